"""Questions of one's own making that close several open questions at once.

To show that d.e is at most a limit for each of many differences d, one can ask about each d. But
once nearly all that is plausible agrees, such an answer is known beforehand and teaches next to
nothing: it cuts off the thin part of the plausible set in which that one difference is open. A
*cut* is a difference made for the purpose, between two mixtures of levels, and goes deeper: it
takes away the parts in which several are open, and some of the rest.
"""

from collections.abc import Callable, Sequence

import numpy as np

from elicit._support.fixed_order import product
from elicit._support.threads import one_thread
from elicit.comparators.panel import Panel
from elicit.lp.hit_and_run import Draws
from elicit.model.comparator import (
    Comparator,
    best_guess,
    draws_in,
    rough_bounds,
    simultaneous_bounds,
)
from elicit.model.difference import tail_sums
from elicit.model.needs import Needs
from elicit.model.query import Answers, InconsistentAnswers, Verdict
from elicit.model.scale import Floats

# A cut is worth asking if it promises so many times what the other question does. Benchmarks on
# families of problems and random MDPs: with 1 it took questions more on most families.
_TIMES = 2.0
_WAYS = 12  # directions, from the middle towards where differences are open
_APART = 0.97  # cosine: directions closer than that count as one
_NEAR = 0.3  # cosine: differences in this direction are cut off together
_SHARES = (
    0.5,
    0.7,
    0.85,
)  # of what is plausible that a cut leaves where the answer is the likely one
# of the bound before, or of the limit: by how much bounds may be too high where cuts are weighed
_SLACK = 0.1
# Cuts left after a look at the draws; after a look at so few of the greatest bounds; and for which
# all bounds are computed.
_DRAWN, _FEW, _BOUNDED = 16, 16, 4
_ALL = slice(None)
_FLAT = 1e-9  # of the longest: directions shorter than that have no room
_GRAINS = 2.0**30  # of which a mixture of a cut is made


CUTTING = Needs(required=("simultaneous_bounds", "draws"), used=("rough_bounds",))
"""Optional parts of a comparator that cuts are chosen by."""


@one_thread
def closing_cut(
    comparator: Comparator, draws: Draws, d: Floats, high: Floats, limit: float, instead: Floats
) -> Floats | None:
    """Return the cut (k,) whose answer closes most of differences d (n, k), n > 0.

    None if the best cut promises less than ``_TIMES`` what the question ``instead`` (k,) does.

    Upper bounds ``high`` (n,) on d.e are to come down to ``limit``, and each counts by how many
    halvings it is away from that. ``draws`` say how likely each of the two answers is. The bounds
    that an answer leaves are found by telling it to the comparator, whose bounds must fall with
    answers, as a polytope's do. That is costly with many levels. So the draws choose ``_DRAWN``
    cuts, the greatest bounds choose ``_BOUNDED`` of these, and all bounds choose the one.
    Deterministic.
    """

    def promise(asked: Floats, rows: slice = _ALL) -> float:
        rest = sum(
            share * halvings_left(comparator, asked, verdict, d[rows], high[rows], limit)
            for share, verdict in _chances(asked, draws)
            if share > 0
        )
        return round(halvings(high[rows], limit) - rest, 9)

    order = np.argsort(-high, kind="stable")
    d, high = d[order], high[order]
    least = _TIMES * promise(instead)
    cuts = cuts_towards(draws, d, high, limit)
    cuts = _best(cuts, drawn_promises(cuts, draws, d, high, limit), _DRAWN)
    if len(d) > _FEW:
        cuts = _best(cuts, [promise(cut, slice(_FEW)) for cut in cuts], _BOUNDED)
    best, cut = _most_promising(cuts, promise)
    return cut if best > least else None


def _chances(asked: Floats, draws: Draws) -> tuple[tuple[float, Verdict], ...]:
    """Return the weight of the draws for which each answer about ``asked`` (k,) is right."""
    below = float(product(product(tail_sums(asked), draws.gaps) < 0, draws.weights))
    return (below, Verdict.WORSE), (1.0 - below, Verdict.BETTER)


def _most_promising(
    cuts: list[Floats], promise: Callable[[Floats], float]
) -> tuple[float, Floats | None]:
    """Return the greatest promise and its cut (k,), of equals the first; 0 and None of no cuts."""
    return max(((promise(cut), cut) for cut in cuts), key=lambda one: one[0], default=(0.0, None))


def _best(cuts: list[Floats], scores: Sequence[float], most: int) -> list[Floats]:
    """Return the cuts with the greatest scores, at most so many, of equals the first."""
    return [cuts[i] for i in np.argsort(-np.array(scores), kind="stable")[:most]]


def drawn_promises(
    cuts: list[Floats], draws: Draws, d: Floats, high: Floats, limit: float
) -> list[float]:
    """Return an estimate of the halvings that each cut (k,) saves, from draws alone.

    An answer brings a bound (n,) down in proportion to how far it brings down the greatest d.e
    among the draws, both measured from their mean.
    """
    worth = product(tail_sums(d), draws.gaps)
    mean, most = worth.mean(axis=1), worth.max(axis=1)
    steep = (high - mean) / np.maximum(most - mean, np.finfo(float).tiny)
    found = []
    for cut in cuts:
        below, rest = product(tail_sums(cut), draws.gaps) < 0, 0.0
        for side in (below, ~below):
            if side.any():
                fallen = most - worth[:, side].max(axis=1)
                with np.errstate(over="ignore", invalid="ignore"):
                    left = np.where(fallen > 0, high - steep * fallen, high)
                share = float(product(side.astype(float), draws.weights))
                rest += share * halvings(left, limit)
        found.append(round(halvings(high, limit) - rest, 9))
    return found


@one_thread
def closing_cut_of_one(
    panel: Panel, d: Floats, high: Floats, limit: float
) -> tuple[str, Floats] | None:
    """Return the cut (k,) that closes most of differences d (n, k), n > 0, if one member answers.

    The member, who comes first, is the one whose own bounds exceed their best guess by most, by
    weight and over all of d that are open. ``high`` (n,) are upper bounds on the mean d.e, which
    are to come down to ``limit``. None if no cut of theirs promises anything. Deterministic.
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

    def promise(asked: Floats) -> float:
        left = 0.0
        for share, verdict in _chances(asked, draws):
            try:
                known = member.update(Answers(asked[None], [int(verdict)])) if share > 0 else member
            except InconsistentAnswers:
                continue
            slack = _SLACK * np.maximum(limit, high) / weight
            after = np.minimum(own[name], rough_bounds(known, d, slack))
            left += share * halvings(rest + weight * after, limit)
        return round(now - left, 9)

    best, cut = _most_promising(cuts_towards(draws, d, high, limit), promise)
    return (name, cut) if cut is not None and best > 0 else None


def halvings(bounds: Floats, limit: float) -> float:
    """Return by how many halvings the bounds (n,) exceed the limit, in total."""
    return float(np.log2(np.maximum(bounds / limit, 1.0)).sum())


def halvings_left(
    comparator: Comparator,
    asked: Floats,
    verdict: Verdict,
    d: Floats,
    high: Floats,
    limit: float,
) -> float:
    """Return the halvings of bounds on d (n, k) that are left after an answer about ``asked`` (k,).

    ``high`` (n,) are the bounds before it. 0 if the answer contradicts what is known.
    """
    try:
        known = comparator.update(Answers(asked[None], [int(verdict)]))
    except InconsistentAnswers:
        return 0.0
    slack = _SLACK * np.maximum(limit, high)
    return halvings(np.minimum(high, rough_bounds(known, d, slack)), limit)


def cuts_towards(draws: Draws, d: Floats, high: Floats, limit: float) -> list[Floats]:
    """Return differences (k,), each below 0 for one of ``_SHARES`` of the draws.

    Their directions are towards where d (n, k) are open.

    A direction is a vector of tail sums. Its length is the standard deviation of d.e over the
    draws, so that the draws scatter alike to all sides, and the cosine of two directions is their
    correlation.
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
    """Return the difference (k,) of two mixtures without a level in common.

    Each mixture has total 1. The difference has tail sums t (p,) up to a positive factor, in whole
    ``_GRAINS``. So its bits are the same if draws differ by rounding, as those of answers told at
    once do from those of answers told one by one.
    """
    d = -np.diff(np.concatenate([[0.0], t, [0.0]]))
    d = np.round(d / np.maximum(d, 0.0).sum() * _GRAINS)
    more, less = d.argmax(), d.argmin()
    d[more] += _GRAINS - np.maximum(d, 0.0).sum()
    d[less] -= _GRAINS + np.minimum(d, 0.0).sum()
    return np.asarray(d / _GRAINS)
