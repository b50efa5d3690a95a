"""The Bayesian comparator for a noisy tutor: particles over scales and the tutor's precision.

The likelihood is the paper's eq. (6) with a lapse: P(the answer is "left is better") = lapse/2 + (1
- lapse) sigma(c d.e). The prior knows the order of the levels, and is wide enough for scales with a
few large gaps. The precision c and the lapse are learned unless they are given. From the first
EQUAL on, the tutor is modelled as calling equal what is closer than some width (Rao and Kupper
1967; see ``density``). The width is learned too.

A comparison is decided if one sign has posterior probability ``level``. Of the comparisons decided
in this way at most 1 - level are wrong, on average over the prior, whichever questions were asked.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Iterable
from functools import cached_property
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaln, expit, logsumexp

from elicit._support.fixed_order import product
from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.keywords import check_keywords
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, is_range, is_whole, require
from elicit.comparators.bradley_terry.density import EQUAL_LAPSES, ParticlePrior
from elicit.comparators.bradley_terry.earlier_people import (
    FITS,
    EarlierPeople,
    Logs,
    OwnParticles,
    answers_of_each,
    averaged,
    learned_from,
)
from elicit.comparators.bradley_terry.first_particles import (
    CONCENTRATION,
    LAPSE,
    PRECISION,
    first_particles,
    prior_law,
)
from elicit.comparators.bradley_terry.raters import (
    RaterArrays,
    Reliability,
    Several,
    newcomer,
    of_several,
    of_the_scale,
    parameters,
    reliability_of,
)
from elicit.comparators.bradley_terry.raters import learn as learn_of_several
from elicit.comparators.bradley_terry.smc import ParticleArrays, effective_size, learn, thetas
from elicit.decision.comparator_rule import Rule, weighted
from elicit.decision.draw_bounds import quantiles, upper_together
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.hit_and_run import Draws
from elicit.lp.prior_inequalities import PriorLike, as_prior
from elicit.model.comparator import TIE, Verdicts, check_answers, check_levels, check_tie
from elicit.model.difference import as_differences, tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats, dot, order_bounds, values_of

WORN = 0.02  # below this effective size, a share of the particles, a warning is raised
_FAR = 1e12  # tail sums are clipped to it for the likelihood
_SHAPES = (1e-9, 1e9)
"""Range of the prior's shapes. Beyond it logarithms of gaps overflow, or all gaps are equal."""
PARTICLES = 1000
"""Default number of particles."""

_PEOPLE = name_code("earlier people")


class ParticleOptions(TypedDict, total=False):
    """Rarely needed keywords of ``PosteriorComparator``.

    Attributes
    ----------
    particles : int
        Number of particles. Default 1000.
    shape : (low, high), optional
        A priori the gaps are Dirichlet(a), with log a uniform between the logs of these two. None:
        the two of ``CONCENTRATION``, each divided by k - 1. (1, 1) is uniform, and overconfident on
        scales with a few large gaps.
    raters : bool
        True if several people answer about one scale, and may differ in precision, lapse and width
        of EQUAL. ``Answers.who`` names the person of each answer. Then each person's parameters are
        learned, and answers of a careless person count less: ``reliability`` says how reliable each
        is. False, the default: all answers are taken as one person's. The two settings give the
        same results until a second name comes up.
    """

    particles: int
    shape: tuple[float, float] | None
    raters: bool


class Degenerate(RuntimeWarning):
    """Warning that only a few particles carry the weight, so that probabilities are unreliable."""


class PosteriorComparator:
    """Decides a difference if one sign of d.e has posterior probability ``level``.

    The comparator is a frozen value, and a function of (answers in the given order, seed, settings)
    alone. Learning answers one by one or all at once gives the same. ``elicit.Comparator`` says
    what its methods take and return.

    Parameters
    ----------
    k : int
        Number of levels.
    precision : float, optional
        The c of the paper's eq. (6), in logits per unit of d.e. None: learned, with log c ~ N(log
        30, 2.5^2) a priori.
    lapse : float, optional
        Share of answers given at random. A tutor who flips a tenth of all answers lapses in a
        fifth, because half of the random answers are right. None: learned, with Beta(1, 4) a
        priori.
    tie : float
        Median a priori of the width of EQUAL: the |d.e| up to which the tutor calls two things
        equal. It is a share of the value range e_k - e_1, in 0 <= tie < 1. Here d is a difference
        of share vectors, used as it is given. The true width is learned, because people do not know
        their own. A priori its logarithm is logistic with scale 1, so the width is with 95%
        probability between 1/39 and 39 times ``tie``. Nothing depends on ``tie`` until the first
        EQUAL, because a tutor who has called nothing equal is taken as sharp. Then all answers are
        learned afresh. 0: EQUAL means equal, and counts as half an answer each way.
    level : float
        Posterior probability that a verdict needs, in (1/2, 1).
    prior : optional
        Inequalities that hold for certain: (A, b) with A e >= b, texts such as "e4 >= 2*e2", or
        linear cvxpy constraints over ``elicit.scale_variable(k)``. For texts that use the levels'
        own names see ``elicit.inequalities(texts, labels=...)``.
    seed : int, SeedSequence, Generator or None
        Kept as an int. None draws a new one.
    like : logs of earlier people, optional
        An ``AnswerLog`` or ``Answers`` of each earlier person, in a list or in a dict by name.
        Scales, precisions and lapses that were common among them are then likelier a priori. The
        general prior keeps the weight of four people, because the next person may be like none of
        them. Learning this takes several times as long as learning all their answers. You may also
        give the ``like`` of another comparator of the same k. The order and the names of the people
        do not matter, nor does the seed.
    **options
        ``particles``, ``shape`` and ``raters``: see ``ParticleOptions``.

    Attributes
    ----------
    like : EarlierPeople or None
        The prior learned from earlier people.

    Raises
    ------
    ValueError
        If a setting is out of range, or a log is about another number of levels.
    TypeError
        For an unknown keyword, or if ``like`` is not a log for each person.
    """

    def __init__(
        self,
        k: int,
        precision: float | None = None,
        lapse: float | None = None,
        level: float = 0.95,
        prior: PriorLike = None,
        seed: Seed | None = 0,
        tie: float = TIE,
        like: Logs | EarlierPeople | None = None,
        **options: Unpack[ParticleOptions],
    ) -> None:
        check_keywords(type(self), options, ParticleOptions.__annotations__)
        particles, shape = options.get("particles", PARTICLES), options.get("shape")
        raters = options.get("raters", False)
        self.k = check_levels(k)
        known = precision is None or is_number(precision, 0)
        require(known, "precision", "None or a finite number of at least 0", precision)
        known = lapse is None or (is_number(lapse, 0) and lapse < 1)
        require(known, "lapse", "None or a number of at least 0 and below 1", lapse)
        require(is_number(level) and 0.5 < level < 1, "level", "strictly between 1/2 and 1", level)
        require(is_whole(particles, 20), "particles", "a whole number of at least 20", particles)
        require(isinstance(raters, bool), "raters", "True or False", raters)
        if raters and like is not None:
            raise ValueError(
                "raters=True and like= do not go together: of earlier people only the law of "
                "single ones is known. Leave one of them out"
            )
        if shape is None:
            shape = (CONCENTRATION[0] / (self.k - 1), CONCENTRATION[1] / (self.k - 1))
        wanted = f"None or two numbers, {_SHAPES[0]:g} <= low <= high <= {_SHAPES[1]:g}"
        require(is_range(shape, *_SHAPES), "shape", wanted, shape)
        seed = seed_of(seed)
        key = key_of(seed)  # a Generator is drawn from once, here
        self.seed = int(seed) if isinstance(seed, (int, np.integer)) else key
        self.level, self.particles, self.shape, self.tie = (
            float(level),
            int(particles),
            (float(shape[0]), float(shape[1])),
            check_tie(tie),
        )
        self.raters = raters
        self.given_precision = None if precision is None else float(precision)
        self.given_lapse = None if lapse is None else float(lapse)
        self.prior = as_prior(prior, self.k)
        self._key = np.uint64(key)
        self._prior = prior_law(
            self.k, self.shape, self.given_precision, self.given_lapse, self.prior
        )
        self.like: EarlierPeople | None = None
        self._forget()
        if like is not None:
            self._like(like)

    def __repr__(self) -> str:
        like = f", like {self.like.people} earlier people" if self.like else ""
        return (
            f"PosteriorComparator(k={self.k}, level={self.level:g}{like}, "
            f"{len(self.answers)} answers)"
        )

    def _like(self, people: Logs | EarlierPeople) -> None:
        """Learn the prior from earlier people, or take over a learned one, and start from it."""
        if isinstance(people, EarlierPeople):
            found, known = people, [len(kind.shapes) + 1 for kind in people.kinds]
            if known[0] != self.k:
                raise ValueError(f"like= was learned for {known[0]} levels, not {self.k}")
        else:
            told = [answers for answers in answers_of_each(people, self.k) if len(answers)]
            if not told:
                return
            found = averaged(
                [
                    learned_from(
                        [self._own_particles((fit, i), own) for i, own in enumerate(told)],
                        sum(map(len, told)),
                        self._general,
                        self.shape[0],
                        self.given_lapse is None,
                        fit,
                    )
                    for fit in range(FITS)
                ]
            )
        general = math.log(found.newcomer) - math.log(2.0) - math.log(PRECISION[1])
        if self.given_lapse is None:
            general -= float(betaln(*LAPSE))
        kinds = np.ascontiguousarray(found.rows(self.given_lapse is None))
        self.like, self._prior = found, self._prior._replace(general=general, kinds=kinds)
        self._forget()

    def _own_particles(self, number: tuple[int, int], answers: Answers) -> OwnParticles:
        """Return an earlier person's posterior from their answers, under the general prior.

        ``number``, which stands for the fit and the person, seeds the particles. The comparator's
        seed does not, so that comparators of all seeds learn the same prior.
        """
        own = copy.copy(self)
        own._key = np.uint64(fold(np.uint64(_PEOPLE), *number))
        own._forget()
        own = own.update(answers)
        x = own._x[:, : self.k - 1]
        log_c = logsumexp(x, axis=1)
        lapse = expit(own._x[:, self.k - 1]) if self.given_lapse is None else own._slips[0]
        return OwnParticles(x - log_c[:, None], log_c, lapse, own._gaps_and_weights[1])

    def _general(self, at: OwnParticles) -> Floats:
        """Return the log density (n,) of the general prior, the one without earlier people.

        The constant of a standard normal is left out. The coordinates are the logs of gaps, log c,
        and the logit of a learned lapse.
        """
        prior = self._prior
        logs = prior.constants[:, None] + prior.shapes[:, None] * at.log_gaps.sum(axis=1)
        found = logsumexp(logs, axis=0) - math.log(2.0)
        found -= 0.5 * ((at.log_c - prior.mean) / prior.sd) ** 2 + math.log(prior.sd)
        if self.given_lapse is None:
            a, b = LAPSE
            found += a * np.log(at.lapse) + b * np.log1p(-at.lapse) - betaln(a, b)
        return np.asarray(found)

    def _forget(self) -> None:
        """Reset the comparator to its prior."""
        self.answers = Answers.none(self.k)
        self._rows, self._tied = np.zeros((self.k - 1, 0)), np.zeros(0, dtype=np.bool_)
        self._start(0.0)
        self._several: Several | None = None

    def _start(self, tie: float) -> None:
        """Draw particles from the prior, with ``tie`` as the median width of EQUAL."""
        self._prior = self._prior._replace(tie=tie)
        self._begin(self._first_particles(self._prior))
        self._theta, self._slips = (
            np.empty((self.k - 1, self.particles)),
            np.empty((2, self.particles)),
        )
        thetas(self._x, self._prior, self._theta, self._slips)

    def _begin(self, x: Floats) -> None:
        """Set x as the particles of a comparator that has learned no answer."""
        self.proposed = self.accepted = 0
        self._x, self._logs = x, np.zeros(self.particles)
        self._noise = np.full(1, 1.0 / self.particles)

    def update(self, answers: Answers) -> PosteriorComparator:
        """Return a comparator that also knows these answers, learned in the given order."""
        check_answers(answers, self.k)
        new = copy.copy(self)
        for name in ("_gaps_and_weights", "values"):
            new.__dict__.pop(name, None)
        new.answers = self.answers + answers
        if self.given_precision == 0 or not len(answers):
            return new
        t = tail_sums(answers.d) * np.where(answers.y == 0, 1, answers.y)[:, None]
        size = np.abs(t).max(axis=1, keepdims=True)
        t = np.where(
            size > _FAR, t / np.where(size > 0, size, 1.0) * _FAR, t
        )  # no answer can be surer than this
        n = self._rows.shape[1]
        new._rows = np.ascontiguousarray(np.concatenate([self._rows, t.T], axis=1))
        new._tied = np.concatenate([self._tied, answers.y == 0])
        new._x, new._theta, new._slips = self._x.copy(), self._theta.copy(), self._slips.copy()
        new._logs, new._noise = self._logs.copy(), self._noise.copy()
        for i in range(n, n + len(answers)):
            if self.raters and len(set(new.answers.who[: i + 1])) > 1:
                new._learn_of_several(i)
                continue
            if new._tied[i] and new._prior.tie == 0 < self.tie:  # the first EQUAL
                new._start(self.tie)
                new._learn(range(i))
            new._learn(range(i, i + 1))
        if new.effective_size < WORN * self.particles:
            warnings.warn(
                f"after {len(new.answers)} answers the {self.particles} particles are worth only "
                f"{new.effective_size:.0f} draws: take more particles, or leave the lapse to be "
                "learned if the answers "
                "contradict each other",
                Degenerate,
                stacklevel=2,
            )
        return new

    def _learn(self, rows: Iterable[int]) -> None:
        """Learn the answers with these row numbers, one by one."""
        state = ParticleArrays(
            self._x, self._theta, self._slips, self._logs, self._noise, self._rows, self._tied
        )
        for i in rows:
            with np.errstate(all="ignore"):  # the hash wraps around
                proposed, accepted = learn(state, i + 1, self._prior, fold(self._key, i)[()])
            self.proposed, self.accepted = self.proposed + proposed, self.accepted + accepted

    def _learn_of_several(self, last: int) -> None:
        """Learn the answer in row ``last``, which is from one of several raters.

        All answers are learned afresh once there are two raters, and at the first EQUAL of each.
        """
        who, rows = self.answers.who, range(last, last + 1)
        tied = self.tie > 0 and bool(self._tied[last])
        wide = {who[i] for i in np.flatnonzero(self._tied[: last + 1])} if self.tie > 0 else set()
        known = self._several
        prior = of_several(self._prior, self.tie)
        if known is None or (tied and dict(zip(*known, strict=True)).get(who[last]) is False):
            self._begin(self._first_particles(of_the_scale(prior)))
            known, rows = Several((), ()), range(last + 1)
        for i in rows:
            if who[i] not in known.names:
                seed = int(fold(self._key, _PEOPLE, len(known.names)))
                own = newcomer(prior, self.particles, seed)
                self._x = np.ascontiguousarray(np.concatenate([self._x, own], axis=1))
                known = Several((*known.names, who[i]), (*known.wide, who[i] in wide))
            by = np.array([known.names.index(one) for one in who[: i + 1]])
            state = RaterArrays(
                self._x, self._logs, self._noise, self._rows, self._tied, by, known.wide
            )
            proposed, accepted = learn_of_several(state, i + 1, prior, fold(self._key, i))
            self.proposed, self.accepted = self.proposed + proposed, self.accepted + accepted
        self._several = known
        thetas(self._x, of_the_scale(prior), self._theta, self._slips)

    @property
    def _tutors(self) -> dict[str | None, tuple[Floats, Floats, Floats]]:
        """The precision, lapse and width of EQUAL, in each particle, of each person by name."""
        precision, known = self.draws.precision, self._several
        if known is None:
            names = set(self.answers.who)
            name = names.pop() if len(names) == 1 else None
            return {name: (precision, *self._slips)}
        prior = of_several(self._prior, self.tie)
        found = {}
        for i, (name, wide) in enumerate(zip(*known, strict=True)):
            factor, lapse, width = parameters(self._x, precision, i, wide, prior)
            found[name] = factor * precision, lapse, width
        return found

    def reliability(self) -> dict[str | None, Reliability]:
        """Return how reliable each person is, by name, with intervals.

        Returns
        -------
        dict of str to Reliability
            With ``raters=True`` an entry for each person who has answered. Otherwise, and as long
            as there is one person, a single entry. Its name is None if answers name nobody, or if
            several people's answers are taken as one person's.
        """
        weights, who = self._gaps_and_weights[1], self.answers.who
        tutors = self._tutors
        return {
            name: reliability_of(
                precision,
                lapse,
                weights,
                len(who) if len(tutors) == 1 else who.count(name),
                self.level,
            )
            for name, (precision, lapse, _) in tutors.items()
        }

    def retract(self, *ids: str) -> PosteriorComparator:
        """Return a comparator without the answers of these ids, as if they had never been given.

        Parameters
        ----------
        *ids : str

        Returns
        -------
        PosteriorComparator
            It has learned the remaining answers afresh.

        Raises
        ------
        ValueError
            For an id that is not among the answers.
        """
        others, fresh = self.answers.without(ids), copy.copy(self)
        fresh._forget()
        return fresh.update(others)

    @property
    def answers_to_next_step(self) -> int:
        """Number of further answers until verdicts may change: 1, since each changes weights."""
        return 1

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences.

        Dominance decides first, then the sign that has probability ``level``.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) int8 verdicts
        """
        return decide_by_rule(self.rule, as_differences(d, self.k)).verdicts

    @property
    def rule(self) -> Rule:
        """The particles as plain arrays for compiled loops."""
        return weighted(*self._gaps_and_weights, self.level)

    def probability(self, d: ArrayLike) -> Floats:
        """Return P(d.e > 0 | answers).

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        (n,) probabilities
        """
        gaps, weights = self._gaps_and_weights
        shares = [weights[dot(t, gaps.T) > 0].sum() for t in tail_sums(as_differences(d, self.k))]
        return np.asarray(np.minimum(shares, 1.0))  # a sum of weights may exceed 1 by rounding

    def answer_probability(self, d: ArrayLike, who: str | None = None) -> Floats:
        """Return the probability that the tutor's next answer is "left is better".

        It is averaged over the posterior of scale, precision, lapse and width of EQUAL. In
        contrast, ``probability`` is the probability that left *is* better. That may be near 1
        although the tutor often errs.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.
        who : str, optional
            The person asked, if there are several raters. None: any of them, with equal
            probability.

        Returns
        -------
        (n,) probabilities
            That of "right is better" is ``answer_probability(-d)``. The two total 1 until the tutor
            calls something EQUAL. From then on the rest is the probability of "equal".

        Raises
        ------
        ValueError
            If ``who`` has not answered yet, or several people's answers are taken as one person's.
        """
        gaps, weights = self._gaps_and_weights
        tutors = self._tutors
        if who is not None:
            if who not in tutors:
                raise ValueError(
                    f"no answers of {who!r} alone are known here, but of "
                    f"{', '.join(map(repr, tutors))}"
                )
            tutors = {who: tutors[who]}
        found = np.zeros(len(t := tail_sums(as_differences(d, self.k))))
        for precision, lapse, width in tutors.values():
            share = np.where(width > 0, 0.5 * (1.0 - EQUAL_LAPSES), 0.5)
            chances = (
                share * lapse + (1.0 - lapse) * expit(precision * dot(row, gaps.T) - width)
                for row in t
            )
            found += [min(1.0, float(product(chance, weights))) for chance in chances]
        return np.asarray(found / len(tutors))

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return two quantiles of d.e: 1 - ``level`` and ``level``.

        If the first is above 0, the verdict is BETTER.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of e_k - e_1
        """
        gaps, weights = self._gaps_and_weights
        t = tail_sums(as_differences(d, self.k))
        low, high = np.empty(len(t)), np.empty(len(t))
        for i, row in enumerate(t):
            low[i], high[i] = quantiles(dot(row, gaps.T), weights, self.level)
        least, greatest = order_bounds(t, 0.0)
        return np.clip(low, least, greatest), np.clip(high, least, greatest)

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e that hold for all rows at once, and the probability of that.

        The particles with the greatest d.e of any row are left out, up to the weight 1 - ``level``.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        probability : float
            Posterior probability that all of them hold.
        """
        gaps, weights = self._gaps_and_weights
        at = product(tail_sums(as_differences(d, self.k)), gaps)
        if not len(at):
            return np.empty(0), 1.0
        return upper_together(at, weights, self.level), self.level

    @cached_property
    @one_thread
    def values(self) -> Floats:
        """The posterior mean (k,) of the scale, from 0 to 1; read-only."""
        gaps, weights = self._gaps_and_weights
        values = values_of(product(gaps, weights))
        values /= values[-1]
        values.flags.writeable = False
        return values

    @property
    @one_thread
    def precision(self) -> float:
        """The precision c: as given, or exp of the posterior mean of log c.

        With several raters it is the common precision, around which theirs vary.
        """
        if self.given_precision is not None:
            return self.given_precision
        return float(np.exp(product(np.log(self.draws.precision), self.draws.weights)))

    @property
    def lapse(self) -> float:
        """The share of answers given at random: as given, or its posterior mean.

        With several raters it is the mean over them.
        """
        if self.given_lapse is not None:
            return self.given_lapse
        weights, tutors = self._gaps_and_weights[1], self._tutors
        return sum(float(product(own[1], weights)) for own in tutors.values()) / len(tutors)

    @property
    def lapses(self) -> Floats:
        """The share of answers given at random, (m,), in each of the m ``draws``.

        With several raters it is the mean over them.
        """
        tutors = self._tutors.values()
        spread = [np.broadcast_to(own[1], self.particles) for own in tutors]
        return np.asarray(np.mean(spread, axis=0))

    @property
    def draws(self) -> Draws:
        """The particles: weighted draws from the posterior."""
        gaps, weights = self._gaps_and_weights
        x = self._x[:, : self.k - 1]
        most = x.max(axis=1)
        log_c = most + np.log(np.exp(x - most[:, None]).sum(axis=1))
        known = self.given_precision
        return Draws(
            gaps,
            weights,
            np.exp(np.minimum(log_c, 300.0)) if known is None else np.full(len(weights), known),
        )

    @property
    def effective_size(self) -> float:
        """Approximate number of independent draws of the posterior that the particles are worth.

        Two things lower it: unequal weights, by Kong's (1992) formula, and copies made by
        resampling. The moves after a resampling make the copies differ again. What is left of its
        effect is the greatest squared correlation, between before and after the moves, of a level's
        value or of log c. The true number was measured by how much probabilities vary with the
        seed: it is between a third of this estimate and three times as much.
        """
        return 1.0 / float(self._noise[0] + 1.0 / effective_size(self._logs) - 1.0 / self.particles)

    @property
    def acceptance(self) -> float:
        """The share of proposed moves of particles that were accepted; nan before the first."""
        return self.accepted / self.proposed if self.proposed else math.nan

    @cached_property
    def _gaps_and_weights(self) -> tuple[Floats, Floats]:
        """The gaps (p, m) of the particles, and their weights (m,), of total 1."""
        weights = np.exp(self._logs - self._logs.max())
        return self._theta / self._theta.sum(axis=0), weights / weights.sum()

    def _first_particles(self, prior: ParticlePrior) -> Floats:
        """Return particles drawn from a prior, (m, >= p).

        A learned lapse and a learned width of EQUAL have a further column each.
        """
        key, m = int(self._key), self.particles
        return first_particles(key, m, self.shape, prior, self.prior, self.like)
