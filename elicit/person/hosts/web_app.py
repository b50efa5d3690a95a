"""The page as an ASGI application: access control, files, messages, and errors.

Opening the address with the launch token gives a browser a cookie. Requests without the cookie get
nothing. What the browser says about the origin of a request must fit too, so that another open page
cannot use the cookie.
"""

import asyncio
import errno
import hmac
import json
import logging
import secrets
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from anyio import CapacityLimiter, to_thread
from starlette.applications import Starlette
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from elicit.person.hosts.getting_ready import Takes
from elicit.person.interview import SavedWithoutScreen
from elicit.tutors.log_file import BadLog

PAGE = Path(__file__).with_name("page")
_TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
_MOST = 16 * 1024  # bytes of a message: an id and a choice
_AT_ONCE = 16  # messages to one page that are computed at once; further ones wait for these
PATIENCE = 10.0
"""Seconds that a request may take to arrive."""
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}
NOT_LET_IN = (
    "If somebody sent you this address, ask them for a new one. If the program runs on this "
    "computer, press Enter in its terminal, and open the address that it prints then."
)
_CLOSED_STYLE = "closed.css"
"""The only file that everybody may read: the style of the page for people who are refused."""
_LOOKS = b"\n".join((PAGE / name).read_bytes() for name in ("style.css", "page.css"))
_CLOSED_DOOR = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Not open to this browser</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="{_CLOSED_STYLE}">
</head>
<body>
<main class="elicit">
<div class="sheet">
<div class="middle">
<div class="wrap">
<h1>Not open to this browser</h1>
<section class="panel">
<p>{{advice}}</p>
<p class="soft">{{why}}</p>
</section>
</div>
</div>
</div>
</main>
</body>
</html>
"""

_FAILED = "the page of %s: the message %r could not be answered: %s"
_CUT_SHORT = "the page of %s: the program ended while the message %r was being answered"
_ENDED = (
    "The program was stopped while this was worked out. All answers that were saved are safe. "
    "Once it runs again, open its new address, or press Try again here."
)
_WENT_WRONG = "Something went wrong in the program. All answers that were saved are safe."
_NEXT_FAILED = "Your answer is saved, but what comes next could not be worked out."
_IF_AGAIN = (
    "Press Try again. If that does not help, tell whoever runs the program, which says more where "
    "it runs."
)
_WHY = (
    "Each address lets in one browser, once. If the program was stopped, it has to be started "
    "again with the same command. All answers are kept."
)
_DAYS = 30
"""Days for which a browser stays let in, even if it is closed meanwhile: people are told to come
back."""

_log = logging.getLogger(__name__)


class Impatient(H11Protocol):
    """HTTP/1.1 that closes a connection without any request after some seconds.

    Later requests need no such limit: a refused request ends its connection.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self.loop.call_later(PATIENCE, self._give_up)

    def _give_up(self) -> None:
        if self.cycle is None and not self.transport.is_closing():
            self.transport.close()


class Door:
    """Access to a page: the valid launch token, and the cookie that it gives.

    Parameters
    ----------
    port : int
        A part of the cookie's name, because a browser sends a host's cookies to all its ports.
    hosts : iterable of str
        The names, in lower case and with their ports, by which the page may be called.
    path : str
        The path of the page. The cookie is sent to this path alone.
    advice : str
        A sentence on how to get in, for people who are refused.
    why : str
        Further sentences to them.
    """

    def __init__(
        self,
        port: int,
        hosts: Iterable[str],
        path: str = "/",
        advice: str = NOT_LET_IN,
        why: str = _WHY,
    ) -> None:
        self.cookie = f"elicit-{port}"
        self.hosts = frozenset(hosts)
        self.path, self.advice = path, advice
        self.closed_page = _CLOSED_DOOR.format(advice=advice, why=why)
        self.secret = secrets.token_urlsafe(32)
        self._token: str | None = None
        self._lock = threading.Lock()
        self.opened = False
        """True if a browser was let in with the newest token."""

    @property
    def token(self) -> str | None:
        """The token that still works; None if it was used, or there was none."""
        return self._token

    def new_token(self, shut_out: bool = False) -> str:
        """Return a new token that works once. The token before it no longer works.

        With ``shut_out``, the browsers that were let in before are refused from now on.
        """
        with self._lock:
            if shut_out:
                self.secret = secrets.token_urlsafe(32)
            self._token, self.opened = secrets.token_urlsafe(32), False
            return self._token

    def takes(self, token: str) -> bool:
        """Return whether this is the token, which is then used up."""
        with self._lock:
            if self._token is None or not _same(token, self._token):
                return False
            self._token, self.opened = None, True
            return True

    def knows(self, request: Request) -> bool:
        """Return whether a request has the cookie.

        It may have several of the same name, since another program on this host may have set one.
        """
        pairs = (
            pair.partition("=")
            for line in request.headers.getlist("cookie")
            for pair in line.split(";")
        )
        return any(
            _same(value.strip(), self.secret)
            for name, _, value in pairs
            if name.strip() == self.cookie
        )


def application(interview: Takes, door: Door, start: str = "page.html") -> ASGIApp:
    """Return the page as an application, with ``POST /api``, which takes a message and replies.

    Messages are for the interview. Messages and replies are JSON. ``start`` is the file of the page
    at "/".
    """
    at_once = CapacityLimiter(_AT_ONCE)

    async def page(request: Request) -> Response:
        return _file(request.path_params.get("name", start))

    async def api(request: Request) -> Response:
        return await _reply(interview, await _message(request), at_once)

    routes = [Route("/", page), Route("/page/{name}", page), Route("/api", api, methods=["POST"])]
    app = Starlette(routes=routes, exception_handlers={HTTPException: _refused})
    app.router.redirect_slashes = False  # there is one name for a thing
    return _Guarded(app, door)


class _Guarded:
    """Middleware that refuses requests that are not the person's, and sets headers on responses."""

    def __init__(self, app: ASGIApp, door: Door) -> None:
        self._app, self._door = app, door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if message["status"] >= 400:  # the rest of such a request is not waited for
                    headers["connection"] = "close"
            await send(message)

        request = Request(scope)
        app = self._elsewhere(request) or self._stranger(request) or self._app
        try:
            await app(scope, receive, with_headers)
        except Exception:  # else nobody would be told, for the server's own log is off
            _log.exception("a request for %s could not be answered", self._door.path)
            raise

    def _elsewhere(self, request: Request) -> Response | None:
        """Return the refusal of a request that a browser sends for another page, or None.

        Such a request is to another name (which now means this machine), or from another origin.
        """
        called = [host.lower() for host in request.headers.getlist("host")]
        if len(called) != 1 or called[0] not in self._door.hosts:
            return _error(
                421, "This page is not called so: open the address that the program printed."
            )
        origins, site = request.headers.getlist("origin"), request.headers.get("sec-fetch-site")
        to_read = request.method in ("GET", "HEAD")
        # a link followed from elsewhere, or typed; SameSite=Strict limits what it sees
        visit = (
            to_read
            and request.scope["path"] == "/"
            and request.headers.get("sec-fetch-mode", "navigate") == "navigate"
        )
        ours = site in (None, "none", "same-origin") or visit
        if any(origin.lower() != f"http://{called[0]}" for origin in origins) or not ours:
            return _error(403, "This came from another page, and was refused.")
        if not to_read and not origins and site is None:
            return _error(403, "A message must say where it comes from: its Origin is missing.")
        return None

    def _stranger(self, request: Request) -> Response | None:
        """Return the response to a request without the cookie: the way in, or a refusal."""
        known = self._door.knows(request)
        path, tokens = request.scope["path"], request.query_params.getlist("token")
        if tokens and path == "/" and request.method == "GET":
            if self._door.takes(tokens[-1]) or known:
                return self._let_in(request)
        elif known:
            return None
        if path == "/api":
            return _error(403, self._door.advice)
        if path.endswith(f"/{_CLOSED_STYLE}") and request.method in ("GET", "HEAD"):
            return Response(_LOOKS, media_type="text/css")
        return HTMLResponse(self._door.closed_page, 403)

    def _let_in(self, request: Request) -> Response:
        if request.headers.get("sec-fetch-site", "none") in ("none", "same-origin"):
            response: Response = RedirectResponse(self._door.path, 303)
        # a link on another page: a redirection would still count as its doing, and go without the
        # cookie
        else:
            response = HTMLResponse("", headers={"refresh": f"0; url={self._door.path}"})
        response.set_cookie(
            self._door.cookie,
            self._door.secret,
            path=self._door.path,
            max_age=_DAYS * 86_400,
            httponly=True,
            samesite="strict",
        )
        return response


async def _message(request: Request) -> dict[str, Any]:
    """Return the content of a request's body. Raises HTTPException."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise HTTPException(415, "A message must be application/json.")
    too_long = HTTPException(413, f"A message has at most {_MOST:,} bytes.")
    declared = request.headers.get("content-length", "0")
    if not declared.isdecimal() or int(declared) > _MOST:
        raise too_long
    body = b""
    try:
        async with asyncio.timeout(PATIENCE):
            async for part in request.stream():
                body += part
                if len(body) > _MOST:
                    raise too_long
    except TimeoutError:
        raise HTTPException(408, "The message did not arrive in time: send it again.") from None
    except ClientDisconnect:
        raise HTTPException(400, "The message ended too early.") from None
    try:
        message = json.loads(body)
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        raise HTTPException(400, "A message must be a JSON object.")
    return message


async def _reply(interview: Takes, message: dict[str, Any], at_once: CapacityLimiter) -> Response:
    """Return the interview's reply, computed in a thread, so that other requests need not wait.

    After an error the reply says what went wrong, without any word of the answers.
    """
    try:
        reply = await to_thread.run_sync(_handled, interview, message, limiter=at_once)
        return Response(json.dumps(reply), media_type="application/json")
    except asyncio.CancelledError:
        # the program ends, and waits no longer for what takes long, such as compiling at first;
        # without a reply the server would send a bare "Internal Server Error", and say nothing here
        _log.warning(_CUT_SHORT, interview.who, message.get("do"))
        return _error(503, _ENDED, saved=True)
    except BadLog as error:
        _log.error("%s", error)
        return _error(
            507,
            "Another program moved or changed the file of the answers, so nothing more is written "
            "to it. What was "
            "saved before is not touched. Start the program again: it says what it finds.",
        )
    except OSError as error:
        _log.error("%s", error)
        room = error.errno in (None, *_NO_ROOM)
        why = error.strerror or "the disk may be full"
        return _error(
            507,
            f"This could not be saved: {why}. What was saved before is not lost. "
            f"{'Free some space' if room else 'Mend that'}, and try again.",
        )
    except ValueError as error:
        _log.warning(_FAILED, interview.who, message.get("do"), error, exc_info=True)
        return _error(
            400,
            "This could not be done; the program says why where it runs. Press Try again, or "
            "reload the page.",
        )
    except Exception as error:
        _log.exception(_FAILED, interview.who, message.get("do"), error)
        saved = isinstance(error, SavedWithoutScreen)
        text = _NEXT_FAILED if saved else _WENT_WRONG
        return _error(500, f"{text} {_IF_AGAIN}", saved=saved)


def _handled(interview: Takes, message: dict[str, Any]) -> dict[str, Any]:
    """Return the interview's reply. All that it raises becomes an Exception, to be reported."""
    try:
        return interview.handle(message)
    except Exception:
        raise
    except BaseException as error:  # such as a panic of compiled Rust code
        raise RuntimeError(f"{type(error).__name__}: {error}") from error


def _file(name: str) -> Response:
    """Return a file of the page, which must be one of those in its folder."""
    for path in PAGE.iterdir():
        if path.name == name and path.suffix in _TYPES:
            return Response(path.read_bytes(), media_type=_TYPES[path.suffix])
    raise HTTPException(404, "There is no such page.")


async def _refused(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _error(error.status_code, error.detail, error.headers)


def _error(status: int, text: str, headers: Any = None, saved: bool = False) -> Response:
    """Return an error in words; ``saved``: what was sent is, or may be, saved nevertheless."""
    told = {"error": text, **({"saved": True} if saved else {})}
    return Response(json.dumps(told), status, headers, "application/json")


def _same(one: str, other: str) -> bool:
    """Return whether two secrets are the same, in a time that does not depend on them."""
    return hmac.compare_digest(one.encode(), other.encode())
