"""Results computed while the person reads are those that would be computed afterwards."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    Bags,
    FlippingTutor,
    Interview,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Session,
    Subject,
    TruthfulTutor,
    Verdict,
    choose,
)
from elicit.person.asker import LookAhead
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, random_mdp
from tests.interpreter import run
from tests.thoroughness import scaled

K = 5
LEVELS = tuple("abcde")
SUBJECT = Subject(LEVELS, least=0)
VECTORS = (
    np.random.default_rng(0).multinomial(20, np.ones(K) / K, 14).astype(float)
)  # whole numbers can be shown
MDP = random_mdp(12, 3, K, discount=0.9, seed=3)[0]
VALUES = [0, 10, 11, 40, 99]


def choosing(known: Any) -> Any:
    return choose(VECTORS, PolytopeComparator(K), order=True, known=known)


def choosing_by_the_posterior(known: Any) -> Any:
    return choose(VECTORS, PosteriorComparator(K, particles=200), order=True, known=known)


def learning_by_bags(known: Any) -> Any:
    return InteractivePolicyIteration(MDP, PolytopeComparator(K), bags=Bags(10), known=known)


def learning_by_the_posterior(known: Any) -> Any:
    comparator = PosteriorComparator(K, particles=200)
    return InteractivePolicyIteration(MDP, comparator, tolerance=0.005, bags=Bags(10), known=known)


def sweeping(known: Any) -> Any:
    comparator = PolytopeComparator(K)
    return InteractiveValueIteration(
        MDP, comparator, tolerance=0.05, audit=0.3, max_audits=5, known=known, seed=1
    )


class Reluctant:
    """An asker that cannot be copied."""

    def __init__(self, known: Any) -> None:
        inner = choosing(known)
        self.ask, self.tell, self.result = inner.ask, inner.tell, inner.result

    def __deepcopy__(self, memo: Any) -> Any:
        raise TypeError("not me")


def tutor(rate: float) -> Callable[[Query], Answer]:
    return FlippingTutor(VALUES, rate, seed=2) if rate else TruthfulTutor(VALUES)


def told(log: AnswerLog) -> list[Any]:
    return [
        (e.answer.query.id, e.answer.verdict, e.answer.swapped, e.used, e.retracted) for e in log
    ]


def answered(make: Any, rate: float, back: bool, ahead: int) -> tuple[list[Any], Any]:
    """Return the log of a session, and its result.

    Some answers are taken back if ``back``. ``ahead`` of the possible answers are computed ahead.
    """
    says, log = tutor(rate), AnswerLog()
    with Session(make, log) as session:
        for number in range(scaled(14, 40)):
            query = session.question()
            if query is None:
                break
            twin = session.twin()
            assert twin is not None
            look = LookAhead(session.current_asker(), twin, query, False)
            assert len([*zip(range(ahead), look.steps(), strict=False)]) == ahead
            session.answer(query.id, says(query).verdict, ahead=look.told)
            if back and number in (3, 7):
                session.undo()
            if back and number == 5:
                session.withdraw(log[1].answer.query.id)
        return told(log), session.result()


@pytest.mark.parametrize(
    "back",
    [
        pytest.param(False, id="straight", marks=pytest.mark.slow),
        pytest.param(True, id="undone and withdrawn"),
    ],
)
@pytest.mark.parametrize(
    ("make", "rate"),
    [
        pytest.param(choosing, 0.0, marks=pytest.mark.slow),
        (choosing, 0.2),
        pytest.param(choosing_by_the_posterior, 0.2, marks=pytest.mark.slow),
        (learning_by_bags, 0.0),
        pytest.param(learning_by_the_posterior, 0.1, marks=pytest.mark.slow),
        (sweeping, 0.2),
    ],
)
def test_it_is_asked_and_ends_as_without(make: Any, rate: float, back: bool) -> None:
    plain, result = answered(make, rate, back, 0)
    assert len(plain) > 5
    for ahead in scaled((4,), (1, 4)):
        log, found = answered(make, rate, back, ahead)
        assert log == plain
        assert found.comparator.values.tobytes() == result.comparator.values.tobytes()
        assert (found.asked, found.decided) == (result.asked, result.decided)
        assert found.loss_bound == pytest.approx(result.loss_bound, abs=1e-9)


def at_work() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "elicit, while one reads"]


def reads_all(_: int) -> None:
    for thread in at_work():
        thread.join()


def reads_nothing(_: int) -> None:
    pass


def reads_a_while(number: int) -> None:
    time.sleep(0.02 * (number % 4))


def interviewed(make: Any, reads: Callable[[int], None]) -> list[Any]:
    """Return the log of an interview in which some answers are taken back."""
    says, log = tutor(0.2), AnswerLog()
    with Session(make, log) as session, Interview(session, SUBJECT) as interview:
        interview.handle({"do": "state"})
        screen = interview.handle({"do": "practised", "choice": "a"})
        number = 0
        while screen["stage"] == "question":
            number += 1
            reads(number)
            query = session.question()
            assert query is not None
            assert query.id == screen["question"]["id"]
            choice = choice_of(log, query, says(query).verdict)
            screen = interview.handle({"do": "answer", "id": query.id, "choice": choice})
            if number in (3, 7):
                reads(number)
                screen = interview.handle({"do": "undo", "id": screen["last"]["id"]})
            if number == 5:
                reads(number)
                screen = interview.handle({"do": "withdraw", "id": log[1].answer.query.id})
    assert not at_work()
    return told(log)


def choice_of(log: AnswerLog, query: Query, verdict: Verdict | None) -> str:
    """Return the choice on the screen for a verdict; the log knows the sides."""
    swapped = next(asked.swapped for asked in reversed(log.asked) if asked.query.id == query.id)
    if verdict is None or verdict is Verdict.EQUAL:
        return "cannot tell" if verdict is None else "equal"
    return "a" if (verdict is Verdict.BETTER) != swapped else "b"


def test_however_long_the_person_reads_an_interview_is_the_same() -> None:
    logs = [
        interviewed(make, reads)
        for make, reads in (
            (Reluctant, reads_nothing),
            (choosing, reads_nothing),
            (choosing, reads_a_while),
        )
    ]
    assert len(logs[0]) > 8
    assert all(log == logs[0] for log in logs)


class Slow:
    """An asker that says in which thread it was told, and takes its time."""

    told: list[tuple[str, int | None]] = []  # noqa: RUF012 - of all copies

    def __init__(self, known: Any) -> None:
        self.inner, self.seconds = choosing(known), 0.0

    def ask(self) -> Any:
        return self.inner.ask()

    def tell(self, answers: Any, on_conflict: Any = "raise") -> None:
        self.told.append((threading.current_thread().name, answers[0].verdict))
        time.sleep(self.seconds)
        self.inner.tell(answers, on_conflict)

    def result(self) -> Any:
        return self.inner.result()


@pytest.fixture
def slow() -> Iterator[tuple[Session, Interview, dict[str, Any]]]:
    Slow.told.clear()
    with (
        Session(Slow, AnswerLog()) as session,
        Interview(session, SUBJECT) as interview,
    ):
        yield session, interview, interview.handle({"do": "practised", "choice": "a"})


def test_what_was_computed_is_not_computed_again(slow: Any) -> None:
    session, interview, screen = slow
    reads_all(0)
    assert [verdict for _, verdict in Slow.told] == [1, -1, 0, None]
    assert not any(name == threading.main_thread().name for name, _ in Slow.told)
    interview.handle({"do": "state"})
    reads_all(0)
    assert len(Slow.told) == 4  # a reload costs nothing
    before = session.question().id
    interview.handle({"do": "answer", "id": screen["question"]["id"], "choice": "equal"})
    assert session.question().id != before
    assert not any(name == threading.main_thread().name for name, _ in Slow.told)


def test_an_answer_waits_for_what_is_being_computed_of_it_and_for_nothing_else() -> None:
    Slow.told.clear()

    def slow(known: Any) -> Slow:
        made = Slow(known)
        made.seconds = 0.2
        return made

    main = threading.main_thread().name
    with (
        Session(slow, AnswerLog()) as session,
        Interview(session, SUBJECT) as interview,
    ):
        interview.handle({"do": "practised", "choice": "a"})
        for verdict, by_main in ((Verdict.BETTER, False), (Verdict.WORSE, True)):
            Slow.told.clear()
            while not Slow.told:
                time.sleep(0.001)
            query = session.question()
            assert query is not None
            interview.handle(
                {"do": "answer", "id": query.id, "choice": choice_of(session.log, query, verdict)}
            )
            # "better" was being computed, for both
            assert ((main, verdict) in Slow.told) == by_main
            assert len([name for name, _ in Slow.told if name != main]) <= 2


def test_results_are_computed_ahead_of_the_answers_that_may_lead_to_an_offer() -> None:
    asker = choosing(())
    (query,) = asker.ask()
    ahead = LookAhead(asker, choosing(()), query, False)
    seen: list[Any] = []
    ahead.is_near = lambda result: bool(seen.append(result))
    assert sum(1 for _ in ahead.steps()) == 4
    assert sum(1 for _ in ahead.results()) == 2
    assert seen == [result for _, result in ahead.found]  # and what an offer would say
    for verdict, (made, result) in zip((Verdict.BETTER, Verdict.WORSE), ahead.found, strict=True):
        after = ahead.told(asker, Answer(query, verdict))
        assert after is not None
        assert after.asker is made
        assert (result.asked, result.loss_bound) == (1, made.result().loss_bound)


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("reads", [reads_nothing, reads_a_while])
def test_a_result_that_is_known_is_that_of_all_answers(
    given: bool, reads: Callable[[int], None]
) -> None:
    with (
        Session(choosing(()) if given else choosing, AnswerLog()) as session,
        Interview(session, SUBJECT) as interview,
    ):
        screen, number = interview.handle({"do": "practised", "choice": "a"}), 0
        while screen["stage"] == "question":
            number += 1
            reads(number)
            session.answer(screen["question"]["id"], 1, ahead=interview._beside.told_ahead)
            known = interview._beside.result_of(session.current_asker())
            assert known is None or known.asked == number
            screen = interview.handle({"do": "state"})
        assert number > 5


def test_an_asker_that_was_given_is_told_itself() -> None:
    asker = choosing(())
    with (
        Session(asker, AnswerLog()) as session,
        Interview(session, SUBJECT) as interview,
    ):
        screen = interview.handle({"do": "practised", "choice": "a"})
        for _ in range(3):
            reads_all(0)
            screen = interview.handle(
                {"do": "answer", "id": screen["question"]["id"], "choice": "a"}
            )
        assert session.current_asker() is asker
        assert asker.result().asked == 3


def test_a_program_that_ends_without_closing_ends_at_once() -> None:
    code = """
import atexit, time
import elicit
class Slow:
    told = []
    def __init__(self, known):
        rows = [[0.5, 0.0, 0.5], [0.0, 1.0, 0.0], [0.25, 0.5, 0.25]]
        self.inner = elicit.choose(rows, elicit.Dominance(3), order=True, known=known)
    def ask(self):
        return self.inner.ask()
    def tell(self, answers, on_conflict="raise"):
        self.told.append(1)
        time.sleep(1.0)
        self.inner.tell(answers, on_conflict)
    def result(self):
        return self.inner.result()
session = elicit.Session(Slow, elicit.AnswerLog())
interview = elicit.Interview(session, elicit.Subject(tuple("abc"), least=0))
interview.handle({"do": "practised", "choice": "a"})
while not Slow.told:
    time.sleep(0.01)
atexit.register(lambda: print(len(Slow.told)))
"""
    assert run(code) == ["1"]  # of four
