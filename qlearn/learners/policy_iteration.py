"""Interactive policy iteration: solve for one scale, and ask what could still change the policy."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import partial
from math import comb
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import product
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.threads import one_thread
from elicit._support.validation import require
from elicit.asking.bags import Bags
from elicit.asking.confirming import confirming_question
from elicit.asking.cuts import CUTTING, closing_cut, closing_cut_of_one
from elicit.asking.elicitation import Elicitation
from elicit.asking.magnified import AS_THEY_ARE, MAGNIFIED, Shown, magnified, multiples
from elicit.asking.options import AskingOptions, check_options, filled
from elicit.asking.question import Pair
from elicit.comparators.panel import Panel
from elicit.decision.verdicts import decide
from elicit.model.comparator import Comparator, Tier, Tiers, offers
from elicit.model.comparator_parts import (
    bounds_above,
    people_of,
    simultaneous_bounds,
    trusted_share,
    unordered_of,
    wrong_of,
)
from elicit.model.difference import tail_sums
from elicit.model.needs import Needs, check_needs
from elicit.model.outcomes import Status
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats
from qlearn.certificates.advantages import Advantages
from qlearn.certificates.loss_bound import Guarantee, completed, drawn_set, draws_of
from qlearn.learners.learner import (
    Learner,
    Result,
    check_max_loss,
    check_problem,
    check_tolerance,
    pair_of,
    place,
)
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    simple_pair,
    strategy_of,
    telling_violation,
    worth_asking,
)
from qlearn.learners.rounds.exact import ExactRounds
from qlearn.learners.rounds.sampled import SampledRounds
from qlearn.learners.rounds.tuning import TUNING
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP

LARGE = 4000  # states up to which rounds are exact by default
LEFT_OUT = "Not their outcomes: what both have in common is left out, and the rest is magnified."


class InteractivePolicyIteration(Learner):
    """A learner that proves a policy with few questions.

    It solves the MDP for the comparator's central scale, and bounds what that policy can lose under
    every plausible scale (``loss_bound``). While the bound exceeds the tolerance, it asks about an
    advantage Q(s, a) - V(s) that could still change the policy, and solves again. The bound holds
    for every scale in K_t with a polytope, and with the comparator's confidence otherwise.

    Parameters
    ----------
    mdp : OrdinalMDP
    comparator : Comparator
        What is known of the scale so far. Its number of levels must be the MDP's.
    tolerance : float
        Stop once the policy loses at most this share of the value range, below 1, at every state.
    max_loss : float, optional
        Stop at this bound already, even if it exceeds the tolerance. The status then is CERTIFIED.
    strategy : function of ``qlearn.strategies``, or its name
        Picks the question. The default weighs what an answer tells by how likely it is to matter.
    bags : elicit.Bags, "magnified" or "as they are", optional
        The form of the questions. "as they are": the futures of two actions at a state.
        "magnified": the difference of these futures, times the greatest power of two that two bags
        have room for. The right answer is the same, and tutors who err where little is at stake
        give it more often (docs/contest.md). A ``Bags``: simple bags ("of 10 days ..."), one
        question at a time, as far as they tell enough. Default: "magnified" for a comparator that
        predicts answers, "as they are" for others.
    cuts : bool, optional
        Once most plausible scales agree on the policy, also ask about two mixtures of levels that
        are made to close several advantages at once (``elicit.asking.cuts``), if that promises
        twice as much as the strategy's own question. It needs proven bounds, one question at a
        time, no bags, and a tutor who calls no pair equal and can tell all. Default: used whenever
        these conditions hold. ``True`` raises an error if they cannot hold.
    exact : bool, optional
        True: every round solves the MDP and looks at all states. False: a round only improves the
        last solution, and looks at a sample of states, as long as the sample shows that the
        tolerance is not reached. Then all advantages are bounded. The bound allows for the inexact
        solution. Default: True up to ``LARGE`` states. If the comparator leaves the order of two
        levels open, rounds are always exact. With False, ``Result.decided`` counts the alternatives
        that were looked at, and at the end all of them.
    **asking
        The options of ``elicit.AskingOptions``. The seed picks audits and samples of states. An
        advantage is not asked about if no plausible scale puts it above ``indifference``. The
        default is tolerance (1 - discount). With more, the tolerance may be out of reach. Audits
        are of pairs that the finished policy depends on.

    Raises
    ------
    TypeError
        If a keyword is unknown.
    ValueError
        If a setting makes no sense, or ``cuts=True`` is given and no cut could be asked about.
    """

    needs = Learner.needs | Needs(
        used=(*CUTTING.required, *CUTTING.used, "lapse", "probability"), open_order=True
    )

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        tolerance: float = 0.001,
        max_loss: float | None = None,
        strategy: Strategy | str = telling_violation,
        bags: Bags | Shown | None = None,
        cuts: bool | None = None,
        exact: bool | None = None,
        **asking: Unpack[AskingOptions],
    ) -> None:
        check_options(self, asking)
        check_problem(mdp, comparator)
        self.seed = asking["seed"] = seed_of(asking.get("seed", 0))
        self._mdp = mdp
        self._tolerance = check_tolerance(tolerance)
        self._enough = max(tolerance, check_max_loss(max_loss) or 0.0)
        require(
            bags in (None, MAGNIFIED, AS_THEY_ARE) or isinstance(bags, Bags),
            "bags",
            f"None, {MAGNIFIED!r}, {AS_THEY_ARE!r} or an elicit.Bags, such as Bags(days=10)",
            bags,
        )
        if bags is None and offers(comparator, "probability"):
            bags = MAGNIFIED
        self._magnify = bags == MAGNIFIED
        bags = bags if isinstance(bags, Bags) else None
        self._strategy = strategy_of(strategy)
        check_needs(comparator, type(self), self._strategy)
        self._bags = bags
        indifference = self._enough * (1 - mdp.discount)
        self._labels = asking.get("labels") or mdp.labels
        asking = filled(asking, {"indifference": indifference, "labels": self._labels})
        batch = asking.get("batch", 1)
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/policy-iteration/{tolerance!r}",
            **asking,
        )
        require(exact is None or isinstance(exact, bool), "exact", "None, True or False", exact)
        require(cuts is None or isinstance(cuts, bool), "cuts", "None, True or False", cuts)
        small = mdp.n_states <= LARGE if exact is None else exact
        if unordered_of(comparator) is not None:
            require(
                exact is not False,
                "exact",
                f"None or True with {type(comparator).__name__}, whose order is open",
                exact,
            )
            small = True
        self._rounds = (
            ExactRounds(mdp, self._enough) if small else SampledRounds(mdp, self._enough, self.seed)
        )
        if cuts:
            _check_cuts(comparator, bags, batch)
        self._cuts = cuts is not False and bags is None and batch == 1
        self._end: Status | None = None
        self._found: tuple[Comparator, Advantages, Guarantee] | None = None
        self._seen_between: (
            tuple[Comparator, ExactRounds | SampledRounds, Advantages, Guarantee] | None
        ) = None

    def _go_on(self) -> tuple[Query, ...]:
        """Return the next questions, or none at the end. ``Learner.ask`` calls it."""
        if self._end is not None:
            return ()
        for look in (self._round, self._look_further):
            advantages, found = look()
            if found.loss_bound <= self._enough:
                return self._audit(advantages, found)
            if self._elicitation.spent:
                self._end = Status.GUESSED
                return ()
            if len(rows := self._open_pairs(advantages)):
                break
        else:
            if mixtures := self._mixtures(advantages):
                return self._elicitation.open([mixtures])
            self._end = Status.CALLED_EQUAL if self._elicitation.called_equal else Status.EXHAUSTED
            return ()
        candidates = self._candidates(advantages, rows)
        chosen = best(self._strategy, candidates, len(rows))
        if self._cuts:
            pair = self._cut(advantages, rows, candidates, candidates.d[chosen[0]])
            if pair is not None:
                return self._elicitation.open([pair])
        order = rows[chosen]
        if self._bags is not None:
            about = advantages.d[order[: TUNING.signs]]
            if simple := simple_pair(
                self._elicitation, self._bags, candidates, about, self._labels
            ):
                return self._elicitation.open([simple])
        return self._open(advantages, order[self._elicitation.next_batch(advantages.d[order])])

    @one_thread
    def result(self) -> Result:
        """Return the policy for the central scale, its loss bound, and the counts so far.

        Asking for a result changes no later question.

        Returns
        -------
        Result
            Its ``decided`` counts the alternatives to the current policy by the tier that decided
            them, and the questions.
        """
        rounds, advantages, found = self._present()
        comparator = self._elicitation.comparator
        in_full = partial(completed, found, self._mdp, advantages, comparator)
        looked_at = advantages if self._end is None else rounds.everything()
        by_tier = np.bincount(self._deciding_tiers(looked_at), minlength=len(Tier))
        by_tier[Tier.SCREEN] += 0 if self._end is None else rounds.left_out
        shares = partial(q_of, np.arange(self._mdp.n_states), advantages.v, model_of(self._mdp))
        policy = advantages.policy.copy()
        return self._result(
            self._mdp,
            policy,
            shares,
            self._end,
            rounds.rounds,
            more=by_tier,
            guarantee=in_full,
            tolerance=self._enough,
        )

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]] | None) -> None:
        """Do nothing. This learner asks and logs every question, whatever the comparator.

        Parameters
        ----------
        signs : callable or None
            Ignored.
        """

    def _present(self) -> tuple[ExactRounds | SampledRounds, Advantages, Guarantee]:
        """Return the rounds, advantages and guarantee for what is known now.

        If only some of several pending questions are answered, the comparator is one that ``ask``
        will never use. A round with it would change the learner's next questions, so it is made on
        a copy.
        """
        comparator = self._elicitation.comparator
        if not self._elicitation.pending or (
            self._found is not None and self._found[0] is comparator
        ):
            return self._rounds, *self._round()
        if self._seen_between is None or self._seen_between[0] is not comparator:
            rounds = copy(
                self._rounds
            )  # a round puts new arrays in the place of old ones, and writes into none
            self._seen_between = comparator, rounds, *rounds.round(comparator)
        return self._seen_between[1:]

    def _round(self) -> tuple[Advantages, Guarantee]:
        """Return the advantages over the current policy, and its loss bound.

        The bound is inf if it exceeds the tolerance, so that the learner has to go on.
        """
        comparator = self._elicitation.comparator
        if self._found is None or self._found[0] is not comparator:
            self._found = comparator, *self._rounds.round(comparator)
        return self._found[1:]

    def _look_further(self) -> tuple[Advantages, Guarantee]:
        """Return the result of ``_round`` after looking at more states.

        This is needed if nothing seen so far may be asked about.
        """
        comparator = self._elicitation.comparator
        self._found = comparator, *self._rounds.look_further(comparator)
        return self._found[1:]

    def _open_pairs(self, advantages: Advantages) -> NDArray[np.int64]:
        """Return rows of the advantages that could still change the policy and may be asked about.

        These exceed the limit under some plausible scale. If there are none and scales are drawn,
        all draws count as plausible, also those that the comparator leaves out.
        """
        comparator, places = self._elicitation.comparator, partial(self._place, advantages)
        limit = self._elicitation.indifference
        rows = worth_asking(self._elicitation, advantages.d, places, limit)
        if self._elicitation.called_equal:
            # loss bounds allow for wider ties than verdicts: pairs between the two must not be
            # asked about
            rows = rows[decide(comparator, advantages.d[rows]).verdicts == Verdict.UNKNOWN]
        if not len(rows) and drawn_set(comparator) is not None:
            least = limit if self._elicitation.gave_up else 0.0
            rows = np.flatnonzero(
                (product(tail_sums(advantages.d), draws_of(comparator).gaps) > least).any(axis=1)
            )
            rows = rows[self._elicitation.may_ask(advantages.d[rows], lambda i: places(rows[i]))]
        if self._magnify:  # the multiple was asked, and a multiple counts as another pair
            asked = advantages.d[rows] * np.reshape(self._times(advantages, rows), (-1, 1))
            rows = rows[self._elicitation.may_ask(asked, lambda i: places(rows[i]))]
        return rows

    def _candidates(self, advantages: Advantages, rows: NDArray[np.int64]) -> Candidates:
        return Candidates(
            advantages.d[rows],
            advantages.states[rows],
            advantages.actions[rows],
            TUNING.matters * self._enough,
            self._elicitation.comparator,
            self._times(advantages, rows),
        )

    def _mixtures(self, advantages: Advantages) -> Pair | None:
        """Return a question about a level and a mixture of two other levels, or None.

        Such questions are for a tutor who may have erred, once every pair of actions that matters
        was asked about: asking the same pair again might give the same error. The result is None if
        none of them tells anything about the signs of the open advantages, or if the setting is to
        ask about pairs as they are.
        """
        elicitation, k = self._elicitation, self._mdp.k
        if not self._magnify or drawn_set(elicitation.comparator) is None or elicitation.gave_up:
            return None
        high = simultaneous_bounds(elicitation.comparator, advantages.d)[0]
        rows = np.flatnonzero(high > elicitation.indifference)
        if not len(rows) or k < 3:
            return None
        candidates = self._candidates(advantages, rows)
        about = candidates.d[best(self._strategy, candidates, TUNING.signs)]
        few = (days for days in TUNING.days if comb(k, 3) * (days - 1) <= TUNING.mixtures)
        days = next(few, TUNING.days[-1])
        return simple_pair(elicitation, Bags(days), candidates, about, self._labels)

    def _cut(
        self,
        advantages: Advantages,
        rows: NDArray[np.int64],
        candidates: Candidates,
        instead: Floats,
    ) -> Pair | None:
        """Return a cut: a question that closes more of the advantages than ``instead`` (k,) would.

        The result is None if there is none, or no cut may be asked.
        """
        elicitation, scores = self._elicitation, candidates.scores
        plain = not (
            elicitation.unsure or elicitation.cannot_tell or (elicitation.answers.y == 0).any()
        )
        known = elicitation.comparator
        proven = not CUTTING.missing(known) and drawn_set(known) is None
        several = len(people_of(known)) > 1
        if not (plain and proven) or (several and not isinstance(known, Panel)):
            return None
        undecided = product((scores > candidates.limit).any(axis=0), candidates.weights)
        wrong = wrong_of(known)
        if undecided > (TUNING.confirming if wrong else TUNING.undecided):
            return None
        high = bounds_above(known, advantages.d, elicitation.indifference)[0][rows]
        most = np.argsort(-high, kind="stable")[: TUNING.closed]
        limit = TUNING.close * self._enough
        cut: Floats | None
        who: str | None
        d, who = candidates.d[most], None
        if several and isinstance(known, Panel):
            of_one = closing_cut_of_one(known, d, high[most], limit)
            who, cut = (None, None) if of_one is None else of_one
        elif wrong:
            found = confirming_question(known, d, limit)
            if found.row >= 0:
                return self._pair(advantages, int(rows[most[found.row]]))
            cut = found.d
        else:
            cut = closing_cut(known, candidates.draws, d, high[most], limit, instead)
        if cut is None:
            return None
        left, right = np.maximum(cut, 0.0), np.maximum(-cut, 0.0)
        pair = Pair(left, right, "two mixtures of levels: left or right?", who=who)
        return pair if elicitation.may_ask(cut[None], lambda _: pair.place).all() else None

    def _deciding_tiers(self, advantages: Advantages) -> NDArray[np.int8]:
        """Return the tier (n,) by which each of the policy's alternatives was found no better.

        Undecided alternatives are left out, unless the question budget is spent.
        """
        verdicts, tiers = decide(self._elicitation.comparator, advantages.d)
        rows = np.flatnonzero(verdicts == Verdict.UNKNOWN)
        high = simultaneous_bounds(self._elicitation.comparator, advantages.d[rows])[0]
        tiers[rows] = np.where(high <= self._elicitation.indifference, Tier.INDIFFERENT, Tier.GUESS)
        return np.asarray(
            tiers[(tiers != Tier.GUESS) | (self._end is Status.GUESSED)], dtype=np.int8
        )

    def _audit(self, advantages: Advantages, found: Guarantee) -> tuple[Query, ...]:
        """Return queries that audit some pairs that the proof depends on, or () at the end.

        If no pair is to be audited, the run ends, with the status that ``found`` allows.
        """
        if self._elicitation.asking_state().audit:
            advantages = self._rounds.some_of(advantages)
            decisions = self._elicitation.decide(advantages.d, partial(self._place, advantages))
            rows = np.flatnonzero(
                (decisions.verdicts == Verdict.UNKNOWN) & (decisions.tiers != Tier.TUTOR)
            )
        else:
            rows = np.empty(0, np.int64)
        if len(rows):
            some = self._elicitation.next_batch(advantages.d[rows])[: self._elicitation.audits_left]
            return self._open(advantages, rows[some], decisions.tiers)
        within = Status.CONVERGED if found.loss_bound <= self._tolerance else Status.CERTIFIED
        self._end = Status.BOUNDED if np.isnan(found.confidence) else within
        return ()

    def _open(
        self, advantages: Advantages, rows: NDArray[np.int64], tiers: Tiers | None = None
    ) -> tuple[Query, ...]:
        """Ask about these rows of the advantages.

        For audits, ``tiers`` (n,) are the tiers that had decided the advantages.
        """
        return self._elicitation.open(
            [
                self._pair(advantages, row, Tier.TUTOR if tiers is None else tiers[row])
                for row in rows
            ]
        )

    def _pair(self, advantages: Advantages, row: int, tier: int = Tier.TUTOR) -> Pair:
        """Return the question about an alternative action and the policy's, for a row."""
        s, a = int(advantages.states[row]), int(advantages.actions[row])
        left = q_of(np.array([s]), advantages.v, model_of(self._mdp))[0, a]
        pair = pair_of(self._mdp, left, advantages.v[s], s, a, int(advantages.policy[s]), int(tier))
        if not self._magnify:
            return pair
        named = self._place(advantages, row)
        return magnified(pair._replace(about=named[0], place=named))

    def _times(self, advantages: Advantages, rows: NDArray[np.int64]) -> Floats | float:
        """Return the factor by which each row's difference is multiplied in a question."""
        if not self._magnify:
            return 1.0
        values = advantages.v[advantages.states[rows]]
        return multiples(values + advantages.d[rows], values)

    def _place(self, advantages: Advantages, row: int) -> tuple[str, str, tuple[int, int, int]]:
        state = int(advantages.states[row])
        one, mirrored, numbers = place(
            self._mdp, state, int(advantages.actions[row]), int(advantages.policy[state])
        )
        if self._magnify:
            one, mirrored = f"{one} {LEFT_OUT}", f"{mirrored} {LEFT_OUT}"
        return one, mirrored, numbers


def _check_cuts(comparator: Comparator, bags: Bags | None, batch: int) -> None:
    """Raise ValueError if ``cuts=True`` was given, but no cut could be asked."""
    advice = "leave cuts out, or say cuts=False, to ask about pairs only"
    if bags is not None:
        raise ValueError(
            f"cuts=True asks about other questions than bags={bags!r} does: leave bags out, or "
            f"{advice}"
        )
    if batch != 1:
        raise ValueError(
            f"cuts=True asks one question at a time, but batch is {batch}: set batch=1, or {advice}"
        )
    if trusted_share(comparator) is not None or CUTTING.missing(comparator):
        raise ValueError(
            "cuts=True needs bounds that are proven of every plausible scale, and draws of such "
            "scales, which "
            f"{type(comparator).__name__} does not have: take elicit.PolytopeComparator, or "
            f"{advice}"
        )
