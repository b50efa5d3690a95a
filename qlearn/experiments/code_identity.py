"""Hashes of the code that a run depends on: a user's factory, and the sources of both packages.

A journal uses them to notice that code has changed.
"""

from __future__ import annotations

import functools
import hashlib
import pickle
import sys
import sysconfig
import types
import typing
import uuid
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from qlearn.mdp.ordinal_mdp import OrdinalMDP

_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...))
_OURS = ("elicit", "qlearn")  # their sources are hashed as a whole
_INSTALLED = [
    Path(sysconfig.get_path(name)).resolve()
    for name in ("stdlib", "platstdlib", "purelib", "platlib")
]
_NO_RUNS = (
    "cli",
    "paper",
    "experiments/ablation_plot.py",
    "experiments/code_identity.py",
    "experiments/compile_ahead.py",
    "warm_up.py",
)  # sources of qlearn that no run depends on


@cache
def sources() -> str:
    """Return a hash of all code that a run depends on: the sources, and versions of libraries.

    Settings and a user's own code are not part of it.
    """
    digest = hashlib.blake2b(digest_size=16)
    here = Path(__file__).parents[1]
    for package in (here.parent / "elicit", here):
        for path in sorted(package.rglob("*.py")):
            name = path.relative_to(package).as_posix()
            if package != here or not name.startswith(_NO_RUNS):
                digest.update(name.encode() + path.read_bytes())
    for library in (
        "numpy",
        "scipy",
        "clarabel",
        "numba",
        "icu-sepsis",
        "gymnasium",
        "mo-gymnasium",
    ):
        try:
            digest.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            digest.update(f"no {library}".encode())
    return digest.hexdigest()


def identity(thing: Any) -> str:
    """Return a hash of a function, or of anything else that can be called.

    It is the same in every process as long as nothing changes in its code, its defaults, its
    closure, and the functions, classes and constants that it names, directly or indirectly.
    Installed modules, Python's own, and those of elicit and qlearn count by name only. Other
    contents count by their pickle. If something cannot be pickled, the hash differs each time.
    """
    digest = hashlib.blake2b(digest_size=16)
    for piece in _pieces(thing, {}):
        digest.update(f"{len(piece)} {piece}".encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def _pieces(thing: Any, met: dict[int, tuple[int, Any]]) -> Iterator[str]:
    """Yield texts that together identify a thing.

    ``met`` numbers the things that may contain themselves. It also keeps them alive, because
    otherwise their ids would be reused. Constants are not among them, because Python decides when
    two constants are the same object.
    """
    if isinstance(thing, _PLAIN):
        yield f"{type(thing).__name__} {thing!r}"
        return
    if isinstance(thing, (set, frozenset)):  # an order that does not depend on hashes
        yield from ("set", *sorted("".join(_pieces(item, {})) for item in thing))
        return
    if not isinstance(thing, (tuple, types.CodeType)):
        if id(thing) in met:
            yield f"again {met[id(thing)][0]}"
            return
        met[id(thing)] = len(met), thing
    parts = _parts(thing)
    if parts is None:
        yield _pickled(thing)
        return
    yield f"{type(thing).__qualname__} {len(parts)}"
    for part in parts:
        yield from _pieces(part, met)


def _parts(thing: Any) -> list[Any] | None:
    """Return the parts that a thing consists of; None if they are not known."""
    match thing:
        case types.CodeType():
            return [thing.co_code, thing.co_names, thing.co_varnames, thing.co_consts]
        case types.FunctionType() if _is_theirs(thing):
            held = [_held(cell) for cell in thing.__closure__ or ()]
            named = _named(thing.__code__, thing.__globals__)
            return [thing.__code__, thing.__defaults__, thing.__kwdefaults__, held, named]
        case type() if _is_theirs(thing):
            own = {name: item for name, item in vars(thing).items() if name not in _OF_EVERY_CLASS}
            return [thing.__qualname__, thing.__bases__, own]
        case types.FunctionType() | types.BuiltinFunctionType() | type():
            return [thing.__module__, thing.__qualname__]
        case (
            types.ModuleType()
            | types.MemberDescriptorType()
            | types.GetSetDescriptorType()
            | typing.TypeVar()
        ):
            return [thing.__name__]
        case types.MethodType():
            return [thing.__func__, thing.__self__]
        case functools.partial():
            return [thing.func, thing.args, thing.keywords]
        case property():
            return [thing.fget, thing.fset]
        case functools.cached_property():
            return [thing.func]
        case staticmethod() | classmethod():
            return [thing.__func__]
        case OrdinalMDP():
            return [thing.fingerprint]
        case tuple() | list():
            return [*thing]
        case dict():
            return [part for item in thing.items() for part in item]
        case _ if hasattr(thing, "__wrapped__"):  # a cache, or numba's
            return [thing.__wrapped__]
        case _ if _is_theirs(type(thing)) and hasattr(thing, "__dict__"):
            return [type(thing), vars(thing)]
        case _:
            return None


_OF_EVERY_CLASS = {  # members that Python adds to the author's
    "__dict__", "__weakref__", "__doc__", "__firstlineno__", "__static_attributes__",
    "__annotations__",
    "__annotations_cache__", "__annotate_func__", "__dataclass_fields__", "__dataclass_params__",
    "_abc_impl",
    "__orig_bases__", "__parameters__",
}  # fmt: skip


def _named(code: types.CodeType, scope: Mapping[str, Any]) -> list[Any]:
    """Return the things of its module that a function's code names.

    If one is a module of the user's, the things that the code takes from it follow.
    """
    names, found = sorted(_names(code)), []
    for name in names:
        if name in scope:
            found.append(scope[name])
            if isinstance(scope[name], types.ModuleType) and not _is_installed(
                scope[name].__name__
            ):
                found += [vars(scope[name])[other] for other in names if other in vars(scope[name])]
    return found


def _names(code: types.CodeType) -> set[str]:
    inner = [_names(part) for part in code.co_consts if isinstance(part, types.CodeType)]
    return {*code.co_names}.union(*inner)


def _held(cell: types.CellType) -> Any:
    try:
        return cell.cell_contents
    except ValueError:  # not assigned yet
        return ...


def _is_theirs(thing: Any) -> bool:
    """Return whether a function or class is the user's own."""
    return not _is_installed(thing.__module__ or "__main__")


def _is_installed(module: str) -> bool:
    """Return whether a module is of elicit or qlearn, of Python, or installed."""
    if module.partition(".")[0] in _OURS:
        return True
    if module == "__main__":  # a script, or a notebook
        return False
    found = sys.modules.get(module)
    file = vars(found).get("__file__") if found else None
    return not file or any(Path(file).resolve().is_relative_to(place) for place in _INSTALLED)


def _pickled(thing: Any) -> str:
    try:
        return pickle.dumps(thing, protocol=5).hex()
    except Exception:  # a user's object may raise anything
        return uuid.uuid4().hex
