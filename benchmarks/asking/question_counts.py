"""Number of questions that a policy costs: true and guaranteed loss against the number of answers.

    python -m benchmarks.asking.question_counts --quick
        # a minute; rough figures
    python -m benchmarks.asking.question_counts --out benchmarks/RESULTS-questions.md

Random MDPs of the paper (|S| = 100, |A| = 5, discount .95, k = 5, 10, 20), three families of
``qlearn.problems`` and ICU-Sepsis (6 levels, discount .99), with a tutor who flips 0, 10 or 20% of
the answers. The learners: policy iteration (``InteractivePolicyIteration``) with its default
strategy, value iteration and Q-learning as in the literature and asking late; and random pairs with
a fit, which is what one does without a learner. ``benchmarks.asking.question_rules`` compares the
strategies on the same problems. ``--journal`` keeps finished runs: while the code is the same, the
same command goes on where it was stopped, also with more seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import elicit
from benchmarks.asking.rival_rules import RIVAL_RULES
from benchmarks.reporting import save, with_interval
from benchmarks.stamps import sources
from elicit.model.scale import Floats
from qlearn import strategies, unasked_loss
from qlearn.certificates.loss_bound import loss_bound
from qlearn.experiments.parallel import Cell, sweep
from qlearn.learners.learner import Learner
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.learners.q_learning import InteractiveQLearning
from qlearn.learners.q_learning_asking_late import LateQLearning
from qlearn.learners.value_iteration import InteractiveValueIteration, LateValueIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import evaluate_policy, optimal_policy, policy_loss, value_iteration
from qlearn.problems.families.catalogue import FAMILIES
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import draw_values, random_mdp

GRID = (0, 5, 10, 20, 40, 80, 160)  # numbers of answers at which policies are judged
TOLERANCE = 0.01  # a policy that may lose a hundredth of the value range will do
STEPS = 100_000  # of Q-learning
RANDOM = ("k = 5", "k = 10", "k = 20")
COSTLY = ("rover", "surgery", "career")  # families in which a wrong guess costs most
ERRORS = (0.0, 0.1, 0.2)
Policy = Callable[[], tuple[Any, elicit.Comparator]]  # the present policy (S,), and what is known
Row = dict[str, Any]

CERTIFY = {
    "policy iteration, telling violation": strategies.telling_violation,
    "policy iteration, mutual information": strategies.mutual_information,
    "policy iteration, max regret": strategies.max_regret,
    "policy iteration, random candidate": None,
}
METHODS = (  # of the page: question_rules compares strategies with each other
    "policy iteration, telling violation",
    "policy iteration, simple bags",
    "value iteration",
    "value iteration, late",
    "Q-learning",
    "Q-learning, late",
    "random pairs + fit",
)
"""Those of the page; ``run`` knows ``CERTIFY`` and ``RIVAL_RULES`` as well."""
DEFAULT = "policy iteration, telling violation"
MORE = 2.5  # times as many problems where the promise of 95% is judged


def run(cell: Cell) -> Row:
    """One learner on one problem: after GRID's numbers of answers the true loss and its bound (nan
    beyond the budget's end: the last ones stand), how many were asked in all, and how it ended."""
    mdp, values = problem(cell["environment"], cell["seed"])
    comparator = made(cell["comparator"], mdp.k, cell["error"], cell["seed"])
    tutor: elicit.Tutor = elicit.TruthfulTutor(values)
    if cell["error"]:
        tutor = elicit.FlippingTutor(values, cell["error"], seed=cell["seed"])
    best = value_iteration(mdp, values)[0]
    losses, bounds = [], []

    def judge(policy: Any, known: elicit.Comparator) -> None:
        losses.append(float(policy_loss(mdp, policy, values, optimum=best).max()))
        bounds.append(
            float(loss_bound(mdp, policy, known).loss_bound) if cell["bounds"] else float("nan")
        )

    if cell["method"] == "random pairs + fit":
        asked, status = _random_pairs(mdp, comparator, tutor, cell["seed"], judge), "DONE"
    else:
        learner = learner_of(cell["method"], mdp, comparator, cell["seed"])
        asked, status = 0, ""
        while queries := learner.ask():
            if asked in GRID:
                judge(learner.result().policy, learner.comparator)
            learner.tell([tutor(query) for query in queries])
            asked += len(queries)
        result = learner.result()
        judge(result.policy, result.comparator)
        asked, status = result.asked, result.status.name
    padding = len(GRID) - len(losses)
    return {
        "asked": asked,
        "status": status,
        "end": losses[-1],
        "kept": bool(losses[-1] <= bounds[-1] + 1e-9),
        "loss": (losses + losses[-1:] * padding)[: len(GRID)],
        "bound": (bounds + bounds[-1:] * padding)[: len(GRID)],
    }


def problem(environment: str, seed: int) -> tuple[OrdinalMDP, Floats]:
    """An MDP and a hidden scale (k,)."""
    if environment == "ICU-Sepsis":
        return icu_sepsis(), draw_values(6, seed=seed)
    if environment in FAMILIES:
        mdp = FAMILIES[environment](seed)
        return mdp, draw_values(mdp.k, seed=seed)
    return random_mdp(100, 5, int(environment.removeprefix("k = ")), seed=seed)


def made(name: str, k: int, error: float, seed: int) -> elicit.Comparator:
    """A fresh comparator, told how often the tutor errs."""
    if name == "polytope":
        return elicit.PolytopeComparator(k)
    if name == "ensemble":
        return elicit.BradleyTerryComparator(k, seed=seed, region="ensemble")
    return elicit.PosteriorComparator(k, lapse=2 * error or 0.05, seed=seed)


def learner_of(method: str, mdp: OrdinalMDP, comparator: elicit.Comparator, seed: int) -> Learner:
    """The learner by name, with a budget of the last of GRID."""
    common: dict[str, Any] = {"max_queries": GRID[-1], "seed": seed}
    if method.startswith("policy iteration"):
        common["tolerance"] = TOLERANCE
        if method == "policy iteration, simple bags":
            return InteractivePolicyIteration(mdp, comparator, bags=elicit.Bags(), **common)
        chosen = (CERTIFY | RIVAL_RULES)[method] or _at_random(seed)
        # strategies choose among the same pairs, so none may ask about cuts besides
        return InteractivePolicyIteration(mdp, comparator, strategy=chosen, cuts=False, **common)
    if method.startswith("value iteration"):
        common["tolerance"] = TOLERANCE
        sweeping = LateValueIteration if "late" in method else InteractiveValueIteration
        return sweeping(mdp, comparator, **common)
    learning = LateQLearning if "late" in method else InteractiveQLearning
    return learning(mdp, comparator, steps=STEPS, epsilon=1.0, **common)


def _at_random(seed: int) -> strategies.Strategy:
    rng = np.random.default_rng(seed)
    return lambda candidates: rng.random(len(candidates))


def _random_pairs(
    mdp: OrdinalMDP,
    comparator: elicit.Comparator,
    tutor: elicit.Tutor,
    seed: int,
    judge: Callable[..., None],
) -> int:
    """Ask about what two random policies do from a random state, and solve for what the answers
    make of the scale.
    """
    rng, live = np.random.default_rng(seed), np.flatnonzero(~mdp.terminal)
    policy, asked = np.argmax(mdp.admissible, axis=1), 0
    for asked in range(GRID[-1] + 1):
        if asked in GRID:
            policy = optimal_policy(mdp, comparator.values, policy)
            judge(policy, comparator)
        if asked == GRID[-1]:
            break
        for _ in range(100):  # until the comparator cannot tell everywhere
            left, right = (evaluate_policy(mdp, _random_policy(mdp, rng)) for _ in range(2))
            unclear = live[comparator.compare((left - right)[live]) == elicit.Verdict.UNKNOWN]
            if len(unclear):
                break
        else:
            judge(optimal_policy(mdp, comparator.values, policy), comparator)
            return asked
        state = rng.choice(unclear)
        query = elicit.Query.make(mdp.fingerprint, asked, left[state], right[state])
        comparator = comparator.update(elicit.Answers.of([tutor(query)], mdp.k))
    return asked


def _random_policy(mdp: OrdinalMDP, rng: np.random.Generator) -> Any:
    return np.where(mdp.admissible, rng.random(mdp.levels.shape), -1.0).argmax(axis=1)


def cells(environments: Sequence[str], seeds: int, methods: Sequence[str] = METHODS) -> list[Row]:
    """List the runs: a polytope for the tutor who never errs, a posterior for all.

    An ensemble of fits runs with the default strategy only.
    """
    out = []
    for environment in environments:
        for method in methods:
            if environment not in RANDOM and not method.startswith(
                ("policy iteration, telling", "policy iteration, simple", "value")
            ):
                continue
            for error in ERRORS:
                for name in ("polytope", "posterior", "ensemble"):
                    if (name == "polytope" and error) or (
                        name == "ensemble" and "telling" not in method
                    ):
                        continue
                    bounds = method.startswith(
                        ("policy iteration, telling", "policy iteration, simple")
                    )
                    if environment != "ICU-Sepsis":  # whose bounds take seconds
                        bounds |= method.startswith(("value", "Q-learning, late"))
                    bounds &= not (name == "posterior" and method == "value iteration")
                    judged = name == "posterior" and method == DEFAULT
                    out += [
                        {"environment": environment, "method": method, "error": error,
                         "comparator": name, "bounds": bounds, "seed": seed}
                        for seed in range(int(MORE * seeds) if judged else seeds)
                    ]  # fmt: skip
    return out


def report(done: Sequence[tuple[Row, Row]]) -> str:
    """The tables, as Markdown, of (cell, row) pairs."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for cell, row in done:
        key = (cell["environment"], cell["error"], cell["comparator"], cell["method"])
        groups.setdefault(key, []).append(row)
    seeds, most = (pick(map(len, groups.values())) for pick in (min, max))
    lines = [
        "# How many questions?",
        "",
        "True loss at the worst state, in percent of the value range, after so many answers: mean "
        f"over {seeds} problems ({most} with policy iteration's default strategy and a posterior)"
        ", and below it what was guaranteed by then, where that was computed. Who has "
        "finished, keeps the"
        " policy. Random MDPs have 100 states, 5 actions and a discount of .95; ICU-Sepsis has 6 "
        f"levels, discount .99; {', '.join(COSTLY)} are families in which a wrong guess is dear."
        f" *asked*: questions in all, mean and 95% interval of the mean, at most {GRID[-1]}.",
    ]
    for environment, error in dict.fromkeys((key[0], key[1]) for key in groups):
        lines += ["", f"## {environment}, {100 * error:.0f}% of the answers flipped", ""]
        lines += ["| learner | comparator | asked | " + " | ".join(map(str, GRID)) + " |"]
        lines += ["|---|---|---|" + "---|" * len(GRID)]
        lines += [nobody_asked(environment, range(seeds))]
        for key, rows in groups.items():
            if key[:2] == (environment, error):
                lines += [line(key[3], key[2], rows)]
    return "\n".join([*lines, "", *_closing(groups)]) + "\n"


def nobody_asked(environment: str, seeds: Sequence[int]) -> str:
    """A row of the tables for asking nothing: acting as if all gaps between levels were equal."""
    loss = 100 * np.mean([unasked_loss(*problem(environment, seed)).worst for seed in seeds])
    return f"| asked nothing | equal gaps | 0 | {loss:.2f} |" + " |" * (len(GRID) - 1)


def line(method: str, comparator: str, rows: Sequence[Row]) -> str:
    """A row of the tables: a method and comparator on all problems."""
    loss = 100 * np.mean([row["loss"] for row in rows], axis=0)
    bound = 100 * np.mean([row["bound"] for row in rows], axis=0)
    shown = [
        f"{a:.2f}" + (f"<br>≤ {b:.2f}" if np.isfinite(b) else "")
        for a, b in zip(loss, bound, strict=True)
    ]
    asked = with_interval([row["asked"] for row in rows], 0)
    return f"| {method} | {comparator} | {asked} | " + " | ".join(shown) + " |"


def _closing(groups: dict[tuple[Any, ...], list[Row]]) -> list[str]:
    """Write the section on the number of questions until the default stops."""
    lines = [
        "## How many questions will my expert have to answer?",
        "",
        f"Until no plausible scale lets the policy lose more than {100 * TOLERANCE:.0f}% of the "
        "value range anywhere"
        " (`InteractivePolicyIteration`, default strategy): mean, and the most in nine of ten "
        "problems. A polytope"
        " proves it, if every answer is right; a posterior says so at 95%. *Kept*: runs whose true "
        "loss is within the"
        " bound.",
        "",
        "| problem | answers flipped | comparator | mean | nine in ten | kept |",
        "|---|---|---|---|---|---|",
    ]
    for (environment, error, comparator, method), rows in groups.items():
        if method == DEFAULT and comparator != "ensemble":
            asked, kept = [row["asked"] for row in rows], [row["kept"] for row in rows]
            lines.append(
                f"| {environment} | {100 * error:.0f}% | {comparator} | {np.mean(asked):.0f} | "
                f"{np.quantile(asked, 0.9, method='higher'):.0f} | {100 * np.mean(kept):.0f}% |"
            )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description="How many questions a policy costs.")
    parser.add_argument("--quick", action="store_true", help="two seeds, k = 5 only, no Q-learning")
    parser.add_argument(
        "--seeds", type=int, default=20, help="problems for each setting (default: 20)"
    )
    parser.add_argument("--jobs", type=int, default=-1, help="processes (default: one a core)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path, help="where to write the tables (default: printed)")
    chosen = parser.parse_args(arguments)
    environments = RANDOM[:1] if chosen.quick else (*RANDOM, *COSTLY, "ICU-Sepsis")
    methods = [name for name in METHODS if not (chosen.quick and name.startswith("Q-learning"))]
    todo = cells(environments, 2 if chosen.quick else chosen.seeds, methods)
    from benchmarks.asking import (
        question_counts,
    )  # by the name that workers and the journal know, not as __main__

    made_of = sources(question_counts.__name__)  # a row of other code is none of these
    how = {"journal": chosen.journal, "jobs": chosen.jobs, "progress": _progress}
    rows = sweep(question_counts.run, todo, own=lambda cell: (made_of, {}), **how)
    text = report(list(zip(todo, rows, strict=True)))
    if chosen.out is None:
        print(text)
    save(text, chosen.out, f"0-{(2 if chosen.quick else chosen.seeds) - 1}")


def _progress(done: int, total: int) -> None:
    print(
        f"\r{done} of {total} runs", end="" if done < total else "\n", file=sys.stderr, flush=True
    )


if __name__ == "__main__":
    main()
