"""Predictions of people's answers by the posterior, today and before people's answers were read.

Needs the folder with the tables that are not shipped (docs/people.md says what they hold), and a
clone with the project's history.

    python -m benchmarks.history.people_before FOLDER --out benchmarks/RESULTS-people-before.md
"""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.history import in_older_code, repeated
from benchmarks.history.in_older_code import FOLDS
from benchmarks.people import comparators
from benchmarks.people.choices import (
    Choices,
    calibration_error,
    choices_of,
    choosing_half,
    deal,
    log_likelihood,
    over_people,
    shown,
)
from benchmarks.people.gains import LEVELS, SEED, answers_of, gain
from benchmarks.reporting import machine, main_of_people, markdown
from benchmarks.stamps import ROOT
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.pairs import pair_numbers
from elicit.model.scale import Floats
from elicit.people.experiments import lottery_choices, repeated_gambles

BEFORE = "afedb709017fa84f146b75e0b12e20cdd9c87685"
"""The last commit before answers of people came into the repository."""
DAY = "23 November 2026"
GAMBLES = "gambles_45_times.csv"
FIRST = 16  # people at the head of the table of lotteries

People = NDArray[np.intp]


class Older(NamedTuple):
    """Predictions by the older code: see ``in_older_code``."""

    chance: Floats
    verdict: Floats
    scores: Floats


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    main_of_people("benchmarks.history.people_before", report, f"{SEED}", arguments)


def report(folder: Path, quick: bool = False) -> Iterator[list[str]]:
    """Yield the page, part by part."""
    most = 6 if quick else None
    logs = dict(list(lottery_choices(folder, LEVELS).items())[:most])
    choices = choices_of(logs)
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    first = np.array([choices.names.index(name) for name in list(logs)[: 3 if quick else FIRST]])
    before = by_older_code(choices, fold_of, np.flatnonzero(~half), first)
    yield [
        "# Predictions of people: before their answers were read, and since",
        "",
        "Of [the same people](RESULTS-people.md), split in the same way, with the same folds. "
        f"*Before* is the posterior of {DAY} (commit {BEFORE[:8]}), the last one before answers "
        "of people came into the repository. Its code runs on the same answers, in a process of "
        "its own. *Today* is the posterior of now. A gain is in nats an answer, person by "
        "person on the same answers. Intervals are of 95%, by a bootstrap over people.",
    ]
    yield list(reporting_half(choices, fold_of, before))
    yield list(first_people(choices, first, before))
    gambles = {"20 times": repeated_gambles(), "45 times": repeated_gambles(folder / GAMBLES)}
    yield from repeated.sections(
        {name: dict(list(x.items())[:most]) for name, x in gambles.items()}
    )
    yield ["## Machine", "", machine("one thread")]


def by_older_code(choices: Choices, fold_of: People, whole: People, first: People) -> Older:
    """Return predictions of the code of ``BEFORE``, which runs in a process of its own.

    Raises RuntimeError if this is no clone with the project's history.
    """
    with tempfile.TemporaryDirectory() as place:
        packed = subprocess.run(
            ["git", "archive", BEFORE, "elicit"], cwd=ROOT, capture_output=True, check=False
        )
        if packed.returncode:
            raise RuntimeError(
                f"git has no commit {BEFORE[:8]} in {ROOT}: {packed.stderr.decode().strip()}. Run "
                "this in a clone with the whole history (git fetch --unshallow)"
            )
        with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
            archive.extractall(place, filter="data")
        source, out = Path(place, "in.npz"), Path(place, "out.npz")
        np.savez(source, d=choices.d, said=choices.said, fold=fold_of, whole=whole, first=first)
        subprocess.run(
            [sys.executable, in_older_code.__file__, str(source), str(out)],
            cwd=place,
            env={**os.environ, "PYTHONPATH": place},
            check=True,
        )
        found = np.load(out)
        if not Path(str(found["place"])).is_relative_to(Path(place).resolve()):
            raise RuntimeError(f"not the older code was run, but {found['place']}")
        return Older(found["chance"], found["verdict"], found["scores"])


def like_choosing_half(choices: Choices, without: Sequence[int] = ()) -> PosteriorComparator:
    """Return a posterior that knows the choosing half's people, all their answers."""
    half = np.flatnonzero(choosing_half(len(choices.names)))
    told = [answers_of(choices, int(i)) for i in half if i not in set(without)]
    return PosteriorComparator(LEVELS, like=told)


def reporting_half(choices: Choices, fold_of: People, before: Older) -> Iterator[str]:
    """Yield the lines on the reporting half of the lotteries."""
    who = ~choosing_half(len(choices.names))
    like = like_choosing_half(choices).like
    today, known = (
        comparators.on_questions(
            lambda k, prior=prior: PosteriorComparator(k, like=prior), choices, fold_of, who
        )
        for prior in (None, like)
    )
    said, old = choices.said[who], before.chance[who]
    rows = []
    for name, chance, verdict in (
        ("before", before.chance, before.verdict),
        ("today", today.chance, today.verdict),
        (f"today, like {like.people if like else 0} earlier people", known.chance, known.verdict),
    ):
        p, v, clear = chance[who], verdict[who], choices.answered[who]
        decided = clear & (np.abs(v) == 1)
        wrong = decided & (v == np.where(said == 1, -1, 1))
        n = len(p)
        rows.append([
            name,
            shown(over_people(lambda i, p=p: log_likelihood(p[i], said[i]), n)),
            "" if name == "before" else gain(p, old, said),
            shown(over_people(lambda i, p=p: calibration_error(p[i], said[i]), n)),
            _share(decided.sum(axis=1), clear.sum(axis=1)),
            _share(wrong.sum(axis=1), decided.sum(axis=1)),
        ])  # fmt: skip
    apart = np.abs(today.chance - before.chance)[who]
    yield f"## The reporting half: {int(who.sum())} people"
    yield ""
    yield (
        f"Lotteries with {LEVELS} levels; each fifth of a person's answers is predicted by the "
        'rest. Without the answer "equal", the posterior\'s law and its prior are today what they '
        f"were before: the two probabilities of an answer differ by {np.nanmean(apart):.3f} in the "
        f"mean and by at most {np.nanmax(apart):.2f}, because the particles are drawn otherwise. "
        "The earlier people are of the choosing half."
    )
    yield ""
    head = ("", "log-likelihood", "gain", "calibration error", "decided", "answered otherwise")
    yield from markdown(head, rows, 1)
    yield ""
    named = {"today": today, f"today, like {like.people if like else 0} earlier people": known}
    yield from put_twice(choices, who, named)


def put_twice(
    choices: Choices, who: NDArray[np.bool_], found: Mapping[str, comparators.Predictions]
) -> Iterator[str]:
    """Yield the lines on the pairs of lotteries that were put twice, as two questions."""
    numbers = pair_numbers(choices.d)
    times = np.bincount(numbers)[numbers]
    if not (times == 2).any():
        return
    said, answered = choices.said[who], choices.answered[who]
    differ = np.transpose([
        np.ptp(said[:, numbers == number], axis=1) for number in sorted(set(numbers[times == 2]))
    ])  # fmt: skip
    both = ~np.isnan(differ)
    rows = []
    for name, (verdict, chance, _) in found.items():
        for label, these in (("once", times == 1), ("twice", times == 2)):
            v, p, y, clear = (x[:, these] for x in (verdict[who], chance[who], said, answered))
            decided = clear & (np.abs(v) == 1)
            wrong = decided & (v == np.where(y == 1, -1, 1))
            rows.append([
                name, label, f"{int(these.sum())}",
                shown(over_people(lambda i, p=p, y=y: log_likelihood(p[i], y[i]), len(p))),
                _share(decided.sum(axis=1), clear.sum(axis=1)),
                _share(wrong.sum(axis=1), decided.sum(axis=1)),
            ])  # fmt: skip
    yield (
        f"{int((times == 1).sum())} of the questions are about a pair that was put once, and "
        f"{int((times == 2).sum())} about {int((times == 2).sum()) // 2} pairs that were put "
        "twice. The two answers to these differ in "
        f"{_share((np.nan_to_num(differ) > 0).sum(axis=1), both.sum(axis=1))} of the cases: so "
        "often is one answer of a person contradicted by another. If the one is in another fold "
        "than the other, it is among the answers that the other is predicted from. *Once*: the "
        "answers for which this cannot be."
    )
    yield ""
    head = ("", "pair put", "questions", "log-likelihood", "decided", "answered otherwise")
    yield from markdown(head, rows, 2)


def first_people(choices: Choices, first: People, before: Older) -> Iterator[str]:
    """Yield the lines on the people on whom the posterior was first tried."""
    like = like_choosing_half(choices, first.tolist())
    told = [answers_of(choices, int(i)) for i in first]
    found = {
        "before": before.scores,
        "today": _scores(PosteriorComparator(LEVELS), told),
        f"today, like {like.like.people if like.like else 0} earlier people": _scores(like, told),
    }
    rows = []
    for name, (score, scored, decided, wrong) in ((x, y.T) for x, y in found.items()):
        apart = score - before.scores[:, 0]
        rows.append([
            name,
            shown(over_people(lambda i, s=score: float(s[i].mean()), len(score))),
            "" if name == "before"
            else shown(over_people(lambda i, a=apart: float(a[i].mean()), len(apart)), 4),
            _share(decided, scored),
            _share(wrong, decided),
        ])  # fmt: skip
    half = choosing_half(len(choices.names))
    yield f"## The first {len(first)} people"
    yield ""
    yield (
        "Before, a log-likelihood of -0.607 was measured on 16 people of one experiment, with 27% "
        "decided and 19% of this answered otherwise. It is not on record which people they were, "
        "and which folds. They had 69 answers each. The closest to it that was found are the "
        f"first {len(first)} people of the table of lotteries, who have 70 answers each, in "
        f"{FOLDS} folds of `elicit.held_out`. {int(half[first].sum())} of them are of the choosing "
        "half, on which the number of levels was chosen. None of them is among the earlier people, "
        "who are the rest of that half."
    )
    yield ""
    head = ("", "log-likelihood", "gain", "decided", "answered otherwise")
    yield from markdown(head, rows, 1)


def _scores(comparator: PosteriorComparator, told: Sequence[object]) -> Floats:
    return np.array([in_older_code.scores_of(comparator, each) for each in told])  # type: ignore[arg-type]


def _share(part: NDArray[np.generic], whole: NDArray[np.generic]) -> str:
    """Return a share of sums over people as text."""
    a, b = np.asarray(part, dtype=np.float64), np.asarray(whole, dtype=np.float64)
    found = over_people(lambda i: float(a[i].sum() / max(1.0, b[i].sum())), len(a))
    return shown(found, 1, percent=True)


if __name__ == "__main__":
    main()
