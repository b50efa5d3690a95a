"""The comparison of two actions in every compiled loop: difference, verdict, and a record of it.

``q_learning_kernel.advance`` and ``state_sweep_kernel.sweep`` first try what needs no proof:
``by_order``, then ``certified``. Only then do they call ``decide_action_pair``. The compiler
inlines it into these loops (``jit.written_out``). The loops hold some sixty arrays, and passing
them in a call would take longer than most verdicts.

Many comparisons are nearly the same as an earlier one: of the same two actions, whose vectors have
moved a little since. So a verdict that took a proof leaves a *certificate*: a vector f with f.g >=
0 for the gaps g of every plausible scale. Gaps are not negative. So if a difference has tail sums t
>= f, entry by entry, then t.g >= f.g >= 0, and it has the same verdict. If the verdict is WORSE, -t
takes the place of t. Comparing k - 1 numbers takes a tenth of the time of a proof.

A verdict by the weight of drawn scales leaves a certificate too. Then t >= f means that enough of
the draws still give the sign of the verdict.

A certificate holds while the answers stay the same. If it was proven for all scales that fit the
answers, it holds for ever, because further answers only remove scales
(``elicit.decision.comparator_rule.outlasts_answers``).
"""

from __future__ import annotations

from types import MethodType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import DTypeLike, NDArray

from elicit._support.jit import compiled, compiled_in_parts, written_out
from elicit.asking.elicitation import Elicitation
from elicit.asking.elicitation_kernel import AskingState, PairDecision, decide_pair
from elicit.comparators.baselines import AlwaysAsk
from elicit.decision.comparator_rule import Rule, outlasts_answers, rule_of
from elicit.decision.rule_kernel import certifies
from elicit.lp.primal_simplex import Known
from elicit.lp.sign_proofs import BY_DOMINANCE, BY_EQUAL, BY_SCREEN, BY_SIMPLEX
from elicit.lp.vertex_store import cut_at_once
from elicit.model.comparator import Decisions, Tier
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import (
    EQUAL,
    LEFT_OPEN,
    UNKNOWN,
    apart,
    by_range,
    mark_of,
    marks_within,
    near_to,
    to_order_one,
)
from elicit.model.query import Verdict
from elicit.model.scale import Floats
from elicit.tutors.simulated_kernel import (
    GIVEN,
    NOBODY,
    TRUTHFUL,
    WRONG,
    Respondent,
    nobody,
    respond,
)

BY_KNOWN, BY_TUTOR = int(Tier.KNOWN), int(Tier.TUTOR)
_KEPT_AT_ONCE = 4096  # comparisons handed to a watcher at once
_TOLD_AT_ONCE = 1024  # answers handed to the elicitation at once, at most
USED, ROOM, ROOM_IN_RULE = 0, 1, 2  # the entries of ``Told.fill``
NO_TIER = -1  # the tier of a pair that is not decided yet


class Certificates(NamedTuple):
    """The last certificate of each state s and action a, in row s*A + a, and what it shows.

    A row has the certificate's vector, the verdict that it shows, and the tier under which its
    decisions are counted. The verdict is 0 if the row has no certificate.
    """

    least: NDArray[np.floating[Any]]  # (n, p) f, of the tail sums times the verdict
    verdicts: NDArray[np.int8]  # (n,)
    tiers: NDArray[np.int8]  # (n,)


class Kept(NamedTuple):
    """Buffer of comparisons for a watcher. Without a watcher it has no room (c = 0)."""

    d: Floats  # (c, k)
    verdicts: NDArray[np.int8]  # (c,)
    tiers: NDArray[np.int8]  # (c,)
    used: NDArray[np.int64]  # (1,) number of comparisons kept


class Told(NamedTuple):
    """Buffer of answers that a tutor has given within a loop, until the elicitation takes them.

    It is empty, with no room, if only Python can ask the tutor.
    """

    vectors: Floats  # (c, 2, k) left and right
    verdicts: NDArray[np.int8]  # (c,)
    sums: Floats  # (c, p) tail sums of left - right
    marks: Floats  # (c,) the marks of these, by which a pair is found again
    # (3,) the number of answers, and the largest number: of those with the rule as it is, and of
    # those that are entered in the rule
    fill: NDArray[np.int64]


class DecidingArrays(NamedTuple):
    """All arrays by which a loop decides a pair."""

    rule: Rule
    asking: AskingState
    oracle: Respondent  # the respondent whom AlwaysAsk asks, if the tutor is there as arrays
    certificates: Certificates
    kept: Kept
    tutor: Respondent  # the respondent who decides open pairs, while there is room in ``told``
    told: Told


@runtime_checkable
class AnswersInLoops(Protocol):
    """A simulated tutor that is also available as plain arrays."""

    @property
    def respondent(self) -> Respondent:
        """Return the tutor as arrays. If an answer from them is LEFT_OPEN, get them again."""


class PairDecider:
    """An elicitation as compiled loops use it.

    It also holds the loop's certificates, and the comparisons that are kept for a watcher.
    """

    def __init__(
        self, elicitation: Elicitation, pairs: int, digits: DTypeLike = np.float64, room: int = 0
    ) -> None:
        k, room = elicitation.comparator.k, max(room, _KEPT_AT_ONCE)
        least = np.empty((pairs, k - 1), dtype=digits)
        self.certificates = Certificates(least, np.zeros(pairs, np.int8), np.zeros(pairs, np.int8))
        self._elicitation = elicitation
        self._unwatched, self._watched = (
            Kept(
                np.empty((c, k)), np.empty(c, np.int8), np.empty(c, np.int8), np.zeros(1, np.int64)
            )
            for c in (0, room)
        )
        c = _TOLD_AT_ONCE
        self._told = Told(
            vectors=np.empty((c, 2, k)),
            verdicts=np.empty(c, np.int8),
            sums=np.empty((c, k - 1)),
            marks=np.empty(c),
            fill=np.zeros(3, np.int64),
        )
        self.tutor: AnswersInLoops | None = (
            None  # the tutor who is asked within the loop, if the elicitation has room for it
        )

    def arrays(self, rule: Rule) -> DecidingArrays:
        """Return the arrays by which pairs are decided now, with this rule of the comparator."""
        elicitation, oracle = self._elicitation, nobody()
        asks_all = isinstance(elicitation.comparator, AlwaysAsk)
        if asks_all and isinstance(elicitation.signs, MethodType):
            tutor = elicitation.signs.__self__
            oracle = tutor.respondent if isinstance(tutor, AnswersInLoops) else oracle
        return DecidingArrays(
            rule=rule,
            asking=elicitation.asking_state(),
            oracle=oracle,
            certificates=self.certificates,
            kept=self._unwatched if elicitation.watch is None else self._watched,
            tutor=self._tutor(rule),
            told=self._told,
        )

    def _tutor(self, rule: Rule) -> Respondent:
        """Return the tutor to ask within the loop, as arrays, and make room for the answers.

        The loop may add answers to the rule only if it is the comparator's latest rule.
        """
        elicitation = self._elicitation
        respondent = nobody() if self.tutor is None else self.tutor.respondent
        room, in_rule = elicitation.room if respondent.kind != NOBODY else 0, 0
        if respondent.kind == TRUTHFUL and not room:
            latest = rule.known is rule_of(elicitation.comparator).known
            in_rule = elicitation.room_in_rule if latest else 0
        self._told.fill[:] = 0, min(room, _TOLD_AT_ONCE), min(in_rule, _TOLD_AT_ONCE)
        return respondent

    def enter(self, tiers: NDArray[np.int64], rule: Rule | None = None) -> bool:
        """Count a loop's comparisons, (len(Tier),) by tier, and pass on what it has recorded.

        The elicitation takes the tutor's answers, which the loop has added to ``rule`` if there was
        room. The watcher gets the comparisons. Return whether there were any answers.
        """
        elicitation, kept = self._elicitation, self._watched
        elicitation.counts += tiers
        if elicitation.signs is not None:
            elicitation.asked = int(elicitation.counts[Tier.TUTOR])
        taken = self.take_told(rule if self._told.fill[ROOM_IN_RULE] else None)
        n, kept.used[0] = int(kept.used[0]), 0
        if n and elicitation.watch is not None:
            elicitation.watch(
                kept.d[:n].copy(), Decisions(kept.verdicts[:n].copy(), kept.tiers[:n].copy())
            )
        return taken

    def take_told(self, rule: Rule | None = None) -> bool:
        """Pass the answers given in the loop to the elicitation; return whether there were any.

        ``rule`` is the comparator's rule if the loop has added the answers to it. It is None if the
        loop has not, or if an interruption has lost the rule.
        """
        told = self._told
        n = int(told.fill[USED])
        if n:
            self._elicitation.take(
                told.vectors[:n, 0], told.vectors[:n, 1], told.verdicts[:n].copy(), rule
            )
            told.fill[:] = 0
            self.take_answers()
        return n > 0

    def answer(self, left: Floats, right: Floats) -> Verdict | None:
        """Ask the tutor about vectors left and right (k,), and have the elicitation learn it.

        Return None, with nothing changed, unless a truthful tutor can be asked within the loop.
        Then the pair has to be asked and told as usual.
        """
        tutor = None if self.tutor is None else self.tutor.respondent
        if tutor is None or tutor.kind != TRUTHFUL:
            return None  # an erring tutor might answer differently when asked again as usual
        said = respond(np.ascontiguousarray(tail_sums(left - right)), tutor)
        if said == LEFT_OPEN:
            return None
        if not self._elicitation.take_at_once(left, right, Verdict(said)):
            tutor.tally[GIVEN] -= 1
            return None
        self.take_answers()
        return Verdict(said)

    def take_answers(self) -> None:
        """Delete the certificates after an answer, unless they were proven for ever."""
        if not outlasts_answers(rule_of(self._elicitation.comparator)):
            self.certificates.verdicts[:] = 0


@compiled
def by_order(verdict: int, dominance: bool) -> int:
    """Return the tier of a verdict of ``difference``; NO_TIER if it does not decide the pair.

    ``dominance`` is whether dominance may decide.
    """
    if verdict == EQUAL:
        return BY_EQUAL
    return BY_DOMINANCE if dominance and verdict != UNKNOWN else NO_TIER


@compiled
def certified(least: Any, sides: Any, row: int, t: Any) -> bool:
    """Return whether a pair with tail sums t (p,) has the verdict of its certificate.

    The certificate is in a row of ``least`` (n, p), and its verdict in ``sides`` (n,), as in
    ``Certificates``. The arrays come one by one because the loops keep them at hand.
    """
    return bool(sides[row] != 0 and certifies(least, row, sides[row], t))


@written_out
def decide_action_pair(
    q: Any, s: int, a: int, b: int, row: int, d: Any, t: Any, deciding: DecidingArrays
) -> tuple[int, int]:
    """Decide a pair of actions that order and certificate leave open. Return verdict and tier.

    It uses the comparator's rule, and a tutor who can be asked within the loop. UNKNOWN means that
    Python has to ask, and LEFT_OPEN that the elicitation has to decide. If the tier is NO_TIER,
    pass on the stored comparisons, then call again. t is overwritten unless the tutor gives the
    verdict.
    """
    sums, least = np.empty(len(t)), np.empty(len(t))
    found = decide_pair(d, t, sums, least, deciding.rule, deciding.asking)
    verdict, tier = certify(found, least, row, deciding.certificates)
    if verdict == UNKNOWN and deciding.told.fill[ROOM] > 0:
        difference(q, s, a, b, d, t)
        verdict, tier = put(q, s, a, b, t, deciding)
    return verdict, tier


@compiled
def difference(q: Any, s: int, a: int, b: int, d: Any, t: Any) -> int:
    """Write Q(s, a) - Q(s, b) of q (S, A, k) into d (k,), and its tail sums into t (p,).

    Return the verdict by dominance.
    """
    # no views of rows of q: counting references to it would take as long as all the sums
    total, least, greatest = -0.0, 0.0, 0.0
    for j in range(len(d) - 1, 0, -1):
        d[j] = q[s, a, j] - q[s, b, j]
        total += d[j]
        t[j - 1] = total
        least, greatest = min(least, total), max(greatest, total)
    d[0] = q[s, a, 0] - q[s, b, 0]
    return by_range(least, greatest)


@compiled
def certify(
    found: PairDecision, least: Any, row: int, certificates: Certificates
) -> tuple[int, int]:
    """Return verdict and tier of a decision ``found`` by ``decide_pair``; store its certificate.

    An audit becomes LEFT_OPEN, because Python has to make it. If there is a certificate in
    ``least`` (p,), it replaces the row's.
    """
    verdict, tier = found.verdict, found.tier
    if verdict == UNKNOWN and tier != BY_TUTOR:
        verdict = LEFT_OPEN
    certificates.verdicts[row] = 0
    if found.certified:
        round_up(least, certificates.least[row])
        certificates.verdicts[row] = verdict
        certificates.tiers[row] = (
            BY_SCREEN if tier == BY_SIMPLEX else tier
        )  # looking it up takes no program
    return verdict, tier


@compiled
def full(used: Any, room: int, fill: Any) -> bool:
    """Return whether comparisons or answers must be passed on before another pair is decided.

    The reason may be that there is no room for more, or that the comparator may have learned
    something. ``used`` (1,) of ``room`` comparisons are kept. ``fill`` is that of ``Told``.
    """
    return bool((used[0] == room and room > 0) or (fill[USED] > 0 and fill[USED] == fill[ROOM]))


@compiled
def put(q: Any, s: int, a: int, b: int, t: Any, deciding: DecidingArrays) -> tuple[int, int]:
    """Ask the tutor about an undecided pair with tail sums t (p,). Return verdict and tier.

    UNKNOWN means that Python has to ask. LEFT_OPEN and NO_TIER mean that the kept comparisons must
    be passed on first, because a watcher may want to know which were decided before the tutor's
    first error. There must be room for an answer.
    """
    kept, tutor, told = deciding.kept, deciding.tutor, deciding.told
    known = told_before(t, told)
    if known != UNKNOWN:
        return known, BY_KNOWN
    if (
        tutor.kind != TRUTHFUL
        and tutor.tally[WRONG] == 0
        and len(kept.tiers) > 0
        and kept.used[0] > 0
    ):
        return LEFT_OPEN, NO_TIER
    verdict = respond(t, tutor)
    if verdict == LEFT_OPEN:
        return UNKNOWN, BY_TUTOR
    record(q, s, a, b, t, verdict, told)
    if verdict == EQUAL:  # this answer is binding: the rule must be made again
        told.fill[ROOM] = told.fill[USED]
    return verdict, BY_TUTOR


@compiled
def told_before(t: Any, told: Told) -> int:
    """Return the verdict on a pair if the tutor gave it earlier in this run of the loop.

    Otherwise return UNKNOWN. The pair has tail sums t (p,), and may be flipped.
    """
    mark, near = mark_of(t), near_to(t)
    reach = marks_within(near, len(t))
    for row in range(told.fill[USED]):
        for way in (1, -1):
            if abs(way * mark - told.marks[row]) <= reach and apart(t, way, told.sums[row]) <= near:
                return int(way * told.verdicts[row])
    return UNKNOWN


@compiled
def record(q: Any, s: int, a: int, b: int, t: Any, verdict: int, told: Told) -> None:
    """Record an answer about a pair of actions with tail sums t (p,). There must be room."""
    row = told.fill[USED]
    for j in range(q.shape[2]):
        told.vectors[row, 0, j] = q[s, a, j]
        told.vectors[row, 1, j] = q[s, b, j]
    for j in range(len(t)):
        told.sums[row, j] = t[j]
    told.verdicts[row], told.marks[row] = verdict, mark_of(t)
    told.fill[USED] = row + 1


@compiled_in_parts
def learn_pair(
    q: Any, s: int, a: int, b: int, d: Any, t: Any, deciding: DecidingArrays
) -> tuple[int, int, Known]:
    """Ask the tutor about an undecided pair, and add the answer to the proofs of the rule.

    Return verdict and tier, and the facts about K_t from now on. UNKNOWN means that only Python can
    ask, or learn the answer. Nothing has changed then. There must be room in the rule. The pair's
    difference is written into d (k,), and its tail sums into t (p,).
    """
    known, tutor, told = deciding.rule.known, deciding.tutor, deciding.told
    difference(q, s, a, b, d, t)
    verdict = told_before(t, told)
    if verdict != UNKNOWN:
        return verdict, BY_KNOWN, known
    verdict = respond(t, tutor)
    if verdict == LEFT_OPEN:
        return UNKNOWN, BY_TUTOR, known
    row = np.empty(len(t))  # as ``region.answer_rows`` has it
    for j in range(len(t)):
        row[j] = verdict * t[j] + 0.0
    size, exponent = to_order_one(row)
    done = verdict != EQUAL and size < 1.0 and exponent <= 0  # else bits may be lost
    if done:
        done, known = cut_at_once(known, row)
    if not done:
        tutor.tally[GIVEN] -= 1
        return UNKNOWN, BY_TUTOR, known
    record(q, s, a, b, t, verdict, told)
    return verdict, BY_TUTOR, known


@compiled
def round_up(numbers: Any, into: Any) -> None:
    """Copy numbers into an array that may be of half precision, rounding up."""
    for j in range(len(numbers)):
        number = max(numbers[j], -1e38)
        into[j] = number
        if into[j] < number:
            into[j] = number + abs(number) * 2.0**-22 + 2.0**-126


@compiled
def keep(d: Any, verdict: int, tier: int, kept: Kept) -> None:
    """Store a comparison for the watcher. There must be room."""
    i = kept.used[0]
    for j in range(len(d)):
        kept.d[i, j] = d[j]
    kept.verdicts[i], kept.tiers[i] = verdict, tier
    kept.used[0] = i + 1
