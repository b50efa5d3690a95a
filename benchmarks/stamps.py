"""Write how, when and of which sources a page of results was made, and read it again.

The stamp is the last line of a page of Markdown, is in the metadata of a notebook, and for a table
``x.csv`` it is in ``x.stamp`` beside it.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import shlex
import sys
import tomllib
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[1]
EVERYWHERE = ("elicit", "qlearn")  # the numbers of every page are of the code in these folders
ASIDE = (  # but not of these, unless pages.toml names them: screens, commands, words and checks
    "elicit/person",
    "elicit/testing",
    "qlearn/cli",
    "qlearn/problems/families/words.py",
    "qlearn/warm_up.py",
)
_BEFORE = "Made before pages were stamped"
_LINE = re.compile(
    rf"^(?:Made on (\S+)|{_BEFORE},) by `([^`]*)`(?:; seeds (.*?); sources (\w+))?\."
    r"(?: Some rows made again on (\S+): the same; sources (\w+)\.)?$",
    re.MULTILINE,
)


class Stamp(NamedTuple):
    """The command, its seeds, the day (ISO), and a hash of the sources.

    Only the command is known of a page that was made before there were stamps. ``again`` is the
    last day on which some rows were made again by code with the hash ``again_by``, and were the
    same.
    """

    command: str
    seeds: str = ""
    day: str = ""
    sources: str = ""
    again: str = ""
    again_by: str = ""

    def __str__(self) -> str:
        if not self.sources:
            return f"{_BEFORE}, by `{self.command}`."
        made = (
            f"Made on {self.day} by `{self.command}`; seeds {self.seeds}; sources {self.sources}."
        )
        if not self.again:
            return made
        return f"{made} Some rows made again on {self.again}: the same; sources {self.again_by}."


def sign(page: Path, seeds: str) -> None:
    """Stamp a page that this process has just written.

    Nothing is done if the process is no program of the project (``python -m benchmarks. ...``): a
    page that a test has written has no command that would make it again.
    """
    if _BEGUN:
        command = shlex.join(["python", "-m", _PROGRAM, *sys.argv[1:]])
        put(page, Stamp(command, seeds or "of the program", date.today().isoformat(), _BEGUN))


def made_now(command: str, seeds: str, program: str) -> Stamp:
    """Return the stamp of what a program (see ``sources``) makes that begins now."""
    return Stamp(command, seeds, date.today().isoformat(), sources(program))


def put(page: Path, stamp: Stamp) -> None:
    """Put a stamp on a page of Markdown, in place of the one that it has, or beside a table."""
    if page.suffix == ".csv":
        page.with_suffix(".stamp").write_text(f"{stamp}\n", encoding="utf-8")
    else:
        text = without(page.read_text(encoding="utf-8"))
        page.write_text(f"{text.rstrip()}\n\n{stamp}\n", encoding="utf-8")


def of(page: Path) -> Stamp | None:
    """Return the stamp of a page, if it has one. Raises FileNotFoundError if there is no page."""
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
    day, command, seeds, made_of, again, again_by = found.groups(default="")
    return Stamp(command, seeds, day, made_of, again, again_by)


def without(text: str) -> str:
    """Return the text of a page of Markdown without its stamp."""
    return re.sub(r"\n+\Z", "\n", _LINE.sub("", text))


def sources(program: str) -> str:
    """Return a hash of the code that the numbers of a program depend on.

    Parameters
    ----------
    program : str
        A module that ``python -m`` runs, or the path of a notebook.

    Returns
    -------
    str
        The hash of the code in elicit/ and qlearn/ but for what is ``ASIDE``, of the program, of
        the modules in folders of benchmarks/ that it imports, itself or by another of them, and of
        what pages.toml names beside them. For a notebook: of elicit/ (its
        testing/ only if a cell names it), qlearn/, the code of its cells, and the tables in
        notebooks/data that they name. Comments, docstrings, and the text of errors, warnings,
        statuses and help do not count.
    """
    digest = hashlib.blake2b(digest_size=5)
    places, aside = [*EVERYWHERE], {*ASIDE}
    if program.endswith(".ipynb"):
        cells = json.loads((ROOT / program).read_text(encoding="utf-8"))["cells"]
        code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        aside = set() if "elicit.testing" in code else {"elicit/testing"}
        digest.update(_bare(code))
        for table in sorted((ROOT / "notebooks" / "data").glob("*.csv")):
            digest.update(table.read_bytes() if table.name in code else b"")
    elif program.startswith("benchmarks."):
        places += sorted(_with_imported(program))
        for page in manifest():
            places += page.get("sources", []) if page["command"].split()[0] == program else []
        aside -= {*places}
    left_out = tuple(f"{each}/" for each in aside)
    for place in dict.fromkeys(places):
        for name in _files(place):
            if name in aside or name.startswith(left_out):
                continue
            digest.update(name.encode())
            digest.update(_code_of(name, os.stat(f"{ROOT}/{name}").st_mtime_ns))
    return digest.hexdigest()


def _files(place: str) -> list[str]:
    """Return the paths of a file or of the code in a folder, in the order of their parts.

    Strings, since this is done for every page.
    """
    if not os.path.isdir(f"{ROOT}/{place}"):
        return [place]
    found = []
    for folder, folders, names in os.walk(f"{ROOT}/{place}"):
        if "__pycache__" in folders:  # where compiled code may be kept in thousands of files
            folders.remove("__pycache__")
        inside = folder[len(f"{ROOT}/") :]
        found += [f"{inside}/{name}" for name in names if name.endswith(".py")]
    return sorted(found, key=lambda name: name.split("/"))


def _with_imported(program: str) -> set[str]:
    """Return the paths of a program and of the modules that it imports in folders of benchmarks.

    Modules that lie in benchmarks/ itself, but for the program, write pages and make no numbers.
    """
    found, left = set[str](), [program]
    while left:
        module = left.pop()
        path = module.replace(".", "/")
        name = f"{path}/__init__.py" if os.path.isdir(f"{ROOT}/{path}") else f"{path}.py"
        in_folder = name.startswith("benchmarks/") and name.count("/") > 1
        wanted = name not in found and (in_folder or module == program)
        if wanted and os.path.isfile(f"{ROOT}/{name}"):
            found.add(name)
            left += _imports_of(name, os.stat(f"{ROOT}/{name}").st_mtime_ns)
    return found


def manifest() -> list[dict[str, Any]]:
    """Return the entries of pages.toml."""
    found: list[dict[str, Any]] = tomllib.loads(
        (ROOT / "benchmarks" / "pages.toml").read_text(encoding="utf-8")
    )["page"]
    return found


@cache
def _code_of(name: str, changed: int) -> bytes:
    """Return a hash of the code of a file that was last changed at that time."""
    code = (ROOT / name).read_text(encoding="utf-8")
    return hashlib.blake2b(_bare(code), digest_size=16).digest()


@cache
def _imports_of(name: str, changed: int) -> list[str]:
    """Return what a file that was last changed at that time imports: modules, or names in them."""
    found = []
    for node in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{each.name}" for each in node.names)]
        elif isinstance(node, ast.Import):
            found += [each.name for each in node.names]
    return found


def _bare(code: str) -> bytes:
    """Return code without what no number depends on, in the same layout whoever wrote it.

    These are comments, docstrings, and the text of errors, warnings, statuses and help.
    """
    tree = _Silent().visit(ast.parse(code))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        first = body[0] if isinstance(body, list) and body else None
        if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
            body[0] = ast.Pass()
    return ast.unparse(tree).encode()


class _Silent(ast.NodeTransformer):
    """Replaces the text of errors, warnings, statuses and help by nothing."""

    def __init__(self) -> None:
        self._within = False

    def visit_Raise(self, node: ast.Raise) -> ast.AST:
        return self._silenced(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        return self._silenced(node) if node.name == "Status" else self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        called = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if called == "setting":
            del node.args[2:3]  # its help
        owner = getattr(getattr(node.func, "value", None), "id", "")  # np.require is no check
        silent = called in ("warn", "require", "reject") and owner != "np"
        return self._silenced(node) if silent else self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.AST:
        return ast.Constant("") if self._within else self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        return self._text_of_parts(node)

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        return self._text_of_parts(node)

    def _text_of_parts(self, node: ast.expr) -> ast.AST:
        parts = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
        text = self._within and any(isinstance(part, str) for part in parts)
        return ast.Constant("") if text else self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return ast.Constant("") if self._within and isinstance(node.value, str) else node

    def _silenced(self, node: ast.AST) -> ast.AST:
        before, self._within = self._within, True
        found = self.generic_visit(node)
        self._within = before
        return found


_SPEC = getattr(sys.modules["__main__"], "__spec__", None)
_PROGRAM = _SPEC.name if _SPEC else ""
_WRITES = _PROGRAM.startswith("benchmarks.") and _PROGRAM not in (
    "benchmarks.evidence",
    "benchmarks.own_process",
)
_BEGUN = sources(_PROGRAM) if _WRITES else ""  # now, for a long run may outlive its code
