"""A pair is known by its value: whichever way round it is, and whatever its last bits are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elicit import Query, Verdict
from elicit._support.jit import compiling
from elicit.asking.answered_pairs import AnsweredPairs
from elicit.model.difference_kernel import find, mark_of, near_to, pair_code, way_round
from elicit.model.pairs import (
    GRID,
    NEAR,
    first_of_each_pair,
    nearness,
    pair_numbers,
    same_pairs,
    ways_round,
    whole_numbers,
)
from tests.scale_arithmetic import Floats, tail_sums

KEY = np.uint64(5)


def code(t: Floats) -> int:
    with np.errstate(over="ignore"):
        return int(pair_code(KEY, np.ascontiguousarray(t)))


def round_sums(n: int, p: int, seed: int) -> Floats:
    """Tail sums of differences of bags of twelve: multiples of a twelfth, where rounding does harm
    if anywhere.
    """
    rng = np.random.default_rng(seed)
    bags = rng.multinomial(12, np.full(p + 1, 1 / (p + 1)), size=(2, n)) / 12.0
    sums = tail_sums(bags[0] - bags[1])
    return sums[np.abs(sums).max(axis=1) > 0]


@given(st.integers(2, 20), st.integers(0, 10_000), st.sampled_from([1.0, 1e-4, 1e6]))
@settings(max_examples=40, deadline=None)
def test_names_do_not_depend_on_direction_or_last_bits(p: int, seed: int, unit: float) -> None:
    rng = np.random.default_rng(seed)
    for t in unit * round_sums(12, p, seed):
        near = t + 1e-15 * unit * rng.standard_normal(p)
        assert way_round(t) == way_round(near) == -way_round(-t) == ways_round(t[None])[0]
        if (
            unit != 1e6
        ):  # beyond order one a grain is a millionth of a twelfth of a million: not at its middle
            assert code(t) == code(near) == code(-t)
        assert same_pairs(t, np.stack([near, -near, t + 3 * nearness(t)])).tolist() == [1, -1, 0]
        assert near_to(t) == nearness(t) > 0


def test_different_pairs_have_different_codes_and_numbers() -> None:
    t = round_sums(200, 4, seed=1)
    d = np.concatenate([t, -t])
    d = -np.diff(np.concatenate([np.zeros((len(d), 1)), d, np.zeros((len(d), 1))], axis=1), axis=1)
    numbers = pair_numbers(d)
    assert (numbers[: len(t)] == numbers[len(t) :]).all()
    codes = np.array([code(row) for row in t], dtype=np.uint64)
    assert len(np.unique(codes)) == numbers.max() + 1 == len(np.unique(numbers)) > 60
    assert code(np.array([1.0, 2.0])) != code(np.array([2.0, 1.0]))
    assert code(np.array([2.0, 4.0])) != code(
        np.array([4.0, 8.0])
    )  # of order one, they are the same
    with compiling():
        assert [code(row) for row in t] == codes.tolist()


def test_whole_numbers_count_grains() -> None:
    numbers, exponent = whole_numbers(np.array([0.5, -0.25, 0.0]))
    assert (numbers / GRID).tolist() == [0.5, -0.25, 0.0]
    assert exponent == 0
    numbers, exponent = whole_numbers(np.array([1e300, 3.0]))
    assert numbers[1] == 0
    assert np.ldexp(numbers[0] / GRID, exponent) == pytest.approx(1e300, rel=1e-8)


@given(st.lists(st.sampled_from([-1, 0, 1]), min_size=1, max_size=30), st.integers(0, 999))
@settings(max_examples=40, deadline=None)
def test_the_table_finds_what_is_near_and_nothing_else(verdicts: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    d = rng.dirichlet(np.ones(5), len(verdicts)) - rng.dirichlet(np.ones(5), len(verdicts))
    pairs = AnsweredPairs(5)
    for row, verdict in zip(d, verdicts, strict=True):
        pairs.add(row, verdict, binding=verdict == 0)
    t = tail_sums(d)
    noise = 0.9 * NEAR * rng.choice([-1.0, 1.0], t.shape)
    assert pairs.said(t).tolist() == verdicts
    assert pairs.said(t + noise).tolist() == verdicts
    assert pairs.said(-t - noise).tolist() == [-v for v in verdicts]
    assert (pairs.said(t + 3 * NEAR) == Verdict.UNKNOWN).all()
    assert find(t[0] + noise[0], pairs.table) == (0, 1)
    assert len(pairs) == len(verdicts)
    pairs.add_many(-d, -np.array(verdicts, dtype=np.int8))
    assert len(pairs) == len(verdicts)
    assert pairs.said(t).tolist() == verdicts
    assert pairs.any_binding == (0 in verdicts)


def test_many_answers_at_once_are_those_one_by_one() -> None:
    rng = np.random.default_rng(5)
    one, many = AnsweredPairs(4), AnsweredPairs(4)
    for n in (1, 5, 40):  # more than there is room for at first
        d = rng.dirichlet(np.ones(4), n) - rng.dirichlet(np.ones(4), n)
        verdicts = rng.integers(-1, 2, n).astype(np.int8)
        for row, verdict in zip(d, verdicts, strict=True):
            one.add(row, verdict, binding=bool(verdict == 0))
        many.add_many(d, verdicts)
        for name, mine in many.table._asdict().items():
            used = slice(0, len(many))
            np.testing.assert_array_equal(mine[used], getattr(one.table, name)[used], err_msg=name)
    assert (many.table.marks == np.sort([mark_of(t) for t in many.table.sums[: len(many)]])).all()


def test_the_latest_answer_to_a_pair_counts() -> None:
    pairs, d = AnsweredPairs(3), np.array([0.5, -1.0, 0.5])
    pairs.add(d, 1, binding=False)
    pairs.add(-d * (1 + 1e-12), 1, binding=True)
    assert pairs.said(tail_sums(d)[None]).tolist() == [-1]
    assert pairs.any_binding


def test_pairs_of_one_mark_are_told_apart() -> None:
    """Pairs are sorted by one number, which is the same for these two."""
    t = np.array([0.3, 0.2])
    other = t + 0.1 * np.array([np.sqrt(3.0), -np.sqrt(2.0)])
    pairs = AnsweredPairs(3)
    pairs.add(np.array([-t[0], t[0] - t[1], t[1]]), 1, binding=False)
    assert pairs.said(np.array([t, other, -other])).tolist() == [1, 2, 2]


def test_tiny_pairs_are_told_apart() -> None:
    t = 1e-11 * round_sums(40, 3, seed=3)
    assert not same_pairs(t[0], -t[:1]).max() > 0
    apart = t[np.abs(t - t[0]).max(axis=1) > 1e-13]
    assert not same_pairs(t[0], apart[np.abs(apart + t[0]).max(axis=1) > 1e-13]).any()


def test_the_first_row_of_each_pair() -> None:
    d = np.array(
        [[0.5, -1, 0.5], [0.3, -1, 0.7], [-0.5, 1 + 1e-13, -0.5], [0.3, -1, 0.7], [0.1, 0.4, -0.5]]
    )
    assert first_of_each_pair(d, 9) == [0, 1, 4]
    assert first_of_each_pair(d, 2) == [0, 1]


def test_the_id_of_a_query_does_not_depend_on_its_last_bits() -> None:
    left, right = np.array([0.1, 0.2, 0.7]), np.array([0.3, 0.4, 0.3])
    query = Query.make("problem", 3, left, right)
    assert query.id == Query.make("problem", 3, left * (1 + 1e-15), right - 1e-16).id
    others = [Query.make(*which, left, right).id for which in (("problem", 4), ("other", 3))]
    others += [
        Query.make("problem", 3, right, left).id,
        Query.make("problem", 3, left + 1e-8, right).id,
    ]
    assert len({query.id, *others}) == 5
