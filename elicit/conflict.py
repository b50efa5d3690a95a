"""Contradictory answers: whether a region is empty, and a smallest set of answers that makes it so."""

from __future__ import annotations

import numpy as np

from elicit.query import Answers, InconsistentAnswers
from elicit.simplex import End, Region, Vertex, minimise_exactly


def is_empty(region: Region) -> Vertex | None:
    """None where some scale satisfies every row, else the exact proof that none does."""
    vertex = minimise_exactly(np.zeros(region.p), region)
    return vertex if vertex.end is End.EMPTY else None


def minimal_conflict(region: Region, proof: Vertex) -> list[int]:
    """Owners of an irreducible contradictory set of rows, beside the order and the prior: the proof's
    support, from which every answer is dropped that the contradiction does not need (Chinneck and
    Dravnieks 1991). Rows of the prior (owner < 0) always stay."""
    owners = sorted({int(region.owner[i]) for i in proof.support if region.owner[i] >= 0})
    for owner in list(owners):
        rest = [o for o in owners if o != owner]
        keep = np.isin(region.owner, rest) | (region.owner < 0)
        if is_empty(region.take(keep)) is not None:
            owners = rest
    return owners


def raise_conflict(region: Region, proof: Vertex, answers: Answers) -> None:
    """Raise InconsistentAnswers with a minimal set of the answers that empty the region."""
    owners = minimal_conflict(region, proof)
    keep = np.isin(region.owner, owners) | (region.owner < 0)
    without_margin = region.take(keep, margin=0.0)
    margin = region.margin > 0 and is_empty(without_margin) is None
    named = [(row, answers.ids[row]) for row in owners]
    listed = ", ".join(f"row {row} (id {name})" for row, name in named)
    cause = (
        f" With a margin of 0 they would be consistent: the margin {region.margin:g} is above the least gap they allow."
        if margin
        else ""
    )
    raise InconsistentAnswers(
        f"no scale satisfies these {len(named)} answers together: {listed}. Each is needed for the contradiction: "
        f"drop or correct one of them.{cause}",
        named,
        margin,
    )
