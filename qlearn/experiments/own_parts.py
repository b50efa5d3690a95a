"""Parts of an ablation that a user brings: names, factories, and what each factory makes.

A factory is given as a function or as "package.module:factory". Its result is checked for what a
run needs, and errors name the factory. Importing this module imports nothing heavy.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elicit.model.comparator import Comparator
    from elicit.model.scale import Floats
    from elicit.model.tutor import CountsErrors
    from qlearn.experiments.metrics import Counted
    from qlearn.learners.learner import Learner
    from qlearn.mdp.ordinal_mdp import OrdinalMDP


@dataclass(frozen=True, eq=False)
class Own:
    """A user's factory, and its name in tables and pictures.

    Two objects are equal if their names and their code are.
    """

    name: str
    factory: Callable[..., Any]

    @cached_property
    def identity(self) -> str:
        """A hash of the factory's code and of what it depends on (``code_identity.identity``)."""
        from qlearn.experiments.code_identity import identity

        return identity(self.factory)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Own) and (self.name, self.identity) == (other.name, other.identity)

    def __hash__(self) -> int:
        return hash((self.name, self.identity))

    def made(self, *arguments: Any, **keywords: Any) -> Any:
        """Return the result of a call of the factory.

        If it raises an Exception, raise ValueError, which names the factory.
        """
        try:
            return self.factory(*arguments, **keywords)
        except Exception as error:
            given = (*arguments, *keywords.values())
            called = ", ".join(
                repr(each) if isinstance(each, int) else type(each).__name__ for each in given
            )
            raise ValueError(
                f"{self.name!r}: the factory, called with ({called}), raised "
                f"{type(error).__name__}: {error}"
            ) from error


def own_of(text: str) -> Own:
    """Return the factory for "package.module:factory" or "name=package.module:factory".

    Without a name the text is the name. The module is imported. Raise ValueError if there is no
    such module or attribute, or if it cannot be called.
    """
    name, _, where = text.rpartition("=")
    module, _, path = where.partition(":")
    if not module or not path:
        raise ValueError(f"{where!r} is not of the form package.module:factory")
    try:
        found: Any = import_module(module)
    except ModuleNotFoundError as error:
        missing = error.name or module
        if f"{module}.".startswith(f"{missing}."):
            raise ValueError(
                f"{where!r}: there is no module {missing!r} in the current directory or installed"
            ) from None
        raise ValueError(
            f"{where!r}: importing {module} needs {missing!r}, which is not installed"
        ) from error
    except Exception as error:
        raise ValueError(
            f"{where!r}: importing {module} raised {type(error).__name__}: {error}"
        ) from error
    for part in path.split("."):
        if not hasattr(found, part):
            raise ValueError(f"{where!r}: module {module} has no {path!r}")
        found = getattr(found, part)
    if not callable(found):
        raise ValueError(f"{where!r} is no factory: {found!r} cannot be called")
    return Own(name or where, found)


def problem_of(own: Own, seed: int) -> tuple[OrdinalMDP, Floats]:
    """Return the MDP and the hidden values (k,) that a factory(seed) makes.

    Raise ValueError unless it returns such a pair.
    """
    import numpy as np

    from elicit.model.scale import gaps
    from qlearn.mdp.ordinal_mdp import OrdinalMDP

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
    """Return the comparator that a factory(k, seed) makes.

    Raise ValueError if its result is no comparator, or has another number of levels than k.
    """
    from elicit.model.comparator import check_comparator_made

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
    """Return the learner that a factory(mdp, comparator, seed) makes, or raise ValueError."""
    from qlearn.learners.learner import Learner

    made = own.made(mdp, comparator, seed)
    if not isinstance(made, Learner):
        raise ValueError(f"{_named(own, seed=seed)} must return a qlearn.Learner, not {made!r}")
    return made


def tutor_of(
    own: Own, values: Floats, seed: int, reference: Callable[[], Floats]
) -> Counted | CountsErrors:
    """Return the tutor that a factory(values, seed) makes.

    If the factory has a third parameter called reference, it gets ``reference``, the differences
    (n, k) by which its noise can be set. Raise ValueError if the result is no tutor.
    """
    from elicit.model.tutor import CountsErrors
    from qlearn.experiments.metrics import Counted

    wants = "reference" in inspect.signature(own.factory).parameters
    made = own.made(values.copy(), seed, **({"reference": reference()} if wants else {}))
    if isinstance(made, type) or not callable(made):
        raise ValueError(
            f"{_named(own, seed=seed)} must return a tutor, which takes a query, not {made!r}"
        )
    return made if isinstance(made, CountsErrors) else Counted(made, values)


def _named(own: Own, **arguments: Any) -> str:
    """Return a call of the factory as text, for messages: its name and its arguments."""
    return (
        f"{own.name!r}: the factory, called with "
        f"{', '.join(f'{name} = {x}' for name, x in arguments.items())},"
    )
