"""The relaxed polytope: the reliable one where answers are consistent, a linear program's set where
they are not.
"""

import time
from collections import Counter
from fractions import Fraction
from itertools import pairwise
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import linprog

from elicit import Answers, PolytopeComparator, RelaxedPolytopeComparator, Verdict
from elicit.comparators.polytope.plausible_set import PlausibleSet
from elicit.comparators.polytope.relaxed_comparator import LEAST_SLACK
from elicit.comparators.polytope.violation import Hinges, best_fit
from elicit.lp.region import TIE_BAND, answer_rows
from elicit.testing import check_comparator
from tests.lp_cases import Case, cases, dot, exact, from_tails, region_of, shares, tails
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import on_any_processor, scaled

Floats = np.ndarray[Any, Any]
BETTER, WORSE, EQUAL, UNKNOWN = Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL, Verdict.UNKNOWN


class Fit:
    """Least total violation, and least d.e where the total violation is at most some number."""

    def __init__(
        self,
        k: int,
        margin: float,
        prior: tuple[Floats, Floats] | None,
        answers: Answers,
        tie: float = 0.0,
    ) -> None:
        self.k, self.n, self.most = k, len(answers), np.inf
        none, rows, limits = np.zeros(self.n), [], []
        for i, (d, y) in enumerate(zip(answers.d, answers.y, strict=True)):
            for sign in (1, -1) if y == 0 else (y,):
                rows.append(np.append(sign * d, np.eye(self.n)[i]))
                limits.append(-max(TIE_BAND * np.abs(d).sum(), tie) if y == 0 else 0.0)
        steps = np.eye(k)[1:] - np.eye(k)[:-1]
        for a, b in [
            *((step, margin) for step in steps),
            *(zip(*prior, strict=True) if prior is not None else ()),
        ]:
            rows.append(np.append(a, none))
            limits.append(b)
        self.rows, self.limits = -np.array(rows), -np.array(limits)

    def _least(self, cost: Floats) -> float:
        total = np.append(np.zeros(self.k), np.ones(self.n))
        within = np.isfinite(self.most)
        found = linprog(
            cost,
            np.vstack([self.rows, total[None]]) if within else self.rows,
            np.append(self.limits, self.most) if within else self.limits,
            bounds=[(0, 0), *[(None, None)] * (self.k - 2), (1, 1), *[(0, None)] * self.n],
            method="highs",
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        assert found.status == 0
        return float(found.fun)

    def violation(self) -> float:
        return self._least(np.append(np.zeros(self.k), np.ones(self.n)))

    def within(self, total: float) -> None:
        self.most = total

    def range(self, d: Floats) -> tuple[float, float]:
        none = np.zeros(self.n)
        return self._least(np.append(d, none)), -self._least(np.append(-d, none))

    def most_violation(self, i: int) -> float:
        return -self._least(-np.append(np.zeros(self.k), np.eye(self.n)[i]))


def budget_of(comparator: RelaxedPolytopeComparator) -> float:
    """The total violation that is allowed, as documented."""
    if comparator.violation == comparator.slack == 0:
        return 0.0
    hinges = Hinges.of(comparator.answers, comparator.tie)
    unit = 2.0**hinges.exponent
    most = unit * (len(hinges.rows) + 1)  # of any scale
    return comparator.violation + min(max(comparator.slack, LEAST_SLACK * unit), most)


def noisy(seed: int, k: int, n: int, rate: float) -> tuple[Floats, Answers]:
    """A scale and n answers about shares, a share of them wrong."""
    rng = np.random.default_rng(seed)
    e = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.ones(k - 1)))])
    d = shares(rng, k, n, 1.0)
    wrong = rng.random(n) < rate
    return e, Answers(
        d, np.where(wrong, -1, 1) * np.sign(d @ e).astype(int), [f"a{i}" for i in range(n)]
    )


def check_against(
    fit: Fit, comparator: RelaxedPolytopeComparator, ask: Floats, size: float
) -> Counter[int]:
    assert comparator.violation == pytest.approx(fit.violation(), abs=1e-9 * size)
    fit.within(budget_of(comparator) + 1e-13)
    verdicts, (low, high), seen = comparator.compare(ask), comparator.bounds(ask), Counter[int]()
    for d, verdict, lo, hi in zip(ask, verdicts, low, high, strict=True):
        least, greatest = fit.range(d)
        assert (lo, hi) == pytest.approx((least, greatest), abs=1e-7)
        if min(abs(least), abs(greatest)) > 1e-7:
            assert verdict == (BETTER if least > 0 else WORSE if greatest < 0 else UNKNOWN)
            seen[int(verdict)] += 1
        elif verdict != UNKNOWN:  # then it is proven, however close
            assert least > -1e-9 if verdict == BETTER else greatest < 1e-9
    return seen


@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_verdicts_and_bounds_are_those_of_the_linear_programs(part: int) -> None:
    seen: Counter[int] = Counter()
    inconsistent = 0
    n_cases = scaled(16, 56)
    for seed in range(n_cases * part, n_cases * (part + 1)):
        rng = np.random.default_rng(seed)
        k, n, slack = (
            int(rng.integers(3, 9)),
            int(rng.integers(8, 36)),
            float(rng.choice([0, 0.003, 0.05, 0.3])),
        )
        _, told = noisy(seed, k, n, 0.3)
        y = np.where(rng.random(n) < 0.1, 0, told.y)
        told = Answers(told.d, y) + Answers(told.d[:3], y[:3])  # some of them twice
        margin = float(rng.choice([0.0, 1e-6, 0.02]))
        comparator = RelaxedPolytopeComparator(k, slack, margin, tie=0.0).update(told[: n // 2])
        comparator.compare(told.d)  # what is cut for some answers is handed on
        comparator = comparator.update(told[n // 2 :])
        inconsistent += comparator.violation > 0
        ask = np.concatenate([shares(rng, k, 3), told.d[:1]])
        seen += check_against(Fit(k, margin, None, told), comparator, ask, 1.0)
    assert inconsistent >= scaled(14, 50)
    assert min(seen[v] for v in (-1, 1, 2)) > scaled(7, 25)


def flipped(case: Case, seed: int) -> Answers:
    y = case.y.copy()
    y[np.random.default_rng(seed).random(len(y)) < 0.3] *= -1
    return Answers(case.d, y)


@pytest.mark.slow
def test_nasty_answers_turned_round() -> None:
    """Ties, parallel and duplicated cuts, flat and thin polytopes, priors, tiny answers: with wrong
    ones among them.
    """
    inconsistent = 0
    for i, case in enumerate(cases(77, scaled(28, 84), most_levels=9, most_answers=40)):
        if case.kind == "extreme":
            continue
        told, slack = flipped(case, i), (0.0, 0.01, 0.2)[i % 3]
        comparator = RelaxedPolytopeComparator(
            case.k, slack, case.margin, case.prior, tie=case.tie
        ).update(told)
        inconsistent += comparator.violation > 0
        ask = case.ask / np.maximum(np.abs(case.ask).sum(axis=1, keepdims=True), 1e-300)
        size = max(1.0, np.abs(told.d).max(initial=0.0))
        check_against(Fit(case.k, case.margin, case.prior, told, case.tie), comparator, ask, size)
        widest = comparator.bounds(np.eye(case.k)[1:] - np.eye(case.k)[:-1])[1]
        assert (np.diff(comparator.values) <= widest + 1e-12).all()
    assert inconsistent > scaled(10, 30)


def test_values_are_the_analytic_centre_with_violations() -> None:
    """The barrier's maximum by another method: a conic program with logarithms."""
    for seed, slack in ((0, 0.1), (1, 0.02)):
        _, told = noisy(seed, 5, 20, 0.2)
        comparator = RelaxedPolytopeComparator(5, slack, margin=0.01, tie=0.0).update(told)
        e, s = cp.Variable(5), cp.Variable(20)
        over = cp.multiply(told.y, told.d @ e) + s
        rest = comparator.violation + slack - cp.sum(s)
        logs = [cp.sum(cp.log(x)) for x in (cp.diff(e) - 0.01, s, over)]
        cp.Problem(cp.Maximize(sum(logs) + cp.log(rest)), [e[0] == 0, e[4] == 1]).solve(cp.CLARABEL)
        assert comparator.values == pytest.approx(e.value, abs=1e-5)
        assert comparator.violation > 0


def test_consistent_answers_and_no_slack_are_the_polytope_comparator() -> None:
    for i, case in enumerate(cases(31, scaled(28, 56), most_levels=11, most_answers=60)):
        told = Answers(case.d, case.y)
        plain = PolytopeComparator(case.k, margin=case.margin, prior=case.prior, tie=case.tie)
        relaxed = RelaxedPolytopeComparator(
            case.k, margin=case.margin, prior=case.prior, tie=case.tie
        )
        half = len(told) // 2
        relaxed = relaxed.update(told[:half]).update(told[half:])
        plain = plain.update(told)
        assert relaxed.compare(case.ask).tolist() == plain.compare(case.ask).tolist(), case.kind
        room = 1e-9 * np.abs(case.ask).sum(axis=1) + 1e-300
        for mine, its in zip(relaxed.bounds(case.ask), plain.bounds(case.ask), strict=True):
            with np.errstate(all="ignore"):
                assert ((np.abs(mine - its) <= room) | (mine == its)).all(), case.kind
        if i % 4 == 0:
            assert relaxed.values == pytest.approx(plain.values, abs=1e-9)
        assert (relaxed.violation, relaxed.violated) == (0.0, ())


@pytest.mark.slow
def test_slack_only_ever_loosens() -> None:
    decided = loosened = 0
    for i, case in enumerate(cases(32, 28, most_levels=8, most_answers=30)):
        told = flipped(case, i) if i % 2 else Answers(case.d, case.y)
        slacks = (0.0, 1e-12, 1e-3, 0.1, 1e9)
        several = [
            RelaxedPolytopeComparator(case.k, x, case.margin, case.prior, tie=case.tie).update(told)
            for x in slacks
        ]
        for tight, loose in pairwise(several):
            assert loose.violation == tight.violation
            narrow, wide = tight.compare(case.ask), loose.compare(case.ask)
            assert ((wide == UNKNOWN) | (wide == narrow) | (narrow == EQUAL)).all(), (
                case.kind,
                tight.slack,
            )
            ends = tight.bounds(case.ask), loose.bounds(case.ask)
            room = 1e-9 * np.abs(case.ask).sum(axis=1)
            with np.errstate(all="ignore"):
                assert (ends[1][0] <= ends[0][0] + room).all()
                assert (ends[1][1] >= ends[0][1] - room).all()
            decided += int(np.count_nonzero(narrow != UNKNOWN))
            loosened += int(np.count_nonzero(narrow != wide))
        free = PolytopeComparator(case.k, margin=case.margin, prior=case.prior, tie=case.tie)
        assert (several[-1].compare(case.ask) == free.compare(case.ask)).all()
    assert decided > 100
    assert loosened > 10


def test_cuts_hold_exactly() -> None:
    """A cut asks no more of any g >= 0 of total 1 than the weighted sum, in rationals.

    This holds for any rows and weights.
    """
    for i, case in enumerate(cases(33, 56, most_levels=12, most_answers=60)):
        rng, hinges = np.random.default_rng(i), Hinges.of(flipped(case, i), case.tie)
        if not len(hinges.rows):
            continue
        for _ in range(5):
            some = rng.random(len(hinges.rows)) < 0.5
            weights = hinges.weights * np.where(
                some, 1.0 if rng.random() < 0.5 else rng.random(len(some)), 0.0
            )
            budget = float(10.0 ** rng.uniform(-10, 1))
            row, limit = hinges.cut(weights, budget)
            total = [dot(exact(weights), exact(hinges.rows[:, j])) for j in range(case.k - 1)]
            wanted = dot(exact(weights), exact(hinges.rhs)) - Fraction(budget)
            unit = Fraction(2) ** int(np.frexp(np.abs(weights @ hinges.rows).max())[1])
            if limit == -2.0:  # row.g > -1: it says nothing
                continue
            # at every corner of that simplex, hence on all of it
            for j in range(case.k - 1):
                assert (Fraction(row[j]) - Fraction(limit)) * unit >= total[j] - wanted
            assert float(wanted / unit) - limit < 1e-8


def test_the_best_fit_is_a_scale_and_its_violation_no_less_than_told() -> None:
    for i, case in enumerate(cases(34, 28, most_levels=10, most_answers=60)):
        told = flipped(case, i)
        hinges = Hinges.of(told, case.tie)
        rows, rhs, owner = answer_rows(told, 0, case.tie)
        assert (hinges.rows == rows).all()
        assert (hinges.owner == owner).all()
        unit = Fraction(2) ** hinges.exponent
        for row, weight, i in zip(hinges.rows, hinges.weights, owner, strict=True):
            t = tails(told.d[i])  # weights are what the rows were divided by
            if weight > 2.0**-1000:
                size = max(map(abs, exact(t)))
                assert size == max(map(abs, exact(row))) * Fraction(weight) * unit
        order = PlausibleSet(
            PolytopeComparator(case.k, case.margin, case.prior, tie=case.tie).region
        )
        g = best_fit(hinges, order)
        true = [x / sum(exact(g)) for x in exact(g)]
        region = region_of(case.k, case.margin, case.prior, case.d[:0], [])
        off = [limit - dot(row, true) for row, limit in zip(region.rows, region.rhs, strict=True)]
        flat = order.inside is None  # then g is a rounded rational point
        assert max([*off, region.margin - min(true)]) <= (Fraction(1e-15) if flat else 0)
        lacking = [r - dot(row, true) for row, r in zip(map(exact, rows), exact(rhs), strict=True)]
        total = dot(exact(hinges.weights), [max(x, Fraction(0)) for x in lacking])
        assert total <= Fraction(hinges.at_most(g)) <= total + Fraction(1e-11)


# g_1 >= 0.6 and g_1 <= 9/19: no scale does both
UP, DOWN = from_tails([1.0, -1.5]), from_tails([-0.90625, 1.0])


def test_repeated_answers_count_repeatedly() -> None:
    once = RelaxedPolytopeComparator(3, tie=0.0).update(Answers([UP, DOWN], [1, 1], ["up", "down"]))
    # 1.5 - 2.5 g is lacking of the one, 1.90625 g - 1 of the other: the steeper one wins
    assert once.violation == pytest.approx(1.90625 * 0.6 - 1, abs=1e-10)
    assert once.values[1] == pytest.approx(0.6, abs=1e-8)
    assert once.violated == ((1, "down"),)
    assert once.compare([UP - 1e-3 * np.eye(3)[2], UP + 1e-3 * np.eye(3)[2], DOWN]).tolist() == [
        WORSE,
        BETTER,
        WORSE,
    ]
    twice = once.update(Answers([DOWN], [1], ["again"]))
    assert twice.violation == pytest.approx(1.5 - 2.5 / 1.90625, abs=1e-10)
    assert twice.values[1] == pytest.approx(1 / 1.90625, abs=1e-8)
    assert twice.violated == ((0, "up"),)
    assert once.violated == ((1, "down"),)
    low, high = once.bounds([[0, 1, 0]])
    assert (low[0], high[0]) == pytest.approx((0.6, 0.6), abs=1e-8)
    loose = RelaxedPolytopeComparator(3, slack=0.19, tie=0.0).update(Answers([UP, DOWN], [1, 1]))
    # between the cuts f falls by .59375 a unit, beyond 0.6 it rises by 1.90625, below 1/1.90625 by
    # 2.5
    wide = [0.6 - 0.19 / 0.59375, 0.6 + 0.19 / 1.90625]
    wide[0] = (1.5 - once.violation - 0.19) / 2.5  # beyond the other cut
    assert [b[0] for b in loose.bounds([[0, 1, 0]])] == pytest.approx(wide, abs=1e-9)


def test_a_tie_is_violated_by_what_exceeds_its_band() -> None:
    told = Answers([UP, DOWN, DOWN, DOWN], [0, 1, 1, 1])
    c = RelaxedPolytopeComparator(3, tie=0.0).update(told)
    g = 1 / 1.90625
    # the tie asks for g = 0.6 and gives way: |1.5 - 2.5 g| less its band
    assert c.violation == pytest.approx(1.5 - 2.5 * g - TIE_BAND * np.abs(UP).sum(), abs=2e-10)
    assert c.violated == ((0, "0"),)


def test_where_the_blame_can_be_put_either_way_all_are_named() -> None:
    """g_1 >= 0.6 and g_1 <= 0.4, equally steep: every g_1 between is a best fit, and violates
    both.
    """
    told = Answers([from_tails([0.4, -0.6]), from_tails([-0.6, 0.4])], [1, 1], ["a", "b"])
    c = RelaxedPolytopeComparator(3, tie=0.0).update(told)
    assert c.violation == pytest.approx(0.2, abs=1e-10)
    assert c.violated == ((0, "a"), (1, "b"))
    assert [b[0] for b in c.bounds([[0, 1, 0]])] == pytest.approx([0.4, 0.6], abs=1e-8)
    assert c.values[1] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.slow
def test_violated_names_whom_some_best_fit_violates() -> None:
    several = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        # few distinct numbers: best fits are often not unique
        d = np.array([from_tails(rng.integers(-3, 4, size=3).astype(float)) for _ in range(8)])
        told = Answers(d, rng.choice([-1, 1], 8))
        c, fit = RelaxedPolytopeComparator(4, tie=0.0).update(told), Fit(4, 1e-6, None, told)
        fit.within(fit.violation() + 1e-9)
        most = np.array([fit.most_violation(i) for i in range(8)])
        if ((most < 1e-4) & (most > 1e-7)).any():
            continue
        blamed = np.flatnonzero(most > 1e-6).tolist() if c.violation > 0 else []
        assert [row for row, _ in c.violated] == blamed
        several += (
            c.violation > 0
            and c.bounds(np.eye(4)[1:3])[1].sum() - c.bounds(np.eye(4)[1:3])[0].sum() > 1e-3
        )
    assert several >= 5


def test_an_answer_against_the_order() -> None:
    c = RelaxedPolytopeComparator(2, tie=0.0).update(Answers([[0.5, -0.5]], [1]))
    assert c.violation == pytest.approx(0.5, abs=1e-10)
    assert c.compare([[0.5, -0.5]]).tolist() == [WORSE]
    assert c.violated == ((0, "0"),)
    assert c.values.tolist() == [0.0, 1.0]


def test_what_the_order_alone_leaves_at_zero() -> None:
    """Least d.e is 0 over the prior, within rounding, but far from it over the best fits."""
    g = 1 / 1.90625  # where the answers say it is
    told = Answers([UP, DOWN, DOWN], [1, 1, 1])
    for corner in (0.3, 0.4, 0.45):
        c = RelaxedPolytopeComparator(3, prior=[f"e2 >= {corner}"], tie=0.0).update(told)
        d = np.array([-corner, 1.0, 0.0]) - np.array([0.0, 0.0, corner])
        assert [b[0] for b in c.bounds(d)] == pytest.approx([g - corner] * 2, abs=1e-8)
        fresh = RelaxedPolytopeComparator(3, prior=[f"e2 >= {corner}"], tie=0.0).update(told)
        assert fresh.compare([d, -d]).tolist() == [BETTER, WORSE]


@pytest.mark.parametrize(
    "prior", [["e3 >= 0.5", "e3 <= 0.5"], ["e2 >= 2*e3 - e4", "e2 <= 2*e3 - e4"]]
)
def test_a_prior_that_leaves_a_flat_set(prior: list[str]) -> None:
    _, told = noisy(3, 5, 30, 0.2)
    for slack in (0.0, 0.05):
        c = RelaxedPolytopeComparator(5, slack, prior=prior, tie=0.0).update(told)
        assert c.violation > 0
        assert c.prior is not None
        fit = Fit(5, 1e-6, (c.prior.a, c.prior.b), told)
        check_against(fit, c, shares(np.random.default_rng(0), 5, 6), 1.0)
        assert (c.prior.a @ c.values - c.prior.b >= -1e-12).all()
        assert fit.range(c.values)[0] > 0


def test_bounds_for_all_rows_at_once_state_a_confidence_only_while_the_answers_agree() -> None:
    _, answers = noisy(2, 5, 10, 0.0)
    d = shares(np.random.default_rng(2), 5, 20, 1.0)
    relaxed = RelaxedPolytopeComparator(5, slack=0.01, tie=0.0).update(answers)
    high, confidence = relaxed.simultaneous_bounds(d)
    assert confidence == 1
    assert (high >= PolytopeComparator(5, tie=0.0).update(answers).bounds(d)[1] - 1e-9).all()
    assert (high >= relaxed.bounds(d)[1] - 1e-8).all()
    assert high.max() == pytest.approx(relaxed.bounds(d)[1].max(), abs=1e-7)
    torn = relaxed.update(Answers(answers.d[:3], -answers.y[:3]))
    high, confidence = torn.simultaneous_bounds(d)
    assert np.isnan(confidence) == (torn.violation > 0)
    assert (high >= torn.bounds(d)[1] - 1e-8).all()
    scores = tail_sums(d) @ torn.draws.gaps
    assert (scores <= high[:, None] + 1e-7).all()


@on_any_processor
@pytest.mark.parametrize(("k", "slack"), [(2, 0.0), (3, 0.1), (5, 0.0), (5, 0.02)])
def test_it_keeps_the_contract_where_answers_contradict_each_other(k: int, slack: float) -> None:
    c = RelaxedPolytopeComparator(k, slack, margin=0.01, tie=0.0).update(
        noisy(1, k, 12, 0.4)[1] if k > 2 else Answers.none(2)
    )
    check_comparator(c)
    new = c.update(c.answers[:2])
    assert (new.slack, new.k, new.margin, new.prior) == (slack, k, 0.01, None)
    assert len(new.answers) == len(c.answers) + len(c.answers[:2])
    assert not c.values.flags.writeable


@pytest.mark.slow
def test_verdicts_depend_on_the_answers_only() -> None:
    """The order of the answers, earlier questions, and the other rows of a batch change none."""
    rng = np.random.default_rng(2)
    for seed, slack in ((1, 0.0), (2, 0.01), (3, 0.1)):
        _, told = noisy(seed, 7, 30, 0.2)
        ask = shares(rng, 7, 120)
        cold = RelaxedPolytopeComparator(7, slack, tie=0.0).update(told)
        expected = cold.compare(ask)
        warm = RelaxedPolytopeComparator(7, slack, tie=0.0)
        for i in range(30):
            warm.compare(ask[rng.integers(120, size=5)])
            warm = warm.update(told[i : i + 1])
        assert [warm.compare(d)[0] for d in ask] == expected.tolist()
        assert warm.violation == pytest.approx(cold.violation, abs=1e-10)
        assert np.abs(warm.values - cold.values).max() < 1e-6
        for power in (-40, 3, 40):
            assert (cold.compare(ask * 2.0**power) == expected).all()
            # answers in another unit, and the slack with them
            scaled = RelaxedPolytopeComparator(7, slack * 2.0**power, tie=0.0)
            scaled = scaled.update(Answers(told.d * 2.0**power, told.y, told.ids))
            assert (scaled.compare(ask) == expected).all()
            assert scaled.violation == cold.violation * 2.0**power
            assert scaled.violated == cold.violated


def test_what_is_retracted_was_never_told() -> None:
    _, told = noisy(5, 6, 40, 0.1)
    c = RelaxedPolytopeComparator(6, 0.0, tie=0.0).update(told)
    assert c.violation > 0
    names = [name for _, name in c.violated]
    without = c.retract(*names)
    assert len(without.answers) == 40 - len(names)
    assert without.violation < c.violation
    never = RelaxedPolytopeComparator(6, tie=0.0).update(told.without(names))
    ask = shares(np.random.default_rng(0), 6, 60)
    assert (without.compare(ask) == never.compare(ask)).all()
    with pytest.raises(ValueError, match="no answer here has the id 'nobody'"):
        c.retract("nobody")


@pytest.mark.slow
def test_extreme_answers_turned_round() -> None:
    """Differences are as large and as small as floats can be.

    Nothing overflows, and the verdicts do not depend on the unit.
    """
    seen = 0
    for i, case in enumerate(c for c in cases(35, 14 * 12, most_levels=8) if c.kind == "extreme"):
        for slack in (0.0, 0.1):
            c = RelaxedPolytopeComparator(case.k, slack, case.margin, tie=case.tie).update(
                flipped(case, i)
            )
            verdicts, (low, high) = c.compare(case.ask), c.bounds(case.ask)
            assert (
                low[verdicts == BETTER]
                >= -1e-9 * np.abs(case.ask[verdicts == BETTER]).max(initial=0.0)
            ).all()
            assert (low <= high).all()
            assert c.violation >= 0
            assert isinstance(c.violated, tuple)
            assert (np.diff(c.values) >= 0).all()
            seen += c.violation > 0
    assert seen >= 5


def test_errors() -> None:
    for slack in (-0.1, np.nan, np.inf, "a", None):
        with pytest.raises(
            ValueError, match=f"slack must be a finite number of at least 0.*not {slack!r}"
        ):
            RelaxedPolytopeComparator(4, slack, tie=0.0)
    with pytest.raises(ValueError, match="margin eta must lie between 0 and"):
        RelaxedPolytopeComparator(4, margin=0.5, tie=0.0)
    with pytest.raises(ValueError, match="no scale with margin"):
        RelaxedPolytopeComparator(4, prior=["e2 >= 0.9", "e3 <= 0.5"], tie=0.0)
    with pytest.raises(ValueError, match="about 3 levels"):
        RelaxedPolytopeComparator(4, tie=0.0).update(Answers.none(3))
    inconsistent = RelaxedPolytopeComparator(3, tie=0.0).update(Answers([UP, DOWN], [1, 1]))
    with pytest.raises(ValueError, match="both huge and tiny numbers"):
        inconsistent.update(Answers([[0, 1e300, 1e-300]], [1]))


@on_any_processor
def test_slack_brings_the_truth_back() -> None:
    """One wrong answer among 60: with no slack the truth is never plausible, and every 20th verdict
    wrong.
    """
    inside, wrong = Counter[float](), Counter[float]()
    runs = 10
    for seed in range(runs):
        e, told = noisy(seed, 5, 60, 0.0)
        rng = np.random.default_rng(seed)
        y = told.y.copy()
        row = int(rng.integers(60))
        y[row] *= -1
        ask = shares(rng, 5, 300, 1.0)
        for slack in (0.0, 0.01, 0.05, 0.2):
            c = RelaxedPolytopeComparator(5, slack, tie=0.0).update(Answers(told.d, y))
            within = abs(told.d[row] @ e) <= c.violation + slack
            inside[slack] += int(within)
            verdicts = c.compare(ask)
            mistakes = int(np.count_nonzero((verdicts != UNKNOWN) & (verdicts != np.sign(ask @ e))))
            assert not (within and mistakes)
            wrong[slack] += mistakes
    assert inside[0.0] == 0 < inside[0.01] < inside[0.05] < inside[0.2] == runs
    assert 0.1 * 300 * runs > wrong[0.0] > 2 * wrong[0.01] > 10 * wrong[0.05] >= wrong[0.2] == 0


@pytest.mark.slow
def test_it_is_fast_enough() -> None:
    """10,000 comparisons after 60 answers, some wrong: .2 to .9 s of computing time; an answer: 3
    ms.
    """
    k = 10
    _, told = noisy(2, k, 60, 0.05)
    ask = shares(np.random.default_rng(3), k, 10_000, 1.0)
    first = RelaxedPolytopeComparator(k, 0.05, tie=0.0).update(told[:50])
    first.compare(ask[:50])  # compiles, if need be
    started = time.process_time()
    c = first
    for i in range(50, 60):
        c = c.update(told[i : i + 1])
    updated = time.process_time()
    verdicts = c.compare(ask)
    compared = time.process_time()
    assert c.violation > 0
    assert 0.05 < np.mean(verdicts == UNKNOWN) < 0.6
    assert (updated - started) / 10 < 0.1
    assert compared - updated < 3.0
    assert 0 < c.solves < 3000
    assert (c.compare(ask) == verdicts).all()
    assert time.process_time() - compared < 1.0
    assert (tail_sums(ask) @ np.diff(c.values))[verdicts == BETTER].min() > 0
