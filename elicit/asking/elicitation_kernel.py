"""The rules by which an elicitation decides a pair, in code that numba can compile.

``decide_by_facts`` states which facts decide and in which order. Both ``Elicitation.decide``, for
whole arrays, and the learners' compiled loops use it. A caller looks up facts only as needed: if
one is missing, the result says which, and the caller finds it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import unit
from elicit._support.jit import compiled
from elicit.decision.comparator_rule import Rule
from elicit.decision.rule_kernel import by_rule, within
from elicit.lp.sign_proofs import BY_DOMINANCE
from elicit.model.comparator import BY_ANSWERS, Tier
from elicit.model.difference_kernel import (
    BETTER,
    EQUAL,
    LEFT_OPEN,
    NOT_THERE,
    UNKNOWN,
    WORSE,
    PairTable,
    find,
    pair_code,
)

KNOWN, INDIFFERENT, GUESS, TUTOR = (
    int(Tier.KNOWN),
    int(Tier.INDIFFERENT),
    int(Tier.GUESS),
    int(Tier.TUTOR),
)
FIRST_BY_ANSWERS, LAST_BY_ANSWERS = int(min(BY_ANSWERS)), int(max(BY_ANSWERS))
NO_FACT, COMPARATOR, PLACE, BOUNDS = range(4)  # which fact is needed to go on


class AskingState(NamedTuple):
    """Everything except the comparator that an elicitation decides by, as plain arrays."""

    indifference: float
    audit: float  # share of the pairs decided by answers that the tutor is to confirm
    key: Any  # np.uint64, the key of the random numbers
    answered: PairTable  # all pairs that were answered
    plain: bool  # no audits and no binding answers, so that a comparator's verdict stands
    unclear: bool  # True if the tutor could not tell somewhere
    guess: NDArray[np.float64]  # (p,) gaps to go by if the tutor is not to be asked; else (0,)


class Facts(NamedTuple):
    """Facts about a pair (or about n pairs, as int64 arrays). LEFT_OPEN: not looked up yet."""

    verdict: Any  # the comparator's own
    tier: Any  # of that verdict
    unclear: Any  # 1 if the tutor could not tell at the same place, else 0
    close: Any  # EQUAL if d.e is proven to lie within the indifference, else UNKNOWN


class PairDecision(NamedTuple):
    """The verdict of an elicitation on one pair (or on n, as arrays), and its tier.

    UNKNOWN means that the tutor must be asked, and LEFT_OPEN that a fact is missing.
    """

    verdict: Any
    # the tier that decided it; UNKNOWN with another tier than TUTOR is an audit, in which the tutor
    # is to confirm a decision
    tier: Any
    certified: Any  # True if ``by_rule`` wrote a certificate
    needed: Any  # the fact that is needed


@compiled
def decide_by_facts(t: Any, asking: AskingState, facts: Facts) -> PairDecision:
    """Decide a pair with tail sums t (p,) by the facts about it, such as the comparator's verdict.

    The result may be that the tutor must be asked, or that a fact is missing.
    """
    verdict, tier = facts.verdict, facts.tier
    if verdict == LEFT_OPEN:
        return missing(COMPARATOR)
    if verdict != UNKNOWN and (tier <= BY_DOMINANCE or asking.plain):
        return decided(verdict, tier)
    row, way = find(t, asking.answered)
    if row != NOT_THERE and (verdict == UNKNOWN or asking.answered.binding[row]):
        return decided(way * asking.answered.said[row], KNOWN)
    if verdict != UNKNOWN:
        may = row == NOT_THERE and verdict != EQUAL and FIRST_BY_ANSWERS <= tier <= LAST_BY_ANSWERS
        if may and asking.audit > 0.0 and unit(pair_code(asking.key, t)) < asking.audit:
            return decided(UNKNOWN, tier)
        return decided(verdict, tier)
    if asking.unclear and facts.unclear != 0:
        return missing(PLACE) if facts.unclear == LEFT_OPEN else decided(EQUAL, KNOWN)
    if asking.indifference > 0.0 and facts.close != UNKNOWN:
        return missing(BOUNDS) if facts.close == LEFT_OPEN else decided(EQUAL, INDIFFERENT)
    if len(asking.guess) > 0:
        at = 0.0
        for j in range(len(t)):
            at += t[j] * asking.guess[j]
        return decided(BETTER if at > 0.0 else WORSE if at < 0.0 else EQUAL, GUESS)
    return decided(UNKNOWN, TUTOR)


@compiled
def decide_rows(rows: Any, t: Any, asking: AskingState, facts: Facts, out: PairDecision) -> None:
    """Write the decisions of ``decide_by_facts`` on rows of tail sums t (n, p) into ``out``."""
    for i in rows:
        found = decide_by_facts(
            t[i], asking, Facts(facts.verdict[i], facts.tier[i], facts.unclear[i], facts.close[i])
        )
        out.verdict[i], out.tier[i], out.needed[i] = found.verdict, found.tier, found.needed


@compiled
def decide_pair(
    d: Any, t: Any, sums: Any, certificate: Any, rule: Rule, asking: AskingState
) -> PairDecision:
    """Find the facts about one pair that dominance does not decide, and decide it by them.

    d (k,) is the pair's difference and t (p,) its tail sums. The comparator's verdict comes from
    its ``rule``, as far as compiled code can find it. t and sums (p,) are overwritten.
    ``certificate`` is as in ``by_rule``.
    """
    for j in range(len(t)):
        sums[j] = t[j]
    verdict, tier, certified = by_rule(d, t, 0.0, certificate, rule)
    if verdict != UNKNOWN and verdict != LEFT_OPEN and asking.plain:
        return PairDecision(verdict, tier, certified, NO_FACT)
    found = decide_by_facts(sums, asking, Facts(verdict, tier, LEFT_OPEN, LEFT_OPEN))
    if found.needed == BOUNDS:
        for j in range(len(t)):
            t[j] = sums[j]
        close = within(d, t, asking.indifference, rule)
        found = decide_by_facts(sums, asking, Facts(verdict, tier, LEFT_OPEN, close))
    certified = certified and found.verdict == verdict
    return PairDecision(found.verdict, found.tier, certified, found.needed)


@compiled
def decided(verdict: int, tier: int) -> PairDecision:
    """Return a decision that needs no further fact."""
    return PairDecision(verdict, tier, False, NO_FACT)


@compiled
def missing(fact: int) -> PairDecision:
    """Return the decision that this fact must be found first."""
    return PairDecision(LEFT_OPEN, LEFT_OPEN, False, fact)
