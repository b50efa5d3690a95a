"""The command ``qlearn figures``: the paper's series, figures, and claims with intervals."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from qlearn.cli.options import KEPT, LAPSE, add_command, frame_of, write_csv
from qlearn.experiments.settings import FiguresSettings

QUICK: dict[str, Any] = {
    "levels": [4, 6, 8], "at_states": 20, "states": [20, 30, 40], "at_levels": 6, "actions": 3,
    "seeds": 3,
    "steps": 2000, "n_boot": 20, "particles": 200,
}  # fmt: skip
TEXTS = {
    "comparators": "the polytope (its tutor never errs); the posterior; and the paper's "
    "Bradley-Terry box: with each resample rescaled, which is one reading of the paper's footnote "
    "3 (box-rescaled), and as it is (box)",
    "lapse": LAPSE,
}


def add_to(commands: Any) -> None:
    """Add the subcommand to a parser's subcommands."""
    command = commands.add_parser(
        "figures",
        help="the paper's figures 2, 3 and 4, and its claims, with intervals over runs",
        description="Run the paper's two series of random MDPs for the polytope, the posterior and "
        "the paper's "
        "comparator, with tutors of several precisions and common random numbers. Writes figure2, "
        "figure3 "
        "and figure4 (.png, .svg), runs.csv (one row a run), "
        "summary.csv (means with 95% intervals), claims.csv and claims.md (trends and bounds with "
        "intervals) "
        "and times.csv. All but times.csv are the same for the same options on any number of "
        "processes. There is no "
        "budget of questions. " + KEPT,
    )
    add_command(command, run, FiguresSettings, QUICK, "results/figures", TEXTS)


def run(settings: FiguresSettings, out: Path, **how: Any) -> int:
    """Run the command and return the exit code. ``how`` are keywords of ``figures``."""
    from qlearn.paper.claims import claims, claims_page, summarise_series
    from qlearn.paper.figure_runs import KEYS, figures
    from qlearn.paper.figures import plot_asked, plot_loss, save

    frame, code = frame_of("figures", partial(figures, settings, **how), KEYS, out)
    if frame is None or code:
        return code
    summary, page = summarise_series(frame), claims_page(frame)
    write_csv(summary, out / "summary.csv")
    write_csv(claims(frame), out / "claims.csv")
    (out / "claims.md").write_text(page, encoding="utf-8")
    save(plot_asked(summary, "levels"), out, "figure2")
    save(plot_asked(summary, "states"), out, "figure3")
    save(plot_loss(summary), out, "figure4")
    print(page)
    print(
        f"written to {out}: figure2, figure3, figure4 (.png, .svg), runs.csv, summary.csv, "
        "claims.csv, claims.md,"
    )
    print("times.csv; and journal.jsonl, from which the same command takes what has finished")
    return code
