"""The report on training by few questions says what its runs say."""

import numpy as np
import pytest

from benchmarks.training import training_questions as report
from qlearn import Status


def run(loss, bound, short=0.0):
    return report.Run(7, 3, loss, bound, Status.CONVERGED, 0.01, 0.2, short)


def test_a_row_counts_bounds_that_were_given_and_kept():
    row = dict(
        zip(
            report.HEAD,
            report.line("it", [run(0.005, 0.01), run(0.02, 0.01), run(0.1, np.nan)]),
            strict=True,
        )
    )
    assert row["bound kept"] == "50.0% of 2"
    assert row["worst"] == "10.00"
    assert row["asked nothing"] == "20.0, 20.0"
    assert row["ends"] == "converged"


def test_a_broken_bound_is_told_from_one_whose_gap_did_not_hold():
    *_, finite, kept, lost = report.broken(
        0.3, [run(0.1, 0.2), run(0.3, 0.2), run(0.3, 0.2, 0.4), run(0.1, np.nan)]
    )
    assert (finite, kept, lost) == ("3", "1 (0)", "1 (1)")


def test_a_black_box_is_measured():
    found = report.black_box(lambda seed: report.random_mdp(10, 3, 4, rng=seed), 0)
    assert -1e-9 <= found.loss <= found.bound <= 0.01 + 1e-8
    assert found.short == pytest.approx(0.0, abs=1e-9)
    assert found.equal >= -1e-9
