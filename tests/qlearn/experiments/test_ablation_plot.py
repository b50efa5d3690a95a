"""Pictures held to what can be measured in them: all that was measured is drawn, and nothing where
no value can be.
"""

from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes

from elicit.plot import STYLES
from qlearn.experiments.ablation import summarise
from qlearn.experiments.ablation_plot import NAMES, plot_ablation, table
from tests.report_cases import bars
from tests.thoroughness import scaled

DATA = Path(__file__).parents[3] / "notebooks" / "data"


@pytest.fixture(scope="module")
def summary() -> pd.DataFrame:
    rows = pd.read_csv(DATA / "ablation.csv")
    return summarise(rows[(rows.problem != "random") | (rows.k == 10)])


@pytest.fixture
def few(summary: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of all problems, in a quick run those of the first two."""
    problems = summary.problem.unique()
    return summary[summary.problem.isin(problems[: scaled(2, len(problems))])]


def markers(axes: Axes) -> dict[str, list[tuple[float, float]]]:
    """Return the places of markers, by their colour; hollow ones have the colour "hollow"."""
    found: dict[str, list[tuple[float, float]]] = {}
    for line in axes.lines:
        if line.get_marker() in {style["marker"] for style in STYLES.values()}:
            face = str(line.get_markerfacecolor())
            at = [(float(x), float(y)) for x, y in np.asarray(line.get_xydata())]
            found.setdefault("hollow" if face == "white" else face, []).extend(at)
    return {name: at for name, at in found.items() if at}


def test_the_ablation_shows_every_mean_beside_its_error_rate(few: pd.DataFrame) -> None:
    plain = few[few.audit == 0]
    figure = plot_ablation(few, max_queries=2000, names={"random": "ten levels"})
    learners = plain.learner.nunique()
    grid = np.array(figure.axes).reshape(-1, 2, learners)  # problems; questions, loss; learners
    assert [axes.get_title() for axes in grid[0, 0]] == [
        "ten levels: Q-learning",
        "ten levels: value iteration",
        "ten levels: policy iteration",
    ]
    for i, problem in enumerate(plain.problem.unique()):
        for j, learner in enumerate(plain.learner.unique()):
            part = plain[(plain.problem == problem) & (plain.learner == learner)]
            for axes, values in zip(grid[i, :, j], (part.asked, 100 * part.loss), strict=True):
                drawn = markers(axes)
                assert len(drawn.pop("hollow", [])) == (part.budget_spent > 0).sum()
                rates = sorted(part.error_rate.unique())
                for name, own in part[part.budget_spent == 0].groupby("comparator"):
                    at = drawn.pop(STYLES[str(name)]["color"])
                    assert [y for _, y in at] == values[own.index].tolist()
                    assert [round(x) for x, _ in at] == own.error_rate.map(rates.index).tolist()
                assert not drawn


def test_linear_axes_begin_at_zero_and_hold_every_interval(summary: pd.DataFrame) -> None:
    plain = summary[(summary.audit == 0) & (summary.problem == "random")]
    figure = plot_ablation(plain, linear=True)
    for axes in figure.axes:
        assert axes.get_yscale() == "linear"
        assert "log" not in axes.get_ylabel()
        low, high = axes.get_ylim()
        assert low == 0
        ends = [y for bar in axes.collections for part in bar.get_paths() for y in part.vertices]
        assert all(y <= high for _, y in ends)


def test_a_line_joins_error_rates_and_no_tutors_by_name(summary: pd.DataFrame) -> None:
    one = summary[
        (summary.learner == "q-learning") & (summary.problem == "random") & (summary.audit == 0)
    ]
    named = one[one.error_rate == 0].assign(error_rate="nurse")
    figure = plot_ablation(
        pd.concat([one.astype({"error_rate": object}), named], ignore_index=True)
    )
    rates = one.error_rate.nunique()
    for axes in figure.axes:
        joined = [line.get_xdata() for line in axes.lines if line.get_linestyle() != "None"]
        joined = [line for line in joined if [*line] != [0, 1]]  # asking nothing: from side to side
        assert len(joined) == one.comparator.nunique()
        assert all(round(float(x)) < rates for line in joined for x in line)
        assert sum(len(at) for at in markers(axes).values()) == len(one) + len(named)


@pytest.mark.slow
def test_nothing_of_the_ablations_picture_lies_on_other_parts_or_outside(
    summary: pd.DataFrame,
) -> None:
    one = summary[(summary.learner == "value-iteration") & (summary.problem == "random")]
    for part, budget in ((summary, 2000), (one, None)):
        figure = plot_ablation(part, max_queries=budget)
        figure.draw_without_rendering()
        legend = figure.legends[0]
        texts = [figure._suptitle, legend, *(axes.title for axes in figure.axes)]
        boxes = [text.get_window_extent() for text in texts if text is legend or text.get_text()]
        assert not any(
            a.overlaps(b)
            for a, b in combinations([*boxes, *(axes.bbox for axes in figure.axes)], 2)
        )
        assert all(
            figure.bbox.padded(1).contains(*corner) for box in boxes for corner in box.corners()
        )
        named = [text.get_text() for text in legend.get_texts()]
        drawn = {NAMES[name] for name in part.comparator[part.audit == 0]}
        others = {"hollow: budget spent", "asked nothing (equal gaps)"}
        assert {*named} == drawn | others | ({"budget"} if budget else set())


def test_a_line_shows_the_loss_of_asking_nothing_where_it_is_known(summary: pd.DataFrame) -> None:
    one = summary[(summary.learner == "q-learning") & (summary.problem == "random")]
    known = one.drop(columns=["loss_unasked", "loss_unasked_half"], errors="ignore")
    level = 2 * float(known.loss.max())
    drawn = plot_ablation(known.assign(loss_unasked=level, loss_unasked_half=0.1))
    label = "asked nothing (equal gaps)"
    for figure, count in ((drawn, 1), (plot_ablation(known), 0)):
        named = [text.get_text() for text in figure.legends[0].get_texts()]
        flat = [line for line in figure.axes[1].lines if {*line.get_ydata()} == {100 * level}]
        assert (named.count(label), len(flat)) == (count, count)
    assert drawn.axes[1].get_ylim()[1] > 100 * level


def test_no_interval_of_questions_or_losses_reaches_below_none(few: pd.DataFrame) -> None:
    wide = few.assign(asked_half=1e6, loss_half=1.0)
    for axes in plot_ablation(wide).axes:
        assert {low for low, _ in bars(axes)} == {0.0}
        assert axes.get_ylim()[0] == 0


def test_long_names_are_not_cut_off_in_the_legend(summary: pd.DataFrame) -> None:
    one = summary[(summary.learner == "q-learning") & (summary.problem == "random")]
    named = one.assign(comparator="mypackage.models.of_mine:factory_" + one.comparator)
    figure = plot_ablation(pd.concat([one, named], ignore_index=True))
    figure.draw_without_rendering()
    legend = figure.legends[0]
    assert all(
        figure.bbox.padded(1).contains(*corner) for corner in legend.get_window_extent().corners()
    )
    assert min(axes.bbox.height for axes in figure.axes) > 0.15 * figure.bbox.height


@pytest.mark.parametrize("shows", [plot_ablation, table])
def test_rows_of_single_runs_are_refused_with_what_to_do(shows) -> None:
    name = shows.__name__
    rows = pd.DataFrame({"asked": [3], "seed": [0]})
    with pytest.raises(
        TypeError, match=rf"single runs: write {name}\(ablation.summarise\(rows\)\)"
    ):
        shows(rows)
    with pytest.raises(TypeError, match=f"{name} takes the means .* but this is list"):
        shows([rows])
