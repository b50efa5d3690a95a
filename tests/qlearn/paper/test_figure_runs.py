"""The paper's figures: the rows do not depend on how they were computed, and what is said of them
can be recomputed.
"""

import math
import re
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from qlearn import random_mdp
from qlearn.experiments.ablation import ablate
from qlearn.experiments.metrics import reference_differences
from qlearn.experiments.settings import FiguresSettings
from qlearn.paper.claims import (
    FAILS,
    HOLDS,
    MEASURES,
    OPEN,
    claims,
    claims_page,
    error_rates,
    series_of,
    summarise_series,
)
from qlearn.paper.figure_runs import KEYS, figures, plan_of
from tests.thoroughness import scaled

STEPS = scaled(120, 250)
TINY: dict[str, Any] = {
    "levels": (3, 5), "at_states": 8, "states": (8, 12), "at_levels": 5, "actions": 3, "seeds": 2,
    "steps": STEPS,
    "n_boot": 10, "particles": 50, "thinned": (),
}  # fmt: skip


@pytest.fixture(scope="module")
def frame() -> pd.DataFrame:
    return figures(**TINY, tutors=["10%"], jobs=1)


def test_one_row_a_run_and_a_problem_of_both_series_once(frame: pd.DataFrame) -> None:
    assert len(frame) == 3 * 5 * 2  # sizes, comparators with the oracle, seeds
    assert not frame.duplicated(list(KEYS)).any()
    certain = frame.comparator.isin(["always", "polytope"])
    assert set(frame.errs[certain]) == {"truthful"}
    assert set(frame.error_rate[certain]) == {0.0}
    assert set(frame.errs[~certain]) == {"10%"}
    assert set(frame.error_rate[~certain]) == {0.1}
    assert (frame.guess == 0).all()  # no budget
    assert (frame.rounds == STEPS).all()


def test_with_a_truthful_tutor_the_polytope_loses_exactly_nothing(frame: pd.DataFrame) -> None:
    rows = frame[frame.comparator == "polytope"]
    for measure in ("paper_loss_percent", "paper_abs_percent", "excess_loss"):
        assert (rows[measure] == 0).all()
    assert (rows.judged_before > 0).all()
    told = claims(frame)
    assert len(told) == 4 * (
        2 * 4 + 3
    )  # comparators; denominators of figures 2 and 3; losses of figure 4
    polytope = told[(told.figure == 4) & (told.comparator == "polytope")]
    assert (polytope[["estimate", "low", "high", "worst"]] == 0).all(axis=None)
    assert (polytope.answer == HOLDS).all()
    others = frame[frame.comparator.isin(["posterior", "box"])]
    assert (others.paper_loss_percent != 0).any()  # else this says nothing
    assert (others.paper_loss_percent.abs() <= others.paper_abs_percent + 1e-12).all()


def test_every_denominator(frame: pd.DataFrame) -> None:
    unequal = frame.compared - frame.equal
    np.testing.assert_allclose(frame.asked_percent_all, 100 * frame.asked / frame.compared)
    np.testing.assert_allclose(frame.asked_percent_unequal, 100 * frame.asked / unequal)
    np.testing.assert_allclose(
        frame.asked_percent_open, 100 * frame.asked / (unequal - frame.dominance)
    )
    fresh = unequal - frame.dominance - frame.known
    np.testing.assert_allclose(frame.asked_percent_fresh, 100 * frame.asked / fresh)


def test_runs_of_one_seed_are_those_of_the_ablation(frame: pd.DataFrame) -> None:
    """The other command gives the same run: nothing is computed in two ways."""
    settings = {
        "noise": "logistic",
        "max_queries": None,
        "refit_growth": 0.2,
        "steps": STEPS,
        "n_boot": 10,
    }
    other = ablate(
        problems=["random"], learners=["q-learning"], comparators=["box"], error_rates=[0.1],
        audit=0.0, seeds=1,
        states=8, actions=3, levels=5, jobs=1, **settings,
    )  # fmt: skip
    (one,) = other[other.comparator == "box"].to_dict("records")
    (two,) = frame.query(
        "comparator == 'box' and states == 8 and levels == 5 and seed == 0"
    ).to_dict("records")
    for name in (
        "asked",
        "model",
        "loss",
        "realised_error_rate",
        "paper_loss_percent",
        "excess_loss",
    ):
        assert one[name] == two[name]


def test_several_tutors_and_some_comparators() -> None:
    part = TINY | {
        "levels": (3,),
        "states": (8,),
        "at_levels": 3,
        "seeds": 1,
        "comparators": ["box"],
    }
    rows = figures(**part, tutors=["2%", "truthful", "c=1"], jobs=1)
    assert [(row.comparator, row.errs) for row in rows.itertuples()] == [
        ("always", "truthful"), ("box", "truthful"), ("box", "c=1"), ("box", "2%")
    ]  # fmt: skip
    assert rows.error_rate.tolist()[:2] == [0.0, 0.0]
    assert rows.error_rate.tolist()[3] == 0.02


def test_what_is_named_twice_is_run_once() -> None:
    twice = {
        "comparators": ["box", "box"],
        "tutors": ["2%", "2%", "10%"],
        "levels": (3, 3, 5),
        "states": (8, 8, 12),
    }
    once = {"comparators": ["box"], "tutors": ["2%", "10%"], "levels": (3, 5), "states": (8, 12)}
    assert plan_of(FiguresSettings(**TINY | twice)) == plan_of(FiguresSettings(**TINY | once))


def test_c_is_the_papers_on_counts_and_values_as_they_are() -> None:
    part = TINY | {
        "levels": (5,),
        "states": (8,),
        "at_levels": 5,
        "seeds": 1,
        "comparators": ["box"],
    }
    row = figures(**part, tutors=["c=1"], jobs=1).query("comparator == 'box'").iloc[0]
    mdp, values = random_mdp(8, 3, 5, 0.95, seed=0)
    counts = reference_differences(mdp, values) / (1 - 0.95)
    wrong = 1 / (1 + np.exp(np.abs(counts @ values)))  # eq. (6), of the answer that is less likely
    assert row.error_rate == pytest.approx(wrong.mean())
    assert row.error_rate > 0


def test_between_the_first_and_the_last_precision_every_other_size_is_enough() -> None:
    plan = plan_of(FiguresSettings(seeds=1))

    def sizes(comparator: str, errs: str) -> list[tuple[int, int]]:
        chosen = [cell for cell in plan if (cell["comparator"], cell["errs"]) == (comparator, errs)]
        return [(cell["states"], cell["levels"]) for cell in chosen]

    every = [
        (100, 5),
        (100, 10),
        (100, 15),
        (100, 20),
        (100, 25),
        (200, 20),
        (300, 20),
        (400, 20),
        (500, 20),
    ]
    some = [(100, 5), (100, 15), (100, 20), (100, 25), (300, 20), (500, 20)]
    for arm in (
        ("always", "truthful"),
        ("polytope", "truthful"),
        ("box", "truthful"),
        ("box-rescaled", "10%"),
    ):
        assert sizes(*arm) == every, arm
    for arm in (
        ("box", "c=1"),
        ("box-rescaled", "2%"),
        ("box", "5%"),
        ("posterior", "truthful"),
        ("posterior", "10%"),
    ):
        assert sizes(*arm) == some, arm
    assert sizes("posterior", "5%") == sizes("polytope", "10%") == []


def test_errors_are_told_of_the_reference_and_of_the_answers_given(frame: pd.DataFrame) -> None:
    told = error_rates(frame).set_index("comparator")
    assert told.index.tolist() == ["posterior", "box-rescaled", "box"]
    assert told.reference.tolist() == pytest.approx([10.0] * 3)
    box = frame[frame.comparator == "box"]
    by_size = 100 * box.groupby(["states", "levels"]).realised_error_rate.mean()
    assert told.realised["box"] == pytest.approx(by_size.mean())
    assert (told.realised_low["box"], told.realised_high["box"]) == pytest.approx(
        (by_size.min(), by_size.max())
    )


def test_warnings_are_counted_not_shown() -> None:
    part = TINY | {
        "levels": (3,),
        "states": (8,),
        "at_levels": 3,
        "seeds": 1,
        "comparators": ["box"],
        "steps": 250,
    }
    quiet, loud = (
        figures(**part, tutors=["10%"], jobs=1, precision=precision) for precision in (300.0, 1e300)
    )
    assert (quiet.warnings == 0).all()
    assert loud.warnings[loud.comparator == "box"].item() > 0


def made_up(slope: float, loss: float, seeds: int = 6, noise: float = 0.2) -> pd.DataFrame:
    """Rows of both series in which what is asked rises by ``slope`` a level and a hundred
    states.
    """
    rng = np.random.default_rng(3)
    rows = []
    for n, k in [(100, 5), (100, 10), (100, 20), (200, 20), (300, 20)]:
        for seed in range(seeds):
            percent = 30 + slope * (k + n / 100) + noise * rng.normal()
            row = {
                "states": n,
                "levels": k,
                "comparator": "box",
                "errs": "10%",
                "error_rate": 0.1,
                "seed": seed,
            }
            row |= {
                f"asked_percent_{name}": percent for name in ("all", "unequal", "open", "fresh")
            }
            row |= {
                "paper_loss_percent": loss + 0.01 * rng.normal(),
                "paper_abs_percent": abs(loss),
            }
            rows.append(
                row
                | {"excess_loss": loss / 100, "loss": 0.01, "asked": 7, "realised_error_rate": 0.3}
            )
    return pd.DataFrame(rows)


@pytest.mark.parametrize(
    ("figure", "name", "step", "fixed"),
    [(2, "levels", 5, "states == 100"), (3, "states", 100, "levels == 20")],
)
def test_the_trend_is_the_mean_slope_of_the_seeds_with_its_interval(
    figure: int, name: str, step: int, fixed: str
) -> None:
    rows = made_up(0.02, 0.5)
    told = claims(rows).query(f"figure == {figure} and measure == 'asked_percent_open'").iloc[0]
    slopes = []
    for _, part in rows.query(fixed).groupby("seed"):
        slopes.append(step * np.polyfit(part[name], part.asked_percent_open, 1)[0])
    low, high = stats.t.interval(0.95, 5, np.mean(slopes), stats.sem(slopes))
    assert (told.estimate, told.low, told.high) == pytest.approx((np.mean(slopes), low, high))
    assert told.agreeing == sum(np.sign(slopes) == np.sign(told.estimate))
    assert (told.statistic, told.runs) == (f"slope per {step} {name}", 6)


@pytest.mark.parametrize(
    ("slope", "noise", "answer"), [(0.5, 0.1, HOLDS), (-0.5, 0.1, FAILS), (0.0, 0.5, OPEN)]
)
def test_its_sign_is_told_as_it_is(slope: float, noise: float, answer: str) -> None:
    told = claims(made_up(slope, 0.0, noise=noise))
    assert (told.answer[told.figure == 2] == answer).all()
    assert told.answer[told.figure == 3].nunique() == 1
    page = claims_page(made_up(slope, 0.0, noise=noise).assign(rounds=7000))
    assert page.count(f"| {answer} (") >= 4
    by_tutor = page.split("## Each claim at each precision")[1].split("\n\n## ")[
        0
    ]  # an answer a column
    found = [
        [cell.strip() for cell in line.split("|")]
        for line in by_tutor.splitlines()
        if line.startswith("|")
    ]
    head, box = found[0], next(cells for cells in found if cells[1] == "2" and cells[3] == "box")
    assert (box[2], box[head.index("10%")]) == ("of all comparisons", answer)
    assert "\n6 runs a point, 7,000 steps each; 95% t-intervals" in page
    assert max(map(len, page.splitlines())) <= 120
    for table in page.split("\n\n"):  # to read as text too
        assert len({len(line) for line in table.splitlines() if line.startswith("|")}) <= 1
    assert "30.0% (30.0 to 30.0)" in page  # of the answers given


@pytest.mark.parametrize(
    ("loss", "answer"),
    [(0.5, HOLDS), (-0.5, HOLDS), (3.0, FAILS), (-3.0, FAILS), (1.0, OPEN)],
)
def test_the_bound_is_held_to_the_interval_of_every_size(loss: float, answer: str) -> None:
    told = (
        claims(made_up(0.0, loss)).query("figure == 4 and measure == 'paper_loss_percent'").iloc[0]
    )
    rows = made_up(0.0, loss).query("levels == 20")
    by_seed = rows.groupby("seed").paper_loss_percent.mean()
    low, high = stats.t.interval(0.95, 5, by_seed.mean(), stats.sem(by_seed))
    assert (told.estimate, told.low, told.high) == pytest.approx((by_seed.mean(), low, high))
    ends = [
        stats.t.interval(0.95, 5, part.mean(), stats.sem(part))
        for _, part in rows.groupby("states").paper_loss_percent
    ]
    assert told.worst == pytest.approx(np.abs(ends).max())
    assert told.answer == answer


def test_one_run_has_no_intervals_and_tells_nothing() -> None:
    page = claims_page(made_up(0.5, 0.1, seeds=1).assign(rounds=7000, realised_error_rate=np.nan))
    assert not re.search(r"\bnan\b", page)
    lines = [
        line.split("|")
        for line in page.split("## With intervals")[1].splitlines()
        if "% asked" in line
    ]
    assert len(lines) == 8
    assert {(cells[6].strip(), cells[7].strip()) for cells in lines} == {("", OPEN)}
    assert all(float(cells[5]) > 0 for cells in lines), "the estimate is there"


def test_the_summary_has_means_and_half_widths(frame: pd.DataFrame) -> None:
    summary = summarise_series(frame)
    assert summary.groupby("series").x.unique().map(list).to_dict() == {
        "levels": [3, 5],
        "states": [8, 12],
    }
    assert {*MEASURES} <= {*summary.columns}
    line = summary.query("series == 'states' and x == 12 and comparator == 'box'").iloc[0]
    asked = frame.query("states == 12 and comparator == 'box'").asked
    assert (line.asked, line.runs) == (asked.mean(), 2)
    assert line.asked_half == pytest.approx(stats.t.ppf(0.975, 1) * asked.std() / math.sqrt(2))
    assert series_of(frame, "levels").comparator.unique().tolist() == [
        "always",
        *FiguresSettings().comparators,
    ]
