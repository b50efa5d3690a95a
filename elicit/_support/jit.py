"""Compile with numba where it is installed (the extra ``fast``); the same source runs without it, slower."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, kept on disk between processes; itself where there is no numba. No option
    that lets sums be reordered: both ways give the same numbers to the last bit.

    Arrays are better assigned element by element: for a whole one, numba compiles what its error message takes, which
    are seconds in every process that compiles at all."""
    return _made(function)


def loosely(function: F) -> F:
    """``compiled``, with products and sums fused and reordered: for numbers whose rounding nothing hangs on."""
    return _made(function, fastmath={"contract", "reassoc"})


def unlocked(function: F) -> F:
    """``compiled``, and other threads may run meanwhile: for functions whose arrays no other thread writes to."""
    return _made(function, nogil=True)


def _made(function: F, **options: Any) -> F:
    try:
        from numba import config as settings
        from numba import njit
    except ImportError:
        return function
    _announce_compiling()
    config: Any = settings
    usual, file = config.CACHE_DIR, Path(function.__code__.co_filename)
    _PACKAGES.add(_package_of(file))  # what this function calls was imported, and is known here, before it
    config.CACHE_DIR = _cache_of(usual, file.parent, frozenset(_PACKAGES))
    try:
        made: Any = njit(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # nowhere to keep it
        made = njit(error_model="numpy", **options)(function)
    finally:
        config.CACHE_DIR = usual
    _OURS.add(function)
    return cast(F, made)


def _package_of(file: Path) -> Path:
    """The outermost folder that a file belongs to by its imports; the file's own, of a script."""
    folder = file.parent
    while (folder / "__init__.py").is_file() and (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


_PACKAGES: set[Path] = {_package_of(Path(__file__))}
_OURS: set[Any] = set()


@cache
def _cache_of(usual: str, folder: Path, packages: frozenset[Path] = frozenset(_PACKAGES)) -> str:
    """Where to keep the machine code of a folder's functions: a place of its own for each state of the sources, of
    whole packages, so that it does not depend on what was imported first. numba looks for changes in a function's own
    file only, not in the files of the functions it calls."""
    sources = {path: path.read_bytes() for home in packages for path in home.rglob("*.py")}
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        if any(mark in sources[path] for mark in (b"@compiled", b"@loosely", b"@unlocked")):
            digest.update(sources[path])
    return str(Path(usual or folder / "__pycache__") / f"numba-{digest.hexdigest()}")


@cache
def _announce_compiling() -> None:
    """Say once, on the standard error, what a first call waits for."""
    from numba.core import event

    class Announcer(event.Listener):
        def on_start(self, event: Any) -> None:
            if event.data["dispatcher"].py_func in _OURS and not said:
                said.append(True)
                print(
                    "elicit: compiling, once on this machine: up to a minute of computing ...",
                    file=sys.stderr,
                    flush=True,
                )

        def on_end(self, event: Any) -> None:
            pass

    said: list[bool] = []
    register: Any = event.register
    register("numba:compile", Announcer())
