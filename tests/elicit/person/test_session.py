"""A session is where its log says, whatever happened in between."""

import errno
import os
from collections.abc import Sequence
from datetime import datetime
from functools import cache
from itertools import count
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    InconsistentAnswers,
    Panel,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Session,
    StaleAnswer,
    TruthfulTutor,
    Verdict,
    choose,
)
from elicit.asking.elicitation import Elicitation
from elicit.asking.question import Pair
from elicit.tutors.answer_log import CONTRADICTS
from tests.interruptions import interrupted_at_each_line
from tests.thoroughness import quick_first, scaled

K = 5
VECTORS = np.random.default_rng(0).dirichlet(np.ones(K), 14)[: scaled(10, 14)]
VALUES = [0, 10, 11, 40, 99]


def make(known: Any = ()) -> Any:
    return choose(VECTORS, PolytopeComparator(K), order=True, known=known)


def posterior(known: Any = ()) -> Any:
    return choose(VECTORS, PosteriorComparator(K, particles=200), known=known)


def says(query: Query) -> Verdict | None:
    return TruthfulTutor(VALUES)(query).verdict


def answer(session: Session, most: int = 1000) -> list[str]:
    """The ids of so many questions, answered."""
    ids: list[str] = []
    while len(ids) < most and (query := session.question()):
        session.answer(query.id, says(query))
        ids.append(query.id)
    return ids


def told(log: AnswerLog) -> list[tuple[Any, ...]]:
    return [(e.answer.query.id, e.answer.verdict, e.used, e.retracted) for e in log]


@cache
def by_hand() -> tuple[list[str], Any]:
    """The questions of an asker that is simply asked and told; and what comes out."""
    asker, ids = make(), []
    while queries := asker.ask():
        ids.append(queries[0].id)
        asker.tell([Answer(queries[0], says(queries[0]))])
    return ids, asker.result()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "log.jsonl"


def same(one: Any, other: Any) -> bool:
    """Return whether two choices, and all that they depend on, are the same."""
    parts = [
        (c.order, c.status, c.asked, c.decided, c.answers.ids, c.answers.d.tobytes())
        for c in (one, other)
    ]
    return bool(
        parts[0] == parts[1]
        and one.comparator.values.tobytes() == other.comparator.values.tobytes()
    )


@pytest.mark.parametrize("asker", [make, None], ids=["function", "object"])
def test_a_session_is_the_loop_and_can_be_left_after_every_answer(path, asker):
    ids, best = by_hand()
    assert len(ids) > 8
    for i, name in enumerate(ids):
        with Session(asker or make(), path) as session:
            query = session.question()
            assert query is not None
            assert query.id == name
            assert session.status().answered == i
            assert not session.status().finished
            session.answer(name, says(query))
    with Session(asker or make(), path) as session:
        assert session.question() is None
        assert same(session.result(), best)
        assert session.log.restarted == 0
        assert str(session.status()) == f"finished: {len(ids)} answered"
    assert [row[0] for row in told(AnswerLog.read(path))] == ids


def test_an_answer_told_twice_counts_once():
    session = Session(make, AnswerLog())
    query = session.question()
    assert query is not None
    verdict = says(query)
    assert verdict is not None
    for code in (verdict, int(verdict)):
        answer = session.answer(query.id, code)
        assert (answer.query.id, answer.verdict) == (query.id, verdict)
    assert len(session.log) == 1
    for other in (-verdict, None):
        with pytest.raises(StaleAnswer, match="withdraw that answer first"):
            session.answer(query.id, other)
    with pytest.raises(StaleAnswer, match="no pending query has the id 'x'"):
        session.answer("x", 1)
    for wrong in (True, 1.0, 2):
        with pytest.raises((TypeError, ValueError)):
            session.answer(session.question().id, wrong)
    assert len(session.log) == 1


def test_undo_puts_the_same_question_again(path):
    session = Session(make, path)
    ids = answer(session, 4)
    for name in reversed(ids):
        assert session.undo().query.id == name
        query = session.question()
        assert query is not None
        assert query.id == name
    with pytest.raises(ValueError, match="no answer to undo"):
        session.undo()
    assert session.status().withdrawn == 4
    assert answer(session) == by_hand()[0]
    assert same(session.result(), by_hand()[1])
    assert session.log.restarted == 0
    session.close()
    with Session(make, path) as again:
        assert again.question() is None
        assert same(again.result(), by_hand()[1])


def test_after_taking_back_the_fourth_of_nine_the_later_ones_are_used(path):
    session = Session(make, path)
    ids = answer(session, 9)
    session.withdraw(ids[3], why="typo")
    used = session.result().answers.ids
    assert used == (*ids[:3], *ids[4:])
    assert [entry.retraction["why"] for entry in session.log if entry.retraction is not None] == [
        "typo"
    ]
    after = answer(session)
    assert not set(after) & set(ids[:3] + ids[4:])
    result = session.result()
    assert result.order == by_hand()[1].order
    session.close()
    with Session(make, path) as again:  # what was asked before and after comes out again
        assert again.question() is None
        assert same(again.result(), result)
        assert again.undo().query.id == after[-1]
        query = again.question()
        assert query is not None
        assert query.id == after[-1]


@pytest.mark.parametrize("steps", quick_first(range(8), 4))
def test_any_history_is_the_same_after_a_restart(path, steps):
    """Answers, undone and withdrawn ones: what goes on in the process, and what is read from the
    file.
    """
    chance = np.random.default_rng(steps)
    session = Session(make, path)
    for _ in range(10):
        step = chance.choice(["answer", "answer", "cannot tell", "undo", "withdraw", "other"])
        standing = [entry.answer.query.id for entry in session.log if not entry.retracted]
        query = session.question()
        if step in ("answer", "cannot tell") and query is not None:
            session.answer(query.id, says(query) if step == "answer" else None)
        elif step == "undo" and standing:
            session.undo()
        elif step == "withdraw" and standing:
            session.withdraw(str(chance.choice(standing)))
        elif step == "other":
            session.close()
            session = Session(make if chance.random() < 0.5 else posterior, path)
            session.close()
            session = Session(make, path)
        assert told(AnswerLog.read(path)) == told(session.log)
        before, since = session.question(), session.result()
        session.close()
        session = Session(make, path)
        now = session.question()
        assert (now is None) == (before is None)
        assert now is None or before is None or now.id == before.id
        assert same(session.result(), since)


def test_another_comparator_goes_on_with_the_same_answers(path):
    with Session(make, path) as session:
        ids = answer(session, 5)
    for maker in (posterior, make):
        with Session(maker, path) as session:
            standing = [entry.answer.query.id for entry in session.log]
            assert list(session.result().answers.ids) == standing
            more = answer(session, 2)
            assert not set(more) & set(ids)
    with pytest.raises(ValueError, match="Give Session a function"):
        Session(make(), path)
    assert len(AnswerLog(path)) >= 5  # not locked by the session that could not be


def test_only_a_function_can_take_back():
    session = Session(make(), AnswerLog())
    (name,) = answer(session, 1)
    for take_back in (session.undo, lambda: session.withdraw(name)):
        with pytest.raises(ValueError, match="give Session a function known -> asker"):
            take_back()
    assert session.status().answered == 1
    with pytest.raises(ValueError, match="cannot be retracted"):
        Session(make, AnswerLog()).withdraw("x")


@pytest.mark.parametrize("wrong", [None, 3, choose, PolytopeComparator(K), "make"])
def test_what_is_no_asker(wrong, path):
    if wrong is choose:
        with pytest.raises(TypeError):
            Session(choose, path)  # takes vectors and a comparator
    else:
        with pytest.raises(TypeError, match="known -> asker"):
            Session(wrong, path)
    with pytest.raises(TypeError, match="must return what has ask, tell and result"):
        Session(lambda known: None, path)
    AnswerLog(path)  # is free


class Ring:
    """An asker with the three members, and no more: asks about three pairs that may go round in a
    ring, each an audit of those before."""

    def __init__(self, known: Any = ()) -> None:
        a, b, c = (
            np.array(x, float) for x in ([0.5, 0, 0, 0.5], [0.2, 0.3, 0.4, 0.1], [0, 0.9, 0.1, 0])
        )
        self.elicitation = Elicitation(PolytopeComparator(4), "ring", known=known)
        self.pairs = [Pair(x, y, "") for x, y in ((a, b), (b, c), (c, a))]

    def ask(self) -> Sequence[Query]:
        while not self.elicitation.pending and self.pairs:
            pair = self.pairs.pop(0)
            if self.elicitation.may_ask((pair.left - pair.right)[None, :], lambda i: 0)[0]:
                self.elicitation.open([pair])
        return self.elicitation.ask()

    def tell(self, answers: Sequence[Answer], on_conflict: Any = "raise") -> None:
        self.elicitation.tell(answers, on_conflict)

    def result(self) -> Any:
        return self.elicitation


def test_what_does_not_go_together_is_said_and_can_be_mended(path):
    session = Session(Ring, path)
    assert session.conflicts() == ()
    ids = []
    while query := session.question():  # a over b over c over a
        session.answer(query.id, Verdict.BETTER)
        ids.append(query.id)
    assert [row[1:] for row in told(session.log)] == [
        (1, True, False),
        (1, True, False),
        (1, False, False),
    ]
    *_, last = session.log
    assert set(last.metadata[CONTRADICTS]) == set(ids[:2])
    ((*ring,),) = session.conflicts()
    assert {entry.answer.query.id for entry in ring} == set(ids)
    with pytest.raises(InconsistentAnswers):
        PolytopeComparator(4).update(
            Session(Ring, AnswerLog()).result().answers + _all_answers(ring)
        )
    assert session.status().unused == 1
    session.withdraw(ids[0])
    assert session.conflicts() == ()
    # what contradicted it counts again
    assert session.status().unused == 0
    assert session.log.answers().ids == (ids[1], ids[2]) == session.result().answers.ids
    session.close()
    with Session(Ring, path) as again:
        assert again.result().answers.ids == (ids[1], ids[2])
        query = again.question()
        assert query is not None
        again.answer(query.id, Verdict.BETTER)
        assert again.status().unused == 1
        assert len(again.conflicts()) == 1


def _all_answers(entries: Any) -> Any:
    log = AnswerLog()
    for entry in entries:
        log.append(entry.answer)
    return log.answers()


def test_interrupted_where_an_answer_contradicts_it_is_marked_once(tmp_path):
    number = count()

    def two_told() -> Session:
        session = Session(Ring, tmp_path / f"{next(number)}.jsonl")
        for _ in range(2):
            session.answer(session.question().id, Verdict.BETTER)
        session.question()  # for this asker forgets a pair where it is interrupted while it asks
        return session

    third = two_told().question()
    folders = ("elicit/person", "elicit/tutors", "elicit/asking")
    for session in interrupted_at_each_line(
        two_told, lambda one: one.answer(third.id, Verdict.BETTER), folders
    ):
        session.answer(third.id, Verdict.BETTER)
        assert session.question() is None
        assert [row[2] for row in told(session.log)] == [True, True, False]
        assert len(session.log[-1].metadata[CONTRADICTS]) == 2
        assert session.current_asker().result().answers.ids == session.log.answers().ids
        session.close()
        read = AnswerLog.read(session.log.path)
        assert told(read) == told(session.log)
        assert read.restarted == 0


def test_interrupted_an_answer_was_taken_back_or_stands():
    def three_told() -> Session:
        session = Session(
            lambda known: choose(VECTORS[:6], PolytopeComparator(K), True, known=known), AnswerLog()
        )
        assert len(answer(session, 3)) == 3
        return session

    undisturbed = three_told()
    before = undisturbed.question().id
    undisturbed.undo()
    after, outcomes = undisturbed.question().id, set()
    for session in interrupted_at_each_line(
        three_told, Session.undo, ("elicit/person", "elicit/tutors")
    ):
        back = session.log[-1].retracted
        outcomes.add(back)
        assert session.question().id == (after if back else before)
        assert session.status().answered == (2 if back else 3)
        assert len(session.result().answers) == (2 if back else 3)
    assert outcomes == {True, False}


def test_a_crash_before_a_contradiction_was_marked(path):
    with Session(Ring, path) as session:
        for _ in range(2):
            session.answer(session.question().id, Verdict.BETTER)
        third = session.question()
    with AnswerLog(path) as log:
        log.append(Answer(third, Verdict.BETTER))  # and no more
    with Session(Ring, path) as session:
        assert [row[2] for row in told(session.log)] == [True, True, False]
        assert session.question() is None
        assert len(session.conflicts()) == 1
        assert session.log.restarted == 0


def test_answers_that_contradict_each_other_from_the_start():
    """They may come from a merged log. The asker takes as many as fit together, the earlier ones
    first.
    """
    asked = Ring().pairs
    log = AnswerLog()
    for i, pair in enumerate(asked):
        log.append(Answer(Query(f"other {i}", pair.left, pair.right), Verdict.BETTER))
    session = Session(Ring, log)
    assert [entry.used for entry in log] == [True, True, False]
    assert log.restarted == 3
    assert session.question() is None
    assert session.result().answers.ids == ("other 0", "other 1")


def test_what_was_shown_and_when_is_logged_and_a_clock_may_go_backwards(path):
    times = iter([1e9, 2e9, 5e8, 4e8, 3e8])
    with Session(make, path, who="nurse", clock=lambda: next(times)) as session:
        first = session.question()
        assert session.question() is first
        session.shown(first.id, swapped=True, words=["12 of 100", "30 of 100"])
        assert session.answer(first.id, says(first)).swapped
        with pytest.raises(StaleAnswer, match="show what question"):
            session.shown(first.id)
        second = session.question()
        assert not session.answer(second.id, says(second), device="phone").swapped
        third = session.question()
        session.answer(third.id, says(third))
    log = AnswerLog.read(path)
    assert [e.answer.query.id for e in log] == [first.id, second.id, third.id] == by_hand()[0][:3]
    (asked,) = log.asked
    assert (asked.query.id, asked.swapped, asked.metadata["words"]) == (
        first.id,
        True,
        ["12 of 100", "30 of 100"],
    )
    when = [datetime.fromisoformat(e.metadata["time"]).timestamp() for e in log]
    assert when == [2e9, 5e8, 4e8]
    assert all(0 <= e.metadata["latency"] < 60 and e.metadata["who"] == "nurse" for e in log)
    assert {e.metadata["session"] for e in log} == {asked.metadata["session"]}
    assert [e.metadata.get("device") for e in log] == [None, "phone", None]
    with Session(make, path) as again:
        assert len(again.result().answers) == 3


class Telling:
    """An asker that fails when it is told, once."""

    def __init__(self, known: Any = ()) -> None:
        self.inner, self.fails = make(known), False
        self.ask, self.result = self.inner.ask, self.inner.result

    def tell(self, answers: Any, on_conflict: Any = "raise") -> None:
        if self.fails:
            self.fails = False
            raise FloatingPointError("while telling")
        self.inner.tell(answers, on_conflict)


@pytest.mark.parametrize("then", ["again", "goes on", "reopened"])
def test_an_answer_that_was_logged_and_not_told(path, then):
    """It counts once, whether the host tries again, goes on, or dies."""
    session = Session(Telling, path)
    query = session.question()
    session.current_asker().fails = True
    with pytest.raises(FloatingPointError):
        session.answer(query.id, says(query))
    assert len(session.log) == 1
    if then == "again":
        session.answer(query.id, says(query))
    elif then == "reopened":
        session.close()
        session = Session(make, path)
    assert [query.id, *answer(session)] == by_hand()[0]
    assert same(session.result(), by_hand()[1])


def test_an_answer_that_cannot_be_told_can_be_taken_back(path):
    session = Session(Telling, path)
    ids = answer(session, 3)
    query = session.question()
    for _ in range(2):
        session.current_asker().fails = True
        with pytest.raises(FloatingPointError):
            session.answer(query.id, says(query))
        session.undo()
        assert session.question().id == query.id
    assert [*ids, *answer(session)] == by_hand()[0]
    assert same(session.result(), by_hand()[1])


def test_a_withdrawal_is_not_lost_where_no_new_asker_can_be_made(path):
    broken = False

    def sometimes(known: Any) -> Any:
        if broken:
            raise FloatingPointError("while making")
        return make(known)

    session = Session(sometimes, path)
    ids = answer(session, 5)
    broken = True
    with pytest.raises(FloatingPointError):
        session.withdraw(ids[1])
    with pytest.raises(FloatingPointError):
        session.question()
    broken = False
    assert session.result().answers.ids == (ids[0], *ids[2:])
    assert session.status().withdrawn == 1


@pytest.mark.parametrize("fails", ["write", "fsync"])
def test_a_full_disk_takes_no_answer_and_loses_none(path, monkeypatch, fails):
    session = Session(make, path)
    answer(session, 3)
    query, before = session.question(), path.read_bytes()
    with monkeypatch.context() as patch:
        if fails == "fsync":
            patch.setattr(os, "fsync", _full)
        else:
            # the file takes part of the line
            file = session.log._file._file
            patch.setattr(session.log._file, "_file", _Half(file))
        for _ in range(2):
            with pytest.raises(OSError, match=r"No space left|disk full"):
                session.answer(query.id, says(query))
            assert path.read_bytes() == before
            assert session.question().id == query.id
            assert session.status().answered == 3
    session.close()
    with Session(make, path) as session:
        answer(session)
        assert same(session.result(), by_hand()[1])


def _full(*_: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class _Half:
    """A file on a disk that has room for half of what is written."""

    def __init__(self, file: Any) -> None:
        self.fileno, self.truncate, self._file = file.fileno, file.truncate, file

    @property
    def closed(self) -> bool:
        return bool(self._file.closed)

    def write(self, data: bytes) -> int:
        return int(self._file.write(data[: len(data) // 2]))


def test_a_session_has_its_log_for_itself(path):
    with Session(make, path) as session:
        answer(session, 1)
        with pytest.raises(BlockingIOError):
            Session(make, path)
        answer(session, 1)
    log = AnswerLog(path)
    with Session(make, log) as session:
        answer(session, 1)
    log.append(
        Answer(Query("q", VECTORS[0], VECTORS[1]), None)
    )  # it did not close what it did not open
    assert len(log) == 4


def test_a_torn_line_costs_what_was_not_acknowledged_and_a_flipped_bit_is_told(path):
    with Session(make, path) as session:
        answer(session, 5)
    whole = path.read_bytes()
    path.write_bytes(whole + whole.splitlines()[-1][:50])
    with Session(make, path) as session:
        assert answer(session) == by_hand()[0][5:]
    path.write_bytes(whole[:900] + bytes([whole[900] ^ 1]) + whole[901:])
    with pytest.raises(ValueError, match="is damaged"):
        Session(make, path)


class Batch:
    """An asker with several questions at once."""

    def __init__(self, known: Any = ()) -> None:
        self.elicitation = Elicitation(PolytopeComparator(K), "batch", known=known, batch=4)
        d = VECTORS[:4] - VECTORS[4:8]
        new = self.elicitation.may_ask(d, lambda i: i)
        self.elicitation.open([Pair(VECTORS[i], VECTORS[i + 4], "") for i in np.flatnonzero(new)])

    def ask(self) -> Sequence[Query]:
        return self.elicitation.ask()

    def tell(self, answers: Sequence[Answer], on_conflict: Any = "raise") -> None:
        self.elicitation.tell(answers, on_conflict)

    def result(self) -> Any:
        return self.elicitation


def test_answers_out_of_order(path):
    with Session(Batch, path) as session:
        queries = session.current_asker().ask()
        for i in (2, 0, 3):
            session.answer(queries[i].id, says(queries[i]))
    with Session(Batch, path) as session:
        assert session.result().answers.ids == tuple(queries[i].id for i in (2, 0, 3))
        assert session.question().id == queries[1].id
        session.answer(queries[0].id, says(queries[0]))
        session.answer(queries[1].id, says(queries[1]))
        assert session.question() is None
        assert session.log.restarted == 0
        assert len(session.log) == 4


def test_a_class_in_place_of_an_asker_is_refused():
    class Asks:
        def __init__(self, problem: Any, comparator: Any, *, known: Any = ()) -> None:
            pass

        ask = tell = result = __init__

    for wrong in (
        Asks,
        type("One", (Asks,), {"__init__": lambda self, problem: None}),
        type("None", (), {}),
    ):
        with pytest.raises(
            TypeError, match=f"but {wrong.__name__} is a class: make one, {wrong.__name__}"
        ):
            Session(wrong, AnswerLog())
    assert Session(Ring, AnswerLog()).question() is not None  # which takes what is known


def test_answers_of_different_people_do_not_contradict_each_other() -> None:
    def several(known: Any = ()) -> Any:
        return choose(VECTORS, Panel({"ann": PolytopeComparator(K), "ben": PolytopeComparator(K)}))

    left, right = [0.5, 0, 0, 0, 0.5], [0.0, 1, 0, 0, 0]
    log = AnswerLog(k=K)
    for i, (who, verdict) in enumerate([("ann", 1), ("ben", -1)]):
        log.append(Answer(Query(f"{i}", left, right), Verdict(verdict), who=who))
    session = Session(several, log)
    assert session.conflicts() == session.contradiction() == ()
    log.append(Answer(Query("2", left, right), Verdict.WORSE, who="ann"))
    session = Session(several, log)
    assert [[e.answer.query.id for e in found] for found in session.conflicts()] == [["0", "2"]]
    assert [e.answer.query.id for e in session.contradiction()] == ["0", "2"]


@pytest.mark.parametrize("maker", [make, posterior])
def test_what_the_answers_say_as_given_is_known_unless_they_contradict_each_other(
    maker: Any,
) -> None:
    level, log = [0.0, 0, 1, 0, 0], AnswerLog(k=K)
    assert Session(maker, log).as_given() is None
    for i, (share, verdict) in enumerate(((0.5, Verdict.WORSE), (0.2, Verdict.BETTER))):
        log.append(Answer(Query(f"{i}", level, [1 - share, 0, 0, 0, share]), verdict))
    given = Session(maker, log).as_given()
    assert given is not None
    low, high = given.bounds(np.eye(K)[[2]] - np.eye(K)[[0]])
    assert (low[0], high[0]) == pytest.approx((0.2, 0.5), abs=1e-5)
    log.append(Answer(Query("2", level, [0.1, 0, 0, 0, 0.9]), Verdict.BETTER))
    assert Session(maker, log).as_given() is None


@pytest.mark.parametrize(("off", "contradict"), [(0.04, False), (0.12, True)])
@pytest.mark.parametrize("maker", [make, posterior])
def test_what_is_called_equal_may_be_rounded_where_errors_are_allowed_for(
    maker: Any, off: float, contradict: bool
) -> None:
    """Call a level as good as two mixtures whose values differ by ``off``."""
    level, log = [0.0, 0, 1, 0, 0], AnswerLog(k=K)
    for i, share in enumerate((0.5, 0.5 + off)):
        mixture = [1 - share, 0, 0, 0, share]
        log.append(Answer(Query(f"{i}", level, mixture), Verdict.EQUAL))
    contradict |= maker is make
    session = Session(maker, log)
    assert len(session.conflicts()) == contradict
    assert bool(session.contradiction()) == contradict
