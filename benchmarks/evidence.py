"""Make pages of results again, by the manifest in pages.toml: ``make evidence``.

    python -m benchmarks.evidence                        all pages: state, minutes, what they need,
                                                         command
    python -m benchmarks.evidence --all                  make what is stale again: hours
    python -m benchmarks.evidence --only claims RESULTS  of these pages only
    python -m benchmarks.evidence --stale                say which pages are stale; the exit code is
                                                         1 if any is
    python -m benchmarks.evidence --repeat               make some rows of each stale page again;
                                                         where all have the digits of their page
                                                         its stamp says so

A page is stale if its stamp (``stamps``) names other sources than those of its program now, or
none, unless some of its rows were made again with the sources of now and were the same. If making
is stopped, the same command goes on, because pages that are done are current then. The programs
with a journal also keep the runs of a page that they have finished.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from datetime import date
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


HOLDING = ("current", "repeated")  # states of a page that is not stale


class Page(NamedTuple):
    """A page or table of results: an entry of pages.toml, which says what the fields are."""

    path: str
    command: str
    minutes: float
    needs: Sequence[str] = ()
    copy_of: str = ""
    seeds: str = ""
    sources: Sequence[str] = ()
    times: bool = False

    @property
    def name(self) -> str:
        """The name of the page in ``--only``."""
        return Path(self.path).stem

    @property
    def state(self) -> str:
        """State of the page: "current", "repeated", or why it is stale."""
        stamp = stamps.of(ROOT / self.path) if (ROOT / self.path).exists() else None
        if stamp is None or not stamp.sources:
            return "made before stamps" if stamp else "not stamped"
        now = self.sources_now
        if stamp.sources == now:
            return "current"
        return "repeated" if stamp.again_by == now else "of older sources"

    @property
    def stale(self) -> bool:
        """True if the page may show other numbers than the code of now would."""
        return self.state not in HOLDING

    @property
    def sources_now(self) -> str:
        """The hash of the code of now that the page's numbers depend on."""
        return stamps.sources(
            self.path if self.path.endswith(".ipynb") else self.command.split()[0]
        )


PAGES = tuple(Page(**entry) for entry in stamps.manifest())


def make(page: Page) -> bool:
    """Run a page's command, and stamp what the command does not stamp.

    Blocks of prose that quote the page are renewed. Returns whether the page is current then.
    """
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


def repeat(page: Page) -> bool:
    """Make some rows of a page again, and stamp the page if they have its digits.

    Returns whether they have. A page that shows times is not stamped: they are not compared.
    """
    from benchmarks.rows_again import NOT_AGAIN, SAMPLES, differing

    samples = [sample for sample in SAMPLES if sample.page == page.name]
    why = NOT_AGAIN.get(page.name, "it shows times, which no digits confirm" if page.times else "")
    if why:
        print(f"{page.path} is to be made again whole: {why}", flush=True)
        return False
    now = page.sources_now
    other = [found for sample in samples for found in differing(page, sample.again)]
    for found in other:
        print(f"{page.path} has no such row: {found}", flush=True)
    stamp = stamps.of(ROOT / page.path)
    if other or stamp is None:
        return False
    day = date.today().isoformat()
    stamps.put(ROOT / page.path, stamp._replace(again=day, again_by=now))
    print(f"{page.path}: rows made again are the same", flush=True)
    return True


def missing(page: Page) -> list[str]:
    """Return the extras that the page needs and that are not installed."""
    return [extra for extra in page.needs if find_spec(NEEDS[extra]) is None]


def tell(states: Sequence[tuple[Page, str]]) -> None:
    """Print pages with their states, and what it would take to make those that are stale."""
    for page, state in states:
        needs = f" (needs {', '.join(page.needs)})" if page.needs else ""
        print(f"{page.name}: {state}; {page.minutes:g} min{needs}: python -m {page.command}")
    stale = [page for page, state in states if state not in HOLDING]
    hours = sum(page.minutes for page in stale) / 60
    print(
        f"--all makes the {len(stale)} that are stale again, in about {hours:.0f} hours; "
        "--only NAME some of them"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns 1 if a page is, or is left, stale."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.evidence", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=[page.name for page in PAGES],
        metavar="NAME",
        help="these pages only: make what is stale, or with --repeat some of its rows",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--all", action="store_true", help="make all that is stale: hours")
    what.add_argument(
        "--stale", action="store_true", help="say which pages are stale, and make none"
    )
    what.add_argument(
        "--repeat",
        action="store_true",
        help="make some rows of stale pages again, and stamp the pages where they are the same",
    )
    parser.add_argument(
        "--fresh", action="store_true", help="with --all or --only: make those that are current too"
    )
    given = parser.parse_args(arguments)
    makes = (given.all or given.only or given.repeat) and not given.stale
    if given.fresh and (given.repeat or not makes):
        parser.error("--fresh goes with --all, or with --only and the names of pages")
    chosen = [page for page in PAGES if given.only is None or page.name in given.only]
    if not makes:
        states = [(page, page.state) for page in chosen if page.stale or not given.stale]
        if states or not given.stale:
            tell(states)
        return int(given.stale and bool(states))
    left = []
    for page in chosen:
        if not page.stale and not given.fresh:
            print(f"{page.path} is {page.state}")
        elif extras := missing(page):
            print(f"{page.path} needs pip install -e '.[{','.join(extras)}]'", file=sys.stderr)
            left.append(page)
        elif not (repeat(page) if given.repeat else make(page)):
            left.append(page)
    if left:
        print(f"left as they were: {', '.join(page.path for page in left)}", file=sys.stderr)
    return int(bool(left))


if __name__ == "__main__":
    sys.exit(main())
