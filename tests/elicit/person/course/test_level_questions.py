"""Further questions: in whole numbers, undecided, about the level whose value is least known."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import (
    Answer,
    Answers,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    Verdict,
    value_bounds,
)
from elicit.person.course.level_questions import (
    FURTHER,
    WIDE,
    known_question,
    level_question,
    order_question,
    purpose_of,
    questions_left,
    questions_to_narrow,
)
from elicit.person.course.ranges import value_ranges
from elicit.person.showing import show
from tests.thoroughness import examples, quick_first, scaled, thorough


def never(_: Query) -> bool:
    return False


def about(query: Query) -> int:
    """The level on the query's left."""
    return int(np.flatnonzero(query.left)[0])


@examples(100)
@given(seed=st.integers(0, 10_000), k=st.integers(3, 7), neighbours=st.booleans())
def test_either_answer_is_possible_and_the_question_is_shown_as_it_is(
    seed: int, k: int, neighbours: bool
) -> None:
    chance = np.random.default_rng(seed)
    knows, values = PolytopeComparator(k), np.sort(chance.random(k))
    for _ in range(int(chance.integers(0, 6))):
        query = level_question(knows, 10, never)
        if query is None:
            break
        sign = Verdict(int(np.sign(query.d @ values)) or 1)
        knows = knows.update(Answers.of([Answer(query, sign)], k))
    found = level_question(knows, 10, never, mixed_with="neighbours" if neighbours else "ends")
    if found is None:
        low, high = value_bounds(knows)
        assert neighbours or (high - low).max() < 0.02 + 1e-6
        return
    (least,), (most,) = knows.bounds(found.d[None, :])
    assert least < 0 < most
    assert show(found).exact
    assert show(found).of in (10, 100)


def test_levels_that_no_answer_is_about_come_first() -> None:
    knows = PolytopeComparator(5)
    for asked, level in (((), 1), ((1,), 2), ((1, 2), 3), ((1, 2, 3), 1)):
        query = level_question(knows, 10, never, asked)
        assert query is not None
        assert about(query) == level
        assert np.flatnonzero(query.right).tolist() == [0, 4]


def test_the_purpose_of_a_question_says_which_level_it_is_about() -> None:
    knows, labels = PolytopeComparator(4), ("died", "ill", "fair", "well")
    query = level_question(knows, 10, never)
    assert query is not None
    said = f"This question narrows what “{labels[about(query)]}” is worth to you."
    assert purpose_of(query, knows, labels, None) == f"{said} {FURTHER}"
    assert "mistakes, is at most 20 wide" in purpose_of(query, knows, labels, 20.0)
    assert not purpose_of(order_question(4, 1), knows, labels, None)


def test_a_question_that_was_answered_is_not_put_again() -> None:
    knows, seen = PolytopeComparator(3), list[int]()

    def share(query: Query) -> int:
        return round(100 * float(query.right[2]))

    while query := level_question(knows, 10, lambda query: share(query) in seen):
        seen.append(share(query))
    assert sorted(seen[:9]) == [*range(10, 100, 10)]  # tenths come first
    assert sorted(seen) == [*range(1, 100)]


def test_it_ends_where_everything_is_known_or_nothing_can_be() -> None:
    assert level_question(PolytopeComparator(2), 10, never) is None
    knows = PolytopeComparator(3, tie=0.0)
    equal = Answer(Query("q", [0, 1, 0], [0.5, 0, 0.5]), Verdict.EQUAL)
    assert level_question(knows.update(Answers.of([equal], 3)), 10, never) is None


def test_a_known_question_has_one_answer_and_is_not_too_easy() -> None:
    knows, seen = PolytopeComparator(4), set[str]()
    assert known_question(knows, 10, never) is None  # nothing is known yet
    for level, n in ((1, 3), (2, 6)):
        mixture = np.array([10 - n, 0, 0, n]) / 10
        equal = Answer(Query(f"{level}", np.eye(4)[level], mixture), Verdict.EQUAL)
        knows = knows.update(Answers.of([equal], 4))
    apart = []
    while query := known_question(knows, 10, lambda query: query.id in seen):
        seen.add(query.id)
        (least,), (most,) = knows.bounds(query.d[None, :])
        assert least > 0 or most < 0
        apart.append(max(least, -most))
    assert np.round(apart, 6).tolist() == sorted(np.round(apart, 6).tolist())
    assert apart[0] >= 0.05
    assert len(apart) == 16


def test_a_posterior_is_asked_as_well() -> None:
    query = level_question(PosteriorComparator(4, particles=200, seed=0), 10, never)
    assert query is not None
    assert show(query).exact


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_order_check_has_the_better_level_on_its_left(level: int) -> None:
    query = order_question(4, level)
    assert (query.d @ np.arange(4.0)) > 0
    assert show(query).exact


@pytest.mark.parametrize("k", quick_first([3, 4, 6], 2))
def test_the_number_of_questions_left_is_foreseen(k: int) -> None:
    """The range holds from every point of a session of a truthful person."""
    chance, held, points = np.random.default_rng(k), 0, 0
    for _ in range(3):
        knows, values = PolytopeComparator(k), np.sort(np.r_[0.0, chance.random(k - 2), 1.0])
        said: set[str] = set()
        ranges = []
        while (query := level_question(knows, 10, lambda query, said=said: query.id in said)) and (
            found := questions_left(knows)
        ):
            ranges.append(found)
            said.add(query.id)
            sign = Verdict(int(np.sign(query.d @ values)))
            knows = knows.update(Answers.of([Answer(query, sign)], k))
        assert ranges
        left = range(len(ranges), 0, -1)
        held += sum(low <= n <= high for (low, high), n in zip(ranges, left, strict=True))
        points += len(ranges)
        assert ranges[0][1] > ranges[len(ranges) // 2][1] > ranges[-1][1]
    assert held >= 0.9 * points
    done = PolytopeComparator(2)
    assert questions_left(done) == (0, 0)


def was_asked(seen: dict[str, int], query: Query) -> bool:
    return query.id in seen


@pytest.mark.parametrize("k", quick_first([4, 6], 1))
def test_as_many_questions_narrow_the_ranges_as_is_said(k: int) -> None:
    held = []
    for number in range(scaled(10, 160)):
        rng = np.random.default_rng([number, 7])
        values = np.r_[0.0, np.cumsum(rng.dirichlet(np.ones(k - 1)))]
        knows, widths = PosteriorComparator(k, seed=number), []
        seen: dict[str, int] = {}
        for _ in range(31):
            low, high = value_ranges(knows)
            widths.append(100.0 * (high - low)[1:-1])
            if len(widths) > 5 and (widths[-1] <= WIDE).all():
                break
            query = level_question(knows, 10, partial(was_asked, seen), [*seen.values()])
            assert query is not None
            seen[query.id] = int(query.id.split("/")[1])
            apart = float(query.d @ values)
            verdict = Verdict(0 if abs(apart) <= 0.03 else int(np.sign(apart)))
            knows = knows.update(Answers.of([Answer(query, verdict)], k))
        for n in range(5, len(widths) - 1):
            left = next((m - n for m in range(n, len(widths)) if (widths[m] <= WIDE).all()), 99)
            least, most = questions_to_narrow(widths[n].tolist())
            held.append(least <= left <= most)
    assert len(held) > scaled(10, 160)
    assert np.mean(held) >= (0.8 if thorough() else 0.7)
