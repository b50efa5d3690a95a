"""The pages of the site: names, links, numbers, pictures and examples are what the code and the
results say.
"""

import doctest
import re
import subprocess
import sys
from importlib import import_module
from inspect import ismodule
from pathlib import Path
from pkgutil import resolve_name

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [*ROOT.glob("*.md"), *DOCS.rglob("*.md"), *(ROOT / "benchmarks").glob("*.md")]
REFERENCE = {
    package: (DOCS / "reference" / f"{package}.md").read_text(encoding="utf-8")
    for package in ("elicit", "qlearn")
}
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)


def documented(package: str) -> list[str]:
    """Return the names that a page of the reference has a directive for, without the package's."""
    return re.findall(
        rf"^\.\. (?:auto(?!module)|py:)\w+:: {package}\.([\w.]+)", REFERENCE[package], re.MULTILINE
    )


@pytest.mark.parametrize("package", REFERENCE)
def test_every_public_name_is_in_the_reference_once_and_has_a_docstring(package):
    module, names = import_module(package), documented(package)
    public = {name for name in dir(module) if not ismodule(getattr(module, name))} - {"__version__"}
    assert {name for name in names if "." not in name} == public >= set(module.__all__)
    assert len(names) == len(set(names))
    for name in names:
        assert resolve_name(f"{package}.{name}").__doc__, name


@pytest.mark.parametrize("package", REFERENCE)
def test_the_modules_that_are_names_of_a_package_are_in_its_reference(package):
    module = import_module(package)
    modules = {name for name in dir(module) if ismodule(getattr(module, name))}
    assert modules
    assert modules == {name.split(".")[0] for name in documented(package) if "." in name}
    shown = re.findall(r"^\.\. automodule:: ([\w.]+)", REFERENCE[package], re.MULTILINE)
    assert {getattr(module, name).__name__ for name in modules} <= {*shown}


COSTLY = (  # sections whose examples take a tenth of a second or more, which a quick run leaves out
    "A person as the tutor",
    "Answers of real people",
    "How good a tutor",
    "The graph of answers",
    "Pictures",
    "What a policy is worth",
    "Environments",
    "The ablation",
    "The paper's figures",
)
COSTLY_BLOCKS = re.compile(r"scale_variable|icu_sepsis")  # blocks of other sections


def examples(package: str, whole: bool = True) -> str:
    """Return the examples of a page of the reference, without the costly ones unless ``whole``."""
    parts = re.split(r"^## ", REFERENCE[package], flags=re.MULTILINE)
    some = [part for part in parts if whole or not part.startswith(COSTLY)]
    blocks = re.findall(r"```pycon\n(.*?)```", "\n".join(some), re.DOTALL)
    return "\n".join(block for block in blocks if whole or not COSTLY_BLOCKS.search(block))


@pytest.mark.parametrize("package", REFERENCE)
def test_every_name_of_the_reference_has_an_example_in_it(package):
    code = "\n".join(re.findall(r"^(?:>>>|\.\.\.) (.*)$", examples(package), re.MULTILINE))
    missing = [
        name
        for name in documented(package)
        if not re.search(rf"\b{package}\.{re.escape(name)}\b", code)
    ]
    assert not missing


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("package", REFERENCE)
def test_the_examples_of_the_reference_print_what_they_say(package, whole):
    for needed in ("gymnasium", "matplotlib", "icu_sepsis"):
        pytest.importorskip(needed)
    test = doctest.DocTestParser().get_doctest(
        examples(package, whole), {}, package, f"{package}.md", 0
    )
    ran = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test)
    assert ran.attempted > (90 if whole else 40)
    assert not ran.failed


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page: its headings, as they are written in addresses."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_to_a_heading_that_is_there(page):
    for to, anchor in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        target = (page.parent / to).resolve() if to else page
        assert target.exists(), to
        assert not anchor or anchor in anchors(target), (to, anchor)


def test_the_numbers_of_the_page_on_choosing_are_on_the_pages_that_it_links():
    text = (DOCS / "choosing.md").read_text(encoding="utf-8")
    sources = {
        to
        for to, _ in LINK.findall(text)
        if "RESULTS" in to or to in ("claims.md", "exploration.md")
    }
    results = "\n".join((DOCS / to).read_text(encoding="utf-8") for to in sources)
    numbers = set(re.findall(r"\d[\d.]* ± \d[\d.]*\d|\d[\d.]* ± \d", text))
    numbers |= set(re.findall(r"\d+ / [\d.]+ \[[\d., ]+\]", text))
    numbers |= {
        re.sub(r"\s+", " ", found) for found in re.findall(r"[+-]\d\.\d+\s+to\s+[+-]\d\.\d+", text)
    }
    assert len(numbers) > 30
    assert not {number for number in numbers if number not in results}


def test_the_page_on_evidence_leads_to_every_page_of_results():
    text = (DOCS / "evidence.md").read_text(encoding="utf-8")
    results = [path.name for path in (ROOT / "benchmarks").glob("RESULTS*.md")]
    assert results
    assert not [name for name in results if f"](../benchmarks/{name})" not in text]


def test_every_folder_of_the_code_has_its_line_in_the_page_on_carrying_on():
    text = (DOCS / "carrying-on.md").read_text(encoding="utf-8")
    folders = [
        path.parent for package in REFERENCE for path in (ROOT / package).glob("*/__init__.py")
    ]
    assert folders
    missing = [
        name for path in folders if f"`{(name := path.relative_to(ROOT).as_posix())}/`" not in text
    ]
    assert not missing


@pytest.mark.slow
def test_the_pictures_say_what_the_script_draws(tmp_path):
    pytest.importorskip("matplotlib")
    subprocess.run(
        [sys.executable, DOCS / "pictures" / "draw.py", "--out", tmp_path], check=True, cwd=ROOT
    )
    drawn = sorted(tmp_path.glob("*.svg"))
    assert len(drawn) >= 3
    for path in drawn:
        assert words(path) == words(DOCS / "pictures" / path.name), path.name


def words(picture: Path) -> list[str]:
    """The texts in an SVG, numbers on its axes included."""
    return re.findall(r"<text[^>]*>(.*?)</text>", picture.read_text(encoding="utf-8"), re.DOTALL)


def test_the_wheel_holds_the_code_its_types_and_what_it_reads():
    builders = pytest.importorskip("hatchling.builders.wheel")
    held = {
        file.distribution_path for file in builders.WheelBuilder(str(ROOT)).recurse_included_files()
    }
    files = (
        path for package in REFERENCE for path in (ROOT / package).rglob("*") if path.is_file()
    )
    assert held == {
        path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts
    }
    assert {"elicit/py.typed", "qlearn/py.typed"} <= held
