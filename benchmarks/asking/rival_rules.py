"""Rules of others for the next question, over the same candidates and the same draws of scales as
our own rules.

Where they were published, a rule also makes up the questions: the best trajectories of two scales
(Wilde et al. 2020), two profiles at the ends of the polytope (Toubia et al. 2004). Here all choose
among a learner's candidates, so that the rule alone differs. BALD, or mutual information (Houlsby
et al. 2011; Biyik et al. 2019), is in ``qlearn.strategies``. The methods as they were published,
with questions, estimates and ends of their own, are in ``benchmarks.contest``.
"""

from __future__ import annotations

import numpy as np

from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.learners.query_strategies import Candidates, Strategy

# of the mean weight: draws of less count as not plausible where a maximum is taken over draws
_SLIGHT = 0.1


def volume_removal(candidates: Candidates) -> Floats:
    """Sadigh et al. (2017), as in APReL: the weight that either answer is sure to take away at the
    least, by the model of the tutor's errors."""
    left = candidates.agreement @ candidates.weights
    return np.asarray(np.minimum(left, 1.0 - left))


def greatest_regret(candidates: Candidates) -> Floats:
    """Wilde et al. (2020), whose ``regret`` APReL takes too: two plausible scales that prefer
    different sides, and each lose most by the other's choice; in differences, for ratios need a
    zero that a scale does not have."""
    weights = candidates.weights
    plausible = candidates.scores[:, weights > _SLIGHT / len(weights)]
    left, right = plausible.max(axis=1), (-plausible).max(axis=1)
    return np.asarray(np.where((left > 0) & (right > 0), left + right, 0.0))


def polyhedral(candidates: Candidates) -> Floats:
    """Toubia, Hauser and Simester (2004): the question that cuts the longest axis of what is
    plausible, through its middle. Mean and covariance of the draws stand for the analytic centre
    and its ellipsoid; the score is how far both ends of the axis are on different sides, in
    half-widths of the ellipsoid along the question."""
    gaps, weights = candidates.draws.gaps, candidates.weights
    centre = gaps @ weights
    off = gaps - centre[:, None]
    covariance = (off * weights) @ off.T
    sizes, axes = np.linalg.eigh(covariance)
    t = tail_sums(candidates.d)
    along, middle = t @ axes[:, -1] * np.sqrt(max(sizes[-1], 0.0)), t @ centre
    half = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", t, covariance, t), 1e-300))
    return np.asarray((np.abs(along) - np.abs(middle)) / half)


RIVAL_RULES: dict[str, Strategy] = {
    "policy iteration, volume removal": volume_removal,
    "policy iteration, regret of two scales": greatest_regret,
    "policy iteration, polyhedral": polyhedral,
}
"""By the names of methods in ``question_counts``."""
