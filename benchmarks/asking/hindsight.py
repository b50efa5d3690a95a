"""Fewest answers that could prove a policy, limits that no rule goes below, and others' rules.

- **Hindsight, greedy**: the hidden scale is known, and so is its optimal policy. Of that policy's
  advantages, over all states and actions, the truthful answer is told about the one that leaves
  least open (the total of the bounds above what matters), again and again until the policy is
  proven by the very bound that our learner stops by. This is an *upper* bound on the fewest answers
  about such advantages.
- **Pruned**: the same without answers that later ones made needless; still an upper bound.
- **Necessary**: those of them without which the answers to *all* other advantages of the policy
  prove nothing: a *lower* bound on the fewest. Where the two meet, the fewest is known. Answers to
  other questions, such as cuts made of several advantages, could be fewer still.
- **Bits**: the logarithm of the share of scales for which the policy is optimal. Scales are drawn
  uniformly, so no rule that asks questions of two answers can need fewer of them on average,
  without hindsight and a tolerance.
- With the posterior, hindsight gives truthful answers to a comparator that has to learn how often
  they are wrong, each about the advantage that leaves least of the weight of the scales under which
  some advantage matters. No pair is asked twice.

Regan and Boutilier (2009) ask *bound queries*: is a level worth more than so much? Here: the level
for certain, or a gamble between the best and the worst. ``largest_gap`` halves what is open of the
level of which most is. Their ``current_solution`` weighs that by how long the two policies of the
greatest regret stay at the level; here these are our incumbent, and the alternative of the greatest
bound.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elicit import Answers, PolytopeComparator, PosteriorComparator
from elicit.model.comparator_parts import best_guess, simultaneous_bounds
from elicit.model.difference import tail_sums
from elicit.model.query import Verdict
from elicit.model.scale import Floats
from elicit.tutors.erring_tutor import says_left
from qlearn.certificates.advantages import Advantages, advantages_over
from qlearn.certificates.loss_bound import collected, guarantee
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.mdp.planning import optimal_policy

MOST = 400  # bound queries, where a policy is not proven before
Level = Callable[[Floats, Advantages, Floats], int]


def hindsight(mdp: OrdinalMDP, values: Floats, tolerance: float) -> dict[str, float]:
    """Count a truthful tutor's answers to the polytope: by greed, pruned, and necessary; and the
    bits.
    """
    advantages = _best(mdp, values)
    matters = tolerance * (1 - mdp.discount)
    known, chosen = PolytopeComparator(mdp.k), list[int]()
    high = simultaneous_bounds(known, advantages.d)[0]
    while collected(mdp, advantages, high).max() > tolerance:
        rows = np.flatnonzero(high > matters)
        found = []
        for row in rows[~np.isin(rows, chosen)]:
            then = _told(known, advantages.d[[row]])
            bounds = np.minimum(high[rows], simultaneous_bounds(then, advantages.d[rows])[0])
            found.append((float(np.maximum(bounds - matters, 0.0).sum()), int(row), then, bounds))
        _, row, known, high[rows] = min(found, key=lambda one: one[:2])
        chosen.append(row)
    pruned = list(chosen)
    for row in chosen:
        rest = [other for other in pruned if other != row]
        if _proven(mdp, advantages, advantages.d[rest], tolerance):
            pruned = rest
    necessary = [
        row
        for row in pruned
        if not _proven(mdp, advantages, np.delete(advantages.d, row, axis=0), tolerance)
    ]
    return {
        "greedy": len(chosen),
        "pruned": len(pruned),
        "necessary": len(necessary),
        "bits": bits(advantages.d),
    }


def bits(d: Floats) -> float:
    """Return -log2 of the share of ordered scales on which no row of d (n, k) is above 0.

    It is estimated by draws from smaller and smaller sets.
    """
    known, t, total = PolytopeComparator(d.shape[1]), tail_sums(d), 0.0
    while True:
        right = t @ known.draws.gaps <= 0
        if (all_right := right.all(axis=0).mean()) > 0.3:
            return total - float(np.log2(all_right))
        share = right.mean(axis=1)
        row = int(np.argmin(np.abs(share - 0.5)))
        total -= float(np.log2(share[row]))
        known = _told(known, d[[row]])


def hindsight_of_posterior(mdp: OrdinalMDP, values: Floats, tolerance: float, seed: int) -> int:
    """Count truthful answers until the posterior, as it comes, gives the best policy its bound."""
    advantages, known = _best(mdp, values), PosteriorComparator(mdp.k, seed=seed)
    t, asked = tail_sums(advantages.d), list[int]()
    while guarantee(mdp, advantages, known, tolerance).loss_bound > tolerance:
        draws = known.draws
        scores = t @ draws.gaps
        weight = draws.weights * (
            1.0 - says_left(scores, draws.precision, known.lapse)
        )  # (n, m) after each answer
        wrong = (scores > 0.5 * tolerance).any(axis=0)
        left = np.where(
            np.isin(np.arange(len(t)), asked),
            np.inf,
            weight[:, wrong].sum(axis=1) / weight.sum(axis=1),
        )
        asked.append(int(np.argmin(left)))
        known = known.update(Answers(advantages.d[asked[-1:]], [int(Verdict.WORSE)]))
    return len(asked)


def largest_gap(gaps: Floats, advantages: Advantages, high: Floats) -> int:
    """Return the level of the widest of the gaps (p,)."""
    return int(np.argmax(gaps))


def current_solution(gaps: Floats, advantages: Advantages, high: Floats) -> int:
    """Return the level of the widest gap, weighed by how much of the level the best two plans have.

    These are the policy, and the alternative with the greatest bound, of ``high`` (n,). The greater
    of their shares counts.
    """
    row = int(np.argmax(high))
    v = advantages.v[advantages.states[row]]
    return int(np.argmax(gaps * np.maximum(v, v + advantages.d[row])))


def bound_queries(mdp: OrdinalMDP, values: Floats, tolerance: float, choose: Level) -> int:
    """Count bound queries, at most ``MOST``, until the optimum of the central scale is proven."""
    e, known, levels = mdp.normalise(values), PolytopeComparator(mdp.k), np.eye(mdp.k)
    policy = np.argmax(mdp.admissible, axis=1)
    for asked in range(MOST):
        policy = optimal_policy(mdp, best_guess(known), policy)
        advantages = advantages_over(mdp, policy)
        high = simultaneous_bounds(known, advantages.d)[0]
        if collected(mdp, advantages, high).max() <= tolerance:
            return asked
        low, up = known.bounds(levels - levels[0])
        level = choose(up - low, advantages, high)
        half = (low[level] + up[level]) / 2
        d = levels[level] - half * levels[-1] - (1.0 - half) * levels[0]
        known = known.update(Answers(d[None], [1 if e[level] > half else -1]))
    return MOST


def _best(mdp: OrdinalMDP, values: Floats) -> Advantages:
    start = np.argmax(mdp.admissible, axis=1)
    return advantages_over(mdp, optimal_policy(mdp, mdp.normalise(values), start))


def _told(known: PolytopeComparator, d: Floats) -> PolytopeComparator:
    """Return the comparator once each d.e of d (n, k) is said to be at most 0."""
    return known.update(Answers(d, np.full(len(d), int(Verdict.WORSE))))


def _proven(mdp: OrdinalMDP, advantages: Advantages, d: Floats, tolerance: float) -> bool:
    known = _told(PolytopeComparator(mdp.k), d)
    return bool(
        collected(mdp, advantages, simultaneous_bounds(known, advantages.d)[0]).max() <= tolerance
    )
