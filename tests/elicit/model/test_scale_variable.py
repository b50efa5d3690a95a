"""A prior stated in cvxpy: it means to the bit what its text means, goes by its label, and must be
linear.
"""

from __future__ import annotations

import re
import subprocess
import sys

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import elicit
from elicit import (
    Answers,
    PolytopeComparator,
    PosteriorComparator,
    inequality,
    scale_variable,
)
from elicit.lp.prior_inequalities import as_prior
from elicit.model.scale_variable import linear_rows
from tests.thoroughness import examples


def in_cvxpy(text, e):
    """The text of an inequality as the cvxpy constraint that the same words make."""
    return eval(text, {f"e{i + 1}": e[i] for i in range(e.size)})


def test_it_stands_for_the_scale():
    e = elicit.scale_variable(4)
    assert (e.shape, e.name()) == ((4,), "e")
    assert not any(e.attributes.values())
    for k in (1, 2.5, "4"):
        with pytest.raises(ValueError, match="k, the number of levels"):
            elicit.scale_variable(k)


@pytest.mark.slow
def test_it_needs_cvxpy_only_when_called():
    code = (
        "import sys, elicit; elicit.PolytopeComparator(4, prior=['e3 >= 0.2']); from elicit import "
        "scale_variable; "
        "assert 'cvxpy' not in sys.modules; scale_variable(3); assert 'cvxpy' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


decimals = st.sampled_from(
    ["0.1", "0.2", "0.3", "0.05", "0.7", "1.1", "2", "3", "10", "1/3", "0.25", "12.34"]
)


@st.composite
def expressions(draw, depth=3):
    """An affine expression of e1..e4 that holds a level, in simple decimals."""
    kind = draw(
        st.sampled_from(["level", "sum", "difference", "shift", "product", "quotient", "minus"])
    )
    if depth == 0 or kind == "level":
        return f"e{draw(st.integers(1, 4))}"
    inner = draw(expressions(depth - 1))
    if kind == "minus":
        return f"-({inner})"
    if kind in ("sum", "difference"):
        return f"({inner}) {'+' if kind == 'sum' else '-'} ({draw(expressions(depth - 1))})"
    number = draw(decimals)
    return {
        "shift": f"({inner}) + {number}",
        "product": f"{number}*({inner})",
        "quotient": f"({inner})/({number})",
    }[kind]


@examples(150)
@given(expressions(), st.one_of(expressions(), decimals), st.sampled_from([">=", "<="]))
def test_the_numbers_are_those_of_the_text_but_for_the_rounding_of_sums(left, right, sign):
    text = f"{left} {sign} {right}"
    assume(" - " not in text)  # terms that cancel leave a rounding of their own
    try:
        said = inequality(text, 4)
    except ValueError:
        assume(False)  # no level is left in it
    assume(not ((np.abs(said.coefficients) > 0) & (np.abs(said.coefficients) < 1e-9)).any())
    found = linear_rows(in_cvxpy(text, scale_variable(4)), 4)
    if not said.coefficients[1:-1].any() and said.coefficients[-1] >= said.bound:
        assert len(found.a) == 0  # it says no more than that the scale goes from 0 to 1
        return
    if not {"+", "-"} & set(text):  # then to the bit
        assert found.a.tolist() == [said.coefficients.tolist()]
        assert found.b.tolist() == [said.bound]
    assert found.a == pytest.approx(said.coefficients[None], rel=1e-12, abs=1e-9)
    assert found.b == pytest.approx([said.bound], rel=1e-12, abs=1e-9)


def test_any_linear_constraint_is_what_cvxpy_evaluates_it_to():
    rng, k = np.random.default_rng(3), 5
    e, weight = scale_variable(k), cp.Parameter(value=0.3)
    m = rng.normal(size=(3, k))
    e.value = rng.random(k)
    before = e.value.copy()
    with pytest.warns(DeprecationWarning, match="NonPos"):
        old_fashioned = cp.NonPos(e[1] - 0.2)
    made = [
        m @ e >= rng.normal(size=3),
        m @ e <= 0.25,
        cp.diff(e, 2) <= 0.1,
        cp.sum(e) / k >= cp.mean(e[1:3]) + 0.01,
        cp.cumsum(e)[2:] >= e[::-1][2:],
        cp.reshape(m @ cp.hstack([e[1:], e[:1]]), (1, 3), order="C") >= np.ones((2, 3)),
        weight * e[2] >= cp.abs(-0.25) * e[1] - cp.norm(np.array([3, 4])),
        cp.multiply(np.arange(k), e)[1:-1] == rng.normal(size=k - 2),
        cp.NonNeg(e[2] - 2 * e[1]),
        old_fashioned,
        cp.Zero(e[2] - 0.4),
    ]
    for constraint in made:
        a, b, _ = linear_rows(constraint, k)
        equality = isinstance(constraint, (cp.Zero, type(e == 0)))
        assert len(a) == constraint.size * (2 if equality else 1)
        for _ in range(20):
            point = rng.normal(size=k)
            e.value = point
            # by how much it is missed, at any point: the same as cvxpy says of it, row for row
            short = np.maximum(b - a @ point, 0).reshape(constraint.size, -1).max(axis=1)
            residual = constraint.residual
            assert short == pytest.approx(np.ravel(residual), abs=1e-12)
        e.value = before
    linear_rows(made[0], k)
    assert e.value.tolist() == before.tolist()


def test_names_are_labels_or_what_cvxpy_prints():
    e = scale_variable(4)
    prior = as_prior(
        [
            e[3] - e[2] >= 0.2,
            "e3 >= 2*e2",
            (e[3] >= 3 * e[1]).set_label("well is thrice\nstable"),
            cp.diff(e)[:2] >= 0.05,
            (cp.diff(e)[:2] <= 0.5).set_label("no leap"),
            (e[1] == 0.25).set_label("known"),
            np.full(4, 1 / 3) @ e
            + np.full(4, 1 / 7) @ e
            + np.full(4, 1 / 9) @ e
            + 0.123456789123 * e[1]
            >= 0.1,
        ],
        4,
    )
    assert prior.names == (
        "0.2 <= e[3] + -(e[2])",
        "e3 >= 2*e2",
        "well is thrice stable",
        *(f"{cp.diff(e)[:2] >= 0.05}: {row}" for row in ("e2 - e1 >= 0.05", "e3 - e2 >= 0.05")),
        "no leap: e2 - e1 <= 0.5",
        "no leap: e3 - e2 <= 0.5",
        "known",
        "known",
        # shorter than what cvxpy prints
        "0.587302*e4 + 0.587302*e3 + 0.710758*e2 + 0.587302*e1 >= 0.1",
    )
    assert prior.a[7:9].tolist() == [[0, 1, 0, 0], [0, -1, 0, 0]]
    assert prior.b[7:9].tolist() == [0.25, -0.25]


def test_that_the_scale_goes_from_0_to_1_may_be_said_and_adds_nothing():
    e = scale_variable(4)
    assert as_prior([e[0] == 0, e[3] == 1, e[0] >= -1, e[3] <= 2], 4) is None
    assert as_prior([e >= 0, e <= 1], 4).names == tuple(
        f"{side}: {row}"
        for side, rows in (
            ("0.0 <= e", ("e2 >= 0", "e3 >= 0")),
            ("e <= 1.0", ("e2 <= 1", "e3 <= 1")),
        )
        for row in rows
    )
    with pytest.raises(
        ValueError, match=re.escape("no scale with margin 1e-06 (and e_1 = 0, e_k = 1) satisfies")
    ):
        PolytopeComparator(4, prior=e[3] <= 0.9)


TEXTS = ["e5 - e4 >= 0.1", "e4 >= 2*e2 + 0.1", "e3 <= 0.7*e5 - e2/3", "3*(e4 - e3) <= 1.1"]


@pytest.mark.parametrize(
    "make",
    [
        PolytopeComparator,
        lambda k, prior: PolytopeComparator(k, prior=prior, wrong=1),
        lambda k, prior: PosteriorComparator(k, particles=50, prior=prior),
    ],
    ids=["polytope", "one wrong", "posterior"],
)
def test_a_comparator_takes_it_as_it_takes_the_text(make):
    rng, k = np.random.default_rng(5), 5
    e = scale_variable(k)
    d = rng.dirichlet(np.ones(k), size=40) - rng.dirichlet(np.ones(k), size=40)
    truth = np.array([0, 0.15, 0.3, 0.55, 1])
    answers = Answers(d[:6], np.sign(d[:6] @ truth).astype(int))
    by_text = make(k, prior=TEXTS).update(answers)
    mixed = [in_cvxpy(TEXTS[0], e), TEXTS[1], *(in_cvxpy(text, e) for text in TEXTS[2:])]
    for prior in ([in_cvxpy(text, e) for text in TEXTS], tuple(mixed)):
        other = make(k, prior=prior).update(answers)
        assert other.prior.a.tolist() == by_text.prior.a.tolist()
        assert other.compare(d).tolist() == by_text.compare(d).tolist()
        assert [x.tolist() for x in other.bounds(d)] == [x.tolist() for x in by_text.bounds(d)]
        assert other.values.tolist() == by_text.values.tolist()
    assert by_text.compare(d).tolist() != make(k, prior=None).update(answers).compare(d).tolist()


def test_two_constraints_are_not_taken_for_a_and_b():
    e = scale_variable(3)
    assert as_prior((e[1] >= 0.1, e[1] <= 0.5), 3).b.tolist() == [0.1, -0.5]
    assert as_prior([e[1] >= 0.1, elicit.scale_variable(3)[1] <= 0.5], 3).b.tolist() == [0.1, -0.5]
    for pair in (([[0, 1, 0]], e[1] >= 0), (e[1] >= 0, [0]), [e[1]], [e[1] >= 0, e[1]]):
        with pytest.raises(ValueError, match=re.escape("a prior is (A, b)")):
            as_prior(pair, 3)


def test_labels_are_in_explanations_and_in_the_error_for_an_empty_prior():
    e = scale_variable(4)
    twice = (e[3] >= 2 * e[1]).set_label("well is twice poor")
    said = PolytopeComparator(4, prior=[twice]).explain([0.0, -2.0, 0.0, 1.0])
    assert [used.name for used in said.prior] == ["well is twice poor"]
    assert '"well is twice poor"' in str(said)
    with pytest.raises(
        ValueError, match=re.escape("together, well is twice poor; 0.6 <= e[1]: relax or drop")
    ):
        PolytopeComparator(4, prior=[twice, e[1] >= 0.6])


def test_a_parameter_counts_with_the_value_it_has_now():
    e, low = scale_variable(3), cp.Parameter(name="low")
    constraint = e[1] >= low
    with pytest.raises(
        ValueError, match=re.escape('"low <= e[1]" has no value yet for low: set its .value first')
    ):
        as_prior(constraint, 3)
    low.value = 0.3
    kept = PolytopeComparator(3, prior=constraint)
    low.value = 0.4
    assert kept.prior.b.tolist() == [0.3]
    assert as_prior(constraint, 3).b.tolist() == [0.4]


E4, WAY_OUT = scale_variable(4), "add it to the programs of comparator.problems(d)"
NOT_LINEAR, NOT_CONVEX = (
    ("is convex but not linear", WAY_OUT),
    ("is not convex by the rules of cvxpy (DCP)",),
)


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        (cp.norm(E4) <= 1.5, NOT_LINEAR),
        (cp.SOC(E4[3], E4[:3]), NOT_LINEAR),
        (cp.log(E4[1]) >= -3, NOT_LINEAR),
        (cp.abs(E4[1] - 0.3) <= 0.1, (*NOT_LINEAR, "abs(x) <= t is x <= t and x >= -t")),
        (cp.bmat([[E4[1], E4[2]], [E4[2], 1]]) >> 0, NOT_LINEAR),
        (cp.norm(E4) >= 1, NOT_CONVEX),
        (E4[1] * E4[2] >= 0.1, NOT_CONVEX),
        (cp.square(E4[1]) == 0.25, NOT_CONVEX),
        (cp.FiniteSet(E4[1], [0.1, 0.2]), NOT_CONVEX),
        (
            E4[1] >= cp.Variable(name="q"),
            ("is about q, but a prior is about the scale alone", WAY_OUT),
        ),
        (cp.Variable(4, name="x")[1] >= 0.1, ("is about x,", "over e = elicit.scale_variable(4)")),
        (scale_variable(5)[1] >= 0.1, ("is about 5 levels, not k = 4",)),
        (E4[1] + scale_variable(4)[2] >= 0.1, ("mixes 2 scale variables: use one",)),
        (
            cp.Variable(4, name="e", integer=True)[1] >= 0.1,
            ("declared integer", "elicit.scale_variable(4)"),
        ),
        (cp.Variable(4, name="e", nonneg=True)[1] >= 0.1, ("declared nonneg",)),
        (
            cp.Variable((4, 1), name="e")[1] >= 0.1,
            ("a variable of shape (4, 1)", "elicit.scale_variable(4)"),
        ),
        (cp.Constant(1) >= 0, ("compares nothing: no level of the scale is in it",)),
        (E4[1] >= 1e400, ("holds numbers too large to compute with",)),
        (1e300 * E4[1] >= 0, ("holds numbers too large to compute with",)),
    ],
)
@pytest.mark.parametrize("make", [PolytopeComparator, PosteriorComparator])
def test_what_is_not_linear_in_the_scale_alone_is_refused_in_words(make, constraint, words):
    with pytest.raises(ValueError, match=re.escape(words[0])) as error:
        make(4, prior=[constraint])
    assert all(word in str(error.value) for word in words)


def test_a_refusal_calls_a_constraint_by_its_label():
    with pytest.raises(ValueError, match='the prior\'s "round" is convex but not linear'):
        as_prior((cp.norm(E4) <= 1.5).set_label("round"), 4)
