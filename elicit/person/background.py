"""Background work while a person reads, which is given up as soon as it is in the way."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event, Thread, main_thread
from typing import Any


class Background:
    """A thread, one at a time, that goes through steps.

    The work can be given up between two steps, and it is once the program ends, so a step should be
    short. If a step fails, the rest is left out. It fails again, and is reported, where its result
    is needed.
    """

    def __init__(self) -> None:
        self._thread: Thread | None = None
        self._given_up = Event()

    def start(self, steps: Iterator[Any]) -> None:
        """Go through ``steps``, computed one by one, in place of the earlier ones.

        Parameters
        ----------
        steps : iterator
        """
        self.stop()
        self._given_up = Event()
        self._thread = Thread(
            target=_run, args=(steps, self._given_up, self._thread), name="elicit, while one reads"
        )
        self._thread.start()

    def stop(self) -> None:
        """Give up the work at the end of its present step, without waiting for it."""
        self._given_up.set()

    def close(self) -> None:
        """Give up the work, and wait until no thread is left."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None


def _run(steps: Iterator[Any], given_up: Event, before: Thread | None) -> None:
    if before is not None:
        before.join()  # it ends after its step
    # the program waits for a non-daemon thread when it ends, so the thread must notice that itself
    while not given_up.is_set() and main_thread().is_alive():
        try:
            next(steps)
        except Exception:  # including StopIteration
            return
