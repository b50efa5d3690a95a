"""The rows behind notebook 04: comparators x learners x tutor errors, for several k and on real and
known tasks.

    python -m benchmarks.paper.ablation_table --out notebooks/data/ablation.csv
        # three quarters of an hour on two cores
    python -m benchmarks.paper.ablation_table --out notebooks/data/ablation.csv --steps 20000 \
        --seeds 2
        # rough

Each part is ``qlearn.ablation.ablate`` with its defaults but for what is said here; the journal
beside the file lets it go on where it was stopped.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.stamps import sign
from qlearn.experiments.ablation import ablate
from qlearn.experiments.catalogue import LEARNERS

COMPARATORS = ("always", "polytope", "posterior", "posterior-close", "box")
ERROR_RATES = (0.0, 0.05, 0.15, 0.3)
# share of the decided pairs that audited runs put to the tutor all the same: one or two hundred
AUDIT = 0.002
LEVELS = (5, 10, 20)  # of the random MDPs
TASKS = ("frozen-lake", "deep-sea-treasure", "icu-sepsis", "surgery", "rover")


def table(
    *,
    levels: Sequence[int] = LEVELS,
    tasks: Sequence[str] = TASKS,
    steps: int = 100_000,
    max_sweeps: int = 200,
    journal: Path | None = None,
    **settings: Any,
) -> pd.DataFrame:
    """One row a run, as ``ablate`` gives it, with audited runs as long as the others, and these
    columns: ``k``, the number of levels; ``name``, the comparator, or "polytope, audited";
    ``questions``, audits included; ``excess``, true policy loss beyond the oracle's of the same
    problem, learner and seed, in percent of the value range; the loss itself for a learner without
    an oracle, as policy iteration is."""
    common: dict[str, Any] = {
        "comparators": COMPARATORS,
        "error_rates": ERROR_RATES,
        "audit": AUDIT,
        "steps": steps,
        "audit_steps": steps,
        "max_sweeps": max_sweeps,
        "audit_sweeps": max_sweeps,
        **settings,
        "journal": journal,
    }
    parts = [ablate(problems=["random"], levels=k, **common).assign(k=k) for k in levels]
    common |= {
        "exploration": "decaying"
    }  # uniformly, Q-learning hardly ever gets to the goal of some of them
    parts += [ablate(problems=[task], **common).assign(k=_levels_of(task)) for task in tasks]
    rows = pd.concat(parts, ignore_index=True)
    audited = rows.comparator.where(
        (rows.audit == 0) | (rows.comparator != "polytope"), "polytope, audited"
    )
    oracle = rows[(rows.comparator == "always") & (rows.error_rate == 0)]
    place = ["problem", "k", "learner", "seed"]
    baseline = rows[place].merge(oracle[[*place, "loss"]], on=place, how="left").loss
    baseline[
        rows.learner.isin([name for name, learner in LEARNERS.items() if learner.needs_proof])
    ] = 0.0
    return rows.assign(
        name=audited, questions=rows.asked + rows.audited, excess=100 * (rows.loss - baseline)
    )


def _levels_of(task: str) -> int:
    from qlearn.experiments.ablation import instance

    return instance(task, 0, (0, 0, 0, 0.0))[0].k


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.paper.ablation_table", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="the CSV to write")
    parser.add_argument("--seeds", type=int, default=8, help="number of seeds (default: 8)")
    parser.add_argument(
        "--steps", type=int, default=100_000, help="steps of Q-learning (default: 1e5)"
    )
    parser.add_argument(
        "--max-queries", type=int, default=2000, help="question budget (default: 2000)"
    )
    parser.add_argument("--jobs", type=int, default=-1, help="processes (default: one a core)")
    chosen = vars(parser.parse_args(arguments))
    out: Path = chosen.pop("out")
    out.parent.mkdir(parents=True, exist_ok=True)
    rows = table(journal=out.with_suffix(".jsonl"), **chosen)
    rows.to_csv(out, index=False, lineterminator="\n")
    sign(out, f"0-{chosen['seeds'] - 1}")
    print(f"{len(rows)} rows written to {out}")


if __name__ == "__main__":
    main()
