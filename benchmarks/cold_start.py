"""Computing time of a newcomer's first run, with nothing compiled on the disk, and
of the next ones.

    python -m benchmarks.cold_start [--before CHECKOUT] [--out FILE]

Each run is a process of its own; its seconds are those that the operating system counts, user and
system, of all its threads and processes. Cold: an empty folder for machine code. Warm: after
``python -m qlearn.warm_up``, the least of three. ``--before`` names a folder with an earlier
version, whose runs take turns with ours.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.own_process import ONE_THREAD
from benchmarks.reporting import machine, markdown, publish

ROOT = Path(__file__).parents[1]
_README = r"""
import re
blocks = re.findall(r"```python\n(.*?)```", open("README.md", encoding="utf-8").read(), re.DOTALL)
exec(next(block for block in blocks if block.startswith("import")), {})
"""
_SESSION = """
import elicit, qlearn
mdp = qlearn.icu_sepsis()
tutor = elicit.TruthfulTutor(qlearn.draw_values(mdp.k, seed=0))
comparator = elicit.{comparator}
learner = qlearn.InteractivePolicyIteration(mdp, comparator, bags=elicit.Bags(10))
queries = learner.ask()
while {more} and queries:
    learner.tell([tutor(query) for query in queries])
    queries = learner.ask()
"""
_LOOP = """
import elicit, qlearn
mdp, values = qlearn.random_mdp(n_states=50, n_actions=4, n_levels=10, seed=1)
learner = qlearn.InteractiveQLearning(mdp, elicit.PolytopeComparator(10), steps=100_000, seed=0)
qlearn.drive(learner, elicit.TruthfulTutor(values))
"""
COMPARATORS = {
    "polytope": "PolytopeComparator(mdp.k)",
    "posterior": "PosteriorComparator(mdp.k, seed=0)",
}


def cases(out: str) -> dict[str, list[str]]:
    """Return the arguments of the interpreter for each case, by name.

    ``out`` is a folder for results.
    """
    found = {
        "imports": [
            "-c",
            "import elicit, qlearn; elicit.PolytopeComparator, qlearn.InteractivePolicyIteration",
        ]
    }
    found["README's example"] = ["-c", _README]
    for name, comparator in COMPARATORS.items():
        for what, more in (("first question", False), ("whole session", True)):
            found[f"ICU-Sepsis, {name}, {what}"] = [
                "-c",
                _SESSION.format(comparator=comparator, more=more),
            ]
    found["Q-learning, 1e5 steps"] = ["-c", _LOOP]
    found["qlearn ablate --quick"] = ["-m", "qlearn", "ablate", "--quick", "--fresh", "--out", out]
    return found


def seconds(arguments: list[str], kept: Path, root: Path) -> float:
    """Computing seconds of a process with the packages of a checkout, machine code being kept in a
    folder. Raises CalledProcessError if it fails."""
    usual = {
        name: value for name, value in os.environ.items() if not name.startswith("ELICIT_COMPILE")
    }
    environment = {**usual, **ONE_THREAD, "NUMBA_CACHE_DIR": str(kept), "PYTHONPATH": str(root)}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *arguments], cwd=root, env=environment, check=True, capture_output=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def report(versions: dict[str, Path]) -> Iterator[list[str]]:
    """The page on checkouts, by what their columns are called."""
    yield ["# The first run on a machine", "", machine("one thread a process")]
    yield ["Computing seconds, as `python -m benchmarks.cold_start` has them."]
    with TemporaryDirectory() as name:
        folder, rows = Path(name), []
        for version, root in versions.items():
            seconds(["-m", "qlearn.warm_up"], folder / version, root)
        for i, (case, arguments) in enumerate(cases(str(folder / "out")).items()):
            cold = [
                seconds(arguments, folder / f"{version} {i}", root)
                for version, root in versions.items()
            ]
            turns = [
                [seconds(arguments, folder / each, versions[each]) for each in versions]
                for _ in range(3)
            ]
            rows.append(
                [case, *(f"{each:.1f}" for each in (*cold, *map(min, zip(*turns, strict=True))))]
            )
            print(rows[-1], file=sys.stderr, flush=True)
    yield markdown(
        ["", *(f"{state}{each}" for state in ("cold", "warm") for each in versions)], rows, 1
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--before", type=Path, help="a checkout of an earlier version")
    parser.add_argument("--out", type=Path, help="the file to write, in Markdown")
    given = parser.parse_args()
    publish(
        report({", before": given.before, "": ROOT} if given.before else {"": ROOT}), given.out, "0"
    )


if __name__ == "__main__":
    main()
