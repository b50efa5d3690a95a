"""``qlearn teach --web --people``: several people answer, each on a page of their own."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qlearn.cli.options import fail

if TYPE_CHECKING:
    from elicit import AnswerLog
    from qlearn.cli.teach_subjects import Taught


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """The people of a study, their logs, and the commands that are printed.

    Attributes
    ----------
    paths : mapping of str to Path
        The log of each person, by name.
    headers : mapping of str to dict
        Further fields of each log's header.
    audit : float
        The share of questions in front of which an earlier one is put again.
    seed : int
    again : str
        The command that resumes the study.
    report : str
        The command that makes the report.
    """

    paths: Mapping[str, Path]
    headers: Mapping[str, Mapping[str, Any]]
    audit: float
    seed: int
    again: str
    report: str


def run_study(
    plan: StudyPlan, make: Callable[[], Taught], host: str, port: int, let_others_in: bool
) -> int:
    """Serve the pages of a study until Ctrl+C, and return the exit code."""
    from elicit import AnswerLog, Session
    from elicit.person.hosts.study_web import serve_study
    from elicit.person.showing import printable
    from elicit.person.study.study import Study

    with ExitStack() as stack:
        try:
            taught = make()
            if taught.hint:
                print(printable(taught.hint), file=sys.stderr, flush=True)
            k, sessions = len(taught.subject.labels), dict[str, Session]()
            logs = dict[str, AnswerLog]()
            for who, path in plan.paths.items():
                header = {**taught.header, **plan.headers[who]}
                logs[who] = stack.enter_context(AnswerLog(path, k, header, who))

            def study_now() -> Study:
                for who, log in logs.items():
                    session = Session(taught.make, log, who=who, audit=plan.audit, seed=plan.seed)
                    sessions[who] = stack.enter_context(session)
                return stack.enter_context(Study(sessions, taught.subject, plan.report))

            people = tuple(logs)
            serve_study(study_now, host, port, people=people, let_others_in=let_others_in)
        # a package is missing, a problem cannot be, a log is in use, damaged, another's, or not to
        # be written, an address lets others in, a port is in use
        except (ImportError, ValueError, OSError) as error:
            return fail(error)
        except KeyboardInterrupt:
            return 130
        kept = ", ".join(f"{who} {_answers(log)}" for who, log in logs.items())
    print(printable(f"Kept: {kept}."))
    print(f"To go on:\n  {printable(plan.again)}")
    print(f"To make the report:\n  {printable(plan.report)}", flush=True)
    return 0


def _answers(log: AnswerLog) -> str:
    n = sum(not entry.repeat for entry in log.standing)
    return f"{n} answer{'' if n == 1 else 's'}"
