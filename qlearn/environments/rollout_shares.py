"""What rollouts measure of a policy."""

from typing import NamedTuple

from scipy.stats import norm

from elicit.model.scale import Floats

STANDARD_ERRORS = 3.0
"""How far from what was measured a policy's shares are taken to lie at most, in standard errors: they lie farther off
with a probability of 0.27%."""


class RolloutShares(NamedTuple):
    """``shares`` (k,): the mean over episodes of the discounted share of time at each level; ``errors`` (k,): its
    standard errors, none below ``error_of_unseen``; ``undecided``: the share of time after episodes were cut off, at
    levels that nobody saw. ``shares`` and ``undecided`` total 1."""

    shares: Floats
    errors: Floats
    undecided: float


def error_of_unseen(episodes: int) -> float:
    """Least standard error of a share measured in so many episodes, however alike they are.

    An outcome of probability p shows in none of n episodes with probability (1 - p)^n. As far as that exceeds 0.27%, it
    cannot be excluded, and a share may be off by p: so ``STANDARD_ERRORS`` errors are at least 1 - 0.0027^(1 / n)."""
    chance = 2.0 * float(norm.sf(STANDARD_ERRORS))
    return float(1.0 - chance ** (1.0 / episodes)) / STANDARD_ERRORS
