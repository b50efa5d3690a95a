"""Declarations of the optional parts of a comparator that a learner or a strategy uses.

A declaration takes one line. It is checked when the learner is made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from elicit.model.comparator import Comparator, check_comparator_made, offers
from elicit.model.comparator_parts import OPTIONAL_PARTS, unordered_of

_F = TypeVar("_F", bound=Callable[..., object])
_PARTS = {part.member: part for part in OPTIONAL_PARTS}


@dataclass(frozen=True)
class Needs:
    """The optional parts of a comparator that a consumer requires or uses.

    A consumer is a learner or a strategy, and declares them as its attribute ``needs``. ``a | b``
    joins two declarations.

    Parameters
    ----------
    required : names
        Members without which the consumer refuses a comparator.
    used : names
        Members that are used if the comparator has them. ``OPTIONAL_PARTS`` says what happens
        without.
    open_order : bool
        Whether the consumer accepts a comparator that leaves the order of two levels open.

    Raises
    ------
    ValueError
        If a name is not that of an optional part.
    """

    required: tuple[str, ...] = ()
    used: tuple[str, ...] = ()
    open_order: bool = False

    def __post_init__(self) -> None:
        if unknown := [name for name in self.required + self.used if name not in _PARTS]:
            raise ValueError(f"{unknown[0]!r} is no optional part of a comparator: {[*_PARTS]}")

    def __or__(self, other: Needs) -> Needs:
        return Needs(
            tuple(dict.fromkeys(self.required + other.required)),
            tuple(dict.fromkeys(self.used + other.used)),
            self.open_order or other.open_order,
        )

    def missing(self, comparator: Comparator) -> tuple[str, ...]:
        """Return the required members that a comparator does not have, without computing any.

        Parameters
        ----------
        comparator : Comparator

        Returns
        -------
        tuple of str
            Their names, in the order of ``required``.
        """
        return tuple(name for name in self.required if not offers(comparator, name))


def uses(*members: str) -> Callable[[_F], _F]:
    """Decorate a function with the optional parts that it uses if the comparator has them."""

    def declared(function: _F) -> _F:
        vars(function)["needs"] = Needs(used=members)
        return function

    return declared


def needs_of(consumer: object) -> Needs:
    """Return what a consumer declares as its ``needs``; empty Needs if it declares nothing."""
    declared = getattr(consumer, "needs", None)
    return declared if isinstance(declared, Needs) else Needs()


def check_needs(comparator: Comparator, *consumers: object) -> None:
    """Raise TypeError unless the object is a comparator with all parts that consumers require.

    The error names the part, the consumer that needs it, and the comparators that have it. If the
    comparator leaves the order of two levels open and a consumer does not accept that, ValueError
    is raised: the bounds of most learners start from the order.
    """
    check_comparator_made(comparator)
    open_step = unordered_of(comparator)
    if open_step is not None and not any(needs_of(one).open_order for one in consumers):
        low, high = (level + 1 for level in open_step)
        raise ValueError(
            f"{type(comparator).__name__} leaves the order of levels {low} and {high} open, and "
            "this learner needs the levels in a fixed order: take InteractivePolicyIteration, or "
            f"decide which level is the worse and take PolytopeComparator({comparator.k})"
        )
    for consumer in consumers:
        for member in needs_of(consumer).missing(comparator):
            part = _PARTS[member]
            raise TypeError(
                f"{type(comparator).__name__} has no {member}, which "
                f"{getattr(consumer, '__name__', repr(consumer))} needs ({part.gives}). "
                f"{', '.join(part.offered_by)} have it; elicit.testing says what makes a comparator"
            )
