"""The families are well-formed, reproducible, and what their descriptions say."""

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import qlearn
from qlearn import OrdinalMDP, equal_gaps_policy, hidden_scales, unasked_loss
from qlearn.problems import FAMILIES
from qlearn.problems.families.words import WORDS
from qlearn.problems.hidden_scales import KINDS
from tests import older_processor
from tests.interpreter import run
from tests.scale_arithmetic import Floats
from tests.thoroughness import examples, scaled

LEAST = {
    "rover": 4,
    "hazards": 4,
    "side-effects": 6,
    "surgery": 6,
    "care": 6,
    "career": 4,
    "plant": 3,
    "fishery": 10,
    "reservoir": 8,
}
SIZED = [(FAMILIES[name], least) for name, least in LEAST.items()]
named = pytest.mark.parametrize("name", FAMILIES)
each = pytest.mark.parametrize(("make", "least"), SIZED, ids=LEAST)


def table_of(mdp: OrdinalMDP) -> Floats:
    """Transitions (S, A, S)."""
    return np.asarray(mdp.transitions.toarray()).reshape(mdp.n_states, mdp.n_actions, mdp.n_states)


def states(mdp: OrdinalMDP, pattern: str) -> list[int]:
    """The states whose name has the pattern."""
    assert mdp.state_names is not None
    found = [s for s, name in enumerate(mdp.state_names) if re.search(pattern, name)]
    assert found
    return found


@named
def test_a_family_has_names_levels_and_starts(name: str) -> None:
    mdp = FAMILIES[name](0)
    assert mdp.state_names is not None
    assert mdp.action_names is not None
    assert 4 <= mdp.k <= 6
    used = mdp.levels[~mdp.terminal].ravel().tolist() + mdp.final_level[mdp.terminal].tolist()
    assert set(used) == set(range(mdp.k))  # no level is there in name only
    assert mdp.admissible.all()
    assert 30 < mdp.n_states < 400


def test_every_family_has_words_for_a_person() -> None:
    assert {*WORDS} == {*FAMILIES}
    for words in WORDS.values():
        assert words.title
        assert words.unit in words.preamble
        assert "right or wrong" not in words.preamble  # the welcome says that there is none


def test_the_mapping_is_found_from_the_package_and_makes_the_default_size() -> None:
    assert qlearn.problems.FAMILIES is FAMILIES
    assert list(FAMILIES) == list(LEAST)
    for make, least in SIZED:
        assert make(3).n_states > make(3, size=least).n_states


def test_the_catalogue_alone_imports_no_arrays() -> None:
    """The command line can list the names at once for this reason."""
    code = (
        "import sys; from qlearn.problems import FAMILIES; "
        "print(len(FAMILIES) > 7, [name for name in ('numpy', 'scipy') if name in sys.modules])"
    )
    assert run(code) == ["True []"]


@each
@examples(15)
@given(seed=st.integers(0, 2**64), more=st.integers(0, 6))
def test_rows_are_distributions_at_every_size_and_seed(
    make: Any, least: int, seed: int, more: int
) -> None:
    mdp = make(seed=seed, size=least + more)
    np.testing.assert_allclose(mdp.probabilities.sum(axis=2), 1, rtol=0, atol=1e-12)
    assert (mdp.probabilities >= 0).all()
    np.testing.assert_allclose(mdp.initial.sum(), 1, rtol=0, atol=1e-12)
    assert not mdp.initial[mdp.terminal].any()
    policy = equal_gaps_policy(mdp)
    for kind in KINDS:
        loss = unasked_loss(mdp, hidden_scales(kind, mdp.k, seed=seed % 1000), policy)
        assert 1 >= loss.worst >= loss.initial >= 0
        assert kind != "equal" or loss.worst < 1e-7


@each
def test_every_state_can_matter_to_somebody(make: Any, least: int) -> None:
    """Each state that is no start can be reached from one, or is worse off than all that can be."""
    mdp = make(seed=1, size=least + 4)
    reached = mdp.initial > 0
    steps = table_of(mdp).max(axis=1) > 0
    for _ in range(mdp.n_states):
        reached = reached | steps[reached].any(axis=0)
    assert reached.mean() > 0.6


@each
def test_the_seed_decides(make: Any, least: int) -> None:
    prints = {make(seed=seed).fingerprint for seed in range(5)}
    assert len(prints) == 5
    assert make(seed=2).fingerprint in prints
    assert make(seed=np.random.SeedSequence(2)).fingerprint == make(seed=2).fingerprint
    assert make().fingerprint != make().fingerprint
    with pytest.raises(TypeError, match="seed"):
        make(seed=-1)


def made(seeds: int) -> str:
    """Fingerprints, and policies of equal gaps, of so many seeds of each family."""
    mdps = [make(seed) for make in FAMILIES.values() for seed in range(seeds)]
    return str([(mdp.fingerprint, equal_gaps_policy(mdp).tolist()) for mdp in mdps])


def test_an_older_processor_makes_the_same_and_acts_the_same() -> None:
    seeds = scaled(1, 2)
    code = f"from tests.qlearn.problems.families.test_families import made; print(made({seeds}))"
    assert run(code, **older_processor.environment()) == [made(seeds)]


@each
def test_sizes_that_cannot_be_are_refused(make: Any, least: int) -> None:
    assert make(seed=0, size=least).n_states < make(seed=0, size=least + 2).n_states
    for size in (least - 1, 0, least + 0.5, "10", None, True):
        with pytest.raises(
            ValueError, match=rf"size must be .* a whole number of at least {least}, not"
        ):
            make(seed=0, size=size)


def test_only_the_plain_is_safe_for_a_rover_and_scree_is_worst() -> None:
    mdp = FAMILIES["rover"](seed=4)
    lost = table_of(mdp)[:, :, states(mdp, "trapped")[0]]
    risks = [lost[states(mdp, soil)] for soil in ("plain", "sand", "rock", "scree")]
    assert (risks[0] == 0).all()
    assert all(low.max() < high.min() for low, high in pairwise(risks))
    assert mdp.initial[states(mdp, "plain")].sum() == pytest.approx(1)
    assert [len(risk) for risk in risks] == [69, 49, 39, 39]


def test_only_a_bog_drowns_and_home_is_for_ever() -> None:
    mdp = FAMILIES["hazards"](seed=5)
    moves, (drowned,) = table_of(mdp), states(mdp, "drowned")
    bogs = states(mdp, "bog")
    near = moves[:, :, bogs].sum(axis=2)
    live = ~mdp.terminal
    np.testing.assert_allclose(moves[live][:, :, drowned], near[live] * 0.3 / 0.7, atol=1e-12)
    assert (moves[states(mdp, "path"), 4, states(mdp, "path")] == 1).all()  # waiting there is safe
    assert mdp.final_level[states(mdp, "home")] == [3]


def test_what_is_broken_stays_broken() -> None:
    mdp = FAMILIES["side-effects"](seed=6)
    n = mdp.n_states // 3
    damage = np.arange(mdp.n_states) // n
    source, _, target = np.nonzero(table_of(mdp))
    assert (damage[target] >= damage[source]).all()
    assert (damage[target] - damage[source] <= 1).all()
    assert (damage[target] > damage[source]).any()
    assert (mdp.levels[:, 0] % 3 == 2 - damage).all()
    assert (mdp.terminal == (mdp.levels[:, 0] >= 3)).all()


def test_an_operation_ends_it_and_drugs_slow_it_down() -> None:
    mdp = FAMILIES["surgery"](seed=7)
    moves, dead, cured = table_of(mdp), *states(mdp, "dead"), *states(mdp, "cured")
    live = ~mdp.terminal
    np.testing.assert_allclose(moves[live, 2][:, [dead, cured]].sum(axis=1), 1, atol=1e-12)
    stays = moves[np.arange(mdp.n_states), :, np.arange(mdp.n_states)]
    inner = [s for s in states(mdp, "stage") if "stage 30 " not in mdp.state_name(s)]
    assert (stays[inner, 1] > stays[inner, 0]).all()
    assert (mdp.levels[live, 1] <= mdp.levels[live, 0]).all()
    risk = moves[live, 2, dead].reshape(4, 30)
    assert (np.diff(risk, axis=0) >= 0).all()
    assert (np.diff(risk, axis=1) >= 0).all()


def test_aggressive_treatment_cures_the_young_and_harms_the_frail() -> None:
    mdp = FAMILIES["care"](seed=8)
    moves, died, cured = table_of(mdp), *states(mdp, "died"), *states(mdp, "cured")
    young = states(mdp, "stage 1 of")
    assert (moves[young, 2, cured] > moves[young, 1, cured]).all()
    assert not moves[~mdp.terminal, 0, cured].any()
    assert (np.diff(moves[young, 2, died]) > 0).all()  # robust, average, frail
    assert (mdp.levels[~mdp.terminal, 2] == 1).all()


def test_a_career_ends_in_one_of_three_ways() -> None:
    mdp = FAMILIES["career"](seed=9)
    moves = table_of(mdp)
    np.testing.assert_array_equal(mdp.final_level[mdp.terminal], [0, 2, 3])
    assert (moves[:40, 0, states(mdp, "steady")] == 1).all()
    offers = [float(re.findall(r"of (\d+)%", mdp.state_name(s))[0]) / 100 for s in range(40)]
    famous = moves[:40, 1, states(mdp, "famous")[0]]
    ruined = moves[:40, 1, states(mdp, "ruined")[0]]
    np.testing.assert_allclose(famous / (famous + ruined), offers, atol=0.005)


def test_a_plant_that_is_off_is_safe_and_half_load_a_third_as_dangerous() -> None:
    mdp = FAMILIES["plant"](seed=10)
    outage = table_of(mdp)[:12, :, states(mdp, "day 1 of")[0]]
    assert not outage[:, 2].any()
    np.testing.assert_allclose(outage[:, 0], 3 * outage[:, 1], atol=1e-12)
    assert (outage[:, 0] > 0).all()
    assert not mdp.terminal.any()


def test_fish_below_the_threshold_do_not_recover_and_quotas_cost_stock() -> None:
    for seed in range(3):
        mdp = FAMILIES["fishery"](seed=seed)
        stock = np.linspace(0, 1, mdp.n_states)
        following = table_of(mdp) @ stock
        assert (np.diff(following, axis=1) <= 1e-12).all()
        threshold = stock[mdp.initial > 0][0]
        assert 0.15 < threshold < 0.35
        below = (stock < threshold) & (stock > 0)
        assert (following[below, 0] < stock[below] + 1e-12).all()
        middling = (stock > threshold + 0.05) & (stock < 0.7)
        assert (following[middling, 0] > stock[middling]).all()


def test_water_let_out_lowers_the_flood_and_a_repair_takes_two_years() -> None:
    mdp = FAMILIES["reservoir"](seed=2)
    flood = states(mdp, "season 1 of the repair")[0]
    chance = table_of(mdp)[:80, :, flood]
    assert (np.diff(chance, axis=1) <= 1e-12).all()
    assert chance.max() > 0
    assert (mdp.levels[flood:] == 0).all()
    assert mdp.n_states - flood == 8


def test_asking_matters_in_most_families() -> None:
    """On seeds that the page of results does not have."""
    seeds = range(1000, 1000 + scaled(2, 40))
    means = []
    for make in FAMILIES.values():
        drawn = []
        for seed in seeds:
            mdp = make(seed)
            drawn.append(unasked_loss(mdp, hidden_scales("even", mdp.k, seed=seed)))
        means.append(np.mean(drawn, axis=0))
    worst, initial = np.array(means).T
    assert np.count_nonzero(worst >= 0.05) >= 6
    assert np.count_nonzero(initial >= 0.03) >= 3
