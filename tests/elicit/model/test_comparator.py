"""The comparators that learn nothing, the one table of verdicts, and the conformance tests
themselves.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import elicit
from elicit import (
    AlwaysAsk,
    Answers,
    Comparator,
    Decisions,
    Dominance,
    Tier,
    Verdict,
    decide,
    simultaneous_bounds,
    value_bounds,
)
from elicit.decision import comparator_rule
from elicit.decision.comparator_rule import nothing
from elicit.model import comparator_parts as protocols
from elicit.model.comparator import check_levels, offers, verdicts_from
from elicit.model.comparator_parts import (
    OPTIONAL_PARTS,
    AllowsLapses,
    AllowsTies,
    BoundsAllAtOnce,
    PersonAsked,
    PredictsAnswers,
    TrustsDraws,
    draws_in,
)
from elicit.testing import check_comparator, sample_differences
from tests.scale_arithmetic import dominance, dot, tail_sums


@pytest.mark.parametrize(
    "comparator", [make(k) for make in (AlwaysAsk, Dominance) for k in (2, 3, 5, 12)], ids=repr
)
def test_both_conform(comparator):
    check_comparator(comparator)
    check_comparator(comparator, seed=5)


def test_the_table_of_signs():
    least = np.array([-2.0, -2, -2, 0, 0, 1, 0])
    greatest = np.array([-1.0, 0, 3, 0, 2, 2, 0])
    wanted = [
        Verdict.WORSE,
        Verdict.WORSE,
        Verdict.UNKNOWN,
        Verdict.EQUAL,
        Verdict.BETTER,
        Verdict.BETTER,
        0,
    ]
    assert verdicts_from(least, greatest).tolist() == wanted
    assert verdicts_from(least, greatest).dtype == np.int8
    assert verdicts_from(-greatest, -least).tolist() == [2 if v == 2 else -v for v in wanted]


def test_what_they_decide():
    d = [[0, 0, 0], [7, 0, 0], [-1, 0, 1], [1, -1, 0], [1, -2, 1]]
    assert Dominance(3).compare(d).tolist() == [0, 0, 1, -1, 2]
    assert AlwaysAsk(3).compare(d).tolist() == [0, 0, 2, 2, 2]
    verdicts, tiers = decide(AlwaysAsk(3), d)
    assert (verdicts.tolist(), tiers.tolist()[:2]) == ([0, 0, 2, 2, 2], [Tier.EQUAL, Tier.EQUAL])
    assert decide(Dominance(3), d).tiers.tolist()[:4] == [
        Tier.EQUAL,
        Tier.EQUAL,
        Tier.DOMINANCE,
        Tier.DOMINANCE,
    ]
    for comparator in (Dominance(3), AlwaysAsk(3)):
        assert comparator.values.tolist() == [0, 0.5, 1]
        assert np.array(comparator.bounds(d)).tolist() == [[0, 0, 1, -1, -1], [0, 0, 1, 0, 1]]


def test_answers_teach_them_nothing():
    answers = Answers([[1, -2, 1]], [1])
    for comparator in (Dominance(3), AlwaysAsk(3)):
        assert comparator.update(answers) == comparator
        with pytest.raises(ValueError, match="about 3 levels"):
            type(comparator)(4).update(answers)
        with pytest.raises(TypeError, match=r"update takes Answers, not \[\]: Answers\.of"):
            comparator.update([])
    assert isinstance(Dominance(3), Comparator)
    assert Dominance(3) != AlwaysAsk(3)


def test_the_number_of_levels():
    assert type(AlwaysAsk(3.0).k) is int
    assert AlwaysAsk(np.int64(3)).values.shape == (3,)
    assert check_levels(2) == 2


@dataclass(frozen=True)
class OneScale:
    """Believes in one scale: a correct, if bold, comparator, from which the bad ones differ by one
    mistake.
    """

    k: int = 4
    told: int = 0

    @property
    def values(self):
        return np.linspace(0, 1, self.k) ** 2

    def product(self, d):
        return dot(tail_sums(elicit.as_differences(d, self.k)), np.diff(self.values))

    def bounds(self, d):
        x = self.product(d)
        return x, x.copy()

    def compare(self, d):
        codes = dominance(tail_sums(elicit.as_differences(d, self.k)))
        return np.where(codes == 2, np.sign(self.product(d)), codes).astype(np.int8)

    def update(self, answers):
        if answers.k != self.k:
            raise ValueError("levels")
        return type(self)(self.k, self.told + len(answers))


def test_a_bold_comparator_conforms():
    check_comparator(OneScale())
    tiers = decide(OneScale(3), [[0, 0, 0], [1, -1, 0], [1, -3, 2]]).tiers
    assert tiers.tolist() == [Tier.EQUAL, Tier.DOMINANCE, Tier.MODEL], "it has no rule"


def left_open(self, d):
    """Return the flags (n,) of the differences that dominance leaves open."""
    return dominance(tail_sums(elicit.as_differences(d, self.k))) == Verdict.UNKNOWN


def unless(change, verdict):
    """A ``compare`` that is OneScale's but where ``change(self, d, verdicts)`` holds (n,)."""

    def compare(self, d):
        verdicts = OneScale.compare(self, d)
        return np.where(change(self, d, verdicts), verdict(verdicts), verdicts).astype(np.int8)

    return compare


def unknown(verdicts):
    return np.int8(Verdict.UNKNOWN)


class Forgetful(OneScale):
    """The answers go into the old one."""

    seen = 0
    compare = unless(lambda self, d, _: left_open(self, d) & (Forgetful.seen < 2), unknown)

    def bounds(self, d):
        return Dominance(self.k).bounds(d)

    def update(self, answers):
        Forgetful.seen += len(answers)
        return super().update(answers)


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ({"compare": unless(lambda *_: True, np.abs)}, "dominance|-compare"),
        ({"compare": lambda self, d: OneScale.compare(self, d).astype(int)}, "int8"),
        # UNKNOWN below an absolute length
        (
            {"compare": unless(lambda self, d, _: np.abs(self.product(d)) < 1e-3, unknown)},
            "dominance|same sign",
        ),
        # shrinks from deciding a single row
        (
            {"compare": unless(lambda self, d, v: left_open(self, d) & (len(v) == 1), unknown)},
            "compared alone",
        ),
        (
            {"compare": lambda self, d: OneScale.compare(self, np.nan_to_num(np.atleast_2d(d)))},
            "must raise ValueError or TypeError",
        ),
        ({"values": property(lambda self: np.linspace(0, 2, self.k))}, "from 0 to 1"),
        ({"compare": unless(lambda self, d, verdicts: verdicts == 0, unknown)}, "dominance"),
        (
            {
                "compare": unless(
                    lambda self, d, _: (np.atleast_2d(d)[:, 0] > 0.9) & left_open(self, d),
                    np.negative,
                )
            },
            r"level 1|-compare|same sign",
        ),
        (
            {"bounds": lambda self, d: (self.product(d) - 0.01, self.product(d) - 0.02)},
            "of two identical|lo <= hi",
        ),
        (
            {"bounds": lambda self, d: (-np.abs(self.product(d)), np.abs(self.product(d)))},
            "BETTER goes with",
        ),
        (
            {"update": lambda self, answers: type(self)(self.k)},
            "must raise ValueError or TypeError",
        ),
        (
            {"update": lambda self, answers: OneScale.update(self, answers) and None},
            "must return a comparator",
        ),
    ],
)
def test_bad_comparators_are_found_out(bad, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_comparator(type("Bad", (OneScale,), bad)())


def test_what_bad_input_raises_may_be_either_kind_of_error():
    def refuses(self, d):
        try:
            return OneScale.compare(self, d)
        except ValueError as error:
            raise TypeError("no such differences") from error

    check_comparator(type("Own", (OneScale,), {"compare": refuses})())

    def breaks(self, d):
        return OneScale.compare(self, d) if np.shape(d)[-1] == self.k else d[99]

    with pytest.raises(
        AssertionError, match=r"must raise ValueError or TypeError, not IndexError.*as_differences"
    ):
        check_comparator(type("Bad", (OneScale,), {"compare": breaks})())


def test_differences_for_authors_of_comparators():
    assert elicit.as_differences([1, -1, 0], 3).tolist() == [[1.0, -1.0, 0.0]]
    assert elicit.as_differences(np.zeros((0, 3)), 3).shape == (0, 3)
    for wrong, message in (
        ([[1, -1]], r"d must have shape \(n, 3\), one column a level, not \(1, 2\)"),
        (np.zeros((1, 2, 3)), r"not \(1, 2, 3\)"),
        ([[0, 0, 0], [0, np.nan, 0]], "row 1, level 2 is nan"),
        ([[0, 0, np.inf]], "row 0, level 3 is inf"),
        ("abc", "d must be numbers"),
        (None, "d must"),
    ):
        with pytest.raises(ValueError, match=message):
            elicit.as_differences(wrong, 3)


def test_a_member_is_found_without_computing_it():
    class Costly(OneScale):
        @property
        def draws(self):
            raise AssertionError("drawn")

    assert offers(Costly(), "draws")
    assert not offers(OneScale(), "draws")
    assert not offers(type("Without", (Costly,), {"draws": None})(), "draws")
    one = OneScale()
    one.__dict__["lapse"] = 0.1
    assert offers(one, "lapse")

    class HandedOn:
        def __getattr__(self, name):
            return getattr(OneScale(), name)

    assert offers(HandedOn(), "values")
    assert not offers(HandedOn(), "draws")


def test_other_things_are_found_out_too():
    with pytest.raises(AssertionError, match="old comparator"):
        check_comparator(Forgetful())
    with pytest.raises(AssertionError, match="must have k"):
        check_comparator(object())


def test_the_sample_holds_the_hard_cases():
    d = sample_differences(5)
    assert (d == sample_differences(5)).all()
    codes = dominance(tail_sums(d)).tolist()
    assert {0, 1, -1, 2} <= set(codes)
    assert codes.count(2) > 10
    assert np.abs(d.sum(axis=1)).max() < 1e-9
    assert sample_differences(2).shape[1] == 2


def even(self):
    """Three draws of the gaps of OneScale, all the same."""
    g = np.diff(self.values)
    return np.tile(g[:, None], 3), np.full(3, 1 / 3), np.full(3, 10.0)


GOOD_PARTS = {
    "simultaneous_bounds": lambda self, d: (self.product(d), 0.9),
    "draws": property(even),
    "level": 0.9,
    "lapse": 0.1,
    "tie": 0.01,
    "probability": lambda self, d: (np.zeros(len(d)), np.where(self.product(d) > 0, 0.9, 0.1)),
}


def test_a_comparator_with_all_optional_parts_conforms():
    full = type("Full", (OneScale,), GOOD_PARTS)()
    for protocol in (BoundsAllAtOnce, TrustsDraws, AllowsLapses, AllowsTies, PredictsAnswers):
        assert isinstance(full, protocol)
    check_comparator(full)
    check_comparator(type("NotYet", (OneScale,), {"draws": None})())


def drawn(change):
    """Its ``draws``, one of the three parts changed."""
    return {"draws": property(lambda self: change(*even(self)))}


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        (
            {"simultaneous_bounds": lambda self, d: self.product(d)},
            r"Bad\.simultaneous_bounds\(d\) must return upper",
        ),
        (
            {"simultaneous_bounds": lambda self, d: (self.product(d)[:-1], 1.0)},
            r"must return upper bounds \(n,\)",
        ),
        (
            {"simultaneous_bounds": lambda self, d: (self.product(d), 95)},
            "confidence .* must be in 0..1, or nan",
        ),
        (
            {"simultaneous_bounds": lambda self, d: (self.product(d) - 0.1, 1.0)},
            "leave room for some scale",
        ),
        ({"level": 95, "draws": property(even)}, "level, .* must lie between 0 and 1, not 95"),
        ({"lapse": 1.5}, "lapse, .* not 1.5"),
        ({"tie": "1%"}, "tie, .* not '1%'"),
        ({"answers": [1]}, r"answers must be elicit\.Answers over k = 4 levels, not \[1\]"),
        (
            {"probability": lambda self, d: np.full(len(d), 1.5)},
            r"probability .* numbers in 0\.\.1",
        ),
        ({"probability": lambda self, d: np.full(len(d), 0.9)}, "total 1 at most"),
        ({"rule": 1, "compare": OneScale.compare}, "rule must be .*Rule, not int"),
        ({"draws": np.ones((3, 5))}, r"Bad\.draws must be None or a tuple.*, but it is ndarray"),
        (drawn(lambda g, w, c: (g.T, w, c[:2])), r"their shapes are \(3, 3\), \(3,\), \(2,\)"),
        (drawn(lambda g, w, c: (2 * g, w, c)), "the gaps of draw 0 do not total 1"),
        (drawn(lambda g, w, c: (g * np.nan, w, c)), "the gaps of draw 0 do not total 1"),
        (drawn(lambda g, w, c: (g, 2 * w, c)), "the weights range from .* and total 2"),
        (drawn(lambda g, w, c: (g, w, -c)), "the least precision is -10"),
        (drawn(lambda g, w, c: (g.astype(np.float32), w, c)), "their types are float32"),
        (
            drawn(lambda g, w, c: (np.array([[2.0, 2, 2], [-1, -1, -1], [0, 0, 0]]), w, c)),
            "must not be negative",
        ),
    ],
)
def test_bad_optional_parts_are_found_out(bad, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_comparator(type("Bad", (OneScale,), bad)())


BAD_PARTS = {
    "simultaneous_bounds": {"simultaneous_bounds": lambda self, d: None},
    "bounds_above": {
        "simultaneous_bounds": lambda self, d: (self.product(d), 0.9),
        "bounds_above": lambda self, d, enough: (self.product(d) - 0.1, 0.9),
    },
    "bounds_after": {
        "simultaneous_bounds": lambda self, d: (self.product(d), 0.9),
        "bounds_after": lambda self, asked, d, enough: np.full((len(asked), 2, len(d)), -1.0),
    },
    "draws": {"draws": 3},
    "level": {"draws": property(even), "level": 2},
    "confidence": {"confidence": 95},
    "probability": {"probability": lambda self, d: np.full(len(d), 2.0)},
    "cells": {"cells": ()},
    "wrong": {"wrong": -1},
    "lapse": {"lapse": 2},
    "tie": {"tie": -1},
    "unordered": {"unordered": (0, 2)},
    "answers": {"answers": Answers.none(9)},
    "answers_to_next_step": {"answers_to_next_step": 0},
    "learned_in_loop": {"learned_in_loop": lambda self, answers, rule: None},
    "people": {"people": ("ann", "ann")},
    "whom": {"people": ("ann",), "whom": lambda self, d, besides: PersonAsked("ben", d)},
    "rule": {"rule": 3, "compare": OneScale.compare},
    "decide_rest": {
        "rule": nothing(),
        "compare": lambda self, d: decide(self, d).verdicts,
        "decide_rest": lambda self, d: Decisions(
            np.full(len(d), 3, np.int8), np.full(len(d), 6, np.int8)
        ),
    },
}


@pytest.mark.parametrize("part", OPTIONAL_PARTS, ids=lambda part: part.member)
def test_each_optional_part_is_tried_out_and_listed(part):
    with pytest.raises(AssertionError):
        check_comparator(type("Bad", (OneScale,), BAD_PARTS[part.member])())
    assert f"    {part.signature:24}{part.gives[:30]}" in elicit.testing.__doc__
    ours = ", ".join(f"`{name}`" for name in part.offered_by)
    row = f"| `{part.signature}` | {part.gives} | {part.use} | {ours} |\n"
    row = row.replace("|d.e|", r"\|d.e\|")
    assert row in (Path(__file__).parents[3] / "docs/your-own-comparator.md").read_text(
        encoding="utf-8"
    )


def test_the_table_of_optional_parts_is_that_of_the_protocols():
    declared = {}
    for module in (protocols, comparator_rule):
        for name, kind in vars(module).items():
            if (
                getattr(kind, "_is_protocol", False)
                and kind.__module__ == module.__name__
                and name != "Comparator"
            ):
                declared[name] = [member for member in vars(kind) if not member.startswith("_")]
    assert declared == {part.protocol: [part.member] for part in OPTIONAL_PARTS}
    assert set(BAD_PARTS) == {part.member for part in OPTIONAL_PARTS}


def test_answers_are_kept_in_full():
    with pytest.raises(AssertionError, match="answers must be all that it was told, in order"):
        check_comparator(type("Bad", (Dominance,), {"answers": Answers.none(4)})(4))


def test_a_rule_that_leaves_differences_open_needs_decide_rest():
    class Half(OneScale):
        rule = nothing()

        def compare(self, d):
            return decide(self, d).verdicts

        def decide_rest(self, d):
            return Decisions(OneScale.compare(self, d), np.full(len(d), Tier.MODEL, np.int8))

    class Ruled(Half):
        rule = nothing()
        compare = Half.compare

    check_comparator(Ruled())
    for decide_rest, complaint in (
        (
            lambda self, d: Decisions(OneScale.compare(self, d), np.full(len(d), 99, np.int8)),
            "a tier, of elicit.Tier",
        ),
        (
            lambda self, d: Decisions(np.full(len(d), 3, np.int8), np.full(len(d), 6, np.int8)),
            "verdicts must be those",
        ),
    ):
        with pytest.raises(AssertionError, match=complaint):
            check_comparator(type("Bad", (Ruled,), {"decide_rest": decide_rest})())


def test_broken_parts_are_named_where_a_learner_meets_them():
    bad = type("Mine", (OneScale,), {"draws": (1, 2)})()
    with pytest.raises(TypeError, match=r"Mine\.draws must be None or a tuple.* but it is tuple"):
        draws_in(bad)
    assert draws_in(OneScale()) is None
    gaps, weights, precision = even(OneScale())
    chance = type("Mine", (OneScale,), {"draws": (gaps, weights, 0.0 * precision)})()
    assert draws_in(chance)[2].tolist() == [0.0] * 3  # a tutor who answers by chance
    bad = type("Mine", (OneScale,), {"simultaneous_bounds": lambda self, d: None})()
    with pytest.raises(
        TypeError,
        match=r"Mine\.simultaneous_bounds\(d\) must return .* but of 1 differences .* None",
    ):
        simultaneous_bounds(bad, [1, -2, 1, 0])


def test_simultaneous_bounds_lie_within_those_of_the_order():
    d = np.array([[-1.0, 0, 0, 1], [1, -2, 1, 0], [0, 0, 0, 0], [1, 0, 0, -1]])
    for said in (np.inf, 1e300):
        loose = type(
            "Mine",
            (OneScale,),
            {"simultaneous_bounds": lambda self, d, said=said: (np.full(len(d), said), 1.0)},
        )
        high, confidence = simultaneous_bounds(loose(), d)
        assert high.tolist() == [1, 1, 0, -1]
        assert confidence == 1
    tight = np.array([1 + 1e-12, -0.25, 0.0, -1.0])  # rounding is left as it is
    mine = type("Mine", (OneScale,), {"simultaneous_bounds": lambda self, d: (tight, 1.0)})()
    assert simultaneous_bounds(mine, d)[0].tobytes() == tight.tobytes()


def test_bounds_row_by_row_stand_in_for_simultaneous_ones():
    d = np.array([[-1.0, 0, 0, 1], [1, -2, 1, 0], [0, 1, -2, 1]])
    high, confidence = simultaneous_bounds(OneScale(), d)
    assert high.tolist() == OneScale().bounds(d)[1].tolist()
    assert np.isnan(confidence)
    loose = {"bounds": lambda self, d: (np.full(len(d), -9.0), np.full(len(d), 9.0))}
    high, _ = simultaneous_bounds(type("Loose", (OneScale,), loose)(), d)
    assert high.tolist() == [1, 1, 1]  # those of the order


def test_what_answers_would_leave_is_found_on_trial():
    known = elicit.PosteriorComparator(4, particles=100, seed=0)
    asked, d = np.array([[0, 1, 0, -1.0], [-0.5, 1, 0, -0.5]]), np.array([[0, 1, -0.5, -0.5]])
    left = elicit.parts.bounds_after(known, asked, d, 0.0)
    assert left.shape == (2, 2, 1)
    for row in range(2):
        for verdict in (-1, 1):
            told = known.update(Answers(asked[row : row + 1], [verdict]))
            assert left[row, (verdict + 1) // 2] == simultaneous_bounds(told, d)[0]


def test_people_without_whom_are_one_tutor():
    named = type("Named", (Dominance,), {"people": ("ann", "ben")})(4)
    (query,) = elicit.choose([[0, 1, 0, 0], [0.5, 0, 0, 0.5]], named).ask()
    assert query.who is None


def test_bounds_of_values_are_those_of_each_level_against_the_worst() -> None:
    answers = Answers([[0.5, -1.0, 0.5, 0.0], [0.0, 0.5, -1.0, 0.5]], [1, -1])
    polytope = elicit.PolytopeComparator(k=4).update(answers)
    low, high = value_bounds(polytope)
    for level in range(4):
        least, most = polytope.bounds([[-float(level > 0), *(np.arange(1, 4) == level)]])
        assert (low[level], high[level]) == pytest.approx((least[0], most[0]), abs=1e-9)
    assert (low[0], high[0], low[-1], high[-1]) == pytest.approx((0, 0, 1, 1), abs=1e-9)
    low, high = value_bounds(Dominance(k=3))
    assert list(zip(low, high, strict=True)) == [(0, 0), (0, 1), (1, 1)]
