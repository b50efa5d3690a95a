"""The elicitation: what settles a pair and in which order, what is asked, and what is kept of the
answers.
"""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import (
    Answer,
    Answers,
    Comparator,
    Decisions,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    Tier,
    TruthfulTutor,
    Verdict,
)
from elicit.asking.elicitation import Elicitation
from elicit.asking.elicitation_kernel import (
    NO_FACT,
    AskingState,
    Facts,
    decide_by_facts,
    decide_pair,
)
from elicit.asking.question import Pair
from elicit.decision.comparator_rule import rule_of
from elicit.model.comparator import BY_ANSWERS
from elicit.model.difference_kernel import LEFT_OPEN
from tests.noisy_cases import COMPARATORS
from tests.scale_arithmetic import Floats, dominance, tail_sums
from tests.thoroughness import examples, on_any_processor

K = 5
VALUES = np.array([0, 8, 20, 25, 80])
BETTER, EQUAL, WORSE, UNKNOWN = Verdict.BETTER, Verdict.EQUAL, Verdict.WORSE, Verdict.UNKNOWN
OPEN, OTHER = np.array(
    [[0.2, -0.3, 0.0, 0.0, 0.1], [-0.1, 0.3, -0.3, 0.0, 0.1]]
)  # dominance is silent on both
MORE = np.array([-0.01, 0.0, 0.0, 0.0, 0.01])  # what makes any difference greater


def elicitation(comparator: Comparator | None = None, **settings: Any) -> Elicitation:
    return Elicitation(comparator or Dominance(K), "a test", **settings)


def pair(d: Floats = OPEN, **more: Any) -> Pair:
    return Pair(np.maximum(d, 0.0), np.maximum(-d, 0.0), "left or right?", **more)


def put(
    asked_by: Elicitation,
    verdict: Verdict | None,
    d: Floats = OPEN,
    drop: bool = False,
    **more: Any,
) -> Query:
    """Ask about a difference and tell the answer."""
    (query,) = asked_by.open([pair(d, **more)])
    asked_by.tell([Answer(query, verdict)], "drop" if drop else "raise")
    return query


def judged(asked_by: Elicitation, *rows: Floats) -> list[tuple[int, int, bool]]:
    """Verdict and tier of each row, and whether the tutor is only to confirm it."""
    verdicts, tiers = asked_by.decide(np.stack(rows))
    return list(
        zip(verdicts.tolist(), tiers.tolist(), audited(verdicts, tiers).tolist(), strict=True)
    )


def audited(verdicts: Any, tiers: Any) -> Any:
    return (verdicts == UNKNOWN) & (tiers != Tier.TUTOR)


def differences(n: int, seed: int = 0) -> Floats:
    rows = np.random.default_rng(seed).dirichlet(np.ones(K), 2 * n)
    d: Floats = rows[:n] - rows[n:]
    return d


class Convinced(Dominance):
    """Knows nothing until told of a preference; from then on calls whatever dominance leaves open
    WORSE.
    """

    told = False

    def compare(self, d: Any) -> Any:
        verdicts = super().compare(d)
        return np.where((verdicts == UNKNOWN) & self.told, np.int8(WORSE), verdicts)

    def update(self, answers: Answers) -> Convinced:
        new = Convinced(self.k)
        object.__setattr__(new, "told", self.told or bool(answers.y.any()))
        return new


def policy(
    verdict: int,
    tier: int,
    bound: bool,
    said: int,
    drawn: bool,
    unclear: bool,
    close: bool,
    guess: int,
) -> tuple[int, int]:
    """Return verdict and tier of a pair, by one plain line for each rule."""
    if verdict != UNKNOWN and tier <= Tier.DOMINANCE:
        return verdict, tier
    if bound and said != UNKNOWN:
        return said, Tier.KNOWN
    if verdict != UNKNOWN:
        audited = drawn and said == UNKNOWN and verdict != EQUAL and tier in BY_ANSWERS
        return (UNKNOWN if audited else verdict), tier
    if said != UNKNOWN:
        return said, Tier.KNOWN
    if unclear:
        return EQUAL, Tier.KNOWN
    if close:
        return EQUAL, Tier.INDIFFERENT
    return (UNKNOWN, Tier.TUTOR) if guess == UNKNOWN else (guess, Tier.GUESS)


@cache
def asking(
    audit: float = 0.0, guess: int = UNKNOWN, said: int = UNKNOWN, bound: bool = False
) -> AskingState:
    """A rule under which the pair OPEN was answered, or not."""
    rule = elicitation(audit=audit, indifference=1e-6).asking_state()
    told = elicitation()
    put(told, EQUAL)
    gaps = {
        UNKNOWN: np.empty(0),
        BETTER: np.eye(K - 1)[3],
        WORSE: np.eye(K - 1)[0],
        EQUAL: np.zeros(K - 1),
    }[guess]
    table = told.asking_state().answered
    if said != UNKNOWN or bound:
        table.said[:1], table.binding[:1] = EQUAL if said == UNKNOWN else said, bound
        rule = rule._replace(answered=table)
    return rule._replace(
        key=told.asking_state().key, unclear=True, guess=gaps, plain=not (audit or bound)
    )


@on_any_processor
def test_what_settles_a_pair_and_in_which_order() -> None:
    by_comparator = [
        (EQUAL, Tier.EQUAL),
        (BETTER, Tier.DOMINANCE),
        (UNKNOWN, Tier.DOMINANCE),
        (UNKNOWN, Tier.MODEL),
    ]
    by_comparator += [(BETTER, Tier.SCREEN), (WORSE, Tier.MODEL), (EQUAL, Tier.EXACT)]
    truths = (False, True)
    for (verdict, tier), bound, said in product(
        by_comparator, truths, (UNKNOWN, WORSE, EQUAL, BETTER)
    ):
        for drawn, unclear, close, guess in product(
            truths, truths, truths, (UNKNOWN, WORSE, EQUAL, BETTER)
        ):
            if bound and said == UNKNOWN:
                continue  # what is binding was said
            rule = asking(float(drawn), guess, said, bound)
            facts = Facts(int(verdict), int(tier), int(unclear), int(EQUAL if close else UNKNOWN))
            with np.errstate(all="ignore"):
                found = decide_by_facts(tail_sums(OPEN).copy(), rule, facts)
            wanted = policy(verdict, tier, bound, said, drawn and not bound, unclear, close, guess)
            assert (found.verdict, found.tier) == wanted
            assert found.needed == NO_FACT


def learned(comparator: Any) -> Any:
    d = differences(6, seed=9)
    return comparator.update(Answers(d, TruthfulTutor(VALUES).signs(d)))


TAUGHT = {name: learned(make(K)) for name, make in COMPARATORS.items()}
TAUGHT["polytope, one wrong"] = learned(PolytopeComparator(K, wrong=1))
TAUGHT["of your own"] = Convinced(K).update(Answers(OPEN, [1]))


# a resample that finds no maximum says so, and the three must agree all the same
@pytest.mark.filterwarnings("ignore:no maximum found")
@pytest.mark.parametrize("name", TAUGHT)
@given(
    seed=st.integers(0, 10_000),
    audit=st.sampled_from([0.0, 0.3]),
    indifference=st.sampled_from([0.0, 0.05]),
    answers=st.lists(st.sampled_from([None, EQUAL, BETTER, WORSE]), max_size=4),
    spent=st.booleans(),
)
@examples(12)
def test_arrays_single_pairs_and_loops_agree(
    name: str,
    seed: int,
    audit: float,
    indifference: float,
    answers: list[Verdict | None],
    spent: bool,
) -> None:
    d = differences(40, seed)
    budget = len(answers) if spent else None
    asked_by = elicitation(TAUGHT[name], audit=audit, indifference=indifference, max_queries=budget)
    for row, verdict in enumerate(answers):
        put(asked_by, verdict, d[row], drop=True, place=(row,))
    d = np.concatenate([d, -d[:6]])
    together = asked_by.decide(d, lambda row: (row % 7,))
    rule, asks = rule_of(asked_by.comparator), asked_by.asking_state()
    for i, (verdict, tier) in enumerate(zip(*together, strict=True)):
        alone = asked_by.decide(d[i : i + 1], lambda row, i=i: (i % 7,))  # type: ignore[misc]
        assert alone.verdicts[0] == verdict
        assert same(alone.tiers[0], tier)
        t = tail_sums(d[i]).copy()
        if dominance(t) != UNKNOWN:
            continue
        with np.errstate(all="ignore"):
            found = decide_pair(d[i], t, np.empty(K - 1), np.empty(K - 1), rule, asks)
        if found.verdict != LEFT_OPEN:
            assert found.verdict == verdict
            assert same(found.tier, tier)


def same(tier: int, other: int) -> bool:
    """Return whether two tiers are the same, or are both proofs.

    Which proof comes first depends on earlier questions. Whether there is a proof does not.
    """
    return tier == other or {tier, other} <= set(BY_ANSWERS)


def test_indifference_wants_both_bounds_close() -> None:
    up = np.array([0.01, -0.03, 0.0, 0.0, 0.02])
    assert [float(bound[0]) for bound in Dominance(K).bounds(up)] == pytest.approx([-0.01, 0.02])
    for share, settled in ((0.009, False), (0.0101, False), (0.0199, False), (0.0201, True)):
        wanted = (EQUAL, Tier.INDIFFERENT, False) if settled else (UNKNOWN, Tier.TUTOR, False)
        assert judged(elicitation(indifference=share), up, -up) == [wanted, wanted]


class Tilted(Dominance):
    """Its best guess is another one after every answer."""

    guess = np.linspace(0.0, 1.0, K)

    @property
    def values(self) -> Floats:
        return self.guess

    def update(self, answers: Answers) -> Tilted:
        new = Tilted(self.k)
        object.__setattr__(new, "guess", np.array([0.0, 0.9, 0.92, 0.94, 1.0]))
        return new


def test_beyond_the_budget_the_latest_guess_decides() -> None:
    asked_by = elicitation(Tilted(K), max_queries=1)
    assert judged(asked_by, OPEN) == [(UNKNOWN, Tier.TUTOR, False)]
    assert not asked_by.spent
    asked_by.puts_off = True
    assert judged(asked_by, OPEN) == [(np.sign(OPEN @ Tilted.guess), Tier.GUESS, False)]
    asked_by.puts_off = False
    put(asked_by, None, OTHER)
    assert asked_by.spent
    assert judged(asked_by, OPEN) == [
        (np.sign(OPEN @ asked_by.comparator.values), Tier.GUESS, False)
    ]
    assert np.sign(OPEN @ Tilted.guess) == -np.sign(OPEN @ asked_by.comparator.values)


def test_a_batch_holds_no_pair_twice_and_no_more_than_the_budget() -> None:
    d = differences(4)
    rows = np.stack([d[0], -d[0], d[1], d[2], d[3]])
    assert elicitation(batch=3).next_batch(rows) == [0, 2, 3]
    assert elicitation(batch=9).next_batch(rows) == [0, 2, 3, 4]
    assert elicitation(batch=9, max_queries=2).next_batch(rows) == [0, 2]


@pytest.mark.parametrize("verdict", [WORSE, BETTER])
def test_a_pair_answered_before_is_known_in_both_directions(verdict: Verdict) -> None:
    asked_by = elicitation()
    assert judged(asked_by, OPEN, -OPEN) == [(UNKNOWN, Tier.TUTOR, False)] * 2
    query = put(asked_by, verdict)
    wanted = [(verdict, Tier.KNOWN, False), (verdict.flipped, Tier.KNOWN, False)]
    assert judged(asked_by, query.d, -query.d) == wanted
    rows = np.stack([OPEN, -OPEN, 0.5 * OPEN])
    assert asked_by.may_ask(rows, lambda row: row).tolist() == [False, False, True]


@pytest.mark.parametrize("tie", [EQUAL, None])
def test_a_model_may_overrule_an_answer_but_no_tie(tie: Verdict | None) -> None:
    asked_by = elicitation(Convinced(K))
    put(asked_by, tie)
    put(asked_by, BETTER, OTHER)
    tied, model = (EQUAL, Tier.KNOWN, False), (WORSE, Tier.MODEL, False)
    assert judged(asked_by, OPEN, -OPEN, OTHER, -OTHER) == [tied, tied, model, model]
    assert asked_by.cannot_tell == (tie is None)
    assert len(asked_by.answers) == 2 - (tie is None)


@pytest.mark.parametrize("undecided", [EQUAL, BETTER])
def test_where_the_tutor_cannot_tell_the_user_says_what_holds(undecided: Verdict) -> None:
    asked_by = elicitation(undecided=undecided)
    put(asked_by, None, place=("here",))
    near = OPEN + np.array([0.0, 1e-3, -1e-3, 0.0, 0.0])
    assert judged(asked_by, OPEN, -OPEN)[0][:2] == (undecided, Tier.KNOWN)
    at = asked_by.decide(np.stack([near, near]), lambda row: [("here",), ("there",)][row])
    assert at.verdicts.tolist() == [EQUAL, UNKNOWN]
    assert at.tiers.tolist() == [Tier.KNOWN, Tier.TUTOR]
    assert asked_by.may_ask(
        np.stack([near, near]), lambda row: [("here",), ("there",)][row]
    ).tolist() == [False, True]
    assert judged(asked_by, near) == [(UNKNOWN, Tier.TUTOR, False)], "of no place"
    put(asked_by, BETTER, OTHER, place=("there",))  # where the tutor can tell
    at = asked_by.decide(near[None], lambda _: ("there",))
    assert (at.verdicts.tolist(), at.tiers.tolist()) == ([UNKNOWN], [Tier.TUTOR])


def test_an_answer_that_may_end_a_row_of_equals_is_not_taken_at_once() -> None:
    asked_by = elicitation(PolytopeComparator(K, tie=0.01))
    left, right = np.maximum(OTHER, 0.0), np.maximum(-OTHER, 0.0)
    put(asked_by, EQUAL, 1e-3 * OPEN)
    assert not asked_by.take_at_once(left, right, BETTER)
    assert (asked_by.asked, len(asked_by.answers)) == (1, 1)
    assert elicitation(PolytopeComparator(K, tie=0.01)).take_at_once(left, right, BETTER)


def test_an_answer_dropped_as_contradictory_settles_its_own_pair() -> None:
    asked_by = elicitation(PolytopeComparator(K))
    put(asked_by, BETTER)
    assert judged(asked_by, OPEN + MORE)[0][0] == BETTER
    with pytest.raises(InconsistentAnswers):
        put(asked_by, WORSE, OPEN + MORE)
    assert len(asked_by.pending) == len(asked_by.answers) == asked_by.asked == 1
    (query,) = asked_by.ask()
    said, dropped = asked_by.tell([Answer(query, WORSE)], "drop")
    assert (said, dropped[0].query) == ({query.id: WORSE}, query)
    assert judged(asked_by, query.d, -query.d) == [
        (WORSE, Tier.KNOWN, False),
        (BETTER, Tier.KNOWN, False),
    ]
    assert judged(asked_by, OPEN + 2 * MORE)[0][0] == BETTER, "nothing else is settled by it"
    assert (asked_by.asked, len(asked_by.answers)) == (2, 1)


def test_of_several_answers_only_what_contradicts_is_dropped() -> None:
    asked_by = elicitation(PolytopeComparator(K))
    queries = asked_by.open([pair(), pair(OPEN + MORE), pair(OTHER)])
    _, dropped = asked_by.tell(
        [Answer(q, v) for q, v in zip(queries, (BETTER, WORSE, BETTER), strict=True)], "drop"
    )
    assert [answer.query for answer in dropped] == [queries[1]]
    assert asked_by.answers.ids == (queries[0].id, queries[2].id)


def test_the_share_of_audits_is_as_stated_and_answered_pairs_are_left_out() -> None:
    comparator, d = TAUGHT["polytope"], differences(3000)
    counts = {}
    for share in (0.0, 0.2, 1.0):
        settled = elicitation(comparator, audit=share).decide(d)
        counts[share] = audited(*settled)
        assert np.isin(settled.tiers[counts[share]], BY_ANSWERS).all()
    every, fifth = counts[1.0].sum(), counts[0.2].sum()
    assert not counts[0.0].any()
    assert abs(fifth - 0.2 * every) < 4 * np.sqrt(0.16 * every)
    assert not (counts[0.2] & ~counts[1.0]).any()
    asked_by, row = elicitation(comparator, audit=1.0), d[np.flatnonzero(counts[1.0])[0]]
    (_, tier, _), expected = judged(asked_by, row)[0], Verdict(comparator.compare(row)[0])
    put(asked_by, expected, row, tier=tier)
    assert judged(asked_by, row, -row) == [(expected, tier, False), (expected.flipped, tier, False)]
    assert (asked_by.asked, asked_by.counts[tier], len(asked_by.audits)) == (0, 1, 1)


@pytest.mark.parametrize(
    ("answer", "verdict", "tier"),
    [
        (WORSE, WORSE, Tier.MODEL),
        (BETTER, WORSE, Tier.MODEL),
        (EQUAL, EQUAL, Tier.KNOWN),
        (None, WORSE, Tier.MODEL),
    ],
)
def test_an_audit_s_answer_counts_but_the_model_has_the_last_word(
    answer: Verdict | None, verdict: Verdict, tier: Tier
) -> None:
    asked_by = elicitation(Convinced(K), audit=1.0)
    put(asked_by, BETTER, OTHER)
    assert judged(asked_by, OPEN) == [(UNKNOWN, Tier.MODEL, True)]
    seen: list[tuple[int, int]] = []
    asked_by.watch = lambda d, decisions: seen.extend(
        zip(*(column.tolist() for column in decisions), strict=True)
    )
    put(asked_by, answer, tier=int(Tier.MODEL))
    assert seen == [(verdict, tier)]
    assert (asked_by.asked, asked_by.audits[0].answer, asked_by.audits[0].expected) == (
        1,
        answer,
        WORSE,
    )
    assert asked_by.audits[0].contradicts == (answer is BETTER)


def test_what_the_user_acted_on_is_counted_and_shown() -> None:
    asked_by, seen = elicitation(), []
    asked_by.watch = lambda d, decisions: seen.append((d.tolist(), decisions.verdicts.tolist()))
    found = asked_by.decide(np.stack([OPEN, np.eye(K)[4] - np.eye(K)[0], np.zeros(K)]))
    assert asked_by.counts.sum() == 0
    asked_by.commit(
        np.stack([np.eye(K)[4] - np.eye(K)[0]]), Decisions(found.verdicts[1:2], found.tiers[1:2])
    )
    asked_by.commit(np.empty((0, K)), Decisions(found.verdicts[:0], found.tiers[:0]))
    put(asked_by, WORSE)
    assert {Tier(i): int(n) for i, n in enumerate(asked_by.counts) if n} == {
        Tier.DOMINANCE: 1,
        Tier.TUTOR: 1,
    }
    assert [verdicts for _, verdicts in seen] == [[BETTER], [WORSE]]


def test_an_oracle_answers_what_is_left_without_limit() -> None:
    asked_by, tutor = (
        elicitation(indifference=1.0, max_queries=0),
        FlippingTutor(VALUES, 0.2, seed=0),
    )
    asked_by.signs = tutor.signs
    d = differences(50)
    open_rows = Dominance(K).compare(d) == UNKNOWN
    found = asked_by.decide(d)
    assert (
        found.verdicts[open_rows] == FlippingTutor(VALUES, 0.2, seed=0).signs(d[open_rows])
    ).all()
    assert (found.tiers[open_rows] == Tier.TUTOR).all()
    asked_by.commit(d, Decisions(found.verdicts, found.tiers))
    assert asked_by.asked == open_rows.sum()


@pytest.mark.parametrize("labels", ["abcd", b"abcd", ["a", "b", "c"], 4])
def test_labels_are_a_list_of_names(labels: Any) -> None:
    with pytest.raises(ValueError, match="labels must be None or 4 names, one a level, not"):
        Elicitation(Dominance(4), "a run", labels=labels)
    assert Elicitation(Dominance(4), "a run", labels=list("abcd")).ask() == ()


@pytest.mark.parametrize("wrong", [1, 2])
@pytest.mark.parametrize("said", [BETTER, EQUAL])
def test_where_answers_may_be_wrong_an_open_pair_is_asked_again_until_enough_agree(
    wrong: int, said: Verdict
) -> None:
    asked_by = elicitation(PolytopeComparator(K, wrong=wrong))
    for _ in range(wrong + 1):
        assert judged(asked_by, OPEN) == [(UNKNOWN, Tier.TUTOR, False)]
        assert asked_by.may_ask(OPEN[None], lambda _: ()).all()
        put(asked_by, said)
    assert judged(asked_by, OPEN)[0][0] == said
    assert not asked_by.may_ask(OPEN[None], lambda _: ()).any()
    again = elicitation(PolytopeComparator(K, wrong=wrong), known=asked_by.answers)
    assert judged(again, OPEN, -OPEN) == judged(asked_by, OPEN, -OPEN)
    fewer = elicitation(PolytopeComparator(K, wrong=wrong), known=asked_by.answers[:wrong])
    assert judged(fewer, OPEN) == [(UNKNOWN, Tier.TUTOR, False)]


def test_who_cannot_tell_is_not_asked_again_where_answers_may_be_wrong() -> None:
    asked_by = elicitation(PolytopeComparator(K, wrong=1))
    put(asked_by, None)
    assert judged(asked_by, OPEN) == [(EQUAL, Tier.KNOWN, False)]


def test_answers_of_a_log_count_where_answers_may_be_wrong() -> None:
    query = Query.make("a log", 0, np.maximum(OTHER, 0.0), np.maximum(-OTHER, 0.0))
    other = Query.make("a log", 1, np.maximum(OTHER, 0.0), np.maximum(-OTHER, 0.0))
    once, twice = (
        elicitation(PolytopeComparator(K, wrong=1), known=[Answer(one, EQUAL) for one in some])
        for some in ((query,), (query, other))
    )
    assert judged(once, OTHER) == [(UNKNOWN, Tier.TUTOR, False)]
    assert judged(twice, OTHER) == [(EQUAL, Tier.KNOWN, False)]
