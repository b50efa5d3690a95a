"""The cheap proofs one by one, in rationals, and what may be handed to ``compare`` and
``decide``.
"""

import math
from collections import Counter
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from elicit import Answers, PolytopeComparator, Verdict, decide
from elicit.lp.dual_simplex import minimise_exactly
from elicit.lp.primal_simplex import ROW, Known
from elicit.lp.rounding import score_doubt
from elicit.lp.sign_proofs import (
    NOWHERE,
    lifting_row,
    lifts,
    side_of,
    sign_of,
    signs_at_points,
    signs_together,
)
from elicit.lp.vertex_store import know_rows, start
from elicit.model.difference_kernel import LEFT_OPEN, by_dominance, to_order_one
from tests.lp_cases import (
    KINDS,
    Oracle,
    answered,
    dot,
    draw_truth,
    exact,
    known_sets,
    normalised,
    objectives,
    region,
    region_of,
    shares,
    tails,
    verdict,
)
from tests.thoroughness import quick_first, scaled

Floats = np.ndarray[Any, Any]
Rng = np.random.Generator
finite = st.floats(allow_nan=False, allow_infinity=False)
wild = st.one_of(
    finite, st.sampled_from([0.0, -0.0, 5e-324, -5e-324, 1.7e308, -1.7e308, 1e300, 1e-300, 1.0])
)
vectors = st.lists(wild, min_size=2, max_size=9)


@pytest.mark.parametrize("seed", range(2))
def test_the_side_of_a_point_is_certain(seed: int) -> None:
    rng, told = np.random.default_rng(seed), Counter[int]()
    for _ in range(300):
        p = int(rng.integers(1, 12))
        g = rng.dirichlet(np.full(p, rng.choice([0.05, 1.0])))
        t = rng.normal(size=p) * 10.0 ** rng.uniform(-12, 0, size=p)
        t = t - rng.choice([0.0, 1.0, 1.0]) * (float(t @ g) + 10.0 ** rng.uniform(-18, -12))
        size, _ = to_order_one(t)
        side = side_of(t, g, score_doubt(p, size))
        value = dot(exact(t), normalised(g))
        assert side == 0 or side == (value > 0) - (value < 0)
        assert side or abs(value) < 1e-13
        told[side] += 1
    assert min(told[-1], told[0], told[1]) > 10


@cache
def nothing_known(p: int) -> Known:
    return start(region(np.empty((0, p))))


def knowing(rows: Floats) -> Known:
    """Return these known rows, and nothing else that is known."""
    known = nothing_known(rows.shape[1])._replace(
        rows=np.empty(rows.shape), lifted=np.empty(rows.shape)
    )
    known = known._replace(masks=np.empty(len(rows), np.uint64), counts=known.counts.copy())
    know_rows(known, rows, np.zeros(len(rows)))
    return known


def is_lifted(t: Floats, side: int, w: Floats) -> bool:
    """Return whether side * t >= lambda w for some lambda >= 0, in rationals."""
    low, high = Fraction(0), None
    for a, b in zip(exact(side * t), exact(w), strict=True):
        if b == 0 and a < 0:
            return False
        if b < 0:
            low = max(low, a / b)
        if b > 0:
            high = a / b if high is None else min(high, a / b)
    return high is None or low <= high


def a_row(rng: Rng, p: int, tiny: bool = False) -> Floats:
    how = rng.integers(4)
    w = rng.normal(size=p)
    if how == 1:
        w = rng.integers(-2, 3, size=p).astype(np.float64)
    if how == 2:
        w = w * 10.0 ** rng.uniform(-140, 0, size=p)
    if how == 3:
        w = np.where(rng.random(p) < 0.5, 0.0, w)
    if tiny:
        w = np.where(rng.random(p) < 0.5, w * 10.0 ** rng.uniform(-320, -140, size=p), w)
    w[0], w[-1] = -abs(w[0]) - 0.1, abs(w[-1]) + 0.1
    w = rng.permutation(w)
    to_order_one(w)
    return w


def near_a_multiple(rng: Rng, w: Floats) -> Floats:
    """lambda w, with some entries raised a little, and some moved by the last bit or by next to
    nothing.
    """
    factor = float(rng.choice([1.0, 1.0, 2.0**-7, 3.0, rng.random(), 10.0 ** rng.uniform(-160, 0)]))
    with np.errstate(under="ignore"):
        t = factor * w
        t = t + (rng.random(len(w)) < 0.3) * rng.choice([1e-300, 1e-15, 0.1]) * rng.random(len(w))
    for j in np.flatnonzero(rng.random(len(w)) < rng.choice([0.0, 0.2])):
        t[j] = math.nextafter(t[j], rng.choice([-math.inf, math.inf]))
    if rng.random() < 0.2:
        t[rng.integers(len(w))] = rng.choice([0.0, -0.0, 5e-324, -5e-324])
    to_order_one(t)
    return t


@pytest.mark.parametrize("seed", quick_first(range(2), 1))
def test_a_row_is_lifted_only_if_it_is(seed: int) -> None:
    """lifts() and lifting_row(), for p on both sides of the 64 bits of a mask."""
    rng, said, missed = np.random.default_rng(seed), 0, 0
    for i in range(scaled(800, 2000)):
        p = int(rng.integers(64, 71)) if i % 7 == 0 else int(rng.integers(2, 9))
        tiny = bool(p <= 64 and rng.random() < 0.3)
        known = knowing(np.array([a_row(rng, p, tiny) for _ in range(int(rng.integers(1, 5)))]))
        w = known.rows[int(rng.integers(len(known.rows)))]
        side = int(rng.choice([-1, 1]))
        t = side * (near_a_multiple(rng, w) if rng.random() < 0.9 else w.copy())
        really = [is_lifted(t, side, row) for row in known.rows]
        known.counts[ROW] = rng.integers(7)  # left over from a set with more rows
        row = lifting_row(t, side, known.rows, known.lifted, known.masks, known.counts)
        given = row != NOWHERE
        assert any(really) or not given
        said += given
        missed += any(really) and not given
        for q, (w_q, mask) in enumerate(zip(known.rows, known.masks, strict=True)):
            usable = (
                mask != ~np.uint64(0)
                or not (w_q != 0).any()
                or np.abs(w_q[w_q != 0]).min() >= 2.0**-500
            )
            assert really[q] or not usable or not lifts(t, side, q, known.rows, known.lifted)
            if (side * t == w_q).all() and usable:  # an answered pair met again
                assert lifts(t, side, q, known.rows, known.lifted)
        if given:
            assert really[row]
    assert said > scaled(160, 400)
    assert missed < scaled(440, 1100)


def test_a_multiple_of_a_known_row_is_found_whatever_its_place() -> None:
    rng = np.random.default_rng(3)
    for p in (8, 63, 64, 65, 70):
        known = knowing(np.array([rng.normal(size=p) for _ in range(6)]))
        for q in (5, 0, 3):
            t = 0.3 * known.rows[q] + 1e-9
            assert lifting_row(t, 1, known.rows, known.lifted, known.masks, known.counts) == q
            assert lifting_row(-t, -1, known.rows, known.lifted, known.masks, known.counts) == q


def test_tiny_entries_prove_nothing_beyond_64_gaps() -> None:
    """w = (1/2, 0, ..., -1/2, 2^-600) and t = lambda w without its last entry, which is too small
    to multiply.
    """
    d, ask = np.zeros(71), np.zeros(71)
    d[[1, 68, 69, 70]] = 0.5, 0.5, -0.5, 2.0**-600
    ask[[1, 2, 3, 68, 69]] = 2.0**-491 * (1 + 2.0**-40), -0.75, 0.75, 2.0**-491, -(2.0**-491)
    least, greatest = Oracle(region_of(71, 0.0, None, d[None], [1])).range(exact(tails(ask)))
    assert least < 0 < greatest
    assert PolytopeComparator(71, margin=0.0).update(Answers([d], [1])).compare(ask).tolist() == [
        Verdict.UNKNOWN
    ]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_what_is_settled_is_settled_rightly(seed: int) -> None:
    rng, seen = np.random.default_rng(seed), Counter[int]()
    for kind, r, known in known_sets(90 + seed, scaled(4, 10) * len(KINDS)):
        for s in objectives(rng, r, 8):
            given = sign_of(s, known)
            seen[given] += 1
            if given != LEFT_OPEN:
                least, greatest = minimise_exactly(s, r).value, -minimise_exactly(-s, r).value
                ordered = given in (
                    Verdict.BETTER,
                    Verdict.WORSE,
                )  # by order alone, where gaps may be closed
                wanted = verdict(least, greatest)
                assert given == wanted or (ordered and wanted == 0 and by_dominance(s) == given), (
                    kind
                )
    assert min(seen[-1], seen[1], seen[2], seen[LEFT_OPEN]) > 20


def test_huge_and_tiny_numbers_in_one_difference() -> None:
    rng, seen = np.random.default_rng(4), Counter[int]()
    for _ in range(60):
        k = int(rng.integers(3, 8))
        truth = draw_truth(rng, k - 1)
        d = shares(rng, k, 5)
        y = answered(rng, d, truth)
        c, oracle = (
            PolytopeComparator(k).update(Answers(d, y)),
            Oracle(region_of(k, 1e-6, None, d, list(y))),
        )
        sizes = np.array([1e300, 1.0, 1e-12, 1e-300, 5e-324, 0.0])
        ask = rng.choice(sizes, size=(4, k)) * rng.choice([-1, 1, 0.7], size=(4, k))
        for one, got in zip(ask, c.compare(ask), strict=True):
            wanted = verdict(*oracle.range(exact(tails(one))))
            assert got == wanted
            seen[wanted] += 1
    assert min(seen[-1], seen[1], seen[2]) > 5


def learned() -> tuple[PolytopeComparator, Floats]:
    rng = np.random.default_rng(5)
    truth = draw_truth(rng, 5)
    d = shares(rng, 6, 12)
    return PolytopeComparator(6).update(Answers(d, answered(rng, d, truth))), shares(rng, 6, 40)


def test_any_layout_and_number_type() -> None:
    c, d = learned()
    wanted = c.compare(d)
    assert set(wanted) == {-1, 1, 2}
    frozen, wide = d.copy(), np.zeros((80, 12))
    frozen.flags.writeable = False
    wide[::2, ::2] = d
    for same in (
        np.asfortranarray(d),
        frozen,
        wide[::2, ::2],
        d.astype(">f8"),
        d.tolist(),
        d.astype(object),
    ):
        assert (c.compare(same) == wanted).all()
    assert (frozen == d).all()
    assert c.compare(np.broadcast_to(d[0], (3, 6))).tolist() == [wanted[0]] * 3
    told = c.answers.d.astype(np.float32).astype(np.float64), c.answers.y
    wanted = PolytopeComparator(6).update(Answers(*told)).compare(d)
    wide = np.zeros((24, 12))
    wide[::2, ::2] = told[0]
    for same in (
        np.asfortranarray(told[0]),
        wide[::2, ::2],
        told[0].astype(np.float32),
        told[0].tolist(),
    ):
        assert (
            PolytopeComparator(6).update(Answers(same, told[1].astype(np.int64))).compare(d)
            == wanted
        ).all()
    short = d.astype(np.float32)
    assert (c.compare(short) == c.compare(short.astype(np.float64))).all()
    whole = np.round(8 * d).astype(np.int8)
    assert (c.compare(whole) == c.compare(whole.astype(np.float64))).all()
    for zero in (
        np.zeros((0, 6)),
        np.zeros((0, 6), dtype=np.int32),
        np.asfortranarray(np.zeros((6, 0))).T,
    ):
        decided = decide(c, zero)
        assert decided.verdicts.shape == decided.tiers.shape == (0,)
        assert decided.verdicts.dtype == np.int8


def test_a_whole_number_too_large_for_a_float() -> None:
    with pytest.raises(ValueError, match="must be"):
        learned()[0].compare([0, 10**400, 0, 0, 0, 1])


@pytest.mark.parametrize("seed", range(20))
def test_signs_at_points_are_the_same_one_by_one_and_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, kind = (
        rng.dirichlet(np.ones(5), size=12).T.copy(),
        rng.integers(0, 3, size=12).astype(np.int8),
    )
    t, at = rng.normal(size=5) + rng.choice([-1.0, 0.0, 1.0]), np.empty((2, 9))
    for doubt in (1e-15, 0.5):
        for side in (-1, 0, 1):
            one = signs_at_points(t, doubt, side, points, kind, at[0])
            assert one == signs_together(t, doubt, side, points, kind, at[1])
            assert at[0].tobytes() == at[1].tobytes()
