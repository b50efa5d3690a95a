"""States of ICU-Sepsis in words say what the benchmark's tables say."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from qlearn.cli.conclusions import icu
from qlearn.problems.icu_sepsis import icu_sepsis

_SOFA = 31  # place of the score, in the order of the AI Clinician's code


def test_states_are_described_by_the_tables_of_the_benchmark() -> None:
    spec = find_spec("icu_sepsis")
    assert spec is not None
    assert spec.submodule_search_locations
    path = Path(spec.submodule_search_locations[0]) / "envs" / "assets" / "dynamics.npz"
    with np.load(path, allow_pickle=False) as data:
        centres, sofa = data["state_cluster_centers"][:713], data["sofa_scores"][:713]
        start = data["d_0"][:713]
    like = np.corrcoef(centres.T, sofa)[-1, :-1]
    assert like[_SOFA] > 0.99  # so the order is that one
    assert np.delete(like, _SOFA).max() < 0.6
    recorded = icu._recorded()
    ventilated, die = recorded.ventilated, recorded.die
    assert np.ptp(centres[:, 1]) == 1  # some are all ventilated, and some not at all
    assert (ventilated.min(), ventilated.max()) == (0, 1)
    assert (die > 0).all()
    assert (die < 1).all()
    assert recorded.from_the_start == pytest.approx(float(start @ die))
    # the benchmark's authors: 0.78 survive, with the doctors' treatment and at random
    assert round(recorded.from_the_start, 2) == round(recorded.at_random, 2) == 0.22
    assert "218 of 1,000 die if treated as recorded, and 220 with doses drawn" in icu.icu_caveat()
    mdp = icu_sepsis()
    words = icu.icu_states(mdp)
    assert words(mdp.state_name(12)) == (
        "critical, mean SOFA score 11.0, 47% ventilated, 24% die (state 12)"
    )
    assert words("died") == "died"
