"""Pictures held to what can be measured in them: no label on another, nothing drawn where no value can be."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.markers import CARETDOWN
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from qlearn.experiments.ablation import summarise
from qlearn.experiments.ablation_plot import plot_ablation
from qlearn.experiments.label_placement import Marked, place_labels
from qlearn.paper.claims import summarise_series
from qlearn.paper.figures import plot_asked, plot_loss

DATA = Path(__file__).parents[3] / "notebooks" / "data"


def labels_of(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation) and text.get_text() != "budget"]


def boxes_of(figure: Figure, axes: Axes) -> list[Bbox]:
    figure.draw_without_rendering()
    return [Text.get_window_extent(text).padded(-1.0) for text in labels_of(axes)]  # without the line to the marker


def crowded() -> list[Marked]:
    """Four paths at one place, and one a little aside."""
    at = np.zeros((3, 2))
    return [Marked(at, ("0", "5", "15"), "black") for _ in range(4)] + [Marked(at + 0.1, ("0", "5", "15"), "red")]


def test_labels_of_markers_on_each_other_are_joined_and_kept_apart() -> None:
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    axes.set(xlim=(-0.01, 1), ylim=(-1, 1))
    figure.draw_without_rendering()
    place_labels(axes, crowded())
    assert [text.get_text() for text in labels_of(axes)] == ["0, 5, 15"] * 5
    boxes = boxes_of(figure, axes)
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    inside = axes.get_window_extent().padded(1)
    assert all(inside.contains(*corner) for box in boxes for corner in box.corners())
    place_labels(axes, [])  # nothing to say


def test_labels_of_markers_apart_stand_alone_beside_them() -> None:
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    figure.draw_without_rendering()
    place_labels(axes, [Marked(np.array([[0.2, 0.2], [0.5, 0.5], [0.8, 0.8]]), ("0", "5", "0"), "black")])
    found = labels_of(axes)
    assert [(text.get_text(), text.arrow_patch) for text in found] == [("0", None), ("5", None), ("0", None)]
    assert [text.xy for text in found] == [(0.2, 0.2), (0.5, 0.5), (0.8, 0.8)]


@pytest.mark.skipif(not (DATA / "ablation.csv").exists(), reason="the notebooks' data are not here")
def test_labels_of_the_ablation_do_not_lie_on_each_other() -> None:
    summary = summarise(pd.read_csv(DATA / "ablation.csv"))
    figure = plot_ablation(summary, max_queries=500)
    seen = overlapping = 0
    for axes in figure.axes:
        boxes = boxes_of(figure, axes)
        seen += len(boxes)
        overlapping += sum(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert seen > 60
    assert figure.bbox.width > figure._suptitle.get_window_extent().width
    alone = plot_ablation(summary[(summary.learner == "ivi") & (summary.problem == "random")])
    alone.draw_without_rendering()
    assert alone.bbox.width > alone._suptitle.get_window_extent().width, "the title fits a figure of one panel too"
    assert overlapping <= seen // 50, "there may be no room for one, whatever the data"


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


@pytest.mark.skipif(not (DATA / "figures.csv").exists(), reason="the notebooks' data are not here")
def test_the_notebooks_figures_show_all_of_their_intervals() -> None:
    summary = summarise_series(pd.read_csv(DATA / "figures.csv"))
    for name in ("levels", "states"):
        figure = plot_asked(summary, name)
        assert not any(carets(axes) for axes in figure.axes)
        for axes in figure.axes:
            assert len(bars(axes)) == 20
            assert axes.get_ylim()[0] < min(low for low, _ in bars(axes))
