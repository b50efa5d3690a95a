"""The widget: an interview in a notebook, drawn by the same front end as the page.

The front end sends custom messages ``{"id": ..., "message": {...}}``. The reply to each is ``{"id":
..., "reply": {...}}`` or ``{"id": ..., "error": "a sentence"}``, with the same id. Messages and
replies are those of ``interview``. The kernel takes them one at a time, between cells: while a cell
runs, a question waits.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from anywidget import AnyWidget

from elicit._support.file_errors import in_words
from elicit.person.interview import Interview, Subject
from elicit.person.session import Session
from elicit.person.showing import printable

_PAGE = files("elicit.person.hosts") / "page"
# Several windows, in several browsers perhaps, hear each other's replies: each asks with ids of its
# own. A letter typed in the widget is no command to the notebook around it, where A and B insert
# cells and X cuts them; Ctrl+S still is.
_GLUE = """
const GONE =
  "the kernel was restarted or does not run. Run the cells of this notebook again, and go on in the new widget: all " +
  "answers before this one are there, if the session has a file for its log.";
const LATER = "To go on, run the cells of this notebook again. It goes on where you are now.";

export default {
  render({ model, el }) {
    const view = Math.random().toString(36).slice(2);
    const waiting = new Map();
    let sent = 0;
    const receive = (said) => {
      const one = waiting.get(said.id);
      waiting.delete(said.id);
      if (one && "error" in said) one.reject(new Error(said.error));
      else if (one) one.resolve(said.reply);
    };
    const lost = () => {
      for (const one of waiting.values()) one.reject(new Error(GONE));
      waiting.clear();
    };
    const send = (message) =>
      new Promise((resolve, reject) => {
        const id = `${view}.${(sent += 1)}`;
        waiting.set(id, { resolve, reject });
        try {
          model.send({ id, message });
        } catch {
          lost();
        }
      });
    model.on("msg:custom", receive);
    model.on("comm_live_update", lost);
    const hold = (event) => event.ctrlKey || event.metaKey || event.altKey || event.stopPropagation();
    el.addEventListener("keydown", hold);
    const root = document.createElement("div");
    el.append(root);
    const unmount = mount(root, send, { keys: root, later: LATER });
    return () => {
      model.off("msg:custom", receive);
      model.off("comm_live_update", lost);
      el.removeEventListener("keydown", hold);
      unmount();
    };
  },
};
"""  # noqa: E501


class InterviewWidget(AnyWidget):  # type: ignore[misc, unused-ignore]  # ipywidgets are untyped
    """A session with a person, in a notebook: put it last in a cell.

    Displaying it again opens another window of the same interview. Each answer is in the session at
    once, so any later cell may call ``session.result()``. Needs the extra ``widget``.

    Parameters
    ----------
    session : Session
        Asks the questions and keeps the answers.
    subject : Subject
        The words of the interview.
    """

    _esm = (_PAGE / "interview.js").read_text(encoding="utf-8") + _GLUE
    _css = (_PAGE / "style.css").read_text(encoding="utf-8")

    def __init__(self, session: Session, subject: Subject) -> None:
        # now, or a thread would compute it while the next cells may use the session
        session.question()
        self._session, self._title = session, printable(subject.words.title)
        self._interview = Interview(session, subject)
        super().__init__()
        self.on_msg(self._take)

    def close(self) -> None:
        """Remove the widget from all windows. The session stays open."""
        self._interview.close()
        super().close()

    def __repr__(self) -> str:
        """Return the text in place of the widget: "a session of ICU-Sepsis: 3 answered"."""
        answered = sum(not entry.repeat for entry in self._session.log.standing)
        return f"a session{f' of {self._title}' if self._title else ''}: {answered} answered"

    def _take(self, _: Any, content: Any, buffers: Any) -> None:
        """Reply to a custom message."""
        try:
            said: dict[str, Any] = {"reply": self._interview.handle(content["message"])}
        except (
            ValueError,
            OSError,
        ) as error:  # a session's or log's error: the message may be sent again
            said = {"error": in_words(error)}
        except Exception as error:
            self.send({"id": content["id"], "error": f"{type(error).__name__}: {error}"})
            raise
        self.send({"id": content["id"], **said})
