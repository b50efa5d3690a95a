"""Work that goes on while a person reads, and is given up as soon as it is in the way."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event, Thread, main_thread
from typing import Any


class Background:
    """One thread at a time that goes through steps. Between two of them the work can be given up, and it is once the
    program ends, so a step should be short. Where one fails the rest is left out: that will fail again, and be told,
    where it is needed."""

    def __init__(self) -> None:
        self._thread: Thread | None = None
        self._given_up = Event()

    def start(self, steps: Iterator[Any]) -> None:
        """Go through ``steps``, computed one by one, in place of what went on before."""
        self.stop()
        self._given_up = Event()
        self._thread = Thread(target=_run, args=(steps, self._given_up, self._thread), name="elicit, while one reads")
        self._thread.start()

    def stop(self) -> None:
        """Give up what goes on: at the end of its present step, for which nobody waits."""
        self._given_up.set()

    def close(self) -> None:
        """Give up what goes on, and wait until no thread is left."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None


def _run(steps: Iterator[Any], given_up: Event, before: Thread | None) -> None:
    if before is not None:
        before.join()  # at the end of its step
    # a thread that is no daemon is waited for when the program ends: it must see that for itself
    while not given_up.is_set() and main_thread().is_alive():
        try:
            next(steps)
        except Exception:  # StopIteration, too
            return
