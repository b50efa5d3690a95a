"""What an elicitation says of one pair, as far as that needs no Python: its part in the learners' compiled loops."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import pair_code, unit
from elicit._support.jit import compiled
from elicit.decision.judge import judge, within
from elicit.lp.sign import BY_EQUAL
from elicit.model.comparator import Tier
from elicit.model.tail_sums_kernel import BETTER, EQUAL, UNKNOWN, UNSETTLED, WORSE

INDIFFERENT, GUESS = int(Tier.INDIFFERENT), int(Tier.GUESS)


class AskingRule(NamedTuple):
    """How an elicitation stands, as plain arrays. Pairs are named by their hash with its key."""

    indifference: float
    audit: float  # share of the pairs settled by answers that the tutor is to confirm
    key: Any  # np.uint64
    binding: NDArray[np.uint64]  # sorted: pairs whose answer no model may overrule
    said: NDArray[np.uint64]  # sorted: all pairs that were answered
    plain: bool  # no audits and nothing binding: what the comparator says, goes
    unclear: bool  # whether somewhere the tutor could not tell
    guess: NDArray[np.float64]  # (p,) gaps to go by once the budget is spent; else (0,)


@compiled
def among(code: Any, codes: Any) -> bool:
    """Whether ``code`` is in the sorted ``codes``."""
    i = np.searchsorted(codes, code)
    return bool(i < len(codes) and codes[i] == code)


@compiled
def judge_pair(d: Any, t: Any, work: Any, rule: Any, asking: AskingRule, certificate: Any) -> tuple[int, int, bool]:
    """Verdict and tier of a pair on which dominance is silent, as ``Elicitation.judge`` has them; UNSETTLED where only
    the elicitation can tell, UNKNOWN where only the tutor can. And whether ``certificate`` was written (``judge``)."""
    for j in range(len(t)):
        work[0, j] = t[j]
    if len(asking.binding) > 0 and among(pair_code(asking.key, t, work[1]), asking.binding):
        return UNSETTLED, BY_EQUAL, False
    verdict, tier, certified = judge(d, t, 0.0, certificate, rule)
    if verdict == UNKNOWN:
        if asking.unclear or (len(asking.said) > 0 and among(pair_code(asking.key, work[0], work[1]), asking.said)):
            return UNSETTLED, BY_EQUAL, False
        if asking.indifference > 0.0:
            for j in range(len(t)):
                work[1, j] = work[0, j]
            verdict, tier = within(d, work[1], asking.indifference, rule), INDIFFERENT
        if verdict == UNKNOWN and len(asking.guess) > 0:
            at = 0.0
            for j in range(len(t)):
                at += work[0, j] * asking.guess[j]
            return (BETTER if at > 0.0 else WORSE if at < 0.0 else EQUAL), GUESS, False
    elif verdict != EQUAL and asking.audit > 0.0 and unit(pair_code(asking.key, work[0], work[1])) < asking.audit:
        return UNSETTLED, BY_EQUAL, False
    return verdict, tier, certified
