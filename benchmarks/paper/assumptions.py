"""Choices that the paper does not state, one at a time: their effect on questions and losses.

    python -m benchmarks.paper.assumptions --out docs/assumptions.md    an hour on a core
    python -m benchmarks.paper.assumptions --quick                      seconds; rough figures

``--journal FILE`` keeps finished runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.paper.paired_runs import (
    DEFAULT,
    Choice,
    Size,
    answer,
    cells_of,
    measure_all,
    parser_of,
    save_quoted,
)
from elicit.model.scale import Floats

COLUMNS = {  # measures: what heads them, and how many digits they are given with
    "asked_of_all": ("% of all", 1),
    "asked_of_open": ("% of open", 1),
    "formula": ("formula", 2),
    "excess_loss": ("excess loss", 2),
    "oracle_loss": ("oracle's loss", 2),
    "errors_realised": ("errors realised", 1),
}
MATTERS = 0.1  # of the default's % of all: what is certainly less than that counts as no change
HEAD = """\
# What the paper leaves open, and what it does

This page is for readers of the paper. It shows how much each choice that the paper does not state changes the number of questions and the
loss. The paper's comparator (Bradley-Terry, box) runs in interactive Q-learning on random MDPs with {states} states, 5 actions and
{levels} levels, {steps:,} steps. The first line is the default of `qlearn figures`. Every other line
changes one choice and gives the **difference** from the default, paired by seed, with its 95% t-interval. Each line has
{seeds} seeds{more}.
Written by `python -m benchmarks.paper.assumptions --steps {steps} --seeds {seeds} --most {most}`.

- **% of all**, **% of open**: questions in percent of all comparisons of two different actions, and in percent of those that
  dominance leaves open (if it is looked for).
- **asks**: the conclusion from the interval of % of all. "More" or "less": the interval excludes 0. "As much": the interval contains 0,
  and all of it is within a tenth of the default's percentage. Otherwise "inconclusive".
- **formula**: figure 4's percentage, signed as printed, against an oracle that always asks a truthful tutor with the same settings.
- **excess loss**: true policy loss less that oracle's. **oracle's loss**: its own. Both are in percent of the value range.
- **errors realised**: wrong answers in percent of the answers given. It is empty if the tutor never errs, or if nothing was asked in
  some run.
"""  # noqa: E501
MORE = """\
. If these do not tell whether more is asked, the line has {most}, all of which count. This second look makes
such intervals miss a little more often than one in twenty"""  # noqa: E501
ETA = """\
## Eta, the least difference of two neighbouring levels

These lines have the comparator of section 3.1 (the polytope K_t) with a tutor who never errs, and {seeds} seeds. The first line is the
default, and the others give the difference from it. Hidden values are distinct integers of 0 to 99, so that no gap
is below 1/99 = .0101 of the range. A greater eta may exclude the truth. An answer that then fits no scale of K_t decides only its own
pair. The Bradley-Terry comparator has no eta: its fits allow levels of equal value.
"""  # noqa: E501


def choices(base: Choice = DEFAULT) -> dict[str, Choice]:
    """The default, and every other choice by name."""

    def boxed(**settings: Any) -> Choice:
        return replace(base, settings={**base.settings, **settings})

    return {
        "default": base,
        "learning rate .1": replace(base, learning_rate=0.1),
        "learning rate 1 / (1 + visits)^.7": replace(base, learning_rate="polynomial"),
        "epsilon .1": replace(base, epsilon=0.1),
        "epsilon .5": replace(base, epsilon=0.5),
        "start at zero (line 4)": replace(base, start="zero"),
        "start at zero, e_1 free": replace(base, first_level="free"),
        "start at the best level": replace(base, start="best"),
        "tutor never errs": replace(base, error_rate=0.0),
        "tutor errs in 2%": replace(base, error_rate=0.02),
        "tutor errs in 30%": replace(base, error_rate=0.3),
        "m = 20": boxed(n_boot=20),
        "m = 100": boxed(n_boot=100),
        "level .8": boxed(level=0.8),
        "level .99": boxed(level=0.99),
        "footnote 3 (rescale)": boxed(rescale=True),
        "literal fit (not monotone)": boxed(monotone=False),
        "weaker prior (.03)": boxed(prior_strength=0.03),
        "fits at 5% more answers": boxed(refit_growth=0.05),
        "nothing decided below 1 answer": boxed(min_answers=1),
        "nothing decided below 50 answers": boxed(min_answers=50),
        "dominance off": boxed(dominance=False),
        "transition weights gaussian": replace(base, weights="gaussian"),
    }


def etas() -> dict[str, Choice]:
    """Return the choices of eta for the polytope, the default first, by name.

    The tutor never errs.
    """

    def with_eta(margin: float) -> Choice:
        return Choice("polytope", {"margin": margin}, error_rate=0.0)

    return {"eta 1e-6": with_eta(1e-6)} | {
        f"eta {eta:g}": with_eta(eta) for eta in (0.0, 0.001, 0.01, 0.02, 0.05)
    }


def table(found: Mapping[str, Mapping[str, Floats]]) -> list[str]:
    """The lines of a table of choices, by name, the first of which the others are held to."""
    names = [heading for heading, _ in COLUMNS.values()]
    head = ["choice", "seeds", names[0], "asks", *names[1:]]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    (first, base), *others = found.items()
    for name, columns in [(first, None), *others]:
        measured = base if columns is None else columns
        cells = cells_of(measured, None if columns is None else base, COLUMNS)
        told = "" if columns is None else _asks(columns, base)
        lines.append(
            f"| {' | '.join([name, str(len(measured['formula'])), cells[0], told, *cells[1:]])} |"
        )
    return lines


def _asks(found: Mapping[str, Floats], base: Mapping[str, Floats]) -> str:
    before = base["asked_of_all"]
    return answer(
        found["asked_of_all"] - before[: len(found["asked_of_all"])], MATTERS * float(before.mean())
    )


def box_table(
    size: Size, seeds: int, most: int, measured: Callable[..., list[dict[str, Floats]]]
) -> list[str]:
    """The table of the box: ``seeds`` of each choice, and ``most`` of those that these do not
    tell.
    """
    wanted = choices()
    found = dict(
        zip(
            wanted, measured(list(wanted.values()), [range(seeds)] * len(wanted), size), strict=True
        )
    )
    untold = [
        name
        for name in wanted
        if name != "default" and _asks(found[name], found["default"]) == "inconclusive"
    ]
    if untold and most > seeds:
        again = ["default", *untold]
        more = measured([wanted[name] for name in again], [range(most)] * len(again), size)
        found |= dict(zip(again, more, strict=True))
    return table(found)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = parser_of("benchmarks.paper.assumptions", __doc__ or "")
    parser.add_argument(
        "--steps", type=int, default=100_000, help="steps of Q-learning (default: the paper's 1e5)"
    )
    parser.add_argument("--seeds", type=int, default=4, help="number of seeds (default: 4)")
    parser.add_argument(
        "--most", type=int, default=20, help="of choices that these do not tell (default: 20)"
    )
    chosen = parser.parse_args(arguments)
    size = (12, 4, 300) if chosen.quick else (100, 10, chosen.steps)
    seeds, most = (2, 3) if chosen.quick else (chosen.seeds, chosen.most)

    def measured(
        wanted: Sequence[Choice], of: Sequence[range], size: Size
    ) -> list[dict[str, Floats]]:
        return measure_all(wanted, of, size, chosen.journal, chosen.jobs)

    states, levels, steps = size
    more = MORE.format(most=most) if most > seeds else ""
    head = HEAD.format(states=states, levels=levels, steps=steps, seeds=seeds, most=most, more=more)
    wanted = etas()
    polytope = dict(
        zip(wanted, measured(list(wanted.values()), [range(most)] * len(wanted), size), strict=True)
    )
    lines = [
        head,
        *box_table(size, seeds, most, measured),
        "",
        ETA.format(seeds=most),
        *table(polytope),
        "",
    ]
    print("\n".join(lines))
    save_quoted(lines, chosen.out, most)


if __name__ == "__main__":
    main()
