"""Verdicts of any comparator, with the tier (kind of proof) that decided each.

A comparator's rule decides first. The comparator itself decides what its rule leaves open.
"""

from collections.abc import Callable
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from elicit._support import jit
from elicit.decision.comparator_rule import DecidesRest, Rule, compares_by_rule, rule_of
from elicit.decision.rule_kernel import all_by_rule
from elicit.model.comparator import Comparator, Decisions, Tier, Verdicts, offers
from elicit.model.difference import as_differences, dominance, tail_sums
from elicit.model.difference_kernel import LEFT_OPEN, UNKNOWN
from elicit.model.query import Verdict
from elicit.model.scale import Floats


def decide(comparator: Comparator, d: ArrayLike) -> Decisions:
    """Return a comparator's verdicts on differences d (n, k), and the tier (n,) of each.

    The verdicts are those of ``comparator.compare(d)``. If a comparator has no rule, the tier of
    all but equal and dominated pairs is MODEL.

    Parameters
    ----------
    comparator : Comparator
        Holds what is known of the scale.
    d : (n, k)
        Differences left - right, a row for each comparison. A single difference (k,) counts as one
        row.

    Returns
    -------
    Decisions
        The verdicts (n,) and the tiers (n,).

    Raises
    ------
    ValueError
        If d has another shape or is not finite, as ``as_differences`` says.
    TypeError
        If ``comparator.compare`` returns anything but verdicts (n,), or the comparator has a rule
        that leaves differences open and no method ``decide_rest``.
    """
    rows = as_differences(d, comparator.k)
    if compares_by_rule(type(comparator)):
        has_rest = offers(comparator, "decide_rest")
        rest = cast(DecidesRest, comparator).decide_rest if has_rest else None
        return decide_by_rule(rule_of(comparator), rows, rest)
    verdicts = _checked(comparator.compare(rows), comparator, len(rows))
    tiers = np.array([Tier.EQUAL, Tier.DOMINANCE, Tier.MODEL, Tier.DOMINANCE], dtype=np.int8)
    return Decisions(verdicts, tiers[dominance(tail_sums(rows))])  # -1, worse, is the last


def _checked(verdicts: object, comparator: Comparator, n: int) -> Verdicts:
    """Return the result of a comparator's ``compare`` for n differences, after a check.

    Raise TypeError unless it is an int8 array (n,) of verdict codes.
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


def decide_by_rule(
    rule: Rule, d: Floats, decide_rest: Callable[[Floats], Decisions] | None = None
) -> Decisions:
    """Return a rule's verdicts (n,) and tiers (n,) of valid differences d (n, k).

    ``decide_rest`` decides the differences that the rule leaves open. If it is needed and missing,
    TypeError is raised.
    """
    rows = np.require(d, requirements=["C", "W"])  # compiled code is made for one layout
    verdicts, tiers = np.empty(len(rows), dtype=np.int8), np.empty(len(rows), dtype=np.int8)
    jit.expect(all_by_rule, 8e-6 * rows.size * rows.shape[1])
    with np.errstate(all="ignore"):
        left = all_by_rule(rows, rule, verdicts, tiers)
    if left:
        if decide_rest is None:
            raise TypeError(
                "a comparator whose rule leaves differences open must have a method decide_rest(d)"
            )
        open_rows = np.flatnonzero(verdicts == LEFT_OPEN)
        verdicts[open_rows], tiers[open_rows] = decide_rest(rows[open_rows])
    return Decisions(verdicts, tiers)
