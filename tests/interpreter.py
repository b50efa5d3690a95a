"""A fresh interpreter, for what depends on how Python was started."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def run(code: str, folder: Path | None = None, **environment: str) -> list[str]:
    """The lines that it prints, in a folder whose modules it can import; its warnings are
    errors.
    """
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={
            **os.environ,
            "NUMBA_DISABLE_JIT": "0",
            "PYTHONPATH": path,
            "OPENBLAS_NUM_THREADS": "1",
            **environment,
        },
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert not done.returncode, done.stderr
    return done.stdout.splitlines()


def report_of(test: str) -> list[str]:
    """Return the result of the function ``report`` of a module of tests, with nothing compiled."""
    return run(f"from {test} import report; print(*report(), sep='\\n')", NUMBA_DISABLE_JIT="1")
