"""Reports as people read them: a benchmark's quick report, its tables, a picture's intervals."""

import shlex
import subprocess
import sys
from pathlib import Path

from matplotlib.axes import Axes

from benchmarks import stamps

ROOT = Path(__file__).resolve().parents[1]


def quick_report(module: str, folder: Path, *settings: str) -> str:
    """Return the text that ``python -m module --quick`` prints without a warning.

    It also writes it, stamped, to a new folder.
    """
    out = folder / "new folder" / "report.md"
    command = [sys.executable, "-W", "error", "-m", module, "--quick", *settings, "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    text = out.read_text(encoding="utf-8")
    stamp = stamps.of(out)
    assert stamp is not None
    assert shlex.split(stamp.command)[1:] == command[3:]  # all but -W error
    text = stamps.without(text)
    assert done.stdout.strip() == text.strip()
    return text


def bars(axes: Axes) -> list[tuple[float, float]]:
    """The ends of the error bars."""
    return [
        (float(low), float(high))
        for (_, low), (_, high) in (s for c in axes.collections for s in c.get_segments())
    ]
