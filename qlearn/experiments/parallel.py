"""Many runs at once: a function applied to many cells, on all cores or on a cluster.

A journal lets the same call resume after an interruption. Only the calling process writes it, so
that workers need no common disk. A row's key is a hash of all that the row depends on. A journal
may hold rows of other settings, which are left alone. So adding seeds, or going back to earlier
settings, computes only the missing rows.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias, TypedDict, Unpack

from elicit._support.keywords import check_keywords

if sys.platform != "win32":
    import fcntl

Cell: TypeAlias = Mapping[str, Any]

_START = b'{"key": "'  # of every line of a journal


class Interrupted(KeyboardInterrupt):
    """Error for Ctrl-C during a sweep, with the rows that have finished.

    ``frame`` is the table of the finished rows, if the sweep was to make one.

    Parameters
    ----------
    rows : list
        The row of each cell in its place, or None if it had not finished.
    """

    def __init__(self, rows: list[Any]) -> None:
        super().__init__(
            f"interrupted after {sum(row is not None for row in rows)} of {len(rows)} rows"
        )
        self.rows = rows
        self.frame: Any = None


class SweepOptions(TypedDict, total=False):
    """Keywords of everything that makes many runs.

    Attributes
    ----------
    jobs : int, optional
        Number of processes. -1: one for each core. 1: this one. None: as an outer
        ``joblib.parallel_config`` says, else -1. The backend is the outer one (Dask, say, which
        chooses its number of workers itself), else loky.
    journal : Path, optional
        File in which finished rows are kept and looked up, under a hash of function, shared and
        cell. It has one line for each row, written to the disk at once. None: no journal.
    fresh : bool
        Empty the journal first.
    progress : function, optional
        Called with (rows finished, rows in all) at the start and after every row.
    """

    jobs: int | None
    journal: Path | None
    fresh: bool
    progress: Callable[[int, int], None] | None


def sweep(
    function: Callable[..., Any],
    cells: Sequence[Cell],
    *,
    shared: Mapping[str, Any] | None = None,
    cost: Callable[[Any], float] | None = None,
    ahead: Callable[[Iterable[Cell]], Iterable[Callable[[], None]]] | None = None,
    own: Callable[[Cell], tuple[Any, Mapping[str, Any]]] | None = None,
    **how: Unpack[SweepOptions],
) -> list[Any]:
    """Return ``function(cell, **shared)`` for every cell: the rows, in the order of ``cells``.

    Linear algebra has one thread while a cell is computed, because the number of threads changes
    the last digits of a sum. A process of a cluster keeps that limit.

    Parameters
    ----------
    function : function
        Importable by workers. It returns what JSON can hold (arrays are returned as lists), the
        same for the same arguments. All rows pass through JSON, which keeps every bit of a float.
        So a row is the same whether it was computed or read back.
    cells : sequence
        JSON, as are ``shared``.
    shared : mapping
        Keywords that all cells have in common.
    cost : function
        Gives a cell's cost. The most costly cells begin first, so that no core is left alone with a
        long one.
    ahead : function
        Takes the cells whose rows are missing and returns functions, importable by workers. They
        are called first, side by side, for work that each process would otherwise do for itself,
        such as compiling.
    own : function
        Takes a cell and returns two things about its parts that JSON cannot hold: an identity in
        JSON, by which the row is looked up, and the parts themselves, as keywords of ``function``.
        They may be functions of any kind, which cloudpickle sends to workers.
    **how
        The options of ``SweepOptions``.

    Raises
    ------
    Interrupted
        On Ctrl-C.
    BrokenExecutor
        If a worker process died (killed, or out of memory).
    BlockingIOError
        If another process writes to the journal.
    ValueError
        If the file is no journal. It is left as it is.
    Exception
        Any that ``function`` or the work ahead raises.

    Notes
    -----
    After any of these errors the journal keeps the rows that have finished, and the same call goes
    on from there.
    """
    from threadpoolctl import threadpool_limits

    check_keywords(sweep, how, SweepOptions.__annotations__)
    journal, fresh, jobs = how.get("journal"), how.get("fresh", False), how.get("jobs")
    shared = dict(shared or {})
    besides = [own(cell) if own else (None, {}) for cell in cells]
    keys = [
        _key(function, shared, cell, what) for cell, (what, _) in zip(cells, besides, strict=True)
    ]
    keywords = {key: {**shared, **more} for key, (_, more) in zip(keys, besides, strict=True)}
    with ExitStack() as stack:
        stack.enter_context(
            threadpool_limits(1)
        )  # only the thread that set a limit can lift it: not each cell
        kept, keep = stack.enter_context(_journal(journal, fresh)) if journal else ({}, None)
        rows = {key: kept[key] for key in keys if key in kept}
        missing = {key: cell for key, cell in zip(keys, cells, strict=True) if key not in rows}
        total = len(rows) + len(missing)
        show = how.get("progress") or (lambda done, total: None)
        try:
            show(len(rows), total)
            for _ in _computed(
                ((part, ()) for part in (ahead(missing.values()) if ahead else ())), jobs
            ):
                pass
            order = sorted(missing, key=lambda key: -cost(missing[key]) if cost else 0.0)
            calls = ((_call, (function, key, missing[key], keywords[key])) for key in order)
            for key, row in stack.enter_context(closing(_computed(calls, jobs))):
                text = _json(row)
                if keep is not None:
                    keep(key, text)
                rows[key] = json.loads(text)
                show(len(rows), total)
        except KeyboardInterrupt:
            raise Interrupted([rows.get(key) for key in keys]) from None
    return [rows[key] for key in keys]


def _key(function: Callable[..., Any], shared: Mapping[str, Any], cell: Cell, own: Any) -> str:
    name = f"{function.__module__}.{function.__qualname__}"
    told = [name, dict(sorted(shared.items())), dict(sorted(cell.items()))]
    text = _json(told if own is None else [*told, own])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _json(value: Any) -> str:
    return json.dumps(value, default=_plain)


def _plain(value: Any) -> Any:
    """Return NumPy's numbers and arrays as Python's."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(
        f"cells, settings and rows must be plain values that JSON can hold, not {value!r}"
    )


def _computed(
    calls: Iterator[tuple[Callable[..., Any], tuple[Any, ...]]], jobs: int | None
) -> Generator[Any]:
    """Yield the results of calls as they finish, in any order."""
    import joblib
    from joblib.parallel import LokyBackend, get_active_backend

    backend, configured = get_active_backend()
    jobs = next((n for n in (jobs, configured) if n is not None), -1)
    with ExitStack() as stack:
        parent = None
        if isinstance(backend, LokyBackend):
            parent = os.getpid()
            # for numba, and for threads that a library starts early: set where the process
            # begins
            stack.enter_context(
                joblib.parallel_config("loky", n_jobs=jobs, inner_max_num_threads=1)
            )
        # one call a task: a batch would be lost, or reported, as a whole
        parallel = joblib.Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        results = parallel(
            joblib.delayed(_in_worker)(parent, call, arguments) for call, arguments in calls
        )
        try:
            for result in results:  # noqa: UP028 - "yield from" would close them itself, with joblib's warning
                yield result
        finally:
            with warnings.catch_warnings():  # that not all was used: the caller knows
                warnings.filterwarnings(
                    "ignore", ".*(successfully executed|still being processed)", UserWarning
                )
                results.close()


def _in_worker(parent: int | None, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    if parent not in (None, os.getpid()):
        _end_with(parent)
    return call(*arguments)


def _call(
    function: Callable[..., Any], key: str, cell: Cell, keywords: Mapping[str, Any]
) -> tuple[str, Any]:
    from threadpoolctl import threadpool_limits

    threadpool_limits(
        1
    )  # for good: another thread of this process may be at a cell of its own when this one is done
    return key, function(cell, **keywords)


@cache
def _end_with(parent: int) -> None:
    """End this process when its parent process is gone.

    Otherwise loky's workers would go on with rows that nobody waits for.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _journal(
    path: Path, fresh: bool
) -> Iterator[tuple[dict[str, Any], Callable[[str, str], None]]]:
    """Return the rows of a journal by their keys, and a function that appends a row.

    A row is given as JSON on one line. A last line that was cut short is removed, because its row
    has not finished. Missing folders are made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        _lock(file, path)
        file.seek(0)
        text = file.read()
        if not text.startswith(_START[: len(text)]):
            raise ValueError(
                f"{path} is no journal, it begins {text[:40]!r}: move it away, or name another file"
            )
        whole = 0 if fresh else text.rfind(b"\n") + 1
        rows = dict[str, Any]()
        for number, line in enumerate(text[:whole].splitlines(), start=1):
            try:
                entry = json.loads(line)
                rows[entry["key"]] = entry["row"]
            except (ValueError, TypeError, KeyError):
                found = f"line {number} of {path} is no finished row but {line[:40]!r}"
                raise ValueError(f"{found}: move the file away, or start over (fresh)") from None
        file.truncate(whole)

        def append(key: str, row: str) -> None:
            file.write(_START + f'{key}", "row": {row}}}\n'.encode())
            file.flush()
            os.fsync(file.fileno())

        yield rows, append


def _lock(file: BinaryIO, path: Path) -> None:
    """Lock the file until it is closed, or the process has ended.

    If the system has no file locks, two processes may append equal rows as whole lines. Then only
    time is lost.
    """
    if sys.platform != "win32":
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BlockingIOError(
                f"another process is writing to {path}: wait for it, or take another place"
            ) from None
        except OSError:  # a file system without locks
            pass
