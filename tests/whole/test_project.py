"""What holds for the project as a whole: imports run one way and stay light, and the README tells the truth."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def imported_modules(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("path", sorted((ROOT / "elicit").glob("*.py")), ids=lambda path: path.name)
def test_elicit_never_imports_qlearn(path):
    assert not {name for name in imported_modules(path) if name.split(".")[0] == "qlearn"}


def test_no_module_of_elicit_or_qlearn_imports_in_a_circle():
    graph = {
        f"{path.parent.name}.{path.stem}": imported_modules(path)
        for package in ("elicit", "qlearn")
        for path in (ROOT / package).glob("*.py")
        if path.stem != "__init__"
    }
    done: set[str] = set()
    while ready := {name for name, needs in graph.items() if name not in done and not (needs & graph.keys()) - done}:
        done |= ready
    assert done == set(graph)


@pytest.mark.parametrize("package", ["elicit", "qlearn"])
def test_importing_a_package_stays_light(package):
    heavy = ("cvxpy", "clarabel", "numba", "matplotlib", "pandas", "scipy.optimize", "networkx", "joblib")
    code = f"import sys, {package}; print([name for name in {heavy!r} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("package", ["elicit", "qlearn"])
def test_every_public_name_can_be_imported_whatever_was_imported_before(package):
    code = (
        f"import importlib, pkgutil, {package} as p\n"
        "before = {name: getattr(p, name) for name in p.__all__}\n"
        "for module in pkgutil.iter_modules(p.__path__):\n"
        f"    importlib.import_module(f'{package}.{{module.name}}')\n"
        "assert all(getattr(p, name) is value for name, value in before.items())\n"
        "assert set(p.__all__) <= set(dir(p))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_example_of_the_readme_runs_as_printed():
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    example = next(block for block in blocks if block.startswith("import"))
    shown = subprocess.run([sys.executable, "-c", example], capture_output=True, text=True, check=True).stdout
    assert "questions" in shown
    worst = float(shown.rsplit(":", 1)[1])
    assert 0 <= worst <= 0.001  # the tolerance that the example asks for


def test_the_constraints_name_versions_and_no_host():
    lines = (ROOT / "constraints.txt").read_text().split()
    assert lines
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line) for line in lines)


@pytest.mark.parametrize("name", ["exploration.Decay", "gym_environments.frozen_lake", "strategies.max_regret"])
def test_what_the_readme_writes_with_dots_is_there_after_import_qlearn_alone(name: str) -> None:
    done = subprocess.run([sys.executable, "-c", f"import qlearn; qlearn.{name}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
