"""Cells that the tests of sweeps and ablations compute.

They have a module of their own, so that a worker starts without the rest."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

TINY: dict[str, Any] = {
    "problems": ["random"], "states": 8, "actions": 3, "levels": 4, "seeds": 1, "steps": 200,
    "tolerance": 0.05,
    "max_sweeps": 80, "max_queries": 40, "n_boot": 10, "error_rates": (0.0, 0.15),
    "audit": 0.3, "audit_steps": 20, "audit_sweeps": 8,
}  # fmt: skip
"""The settings of an ablation that takes seconds."""
CELLS = [{"x": x, "name": name} for name in ("a", "b") for x in range(4)]


def row(
    cell: dict[str, Any], scale: float = 1.0, log: str | None = None, pause: float = 0.0
) -> dict[str, Any]:
    """A row that is not the same twice if its floats lose a bit; ``log`` gets a line each time it
    is computed.
    """
    time.sleep(pause)
    if log is not None:
        note(log, cell)
    x = cell["x"]
    numbers = {"third": scale * (x + 1) / 3, "ends": [float("nan"), float("-inf"), -0.0, 5e-324]}
    return {"x": x, **numbers, "v": np.sqrt(np.arange(x + 2.0)), "of": "é\n"}


def note(log: str, cell: dict[str, Any]) -> None:
    with open(log, "a", encoding="utf-8") as file:
        file.write(f"{cell['name']}{cell['x']}\n")


def where(cell: dict[str, Any], pause: float = 0.2) -> dict[str, Any]:
    time.sleep(pause)
    pools = [pool["num_threads"] for pool in threadpool_info()]
    return {"pid": os.getpid(), "threads": pools, "numba": os.environ.get("NUMBA_NUM_THREADS")}


def deadly(cell: dict[str, Any], marker: str) -> int:
    """Dies as if it were killed, at the third cell, unless the file ``marker`` is there."""
    if cell == CELLS[2] and not Path(marker).exists():
        time.sleep(0.3)  # let the others get on
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return int(cell["x"]) + 1
