"""Names and factories that a user brings to an ablation.

A factory is given as a function or as "package.module:factory".

Imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any


@dataclass(frozen=True, eq=False)
class Own:
    """A factory of the user's, and the name that it has in tables and pictures.

    Two are equal if their names and their code are.
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
        """Return the result of the factory.

        Raise ValueError, which names the factory, if it raises an Exception.
        """
        try:
            return self.factory(*arguments, **keywords)
        except Exception as error:
            raise ValueError(
                f"{self.name!r}: the factory raised {type(error).__name__}: {error}"
            ) from error


def own_of(text: str) -> Own:
    """Return the factory of "package.module:factory", or of "name=package.module:factory".

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
