"""A best guess is shown only where a level's range is narrow enough."""

import numpy as np
import pytest

from elicit import Answer, AnswerLog, Answers, PolytopeComparator, Query, Verdict
from elicit.person.findings import ScaleRow, is_known, overlap, scale_rows

LABELS = ("died", "ill", "fair", "well")


@pytest.mark.parametrize(
    ("low", "high", "worse_low", "better_high", "known"),
    [
        (0, 100, 0, 100, False),
        (50, 100, 0, 100, False),
        (20, 50, 0, 100, True),
        (58, 70, 55, 70, True),  # narrow, whatever lies beside it
        (0, 30, 0, 35, False),  # all that its neighbours leave
    ],
)
def test_a_wide_range_is_not_known_yet(
    low: float, high: float, worse_low: float, better_high: float, known: bool
) -> None:
    assert is_known(low, high, worse_low, better_high) is known


def test_rows_after_one_answer_say_what_is_known_and_that_ranges_overlap() -> None:
    query = Query("q", np.array([0, 1.0, 0, 0]), np.array([0.7, 0, 0, 0.3]))
    log = AnswerLog(k=4)
    log.append(Answer(query, Verdict.WORSE))
    comparator = PolytopeComparator(4)
    comparator = comparator.update(Answers(query.d[None, :], [-1]))
    rows = {row.label: row for row in scale_rows(comparator, LABELS, log)}
    assert (rows["ill"].low, rows["ill"].high, rows["ill"].known) == (0, 30, True)
    assert (rows["fair"].asked, rows["fair"].known) == (False, False)
    assert rows["well"].known
    assert rows["died"].known
    assert overlap([*rows.values()])
    assert not overlap([ScaleRow("well", 100, 100, 100), ScaleRow("died", 0, 0, 0)])
