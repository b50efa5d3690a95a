"""A consumer declares its needs of a comparator in one line, and one function checks them."""

import pytest

import elicit
from elicit import (
    AlwaysAsk,
    BradleyTerryComparator,
    Dominance,
    Needs,
    OpenOrderComparator,
    OpenOrderPosterior,
    Panel,
    PolytopeComparator,
    PosteriorComparator,
)
from elicit.model.comparator import offers
from elicit.model.comparator_parts import OPTIONAL_PARTS
from elicit.model.needs import check_needs, needs_of, uses

OURS = (
    PolytopeComparator(4),
    PosteriorComparator(4, seed=0),
    BradleyTerryComparator(4, seed=0),
    OpenOrderComparator(4),
    OpenOrderPosterior(4, particles=200, seed=0),
    Dominance(4),
    AlwaysAsk(4),
    Panel({name: PosteriorComparator(4, seed=0) for name in ("ann", "ben")}),
)


@pytest.mark.parametrize("part", OPTIONAL_PARTS, ids=lambda part: part.member)
def test_the_table_says_which_of_ours_have_a_part(part):
    assert part.offered_by == tuple(type(one).__name__ for one in OURS if offers(one, part.member))
    assert set(part.offered_by) <= set(elicit.__all__)


def test_an_error_names_the_part_the_consumer_and_who_has_it():
    class Wants:
        needs = Needs(required=("answers", "lapse"), used=("tie",))

    check_needs(PosteriorComparator(4, seed=0), Wants)
    message = r"Polytope\w+ has no lapse, which Wants needs \(the share .*Posterior, Panel have"
    with pytest.raises(TypeError, match=message):
        check_needs(PolytopeComparator(4), Wants)
    with pytest.raises(TypeError, match="Dominance has no answers, which Wants needs"):
        check_needs(Dominance(4), int, Wants)
    with pytest.raises(TypeError, match="a comparator is wanted"):
        check_needs("polytope")


def test_needs_are_joined_and_know_what_is_missing():
    one, other = Needs(("draws",), ("tie",)), Needs(("draws", "lapse"), ("tie", "rule"))
    assert one | other == Needs(("draws", "lapse"), ("tie", "rule"))
    assert (one | other).missing(PolytopeComparator(4)) == ("lapse",)
    assert Needs().missing(AlwaysAsk(4)) == ()


def test_a_name_that_is_no_part_is_refused():
    with pytest.raises(ValueError, match="'drawz' is no optional part of a comparator"):
        Needs(used=("drawz",))


def test_a_function_declares_and_without_a_declaration_nothing_is_needed():
    @uses("draws")
    def rule(candidates):
        return candidates

    assert needs_of(rule) == Needs(used=("draws",))
    assert needs_of(len) == needs_of(object()) == Needs()
