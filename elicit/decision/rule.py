"""What a comparator knows, as plain arrays: the rule by which compiled loops judge (``elicit.decision.judge``).

A loop that compares by the million cannot call Python for each comparison. It takes a comparator's ``rule`` anew after
every update. One type for all rules, so that a loop is compiled once, for whatever comparator.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit.lp.vertices import Known
from elicit.model.comparator import Comparator, Dominance
from elicit.model.scale import Floats

NOTHING, SILENT, PROVEN, OUTER, WEIGHTED, ENSEMBLE, BOX = range(7)
PROOFS = (PROVEN, OUTER)  # whose arrays compiled code writes to


class Rule(NamedTuple):
    """How to judge: by ``kind``, with the arrays that it needs; the others are empty."""

    kind: int
    known: Known
    scales: Floats  # (p, m)
    weights: Floats  # (m,)
    level: float


def nothing() -> Rule:
    """No arrays: only the comparator itself can tell."""
    return _NOTHING


def silent() -> Rule:
    """Beyond the order of the levels nothing is known: every other comparison is UNKNOWN."""
    return _NOTHING._replace(kind=SILENT)


def proven(known: Known) -> Rule:
    """By proofs about K_t."""
    return _NOTHING._replace(kind=PROVEN, known=known)


def outer(known: Known) -> Rule:
    """By proofs about a set around that of the plausible scales: what they leave open, only the comparator can tell."""
    return _NOTHING._replace(kind=OUTER, known=known)


def weighted(gaps: Floats, weights: Floats, level: float) -> Rule:
    """BETTER where scales of gaps (p, m) that carry the weight ``level`` say so; weights (m,) of total 1."""
    return _NOTHING._replace(kind=WEIGHTED, scales=gaps, weights=weights, level=level)


def ensemble(gaps: Floats, left_out: int) -> Rule:
    """BETTER where the last of the scales of gaps (p, m) says so, and all but so many of the others."""
    return _NOTHING._replace(kind=ENSEMBLE, scales=gaps, level=float(left_out))


def box(low: Floats, high: Floats) -> Rule:
    """BETTER where the whole box of values low (p,) to high (p,) of levels 2..k says so."""
    return _NOTHING._replace(kind=BOX, scales=np.ascontiguousarray(np.stack([low, high], axis=1)))


def rule_of(comparator: Comparator) -> Rule:
    """The comparator's ``rule``; ``nothing()`` where it has none, or a class derived from it compares otherwise."""
    kind = type(comparator)
    if kind is Dominance:
        return silent()
    if not _rules(kind):
        return nothing()
    rule: Rule = comparator.rule  # type: ignore[attr-defined]
    return rule


@cache
def _rules(kind: type) -> bool:
    """Whether the class that says how to compare also says by which rule."""
    says = {name: [name in vars(parent) for parent in kind.__mro__] for name in ("rule", "compare", "decide")}
    first = {name: found.index(True) for name, found in says.items() if True in found}
    return "rule" in first and first["rule"] <= min(first.get("compare", 0), first.get("decide", first["rule"]))


def outlasts_answers(rule: Rule) -> bool:
    """Whether what ``judge`` found with a rule before these answers still holds with this one: verdicts proven of K_t
    do, while it has points inside (on a flat one a preference can become a tie)."""
    return rule.kind == PROVEN and not np.isnan(rule.known.inside[0])


def _no_proofs() -> Known:
    none, table, count = np.empty(0), np.empty((0, 0)), np.empty(0, np.int64)
    masks: NDArray[np.uint64] = np.empty(0, np.uint64)
    return Known(
        margin=0.0, cuts=table, limits=none, open=none, rows=table, lifted=table, masks=masks, inside=none, room=none,
        points=table, inverses=np.empty((0, 0, 0)), active=np.empty((0, 0), np.int64), kind=np.empty(0, np.int8),
        age=count, counts=np.zeros(4, np.int64),
    )  # fmt: skip


_NOTHING = Rule(NOTHING, _no_proofs(), np.empty((0, 0)), np.empty(0), 0.0)
