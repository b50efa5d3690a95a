"""Compiling with numba, but only of functions that have run for five seconds.

If the machine code is on the disk from an earlier process, a call runs it. Otherwise the call is
interpreted, with identical results, until the function has taken five seconds in total. So a short
program does not wait for the compiler, and a long one is compiled after a few seconds.

``NUMBA_DISABLE_JIT=1`` interprets always. ``ELICIT_COMPILE_FIRST=1`` compiles at the first call.
"""

from __future__ import annotations

import atexit
import builtins
import hashlib
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from threading import Lock, Timer, local
from time import monotonic, thread_time
from types import CodeType, FunctionType, MappingProxyType, ModuleType, SimpleNamespace
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit, types
from numba._dispatcher import compute_fingerprint
from numba.core import event
from numba.extending import models, register_model, typeof_impl

F = TypeVar("F", bound=Callable[..., Any])

_settings: Any = config
_unliteral: Any = types.unliteral
# CPU seconds for which a function, with those it calls, is interpreted before it is compiled. A
# first run takes nearly the same time with 5 and with a guess from the length of each function's
# bytecode. With 2, README's example compiles functions it hardly needs (24 s in place of 4).
_PATIENCE = 5.0


def compiled(function: F) -> F:
    """Make a function run interpreted first, and compiled once it has taken long.

    The machine code is kept on disk for later processes. The compiler may not reorder sums, so
    results are the same to the last bit, compiled or not.

    In such a function assign arrays element by element. An assignment of a whole array takes numba
    seconds more to compile, in every process that compiles, because of the error message it may
    raise.
    """
    return _made(function)


def loosely(function: F) -> F:
    """Make a function run compiled, with products and sums fused and reordered.

    Use ``loosely`` in place of ``compiled`` for numbers whose rounding decides nothing.
    """
    return _made(function, fastmath={"contract", "reassoc"})


def unlocked(function: F) -> F:
    """Make a function run compiled without Python's lock, so that other threads run meanwhile.

    Use ``unlocked`` in place of ``compiled`` if no other thread writes to the function's arrays.
    """
    return _made(function, nogil=True)


def for_each_number(function: F) -> F:
    """Make a function run compiled, with a version for each value of a literal number in a call.

    Use ``for_each_number`` in place of ``compiled`` for loops whose length is given by such a
    number: the compiler then knows it.
    """
    made = _made(function)
    if isinstance(made, Compiled):
        made.literal = True
    return made


def written_out(function: F) -> F:
    """Make a function inline: it is compiled into each place that calls it.

    Use ``written_out`` in place of ``compiled`` for parts of loops that take many arrays. Passing
    an array costs a reference count, and many of these cost more than the work itself.
    """
    made = _made(function)
    if isinstance(made, Compiled):
        made.targetoptions, made.py_func = {"inline": "always"}, function
    return made


def compiled_beside(stand_in: Callable[..., Any], *, unlocked: bool = False) -> Callable[[F], F]:
    """Make a function run compiled, and run ``stand_in`` in its place until it is compiled.

    ``stand_in`` returns the same to the last bit. It works on whole arrays in NumPy, and so is
    fast. If ``unlocked``, other threads run meanwhile, as with the function ``unlocked``.
    """

    def made(function: F) -> F:
        made = _made(function, **({"nogil": True} if unlocked else {}))
        if isinstance(made, Compiled) and not _settings.DISABLE_JIT:
            vars(made)["_source"] = stand_in
        return made

    return made


def compiled_in_parts(function: F) -> F:
    """Make a function run interpreted, while each function that it calls is compiled on its own.

    It is compiled as a whole only if its machine code is on the disk or ``compiling()`` asks for
    it. Use it in place of ``compiled`` where a function that is called often is called by one that
    runs seldom and would take the compiler long.
    """
    made = _made(function)
    if isinstance(made, Compiled) and not _settings.DISABLE_JIT:
        vars(made)["_source"], made.in_parts = function, True
    return made


def expect(function: Callable[..., Any], seconds: float) -> None:
    """Tell a compiled function how many seconds its next call would take if interpreted.

    The function is compiled at that call if these seconds and those of its past calls together
    exceed the limit. A loop that returns to Python only at its end needs this.
    """
    if isinstance(function, Compiled):
        function.expect(seconds)


@contextmanager
def compiling() -> Iterator[None]:
    """Return a context in which each function is compiled at its first call."""
    usual, Compiled.patient = Compiled.patient, False
    try:
        yield
    finally:
        Compiled.patient = usual


class Compiled:
    """A function that runs interpreted until compiling it pays off.

    If compiled code calls the function, it calls its machine code. If interpreted code does, it
    calls the Python source.
    """

    literal = False  # whether numbers that stand in a call have versions of their own
    in_parts = False  # whether only the functions that it calls are compiled when they take long
    # numba reads these two: whether to write the function out where it is called, and its code
    targetoptions: Mapping[str, str] = MappingProxyType({})
    py_func: Callable[..., Any]
    patient = not os.environ.get("ELICIT_COMPILE_FIRST")

    def __init__(self, function: Callable[..., Any], machine: Any, place: str | None) -> None:
        update_wrapper(self, function)
        self._function, self.machine, self._place = function, machine, place
        self._spent, self._lasts = 0.0, False
        # kinds of arguments for which no machine code was found, and how much there was then
        self._not_kept: dict[object, int] = {}

    def __call__(self, *arguments: Any) -> Any:
        if _settings.DISABLE_JIT:
            return self._interpreted(arguments)
        if self._lasts or not self.patient:
            return self.machine(*arguments)
        if self._may_be_kept or self.machine.overloads:  # on the disk, or for another function
            kinds = self._kinds(arguments) if self._not_kept else None
            if self._not_kept.get(kinds) != len(self.machine.overloads):
                _here.only_kept = True
                try:
                    return self.machine(*arguments)
                except _NotKept:
                    self._not_kept[self._kinds(arguments)] = len(self.machine.overloads)
                finally:
                    _here.only_kept = False
        begun = thread_time()
        result = self._interpreted(arguments)
        self._spent += thread_time() - begun
        self.expect(0.0)
        return result

    def _kinds(self, arguments: tuple[Any, ...]) -> object:
        """Return what numba compiles a version for: the types of the arguments, or a code for them.

        The code is found in a microsecond, and the types of a ``NamedTuple`` of arrays in a tenth
        of a millisecond. But some types have no code.
        """
        try:
            return compute_fingerprint(arguments)
        except (NotImplementedError, ValueError):
            return tuple(map(self.machine.typeof_pyval, arguments))

    def expect(self, seconds: float) -> None:
        """Have the next call compiled if past and coming seconds exceed ``_PATIENCE``."""
        if not self.in_parts:
            self._lasts = self._lasts or self._spent + seconds > _PATIENCE

    @cached_property
    def _may_be_kept(self) -> bool:
        """Return whether machine code of this function may be on the disk.

        It may be if some file in the folder of machine code has the function's name. The folder is
        read once in a process.
        """
        names = _names_in(self._place) if self._place else ()
        return any(self._function.__name__ in name for name in names)

    def _interpreted(self, arguments: tuple[Any, ...]) -> Any:
        with np.errstate(
            all="ignore"
        ):  # as machine code has it: hashes wrap around, and 1/0 is infinite
            return _boxed(self._source(*arguments))

    @cached_property
    def _source(self) -> Callable[..., Any]:
        """Return the interpreted form of the function, which calls other interpreted forms.

        Its ``math`` functions return infinity or nan in place of raising an error.
        """
        scope: dict[str, Any] = {"__builtins__": builtins}
        named = self._function.__globals__
        for name in _names_of(self._function.__code__) & named.keys():
            scope[name] = _MATH if named[name] is math else named[name]
        for name, other in _called_by(self._function).items():
            scope[name] = other._source
        return FunctionType(self._function.__code__, scope, self._function.__name__)


class _Callee(types.Dispatcher):  # type: ignore[misc, unused-ignore]  # numba is untyped in some versions
    """A ``Compiled`` function as numba sees it in a call from compiled code.

    A literal number in the call is passed as an ordinary number. Otherwise numba would compile a
    version for each value.
    """

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        plain = tuple(map(_unliteral, args)), {name: _unliteral(kws[name]) for name in kws}
        return super().get_call_type(context, *plain)


register_model(_Callee)(models.OpaqueModel)


@typeof_impl.register(Compiled)
def _as_numba_sees_it(function: Compiled, _: Any) -> Any:
    return types.Dispatcher(function.machine) if function.literal else _Callee(function.machine)


def _names_of(code: CodeType) -> set[str]:
    """Return the global names that a function's code uses, also in functions nested in it."""
    return set(code.co_names).union(
        *(_names_of(part) for part in code.co_consts if isinstance(part, CodeType))
    )


def _called_by(function: Any) -> dict[str, Compiled]:
    """Return the compiled functions that a function uses, by name."""
    scope = function.__globals__
    return {
        name: scope[name]
        for name in _names_of(function.__code__)
        if isinstance(scope.get(name), Compiled)
    }


def _boxed(result: Any) -> Any:
    """Return a result with NumPy's numbers replaced by Python's, as numba does."""
    if isinstance(result, np.generic):
        return result.item()
    return tuple(map(_boxed, result)) if type(result) is tuple else result


def _without_errors(name: str) -> Callable[..., float]:
    """Return a function of ``math`` that returns infinity or nan where Python raises an error.

    C's functions, and so compiled code, do the same.
    """
    function, fallback = getattr(math, name), getattr(np, name)

    def quiet(*arguments: Any) -> float:
        try:
            return float(function(*arguments))
        except (OverflowError, ValueError):
            return float(fallback(*arguments))

    return quiet


_MATH = SimpleNamespace(**vars(math))
vars(_MATH).update(
    {name: _without_errors(name) for name in ("exp", "expm1", "ldexp", "log", "sqrt")}
)


class _Here(local):
    """The state of this thread: whether a call may only use code that is on the disk."""

    only_kept = False  # code that is not on the disk must not be compiled


_here = _Here()


class _NotKept(Exception):
    """Error raised inside numba when a function would have to be compiled."""


class _Refuser(event.Listener):
    """A listener to numba that stops compiling in threads whose call may only use code on the disk.

    Only numba knows which machine code is on its disk, so it has to begin before it can be stopped.
    """

    def on_start(self, event: Any) -> None:
        if _here.only_kept:
            raise _NotKept

    def on_end(self, event: Any) -> None:
        pass


@cache
def _names_in(place: str) -> frozenset[str]:
    """Return the names of all files in a folder; none if there is no such folder."""
    return frozenset(path.name for path in Path(place).glob("*"))


def _made(function: F, **options: Any) -> F:
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}
    usual, file = _settings.CACHE_DIR, Path(function.__code__.co_filename)
    packages = frozenset(_packages_called(function, _package_of(file)))
    _settings.CACHE_DIR = _cache_of(usual, file.parent, packages)
    try:
        made: Any = njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep it
        made = njit(**options)(function)
    finally:
        _settings.CACHE_DIR = usual
    _OURS.add(function)
    place = None if _settings.DISABLE_JIT else made.stats.cache_path
    return cast(F, Compiled(function, made, place))


def _package_of(file: Path) -> Path:
    """Return the folder of a file's top-level package; for a script, the folder it lies in."""
    folder = file.parent
    while (folder / "__init__.py").is_file() and (folder.parent / "__init__.py").is_file():
        folder = folder.parent
    return folder


def _packages_called(function: Callable[..., Any], home: Path) -> set[Path]:
    """Return the folders of packages whose code a function in package ``home`` may call.

    These are ``home``, this package, and packages from which the function's module has imported
    modules or compiled functions. Whatever else the process has imported does not count. Otherwise
    a program with compiled functions of its own would have all others compiled again.
    """
    found = _PACKAGES.setdefault(home, {_HOME, home})
    for value in function.__globals__.values() if home != _HOME else ():
        if isinstance(value, Compiled):
            called = _package_of(Path(value._function.__code__.co_filename))
        elif isinstance(value, ModuleType) and getattr(value, "__file__", None):
            called = _package_of(Path(str(value.__file__)))
        else:
            continue
        found |= _PACKAGES.get(called, set())
    return found


_HOME = _package_of(Path(__file__))
_PACKAGES: dict[Path, set[Path]] = {_HOME: {_HOME}}
_OURS: set[Any] = set()


@cache
def _cache_of(usual: str, folder: Path, packages: frozenset[Path]) -> str:
    """Return the folder in which to keep machine code of functions in ``folder``.

    Its name contains a hash of the sources of all ``packages``, so a change of any of them leads to
    a new folder. numba itself would only notice changes in a function's own file, not in the
    functions it calls.
    """
    sources = {path: path.read_bytes() for home in packages for path in home.rglob("*.py")}
    digest, compiled_here = hashlib.blake2b(digest_size=8), (b"_support.jit import", b"numba.ext")
    for path in sorted(sources):
        if any(words in sources[path] for words in compiled_here):
            digest.update(sources[path])
    return str(Path(usual or folder / "__pycache__") / f"numba-{digest.hexdigest()}")


def first_on_this_machine() -> bool:
    """Return whether this process is the first on this machine to compile the present sources.

    The process is then noted on disk. If nothing can be written, the result is always True.
    """
    place = Path(_cache_of(_settings.CACHE_DIR, Path(__file__).parent, frozenset({_HOME})))
    try:
        place.mkdir(parents=True, exist_ok=True)
        (place / "compiled").touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:
        return True
    return True


class _Announcer(event.Listener):
    """A listener to numba that says on standard error when compiling begins and when it has ended.

    Only the first process on a machine says so. Processes that compile at the same time or later
    are silent.
    """

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
                    _say("compiling, once on this machine: up to a minute or two of computing ...")
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
        """Say, once, that compiling has ended, if nothing was compiled for ``quiet`` seconds."""
        with self._lock:
            if self._begun is not None and not self._under_way and monotonic() >= self._end + quiet:
                _say(f"compiled, in {self._end - self._begun:.0f} s")
                self._begun = None


def _say(words: str) -> None:
    print(f"elicit: {words}", file=sys.stderr, flush=True)


_register: Any = event.register
_register("numba:compile", _Refuser())  # the first to be told
_register("numba:compile", _Announcer())
