"""Findings of a type checker in a user's program: constructors accept more than they store."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = ROOT / "tests" / "typed_program.py"


@pytest.mark.slow  # make lint says the same of the program as it is
def test_plain_functions_lists_and_names_are_taken_and_another_tutor_is_not(tmp_path):
    pytest.importorskip("mypy")
    text = PROGRAM.read_text(encoding="utf-8")
    (tmp_path / "program.py").write_text(
        text.replace("  # type: ignore[assignment]", ""), encoding="utf-8"
    )
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--no-error-summary",
        str(tmp_path / "program.py"),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert not done.stderr, done.stderr
    (said,) = (
        line for line in done.stdout.splitlines() if ": error:" in line
    )  # only this is wrong
    assert f"program.py:{len(text.splitlines())}: error: Incompatible types in assignment" in said
