"""The next question after each possible answer, computed while the person reads."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from functools import partial

from elicit.model.query import Answer, Query, Verdict
from elicit.person.asker import AfterAnswer, Asker, tell
from elicit.person.background import MadeAhead

_LIKELY_FIRST = (Verdict.BETTER, Verdict.WORSE, Verdict.EQUAL, None)


class LookAhead:
    """Copies of an asker, each told another answer, so that their next questions are known already.

    ``steps`` computes the remaining ones. It may run in another thread than ``told``.

    Parameters
    ----------
    asker : Asker
        The asker that has the pending query.
    twin : Asker
        A copy of it, which nothing else uses.
    query : Query
        The pending query.
    swapped : bool
        True if the query is shown right to left.
    who : str, optional
        The person who will answer.
    """

    def __init__(
        self, asker: Asker, twin: Asker, query: Query, swapped: bool, who: str | None = None
    ) -> None:
        self.asker, self.query = asker, query
        self._twin, self._swapped, self._who = twin, swapped, who
        self._ahead = MadeAhead[Verdict | None, AfterAnswer]()

    def steps(self) -> Iterator[None]:
        """Compute one answer a step. A step that fails is left out."""
        return self._ahead.steps(
            {verdict: partial(self._after, verdict) for verdict in _LIKELY_FIRST}
        )

    def _after(self, verdict: Verdict | None) -> AfterAnswer:
        asker = copy.deepcopy(self._twin)
        answer = Answer(self.query, verdict, self._swapped, self._who)
        found = AfterAnswer(asker, tell(asker, answer))
        asker.ask()
        return found

    def waits_for(self, asker: Asker, query: Query) -> bool:
        """Return whether this looks ahead to the answers to this query of this asker."""
        return asker is self.asker and query.id == self.query.id

    def told(self, asker: Asker, answer: Answer) -> AfterAnswer | None:
        """Return the asker after this answer, or None if that was not computed.

        The asker is given away. If it is being computed, the call waits for it.

        Parameters
        ----------
        asker : Asker
        answer : Answer

        Returns
        -------
        AfterAnswer or None
        """
        if not self.waits_for(asker, answer.query) or answer.swapped != self._swapped:
            return None
        if answer.who != Answer(self.query, None, who=self._who).who:
            return None
        return self._ahead.take(answer.verdict)
