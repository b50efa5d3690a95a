"""``qlearn teach --web`` as it runs: killed, without room, beside another one; and nothing that was
taken is lost.
"""

import errno
import random
import re
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from http.client import HTTPException
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from elicit import AnswerLog, Session
from qlearn import draw_values
from qlearn.cli.main import main
from qlearn.cli.teach_subjects import taught_by
from tests.scripted_person import Teach
from tests.web_person import TeachWeb, Visitor, answer_all, untimed

VALUES = dict(zip([f"level {i}" for i in range(1, 6)], draw_values(5, 7).tolist(), strict=True))
FINE = ("--problem", "random", "--comparator", "polytope", "--days", "20", "--tolerance", "0.001")


def told(log: Path) -> list[tuple[Any, ...]]:
    """The answers of a log."""
    return [(e.answer.query.id, e.answer.verdict, e.used, e.retracted) for e in AnswerLog.read(log)]


def policy_of(log: Path) -> list[int]:
    """Return the policy that was learned."""
    taught = taught_by("random", "polytope", 20, None, 0, 0.001)
    with Session(taught.make, log) as session:
        assert session.question() is None
        found: list[int] = session.result().policy.tolist()
        return found


@dataclass(frozen=True)
class Undisturbed:
    """The record of an undisturbed session: answers, policy, end, times to start and to answer."""

    told: list[tuple[Any, ...]]
    policy: list[int]
    end: Any
    starting: float
    answering: float


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    begun = time.monotonic()
    with TeachWeb(folder, *FINE) as teach:
        started = time.monotonic()
        screen = answer_all(teach.visitor, VALUES)
        ended = time.monotonic()
    log = folder / "answers-random.jsonl"
    assert len(told(log)) > 8
    return Undisturbed(told(log), policy_of(log), screen["end"], started - begun, ended - started)


def killed(folder: Path, expected: Undisturbed, kills: int, seed: int) -> int:
    """Kill so many servers at random moments while a person answers, and go on each time. Returns
    how many sessions came to their end."""
    chance, done, ended = random.Random(seed), 0, 0
    while done < kills:
        log, acknowledged, before, screen = folder / f"{ended}.jsonl", [], 0, None
        while screen is None:
            if done < kills and chance.random() < 0.2:
                with Teach(folder, "--web", *FINE, "--log", log.name):
                    time.sleep(chance.uniform(0, 1.2 * expected.starting))
                done += 1
            with TeachWeb(folder, *FINE, "--log", log.name) as teach:
                timer = threading.Timer(
                    chance.uniform(0, 1.2 * expected.answering), teach.process.kill
                )
                if done < kills:
                    timer.start()
                try:
                    screen = answer_all(teach.visitor, VALUES, acknowledged=acknowledged.append)
                except (OSError, HTTPException):
                    done += 1
                timer.cancel()
            kept = [row[0] for row in told(log)] if log.exists() else []
            assert kept[: len(acknowledged)] == acknowledged  # what was taken is there, in order
            assert len({*kept}) == len(kept)
            assert before <= len(kept) <= len(acknowledged) + 1
            before, acknowledged = len(kept), kept  # which the next page shows as answered
        assert told(log) == expected.told
        assert policy_of(log) == expected.policy
        assert untimed(screen["end"]) == untimed(expected.end)
        ended += 1
    return ended


def refused(capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """Return the message of the command if it does not start."""
    assert main(["teach", "--web", "--problem", "random", *options]) == 1
    shown = capsys.readouterr()
    assert shown.out == ""
    return " ".join(shown.err.split())


@pytest.mark.slow
def test_killed_at_random_moments_nothing_is_lost_and_the_end_is_the_same(
    tmp_path: Path, undisturbed: Undisturbed
) -> None:
    assert killed(tmp_path, undisturbed, 2, seed=1)


@pytest.mark.slow
def test_killed_fifty_times_nothing_is_lost_and_the_end_is_the_same(
    tmp_path: Path, undisturbed: Undisturbed
) -> None:
    assert killed(tmp_path, undisturbed, 50, seed=2)


@pytest.mark.slow
def test_an_address_a_second_browser_and_the_command_that_goes_on(tmp_path: Path) -> None:
    with TeachWeb(tmp_path, "--problem", "random", "--tolerance", "0.05") as teach:
        assert re.fullmatch(
            r"http://127\.0\.0\.1:\d+", teach.visitor.at.scheme + "://" + teach.visitor.at.netloc
        )
        screen = answer_all(teach.visitor, VALUES, most=2)
        assert teach.process.stdin is not None
        teach.process.stdin.write(b"\n")
        teach.process.stdin.flush()
        phone = Visitor(teach.printed())
        assert phone.screen() == screen
        with ThreadPoolExecutor(2) as pool:
            id = screen["question"]["id"]
            both = [
                pool.submit(who.post, {"do": "answer", "id": id, "choice": "a"})
                for who in (phone, teach.visitor)
            ]
            assert {reply.result()[1]["answered"] for reply in both} == {2}
        code, rest, errors = teach.interrupt()
    assert code == 0
    assert rest == (
        "Kept: 2 answers. To go on:\n  qlearn teach --problem random --comparator posterior --log "
        "answers-random.jsonl "
        "--days 10 --seed 0 --tolerance 0.05 --web\n"
    )
    assert "it works once. Enter: another one. Ctrl+C: stop." in errors
    assert "Traceback" not in errors
    assert len(told(tmp_path / "answers-random.jsonl")) == 2


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux limits the files of another process"
)
def test_without_room_it_says_so_and_goes_on_once_there_is_some(
    tmp_path: Path, undisturbed: Undisturbed
) -> None:
    import resource

    log = tmp_path / "answers-random.jsonl"
    with TeachWeb(tmp_path, *FINE) as teach:
        visitor = teach.visitor
        screen = answer_all(visitor, VALUES, most=3)
        kept = told(log)
        _, most = resource.prlimit(teach.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(teach.process.pid, resource.RLIMIT_FSIZE, (log.stat().st_size + 50, most))
        for _ in range(3):
            status, reply = visitor.post(
                {"do": "answer", "id": screen["question"]["id"], "choice": "a"}
            )
            assert (status, reply.keys()) == (507, {"error"})
            assert "could not be saved" in reply["error"]
            assert told(log) == kept
        assert visitor.screen()["question"] == screen["question"]
        resource.prlimit(teach.process.pid, resource.RLIMIT_FSIZE, (most, most))
        answer_all(visitor, VALUES)
        code, _, errors = teach.interrupt()
    assert code == 0
    assert "Traceback" not in errors
    assert (told(log), policy_of(log)) == (undisturbed.told, undisturbed.policy)


def check_broken_and_tear(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that a log with a flipped bit is refused, and leave it whole but for a torn line."""
    whole = log.read_bytes()
    middle = len(whole) // 2
    log.write_bytes(whole[:middle] + bytes([whole[middle] ^ 4]) + whole[middle + 1 :])
    assert re.search(r"line \d+ of answers-random\.jsonl", refused(capsys))
    log.write_bytes(whole + b'{"event": "answered", "id": "x')  # a torn line is no fault


@pytest.mark.slow
def test_a_log_that_cannot_be_gone_on_with_is_said_before_there_is_an_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "answers-random.jsonl"
    with TeachWeb(tmp_path, "--problem", "random") as teach:
        answered = answer_all(teach.visitor, VALUES, most=4)["answered"]
        assert answered > 0
        assert re.search(rf"answers-random\.jsonl .*{teach.process.pid}", refused(capsys))
        port = str(teach.visitor.at.port)
        said = refused(capsys, "--log", "other.jsonl", "--port", port)
        assert f"cannot listen on 127.0.0.1, port {port}: Address already in use" in said
    check_broken_and_tear(log, capsys)
    with TeachWeb(tmp_path, "--problem", "random") as teach:
        assert teach.visitor.screen()["answered"] == answered


def test_a_log_or_a_port_in_use_and_a_broken_log_are_said_before_there_is_an_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", StringIO("a\na\na\nq\n"))
    assert main(["teach", "--problem", "random", "--comparator", "polytope"]) == 0
    capsys.readouterr()
    log = tmp_path / "answers-random.jsonl"
    answered = told(log)
    assert len(answered) == 2  # the first key answers the practice question
    with AnswerLog(log):
        assert "answers-random.jsonl is being written to by another AnswerLog" in refused(capsys)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = f"{taken.getsockname()[1]}"
        said = refused(capsys, "--log", "other.jsonl", "--port", port)
        assert f"cannot listen on 127.0.0.1, port {port}: Address already in use" in said
    check_broken_and_tear(log, capsys)
    assert told(log) == answered


def test_a_log_that_may_not_be_written_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def closed(path: object, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("elicit.tutors.log_file.open", closed, raising=False)
    assert "answers-random.jsonl may not be read or written by you" in refused(capsys)


def test_what_lets_others_in_must_be_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    said = refused(capsys, "--host", "192.0.2.1")
    assert (
        "192.0.2.1 can be reached by other machines, and what is sent there is not encrypted"
        in said
    )
    assert "cannot listen on 192.0.2.1" in refused(capsys, "--host", "192.0.2.1", "--let-others-in")
