"""The benchmark of first runs counts what a process computes, in the checkout that it is told."""

import subprocess
from pathlib import Path

import pytest

from benchmarks import cold_start

ROOT = Path(__file__).parents[2]


def test_it_counts_computing_seconds(tmp_path: Path) -> None:
    busy = "import time\nwhile time.process_time() < {}: pass"
    short, long = (
        cold_start.seconds(["-c", busy.format(each)], tmp_path, ROOT) for each in (0.1, 0.6)
    )
    assert long >= 0.6
    assert short < long
    with pytest.raises(subprocess.CalledProcessError):
        cold_start.seconds(["-c", "import no_such_module"], tmp_path, ROOT)


def test_its_processes_are_patient(tmp_path: Path) -> None:
    code = "import os, sys; sys.exit(int(bool(os.environ.get('ELICIT_COMPILE_FIRST'))))"
    cold_start.seconds(["-c", code], tmp_path, ROOT)
