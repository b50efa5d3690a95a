"""Number of questions until policy iteration has its certificate, and how often it is held.

    python -m benchmarks.asking.certificates --journal results/certificates.jsonl \
        --out benchmarks/RESULTS-certified.md
    python -m benchmarks.asking.certificates --problems 2 --erring 2 --limits 2
        # a few minutes; rough figures
    python -m benchmarks.asking.certificates --only "k = 5" limits
        # parts of the page

Random MDPs of the paper (|S| = 100, |A| = 5, discount .95), the families of ``qlearn.problems`` and
ICU-Sepsis, each problem with a hidden scale of its own. A truthful tutor and the polytope, beside
plain value iteration; and, with the posterior, tutors who err: one who flips a tenth of the
answers, and two who err as in eq. (6). Then the same numbers of questions beside how few could have
proven the policy (``hindsight``).
``--journal`` keeps finished runs: while the code is the same, the same command goes on where it was
stopped, and parts made with ``--only`` are not made again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks import quotes
from benchmarks.asking import hindsight
from benchmarks.reporting import machine, markdown, publish, with_interval
from benchmarks.stamps import sources
from elicit import Comparator, PolytopeComparator, PosteriorComparator, TruthfulTutor, Tutor
from elicit.model.outcomes import Status
from elicit.model.scale import Floats
from elicit.model.tutor import CountsErrors
from qlearn import (
    InteractivePolicyIteration,
    InteractiveValueIteration,
    OrdinalMDP,
    equal_gaps_policy,
    policy_loss,
    random_mdp,
    unasked_loss,
)
from qlearn.experiments.ablation import TUTORS, of_precision
from qlearn.experiments.parallel import Cell, sweep
from qlearn.learners.learner import Learner, Result
from qlearn.mdp.planning import Actions
from qlearn.problems.families.catalogue import FAMILIES
from qlearn.problems.icu_sepsis import icu_sepsis
from qlearn.problems.random_mdp import draw_values

PROVEN, ENOUGH, ERROR = 5e-5, 0.01, 0.1
BUDGET = 1000  # questions, with a tutor who errs
ICU = "ICU-Sepsis"
RANDOM = ("k = 5", "k = 10", "k = 20")
PARTS = (*RANDOM, *FAMILIES, ICU)
# problems of ICU-Sepsis with a truthful tutor, and at most of limits at k = 20: a minute each
FEW = 5
LIMITS = "limits"
Row = dict[str, Any]
Made = Callable[[OrdinalMDP, Floats, int], Tutor]  # from a hidden scale and a seed
NEVER = "never"
FLIPS = "10% flipped"
ERRING: Mapping[str, Made] = {
    FLIPS: lambda mdp, values, seed: TUTORS["flip"](mdp, values, ERROR, seed),
    "eq. (6), c = 1": partial(of_precision, 1.0),
    "eq. (6), 10%": lambda mdp, values, seed: TUTORS["logistic"](mdp, values, ERROR, seed),
}
"""The tutors who err, by what the page calls them."""
HEAD = ("problem", "learner", "tutor errs", "tolerance", "problems", "asked nothing",
        "questions", "at most",
        "spent", "held",
        "answers wrong", "wait")  # fmt: skip
ABOUT = f"""\
Stops once no plausible scale lets the policy lose more than the tolerance, in percent of the value range, at any
state: proven with the polytope, at 95% with the posterior.

- *tutor errs*: **{FLIPS}**: a tenth of the answers, drawn by chance, are flipped, however clear the case
  is. **eq. (6)**: the tutor errs where two things are nearly equal, as in the paper's eq. (6): with its c = 1 on the paper's
  own units (discounted counts times values of 0 to 99), or with the c that errs in 10% of the comparisons of an optimal
  policy. These are the tutors "c=1" and "10%" of `qlearn figures`. In most of these comparisons the two sides may be far
  closer than in those that are asked about: on ICU-Sepsis the second one errs in no answer, too.
- With a tutor who errs the posterior is as it comes: it is not given how the tutor errs, how often, or the c of eq. (6). The
  same problems, for all tutors. {BUDGET:,} questions at most.
- *asked nothing*: true loss at the worst state, in percent of the value range, of the policy that is best if all gaps
  between levels are equal: mean with its 95% t-interval.
- *questions*: mean with its 95% t-interval; *at most*: the most in one run; *spent*: runs that ended because the
  {BUDGET:,} were asked.
- *held*: runs whose true loss at the worst state is within the bound that was stated, with the exact 95% interval.
- *answers wrong*: of those given, all runs together.
- *wait*: from an answer to the next question, median; with `--jobs` above 1 it is longer.
"""  # noqa: E501
ABOUT_LIMITS = """\
On the same problems, with hindsight: of the advantages of the policy that is optimal for the hidden scale, the truthful
answer about the one that leaves least open, again and again until the policy is proven (greedy: an upper bound on the
fewest); without those that later ones made needless (pruned: another); and those of them without which all other such
answers prove nothing (necessary: a lower bound on such answers; cuts, which are about several advantages at once, can
prove it with fewer). *Bits*: the logarithm of the share of scales for which the policy is
optimal, which without hindsight no rule of questions with two answers stays below on average, but for the tolerance.
*Ratio*: of the means, to the greedy limit. The rules of Regan and Boutilier (2009) ask whether a level is worth more
than so much, here with our incumbent and bound; 400 at most. With the posterior, which is as it comes, hindsight is
answered truthfully, and ours with a tenth flipped."""  # noqa: E501


def run(learner: Learner, tutor: Tutor) -> tuple[Result, list[float]]:
    """Return the result, and the waits for each question in ms."""
    waits, begin = [], perf_counter()
    while queries := learner.ask():
        waits.append(1e3 * (perf_counter() - begin))
        answers = [tutor(query) for query in queries]
        begin = perf_counter()
        learner.tell(answers)
    return learner.result(), waits


def problem(name: str, seed: int) -> tuple[OrdinalMDP, Floats]:
    """Return an MDP and its hidden values (k,).

    ``name`` is ICU-Sepsis, a family, or "k = ..." for a random MDP of the paper of k levels.
    """
    if name in (ICU, *FAMILIES):
        mdp = _icu() if name == ICU else FAMILIES[name](seed)
        return mdp, draw_values(mdp.k, seed=seed)
    return random_mdp(100, 5, int(name.removeprefix("k = ")), seed=seed)


_icu = cache(icu_sepsis)


@cache
def _icu_unasked() -> Actions:
    """Return the policy of equal gaps on ICU-Sepsis, whose MDP is always the same."""
    return equal_gaps_policy(_icu())


def certify(cell: Cell) -> Row:
    """Run one learner on one problem.

    The row has the number of questions, whether the budget was spent and the bound held, the wrong
    answers, and the waits for questions in ms.
    """
    seed, who = cell["seed"], cell["errs"]
    mdp, values = problem(cell["problem"], seed)
    comparator: Comparator = PolytopeComparator(mdp.k)
    tutor: Tutor = TruthfulTutor(values)
    budget = None
    if who != NEVER:
        comparator, tutor, budget = (
            PosteriorComparator(mdp.k, seed=seed),
            ERRING[who](mdp, values, seed),
            BUDGET,
        )
    make = (
        InteractivePolicyIteration
        if cell["learner"] == "policy iteration"
        else InteractiveValueIteration
    )
    result, waits = run(make(mdp, comparator, tolerance=tolerance(cell), max_queries=budget), tutor)
    assert isinstance(tutor, CountsErrors)
    return {
        "asked": result.asked,
        "spent": result.status is Status.GUESSED,
        "kept": bool(policy_loss(mdp, result.policy, values).max() <= result.loss_bound + 1e-12),
        "unasked": unasked_loss(
            mdp, values, _icu_unasked() if cell["problem"] == ICU else None
        ).worst,
        "wrong": round(result.asked * tutor.realised_error_rate) if result.asked else 0,
        "waits": waits,
    }


def tolerance(cell: Cell) -> float:
    """Return the largest loss that a certificate allows, as a share of the value range."""
    return PROVEN if cell["errs"] == NEVER and cell["problem"] in RANDOM else ENOUGH


def line(cell: Cell, rows: Sequence[Row]) -> list[str]:
    """A row of the page: one learner and tutor, on all problems of a kind."""
    asked, n = [row["asked"] for row in rows], len(rows)
    kept = binomtest(sum(row["kept"] for row in rows), n)
    low, high = kept.proportion_ci(method="exact")
    waits = [wait for row in rows for wait in row["waits"]]
    return [
        cell["problem"],
        cell["learner"],
        cell["errs"],
        f"{100 * tolerance(cell):g}%",
        f"{n}",
        with_interval([100 * row["unasked"] for row in rows], 1),
        with_interval(asked, 1),
        f"{max(asked)}",
        f"{sum(row['spent'] for row in rows)}",
        f"{100 * kept.statistic:.1f}% [{100 * low:.1f}, {100 * high:.1f}]",
        f"{100 * sum(row['wrong'] for row in rows) / max(1, sum(asked)):.1f}%",
        f"{median(waits):.0f} ms" if waits else "",
    ]


def plan(name: str, who: str, errs: str, seed: int) -> Cell:
    """A run of the first table."""
    return {"problem": name, "learner": who, "errs": errs, "seed": seed}


def cells(only: Sequence[str], problems: int, erring: int) -> list[Cell]:
    """The runs of the first table, row by row."""
    return [
        plan(name, who, errs, seed)
        for name in PARTS
        if name in only
        for who, errs in (
            ("value iteration", NEVER),
            *(("policy iteration", one) for one in (NEVER, *ERRING)),
        )
        for seed in range(_count(name, errs, problems, erring))
    ]


def _count(name: str, errs: str, problems: int, erring: int) -> int:
    """Count the problems of a row."""
    if errs != NEVER:
        return erring
    return min(problems, FEW) if name == ICU else problems


def _without_cuts(mdp: OrdinalMDP, values: Floats, tolerance: float) -> int:
    learner = InteractivePolicyIteration(
        mdp, PolytopeComparator(mdp.k), tolerance=tolerance, cuts=False
    )
    return run(learner, TruthfulTutor(values))[0].asked


RULES: Mapping[str, Callable[[OrdinalMDP, Floats, float], int]] = {
    "policy iteration without cuts": _without_cuts,
    "halve the largest gap (Regan and Boutilier)": partial(
        hindsight.bound_queries, choose=hindsight.largest_gap
    ),
    "current solution (Regan and Boutilier)": partial(
        hindsight.bound_queries, choose=hindsight.current_solution
    ),
}
"""Number of questions to a truthful tutor until the policy is proven within a tolerance, by rule.
"""


def limits(cell: Cell) -> list[tuple[str, str, float]]:
    """Count the questions of each rule on one problem; return (tutor, rule, number) each."""
    mdp, values = problem(cell["problem"], cell["seed"])
    found: list[tuple[str, str, float]] = []
    for what, number in hindsight.hindsight(mdp, values, PROVEN).items():
        found.append((NEVER, "bits" if what == "bits" else f"hindsight, {what}", number))
    found += [(NEVER, rule, count(mdp, values, PROVEN)) for rule, count in RULES.items()]
    return [
        *found,
        (
            FLIPS,
            "hindsight, greedy",
            hindsight.hindsight_of_posterior(mdp, values, ENOUGH, cell["seed"]),
        ),
    ]


def limit_rows(name: str, runs: Sequence[Sequence[tuple[str, str, float]]]) -> list[list[str]]:
    """Return table rows, one for each tutor and rule: the number of questions, and its ratio.

    The ratio is to the number of the greedy rule with hindsight, for the same tutor. ``runs`` has
    the result of ``limits`` for each problem of one kind, and ``name`` is that kind.
    """
    found: dict[tuple[str, str], list[float]] = {}
    for one in runs:
        for errs, rule, number in one:
            found.setdefault((errs, rule), []).append(number)
    rows = []
    for (errs, rule), numbers in sorted(found.items(), key=lambda one: one[0][0] != NEVER):
        ratio = np.mean(numbers) / np.mean(found[errs, "hindsight, greedy"])
        shown = with_interval(numbers, 1), f"{max(numbers):.3g}", f"{ratio:.2f}"
        rows.append([name, errs, rule, f"{len(numbers)}", *shown])
    return rows


def report(
    only: Sequence[str], problems: int, erring: int, limited: int, **how: Any
) -> Iterator[list[str]]:
    """The page, part by part, as its runs end; ``how`` are keywords of ``sweep``."""
    from benchmarks.asking import (
        certificates,
    )  # by the name that workers and the journal know, not as __main__

    done: dict[tuple[Any, ...], Row] = {}

    def certified(runs: Sequence[Cell]) -> list[Row]:
        """The rows of the runs, each of which is made once."""
        missing = [cell for cell in runs if (*cell.values(),) not in done]
        for cell, row in zip(missing, sweep(certificates.certify, missing, **how), strict=True):
            done[(*cell.values(),)] = row
        return [done[(*cell.values(),)] for cell in runs]

    yield ["# Questions until the certificate stands", "", machine(), "", *ABOUT.splitlines()]
    groups: dict[tuple[str, ...], list[Cell]] = {}
    for cell in cells(only, problems, erring):
        groups.setdefault((cell["problem"], cell["learner"], cell["errs"]), []).append(cell)
    table = []
    for runs in groups.values():
        table.append(line(runs[0], certified(runs)))
        _tell(table[-1])
    if table:
        yield markdown(HEAD, table, 4)
    if LIMITS not in only:
        return
    table = []
    for name in [name for name in RANDOM if name in only] or RANDOM:
        count = limited if name != RANDOM[-1] else min(limited, FEW)
        places = [{"problem": name, "seed": seed} for seed in range(count)]
        found = sweep(certificates.limits, places, **how)
        for errs in (NEVER, FLIPS):
            same = [plan(name, "policy iteration", errs, seed) for seed in range(count)]
            for one, row in zip(found, certified(same), strict=True):
                one.insert(0, (errs, "policy iteration", row["asked"]))
        for row in limit_rows(name, found):
            table.append(row)
            _tell(row)
    head = ("problem", "tutor errs", "rule", "problems", "questions", "at most", "ratio")
    yield [
        "## How few could have proven it",
        "",
        *ABOUT_LIMITS.splitlines(),
        "",
        *markdown(head, table, 3),
    ]


def _tell(row: Sequence[str]) -> None:
    print(" | ".join(row), file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it, and what other pages quote of it."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.certificates", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--problems", type=int, default=20, help="with a truthful tutor (default: 20)"
    )
    parser.add_argument(
        "--erring", type=int, default=50, help="with a tutor who errs (default: 50)"
    )
    parser.add_argument(
        "--limits",
        type=int,
        default=20,
        help=f"problems of the second table (default: 20; of k = 20 at most {FEW})",
    )
    parts = (*PARTS, LIMITS)
    parser.add_argument("--only", nargs="+", choices=parts, default=list(parts), metavar="PART",
                        help=f"parts of the page, of {', '.join(map(repr, parts))}")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    made_of = sources("benchmarks.asking.certificates")  # a row of other code is none of these
    how = {"journal": given.journal, "jobs": given.jobs, "own": lambda cell: (made_of, {})}
    page = report(given.only, given.problems, given.erring, given.limits, **how)
    publish(page, given.out, f"0-{given.problems - 1}, 0-{given.erring - 1} where the tutor errs")
    if given.out:
        quotes.renew_beside(given.out)


if __name__ == "__main__":
    main()
