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
