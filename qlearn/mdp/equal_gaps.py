"""The policy for equal gaps: how to act without having asked, and the loss of doing so.

Without any question, the plain guess is that the steps between neighbouring levels are equal. The
loss of this guess under a hidden scale is the most that questions can save.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.validation import is_number, require
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions, backed_up, policy_loss, rewarded, value_iteration

_TIE = 1e-9  # ten times the greatest error of a computed value; no loss of this size matters


class UnaskedLoss(NamedTuple):
    """Loss of the policy for equal gaps under a hidden scale, as shares of the value range.

    Attributes
    ----------
    worst : float
        The loss at the worst state.
    initial : float
        The mean loss from the initial distribution.
    """

    worst: float
    initial: float


def equal_gaps_policy(mdp: OrdinalMDP, tie: float = _TIE) -> Actions:
    """Return a policy that is optimal if the steps between neighbouring levels are equal.

    It is how to act if nobody is asked about the levels.

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    tie : float
        Actions whose values differ from the best by at most this share of the value range count as
        equally good. Of these the action with the lowest index is taken, so that rounding decides
        nothing.

    Returns
    -------
    ndarray of int
        (S,) the action in each state. On equal gaps the policy loses at most tie / (1 - discount)
        of the value range.

    Raises
    ------
    ValueError
        If ``tie`` is not a number from 1e-12 to 1.

    Examples
    --------
    >>> mdp, values = qlearn.random_mdp(n_states=20, n_actions=3, n_levels=5, seed=1)
    >>> qlearn.equal_gaps_policy(mdp).shape
    (20,)
    """
    require(is_number(tie, 1e-12, 1), "tie", "a share of the value range from 1e-12 to 1", tie)
    values = np.linspace(0.0, 1.0, mdp.k)
    v, _ = value_iteration(mdp, values, tolerance=min(tie / 10, 1e-10))
    q = backed_up(mdp, *rewarded(mdp, values), v)
    first: Actions = np.argmax(q >= q.max(axis=1, keepdims=True) - tie, axis=1)
    return first


def unasked_loss(mdp: OrdinalMDP, values: ArrayLike, policy: Actions | None = None) -> UnaskedLoss:
    """Return the loss of acting by equal gaps if the hidden scale is ``values``.

    The loss is (1 - discount) times the loss of return, over the value of the best level against
    the worst, like ``Result.loss_bound``.

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    values : array_like
        (k,) the hidden value of each level, increasing.
    policy : ndarray of int, optional
        (S,) the ``equal_gaps_policy``, if you have it already.

    Returns
    -------
    UnaskedLoss
        ``worst``, the loss at the worst state, and ``initial``, the loss from the initial
        distribution.

    Raises
    ------
    ValueError
        If ``values`` are not k increasing numbers.

    Examples
    --------
    >>> mdp = qlearn.problems.FAMILIES["career"](seed=1)
    >>> loss = qlearn.unasked_loss(mdp, [0, 1, 9, 10])
    >>> loss.worst >= loss.initial > 0
    True
    """
    loss: Floats = policy_loss(mdp, equal_gaps_policy(mdp) if policy is None else policy, values)
    worst = float(loss.max())
    return UnaskedLoss(worst, min(float((mdp.initial * loss).sum()), worst))
