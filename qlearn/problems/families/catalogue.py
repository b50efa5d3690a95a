"""The families of problems by name, with factories. A family is imported when first used."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from elicit._support.hashing import Seed
    from qlearn.mdp.ordinal_mdp import OrdinalMDP

    class Family(Protocol):
        """A factory of problems."""

        def __call__(self, seed: Seed | None = None, **size: int) -> OrdinalMDP:
            """Return the problem for a seed, of the default size or of ``size=``."""


_MODULES = {
    "rover": "grids",
    "hazards": "grids",
    "side-effects": "grids",
    "surgery": "illness",
    "care": "illness",
    "career": "ventures",
    "plant": "ventures",
    "fishery": "waters",
    "reservoir": "waters",
}


def _make(name: str, seed: Seed | None = None, **size: int) -> OrdinalMDP:
    module = import_module(f"qlearn.problems.families.{_MODULES[name]}")
    made: OrdinalMDP = getattr(module, name.replace("-", "_"))(seed, **size)
    return made


FAMILIES: Mapping[str, Family] = {name: partial(_make, name) for name in _MODULES}
"""Factories of the families by name: ``FAMILIES["rover"](seed, size=6)`` is an ``OrdinalMDP``."""
