"""Hashed random numbers: stateless, evenly spread, and the same for arrays and for compiled
loops.
"""

import numpy as np
import pytest

from elicit._support.hashing import fold, key_of, mix, name_code, uniform, unit


def test_keys() -> None:
    assert key_of(3) == key_of(np.int64(3)) == key_of(np.random.SeedSequence(3))
    assert key_of(3) != key_of(4)
    assert 0 <= key_of(2**80) < 2**64
    assert 0 <= name_code("transitions") < 2**64
    assert name_code("transitions") != name_code("exploration")
    generator, twin = np.random.default_rng(1), np.random.default_rng(1)
    assert key_of(generator) == key_of(twin) != key_of(generator)
    for bad in (None, -1, True, 1.5, "a"):
        with pytest.raises(TypeError, match="seed"):
            key_of(bad)


def test_fold_is_splitmix64_stateless_and_broadcasts() -> None:
    key = key_of(0)
    grid = fold(key, np.arange(4)[:, None], np.arange(5))
    assert grid.shape == (4, 5)
    assert grid.dtype == np.uint64
    assert all(grid[i, j] == fold(key, i, j) for i in range(4) for j in range(5))
    assert fold(fold(key, 1), 2) == fold(key, 1, 2)
    assert len(np.unique(fold(key, np.arange(10_000)))) == 10_000
    assert fold(key, 1, 2) != fold(key, 2, 1)
    assert fold(2**64 - 1, 2**64 - 1) == fold(np.uint64(2**64 - 1), -1)
    # the first outputs of SplitMix64 from state 0, as its authors' code gives them
    assert [int(fold(0, i)) for i in range(3)] == [
        0xE220A8397B1DCDAF,
        0x6E789E6AA1B965F4,
        0x06C45D188009454F,
    ]
    with np.errstate(over="ignore"):  # one by one, for compiled code
        assert mix(np.uint64(key), np.uint64(3)) == fold(key, 3)
        assert unit(mix(np.uint64(key), np.uint64(3))) == uniform(fold(key, 3))


def test_uniform_numbers() -> None:
    u = uniform(fold(key_of(1), np.arange(100_000)))
    assert 0 <= u.min() < 1e-3
    assert 1 - 1e-3 < u.max() < 1
    assert abs(u.mean() - 0.5) < 0.005
    assert abs(np.corrcoef(u[:-1], u[1:])[0, 1]) < 0.02
    counts = np.histogram(u, 20, (0, 1))[0]
    assert abs(counts - 5000).max() < 400
    assert uniform(np.array([0, 2**64 - 1], dtype=np.uint64)).tolist() == [0, 1 - 2**-53]
