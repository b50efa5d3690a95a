"""Subjects that a person can teach.

They are an MDP's scale, or the choice among the alternatives of a CSV file.
"""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elicit.asking.bags import Bags
from elicit.asking.choose_from_list import Choice, choose
from elicit.model.comparator import wrong_of
from elicit.model.outcomes import Status, assumed_of_answers
from elicit.model.scale import Floats
from elicit.person.asker import MakeAsker
from elicit.person.interview import Subject
from elicit.person.showing import Words
from qlearn.experiments.catalogue import COMPARATORS, PROBLEMS
from qlearn.experiments.factories import Own
from qlearn.learners.learner import Result
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import optimal_policy
from qlearn.problems.families.words import WORDS

_RANDOM = (30, 3, 5, 0.9)  # states, actions, levels, discount
_MOST_STATES = 12  # that are listed


@dataclass(frozen=True, eq=False)
class Taught:
    """A subject, how its asker is made, and the header of its log.

    ``make`` takes what was answered before.
    """

    subject: Subject
    make: MakeAsker
    header: dict[str, Any]


def taught_by(
    problem: str | Own, comparator: str, days: int, unit: str | None, seed: int, tolerance: float
) -> Taught:
    """Return the subject of a problem's name, a user's function, or the path of a CSV file.

    The names are "icu-sepsis" and "random". Raises ValueError, ImportError and OSError that say
    what is wrong with it.
    """
    if isinstance(problem, str) and problem.lower().endswith(".csv"):
        return _choice(Path(problem), comparator, days, unit, seed)
    mdp, words, legend = _mdp(problem, seed)
    words = words if unit is None else replace(words, unit=unit)
    header = _header(mdp.labels, mdp.fingerprint, words, discount=mdp.discount)

    def make(known: Any) -> InteractivePolicyIteration:
        knows = COMPARATORS[comparator].make(mdp.k, seed)
        return InteractivePolicyIteration(
            mdp, knows, tolerance=tolerance, bags=Bags(days=days), known=known, seed=seed
        )

    finer = f"For finer ones start again with --days {2 * days}: what you answered stays."
    report, stakes = (
        partial(_policy_report, mdp, tolerance, legend),
        partial(_policy_stakes, tolerance),
    )
    return Taught(Subject(mdp.labels, words, days, report, stakes, finer, seed), make, header)


def _header(labels: tuple[str, ...], fingerprint: str, words: Words, **more: Any) -> dict[str, Any]:
    return {"labels": list(labels), "unit": words.unit, "problem": fingerprint, **more}


def _mdp(problem: str | Own, seed: int) -> tuple[OrdinalMDP, Words, str]:
    """The MDP, how it speaks, and what its names of states and actions mean, in sentences."""
    if isinstance(problem, Own):
        made = problem.made(seed)
        parts = made if isinstance(made, tuple) and made else (made,)
        if not isinstance(parts[0], OrdinalMDP):
            raise ValueError(
                f"{problem.name!r}: the function, called with seed = {seed}, must return an "
                "OrdinalMDP, or a tuple "
                f"(mdp, elicit.Words), not {made!r}"
            )
        words = next((part for part in parts if isinstance(part, Words)), Words(title=problem.name))
        return parts[0], words, ""
    entry = PROBLEMS[problem]
    if entry.family is not None:
        return entry.family(seed), WORDS[problem], ""
    if entry.factory is None:
        mdp, _ = entry.instance(seed, _RANDOM)
        preamble = "Level 1 is the worst. There is no right or wrong answer."
        return mdp, Words(title="A random problem", preamble=preamble), ""
    preamble = (
        "The patients are alike at the start. Each is then in the condition shown, all for equally "
        "long. Mild to "
        "critical are sepsis in intensive care: SOFA scores up to about 4.7, 6.5, 8.6, and above. "
        "Choose the group you "
        "would rather see, as a whole. There is no right or wrong answer. For research on "
        "algorithms; not medical "
        "advice."
    )
    legend = (
        "A state is a cluster of similar patients; mild to critical are quarters of them, no "
        "clinical categories. "
        "Doses are those of 4 hours: 0 is none, and 1 to 4 are the lowest to the highest quarter "
        "of the doses given. "
        "All comes from a benchmark's tables: for research on algorithms; not medical advice."
    )
    return (
        entry.factory(),
        Words("patients", "fare", "ICU-Sepsis", preamble, "which is better off?"),
        legend,
    )


def _policy_report(mdp: OrdinalMDP, tolerance: float, legend: str, result: Result) -> list[str]:
    """Return sentences on what the policy can lose, and where it differs.

    It is compared with the policy of equal gaps between the levels.
    """
    bound = f"{_percent(result.loss_bound)} ({_sure(result)})"
    lines = [
        f"The plan learned falls short of your best plan by at most {bound}; "
        f"{_whole_way(mdp.labels)}."
    ]
    if result.status is Status.WAITING:
        lines.append("It is not finished: more could be asked.")
    elif result.status is Status.CONVERGED:
        lines += [
            f"It is finished: questions end at {100 * tolerance:g}%. What is still open about the "
            "levels "
            "matters less than that to the plan.",
            f"For a smaller shortfall start again with --tolerance {tolerance / 10:g}: what you "
            "answered stays.",
        ]
    elif result.status is Status.UNSURE:
        lines.append(
            "It is finished, but where you could not tell, two courses were taken for equally "
            "good: so this may be "
            f"more than the {100 * tolerance:g}% at which questions would end otherwise."
        )
    else:
        lines.append(f"It is {result.status.value}.")
    equal = optimal_policy(mdp, np.linspace(0.0, 1.0, mdp.k), result.policy)
    states = np.flatnonzero((equal != result.policy) & ~mdp.terminal).tolist()
    live = int(np.count_nonzero(~mdp.terminal))
    if not states:
        return [*lines, "It acts as if the steps between the levels were equal."]
    differs = (
        f"In {len(states)} of {live} states it acts otherwise than if the steps between the levels "
        "were equal."
    )
    lines.append(f"{differs} {legend}".strip())
    action = "action " if mdp.action_names is None else ""
    for s in states[:_MOST_STATES]:
        one, other = (mdp.action_name(int(actions[s])) for actions in (result.policy, equal))
        lines.append(f"  state {mdp.state_name(s)}: {action}{one}, not {other}")
    more = len(states) - _MOST_STATES
    return [*lines, f"  and {more} more"] if more > 0 else lines


def _whole_way(labels: tuple[str, ...]) -> str:
    """Return a phrase on the unit of a loss."""
    return f"100% is from all {labels[0]} to all {labels[-1]}"


def _policy_stakes(tolerance: float, result: Result) -> str | None:
    """Return a sentence on what the policy learned so far can lose."""
    if np.isnan(result.loss_bound):
        return None
    return (
        "The plan learned so far may fall short of your best plan by up to "
        f"{_percent(result.loss_bound)}; questions "
        f"end at {100 * tolerance:g}%."
    )


def _percent(share: float) -> str:
    """Rounded up, so that it still bounds."""
    return f"{max(0.0, np.ceil(share * 1e4 - 1e-9)) / 100:g}%"


def _sure(result: Result | Choice) -> str:
    """Return a phrase on how certain a bound is."""
    if result.confidence == 1.0:
        return assumed_of_answers(wrong_of(result.comparator), "your")
    return f"with {result.confidence:.0%} probability"


def _choice(path: Path, comparator: str, days: int, unit: str | None, seed: int) -> Taught:
    labels, names, vectors = read_alternatives(path)
    words = Words(
        unit or "outcomes", title=path.stem, preamble="There is no right or wrong answer."
    )
    content = json.dumps([labels, names, vectors.tolist()]).encode()
    header = _header(labels, hashlib.blake2b(content, digest_size=16).hexdigest(), words)

    # a tie, a loss and what may be rounded are shares of the value range
    shares = vectors / float(f"{vectors[0].sum():.12g}")

    def make(known: Any) -> Any:
        made = COMPARATORS[comparator].make(len(labels), seed)
        return choose(shares, made, names=names, labels=labels, known=known)

    report, stakes = partial(_choice_report, labels), partial(_choice_stakes, labels)
    finer = (
        f"Round the numbers in {path.name} to counts of the same total, and start with a new log."
    )
    return Taught(Subject(labels, words, days, report, stakes, finer, seed), make, header)


def _choice_report(labels: tuple[str, ...], result: Choice) -> list[str]:
    bound = f"{_percent(result.loss_bound)} ({_sure(result)})"
    finished = result.status is not Status.WAITING
    status = result.status.sentence if finished else "Not finished: more could be asked."
    return [
        f"Your choice: {result.name}.",
        status,
        f"No other is better by more than {bound}; {_whole_way(labels)}.",
    ]


def _choice_stakes(labels: tuple[str, ...], result: Choice) -> str | None:
    """Return a sentence on what the choice can lose."""
    if np.isnan(result.loss_bound):
        return None
    most = _percent(result.loss_bound)
    return (
        f"The best guess so far is not certain: another one may be better by up to {most}; "
        f"{_whole_way(labels)}."
    )


def read_alternatives(path: Path) -> tuple[tuple[str, ...], list[str], Floats]:
    """Return labels (k), names (n) and vectors (n, k) of the alternatives in a CSV file.

    The header has any word over the names, and the k labels, worst first; each row has a name and
    its numbers. Raises ValueError that names the line, also if the totals differ or a number is
    below 0; OSError.
    """
    with open(path, encoding="utf-8-sig", newline="") as text:
        try:
            rows = [(n, cells) for n, cells in _rows(csv.reader(text, strict=True)) if any(cells)]
        except csv.Error as error:
            raise ValueError(f"{path} is no CSV: {error}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path} is not in UTF-8 ({error}): save it as such") from None
    header = rows[0][1] if rows else []
    if len(header) < 3 or not all(header[1:]):
        raise ValueError(
            f"the first line of {path} must name a column of names and then at least two levels, "
            "worst first, such as "
            f"name,died,ill,well; it is {','.join(header)!r}"
        )
    twice = next((label for i, label in enumerate(header) if i and label in header[1:i]), None)
    if twice is not None:
        raise ValueError(
            f"the first line of {path} names the level {twice!r} twice: give each its own name"
        )
    if len(rows) < 2:
        raise ValueError(
            f"{path} names levels, but no alternative to choose from: add a line for each"
        )
    vectors = []
    for number, cells in rows[1:]:
        where = f"line {number} of {path}"
        if len(cells) != len(header):
            raise ValueError(f"{where} has {len(cells)} cells, but the header has {len(header)}")
        vectors.append([_number(cell, where) for cell in cells[1:]])
        total, first = sum(vectors[-1]), sum(vectors[0])
        if not first > 0 or abs(total - first) > 1e-9 * first:
            raise ValueError(
                f"{where} has the total {total:g}, and the first alternative {first:g}: give all "
                "the same total, above "
                "0, such as shares of 1, or counts of the same number of people"
            )
    return tuple(header[1:]), [cells[0] for _, cells in rows[1:]], np.array(vectors)


def _rows(reader: Any) -> Iterator[tuple[int, list[str]]]:
    """The number of each line, and its cells."""
    for cells in reader:
        yield reader.line_num, [cell.strip() for cell in cells]


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not 0 <= value < float("inf"):
        raise ValueError(f"{where}: {cell!r} is no number of at least 0")
    return value
