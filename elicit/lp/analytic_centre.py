"""The analytic centre of K_t, the set of scales that fit the answers.

It is the point that maximises the product of its distances to all constraints. The polytope uses it
as its single best guess at the scale (``values``). It is also strictly inside K_t, so it proves the
sign of d.e for one plausible scale.
"""

import hashlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from elicit._support.fixed_order import LeastSquares, null_basis, product, sums_to_zero
from elicit._support.threads import one_thread
from elicit.lp.dual_simplex import Numbers, minimise_exactly
from elicit.lp.region import Region
from elicit.model.scale import Floats

_FLAT = 1e-12  # if no point of the region has a larger slack, the slack counts as 0
_BAND = 1e-8  # two opposite rows with less room between them are replaced by its middle
_MOST_REMEMBERED = 10_000  # centres; then it begins anew
_REMEMBERED: dict[bytes, Floats] = {}  # by a hash of the constraints

Flags = NDArray[np.bool_]


class _Shape(NamedTuple):
    """All constraints of a region, rows (m, p) and limits (m,), sorted.

    So nothing that is computed from them depends on the order of the answers.
    """

    rows: Floats
    limits: Floats
    size: Floats  # (m,) largest entry of each row


class _Hull(NamedTuple):
    """The affine hull {g : equal g = to, sum g = 1} of a region with no interior.

    ``flat`` flags the constraints that hold with equality in the whole region.
    """

    flat: Flags
    equal: Floats
    to: Floats


def analytic_centre(region: Region) -> Floats:
    """Return the analytic centre g (p,) of the region, or of its relative interior if it is flat.

    The result depends only on the set of constraints. It is found by ``climb``, from the point with
    the greatest least slack. Results are remembered, because the same sets come again: all runs on
    the same levels begin with one, and a session that is resumed goes through those of before.
    """
    shape = _canonical(region)
    digest = hashlib.blake2b(repr(shape.rows.shape).encode(), digest_size=16)
    digest.update(shape.rows.tobytes())
    digest.update(shape.limits.tobytes())
    key = digest.digest()
    centre = _REMEMBERED.get(key)
    if centre is None:
        centre = _REMEMBERED[key] = _centre(shape, region)
        if len(_REMEMBERED) > _MOST_REMEMBERED:
            _REMEMBERED.clear()
    return centre.copy()


@one_thread
def _centre(shape: _Shape, region: Region) -> Floats:
    """Find the centre of a region with these constraints."""
    hull = _opposites(shape)
    g = _deepest_point(shape, hull)
    if g is not None:
        g = _newton(g, shape, hull)
        if _inside(g, shape, hull.flat):
            return g
    start, hull = _relative_interior(shape, region)
    g = _newton(start, shape, hull)
    return g if _inside(g, shape, hull.flat) else start


def _canonical(region: Region) -> _Shape:
    rows, limits = region.constraints_in_order
    return _Shape(rows, limits, np.abs(rows).max(axis=1))


def _opposites(shape: _Shape) -> _Hull:
    """Return the affine hull of a region, as far as pairs of opposite rows show it.

    Two opposite rows make the region flat if their limits leave (nearly) no room between them. Such
    a pair comes from an answer "equal", or from opposite answers.
    """
    tightest: dict[bytes, float] = {}
    keys = [(row + 0.0).tobytes() for row in shape.rows]
    for key, limit in zip(keys, shape.limits, strict=True):
        tightest[key] = max(limit, tightest.get(key, limit))
    flat, equal, to = np.zeros(len(keys), dtype=bool), [], []
    for i, row in enumerate(shape.rows):
        low, high = tightest[keys[i]], -tightest.get((0.0 - row).tobytes(), -np.inf)
        if high - low < _BAND * np.abs(row).sum():
            flat[i] = True
            equal.append(row)
            to.append((low + high) / 2)
    return _Hull(flat, np.array(equal).reshape(-1, shape.rows.shape[1]), np.array(to))


def _inside(g: Floats, shape: _Shape, flat: Flags) -> bool:
    """Return whether g satisfies every constraint.

    Constraints flagged in ``flat`` hold with equality, and may be violated by ``_FLAT`` times their
    largest entry.
    """
    slack = (product(shape.rows, g) - shape.limits) / shape.size
    return bool((slack[~flat] > 0).all() and (slack[flat] > -_FLAT).all())


def _deepest_point(shape: _Shape, hull: _Hull) -> Floats | None:
    """Return the point of the hull that is farthest from its nearest constraint.

    Return None if floats find no point with positive slack in all constraints.
    """
    p, free = shape.rows.shape[1], ~hull.flat
    equal = np.concatenate([np.ones((1, p)), hull.equal])
    found = linprog(
        np.concatenate([np.zeros(p), [-1.0]]),
        A_ub=np.concatenate([-shape.rows[free], shape.size[free, None]], axis=1),
        b_ub=-shape.limits[free],
        A_eq=np.concatenate([equal, np.zeros((len(equal), 1))], axis=1),
        b_eq=np.concatenate([[1.0], hull.to]),
        bounds=[(None, None)] * p + [(None, 1.0)],
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if found.x is None:
        return None
    g: Floats = found.x[:p] / found.x[:p].sum()
    slack = (product(shape.rows, g) - shape.limits) / shape.size
    return g if slack[free].min(initial=1.0) > _FLAT else None


def _relative_interior(shape: _Shape, region: Region) -> tuple[Floats, _Hull]:
    """Return a point in the relative interior of a flat region, and the region's affine hull.

    At the point every constraint has slack, unless it holds with equality in the whole region. The
    point is a mean of exact vertices. For each constraint without slack at the mean, the vertex
    where it has the greatest slack is added, if that slack is above 0.
    """
    m = len(shape.rows)
    vertices: list[Numbers] = [minimise_exactly(-shape.rows[0], region).g]
    flat = np.zeros(m, dtype=bool)
    for i in range(m):
        mean = (np.sum(vertices, axis=0) / len(vertices)).astype(np.float64)
        if product(shape.rows[i], mean) - shape.limits[i] > _FLAT * shape.size[i]:
            continue
        vertex = minimise_exactly(-shape.rows[i], region).g
        flat[i] = (
            float(product(shape.rows[i], vertex.astype(np.float64))) - shape.limits[i]
            <= _FLAT * shape.size[i]
        )
        if not flat[i]:
            vertices.append(vertex)
    mean = (np.sum(vertices, axis=0) / len(vertices)).astype(np.float64)
    return mean, _Hull(flat, shape.rows[flat], product(shape.rows[flat], mean))


def _newton(g: Floats, shape: _Shape, hull: _Hull) -> Floats:
    """Return the analytic centre of a region within its affine hull.

    Newton steps lead to it from g, a point of the hull with slack in all rows that are not flat.
    """
    p = len(g)
    along = (
        null_basis(np.concatenate([np.ones((1, p)), hull.equal]))
        if len(hull.equal)
        else sums_to_zero(p)
    )
    if along.shape[1] == 0:
        return g
    g = climb(g, shape.rows[~hull.flat], shape.limits[~hull.flat], along)
    return np.asarray(g / g.sum(), dtype=np.float64)


@one_thread
def climb(x: Floats, rows: Floats, limits: Floats, along: Floats) -> Floats:
    """Return the point of x + span(along) where the product of the slacks is greatest.

    The slacks are rows x - limits. The method is damped Newton steps on the self-concordant barrier
    (Nesterov and Nemirovskii 1994).

    Parameters
    ----------
    x : (n,)
        A point of positive slacks.
    rows : (m, n)
    limits : (m,)
    along : (n, q)

    Returns
    -------
    (n,)
    """
    if not along.size:
        return x
    moves = product(rows, along)
    moving = np.abs(moves).max(axis=1) > 1e-13 * np.abs(rows).max(axis=1)
    rows, limits, moves = rows[moving], limits[moving], moves[moving]
    last = np.inf
    for _ in range(200):
        slack = product(rows, x) - limits
        # least squares on the scaled rows give the Newton step without squaring the condition
        # number
        scaled = moves / slack[:, None]
        step = LeastSquares(scaled).solve(np.ones(len(slack)))
        along_rows = product(scaled, step)
        decrement = float(np.sqrt((along_rows * along_rows).sum()))
        if decrement < 1e-10 or (
            decrement < 1e-4 and decrement > last / 2
        ):  # as near as rounding allows
            break
        last = decrement
        x = x + product(along, step) / (1.0 + decrement if decrement > 0.25 else 1.0)
    return x
