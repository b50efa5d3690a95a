"""What the commands share: kinds of numbers, options with their defaults, a progress bar, and how failure is said."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any, TypeAlias

Groups: TypeAlias = Mapping[str, Mapping[str, tuple[dict[str, Any], Any, str]]]
"""By group and option: argparse keywords, default, help."""
EXTRAS = ("joblib", "matplotlib", "pandas", "threadpoolctl", "tqdm")


def fail(message: str) -> int:
    """Say it on the error stream; returns the exit code."""
    print(f"qlearn: {message}", file=sys.stderr)
    return 1


def number(kind: type[int] | type[float], holds: Callable[[float], bool], wanted: str) -> Callable[[str], float]:
    """An argparse type: finite numbers of a kind for which something holds."""

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and holds(value)):
            raise argparse.ArgumentTypeError(f"{text!r} is not {wanted}")
        return value

    return parse


COUNT = number(int, lambda n: n >= 1, "a whole number of at least 1")
FROM_0 = number(int, lambda n: n >= 0, "a whole number of at least 0")
LEVELS = number(int, lambda n: 2 <= n <= 100, "a whole number from 2 to 100")
SHARE = number(float, lambda x: 0 <= x <= 1, "a number from 0 to 1")
INNER = number(float, lambda x: 0 < x < 1, "a number strictly between 0 and 1")
DISCOUNT = number(float, lambda x: 0 <= x < 1, "a number of at least 0 and below 1")
ERROR_RATE = number(float, lambda x: 0 <= x < 0.5, "a number of at least 0 and below 0.5")
LAPSE = number(float, lambda x: 0 <= x < 1, "a number of at least 0 and below 1")
PARTICLES = number(int, lambda n: n >= 20, "a whole number of at least 20")
POSITIVE = number(float, lambda x: x > 0, "a number above 0")
SCALE = number(float, lambda x: x >= 0, "a number of at least 0")


def add_where(command: argparse.ArgumentParser, folder: str) -> None:
    """Options that every command has: where to, how many processes, whether to start over."""
    command.add_argument(
        "--out", type=Path, default=Path(folder), metavar="DIR", help="directory to write to [%(default)s]"
    )
    command.add_argument(
        "--jobs", type=COUNT, default=-1, metavar="N", help="number of processes, one thread each [one a core]"
    )
    command.add_argument("--fresh", action="store_true", help="forget the runs that have finished, and start over")


def add_groups(command: argparse.ArgumentParser, groups: Groups) -> None:
    """The options of all groups; what is not given is left out, so that a preset or the library has its say."""
    for title, options in groups.items():
        group = command.add_argument_group(title)
        for name, (keywords, default, text) in options.items():
            stated = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in _as_tuple(default))
            metavar: Any = {}
            if "choices" not in keywords and "action" not in keywords:
                metavar = {"metavar": "X" if isinstance(_as_tuple(default)[0], float) else "N"}
            flag = f"--{name.replace('_', '-')}"
            group.add_argument(flag, default=argparse.SUPPRESS, help=f"{text} [{stated}]", **keywords, **metavar)


def defaults_of(groups: Groups) -> dict[str, Any]:
    """The default of every option."""
    return {name: default for group in groups.values() for name, (_, default, _) in group.items()}


def without(error: ModuleNotFoundError) -> int:
    """Say which package of the extra is missing; returns the exit code. Raises the error where it is none of them."""
    if (error.name or "").split(".")[0] not in EXTRAS:
        raise error
    return fail(f"{error.name} is not installed: pip install 'elicit-qlearn[ablation]'")


def frame_of(name: str, runs: Callable[..., Any], out: Path) -> tuple[Any, int]:
    """The frame of all runs, or of those finished before Ctrl-C, with a bar and a journal in the directory ``out``,
    and the exit code; None for the frame where there is nothing to show."""
    from qlearn.experiments.run import Interrupted

    try:  # before the runs, not after minutes of them
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return None, fail(f"cannot make the directory --out {out}: {error.strerror}")
    bar, show = progress_bar(name)
    try:
        with bar:
            return runs(progress=show, journal=out / "journal.jsonl"), 0
    except Interrupted as stopped:
        kept = len(stopped.frame)
        print(f"interrupted: keeping the {kept} runs that had finished; start again to go on", file=sys.stderr)
        return stopped.frame if kept else None, 130
    # a problem's package is missing; options that do not go together; a journal that is in use, or not to be written
    except (ImportError, ValueError, OSError) as error:
        return None, fail(str(error))
    except BrokenExecutor:
        return None, fail(
            "a process that computed a run died, and again when it was tried once more (out of memory?); all other "
            "runs are kept: start again to try the rest, or with --jobs 1"
        )


def progress_bar(name: str) -> tuple[Any, Callable[[int, int], None]]:
    """A bar that counts runs on the error stream of a terminal, and what moves it to (finished, in all)."""
    from tqdm import tqdm

    bar = tqdm(desc=name, unit="run", disable=None)

    def show(done: int, total: int) -> None:
        if bar.total is None:  # the start: what is read back says nothing about the speed
            bar.total, bar.initial, bar.n = total, done, done
            bar.refresh()
            if done:
                bar.write(f"{done} of the {total} runs had finished before (--fresh starts over)", file=sys.stderr)
        bar.update(done - bar.n)

    return bar, show


def _as_tuple(default: Any) -> tuple[Any, ...]:
    return default if isinstance(default, tuple) else (default,)
