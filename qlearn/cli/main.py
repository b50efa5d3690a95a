"""The command ``qlearn``. Each subcommand imports what it needs when it runs."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from qlearn.cli import ablate, figures, log, report, result, teach
from qlearn.cli.options import without


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line (default: ``sys.argv``) and return the exit code.

    Bad options end in SystemExit(2).
    """
    options = vars(parser().parse_args(argv))
    if "settings" not in options:
        try:
            code = int(options.pop("command")(**options))
            sys.stdout.flush()
        except BrokenPipeError:  # the reader, such as head, has read enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        return code
    command, settings, preset = (options.pop(name) for name in ("command", "settings", "preset"))
    where = {name: options.pop(name) for name in ("out", "jobs", "fresh")}
    try:
        code = command(settings(**preset | options), **where)
    except ModuleNotFoundError as error:
        code = without(error)
    return code


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    made = argparse.ArgumentParser(
        "qlearn", description="Reinforcement learning with ordinal rewards and a tutor."
    )
    made.add_argument(
        "--version", action=_Version, nargs=0, default=argparse.SUPPRESS, help="say the version"
    )
    commands = made.add_subparsers(title="commands", required=True, metavar="COMMAND")
    ablate.add_to(commands)
    figures.add_to(commands)
    log.add_to(commands)
    teach.add_to(commands)
    result.add_to(commands)
    report.add_to(commands)
    return made


class _Version(argparse.Action):
    """The version, looked up only when ``--version`` asks for it."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from elicit._support.distribution import version

        print(f"{parser.prog} {version()}")
        parser.exit()
