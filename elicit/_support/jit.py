"""Compile with numba, and keep the machine code on disk. ``NUMBA_DISABLE_JIT=1`` runs the same source to the same
numbers, slowly."""

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import config, njit
from numba.core import event

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, kept on disk between processes. No option that lets sums be reordered: compiled
    or not, the numbers are the same to the last bit.

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
    settings: Any = config
    usual, file = settings.CACHE_DIR, Path(function.__code__.co_filename)
    _PACKAGES.add(_package_of(file))  # what this function calls was imported, and is known here, before it
    settings.CACHE_DIR = _cache_of(usual, file.parent, frozenset(_PACKAGES))
    try:
        made: Any = njit(cache=True, error_model="numpy", **options)(function)
    except RuntimeError:  # nowhere to keep it
        made = njit(error_model="numpy", **options)(function)
    finally:
        settings.CACHE_DIR = usual
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
def _cache_of(usual: str, folder: Path, packages: frozenset[Path]) -> str:
    """Where to keep the machine code of a folder's functions: a place of its own for each state of the sources, of
    whole packages, so that it does not depend on what was imported first. numba looks for changes in a function's own
    file only, not in the files of the functions it calls."""
    sources = {path: path.read_bytes() for home in packages for path in home.rglob("*.py")}
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        if b"_support.jit import" in sources[path]:
            digest.update(sources[path])
    return str(Path(usual or folder / "__pycache__") / f"numba-{digest.hexdigest()}")


class _Announcer(event.Listener):
    """Says once, on the standard error, what a first call waits for."""

    said = False

    def on_start(self, event: Any) -> None:
        if event.data["dispatcher"].py_func in _OURS and not self.said:
            self.said = True
            print(
                "elicit: compiling, once on this machine: up to a minute of computing ...", file=sys.stderr, flush=True
            )

    def on_end(self, event: Any) -> None:
        pass


_register: Any = event.register
_register("numba:compile", _Announcer())
