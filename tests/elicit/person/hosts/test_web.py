"""The page is the person's alone, and what goes wrong is said without a word of the answers."""

import errno
import re
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from elicit import AnswerLog, BadLog, Interview, PolytopeComparator, Session, Subject, choose
from elicit.person.hosts import web_app
from elicit.person.hosts.web import WebServer
from tests.interpreter import run
from tests.web_person import Visitor, answer_all

LABELS = ("died", "worse", "ill", "well")
SUBJECT = Subject(LABELS, least=0)
VALUES = {"died": 0.0, "worse": 0.2, "ill": 0.3, "well": 1.0}
VECTORS = np.random.default_rng(0).multinomial(10, [0.25] * 4, 8)


def make(known: Any = ()) -> Any:
    return choose(VECTORS, PolytopeComparator(4), order=True, known=known)


@pytest.fixture(scope="module", autouse=True)
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Three small files in place of the page's, beside one that is not for visitors."""
    folder = tmp_path_factory.mktemp("web") / "page"
    folder.mkdir()
    for name in ("page.html", "page.js", "style.css", "notes.txt"):
        (folder / name).write_text(f"this is {name}")
    (folder.parent / "secret.js").write_text("secret")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(web_app, "PAGE", folder)
        yield


@pytest.fixture(scope="module")
def server(page: None) -> Iterator[WebServer]:
    """A page on which nobody answers."""
    with (
        Session(make, AnswerLog(k=4)) as session,
        WebServer(session, SUBJECT) as server,
    ):
        yield server


@pytest.fixture
def visitor(server: WebServer) -> Visitor:
    """Return a visitor whom the server has let in."""
    return Visitor(server.new_address())


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """A new session."""
    with AnswerLog(tmp_path / "answers.jsonl", 4) as log, Session(make, log) as session:
        yield session


@pytest.fixture
def host(session: Session) -> Iterator[WebServer]:
    """Its page."""
    with WebServer(session, SUBJECT) as server:
        yield server


@pytest.fixture
def person(host: WebServer) -> Visitor:
    """Return the person who answers at this host."""
    return Visitor(host.new_address())


def raw(server: WebServer, request: str | bytes) -> bytes:
    """Return the bytes that the server sends until it closes the connection.

    It may close it before the request ends.
    """
    found = b""
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        with suppress(ConnectionResetError, BrokenPipeError):
            connection.sendall(request.encode() if isinstance(request, str) else request)
        with suppress(ConnectionResetError):
            while part := connection.recv(65536):
                found += part
    return found


def status_of(reply: bytes) -> int:
    return int(reply.split(b" ", 2)[1])


def head(visitor: Visitor, start: str = "GET / HTTP/1.1", **headers: str) -> str:
    """The head of a request of his, with these headers changed; an empty one is left out."""
    usual = {"host": visitor.at.netloc, "cookie": visitor.cookie, "connection": "close", **headers}
    lines = [f"{name.replace('_', '-')}: {text}" for name, text in usual.items() if text]
    return "\r\n".join([start, *lines, "", ""])


def posted(visitor: Visitor, **headers: str) -> str:
    """The head of a message of his."""
    usual = {"origin": f"http://{visitor.at.netloc}", "content_type": "application/json"}
    return head(visitor, "POST /api HTTP/1.1", **{**usual, **headers})


def test_the_printed_address_lets_in_one_browser_once(server: WebServer) -> None:
    address = server.new_address()
    assert re.fullmatch(rf"http://127\.0\.0\.1:{server.port}/\?token=[\w-]{{43}}", address)
    first = Visitor(address)
    assert first.status == 303
    assert first.fetch("GET", "/", cookie=first.cookie)[2] == b"this is page.html"
    second = Visitor(address)
    assert (second.status, second.cookie) == (403, "")
    assert b"press Enter in its terminal" in second.fetch("GET", "/")[2]
    third = Visitor(server.new_address())
    assert third.screen() == first.screen()


def test_only_the_newest_address_is_valid_and_only_a_visit_uses_it_up(server: WebServer) -> None:
    old, new = server.new_address(), server.new_address()
    assert Visitor(old).status == 403
    visitor = Visitor(f"{new}x")
    path = new.removeprefix(f"http://{visitor.at.netloc}")
    assert visitor.fetch("HEAD", path)[0] == 403
    assert visitor.fetch("POST", path)[0] == 403
    assert visitor.fetch("GET", path.replace("/?", "/page/page.js?"))[0] == 403
    assert visitor.fetch("GET", path.replace("/?", "/%3Ftoken=x?"))[0] == 403
    assert visitor.status == 403
    assert Visitor(new).status == 303


def test_the_cookie_is_strict_and_named_by_the_port(server: WebServer) -> None:
    visitor = Visitor(f"http://127.0.0.1:{server.port}/?token=x")
    _, headers, body = visitor.fetch("GET", server.new_address().split(str(server.port))[1])
    given = headers["set-cookie"]
    assert re.fullmatch(
        rf"elicit-{server.port}=[\w-]{{43}}; HttpOnly; Max-Age=2592000; Path=/; SameSite=strict",
        given,
    )
    assert (headers["location"], body) == ("/", b"")


def test_who_has_the_cookie_may_open_the_address_again(server: WebServer) -> None:
    address = server.new_address()
    visitor = Visitor(address)
    path = f"/?{visitor.at.query}"
    assert visitor.fetch("GET", path, cookie=visitor.cookie)[0] == 303
    fresh = f"/?{server.new_address().split('?')[1]}"
    assert visitor.fetch("GET", fresh, cookie=visitor.cookie)[0] == 303
    assert visitor.fetch("GET", fresh)[0] == 403  # used up all the same


def test_there_is_nothing_without_the_cookie(visitor: Visitor) -> None:
    name, value = visitor.cookie.split("=")
    origin = f"http://{visitor.at.netloc}"
    for path in (
        "/",
        "/page/page.js",
        "/page/style.css",
        "/api",
        "/nothing",
        "/docs",
        "/openapi.json",
    ):
        for method in ("GET", "HEAD", "POST", "PUT", "OPTIONS", "DELETE"):
            status, headers, body = visitor.fetch(method, path, b"{}", origin=origin)
            assert (status, b"this is" in body, "set-cookie" in headers) == (403, False, False)
        for cookie in (
            f"{name}=",
            f"{name}={value[:-1]}",
            f"{name}1={value}",
            f"elicit-1={value}",
            value,
            "=;=;;",
        ):
            status, headers, body = visitor.fetch("GET", path, cookie=cookie)
            assert (status, b"this is" in body, "set-cookie" in headers) == (403, False, False)


def test_who_is_not_let_in_sees_one_sentence_on_what_to_do_and_the_looks_of_the_page(
    server: WebServer, visitor: Visitor
) -> None:
    status, headers, body = visitor.fetch("GET", "/")
    page = body.decode()
    assert (status, headers["content-type"]) == (403, "text/html; charset=utf-8")
    assert (
        "<p>If somebody sent you this address, ask them for a new one. If the program runs" in page
    )
    assert '<link rel="stylesheet" href="closed.css">' in page
    assert 'content="light dark"' in page
    for path in ("/closed.css", "/page/closed.css"):  # the link is relative to any closed page
        status, headers, body = visitor.fetch("GET", path, sec_fetch_site="same-origin")
        assert (status, headers["content-type"]) == (200, "text/css; charset=utf-8")
        assert b".elicit .sheet" in body
        assert b"prefers-color-scheme: dark" in body
        assert b"this is" not in body  # nothing of what is served to those who are let in
    for path, method in (
        ("/closed.css", "POST"),
        ("/closed.css/x", "GET"),
        ("/xclosed.css", "GET"),
    ):
        assert visitor.fetch(method, path, origin=server.origin)[0] == 403


def test_another_programs_cookie_of_the_same_name_does_not_shut_out(visitor: Visitor) -> None:
    name = visitor.cookie.split("=")[0]
    for cookie in (f"{name}=x; {visitor.cookie}", f'{visitor.cookie}; {name}="x"; a=b'):
        assert visitor.fetch("GET", "/", cookie=cookie)[0] == 200


def test_what_there_is_with_the_cookie(visitor: Visitor) -> None:
    def got(path: str) -> tuple[int, str, bytes]:
        status, headers, body = visitor.fetch("GET", path, cookie=visitor.cookie)
        return status, headers["content-type"], body

    assert (
        got("/")
        == got("/page/page.html")
        == (200, "text/html; charset=utf-8", b"this is page.html")
    )
    assert got("/page/page.js") == (200, "text/javascript; charset=utf-8", b"this is page.js")
    assert got("/page/style.css") == (200, "text/css; charset=utf-8", b"this is style.css")
    inside = "../secret.js %2e%2e/secret.js ..%2fsecret.js %2e%2e%2fsecret.js ..%5csecret.js"
    files = f"notes.txt nothing.js /page.js page.js%00 ./page.js {inside}".split()
    others = (
        "/favicon.ico",
        "/page/",
        "/page",
        "/docs",
        "/openapi.json",
        "/api/",
        "/page/page.js/",
        "/..//page/../secret.js",
    )
    for path in [*(f"/page/{file}" for file in files), *others]:
        status, _, body = got(path)
        assert (status, b"secret" in body) == (404, False), path
    for method, path in (
        ("PUT", "/"),
        ("POST", "/"),
        ("GET", "/api"),
        ("TRACE", "/"),
        ("DELETE", "/page/page.js"),
    ):
        origin = f"http://{visitor.at.netloc}"
        assert visitor.fetch(method, path, cookie=visitor.cookie, origin=origin)[0] == 405
    status, headers, body = visitor.fetch("HEAD", "/", cookie=visitor.cookie)
    assert (status, headers["content-length"], body) == (200, "17", b"")


def test_another_name_for_this_machine_is_refused(server: WebServer, visitor: Visitor) -> None:
    port = server.port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"LOCALHOST:{port}", f"[::1]:{port}"):
        assert status_of(raw(server, head(visitor, host=host))) == 200
    evil = (
        "evil.example",
        f"evil.example:{port}",
        "127.0.0.1",
        f"127.0.0.1:{port + 1}",
        f"127.0.0.1.evil:{port}",
    )
    for host in (*evil, f"127.0.0.1:{port}, evil.example"):
        reply = raw(server, head(visitor, host=host))
        assert (status_of(reply), b"this is" in reply) == (421, False), host
    assert status_of(raw(server, head(visitor, "GET / HTTP/1.0", host=""))) == 421
    twice = head(visitor).replace("\r\n\r\n", "\r\nhost: evil.example\r\n\r\n")
    assert status_of(raw(server, twice)) == 400
    # the name in the request line counts for nothing
    assert (
        status_of(
            raw(
                server, head(visitor, f"GET http://127.0.0.1:{port}/ HTTP/1.1", host="evil.example")
            )
        )
        == 421
    )
    assert status_of(raw(server, head(visitor, "GET http://evil.example/ HTTP/1.1"))) == 404


def test_what_another_page_sends_is_refused(server: WebServer, visitor: Visitor) -> None:
    state = {"do": "state"}
    ours = f"http://{visitor.at.netloc}"
    for origin in (
        "http://evil.example",
        "null",
        "",
        ours.replace("http", "https"),
        ours + "1",
        "http://127.0.0.1",
    ):
        assert visitor.post(state, origin=origin)[0] == 403, origin
    for site in ("cross-site", "same-site"):
        assert visitor.post(state, sec_fetch_site=site)[0] == 403
    assert visitor.post(state, sec_fetch_site="same-origin")[0] == 200
    nowhere = posted(visitor, origin="", content_length="14") + '{"do":"state"}'
    assert status_of(raw(server, nowhere)) == 403
    from_here = (
        posted(visitor, origin="", content_length="14", sec_fetch_site="same-origin")
        + '{"do":"state"}'
    )
    assert status_of(raw(server, from_here)) == 200
    for site in ("cross-site", "same-site"):
        for mode in ("no-cors", "cors", "same-origin", "websocket"):
            for path in ("/", "/page/page.js"):
                sent = {"cookie": visitor.cookie, "sec_fetch_site": site, "sec_fetch_mode": mode}
                assert visitor.fetch("GET", path, **sent)[0] == 403, (path, sent)
        sent = {"cookie": visitor.cookie, "sec_fetch_site": site, "sec_fetch_mode": "navigate"}
        assert visitor.fetch("GET", "/", **sent)[0] == 200  # a link was followed
        assert visitor.fetch("GET", "/page/page.js", **sent)[0] == 403
    assert (
        visitor.fetch("GET", "/page/page.js", cookie=visitor.cookie, origin="http://evil.example")[
            0
        ]
        == 403
    )


def test_a_link_on_another_page_lets_in_too(server: WebServer) -> None:
    """A browser sends no strict cookie along where such a link is redirected."""
    visitor = Visitor(f"http://127.0.0.1:{server.port}/?token=x")
    query = server.new_address().split("?")[1]
    status, headers, _ = visitor.fetch(
        "GET", f"/?{query}", sec_fetch_site="cross-site", sec_fetch_mode="navigate"
    )
    assert (status, headers["refresh"]) == (200, "0; url=/")
    assert visitor.fetch("GET", "/", cookie=headers["set-cookie"].split(";")[0])[0] == 200


def test_every_response_has_the_headers(
    server: WebServer, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Interview, "handle", MagicMock(side_effect=RuntimeError("no")))
    cookie = visitor.cookie
    replies = {
        200: head(visitor),
        303: head(visitor, f"GET /?{server.new_address().split('?')[1]} HTTP/1.1"),
        400: posted(visitor, content_length="1") + "x",
        403: head(visitor, cookie=""),
        404: head(visitor, "GET /nothing HTTP/1.1"),
        405: head(visitor, "PUT / HTTP/1.1", origin=f"http://{visitor.at.netloc}"),
        413: posted(visitor, content_length="99999"),
        415: posted(visitor, content_type="text/plain", content_length="1") + "x",
        421: head(visitor, host="evil.example", cookie=cookie),
        500: posted(visitor, content_length="14") + '{"do":"state"}',
    }
    for status, request in replies.items():
        reply = raw(server, request).decode().lower()
        assert status_of(reply.encode()) == status
        lines = reply.split("\r\n\r\n")[0].split("\r\n")
        policy = next(line for line in lines if line.startswith("content-security-policy: "))
        assert policy == (
            "content-security-policy: default-src 'none'; script-src 'self'; style-src 'self'; "
            "connect-src 'self'; "
            "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        wanted = {
            "x-content-type-options: nosniff",
            "x-frame-options: deny",
            "referrer-policy: no-referrer",
        }
        wanted |= {"cache-control: no-store", "cross-origin-resource-policy: same-origin"}
        assert wanted <= {*lines}
        assert not [line for line in lines if line.startswith(("server:", "access-control-"))]
        assert reply.count("content-security-policy") == 1


def test_a_message_is_json_and_short(server: WebServer, visitor: Visitor) -> None:
    for kind in ("text/plain", "application/x-www-form-urlencoded", "application/jsonx", ""):
        assert visitor.post({"do": "state"}, content_type=kind)[0] == 415
    assert visitor.post({"do": "state"}, content_type="Application/JSON; charset=utf-8")[0] == 200
    bad = (
        "",
        "{",
        "[]",
        "null",
        '"state"',
        "[" * 9000,
        b"\xff",
        "{}",
        '{"do": 1}',
        '{"do": "state", "id": "x"}',
    )
    worse = (
        '{"do": "answer", "id": ["x"], "choice": "a"}',
        '{"do": "__init__"}',
        f'{{"do": {"9" * 5000}}}',
    )
    for message in (*bad, *worse, '{"do": "answer", "id": "x"}'):
        assert visitor.post(message)[0] == 400, message
    for id in ("x" * 9000, "\ud800", "\x00", "../../x"):
        assert "no longer open" in visitor.screen("answer", id=id, choice="a")["note"]
        assert visitor.post({"do": "outlook", "id": id})[0] == 200
    assert visitor.screen()["answered"] == 0


def test_a_body_is_bounded_whether_its_length_is_said_or_not(
    server: WebServer, visitor: Visitor
) -> None:
    for length in ("16385", "99999999999999999999"):
        assert status_of(raw(server, posted(visitor, content_length=length))) == 413
    for length in ("-1", "x", "+1", "1, 2", "1e3", "1" * 400):
        assert status_of(raw(server, posted(visitor, content_length=length))) == 400
    chunked = posted(visitor, transfer_encoding="chunked")
    assert status_of(raw(server, chunked + '7\r\n{"do":"\r\n7\r\nstate"}\r\n0\r\n\r\n')) == 200
    assert status_of(raw(server, chunked + "4001\r\n" + " " * 0x4001)) == 413
    assert status_of(raw(server, chunked + ("100\r\n" + " " * 256 + "\r\n") * 65)) == 413
    for size in ("-1", "x", "0x7", "fffffffffffffffffffffffff"):
        assert status_of(raw(server, f"{chunked}{size}\r\nxx\r\n")) in (400, 413), size
    both = posted(visitor, transfer_encoding="chunked", content_length="5") + "0\r\n\r\n"
    assert status_of(raw(server, both)) in (400, 413)
    assert raw(server, head(visitor, x="x" * 10_000_000))[:12] in (b"HTTP/1.1 400", b"")
    assert visitor.screen()["answered"] == 0


def test_who_is_slow_does_not_keep_a_connection(
    server: WebServer, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_app, "PATIENCE", 0.2)
    assert status_of(raw(server, posted(visitor, content_length="14") + '{"do"')) == 408
    assert raw(server, "GET / HTTP/1.1\r\nhost: x") == b""
    assert raw(server, "") == b""


def test_a_websocket_is_not_opened(server: WebServer, visitor: Visitor) -> None:
    wanted = {"upgrade": "websocket", "connection": "upgrade, close", "sec_websocket_version": "13"}
    assert (
        status_of(raw(server, head(visitor, "GET /api HTTP/1.1", **wanted, sec_websocket_key="x")))
        == 405
    )


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (ValueError("well 1 ill 2"), 400, "This could not be done"),
        (RuntimeError("well 1 ill 2"), 500, "Something went wrong in the program"),
        (BadLog("well 1 ill 2"), 507, "Another program moved or changed the file of the answers"),
        (
            OSError("well 1 ill 2"),
            507,
            "This could not be saved: the disk may be full. What was saved before is not lost. Free",  # noqa: E501
        ),
        (
            OSError(errno.ENOSPC, "No space left on device", "well 1 ill 2"),
            507,
            "could not be saved: No space left on device. What was saved before is not lost. Free "
            "some space, and",
        ),
        (
            OSError(errno.EROFS, "Read-only file system", "well 1 ill 2"),
            507,
            "could not be saved: Read-only file system. What was saved before is not lost. Mend "
            "that, and try again.",
        ),
    ],
)
def test_an_error_is_said_without_the_answers(
    visitor: Visitor,
    error: Exception,
    status: int,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(Interview, "handle", MagicMock(side_effect=error))
        found, reply = visitor.post({"do": "state"})
    assert found == status
    assert reply.keys() == {"error"}
    assert said in reply["error"]
    assert not re.search("well|ill|Traceback|[.]py", reply["error"])
    assert "well 1 ill 2" in caplog.text  # where the program runs
    assert visitor.screen()["stage"] == "welcome"


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
def test_after_a_failed_write_the_question_stays_and_can_be_answered(
    session: Session, person: Visitor, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    id = answer_all(person, VALUES, most=2)["question"]["id"]
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", MagicMock(side_effect=OSError(code, "it failed")))
        status, reply = person.post({"do": "answer", "id": id, "choice": "a"})
        assert (status, "it failed" in reply["error"]) == (507, True)
        assert person.post({"do": "undo", "id": session.log[0].answer.query.id})[0] == 507
    screen = person.screen()
    assert (screen["question"]["id"], screen["answered"], len(session.log)) == (id, 1, 1)
    assert person.screen("answer", id=id, choice="a")["answered"] == 2
    assert session.log.path
    assert len(AnswerLog.read(session.log.path)) == 2


def test_while_one_message_is_computed_others_are_answered(
    visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(self: Interview, id: str) -> dict[str, Any]:
        begun.set()
        assert go_on.wait(60)
        return {"id": id}

    handled = Interview.handle
    monkeypatch.setattr(
        Interview,
        "handle",
        lambda self, message: (
            slow(self, "x") if message["do"] == "outlook" else handled(self, message)
        ),
    )
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(visitor.post, {"do": "outlook", "id": "x"})
        assert begun.wait(60)
        assert visitor.screen()["stage"] == "welcome"
        assert visitor.fetch("GET", "/page/page.js", cookie=visitor.cookie)[0] == 200
        assert not waiting.done()
        go_on.set()
        assert waiting.result() == (200, {"id": "x"})


def test_an_answer_sent_many_times_at_once_counts_once(session: Session, person: Visitor) -> None:
    id = answer_all(person, VALUES, most=1)["question"]["id"]
    with ThreadPoolExecutor(20) as pool:
        replies = [*pool.map(person.post, [{"do": "answer", "id": id, "choice": "a"}] * 20)]
    assert {status for status, _ in replies} == {200}
    assert {(reply["answered"], reply["note"]) for _, reply in replies} == {(1, None)}
    assert [entry.answer.query.id for entry in session.log] == [id]


def test_two_browsers_on_one_question(session: Session, host: WebServer) -> None:
    one, other = Visitor(host.new_address()), Visitor(host.new_address())
    question = answer_all(one, VALUES, most=1)["question"]
    assert other.screen()["question"] == question
    after = one.screen("answer", id=question["id"], choice="a")
    told = other.screen("answer", id=question["id"], choice="b")
    assert "already answered, perhaps in another window" in told["note"]
    assert told["question"] == after["question"]
    assert other.screen("answer", id=question["id"], choice="a")["note"] is None
    assert len(session.log) == 1
    taken = other.screen("undo", id=question["id"])
    again = taken["question"]["check"]
    assert again.startswith("This is the same question again, because you took back your answer")
    assert (taken["answered"], taken["question"]) == (0, {**question, "check": again})
    assert one.screen("answer", id=after["question"]["id"], choice="a")["note"].startswith(
        "That question is no longer open"
    )
    assert [entry.retracted for entry in session.log] == [True]


def test_answers_out_of_order_change_nothing(session: Session, person: Visitor) -> None:
    ids: list[str] = []
    screen = answer_all(person, VALUES, most=4, acknowledged=ids.append)
    before = [entry.answer for entry in session.log]
    for id in ("practice/0", "never asked", *ids[:2]):
        reply = person.screen("answer", id=id, choice="cannot tell")
        assert reply["note"]
        assert reply["question"] == screen["question"]
    assert "no longer the last answer" in person.screen("undo", id=ids[0])["note"]
    assert [entry.answer for entry in session.log] == before


def test_a_clock_that_goes_backwards_matters_to_no_answer(tmp_path: Path, session: Session) -> None:
    seconds = iter(range(2_000_000_000, 0, -10_000_000))
    with (
        Session(make, tmp_path / "backwards.jsonl", clock=lambda: next(seconds)) as backwards,
        WebServer(backwards, SUBJECT) as server,
    ):
        answer_all(Visitor(server.new_address()), VALUES)
        found = [entry.answer for entry in backwards.log]
        times = [entry.metadata["time"] for entry in backwards.log]
    assert times == sorted(times, reverse=True)
    with Session(make, tmp_path / "backwards.jsonl") as again:
        assert again.question() is None
    with WebServer(session, SUBJECT) as server:
        answer_all(Visitor(server.new_address()), VALUES)
    assert [(a.query.id, a.verdict) for a in found] == [
        (entry.answer.query.id, entry.answer.verdict) for entry in session.log
    ]


def test_others_are_let_in_only_where_that_is_said(session: Session) -> None:
    for host in ("192.0.2.1", "0.0.0.0", "::"):
        with pytest.raises(
            ValueError,
            match=f"{host} can be reached by other machines, and what is sent there is not",
        ):
            WebServer(session, SUBJECT, host)
    with pytest.raises(OSError, match=r"cannot listen on 192\.0\.2\.1, port 0"):
        WebServer(session, SUBJECT, "192.0.2.1", let_others_in=True)
    with pytest.raises(ValueError, match=r"0\.0\.0\.0 is no address to open"):
        WebServer(session, SUBJECT, "0.0.0.0", let_others_in=True)
    with pytest.raises(ValueError, match="'no name' is no address of this machine"):
        WebServer(session, SUBJECT, "no name")


def test_the_other_loopback_address(session: Session) -> None:
    with (
        suppress(OSError),
        WebServer(session, SUBJECT, "::1") as server,
    ):  # where there is one
        visitor = Visitor(server.new_address())
        assert visitor.at.netloc == f"[::1]:{server.port}"
        assert visitor.screen()["stage"] == "welcome"


def test_only_this_machine_is_listened_to(server: WebServer) -> None:
    listening = [socket.gethostbyname("localhost"), "127.0.0.1"]
    others = [
        where[4][0] for where in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
    ]
    for address in {"127.0.0.2", *map(str, others)} - {*listening}:
        with pytest.raises(OSError, match=r"refused|unreachable|timed out"):
            socket.create_connection((address, server.port), timeout=5)


def test_a_port_in_use_is_said(session: Session, server: WebServer) -> None:
    with pytest.raises(
        OSError, match=f"cannot listen on 127.0.0.1, port {server.port}: Address already in use"
    ):
        WebServer(session, SUBJECT, port=server.port)


def test_after_close_nothing_listens_and_the_session_goes_on(session: Session) -> None:
    with WebServer(session, SUBJECT) as server:
        answer_all(Visitor(server.new_address()), VALUES, most=2)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", server.port))
    with WebServer(session, SUBJECT, port=server.port) as again:
        visitor = Visitor(again.new_address())
        assert visitor.screen()["answered"] == 1
        assert visitor.cookie.split("=")[0] == f"elicit-{server.port}"


@pytest.mark.slow
def test_a_missing_package_is_named() -> None:
    code = (
        "import sys\nfrom elicit.person.hosts.web import WebServer\nfor package in ('starlette', "
        "'uvicorn'):\n"
        "    sys.modules[package] = None\n"
        "    try:\n        WebServer(None, None)\n    except ModuleNotFoundError as error:\n       "
        " print(error)\n"
        "    del sys.modules[package]\n"
    )
    assert run(code) == [
        f"{package} is not installed: pip install 'elicit-qlearn[web]'"
        for package in ("starlette", "uvicorn")
    ]


def test_secrets_are_compared_in_constant_time(
    server: WebServer, visitor: Visitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    server.new_address()
    name = visitor.cookie.split("=")[0]
    for same, let_in in ((False, [403, 403]), (True, [303, 200])):
        monkeypatch.setattr("hmac.compare_digest", lambda *_, same=same: same)
        token = visitor.fetch("GET", "/?token=x")[0]
        assert [token, visitor.fetch("GET", "/", cookie=f"{name}=x")[0]] == let_in


def test_before_the_session_is_there_the_page_is_open_and_says_so(session: Session) -> None:
    with WebServer(None, SUBJECT) as server:
        visitor = Visitor(server.new_address())
        assert visitor.fetch("GET", "/", cookie=visitor.cookie)[0] == 200
        status, reply = visitor.post({"do": "state"})
        assert (status, reply) == (200, {"getting_ready": reply["getting_ready"]})
        assert reply["getting_ready"] >= 0
        server.begin(session)
        assert visitor.screen()["stage"] in ("welcome", "question")
