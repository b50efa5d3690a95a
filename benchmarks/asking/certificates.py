"""How many questions policy iteration asks before its certificate stands, and how often what it promises is kept.

    python -m benchmarks.asking.certificates --out benchmarks/RESULTS-certified.md   a quarter of an hour on one core
    python -m benchmarks.asking.certificates --problems 4 --erring 4                  seconds; rough figures

Random MDPs of the paper (|S| = 100, |A| = 5, discount .95) and ICU-Sepsis, each problem with a hidden scale of its own.
A truthful tutor and the polytope, beside plain value iteration; and a tutor who flips a tenth of her answers, with the
posterior.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.reporting import machine, save, with_interval
from elicit import Comparator, FlippingTutor, PolytopeComparator, PosteriorComparator, TruthfulTutor, Tutor
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, OrdinalMDP, policy_loss, random_mdp
from qlearn.learners.learner import Learner, Result
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import draw_values

PROVEN, ENOUGH, ERROR = 5e-5, 0.01, 0.1
Problem = Callable[[int], tuple[OrdinalMDP, Floats]]


def run(learner: Learner, tutor: Tutor) -> tuple[Result, list[float]]:
    """The result, and how long each question took to come, in ms."""
    waits, begin = [], perf_counter()
    while queries := learner.ask():
        waits.append(1e3 * (perf_counter() - begin))
        answers = [tutor(query) for query in queries]
        begin = perf_counter()
        learner.tell(answers)
    return learner.result(), waits


def line(name: str, who: str, problem: Problem, tolerance: float, truthful: bool, how_many: int) -> str:
    """One learner on so many problems: questions, runs that kept the bound, and the median wait for a question."""
    asked, kept, waits = [], [], []
    for seed in range(how_many):
        mdp, values = problem(seed)
        comparator: Comparator = PolytopeComparator(mdp.k)
        tutor: Tutor = TruthfulTutor(values)
        if not truthful:
            comparator = PosteriorComparator(mdp.k, lapse=2 * ERROR, seed=seed)
            tutor = FlippingTutor(values, ERROR, seed=seed)
        make = InteractivePolicyIteration if who == "policy iteration" else InteractiveValueIteration
        result, waited = run(make(mdp, comparator, tolerance=tolerance), tutor)
        asked.append(result.asked)
        kept.append(policy_loss(mdp, result.policy, values).max() <= result.loss_bound + 1e-12)
        waits += waited
    cells = [name, who, "never" if truthful else f"{ERROR:.0%}", f"{100 * tolerance:g}%", how_many]
    cells += [with_interval(asked, 1), max(asked)]
    return f"| {' | '.join(map(str, cells))} | {100 * np.mean(kept):.1f}% | {median(waits):.0f} ms |"


def paper(k: int) -> Problem:
    """The paper's random MDPs with k levels."""
    return lambda seed: random_mdp(100, 5, k, rng=seed)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(prog="benchmarks.asking.certificates", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--problems", type=int, default=20, help="with a truthful tutor (default: 20)")
    parser.add_argument("--erring", type=int, default=200, help="with a tutor who errs (default: 200)")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    icu = icu_sepsis()
    text = [
        "# Questions until the certificate stands",
        "",
        machine(),
        "",
        "Stops once no plausible scale lets the policy lose more than the tolerance, in percent of the value range, at "
        "any state: proven with the polytope, at 95% with the posterior. Mean with its 95% t-interval, and the most. "
        "*Kept*: runs whose true loss at the worst state is within the bound. *Wait*: from an answer to the next "
        "question, median.",
        "",
        "| problem | learner | tutor errs | tolerance | problems | questions | at most | kept | wait |",
        "|---|---|---|---|---:|---:|---:|---:|---:|",
    ]
    print("\n".join(text), flush=True)
    problems = [(f"k = {k}", paper(k), PROVEN) for k in (5, 10, 20)]
    for name, problem, tolerance in [*problems, ("ICU-Sepsis", lambda seed: (icu, draw_values(6, rng=seed)), ENOUGH)]:
        few = name == "ICU-Sepsis"
        for who, truthful in (("value iteration", True), ("policy iteration", True), ("policy iteration", False)):
            count = min(5, given.problems) if few else given.problems if truthful else given.erring
            text.append(line(name, who, problem, tolerance if truthful else ENOUGH, truthful, count))
            print(text[-1], flush=True)
    save("\n".join([*text, ""]), given.out, f"0-{given.problems - 1}, 0-{given.erring - 1} where she errs")


if __name__ == "__main__":
    main()
