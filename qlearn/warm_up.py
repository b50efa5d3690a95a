"""Compile all machine code of learners and comparators now, as a step of an installation.

Run it by ``python -m qlearn.warm_up``. Without it, code is compiled when it is first needed, once
on a machine.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from time import monotonic

from elicit._support import jit
from elicit._support.threads import cores
from qlearn.experiments.compile_ahead import ALL


def main() -> None:
    """Compile all machine code, by running small examples.

    As many examples run at once as there are cores. It takes a moment if the code is compiled
    already.
    """
    jobs, begun = min(len(ALL), cores()), monotonic()
    jit.first_on_this_machine()  # then only this process reports compiling
    print(
        f"qlearn: compiling with {jobs} processes, some two minutes of computing ...",
        file=sys.stderr,
        flush=True,
    )
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for part in [pool.submit(each) for each in ALL]:
            part.result()
    print(f"qlearn: compiled, in {monotonic() - begun:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
