"""Many runs at once: one function over many cells, on all cores or on a cluster, with a journal to go on from.

Only the calling process writes the journal, a line a finished row, so that workers need no common disk. A row's key is
a hash of all that it depends on, and a journal may hold rows of other settings, which are left alone: to add seeds to a
sweep, or to go back to earlier settings, computes only what is missing.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, closing, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

from qlearn.experiments.journal import Journal
from qlearn.experiments.threads import one_thread

__all__ = ["Cell", "Unfinished", "do_first", "sweep"]

Cell: TypeAlias = Mapping[str, Any]
Function: TypeAlias = Callable[..., Any]

_FORMAT = 1  # of the journal, part of every key


class Unfinished(KeyboardInterrupt):
    """Ctrl-C during a sweep. ``rows`` has the row of each cell in its place, None where it had not finished."""

    def __init__(self, rows: list[Any]) -> None:
        super().__init__(f"interrupted after {sum(row is not None for row in rows)} of {len(rows)} rows")
        self.rows = rows


def sweep(
    function: Function,
    cells: Sequence[Cell],
    *,
    shared: Mapping[str, Any] | None = None,
    stamp: str = "",
    journal: Path | None = None,
    fresh: bool = False,
    jobs: int | None = None,
    cost: Callable[[Any], float] | None = None,
    ahead: Callable[[Iterable[Cell]], Sequence[Callable[[], None]]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """``function(cell, **shared)`` for every cell: the rows, in the order of ``cells``.

    function  importable by workers; returns what JSON can hold (arrays are returned as lists), the same for the same
              arguments. All rows pass through JSON, which keeps every bit of a float, so that a row is the same
              whether it was computed or read back
    shared    keywords that all cells have in common; these and the cells are JSON too
    stamp     what else a row depends on, such as the version of the code
    journal   file in which finished rows are kept and looked up, under a hash of function, shared, cell and stamp.
              None: nowhere. ``fresh`` empties it first
    jobs      processes; -1: one a core; 1: this one. None: as an outer ``joblib.parallel_config`` says, else -1. The
              backend is the outer one (Dask, say, which has its own idea of the number of workers), else loky.
              A cell runs on one thread wherever it runs
    cost      cells of the greatest cost begin first, so that no core is left alone with a long one at the end
    ahead     from the cells whose rows are missing to functions, importable by workers, that are called first, side by
              side, where there are several processes: for what each would else do for itself, such as to compile
    progress  called with (rows finished, rows in all) at the start and after every row

    Where a worker process of this machine dies (killed, or out of memory) the rest goes on with a RuntimeWarning, and
    what was in flight is tried once more, alone. Raises BrokenExecutor for a row that kills its worker again, after all
    others; Unfinished on Ctrl-C; what ``function`` raises, or what goes ahead; and what ``Journal`` raises. In all
    these cases the journal keeps the rows that have finished.
    """
    shared = dict(shared or {})
    keys = [_key(function, shared, cell, stamp) for cell in cells]
    rows: dict[str, Any] = {}
    with ExitStack() as stack:
        book = stack.enter_context(closing(Journal(journal, fresh=fresh))) if journal else None
        if book is not None:
            rows = {key: book.rows[key] for key in keys if key in book.rows}
        missing = {key: cell for key, cell in zip(keys, cells, strict=True) if key not in rows}
        total = len(rows) + len(missing)
        try:
            if progress is not None:
                progress(len(rows), total)
            if ahead is not None and not _alone(jobs):
                do_first(ahead(missing.values()), jobs)
            finished = stack.enter_context(closing(_finished(function, _ordered(missing, cost), shared, jobs)))
            for key, row in finished:
                text = _json(row)
                if book is not None:
                    book.append(key, text)
                rows[key] = json.loads(text)
                if progress is not None:
                    progress(len(rows), total)
        except KeyboardInterrupt:
            raise Unfinished([rows.get(key) for key in keys]) from None
    return [rows[key] for key in keys]


def do_first(parts: Sequence[Callable[[], None]], jobs: int | None = None) -> None:
    """Call each part, side by side: what ``sweep`` does with what goes ahead."""
    tasks = [(str(i), {"part": part}) for i, part in enumerate(parts)]
    with suppress(BrokenExecutor):  # then each process does for itself what it needs
        for _ in _as_they_come(_do, iter(tasks), {}, jobs):
            pass


def _do(task: Cell) -> None:
    task["part"]()


def _key(function: Function, shared: Mapping[str, Any], cell: Cell, stamp: str) -> str:
    name = f"{function.__module__}.{function.__qualname__}"
    text = _json([_FORMAT, name, stamp, dict(sorted(shared.items())), dict(sorted(cell.items()))])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    """Numpy's numbers and arrays as Python's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"cells, settings and rows must be plain values that JSON can hold, not {value!r}")


def _ordered(cells: Mapping[str, Cell], cost: Callable[[Any], float] | None) -> list[tuple[str, Cell]]:
    return sorted(cells.items(), key=lambda item: -cost(item[1]) if cost else 0.0)


def _finished(
    function: Function, tasks: Sequence[tuple[str, Cell]], shared: Mapping[str, Any], jobs: int | None
) -> Generator[tuple[str, Any], None, None]:
    """(key, row) as they come, in any order. Goes on when a worker dies, and tries what was then in flight again."""
    left, suspects = dict(tasks), dict[str, Cell]()
    begun: list[str] = []

    def begin(some: Mapping[str, Cell]) -> Iterator[tuple[str, Cell]]:
        for key, cell in list(some.items()):
            begun.append(key)
            yield key, cell

    while left:
        begun.clear()
        try:
            with closing(_as_they_come(function, begin(left), shared, jobs)) as results:
                for key, row in results:
                    del left[key]
                    yield key, row
        except BrokenExecutor:
            suspects |= {key: left.pop(key) for key in begun if key in left}
            message = "a worker process died (killed, or out of memory?): what it was at is tried again at the end"
            warnings.warn(message, RuntimeWarning, stacklevel=3)
    failure: BrokenExecutor | None = None
    for item in suspects.items():  # one at a time: a row that kills its worker takes no other with it
        try:
            with closing(_as_they_come(function, iter([item]), shared, jobs)) as results:
                yield from results
        except BrokenExecutor as error:
            failure = error
    if failure is not None:
        raise failure


def _as_they_come(
    function: Function, tasks: Iterator[tuple[str, Cell]], shared: Mapping[str, Any], jobs: int | None
) -> Generator[tuple[str, Any], None, None]:
    import joblib
    from joblib.parallel import LokyBackend

    if _alone(jobs):
        yield from (_call(function, key, cell, shared) for key, cell in tasks)
        return
    backend, jobs = _backend(jobs)
    parent = os.getpid() if isinstance(backend, LokyBackend) else None
    calls = (joblib.delayed(_call)(function, key, cell, shared, parent) for key, cell in tasks)
    with ExitStack() as stack:
        if isinstance(backend, LokyBackend):
            # for numba and what a library starts before it can be told: set where the process begins
            stack.enter_context(joblib.parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1))
        # one row a task: a batch would be lost, or reported, as a whole
        results = joblib.Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")(calls)
        try:
            for result in results:  # noqa: UP028 - "yield from" would close them itself, with joblib's warning
                yield result
        finally:
            with warnings.catch_warnings():  # that not all was used: the caller knows
                warnings.filterwarnings("ignore", ".*(successfully executed|still being processed)", UserWarning)
                results.close()


def _backend(jobs: int | None) -> tuple[Any, int]:
    """The backend that joblib would use, and how many processes are asked of it."""
    from joblib.parallel import get_active_backend

    backend, configured = get_active_backend()
    return backend, next((n for n in (jobs, configured) if n is not None), -1)


def _alone(jobs: int | None) -> bool:
    """Whether all is done in this process."""
    from joblib.parallel import LokyBackend, SequentialBackend

    backend, jobs = _backend(jobs)
    return jobs == 1 or (isinstance(backend, (LokyBackend, SequentialBackend)) and backend.effective_n_jobs(jobs) == 1)


def _call(
    function: Function, key: str, cell: Cell, shared: Mapping[str, Any], parent: int | None = None
) -> tuple[str, Any]:
    if parent is not None:
        _end_with(parent)
    with one_thread():
        return key, function(cell, **shared)


@cache
def _end_with(parent: int) -> None:
    """End this process when its parent is gone. Loky's workers would go on with rows that nobody waits for."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
