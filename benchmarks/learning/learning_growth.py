"""Growth of the cost of interactive Q-learning: time by answers, memory, start-up, and a peer.

Like ``benchmarks.learning.learning_runs``: each function in a process of its own.
"""

from __future__ import annotations

import gc
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from statistics import median
from time import perf_counter, process_time

import numpy as np

from benchmarks.learning.known_values import Knowing
from benchmarks.learning.learning_runs import Found, Setting, comparator, learner, ours, problem
from benchmarks.own_process import memory


def per_answer(at: Setting) -> Found:
    """Seconds to take in one answer and to judge the difference asked next, by the number of
    answers known.
    """
    mdp, values = problem(at, 0)
    ours(at, mdp, values, 0)
    _, seconds, result = ours(at, mdp, values, 0)
    n, passes = len(result.answers), []
    answers = result.answers
    for _ in range(at.repeats + 1):
        known, times = comparator(at), []
        gc.collect()
        for i in range(n):
            start = process_time()
            known = known.update(answers[i : i + 1])
            known.compare(answers.d[min(i + 1, n - 1)])
            times.append(process_time() - start)
        passes.append(times)
    middle = np.median(passes[1:], axis=0)
    edges = np.linspace(0, n, min(n, 5) + 1).astype(int)
    parts = [(int(a), int(b), float(middle[a:b].mean())) for a, b in pairwise(edges)]
    return {"asked": n, "parts": parts, "seconds": seconds}


def memory_of_a_run(at: Setting) -> Found:
    """Bytes in use before the problem is made, and at most after one run."""
    small = replace(at, states=20, steps=2000)
    ours(small, *problem(small, 0), 0)
    before = memory("VmRSS")
    mdp, values = problem(at, 0)
    _, seconds, result = ours(at, mdp, values, 0)
    return {"before": before, "peak": memory("VmHWM"), "seconds": seconds, "asked": result.asked}


def start_up(at: Setting) -> Found:
    """Wall seconds of new processes, the first of each not counted."""
    commands = {
        "`python -c pass`": ["-c", "pass"],
        '`python -c "import elicit"`': ["-c", "import elicit"],
        "`qlearn --help`": ["-m", "qlearn", "--help"],
    }
    found: dict[str, list[float]] = {name: [] for name in commands}
    for i in range(at.repeats + 1):
        for name, command in commands.items():
            start = perf_counter()
            subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
            found[name] += [perf_counter() - start] * (i > 0)
    return {name: median(seconds) for name, seconds in found.items()}


def speed(at: Setting) -> Found:
    """Steps a second of ours, asking and knowing."""
    mdp, values = problem(at, 0)
    ours(at, mdp, values, 0)
    _, seconds, _ = ours(at, mdp, values, 0)
    Knowing(learner(at, mdp, 0), values).run()
    known = Knowing(learner(at, mdp, 0), values).run()
    return {"asking": at.steps / seconds, "knowing": at.steps / known.seconds}


def mdptoolbox(at: Setting) -> Found:
    """Steps a second of pymdptoolbox's QLearning on the same MDP with its rewards known: Q (S, A),
    exploration 1 / log of the step, a new start every 100 steps."""
    try:
        from mdptoolbox.mdp import QLearning  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise ImportError("not installed (pip install pymdptoolbox)") from error
    mdp, values = problem(at, 0)
    n, m = mdp.levels.shape
    dense = mdp.transitions.toarray().reshape(n, m, n).transpose(1, 0, 2)
    np.random.seed(0)  # noqa: NPY002 (the package draws from it)
    peer = QLearning(
        np.ascontiguousarray(dense),
        mdp.rewards(values),
        mdp.discount,
        n_iter=max(10_000, at.prefix),
    )
    start = process_time()
    peer.run()
    return {"steps": peer.max_iter, "knowing": peer.max_iter / (process_time() - start)}
