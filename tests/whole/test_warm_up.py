"""After ``python -m qlearn.warm_up`` nothing that users meet is left to compile."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from qlearn.experiments import compile_ahead
from tests.interpreter import run

ROOT = Path(__file__).parents[2]


@pytest.mark.slow  # two minutes of computing, for it compiles everything
def test_after_it_the_readme_and_every_learner_compile_nothing(tmp_path: Path) -> None:
    kept = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path),
        "NUMBA_DISABLE_JIT": "0",
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, "-m", "qlearn.warm_up"]
    for _ in range(2):  # the second time there is nothing to do
        done = subprocess.run(command, env=kept, capture_output=True, text=True, timeout=1200)
        assert done.returncode == 0
        said = done.stderr.splitlines()
        assert [line.split(",")[0].split(" with ")[0] for line in said] == [
            "qlearn: compiling",
            "qlearn: compiled",
        ]
    code = "from tests.compile_cases import report; print(*report(), sep='\\n')"
    lines = [line for line in run(code, NUMBA_CACHE_DIR=str(tmp_path)) if line.startswith("after ")]
    assert lines == [f"after {part}: []" for part in ("readme", "icu", "choices", "sessions")]


@pytest.mark.slow
@pytest.mark.parametrize("part", ["readme", "icu"])
def test_without_it_the_readme_and_a_session_compile_nothing_before_they_have_taken_long(
    part: str, tmp_path: Path
) -> None:
    code = f"""
from elicit._support import jit
jit.thread_time = lambda: 0.0
from tests.compile_cases import Compiled, {part}
jit.Compiled.patient = True
found = Compiled()
{part}()
print(found.names)
"""
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path))[-1] == "[]"


def test_it_needs_no_extra() -> None:
    code = """
import sys
for name in ("joblib", "pandas", "matplotlib", "tqdm"):
    sys.modules[name] = None
from qlearn.experiments.compile_ahead import ALL
import qlearn.warm_up
print(*(part.__name__ for part in ALL))
"""
    (said,) = run(code)
    assert said == " ".join(part.__name__ for part in compile_ahead.ALL)
    assert "certificates" in said
