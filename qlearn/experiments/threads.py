"""How many threads linear algebra may use while something is computed."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager

__all__ = ["one_thread"]

_guard = threading.Lock()
_users = 0
_limit = ExitStack()


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread: how a sum is split among threads shows in its last digits. Where several threads of
    a process are in here, the limit holds until the last has left; but a limit on OpenBLAS that another thread has set
    with threadpoolctl 3.8 or later, and not lifted, stays as it is."""
    from threadpoolctl import threadpool_limits

    global _users
    with _guard:
        if not _users:
            _limit.enter_context(_limited())
        _users += 1
    try:
        with threadpool_limits(1):  # where limits are a thread's own
            yield
    finally:
        with _guard:
            _users -= 1
            if not _users:
                _limit.close()


@contextmanager
def _limited() -> Iterator[None]:
    """Limit the process. Only the thread that set a limit on OpenBLAS can lift it: here one that outlasts the rest."""
    from threadpoolctl import threadpool_limits

    held = ExitStack()
    with ThreadPoolExecutor(1) as keeper:
        try:
            keeper.submit(lambda: held.enter_context(threadpool_limits(1))).result()
            yield
        finally:
            keeper.submit(held.close).result()  # even where Ctrl-C came while the limit was being set
