"""People at the pages of a study, without browsers, and whoever runs it."""

import http.client
import json
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.scripted_person import Teach
from tests.web_person import Visitor


class Guest(Visitor):
    """A visitor who opens a link of a study, whose page lies under a path of its own."""

    def __init__(self, link: str) -> None:
        self.folder = urlsplit(link).path.rstrip("/")
        super().__init__(link)

    def fetch(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, Any, bytes]:
        """The status, headers and body of a reply, of a path within the page's own."""
        return super().fetch(method, self.folder + path, body, **headers)


def anywhere(visitor: Visitor, method: str, path: str, body: Any = None, **headers: str) -> Any:
    """The status, headers and body of a reply to any path of the visitor's server, as it is."""
    connection = http.client.HTTPConnection(visitor.at.netloc, timeout=60)
    try:
        sent = {name.replace("_", "-"): text for name, text in headers.items()}
        connection.request(method, path, body, sent)
        reply = connection.getresponse()
        return reply.status, reply.headers, reply.read()
    finally:
        connection.close()


def posted(visitor: Visitor, path: str, message: Mapping[str, str], cookie: str) -> Any:
    """The status and the reply of a message to any path, with a cookie."""
    headers = {"origin": f"http://{visitor.at.netloc}", "content_type": "application/json"}
    body = json.dumps(message)
    status, _, reply = anywhere(visitor, "POST", path, body, cookie=cookie, **headers)
    return status, reply


class TeachStudy(Teach):
    """``qlearn teach --web --people`` with these options, run in a folder, and the links that it
    prints. ``runner`` has opened the page of whoever runs it.
    """

    def __init__(self, folder: Path, people: str, *options: str) -> None:
        super().__init__(folder, "--web", "--people", people, *options)
        self.links = dict(self.printed() for _ in people.split(","))
        _, self.address = self.printed()

    def printed(self) -> tuple[str, str]:
        """The name and the address of the next line that it prints."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline().decode().rstrip()
        who, _, address = line.partition(": ")
        if not address:
            raise ConnectionError(f"it ended with {line!r}")
        return who, address

    def interrupt(self) -> tuple[int, str, str]:
        """Ctrl+C; the exit code, what was printed since, and the error stream."""
        self.process.send_signal(signal.SIGINT)
        rest, errors = self.process.communicate(timeout=60)
        return self.process.returncode, rest.decode(), errors.decode()
