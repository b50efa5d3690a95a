"""Interactive training: policies from any trainer, and the best of them by few questions.

The loss of the best policy is also bounded against policies that nobody has trained.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from time import thread_time
from typing import Any, ClassVar, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.fixed_order import product
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.threads import one_thread
from elicit._support.validation import is_list, is_number, is_whole, require
from elicit.asking.bags import Bags
from elicit.asking.elicitation import Elicitation, OnConflict
from elicit.asking.options import AskingOptions, check_options, filled
from elicit.asking.question import Pair
from elicit.model.comparator import Comparator, Tier
from elicit.model.comparator_parts import best_guess, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.needs import Needs, check_needs
from elicit.model.outcomes import Status
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats, values_of
from qlearn.certificates.loss_bound import draws_of
from qlearn.environments.rollout_shares import STANDARD_ERRORS, RolloutShares
from qlearn.learners.learner import check_tolerance
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    simple_pair,
    strategy_of,
    telling_violation,
)
from qlearn.training.reachable_set import ReachableSet, as_shares
from qlearn.training.training_bound import (
    ROUNDING,
    greatest_error,
    greatest_loss,
    guarantee_of,
    is_broken,
    observed_gap,
)
from qlearn.training.training_result import TrainedPolicy, TrainingResult

_CORNERS = 2  # questions about vertices that no policy has reached, after each training
# share of the tolerance that a difference, or a training's gain, must exceed to count
_MATTERS = 0.5
_LEAST = 0.1  # share of the tolerance that a training must promise if no question is left
_ABOUT = 12  # number of differences whose signs a simple question should tell
_LOOKED_AT = (
    512  # number of differences, those with the greatest bounds, among which a strategy chooses
)


class _Question(NamedTuple):
    """A pair to ask about next.

    ``at_corner`` is True if one of its vectors is a vertex of the reachable set that no policy has.
    """

    pair: Pair
    at_corner: bool = False


class InteractiveTraining:
    """Finds a good policy with any trainer that optimises one numeric reward at a time.

        while not training.finished:
            if (values := training.to_train()) is not None:
                policy = ...  # train on qlearn.OrdinalReward(env, values, ...)
                training.add(policy, qlearn.rollout_shares(env, policy))
            while queries := training.ask():
                training.tell([tutor(query) for query in queries])

    Ask and tell as with a learner. The object holds no trainer, tutor or file.

    Parameters
    ----------
    comparator : Comparator
        It must bound differences all at once and have plausible scales (``simultaneous_bounds``,
        ``draws``), as the polytope and the posterior do.
    discount : float
        Discount of the share vectors.
    tolerance : float
        A share of the value range, below 1. The training ends once answers and trainings can gain
        no more than this.
    optimality_gap : float, optional
        Largest distance of a training's result below its optimum, in the same unit (0: no
        distance). ``loss_bound`` includes it, as well as errors of measured shares. None: it is
        unknown, and there is no bound.
    objectives : (low (m,), high (m,)), optional
        Bounds of the objectives, for vectors of ``elicit.objectives`` with k = m + 1.
    strategy : callable or str
        Chooses the question, as in ``InteractivePolicyIteration``.
    bags : Bags, optional
        The simple questions that are asked when plain pairs run out. None: no such questions.
    max_trainings : int
        Largest number of trainings.
    **asking
        The options of ``elicit.AskingOptions``. The seed picks the audits, which come at the end
        and are of pairs of policies. The default of ``indifference`` is half the tolerance.
        ``batch`` has no effect: there is one question at a time.

    Raises
    ------
    TypeError
        If the comparator lacks a method that is needed, or a keyword is unknown.
    ValueError
        If a setting is out of range.

    Notes
    -----
    This is optimistic linear support over share vectors (Roijers 2015; Mossalam et al. 2016). The
    best policy so far is the best at the comparator's central scale. Its regret against each other
    policy is bounded over all plausible scales, and questions are about policies whose bound is too
    large.

    Policies that nobody has trained are bounded by the trainings: at the scale of a training, no
    policy is better than its result plus the gap. All vectors that satisfy these bounds form the
    ``ReachableSet``. Its vertices are asked about too, against the best policy, two after each
    training. The next scale to train on is the central one while much can be gained there. After
    that it is the plausible scale under which most can be gained.

    The number of the vertices grows fast. If there would be too many, the first trainings are left
    out of the set (docs/beyond-tables.md says how many levels that leaves room for).
    ``max_seconds`` limits the computing time.
    """

    needs: ClassVar[Needs] = Elicitation.needs | Needs(
        required=("simultaneous_bounds", "draws"), used=("level", "confidence", "lapse")
    )

    @takes_rng
    def __init__(
        self,
        comparator: Comparator,
        *,
        discount: float,
        tolerance: float = 0.01,
        optimality_gap: float | None = None,
        objectives: tuple[ArrayLike, ArrayLike] | None = None,
        strategy: Strategy | str = telling_violation,
        bags: Bags | None = Bags(),  # noqa: B008 (frozen)
        max_trainings: int = 40,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        check_needs(comparator, type(self), strategy_of(strategy))
        k = comparator.k
        require(
            is_number(discount, 0) and discount < 1,
            "discount",
            "a number of at least 0 and below 1",
            discount,
        )
        check_tolerance(tolerance)
        known_gap = optimality_gap is None or is_number(optimality_gap, 0)
        require(
            known_gap,
            "optimality_gap",
            "None or a share of the value range, at least 0",
            optimality_gap,
        )
        require(
            is_whole(max_trainings, 1),
            "max_trainings",
            "a whole number of at least 1",
            max_trainings,
        )
        require(
            bags is None or isinstance(bags, Bags),
            "bags",
            "None or an elicit.Bags, such as Bags(days=10)",
            bags,
        )
        labels = asking.get("labels")
        require(labels is None or is_list(labels, k), "labels", f"{k} names, one a level", labels)
        self.seed = asking["seed"] = seed_of(asking.get("seed", 0))
        self.discount, self.tolerance = float(discount), float(tolerance)
        self.optimality_gap = None if optimality_gap is None else float(optimality_gap)
        self._everything = (
            ReachableSet.shares(k) if objectives is None else ReachableSet.box(*objectives)
        )
        fits = self._everything.corners.shape[1] == k - 1
        require(
            fits,
            "objectives",
            f"the least and the greatest of each of {k - 1}, for k = {k}",
            objectives,
        )
        self._labels = (
            [f"level {i + 1}" for i in range(k)]
            if labels is None
            else [str(label) for label in labels]
        )
        self._strategy, self._bags = strategy_of(strategy), None if objectives is not None else bags
        self._most = int(max_trainings)
        self._most_seconds: float | None = None
        self._seconds = 0.0  # CPU seconds computed in calls that have ended
        self._elicitation = Elicitation(
            comparator,
            f"training/{k}/{discount!r}/{tolerance!r}",
            **filled(asking, {"indifference": tolerance * _MATTERS}),
        )
        self._policies: list[TrainedPolicy] = []
        # the limits of the trainings, in order, and the set that they leave
        self._limits: list[float] = []
        self._cut = self._everything
        self._corners_left = 0  # vertices to be asked about before the next training
        self._next: Floats | _Question | Status | None = (
            None  # a scale to train on, a question, or the final status
        )
        self._given: Floats | None = (
            None  # the scale that ``to_train`` gave, until a policy is added
        )

    def __repr__(self) -> str:
        now = self._elicitation
        counts = f"policies={len(self._policies)}, asked={now.asked}, pending={len(now.pending)}"
        return (
            f"InteractiveTraining({type(now.comparator).__name__}, k={now.comparator.k}, {counts})"
        )

    @property
    def max_seconds(self) -> float | None:
        """Largest number of CPU seconds of the object's own computing, in all calls together.

        None, the default, is no limit. The limit may be set at any time. If it has ended the
        training, a higher limit lets the training go on. Seconds of the trainer, of the tutor, and
        of reading the result's ``loss_bound`` do not count. The time is checked between steps, and
        a step that has begun is finished. At least one policy is trained.

        The status at the end is then TIME_LIMIT, and the result's ``loss_bound`` says what is
        proven of the best policy so far. With a limit, the end of a run depends on the machine.

        Raises
        ------
        ValueError
            When set to anything but None or a number above 0.
        """
        return self._most_seconds

    @max_seconds.setter
    def max_seconds(self, seconds: float | None) -> None:
        fits = seconds is None or (is_number(seconds, 0) and seconds > 0)
        require(fits, "max_seconds", "None or a number above 0", seconds)
        self._most_seconds = None if seconds is None else float(seconds)
        if self._next is Status.TIME_LIMIT:
            self._next = None

    @one_thread
    def to_train(self) -> Floats | None:
        """Return the values of the levels to train the next policy on, or None.

        They stay the same until a policy is added. The result is None while an answer is pending,
        and at the end.

        Returns
        -------
        (k,) from 0 to 1, or None
        """
        self._advance()
        self._given = self._next if isinstance(self._next, np.ndarray) else None
        return None if self._given is None else self._given.copy()

    @property
    def start_from(self) -> Any:
        """Return the best policy so far under ``to_train()``, for a warm start, or None.

        A cold start explores anew, which a warm start may not. In either case ``optimality_gap``
        says how near the training comes to its optimum.
        """
        self._advance()
        if not isinstance(self._next, np.ndarray) or not self._policies:
            return None
        return self._policies[int(np.argmax(product(self._shares(), self._next)))].policy

    def add(
        self,
        policy: Any,
        shares: ArrayLike | RolloutShares,
        errors: ArrayLike | None = None,
        *,
        trained: bool = True,
    ) -> None:
        """Add a policy, and its share of time at each level.

        Normally it is the policy that was trained on the values that ``to_train`` gave last. Then
        it limits what any other policy can reach.

        Parameters
        ----------
        policy
            Any object. The result returns it.
        shares : (k,) or RolloutShares
            As ``rollout_shares`` finds them, or its result. A total below 1 means that runs were
            cut off. The missing share counts in ``loss_bound``.
        errors : (k,), optional
            Standard errors of the shares; for objectives those of each (k - 1,). Without errors the
            shares are taken to be exact.
        trained : bool
            False for a policy of another origin. It may be chosen, but it limits no other policies.

        Raises
        ------
        ValueError
            If a number is out of range.
        """
        if isinstance(shares, RolloutShares):  # to a type checker it is also a sequence of numbers
            require(errors is None, "errors", "left out where shares have their own", errors)
            shares, errors, _ = shares
        k = self._elicitation.comparator.k
        x, undecided = as_shares(shares, k)
        excess = self._everything.excess(tail_sums(x))
        require(
            excess <= 1e-6,
            "shares",
            "of no negative share, or objectives within their range",
            shares,
        )
        error = undecided + (0.0 if errors is None else STANDARD_ERRORS * greatest_error(errors, k))
        self._policies.append(TrainedPolicy(policy, x, error, self._given if trained else None))
        if trained and self._given is not None:
            self._corners_left = _CORNERS
            self._given = None
        self._next = None

    @one_thread
    def ask(self) -> tuple[Query, ...]:
        """Return the pending query, or () if a policy is to be trained first, and at the end.

        It stays the same until it is answered.

        Returns
        -------
        tuple of Query
        """
        self._advance()
        if isinstance(self._next, _Question):
            pair, at_corner = self._next
            if not self._elicitation.pending:
                self._elicitation.open([pair])
            vars(self).update(
                _next=None, _corners_left=self._corners_left - at_corner
            )  # one call, so that an interruption changes both or neither
        return self._elicitation.ask()

    @one_thread
    def tell(
        self, answers: Sequence[Answer], on_conflict: OnConflict = "raise"
    ) -> tuple[Answer, ...]:
        """Take answers to pending queries.

        Parameters
        ----------
        answers : sequence of Answer
        on_conflict : {"raise", "drop"}
            With ``"drop"`` an answer that contradicts the others decides its own pair only, and is
            returned.

        Returns
        -------
        tuple of Answer
            The dropped answers.

        Raises
        ------
        StaleAnswer
            If no such query is pending.
        InconsistentAnswers
            Unless ``on_conflict="drop"``.
        """
        with self._counted():
            _, dropped = self._elicitation.tell(answers, on_conflict)
        self._next = None
        return dropped

    @property
    def finished(self) -> bool:
        """True if no training and no question is left."""
        self._advance()
        return not self._elicitation.pending and isinstance(self._next, Status)

    @property
    def comparator(self) -> Comparator:
        """The comparator with all answers learned so far."""
        return self._elicitation.comparator

    @property
    def implied(self) -> dict[str, Verdict]:
        """Verdicts that the answers so far imply on pending audits, by query id."""
        return {p.query.id: p.expected for p in self._elicitation.pending if p.expected is not None}

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]] | None) -> None:
        """Do nothing: each question is asked and logged.

        Parameters
        ----------
        signs : callable or None
            Ignored.
        """

    @one_thread
    def result(self) -> TrainingResult:
        """Return the best policy so far and its bound. It may be called at any time.

        It changes no later question.

        Returns
        -------
        TrainingResult
        """
        self._advance()
        asked, comparator = self._elicitation, self._elicitation.comparator
        asks = bool(asked.pending) or isinstance(self._next, _Question)
        waits = Status.WAITING if asks else Status.TRAINING
        at = self._best() if self._policies else None
        policies, gap = tuple(self._policies), self.optimality_gap
        return TrainingResult(
            policy=None if at is None else self._policies[at].policy,
            shares=None if at is None else self._policies[at].shares.copy(),
            status=self._next if isinstance(self._next, Status) and not asked.pending else waits,
            asked=asked.asked,
            trained=sum(policy.trained_on is not None for policy in self._policies),
            observed_gap=observed_gap(self._policies),
            policies=policies,
            comparator=comparator,
            answers=asked.answers,
            audits=tuple(asked.audits),
            cannot_tell=asked.cannot_tell,
            guarantee=partial(guarantee_of, self._everything, policies, at, comparator, gap),
        )

    def _advance(self) -> None:
        """Find the next step: a question, a training, or the end. Nothing is asked yet."""
        if self._next is None and not self._elicitation.pending:
            with self._counted() as late:
                self._next = self._find_next(late)

    @contextmanager
    def _counted(self) -> Iterator[Callable[[], bool]]:
        """Count the CPU seconds within this context.

        The context's value is a function that returns whether the time is over.
        """
        begun, before, most = thread_time(), self._seconds, self._most_seconds
        try:
            yield lambda: most is not None and before + thread_time() - begun >= most
        finally:
            self._seconds = before + thread_time() - begun

    def _find_next(self, late: Callable[[], bool]) -> Floats | _Question | Status:
        """Return the scale to train on, or the question to ask, or at the end the status."""
        comparator = self._elicitation.comparator
        centre = np.diff(best_guess(comparator))
        if not self._policies:
            return _values(centre)
        if late():
            return self._stopped(Status.TIME_LIMIT)
        at, shares, reach = self._best(), self._shares(), self._reach()
        unseen = reach.vectors - shares[at]
        loss, high, confidence = greatest_loss(unseen, comparator)
        if loss <= self.tolerance:
            return self._audit(shares, at) or self._converged(confidence)
        if late():
            return self._stopped(Status.TIME_LIMIT)
        spent = self._elicitation.spent
        others = np.delete(shares, at, axis=0) - shares[at]
        if (
            not spent
            and (pair := self._best_pair(others, partial(self._pair_of_policies, at))) is not None
        ):
            return _Question(pair)
        gaps = np.column_stack([centre, draws_of(comparator).gaps])
        gain = reach.greatest(gaps) - product(tail_sums(shares), gaps).max(axis=0)
        least = (_MATTERS if spent else _LEAST) * self.tolerance
        at_limit = self._at_the_limit()
        missed = at_limit and gain.max() > least  # a training that the limit prevents
        if at_limit:
            gain = np.zeros_like(gain)
        promising = gain.max() > _MATTERS * self.tolerance
        if not spent and (self._corners_left > 0 or not promising):
            rows = np.flatnonzero(high > self.tolerance)
            pair = self._best_pair(
                unseen[rows], partial(self._pair_with_unseen, at, reach.vectors[rows])
            )
            if pair is not None:
                return _Question(pair, at_corner=True)
        if gain[0] > _MATTERS * self.tolerance:
            return _values(centre)
        if gain.max() > least:
            return _values(gaps[:, int(np.argmax(gain))])
        if not spent and (pair := self._simple_pair(unseen[high > self.tolerance])) is not None:
            return _Question(pair)
        if missed:
            return self._stopped(Status.TRAINING_LIMIT)
        if spent:
            return self._stopped(Status.GUESSED)
        called_equal = self._elicitation.called_equal
        return self._stopped(Status.CALLED_EQUAL if called_equal else Status.EXHAUSTED)

    def _at_the_limit(self) -> bool:
        return sum(policy.trained_on is not None for policy in self._policies) >= self._most

    def _shares(self) -> Floats:
        """The shares (n, k) of the policies added so far."""
        return np.array([policy.shares for policy in self._policies])

    def _best(self) -> int:
        """Return the number of the policy that is best at the central scale.

        If several are equally good, it is the first.
        """
        return int(
            np.argmax(
                product(
                    tail_sums(self._shares()), np.diff(best_guess(self._elicitation.comparator))
                )
            )
        )

    def _reach(self) -> ReachableSet:
        """Return the set of all vectors that policies may have, as far as the trainings tell.

        At the scale of each training, the best policy added so far is taken to be optimal.
        """
        scales = [np.diff(one.trained_on) for one in self._policies if one.trained_on is not None]
        if not scales:
            return self._everything
        limits = product(tail_sums(self._shares()), np.array(scales).T).max(axis=0).tolist()
        if limits != self._limits:
            cuts = [*zip(scales, limits, strict=True)]
            self._limits, self._cut = limits, self._everything.cut_by(cuts)
        return self._cut

    def _best_pair(self, d: Floats, pair: Callable[[int], Pair]) -> Pair | None:
        """Return the best question about d (n, k), among those that matter, or None."""
        elicitation = self._elicitation
        high = simultaneous_bounds(elicitation.comparator, d)[0]
        rows = np.argsort(-high, kind="stable")[:_LOOKED_AT]
        rows = rows[high[rows] > max(self.tolerance, elicitation.indifference)]
        rows = rows[elicitation.may_ask(d[rows], lambda i: pair(int(rows[i])).place)]
        if not len(rows):
            return None
        return pair(int(rows[best(self._strategy, self._candidates(d[rows]))[0]]))

    def _simple_pair(self, d: Floats) -> Pair | None:
        """Return a question of simple bags about the signs of differences d (n, k), or None."""
        if self._bags is None or not len(d):
            return None
        candidates = self._candidates(d[:_LOOKED_AT])
        about = candidates.d[best(self._strategy, candidates, _ABOUT)]
        return simple_pair(self._elicitation, self._bags, candidates, about, self._labels)

    def _candidates(self, d: Floats) -> Candidates:
        nowhere = np.zeros(len(d), dtype=np.int64)
        return Candidates(
            d, nowhere, nowhere, _MATTERS * self.tolerance, self._elicitation.comparator
        )

    def _pair_of_policies(self, at: int, row: int, tier: int = int(Tier.TUTOR)) -> Pair:
        """Return the question about the best policy and another one, the row-th of the others."""
        other = row + (row >= at)
        about = f"policy {other + 1} (left) or policy {at + 1}, the best so far (right)?"
        place = (("policies", min(at, other), max(at, other)),)
        return Pair(self._policies[other].shares, self._policies[at].shares, about, place, tier)

    def _pair_with_unseen(self, at: int, unseen: Floats, row: int) -> Pair:
        """Return the question about the best policy and a row of vectors that no policy has."""
        about = f"what no policy has shown yet (left) or policy {at + 1}, the best so far (right)?"
        place = (("unseen", at, np.round(unseen[row], 2).tobytes()),)
        return Pair(unseen[row], self._policies[at].shares, about, place)

    def _audit(self, shares: Floats, at: int) -> _Question | None:
        """Return a pair of policies that the answers have decided, if audits are wanted."""
        d = np.delete(shares, at, axis=0) - shares[at]
        decisions = self._elicitation.decide(d, lambda row: self._pair_of_policies(at, row).place)
        rows = np.flatnonzero(
            (decisions.verdicts == Verdict.UNKNOWN) & (decisions.tiers != Tier.TUTOR)
        )
        if not len(rows) or not self._elicitation.audits_left:
            return None
        return _Question(self._pair_of_policies(at, int(rows[0]), int(decisions.tiers[rows[0]])))

    def _converged(self, confidence: float) -> Status:
        if self.optimality_gap is None:
            return Status.UNPROVEN
        if is_broken(self._policies, self.optimality_gap):
            return Status.GAP_BROKEN
        if np.isnan(confidence):
            return Status.BOUNDED
        comparator, policies = self._elicitation.comparator, tuple(self._policies)
        found = guarantee_of(
            self._everything, policies, self._best(), comparator, self.optimality_gap
        )
        return Status.CONVERGED if found.loss_bound <= self.tolerance + ROUNDING else Status.SETTLED

    def _stopped(self, why: Status) -> Status:
        """Return the status at an end without a proof."""
        broken = self.optimality_gap is not None and is_broken(self._policies, self.optimality_gap)
        return Status.GAP_BROKEN if broken else why


def _values(gaps: Floats) -> Floats:
    values = values_of(gaps)
    return np.asarray(values / values[-1])
