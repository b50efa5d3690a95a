"""The contest's tables and picture, from the committed rows: no run, some seconds.

    python -m benchmarks.contest.redraw --out benchmarks/RESULTS-contest.md

Beside the page it writes the picture (.svg).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from benchmarks.contest import problems
from benchmarks.contest.methods import METHODS, WORST
from benchmarks.contest.run import KEY, ROWS, load
from benchmarks.reporting import markdown, publish, with_interval
from elicit.catalogue import COMPARATORS, LOOKS
from elicit.model.scale import Floats

ENOUGH = 0.01
FLOOR = 0.01  # percent: the picture shows no smaller loss
SHOWN = (0, 1, 2, 3, 5, 8, 12, 20, 30)
PLACES = {"initial": "from the start", "worst": "at the worst state"}
OURS, PROVEN, RANDOM = "ours: posterior", "ours: polytope", "random pairs"
COMPARED = (3, 5, 10, 30)
EXPECTED = "expected utility (EVOI, EUBO)"
BESIDE_FEW = (EXPECTED, OURS, RANDOM)
BANDED = 0.16  # opacity of a band
DRAWN = {  # in the picture: a colour, a marker, a style of line, and whether there is a band
    PROVEN: (COMPARATORS["polytope"].color, COMPARATORS["polytope"].marker, "-", True),
    OURS: (COMPARATORS["posterior"].color, COMPARATORS["posterior"].marker, "-", True),
    EXPECTED: ("#E3A500", "1", "-", True),
    RANDOM: (LOOKS["random questions"]["color"], LOOKS["random questions"]["marker"], "-", True),
    "minimax regret: current solution": ("#708090", "2", "-", False),
    "polyhedral (Toubia)": ("#9ACD32", "3", "-", False),
    "IDRL": ("#9467BD", "4", "--", False),
    "APReL: mutual information": ("#E7298A", "+", "--", False),
    "Gaussian process (Zintgraf)": ("#A0926B", "|", "--", False),
    "policy comparisons (Shao)": ("#C49C94", ".", ":", False),
    "bisection of each level": ("#17BECF", "_", ":", False),
}
APART = 5  # answers between two markers of a line
BARS = (5, 10, 20)
"""Answers after which a line without a band has a bar, its 95% interval."""


def curves(frame: pd.DataFrame, place: str) -> Floats:
    """Return losses (runs, answers) in percent."""
    names = [name for name in frame if str(name).startswith(f"{place} ")]
    names.sort(key=lambda name: int(str(name).split()[1]))
    return 100 * frame[names].to_numpy(dtype=np.float64)


def few(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of slow methods, which play fewer runs than the others."""
    return frame[frame["method"].map(lambda name: METHODS[str(name)].runs > 0)]


def common(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the runs in which every method took part, so that all meet the same.

    Slow methods are left out: they play only some of these runs.
    """
    parts = []
    frame = frame.drop(few(frame).index)
    for tutor in problems.TUTORS:
        part = frame[frame["tutor"] == tutor]
        runs = part.groupby(["problem", "seed"])["method"].transform("nunique")
        parts.append(part[runs == part["method"].nunique()])
    return pd.concat(parts)


def true_from(losses: Floats) -> Floats:
    """Return after how many answers (runs,) a loss of 1% holds for good; inf if it never does."""
    over = losses > 100 * ENOUGH
    last = losses.shape[1] - 1 - over[:, ::-1].argmax(axis=1)
    found = np.where(over.any(axis=1), last + 1.0, 0.0)
    return np.where(found >= losses.shape[1], np.inf, found)


def summary_table(frame: pd.DataFrame) -> list[str]:
    """Return one table of all: losses from the start, ends, false claims, and the cost."""
    shared = common(frame)
    shown = {"truthful": 5, "flips": 10, "eq. (6)": 10, "person": 10}
    head = [
        "method",
        *(f"{tutor} after {n}" for tutor, n in shown.items()),
        "claims",
        "done after (truthful)",
        *(f"false claims ({tutor})" for tutor in ("flips", "eq. (6)", "person")),
        "ms a question",
    ]
    rows = []
    for method, entry in METHODS.items():
        mine = frame[frame["method"] == method]
        if not len(mine) or entry.runs:
            continue
        cells = [method]
        for tutor, n in shown.items():
            runs = shared[(shared["tutor"] == tutor) & (shared["method"] == method)]
            cells.append(with_interval(curves(runs, "initial")[:, n], 2) if len(runs) else "")
        cells.append(f"1% {entry.claims}" if entry.claims else "")
        truthful = mine[mine["tutor"] == "truthful"]
        done = truthful.loc[truthful["done"] >= 0, "done"]
        cells.append(with_interval(done, 1) if entry.claims and len(done) else "")
        for tutor in ("flips", "eq. (6)", "person"):
            found, false = false_claims(mine[mine["tutor"] == tutor], method)
            takes_part = entry.claims and not entry.only
            cells.append(f"{false} of {found}" if takes_part else "")
        cells.append(f"{1000 * mine['seconds'].median():.1f}")
        rows.append(cells)
    return markdown(head, rows, 1)


def loss_table(part: pd.DataFrame, place: str) -> list[str]:
    """Return the losses after so many answers, the least mean over all answers first."""
    rows = []
    for method, runs in part.groupby("method", sort=False):
        losses = curves(runs, place)
        cells = [with_interval(losses[:, n], 2) for n in SHOWN if n < losses.shape[1]]
        rows.append((losses[:, 1:].mean(), [str(method), *cells]))
    rows.sort(key=lambda row: row[0])
    head = ["method", *(str(n) for n in SHOWN)]
    return markdown(head, [cells for _, cells in rows], 1)


def count_table(part: pd.DataFrame) -> list[str]:
    """Return questions until 1% is true and until it is claimed, and the cost."""
    head = (
        "method",
        "runs",
        "1% true from the start: median",
        "reached",
        "1% true at the worst state: median",
        "reached at the worst state",
        "done: mean questions",
        "done within 30",
        "CPU ms a question",
    )
    rows = []
    for method, runs in part.groupby("method", sort=False):
        cells = [str(method), str(len(runs))]
        for place in ("initial", "worst"):
            found = true_from(curves(runs, place))
            middle = float(np.quantile(found, 0.5, method="higher"))
            cells += [
                f"{middle:.0f}" if np.isfinite(middle) else "over 30",
                f"{np.isfinite(found).mean():.0%}",
            ]
        done = runs.loc[runs["done"] >= 0, "done"]
        cells += [with_interval(done, 1) if len(done) else "never", f"{len(done) / len(runs):.0%}"]
        cells.append(f"{1000 * runs['seconds'].median():.1f}")
        rows.append(cells)
    return markdown(head, rows, 1)


def false_claims(runs: pd.DataFrame, method: str) -> tuple[int, int]:
    """Return how many claims a method made, and how many of them were false."""
    place = "worst" if METHODS[method].claims == WORST else "initial"
    claimed = runs[runs["done"] >= 0]
    if not len(claimed):
        return 0, 0
    losses = curves(claimed, place)
    at_claim = losses[np.arange(len(claimed)), claimed["done"].to_numpy()]
    return len(claimed), int((at_claim > 100 * ENOUGH + 1e-6).sum())


def share(found: int, of: int) -> str:
    """Return a share in percent with its 95% interval (Clopper and Pearson)."""
    if not of:
        return "no claim"
    low, high = stats.binomtest(found, of).proportion_ci(0.95, "exact")
    return f"{found} of {of}: {found / of:.1%} [{100 * low:.1f}, {100 * high:.1f}]"


def claim_table(frame: pd.DataFrame) -> list[str]:
    """Return how often each claim was false, by tutor."""
    tutors = [*problems.TUTORS]
    rows = []
    for method, entry in METHODS.items():
        if not entry.claims or method not in set(frame["method"]):
            continue
        cells = [method, f"1% {entry.claims}"]
        for tutor in tutors:
            runs = frame[(frame["tutor"] == tutor) & (frame["method"] == method)]
            found, false = false_claims(runs, method)
            cells.append(share(false, found) if len(runs) else "takes no part")
        rows.append(cells)
    return markdown(["method", "claims", *tutors], rows, 2)


def cell_table(frame: pd.DataFrame, tutor: str) -> list[str]:
    """Return false claims of each claim in each problem, with one tutor."""
    part = frame[frame["tutor"] == tutor]
    names = list(dict.fromkeys(part["problem"]))
    rows = []
    for method, entry in METHODS.items():
        runs = part[part["method"] == method]
        if entry.claims and len(runs):
            counts = [false_claims(runs[runs["problem"] == name], method) for name in names]
            rows.append([method, *(f"{false} of {found}" for found, false in counts)])
    return markdown(["method", *names], rows, 1)


def apart(part: pd.DataFrame, method: str, other: str, place: str) -> Floats:
    """Return losses of one method less those of another (runs, answers), where both played."""
    run = list(KEY[:3])
    first, second = (part[part["method"] == name].set_index(run) for name in (method, other))
    both = first.index.intersection(second.index).sort_values()
    return curves(first.loc[both], place) - curves(second.loc[both], place)


def sure(d: Floats) -> int:
    """Return -1 or 1 if the mean of d (runs,) is below or above 0 with 95%, else 0."""
    if np.ptp(d) == 0:
        return int(np.sign(round(float(d[0]), 9)))
    half = stats.t.ppf(0.975, len(d) - 1) * stats.sem(d)
    return int(d.mean() - half > 0) - int(d.mean() + half < 0)


def beside_table(part: pd.DataFrame, other: str, place: str) -> list[str]:
    """Return the loss of every method less that of another after some numbers of answers."""
    rows = []
    for method in dict.fromkeys(part["method"]):
        if method == other:
            continue
        d = apart(part, method, other, place)
        cells = []
        for n in COMPARED:
            word = {-1: " less", 0: "", 1: " more"}[sure(d[:, n])]
            cells.append(with_interval(d[:, n], 2, signed=True) + word)
        rows.append([method, *cells])
    return markdown(["method", *(f"after {n}" for n in COMPARED)], rows, 1)


def where_we_lose(part: pd.DataFrame, tutor: str) -> list[str]:
    """Return a sentence for each place at which another method loses less than ours."""
    lines = []
    for place, words in PLACES.items():
        for ours in (PROVEN, OURS):
            if ours not in set(part["method"]):
                continue
            found = []
            for method in dict.fromkeys(part["method"]):
                if str(method).startswith("ours"):
                    continue
                d = apart(part, method, ours, place)
                better = [str(n) for n in COMPARED if sure(d[:, n]) < 0]
                found += [f"{method} (after {', '.join(better)})"] * bool(better)
            said = "; ".join(found) if found else "none"
            lines.append(f"- {tutor}, {words}, less loss than {ours!r}: {said}.")
    return lines


def below_random(part: pd.DataFrame, tutor: str) -> str:
    """Return who loses more than random pairs in the mean over all answers."""
    found = []
    for method in dict.fromkeys(part["method"]):
        if (
            method != RANDOM
            and sure(apart(part, method, RANDOM, "initial")[:, 1:].mean(axis=1)) > 0
        ):
            found.append(method)
    return f"- {tutor}: {', '.join(found) if found else 'none'}."


def fewer_table(frame: pd.DataFrame, place: str) -> list[str]:
    """Return losses of slow methods, and of some others in the same runs, over all tutors."""
    slow = few(frame)
    names = [*dict.fromkeys(slow["method"]), *BESIDE_FEW]
    part = frame.merge(slow[[*KEY[:3]]].drop_duplicates(), on=[*KEY[:3]])
    rows = []
    for method in names:
        losses = curves(part[part["method"] == method], place)
        cells = [with_interval(losses[:, n], 2) for n in COMPARED]
        d = apart(part, method, EXPECTED, place)[:, 10]
        cells.append("" if method == EXPECTED else with_interval(d, 2, signed=True))
        rows.append([method, str(len(losses)), *cells])
    head = ["method", "runs", *(f"after {n}" for n in COMPARED)]
    return markdown([*head, f"after 10, less {EXPECTED}"], rows, 1)


def by_tutors(frame: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return the rows by tutor, of the runs that all methods shared."""
    shared = common(frame)
    return {tutor: shared[shared["tutor"] == tutor] for tutor in dict.fromkeys(shared["tutor"])}


def counted(by_tutor: dict[str, pd.DataFrame]) -> str:
    """Return the numbers of shared runs in words."""
    sizes = (f"{len(part[[*KEY[:3]]].drop_duplicates())} ({t})" for t, part in by_tutor.items())
    return ", ".join(sizes)


def agreement_table(frame: pd.DataFrame, again: pd.DataFrame) -> list[str]:
    """Return how alike two sets of runs rank the methods, by their mean losses over all answers."""
    rows = []
    first, second = by_tutors(frame), by_tutors(again)
    for tutor, part in first.items():
        cells = [tutor]
        for place in PLACES:
            means = [
                {
                    method: curves(runs, place)[:, 1:].mean()
                    for method, runs in each.groupby("method")
                }
                for each in (part, second[tutor])
            ]
            both = sorted(set(means[0]) & set(means[1]))
            found = stats.spearmanr(*([mean[method] for method in both] for mean in means))
            ranks = [
                1 + sorted(mean, key=lambda method: mean[method]).index(OURS) for mean in means
            ]
            cells += [f"{found.statistic:.2f}", f"{ranks[0]} and {ranks[1]} of {len(both)}"]
        rows.append(cells)
    head = ["tutor"]
    for words in PLACES.values():
        head += [f"rank correlation {words}", f"our posterior's rank {words}"]
    return markdown(head, rows, 1)


def confirmed(frame: pd.DataFrame, again: pd.DataFrame) -> Iterator[list[str]]:
    """The parts of the page on the seeds that were used once."""
    by_tutor = by_tutors(again)
    slow = few(again)
    yield [
        "## Confirmation on seeds that were used once",
        "",
        f"The same on other seeds, which nothing was chosen or changed on: {len(again):,} runs, of "
        f"which all methods but BoTorch's qEUBO share {counted(by_tutor)}. Mean losses over all "
        "answers rank the methods so much alike in both sets of runs (CPU times are of a busier "
        "machine, which compiled during the runs, and not to be compared):",
        "",
        *agreement_table(frame, again),
    ]
    yield ["## Confirmation: in short", "", *summary_table(again)]
    yield [
        "## Confirmation: where another method loses less than ours",
        "",
        *(line for tutor, part in by_tutor.items() for line in where_we_lose(part, tutor)),
    ]
    yield [
        "## Confirmation: who loses more than random pairs",
        "",
        *(below_random(part, tutor) for tutor, part in by_tutor.items()),
    ]
    yield ["## Confirmation: claims", "", *claim_table(again)]
    if len(slow):
        for place, words in PLACES.items():
            yield [
                f"## BoTorch's qEUBO and others in the same runs: loss {words}",
                "",
                "The published qEUBO takes tenths of a second a question. It played one run of "
                "some problems with each tutor. Losses after so many answers, over all tutors.",
                "",
                *fewer_table(again, place),
            ]


def report(frame: pd.DataFrame, again: pd.DataFrame) -> Iterator[list[str]]:
    """The parts of the page, from the rows of the main runs and of the confirmation."""
    by_tutor = by_tutors(frame)
    tutors = list(by_tutor)
    yield [
        "# The contest: rivals as published, and ours",
        "",
        "![Loss against questions](RESULTS-contest.svg)",
        "",
        "What each method is, needs and promises, and why it wins or loses: "
        "[the contest](../docs/contest.md). This page is made from the committed rows "
        f"(`benchmarks/contest/rows.csv.xz`, {len(frame) + len(again):,} runs) without a run; "
        "`python -m benchmarks.contest.run --check 40` repeats 40 of them. Problems and seeds are "
        "those of `benchmarks/contest/held_out.toml`, which says when they were used.",
        "",
        "Losses are in percent of the value range, means with 95% t-intervals over problems and "
        f"runs: {counted(by_tutor)}. In these all methods meet the same problems, hidden "
        "scales and tutors. Claims are counted over all runs of the methods that make them.",
        "",
        f"Of the rows: {made_of()}",
    ]
    yield [
        "## In short",
        "",
        "Loss from the start, in percent of the value range, after so many answers of each tutor; "
        "what a method claims when it stops, after how many questions, and how many of its claims "
        "were false; the median CPU time of a question.",
        "",
        *summary_table(frame),
    ]
    yield [
        "## Where another method loses less than ours",
        "",
        "Paired by problem and run, beyond the 95% interval of the difference, after "
        f"{', '.join(map(str, COMPARED))} answers:",
        "",
        *(line for tutor, part in by_tutor.items() for line in where_we_lose(part, tutor)),
    ]
    yield [
        "## Who loses more than random pairs",
        "",
        "From the start, in the mean over all numbers of answers, beyond the 95% interval:",
        "",
        *(below_random(part, tutor) for tutor, part in by_tutor.items()),
    ]
    yield from confirmed(frame, again)
    yield [
        "## Claims",
        "",
        "A method that stops claims a loss of at most 1%, at the place in the second column. How "
        "many claims were false, with a 95% interval. Our posterior claims it at 95%; the "
        "polytope, minimax regret and bisection if all answers are right.",
        "",
        *claim_table(frame),
    ]
    for tutor in tutors:
        yield [
            f"## Claims by problem: {tutor}",
            "",
            "False claims of all claims.",
            "",
            *cell_table(frame, tutor),
        ]
    for tutor, part in by_tutor.items():
        yield [f"## Questions: {tutor}", "", *count_table(part)]
    for place, words in PLACES.items():
        for tutor, part in by_tutor.items():
            yield [
                f"## Loss {words}: {tutor}",
                "",
                "The least mean over all numbers of answers first.",
                "",
                *loss_table(part, place),
            ]
    for place, words in PLACES.items():
        for tutor, part in by_tutor.items():
            yield [
                f"## Loss {words}, less that of {OURS!r}: {tutor}",
                "",
                *beside_table(part, OURS, place),
            ]


def made_of() -> str:
    """Return when, by which command and of which sources the rows were made."""
    return ROWS.with_name("rows.stamp").read_text(encoding="utf-8").strip()


def draw(frame: pd.DataFrame, path: Path) -> None:
    """Draw the mean loss against answers: a column a tutor, a row a place.

    Four methods have 95% bands, the others 95% bars after some numbers of answers.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    shared = common(frame)
    tutors = list(dict.fromkeys(shared["tutor"]))
    with plt.rc_context({"svg.hashsalt": "contest", "svg.fonttype": "none", "font.size": 10}):
        size = (3.4 * len(tutors), 8.4)
        figure, axes = plt.subplots(2, len(tutors), figsize=size, sharex=True, sharey=True)
        for row, (place, words) in enumerate(PLACES.items()):
            for column, tutor in enumerate(tutors):
                ax, part = axes[row, column], shared[shared["tutor"] == tutor]
                for at, method in enumerate(DRAWN):
                    losses = curves(part[part["method"] == method], place)
                    if len(losses):
                        _draw_line(ax, method, losses, 0.06 * (at - len(DRAWN) / 2))
                ax.set(yscale="log", ylim=(FLOOR, 30), xlim=(0, 30))
                ax.axhline(100 * ENOUGH, color="0.5", linewidth=0.8, linestyle=(0, (1, 2)))
                ax.spines[["top", "right"]].set_visible(False)
                if not row:
                    ax.set_title(tutor)
                else:
                    ax.set_xlabel("answers")
            axes[row, 0].set_ylabel(f"loss {words}\n(% of the value range)")
            axes[row, 0].set_yticks([0.01, 0.1, 1, 10], ["0.01", "0.1", "1", "10"])
        handles, labels = axes[0, tutors.index("truthful")].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=4, frameon=False)
        figure.tight_layout(rect=(0, 0.1, 1, 1))
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def _draw_line(ax: Any, method: str, losses: Floats, aside: float) -> None:
    """Draw one mean, and its 95% band or some bars, which stand aside of each other."""
    colour, marker, style, banded = DRAWN[method]
    mean, n = losses.mean(axis=0), np.arange(losses.shape[1])
    half = stats.t.ppf(0.975, len(losses) - 1) * stats.sem(losses, axis=0)
    low, high = (np.maximum(each, FLOOR / 10) for each in (mean - half, mean + half))
    wide = 2.4 if method.startswith("ours") else 1.3
    ax.plot(
        n,
        np.maximum(mean, FLOOR / 10),
        style,
        color=colour,
        marker=marker,
        markevery=(APART, APART),
        label=method,
        linewidth=wide,
    )
    if banded:
        ax.fill_between(n, low, high, color=colour, alpha=BANDED, linewidth=0)
    else:
        places = np.array(BARS)
        ax.vlines(places + 4 * aside, low[places], high[places], color=colour, linewidth=0.9)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it and the picture."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.contest.redraw", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    frame, again = load(), load("confirmation")
    if given.out is not None:
        draw(frame, given.out.with_suffix(".svg"))
    publish(report(frame, again), given.out, "of held_out.toml")


if __name__ == "__main__":
    main()
