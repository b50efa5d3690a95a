"""The answer log loses nothing that it acknowledged, and says what is wrong with a file."""

import json
import os
import re
import stat
import subprocess
import sys
from dataclasses import replace
from itertools import count
from subprocess import PIPE
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Answer, AnswerLog, BadLog, Query, Verdict
from elicit.tutors import log_file
from elicit.tutors.answer_log import Asked
from elicit.tutors.log_file import with_check
from tests.interruptions import interrupted_at_each_line
from tests.thoroughness import examples, thorough

LEFT, RIGHT = [0.1, 0.2, 0.7], [1 / 3, 1 / 3, 1 / 3]


def answer(name="q", verdict=Verdict.BETTER, left=LEFT, right=RIGHT, **more):
    return Answer(Query(name, left, right, more.pop("about", "")), verdict, **more)


def parts(log):
    """Return the whole contents of a log's entries, to the last bit, for comparisons."""
    blank, queries = Query("", LEFT, RIGHT), [entry.answer.query for entry in log]
    rest = [replace(entry, answer=replace(entry.answer, query=blank)) for entry in log]
    return [repr(entry) for entry in rest], [
        (one.id, one.about, one.left.tobytes(), one.right.tobytes()) for one in queries
    ]


def told(**changes):
    """The line of an answer, with other fields; ... takes one out."""
    fields = {
        "id": "e",
        "left": LEFT,
        "right": RIGHT,
        "verdict": 1,
        "swapped": False,
        "about": "",
        "used": True,
    }
    return json.dumps(
        {name: value for name, value in {**fields, **changes}.items() if value is not ...}
    )


HEADER = '{"format": "elicit answers", "version": 2, "k": 3}'


def write_lines(path, *lines, header=HEADER):
    """A file whose lines have checksums that fit, whatever they say."""
    data, check = with_check(header.encode(), "")
    for line in lines:
        more, check = with_check(line.encode(), check)
        data += more
    path.write_bytes(data)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.jsonl"


def ids(log):
    return [entry.answer.query.id for entry in log]


def filled(path, header=None):
    log = AnswerLog(path, header=header)
    log.append(answer("a", about="ward 3 or ward 4?\nünïcödé \u2028"), time="2024-05-01T12:00:00Z")
    log.append(answer("b", None), used=False)
    log.append(answer("c", Verdict.EQUAL, swapped=True), who={"nurse": [1, 2.5, None]})
    return log


@pytest.mark.parametrize("on_disk", [True, False])
def test_what_went_in_comes_out(path, on_disk):
    path = path if on_disk else None
    log = filled(path)
    assert (len(log), log.k) == (3, 3)
    first = next(iter(log))
    assert isinstance(first.answer.verdict, Verdict)
    assert [e.answer.verdict for e in log] == [1, None, 0]
    assert [(e.used, e.answer.swapped) for e in log] == [
        (True, False),
        (False, False),
        (True, True),
    ]
    assert first.answer.query.about == "ward 3 or ward 4?\nünïcödé \u2028"
    assert [e.metadata for e in log] == [
        {"time": "2024-05-01T12:00:00Z"},
        {},
        {"who": {"nurse": [1, 2.5, None]}},
    ]
    if path is not None:
        log.close()
        assert parts(AnswerLog.read(path)) == parts(AnswerLog(path)) == parts(log)


def test_answers_are_the_used_and_decided_ones():
    log = AnswerLog(k=3)
    assert (len(log.answers()), log.answers().k) == (0, 3)
    for one, used in (
        (answer("a", -1), True),
        (answer("b", None), True),
        (answer("c"), False),
        (answer("d", 0), True),
    ):
        log.append(one, used=used)
    told = log.answers()
    assert (told.ids, told.y.tolist()) == (("a", "d"), [-1, 0])
    assert told.d.tobytes() == np.tile(np.subtract(LEFT, RIGHT), 2).tobytes()


def test_an_empty_log_does_not_guess_k():
    log = AnswerLog()
    assert (log.k, list(log)) == (None, [])
    with pytest.raises(ValueError, match="give k"):
        log.answers()


@given(st.lists(st.floats(-(2.0**1000), 2.0**1000), min_size=6, max_size=6))
@examples(100)
def test_floats_survive_to_the_last_bit(numbers):
    log = AnswerLog()
    log.append(answer(left=numbers[:3], right=numbers[3:]))
    stored = next(iter(log)).answer.query
    assert np.concatenate([stored.left, stored.right]).tobytes() == np.array(numbers).tobytes()


def test_an_existing_file_of_plain_json_lines_is_continued(path):
    filled(path, header={"levels": ["bad", "fair", "good"]})
    before = path.read_bytes()
    lines = [json.loads(line) for line in before.decode("ascii").splitlines()]
    assert all(len(line.pop("check")) == 16 for line in lines)
    assert lines[0] == {
        "format": "elicit answers",
        "version": 2,
        "k": 3,
        "levels": ["bad", "fair", "good"],
    }
    expected = json.loads(told(id="c", verdict=0, swapped=True))
    assert lines[3] == {"event": "answered", **expected, "who": {"nurse": [1, 2.5, None]}}
    log = AnswerLog(path, k=3, header={"levels": ("bad", "fair", "good")})
    assert path.read_bytes() == before, "opening must not change the file"
    log.append(answer("d"))
    assert path.read_bytes().startswith(before)
    assert ids(AnswerLog.read(path)) == ["a", "b", "c", "d"]
    assert AnswerLog.read(path).header["levels"] == ["bad", "fair", "good"]


def test_a_given_k_shows_before_the_first_answer(path):
    log = AnswerLog(path, k=3)
    assert log.k == 3
    with pytest.raises(ValueError, match="3 levels, but query q is about 2"):
        log.append(answer(left=[0, 1], right=[1, 0]))
    assert len(log) == 0
    log.append(answer())
    assert AnswerLog.read(path).k == 3


def cuts(start, end):
    """Return where a file is cut: everywhere; in a quick run at both ends and now and then."""
    between = range(start, end + 1)
    return between if thorough() else sorted({*between[:3], *between[3:-3:11], *between[-3:]})


WRITES = [lambda log: log.append(answer("d")), lambda log: log.retract("a", why="typo")]


@pytest.mark.parametrize("write", WRITES)
def test_a_file_cut_anywhere_in_its_last_line_keeps_the_rest(path, write):
    log = filled(path)
    before, start = log.answers().ids, len(path.read_bytes())
    write(log)
    log.close()
    after, data = log.answers().ids, path.read_bytes()
    for cut in cuts(start, len(data)):
        path.write_bytes(data[:cut])
        left = after if cut >= len(data) - 1 else before  # only the line feed may be missing
        for open_log in (AnswerLog.read, AnswerLog):
            log = None  # lets go of the one before
            log = open_log(path)
            assert log.answers().ids == left, cut
        assert path.read_bytes() == data[:cut], "opening must not change the file"
        log.append(answer("next"))
        log.retract("c")  # either takes a torn line out of the file
        log.close()
        for found in (log, AnswerLog.read(path), AnswerLog(path)):
            assert found.answers().ids == (*(name for name in left if name != "c"), "next"), cut
        del found


def test_a_file_cut_anywhere_in_its_first_lines(path):
    """A crash during the very first append leaves a part of the header, or of the first answer."""
    AnswerLog(path).append(answer("a"))
    data = path.read_bytes()
    header = data.index(b"\n")
    for cut in {*cuts(0, header + 1), *cuts(header, len(data))}:
        path.write_bytes(data[:cut])
        log = None
        log = AnswerLog(path)
        whole = cut >= len(data) - 1
        assert len(log) == whole
        assert log.k == (3 if cut >= header else None)
        log.append(answer("next"))
        assert ids(AnswerLog.read(path)) == (["a", "next"] if whole else ["next"]), cut


def test_garbage_at_the_end_is_torn_too(path):
    filled(path)
    whole = path.read_bytes()
    for tail in (b"\0" * 40, b'{"id": "\xc3', b"\xff\xfe"):
        path.write_bytes(whole + tail)
        log = None
        log = AnswerLog(path)
        assert len(log) == 3
        log.append(answer("d"))
        assert len(AnswerLog.read(path)) == 4


@pytest.mark.parametrize("write", WRITES)
def test_each_write_is_synced(path, monkeypatch, write):
    log, real, synced = filled(path), os.fsync, []
    monkeypatch.setattr(os, "fsync", lambda n: (synced.append(os.fstat(n).st_size), real(n))[1])
    write(log)
    assert synced == [path.stat().st_size]


@pytest.mark.skipif(os.name != "posix", reason="only there a directory can be synced")
def test_the_name_of_a_new_file_is_synced(path, monkeypatch):
    synced = []
    monkeypatch.setattr(os, "fsync", lambda n: synced.append(os.fstat(n).st_ino))
    AnswerLog(path)
    assert synced == [path.parent.stat().st_ino]


def half_written(*args, **kwargs):
    """A file that takes all but the last five bytes."""
    file = open(*args, **kwargs)  # noqa: SIM115
    half = MagicMock(wraps=file)
    type(half).closed = property(lambda self: file.closed)
    half.write.side_effect = lambda data: file.write(data[:-5])
    return half


@pytest.mark.parametrize("write", WRITES)
@pytest.mark.parametrize("fails", ["write", "fsync", "fsync and truncate"])
def test_a_failed_write_changes_nothing(path, monkeypatch, fails, write):
    """A full disk, and one that does not even let go of what it took."""
    filled(path)
    before = path.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(log_file, "open", half_written, raising=False)
        log = AnswerLog(path)
    file = log._file._file
    with monkeypatch.context() as patch:
        if fails == "write":
            failing = pytest.raises(OSError, match="disk full")
        else:
            failing = pytest.raises(OSError, match="No space left")
            patch.setattr(
                os, "fsync", MagicMock(side_effect=OSError(28, "No space left on device"))
            )
            file.write.side_effect = None
            file.write.side_effect = lambda data: os.write(file.fileno(), data)
        if fails == "fsync and truncate":
            file.truncate.side_effect = OSError(5, "Input/output error")
        with failing:
            write(log)
    if fails != "fsync and truncate":
        assert path.read_bytes() == before
    assert (len(log), log.answers().ids) == (3, ("a", "c"))
    file.write.side_effect = lambda data: os.write(file.fileno(), data)
    file.truncate.side_effect = None
    log.append(answer("d"))
    assert path.read_bytes().startswith(before)
    assert AnswerLog.read(path).answers().ids == ("a", "c", "d")


@pytest.mark.parametrize("write", WRITES)
def test_a_writer_that_asks_for_no_lock_is_noticed(path, write):
    log = filled(path)
    with path.open("ab") as other:
        other.write(b"{}")
    before = path.read_bytes()
    with pytest.raises(BadLog, match="something else wrote"):
        write(log)
    assert path.read_bytes() == before
    assert log.answers().ids == ("a", "c")


@pytest.mark.parametrize("change", ["replaced", "deleted"])
@pytest.mark.parametrize("write", WRITES)
def test_a_file_that_was_replaced_takes_no_answer(tmp_path, path, write, change):
    log = filled(path)
    if change == "replaced":
        (tmp_path / "copy").write_bytes(path.read_bytes())
        os.replace(tmp_path / "copy", path)
    else:
        path.unlink()
    with pytest.raises(BadLog, match="moved, deleted or replaced"):
        write(log)
    assert log.answers().ids == ("a", "c")


def test_a_log_has_one_writer_at_a_time(path):
    one = filled(path)
    with pytest.raises(BlockingIOError, match=r"written to by .*one writer at a time"):
        AnswerLog(path)
    one.append(answer("e"))
    assert AnswerLog.read(path).answers().ids == ("a", "c", "e")
    with one:
        pass
    with AnswerLog(path) as two:
        two.append(answer("f"))
        with pytest.raises(ValueError, match="closed: open it again"):
            one.append(answer("g"))
    del two
    three = AnswerLog(path)
    assert three.answers().ids == ("a", "c", "e", "f")
    del three  # what is let go of is free
    AnswerLog(path)


HOLDS = """
import sys, elicit
log = elicit.AnswerLog(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


def test_another_process_is_named_and_its_death_frees_the_log(path):
    filled(path)
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, path], stdin=PIPE, stdout=PIPE, text=True
    ) as other:
        assert other.stdout.readline() == "held\n"
        before = path.read_bytes()
        who = f"process {other.pid}" if sys.platform == "linux" else "another program"
        with pytest.raises(BlockingIOError, match=who):
            AnswerLog(path)
        assert path.read_bytes() == before
        assert len(AnswerLog.read(path)) == 3
        other.kill()
        other.wait()
        AnswerLog(path).append(answer("d"))
    assert len(AnswerLog.read(path)) == 4


@pytest.mark.skipif(os.name != "posix", reason="permission bits and pipes are POSIX")
def test_only_regular_files_and_new_ones_are_private(tmp_path, path):
    os.mkfifo(tmp_path / "pipe")
    for place, kind in (
        ("/dev/full", "a device"),
        (tmp_path, "a directory"),
        (tmp_path / "pipe", "a pipe"),
    ):
        for open_log in (AnswerLog, AnswerLog.read):
            with pytest.raises(BadLog, match=f"is {kind}: an answer log is a regular file"):
                open_log(place)
    before = os.umask(0)
    try:
        filled(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.chmod(0o640)
    AnswerLog(path).append(answer("d"))
    assert stat.S_IMODE(path.stat().st_mode) == 0o640, "what someone chose stays"


def test_a_file_that_cannot_be_written_shows_at_once(path, monkeypatch):
    filled(path)

    def open_file(path, mode="r", **more):
        if "a" in mode or "w" in mode or "+" in mode:
            raise PermissionError(13, "Permission denied", str(path))
        return open(path, mode, **more)

    monkeypatch.setattr(log_file, "open", open_file, raising=False)
    with pytest.raises(PermissionError):
        AnswerLog(path)
    assert len(AnswerLog.read(path)) == 3


def everything(path):
    """A log with every event."""
    with filled(path, header={"unit": "days"}) as log:
        log.append_asked(answer("d").query, swapped=True, words="of 100 days")
        log.append(answer("d"), latency=2.5)
        log.mark_unused("d", why="contradicts")
        log.retract("a")
        log.mark_restart(session="x")
        log.append(answer("e"))
    return log


def test_every_event_comes_out(path):
    log = everything(path)
    for found in (log, AnswerLog.read(path), AnswerLog(path)):
        assert parts(found) == parts(log)
        assert [(one.query.id, one.metadata) for one in found.asked] == [
            ("d", {"words": "of 100 days"})
        ]
        assert all(isinstance(one, Asked) and one.swapped for one in found.asked)
        assert found.restarted == 4
        assert [entry.used for entry in found] == [False, False, True, False, True]
        assert [entry.metadata for entry in found][3] == {"latency": 2.5, "why": "contradicts"}
        assert found.header == {"format": "elicit answers", "version": 2, "k": 3, "unit": "days"}
    assert [json.loads(line).get("event") for line in path.read_text().splitlines()] == [
        None, *["answered"] * 3, "asked", "answered", "unused", "withdrawn", "restarted",
        "answered",
    ]  # fmt: skip


def short(path):
    """A log of few bytes."""
    with AnswerLog(path) as log:
        log.append(answer("b", left=[0, 0, 1], right=[1, 0, 0]))
        log.mark_unused("b")


@pytest.mark.parametrize("write", [short, everything])
def test_every_flipped_bit_is_noticed(path, write):
    """This holds for acknowledged entries. A quick run flips one bit of each byte."""
    write(path)
    whole, unseen = path.read_bytes(), []
    with open(path, "r+b", buffering=0) as file:
        for place, byte in enumerate(whole):
            for bit in range(8) if thorough() else [place % 8]:
                file.seek(place)
                file.write(bytes([byte ^ 1 << bit]))
                try:
                    AnswerLog.read(path)
                except BadLog:
                    continue
                unseen.append((place, bit))
            file.seek(place)
            file.write(bytes([byte]))
    assert not unseen
    assert path.read_bytes() == whole


def test_lines_left_out_moved_or_doubled_are_noticed(path):
    everything(path)
    lines = path.read_bytes().splitlines(keepends=True)
    for i in range(len(lines) - 1):
        for wrong in (
            lines[:i] + lines[i + 1 :],
            [*lines[:i], lines[i + 1], lines[i], *lines[i + 2 :]],
            [*lines[: i + 1], *lines[i:]],
        ):
            path.write_bytes(b"".join(wrong))
            with pytest.raises(BadLog):
                AnswerLog.read(path)


def test_what_stands_before_the_damage_can_be_read(path):
    whole = list(everything(path))
    lines = path.read_bytes().splitlines(keepends=True)
    for i, was in ((2, b'"verdict": null'), (4, b'"check"'), (6, b'"}')):
        damaged = [*lines[:i], lines[i].replace(was, was.replace(b'"', b"'")), *lines[i + 1 :]]
        path.write_bytes(b"".join(damaged))
        faults = []
        found = AnswerLog.read(path, faults)
        assert [fault.line for fault in faults] == [i + 1]
        assert ids(found) == [
            entry.answer.query.id for entry in whole[: min(i - 1, 3) if i < 6 else 4]
        ]
        for open_log in (AnswerLog, AnswerLog.read):
            with pytest.raises(BadLog) as caught:
                open_log(path)
            assert caught.value.line == i + 1
            said = str(caught.value)
            assert f"line {i + 1} of {path} is damaged" in said
            assert (
                f"or save the {i - 1} events before it: qlearn log merge --salvage --out NEW {path}"
                in said
            )


@pytest.mark.parametrize("open_log", [AnswerLog, AnswerLog.read])
def test_a_log_of_version_1_is_refused_in_one_sentence(path, open_log):
    path.write_text('{"format": "elicit answers", "version": 1, "k": 3}\n' + told(id="a") + "\n")
    with pytest.raises(BadLog) as caught:
        open_log(path)
    said = (
        f"{path} is a log of version 1, which no release has written: this program reads version 2"
    )
    assert str(caught.value) == said


@pytest.mark.parametrize("on_disk", [True, False])
def test_a_retracted_answer_stays_in_the_log_but_teaches_nothing(path, on_disk):
    path = path if on_disk else None
    log = filled(path)
    log.append(answer("a", Verdict.WORSE))  # the same query, told twice
    before = path.read_bytes() if on_disk else b""
    log.retract("a", who="nurse", why={"typo": True})
    log.retract("b")
    assert log.answers().ids == ("c",)
    assert ids(log) == ["a", "b", "c", "a"]
    assert [entry.retracted for entry in log] == [True, True, False, True]
    assert [entry.used for entry in log] == [False, False, True, False]
    assert next(iter(log)).metadata == {"time": "2024-05-01T12:00:00Z"}
    reason = {"who": "nurse", "why": {"typo": True}}
    assert [entry.retraction for entry in log] == [reason, {}, None, reason]
    if on_disk:
        log.close()
        assert path.read_bytes().startswith(before)
        lines = [json.loads(line) for line in path.read_bytes()[len(before) :].splitlines()]
        assert all(line.pop("check") for line in lines)
        assert lines == [
            {"event": "withdrawn", "id": "a", **reason},
            {"event": "withdrawn", "id": "b"},
        ]
        assert parts(AnswerLog.read(path)) == parts(AnswerLog(path)) == parts(log)


def test_what_cannot_be_retracted(path):
    log = filled(path)
    log.retract("a")
    before = path.read_bytes()
    for opened, name, more, complaint in (
        (log, "x", {}, "'x' cannot be retracted: this log has none"),
        (log, "a", {}, "'a' was retracted already"),
        *((log, "c", {field: 1}, field) for field in ("about", "event", "check", "used")),
        (log, "c", {"why": object()}, "plain JSON"),
        (AnswerLog.read(path), "c", {}, "opened for reading"),
        (AnswerLog(), "a", {}, "this log has none"),
    ):
        with pytest.raises(ValueError, match=complaint):
            opened.retract(name, **more)
    assert path.read_bytes() == before
    assert log.answers().ids == ("c",)


@given(
    st.lists(
        st.tuples(st.sampled_from("abc"), st.sampled_from([-1, 0, 1, None, "retract"])), max_size=12
    )
)
@examples(60)
def test_retractions_against_a_list(tmp_path_factory, history):
    """Any history, also after a restart at each step, against the plain list of what stands."""
    path = tmp_path_factory.mktemp("log") / "log.jsonl"
    stands: list[tuple[str, int | None]] = []
    for name, verdict in history:
        log = None
        log = AnswerLog(path, k=3)
        if verdict != "retract":
            log.append(answer(name, verdict))
            stands.append((name, verdict))
        elif any(told == name for told, _ in stands):
            log.retract(name)
            stands = [one for one in stands if one[0] != name]
        else:
            with pytest.raises(ValueError, match="retracted"):
                log.retract(name)
        log.close()
        for found in (log, AnswerLog(path, k=3)):
            assert [
                (e.answer.query.id, e.answer.verdict) for e in found if not e.retracted
            ] == stands
            told = found.answers()
            assert list(zip(told.ids, told.y.tolist(), strict=True)) == [
                s for s in stands if s[1] is not None
            ]
        del found


def test_reading_does_not_write(tmp_path, path):
    filled(path)
    log = AnswerLog.read(path)
    with pytest.raises(ValueError, match="opened for reading"):
        log.append(answer("d"))
    for open_log, missing in (
        (AnswerLog.read, tmp_path / "none"),
        (AnswerLog, tmp_path / "none" / "log.jsonl"),
    ):
        with pytest.raises(FileNotFoundError):
            open_log(missing)
    assert not (tmp_path / "none").exists()
    empty = tmp_path / "empty"
    empty.touch()
    assert len(AnswerLog.read(empty)) == 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hello", "no answer log"),
        ("hello\n", "no answer log"),
        ("[1, 2]\n", "no answer log"),
        ('{"format": "other"}\n', "no answer log"),
        (
            '{"format": "elicit answers", "version": 3, "k": 3}\n',
            "log of version 3: this program reads version 2",
        ),
        (
            '{"format": "elicit answers", "version": true, "k": 3}\n',
            "log of version True: this program reads",
        ),
        ('{"format": "elicit answers", "version": 2, "k": 3}\n', "checksum does not fit"),
        (with_check(b'{"format": "elicit answers", "version": 2}', "")[0].decode(), "k = None"),
        (
            with_check(b'{"format": "elicit answers", "version": 2, "k": "3"}', "")[0].decode(),
            "k = '3'",
        ),
    ],
)
@pytest.mark.parametrize("open_log", [AnswerLog, AnswerLog.read])
def test_files_that_are_no_log(path, text, complaint, open_log):
    path.write_text(text)
    with pytest.raises(BadLog, match=complaint) as caught:
        open_log(path)
    assert caught.value.line == 1
    assert path.read_text() == text


@pytest.mark.parametrize("line", ["", "{", "3", "null", '{"id": "a"', told(id="x")])
def test_a_line_that_is_none_of_a_logs(path, line):
    filled(path)
    data = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*data[:3], line.encode() + b"\n", data[3]]))
    with pytest.raises(BadLog, match="is damaged") as caught:
        AnswerLog(path)
    assert caught.value.line == 4
    assert f"line 4 of {path}" in str(caught.value)


def event(kind, **changes):
    return json.dumps({"event": kind, **json.loads(told(**changes))})


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        (event("answered", left=...), "no field 'left'"),
        (event("asked", left=[0, 1], right=[1, 0]), "about 3 levels, but query e is about 2"),
        (event("answered", left=[0, 1, float("nan")]), "finite"),
        (event("answered", left=[0, 1]), r"\(2,\) with \(3,\)"),
        (event("answered", left=[0, 1, None]), "finite|number"),
        (event("answered", left="abc"), "abc"),
        (event("answered", verdict=2), "verdict is 2"),
        (event("answered", verdict=True), "verdict is True"),
        (event("answered", verdict="better"), "verdict is 'better'"),
        (event("answered", used=1), "used is 1"),
        (event("asked", id=7), "id is 7"),
        (event("asked", swapped=None), "swapped is None"),
        (event("forgotten"), "no such event: 'forgotten'; was the file written by a newer program"),
        (told(), "no field 'event'"),
        ('{"event": "withdrawn", "id": "x"}', "'x' cannot be retracted"),
        (
            '{"event": "withdrawn", "id": "b"}',
            "'b' cannot be retracted",
        ),  # only what was told before
        ('{"event": "withdrawn", "id": null}', "None"),
        ('{"event": "withdrawn", "id": ["a"]}', "cannot be retracted"),
        ('{"event": "withdrawn", "about": "x"}', "no field 'id'"),
        ('{"event": "unused", "id": "x"}', "no used answer has the id 'x'"),
    ],
)
def test_a_line_that_says_what_cannot_be(path, line, complaint):
    write_lines(path, event("answered", id="a"), line, event("answered", id="b"))
    with pytest.raises(BadLog, match=complaint) as caught:
        AnswerLog(path)
    assert caught.value.line == 3
    assert ids(AnswerLog.read(path, [])) == ["a", "b"]


def test_another_log_than_the_one_expected(path):
    filled(path, header={"problem": "icu"})
    for wanted, complaint in (
        ({"k": 4}, "k = 3, not 4"),
        ({"header": {"problem": "ward"}}, "= 'icu', not 'ward'"),
        ({"header": {"unit": "days"}}, "nothing of unit, not 'days'"),
        ({"k": 3, "header": {"problem": "icu", "discount": None}}, "nothing of discount"),
    ):
        with pytest.raises(BadLog, match=complaint):
            AnswerLog(path, **wanted)
    assert len(AnswerLog(path, k=3, header={"problem": "icu"})) == 3


@pytest.mark.parametrize("open_log", [AnswerLog, AnswerLog.read])
def test_what_is_no_path_is_refused_by_name(open_log):
    with pytest.raises(
        TypeError, match=r"path must be the name of a file, .* not 4: the number of levels is k=4"
    ):
        open_log(4)
    for other in (["log.jsonl"], 4.5, True):
        with pytest.raises(
            TypeError,
            match=f"path must be the name of a file, or None .*not {re.escape(repr(other))}$",
        ):
            open_log(other)


def test_bad_arguments():
    for header, complaint in (
        ({"k": 3}, "not free fields"),
        ({"levels": {1, 2}}, "header must be plain JSON"),
    ):
        with pytest.raises(ValueError, match=complaint):
            AnswerLog(header=header)
    log = AnswerLog()
    for more, complaint in (
        ({"when": object()}, "metadata must be plain JSON"),
        ({"weight": float("nan")}, "metadata must be plain JSON"),
        ({"left": 3}, "left"),
    ):
        with pytest.raises(ValueError, match=complaint):
            log.append(answer(), **more)
    assert (len(log), log.k) == (0, None)


def test_a_log_is_read_like_a_list(path):
    log = AnswerLog(path)
    for name in "abc":
        log.append(answer(name))
    log.retract("b")
    assert (log[0].answer.query.id, log[-1].answer.query.id, log[1].retracted) == ("a", "c", True)
    assert [entry.answer.query.id for entry in log[1:]] == ["b", "c"]
    assert type(log[:0]) is tuple
    with pytest.raises(IndexError, match="there is no answer 3: the log has 3"):
        log[3]
    assert repr(log) == f"AnswerLog(3 answers, 1 of them retracted, k=3, path={str(path)!r})"
    assert repr(AnswerLog.read(path)).endswith(", read only)")
    assert repr(AnswerLog()) == "AnswerLog(0 answers, k=None)"


def test_interrupted_when_the_line_was_on_the_disk_the_log_goes_on(tmp_path, monkeypatch):
    """An interruption by Ctrl+C in a notebook leaves the session as it is."""
    path, answers = (
        tmp_path / "log.jsonl",
        [Answer(Query(f"q{i}", [0, 1], [1, 0]), 1) for i in range(3)],
    )
    append = log_file.LogFile.append

    def interrupted(self, data):
        append(self, data)
        raise KeyboardInterrupt

    with AnswerLog(path) as log:
        log.append(answers[0])
        with monkeypatch.context() as patch:
            patch.setattr(log_file.LogFile, "append", interrupted)
            with pytest.raises(KeyboardInterrupt):
                log.append(answers[1])
        assert len(log) == 2
        log.append(answers[2])
        assert [entry.answer.query.id for entry in log] == ["q0", "q1", "q2"]
    assert [entry.answer.query.id for entry in AnswerLog.read(path)] == ["q0", "q1", "q2"]


def test_interrupted_at_any_line_an_append_is_in_the_log_and_the_file_or_in_neither(tmp_path):
    answers = [Answer(Query(f"q{i}", [0, 1], [1, 0]), 1) for i in range(3)]
    acts = [
        lambda log: log.append(answers[1], used=False),
        lambda log: log.append_asked(answers[1].query),
        lambda log: log.retract("q0"),
        lambda log: log.mark_restart(),
    ]
    for n, act in enumerate(acts):
        number = count()

        def new(n=n, number=number):
            log = AnswerLog(tmp_path / f"{n}-{next(number)}.jsonl")
            log.append(answers[0])
            return log

        outcomes = set()
        for log in interrupted_at_each_line(new, act):
            found = list(log), log.asked, log.restarted
            outcomes.add(repr(found))
            log.append(answers[2])
            assert log[-1].answer.query.id == "q2"
            assert len(log) == len(found[0]) + 1
            log.close()
            read = AnswerLog.read(log.path)
            assert repr((list(read)[:-1], read.asked, read.restarted)) == repr(found)
            assert repr(read[-1]) == repr(log[-1])
        assert len(outcomes) == 2, n
