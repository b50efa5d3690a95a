"""Predictions of held-out answers: to compare comparators on a log, without a learner."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtri

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit._support.validation import require
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.diagnostics.tutor_report import NOTHING, Estimate, Told, check_level, read_log
from elicit.model.comparator import Comparator, Foretells, learn, offers
from elicit.model.pairs import pair_numbers
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats, dot, tail_sums

Folds = int | Literal["sequential"]
_RESAMPLES = 1000


@dataclass(frozen=True)
class HeldOut:
    """Scores of a comparator's predictions of answers that it has not learned from; see ``held_out``.

    scored: held-out answers that prefer a side; the ``ties`` are not scored. decided: share of these on which the
    comparator is certain. accuracy, wrong: shares of the decided answers that agree, and that say the opposite (the
    rest it calls EQUAL). by_values: share whose sign at ``.values`` agrees, a value of 0 counting as half.
    log_likelihood: mean log-probability of the answers; nan without ``.probability``. Intervals of ``level``: Wilson's
    (1927) for shares, percentiles of a bootstrap over the answers for the log-likelihood; both take the answers as
    independent, and leave out that another training set would have given another comparator.
    contradicted: folds whose training answers the comparator found contradictory; dropped: how many of these it then
    went without, over all folds.
    """

    scored: int
    ties: int
    folds: Folds
    level: float
    decided: Estimate
    accuracy: Estimate
    wrong: Estimate
    by_values: Estimate
    log_likelihood: Estimate
    contradicted: int
    dropped: int

    def __str__(self) -> str:
        return str(HeldOutTable({"": self}))


class HeldOutTable(dict[str, HeldOut]):
    """``HeldOut`` by name; ``str()`` is an aligned table."""

    def __str__(self) -> str:
        table = [["", "decided", "right of decided", "wrong of decided", "right by values", "log-likelihood"]]
        for name, score in self.items():
            shares = (score.decided, score.accuracy, score.wrong, score.by_values)
            cells = ["-" if math.isnan(share.value) else share.percent for share in shares]
            likelihood = "{:.3f} ({:.3f} to {:.3f})".format(*score.log_likelihood)
            table.append([name, *cells, "-" if math.isnan(score.log_likelihood.value) else likelihood])
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]
        for name, score in self.items():
            how = "answer by answer" if score.folds == "sequential" else f"in {score.folds} folds"
            lines.append(
                f"{name}{': ' * bool(name)}{score.scored} answers held out {how}, {score.ties} ties not scored"
                + f"; contradictory answers in {score.contradicted}, {score.dropped} dropped" * bool(score.dropped)
            )
        return "\n".join(lines)


def held_out(
    comparator: Comparator, answers: Told, folds: Folds = 10, *, level: float = 0.95, seed: Seed | None = 0
) -> HeldOut:
    """Scores of a comparator on answers of a log that it has not learned from. No learner, no hidden scale.

    comparator: fresh, as in ``PosteriorComparator(k)``; what it knows already it knows in every fold. answers: as for
    ``tutor_report``, those marked unused included. folds: the pairs are dealt into so many folds by ``seed``, all
    answers to one pair into the same, and each fold is foretold from the others, in told order. "sequential": each
    answer is foretold from those before it, repeated pairs included.

    Answers are not the truth: of a tutor who errs in a tenth of all answers no comparator agrees with more than nine
    tenths, but by luck. A log that a learner asked for holds questions its comparator could not decide, harder than
    fresh pairs. Contradictory training answers are taken as ``learn`` does, one by one, and those dropped are counted.

    The probability of an answer is, for a ``PosteriorComparator``, that of its model, lapse included; else what a
    comparator that ``Foretells`` says. Raises ValueError on other numbers of folds than 2 up to that of the pairs, on a
    level outside (0, 1), and on answers about other levels.
    """
    check_level(level)
    return _score(comparator, read_log(answers, comparator.k).answers, folds, level, key_of(seed_of(seed)))


def _score(comparator: Comparator, rows: Answers, folds: Folds, level: float, key: int) -> HeldOut:
    y, n = rows.y, len(rows)
    told = np.empty((3, n))
    lost = []  # how many training answers each fold dropped
    if folds == "sequential":
        taken = np.ones(n, dtype=np.bool_)
        for i in range(n):
            told[:, [i]] = _foretell(comparator, rows.d[i : i + 1])
            comparator, taken[i : i + 1] = learn(comparator, rows[i : i + 1], one_by_one=True)
        lost.append(int((~taken).sum()))
    else:
        fold_of = _deal(pair_numbers(rows.d), folds, key)
        for number in range(folds):
            test = fold_of == number
            train = np.flatnonzero(~test)
            known = Answers(rows.d[train], y[train], [rows.ids[i] for i in train])
            learned, taken = learn(comparator, known, one_by_one=True)
            lost.append(int((~taken).sum()))
            told[:, test] = _foretell(learned, rows.d[test])
    clear = y != 0
    said, (verdicts, scores, chance) = y[clear], told[:, clear]
    decided = verdicts != Verdict.UNKNOWN
    right, wrong = int((verdicts == said).sum()), int((verdicts == -said).sum())
    agree = np.sign(scores) * said
    with np.errstate(divide="ignore"):
        logs = np.log(np.where(said > 0, chance, 1.0 - chance))
    m, sure = len(said), int(decided.sum())
    return HeldOut(
        scored=m,
        ties=n - m,
        folds=folds,
        level=level,
        decided=wilson(sure, m, level),
        accuracy=wilson(right, sure, level),
        wrong=wilson(wrong, sure, level),
        by_values=wilson(float((1.0 + agree).sum() / 2.0), m, level),
        log_likelihood=_bootstrap_mean(logs, level, key),
        contradicted=int(np.count_nonzero(lost)),
        dropped=sum(lost),
    )


def compare_held_out(
    comparators: Mapping[str, Comparator],
    answers: Told,
    folds: Folds = 10,
    *,
    level: float = 0.95,
    seed: Seed | None = 0,
) -> HeldOutTable:
    """``held_out`` of each comparator, by name, over the same folds; ``print`` shows an aligned table."""
    check_level(level)
    if not comparators:
        return HeldOutTable()
    key, rows = key_of(seed_of(seed)), read_log(answers, next(iter(comparators.values())).k).answers
    return HeldOutTable({name: _score(each, rows, folds, level, key) for name, each in comparators.items()})


def wilson(count: float, n: int, level: float = 0.95) -> Estimate:
    """count / n with Wilson's score interval; nan for n = 0."""
    if n == 0:
        return NOTHING
    z2 = float(ndtri((1.0 + level) / 2.0)) ** 2
    share = count / n
    middle = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = math.sqrt(z2 * (share * (1 - share) / n + z2 / (4 * n * n))) / (1 + z2 / n)
    return Estimate(share, max(0.0, middle - half), min(1.0, middle + half))


@one_thread
def _foretell(comparator: Comparator, d: Floats) -> Floats:
    """Return a comparator's predictions on d (n, k), as rows (3, n).

    They are the verdicts, d.e at ``.values``, and the probability of the answer "left is better", nan without one."""
    t, chance = tail_sums(d), np.full(len(d), math.nan)
    if isinstance(comparator, PosteriorComparator):
        draws = comparator.draws
        each = comparator.lapse / 2 + (1 - comparator.lapse) * expit(t @ draws.gaps * draws.precision)
        chance = each @ draws.weights
    elif offers(comparator, "probability"):
        found = cast(Foretells, comparator).probability(d)
        chance = found[-1] if isinstance(found, tuple) else found
    return np.array([comparator.compare(d), dot(t, np.diff(comparator.values)), chance])


def _deal(pairs: NDArray[np.intp], folds: int, key: int) -> NDArray[np.intp]:
    """The fold (n,) of each row: pairs, not rows, are dealt."""
    n = int(pairs.max(initial=-1)) + 1
    wanted = f'"sequential" or a number from 2 to that of different pairs, {n}'
    require(isinstance(folds, (int, np.integer)) and 2 <= folds <= n, "folds", wanted, folds)
    order = _rng(key, "folds").permutation(n)
    return np.asarray((np.argsort(order) % folds)[pairs])


def _bootstrap_mean(x: Floats, level: float, key: int) -> Estimate:
    """The mean of x (n,) with a percentile interval; nan where one of them is or where there are none."""
    if not len(x) or np.isnan(x).any():
        return NOTHING
    rng = _rng(key, "bootstrap of scores")
    means = [float(x[rng.integers(0, len(x), len(x))].mean()) for _ in range(_RESAMPLES)]
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2], method="inverted_cdf")
    return Estimate(float(x.mean()), float(low), float(high))


def _rng(key: int, purpose: str) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(int(fold(key, name_code(purpose)))))
