"""Solvers of an MDP whose values are known, a problem k times smaller than ours: other packages,
each by its own fastest settings, and ours. What each takes beforehand, its own form of the tables,
is not counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from elicit.model.scale import Floats
from qlearn import OrdinalMDP
from qlearn.mdp.planning import rewarded
from qlearn.mdp.warm_planning import nearly_optimal


class Solved(NamedTuple):
    """A policy (S,), sweeps or policies that it took (None: it does not say), and the CPU seconds
    of solving alone.
    """

    policy: NDArray[np.int64]
    sweeps: int | None
    cpu: float


class Solver(NamedTuple):
    """``solve(mdp, values (k,), tolerance)``: a policy within ``tolerance``, a share of the value
    range, by the package's own rule; ``needs``: the module that must be installed."""

    solve: Callable[[OrdinalMDP, Floats, float], Solved]
    needs: str | None = None

    @property
    def missing(self) -> bool:
        """True if a package that it needs is not installed."""
        return self.needs is not None and find_spec(self.needs) is None


def ours(mdp: OrdinalMDP, values: Floats, tolerance: float) -> Solved:
    """Modified policy iteration that stops on the span of a change (``qlearn.mdp.warm_planning``),
    from a cold start."""
    gain, ends = rewarded(mdp, mdp.normalise(values))
    start = process_time()
    policy = nearly_optimal(mdp, gain, ends, np.full(mdp.n_states, 0.5), tolerance)[1]
    return Solved(policy, None, process_time() - start)


def quantecon(method: str, **settings: Any) -> Solver:
    """QuantEcon's DiscreteDP on state-action pairs, sparse."""

    def solve(mdp: OrdinalMDP, values: Floats, tolerance: float) -> Solved:
        from quantecon.markov import DiscreteDP  # type: ignore[import-not-found, unused-ignore]

        s, a = np.divmod(np.arange(mdp.levels.size), mdp.n_actions)
        rewards = rewarded(mdp, mdp.normalise(values))[0].ravel()
        problem = DiscreteDP(rewards, _matrix(mdp), mdp.discount, s, a)
        start = process_time()
        solved = problem.solve(
            method=method, max_iter=100_000, **({"epsilon": tolerance} | settings)
        )
        return Solved(solved.sigma.astype(np.int64), solved.num_iter, process_time() - start)

    return Solver(solve, "quantecon")


def mdptoolbox(method: str, **settings: Any) -> Solver:
    """pymdptoolbox, without its check of the input, which makes dense tables, and without its
    estimate of the number of sweeps, which takes far longer than these. Its value iteration stops
    on the span too."""

    def solve(mdp: OrdinalMDP, values: Floats, tolerance: float) -> Solved:
        from mdptoolbox import mdp as toolbox  # type: ignore[import-not-found, unused-ignore]

        with _unchecked(toolbox):
            each = [
                _matrix(mdp)[np.arange(mdp.n_states) * mdp.n_actions + a]
                for a in range(mdp.n_actions)
            ]
            rewards = rewarded(mdp, mdp.normalise(values))[0]
            problem = getattr(toolbox, method)(
                each, rewards, mdp.discount, epsilon=tolerance, **settings
            )
            start = process_time()
            problem.run()
        return Solved(np.array(problem.policy), problem.iter, process_time() - start)

    return Solver(solve, "mdptoolbox")


def mdpsolver(**settings: Any) -> Solver:
    """MDPSolver, in C++, one thread, which is given lists."""

    def solve(mdp: OrdinalMDP, values: Floats, tolerance: float) -> Solved:
        import mdpsolver as package  # type: ignore[import-not-found, unused-ignore]

        p, n, m = mdp.transitions, mdp.n_states, mdp.n_actions
        probabilities, columns = (
            [[x.tolist() for x in row] for row in _grouped(np.split(part, p.indptr[1:-1]), n, m)]
            for part in (p.data, p.indices)
        )
        model = package.model()
        rewards = rewarded(mdp, mdp.normalise(values))[0].tolist()
        model.mdp(
            discount=mdp.discount,
            rewards=rewards,
            tranMatProbs=probabilities,
            tranMatColumns=columns,
        )
        start = process_time()
        model.solve(tolerance=tolerance, parallel=False, **settings)
        return Solved(np.array(model.getPolicy()), None, process_time() - start)

    return Solver(solve, "mdpsolver")


def _grouped(parts: list[Any], n: int, m: int) -> list[list[Any]]:
    """n lists of m parts each."""
    return [parts[i * m : (i + 1) * m] for i in range(n)]


@contextmanager
def _unchecked(toolbox: Any) -> Iterator[None]:
    check, bound = toolbox._util.check, toolbox.ValueIteration._boundIter
    toolbox._util.check = lambda *tables: None
    toolbox.ValueIteration._boundIter = lambda self, epsilon: setattr(self, "max_iter", 100_000)
    try:
        yield
    finally:
        toolbox._util.check, toolbox.ValueIteration._boundIter = check, bound


def _matrix(mdp: OrdinalMDP) -> sparse.csr_matrix:
    p = mdp.transitions
    return sparse.csr_matrix((p.data, p.indices, p.indptr), shape=p.shape)


SOLVERS: dict[str, Solver] = {
    "qlearn, modified policy iteration": Solver(ours),
    "pymdptoolbox, value iteration": mdptoolbox("ValueIteration"),
    "QuantEcon, modified policy iteration": quantecon("modified_policy_iteration", k=5),
    "QuantEcon, value iteration": quantecon("value_iteration"),
    "QuantEcon, policy iteration": quantecon("policy_iteration"),
    "MDPSolver, value iteration": mdpsolver(algorithm="vi"),
    "MDPSolver, modified policy iteration": mdpsolver(algorithm="mpi"),
}
"""Each by the settings that were fastest on random MDPs: of QuantEcon 5 sweeps of a policy in place
of 20; of MDPSolver plain updates in place of Gauss-Seidel."""
