"""The paper's algorithm read literally, beside our default, and each thing that the reading leaves
out put back.

    python -m benchmarks.paper.literal --out docs/literal.md    an hour on one core
    python -m benchmarks.paper.literal --quick                  seconds; rough figures

``--journal FILE`` keeps finished runs.

What the paper's algorithms give, and nothing more (``LITERAL``): the two vectors are put to the fit
whether or not one dominates the other, for Algorithm 2 has no line that looks; eq. (7) is maximised
in e_1, ..., e_k, all free, without a prior and without their order; a fit, and m bootstrap fits, at
every answer; asked is what the intervals of section 3.2 leave open, from the first answer on
(Algorithm 2); all vectors start at zero (line 4 of Algorithm 1).

Steps that the text leaves undefined, and what was done: see ``HEAD``, which the page begins with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.paper.paired_runs import (
    DEFAULT,
    Choice,
    Size,
    cells_of,
    measure_all,
    parser_of,
    save_quoted,
)
from elicit.model.scale import Floats

COLUMNS = {  # measures: what heads them, and how many digits they are given with
    "asked_of_all": ("% of all", 1),
    "excess_loss": ("excess loss", 2),
    "formula": ("formula", 2),
    "errors_realised": ("errors realised", 1),
    "cpu_seconds": ("CPU seconds", 1),
}
LITERAL = Choice(
    first_level="free",  # and with it the start at zero
    settings={
        "dominance": False,
        "prior_strength": 0,
        "monotone": False,
        "refit_growth": 0,
        "min_answers": 1,
    },
)
HEAD = """\
# The paper read literally

This page is for readers of the paper. It runs interactive Q-learning exactly as the paper's algorithms have it, beside the default of
`qlearn figures`. Then it puts back, one at a time, each thing that the algorithms do not have. The problems are random MDPs with 5
actions. The tutor errs by eq. (6), with a precision at which 10% of an optimal policy's open comparisons would be answered wrongly. The
fit has m = 50 resamples and the level .95; exploration is uniform. There are {seeds} seeds, each with the same MDP, hidden values,
transitions and actions in all lines. Written by
`python -m benchmarks.paper.literal --seeds {seeds} --steps {steps} --longer {longer}`.

**Literally** means:

- No comparison is decided by dominance.
- (7) is maximised in e_1, ..., e_k, all of them free, with no prior and no order of the levels.
- The fit and its m bootstrap fits are made again at every answer.
- From the first answer on, the tutor is asked if the interval of section 3.2 contains 1/2, and not otherwise.
- All vectors start at zero (line 4), and the tutor compares the values as they were drawn, from 0 to 99.

**Where the text leaves a step undefined, this was done:**

- *Dominance.* Section 2.2 says that dominated vectors are eliminated, but Algorithms 1 and 2 have no line that does so. The
  literal reading is that of the algorithms. The line *dominance first* is that of section 2.2.
- *A fit without a maximum.* If some scale explains all answers without error, (7) has no maximum. If no answer has touched a level, any
  value of this level is as good as any other, so (7) has no single maximum, and this counts as none.
  The first is always so at the start, and for ever with a tutor who never errs. Such a fit is no estimate. A bootstrap fit without a
  maximum may lie anywhere, and counts as one beyond either end of every interval. If there are more such fits than the intervals leave
  out (1 of 50), or if the answers themselves have no maximum, the tutor is asked.
  The line *taken where it stops* does the opposite. Newton's method starts at equal gaps, and stops where a step promises
  less than 1e-12 or after 100 steps; the point where it stops is the estimate.
- *e_k at or below zero.* All values are measured in units of e_k. If the fit puts it at or below zero, the tutor is asked.
- *The same vectors again.* An action is not compared with itself, equal vectors keep the best action so far, and a pair
  that was asked is not asked again.
- *The start.* If all vectors start on the worst level, their totals are equal, and e_1 does not matter (it is set to 0). So the line
  *the worst level as the start* puts back both. The line *e_1 = 0* puts back e_1 alone, with the start at zero: hidden values are
  measured from the worst.
- *Not said:* learning rate, epsilon, the law of the transitions. They are as in [assumptions](assumptions.md).

The first line of each table is the default. The second is the literal reading, as the **difference** from the default.
Every other line is the **difference** from the literal reading. Differences are paired by seed, ± half the width of a 95%
t-interval.

- **% of all**: questions in percent of all comparisons of two different actions.
- **excess loss**: true policy loss, less that of always asking a truthful tutor from the same start, in percent of
  the value range. **formula**: figure 4's percentage, signed as printed, against the same oracle.
- **errors realised**: wrong answers in percent of the answers given. **CPU seconds**: of the run, in one thread.
"""  # noqa: E501
PLACES = ((50, 5), (50, 10), (100, 5), (100, 10))  # states and levels
LONGER_PLACES = PLACES[3:]
AT_EVERY_ANSWER = ("default", "literal, less the default", "fits at 20% more answers")
EXACT = """\
## A fit at every answer

The time of a run grows with the square of the number of answers. So there are few steps, and
nothing else is put back.
"""
LONGER = """\
## Fits at every 20% more answers

All lines make a new fit only at every 20% more answers, as the default does. So the literal
reading can be run for longer.
"""


def put_back(literal: Choice = LITERAL) -> dict[str, Choice]:
    """The literal reading with one thing put back, by name, and with one thing read otherwise."""

    def boxed(**settings: Any) -> Choice:
        return replace(literal, settings={**literal.settings, **settings})

    return {
        "dominance first": boxed(dominance=True),
        "the prior": boxed(prior_strength=0.3),
        "the order of the levels": boxed(monotone=True),
        "fits at 20% more answers": boxed(refit_growth=0.2),
        "nothing decided below 5 answers": boxed(min_answers=5),
        "the worst level as the start": replace(literal, first_level="zero"),
        "e_1 = 0": replace(literal, first_level="zero", start="zero"),
        "footnote 3 (rescale)": boxed(rescale=True),
        "no maximum: taken where it stops": boxed(no_maximum="take"),
    }


def arms(literal: Choice = LITERAL) -> dict[str, Choice]:
    """All lines of a table: the default, the literal reading, and ``put_back``, without what
    changes nothing.
    """
    others = {name: choice for name, choice in put_back(literal).items() if choice != literal}
    return {"default": DEFAULT, "literal, less the default": literal} | others


def table(found: Mapping[str, Mapping[str, Floats]], size: Size, fits: str) -> list[str]:
    """The lines of a table of ``arms`` at this size; ``fits`` says when the literal reading makes
    its own.
    """
    states, levels, steps = size
    head = [
        "states",
        "levels",
        "fits",
        "reading",
        "steps",
        *(heading for heading, _ in COLUMNS.values()),
    ]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    (_, default), (_, literal), *_ = found.items()
    for i, (name, measured) in enumerate(found.items()):
        cells = cells_of(measured, (None, default, literal)[min(i, 2)], COLUMNS)
        lines.append(
            f"| {' | '.join([str(states), str(levels), fits, name, f'{steps:,}', *cells])} |"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = parser_of("benchmarks.paper.literal", __doc__ or "")
    parser.add_argument("--seeds", type=int, default=10, help="number of seeds (default: 10)")
    parser.add_argument(
        "--steps", type=int, default=1000, help="with a fit at every answer (default: 1000)"
    )
    parser.add_argument(
        "--longer", type=int, default=10_000, help="steps with fits at 20%% more (default: 10,000)"
    )
    parser.add_argument(
        "--all", action="store_true", help="put back each thing also where fits are at every answer"
    )
    chosen = parser.parse_args(arguments)
    chosen.all |= chosen.quick
    seeds, steps, longer = (
        (2, 100, 200) if chosen.quick else (chosen.seeds, chosen.steps, chosen.longer)
    )
    places, longer_places = (((8, 3),), ((8, 3),)) if chosen.quick else (PLACES, LONGER_PLACES)
    scheduled = replace(LITERAL, settings={**LITERAL.settings, "refit_growth": 0.2})
    lines = HEAD.format(seeds=seeds, steps=steps, longer=longer).splitlines()
    print("\n".join(lines))
    for title, literal, its, n in (
        (EXACT, LITERAL, places, steps),
        (LONGER, scheduled, longer_places, longer),
    ):
        part = ["", *title.splitlines()]
        for place in its:
            size = (*place, n)
            wanted = arms(literal)
            if literal == LITERAL and not chosen.all:
                wanted = {name: wanted[name] for name in AT_EVERY_ANSWER}
            runs = measure_all(
                list(wanted.values()),
                [range(seeds)] * len(wanted),
                size,
                chosen.journal,
                chosen.jobs,
            )
            fits = "each answer" if literal == LITERAL else "20% more"
            part += ["", *table(dict(zip(wanted, runs, strict=True)), size, fits)]
            print("\n".join(part), flush=True)
            lines, part = lines + part, []
    save_quoted([*lines, ""], chosen.out, seeds)


if __name__ == "__main__":
    main()
