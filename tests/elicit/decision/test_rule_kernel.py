"""Compiled loops get the verdicts that the comparator gives."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from elicit import (
    Answers,
    BradleyTerryComparator,
    Comparator,
    Dominance,
    FlippingTutor,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    Verdict,
    decide,
)
from elicit.decision.comparator_rule import NO_ARRAYS, PROVEN, nothing, rule_of
from elicit.decision.rule_kernel import by_rule, certifies, within
from elicit.decision.verdicts import decide_by_rule
from elicit.model.difference_kernel import LEFT_OPEN
from tests.noisy_cases import pairs
from tests.scale_arithmetic import tail_sums

NOWHERE = np.empty(0)
K = 6
MAKERS: dict[str, Callable[[int], Comparator]] = {
    "polytope": PolytopeComparator,
    "polytope, margin 0, prior": lambda k: PolytopeComparator(
        k, margin=0.0, prior=["e4 >= 2*e2", "e5 - e4 >= 0.05"]
    ),
    "posterior": lambda k: PosteriorComparator(k, lapse=0.1, particles=200),
    "ensemble": lambda k: BradleyTerryComparator(k, precision=100, n_boot=40, region="ensemble"),
    "box": lambda k: BradleyTerryComparator(k, precision=100, n_boot=40, region="box"),
    "dominance": Dominance,
}


def told(name: str, n: int, seed: int) -> Comparator:
    rng = np.random.default_rng(seed)
    values = np.array([0.0, 3.0, 7.0, 20.0, 26.0, 40.0])
    errs = name in ("posterior", "ensemble", "box")
    tutor = FlippingTutor(values, 0.1, seed=1) if errs else TruthfulTutor(values)
    comparator: Comparator = MAKERS[name](K)
    d = pairs(rng, K, n)
    return comparator.update(Answers(d, tutor.signs(d)))


@pytest.mark.parametrize("n", [0, 3, 40])
@pytest.mark.parametrize("name", MAKERS)
def test_judges_as_the_comparator_does(name: str, n: int) -> None:
    comparator = told(name, n, seed=n)
    d = pairs(np.random.default_rng(7), K, 400)
    verdicts = comparator.compare(d)
    settled = 0
    for row, t, verdict in zip(d, tail_sums(d), verdicts, strict=True):
        found, _, _ = by_rule(row, t.copy(), 0.0, NOWHERE, rule_of(comparator))
        settled += found != LEFT_OPEN
        assert found in (verdict, LEFT_OPEN)
    assert settled > 0.99 * len(d)
    if n == 40 and name != "dominance":
        assert (np.abs(verdicts) == 1).sum() > (0 if name == "box" else 20)  # the box is blunt


@pytest.mark.parametrize("name", [name for name in MAKERS if name != "dominance"])
def test_what_lies_above_a_certificate_has_its_verdict(name: str) -> None:
    comparator, rng = told(name, 40, seed=3), np.random.default_rng(8)
    found, beyond = 0, []
    for row, t in zip(d := pairs(rng, K, 300), tail_sums(d), strict=True):
        low = np.empty(K - 1)
        verdict, _, certified = by_rule(row, t.copy(), 0.0, low, rule_of(comparator))
        if not certified:
            continue
        found += 1
        assert abs(verdict) == 1
        assert certifies(low[None, :], 0, verdict, t)
        below = np.where(np.arange(K - 1) == 2, verdict * low - verdict * 1e-9, t)
        assert not certifies(low[None, :], 0, verdict, below)
        for other in (low, low + rng.exponential(0.02, K - 1), np.maximum(low, verdict * t - 1e-3)):
            moved = np.concatenate([[0.0], verdict * other - np.append(verdict * other[1:], 0.0)])
            if certifies(
                low[None, :], 0, verdict, tail_sums(moved[None, :])[0]
            ):  # rounding may leave it below
                beyond.append((verdict, moved))
    if name in ("ensemble", "box"):
        assert not found
        return
    assert found > 50
    assert len(beyond) > 100
    again = comparator.compare(np.array([d for _, d in beyond]))
    assert (again == [verdict for verdict, _ in beyond]).all()


@pytest.mark.parametrize("indifference", [0.0005, 0.02, 0.2])
@pytest.mark.parametrize("name", MAKERS)
def test_indifference_is_that_of_the_bounds(name: str, indifference: float) -> None:
    comparator = told(name, 40, seed=4)
    d = pairs(np.random.default_rng(9), K, 200)
    d[100:] *= 0.1
    low, high = comparator.bounds(d)
    sure = 1e-9
    close = (low >= -indifference + sure) & (high <= indifference - sure)
    far = (low < -indifference - sure) | (high > indifference + sure)
    for i, (row, t) in enumerate(zip(d, tail_sums(d), strict=True)):
        found = within(row, t.copy(), indifference, rule_of(comparator))
        if found != LEFT_OPEN and (close[i] or far[i]):
            assert found == (Verdict.EQUAL if close[i] else Verdict.UNKNOWN)
    if indifference == 0.2:
        assert close.any()


def test_a_union_of_polytopes_leaves_all_to_the_comparator() -> None:
    comparator = PolytopeComparator(K, wrong=1).update(told("polytope", 8, seed=5).answers)
    assert len(comparator.cells) > 1
    ask = pairs(np.random.default_rng(5), K, 50)
    rule = rule_of(comparator)
    for row, t in zip(ask, tail_sums(ask), strict=True):
        assert by_rule(row, t.copy(), 0.0, NOWHERE, rule)[0] == LEFT_OPEN
    assert (np.abs(comparator.compare(ask)) == 1).any()


@pytest.mark.parametrize("name", ["ensemble", "box", "posterior", "polytope"])
def test_verdicts_do_not_depend_on_the_scale_of_a_difference(name: str) -> None:
    comparator = told(name, 40, seed=5)
    d = pairs(np.random.default_rng(6), K, 200)
    want = comparator.compare(d)
    assert set(want.tolist()) >= ({-1, 1, 2} if name != "box" else {2})
    for power in (-1000, -950, -40, 3, 990, 999):
        assert (comparator.compare(np.ldexp(d, power)) == want).all()
        assert np.isfinite(comparator.bounds(np.ldexp(d, power))).all()


def test_a_rule_that_leaves_differences_open_needs_a_comparator_that_settles_them() -> None:
    with pytest.raises(TypeError, match=r"decide_rest\(d\)"):
        decide_by_rule(nothing(), pairs(np.random.default_rng(1), K, 3))


def test_a_class_that_compares_in_its_own_way_has_no_rule() -> None:
    class Blind(PolytopeComparator):
        def compare(self, d: ArrayLike) -> NDArray[np.int8]:
            return np.where(
                super().compare(d) == Verdict.UNKNOWN, np.int8(2), Dominance(self.k).compare(d)
            )

    class Named(PolytopeComparator):
        pass

    assert rule_of(Blind(K)).kind == NO_ARRAYS
    assert (decide(Blind(K), np.eye(K)[:2]).verdicts == Blind(K).compare(np.eye(K)[:2])).all()
    assert rule_of(Named(K)).kind == rule_of(PolytopeComparator(K)).kind == PROVEN
