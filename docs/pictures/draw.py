"""The pictures of docs/proofs.md, drawn from runs: ``python docs/pictures/draw.py``. Texts stay
texts in the SVGs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np

import elicit
import elicit.plot
import qlearn

LEVELS = ("critical", "poor", "stable", "well")
VALUES = np.array([0.0, 0.3, 0.7, 1.0])
QUESTIONS = (  # differences left - right of shares at the four levels
    (-0.5, 1.0, 0.0, -0.5),  # always poor, or half critical and half well?
    (-0.4, 0.0, 1.0, -0.6),  # always stable, or four days in ten critical and six well?
    (-0.3, 1.0, -0.7, 0.0),
    (0.0, 0.5, -1.0, 0.5),
)
SETTLED = (-0.2, 0.6, -0.2, -0.2)  # a difference whose line misses what is left after two answers
OPEN = (-0.3, 0.8, -1.0, 0.5)  # and one whose line crosses it


def knowing(answers: int) -> elicit.PolytopeComparator:
    """The polytope after the first so many questions, answered by ``VALUES``."""
    d = np.array(QUESTIONS[:answers]).reshape(-1, 4)
    return elicit.PolytopeComparator(4).update(elicit.Answers(d, np.sign(d @ VALUES).astype(int)))


def what_fits() -> plt.Figure:
    """K_0, K_1, K_2 and K_4 inside each other."""
    figure, ax = plt.subplots(figsize=(6.4, 6.0))
    elicit.plot.polytope([knowing(n) for n in (0, 1, 2, 4)], ax, labels=LEVELS, values=VALUES)
    return figure


def two_verdicts() -> plt.Figure:
    """The line of scales that see two vectors as equal misses what still fits, or crosses it."""
    known = knowing(2)
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.9), sharey=True)
    for ax, d in zip(axes, (SETTLED, OPEN), strict=True):
        elicit.plot.polytope(known, ax, labels=LEVELS, cuts=False)
        for text in ax.texts:
            text.set_visible(False)
        ax.plot(
            *line_of(d).T,
            color="black",
            linewidth=1.6,
            label="scales that see left and right as equal",
        )
        low, high = (float(bound[0]) for bound in known.bounds([d]))
        verdict = elicit.Verdict(int(known.compare([d])[0]))
        says = (
            "nobody need be asked"
            if verdict != elicit.Verdict.UNKNOWN
            else "the tutor must be asked"
        )
        ax.set_title(
            f"{verdict}: {says}\nd . e lies between {low:+.2f} and {high:+.2f}", fontsize=10
        )
        ax.get_legend().remove()
        ax.set(
            xlabel=f"value of {LEVELS[1]}", ylabel=f"value of {LEVELS[2]}" if ax is axes[0] else ""
        )
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="lower center", ncols=3, frameon=False, fontsize=9
    )
    figure.subplots_adjust(bottom=0.18, top=0.88, left=0.07, right=0.99, wspace=0.08)
    return figure


def triangle() -> np.ndarray:
    """(3, 2): all ordered scales of four levels, as values of the two in the middle."""
    return np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


def line_of(d: tuple[float, ...]) -> np.ndarray:
    """(2, 2): where d.e = 0 crosses the triangle of ordered scales."""
    ends = []
    for start, end in zip(triangle(), np.roll(triangle(), -1, axis=0), strict=True):
        here, there = (np.array([0.0, *point, 1.0]) @ d for point in (start, end))
        if here * there < 0:
            ends.append(start + here / (here - there) * (end - start))
    return np.array(ends)


def what_it_may_lose() -> plt.Figure:
    """The bound on the loss and the true loss after each answer of one run, both at the worst
    state.
    """
    mdp, values = qlearn.random_mdp(n_states=100, n_actions=5, n_levels=10, seed=3)
    tutor = elicit.TruthfulTutor(values)
    learner = qlearn.InteractivePolicyIteration(
        mdp, elicit.PolytopeComparator(k=10), tolerance=0.001
    )
    bounds, losses = [], []
    while True:
        queries = learner.ask()
        result = learner.result()
        bounds.append(100 * result.loss_bound)
        losses.append(100 * qlearn.policy_loss(mdp, result.policy, values).max())
        if not queries:
            break
        learner.tell([tutor(query) for query in queries])
    figure, ax = plt.subplots(figsize=(7.2, 4.2))
    colour, asked = elicit.plot.STYLES["polytope"]["color"], np.arange(len(bounds) + 1)
    bounds, losses = (
        [*bounds, bounds[-1]],
        [*losses, losses[-1]],
    )  # the last step is as wide as the others
    ax.step(
        asked,
        bounds,
        where="post",
        color=colour,
        linewidth=2,
        label="what the policy may lose at most: proven",
    )
    ax.step(
        asked,
        losses,
        where="post",
        color="black",
        linestyle=(0, (4, 2)),
        label="what it does lose: hidden",
    )
    ax.axhline(0.1, color="0.5", linewidth=0.8)
    ax.annotate(
        "the tolerance: .1%", (0, 0.1), (2, 3), textcoords="offset points", fontsize=9, color="0.3"
    )
    ax.set_yscale("symlog", linthresh=0.1, linscale=0.7)
    ax.set(ylim=(-0.005, 130), xlim=(0, asked[-1]), xlabel="answers")
    ax.set_ylabel("loss at the worst state,\n% of the value range")
    ax.set_xticks(range(0, asked[-1] + 1, 5))
    ax.set_yticks([0, 0.1, 1, 10, 100], ["0", "0.1", "1", "10", "100"])
    ax.set_title(f"one run: 100 states, 10 levels, done after {result.asked} answers", fontsize=10)
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(frameon=False, fontsize=9, loc="upper right")
    figure.tight_layout()
    return figure


PICTURES = {
    "what-fits": what_fits,
    "two-verdicts": two_verdicts,
    "what-it-may-lose": what_it_may_lose,
}


def draw(folder: Path) -> None:
    """Write every picture into ``folder``, the same bytes for the same versions."""
    settings = {"svg.fonttype": "none", "svg.hashsalt": "elicit", "font.family": "DejaVu Sans"}
    with plt.rc_context(settings):
        for name, make in PICTURES.items():
            figure = make()
            figure.savefig(folder / f"{name}.svg", metadata={"Date": None}, facecolor="white")
            plt.close(figure)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    draw(parser.parse_args().out)
