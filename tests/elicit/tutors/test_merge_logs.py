"""Logs of several experts become one, with all that was said and nothing twice."""

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    BadLog,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    Verdict,
    choose,
    merge_logs,
)

LEFT, RIGHT = [0.1, 0.2, 0.7], [0.3, 0.3, 0.4]


def log_of(path, who, verdicts, header=None):
    """Answers to the queries named."""
    with AnswerLog(path, header=header or {"unit": "days"}) as log:
        for name, verdict in verdicts.items():
            log.append(Answer(Query(name, LEFT, RIGHT), verdict), who=who)
    return log


def told(log):
    return [
        (e.answer.query.id, e.answer.verdict, e.metadata.get("who"), e.used, e.retraction)
        for e in log
    ]


def test_what_one_withdrew_another_said_still_stands(tmp_path):
    log_of(tmp_path / "a", "ann", {"q": 1, "r": None})
    log_of(tmp_path / "b", "bob", {"q": -1, "s": 0})
    with AnswerLog(tmp_path / "b") as log:
        log.retract("q", why="typo")
        log.mark_unused("s")
        log.append(Answer(Query("q", LEFT, RIGHT), Verdict.BETTER), who="bob")
    logs = [AnswerLog.read(tmp_path / name) for name in ("a", "b", "a")]  # one of them twice
    merge_logs(logs, tmp_path / "all")
    merged = AnswerLog(tmp_path / "all", k=3, header={"unit": "days"})
    assert told(merged) == [
        ("q", -1, "bob", False, {"why": "typo"}),
        ("q", 1, "ann", True, None),
        ("r", None, "ann", True, None),
        ("s", 0, "bob", False, None),
        ("q", 1, "bob", True, None),
    ]
    assert merged.answers().y.tolist() == [1, 1]
    with pytest.raises(FileExistsError, match="name a new file"):
        merge_logs(logs, tmp_path / "all")


@pytest.mark.parametrize(
    "header", [{"unit": "patients"}, {"unit": "days", "discount": 0.9}, {"labels": ["a"]}]
)
def test_logs_of_other_problems_are_not_merged(tmp_path, header):
    log_of(tmp_path / "a", "ann", {"q": 1})
    log_of(tmp_path / "b", "bob", {"q": 1}, header)
    logs = [AnswerLog.read(tmp_path / name) for name in "ab"]
    with pytest.raises(BadLog, match="something else than"):
        merge_logs(logs, tmp_path / "all")
    with pytest.raises(ValueError, match="no logs"):
        merge_logs([], tmp_path / "all")
    assert not (tmp_path / "all").exists()


def test_opposite_answers_of_two_logs_are_a_contradiction_and_no_tie(tmp_path):
    open_pair = [0.0, 1.0, 0.0], [0.5, 0.0, 0.5]  # dominance is silent
    for name, query, verdict in (("a", "q", 1), ("b", "r", -1)):
        with AnswerLog(tmp_path / name, header={"unit": "days"}) as log:
            log.append(Answer(Query(query, *open_pair), verdict))
    merge_logs([AnswerLog.read(tmp_path / name) for name in "ab"], tmp_path / "all")
    merged = AnswerLog.read(tmp_path / "all")
    with pytest.raises(InconsistentAnswers, match="one of them is wrong") as caught:
        PolytopeComparator(3).update(merged.answers())
    assert caught.value.answers == ((0, "q"), (1, "r"))
    with pytest.raises(InconsistentAnswers) as caught:
        choose(np.array(open_pair), PolytopeComparator(3), known=merged)
    assert [name for _, name in caught.value.answers] == ["q", "r"]
    d = np.subtract(*open_pair)
    known = PolytopeComparator(3, wrong=1).update(merged.answers())
    assert (
        known.compare(d).tolist() == PolytopeComparator(3).compare(d).tolist() == [Verdict.UNKNOWN]
    )
