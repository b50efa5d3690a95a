"""Subjects that a person can teach: an MDP's scale, or a choice among a CSV file's alternatives."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from elicit.asking.bags import Bags
from elicit.asking.choose_from_list import choose
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.comparators.panel import Panel
from elicit.model.comparator import Comparator, offers
from elicit.model.scale import Floats
from elicit.person.asker import MakeAsker
from elicit.person.course.conclusion import SessionFacts, in_plural, per_hundred
from elicit.person.interview import Subject
from elicit.person.showing import Words
from elicit.tutors.answer_log import AnswerLog
from qlearn.cli.conclusions.choice import (
    choice_conclusion,
    choice_holds,
    choice_nearly,
    choice_stakes,
    offered_table,
)
from qlearn.cli.conclusions.decided_plan import DecidedPlans
from qlearn.cli.conclusions.icu import (
    ICU_DURATION,
    ICU_LEGEND,
    icu_caveat,
    icu_dose,
    icu_states,
    icu_valuation,
)
from qlearn.cli.conclusions.in_words import InWords
from qlearn.cli.conclusions.plan import (
    policy_conclusion,
    policy_holds,
    policy_nearly,
    policy_stakes,
    valuation,
)
from qlearn.experiments.catalogue import COMPARATORS, PROBLEMS
from qlearn.experiments.own_parts import Own
from qlearn.learners.expected_bounds import expected_bounds
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.panel.following import Following, cost_of_following, cost_of_following_a_choice
from qlearn.problems.families.words import WORDS

_SESSIONS = {"polytope": 12, "posterior": 4}  # simulated; one takes about 1 s, and 8 to 25 s
_RANDOM = (30, 3, 5, 0.9)  # states, actions, levels, discount
_KINDS = {
    "posterior": " (a Bayesian model, by which some answers are mistakes)",
    "polytope": " (takes every answer for right)",
}
_LEARNS = "It works out how good each level is to you."
_EQUAL_STEPS = (
    "Your plan is compared with the plan for equal steps: each level is then better than the one "
    "below it by the same amount."
)
_NAMED = 6  # alternatives up to which the welcome names them
_NO_NOUNS = ("name", "label", "title", "row", "index", "column", "description", "text")


@dataclass(frozen=True, eq=False)
class Taught:
    """A subject that a person can teach.

    Attributes
    ----------
    subject : Subject
    make : MakeAsker
        Makes the asker from the answers that it is to know.
    header : dict
        The fields that the header of the log must have.
    hint : str
        A sentence to the person who runs the program on what the problem lacks, or "".
    plan : function or None
        Takes the comparator and a number of questions, and says what these are likely to prove.
        None if that cannot be said.
    following : function or None
        Takes a panel, and returns the losses from following one another. None if these cannot be
        computed.
    """

    subject: Subject
    make: MakeAsker
    header: dict[str, Any]
    hint: str = ""
    plan: Callable[[Comparator, int], str] | None = None
    following: Callable[[Panel], Following] | None = None


def taught_again(recipe: Mapping[str, Any]) -> Taught:
    """Return the subject of a recipe: the settings that ``qlearn teach`` keeps in a log's header.

    Settings that the recipe leaves out have the defaults of ``qlearn teach``.
    """
    comparator = recipe.get("comparator", "posterior")
    return taught_by(
        recipe["problem"],
        comparator,
        recipe.get("days", 10),
        recipe.get("unit"),
        recipe.get("seed", 0),
        recipe.get("tolerance", 0.01),
        recipe.get("like", ()) if comparator == "posterior" else (),
    )


def taught_by(
    problem: str | Own,
    comparator: str,
    days: int,
    unit: str | None,
    seed: int,
    tolerance: float,
    like: Sequence[str] = (),
) -> Taught:
    """Return the subject for a problem's name, a user's function, or the path of a CSV file.

    The names are those of ``qlearn.experiments.catalogue.PROBLEMS``. ``like`` are the paths of
    earlier people's logs. Raises ValueError, ImportError and OSError that say what is wrong.
    """
    if isinstance(problem, str) and problem.lower().endswith(".csv"):
        return _choice(Path(problem), comparator, days, unit, seed, tolerance, like)
    mdp, words, legend = _mdp(problem, seed)
    words = words if unit is None else replace(words, unit=unit)
    words = replace(words, purpose=f"{words.purpose or _LEARNS} {_EQUAL_STEPS}")
    header = _header(mdp.labels, mdp.fingerprint, words, discount=mdp.discount)
    comparator_now = _comparator_maker(comparator, mdp.labels, seed, like)

    def make(known: Any) -> InteractivePolicyIteration:
        return InteractivePolicyIteration(
            mdp, comparator_now(), tolerance=tolerance, bags=Bags(days=days), known=known, seed=seed
        )

    finer = f"For finer ones start again with --days {2 * days}: what you answered stays."
    names = icu_dose if problem == "icu-sepsis" else mdp.action_name
    told, valued = InWords(mdp.labels, words, tolerance, legend=legend), valuation(mdp)
    if problem == "icu-sepsis":
        told = replace(
            told,
            states="patient states",
            plan="treatment",
            state_words=icu_states(mdp),
            caveat=icu_caveat,
        )
        valued = icu_valuation(mdp)
    plans = DecidedPlans(mdp, tolerance)
    subject = Subject(
        mdp.labels,
        words,
        days,
        stakes=partial(policy_stakes, told),
        finer=finer,
        seed=seed,
        conclude=partial(policy_conclusion, told, plans, names),
        facts=_facts(
            problem,
            header,
            comparator,
            seed,
            ("Tolerance", per_hundred(tolerance)),
            like=like,
            valued=valued,
        ),
        enough=partial(policy_holds, told, plans),
        enough_is_slow=True,
        nearly=partial(policy_nearly, told, plans),
        source=words.source_sentence,
    )

    def plan(known: Comparator, questions: int) -> str:
        runs = _SESSIONS["posterior" if offers(known, "level") else "polytope"]
        how: dict[str, Any] = {"tolerance": tolerance, "bags": Bags(days=days)}
        return str(expected_bounds(mdp, known, questions, runs=runs, seed=seed, **how))

    return Taught(subject, make, header, plan=plan, following=partial(cost_of_following, mdp))


def _comparator_maker(
    comparator: str, labels: tuple[str, ...], seed: int, like: Sequence[str]
) -> Callable[[], Comparator]:
    """Return a function that makes the comparator before any answer.

    The prior from earlier people's logs is learned once, in this call.

    Raises
    ------
    ValueError
        If there is no such comparator, if it learns nothing from earlier people, or a log is empty,
        of other levels or of several people.
    OSError
        If a log cannot be read.
    """
    if comparator not in COMPARATORS:
        raise ValueError(
            f"there is no comparator {comparator!r}: give --comparator posterior, or "
            "--comparator polytope-1-wrong if at most one answer is wrong"
        )
    if not like:
        return partial(COMPARATORS[comparator].make, len(labels), seed)
    if comparator != "posterior":
        raise ValueError(
            f"--like is for --comparator posterior: {comparator} learns nothing from earlier people"
        )
    told = {}
    for path in like:
        log = AnswerLog.read(path)
        if not log.standing:
            raise ValueError(f"{path} holds no answers to learn from: leave it out of --like")
        theirs = log.header.get("labels")
        if theirs != list(labels):
            raise ValueError(
                f"{path} is about the levels {theirs}, not {list(labels)}: --like takes logs about "
                "the same levels"
            )
        told[path] = log
    earlier = PosteriorComparator(len(labels), seed=seed, like=told).like
    return partial(PosteriorComparator, len(labels), seed=seed, like=earlier)


def _facts(
    problem: str | Own,
    header: dict[str, Any],
    comparator: str,
    seed: int,
    *more: tuple[str, str],
    like: Sequence[str] = (),
    valued: str = "",
) -> SessionFacts:
    """Return the facts that a report names. ``valued`` says how a plan is valued."""
    name = problem if isinstance(problem, str) else problem.name
    if name.lower().endswith(".csv"):
        name = Path(name).name
    assumed = {
        "polytope": "It assumes that every answer you gave is right. One wrong answer can make it "
        "wrong.",
        "posterior": "The 95% allows for mistakes. It is an average over many possible people: for "
        "one person it may be more or less.",
    }
    limits = [assumed[comparator]] if comparator in assumed else []
    limits.append("Only the outcomes that were shown are compared, and nothing else about them.")
    if valued:
        limits.append(valued)
    if name == "icu-sepsis":
        limits.append(
            "“If patients died instead of recovering” gives lost value a size that is easy to "
            "picture. It is not a forecast."
        )
    if like:
        people = f"{len(like)} earlier {'person' if len(like) == 1 else 'people'}"
        more = (
            *more,
            ("Prior", f"learned from {people}: {', '.join(Path(one).name for one in like)}"),
        )
    of = (
        ("Problem", f"{name} ({header['problem'][:12]})"),
        ("Comparator", f"{comparator}{_KINDS.get(comparator, '')}"),
        *more,
        ("Seed", f"{seed}"),
    )
    return SessionFacts(of, tuple(limits))


def _header(labels: tuple[str, ...], fingerprint: str, words: Words, **more: Any) -> dict[str, Any]:
    return {"labels": list(labels), "unit": words.unit, "problem": fingerprint, **more}


def _mdp(problem: str | Own, seed: int) -> tuple[OrdinalMDP, Words, str]:
    """Return an MDP, its words, and what its names of states and actions mean, in sentences."""
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
        preamble = "Level 1 is the worst."
        return mdp, Words(title="A random problem", preamble=preamble), ""
    preamble = (
        "The patients are alike at the start. Judge each group as a whole, by these 30 days alone: "
        "the years that a death costs are left out. The SOFA score measures organ failure from 0 "
        "to 24, and higher is worse. In the records the patients fall into "
        "713 groups of similar ones. The four middle conditions are quarters of these groups, by "
        "their mean SOFA score, and not clinical categories."
    )
    words = Words(
        "patients",
        "fare",
        "ICU-Sepsis",
        preamble,
        duration=ICU_DURATION,
        levels=(
            "Died in hospital: dead on all 30 days",
            "In intensive care, the worst quarter: mean SOFA score above 8.5",
            "In intensive care, the second worst quarter: mean SOFA score 6.5 to 8.5",
            "In intensive care, the second best quarter: mean SOFA score 4.7 to 6.5",
            "In intensive care, the best quarter: mean SOFA score up to 4.7",
            "Alive and out of intensive care",
        ),
        purpose="It works out how good each condition is to you, and plans sepsis treatment to "
        "match.",
        note="For research on algorithms. Not medical advice.",
        loss="{n} patients died instead of recovering",
        source="the benchmark ICU-Sepsis, made of records of a hospital in Boston from 2001 to "
        "2012 (MIMIC-III)",
        ends=("die", "", "", "", "", "recover"),
    )
    return entry.factory(), words, ICU_LEGEND


def _choice(
    path: Path,
    comparator: str,
    days: int,
    unit: str | None,
    seed: int,
    tolerance: float,
    like: Sequence[str],
) -> Taught:
    labels, names, vectors = read_alternatives(path)
    words, hint = _words_of(path, labels)
    words = words if unit is None else replace(words, unit=unit)
    noun = _noun_of(path)
    if not words.purpose:
        words = replace(words, purpose=_purpose(names, noun))
    content = json.dumps([labels, names, vectors.tolist()]).encode()
    header = _header(labels, hashlib.blake2b(content, digest_size=16).hexdigest(), words)

    # a tie, a loss and a rounding error are shares of the value range
    shares = vectors / float(f"{vectors[0].sum():.12g}")

    comparator_now = _comparator_maker(comparator, labels, seed, like)

    def make(known: Any) -> Any:
        return choose(shares, comparator_now(), names=names, labels=labels, known=known)

    finer = (
        f"Round the numbers in {path.name} to counts of the same total, and start with a new log."
    )
    told = InWords(labels, words, tolerance, alternative=noun)
    subject = Subject(
        labels,
        words,
        days,
        stakes=partial(choice_stakes, told),
        finer=finer,
        seed=seed,
        conclude=partial(choice_conclusion, told, names, shares),
        facts=_facts(
            str(path), header, comparator, seed, ("Tolerance", per_hundred(tolerance)), like=like
        ),
        enough=partial(choice_holds, told),
        nearly=partial(choice_nearly, told, names, shares),
        source=words.source_sentence or f"The figures are those of the file {path.name}.",
        offered=offered_table(told, names, shares),
    )
    following = partial(cost_of_following_a_choice, shares)
    return Taught(subject, make, header, hint, following=following)


def _noun_of(path: Path) -> str:
    """Return what the alternatives of a CSV file are called, in the singular.

    It is the head of the column of names if that is an English noun as far as can be told, such as
    "treatment", and otherwise "alternative".
    """
    with open(path, encoding="utf-8-sig", newline="") as text:
        head = next(cells[0] for _, cells in _rows(text) if any(cells)).lower()
    is_noun = re.fullmatch(r"[a-z]{3,20}", head) and not head.endswith("s")
    return head if is_noun and head not in _NO_NOUNS else "alternative"


def _purpose(names: Sequence[str], noun: str) -> str:
    """Return a sentence on what is to be chosen."""
    if len(names) > _NAMED:
        return f"It works out which of {len(names)} {in_plural(noun)} is best for you."
    some = f"{', '.join(names[:-1])} or {names[-1]}" if len(names) > 1 else names[0]
    return f"It works out which is best for you: {some}."


def _words_of(path: Path, labels: tuple[str, ...]) -> tuple[Words, str]:
    """Return the words of a CSV file, and if they are missing a sentence on what to write.

    They are in a JSON file beside it. Raises ValueError that says what is wrong with that, and
    OSError.
    """
    beside = path.with_suffix(".words.json")
    if not beside.exists():
        example = {
            "title": "A title",
            "unit": "patients",
            "preamble": "What a count stands for.",
            "source": "the study that the figures come from",
        }
        hint = (
            f"{path.name} does not say what its counts stand for, so they are called outcomes. "
            f"Write it in {beside.name}, for example {json.dumps(example)}"
        )
        return Words("outcomes", title=path.stem.replace("_", " ").replace("-", " ")), hint
    try:
        said = json.loads(beside.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{beside} is no JSON: {error}") from None
    known = [field.name for field in fields(Words) if field.name != "ends"]  # nothing follows
    if not isinstance(said, dict) or not set(said) <= set(known):
        raise ValueError(
            f"{beside} must hold one object with some of the names {', '.join(known)}, and levels "
            "as an object of texts by the names of levels"
        )
    meanings = said.pop("levels", {})
    if not isinstance(meanings, dict) or not set(meanings) <= set(labels):
        raise ValueError(
            f"levels in {beside} must be an object of texts by the names of levels, some of "
            f"{', '.join(labels)}"
        )
    wrong = [name for name, text in [*said.items(), *meanings.items()] if type(text) is not str]
    if wrong:
        raise ValueError(f"{wrong[0]!r} in {beside} must be a text")
    levels = tuple(meanings.get(label, "") for label in labels) if meanings else ()
    return Words(**{"unit": "outcomes", "title": path.stem, **said}, levels=levels), ""


def read_alternatives(path: Path) -> tuple[tuple[str, ...], list[str], Floats]:
    """Return labels (k), names (n) and vectors (n, k) of the alternatives in a CSV file.

    The header has any word above the names, and the k labels, worst first. Each further row has a
    name and its numbers. Cells are separated by commas, or all by semicolons.

    Raises ValueError that names the line, also if the totals differ or a number is below 0, and
    OSError.
    """
    with open(path, encoding="utf-8-sig", newline="") as text:
        try:
            rows = [(n, cells) for n, cells in _rows(text) if any(cells)]
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
    if all(map(_is_number, header)):
        raise ValueError(
            f"the first line of {path} holds numbers: it must name a column of names and then the "
            "levels, worst first, such as name,died,ill,well"
        )
    unnamed = all(_is_number(cells[0]) for _, cells in rows[1:])
    vectors = []
    for number, cells in rows[1:]:
        where = f"line {number} of {path}"
        if len(cells) != len(header):
            raise ValueError(f"{where} has {len(cells)} cells, but the header has {len(header)}")
        vectors.append([_number(cell, where) for cell in cells[1:]])
        total, first = sum(vectors[-1]), sum(vectors[0])
        if unnamed and first > 0 and abs(total - first) > 1e-9 * first:
            raise ValueError(
                f"the first column of {path}, {header[0]!r}, holds numbers, and without it the "
                f"totals differ: it must hold the names of the alternatives. If {header[0]!r} is a "
                "level, put a column of names in front of it"
            )
        if not first > 0 or abs(total - first) > 1e-9 * first:
            raise ValueError(
                f"{where} has the total {total:g}, and the first alternative {first:g}: give all "
                "the same total, above "
                "0, such as shares of 1, or counts of the same number of people"
            )
    return tuple(header[1:]), [cells[0] for _, cells in rows[1:]], np.array(vectors)


def _rows(text: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of each line, and its cells.

    If the first line has semicolons and no comma, cells are separated by semicolons. Decimals may
    then be written with a comma, as spreadsheets in many countries do.
    """
    first = text.readline()
    text.seek(0)
    semicolons = ";" in first and "," not in first
    reader = csv.reader(text, strict=True, delimiter=";" if semicolons else ",")
    for cells in reader:
        if semicolons and reader.line_num > 1:
            cells = [cells[0], *(cell.replace(",", ".") for cell in cells[1:])] if cells else cells
        yield reader.line_num, [cell.strip() for cell in cells]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(cell: str, where: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not 0 <= value < float("inf"):
        raise ValueError(f"{where}: {cell!r} is no number of at least 0")
    return value
