"""``qlearn teach --web --people``: several people answer, each on a page of their own."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from qlearn.cli.options import fail
from qlearn.cli.teach import (
    SessionOptions,
    StudySettings,
    address_options,
    begun_with,
    in_a_path,
    short_name,
)

if TYPE_CHECKING:
    from elicit import Session


def run_study(settings: StudySettings, people: Sequence[str], how: SessionOptions) -> int:
    """Serve the pages of a study until Ctrl+C, and return the exit code."""
    from elicit import AnswerLog, Session
    from elicit.person.hosts.study_web import serve_study
    from elicit.person.showing import printable
    from elicit.person.study.study import Study
    from qlearn.cli.teach_subjects import taught_by

    problem, comparator, days, unit, seed, tolerance, audit = vars(settings).values()
    name = problem if isinstance(problem, str) else problem.name
    short = short_name(name)
    paths = {who: Path(f"answers-{short}-{in_a_path(who)}.jsonl") for who in people}
    report = shlex.join(["qlearn", "report", *map(str, paths.values()), "--out", f"study-{short}"])
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
            k, sessions = len(taught.subject.labels), dict[str, Session]()
            for who, path in paths.items():
                header = {**taught.header, **begun_with(path, recipe)}
                log = stack.enter_context(AnswerLog(path, k, header, who))
                session = Session(taught.make, log, who=who, audit=audit, seed=seed)
                sessions[who] = stack.enter_context(session)
            study = stack.enter_context(Study(sessions, taught.subject, report))
            serve_study(study, how["host"], how["port"], let_others_in=how["let_others_in"])
        # a package is missing, a problem cannot be, a log is in use, damaged, another's, or not to
        # be written, an address lets others in, a port is in use
        except (ImportError, ValueError, OSError) as error:
            return fail(str(error))
        except KeyboardInterrupt:
            return 130
        kept = ", ".join(f"{who} {_answers(session)}" for who, session in sessions.items())
    again = _again(settings, name, people, how)
    print(printable(f"Kept: {kept}."), flush=True)
    print(
        f"To go on:\n  {printable(again)}\nTo make the report:\n  {printable(report)}", flush=True
    )
    return 0


def _answers(session: Session) -> str:
    n = sum(not entry.retracted and not entry.repeat for entry in session.log)
    return f"{n} answer{'' if n == 1 else 's'}"


def _again(settings: StudySettings, name: str, people: Sequence[str], how: SessionOptions) -> str:
    """Return the command that goes on."""
    invited = how["invite"] is not None
    some = ["--invite", str(len(people))] if invited else ["--people", ",".join(people)]
    again = ["qlearn", "teach", "--web", *some, "--problem", name]
    again += ["--comparator", settings.comparator, "--days", str(settings.days)]
    again += ["--seed", str(settings.seed)]
    again += [] if settings.unit is None else ["--unit", settings.unit]
    again += [] if name.lower().endswith(".csv") else ["--tolerance", str(settings.tolerance)]
    again += ["--audit", str(settings.audit), *address_options(how)]
    return shlex.join(again)
