"""The share vector of a policy as measured by rollouts, and its errors."""

from typing import NamedTuple

from scipy.stats import norm

from elicit.model.scale import Floats

STANDARD_ERRORS = 3.0
"""The largest error of a policy's measured shares that is allowed for, in standard errors:
a larger one has a probability of 0.27%."""


class RolloutShares(NamedTuple):
    """A policy's share vector, measured over some episodes, with standard errors.

    Attributes
    ----------
    shares : (k,)
        Mean over episodes of the discounted share of time at each level.
    errors : (k,)
        Standard errors of the shares, none below ``error_of_unseen``.
    undecided : float
        Share of time after episodes were cut off, at unknown levels. ``shares`` and ``undecided``
        total 1.
    """

    shares: Floats
    errors: Floats
    undecided: float


def error_of_unseen(episodes: int) -> float:
    """Return the least standard error of a share measured in a number of episodes.

    It applies even if all episodes were alike. An outcome of probability p shows in none of n
    episodes with probability (1 - p)^n. As long as that exceeds 0.27%, the outcome cannot be
    excluded, and a share may be off by p. So ``STANDARD_ERRORS`` standard errors must be at least 1
    - 0.0027^(1 / n).

    Parameters
    ----------
    episodes : int

    Returns
    -------
    float
    """
    chance = 2.0 * float(norm.sf(STANDARD_ERRORS))
    return float(1.0 - chance ** (1.0 / episodes)) / STANDARD_ERRORS
