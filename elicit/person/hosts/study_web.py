"""A study as pages: ``serve_study`` until Ctrl+C, or ``StudyServer`` beside other work.

Needs the extra: pip install 'elicit-qlearn[web]'.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress

from elicit.person.hosts.getting_ready import progress_said
from elicit.person.hosts.web import PageServer, lines_entered
from elicit.person.study.study import Study


class StudyServer(PageServer):
    """The pages of a study, served by a thread of its own from now until ``close``.

    Each person has a link of their own, which leads to their page alone. The person who runs the
    study has a page that says who has answered how much, makes new links, and ends the study.

    ``study`` may also be the names of its people, if the study is not made yet. The pages then say
    that the program gets ready, until ``begin``. Other arguments and errors are those of
    ``PageServer``. Closing the server does not close the study.
    """

    def __init__(
        self,
        study: Study | Sequence[str],
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        let_others_in: bool = False,
    ) -> None:
        super().__init__(host, port, let_others_in=let_others_in)
        from elicit.person.hosts.study_app import Reception

        people = study.people if isinstance(study, Study) else study
        self._reception = Reception(people, self.port, self.hosts, self.origin)
        if isinstance(study, Study):
            self._reception.begin(study)
        self.serve_app(self._reception.application())

    def begin(self, study: Study) -> None:
        """Serve the pages of this study, if names were given in its place before."""
        self._reception.begin(study)

    def links(self) -> dict[str, str]:
        """Return each person's link that was not opened yet. It lets in one browser, once."""
        return self._reception.links()

    def new_address(self) -> str:
        """Return an address that lets in the person who runs the study, once.

        The address before it no longer works.
        """
        return self._reception.new_runner_address()


def serve_study(
    study: Study | Callable[[], Study],
    host: str = "127.0.0.1",
    port: int = 0,
    *,
    people: Sequence[str] = (),
    let_others_in: bool = False,
) -> None:
    """Serve the pages of a study until Ctrl+C.

    It prints each person's name and link on a line of standard output, and the address of the page
    of the person who runs the study. For each line of standard input it prints a new address of
    that page.

    ``study`` may also be a function that makes it, which is called once the links of these
    ``people`` are printed. Its errors are raised. Other arguments and errors are those of
    ``StudyServer``.
    """
    with (
        suppress(KeyboardInterrupt),  # a second one, while the first one is heeded
        StudyServer(
            study if isinstance(study, Study) else people, host, port, let_others_in=let_others_in
        ) as server,
        suppress(KeyboardInterrupt),
    ):
        for who, link in server.links().items():
            print(f"{who}: {link}")
        print(f"Your own page: {server.new_address()}", flush=True)
        print(
            "Send each person the link with their name. Each address lets in one browser, once. "
            "Your own page makes new links, shows who has answered how much, and ends the study. "
            "Enter: another address of your own page. Ctrl+C: stop. Every answer is kept.",
            file=sys.stderr,
            flush=True,
        )
        if not isinstance(study, Study):
            with progress_said():
                server.begin(study())
        for _ in lines_entered():
            print(f"Your own page: {server.new_address()}", flush=True)
        threading.Event().wait()
