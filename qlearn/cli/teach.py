"""The command ``qlearn teach``: a person answers, in the terminal."""

from __future__ import annotations

import shlex
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from qlearn.cli.options import fail, number_parser, part_parser
from qlearn.experiments.factories import Own
from qlearn.experiments.settings import FROM_0, NameOrOwn, Number

_PROBLEM = NameOrOwn(("icu-sepsis", "random"), "(seed) returns an OrdinalMDP, or (mdp, elicit.Words)")
_COMPARATORS = ("polytope", "posterior")
_DAYS = Number(int, lambda n: n >= 2, "a whole number of at least 2")


def add_to(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "teach",
        help="answer the questions yourself, in the terminal",
        description="Puts questions about simple groups of outcomes, keeps each answer on the disk before the next "
        "question, and says at the end what was learned. Leave at any moment, and start the same command to go on. "
        "Answers are lines of standard input: a, b, e (equal), ? (cannot tell), u (undo), q (quit).",
    )
    command.set_defaults(command=run)
    command.add_argument(
        "--problem",
        type=_problem,
        default="icu-sepsis",
        metavar="{icu-sepsis,random,package.module:function,FILE.csv}",
        help="what to learn: function(seed) returns an OrdinalMDP, alone or as the first of a tuple, perhaps with "
        "elicit.Words for its questions; a CSV lists alternatives to choose from: its header names the levels, "
        "worst first, after a first column with the alternatives' names [%(default)s]",
    )
    command.add_argument(
        "--comparator",
        choices=_COMPARATORS,
        default="polytope",
        help="who learns: polytope takes each answer for right, posterior allows for errors [%(default)s]",
    )
    command.add_argument(
        "--log", type=Path, metavar="FILE", help="where the answers are kept [answers-PROBLEM.jsonl, here]"
    )
    command.add_argument(
        "--days",
        type=number_parser(_DAYS),
        default=10,
        metavar="N",
        help="how many outcomes are shown on a side, where there is a choice [%(default)s]",
    )
    command.add_argument(
        "--unit",
        metavar="WORD",
        help="what is counted, in the plural [that of the problem; days, or of a CSV outcomes]",
    )
    command.add_argument(
        "--seed",
        type=number_parser(FROM_0),
        default=0,
        metavar="N",
        help="of what is left to chance: which side is A, a random problem [%(default)s]",
    )


def run(problem: str | Own, comparator: str, log: Path | None, days: int, unit: str | None, seed: int) -> int:
    """The command; returns the exit code."""
    from elicit import AnswerLog, Session
    from qlearn.cli.teach_subjects import taught_by
    from qlearn.cli.teach_terminal import Terminal

    name = problem if isinstance(problem, str) else problem.name
    short = Path(name).stem if name.lower().endswith(".csv") else name.replace(":", "-")
    path = log or Path(f"answers-{short}.jsonl")
    again = ["qlearn", "teach", "--problem", name, "--comparator", comparator, "--log", str(path)]
    again += ["--days", str(days), "--seed", str(seed), *([] if unit is None else ["--unit", unit])]
    with ExitStack() as stack:
        try:
            taught = taught_by(problem, comparator, days, unit, seed)
            print("Getting ready ...", file=sys.stderr, flush=True)
            kept = stack.enter_context(AnswerLog(path, len(taught.subject.labels), taught.header))
            session = stack.enter_context(Session(taught.make, kept))
        # a package is missing, a problem cannot be, a log is in use, damaged, another's, or not to be written
        except (ImportError, ValueError, OSError) as error:
            return fail(str(error))
        except KeyboardInterrupt:
            return 130
        return Terminal(session, taught.subject, shlex.join(again)).converse()


def _problem(text: str) -> Any:
    """An argparse type: as ``part_parser``, or the path of a CSV file."""
    if text.lower().endswith(".csv"):
        return text
    found = part_parser(_PROBLEM)(text)
    return replace(found, name=text) if isinstance(found, Own) else found  # by this name it is found again
