"""A policy's loss under drawn scales, and its quantile at a comparator's confidence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit._support.fixed_order import product
from elicit.decision.votes import LEVEL_ROUNDING
from elicit.lp.hit_and_run import Draws
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn.certificates.advantages import ROUNDING, Advantages
from qlearn.mdp.ordinal_mdp import OrdinalMDP

BLOCK = 48  # draws solved for at the same time
NUMBERS = 1 << 24  # numbers in one array of scores
MOST_SWEEPS = 2000


def loss_over_draws(
    mdp: OrdinalMDP, advantages: Advantages, draws: Draws, level: float, enough: float | None = None
) -> float:
    """Return the ``level`` quantile, over drawn scales, of an upper bound on the policy's loss.

    It is accurate to about a hundredth of itself, unless ``MOST_SWEEPS`` ends the computation
    earlier. First, each draw gets a rough bound: its greatest advantage divided by 1 - discount.
    Draws are then bounded more closely, those with the greatest rough bound first, until the
    quantile is known. Most draws need only the rough bound. If ``enough`` is given, the computation
    stops once the quantile certainly exceeds it, and returns inf.
    """
    doubt, t = advantages.doubt / (1 - mdp.discount), tail_sums(advantages.d)
    first = np.minimum(
        (most_of(advantages.d, draws.gaps, axis=0) + ROUNDING) / (1 - mdp.discount), 1.0
    )
    game, order, upper = _Game.of(mdp, advantages), np.argsort(-first, kind="stable"), first.copy()
    lower = np.zeros_like(first)
    spare, target = 1.0 - level + LEVEL_ROUNDING, -1.0 if enough is None else enough - doubt
    beyond = 0.0  # weight of the draws that are certain to lose more than the target
    width = max(1, min(BLOCK, NUMBERS // max(1, len(t))))
    for start in range(0, len(order), width):
        if first[order[start]] <= max(
            target, upper_quantile(upper[order[:start]], draws.weights[order[:start]], spare)
        ):
            break
        block = order[start : start + width]
        weights, gain = (
            draws.weights[block],
            np.maximum(product(t, draws.gaps[:, block]), -1.0) + ROUNDING,
        )
        room = np.inf if enough is None else spare - beyond
        small = upper_quantile(
            lower, draws.weights, spare
        )  # smaller losses do not matter to the quantile
        lower[block], upper[block] = game.losses(gain, target, weights, room, small)
        beyond += float(weights[lower[block] > target].sum())
        if enough is not None and beyond > spare:
            return np.inf
    return min(1.0, upper_quantile(upper, draws.weights, spare) + doubt)


def most_of(d: Floats, gaps: Floats, axis: int) -> Floats:
    """Return the greatest d.e, at least 0, of differences d (n, k) under scales of gaps (p, m).

    With axis 0 it is the greatest over the differences, (m,), and with axis 1 over the scales,
    (n,). It is computed in parts, so that the n times m products are never all in memory.
    """
    found, step = np.zeros((gaps.shape[1], len(d))[axis]), max(1, NUMBERS // gaps.shape[1])
    for start in range(0, len(d), step):
        scores = product(tail_sums(d[start : start + step]), gaps).max(axis=axis)
        part = found if axis == 0 else found[start : start + step]
        np.maximum(part, scores, out=part)
    return found


def upper_quantile(x: Floats, weights: Floats, spare: float) -> float:
    """Return the least entry of x (m,) such that all larger ones together weigh at most ``spare``.

    It is 0 if x is empty.
    """
    order = np.argsort(-x, kind="stable")
    above = np.cumsum(weights[order])
    i = int(np.searchsorted(above, spare, side="right"))
    return float(x[order[i]]) if i < len(x) else 0.0


class _Game(NamedTuple):
    """An MDP with numeric rewards: the advantages over a policy, under given scales.

    Its rows are the actions that the policy does not take, sorted by state. States where nothing
    can be gained are left out.
    """

    chain: sparse.csr_array  # (n, S) transitions of the alternatives
    own: sparse.csr_array  # (live, S) transitions of the policy's actions, which gain nothing
    live: NDArray[np.int64]
    starts: NDArray[np.int64]  # the first alternative of each state that has any
    owners: NDArray[np.int64]  # (j,) the places of these states among the live ones
    discount: float

    @staticmethod
    def of(mdp: OrdinalMDP, advantages: Advantages) -> _Game:
        live, m = np.flatnonzero(~mdp.terminal), mdp.n_actions
        states, starts = np.unique(advantages.states, return_index=True)
        return _Game(
            chain=mdp.transitions[advantages.states * m + advantages.actions],
            own=mdp.transitions[live * m + advantages.policy[live]],
            live=live,
            starts=starts,
            owners=np.searchsorted(live, states),
            discount=mdp.discount,
        )

    def losses(
        self, gain: Floats, target: float, weights: Floats, room: float, small: float
    ) -> tuple[Floats, Floats]:
        """Return bounds on the greatest total that a policy can collect, from the worst state.

        There are a lower and an upper bound (b,), for each of b scales; ``gain`` (n, b) are the
        rewards. They come from sweeps of value iteration that start at zero, with MacQueen's (1966)
        bounds. The sweeps end when each pair of bounds is decided: both are on one side of the
        target, or below ``small``, or within a hundredth of each other. They also end when scales
        of more weight than ``room`` certainly exceed the target.
        """
        b = gain.shape[1]
        total, ratio = np.zeros((self.own.shape[1], b)), self.discount / (1 - self.discount)
        low, high = np.zeros(b), np.full(b, np.inf)
        for _ in range(MOST_SWEEPS):
            new = self.discount * (self.own @ total)
            if len(self.starts):
                others = gain + self.discount * (self.chain @ total)
                new[self.owners] = np.maximum(
                    new[self.owners], np.maximum.reduceat(others, self.starts, axis=0)
                )
            change = (new - total[self.live]).max(axis=0, initial=0.0)
            total[self.live] = new
            low = total.max(axis=0)
            high = np.minimum(high, low + ratio * change + ROUNDING)
            if target >= 0 and weights[low > target].sum() > room:
                break
            close = high - low <= 0.01 * high + 1e-9
            if ((low > target) & (target >= 0) | (high <= max(target, small)) | close).all():
                break
        return low, high
