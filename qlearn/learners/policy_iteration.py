"""Certify first: solve for one central scale, then ask only about what could still change the policy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elicit._support.fixed_order import principal_axes, product
from elicit._support.hashing import Seed, key_of
from elicit._support.seeds import seed_of, takes_rng
from elicit._support.threads import one_thread
from elicit._support.validation import require
from elicit.asking.bags import Bags
from elicit.asking.cuts import closing_cut
from elicit.asking.elicitation import MAX_AUDITS, Elicitation, Known, Pair, Place
from elicit.decision.verdicts import decide
from elicit.decision.votes import LEVEL_ROUNDING
from elicit.model.comparator import (
    BoundsAllAtOnce,
    Comparator,
    HasDraws,
    Tier,
    Tiers,
    best_guess,
    draws_in,
    simultaneous_bounds,
    trusted_share,
)
from elicit.model.outcomes import Status
from elicit.model.query import Query, Verdict
from elicit.model.scale import Floats, order_bounds, tail_sums
from qlearn.learners.learner import (
    Learner,
    Result,
    check_max_loss,
    check_problem,
    check_tolerance,
    pair_of,
    place,
)
from qlearn.learners.loss_bound import Advantages, Guarantee, advantages, collected, drawn_set, guarantee, most_of
from qlearn.learners.query_strategies import (
    Candidates,
    Strategy,
    best,
    draws_of,
    simple_pair,
    strategy_of,
    telling_violation,
    worth_asking,
)
from qlearn.mdp.backup import model_of, q_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import backed_up, optimal_policy, rewarded
from qlearn.mdp.warm_planning import nearly_optimal, nearly_valued

_TIE = 1e-13
_ABOUT = 12  # advantages, the best to ask about, whose signs a simple question should tell
LARGE = 4000  # states up to which rounds are exact, unless told otherwise
_SAMPLE = 1000  # states looked at for questions
_POOL = 4000  # advantages, those of the greatest bounds, that questions may be about
_QUESTIONS, _MORE = 4, 8  # a solution; where that takes longer
_LONGER = 30_000  # states
_BLOCK = 1 << 14  # advantages whose bounds are in the making at once
_SHARE = 0.02  # of the tolerance: what V's error and the bound's may come to
_UNDECIDED = 0.5  # of the weight of scales, at most, that see a better action, where cuts are asked about
_CLOSED = 200  # advantages, those of the greatest bounds, that a cut is to close
_CLOSE = 0.3  # of the tolerance: what it is to bring them down to
_MATTERS = 0.5
"""Of the tolerance: what an advantage must exceed to count for a strategy. In one state, taken once, it costs as much;
with the least advantage that could ever matter, tolerance (1 - discount), a fifth more questions were asked."""


class InteractivePolicyIteration(Learner):
    """Solves the MDP for the comparator's central scale, bounds what the policy can lose under every plausible scale
    (``loss_bound``), and stops once that is within ``tolerance``, a share of the value range (below 1) at every state:
    for every scale in K_t with a polytope, with the comparator's confidence otherwise. Until then it asks about an
    advantage Q(s, a) - V(s) that could still change the policy, takes in the answer, and solves again.

    ``strategy`` picks the question (a function of ``qlearn.strategies``, or its name); the default weighs what an
    answer tells by how likely it is to matter. ``bags``: ask about simple bags instead, "of 10 days ...", as far as
    they tell enough of the signs of the advantages in question (``elicit.Bags``), one at a time. ``cuts``: once most of
    what is plausible agrees on the policy, ask also about two mixtures of levels made to close several advantages at
    once (``elicit.asking.cuts``; default: with the default strategy). That is where bounds are proven, without bags,
    one question at a time, and as long as the tutor calls no pair equal and can tell all; ``cuts=True`` raises
    ValueError with bags, with several questions at a time, and with a comparator whose bounds are not proven.
    ``indifference`` (default tolerance (1 - discount)): an advantage that no plausible scale puts above it is not asked
    about; above the default, the tolerance may be out of reach. ``max_loss``: stop there even if the tolerance is
    smaller, with the status CERTIFIED where the bound is not within the tolerance too. ``max_queries``: beyond it the
    policy for the central scale stands, with what can be said of its loss. ``audit``: share of the pairs decided by
    answers, among those that the finished policy rests on, that is put to the tutor all the same; ``seed`` picks them.
    ``batch``: the best so many questions at once.

    ``exact``: whether every round solves linear systems in all states and bounds all advantages, which is for models of
    up to some thousands of states. Else it solves nearly, from the last solution, which the bound allows for; asks
    about a sample of states, a few questions a solution, as long as some scale shows there that the tolerance is not
    met; and only then bounds all. By default that goes by the number of states, ``LARGE``. (``Result.decided`` then
    counts all alternatives at the end; before, those looked at.)
    """

    @takes_rng
    def __init__(
        self,
        mdp: OrdinalMDP,
        comparator: Comparator,
        *,
        tolerance: float = 0.001,
        max_loss: float | None = None,
        strategy: Strategy | str = telling_violation,
        bags: Bags | None = None,
        cuts: bool | None = None,
        seed: Seed | None = 0,
        max_queries: int | None = None,
        indifference: float | None = None,
        audit: float = 0.0,
        max_audits: int = MAX_AUDITS,
        batch: int = 1,
        known: Known = (),
        exact: bool | None = None,
    ) -> None:
        check_problem(mdp, comparator)
        self.seed = seed_of(seed)
        self._mdp, self._tolerance = mdp, check_tolerance(tolerance)
        self._enough = max(tolerance, check_max_loss(max_loss) or 0.0)
        require(bags is None or isinstance(bags, Bags), "bags", "None or an elicit.Bags, such as Bags(days=10)", bags)
        self._strategy, self._bags = strategy_of(strategy), bags
        self._elicitation = Elicitation(
            comparator,
            f"{mdp.fingerprint}/policy-iteration/{tolerance!r}",
            indifference=self._enough * (1 - mdp.discount) if indifference is None else indifference,
            max_queries=max_queries,
            audit=audit,
            max_audits=max_audits,
            batch=batch,
            known=known,
            seed=self.seed,
            labels=mdp.labels,
        )
        require(exact is None or isinstance(exact, bool), "exact", "None, True or False", exact)
        require(cuts is None or isinstance(cuts, bool), "cuts", "None, True or False", cuts)
        small = mdp.n_states <= LARGE if exact is None else exact
        self._solver = _Exactly(mdp, self._enough) if small else _Nearly(mdp, self._enough, self.seed)
        if cuts:
            _check_cuts(comparator, bags, batch)
        wanted = self._strategy is telling_violation if cuts is None else cuts
        self._cuts = wanted and bags is None and batch == 1
        self._end: Status | None = None
        self._found: tuple[Comparator, Advantages, Guarantee] | None = None

    def _go_on(self) -> tuple[Query, ...]:
        if self._end is not None:
            return ()
        for look in (self._round, self._look_further):
            over, found = look()
            if found.loss_bound <= self._enough:
                return self._audit(over, found)
            if self._elicitation.spent:
                self._end = Status.GUESSED
                return ()
            if len(rows := self._open_pairs(over)):
                break
        else:
            self._end = Status.CALLED_EQUAL if self._elicitation.called_equal else Status.EXHAUSTED
            return ()
        candidates = Candidates(
            over.d[rows], over.states[rows], over.actions[rows], _MATTERS * self._enough, self._elicitation.comparator
        )
        if self._cuts and (pair := self._cut(over, rows, candidates)) is not None:
            return self._elicitation.open([pair])
        order = rows[best(self._strategy, candidates, len(rows))]
        if self._bags is not None:
            about = over.d[order[:_ABOUT]]
            if simple := simple_pair(self._elicitation, self._bags, candidates, about, self._mdp.labels):
                return self._elicitation.open([simple])
        return self._open(over, order[self._elicitation.next_batch(over.d[order])])

    @one_thread
    def result(self) -> Result:
        """The policy for the central scale, what it can lose, and the counts so far. ``decided`` counts the present
        policy's alternatives by what settled them, and the questions."""
        over, found = self._round()
        comparator = self._elicitation.comparator
        in_full = partial(_in_full, found, self._mdp, over, comparator)
        looked_at = over if self._end is None else self._solver.everything()
        settled = np.bincount(self._settled_by(looked_at), minlength=len(Tier))
        shares = partial(q_of, np.arange(self._mdp.n_states), over.v, model_of(self._mdp))
        policy = over.policy.copy()
        return self._result(self._mdp, policy, shares, self._end, self._solver.rounds, more=settled, guarantee=in_full)

    def consult(self, signs: Callable[[Floats], NDArray[np.int8]] | None) -> None:
        """Has no effect: each question is asked and logged, also by a comparator that never learns."""

    def _round(self) -> tuple[Advantages, Guarantee]:
        """The policy for the central scale, and the bound on its loss, which is only right about being enough."""
        comparator = self._elicitation.comparator
        if self._found is None or self._found[0] is not comparator:
            self._found = comparator, *self._solver.round(comparator)
        return self._found[1:]

    def _look_further(self) -> tuple[Advantages, Guarantee]:
        """The same where none of what was looked at may be asked about."""
        comparator = self._elicitation.comparator
        self._found = comparator, *self._solver.look_further(comparator)
        return self._found[1:]

    def _open_pairs(self, over: Advantages) -> NDArray[np.int64]:
        """Rows of the advantages that could still change the policy and may be asked about: those that some plausible
        scale puts above the limit; of drawn scales, where no draw is left out, if there are none else."""
        comparator, places = self._elicitation.comparator, partial(self._place, over)
        limit = self._elicitation.indifference
        rows = worth_asking(self._elicitation, over.d, places, limit)
        if (
            self._elicitation.called_equal
        ):  # guarantees allow for wider ties than verdicts, which must not be asked about
            rows = rows[decide(comparator, over.d[rows]).verdicts == Verdict.UNKNOWN]
        if not len(rows) and drawn_set(comparator) is not None:
            least = limit if self._elicitation.gave_up else 0.0
            rows = np.flatnonzero((product(tail_sums(over.d), draws_of(comparator).gaps) > least).any(axis=1))
            rows = rows[self._elicitation.may_ask(over.d[rows], lambda i: places(rows[i]))]
        return rows

    def _cut(self, over: Advantages, rows: NDArray[np.int64], candidates: Candidates) -> Pair | None:
        """What closes most of the advantages in these rows, in a proof; None where that is not what is wanted."""
        elicitation, scores = self._elicitation, candidates.scores
        plain = not (elicitation.unsure or elicitation.cannot_tell or (elicitation.answers.y == 0).any())
        known = elicitation.comparator
        proven = isinstance(known, BoundsAllAtOnce) and isinstance(known, HasDraws) and drawn_set(known) is None
        if not (plain and proven) or product((scores > candidates.limit).any(axis=0), candidates.weights) > _UNDECIDED:
            return None
        high = simultaneous_bounds(known, candidates.d)[0]
        most = np.argsort(-high, kind="stable")[:_CLOSED]
        found = closing_cut(known, candidates.draws, candidates.d[most], high[most], _CLOSE * self._enough)
        if found.row >= 0:
            return self._pair(over, int(rows[most[found.row]]))
        left, right = np.maximum(found.d, 0.0), np.maximum(-found.d, 0.0)
        pair = Pair(left, right, "two mixtures of levels: left or right?")
        return pair if elicitation.may_ask(found.d[None], lambda _: pair.place).all() else None

    def _settled_by(self, over: Advantages) -> NDArray[np.int8]:
        """The tiers (n,) by which the policy's alternatives are no better; those still open are left out, but for a
        budget that is spent."""
        verdicts, tiers = decide(self._elicitation.comparator, over.d)
        rows = np.flatnonzero(verdicts == Verdict.UNKNOWN)
        high = simultaneous_bounds(self._elicitation.comparator, over.d[rows])[0]
        tiers[rows] = np.where(high <= self._elicitation.indifference, Tier.INDIFFERENT, Tier.GUESS)
        return np.asarray(tiers[(tiers != Tier.GUESS) | (self._end is Status.GUESSED)], dtype=np.int8)

    def _audit(self, over: Advantages, found: Guarantee) -> tuple[Query, ...]:
        """The certificate stands: audit some of what it rests on."""
        if self._elicitation.rule().audit:
            over = self._solver.some_of(over)
            judged = self._elicitation.judge(over.d, partial(self._place, over))
            rows = np.flatnonzero((judged.verdicts == Verdict.UNKNOWN) & (judged.tiers != Tier.TUTOR))
        else:
            rows = np.empty(0, np.int64)
        if len(rows):
            some = self._elicitation.next_batch(over.d[rows])[: self._elicitation.audits_left]
            return self._open(over, rows[some], judged.tiers)
        within = Status.CONVERGED if found.loss_bound <= self._tolerance else Status.CERTIFIED
        self._end = Status.BOUNDED if np.isnan(found.confidence) else within
        return ()

    def _open(self, over: Advantages, rows: NDArray[np.int64], tiers: Tiers | None = None) -> tuple[Query, ...]:
        """Ask about these rows; of an audit with the tiers (n,) that settled all rows."""
        return self._elicitation.open(
            [self._pair(over, row, Tier.TUTOR if tiers is None else tiers[row]) for row in rows]
        )

    def _pair(self, over: Advantages, row: int, tier: int = Tier.TUTOR) -> Pair:
        """An action's vector and the policy's, at the state of this row."""
        s, a = int(over.states[row]), int(over.actions[row])
        left = q_of(np.array([s]), over.v, model_of(self._mdp))[0, a]
        return pair_of(self._mdp, left, over.v[s], s, a, int(over.policy[s]), int(tier))

    def _place(self, over: Advantages, row: int) -> Place:
        state = int(over.states[row])
        return place(self._mdp, state, int(over.actions[row]), int(over.policy[state]))


def _check_cuts(comparator: Comparator, bags: Bags | None, batch: int) -> None:
    """Raise ValueError where no cut could be asked about, though it was wanted."""
    advice = "leave cuts out, or say cuts=False, to ask about pairs only"
    if bags is not None:
        raise ValueError(f"cuts=True asks about other questions than bags={bags!r} does: leave bags out, or {advice}")
    if batch != 1:
        raise ValueError(f"cuts=True asks one question at a time, but batch is {batch}: set batch=1, or {advice}")
    if trusted_share(comparator) is not None or not (
        isinstance(comparator, BoundsAllAtOnce) and isinstance(comparator, HasDraws)
    ):
        raise ValueError(
            "cuts=True needs bounds that are proven of every plausible scale, and draws of such scales, which "
            f"{type(comparator).__name__} does not have: take elicit.PolytopeComparator, or {advice}"
        )


def _in_full(found: Guarantee, mdp: OrdinalMDP, over: Advantages, comparator: Comparator) -> Guarantee:
    """A guarantee whose bound was needed only as far as "too much"."""
    if np.isfinite(found.loss_bound):
        return found
    return guarantee(mdp, advantages(mdp, over.policy, over.v), comparator)  # over may be of some states only


class _Exactly:
    """The heavy parts of a round for a small model: all advantages over a policy that is optimal for the central scale,
    and the bound on its loss."""

    def __init__(self, mdp: OrdinalMDP, enough: float) -> None:
        self._mdp, self._enough = mdp, enough
        self._over: Advantages | None = None
        self.rounds = 0  # policies solved for

    def round(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """The advantages that questions may be about, and a guarantee that is only right about being enough."""
        values, over = best_guess(comparator), self._over
        if over is None or self._changes(over, values):
            start = np.argmax(self._mdp.admissible, axis=1) if over is None else over.policy
            over = advantages(self._mdp, optimal_policy(self._mdp, values, start))
        self._over, self.rounds = over, self.rounds + 1
        return self.look_further(comparator)

    @staticmethod
    def _changes(over: Advantages, values: Floats) -> bool:
        """Whether ``optimal_policy`` would give another policy for this scale: there is a better action, or one that is
        as good and comes first."""
        gain = product(over.d, values)
        return bool(((gain > _TIE) | ((gain >= -_TIE) & (over.actions < over.policy[over.states]))).any())

    def look_further(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """The same, without solving again: there is no more to be seen."""
        over = self.everything()
        return over, guarantee(self._mdp, over, comparator, self._enough)

    def everything(self) -> Advantages:
        """All advantages over the present policy."""
        assert self._over is not None, "no round yet"
        return self._over

    def some_of(self, over: Advantages) -> Advantages:
        """Those among which audits are picked: all."""
        return over


class _Nearly:
    """The same for a large model: by sweeps, of a sample of states as long as that shows enough."""

    def __init__(self, mdp: OrdinalMDP, enough: float, seed: Seed) -> None:
        self._mdp, self._enough, self._key = mdp, enough, key_of(seed)
        self._worth = np.full(mdp.n_states, 0.5)  # (S,) under the last central scale
        self._policy: NDArray[np.int64] | None = None
        self._v: Floats | None = None  # (S, k) what it is worth, nearly
        self._total = np.zeros(mdp.n_states)  # that could be collected, by the last bounds
        self._most = _QUESTIONS if mdp.n_states <= _LONGER else _MORE
        self.rounds, self._asked = 0, 0  # policies solved for; rounds with the present one
        self._pool: Advantages | None = None
        self._all: Advantages | None = None

    def round(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """As of ``_Exactly``; the guarantee may be inf also where it only was not looked at."""
        self._asked += 1
        if self._pool is None or self._asked >= self._most or not self._in_vain(self._pool, comparator):
            self._solve(best_guess(comparator))
            sample = self._sample()
            self._pool = advantages(self._mdp, self._kept(), self._v, sample)
            if not self._too_much(self._pool, comparator):
                return self.look_further(comparator)
        return self._pool, Guarantee(np.inf, np.nan)

    def _in_vain(self, pool: Advantages, comparator: Comparator) -> bool:
        """Whether these advantages alone, over the present policy, show that its bound cannot be small enough yet."""
        if self._too_much(pool, comparator):
            return True
        if self._all is None or drawn_set(comparator) is not None:
            return False  # a sample, or drawn scales: these cannot show more
        high, _ = bounds_of_many(comparator, pool.d)
        total = collected(self._mdp, pool, high, self._total, _SHARE * self._enough)
        return bool(total.max(initial=0.0) > self._enough)

    def everything(self) -> Advantages:
        if self._all is None:
            self._all = advantages(self._mdp, self._kept(), self._v)
        return self._all

    def some_of(self, over: Advantages) -> Advantages:
        """Of a sample of the states."""
        return advantages(self._mdp, self._kept(), self._v, self._sample())

    def _kept(self) -> NDArray[np.int64]:
        """The present policy."""
        assert self._policy is not None, "no round yet"
        return self._policy

    def _solve(self, values: Floats) -> None:
        """A policy for the central scale. Where its actions are as good, the last one is kept, and if they are so
        everywhere its V as well: the same pairs, but for rounding, would be new ones and be asked about again."""
        mdp, little = self._mdp, _SHARE * self._enough
        gain, ends = rewarded(mdp, values)
        self._worth, policy, _ = nearly_optimal(mdp, gain, ends, self._worth, little)
        last = self._policy
        if last is not None:
            q, rows = backed_up(mdp, gain, ends, self._worth), np.arange(mdp.n_states)
            policy = np.where(q[rows, last] >= q[rows, policy] - little * (1 - mdp.discount), last, policy)
        if last is None or (policy != last)[~mdp.terminal].any():
            self._v = nearly_valued(mdp, policy, self._v, little * (1 - mdp.discount))
            self._policy, self._all = policy, None
        self.rounds, self._asked = self.rounds + 1, 0

    def _sample(self) -> NDArray[np.int64]:
        n = self._mdp.n_states
        rng = np.random.default_rng((self._key, self.rounds))
        return np.sort(rng.choice(n, min(n, _SAMPLE), replace=False))

    def _too_much(self, over: Advantages, comparator: Comparator) -> bool:
        """Whether too many draws show that some alternative, taken once, gains more than is enough: then no bound can
        be small enough, and these tell what to ask."""
        draws, trusted = draws_of(comparator), drawn_set(comparator)
        scores = product(tail_sums(over.d), draws.gaps)
        too_much = scores > self._enough
        too_much[scores.min(axis=1) >= 0] = False  # what all agree on, a new policy heeds
        beyond = product(too_much.any(axis=0), draws.weights)
        return bool(beyond > (0.0 if trusted is None else 1.0 - trusted[1] + LEVEL_ROUNDING))

    def look_further(self, comparator: Comparator) -> tuple[Advantages, Guarantee]:
        """All bounds, of a policy for this comparator's central scale; questions may be about the greatest."""
        if self._asked:
            self._solve(best_guess(comparator))
        mdp, over, trusted = self._mdp, self.everything(), drawn_set(comparator)
        if trusted is None:
            high, confidence = bounds_of_many(comparator, over.d)
            self._total = collected(mdp, over, high, self._total, _SHARE * self._enough)
            found = Guarantee(float(self._total.max(initial=0.0)), confidence)
        else:
            found = guarantee(mdp, over, comparator, self._enough)
            high = most_of(over.d, trusted[0].gaps, axis=1)
        rows = np.argsort(-high, kind="stable")[:_POOL]
        self._pool = over.only(np.sort(rows))
        return self._pool, found


def bounds_of_many(comparator: Comparator, d: Floats) -> tuple[Floats, float]:
    """``simultaneous_bounds`` of very many differences d (n, k), most of which are below 0 for every plausible scale:
    these bounds are no tighter than a box needs to show it.

    The box is of the plausible scales, along the principal axes of their draws: 2 (k - 1) bounds say how far it
    reaches, and all scales that they allow are in it. Without draws, or where bounds are not certain, so that what they
    are may depend on how many are asked for, there is no box."""
    if (draws := draws_in(comparator)) is not None:
        gaps, weights = draws[:2]
        spread = gaps - product(gaps, weights)[:, None]
        axes = principal_axes(product(spread * weights, spread.T))  # (p, p), orthonormal
        ways = np.concatenate([axes.T, -axes.T])
        reach, confidence = simultaneous_bounds(comparator, -np.diff(ways, axis=1, prepend=0.0, append=0.0))
        if confidence == 1 and np.isfinite(reach).all():
            high = _bounds_by_box(axes, reach, d)
            rows = np.flatnonzero(high > 0)
            high[rows] = simultaneous_bounds(comparator, d[rows])[0]
            return high, confidence
    high, confidence = simultaneous_bounds(comparator, d)
    return np.minimum(high, order_bounds(tail_sums(d), 0.0)[1]), confidence  # which may have been inf


def _bounds_by_box(axes: Floats, reach: Floats, d: Floats) -> Floats:
    """Upper bounds (n,) on d.e for scales whose gaps reach at most so far (2p,) along orthonormal axes, the columns
    (p, p), and against them."""
    p, high = len(axes), np.empty(len(d))
    astray = (
        np.abs(product(axes, axes.T) - np.eye(p)).max() * p + 16 * p * p * np.finfo(float).eps
    )  # all of this is rounded
    for start in range(0, len(d), _BLOCK):
        t, some = tail_sums(d[start : start + _BLOCK]), slice(start, start + _BLOCK)
        along = product(t, axes)
        high[some] = np.maximum(along * reach[:p], along * -reach[p:]).sum(axis=1) + astray * np.abs(t).sum(axis=1)
    return high
