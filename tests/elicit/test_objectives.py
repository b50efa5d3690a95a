"""Objectives without an order: hidden weights are the gaps of a scale."""

import numpy as np
import pytest

from elicit import (
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    Verdict,
    choose,
    objectives,
)
from tests.scale_arithmetic import tail_sums


def test_there_and_back():
    v = np.random.default_rng(0).standard_normal((7, 3))
    vectors = objectives.as_levels(v)
    assert vectors.shape == (7, 4)
    assert vectors.sum(axis=1) == pytest.approx(1.0)
    assert tail_sums(vectors) == pytest.approx(v, abs=1e-12)
    assert objectives.of_levels(vectors) == pytest.approx(v, abs=1e-12)
    assert objectives.as_levels(v[0]) == pytest.approx(vectors[0])
    weights = np.array([0.2, 0.5, 0.3])
    assert objectives.weights(objectives.values(weights)) == pytest.approx(weights)
    assert vectors @ objectives.values(weights) == pytest.approx(v @ weights)


def test_dominance_is_componentwise():
    comparator = PolytopeComparator(3)
    v, u = np.array([[0.5, 0.2], [0.5, 0.2]]), np.array([[0.4, 0.2], [0.4, 0.3]])
    d = objectives.as_levels(v) - objectives.as_levels(u)
    assert comparator.compare(d).tolist() == [Verdict.BETTER, Verdict.UNKNOWN]


@pytest.mark.parametrize("make", [PolytopeComparator, PosteriorComparator])
def test_the_best_of_a_list_by_hidden_weights(make):
    rng = np.random.default_rng(1)
    weights = np.array([0.15, 0.6, 0.25])
    v = rng.random((30, 3))
    choice = choose(objectives.as_levels(v), make(4))
    tutor = TruthfulTutor(objectives.values(weights))
    while queries := choice.ask():
        choice.tell([tutor(query) for query in queries])
    result = choice.result()
    assert (v @ weights).max() - v[result.best] @ weights <= 0.02
    assert result.asked < 25


def test_what_makes_no_sense_is_said():
    with pytest.raises(ValueError, match="objectives must be finite numbers"):
        objectives.as_levels([[1.0, np.nan]])
    with pytest.raises(ValueError, match="values must be m \\+ 1 numbers that rise"):
        objectives.weights([0.0, 0.5, 0.2])
    with pytest.raises(ValueError, match="weights must be m numbers of at least 0"):
        objectives.values([0.5, -0.1])
