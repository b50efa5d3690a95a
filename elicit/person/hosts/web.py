"""A session as a page in the browser: ``serve`` until Ctrl+C, or ``WebServer`` beside other work.

Needs the extra: pip install 'elicit-qlearn[web]'.
"""

from __future__ import annotations

import ipaddress
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING

from elicit._support.closing import Closing
from elicit._support.distribution import with_advice
from elicit.person.hosts.getting_ready import StandIn, progress_said
from elicit.person.interview import Interview, Subject
from elicit.person.session import Session

if TYPE_CHECKING:
    from starlette.types import ASGIApp

_HTTP = 80
_FAREWELL = 5  # seconds for requests that are under way when the server stops


class PageServer(Closing):
    """A server of pages, in a thread of its own, from ``serve_app`` until ``close``.

    Parameters
    ----------
    host : str
        The address, or a name of it, on which to listen. Only this machine can reach 127.0.0.1, ::1
        and localhost.
    port : int
        0 takes a free one.
    let_others_in : bool
        Needed for any other address. Its connections are not encrypted: anybody who can read the
        network can read the answers, and take part.

    Raises
    ------
    ModuleNotFoundError
        If a package of the extra is missing. The message has the command to install it.
    ValueError
        If the address cannot be opened, or needs ``let_others_in``.
    OSError
        If the port is in use.
    """

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, *, let_others_in: bool = False
    ) -> None:
        try:
            import uvicorn  # noqa: F401 - what is missing must be said before anything is opened

            import elicit.person.hosts.web_app  # noqa: F401
        except ModuleNotFoundError as error:
            raise with_advice(error) from None
        self._listening = _listening(host, port, let_others_in)
        self.port: int = self._listening.getsockname()[1]
        """The port on which the server listens."""
        name = f"[{host}]" if ":" in host else host
        names = {name, "localhost", "127.0.0.1", "[::1]"}
        ports = {
            f":{self.port}",
            *([""] if self.port == _HTTP else []),
        }  # browsers leave that one out
        self.hosts = frozenset(each.lower() + end for each in names for end in ports)
        """The names by which the server may be called, in lower case and with the port."""
        self.origin = f"http://{name}:{self.port}"
        """The beginning of every address."""

    def serve_app(self, app: ASGIApp) -> None:
        """Serve an application from now on."""
        import uvicorn

        from elicit.person.hosts.web_app import Impatient

        config = uvicorn.Config(
            app,
            loop="asyncio",
            http=Impatient,
            ws="none",
            lifespan="off",
            log_config=None,
            log_level="critical",  # lower levels report errors in strangers' requests
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=_FAREWELL,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._server.run,
            kwargs={"sockets": [self._listening]},
            name="elicit page",
            daemon=True,
        )
        self._thread.start()
        while not self._server.started and self._thread.is_alive():
            time.sleep(0.005)
        if not self._server.started:
            raise RuntimeError("the page could not be served: the error above says why")

    def close(self) -> None:
        """Stop the server, once requests under way are answered, or after a few seconds."""
        self._server.should_exit = True
        self._thread.join()


class WebServer(PageServer):
    """The page of a session, served by a thread of its own from now until ``close``.

    Closing the server does not close the session. Several servers must not share a session. The
    other parameters and the errors are those of ``PageServer``.

    Parameters
    ----------
    session : Session or None
        None if it is not made yet. The page then says that the program gets ready, until ``begin``.
    subject : Subject
    """

    def __init__(
        self,
        session: Session | None,
        subject: Subject,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        let_others_in: bool = False,
    ) -> None:
        super().__init__(host, port, let_others_in=let_others_in)
        from elicit.person.hosts.web_app import Door, application

        self._door = Door(self.port, self.hosts)
        self._subject = subject
        self._interview = None if session is None else Interview(session, subject)
        self._stand_in = StandIn()
        self.serve_app(application(self._interview or self._stand_in, self._door))

    def begin(self, session: Session) -> None:
        """Serve the page of this session, if None was given in its place before."""
        self._interview = Interview(session, self._subject)
        self._stand_in.give_way(self._interview)

    def new_address(self) -> str:
        """Return an address that lets in one browser, once. The one before it no longer works."""
        return f"{self.origin}/?token={self._door.new_token()}"

    def close(self) -> None:
        """Stop the server, once requests under way are answered, or after a few seconds."""
        super().close()
        if self._interview is not None:
            self._interview.close()


def serve(
    session: Session | Callable[[], Session],
    subject: Subject,
    host: str = "127.0.0.1",
    port: int = 0,
    *,
    let_others_in: bool = False,
) -> None:
    """Serve the page of a session until Ctrl+C.

    It prints the address on a line of standard output, and a new address for each line of standard
    input. Each address lets in one browser, once. The other parameters and the errors are those of
    ``WebServer``.

    Parameters
    ----------
    session : Session or function
        A function makes the session. It is called once the address is printed, and its errors are
        raised.
    subject : Subject
    """
    there = session if isinstance(session, Session) else None
    with (
        suppress(KeyboardInterrupt),  # a second one, while the first one is heeded
        WebServer(there, subject, host, port, let_others_in=let_others_in) as server,
        suppress(KeyboardInterrupt),
    ):
        print(server.new_address(), flush=True)
        print(
            "Open this address in a browser; it works once. Enter: another one. Ctrl+C: stop. "
            "Every answer is kept.",
            file=sys.stderr,
            flush=True,
        )
        if not isinstance(session, Session):
            with progress_said():
                server.begin(session())
        for _ in lines_entered():
            print(server.new_address(), flush=True)
        threading.Event().wait()


def lines_entered() -> Iterator[str]:
    """Yield the lines of standard input, if there is one."""
    if hasattr(signal, "SIGTTIN") and threading.current_thread() is threading.main_thread():
        signal.signal(
            signal.SIGTTIN, signal.SIG_IGN
        )  # in the background it is an error, and does not stop the process
    with suppress(OSError):
        while sys.stdin and (line := sys.stdin.readline()):
            yield line


def _listening(host: str, port: int, let_others_in: bool) -> socket.socket:
    """Return a socket that listens. Raises ValueError and OSError."""
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as error:
        raise ValueError(f"{host!r} is no address of this machine: {error.strerror}") from None
    family, _, _, _, where = found[0]
    address = ipaddress.ip_address(str(where[0]).partition("%")[0])
    if not address.is_loopback and not let_others_in:
        raise ValueError(
            f"{host} can be reached by other machines, and what is sent there is not encrypted: if "
            "you mean that, say "
            "let_others_in=True, or --let-others-in; else listen on 127.0.0.1"
        )
    if address.is_unspecified:
        raise ValueError(
            f"{host} is no address to open: name the one of this machine by which others reach it"
        )
    listening = socket.socket(family)
    try:
        if os.name == "posix":  # elsewhere it would let another program listen there too
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(where)
        listening.listen()
    except OSError as error:
        listening.close()
        raise OSError(
            error.errno, f"cannot listen on {host}, port {port}: {error.strerror}"
        ) from None
    return listening
