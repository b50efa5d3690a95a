"""How, when and of which sources a page of results was made: the line at its foot, and whether its
sources are today's.

A page of Markdown has the line as its last, a notebook in its metadata, and a table ``x.csv`` in
``x.stamp`` beside it.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import json
import re
import shlex
import sys
from collections.abc import Iterator
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("elicit", "qlearn", "benchmarks")  # whose sources count
LAZY = ("elicit", "qlearn")  # whose names are imported when they are first used
# what they run is of no number; ``compile_ahead`` leaves nothing but machine code behind
NOT_MEASURED = (
    "benchmarks.stamps",
    "benchmarks.evidence",
    "benchmarks.quotes",
    "qlearn.experiments.compile_ahead",
)
STARTS = {  # what a program runs in processes of its own, beside itself
    "benchmarks.asking.person_sessions": ("benchmarks.asking.person_sessions", "qlearn.cli.teach"),
    "benchmarks.cold_start": (
        "benchmarks.cold_start",
        "qlearn.cli.ablate",
        "qlearn.learners.policy_iteration",
        "elicit.asking.bags",
    ),
    "qlearn": ("qlearn.cli.figures",),
}
# what a program runs when the table that is kept of it is written: of no number in it
AFTERWARDS = {
    "qlearn": ("qlearn.paper.claims", "qlearn.paper.figures"),
}
_BEFORE = "Made before pages were stamped"
_LINE = re.compile(
    rf"^(?:Made on (\S+)|{_BEFORE},) by `([^`]*)`(?:; seeds (.*); sources (\w+))?\.$", re.MULTILINE
)


class Stamp(NamedTuple):
    """The command, its seeds, the day (ISO), and a hash of the sources; of a page that was made
    before there were stamps only the command is known."""

    command: str
    seeds: str = ""
    day: str = ""
    sources: str = ""

    def __str__(self) -> str:
        if not self.sources:
            return f"{_BEFORE}, by `{self.command}`."
        return (
            f"Made on {self.day} by `{self.command}`; seeds {self.seeds}; sources {self.sources}."
        )


def sign(page: Path, seeds: str) -> None:
    """Stamp a page that this process has just written, if it is a program of the project (``python
    -m ...``): a page that a test or a session has written has no command that would make it
    again."""
    if _BEGUN:
        command = shlex.join(["python", "-m", _PROGRAM, *sys.argv[1:]])
        put(page, Stamp(command, seeds or "of the program", date.today().isoformat(), _BEGUN))


def made_now(command: str, seeds: str, program: str) -> Stamp:
    """The stamp of what a program (see ``sources``) makes that begins now."""
    return Stamp(command, seeds, date.today().isoformat(), sources(program))


def put(page: Path, stamp: Stamp) -> None:
    """Put a stamp on a page of Markdown, in place of the one that it has, or beside a table."""
    if page.suffix == ".csv":
        page.with_suffix(".stamp").write_text(f"{stamp}\n", encoding="utf-8")
    else:
        text = without(page.read_text(encoding="utf-8"))
        page.write_text(f"{text.rstrip()}\n\n{stamp}\n", encoding="utf-8")


def of(page: Path) -> Stamp | None:
    """The stamp of a page, if it has one. Raises FileNotFoundError where there is no such page."""
    if page.suffix == ".csv":
        beside = page.with_suffix(".stamp")
        text = beside.read_text(encoding="utf-8") if beside.exists() else ""
    else:
        text = page.read_text(encoding="utf-8")
        if page.suffix == ".ipynb":
            text = json.loads(text)["metadata"].get("executed", {}).get("stamp", "")
    found = _LINE.search(text)
    if not found:
        return None
    day, command, seeds, made_of = found.groups(default="")
    return Stamp(command, seeds, day, made_of)


def without(text: str) -> str:
    """The text of a page of Markdown without its stamp."""
    return re.sub(r"\n+\Z", "\n", _LINE.sub("", text))


def sources(program: str) -> str:
    """A hash of all that a program may run of elicit, qlearn and benchmarks: the code of the
    modules that it imports, wherever in them, and that they import, and so on; docstrings and
    comments do not count. Of a notebook (its path) the code of its cells too, and the tables of
    notebooks/data that it names; not what it runs ``AFTERWARDS``."""
    digest = hashlib.blake2b(digest_size=5)
    if program.endswith(".ipynb"):
        cells = json.loads((ROOT / program).read_text(encoding="utf-8"))["cells"]
        code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        tree = ast.parse(code)
        todo = list(_imported(tree))
        digest.update(_told(tree).encode())
        tables = (
            table
            for table in sorted((ROOT / "notebooks" / "data").glob("*.csv"))
            if table.name in code
        )
        digest.update(b"".join(table.read_bytes() for table in tables))
    else:
        todo = list(STARTS.get(program, (program,)))
    met: dict[str, bytes] = {}
    left_out = (*NOT_MEASURED, *AFTERWARDS.get(program, ()))
    while todo:
        if (name := todo.pop()) not in met and name not in left_out:
            met[name], further = _module(name, _file(name).stat().st_mtime_ns)
            todo += further
    for name in sorted(met):
        digest.update(name.encode() + met[name])
    return digest.hexdigest()


@cache
def _module(name: str, changed: int) -> tuple[bytes, frozenset[str]]:
    """A hash of the code of a module, last changed at that time, and what it imports."""
    tree = ast.parse(_file(name).read_text(encoding="utf-8"))
    return hashlib.blake2b(_told(tree).encode(), digest_size=16).digest(), frozenset(
        _imported(tree)
    )


def _file(name: str) -> Path:
    return ROOT.joinpath(*name.split(".")).with_suffix(".py")


def _imported(tree: ast.Module) -> Iterator[str]:
    """Modules of ``FOLDERS`` that the code imports. The ``__init__`` of a folder holds names and no
    code.
    """
    lazy = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            lazy |= {*names} & {*LAZY}
            yield from (name for name in names if _counts(name))
        elif isinstance(node, ast.ImportFrom) and node.module:
            for name in (f"{node.module}.{alias.name}" for alias in node.names):
                if _counts(name):
                    yield name
                elif _counts(node.module):
                    yield node.module
                elif node.module in LAZY:
                    yield from _place(name)
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in lazy
        ):
            yield from _place(f"{node.value.id}.{node.attr}")


def _counts(name: str) -> bool:
    return name.partition(".")[0] in FOLDERS and _file(name).exists()


def _place(name: str) -> Iterator[str]:
    """The module that a name of a lazy package comes from."""
    package, _, name = name.partition(".")
    names = vars(importlib.import_module(package))
    place = (
        names["_MODULES"].get(name)
        or names["_LATER"].get(name)
        or getattr(names.get(name), "__module__", "")
    )
    if place and _counts(place):
        yield place


def _told(thing: Any) -> str:
    """A syntax tree as text, the same in every version of Python, without docstrings."""
    if isinstance(thing, ast.AST):
        fields = {
            name: part for name, part in ast.iter_fields(thing) if part is not None and part != []
        }
        body = fields.get("body")
        if (
            isinstance(body, list)
            and isinstance(body[0], ast.Expr)
            and isinstance(body[0].value, ast.Constant)
        ):
            fields["body"] = body[1:]  # a docstring, or what does as little
        return f"{type(thing).__name__}({','.join(f'{name}={_told(part)}' for name, part in fields.items())})"  # noqa: E501
    if isinstance(thing, list):
        return f"[{','.join(map(_told, thing))}]"
    return repr(thing)


_SPEC = getattr(sys.modules["__main__"], "__spec__", None)
_PROGRAM = _SPEC.name if _SPEC else ""
_WRITES = _PROGRAM.startswith("benchmarks.") and _PROGRAM not in (
    "benchmarks.evidence",
    "benchmarks.own_process",
)
_BEGUN = sources(_PROGRAM) if _WRITES else ""  # now, for a long run may outlive its code
