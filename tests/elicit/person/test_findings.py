"""A best guess is shown only where a level's range is narrow enough."""

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
    given_in,
    guess_in_words,
    narrowing,
    overlap,
    scale_notes,
    scale_rows,
    values_in_words,
)
from tests.thoroughness import quick_first

LABELS = ("died", "ill", "fair", "well")
ROUGH = (
    "Hollow dot: a rough best guess, “about” so much, of a range wider than 20, or than 10 if it "
    "reaches to 0 or 100."
)
ABOVE_80 = (  # differences of two groups of 10, and the verdict on each
    ((-5, 0, 0, 10, 0, -5), 1),
    ((-5, 0, 10, 0, 0, -5), -1),
    ((0, -5, 0, 10, 0, -5), 1),
    ((-2, 0, 0, 0, 10, -8), 1),
    ((0, 0, 0, -10, 10, 0), 1),
    ((-5, 0, 10, -5, 0, 0), 1),
    ((-5, 0, 10, 0, -5, 0), -1),
    ((-5, 0, 0, 10, -5, 0), 1),
    ((0, 0, -5, 10, 0, -5), 0),
    ((-6, 0, 10, 0, 0, -4), 0),
)


def test_rows_after_one_answer_say_what_is_known_and_that_ranges_overlap() -> None:
    query = Query("q", np.array([0, 1.0, 0, 0]), np.array([0.7, 0, 0, 0.3]))
    log = AnswerLog(k=4)
    log.append(Answer(query, Verdict.WORSE))
    comparator = PolytopeComparator(4)
    comparator = comparator.update(Answers(query.d[None, :], [-1]))
    rows = {row.label: row for row in scale_rows(comparator, LABELS, log)}
    assert (rows["ill"].low, rows["ill"].high, rows["ill"].known) == (0, 30, False)
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
    """The posterior allows for a mistake in any answer, so two of them leave a wide range."""
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
    assert f"{ROUGH} The result allows" in notes
    wide = f"“ill” ({ill.low:.0f} to {ill.high:.0f}) still has a wide range although you answered "
    assert notes.startswith(f"{wide}about it, because any one answer may be a mistake. “Not known")
    narrow = [row._replace(low=row.high - 40) if row is ill else row for row in found]
    notes = " ".join(scale_notes(narrow, comparator, settled=True))
    assert f"“ill” ({ill.high - 40:.0f} to {ill.high:.0f}) still has a wide range" in notes
    known = [row._replace(known=True) if row.label == "ill" else row for row in narrow]
    assert "still has" not in " ".join(scale_notes(known, comparator, settled=True))
    notes = " ".join(scale_notes(found, comparator, settled=True))
    assert "The result allows for all that is still possible for “fair” and “ill”, and" in notes
    assert "does not need to know them more exactly" in notes
    without = [row for row in found if row.label != "fair"]
    notes = " ".join(scale_notes(without, comparator, settled=True))
    assert "Not known yet" not in notes
    assert "The result allows for all that is still possible for “ill”, and" in notes
    assert "does not need to know it more exactly" in notes
    notes = " ".join(scale_notes(without, PolytopeComparator(4), settled=False))
    assert f"{ROUGH} The result" in notes
    assert "still has a wide range. More answers about it would narrow it. " in notes
    assert notes.count("does not need") == notes.count("mistake") == 0


def test_the_note_on_wide_ranges_names_the_levels_whose_best_guess_is_about() -> None:
    ends = [ScaleRow("well", 100, 100, 100), ScaleRow("died", 0, 0, 0)]
    for high in (10, 11, 9, 21):  # a range that reaches to 0 counts as twice as wide
        row = ScaleRow("ill", 7, 0, high, known=False, rough=True)
        notes = scale_notes([ends[0], row, ends[1]], PosteriorComparator(3), settled=True)
        assert guess_in_words(row.value, row.known, row.rough) == "about 7"
        assert notes[0].startswith(f"“ill” (0 to {high}) still has a wide range ")
        said = narrowing([ends[0], row, ends[1]], PosteriorComparator(3))
        assert ("questions would narrow every range to a width of 20 or less." in said) == (
            high > 10
        )
        assert bool(said) == (high > 10)
        assert not narrowing([ends[0], row, ends[1]], PolytopeComparator(3))
        assert any(note.startswith("Hollow dot") for note in notes)


@pytest.mark.parametrize(("width", "known"), [(19.0, True), (20.0, True), (21.0, False)])
def test_a_range_of_at_most_twenty_has_an_exact_best_guess(width: float, known: bool) -> None:
    said = 0.01 * width
    log, rows = AnswerLog(k=3), []
    for n, share in enumerate((0.4, 0.4 + said)):  # ill is worth more than the first only
        query = Query(f"q{n}", np.array([0, 1.0, 0]), np.array([1 - share, 0, share]))
        log.append(Answer(query, Verdict.BETTER if n == 0 else Verdict.WORSE))
        rows.append(query.d)
    known_now = PolytopeComparator(3).update(Answers(rows, [1, -1]))
    ill = scale_rows(known_now, ("died", "ill", "well"), log)[1]
    assert (ill.low, ill.high, ill.known) == (40, 40 + width, known)
    assert values_in_words([ill]) == f"ill {guess_in_words(ill.value, known, not known)}."


@pytest.mark.parametrize(("value", "said"), [(30.0, True), (31.0, True), (40.0, False)])
def test_a_best_guess_at_an_end_of_a_range_is_explained(value: float, said: bool) -> None:
    ends = [ScaleRow("well", 100, 100, 100), ScaleRow("died", 0, 0, 0)]
    rows = [ends[0], ScaleRow("ill", value, 20, 60), ends[1]]
    notes = scale_notes(rows, PosteriorComparator(3), True, [ScaleRow("ill", 45, 30, 55)])
    assert any("may lie at an end of the range" in note for note in notes) == said


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (0, 50, (0, 50)),
        (20, 50, (20, 50)),
        (0, 84, (0, 84)),
        (10, 90, (10, 84)),
        (0, 100, (0, 84)),
        (90, 95, None),
    ],
)
def test_beside_a_wide_range_stands_that_of_the_answers_if_none_is_a_mistake(
    low: float, high: float, shown: tuple[float, float] | None
) -> None:
    ends = [ScaleRow("well", 100, 100, 100), ScaleRow("died", 0, 0, 0)]
    wide = ScaleRow("ill", 40, 0, 84, known=False, rough=True)
    narrow = ScaleRow("fair", 95, 94, 97)
    given = [ScaleRow("ill", 40, low, high), ScaleRow("fair", 95, 95, 96)]
    assert given_in(wide, given) == shown
    assert given_in(narrow, given) == (95, 96)
    assert given_in(wide, []) is None
    assert given_in(wide._replace(asked=False), given) is None
    rows = [ends[0], narrow, wide, ends[1]]
    [first, *_] = scale_notes(rows, PosteriorComparator(4), True, given)
    assert first.startswith("“ill” (0 to 84) still has a wide range") == (shown is None)
    assert "fair" not in first
    about = "In “If no answer is a mistake”, an answer “equally good” counts as “within 5 of 100”."
    assert about in scale_notes(rows, PosteriorComparator(4), True, given, about_equal=0.05)
    for asked, within in ((given, 0.0), ((), 0.05)):  # nothing was called equal; no such range
        assert about not in scale_notes(rows, PosteriorComparator(4), True, asked, within)


def test_an_answer_that_narrows_nothing_leaves_a_level_unknown() -> None:
    log = AnswerLog(k=4)
    query = Query("q", np.array([0, 0.5, 0, 0.5]), np.array([0.1, 0.2, 0.3, 0.4]))
    log.append(Answer(query, Verdict.BETTER))
    rows = scale_rows(PolytopeComparator(4), LABELS, log)  # which has not learned it
    ill = next(row for row in rows if row.label == "ill")
    assert (ill.asked, ill.known, ill.rough) == (True, False, False)


@pytest.mark.parametrize("seed", quick_first([3, 8, 0, 1, 2], 2))
def test_a_level_that_few_answers_are_about_keeps_a_wide_range(seed: int) -> None:
    """Ten answers of a person to whom the last level but one was worth 85 say that it is above 80.

    With these seeds the bounds of the comparator's own particles say more than 90.
    """
    labels = ("died", "critical", "severe", "moderate", "mild", "recovered")
    counts, verdicts = zip(*ABOVE_80, strict=True)
    known = PosteriorComparator(6, seed=seed).update(Answers(np.array(counts) / 10, verdicts))
    mild = scale_rows(known, labels)[1]
    assert mild.low <= 85 <= mild.high
