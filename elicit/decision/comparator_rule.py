"""A comparator's knowledge as plain arrays: the rule by which ``decision.rule_kernel`` decides.

A loop that compares millions of pairs cannot call Python for each comparison. It takes a
comparator's ``rule`` anew after every update. All rules have one type, so that the code that
decides is compiled once for all comparators.
"""

from functools import cache
from typing import NamedTuple, Protocol, cast, runtime_checkable

import numpy as np

from elicit.lp.primal_simplex import Known, nothing_known
from elicit.model.comparator import Comparator, Decisions
from elicit.model.query import Answers
from elicit.model.scale import Floats

NO_ARRAYS, ALWAYS_ASK, ORDER_ONLY, PROVEN, OUTER, WEIGHTED, ENSEMBLE, BOX = range(8)
PROOFS = (PROVEN, OUTER)  # the kinds whose arrays compiled code writes to


class Rule(NamedTuple):
    """A comparator's knowledge: a kind, and the arrays that this kind needs, others empty."""

    kind: int
    dominance: bool  # whether eq. (4) decides before anything else
    known: Known
    scales: Floats  # (p, m)
    weights: Floats  # (m,)
    level: float
    room: int  # the number of answers that compiled code may enter in ``known`` by ``cut_at_once``


class Ruled(Protocol):
    """A comparator that decides by a rule."""

    @property
    def rule(self) -> Rule:
        """The comparator's knowledge as plain arrays."""


@runtime_checkable
class DecidesRest(Protocol):
    """A comparator that can decide the differences that its rule leaves open."""

    def decide_rest(self, d: Floats) -> Decisions:
        """Return verdicts and tiers (n,) of differences d (n, k) that the rule leaves open."""


@runtime_checkable
class LearnsInLoops(Protocol):
    """A comparator whose rule a compiled loop may change by answers, up to the rule's ``room``."""

    def learned_in_loop(self, answers: Answers, rule: Rule) -> Comparator:
        """Return the comparator after strict answers that a loop has entered in its rule."""


@cache
def nothing() -> Rule:
    """Return a rule without arrays: beyond dominance, only the comparator itself can decide."""
    known = nothing_known(0.0, np.empty((0, 0)), np.empty(0), vertices=0)
    return Rule(NO_ARRAYS, True, known, np.empty((0, 0)), np.empty(0), 0.0, 0)


def unaided() -> Rule:
    """Return a rule that decides nothing, not even dominance: only the comparator itself can."""
    return nothing()._replace(dominance=False)


def asking() -> Rule:
    """Return the rule of a comparator that knows nothing: all is UNKNOWN but what is EQUAL."""
    return nothing()._replace(kind=ALWAYS_ASK, dominance=False)


def silent() -> Rule:
    """Return the rule that knows the order of the levels only: all else is UNKNOWN."""
    return nothing()._replace(kind=ORDER_ONLY)


def proven(known: Known, room: int) -> Rule:
    """Return the rule that decides by proofs about K_t, with room for so many answers."""
    return nothing()._replace(kind=PROVEN, known=known, room=room)


def outer(known: Known, inside: Floats) -> Rule:
    """Return the rule that decides by proofs about a set that contains all plausible scales.

    ``inside`` (p, m) are plausible scales, which show that both signs occur. Only the comparator
    itself can decide the differences that these leave open.
    """
    return nothing()._replace(kind=OUTER, known=known, scales=np.ascontiguousarray(inside))


def weighted(gaps: Floats, weights: Floats, level: float) -> Rule:
    """Return the rule that decides by the weight of the scales that share a sign.

    The verdict is BETTER if scales of gaps (p, m) that carry the weight ``level`` say so. The
    weights (m,) total 1.
    """
    return nothing()._replace(kind=WEIGHTED, scales=gaps, weights=weights, level=level)


def ensemble(gaps: Floats, left_out: int) -> Rule:
    """Return the rule that decides by the number of the scales that share a sign.

    The verdict is BETTER if the last of the scales of gaps (p, m) says so, and all but ``left_out``
    of the others.
    """
    return nothing()._replace(kind=ENSEMBLE, scales=gaps, level=float(left_out))


def box(low: Floats, high: Floats) -> Rule:
    """Return the rule that decides by a box of values, low (p,) to high (p,) for levels 2..k.

    The verdict is BETTER if the whole box says so.
    """
    return nothing()._replace(kind=BOX, scales=np.ascontiguousarray(np.stack([low, high], axis=1)))


def rule_of(comparator: Comparator) -> Rule:
    """Return the comparator's rule, or ``nothing()`` if it does not compare by one."""
    return cast(Ruled, comparator).rule if compares_by_rule(type(comparator)) else nothing()


@cache
def compares_by_rule(kind: type) -> bool:
    """Return whether a class of comparators has a ``rule`` that its ``compare`` follows.

    It does not if a class derived from the one with the rule has a ``compare`` of its own.
    """
    places = [*enumerate(kind.__mro__)][::-1]
    first = {
        name: i for name in ("rule", "compare") for i, parent in places if name in vars(parent)
    }
    return "rule" in first and first["rule"] <= first.get("compare", 0)


def outlasts_answers(rule: Rule) -> bool:
    """Return whether earlier verdicts of a rule still hold with this later one.

    Verdicts that are proven of K_t do, as long as K_t has points inside. In a flat K_t a preference
    can become a tie.
    """
    return rule.kind == PROVEN and not np.isnan(rule.known.inside[0])
