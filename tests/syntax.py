"""Syntax trees of source files, and what several tests look up in them."""

import ast
import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path


def parsed(path: Path) -> ast.Module:
    """Return the syntax tree of a file.

    Collecting garbage, which there is none of, would take three times as long as parsing.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    finally:
        if collects:
            gc.enable()


def statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all statements below it, without looking into expressions."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for name in ("body", "orelse", "finalbody", "handlers", "cases"):
            below = getattr(node, name, None)
            if isinstance(below, list):  # of a lambda it is an expression
                waiting += below


@cache
def imports(path: Path) -> tuple[tuple[ast.Import | ast.ImportFrom, bool], ...]:
    """Return the imports of a file, also those within functions.

    With each stands whether it is for type checks only. They are kept, while trees are not, which
    would slow down all later collecting of garbage.
    """
    found = []
    for top in parsed(path).body:
        for_types = isinstance(top, ast.If) and ast.unparse(top.test) == "TYPE_CHECKING"
        found += [
            (node, for_types)
            for node in statements(top)
            if isinstance(node, ast.Import | ast.ImportFrom)
        ]
    return tuple(found)


@cache
def classes(path: Path) -> tuple[tuple[str, int], ...]:
    """Return the name of every class of a file, and its line."""
    return tuple(
        (node.name, node.lineno)
        for node in statements(parsed(path))
        if isinstance(node, ast.ClassDef)
    )
