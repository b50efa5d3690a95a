"""Reports on the tutor behind a log: error rates, precision, and side bias.

The hidden scale is not known here. Wrong answers show in three ways: a question was asked twice
with different answers, an answer contradicts the order of the levels, or, by the model of
``PosteriorComparator``, an answer fits no scale that fits the others.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from elicit._support.hashing import Seed, key_of
from elicit._support.seeds import seed_of
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, require
from elicit.asking.options import EarlierAnswers
from elicit.comparators.bradley_terry.first_particles import PRECISION
from elicit.comparators.bradley_terry.particle_comparator import PARTICLES, PosteriorComparator
from elicit.lp.prior_inequalities import PriorLike
from elicit.model.comparator import check_levels
from elicit.model.difference import dominance, tail_sums
from elicit.model.pairs import pair_numbers, ways_round
from elicit.model.query import Answers
from elicit.model.scale import Floats
from elicit.tutors.answer_log import AnswerLog, entries_of

_BOUNDLESS = math.exp(
    PRECISION[0] + 1.25 * PRECISION[1]
)  # an upper end of the precision above it comes from the prior
_SHOWN = 5  # number of doubtful answers that a report names


class Estimate(NamedTuple):
    """A number with an interval; nan if the answers say nothing about it."""

    value: float
    low: float
    high: float

    @property
    def percent(self) -> str:
        """Return the estimate as text, in percent."""
        return f"{100 * self.value:.3g}% ({100 * self.low:.3g} to {100 * self.high:.3g})"


NOTHING = Estimate(math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class TutorReport:
    """Findings of ``tutor_report``; ``str()`` puts them in sentences.

    Intervals of estimates have the level ``level``.

    Attributes
    ----------
    answers
        Number of answers that prefer a side or call a tie. ``ties`` of them are ties. ``unused`` of
        them were told but not learned. A session's repeated questions are not among them.
    cannot_tell, retracted
        Numbers of answers of these kinds. They are not among ``answers``.
    by_order, against_order
        Number of answers to pairs that the order of the levels decides, and number of these that
        contradict it.
    repeated
        Number of questions asked more than once.
    couples
        Number of couples of answers to the same question: its first two answers, the next two, and
        so on.
    consistency
        Share of couples that agree, with an exact interval (Clopper and Pearson 1934).
    error_rate_repeated
        Error rate from the couples without ties, with an exact interval.
    error_rate
        Share of the log's own answers (without ties) that are wrong, by the model.
    precision
        In logits per unit of d.e (median, quantiles).
    lapse
        Share of answers given at random, half of which are wrong (mean, shortest interval).
    doubtful
        (id, probability) of the answers that are more probably wrong than right.
    sided, exchanged, left_share
        ``sided`` is the number of answers that prefer a side, or 0 if the log does not say which
        side was shown left. ``exchanged`` of these were shown flipped. ``left_share`` is the share
        of the sided answers that prefer the side shown left, with an exact interval.
    left_p
        Two-sided exact p-value of a bias to one side. It tests ``left_share`` against 1/2, which is
        right if sides were exchanged at random. It is nan if they were exchanged never or always.
    """

    k: int
    level: float
    answers: int
    ties: int
    cannot_tell: int
    retracted: int
    unused: int
    by_order: int
    against_order: int
    repeated: int
    couples: int
    consistency: Estimate
    error_rate_repeated: Estimate
    error_rate: Estimate = NOTHING
    precision: Estimate = NOTHING
    lapse: Estimate = NOTHING
    doubtful: tuple[tuple[str, float], ...] = ()
    sided: int
    exchanged: int
    left_share: Estimate
    left_p: float

    def __str__(self) -> str:
        kinds = (
            f"{self.ties} of them ties, {self.unused} not learned from; {self.cannot_tell} more "
            "could not be told"
        )
        lines = {
            "answers": f"{self.answers} over {self.k} levels, {kinds}, {self.retracted} were "
            "retracted",
            "errors": "not known: no answer prefers a side",
            "": "not known from questions asked again: there are none without ties",
            "order": "no question was decided by the order of the levels alone",
            "repeats": "no question was asked twice",
        }
        if self.answers > self.ties:
            lines["errors"] = f"{self.error_rate.percent} of the answers are wrong, by the model"
            lines["precision"] = "{:.3g} ({:.3g} to {:.3g}) logits per unit of d.e".format(
                *self.precision
            )
            lines["precision"] += ", the upper end being the prior's" * (
                self.precision.high > _BOUNDLESS
            )
            lines["lapse"] = (
                f"{self.lapse.percent} of the answers are given at random, half of these wrongly"
            )
            names = [f"{name} ({100 * p:.0f}%)" for name, p in self.doubtful]
            lines["doubtful"] = (
                ", ".join(names[:_SHOWN]) or "no answer is more probably wrong than right"
            )
            lines["doubtful"] += f" and {len(names) - _SHOWN} more" * (len(names) > _SHOWN)
        if not math.isnan(self.error_rate_repeated.value):
            lines[""] = (
                f"{self.error_rate_repeated.percent} by questions asked again, if errors are "
                "independent"
            )
        if self.by_order:
            settled = f"{self.by_order} answers that the order of the levels decides"
            lines["order"] = f"{self.against_order} of {settled} defy it"
        if self.couples:
            agree = f"{self.consistency.percent} of {self.couples} couples of answers agree"
            lines["repeats"] = f"{self.repeated} questions were asked again; {agree}"
        lines["sides"] = "which side was shown left is not known: give the log, not bare Answers"
        if self.sided:
            lines["sides"] = (
                f"{self.left_share.percent} of {self.sided} answers prefer the side shown left"
            )
            bias = "a bias" if self.left_p < 1 - self.level else "no sign of a bias"
            tested = f" ({self.exchanged} shown exchanged), p = {self.left_p:.2g}: {bias}"
            untested = (
                ", but sides were never exchanged at random: that may be what was asked, not a bias"
            )
            lines["sides"] += untested if math.isnan(self.left_p) else tested
        title = f"Tutor report, {100 * self.level:g}% intervals in brackets"
        return "\n".join([title, *(f"  {name:<10}{text}" for name, text in lines.items())])


def tutor_report(
    log: EarlierAnswers,
    k: int | None = None,
    *,
    level: float = 0.95,
    prior: PriorLike = None,
    particles: int = PARTICLES,
    seed: Seed | None = 0,
) -> TutorReport:
    """Estimate how often a tutor errs, how precise the answers are, and a side bias.

    Parameters
    ----------
    log : AnswerLog, its entries, Answers to queries, or bare ``Answers``
        Retracted answers are left out. Answers marked unused count: most were set aside because
        they contradict others, so leaving them out would flatter the tutor.
    k : int, optional
        Number of levels. It is needed if nothing else says it.
    level : float
        Level of the intervals, in (0, 1).
    prior : optional
        Inequalities that hold for certain, as in ``PosteriorComparator``.
    particles : int
        Number of draws from the posterior.
    seed : int, SeedSequence, Generator or None

    Returns
    -------
    TutorReport

    Raises
    ------
    ValueError
        If the level is outside (0, 1), or if nothing says how many levels there are.

    Notes
    -----
    There are two error rates. The first is from repeated questions. Suppose that errors are
    independent, and equally likely in both directions, with the rate e. Two answers to the same
    pair then differ with probability q = 2 e (1 - e), so e = (1 - sqrt(1 - 2 q)) / 2. This assumes
    nothing about the scale. But errors that a tutor repeats stay hidden, and if error rates differ
    between pairs, e is below their mean.

    The second is from the model, P(left said better) = lapse/2 + (1 - lapse) sigma(c d.e), with the
    prior of ``PosteriorComparator`` on scale, precision c and lapse. It is the posterior share of
    answers on the wrong side of the scale. The interval of the lapse is the shortest one that holds
    the share ``level`` of the posterior. An interval that starts at 0 is given instead if it is at
    most about a tenth longer.

    If each question was chosen because its answer could not be predicted, some twenty answers say
    little about errors. The priors then dominate both figures from the model. A tutor who never
    errs, even at near ties, fits every large precision equally well. The upper end of the
    precision's interval is then that of the prior.
    """
    check_level(level)
    told = read_log(log, k)
    answers, n = told.answers, len(told.answers)
    y, decisive = answers.y, answers.y != 0
    couples, repeated = _couples(answers)
    oriented = y * ways_round(tail_sums(answers.d))
    agree = oriented[couples[:, 0]] == oriented[couples[:, 1]]
    clear = decisive[couples].all(axis=1)
    differ = exact_share(int((~agree & clear).sum()), int(clear.sum()), level)
    order = dominance(tail_sums(answers.d))
    settled = (np.abs(order) == 1) & decisive
    recorded = decisive & (told.swapped is not None)
    swapped = np.zeros(n, dtype=np.bool_) if told.swapped is None else told.swapped
    sided, exchanged = int(recorded.sum()), int((swapped & recorded).sum())
    left = int(((y > 0) != swapped)[recorded].sum())
    return TutorReport(
        k=answers.k,
        level=level,
        answers=n,
        ties=int((~decisive).sum()),
        cannot_tell=told.cannot_tell,
        retracted=told.retracted,
        unused=told.unused,
        by_order=int(settled.sum()),
        against_order=int((settled & (order == -y)).sum()),
        repeated=repeated,
        couples=len(couples),
        consistency=exact_share(int(agree.sum()), len(couples), level),
        error_rate_repeated=Estimate(
            *((1.0 - math.sqrt(1.0 - 2.0 * min(q, 0.5))) / 2.0 for q in differ)
        ),
        **(_fit_model(answers, level, prior, particles, seed) if decisive.any() else {}),
        sided=sided,
        exchanged=exchanged,
        left_share=exact_share(left, sided, level),
        left_p=float(binomtest(left, sided).pvalue) if 0 < exchanged < sided else math.nan,
    )


def exact_share(count: int, n: int, level: float = 0.95) -> Estimate:
    """Return count / n with Clopper and Pearson's interval; nan for n = 0.

    Parameters
    ----------
    count, n : int
    level : float

    Returns
    -------
    Estimate
    """
    return (
        Estimate(count / n, *binomtest(count, n).proportion_ci(level, method="exact"))
        if n
        else NOTHING
    )


class _Record(NamedTuple):
    """A log's answers that were not taken back, and counts of its other answers.

    ``swapped`` (n,) flags the answers that were shown with sides exchanged; None if the log does
    not say it.
    """

    answers: Answers
    swapped: NDArray[np.bool_] | None
    cannot_tell: int = 0
    retracted: int = 0
    unused: int = 0


def read_log(log: EarlierAnswers, k: int | None) -> _Record:
    """Return a log's answers about k levels that were not taken back, and counts of the others.

    Parameters
    ----------
    log : AnswerLog, its entries, Answers to queries, or bare ``Answers``
    k : int or None

    Raises
    ------
    TypeError
        If it is no log.
    ValueError
        If it is about other levels, or nothing says how many.
    """
    k = None if k is None else check_levels(k)
    if isinstance(log, Answers):
        if k not in (None, log.k):
            raise ValueError(f"these answers are about {log.k} levels, not k = {k}")
        return _Record(log, None)
    if not isinstance(log, Iterable):
        raise TypeError(f"a log is an AnswerLog, its entries, or Answers, not {log!r}")
    entries = entries_of(log)
    standing = [entry for entry in entries if entry.stands]
    told = [entry.answer for entry in standing if entry.answer.verdict is not None]
    levels = k or (
        log.k
        if isinstance(log, AnswerLog)
        else len(entries[0].answer.query.left)
        if entries
        else None
    )
    if levels is None:
        raise ValueError("the log is empty, so that nothing says how many levels there are: give k")
    return _Record(
        Answers.of(told, levels),
        np.array([answer.swapped for answer in told], dtype=np.bool_),
        len(standing) - len(told),
        sum(entry.retracted for entry in entries),
        sum(
            not entry.used and not entry.repeat and entry.answer.verdict is not None
            for entry in standing
        ),
    )


def _couples(answers: Answers) -> tuple[NDArray[np.intp], int]:
    """Return pairs of rows (m, 2) that answer the same question, and the number of such questions.

    No row is in two couples, so that couples are independent. Questions about equal vectors do not
    count.
    """
    pairs, asked = pair_numbers(answers.d), np.any(answers.d != 0, axis=1)
    rows = [
        np.flatnonzero(asked & (pairs == pair)) for pair in dict.fromkeys(pairs[asked].tolist())
    ]
    couples = [mine[: len(mine) // 2 * 2].reshape(-1, 2) for mine in rows]
    return np.concatenate([np.empty((0, 2), np.intp), *couples]), sum(
        len(mine) > 1 for mine in rows
    )


@one_thread
def _fit_model(
    answers: Answers, level: float, prior: PriorLike, particles: int, seed: Seed | None
) -> dict[str, Any]:
    """Return the parts of a ``TutorReport`` that come from the model, by name."""
    posterior = PosteriorComparator(
        answers.k, particles=particles, prior=prior, seed=key_of(seed_of(seed)), tie=0.0
    ).update(answers)
    draws, lapses, tied = posterior.draws, posterior.lapses, answers.y == 0
    t = tail_sums(answers.d) * np.where(tied, 1, answers.y)[:, None]
    against = t @ draws.gaps < 0
    wrong = against[~tied].mean(axis=0)
    doubt = np.where(tied, 0.0, against @ draws.weights)
    doubtful = [i for i in np.argsort(-doubt, kind="stable") if doubt[i] > 0.5]
    tails = [(1 - level) / 2, (1 + level) / 2]

    def quantiles(numbers: Floats, shares: list[float]) -> list[float]:
        found = np.quantile(numbers, shares, weights=draws.weights, method="inverted_cdf")
        return [float(each) for each in found]

    return {
        "error_rate": _around(float(wrong @ draws.weights), *quantiles(wrong, tails)),
        "precision": Estimate(*quantiles(draws.precision, [0.5, *tails])),
        "lapse": _around(float(lapses @ draws.weights), *_shortest(lapses, draws.weights, level)),
        "doubtful": tuple((answers.ids[i], float(doubt[i])) for i in doubtful),
    }


def _shortest(shares: Floats, weights: Floats, level: float) -> tuple[float, float]:
    """Return the shortest interval that holds a weight of ``level`` of some weighted numbers >= 0.

    An interval that starts at 0 is returned instead if it is less than a ninth longer: which of the
    two is shorter may be chance.
    """
    order = np.argsort(shares, kind="stable")
    at, below = shares[order], np.concatenate([[0.0], np.cumsum(weights[order])])
    last = np.searchsorted(below[1:], below[:-1] + level * (1.0 - 1e-9))
    starts = np.flatnonzero(last < len(at))
    lengths = at[last[starts]] - at[starts]
    first = int(starts[np.argmin(lengths)])
    if lengths.min() > 0.9 * at[last[0]]:
        return 0.0, float(at[last[0]])
    return float(at[first]), float(at[last[first]])


def _around(value: float, low: float, high: float) -> Estimate:
    """Return the interval as an Estimate, widened to hold the value, which may lie outside."""
    return Estimate(float(value), float(min(low, value)), float(max(high, value)))


def check_level(level: float) -> None:
    """Raise ValueError unless a level is in (0, 1)."""
    require(is_number(level) and 0 < level < 1, "level", "a number strictly between 0 and 1", level)
