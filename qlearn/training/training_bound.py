"""Upper bound on the loss of the best trained policy against all policies, and its conditions.

A training that came within a gap of its optimum bounds all policies at its own scale
(``ReachableSet``). The gap is an assumption that nothing can prove. But it is refuted if a later
policy beats an earlier training, at that training's scale, by more than the gap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from elicit._support.fixed_order import product
from elicit._support.validation import require
from elicit.decision.votes import LEVEL_ROUNDING
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import simultaneous_bounds, stated_confidence
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.certificates.drawn_losses import upper_quantile
from qlearn.certificates.loss_bound import Guarantee, drawn_set
from qlearn.environments.rollout_shares import STANDARD_ERRORS
from qlearn.training.reachable_set import ReachableSet
from qlearn.training.training_result import TrainedPolicy

ROUNDING = 1e-9
"""Upper bound on the rounding errors of vertices and bounds."""


def greatest_error(errors: ArrayLike, k: int) -> float:
    """Return an upper bound on the standard error of a vector's value, for all scales.

    The value is a mean of tail sums, so its error is at most the greatest error of a tail sum. That
    is at most the sum of the errors of the shares in the tail. Since shares total 1, it is also at
    most the sum of the errors of the other shares.

    Parameters
    ----------
    errors : (k,) or (k - 1,)
        Standard errors of the vector's k shares, or of its k - 1 objectives.
    k : int

    Returns
    -------
    float
    """
    given = np.asarray(errors, dtype=np.float64)
    fits = given.shape in ((k,), (k - 1,)) and bool((np.isfinite(given) & (given >= 0)).all())
    require(
        fits,
        "errors",
        f"{k} standard errors, one a share (of objectives {k - 1}), finite and at least 0",
        errors,
    )
    if len(given) == k - 1:
        return float(given.max())
    above = tail_sums(given)
    return float(np.minimum(above, given.sum() - above).max())


def greatest_loss(d: Floats, comparator: Comparator) -> tuple[float, Floats, float]:
    """Return the greatest d.e over differences and plausible scales, and the confidence in it.

    Parameters
    ----------
    d : (n, k)
    comparator : Comparator

    Returns
    -------
    loss : float
        In units of e_k - e_1. If the scales are drawn, it is a quantile, at the comparator's level,
        of the greatest d.e under each scale.
    each : (n,)
        The greatest d.e of each difference over all plausible scales.
    confidence : float
    """
    drawn = drawn_set(comparator)
    if drawn is None:
        high, confidence = simultaneous_bounds(comparator, d)
        return float(high.max(initial=0.0)) + ROUNDING, high, confidence
    draws, level = drawn
    at = product(tail_sums(d), draws.gaps)
    loss = upper_quantile(at.max(axis=0, initial=0.0), draws.weights, 1.0 - level + LEVEL_ROUNDING)
    confidence = stated_confidence(comparator, level)
    return loss + ROUNDING, at.max(axis=1, initial=-np.inf), confidence


def guarantee_of(
    everything: ReachableSet,
    policies: tuple[TrainedPolicy, ...],
    at: int | None,
    comparator: Comparator,
    gap: float | None,
) -> Guarantee:
    """Return the guarantee of the policy with number ``at``, if the gap is not refuted.

    Parameters
    ----------
    everything : ReachableSet
        The set of all vectors that are possible before any training.
    policies : tuple of TrainedPolicy
    at : int or None
        Number of the policy.
    comparator : Comparator
    gap : float or None
        Largest distance of a training's result below its optimum.

    Returns
    -------
    Guarantee
        nan if there is no policy or no gap, or if the policies refute the gap.
    """
    if at is None or gap is None or is_broken(policies, gap):
        return Guarantee(np.nan, np.nan)
    trained = [(one, one.trained_on) for one in policies if one.trained_on is not None]
    scales = [np.diff(values) for _, values in trained]
    limits = [
        float(product(tail_sums(one.shares), gaps)) + gap + one.error
        for (one, _), gaps in zip(trained, scales, strict=True)
    ]
    reach = everything.cut_by([*zip(scales, limits, strict=True)])
    loss, _, confidence = greatest_loss(reach.vectors - policies[at].shares, comparator)
    # each measured policy may be further off at its own scale, and the best one at the true scale
    measured = sum(policy.error > 0 for policy in policies)
    doubt = (measured + 1) * 2.0 * float(norm.sf(STANDARD_ERRORS)) if measured else 0.0
    return Guarantee(loss + policies[at].error, max(0.0, confidence - doubt))


def _excesses(policies: Sequence[TrainedPolicy]) -> tuple[Floats, Floats]:
    """Return how much better policies are than trained ones, (n, j), and the errors of this.

    Entry (n, j) is the value of policy n minus that of trained policy j, at the scale that j was
    trained on. Its error is the sum of both policies' errors.
    """
    shares, errors = (
        np.array([policy.shares for policy in policies]),
        np.array([policy.error for policy in policies]),
    )
    trained = [i for i, policy in enumerate(policies) if policy.trained_on is not None]
    scales = np.array([policies[i].trained_on for i in trained])
    worth = product(tail_sums(shares), np.diff(scales, axis=1).T)
    return worth - worth[trained, range(len(trained))], errors[:, None] + errors[trained]


def observed_gap(policies: Sequence[TrainedPolicy]) -> float:
    """Return the greatest value by which a policy beats a trained one, or 0 if none does.

    Both are compared at the scale of the trained one.
    """
    if all(policy.trained_on is None for policy in policies):
        return 0.0
    return max(0.0, float(_excesses(policies)[0].max()))


def is_broken(policies: Sequence[TrainedPolicy], gap: float) -> bool:
    """Return whether some policy shows that a training ended more than ``gap`` below its optimum.

    Each policy is compared with each trained one, at the scale that the latter was trained on. It
    shows this if it is better by more than ``gap`` plus the standard errors of the two policies.
    """
    if all(policy.trained_on is None for policy in policies):
        return False
    excess, errors = _excesses(policies)
    return bool((excess - errors > gap + ROUNDING).any())
