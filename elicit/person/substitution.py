"""Questions that replace those that an asker waits for, such as simpler ones."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from elicit.model.difference import tail_sums
from elicit.model.pairs import same_pairs
from elicit.model.query import Query
from elicit.person.asker import Asker, Audits
from elicit.tutors.answer_log import AnswerLog

Instead: TypeAlias = Callable[[Query, Callable[[Query], bool]], Query | None]
"""Returns the query to put in place of another, or None for the query itself. Its second argument
tells whether a query's difference was answered before."""


def substitute(query: Query, asker: Asker, log: AnswerLog, instead: Instead) -> Query | None:
    """Return the query that is put in place of a pending one, or None if the query itself is put.

    An audit is always put as it is.

    Parameters
    ----------
    query : Query
    asker : Asker
    log : AnswerLog
    instead : callable

    Returns
    -------
    Query or None
    """
    if isinstance(asker, Audits) and query.id in asker.implied:
        return None
    said = [tail_sums(entry.answer.query.d) for entry in log if not entry.retracted]

    def asked_before(other: Query) -> bool:
        return bool(said) and bool(same_pairs(tail_sums(other.d), np.array(said)).any())

    return instead(query, asked_before)
