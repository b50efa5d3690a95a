"""Nobody of a study reads or writes another's answers, whatever they send."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import AnswerLog, PolytopeComparator, Session, Subject, choose
from elicit.person.hosts.study_web import StudyServer
from elicit.person.study.study import Study
from tests.study_visitors import Guest, anywhere, posted
from tests.web_person import answer_all

LABELS = ("died", "worse", "ill", "well")
VALUES = {
    "ann": {"died": 0.0, "worse": 0.2, "ill": 0.3, "well": 1.0},
    "ben": {"died": 0.0, "worse": 0.7, "ill": 0.9, "well": 1.0},
    "chen": {"died": 0.0, "worse": 0.1, "ill": 0.9, "well": 1.0},
}
VECTORS = np.random.default_rng(0).multinomial(10, [0.25] * 4, 8)


def make(known: Any = ()) -> Any:
    return choose(VECTORS, PolytopeComparator(4), order=True, known=known)


class Room:
    """A study of three people, their logs, and those who opened the links."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.paths = {who: folder / f"{who}.jsonl" for who in VALUES}
        sessions = {
            who: stack.enter_context(Session(make, path, who=who))
            for who, path in self.paths.items()
        }
        self.study = stack.enter_context(Study(sessions, Subject(LABELS, least=0)))
        self.server = stack.enter_context(StudyServer(self.study))
        self.links = self.server.links()
        self.guests = {who: Guest(link) for who, link in self.links.items()}
        self.runner = Guest(self.server.new_address())
        self.everybody = {**self.guests, "runner": self.runner}

    def logs(self) -> dict[str, bytes]:
        """Return the files on the disk, by name."""
        return {who: path.read_bytes() for who, path in self.paths.items()}

    def answers(self, who: str) -> list[Any]:
        return [
            (e.answer.query.id, e.answer.verdict, e.answer.who)
            for e in AnswerLog.read(self.paths[who])
        ]


@pytest.fixture
def room(tmp_path: Path) -> Iterator[Room]:
    with ExitStack() as stack:
        yield Room(stack, tmp_path)


def test_each_answers_in_a_log_of_their_own_at_once(room: Room) -> None:
    said: dict[str, list[str]] = {who: [] for who in VALUES}

    def answers(who: str) -> Any:
        return answer_all(room.guests[who], VALUES[who], acknowledged=said[who].append)

    with ThreadPoolExecutor(3) as pool:
        ends = dict(zip(VALUES, pool.map(answers, VALUES), strict=True))
    for who, screen in ends.items():
        found = room.answers(who)
        assert [id for id, _, _ in found] == said[who]
        assert {name for _, _, name in found} == {who}
        assert screen["answered"] == len(found)
        with Session(make, AnswerLog(k=4)) as alone:  # the same answers as from one who is alone
            values = np.array([VALUES[who][label] for label in LABELS])
            while query := alone.question():
                apart = float(query.d @ values)
                alone.answer(query.id, 0 if abs(apart) < 1e-9 else 1 if apart > 0 else -1)
            assert [(e.answer.query.id, e.answer.verdict) for e in alone.log] == [
                (id, verdict) for id, verdict, _ in found
            ]


def test_a_cookie_opens_the_page_of_its_owner_alone(room: Room) -> None:
    for who, guest in room.guests.items():
        answer_all(guest, VALUES[who], most=3)
    before = room.logs()
    messages = [{"do": do} for do in ("state", "answers", "report", "result", "finish", "end")]
    messages += [{"do": "download", "what": "answers", "format": "csv"}]
    for mine, theirs in permutations(room.everybody.values(), 2):
        assert mine.cookie != theirs.cookie
        cookie = mine.cookie
        for path in ("/", "/page/page.js", "/page/runner.js", "/?token=x"):
            status, headers, body = anywhere(mine, "GET", theirs.folder + path, cookie=cookie)
            assert (status, "set-cookie" in headers, b"function" in body) == (403, False, False)
        for message in messages:
            status, reply = posted(mine, f"{theirs.folder}/api", message, cookie)
            assert (status, b'"answered"' in reply) == (403, False)
        both = f"{cookie}; {cookie.split('=')[0]}=x"
        assert posted(mine, f"{theirs.folder}/api", messages[0], both)[0] == 403
    assert room.logs() == before


def test_no_path_leads_round_a_door(room: Room) -> None:
    ann, ben = room.guests["ann"], room.guests["ben"]
    to_ben = ("/1/../2/api", "/1/..%2f2/api", "/1/%2e%2e/2/api", "/1//2/api", "/1/2/api", "//2/api")
    more = ("/2%2fapi", "/%32/api", "/02/api", "/2;/api", "/2/api/", "/2/./api", "2/api", "/2\\api")
    for path in (*to_ben, *more, "/1/../study/api", "/study/../2/api", "/api", "/page/page.js"):
        status, reply = posted(ann, path, {"do": "state"}, ann.cookie)
        assert status in (400, 403, 404, 405), path
        assert b'"answered"' not in reply
    for path in ("/", "/0/", "/4/", "/1", "/2", "/study", "/-1/", "/nobody/", "/\u00b2/".encode()):
        where = path if isinstance(path, str) else "/%C2%B2/"
        assert anywhere(ann, "GET", where, cookie=ann.cookie)[0] == 403
        assert anywhere(ann, "GET", where, cookie=room.runner.cookie)[0] == 403
    assert (
        posted(ben, "/%32/api", {"do": "state"}, ben.cookie)[0] == 200
    )  # the same path, written otherwise


def test_a_token_is_for_one_person_once(room: Room) -> None:
    tokens = {who: link.split("token=")[1] for who, link in room.links.items()}
    assert all(re.fullmatch(r"[\w-]{43}", token) for token in tokens.values())
    assert len({*tokens.values()}) == 3
    fresh = room.runner.screen("link", who="ben")
    link = next(one["link"] for one in fresh["people"] if one["who"] == "ben")
    query = link.split("?")[1]
    for folder in ("/1", "/3", "/study", ""):
        status, headers, _ = anywhere(room.runner, "GET", f"{folder}/?{query}")
        assert (status, "set-cookie" in headers) == (403, False)
    assert [Guest(old).status for old in room.links.values()] == [403] * 3
    assert Guest(link).status == 303
    assert Guest(link).status == 403


def test_a_new_link_shuts_out_the_browser_before_and_nobody_else(room: Room) -> None:
    answered = answer_all(room.guests["ann"], VALUES["ann"], most=2)
    room.runner.screen("link", who="ann")
    status, reply = room.guests["ann"].post({"do": "state"})
    assert (status, "Ask whoever runs the study" in reply["error"]) == (403, True)
    assert room.guests["ben"].screen()["stage"] == "welcome"
    again = Guest(room.server.links()["ann"])
    assert again.screen() == answered
    closed = room.guests["ann"].fetch("GET", "/", cookie=room.guests["ann"].cookie)
    assert (closed[0], b"Ask whoever runs the study for a new link" in closed[2]) == (403, True)


def test_what_was_sent_for_one_means_nothing_to_another(room: Room) -> None:
    """A question's id is the same for everybody who said the same so far."""
    ann, ben = room.guests["ann"], room.guests["ben"]
    first = answer_all(ann, VALUES["ann"], most=1)["question"]["id"]
    assert answer_all(ben, VALUES["ben"], most=1)["question"]["id"] == first
    ann.screen("answer", id=first, choice="a")
    assert ben.screen()["question"]["id"] == first  # not answered by ann
    before = room.logs()
    message = {"do": "answer", "id": first, "choice": "b"}
    assert posted(ann, "/2/api", message, ann.cookie)[0] == 403  # replayed at another's
    assert ann.post(message)[0] == 200  # and at one's own: it stands as it was answered
    assert ann.post({"do": "withdraw", "id": "never asked"})[0] == 200
    assert room.logs() == before
    assert room.answers("ben") == []


def test_each_page_refuses_what_the_single_page_refuses(room: Room) -> None:
    for guest in room.everybody.values():
        state = {"do": "state"}
        assert guest.post(state, origin="http://evil.example")[0] == 403
        assert guest.post(state, sec_fetch_site="cross-site")[0] == 403
        assert guest.post(state, content_type="text/plain")[0] == 415
        assert guest.post(b"x" * 20_000)[0] == 413
        assert guest.post(state, host="evil.example")[0] == 421
        assert guest.post(state, cookie="")[0] == 403
        assert guest.post("[]")[0] == 400
        assert guest.post({"do": "link", "who": "nobody"})[0] == 400
        _, headers, _ = guest.fetch("GET", "/", cookie=guest.cookie)
        assert headers["content-security-policy"].startswith("default-src 'none'")
        assert headers["cache-control"] == "no-store"
    for message in ("state", "agreement", "end"):  # of a person, these are none or their own
        assert "people" not in room.guests["ann"].post({"do": message})[1]
    assert not room.study.ended


def test_the_runner_sees_where_each_is_and_ends_the_study(room: Room) -> None:
    seen = room.runner.screen()
    assert [(one["who"], one["answered"], one["opened"]) for one in seen["people"]] == [
        (who, 0, True) for who in VALUES
    ]
    assert "two people" in room.runner.screen("agreement")["few"]
    screens = {who: answer_all(room.guests[who], VALUES[who], most=3) for who in ("ann", "ben")}
    seen = room.runner.screen()["people"]
    assert [one["answered"] for one in seen] == [
        screens["ann"]["answered"],
        screens["ben"]["answered"],
        0,
    ]
    assert [one["state"] for one in seen] == ["answering", "answering", "has not come yet"]
    agreed = room.runner.screen("agreement")
    assert (agreed["people"], agreed["few"], len(agreed["levels"])) == (["ann", "ben"], "", 4)
    before = room.logs()
    ended = room.runner.screen("end")
    assert ended["ended"]
    assert [one["state"] for one in ended["people"]] == [
        "ended before finishing",
        "ended before finishing",
        "ended before the first answer",
    ]
    late = room.guests["ann"].screen("answer", id=screens["ann"]["question"]["id"], choice="a")
    assert (late["stage"], late["last"], late["end"]["more"]) == ("end", None, False)
    assert "has ended" in late["note"]
    for do, parts in {"undo": {"id": "x"}, "more": {}, "start": {}, "finish": {}}.items():
        assert room.guests["ben"].screen(do, **parts)["stage"] == "end"
    assert room.guests["chen"].screen()["stage"] == "end"
    assert room.logs() == before
    assert room.runner.screen()["people"] == ended["people"]  # also once they have seen the result
    assert room.guests["ann"].screen("answers")["answers"]


def test_one_who_sends_a_lot_keeps_nobody_waiting(room: Room) -> None:
    ann, ben = room.guests["ann"], room.guests["ben"]
    begun = room.study.interviews["ann"]._lock
    with begun, ThreadPoolExecutor(60) as pool:
        waiting = [pool.submit(ann.post, {"do": "state"}) for _ in range(60)]
        assert ben.screen()["stage"] == "welcome"
        assert room.runner.screen()["people"]
        assert not any(one.done() for one in waiting)
        begun.release()
        assert {one.result()[0] for one in waiting} == {200}
        begun.acquire()
