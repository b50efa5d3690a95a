"""The reference algorithms, held to the paper, to arithmetic done by hand, and to ground truth."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qlearn.reference
from elicit import (
    AlwaysAsk,
    Answer,
    BradleyTerryComparator,
    Dominance,
    PolytopeComparator,
    Query,
    TruthfulTutor,
    Verdict,
)
from elicit._support.hashing import key_of
from qlearn import OrdinalMDP, policy_loss, random_mdp
from qlearn.reference import (
    Answered,
    draw,
    forecast,
    get_best,
    interactive_q_learning,
    interactive_value_iteration,
    pick,
)
from tests.mdp_cases import messy_mdp
from tests.scalar_q_learning import scalar_q_learning
from tests.thoroughness import quick_first, scaled


def two_state_mdp() -> OrdinalMDP:
    """Everything certain: action 0 stays, action 1 goes to the other state; levels [[1, 0], [2,
    0]]; discount 1/2.
    """
    successors = np.array([[[0], [1]], [[1], [0]]])
    return OrdinalMDP(
        successors, np.ones((2, 2, 1)), np.array([[1, 0], [2, 0]]), 0.5, ("bad", "fair", "good")
    )


def refuse(query: Query) -> Answer:
    raise AssertionError(f"nothing to ask: {query}")


@pytest.mark.parametrize(("algorithm", "lines"), [(1, 18), (2, 19)])
def test_every_line_of_the_paper_is_named(algorithm: int, lines: int) -> None:
    source = Path(qlearn.reference.__file__).read_text(encoding="utf-8")
    named: set[int] = set()
    for comment in re.findall(rf"# Alg\. {algorithm}, l\. ([\d, toand]+)", source):
        for first, last in re.findall(r"(\d+)(?: to (\d+))?", comment):
            named.update(range(int(first), int(last or first) + 1))
    structure = {1: {3, 8, 10, 16}, 2: {3, 8, 10, 16}}[algorithm]  # else, or no action of their own
    assert named | structure >= set(range(1, lines + 1))


def test_one_step_by_hand() -> None:
    # Alg. 1, l. 9 and 10 from the worst level, rate 1/4: Q = 3/4 (1, 0, 0) + 1/4 (1/2 (0, 1, 0) +
    # 1/2 (1, 0, 0))
    mdp = two_state_mdp()
    for key in map(key_of, range(10)):
        learned, _, told = interactive_q_learning(
            mdp, Dominance(3), refuse, steps=1, epsilon=1.0, rates=[0.25], key=key
        )
        moved = np.argwhere((learned.q != [1.0, 0.0, 0.0]).any(axis=2))
        for s, a in moved:  # a step at the worst level changes nothing
            level = mdp.levels[s, a]
            expected = np.array([0.875, 0.0, 0.0])
            expected[level] += 0.125
            assert learned.q[s, a].tolist() == expected.tolist()
            assert learned.best[s] == a  # it dominates whatever was best
        assert len(moved) <= 1
        assert not told.answers


def test_zero_start_is_line_4_of_the_paper() -> None:
    mdp = two_state_mdp()
    learned, _, _ = interactive_q_learning(
        mdp, Dominance(3), refuse, steps=1, epsilon=1.0, rates=[1.0], key=3, start="zero"
    )
    assert sorted(learned.q.sum(axis=2).ravel().tolist()) == [0.0, 0.0, 0.0, 0.5]


@pytest.mark.parametrize("start", ["worst", "zero"])
def test_long_runs_reach_the_known_optimum(start: str) -> None:
    # staying in state 1 for ever is worth (0, 0, 1); state 0 does best to go there: (1/2, 0, 1/2)
    mdp = two_state_mdp()
    how: dict[str, Any] = {
        "steps": 400,
        "epsilon": 0.5,
        "rates": np.full(400, 0.5),
        "key": 1,
        "start": start,
    }
    learned, _, _ = interactive_q_learning(
        mdp, PolytopeComparator(3), TruthfulTutor([0, 4, 10]), **how
    )
    assert learned.best == [1, 0]
    best = learned.q[[0, 1], learned.best]
    np.testing.assert_allclose(best[:, 1:], [[0.0, 0.5], [0.0, 1.0]], atol=1e-6)


def test_get_best_asks_only_when_unsure_and_remembers() -> None:
    asked: list[Query] = []

    def tutor(query: Query) -> Answer:
        asked.append(query)
        return TruthfulTutor([0, 1, 10])(query)

    better, worse = np.array([0.5, 0.0, 0.5]), np.array([0.0, 1.0, 0.0])
    model, told = PolytopeComparator(3), Answered()
    winner, model, told = get_best(better, 7, worse, 4, model, told, tutor)
    assert (winner, len(asked), len(told.answers)) == (7, 1, 1)
    winner, model, told = get_best(worse, 4, better, 7, model, told, tutor)  # now M is confident
    assert (winner, len(asked)) == (7, 1)
    winner, model, told = get_best(
        better, 7, better, 4, model, told, tutor
    )  # a tie: the best so far stays
    assert (winner, len(asked)) == (4, 1)
    assert asked[0].left.tolist() == better.tolist()
    assert asked[0].right.tolist() == worse.tolist()


@pytest.mark.parametrize("verdict", [Verdict.EQUAL, None])
def test_get_best_after_a_tie_or_no_answer(verdict: Verdict | None) -> None:
    left, right = np.array([0.5, 0.0, 0.5]), np.array([0.0, 1.0, 0.0])
    model: Any = BradleyTerryComparator(3, n_boot=10)
    told = Answered()
    winner, model, told = get_best(
        left, 1, right, 0, model, told, lambda query: Answer(query, verdict)
    )
    assert winner == 0
    for a, b in ((left, right), (right, left)):
        assert forecast(a - b, model, told, 0.0) is Verdict.EQUAL
        assert get_best(a, 1, b, 0, model, told, refuse)[0] == 0


def test_indifference_makes_close_pairs_equal() -> None:
    left, right = np.array([0.5, 0.0, 0.5]), np.array([0.0, 1.0, 0.0])
    assert forecast(left - right, Dominance(3), Answered(), 0.49) is Verdict.UNKNOWN
    assert forecast(left - right, Dominance(3), Answered(), 0.5) is Verdict.EQUAL
    assert forecast(left - right, AlwaysAsk(3), Answered(), 0.5) is Verdict.UNKNOWN


def test_draws_have_the_stated_distribution() -> None:
    weights = np.array([0.0, 0.5, 0.2, 0.0, 0.3, 0.0])
    counts = np.bincount([draw(weights, 5, i) for i in range(4000)], minlength=6)
    assert counts[weights == 0].sum() == 0
    np.testing.assert_allclose(counts / 4000, weights, atol=0.03)
    picks = np.bincount([pick([1, 3], 5, i) for i in range(2000)], minlength=4)
    assert picks[[0, 2]].sum() == 0
    np.testing.assert_allclose(picks[[1, 3]], 1000, atol=100)


@pytest.mark.parametrize("seed", quick_first(range(5), 2))
@pytest.mark.parametrize(
    ("episode_length", "start"), [(None, "worst"), (6, "worst"), (None, "best")]
)
def test_vectors_and_scalars_tell_the_same_story(
    seed: int, episode_length: int | None, start: str
) -> None:
    # proposition 1 all along a run: always asking a truthful tutor is ordinary Q-learning on the
    # true values
    for mdp, values in (random_mdp(8, 3, 4, rng=seed), messy_mdp(seed)):
        settings: dict[str, Any] = {
            "steps": 300,
            "epsilon": 0.3,
            "rates": np.full(300, 0.3),
            "key": key_of(seed),
        }
        settings |= {"episode_length": episode_length, "start": start}
        scalar = scalar_q_learning(mdp, values, **settings)
        vector, _, told = interactive_q_learning(
            mdp, AlwaysAsk(mdp.k), TruthfulTutor(values), **settings
        )
        assert vector.comparisons == scalar.comparisons
        assert vector.best == scalar.best
        assert 0 < len(told.answers) <= len(scalar.comparisons)
        np.testing.assert_allclose(vector.q @ mdp.normalise(values), scalar.q, atol=1e-13)


@pytest.mark.parametrize("discount", [0.0, 0.5, 0.9])
def test_reference_value_iteration_finds_an_optimal_policy(discount: float) -> None:
    for seed in range(scaled(2, 4)):
        mdp, values = messy_mdp(seed, discount=discount)
        (learned, _, told), (everything, _, all_told) = (
            interactive_value_iteration(mdp, comparator, TruthfulTutor(values), tolerance=0.001)
            for comparator in (PolytopeComparator(mdp.k), AlwaysAsk(mdp.k))
        )
        assert policy_loss(mdp, learned.best, values).max() <= 0.001
        assert everything.best == learned.best
        assert len(told.answers) <= len(all_told.answers)
