"""A measurement in a process of its own, one thread: ``apart`` starts it; this module, run as a
script, is it.
"""

from __future__ import annotations

import importlib
import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OPENBLAS", "OMP", "MKL", "NUMBA")}
ROOT = Path(__file__).resolve().parent.parent


class Failed(RuntimeError):
    """A measurement that ended without a result; the message is its last line."""


def apart(task: Callable[..., T], *arguments: Any, limit: float | None = None) -> T:
    """Return the result of ``task(*arguments)``, a function of a module, from a new process.

    Raises Failed if the process does not end well, or not within ``limit`` seconds.
    """
    spec = sys.modules[
        task.__module__
    ].__spec__  # whose name is the module's also where it runs as __main__
    module = spec.name if spec else task.__module__
    given = pickle.dumps((module, task.__name__, arguments), protocol=5)
    command = [sys.executable, "-m", "benchmarks.own_process"]
    settings: dict[str, Any] = {"cwd": ROOT, "env": os.environ | ONE_THREAD, "timeout": limit}
    try:
        done = subprocess.run(command, input=given, capture_output=True, **settings)
    except subprocess.TimeoutExpired:
        raise Failed(f"not done after {limit:g} s") from None
    if done.returncode:
        raise Failed(
            (done.stderr.decode().strip().splitlines() or [f"it ended with {done.returncode}"])[-1]
        )
    found: T = pickle.loads(done.stdout)
    return found


def memory(field: str) -> int:
    """Bytes of this process in use now (VmRSS) or at most so far (VmHWM). Elsewhere than on Linux
    only the latter is known; there, and on Linux rather not, it includes the peak of the parent
    process."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith(field))
        return 1024 * int(line.split()[1])
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


def main() -> None:
    """Run the task that is read, and write what it found; what it prints goes where errors go."""
    results, sys.stdout = sys.stdout, sys.stderr
    module, name, arguments = pickle.load(sys.stdin.buffer)
    found = getattr(importlib.import_module(module), name)(*arguments)
    pickle.dump(found, results.buffer)
    results.flush()


if __name__ == "__main__":
    main()
