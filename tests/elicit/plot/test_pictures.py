"""The pictures show what the comparators say: areas, intervals and arrows against other ways to the
same numbers.
"""

import itertools
import subprocess
import sys

import matplotlib
import networkx as nx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle

from elicit import (
    AlwaysAsk,
    Answer,
    Answers,
    BradleyTerryComparator,
    Dominance,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
    Verdict,
    plot,
)
from elicit.diagnostics.preference_graph import cycles, preference_graph
from tests.lp_cases import equalities
from tests.noisy_cases import differences
from tests.scale_arithmetic import dominance, tail_sums
from tests.thoroughness import examples

matplotlib.use("Agg")
LEVELS = ["critical", "stable", "well", "recovered"]
VALUES = [0, 2, 7, 10]
WARD = [[0.1, 0.6, 0.2, 0.1], [0.3, 0.1, 0.4, 0.2], [0.2, 0.2, 0.6, 0.0], [0.5, 0.0, 0.0, 0.5]]


@pytest.fixture(autouse=True)
def _nothing_global(monkeypatch):
    monkeypatch.setattr(plt, "show", lambda *args, **kwargs: pytest.fail("plt.show was called"))
    before = dict(matplotlib.rcParams)
    yield
    assert dict(matplotlib.rcParams) == before
    plt.close("all")


def taught(n, seed=0, **kwargs):
    d = differences(np.random.default_rng(seed), 4, 99)
    d = d[dominance(tail_sums(d)) == Verdict.UNKNOWN][:n]
    return PolytopeComparator(4, **kwargs).update(Answers(d, TruthfulTutor(VALUES).signs(d)))


def area(points):
    """Half the sum of cross products of neighbours."""
    x, y = np.asarray(points).T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def areas(ax):
    """The drawn K_t, in the order in which they were given; the first patch is the triangle."""
    return [patch for patch in ax.patches if isinstance(patch, Polygon)][1:]


def nothing_is_clipped(ax):
    figure = ax.figure
    figure.canvas.draw()
    box, renderer = figure.bbox, figure.canvas.get_renderer()
    legend = ax.get_legend()
    texts = list(ax.texts)
    for axis in (ax.xaxis, ax.yaxis) if ax.axison else ():
        low, high = sorted(axis.get_view_interval())
        texts += [
            axis.label,
            *(tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high),
        ]
    assert len(texts) > 3
    for artist in [t for t in texts if t.get_visible() and t.get_text()] + (
        [legend] if legend else []
    ):
        extent = artist.get_window_extent(renderer)
        assert all(box.padded(1).fully_contains(*corner) for corner in extent.corners()), artist


@pytest.mark.parametrize("n", [0, 1, 3, 8])
@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_the_area_is_the_share_of_scales_that_fit(n, margin):
    """Against random points of the simplex, of which those count that agree with every answer."""
    known = taught(n, seed=n, margin=margin)
    g = np.random.default_rng(1).dirichlet(np.ones(3), 40_000)
    fits = (g >= margin).all(axis=1) & (
        tail_sums(known.answers.d) @ g.T * known.answers.y[:, None] >= 0
    ).all(axis=0)
    share = fits.mean()
    (drawn,) = areas(plot.polytope(known))
    assert 2 * area(drawn.get_xy()) == pytest.approx(
        share, abs=5 * np.sqrt(share * (1 - share) / 40_000) + 1e-9
    )
    assert n == 0 or share < 0.9 * (1 - 3 * margin) ** 2


def test_a_prior_cuts_too():
    """e_3 >= 2 e_2 and e_4 - e_3 >= 0.1: by hand a triangle less a corner."""
    known = PolytopeComparator(4, margin=0, prior=([[0, -2, 1, 0], [0, 0, -1, 1]], [0, 0.1]))
    (drawn,) = areas(plot.polytope(known))
    assert area(drawn.get_xy()) == pytest.approx(0.9 * 0.45 / 2)
    found = sorted(map(tuple, np.round(plot.corners(known).cumsum(axis=1)[:, :2], 12)))
    assert found == [(0, 0), (0, 0.9), (0.45, 0.9)]


small = st.lists(st.integers(-8, 8), min_size=4, max_size=4).map(lambda d: np.array(d) / 8)


@given(
    st.lists(st.tuples(small, st.booleans()), max_size=6),
    small,
    st.sampled_from([0.0, 1e-6, 0.125]),
)
@examples(60)
def test_the_corners_span_what_the_bounds_say(told, d, margin):
    """The least and greatest d.e are reached at corners: against the linear programs."""
    known = PolytopeComparator(4, margin=margin)
    tutor = TruthfulTutor([0, 2, 5, 8])  # ties happen
    for row, as_equal in told:
        sign = int(tutor.signs(row)[0])
        if sign or as_equal:
            known = known.update(Answers([row], [sign]))
    corners = plot.corners(known)
    assert corners.sum(axis=1) == pytest.approx(1)
    (low,), (high,) = known.bounds(d)
    values = corners @ tail_sums(d)
    room = 2e-9 * max(np.abs(d).sum(), 1e-3)
    assert (values.min(), values.max()) == pytest.approx((low, high), abs=room)


def test_shrunk_to_a_segment_and_to_a_point():
    ways = np.array([[0, 1, -0.5, 0], [0, 0, 1, -0.5]])  # e_3 = 2 e_2, e_4 = 2 e_3
    line = PolytopeComparator(4, margin=0, prior=equalities(ways[:1]))
    assert len(plot.corners(line)) == 2
    assert plot.corners(line).cumsum(axis=1)[:, 1] == pytest.approx(2 * plot.corners(line)[:, 0])
    point = PolytopeComparator(4, margin=0, prior=equalities(ways))
    assert plot.corners(point).tolist() == [[0.25, 0.25, 0.5]]
    band = PolytopeComparator(4, tie=0.0).update(
        Answers(ways, [0, 0])
    )  # "equal" is a band, if a narrow one
    assert plot.corners(band) == pytest.approx(
        np.tile([0.25, 0.25, 0.5], (len(plot.corners(band)), 1)), abs=1e-8
    )
    for known, rings in ((line, 0), (point, 1), (band, 1)):
        ax = plot.polytope(known)
        (drawn,) = areas(ax)
        assert drawn.get_linewidth() >= 1
        assert sum(mark.get_markerfacecolor() == "none" for mark in ax.lines) == rings
        ax.figure.draw_without_rendering()
    only = PolytopeComparator(4, margin=1 / 3)  # the margin alone can leave no more than a point
    assert plot.corners(only) == pytest.approx(np.full((len(plot.corners(only)), 3), 1 / 3))


def test_nested_areas_shrink_and_the_marks_are_where_they_belong():
    steps = [taught(n) for n in (1, 3, 9)]
    ax = plot.polytope(steps, labels=LEVELS, values=VALUES)
    drawn = areas(ax)
    first, second, third = (area(patch.get_xy()) for patch in drawn)
    assert first >= second >= third > 0
    assert first > 1.3 * third
    for inner, outer in itertools.pairwise(reversed(drawn)):  # corners on the edge count as inside
        corners, path = inner.get_xy()[:-1], outer.get_path()
        assert any(path.contains_points(corners, radius=room).all() for room in (1e-9, -1e-9))
    marks = {line.get_label(): line.get_xydata().tolist() for line in ax.lines}
    assert marks["best guess (analytic centre)"] == [steps[-1].values[1:3].tolist()]
    assert marks["true scale"] == [[0.2, 0.7]]
    for mark in ((0.2, 0.7), steps[-1].values[1:3]):
        assert drawn[-1].contains_point(ax.transData.transform(mark))
    assert len({str(patch.get_linestyle()) for patch in drawn}) == 3, "told apart in grey"
    assert len({patch.get_edgecolor() for patch in drawn}) == 3
    named = [patch.get_label() for patch in drawn]
    assert named == [f"scales that fit {count}" for count in ("1 answer", "3 answers", "9 answers")]


def test_the_corners_of_the_triangle_say_what_they_mean():
    ax = plot.polytope(taught(3), labels=LEVELS)
    said = {tuple(text.xy): text.get_text() for text in ax.texts}
    for e_2, e_3 in ((0, 0), (0, 1), (1, 1)):
        j = [e_2, e_3 - e_2, 1 - e_3].index(1)  # the one gap that is open there
        assert (
            said[e_2, e_3] == f"all of the difference lies\nbetween {LEVELS[j]} and {LEVELS[j + 1]}"
        )
    assert ax.get_xlabel() == "value of stable\n(share of the range $e_4 - e_1$)"
    assert ax.get_ylabel().startswith("value of well\n(share of the range")
    nothing_is_clipped(ax)


def test_each_line_is_where_its_answer_changes_side():
    known = taught(8).update(
        Answers([[0, 1, 0, 0]], [1])
    )  # the last follows from the order: no line
    (lines,) = [c for c in plot.polytope(known).collections if isinstance(c, LineCollection)]
    assert lines.get_label() == "limits of the answers"
    t = tail_sums(known.answers.d)
    crossing = [row for row in t if row.min() < 0 < row.max()]
    assert len(lines.get_segments()) == len(crossing) == 8
    for segment, row in zip(lines.get_segments(), crossing, strict=True):
        g = np.diff(segment, axis=1, prepend=0, append=1)
        assert g @ row == pytest.approx(0, abs=1e-12)
        assert g.min(axis=1) == pytest.approx(0, abs=1e-12), "from edge to edge"
    assert not plot.polytope(known, cuts=False).collections
    prior = PolytopeComparator(
        4, prior=([[0, -2, 1, 0], [0, 0, 0, 1]], [0, 0.5])
    )  # the second says nothing
    (line,) = plot.polytope(prior).collections
    assert line.get_label() == "limits of the prior"
    assert sorted(map(tuple, line.get_segments()[0])) == [(0, 0), (0.5, 1)]


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: plot.polytope(PolytopeComparator(5)), "k = 5: scale_intervals"),
        (
            lambda: plot.polytope([PolytopeComparator(4), PolytopeComparator(3)]),
            "k = 3: scale_intervals",
        ),
        (lambda: plot.polytope(Dominance(4)), "not Dominance: use scale_intervals"),
        (lambda: plot.polytope([]), "at least one"),
        (lambda: plot.corners(PolytopeComparator(3)), "k = 3: scale_intervals"),
        (
            lambda: plot.polytope(PolytopeComparator(4), labels=["a", "b"]),
            "4 levels, worst first, but there are 2",
        ),
        (lambda: plot.polytope(PolytopeComparator(4), values=[0, 1, 2]), "each of 4 levels"),
        (lambda: plot.polytope(PolytopeComparator(4), values=[0, 3, 2, 4]), "increase"),
        (
            lambda: plot.plausible(PolytopeComparator(5)),
            "PolytopeComparator of 5 levels: use scale_intervals",
        ),
        (lambda: plot.plausible(Dominance(4)), "Dominance of 4 levels: use scale_intervals"),
        (lambda: plot.scale_intervals([]), "at least one"),
        (lambda: plot.scale_intervals({}), "at least one"),
        (
            lambda: plot.scale_intervals({"a": Dominance(3), "b": Dominance(4)}),
            "b is about 4 levels, but a is about 3",
        ),
        (lambda: plot.scale_intervals(Dominance(3), labels="abcd"), "3 levels"),
        (
            lambda: plot.scale_intervals(Dominance(4), labels="abcd"),
            "4 levels, .* but they are the text 'abcd'",
        ),
        (
            lambda: plot.preference_graph(preference_graph([]), names="abcd"),
            "not the one text 'abcd'",
        ),
        (lambda: plot.scale_intervals(Dominance(3), values=[0, 1]), "each of 3 levels"),
    ],
)
def test_what_cannot_be_drawn(call, complaint):
    with pytest.raises(ValueError, match=complaint):
        call()
    assert not plt.get_fignums(), "no empty figure is left behind"


def test_what_each_comparator_holds_possible_is_drawn_in_its_own_colour():
    d = differences(np.random.default_rng(2), 4, 30)
    told = Answers(d, TruthfulTutor(VALUES).signs(d))
    two = np.eye(4)[1:3] - np.eye(4)[0]

    known = PolytopeComparator(4).update(told[:9])
    ax = plot.plausible(known, labels=LEVELS, values=VALUES)
    (drawn,) = areas(ax)
    assert area(drawn.get_xy()) == pytest.approx(area(plot.corners(known).cumsum(axis=1)[:, :2]))
    assert drawn.get_edgecolor()[:3] == pytest.approx(to_rgb(plot.STYLES["polytope"]["color"]))
    assert ax.get_xlabel().startswith("value of stable")
    assert [line.get_xydata().tolist() for line in ax.lines] == [[[0.2, 0.7]]]
    nothing_is_clipped(ax)

    for rescale, kind in ((False, "box"), (True, "box-rescaled")):
        known = BradleyTerryComparator(4, region="box", rescale=rescale, n_boot=20).update(told)
        (drawn,) = [
            patch for patch in plot.plausible(known).patches if isinstance(patch, Rectangle)
        ]
        low, high = known.bounds(two)
        assert drawn.get_bbox().get_points() == pytest.approx(np.stack([low, high]))
        assert drawn.get_edgecolor()[:3] == pytest.approx(to_rgb(plot.STYLES[kind]["color"]))

    for known, kind in (
        (BradleyTerryComparator(4, n_boot=20, region="ensemble").update(told), "ensemble"),
        (PosteriorComparator(4, particles=50).update(told), "posterior"),
    ):
        (dots,) = plot.plausible(known).collections
        assert np.array(dots.get_offsets()) == pytest.approx(known.draws.gaps.cumsum(axis=0)[:2].T)
        assert dots.get_sizes() / dots.get_sizes().sum() == pytest.approx(known.draws.weights)
        assert dots.get_facecolor()[0, :3] == pytest.approx(to_rgb(plot.STYLES[kind]["color"]))

    for region in ("box", "ensemble"):  # too few answers
        ax = plot.plausible(BradleyTerryComparator(4, region=region).update(told[:1]))
        assert [text.get_text() for text in ax.texts] == ["says nothing yet"]


def test_every_comparator_has_a_kind_and_others_their_own_style():
    kinds = [
        (AlwaysAsk(3), "always"),
        (PolytopeComparator(3), "polytope"),
        (PolytopeComparator(3, wrong=1), "polytope-1-wrong"),
        (PosteriorComparator(3, particles=50), "posterior"),
        (BradleyTerryComparator(3, region="ensemble"), "ensemble"),
        (BradleyTerryComparator(3, region="box"), "box"),
        (BradleyTerryComparator(3, region="box", rescale=True), "box-rescaled"),
        (Dominance(3), "Dominance"),
    ]
    assert [plot.kind_of(one) for one, _ in kinds] == [kind for _, kind in kinds]
    ax = plot.scale_intervals({kind: one for one, kind in kinds if kind != "always"})
    marks = [(line.get_color(), line.get_marker()) for *_, line in drawn_intervals(ax)]
    looks = plot.styles(kind for _, kind in kinds[1:])
    assert marks == [(look["color"], look["marker"]) for look in looks.values()]


def drawn_intervals(ax):
    """For each comparator: low, high, height (k,) of its lines; the best guesses (k,), and the line
    of these.
    """
    lines = [c for c in ax.collections if c.get_zorder() == 1]
    points = [line for line in ax.lines if line.get_zorder() == 2]
    for collection, line in zip(lines, points, strict=True):
        ends = np.array(collection.get_segments())
        yield ends[:, 0, 0], ends[:, 1, 0], ends[:, 0, 1], line.get_xdata(), line


@pytest.mark.parametrize("k", [2, 3, 7])
def test_intervals_are_the_bounds(k):
    rng = np.random.default_rng(k)
    values = np.cumsum(rng.random(k))
    d = differences(rng, k, 40)
    answers = Answers(d, TruthfulTutor(values).signs(d))
    named = {
        "polytope": PolytopeComparator(k).update(answers),
        "Bradley-Terry": BradleyTerryComparator(k, n_boot=20, seed=0, region="ensemble").update(
            answers
        ),
        "always ask": AlwaysAsk(k),
        "order": Dominance(k),
    }
    ax = plot.scale_intervals(named, values=values)
    found = list(drawn_intervals(ax))
    assert len(found) == 4
    true = (values - values[0]) / (values[-1] - values[0])
    for one, (low, high, _, guess, _) in zip(named.values(), found, strict=True):
        bounds = [one.bounds(np.eye(k)[j] - np.eye(k)[0]) for j in range(k)]
        assert (np.stack([low, high], axis=1) == np.array(bounds)[:, :, 0]).all()
        assert guess.tolist() == one.values.tolist()
    low, high, *_ = found[0]
    assert ((low <= true + 1e-12) & (true <= high + 1e-12)).all()
    assert (k == 2) == (high[1] - low[1] < 0.01)
    heights = np.array([height for _, _, height, _, _ in found])
    assert len(np.unique(heights.round(6))) == 4 * k, "beside each other"
    assert (np.abs(heights - np.arange(k)) < 0.45).all()
    (ticks,) = [c for c in ax.collections if c.get_zorder() == 3]
    assert np.array(ticks.get_segments())[:, 0, 0] == pytest.approx(true)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["true value", *named]
    nothing_is_clipped(ax)


def test_comparators_are_told_apart_in_colour_and_in_grey():
    several = [PolytopeComparator(4), *(taught(n) for n in range(1, 7))]
    ax = plot.scale_intervals(several)
    marks = [line for *_, line in drawn_intervals(ax)]
    lines = [c for c in ax.collections if c.get_zorder() == 1]
    for kinds in (
        [m.get_marker() for m in marks],
        [m.get_color() for m in marks],
        [c.get_linestyle() for c in lines],
    ):
        assert len(set(map(str, kinds))) == 7
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names[:3] == ["Polytope, 0 answers", "Polytope, 1 answer", "Polytope, 2 answers"]
    nothing_is_clipped(ax)


def test_one_comparator_with_names_of_levels():
    ax = plot.scale_intervals(taught(4), labels=LEVELS)
    assert [text.get_text() for text in ax.get_yticklabels()] == LEVELS
    assert ax.get_legend() is None
    assert "share of the range $e_4 - e_1$" in ax.get_xlabel()
    nothing_is_clipped(ax)
    assert "$e_{12} - e_1$" in plot.scale_intervals(Dominance(12)).get_xlabel()


def said(name, left, verdict, right):
    return Answer(Query(name, WARD[left], WARD[right]), verdict)


def arrows(ax):
    return [text.arrow_patch for text in ax.texts if isinstance(text.arrow_patch, FancyArrowPatch)]


def test_better_vectors_stand_above():
    graph = preference_graph(
        [
            said("1", 0, Verdict.BETTER, 1),
            said("2", 2, Verdict.WORSE, 1),
            said("3", 2, Verdict.EQUAL, 3),
        ],
        dominance=False,
    )
    ax = plot.preference_graph(graph)
    height = {text.get_text(): text.xy[1] for text in ax.texts if text.get_text()}
    assert height["0"] > height["1"] > height["2"]
    assert height["10/60/20/10"] == height["0"]
    assert len(arrows(ax)) == 3, "equal is one line"
    assert len({str(arrow.get_linestyle()) for arrow in arrows(ax)}) == 2
    nothing_is_clipped(ax)
    ax = plot.preference_graph(graph, names=LEVELS)
    assert set(LEVELS) <= {text.get_text() for text in ax.texts}


def test_a_circle_can_be_drawn_and_stands_out():
    graph = preference_graph([said(str(i), i, Verdict.BETTER, (i + 1) % 4) for i in range(4)])
    plain, marked = plot.preference_graph(graph), plot.preference_graph(graph, cycles=cycles(graph))
    colours = [{arrow.get_edgecolor() for arrow in arrows(ax)} for ax in (plain, marked)]
    assert len(colours[0]) == len(colours[1]) == 1
    assert colours[0] != colours[1]
    assert "on a cycle" in [text.get_text() for text in marked.get_legend().get_texts()]


def test_dominance_is_drawn_without_what_follows():
    chain = [[1 - s, 0.0, 0.0, s] for s in (0.1, 0.2, 0.4, 0.8)]
    answers = [Answer(Query(str(i), chain[i], chain[i + 1]), None) for i in range(3)]
    graph = preference_graph(answers)
    assert graph.number_of_edges() == 6
    assert len(arrows(plot.preference_graph(graph))) == 3
    plot.preference_graph(preference_graph([]))


@pytest.mark.parametrize(
    "draw",
    [
        lambda ax: plot.polytope(taught(2), ax),
        lambda ax: plot.scale_intervals(taught(2), ax),
        lambda ax: plot.preference_graph(preference_graph([said("1", 0, Verdict.BETTER, 1)]), ax),
    ],
)
def test_axes_are_used_or_made(draw):
    figure, (left, right) = plt.subplots(1, 2)
    assert draw(left) is left
    assert plt.get_fignums() == [figure.number]
    assert not right.has_data()
    new = draw(None)
    assert new.figure is not figure
    assert len(plt.get_fignums()) == 2


@pytest.mark.slow
def test_only_drawing_needs_matplotlib_and_the_error_names_what_to_install():
    code = (
        "sys.modules['matplotlib'] = None; import elicit, elicit.plot as p; "
        "p.scale_intervals(elicit.PolytopeComparator(3))"
    )
    found = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}"], capture_output=True, text=True
    )
    assert (
        "ImportError: plots need matplotlib: pip install 'elicit-qlearn[ablation]'" in found.stderr
    )


def sticks_out(ax):
    ax.figure.draw_without_rendering()
    legend, whole = ax.get_legend().get_window_extent(), ax.figure.bbox
    return min(legend.x0, legend.y0) < -1 or legend.x1 > whole.x1 + 1 or legend.y1 > whole.y1 + 1


def test_no_legend_is_cut_off():
    told = [taught(n) for n in (0, 1, 2, 3, 5, 8, 12)]
    named = {
        f"the long name that somebody gave to the comparator of number {i}": one
        for i, one in enumerate(told[:3])
    }
    assert not sticks_out(plot.scale_intervals(named, values=VALUES))
    assert not sticks_out(plot.scale_intervals(told, plt.subplots()[1], values=VALUES))
    assert not sticks_out(
        plot.scale_intervals(told, plt.subplots(1, 2, layout="constrained")[1][1], values=VALUES)
    )
    assert not sticks_out(plot.polytope(told, values=VALUES))
    graph = preference_graph([Answer(Query("q", WARD[0], WARD[1]), Verdict.BETTER)])
    assert not sticks_out(plot.preference_graph(graph))


def test_a_large_graph_is_drawn_without_what_follows():
    rng, values = np.random.default_rng(0), np.array(VALUES, dtype=float)
    seen = np.unique(rng.multinomial(10, np.full(4, 0.25), 80) / 10, axis=0)[:45]
    asked = [rng.choice(len(seen), 2, replace=False) for _ in range(60)]
    flipped = [-1 if rng.random() < 0.1 else 1 for _ in asked]
    graph = preference_graph(
        Answer(
            Query(f"q{i}", seen[a], seen[b]),
            Verdict(int(flip * np.sign((seen[a] - seen[b]) @ values))),
        )
        for i, ((a, b), flip) in enumerate(zip(asked, flipped, strict=True))
    )
    assert len(graph) > 30
    circles = cycles(graph)
    ax = plot.preference_graph(graph, cycles=circles)
    drawn = [text for text in ax.texts if text.arrow_patch is not None]
    assert len(drawn) < graph.number_of_edges() / 2
    assert {text.get_text() for text in ax.texts} == {"", *map(str, graph)}, "numbers only"
    at = {text.get_text(): text.get_position() for text in ax.texts if text.get_text()}
    assert len(set(at.values())) == len(graph)
    names = {
        text.get_position(): name for name, text in ((t.get_text(), t) for t in ax.texts) if name
    }
    arrows = {(int(names[tuple(text.xyann)]), int(names[tuple(text.xy)])) for text in drawn}
    assert {step[:2] for circle in circles for step in circle.steps} <= arrows | {
        (b, a) for a, b in arrows
    }
    down = nx.DiGraph((a, b) for a, b in arrows if at[str(a)][1] > at[str(b)][1])
    for a, b in graph.edges:  # what was left out follows from what was drawn
        if graph.edges[a, b]["kind"] != "equal" and (a, b) not in arrows:
            assert nx.has_path(down, a, b)
    texts = plot.preference_graph(graph, names=[f"plan {node}" for node in graph]).texts
    assert sum(text.get_text().startswith("plan ") for text in texts) == len(graph)


def test_shares_of_a_node_total_a_hundred():
    graph = preference_graph(
        [Answer(Query("q", [1 / 3, 1 / 3, 1 / 3], [0.5, 0.25, 0.25]), Verdict.BETTER)]
    )
    texts = {text.get_text() for text in plot.preference_graph(graph).texts}
    assert {"33.4/33.3/33.3", "50/25/25"} <= texts


class Held:
    """A result, as far as pictures go: it holds a comparator."""

    def __init__(self, comparator):
        self.comparator = comparator


def test_a_result_stands_for_its_comparator():
    known = taught(5)
    for draw in (plot.scale_intervals, plot.polytope, plot.plausible):
        of_result, of_comparator = draw(Held(known)), draw(known)
        drawn = [
            [line.get_xydata().tolist() for line in ax.lines] for ax in (of_result, of_comparator)
        ]
        assert drawn[0] == drawn[1]
    (name,) = plot.scale_intervals({"mine": Held(known)}).get_legend().get_texts()
    assert name.get_text() == "mine"


@pytest.mark.parametrize("given", [TruthfulTutor(VALUES), [0, 1, 2], {"a": 3}, Held])
def test_what_holds_no_comparator_is_named(given):
    with pytest.raises(TypeError, match="scale_intervals draws comparators, or results"):
        plot.scale_intervals(given)


class Losses:
    asked = np.array([0, 1, 2])
    loss = np.array([0.2, 0.05, 0.0])
    loss_bound = np.array([0.6, 0.3, 0.001])


def test_a_loss_history_is_drawn_from_question_zero_in_percent():
    ax = plot.loss_history(Losses())
    loss, bound = ax.lines
    assert loss.get_xydata().tolist() == [[0, 20], [1, 5], [2, 0]]
    assert bound.get_ydata().tolist() == pytest.approx([60, 30, 0.1])
    assert loss.get_drawstyle() == bound.get_drawstyle() == "steps-post"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "loss under the true values",
        "bound",
    ]
    low, high = ax.get_xlim()
    assert low == 0
    assert high >= 2


def test_several_histories_have_their_names_and_colours():
    ax = plot.loss_history({"polytope": Losses(), "mine": Losses()})
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names[:2] == ["polytope", "mine"]
    colours = [line.get_color() for line in ax.lines]
    assert colours[0] == colours[1] == plot.STYLES["polytope"]["color"] != colours[2] == colours[3]
    with pytest.raises(TypeError, match=r"draws a qlearn.LossHistory, not 3"):
        plot.loss_history(3)
