"""A fresh interpreter, for what depends on how Python was started; and this one, for the rest."""

import os
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
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


def printed_here(code: str) -> str:
    """Return the output of a program that may run in this interpreter, which is soon started."""
    with redirect_stdout(StringIO()) as said:
        exec(code, {"__name__": "__main__"})
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
    return said.getvalue()


def report_of(test: str, name: str = "report") -> list[str]:
    """Return the result of a function of a module of tests, with nothing compiled."""
    return run(f"from {test} import {name}; print(*{name}(), sep='\\n')", NUMBA_DISABLE_JIT="1")
