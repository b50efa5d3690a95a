"""Linear algebra on one thread, whatever the machine has; and how many cores it has.

How a sum is split among threads shows in its last digits, which can decide what is asked next.
Systems of a few hundred unknowns are also solved ten times faster.
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
    """The number of blocks that this thread is in, and what it has to set back.

    The latter is used if the limit is a thread's own.
    """

    def __init__(self) -> None:
        self.blocks = 0
        self.own: dict[LibController, int] = {}


class _OneThread(ContextDecorator):
    """A block, or a decorated function, in which BLAS has one thread.

    The limit is that of the whole process in most libraries: it ends when the last of the threads
    that are in such a block leaves it, whichever that is. To enter a block costs some microseconds,
    within another one next to nothing.
    """

    def __init__(self) -> None:
        self._depth, self._lock, self._inside = _Depth(), Lock(), 0
        self._before: dict[
            LibController, int
        ] = {}  # how many threads the process had, where it was not one

    @cached_property
    def _libraries(self) -> tuple[list[LibController], list[LibController]]:
        """Return libraries whose limit is a thread's own, and those whose is the process's."""
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
    """Give each library one thread; how many those had that had another number."""
    before = {library: n for library in libraries if (n := library.num_threads) not in (1, None)}
    for library in before:
        _set(library, 1)
    return before


def _restore(before: dict[LibController, int]) -> None:
    for library, n in before.items():
        _set(library, n)


def _set(library: LibController, n: int) -> None:
    """Set the number of threads, also if another thread has set it last.

    OpenBLAS's controller would then do nothing, and whoever leaves last could not lift what the
    first set.
    """
    OpenBLASController.clear_controlling_thread(force=True)
    library.set_num_threads(n)
    OpenBLASController.clear_controlling_thread(force=True)


one_thread = _OneThread()  # one for the process: so is the limit


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
