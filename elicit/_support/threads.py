"""Linear algebra limited to one thread, and the number of cores.

The number of threads changes the order of a sum and so its last digits, which can decide the next
question. With one thread, systems of a few hundred unknowns are also solved ten times faster.
"""

import os
import sys
from contextlib import ContextDecorator
from functools import cached_property
from threading import Lock, local
from types import TracebackType

import numpy  # noqa: F401 - numpy and scipy each bring a BLAS of their own, found only once it is loaded
import scipy.linalg  # noqa: F401
from threadpoolctl import LibController, OpenBLASController, ThreadpoolController


class _Depth(local):
    """A thread's number of nested ``with one_thread`` blocks, and the limits to restore after them.

    The limits are those of libraries that limit each thread separately.
    """

    def __init__(self) -> None:
        self.blocks = 0
        self.own: dict[LibController, int] = {}


class _OneThread(ContextDecorator):
    """A context, or a decorator, in which BLAS uses one thread.

    Most libraries have one limit for the whole process. It is lifted when the last thread in such a
    block leaves it. Entering a block takes some microseconds, and entering a nested one almost no
    time.
    """

    def __init__(self) -> None:
        self._depth, self._lock, self._inside = _Depth(), Lock(), 0
        self._before: dict[
            LibController, int
        ] = {}  # how many threads the process had, where it was not one

    @cached_property
    def _libraries(self) -> tuple[list[LibController], list[LibController]]:
        """BLAS libraries with a limit for each thread, and those with one limit for the process."""
        own, shared = list[LibController](), list[LibController]()
        for library in ThreadpoolController().select(user_api="blas").lib_controllers:
            by_openmp = (
                isinstance(library, OpenBLASController) and library.threading_layer == "openmp"
            )
            (own if by_openmp else shared).append(library)
        return own, shared

    def __enter__(self) -> None:
        if self._depth.blocks == 0:
            with self._lock:
                own, shared = self._libraries
                # counted as entered only at the end: if an interruption (Ctrl+C) comes before, the
                # next block sets the limits again, and still knows the earlier ones
                self._depth.own = _limited(own) | self._depth.own
                self._before = _limited(shared) | self._before
                self._inside, self._depth.blocks = self._inside + 1, 1
        else:
            self._depth.blocks += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._depth.blocks -= 1
        if self._depth.blocks == 0:
            with self._lock:
                self._inside -= 1
                _restore(self._depth.own)
                self._depth.own = {}
                if self._inside == 0:
                    _restore(self._before)
                    self._before = {}


def _limited(libraries: list[LibController]) -> dict[LibController, int]:
    """Limit each library to one thread, and return the previous limits that were not 1."""
    before = {library: n for library in libraries if (n := library.num_threads) not in (1, None)}
    for library in before:
        _set(library, 1)
    return before


def _restore(before: dict[LibController, int]) -> None:
    for library, n in before.items():
        _set(library, n)


def _set(library: LibController, n: int) -> None:
    """Set a library's number of threads, also if another thread was the last to set it.

    Without the two other calls OpenBLAS's controller would ignore the new number in that case.
    """
    OpenBLASController.clear_controlling_thread(force=True)
    library.set_num_threads(n)
    OpenBLASController.clear_controlling_thread(force=True)


one_thread = _OneThread()  # one for the process: so is the limit


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
