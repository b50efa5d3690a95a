"""The polytope comparator's promises: verdicts that depend on the answers only, its centre,
contradictions, errors.
"""

import pickle
import time
import traceback
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space

from elicit import Answers, InconsistentAnswers, PolytopeComparator, Tier, Verdict, decide
from elicit.lp.region import TIE_BAND
from tests.lp_cases import (
    Case,
    Oracle,
    answered,
    cases,
    draw_truth,
    equalities,
    exact,
    few_bits,
    from_tails,
    is_empty,
    questions,
    region_of,
    shares,
    sign_of,
    tails,
    tie_with,
    verdict,
)
from tests.thoroughness import examples, on_any_processor, quick_first, scaled

BETTER, WORSE, EQUAL, UNKNOWN = Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL, Verdict.UNKNOWN
Floats = np.ndarray[Any, Any]


def setting(seed: int, k: int = 7, n: int = 40, asks: int = 60) -> Case:
    """Truthful answers of shares and a mixture of easy and nasty questions."""
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, k - 1)
    d = shares(rng, k, n)
    return Case(
        "setting", k, 1e-6, None, d, answered(rng, d, truth), questions(rng, d, truth, asks), truth
    )


def test_without_answers_it_knows_the_order_and_the_margin() -> None:
    c = PolytopeComparator(3, margin=0.125, tie=0.0)
    steps = np.array(
        [[-1, 1, 0], [0, 1, -1], [0, 0, 0], [-1, 2, -1], [-1, 7, -6], [-6, 7, -1]], dtype=float
    )
    assert c.compare(steps).tolist() == [BETTER, WORSE, EQUAL, UNKNOWN, UNKNOWN, UNKNOWN]
    # the gaps lie in [1/8, 7/8]: one step up against another down is decided from 7 to 1
    assert c.compare(from_tails([7.0, -1.0])).tolist() == [BETTER]
    assert c.compare(from_tails([7.0 - 2.0**-40, -1.0])).tolist() == [UNKNOWN]
    assert c.compare(from_tails([-7.0, 1.0])).tolist() == [WORSE]


def test_the_closed_form_is_right_to_the_last_bit() -> None:
    """Without answers least d.e is a closed form; here it is within a few last bits of 0."""
    rng = np.random.default_rng(4)
    for _ in range(scaled(60, 300)):
        k = int(rng.integers(3, 12))
        margin = float(rng.uniform(0, 1 / (k - 1)))
        t = np.sort(rng.random(k - 1))[::-1]
        # the worst gap's t at which least d.e vanishes
        t[-1] = -margin * t[:-1].sum() / (1 - (k - 2) * margin)
        t[-1] += int(rng.integers(-3, 4)) * np.spacing(abs(t[-1]))
        d = np.concatenate([[0.0], np.append(t[:-1] - t[1:], t[-1])])
        exactly = exact(tails(d))
        least = Fraction(margin) * sum(exactly) + (1 - (k - 1) * Fraction(margin)) * min(exactly)
        assert PolytopeComparator(k, margin=margin, tie=0.0).compare(d)[0] == (
            BETTER if least >= 0 else UNKNOWN
        )


def test_closed_gaps_make_no_difference() -> None:
    """Margin 0 and an answer against dominance: the gap is 0, and what differs by it only is
    equal.
    """
    c = PolytopeComparator(4, margin=0.0, tie=0.0).update(
        Answers([from_tails([0.0, 1.0, 0.0])], [-1])
    )
    asked = [
        from_tails(t)
        for t in ([0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -5.0, 0.0], [1.0, 0.0, -1.0])
    ]
    assert c.compare(asked).tolist() == [EQUAL, BETTER, BETTER, UNKNOWN]
    assert (
        decide(c, asked).tiers[:3].tolist() == [Tier.EXACT] * 3
    )  # dominance itself would say too much
    assert c.values[1] == pytest.approx(c.values[2])


@examples(12)
@given(st.integers(0, 2**32), st.integers(3, 9), st.integers(0, 40))
def test_verdicts_depend_on_nothing_else(seed: int, k: int, n: int) -> None:
    case = setting(seed, k, n, asks=40)
    rng = np.random.default_rng(seed)
    expected = case.known().compare(case.ask)

    order = rng.permutation(len(case.ask))
    permuted = case.known().compare(case.ask[order])
    assert (permuted == expected[order]).all()

    single = case.known()
    assert [single.compare(d)[0] for d in case.ask] == expected.tolist()
    for i in rng.integers(len(case.ask), size=5):
        assert case.known().compare(case.ask[i])[0] == expected[i]  # cold

    warm = case.known()
    warm.compare(questions(rng, case.d, case.truth, 200))
    _, _ = warm.values, warm.bounds(case.ask[:5])
    assert (warm.compare(case.ask) == expected).all()

    one_by_one = PolytopeComparator(k, tie=0.0)
    for i in rng.permutation(n):
        one_by_one.compare(
            case.ask[: rng.integers(10)]
        )  # proofs found on the way are carried along
        one_by_one = one_by_one.update(Answers(case.d[i : i + 1], case.y[i : i + 1]))
    assert (one_by_one.compare(case.ask) == expected).all()
    assert (one_by_one.values == case.known().values).all()

    twice = case.known().update(Answers(case.d, case.y)).update(Answers(-4 * case.d, -case.y))
    assert (twice.compare(case.ask) == expected).all()
    assert (twice.values == case.known().values).all()


@pytest.mark.parametrize("seed", quick_first(range(4), 2, older=2))
def test_decided_stays_decided(seed: int) -> None:
    case = setting(seed, k=6, n=30, asks=150)
    c = PolytopeComparator(6, tie=0.0)
    before = c.compare(case.ask)
    for i in range(30):
        c = c.update(Answers(case.d[i : i + 1], case.y[i : i + 1]))
        after = c.compare(case.ask)
        kept = (before == UNKNOWN) | (after == before) | ((np.abs(before) == 1) & (after == EQUAL))
        assert kept.all()
        before = after
    truth = np.array([sign_of(d, case.truth) for d in case.ask])
    assert ((before == UNKNOWN) | (before == truth) | (truth == 0)).all()


@on_any_processor
@pytest.mark.parametrize("seed", quick_first(range(3), 1))
def test_the_other_way_round_and_at_other_scales(seed: int) -> None:
    for case in cases([41, seed], scaled(14, 28), asks=4, most_answers=scaled(40, 60)):
        c = case.known()
        ask = case.ask[np.abs(case.ask).max(axis=1) < 1e250]
        flipped = np.where(c.compare(ask) == UNKNOWN, UNKNOWN, -c.compare(ask))
        assert (c.compare(-ask) == flipped).all()
        normal = ask[((np.abs(ask) > 1e-200) | (ask == 0)).all(axis=1)]
        for power in (-60, -1, 3, 70):
            assert (c.compare(np.ldexp(normal, power)) == c.compare(normal)).all()


def test_level_1_of_an_answer_never_enters() -> None:
    case = setting(9)
    other = case.d.copy()
    other[:, 0] = 1e300
    c = PolytopeComparator(case.k, tie=case.tie).update(Answers(other, case.y))
    assert (c.compare(case.ask) == case.known().compare(case.ask)).all()


def test_nothing_new_changes_nothing() -> None:
    case = setting(6)
    c = case.known()
    same = c.update(Answers.none(case.k)).update(Answers(np.zeros((2, case.k)), [1, 0]))
    assert (same.compare(case.ask) == c.compare(case.ask)).all()
    assert (same.values == c.values).all()


def slacks(c: PolytopeComparator, g: Floats) -> tuple[Floats, Floats]:
    both = np.unique(np.column_stack(c.region.constraints), axis=0)  # each constraint once
    return both[:, :-1], both[:, :-1] @ g - both[:, -1]


def decrement(rows: Floats, slack: Floats, flat: Floats) -> float:
    """Return the length of a Newton step along the flat, in the barrier's own norm."""
    along = null_space(np.concatenate([np.ones((1, rows.shape[1])), rows[flat]]), rcond=1e-9)
    scaled = (rows[~flat] / slack[~flat, None]) @ along
    if not scaled.size:
        return 0.0
    step = np.linalg.lstsq(scaled, np.ones(len(scaled)))[0]
    return float(np.linalg.norm(scaled @ step))


@on_any_processor
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))]
)
def test_the_centre_is_the_barriers_optimum(seed: int) -> None:
    checked = 0
    for case in cases([51, seed], scaled(21, 42), asks=1, most_answers=scaled(100, 150)):
        c = case.known()
        values = c.values
        g = np.diff(values)
        rows, slack = slacks(c, g)
        size = np.abs(rows).max(axis=1)
        assert values.shape == (case.k,)
        assert values[0] == 0.0
        assert values[-1] == pytest.approx(1.0, abs=1e-12)
        assert (slack > -2e-12 * np.maximum(size, 1e-12)).all(), case.kind
        if case.kind not in (
            "thin",
            "tied",
            "parallel",
        ):  # where a slack of 1e-9 is all there is, or none at all
            assert decrement(rows, slack, slack < 1e-10) < 1e-5, case.kind
            checked += 1
    assert checked > scaled(10, 20)


def test_the_centre_lies_strictly_inside() -> None:
    for k, n in ((3, 5), (6, 40), (12, 150), (25, 300)):
        case = setting(k, k=k, n=n, asks=0)
        c = PolytopeComparator(k, margin=float(min(case.truth)) / 2, tie=case.tie).update(
            Answers(case.d, case.y)
        )
        g = exact(np.diff(c.values))
        g = [x / sum(g) for x in g]
        region = region_of(k, c.margin, None, case.d, list(case.y))
        assert region.contains(g)
        assert min(g) > region.margin
        assert (c.compare(case.d) != UNKNOWN).all()


def test_equal_gaps_before_any_answer() -> None:
    for k in (2, 3, 10, 25):
        assert PolytopeComparator(k, tie=0.0).values == pytest.approx(
            np.linspace(0, 1, k), abs=1e-9
        )
        assert PolytopeComparator(k, margin=1 / (k - 1), tie=0.0).values == pytest.approx(
            np.linspace(0, 1, k), abs=1e-12
        )


def test_known_centres() -> None:
    # g_1 = g_2: the product g_1 g_2 g_3 is greatest at a third each; with d told three ways
    d = from_tails([1.0, -1.0, 0.0])
    for prior, told, y in (
        (equalities([d]), [], []),
        (None, [d], [0]),
        (equalities([d]), [d], [0]),
    ):
        c = PolytopeComparator(4, margin=0.0, tie=0.0, prior=prior)
        c = c.update(Answers(np.reshape(told, (-1, 4)), np.array(y, dtype=int)))
        assert c.values == pytest.approx([0, 1 / 3, 2 / 3, 1], abs=1e-7)
    # g_1 >= g_2: maximise g_1 g_2 (g_1 - g_2) with g_1 + g_2 = 1, hence 6 g_1^2 - 6 g_1 + 1 = 0
    c = PolytopeComparator(3, margin=0.0, tie=0.0).update(Answers([from_tails([1.0, -1.0])], [1]))
    assert c.values[1] == pytest.approx(0.5 + 1 / np.sqrt(12), abs=1e-9)
    # one point: the ratios 1 : 2 : 5 are told exactly
    pairs = [from_tails([2.0, -1.0, 0.0]), from_tails([5.0, 0.0, -1.0])]
    c = PolytopeComparator(4, tie=0.0, prior=equalities(pairs))
    assert c.values == pytest.approx([0, 1 / 8, 3 / 8, 1], abs=1e-9)
    assert c.compare(from_tails([2.0, 0.0, -0.375])).tolist() == [BETTER]
    assert c.compare(from_tails([2.0, 0.0, -0.5])).tolist() == [WORSE]
    assert c.compare(from_tails([3.0, 1.0, -1.0])).tolist() == [EQUAL]


def test_ties_that_only_the_edge_of_the_band_satisfies() -> None:
    """Two answers "equal" that would contradict each other without a tie leave a thin set.

    The values lie in it.
    """
    a, b = from_tails([1.0, -1.0, 0.0]), from_tails([1.0 + 2.0**-28, -1.0, 0.0])
    c = PolytopeComparator(4, margin=0.3, tie=0.0).update(Answers([a, b], [0, 0]))
    _, slack = slacks(c, np.diff(c.values))
    assert slack.min() > -1e-12


def test_bounds_are_as_wide_wherever_an_equal_stands_among_the_answers() -> None:
    d = np.array([from_tails([1.0, -1.0]), from_tails([1.0, -0.5])])
    equal, better = Answers(d[:1], [0], ["a"]), Answers(d[1:], [1], ["b"])
    fresh, rows = PolytopeComparator(3, tie=0.05), np.array([from_tails([1.0, -0.875])])
    one, other = fresh.update(equal).update(better), fresh.update(better).update(equal)
    bounds = [found.simultaneous_bounds(rows)[0] for found in (one, other)]
    assert bounds[0] == pytest.approx(bounds[1], abs=1e-9)
    narrow = PolytopeComparator(3, tie=0.01).update(equal).simultaneous_bounds(rows)[0]
    assert (bounds[0] > narrow + 0.01).all()


def test_values_do_not_depend_on_the_order_of_the_answers() -> None:
    rng = np.random.default_rng(0)
    for case in cases(53, scaled(14, 140), asks=1, most_answers=60, most_levels=15):
        if case.kind not in ("plain", "touching", "equal gaps", "extreme"):
            order = rng.permutation(len(case.y))
            shuffled = PolytopeComparator(
                case.k, margin=case.margin, prior=case.prior, tie=case.tie
            )
            for part in np.array_split(order, 3):
                shuffled = shuffled.update(Answers(case.d[part], case.y[part]))
            assert (shuffled.values == case.known().values).all(), case.kind


def check_conflict(
    error: InconsistentAnswers, k: int, margin: float, prior: Any, d: Floats, y: Any
) -> None:
    """Empty, not empty without any one of them, and the margin is blamed rightly: all exactly, by
    another method.
    """
    rows = [row for row, _ in error.answers]
    assert rows == sorted(set(rows))
    assert is_empty(region_of(k, margin, prior, d, y, rows))
    for row in rows:
        assert not is_empty(region_of(k, margin, prior, d, y, [r for r in rows if r != row])), rows
    assert error.margin == (margin > 0 and not is_empty(region_of(k, 0.0, prior, d, y, rows)))
    for row, name in error.answers:
        assert f"row {row} (id {name})" in str(error)


@pytest.mark.parametrize("seed", quick_first(range(5), 3, older=1))
def test_an_erring_tutor_is_caught_with_a_minimal_set(seed: int) -> None:
    rng = np.random.default_rng([61, seed])
    found = 0
    for _ in range(12):
        k, n = int(rng.integers(3, 9)), int(rng.integers(5, 80))
        truth, d = draw_truth(rng, k - 1), shares(rng, k, n)
        y = np.where(rng.random(n) < 0.1, -1, 1) * answered(rng, d, truth)
        ids = [f"q{i}" for i in range(n)]
        margin = float(rng.choice([0.0, 1e-6, 1e-3]))
        c, told, batch = (
            PolytopeComparator(k, margin=margin, tie=0.0),
            0,
            int(rng.choice([1, 7, n])),
        )
        while told < n:
            part = slice(told, told + batch)
            ask = shares(rng, k, 5)
            before = c.compare(ask)
            if not is_empty(region_of(k, margin, None, d[: told + batch], list(y[: told + batch]))):
                c = c.update(Answers(d[part], y[part], ids[part]))
                told += batch
                continue
            found += 1
            with pytest.raises(InconsistentAnswers) as caught:
                c.update(Answers(d[part], y[part], ids[part]))
            check_conflict(
                caught.value, k, margin, None, d[: told + batch], list(y[: told + batch])
            )
            assert all(name == ids[row] for row, name in caught.value.answers)
            assert len(c.answers) == told  # and nothing has changed
            assert (c.compare(ask) == before).all()
            break
    assert found >= 3


def test_truthful_answers_and_a_margin_above_the_least_gap() -> None:
    rng = np.random.default_rng(7)
    truth = [Fraction(1, 100), Fraction(49, 100), Fraction(50, 100)]
    d = shares(rng, 4, 400)
    y = answered(rng, d, truth)
    assert len(PolytopeComparator(4, margin=0.009, tie=0.0).update(Answers(d, y)).answers) == 400
    with pytest.raises(InconsistentAnswers, match=r"margin 0\.1 is above the least gap") as caught:
        PolytopeComparator(4, margin=0.1, tie=0.0).update(Answers(d, y))
    assert caught.value.margin is True
    check_conflict(caught.value, 4, 0.1, None, d, list(y))


def test_a_real_contradiction_does_not_blame_the_margin() -> None:
    d = np.array([from_tails(t) for t in ([1.0, -2.0], [-2.0, 1.0], [1.0, 1.0])])
    with pytest.raises(InconsistentAnswers) as caught:
        PolytopeComparator(3, margin=0.01, tie=0.0).update(Answers(d, [1, 1, 1], ["a", "b", "c"]))
    copied = pickle.loads(pickle.dumps(caught.value))  # as from a worker process
    for error in (caught.value, copied):
        assert error.answers == ((0, "a"), (1, "b"))
        assert error.margin is False
        assert "margin" not in str(error)


@pytest.mark.parametrize(
    ("t", "y", "margin", "blamed"),
    [
        ([1.0, 1.0, 1.0], -1, 0.01, False),  # the best is worse than the worst: no margin helps
        ([1.0, 1.0, 1.0], 0, 0.01, False),
        ([0.0, 1.0, 0.0], -1, 0.01, True),  # two levels worth the same
        ([0.0, 1.0, 0.0], 0, 0.01, True),
        ([0.0, -1.0, 0.0], 1, 1e-300, True),
        ([1.0, 1.0, 1.0], -1, 0.0, False),
    ],
)
def test_one_answer_against_dominance(t: list[float], y: int, margin: float, blamed: bool) -> None:
    c = PolytopeComparator(4, margin=margin, tie=0.0).update(
        Answers([from_tails([1.0, -1.0, 0.0])], [1])
    )
    with pytest.raises(InconsistentAnswers) as caught:
        c.update(Answers([from_tails(t)], [y], ["odd"]))
    assert caught.value.answers == ((1, "odd"),)
    assert caught.value.margin is blamed


def test_equal_levels_within_the_band_are_no_contradiction() -> None:
    step = from_tails([0.0, 1.0, 0.0])
    assert PolytopeComparator(4, margin=1e-10, tie=0.0).update(Answers([step], [0])).compare(
        step
    ).tolist() == [BETTER]
    with pytest.raises(InconsistentAnswers):
        PolytopeComparator(4, margin=1e-6, tie=0.0).update(Answers([step], [0]))
    assert PolytopeComparator(4, margin=0.0, tie=0.0).update(Answers([step], [-1])).compare(
        step
    ).tolist() == [EQUAL]


def test_the_prior_is_never_named() -> None:
    prior = (np.array([[0.0, 1.0, 0.0]]), np.array([0.5]))  # level 2 is worth at least a half
    c = PolytopeComparator(3, margin=0.01, prior=prior, tie=0.0)
    d = from_tails([-1.0, 2.0])
    ok = c.update(Answers([d], [1]))
    with pytest.raises(InconsistentAnswers) as caught:
        ok.update(Answers([from_tails([-1.0, 0.5])], [1], ["too much"]))
    assert caught.value.answers == ((1, "too much"),)
    check_conflict(caught.value, 3, 0.01, prior, np.array([d, from_tails([-1.0, 0.5])]), [1, 1])


def test_contradictions_by_the_last_bit() -> None:
    """The truth lies exactly on a cut: moving a later cut by one unit in the last place decides
    consistency.
    """
    d = from_tails([3.0, -1.0])  # g = (1/4, 3/4)
    c = PolytopeComparator(3, tie=0.0, prior=equalities([d]))
    touching, beyond = from_tails([-6.0, 2.0]), np.array([4.0, -8.0, 2.0 - 2.0**-52])
    assert c.update(Answers([touching], [1])).compare(touching).tolist() == [EQUAL]
    beyond = np.array([0.0, -6.0 - 2.0 + 2.0**-52, 2.0 - 2.0**-52])
    assert tails(beyond) == [-6.0, 2.0 - 2.0**-52]
    with pytest.raises(InconsistentAnswers):
        c.update(Answers([beyond], [1]))


@pytest.mark.parametrize(
    ("k", "margin"),
    [(3, 0.51), (3, 0.5000000000000001), (11, 0.2), (4, -1e-9), (4, np.nan), (4, "a")],
)
def test_a_margin_that_does_not_fit(k: int, margin: float) -> None:
    with pytest.raises(ValueError, match=r"margin eta must lie between 0 and 1/\(k-1\)") as caught:
        PolytopeComparator(k, margin=margin, tie=0.0)
    assert repr(margin) in str(caught.value)


def test_the_greatest_margin() -> None:
    for k in range(2, 26):
        c = PolytopeComparator(k, margin=1.0 / (k - 1), tie=0.0)
        d = shares(np.random.default_rng(k), k, 20)
        truth = [Fraction(1, k - 1)] * (k - 1)
        assert c.compare(d).tolist() == [sign_of(row, truth) for row in d]
        with pytest.raises(ValueError, match="margin eta"):
            PolytopeComparator(k, margin=float(np.nextafter(1.0 / (k - 1), 2)), tie=0.0)
        PolytopeComparator(k, margin=float(np.nextafter(1.0 / (k - 1), 0)), tie=0.0).compare(d)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (
            ([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], [0.6, -0.5]),
            "no scale with margin 1e-06 .* satisfies the prior's",
        ),
        (([[0.0, 0.0, 0.0]], [1e-9]), "no scale"),
        (([[0.0, 1.0, 0.0]], [1e300]), "no scale"),
        (([[0.0, 1.0]], [0.0]), r"the prior's A must have shape \(n, 3\)"),
        (([[0.0, np.nan, 0.0]], [0.0]), "the prior's A must be finite"),
        (([[0.0, 1.0, 0.0]], [0.0, 1.0]), "the prior's b must be one finite number"),
        (([[0.0, 1.0, 0.0]], [np.inf]), "the prior's b must be one finite number"),
        (([[0.0, 1e-300, 1e300]], [0.0]), "both huge and tiny"),
    ],
)
def test_a_prior_that_cannot_be(prior: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PolytopeComparator(3, prior=prior, tie=0.0)


@pytest.mark.parametrize(
    ("d", "message"),
    [
        ([[1.0, np.nan, 0.0]], "row 0, level 2 is nan"),
        ([[0.0, 0.0, 0.0], [1.0, 0.0, -np.inf]], "row 1, level 3 is -inf"),
        ([[1.0, 2.0]], r"shape \(n, 3\)"),
        ([[[1.0, 2.0, 3.0]]], r"not \(1, 1, 3\)"),
        (["a", "b", "c"], "must be numbers"),
    ],
)
def test_differences_that_are_none(d: Any, message: str) -> None:
    c = PolytopeComparator(3, tie=0.0)
    for ask in (c.compare, c.bounds, partial(decide, c)):
        with pytest.raises(ValueError, match=message):
            ask(d)


def test_ties_keep_their_width_at_any_size() -> None:
    d = from_tails([1.0, -2.0, 0.25])
    for power in (995, 0, -1000):
        c = PolytopeComparator(4, tie=0.0).update(Answers([np.ldexp(d, power)], [0]))
        band = TIE_BAND * np.abs(d).sum()
        assert band <= c.bounds(d)[1][0] <= 2.001 * band
        assert c.compare(from_tails([1.0 + 2.0**-26, -2.0, 0.25])).tolist() == [UNKNOWN]
        assert c.compare(from_tails([1.0 + 2.0**-20, -2.0, 0.25 + 2.0**-20])).tolist() == [BETTER]


def test_huge_and_tiny_in_one_difference() -> None:
    d = np.array([0.0, 0.0, -1e-300, 1e300])
    c = PolytopeComparator(4, tie=0.0)
    assert c.compare([d, -d]).tolist() == [BETTER, WORSE]
    odd = [0.0, 1e280, -1e-300, 0.0]
    assert tails(odd) == [1e280, -1e-300, 0.0]
    assert c.compare(odd).tolist() == [BETTER]
    assert PolytopeComparator(4, margin=0.0, tie=0.0).compare(odd).tolist() == [UNKNOWN]
    pinned = PolytopeComparator(4, margin=0.0, tie=0.0).update(
        Answers([from_tails([1.0, 0.0, 0.0])], [-1])
    )
    assert pinned.compare(odd).tolist() == [WORSE]
    with pytest.raises(ValueError, match="row 0 of the answers holds both huge and tiny numbers"):
        c.update(Answers([odd], [1]))


@on_any_processor
@pytest.mark.parametrize(
    ("k", "flat"), [(10, 0), pytest.param(25, 0, marks=pytest.mark.slow), (12, 4)]
)
def test_five_hundred_answers(k: int, flat: int) -> None:
    """Nothing lies strictly inside if there are ties: every doubtful sign is decided exactly."""
    rng = np.random.default_rng(13)
    truth, _ = few_bits(rng, k - 1, 30)
    ties = np.array([tie_with(rng, truth) for _ in range(flat)]).reshape(-1, k)
    prior = equalities(ties) if flat else None
    d = shares(rng, k, 500)
    y = answered(rng, d, truth)
    ask = np.concatenate([questions(rng, d, truth, scaled(5, 12)), shares(rng, k, scaled(2, 4))])
    begin = time.perf_counter()
    c = PolytopeComparator(k, tie=0.0, prior=prior).update(Answers(d, y))
    given, _ = c.compare(ask), (c.values, c.bounds(ask[:5]))
    assert time.perf_counter() - begin < 30.0
    oracle = Oracle(region_of(k, 1e-6, prior, d, list(y)))
    for row, got in zip(ask, given, strict=True):
        assert got == verdict(*oracle.range(exact(tails(row))))


@pytest.mark.parametrize("scale", [1.0, -1.0, 1.0 + 1e-13, 16.0, -2.0])
def test_opposite_answers_to_one_pair_are_a_contradiction_and_no_tie(scale: float) -> None:
    d, other = from_tails([1.0, -2.0, 0.5]), from_tails([-1.0, 1.0, 1.0])
    answers = Answers(
        [other, d, scale * d], [1, 1, -1 if scale > 0 else 1], ["other", "first", "last"]
    )
    known = PolytopeComparator(4).update(answers[:2])
    for update in (
        lambda: known.update(answers[2:]),
        lambda: PolytopeComparator(4).update(answers),
    ):
        with pytest.raises(
            InconsistentAnswers, match="That does not make it equal: one of them is wrong"
        ) as caught:
            update()
        assert caught.value.answers == ((1, "first"), (2, "last"))
        assert caught.value.margin is False
    assert known.compare(d).tolist() == [BETTER]  # nothing has changed
    assert known.update(answers[1:2]).compare(d).tolist() == [
        BETTER
    ]  # the same answer again is welcome
    assert known.update(Answers(d, [0])).compare(d).tolist() == [
        BETTER
    ]  # "equal" only means that it is close


@pytest.mark.parametrize("apart", [5e-10, -5e-10, 2e-8])
def test_answers_are_opposite_if_their_pairs_are_as_near_as_one_pair_is_to_itself(
    apart: float,
) -> None:
    t = np.array([0.75, -0.5, 0.25])
    answers = Answers([from_tails(t), from_tails(t - apart)], [1, -1])
    if apart > 1e-9:  # scales that fit both are few, but they are
        known = PolytopeComparator(4).update(answers)
        assert known.compare(from_tails(t)).tolist() == [BETTER]
        return
    with pytest.raises(InconsistentAnswers, match="one of them is wrong"):
        PolytopeComparator(4).update(answers)
    with pytest.raises(InconsistentAnswers, match="one of them is wrong"):
        PolytopeComparator(4).update(answers[:1]).update(answers[1:])


def test_a_contradiction_goes_by_its_documented_name() -> None:
    d = np.array([from_tails(t) for t in ([1.0, -2.0], [-2.0, 1.0])])
    with pytest.raises(InconsistentAnswers) as caught:
        PolytopeComparator(3, tie=0.0).update(Answers(d, [1, 1], ["a", "b"]))
    assert type(caught.value) is InconsistentAnswers
    assert repr(caught.value).startswith(
        "InconsistentAnswers('no scale satisfies these answers together: row 0 (id a)"
    )
    assert "InconsistentAnswers: no scale satisfies" in "".join(
        traceback.format_exception(caught.value)
    )
