"""The widget speaks the messages of ``elicit.person.hosts.widget``, and says what is missing where
it cannot.
"""

from typing import Any

import comm
import numpy as np
import pytest
from comm.base_comm import BaseComm

import elicit
from tests.interpreter import run

LABELS = ("died", "stable", "well")
VECTORS = np.array([[2, 1, 1], [1, 3, 0], [0, 4, 0]]) / 4


class Recorded(BaseComm):
    """A connection to no browser: what the kernel sends is kept, and messages come from ``say``."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.sent: list[Any] = []
        super().__init__(*args, **kwargs)

    def publish_msg(self, msg_type: str, data: Any = None, *args: Any, **kwargs: Any) -> None:
        """Keep what is sent."""
        self.sent.append(data)

    def say(self, content: Any) -> Any:
        """Return the reply to a custom message."""
        self.sent.clear()
        self.handle_msg(
            {"content": {"data": {"method": "custom", "content": content}}, "buffers": []}
        )
        said = [data["content"] for data in self.sent if data.get("method") == "custom"]
        assert len(said) == 1
        return said[0]


def make(known: Any) -> Any:
    return elicit.choose(VECTORS, elicit.PolytopeComparator(3), known=known)


@pytest.fixture
def session():
    with elicit.Session(make, elicit.AnswerLog(k=3)) as one:
        yield one


@pytest.fixture
def widget(session, monkeypatch):
    monkeypatch.setattr(comm, "create_comm", Recorded)
    one = elicit.InterviewWidget(
        session, elicit.Subject(LABELS, elicit.Words(title="Three courses"), least=0)
    )
    yield one
    one.close()


def test_a_session_goes_to_its_end_in_messages_and_its_result_can_be_read(widget, session):
    n = 0

    def say(**message: str) -> Any:
        nonlocal n
        n += 1
        said = widget.comm.say({"id": f"x.{n}", "message": message})
        assert said.keys() == {"id", "reply"}
        assert said["id"] == f"x.{n}"
        return said["reply"]

    assert say(do="state")["stage"] == "welcome"
    screen = say(do="practised", choice="a")
    assert screen["stage"] == "question"
    while screen["question"]:
        screen = say(do="answer", id=screen["question"]["id"], choice="a")
    assert screen["stage"] == "end"
    assert screen["answered"] == len(session.log) > 0
    assert session.result().best in range(3)
    assert repr(widget) == f"a session of Three courses: {len(session.log)} answered"


def test_what_goes_wrong_is_told_in_a_sentence_and_the_next_message_is_taken(
    widget, session, monkeypatch
):
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    def broken(*_: Any) -> None:
        raise KeyError("broken")

    assert "say" in widget.comm.say({"id": 1, "message": {"do": "nothing"}})["error"]
    with monkeypatch.context() as patch:
        patch.setattr(session, "question", full)
        widget.comm.say({"id": 2, "message": {"do": "practised", "choice": "a"}})
        assert widget.comm.say({"id": 3, "message": {"do": "state"}}) == {
            "id": 3,
            "error": "No space left on device",
        }
        patch.setattr(session, "question", broken)
        assert widget.comm.say({"id": 4, "message": {"do": "state"}}) == {
            "id": 4,
            "error": "KeyError: 'broken'",
        }
    assert widget.comm.say({"id": 5, "message": {"do": "state"}})["reply"]["stage"] == "question"


def test_a_notebook_without_the_widget_shows_how_many_are_answered(widget, session):
    query = session.question()
    session.answer(query.id, elicit.Verdict.BETTER)
    data, *_ = widget._repr_mimebundle_()
    assert data["text/plain"] == "a session of Three courses: 1 answered"
    with elicit.Session(make, elicit.AnswerLog(k=3)) as other:
        untitled = elicit.InterviewWidget(other, elicit.Subject(LABELS, least=0))
        assert repr(untitled) == "a session: 0 answered"
        untitled.close()


def test_the_front_end_is_the_page_s_and_stands_alone(widget):
    state = widget.get_state()
    assert "export function mount" in state["_esm"]
    assert state["_esm"].count("export default") == 1
    assert "import " not in state["_esm"].replace("import.meta", "")
    assert ".elicit" in state["_css"]


@pytest.mark.slow
def test_without_the_extra_it_says_what_to_install_and_everything_else_works():
    code = (
        "import sys; sys.modules['anywidget'] = None\n"
        "from elicit import *\n"
        "import elicit; print('InterviewWidget' in dir(elicit))\n"
        "try:\n    elicit.InterviewWidget\nexcept ModuleNotFoundError as error:\n    print(error)\n"
    )
    assert run(code) == ["True", "anywidget is not installed: pip install 'elicit-qlearn[widget]'"]
