"""A comparator's knowledge as plain arrays, its *rule*, by which compiled loops decide.

A loop that compares millions of pairs cannot call Python for each comparison. It takes the
comparator's ``rule`` again after every update, and decides by ``decision.rule_kernel``. All rules
have one type, so that the deciding code is compiled once for all comparators.
"""

from functools import cache
from typing import NamedTuple, Protocol, cast, runtime_checkable

import numpy as np

from elicit.lp.primal_simplex import Known, nothing_known
from elicit.model.comparator import Comparator, Decisions
from elicit.model.query import Answers
from elicit.model.scale import Floats

NO_ARRAYS, ALWAYS_ASK, ORDER_ONLY, PROVEN, WEIGHTED, ENSEMBLE, BOX = range(7)


class Rule(NamedTuple):
    """A comparator's knowledge: a kind, and the arrays that this kind needs. Others are empty."""

    kind: int
    dominance: bool  # whether eq. (4) decides before anything else
    known: Known
    scales: Floats  # (p, m)
    weights: Floats  # (m,)
    level: float
    grows: bool  # whether compiled code may add answers to ``known`` by ``cut_at_once``


class Ruled(Protocol):
    """A comparator that gives its knowledge as a ``Rule``, by which compiled loops decide."""

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
    """A comparator that lets a compiled loop add answers to its rule, if the rule ``grows``."""

    def learned_in_loop(self, answers: Answers, rule: Rule) -> Comparator:
        """Return the comparator after strict answers that a loop has already added to ``rule``.

        The rule was the comparator's own before the loop added them.
        """


@cache
def nothing() -> Rule:
    """Return a rule that decides by dominance alone. The comparator itself decides the rest."""
    known = nothing_known(0.0, np.empty((0, 0)), np.empty(0), vertices=0)
    return Rule(NO_ARRAYS, True, known, np.empty((0, 0)), np.empty(0), 0.0, grows=False)


def unaided() -> Rule:
    """Return a rule that decides nothing, not even by dominance. The comparator itself decides."""
    return nothing()._replace(dominance=False)


def asking() -> Rule:
    """Return the rule of a comparator that knows nothing: UNKNOWN for all but equal vectors."""
    return nothing()._replace(kind=ALWAYS_ASK, dominance=False)


def silent() -> Rule:
    """Return a rule that decides by dominance alone, and says UNKNOWN if that does not decide."""
    return nothing()._replace(kind=ORDER_ONLY)


def proven(known: Known, grows: bool) -> Rule:
    """Return a rule that decides by proofs about K_t. If it ``grows``, a loop may add answers."""
    return nothing()._replace(kind=PROVEN, known=known, grows=grows)


def weighted(gaps: Floats, weights: Floats, level: float) -> Rule:
    """Return a rule that decides by the weight of scales.

    The verdict is BETTER if scales with total weight ``level`` say so. Their gaps are ``gaps`` (p,
    m), and ``weights`` (m,) total 1.
    """
    return nothing()._replace(kind=WEIGHTED, scales=gaps, weights=weights, level=level)


def ensemble(gaps: Floats, left_out: int) -> Rule:
    """Return a rule that decides by the number of scales, given by ``gaps`` (p, m).

    The last scale is a point estimate. The verdict is BETTER if it says so, and if all others
    except ``left_out`` of them do.
    """
    return nothing()._replace(kind=ENSEMBLE, scales=gaps, level=float(left_out))


def box(low: Floats, high: Floats) -> Rule:
    """Return a rule that decides by a box of scales, low (p,) to high (p,) for levels 2..k.

    The verdict is BETTER if all scales in the box say so.
    """
    return nothing()._replace(kind=BOX, scales=np.ascontiguousarray(np.stack([low, high], axis=1)))


def rule_of(comparator: Comparator) -> Rule:
    """Return the comparator's rule, or ``nothing()`` if its ``compare`` follows no rule."""
    return cast(Ruled, comparator).rule if compares_by_rule(type(comparator)) else nothing()


@cache
def compares_by_rule(kind: type) -> bool:
    """Return whether a class of comparators has a ``rule`` that its ``compare`` follows.

    A derived class with a ``compare`` of its own does not follow the rule of its base class.
    """
    places = [*enumerate(kind.__mro__)][::-1]
    first = {
        name: i for name in ("rule", "compare") for i, parent in places if name in vars(parent)
    }
    return "rule" in first and first["rule"] <= first.get("compare", 0)


def outlasts_answers(rule: Rule) -> bool:
    """Return whether earlier verdicts still hold after answers that led to this rule.

    Verdicts proven over K_t do, as long as K_t has points strictly inside. Without any, a
    preference can become a tie.
    """
    return rule.kind == PROVEN and not np.isnan(rule.known.inside[0])
