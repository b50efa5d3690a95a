"""Pictures held to what can be measured in them: all that was measured is drawn, and nothing where no value can be."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.markers import CARETDOWN

from qlearn.experiments.ablation import summarise
from qlearn.experiments.ablation_plot import plot_ablation
from qlearn.experiments.palette import NAMES, STYLES
from qlearn.paper.claims import summarise_series
from qlearn.paper.figures import plot_asked, plot_loss

DATA = Path(__file__).parents[3] / "notebooks" / "data"


@pytest.fixture(scope="module")
def summary() -> pd.DataFrame:
    rows = pd.read_csv(DATA / "ablation.csv")
    return summarise(rows[(rows.problem != "random") | (rows.k == 10)])


def markers(axes: Axes) -> dict[str, list[tuple[float, float]]]:
    """Where markers are, by their colour; hollow ones as of the colour "hollow"."""
    found: dict[str, list[tuple[float, float]]] = {}
    for line in axes.lines:
        if line.get_marker() in {style["marker"] for style in STYLES.values()}:
            face = str(line.get_markerfacecolor())
            at = [(float(x), float(y)) for x, y in np.asarray(line.get_xydata())]
            found.setdefault("hollow" if face == "white" else face, []).extend(at)
    return {name: at for name, at in found.items() if at}


def test_the_ablation_shows_every_mean_beside_its_error_rate(summary: pd.DataFrame) -> None:
    plain = summary[summary.audit == 0]
    figure = plot_ablation(summary, max_queries=2000, names={"random": "ten levels"})
    grid = np.array(figure.axes).reshape(-1, 2, 2)  # problems; questions, loss; learners
    assert [axes.get_title() for axes in grid[0, 0]] == ["ten levels: Q-learning", "ten levels: value iteration"]
    for i, problem in enumerate(plain.problem.unique()):
        for j, learner in enumerate(plain.learner.unique()):
            part = plain[(plain.problem == problem) & (plain.learner == learner)]
            for axes, values in zip(grid[i, :, j], (part.asked, 100 * part.excess_loss), strict=True):
                drawn = markers(axes)
                assert len(drawn.pop("hollow", [])) == (part.budget_spent > 0).sum()
                rates = sorted(part.error_rate.unique())
                for name, own in part[part.budget_spent == 0].groupby("comparator"):
                    at = drawn.pop(STYLES[str(name)]["color"])
                    assert [y for _, y in at] == values[own.index].tolist()
                    assert [round(x) for x, _ in at] == own.error_rate.map(rates.index).tolist()
                assert not drawn


def test_nothing_of_the_ablations_picture_lies_on_other_parts_or_outside(summary: pd.DataFrame) -> None:
    one = summary[(summary.learner == "ivi") & (summary.problem == "random")]
    for part, budget in ((summary, 2000), (one, None)):
        figure = plot_ablation(part, max_queries=budget)
        figure.draw_without_rendering()
        legend = figure.legends[0]
        texts = [figure._suptitle, legend, *(axes.title for axes in figure.axes)]
        boxes = [text.get_window_extent() for text in texts if text is legend or text.get_text()]
        assert not any(a.overlaps(b) for a, b in combinations([*boxes, *(axes.bbox for axes in figure.axes)], 2))
        assert all(figure.bbox.padded(1).contains(*corner) for box in boxes for corner in box.corners())
        named = [text.get_text() for text in legend.get_texts()]
        drawn = {NAMES[name] for name in part.comparator[part.audit == 0]}
        assert {*named} == drawn | {"hollow: budget spent"} | ({"budget"} if budget else set())


def test_no_interval_of_questions_reaches_below_none(summary: pd.DataFrame) -> None:
    wide = summary.assign(asked_half=1e6)
    for axes in np.array(plot_ablation(wide).axes).reshape(-1, 2, 2)[:, 0].flat:
        assert {low for low, _ in bars(axes)} == {0.0}
        assert axes.get_ylim()[0] == 0


def series(rows: dict[str, list[float]], measures: dict[str, Any]) -> pd.DataFrame:
    """A summary as of ``summarise_series``, of one comparator at two sizes in both series."""
    parts = [
        {"series": name, "comparator": "polytope", "error_rate": 0.0, "x": x, "runs": 2}
        | {key: value[i] for key, value in {**measures, **rows}.items()}
        for name in ("levels", "states")
        for i, x in enumerate((5, 10))
    ]
    return pd.DataFrame(parts)


def bars(axes: Axes) -> list[tuple[float, float]]:
    """The ends of the error bars."""
    return [
        (float(low), float(high)) for (_, low), (_, high) in (s for c in axes.collections for s in c.get_segments())
    ]


ASKED = ("asked_percent_all", "asked_percent_open", "asked_percent_fresh")
LOSSES = ("paper_loss_percent", "paper_abs_percent", "excess_loss_percent")


def of(names: tuple[str, ...], mean: list[float], half: list[float]) -> pd.DataFrame:
    return series(dict.fromkeys(names, mean), {f"{name}_half": half for name in names})


def carets(axes: Axes) -> list[tuple[float, float]]:
    return [
        tuple(map(float, at))
        for line in axes.lines
        if line.get_marker() == CARETDOWN
        for at in np.asarray(line.get_xydata())
    ]


def test_intervals_that_reach_zero_end_in_an_arrow_at_the_end_of_the_log_axis() -> None:
    for name, figure in ((n, plot_asked(of(ASKED, [1.0, 4.0], [1.5, 0.5]), n)) for n in ("levels", "states")):
        for axes in figure.axes:
            assert axes.get_ylim()[0] == 0.5, name
            assert bars(axes) == [(0.5, 2.5), (3.5, 4.5)]
            assert carets(axes) == [(5.0, 0.5)]
        assert "arrows" in figure.axes[0].get_ylabel()


def test_where_none_was_asked_the_point_is_at_the_end_of_the_axis() -> None:
    for axes in plot_asked(of(ASKED, [0.0, 2.0], [0.0, 0.1]), "levels").axes:
        assert carets(axes) == [(5.0, 1.0)]
        assert bars(axes)[0] == (1.0, 1.0)
    for axes in plot_asked(of(ASKED, [0.0, 0.0], [0.0, np.nan]), "levels").axes:
        assert carets(axes) == [(5.0, 1.0), (10.0, 1.0)]


def test_no_arrows_where_nothing_is_cut_off() -> None:
    figure = plot_asked(of(ASKED, [1.0, 4.0], [0.3, np.nan]), "levels")
    assert not any(carets(axes) for axes in figure.axes)
    assert "arrows" not in figure.axes[0].get_ylabel()


def test_a_distance_has_no_interval_below_zero_and_a_difference_has() -> None:
    signed, distance, excess = plot_loss(of(LOSSES, [0.2, 3.0], [0.5, 0.5])).axes
    assert bars(distance) == [(0.0, 0.7), (2.5, 3.5)]
    for axes in (signed, excess):
        np.testing.assert_allclose(bars(axes), [(-0.3, 0.7), (2.5, 3.5)])
    assert not any(carets(axes) for axes in (signed, distance, excess))


def test_the_notebooks_figures_show_all_of_their_intervals() -> None:
    summary = summarise_series(pd.read_csv(DATA / "figures.csv"))
    for name in ("levels", "states"):
        figure = plot_asked(summary, name)
        assert not any(carets(axes) for axes in figure.axes)
        for axes in figure.axes:
            assert len(bars(axes)) == 20
            assert axes.get_ylim()[0] < min(low for low, _ in bars(axes))
