"""Interactive value iteration at scale: what not knowing the values costs beside knowing them.

    python -m benchmarks.learning.value_iteration_cost [--states 10000 100000] [--jobs 1] [--repeats 3]
        [--out FILE] [--huge]

Each method runs in a process of its own, one after the other, and alternating where there are repeats. The base line
is value iteration on the same share vectors with the same compiled backup, stopping rule and threads, that knows the
values and chooses by e.Q. QuantEcon's DiscreteDP and pymdptoolbox, where they are installed, solve the
scalar problem, k times smaller; ``--huge`` adds a million states, which takes a while.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from itertools import repeat
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from benchmarks.own_process import Failed, apart, memory
from benchmarks.reporting import machine, markdown, save
from elicit import PolytopeComparator, TruthfulTutor
from elicit._support.jit import compiled, unlocked
from elicit.model.scale import Floats, gaps
from qlearn import InteractiveValueIteration, OrdinalMDP, policy_loss, random_mdp
from qlearn.learners.state_sweep import BLOCK
from qlearn.mdp.backup import Model, back_up_from, model_of

TOLERANCE, ACTIONS, LEVELS = 0.001, 5, 10
HEAD = ("method", "seconds", "ratio", "CPU seconds", "sweeps", "ms a sweep", "questions", "loss", "peak memory, GiB")
Run = dict[str, Any]
NOTE = (
    "Seconds: of the two on share vectors all but the making of the MDP; of the other packages, which solve the scalar "
    "problem, k times smaller, their solving alone. CPU seconds and peak memory hold what they make before. They stop "
    "by rules of their own, so that sweeps differ."
)


@unlocked
def sweep_knowing(states: Any, g: Any, v: Any, following: Any, best: Any, model: Model) -> float:
    """Back up these states and take the action of greatest e.Q, where g (p,) are the gaps of e; returns the greatest
    change of a tail sum of V."""
    m, k, ends = model.n_actions, v.shape[1], model.ends
    arrays = model.successors, model.probabilities, ends, model.levels
    q = np.empty((m, k))
    change = 0.0
    for i in range(len(states)):
        s = states[i]
        back_up_from(s, v, arrays, model.discount, q)
        chosen, most = best[s], worth(q, best[s], g)
        for a in range(m):
            if a != chosen and ends[s * m + a] != ends[s * m + a + 1]:
                value = worth(q, a, g)
                if value > most:
                    chosen, most = a, value
        best[s] = chosen
        total = 0.0
        for j in range(k - 1, -1, -1):
            if j > 0:
                total += q[chosen, j] - v[s, j]
                change = max(change, abs(total))
            following[s, j] = q[chosen, j]
    return change


@compiled
def worth(q: Any, a: int, g: Any) -> float:
    """e.q of row a of q (A, k), where g (p,) are the gaps of e."""
    total, value = 0.0, 0.0
    for j in range(q.shape[1] - 1, 0, -1):
        total += q[a, j]
        value += total * g[j - 1]
    return value


def knowing(mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    """The base line. For MDPs without terminal states."""
    n, gamma, g, model = mdp.n_states, mdp.discount, gaps(values), model_of(mdp)
    v, following, best = np.zeros((n, mdp.k)), np.empty((n, mdp.k)), np.zeros(n, dtype=np.int64)
    v[:, 0] = 1.0
    sweeps, change = 0, np.inf
    blocks = [np.arange(i, min(n, i + BLOCK)) for i in range(0, n, BLOCK)]
    with ThreadPoolExecutor(jobs) as pool:
        mapped: Callable[..., Any] = pool.map if jobs > 1 else map
        while not change < TOLERANCE * (1 - gamma) / (4 * gamma):
            arrays = g, v, following, best, model
            change = max(mapped(sweep_knowing, blocks, *map(repeat, arrays)))
            v, following, sweeps = following, v, sweeps + 1
    return {"policy": best, "sweeps": sweeps}


def interactive(mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    """Ours, with a polytope and a truthful tutor."""
    learner = InteractiveValueIteration(mdp, PolytopeComparator(mdp.k), tolerance=TOLERANCE, jobs=jobs)
    tutor, start, sweeps_before = TruthfulTutor(values), perf_counter(), 0.0
    while queries := learner.ask():
        learner.tell([tutor(query) for query in queries])
        sweeps_before = perf_counter() - start
    result = learner.result()
    return {
        "policy": result.policy,
        "sweeps": result.rounds,
        "asked": result.asked,
        "until the last answer": sweeps_before,
        "decided": {tier: n for tier, n in result.decided.items() if n},
    }


def quantecon(mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    """QuantEcon's DiscreteDP on state-action pairs, by value iteration."""
    from quantecon.markov import DiscreteDP  # type: ignore[import-not-found, unused-ignore]

    n, m = mdp.levels.shape
    rewards = (1 - mdp.discount) * mdp.normalise(values)[mdp.levels].ravel()
    s, a = np.divmod(np.arange(n * m), m)
    problem = DiscreteDP(rewards, _scipy_matrix(mdp), mdp.discount, s, a)
    start = perf_counter()
    solved = problem.solve(method="value_iteration", epsilon=TOLERANCE, max_iter=100_000)
    return {"policy": solved.sigma.astype(np.int64), "sweeps": solved.num_iter, "seconds": perf_counter() - start}


def mdptoolbox(mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    """pymdptoolbox, by value iteration; without its estimate of the number of sweeps, which takes far longer than
    these."""
    from mdptoolbox.mdp import ValueIteration  # type: ignore[import-not-found, unused-ignore]

    class Iteration(ValueIteration):  # type: ignore[misc, unused-ignore]
        def _boundIter(self, epsilon: float) -> None:
            self.max_iter = 100_000

    n, m = mdp.levels.shape
    rewards = (1 - mdp.discount) * mdp.normalise(values)[mdp.levels]
    p = _scipy_matrix(mdp)
    each = [p[np.arange(n) * m + a] for a in range(m)]
    problem = Iteration(each, rewards, mdp.discount, epsilon=TOLERANCE)
    start = perf_counter()
    problem.run()
    return {"policy": np.array(problem.policy), "sweeps": problem.iter, "seconds": perf_counter() - start}


def _scipy_matrix(mdp: OrdinalMDP) -> Any:
    from scipy import sparse

    p = mdp.transitions
    return sparse.csr_matrix((p.data, p.indices, p.indptr), shape=p.shape)


METHODS: dict[str, Callable[[OrdinalMDP, Floats, int], Run]] = {
    "values known": knowing,
    "interactive": interactive,
    "QuantEcon DiscreteDP": quantecon,
    "pymdptoolbox": mdptoolbox,
}
NEEDS = {"QuantEcon DiscreteDP": "quantecon", "pymdptoolbox": "mdptoolbox"}


def run(method: str, states: int, jobs: int, seed: int, with_loss: bool) -> Run:
    """One method on one random MDP, in this process: seconds, peak memory in GiB, and what the method reports."""
    small, small_values = random_mdp(2 * BLOCK, 2, LEVELS, rng=seed)
    if method not in NEEDS:
        METHODS[method](small, small_values, jobs)  # compiles what is to be compiled
    start = perf_counter()
    mdp, values = random_mdp(states, ACTIONS, LEVELS, rng=seed)
    built = perf_counter() - start
    mdp.fingerprint, mdp.transitions  # noqa: B018 (made once, whoever needs them)
    start, busy = perf_counter(), process_time()
    found: Run = {"seconds": 0.0} | METHODS[method](mdp, values, jobs)
    found["seconds"] = found["seconds"] or perf_counter() - start
    found["cpu"] = process_time() - busy  # what a busy machine leaves comparable
    found |= {"built": built, "peak": memory("VmHWM") / 2**30, "loss": None}
    policy = found.pop("policy")
    if with_loss:
        found["loss"] = float(policy_loss(mdp, policy, values, 1e-6).max())
    return found


def measured(method: str, states: int, jobs: int, seed: int, with_loss: bool, limit: float) -> Run | str:
    """``run`` in a new process; where it does not end well, why."""
    if method in NEEDS and find_spec(NEEDS[method]) is None:
        return "not installed"
    try:
        return apart(run, method, states, jobs, seed, with_loss, limit=limit)
    except Failed as failure:
        return str(failure)


def report(states: int, jobs: int, repeats: int, seed: int, limit: float, others: bool) -> list[str]:
    """Lines on one size."""
    ours = ("values known", "interactive")
    runs: dict[str, list[Run | str]] = {method: [] for method in METHODS}
    for i in range(repeats):
        for method in METHODS:
            if method in ours or (i == 0 and others):
                runs[method].append(measured(method, states, jobs, seed, i == 0, limit))
    base = [found["seconds"] for found in runs["values known"] if isinstance(found, dict)]
    title = (
        f"## {states:,} states, {ACTIONS} actions, {LEVELS} levels, discount 0.95, tolerance {TOLERANCE}, "
        f"{jobs} thread{'s' * (jobs > 1)}"
    )
    rows: list[list[str]] = []
    for method, each in runs.items():
        good = [found for found in each if isinstance(found, dict)]
        if not good:
            rows += [[method, str(each[0]), *[""] * (len(HEAD) - 2)]] if each else []
            continue
        seconds, first = median(found["seconds"] for found in good), good[0]
        ratio = f"{seconds / median(base):.2f}" if base else ""
        loss = "" if first["loss"] is None else f"{first['loss']:.1e}"
        cells = [method, f"{seconds:.2f}", ratio, f"{median(found['cpu'] for found in good):.2f}", first["sweeps"]]
        cells += [f"{1e3 * seconds / first['sweeps']:.2f}", first.get("asked", ""), loss]
        cells += [f"{max(found['peak'] for found in good):.2f}"]
        rows.append([str(cell) for cell in cells])
    lines = [title, "", *markdown(HEAD, rows, 1)]
    for found in runs["interactive"][:1]:
        if isinstance(found, dict):
            lines += ["", f"The MDP was built in {found['built']:.1f} s; the last answer came after "]
            lines[-1] += f"{found['until the last answer']:.1f} s. Decided by: {found['decided']}."
    return [*lines, ""]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the report; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.learning.value_iteration_cost", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--states", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--huge", action="store_true", help="a million states too")
    parser.add_argument("--jobs", type=int, default=1, help="threads")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds a method may take")
    parser.add_argument("--ours", action="store_true", help="without the other packages")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    lines = ["# Interactive value iteration beside value iteration that knows the values", "", machine(), "", NOTE, ""]
    for states in given.states + [1_000_000] * given.huge:
        lines += report(states, given.jobs, given.repeats, given.seed, given.limit, not given.ours)
    text = "\n".join(lines)
    print(text)
    save(text, given.out, str(given.seed))


if __name__ == "__main__":
    main()
