"""The pages of the site: names, links, numbers, pictures and examples are what the code and the
results say.
"""

import doctest
import re
import subprocess
import sys
from dataclasses import is_dataclass
from enum import EnumType
from importlib import import_module
from inspect import cleandoc, isfunction, ismodule, signature
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, is_typeddict

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


EXEMPT = {  # from naming parameters, each with its reason
    "elicit.Comparator": "a protocol: it is not called",
    "elicit.Tutor": "a protocol: it is not called",
    "elicit.Verdict": "an enum: its members are listed",
    "elicit.Tier": "an enum: its members are listed",
    "elicit.Status": "an enum: its members are listed",
    "qlearn.Status": "an enum: its members are listed",
}


@pytest.mark.parametrize("package", REFERENCE)
def test_docstrings_of_the_reference_name_parameters_results_and_errors(package):
    exempt, wrong = set(), {}
    for name in documented(package):
        thing = resolve_name(f"{package}.{name}")
        if not callable(thing):  # a table or a tuple, which the page itself describes
            continue
        if getattr(thing, "_is_protocol", False) or issubclass(type(thing), EnumType):
            exempt.add(f"{package}.{name}")
        elif found := faults_of(thing):
            wrong[name] = found
    assert not wrong
    assert exempt == {name for name in EXEMPT if name.startswith(f"{package}.")}


@pytest.mark.parametrize("package", REFERENCE)
def test_docstrings_of_public_methods_name_parameters_results_and_errors(package):
    methods, wrong = 0, {}
    for name in documented(package):
        kind = resolve_name(f"{package}.{name}")
        for method in methods_of(kind) if isinstance(kind, type) else ():
            methods += 1
            found = faults_of(getattr(kind, method))
            if found and not says_elsewhere(kind, method):
                wrong[f"{name}.{method}"] = found
    assert methods > 30
    assert not wrong


def methods_of(kind: type) -> list[str]:
    """Return the names of the public methods that a class defines itself, with ``__call__``."""
    fields = getattr(kind, "__dataclass_fields__", {})  # a default may be a function
    return [
        name
        for name, member in vars(kind).items()
        if isfunction(getattr(member, "__func__", member))
        and (name == "__call__" or not name.startswith("_"))
        and name not in fields
    ]


IN_FULL = ("elicit.Comparator", "elicit.Tutor", "qlearn.Learner")  # they document their methods


def says_elsewhere(kind: type, method: str) -> bool:
    """Return whether a method may leave its parameters and results to the class it implements.

    It may if a class of ``IN_FULL`` has the method with the same parameters, and ``kind`` inherits
    from that class or, if it is a protocol, has all its methods. The docstring then has neither
    section: if it has one of them, it must be complete.
    """
    prose, sections = sections_of(getattr(kind, method))
    if not prose or RAISED.search(prose) or {"Parameters", "Returns"} & sections.keys():
        return False
    for base in map(resolve_name, IN_FULL):
        own = methods_of(base)
        is_one = (
            all(hasattr(kind, name) for name in own)
            if getattr(base, "_is_protocol", False)
            else issubclass(kind, base)
        )
        if kind is not base and method in own and is_one:
            return [*signature(getattr(kind, method)).parameters] == [
                *signature(getattr(base, method)).parameters
            ]
    return False


def faults_of(thing: Any) -> list[str]:
    """Return what the docstring of a function or a class lacks, or has too much."""
    prose, sections = sections_of(thing)
    if not prose:
        return ["no docstring"]
    given = names_in(sections.get("Parameters", "")) | names_in(sections.get(OTHER, ""))
    faults, held, unknown = [], set(), set()
    if isinstance(thing, type):
        init = thing.__init__ if isfunction(thing.__init__) else None
        given |= names_in(sections_of(init)[1].get("Parameters", "")) if init else set()
        held = names_in(sections.get("Attributes", ""))
        if is_dataclass(thing) or hasattr(thing, "_fields"):  # others set theirs when they are made
            unknown = held - {*signature(thing).parameters} - {*dir(thing)}
        if is_dataclass(thing):  # which may leave inherited fields to the class that it names
            bases = [base for base in thing.__mro__[1:] if f"``{base.__name__}``" in thing.__doc__]
            held = held.union(*(names_in(sections_of(base)[1]["Attributes"]) for base in bases))
    elif signature(thing).return_annotation not in (None, "None") and not (
        {"Returns", "Yields"} & sections.keys()
    ):
        faults.append("no section Returns")
    wanted, optional = parameters_of(thing)
    faults += [f"no word on {name}" for name in sorted(wanted - given - held)]
    faults += [f"no parameter {name}" for name in sorted(given - wanted - optional)]
    faults += [f"no attribute {name}" for name in sorted(unknown)]
    faults += [f"an empty section {title}" for title, text in sections.items() if not text.strip()]
    return faults + RAISED.findall(prose)


RAISED = re.compile(r"\bRaises? \w+")  # an error in the prose, which belongs into a section
OTHER = "Other Parameters"
HEADING = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.MULTILINE)


def sections_of(thing: Any) -> tuple[str, dict[str, str]]:
    """Return the prose of a docstring above its sections, and the text of each section."""
    prose, *rest = HEADING.split(cleandoc(thing.__doc__ or ""))
    return prose, dict(zip(rest[::2], rest[1::2], strict=True))


def names_in(section: str) -> set[str]:
    """Return the names that a section of parameters is about: "a" and "b" of "a, b : int"."""
    heads = re.findall(r"^(\S.*?)(?: :.*)?$", section, re.MULTILINE)
    return {name.strip().lstrip("*") for head in heads for name in head.split(",")}


def parameters_of(thing: Any) -> tuple[set[str], set[str]]:
    """Return the parameters that a docstring must name, and others that it may name.

    Common keywords, which are passed as ``**rest``, may be named one by one, or all at once as
    "**rest".
    """
    if is_typeddict(thing):
        return {*thing.__annotations__}, set()
    called = thing
    if isinstance(thing, type) and isfunction(thing.__init__):
        called = thing.__init__
    elif isinstance(thing, type) and issubclass(thing, BaseException):
        return set(), set()  # it takes a message, as all do
    wanted, optional = set(), set()
    for name, parameter in signature(called).parameters.items():
        common = re.match(r"Unpack\[(\w+)\]", str(parameter.annotation))
        if parameter.kind is parameter.VAR_KEYWORD and common:
            keys = {*getattr(sys.modules[thing.__module__], common[1]).__annotations__}
            named = names_in(sections_of(thing)[1].get(OTHER, ""))
            wanted |= keys if named else {name}
            optional |= keys
        elif name != "self":
            wanted.add(name)
    return wanted, optional


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
