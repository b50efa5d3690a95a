"""Questions made to close several open differences at once.

A learner needs to show that d.e is at most a limit for each of many differences d. It could ask
about each d. But once nearly all plausible scales agree about a d, the answer is nearly certain,
and removes only the thin part of the plausible set in which that d exceeds the limit.

A *cut* is a difference made for the purpose, between two mixtures of levels. It goes deeper into
the plausible set, and removes the parts in which several differences exceed the limit.
"""

import numpy as np

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit.comparators.panel import Panel
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import best_guess, bounds_after, draws_in, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.needs import Needs
from elicit.model.scale import Floats

# A cut is worth asking if it promises this many times as much as the other question. Benchmarks on
# families of problems and random MDPs: with 1 it took questions more on most families.
_TIMES = 2.0
_WAYS = 12  # directions, from the middle towards where differences are open
_APART = 0.97  # cosine: directions closer than that count as one
_NEAR = 0.3  # cosine: differences in this direction are cut off together
_SHARES = (
    0.5,
    0.7,
    0.85,
)  # shares of the plausible scales that a cut leaves after the likelier answer
_FLAT = 1e-9  # share of the longest direction: shorter ones have no room
_GRAINS = 2.0**30  # grains that a mixture of a cut consists of


CUTTING = Needs(required=("simultaneous_bounds", "draws"), used=("bounds_after",))
"""The optional parts of a comparator by which cuts are chosen."""


@one_thread
def closing_cut(
    comparator: Comparator, draws: Draws, d: Floats, high: Floats, limit: float, instead: Floats
) -> Floats | None:
    """Return the cut (k,) whose answer brings the bounds on differences d (n, k) down most.

    Upper bounds ``high`` (n,) on d.e, n > 0, are to come down to ``limit``. A cut is scored by the
    expected number of ``halvings`` of bounds that its answer saves. ``draws`` give the probability
    of each answer, and the comparator's ``bounds_after`` the bounds after it. No answer may raise
    them, and with a polytope none does. The result is None unless the best cut saves more than
    ``_TIMES`` as much as the question ``instead`` (k,). No randomness.
    """
    order = np.argsort(-high, kind="stable")
    d, high = d[order], high[order]
    asked = [instead, *cuts_towards(draws, d, high, limit)]
    wide = high > limit  # the others are closed, whatever is answered
    left = halvings_left(comparator, np.array(asked), d[wide], high[wide], limit)
    now, chances = halvings(high, limit), [_chances(one, draws) for one in asked]
    least, *promised = (
        round(now - float(product(*both)), 9) for both in zip(chances, left, strict=True)
    )
    best = int(np.argmax([0.0, *promised]))  # of equals the first
    return asked[best] if best and promised[best - 1] > _TIMES * least else None


def _chances(asked: Floats, draws: Draws) -> Floats:
    """Return the weights (2,) of the draws under which ``asked`` (k,) is worse, and better."""
    below = float(product(product(tail_sums(asked), draws.gaps) < 0, draws.weights))
    return np.array([below, 1.0 - below])


@one_thread
def closing_cut_of_one(
    panel: Panel, d: Floats, high: Floats, limit: float
) -> tuple[str, Floats] | None:
    """Return a panel member's name, and the cut (k,) to ask that member about.

    Upper bounds ``high`` (n,), n > 0, on the mean d.e of differences d (n, k) are to come down to
    ``limit``. The member is the one with the largest weighted distance from best guess to bound,
    added up over the differences that are still above the limit. The cut is the one whose answer by
    this member is expected to save the most ``halvings`` of bounds. The result is None if no cut
    saves any, or if the member has no draws. No randomness.
    """
    open_rows = high > limit
    own = {name: simultaneous_bounds(one, d)[0] for name, one in panel.members.items()}
    beyond = {
        name: panel.weights[name] * (own[name] - product(tail_sums(d), np.diff(best_guess(one))))
        for name, one in panel.members.items()
    }
    name = max(panel.people, key=lambda one: round(float(beyond[one][open_rows].sum()), 9))
    member, weight = panel.members[name], panel.weights[name]
    found = draws_in(member)
    if found is None:
        return None
    draws = Draws(*found)
    rest, now = high - weight * own[name], halvings(high, limit)

    cuts = cuts_towards(draws, d, high, limit)
    if not cuts:
        return None
    enough = (limit - rest) / weight
    after = np.minimum(own[name], bounds_after(member, np.array(cuts), d, enough))
    promised = [
        round(now - float(product(_chances(cut, draws), _each_halvings(left, limit))), 9)
        for cut, left in zip(cuts, rest + weight * after, strict=True)
    ]
    best = int(np.argmax(promised))
    return (name, cuts[best]) if promised[best] > 0 else None


def halvings(bounds: Floats, limit: float) -> float:
    """Return how many times the bounds (n,) must be halved to reach the limit, in total."""
    return float(np.log2(np.maximum(bounds / limit, 1.0)).sum())


def halvings_left(
    comparator: Comparator, asked: Floats, d: Floats, high: Floats, limit: float
) -> Floats:
    """Return the ``halvings`` (c, 2) that would be left after the answers "worse" and "better".

    The questions are ``asked`` (c, k). The bounds on d (n, k) before them are ``high`` (n,). An
    answer that contradicts earlier ones would leave 0.
    """
    after = np.minimum(high, bounds_after(comparator, asked, d, limit))
    return np.array([_each_halvings(left, limit) for left in after])


def _each_halvings(left: Floats, limit: float) -> Floats:
    """Return the ``halvings`` (2,) of bounds (2, n) after the answers "worse" and "better"."""
    return np.array([halvings(bounds, limit) for bounds in left])


def cuts_towards(draws: Draws, d: Floats, high: Floats, limit: float) -> list[Floats]:
    """Return candidate cuts (k,): each splits the draws so that ``_SHARES`` of them have d.e < 0.

    Each cut points along one of the d (n, k) with the greatest bounds, as a vector of tail sums.
    Lengths and angles are measured by the draws: a vector's squared length is the variance of its
    d.e over the draws, and the cosine of two vectors is the correlation of their d.e.
    """
    spread = draws.gaps - product(draws.gaps, draws.weights)[:, None]
    covariance = product(spread * draws.weights, spread.T)

    def length(ways: Floats) -> Floats:
        return np.asarray(np.sqrt(np.maximum((product(ways, covariance) * ways).sum(axis=1), 0.0)))

    ways = tail_sums(d)
    size = length(ways)
    order = np.argsort(-high, kind="stable")
    order = order[size[order] > _FLAT * size.max()]
    if not len(order):
        return []
    weight = np.log2(np.maximum(1.0 + high / limit, 1.0))
    ways[order] /= size[order, None]
    seen = product(ways, covariance)  # the cosine of ways i and j is seen[i] . ways[j]
    chosen: list[int] = []
    for i in order:
        if len(chosen) == _WAYS:
            break
        if all(product(seen[i], ways[j]) < _APART for j in chosen):
            chosen.append(i)
    means = []
    for i in [*chosen[: _WAYS // 2], None]:
        near = order if i is None else order[product(ways[order], seen[i]) > _NEAR]
        means.append(product(weight[near], ways[near]))
    middle = np.array(means)
    size = length(middle)
    some = size > 1e-9
    found = []
    for t in [*ways[chosen], *(middle[some] / size[some, None])]:
        for height in np.quantile(
            product(t, draws.gaps), _SHARES
        ):  # gaps total 1: a constant in t shifts the cut
            found.append(_difference(t - height))
    return found


def _difference(t: Floats) -> Floats:
    """Return the difference (k,) whose tail sums are t (p,) times a positive factor.

    It is the difference of two mixtures of total 1 that have no level in common, rounded to whole
    ``_GRAINS``. The rounding removes differences in the draws' last bits, such as those between
    learning answers at once and one by one.
    """
    d = -np.diff(np.concatenate([[0.0], t, [0.0]]))
    d = np.round(d / np.maximum(d, 0.0).sum() * _GRAINS)
    more, less = d.argmax(), d.argmin()
    d[more] += _GRAINS - np.maximum(d, 0.0).sum()
    d[less] -= _GRAINS + np.minimum(d, 0.0).sum()
    return np.asarray(d / _GRAINS)
