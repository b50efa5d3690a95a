"""Measures of a simulated run with a known scale: questions, wrong verdicts, losses, audits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from elicit.model.comparator import BY_ANSWERS, Decisions, Tier
from elicit.model.difference import dominance, tail_sums
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats, dot, gaps
from elicit.model.tutor import Tutor
from elicit.tutors.simulated import TruthfulTutor
from qlearn.learners.learner import Result
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import evaluate_policy, value_iteration

if TYPE_CHECKING:
    from pandas import DataFrame  # only summarise needs pandas, and it is handed a frame

CELL = (
    "problem",
    "learner",
    "comparator",
    "error_rate",
    "audit",
)  # the columns that name a cell of an ablation
MEASURES = (
    "asked",
    "asked_percent_open",
    "realised_error_rate",
    "wrong_percent",
    "wrong_percent_after",
    "audited",
    "audits_to_contradiction",
    "paper_loss_percent",
    "loss",
    "loss_initial",
    "loss_unasked",
    "excess_loss",
    "excess_loss_initial",
)

# verdicts kept before they are checked: one exact check costs as much as thousands together
_BUFFER = 4096
_BY_ANSWERS = np.isin([*Tier], BY_ANSWERS)  # by tier


class VerdictCounts(NamedTuple):
    """Numbers of a comparator's verdicts, and of the wrong ones among them.

    They are counted before and after the tutor's first wrong answer.
    """

    judged_before: int
    wrong_before: int
    judged_after: int
    wrong_after: int


class Watch:
    """Checks a comparator's verdicts against the hidden scale. Give it to a learner's ``watch``.

    It counts the verdicts BETTER and WORSE that depend on answers (``BY_ANSWERS``; dominance cannot
    be wrong).

    Parameters
    ----------
    values : (k,)
        The hidden scale.
    indifference : float
        A share of the value range. Pairs with |d.e| up to this are not counted, because they do not
        matter to the learner.
    erred : function
        Says whether the tutor has given a wrong answer yet.
    """

    def __init__(
        self,
        values: ArrayLike,
        indifference: float = 0.0,
        erred: Callable[[], bool] = lambda: False,
    ) -> None:
        self._truth = TruthfulTutor(values)
        self._gaps = gaps(values)
        self._indifference = indifference
        self._erred = erred
        self._waiting: list[tuple[Floats, NDArray[np.int8], NDArray[np.int64]]] = []
        self._rows = 0
        self._counts = np.zeros((2, 2), dtype=np.int64)  # before or after; decided, wrong

    def __call__(self, d: Floats, decisions: Decisions) -> None:
        """Enter the differences d (n, k) that a learner compared, and the decision on each."""
        counted = _BY_ANSWERS[decisions.tiers] & (np.abs(decisions.verdicts) == 1)
        if counted.any():
            rows = d[counted]
            self._waiting.append(
                (rows, decisions.verdicts[counted], np.full(len(rows), int(self._erred())))
            )
            self._rows += len(rows)
        if self._rows >= _BUFFER:
            self._count_waiting()

    @property
    def counts(self) -> VerdictCounts:
        """The counts so far."""
        self._count_waiting()
        return VerdictCounts(*self._counts.ravel().tolist())

    def _count_waiting(self) -> None:
        if not self._waiting:
            return
        d, said, after = (np.concatenate(part) for part in zip(*self._waiting, strict=True))
        true = self._truth.signs(d)
        matters = (true != 0) & (np.abs(dot(tail_sums(d), self._gaps)) > self._indifference)
        for column, chosen in enumerate((matters, matters & (true != said))):
            self._counts[:, column] += np.bincount(after[chosen], minlength=2)
        self._waiting, self._rows = [], 0


class Counted:
    """A tutor whose verdicts are counted, and those that are wrong for the hidden values (k,)."""

    def __init__(self, tutor: Tutor, values: Floats) -> None:
        self._tutor, self._truth = tutor, TruthfulTutor(values)
        self._given = self._wrong = 0

    def __call__(self, query: Query) -> Answer:
        """Return the tutor's answer. Raise TypeError unless it is an Answer."""
        answer = self._tutor(query)
        if not isinstance(answer, Answer):
            raise TypeError(
                f"a tutor returns an elicit.Answer, but {self._tutor!r} returned {answer!r}"
            )
        if answer.verdict is not None:
            true = int(self._truth.signs(query.d)[0])
            self._given += 1
            self._wrong += true != 0 and int(answer.verdict) != true
        return answer

    @property
    def realised_error_rate(self) -> float:
        """Share of the verdicts that are wrong; nan before the first.

        If two vectors are equal, calling one of them better is not wrong. If they differ, "equal"
        is wrong.
        """
        return self._wrong / self._given if self._given else float("nan")


def counts(result: Result) -> dict[str, Any]:
    """Return a run's numbers of questions and comparisons, for a row of a table.

    ``asked_percent_<denominator>`` are questions in percent of comparisons. The denominators are
    "all" comparisons, the "unequal" ones (the vectors differ) and the "open" ones, which dominance
    does not decide either. The percentage is nan if there are none. AlwaysAsk does not look for
    dominance, so that for it unequal pairs are open. The comparisons by tier follow.
    """
    unequal = result.compared - result.decided["equal"]
    denominators = {
        "all": result.compared,
        "unequal": unequal,
        "open": unequal - result.decided["dominance"],
    }
    return {
        "status": result.status.name.lower(),
        "rounds": result.rounds,
        "asked": result.asked,
        "compared": result.compared,
        **{
            f"asked_percent_{name}": 100 * result.asked / n if n else np.nan
            for name, n in denominators.items()
        },
        **{tier.name.lower(): result.decided[tier.name.lower()] for tier in Tier},
    }


def audits(result: Result, values: ArrayLike) -> dict[str, Any]:
    """Return the measures of a run's audits, for a row of a table.

    They are: the number of audits; the number (from 1) of the first audit that contradicted the
    answers, nan if none did; and who was wrong then, by the hidden scale ``values`` (k,). That is
    the "answers" given before (including a model's conclusion from them), the "audit", "neither"
    for an exact tie, or "" without a contradiction.
    """
    row: dict[str, Any] = {
        "audited": result.audited,
        "audits_to_contradiction": np.nan,
        "contradiction_due_to": "",
    }
    for number, audit in enumerate(result.audits, start=1):
        if audit.contradicts:
            true = int(TruthfulTutor(values).signs(audit.query.d)[0])
            guilty = "neither" if true == 0 else "audit" if true == audit.expected else "answers"
            return row | {"audits_to_contradiction": number, "contradiction_due_to": guilty}
    return row


def estimated_values(mdp: OrdinalMDP, q: Floats, values: ArrayLike) -> Floats:
    """Return v (S,) of the paper's figure 4: the maximum over actions a of sum_i Q(s, a)_i e_i.

    Q is the discounted counting vector, that is q (S, A, k) shares over 1 - discount. e are the
    hidden ``values`` (k,) as they are. Only admissible actions count.

    Since the maximum is taken with the hidden scale, which the learner does not know, v does not
    depend on the actions that the learner chose at the end.
    """
    e = np.asarray(values, dtype=np.float64)
    weighted = np.zeros(q.shape[:2])
    for i in range(mdp.k):  # summed in order: the same on every machine
        weighted += q[:, :, i] * e[i]
    v: Floats = np.where(mdp.admissible, weighted, -np.inf).max(axis=1) / (1 - mdp.discount)
    return v


def greatest_reward(mdp: OrdinalMDP, values: ArrayLike) -> float:
    """Return the greatest of the hidden ``values`` (k,) that an admissible action earns.

    It is max r in the formula of the paper's figure 4.
    """
    return float(np.asarray(values, dtype=np.float64)[mdp.levels[mdp.admissible]].max())


def paper_loss(v: Floats, baseline: Floats | float, best: float) -> float:
    """Return the percentage of loss in the paper's figure 4, signed.

    It is 100 sum_s (v(s) - V(s)) / (|S| max r). v (S,) and the baseline V (S,) are
    ``estimated_values`` with and without a preference model. ``best`` is the ``greatest_reward``;
    the result is nan if that is 0.

    Both v and V take the best action by the hidden scale. So the formula ignores which action the
    learner chose: a learner with a good Q that then takes the worst action everywhere would show no
    loss. The loss of the policy itself is ``planning.policy_loss``.
    """
    return float(100 * np.mean(v - baseline) / best) if best else float("nan")


def reference_differences(mdp: OrdinalMDP, values: ArrayLike) -> Floats:
    """Return differences (n, k) by which a noisy tutor's precision can be set.

    They are Q(s, a) - Q(s, a*) in shares under an optimal policy, for every admissible a that the
    order of the levels alone does not decide.
    """
    _, policy = value_iteration(mdp, values)
    shares = evaluate_policy(mdp, policy)
    q = (1 - mdp.discount) * mdp.vector_rewards()
    q += mdp.discount * (mdp.transitions @ shares).reshape(q.shape)
    d = q - q[np.arange(mdp.n_states), policy][:, None, :]
    d = d[mdp.admissible & ~mdp.terminal[:, None]]
    open_rows: Floats = d[dominance(tail_sums(d)) == Verdict.UNKNOWN]
    return open_rows


def summarise(frame: DataFrame) -> DataFrame:
    """Return a row for each cell, with the mean over its seeds of each of ``MEASURES``.

    Parameters
    ----------
    frame : pandas.DataFrame
        The rows of ``ablate``.

    Returns
    -------
    pandas.DataFrame
        The columns that name the cell come first, then counts of runs, then for each measure its
        mean and ``<name>_half``, half the width of its 95% t-interval (nan from a single seed).

    Notes
    -----
    Runs for which a measure is not defined are left out. So is a measure that the frame has no
    column for, such as ``loss_unasked`` (the loss of ``equal_gaps_policy``) in a file of an earlier
    version.

    ``wrong_percent`` is in percent of the verdicts that a comparator decided, and
    ``wrong_percent_after`` of those after the tutor's first wrong answer. Excess losses are paired
    by seed with the oracle. The counts are ``runs``, those with the budget spent, those stopped at
    the limit of sweeps, those with an audit that contradicted the answers, and those with such an
    audit that was itself wrong.
    """
    judged = frame.judged_before + frame.judged_after
    wide = frame.assign(
        wrong_percent=100 * (frame.wrong_before + frame.wrong_after) / judged.where(judged > 0),
        wrong_percent_after=100
        * frame.wrong_after
        / frame.judged_after.where(frame.judged_after > 0),
        budget_spent=frame.guess > 0,
        sweep_limit=frame.status == "sweep_limit",
        contradicted=frame.audits_to_contradiction > 0,
        audit_wrong=frame.contradiction_due_to == "audit",
        runs=1,
    )
    groups = wide.groupby(list(CELL), sort=False)
    counts = groups[["runs", "budget_spent", "sweep_limit", "contradicted", "audit_wrong"]].sum()
    measured = [name for name in MEASURES if name in wide]
    summary: DataFrame = counts.join(means(groups, measured)).reset_index()
    return summary


def means(groups: Any, measures: Sequence[str]) -> DataFrame:
    """Return the means of a grouped frame's measures.

    ``<name>_half`` is half the width of the 95% t-interval, nan from a single number. Numbers that
    are nan are left out.
    """
    mean, spread, n = (groups[list(measures)].agg(how) for how in ("mean", "std", "count"))
    table: DataFrame = mean.join(_half(spread, n).add_suffix("_half"))
    return table[[column for name in measures for column in (name, f"{name}_half")]]


def half_width(x: Floats) -> float:
    """Return half the width of the 95% t-interval of the mean of x (n,); nan if n is 1."""
    return float(_half(np.std(x, ddof=1), len(x))) if len(x) > 1 else float("nan")


def _half(spread: Any, n: Any) -> Any:
    return spread * stats.t.ppf(0.975, n - 1) / np.sqrt(n)
