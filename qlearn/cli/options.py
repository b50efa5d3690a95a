"""The parts that commands share: options, a progress bar, output, and failures."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from qlearn.experiments.settings import COUNT, NameOrOwn, Number, Settings

KEPT = (
    "Every run is kept in journal.jsonl as it finishes: after Ctrl-C, or worse, the same command "
    "computes what is "
    "missing."
)
LAPSE = "share of answers that the posterior takes to be given at random [it is learned]"
EXTRAS = ("joblib", "matplotlib", "pandas", "tqdm")


def fail(why: str | BaseException) -> int:
    """Print a message, or an error in words, to standard error, and return the exit code."""
    from elicit._support.file_errors import in_words

    message = why if isinstance(why, str) else in_words(why)
    print(f"qlearn: {message}", file=sys.stderr)
    return 1


def add_command(
    command: Any,
    run: Callable[..., int],
    settings: type[Settings],
    quick: Any,
    folder: str,
    texts: Mapping[str, str],
) -> Any:
    """Add a command's options to a parser; return its group of presets.

    The options are the folder to write to, the number of processes, whether to start over, and all
    settings in their groups. Settings that are not given are left out of the result. The group of
    presets has ``--quick``. ``texts`` are help texts that replace those of some settings.
    """
    command.set_defaults(command=run, settings=settings, preset={})
    command.add_argument(
        "--out",
        type=Path,
        default=Path(folder),
        metavar="DIR",
        help="directory to write to [%(default)s]",
    )
    command.add_argument(
        "--jobs",
        type=number_parser(COUNT),
        default=-1,
        metavar="N",
        help="number of processes, one thread each [one a core]",
    )
    command.add_argument(
        "--fresh", action="store_true", help="forget the runs that have finished, and start over"
    )
    presets = command.add_mutually_exclusive_group()
    add_preset(presets, "--quick", quick, "a tiny setting, to see that it works (seconds)")
    by_name = {one.name: one for one in fields(settings)}
    for title, names in settings.GROUPS.items():
        group = command.add_argument_group(title)
        for name in names:
            one = by_name[name]
            text = texts.get(name, one.metadata["help"])
            if one.default not in (None, ()):  # of these two the text says what they mean
                default = one.default if isinstance(one.default, tuple) else (one.default,)
                stated = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in default)
                text += f" [{stated}]"
            group.add_argument(
                f"--{name.replace('_', '-')}",
                default=argparse.SUPPRESS,
                help=text.replace("%", "%%"),
                **_keywords(one),
            )
    return presets


def add_preset(presets: Any, name: str, settings: dict[str, Any], text: str) -> None:
    """Add an option that stands for these settings. Options given for a setting take precedence."""
    presets.add_argument(name, dest="preset", action="store_const", const=settings, help=text)


def without(error: ModuleNotFoundError) -> int:
    """Print which package of the extra is missing, and return the exit code.

    Raises the error if it is about another package.
    """
    if (error.name or "").split(".")[0] not in EXTRAS:
        raise error
    return fail(f"{error.name} is not installed: pip install 'elicit-qlearn[ablation]'")


def frame_of(
    name: str, runs: Callable[..., Any], keys: Sequence[str], out: Path
) -> tuple[Any, int]:
    """Return the table of all runs, or of those finished before Ctrl-C, and the exit code.

    If there is nothing to show, None stands for the table. A progress bar is shown. A journal,
    runs.csv, and times.csv by these keys are written into the directory ``out``.
    """
    from qlearn.experiments.parallel import Interrupted

    try:  # before the runs, not after minutes of them
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return None, fail(f"cannot make the directory --out {out}: {error.strerror}")
    bar, show = _progress_bar(name)
    try:
        with bar:
            frame, code = runs(progress=show, journal=out / "journal.jsonl"), 0
    except Interrupted as stopped:
        frame, code = stopped.frame, 130
        print(
            f"interrupted: keeping the {len(frame)} runs that had finished; start again to go on",
            file=sys.stderr,
        )
        if frame.empty:
            return None, code
    # ImportError: a problem's package is missing. ValueError: a setting is out of range. OSError:
    # the journal is in use, or cannot be written
    except (ImportError, ValueError, OSError) as error:
        return None, fail(error)
    except BrokenExecutor:
        return None, fail(
            "a process that computed a run died (killed, or out of memory?); the runs that had "
            "finished are kept: "
            "start again to compute the rest, or with --jobs 1"
        )
    write_csv(frame[[*keys, "seconds"]], out / "times.csv")
    frame = frame.drop(columns="seconds")
    write_csv(frame, out / "runs.csv")
    return frame, code


def write_csv(frame: Any, path: Path) -> None:
    """Write a table as CSV, with the same bytes on every system."""
    frame.to_csv(path, index=False, lineterminator="\n")


def _keywords(one: Field[Any]) -> dict[str, Any]:
    """Return the keywords of a setting for argparse."""
    check = one.metadata["check"]
    many = (
        {"nargs": "*" if one.metadata["may_be_empty"] else "+"}
        if isinstance(one.default, tuple)
        else {}
    )
    if isinstance(check, Number):
        return {
            "type": number_parser(check),
            "metavar": "X" if check.kind is float else "N",
            **many,
        }
    if isinstance(check, NameOrOwn):
        choices = ",".join([*check.names, "package.module:factory"])
        return {"type": part_parser(check), "metavar": f"{{{choices}}}", **many}
    return {"action": "store_true"} if one.default is False else {"choices": check.names, **many}


def number_parser(check: Number) -> Callable[[str], float]:
    """Return a function that argparse uses to read a number."""

    def parse(text: str) -> float:
        try:
            value = check.value_of(check.kind(text))
        except ValueError:
            value = None
        if value is None:
            raise argparse.ArgumentTypeError(f"{text!r} is not {check.wanted}")
        return value

    return parse


def part_parser(check: NameOrOwn) -> Callable[[str], Any]:
    """Return a function that argparse uses to read the name of a part: ours, or the user's own.

    The module of a user's part is also looked for in the current directory.
    """

    def parse(text: str) -> Any:
        if ":" in text and not {"", os.getcwd()} & {*sys.path}:
            sys.path.insert(0, os.getcwd())  # workers have the same path
        try:
            value = check.value_of(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
        if value is None:
            choices = ", ".join([*map(repr, check.names), "or your own, as package.module:factory"])
            stem = text.removesuffix(".py")
            meant = f"; for a function of that file write {stem}:function" if stem != text else ""
            raise argparse.ArgumentTypeError(
                f"invalid choice: {text!r} (choose from {choices}){meant}"
            )
        return value

    return parse


def _progress_bar(name: str) -> tuple[Any, Callable[[int, int], None]]:
    """Return a progress bar on standard error, if that is a terminal, and a function that moves it.

    The function takes (finished, in all).
    """
    from tqdm import tqdm

    bar = tqdm(desc=name, unit="run", disable=None)

    def show(done: int, total: int) -> None:
        if bar.total is None:  # the start: rows read back say nothing about the speed
            bar.total, bar.initial, bar.n = total, done, done
            bar.refresh()
            if done:
                bar.write(
                    f"{done} of the {total} runs had finished before (--fresh starts over)",
                    file=sys.stderr,
                )
        bar.update(done - bar.n)

    return bar, show
