"""Run the contest, or repeat some of its rows.

    python -m benchmarks.contest.run --runs 2                  rough figures on development seeds
    python -m benchmarks.contest.run --part held_out           all runs of the main tables
    python -m benchmarks.contest.run --part confirmation       all runs on seeds used once
    python -m benchmarks.contest.run --check 40                repeat 40 rows: the same digits?

The rows are committed, compressed: ``benchmarks/contest/rows.csv.xz``, one row a run.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks import stamps
from benchmarks.contest import problems
from benchmarks.contest.harness import as_seed, play
from benchmarks.contest.methods import METHODS
from qlearn.experiments.parallel import Cell, sweep

ROWS = Path(__file__).parent / "rows.csv.xz"
KEY = ("problem", "tutor", "seed", "method")
TIMED = "seconds"
OURS = "ours: "  # how the names of our methods begin
MAY_DIFFER = 0.05  # share of the sample: rows of others, on another kind of processor
PARTS = ("held_out", "confirmation", "development")


def run(cell: Cell) -> dict[str, Any]:
    """Play one run: a method, a problem and its hidden scale, and a tutor."""
    name, seed = str(cell["problem"]), int(cell["seed"])
    mdp = problems.problem(name, seed)
    values = problems.scale(mdp.k, seed)
    told = problems.TUTORS[str(cell["tutor"])]
    tutor = problems.tutor(told.law, values, seed)
    method = METHODS[str(cell["method"])].make()
    return play(method, mdp, values, tutor, told, int(cell["questions"]), as_seed(cell))


def cells(
    names: Sequence[str],
    runs: Mapping[str, Mapping[str, int]],
    first: int,
    questions: int,
    methods: Sequence[str] = (*METHODS,),
) -> Iterator[dict[str, Any]]:
    """Yield the runs, seed by seed: every method meets the same problems, scales and tutors.

    ``runs`` has, by tutor, the numbers of runs of methods that promise a loss with a probability,
    and of the others.
    """
    most = max(max(counts.values()) for counts in runs.values())
    order = [*problems.PROBLEMS], [*problems.plan()["held_out"]["runs"]]
    for i in range(most):
        for name in names:
            for tutor, counts in runs.items():
                cell = order[0].index(name) + order[1].index(tutor)
                for method in methods:
                    entry = METHODS[method]
                    many = counts["promising" if entry.promises else "others"]
                    if entry.runs:  # each kind of scale in turn, in every fourth run
                        turn = (i + cell) % 4 == 0
                        many = min(many, 4 * entry.runs) if turn else 0
                    if i < many and entry.only in ("", tutor):
                        yield {
                            "problem": name,
                            "tutor": tutor,
                            "seed": first + i,
                            "method": method,
                            "questions": questions,
                        }


def planned(part: str) -> list[dict[str, Any]]:
    """Return the runs of a part of the plan, ``held_out`` or ``confirmation``."""
    plan = problems.plan()[part]
    told = plan["problems"], plan["runs"], plan["first_seed"], plan["questions"]
    return [cell for cell in cells(*told) if quick_enough(part, cell)]


def quick_enough(part: str, cell: Mapping[str, Any]) -> bool:
    """Return whether the method plays this problem in this part: slow ones play some only."""
    slow = problems.plan()[part].get("slow_problems", problems.PROBLEMS)
    return not METHODS[str(cell["method"])].runs or cell["problem"] in slow


def flat(cell: Mapping[str, Any], row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a run as a row of the table: losses in units of 1e-9."""
    columns: dict[str, Any] = {name: cell[name] for name in KEY}
    columns |= {name: row[name] for name in ("asked", "done", "wrong", "seconds")}
    for place in ("worst", "initial"):
        columns |= {f"{place} {n}": round(1e9 * loss) for n, loss in enumerate(row[place])}
    return columns


def load(part: str = "held_out") -> pd.DataFrame:
    """Return the committed rows of a part of the plan, with losses as shares of the value range."""
    frame = pd.read_csv(ROWS)
    confirmed = frame["seed"] >= problems.plan()["confirmation"]["first_seed"]
    frame = frame[confirmed if part == "confirmation" else ~confirmed].reset_index(drop=True)
    losses = [name for name in frame if str(name).startswith(("worst", "initial"))]
    frame[losses] = frame[losses] / 1e9
    return frame


@dataclass(frozen=True)
class Differing:
    """Numbers of repeated rows that differ from the committed ones in anything but seconds.

    Our methods are the same on every processor. Some of the others choose by what LAPACK computes,
    which rounds differently on another kind of processor.
    """

    ours: int
    others: int


def check(count: int) -> Differing:
    """Repeat a sample of the committed rows, and count those that differ.

    Rows of methods whose packages are not installed are left out of the sample.
    """
    frame = pd.read_csv(ROWS)
    playable = frame["method"].map(lambda name: METHODS[str(name)].playable)
    left_out = sorted(set(frame.loc[~playable, "method"]))
    if left_out:
        print(f"left out, as their packages are not installed: {'; '.join(left_out)}")
    frame = frame[playable]
    # by hashes of the keys, so that everybody repeats the same sample
    order = [
        zlib.crc32("/".join(str(row[name]) for name in KEY).encode())
        for row in frame[list(KEY)].to_dict("records")
    ]
    chosen = frame.iloc[pd.Series(order).sort_values(kind="stable").index[:count]]
    questions = max(int(str(name).split()[1]) for name in frame if str(name).startswith("worst"))
    differing = []
    for row in chosen.to_dict("records"):
        cell = {name: row[name] for name in KEY} | {"questions": questions}
        again = flat(cell, run(cell))
        differs = [name for name in again if name != TIMED and again[name] != row[name]]
        if differs:
            differing.append(str(row["method"]))
        said = f"differs in {', '.join(map(str, differs))}" if differs else "same"
        print(" | ".join(str(row[name]) for name in KEY), said, sep=": ", flush=True)
    same = count - len(differing)
    print(f"{same} of {count} rows are the same in every digit but their seconds")
    ours = sum(name.startswith(OURS) for name in differing)
    return Differing(ours=ours, others=len(differing) - ours)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.contest.run", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--check", type=int, metavar="N", help="repeat N of the committed rows")
    parser.add_argument("--part", choices=PARTS, default="development", help="which seeds")
    parser.add_argument("--runs", type=int, help="runs of each problem and tutor")
    parser.add_argument("--problems", nargs="+", choices=problems.PROBLEMS)
    parser.add_argument("--tutors", nargs="+", choices=[*problems.TUTORS])
    parser.add_argument("--methods", nargs="+", choices=[*METHODS])
    parser.add_argument("--jobs", type=int, default=-1, help="processes (default: one a core)")
    parser.add_argument("--journal", type=Path, help="file that keeps finished runs")
    parser.add_argument("--out", type=Path, help="where to write the rows, and rows.stamp beside")
    given = parser.parse_args(arguments)
    if given.check is not None:
        found = check(given.check)
        return int(found.ours > 0 or found.others > MAY_DIFFER * given.check)
    from benchmarks.contest import run as here  # the name that workers and the journal know

    plan = problems.plan()
    chosen = plan[given.part]
    runs = dict(chosen.get("runs", plan["held_out"]["runs"]))
    if given.runs is not None:
        runs = {name: {"promising": given.runs, "others": given.runs} for name in runs}
    runs = {name: runs[name] for name in given.tutors or runs}
    todo = list(
        cells(
            given.problems or chosen["problems"],
            runs,
            chosen["first_seed"],
            plan["held_out"]["questions"],
            given.methods or [*METHODS],
        )
    )
    todo = [cell for cell in todo if quick_enough(given.part, cell)]
    if missing := {METHODS[str(cell["method"])].needs for cell in todo if not _playable(cell)}:
        parser.error(f"install {', '.join(sorted(missing))}, or name other --methods")
    made_of = stamps.sources("benchmarks.contest.run")
    rows = sweep(
        here.run,
        todo,
        own=lambda cell: (made_of, {}),
        journal=given.journal,
        jobs=given.jobs,
        progress=_progress,
    )
    frame = pd.DataFrame([flat(cell, row) for cell, row in zip(todo, rows, strict=True)])
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        frame.to_csv(given.out, index=False)
        command = "python -m benchmarks.contest.run --part PART --journal FILE --out FILE"
        stamp = stamps.made_now(command, "of held_out.toml", "benchmarks.contest.run")
        given.out.with_name("rows.stamp").write_text(f"{stamp}\n", encoding="utf-8")
    else:
        last = [name for name in frame if str(name).startswith("initial")][-1]
        shown = frame.groupby(["tutor", "method"], sort=False)
        print(shown[["asked", "done", "seconds", "initial 5", "initial 10", last]].mean())
    return 0


def _playable(cell: Mapping[str, Any]) -> bool:
    return METHODS[str(cell["method"])].playable


def _progress(done: int, total: int) -> None:
    if done % 50 == 0 or done == total:
        print(f"{done} of {total} runs", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
