"""What is known of K_t stays true however long it is used: points, corners, rows, the inner point, the pruning."""

from __future__ import annotations

import time
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from elicit.comparators.polytope.comparator import PolytopeComparator
from elicit.lp.dual_simplex import minimise_exactly
from elicit.lp.region import Region
from elicit.lp.sign import settle_all
from elicit.lp.vertices import CERTAIN_POINT, CORNER, DOUBTFUL_CORNER, EPS, ROW, SLOT, SMALL, USED, corner_of, slacks_of
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import tail_sums
from tests.elicit.lp.test_primal_simplex import normalised
from tests.lp_cases import (
    KINDS,
    Oracle,
    Rationals,
    answered,
    cases,
    dot,
    draw_truth,
    exact,
    from_tails,
    questions,
    region_of,
    shares,
    sign_of,
    tails,
    verdict,
)

COMPILED = hasattr(settle_all, "py_func")
MANY = 10_000 if COMPILED else 500  # it is a hundred times slower without numba
Floats = np.ndarray[Any, Any]
Rng = np.random.Generator


def least_slack(r: Region, g: Rationals) -> Fraction:
    """The least slack of a point, exactly where it is not large beyond doubt."""
    near = np.array([float(x) for x in g])
    rows = np.flatnonzero(r.rows @ near - r.rhs < 1e-9)
    slacks = [dot(exact(r.rows[i]), g) - Fraction(float(r.rhs[i])) for i in rows]
    return min([*slacks, min(g) - r.exact_margin, Fraction(1, 10**9)])


def check_shapes(c: PolytopeComparator) -> None:
    """Sizes and counters fit the region, and the inner point is strictly inside, in rationals."""
    r, known = c._set.region, c._set._known
    p, m, most = r.p, len(r.rows), len(known.kind)
    assert 0 <= known.counts[USED] <= most
    assert 0 <= known.counts[SLOT] < most
    assert known.counts[ROW] >= 0
    assert known.margin == r.margin
    assert (known.cuts == r.rows.T).all()
    assert (known.limits == r.rhs).all()
    assert m <= len(known.rows) == len(known.lifted) == len(known.masks)
    assert set(known.kind) <= {CERTAIN_POINT, CORNER, DOUBTFUL_CORNER}
    assert set(known.active.ravel()) <= set(range(p + m))
    for q in range(known.counts[USED]):
        assert known.kind[q] == CERTAIN_POINT or len(set(known.active[q])) == p - 1
        assert known.kind[q] == CERTAIN_POINT or 0 <= known.age[q] <= 40
    if c._set.inside is not None:
        assert least_slack(r, normalised(known.inside)) > 0
        room = np.concatenate([known.inside - r.margin, r.rows @ known.inside - r.rhs])
        assert known.room == pytest.approx(room, abs=1e-13)
        assert known.room.min() > 0


def check_points(c: PolytopeComparator) -> int:
    """No known point is outside K_t, in rationals; those of exact optima are right to their last bits. Returns
    how many there are."""
    r, known = c._set.region, c._set._known
    count = 0
    for q in np.flatnonzero(known.kind[: known.counts[USED]] != DOUBTFUL_CORNER):
        count += 1
        doubt = (r.p + 8) * Fraction(EPS) if known.kind[q] == CERTAIN_POINT else 0
        assert least_slack(r, normalised(known.points[:, q])) >= -doubt
    return count


def check_corners(c: PolytopeComparator) -> None:
    """For regions that floats can handle: corners are where their active constraints meet, and in K_t."""
    r, known = c._set.region, c._set._known
    g, slack = np.empty(r.p), np.empty(r.p + len(r.rows))
    for q in np.flatnonzero(known.kind[: known.counts[USED]] != CERTAIN_POINT):
        corner_of(known.inverses[q], known.active[q], known, g)
        slacks_of(g, known, slack)
        assert np.abs(slack[known.active[q]]).max(initial=0.0) < 1e-9
        assert slack.min() > -1e-9


def check_rows(c: PolytopeComparator) -> None:
    """Every known row holds on all of K_t, in rationals; masks and lifted rows belong to them."""
    r, known = c._set.region, c._set._known
    for w, lifted, mask in zip(known.rows, known.lifted, known.masks, strict=True):
        assert minimise_exactly(w, r).value >= 0
        tiny = bool(((w != 0) & (np.abs(w) < SMALL)).any())
        ratio = lifted[w != 0] / w[w != 0] - 1
        assert tiny or ratio == pytest.approx(np.where(w[w != 0] > 0, 1.25, 0.75) * 2.0**-48, rel=0.1)
        assert tiny or int(mask) == sum(1 << j for j, x in enumerate(w[:64]) if x >= 0)


def everything(c: PolytopeComparator) -> bytes:
    return b"".join(np.ascontiguousarray(part).tobytes() for part in c._set._known)


# ---- pruning ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_what_is_left_out_follows_from_what_is_kept(seed: int) -> None:
    """All answers against the pruned set, in rationals; and the same set, whatever the order they came in."""
    dropped = 0
    for i, case in enumerate(cases([61, seed], 3 * len(KINDS), asks=3, most_levels=9, most_answers=60)):
        rng = np.random.default_rng(i)
        new = PolytopeComparator(case.k, case.margin, case.prior)
        c, other = new.update(Answers(case.d, case.y)), new
        for rows in np.array_split(rng.permutation(len(case.y)), min(5, len(case.y) or 1)):
            other = other.update(Answers(case.d[rows], case.y[rows]))
            other.compare(case.ask)
            if rng.random() < 0.5:
                check_points(other)
        for one in (c, other):
            check_shapes(one)
            check_points(one)
            kept, every = one._set.region, one.region
            dropped += len(every.rows) - len(kept.rows)
            for row, limit in zip(every.rows, every.rhs, strict=True):
                if not ((kept.rows == row).all(axis=1) & (kept.rhs == limit)).any():
                    assert minimise_exactly(row, kept).value >= Fraction(float(limit)), case.kind
        for t in tail_sums(case.ask):
            if np.abs(t).max() < 1e300:
                assert minimise_exactly(t, c._set.region).value == minimise_exactly(t, other._set.region).value
        if i % 4 == 0:
            check_rows(c)
            check_rows(other)
    assert dropped > 300


# ---- long runs --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("k", "checks"), [(2, 5), (3, 5), (8, 5), (20, 2)])
def test_five_thousand_comparisons_between_150_answers(k: int, checks: int) -> None:
    if k == 20 and not COMPILED:
        pytest.skip("too slow without numba")
    rng = np.random.default_rng(k)
    truth = draw_truth(rng, k - 1)
    c, seen, old = PolytopeComparator(k), np.zeros(4, dtype=int), []
    points = 0
    for step in range(150):
        d = shares(rng, k, 33)
        if step % 10 == 5:
            d[:10] = questions(rng, c.answers.d, truth, 10)
        given = c.compare(d)
        sure = given != Verdict.UNKNOWN
        right = np.array([sign_of(row, truth) for row in d])
        assert ((given == right) | ~sure | (right == 0)).all()
        seen += np.bincount(given + 1, minlength=4)
        check_shapes(c)
        if step % 50 == 10:
            old.append((c, d, given))
        if step % (150 // checks) == 0:
            points += check_points(c)
            check_corners(c)
        # one that is not known yet, where there is one, as a learner would ask; none that makes K_t too thin
        unknown = np.append(np.flatnonzero(~sure[10:]), 0)
        one = d[10 + unknown[0]][None]
        c = c.update(Answers(one, answered(rng, one, truth)))
    check_points(c)
    check_corners(c)
    check_rows(c)
    assert seen[0] > 100
    assert seen[2] > 100
    assert points > 4
    oracle = Oracle(region_of(k, 1e-6, None, c.answers.d, list(c.answers.y)))
    ask = questions(rng, c.answers.d, truth, 4)
    for row, got in zip(ask, c.compare(ask), strict=True):
        assert got == verdict(*oracle.range(exact(tails(row)[0])))
    for before, d, given in old:
        assert (before.compare(d) == given).all()


def test_a_comparator_shares_nothing_that_changes_with_what_is_made_of_it() -> None:
    rng = np.random.default_rng(1)
    truth = draw_truth(rng, 6)
    d = shares(rng, 7, 30)
    answers = Answers(d, answered(rng, d, truth))
    old = PolytopeComparator(7).update(answers)
    old.compare(shares(rng, 7, 100))
    more = shares(rng, 7, 20)
    new = old.update(Answers(more, answered(rng, more, truth)))
    before = everything(old)
    new.compare(shares(rng, 7, 500))
    more = (most := shares(rng, 7, 500))[new.compare(most) == Verdict.UNKNOWN][:3]
    newest = new.update(Answers(more, answered(rng, more, truth)))
    newest.compare(most)
    assert everything(old) == before
    before, ask = everything(new), shares(rng, 7, 500)
    old.compare(ask)
    newest.compare(ask)
    assert everything(new) == before
    with pytest.raises(InconsistentAnswers):
        new.update(Answers([from_tails([-1.0, -1.0, -1.0, -1.0, -1.0, -2.0])], [1]))
    check_points(new)
    check_rows(new)


@pytest.mark.skipif(not COMPILED, reason="too slow without numba")
def test_very_many_levels() -> None:
    rng = np.random.default_rng(2)
    truth = draw_truth(rng, 119)
    d, ask = shares(rng, 120, 60), shares(rng, 120, 400)
    begin = time.perf_counter()
    c = PolytopeComparator(120).update(Answers(d, answered(rng, d, truth)))
    given = c.compare(ask)
    assert time.perf_counter() - begin < 20.0  # it takes a fifth of a second
    right = np.array([sign_of(row, truth) for row in ask])
    assert ((given == right) | (given == Verdict.UNKNOWN)).all()
    assert np.count_nonzero(given != Verdict.UNKNOWN) > 50
    check_shapes(c)
    check_corners(c)
    for i in (*np.flatnonzero(given == 1)[:2], *np.flatnonzero(given == 2)[:2]):
        least, t = minimise_exactly(tail_sums(ask[i]), c._set.region).value, tail_sums(ask[i])
        assert verdict(least, -minimise_exactly(-t, c._set.region).value) == given[i]


# ---- odd answers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [6, 12])
def test_ten_thousand_answers_at_once(k: int) -> None:
    rng = np.random.default_rng(k)
    truth = draw_truth(rng, k - 1)
    d = shares(rng, k, MANY)
    begin = time.perf_counter()
    c = PolytopeComparator(k).update(Answers(d, answered(rng, d, truth)))
    assert time.perf_counter() - begin < 20.0  # it takes a seventh of a second
    check_points(c)
    assert len(c._set.region.rows) < 200
    for i in rng.integers(len(d), size=15):
        t = tail_sums(d[i]) * float(c.answers.y[i])
        assert minimise_exactly(t, c._set.region).value >= 0
    assert (c.compare(d) == c.answers.y).all()


def test_ten_thousand_times_the_same_answer() -> None:
    d, ask = from_tails([1.0, -2.0, 0.5, 0.25]), shares(np.random.default_rng(3), 5, 50)
    once = PolytopeComparator(5).update(Answers([d], [1]))
    begin = time.perf_counter()
    often = PolytopeComparator(5).update(Answers(np.repeat(d[None], MANY, axis=0), np.ones(MANY)))
    assert time.perf_counter() - begin < 10.0  # it takes a third of a second
    assert len(often._set.region.rows) == 1
    assert (often.compare(ask) == once.compare(ask)).all()


def test_the_same_opposite_answers_again_and_again() -> None:
    d = from_tails([1.0, -2.0, 0.5, 0.25])
    c = PolytopeComparator(5).update(Answers(np.repeat(d[None], 20, axis=0), np.tile([1, -1], 10)))
    assert len(c._set.region.rows) == 2  # 1,000 such answers take six seconds


def test_an_answer_that_touches_the_set_in_one_corner() -> None:
    touch = from_tails([1.0, -3.0, -3.0])  # 0 at gaps (6, 1, 1) / 8, and less elsewhere
    c = PolytopeComparator(4, margin=0.125).update(Answers([touch], [1]))
    corner = [Fraction(6, 8), Fraction(1, 8), Fraction(1, 8)]
    rng = np.random.default_rng(4)
    ask = np.concatenate(
        [shares(rng, 4, 40), [touch, -touch, from_tails([0.0, 1.0, -1.0]), from_tails([1.0, -6.0, 0.0])]]
    )
    for _ in range(2):
        given = c.compare(ask)
        assert given.tolist() == [sign_of(d, corner) for d in ask]
        check_shapes(c)
        check_points(c)
    for d in ask[:40:8]:
        c = c.update(Answers([d], [sign_of(d, corner)]))
        with pytest.raises(InconsistentAnswers):
            c.update(Answers([d], [-sign_of(d, corner)]))
        assert (c.compare(ask) == given).all()


@pytest.mark.parametrize("k", [3, 6])
def test_answers_that_leave_one_point(k: int) -> None:
    weights = np.random.default_rng(k).integers(1, 30, size=k - 1)
    truth = [Fraction(int(w), int(weights.sum())) for w in weights]
    ties = np.zeros((k - 2, k - 1))
    ties[:, 0], ties[np.arange(k - 2), np.arange(1, k - 1)] = weights[1:], -weights[0]
    d = np.array([from_tails(t) for t in ties])
    c = PolytopeComparator(k)
    for sign in (1, -1):
        c = c.update(Answers(d, np.full(k - 2, sign)))
    ask = np.concatenate([shares(np.random.default_rng(9), k, 30), d, d[:1] - 2 * d[-1:]])
    for _ in range(2):
        assert c.compare(ask).tolist() == [sign_of(row, truth) for row in ask]
        check_shapes(c)
        check_points(c)
    assert c.values[1:] == pytest.approx(np.cumsum([float(g) for g in truth]), abs=1e-9)


def test_answers_of_any_layout_and_number_type() -> None:
    rng = np.random.default_rng(6)
    truth = draw_truth(rng, 5)
    d = shares(rng, 6, 12).astype(np.float32).astype(np.float64)
    y, ask = answered(rng, d, truth), shares(rng, 6, 40)
    wanted = PolytopeComparator(6).update(Answers(d, y)).compare(ask)
    frozen, wide = d.copy(), np.zeros((24, 12))
    frozen.flags.writeable = False
    wide[::2, ::2] = d
    for same in (np.asfortranarray(d), frozen, wide[::2, ::2], d.astype(np.float32), d.tolist()):
        assert (PolytopeComparator(6).update(Answers(same, y.astype(float))).compare(ask) == wanted).all()
    none = PolytopeComparator(6).update(Answers(np.zeros((0, 6)), []))
    assert (none.compare(ask) == PolytopeComparator(6).compare(ask)).all()


@pytest.mark.parametrize("size", [1e300, 1e-300, 5e-324])
def test_answers_of_any_size(size: float) -> None:
    t, ask = np.array([1.0, -1.0, 0.0, 1.0]), shares(np.random.default_rng(7), 5, 50)
    d = np.concatenate([[0.0], (t[:-1] - t[1:]) * size, t[-1:] * size])
    given = PolytopeComparator(5).update(Answers([d], [1])).compare(ask)
    assert (given == PolytopeComparator(5).update(Answers([from_tails(t)], [1])).compare(ask)).all()
