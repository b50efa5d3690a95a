"""The items' section of the benchmark of fits: all libraries solve the same problem; who is fastest
comes first.
"""

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("statsmodels")

from benchmarks.fitting import fit_tables as tables
from benchmarks.fitting import item_strengths as items
from benchmarks.fitting.fit_methods import RIDGED
from benchmarks.fitting.fit_tables import Line


@pytest.fixture(scope="module")
def data() -> items.Items:
    return items.draw_items(4, 200, 6, seed=1)


@pytest.mark.parametrize("name", items.METHODS)
def test_every_library_finds_the_same_strengths(name, data):
    needs, method = items.METHODS[name]
    if needs in items.missing():
        pytest.skip(f"{needs} is not installed")
    exact, found = items.ours(data), method(data)
    assert np.isfinite(exact).all()
    assert exact.max() - exact.min() > 1
    np.testing.assert_allclose(found - found[:, :1], exact, atol=1e-4)


def test_ours_are_where_the_likelihood_is_flat(data):
    strengths = items.ours(data)
    for wins, theta in zip(data.wins, strengths, strict=True):
        expected = (wins + wins.T) / (
            1 + np.exp(theta[None] - theta[:, None])
        )  # of row over column
        np.testing.assert_allclose(expected.sum(axis=1), wins.sum(axis=1), atol=1e-6)


def test_answers_and_resamples_hold_as_many_wins(data):
    assert (data.wins.sum(axis=(1, 2)) == 200).all()
    assert (np.diagonal(data.wins, axis1=1, axis2=2) == 0).all()
    assert not np.array_equal(data.wins[0], data.wins[1])


def test_an_item_that_never_lost_has_no_strength_and_who_gives_one_is_told():
    data = items.draw_items(3, 300, 2, seed=0)
    data.wins[1][:, 2] = 0.0
    exact = items.ours(data)
    assert np.isnan(exact[1]).all()
    assert np.isfinite(exact[[0, 2]]).all()
    lost, made_up = exact.copy(), np.nan_to_num(exact, nan=5.0)
    lost[2] = np.nan
    assert items._line("a", 1.0, [lost], [exact], [data])[3:] == (1, 0)
    line = items._line("b", 1.0, [made_up + 3.0], [exact], [data])
    assert line[3:] == (0, 1)
    assert line.error == pytest.approx(0, abs=1e-12)


def test_the_section_leaves_out_what_is_not_installed(monkeypatch):
    monkeypatch.setattr(items, "missing", lambda: ["choix", "evalica"])
    lines, none = items.item_lines(3, 60, 1, 4, seed=0)
    assert [line.name for line in lines] == [items.OURS, "SciPy L-BFGS-B, gradient"]
    text = "\n".join(
        line for part in items.item_tables({(3, 60): (lines, none)}, 1, 4) for line in part
    )
    assert "choix is not installed, and its rows are left out." in text
    assert "### 3 items, 60 answers" in text


def test_where_another_wins_the_page_says_so_first():
    own = Line(f"{tables.OURS}, monotone=False", str(RIDGED), 4.0, 0.0, 0.5, 0.0, "")
    slow = own._replace(name="slow", milliseconds=8.0)
    mine, quick = (
        items.ItemLine(items.OURS, 6.0, 0.0, 0, 0),
        items.ItemLine("quick", 3.0, 0.0, 0, 0),
    )
    broken = quick._replace(name="broken", milliseconds=1.0, missing=2)
    said = tables.fastest({(5, 30): [slow, own]}, {(5, 60): ([mine, quick, broken], 0)})
    assert said[0].startswith("On items quick fits")
    assert "in 1 of 2 tables" in said[0]
    assert said[4:] == [
        "| items | 5 | 60 | quick | 3.0 | 6.0 | 0.50 |",
        "| bags, ridge | 5 | 30 | slow | 8.0 | 4.0 | 2.00 |",
    ]
    assert tables.fastest({(5, 30): [slow, own]}, {})[0].startswith("No other library")
