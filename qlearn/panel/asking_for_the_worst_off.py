"""Asking a panel until the policy for its worst-off member is proven.

The policy is that of ``qlearn.panel.worst_off`` for the members' best guesses. As long as the
greatest loss of another policy could be smaller by more than the tolerance, a question follows: a
member is asked about the difference between this policy and a better one for them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Unpack

import numpy as np

from elicit._support.seeds import seed_of, takes_rng
from elicit._support.threads import one_thread
from elicit.asking.elicitation import Elicitation
from elicit.asking.options import AskingOptions, check_options, filled
from elicit.asking.question import Pair
from elicit.comparators.panel import Panel
from elicit.model.outcomes import Status
from elicit.model.query import Query
from elicit.model.scale import Floats
from qlearn.learners.learner import Learner, Result, check_tolerance
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import evaluate_policy
from qlearn.panel.following import check_panel
from qlearn.panel.worst_off import WorstOff, WorstOffPolicy, worst_off

_LOOKED_AT = 40  # differences for each member and round; the widest is asked about


@dataclass(frozen=True, eq=False, repr=False)
class WorstOffResult(Result):
    """A result whose policy is for the worst-off member of a panel.

    ``worst_off`` has the policy, which may draw its actions, and its bounds. ``policy`` is the best
    deterministic policy found, and ``loss_bound`` is its loss under the mean scale.

    Attributes
    ----------
    found : function
        Computes ``worst_off``. The other attributes are those of ``Result``.
    """

    found: Callable[[], WorstOffPolicy] | None = None

    @property
    def worst_off(self) -> WorstOffPolicy:
        """The policy whose greatest loss to any member is least, and its loss to each member."""
        assert self.found is not None
        return self.found()

    def __str__(self) -> str:
        """Return the status, the number of questions, and the losses of all members."""
        said = "1 question was" if self.asked == 1 else f"{self.asked:,} questions were"
        return f"{self.status.sentence}\n{said} asked.\n{self.worst_off}"


class WorstOffIteration(Learner):
    """A learner that proves the policy for the worst-off member of a panel.

    ``qlearn.solve`` uses it for a panel with ``aim="worst"``.

    Parameters
    ----------
    mdp : OrdinalMDP
    panel : Panel
    tolerance : float
        Stop once the policy is proven this near to the best one for the worst-off. Its greatest
        loss to any member then exceeds the least that a policy could have by at most this share of
        the value range. Losses are from the distribution of first states.
    **asking
        The options of ``elicit.AskingOptions``. One question is asked at a time.

    Raises
    ------
    TypeError
        If ``panel`` is no Panel, or a keyword is unknown.
    ValueError
        If a setting makes no sense.

    Notes
    -----
    Each round solves a linear program over occupancies and plans once for each member, so it is for
    MDPs of up to some thousand states. If the members' bounds depend on draws, the proof adds up a
    bound on each advantage. That is coarser than the proof of policy iteration for the mean scale.
    The learner then asks many more questions, or ends before the tolerance is reached.
    """

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        panel: Panel,
        *,
        tolerance: float = 0.001,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        check_panel(mdp, panel)
        self.seed = asking["seed"] = seed_of(asking.get("seed", 0))
        self._mdp = mdp
        self._tolerance = check_tolerance(tolerance)
        self._labels = asking.get("labels") or mdp.labels
        asking = filled(asking, {"labels": self._labels})
        name = f"{mdp.fingerprint}/worst-off/{tolerance!r}"
        self._elicitation = Elicitation(panel, name, **asking)
        self._end: Status | None = None
        self._rounds = 0
        self._last: tuple[Panel, WorstOff] | None = None

    @property
    def _panel(self) -> Panel:
        known = self._elicitation.comparator
        assert isinstance(known, Panel)
        return known

    def _round(self) -> WorstOff:
        if self._last is None or self._last[0] is not self._panel:
            self._last = self._panel, worst_off(self._mdp, self._panel)
            self._rounds += 1
        return self._last[1]

    def _go_on(self) -> tuple[Query, ...]:
        if self._end is not None:
            return ()
        now = self._round()
        if now.policy.excess <= self._tolerance:
            proven = not np.isnan(now.policy.confidence)
            self._end = Status.CONVERGED if proven else Status.BOUNDED
        elif self._elicitation.spent:
            self._end = Status.GUESSED
        elif (pair := self._telling_pair(now)) is not None:
            return self._elicitation.open([pair])
        else:
            self._end = Status.EXHAUSTED
        return ()

    def _telling_pair(self, now: WorstOff) -> Pair | None:
        """Return a question to the member about whom most is open, or None if no answer would help.

        Differences between whole policies come first. Differences between single actions follow if
        nothing can be learned from these.
        """
        panel, telling = self._panel, now.telling()
        for part in (slice(0, 3), slice(3, 3 + _LOOKED_AT), slice(3, None)):
            best: tuple[float, Pair] | None = None
            for name, counts, d in telling:
                others = tuple(one for one in panel.people if one != name)
                for row in d[part]:
                    asked = panel.whom(row, others) if np.abs(row).max() > 0 else None
                    if asked is None:
                        continue
                    high = panel.members[name].bounds(row[None])
                    width = round(counts * float(high[1][0] - high[0][0]), 9)
                    if best is None or width > best[0]:
                        pair = _pair(asked.d, name)
                        if name not in self._elicitation.unable(pair):
                            best = width, pair
            if best is not None:
                return best[1]
        return None

    @one_thread
    def result(self) -> WorstOffResult:
        """Return the policy for the worst-off so far, its bounds, and the counts.

        Returns
        -------
        WorstOffResult
        """
        now = self._round()
        policy = now.policy.policy
        v = evaluate_policy(self._mdp, policy)
        plain = self._result(
            self._mdp,
            policy,
            q_of(np.arange(self._mdp.n_states), v, model_of(self._mdp)),
            self._end,
            self._rounds,
            tolerance=self._tolerance,
        )
        return WorstOffResult(**vars(plain), found=lambda: now.policy)


def _pair(d: Floats, who: str) -> Pair:
    """Return the question to a member about a difference d (k,), between two mixtures of levels."""
    left, right = np.maximum(d, 0.0), np.maximum(-d, 0.0)
    total = max(left.sum(), right.sum())
    return Pair(left / total, right / total, "two mixtures of levels: left or right?", who=who)
