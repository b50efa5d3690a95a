"""Statements beside a question hold: why it is asked, and how many come after it."""

import copy
import gc
import threading
import time
import weakref
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    AnswerLog,
    Answers,
    Bags,
    Interview,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Session,
    Subject,
    TruthfulTutor,
    Verdict,
    Words,
    choose,
)
from elicit.person.outlook import Outlook, _Play, what_is_open
from elicit.person.showing import show
from qlearn import InteractivePolicyIteration, random_mdp
from tests.thoroughness import scaled

LEVELS = ("died", "ill", "well")
MDP = random_mdp(8, 2, 5, discount=0.9, seed=3)[0]


def bag(good: int, seed: int = 0) -> Any:
    """ "Of 10: 10 ill, or so many well and the others died?", as it is shown."""
    return show(
        Query(f"{good}", [0, 1, 0], [1 - good / 10, 0, good / 10], labels=LEVELS), seed=seed
    )


def learning(known: Any) -> Any:
    return InteractivePolicyIteration(MDP, PolytopeComparator(5), bags=Bags(10), known=known)


def outlook_of(asker: Any, **more: Any) -> Outlook:
    query = asker.ask()[0]
    found = Outlook(
        asker, show(query), query, lambda _: "Much.", lambda query: not show(query).exact, 0, **more
    )
    assert not found.ready
    for _ in found.steps():
        assert not found.ready
    assert found.ready
    return found


def to_its_end(asker: Any, values: Any) -> list[Verdict | None]:
    """The answers of a truthful tutor."""
    said, says = [], TruthfulTutor(values)
    while (queries := asker.ask()) and show(queries[0]).exact:
        said.append(says(queries[0]).verdict)
        asker.tell([Answer(queries[0], said[-1])])
    return said


def test_why_names_what_is_open_in_whole_numbers_that_hold() -> None:
    knows = PolytopeComparator(3)
    scale = "on the scale from 0 (died) to 100 (well)."
    assert what_is_open(bag(5), knows) == f"We don't yet know how good “ill” is, {scale}"
    d = np.array([[-0.667, 1, -0.333], [-0.2, 1, -0.8]])
    knows = knows.update(Answers(d, [1, -1]))  # above .333, below .8
    said = f"So far “ill” is between 33 and 80, {scale}"
    assert what_is_open(bag(5, seed=3), knows) == said
    posterior = PosteriorComparator(3, particles=200)
    posterior = posterior.update(Answers(np.repeat(d, 9, axis=0), [1] * 9 + [-1] * 9))
    may = (
        "Any one answer may be a mistake: a range narrows once several agree, and may widen after "
        "an answer that was not expected."
    )
    assert str(what_is_open(bag(5), posterior)).endswith(f" (with 95% probability), {scale} {may}")


def test_why_of_every_question_is_on_the_one_scale_of_the_levels() -> None:
    knows, labels = PolytopeComparator(4), ("died", "bad", "fair", "well")
    scale = "the scale from 0 (died) to 100 (well)"
    for seed in range(8):  # whichever side is A
        shown = show(Query("q", [0.4, 0, 0.6, 0], [0, 0.7, 0, 0.3], labels=labels), seed=seed)
        both = f"We don't yet know how good “fair” and “bad” are, on {scale}."
        assert what_is_open(shown, knows) == both
    below = knows.update(Answers(np.array([[-0.4, 1, 0, -0.6]]), [-1]))
    said = what_is_open(shown, below)
    assert said == (
        f"So far “bad” is between 0 and 60, on {scale}. We don't yet know how good “fair” is, on "
        "that scale."
    )
    fair = show(Query("q", [0, 0.5, 0, 0.5], [0, 0, 1, 0], labels=labels))
    assert what_is_open(fair, below) == said
    sure = show(Query("q", [0, 0, 0, 1], [1, 0, 0, 0], labels=labels))
    assert what_is_open(sure, knows) is None


def test_the_number_to_come_is_that_of_sessions_like_this_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("elicit.person.outlook._SECONDS", 600.0)  # on whatever machine
    asker = learning(())
    found = outlook_of(asker)
    assert found.why[1] == "Much."
    assert found.to_come is not None
    assert found.to_come == outlook_of(learning(())).to_come  # again the same
    least, most = found.to_come
    assert most - least < 15
    scales = np.sort(np.random.default_rng(1).random((scaled(3, 10), 5)))
    to_come = [len(to_its_end(copy.deepcopy(asker), values)) - 1 for values in scales]
    assert sum(least <= n <= most for n in to_come) >= scaled(2, 7)


@pytest.mark.parametrize(
    ("lengths", "to_come", "likely"),
    [
        ([4] * 11 + [60], (3, 3), 3),  # a single long one does not show
        ([3, *range(5, 15), 60], (4, 13), 8),  # nor the shortest of twelve
        ([3, 4, 5, 6, 7, 8, 9, 60], (2, 8), 5),
        ([4, 4, 4, 60, 60, 4, 4], None, 3),  # too few for a range
        ([4, 4, 60], None, None),
        ([], None, None),
    ],
)
def test_the_range_is_that_of_most_simulated_sessions(
    lengths: list[int], to_come: tuple[int, int] | None, likely: int | None
) -> None:
    asker = learning(())
    query = asker.ask()[0]
    plays = [_Play(asker, lambda _: Verdict.EQUAL, [Verdict.EQUAL] * n, True) for n in lengths]
    before = SimpleNamespace(_before=None, _going_on=lambda answered: plays)
    found = Outlook(
        asker,
        show(query),
        query,
        lambda _: None,
        lambda _: True,
        0,
        before,  # type: ignore[arg-type]
    )
    assert (found.to_come, found.likely) == (to_come, likely)


def test_sessions_that_were_answered_alike_go_on() -> None:
    before, asker = outlook_of(learning(())), learning(())
    first = asker.ask()[0]
    asker.tell([Answer(first, Verdict.BETTER)])
    played: list[Any] = []

    class Watched:
        """An asker that counts how often copies of it are told an answer."""

        def __init__(self) -> None:
            self.ask, self.result, self.comparator = asker.ask, asker.result, asker.comparator

        def tell(self, answers: Any, on_conflict: Any = "raise") -> None:
            played.append(answers)
            raise FloatingPointError

    query = asker.ask()[0]
    found = Outlook(
        Watched(),
        show(query),
        query,
        lambda _: None,
        lambda _: False,
        0,
        before,
        [Verdict.BETTER],  # type: ignore[arg-type]
    )
    steps = found.steps()
    with pytest.raises(FloatingPointError):
        list(steps)
    assert found.ready
    assert len(played) == 1  # only then a new one was played
    assert found.why == (what_is_open(show(query), asker.comparator),)


@pytest.mark.slow
def test_one_who_answers_before_anything_is_computed_leaves_nothing_behind() -> None:
    first, asker = outlook_of(learning(())), learning(())
    now, said, given_up = first, [], []
    for _ in range(3):
        query = asker.ask()[0]
        said.append(TruthfulTutor([0, 10, 11, 40, 99])(query).verdict)
        asker.tell([Answer(query, said[-1])])
        query, twin = asker.ask()[0], copy.deepcopy(asker)
        now = Outlook(twin, show(query), query, lambda _: None, lambda _: False, 0, now, said[-1:])
        given_up.append(weakref.ref(twin))
    del twin
    gc.collect()
    assert [twin() is None for twin in given_up] == [True, True, False]
    at_once = Outlook(asker, show(query), query, lambda _: None, lambda _: False, 0, first, said)
    assert [play.answers for play in now._plays] == [play.answers for play in at_once._plays]
    assert now._plays


def test_nothing_is_said_of_what_nothing_tells() -> None:
    vectors = np.array([[1.0, 0, 1], [0, 2, 0]])
    asker = choose(vectors, AlwaysAsk(3))
    assert outlook_of(asker).to_come is None  # it names no plausible scales
    assert outlook_of(SimpleNamespace(ask=asker.ask, tell=asker.tell, result=asker.result)).why == (
        "Much.",
    )


@pytest.mark.slow
def test_an_interview_says_it_of_the_question_on_the_screen() -> None:
    subject = Subject(MDP.labels, least=0, stakes=lambda result: f"{result.asked} so far.")
    with Session(learning, AnswerLog()) as session, Interview(session, subject) as interview:
        screen = interview.handle({"do": "practised", "choice": "a"})
        for asked in range(3):
            id = screen["question"]["id"]
            while not interview.handle({"do": "outlook", "id": id})["ready"]:
                threading.Event().wait(0.01)
            reply = interview.handle({"do": "outlook", "id": id})
            assert reply["id"] == id
            assert reply["why"][0].startswith(("We don't yet know how good ", "So far "))
            assert reply["why"][1] == f"{asked} so far."
            least, most = reply["to_come"]
            assert 0 <= least <= most
            other = interview.handle({"do": "outlook", "id": "another"})
            assert (other["why"], other["to_come"], other["ready"]) == ([], None, True)
            screen = interview.handle({"do": "answer", "id": id, "choice": "a"})
    with Session(learning(()), AnswerLog()) as session, Interview(session, subject) as interview:
        screen = interview.handle({"do": "practised", "choice": "a"})
        id = screen["question"]["id"]
        while not interview.handle({"do": "outlook", "id": id})["ready"]:
            threading.Event().wait(0.01)
        assert interview.handle({"do": "outlook", "id": id})[
            "to_come"
        ]  # also of an asker that was given


@pytest.mark.parametrize(
    ("to_come", "likely", "near"),
    [((1, 9), 2, True), ((1, 9), 3, False), ((1, 2), 1, False), ((4, 9), 2, False)],
)
def test_if_the_end_is_likely_close_it_is_said(
    monkeypatch: pytest.MonkeyPatch, to_come: tuple[int, int], likely: int, near: bool
) -> None:
    monkeypatch.setattr("elicit.person.outlook._PLAYS", 0)
    subject = Subject(MDP.labels, least=0)
    with Session(learning, AnswerLog()) as session, Interview(session, subject) as interview:
        id = interview.handle({"do": "practised", "choice": "a"})["question"]["id"]
        until = time.monotonic() + 60
        while not (reply := interview.handle({"do": "outlook", "id": id}))["ready"]:
            assert time.monotonic() < until
            threading.Event().wait(0.01)
        assert not reply["near"]
        beside = interview._beside._beside
        assert beside is not None
        assert beside.outlook is not None
        beside.outlook.to_come, beside.outlook.likely = to_come, likely
        reply = interview.handle({"do": "outlook", "id": id})
    assert (reply["to_come"], reply["near"]) == ([*to_come], near)


class OfLength:
    """An asker of so many questions, of fewer if the first answer is for the mixture.

    It can lose 0.6, or 0.9 if the first answer is for the level, and less by 0.02 an answer.
    """

    def __init__(self, most: int, fewer: int, share: float, comparator: Any) -> None:
        self._most, self._fewer, self._share, self.comparator = most, fewer, share, comparator
        self._said: list[Verdict | None] = []

    def ask(self) -> list[Query]:
        """The next one."""
        n = self._fewer if self._said[:1] == [Verdict.WORSE] else self._most
        mixture = [1 - self._share, 0, self._share]
        return [Query(f"{len(self._said)}", [0, 1, 0], mixture)] if len(self._said) < n else []

    def tell(self, answers: Any, on_conflict: str = "raise") -> None:
        """Count these."""
        self._said += [answer.verdict for answer in answers]

    def result(self) -> Any:
        """Return the possible loss."""
        most = 0.9 if self._said[:1] == [Verdict.BETTER] else 0.6
        return SimpleNamespace(loss_bound=max(0.0, most - 0.02 * len(self._said)))


ALL = "Settled in all 12 simulations."
OPEN = (
    "Settled in {} of 12 simulations. "
    "In half of all 12 the result could still fall {} in 100 short."
)
LENGTH = "Half of the simulated sessions took at most {} questions, about {} minutes."


@pytest.mark.parametrize(
    ("lengths", "share", "least", "budgets", "settled"),
    [
        ((5, 5), 0.5, 0, [ALL] * 3, LENGTH.format(10, 3)),
        ((5, 5), 0.5, 20, [ALL] * 3, LENGTH.format(25, 8)),
        ((30, 30), 0.9, 0, [OPEN.format(0, 40), OPEN.format(0, 12), ALL], LENGTH.format(37, 12)),
        ((99, 5), 0.9, 0, [ALL.replace("all", "11 of")] * 3, LENGTH.format(10, 3)),
        ((99, 5), 0.1, 0, [OPEN.format(2, n) for n in (70, 42, 0)], ""),
    ],
    ids=["5", "5 of 20", "30", "mostly 5", "mostly 99"],
)
def test_the_welcome_counts_sessions_that_are_settled_in_time(
    lengths: tuple[int, int], share: float, least: int, budgets: list[str], settled: str
) -> None:
    found = prospects_of(OfLength(*lengths, share, PolytopeComparator(3)), least)
    assert (found["budgets"], found["settled"]) == (budgets, settled)


def test_the_welcome_forecasts_nothing_without_plausible_scales() -> None:
    found = prospects_of(OfLength(5, 5, 0.5, AlwaysAsk(3)))
    assert found == {"budgets": [], "settled": "", "values": "", "ready": True}
    asker = OfLength(5, 5, 0.5, PolytopeComparator(3))
    asker.comparator.lock = threading.Lock()  # so that it cannot be copied
    assert prospects_of(asker) == {"budgets": [], "settled": "", "values": "", "ready": True}


def test_the_welcome_forecasts_nothing_where_an_interview_asks_on_after_its_asker() -> None:
    """Its own questions are not simulated, so what they prove is unknown."""
    asker = OfLength(5, 5, 0.5, PolytopeComparator(3))
    never = prospects_of(asker, enough=lambda result: False)
    assert never == {"budgets": [], "settled": "", "values": "", "ready": True}
    always = prospects_of(asker, enough=lambda result: True)
    assert always["budgets"] == [ALL] * 3


def prospects_of(
    asker: Any, least: int = 0, enough: Callable[[Any], bool] | None = None
) -> dict[str, Any]:
    """Return the final forecast of the welcome."""
    subject = Subject(LEVELS, Words("people"), least=least, enough=enough)
    with (
        Session(lambda _: asker, AnswerLog()) as session,
        Interview(session, subject) as interview,
    ):
        assert interview.handle({"do": "state"})["stage"] == "welcome"
        until = time.monotonic() + 60
        while not (found := interview.handle({"do": "prospects"}))["ready"]:
            assert time.monotonic() < until
            threading.Event().wait(0.01)
        return found


def test_a_loss_that_rose_since_it_was_stated_says_why() -> None:
    asker = learning(())
    query = asker.ask()[0]
    for before, said in ((0.0, True), (1.0, False), (None, False)):
        found = Outlook(asker, show(query), query, lambda _: "Much.", lambda _: True, 0)
        found.stated = before
        for _ in found.steps():
            pass
        assert found.loss is not None
        assert found.loss > 0
        assert (found.why[1] != "Much.") == said
        assert found.why[1].startswith("Much.")
        assert ("changes the plan" in found.why[1]) == said


@pytest.mark.parametrize("little", [True, False])
def test_whether_little_could_be_lost_is_found_beside_the_question(little: bool) -> None:
    asker, found = learning(()), []
    query = asker.ask()[0]
    notes = Outlook(asker, show(query), query, lambda _: None, lambda _: True, 0)
    notes.is_near = lambda result: bool(found.append(result)) or little
    assert notes.near is None
    for _ in notes.steps():
        pass
    assert notes.near is little
    assert [type(one) for one in found] == [type(asker.result())]
