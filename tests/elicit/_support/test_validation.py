"""Settings are checked without raising anything raw, whatever they are."""

import math
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import elicit
import qlearn
from elicit._support.validation import (
    check_printable,
    is_number,
    is_range,
    is_whole,
    require,
    with_visible_controls,
)

NONE: list[Any] = [
    None,
    "a",
    "1",
    True,
    np.True_,
    math.nan,
    math.inf,
    1j,
    [1],
    {},
    np.ones(3),
    Decimal(1),
    10**400,
]


@pytest.mark.parametrize("value", NONE, ids=repr)
def test_what_is_no_number(value: Any) -> None:
    assert not is_number(value)
    assert not is_whole(value, 0)
    assert not is_range(value)
    assert not is_range((value, 1))
    assert not is_range((0, value))


@pytest.mark.parametrize(
    "value", [0, 1, 2.0, np.float32(1.5), np.int8(3), Fraction(1, 3)], ids=repr
)
def test_numbers_and_their_limits(value: Any) -> None:
    assert is_number(value)
    assert is_number(value, float(value), float(value))
    assert not is_number(value, least=float(value) + 0.01)
    assert not is_number(value, most=float(value) - 0.01)
    assert is_whole(value, 0) == (float(value) in (0, 1, 2, 3))
    assert not is_whole(value, 4)


def test_ranges_and_what_is_refused() -> None:
    assert is_range((1, 1))
    assert is_range([0.1, 2.0], 0.1, 2.0)
    assert not is_range((2, 1))
    assert not is_range((1, 2, 3))
    assert not is_range((0, 1), least=0.5)
    assert not is_range((0, 1), most=0.5)
    require(True, "x", "a number", "a")
    with pytest.raises(ValueError, match="x must be a number, not 'a'"):
        require(False, "x", "a number", "a")


LEARNERS = [
    qlearn.InteractiveQLearning,
    qlearn.InteractiveValueIteration,
    qlearn.InteractivePolicyIteration,
]


@pytest.mark.parametrize("comparator", [None, elicit.PolytopeComparator, "polytope", 5], ids=repr)
def test_what_is_no_comparator(comparator: Any) -> None:
    mdp, _ = qlearn.random_mdp(4, 2, 3, rng=0)
    for learner in LEARNERS:
        with pytest.raises(TypeError, match="a comparator is wanted, such as"):
            learner(mdp, comparator)
    with pytest.raises(TypeError, match="a comparator is wanted, such as"):
        elicit.choose([[1.0, 0.0], [0.0, 1.0]], comparator)


@pytest.mark.parametrize("learner", LEARNERS)
def test_what_is_no_mdp_or_has_other_levels(learner: Any) -> None:
    mdp, values = qlearn.random_mdp(4, 2, 3, rng=0)
    with pytest.raises(TypeError, match="an OrdinalMDP is wanted, not None"):
        learner(None, elicit.PolytopeComparator(3))
    with pytest.raises(TypeError, match=r"an OrdinalMDP is wanted, not PolytopeComparator\(k=3"):
        learner(elicit.PolytopeComparator(3), mdp)
    with pytest.raises(
        ValueError, match="the MDP has 3 levels, but the comparator was made for k = 4"
    ):
        learner(mdp, elicit.PolytopeComparator(4))
    with pytest.raises(TypeError, match=r"a tutor takes a query and returns an Answer; \[39"):
        qlearn.drive(learner(mdp, elicit.PolytopeComparator(3)), values.tolist())


@pytest.mark.parametrize("k", [1, 0, -3, 2.5, "5", None, math.nan, math.inf, True, 10**400])
def test_what_is_no_number_of_levels(k: Any) -> None:
    kinds = [
        elicit.PolytopeComparator,
        elicit.BradleyTerryComparator,
        elicit.PosteriorComparator,
        elicit.AlwaysAsk,
    ]
    for comparator in [*kinds, elicit.Dominance]:
        with pytest.raises(
            ValueError, match="k, the number of levels, must be a whole number of at least 2, not"
        ):
            comparator(k)


@pytest.mark.parametrize("bad", ["a\x1b[31m", "a\n", "\x00", "a\u2028b", "\ud800"])
def test_a_control_character_is_named(bad: str) -> None:
    with pytest.raises(ValueError, match=r"names are shown to people, and .* leave it out"):
        check_printable("names", ["fine", bad])


def test_letters_of_all_scripts_are_printable() -> None:
    texts = ["à 5\u00a0%", "بهتر", "良い", "👩\u200d⚕️", ""]
    check_printable("names", texts)
    assert [with_visible_controls(text) for text in texts] == texts


def test_a_question_shows_control_characters_as_text() -> None:
    query = elicit.Query("a", [1, 0], [0, 1], "b\x1b[2J?", labels=["c\n", "d"])
    assert str(query) == "b\\x1b[2J?\n  left:  100% c\\n\n  right: 100% d"
