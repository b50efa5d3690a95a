"""Prior inequalities: what their text means, which texts are refused and with which words, and what
a prior may be.
"""

import re
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import (
    Inequality,
    PolytopeComparator,
    PosteriorComparator,
    Verdict,
    inequalities,
    inequality,
)
from elicit.lp.prior_inequalities import Prior, as_prior, readable
from elicit.lp.region import prior_rows
from tests.thoroughness import examples

LABELS = ["critical", "stable", "well"]


@pytest.mark.parametrize(
    ("text", "coefficients", "bound"),
    [
        ("e4 >= 2*e2", [0, -2, 0, 1], 0),
        ("e4 >= e2*2", [0, -2, 0, 1], 0),
        ("2*e2 <= e4", [0, -2, 0, 1], 0),
        ("e4 ≥ 2*e2", [0, -2, 0, 1], 0),
        ("e2 ≤ 0.5", [0, -1, 0, 0], -0.5),
        ("0.5 >= e2", [0, -1, 0, 0], -0.5),
        ("e3 - e2 >= (e4 - e3)/4 + 0.125", [0, -1, 1.25, -0.25], 0.125),
        ("-(e2 - 1) >= +e3", [0, -1, -1, 0], -1),
        ("2*(e2 + 3*(e3 - 0.5)) >= e2 + 1e-3", [0, 1, 6, 0], 3.001),
        ("e2 + 0*e3 >= e3 - e3 + 1/4", [0, 1, 0, 0], 0.25),
        ("  e2>=.25  ", [0, 1, 0, 0], 0.25),
        ("e1 + e4 >= e2", [1, -1, 0, 1], 0),
    ],
)
def test_an_inequality_means_what_it_says(text, coefficients, bound):
    found = inequality(text, k=4)
    assert found.coefficients.tolist() == coefficients
    assert found.bound == bound
    assert found.name == text.strip()
    assert (
        str(bound) != "0" or np.copysign(1.0, found.bound) == 1.0
    )  # no minus zero for people to read


def test_levels_go_by_their_labels_and_by_number():
    by_label = inequality("well >= 2*stable", labels=LABELS)
    by_number = inequality("e3 >= 2*stable", labels=LABELS, name="well is at least twice stable")
    assert by_label.coefficients.tolist() == by_number.coefficients.tolist() == [0, -2, 1]
    assert (by_label.name, by_number.name) == ("well >= 2*stable", "well is at least twice stable")
    accented = inequality(
        "ﬁne >= 0.5", labels=["schlecht", "gut genug", "ﬁne", "best"]
    )  # a ligature
    assert accented.coefficients.tolist() == [0, 0, 1, 0]


def test_a_chain_is_several_inequalities_each_with_its_own_name():
    low, high = inequalities("0.25 <= e2 <= e3/2", k=3)
    assert (low.coefficients.tolist(), low.bound, low.name) == ([0, 1, 0], 0.25, "0.25 <= e2")
    assert (high.coefficients.tolist(), high.bound, high.name) == (
        [0, -1, 0.5],
        0.0,
        "e2 <= e3 / 2",
    )
    assert [x.name for x in inequalities("0.25 <= e2 <= 0.5", 3, name="guess")] == [
        "guess: 0.25 <= e2",
        "guess: e2 <= 0.5",
    ]
    with pytest.raises(ValueError, match="holds 2 inequalities: write each by itself"):
        inequality("0.25 <= e2 <= 0.5", k=3)


@pytest.mark.parametrize(
    ("message", "texts"),
    [
        ("write >= for >", ["e2 > 0.5"]),
        ("write <= for <", ["e2 < 0.5", "0.1 <= e2 < 0.5"]),
        ("an equality as two inequalities", ["e2 == 0.5"]),
        ("states no inequality", ["e2 != 0.5", "e2 in e3", "e2", "e2 >= 0.3 and e3 <= 0.5"]),
        ("cannot be read", ["e2 = 0.5", "", "e2 >= ", "e2 >= 0.5; e3", "e2 >= 0\x00"]),
        ("cannot be read", ["(" * 400 + "e2" + ")" * 400 + " >= 0"]),
        ("too long to read", ["e2 >= " + "+".join(["e3"] * 400)]),
        ('"e2 * e3" is not linear', ["e2*e3 >= 0.5"]),
        (
            "is not linear",
            ["e2**2 >= 0.5", "0.5/e2 >= 0.5", "e2//2 >= 0.5", "~e2 >= 0.5", "max(e2, e3) >= 0.5"],
        ),
        (
            "is not linear",
            ["e2 >= True", "e2 >= 2j", "e2 >= 'a'", "e2.real >= 0.5", "[e2][0] >= 0.5"],
        ),
        ("is not linear", ["__import__('os').abort() >= e2", "(lambda: e2)() >= 0.5"]),
        ("divides by zero", ["e2/0 >= 0.5", "e2/(1 - 1) >= 0.5"]),
        ('no level is called "e9"; there are e1, e2, e3', ["e9 >= 0.5"]),
        ("no level is called", ["stable >= 0.5", "e0 >= 0.5"]),
        ("would be read as the number 200. Write 2*e2 for the level", ["e4 >= 2e2"]),
        ("Write .5*e1 for the level", ["e3 >= .5E1"]),
        ("too large", ["e2 >= 1e400", "1e400*e2 >= 0", "0*1e400*e2 >= 0", "e2 >= 1" + "0" * 400]),
        ("compares nothing", ["2 >= 1", "e2 >= e2 - 1"]),
    ],
)
def test_what_is_no_linear_inequality_is_refused_in_words(message, texts):
    for text in texts:
        with pytest.raises(ValueError, match=re.escape(message)):
            inequality(text, k=3)


def test_deep_nesting_is_an_error_of_the_text_not_a_crash():
    assert inequality("-" * 100 + "e2 >= 0", k=3).coefficients.tolist() == [0, 1, 0]
    with pytest.raises(ValueError, match=r"cannot be read|nested too deeply"):
        inequality("-" * 990 + "e2 >= 0", k=3)


def test_a_prior_of_several_texts_may_use_the_names_of_levels():
    texts = ["stable >= 0.4", "0.1 <= very_ill <= 0.3"]
    labels = ["dead", "very ill", "stable", "well"]
    found = inequalities(texts, labels=labels)
    assert [(one.coefficients.tolist(), one.bound) for one in found] == [
        ([0, 0, 1, 0], 0.4),
        ([0, 1, 0, 0], 0.1),
        ([0, -1, 0, 0], -0.3),
    ]
    assert [one.name for one in found] == ["stable >= 0.4", "0.1 <= very_ill", "very_ill <= 0.3"]
    named = inequalities(texts, labels=labels, name="Ann")
    assert next(one.name for one in named) == "Ann: stable >= 0.4"
    assert inequalities(["e2 >= 0.5"], 3, name="Ben")[0].name == "Ben"
    assert inequalities([], labels=labels) == ()
    for comparator in (
        PolytopeComparator(4, prior=found),
        PosteriorComparator(4, prior=found, particles=50),
    ):
        low, high = comparator.bounds([[0, 0, 1, 0], [0, 1, 0, 0]])
        assert low[0] >= 0.4 - 1e-9
        assert 0.1 - 1e-9 <= low[1] <= high[1] <= 0.3 + 1e-9
    with pytest.raises(
        ValueError, match=r"each inequality must be a text such as 'e2 >= 0.4', not 3"
    ):
        inequalities(["e2 >= 0.5", 3], 3)
    unclear = ["dead", "very ill", "very-ill", "well"]
    assert inequality("e2 >= 0.5", labels=unclear).bound == 0.5
    with pytest.raises(
        ValueError, match='no level is called "very_ill"; there are e1, e2, e3, e4, dead, well'
    ):
        inequality("very_ill >= 0.5", labels=unclear)


def test_a_comparator_that_does_not_know_a_name_says_how_to_give_it():
    wanted = (
        r'no level is called "stable"; .* elicit.inequalities\("stable >= 0.4", labels=\[...\]\), '
        r"with one name a level"
    )
    for make in (PolytopeComparator, PosteriorComparator):
        with pytest.raises(ValueError, match=wanted):
            make(4, prior=["stable >= 0.4"])


def test_the_number_of_levels_and_the_labels_are_checked():
    with pytest.raises(ValueError, match="Give k or labels"):
        inequality("e2 >= 0.5")
    with pytest.raises(ValueError, match="labels must be 4 names"):
        inequality("e2 >= 0.5", k=4, labels=LABELS)
    with pytest.raises(ValueError, match="labels must be 4 names, one a level, not 'abcd'"):
        inequality("b >= 0.5", labels="abcd")
    with pytest.raises(ValueError, match='"e1" of level 2 is also a name of level 1'):
        inequality("e2 >= 0.5", labels=["low", "e1", "high"])
    with pytest.raises(ValueError, match='"mid" of level 3 is also a name of level 2'):
        inequality("e2 >= 0.5", labels=["low", "mid", "mid"])
    assert inequality("e2 >= 0.5", labels=["e1", "e2", "e3"]).bound == 0.5
    with pytest.raises(ValueError, match="at least 2"):
        inequality("e1 >= 0.5", k=1)


@st.composite
def expressions(draw, depth: int = 3):
    """An expression over e1..e3 with its value as an affine function (constant, three coefficients)
    in Fractions.
    """
    kind = draw(
        st.sampled_from(["level", "number", "sum", "difference", "product", "quotient", "minus"])
    )
    if depth == 0 or kind == "level":
        i = draw(st.integers(1, 3))
        return f"e{i}", [Fraction(int(j == i)) for j in range(4)]
    if kind == "number":
        n = draw(st.integers(0, 64))
        return str(n / 8), [Fraction(n, 8), *[Fraction(0)] * 3]
    text, value = draw(expressions(depth - 1))
    if kind == "minus":
        return f"-({text})", [-x for x in value]
    if kind in ("product", "quotient"):
        power = draw(st.sampled_from([1, 2, 4, 8]))
        factor = Fraction(power) if kind == "product" else Fraction(1, power)
        shown = draw(st.sampled_from([f"{power}*({text})", f"({text})*{power}"]))
        return shown if kind == "product" else f"({text})/{power}", [factor * x for x in value]
    other, more = draw(expressions(depth - 1))
    sign = 1 if kind == "sum" else -1
    return f"({text}) {'+' if sign > 0 else '-'} ({other})", [
        x + sign * y for x, y in zip(value, more, strict=True)
    ]


@examples(200)
@given(expressions(), expressions(), st.sampled_from([">=", "<="]))
def test_any_expression_has_the_value_that_exact_arithmetic_gives_it(left, right, op):
    sign = 1 if op == ">=" else -1
    want = [sign * (a - b) for a, b in zip(left[1], right[1], strict=True)]
    text = f"{left[0]} {op} {right[0]}"
    if not any(want[1:]):
        with pytest.raises(ValueError, match="compares nothing"):
            inequality(text, k=3)
        return
    found = inequality(text, k=3)
    assert [Fraction(float(x)) for x in found.coefficients] == want[1:]
    assert Fraction(found.bound) == -want[0]


@pytest.mark.parametrize(
    ("coefficients", "bound", "text"),
    [
        ([0, -1, 2], 0.1, "2*e3 - e2 >= 0.1"),
        ([0, 1, 0], 0, "e2 >= 0"),
        ([0, 2, -1], 0.1, "e3 - 2*e2 <= -0.1"),
        ([0, -1, 0], -0.5, "e2 <= 0.5"),
        ([-1, 0.25, 1 / 3], 0, "0.333333*e3 + 0.25*e2 - e1 >= 0"),
        ([0, 0, 0], 1, "0 >= 1"),
        ([0, -1, 0], 0, "e2 <= 0"),
    ],
)
def test_numbers_are_rendered_as_people_write_them(coefficients, bound, text):
    assert readable(np.array(coefficients, dtype=float), bound) == text
    assert Inequality(coefficients, bound).name == text
    if any(coefficients[1:]):
        again = inequality(text, k=3)
        assert again.coefficients == pytest.approx(coefficients, abs=1e-5)
        assert again.bound == pytest.approx(bound)


def test_an_inequality_is_checked_and_cannot_be_changed():
    given_row = np.array([0.0, 1.0, -1.0])
    found = Inequality(given_row, 0.25, "x")
    given_row[1] = 7.0
    assert found.coefficients.tolist() == [0, 1, -1]
    with pytest.raises(ValueError, match="read-only"):
        found.coefficients[0] = 1.0
    for row, bound, message in [
        ([[0, 1]], 0, r"shape \(k,\), not \(1, 2\)"),
        ([1], 0, "shape"),
        ([0, np.nan], 0, "finite"),
        (["a", "b"], 0, "must be numbers"),
        ([0, 1], np.inf, "bound must be one finite number"),
        ([0, 1], [1, 2], "bound must be one finite number"),
        ([0, 1], "much", "bound must be one finite number, not 'much'"),
    ]:
        with pytest.raises(ValueError, match=message):
            Inequality(row, bound)


def test_every_way_to_state_a_prior_is_the_same_prior():
    a, b = [[0, -2, 1], [0, 1, 0]], [0.0, 0.1]
    first, second = inequality("e3 >= 2*e2", k=3), Inequality([0, 1, 0], 0.1, "a tenth")
    ways = [
        (a, b),
        [np.array(a, dtype=float), np.array(b)],
        Prior(np.array(a, dtype=float), np.array(b), ("p", "q")),
        [first, second],
        (first, second),
        ["e3 >= 2*e2", "e2 >= 0.1"],
        ("e3 >= 2*e2", second),
    ]
    names = [("e3 - 2*e2 >= 0", "e2 >= 0.1")] * 2 + [("p", "q")] + [("e3 >= 2*e2", "a tenth")] * 2
    names += [("e3 >= 2*e2", "e2 >= 0.1"), ("e3 >= 2*e2", "a tenth")]
    for way, want in zip(ways, names, strict=True):
        prior = as_prior(way, 3)
        assert prior.names == want
        assert prior[0].tolist() == prior.a.tolist() == a
        assert prior[1].tolist() == prior.b.tolist() == b
        assert not prior.a.flags.writeable
        assert not prior.b.flags.writeable
    assert as_prior(as_prior(ways[3], 3), 3).names == ("e3 >= 2*e2", "a tenth")
    assert as_prior(first, 3).names == as_prior("e3 >= 2*e2", 3).names == ("e3 >= 2*e2",)
    assert len(as_prior("0.1 <= e2 <= 0.5", 3).names) == 2
    assert as_prior(([0, 1, 0], 0.1), 3).a.shape == (
        1,
        3,
    )  # one row needs no second pair of brackets


def test_no_inequality_is_no_prior():
    assert as_prior(None, 3) is None
    assert as_prior([], 3) is None
    assert as_prior((np.empty((0, 3)), np.empty(0)), 3).names == ()


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        (([[0, 1]], [0]), r"the prior's A must have shape \(n, 3\)"),
        (([[0, 1, np.inf]], [0]), "the prior's A must be finite"),
        (([[0, 1, 1]], [0, 1]), "the prior's b must be one finite number"),
        (([[0, 1, 1], [0, 0, 1]], [0]), "the prior's b must be 2 finite numbers, one a row of A"),
        (([[0, 1, 1]], [np.nan]), "the prior's b"),
        (([[0, 1, 1]], None), "the prior's b"),
        (([[0, 1, 1]], "none"), r"a prior is \(A, b\)"),
        (([[0, 1, 1]], [0], ["x"]), r"a prior is \(A, b\)"),
        (3, r"a prior is \(A, b\)"),
        ({"e2": 1}, r"a prior is \(A, b\)"),
        (([[0, 1, 1]], "e2 >= 0.5"), r"a prior is \(A, b\)"),
        ([Inequality([0, 1], 0, "x")], '"x" is about 2 levels, not k = 3'),
        (Inequality([0, 1], 0, "x"), '"x" is about 2 levels, not k = 3'),
        (["e4 >= 0.5"], 'no level is called "e4"'),
        (
            Prior(np.zeros((2, 3)), np.zeros(2), ("x",)),
            "one name an inequality: 2 inequalities, 1 names",
        ),
        (Prior(np.zeros((2, 4)), np.zeros(2), ("x", "y")), "the prior's A must have shape"),
    ],
)
def test_what_is_no_prior_is_refused_in_words(prior, message):
    with pytest.raises(ValueError, match=message):
        as_prior(prior, 3)


def test_the_comparators_program_takes_a_prior_as_it_takes_a_and_b():
    prior = as_prior(["e3 >= 2*e2", "e4 - e3 <= 0.25"], 4)
    for named, plain in zip(prior_rows(prior, 4), prior_rows((prior.a, prior.b), 4), strict=True):
        assert named.tolist() == plain.tolist()
    assert prior_rows(prior, 4)[2].tolist() == [-1, -2]  # no number of an answer
    comparator = PolytopeComparator(4, prior=prior)
    twice, slack = (
        [0.0, -2.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, -0.75],
    )  # e3 - 2 e2, and e3 - 3/4 e4 with e4 = 1
    assert comparator.compare([twice, slack]).tolist() == [Verdict.BETTER, Verdict.BETTER]
    for nothing in (None, (np.empty((0, 4)), [])):
        plain = PolytopeComparator(4, prior=nothing)
        assert plain.compare([twice, slack]).tolist() == [Verdict.UNKNOWN, Verdict.UNKNOWN]
