"""How many questions policy iteration asks before its certificate stands, and how often what it promises is kept.

    python -m benchmarks.asking.certificates --out benchmarks/RESULTS-certified.md   half an hour on one core
    python -m benchmarks.asking.certificates --problems 4 --erring 4                  seconds; rough figures

Random MDPs of the paper (|S| = 100, |A| = 5, discount .95) and ICU-Sepsis, each problem with a hidden scale of its own.
A truthful tutor and the polytope, beside plain value iteration; and a tutor who flips a tenth of her answers, with the
posterior. Then the same numbers of questions beside how few could have proven the policy (``hindsight``).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np

from benchmarks.asking import hindsight
from benchmarks.reporting import machine, save, with_interval
from elicit import Comparator, FlippingTutor, PolytopeComparator, PosteriorComparator, TruthfulTutor, Tutor
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, OrdinalMDP, policy_loss, random_mdp
from qlearn.learners.learner import Learner, Result
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import draw_values

PROVEN, ENOUGH, ERROR = 5e-5, 0.01, 0.1
Problem = Callable[[int], tuple[OrdinalMDP, Floats]]
LIMIT = """
## How few could have proven it

On the same problems, with hindsight: of the advantages of the policy that is optimal for the hidden scale, the truthful
answer about the one that leaves least open, again and again until the policy is proven (greedy: an upper bound on the
fewest); without those that later ones made needless (pruned: another); and those of them without which all other such
answers prove nothing (necessary: a lower bound). *Bits*: the logarithm of the share of scales for which the policy is
optimal, which without hindsight no rule of questions with two answers stays below on average, but for the tolerance.
*Ratio*: of the means, to the greedy limit. The rules of Regan and Boutilier (2009) ask whether a level is worth more
than so much, here with our incumbent and bound; 400 at most. With the posterior, hindsight is answered truthfully, and
ours with a tenth flipped.

| problem | tutor errs | rule | questions | at most | ratio |
|---|---|---|---:|---:|---:|"""


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


def limit(name: str, problem: Problem, how_many: int) -> list[str]:
    """Rows of questions beside their limit, of one kind of problem."""
    found: dict[tuple[str, str], list[float]] = {}
    rules = {
        "policy iteration": partial(_certify, cuts=None),
        "policy iteration without cuts": partial(_certify, cuts=False),
        "halve the largest gap (Regan and Boutilier)": partial(hindsight.bound_queries, choose=hindsight.largest_gap),
        "current solution (Regan and Boutilier)": partial(hindsight.bound_queries, choose=hindsight.current_solution),
    }
    for seed in range(how_many):
        mdp, values = problem(seed)
        for what, number in hindsight.hindsight(mdp, values, PROVEN).items():
            rule = "bits" if what == "bits" else f"hindsight, {what}"
            found.setdefault(("never", rule), []).append(number)
        for rule, count in rules.items():
            found.setdefault(("never", rule), []).append(count(mdp, values, PROVEN))
        errs = f"{ERROR:.0%}"
        few = hindsight.hindsight_of_posterior(mdp, values, ENOUGH, 2 * ERROR, seed)
        found.setdefault((errs, "hindsight, greedy"), []).append(few)
        known, tutor = PosteriorComparator(mdp.k, lapse=2 * ERROR, seed=seed), FlippingTutor(values, ERROR, seed=seed)
        asked = run(InteractivePolicyIteration(mdp, known, tolerance=ENOUGH), tutor)[0].asked
        found.setdefault((errs, "policy iteration"), []).append(asked)
    rows = []
    for (errs, rule), numbers in found.items():
        ratio = np.mean(numbers) / np.mean(found[errs, "hindsight, greedy"])
        most = f"{max(numbers):.3g}"
        rows.append(f"| {name} | {errs} | {rule} | {with_interval(numbers, 1)} | {most} | {ratio:.2f} |")
    return rows


def _certify(mdp: OrdinalMDP, values: Floats, tolerance: float, cuts: bool | None) -> int:
    learner = InteractivePolicyIteration(mdp, PolytopeComparator(mdp.k), tolerance=tolerance, cuts=cuts)
    return run(learner, TruthfulTutor(values))[0].asked


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
    text += LIMIT.splitlines()
    print(LIMIT, flush=True)
    for name, problem, _ in problems:
        text += limit(name, problem, given.problems)
        print("\n".join(text[-10:]), flush=True)
    save("\n".join([*text, ""]), given.out, f"0-{given.problems - 1}, 0-{given.erring - 1} where she errs")


if __name__ == "__main__":
    main()
