"""Rewritten rivals have the figures that others print of them."""

import numpy as np
import pytest

import elicit
from benchmarks.contest import problems
from benchmarks.contest.harness import play
from benchmarks.contest.methods.polyhedral import Polyhedral
from benchmarks.contest.vertices import ScaleSet
from benchmarks.rivals.printed_figures import (
    DIAMONDS,
    STOP,
    compared,
    least_regret,
    on_trident,
    proven_on_trident,
)
from tests.thoroughness import scaled


@pytest.mark.slow
@pytest.mark.parametrize("p", DIAMONDS)
def test_minimax_regret_on_the_diamonds_is_as_printed(p):
    assert DIAMONDS[p] - 0.01 <= least_regret(p) <= (1 + STOP) * DIAMONDS[p]  # theirs is from below


@pytest.mark.parametrize("b", [0.1, 0.5, 1.0])
def test_minimax_regret_on_the_trident_is_as_proven(b):
    (shares, regret), (their_shares, their_regret) = on_trident(1.0, b), proven_on_trident(1.0, b)
    assert shares == pytest.approx(their_shares, abs=1e-6)
    assert regret == pytest.approx(their_regret, abs=1e-5)


def test_policy_comparisons_ask_as_many_questions_as_their_theorem_has():
    """The number is of the order of k ln(k / epsilon), with the same constant for all of them."""
    for objectives in scaled((3, 8), (3, 5, 8, 12)):
        for precision in scaled((0.01,), (0.1, 0.01, 0.001)):
            runs = [compared(objectives, precision, seed) for seed in range(scaled(2, 6))]
            asked, losses = np.mean(runs, axis=0)
            assert 0 < asked <= 1.3 * objectives * np.log(objectives / precision)
            assert losses <= precision


@pytest.mark.parametrize("answers", [0, 3, 6])
def test_the_ellipsoid_of_the_polyhedral_method_is_sonnevends(answers):
    """Around the analytic centre of m inequalities it lies within the polytope, and around the
    polytope if its axes are sqrt(m (m - 1)) times as long.
    """
    mdp = problems.problem("fishery", 1)
    values, method, scales = problems.scale(mdp.k, 1), Polyhedral(), ScaleSet(mdp.k)
    told = problems.TUTORS["truthful"]
    play(method, mdp, values, elicit.TruthfulTutor(values), told, answers, 0)
    for row in method._rows:
        scales.cut(row)
    rows, slack = method._constraints()
    scaled = rows / slack[:, None]
    m, apart = len(rows), scales.vertices - method._centre
    sizes = ((apart @ scaled.T) ** 2).sum(axis=1)
    assert (sizes >= 1 - 1e-9).all()
    assert (sizes <= m * (m - 1) * (1 + 1e-6)).all()
