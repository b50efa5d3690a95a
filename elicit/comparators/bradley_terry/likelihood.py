"""The likelihood of a noisy tutor's answers and its fit, for many bootstrap samples at once.

It is the paper's eq. (6) and (7). In gap coordinates eq. (6) is P(left is better) = 1 / (1 +
exp(-t.gamma)). Here t are the tail sums of left - right, and gamma_j = c (e_{j+1} - e_j) >= 0 the
scaled gaps. The log-likelihood is concave in gamma, so a fit is a convex problem. ``fit`` solves
many of them fast.

Shapes: n answers, p = k - 1 gaps, m resamples. An answer y = 0 (a tie) counts as half an answer
each way, or has a probability of its own (Rao and Kupper 1967; see ``fit``). Gammas are in logits
per unit of share, so that t.gamma is in logits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from elicit._support.hashing import fold, name_code
from elicit._support.threads import one_thread
from elicit.model.scale import Floats

_TOLERANCE = 1e-12  # a step that promises a smaller gain in log-likelihood is the last one
_FLAT = 1e-8  # least curvature of a maximum, as a share of the most that the answers could have
_MOST_STEPS = 100
_BACKTRACKS = 50
_BLOCK = 2**16  # numbers in a working array that stays in the cache
_ROWS = 2**11  # answers at once, at most
_GATHERED = 128  # rows whose products are computed at once
_KEPT = 2**23  # numbers in products of rows that are kept from step to step, at most
_SURE = 600.0  # logits that count as infinite: exp overflows not far above
_NEAR = 1e-3  # gaps this close to 0 (in gaps that total 1) may be held there for a step

Signs = NDArray[np.integer]


class Fit(NamedTuple):
    """The fitted gamma (m, p) of m problems, and whether each converged (m,)."""

    gamma: Floats
    converged: NDArray[np.bool_]


def sigmoid(z: ArrayLike) -> Floats:
    """Return 1 / (1 + exp(-z)), elementwise, without overflow."""
    logits = np.asarray(z, dtype=np.float64)
    return _sigmoid(logits, np.empty_like(logits))[()]


def _sigmoid(z: Floats, work: Floats) -> Floats:
    """Return ``sigmoid`` of z. ``work``, an array of the shape of z, is overwritten."""
    small = _exp_of_minus_size(z, work)
    out: Floats = np.where(z >= 0, 1.0, small)
    small += 1.0
    out /= small
    return out


def _exp_of_minus_size(z: Floats, out: Floats) -> Floats:
    """Write exp(-|z|) into ``out``, and return it."""
    np.abs(z, out=out)
    np.negative(out, out=out)
    return np.exp(out, out=out)


def log_likelihood(gamma: Floats, t: Floats, y: Signs, weights: Floats | float = 1.0) -> Floats:
    """Return the log-likelihood, the paper's eq. (7).

    Parameters
    ----------
    gamma : (m, p) logits
    t : (n, p)
        Tail sums.
    y : (n,)
        Answers in {-1, 0, +1}.
    weights : (m, n) or float

    Returns
    -------
    (m,)
    """
    m, n = len(gamma), len(t)
    counts, total = np.broadcast_to(weights, (m, n)), np.zeros(m)
    for some in _blocks(m, n):
        # in place, because new arrays of this size take longer than the sums in them
        z = gamma @ t[some].T
        log = _exp_of_minus_size(z, np.empty_like(z))
        np.log1p(log, out=log)
        terms = (1.0 + y[some]) / 2.0 * z
        terms -= np.maximum(z, 0.0, out=z)
        terms -= log
        terms *= counts[:, some]
        total += terms.sum(axis=1)
    return total


def derivatives(
    gamma: Floats,
    t: Floats,
    y: Signs,
    weights: Floats | float = 1.0,
    outer: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Return the gradient (m, p) and the Hessian (m, p, p) of ``log_likelihood``.

    ``outer`` is ``outer_rows(t)`` if it is known already.
    """
    (m, p), n = gamma.shape, len(t)
    counts, gradient, hessian = np.broadcast_to(weights, (m, n)), np.zeros((m, p)), np.zeros((p, p))
    upper = np.zeros((m, p * (p + 1) // 2))
    for some in _blocks(m, n):
        z = gamma @ t[some].T
        s = _sigmoid(z, np.empty_like(z))
        np.subtract((1.0 + y[some]) / 2.0, s, out=z)
        z *= counts[:, some]
        gradient += z @ t[some]
        s *= np.subtract(1.0, s, out=z)
        s *= counts[:, some]
        if m == 1:  # then one product of matrices takes less time than the products of all rows
            hessian += (t[some] * s[0, :, None]).T @ t[some]
        else:
            upper += s @ (outer_rows(t[some]) if outer is None else outer[some])
    return gradient, -(hessian[None] if m == 1 else _symmetric(upper, p))


def _blocks(m: int, n: int) -> list[slice]:
    """Return slices of the n answers, so short that arrays of m problems stay in the cache."""
    size = min(max(64, _BLOCK // max(1, m)), _ROWS)
    return [slice(i, i + size) for i in range(0, n, size)]


def outer_rows(t: Floats) -> Floats:
    """Return the upper triangle of the outer product of each row of t with itself.

    The result is (n, p(p+1)/2). With it the Hessians of all resamples are one matrix product.
    """
    first, second = np.triu_indices(t.shape[1])
    products = np.empty((len(t), len(first)))
    for i in range(0, len(t), _GATHERED):
        some, out = t[i : i + _GATHERED], products[i : i + _GATHERED]
        np.take(some, first, axis=1, out=out, mode="clip")  # another mode would buffer ``out``
        out *= some.take(second, axis=1)
    return products


def _symmetric(upper: Floats, p: int) -> Floats:
    rows, columns = np.triu_indices(p)
    full: Floats = np.empty((len(upper), p, p))
    full[:, rows, columns] = full[:, columns, rows] = upper
    return full


@dataclass(frozen=True)
class _Problems:
    """A batch of m penalised fits to the same rows with different weights.

    They are solved for the gaps u = gamma / precision. So the rows are x = precision * t.
    """

    x: Floats  # (n, p)
    y: Signs  # (n,)
    weights: Floats  # (m, n)
    centre: Floats  # (m, p)
    strength: float
    monotone: bool
    equal: Floats  # (m,) number of ties with a probability of their own
    width: float  # width of such ties, in logits for gaps that total 1
    outer: Floats | None  # ``outer_rows(x)``, unless they are too many to keep

    def loss(self, u: Floats) -> Floats:
        """Return the loss (m,) to minimise: minus the log-likelihood, plus the ridge penalty."""
        ridge = self.strength / 2.0 * ((u - self.centre) ** 2).sum(axis=1)
        total: Floats = ridge - log_likelihood(u, self.x, self.y, self.weights)
        if self.width > 0:
            total -= np.where(
                self.equal > 0, self.equal * _log_apart(2.0 * self.width * u.sum(axis=1)), 0.0
            )
        return total

    def slopes(self, u: Floats) -> tuple[Floats, Floats]:
        """Return the gradient (m, p) and the Hessian (m, p, p) of the loss."""
        gradient, hessian = derivatives(u, self.x, self.y, self.weights, self.outer)
        gradient, hessian = (
            self.strength * (u - self.centre) - gradient,
            self.strength * np.eye(u.shape[1]) - hessian,
        )
        if self.width > 0:
            a = np.clip(2.0 * self.width * u.sum(axis=1), np.finfo(np.float64).tiny, _SURE)
            gradient -= (self.equal * 2.0 * self.width / np.expm1(a))[:, None]
            hessian += (self.equal * (self.width / np.sinh(a / 2.0)) ** 2)[:, None, None]
        return gradient, hessian

    def only(self, rows: NDArray[np.bool_] | slice) -> _Problems:
        """Return the batch of these problems alone."""
        return replace(
            self, weights=self.weights[rows], centre=self.centre[rows], equal=self.equal[rows]
        )

    def project(self, u: Floats) -> Floats:
        """Return the admissible points nearest to u (m, p): no gap is negative if ``monotone``."""
        return np.maximum(u, 0.0) if self.monotone else u


@one_thread
@np.errstate(over="ignore", invalid="ignore")  # if logits overflow, no step is acceptable
def fit(
    t: Floats,
    y: Signs,
    *,
    precision: float,
    centre: Floats,
    strength: float,
    weights: Floats | None = None,
    start: Floats | None = None,
    monotone: bool = True,
    tie: float = 0.0,
) -> Fit:
    """Fit m penalised likelihoods at once.

    Each maximises the log-likelihood less (strength / 2) sum_j (gamma_j / precision - centre_j)^2.

    Parameters
    ----------
    t : (n, p)
        Tail sums.
    y : (n,)
        Answers in {-1, 0, +1}.
    precision : float
        Above 0.
    centre : (m, p)
        The prior's centre, in gaps that total 1.
    strength : float
        Strength of the prior. With 0 the maximum may lie at infinity, if some scale explains the
        answers without error. It may not be unique, if no answer touches some levels. In both cases
        the likelihood is flat in some direction, and the fit is reported as not converged.
    weights : (m, n), optional
        Number of times that each resample holds each answer. Default: once.
    start : (p,) or (m, p), optional
        In the unit of gamma, with a total above 0. Default: the centre.
    monotone : bool
        Keep gamma >= 0.
    tie : float
        If it is above 0 and any y is 0, ties have a probability of their own. With s = tie * sum_j
        gamma_j the three answers have the probabilities sigma(t.gamma - s), sigma(-t.gamma - s)
        and, for equal, the rest: (1 - exp(-2 s)) sigma(s - t.gamma) sigma(s + t.gamma).

    Returns
    -------
    Fit

    Notes
    -----
    The shift s is a shift of all tail sums by ``tie``. A tie counts as two answers to shifted rows,
    and log(1 - exp(-2 s)) is concave, so the whole stays concave.

    The method is projected Newton steps with Armijo damping. Undamped, warm starts diverge if there
    are few answers.

    References
    ----------
    Bertsekas, SIAM J. Control Optim. 1982. Rao and Kupper 1967.
    """
    m, p = centre.shape
    counts, equal, width = np.ones((m, len(t))) if weights is None else weights, np.zeros(m), 0.0
    tied = y == 0
    if tie > 0 and tied.any():
        width, equal = tie * precision, counts[:, tied].sum(axis=1)
        t = np.concatenate([y[~tied, None] * t[~tied] - tie, tie - t[tied], tie + t[tied]])
        counts = np.concatenate([counts[:, ~tied], counts[:, tied], counts[:, tied]], axis=1)
        y = np.ones(len(t), dtype=np.int8)
    x = precision * t
    outer = outer_rows(x) if m > 1 and len(x) * p * (p + 1) // 2 <= _KEPT else None
    every = _Problems(x, y, counts, centre, strength, monotone, equal, width, outer)
    first = np.array(np.broadcast_to(centre if start is None else start / precision, (m, p)))
    u, converged = _fit(every, every.project(first))
    return Fit(precision * u, converged)


def _log_apart(a: Floats) -> Floats:
    """Return log(1 - exp(-a)), elementwise; -inf unless a is above 0."""
    least = np.finfo(np.float64).tiny
    return np.where(a > 0, np.log(-np.expm1(-np.maximum(a, least))), -np.inf)


def _fit(problems: _Problems, u: Floats) -> Fit:
    best, m = u.copy(), len(u)
    converged = np.zeros(m, dtype=np.bool_)
    rest, todo, loss = problems, np.arange(m), problems.loss(u)
    for _ in range(_MOST_STEPS):
        u, loss, accepted, last = _step(rest, u, loss)
        best[todo] = u
        converged[todo] = accepted & last
        going = accepted & ~last
        if not going.all():
            rest, todo, u, loss = rest.only(going), todo[going], u[going], loss[going]
        if not todo.size:
            break
    if problems.strength == 0:
        converged &= ~_flat(problems, best)
    return Fit(best, converged)


def _step(
    problems: _Problems, u: Floats, loss: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_], NDArray[np.bool_]]:
    """Take one damped Newton step in each problem.

    Return the new points, their losses, whether each step was acceptable, and whether it promised
    too little to go on.
    """
    gradient, hessian = problems.slopes(u)
    diagonal = np.einsum("mjj->mj", hessian)  # a view: writing to it writes to the Hessian
    diagonal += 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-300  # solvable where strength is 0
    held = np.zeros(u.shape, dtype=np.bool_)
    if problems.monotone:
        # Gaps at (nearly) 0 that the gradient pushes down step on their own. So the others'
        # projected Newton step still descends. The margin shrinks as the fit converges.
        reach = np.abs(u - problems.project(u - gradient / diagonal)).max(axis=1, keepdims=True)
        held = (u <= np.minimum(reach, _NEAR)) & (gradient > 0)
        hessian = np.where(
            (held[:, :, None] | held[:, None, :]) & ~np.eye(u.shape[1], dtype=bool), 0.0, hessian
        )
    direction = np.linalg.solve(hessian, gradient[:, :, None])[:, :, 0]

    size = np.ones((len(u), 1))
    last = accepted = np.zeros(len(u), dtype=np.bool_)
    for attempt in range(_BACKTRACKS):
        trial = problems.project(u - size * direction)
        promised = (gradient * np.where(held, u - trial, size * direction)).sum(axis=1)
        if attempt == 0:
            last = promised <= _TOLERANCE
        value = problems.loss(trial)
        accepted = value <= loss - 1e-4 * promised + 1e-13 * (1.0 + np.abs(loss))
        if accepted.all():
            break
        size[~accepted] /= 2.0
    return np.where(accepted[:, None], trial, u), np.where(accepted, value, loss), accepted, last


def _flat(problems: _Problems, u: Floats) -> NDArray[np.bool_]:
    """Return for each problem (m,) whether its loss is flat along some admissible direction at u.

    If so, u is not the only maximum.
    """
    most = problems.weights @ outer_rows(problems.x) / 4.0  # no logistic curvature exceeds 1/4
    scale = np.sqrt(np.einsum("mjj->mj", _symmetric(most, u.shape[1])))
    gradient, hessian = problems.slopes(u)
    held = (u <= 0) & (gradient > 0) if problems.monotone else np.zeros(u.shape, dtype=np.bool_)
    untouched = ((scale == 0) & ~held).any(axis=1)
    scale = np.where(scale == 0, 1.0, scale)
    relative = hessian / (scale[:, :, None] * scale[:, None, :])
    relative = np.where(held[:, :, None] | held[:, None, :], np.eye(u.shape[1]), relative)
    relative = np.nan_to_num(relative, nan=0.0, posinf=0.0, neginf=0.0)
    flat: NDArray[np.bool_] = untouched | (np.linalg.eigvalsh(relative)[:, 0] < _FLAT)
    return flat


def bootstrap_weights(key: int, m: int, n: int) -> Floats:
    """Return the number of times (m, n) that each resample holds each answer.

    A resample is n draws with replacement. The result is a function of the key and n alone.

    Parameters
    ----------
    key, m, n : int

    Returns
    -------
    (m, n) counts
    """
    rng = np.random.Generator(np.random.PCG64(int(fold(key, name_code("bootstrap"), n))))
    drawn = rng.integers(0, n, size=(m, n)) + n * np.arange(m)[:, None]
    counts: Floats = np.bincount(drawn.ravel(), minlength=m * n).reshape(m, n).astype(np.float64)
    return counts


def prior_centres(key: int, m: int, p: int, shape: tuple[float, float] = (1.0, 1.0)) -> Floats:
    """Return the centre of each resample's prior: m draws (m, p) of gaps that total 1.

    Each draw is from Dirichlet(a), and a is drawn anew each time: log a is uniform between the logs
    of the two numbers of ``shape``. With a = 1 the draw is uniform on the simplex, and a small a
    makes a few large gaps. The answers have no part in it, so when answers are added, each resample
    has the same centre as before.

    Parameters
    ----------
    key, m, p : int
    shape : (low, high)

    Returns
    -------
    (m, p)
    """
    rng = np.random.Generator(np.random.PCG64(int(fold(key, name_code("prior centres")))))
    a = np.exp(rng.uniform(np.log(shape[0]), np.log(shape[1]), size=(m, 1)))
    draws = (
        rng.standard_gamma(np.broadcast_to(a, (m, p))) + np.finfo(np.float64).tiny
    )  # never all zero
    centres: Floats = draws / draws.sum(axis=1, keepdims=True)
    return centres
