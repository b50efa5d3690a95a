"""The paper's figures, held to what can be measured in them: nothing is drawn where no value can
be.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.markers import CARETDOWN

from qlearn.paper.claims import summarise_series
from qlearn.paper.figures import plot_asked, plot_loss
from tests.report_cases import bars

DATA = Path(__file__).parents[3] / "notebooks" / "data"


ASKED = ("asked_percent_all", "asked_percent_open", "asked_percent_fresh")
LOSSES = ("paper_loss_percent", "paper_abs_percent", "excess_loss_percent")


def of(names: tuple[str, ...], mean: list[float], half: list[float]) -> pd.DataFrame:
    """A summary as of ``summarise_series``, of one comparator at two sizes in both series."""
    parts = []
    for name, (i, x) in product(("levels", "states"), enumerate((5, 10))):
        measures = dict.fromkeys(names, mean[i]) | {f"{measure}_half": half[i] for measure in names}
        parts.append(
            {
                "series": name,
                "comparator": "polytope",
                "errs": "truthful",
                "x": x,
                "runs": 2,
                **measures,
            }
        )
    return pd.DataFrame(parts)


def carets(axes: Axes) -> list[tuple[float, float]]:
    return [
        tuple(map(float, at))
        for line in axes.lines
        if line.get_marker() == CARETDOWN
        for at in np.asarray(line.get_xydata())
    ]


def test_intervals_that_reach_zero_end_in_an_arrow_at_the_end_of_the_log_axis() -> None:
    for name, figure in (
        (n, plot_asked(of(ASKED, [1.0, 4.0], [1.5, 0.5]), n)) for n in ("levels", "states")
    ):
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


def test_measures_have_a_panel_each() -> None:
    (only,) = plot_asked(of(ASKED, [1.0, 4.0], [0.3, 0.5]), "levels", measures=ASKED[1:2]).axes
    assert (only.get_title(), bars(only)) == (
        "of those that dominance leaves open",
        [(0.7, 1.3), (3.5, 4.5)],
    )
    (only,) = plot_loss(of(LOSSES, [1.0, 4.0], [0.5, 0.5]), measures=LOSSES[2:]).axes
    assert (only.get_title(), bars(only)) == ("true policy loss", [(0.5, 1.5), (3.5, 4.5)])


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
    shown = summary[(summary.comparator != "always") & summary.errs.isin(["truthful", "10%"])]
    for name in ("levels", "states"):
        figure = plot_asked(summary, name)
        assert not any(carets(axes) for axes in figure.axes)
        for axes in figure.axes:
            assert len(bars(axes)) == (shown.series == name).sum() >= 20
            assert axes.get_ylim()[0] < min(low for low, _ in bars(axes))


def test_pictures_show_the_tutor_who_never_errs_and_the_one_who_errs_most_or_those_named() -> None:
    parts = [
        of(ASKED, [1.0, 4.0], [0.3, 0.3]).assign(errs=errs) for errs in ("truthful", "2%", "10%")
    ]
    summary = pd.concat(parts, ignore_index=True)
    for tutors, shown in (
        (None, ["truthful tutor", "tutor errs (10%)"]),
        (["2%"], ["tutor errs (2%)"]),
    ):
        labels = plot_asked(summary, "levels", tutors).axes[0].get_legend_handles_labels()[1]
        assert [label.split(", ")[1] for label in labels] == shown
