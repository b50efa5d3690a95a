"""The command ``qlearn result``: the result in a log of ``qlearn teach``, without a browser."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qlearn.cli.options import fail, number_parser
from qlearn.cli.teach import RECIPE, problem_parser
from qlearn.experiments.catalogue import TAUGHT_WITH
from qlearn.experiments.settings import INNER

if TYPE_CHECKING:
    from elicit import Interview

_WIDTH = 80
NO_RECIPE = (
    "{} does not say which problem its answers are about: name it with --problem, as for qlearn "
    "teach"
)


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "result",
        help="print what the answers of a log say",
        description="Prints what the answers in a log of qlearn teach say: the conclusion, the "
        "scale, and what the answers change. The log is not changed. The problem and the settings "
        "are those of the log, unless options say otherwise.",
    )
    command.set_defaults(command=run)
    command.add_argument("log", type=Path, metavar="LOG", help="a log of qlearn teach")
    add_settings(command, "the log's")
    command.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="also write report.html, and scale, plan (or choice) and answers as .csv and .json",
    )


def add_settings(command: Any, whose: str) -> None:
    """Add options that replace the settings in a log's header; ``whose`` says which logs."""
    command.add_argument("--problem", type=problem_parser, help=f"as of qlearn teach [{whose}]")
    command.add_argument("--comparator", choices=TAUGHT_WITH, help=f"who learns [{whose}]")
    command.add_argument(
        "--tolerance",
        type=number_parser(INNER),
        metavar="X",
        help=f"share of the value range at which a plan is called settled [{whose}]",
    )


def run(
    log: Path, problem: Any, comparator: str | None, tolerance: float | None, out: Path | None
) -> int:
    """Run the command and return the exit code."""
    from elicit import AnswerLog, Interview, Session
    from qlearn.cli.teach_subjects import taught_again
    from qlearn.cli.teach_terminal import say_report

    try:
        recipe = dict(AnswerLog.read(log).header.get(RECIPE, {}))
        if problem is None and "problem" not in recipe:
            return fail(NO_RECIPE.format(log))
        recipe["problem"] = problem_parser(recipe["problem"]) if problem is None else problem
        given = {"comparator": comparator, "tolerance": tolerance}
        recipe |= {name: value for name, value in given.items() if value is not None}
        taught = taught_again(recipe)
        with tempfile.TemporaryDirectory() as folder:
            # a session may mark answers as unused: that is done to a copy
            copy = Path(shutil.copy(log, folder))
            kept = AnswerLog(copy, len(taught.subject.labels), taught.header)
            with (
                kept,
                Session(taught.make, kept, seed=recipe.get("seed", 0)) as session,
                Interview(session, taught.subject) as interview,
            ):
                say_report(interview.handle({"do": "result"}), _WIDTH)
                if out is not None:
                    _write(interview, out)
    except BrokenPipeError:  # which ends the command quietly
        raise
    except (ImportError, ValueError, OSError) as error:
        return fail(error)
    return 0


def _write(interview: Interview, out: Path) -> None:
    """Write the report and the tables to a folder, and print their names."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "report.html").write_text(interview.handle({"do": "report"})["html"], encoding="utf-8")
    names = ["report.html"]
    for one in interview.handle({"do": "result"})["end"]["downloads"]:
        for form in ("csv", "json"):
            wanted = {"do": "download", "what": one["what"], "format": form}
            names.append(f"{one['name'].lower()}.{form}")
            text = interview.handle(wanted)["text"]
            (out / names[-1]).write_text(text, encoding="utf-8")
    print(f"Written to {out}: {', '.join(names)}.")
