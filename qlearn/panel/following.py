"""The cost to each member of a panel of following another member's policy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit.comparators.panel import Panel
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess, simultaneous_bounds
from elicit.model.difference import as_vectors
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import loss_bound
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss, value_iteration


@dataclass(frozen=True, eq=False)
class Following:
    """Losses of each member under each member's best policy, and under the best for the mean.

    Losses are shares of the value range, at the worst state, as ``Result.loss_bound`` is. For a
    choice from a list, alternatives take the place of policies.

    Attributes
    ----------
    people : tuple of str
        The n members, a row for each.
    followed : tuple of str
        Those whose policy is followed, a column for each: the members, then "the mean".
    losses : (n, n + 1)
        The loss, if scales are the best guesses of the members' comparators.
    bounds : (n, n + 1)
        Upper bounds on the loss over all scales that the row's comparator holds plausible.
    of_policies : bool
        False if alternatives from a list are followed.
    """

    people: tuple[str, ...]
    followed: tuple[str, ...]
    losses: Floats
    bounds: Floats
    of_policies: bool = True

    def __str__(self) -> str:
        """Return the table in percent: losses by the best guess, and in brackets the bounds."""
        cells = [
            [f"{100 * loss:.1f} ({100 * bound:.1f})" for loss, bound in zip(*row, strict=True)]
            for row in zip(self.losses, self.bounds, strict=True)
        ]
        rows = [["who loses", *self.followed]]
        rows += [[name, *row] for name, row in zip(self.people, cells, strict=True)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        where, what = (", at the worst state", "policy") if self.of_policies else ("", "choice")
        head = (
            f"Loss in percent of the value range{where}, by whose {what} is followed "
            "(in brackets: at most):"
        )
        return "\n".join([head, *lines])


@one_thread
def cost_of_following(mdp: OrdinalMDP, panel: Panel) -> Following:
    """Return each member's loss from following another member's policy, or that of the mean.

    A member's policy is the best one for the best guess of their comparator.

    Parameters
    ----------
    mdp : OrdinalMDP
    panel : Panel

    Returns
    -------
    Following

    Raises
    ------
    TypeError
        If ``mdp`` is no OrdinalMDP, or ``panel`` no Panel.
    ValueError
        If the MDP has another number of levels.
    """
    check_panel(mdp, panel)
    scales = {name: best_guess(member) for name, member in panel.members.items()}
    policies = [value_iteration(mdp, scale)[1] for scale in (*scales.values(), panel.values)]
    losses = [
        [float(policy_loss(mdp, policy, scale).max()) for policy in policies]
        for scale in scales.values()
    ]
    bounds = [
        [loss_bound(mdp, policy, member).loss_bound for policy in policies]
        for member in panel.members.values()
    ]
    return Following(panel.people, (*panel.people, "the mean"), np.array(losses), np.array(bounds))


@one_thread
def cost_of_following_a_choice(vectors: ArrayLike, panel: Panel) -> Following:
    """Return each member's loss from taking the alternative that is best for another member.

    A member's choice is the best alternative for the best guess of their comparator. If several are
    equal, it is the first in the list.

    Parameters
    ----------
    vectors : (n, k) shares
        The alternatives.
    panel : Panel

    Returns
    -------
    Following

    Raises
    ------
    TypeError
        If ``panel`` is no Panel.
    ValueError
        If the alternatives have another number of levels, or no finite numbers.
    """
    if not isinstance(panel, Panel):
        raise TypeError(f"an elicit.Panel is wanted, not {panel!r}")
    shares = as_vectors(vectors, panel.k)
    scales = [best_guess(member) for member in panel.members.values()]
    worth = [np.round(product(shares, scale), 9) for scale in (*scales, panel.values)]
    chosen = [int(one.argmax()) for one in worth]
    losses = [[float(one.max() - one[c]) for c in chosen] for one in worth[:-1]]
    different = dict.fromkeys(chosen)  # many people may choose the same
    bounds = []
    for member in panel.members.values():
        of = {c: _most(member, shares - shares[c]) for c in different}
        bounds.append([of[c] for c in chosen])
    names = (*panel.people, "the mean")
    return Following(panel.people, names, np.array(losses), np.array(bounds), of_policies=False)


def _most(member: Comparator, d: Floats) -> float:
    """Return an upper bound on the greatest d.e of differences d (n, k) for a member."""
    high, _ = simultaneous_bounds(member, d)
    return float(np.clip(high.max(), 0.0, 1.0))


def check_panel(mdp: OrdinalMDP, panel: Panel) -> None:
    """Raise TypeError or ValueError unless these are an MDP and a panel over the same levels."""
    if not isinstance(mdp, OrdinalMDP):
        raise TypeError(f"mdp must be a qlearn.OrdinalMDP, not {mdp!r}")
    if not isinstance(panel, Panel):
        raise TypeError(f"an elicit.Panel is wanted, not {panel!r}")
    if panel.k != mdp.k:
        raise ValueError(f"the MDP has {mdp.k} levels, but the panel's scales have {panel.k}")
