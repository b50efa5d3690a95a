"""The posterior comparator: what it promises, what it may depend on, and its numbers against other
ways to them.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.special import expit, gammaln, logsumexp
from scipy.stats import beta, chisquare

from elicit import (
    Answers,
    BradleyTerryComparator,
    BradleyTerryTutor,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    Verdict,
)
from elicit._support.fixed_order import product
from elicit.comparators.bradley_terry.first_particles import LAPSE
from elicit.model.comparator_parts import lapse_of
from elicit.model.scale import order_bounds
from elicit.testing import check_comparator, sample_differences
from tests.interpreter import run
from tests.noisy_cases import (
    MEAN,
    SD,
    Floats,
    Rng,
    differences,
    drawn_gaps,
    log_terms,
    pairs,
    widths_of,
)
from tests.scale_arithmetic import dominance, tail_sums, values_of
from tests.thoroughness import covering, on_any_processor, quick_first, scaled

TINY = 1e-20
# independent draws that 1000 particles are worth at least, for k up to 8: moved copies stay alike
# for a time
WORTH = 120


def answered(
    rng: Rng, d: Floats, g: Floats, c: float, lapse: float = 0.05, ties: float = 0.0
) -> Answers:
    """Answers of the model to d (n, k)."""
    right = lapse / 2 + (1 - lapse) * expit(c * (tail_sums(d) @ g))
    y = np.where(rng.random(len(d)) < right, 1, -1)
    return Answers(d, np.where(rng.random(len(d)) < ties, 0, y))


def told(k: int = 5, n: int = 40, seed: int = 0, c: float = 20.0) -> Answers:
    rng = np.random.default_rng([seed, k, n])
    return answered(rng, pairs(rng, k, n), rng.dirichlet(np.ones(k - 1)), c)


def identical(a: PosteriorComparator, b: PosteriorComparator) -> bool:
    d = sample_differences(a.k)
    return bool(
        all((x == y).all() for x, y in zip(a.draws, b.draws, strict=True))
        and (a.values == b.values).all()
        and (a.compare(d) == b.compare(d)).all()
        and (a.probability(d) == b.probability(d)).all()
        and (a.proposed, a.accepted, a.effective_size) == (b.proposed, b.accepted, b.effective_size)
    )


def assert_sane(c: PosteriorComparator, least: float = 0.05) -> None:
    """Finite, in range, in line with itself, and of particles that are worth something."""
    d = np.concatenate([pairs(np.random.default_rng(9), c.k, 60), sample_differences(c.k)])
    assert all(np.isfinite(part).all() for part in c.draws)
    values = c.values
    assert values[0] == 0
    assert values[-1] == 1
    assert (np.diff(values) >= 0).all()
    p, q, v, (low, high) = c.probability(d), c.probability(-d), c.compare(d), c.bounds(d)
    assert ((p >= 0) & (q >= 0) & (p + q <= 1 + 1e-9)).all()
    assert np.isin(v, [-1, 0, 1, 2]).all()
    floor, ceiling = order_bounds(tail_sums(d), 0.0)
    assert ((floor <= low) & (low <= high) & (high <= ceiling)).all()
    plain = dominance(tail_sums(d))
    assert (v[plain != 2] == plain[plain != 2]).all()
    assert ((v == 1) == ((p >= c.level) & (plain != 0)))[plain == 2].all()
    assert ((v == -1) == (q >= c.level))[plain == 2].all()
    assert 0 <= c.precision < math.inf
    assert least * c.particles <= c.effective_size <= c.particles * (1 + 1e-9)
    assert math.isnan(c.acceptance) or 0 < c.acceptance < 1


@pytest.mark.parametrize(
    ("k", "n", "settings"),
    quick_first(
        [
            (2, 0, {}),
            (5, 40, {}),
            (5, 0, {"prior": ["e3 >= 0.5", "e4 - e3 <= 0.1"]}),
            (8, 0, {"precision": 20.0, "lapse": 0.0}),
            (4, 0, {"precision": 0}),
            (5, 0, {"shape": (1.0, 1.0), "particles": 37, "seed": 4}),
            (6, 100, {"level": 0.99}),
            (5, 0, {"level": 0.8}),
        ],
        8,
        older=3,
        names=3,
    ),
)
def test_it_keeps_the_contract(k: int, n: int, settings: dict[str, Any]) -> None:
    comparator = PosteriorComparator(k, **settings).update(told(k, n))
    check_comparator(comparator)
    assert_sane(comparator)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("k", [1]),
        ("precision", [-1.0, math.inf, math.nan, "a", True, 10**400]),
        ("lapse", [1.0, -0.1, math.nan, "a", True]),
        ("tie", [1.0, -0.01, math.nan, "a", None, True]),
        ("level", [0.5, 1.0, None]),
        ("particles", [5, 100.5, math.nan, math.inf, "x", [100]]),
        ("shape", [(0.0, 1.0), (2.0, 1.0), (1.0, math.inf), (1.0,), "ab", 1.0, (1.0, None)]),
        ("shape", [(1e-300, 1e300)]),  # whose logarithms of gaps are no numbers
        ("prior", ["e2 >= 0.9, e2 <= 0.1"]),
    ],
)
def test_bad_settings_are_refused_by_name(name: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(ValueError, match=r"must be|levels|cannot be read"):
            PosteriorComparator(**({"k": 5} | {name: value}))


def test_it_is_a_function_of_answers_seed_and_settings() -> None:
    answers = told()
    a = PosteriorComparator(5, seed=3).update(answers)
    assert identical(a, PosteriorComparator(5, seed=3).update(answers))
    assert not (a.draws.gaps == PosteriorComparator(5, seed=4).update(answers).draws.gaps).any()
    rng = np.random.default_rng(8)
    drawn = PosteriorComparator(5, seed=rng)
    assert identical(
        drawn.update(answers), PosteriorComparator(5, seed=np.random.default_rng(8)).update(answers)
    )
    sequence = np.random.SeedSequence(8)
    assert identical(
        PosteriorComparator(5, seed=sequence),
        PosteriorComparator(5, seed=np.random.SeedSequence(8)),
    )


def test_many_updates_are_one_and_the_old_comparator_stays_as_it_was() -> None:
    answers = told(n=75)
    fresh = PosteriorComparator(5)
    before, untouched = fresh.draws.gaps.copy(), PosteriorComparator(5)
    at_once = fresh.update(answers)
    by_parts, middle = fresh, None
    for a, b in ((0, 1), (1, 1), (1, 30), (30, 75)):
        by_parts = by_parts.update(answers[a:b])
        middle = by_parts if b == 30 else middle
    assert identical(at_once, by_parts)
    assert middle is not None
    assert identical(middle, PosteriorComparator(5).update(answers[:30]))
    assert (fresh.draws.gaps == before).all()
    assert identical(fresh, untouched)
    assert len(fresh.answers) == 0
    assert len(at_once.answers) == 75
    one, other = (
        middle.update(answers[30:31]),
        middle.update(answers[40:41]),
    )  # two futures of one past
    assert identical(one, fresh.update(answers[:31]))
    assert not (one.probability(answers.d) == other.probability(answers.d)).all()


def test_values_cannot_be_changed_from_outside() -> None:
    c = PosteriorComparator(5)
    with pytest.raises(ValueError, match="read-only"):
        c.values[1] = 0.5


@pytest.mark.parametrize(
    ("particles", "level"),
    [
        (500, 0.95),
        (100, 0.9),
        (20, 0.55),
        *[
            pytest.param(*case, marks=pytest.mark.slow)
            for case in [(1000, 0.95), (300, 0.95), (500, 0.8)]
        ],
    ],
)
def test_verdicts_probabilities_and_bounds_agree_at_the_very_level(
    particles: int, level: float
) -> None:
    c = PosteriorComparator(6, particles=particles, level=level)
    d = pairs(np.random.default_rng(0), 6, 3000)
    v, up, down, (low, high) = c.compare(d), c.probability(d), c.probability(-d), c.bounds(d)
    assert (np.abs(up - level) < 1e-9).any()
    assert ((v == 1) == (low > 0)).all()
    assert ((v == -1) == (high < 0)).all()
    assert ((v == 1) == (up >= level - 1e-9)).all()
    assert ((v == -1) == (down >= level - 1e-9)).all()
    mirrored = c.bounds(-d)
    assert np.allclose(mirrored[0], -high, atol=1e-12)
    assert np.allclose(mirrored[1], -low, atol=1e-12)


def test_bounds_are_quantiles() -> None:
    c = PosteriorComparator(5).update(told(5, 20))
    d = pairs(np.random.default_rng(1), 5, 50)
    gaps, weights, _ = c.draws
    low, high = c.bounds(d)
    for t, lo, hi in zip(tail_sums(d), low, high, strict=True):
        scores = t @ gaps
        near = 1e-9 * np.abs(t).sum()
        assert (
            weights[scores < lo - near].sum()
            <= 0.05 + 1e-9
            <= weights[scores <= lo + near].sum() + 2e-9
        )
        assert weights[scores < hi - near].sum() < 0.95 <= weights[scores <= hi + near].sum() + 1e-9


def test_bounds_for_all_rows_at_once_leave_out_the_fewest_particles() -> None:
    """Particles with the greatest d.e of any row are left out, as many as the level allows."""
    c = PosteriorComparator(6, seed=1).update(told(6, 12))
    d = differences(np.random.default_rng(0), 6, 30)
    high, confidence = c.simultaneous_bounds(d)
    gaps, weights, _ = c.draws
    at = product(tail_sums(d), gaps)
    order = np.argsort(at.max(axis=0))
    enough = next(n for n in range(1, 1001) if weights[order[:n]].sum() >= c.level - 1e-9)
    assert (high == at[:, order[:enough]].max(axis=1)).all()
    assert weights @ (at <= high[:, None]).all(axis=0) >= c.level - 1e-9
    assert confidence == c.level == 0.95
    # one by one the quantiles are lower: together they hold less often
    alone = c.bounds(d)[1]
    assert weights @ (at <= alone[:, None]).all(axis=0) < 0.95
    assert (high >= alone - 1e-12).mean() > 0.8
    # for one difference the two are the same quantile
    np.testing.assert_allclose([c.simultaneous_bounds(row)[0][0] for row in d], alone, atol=1e-12)


def test_retracted_answers_leave_no_trace() -> None:
    answers = told(n=30)
    for start in (
        PosteriorComparator(5, seed=np.random.default_rng(3)),
        PosteriorComparator(5, prior="e3 >= 0.4"),
    ):
        full = start.update(answers)
        full.compare(answers.d)
        others = answers.without(["3", "17"])
        back = full.retract("3", "17")
        assert identical(back, start.update(others))
        assert back.answers.ids == others.ids
        assert identical(full, start.update(answers))
        assert identical(full.retract(*answers.ids), start)
    with pytest.raises(ValueError, match="no answer here has the id 'x'"):
        full.retract("x")


@pytest.mark.parametrize("k", [2, 5, 21])
def test_the_default_shape_keeps_to_the_sum_of_the_parameters(k: int) -> None:
    assert PosteriorComparator(k).shape == (0.2 / (k - 1), 2.0 / (k - 1))


def test_levels_set_in_between_do_not_change_what_is_thought_of_the_others() -> None:
    """Whatever is decided about three levels before any answer is so when 16 more lie between
    them.
    """
    d = pairs(np.random.default_rng(0), 3, 200)
    wide = np.zeros((200, 19))
    wide[:, [0, 9, 18]] = d
    few, many = (
        np.mean([C.probability(e) for C in made], axis=0)
        for made, e in (
            ([PosteriorComparator(3, seed=i) for i in range(8)], d),
            ([PosteriorComparator(19, seed=i) for i in range(8)], wide),
        )
    )
    assert np.abs(few - many).max() < 4 * math.sqrt(0.5 / (8 * 1000))


def weighted(
    rng: Rng, k: int, answers: Answers, lapse: float, m: int
) -> tuple[Floats, Floats, Floats]:
    """Gaps (m, p), log c (m,) from the prior, and their weights (m,) by the formula: the posterior,
    exactly so in the limit, by no chain at all."""
    g, log_c = drawn_gaps(rng, k, m), rng.normal(MEAN, SD, m)
    return g, log_c, normalised(log_likelihood(g, log_c, answers, lapse))


def log_likelihood(
    g: Floats, log_c: Floats, answers: Answers, lapse: Any, share: Any = 0.0
) -> Floats:
    """Return the log likelihood (m,) by the formula.

    It is that of scales g (m, p), precisions (m,), and lapses and widths, each (m,) or a number.
    """
    total, theta = np.zeros(len(g)), np.exp(np.minimum(log_c, 300.0))[:, None] * g
    block = max(1, 1_000_000 // len(g))  # answers at a time
    for i in range(0, len(answers), block):
        y = answers.y[i : i + block]
        t = tail_sums(answers.d[i : i + block]) * np.where(y == 0, 1, y)[:, None]
        total += log_terms(theta, t, y == 0, lapse, share * theta.sum(axis=1)).sum(axis=1)
    return total


def normalised(logs: Floats) -> Floats:
    w = np.exp(logs - logs.max())
    w /= w.sum()
    return np.asarray(w)


@on_any_processor
@pytest.mark.parametrize(("k", "n"), covering([3, 5, 10], [0, 1], together=1))
def test_nothing_is_certain_that_the_prior_does_not_make_so(k: int, n: int) -> None:
    rng = np.random.default_rng([k, n])
    d = pairs(rng, k, 400)
    even = np.abs((tail_sums(d) @ drawn_gaps(rng, k, 4000).T > 0).mean(axis=1) - 0.5).argmin()
    answers = Answers(d[[even]], [1])[:n]
    g, _, w = weighted(rng, k, answers, 0.05, 40_000)
    true = (tail_sums(d) @ g.T > 0) @ w
    for seed in range(3):
        c = PosteriorComparator(k, seed=seed).update(answers)
        v = c.compare(d)
        slack = 4 * math.sqrt(0.05 * 0.95 / 250)
        assert (true[v == 1] > 0.95 - slack).all()
        assert (true[v == -1] < 0.05 + slack).all()
        assert (v[(true > 0.15) & (true < 0.85)] == Verdict.UNKNOWN).all()
        assert ((true > 0.15) & (true < 0.85)).sum() > 100
        assert (c.compare(answers.d) == Verdict.UNKNOWN).all()
        assert_sane(c, 0.4)


@on_any_processor
@pytest.mark.parametrize("y", quick_first([1, 0, -1], 2))
def test_levels_that_no_answer_touched_stay_uncertain(y: int) -> None:
    told_of = np.array([[0.3, -0.5, 0.2, 0.0, 0.0, 0.0]])
    other = np.array(
        [[0, 0, 0, 0.5, -1.0, 0.5], [0, 0, 0.3, -0.6, 0, 0.3], [0, 0, 0.5, -1, 0.5, 0]]
    )
    for precision in (None, 20.0, 1e6):
        c = PosteriorComparator(6, precision=precision).update(
            Answers(np.tile(told_of, (200, 1)), np.full(200, y))
        )
        assert_sane(c)
        assert (c.compare(other) == Verdict.UNKNOWN).all()
        assert c.probability(other) == pytest.approx([0.5, 0.6, 0.5], abs=0.25)
        low, high = c.bounds(other)
        assert (low < -0.005).all()
        assert (high > 0.005).all()
        assert c.compare(told_of).tolist() == [Verdict.UNKNOWN if y == 0 else y]


@pytest.mark.parametrize("precision", [0, 1e-300, 1e-9])
def test_a_tutor_of_no_precision_teaches_nothing(precision: float) -> None:
    c = PosteriorComparator(5, precision=precision)
    after = c.update(told())
    assert after.precision == precision
    assert np.allclose(after.values, c.values, atol=1e-6)
    assert (after.compare(sample_differences(5)) == c.compare(sample_differences(5))).all()
    assert after.effective_size == pytest.approx(after.particles)
    assert math.isnan(after.acceptance)
    assert len(after.answers) == 40


@pytest.mark.slow
def test_ten_thousand_answers() -> None:
    rng = np.random.default_rng(0)
    d, e = differences(rng, 5, 10_000), np.array([0.0, 0.1, 0.15, 0.7, 1.0])
    c = PosteriorComparator(5, lapse=0.0).update(Answers(d, BradleyTerryTutor(e, 20.0, 1).signs(d)))
    assert_sane(c, 0.2)
    assert np.allclose(c.values, e, atol=0.03)
    assert c.precision == pytest.approx(20.0, rel=0.08)
    fresh = pairs(rng, 5, 300)
    v, truth = c.compare(fresh), TruthfulTutor(e).signs(fresh)
    assert (v != Verdict.UNKNOWN).mean() > 0.85
    assert (v[v != 2] == truth[v != 2]).mean() > 0.99


@pytest.mark.parametrize(
    ("precision", "lapse"),
    [
        (100.0, 0.0),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in ((None, 0.05), (None, 0.0), (1e6, 0.05))
        ),
    ],
)
def test_contradictory_answers_a_thousand_times(precision: float | None, lapse: float) -> None:
    d = np.array([[0.2, -0.5, 0.3, 0.0, 0.0]])
    other = np.array([[0.0, 0.0, 0.5, -1.0, 0.5]])
    y = np.tile([1, -1], 1000) if precision == 100.0 else np.repeat([1, -1], 1000)
    c = PosteriorComparator(5, precision=precision, lapse=lapse).update(
        Answers(np.tile(d, (2000, 1)), y)
    )
    assert_sane(c)
    low, high = c.bounds(d)
    assert low[0] < 0.01  # the truth is near a tie, or the tutor knows nothing
    assert high[0] > -0.01
    assert c.compare(other).tolist() == [Verdict.UNKNOWN]
    if precision is None:
        assert (
            c.precision * np.abs(c.bounds(d)).max() < 20
        )  # the tutor is no longer thought to be precise


@on_any_processor
@pytest.mark.parametrize("precision", [None, 100.0])
def test_nearly_identical_vectors_teach_nothing_and_far_ones_are_no_harm(
    precision: float | None,
) -> None:
    answers = told(n=scaled(40, 100))
    c = PosteriorComparator(5, precision=precision)
    for d in (1e-12 * answers.d, np.zeros_like(answers.d)):
        after = c.update(Answers(d, answers.y))
        assert np.allclose(after.values, c.values, atol=1e-6)
        assert after.effective_size > 499
    for size in (1e4, 1e100, 1e300):
        assert_sane(c.update(Answers(size * answers.d, answers.y)))


@pytest.mark.slow
def test_answers_about_vectors_near_the_greatest_number_end() -> None:
    code = (
        "import numpy as np; from elicit import PosteriorComparator as C\n"
        "from elicit.model.query import Answers\n"
        "c = C(3).update(Answers(1e301 * np.array([[0.4, -1.0, 0.6]]), [1])); assert "
        "np.isfinite(c.draws.gaps).all()"
    )
    run(code)  # which waits for so long only


@on_any_processor
@pytest.mark.parametrize("precision", [None, 100.0])
@pytest.mark.parametrize("lapse", [0.0, 0.05])
def test_all_answers_equal(precision: float | None, lapse: float) -> None:
    answers = told(n=scaled(80, 150))
    c = PosteriorComparator(5, precision=precision, lapse=lapse, tie=0.0).update(
        Answers(answers.d, np.zeros(len(answers), int))
    )
    assert_sane(c)
    if precision is None:
        assert c.precision < 5.0  # who finds everything equal sees no differences
        assert (c.compare(pairs(np.random.default_rng(0), 5, 200)) == Verdict.UNKNOWN).mean() > 0.7


def test_equal_answers_draw_the_pair_to_a_tie() -> None:
    d = np.array([[0.3, -1.0, 0.7]])
    before = PosteriorComparator(3, precision=50.0, lapse=0.05, tie=0.0)
    after = before.update(Answers(np.tile(d, (40, 1)), np.zeros(40, int)))
    (low,), (high,) = before.bounds(d)
    (lower,), (higher,) = after.bounds(d)
    assert -0.05 < lower < 0 < higher < 0.05
    assert high - low > 0.5
    assert after.compare(d).tolist() == [Verdict.UNKNOWN]
    assert after.values[1] == pytest.approx(0.7, abs=0.03)


@pytest.mark.parametrize(("precision", "truth"), covering([None, 1e9], [0.37, 0.999], together=1))
def test_a_nearly_noiseless_tutor_can_be_asked_ever_finer(
    precision: float | None, truth: float
) -> None:
    """Bisection: each question compares level 2 with the mixture of 1 and 3 that is worth as much
    by now.
    """
    c = PosteriorComparator(3, precision=precision, lapse=0.0)
    for _ in range(50):
        m = float(c.values[1])
        c = c.update(Answers(np.array([[m - 1.0, 1.0, -m]]), [1 if truth > m else -1]))
    assert_sane(c)
    assert c.values[1] == pytest.approx(truth, abs=1e-4 if precision is None else 1e-7)
    assert (c.draws.gaps[0].min() < truth) == (c.draws.gaps[0].max() > truth)


@pytest.mark.parametrize("k", quick_first([3, 8, 5], 2, older=1))
def test_without_noise_it_agrees_with_the_polytope(k: int) -> None:
    rng = np.random.default_rng(k)
    e = values_of(rng.dirichlet(np.ones(k - 1)))
    asked, fresh = pairs(rng, k, 25), pairs(rng, k, 300)
    answers = Answers(asked, TruthfulTutor(e).signs(asked))
    certain = PolytopeComparator(k, 0.0).update(answers).compare(fresh)
    known, doubts = certain != Verdict.UNKNOWN, []
    for precision in (30.0, 1e3, 1e6, 1e12):
        c = PosteriorComparator(k, precision=precision, lapse=0.0).update(answers)
        assert_sane(c)
        agree = np.where(certain == 1, c.probability(fresh), c.probability(-fresh))
        doubts.append(float((1.0 - agree[known]).max()))
    assert known.sum() > 50
    assert doubts[-1] < 1e-4
    assert doubts[0] > doubts[-1]
    assert (c.compare(fresh)[known] == certain[known]).all()
    gaps, weights, _ = c.draws
    assert (tail_sums(asked) @ gaps[:, weights > 1e-12] * answers.y[:, None] > -1e-9).all()


# ---- the lapse
# --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("settings", "counts", "values"),
    [
        ({"lapse": 0.05}, (8000, 2069), [0.0, 0.18716762986746102, 0.4867383696967482, 1.0]),
        (
            {"lapse": 0.0, "precision": 30.0},
            (6400, 1992),
            [0.0, 0.2321376491929906, 0.5236409391457905, 1.0],
        ),
        (
            {"lapse": 0.2, "prior": "e3 >= 0.4"},
            (6400, 1606),
            [0.0, 0.18044896435217214, 0.4771631074816869, 1.0],
        ),
    ],
)
def test_a_given_lapse_gives_these_numbers_on_every_processor(
    settings: dict[str, Any], counts: tuple[int, int], values: list[float]
) -> None:
    rng = np.random.default_rng(11)
    d = rng.dirichlet(np.ones(4), 60) - rng.dirichlet(np.ones(4), 60)
    y = np.sign(d @ [0.0, 0.2, 0.5, 1.0]).astype(int) * np.where(rng.random(60) < 0.1, -1, 1)
    c = PosteriorComparator(4, particles=100, seed=3, **settings).update(Answers(d, y))
    assert (c.proposed, c.accepted) == counts
    assert c.values.tolist() == pytest.approx(values, rel=1e-12)
    assert c.lapse == c.given_lapse == settings["lapse"]


@on_any_processor
@pytest.mark.parametrize(
    ("flips", "least", "most"),
    quick_first([(0.0, 0.0, 0.02), (0.3, 0.5, 0.7), (0.1, 0.12, 0.28)], 2, names=3),
)
def test_the_lapse_is_learned(flips: float, least: float, most: float) -> None:
    rng, e = np.random.default_rng(4), np.array([0.0, 0.1, 0.35, 0.4, 1.0])
    d = pairs(rng, 5, 400)
    c = PosteriorComparator(5).update(Answers(d, FlippingTutor(e, flips, 2).signs(d)))
    assert_sane(c)
    assert c.given_lapse is None
    assert isinstance(c.lapse, float)
    assert least <= c.lapse <= most
    fresh = pairs(rng, 5, 300)
    v, truth = c.compare(fresh), TruthfulTutor(e).signs(fresh)
    assert (v != 2).mean() > (0.75 if flips == 0.3 else 0.9)
    assert (v[v != 2] == truth[v != 2]).mean() > 0.99


def test_before_any_answer_the_lapse_is_the_priors() -> None:
    assert PosteriorComparator(5).lapse == pytest.approx(LAPSE[0] / sum(LAPSE), abs=1e-3)
    assert lapse_of(PosteriorComparator(5, lapse=0.3)) == 0.3
    assert PosteriorComparator(5, lapse=0).lapse == 0.0


# ---- about equal
# ------------------------------------------------------------------------------------------------


def told_equal(
    k: int, n: int, tie: float, seed: int = 0, c: float = 60.0, lapse: float = 0.1
) -> Answers:
    """Answers of Rao and Kupper's model with half that width and a lapse."""
    rng = np.random.default_rng([seed, k, n])
    d = pairs(rng, k, n)
    z, s = c * (tail_sums(d) @ rng.dirichlet(np.ones(k - 1))), c * tie / 2
    at, slips = rng.random(n), rng.random(n) < lapse
    y = np.where(at < expit(z - s), 1, np.where(at < expit(z + s), 0, -1))
    return Answers(d, np.where(slips, rng.integers(-1, 2, n), y))


def test_who_calls_nothing_equal_is_taken_as_sharp_whatever_she_might_call_so() -> None:
    answers = told(n=60)
    given: list[dict[str, Any]] = [{"lapse": 0.05}, {"precision": 30.0}]
    for settings in ({}, *scaled([given[0] | given[1]], given)):
        sharp, wide = (PosteriorComparator(5, tie=tie, **settings) for tie in (0.0, 0.2))
        assert (sharp.tie, wide.tie, PosteriorComparator(5).tie) == (0.0, 0.2, 0.01)
        assert identical(sharp.update(answers), wide.update(answers))
        assert not identical(sharp, sharp.update(answers))


@pytest.mark.parametrize(
    "settings",
    quick_first(
        [{}, {"lapse": 0.0, "precision": 30.0}, {"lapse": 0.05}, {"prior": "e3 >= 0.4"}], 1
    ),
)
def test_the_first_equal_has_all_answers_taken_in_afresh(settings: dict[str, Any]) -> None:
    answers = told(n=40)
    y = answers.y.copy()
    y[[25, 26, 33]] = 0
    answers = Answers(answers.d, y)
    settings = {**settings, "particles": scaled(150, 1000)}
    start = PosteriorComparator(5, tie=0.05, **settings)
    sharp, after = start.update(answers[:25]), start.update(answers)
    assert_sane(after)
    step = start
    for i in range(40):
        step = step.update(answers[i : i + 1])
        if i == 24:
            assert identical(step, sharp)
    assert identical(step, after)
    assert identical(sharp.update(answers[25:]), after)
    assert identical(sharp, start.update(answers[:25])), "the old one is as it was"
    assert not identical(after, PosteriorComparator(5, tie=0.0, **settings).update(answers))
    ids = answers.ids
    assert identical(
        after.retract(ids[25], ids[26], ids[33]),
        start.update(answers.without([ids[25], ids[26], ids[33]])),
    )
    assert identical(after.retract(ids[3]), start.update(answers.without([ids[3]])))
    assert identical(
        start.update(answers[25:26]).update(answers[:25]),
        start.update(answers[25:26] + answers[:25]),
    )


def test_a_pair_called_equal_lies_within_what_the_tutor_calls_so() -> None:
    """Five times EQUAL about one pair leave the width open; with other answers, they do not."""
    d, rng = np.array([[0.3, -1.0, 0.7]]), np.random.default_rng(0)
    others, e = pairs(rng, 3, 40), np.array([0.0, 0.69, 1.0])
    y = np.where(np.abs(others @ e) <= 0.02, 0, np.sign(others @ e))
    truth = float(d[0] @ e)
    assert truth == pytest.approx(0.01)
    alone = PosteriorComparator(3, tie=0.03).update(Answers(np.tile(d, (5, 1)), np.zeros(5, int)))
    assert np.diff(alone.bounds(d), axis=0) > 0.5  # such a tutor may call everything equal
    for n, tie in ((10, 0.03), (10, 0.01), (40, 0.03), (40, 0.01)):
        answers = Answers(
            np.concatenate([others[:n], np.tile(d, (5, 1))]),
            np.append(y[:n], np.zeros(5)).astype(int),
        )
        (low,), (high,) = PosteriorComparator(3, tie=tie).update(answers).bounds(d)
        assert -0.02 < low < truth < high < 0.02
        assert high - low > 0.01
    assert low > 0.0  # the others say so, not EQUAL
    (low,), (high,) = PosteriorComparator(3, tie=0.0).update(answers[-5:]).bounds(d)
    assert high - low > 0.5  # a sharp tutor who cannot tell may be one who knows nothing


def test_a_tutor_who_finds_all_equal_that_is_not_teaches_nothing_but_the_width() -> None:
    answers = told(n=150)
    c = PosteriorComparator(5).update(Answers(answers.d, np.zeros(150, int)))
    assert_sane(c)
    assert (c.compare(pairs(np.random.default_rng(0), 5, 200)) == Verdict.UNKNOWN).mean() > 0.9
    ((_, lapse, width),) = c._tutors.values()
    weights = c.draws.weights
    assert lapse @ weights < 0.1
    assert (width / c.draws.precision) @ weights > 0.3
    for settings in (
        {"lapse": 0.05},
        {"lapse": 0.0},
        {"tie": 0.2},
        {"precision": 1e9},
        {"precision": 1e-9},
    ):
        assert_sane(
            PosteriorComparator(5, **settings).update(Answers(answers.d, np.zeros(150, int)))
        )


def test_one_equal_among_consistent_answers_is_believed() -> None:
    """A person's eight answers about four levels, in tenths and so on of each; the fifth says that
    the second level is worth 0.4.
    """
    told_so = [
        ([3, 0, 0, 10], [0, 3, 10, 0], 1),
        ([4, 0, 0, 15], [0, 9, 10, 0], 1),
        ([0, 0, 10, 0], [5, 0, 0, 5], 1),
        ([0, 0, 10, 0], [4, 0, 0, 6], 1),
        ([0, 10, 0, 0], [6, 0, 0, 4], 0),
        ([0, 0, 0, 10], [0, 0, 10, 0], 1),
        ([7, 0, 0, 25], [0, 12, 20, 0], 1),
        ([5, 0, 0, 5], [0, 10, 0, 0], 1),
    ]
    shares = [(np.array(a) / sum(a), np.array(b) / sum(b), y) for a, b, y in told_so]
    answers = Answers(np.array([a - b for a, b, _ in shares]), [y for _, _, y in shares])
    found = [PosteriorComparator(4, seed=seed).update(answers).values[1] for seed in range(4)]
    strict = answers.without([answers.ids[4]])
    assert PosteriorComparator(4).update(strict).values[1] < 0.2
    assert 0.26 < np.mean(found) < 0.4


@on_any_processor
@pytest.mark.parametrize("width", quick_first([0.02, 0.1, 0.05], 2))
def test_intervals_hold_for_people_who_call_equal_what_they_are_not_told(width: float) -> None:
    """Scales of the prior, 25 answers, one in twenty at random; the default ``tie`` is .01.

    Nine in ten are inside by construction, so that of many people as many are but for chance.
    """
    inside, wrong = [], []
    for i in range(scaled(8, 160)):
        rng = np.random.default_rng([i, 32])
        g, asked, fresh = drawn_gaps(rng, 4)[0], pairs(rng, 4, 25), pairs(rng, 4, 40)
        true, at = tail_sums(fresh) @ g, tail_sums(asked) @ g
        y = np.where(np.abs(at) <= width, 0, np.sign(at)).astype(int)
        y = np.where(rng.random(25) < 0.05, rng.choice([-1, 1], 25), y)
        learned = PosteriorComparator(4, seed=i).update(Answers(asked, y))
        low, high = learned.bounds(fresh)
        inside.append((low <= true) & (true <= high))
        verdicts = learned.compare(fresh)
        decided = verdicts != Verdict.UNKNOWN
        wrong.append((verdicts != np.sign(true))[decided])
    of_each = np.mean(inside, axis=1)
    by_chance = scaled(0.0, 2.0 * float(of_each.std(ddof=1)) / len(of_each) ** 0.5)
    assert of_each.mean() > 0.9 - by_chance
    assert np.concatenate(wrong).mean() < 0.05


@pytest.mark.slow
def test_it_agrees_with_weighted_draws_where_all_is_learned_on_15_data_sets() -> None:
    """Scale, precision, lapse and width drawn from the prior and weighted by the formula."""
    squares = []
    for i in range(0, 15, scaled(4, 1)):  # of all numbers of levels, and of all ties
        k, tie, rng = (3, 4, 5)[i % 3], (0.0, 0.1, 0.3)[i // 5], np.random.default_rng([i, 78])
        answers, m, d = told_equal(k, 10, tie, i, c=30.0), 150_000, pairs(rng, k, 20)
        tie = tie if (answers.y == 0).any() else 0.0
        g, log_c = drawn_gaps(rng, k, m), rng.normal(MEAN, SD, m)
        lapse, share = rng.beta(*LAPSE, m), widths_of(tie, rng.random(m))
        if not tie:
            answers = Answers(answers.d, np.where(answers.y == 0, 1, answers.y))
        w = normalised(log_likelihood(g, log_c, answers, lapse, share))
        assert 1.0 / float((w**2).sum()) > 300

        def error(f: Floats, w: Floats = w) -> Floats:
            centred = f - (f @ w)[:, None]
            return np.asarray(np.sqrt(centred**2 @ w**2))

        squares.append(compare_with(answers, g, w, d, error, 3, None, tie))
        found = np.mean(
            [PosteriorComparator(k, tie=tie, seed=s).update(answers).lapse for s in range(3)]
        )
        assert found == pytest.approx(lapse @ w, abs=4 * float(lapse.std()) / math.sqrt(3 * WORTH))
    assert math.sqrt(np.mean(squares)) < 1.1


@pytest.mark.slow
def test_it_agrees_with_a_grid_where_all_is_learned_of_three_levels() -> None:
    """Quadrature over the logit of the first gap, log c, the lapse and the width: 40 answers, some
    equal.

    The logit's grid is fine where the scales are: P(d.e > 0) is known to the mass of one cell.
    """
    tie, rng = 0.1, np.random.default_rng(2)
    answers, d = told_equal(3, 40, tie, 1), pairs(rng, 3, 20)
    assert 3 <= (answers.y == 0).sum() <= 15
    r = np.concatenate(
        [np.arange(-60.0, -2.0, 0.4), np.arange(-2.0, 2.0, 0.005), np.arange(2.0, 60.0, 0.4)]
    )
    log_c = np.arange(MEAN - 4.0 * SD, MEAN + 4.0 * SD, 0.5)
    a = np.exp(np.linspace(math.log(0.2), math.log(2.0), 401)) / 2
    log_g = np.stack([-np.logaddexp(0, -r), -np.logaddexp(0, r)])
    constants = gammaln(2 * a) - 2 * gammaln(a)
    density = logsumexp(constants[:, None] + a[:, None] * log_g.sum(axis=0), axis=0)
    (lapse_nodes, lapse_mass), (share_nodes, share_mass) = map(
        np.polynomial.legendre.leggauss, (6, 24)
    )
    lapses, shares = (lapse_nodes + 1) / 2, widths_of(tie, (share_nodes + 1) / 2)
    at = np.stack(np.meshgrid(np.arange(len(r)), log_c, lapses, shares, indexing="ij")).reshape(
        4, -1
    )
    g, i = np.exp(log_g).T, at[0].astype(int)
    logs = (
        density[i]
        + np.log(np.gradient(r))[i]
        - 0.5 * ((at[1] - MEAN) / SD) ** 2
        + np.log(beta.pdf(at[2], *LAPSE))
    )
    weights = np.add.outer(np.log(lapse_mass), np.log(share_mass)).ravel()
    logs += np.tile(weights, len(i) // len(weights))
    for part in np.array_split(np.arange(len(i)), 100):
        logs[part] += log_likelihood(g[i[part]], at[1, part], answers, at[2, part], at[3, part])
    w = np.bincount(i, normalised(logs), len(r))
    assert compare_with(answers, g, w, d, lambda f: np.zeros(len(f)), 12, None, tie) < 1.2


# ---- prior inequalities
# -----------------------------------------------------------------------------------------


def test_named_inequalities_hold_for_certain() -> None:
    prior = ["e4 >= 2*e2", "e3 - e2 <= 0.1", "e2 >= 0.05"]
    rows = np.array([[0, -2, 0, 1, 0], [0, 1, -1, 0, 0.1], [0, 1, 0, 0, -0.05]])
    for n in (0, 60):
        c = PosteriorComparator(5, prior=prior).update(told(n=60)[:n])
        assert_sane(c)
        assert c.compare(rows).tolist() == [1, 1, 1]
        assert (tail_sums(rows) @ c.draws.gaps >= -1e-9).all()
        assert c.prior is not None
        assert c.prior.names == tuple(prior)


def test_a_prior_with_inequalities_is_the_prior_where_they_hold() -> None:
    rng = np.random.default_rng(1)
    g = drawn_gaps(rng, 4, 400_000)
    g = g[(g[:, 0] >= 0.2) & (g[:, 1] <= 0.3) & (g[:, 2] >= 0.1)]
    d = pairs(rng, 4, 60)
    true = (tail_sums(d) @ g.T > 0).mean(axis=1)
    made = [
        PosteriorComparator(4, prior=["e2 >= 0.2", "e3 - e2 <= 0.3", "e3 <= 0.9"], seed=s)
        for s in range(8)
    ]
    found = np.mean([c.probability(d) for c in made], axis=0)
    assert len(g) > 5000
    off = np.abs(found - true) / np.sqrt(np.maximum(true * (1 - true), 0.01) / (8 * WORTH))
    assert off.max() < 4
    values = np.mean([c.values for c in made], axis=0)
    assert values[1:] == pytest.approx(np.cumsum(g.mean(axis=0)), abs=0.03)


@pytest.mark.slow
def test_a_rare_corner_of_the_prior_is_reached() -> None:
    c = PosteriorComparator(6, prior=[f"e{i} - e{i - 1} >= 0.19" for i in range(2, 6)])
    assert_sane(c)
    g = np.array([0.19, 0.19, 0.19, 0.19, 0.0]) + 0.24 * np.random.default_rng(0).dirichlet(
        np.ones(5), 100_000
    )
    a = np.exp(np.linspace(math.log(0.2), math.log(2.0), 101)) / 5
    logs = (gammaln(5 * a) - 5 * gammaln(a))[:, None] + (a - 1)[:, None] * np.log(g).sum(axis=1)
    mean = normalised(logsumexp(logs, axis=0)) @ g
    assert np.diff(c.values) == pytest.approx(mean, abs=4 * 0.06 / math.sqrt(WORTH))


def test_impossible_or_too_thin_inequalities_are_named() -> None:
    with pytest.raises(ValueError, match=r"e2 >= 0\.9; e3 <= 0\.5"):
        PosteriorComparator(4, prior=["e2 >= 0.9", "e3 <= 0.5"])
    with pytest.raises(ValueError, match=r"e2 >= 0\.5; e2 <= 0\.5, leave too little room"):
        PosteriorComparator(4, prior=["e2 >= 0.5", "e2 <= 0.5"])


def assert_near(
    found: Floats, true: Floats, copies: int, spread: Floats, error: Floats | float, what: str
) -> float:
    """Estimates within four standard errors, that of ``copies`` times 1000 particles and that of
    the reference; the root mean square in such units is returned."""
    sigma = np.sqrt(spread**2 / (copies * WORTH) + np.square(error))
    z = (found - true) / np.maximum(sigma, 2e-3)
    assert np.abs(z).max(initial=0.0) < 4, f"{what}: {found} should be {true}"
    return float((z**2).mean())


def compare_with(
    answers: Answers,
    g: Floats,
    w: Floats,
    d: Floats,
    error: Callable[[Floats], Floats],
    copies: int,
    lapse: float | None,
    tie: float = 0.0,
) -> float:
    """Hold comparators of several seeds to a weighted sample of the posterior; ``error`` gives the
    standard error of that sample's mean of a function (functions, m)."""
    k = answers.k
    made = [
        PosteriorComparator(k, lapse=lapse, tie=tie, seed=seed).update(answers)
        for seed in range(copies)
    ]
    above, levels = (tail_sums(d) @ g.T > 0).astype(np.float64), np.cumsum(g, axis=1).T[:-1]
    p, e = above @ w, levels @ w
    found = np.mean([c.probability(d) for c in made], axis=0)
    spread = np.sqrt(np.maximum(p * (1 - p), 1.0 / WORTH / 4))
    first = assert_near(
        found, p, copies, spread, error(above), f"P(d.e > 0), k = {k}, n = {len(answers)}"
    )
    found_e = np.mean([c.values for c in made], axis=0)[1:-1]
    deviation = np.sqrt(np.maximum(levels**2 @ w - e**2, 0.0))
    second = assert_near(
        found_e, e, copies, deviation, error(levels), f"E(e), k = {k}, n = {len(answers)}"
    )
    return (first + second) / 2


def a_data_set(i: int, most: int) -> tuple[int, Answers, Floats, float, Rng]:
    """Scale and precision from the prior, some answers, a tie among them now and then; 20 pairs."""
    rng = np.random.default_rng([i, 77])
    k, lapse = (3, 4, 5, 6)[i % 4], (0.05, 0.2)[i % 2]
    g, c = drawn_gaps(rng, k)[0], math.exp(min(rng.normal(MEAN, SD), 9.0))
    n = int(rng.integers(1, most + 1))
    return k, answered(rng, pairs(rng, k, n), g, c, lapse, ties=0.1), pairs(rng, k, 20), lapse, rng


@on_any_processor
def test_it_agrees_with_weighted_draws_of_the_prior_on_25_data_sets() -> None:
    squares = []
    for i in range(scaled(4, 25)):  # of each number of levels one at least
        k, answers, d, lapse, rng = a_data_set(i, 12)
        g, _, w = weighted(rng, k, answers, lapse, 60_000)
        size = 1.0 / float((w**2).sum())
        assert size > 300

        def error(f: Floats, w: Floats = w) -> Floats:
            centred = f - (f @ w)[:, None]
            return np.asarray(np.sqrt(centred**2 @ w**2))

        squares.append(compare_with(answers, g, w, d, error, 3, lapse))
    assert math.sqrt(np.mean(squares)) < 1.1


@on_any_processor
@pytest.mark.parametrize("n", quick_first([20, 120], 1))
def test_it_agrees_with_a_grid_where_there_are_three_levels(n: int) -> None:
    """Quadrature over the logit of the first gap and log c."""
    rng = np.random.default_rng(n)
    answers, d = answered(rng, pairs(rng, 3, n), np.array([0.8, 0.2]), 12.0), pairs(rng, 3, 20)
    r, log_c = np.arange(-80.0, 80.0, 0.1), np.arange(MEAN - 4.5 * SD, MEAN + 4.5 * SD, 0.2)
    a = np.exp(np.linspace(math.log(0.2), math.log(2.0), 401)) / 2
    log_g = np.stack([-np.logaddexp(0, -r), -np.logaddexp(0, r)])
    constants = gammaln(2 * a) - 2 * gammaln(a)
    density = logsumexp(constants[:, None] + a[:, None] * log_g.sum(axis=0), axis=0)
    logs = density[:, None] - 0.5 * ((log_c - MEAN) / SD) ** 2
    g = np.exp(log_g).T
    logs += log_likelihood(
        np.repeat(g, len(log_c), axis=0), np.tile(log_c, len(r)), answers, 0.05
    ).reshape(logs.shape)
    w = normalised(logs).sum(axis=1)
    assert compare_with(answers, g, w, d, lambda f: np.zeros(len(f)), 12, 0.05) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("i", range(100, 150))
def test_it_agrees_with_a_long_chain_of_another_sampler_on_50_data_sets(i: int) -> None:
    emcee = pytest.importorskip("emcee")
    k, answers, d, lapse, rng = a_data_set(i, 80)
    a = np.exp(np.linspace(math.log(0.2), math.log(2.0), 101)) / (k - 1)
    constants = gammaln((k - 1) * a) - (k - 1) * gammaln(a)

    def log_density(x: Floats) -> Floats:
        top = x.max(axis=1)
        log_c = top + np.log(np.exp(x - top[:, None]).sum(axis=1))
        log_g = x - log_c[:, None]
        by_shape = constants + a * log_g.sum(axis=1)[:, None]
        most = by_shape.max(axis=1)
        prior = (
            most
            + np.log(np.exp(by_shape - most[:, None]).sum(axis=1))
            - 0.5 * ((log_c - MEAN) / SD) ** 2
        )
        return np.asarray(prior + log_likelihood(np.exp(log_g), log_c, answers, lapse))

    def error(f: Floats) -> Floats:
        means = np.array([part.mean(axis=1) for part in np.array_split(f, 20, axis=1)])
        return np.asarray(means.std(axis=0, ddof=1) / math.sqrt(20))

    walkers = 40
    g, log_c, w = weighted(rng, k, answers, lapse, 60_000)
    chosen = rng.choice(len(w), walkers, p=w)
    start = (
        np.log(g[chosen] + 1e-300) + log_c[chosen, None] + 0.1 * rng.normal(size=(walkers, k - 1))
    )
    sampler = emcee.EnsembleSampler(walkers, k - 1, log_density, vectorize=True)
    sampler.random_state = np.random.RandomState(i).get_state()
    state = sampler.run_mcmc(start, 1000)
    sampler.reset()
    sampler.run_mcmc(state, 3000)
    x = sampler.get_chain(thin=3).reshape(-1, k - 1)  # in order of time
    g = np.exp(x - logsumexp(x, axis=1, keepdims=True))
    assert compare_with(answers, g, np.full(len(g), 1.0 / len(g)), d, error, 4, lapse) < 2.5


@pytest.mark.slow
@pytest.mark.parametrize(("k", "n"), [(5, 40), (10, 40), (10, 300), (20, 40), (20, 300)])
def test_particles_are_worth_about_what_their_effective_size_says(k: int, n: int) -> None:
    said, worth = [], []
    for i in range(4):
        rng = np.random.default_rng([k, n, i])
        g, asked, d = drawn_gaps(rng, k)[0], pairs(rng, k, n), pairs(rng, k, 200)
        answers = answered(rng, asked, g, 3.0 / float(np.std(tail_sums(asked) @ g)))
        made = [PosteriorComparator(k, seed=seed).update(answers) for seed in range(16)]
        said.append(np.mean([c.effective_size for c in made]))
        # how many independent draws would let P(d.e > 0) vary as much from seed to seed
        found = np.array([c.probability(d) for c in made])
        p = found.mean(axis=0)
        unsure = (p > 0.1) & (p < 0.9)
        worth.append(float((p * (1 - p))[unsure].sum() / found.var(axis=0, ddof=1)[unsure].sum()))
    off = np.log(worth) - np.log(said)
    # With 20 levels and 40 answers one set of four is worth a quarter of what is said: 68 of 290,
    # by 64 seeds, not 16.
    assert off.min() > -math.log(5 if (k, n) == (20, 40) else 3), (said, worth)
    assert -math.log(2) < off.mean() < math.log(3), (said, worth)


def ranks(k: int, n: int, replications: int, seed: int) -> tuple[list[str], Floats]:
    """Simulation-based calibration (Talts et al. 2018): the ranks (replications, quantities) of
    what was drawn from the prior among 99 particles of the posterior."""
    fixed = differences(np.random.default_rng(99), k, 1)
    t, out = tail_sums(fixed)[0], []
    for i in range(replications):
        rng = np.random.default_rng([seed, i, k, n])
        g, log_c, lapse = drawn_gaps(rng, k)[0], rng.normal(MEAN, SD), rng.beta(*LAPSE)
        c = PosteriorComparator(k, seed=i).update(
            answered(rng, differences(rng, k, n), g, math.exp(log_c), lapse)
        )
        gaps, weights, precision = c.draws
        pick = rng.choice(len(weights), 99, p=weights)
        # gaps that no vector can tell from none are kept to within e^-60 of the greatest only: they
        # tie
        levels, true = (
            np.maximum(np.cumsum(gaps, axis=0)[:-1, pick], TINY),
            np.maximum(np.cumsum(g)[:-1], TINY),
        )
        ties = rng.integers(0, (levels == true[:, None]).sum(axis=1) + 1)
        below = [
            *((levels < true[:, None]).sum(axis=1) + ties),
            (np.log(precision[pick]) < log_c).sum(),
        ]
        out.append([*below, (t @ gaps[:, pick] < t @ g).sum()])
    return [*(f"e{j}" for j in range(2, k)), "log c", "d.e"], np.array(out)


def assert_uniform(names: list[str], found: Floats) -> None:
    for name, column in zip(names, found.T, strict=True):
        histogram = np.bincount(column // 10, minlength=10)
        assert chisquare(histogram).pvalue > 0.01 / len(names), f"ranks of {name}: {histogram}"


@pytest.mark.slow
def test_ranks_of_the_truth_are_uniform() -> None:
    assert_uniform(*ranks(5, 40, scaled(60, 200), 0))


@pytest.mark.slow
@pytest.mark.parametrize(("k", "n"), [(5, 40), (10, 40), (20, 40)])
def test_ranks_of_the_truth_are_uniform_in_many_replications(k: int, n: int) -> None:
    assert_uniform(*ranks(k, n, 600, 1))


def learned(
    k: int, lapse: float, make: Callable[[Floats, Floats, int], Any], law: str, seed: int
) -> tuple[int, int]:
    """Count the decided and the wrongly decided pairs of a run that asks only about undecided ones.

    Fresh pairs are counted after it.
    """
    rng = np.random.default_rng([seed, k])
    g = np.maximum(
        drawn_gaps(rng, k)[0] if law == "prior" else rng.dirichlet(np.full(k - 1, 0.2)), 1e-9
    )
    e = values_of(g / g.sum())
    e /= e[-1]
    stream, truth = pairs(rng, k, 120), TruthfulTutor(e)
    tutor, c, seen = make(e, stream, seed), PosteriorComparator(k, lapse=lapse), []
    for d in stream:
        verdict = c.compare(d)[0]
        seen.append(verdict)
        if verdict == Verdict.UNKNOWN and len(c.answers) < 40:
            c = c.update(Answers(d[None], tutor.signs(d)))
    v, true = (
        np.array([*seen, *c.compare(fresh := pairs(rng, k, 120))]),
        truth.signs(np.concatenate([stream, fresh])),
    )
    return int((v != 2).sum()), int(((v != 2) & (v != true)).sum())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("k", "tutor", "law"),
    [(5, "logistic", "prior"), (10, "flipping", "prior"), (5, "logistic", "skewed")],
)
def test_what_is_decided_is_seldom_wrong_whichever_questions_were_asked(
    k: int, tutor: str, law: str
) -> None:
    def logistic(e: Floats, d: Floats, seed: int) -> BradleyTerryTutor:
        return BradleyTerryTutor(e, 2.0 / float(np.std(d @ e)), seed)

    def flipping(e: Floats, d: Floats, seed: int) -> FlippingTutor:
        return FlippingTutor(e, 0.1, seed)

    make = {"logistic": logistic, "flipping": flipping}[tutor]
    counts = np.array(
        [
            learned(k, 0.1 if tutor == "flipping" else 0.05, make, law, seed)
            for seed in range(scaled(6, 15))
        ]
    )
    decided, wrong = counts.sum(axis=0)
    assert decided > 0.3 * len(counts) * 240
    assert wrong <= 0.05 * decided


@pytest.mark.slow
def test_a_uniform_prior_is_too_sure_on_skewed_scales_and_the_default_is_not() -> None:
    """Few answers and gaps from Dirichlet(.2): why the default is wide."""
    wrong: dict[tuple[float, float] | None, float] = {}
    decided: dict[tuple[float, float] | None, float] = {}
    for shape in ((1.0, 1.0), None):
        total = np.zeros(2)
        for i in range(50):
            rng = np.random.default_rng([i, 5])
            g = np.maximum(rng.dirichlet(np.full(7, 0.2)), 1e-9)
            g /= g.sum()
            asked, fresh = pairs(rng, 8, 10), pairs(rng, 8, 200)
            answers = answered(rng, asked, g, 2.0 / float(np.std(tail_sums(asked) @ g)), 0.0)
            v, true = (
                PosteriorComparator(8, shape=shape).update(answers).compare(fresh),
                np.sign(tail_sums(fresh) @ g),
            )
            total += [(v != 2).sum(), ((v != 2) & (v != true)).sum()]
        decided[shape], wrong[shape] = total[0], total[1] / total[0]
    assert wrong[(1.0, 1.0)] > 0.05
    assert wrong[None] <= 0.05
    assert decided[None] > 500


@pytest.mark.slow
def test_it_decides_far_more_than_the_box() -> None:
    """At 20 levels and 400 answers of logit sd 2: the paper's literal fit, each resample
    rescaled, and ours with order.
    """
    shares = np.zeros(3)
    for i in range(6):
        rng = np.random.default_rng([i, 20])
        g, asked, fresh = drawn_gaps(rng, 20)[0], pairs(rng, 20, 400), pairs(rng, 20, 300)
        c = 2.0 / float(np.std(tail_sums(asked) @ g))
        answers = answered(rng, asked, g, c, 0.0)
        for j, rule in enumerate((
            PosteriorComparator(20),
            BradleyTerryComparator(20, precision=c, region="box"),
            BradleyTerryComparator(20, precision=c, region="box", monotone=False, prior_strength=0,
                                   rescale=True),
        )):  # fmt: skip
            shares[j] += (rule.update(answers).compare(fresh) != 2).mean() / 6
    ours, box, literal = shares
    assert ours > 0.8
    assert ours > 4 * box
    assert ours > 8 * literal > 0


def chance_by_prior_draws(answers: Answers, d: Floats, tie: float) -> Floats:
    """The probability (n,) of the answer "left" by weighting plain draws from the prior."""
    rng, p, draws = np.random.default_rng(3), answers.k - 1, scaled(120_000, 400_000)
    shape = np.exp(rng.uniform(math.log(0.2 / p), math.log(2.0 / p), draws))
    logs = np.log(rng.standard_gamma(shape[:, None] + 1.0, (draws, p)))
    logs += np.log(rng.random((draws, p))) / shape[:, None]
    gaps = np.exp(logs - logs.max(axis=1, keepdims=True))
    gaps /= gaps.sum(axis=1, keepdims=True)
    precision = np.exp(rng.normal(math.log(30.0), 2.5, draws))
    lapse = rng.beta(1.0, 4.0, draws)
    width = None
    if (answers.y == 0).any():
        width = precision * widths_of(tie, rng.random(draws))

    def left(rows: Floats) -> Floats:
        logits = precision * (tail_sums(rows) @ gaps.T)
        if width is None:
            return np.asarray(lapse / 2 + (1 - lapse) * expit(logits))
        return np.asarray(0.495 * lapse + (1 - lapse) * expit(logits - width))

    told_left, told_right = left(answers.d), left(-answers.d)
    y = answers.y[:, None]
    each = np.where(y > 0, told_left, np.where(y < 0, told_right, 1 - told_left - told_right))
    weights = np.exp(np.log(np.maximum(each, TINY)).sum(axis=0))
    assert weights.sum() ** 2 / (weights**2).sum() > scaled(1000, 2000)
    return np.asarray(left(d) @ weights / weights.sum())


@on_any_processor
@pytest.mark.parametrize("ties", [0.3, pytest.param(0.0, marks=pytest.mark.slow)])
def test_the_probability_of_an_answer_is_that_of_a_plain_sampler(ties):
    rng = np.random.default_rng(11)
    answers = answered(rng, pairs(rng, 4, 25), rng.dirichlet(np.ones(3)), 15.0, 0.1, ties)
    d = pairs(rng, 4, 30)
    particles = scaled(2000, 4000)
    learned = PosteriorComparator(4, particles=particles, tie=0.1).update(answers)
    left, right = learned.answer_probability(d), learned.answer_probability(-d)
    assert np.abs(left - chance_by_prior_draws(answers, d, 0.1)).max() < 0.03
    assert (left + right) == pytest.approx(np.ones(30)) if not ties else (left + right < 1).all()


def test_an_answer_is_never_surer_than_the_lapse_allows():
    d = [[-1.0, 0.0, 1.0]]  # the best against the worst
    known = PosteriorComparator(3, precision=1e6, lapse=0.4)
    assert known.answer_probability(d) == pytest.approx([0.8])
    assert known.probability(d) == [1]
    assert PosteriorComparator(3).answer_probability([[0.0, 0.0, 0.0]]) == pytest.approx([0.5])
    assert PosteriorComparator(3, precision=0).answer_probability(d) == pytest.approx([0.5])
    assert known.answer_probability(np.empty((0, 3))).shape == (0,)
    with pytest.raises(ValueError, match="shape"):
        known.answer_probability([[1.0, -1.0]])
