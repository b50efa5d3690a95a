"""139 real people as a panel: how many schools there are, and what one policy loses each.

    python -m benchmarks.people.crowd results/people --out notebooks/data/crowd.csv     two minutes

Needs the folder with the tables that are not shipped; docs/people.md says what they hold. The table
that is written has numbers that were derived from the answers, one row a person: no answers.

The decision problem is the simplest that these people really had: the 70 pairs of lotteries. A
policy takes one lottery of each pair. Its loss to a person is what the lotteries that it leaves are
worth more by that person's scale, in the mean over the pairs. The levels are amounts of money, as
many as predicted the choosing half of the people best (RESULTS-people.md).
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import linprog

from benchmarks.people.choices import Bools
from benchmarks.stamps import sign
from elicit import AnswerLog, Answers, Panel, PosteriorComparator, agreement
from elicit._support.fixed_order import product
from elicit.model.comparator_parts import best_guess, draws_in
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats
from elicit.people import lottery_choices

LEVELS = 8
SEED = 0
LEVEL = 0.95  # of the bounds on a loss


def panel_of(answers: Mapping[str, Answers]) -> Panel:
    """Return a panel with a posterior of each person's answers."""
    return Panel(
        {
            name: PosteriorComparator(own.k, level=LEVEL, seed=SEED).update(own)
            for name, own in answers.items()
        }
    )


class Schools(NamedTuple):
    """Groups of people, and the share of the questions from which on they are kept apart."""

    groups: tuple[tuple[str, ...], ...]
    apart: float

    def of(self, name: str) -> int:
        """Return the number of a person's school, from 0 on."""
        return next(i for i, group in enumerate(self.groups) if name in group)


def schools_in(panel: Panel) -> Schools:
    """Return the groups at the widest distance at which there are two or more, in steps of 1%.

    The first step is the default of ``elicit.agreement``. If there is one group at 1% too, it is
    that one.
    """
    for percent in range(10, 0, -1):
        groups = agreement(panel, apart=percent / 100).groups
        if len(groups) > 1:
            return Schools(groups, percent / 100)
    return Schools((panel.people,), 0.01)


def takes_left(d: Floats, values: Floats) -> Floats:
    """Return the best policy for a scale: the chance (m,) with which it takes the left of a pair.

    d (m, k) are the differences of left and right. Of two that are equal it takes the right one.
    """
    return (worth(d, np.diff(values)[:, None])[:, 0] > 0).astype(float)


def worth(d: Floats, gaps: Floats) -> Floats:
    """Return d.e (m, n) of differences (m, k) by scales with these gaps (k - 1, n)."""
    return np.round(product(tail_sums(d), gaps), 12)


def losses(policy: Floats, left_more: Floats) -> Floats:
    """Return the mean loss (n,) of a policy (m,) over pairs of which left is worth more by (m, n).

    It is a share of the value range.
    """
    takes = policy[:, None]
    lost = np.maximum(left_more, 0.0) * (1 - takes) + np.maximum(-left_more, 0.0) * takes
    return np.asarray(lost.mean(axis=0))


def loss_of(policy: Floats, d: Floats, member: PosteriorComparator) -> tuple[float, float]:
    """Return what a policy loses a person by their best guess, and at most with 95%."""
    guess = losses(policy, worth(d, np.diff(best_guess(member))[:, None]))[0]
    draws = draws_in(member)
    assert draws is not None
    lost = losses(policy, worth(d, draws[0]))
    order = np.argsort(lost, kind="stable")
    at = int(np.searchsorted(np.cumsum(draws[1][order]), LEVEL))
    return float(guess), float(lost[order[min(at, len(order) - 1)]])


def for_the_worst_off(d: Floats, scales: Floats) -> Floats:
    """Return the policy (m,) whose greatest loss by any of the scales (n, k) is the least."""
    more = worth(d, np.diff(scales, axis=1).T).T  # (n, m)
    n, m = more.shape
    # the loss is the mean of max(w, 0) - w x over pairs, where x is the chance of left
    found = linprog(
        np.r_[np.zeros(m), 1.0],
        A_ub=np.c_[-more / m, -np.ones(n)],
        b_ub=-np.maximum(more, 0.0).mean(axis=1),
        bounds=[(0.0, 1.0)] * m + [(None, None)],
        method="highs",
    )
    if found.status != 0:
        raise ArithmeticError(f"the linear program was not solved: {found.message}")
    return np.clip(found.x[:m], 0.0, 1.0)


def halved(answers: Answers, seed: int) -> tuple[Answers, Answers]:
    """Return a random half of a person's answers, and the other half."""
    order = np.random.default_rng([SEED, seed]).permutation(len(answers))
    half = len(answers) // 2
    return answers.take(sorted(order[:half].tolist())), answers.take(sorted(order[half:].tolist()))


def chosen_alike(values: Floats, answers: Answers) -> float:
    """Return the share of the answers that are as the best policy for a scale has it."""
    left: Bools = takes_left(answers.d, values) > 0
    return float((left == (answers.y > 0)).mean())


def table(logs: Mapping[str, AnswerLog]) -> pd.DataFrame:
    """Return a row for each person; ``notebooks/11_several_experts.ipynb`` says what it means.

    Parameters
    ----------
    logs : mapping of str to AnswerLog
        By person. All were put the same questions.

    Returns
    -------
    DataFrame
        ``group`` by the default of ``elicit.agreement``, ``school`` by ``schools_in``. The value of
        each level by the best guess. For each policy the loss to the person and its 95% bound.
        ``alike`` is the share of the person's other choices that a policy from half of everybody's
        answers makes as the person did.
    """
    answers = {name: log.answers() for name, log in logs.items()}
    first = next(iter(logs.values()))
    questions = {
        entry.answer.query.id: entry.answer.query.d for log in logs.values() for entry in log
    }
    d = np.stack([questions[name] for name in sorted(questions)])
    labels = first.header["labels"]
    panel = panel_of(answers)
    groups, schools = agreement(panel).groups, schools_in(panel)
    scales = np.stack([best_guess(member) for member in panel.members.values()])
    policies = {"the mean": takes_left(d, panel.values)}
    for i, group in enumerate(schools.groups, 1):
        policies[f"school {i}"] = takes_left(d, mean_of(panel, group))
    policies["the worst off"] = for_the_worst_off(d, scales)
    halves = {name: halved(own, i) for i, (name, own) in enumerate(answers.items())}
    told = panel_of({name: known for name, (known, _) in halves.items()})
    told_schools = schools_in(told)
    means = [mean_of(told, group) for group in told_schools.groups]
    rows = list[dict[str, Any]]()
    for number, (name, member) in enumerate(panel.members.items()):
        row: dict[str, Any] = {
            "person": number + 1,
            "group": Schools(groups, 0.1).of(name) + 1,
            "school": schools.of(name) + 1,
            "apart": schools.apart,
        }
        row |= {f"value of {label}": x for label, x in zip(labels, scales[number], strict=True)}
        assert isinstance(member, PosteriorComparator)
        for whose, policy in policies.items():
            guess, most = loss_of(policy, d, member)
            row |= {f"loss by {whose}": guess, f"at most by {whose}": most}
        rest = halves[name][1]
        own = told_schools.of(name)
        row |= {
            "alike by the mean": chosen_alike(told.values, rest),
            "alike by the school": chosen_alike(means[own], rest),
            "alike by their own": chosen_alike(best_guess(told.members[name]), rest),
            "schools in half": len(told_schools.groups),
        }
        rows.append(row)
    return pd.DataFrame(rows).round(4)


def mean_of(panel: Panel, group: Sequence[str]) -> Floats:
    """Return the mean scale (k,) of some of the members."""
    return Panel({name: panel.members[name] for name in group}).values


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table's means; ``--out`` also writes the table."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.people.crowd", description=(__doc__ or "").splitlines()[0]
    )
    parser.add_argument("folder", type=Path, help="of the tables that are not shipped")
    parser.add_argument("--people", type=int, help="the first so many: rough figures")
    parser.add_argument("--out", type=Path, help="the table to write")
    given = parser.parse_args(arguments)
    logs = lottery_choices(given.folder, LEVELS)
    found = table(dict(sorted(logs.items(), key=lambda item: int(item[0]))[: given.people]))
    print(found.drop(columns="person").groupby(["group", "school"]).agg("mean").T.to_string())
    if given.out is not None:
        given.out.parent.mkdir(parents=True, exist_ok=True)
        found.to_csv(given.out, index=False)
        sign(given.out, str(SEED))


if __name__ == "__main__":
    main()
