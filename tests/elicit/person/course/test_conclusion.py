"""Losses are said in the problem's own unit, and never rounded down."""

import re

from hypothesis import given
from hypothesis import strategies as st

from elicit.person.course.conclusion import in_unit, per_hundred


@given(st.floats(0, 1))
def test_a_loss_is_never_rounded_down_and_by_a_tenth_at_most(share: float) -> None:
    found = re.fullmatch(r"([\d.e-]+) in 100", per_hundred(share))
    assert found
    said = float(found[1]) / 100
    assert said >= share * (1 - 1e-9)
    assert said <= max(1.1 * share, 1.001e-5)


def test_two_digits() -> None:
    said = {0.0379: "3.8", 0.01: "1", 0.28: "28", 0.004711: "0.48", 1.0: "100", 0.0: "0"}
    assert {share: per_hundred(share) for share in said} == {
        share: f"{text} in 100" for share, text in said.items()
    }


def test_in_the_problems_unit() -> None:
    labels = ("died", "ill", "well")
    assert in_unit(0.01, "days", labels) == (
        "as much as if 1 in 100 days were at “died” instead of “well”"
    )
    own = "{n} patients died instead of recovering"
    assert in_unit(0.038, "patients", labels, own) == (
        "as much as if 3.8 in 100 patients died instead of recovering"
    )
