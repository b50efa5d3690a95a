"""Published weights and trials of the modified Rankin scale, held to what the reports say."""

from __future__ import annotations

import numpy as np
import pytest

import elicit
from elicit import OpenOrderComparator, PolytopeComparator, Verdict
from elicit.people import rankin

K = len(rankin.LEVELS)
BOTH = pytest.mark.parametrize("better", [False, True])


def up_to(shares: tuple[float, ...], worst: int) -> float:
    """Percent of patients at Rankin 0 to ``worst``."""
    return 100 * sum(shares[K - 1 - worst :])


@BOTH
def test_the_shares_are_those_that_the_abstracts_state(better: bool) -> None:
    found = rankin.trials(better)
    stated = {  # treatment, worst Rankin level: percent with it, percent without it
        ("decompression up to 60", 3): (43, 21),
        ("decompression up to 60", 4): (75, 24),
        ("decompression up to 60", 5): (78, 29),
        ("decompression over 60", 5): (67, 30),
        ("thrombectomy", 2): (46.0, 26.5),
        ("lower blood pressure", 2): (48.0, 44.4),
        ("clot lysis in the ventricles", 3): (48, 45),
        ("clot lysis in the ventricles", 5): (82, 71),
        ("thrombolysis", 1): (39, 26),
        ("thrombolysis", 5): (83, 79),
    }
    for (name, worst), (treated, control) in stated.items():
        assert up_to(found[name].treated, worst) == pytest.approx(treated, abs=0.8)
        assert up_to(found[name].control, worst) == pytest.approx(control, abs=0.8)
    for trial in found.values():
        assert sum(trial.treated) == pytest.approx(1)
        assert sum(trial.control) == pytest.approx(1)
        assert trial.source


def test_pooled_patients_are_at_one_end_of_the_pool() -> None:
    worst, best = rankin.trials(False), rankin.trials(True)
    for name, trial in worst.items():
        same = trial.treated == best[name].treated
        assert same == (trial.pooled == "none")
        assert (np.cumsum(best[name].treated) <= np.cumsum(trial.treated) + 1e-9).all()


def test_one_set_of_weights_puts_constant_care_below_death_and_the_others_do_not() -> None:
    below = [name for name, one in rankin.WEIGHTS.items() if one.values[1] < one.values[0]]
    assert below == ["22,946 patients"]
    for weights in rankin.WEIGHTS.values():
        assert (np.diff(weights.values[1:]) > 0).all()
        assert rankin.worth(np.eye(K), weights).min() == 0.0
        assert rankin.worth(np.eye(K), weights).max() == 1.0


@BOTH
def test_what_holds_for_every_order_holds_for_the_published_weights(better: bool) -> None:
    names, shares = rankin.programmes(better)
    assert shares.sum(axis=1) == pytest.approx(1)
    known = OpenOrderComparator(K, margin=0.0)
    for i in range(len(names)):
        verdicts = known.compare(shares[i] - shares)
        for weights in rankin.WEIGHTS.values():
            apart = rankin.worth(shares[i], weights) - rankin.worth(shares, weights)
            assert (apart[verdicts == Verdict.BETTER] > 0).all()


@BOTH
@pytest.mark.parametrize("name", rankin.WEIGHTS)
def test_a_choice_puts_the_programmes_in_the_order_of_the_tutor(name: str, better: bool) -> None:
    weights = rankin.WEIGHTS[name]
    names, shares = rankin.programmes(better)
    choosing = elicit.choose(shares, OpenOrderComparator(K, margin=0.0), order=True, names=names)
    tutor = rankin.tutor_of(weights)
    while queries := choosing.ask():
        choosing.tell([tutor(query) for query in queries])
    order = np.argsort(-rankin.worth(shares, weights), kind="stable").tolist()
    assert list(choosing.result().order or ()) == order
    assert choosing.result().asked < len(names) * (len(names) - 1) / 2


def test_dominance_holds_only_while_death_is_the_worst() -> None:
    trial = rankin.trials()["decompression over 60"]
    d = np.array(trial.treated) - np.array(trial.control)
    assert PolytopeComparator(K).compare(d)[0] == Verdict.BETTER
    assert OpenOrderComparator(K).compare(d)[0] == Verdict.UNKNOWN
    worse = rankin.Weights((0.0, -0.6, 0.22, 0.54, 0.72, 0.83, 0.96), "made up")
    assert float(np.dot(d, worse.values)) < 0  # a scale that the fixed order leaves out


def test_weights_of_another_number_are_refused() -> None:
    with pytest.raises(ValueError, match="7 finite numbers"):
        rankin.tutor_of(rankin.Weights((0.0, 1.0), "made up"))


def test_odd_weights_and_shares_are_refused() -> None:
    weights, shares = rankin.WEIGHTS["utility weights"], np.eye(K)
    assert rankin.worth(shares[0], weights).shape == (1,)
    with pytest.raises(TypeError, match=r"such as WEIGHTS\['utility weights'\], not 'utility"):
        rankin.worth(shares, "utility weights")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="weights must be"):
        rankin.tutor_of([0, 1])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="7 finite numbers"):
        rankin.worth(shares, rankin.Weights((0.0, 1.0), "mine"))
    with pytest.raises(ValueError, match="7 finite numbers"):
        rankin.tutor_of(rankin.Weights((float("nan"),) * 7, "mine"))
    with pytest.raises(ValueError, match="some differ"):
        rankin.worth(shares, rankin.Weights((1.0,) * 7, "mine"))
    with pytest.raises(ValueError, match="shares"):
        rankin.worth(np.eye(3), weights)
    query = elicit.Query("q", [1, 0, 0], [0, 1, 0])
    with pytest.raises(ValueError, match="about 3 levels, but these weights are of 7"):
        rankin.tutor_of(weights)(query)
