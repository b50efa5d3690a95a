"""A stand-in for an interview that is not ready yet, and progress on the terminal.

The first session on a machine compiles, which takes up to two minutes. Meanwhile a page can be
opened: every message to it is answered with ``{"getting_ready": seconds so far}``, and the page
sends it again.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

GETTING_READY = "getting_ready"
"""The only field of a reply before the interview is ready: the seconds so far."""
SAID = (
    "Getting ready: a few seconds. The first start on a computer compiles, which takes up to two "
    "minutes."
)
"""The first line of ``progress_said``."""
_EVERY = 10.0  # seconds between two lines of progress


class Takes(Protocol):
    """Protocol of an object that takes the messages of a page, such as an ``Interview``."""

    @property
    def who(self) -> str:
        """The name of the page's person, for messages to the person who runs the program."""

    def handle(self, message: Mapping[str, Any], /) -> dict[str, Any]:
        """Return the reply to a message."""


class StandIn:
    """Takes messages in place of an interview that is not ready yet."""

    def __init__(self) -> None:
        self._begun = time.monotonic()
        self._takes: Takes | None = None

    @property
    def who(self) -> str:
        """The name of the page's person, for messages to the person who runs the program."""
        return "a person" if self._takes is None else self._takes.who

    def handle(self, message: Mapping[str, Any], /) -> dict[str, Any]:
        """Return the interview's reply, or for how long it has been getting ready."""
        if self._takes is None:
            return {GETTING_READY: int(time.monotonic() - self._begun)}
        return self._takes.handle(message)

    def give_way(self, to: Takes) -> None:
        """Pass every message to this interview from now on."""
        self._takes = to


@contextmanager
def progress_said() -> Iterator[None]:
    """Say on standard error that the program gets ready, and every ten seconds for how long."""
    begun, over = time.monotonic(), threading.Event()

    def say_on() -> None:
        while not over.wait(_EVERY):
            print(f"  {time.monotonic() - begun:.0f} s so far", file=sys.stderr, flush=True)

    print(SAID, file=sys.stderr, flush=True)
    says = threading.Thread(target=say_on, name="elicit, getting ready", daemon=True)
    says.start()
    try:
        yield
    finally:
        over.set()
        says.join()
