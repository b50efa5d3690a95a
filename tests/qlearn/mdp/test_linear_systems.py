"""Discounted totals are the exact ones, rounded once: whoever solves, the bits are the same."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import sparse

from qlearn.mdp import linear_systems
from qlearn.mdp.linear_systems import discounted_totals
from tests.scale_arithmetic import Floats


def random_chain(n: int, seed: int, successors: int = 4) -> sparse.csr_array:
    rng = np.random.default_rng(seed)
    table = np.zeros((n, n))
    for row in table:
        row[rng.choice(n, min(n, successors), replace=False)] = rng.dirichlet(
            np.ones(min(n, successors))
        )
    return sparse.csr_array(table)


def exactly(chain: sparse.csr_array, inflow: Floats, discount: float) -> list[float]:
    """The solution by Gauss's elimination in rationals, rounded."""
    flows, n = (discount * chain).toarray(), len(inflow)
    rows = [
        [Fraction(int(i == j)) - Fraction(flows[i, j]) for j in range(n)] + [Fraction(inflow[i])]
        for i in range(n)
    ]
    for c in range(n):
        pivot = next(r for r in range(c, n) if rows[r][c])
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [x / rows[c][c] for x in rows[c]]
        for r in range(n):
            if r != c and rows[r][c]:
                factor = rows[r][c]
                rows[r] = [x - factor * y for x, y in zip(rows[r], rows[c], strict=True)]
    return [float(row[n]) for row in rows]


@pytest.mark.parametrize("discount", [0.0, 0.5, 0.95, 0.999, 0.99999])
@pytest.mark.parametrize("seed", range(3))
def test_the_exact_solution_rounded_once(discount: float, seed: int) -> None:
    chain, inflow = (
        random_chain(12, seed),
        np.random.default_rng(seed).random((12, 1)) * (1 - discount),
    )
    assert discounted_totals(chain, inflow, discount)[:, 0].tolist() == exactly(
        chain, inflow[:, 0], discount
    )


@pytest.mark.parametrize("scale", [1.0, 2.0**40, 2.0**-40])
def test_the_same_bits_by_factors_steps_and_sweeps(
    scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain, inflow = random_chain(60, 5), scale * np.random.default_rng(1).random((60, 3)) * 0.1
    dense = discounted_totals(chain, inflow, 0.9)
    monkeypatch.setattr(linear_systems, "_DENSE", 0)
    beside_a_constant = discounted_totals(chain, inflow, 0.9)
    monkeypatch.setattr(linear_systems, "_swept_beside_a_constant", lambda flows, inflow: None)
    by_steps = discounted_totals(chain, inflow, 0.9)
    stuck = lambda matrix, residual, rtol, maxiter: (0.0 * residual, maxiter)  # noqa: E731
    monkeypatch.setattr(linear_systems, "bicgstab", stuck)
    by_factors = discounted_totals(chain, inflow, 0.9)
    monkeypatch.setattr(linear_systems, "_SPARSE", 0)
    by_sweeps = discounted_totals(chain, inflow, 0.9)
    for other in (beside_a_constant, by_steps, by_factors, by_sweeps):
        np.testing.assert_array_equal(other, dense)


@pytest.mark.parametrize("discount", [0.3, 0.9, 0.9999])
@pytest.mark.parametrize("ends", [0, 1, 30])
def test_sweeps_beside_a_constant_are_right_or_give_up(discount: float, ends: int) -> None:
    rng = np.random.default_rng(ends)
    mixing, inflow = random_chain(200, ends, 8), rng.random((200, 3))
    # states from which a run may end, and a chain of two halves that hardly mix
    leaking = sparse.csr_array(sparse.diags_array(1.0 - (np.arange(200) < ends) * 0.5) @ mixing)
    halves = sparse.csr_array(sparse.block_diag([random_chain(100, 1), random_chain(100, 2)]))
    for chain, must in ((mixing, True), (leaking, ends == 0), (halves, False)):
        flows = (discount * chain).tocsr()
        found = linear_systems._swept_beside_a_constant(flows, inflow)
        assert found is not None or not must
        if found is not None:
            exact = np.linalg.solve(np.eye(200) - flows.toarray(), inflow)
            np.testing.assert_allclose(found, exact, atol=1e-12 / (1 - discount))
    if discount == 0.9999:
        assert found is None  # what the halves differ by is forgotten slowly


def test_nothing_flows_in() -> None:
    assert not discounted_totals(random_chain(5, 0), np.zeros((5, 2)), 0.9).any()
