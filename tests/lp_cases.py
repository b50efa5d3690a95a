"""Random and adversarial polytopes, and an exact second opinion on them that shares no code with
elicit's methods.

A ``Case`` is a set of answers that some hidden scale satisfies exactly, with differences to ask
about. ``Region`` states its polytope in rationals, from the tail sums of the float differences.
``Oracle`` gives least t.g over it: elicit's simplex method in floats proposes a basis, which is
verified in rationals (primal and dual feasibility); where that fails, a primal simplex method on
the dual program, in exact integers, decides.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elicit import Answers, PolytopeComparator
from elicit.lp import region as floats
from elicit.lp.dual_simplex import minimise, minimise_exactly
from elicit.lp.primal_simplex import CERTAIN_POINT, DOUBTFUL_VERTEX, USED, Known
from elicit.lp.rounding import EPS
from elicit.lp.vertex_store import start
from elicit.model.difference import MOST
from elicit.model.difference_kernel import to_order_one

Floats = NDArray[np.float64]
Rationals = list[Fraction]
TIE_BAND = Fraction(1e-9)


def tails(d: Sequence[float]) -> list[float]:
    """The float tail sums (k-1,) of d (k,), added from the best level down."""
    total, out = 0.0, []
    for x in reversed([float(x) for x in d[1:]]):
        total += x
        out.append(total)
    return out[::-1]


def exact(numbers: Sequence[float]) -> Rationals:
    return [Fraction(float(x)) for x in numbers]


def whole(numbers: Sequence[Fraction]) -> tuple[list[int], int]:
    """Fractions as integers over one denominator."""
    below = [x.denominator for x in numbers]
    unit = math.lcm(*below)
    return [x.numerator * (unit // d) for x, d in zip(numbers, below, strict=True)], unit


def added(numbers: Iterable[Fraction]) -> Fraction:
    """The sum, in integers: Fractions would be reduced to lowest terms after each step."""
    whole_numbers, unit = whole(list(numbers))
    return Fraction(sum(whole_numbers), unit)


def dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    (m, unit_a), (n, unit_b) = whole(a), whole(b)
    return Fraction(sum(x * y for x, y in zip(m, n, strict=True)), unit_a * unit_b)


@dataclass
class Region:
    """{g : g >= margin, sum g = 1, rows g >= rhs} in Fractions; each row's largest entry is of
    order 1.
    """

    p: int
    margin: Fraction
    rows: list[Rationals]
    rhs: Rationals

    def add(self, row: Rationals, limit: Fraction) -> None:
        size = max(map(abs, row), default=Fraction(0))
        unit = (
            Fraction(2) ** math.frexp(float(size))[1]
            if float(size) > 2.0**-1000
            else (size or Fraction(1))
        )
        self.rows.append([x / unit for x in row])
        self.rhs.append(limit / unit)

    def contains(self, g: Rationals) -> bool:
        rows = all(dot(row, g) >= limit for row, limit in zip(self.rows, self.rhs, strict=True))
        return added(g) == 1 and min(g) >= self.margin and rows


def region_of(
    k: int,
    margin: float,
    prior: tuple[Floats, Floats] | None,
    d: Floats,
    y: Sequence[int],
    only: Sequence[int] | None = None,
    tie: float = 0.0,
) -> Region:
    """K_t of answers (d, y), or of those numbered ``only``; "equal" means within ``tie``."""
    p = k - 1
    region = Region(p, Fraction(1, p) if margin == 1.0 / p else Fraction(margin), [], [])
    if prior is not None:
        for a, b in zip(*prior, strict=True):
            t = tails(a)
            region.add(exact(t), Fraction(float(b)))
    for i in range(len(y)) if only is None else only:
        t = tails(d[i])
        if not any(t):
            continue
        band = (
            max(TIE_BAND * sum(map(abs, exact(d[i]))), Fraction(tie)) if y[i] == 0 else Fraction(0)
        )
        for sign in (1, -1) if y[i] == 0 else (int(y[i]),):
            region.add([sign * x for x in exact(t)], -band)
    return region


class Oracle:
    """Least t.g over one region, exactly. ``verified`` counts how often a basis did."""

    def __init__(self, region: Region) -> None:
        self.region = region
        self.verified = 0
        self._rows = np.array([[float(x) for x in row] for row in region.rows]).reshape(
            -1, region.p
        )
        self._rhs = np.array([float(x) for x in region.rhs])
        self._floats = floats.Region(
            float(region.margin), self._rows, self._rhs, np.arange(len(self._rhs))
        )

    def least(self, t: Rationals) -> Fraction:
        """The exact optimum of min t.g. Raises ValueError where the region is empty."""
        size = max(map(abs, t))
        if size == 0:
            return Fraction(0)
        unit = [x / size for x in t]
        value = self._verify(unit, self._basis(unit))
        if value is not None:
            self.verified += 1
        else:
            value = least_from_scratch(unit, self.region)
        if value is None:
            raise ValueError("the region is empty")
        return value * size

    def range(self, t: Rationals) -> tuple[Fraction, Fraction]:
        """Least and greatest t.g."""
        return self.least(t), -self.least([-x for x in t])

    def _basis(self, t: Rationals) -> tuple[list[int], list[int]]:
        """(gaps that are basic, rows that are active) as elicit's simplex method ends."""
        p, basis = self.region.p, minimise(np.array([float(x) for x in t]), self._floats).basis
        return [j for j in range(p) if j not in basis], [c - p for c in basis if c >= p]

    def _verify(self, t: Rationals, basis: tuple[list[int], list[int]]) -> Fraction | None:
        """The value at the basis if it is a feasible and optimal one in rationals, else None."""
        region, (free, active) = self.region, basis
        if len(free) != len(active) + 1:
            return None
        fixed = [j for j in range(region.p) if j not in set(free)]
        matrix = [[Fraction(1)] * len(free)] + [[region.rows[i][j] for j in free] for i in active]
        at_margin = [added(region.rows[i][j] for j in fixed) * region.margin for i in active]
        limits = [1 - len(fixed) * region.margin]
        limits += [region.rhs[i] - m for i, m in zip(active, at_margin, strict=True)]
        x = solve_exactly(matrix, limits)
        y = solve_exactly(
            [list(column) for column in zip(*matrix, strict=True)], [t[j] for j in free]
        )
        if x is None or y is None or min(y[1:], default=Fraction(0)) < 0 or min(x) < region.margin:
            return None
        g = [region.margin] * region.p
        for j, value in zip(free, x, strict=True):
            g[j] = value
        for j in fixed:
            if t[j] - y[0] < dot(y[1:], [region.rows[i][j] for i in active]):
                return None
        slack = self._rows @ np.array([float(v) for v in g]) - self._rhs
        for i in np.flatnonzero(slack < 1e-6):  # rows are of order 1: the others hold beyond doubt
            if dot(region.rows[i], g) < region.rhs[i]:
                return None
        return dot(t, g)


def solve_exactly(matrix: list[Rationals], right: Rationals) -> Rationals | None:
    """x with matrix x = right by fraction-free elimination (Bareiss 1968); None where singular."""
    n = len(matrix)
    work = [whole([*row, b])[0] for row, b in zip(matrix, right, strict=True)]
    last = 1
    for c in range(n):
        pivot = next((i for i in range(c, n) if work[i][c]), None)
        if pivot is None:
            return None
        work[c], work[pivot] = work[pivot], work[c]
        head = work[c]
        for i in range(n):
            if i != c:
                row, factor = work[i], work[i][c]
                work[i] = [
                    (head[c] * a - factor * b) // last for a, b in zip(row, head, strict=True)
                ]
        last = head[c]
    return [Fraction(row[n], row[i]) for i, row in enumerate(work)]


def least_from_scratch(t: Rationals, region: Region) -> Fraction | None:
    """Least t.g over the region; None where it is empty.

    The dual program, with h = g - margin >= 0, sum h = F, rows h >= r: maximise F mu + r.y subject
    to mu + y rows <= t, y >= 0. Primal simplex on it, in integers over one denominator, from y = 0
    and mu = min t.
    """
    p, m, low = region.p, len(region.rows), min(t)
    total = 1 - p * region.margin
    limits = [
        limit - region.margin * added(row)
        for row, limit in zip(region.rows, region.rhs, strict=True)
    ]
    # columns: mu+, mu-, the multipliers, the slacks, the right-hand side; last row: the objective
    tableau = np.zeros((p + 1, m + p + 3), dtype=object)
    unit_t = whole([x - low for x in t])[1]
    for j in range(p):
        tableau[j, 0], tableau[j, 1], tableau[j, 2 + m + j] = 1, -1, 1
        tableau[j, -1] = int((t[j] - low) * unit_t)
    common = math.lcm(total.denominator, *(x.denominator for x in limits))
    for i, row in enumerate(region.rows):
        ints, unit = whole([*row, limits[i] * common])
        tableau[:p, 2 + i], tableau[p, 2 + i] = ints[:-1], ints[-1]
        assert unit >= 1
    tableau[p, 0], tableau[p, 1] = int(total * common), -int(total * common)
    basis = list(range(2 + m, 2 + m + p))
    denominator, steps = 1, 0
    while True:
        gains = tableau[p, :-1]
        rising = [c for c in range(m + p + 2) if gains[c] > 0]
        if not rising:
            return (
                low * total
                + Fraction(-tableau[p, -1], denominator * common * unit_t)
                + region.margin * added(t)
            )
        # the best relative gain at first, then the first (Bland 1977), which ends
        size = (
            [max(abs(tableau[i, c]) for i in range(p)) or 1 for c in rising]
            if steps < 20 * p
            else []
        )
        entering = (
            max(zip(rising, size, strict=True), key=lambda cs: (gains[cs[0]] << 64) // cs[1])[0]
            if size
            else rising[0]
        )
        steps += 1
        column = tableau[:p, entering]
        ratios = [
            (Fraction(tableau[i, -1], column[i]), basis[i], i) for i in range(p) if column[i] > 0
        ]
        if not ratios:
            return None
        leaving = min(ratios)[2]
        head, pivot = tableau[leaving].copy(), tableau[leaving, entering]
        tableau = (tableau * pivot - np.outer(tableau[:, entering], head)) // denominator
        tableau[leaving] = head
        denominator = pivot
        basis[leaving] = entering


def is_empty(region: Region) -> bool:
    """Return whether no g satisfies the region's constraints."""
    return least_from_scratch([Fraction(0)] * region.p, region) is None


def verdict(least: Fraction, greatest: Fraction) -> int:
    """The verdict of exact extremes: 1 better, -1 worse, 0 equal, 2 unknown."""
    if least == greatest == 0:
        return 0
    if least >= 0:
        return 1
    return -1 if greatest <= 0 else 2


@dataclass
class Case:
    """Answers that the hidden gaps ``truth`` satisfy exactly, and differences ``ask`` (q, k)."""

    kind: str
    k: int
    margin: float
    prior: tuple[Floats, Floats] | None
    d: Floats
    y: NDArray[np.int8]
    ask: Floats
    truth: Rationals
    tie: float = 0.0

    def region(self) -> Region:
        return region_of(self.k, self.margin, self.prior, self.d, list(self.y), tie=self.tie)

    def known(self) -> PolytopeComparator:
        """A comparator that was told the answers at once."""
        return PolytopeComparator(self.k, self.margin, self.prior, self.tie).update(
            Answers(self.d, self.y)
        )


Rng = np.random.Generator


def from_tails(t: Sequence[float], exactly: bool = True) -> Floats:
    """A difference (k,) whose tail sums are t, exactly so for t of few bits: level 1 makes the
    total 0.
    """
    t = np.asarray(t, dtype=np.float64)
    d = np.append(t[:-1] - t[1:], t[-1])
    out = np.concatenate([[-float(np.sum(d))], d])
    assert not exactly or tails(out) == list(t)
    return out


def shares(rng: Rng, k: int, n: int, spread: float = 0.7) -> Floats:
    out: Floats = rng.dirichlet(np.full(k, spread), size=n) - rng.dirichlet(
        np.full(k, spread), size=n
    )
    return out.reshape(n, k)


def draw_truth(rng: Rng, p: int) -> Rationals:
    weights = [
        int(x) for x in np.ceil(rng.dirichlet(np.full(p, rng.choice([0.3, 1.0, 5.0]))) * 1000)
    ]
    return [Fraction(w, sum(weights)) for w in weights]


def few_bits(rng: Rng, p: int, most: int) -> tuple[Rationals, list[int]]:
    """Gaps in the ratio of whole numbers below ``most``, and these."""
    weights = [int(w) for w in rng.integers(1, most, size=p)]
    return [Fraction(w, sum(weights)) for w in weights], weights


def sign_of(d: Sequence[float], truth: Rationals) -> int:
    value = dot(exact(tails(d)), truth)
    return (value > 0) - (value < 0)


def answered(rng: Rng, d: Floats, truth: Rationals) -> NDArray[np.int8]:
    """Truthful answers; an exact tie is answered -1, 0 or +1, all of which are true."""
    return np.array([sign_of(row, truth) or int(rng.integers(-1, 2)) for row in d], dtype=np.int8)


def below(x: Fraction) -> float:
    """The greatest float that is at most x."""
    f = float(x)
    return f if Fraction(f) <= x else math.nextafter(f, -math.inf)


def tie_with(rng: Rng, truth: Rationals) -> Floats:
    """A difference of few bits that is exactly 0 under the truth; no difference where the truth has
    too many bits.
    """
    weights, _ = whole(truth)
    t = np.zeros(len(truth))
    if len(truth) > 1 and max(weights) < 2**50:
        a, b = rng.choice(len(truth), 2, replace=False)
        t[a], t[b] = weights[b], -weights[a]
    return from_tails(t)


def random_margin(rng: Rng, truth: Rationals) -> float:
    least = below(min(truth))
    return float(rng.choice([0.0, min(1e-6, least), least / 2, least]))


def questions(rng: Rng, d: Floats, truth: Rationals, count: int) -> Floats:
    """Return differences to ask about.

    They are fresh ones, cuts and differences near these, combinations, ties, and zero.
    """
    p = len(truth)
    k = p + 1

    def cut() -> Floats:
        return np.array(d[rng.integers(len(d))]) if len(d) else shares(rng, k, 1)[0]

    def near() -> Floats:
        return cut() + 10.0 ** rng.uniform(-16, -6) * rng.normal(size=k) * (
            np.abs(cut()).max() or 1.0
        )

    def combination() -> Floats:
        some = rng.integers(len(d), size=rng.integers(1, 5)) if len(d) else []
        signs = [sign_of(d[i], truth) or 1 for i in some]
        weights = (
            rng.integers(1, 4, size=len(some)) if rng.random() < 0.5 else rng.random(len(some))
        )
        total = np.zeros(k)
        for i, s, w in zip(some, signs, weights, strict=True):
            total = total + s * w * d[i] / (np.abs(d[i]).max() or 1.0)
        return total if rng.random() < 0.5 else -total

    makers: list[Callable[[], Floats]] = [
        lambda: shares(rng, k, 1)[0],
        lambda: shares(rng, k, 1)[0],
        lambda: shares(rng, k, 1)[0] * 10.0 ** rng.integers(-15, 2),
        cut,
        lambda: -cut() * 2.0 ** rng.integers(-30, 30),
        lambda: cut() * 3.0,
        near,
        near,
        combination,
        combination,
        lambda: tie_with(rng, truth),
        lambda: np.eye(k)[rng.integers(k)] - np.eye(k)[rng.integers(k)],
        lambda: np.zeros(k),
    ]
    with np.errstate(all="ignore"):
        made = [makers[rng.integers(len(makers))]() for _ in range(count)]
    return np.array([one if np.isfinite(one).all() else cut() for one in made])


def _case(
    kind: str,
    rng: Rng,
    truth: Rationals,
    margin: float,
    d: Floats,
    asks: int,
    y: NDArray[np.int8] | None = None,
) -> Case:
    d = np.asarray(d, dtype=np.float64).reshape(-1, len(truth) + 1)
    y = answered(rng, d, truth) if y is None else y
    return Case(kind, len(truth) + 1, margin, None, d, y, questions(rng, d, truth, asks), truth)


def plain(rng: Rng, k: int, n: int, asks: int) -> Case:
    truth = draw_truth(rng, k - 1)
    return _case("plain", rng, truth, random_margin(rng, truth), shares(rng, k, n), asks)


def duplicated(rng: Rng, k: int, n: int, asks: int) -> Case:
    truth = draw_truth(rng, k - 1)
    base = shares(rng, k, n // 4 + 1)
    d = np.concatenate([base, base, 2 * base, -3 * base, np.zeros((2, k)), 1e-12 * base])
    return _case(
        "duplicated",
        rng,
        truth,
        random_margin(rng, truth),
        d[rng.permutation(len(d))][: n + 1],
        asks,
    )


def parallel(rng: Rng, k: int, n: int, asks: int) -> Case:
    truth = draw_truth(rng, k - 1)
    base = shares(rng, k, 3)[rng.integers(3, size=n + 2)]
    tiny = 10.0 ** rng.uniform(-16, -6, size=(len(base), 1)) * rng.normal(size=base.shape)
    return _case("parallel", rng, truth, random_margin(rng, truth), base + tiny, asks)


def equalities(d: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return the prior that says d.e = 0 of each of these differences."""
    return np.array([s * row for row in d for s in (1, -1)]), np.zeros(2 * len(d))


def pinned(rng: Rng, k: int, n: int, asks: int) -> Case:
    """Ties, by the prior, hold K_t to a flat: to a single point where there are k - 2 of them."""
    truth, weights = few_bits(rng, k - 1, 60)
    ties = []
    for j in range(1, k - 1):
        t = np.zeros(k - 1)
        t[0], t[j] = weights[j], -weights[0]
        ties.append(from_tails(t))
    ties = ties[: int(rng.integers(1, k - 1))] if k > 2 and rng.random() < 0.4 else ties
    case = _case("pinned", rng, truth, random_margin(rng, truth), shares(rng, k, min(n, 10)), asks)
    if ties:
        case.prior = equalities(ties)
    return case


def tied(rng: Rng, k: int, n: int, asks: int) -> Case:
    """Answers "equal": to exact ties and to pairs inside the band of 1e-9 |d|_1, or inside that of
    a wider tie.
    """
    truth, _ = few_bits(rng, k - 1, 60)
    ties = np.array([tie_with(rng, truth) for _ in range(int(rng.integers(1, 5)))])
    tie = float(rng.choice([0.0, 0.0, 0.0, 0.01, 0.2]))
    off = tie or 1e-10 * np.abs(ties).max()
    ties = ties + (rng.random() < 0.7) * off * rng.uniform(-1, 1, size=ties.shape)
    more = shares(rng, k, min(n, 30))
    y = np.concatenate([np.zeros(len(ties), dtype=np.int8), answered(rng, more, truth)])
    d = np.concatenate([ties, more])
    for i in range(len(ties)):
        value = abs(dot(exact(tails(d[i])), truth))
        if value > max(TIE_BAND * sum(map(abs, exact(d[i]))), Fraction(tie)):
            y[i] = sign_of(d[i], truth)
    return replace(_case("tied", rng, truth, random_margin(rng, truth), d, asks, y), tie=tie)


def opposite(rng: Rng, k: int, n: int, asks: int) -> Case:
    """A pair of shares that the prior calls equal: the truth lies exactly on the cut."""
    for _ in range(100):
        d = shares(rng, k, 1)[0]
        t = exact(tails(d))
        a, b = draw_truth(rng, k - 1), draw_truth(rng, k - 1)
        high, low = dot(t, a), dot(t, b)
        if high > 0 > low:
            truth = [(high * v - low * u) / (high - low) for u, v in zip(a, b, strict=True)]
            more = shares(rng, k, min(n, 20))
            case = _case("opposite", rng, truth, min(1e-6, below(min(truth))), more, asks)
            case.prior = equalities([d])
            return case
    return plain(rng, k, n, asks)


def touching(rng: Rng, k: int, n: int, asks: int) -> Case:
    """An answer whose cut meets K_0 in one vertex, or (k > 3, half the time) in an edge."""
    p = k - 1
    q = int(rng.integers(5, 11))
    best = [int(j) for j in rng.choice(p, 2 if p > 2 and rng.random() < 0.5 else 1, replace=False)]
    # with margin 2^-q, t.g at the vertex of a best gap is (sum of the others' t + (2^q - p + 1)
    # t_best) / 2^q
    others = [j for j in range(p) if j not in best]
    t = np.zeros(p)
    t[best] = 1.0
    need = 2**q - p + len(best)
    for _ in range(need) if others else ():
        t[rng.choice(others)] -= 1
    if not others:
        t[:] = 0.0
    share = int(rng.integers(0, 2**q - p + 1)) if len(best) == 2 else 0
    weights = [1] * p
    weights[best[0]] += 2**q - p - share
    weights[best[-1]] += share
    truth = [Fraction(w, 2**q) for w in weights]
    d = np.concatenate([[from_tails(t)], shares(rng, k, min(n, 10))])
    return _case(
        "touching", rng, truth, 2.0**-q, d, asks, np.append(np.int8(1), answered(rng, d[1:], truth))
    )


def with_prior(rng: Rng, k: int, n: int, asks: int) -> Case:
    """Prior inequalities A e >= b of all sizes, half of them tight at the truth."""
    truth = draw_truth(rng, k - 1)
    a = rng.normal(size=(int(rng.integers(1, 8)), k)) * 10.0 ** rng.integers(-5, 6)
    if rng.random() < 0.5:
        a = rng.integers(-2, 3, size=a.shape).astype(float)
    values = [dot(exact(tails(row)), truth) for row in a]
    size = np.abs(a).max(axis=1)
    b = np.array(
        [
            below(v - Fraction(float(s * rng.choice([0, 0.1]))))
            for v, s in zip(values, size, strict=True)
        ]
    )
    case = _case("prior", rng, truth, random_margin(rng, truth), shares(rng, k, min(n, 60)), asks)
    case.prior = (a, b)
    return case


def closed_gaps(rng: Rng, k: int, n: int, asks: int) -> Case:
    """Margin 0 and a truth with gaps of 0, which answers against dominance show."""
    truth = draw_truth(rng, k - 1)
    dead = rng.random(k - 1) < 0.4
    dead[rng.integers(k - 1)] = False
    kept = added(g for g, gone in zip(truth, dead, strict=True) if not gone)
    truth = [Fraction(0) if gone else g / kept for g, gone in zip(truth, dead, strict=True)]
    flat = np.array(
        [from_tails(np.where(np.arange(k - 1) == j, 1.0, 0.0)) for j in np.flatnonzero(dead)]
    )
    more = shares(rng, k, min(n, 30))
    y = np.concatenate([-np.ones(len(flat), dtype=np.int8), answered(rng, more, truth)])
    case = _case("closed", rng, truth, 0.0, np.concatenate([flat.reshape(-1, k), more]), asks, y)
    for i in range(asks // 2):
        case.ask[i] = from_tails(rng.integers(0, 2, size=k - 1).astype(float))
    return case


def equal_gaps(rng: Rng, k: int, n: int, asks: int) -> Case:
    """A margin of 1/(k-1): K_0 is one point."""
    truth = [Fraction(1, k - 1)] * (k - 1)
    case = _case("equal gaps", rng, truth, 1.0 / (k - 1), shares(rng, k, min(n, 30)), asks)
    case.ask[0] = from_tails(rng.permutation(np.append(np.zeros(k - 1), [1.0, -1.0]))[: k - 1])
    return case


def extreme(rng: Rng, k: int, n: int, asks: int) -> Case:
    """Differences as large as they may be, and as small as floats can be."""
    truth = draw_truth(rng, k - 1)
    d = shares(rng, k, min(n, 40) + 1)
    exponents = rng.choice([999, 970, 0, -900, -1060, -1073], size=(len(d), 1))
    d = np.ldexp(d, exponents)
    case = _case("extreme", rng, truth, random_margin(rng, truth), d, asks)
    powers = rng.choice([1e301, 1e280, 1e-12, 1e-300, 1e-320], size=(asks // 2, 1))
    case.ask[: asks // 2] = shares(rng, k, asks // 2) / 2 * powers
    case.ask[np.abs(case.ask).max(axis=1) > MOST] *= 2.0**-40  # beyond it they are refused
    return case


def thin(rng: Rng, k: int, n: int, asks: int) -> Case:
    """K_t between a prior inequality and an answer nearly opposite to it."""
    case = opposite(rng, k, n, asks)
    if case.kind != "opposite":
        return case
    assert case.prior is not None
    across = case.prior[0][0]
    t = np.array(tails(across))
    width = 10.0 ** rng.uniform(-14, -7)
    # t.g >= 0 and (t - width).g <= 0: for g of total 1 this leaves a slab of that width
    case.prior = across[None], np.zeros(1)
    case.d = np.concatenate([[from_tails(t - width, exactly=False)], case.d])
    case.y = np.array([sign_of(case.d[0], case.truth) or -1, *case.y], dtype=np.int8)
    case.ask[0] = case.d[0]
    case.kind = "thin"
    return case


KINDS: tuple[Callable[[Rng, int, int, int], Case], ...] = (
    *(plain, plain, plain, duplicated, parallel, pinned, tied),
    *(opposite, touching, with_prior, closed_gaps, equal_gaps, extreme, thin),
)


def cases(
    seed: int | list[int], count: int, asks: int = 4, most_levels: int = 25, most_answers: int = 300
) -> Iterator[Case]:
    """``count`` cases, the kinds in turn; small k and n are drawn more often, since they cost
    less.
    """
    for i in range(count):
        rng = np.random.default_rng([*np.atleast_1d(seed), i])
        k = 2 + int((most_levels - 1) * rng.random() ** 2)
        n = int((most_answers + 1) * rng.random() ** 3)
        yield KINDS[i % len(KINDS)](rng, k, n, asks)


def region(rows: Any, margin: float = 0.0, rhs: Any = None) -> floats.Region:
    rows = np.array(rows, dtype=np.float64)
    limits = np.zeros(len(rows)) if rhs is None else np.array(rhs, dtype=np.float64)
    return floats.Region(margin, rows, limits, np.arange(len(rows)))


def exactly(r: floats.Region) -> Region:
    """Return the same region in rationals."""
    out = Region(r.p, r.exact_margin, [], [])
    for row, limit in zip(r.rows, r.rhs, strict=True):
        out.add(exact(row), Fraction(float(limit)))
    return out


def normalised(g: Any) -> Rationals:
    """Return floats g divided by their total, exactly."""
    numbers = exact(g)
    total = added(numbers)
    return [x / total for x in numbers]


def known_sets(seed: int, count: int, most: int = 9) -> Iterator[tuple[str, floats.Region, Known]]:
    """Regions of each kind in turn, with at least two gaps, and what is known of them at first."""
    for case in cases(seed, count, asks=1, most_levels=most, most_answers=3 * most):
        if case.k > 2:
            r = case.known().region
            yield case.kind, r, start(r)


def objectives(rng: Rng, r: floats.Region, count: int) -> list[Floats]:
    """Return objectives of order 1.

    They are random ones, rows and sums of rows, and such whose least value is 0, or nearly.
    """
    out = []
    for _ in range(count):
        s = rng.normal(size=r.p) * 10.0 ** rng.integers(-3, 1)
        how = rng.integers(4)
        if how == 1:
            s = rng.integers(0, 3, size=len(r.rows)) @ r.rows + rng.choice([0.0, 1e-16, -1e-13]) * s
        if how > 1:
            s = (
                s
                - float(minimise_exactly(s, r).value)
                + rng.choice([0.0, 1e-16, -1e-15, 1e-13, 1e-12, -1e-12, 1e-10])
            )
        if s.any():
            to_order_one(s)
            out.append(s)
    return out


def rows_kept(c: PolytopeComparator) -> int:
    """Return how many of a comparator's rows are left without those that follow from others."""
    return len(c._set.region.rows)


def check_proofs(c: PolytopeComparator) -> None:
    """Check in rationals that a comparator's stored facts are true.

    They are rows that hold on K_t, points in it, and one strictly inside. Only this function and
    ``rows_kept`` look at how facts are stored.
    """
    kept, known = c._set.region, c._set._known

    def least_slack(g: Rationals) -> Fraction:
        near = np.array([float(x) for x in g])
        rows = np.flatnonzero(kept.rows @ near - kept.rhs < 1e-9)  # the others hold beyond doubt
        slacks = [dot(exact(kept.rows[i]), g) - Fraction(float(kept.rhs[i])) for i in rows]
        return min([*slacks, min(g) - kept.exact_margin])

    for row, limit in zip(
        c.region.rows, c.region.rhs, strict=True
    ):  # those left out follow from those kept
        if not ((kept.rows == row).all(axis=1) & (kept.rhs == limit)).any():
            assert minimise_exactly(row, kept).value >= Fraction(float(limit))
    assert all(minimise_exactly(row, kept).value >= 0 for row in known.rows)
    if c._set.inside is not None:
        assert least_slack(normalised(known.inside)) > 0
    used = known.counts[USED]
    for point, kind in zip(known.points[:, :used].T, known.kind[:used], strict=True):
        if kind != DOUBTFUL_VERTEX:  # points of exact optima are right to their last bits
            assert least_slack(normalised(point)) >= -(kept.p + 8) * Fraction(EPS) * (
                kind == CERTAIN_POINT
            )
