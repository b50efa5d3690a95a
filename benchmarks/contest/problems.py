"""Problems, hidden scales and tutors of the contest: small versions of the project's families."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import elicit
from benchmarks.contest.harness import Told
from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.grids import hazards, rover
from qlearn.problems.families.illness import care, surgery
from qlearn.problems.families.ventures import career, plant
from qlearn.problems.families.waters import fishery, reservoir
from qlearn.problems.hidden_scales import hidden_scales
from qlearn.problems.random_mdp import random_mdp

KINDS = ("even", "skewed", "convex", "concave")
"""Of hidden scales. The seed picks the kind: each is that of every fourth run."""
SIZES: Mapping[str, tuple[Callable[..., OrdinalMDP], int]] = {
    "rover": (rover, 6),
    "hazards": (hazards, 6),
    "surgery": (surgery, 10),
    "care": (care, 12),
    "career": (career, 24),
    "plant": (plant, 10),
    "fishery": (fishery, 24),
    "reservoir": (reservoir, 10),
}
RANDOM = "random"
"""Random MDPs of the paper's law, with 40 states, 4 actions and 6 levels."""
PROBLEMS = (*SIZES, RANDOM)
FLIPS = 0.1
PRECISION = 30.0
"""Of the tutor of eq. (6): 5% errors where two sides differ by a tenth of the value range."""
TUTORS: Mapping[str, Told] = {
    "truthful": Told("truthful", np.inf, 0.0),
    "flips": Told("flips", np.inf, 2 * FLIPS),
    "eq. (6)": Told("eq. (6)", PRECISION, 0.0),
    "person": Told("person", 60.0, 0.1),  # about the middle of the people that PersonTutor draws
}
"""Tutors, and what is said of each to a method that has a place for it."""


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed."""
    if name == RANDOM:
        return random_mdp(40, 4, 6, seed=seed)[0]
    make, size = SIZES[name]
    return make(seed, size)


def scale(k: int, seed: int) -> Floats:
    """Return the hidden scale (k,) of this seed."""
    return hidden_scales(KINDS[seed % len(KINDS)], k, seed)


def tutor(name: str, values: Floats, seed: int) -> elicit.Tutor:
    """Return the tutor of this name with these hidden values."""
    if name == "truthful":
        return elicit.TruthfulTutor(values)
    if name == "flips":
        return elicit.FlippingTutor(values, FLIPS, seed=seed)
    if name == "eq. (6)":
        return elicit.BradleyTerryTutor(values, PRECISION, seed=seed)
    return elicit.PersonTutor(values, seed=seed)


@cache
def plan() -> Mapping[str, Any]:
    """Return what ``held_out.toml`` says."""
    text = (Path(__file__).parent / "held_out.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)
