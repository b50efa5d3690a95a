"""Planning of a question budget: loss bounds that a number of questions is likely to prove."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.hashing import Seed, key_of
from elicit._support.seeds import seed_of
from elicit._support.validation import is_whole, require
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import lapse_of, unordered_of
from elicit.model.difference import tail_sums
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats
from elicit.model.tutor import Tutor
from elicit.tutors.simulated import FlippingTutor, TruthfulTutor
from qlearn.certificates.loss_bound import draws_of
from qlearn.learners.learner import check_problem
from qlearn.learners.policy_iteration import InteractivePolicyIteration
from qlearn.mdp.ordinal_mdp import OrdinalMDP

_LEAST_GAP = 1e-9  # least gap of a drawn scale, so that a simulated tutor can tell all levels apart
_FEWEST = 3  # fewest runs: the range of fewer says nothing


@dataclass(frozen=True, eq=False)
class ExpectedBounds:
    """Loss bounds at the end of simulated sessions with a budget of questions.

    Attributes
    ----------
    questions : int
        The budget.
    before : float
        The loss bound before the first question, a share of the value range.
    bounds : (runs,)
        Loss bounds at the end of each simulated session, ascending.
    asked : (runs,)
        Numbers of questions asked, in the same order. They are below the budget if the tolerance
        was reached sooner.
    """

    questions: int
    before: float
    bounds: Floats
    asked: NDArray[np.int64]

    @property
    def median(self) -> float:
        """The median of the bounds."""
        return float(np.median(self.bounds))

    @property
    def least(self) -> float:
        """The least of the bounds."""
        return float(self.bounds[0])

    @property
    def most(self) -> float:
        """The greatest of the bounds."""
        return float(self.bounds[-1])

    @property
    def coverage(self) -> float:
        """Probability that another such session ends between ``least`` and ``most``.

        It is (runs - 1) / (runs + 1), if the hidden scale is like those that were drawn, and the
        tutor like the simulated ones.
        """
        return (len(self.bounds) - 1) / (len(self.bounds) + 1)

    def __str__(self) -> str:
        number = "1 question" if self.questions == 1 else f"{self.questions} questions"
        sooner = int((self.asked < self.questions).sum())
        return (
            f"{number} bounded the loss by {_percent(self.median)} of the value range in half of "
            f"{len(self.bounds)} simulated sessions, and by {_percent(self.least)} to "
            f"{_percent(self.most)} in all of them. Without any question the bound is "
            f"{_percent(self.before)}. Yours ends in this range with a chance of about "
            f"{100 * self.coverage:.0f}%, if your scale is like those that were drawn."
            + (f" {sooner} of the sessions needed fewer questions." if sooner else "")
        )


def expected_bounds(
    mdp: OrdinalMDP,
    comparator: Comparator,
    questions: int = 10,
    *,
    runs: int = 20,
    seed: Seed | None = None,
    **learner: Any,
) -> ExpectedBounds:
    """Simulate sessions to see what a number of questions is likely to prove.

    Use it to plan: how many questions are worth the tutor's time? You can call it again in the
    middle of a session, with the comparator that knows the answers so far.

    Parameters
    ----------
    mdp : OrdinalMDP
        The problem.
    comparator : Comparator
        What is known of the scale so far. It is not changed.
    questions : int
        The budget, at least 1.
    runs : int
        Number of simulated sessions, at least 3. A session takes about a second with a polytope,
        and ten times as long with a posterior.
    seed : optional
        The same int gives the same sessions.
    **learner
        Settings of ``InteractivePolicyIteration``, such as ``tolerance`` and ``bags``.

    Returns
    -------
    ExpectedBounds
        ``print`` says it in words.

    Raises
    ------
    ValueError
        If ``questions`` or ``runs`` is too small, or the comparator is for another number of
        levels.

    Notes
    -----
    Each session draws a scale from those that the comparator holds plausible. The tutor answers
    truthfully by that scale, but flips a share of the answers: half of the comparator's ``lapse``,
    because half of the answers given at random are wrong.

    Examples
    --------
    >>> mdp, values = qlearn.random_mdp(n_states=20, n_actions=3, n_levels=5, seed=1)
    >>> plan = qlearn.expected_bounds(mdp, elicit.PolytopeComparator(5), 3, runs=5, seed=1)
    >>> plan.least <= plan.median <= plan.most <= plan.before
    True
    """
    check_problem(mdp, comparator)
    require(is_whole(questions, 1), "questions", "a whole number of at least 1", questions)
    require(is_whole(runs, _FEWEST), "runs", f"a whole number of at least {_FEWEST}", runs)
    rng = np.random.default_rng(key_of(seed_of(seed)))
    drawn = draws_of(comparator)
    chosen = rng.choice(len(drawn.weights), size=runs, p=drawn.weights / drawn.weights.sum())
    errors = lapse_of(comparator) / 2
    before = InteractivePolicyIteration(mdp, comparator, seed=0, **learner).result().loss_bound
    ends = []
    for which in chosen.tolist():
        own = int(rng.integers(2**62))  # of this session
        gaps = drawn.gaps[:, which]
        tutor: Tutor
        if unordered_of(comparator) is not None:
            tutor = partial(_truthful, gaps)
        else:
            values = np.concatenate([[0.0], np.cumsum(np.maximum(gaps, _LEAST_GAP))])
            tutor = FlippingTutor(values, errors, own) if errors else TruthfulTutor(values)
        run = InteractivePolicyIteration(mdp, comparator, seed=own, **learner)
        asked = 0
        while asked < questions and (queries := run.ask()):
            run.tell([tutor(query) for query in queries], on_conflict="drop")
            asked += len(queries)
        ends.append((run.result().loss_bound, asked))
    bounds, numbers = zip(*sorted(ends), strict=True)
    return ExpectedBounds(int(questions), before, np.array(bounds), np.array(numbers))


def _truthful(gaps: Floats, query: Query) -> Answer:
    """Return the true answer for a scale with gaps (k - 1,), some of which may be negative."""
    worth = float(product(tail_sums(query.d[None]), gaps)[0])
    return Answer(query, Verdict(int(np.sign(worth))))


def _percent(share: float) -> str:
    """Return an upper bound in percent: two digits, at least a hundredth of a percent."""
    percent = max(100 * share, 0.01)
    return f"{percent:.2g}%" if percent < 99.5 else f"{percent:.0f}%"
