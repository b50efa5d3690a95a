"""The command ``qlearn``. Everything heavy is imported by the command that needs it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from qlearn.cli import figures as figures_command
from qlearn.cli.options import (
    COUNT,
    DISCOUNT,
    ERROR_RATE,
    FROM_0,
    INNER,
    LAPSE,
    LEVELS,
    PARTICLES,
    POSITIVE,
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
    "problems": ["random"], "states": 15, "actions": 3, "levels": 4, "seeds": 2, "steps": 400, "tolerance": 0.02,
    "max_sweeps": 150, "max_queries": 150, "n_boot": 20,
}  # fmt: skip
PAPER: dict[str, Any] = {"seeds": 20, "n_boot": 200, "refit_growth": 0.0}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line (default: ``sys.argv``) and return the exit code. Bad options end in SystemExit(2)."""
    options = vars(_parser().parse_args(argv))
    command: Callable[[dict[str, Any]], int] = options.pop("command")
    return command(options)


def _ablate(options: dict[str, Any]) -> int:
    quick, paper, out = (options.pop(name) for name in ("quick", "paper", "out"))
    settings = (QUICK if quick else PAPER if paper else {}) | options
    try:
        import tqdm  # noqa: F401 - for the bar

        from qlearn.experiments.ablation import KEYS, ablate, summarise
        from qlearn.experiments.ablation_plot import LEGEND, plot_ablation, table
    except ModuleNotFoundError as error:
        return without(error)
    frame, code = frame_of("ablation", partial(ablate, **settings), out)
    if frame is None:
        return code

    times = [*KEYS, "seconds"]
    frame[times].to_csv(out / "times.csv", index=False, lineterminator="\n")
    frame.drop(columns="seconds").to_csv(out / "runs.csv", index=False, lineterminator="\n")
    summary = summarise(frame)
    summary.to_csv(out / "summary.csv", index=False, lineterminator="\n")
    defaults = DEFAULTS | settings
    size = "{states} states, {actions} actions, {levels} levels".format(**defaults)
    names = {"random": f"random MDP ({size})"}
    figure = plot_ablation(summary, max_queries=defaults["max_queries"], names=names)
    figure.savefig(out / "ablation.png", dpi=150)
    print(table(summary, names), LEGEND, sep="\n\n")
    print(f"\nwritten to {out}: runs.csv (a row a run), summary.csv (a row a cell), times.csv, ablation.png; and")
    print("journal.jsonl, from which the same command takes what has finished")
    return code


_PROBLEMS, _LEARNERS = ("random", "icu", "frozen-lake", "deep-sea-treasure"), ("q-learning", "ivi")
_COMPARATORS = ("always", "polytope", "relaxed", "posterior", "posterior-close", "ensemble", "box")
# The defaults are those of qlearn.ablation, said again here
# because --help would take a second if it had to import it.
_OPTIONS: Groups = {
    "the sweep": {
        "problems": ({"nargs": "+", "choices": _PROBLEMS}, _PROBLEMS[:2], "random MDPs; real and known tasks"),
        "learners": ({"nargs": "+", "choices": _LEARNERS}, _LEARNERS, "Q-learning, interactive value iteration"),
        "comparators": (
            {"nargs": "+", "choices": _COMPARATORS},
            _COMPARATORS,
            "always ask; polytope, plain and relaxed; posterior, plain and with an indifference; Bradley-Terry",
        ),
        "error_rates": (
            {"nargs": "+", "type": ERROR_RATE},
            (0.0, 0.05, 0.15),
            "the tutor's chance of a wrong answer; 0 is truthful",
        ),
        "noise": (
            {"choices": ("flip", "logistic")},
            "flip",
            "errors however clear the case (flip), or near ties mostly, set to the same mean rate (logistic)",
        ),
        "audit": ({"type": SHARE}, 0.05, "share of decided pairs put to the tutor in the audited runs; 0: none"),
        "audit_steps": ({"type": COUNT}, 2000, "steps of an audited run, if steps are not fewer"),
        "audit_sweeps": ({"type": COUNT}, 20, "sweeps of an audited run at most, if max-sweeps are not fewer"),
        "seeds": ({"type": COUNT}, 4, "number of seeds"),
        "seed": ({"type": FROM_0}, 0, "the first seed"),
        "max_queries": ({"type": FROM_0}, 2000, "question budget; beyond it the best guess decides"),
    },
    "the random MDP": {
        "states": ({"type": COUNT}, 100, "number of states"),
        "actions": ({"type": COUNT}, 5, "number of actions"),
        "levels": ({"type": LEVELS}, 10, "number of levels"),
        "discount": ({"type": DISCOUNT}, 0.95, "discount factor (ICU-Sepsis, FrozenLake: 0.99)"),
    },
    "Q-learning": {
        "steps": ({"type": COUNT}, 100_000, "number of steps"),
        "epsilon": (
            {"type": SHARE},
            1.0,
            "chance of a random action; at 1 all comparators see the same transitions",
        ),
        "exploration": (
            {"choices": ("constant", "decaying", "restarts", "optimistic", "uniform")},
            None,
            "a named way of exploring, in place of epsilon",
        ),
        "indifference": ({"type": SHARE}, 0.0, "undecided pairs this close count as equal (share of range)"),
        "close": ({"type": SHARE}, 0.005, "the indifference of posterior-close"),
    },
    "value iteration": {
        "tolerance": ({"type": POSITIVE}, 0.005, "policy loss aimed at (share of range)"),
        "max_sweeps": ({"type": COUNT}, 200, "stop there; a tutor who errs anew each time keeps it going"),
    },
    "Bradley-Terry": {
        "precision": ({"type": SCALE}, 300.0, "the prior's, logits per unit of d.e"),
        "n_boot": ({"type": COUNT}, 50, "number of resamples"),
        "level": ({"type": INNER}, 0.95, "confidence level, also the posterior's"),
        "refit_growth": ({"type": SCALE}, 0.05, "growth of the answers between two fits; 0: fit at each"),
    },
    "posterior and relaxed polytope": {
        "lapse": ({"type": LAPSE}, 0.1, "share of answers that the posterior takes to be given at random"),
        "particles": ({"type": PARTICLES}, 1000, "number of particles"),
        "slack": ({"type": SCALE}, 0.0, "violation allowed beyond the least (share of range)"),
    },
}
DEFAULTS = defaults_of(_OPTIONS)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("qlearn", description="Reinforcement learning with ordinal rewards and a tutor.")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    ablation = commands.add_parser(
        "ablate",
        help="compare the comparators: what they cost in questions and in policy loss, and where they break",
        description="Run comparators x learners x tutors x problems over several seeds with common random numbers. "
        "Prints a table and writes runs.csv (one row a run), summary.csv (one a cell), times.csv and ablation.png. "
        "Runs.csv is the same for the same options on any number of processes. Every run is kept in journal.jsonl as "
        "it finishes: after Ctrl-C, or worse, the same command computes what is missing.",
    )
    ablation.set_defaults(command=_ablate)
    add_where(ablation, "results/ablation")
    size = ablation.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="a tiny setting, to see that it works (seconds)")
    size.add_argument(
        "--paper",
        action="store_true",
        help="the paper's 1e5 steps and 20 runs; 200 resamples, fitted anew at every answer (takes many hours)",
    )
    add_groups(ablation, _OPTIONS)
    figures_command.add_to(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
