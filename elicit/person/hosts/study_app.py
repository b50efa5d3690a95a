"""The pages of a study as an ASGI application: one for each person, one for the study's runner.

Each page has its own path, and its own token and cookie. The browser sends the cookie to this path
alone. Otherwise a page is like that of a single session (``web_app``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send

from elicit.person.hosts.getting_ready import StandIn
from elicit.person.hosts.web_app import Door, application
from elicit.person.showing import printable
from elicit.person.study.study import Study

RUNNER = "study"
"""The first part of the path of the page for the person who runs the study."""
_ASK = "Ask whoever runs the study for a new link."
_KEPT = (
    "Each link lets in one browser, once, and a new one is needed after a restart of the program. "
    "All answers are kept."
)


class Reception:
    """Access to the pages of a study, and the messages of the person who runs it.

    The messages are those of ``Study``, with two more fields for each person: ``link`` (the link
    that was not opened yet, or null) and ``opened`` (true if a browser was let in by the newest
    link). There is also ``{"do": "link", "who": ...}``, which makes a new link for a person and
    shuts out the browsers that older links let in. Its reply is that to ``state``.

    Parameters
    ----------
    people : sequence of str
        Their names. Until ``begin`` their pages say that the program gets ready.
    port : int
    hosts : iterable of str
        As for ``Door``.
    origin : str
        The beginning of every address.
    """

    def __init__(self, people: Sequence[str], port: int, hosts: Iterable[str], origin: str) -> None:
        self._study: Study | None = None
        self._begun, self._origin = StandIn(), origin
        self._rooms = {who: StandIn() for who in people}
        names = frozenset(hosts)
        self._doors = {
            who: Door(port, names, f"/{number}/", _ASK, _KEPT)
            for number, who in enumerate(people, 1)
        }
        self._runner = Door(port, names, f"/{RUNNER}/")
        self._nobody = Door(port, names, "/", _ASK, _KEPT)
        for door in self._doors.values():
            door.new_token()

    def begin(self, study: Study) -> None:
        """Pass messages to each person's interview in the study from now on."""
        self._study = study
        for who, interview in study.interviews.items():
            self._rooms[who].give_way(interview)

    def links(self) -> dict[str, str]:
        """Return each person's link that was not opened yet."""
        return {
            who: self._link(door) for who, door in self._doors.items() if door.token is not None
        }

    def new_runner_address(self) -> str:
        """Return an address that lets in the person who runs the study, once.

        The address before it no longer works.
        """
        self._runner.new_token()
        return self._link(self._runner)

    def application(self) -> ASGIApp:
        """Return the application."""
        rooms: dict[str, ASGIApp] = {
            door.path.strip("/"): application(self._rooms[who], door, "person.html")
            for who, door in self._doors.items()
        }
        rooms[RUNNER] = application(self, self._runner, "runner.html")
        nobody = application(self, self._nobody)

        async def route(scope: Scope, receive: Receive, send: Send) -> None:
            first, slash, rest = str(scope["path"]).removeprefix("/").partition("/")
            room = rooms.get(first) if slash and scope["path"].startswith("/") else None
            if room is None:
                await nobody(scope, receive, send)
            else:
                await room({**scope, "path": f"/{rest}"}, receive, send)

        return route

    @property
    def who(self) -> str:
        """The name of the page's person, for messages to the person who runs the program."""
        return "whoever runs the study"

    def handle(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Return the reply to a message of the person who runs the study.

        Raises
        ------
        ValueError
            For something that is no message.
        """
        parts = dict(message)
        if self._study is None:
            return self._begun.handle(parts)
        if parts.get("do") == "link":
            door = next(
                (d for who, d in self._doors.items() if printable(who) == parts.get("who")), None
            )
            if door is None or len(parts) != 2:
                raise ValueError("a link is for one of the people of the study")
            door.new_token(shut_out=True)
            parts = {"do": "state"}
        reply = self._study.handle(parts)
        if parts["do"] == "agreement":
            return reply
        doors = zip(reply["people"], self._doors.values(), strict=True)
        people = [
            {
                **person,
                "link": None if door.token is None else self._link(door),
                "opened": door.opened,
            }
            for person, door in doors
        ]
        return {**reply, "people": people}

    def _link(self, door: Door) -> str:
        return f"{self._origin}{door.path}?token={door.token}"
