"""Compile with numba, and keep the machine code on disk. ``NUMBA_DISABLE_JIT=1`` runs the same source to the same
numbers, slowly."""

import atexit
import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from threading import Lock, Timer
from time import monotonic
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
    home = _package_of(file)
    _PACKAGES.add(home)  # what this function calls was imported, and is known here, before it
    packages = {_HOME} if home == _HOME else _PACKAGES  # this one calls nothing of the others, whatever was imported
    settings.CACHE_DIR = _cache_of(usual, file.parent, frozenset(packages))
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


_HOME = _package_of(Path(__file__))
_PACKAGES: set[Path] = {_HOME}
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


def first_on_this_machine() -> bool:
    """Whether no process has said before that it compiles these sources, or would have to each time, since nothing can
    be kept; from now on one has."""
    settings: Any = config
    place = Path(_cache_of(settings.CACHE_DIR, Path(__file__).parent, frozenset({_HOME})))
    try:
        place.mkdir(parents=True, exist_ok=True)
        (place / "compiled").touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        return True
    return True


class _Announcer(event.Listener):
    """Says on the standard error what a first call waits for, and when that is over: once on a machine, not in every
    process that compiles beside it or later."""

    _QUIET = 3.0  # seconds without anything to compile, after which it is over

    def __init__(self) -> None:
        self._lock, self._under_way, self._end = Lock(), 0, 0.0
        self._begun: float | None = None
        self._asked = False  # whether it is known if this process is to say anything

    def on_start(self, event: Any) -> None:
        if event.data["dispatcher"].py_func not in _OURS:
            return
        with self._lock:
            self._under_way += 1
            if not self._asked:
                self._asked = True
                if first_on_this_machine():
                    self._begun = monotonic()
                    _say("compiling, once on this machine: a minute or two of computing ...")
                    atexit.register(self._finish, 0.0)

    def on_end(self, event: Any) -> None:
        if event.data["dispatcher"].py_func not in _OURS:
            return
        with self._lock:
            self._under_way -= 1
            self._end = monotonic()
            if self._begun is not None and not self._under_way:
                waits = Timer(self._QUIET, self._finish, (self._QUIET,))
                waits.daemon = True
                waits.start()

    def _finish(self, quiet: float) -> None:
        """Say that it is over, where that has not been said and nothing was compiled for so many seconds."""
        with self._lock:
            if self._begun is not None and not self._under_way and monotonic() >= self._end + quiet:
                _say(f"compiled, in {self._end - self._begun:.0f} s")
                self._begun = None


def _say(words: str) -> None:
    print(f"elicit: {words}", file=sys.stderr, flush=True)


_register: Any = event.register
_register("numba:compile", _Announcer())
