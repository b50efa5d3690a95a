"""The loss of a policy against the number of questions, from question zero: the project's picture.

    python -m benchmarks.asking.loss_by_questions --out benchmarks/RESULTS-loss.md    some minutes
    python -m benchmarks.asking.loss_by_questions --problems 2 --most 5               seconds; rough

Three families in which a wrong guess is costly, and ICU-Sepsis. Each learner asks a truthful tutor
with the polytope. After each answer its policy is evaluated under the hidden scale. Beside the
page, under the same name, it writes the rows (.csv) and the picture (.svg).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import elicit
import qlearn
from benchmarks.reporting import machine, markdown, publish, with_interval
from qlearn.experiments.catalogue import LEARNERS

NAMES = ("rover", "surgery", "career", "icu-sepsis")
RANDOM = "random questions"
SHOWN = (0, 1, 2, 3, 5, 8, 12, 20, 30)
TOLERANCE = 1e-3
STEPS = 100_000


def _random_scores(seed: int) -> Callable[[Any], Any]:
    """Return a strategy that asks about open advantages in random order."""
    draws = np.random.default_rng(seed)
    return lambda candidates: draws.random(len(candidates.d))


def learner(method: str, mdp: qlearn.OrdinalMDP, seed: int, most: int) -> Any:
    """Return a learner that asks at most ``most`` questions."""
    known = elicit.PolytopeComparator(mdp.k)
    common: dict[str, Any] = {"seed": seed, "max_queries": most}
    if method == "q-learning":
        return qlearn.InteractiveQLearning(mdp, known, steps=STEPS, **common)
    if method == "value-iteration":
        return qlearn.InteractiveValueIteration(mdp, known, tolerance=TOLERANCE, **common)
    chosen: dict[str, Any] = {}
    if method == RANDOM:
        chosen = {"strategy": _random_scores(seed), "cuts": False}
    return qlearn.InteractivePolicyIteration(mdp, known, tolerance=TOLERANCE, **common, **chosen)


ANYTIME = ("policy-iteration", RANDOM)
METHODS = (*ANYTIME, "value-iteration", "q-learning")


def label(method: str) -> str:
    """Return the name of a method in tables and pictures."""
    return "policy iteration, random questions" if method == RANDOM else LEARNERS[method].label


def curves(name: str, seeds: Sequence[int], most: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each seed, method and number of questions.

    Policy iteration has a policy after each answer. The others have one once they have finished:
    each number of questions is a run of its own, with that budget.
    """
    for seed in seeds:
        mdp = problem(name, seed)
        values = qlearn.hidden_scales("even", mdp.k, seed)
        tutor = elicit.TruthfulTutor(values)
        for method in METHODS:
            history = qlearn.LossHistory(mdp, values, bound=method == "policy-iteration")
            if method in ANYTIME:
                qlearn.drive(learner(method, mdp, seed, most), tutor, progress=history)
                for n, row in enumerate(history.after(np.arange(most + 1))):
                    yield _row(name, method, seed, n, history, row)
            else:
                yield _row(name, method, seed, 0, history, 0)
                for n in SHOWN[1:]:
                    if n <= most:
                        history(qlearn.drive(learner(method, mdp, seed, n), tutor))
                        yield _row(name, method, seed, n, history, -1)


def _row(
    name: str, method: str, seed: int, asked: int, history: qlearn.LossHistory, row: int
) -> dict[str, Any]:
    return {
        "problem": name,
        "method": method,
        "seed": seed,
        "asked": asked,
        "loss": float(history.loss[row]),
        "initial": float(history.initial_loss[row]),
        "bound": float(history.loss_bound[row]),
    }


def problem(name: str, seed: int) -> qlearn.OrdinalMDP:
    """Return the problem of this name; ICU-Sepsis is the same for every seed."""
    if name in qlearn.problems.FAMILIES:
        return qlearn.problems.FAMILIES[name](seed)
    return qlearn.icu_sepsis()


def report(frame: pd.DataFrame) -> Iterator[list[str]]:
    """The parts of the page."""
    seeds, most = frame["seed"].nunique(), int(frame["asked"].max())
    yield [
        "# Loss against questions, from question zero",
        "",
        machine(),
        "",
        "![Loss against questions](RESULTS-loss.svg)",
        "",
        "The true loss of the policy at the worst state, in percent of the value range, after so "
        f"many answers of a truthful tutor: mean over {seeds} hidden scales (and, but for "
        f"ICU-Sepsis, problems), seeds 0 to {seeds - 1}, with its 95% t-interval. At 0 questions "
        "the policy is optimal for equal gaps between levels. All methods use the polytope. Policy "
        f"iteration has a tolerance of {TOLERANCE:.1%} and a policy after each answer; when it has "
        "finished, it keeps its policy. *Proven* is its loss bound. Value iteration (the same "
        f"tolerance) and Q-learning ({STEPS:,} steps) have a policy once they have finished, so "
        "each number is of a run with that budget of questions.",
    ]
    shown = [n for n in SHOWN if n <= most]
    for name in dict.fromkeys(frame["problem"]):
        rows = []
        part = frame[frame["problem"] == name]
        for method in METHODS:
            cells = part[part["method"] == method]
            rows.append([label(method), *(_cell(cells, n, "loss") for n in shown)])
            if cells["bound"].notna().all():
                rows.append(["proven", *(_cell(cells, n, "bound") for n in shown)])
        yield [f"## {name}", "", *markdown(["questions", *map(str, shown)], rows, 1)]


def _cell(cells: pd.DataFrame, asked: int, column: str) -> str:
    return with_interval(100 * cells.loc[cells["asked"] == asked, column], 1)


def draw(frame: pd.DataFrame, path: Path) -> None:
    """Draw one panel a problem, with the mean loss of each method and what is proven."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    names = list(dict.fromkeys(frame["problem"]))
    looks = elicit.plot.styles([RANDOM, *(label(method) for method in METHODS)])
    with plt.rc_context({"svg.hashsalt": "loss", "svg.fonttype": "none", "font.size": 9}):
        figure, axes = plt.subplots(1, len(names), figsize=(3 * len(names), 3.2))
        for ax, name in zip(np.atleast_1d(axes), names, strict=True):
            part = frame[frame["problem"] == name]
            for method in METHODS:
                mean = part[part["method"] == method].groupby("asked")[["loss", "bound"]].mean()
                look = looks[RANDOM if method == RANDOM else label(method)]
                colour = look["color"]
                ax.step(
                    mean.index,
                    100 * mean["loss"],
                    where="post",
                    color=colour,
                    marker=look["marker"],
                    markersize=4,
                    markevery=[n in SHOWN for n in mean.index],
                    label=label(method),
                )
                if mean["bound"].notna().all():
                    ax.step(
                        mean.index,
                        100 * mean["bound"],
                        where="post",
                        color=colour,
                        linestyle=":",
                        label="policy iteration, proven",
                    )
            top = 100 * part[part["asked"] == 0].groupby("method")["loss"].mean().max()
            ax.set(title=name, xlabel="questions", xlim=(0, frame["asked"].max()))
            ax.set_ylim(0, max(1.6 * top, 2.0))
            ax.spines[["top", "right"]].set_visible(False)
        np.atleast_1d(axes)[0].set_ylabel("loss at the worst state\n(% of the value range)")
        handles, labels = np.atleast_1d(axes)[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=5, frameon=False)
        figure.tight_layout(rect=(0, 0.09, 1, 1))
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the page; ``--out`` also writes it, the rows and the picture."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.asking.loss_by_questions", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("--problems", type=int, default=12, help="hidden scales (default: 12)")
    parser.add_argument("--most", type=int, default=30, help="questions at most (default: 30)")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args(arguments)
    rows = [row for name in NAMES for row in curves(name, range(given.problems), given.most)]
    frame = pd.DataFrame(rows)
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        frame.to_csv(given.out.with_suffix(".csv"), index=False, float_format="%.6g")
        draw(frame, given.out.with_suffix(".svg"))
    publish(report(frame), given.out, f"0-{given.problems - 1}")


if __name__ == "__main__":
    main()
