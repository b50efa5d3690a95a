"""Several logs of the same problem, such as those of several people, merged into one log."""

import os
from collections.abc import Sequence
from pathlib import Path

from elicit.tutors.answer_log import WHO, AnswerLog, Entry
from elicit.tutors.log_file import BadLog


def merge_logs(logs: Sequence[AnswerLog], out: str | os.PathLike[str]) -> None:
    """Write all answers of the logs to a new file, one log after the other.

    An answer that is in several logs is written once. Questions without an answer are left out. If
    the logs are of several people, each answer names its person.

    Withdrawn answers are written before all others. Otherwise withdrawing one would also take back
    earlier answers to the same query from other logs.

    Parameters
    ----------
    logs : sequence of AnswerLog
    out : str or path
        The new file.

    Raises
    ------
    BadLog
        If the headers differ.
    ValueError
        If there are no logs.
    FileExistsError
        If the file exists.
    OSError
        If it cannot be written.
    """
    if not logs:
        raise ValueError("there are no logs to merge")
    headers = [
        {name: log.header[name] for name in log.header if name not in ("version", WHO)}
        for log in logs
    ]
    for log, header in zip(logs, headers, strict=True):
        for name in {**headers[0], **header}:
            if name not in header or name not in headers[0] or header[name] != headers[0][name]:
                raise BadLog(
                    f"{log.path} is a log of something else than {logs[0].path}: of {name} their "
                    "headers say "
                    f"{header.get(name)!r} and {headers[0].get(name)!r}. Merge logs of one problem "
                    "only"
                )
    if Path(out).exists():
        raise FileExistsError(f"{out} exists: name a new file to merge into")
    entries = {_name_of(entry): entry for log in logs for entry in log}.values()
    free = {name: headers[0][name] for name in headers[0] if name not in ("format", "k")}
    people = {log.who for log in logs}
    one = people.pop() if len(people) == 1 else None
    with AnswerLog(out, logs[0].k, free, one) as merged:
        for entry in sorted(entries, key=lambda entry: entry.stands):  # the order stays otherwise
            merged.append(entry.answer, entry.used or entry.retracted, **entry.metadata)
            if entry.retraction is not None:
                merged.retract(entry.answer.query.id, **entry.retraction)


def _name_of(entry: Entry) -> str:
    """Return a key that copies of an entry share, and different entries do not."""
    query = entry.answer.query
    told = (
        query.id,
        query.left.tolist(),
        query.right.tolist(),
        entry.answer.verdict,
        entry.answer.swapped,
        entry.answer.who,
    )
    return repr((*told, sorted(entry.metadata.items()), entry.retracted))
