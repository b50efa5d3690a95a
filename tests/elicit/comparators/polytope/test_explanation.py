"""Explanations: every proof checked in rationals by code of its own, every listed answer shown to
be needed by telling the others alone, and the sentences word by word."""

import pickle
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import Answers, PolytopeComparator, Verdict, inequality
from elicit.comparators.polytope.explanation import Explanation, Proof
from elicit.comparators.polytope.minimal_proof import explain
from elicit.lp.prior_inequalities import as_prior
from tests.lp_cases import (
    KINDS,
    TIE_BAND,
    Case,
    Oracle,
    cases,
    dot,
    exact,
    from_tails,
    shares,
    tails,
)
from tests.thoroughness import examples, on_any_processor, scaled

LABELS = ["critical", "stable", "well"]
HALF = [0.5, -1.0, 0.5]  # better where e2 < 1/2


def told(
    k: int, answers: Sequence[tuple[Any, int]] = (), margin: float = 1e-6, prior: Any = None
) -> PolytopeComparator:
    known = as_prior(prior, k)
    comparator = PolytopeComparator(k, margin=margin, prior=known, tie=0.0)
    if answers:
        d, y = zip(*answers, strict=True)
        comparator = comparator.update(
            Answers(np.array(d, dtype=float), y, ids=[f"q{i}" for i in range(len(y))])
        )
    return comparator


def of_case(
    case: Case, rows: Sequence[int] | None = None, prior: Sequence[int] | None = None
) -> PolytopeComparator:
    """The comparator that knows a case, or only some of its answers and prior inequalities."""
    keep = slice(None) if rows is None else list(rows)
    given = (
        case.prior
        if prior is None or case.prior is None
        else tuple(x[list(prior)] for x in case.prior)
    )
    comparator = PolytopeComparator(case.k, margin=case.margin, prior=given, tie=case.tie)
    return comparator.update(Answers(case.d[keep], case.y[keep]))


def in_units_of(d: Sequence[float]) -> list[Fraction]:
    t = tails(d)
    return list(exact(t))


def band(d: Sequence[float], tie: float) -> Fraction:
    """Return the largest |d.e| that an answer "equal" about d allows.

    The code allows more, by less than one part in 10^12.
    """
    return max(TIE_BAND * sum(map(abs, exact(d))), Fraction(tie))


def least_gap(comparator: PolytopeComparator) -> Fraction:
    p = comparator.k - 1
    return Fraction(1, p) if comparator.margin == 1.0 / p else Fraction(comparator.margin)


def check_proof(proof: Proof, d: Any, comparator: PolytopeComparator) -> None:
    """The identity, in gaps: d.e = t.g with the tail sums t, e_{j+1} - e_j = g_j and e_k - e_1 =
    1.
    """
    answers, prior = comparator.answers, comparator.prior
    total, bound, wider = [proof.remainder] * (comparator.k - 1), proof.remainder, Fraction(0)
    for row, name, sign, weight, equal in proof.answers:
        assert name == answers.ids[row]
        assert sign == answers.y[row] or (answers.y[row] == 0 and sign in (1, -1))
        assert equal == (answers.y[row] == 0)
        assert weight > 0
        total = [
            a + weight * sign * x for a, x in zip(total, in_units_of(answers.d[row]), strict=True)
        ]
        wider += weight * band(answers.d[row], comparator.tie) if answers.y[row] == 0 else 0
    for row, name, weight in proof.prior:
        assert prior is not None
        assert name == prior.names[row]
        assert weight > 0
        total = [a + weight * x for a, x in zip(total, in_units_of(prior.a[row]), strict=True)]
        bound += weight * Fraction(float(prior.b[row]))
    without_margin = bound
    for gap, weight in proof.order:
        assert weight > 0
        total[gap] += weight
        bound += weight * least_gap(comparator)
    assert total == [proof.sign * x for x in in_units_of(d)]
    assert proof.bound >= 0
    assert wider <= bound - proof.bound <= wider * (1 + Fraction(1e-12))
    assert bound - proof.bound == without_margin - proof.bound_without_margin


def check_scales(explanation: Explanation, comparator: PolytopeComparator) -> None:
    """They fit all that is known, and say of d what they are there to say."""
    answers, prior, t = comparator.answers, comparator.prior, in_units_of(explanation.d)
    signs = []
    for e in explanation.scales:
        assert e.shape == (comparator.k,)
        assert (e[0], e[-1]) == (0, 1)
        g = list(np.diff(e))
        assert min(g) >= least_gap(comparator)
        for d, y in zip(answers.d, answers.y, strict=True):
            value = dot(in_units_of(d), g)
            assert (
                y * value >= 0
                if y
                else abs(value) <= band(d, comparator.tie) * (1 + Fraction(1e-12))
            )
        for a, b in zip(prior.a, prior.b, strict=True) if prior is not None else ():
            assert dot(in_units_of(a), g) >= Fraction(float(b))
        signs.append(np.sign(dot(t, g)))
    if explanation.verdict is Verdict.UNKNOWN:
        assert signs == [1, -1]
    elif explanation.verdict is Verdict.EQUAL or explanation.proofs[0].bound > 0:
        assert signs == []
    else:
        assert signs == [int(explanation.verdict)]


def explained(
    d: Any, comparator: PolytopeComparator, labels: list[str] | None = None
) -> Explanation:
    """The explanation of d, whose proofs and scales hold."""
    found = explain(d, comparator, labels)
    assert found.verdict == comparator.compare(d)[0]
    signs = {Verdict.BETTER: [1], Verdict.WORSE: [-1], Verdict.EQUAL: [1, -1], Verdict.UNKNOWN: []}[
        found.verdict
    ]
    assert [proof.sign for proof in found.proofs] == (signs if any(in_units_of(found.d)) else [])
    for proof in found.proofs:
        check_proof(proof, found.d, comparator)
        assert len(proof.answers) + len(proof.prior) + len(proof.order) <= max(comparator.k - 2, 0)
        assert str(proof).count(" = ") == 1
    check_scales(found, comparator)
    return found


def check_minimal(explanation: Explanation, case: Case) -> None:
    """The listed answers and prior inequalities are enough, and none of them can be spared."""
    rows, prior = list(explanation.rows), sorted({used.row for used in explanation.prior})
    d, verdict = explanation.d, explanation.verdict
    assert of_case(case, rows, prior).compare(d)[0] == verdict
    for row in rows:
        assert of_case(case, [r for r in rows if r != row], prior).compare(d)[0] != verdict, (
            case.kind,
            row,
        )
    for row in prior:
        assert of_case(case, rows, [r for r in prior if r != row]).compare(d)[0] != verdict, (
            case.kind,
            -1 - row,
        )


def check(case: Case, d: Any, oracle: Oracle | None = None) -> Explanation:
    explanation = explained(d, of_case(case))
    for proof in explanation.proofs if oracle is not None and 0 not in case.y else ():
        assert proof.bound <= oracle.least([proof.sign * x for x in in_units_of(d)])
    check_minimal(explanation, case)
    first = (
        "ask: "
        if explanation.verdict is Verdict.UNKNOWN and explanation.told_equal is None
        else "not asked"
    )
    assert str(explanation).startswith(first)
    return explanation


@on_any_processor
@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_every_proof_holds_and_every_listed_answer_is_needed(part: int) -> None:
    seen: Counter[str] = Counter()
    for i, case in enumerate(
        cases([33, part], scaled(3, 7) * len(KINDS), asks=2, most_levels=12, most_answers=60)
    ):
        oracle = Oracle(case.region()) if i % 4 == 0 else None
        for d in case.ask:
            found = check(case, d, oracle)
            seen[found.verdict.name] += 1
            seen["answers"] += bool(found.answers)
            seen["prior"] += bool(found.prior)
            seen["several"] += len(found.rows) > 1
            seen["bound 0"] += any(proof.bound == 0 for proof in found.proofs)
            seen["margin"] += any(proof.needs_margin for proof in found.proofs)
    wanted = {
        "BETTER",
        "WORSE",
        "EQUAL",
        "UNKNOWN",
        "answers",
        "prior",
        "several",
        "bound 0",
        "margin",
    }
    assert wanted <= {
        name for name, times in seen.items() if times
    }  # the cases are worth their time


def test_a_pair_that_was_answered_is_explained_by_the_first_such_answer_alone() -> None:
    rng = np.random.default_rng(2)
    d = shares(rng, 8, 20)
    e = np.linspace(0, 1, 8)
    comparator = told(8, [(row, int(np.sign(row @ e))) for row in np.concatenate([d, d])])
    for i in range(20):
        found = explained(d[i] * 4, comparator)
        if found.answers:  # else dominance
            assert found.rows == (i,)
            assert found.answers[0].multiplier == 4
            assert found.order == ()
            assert found.proofs[0].remainder == 0
    assert explained(d[0], comparator).answers[0].id == "q0"


def test_prior_knowledge_alone_is_preferred_to_answers() -> None:
    prior = [inequality("e2 <= 0.4", k=3)]
    d = [0.4, -0.9, 0.5]  # better where e2 < 5/9
    known = told(3, [(HALF, 1)], prior=prior)
    found = explained(d, known)
    assert found.rows == ()
    assert [(used.row, used.name) for used in found.prior] == [(0, "e2 <= 0.4")]
    assert explained(d, told(3, [(HALF, 1)])).rows == (0,)


def test_the_explanation_is_the_same_however_the_answers_were_told() -> None:
    rng = np.random.default_rng(4)
    d, e = shares(rng, 6, 30), np.cumsum([0, 0.1, 0.3, 0.2, 0.1, 0.3])
    y = np.sign(d @ e).astype(int)
    whole, parts = told(6).update(Answers(d, y)), told(6)
    for row, sign in zip(d, y, strict=True):
        parts = parts.update(Answers([row], [sign], ids=[str(len(parts.answers))]))
        parts.compare(shares(rng, 6, 3))
    for one in shares(rng, 6, 20):
        a, b = explained(one, whole), explained(one, parts)
        assert (str(a), a.proofs) == (str(b), b.proofs)
        assert all((x == y).all() for x, y in zip(a.scales, b.scales, strict=True))


@examples(60)
@given(st.integers(0, 10**6), st.integers(-900, 900))
def test_scaling_a_difference_by_a_power_of_two_scales_its_proof(seed: int, power: int) -> None:
    rng = np.random.default_rng(seed)
    k = int(rng.integers(3, 7))
    d, e = shares(rng, k, 8), np.sort(rng.random(k))
    comparator = told(k, margin=0.0).update(Answers(d, np.sign(d @ (e - e[0])).astype(int)))
    one = d[0] + d[1] * rng.random() if seed % 2 else shares(rng, k, 1)[0]
    plain, scaled = explained(one, comparator), explained(np.ldexp(one, power), comparator)
    factor = Fraction(2) ** power
    assert scaled.rows == plain.rows
    assert [u.multiplier for u in scaled.answers] == [factor * u.multiplier for u in plain.answers]
    assert [u.multiplier for u in scaled.order] == [factor * u.multiplier for u in plain.order]
    assert [p.bound for p in scaled.proofs] == [factor * p.bound for p in plain.proofs]


@pytest.mark.parametrize("of_answer", [997, 0, -1000, -1074])
@pytest.mark.parametrize("of_d", [995, 0, -1000])
def test_magnitudes_far_apart(of_answer: int, of_d: int) -> None:
    comparator = told(4, [(np.ldexp([0.0, -2.0, 3.0, -2.0], of_answer), -1)])
    found = explained(np.ldexp([0.0, 2.0, -3.0, 2.5], of_d), comparator)
    assert found.verdict is Verdict.BETTER
    assert found.rows == (0,)
    assert found.answers[0].multiplier == Fraction(2) ** (of_d - of_answer)
    assert found.proofs[0].bound == Fraction(2) ** (of_d - 1)
    assert ">=" in str(found.proofs[0])  # also where the multiplier exceeds every float


def test_the_edge_of_a_cone_is_told_from_what_lies_beside_it() -> None:
    first, second = np.array([2.0, -1.0, 0.0]), np.array([0.0, 2.0, -1.0])
    comparator = told(4, [(from_tails(first), 1), (from_tails(-second), -1)], margin=0.0)
    found = explained(from_tails(first + second), comparator)
    assert [(used.row, used.sign, used.multiplier) for used in found.answers] == [
        (0, 1, 1),
        (1, -1, 1),
    ]
    assert (found.order, found.proofs[0].bound, len(found.scales)) == ((), 0, 1)
    beside = explained(from_tails(first + second - [0.0, 2.0**-50, 0.0]), comparator)
    assert beside.verdict is Verdict.UNKNOWN


LEFT, RIGHT, EVEN = (
    f"not asked: {who}, because it follows from "
    for who in ("left is better", "right is better", "left and right are equally good")
)
DOMINATES = (
    " is better whatever the values, since it has at least as much time at or above every level"
)
OPEN = (
    "ask: what is known leaves it open; left is better if, say, stable = {}, right if stable = {} "
)
TWICE = inequality("e3 >= 2*e2", k=3, name="well is at least twice stable")
CASES: list[tuple[dict[str, Any], list[float], list[str] | None, str]] = [
    ({"k": 3}, [0, 0, 0], LABELS, "not asked: left and right are the same at every level"),
    ({"k": 3}, [-0.1, -0.1, 0.2], LABELS, "not asked: left" + DOMINATES),
    ({"k": 3, "answers": [(HALF, 1)]}, [0.1, 0.0, -0.1], LABELS, "not asked: right" + DOMINATES),
    ({"k": 3}, HALF, LABELS, OPEN.format(0.25, 0.75) + "(where critical = 0 and well = 1)"),
    (
        {"k": 3, "answers": [(HALF, 0)]},
        [0.25, -0.5, 0.25],
        LABELS,
        OPEN.format(0.499999999, 0.500000001) + "(where critical = 0 and well = 1)",
    ),
    (
        {"k": 3, "answers": [([0.0, -0.5, 0.3], 1), (HALF, 0)]},
        [-0.5, 1.0, -0.5],
        LABELS,
        "not asked again: your answer 2 called this very pair equal",
    ),
    ({"k": 3, "answers": [(HALF, 1)]}, HALF, None, LEFT + "your answer 1"),
    (
        {"k": 4, "answers": [([0.0, -1.0, 1.0, -0.5], 1)]},
        [0.0, -1.0, 0.75, -0.25],
        ["a", "b", "c", "d"],
        LEFT + "your answer 1 and from d > c",
    ),
    (
        {"k": 3, "answers": [(HALF, 1)]},
        [-0.4, 1.0, -0.6],
        LABELS,
        RIGHT + "your answer 1 and from well > critical",
    ),
    (  # one round of three
        {
            "k": 4,
            "answers": [
                ([-1.0, 2.0, -1.0, 0.0], 1),
                ([0.0, -1.0, 2.0, -1.0], 1),
                ([1.0, -1.0, -1.0, 1.0], 1),
            ],
        },
        [-1.0, 2.0, -1.0, 0.0],
        None,
        EVEN + "your answers 1, 2 and 3",
    ),
    ({"k": 3, "prior": [TWICE]}, HALF, LABELS, LEFT + '"well is at least twice stable"'),
    (
        {"k": 4, "answers": [([0.0, 0.0, -1.0, 0.5], 1)], "prior": ["e3 >= 2*e2"]},
        [0.0, -1.0, 0.0, 0.25],
        None,
        LEFT + 'your answer 1 and from "e3 >= 2*e2"',
    ),
    (
        {"k": 3, "margin": 0.2},
        [0.9, -1.0, 0.1],
        LABELS,
        RIGHT + "stable > critical and from the margin of 0.2 between neighbouring levels",
    ),
    (
        {"k": 3, "margin": 0.5},
        HALF,
        LABELS,
        EVEN + "critical < stable < well and from the margin of 0.5 between neighbouring levels",
    ),
    (
        {"k": 3, "prior": ["0.25 <= e2 <= 0.25"]},
        [0.0, -1.0, 0.25],
        LABELS,
        EVEN + '"e2 <= 0.25" and "0.25 <= e2"',
    ),
]


@pytest.mark.parametrize(
    ("known", "d", "labels", "sentence"), CASES, ids=[case[-1] for case in CASES]
)
def test_what_an_explanation_says(
    known: dict[str, Any], d: list[float], labels: list[str] | None, sentence: str
) -> None:
    found = explained(d, told(**known), labels)
    assert str(found) == sentence
    assert repr(found) == f"<Explanation: {sentence}>"


def test_many_answers_and_levels_are_listed_as_people_do() -> None:
    k = 6
    steps = [
        np.eye(k)[j] * 2 - np.eye(k)[j - 1] - np.eye(k)[j + 1] for j in range(1, k - 1)
    ]  # gaps shrink upwards
    comparator = told(k, [(np.eye(k)[5] - np.eye(k)[3], 1), *((step, 1) for step in steps)])
    far = explained(np.eye(k)[1] - np.eye(k)[0] - np.eye(k)[4] + np.eye(k)[3], comparator)
    assert str(far) == "not asked: left is better, because it follows from your answers 2, 3 and 4"
    assert far.rows == (1, 2, 3)
    assert [used.id for used in far.answers] == ["q1", "q2", "q3"]
    assert [used.multiplier for used in far.answers] == [1, 1, 1]
    answer, more = (
        np.array([2.0, -1.0, 2.0, -1.0, 2.0, 2.0, 2.0]),
        np.array([0.0, 0.0, 2.0, 3.0, 1.5, 0.5, 1.0]),
    )
    five = explained(from_tails(answer + more), told(8, [(from_tails(answer), 1)]))
    assert (
        str(five)
        == "not asked: left is better, because it follows from your answer 1 and from the order of "
        "the levels"
    )
    assert [used.gap for used in five.order] == [2, 3, 4, 5, 6]


def test_steps_are_named_in_chains_and_apart() -> None:
    answer = np.array([2.0, -1.0, 2.0, -1.0, 2.0, 2.0])
    comparator = told(7, [(from_tails(answer), 1)])
    found = explained(
        from_tails(answer + np.array([0.0, 1.0, 2.0, 0.0, 0.0, 3.0])), comparator, list("abcdefg")
    )
    assert (
        str(found)
        == "not asked: left is better, because it follows from your answer 1, from b < c < d and "
        "from g > f"
    )
    assert [(used.gap, used.multiplier) for used in found.order] == [(1, 1), (2, 2), (5, 3)]
    assert str(found.proofs[0]) == (
        "d.e = 1*(d of answer 1).e + 1*(e3 - e2) + 2*(e4 - e3) + 3*(e7 - e6) >= 6e-06"
    )


def test_the_identity_is_printed_with_its_signs() -> None:
    comparator = told(3, [([-0.5, 1.0, -0.5], -1)], prior=["e2 >= 0.25"])
    assert (
        str(explained([0.4, -1.0, 0.6], comparator).proofs[0])
        == "d.e = 1*(-d of answer 1).e + 0.1 >= 0.1"
    )
    assert str(explained([0.0, 1.0, -0.125], comparator).proofs[0]) == (
        'd.e = 1*(A of "e2 >= 0.25").e - 0.125 >= 0.125'
    )


def test_shares_of_a_table_and_its_row_are_taken_and_other_shapes_refused() -> None:
    comparator = told(3, [(HALF, 1)])
    assert explain([HALF], comparator).rows == (0,)
    with pytest.raises(ValueError, match="one difference of shape"):
        explain([HALF, HALF], comparator)
    with pytest.raises(ValueError, match="shape"):
        explain([0.0, 1.0], comparator)
    with pytest.raises(ValueError, match="finite"):
        explain([0.0, np.nan, 1.0], comparator)
    with pytest.raises(ValueError, match="labels must be 3 names"):
        PolytopeComparator(3).explain([1, -2, 1], labels="abc")
    with pytest.raises(ValueError, match="labels must be 3 names"):
        explain(HALF, comparator, ["bad", "good"])


def test_an_explanation_is_a_value() -> None:
    d = np.array(HALF)
    found = explain(d, told(3, [(HALF, 1)]))
    d[0] = 7.0
    assert found.d.tolist() == HALF
    with pytest.raises(ValueError, match="read-only"):
        found.d[0] = 1.0
    again = pickle.loads(pickle.dumps(found))
    assert (str(again), again.proofs) == (str(found), found.proofs)
    assert all(isinstance(x, Fraction) for e in found.scales for x in e)
