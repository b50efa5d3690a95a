"""Facts about K_t stay true however long they are used: points, vertices, rows, the inner point.

Pruning keeps them true as well."""

import time

import numpy as np
import pytest

from elicit import Answers, InconsistentAnswers, PolytopeComparator, Verdict
from elicit.lp import analytic_centre as centres
from elicit.lp.dual_simplex import minimise_exactly
from elicit.lp.primal_simplex import USED
from elicit.lp.vertex_store import _cut_of_arrays, cut
from tests.lp_cases import (
    KINDS,
    Oracle,
    answered,
    cases,
    check_proofs,
    draw_truth,
    exact,
    from_tails,
    questions,
    region_of,
    rows_kept,
    shares,
    sign_of,
    tails,
    verdict,
)
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import on_any_processor, quick_first, scaled


@pytest.mark.parametrize("seed", quick_first(range(2), 1))
def test_what_is_left_out_follows_from_what_is_kept(seed: int) -> None:
    """All answers against the pruned set; and the same set, whatever the order they came in."""
    answers = rows = 0
    for i, case in enumerate(
        cases([61, seed], scaled(1, 3) * len(KINDS), asks=3, most_levels=9, most_answers=60)
    ):
        rng = np.random.default_rng(i)
        c, other = case.known(), PolytopeComparator(case.k, case.margin, case.prior, case.tie)
        for part in np.array_split(rng.permutation(len(case.y)), min(5, len(case.y) or 1)):
            other = other.update(Answers(case.d[part], case.y[part]))
            other.compare(case.ask)
        for one in (c, other):
            check_proofs(one)
            rows += rows_kept(one)
            answers += len(one.region.rows)
        low, high = c.bounds(case.ask)
        for mine, its in zip(other.bounds(case.ask), (low, high), strict=True):
            with np.errstate(all="ignore"):
                assert (
                    (np.abs(mine - its) <= 1e-9 * np.abs(case.ask).sum(axis=1)) | (mine == its)
                ).all(), case.kind
    assert rows < answers - scaled(70, 300)


@pytest.mark.parametrize(
    ("k", "checks"),
    [
        (2, 1),
        (8, scaled(1, 3)),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in [(3, 3), (20, 1)]),
    ],
)
def test_five_thousand_comparisons_between_150_answers(k: int, checks: int) -> None:
    rng = np.random.default_rng(k)
    truth = draw_truth(rng, k - 1)
    c, seen, old = PolytopeComparator(k), np.zeros(4, dtype=int), []
    for step in range(150):
        d = shares(rng, k, 33)
        if step % 10 == 5:
            d[:10] = questions(rng, c.answers.d, truth, 10)
        given = c.compare(d)
        sure = given != Verdict.UNKNOWN
        right = np.array([sign_of(row, truth) for row in d])
        assert ((given == right) | ~sure | (right == 0)).all()
        seen += np.bincount(given + 1, minlength=4)
        if step % 50 == 10:
            old.append((c, d, given))
        if step % (150 // checks) == 149 // checks:
            check_proofs(c)
            oracle = Oracle(region_of(k, 1e-6, None, c.answers.d, list(c.answers.y)))
            ask = np.concatenate([questions(rng, c.answers.d, truth, 12), d[:4]])
            for row, got in zip(ask, c.compare(ask), strict=True):
                assert got == verdict(*oracle.range(exact(tails(row))))
        # one that is not known yet, where there is one, as a learner would ask; none that makes K_t
        # too thin
        unknown = np.append(np.flatnonzero(~sure[10:]), 0)
        one = d[10 + unknown[0]][None]
        c = c.update(Answers(one, answered(rng, one, truth)))
    assert min(seen[0], seen[2]) > 100
    for before, d, given in old:
        assert (before.compare(d) == given).all()


def test_a_comparator_shares_nothing_that_changes_with_what_is_made_of_it() -> None:
    rng = np.random.default_rng(1)
    truth = draw_truth(rng, 6)
    d, made = shares(rng, 7, 30), PolytopeComparator(7)
    several = [
        made := made.update(Answers(part, answered(rng, part, truth)))
        for part in (d[:20], d[20:25], d[25:])
    ]
    ask = shares(rng, 7, 500)
    said = [(one.compare(ask), one.values, len(one.answers)) for one in several[::-1]][::-1]
    for one, (verdicts, values, told) in zip(several, said, strict=True):
        one.bounds(ask[:5])
        assert (one.compare(ask) == verdicts).all()
        assert (one.values == values).all()
        assert len(one.answers) == told
        for each in several:  # a point of an older set need not be one of a later set
            check_proofs(each)
    with pytest.raises(InconsistentAnswers):
        several[0].update(Answers([from_tails([-1.0, -1.0, -1.0, -1.0, -1.0, -2.0])], [1]))
    check_proofs(several[0])


@on_any_processor
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
    some = scaled(1, 2)
    for i in (*np.flatnonzero(given == 1)[:some], *np.flatnonzero(given == 2)[:some]):
        t = tail_sums(ask[i])
        assert verdict(*(s * minimise_exactly(s * t, c.region).value for s in (1, -1))) == given[i]


@on_any_processor
@pytest.mark.parametrize("k", quick_first([12, 6], 1))
def test_ten_thousand_answers_at_once(k: int) -> None:
    rng = np.random.default_rng(k)
    truth = draw_truth(rng, k - 1)
    d = shares(rng, k, 10_000)
    at = tail_sums(d) @ np.array(truth, dtype=np.float64)
    y, near = np.sign(at).astype(int), np.abs(at) < 1e-9
    y[near] = answered(rng, d[near], truth)  # only there floats may be wrong
    begin = time.perf_counter()
    c = PolytopeComparator(k).update(Answers(d, y))
    assert time.perf_counter() - begin < 20.0  # it takes a seventh of a second
    assert rows_kept(c) < 200
    assert (c.compare(d) == c.answers.y).all()


def test_ten_thousand_times_the_same_answer() -> None:
    d, ask = from_tails([1.0, -2.0, 0.5, 0.25]), shares(np.random.default_rng(3), 5, 50)
    once = PolytopeComparator(5).update(Answers([d], [1]))
    begin = time.perf_counter()
    often = PolytopeComparator(5).update(
        Answers(np.repeat(d[None], 10_000, axis=0), np.ones(10_000, int))
    )
    assert time.perf_counter() - begin < 10.0  # it takes a third of a second
    assert rows_kept(often) == 1
    assert (often.compare(ask) == once.compare(ask)).all()
    prior = np.repeat([d, -d], 10, axis=0), np.zeros(20)
    assert (
        rows_kept(
            PolytopeComparator(5, prior=prior).update(
                Answers([from_tails([-1.0, 0.0, 1.0, 0.0])], [1])
            )
        )
        <= 21
    )


@pytest.mark.parametrize("k", [3, 6, 12])
def test_a_compiled_cut_is_the_one_of_whole_arrays(k: int) -> None:
    """Compiled and whole-array cuts leave equal facts in all places in use."""
    rng = np.random.default_rng(k)
    truth, c = draw_truth(rng, k - 1), PolytopeComparator(k)
    for _ in range(12):
        c.compare(shares(rng, k, 50))
        d = shares(rng, k, 1)
        row = tail_sums(d)[0]
        row /= np.abs(row).max()
        known = c.rule.known
        for limit in (0.0, -0.25):
            ours, plain = cut(known, row, limit), _cut_of_arrays(known, row, limit)
            used = ours.counts[USED]
            assert used <= known.counts[USED]
            for name in known._fields:
                mine, its = getattr(ours, name), getattr(plain, name)
                if name == "inverses":  # free places hold anything
                    mine, its = mine[:used], its[:used]
                np.testing.assert_array_equal(mine, its, err_msg=name)
        c = c.update(Answers(d, answered(rng, d, truth)))


def test_the_centre_of_the_same_constraints_is_found_once_and_is_each_callers_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    d = np.array([[1.0, -3.0, 1.0, 1.0, 0.0, 0.0], [0.0, 1.0, -2.0, 0.0, 1.0, 0.0]])
    region = PolytopeComparator(6).update(Answers(d, [1, -1])).region
    first = centres.analytic_centre(region)
    expected = first.copy()
    first += 1.0
    monkeypatch.setattr(centres, "_deepest_point", None)  # finding another would fail
    again = region.take(np.arange(len(region.rows))[::-1])
    assert np.array_equal(centres.analytic_centre(again), expected)
    with pytest.raises(TypeError):
        centres.analytic_centre(region.take(np.arange(len(region.rows)), margin=0.01))
