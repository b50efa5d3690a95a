"""Tests of whether a region is empty, and the smallest set of answers that makes it so."""

from functools import partial

import numpy as np

from elicit.lp.dual_simplex import End, Vertex, minimise_exactly
from elicit.lp.region import Region
from elicit.lp.vertex_store import UNOPPOSED
from elicit.model.difference import tail_sums
from elicit.model.pairs import NEAR, same_pairs
from elicit.model.query import Answers, InconsistentAnswers
from elicit.model.scale import Floats


def is_empty(region: Region) -> Vertex | None:
    """Return the exact proof that no scale satisfies every row, or None if some scale does."""
    vertex = minimise_exactly(np.zeros(region.p), region)
    return vertex if vertex.end is End.EMPTY else None


def minimal_conflict(region: Region, proof: Vertex) -> list[int]:
    """Return the numbers of answers that contradict each other, with none that can be left out.

    The search begins with the rows that ``proof`` names, and drops each answer that the
    contradiction does not need (Chinneck and Dravnieks 1991). The order of the levels and the rows
    of the prior always stay. Numbers are those of ``Region.owner``.
    """
    owners = sorted({int(region.owner[i]) for i in proof.support if region.owner[i] >= 0})
    for owner in list(owners):
        rest = [o for o in owners if o != owner]
        keep = np.isin(region.owner, rest) | (region.owner < 0)
        if is_empty(region.take(keep)) is not None:
            owners = rest
    return owners


def opposite_answers(answers: Answers, first: int) -> tuple[int, int] | None:
    """Return two rows of opposite answers to the same pair, or None if there are none.

    One answer says "better" and the other "worse". The later one is in row ``first`` or after it.
    Both could be right only if the pair were equal, which neither says.

    A multiple of a pair counts as the same pair only if the factor is a power of two, because a
    learner may ask about another multiple that rounding leaves open.
    """
    if not (answers.y[first:] != 0).any():
        return None
    sums = tail_sums(answers.d) * answers.y[:, None]
    size = np.abs(sums).max(axis=1, initial=0.0)
    told = np.flatnonzero((size > 0) & np.isfinite(size))
    # scaling makes, for example, the same bags with twice the days the same pair
    unit = np.ldexp(sums[told], -np.frexp(size[told])[1][:, None])
    marks = unit @ np.sqrt(
        np.arange(2.0, answers.k + 1.0)
    )  # marks of opposite answers are opposite, up to rounding
    order = np.argsort(marks)
    new = np.flatnonzero(told >= first)
    near = 4.0 * NEAR * answers.k**1.5
    lowest, highest = (np.searchsorted(marks[order], -marks[new] + side) for side in (-near, near))
    for i in np.flatnonzero(lowest < highest):
        others = np.sort(order[lowest[i] : highest[i]])
        against = others[(others < new[i]) & (same_pairs(unit[new[i]], unit[others]) < 0)]
        if len(against):
            return int(told[against[0]]), int(told[new[i]])
    return None


def exclude_opposites(rows: Floats, g: Floats | None) -> bool:
    """Return whether a quick test shows that the answers with these rows (m, p) have no opposites.

    The test uses a point g (p,) that satisfies every answer; None if there is no such point. It is
    a single product, while ``opposite_answers`` looks through all answers
    (``vertex_store.UNOPPOSED`` says why it suffices).
    """
    return g is not None and bool((rows @ g > UNOPPOSED).all())


def opposed(rows: tuple[int, int], answers: Answers) -> InconsistentAnswers:
    """Return the error that says that answers in two rows are opposite answers to the same pair."""
    found = tuple((row, answers.ids[row]) for row in rows)
    listed = " and ".join(f"row {row} (id {name})" for row, name in found)
    said = (
        f"no scale satisfies these answers together: {listed} say the opposite of each other "
        f"about one pair. That does "
        "not make it equal: one of them is wrong. Drop or correct one of them."
    )
    return InconsistentAnswers(said, found)


def contradiction(region: Region, proof: Vertex, answers: Answers) -> InconsistentAnswers:
    """Return the error that says that no scale fits the answers, as ``proof`` shows."""
    return InconsistentAnswers(partial(_explained, region, proof, answers))


def _explained(
    region: Region, proof: Vertex, answers: Answers
) -> tuple[str, tuple[tuple[int, str], ...], bool]:
    """Return a sentence, a minimal contradictory set of (row, id) pairs, and a flag.

    The flag says whether the answers would be consistent with a margin of 0.
    """
    owners = minimal_conflict(region, proof)
    keep = np.isin(region.owner, owners) | (region.owner < 0)
    found = tuple((row, answers.ids[row]) for row in owners)
    margin = region.margin > 0 and is_empty(region.take(keep, margin=0.0)) is None
    listed = ", ".join(f"row {row} (id {name})" for row, name in found)
    said = (
        f"no scale satisfies these answers together: {listed}. Each is needed for the "
        "contradiction: drop or "
        "correct one of them."
        if len(found) > 1
        else f"no scale satisfies the answer in {listed}: it contradicts the order of the levels, "
        "or the "
        "prior. Drop or correct it."
    )
    if margin:
        allowed = f"the margin {region.margin:g} is above the least gap they allow."
        said += f" With a margin of 0 they would be consistent: {allowed}"
    if any(answers.y[row] == 0 for row, _ in found):
        said += (
            " An answer 'equal' is taken to mean |d.e| <= tie: a wider tie may make room for them."
        )
    return said, found, margin
