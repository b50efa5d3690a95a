"""A function of today is told from that of yesterday, and taken for the same where nothing has
changed.
"""

import functools
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import PolytopeComparator
from qlearn import random_mdp
from qlearn.experiments.code_identity import identity
from tests.interpreter import run
from tests.thoroughness import thorough

SOURCE = """
import abc, dataclasses, enum, functools, helpers, logging, typing
import numba
import numpy as np
from elicit import PolytopeComparator
from elicit.model.difference import tail_sums

STEP = 2
SETS = {"a", "b", "c", "d"}

@dataclasses.dataclass
class Base:
    k: int = 3
    names: tuple = ("x", "y")

class Kind(enum.Enum):
    A = 11

class Shape(abc.ABC, typing.Generic[typing.TypeVar("T")]):
    @abc.abstractmethod
    def area(self) -> typing.Any: ...

class Square(Shape[int]):
    def area(self):
        return super().area, Kind.A, log, jitted(1)

@numba.njit
def jitted(x):
    return x + 7

log = logging.getLogger("own")

class Mine(Base):
    __slots__ = ("other",)
    level = 0.5

    @property
    def twice(self):
        return 2 * self.k

    def compare(self, d):
        return np.sign(d) + helpers.shift(STEP)

@functools.lru_cache
def cached(k):
    return k + 1

def factory(k, seed, more=4):
    if k in SETS or k in {"p", "q", "r", "s"}:
        return factory(k, seed)
    Square().area()
    return (lambda: Mine(cached(k), tail_sums(np.zeros(3)), np.random.default_rng(seed)))()
"""
HELPERS = (
    "def shift(x):\n    return unused(x) + 1\n\n\ndef unused(x):\n    return x\n\n\ndef far(x):\n  "
    "  return x\n"
)


def written(folder: Path, source: str = SOURCE, helpers: str = HELPERS) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "own_module.py").write_text(source)
    (folder / "helpers.py").write_text(helpers)
    return folder


def identity_in_a_process(folder: Path) -> str:
    code = (
        f"import sys; sys.path.insert(0, {str(folder)!r})\n"
        "import own_module; from qlearn.experiments.code_identity import identity; "
        "print(identity(own_module.factory))"
    )
    (line,) = run(code)
    return line


def identity_here(folder: Path) -> str:
    names = ("own_module", "helpers")
    with pytest.MonkeyPatch.context() as here:
        here.syspath_prepend(folder)
        here.setattr(sys, "dont_write_bytecode", True)
        found = identity(import_module("own_module").factory)
        for name in names:
            del sys.modules[name]
    return found


def test_the_same_code_is_the_same_in_every_process_and_other_code_is_not(tmp_path: Path) -> None:
    first = identity_here(written(tmp_path / "one"))
    assert (
        identity_in_a_process(tmp_path / "one") == first
    )  # compiled there, and with other hashes of strings
    assert identity_here(tmp_path / "one") == first  # read back
    assert not thorough() or identity_in_a_process(tmp_path / "one") == first
    moved = "# a comment\n\n" + SOURCE.replace("def factory", "\n\ndef factory")
    unrelated = HELPERS.replace("def far(x):\n    return x", "")
    assert identity_here(written(tmp_path / "two", moved, unrelated)) == first


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("STEP = 2", "STEP = 3"),
        ('"c", "d"', '"c", "e"'),
        ('"r", "s"', '"r", "t"'),
        ("more=4", "more=5"),
        ("k: int = 3", "k: int = 4"),
        ("level = 0.5", "level = 0.6"),
        ("2 * self.k", "3 * self.k"),
        ("return k + 1", "return k + 2"),
        ("A = 11", "A = 12"),
        ("x + 7", "x + 8"),
        ("np.sign(d) +", "np.abs(d) +"),
        ("class Mine(Base)", "class Mine(Base, Exception)"),
    ],
)
def test_a_change_anywhere_that_the_factory_reaches_shows(
    old: str, new: str, tmp_path: Path
) -> None:
    assert SOURCE.count(old) == 1
    changed = written(tmp_path / "changed", SOURCE.replace(old, new))
    assert identity_here(changed) != identity_here(written(tmp_path / "as it was"))


def test_a_change_in_another_module_of_the_users_shows(tmp_path: Path) -> None:
    changed = HELPERS.replace("return unused(x) + 1", "return unused(x) + 2")
    deeper = HELPERS.replace("def unused(x):\n    return x", "def unused(x):\n    return -x")
    texts = enumerate((HELPERS, changed, deeper))
    assert len({identity_here(written(tmp_path / str(i), helpers=text)) for i, text in texts}) == 3


def closing_over(*things: Any) -> Callable[[], Any]:
    return lambda: things


def both(first: Any, second: Any) -> Callable[[], Any]:
    return lambda: (first, second)


def test_what_a_function_holds_counts() -> None:
    mdp, other = random_mdp(4, 2, 3, rng=0)[0], random_mdp(4, 2, 3, rng=1)[0]
    one = identity(closing_over(mdp, np.arange(3)))
    assert mdp.rewards([0, 1, 2]).shape == (4, 2)  # used meanwhile, which changes nothing
    assert identity(closing_over(mdp, np.arange(3))) == one
    assert (
        len(
            {
                one,
                identity(closing_over(other, np.arange(3))),
                identity(closing_over(mdp, np.arange(4))),
            }
        )
        == 3
    )
    assert identity(both(None, 1)) != identity(both(1, None))
    assert identity(both([1], [1])) == identity(both([1], [1])) != identity(both([1], [2]))
    partial = functools.partial(both, second=2)
    assert (
        identity(partial)
        == identity(functools.partial(both, second=2))
        != identity(functools.partial(both, 2))
    )
    assert identity(PolytopeComparator) == identity(PolytopeComparator) != identity(np.sign)
    assert identity(sys.maxsize) != identity(float(sys.maxsize))


def test_what_holds_itself_has_an_end_and_what_cannot_be_known_is_never_the_same() -> None:
    loop: list[Any] = []
    loop.append(loop)
    assert identity(closing_over(loop)) == identity(closing_over(loop))
    lock = threading.Lock()
    assert identity(closing_over(lock)) != identity(closing_over(lock))
