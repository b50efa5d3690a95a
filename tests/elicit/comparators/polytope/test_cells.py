"""A polytope that survives wrong answers: against all ways to leave some out, and with a lie at
every position."""

import copy
import pickle
from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from elicit import (
    Answer,
    Answers,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from elicit.comparators.polytope.cells import log_volume
from elicit.lp.hit_and_run import Draws
from qlearn import InteractivePolicyIteration, drive, policy_loss, random_mdp
from tests.scale_arithmetic import Floats, tail_sums
from tests.thoroughness import examples, scaled

BETTER, EQUAL, WORSE, UNKNOWN = Verdict.BETTER, Verdict.EQUAL, Verdict.WORSE, Verdict.UNKNOWN
MARGIN = 1e-6


class Told(NamedTuple):
    """Answers of whatever kind, how many may be wrong, and what to ask."""

    answers: Answers
    wrong: int
    ask: Floats


@st.composite
def told(draw: st.DrawFn) -> Told:
    k, n, wrong = draw(st.integers(3, 5)), draw(st.integers(0, 7)), draw(st.integers(1, 2))
    rng = np.random.default_rng(draw(st.integers(0, 10**9)))
    gaps = rng.dirichlet(np.ones(k - 1))
    d = rng.dirichlet(np.ones(k), n) - rng.dirichlet(np.ones(k), n) if n else np.empty((0, k))
    at = tail_sums(d) @ gaps if n else np.empty(0)
    y = np.where(np.abs(at) <= 0.01, rng.integers(-1, 2, n), np.sign(at)).astype(int)
    if n:
        lies = rng.integers(n, size=draw(st.integers(0, 3)))
        y[lies] = rng.integers(-1, 2, len(lies))
    ask = rng.dirichlet(np.ones(k), 6) - rng.dirichlet(np.ones(k), 6)
    return Told(Answers(d, y), wrong, np.concatenate([ask, d[:2]]))


def halves(answers: Answers, rows: tuple[int, ...], tie: float) -> tuple[Floats, Floats]:
    """Rows and limits of the answers in these rows: rows g >= limits."""
    found, limits = [np.empty(answers.k - 1)][:0], []
    for row in rows:
        t = tail_sums(answers.d[row])
        for sign in (1, -1) if answers.y[row] == 0 else (int(answers.y[row]),):
            found.append(sign * t)
            limits.append(-tie if answers.y[row] == 0 else 0.0)
    return np.array(found).reshape(-1, answers.k - 1), np.array(limits)


def optimum(goal: Floats, rows: Floats, limits: Floats) -> float | None:
    """The least goal.g over {g >= margin, sum g = 1, rows g >= limits} by HiGHS; None if it is
    empty."""
    some = {"A_ub": -rows, "b_ub": -limits} if len(rows) else {}
    found = linprog(
        goal, A_eq=np.ones((1, len(goal))), b_eq=[1.0], bounds=[(MARGIN, None)] * len(goal), **some
    )
    return float(found.fun) if found.status == 0 else None


def ways(told: Told, tie: float) -> Iterator[tuple[Floats, Floats]]:
    """The polytopes that leave out at most so many answers, those in which all others can be
    strictly right."""
    n = len(told.answers)
    for out in (rows for size in range(told.wrong + 1) for rows in combinations(range(n), size)):
        rows, limits = halves(told.answers, tuple(i for i in range(n) if i not in out), tie)
        # a variable more, the room in every row
        roomy = np.column_stack([rows, -np.ones(len(rows))])
        equal = np.append(np.ones(told.answers.k - 1), 0.0)[None]
        goal = np.append(np.zeros(told.answers.k - 1), -1.0)
        some = {"A_ub": -roomy, "b_ub": -limits} if len(rows) else {}
        bounds = [(MARGIN, None)] * (told.answers.k - 1) + [(None, 1.0)]
        found = linprog(goal, A_eq=equal, b_eq=[1.0], bounds=bounds, **some)
        if found.status == 0 and -found.fun > 1e-7:
            yield rows, limits


@given(told(), st.sampled_from([0.01, 0.1]))
@examples(60)
def test_verdicts_and_bounds_are_those_of_all_ways_to_leave_answers_out(
    told: Told, tie: float
) -> None:
    left = list(ways(told, tie))
    blank = PolytopeComparator(told.answers.k, MARGIN, tie=tie, wrong=told.wrong)
    if not left:
        with pytest.raises(InconsistentAnswers) as caught:
            blank.update(told.answers)
        rows = [row for row, _ in caught.value.answers]
        assert len(rows) > told.wrong
        for row in rows:  # minimal: without any one of them the others can be explained
            rest = [other for other in rows if other != row]
            blank.update(Answers(told.answers.d[rest], told.answers.y[rest]))
        return
    known = blank.update(told.answers)
    low, high = known.bounds(told.ask)
    top, confidence = known.simultaneous_bounds(told.ask)
    assert confidence == 1.0
    for i, (t, verdict) in enumerate(
        zip(tail_sums(told.ask), known.compare(told.ask), strict=True)
    ):
        least = min(optimum(t, *way) or 0.0 for way in left)
        most = max(-(optimum(-t, *way) or 0.0) for way in left)
        assert low[i] == pytest.approx(least, abs=2e-7)
        assert high[i] == pytest.approx(most, abs=2e-7)
        assert top[i] >= most - 2e-7
        if min(abs(least), abs(most)) > 1e-6:
            assert verdict == (BETTER if least > 0 else WORSE if most < 0 else UNKNOWN)


@given(told())
@examples(20)
def test_the_order_of_the_answers_changes_no_verdict(told: Told) -> None:
    n = len(told.answers)
    order = np.random.default_rng(n).permutation(n)
    found = []
    for rows in (np.arange(n), order):
        known = PolytopeComparator(told.answers.k, wrong=told.wrong)
        try:
            for row in rows:
                known = known.update(told.answers[int(row) : int(row) + 1])
        except InconsistentAnswers:
            found.append(None)
            continue
        found.append((known.compare(told.ask).tolist(), known.bounds(told.ask)))
    if found[0] is None or found[1] is None:
        assert found[0] is found[1]
    else:
        assert found[0][0] == found[1][0]
        np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-8)


@pytest.mark.parametrize("wrong", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_lie_at_any_position_violates_no_bound(wrong: int) -> None:
    mdp, values = random_mdp(15, 3, 4, seed=5)
    truth = TruthfulTutor(values)
    lies = 0
    for at in range(scaled(2, 12)):
        given = 0

        def tutor(query: Query, at: int = at) -> Answer:
            nonlocal given, lies
            verdict = Verdict(truth(query).verdict or 0)
            lie = at <= given < at + wrong
            lies += lie
            given += 1
            return Answer(query, verdict.flipped if lie else verdict)

        learner = InteractivePolicyIteration(
            mdp, PolytopeComparator(4, wrong=wrong), tolerance=0.01
        )
        result = drive(learner, tutor)
        assert result.status.name == "CONVERGED"
        assert policy_loss(mdp, result.policy, values).max() <= result.loss_bound + 1e-12
        assert result.confidence == 1.0
        low, high = result.comparator.bounds(np.eye(4) - np.eye(4)[0])
        truth_scaled = (values - values[0]) / (values[-1] - values[0])
        assert (low <= truth_scaled + 1e-9).all()
        assert (truth_scaled <= high + 1e-9).all()
    assert lies >= scaled(2, 5)


D, OTHER = np.array([0.0, 1.0, -0.5, 0.0]), np.array([0.0, 0.0, 1.0, -0.4])


def test_disagreement_widens_and_a_majority_tells_who_was_wrong() -> None:
    blank = PolytopeComparator(4, wrong=1)
    one = blank.update(Answers(D, [1], ["a"]))
    assert one.compare(D).tolist() == [UNKNOWN]
    assert (one.suspects, one.refuted) == ((), ())
    torn = one.update(Answers(2 * D, [-1], ["b"]))
    assert torn.compare(D).tolist() == [UNKNOWN]
    assert (torn.suspects, torn.refuted) == (((0, "a"), (1, "b")), ())
    np.testing.assert_allclose(torn.bounds(D), blank.bounds(D))  # as if neither had been given
    sure = torn.update(Answers(D, [1], ["c"]))
    assert sure.compare(D).tolist() == [BETTER]
    assert (sure.suspects, sure.refuted) == (((1, "b"),), ((1, "b"),))
    with pytest.raises(
        InconsistentAnswers, match="more than 1 of these 4 answers are wrong"
    ) as caught:
        sure.update(Answers(-D, [1], ["d"]))
    assert [name for _, name in caught.value.answers] == ["a", "b", "c", "d"]
    assert sure.retract("b").refuted == ()
    assert PolytopeComparator(4, wrong=2).update(Answers([D, D, D, -D], [1, -1, 1, 1])).compare(
        D
    ).tolist() == [UNKNOWN]


def test_the_same_answer_twice_is_proof_against_one_lie() -> None:
    twice = PolytopeComparator(4, wrong=1).update(Answers([D, D], [1, 1]))
    assert twice.compare(D).tolist() == [BETTER]
    assert len(twice.cells) == 1
    assert twice.bounds(D)[0][0] == pytest.approx(
        PolytopeComparator(4).update(Answers(D, [1])).bounds(D)[0][0]
    )


def test_an_equal_may_be_wrong_too() -> None:
    once = PolytopeComparator(4, tie=0.05, wrong=1).update(Answers(OTHER, [0]))
    assert [cell.wrong for cell in once.cells] == [(), (0,), (0,)]
    np.testing.assert_allclose(once.bounds(OTHER), PolytopeComparator(4).bounds(OTHER))
    low, high = once.update(Answers(OTHER, [0])).bounds(OTHER)
    assert (float(low[0]), float(high[0])) == pytest.approx((-0.05, 0.05), abs=1e-8)


def test_against_the_order_of_the_levels() -> None:
    step = np.array([0.0, 1.0, -1.0, 0.0])  # level 2 above level 3
    known = PolytopeComparator(4, wrong=1).update(Answers(step, [1], ["odd"]))
    assert known.refuted == ((0, "odd"),)
    assert known.compare(step).tolist() == [WORSE]
    with pytest.raises(InconsistentAnswers):
        known.update(Answers(-step, [-1]))


def test_none_wrong_is_the_polytope_as_it_was() -> None:
    answers = Answers([D, OTHER], [1, 1])
    plain, spelled = (PolytopeComparator(4, **more).update(answers) for more in ({}, {"wrong": 0}))
    assert repr(plain) == repr(spelled) == "PolytopeComparator(k=4, margin=1e-06, 2 answers)"
    assert (plain.values == spelled.values).all()
    ((one, wrong, weight),) = plain.cells
    assert one is plain
    assert (wrong, weight) == ((), 1.0)


@pytest.mark.parametrize("wrong", [-1, 0.5, True, None])
def test_a_number_that_does_not_fit(wrong: object) -> None:
    with pytest.raises(ValueError, match="wrong, how many answers may be wrong"):
        PolytopeComparator(4, wrong=wrong)  # type: ignore[arg-type]


def test_parts_of_a_single_polytope_say_where_to_look() -> None:
    known = PolytopeComparator(4, wrong=1).update(Answers([D, OTHER], [1, 1]))
    assert "wrong=1" in repr(known)
    for call in (lambda: known.region, lambda: known.problems(D), lambda: known.explain(D)):
        with pytest.raises(
            ValueError, match=r"with wrong=1 .* a union of 3 polytopes.* each of comparator\.cells"
        ):
            call()
    assert sum(cell.weight for cell in known.cells) == pytest.approx(1.0)
    assert known.cells[0].scales.explain(D).verdict == BETTER
    for same in (copy.deepcopy(known), pickle.loads(pickle.dumps(known))):
        assert (same.compare(np.stack([D, OTHER])) == known.compare(np.stack([D, OTHER]))).all()
        assert (same.values == known.values).all()


def test_a_volume_is_that_of_the_scatter_wherever_the_set_lies() -> None:
    rng = np.random.default_rng(0)
    gaps, weights = rng.dirichlet(np.ones(4), 200).T, np.full(200, 1 / 200)
    whole = log_volume(Draws(gaps, weights, np.full(200, np.inf)))
    assert whole == pytest.approx(0.5 * np.linalg.slogdet(np.cov(gaps[:3], bias=True))[1], abs=1e-5)
    half = log_volume(Draws(0.5 * gaps + 0.1, weights, np.full(200, np.inf)))
    assert half == pytest.approx(whole - 3 * np.log(2), abs=1e-5)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.8])
def test_a_set_that_is_flat_in_one_direction_has_next_to_no_volume(share: float) -> None:
    gaps, weights = np.random.default_rng(0).dirichlet(np.ones(5), 200).T, np.full(200, 1 / 200)
    whole = log_volume(Draws(gaps, weights, np.full(200, np.inf)))
    gaps[1] = share * gaps[0]  # what elimination leaves of it is rounding, of either sign
    with np.errstate(all="raise"):
        assert log_volume(Draws(gaps, weights, np.full(200, np.inf))) < whole - 10
