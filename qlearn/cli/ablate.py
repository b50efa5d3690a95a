"""The command ``qlearn ablate``: the questions that each comparator needs, and its policy loss."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from qlearn.cli.options import KEPT, LAPSE, add_command, add_preset, frame_of, write_csv
from qlearn.experiments.catalogue import COMPARATORS
from qlearn.experiments.settings import AblationSettings

QUICK: dict[str, Any] = {  # so small that ten seeds take seconds and tell the comparators apart
    "problems": ["random"],
    "comparators": [name for name, entry in COMPARATORS.items() if entry.quick],
    "error_rates": [0.0, 0.15],
    "states": 10, "actions": 3, "levels": 5, "discount": 0.8, "seeds": 10, "steps": 600,
    "tolerance": 0.02,
    "max_sweeps": 50, "max_queries": 150, "n_boot": 10, "refit_growth": 0.2, "particles": 200,
    "audit": 0.0,
}  # fmt: skip
TEXTS = {
    "tutors": "further tutors, beside those of the error rates: person, who errs as people were "
    "seen to (another one for each seed), or your own [none]",
    "tie": "comparators assume that a tutor may call two things equal if they differ by at most "
    "this share of the range [0 for the tutors of the error rates, 0.01 for person and your own]",
    "exploration": "a named way of exploring, in place of epsilon [none]",
    "lapse": LAPSE,
}
PAPER: dict[str, Any] = {"seeds": 20, "n_boot": 200, "refit_growth": 0.0}


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "ablate",
        help="compare the comparators: what they cost in questions and in policy loss, and where "
        "they break",
        description="Run comparators x learners x tutors x problems over several seeds with common "
        "random numbers. "
        "Prints a table and writes runs.csv (one row a run), summary.csv (one a cell), times.csv "
        "and ablation.png. "
        "Runs.csv is the same for the same options on any number of processes. " + KEPT,
    )
    presets = add_command(command, run, AblationSettings, QUICK, "results/ablation", TEXTS)
    text = (
        "the paper's 1e5 steps and 20 runs; 200 resamples, fitted anew at every answer (takes many "
        "hours)"
    )
    add_preset(presets, "--paper", PAPER, text)


def run(settings: AblationSettings, out: Path, **how: Any) -> int:
    """Run the command and return the exit code. ``how`` are keywords of ``ablate``."""
    from qlearn.experiments.ablation import KEYS, ablate, plan_of, summarise
    from qlearn.experiments.ablation_plot import LEGEND, plot_ablation, table

    frame, code = frame_of("ablation", partial(ablate, settings, **how), KEYS, out)
    if frame is None:
        return code
    summary = summarise(frame)
    write_csv(summary, out / "summary.csv")
    size = "{states} states, {actions} actions, {levels} levels".format(
        **settings.named("states", "actions", "levels")
    )
    shown: dict[str, Any] = {"names": {"random": f"random MDP ({size})"}, "seeds": settings.seeds}
    plot_ablation(summary, max_queries=settings.max_queries, **shown).savefig(
        out / "ablation.png", dpi=150
    )
    print(table(summary, **shown), LEGEND, sep="\n\n")
    plan = plan_of(settings)
    if len(frame) < len(plan):
        cells = {tuple(cell[key] for key in KEYS if key != "seed") for cell in plan}
        print(
            f"\nINCOMPLETE: {len(frame)} of {len(plan)} runs; of {len(cells) - len(summary)} rows "
            "there are none yet"
        )
    print(
        f"\nwritten to {out}: runs.csv (a row a run), summary.csv (a row a cell), times.csv, "
        "ablation.png; and"
    )
    print("journal.jsonl, from which the same command takes what has finished")
    return code
