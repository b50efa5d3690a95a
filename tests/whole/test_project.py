"""Rules for the project as a whole: imports run one way and stay light, and the README is true."""

import ast
import pkgutil
import re
from importlib.metadata import version
from pathlib import Path

import pytest

import elicit
import qlearn
from tests.interpreter import printed_here, run
from tests.syntax import imports, parsed
from tests.thoroughness import quick_first, thorough

ROOT = Path(__file__).resolve().parents[2]
ORDER = (  # a folder imports from those before it; folders side by side do not import each other
    ("elicit._support",),
    ("elicit.model",),
    ("elicit.lp",),
    ("elicit.decision",),
    ("elicit.comparators",),
    ("elicit.comparators.bradley_terry", "elicit.comparators.polytope"),
    ("elicit.tutors",),
    ("elicit.asking", "elicit.people"),
    ("elicit.diagnostics", "elicit.person.course"),
    ("elicit.person",),
    ("elicit.person.study",),
    ("elicit.person.hosts",),
    ("elicit",),  # the modules at the top, and __init__ itself
    ("elicit.plot", "elicit.testing"),
    ("qlearn.mdp", "qlearn.environments"),
    ("qlearn.problems.families",),
    ("qlearn.problems",),
    ("qlearn.certificates",),
    ("qlearn.learners.loops", "qlearn.learners.rounds"),
    ("qlearn.learners",),
    ("qlearn.panel",),
    ("qlearn.training",),
    ("qlearn.experiments",),
    ("qlearn.paper",),
    ("qlearn.cli.conclusions",),
    ("qlearn.cli",),
    ("qlearn",),
)
HEIGHT = {folder: height for height, folders in enumerate(ORDER) for folder in folders}
MOST = 12  # modules in a folder: about a dozen


def modules(*folders: str) -> dict[str, Path]:
    """Every Python file in these folders and below, by the name under which it is imported."""
    found = {}
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


CODE = modules("elicit", "qlearn")
TESTS = modules("tests")


def imported(path: Path, known: dict[str, Path], for_types: bool = True) -> set[str]:
    """The known modules that a file imports, also within functions, and perhaps for type checks
    only.
    """
    names = set()
    for node, is_for_types in imports(path):
        if is_for_types and not for_types:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            assert not node.level, f"{path}: relative import"
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else str(node.module) for name in whole}
    return names & known.keys()


def folder_of(module: str) -> str:
    """The folder in ``ORDER`` that a module lies in."""
    parts = module.split(".")
    return next(name for n in range(len(parts), 0, -1) if (name := ".".join(parts[:n])) in HEIGHT)


def test_imports_run_one_way():
    wrong = set()
    for module, path in CODE.items():
        if path.name == "__init__.py" and module in ("elicit", "qlearn"):
            continue  # which gives names from everywhere
        here = folder_of(module)
        for name in imported(path, CODE):
            there = folder_of(name)
            if there != here and HEIGHT[there] >= HEIGHT[here]:
                wrong.add((module, name))
    assert not wrong


def test_no_module_of_elicit_or_qlearn_imports_in_a_circle():
    graph = {
        name: imported(path, CODE, for_types=False)
        - {name, "elicit", "qlearn"}  # which import late
        for name, path in CODE.items()
        if name not in ("elicit", "qlearn")
    }
    done: set[str] = set()
    while ready := {name for name, needs in graph.items() if name not in done and not needs - done}:
        done |= ready
    assert done == graph.keys()


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in CODE.values()}), ids=lambda path: path.name
)
def test_a_folder_says_what_it_holds_and_is_no_heap(folder):
    says = ast.get_docstring(parsed(folder / "__init__.py"))
    assert says
    assert says.split("\n\n")[0].endswith(".")
    assert folder_of(".".join(folder.relative_to(ROOT).parts)).split(".")[-1] == folder.name
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST
    if folder.name != "_support":
        described = (ROOT / "docs" / "carrying-on.md").read_text(encoding="utf-8")
        assert re.search(rf"\b{folder.name}/", described)


def test_no_test_imports_another_test():
    pairs = {(test, name) for test, path in TESTS.items() for name in imported(path, TESTS)}
    assert not {(test, name) for test, name in pairs if "test_" in name}


@pytest.mark.parametrize("package", ["elicit", "qlearn"])
def test_importing_a_package_stays_light(package):
    heavy = (
        "cvxpy",
        "clarabel",
        "numba",
        "matplotlib",
        "pandas",
        "scipy.optimize",
        "networkx",
        "joblib",
        "gymnasium",
    )
    code = f"import sys, {package}; print([name for name in {heavy!r} if name in sys.modules])"
    assert run(code) == ["[]"]


@pytest.mark.parametrize(
    "names",
    quick_first(
        [
            ["elicit.objectives.as_levels", "elicit.testing.check_comparator"],
            [
                "qlearn.exploration.Decay",
                "qlearn.gym_environments.frozen_lake",
                "qlearn.strategies.max_regret",
            ],
            ["elicit.graph.preference_graph", "elicit.plot.polytope"],  # import slow packages
            ["qlearn.ablation.ablate"],
        ],
        2,
    ),
)
def test_what_the_readme_writes_with_dots_is_there_after_one_import_and_found_by_completion(names):
    package = names[0].split(".")[0]
    # each name in a process of its own, in which nothing but the package was imported before
    code = f"""
import os, {package}
for name in {names!r}:
    if not os.fork():
        print(name.split(".")[1] in dir({package}), eval(name).__name__, flush=True)
        os._exit(0)
    assert os.wait()[1] == 0
"""
    assert run(code) == [f"True {name.split('.')[2]}" for name in names]


@pytest.mark.parametrize("package", ["elicit", "qlearn"])
def test_the_version_is_that_of_the_installed_distribution_and_looked_up_when_touched(package):
    code = (
        f"import sys, {package} as p; print('elicit._support.distribution' in sys.modules, "
        "'__version__' in dir(p))\n"
        "print(p.__version__)"
    )
    assert run(code) == ["False True", version("elicit-qlearn")]


@pytest.mark.parametrize("package", ["elicit", "qlearn"])
def test_where_nothing_is_installed_there_is_no_version(package):
    code = (
        "import importlib.metadata as m, sys\n"
        "def version(name):\n    raise m.PackageNotFoundError(name)\n"
        "m.version = version\n"
        f"import {package}\n"
        f"try:\n    {package}.__version__\nexcept AttributeError as error:\n    print(error)\n"
    )
    assert run(code) == [
        "elicit-qlearn is not installed, so its version is not known; in a clone: pip install -e "
        "'.[all]'"
    ]


def test_a_module_whose_extra_is_missing_says_what_installs_it():
    code = (
        "import sys, qlearn; sys.modules['pandas'] = None\n"
        "try:\n    qlearn.ablation\nexcept ModuleNotFoundError as error:\n    print(error)\n"
    )
    assert run(code) == ["pandas is not installed: pip install 'elicit-qlearn[ablation]'"]


@pytest.mark.parametrize("package", [elicit, qlearn])
def test_no_module_takes_the_place_of_a_public_name(package):
    """Importing a module sets it as an attribute of the folder that it lies in."""
    assert not {module.name for module in pkgutil.iter_modules(package.__path__)} & {
        *package.__all__
    }
    assert set(package.__all__) <= set(dir(package))
    assert all(getattr(package, name, None) is not None for name in package.__all__)


@pytest.mark.slow
def test_every_public_name_can_be_imported_whatever_was_imported_before():
    code = """
import importlib, pkgutil, elicit, qlearn
before = {package: {name: getattr(package, name) for name in package.__all__} for package in (elicit, qlearn)}
for package, names in before.items():
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
for package, names in before.items():
    assert all(getattr(package, name) is value for name, value in names.items())
    assert set(package.__all__) <= set(dir(package))
"""  # noqa: E501
    run(code)


def test_the_example_of_the_readme_runs_as_printed():
    text = (ROOT / "README.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (printed,) = re.findall(r"```text\n(.*?)```", text, re.DOTALL)
    assert code.startswith("import")
    assert "qlearn.solve(" in code
    shown = "\n".join(run(code)) + "\n" if thorough() else printed_here(code)
    assert shown == printed
    said = r"Truly lost: ([0-9.]+)%\. Without a question: ([0-9.]+)%\."
    lost, unasked = map(float, re.fullmatch(said, printed.splitlines()[-1]).groups())
    assert 0 <= lost <= 1 < unasked  # 1% is the tolerance that the example asks for


def test_the_readme_is_short():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 100
    beside = r"```.*?```|<!-- begin (\S+) -->.*?<!-- end \1 -->|\]\([^)]*\)"  # code, tables, links
    assert len(re.sub(beside, "", text, flags=re.DOTALL).split()) <= 950


def test_the_constraints_name_versions_and_no_host():
    lines = (ROOT / "constraints.txt").read_text().split()
    assert lines
    assert all(re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line) for line in lines)
