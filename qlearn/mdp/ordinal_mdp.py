"""Ordinal reward MDPs (the paper's section 2.2): transitions are numbers, rewards are levels."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from elicit._support.keywords import check_keywords
from elicit._support.validation import is_number, require
from elicit.model.scale import Floats, normalise
from qlearn.mdp import array_checks as checks
from qlearn.mdp import gymnasium_tables
from qlearn.mdp import transition_tables as tables
from qlearn.mdp.array_checks import Flags, Indices, called


class _Parts(TypedDict, total=False):
    """The keywords of every way to make an MDP. ``OrdinalMDP`` says what each means."""

    initial: ArrayLike | None
    terminal: ArrayLike | None
    state_names: Sequence[str] | None
    action_names: Sequence[str] | None


class _AllParts(_Parts, total=False):
    """The keywords of ``_Parts`` and ``admissible``, which ``from_pairs`` finds out by itself."""

    admissible: ArrayLike | None


@dataclass(frozen=True, eq=False, repr=False, init=False)
class OrdinalMDP:
    """An MDP whose reward is one of k named levels, worst first, of unknown value.

    Array-likes are accepted and copied. Arrays of the stored type that are read-only and own their
    memory are not copied. The stored arrays are read-only.

    Parameters
    ----------
    successors : (S, A, b) int
        The next state after action a in state s is ``successors[s, a, j]`` with probability
        ``probabilities[s, a, j]``. A successor may appear twice in a row; its probabilities add.
    probabilities : (S, A, b)
        Shorter rows are padded with probability 0.
    levels : (S, A) int
        From 0 to k - 1.
    discount : float
        In [0, 1).
    labels : (k,) str
        The names of the levels.

    Other Parameters
    ----------------
    initial : (S,), optional
        The distribution of an episode's first state. Default: uniform over the states that are not
        terminal.
    terminal : (S,) bool, optional
        The states where episodes end. Default: none.
    admissible : (S, A) bool, optional
        The actions that exist in each state. Default: all.
    state_names : (S,) str, optional
    action_names : (A,) str, optional
        Names for people, which queries use in place of numbers. The ``fingerprint`` leaves them
        out, so that a log still fits when a name is corrected.

    Raises
    ------
    ValueError
        For an impossible value. The message names its index.
    TypeError
        For anything that is no array of numbers, and for an unknown keyword.

    Notes
    -----
    A terminal state's value is its level for ever, so its levels must agree over its admissible
    actions.

    Entries that are never read need not be valid, and are overwritten. The rows of a terminal state
    become a self-loop. Those of an inadmissible action get probability 0 throughout. The successors
    of padding become the row's last real successor: a sampler that runs off the end by rounding
    gets that.

    Rows (and ``initial``) that sum to 1 within 1e-9 but not within 1e-12 are divided by their sum.
    """

    successors: NDArray[np.integer[Any]]  # int32 once stored
    probabilities: Floats
    levels: NDArray[np.integer[Any]]  # int32 once stored
    discount: float
    labels: tuple[str, ...]
    initial: Floats
    terminal: Flags
    admissible: Flags
    state_names: tuple[str, ...] | None
    action_names: tuple[str, ...] | None

    def __init__(
        self,
        successors: ArrayLike,
        probabilities: ArrayLike,
        levels: ArrayLike,
        discount: float,
        labels: Sequence[str],
        **rest: Unpack[_AllParts],
    ) -> None:
        check_keywords(type(self), rest, _AllParts.__annotations__)
        probabilities = checks.numbers("probabilities", probabilities)
        if probabilities.ndim != 3 or 0 in probabilities.shape:
            raise ValueError(
                "probabilities must have shape (S, A, b), each at least 1, not "
                f"{probabilities.shape}; "
                "OrdinalMDP.from_dense takes a table (S, A, S), from_sparse a sparse one"
            )
        n, m, b = probabilities.shape
        targets = checks.numbers("successors", successors, (n, m, b), whole=True)
        labels = checks.labels(labels)
        states = checks.names("state_names", rest.get("state_names"), n)
        actions = checks.names("action_names", rest.get("action_names"), m)

        def place(state: int, action: int) -> str:
            return f"{called('state', state, states)}, {called('action', action, actions)}"

        levels = checks.levels(levels, (n, m), len(labels), place)
        holds = is_number(discount, 0) and float(discount) < 1
        require(holds, "discount", "a number in [0, 1)", discount)
        terminal = checks.flags("terminal", rest.get("terminal"), (n,), default=False)
        admissible = checks.flags("admissible", rest.get("admissible"), (n, m), default=True)
        if terminal.all():
            raise ValueError(
                f"all {n} states are terminal: there is nothing to decide; clear at least one"
            )
        if not admissible.any(axis=1).all():
            s = int(np.argmin(admissible.any(axis=1)))
            raise ValueError(
                f"{called('state', s, states)} has no admissible action; set at least one of "
                f"admissible[{s}]"
            )
        checks.check_terminal_levels(levels, terminal, admissible, states)
        successors, probabilities = checks.clean(
            targets, probabilities, terminal, admissible, place
        )

        initial = rest.get("initial")
        if initial is None:
            initial = ~terminal / np.count_nonzero(~terminal)
        else:
            initial = checks.distributions("initial", checks.numbers("initial", initial, (n,)))
            checks.reject(
                "initial",
                initial,
                terminal & (initial != 0),
                "must be 0: an episode cannot start in a terminal state",
            )

        stored = (
            successors,
            probabilities,
            levels,
            float(discount),
            labels,
            initial,
            terminal,
            admissible,
            states,
            actions,
        )
        for field, value in zip(fields(self), stored, strict=True):
            object.__setattr__(self, field.name, value)
        self._freeze()

    def _freeze(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._freeze()  # unpickled arrays are writeable

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return the same object: it never changes, so a copied learner can share its problem."""
        return self

    @classmethod
    def from_dense(
        cls,
        transitions: ArrayLike,
        levels: ArrayLike,
        discount: float,
        labels: Sequence[str],
        **rest: Unpack[_AllParts],
    ) -> OrdinalMDP:
        """Make an MDP from a dense table ``transitions`` (S, A, S) of p(s, a, s').

        Parameters
        ----------
        transitions : (S, A, S)
            ``transitions[s, a, t]`` is the probability of state t after action a in state s.
        levels : (S, A) int
            From 0 to k - 1.
        discount : float
            In [0, 1).
        labels : (k,) str
            The names of the levels.
        **rest
            initial, terminal, admissible, state_names and action_names, as for ``OrdinalMDP``.

        Returns
        -------
        OrdinalMDP
            The MDP.

        Raises
        ------
        ValueError
            For an impossible value. Other errors are as for ``OrdinalMDP``.
        """
        return cls.from_sparse(tables.from_dense(transitions), levels, discount, labels, **rest)

    @classmethod
    def from_sparse(
        cls,
        transitions: tables.Matrix | Sequence[tables.Matrix],
        levels: ArrayLike,
        discount: float,
        labels: Sequence[str],
        **rest: Unpack[_AllParts],
    ) -> OrdinalMDP:
        """Make an MDP from sparse ``transitions``.

        All rows are stored at the length of the longest. So a single state with very many
        successors makes the whole table large.

        Parameters
        ----------
        transitions : SciPy matrix, or sequence of SciPy matrices
            A single matrix (S*A, S) whose row s*A + a belongs to (s, a), as in
            ``OrdinalMDP.transitions``, or a sequence of A matrices (S, S), one for each action.
        levels : (S, A) int
            From 0 to k - 1.
        discount : float
            In [0, 1).
        labels : (k,) str
            The names of the levels.
        **rest
            initial, terminal, admissible, state_names and action_names, as for ``OrdinalMDP``.

        Returns
        -------
        OrdinalMDP
            The MDP.

        Raises
        ------
        ValueError
            For an impossible value. Other errors are as for ``OrdinalMDP``.
        """
        matrix = tables.from_sparse(transitions)
        n = matrix.shape[1]
        ends = checks.flags("terminal", rest.get("terminal"), (n,), default=False)
        offered = checks.flags(
            "admissible", rest.get("admissible"), (n, matrix.shape[0] // n), default=True
        )
        successors, probabilities = tables.padded(matrix, offered & ~ends[:, None])
        rest["terminal"], rest["admissible"] = ends, offered
        return cls(successors, probabilities, levels, discount, labels, **rest)

    @classmethod
    def from_pairs(
        cls,
        levels: ArrayLike,
        transitions: tables.Matrix | ArrayLike,
        s_indices: ArrayLike,
        a_indices: ArrayLike,
        discount: float,
        labels: Sequence[str],
        **rest: Unpack[_Parts],
    ) -> OrdinalMDP:
        """Make an MDP from its L state-action pairs, as QuantEcon's DiscreteDP takes them.

        Parameters
        ----------
        levels : (L,) int
            The level of each pair, from 0 to k - 1. They take the place of DiscreteDP's rewards R.
        transitions : (L, S), sparse or dense
            The probability of each next state. They take the place of DiscreteDP's Q.
        s_indices, a_indices : (L,) int
            The state and the action of each pair, in any order. A pair that is not listed is
            inadmissible.
        discount : float
            In [0, 1).
        labels : (k,) str
            The names of the levels.
        **rest
            initial, terminal, state_names and action_names, as for ``OrdinalMDP``.

        Returns
        -------
        OrdinalMDP
            The MDP.

        Raises
        ------
        ValueError
            For pairs out of range or listed twice, and for a state without any. Other errors are as
            for ``OrdinalMDP``.
        """
        matrix, each, listed = tables.from_pairs(
            levels, transitions, s_indices, a_indices, len(labels)
        )
        return cls.from_sparse(matrix, each, discount, labels, admissible=listed, **rest)

    @classmethod
    def from_environment(
        cls,
        env: Any,
        discount: float,
        *,
        levels: Mapping[float, str] | Sequence[float] | None = None,
        labels: Sequence[str] | None = None,
        initial: ArrayLike | None = None,
        after: float = 0.0,
    ) -> OrdinalMDP:
        """Make an MDP from an environment that carries its tables, as Gymnasium's toy texts do.

        Parameters
        ----------
        env : gymnasium.Env
            ``env.unwrapped.P`` must have ``P[s][a]``, a list of (probability, next state, reward,
            terminated).
        discount : float
            In [0, 1).
        levels : sequence or mapping, optional
            The meaning of the rewards. It is a sequence of rewards, worst first, or a mapping from
            reward to the name of its level, in which several rewards may have the same name.
            Default: the distinct rewards in increasing order are the levels.
        labels : (k,) str, optional
            The names of the levels, worst first. With a mapping these are its names, by default in
            the order in which they first appear there.
        initial : (n,), optional
            The distribution of an episode's first state, over the environment's n states. Default:
            ``env.unwrapped.initial_state_distrib``, if there is one.
        after : float
            After the end of an episode every further step counts as one with this reward, which
            needs a level too. Default: 0.

        Returns
        -------
        OrdinalMDP
            States 0..n-1 are the environment's, so a policy's first n entries are a policy for it.
            States after the end are appended.

        Raises
        ------
        TypeError
            If there are no tables.
        ValueError
            For a reward without a level.

        Notes
        -----
        If a reward depends on the next state, it is counted on arrival, one step later. This
        changes no preference between two policies, and scales their differences by ``discount``. A
        state that can be entered with different rewards is appended once for each further one.
        """
        return cls(**gymnasium_tables.read(env, discount, levels, labels, initial, after))

    @property
    def n_states(self) -> int:
        """Number of states, S."""
        return int(self.levels.shape[0])

    @property
    def n_actions(self) -> int:
        """Number of actions, A."""
        return int(self.levels.shape[1])

    @property
    def k(self) -> int:
        """The number of levels."""
        return len(self.labels)

    @cached_property
    def final_level(self) -> Indices:
        """Level (S,) of each terminal state; -1 if a state is not terminal."""
        first = np.argmax(self.admissible, axis=1)
        level: Indices = np.where(
            self.terminal, self.levels[np.arange(self.n_states), first], -1
        ).astype(np.int32)
        level.flags.writeable = False
        return level

    @cached_property
    def transitions(self) -> sparse.csr_array:
        """The transition matrix P as CSR (S*A, S). Row s*A + a belongs to (s, a).

        A terminal state's admissible actions lead back to it. The row of an inadmissible action is
        empty. Do not write to the matrix.
        """
        n, m, b = self.probabilities.shape
        p, column = self.probabilities.reshape(-1), self.successors.reshape(-1)
        used = p != 0
        counts = np.count_nonzero(used.reshape(n * m, b), axis=1)
        ends = np.concatenate([[0], np.cumsum(counts)]).astype(
            np.int32 if p.size < 2**31 else np.int64
        )
        if (
            not used.all()
        ):  # otherwise the arrays themselves: at a million states a copy would be a gigabyte
            p, column = p[used], column[used]
        matrix = sparse.csr_array(
            (p, column.astype(ends.dtype, copy=False), ends), shape=(n * m, n)
        )
        if not matrix.has_canonical_format:
            matrix = matrix.copy()
            matrix.sum_duplicates()
        matrix.data.flags.writeable = False
        return matrix

    def state_name(self, state: int) -> str:
        """Return a state's name, or its number.

        Parameters
        ----------
        state : int
            The state, counted from 0.

        Returns
        -------
        str
        """
        return str(state) if self.state_names is None else self.state_names[state]

    def action_name(self, action: int) -> str:
        """Return an action's name, or its number.

        Parameters
        ----------
        action : int
            The action, counted from 0.

        Returns
        -------
        str
        """
        return str(action) if self.action_names is None else self.action_names[action]

    def normalise(self, values: ArrayLike) -> Floats:
        """Return values of the levels as a scale from 0 to 1.

        Parameters
        ----------
        values : (k,)
            The value of each level, worst first, in any unit.

        Returns
        -------
        (k,)
            (values - values[0]) / (values[-1] - values[0]).

        Raises
        ------
        ValueError
            Unless they are k finite, strictly increasing values.
        """
        scale = normalise(values)
        if scale.size != self.k:
            raise ValueError(f"values must be {self.k} numbers, one a level, not {scale.size}")
        return scale

    def rewards(self, values: ArrayLike) -> Floats:
        """Return the numeric rewards r(s, a) if level i is worth values[i].

        Any solver for standard MDPs takes the result, together with ``transitions`` and
        ``discount``.

        Parameters
        ----------
        values : (k,)
            The value of each level, worst first, in any unit. They are used as they are.

        Returns
        -------
        (S, A)
            In the unit of ``values``.

        Raises
        ------
        ValueError
            Unless they are k finite, strictly increasing values.
        """
        self.normalise(values)
        r: Floats = np.asarray(values, dtype=np.float64)[self.levels]
        return r

    def vector_rewards(self) -> Floats:
        """Return one-hot rewards: component i is 1 if the level of (s, a) is i.

        Returns
        -------
        (S, A, k)
        """
        one_hot: Floats = np.eye(self.k)[self.levels]
        return one_hot

    @cached_property
    def fingerprint(self) -> str:
        """Hash (32 hex digits) of all that is stored, except the names of states and actions.

        It is the same on every machine.
        """
        digest = hashlib.blake2b(repr((self.discount, self.labels)).encode(), digest_size=16)
        arrays = ("successors", "probabilities", "levels", "initial", "terminal", "admissible")
        for name, kind in zip(arrays, ("<i4", "<f8", "<i4", "<f8", "?", "?"), strict=True):
            array = np.ascontiguousarray(getattr(self, name), dtype=kind)
            digest.update(f"{name}{array.shape}".encode())
            digest.update(array.data)
        return digest.hexdigest()

    def __repr__(self) -> str:
        scale = " < ".join(
            self.labels if self.k <= 7 else (*self.labels[:3], "...", self.labels[-1])
        )
        parts = [
            f"{self.n_states} states, {self.n_actions} actions, {self.k} levels: {scale}, discount "
            f"{self.discount:g}"
        ]
        if self.terminal.any():
            parts.append(f"{np.count_nonzero(self.terminal)} terminal")
        if not self.admissible.all():
            parts.append(f"{self.admissible.sum(axis=1).mean():.1f} admissible actions a state")
        return f"OrdinalMDP({', '.join(parts)})"
