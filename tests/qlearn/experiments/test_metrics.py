"""Each metric is held to a case worked out by hand."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from elicit import AlwaysAsk, Answers, Decisions, Query, Tier, Verdict
from elicit.asking.question import Audit
from qlearn import Guarantee, OrdinalMDP, Result, Status, random_mdp, value_iteration
from qlearn.experiments.metrics import (
    Watch,
    audits,
    counts,
    estimated_values,
    greatest_reward,
    half_width,
    means,
    paper_loss,
    reference_differences,
)
from tests.scale_arithmetic import Floats, normalise, tail_sums

VALUES = (10.0, 20.0, 50.0)  # normalised: 0, 1/4, 1


def decided(verdicts: Sequence[int], tier: Tier = Tier.MODEL) -> Decisions:
    return Decisions(np.array(verdicts, dtype=np.int8), np.full(len(verdicts), tier, dtype=np.int8))


# d.e is .5 * 1 - .5 * .25 = .375; its opposite; and .02 * 1 - .1 * .25 = -.005, close
DIFFERENCES = np.array([[0.0, -0.5, 0.5], [0.0, 0.5, -0.5], [0.08, -0.1, 0.02]])


PROVEN = ("SCREEN", "SIMPLEX", "LP", "EXACT", "MODEL")
TIE = np.array([[0.75, -1.0, 0.25]])  # d.e is .25 * 1 - 1 * .25 = 0


@pytest.mark.parametrize(
    ("d", "said", "indifference", "tier", "counts"),
    [
        (DIFFERENCES, [1, 1, -1], 0.0, Tier.MODEL, (3, 1)),
        (DIFFERENCES, [1, -1, 1], 0.0, Tier.MODEL, (3, 1)),
        (DIFFERENCES, [1, -1, 1], 0.01, Tier.MODEL, (2, 0)),  # the third is within the indifference
        (TIE, [1], 0.0, Tier.MODEL, (0, 0)),
        (DIFFERENCES, [Verdict.EQUAL, Verdict.UNKNOWN, Verdict.BETTER], 0.0, Tier.LP, (1, 1)),
        *(
            (DIFFERENCES, [-1, 1, 1], 0.0, tier, (3, 3) if tier.name in PROVEN else (0, 0))
            for tier in Tier
        ),
    ],
)
def test_watch_counts_what_the_answers_decided_against_the_hidden_scale(
    d: Floats, said: list[int], indifference: float, tier: Tier, counts: tuple[int, int]
) -> None:
    watch = Watch(VALUES, indifference)
    watch(d, decided(said, tier))
    assert watch.counts == (*counts, 0, 0)


def test_watch_splits_at_the_tutors_first_wrong_answer() -> None:
    erred = [False]
    watch = Watch(VALUES, erred=lambda: erred[0])
    watch(DIFFERENCES[:2], decided([-1, -1]))
    erred[0] = True
    watch(DIFFERENCES, decided([-1, 1, 1]))
    assert watch.counts == (2, 1, 3, 3)
    assert watch.counts._fields == ("judged_before", "wrong_before", "judged_after", "wrong_after")


def test_watch_judges_many_small_calls_like_one() -> None:
    rng = np.random.default_rng(0)
    d = rng.dirichlet(np.ones(3), 6000) - rng.dirichlet(np.ones(3), 6000)
    said = rng.choice([-1, 1], 6000)
    one, many = Watch(VALUES, 0.01), Watch(VALUES, 0.01)
    one(d, decided(list(said)))
    for i in range(6000):
        many(d[i : i + 1], decided([said[i]]))
    true = d @ normalise(VALUES)
    far = np.abs(true) > 0.01
    assert one.counts == many.counts == (far.sum(), (far & (np.sign(true) != said)).sum(), 0, 0)


ONE_STATE = OrdinalMDP([[[0]]], [[[1.0]]], [[0]], 0.5, ["low", "middle", "high"])


def result(decided: dict[str, int], asked: int = 0, checked: tuple[Audit, ...] = ()) -> Result:
    nothing: dict[str, Any] = {
        "policy": np.zeros(1, np.int64),
        "shares": np.zeros((1, 1, 3)),
        "cannot_tell": 0,
    }
    nothing |= {
        "comparator": AlwaysAsk(3),
        "answers": Answers.none(3),
        "status": Status.DONE,
        "rounds": 7,
    }
    nothing |= {"guarantee": lambda: Guarantee(np.nan, np.nan), "mdp": ONE_STATE}
    tiers = {tier.name.lower(): 0 for tier in Tier} | decided
    return Result(asked=asked, decided=tiers, audits=checked, **nothing)


def test_counts_name_every_denominator() -> None:
    row = counts(result({"equal": 10, "dominance": 50, "lp": 36, "tutor": 4}, asked=4))
    assert (row["asked_percent_all"], row["asked_percent_unequal"], row["asked_percent_open"]) == (
        4.0,
        400 / 90,
        10.0,
    )
    assert row["compared"] == 100
    assert (row["equal"], row["lp"], row["guess"]) == (10, 36, 0)
    assert (row["status"], row["rounds"]) == ("done", 7)
    row = counts(result({"equal": 3}))  # no comparisons, no percentage
    assert row["asked_percent_all"] == 0
    assert math.isnan(row["asked_percent_unequal"])
    assert math.isnan(row["asked_percent_open"])


def audit(d: Floats, expected: int, answer: int | None) -> Audit:
    query = Query.make("", 0, d, np.zeros(3))
    return Audit(query, Verdict(expected), None if answer is None else Verdict(answer))


@pytest.mark.parametrize(
    ("d", "expected", "answer", "guilty"),
    [
        (DIFFERENCES[0], 1, -1, "audit"),
        (DIFFERENCES[0], -1, 1, "answers"),
        (TIE[0], 1, -1, "neither"),
    ],
    ids=["audit", "answers", "neither"],
)
def test_the_first_contradiction_is_blamed_on_who_was_wrong(
    d: Floats, expected: int, answer: int, guilty: str
) -> None:
    better = DIFFERENCES[0]
    agreed = (audit(better, 1, 1), audit(better, 1, None))
    row = audits(
        result({}, checked=(*agreed, audit(d, expected, answer), audit(better, 1, -1))), VALUES
    )
    assert row == {"audited": 4, "audits_to_contradiction": 3, "contradiction_due_to": guilty}
    row = audits(result({}, checked=agreed), VALUES)
    assert math.isnan(row.pop("audits_to_contradiction"))
    assert row == {"audited": 2, "contradiction_due_to": ""}


def small_mdp() -> OrdinalMDP:
    """Two states; from the second the third action is inadmissible, and it alone bears the best
    level.
    """
    return OrdinalMDP(
        np.zeros((2, 3, 1), dtype=int), np.ones((2, 3, 1)), [[0, 1, 1], [1, 0, 2]], 0.5,
        ("low", "middle", "high"),
        admissible=[[True, True, True], [True, True, False]],
    )  # fmt: skip


def test_the_papers_loss_by_hand() -> None:
    mdp = small_mdp()
    q = np.array(
        [[[1, 0, 0], [0.5, 0.5, 0], [0.2, 0.8, 0]], [[0, 1, 0], [1, 0, 0], [0, 0, 1]]], dtype=float
    )
    # shares / (1 - discount) on raw values: 2 * (.2 * 10 + .8 * 20) = 36, and 2 * 20, the best
    # level being barred
    v = estimated_values(mdp, q, VALUES)
    assert v.tolist() == pytest.approx([36.0, 40.0])
    # the greatest reward that can be had is 20: 100 * ((36 - 40) + (40 - 40)) / (2 * 20)
    best = greatest_reward(mdp, VALUES)
    assert paper_loss(v, np.array([40.0, 40.0]), best) == pytest.approx(-10.0)
    assert paper_loss(v, v, best) == 0.0
    assert (
        greatest_reward(mdp, (-5.0, 0.0, 7.0)) == 0
    )  # the best level cannot be had, and the loss is not defined
    assert math.isnan(paper_loss(v, v, 0.0))


def test_reference_differences_are_open_and_against_an_optimal_action() -> None:
    mdp, values = random_mdp(12, 3, 4, rng=1)
    d = reference_differences(mdp, values)
    t: Any = tail_sums(d)
    assert 0 < len(d) <= 24
    assert ((t > 0).any(axis=1) & (t < 0).any(axis=1)).all()
    assert (d @ normalise(values) <= 1e-12).all()
    v, policy = value_iteration(mdp, values)
    e = normalise(values)
    q = 0.05 * e[mdp.levels] + 0.95 * (mdp.transitions @ v).reshape(mdp.levels.shape)
    losses = np.sort((q - q[np.arange(12), policy][:, None]).ravel())
    assert all(np.abs(losses - x).min() < 1e-8 for x in d @ e)


@pytest.mark.parametrize("n", [2, 3, 20])
def test_intervals_are_those_of_the_t_test_at_95_percent(n: int) -> None:
    x = np.random.default_rng(n).normal(3.0, 2.0, n)
    low, high = stats.ttest_1samp(x, 0.0).confidence_interval(0.95)
    assert half_width(x) == pytest.approx((high - low) / 2)
    frame = pd.DataFrame({"of": "one", "x": [*x, np.nan], "alone": [2.0] + [np.nan] * n})
    (row,) = means(frame.groupby("of"), ["x", "alone"]).itertuples()  # what is nan is left out
    assert (row.x, row.x_half, row.alone) == pytest.approx((x.mean(), half_width(x), 2.0))
    assert math.isnan(row.alone_half)
    assert math.isnan(half_width(x[:1]))
