"""OrdinalMDP: what it stores, what it computes, and what it refuses."""

import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import numpy as np
import pytest

from qlearn import OrdinalMDP
from qlearn.mdp import array_checks
from tests.interpreter import run

LABELS = ("bad", "fair", "good")


def parts(**changed: Any) -> dict[str, Any]:
    """Three states, two actions; state 2 is terminal, action 1 is inadmissible in state 1."""
    given: dict[str, Any] = {
        "successors": [[[0, 1], [1, 2]], [[0, 2], [0, 0]], [[2, 2], [2, 2]]],
        "probabilities": [[[0.5, 0.5], [0.25, 0.75]], [[1, 0], [1, 0]], [[1, 0], [1, 0]]],
        "levels": [[0, 1], [1, 0], [2, 2]],
        "discount": 0.9,
        "labels": LABELS,
        "terminal": [False, False, True],
        "admissible": [[True, True], [True, False], [True, True]],
    }
    return given | changed


def small(**changed: Any) -> OrdinalMDP:
    return OrdinalMDP(**parts(**changed))


def test_stores_what_it_is_given() -> None:
    mdp = small()
    assert (mdp.n_states, mdp.n_actions, mdp.k) == (3, 2, 3)
    assert mdp.successors.dtype == mdp.levels.dtype == np.int32
    assert mdp.labels == LABELS == small(labels=np.array(LABELS)).labels
    assert {type(label) for label in small(labels=np.array(LABELS)).labels} == {str}
    np.testing.assert_array_equal(mdp.probabilities[0], [[0.5, 0.5], [0.25, 0.75]])
    np.testing.assert_array_equal(mdp.final_level, [-1, -1, 2])
    np.testing.assert_allclose(
        mdp.initial, [0.5, 0.5, 0]
    )  # uniform over the states that are not terminal
    plain = small(terminal=None, admissible=None)
    np.testing.assert_allclose(plain.initial, np.full(3, 1 / 3))
    assert not plain.terminal.any()
    assert plain.admissible.all()


def test_transitions_are_the_table_by_hand() -> None:
    expected = np.array(
        [[0.5, 0.5, 0], [0, 0.25, 0.75], [1, 0, 0], [0, 0, 0], [0, 0, 1], [0, 0, 1]]
    )
    np.testing.assert_array_equal(small().transitions.toarray(), expected)


def test_rows_never_read_need_nothing_valid() -> None:
    successors: Any = np.array(parts()["successors"], dtype=float)
    probabilities: Any = np.array(parts()["probabilities"], dtype=float)
    successors[1, 1], probabilities[1, 1] = 99, np.nan
    successors[2], probabilities[2] = np.nan, -5
    junk = small(successors=successors, probabilities=probabilities)
    assert junk.fingerprint == small().fingerprint
    np.testing.assert_array_equal(junk.successors[2], np.full((2, 2), 2))
    np.testing.assert_array_equal(junk.probabilities[2], [[1, 0], [1, 0]])
    np.testing.assert_array_equal(junk.probabilities[1, 1], [0, 0])


def test_padding_repeats_the_last_real_successor() -> None:
    successors = parts()["successors"]
    successors[1][0] = [0, -1]
    mdp = small(successors=successors)
    np.testing.assert_array_equal(mdp.successors[1, 0], [0, 0])
    rows, p = [[[1, 0, 7, 7]], [[0, 0, 0, 0]]], [[[0.5, 0.5, 0, 0]], [[1, 0, 0, 0]]]
    trailing = OrdinalMDP(np.array(rows), np.array(p), np.array([[0], [1]]), 0.5, ("a", "b"))
    np.testing.assert_array_equal(trailing.successors[0, 0], [1, 0, 0, 0])


def test_vector_rewards_are_one_hot_and_agree_with_rewards() -> None:
    mdp, values = small(), np.array([-3.0, 10, 40])
    one_hot = mdp.vector_rewards()
    assert one_hot.shape == (3, 2, 3)
    np.testing.assert_array_equal(one_hot.sum(axis=2), np.ones((3, 2)))
    np.testing.assert_array_equal(one_hot @ values, [[-3, 10], [10, -3], [40, 40]])
    np.testing.assert_array_equal(mdp.rewards(values), one_hot @ values)
    for bad, message in (([0, 1], "3 numbers, one a level, not 2"), ([0, 0, 1], "must increase")):
        with pytest.raises(ValueError, match=message):
            mdp.rewards(bad)


def test_arrays_are_copies_and_read_only() -> None:
    levels = np.array(parts()["levels"])
    mdp = small(levels=levels)
    levels[0, 0] = 2
    assert mdp.levels[0, 0] == 0
    for name in (
        "successors",
        "probabilities",
        "levels",
        "initial",
        "terminal",
        "admissible",
        "final_level",
    ):
        with pytest.raises(ValueError, match="read-only"):
            getattr(mdp, name)[...] = 0
    with pytest.raises(ValueError, match="read-only"):
        mdp.transitions.data[0] = 0
    with pytest.raises(FrozenInstanceError):
        mdp.discount = 0.5  # type: ignore[misc]


def test_frozen_arrays_are_shared_and_never_written_to() -> None:
    mdp = small()
    other = replace(mdp, discount=0.5)
    for name in ("successors", "probabilities", "levels", "terminal", "admissible", "initial"):
        assert getattr(other, name) is getattr(mdp, name)
    rows = np.array([[[0.5, 0.5 + 1e-10]], [[1.0, 0.0]]])
    where = np.array([[[0, 1]], [[1, 0]]], dtype=np.int32)
    rows.flags.writeable = where.flags.writeable = False
    before = rows.tobytes(), where.tobytes()
    scaled = OrdinalMDP(where, rows, np.array([[0], [1]]), 0.9, ("a", "b"))
    assert (rows.tobytes(), where.tobytes()) == before
    assert scaled.successors[1, 0].tolist() == [1, 1]
    view = np.array(parts()["probabilities"], dtype=float)
    view.reshape(-1).flags.writeable = False
    mine = small(probabilities=view)
    view[...] = 7
    assert mine.probabilities.max() == 1


def test_transitions_share_the_arrays_where_no_row_is_padded() -> None:
    rng = np.random.default_rng(0)
    p, to = (
        rng.dirichlet(np.ones(2), size=(4, 3)),
        np.sort(rng.permuted(np.tile(np.arange(4), (12, 1)), axis=1)[:, :2]),
    )
    mdp = OrdinalMDP(to.reshape(4, 3, 2), p, rng.integers(2, size=(4, 3)), 0.9, ("a", "b"))
    assert np.shares_memory(mdp.transitions.data, mdp.probabilities)
    assert np.shares_memory(mdp.transitions.indices, mdp.successors)
    doubled = OrdinalMDP(np.zeros((1, 1, 2)), [[[0.5, 0.5]]], [[0]], 0.9, ("a", "b"))
    assert doubled.transitions.toarray() == [[1.0]]  # what appears twice adds
    assert doubled.transitions.has_canonical_format
    assert doubled.probabilities.tolist() == [[[0.5, 0.5]]]


def test_checks_go_by_blocks_and_still_name_the_place(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    p, to = rng.dirichlet(np.ones(3), size=(7, 2)), rng.integers(7, size=(7, 2, 3))
    p[4, 1] = [1.0, 0.0, 0.0]
    levels, ends = rng.integers(3, size=(7, 2)), np.arange(7) == 5
    levels[5] = 1
    whole = OrdinalMDP(to, p, levels, 0.9, LABELS, terminal=ends)
    monkeypatch.setattr(array_checks, "BLOCK", 12)
    assert OrdinalMDP(to, p, levels, 0.9, LABELS, terminal=ends).fingerprint == whole.fingerprint
    assert (
        OrdinalMDP(to.astype(float), p, levels, 0.9, LABELS, terminal=ends).fingerprint
        == whole.fingerprint
    )
    at = np.arange(42).reshape(7, 2, 3)
    for where, chances, message in (
        (to, np.where(at == 39, -1, p), r"probabilities\[6, 1, 0\] is -1"),
        (np.where(at == 39, 7, to), p, r"successors\[6, 1, 0\] is 7, but must be a state"),
        (to, np.where(at >= 39, 0, p), r"probabilities\[6, 1\] sums to 0"),
    ):
        with pytest.raises(ValueError, match=message):
            OrdinalMDP(where, chances, levels, 0.9, LABELS)


def test_rounding_of_rows() -> None:
    kept = [[0.5, 0.5 + 1e-14], [0.25, 0.75]]
    scaled = [[0.5, 0.5 + 1e-10], [0.25, 0.75]]
    tail = parts()["probabilities"][1:]
    np.testing.assert_array_equal(small(probabilities=[kept, *tail]).probabilities[0], kept)
    once = small(probabilities=[scaled, *tail])
    assert abs(once.probabilities[0, 0].sum() - 1) < 1e-15
    assert replace(once).fingerprint == once.fingerprint  # scaling is done once, not at every copy


@pytest.mark.parametrize(
    "changed",
    [
        {"levels": [[1, 1], [1, 0], [2, 2]]},
        {"labels": ("bad", "fair", "best")},
        {"discount": 0.91},
        {"initial": [1, 0, 0]},
        {"terminal": None},
        {"admissible": None},
        {"probabilities": [[[0.4, 0.6], [0.25, 0.75]], [[1, 0], [1, 0]], [[1, 0], [1, 0]]]},
        {"successors": [[[0, 2], [1, 2]], [[0, 2], [0, 0]], [[2, 2], [2, 2]]]},
    ],
)
def test_fingerprint_sees_every_field(changed: dict[str, Any]) -> None:
    assert small(**changed).fingerprint != small().fingerprint


def test_fingerprint_is_stable_across_processes() -> None:
    code = (
        "import numpy as np; from qlearn import OrdinalMDP; "
        "print(OrdinalMDP.from_dense(np.eye(2)[:, None], [[0], [1]], 0.5, ('a', 'b')).fingerprint)"
    )
    (out,) = run(code)
    assert out == OrdinalMDP.from_dense(np.eye(2)[:, None], [[0], [1]], 0.5, ("a", "b")).fingerprint
    assert len(out) == 32


def test_pickle_keeps_it_read_only() -> None:
    mdp = small()
    again = pickle.loads(pickle.dumps(mdp))
    assert again.fingerprint == mdp.fingerprint
    assert not again.levels.flags.writeable


def test_repr_is_short() -> None:
    text = repr(small())
    assert "3 states, 2 actions, 3 levels: bad < fair < good, discount 0.9, 1 terminal" in text
    many = OrdinalMDP.from_dense(np.ones((1, 1, 1)), [[0]], 0.5, [f"l{i}" for i in range(30)])
    assert "l0 < l1 < l2 < ... < l29" in repr(many)
    assert len(repr(many)) < 200


P = parts()["probabilities"]


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"probabilities": [[1.0]]}, ValueError, r"shape \(S, A, b\).*from_dense"),
        ({"probabilities": np.zeros((0, 2, 2))}, ValueError, r"\(0, 2, 2\)"),
        (
            {"probabilities": [[[0.6, 0.5], [0.25, 0.75]], *P[1:]]},
            ValueError,
            r"probabilities\[0, 0\] sums to 1.1",
        ),
        (
            {"probabilities": [[[0.5, 0.5], [0.25, 0.7499]], *P[1:]]},
            ValueError,
            r"probabilities\[0, 1\] sums to",
        ),
        (
            {"probabilities": [[[0.5, 0.5], [-0.25, 1.25]], *P[1:]]},
            ValueError,
            r"\[0, 1, 0\] is -0.25.*negative",
        ),
        (
            {"probabilities": [[[0.5, np.nan], [0.25, 0.75]], *P[1:]]},
            ValueError,
            r"\[0, 0, 1\] is nan.*finite",
        ),
        (
            {
                "probabilities": [[[0.5, 0.5], [-0.25, 1.25]], *P[1:]],
                "state_names": ("home", "out", "end"),
                "action_names": ("stay", "go"),
            },
            ValueError,
            r"\(state 0, 'home', action 1, 'go', next state 1\)$",
        ),
        (
            {"probabilities": [[[0.6, 0.5], [0.25, 0.75]], *P[1:]]},
            ValueError,
            r"percent \(state 0, action 0\)$",
        ),
        (
            {"levels": [[0, 1], [0, 9], [2, 2]], "state_names": ("home", "out", "end")},
            ValueError,
            r"levels\[1, 1\] is 9.*\(state 1, 'out', action 1\)$",
        ),
        (
            {"admissible": [[1, 1], [0, 0], [1, 1]], "state_names": ("home", "out", "end")},
            ValueError,
            "state 1, 'out' has no admissible action",
        ),
        ({"labels": ("a", "b\x1b[31m", "c")}, ValueError, r"control character '\\x1b': leave it"),
        ({"state_names": ("a", "b\n", "c")}, ValueError, "state_names are shown to people"),
        ({"probabilities": "many"}, TypeError, "probabilities must be an array of numbers"),
        (
            {"successors": [[0, 1]]},
            ValueError,
            r"successors must have shape \(3, 2, 2\), not \(1, 2\)",
        ),
        (
            {"successors": np.full((3, 2, 2), 3)},
            ValueError,
            r"successors\[0, 0, 0\] is 3, but must be a state in 0..2",
        ),
        ({"successors": np.full((3, 2, 2), -1)}, ValueError, r"successors\[0, 0, 0\] is -1"),
        (
            {"successors": np.full((3, 2, 2), 0.5)},
            ValueError,
            r"successors\[0, 0, 0\] is 0.5.*whole",
        ),
        ({"successors": np.full((3, 2, 2), 2.0**40)}, ValueError, "whole number of at most"),
        (
            {"levels": [0, 1, 2]},
            ValueError,
            r"levels must have shape \(3, 2\), not \(3,\): .* "
            r"np.repeat\(np.c_\[levels\], 2, axis=1\)",
        ),
        (
            {"levels": [[0, 1], [1, 0], [3, 3]]},
            ValueError,
            r"levels\[2, 0\] is 3, but must be in 0..2, because 3 levels have labels",
        ),
        (
            {"levels": [["low", "high"]] * 3},
            TypeError,
            r"levels must be an array of numbers.*0 for the worst: labels.index\(name\) is",
        ),
        ({"levels": [[0, np.nan], [1, 0], [2, 2]]}, ValueError, r"levels\[0, 1\] is nan"),
        ({"levels": [[0, 1], [1, 0], [2, 1]]}, ValueError, r"terminal state 2 has levels \[2, 1\]"),
        ({"discount": 1.0}, ValueError, r"discount must be a number in \[0, 1\), not 1.0"),
        ({"discount": "a"}, ValueError, r"discount must be a number in \[0, 1\), not 'a'"),
        ({"discount": -0.1}, ValueError, "not -0.1"),
        ({"labels": ("only",)}, ValueError, "at least 2 levels"),
        ({"labels": ("a", "b", "a")}, ValueError, "'a' appears twice"),
        ({"labels": "abc"}, TypeError, "sequence of strings"),
        ({"labels": (1, 2, 3)}, TypeError, "sequence of strings"),
        (
            {"labels": None},
            TypeError,
            "labels must be a sequence of strings, worst level first, not None",
        ),
        (
            {"state_names": ("a", "b")},
            ValueError,
            "state_names must be 3 names, one each, but there are 2",
        ),
        (
            {"state_names": "abc"},
            TypeError,
            "state_names must be None or a sequence of strings, not 'abc'",
        ),
        (
            {"action_names": ("go", "go")},
            ValueError,
            "action_names must differ, but 'go' appears twice",
        ),
        ({"action_names": (0, 1)}, TypeError, "action_names must be None or a sequence of strings"),
        (
            {"action_names": 2},
            TypeError,
            "action_names must be None or a sequence of strings, not 2",
        ),
        ({"initial": [0.5, 0.6, 0]}, ValueError, "initial sums to 1.1"),
        ({"initial": [-0.5, 1.5, 0]}, ValueError, r"initial\[0\] is -0.5"),
        ({"initial": [0.5, 0.4, 0.1]}, ValueError, r"initial\[2\] is 0.1.*terminal"),
        (
            {"terminal": [2]},
            ValueError,
            r"terminal must have shape \(3,\), True or False for each state, not \(1,\); a list of",
        ),
        ({"terminal": [0, 1, 2]}, ValueError, r"terminal\[2\] is 2.*indices"),
        (
            {"terminal": [True] * 3, "levels": np.zeros((3, 2))},
            ValueError,
            "all 3 states are terminal",
        ),
        ({"admissible": [[1, 1], [0, 0], [1, 1]]}, ValueError, "state 1 has no admissible action"),
        ({"admissible": [True] * 3}, ValueError, r"admissible must have shape \(3, 2\)"),
    ],
)
def test_errors_name_the_place(
    changed: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        small(**changed)


def test_a_terminal_state_may_disagree_where_it_is_inadmissible() -> None:
    mdp = small(levels=[[0, 1], [1, 0], [2, 1]], admissible=[[1, 1], [1, 0], [1, 0]])
    assert mdp.final_level[2] == 2


STATES, ACTIONS = ("ward", "home", "end"), ("operate", "wait")


def test_states_and_actions_may_have_names() -> None:
    plain, named = small(), small(state_names=list(STATES), action_names=np.array(ACTIONS))
    assert (plain.state_names, plain.action_names) == (None, None)
    assert (plain.state_name(1), plain.action_name(0)) == ("1", "0")
    assert (named.state_names, named.action_names) == (STATES, ACTIONS)
    assert (named.state_name(1), named.action_name(0)) == ("home", "operate")
    assert {type(name) for name in (*named.state_names, *named.action_names)} == {str}
    assert named.fingerprint == plain.fingerprint, "they are for people"
    assert pickle.loads(pickle.dumps(named)).state_names == STATES
    assert replace(named, discount=0.5).action_names == ACTIONS


def test_names_are_kept_however_an_mdp_is_made() -> None:
    mdp = small()
    names: dict[str, Any] = {
        "state_names": STATES,
        "action_names": ACTIONS,
        "terminal": mdp.terminal,
    }
    made = [
        OrdinalMDP.from_dense(
            mdp.transitions.toarray().reshape(3, 2, 3),
            mdp.levels,
            0.9,
            LABELS,
            admissible=mdp.admissible,
            **names,
        ),
        OrdinalMDP.from_sparse(
            mdp.transitions, mdp.levels, 0.9, LABELS, admissible=mdp.admissible, **names
        ),
        OrdinalMDP.from_pairs(
            mdp.levels[mdp.admissible],
            mdp.transitions[mdp.admissible.ravel()],
            *np.nonzero(mdp.admissible),
            0.9,
            LABELS,
            **names,
        ),
    ]
    for again in made:
        assert (again.state_names, again.action_names) == (STATES, ACTIONS)
        assert np.array_equal(again.transitions.toarray(), mdp.transitions.toarray())
