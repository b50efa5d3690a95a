"""A person at the page of ``qlearn teach --web``, without a browser: messages over HTTP, answered
by hidden values.
"""

import http.client
import json
import signal
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.scripted_person import Teach


class Visitor:
    """A visitor who opens a printed address.

    It keeps the cookie that it is given, what it sent, and the replies.
    """

    def __init__(self, address: str) -> None:
        self.at = urlsplit(address)
        self.status, headers, _ = self.fetch("GET", f"/?{self.at.query}")
        self.cookie = headers.get("set-cookie", "").split(";")[0]

    def fetch(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, Any, bytes]:
        """The status, headers and body of a reply, over a connection of its own."""
        connection = http.client.HTTPConnection(self.at.netloc, timeout=60)
        try:
            connection.request(
                method, path, body, {name.replace("_", "-"): text for name, text in headers.items()}
            )
            reply = connection.getresponse()
            return reply.status, reply.headers, reply.read()
        finally:
            connection.close()

    def post(self, message: Any, **headers: str) -> tuple[int, Any]:
        """The status of a message, and its reply."""
        usual = {
            "origin": f"http://{self.at.netloc}",
            "content_type": "application/json",
            "cookie": self.cookie,
        }
        body = message if isinstance(message, (str, bytes)) else json.dumps(message)
        status, _, reply = self.fetch("POST", "/api", body, **{**usual, **headers})
        return status, json.loads(reply)

    def screen(self, do: str = "state", **parts: str) -> Any:
        """The screen after a message, which must be taken."""
        status, reply = self.post({"do": do, **parts})
        while status == 200 and "getting_ready" in reply:
            time.sleep(0.1)
            status, reply = self.post({"do": do, **parts})
        assert status == 200, reply
        return reply


class TeachWeb(Teach):
    """``qlearn teach --web`` with these options, run in a folder, and who opens the address that it
    prints.
    """

    def __init__(self, folder: Path, *options: str) -> None:
        super().__init__(folder, "--web", *options)
        self.visitor = Visitor(self.printed())

    def printed(self) -> str:
        """The next line that it prints."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().decode().rstrip()

    def interrupt(self) -> tuple[int, str, str]:
        """Ctrl+C; the exit code, what was printed since, and the error stream."""
        self.process.send_signal(signal.SIGINT)
        rest, errors = self.process.communicate(timeout=60)
        return self.process.returncode, rest.decode(), errors.decode()


def truthful(question: Any, values: Mapping[str, float]) -> str:
    """Return the choice between the two sides of a question, by the values of the named levels."""
    apart = sum(values[row["label"]] * (row["a"] - row["b"]) for row in question["rows"])
    return "equal" if abs(apart) < 1e-9 else "a" if apart > 0 else "b"


def answer_all(
    visitor: Visitor,
    values: Mapping[str, float],
    most: int = 1000,
    acknowledged: Callable[[str], None] = lambda id: None,
) -> Any:
    """Answer truthfully, so many questions at most, the practice one included; each id is told once
    its answer was taken. Returns the screen then."""
    screen = visitor.screen()
    for _ in range(most):
        if screen["stage"] == "welcome":
            screen = visitor.screen("start")
        if screen["stage"] == "offer":  # to stop before it is settled
            screen = visitor.screen("choose", option="on")
        question = screen["question"]
        if question is None:
            break
        if screen["stage"] == "practice":
            screen = visitor.screen("practised", choice="a")
            continue
        screen = visitor.screen("answer", id=question["id"], choice=truthful(question, values))
        acknowledged(question["id"])
    return screen


def untimed(end: Mapping[str, Any]) -> dict[str, Any]:
    """Return the texts of the end's screen, without remarks on the speed of the answers."""
    return {name: said for name, said in end.items() if name != "remarks"}
