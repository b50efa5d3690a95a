"""Comparison of comparators on a log: how well each predicts answers that it has not learned."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from elicit._support.hashing import Seed, fold, key_of, name_code
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit._support.validation import require
from elicit.asking.options import EarlierAnswers
from elicit.comparators.bradley_terry.open_order_posterior import OpenOrderPosterior
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.diagnostics.tutor_report import NOTHING, Estimate, check_level, read_log
from elicit.model.comparator import Comparator, learn, offers
from elicit.model.comparator_parts import PredictsAnswers
from elicit.model.difference import tail_sums
from elicit.model.pairs import pair_numbers
from elicit.model.query import Answers, Verdict
from elicit.model.scale import Floats, dot
from elicit.tutors.erring_tutor import says_left

Folds = int | Literal["sequential"]
_RESAMPLES = 1000


@dataclass(frozen=True)
class HeldOut:
    """Scores of a comparator's predictions of held-out answers, as ``held_out`` returns them.

    Intervals have the level given. They are Wilson's (1927) for shares, and percentiles of a
    bootstrap over the answers for the log-likelihood. Both take the answers as independent, and the
    training set as fixed.

    Attributes
    ----------
    scored
        Number of held-out answers that prefer a side.
    ties
        Number of held-out answers that prefer none. They are not scored.
    decided
        Share of the scored answers on which the comparator is certain.
    accuracy, wrong
        Shares of the decided answers that agree with the comparator, and that say the opposite. The
        comparator calls the rest EQUAL.
    by_values
        Share of the scored answers that agree with the sign of d.e at ``.values``. A d.e of 0
        counts as half.
    log_likelihood
        Mean log-probability of the answers; nan without ``.probability``.
    contradicted
        Number of folds whose training answers the comparator found contradictory.
    dropped
        Number of training answers that were then left out, over all folds.
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
    """A dict from names to ``HeldOut`` that prints as an aligned table."""

    def __str__(self) -> str:
        table = [
            [
                "",
                "decided",
                "right of decided",
                "wrong of decided",
                "right by values",
                "log-likelihood",
            ]
        ]
        for name, score in self.items():
            shares = (score.decided, score.accuracy, score.wrong, score.by_values)
            cells = ["-" if math.isnan(share.value) else share.percent for share in shares]
            likelihood = "{:.3f} ({:.3f} to {:.3f})".format(*score.log_likelihood)
            table.append(
                [name, *cells, "-" if math.isnan(score.log_likelihood.value) else likelihood]
            )
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]
        for name, score in self.items():
            how = "answer by answer" if score.folds == "sequential" else f"in {score.folds} folds"
            lines.append(
                f"{name}{': ' * bool(name)}{score.scored} answers held out {how}, {score.ties} "
                "ties not scored"
                + f"; contradictory answers in {score.contradicted}, {score.dropped} dropped"
                * bool(score.dropped)
            )
        return "\n".join(lines)


def held_out(
    comparator: Comparator,
    answers: EarlierAnswers,
    folds: Folds = 10,
    *,
    level: float = 0.95,
    seed: Seed | None = 0,
) -> HeldOut:
    """Return how well a comparator predicts answers of a log that it has not learned.

    No learner and no hidden scale are needed.

    Parameters
    ----------
    comparator : Comparator
        Usually without answers, as ``PosteriorComparator(k)``. Whatever it knows already, it knows
        in every fold.
    answers : AnswerLog, entries, Answers
        As for ``tutor_report``, including those marked unused.
    folds : int or "sequential"
        Number of folds. All answers to a pair go into the same fold, at random by ``seed``. Each
        fold is predicted from the others, in told order. ``"sequential"``: each answer is predicted
        from those before it, including repeated pairs.
    level : float
        Level of the intervals, in (0, 1).
    seed : int, SeedSequence, Generator or None

    Returns
    -------
    HeldOut

    Raises
    ------
    ValueError
        If the number of folds is not from 2 to the number of pairs, if the level is outside (0, 1),
        or if the answers are about other levels.

    Notes
    -----
    Answers are not the truth. If a tutor errs in a tenth of all answers, no comparator agrees with
    more than nine tenths, except by luck. A learner's log holds questions that its comparator could
    not decide, so they are harder than fresh pairs.

    Contradictory training answers are learned one by one, and those that contradict earlier ones
    are dropped and counted (see ``learn``).

    ``PosteriorComparator`` and ``OpenOrderPosterior`` predict an answer by their model, lapse
    included. Other comparators predict by their ``probability``, if they have it
    (``PredictsAnswers``).
    """
    check_level(level)
    return _score(
        comparator, read_log(answers, comparator.k).answers, folds, level, key_of(seed_of(seed))
    )


def _score(comparator: Comparator, rows: Answers, folds: Folds, level: float, key: int) -> HeldOut:
    y, n = rows.y, len(rows)
    told = np.empty((3, n))
    lost = []  # number of training answers that each fold dropped
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
            some = rows.take(train.tolist())
            known = Answers(some.d, y[train], some.ids, some.who)
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
    answers: EarlierAnswers,
    folds: Folds = 10,
    *,
    level: float = 0.95,
    seed: Seed | None = 0,
) -> HeldOutTable:
    """Return ``held_out`` of several comparators, by name, over the same folds.

    Parameters
    ----------
    comparators : mapping of str to Comparator
    answers, folds, level, seed
        As for ``held_out``.

    Returns
    -------
    HeldOutTable
        ``print`` shows an aligned table.

    Raises
    ------
    ValueError
        As ``held_out`` does.
    """
    check_level(level)
    if not comparators:
        return HeldOutTable()
    key, rows = key_of(seed_of(seed)), read_log(answers, next(iter(comparators.values())).k).answers
    return HeldOutTable(
        {name: _score(each, rows, folds, level, key) for name, each in comparators.items()}
    )


def wilson(count: float, n: int, level: float = 0.95) -> Estimate:
    """Return count / n with Wilson's score interval; nan for n = 0.

    Parameters
    ----------
    count, n : float, int
    level : float

    Returns
    -------
    Estimate
    """
    if n == 0:
        return NOTHING
    z2 = float(ndtri((1.0 + level) / 2.0)) ** 2
    share = count / n
    middle = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = math.sqrt(z2 * (share * (1 - share) / n + z2 / (4 * n * n))) / (1 + z2 / n)
    return Estimate(share, max(0.0, middle - half), min(1.0, middle + half))


@one_thread
def _foretell(comparator: Comparator, d: Floats) -> Floats:
    """Return a comparator's predictions of answers about d (n, k), as rows (3, n).

    The rows are the verdicts, d.e at ``.values``, and the probability of "left is better", nan if
    the comparator gives none.
    """
    t, chance = tail_sums(d), np.full(len(d), math.nan)
    if isinstance(comparator, PosteriorComparator):
        draws = comparator.draws
        chance = says_left(t @ draws.gaps, draws.precision, comparator.lapse) @ draws.weights
    elif isinstance(comparator, OpenOrderPosterior):
        chance = comparator.answer_probability(d)
    elif offers(comparator, "probability"):
        found = cast(PredictsAnswers, comparator).probability(d)
        chance = found[-1] if isinstance(found, tuple) else found
    return np.array([comparator.compare(d), dot(t, np.diff(comparator.values)), chance])


def _deal(pairs: NDArray[np.intp], folds: int, key: int) -> NDArray[np.intp]:
    """Return the fold (n,) of each answer; all answers to a pair are in the same fold."""
    n = int(pairs.max(initial=-1)) + 1
    wanted = f'"sequential" or a number from 2 to that of different pairs, {n}'
    require(isinstance(folds, (int, np.integer)) and 2 <= folds <= n, "folds", wanted, folds)
    order = _rng(key, "folds").permutation(n)
    return np.asarray((np.argsort(order) % folds)[pairs])


def _bootstrap_mean(x: Floats, level: float, key: int) -> Estimate:
    """Return the mean of x (n,) with a bootstrap interval; nan if x has nan or is empty."""
    if not len(x) or np.isnan(x).any():
        return NOTHING
    rng = _rng(key, "bootstrap of scores")
    means = [float(x[rng.integers(0, len(x), len(x))].mean()) for _ in range(_RESAMPLES)]
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2], method="inverted_cdf")
    return Estimate(float(x.mean()), float(low), float(high))


def _rng(key: int, purpose: str) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(int(fold(key, name_code(purpose)))))
