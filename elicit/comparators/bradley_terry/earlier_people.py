"""A prior learned from earlier people: scales, precisions and lapses that were common among them.

The model is that people are of a few kinds. A kind has a Dirichlet law of the gaps, a normal law of
log c, and a Beta law of the lapse. Expectation-maximisation fits these laws to particles of each
person's own posterior, and in each step reweights the particles by the laws. So the people inform
each other, and a person of erratic answers counts little.

A few people's answers fit many laws almost equally well, and which one is found depends on the
particles. So the fit is made ``FITS`` times, each time to other particles, and the prior's density
is the mean of those of the fits. The particles do not depend on the comparator's seed.

The next person may be unlike everybody before. So the general prior keeps the weight ``NEWCOMERS /
(NEWCOMERS + people)``, which falls with the number of people, as in the urn of Blackwell and
MacQueen (1973).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol, TypeAlias, cast

import numpy as np
from scipy.special import betaln, digamma, gammaln, logsumexp, polygamma

from elicit.model.query import Answers
from elicit.model.scale import Floats

NEWCOMERS = 4.0
"""The general prior has the weight of this many people."""

MOST_KINDS, PEOPLE_A_KIND = (
    3,
    12,
)  # largest number of kinds, and the people needed for each further one
FITS = 4  # fits, each to particles of its own, whose densities are averaged
DEALS, FIRST_STEPS = (
    4,
    8,
)  # random deals of people into kinds at the start of a fit, and steps with each deal
STEPS = 30  # steps of expectation-maximisation from the likeliest deal
NEWTON = 40  # greatest number of Newton steps of a fit of a Dirichlet law
CONVERGED = 1e-12  # relative changes of its parameters below this are rounding
DIGITS = 4  # digits of fitted parameters: processors differ in the last of sixteen
LEAST_SD = 0.1  # least standard deviation of log c within a kind
_LEAST_LAPSE = 1e-4


class HasAnswers(Protocol):
    """The part of an answer log that the option ``like`` reads."""

    def answers(self) -> Answers:
        """Return the answers that a comparator learns from."""


Logs: TypeAlias = Mapping[str, HasAnswers | Answers] | Iterable[HasAnswers | Answers]
"""An answer log, or its Answers, for each of several people; perhaps by name."""


class OwnParticles(NamedTuple):
    """Weighted particles of one person's posterior: logs of gaps (m, p), log c, and lapse."""

    log_gaps: Floats
    log_c: Floats
    lapse: Floats
    weights: Floats


class Kind(NamedTuple):
    """One kind of people: its laws, and its share among the earlier people."""

    share: float
    shapes: tuple[float, ...]  # of the Dirichlet law of the gaps
    log_precision: float
    log_precision_sd: float
    lapse_a: float
    lapse_b: float


class EarlierPeople(NamedTuple):
    """Prior knowledge about the next person, learned from earlier people's answers.

    ``people`` is the number of people, ``answers`` the number of their answers, and ``kinds`` all
    the kinds that the fits have found.
    """

    people: int
    answers: int
    kinds: tuple[Kind, ...]

    @property
    def newcomer(self) -> float:
        """The weight of the general prior, which stands for people unlike the earlier ones."""
        return NEWCOMERS / (NEWCOMERS + self.people)

    def rows(self, learns_lapse: bool) -> Floats:
        """Return the kinds as an array, a row for each, as ``density.among_kinds`` reads them."""
        return np.array(
            [
                [
                    float(np.log((1.0 - self.newcomer) * kind.share))
                    + _constant(kind, learns_lapse),
                    *kind[2:],
                    *kind.shapes,
                ]
                for kind in self.kinds
            ]
        )


def _constant(kind: Kind, learns_lapse: bool) -> float:
    """Return the log of the constants of a kind's densities, without that of a standard normal."""
    shapes = np.array(kind.shapes)
    found = gammaln(shapes.sum()) - gammaln(shapes).sum() - np.log(kind.log_precision_sd)
    if learns_lapse:
        found -= betaln(kind.lapse_a, kind.lapse_b)
    return float(found)


def learned_from(
    people: list[OwnParticles],
    answers: int,
    general: Callable[[OwnParticles], Floats],
    least_shape: float,
    learns_lapse: bool,
    seed: int,
) -> EarlierPeople:
    """Return the kinds of people that best explain the posteriors of several earlier people.

    Parameters
    ----------
    people : list of OwnParticles
        Particles of each person's posterior, equally many for all.
    answers : int
        Number of answers that these people gave.
    general : callable
        Takes particles, and returns the log density (n,) of the general prior at them. The measure
        is that of ``Kind``'s laws, and the constant of a standard normal is left out.
    least_shape : float
        Least parameter of a Dirichlet law.
    learns_lapse : bool
        If False, the lapse is known, and no part of a kind.
    seed : int
        Seed of the random assignments of people to kinds, from which the fit starts ``DEALS``
        times.

    Returns
    -------
    EarlierPeople
    """
    n, m = len(people), len(people[0].weights)
    pooled = OwnParticles(*(np.concatenate(parts) for parts in zip(*people, strict=True)))
    lapse = np.clip(pooled.lapse, _LEAST_LAPSE, 1.0 - _LEAST_LAPSE)
    pooled = pooled._replace(lapse=lapse, weights=np.log(np.maximum(pooled.weights, 1e-300)))
    before = general(pooled)
    count = min(MOST_KINDS, 1 + n // PEOPLE_A_KIND)
    rng, held = np.random.default_rng(seed), np.exp(pooled.weights)

    def fitted(kinds: list[Kind], steps: int) -> tuple[float, list[Kind]]:
        return _maximised(pooled, before, kinds, n, steps, least_shape, learns_lapse)

    begun = []
    for _ in range(DEALS if count > 1 else 1):
        dealt = np.repeat(rng.permutation(n) % count, m) == np.arange(count)[:, None]
        begun.append(fitted(_fitted(pooled, held * dealt, least_shape, learns_lapse), FIRST_STEPS))
    _, likeliest = max(begun, key=lambda fit: round(fit[0], 6))
    _, kinds = fitted(likeliest, STEPS)
    return EarlierPeople(n, answers, tuple(_rounded(kind) for kind in kinds))


def averaged(fits: list[EarlierPeople]) -> EarlierPeople:
    """Return the prior whose density is the mean of those of several fits to the same people."""
    kinds = tuple(
        kind._replace(share=_short(kind.share / len(fits))) for fit in fits for kind in fit.kinds
    )
    return fits[0]._replace(kinds=kinds)


def _maximised(
    pooled: OwnParticles,
    before: Floats,
    kinds: list[Kind],
    n: int,
    steps: int,
    least_shape: float,
    learns_lapse: bool,
) -> tuple[float, list[Kind]]:
    """Run ``steps`` of expectation-maximisation; return the log-likelihood and the new kinds.

    The log-likelihood is that of the kinds before the last step, up to a constant, for n people.
    """
    newcomer, found = NEWCOMERS / (NEWCOMERS + n), 0.0
    for _ in range(steps):
        parts = np.stack(
            [
                np.log((1.0 - newcomer) * kind.share) + _log_density(kind, pooled, learns_lapse)
                for kind in kinds
            ]
            + [np.log(newcomer) + before]
        )
        total = logsumexp(parts, axis=0)
        logs = (pooled.weights + total - before).reshape(n, -1)
        own = logsumexp(logs, axis=1, keepdims=True)
        weights, found = np.exp(logs - own).ravel(), float(own.sum())
        kinds = _fitted(pooled, weights * np.exp(parts[:-1] - total), least_shape, learns_lapse)
    return found, kinds


def _log_density(kind: Kind, at: OwnParticles, learns_lapse: bool) -> Floats:
    """Return the log density (n,) of a kind at particles.

    It is the density of the logs of the gaps, of log c, and of the logit of the lapse.
    """
    found = _constant(kind, learns_lapse) + at.log_gaps @ np.array(kind.shapes)
    found -= 0.5 * ((at.log_c - kind.log_precision) / kind.log_precision_sd) ** 2
    if learns_lapse:
        found += kind.lapse_a * np.log(at.lapse) + kind.lapse_b * np.log1p(-at.lapse)
    return np.asarray(found)


def _fitted(at: OwnParticles, held: Floats, least_shape: float, learns_lapse: bool) -> list[Kind]:
    """Return the most likely kinds, if the particles belong to each with weights (kinds, n)."""
    kinds, most = [], held.sum()
    for part in held:
        total = part.sum()
        part = part / total
        shapes = np.maximum(dirichlet_fit(part @ at.log_gaps), least_shape)
        mean = float(part @ at.log_c)
        sd = float(np.sqrt(part @ (at.log_c - mean) ** 2 + LEAST_SD**2))
        lapse = (1.0, 1.0)
        if learns_lapse:
            logs = np.array([part @ np.log(at.lapse), part @ np.log1p(-at.lapse)])
            lapse = tuple(dirichlet_fit(logs).tolist())
        # one person's worth of weight is spread over all kinds, so that none dies out
        share = (total + 1.0 / len(held)) / (most + 1.0)
        kinds.append(Kind(float(share), tuple(shapes.tolist()), mean, sd, *lapse))
    return kinds


def dirichlet_fit(mean_logs: Floats) -> Floats:
    """Return the maximum-likelihood parameters (p,) of a Dirichlet law (Minka 2000).

    The method is Newton steps.

    Parameters
    ----------
    mean_logs : (p,)
        Means of the logs of the shares.

    Returns
    -------
    (p,)
    """
    a = np.full(len(mean_logs), 0.5)
    for _ in range(NEWTON):
        slope = digamma(a.sum()) - digamma(a) + mean_logs
        curve, common = -polygamma(1, a), polygamma(1, a.sum())
        shared = (slope / curve).sum() / (1.0 / common + (1.0 / curve).sum())
        step = (slope - shared) / curve
        before, a = a, np.where(a > step, a - step, a / 2.0)
        if (np.abs(a - before) <= CONVERGED * before).all():
            break
    return np.asarray(a)


def _rounded(kind: Kind) -> Kind:
    """Return a kind with its numbers rounded to ``DIGITS`` digits."""
    return Kind(
        _short(kind.share), tuple(_short(shape) for shape in kind.shapes), *map(_short, kind[2:])
    )


def _short(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")


def drawn(
    earlier: EarlierPeople, rng: np.random.Generator, m: int
) -> tuple[Floats, list[tuple[Floats, Floats, Floats]]]:
    """Draw m people: the kind of each, and for each kind the parameters of its people.

    Returns
    -------
    kinds : (m,)
        The number of each person's kind; -1 for a person who is unlike the earlier ones.
    draws : list of (log_gaps (q, p), log_c (q,), lapse (q,))
        An entry for each kind, with a row for each of the q people drawn from it.
    """
    bounds = earlier.newcomer + (1.0 - earlier.newcomer) * np.cumsum(
        [0.0, *(kind.share for kind in earlier.kinds)]
    )
    spread = (rng.permutation(m) + rng.random(m)) / m  # stratified
    of = np.minimum(np.searchsorted(bounds, spread, side="right") - 1, len(earlier.kinds) - 1)
    draws = []
    for i, kind in enumerate(earlier.kinds):
        q, a = int((of == i).sum()), np.array(kind.shapes)
        draws.append(
            (
                log_dirichlet(rng, np.broadcast_to(a, (q, len(a)))),
                rng.normal(kind.log_precision, kind.log_precision_sd, q),
                rng.beta(kind.lapse_a, kind.lapse_b, q),
            )
        )
    return of, draws


def log_dirichlet(rng: np.random.Generator, shapes: Floats) -> Floats:
    """Return logs (m, p) of draws from Dirichlet laws with parameters (m, p).

    The logarithm is drawn directly, because a gamma variate of a small shape may underflow.
    """
    x = np.log(rng.standard_gamma(shapes + 1.0)) + np.log(rng.random(shapes.shape)) / shapes
    x -= x.max(axis=1, keepdims=True)
    x -= np.log(np.exp(x).sum(axis=1, keepdims=True))
    return np.asarray(x)


def answers_of_each(people: Logs, k: int) -> list[Answers]:
    """Return each person's answers, over k levels. Raise TypeError or ValueError."""
    wanted = "like= takes one AnswerLog or Answers a person, in a list or in a dict by name"
    if isinstance(people, (str, bytes, Answers)) or hasattr(people, "answers"):
        raise TypeError(f"{wanted}, not {type(people).__name__}: for one person write like=[...]")
    if not isinstance(people, Iterable):
        raise TypeError(f"{wanted}, not {people!r}")
    by_name = people if isinstance(people, Mapping) else dict(enumerate(people))
    found = []
    for name, log in by_name.items():
        if not isinstance(log, Answers) and not callable(getattr(log, "answers", None)):
            raise TypeError(f"{wanted}, but that of {name!r} is {log!r}")
        if getattr(log, "k", k) is None:
            raise ValueError(
                f"the log of {name!r} in like= is empty, so that nothing can be learned from it: "
                "leave it out"
            )
        answers = log if isinstance(log, Answers) else cast(HasAnswers, log).answers()
        if answers.k != k:
            raise ValueError(
                f"the answers of {name!r} in like= are about {answers.k} levels, not {k}"
            )
        whose = [who for who in dict.fromkeys(answers.who) if who is not None]
        if len(whose) > 1:
            raise ValueError(
                f"the answers of {name!r} in like= are of several people, "
                f"{', '.join(map(repr, whose))}: give those of each (Answers.of_person)"
            )
        found.append(answers)
    # the result must depend neither on the order of people nor on their names
    return sorted(found, key=lambda one: (one.d.tobytes(), one.y.tobytes()))
