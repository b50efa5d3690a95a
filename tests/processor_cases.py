"""Questions of learners, by value, in runs that a last bit could change.

They have symmetric grids, ties, audits, batches and errors.

``python -m tests.processor_cases`` writes the record anew, after a change that is meant to change
the questions.
"""

import hashlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import elicit
import qlearn
from elicit.model.pairs import pair_numbers, whole_numbers
from tests.scale_arithmetic import tail_sums

RECORD = Path(__file__).parent / "asked_on_every_processor.txt"
"""The lines of ``report``, which every processor must give."""


def grid(side: int, k: int, seed: int) -> qlearn.OrdinalMDP:
    """A deterministic grid with a level in each cell: many states mirror each other."""
    cells = np.random.default_rng(seed).integers(0, k, (side, side))
    x, y = np.divmod(np.arange(side * side), side)
    steps = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    ends = [np.clip(x + dx, 0, side - 1) * side + np.clip(y + dy, 0, side - 1) for dx, dy in steps]
    levels = np.repeat(cells.reshape(-1, 1), 4, axis=1)
    shape = (side * side, 4, 1)
    return qlearn.OrdinalMDP(
        np.stack(ends, 1)[:, :, None], np.ones(shape), levels, 0.95, [f"{i}" for i in range(k)]
    )


class Run(NamedTuple):
    """A learner to be made, with what it may know at first, and the tutor whom it asks."""

    name: str
    make: Callable[..., Any]
    tutor: Any


def runs() -> Iterator[Run]:
    """Runs of all learners."""
    planner = qlearn.InteractivePolicyIteration
    for k, states in ((5, 40), (10, 40), (15, 25)):
        mdp, values = qlearn.random_mdp(states, 4, k, seed=k)
        exact = partial(planner, mdp, elicit.PolytopeComparator(k), tolerance=0.002)
        yield Run(f"polytope {k}", exact, elicit.TruthfulTutor(values))
        likely = partial(planner, mdp, elicit.PosteriorComparator(k, seed=1), tolerance=0.01)
        yield Run(f"posterior {k}", likely, elicit.FlippingTutor(values, 0.1, seed=2))
    values = np.array([0.0, 0.1, 0.35, 0.5, 0.9, 1.0])
    for name, settings in (("", {}), (", batches", {"batch": 3}), (", audits", {"audit": 0.3})):
        for tie in (0.0, 0.01):
            known = elicit.PolytopeComparator(6, tie=tie)
            make = partial(planner, grid(6, 6, 2), known, tolerance=5e-4, **settings)
            yield Run(f"grid, tie {tie:g}{name}", make, elicit.TruthfulTutor(values, tie=tie))
    mdp, values = qlearn.random_mdp(15, 3, 5, seed=1)
    posterior = elicit.PosteriorComparator(5, seed=1)
    sweeps = partial(
        qlearn.InteractiveValueIteration, mdp, posterior, tolerance=0.01, max_queries=20
    )
    yield Run("value iteration", sweeps, elicit.BradleyTerryTutor(values, 40.0, seed=3))
    steps = partial(qlearn.InteractiveQLearning, mdp, posterior, steps=1500, max_queries=20)
    yield Run("Q-learning", steps, elicit.FlippingTutor(values, 0.1, seed=3))


def answered(learner: Any, tutor: Any) -> list[elicit.Answer]:
    """All answers to what the learner asks, in order."""
    answers: list[elicit.Answer] = []
    while queries := learner.ask():
        new = [tutor(query) for query in queries]
        learner.tell(new)
        answers += new
    return answers


def report() -> list[str]:
    """Return one line a run."""
    return [line_of(run) for run in runs()]


def line_of(run: Run) -> str:
    """Return the number of questions, the status, how many were asked again, and a hash of all
    questions by value, of the answers and of the policy."""
    learner = run.make()
    answers = answered(learner, run.tutor)
    result, d = learner.result(), np.array([answer.query.d for answer in answers])
    grains = np.array([whole_numbers(t)[0] for t in tail_sums(d)])
    said = np.array([answer.verdict for answer in answers], dtype=np.int8)
    digest = hashlib.blake2b(
        grains.tobytes() + said.tobytes() + result.policy.tobytes(), digest_size=8
    ).hexdigest()
    again = len(d) - len(np.unique(pair_numbers(d)))
    return f"{run.name}: {result.asked} {result.status.name}, {again} again, {digest}"


def resumed(run: Run) -> tuple[list[elicit.Answer], list[elicit.Answer]]:
    """The second half of a run's answers, undisturbed, and of a run that is begun anew with the
    first half known.
    """
    whole = answered(run.make(), run.tutor)
    half = len(whole) // 2
    return whole[half:], answered(run.make(known=whole[:half]), elicit.ReplayTutor(whole))


def planned() -> Iterator[Run]:
    """Twelve runs of policy iteration, half of them with a tutor who errs."""
    for seed in range(6):
        k = 4 + seed
        mdp, values = qlearn.random_mdp(30, 4, k, seed=seed)
        make = partial(qlearn.InteractivePolicyIteration, mdp)
        exact = partial(make, elicit.PolytopeComparator(k), tolerance=5e-4)
        yield Run(f"polytope {k}", exact, elicit.TruthfulTutor(values))
        likely = partial(make, elicit.PosteriorComparator(k, seed=seed), tolerance=0.01)
        yield Run(f"posterior {k}", likely, elicit.FlippingTutor(values, 0.1, seed=seed))


def half_done(folder: Path) -> list[list[str]]:
    """Keep the first half of each planned run's answers in a log; return all its questions."""
    asked = []
    for number, run in enumerate(planned()):
        whole = answered(run.make(), run.tutor)
        for name, answers in (("whole", whole), ("half", whole[: len(whole) // 2])):
            with elicit.AnswerLog(folder / f"{name}-{number}.jsonl") as log:
                for answer in answers:
                    log.append(answer)
        asked.append(by_value(whole))
    return asked


def resumed_from(folder: Path) -> list[str]:
    """Return the questions of runs that go on from the logs of ``half_done``, a line a run."""
    lines = []
    for number, run in enumerate(planned()):
        known = elicit.AnswerLog.read(folder / f"half-{number}.jsonl")
        tutor = elicit.ReplayTutor(elicit.AnswerLog.read(folder / f"whole-{number}.jsonl"))
        lines.append(" ".join(by_value(answered(run.make(known=known), tutor))))
    return lines


def by_value(answers: list[elicit.Answer]) -> list[str]:
    """Return the number of each question's pair, which pairs within 1e-9 share."""
    numbers = [whole_numbers(tail_sums(answer.query.d[None])[0]) for answer in answers]
    return [hashlib.blake2b(grains.tobytes(), digest_size=8).hexdigest() for grains, *_ in numbers]


if __name__ == "__main__":
    RECORD.write_text("\n".join(report()) + "\n", encoding="utf-8")
