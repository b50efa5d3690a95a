"""Differences of share vectors on which wrong comparators fail."""

import numpy as np

from elicit._support.hashing import Seed
from elicit.model.scale import Floats


def sample_differences(k: int, seed: Seed | None = 0) -> Floats:
    """Return differences of share vectors on which wrong comparators fail.

    Some are smooth and some sparse. There are near and exact ties, single steps, dominated pairs
    and zero, and sizes from tiny to large.

    Parameters
    ----------
    k : int
    seed : int, SeedSequence, Generator or None

    Returns
    -------
    (n, k)
    """
    rng = np.random.default_rng(seed)

    def pairs(n: int, concentration: float = 1.0) -> Floats:
        left, right = (rng.dirichlet(np.full(k, concentration), n) for _ in range(2))
        return np.asarray(left - right)

    counts = rng.multinomial(4, np.full(k, 1.0 / k), 16) / 4.0
    steps = np.eye(k)[1:] - np.eye(k)[:-1]
    better = np.sort(rng.random((4, k)), axis=1)
    better -= better.mean(axis=1, keepdims=True)
    shares = [pairs(12), pairs(6, 0.2), counts[:8] - counts[8:]]
    return np.concatenate(
        [*shares, steps, -steps, better, 1e-9 * pairs(3), 1e4 * pairs(3), np.zeros((1, k))]
    )
