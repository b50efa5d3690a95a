"""The parts of a run that a user's factories make, each checked for what a run needs.

Errors name the factory.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from elicit.model.comparator import Comparator, check_comparator_made
from elicit.model.query import Answer, Query
from elicit.model.scale import Floats, gaps
from elicit.model.tutor import CountsErrors, Tutor
from elicit.tutors.simulated import TruthfulTutor
from qlearn.experiments.factories import Own
from qlearn.learners.learner import Learner
from qlearn.mdp.ordinal_mdp import OrdinalMDP


def problem_of(own: Own, seed: int) -> tuple[OrdinalMDP, Floats]:
    """Return the MDP and the hidden values (k,) of a factory(seed).

    Raise ValueError unless it returns such a pair.
    """
    made = own.made(seed)
    pair = made if isinstance(made, tuple) and len(made) == 2 else (None, None)
    if not isinstance(pair[0], OrdinalMDP):
        raise ValueError(
            f"{_named(own, seed=seed)} must return (mdp, values), an OrdinalMDP and its scale, not "
            f"{made!r}"
        )
    mdp = pair[0]
    try:
        values = np.array(pair[1], dtype=np.float64)
        gaps(values)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{_named(own, seed=seed)} returned values that are no scale: {error}"
        ) from error
    if values.shape != (mdp.k,):
        raise ValueError(
            f"{_named(own, seed=seed)} returned {len(values)} values for an MDP of {mdp.k} levels"
        )
    return mdp, values


def comparator_of(own: Own, k: int, seed: int) -> Comparator:
    """Return the comparator of a factory(k, seed).

    Raise ValueError for anything else, and for one of other levels.
    """
    made = own.made(k, seed)
    try:
        check_comparator_made(made)
    except TypeError as error:
        raise ValueError(
            f"{_named(own, k=k, seed=seed)} returned no comparator: {error}"
        ) from error
    if made.k != k:
        raise ValueError(
            f"{_named(own, k=k, seed=seed)} returned a comparator of k = {made.k}: it must be made "
            f"for {k}"
        )
    comparator: Comparator = made
    return comparator


def learner_of(own: Own, mdp: OrdinalMDP, comparator: Comparator, seed: int) -> Learner:
    """Return the learner of a factory(mdp, comparator, seed), or raise ValueError."""
    made = own.made(mdp, comparator, seed)
    if not isinstance(made, Learner):
        raise ValueError(f"{_named(own, seed=seed)} must return a qlearn.Learner, not {made!r}")
    return made


def tutor_of(
    own: Own, values: Floats, seed: int, reference: Callable[[], Floats]
) -> Counted | CountsErrors:
    """Return the tutor of a factory(values, seed).

    The factory may have a third parameter called reference. It then gets ``reference``, the
    differences (n, k) by which its noise can be set. Raise ValueError if the result is no tutor.
    """
    wants = "reference" in inspect.signature(own.factory).parameters
    made = own.made(values.copy(), seed, **({"reference": reference()} if wants else {}))
    if isinstance(made, type) or not callable(made):
        raise ValueError(
            f"{_named(own, seed=seed)} must return a tutor, which takes a query, not {made!r}"
        )
    return made if isinstance(made, CountsErrors) else Counted(made, values)


class Counted:
    """A tutor that counts its verdicts, and those that differ from the hidden values' (k,)."""

    def __init__(self, tutor: Tutor, values: Floats) -> None:
        self._tutor, self._truth = tutor, TruthfulTutor(values)
        self._given = self._wrong = 0

    def __call__(self, query: Query) -> Answer:
        """Return the tutor's answer. Raise TypeError unless it is an Answer."""
        answer = self._tutor(query)
        if not isinstance(answer, Answer):
            raise TypeError(
                f"a tutor returns an elicit.Answer, but {self._tutor!r} returned {answer!r}"
            )
        if answer.verdict is not None:
            true = int(self._truth.signs(query.d)[0])
            self._given += 1
            self._wrong += true != 0 and int(answer.verdict) != true
        return answer

    @property
    def realised_error_rate(self) -> float:
        """Share of the verdicts that are wrong; nan before the first.

        Calling either of two equal vectors better is not wrong. Calling two that differ equal is.
        """
        return self._wrong / self._given if self._given else float("nan")


def _named(own: Own, **arguments: Any) -> str:
    """Return the factory and the arguments of its call, as text."""
    return (
        f"{own.name!r}: the factory, called with "
        f"{', '.join(f'{name} = {x}' for name, x in arguments.items())},"
    )
