"""An unknown keyword is named, beside the nearest that there is."""

from inspect import signature
from typing import Any

import pytest

import elicit
from elicit._support.keywords import check_keywords, naming_nearest


class Base:
    def __init__(self, alpha: int = 0, **options: Any) -> None:
        check_keywords(type(self), options, ("seed", "batch"))


class Derived(Base):
    def __init__(self, beta: int = 0, **options: Any) -> None:
        super().__init__(**options)


def asks(gamma: int = 0, **options: Any) -> None:
    check_keywords(asks, options, ("seed", "batch"))


def test_the_nearest_keyword_is_named_whether_common_own_or_of_a_base_class() -> None:
    for taker, given, nearest in (
        (Base, "bach", "batch"),
        (Derived, "alpa", "alpha"),
        (Derived, "betta", "beta"),
        (asks, "gama", "gamma"),
    ):
        with pytest.raises(
            TypeError,
            match=f"{taker.__name__} has no keyword '{given}'. The nearest is '{nearest}'",
        ):
            taker(**{given: 1})


def test_all_keywords_are_listed_and_known_ones_pass() -> None:
    with pytest.raises(TypeError, match=r"it takes alpha, batch, beta, seed$"):
        Derived(nothing_like_it=1)
    Derived(beta=1, alpha=2, seed=3, batch=4)
    asks(1, seed=2)


@naming_nearest
def adds(one: int, /, two: int = 2, *, three: int = 3) -> int:
    """Add three numbers."""
    return one + two + three


def test_a_function_without_a_common_set_names_the_nearest_too() -> None:
    assert adds(1) == adds(1, 2, three=3) == 6
    assert (adds.__name__, adds.__doc__) == ("adds", "Add three numbers.")
    assert [*signature(adds).parameters] == ["one", "two", "three"]
    with pytest.raises(TypeError, match=r"adds has no keyword 'tree'. The nearest is 'three'"):
        adds(1, tree=3)  # type: ignore[call-arg]
    known = elicit.PolytopeComparator(2)
    with pytest.raises(TypeError, match=r"choose has no keyword 'label'. The nearest is 'labels'"):
        elicit.choose([[1, 0], [0, 1]], known, label=["a", "b"])  # type: ignore[call-arg]
