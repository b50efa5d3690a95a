"""Several raters of one scale, against a plain Metropolis sampler and simulated people."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.special import betaln, expit, logit, logsumexp

import qlearn
from benchmarks.people.raters import moved
from elicit import Answers, FlippingTutor, PosteriorComparator
from elicit._support.hashing import fold
from elicit.comparators.bradley_terry import (
    earlier_people,
    first_particles,
    mcmc_arrays,
    particle_comparator,
    raters,
)
from elicit.comparators.bradley_terry.first_particles import PRECISION
from tests.noisy_cases import widths_of
from tests.scale_arithmetic import Floats, tail_sums
from tests.thoroughness import on_any_processor, quick_first, scaled

TIE = 0.05
FOUR = np.array([0.0, 0.3, 0.7, 1.0])


def told(n: int, people: dict[str, Any], values: Floats, seed: int) -> Answers:
    """Answers of people, by turns: each is a precision, a lapse, and a width of EQUAL."""
    rng, k, rows, who = np.random.default_rng(seed), len(values), [], []
    y = []
    for i in range(n):
        name = [*people][i % len(people)]
        precision, lapse, width = people[name]
        left, right = rng.dirichlet(np.full(k, 0.7), 2)
        value = float((left - right) @ values)
        better = expit(precision * (value - width))
        worse = expit(precision * (-value - width))
        kinds = 3 if width else 2
        chance = [lapse / kinds + (1 - lapse) * p for p in (better, worse)]
        u = rng.random()
        y.append(1 if u < chance[0] else -1 if u < sum(chance) or not width else 0)
        rows.append(left - right)
        who.append(name)
    return Answers(np.array(rows), y, who=who)


def plain_metropolis(
    answers: Answers, wide: dict[str, bool], chains: int, steps: int, seed: int
) -> dict[str, Floats]:
    """Draws of the same posterior for three levels, from its definition: e2, and by name the log
    precision and the lapse of each rater.

    The log precisions are jointly normal, each with the variance of a single person's, and
    correlated. Many chains take steps of one size.
    """
    names = [*wide]
    r = len(names)
    rng = np.random.default_rng(seed)
    tails = tail_sums(answers.d)
    common = PRECISION[1] ** 2 - raters.SPREAD**2
    law = stats.multivariate_normal(
        np.full(r, PRECISION[0]), common * np.ones((r, r)) + raters.SPREAD**2 * np.eye(r)
    )
    shapes = np.exp(np.linspace(np.log(0.1), np.log(1.0), 41))  # 0.2 / (k - 1) to 2 / (k - 1)
    ends = np.where(np.isin(np.arange(41), [0, 40]), 0.5, 1.0)
    told_alike: dict[tuple[int, int], list[Floats]] = {}
    for row, verdict, who in zip(tails, answers.y, answers.who, strict=True):
        told_alike.setdefault((names.index(str(who)), int(verdict)), []).append(row)
    alike = {key: np.array(rows) for key, rows in told_alike.items()}

    def density(at: Floats) -> Floats:
        middle, log_c = expit(at[:, 0]), at[:, 1 : 1 + r]
        lapse, share = expit(at[:, 1 + r : 1 + 2 * r]), expit(at[:, 1 + 2 * r :])
        # in the logit of e2, so each density is multiplied by e2 (1 - e2)
        # the density of Beta(a, a) at e2, for all shapes a at once
        both = np.log(middle) + np.log1p(-middle)
        logs = (
            np.multiply.outer(shapes - 1, both) + (np.log(ends) - betaln(shapes, shapes))[:, None]
        )
        total = logsumexp(logs, axis=0) + both + law.logpdf(log_c)
        total += (np.log(lapse) + 4 * np.log1p(-lapse)).sum(axis=1)
        total += (np.log(share) + np.log1p(-share)).sum(axis=1)
        for (j, verdict), rows in alike.items():
            value = np.multiply.outer(rows[:, 0], middle) + np.multiply.outer(
                rows[:, 1], 1 - middle
            )
            precision, slip = np.exp(log_c[:, j]), lapse[:, j]
            width = widths_of(TIE, share[:, j]) if wide[names[j]] else 0.0
            better = expit(precision * (value - width))
            worse = expit(precision * (-value - width))
            clear = {1: better, -1: worse, 0: 1 - better - worse}[verdict]
            at_random = 0.5
            if wide[names[j]]:
                at_random = 0.495 if verdict else 0.01
            total += np.log(slip * at_random + (1 - slip) * clear + 1e-300).sum(axis=0)
        return np.asarray(total)

    at = np.concatenate(
        [
            logit(rng.uniform(0.2, 0.8, (chains, 1))),
            rng.normal(PRECISION[0], 1.0, (chains, r)),
            logit(rng.uniform(0.05, 0.4, (chains, r))),
            rng.normal(0.0, 1.0, (chains, r)),
        ],
        axis=1,
    )
    size = np.concatenate([[1.0], np.full(3 * r, 1.2)])
    now, kept = density(at), []
    for step in range(steps):
        some = rng.random(at.shape) < 0.4
        proposal = at + np.where(some, size, 0.0) * rng.normal(size=at.shape)
        new = density(proposal)
        taken = np.log(rng.random(chains)) < new - now
        at, now = np.where(taken[:, None], proposal, at), np.where(taken, new, now)
        if step >= steps // 3 and step % 5 == 0:
            kept.append(at)
    found = np.concatenate(kept)
    return {
        "e2": expit(found[:, 0]),
        **{f"{name} precision": found[:, 1 + j] for j, name in enumerate(names)},
        **{f"{name} lapse": expit(found[:, 1 + r + j]) for j, name in enumerate(names)},
    }


@on_any_processor
@pytest.mark.parametrize("ties", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_posterior_is_that_of_a_plain_sampler(ties: bool) -> None:
    people = {
        "ann": (60.0, 0.05, 0.08 if ties else 0.0),
        "ben": (10.0, 0.05, 0.0),
        "chen": (0.0, 1.0, 0.0),
    }
    answers = told(45, people, np.array([0, 0.3, 1]), seed=3)
    assert (answers.y == 0).any() == ties
    wide = {name: ties and name == "ann" for name in people}
    plain = plain_metropolis(answers, wide, scaled(50, 150), scaled(600, 4000), seed=1)
    found: dict[str, list[float]] = {name: [] for name in plain}
    spreads: dict[str, list[float]] = {name: [] for name in plain}
    for seed in range(scaled(1, 8)):
        ours = PosteriorComparator(3, seed=seed, tie=TIE, raters=True).update(answers)
        gaps, weights = ours._gaps_and_weights
        own = {"e2": gaps[0]}
        for name, (precision, lapse, _) in ours._tutors.items():
            own[f"{name} precision"], own[f"{name} lapse"] = np.log(precision), lapse
        for name, draws in own.items():
            found[name].append(float(draws @ weights))
            spreads[name].append(float(np.sqrt((draws - draws @ weights) ** 2 @ weights)))
    near = scaled(0.25, 0.12)
    for name, draws in plain.items():
        sd = draws.std()
        assert np.mean(found[name]) == pytest.approx(draws.mean(), abs=near * sd), name
        assert np.mean(spreads[name]) == pytest.approx(sd, rel=near), name


FIVE = ("ann", "ben", "chen", "dora", "eve")


@pytest.mark.slow
def test_a_rater_at_random_hardly_moves_the_scale() -> None:
    seeds, each = range(20), 40
    pooled, apart = (
        np.mean([moved(seed, each, raters=raters) for seed in seeds]) for raters in (False, True)
    )
    assert apart < 0.2 * pooled


@on_any_processor
def test_says_who_is_reliable() -> None:
    people = {"ann": (60.0, 0.0, 0.0), "ben": (30.0, 0.1, 0.0), "chen": (0.0, 1.0, 0.0)}
    answers = told(90, people, np.array([0, 0.3, 0.6, 1]), seed=2)
    known = PosteriorComparator(4, seed=1, raters=True, particles=scaled(300, 1000))
    known = known.update(answers)
    found = known.reliability()
    assert {*found} == {"ann", "ben", "chen"}
    assert found["ann"].right > found["ben"].right > found["chen"].right
    assert found["chen"].right_interval[0] < 0.55
    assert found["chen"].lapse > 2 * found["ann"].lapse
    for one in found.values():
        assert one.answers == 30
        for value, (low, high) in (
            (one.right, one.right_interval),
            (one.precision, one.precision_interval),
            (one.lapse, one.lapse_interval),
        ):
            assert low < value < high
        assert "30 answers" in str(one)
    # the answers of one of them: less is known of what the others would say
    d = np.array([[-0.2, 0, 0, 0.2]])
    chances = [known.answer_probability(d, who=name)[0] for name in ("ann", "ben", "chen")]
    assert chances[0] > 0.95
    assert chances[2] < 0.8
    assert known.answer_probability(d)[0] == pytest.approx(np.mean(chances))
    assert known.lapse == pytest.approx(np.mean([one.lapse for one in found.values()]))
    with pytest.raises(ValueError, match="no answers of 'eve' alone are known here, but of"):
        known.answer_probability(d, who="eve")


@on_any_processor
def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    held, n = 0, scaled(2, 40)
    for seed in range(n):
        rng = np.random.default_rng(seed)
        common = rng.normal(PRECISION[0], 0.5)
        people = {
            name: (float(np.exp(rng.normal(common, raters.SPREAD))), rng.beta(1, 4), 0.0)
            for name in FIVE[:3]
        }
        values = np.concatenate([[0], np.cumsum(rng.dirichlet(np.full(3, 0.3)))])
        answers = told(45, people, values, seed)
        known = PosteriorComparator(4, seed=seed, raters=True, particles=300).update(answers)
        for name, (precision, lapse, _) in people.items():
            right = lapse / 2 + (1 - lapse) * expit(raters.NEAR * precision)
            low, high = known.reliability()[name].right_interval
            held += low <= right <= high
    assert stats.binomtest(held, 3 * n, 0.9).pvalue > 0.001


@pytest.mark.parametrize("who", [None, "ann"])
def test_a_single_rater_is_the_same_as_without_raters(who: str | None) -> None:
    answers = told(30, {"ann": (30.0, 0.1, 0.05)}, np.array([0, 0.3, 1]), seed=0)
    answers = Answers(answers.d, answers.y, who=[who] * 30)
    one = PosteriorComparator(3, seed=2).update(answers)
    same = PosteriorComparator(3, seed=2, raters=True).update(answers)
    assert same._x.tobytes() == one._x.tobytes()
    assert same._logs.tobytes() == one._logs.tobytes()
    assert same.reliability() == one.reliability()
    assert [*one.reliability()] == [who]
    both = Answers(answers.d, answers.y, who=["ann", "ben"] * 15)
    pooled = PosteriorComparator(3, seed=2).update(both)
    assert pooled._x.tobytes() == one._x.tobytes()
    assert [*pooled.reliability()] == [None]


@pytest.mark.parametrize("ties", quick_first([0.05, 0.0], 2, older=1))
def test_is_the_same_one_by_one_and_after_a_retraction(ties: float) -> None:
    people = {"ann": (30.0, 0.1, ties), "ben": (30.0, 0.1, ties), "chen": (3.0, 0.1, 0.0)}
    answers = told(24, people, np.array([0, 0.3, 0.5, 1]), seed=1)
    fresh = PosteriorComparator(4, seed=5, particles=100, raters=True)
    at_once, one_by_one = fresh.update(answers), fresh
    for row in range(24):
        one_by_one = one_by_one.update(answers[row : row + 1])
    assert at_once._x.tobytes() == one_by_one._x.tobytes()
    assert at_once._logs.tobytes() == one_by_one._logs.tobytes()
    longer = at_once.update(Answers(-answers.d[:1], [1], ["more"], ["dora"]))
    assert longer.retract("more")._x.tobytes() == at_once._x.tobytes()
    assert [*longer.reliability()] == ["ann", "ben", "chen", "dora"]
    assert [*at_once.reliability()] == ["ann", "ben", "chen"], "the old one still answers as before"


@pytest.mark.parametrize(
    "settings",
    quick_first(
        [{}, {"prior": ["e3 >= 2*e2"]}, {"precision": 30.0}, {"lapse": 0.1}, {"tie": 0.0}],
        5,
        older=2,
    ),
)
def test_what_is_given_is_that_of_every_rater(settings: dict[str, Any]) -> None:
    people = {"ann": (30.0, 0.1, 0.05), "ben": (30.0, 0.1, 0.0)}
    answers = told(40, people, np.array([0, 0.2, 0.6, 1]), seed=1)
    known = PosteriorComparator(
        4, seed=5, raters=True, particles=scaled(200, 500), **settings
    ).update(answers)
    for one in known.reliability().values():
        if "precision" in settings:
            assert one.precision == pytest.approx(30.0)
        if "lapse" in settings:
            assert one.lapse == pytest.approx(0.1)
    if "prior" in settings:
        assert (known.draws.gaps[1] >= known.draws.gaps[0] * (1 - 1e-9)).all()
    assert known.values[1] < 0.4
    assert 0.1 < known.acceptance < 0.9


def test_raters_of_no_precision_are_right_as_a_coin_is() -> None:
    people = {"ann": (30.0, 0.1, 0.05), "ben": (30.0, 0.1, 0.0)}
    answers = told(40, people, np.array([0, 0.2, 0.6, 1]), seed=1)
    nothing = PosteriorComparator(4, precision=0.0, raters=True).update(answers)
    assert nothing.reliability()[None].right == pytest.approx(0.5)


def test_a_step_goes_along_two_different_others_each_two_as_likely() -> None:
    others = np.array([3, 5, 8])
    u, v = (axis.ravel() for axis in np.meshgrid(np.arange(0.05, 1, 0.1), np.arange(0.05, 1, 0.1)))
    first, second = raters._two_of(others, u, v)
    assert (first != second).all()
    for one in others:  # the second is each of the other two for one half of v
        assert np.unique(second[first == one], return_counts=True)[1].std() == 0


def test_refuses_settings_that_do_not_go_together() -> None:
    some = told(4, {"ann": (30.0, 0.1, 0.0)}, np.array([0, 0.3, 1]), seed=0)
    with pytest.raises(ValueError, match="raters=True and like= do not go together"):
        PosteriorComparator(3, raters=True, like=[some])
    with pytest.raises(ValueError, match="raters must be True or False"):
        PosteriorComparator(3, raters="ann")  # type: ignore[arg-type]


@pytest.mark.parametrize("last", [1.0, 0.4])
def test_compiled_code_and_arrays_say_the_same(last: float) -> None:
    rng = np.random.default_rng(4)
    theta = rng.gamma(1.0, 10.0, (4, 30))
    rows = np.ascontiguousarray(tail_sums(rng.dirichlet(np.ones(5), 80) - 0.2).T)
    tied = rng.random(80) < 0.2
    lapse, width = rng.uniform(0.01, 0.5, 30), rng.uniform(0.1, 2.0, 30)
    for wide in (0.0 * width, width):
        arguments = (theta, rows, tied, 80, last, lapse, wide)
        of_arrays = raters._likelihoods_of_arrays(*arguments)
        assert raters.log_likelihoods(*arguments).tobytes() == of_arrays.tobytes()
    own = rng.normal(0.0, 2.0, (30, 3))
    of_arrays = raters._raters_of_arrays(own, 1.0, 4.0)
    assert raters.log_priors_of_raters(own, 1.0, 4.0).tobytes() == of_arrays.tobytes()
    prior = raters.of_the_scale(PosteriorComparator(5, raters=True)._prior)
    x = np.log(theta.T.copy())
    one, other = np.empty((4, 30)), np.empty((4, 30))
    assert (
        raters.log_priors(x, prior, one).tobytes()
        == raters._priors_of_arrays(x, prior, other).tobytes()
    )
    assert one.tobytes() == other.tobytes()


def test_moves_leave_the_prior_as_it_is() -> None:
    m, prior = 1000, raters.of_several(PosteriorComparator(4)._prior, 0.02)
    fresh = PosteriorComparator(4, seed=3, particles=m)
    x = fresh._first_particles(raters.of_the_scale(prior))
    x = np.concatenate([x, *(raters.newcomer(prior, m, seed) for seed in (1, 2))], axis=1)
    none: NDArray[np.int64] = np.zeros(1, dtype=np.int64)
    flat = raters.RaterArrays(
        x.copy(), np.zeros(m), np.zeros(1), np.zeros((3, 1)), none > 0, none, (False, True)
    )
    with np.errstate(all="ignore"):
        raters.move(flat, 1, 1.0, prior, fold(7, 7), 20)
    moved = flat.x
    assert not np.allclose(moved, x)
    for column in range(x.shape[1]):
        assert stats.ks_2samp(moved[:, column], x[:, column]).pvalue > 1e-3, column
    assert mcmc_arrays.log_prior(moved[:, :3].T, 3, raters.of_the_scale(prior))[0].max() < np.inf


class OtherLastBits:
    """NumPy as on another processor: in a fifth of the numbers, a logarithm's last bit differs."""

    rng = np.random.default_rng(0)

    def __getattr__(self, name: str) -> Any:
        function = getattr(np, name)
        return partial(self._of, function) if name in ("exp", "log", "log1p") else function

    def _of(self, function: Any, x: Any) -> Any:
        y = np.asarray(function(x))
        return np.where(self.rng.random(y.shape) < 0.2, np.nextafter(y, np.inf), y)


@pytest.mark.parametrize("of_several", [False, True])
def test_last_bits_of_logarithms_change_no_posterior(
    of_several: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Moves are differences of particles, which make any difference at the start grow."""
    careful, careless = (50.0, 0.02, 0.0), (5.0, 0.3, 0.0)
    answers = told(scaled(45, 90), {"ann": careful, "ben": careless, "eve": careful}, FOUR, 3)

    def learned() -> Any:
        particles = scaled(100, 300)
        known = PosteriorComparator(4, seed=1, particles=particles, raters=of_several)
        known = known.update(answers)
        return [known.proposed, known.accepted, *known.values, *known.draws.precision]

    here = learned()
    other = OtherLastBits()
    for module in (earlier_people, first_particles, particle_comparator):
        monkeypatch.setattr(module, "np", other)
    there = learned()
    assert there != here  # the last bits did differ
    assert there == pytest.approx(here, rel=1e-12, abs=1e-12)


def test_a_learner_asks_the_raters_by_turns() -> None:
    mdp, values = qlearn.random_mdp(12, 3, 4, discount=0.9, seed=2)
    tutors: dict[str, Any] = {
        name: FlippingTutor(values, 0.05, seed=i) for i, name in enumerate(FIVE[:3])
    }
    tutors["eve"] = FlippingTutor(values, 0.5, seed=9)
    known = PosteriorComparator(4, seed=0, particles=scaled(100, 300), raters=True)
    found = qlearn.solve(mdp, tutors, known, tolerance=0.02, max_queries=60, seed=0)
    assert qlearn.policy_loss(mdp, found.policy, values).max() <= found.loss_bound
    names = [*tutors]
    assert found.answers.who == tuple(names[i % 4] for i in range(len(found.answers)))
    assert isinstance(found.comparator, PosteriorComparator)
    assert {*found.comparator.reliability()} == {*names}
    again = qlearn.solve(
        mdp, tutors["ann"], PosteriorComparator(4, raters=True), tolerance=0.1, seed=0
    )
    assert {*again.answers.who} <= {None}
