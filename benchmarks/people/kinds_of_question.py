"""Savings by degrees of preference and by sliders, at best, beside plain questions.

    python -m benchmarks.people.kinds_of_question --out benchmarks/RESULTS-kinds.md   ten minutes
    python -m benchmarks.people.kinds_of_question --seeds 2                           rough figures

Policy iteration with the polytope, to a loss of 1%. All answers are right, and what a person says
about their own precision is right too. So each figure is the most that such a question can save.
``--journal FILE`` keeps finished runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from benchmarks.reporting import machine, main_by_seeds, markdown, with_interval
from elicit import Answers, PolytopeComparator
from elicit.model.scale import Floats
from qlearn import InteractivePolicyIteration, hidden_scales, policy_loss, random_mdp
from qlearn.experiments.parallel import Cell, sweep
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.catalogue import FAMILIES

FIRST = 300
TOLERANCE = 0.01
MOST = 60
CLEARLY = 0.1  # |d.e| from which a person says "clearly better"
IMPRECISION = (0.05, 0.1, 0.15)  # standard deviations of what a slider is set to
SLIDERS = (1, 2, 3)  # asked before the first plain question
RANDOM = {f"random MDP, k = {k}": k for k in (4, 5, 6)}
FEW_LEVELS = 6
PLAIN, DEGREE = "plain questions", "slightly or clearly"
_SLIDERS = [f"{n} slider{'s' * (n > 1)}, {s:g}" for s in IMPRECISION for n in SLIDERS]
KINDS = (PLAIN, DEGREE, *_SLIDERS)
HEAD = ("problem", "question", "questions", "saved", "share saved", "violated")


def problems() -> tuple[str, ...]:
    """Return the names of the families with few levels, and of random MDPs."""
    return (*(name for name in FAMILIES if FAMILIES[name](0).k <= FEW_LEVELS), *RANDOM)


def problem(name: str, seed: int) -> OrdinalMDP:
    """Return the problem of this name and seed."""
    if name in RANDOM:
        return random_mdp(60, 4, RANDOM[name], seed=seed)[0]
    return FAMILIES[name](seed)


def told(d: Floats, values: Floats, degree: bool) -> Answers:
    """Return what a truthful person says about d (k,): the sign, and perhaps the degree.

    Since the best level is worth 1 and the worst 0, "d.e is at least c" is a preference too: for d
    less c times the best level and plus c times the worst.
    """
    worth = float(d @ values)
    sign = int(np.sign(worth))
    rows, signs = [d], [sign]
    if degree and sign:
        apart = np.zeros(len(d))
        apart[[0, -1]] = -CLEARLY, CLEARLY
        rows.append(d - sign * apart)
        signs.append(sign if abs(worth) > CLEARLY else -sign)
    return Answers(np.array(rows), signs)


def slid(level: int, values: Floats, imprecision: float, chance: np.random.Generator) -> Answers:
    """Return two preferences: the range that a person sets for the worth of a level.

    It is twice the imprecision to both sides of what they say, wider where that misses the truth,
    and in steps of a tenth, as of ten patients.
    """
    said = values[level] + imprecision * chance.standard_normal()
    low = min(said - 2 * imprecision, values[level])
    high = max(said + 2 * imprecision, values[level])
    ends = np.clip([np.floor(10 * low) / 10, np.ceil(10 * high) / 10], 0.0, 1.0)
    rows = np.zeros((2, len(values)))
    rows[:, level] = 1.0
    rows[:, 0] -= 1.0 - ends
    rows[:, -1] -= ends
    return Answers(rows, [1, -1])


def widest_level(comparator: PolytopeComparator, asked: set[int]) -> int | None:
    """Return the level between worst and best of whose worth least is known; None: all asked."""
    levels = [level for level in range(1, comparator.k - 1) if level not in asked]
    if not levels:
        return None
    low, high = comparator.bounds(np.eye(comparator.k)[levels])
    return levels[int(np.argmax(np.round(high - low, 9)))]


def run(cell: Cell) -> dict[str, Any]:
    """Count the questions of one kind on one problem."""
    mdp, kind = problem(cell["problem"], cell["seed"]), cell["question"]
    values = hidden_scales(cell["scale"], mdp.k, cell["seed"])
    chance = np.random.default_rng(cell["seed"])
    comparator, asked = PolytopeComparator(mdp.k, tie=0), 0
    if "slider" in kind:
        count, imprecision = int(kind.split()[0]), float(kind.split()[-1])
        levels: set[int] = set()
        while len(levels) < count and (level := widest_level(comparator, levels)) is not None:
            levels.add(level)
            comparator = comparator.update(slid(level, values, imprecision, chance))
        asked = len(levels)
    while True:
        learner = InteractivePolicyIteration(mdp, comparator, tolerance=TOLERANCE)
        queries = learner.ask()
        if not queries or asked >= MOST:
            break
        asked += 1
        comparator = comparator.update(told(queries[0].d, values, kind == DEGREE))
    result = learner.result()
    loss = float(policy_loss(mdp, result.policy, values).max())
    return {"asked": asked, "violated": loss > result.loss_bound + 1e-9}


def row(name: str, kind: str, runs: Sequence[Any], plain: Sequence[Any]) -> list[str]:
    """Return the cells of one problem and kind of question, beside plain questions."""
    asked, before = (np.array([one["asked"] for one in some], float) for some in (runs, plain))
    violated = str(sum(one["violated"] for one in runs))
    if kind == PLAIN:
        return [name, kind, with_interval(asked, 1), "", "", violated]
    share = f"{100 * (before - asked).sum() / before.sum():.0f}%"
    saved = with_interval(before - asked, 1, signed=True)
    return [name, kind, with_interval(asked, 1), saved, share, violated]


def report(seeds: int, **how: Any) -> Iterator[list[str]]:
    """The parts of the page."""
    yield [
        "# Degrees and sliders",
        "",
        machine(),
        "",
        f"Questions until policy iteration has proven a loss of {100 * TOLERANCE:g}% with the "
        f"polytope, over {seeds} problems (seeds from {FIRST} on) for each of two kinds of hidden "
        "scale, even and skewed; means with 95% t-intervals. *Slightly or clearly*: each answer "
        f"also says whether the difference exceeds {CLEARLY:g} of the value range. *Sliders*: "
        "before the first plain question the person says, for so many levels, how many of ten "
        "would have to recover for both sides to be equal; the number is the standard deviation of "
        "what they say, and they state a range of twice that to both sides. All answers are right "
        "and all ranges hold, so this is what such questions save at best. A slider counts as one "
        "question, though it takes a person longer, and is about the level of whose worth least is "
        "known. *Saved*: paired.",
    ]
    settings = list(product((*problems(),), KINDS))
    cells = [
        {"problem": name, "question": kind, "scale": scale, "seed": seed}
        for name, kind in settings
        for scale in ("even", "skewed")
        for seed in range(FIRST, FIRST + seeds)
    ]
    found = iter(sweep(run, cells, **how))
    runs = {setting: [next(found) for _ in range(2 * seeds)] for setting in settings}
    every = {kind: [one for name in problems() for one in runs[name, kind]] for kind in KINDS}
    yield markdown(HEAD, [row("all", kind, every[kind], every[PLAIN]) for kind in KINDS], 2)
    yield [
        "By problem, with the least imprecise slider:",
        "",
        *markdown(
            HEAD,
            [
                row(name, kind, runs[name, kind], runs[name, PLAIN])
                for name in problems()
                for kind in KINDS[:3]
            ],
            2,
        ),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it."""
    program = "benchmarks.people.kinds_of_question"
    main_by_seeds(program, report, FIRST, ("seeds", 6, "a row and kind"), arguments)


if __name__ == "__main__":
    main()
