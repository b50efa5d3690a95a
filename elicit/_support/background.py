"""Background work while a person reads, which stops as soon as it is in the way."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from threading import Condition, Event, Thread, main_thread
from typing import Any, Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

_LOOK = 0.2  # seconds after which a thread that waits looks whether it was given up


class MadeAhead(Generic[K, V]):
    """Values that are made before they are needed, each under a key.

    One thread may call ``steps`` while another calls ``take``.
    """

    def __init__(self) -> None:
        self._made: dict[K, V] = {}
        self._computing: tuple[K] | None = None
        self._changed = Condition()

    def steps(self, makes: Mapping[K, Callable[[], V]]) -> Iterator[None]:
        """Make a value in each step, in this order, and forget the values of other keys.

        A step that fails is left out. It fails again, and is reported, when its value is needed.
        """
        self._made = {key: made for key, made in self._made.items() if key in makes}
        for key, make in makes.items():
            if key in self._made:
                continue
            with self._changed:
                self._computing = (key,)
            try:
                self._made[key] = make()
            except Exception:
                pass
            finally:
                with self._changed:
                    self._computing = None
                    self._changed.notify_all()
            yield

    def take(self, key: K) -> V | None:
        """Remove and return the value of a key, or return None if it was not made.

        If it is being made, the call waits for it.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._computing != (key,))
        return self._made.pop(key, None)


class Turns:
    """Turns of several background threads, so that only one of them computes at a time.

    They compute in the order in which they came. No thread begins a step while somebody waits for a
    reply.
    """

    def __init__(self) -> None:
        self._changed = Condition()
        self._waiting: deque[object] = deque()
        self._computing = False
        self._replies = 0

    @contextmanager
    def reply(self) -> Iterator[None]:
        """Hold back the background threads while a reply to a person is computed."""
        with self._changed:
            self._replies += 1
        try:
            yield
        finally:
            with self._changed:
                self._replies -= 1
                self._changed.notify_all()

    def take(self, given_up: Callable[[], bool]) -> bool:
        """Wait for a turn. Return True, or False if the work was given up before the turn came.

        After the step the caller must call ``leave``.

        Parameters
        ----------
        given_up : callable
            Returns whether the work was given up.
        """
        mine = object()
        with self._changed:
            self._waiting.append(mine)
            try:
                while not given_up():
                    if not self._replies and not self._computing and self._waiting[0] is mine:
                        self._computing = True
                        return True
                    self._changed.wait(_LOOK)
                return False
            finally:
                self._waiting.remove(mine)
                self._changed.notify_all()

    def leave(self) -> None:
        """Let the next thread compute."""
        with self._changed:
            self._computing = False
            self._changed.notify_all()


class Background:
    """Background work in steps, in a thread. New work replaces the old.

    The work can be stopped between two steps, and is stopped when the program ends, so a step
    should be short. If a step fails, the rest is left out. It fails again, and is reported, when
    its result is needed.

    Parameters
    ----------
    turns : Turns, optional
        Shared by several such objects in a process.
    """

    def __init__(self, turns: Turns | None = None) -> None:
        self._thread: Thread | None = None
        self._given_up = Event()
        self._turns = turns or Turns()

    def start(self, steps: Iterator[Any]) -> None:
        """Start to compute ``steps``, one by one, in place of the earlier ones.

        Parameters
        ----------
        steps : iterator
        """
        self.stop()
        self._given_up = Event()
        self._thread = Thread(
            target=_run,
            args=(steps, self._given_up, self._thread, self._turns),
            name="elicit, while one reads",
        )
        self._thread.start()

    def stop(self) -> None:
        """Stop the work at the end of its present step, without waiting for that."""
        self._given_up.set()

    def close(self) -> None:
        """Stop the work, and wait until its thread has ended."""
        self.stop()
        if self._thread is not None:
            self._thread.join()
            self._thread = None


def _run(steps: Iterator[Any], given_up: Event, before: Thread | None, turns: Turns) -> None:
    if before is not None:
        before.join()  # it ends after its step

    # the program waits for a non-daemon thread when it ends, so the thread must notice that itself
    def is_given_up() -> bool:
        return given_up.is_set() or not main_thread().is_alive()

    while not is_given_up() and turns.take(is_given_up):
        try:
            next(steps)
        except Exception:  # including StopIteration
            return
        finally:
            turns.leave()
