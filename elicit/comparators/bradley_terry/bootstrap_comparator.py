"""The paper's comparator for a tutor who errs (section 3.2): a Bradley-Terry fit and its bootstrap.

The model, the paper's eq. (6) and (7) with a prior, is fitted to the answers and to m resamples of
them. A comparison is decided only if all plausible scales agree on its sign. Plausible are either
all scales in the paper's box, which is an interval for each level, or the fits themselves (the
ensemble).

These parts are not the paper's: the prior (without one, early fits lie at infinity), gaps >= 0
(``monotone``), ties (``tie``), dominance first, ``min_answers``, and refits on a schedule. Each can
be switched off, and ``benchmarks.paper.literal`` measures the effect of that. The ensemble is not
the paper's either.
"""

from __future__ import annotations

import copy
import math
import warnings
from bisect import bisect_right
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.fixed_order import product
from elicit._support.hashing import Seed, key_of
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, is_range, is_whole, require
from elicit.comparators.bradley_terry.likelihood import (
    bootstrap_weights,
    fit,
    prior_centres,
    sigmoid,
)
from elicit.decision.comparator_rule import Rule, asking, box, ensemble, silent
from elicit.decision.verdicts import decide_by_rule
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import TIE, Verdicts, check_answers, check_levels, check_tie
from elicit.model.difference import as_differences, of_order_one, tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats, dot, order_bounds, values_of

Region = Literal["box", "ensemble"]
NoMaximum = Literal["ask", "take"]
_LARGE = (
    2.0**900
)  # larger differences, or smaller than its inverse, are scaled lest sums overflow or vanish


class NotConverged(RuntimeWarning):
    """Warning that some fits have no maximum, so that the comparator may be unable to decide.

    With ``prior_strength=0`` there are two causes. Either some scale explains the answers without
    error, or no answer touches some levels.
    """


@dataclass(frozen=True)
class BradleyTerryComparator:
    """Decides a difference if fits to ``n_boot`` resamples of the answers leave its sign no doubt.

    The comparator is a frozen value, and a function of (answers in told order, seed, settings)
    alone. Fits are made when they are first needed. If the model is inconclusive (too few answers,
    precision 0, theta_k <= 0, no maximum), every verdict beyond dominance is UNKNOWN.
    ``elicit.Comparator`` says what its methods take and return. Equations and sections are those of
    the paper.

    Parameters
    ----------
    k : int
        Number of levels.
    precision : float
        The c of eq. (6), in logits per unit of d.e. It enters only the prior, where it is theta_k:
        the fit leaves theta = c (e - e_1) free. If it is 0, the answers teach nothing.
    n_boot : int
        Number of resamples, m.
    level : float
        Confidence level of the percentile intervals. Their ends are order statistics, rounded
        outwards and widened to hold the point estimate.
    region : {"box", "ensemble"}
        ``"box"`` takes the paper's extremes of d.theta over a percentile interval for each theta_i.
        It ignores how the levels vary together, and for k >= 10 it decides next to nothing.
        ``"ensemble"`` takes percentiles of d.theta over the m fits. It decides far more, but after
        few answers significantly more than 5% of it can be wrong, which was not seen of the box
        (``benchmarks.fitting.calibration``): so the box is the default.
    seed : int, SeedSequence, Generator or None
        Kept as an int. None draws a new one.
    prior_strength : float
        The s of the prior -(s/2) sum_j ((k-1) (gamma_j / precision - centre_j))^2 on the gaps gamma
        of theta. Gaps stray from their centre by about s^-1/2 equal gaps. 0: no prior.
    prior_shape : (low, high)
        The prior's centre is equal gaps for the point estimate. Each resample draws a centre of its
        own, because few answers show no spread of their own: gaps from Dirichlet(a), with log a
        uniform between the logs of these two. (1, 1) is uniform on the simplex of gaps, and
        overconfident on scales with a few large gaps.
    monotone : bool
        Keep gamma >= 0. False: the paper's literal fit.
    rescale : bool
        Divide the theta of each resample by its theta_k first. This is one reading of the paper's
        footnote 3; by the other one, all are divided by one number, which changes no verdict.
    refit_growth : float
        Fits are made only at r_0 = 1, r_{i+1} = max(r_i + 1, ceil(r_i (1 + refit_growth))) answers.
        In between, the last fit stays in use. 0: a fit at every answer.
    min_answers : int
        A fit to fewer answers decides nothing. A bootstrap of one answer has no width, and one of
        very few shows the prior more than the tutor.
    dominance : bool
        Let dominance, eq. (4), decide before the fits do. If False, the fits decide alone, as in
        Algorithm 2, and bounds may exceed what the order of the levels allows.
    no_maximum : {"ask", "take"}
        Treatment of a fit that found no maximum (see ``NotConverged``). ``"ask"``: such a fit could
        lie anywhere, so it counts as one of the extreme fits that a percentile leaves out, at
        either end. If there are too many of them, nothing is decided. ``"take"``: the fit counts
        where Newton's method stopped, as with an optimiser whose convergence nobody checks.
    tie : float
        Largest |d.e| that the tutor may call EQUAL, a share of the value range e_k - e_1, in 0 <=
        tie < 1. Here d is a difference of share vectors, used as it is given. It is the width in
        Rao and Kupper's (1967) model of ties (see ``likelihood.fit``). As long as no answer is
        EQUAL the fits do not depend on it. 0: EQUAL means equal, and counts as half an answer each
        way.

    Raises
    ------
    ValueError
        If a setting is out of range.
    """

    k: int
    _: KW_ONLY
    precision: float = 10.0
    n_boot: int = 100
    level: float = 0.95
    region: Region = "box"
    seed: Seed | None = 0
    # Chosen by measurement: 40 tutors each, logits of spread 2 or 10% flips, k = 5..20, n =
    # 10..400, true gaps uniform or Dirichlet(.2): at most 3.6% of the decided fresh pairs wrong,
    # 5.6% with 1.0 and (1, 1).
    prior_strength: float = 0.3
    prior_shape: tuple[float, float] = (0.1, 2.0)
    monotone: bool = True
    rescale: bool = False
    refit_growth: float = 0.05
    min_answers: int = 5
    dominance: bool = True
    no_maximum: NoMaximum = "ask"
    tie: float = TIE
    answers: Answers = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "k", check_levels(self.k))
        for name in ("precision", "prior_strength", "refit_growth"):
            value = getattr(self, name)
            require(is_number(value, 0), name, "a finite number of at least 0", value)
        for name in ("n_boot", "min_answers"):
            value = getattr(self, name)
            require(is_whole(value, 1), name, "a whole number of at least 1", value)
            object.__setattr__(self, name, int(value))
        require(
            is_number(self.level) and 0 < self.level < 1,
            "level",
            "strictly between 0 and 1",
            self.level,
        )
        for name in ("monotone", "rescale", "dominance"):
            require(
                isinstance(getattr(self, name), bool), name, "True or False", getattr(self, name)
            )
        check_tie(self.tie)
        require(self.region in get_args(Region), "region", '"box" or "ensemble"', self.region)
        require(
            self.no_maximum in get_args(NoMaximum), "no_maximum", '"ask" or "take"', self.no_maximum
        )
        positive = is_range(self.prior_shape) and self.prior_shape[0] > 0
        require(positive, "prior_shape", "two numbers, 0 < low <= high", self.prior_shape)
        object.__setattr__(self, "prior_shape", tuple(self.prior_shape))
        seed = seed_of(self.seed)
        key = key_of(seed)  # a Generator is drawn from once, here
        object.__setattr__(self, "seed", int(seed) if isinstance(seed, (int, np.integer)) else key)
        object.__setattr__(self, "answers", Answers.none(self.k))

    def update(self, answers: Answers) -> BradleyTerryComparator:
        """Return a comparator that also knows these answers.

        It makes no difference whether answers come all at once or one by one.
        """
        check_answers(answers, self.k)
        after = copy.copy(self)
        object.__setattr__(after, "answers", self.answers + answers)
        if after.fitted_answers != self.fitted_answers:
            after.__dict__.pop("_model", None)  # otherwise the rows are the same, and so is the fit
        return after

    @property
    def fitted_answers(self) -> int:
        """Number of answers that the fit in use was made from: the first ones."""
        return refit_point(len(self.answers), self.refit_growth)

    @property
    def answers_to_next_step(self) -> int:
        """Number of further answers until the next fit."""
        return next_refit(len(self.answers), self.refit_growth) - len(self.answers)

    @property
    def values(self) -> Floats:
        """The point estimate (k,), theta / theta_k; equal gaps if the model is inconclusive."""
        return self._model.values.copy()

    @property
    def converged(self) -> bool:
        """True if every fit in use found its maximum. If not, ``NotConverged`` was warned."""
        return self._model.converged

    def compare(self, d: ArrayLike) -> Verdicts:
        """Return verdicts on differences.

        Dominance decides first, unless it is switched off. Other differences are BETTER or WORSE if
        all plausible fits agree.

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
        """The plausible fits, or the box around them, as plain arrays for compiled loops."""
        region = self._model.region
        if region is None:
            return silent() if self.dominance else asking()
        rule = (
            box(region.lo, region.hi)
            if isinstance(region, _Box)
            else ensemble(region.gaps, region.cut)
        )
        return rule if self.dominance else rule._replace(dominance=False)

    def bounds(self, d: ArrayLike) -> tuple[Floats, Floats]:
        """Return bounds on d.e over the plausible fits, or over the box around them.

        With ``dominance`` they never exceed what the order of the levels allows.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        lo, hi : (n,) each, in units of the point estimate's theta_k
        """
        rows, t, power = of_order_one(as_differences(d, self.k))
        least, greatest = order_bounds(t, 0.0)
        if not self.dominance:
            greatest = np.where(
                t.any(axis=1), np.inf, 0.0
            )  # equal vectors are equal on every scale
            least = -greatest
        lo, hi = least, greatest
        if self._model.region is not None:
            lo, hi = (np.clip(end, least, greatest) for end in self._model.region.extremes(rows))
        return np.ldexp(lo, power), np.ldexp(hi, power)

    @property
    def confidence(self) -> float:
        """Confidence of guarantees that depend on the fits: ``level``, or nan.

        It is nan if ``tie`` is above 0 and the tutor has called something equal. Such answers are
        the same in all resamples, so the fits do not show how uncertain the tie is.
        """
        return math.nan if self.tie > 0 and (self.answers.y == 0).any() else self.level

    @one_thread
    def simultaneous_bounds(self, d: ArrayLike) -> tuple[Floats, float]:
        """Return upper bounds on d.e / e_k that hold for all rows at once, and their confidence.

        A bound is the greatest d.e over the fits. The share 1 - ``level`` of the fits is left out:
        those with the greatest d.e of any row. If the model is inconclusive or the region a box,
        whose levels are not bounded together, the bounds are those over every ordered scale, at
        confidence 1.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        hi : (n,) in units of e_k - e_1
        confidence : float
            The bootstrap's nominal confidence. It is not a posterior probability.
        """
        rows = as_differences(d, self.k)
        draws, t = self.draws, tail_sums(rows)
        if draws is None or not len(rows):
            return order_bounds(t, 0.0)[1], 1.0
        at = product(t, draws.gaps)
        most = np.sort(at.max(axis=0))[-1 - math.floor((1.0 - self.level) * at.shape[1] + 1e-9)]
        return at[:, at.max(axis=0) <= most].max(axis=1), self.confidence

    @property
    def draws(self) -> Draws | None:
        """The fits as equally likely scales, each with its own precision, or None.

        It is None in three cases: the model is inconclusive, the region is a box, or a fit has no
        scale (theta_k <= 0).
        """
        region = self._model.region
        if not isinstance(region, _Ensemble) or not (region.gaps.sum(axis=0) > 0).all():
            return None
        total, m = region.gaps.sum(axis=0), region.gaps.shape[1]
        return Draws(region.gaps / total, np.full(m, 1.0 / m), total * self._model.top)

    def probability(self, d: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return bounds on the probability of "left is better" by eq. (6), and its point estimate.

        The verdict is BETTER if the lower bound s_min is above 1/2. If the model is inconclusive,
        the range is 0 to 1, or 1/2 at an end that dominance rules out. Then the point estimate is
        that of the prior's equal gaps.

        Parameters
        ----------
        d : (n, k)
            Differences left - right.

        Returns
        -------
        s_min, s_max, point : (n,) each, probabilities
        """
        model = self._model
        lo, hi = self.bounds(d)
        point = np.clip(dot(tail_sums(as_differences(d, self.k)), np.diff(model.values)), lo, hi)
        if model.region is None:
            return (
                np.where(lo < 0, 0.0, 0.5),
                np.where(hi > 0, 1.0, 0.5),
                sigmoid(self.precision * point),
            )
        # the logistic function rises, but its last bit need not
        ends = sigmoid(model.top * lo), sigmoid(model.top * hi)
        low, high = np.minimum(*ends), np.maximum(*ends)
        return low, high, np.clip(sigmoid(model.top * point), low, high)

    @cached_property
    def _model(self) -> _FittedModel:
        n, p = self.fitted_answers, self.k - 1
        equal = np.full((1, p), 1.0 / p)
        nothing = _FittedModel(values_of(equal[0]))
        if n < self.min_answers or self.precision == 0:
            return nothing
        t, y, key, m = (
            tail_sums(self.answers.d[:n]),
            self.answers.y[:n],
            key_of(seed_of(self.seed)),
            self.n_boot,
        )
        strength = self.prior_strength * p**2
        fitted = partial(
            fit,
            t,
            y,
            precision=self.precision,
            strength=strength,
            monotone=self.monotone,
            tie=self.tie,
        )
        point = fitted(centre=equal)
        taken = self.no_maximum == "take"
        if not (
            point.converged[0] or taken or self.prior_strength
        ):  # then no resample has a maximum either
            self._warn(n, m, False)
            return replace(nothing, converged=False)
        centres, weights = prior_centres(key, m, p, self.prior_shape), bootstrap_weights(key, m, n)
        boot = fitted(centre=centres, weights=weights, start=point.gamma[0])
        converged = bool(point.converged.all() and boot.converged.all())
        if not converged:
            self._warn(n, m - int(boot.converged.sum()), bool(point.converged[0]))

        theta, thetas = np.cumsum(point.gamma[0]), np.cumsum(boot.gamma, axis=1)
        top = float(theta[-1])
        found = boot.converged | taken
        usable = found & (thetas[:, -1] > 0) if self.rescale else found
        # A missing fit could lie anywhere: it takes the place of one left out at either end.
        cut = min(math.floor((1.0 - self.level) / 2.0 * m + 1e-9), (m - 1) // 2) - int(
            m - usable.sum()
        )
        if cut < 0 or top <= 0 or not (point.converged[0] or taken):
            return replace(nothing, converged=converged)
        scale = thetas[usable, -1:] if self.rescale else top
        region: _Ensemble | _Box
        if self.region == "ensemble":
            region = _Ensemble(
                np.vstack([boot.gamma[usable] / scale, point.gamma[0] / top]).T.copy(), cut
            )
        else:
            region = _Box.around(thetas[usable] / scale, theta / top, cut)
        return _FittedModel(np.concatenate([[0.0], theta / top]), top, region, converged)

    def _warn(self, n: int, lost: int, point: bool) -> None:
        """Warn that ``lost`` of the resamples of n answers have no maximum.

        If ``point`` is False, the fit to the answers themselves has none either.
        """
        text = f"no maximum found for {lost} of {self.n_boot} resamples of {n} answers"
        text += "" if point else ", nor for the answers themselves"
        text += ": a prior_strength above 0 gives each fit one" if self.prior_strength == 0 else ""
        warnings.warn(text, NotConverged, stacklevel=4)


@dataclass(frozen=True)
class _FittedModel:
    """A fitted scale and the region of plausible scales around it; None if inconclusive."""

    values: Floats  # (k,)
    top: float = 0.0  # theta_k of the point estimate
    region: _Ensemble | _Box | None = None
    converged: bool = True


@dataclass(frozen=True)
class _Ensemble:
    """The plausible scales as an ensemble of fits, with percentiles of d.e over them."""

    gaps: Floats  # (p, m + 1), the last one the point estimate
    cut: int  # number of fits left out at either end

    def extremes(self, d: Floats) -> tuple[Floats, Floats]:
        """Return the least and the greatest plausible d.e (n,) for differences d (n, k)."""
        scores, last = dot(tail_sums(d)[:, None], self.gaps.T), self.gaps.shape[1] - 2
        point = scores[:, -1]
        ordered = np.sort(scores[:, :-1], axis=1)
        return np.minimum(ordered[:, self.cut], point), np.maximum(
            ordered[:, last - self.cut], point
        )


@dataclass(frozen=True)
class _Box:
    """The plausible scales as the paper's box: an interval for each of e_2, ..., e_k."""

    lo: Floats  # (p,)
    hi: Floats  # (p,)

    @staticmethod
    def around(scales: Floats, point: Floats, cut: int) -> _Box:
        """Return the box of percentile intervals of scales (m, p), widened to hold ``point`` (p,).

        Each interval leaves out ``cut`` scales at either end.
        """
        ordered = np.sort(scales, axis=0)
        return _Box(
            np.minimum(ordered[cut], point), np.maximum(ordered[len(scales) - 1 - cut], point)
        )

    def extremes(self, d: Floats) -> tuple[Floats, Floats]:
        """Return the least and the greatest plausible d.e (n,) for differences d (n, k)."""
        ends = np.stack([d[:, 1:] * self.lo, d[:, 1:] * self.hi])
        least, greatest = ends.min(axis=0), ends.max(axis=0)
        return np.add.accumulate(least, axis=1)[:, -1], np.add.accumulate(greatest, axis=1)[:, -1]


def refit_point(n: int, growth: float) -> int:
    """Return the largest number of answers r_i <= n at which a fit is made.

    The schedule is r_0 = 1, r_{i+1} = max(r_i + 1, ceil(r_i (1 + growth))).
    """
    if n * growth <= 1:
        return n
    points = _refits(growth, 1 << n.bit_length())
    return points[bisect_right(points, n) - 1]


def next_refit(n: int, growth: float) -> int:
    """Return the smallest number of answers above n at which a fit is made (``refit_point``)."""
    if (n + 1) * growth <= 1:
        return n + 1
    points = _refits(growth, 1 << n.bit_length())
    return points[bisect_right(points, n)]


@lru_cache(maxsize=64)
def _refits(growth: float, beyond: int) -> tuple[int, ...]:
    """Return the numbers of answers at which fits are made, up to the first above ``beyond``.

    The list begins at about 1 / growth. Up to there a fit is made at every answer.
    """
    points = [max(1, int(1 / growth))]
    while points[-1] <= beyond:
        points.append(points[-1] + max(1, math.ceil(points[-1] * growth)))
    return tuple(points)
