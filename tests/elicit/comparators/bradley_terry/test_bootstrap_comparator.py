"""The Bradley-Terry comparator: what it may decide, on what, and what it must not depend on."""

import math
import re
import warnings
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from elicit import Answers, BradleyTerryComparator, Comparator, NotConverged, Verdict
from elicit._support.hashing import key_of
from elicit.comparators.bradley_terry.bootstrap_comparator import next_refit, refit_point
from elicit.comparators.bradley_terry.likelihood import (
    bootstrap_weights,
    fit,
    prior_centres,
    sigmoid,
)
from elicit.model.scale import order_bounds
from elicit.testing import check_comparator
from tests.noisy_cases import pairs
from tests.scale_arithmetic import Floats, tail_sums
from tests.thoroughness import on_any_processor, quick_first

REGIONS = ["ensemble", "box"]


def told(
    seed: int, k: int, n: int, *, sd: float = 2.0, alpha: float = 1.0
) -> tuple[Answers, Floats, float, Floats]:
    """n answers of a noisy tutor, fresh pairs (500, k), the precision, and the hidden scale
    (k,).
    """
    rng = np.random.default_rng(seed)
    e = np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.full(k - 1, alpha)))])
    d, fresh = pairs(rng, k, n), pairs(rng, k, 500)
    precision = sd / float(np.std(fresh @ e))
    y = np.where(rng.random(n) < sigmoid(precision * (d @ e)), 1, -1)
    return Answers(d, y), fresh, precision, e


@cache
def taught(k: int = 5, n: int = 40, **kwargs: Any) -> BradleyTerryComparator:
    answers, _, precision, _ = told(0, k, n)
    return BradleyTerryComparator(k, precision=precision, n_boot=30, **kwargs).update(answers)


def same(a: BradleyTerryComparator, b: BradleyTerryComparator, d: Floats) -> bool:
    (lo, hi), (lo2, hi2) = a.bounds(d), b.bounds(d)
    return bool(
        (a.values == b.values).all()
        and (lo == lo2).all()
        and (hi == hi2).all()
        and (a.compare(d) == b.compare(d)).all()
    )


# What it says with little to go on


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("n", [0, 1])
def test_nothing_beyond_dominance_without_answers_or_after_one(region: str, n: int) -> None:
    answers, fresh, precision, _ = told(1, 6, 1)
    a = BradleyTerryComparator(6, precision=precision, region=region).update(answers[:n])
    assert isinstance(a, Comparator)
    assert (a.compare(fresh) == Verdict.UNKNOWN).all()
    assert (a.compare(answers.d) == Verdict.UNKNOWN).all()
    assert a.values == pytest.approx(np.linspace(0, 1, 6))
    assert all(
        (x == y).all()
        for x, y in zip(a.bounds(fresh), order_bounds(tail_sums(fresh), 0.0), strict=True)
    )
    low, high, point = a.probability(fresh)
    assert (low == 0).all()
    assert (high == 1).all()
    assert ((point > 0) & (point < 1)).all()


@pytest.mark.parametrize("region", REGIONS)
def test_many_equal_answers_about_one_pair_leave_the_rest_open(region: str) -> None:
    """No false certainty: every resample is the same, so spread can only come from the prior."""
    d = np.array([0.3, -0.5, 0.2, 0.0, 0.0, 0.0])
    a = BradleyTerryComparator(6, precision=20.0, region=region).update(
        Answers(np.tile(d, (200, 1)), np.ones(200, int))
    )
    untouched = np.array(
        [[0.0, 0.0, 0.0, 0.5, -1.0, 0.5], [0.0, 0.0, 0.3, -0.6, 0.0, 0.3], [0, 0, 0.5, -1, 0.5, 0]]
    )
    assert (a.compare(untouched) == Verdict.UNKNOWN).all()
    lo, hi = a.bounds(untouched)
    assert (lo < -0.01).all()
    assert (hi > 0.01).all()
    if region == "ensemble":
        assert a.compare(d).tolist() == [Verdict.BETTER]


def test_answers_of_no_size_teach_nothing() -> None:
    answers, fresh, precision, _ = told(2, 5, 40)
    tiny = Answers(answers.d * 1e-12, answers.y)
    a = BradleyTerryComparator(
        5, precision=precision, prior_shape=(1.0, 1.0), region="ensemble"
    ).update(tiny)
    prior = BradleyTerryComparator(
        5, precision=1e-12, prior_shape=(1.0, 1.0), region="ensemble"
    ).update(answers)
    assert a.converged
    assert np.allclose(a.values, np.linspace(0, 1, 5), atol=1e-6)
    assert np.allclose(a.bounds(fresh), prior.bounds(fresh), atol=1e-6)
    assert (a.compare(fresh) == Verdict.UNKNOWN).mean() > 0.5


def test_precision_zero_learns_nothing() -> None:
    answers, fresh, _, _ = told(3, 5, 60)
    a = BradleyTerryComparator(5, precision=0, region="ensemble").update(answers)
    assert (a.compare(fresh) == Verdict.UNKNOWN).all()
    assert a.converged
    assert a.values == pytest.approx(np.linspace(0, 1, 5))
    assert (a.probability(fresh)[2] == 0.5).all()


# What it says of answers that fit no scale, or too many


@pytest.mark.parametrize("region", REGIONS)
def test_separable_answers_without_a_prior_are_no_fit(region: str) -> None:
    answers, fresh, precision, e = told(4, 5, 30)
    truthful = Answers(answers.d, np.sign(answers.d @ e).astype(int))
    a = BradleyTerryComparator(5, precision=precision, prior_strength=0, region=region).update(
        truthful
    )
    with pytest.warns(
        NotConverged, match="no maximum found for 100 of 100 resamples of 29 answers, nor"
    ):
        assert not a.converged
    assert (a.compare(fresh) == Verdict.UNKNOWN).all()
    assert a.values == pytest.approx(np.linspace(0, 1, 5))
    b = BradleyTerryComparator(5, precision=precision, region=region).update(truthful)
    assert b.converged


def test_without_a_prior_many_noisy_answers_still_decide() -> None:
    answers, fresh, precision, e = told(5, 4, 400)
    a = BradleyTerryComparator(
        4, precision=precision, prior_strength=0, n_boot=50, region="ensemble"
    ).update(answers)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotConverged)  # a resample or two may still be separable
        verdicts = a.compare(fresh)
    decided = verdicts != Verdict.UNKNOWN
    assert decided.mean() > 0.5
    assert (verdicts == np.sign(fresh @ e))[decided].mean() > 0.97


@pytest.mark.parametrize("region", REGIONS)
def test_without_dominance_the_fits_decide_alone(region: str) -> None:
    answers, fresh, precision, _ = told(0, 5, 200)
    made = partial(BradleyTerryComparator, 5, precision=precision, region=region, n_boot=30)
    dominated = np.array([[-0.5, 0.5, 0, 0, 0], [0, 0, 0, -0.1, 0.1], [0, 0, 0, 0, 0]])
    blank = made(dominance=False)
    assert blank.compare(dominated).tolist() == [Verdict.UNKNOWN, Verdict.UNKNOWN, Verdict.EQUAL]
    assert np.array(blank.bounds(dominated)).tolist() == [
        [-np.inf, -np.inf, 0],
        [np.inf, np.inf, 0],
    ]
    assert np.array(blank.probability(dominated)[:2]).tolist() == [[0, 0, 0.5], [1, 1, 0.5]]
    first, alone = made().update(answers), blank.update(answers)
    opened = order_bounds(tail_sums(fresh), 0.0)[0] < 0
    opened &= order_bounds(tail_sums(fresh), 0.0)[1] > 0
    assert (alone.compare(fresh[opened]) == first.compare(fresh[opened])).all()
    # a tutor who answers against the order is believed
    against = Answers(np.tile(dominated[0], (60, 1)), -np.ones(60, int))
    turned = made(dominance=False, monotone=False, prior_strength=0.01).update(answers + against)
    verdicts, (low, high) = turned.compare(fresh), turned.bounds(fresh)
    assert ((verdicts == Verdict.BETTER) == (low > 0)).all()
    assert ((verdicts == Verdict.WORSE) == (high < 0)).all()
    assert turned.compare(dominated[0]).tolist() == [Verdict.WORSE]


@pytest.mark.parametrize("region", REGIONS)
def test_without_dominance_it_keeps_the_rest_of_the_contract(region: str) -> None:
    check_comparator(BradleyTerryComparator(4, dominance=False, region=region, n_boot=20))


@pytest.mark.parametrize("name", ["dominance", "monotone", "rescale"])
def test_a_yes_or_no_is_true_or_false(name: str) -> None:
    for wrong in ("no", 0, None):
        with pytest.raises(ValueError, match=f"{name} must be True or False, not {wrong!r}"):
            BradleyTerryComparator(4, **{name: wrong})


def test_a_fit_without_a_maximum_can_be_taken_where_it_stopped() -> None:
    answers, fresh, precision, _ = told(4, 5, 1)
    literal: dict[str, Any] = {
        "precision": precision,
        "prior_strength": 0,
        "min_answers": 1,
        "region": "box",
    }
    with pytest.warns(NotConverged):
        asks = BradleyTerryComparator(5, **literal).update(answers).compare(fresh)
    with pytest.warns(NotConverged):
        takes = (
            BradleyTerryComparator(5, no_maximum="take", **literal).update(answers).compare(fresh)
        )
    assert (asks == Verdict.UNKNOWN).all()
    assert (
        takes != Verdict.UNKNOWN
    ).mean() > 0.9  # all resamples of one answer are the same: the box has no width


@pytest.mark.parametrize("region", REGIONS)
def test_a_pair_answered_both_ways_a_thousand_times_stays_open(region: str) -> None:
    d = np.array([0.0, 0.5, -1.0, 0.5])
    answers = Answers(np.tile(d, (2000, 1)), np.tile([1, -1], 1000))
    a = BradleyTerryComparator(4, precision=15.0, region=region).update(answers)
    assert a.compare(d).tolist() == [Verdict.UNKNOWN]
    lo, hi = a.bounds(d)
    assert lo[0] < 0 < hi[0]
    assert a.probability(d)[2][0] == pytest.approx(0.5, abs=0.05)


def test_a_tie_means_what_the_tutor_may_call_equal_and_nothing_where_she_does_not() -> None:
    answers, fresh, precision, e = told(6, 5, 200)
    sharp, wide = (
        BradleyTerryComparator(5, precision=precision, tie=tie, region="ensemble")
        for tie in (0.0, 0.02)
    )
    assert (BradleyTerryComparator(5).tie, BradleyTerryComparator(5).region) == (0.01, "box")
    assert same(sharp.update(answers), wide.update(answers), fresh)
    y = np.where(np.abs(answers.d @ e) < 0.02, 0, answers.y)
    assert 5 < (y == 0).sum() < 50
    told_equal = Answers(answers.d, y)
    a, b = sharp.update(told_equal), wide.update(told_equal)
    assert not same(a, b, fresh)
    fitted = fit(
        tail_sums(answers.d), y, precision=precision, centre=np.full((1, 4), 0.25),
        strength=0.3 * 16, tie=0.02
    ).gamma[0]  # fmt: skip
    late = BradleyTerryComparator(
        5, precision=precision, tie=0.02, refit_growth=0, region="ensemble"
    ).update(told_equal)
    assert late.values[1:] == pytest.approx(np.cumsum(fitted) / fitted.sum(), abs=1e-9)
    # she who calls equal what is close is thought to see more than under the sharp model
    assert b.draws is not None
    assert a.draws is not None
    assert np.median(b.draws.precision) > 1.1 * np.median(a.draws.precision)


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("tie", [0.0, 0.01])
def test_ties_everywhere(region: str, tie: float) -> None:
    answers, fresh, precision, _ = told(6, 5, 300)
    nothing = Answers(answers.d, np.zeros(300, int))
    a = BradleyTerryComparator(5, precision=precision, region=region, tie=tie).update(nothing)
    assert a.converged
    assert np.isfinite(a.values).all()
    assert a.values[0] == 0
    assert a.values[-1] == 1
    assert (a.compare(fresh) != Verdict.EQUAL).all()  # a statistical rule never says EQUAL


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("rescale", [False, True])
def test_a_tutor_against_the_order_ends_in_silence(region: str, rescale: bool) -> None:
    """Every dominated vector is called better: all gaps shrink to 0, and no verdict may come of
    it.
    """
    rng = np.random.default_rng(7)
    d = np.sort(rng.dirichlet(np.ones(4), 400), axis=1) - 0.25
    a = BradleyTerryComparator(4, precision=20.0, region=region, rescale=rescale).update(
        Answers(d, -np.ones(400, int))
    )
    assert (a.compare(pairs(rng, 4, 50)) == Verdict.UNKNOWN).all()
    assert (a.compare(d) == Verdict.BETTER).all()
    literal = BradleyTerryComparator(
        4, precision=20.0, region=region, rescale=rescale, monotone=False
    )
    assert (literal.update(Answers(d, -np.ones(400, int))).compare(d) == Verdict.BETTER).all()


# How well it decides


@on_any_processor
@pytest.mark.parametrize(
    ("k", "n", "alpha"), [(5, 100, 1.0), (5, 20, 0.2), (10, 100, 1.0), (10, 40, 0.2)]
)
def test_few_of_the_decided_are_wrong(k: int, n: int, alpha: float) -> None:
    decided = wrong = box = box_wrong = 0
    for seed in range(12):
        answers, fresh, precision, e = told(100 + seed, k, n, alpha=alpha)
        truth = np.sign(fresh @ e)
        for region in REGIONS:
            v = (
                BradleyTerryComparator(k, precision=precision, region=region, seed=seed)
                .update(answers)
                .compare(fresh)
            )
            count, errors = (
                int((v != Verdict.UNKNOWN).sum()),
                int(((v != Verdict.UNKNOWN) & (v != truth)).sum()),
            )
            if region == "box":
                box, box_wrong = box + count, box_wrong + errors
            else:
                decided, wrong = decided + count, wrong + errors
    assert decided > 0.4 * 12 * 500
    assert wrong < 0.05 * decided
    assert box < 0.8 * decided  # the box is blunt
    assert box_wrong <= 0.05 * box
    if k == 10:
        assert box < 0.3 * decided


def test_the_estimate_approaches_the_scale() -> None:
    answers, _, precision, e = told(8, 5, 3000)
    a = BradleyTerryComparator(5, precision=precision, n_boot=20, region="ensemble").update(answers)
    assert np.abs(a.values - e).max() < 0.06


def test_the_estimate_lies_within_its_interval() -> None:
    answers, fresh, precision, _ = told(9, 8, 25)
    for region in REGIONS:
        for rescale in (False, True):
            for monotone in (False, True):
                a = BradleyTerryComparator(
                    8,
                    precision=precision,
                    n_boot=3,
                    level=0.1,
                    region=region,
                    rescale=rescale,
                    monotone=monotone,
                ).update(answers)
                lo, hi = a.bounds(fresh)
                assert (lo <= hi).all()
                estimate = np.clip(
                    fresh @ a.values, *order_bounds(tail_sums(fresh), 0.0)
                )  # the literal fit may stray
                assert (lo - 1e-12 <= estimate).all()
                assert (estimate <= hi + 1e-12).all()
                low, high, point = a.probability(fresh)
                assert (low <= point).all()
                assert (point <= high).all()


def test_the_literal_fit_may_break_the_order_and_rescaling_pins_the_top() -> None:
    answers, fresh, precision, _ = told(10, 8, 40)
    settings_ = {"precision": precision, "region": "box"}
    literal = BradleyTerryComparator(8, monotone=False, **settings_).update(answers)
    assert (np.diff(literal.values) < 0).any()
    assert (np.diff(BradleyTerryComparator(8, **settings_).update(answers).values) >= 0).all()
    top = np.array([-1.0, 0, 0, 0, 0, 0, 0, 1.0])
    plain, pinned = (
        BradleyTerryComparator(8, rescale=r, **settings_).update(answers) for r in (False, True)
    )
    assert pinned.bounds(top) == (1.0, 1.0)
    assert (pinned.compare(fresh) != Verdict.UNKNOWN).sum() > (
        plain.compare(fresh) != Verdict.UNKNOWN
    ).sum()


@pytest.mark.parametrize("region", REGIONS)
def test_verdicts_bounds_and_probabilities_agree(region: str) -> None:
    a = taught(5, 60, region=region)
    fresh = told(0, 5, 60)[1]
    v, (lo, hi), (low, high, _) = a.compare(fresh), a.bounds(fresh), a.probability(fresh)
    assert ((v == Verdict.BETTER) == (lo > 0)).all()
    assert ((v == Verdict.WORSE) == (hi < 0)).all()
    assert ((v == Verdict.BETTER) == (low > 0.5)).all()
    assert ((v == Verdict.WORSE) == (high < 0.5)).all()
    assert {*v.tolist()} >= {Verdict.BETTER, Verdict.WORSE, Verdict.UNKNOWN}
    low, high, point = a.probability([[0, 0, 0, 0, 0], [-1, 0, 0, 0, 1], [0, 0, 0, 0.5, -0.5]])
    assert low[0] == high[0] == point[0] == 0.5
    assert (low[1] >= 0.5, high[2] <= 0.5) == (True, True)


def outer_quantiles(scores: Floats, level: float) -> tuple[Floats, Floats]:
    """The percentile interval (n,), (n,) of scores (m, n), rounded outwards: at either end no more
    than the share (1 - level) / 2 lies beyond it, and with the end itself there would be more."""
    most = (1 - level) / 2 * len(scores) + 1e-9
    low = np.array([min(x for x in column if (column <= x).sum() > most) for column in scores.T])
    high = np.array([max(x for x in column if (column >= x).sum() > most) for column in scores.T])
    return low, high


@pytest.mark.parametrize(
    ("m", "level"),
    quick_first(
        [(100, 0.95), (39, 0.95), (200, 0.95), (40, 0.95), (50, 0.6), (100, 0.9)],
        6,
        older=2,
        names=2,
    ),
)
@pytest.mark.parametrize("rescale", [False, True])
def test_intervals_are_percentiles_of_fits_to_resamples(
    m: int, level: float, rescale: bool
) -> None:
    """Fit by fit and by the definition of a percentile interval, widened to hold the point
    estimate.
    """
    answers, fresh, precision, _ = told(3, 4, 60)
    t, p = tail_sums(answers.d), 3
    made = partial(
        BradleyTerryComparator,
        4,
        precision=precision,
        n_boot=m,
        level=level,
        seed=5,
        rescale=rescale,
        region="ensemble",
    )
    fitted = partial(fit, t, answers.y, precision=precision, strength=0.3 * p**2)
    point = fitted(centre=np.full((1, p), 1 / p)).gamma
    key = key_of(5)
    boot = fitted(
        centre=prior_centres(key, m, p, (0.1, 2.0)), weights=bootstrap_weights(key, m, 60)
    ).gamma
    point, boot = (
        point / point.sum(),
        boot / (boot.sum(axis=1, keepdims=True) if rescale else point.sum()),
    )
    steps = np.eye(4)[1:3] - np.eye(4)[0]  # d.e is the value of a level
    for region, d in (("box", steps), ("ensemble", fresh[:40])):
        low, high = outer_quantiles(boot @ tail_sums(d).T, level)
        middle = (point @ tail_sums(d).T)[0]
        least, greatest = order_bounds(tail_sums(d), 0.0)
        wanted = (
            np.clip(np.minimum(low, middle), least, greatest),
            np.clip(np.maximum(high, middle), least, greatest),
        )
        found = made(region=region, refit_growth=0.0).update(answers).bounds(d)
        assert np.abs(np.subtract(found, wanted)).max() < 1e-6


@pytest.mark.parametrize("least", [1, 5, 12])
def test_it_speaks_up_from_the_least_number_of_answers_on(least: int) -> None:
    answers, fresh, precision, _ = told(1, 5, 12)
    for n in (least - 1, least):
        a = BradleyTerryComparator(
            5, precision=precision, min_answers=least, refit_growth=0.0, region="ensemble"
        ).update(answers[:n])
        assert (a.draws is not None) == (n >= least)
        assert (a.bounds(fresh)[0] > order_bounds(tail_sums(fresh), 0.0)[0]).any() == (n >= least)


@pytest.mark.parametrize("region", REGIONS)
def test_bounds_for_all_rows_at_once_leave_out_whole_fits(region: str) -> None:
    answers, fresh, precision, _ = told(1, 4, 40)
    blank = BradleyTerryComparator(4, precision=precision, region=region)
    by_order = order_bounds(tail_sums(fresh), 0.0)[1]
    assert (blank.simultaneous_bounds(fresh)[0] == by_order).all()
    assert (blank.simultaneous_bounds(fresh)[1], blank.draws) == (1.0, None)
    a = blank.update(answers)
    high, confidence = a.simultaneous_bounds(fresh[:9])
    if region == "box":  # its levels are not bounded together
        assert (high == by_order[:9]).all()
        assert (confidence, a.draws) == (1.0, None)
        return
    assert a.draws is not None
    assert confidence == 0.95
    # m fits and the point estimate, less a twentieth
    assert (tail_sums(fresh[:9]) @ a.draws.gaps <= high[:, None] + 1e-12).all(
        axis=0
    ).sum() == 101 - 5


# What it must not depend on


@pytest.mark.parametrize("region", REGIONS)
@pytest.mark.parametrize("growth", [0.0, 0.05, 0.4])
def test_one_update_of_n_is_n_updates_of_one(region: str, growth: float) -> None:
    answers, fresh, precision, _ = told(11, 5, 45)
    start = BradleyTerryComparator(
        5, precision=precision, n_boot=20, region=region, refit_growth=growth
    )
    at_once, one_by_one, looked_at = start.update(answers), start, start
    for i in range(45):
        row = answers[i : i + 1]
        one_by_one, looked_at = one_by_one.update(row), looked_at.update(row)
        looked_at.compare(fresh)
        looked_at.bounds(fresh[:3])
    assert same(at_once, one_by_one, fresh)
    assert same(at_once, looked_at, fresh)
    assert at_once.answers.ids == answers.ids


def test_refits_follow_the_schedule() -> None:
    for growth in (0.0, 0.01, 0.05, 0.1, 1 / 3, 0.5, 1.0, 10.0):
        points, r = [0, 1], 1
        while r < 400:
            r = max(r + 1, r + int(np.ceil(r * growth)))
            points.append(r)
        assert [refit_point(n, growth) for n in range(400)] == [
            max(p for p in points if p <= n) for n in range(400)
        ]
        assert [next_refit(n, growth) for n in range(390)] == [
            min(p for p in points if p > n) for n in range(390)
        ]
    answers, fresh, precision, _ = told(13, 5, 100)
    a = BradleyTerryComparator(5, precision=precision, n_boot=10, region="ensemble").update(answers)
    assert a.fitted_answers == 97
    assert a.answers_to_next_step == 2  # 97 + ceil(4.85) = 102
    assert same(
        a,
        BradleyTerryComparator(5, precision=precision, n_boot=10, region="ensemble").update(
            answers[:97]
        ),
        fresh,
    )


def test_the_same_seed_gives_the_same_result() -> None:
    answers, fresh, precision, _ = told(14, 5, 30)

    def make(seed: Any) -> BradleyTerryComparator:
        return BradleyTerryComparator(5, precision=precision, seed=seed, region="ensemble").update(
            answers
        )

    made = make(3)
    made.values[:] = 7.0  # a copy
    assert same(made, make(3), fresh)
    assert same(make(np.random.default_rng(1)), make(np.random.default_rng(1)), fresh)
    assert same(make(np.random.SeedSequence(1)), make(np.random.SeedSequence(1)), fresh)
    assert not same(make(3), make(4), fresh)
    assert (make(3).values == make(4).values).all()  # the point estimate is not resampled
    drawn = BradleyTerryComparator(5, seed=np.random.default_rng(1), region="ensemble")
    assert drawn.update(answers).seed == drawn.seed


# Bad input


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("k", [1]),
        ("precision", [-1.0, math.nan, math.inf, "a"]),
        ("n_boot", [0, 2.5, "a"]),
        ("min_answers", [0, None]),
        ("level", [1.0, 0.0, None]),
        ("region", ["ball"]),
        ("no_maximum", ["guess"]),
        ("prior_strength", [-0.1]),
        ("prior_shape", [(0.0, 1.0), (2.0, 1.0), "ab", 1.0]),
        ("refit_growth", [-1]),
        ("tie", [1.0, -0.01, math.nan, "a", None, True]),
    ],
)
def test_bad_settings_are_named(name: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(ValueError, match=f"{name}.* not {re.escape(repr(value))}"):
            BradleyTerryComparator(**({"k": 5} | {name: value}))
