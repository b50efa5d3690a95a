"""Losses of a learner's policy after each answer, from question zero."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.validation import require
from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.model.comparator import Comparator
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import loss_bound
from qlearn.learners.learner import Result
from qlearn.mdp.equal_gaps import equal_gaps_policy
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import policy_loss

if TYPE_CHECKING:
    from pandas import DataFrame


class _LossRow(NamedTuple):
    asked: int
    loss: float
    initial_loss: float
    loss_bound: float


class LossHistory:
    """Losses of a learner's policy after each answer, from question zero.

    Give the object to ``qlearn.solve`` or ``qlearn.drive`` as ``progress``. Its first row is of the
    policy for equal gaps, before any question. All losses are shares of the value range, as
    ``Result.loss_bound`` is.

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    values : array_like, optional
        (k,) the hidden value of each level, increasing, for the true losses. Without them these are
        nan.
    bound : bool
        Whether to compute the loss bound after each answer, which takes time. Without it the bounds
        are nan.

    Raises
    ------
    ValueError
        If ``values`` are not k increasing numbers, or ``bound`` is not True or False.

    Examples
    --------
    >>> mdp, values = qlearn.random_mdp(n_states=20, n_actions=3, n_levels=5, seed=1)
    >>> history = qlearn.LossHistory(mdp, values)
    >>> tutor = elicit.TruthfulTutor(values)
    >>> result = qlearn.solve(mdp, tutor, "polytope", seed=0, progress=history)
    >>> history.asked[0], history.asked[-1] == result.asked
    (np.int64(0), np.True_)
    """

    def __init__(
        self, mdp: OrdinalMDP, values: ArrayLike | None = None, *, bound: bool = True
    ) -> None:
        require(isinstance(bound, bool), "bound", "True or False", bound)
        self._mdp = mdp
        self._values = None if values is None else np.asarray(values, dtype=float)
        self._bound = bound
        policy = equal_gaps_policy(mdp)
        self._rows = [self._row(0, policy, PolytopeComparator(mdp.k))]

    def __call__(self, result: Result) -> None:
        """Add a row for the result so far. Rows come in the order of the answers.

        Parameters
        ----------
        result : Result
        """
        bound = result.loss_bound if self._bound else np.nan
        self._rows.append(_LossRow(result.asked, *self._losses(result.policy), bound))

    @property
    def asked(self) -> NDArray[np.int64]:
        """Numbers (n,) of questions asked, 0 first."""
        return np.array([row.asked for row in self._rows], dtype=np.int64)

    @property
    def loss(self) -> Floats:
        """True losses (n,) at the worst state."""
        return np.array([row.loss for row in self._rows])

    @property
    def initial_loss(self) -> Floats:
        """True losses (n,) from the initial distribution."""
        return np.array([row.initial_loss for row in self._rows])

    @property
    def loss_bound(self) -> Floats:
        """Upper bounds (n,) on the loss at the worst state."""
        return np.array([row.loss_bound for row in self._rows])

    def after(self, asked: ArrayLike) -> NDArray[np.int64]:
        """Return the index of the last row with at most so many questions, for each given number.

        For example, ``history.loss[history.after(range(30))]`` is a curve of thirty points, even if
        the learner ended earlier.

        Parameters
        ----------
        asked : (n,)
            Numbers of questions.

        Returns
        -------
        (n,) int
            Rows, counted from 0.
        """
        return np.searchsorted(self.asked, np.asarray(asked), side="right") - 1

    def frame(self) -> DataFrame:
        """Return the rows as a table: question zero, then one row for each call.

        Returns
        -------
        pandas.DataFrame
            Its columns are ``asked``, ``loss``, ``initial_loss`` and ``loss_bound``.
        """
        from pandas import DataFrame

        return DataFrame(self._rows)

    def _row(self, asked: int, policy: NDArray[np.int64], known: Comparator) -> _LossRow:
        bound = loss_bound(self._mdp, policy, known).loss_bound if self._bound else np.nan
        return _LossRow(asked, *self._losses(policy), bound)

    def _losses(self, policy: NDArray[np.int64]) -> tuple[float, float]:
        if self._values is None:
            return np.nan, np.nan
        loss = policy_loss(self._mdp, policy, self._values)
        return float(loss.max()), float(self._mdp.initial @ loss)
