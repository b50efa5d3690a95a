"""Parts that all reports share: the line on the machine, tables in Markdown, means with intervals,
printing, writing.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from benchmarks import stamps

PACKAGES = ("numpy", "scipy", "cvxpy", "clarabel", "highspy", "numba")


def machine(threads: str | None = None) -> str:
    """The processor, its cores or how many threads were used, Python, and the versions of the
    libraries.
    """
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    used = threads or f"{os.cpu_count()} cores"
    return f"{_processor()}, {used}; Python {platform.python_version()}, {versions}."


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]], words: int) -> list[str]:
    """A Markdown table; the first ``words`` columns and the remarks are set left, the others
    right.
    """
    rules = ["---" if i < words or name == "remark" else "---:" for i, name in enumerate(head)]
    return [
        f"| {' | '.join(head)} |",
        f"|{'|'.join(rules)}|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def with_interval(x: ArrayLike, digits: int, signed: bool = False) -> str:
    """The mean of x (n,) and half the width of its 95% t-interval; of one number there is no
    interval.
    """
    given = np.asarray(x, dtype=np.float64)
    mean = round(float(given.mean()), digits) + 0.0  # which makes -0.0 a plain 0
    text, n = f"{mean:{'+' if signed else ''},.{digits}f}", len(given)
    return text if n < 2 else f"{text} ± {stats.t.ppf(0.975, n - 1) * stats.sem(given):,.{digits}f}"


def publish(parts: Iterable[list[str]], out: Path | None, seeds: str = "") -> None:
    """Print the parts of a report as they come, an empty line after each; at the end ``save``
    them.
    """
    lines: list[str] = []
    for part in parts:
        print("\n".join(part), end="\n\n", flush=True)
        lines += [*part, ""]
    save("\n".join(lines), out, seeds)


def save(text: str, out: Path | None, seeds: str = "") -> None:
    """Write a report to the file that ``--out`` names, if any, and make its folder.

    The file is stamped (``stamps``). ``seeds`` names the seeds of the numbers, such as "0-19".
    """
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")
        stamps.sign(out, seeds)


def main_by_seeds(
    program: str,
    report: Callable[..., Iterable[list[str]]],
    first: int,
    option: tuple[str, int, str],
    arguments: Sequence[str] | None,
) -> None:
    """Print the report of a program over seeds from ``first`` on; ``--out`` also writes it.

    ``option`` is the name, the default and the meaning of the option that says how many seeds. Runs
    that ``--journal`` keeps are taken again only if the program's sources are the same.
    """
    name, default, meaning = option
    parser = argparse.ArgumentParser(
        prog=program, description=(sys.modules[report.__module__].__doc__ or "").splitlines()[0]
    )
    parser.add_argument(f"--{name}", type=int, default=default, help=f"{meaning} [%(default)s]")
    parser.add_argument("--jobs", type=int, default=2, help="processes [%(default)s]")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    count, made_of = getattr(given, name), stamps.sources(program)
    parts = report(count, jobs=given.jobs, journal=given.journal, own=lambda cell: (made_of, {}))
    publish(parts, given.out, f"{first}-{first + count - 1}")


def main_of_people(
    program: str,
    report: Callable[[Path, bool], Iterable[list[str]]],
    seeds: str,
    arguments: Sequence[str] | None,
) -> None:
    """Print the report of a program about answers of people; ``--out`` also writes it."""
    parser = argparse.ArgumentParser(
        f"python -m {program}",
        description=(sys.modules[report.__module__].__doc__ or "").splitlines()[0],
    )
    parser.add_argument("folder", type=Path, help="of the tables that are not shipped")
    parser.add_argument("--out", type=Path, help="the page to write")
    parser.add_argument("--quick", action="store_true", help="few people and draws: rough figures")
    given = parser.parse_args(arguments)
    publish(report(given.folder, given.quick), given.out, seeds)
