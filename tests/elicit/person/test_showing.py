"""The screen shows the pair that is asked about."""

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Bags, Query, Verdict, Words
from elicit.person.showing import NARROWEST, Choice, Shown, practice, show

LABELS = ("died", "critical", "severe", "moderate", "mild", "recovered")
PATIENTS = Words("patients", "fare")


@st.composite
def queries(draw: Any) -> tuple[Query, int]:
    """Two vectors of k levels that are counts of one total divided by a number, which comes with
    them.
    """
    k, total = draw(st.integers(2, 7)), draw(st.sampled_from([1, 7, 10, 37, 100, 999, 1000]))
    ends = st.lists(st.integers(0, total), min_size=k - 1, max_size=k - 1).map(sorted)
    counts = [np.diff([0, *draw(ends), total]) for _ in range(2)]
    divisor = draw(st.sampled_from([1, total]))
    return Query(draw(st.text("abc", min_size=1)), *(n / divisor for n in counts)), divisor


def read_back(text: str, k: int) -> list[list[int]]:
    """The counts of side A and of side B that a text says, whatever its width, of levels named
    level 1, ... level k.
    """
    said, table = text.split("\n\n")
    counts = np.zeros((2, k), dtype=int)
    common = re.search(r" the same in both groups: (.*?)\.", " ".join(said.split()))
    for n, level in re.findall(r"([\d,]+) level (\d+)", common.group(1) if common else ""):
        counts[:, int(level) - 1] += int(n.replace(",", ""))
    side: int | None = None
    for line in table.splitlines():
        if line in ("A", "B"):
            side = "AB".index(line)
        elif found := re.match(r"  level (\d+) ", line):
            numbers = [
                int(n.replace(",", ""))
                for n in re.findall(r"(?<= )\d[\d,]*", line[found.end() - 1 :])
            ]
            sides = [0, 1] if side is None else [side]
            assert len(numbers) == len(sides)
            counts[sides, int(found[1]) - 1] += numbers
    return counts.tolist()


@given(queries(), st.integers(NARROWEST, 120), st.integers(0, 3))
def test_what_is_shown_reads_back_to_the_vectors_of_the_query(
    asked: tuple[Query, int], width: int, seed: int
) -> None:
    query, _ = asked
    shown = show(query, seed=seed)
    assert shown.exact
    text = shown.text(width)
    assert max(map(len, text.splitlines())) <= width
    sides = read_back(text, len(query.left))
    left, right = reversed(sides) if shown.swapped else sides
    assert (
        (np.array(left) / shown.scale).tolist() == query.left.tolist() == shown.vectors[0].tolist()
    )
    assert (
        (np.array(right) / shown.scale).tolist()
        == query.right.tolist()
        == shown.vectors[1].tolist()
    )
    icons = text.split("\n\n")[1].count
    if max([0, *(n for row in shown.rows for n in (row.a, row.b))]) <= 50:
        assert icons("+") + icons("x") + icons("o") == 2 * (shown.of - sum(shown.common))


def test_every_bag_question_is_shown_in_its_own_counts() -> None:
    bags = Bags(days=10)
    asked = bags.questions(5)
    for left, right in zip(asked.left, asked.right, strict=True):
        shown = show(Query("a", left / 10, right / 10), of=10)
        assert (shown.exact, shown.of) == (True, 10)
        assert (shown.left, shown.right) == (tuple(left), tuple(right))
        assert not sum(shown.common)


@given(
    st.lists(st.floats(1e-3, 1), min_size=6, max_size=6),
    st.lists(st.floats(1e-3, 1), min_size=6, max_size=6),
)
def test_what_is_rounded_says_so_and_keeps_its_total_and_the_signs_of_what_differs(
    a: list[float], b: list[float]
) -> None:
    left, right = (np.array(x) / sum(x) for x in (a, b))
    shown = show(Query("a", left, right))
    if shown.exact:
        assert (shown.vectors[0] == left).all()
        return
    assert "(Rounded to whole days: " in shown.text()
    assert sum(shown.left) == sum(shown.right) == shown.of
    d, apart = shown.vectors[0] - shown.vectors[1], np.abs(left - right).max()
    assert shown.of == 1_000_000 or np.abs(d - (left - right)).max() <= 0.1 * apart


def test_a_difference_does_not_change_its_sign_by_rounding() -> None:
    left, right = [0.2049, 0.3051, 0.49], [0.2051, 0.3046, 0.4903]
    shown = show(Query("a", np.array(left) / sum(left), np.array(right) / sum(right)))
    d = shown.vectors[0] - shown.vectors[1]
    assert np.sign(d).tolist() == [-1, 1, -1]


def test_what_cannot_be_told_apart_in_counts_says_so() -> None:
    shown = show(Query("a", [0.5 + 1e-9, 0.5 - 1e-9], [0.5, 0.5]))
    assert not shown.exact
    assert (
        "The two groups differ by less than 1 in 1,000,000: which would you rather have?"
        in shown.text()
    )


def test_a_bag_question_in_80_columns_and_in_39() -> None:
    shown = show(Query("a", np.eye(6)[3], [0.6, 0, 0, 0, 0, 0.4], labels=LABELS), PATIENTS, seed=2)
    assert not shown.swapped
    assert shown.text() == (
        "Two groups of 10 patients: which would you rather have?\n\n"
        "              A                            B\n"
        "  recovered   0                            4 ++++\n"
        "  moderate   10 ooooo ooooo                0\n"
        "  died        0                            6 xxxxx x"
    )
    assert shown.text(39) == (
        "Two groups of 10 patients: which would\nyou rather have?\n\n"
        "A\n  recovered   0\n  moderate   10 ooooo ooooo\n  died        0\n"
        "B\n  recovered   4 ++++\n  moderate    0\n  died        6 xxxxx x"
    )


def test_what_fares_the_same_is_said_in_a_line_and_not_drawn() -> None:
    left, right = [88, 14, 40, 26, 33, 799], [74, 17, 57, 27, 37, 788]
    shown = show(Query("a", np.array(left) / 1000, np.array(right) / 1000, labels=LABELS), PATIENTS)
    same, asked = shown.sentences()
    assert same == (
        "975 of 1,000 patients fare the same in both groups: 788 recovered, 33 mild, 26 moderate, "
        "40 severe, "
        "14 critical, 74 died. The other 25 are shown."
    )
    assert asked == "Two groups of 1,000 patients: which would you rather have?"
    assert [row.label for row in shown.rows] == [*reversed(LABELS)]
    assert sum(row.a for row in shown.rows) == sum(row.b for row in shown.rows) == 25


def test_long_names_are_wrapped_and_cannot_steer_the_terminal() -> None:
    labels = (
        "dead\x1b[2J\n",
        "a very long name of a level with many words",
        "Supercalifragilisticexpialidocious",
    )
    shown = show(Query("a", [0.3, 0.4, 0.3], [0.1, 0.8, 0.1], labels=labels))
    for width in (NARROWEST, 39, 80):
        text = shown.text(width)
        assert "\x1b" not in text
        assert max(map(len, text.splitlines())) <= width


def test_sides_are_swapped_at_random_by_the_seed_and_the_answer_turned_back() -> None:
    asked = [Query(f"{i}", [0, 1], [1, 0]) for i in range(200)]
    first, again, other = (
        [show(query, seed=seed).swapped for query in asked] for seed in (0, 0, 1)
    )
    assert first == again != other
    assert 70 < sum(first) < 130
    for query in asked[:20]:
        shown: Shown = show(query)
        better: Choice = "a" if shown.rows[0].a else "b"  # where the best are
        assert shown.verdict(better) is Verdict.BETTER
        assert shown.verdict("b" if better == "a" else "a") is Verdict.WORSE
        assert shown.verdict("equal") is Verdict.EQUAL
        assert shown.verdict("cannot tell") is None
        assert shown.record()[better] == [0, 10]


def test_the_practice_question_has_an_obvious_answer() -> None:
    shown = practice(LABELS, PATIENTS)
    assert [(row.label, {row.a, row.b}) for row in shown.rows] == [
        ("recovered", {0, 10}),
        ("died", {0, 10}),
    ]
    assert shown.verdict("a" if shown.rows[0].a else "b") is Verdict.BETTER


@pytest.mark.parametrize(("left", "right"), [([1, 2], [1, 3]), ([-1, 2], [0, 1]), ([0, 0], [0, 0])])
def test_what_are_no_counts_is_refused(left: list[float], right: list[float]) -> None:
    with pytest.raises(ValueError, match="can be shown as counts"):
        show(Query("a", left, right))


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="at least 30, not 29"):
        show(Query("a", [0, 1], [1, 0])).text(29)
    with pytest.raises(ValueError, match="of, how many"):
        show(Query("a", [0, 1], [1, 0]), of=0)
    with pytest.raises(ValueError, match="not 'left'"):
        show(Query("a", [0, 1], [1, 0])).verdict("left")  # type: ignore[arg-type]


def test_an_answer_in_words() -> None:
    shown = show(Query("a", [0.1, 0.2, 0.7], [0.2, 0.8, 0]), of=10, labels=("died", "ill", "well"))
    assert shown.sentence(Verdict.BETTER) == "7 well rather than 6 ill and 1 died"
    assert shown.sentence(Verdict.WORSE) == "6 ill and 1 died rather than 7 well"
    assert shown.sentence(Verdict.EQUAL) == "7 well as good as 6 ill and 1 died"
    assert shown.sentence(None) == "cannot tell 7 well from 6 ill and 1 died"
    with pytest.raises(ValueError, match="labels must be 3 names"):
        show(Query("a", [0, 0, 1], [1, 0, 0]), labels=("one",))
    with pytest.raises(ValueError, match="labels must be 3 names"):
        show(Query("a", [0, 0, 1], [1, 0, 0]), labels="abc")
