"""The command ``qlearn teach``: a person answers, in the terminal."""

from __future__ import annotations

import argparse
import json
import re
import shlex
import sys
import unicodedata
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from qlearn.cli.options import fail, number_parser, part_parser
from qlearn.experiments.catalogue import PROBLEMS, TAUGHT_WITH
from qlearn.experiments.own_parts import Own
from qlearn.experiments.settings import FROM_0, INNER, SHARE, NameOrOwn, Number

if TYPE_CHECKING:
    from elicit import AnswerLog, Session, Subject
    from qlearn.cli.teach_subjects import Taught

_TAUGHT = tuple(name for name, entry in PROBLEMS.items() if entry.taught)
_PROBLEM = NameOrOwn(_TAUGHT, "(seed) returns an OrdinalMDP, or (mdp, elicit.Words)")
_PORT = Number(int, lambda n: 0 <= n <= 65535, "a port, from 1 to 65535, or 0 for a free one")
_HOST = "127.0.0.1"
_AUDIT = 0.1
LONGEST_NAME = 80
_WANTED_WORDS = {
    "title": "A title",
    "unit": "What one count is, in the plural, such as patients or days",
    "preamble": "A sentence on what is compared, for the person who answers",
    "source": "Where the figures come from, such as the 2019 hip registry",
}
RECIPE = "recipe"
"""The field of a log's header that holds the options of ``qlearn teach`` that began it."""
_MOST_PEOPLE = 50
_LONGEST_PART = 120  # bytes of a name in a file's name, of which most file systems allow 255
_INVITED = Number(int, lambda n: 1 <= n <= _MOST_PEOPLE, f"a whole number from 1 to {_MOST_PEOPLE}")
_BUDGET = Number(int, lambda n: 1 <= n < 10_000, "a whole number from 1 to 9999")
_DAYS = Number(int, lambda n: n >= 2, "a whole number of at least 2")


class SessionOptions(TypedDict):
    """Options of a session: its person, earlier people, the planned questions, and the page.

    The address matters only with ``web``, and with it the people of a study.
    """

    who: str | None
    like: list[str]
    questions: int | None
    until: Literal["values", "settled"] | None
    web: bool
    port: int
    host: str
    let_others_in: bool
    people: tuple[str, ...] | None
    invite: tuple[str, ...] | None


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "teach",
        help="answer the questions yourself, in the terminal or the browser",
        description="Puts questions about simple groups of outcomes, keeps each answer on the disk "
        "before the next "
        "question, and says at the end what was learned. Leave at any moment, and start the same "
        "command to go on. "
        "Answers are lines of standard input: a, b, e (equal), ? (cannot tell), u (take back the "
        "last answer), w (why), f (finish now), q (quit).",
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
        "what its counts stand for and where the figures come from [%(default)s]",
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
        help="where the answers are kept; with --who NAME it is answers-PROBLEM-NAME.jsonl "
        "[answers-PROBLEM.jsonl, here]",
    )
    command.add_argument(
        "--who",
        type=_name_parser,
        metavar="NAME",
        help="name or pseudonym of the person who answers, for the log: each has a log of their "
        "own. In a terminal, without a name and a --log, it is asked for at the start [nobody]",
    )
    command.add_argument(
        "--like",
        nargs="+",
        default=[],
        metavar="LOG",
        help="logs of earlier people about the same levels, one each: their scales and errors are "
        "the prior for this person's, with --comparator posterior. Leave the files as they are: "
        "going on, and qlearn result, read them again [nobody]",
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
        help="questions end once the policy, or the choice from a CSV, can lose no more than this "
        "share of the value range [%(default)s]",
    )
    command.add_argument(
        "--questions",
        type=number_parser(_BUDGET),
        metavar="N",
        help="how many questions you have time for: says before the first what they are likely to "
        "prove, which takes up to a minute (Ctrl+C skips it), and offers the result after so many "
        "[no limit]",
    )
    command.add_argument(
        "--until",
        choices=("values", "settled"),
        help="when the questions in the terminal end: values, once the range of every level is at "
        "most 20 wide, of 100; settled, already once the result is settled. With --web the page "
        "lets the person choose [values; or, in a log with answers, what was chosen before]",
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
    study = command.add_argument_group(
        "several people",
        "With --web: one link for each person, who has a session and a log of their own, and a "
        "page for whoever runs the study. qlearn report makes the report.",
    )
    some = study.add_mutually_exclusive_group()
    some.add_argument(
        "--people",
        type=people_parser,
        metavar="NAME,NAME,...",
        help="names or pseudonyms of the people who answer; their logs are "
        "answers-PROBLEM-NAME.jsonl [nobody]",
    )
    some.add_argument(
        "--invite",
        type=_invited,
        metavar="N",
        help="the same for so many people without names, person-1 and so on, at most "
        f"{_MOST_PEOPLE} [nobody]",
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
    **how: Unpack[SessionOptions],
) -> int:
    """Run the command and return the exit code."""
    from elicit import AnswerLog, Session
    from elicit.person.hosts.getting_ready import progress_said
    from elicit.person.showing import printable
    from qlearn.cli.teach_subjects import taught_by
    from qlearn.cli.teach_terminal import Terminal

    questions = how["questions"]
    name = problem if isinstance(problem, str) else problem.name
    short = short_name(name)
    recipe = {
        "problem": name,
        "comparator": comparator,
        "days": days,
        "unit": unit,
        "seed": seed,
        "tolerance": tolerance,
    }
    like = sorted(dict.fromkeys(str(Path(each).resolve()) for each in how["like"]))
    recipe |= {"like": like} if like else {}
    same = ["--days", str(days), "--seed", str(seed)]
    same += [] if unit is None else ["--unit", unit]
    same += ["--tolerance", str(tolerance)]
    same += ["--like", *like] if like else []
    if people := how["people"] or how["invite"]:
        wrong = _not_for_several(log, how)
        if wrong:
            return fail(wrong)
        from qlearn.cli.teach_study import StudyPlan, run_study

        paths = {who: Path(f"answers-{short}-{in_a_path(who)}.jsonl") for who in people}
        headers = {who: begun_with(path, recipe) for who, path in paths.items()}
        some = ["--people", ",".join(people)]
        if how["invite"]:
            some = ["--invite", str(len(people))]
        again = ["qlearn", "teach", "--web", *some, "--problem", name, "--comparator", comparator]
        again += [*same, "--audit", str(audit), *address_options(how)]
        report = ["qlearn", "report", *map(str, paths.values()), "--out", f"study-{short}"]
        plan = StudyPlan(paths, headers, audit, seed, shlex.join(again), shlex.join(report))

        def taught_now() -> Taught:
            _compile(comparator)
            return taught_by(problem, comparator, days, unit, seed, tolerance, like)

        return run_study(plan, taught_now, how["host"], how["port"], how["let_others_in"])
    try:
        who = how["who"] or (None if log else _asked_name())
        path = log or Path(f"answers-{short}{'' if who is None else f'-{in_a_path(who)}'}.jsonl")
        if name.lower().endswith(".csv") and not path.exists():  # a log has its words already
            _ask_words(Path(name))
    except KeyboardInterrupt:
        return 130
    again = ["qlearn", "teach", "--problem", name, "--comparator", comparator, "--log", str(path)]
    again += same
    again += [] if questions is None else ["--questions", str(questions)]
    again += [] if how["until"] is None else ["--until", how["until"]]
    again += [] if audit == _AUDIT else ["--audit", str(audit)]
    again += [] if who is None else ["--who", who]
    if how["web"]:
        again += ["--web", *address_options(how)]
    with ExitStack() as stack:
        try:
            if str(path.resolve()) in like:
                return fail(f"{path} is this person's own log: leave it out of --like")
            taught = taught_by(problem, comparator, days, unit, seed, tolerance, like)
            if taught.hint:
                print(printable(taught.hint), file=sys.stderr, flush=True)
            header = {**taught.header, **begun_with(path, recipe)}
            kept = stack.enter_context(AnswerLog(path, len(taught.subject.labels), header, who))

            def session_now() -> Session:
                _compile(comparator)
                made = Session(taught.make, kept, who=who, audit=audit, seed=seed)
                session = stack.enter_context(made)
                if questions is not None:
                    _say_plan(taught, session, questions)
                return session

            if how["web"]:
                return _served(session_now, kept, taught.subject, shlex.join(again), how)
            with progress_said():
                session = session_now()
        # a package is missing, a problem cannot be, a log is in use, damaged, another's, or not to
        # be written
        except (ImportError, ValueError, OSError) as error:
            return fail(error)
        except KeyboardInterrupt:
            return 130
        until = how["until"]
        return Terminal(session, taught.subject, shlex.join(again), questions, until).converse()


def _compile(comparator: str) -> None:
    """Compile now what the answers will need, so that nobody waits for it between two questions.

    It takes a second if the machine code is there already.
    """
    from qlearn.experiments.compile_ahead import parts

    for part in parts([{"comparator": comparator, "learner": "policy-iteration"}]):
        part()


def _say_plan(taught: Taught, session: Session, questions: int) -> None:
    """Print what this number of questions is likely to prove, unless interrupted or unknown."""
    from elicit.person.asker import Compares

    asker = session.current_asker()
    if taught.plan is None or not isinstance(asker, Compares) or not asker.ask():
        return
    print(
        f"Simulating sessions of {questions} questions (up to a minute; Ctrl+C skips this) ...",
        file=sys.stderr,
        flush=True,
    )
    with suppress(KeyboardInterrupt):
        print(f"Your plan: {taught.plan(asker.comparator, questions)}", flush=True)


def _not_for_several(log: Path | None, how: SessionOptions) -> str:
    """Return a sentence on options that cannot be used with several people, or ""."""
    if not how["web"]:
        return "several people answer in browsers: add --web to --people or --invite"
    for given, option, instead in (
        (log, "--log", "each person has a log of their own, answers-PROBLEM-NAME.jsonl, here"),
        (how["who"], "--who", "--people names all who answer"),
        (how["questions"], "--questions", "the page asks each person how much time they have"),
        (how["until"], "--until", "the page asks each person how far to go"),
    ):
        if given is not None:
            return f"{option} is for one person: leave it out, since {instead}"
    return ""


def short_name(problem: str) -> str:
    """Return a problem's name as a part of a file's name."""
    return Path(problem).stem if problem.lower().endswith(".csv") else problem.replace(":", "-")


def address_options(how: SessionOptions) -> list[str]:
    """Return the options that give the page the same address again."""
    return [
        *(["--port", str(how["port"])] if how["port"] else []),
        *([] if how["host"] == _HOST else ["--host", how["host"]]),
        *(["--let-others-in"] if how["let_others_in"] else []),
    ]


def people_parser(text: str) -> tuple[str, ...]:
    """Return names from a command line's text, separated by commas. Each gives a different file."""
    names = [_name_parser(name) if name.strip() else "" for name in text.split(",")]
    if "" in names:
        raise argparse.ArgumentTypeError(
            f"a name in {text[:LONGEST_NAME]!r} is blank: write names with one comma between them, "
            "such as ann,ben,chen"
        )
    if len(names) > _MOST_PEOPLE:
        raise argparse.ArgumentTypeError(
            f"{len(names)} names are given, but a study has at most {_MOST_PEOPLE} people"
        )
    taken: dict[str, str] = {}
    for name in names:
        part = in_a_path(name)
        if len(part.encode()) > _LONGEST_PART:
            raise argparse.ArgumentTypeError(
                f"the name {name!r} is too long for a file's name: shorten it"
            )
        # some file systems take these for the same
        alike = unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", part).casefold())
        if alike in taken:
            raise argparse.ArgumentTypeError(
                f"{taken[alike]!r} and {name!r} would share a log, ...-{part}.jsonl: give one of "
                "them another name"
            )
        taken[alike] = name
    return tuple(names)


def _invited(text: str) -> tuple[str, ...]:
    """Return pseudonyms for the number of people given on the command line."""
    number = int(number_parser(_INVITED)(text))
    return tuple(f"person-{i}" for i in range(1, number + 1))


def _name_parser(text: str) -> str:
    """Return a name from the command line: printable, and at most ``LONGEST_NAME`` characters."""
    from elicit.person.showing import printable

    name = " ".join(printable(text).split())
    if not name or len(name) > LONGEST_NAME:
        raise argparse.ArgumentTypeError(
            f"a name has 1 to {LONGEST_NAME} characters, not {text[:LONGEST_NAME]!r}"
        )
    return name


def _asked_name() -> str | None:
    """Ask for the name of the person who answers.

    The result is None if nobody is at the terminal, or no name is given.
    """
    if not sys.stdin.isatty():  # then the lines are answers
        return None
    while True:
        print("Your name or a pseudonym, for the log (Enter: none): ", end="", flush=True)
        said = sys.stdin.readline()
        if not said.strip():
            return None
        try:
            return _name_parser(said)
        except argparse.ArgumentTypeError as error:
            print(f"{error}.")


def _ask_words(table: Path) -> None:
    """Ask for the words that a CSV file lacks, and write them to a file beside it.

    If nobody is at the terminal, nothing is asked or written. If every answer is empty, nothing is
    written.
    """
    from elicit._support.file_errors import in_words

    beside = table.with_suffix(".words.json")
    if not sys.stdin.isatty() or not table.exists() or beside.exists():
        return
    print(f"{table.name} does not say what its counts stand for. Enter leaves a line out.")
    said: dict[str, str] = {}
    for field, wanted in _WANTED_WORDS.items():
        print(f"{wanted}: ", end="", flush=True)
        if text := " ".join(sys.stdin.readline().split()):
            said[field] = text
    if not said:
        return
    try:
        beside.write_text(json.dumps(said, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        print(f"This was not written down: {in_words(error)}.")
    else:
        print(f"Written to {beside}, where you can change it.")


def in_a_path(who: str) -> str:
    """Return a name as a part of a file's name: all but letters and digits become hyphens."""
    whole = unicodedata.normalize("NFC", who)  # a letter and its accent are one character
    return re.sub(r"[^\w]+", "-", whole).strip("-_") or "person"


def begun_with(path: Path, recipe: dict[str, Any]) -> dict[str, Any]:
    """Return the header field with a log's first options: those in the file, if it has the field.

    A log may be continued with other options. A log without the field stays as it is.
    """
    from elicit import AnswerLog
    from elicit.tutors.log_file import BadLog

    try:
        header = AnswerLog.read(path, []).header
    except (BadLog, OSError):
        return {RECIPE: recipe}  # a new log, or one that opening it refuses
    if "k" not in header:
        return {RECIPE: recipe}
    return {RECIPE: header[RECIPE]} if RECIPE in header else {}


def _served(
    session: Callable[[], Session],
    log: AnswerLog,
    subject: Subject,
    again: str,
    how: SessionOptions,
) -> int:
    """Serve the page until Ctrl+C, and return the exit code."""
    from elicit.person.hosts.web import serve
    from elicit.person.showing import printable

    try:
        serve(
            session,
            subject,
            how["host"],
            how["port"],
            let_others_in=how["let_others_in"],
        )
    # a package is missing, an address lets others in, a port is in use
    except (ImportError, ValueError, OSError) as error:
        return fail(error)
    kept = sum(not entry.repeat for entry in log.standing)
    print(
        f"Kept: {kept} answer{'' if kept == 1 else 's'}. To go on:\n  {printable(again)}",
        flush=True,
    )
    return 0


def problem_parser(text: str) -> Any:
    """Return a problem, given on the command line by a name or by the path of a CSV file.

    Names are those of ``part_parser``.
    """
    if text.lower().endswith(".csv"):
        return text
    found = part_parser(_PROBLEM)(text)
    return (
        replace(found, name=text) if isinstance(found, Own) else found
    )  # by this name it is found again
