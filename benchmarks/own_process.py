"""A measurement in a process of its own, one thread: ``apart`` starts it, this module, run, is it."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.learning.learning_runs import Found, Setting

ONE_THREAD = {f"{pool}_NUM_THREADS": "1" for pool in ("OPENBLAS", "OMP", "MKL", "NUMBA")}
ROOT = Path(__file__).resolve().parent.parent


class Failed(RuntimeError):
    """A measurement that ended without a result; the message is its last line."""


def apart(task: Callable[[Setting], Found], at: Setting) -> Found:
    """What ``task(at)`` finds in a new process. Raises Failed where it does not end well."""
    command = [sys.executable, "-m", "benchmarks.own_process", task.__module__, task.__name__, json.dumps(asdict(at))]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=os.environ | ONE_THREAD)
    if done.returncode:
        raise Failed((done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"])[-1])
    found: Found = json.loads(done.stdout.splitlines()[-1])
    return found


def main(module: str, name: str, settings: str) -> None:
    """Run the task and print what it found."""
    from benchmarks.learning.learning_runs import Setting

    print(json.dumps(getattr(importlib.import_module(module), name)(Setting(**json.loads(settings)))))


if __name__ == "__main__":
    main(*sys.argv[1:])
