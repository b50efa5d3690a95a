"""Verdicts of any comparator, and the tier that decided each.

A comparator's rule decides first. The comparator itself decides what its rule leaves open.
"""

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from elicit._support import jit
from elicit.decision.comparator_rule import Rule, Settling, compares_by_rule, rule_of
from elicit.decision.judge_kernel import judge_all
from elicit.model.comparator import Comparator, Decisions, Tier, Verdicts, offers
from elicit.model.difference import as_differences, dominance, tail_sums
from elicit.model.difference_kernel import UNKNOWN, UNSETTLED
from elicit.model.query import Verdict
from elicit.model.scale import Floats


def decide(comparator: Comparator, d: ArrayLike) -> Decisions:
    """Return ``comparator.compare(d)`` of differences d (n, k), with the tiers (n,).

    If a comparator has no rule, differences that are neither equal nor dominated count as MODEL.
    """
    rows = as_differences(d, comparator.k)
    if compares_by_rule(type(comparator)):
        settle = cast(Settling, comparator).settle if offers(comparator, "settle") else None
        return decide_by(rule_of(comparator), rows, settle)
    verdicts = _checked(comparator.compare(rows), comparator, len(rows))
    tiers = np.array([Tier.EQUAL, Tier.DOMINANCE, Tier.MODEL, Tier.DOMINANCE], dtype=np.int8)
    return Decisions(verdicts, tiers[dominance(tail_sums(rows))])  # -1, worse, is the last


def _checked(verdicts: object, comparator: Comparator, n: int) -> Verdicts:
    """Return the result of a comparator's ``compare`` for n differences.

    Raise TypeError unless it is codes (n,) int8.
    """
    codes = np.asarray(verdicts)
    if (
        codes.shape == (n,)
        and codes.dtype == np.int8
        and (codes >= Verdict.WORSE).all()
        and (codes <= UNKNOWN).all()
    ):
        return codes
    raise TypeError(
        f"{type(comparator).__name__}.compare(d) must return an int8 array (n,) of verdicts, -1, "
        "0, 1, or 2 where only "
        f"the tutor can tell, but of {n} differences it returns {verdicts!r}, of shape "
        f"{codes.shape} and type "
        f"{codes.dtype}; elicit.testing.check_comparator tries a comparator out"
    )


def decide_by(
    rule: Rule, d: Floats, settle: Callable[[Floats], Decisions] | None = None
) -> Decisions:
    """Return verdicts (n,) and tiers (n,) of valid differences d (n, k) by a rule.

    ``settle`` decides the differences that the rule leaves open. If there are any and there is no
    ``settle``, TypeError is raised.
    """
    rows = np.require(d, requirements=["C", "W"])  # compiled code is made for one layout
    verdicts, tiers = np.empty(len(rows), dtype=np.int8), np.empty(len(rows), dtype=np.int8)
    jit.expect(judge_all, 8e-6 * rows.size * rows.shape[1])
    with np.errstate(all="ignore"):
        left = judge_all(rows, rule, verdicts, tiers)
    if left:
        if settle is None:
            raise TypeError(
                "a comparator whose rule leaves differences open must have a method settle(d)"
            )
        open_rows = np.flatnonzero(verdicts == UNSETTLED)
        verdicts[open_rows], tiers[open_rows] = settle(rows[open_rows])
    return Decisions(verdicts, tiers)
