"""Predict people's held-out answers with whichever version of ``elicit`` is found first.

``people_before`` runs this file in a process of its own, as ``python in_older_code.py IN OUT``, so
that older code can be imported. Only names that older code also has may be used here. Both files
are NumPy archives.

IN holds the differences ``d`` (m, k), the answers ``said`` (n, m) of n people, as in
``benchmarks.people.choices``, the fold (n, m) of each answer, ``whole`` (people by number, whose
folds are those), and ``first`` (people by number, whose folds ``held_out`` deals). OUT has the
``chance`` and the ``verdict`` (n, m) of ``whole``, and the ``scores`` of ``first``: see
``scores_of``.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import elicit

FOLDS = 5


def answers_of(d: Any, said: Any) -> elicit.Answers:
    """Return a person's answers; ``said`` is 1 for left, and nan where there is none."""
    there = ~np.isnan(said)
    return elicit.Answers(d[there], np.where(said[there] == 1, 1, -1))


def chance_of(known: Any, d: Any) -> Any:
    """Return P("left is better") of the next answers, as ``held_out`` computed it in older code."""
    draws, tails = known.draws, np.cumsum(d[:, ::-1], axis=1)[:, ::-1][:, 1:]
    right = 1.0 / (1.0 + np.exp(-np.clip(tails @ draws.gaps * draws.precision, -700.0, 700.0)))
    return (known.lapse / 2 + (1 - known.lapse) * right) @ draws.weights


def scores_of(comparator: Any, answers: elicit.Answers) -> list[float]:
    """Return the mean log-likelihood of the scored answers, their number, how many the comparator
    decides, and how many of these are answered otherwise."""
    found = elicit.held_out(comparator, answers, FOLDS)
    decided = round(found.decided.value * found.scored)
    otherwise = round(found.wrong.value * decided) if decided else 0
    return [found.log_likelihood.value, float(found.scored), float(decided), float(otherwise)]


def main(source: str, out: str) -> None:
    """Read one archive, and write the other one."""
    given = np.load(source)
    d, said, fold = given["d"], given["said"], given["fold"]
    chance, verdict = np.full(said.shape, np.nan), np.full(said.shape, np.nan)
    for i in given["whole"]:
        for number in range(FOLDS):
            test = fold[i] == number
            known = elicit.PosteriorComparator(d.shape[1]).update(
                answers_of(d, np.where(test, np.nan, said[i]))
            )
            chance[i, test], verdict[i, test] = chance_of(known, d[test]), known.compare(d[test])
    scores = [
        scores_of(elicit.PosteriorComparator(d.shape[1]), answers_of(d, said[i]))
        for i in given["first"]
    ]
    place = np.array(elicit.__file__)
    np.savez(out, chance=chance, verdict=verdict, scores=np.array(scores), place=place)


if __name__ == "__main__":
    main(*sys.argv[1:])
