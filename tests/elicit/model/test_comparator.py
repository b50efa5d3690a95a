"""The comparators that learn nothing, the one table of verdicts, and the conformance tests themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from elicit.comparators.baselines import AlwaysAsk, Dominance
from elicit.decision.decide import decide
from elicit.model.comparator import Comparator, Decisions, Tier, check_levels, verdicts_from
from elicit.model.query import Answers, Verdict
from elicit.model.scale import as_vectors, dominance, dot, tail_sums
from elicit.testing import check_comparator, sample_differences


@pytest.mark.parametrize("k", [2, 3, 5, 12])
@pytest.mark.parametrize("make", [AlwaysAsk, Dominance])
def test_both_conform(make, k):
    check_comparator(make(k))
    check_comparator(make(k), seed=5)


def test_the_table_of_signs():
    least = np.array([-2.0, -2, -2, 0, 0, 1, 0])
    greatest = np.array([-1.0, 0, 3, 0, 2, 2, 0])
    wanted = [Verdict.WORSE, Verdict.WORSE, Verdict.UNKNOWN, Verdict.EQUAL, Verdict.BETTER, Verdict.BETTER, 0]
    assert verdicts_from(least, greatest).tolist() == wanted
    assert verdicts_from(least, greatest).dtype == np.int8
    assert verdicts_from(-greatest, -least).tolist() == [2 if v == 2 else -v for v in wanted]


def test_what_they_decide():
    d = [[0, 0, 0], [7, 0, 0], [-1, 0, 1], [1, -1, 0], [1, -2, 1]]
    assert Dominance(3).compare(d).tolist() == [0, 0, 1, -1, 2]
    assert AlwaysAsk(3).compare(d).tolist() == [0, 0, 2, 2, 2]
    assert decide(Dominance(3), d).tiers.tolist()[:4] == [Tier.EQUAL, Tier.EQUAL, Tier.DOMINANCE, Tier.DOMINANCE]
    for comparator in (Dominance(3), AlwaysAsk(3)):
        assert comparator.values.tolist() == [0, 0.5, 1]
        low, high = comparator.bounds(d)
        assert low.tolist() == [0, 0, 1, -1, -1]
        assert high.tolist() == [0, 0, 1, 0, 1]


def test_a_comparator_may_know_its_own_tiers():
    class Knowing(Dominance):
        def decide(self, d):
            verdicts = self.compare(d)
            return Decisions(verdicts, np.full(len(verdicts), Tier.SCREEN, dtype=np.int8))

    assert decide(Knowing(3), [[-1, 0, 1]]).tiers.tolist() == [Tier.SCREEN]


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
    for bad in (1, 0, -3, 2.5, "3", None, True, np.nan, np.inf):
        with pytest.raises(ValueError, match="number of levels"):
            Dominance(bad)


# --- the conformance tests find what is wrong


@dataclass(frozen=True)
class OneScale:
    """Believes in one scale: a correct, if bold, comparator, from which the bad ones differ by one mistake."""

    k: int = 4
    told: int = 0

    @property
    def values(self):
        return np.linspace(0, 1, self.k) ** 2

    def product(self, d):
        return dot(tail_sums(as_vectors(d, self.k)), np.diff(self.values))

    def bounds(self, d):
        x = self.product(d)
        return x, x.copy()

    def compare(self, d):
        codes = dominance(tail_sums(as_vectors(d, self.k)))
        return np.where(codes == 2, np.sign(self.product(d)), codes).astype(np.int8)

    def update(self, answers):
        if answers.k != self.k:
            raise ValueError("levels")
        return type(self)(self.k, self.told + len(answers))


def test_a_bold_comparator_conforms():
    check_comparator(OneScale())


class NoNegative(OneScale):
    def compare(self, d):
        return np.abs(super().compare(d)).astype(np.int8)


class WrongType(OneScale):
    def compare(self, d):
        return super().compare(d).astype(int)


class Loud(OneScale):
    """UNKNOWN below an absolute length."""

    def compare(self, d):
        return np.where(np.abs(self.product(d)) < 1e-3, 2, super().compare(d)).astype(np.int8)


class Batchy(OneScale):
    """Shrinks from deciding a single row."""

    def compare(self, d):
        verdicts = super().compare(d)
        settled = (dominance(tail_sums(as_vectors(d, self.k))) != 2) | (len(verdicts) > 1)
        return np.where(settled, verdicts, 2).astype(np.int8)


class NotANumber(OneScale):
    def compare(self, d):
        d = np.nan_to_num(np.atleast_2d(d))
        return super().compare(d)


class Forgetful(OneScale):
    """The answers go into the old one."""

    seen = 0

    def compare(self, d):
        verdicts = super().compare(d)
        return np.where((dominance(tail_sums(as_vectors(d, self.k))) == 2) & (Forgetful.seen < 2), 2, verdicts).astype(
            np.int8
        )

    def bounds(self, d):
        t = tail_sums(as_vectors(d, self.k))
        return t.min(axis=-1), t.max(axis=-1)

    def update(self, answers):
        Forgetful.seen += len(answers)
        return super().update(answers)


class WideValues(OneScale):
    @property
    def values(self):
        return np.linspace(0, 2, self.k)


class UnsureOfZero(OneScale):
    def compare(self, d):
        verdicts = super().compare(d)
        return np.where(verdicts == 0, 2, verdicts).astype(np.int8)


class LevelOne(OneScale):
    def compare(self, d):
        d = as_vectors(d, self.k)
        odd = (d[:, 0] > 0.9) & (dominance(tail_sums(d)) == 2)
        return np.where(odd, -super().compare(d), super().compare(d)).astype(np.int8)


class BadBounds(OneScale):
    def bounds(self, d):
        x = self.product(d)
        return x - 0.01, x - 0.02


class NarrowBounds(OneScale):
    def bounds(self, d):
        x = self.product(d)
        return -np.abs(x), np.abs(x)


class Careless(OneScale):
    def update(self, answers):
        return type(self)(self.k)


class Nothing(OneScale):
    def update(self, answers):
        super().update(answers)


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        (NoNegative, "dominance|-compare"),
        (WrongType, "int8"),
        (Loud, "dominance|same sign"),
        (Batchy, "compared alone"),
        (NotANumber, "must raise ValueError"),
        (Forgetful, "old comparator"),
        (WideValues, "from 0 to 1"),
        (UnsureOfZero, "dominance"),
        (LevelOne, r"level 1|-compare|same sign"),
        (BadBounds, "bounds of two identical vectors|lo <= hi"),
        (NarrowBounds, "BETTER goes with"),
        (Careless, "must raise ValueError"),
        (Nothing, "must return a comparator"),
    ],
)
def test_bad_comparators_are_found_out(bad, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_comparator(bad())


def test_what_is_no_comparator():
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
