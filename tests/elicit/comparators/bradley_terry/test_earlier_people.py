"""A prior from earlier people: its density, its draws, what it gains, and what it must not do."""

from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize
from scipy.special import expit, gammaln, logsumexp

from elicit import AnswerLog, Answers, PosteriorComparator
from elicit.comparators.bradley_terry import density as D
from elicit.comparators.bradley_terry import earlier_people
from elicit.comparators.bradley_terry.earlier_people import (
    NEWCOMERS,
    EarlierPeople,
    Kind,
    OwnParticles,
    dirichlet_fit,
    drawn,
    learned_from,
)
from elicit.comparators.bradley_terry.first_particles import LAPSE, PRECISION
from elicit.testing import check_comparator, sample_differences
from tests.noisy_cases import pairs
from tests.thoroughness import on_any_processor, scaled

ALIKE, TOLD = scaled((5, 20), (12, 40))  # people, and answers of each
TWO_KINDS = EarlierPeople(
    6,
    300,
    (
        Kind(0.25, (8.0, 2.0, 1.0), 2.5, 0.4, 1.5, 9.0),
        Kind(0.75, (0.5, 0.5, 3.0), 5.0, 1.2, 0.9, 30.0),
    ),
)


def answered(rng: np.random.Generator, n: int, gaps: Any, c: float, lapse: float) -> Answers:
    """A person's answers to n random pairs."""
    d = pairs(rng, len(gaps) + 1, n)
    worth = d @ np.append(0.0, np.cumsum(gaps))
    left = lapse / 2 + (1 - lapse) * expit(c * worth)
    return Answers(d, np.where(rng.random(n) < left, 1, -1))


def alike(people: int, n: int = 40, seed: int = 0, k: int = 5) -> list[Answers]:
    """Answers of people whose first gap is nearly all that counts."""
    rng = np.random.default_rng([seed, people])
    law = np.append(30.0, np.full(k - 2, 1.5))
    return [answered(rng, n, rng.dirichlet(law), 40.0, 0.05) for _ in range(people)]


@pytest.fixture(scope="module")
def like() -> EarlierPeople:
    """Return the prior learned from twelve people who are alike, or from fewer."""
    particles = scaled(300, 1000)
    found = PosteriorComparator(5, like=alike(ALIKE, TOLD), particles=particles).like
    assert found is not None
    return found


@pytest.mark.parametrize("lapse", [None, 0.05])
def test_the_density_is_the_mixture_that_scipy_computes(lapse: float | None) -> None:
    plain = PosteriorComparator(4, lapse=lapse)
    prior = PosteriorComparator(4, lapse=lapse, like=TWO_KINDS)._prior
    x, work, theta = plain._x, np.empty((2, D.BLOCK)), np.empty(3)
    for at in x[:50]:
        log_c = logsumexp(at[:3])
        g = np.exp(at[:3] - log_c)
        slip = expit(at[3]) if lapse is None else 0.5
        parts = []
        for kind in TWO_KINDS.kinds:
            log = (np.array(kind.shapes) * np.log(g)).sum() + gammaln(sum(kind.shapes))
            log -= gammaln(kind.shapes).sum()
            log += stats.norm.logpdf(log_c, kind.log_precision, kind.log_precision_sd)
            if lapse is None:
                log += stats.beta.logpdf(slip, kind.lapse_a, kind.lapse_b)
            parts.append(log + np.log(0.6 * kind.share))
        shapes = np.exp(np.linspace(*np.log(plain.shape), 2001))
        logs = gammaln(3 * shapes) - 3 * gammaln(shapes) + shapes * np.log(g).sum()
        general = np.log(np.trapezoid(np.exp(logs), dx=1 / 2000))
        general += stats.norm.logpdf(log_c, *PRECISION) + np.log(0.4)
        if lapse is None:
            general += stats.beta.logpdf(slip, *LAPSE)
        wanted = logsumexp([*parts, general]) + 0.5 * np.log(2 * np.pi)
        if lapse is None:  # of the logit
            wanted += np.log(slip * (1 - slip))
        assert D.log_prior(at, prior, theta, work) == pytest.approx(wanted, abs=2e-4)


@pytest.mark.parametrize("settings", [{}, {"lapse": 0.05}, {"prior": ["e2 >= 0.3"]}])
def test_moves_leave_the_first_particles_law_as_it_is(settings: dict[str, Any]) -> None:
    from elicit.comparators.bradley_terry.mcmc import move

    start = PosteriorComparator(4, like=TWO_KINDS, particles=1500, **settings)
    x = start._x.copy()
    with np.errstate(all="ignore"):
        move(x, np.zeros((3, 1)), np.zeros(1, np.bool_), 1, 1.0, start._prior, np.uint64(3), 60)
    fresh = PosteriorComparator(4, like=TWO_KINDS, particles=6000, seed=5, **settings)._x
    assert (x != start._x).any()
    for j in range(x.shape[1]):
        assert stats.ks_2samp(x[:, j], fresh[:, j]).pvalue > 1e-3
    log_c = [logsumexp(each[:, :3], axis=1) for each in (x, fresh)]
    assert stats.ks_2samp(*log_c).pvalue > 1e-3


def test_draws_are_of_the_stated_laws() -> None:
    of, draws = drawn(TWO_KINDS, np.random.default_rng(0), 20_000)
    shares = [(of == i).mean() for i in (-1, 0, 1)]
    assert TWO_KINDS.newcomer == NEWCOMERS / (NEWCOMERS + 6) == 0.4
    np.testing.assert_allclose(shares, [0.4, 0.15, 0.45], atol=1e-3)
    for kind, (log_gaps, log_c, lapse) in zip(TWO_KINDS.kinds, draws, strict=True):
        a = np.array(kind.shapes)
        np.testing.assert_allclose(np.exp(log_gaps).mean(axis=0), a / a.sum(), atol=0.01)
        assert log_c.mean() == pytest.approx(kind.log_precision, abs=0.05)
        assert lapse.mean() == pytest.approx(kind.lapse_a / (kind.lapse_a + kind.lapse_b), abs=0.01)


@pytest.mark.parametrize("a", [[0.1, 0.2], [3.0, 0.5, 20.0], [0.03, 0.03, 0.9, 1.0]])
def test_a_dirichlet_law_is_fitted_as_by_a_general_optimiser(a: list[float]) -> None:
    logs = np.log(np.maximum(np.random.default_rng(0).dirichlet(a, 500), 1e-200)).mean(axis=0)

    def loss(log_a: Any) -> float:
        b = np.exp(log_a)
        return float(gammaln(b).sum() - gammaln(b.sum()) - b @ logs)

    found = dirichlet_fit(logs)
    best = minimize(loss, np.zeros(len(a)), tol=1e-12)
    assert loss(np.log(found)) == pytest.approx(best.fun, abs=1e-6)
    np.testing.assert_allclose(found, np.exp(best.x), rtol=1e-3)


@pytest.mark.parametrize("spread", [0.3, 1.0])
def test_how_far_people_differ_is_told_from_how_little_is_known_of_each(spread: float) -> None:
    """Each one's log c is known up to 1, so that their means are apart by more than they are."""
    log_c = np.repeat(np.linspace(-10, 20, 61), 9)
    first = np.tile((np.arange(9) + 0.5) / 9, 61)
    gaps, lapse = np.log(np.stack([first, 1 - first], axis=1)), np.full(len(first), 0.5)

    def general(at: OwnParticles) -> Any:
        return gammaln(2) + at.log_gaps.sum(axis=1) - 0.5 * ((at.log_c - 5) / 4) ** 2 - np.log(4)

    people = []
    for share in (np.arange(11) + 0.5) / 11:
        mean = stats.norm.ppf(share, 5, np.hypot(spread, 1))
        weights = stats.norm.pdf(log_c, mean, 1) * stats.norm.pdf(log_c, 5, 4)
        people.append(OwnParticles(gaps, log_c, lapse, weights / weights.sum()))
    (kind,) = learned_from(people, 99, general, 0.1, learns_lapse=False, seed=0).kinds
    assert kind.log_precision == pytest.approx(5, abs=0.05)
    assert kind.log_precision_sd == pytest.approx(spread, abs=0.25)


@on_any_processor
def test_people_alike_are_learned_and_their_next_is_known_sooner(like: EarlierPeople) -> None:
    assert (like.people, like.answers) == (ALIKE, TOLD * ALIKE)
    assert sum(kind.share for kind in like.kinds) == pytest.approx(1, abs=1e-3)
    fresh = pairs(np.random.default_rng(1), 5, 200)
    decided, logs = np.zeros((2, 2))
    seeds = scaled(3, 5)
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 99])
        gaps = rng.dirichlet([30.0, 1.5, 1.5, 1.5])
        told, more = (answered(rng, n, gaps, 40.0, 0.05) for n in (8, 200))
        for i, prior in enumerate((None, like)):
            known = PosteriorComparator(5, like=prior).update(told)
            decided[i] += (known.compare(fresh) != 2).mean() / seeds
            chance = known.answer_probability(more.d)
            logs[i] += np.log(np.where(more.y == 1, chance, 1 - chance)).mean() / seeds
    assert decided[1] > decided[0] + 0.1
    assert logs[1] > logs[0] + 0.02


def test_a_person_like_nobody_before_is_learned_all_the_same(like: EarlierPeople) -> None:
    wrong = decided = 0
    fresh = pairs(np.random.default_rng(2), 5, 200)
    for seed in range(scaled(3, 6)):
        rng = np.random.default_rng([seed, 7])
        gaps = rng.dirichlet([1.0, 1.0, 1.0, 30.0])
        known = PosteriorComparator(5, like=like).update(answered(rng, 60, gaps, 40.0, 0.05))
        truth = np.sign(fresh @ np.append(0.0, np.cumsum(gaps)))
        verdicts = known.compare(fresh)
        decided += (verdicts != 2).sum()
        wrong += (verdicts == -truth).sum()
    assert decided > scaled(300, 600)
    assert wrong < 0.05 * decided


@on_any_processor
def test_it_is_one_comparator_like_any_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(earlier_people, "STEPS", scaled(6, earlier_people.STEPS))
    logs = alike(3, n=20)
    first, again = (PosteriorComparator(5, like=logs, particles=200) for _ in range(2))
    assert first.like == again.like
    assert (first.draws.gaps == again.draws.gaps).all()
    assert repr(first) == "PosteriorComparator(k=5, level=0.95, like 3 earlier people, 0 answers)"
    check_comparator(first.update(alike(1, n=30, seed=4)[0]))
    told = alike(1, n=9, seed=4)[0]
    one_by_one = first
    for i in range(len(told)):
        one_by_one = one_by_one.update(told[i : i + 1])
    d = sample_differences(5)
    assert (one_by_one.probability(d) == first.update(told).probability(d)).all()
    back = first.update(told).retract(*told.ids)
    assert (back.probability(d) == first.probability(d)).all()
    passed_on = PosteriorComparator(5, like=first.like, particles=200)
    assert (passed_on.draws.gaps == first.draws.gaps).all()


def test_what_is_learned_depends_neither_on_order_nor_names_nor_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(earlier_people, "STEPS", scaled(6, earlier_people.STEPS))
    logs = alike(3, n=6)
    by_name = dict(zip("abc", logs, strict=True))
    renamed = dict(zip("cab", logs, strict=True))
    turned = dict(reversed(by_name.items()))
    first = PosteriorComparator(5, like=by_name, particles=100)
    for like in scaled((turned, renamed, logs), (turned, renamed, logs, logs[::-1]), (renamed,)):
        assert PosteriorComparator(5, like=like, particles=100).like == first.like
    other = PosteriorComparator(5, like=by_name, particles=100, seed=1)
    assert other.like == first.like
    assert not (other.draws.gaps == first.draws.gaps).all()


def test_several_fits_are_averaged() -> None:
    fits = [
        EarlierPeople(6, 300, TWO_KINDS.kinds),
        EarlierPeople(6, 300, TWO_KINDS.kinds[:1]),
    ]
    found = earlier_people.averaged(fits)
    assert (found.people, found.answers) == (6, 300)
    assert [kind.share for kind in found.kinds] == [0.125, 0.375, 0.125]
    assert [kind[1:] for kind in found.kinds] == [TWO_KINDS.kinds[i][1:] for i in (0, 1, 0)]


@on_any_processor
def test_of_several_deals_of_people_into_kinds_the_likeliest_fit_is_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reached: list[tuple[float, int]] = []
    plain = earlier_people._maximised

    def watched(*given: Any) -> Any:
        found = plain(*given)
        reached.append((found[0], given[4]))
        return found

    monkeypatch.setattr(earlier_people, "_maximised", watched)
    monkeypatch.setattr(earlier_people, "STEPS", scaled(10, earlier_people.STEPS))
    like = PosteriorComparator(5, like=alike(14, n=12), particles=scaled(60, 200)).like
    assert like is not None
    assert len(like.kinds) == 2 * earlier_people.FITS
    runs = earlier_people.DEALS + 1
    assert len(reached) == runs * earlier_people.FITS
    for i in range(0, len(reached), runs):
        *begun, (last, steps) = reached[i : i + runs]
        assert {steps for _, steps in begun} == {earlier_people.FIRST_STEPS}
        assert steps == earlier_people.STEPS
        assert last >= max(found for found, _ in begun) - 1e-3  # expectation-maximisation goes up


def test_nobody_before_is_the_general_prior() -> None:
    plain = PosteriorComparator(5, particles=100)
    for like in ([], {}, [Answers.none(5)]):
        same = PosteriorComparator(5, particles=100, like=like)
        assert same.like is None
        assert (same.draws.gaps == plain.draws.gaps).all()


@pytest.mark.parametrize(
    ("like", "error", "message"),
    [
        (alike(1, n=3)[0], TypeError, r"for one person write like=\[...\]"),
        (AnswerLog(k=5), TypeError, "in a list or in a dict by name, not AnswerLog"),
        ("people.jsonl", TypeError, "not str"),
        ([AnswerLog()], ValueError, "the log of 0 in like= is empty.*leave it out"),
        (3, TypeError, "not 3"),
        ({"ann": [1, 2]}, TypeError, "that of 'ann' is"),
        ({"ann": Answers.none(4)}, ValueError, "'ann' in like= are about 4 levels, not 5"),
        (TWO_KINDS, ValueError, "learned for 4 levels, not 5"),
    ],
)
def test_what_is_no_log_a_person_is_refused(
    like: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        PosteriorComparator(5, like=like)


def test_a_merged_log_of_several_people_is_no_person() -> None:
    d = np.array([[0.5, -1.0, 0.5], [0.2, -0.5, 0.3]])
    both = Answers(d, [1, -1], ["a", "b"], who=["ann", "ben"])
    with pytest.raises(ValueError, match="of several people, 'ann', 'ben': give those of each"):
        PosteriorComparator(3, like=[both])
