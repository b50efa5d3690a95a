"""The families by name, each as a factory of a seed. A family is imported when it is first made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from elicit._support.hashing import Seed
    from qlearn.mdp.ordinal_mdp import OrdinalMDP

    Family: TypeAlias = Callable[[Seed | None], OrdinalMDP]
    """A factory: from a seed to a problem of the default size."""


def _rover(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.grids import rover

    return rover(seed)


def _hazards(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.grids import hazards

    return hazards(seed)


def _side_effects(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.grids import side_effects

    return side_effects(seed)


def _surgery(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.illness import surgery

    return surgery(seed)


def _care(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.illness import care

    return care(seed)


def _career(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.ventures import career

    return career(seed)


def _plant(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.ventures import plant

    return plant(seed)


def _fishery(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.waters import fishery

    return fishery(seed)


def _reservoir(seed: Seed | None = None) -> OrdinalMDP:
    from qlearn.problems.families.waters import reservoir

    return reservoir(seed)


FAMILIES: Mapping[str, Family] = {
    "rover": _rover,
    "hazards": _hazards,
    "side-effects": _side_effects,
    "surgery": _surgery,
    "care": _care,
    "career": _career,
    "plant": _plant,
    "fishery": _fishery,
    "reservoir": _reservoir,
}
"""Factories of the families by name: ``FAMILIES["rover"](seed)`` returns an ``OrdinalMDP``."""
