"""The shares of runs that end at each level under a plan, in words and as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order

from elicit._support.fixed_order import product
from elicit.model.scale import Floats
from elicit.person.course.conclusion import DataTable, capital, listed
from elicit.person.showing import printable
from qlearn.cli.conclusions.decided_plan import DecidedPlan
from qlearn.cli.conclusions.in_words import InWords
from qlearn.mdp.array_checks import Flags
from qlearn.mdp.linear_systems import discounted_totals
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import Actions

_MOST = 50_000  # states that a run may be in: the linear system of more takes too long
_ROUNDING = 1e-9  # sum of the shares, less 1
_LARGE = 0.02  # least difference of two shares for which counts of 100 are fine enough
_LEAST = 0.5  # difference of two counts that is not due to rounding

_BY_STEPS = "if the steps between the levels were equal"
_FEWER = "Your answers also weigh the time in each condition before the end, and not only the end."


def end_shares(mdp: OrdinalMDP, policy: Actions) -> Floats | None:
    """Return the shares (k,) of runs that end at each level, or None if some run may never end.

    A run starts as ``mdp.initial`` says, and follows the policy (S,). No step is discounted. The
    result is None, too, if a run may be in more than 50,000 states.

    Examples
    --------
    >>> from qlearn import OrdinalMDP
    >>> chain = OrdinalMDP(
    ...     [[[1, 2]], [[1, 1]], [[2, 2]]], [[[0.25, 0.75]], [[1, 0]], [[1, 0]]], [[1], [0], [2]],
    ...     0.9, ["dead", "ill", "well"], terminal=[False, True, True],
    ... )
    >>> end_shares(chain, [0, 0, 0]).tolist()
    [0.25, 0.0, 0.75]
    """
    ends = _ends(mdp, policy, mdp.initial > 0)
    if ends is None:
        return None
    shares = np.clip(product(mdp.initial, ends), 0.0, 1.0)
    return shares if abs(float(shares.sum()) - 1.0) <= _ROUNDING else None


def _ends(mdp: OrdinalMDP, policy: Actions, first: Flags) -> Floats | None:
    """Return the shares (S, k) of runs from each state that end at each level.

    They are right for the states that can be reached from the ``first`` ones. The result is None if
    some run from there may never end, or they are too many.
    """
    n, m = mdp.levels.shape
    chain = mdp.transitions[np.arange(n) * m + np.asarray(policy)]
    live = _reached(chain, first) & ~mdp.terminal
    if live.sum() > _MOST or not _reached(chain.T.tocsr(), mdp.terminal)[live].all():
        return None
    ends = np.where(mdp.terminal[:, None], np.eye(mdp.k)[mdp.final_level], 0.0)
    if live.any():
        chain = chain[live]
        ends[live] = discounted_totals(chain[:, live], chain @ ends, 1.0)
    return ends


class Effect(NamedTuple):
    """Shares of the runs from a state that end at the best outcome, with either action."""

    learned: float
    equal: float

    def said(self, word: str) -> str:
        """Return both as a text; ``word`` says how these runs end, such as "recover"."""
        ours, theirs = self._of_1000
        return f"with it {ours} of 1,000 {word}, with equal steps {theirs}"

    @property
    def is_fewer(self) -> bool:
        """True if the number of 1,000 with the learned action, as it is said, is the smaller."""
        ours, theirs = self._of_1000
        return ours < theirs

    @property
    def _of_1000(self) -> tuple[int, int]:
        return round(1000 * self.learned), round(1000 * self.equal)


def effects_of(told: InWords, mdp: OrdinalMDP, found: DecidedPlan) -> dict[int, Effect]:
    """Return for each state that differs how many runs from there end at the best outcome.

    It compares the learned action with that of equal steps, each followed by the plan. The result
    is empty unless the problem's words name that outcome, and every run ends.
    """
    words, states = told.words.ends, found.states
    if len(words) != mdp.k or not words[-1] or not len(states):
        return {}
    m = mdp.levels.shape[1]
    rows = [mdp.transitions[states * m + actions[states]] for actions in _both(found)]
    first = np.zeros(len(mdp.terminal), np.bool_)
    for chances in rows:
        first[chances.indices] = True
    ends = _ends(mdp, found.policy, first)
    if ends is None:
        return {}
    learned, equal = (chances @ ends[:, -1] for chances in rows)
    shares = map(Effect, learned.tolist(), equal.tolist())
    return dict(zip(states.tolist(), shares, strict=True))


def _both(found: DecidedPlan) -> tuple[Actions, Actions]:
    """Return the learned action in every state, and that of equal steps, as arrays (S,)."""
    learned = found.equal.copy()
    learned[found.states] = found.learned
    return learned, found.equal


def _reached(links: sparse.csr_array, first: Flags) -> Flags:
    """Return the states (S,) that can be reached along the links from any of the first ones."""
    n = len(first)
    source = sparse.csr_array(first[None, :].astype(np.float64))
    graph = sparse.block_array([[links, None], [source, sparse.csr_array((1, 1))]], format="csr")
    found = np.zeros(n + 1, np.bool_)
    found[breadth_first_order(graph, n, return_predecessors=False)] = True
    return found[:n]


def outcomes_of(told: InWords, mdp: OrdinalMDP, found: DecidedPlan) -> tuple[str, DataTable | None]:
    """Return sentences on where runs end with the plan and with equal steps, and the shares.

    They are "" and None unless the problem's words name every outcome at which a run ends, and
    every run ends.
    """
    words = told.words.ends
    if len(words) != mdp.k:
        return "", None
    plan, steps = end_shares(mdp, found.policy), end_shares(mdp, found.equal)
    if plan is None or steps is None:
        return "", None
    levels = [i for i in range(mdp.k) if plan[i] > 0 or steps[i] > 0][::-1]
    if not all(words[i] for i in levels):
        return "", None
    table = DataTable(
        "Outcomes",
        ("outcome", "share_in_plan", "share_with_equal_steps"),
        tuple(
            (printable(told.labels[i]), round(float(plan[i]), 6), round(float(steps[i]), 6))
            for i in levels
        ),
    )
    same = bool((found.policy == found.equal)[~mdp.terminal].all())
    return _in_words(told, levels, plan, steps, same), table


def _in_words(told: InWords, levels: Sequence[int], plan: Floats, steps: Floats, same: bool) -> str:
    """Return sentences on the shares (k,) of these levels; ``same`` if both plans are the same.

    Two counts that differ by less than a half are called the same, because rounding could make them
    one apart.
    """
    apart = np.abs(plan - steps)[levels]
    of = 100 if apart.max() >= _LARGE else 1000
    unit, words = printable(told.words.unit), [printable(words) for words in told.words.ends]
    with_plan, with_steps = (np.rint(of * shares).astype(int) for shares in (plan, steps))
    each = listed([f"{with_plan[i]:,} {words[i]}" for i in levels])
    said = f"In the model, of {of:,} {unit} about {each} under this plan"
    if same:
        return f"{said}."
    if of * apart.max() < _LEAST or (with_plan == with_steps)[levels].all():
        return f"{said}. The numbers would be about the same {_BY_STEPS}."
    others = listed([f"{with_steps[i]:,} {words[i]}" for i in levels])
    said = f"{said}. {capital(_BY_STEPS)}, it would be: {others}."
    return f"{said} {_FEWER}" if with_plan[levels[0]] < with_steps[levels[0]] else said
