"""The parts that all learners share: ask and tell, and their Result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed
from elicit._support.threads import one_thread
from elicit._support.validation import is_number, require
from elicit.asking.elicitation import Elicitation, OnConflict, Watcher
from elicit.asking.question import AnsweredQuery, Audit, Pair
from elicit.comparators.panel import Panel
from elicit.model.comparator import Comparator, Tier, check_comparator_made
from elicit.model.comparator_parts import tie_of, wrong_of
from elicit.model.needs import Needs
from elicit.model.outcomes import Status, assumed_of_answers
from elicit.model.query import (
    Answer,
    Answers,
    Query,
    Verdict,
)
from elicit.model.scale import Floats
from qlearn.certificates.loss_bound import BOUNDING, Guarantee, loses_at_most, loss_bound
from qlearn.certificates.within_reach import out_of_reach, tolerance_within_reach
from qlearn.mdp.ordinal_mdp import OrdinalMDP


def place(mdp: OrdinalMDP, state: int, a: int, b: int) -> tuple[str, str, tuple[int, int, int]]:
    """Return the place at which actions a and b are compared: its names.

    There are three names: the question in words with a on the left, the question in words with b on
    the left, and the numbers of the state and of the actions.
    """
    return _sentence(mdp, state, a, b), _sentence(mdp, state, b, a), (state, min(a, b), max(a, b))


def _sentence(mdp: OrdinalMDP, state: int, a: int, b: int) -> str:
    other = f"action {b}" if mdp.action_names is None else mdp.action_names[b]
    return f"state {mdp.state_name(state)}: action {mdp.action_name(a)} (left) or {other} (right)?"


def pair_of(
    mdp: OrdinalMDP,
    left: Floats,
    right: Floats,
    state: int,
    a: int,
    b: int,
    tier: int = int(Tier.TUTOR),
) -> Pair:
    """Return the question which of two actions, a and b, is better at a state.

    ``left`` (k,) is the vector of a, and ``right`` (k,) that of b.
    """
    sentences = place(mdp, state, a, b)
    return Pair(left, right, sentences[0], sentences, tier)


def state_of(pair: Pair) -> int:
    """Return the state at which a pair made by ``pair_of`` compares two actions."""
    _, _, numbers = pair.place
    return cast(tuple[int, int, int], numbers)[0]


def check_problem(mdp: OrdinalMDP, comparator: Comparator) -> None:
    """Raise TypeError unless the arguments are an MDP and a comparator.

    Raise ValueError if their numbers of levels differ.
    """
    if not isinstance(mdp, OrdinalMDP):
        raise TypeError(f"an OrdinalMDP is wanted, not {mdp!r}")
    check_comparator_made(comparator)
    if mdp.k != comparator.k:
        raise ValueError(
            f"the MDP has {mdp.k} levels, but the comparator was made for k = {comparator.k}: make "
            f"it with k = {mdp.k}"
        )


_MANY_EQUAL = 3
"""Fewer answers "equal" say nothing about the tutor. With 5 in place of 3, four of eight runs whose
bound was violated would not have warned: 5 levels, a tutor who calls equal what lies within 5% or
10% of the value range, 36 random MDPs each.
"""
_SHARE_OF_EQUAL = 0.3
"""The share of answers "equal" from which on a result warns. Above it a bound of 95% held in
68% of runs with simulated persons, below it in 98% (benchmarks/RESULTS-promise.md).
"""
_MOST_LISTED = 12  # states whose actions are printed one by one; of more, actions are counted
_USELESS = 0.5  # a loss bound of this share of the value range tells nobody much
_LEAST_SHOWN = 1e-6
"""The least positive loss bound that is printed, a share of the value range: rounding alone gives
smaller ones.
"""

_SHARE = "a share of the value range, above 0 and below 1 (0.01: a policy may lose 1% of the range)"


def check_tolerance(tolerance: float) -> float:
    """Return ``tolerance`` as a float.

    Raise ValueError unless it is a share of the value range, below 1.
    """
    require(is_number(tolerance) and 0 < tolerance < 1, "tolerance", _SHARE, tolerance)
    return float(tolerance)


def check_max_loss(max_loss: float | None) -> float | None:
    """Return ``max_loss``, after a check.

    Raise ValueError unless it is None or a share of the value range, below 1.
    """
    holds = max_loss is None or (is_number(max_loss) and 0 < max_loss < 1)
    require(holds, "max_loss", f"None or {_SHARE}", max_loss)
    return max_loss


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A learner's policy and counts so far, with a bound on the policy's loss.

    ``print(result)`` says them in words.

    Attributes
    ----------
    policy : (S,)
        The action in each state.
    status : Status
        Why the learner stopped, or what it waits for.
    asked : int
        Number of questions to the tutor, without audits.
    decided : dict of str to int
        Number of comparisons that each tier (kind of proof) decided, by the tier's name in lower
        case.
    comparator : Comparator
        The comparator with all answers that it learned.
    answers : Answers
        These answers.
    audits : tuple of Audit
        The decided comparisons that were put to the tutor all the same, with the answers.
    cannot_tell : int
        Number of questions that got no verdict.
    rounds : int
        Number of steps of Q-learning, of sweeps of value iteration, or of policies solved for.
    shares : (S, A, k) or function
        ``q``, or a function that computes it when it is first read.
    guarantee : function
        Computes the loss bound.
    mdp : OrdinalMDP
        The problem, by whose names of states and actions the policy is printed.
    member_guarantees : function
        Computes the loss bound of each member of a panel, by name; {} without a panel.
    tolerance, budget
        The tolerance and the budget of questions that the learner was given; None if it has none.
    """

    policy: NDArray[np.int64]
    status: Status
    asked: int
    decided: Mapping[str, int]
    comparator: Comparator
    answers: Answers
    audits: tuple[Audit, ...]
    cannot_tell: int
    rounds: int
    shares: Floats | Callable[[], Floats]
    guarantee: Callable[[], Guarantee]
    mdp: OrdinalMDP
    member_guarantees: Callable[[], Mapping[str, Guarantee]] = dict
    tolerance: float | None = None
    budget: int | None = None

    def __str__(self) -> str:
        """Return the status, the number of questions, the loss bound in words, and the policy.

        The policy is left out if the problem names neither states nor actions. Computing the bound
        may take long on a large model.
        """
        questions = (
            "1 question was asked" if self.asked == 1 else f"{self.asked:,} questions were asked"
        )
        if not self.asked and self.status is Status.CONVERGED:
            questions = "No question was asked: this policy was good enough before any answer"
            if len(self.answers):
                questions = "No question was asked: the answers known before were enough"
        parts = (
            self.status.sentence,
            f"{questions}.",
            self._loss_in_words(),
            self._policy_in_words(),
            self.tie_warning,
            self._members_in_words(),
            self.outlook,
        )
        return "\n".join(part for part in parts if part)

    def __repr__(self) -> str:
        parts = [f"status={self.status.name}", f"asked={self.asked}"]
        parts += [f"audited={self.audited}"] if self.audits else []
        parts += [f"cannot_tell={self.cannot_tell}"] if self.cannot_tell else []
        if "_guaranteed" in vars(
            self
        ):  # bounding the loss can take long, so it is printed only once somebody has read it
            parts += [f"loss_bound={self.loss_bound:.3g}", f"confidence={self.confidence:g}"]
        return f"Result({', '.join(parts)})"

    @cached_property
    def q(self) -> Floats:
        """Share vectors (S, A, k) of taking each action first, and then following the policy."""
        return self.shares() if callable(self.shares) else self.shares

    @cached_property
    def _guaranteed(self) -> Guarantee:
        return self.guarantee()

    @property
    def loss_bound(self) -> float:
        """Upper bound on the policy's loss at the worst state, as a share of the value range.

        The loss is (1 - discount) times the loss of return against the best policy, divided by the
        value of the best level minus that of the worst. The bound is computed from the MDP's
        transition probabilities, even if the learner only samples them. It is nan if there is no
        bound.
        """
        return float(self._guaranteed.loss_bound)

    @property
    def discount(self) -> float:
        """The MDP's discount."""
        return self.mdp.discount

    @property
    def return_loss_bound(self) -> float:
        """Upper bound on the policy's loss of return at the worst state.

        Its unit is the reward of the best level minus that of the worst. It is ``loss_bound / (1 -
        discount)``.
        """
        return self.loss_bound / (1 - self.discount)

    @property
    def confidence(self) -> float:
        """The probability that ``loss_bound`` holds.

        It is 1 if no scale that fits the answers allows a greater loss, given that the answers are
        right. For a posterior it is the comparator's level. It is nan if no probability can be
        stated.
        """
        return float(self._guaranteed.confidence)

    @cached_property
    def _of_members(self) -> Mapping[str, Guarantee]:
        return self.member_guarantees()

    @property
    def member_loss_bounds(self) -> dict[str, float]:
        """Upper bounds on the policy's loss to each member of a panel, by name.

        Each is under the member's own scale, at the worst state, as a share of the value range.
        Without a panel there are none.
        """
        return {name: float(found.loss_bound) for name, found in self._of_members.items()}

    def _members_in_words(self) -> str:
        if len(self._of_members) < 2:
            return ""
        said = ", ".join(
            f"{name} {_rounded_up(100 * bound)}%" for name, bound in self.member_loss_bounds.items()
        )
        return (
            "That is by the mean scale of all. By their own scale it loses each at most, of the "
            f"value range: {said}."
        )

    def _loss_in_words(self) -> str:
        if np.isnan(self.loss_bound):
            return "No bound on the policy's loss can be given."
        share = 0.0 if self.loss_bound == 0 else max(self.loss_bound, _LEAST_SHOWN)
        worst, best = self.mdp.labels[0], self.mdp.labels[-1]
        return (
            f"The policy loses at most {_rounded_up(100 * share)}% of the value range at the worst "
            f"state ({self._confidence_in_words()}).\n"
            f"That is as bad as a chance of {_rounded_up(100 * share)}%, at every step, of "
            f"{worst!r} in place of {best!r}. Or as "
            f"{_rounded_up(share / (1 - self.discount))} steps at {worst!r} right away, since "
            f"later steps count less, by the discount of {self.discount:g}."
        )

    def _policy_in_words(self) -> str:
        mdp = self.mdp
        if mdp.state_names is None and mdp.action_names is None:
            return ""
        choices = np.flatnonzero(~mdp.terminal & (mdp.admissible.sum(axis=1) > 1))
        if not len(choices):
            return ""
        taken = self.policy[choices]
        if len(choices) > _MOST_LISTED:
            actions, counts = np.unique(taken, return_counts=True)
            said = ", ".join(
                f"{mdp.action_name(int(a))} in {n:,}" for a, n in zip(actions, counts, strict=True)
            )
            return f"Of {len(choices):,} states with a choice, it takes {said}."
        said = "; ".join(
            f"{mdp.state_name(int(s))}: {mdp.action_name(int(a))}"
            for s, a in zip(choices, taken, strict=True)
        )
        return f"What it does in each state with a choice: {said}."

    def _confidence_in_words(self) -> str:
        if np.isnan(self.confidence):
            return "with unknown confidence"
        if self.confidence == 1:
            return f"proven, {assumed_of_answers(wrong_of(self.comparator), 'the')}"
        assumed = "on average over the values and tutors that the comparator assumes"
        if not len(self.answers):
            assumed = "over the values that the comparator takes for possible"
        return f"with probability {self.confidence:.4g}, {assumed}"

    @property
    def tie_warning(self) -> str:
        """A warning if many answers "equal" may make the bound unreliable, else "".

        A proven loss bound allows for a tutor who calls equal a difference of up to twice the
        comparator's ``tie``. The answers do not show whether the tutor calls larger differences
        equal. The posterior learns that, and may need several answers for it.
        """
        given = len(self.answers)
        equal = int(np.count_nonzero(self.answers.y == Verdict.EQUAL))
        if equal < _MANY_EQUAL or equal < _SHARE_OF_EQUAL * given:
            return ""
        said = f'{equal} of {given} answers say "equal".'
        if 0 < self.confidence < 1 and tie_of(self.comparator):
            return (
                f'{said} How far "equal" reaches is learned from these answers: while they are '
                "few, the bound may hold less often than stated."
            )
        widest = 2 * tie_of(self.comparator)
        meant = f"differ by at most {100 * widest:.3g}% of the value range"
        meant = meant if widest else "do not differ at all"
        return (
            f"{said} The bound counts on pairs called equal that {meant}: if the tutor means more, "
            "give the comparator a larger tie."
        )

    @property
    def outlook(self) -> str:
        """A sentence if the tutor errs too much for the tolerance to be reached, else "".

        It appears from 30 answers on. It needs a budget of questions (``max_queries``) and a
        comparator that learns the tutor's precision. The tolerance that it names as possible is a
        rough estimate. Only ``loss_bound`` is guaranteed.
        """
        ended = self.status in (Status.CONVERGED, Status.CERTIFIED, Status.BOUNDED)
        if self.tolerance is None or self.budget is None or ended:
            return ""
        if not out_of_reach(self.comparator, self.tolerance, self.budget):
            return ""
        had = tolerance_within_reach(self.comparator, self.budget)
        possible = f"about {100 * had:.2g}%" if had < _USELESS else "no useful bound"
        return (
            f"By the answers so far the tutor errs so often where two things are close (precision "
            f"{self.comparator.precision:.2g}) that {100 * self.tolerance:.3g}% "  # type: ignore[attr-defined]
            f"is out of reach within {self.budget:,} questions: {possible} can be had."
        )

    @property
    def audited(self) -> int:
        """The number of decided comparisons that were still put to the tutor, to find errors."""
        return len(self.audits)

    @property
    def compared(self) -> int:
        """The number of all comparisons, by proof or by the tutor."""
        return sum(self.decided.values())


def _rounded_up(x: float) -> str:
    """Return a number of at least 0 with three significant digits, rounded up."""
    if x == 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(x)) - 2)
    # a millionth of the last digit: 0.01 is not 0.0101
    return f"{math.ceil(x / unit - 1e-6) * unit:.3g}"


class Learner:
    """A solver of an MDP that stops when it needs the tutor: base class of all learners.

    What learners have in common is done by their ``Elicitation``.
    """

    needs: ClassVar[Needs] = Elicitation.needs | BOUNDING
    seed: Seed = 0  # a seed that gives the same run again
    _elicitation: Elicitation
    _bounded: tuple[Comparator, NDArray[np.int64]] | None = (
        None  # the policy and answers for which the loss was last bounded
    )

    def __repr__(self) -> str:
        now, known = self._elicitation, self.comparator
        counts = f"k={known.k}, asked={now.asked}, pending={len(now.pending)}, seed={self.seed}"
        return f"{type(self).__name__}({type(known).__name__}, {counts})"

    @one_thread
    def ask(self) -> tuple[Query, ...]:
        """Return the pending queries, or () when finished.

        The learner first runs as far as it can without the tutor. The queries stay the same until
        they are answered.

        Returns
        -------
        tuple of Query
        """
        self._act()
        return self._elicitation.ask() or self._go_on()

    @one_thread
    def tell(
        self, answers: Sequence[Answer], on_conflict: OnConflict = "raise"
    ) -> tuple[Answer, ...]:
        """Take answers to pending queries. Return those that were dropped.

        Parameters
        ----------
        answers : sequence of Answer
            Answers to pending queries.
        on_conflict : {"raise", "drop"}
            What happens to an answer that contradicts the others. "raise": InconsistentAnswers is
            raised. "drop": it decides its own pair only, and is returned.

        Returns
        -------
        tuple of Answer
            The answers that were dropped.

        Raises
        ------
        StaleAnswer
            For an answer to another query.
        InconsistentAnswers
            If an answer contradicts the others, unless ``on_conflict="drop"``.

        Notes
        -----
        If an error is raised, nothing has changed. If Ctrl+C interrupts it, either nothing has
        changed, or the answers were taken and ``ask`` goes on from them.
        """
        self._act()
        _, dropped = self._elicitation.tell(answers, on_conflict)
        self._act()
        return dropped

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]] | None) -> None:
        """Have the function ``signs`` answer from now on. Its answers are counted, not logged.

        Parameters
        ----------
        signs : callable or None
            Maps differences left - right (n, k) to verdicts (n,). None: ask the tutor again.
        """
        self._elicitation.signs = signs

    def watch(self, watcher: Watcher) -> None:
        """Call ``watcher(d, decisions)`` with batches of the comparisons that were acted on.

        For Q-learning these are comparisons that neither equality nor dominance decided. For policy
        iteration they are the questions answered.

        Parameters
        ----------
        watcher : callable
            Takes differences d (n, k) and their ``Decisions``: verdicts (n,) and tiers (n,). Its
            result is ignored.
        """
        self._elicitation.watch = watcher

    @property
    def implied(self) -> dict[str, Verdict]:
        """The verdicts that the answers so far imply for pending audits, by query id."""
        return {p.query.id: p.expected for p in self._elicitation.pending if p.expected is not None}

    @property
    def comparator(self) -> Comparator:
        """The comparator with all answers learned so far."""
        return self._elicitation.comparator

    def result(self) -> Result:
        """Return the policy and the counts so far. It may be called at any time.

        Returns
        -------
        Result
        """
        raise NotImplementedError

    def _go_on(self) -> tuple[Query, ...]:
        """Run on, and return the next queries, or () at the end."""
        raise NotImplementedError

    def _act(self) -> None:
        """Act on the answers. After an interruption, act on all of them again."""
        if self._elicitation.to_act_on:
            self._take(self._elicitation.to_act_on)
            self._elicitation.to_act_on = ()

    def _take(self, told: Sequence[AnsweredQuery]) -> None:
        """Act on the verdicts. Doing it twice must have the same effect as once."""

    def _certified(
        self, mdp: OrdinalMDP, policy: NDArray[np.int64], max_loss: float | None
    ) -> bool:
        """Return whether the policy (S,) certainly loses at most ``max_loss``.

        The same policy with the same answers is not tried twice in a row: then the result is False.
        """
        comparator, last = self.comparator, self._bounded
        if max_loss is None or (
            last is not None and last[0] is comparator and (last[1] == policy).all()
        ):
            return False
        self._bounded = comparator, policy.copy()
        return loses_at_most(mdp, policy, comparator, max_loss)

    def _result(
        self,
        mdp: OrdinalMDP,
        policy: NDArray[np.int64],
        shares: Floats | Callable[[], Floats],
        status: Status | None,
        rounds: int,
        *,
        more: NDArray[np.int64] | int = 0,
        guarantee: Callable[[], Guarantee] | None = None,
        tolerance: float | None = None,
    ) -> Result:
        """Return the Result of this policy, an array that must not change afterwards.

        ``more`` (len(Tier),) are comparisons in addition to those that the elicitation counted.
        Without a status the learner waits for the tutor.
        """
        elicitation = self._elicitation
        return Result(
            policy=policy,
            shares=shares,
            status=status or Status.WAITING,
            asked=elicitation.asked,
            decided={
                tier.name.lower(): int(n)
                for tier, n in zip(Tier, elicitation.counts + more, strict=True)
            },
            comparator=elicitation.comparator,
            answers=elicitation.answers,
            audits=tuple(elicitation.audits),
            cannot_tell=elicitation.cannot_tell,
            rounds=rounds,
            guarantee=guarantee or partial(loss_bound, mdp, policy.copy(), elicitation.comparator),
            mdp=mdp,
            member_guarantees=partial(_of_members, mdp, policy.copy(), elicitation.comparator),
            tolerance=tolerance,
            budget=elicitation.max_queries,
        )


def _of_members(
    mdp: OrdinalMDP, policy: NDArray[np.int64], comparator: Comparator
) -> dict[str, Guarantee]:
    """Return a policy's guarantee for each member of a panel, by name."""
    if not isinstance(comparator, Panel):
        return {}
    return {name: loss_bound(mdp, policy, member) for name, member in comparator.members.items()}
