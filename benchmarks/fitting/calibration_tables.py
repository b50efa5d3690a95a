"""The tables of the calibration: data sets pooled into cells, their intervals, and which are
judged.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from benchmarks.reporting import machine

Ints: TypeAlias = NDArray[np.int64]
PROMISE = 0.05
ENOUGH_DECIDED, ENOUGH_SETS = 200, 30  # a cell with fewer is shown, not judged
RESAMPLES = 2000


class Row(NamedTuple):
    """One rule on one data set: how many pairs were open, decided and decided wrongly; ``seconds``
    for the answers since the row before."""

    pairs: str
    setting: str
    rule: str
    k: int
    answers: int
    number: int
    open: int
    decided: int
    wrong: int
    seconds: float
    learned: int


class Share(NamedTuple):
    """A share, and the ends of its 95% interval; nan of nothing."""

    at: float
    low: float
    high: float

    @staticmethod
    def of(part: int, whole: int, parts: Ints, wholes: Ints) -> Share:
        """Make a share from its totals, and from the totals (m,) of resamples."""
        some = wholes > 0
        if not whole or not some.any():
            return Share(np.nan, np.nan, np.nan)
        return Share(
            part / whole, *np.quantile(parts[some] / wholes[some], (0.025, 0.975)).tolist()
        )


class Cell(NamedTuple):
    """All data sets of one rule, setting, k and number of answers together."""

    pairs: str
    setting: str
    rule: str
    k: int
    answers: int
    sets: int
    open: int
    decided: int
    wrong: int
    share_decided: Share
    share_wrong: Share
    judged: bool
    ms_per_answer: float

    @property
    def broken(self) -> bool:
        """True if the error rate significantly exceeds the promise (95%)."""
        return self.judged and self.share_wrong.low > PROMISE

    def flat(self) -> dict[str, object]:
        """A line of the table of cells."""
        line: dict[str, object] = {}
        for name, value in self._asdict().items():
            if isinstance(value, Share):
                line |= {name: value.at, f"{name}_low": value.low, f"{name}_high": value.high}
            else:
                line[name] = value
        return line


def summary(rows: Iterable[Row]) -> list[Cell]:
    """The data sets of each cell together; kinds of pairs, settings and rules in the order of their
    first rows.
    """
    told = list(rows)
    place = {
        name: i
        for i, name in enumerate(
            dict.fromkeys(x for r in told for x in (r.pairs, r.setting, r.rule))
        )
    }

    def cell_of(row: Row) -> tuple[int, ...]:
        return place[row.pairs], place[row.setting], row.k, row.answers, place[row.rule]

    return [
        cell(list(group)) for _, group in groupby(sorted(told, key=cell_of), key=cell_of)
    ]  # sets stay in order


def cell(rows: list[Row]) -> Cell:
    """Pooled shares, with percentile intervals from resampled data sets."""
    counts = np.array([(row.open, row.decided, row.wrong) for row in rows])
    n, first, (opened, decided, wrong) = len(rows), rows[0], counts.sum(axis=0).tolist()
    weights = np.random.default_rng(0).multinomial(n, np.full(n, 1.0 / n), RESAMPLES)
    resampled = (weights @ counts).T
    return Cell(
        pairs=first.pairs,
        setting=first.setting,
        rule=first.rule,
        k=first.k,
        answers=first.answers,
        sets=n,
        open=opened,
        decided=decided,
        wrong=wrong,
        share_decided=Share.of(decided, opened, resampled[1], resampled[0]),
        share_wrong=Share.of(wrong, decided, resampled[2], resampled[1]),
        judged=n >= ENOUGH_SETS and decided >= ENOUGH_DECIDED,
        ms_per_answer=1e3
        * sum(row.seconds for row in rows)
        / max(1, sum(row.learned for row in rows)),
    )


def report(cells: list[Cell]) -> Iterator[str]:
    """The report, as lines of Markdown."""
    yield from ("# Wrong among decided", "", machine("one thread"), "", *NOTES, "")
    for (pairs, setting), group in groupby(cells, key=lambda c: (c.pairs, c.setting)):
        here = list(group)
        names = list(dict.fromkeys(c.rule for c in here))
        yield from (
            f"## {_TITLES[pairs]}: {setting}",
            "",
            "| k | answers | " + " | ".join(names) + " |",
        )
        yield "|---:|---:|" + "---|" * len(names)
        for k, n in sorted({(c.k, c.answers) for c in here}):
            found = {c.rule: c for c in here if (c.k, c.answers) == (k, n)}
            yield f"| {k} | {n} | " + " | ".join(shown(found[name]) for name in names) + " |"
        yield ""
    yield from costs(cells)
    broken = [c for c in cells if c.broken]
    judged = sum(c.judged for c in cells)
    yield from (
        "## Promises broken",
        "",
        f"{judged} of {len(cells)} cells are judged; {len(broken)} break the promise.",
        "",
    )
    for c in sorted(broken, key=lambda c: -c.share_wrong.low):
        yield (
            f"- {c.rule}; {_TITLES[c.pairs].lower()}, {c.setting}, k = {c.k}, {c.answers} answers: "
            f"{shown(c)}"
        )


def shown(c: Cell) -> str:
    """A cell of the tables."""
    if not c.decided:
        return "0 / -"
    decided, (at, low, high) = 100 * c.share_decided.at, (100 * x for x in c.share_wrong)
    text = f"{decided:.0f} / {at:.1f} [{low:.1f}, {high:.1f}]"
    return f"**{text}**" if c.broken else text if c.judged else f"({text})"


def costs(cells: list[Cell]) -> Iterator[str]:
    """Milliseconds an answer on fresh pairs, where the answers come one after the other."""
    fresh = [c for c in cells if c.pairs == "fresh" and c.rule.startswith("posterior")]
    counts = sorted({c.answers for c in fresh})
    yield from ("## Milliseconds an answer, the verdicts on fresh pairs included", "")
    yield "| k | rule | " + " | ".join(f"up to {n}" for n in counts) + " |"
    yield "|---:|---|" + "---:|" * len(counts)
    for k, rule in sorted({(c.k, c.rule) for c in fresh}):
        means = [
            [c.ms_per_answer for c in fresh if (c.k, c.rule, c.answers) == (k, rule, n)]
            for n in counts
        ]
        yield (
            f"| {k} | {rule} | "
            + " | ".join(f"{np.mean(m):.2f}" if m else "-" for m in means)
            + " |"
        )
    yield ""


_TITLES = {
    "fresh": "Fresh pairs",
    "Q-learning": "Pairs that Q-learning chose",
    "value iteration": "Pairs that value iteration chose",
}
NOTES = [
    "Each entry: percent decided of the pairs that dominance leaves open / percent wrong among "
    "these [95% interval, "
    f"data sets resampled {RESAMPLES} times]. In brackets: fewer than {ENOUGH_DECIDED} decided "
    f"pairs or {ENOUGH_SETS} "
    f"data sets, not judged. Bold: the interval lies wholly above {PROMISE:.0%}. Where nothing is "
    "wrong in any data "
    "set the interval has no width.",
    "",
    "Shares are pooled over data sets: a posterior rule promises that much on average over scales "
    "from its prior. The "
    "rows of one k share their data sets. The Bradley-Terry rules are told the tutor's own "
    "precision (10 with "
    "flips), the posterior ones learn it. The first learns the lapse too; the one beside it is "
    "told the right one, "
    "twice the share of flips, and 0 for tutors of eq. (6). With learners the budget is the number "
    "of answers at "
    "most, and the fits are renewed at every fourth more answers only (`refit_growth=0.25`).",
]
