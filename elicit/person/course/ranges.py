"""Ranges of values as they are shown to a person, from what a comparator knows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.decision.draw_bounds import quantiles
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import Comparator, bounds_of
from elicit.model.comparator_parts import draws_in, trusted_share, unordered_of
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats, dot

_AGAIN = 3
"""Number of times that a posterior is learned again for a range. The particles disagree about the
ends of a range: after ten answers one end was 76 to 89 of 100 with one seed and another. Learning
10 to 23 answers three times takes .2 to .4 s of computing, too long before each question."""
_REMEMBERED = 8  # number of posteriors whose draws are kept, since a screen needs them repeatedly


def value_ranges(comparator: Comparator, draws: Draws | None = None) -> tuple[Floats, Floats]:
    """Return each level's range (k,) as it is shown, from 0 for the worst level to 1 for the best.

    ``draws`` is that of ``ranges_of``.
    """
    k, open_step = comparator.k, unordered_of(comparator) or (-1, -1)
    worst = open_step if open_step[0] == 0 else (0,)  # a value is that above the worst of these
    above = [ranges_of(comparator, np.eye(k) - np.eye(k)[level], draws) for level in worst]
    low, high = np.array(above).max(axis=0)
    return low, high


def outwards(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the ends of ranges, from 0 to 1, in whole numbers of 100 that do not narrow them."""
    return np.clip(np.floor(100.0 * low + 1e-6), 0, 100), np.clip(
        np.ceil(100.0 * high - 1e-6), 0, 100
    )


def counted_widths(low: Floats, high: Floats) -> Floats:
    """Return the widths of ranges, of 100, as they count where a range is called wide.

    A range with one end at 0 or 100 counts as twice as wide, but not wider than 100: no answer
    limits the value on that side, so the best guess depends on what is assumed of people.

    Examples
    --------
    >>> counted_widths(np.array([0.0, 0.0, 40.0, 60.0]), np.array([0.0, 15.0, 52.0, 100.0]))
    array([ 0., 30., 12., 80.])
    """
    one_sided = (low <= 0.0) | (high >= 100.0)
    widths: Floats = np.minimum(np.where(one_sided, 2.0, 1.0) * (high - low), 100.0)
    return widths


def ranges_of(
    comparator: Comparator, d: Floats, draws: Draws | None = None
) -> tuple[Floats, Floats]:
    """Return the range (n,) of d.e as it is shown, for differences d (n, k).

    If the comparator's bounds hold with a probability, the whole range has this probability, and
    half of the rest lies beyond each end. The bounds leave out all of the rest at each end, because
    a verdict needs one end only. For other comparators the range is that of the bounds.

    Parameters
    ----------
    comparator : Comparator
    d : (n, k)
    draws : Draws, optional
        Draws of its posterior, such as ``draws_again``. Default: its own.

    Returns
    -------
    low, high : (n,)
    """
    low, high = bounds_of(comparator, d)
    level = trusted_share(comparator)
    known = draws_in(comparator) if draws is None and level is not None else draws
    if level is None or known is None:
        return low, high
    gaps, weights, _ = known
    scores = [dot(row, gaps.T) for row in tail_sums(d)]
    ends = np.array([quantiles(row, weights, 0.5 * (1.0 + level)) for row in scores]).reshape(-1, 2)
    return np.minimum(low, ends[:, 0]), np.maximum(high, ends[:, 1])


def draws_again(comparator: Comparator) -> Draws | None:
    """Return the draws of a posterior together with those of the same posterior of other seeds.

    The result is None for any other comparator.
    """
    return _draws_again(comparator) if type(comparator) is PosteriorComparator else None


@lru_cache(maxsize=_REMEMBERED)
def _draws_again(comparator: PosteriorComparator) -> Draws:
    every = [comparator.draws]
    for i in range(_AGAIN):
        fresh = PosteriorComparator(
            comparator.k,
            comparator.given_precision,
            comparator.given_lapse,
            comparator.level,
            comparator.prior,
            np.random.SeedSequence([abs(comparator.seed), i]),
            comparator.tie,
            comparator.like,
            particles=comparator.particles,
            shape=comparator.shape,
            raters=comparator.raters,
        )
        every.append(fresh.update(comparator.answers).draws)
    return Draws(
        np.concatenate([draws.gaps for draws in every], axis=1),
        np.concatenate([draws.weights for draws in every]) / len(every),
        np.concatenate([draws.precision for draws in every]),
    )
