"""Solve an MDP in one call, with a comparator and a learner by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from elicit._support.hashing import Seed
from elicit._support.keywords import naming_nearest
from elicit._support.seeds import seed_of
from elicit.comparators.panel import Panel
from elicit.model.comparator import Comparator
from elicit.model.tutor import check_tutor_made
from elicit.tutors.answer_log import AnswerLog
from elicit.tutors.panel import as_one_tutor
from qlearn.experiments.catalogue import COMPARATORS, LEARNERS
from qlearn.learners.driving import Tutors, drive
from qlearn.learners.learner import Result, check_problem
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.panel.asking_for_the_worst_off import WorstOffIteration


@naming_nearest
def solve(
    mdp: OrdinalMDP,
    tutor: Tutors,
    comparator: str | Comparator = "posterior",
    tolerance: float = 0.01,
    seed: Seed | None = None,
    *,
    learner: str = "policy-iteration",
    max_queries: int | None = None,
    log: AnswerLog | None = None,
    progress: Callable[[Result], None] | None = None,
) -> Result:
    """Find a good policy for an MDP by asking a tutor.

    Parameters
    ----------
    mdp
        The problem, whose rewards are levels of an ordinal scale.
    tutor
        Any function from a ``Query`` to an ``Answer``, or to a verdict on the query's left vector:
        a ``Verdict``, or 1, 0, -1. To say "cannot tell", return ``Answer(query, None)``. For an
        ``elicit.Panel``, the tutor of each person by name: ``{"ann": tutor, "ben": another}``.
    comparator
        Decides comparisons from the answers so far. ``"posterior"`` is for a tutor who may err.
        ``"polytope"`` is for a tutor who never errs: its verdicts are proven. ``"ensemble"``,
        ``"box-rescaled"`` and ``"box"`` are the paper's fits; ``elicit.catalogue`` has all names. A
        ``Comparator`` for ``mdp.k`` levels is used as it is, such as
        ``elicit.PosteriorComparator(mdp.k, like=logs)``, with a prior of earlier people. An
        ``elicit.Panel`` of several members with ``aim="worst"`` gives a ``WorstOffResult``, by
        ``WorstOffIteration``.
    tolerance
        Largest acceptable loss of the policy, a share of the value range: see
        ``Result.loss_bound``. Q-learning ignores it.
    seed
        An int, a NumPy ``SeedSequence`` or a ``Generator``. The same int gives the same run.
        ``None`` draws a new seed. A comparator that is given as an object keeps its own.
    learner
        ``"policy-iteration"`` asks the fewest questions. ``"value-iteration"`` and ``"q-learning"``
        run with their default settings.
    max_queries
        Largest number of questions. Comparisons still open after it follow the best guess at the
        scale, and the result's status says so. ``None``: no limit. ``expected_bounds`` tells what a
        number of questions is likely to prove.
    log
        Receives every answer before the learner does. Answers that it already holds are used, and
        not asked again.
    progress
        Called with the result so far after every round of questions.

    Returns
    -------
    Result
        The policy, a bound on its loss, and the number of questions. ``print(result)`` says it in
        words.

    Raises
    ------
    TypeError
        If ``mdp`` is no ``OrdinalMDP``, ``tutor`` cannot be called, or ``tutor`` returns neither an
        answer nor a verdict.
    ValueError
        If a name is unknown, a number is out of range, or the comparator or the tutor is for
        another number of levels than the MDP has.
    InconsistentAnswers
        If no scale agrees with the answers. Only the polytope raises it. ``"posterior"`` allows for
        errors.

    Notes
    -----
    With an int as the seed this is the same run as

        comparator = elicit.PosteriorComparator(mdp.k, seed=seed)
        learner = qlearn.InteractivePolicyIteration(mdp, comparator, tolerance=tolerance, seed=seed)
        result = qlearn.drive(learner, tutor, seed=seed)
    """
    _check_mdp(mdp)
    key = seed_of(seed)
    knows = _named(comparator, key, mdp.k)
    tutor = as_one_tutor(tutor, knows)
    check_tutor_made(tutor, mdp.k)
    check_problem(mdp, knows)
    if not isinstance(learner, str) or learner not in LEARNERS:
        raise ValueError(f"learner must be one of {_listed(LEARNERS)}, not {learner!r}")
    if log is not None and not isinstance(log, AnswerLog):
        raise TypeError(
            "log must be None or an elicit.AnswerLog, such as AnswerLog('answers.jsonl'), not "
            f"{log!r}"
        )
    if isinstance(knows, Panel) and knows.aim == "worst" and len(knows.people) > 1:
        if learner != "policy-iteration":
            raise ValueError(
                f"learner must be 'policy-iteration' for a panel with aim='worst', not {learner!r}"
            )
        earlier: Any = () if log is None else log
        worst = WorstOffIteration(
            mdp, knows, tolerance=tolerance, seed=key, max_queries=max_queries, known=earlier
        )
        return drive(worst, tutor, log, progress, seed=key)
    chosen = LEARNERS[learner]
    settings: dict[str, Any] = {"tolerance": tolerance} if chosen.has_tolerance else {}
    known: Any = () if log is None else log
    run = chosen.factory(mdp, knows, seed=key, max_queries=max_queries, known=known, **settings)
    return drive(run, tutor, log, progress, seed=key)


def _check_mdp(mdp: object) -> None:
    if not isinstance(mdp, OrdinalMDP):
        pair = isinstance(mdp, tuple) and any(isinstance(part, OrdinalMDP) for part in mdp)
        advice = ": it holds one, write mdp, values = ..." if pair else ""
        raise TypeError(f"mdp must be a qlearn.OrdinalMDP, not a {type(mdp).__name__}{advice}")


def _named(comparator: str | Comparator, seed: Seed, k: int) -> Comparator:
    if not isinstance(comparator, str):
        return comparator
    if comparator not in COMPARATORS:
        raise ValueError(
            f"comparator must be one of {_listed(COMPARATORS)}, or a Comparator, not {comparator!r}"
        )
    return COMPARATORS[comparator].make(k, seed)


def _listed(names: Mapping[str, object]) -> str:
    return ", ".join(map(repr, names))
