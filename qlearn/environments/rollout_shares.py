"""What rollouts measure of a policy."""

from typing import NamedTuple

from elicit.model.scale import Floats


class RolloutShares(NamedTuple):
    """``shares`` (k,): the mean over episodes of the discounted share of time at each level; ``errors`` (k,): its
    standard errors; ``undecided``: the share of time after episodes were cut off, at levels that nobody saw. ``shares``
    and ``undecided`` total 1."""

    shares: Floats
    errors: Floats
    undecided: float
