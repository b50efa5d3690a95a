"""The options of asking: one set of keywords for everything that asks a tutor."""

from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from typing import NamedTuple, TypeAlias, TypedDict, cast

from elicit._support.hashing import Seed
from elicit._support.keywords import check_keywords
from elicit._support.validation import is_list, is_number, is_whole, require
from elicit.model.comparator import check_answers
from elicit.model.query import Answer, Answers
from elicit.tutors.answer_log import Entry

EarlierAnswers: TypeAlias = Answers | Iterable[Answer | Entry]
"""Earlier answers: Answers, an AnswerLog, or a list of Answer."""

MAX_AUDITS = 50
"""Default limit on the number of audits: enough to tell a tutor with a tenth of wrong answers from
one without."""


class AskingOptions(TypedDict, total=False):
    """Keywords that learners and all other askers take. Each may be left out.

    Attributes
    ----------
    max_queries : int, optional
        Largest number of questions. Pairs that are still undecided after it follow the comparator's
        best guess at the scale, and the result's status says so. None: no limit.
    indifference : float, optional
        An undecided pair whose bounds on d.e lie within +- this counts as equal. It is a share of
        the value range. None: the asker's default, which a learner with a tolerance derives from
        the tolerance.
    audit : float
        Share of the pairs decided by answers that is put to the tutor all the same, to find errors,
        in 0..1. Default 0.
    max_audits : int
        Largest number of audits. Default 50.
    batch : int
        Largest number of questions at once. Default 1. An asker with one pair in question at a
        time, such as Q-learning, leaves it unused.
    known : Answers, AnswerLog or list of Answer
        Earlier answers. The comparator learns those that it does not have yet. Their pairs are not
        asked again. Audits among them count as audits, but other questions do not count as asked.
    seed : int, SeedSequence or Generator, optional
        Picks the audits, and makes an asker's other random choices. The same int gives the same
        run. None draws a new seed, which is kept as ``.seed``. Default 0.
    labels : sequence of k str, optional
        Names of the levels, worst first, that questions show. None: a learner takes its MDP's.
    """

    max_queries: int | None
    indifference: float | None
    audit: float
    max_audits: int
    batch: int
    known: EarlierAnswers
    seed: Seed | None
    labels: Sequence[str] | None


class OptionValues(NamedTuple):
    """Values of ``AskingOptions`` that are in range. Those not given have their defaults."""

    indifference: float
    max_queries: int | None
    audit: float
    max_audits: int
    batch: int
    labels: Sequence[str] | None


def check_options(taker: object, given: AskingOptions) -> None:
    """Raise TypeError for an option that neither ``AskingOptions`` nor the taker has."""
    check_keywords(type(taker), given, AskingOptions.__annotations__)


def checked_values(given: AskingOptions, k: int) -> OptionValues:
    """Return the values of the options, for k levels. An indifference of None is 0.

    Raises ValueError for one that is out of range.
    """
    indifference = given.get("indifference")
    indifference = 0.0 if indifference is None else indifference
    max_queries = given.get("max_queries")
    audit = given.get("audit", 0.0)
    max_audits = given.get("max_audits", MAX_AUDITS)
    batch = given.get("batch", 1)
    labels = given.get("labels")
    require(is_number(indifference, 0), "indifference", "a number of at least 0", indifference)
    require(
        max_queries is None or is_whole(max_queries, 0),
        "max_queries",
        "None or a whole number from 0 on",
        max_queries,
    )
    require(
        is_number(audit, 0, 1),
        "audit, the share of decided pairs to ask about,",
        "in 0..1",
        audit,
    )
    require(is_whole(max_audits, 0), "max_audits", "a whole number of at least 0", max_audits)
    require(is_whole(batch, 1), "batch", "a whole number of at least 1", batch)
    require(
        labels is None or is_list(labels, k),
        "labels",
        f"None or {k} names, one a level",
        labels,
    )
    return OptionValues(
        float(indifference), max_queries, float(audit), int(max_audits), int(batch), labels
    )


def filled(given: AskingOptions, defaults: AskingOptions) -> AskingOptions:
    """Return the options given. Those left out or None are taken from ``defaults``."""
    missing = {name: value for name, value in defaults.items() if given.get(name) is None}
    return cast(AskingOptions, {**given, **missing})


def checked_known(known: EarlierAnswers, k: int) -> Answers | Iterator[Entry]:
    """Return the option ``known`` as Answers over k levels, or as an iterator of log entries.

    Raises TypeError or ValueError. For a bad entry the iterator raises it on reaching the entry.
    """
    if isinstance(known, str | bytes | PathLike):
        raise TypeError(
            "known takes answers, not the path of a file: open it, "
            f"known=elicit.AnswerLog({known!r}), or only "
            f"read it, known=elicit.AnswerLog.read({known!r})"
        )
    if isinstance(known, Answers):
        return check_answers(known, k)
    if not isinstance(known, Iterable):
        raise TypeError(
            f"known takes Answers, an AnswerLog, or a list of elicit.Answer, not {known!r}"
        )
    return (_checked_entry(one, k) for one in known)


def _checked_entry(known: Answer | Entry, k: int) -> Entry:
    """Return an answer as a log entry. Raise TypeError or ValueError unless it has k levels."""
    entry = known if isinstance(known, Entry) else Entry(known)
    answer = entry.answer
    if not isinstance(answer, Answer):
        raise TypeError(
            "known takes Answers, an AnswerLog, or a list of elicit.Answer, but among it is "
            f"{known!r}"
        )
    if not entry.retracted and len(answer.query.left) != k:
        raise ValueError(
            f"known is about other levels: query {answer.query.id} has "
            f"{len(answer.query.left)}, but the "
            f"comparator was made for k = {k}"
        )
    return entry
