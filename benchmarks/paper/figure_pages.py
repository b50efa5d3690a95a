"""Make docs/claims.md from the runs of the paper's figures, and renew what quotes the runs.

python -m benchmarks.paper.figure_pages                             from the committed runs
python -m benchmarks.paper.figure_pages results/figures/runs.csv    from those of `make figures`,
                                                                    which it commits
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from benchmarks import quotes
from benchmarks.reporting import save
from qlearn.paper.claims import claims_page

ROOT = Path(__file__).resolve().parents[2]
RUNS = ROOT / "notebooks" / "data" / "figures.csv"


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the page, keep the runs that it is of, and renew the blocks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "runs",
        nargs="?",
        type=Path,
        default=RUNS,
        help="runs.csv of `qlearn figures` [%(default)s]",
    )
    given = parser.parse_args(arguments).runs
    if given.resolve() != RUNS:
        shutil.copyfile(given, RUNS)
    frame = pd.read_csv(RUNS)
    save(claims_page(frame), ROOT / "docs" / "claims.md", f"0-{frame.seed.max()}")
    quotes.renew()


if __name__ == "__main__":
    main()
