"""Agreement of several people: their scales, the questions that divide them, and groups.

People who differ should talk before a policy is made for all of them. The questions that divide
them most are a place to start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit._support.validation import is_list, is_number, is_whole, require
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.panel import Panel
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess, draws_in
from elicit.model.difference import tail_sums
from elicit.model.query import Answers
from elicit.model.scale import Floats
from elicit.tutors.answer_log import AnswerLog

KNOWN = 0.9  # probability from which on it counts as known which side a person prefers
_SHARES = (0.25, 0.5, 0.75)  # of the better level, in the mixtures that questions are about
_COARSE = 6  # digits to which scores are compared

FromPeople: TypeAlias = (
    Panel | Answers | Sequence[AnswerLog] | Mapping[str, AnswerLog] | Mapping[str, Answers]
)
"""A panel, answers that say who gave them, or logs: a log for each person, perhaps by name."""


@dataclass(frozen=True, eq=False)
class DividingQuestion:
    """A question on which people differ: a level for sure, or a mixture of a better and a worse.

    Attributes
    ----------
    left, right : (k,) shares
        The level, and the mixture.
    text : str
        The question in words.
    prefers_left : mapping of str to float
        Probability that a person prefers the level for sure.
    disagreement : float
        Probability that two of the people, drawn at random, prefer different sides.
    """

    left: Floats
    right: Floats
    text: str
    prefers_left: Mapping[str, float]
    disagreement: float

    def __str__(self) -> str:
        said = ", ".join(f"{who} {100 * p:.0f}%" for who, p in self.prefers_left.items())
        return f"{self.text} (prefers the first: {said})"


@dataclass(frozen=True, eq=False)
class Agreement:
    """A report on how far several people agree. ``print`` shows it in words.

    Attributes
    ----------
    people : tuple of str
        The n people.
    labels : tuple of str
        The k levels, worst first.
    values, low, high : (n, k)
        Best guess and interval of each level's value, from 0 to 1, by each person's comparator.
    questions : tuple of DividingQuestion
        The questions that divide the people most, the most dividing first.
    known_to_differ : (n, n)
        For each two people, the share of all questions considered in which they are known to prefer
        different sides.
    groups : tuple of tuple of str
        People who think alike, the largest group first.
    apart : float
        Two groups stay separate if the mean of ``known_to_differ`` between them is at least this.
    """

    people: tuple[str, ...]
    labels: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    questions: tuple[DividingQuestion, ...]
    known_to_differ: Floats
    groups: tuple[tuple[str, ...], ...]
    apart: float

    def __str__(self) -> str:
        """Return the scales, the questions that divide, and the groups, for people to read."""
        cells = [
            [
                f"{100 * v:.0f} ({100 * lo:.0f} to {100 * hi:.0f})"
                for v, lo, hi in zip(
                    self.values[:, j], self.low[:, j], self.high[:, j], strict=True
                )
            ]
            for j in range(len(self.labels))
        ]
        rows = [["", *self.people]]
        rows += [[name, *row] for name, row in zip(self.labels, cells, strict=True)][::-1]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["Value of each level, from 0 (the worst) to 100 (the best), with its interval:"]
        lines += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        ]
        lines += ["", "Questions that divide these people most:"]
        lines += [f"{i}. {question}" for i, question in enumerate(self.questions, 1)]
        if not self.questions:
            lines.append("none: there are too few levels, or too few people.")
        return "\n".join([*lines, "", *self._groups_in_words()])

    def _groups_in_words(self) -> list[str]:
        rule = (
            f"Two groups are kept apart if their members are known to differ in {self.apart:.0%} "
            "of the questions or more, in the mean over pairs of them."
        )
        if len(self.groups) == 1:
            return ["The answers show no groups of people who think differently.", rule]
        said = "; ".join(", ".join(group) for group in self.groups)
        return [f"The answers show {len(self.groups)} groups: {said}.", rule]


@one_thread
def agreement(
    people: FromPeople,
    labels: Sequence[str] | None = None,
    *,
    most: int = 5,
    apart: float = 0.1,
    make: Callable[[int], Comparator] | None = None,
) -> Agreement:
    """Return how far several people agree on the values of the levels.

    Parameters
    ----------
    people : Panel, Answers, or logs
        Answers must say who gave them. Logs come in a sequence, a log for each person, named by
        ``AnswerLog(..., who=)``, or in a mapping from names.
    labels : sequence of k str, optional
        Names of the levels, worst first.
    most : int
        Largest number of dividing questions.
    apart : float
        Two groups of people are joined unless their members are known to differ in this share of
        the questions, in 0..1, on average over pairs of members (average linkage). Two people are
        known to differ in a question if that has a probability of at least 90%.
    make : function of k, optional
        Makes the comparator that learns a person's answers. Default: a ``PosteriorComparator``. A
        panel has its own.

    Returns
    -------
    Agreement

    Raises
    ------
    TypeError
        If ``people`` is none of these.
    ValueError
        If answers or logs do not say whose they are, there are none, or a setting is out of range.

    Notes
    -----
    The questions compare a level for sure with mixtures of a better and a worse one. The better one
    has a share of a quarter, half or three quarters. A person's preferences come from the draws of
    their comparator, or from its best guess if it has no draws.
    """
    require(is_whole(most, 0), "most, the number of questions,", "a whole number from 0 on", most)
    require(is_number(apart, 0, 1), "apart, a share of the questions,", "in 0..1", apart)
    panel = people if isinstance(people, Panel) else _panel_of(people, make)
    k = panel.k
    require(labels is None or is_list(labels, k), "labels", f"None or {k} names", labels)
    names = tuple(labels) if labels is not None else tuple(f"level {j + 1}" for j in range(k))
    units = np.eye(k) - np.eye(k)[0]
    each = [member.bounds(units) for member in panel.members.values()]
    left, right = _mixtures(k)
    chance = np.stack([_prefers(member, left - right) for member in panel.members.values()])
    differ = _known_to_differ(chance)
    return Agreement(
        panel.people,
        names,
        np.stack([best_guess(member) for member in panel.members.values()]),
        np.stack([low for low, _ in each]),
        np.stack([high for _, high in each]),
        _dividing(panel.people, names, left, right, chance, most),
        differ,
        _groups(panel.people, differ, apart),
        float(apart),
    )


def _panel_of(people: FromPeople, make: Callable[[int], Comparator] | None) -> Panel:
    """Return a panel that has learned these answers. Raises TypeError and ValueError."""
    if isinstance(people, Answers):
        if None in people.who or not len(people):
            raise ValueError(
                "agreement needs answers that say who gave them: Answers(..., who=), or one log "
                "for each person"
            )
        told = {str(name): people.of_person(name) for name in dict.fromkeys(people.who)}
    elif isinstance(people, Mapping):
        told = {name: _of_one(name, log) for name, log in people.items()}
    elif isinstance(people, Sequence) and all(isinstance(log, AnswerLog) for log in people):
        told = {}
        for log in people:
            named = {entry.answer.who for entry in log if entry.used} | {log.who} - {None}
            if len(named) != 1 or None in named:
                raise ValueError(
                    f"{log!r} does not say whose its answers are, or is of several people: give "
                    "agreement a mapping of names to logs, or log.answers() of one log of several"
                )
            (who,) = named
            if who in told:
                raise ValueError(f"two logs are of {who!r}: merge them, or give other names")
            told[str(who)] = log.answers()
    else:
        raise TypeError(
            f"agreement takes an elicit.Panel, Answers with who, or logs of answers, not {people!r}"
        )
    if not told:
        raise ValueError("agreement needs the answers of at least one person")
    makes = make or (lambda k: PosteriorComparator(k, seed=0))
    return Panel({name: makes(answers.k).update(answers) for name, answers in told.items()})


def _of_one(name: str, log: AnswerLog | Answers) -> Answers:
    """Return one person's answers. Raises TypeError and ValueError."""
    if not isinstance(log, AnswerLog | Answers):
        raise TypeError(f"agreement takes an AnswerLog or Answers of {name!r}, not {log!r}")
    answers = log if isinstance(log, Answers) else log.answers()
    whose = [*dict.fromkeys(answers.who)]
    if len(whose) > 1:
        raise ValueError(
            f"the answers of {name!r} are of several people, {', '.join(map(repr, whose))}: give "
            "agreement the answers of each by name (Answers.of_person), or all in one, as Answers"
        )
    return answers


def _mixtures(k: int) -> tuple[Floats, Floats]:
    """Return pairs (n, k) each: a level for sure, and a mixture of a better and a worse level."""
    triples = [
        (low, middle, high, share)
        for low, middle, high in combinations(range(k), 3)
        for share in _SHARES
    ]
    left, right = np.zeros((len(triples), k)), np.zeros((len(triples), k))
    for i, (low, middle, high, share) in enumerate(triples):
        left[i, middle] = 1.0
        right[i, high], right[i, low] = share, 1.0 - share
    return left, right


def _prefers(member: Comparator, d: Floats) -> Floats:
    """Return the probability (n,) that d.e > 0 for one person, by draws or else the best guess."""
    draws = draws_in(member)
    tails = tail_sums(d)
    if draws is None:
        at = np.round(product(tails, np.diff(best_guess(member))), 9)
        return np.asarray(0.5 + 0.5 * np.sign(at))
    at = product(tails, draws[0])
    above = product((at > 0).astype(float), draws[1])
    return np.asarray(np.clip(above + 0.5 * product((at == 0).astype(float), draws[1]), 0.0, 1.0))


def _known_to_differ(chance: Floats) -> Floats:
    """Return for each two of m people the share of questions in which they are known to differ.

    ``chance`` (m, n) are their probabilities of preferring left.
    """
    side = np.where(chance >= KNOWN, 1, np.where(chance <= 1.0 - KNOWN, -1, 0))
    if not side.shape[1]:
        return np.zeros((len(side), len(side)))
    return np.asarray((side[:, None] * side[None] == -1).mean(axis=2))


def _dividing(
    people: Sequence[str],
    names: Sequence[str],
    left: Floats,
    right: Floats,
    chance: Floats,
    most: int,
) -> tuple[DividingQuestion, ...]:
    """Return the questions on which two people drawn at random differ with most probability.

    No two of them offer the same level for sure, so that they are not nearly the same.
    """
    n = len(people)
    if n < 2:
        return ()
    total, square = chance.sum(axis=0), (chance * chance).sum(axis=0)
    # two people with probabilities p and q disagree with p (1 - q) + q (1 - p)
    differ = 2.0 * ((n - 1) * total - (total * total - square)) / (n * (n - 1))
    order = np.argsort(-np.round(differ, _COARSE), kind="stable")
    found: list[DividingQuestion] = []
    taken: set[int] = set()
    for i in order:
        level = int(left[i].argmax())
        if len(found) == most:
            break
        if level in taken:
            continue
        taken.add(level)
        worse, better = np.flatnonzero(right[i]).tolist()
        text = (
            f"“{names[level]}” for sure, or {100 * right[i, better]:.0f}% “{names[better]}” and "
            f"{100 * right[i, worse]:.0f}% “{names[worse]}”?"
        )
        prefers = dict(zip(people, chance[:, i].tolist(), strict=True))
        found.append(DividingQuestion(left[i], right[i], text, prefers, float(differ[i])))
    return tuple(found)


def _groups(
    people: Sequence[str], differ: NDArray[np.float64], apart: float
) -> tuple[tuple[str, ...], ...]:
    """Return groups of people by average linkage: groups that differ by ``apart`` stay separate."""
    if len(people) == 1:
        return (tuple(people),)
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    tree = linkage(squareform(np.round(differ, 9), checks=False), method="average")
    number = fcluster(tree, np.nextafter(apart, -1.0), criterion="distance")
    groups = [
        tuple(name for name, own in zip(people, number, strict=True) if own == group)
        for group in dict.fromkeys(number.tolist())
    ]
    return tuple(sorted(groups, key=lambda group: -len(group)))
