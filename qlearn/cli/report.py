"""The command ``qlearn report``: a report on several people's logs, with tables beside it."""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qlearn.cli.options import fail
from qlearn.cli.result import NO_RECIPE, add_settings
from qlearn.cli.teach import RECIPE, problem_parser

if TYPE_CHECKING:
    from elicit import AnswerLog, Interview
    from elicit.person.study.report import FollowingTable, PersonFound
    from qlearn.cli.teach_subjects import Taught

_LIMITS = {
    "polytope": "It is assumed that every answer is right for the person who gave it. One wrong "
    "answer can make that person's ranges wrong.",
    "polytope-1-wrong": "It is assumed that at most one answer of each person is wrong for them. "
    "Two wrong answers can make that person's ranges wrong.",
    "posterior": "The ranges allow for errors in the answers. Each holds with 95% probability, on "
    "average over the scales that were assumed before the first answer.",
}
_FOR_ALL = (
    "What one person answered is taken to say nothing about another's scale, nor about another's "
    "errors.",
    "The mean adds up values of different people on one range, from the worst level to the best. "
    "That is a choice, not a finding.",
)


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "report",
        help="make one report of several people's logs",
        description="Makes one report of the logs of several people who answered about the same "
        "problem: each one's scale, how far they agree, and what it costs to follow one another. "
        "Tables of scales, plans (or choices) and answers are written beside it, as CSV and "
        "JSON. The logs are not changed, and may be in use. Problem and settings are those of the "
        "logs, unless options say otherwise.",
    )
    command.set_defaults(command=run)
    command.add_argument(
        "logs", type=Path, nargs="+", metavar="LOG", help="a log of qlearn teach for each person"
    )
    add_settings(command, "the logs'")
    command.add_argument(
        "--out",
        type=Path,
        default=Path("study"),
        metavar="DIR",
        help="where to write [%(default)s]",
    )


def run(
    logs: Sequence[Path],
    problem: Any,
    comparator: str | None,
    tolerance: float | None,
    out: Path,
) -> int:
    """Run the command and return the exit code."""
    from elicit import AnswerLog
    from qlearn.cli.teach_subjects import taught_again

    try:
        if len(logs) < 2:
            raise ValueError(
                f"a report is about several people: name the log of each, or use qlearn result "
                f"{logs[0]} for one"
            )
        read = [AnswerLog.read(path) for path in logs]
        named = _named(read)
        recipe = _common_recipe(
            named, {"problem": problem, "comparator": comparator, "tolerance": tolerance}
        )
        recipe["problem"] = problem_parser(recipe["problem"]) if problem is None else problem
        taught = taught_again(recipe)
        _write(out, taught, named, recipe)
    except BrokenPipeError:  # which ends the command quietly
        raise
    except (ImportError, ValueError, OSError) as error:
        return fail(error)
    return 0


def _named(logs: Sequence[AnswerLog]) -> dict[str, AnswerLog]:
    """Return the logs by name of their person or, without one, of their file. Raises ValueError."""
    named: dict[str, AnswerLog] = {}
    for log in logs:
        assert log.path is not None
        said = {entry.answer.who for entry in log} | {log.who} - {None}
        if len(said - {None}) > 1:
            raise ValueError(
                f"{log.path} holds the answers of several people: give a log for each person"
            )
        who = next(iter(said - {None}), None) or log.path.stem
        if who in named:
            raise ValueError(
                f"{named[who].path} and {log.path} are both of {who!r}: give one log for each "
                "person, or join the two with qlearn log merge"
            )
        named[who] = log
    return named


def _common_recipe(named: Mapping[str, AnswerLog], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that all logs share. A setting that is given replaces those of the logs.

    Raises ValueError if the logs differ in a setting that is not given. The number of outcomes on a
    side may differ, because only new questions depend on it.
    """
    recipes = {who: dict(log.header.get(RECIPE, {})) for who, log in named.items()}
    common: dict[str, Any] = {}
    for setting in ("problem", "comparator", "tolerance", "seed", "unit", "days"):
        if given.get(setting) is not None:
            common[setting] = given[setting]
            continue
        found = {who: recipe[setting] for who, recipe in recipes.items() if setting in recipe}
        values = [*dict.fromkeys(found.values())]
        if len(values) > 1 and setting in given:
            each = ", ".join(f"{value} for {who}" for who, value in found.items())
            raise ValueError(
                f"the logs were begun with another {setting} each ({each}): choose one with "
                f"--{setting}"
            )
        if values:
            common[setting] = max(values) if setting == "days" else values[0]
    earlier = {tuple(recipe.get("like", ())) for recipe in recipes.values() if recipe}
    if len(earlier) > 1:
        raise ValueError(
            "the logs were begun with other earlier people each (--like of qlearn teach): make a "
            "report of those that share them"
        )
    common["like"] = next(iter(earlier), ())
    if "problem" not in common:
        raise ValueError(NO_RECIPE.format(next(iter(named.values())).path))
    return common


@dataclass(frozen=True, eq=False)
class _Found:
    """Findings in the log of a person: texts, tables, and the comparator that learned it.

    ``plan`` is the name of the table of what to do, or "".
    """

    person: PersonFound
    tables: Mapping[str, list[dict[str, Any]]]
    comparator: Any
    entries: tuple[Any, ...]
    plan: str


def _write(
    out: Path, taught: Taught, named: Mapping[str, AnswerLog], recipe: Mapping[str, Any]
) -> None:
    """Write the report and the tables to a folder, and print their names."""
    from elicit import Panel
    from elicit._support.distribution import version
    from elicit.person.course.files import as_csv, as_json
    from elicit.person.report import ReportDetails
    from elicit.person.showing import about_questions, legend_of, printable
    from elicit.person.study.report import stated_probability, study_page
    from elicit.person.study.study import agreed_so_far

    subject = taught.subject
    found: dict[str, _Found] = {}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for number, (who, log) in enumerate(named.items()):
            print(f"Reading the answers of {printable(who)} ...", file=sys.stderr, flush=True)
            found[who] = _found(taught, who, log, folder / f"{number}.jsonl", recipe)
    known = {
        who: one.comparator
        for who, one in found.items()
        if one.comparator is not None and one.person.end["counts"]["answered"]
    }
    entries = {who: found[who].entries for who in known}
    print("Comparing them ...", file=sys.stderr, flush=True)
    agreed = agreed_so_far(known, entries, subject.labels)
    following = None
    if taught.following is not None and len(known) > 1:
        some = [found[who].person for who in known]
        following = _table(taught.following(Panel(known)), stated_probability(some))
    now = datetime.now(UTC)
    limit = _LIMITS.get(recipe.get("comparator", "posterior"))
    note = printable(subject.words.note)
    html = study_page(
        printable(subject.words.title),
        f"{now.day} {now:%B %Y, %H:%M} UTC",
        [one.person for one in found.values()],
        agreed,
        following,
        ReportDetails(
            preamble=about_questions(subject.words),
            legend=legend_of(subject),
            facts={
                **dict(subject.facts.of),
                "Version": f"elicit-qlearn {version()}, Python {sys.version.split()[0]}",
            },
            limits=[one for one in (limit, *_FOR_ALL, note) if one],
        ),
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.html").write_text(html, encoding="utf-8")
    names = ["report.html"]
    plans = next((f"{one.plan.lower()}s" for one in found.values() if one.plan), "plans")
    tables = {
        name: [row for one in found.values() for row in one.tables[what]]
        for what, name in (("scale", "scales"), ("plan", plans), ("answers", "answers"))
    }
    if following is not None:
        tables["following"] = [
            {"person": who, "follows": other, "loss": round(loss, 6), "at_most": round(bound, 6)}
            for who, losses, bounds in zip(
                following.rows, following.losses, following.bounds, strict=True
            )
            for other, loss, bound in zip(following.columns, losses, bounds, strict=True)
        ]
    for name, rows in tables.items():
        for form, text in (("csv", as_csv(rows)), ("json", as_json(rows))):
            names.append(f"{name}.{form}")
            (out / names[-1]).write_text(text, encoding="utf-8")
    print(f"Written to {out}: {', '.join(names)}.")


def _found(
    taught: Taught, who: str, log: AnswerLog, copy: Path, recipe: Mapping[str, Any]
) -> _Found:
    """Return the findings in a person's log, made from a copy, which a session may change."""
    from elicit import AnswerLog, Interview, Session
    from elicit.person.showing import printable
    from elicit.person.study.report import PersonFound

    assert log.path is not None
    for field, value in taught.header.items():
        if log.checksum is not None and log.header.get(field) != value:  # else it is empty
            raise ValueError(
                f"{log.path} is about another problem: its {field} is {log.header.get(field)}, not "
                f"{value}. Give the logs of one problem, or name it with --problem"
            )
    shutil.copy(log.path, copy)
    seed = recipe.get("seed", 0)
    with (
        AnswerLog(copy, len(taught.subject.labels), taught.header) as kept,
        Session(taught.make, kept, seed=seed) as session,
        Interview(session, taught.subject) as interview,
    ):
        end = interview.handle({"do": "result"})["end"]
        result, nan = session.result(), float("nan")
        person = PersonFound(
            printable(who),
            end,
            float(getattr(result, "loss_bound", nan)),
            printable(log.path.name),
            kept.checksum,
            float(getattr(result, "confidence", nan)),
        )
        return _Found(
            person,
            {what: _rows(interview, who, what) for what in ("scale", "plan", "answers")},
            interview.progress.comparator,
            interview.progress.entries,
            next((one["name"] for one in end["downloads"] if one["what"] == "plan"), ""),
        )


def _rows(interview: Interview, who: str, what: str) -> list[dict[str, Any]]:
    """Return the rows of a table, with a first column for the person."""
    return [
        {"person": who, **{name: value for name, value in row.items() if name != "who"}}
        for row in interview.table(what)
    ]


def _table(found: Any, sure: str) -> FollowingTable:
    """Return the report's table of losses: those of each person under each other's policy.

    ``found`` is a ``Following``. If people choose from a list, choices take the place of policies.
    ``sure`` says how sure a bound on a loss is ("" if it is proven).
    """
    from elicit.person.study.report import FollowingTable

    what, where = ("policy", ", at the worst state") if found.of_policies else ("choice", "")
    note = (
        f"Loss of the person in the row if the {what} that is best for the person in the column is "
        "followed. Losses are in percent of the value range, by the scale of the person in the row"
        f"{where}. The first number is the best guess, and the one in brackets an upper bound"
        f"{f', {sure} each' if sure else ''}."
    )
    return FollowingTable(
        found.people, found.followed, found.losses.tolist(), found.bounds.tolist(), note
    )
