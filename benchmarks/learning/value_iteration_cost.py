"""Interactive value iteration at scale: what not knowing the values costs beside knowing them.

    python -m benchmarks.learning.value_iteration_cost [--states 10000 100000] [--jobs 1] [--repeats
    3]
        [--limit 120] [--ours] [--out FILE] [--huge]

Beside it stand who solves the scalar problem, k times smaller, each at its own fastest settings
(``benchmarks.learning.scalar_solvers``), where they are installed; value iteration on the same
share vectors with the same compiled backup, stopping rule and threads, that knows the values and
chooses by e.Q; and policy iteration. Each method runs in a process of its own, one after the
other, in as many rounds as there are repeats. ``--huge`` adds a million states and takes a while.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import repeat
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

from benchmarks.learning.scalar_solvers import SOLVERS
from benchmarks.own_process import Failed, apart, memory
from benchmarks.reporting import machine, markdown, save
from elicit import PolytopeComparator, TruthfulTutor
from elicit._support.jit import compiled, unlocked
from elicit.model.scale import Floats, gaps
from qlearn import (
    InteractivePolicyIteration,
    InteractiveValueIteration,
    OrdinalMDP,
    drive,
    policy_loss,
    random_mdp,
)
from qlearn.learners.state_sweep import BLOCK
from qlearn.mdp.backup import MdpArrays, back_up_from, model_of

TOLERANCE, ACTIONS, LEVELS = 0.001, 5, 10
HEAD = (
    "method",
    "CPU seconds",
    "least",
    "most",
    "ratio to the fastest",
    "sweeps",
    "questions",
    "loss",
)
HEAD += ("peak memory, GiB",)
Run = dict[str, Any]
NOTE = (
    "CPU seconds, medians: of those on share vectors all but the making of the MDP; of those that "
    "solve the scalar "
    "problem, k times smaller, their solving alone, without the making of their tables (peak "
    "memory holds these). Each "
    "stops by its own rule for this tolerance, so that sweeps differ. Of policy iteration, sweeps "
    "are policies. "
    "pymdptoolbox is run without its check of the input, which makes dense tables, and without its "
    "estimate of the "
    "number of sweeps."
)


@unlocked
def sweep_knowing(states: Any, g: Any, v: Any, following: Any, best: Any, model: MdpArrays) -> Any:
    """Back up these states and take the action of greatest e.Q, where g (p,) are the gaps of e;
    returns the least and the greatest change (2, p) of each tail sum of V."""
    m, k, ends = model.n_actions, v.shape[1], model.ends
    arrays = model.successors, model.probabilities, ends, model.levels
    q = np.empty((m, k))
    change = np.empty((2, k - 1))
    change[0], change[1] = np.inf, -np.inf
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
                change[0, j - 1] = min(change[0, j - 1], total)
                change[1, j - 1] = max(change[1, j - 1], total)
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
    """The base line on share vectors. For MDPs without terminal states."""
    n, gamma, g, model = mdp.n_states, mdp.discount, gaps(values), model_of(mdp)
    v, following, best = np.zeros((n, mdp.k)), np.empty((n, mdp.k)), np.zeros(n, dtype=np.int64)
    v[:, 0] = 1.0
    sweeps, span = 0, np.inf
    blocks = [np.arange(i, min(n, i + BLOCK)) for i in range(0, n, BLOCK)]
    with ThreadPoolExecutor(jobs) as pool:
        mapped: Callable[..., Any] = pool.map if jobs > 1 else map
        while not span < TOLERANCE * (1 - gamma) / (2 * gamma):
            changes = np.stack(
                list(mapped(sweep_knowing, blocks, *map(repeat, (g, v, following, best, model))))
            )
            span = float((changes[:, 1].max(axis=0) - changes[:, 0].min(axis=0)).max())
            v, following, sweeps = following, v, sweeps + 1
    return {"policy": best, "sweeps": sweeps}


def interactive(mdp: OrdinalMDP, values: Floats, jobs: int, partial_sweeps: bool = True) -> Run:
    """Ours, with a polytope and a truthful tutor."""
    comparator = PolytopeComparator(mdp.k)
    learner = InteractiveValueIteration(
        mdp, comparator, tolerance=TOLERANCE, jobs=jobs, partial_sweeps=partial_sweeps
    )
    tutor, start, until_the_last = TruthfulTutor(values), process_time(), 0.0
    while queries := learner.ask():
        learner.tell([tutor(query) for query in queries])
        until_the_last = process_time() - start
    result = learner.result()
    return {
        "policy": result.policy,
        "sweeps": result.rounds,
        "asked": result.asked,
        "until the last answer": until_the_last,
        "decided": {tier: n for tier, n in result.decided.items() if n},
    }


def policy_iteration(mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    """Policy iteration that asks only what can still change the policy, to the same tolerance."""
    learner = InteractivePolicyIteration(mdp, PolytopeComparator(mdp.k), tolerance=TOLERANCE)
    result = drive(learner, TruthfulTutor(values))
    return {"policy": result.policy, "sweeps": result.rounds, "asked": result.asked}


VECTORS: dict[str, Callable[[OrdinalMDP, Floats, int], Run]] = {
    "values known, share vectors": knowing,
    "interactive value iteration": interactive,
    "the same without partial sweeps": partial(interactive, partial_sweeps=False),
    "policy iteration": policy_iteration,
}
METHODS = (*SOLVERS, *VECTORS)


def run(method: str, states: int, jobs: int, seed: int, with_loss: bool) -> Run:
    """One method on one random MDP, in this process: CPU seconds, peak memory in GiB, and what the
    method reports.
    """
    _solved(
        method, *random_mdp(2 * BLOCK, 2, LEVELS, seed=seed), jobs
    )  # compiles what is to be compiled
    start = perf_counter()
    mdp, values = random_mdp(states, ACTIONS, LEVELS, seed=seed)
    built = perf_counter() - start
    mdp.fingerprint, mdp.transitions  # noqa: B018 (made once, whoever needs them)
    found = _solved(method, mdp, values, jobs)
    found |= {"built": built, "peak": memory("VmHWM") / 2**30, "loss": None}
    policy = found.pop("policy")
    if with_loss:
        found["loss"] = float(policy_loss(mdp, policy, values, 1e-6).max())
    return found


def _solved(method: str, mdp: OrdinalMDP, values: Floats, jobs: int) -> Run:
    if method in SOLVERS:
        return SOLVERS[method].solve(mdp, values, TOLERANCE)._asdict()
    start = process_time()
    found = VECTORS[method](mdp, values, jobs)
    return found | {"cpu": process_time() - start}


def measured(
    method: str, states: int, jobs: int, seed: int, with_loss: bool, limit: float
) -> Run | str:
    """``run`` in a new process; where it does not end well, why."""
    if method in SOLVERS and SOLVERS[method].missing:
        return "not installed"
    try:
        return apart(run, method, states, jobs, seed, with_loss, limit=limit)
    except Failed as failure:
        return str(failure)


def report(
    states: int, jobs: int, repeats: int, seed: int, limit: float, others: bool
) -> list[str]:
    """Lines on one size."""
    runs: dict[str, list[Run | str]] = {
        method: []
        for method in METHODS
        if others or method in VECTORS or SOLVERS[method].needs is None
    }
    for i in range(repeats):
        for method, each in runs.items():
            if not each or isinstance(each[-1], dict):  # what failed once is not tried again
                each.append(measured(method, states, jobs, seed, i == 0, limit))
    good = {
        method: [found for found in each if isinstance(found, dict)]
        for method, each in runs.items()
    }
    seconds = {
        method: median(found["cpu"] for found in each) for method, each in good.items() if each
    }
    fastest = min(
        (method for method in seconds if method in SOLVERS), key=lambda method: seconds[method]
    )
    title = (
        f"## {states:,} states, {ACTIONS} actions, {LEVELS} levels, discount 0.95, tolerance "
        f"{TOLERANCE}, "
        f"{jobs} thread{'s' * (jobs > 1)}"
    )
    order = sorted(seconds, key=lambda method: seconds[method])
    rows = [_row(method, good[method], seconds[method] / seconds[fastest]) for method in order]
    rows += [
        [method, str(each[0]), *[""] * (len(HEAD) - 2)]
        for method, each in runs.items()
        if not good[method]
    ]
    lines = [title, "", _who_wins(fastest, seconds), "", *markdown(HEAD, rows, 1)]
    for found in good["interactive value iteration"][:1]:
        lines += ["", f"The MDP was built in {found['built']:.1f} s; the last answer came after "]
        lines[-1] += (
            f"{found['until the last answer']:.1f} CPU seconds. Decided by: {found['decided']}."
        )
    return [*lines, ""]


def _who_wins(fastest: str, seconds: dict[str, float]) -> str:
    """Write what the table shows in a sentence: a method that knows the values is faster."""
    each = [
        f"{method} {seconds[method] / seconds[fastest]:.1f} times"
        for method in VECTORS
        if method in seconds
    ]
    return (
        f"Who is told the values is faster: {fastest} takes {seconds[fastest]:.3f} CPU seconds. "
        f"Beside that, {', '.join(each)} as long."
    )


def _row(method: str, each: list[Run], ratio: float) -> list[str]:
    cpu, first = [found["cpu"] for found in each], each[0]
    loss = "" if first["loss"] is None else f"{first['loss']:.1e}"
    cells = [method, *(f"{x:.3f}" for x in (median(cpu), min(cpu), max(cpu))), f"{ratio:.1f}"]
    cells += [
        "" if first["sweeps"] is None else str(first["sweeps"]),
        str(first.get("asked", "")),
        loss,
    ]
    return [*cells, f"{max(found['peak'] for found in each):.2f}"]


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
    parser.add_argument("--limit", type=float, default=120.0, help="seconds a run may take")
    parser.add_argument("--ours", action="store_true", help="without the other packages")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    lines = [
        "# Interactive value iteration beside value iteration that knows the values",
        "",
        machine(),
        "",
        NOTE,
        "",
    ]
    for states in given.states + [1_000_000] * given.huge:
        lines += report(states, given.jobs, given.repeats, given.seed, given.limit, not given.ours)
    text = "\n".join(lines)
    print(text)
    save(text, given.out, str(given.seed))


if __name__ == "__main__":
    main()
