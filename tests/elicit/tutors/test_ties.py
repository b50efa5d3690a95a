"""Simulated tutors who call equal what is close."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from elicit import BradleyTerryTutor, FlippingTutor, Query, TruthfulTutor, Verdict
from tests.noisy_cases import differences
from tests.scale_arithmetic import tail_sums

VALUES = np.array([0.0, 0.2, 0.5, 1.0])


def test_a_truthful_tutor_calls_equal_what_lies_within_the_tie_and_nothing_else():
    d = differences(np.random.default_rng(1), 4, 4000)
    at = tail_sums(d) @ np.diff(VALUES)
    said = TruthfulTutor(VALUES, tie=0.05).signs(d)
    assert (said == np.where(np.abs(at) <= 0.05, 0, np.sign(at))).all()
    assert 100 < np.count_nonzero(said == 0) < 3000
    left, right = np.array([0.5, 0.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.0, 0.0])
    assert TruthfulTutor(VALUES, tie=1e-9)(Query.make("", 0, left, right)).verdict is Verdict.EQUAL


def test_a_flipping_tutor_flips_what_lies_beyond_the_tie():
    d = differences(np.random.default_rng(2), 4, 4000)
    near = np.abs(tail_sums(d) @ np.diff(VALUES)) <= 0.05
    said, sharp = (
        FlippingTutor(VALUES, 0.2, 3, tie=0.05).signs(d),
        FlippingTutor(VALUES, 0.2, 3).signs(d),
    )
    assert (said[near] == 0).all()
    assert (said[~near] == sharp[~near]).all()


def test_a_bradley_terry_tutor_ties_as_rao_and_kupper_have_it():
    precision, tie, n = 20.0, 0.04, 40_000
    for d in ([0.0, 1.0, -0.7, -0.3], [0.0, 0.0, 0.3, -0.3]):
        x = float(np.dot(d, VALUES))
        said = BradleyTerryTutor(VALUES, precision, 5, tie=tie).signs(np.tile(d, (n, 1)))
        better, worse = expit(precision * (x - tie)), expit(precision * (-x - tie))
        for code, chance in ((1, better), (-1, worse), (0, 1 - better - worse)):
            assert np.mean(said == code) == pytest.approx(
                chance, abs=4 * np.sqrt(chance * (1 - chance) / n) + 1e-9
            )


def test_without_a_tie_nothing_has_changed():
    d = differences(np.random.default_rng(3), 4, 500)
    assert (
        BradleyTerryTutor(VALUES, 9.0, 1, tie=0.0).signs(d)
        == BradleyTerryTutor(VALUES, 9.0, 1).signs(d)
    ).all()


@pytest.mark.parametrize("tie", [-0.1, 1.0, float("nan"), "x", None])
def test_a_tie_that_is_no_share_is_refused(tie):
    with pytest.raises(ValueError, match="tie, the largest"):
        TruthfulTutor(VALUES, tie=tie)
