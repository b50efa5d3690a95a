"""Functions that ``learning_cost`` measures, each in a process of its own
(``benchmarks.own_process``).

Seconds are CPU seconds of one thread. The first run of each kind compiles and fills caches, and
does not count; those that count alternate between the two sides of a ratio.
"""

from __future__ import annotations

import gc
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from time import process_time
from typing import Any

import numpy as np

from benchmarks.learning.known_values import Knowing
from elicit import (
    AlwaysAsk,
    BradleyTerryComparator,
    Comparator,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
)
from elicit._support.hashing import key_of
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from qlearn import InteractiveQLearning, OrdinalMDP, drive, policy_loss, random_mdp
from qlearn.learners.learner import Result

Found = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """``error``: the share of answers that the tutor flips; ``seeds``: how many problems, each with
    ``repeats`` timed runs; ``prefix``: how much of its run a slow rival is given (steps, open
    comparisons or questions)."""

    k: int = 10
    states: int = 100
    actions: int = 5
    steps: int = 100_000
    epsilon: float = 0.1
    comparator: str = "polytope"
    error: float = 0.0
    max_queries: int | None = None
    particles: int = 500
    seeds: int = 5
    repeats: int = 5
    rival: str = ""
    prefix: int = 0
    fits: int = 10


def comparator(at: Setting) -> Comparator:
    """A fresh one, with nothing in its caches."""
    if at.comparator == "polytope":
        return PolytopeComparator(at.k)
    if at.comparator == "posterior":
        return PosteriorComparator(at.k, lapse=0.1, particles=at.particles)
    if at.comparator == "always-ask":
        return AlwaysAsk(at.k)
    region: Any = at.comparator
    return BradleyTerryComparator(at.k, n_boot=100, level=0.95, region=region)


def problem(at: Setting, seed: int) -> tuple[OrdinalMDP, Floats]:
    """A random MDP, discount .95, and the hidden scale (k,) from 0 to 1."""
    mdp, values = random_mdp(at.states, at.actions, at.k, seed=seed)
    return mdp, mdp.normalise(values)


def tutor(at: Setting, values: Floats, seed: int) -> TruthfulTutor | FlippingTutor:
    """The tutor of a problem: the same for all runs of it."""
    return FlippingTutor(values, at.error, seed) if at.error else TruthfulTutor(values)


def learner(at: Setting, mdp: OrdinalMDP, seed: int) -> InteractiveQLearning:
    """A fresh learner, ready for its first question."""
    return InteractiveQLearning(
        mdp,
        comparator(at),
        steps=at.steps,
        epsilon=at.epsilon,
        seed=seed,
        max_queries=at.max_queries,
    )


def ours(at: Setting, mdp: OrdinalMDP, values: Floats, seed: int) -> tuple[float, float, Result]:
    """Seconds to make a learner, seconds of its run, and what it learned."""
    gc.collect()
    start = process_time()
    made, teacher = learner(at, mdp, seed), tutor(at, values, seed)
    between = process_time()
    result = drive(made, teacher)
    return between - start, process_time() - between, result


def opened(result: Result) -> int:
    """The comparisons that neither equality nor dominance settled."""
    return result.compared - result.decided["equal"] - result.decided["dominance"]


def beside_knowing(at: Setting) -> Found:
    """Pairs of runs, one that must ask and one that knows the values, for each seed."""
    found: dict[str, list[Any]] = {}
    for seed in range(at.seeds):
        mdp, values = problem(at, seed)
        pairs = []
        for _ in range(at.repeats + 1):
            made, seconds, result = ours(at, mdp, values, seed)
            knowing = Knowing(learner(at, mdp, seed), values)
            gc.collect()
            known = knowing.run()
            pairs.append((seconds, known.seconds, seconds / known.seconds, made))
        row = dict(
            zip(
                ("seconds", "knowing", "ratio", "made"),
                map(median, zip(*pairs[1:], strict=True)),
                strict=True,
            )
        )
        row |= {"asked": result.asked, "compared": result.compared, "opened": opened(result)}
        row["same"] = bool((result.policy == known.policy).all())
        row["loss"] = float(policy_loss(mdp, result.policy, values).mean())
        row["loss knowing"] = float(policy_loss(mdp, known.policy, values).mean())
        row["guessed"] = result.decided["guess"]
        for name, value in row.items():
            found.setdefault(name, []).append(value)
    return found


def beside_plain(at: Setting) -> Found:
    """Pairs of our whole run and a rival's prefix, on one problem
    (``benchmarks.learning.plain_q_learning``).
    """
    from benchmarks.learning import plain_q_learning as plain

    mdp, values = problem(at, 0)
    limits: dict[str, Callable[[plain.Run], int]] = {
        "programs": lambda run: run.opened,
        "careful": lambda run: run.steps,
        "box": lambda run: len(run.asked),
        "ensemble": lambda run: len(run.asked),
    }
    makes: dict[str, Callable[[], plain.Judge]] = {
        "programs": lambda: plain.Rebuilt(at.k),
        "careful": lambda: plain.Careful(at.k),
        "box": lambda: plain.Bootstrap(at.k, "box"),
        "ensemble": lambda: plain.Bootstrap(at.k, "ensemble"),
    }
    reached, pairs = limits[at.rival], []
    for i in range(at.repeats + 1):
        _, seconds, result = ours(at, mdp, values, 0)
        gc.collect()
        wanted = at.prefix if i else min(at.prefix, 20)
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # fits that did not converge: their time counts all the same
            run = plain.q_learning(
                mdp,
                makes[at.rival](),
                tutor(at, values, 0),
                steps=at.steps,
                epsilon=at.epsilon,
                key=key_of(0),
                enough=lambda run, wanted=wanted: reached(run) >= wanted,  # type: ignore[misc]
            )
        whole = run.whole(at.steps, opened(result))
        theirs, here = run.seconds / max(1, len(run.asked)), seconds / max(1, result.asked)
        judged = 1e6 * run.judging / max(1, run.opened)
        pairs.append(
            (seconds, whole, whole / seconds, run.seconds, judged, theirs, here, theirs / here)
        )
    names = (
        "seconds",
        "whole",
        "ratio",
        "prefix seconds",
        "us open",
        "a question",
        "ours a question",
        "ratio asked",
    )
    found: Found = dict(zip(names, map(median, zip(*pairs[1:], strict=True)), strict=True))
    found |= {"asked": result.asked, "opened": opened(result), "compared": result.compared}
    found |= {"their steps": run.steps, "their opened": run.opened, "their asked": len(run.asked)}
    asked = np.array(run.asked).reshape(-1, at.k)
    found["same questions"] = bool(np.array_equal(asked, result.answers.d[: len(asked)]))
    found["same policy"] = (
        bool((run.best == result.policy).all()) if run.steps == at.steps else None
    )
    if at.rival in ("box", "ensemble") and result.asked:
        found["a step"] = (run.seconds - run.judging) / run.steps
        found |= whole_bootstrap(at, mdp, values, found["a step"])
    return found


def whole_bootstrap(at: Setting, mdp: OrdinalMDP, values: Floats, step: float) -> Found:
    """Pairs of our whole run and what the bootstrap would take for one with our questions, at
    ``step`` seconds a step beside its fits and decisions."""
    pairs = []
    for _ in range(at.repeats):
        _, seconds, result = ours(at, mdp, values, 0)
        refit, deciding, sizes = fits(at, result)
        whole = step * at.steps + deciding * opened(result) + refit * result.asked
        pairs.append((seconds / result.asked, whole, whole / seconds, refit, deciding))
    names = ("ours then", "whole", "ratio", "refit", "deciding")
    return dict(zip(names, map(median, zip(*pairs, strict=True)), strict=True)) | {"sizes": sizes}


def fits(at: Setting, result: Result) -> tuple[float, float, list[int]]:
    """Seconds of the bootstrap's fits after an answer, and of a decision then, and the numbers of
    answers at which, spread evenly over our run's."""
    from benchmarks.comparing.recorded_streams import unit
    from benchmarks.learning import plain_q_learning as plain

    sizes = np.unique(np.linspace(1, result.asked, at.fits).astype(int)).tolist()
    region: Any = at.rival
    judge, refitting, deciding = plain.Bootstrap(at.k, region), 0.0, 0.0
    some = unit(tail_sums(result.answers.d[:50]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for before, n in pairwise([0, *sizes]):
            judge.add(result.answers[before:n])
            gc.collect()
            start = process_time()
            judge.refit()
            between = process_time()
            for t in some:
                judge.settle(t)
            refitting, deciding = refitting + between - start, deciding + process_time() - between
    return refitting / len(sizes), deciding / len(sizes) / len(some), sizes
