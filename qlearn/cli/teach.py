"""The command ``qlearn teach``: a person answers, in the terminal."""

from __future__ import annotations

import shlex
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from qlearn.cli.options import fail, number_parser, part_parser
from qlearn.experiments.catalogue import PROBLEMS, TAUGHT_WITH
from qlearn.experiments.factories import Own
from qlearn.experiments.settings import FROM_0, INNER, SHARE, NameOrOwn, Number

if TYPE_CHECKING:
    from elicit import Session, Subject

_TAUGHT = tuple(name for name, entry in PROBLEMS.items() if entry.taught)
_PROBLEM = NameOrOwn(_TAUGHT, "(seed) returns an OrdinalMDP, or (mdp, elicit.Words)")
_PORT = Number(int, lambda n: 0 <= n <= 65535, "a port, from 1 to 65535, or 0 for a free one")
_HOST = "127.0.0.1"
_AUDIT = 0.1
RECIPE = "recipe"
"""The field of a log's header that holds the options of ``qlearn teach`` that began it."""
_DAYS = Number(int, lambda n: n >= 2, "a whole number of at least 2")


class PageOptions(TypedDict):
    """The address at which a browser finds the questions, if ``web`` is given."""

    web: bool
    port: int
    host: str
    let_others_in: bool


def add_to(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "teach",
        help="answer the questions yourself, in the terminal or the browser",
        description="Puts questions about simple groups of outcomes, keeps each answer on the disk "
        "before the next "
        "question, and says at the end what was learned. Leave at any moment, and start the same "
        "command to go on. "
        "Answers are lines of standard input: a, b, e (equal), ? (cannot tell), u (undo), w (why), "
        "f (finish now), q (quit).",
    )
    command.set_defaults(command=run)
    command.add_argument(
        "--problem",
        type=problem_parser,
        default="icu-sepsis",
        metavar=f"{{{','.join(_TAUGHT)},package.module:function,FILE.csv}}",
        help="what to learn: function(seed) returns an OrdinalMDP, alone or as the first of a "
        "tuple, perhaps with "
        "elicit.Words for its questions; a CSV lists alternatives to choose from: its header names "
        "the levels, "
        "worst first, after a first column with the alternatives' names, and FILE.words.json says "
        "what its counts stand for [%(default)s]",
    )
    command.add_argument(
        "--comparator",
        choices=TAUGHT_WITH,
        default="posterior",
        help="who learns: posterior allows for errors, as people make them; polytope takes each "
        "answer for right [%(default)s]",
    )
    command.add_argument(
        "--log",
        type=Path,
        metavar="FILE",
        help="where the answers are kept [answers-PROBLEM.jsonl, here]",
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
    command.add_argument(
        "--tolerance",
        type=number_parser(INNER),
        default=0.01,
        metavar="X",
        help="of an MDP: questions end once the policy can lose no more than this share of the "
        "value range "
        "[%(default)s]",
    )
    command.add_argument(
        "--audit",
        type=number_parser(SHARE),
        default=_AUDIT,
        metavar="X",
        help="in front of this share of the questions an earlier one is put again, to see whether "
        "the answers agree, and more where too few were; 0: none [%(default)s]",
    )
    page = command.add_argument_group(
        "in the browser", "The answers stay on this machine, and only it is listened to."
    )
    page.add_argument(
        "--web",
        action="store_true",
        help="print the address of a page instead, which lets in one browser, once; Enter prints "
        "another one, Ctrl+C "
        "ends",
    )
    page.add_argument(
        "--port",
        type=number_parser(_PORT),
        default=0,
        metavar="N",
        help="where the page is, such as for a tunnel [a free port]",
    )
    page.add_argument(
        "--host",
        default=_HOST,
        metavar="ADDRESS",
        help="of this machine, to listen on; one that other machines reach needs --let-others-in "
        "[%(default)s]",
    )
    page.add_argument(
        "--let-others-in",
        action="store_true",
        help="listen where other machines reach it, too: nothing is encrypted, so who can read the "
        "network can read "
        "the answers, and answer",
    )


def run(
    problem: str | Own,
    comparator: str,
    log: Path | None,
    days: int,
    unit: str | None,
    seed: int,
    tolerance: float,
    audit: float,
    **page: Unpack[PageOptions],
) -> int:
    """Run the command and return the exit code."""
    from elicit import AnswerLog, Session
    from elicit.person.showing import printable
    from qlearn.cli.teach_subjects import taught_by
    from qlearn.cli.teach_terminal import Terminal

    name = problem if isinstance(problem, str) else problem.name
    short = Path(name).stem if name.lower().endswith(".csv") else name.replace(":", "-")
    path = log or Path(f"answers-{short}.jsonl")
    again = ["qlearn", "teach", "--problem", name, "--comparator", comparator, "--log", str(path)]
    again += ["--days", str(days), "--seed", str(seed), *([] if unit is None else ["--unit", unit])]
    again += [] if name.lower().endswith(".csv") else ["--tolerance", str(tolerance)]
    again += [] if audit == _AUDIT else ["--audit", str(audit)]
    if page["web"]:
        again += [
            "--web",
            *(["--port", str(page["port"])] if page["port"] else []),
            *([] if page["host"] == _HOST else ["--host", page["host"]]),
        ]
        again += ["--let-others-in"] if page["let_others_in"] else []
    with ExitStack() as stack:
        try:
            taught = taught_by(problem, comparator, days, unit, seed, tolerance)
            if taught.hint:
                print(printable(taught.hint), file=sys.stderr, flush=True)
            print("Getting ready ...", file=sys.stderr, flush=True)
            recipe = {
                "problem": name,
                "comparator": comparator,
                "days": days,
                "unit": unit,
                "seed": seed,
                "tolerance": tolerance,
            }
            header = {**taught.header, **_begun_with(path, recipe)}
            kept = stack.enter_context(AnswerLog(path, len(taught.subject.labels), header))
            session = stack.enter_context(Session(taught.make, kept, audit=audit, seed=seed))
        # a package is missing, a problem cannot be, a log is in use, damaged, another's, or not to
        # be written
        except (ImportError, ValueError, OSError) as error:
            return fail(str(error))
        except KeyboardInterrupt:
            return 130
        if page["web"]:
            return _served(session, taught.subject, shlex.join(again), page)
        return Terminal(session, taught.subject, shlex.join(again)).converse()


def _begun_with(path: Path, recipe: dict[str, Any]) -> dict[str, Any]:
    """Return the header field with the options that began a log: those in the file, if it has any.

    A log may be gone on with other options. One without the field stays as it is.
    """
    from elicit import AnswerLog
    from elicit.tutors.log_lines import BadLog

    try:
        header = AnswerLog.read(path, []).header
    except (BadLog, OSError):
        return {RECIPE: recipe}  # a new log, or one that opening it refuses
    if "k" not in header:
        return {RECIPE: recipe}
    return {RECIPE: header[RECIPE]} if RECIPE in header else {}


def _served(session: Session, subject: Subject, again: str, page: PageOptions) -> int:
    """Serve the page until Ctrl+C, and return the exit code."""
    from elicit.person.hosts.web import serve
    from elicit.person.showing import printable

    try:
        serve(
            session,
            subject,
            page["host"],
            page["port"],
            let_others_in=page["let_others_in"],
        )
    # a package is missing, an address lets others in, a port is in use
    except (ImportError, ValueError, OSError) as error:
        return fail(str(error))
    kept = sum(not entry.retracted and not entry.repeat for entry in session.log)
    print(
        f"Kept: {kept} answer{'' if kept == 1 else 's'}. To go on:\n  {printable(again)}",
        flush=True,
    )
    return 0


def problem_parser(text: str) -> Any:
    """An argparse type: as ``part_parser``, or the path of a CSV file."""
    if text.lower().endswith(".csv"):
        return text
    found = part_parser(_PROBLEM)(text)
    return (
        replace(found, name=text) if isinstance(found, Own) else found
    )  # by this name it is found again
