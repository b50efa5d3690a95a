"""Compile with numba where it is installed (the extra ``fast``); the same source runs without it, slower."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """The function as machine code, kept on disk between processes; itself where there is no numba. No option
    that lets sums be reordered: both ways give the same numbers to the last bit."""
    return _made(function, nogil=False)


def unlocked(function: F) -> F:
    """``compiled``, and other threads may run meanwhile: for functions whose arrays no other thread writes to."""
    return _made(function, nogil=True)


def _made(function: F, nogil: bool) -> F:
    try:
        from numba import config as settings
        from numba import njit
    except ImportError:
        return function
    config: Any = settings
    usual = config.CACHE_DIR
    config.CACHE_DIR = _cache_of(usual, Path(function.__code__.co_filename).parent)
    try:
        made: Any = njit(cache=True, error_model="numpy", nogil=nogil)(function)
    except RuntimeError:  # nowhere to keep it
        made = njit(error_model="numpy", nogil=nogil)(function)
    finally:
        config.CACHE_DIR = usual
    return cast(F, made)


@cache
def _cache_of(usual: str, folder: Path) -> str:
    """Where to keep the machine code of a folder's functions: a place of its own for each state of the sources.
    numba looks for changes in a function's own file only, not in the files of the functions it calls."""
    sources = {path: path.read_bytes() for home in {folder, Path(__file__).parent} for path in home.glob("*.py")}
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(sources):
        if b"@compiled" in sources[path]:
            digest.update(sources[path])
    return str(Path(usual or folder / "__pycache__") / f"numba-{digest.hexdigest()}")
