"""Questions about a multiple of a difference, which have the same answer and are easier to tell.

Two actions at one state often lead to nearly the same. A tutor who errs when little is at stake
then answers nearly by chance. Whole policies or gambles differ by more, which is why published
methods ask about those. But the sign of d.e is the same for every positive multiple of d. So a
question can shrink what both sides have in common, and enlarge what differs.
"""

from typing import Final, Literal, TypeAlias

import numpy as np

from elicit.asking.question import Pair
from elicit.model.scale import Floats

Shown: TypeAlias = Literal["magnified", "as they are"]
"""The way in which the two sides of a pair are put to the tutor."""

MAGNIFIED: Final[Literal["magnified"]] = "magnified"
AS_THEY_ARE: Final[Literal["as they are"]] = "as they are"

_SLACK = 1e-9
"""The share of the total by which a multiple may exceed the room for it. Sums are rounded, and the
choice of the power of two must not depend on rounding."""

_MOST = 2.0**20
"""The greatest multiple. It enlarges the rounding of shares, about 1e-16, to at most 1e-10, so that
a magnified pair is still recognised."""


def multiples(left: Floats, right: Floats) -> Floats:
    """Return the greatest powers of two by which differences can be multiplied.

    Parameters
    ----------
    left, right : (n, k) shares
        The two sides of each of n pairs, of the same total.

    Returns
    -------
    (n,)
        At least 1. It is 1 if the sides are equal, or have little in common.
    """
    total = np.maximum(left.sum(axis=1), right.sum(axis=1))
    apart = _apart(left, right)
    room = np.divide(total, apart, out=np.ones_like(total), where=apart > 0.0) * (1.0 + _SLACK)
    _, exponent = np.frexp(np.clip(room, 1.0, _MOST))
    return np.asarray(np.ldexp(1.0, exponent - 1))


def magnified(pair: Pair) -> Pair:
    """Return a pair with its difference multiplied by the greatest possible power of two.

    The larger side keeps its total. The common part of both sides shrinks but keeps its
    proportions. Pairs are recognised up to powers of two, so the result counts as the same pair.
    """
    times = float(multiples(pair.left[None, :], pair.right[None, :])[0])
    if times == 1.0:
        return pair
    common = np.minimum(pair.left, pair.right)
    total = max(pair.left.sum(), pair.right.sum())
    room = max(0.0, total - times * _apart(pair.left[None, :], pair.right[None, :])[0])
    shrunk = common * (room / common.sum())
    left, right = (times * (side - common) + shrunk for side in (pair.left, pair.right))
    return pair._replace(left=left, right=right)


def _apart(left: Floats, right: Floats) -> Floats:
    """Return for each pair (n,) the share of its larger side that the other side does not have."""
    more, less = np.maximum(left - right, 0.0), np.maximum(right - left, 0.0)
    return np.asarray(np.maximum(more.sum(axis=1), less.sum(axis=1)))
