"""Walks between vertices and what they rest on: every result is a proof, however bad the region or
the numbers.
"""

import math
from collections import Counter
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from elicit.lp.dual_simplex import minimise_exactly
from elicit.lp.primal_simplex import (
    CERTAIN_POINT,
    USED,
    VERTEX,
    Known,
    inverse_of,
    keep,
    multipliers,
    pulled_inside,
    redundant,
    vertex_of,
    walk,
)
from elicit.lp.rounding import bound_of, slacks_of, surely_inside
from elicit.lp.vertex_store import prune, start
from tests.lp_cases import dot, exact, exactly, known_sets, normalised, objectives, region
from tests.thoroughness import quick_first, scaled

Floats = np.ndarray[Any, Any]
Rng = np.random.Generator
NOTHING = np.zeros(0, dtype=np.bool_)


def starts(known: Known) -> Any:
    """The vertices that a walk can start from."""
    return np.flatnonzero(known.kind[: known.counts[USED]] != CERTAIN_POINT)


def of(known: Known) -> tuple[float, Floats, Floats]:
    """K_t as the functions of ``rounding`` take it."""
    return known.margin, known.cuts, known.limits


@pytest.mark.parametrize("seed", quick_first(range(3), 1))
def test_a_walk_is_right_or_does_not_know_and_keeps_what_is_certain(seed: int) -> None:
    rng, kept = np.random.default_rng(seed), 0
    seen: Counter[int] = Counter()
    for kind, r, known in known_sets(seed, scaled(42, 70)):
        for s in objectives(rng, r, 8):
            least = minimise_exactly(s, r).value
            for vertex in rng.permutation(starts(known))[:3]:
                before = s.copy()
                found = walk(s, int(vertex), known, NOTHING, 0.0)
                assert (s == before).all()
                assert found == 0 or (least > 0) - (least < 0) == found, (
                    f"{kind}: {found}, but {float(least)}"
                )
                assert found or kind != "plain" or abs(least) < 1e-9, f"gave up at {float(least)}"
                seen[found] += 1
        g, slack = np.empty(r.p), np.empty(r.p + len(r.rows))
        for q in np.flatnonzero(known.kind[: known.counts[USED]] == VERTEX)[:12]:
            kept += 1
            assert exactly(r).contains(normalised(known.points[:, q])), kind
            assert len(set(known.active[q])) == r.p - 1
            if kind == "plain":
                vertex_of(known.inverses[q], known.active[q], known, g)
                slacks_of(g, *of(known), slack)
                assert np.abs(slack[known.active[q]]).max() < 1e-9
                assert slack.min() > -1e-9
                assert np.abs(known.points[:, q] - g).max() < 1e-9
    assert kept > 50
    assert min(seen[1], seen[-1], seen[0]) > 100


def test_only_rows_that_follow_from_the_rest_are_pruned() -> None:
    pruned = 0
    for kind, r, first in known_sets(31, scaled(42, 84)):
        out = redundant(first)
        known, rest = prune(first, r)
        assert (rest.owner == r.owner[~out]).all()
        assert (known.limits == rest.rhs).all()
        assert (known.cuts == rest.rows.T).all()
        for i in np.flatnonzero(out):
            pruned += 1
            assert minimise_exactly(r.rows[i], rest).value >= Fraction(float(r.rhs[i])), kind
    assert pruned > scaled(50, 100)


def test_the_right_multipliers_give_a_tight_bound() -> None:
    rng, checked = np.random.default_rng(6), 0
    for _, r, known in known_sets(50, 28):
        for s in objectives(rng, r, 3):
            vertex = minimise_exactly(s, r)
            active, inverse, y = (
                np.array(vertex.basis, dtype=np.int64),
                np.empty((r.p, r.p)),
                np.empty(r.p),
            )
            if not inverse_of(active, known, inverse) or np.abs(inverse).max() > 100:
                continue
            checked += 1
            assert multipliers(s, inverse[None], 0, y) == -1
            bound = bound_of(s.copy(), y, active[None], 0, r.margin, known.cuts, known.limits)
            assert 0 <= vertex.value - Fraction(bound) < 1e-11
    assert checked > 30


@pytest.mark.parametrize("seed", quick_first(range(3), 1))
def test_a_point_pulled_inside_is_inside(seed: int) -> None:
    rng, pulled, left = np.random.default_rng(seed), 0, 0
    for kind, r, known in known_sets(60 + seed, scaled(42, 70)):
        p, slack, point = r.p, np.empty(r.p + len(r.rows)), np.empty(r.p)
        for _ in range(8):
            g = minimise_exactly(rng.normal(size=p), r).g.astype(np.float64)
            g = g + rng.choice([0.0, 1e-15, 1e-12, 1e-9, 0.3, 1e3]) * rng.normal(size=p)
            if rng.random() < 0.7:
                g /= g.sum()
            slacks_of(g, *of(known), slack)
            slack += rng.choice([0.0, 1e-13, 1.0]) * rng.normal(
                size=len(slack)
            )  # as pivots let it drift
            if pulled_inside(g, slack, known.inside, known.room, *of(known), point):
                pulled += 1
                assert exactly(r).contains(normalised(point)), kind
                s = rng.normal(size=p) + rng.choice([0.0, 1.0]) * -float(rng.normal())
                s = (
                    s - float(s @ point) - rng.choice([0.0, 1e-16, 1e-15, 1e-3])
                )  # s.point is 0, or nearly
                if keep(s, g, slack, np.eye(p), np.arange(p - 1), 0, known):
                    stored = known.points[:, (known.counts[1] - 1) % len(known.kind)]
                    assert dot(exact(s), exact(stored)) < 0
            else:
                left += 1
    assert pulled > scaled(60, 100)
    assert left > 10


def test_a_point_on_the_border_is_not_surely_inside() -> None:
    """Floats cannot tell on which side the segment from the inner point leaves the region."""
    rng, seen = np.random.default_rng(4), {True: 0, False: 0}
    for kind, r, known in known_sets(80, 42):
        slack = np.empty(r.p + len(r.rows))
        for _ in range(20 if not np.isnan(known.inside[0]) else 0):
            towards = rng.normal(size=r.p)
            towards -= towards.mean()
            rate = np.concatenate([towards, r.rows @ towards])
            length = (known.room[rate < 0] / -rate[rate < 0]).min() * (
                1 - rng.choice([0.0, 1e-16, 1e-15, 1e-14, 1e-9])
            )
            g = known.inside + length * towards
            g /= g.sum()
            sure = surely_inside(g, *of(known), slack)
            seen[bool(sure)] += 1
            assert not sure or exactly(r).contains(normalised(g)), kind
            assert sure or slack.min() < 1e-12 * (1 + known.margin)
    assert min(seen.values()) > 50


def test_nothing_is_inside_without_a_point_inside() -> None:
    flat = start(region([[0.5, -0.5, 0.0], [-0.5, 0.5, 0.0]], 1e-6))
    assert np.isnan(flat.inside[0])
    for g in ([1 / 3] * 3, [0.25, 0.25, 0.5], [math.nan] * 3):
        point, slack = np.empty(3), np.empty(5)
        slacks_of(np.array(g), *of(flat), slack)
        assert not surely_inside(np.array(g), *of(flat), slack.copy())
        assert not pulled_inside(np.array(g), slack, flat.inside, flat.room, *of(flat), point)
        assert not pulled_inside(np.array(g), np.ones(5), flat.inside, flat.room, *of(flat), point)
