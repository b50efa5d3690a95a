"""Comparators, problems, tutors and learners of the user's in the ablation: rows, journal, table
and picture.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from elicit import (
    FlippingTutor,
    PersonTutor,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
)
from elicit.testing import check_comparator
from qlearn import InteractivePolicyIteration, InteractiveValueIteration, drive
from qlearn.experiments import ablation as runs
from qlearn.experiments.ablation import ablate, summarise
from qlearn.experiments.ablation_plot import NAMES, plot_ablation, table
from qlearn.experiments.metrics import Counted
from qlearn.experiments.settings import AblationSettings
from tests.own_cases import Exact, careless, certified, exact, tiny
from tests.scale_arithmetic import Floats
from tests.sweep_cases import TINY

SMALL: dict[str, Any] = TINY | {"learners": ["value-iteration"], "audit": 0.0, "tolerance": 0.1}


def text_of(frame: pd.DataFrame) -> str:
    return str(frame.drop(columns="seconds").to_csv(index=False))


def counting(log: Path, values_of: Callable[[int], Floats]) -> Callable[[int, int], Exact]:
    """A factory that closes over things, and counts its calls."""

    def make(k: int, seed: int) -> Exact:
        with log.open("a") as file:
            print(seed, file=file)
        return Exact(values_of(seed))

    return make


def test_a_comparator_that_knows_the_scale_has_its_row_its_colour_and_its_marker() -> None:
    check_comparator(exact(4, 0))
    rows = ablate(
        **SMALL | {"comparators": {"mine": lambda k, seed: exact(k, seed), "polytope": "polytope"}},
        jobs=1,
    )
    mine = rows[rows.comparator == "mine"]
    assert mine.error_rate.tolist() == [0.0, 0.15]
    assert (mine.asked == 0).all()
    assert (mine.excess_loss == 0).all()
    assert mine.judged_before.sum() > 0 == mine.wrong_before.sum()
    text = table(summarise(rows))
    assert sum(line.startswith("mine ") for line in text.splitlines()) == 2
    assert max(map(len, text.splitlines())) <= 120
    figure = plot_ablation(summarise(rows))
    handles = {str(line.get_label()): line for line in figure.legends[0].legend_handles}
    unasked = "asked nothing (equal gaps)"
    assert [*handles] == [NAMES["always"], NAMES["polytope"], "mine", unasked]
    look = handles["mine"].get_color(), handles["mine"].get_marker()
    drawn = [
        line
        for axes in figure.axes
        for line in axes.lines
        if (line.get_color(), line.get_marker()) == look
    ]
    assert sum(len(line.get_xdata()) for line in drawn) == 2 * 2
    assert len({line.get_color() for line in handles.values()}) == 4


@pytest.mark.slow
def test_rows_are_the_same_on_two_processes_and_read_back(tmp_path: Path) -> None:
    own = SMALL | {
        "comparators": {"mine": lambda k, seed: exact(k, seed), "polytope": ...},
        "problems": {"box": lambda seed: tiny(seed + 1), "random": "random"},
        "tutors": {
            "careless": careless,
            "noisy": lambda values, seed: FlippingTutor(values, 0.3, seed),
        },
        "learners": {"certified": certified, "value-iteration": "value-iteration"},
    }
    here = ablate(**own, jobs=1, journal=tmp_path / "journal")
    assert len(here) == 2 * (1 + 2 * 4 + 2 * 4)
    assert text_of(ablate(**own, jobs=2)) == text_of(here)
    seen: list[tuple[int, int]] = []
    again = ablate(
        **own, jobs=1, journal=tmp_path / "journal", progress=lambda *now: seen.append(now)
    )
    assert seen == [(len(here), len(here))]
    assert text_of(again) == text_of(here)
    without = ablate(
        **own | {"comparators": ["polytope"], "tutors": ()}, jobs=1, journal=tmp_path / "journal"
    )
    kept = here[here.comparator.isin(["always", "polytope"]) & here.error_rate.isin([0.0, 0.15])]
    assert text_of(without) == text_of(kept)


def test_other_code_under_the_same_name_is_computed_anew_and_nothing_else_is(
    tmp_path: Path,
) -> None:
    log, seen = tmp_path / "log", []

    def lowest(seed: int) -> Floats:
        return np.array([0.0, 1.0, 2.0, 3.0])

    def highest(seed: int) -> Floats:
        return np.array([0.0, 7.0, 8.0, 9.0])

    def asked(values_of: Callable[[int], Floats]) -> pd.DataFrame:
        given = SMALL | {
            "comparators": {"mine": counting(log, values_of), "polytope": "polytope"},
            "seeds": 2,
        }
        return ablate(
            **given, jobs=1, journal=tmp_path / "journal", progress=lambda *now: seen.append(now)
        )

    first = asked(lowest)
    assert seen[0] == (0, 10)
    seen.clear()
    assert text_of(asked(lowest)) == text_of(first)
    assert seen == [(10, 10)]
    seen.clear()
    second = asked(highest)
    assert seen[0] == (6, 10)  # all but those of mine
    assert text_of(second) != text_of(first)
    assert text_of(second[second.comparator != "mine"]) == text_of(
        first[first.comparator != "mine"]
    )
    assert text_of(asked(lowest)) == text_of(first)


def test_a_problem_is_made_anew_in_every_run(tmp_path: Path) -> None:
    (tmp_path / "seed").write_text("0")

    def from_a_file(seed: int) -> Any:
        return tiny(int((tmp_path / "seed").read_text()))

    def asked(fresh: bool) -> str:
        given = SMALL | {"problems": {"box": from_a_file}, "comparators": ["polytope"]}
        return text_of(ablate(**given, jobs=1, journal=tmp_path / "journal", fresh=fresh))

    first = asked(fresh=False)
    (tmp_path / "seed").write_text("3")
    assert asked(fresh=False) == first  # the journal knows the code, not the file
    assert asked(fresh=True) != first


def test_a_name_of_ours_may_be_given_to_another_and_keeps_its_place() -> None:
    given = {"posterior": lambda k, seed: PolytopeComparator(k, tie=0), "polytope": "polytope"}
    rows = ablate(**SMALL | {"comparators": given}, jobs=1)
    assert rows.comparator.unique().tolist() == ["always", "polytope", "posterior"]
    one, other = (
        text_of(rows[rows.comparator == name].drop(columns="comparator")) for name in given
    )
    assert one == other


def test_a_run_with_a_tutor_and_a_learner_of_the_users_can_be_rebuilt_by_hand() -> None:
    given = {
        "comparators": ["polytope"],
        "problems": {"box": tiny},
        "tutors": {"careless": careless},
    }
    rows = ablate(**SMALL | given | {"error_rates": ()}, jobs=1)
    assert rows.error_rate.tolist() == [0.0, "careless"]
    mdp, values = tiny(0)
    learner = InteractiveValueIteration(
        mdp, PolytopeComparator(4), tolerance=0.1, rng=0, max_sweeps=80, max_queries=40
    )
    result = drive(learner, careless(values, 0))  # type: ignore[arg-type]
    (row,) = rows[rows.error_rate == "careless"].itertuples()
    assert (row.asked, row.compared, row.realised_error_rate) == (
        result.asked,
        result.compared,
        1.0,
    )
    assert row.wrong_before == 0 < row.wrong_after
    text = table(summarise(rows))
    assert "careless" in text
    figure = plot_ablation(summarise(rows))
    assert [label.get_text() for label in figure.axes[-1].get_xticklabels()] == ["0", "careless"]

    rows = ablate(**SMALL | given | {"learners": {"mine": certified}}, jobs=1)
    assert rows.comparator.unique().tolist() == [
        "polytope"
    ]  # no oracle: it is held to the best policy
    assert rows.excess_loss.tolist() == rows.loss.tolist()
    assert rows.paper_loss_percent.isna().all()


def test_simulated_persons_are_a_tutor_by_name() -> None:
    given = {
        "tutors": ["person"],
        "comparators": ["posterior"],
        "learners": ["policy-iteration"],
        "problems": {"box": tiny},
        "tolerance": 1e-3,
    }
    rows = ablate(**SMALL | given | {"error_rates": (), "seeds": 2, "audit": 0.0}, jobs=1)
    persons = rows[rows.error_rate == "person"]
    assert len(persons) == 2
    for row in persons.itertuples():
        mdp, values = tiny(int(row.seed))
        tutor = PersonTutor(values, seed=int(row.seed))
        settings = replace(AblationSettings(), **SMALL | given)
        learner = InteractivePolicyIteration(
            mdp,
            PosteriorComparator(
                mdp.k, lapse=settings.lapse, seed=int(row.seed), particles=settings.particles
            ),
            tolerance=settings.tolerance,
            max_queries=settings.max_queries,
            seed=int(row.seed),
        )
        result = drive(learner, tutor)
        assert row.asked == result.asked > 0
        assert row.realised_error_rate == tutor.realised_error_rate
    assert "person" in table(summarise(rows))


def test_a_tutor_who_takes_a_reference_gets_differences_to_set_her_noise_by() -> None:
    seen: list[tuple[int, ...]] = []

    def tutor(values: Floats, seed: int, reference: Floats) -> TruthfulTutor:
        seen.append(reference.shape)
        return TruthfulTutor(values)

    ablate(
        **SMALL | {"tutors": {"hers": tutor}, "comparators": ["polytope"], "error_rates": ()},
        jobs=1,
    )
    assert {shape[1] for shape in seen} == {4}
    assert min(shape[0] for shape in seen) > 0


def test_ours_take_equal_at_its_word_from_tutors_of_ours_and_not_from_yours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[float] = []

    def polytope(k: int, seed: int, **settings: Any) -> PolytopeComparator:
        comparator = PolytopeComparator(k, **settings)
        made.append(comparator.tie)
        return comparator

    monkeypatch.setattr(
        runs,
        "COMPARATORS",
        {**runs.COMPARATORS, "polytope": replace(runs.COMPARATORS["polytope"], factory=polytope)},
    )
    given = SMALL | {
        "comparators": ["polytope"],
        "error_rates": (0.0,),
        "tutors": {"careless": careless},
    }
    ablate(**given, jobs=1)
    assert {*made} == {0.0, 0.01}
    for name in ("always", "polytope", "polytope-1-wrong"):
        made_by = [runs.COMPARATORS[name].make(4, 0, {"tie": tie}).tie for tie in (0.0, 0.2)]  # type: ignore[attr-defined]
        assert made_by == [0.0, 0.2]
    made.clear()
    ablate(**given | {"tie": 0.05}, jobs=1)
    assert {*made} == {0.05}


def test_the_errors_of_a_tutor_who_does_not_count_are_counted() -> None:
    values = np.array([0.0, 1.0, 3.0])
    apart, same = (
        Query.make("x", i, left, [0.0, 1.0, 0.0])
        for i, left in enumerate(([0, 0, 1.0], [0, 1.0, 0]))
    )
    truthful, wrong = TruthfulTutor(values), careless(values, 0)
    said = [truthful(apart), None]

    def tutor(query: Query) -> Any:
        return said.pop(0)

    counted = Counted(tutor, values)
    assert np.isnan(counted.realised_error_rate)
    counted(apart)
    assert counted.realised_error_rate == 0
    with pytest.raises(TypeError, match=r"a tutor returns an elicit\.Answer, but .* returned None"):
        counted(apart)
    mistaken = Counted(wrong, values)  # type: ignore[arg-type]
    assert [int(mistaken(query).verdict) for query in (apart, same)] == [-1, 0]  # type: ignore[arg-type]
    assert mistaken.realised_error_rate == 0.5
