"""A best guess is shown only where a level's range is narrow enough."""

from typing import Any

import numpy as np
import pytest

from elicit import (
    Answer,
    AnswerLog,
    Answers,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Verdict,
)
from elicit.person.findings import (
    ScaleRow,
    guess_in_words,
    is_known,
    overlap,
    scale_notes,
    scale_rows,
)

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
    assert (rows["fair"].asked, rows["fair"].known, rows["fair"].rough) == (False, False, False)
    assert rows["well"].known
    assert rows["died"].known
    assert overlap([*rows.values()])
    assert not overlap([ScaleRow("well", 100, 100, 100), ScaleRow("died", 0, 0, 0)])


@pytest.mark.parametrize(
    ("known", "rough", "said"),
    [(True, False, "41"), (False, True, "about 41"), (False, False, "not known yet")],
)
def test_a_best_guess_that_is_not_exact_or_not_known_is_said_to_be(
    known: bool, rough: bool, said: str
) -> None:
    assert guess_in_words(40.6, known, rough) == said


def test_a_best_guess_in_a_wide_range_is_called_inexact_and_the_reason_is_said() -> None:
    """The posterior allows for a slip in any answer, so two of them leave a wide range."""
    log, rows = AnswerLog(k=4), []
    for n, (share, verdict) in enumerate([(0.4, Verdict.WORSE), (0.3, Verdict.WORSE)]):
        query = Query(f"q{n}", np.array([0, 1.0, 0, 0]), np.array([1 - share, 0, 0, share]))
        log.append(Answer(query, verdict))
        rows.append(query.d)
    comparator = PosteriorComparator(4).update(Answers(rows, [-1, -1]))
    found = scale_rows(comparator, LABELS, log)
    ill = next(row for row in found if row.label == "ill")
    assert (ill.asked, ill.known, ill.rough) == (True, False, True)
    assert (ill.low, ill.high) != (0, 100)
    notes = " ".join(scale_notes(found, comparator, settled=True))
    assert "“Not known yet” (no dot): no answer is about it" in notes  # fair
    assert (
        "“About” (hollow dot): this best guess is not exact yet. Any one answer may be a" in notes
    )
    assert "The result allows for all that is still possible for “fair” and “ill”, and" in notes
    assert "does not need to know them more exactly" in notes
    without = [row for row in found if row.label != "fair"]
    notes = " ".join(scale_notes(without, comparator, settled=True))
    assert "Not known yet" not in notes
    assert "The result allows for all that is still possible for “ill”, and" in notes
    assert "does not need to know it more exactly" in notes
    notes = " ".join(scale_notes(without, PolytopeComparator(4), settled=False))
    assert "“About” (hollow dot): this best guess is not exact yet. The result" in notes
    assert notes.count("does not need") == notes.count("slip") == 0


def test_an_answer_that_narrows_nothing_leaves_a_level_unknown() -> None:
    log = AnswerLog(k=4)
    query = Query("q", np.array([0, 0.5, 0, 0.5]), np.array([0.1, 0.2, 0.3, 0.4]))
    log.append(Answer(query, Verdict.BETTER))
    rows = scale_rows(PolytopeComparator(4), LABELS, log)  # which has not learned it
    ill = next(row for row in rows if row.label == "ill")
    assert (ill.asked, ill.known, ill.rough) == (True, False, False)


def test_a_range_that_rests_on_the_model_more_than_on_answers_is_that_of_the_answers() -> None:
    """One answer alone says that "fair" is worth more than 80."""
    log, rows, said = AnswerLog(k=4), [], []
    asked = [
        ([-0.2, 0.0, 1.0, -0.8], 1),  # fair is worth more than 80
        ([-0.5, 1.0, 0.0, -0.5], 1),
        ([-0.5, 1.0, -0.5, 0.0], 1),
        ([-0.3, 1.0, 0.0, -0.7], -1),
    ]
    for n, (d, verdict) in enumerate(asked):
        left, right = np.maximum(d, 0.0), np.maximum(-np.array(d), 0.0)
        log.append(Answer(Query(f"q{n}", left, right), Verdict(verdict)))
        rows.append(d)
        said.append(verdict)

    class Narrow(PosteriorComparator):
        """A posterior that is surer of "fair" than the answers are."""

        def bounds(self, d: Any) -> Any:
            low, high = super().bounds(d)
            fair = np.asarray(d)[:, 2] == 1.0
            return np.where(fair, 0.93, low), np.where(fair, 1.0, high)

    plain = PosteriorComparator(4, particles=300, seed=0).update(Answers(rows, said))
    narrow = Narrow(4, particles=300, seed=0).update(Answers(rows, said))
    assert not any(row.alone for row in scale_rows(plain, LABELS, log))
    found = scale_rows(narrow, LABELS, log)
    fair = next(row for row in found if row.label == "fair")
    assert (fair.low, fair.high, fair.alone, fair.rough, fair.known) == (80, 100, True, True, False)
    assert [row.label for row in found if row.alone] == ["fair"]
    notes = " ".join(scale_notes(found, narrow, settled=False))
    assert "Few answers are about “fair”: the range is what your answers alone leave" in notes
