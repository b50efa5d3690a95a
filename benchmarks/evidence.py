"""Every page of results, the command that makes it, and whether it is of the code of today: ``make
evidence``.

    python -m benchmarks.evidence                        all pages: state, minutes, what they need,
                                                         command
    python -m benchmarks.evidence --all                  make what is stale again, page by page, in
                                                         this order: hours
    python -m benchmarks.evidence --only claims RESULTS  of these pages only
    python -m benchmarks.evidence --stale                say which pages are stale; the exit code is
                                                         1 if any is

A page is stale if its stamp (``stamps``) names other sources than those its program would run now,
or none. Stopped, the same command goes on, for pages that are done are current then. Within a page
the figures, the ablation and the programs with a journal keep their finished runs; the others begin
their page again.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from benchmarks import quotes, stamps

ROOT = stamps.ROOT
NEEDS = {
    "peers": "quantecon",
    "sb3": "stable_baselines3",
    "browser": "playwright",
}  # an extra, and a package of it


class Page(NamedTuple):
    """A page or table: where it lies; what follows ``python -m`` to make it; about how many minutes
    on two cores; the extras that takes beside ``dev``. Where the command writes elsewhere: what the
    page is a copy of, and its seeds."""

    path: str
    command: str
    minutes: float
    needs: tuple[str, ...] = ()
    copy_of: str = ""
    seeds: str = ""

    @property
    def name(self) -> str:
        """What it is called in ``--only``."""
        return Path(self.path).stem

    @property
    def sources(self) -> str:
        """The hash of what its program would run now."""
        return stamps.sources(
            self.path if self.path.endswith(".ipynb") else self.command.split()[0]
        )

    @property
    def state(self) -> str:
        """The word "current", or why it is not."""
        stamp = stamps.of(ROOT / self.path) if (ROOT / self.path).exists() else None
        if stamp is None or not stamp.sources:
            return "made before stamps" if stamp else "not stamped"
        return "current" if stamp.sources == self.sources else "of older sources"


def results(name: str, command: str, minutes: float, *needs: str) -> Page:
    """A page of ``benchmarks`` that its program writes."""
    path = f"benchmarks/{name}.md"
    return Page(path, f"benchmarks.{command} --out {path}", minutes, needs)


def notebook(name: str, minutes: float) -> Page:
    """A notebook with what its cells print."""
    return Page(f"notebooks/{name}.ipynb", f"notebooks.execute {name}", minutes)


PAGES = (  # a notebook after the tables that it reads
    Page(
        "notebooks/data/figures.csv",
        "qlearn figures --out results/figures",
        26,
        copy_of="results/figures/runs.csv",
        seeds="0-19",
    ),
    Page("docs/claims.md", "benchmarks.paper.figure_pages", 0.1),
    Page(
        "docs/assumptions.md",
        "benchmarks.paper.assumptions --journal results/assumptions.jsonl --out docs/assumptions.md",  # noqa: E501
        60,
    ),
    Page(
        "docs/literal.md",
        "benchmarks.paper.literal --journal results/literal.jsonl --out docs/literal.md",
        25,
    ),
    Page("docs/exploration.md", "benchmarks.paper.exploration --out docs/exploration.md", 5),
    Page(
        "notebooks/data/ablation.csv",
        "benchmarks.paper.ablation_table --out notebooks/data/ablation.csv",
        30,
    ),
    results("RESULTS-certified", "asking.certificates --journal results/certificates.jsonl", 25),
    results(
        "RESULTS-questions", "asking.question_counts --journal results/question_counts.jsonl", 70
    ),
    results(
        "RESULTS-question-rules", "asking.question_rules --journal results/question_rules.jsonl", 10
    ),
    Page("docs/about-equal.md", "benchmarks.asking.about_equal --out docs/about-equal.md", 20),
    results("RESULTS-headroom", "asking.headroom", 3),
    results("RESULTS-loss", "asking.loss_by_questions", 10),
    results("RESULTS-contest", "contest.redraw", 0.5),
    results("RESULTS-cuts", "asking.cuts_and_pairs --journal results/cuts.jsonl", 15),
    results(
        "RESULTS-families", "comparing.families_and_rules --journal results/families.jsonl", 15
    ),
    results("RESULTS-wrong", "asking.wrong_answers --journal results/wrong.jsonl", 30),
    results("RESULTS-kinds", "people.kinds_of_question --journal results/kinds.jsonl", 8),
    results("RESULTS-sessions", "asking.person_sessions", 10, "browser"),
    results("RESULTS-scale", "asking.certify_at_scale --huge", 15),
    results(
        "RESULTS-growth", "learning.growth_by_size --journal results/growth.jsonl", 15, "peers"
    ),
    results("RESULTS-calibration", "fitting.calibration --journal results/calibration.jsonl", 35),
    results("RESULTS-lapse", "fitting.calibration_questions --flips 0 0.1 0.2", 8),
    results("RESULTS-bradley-terry", "fitting.fit_cost", 15),
    results(
        "RESULTS-posteriors",
        "posteriors.preference_posteriors --journal results/posteriors.jsonl",
        10,
        "peers",
    ),
    results("RESULTS-people", "people.answers_of_people results/people", 20),
    results("RESULTS-people-gains", "people.gains results/people", 10),
    results("RESULTS-promise", "people.promise --jobs 2", 60),
    results("RESULTS-panel", "people.panel --journal results/panel.jsonl", 120),
    results("RESULTS", "learning.learning_cost", 25, "peers"),
    results("RESULTS-ivi", "learning.value_iteration_cost", 6, "peers"),
    results(
        "RESULTS-ivi-huge",
        "learning.value_iteration_cost --states 1000000 --repeats 1 --limit 1200",
        60,
        "peers",
    ),
    results("RESULTS-lp", "comparing.comparison_cost", 3),
    results("RESULTS-training", "training.training_questions", 15),
    Page(
        "notebooks/data/dqn_terrain.csv",
        "benchmarks.training.dqn_on_terrain --out notebooks/data/dqn_terrain.csv",
        10,
        ("sb3",),
    ),
    results("RESULTS-cold", "cold_start", 10),
    notebook("00_your_first_policy", 1),
    notebook("01_two_tutors", 1),
    notebook("02_polytope", 2),
    notebook("03_bradley_terry", 4),
    notebook("04_ablation", 1),
    notebook("05_paper_figures", 1),
    notebook("06_fewer_questions", 2),
    notebook("07_you_are_the_tutor", 1),
    notebook("08_beyond_tables", 4),
    notebook("09_real_people", 2),
    notebook("10_medical_scales", 1),
    notebook("11_several_experts", 1),
)


def make(page: Page) -> bool:
    """Run a page's command, stamp what the command itself does not stamp, and renew what prose
    quotes of the page; whether the page is current then."""
    command = f"python -m {page.command}"
    print(f"{page.path}, about {page.minutes:g} minutes: {command}", flush=True)
    begun = stamps.made_now(command, page.seeds, page.command.split()[0])
    done = subprocess.run([sys.executable, "-m", *page.command.split()], cwd=ROOT)
    if done.returncode:
        print(
            f"{page.path} stays as it was: its command ended with {done.returncode}",
            file=sys.stderr,
        )
        return False
    if page.copy_of:
        shutil.copyfile(ROOT / page.copy_of, ROOT / page.path)
        stamps.put(ROOT / page.path, begun)
    quotes.renew_beside(ROOT / page.path)
    return page.state == "current"


def missing(page: Page) -> list[str]:
    """Extras that the page needs and that are not installed."""
    return [extra for extra in page.needs if find_spec(NEEDS[extra]) is None]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns 1 if a page is, or is left, stale."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.evidence", description=(__doc__ or "").splitlines()[0]
    )
    names = [page.name for page in PAGES]
    parser.add_argument(
        "--only",
        nargs="+",
        choices=names,
        metavar="NAME",
        help="these pages only: make what is stale",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--all", action="store_true", help="make all that is stale: hours")
    what.add_argument(
        "--stale", action="store_true", help="say which pages are stale, and make none"
    )
    what.add_argument(
        "--list",
        action="store_true",
        help="say what there is, and make nothing, as without an option",
    )
    parser.add_argument(
        "--fresh", action="store_true", help="with --all or --only: make those that are current too"
    )
    given = parser.parse_args(arguments)
    makes = (given.all or given.only) and not given.stale and not given.list
    if given.fresh and not makes:
        parser.error("--fresh goes with --all, or with --only and the names of pages")
    chosen = [page for page in PAGES if given.only is None or page.name in given.only]
    if not makes and not given.stale:
        for page in chosen:
            needs = f" (needs {', '.join(page.needs)})" if page.needs else ""
            print(
                f"{page.name}: {page.state}; {page.minutes:g} min{needs}: python -m {page.command}"
            )
        stale = [page for page in chosen if page.state != "current"]
        hours = sum(page.minutes for page in stale) / 60
        print(
            f"--all makes the {len(stale)} that are stale again, in about {hours:.0f} hours; "
            "--only NAME some of them"
        )
        return 0
    if given.stale:
        stale = [page for page in chosen if page.state != "current"]
        for page in stale:
            print(f"{page.path} is {page.state}: python -m {page.command}")
        return int(bool(stale))
    left = []
    for page in chosen:
        if page.state == "current" and not given.fresh:
            print(f"{page.path} is current")
        elif extras := missing(page):
            print(f"{page.path} needs pip install -e '.[{','.join(extras)}]'", file=sys.stderr)
            left.append(page)
        elif not make(page):
            left.append(page)
    if left:
        print(f"left as they were: {', '.join(page.path for page in left)}", file=sys.stderr)
    return int(bool(left))


if __name__ == "__main__":
    sys.exit(main())
