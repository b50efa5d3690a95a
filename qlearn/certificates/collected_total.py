"""The greatest discounted total of bounded advantages that any policy can collect."""

import numpy as np

from elicit.model.scale import Floats
from qlearn.certificates.advantages import ROUNDING, Advantages
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_iteration
from qlearn.mdp.warm_planning import nearly_optimal


def collected(
    mdp: OrdinalMDP,
    over: Advantages,
    high: Floats,
    start: Floats | None = None,
    within: float = 0.0,
) -> Floats:
    """Return upper bounds on the discounted total of advantages that a policy collects.

    There is one for each state that it starts from.

    Parameters
    ----------
    mdp : OrdinalMDP
    over : Advantages
    high : (n,)
        Upper bounds on the advantages.
    start : (S,), optional
        Totals found earlier. If given, they are improved step by step until they are tight to about
        ``within``, which is faster for large models. Default: solve exactly.
    within : float
        A share of the value range.

    Returns
    -------
    (S,) shares of the value range, at most 1
    """
    gain = np.full(mdp.levels.shape, -np.inf)
    live = np.flatnonzero(~mdp.terminal)
    gain[live, over.policy[live]] = 0.0
    gain[over.states, over.actions] = high
    gain[live] += ROUNDING
    total = np.zeros(mdp.n_states)
    if gain.max() > ROUNDING:
        total = greatest_total(mdp, gain, start, within)
    total[live] += over.doubt / (1 - mdp.discount)
    return np.clip(total, 0.0, 1.0)


def greatest_total(
    mdp: OrdinalMDP, gain: Floats, start: Floats | None = None, within: float = 0.0
) -> Floats:
    """Return the greatest expected discounted total (S,) of gain (S, A), rounded up.

    Policy iteration proposes it, and a sweep certifies it. A gain of -inf marks an action that does
    not exist. Terminal states gain nothing.
    """
    live, ends = ~mdp.terminal, np.zeros(mdp.n_states)
    gain = np.where(live[:, None], gain, 0.0)
    if start is None:
        v, _ = policy_iteration(mdp, gain, ends, gain.argmax(axis=1))
        swept = (gain + mdp.discount * (mdp.transitions @ v).reshape(gain.shape)).max(axis=1)
        more = max(0.0, float((swept - v)[live].max(initial=0.0))) / (1 - mdp.discount)
    else:
        v, _, more = nearly_optimal(mdp, gain, ends, start, within)
    return np.where(live, v + (more + ROUNDING / (1 - mdp.discount)), 0.0)
