"""A comparator's knowledge as plain arrays: the rule by which ``decision.judge_kernel`` decides.

A loop that compares by the million cannot call Python for each comparison. It takes a comparator's
``rule`` anew after every update. One type for all rules, so that code that judges is compiled once,
for whatever comparator.
"""

from functools import cache
from typing import NamedTuple, Protocol, cast, runtime_checkable

import numpy as np

from elicit.lp.primal_simplex import Known, nothing_known
from elicit.model.comparator import Comparator, Decisions
from elicit.model.scale import Floats

NOTHING, ASKING, SILENT, PROVEN, OUTER, WEIGHTED, ENSEMBLE, BOX = range(8)
PROOFS = (PROVEN, OUTER)  # whose arrays compiled code writes to


class Rule(NamedTuple):
    """How to judge: by ``kind``, with the arrays that it needs; the others are empty."""

    kind: int
    dominance: bool  # whether eq. (4) decides before anything else
    known: Known
    scales: Floats  # (p, m)
    weights: Floats  # (m,)
    level: float


class Ruled(Protocol):
    """A comparator that judges by a rule."""

    @property
    def rule(self) -> Rule:
        """What it knows, as plain arrays."""


@runtime_checkable
class Settling(Protocol):
    """A comparator that can tell what its rule leaves open."""

    def settle(self, d: Floats) -> Decisions:
        """Verdicts and tiers (n,) of differences d (n, k) that the rule leaves UNSETTLED."""


@cache
def nothing() -> Rule:
    """No arrays: beyond dominance, only the comparator itself can tell."""
    known = nothing_known(0.0, np.empty((0, 0)), np.empty(0), corners=0)
    return Rule(NOTHING, True, known, np.empty((0, 0)), np.empty(0), 0.0)


def unaided() -> Rule:
    """No arrays, and dominance says nothing either: only the comparator itself can tell."""
    return nothing()._replace(dominance=False)


def asking() -> Rule:
    """Everything is UNKNOWN but what is EQUAL."""
    return nothing()._replace(kind=ASKING, dominance=False)


def silent() -> Rule:
    """Beyond the order of the levels nothing is known: every other comparison is UNKNOWN."""
    return nothing()._replace(kind=SILENT)


def proven(known: Known) -> Rule:
    """By proofs about K_t."""
    return nothing()._replace(kind=PROVEN, known=known)


def outer(known: Known, inside: Floats) -> Rule:
    """By proofs about a set around that of the plausible scales, and by points inside (p, m): what
    they leave open, only the comparator can tell."""
    return nothing()._replace(kind=OUTER, known=known, scales=np.ascontiguousarray(inside))


def weighted(gaps: Floats, weights: Floats, level: float) -> Rule:
    """BETTER where scales of gaps (p, m) that carry the weight ``level`` say so; weights (m,) of
    total 1.
    """
    return nothing()._replace(kind=WEIGHTED, scales=gaps, weights=weights, level=level)


def ensemble(gaps: Floats, left_out: int) -> Rule:
    """BETTER where the last of the scales of gaps (p, m) says so, and all but so many of the
    others.
    """
    return nothing()._replace(kind=ENSEMBLE, scales=gaps, level=float(left_out))


def box(low: Floats, high: Floats) -> Rule:
    """BETTER where the whole box of values low (p,) to high (p,) of levels 2..k says so."""
    return nothing()._replace(kind=BOX, scales=np.ascontiguousarray(np.stack([low, high], axis=1)))


def rule_of(comparator: Comparator) -> Rule:
    """The comparator's rule; ``nothing()`` where it does not compare by one."""
    return cast(Ruled, comparator).rule if compares_by_rule(type(comparator)) else nothing()


@cache
def compares_by_rule(kind: type) -> bool:
    """Whether a class of comparators has a ``rule``, and no class derived from that one compares
    otherwise.
    """
    places = [*enumerate(kind.__mro__)][::-1]
    first = {
        name: i for name in ("rule", "compare") for i, parent in places if name in vars(parent)
    }
    return "rule" in first and first["rule"] <= first.get("compare", 0)


def outlasts_answers(rule: Rule) -> bool:
    """Whether what ``judge`` found with a rule before these answers still holds with this one:
    verdicts proven of K_t do, while it has points inside (on a flat one a preference can become a
    tie)."""
    return rule.kind == PROVEN and not np.isnan(rule.known.inside[0])
