"""Answers in degrees and by sliders are true of the person's values."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.people import kinds_of_question as kinds
from elicit import PolytopeComparator
from tests.thoroughness import examples


@examples(100)
@given(st.integers(0, 10**6), st.integers(3, 6), st.booleans())
def test_what_is_told_holds_for_the_persons_values(seed, k, degree):
    rng = np.random.default_rng(seed)
    values = np.concatenate([[0.0], np.sort(rng.random(k - 2)), [1.0]])
    d = rng.dirichlet(np.ones(k)) - rng.dirichlet(np.ones(k))
    said = kinds.told(d, values, degree)
    assert len(said) == (2 if degree else 1)
    assert (said.y * (said.d @ values) >= -1e-12).all()
    if degree:
        clearly = abs(d @ values) > kinds.CLEARLY
        assert (said.y[0] == said.y[1]) == clearly


@examples(100)
@given(st.integers(0, 10**6), st.sampled_from(kinds.IMPRECISION))
def test_a_sliders_range_holds_the_persons_value_in_steps_of_a_tenth(seed, imprecision):
    rng = np.random.default_rng(seed)
    values = np.concatenate([[0.0], np.sort(rng.random(2)), [1.0]])
    said = kinds.slid(1, values, imprecision, rng)
    assert said.y.tolist() == [1, -1]
    assert (said.y * (said.d @ values) >= -1e-12).all()
    ends = -said.d[:, -1]
    assert np.allclose(10 * ends, np.round(10 * ends))
    assert ends[1] - ends[0] >= 0.1 - 1e-12


def test_the_widest_level_is_asked_about_once():
    comparator = PolytopeComparator(4, prior=["e2 >= 0.4", "e2 <= 0.5"])
    assert kinds.widest_level(comparator, set()) == 2
    assert kinds.widest_level(comparator, {2}) == 1
    assert kinds.widest_level(comparator, {1, 2}) is None


def test_every_kind_has_a_row_and_no_bound_is_violated(monkeypatch, capsys):
    monkeypatch.setattr(kinds, "problems", lambda: ("career",))
    monkeypatch.setattr(kinds, "KINDS", (kinds.PLAIN, kinds.DEGREE, "1 slider, 0.1"))
    kinds.main(["--seeds", "1", "--jobs", "1"])
    rows = [line.split(" | ") for line in capsys.readouterr().out.splitlines() if "|" in line]
    every = [row for row in rows if row[0] == "| all"]
    assert [row[1] for row in every] == list(kinds.KINDS)
    assert all(row[-1].startswith("0") for row in every)
    assert float(every[2][2].split(" ")[0]) >= 1.0
