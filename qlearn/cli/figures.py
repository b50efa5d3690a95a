"""The command ``qlearn figures``: the paper's two series, its three figures, and its claims with intervals."""

from __future__ import annotations

from functools import partial
from typing import Any

from qlearn.cli.options import (
    COUNT,
    DISCOUNT,
    ERROR_RATE,
    FROM_0,
    INNER,
    LAPSE,
    LEVELS,
    PARTICLES,
    SCALE,
    SHARE,
    Groups,
    add_groups,
    add_where,
    defaults_of,
    frame_of,
    without,
)

QUICK: dict[str, Any] = {
    "levels": [4, 6, 8], "at_states": 20, "states": [20, 30, 40], "at_levels": 6, "actions": 3, "seeds": 3,
    "steps": 2000, "n_boot": 20, "particles": 200,
}  # fmt: skip
_COMPARATORS = ("polytope", "posterior", "box-rescaled", "box")
OPTIONS: Groups = {
    "the two series": {
        "levels": ({"nargs": "+", "type": LEVELS}, (5, 10, 15, 20, 25), "numbers of levels of the first series"),
        "at_states": ({"type": COUNT}, 100, "its number of states"),
        "states": ({"nargs": "+", "type": COUNT}, (100, 200, 300, 400, 500), "numbers of states of the second series"),
        "at_levels": ({"type": LEVELS}, 20, "its number of levels"),
        "actions": ({"type": COUNT}, 5, "number of actions"),
        "discount": ({"type": DISCOUNT}, 0.95, "discount factor"),
        "seeds": ({"type": COUNT}, 20, "number of runs of each point"),
        "seed": ({"type": FROM_0}, 0, "the first seed"),
        "steps": ({"type": COUNT}, 100_000, "number of steps of Q-learning"),
        "epsilon": ({"type": SHARE}, 1.0, "chance of a random action; at 1 all comparators see the same transitions"),
    },
    "comparators and tutors": {
        "comparators": (
            {"nargs": "+", "choices": _COMPARATORS},
            _COMPARATORS,
            "the polytope (its tutor never errs), the posterior, the paper's Bradley-Terry box with footnote 3 and "
            "without",
        ),
        "error_rate": (
            {"type": ERROR_RATE},
            0.1,
            "of the tutor of all but the polytope, who errs as in eq. (6): his precision is set to err in this share "
            "of the comparisons of an optimal policy",
        ),
        "both_tutors": ({"action": "store_true"}, False, "a truthful tutor for all of them as well"),
        "precision": ({"type": SCALE}, 300.0, "of the box's prior, logits per unit of d.e"),
        "n_boot": ({"type": COUNT}, 50, "the box's number of resamples"),
        "level": ({"type": INNER}, 0.95, "confidence level, also the posterior's"),
        "refit_growth": ({"type": SCALE}, 0.2, "growth of the box's answers between two fits; 0: fit at each (hours)"),
        "lapse": ({"type": LAPSE}, 0.1, "share of answers that the posterior takes to be given at random"),
        "particles": ({"type": PARTICLES}, 1000, "the posterior's number of particles"),
    },
}
DEFAULTS = defaults_of(OPTIONS)


def add_to(commands: Any) -> None:
    """Add the command to a parser's."""
    command = commands.add_parser(
        "figures",
        help="the paper's figures 2, 3 and 4, and its claims, with intervals over runs",
        description="Run the paper's two series of random MDPs for the polytope, the posterior and the paper's "
        "comparator, with common random numbers. Writes figure2, figure3 and figure4 (.png, .svg), runs.csv (one row "
        "a run), summary.csv (means with 95% intervals), claims.csv and claims.md (trends and bounds with intervals) "
        "and times.csv. "
        "All but times.csv are the same for the same options on any number of processes. There is no budget of "
        "questions. Every run is kept in journal.jsonl as it finishes: after Ctrl-C, or worse, the same command "
        "computes what is missing.",
    )
    command.set_defaults(command=run)
    add_where(command, "results/figures")
    command.add_argument("--quick", action="store_true", help="a tiny setting, to see that it works (seconds)")
    add_groups(command, OPTIONS)


def run(options: dict[str, Any]) -> int:
    """The command; returns the exit code."""
    quick, out = options.pop("quick"), options.pop("out")
    settings = (QUICK if quick else {}) | options
    try:
        import tqdm  # noqa: F401 - for the bar

        from qlearn.paper.claims import claims, claims_page, claims_text, summarise_series
        from qlearn.paper.figures import plot_asked, plot_loss, save
        from qlearn.paper.series import KEYS, figures
    except ModuleNotFoundError as error:
        return without(error)
    frame, code = frame_of("figures", partial(figures, **settings), out)
    if frame is None:
        return code

    frame[[*KEYS, "seconds"]].to_csv(out / "times.csv", index=False, lineterminator="\n")
    frame = frame.drop(columns="seconds")
    frame.to_csv(out / "runs.csv", index=False, lineterminator="\n")
    if code:
        return code
    summary, told = summarise_series(frame), claims(frame)
    summary.to_csv(out / "summary.csv", index=False, lineterminator="\n")
    told.to_csv(out / "claims.csv", index=False, lineterminator="\n")
    (out / "claims.md").write_text(claims_page(frame), encoding="utf-8")
    save(plot_asked(summary, "levels"), out, "figure2")
    save(plot_asked(summary, "states"), out, "figure3")
    save(plot_loss(summary), out, "figure4")
    print(claims_text(told))
    print(f"\nwritten to {out}: figure2, figure3, figure4 (.png, .svg), runs.csv, summary.csv, claims.csv, claims.md,")
    print("times.csv; and journal.jsonl, from which the same command takes what has finished")
    return code
