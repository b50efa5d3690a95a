"""The posterior density of a particle, up to a constant: prior times likelihood, in compiled code.

A particle x is one guess at the scale and the tutor. Its first p coordinates give theta = exp(x) =
c g, the gaps times the precision c. If the lapse is learned, the next coordinate is its logit (see
``slips``). If the width of EQUAL is learned, the last coordinate is the logarithm of its ratio to
the median width: the tutor calls equal two things that are closer than the width.

With a width w there are three answers (Rao and Kupper 1967). P(better) = sigma(c d.e - c w), and
P(worse) is the same for -d. P(equal) is the rest, (1 - exp(-2 c w)) sigma(c w - c d.e) sigma(c w +
c d.e). A lapse says EQUAL with probability ``EQUAL_LAPSES``, and the two others with half the rest
each. Without a width there are two answers, and a tie counts as half an answer each way.

Each term of the log-likelihood is at most 0. So a proposal can be rejected as soon as its partial
sum is too low.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from elicit._support.jit import compiled, for_each_number
from elicit.model.scale import Floats

# rows whose likelihoods are multiplied before a logarithm is taken; log_terms halves it three times
BLOCK = 64
FARTHEST = 60.0  # a logistic function is 0 or 1 there, to within 1e-26
# least lapse that is learned: single precision is too coarse below (see ``density_float32``)
LEAST_LAPSE = 1e-4
EQUAL_LAPSES = 0.01
"""Share of lapses that say EQUAL. Chosen on half of 30 people who could say "indifferent" (see
docs/posterior.md): with a third, a single EQUAL is taken for a lapse."""
LEAST_WIDTH = 1e-6  # in logits: below, products of eight probabilities of EQUAL would underflow


class ParticlePrior(NamedTuple):
    """The prior of a particle, as plain arrays and numbers.

    The gaps g follow a mixture of Dirichlet(a) over shapes a; their log density depends on S = sum
    log g alone. The precision has log c ~ N(mean, sd^2). If ``fixed`` > 0, it is the known
    precision, and the coordinates of theta then give only the ratios of the gaps. If ``lapse`` >=
    0, it is the known lapse. If ``lapse`` is negative, the lapse is a coordinate, which is Beta(a,
    b) a priori, but at least LEAST_LAPSE. If ``tie`` > 0, the width w of EQUAL is a coordinate: log
    w is logistic a priori, with median log ``tie`` and scale 1, but w is at most the value range.
    If there are ``kinds``, the law of gaps, precision and lapse is a mixture of this general one
    and of one for each kind of earlier people.
    """

    shapes: Floats  # (nodes,), at most BLOCK
    constants: Floats  # (nodes,) log weight + log of Dirichlet(a)'s constant
    mean: float
    sd: float
    fixed: float
    lapse: float
    lapse_a: float
    lapse_b: float
    tie: float
    above: Floats  # (r, p) rows with row.g >= limits
    limits: Floats  # (r,)
    general: float  # log weight of the general law beside ``kinds``, with its constants
    kinds: Floats  # (q, 5 + p) see ``among_kinds``; if q = 0, the general law is the whole prior


@compiled
def scaled(x: Any, fixed: float, theta: Any) -> float:
    """Return log c of particle x (>= p,), and write theta = c g into ``theta`` (p,)."""
    p = len(theta)
    most, total = x[0], 0.0
    for j in range(p):
        most = max(most, x[j])
    for j in range(p):
        theta[j] = small_exp(min(most - x[j], FARTHEST))
    for j in range(p):
        total += theta[j]
    log_c: float = most + math.log(total)
    c = fixed if fixed > 0.0 else math.exp(min(log_c, 300.0))
    for j in range(p):
        theta[j] *= c / total
    return log_c


@compiled
def log_prior(x: Any, prior: ParticlePrior, theta: Any, work: Any) -> float:
    """Return the log prior density of x up to a constant, and write theta = c g into theta (p,).

    It is -inf if a prior inequality fails. ``work`` (2, BLOCK) is overwritten.
    """
    p, s, c = len(theta), 0.0, 0.0
    log_c = scaled(x, prior.fixed, theta)
    for j in range(p):
        s += x[j]
        c += theta[j]
    for i in range(len(prior.limits)):
        at = 0.0
        for j in range(p):
            at += prior.above[i, j] * theta[j]
        if not at >= prior.limits[i] * c:
            return -math.inf
    s -= p * log_c
    best, total, terms, nodes = -math.inf, 0.0, work[0], len(prior.shapes)
    for i in range(nodes):
        terms[i] = prior.constants[i] + prior.shapes[i] * s
    for i in range(nodes):
        best = max(best, terms[i])
    for i in range(nodes):
        terms[i] = small_exp(min(best - terms[i], FARTHEST))
    for i in range(nodes):
        total += terms[i]
    z: float = (log_c - prior.mean) / prior.sd
    found: float = best + math.log(total) - 0.5 * z * z
    if prior.lapse < 0.0:
        found += log_logistic(x[p], prior.lapse_a, prior.lapse_b)
    if len(prior.kinds) > 0:
        found = among_kinds(x, log_c, found + prior.general, prior, work[1])
    if prior.tie > 0.0:
        found += log_logistic(x[len(x) - 1], 1.0, 1.0)
    return found


@compiled
def among_kinds(x: Any, log_c: float, general: float, prior: ParticlePrior, terms: Any) -> float:
    """Return the log density of a mixture of the general prior and of kinds of people.

    A row of ``prior.kinds`` describes one kind: the log of its weight and constants, the mean and
    the standard deviation of log c, the two parameters of the lapse, and the Dirichlet parameters
    of the gaps. ``general`` is the log of the general prior's part. ``terms`` (BLOCK,) is
    overwritten.
    """
    best, total, p = general, 0.0, prior.kinds.shape[1] - 5
    for i in range(len(prior.kinds)):
        at, z = prior.kinds[i, 0], (log_c - prior.kinds[i, 1]) / prior.kinds[i, 2]
        for j in range(p):
            at += prior.kinds[i, 5 + j] * (x[j] - log_c)
        at -= 0.5 * z * z
        if prior.lapse < 0.0:
            at += log_logistic(x[p], prior.kinds[i, 3], prior.kinds[i, 4])
        terms[i] = at
        best = max(best, at)
    total += small_exp(min(best - general, FARTHEST))
    for i in range(len(prior.kinds)):
        total += small_exp(min(best - terms[i], FARTHEST))
    return best + math.log(total)


@compiled
def log_logistic(u: float, a: float, b: float) -> float:
    """Return the log density of the logit u of a Beta(a, b) variate, up to a constant."""
    return (
        a * min(u, 0.0)
        - b * max(u, 0.0)
        - (a + b) * math.log(1.0 + small_exp(min(abs(u), FARTHEST)))
    )


@compiled
def logistic(u: float) -> float:
    """Return 1 / (1 + exp(-u))."""
    less: float = small_exp(min(abs(u), FARTHEST))
    return (1.0 if u >= 0.0 else less) / (1.0 + less)


@compiled
def odds(u: float) -> float:
    """Return the odds exp(u) of log odds u, limited to exp(-FARTHEST) and exp(FARTHEST)."""
    less: float = small_exp(min(abs(u), FARTHEST))
    return 1.0 / less if u >= 0.0 else less


@compiled
def slips(x: Any, theta: Any, prior: ParticlePrior) -> tuple[float, float]:
    """Return the lapse and the width c w of EQUAL, in logits, of particle x with theta (p,).

    The width is 0 if EQUAL means equal.
    """
    lapse, width = prior.lapse, 0.0
    if lapse < 0.0:
        lapse = LEAST_LAPSE + (1.0 - LEAST_LAPSE) * logistic(x[len(theta)])
    if prior.tie > 0.0:
        for j in range(len(theta)):
            width += theta[j]
        width = max(LEAST_WIDTH, width * min(1.0, prior.tie * odds(x[len(x) - 1])))
    return lapse, width


@compiled
def log_likelihood(
    theta: Any,
    rows: Any,
    tied: Any,
    first: int,
    end: int,
    lapse: float,
    width: float,
    least: float,
    work: Any,
) -> float:
    """Return the log-likelihood of the answers in rows (p, n) from ``first`` up to ``end``.

    It is the sum of ``log_term``, and -inf as soon as the sum is below ``least``. ``work`` (2,
    BLOCK) is overwritten.
    """
    total = 0.0
    for start in range(first, end, BLOCK):
        size = min(BLOCK, end - start)
        if size == BLOCK:  # the same call with a length that the compiler knows
            logits(theta, rows, start, BLOCK, work[0])
        else:
            logits(theta, rows, start, size, work[0])
        if width > 0.0:
            total += log_terms_apart(work, tied[start : start + size], lapse, width)
        else:
            total += log_terms(work, tied[start : start + size], lapse)
        if total < least:
            return -math.inf
    return total


@for_each_number
def logits(theta: Any, rows: Any, start: int, size: int, out: Any) -> None:
    """Write the logits t.theta of ``size`` answers into ``out``.

    The answers are columns of ``rows`` (p, n), from ``start`` on.
    """
    p, stop = len(theta), start + size
    for i in range(size):
        out[i] = 0.0
    for j in range(0, p - 3, 4):  # four at a time: the sums stay in registers
        a, b, c, d = theta[j], theta[j + 1], theta[j + 2], theta[j + 3]
        ra, rb = rows[j, start:stop], rows[j + 1, start:stop]
        rc, rd = rows[j + 2, start:stop], rows[j + 3, start:stop]
        for i in range(size):
            out[i] += ra[i] * a + rb[i] * b + rc[i] * c + rd[i] * d
    for j in range(p - p % 4, p):
        a, ra = theta[j], rows[j, start:stop]
        for i in range(size):
            out[i] += ra[i] * a


@compiled
def log_terms(work: Any, tied: Any, lapse: float) -> float:
    """Return the sum of ``log_term`` over a block of answers, one for each entry of ``tied``.

    The first row of ``work`` (2, BLOCK) holds the answers' logits eta, and is overwritten.
    sigma(eta) is 1 or exp(-|eta|), divided by 1 + exp(-|eta|). Numerators and denominators are
    multiplied up before a logarithm is taken, so that few logarithms are needed.
    """
    above, below, size, ties, far = work[0], work[1], len(tied), 0, 0
    for i in range(size):
        ties += tied[i]
        far += abs(above[i]) > FARTHEST
    if far > 0 and lapse == 0.0:
        total = 0.0
        for i in range(size):
            total += log_term(above[i], tied[i], lapse, 0.0)
        return total
    half, sure = 0.5 * lapse, 1.0 - lapse
    for i in range(size):
        below[i] = small_exp(min(abs(above[i]), FARTHEST))
    for i in range(size):
        above[i] = half * (1.0 + below[i]) + sure * (1.0 if above[i] >= 0.0 else below[i])
    if ties > 0:
        for i in range(size):
            if tied[i]:
                even = half * (1.0 + below[i])
                above[i] = math.sqrt((even + sure) * (even + sure * below[i]))
    return log_quotient(above, below, size, 1e-90)


@compiled
def log_terms_apart(work: Any, tied: Any, lapse: float, width: float) -> float:
    """Return the sum of ``log_term`` over a block of answers, for a tutor with a width of EQUAL.

    ``log_terms`` is the same for a tutor without one.
    """
    above, below, size, far = work[0], work[1], len(tied), 0
    sure, equal = 1.0 - lapse, -math.expm1(-2.0 * width)
    rare, often = EQUAL_LAPSES * lapse, 0.5 * (1.0 - EQUAL_LAPSES) * lapse
    for i in range(size):
        below[i] = width - abs(above[i]) if tied[i] else above[i] - width
        far += abs(below[i]) > FARTHEST
    if far > 0 and lapse == 0.0:
        total = 0.0
        for i in range(size):
            total += log_term(above[i], tied[i], lapse, width)
        return total
    for i in range(size):
        above[i] = below[i]
        below[i] = small_exp(min(abs(above[i]), FARTHEST))
    for i in range(size):
        top = 1.0 if above[i] >= 0.0 else below[i]
        if tied[i]:
            top *= equal / (1.0 + small_exp(min(2.0 * width - above[i], FARTHEST)))
        above[i] = (rare if tied[i] else often) * (1.0 + below[i]) + sure * top
    return log_quotient(above, below, size, 1e-30)


@compiled
def log_quotient(above: Any, below: Any, size: int, low: float) -> float:
    """Return the log of the product of above / (1 + below) over the first ``size`` entries.

    Both arrays are (BLOCK,) and are overwritten. If a partial product of ``above`` is below
    ``low``, its logarithm is taken at once, so that nothing underflows.
    """
    for i in range(size):
        below[i] += 1.0
    for i in range(size, BLOCK):
        above[i], below[i] = 1.0, 1.0
    for half in (BLOCK // 2, BLOCK // 4, BLOCK // 8):
        for i in range(half):
            above[i] *= above[i + half]
            below[i] *= below[i + half]
    few, many, total = 1.0, 1.0, 0.0
    for i in range(BLOCK // 8):
        few *= below[i]  # at most 2^BLOCK
        many *= above[i]  # each at least exp(-8 FARTHEST), times LEAST_WIDTH^8 with a width
        if many < low:
            total += math.log(many)
            many = 1.0
    return total + math.log(many) - math.log(few)


@compiled
def log_term(eta: float, tied: bool, lapse: float, width: float) -> float:
    """Return the log-probability of one answer whose logit is eta = c d.e; at most 0.

    Without a width it is log(lapse/2 + (1 - lapse) sigma(eta)). For a tie (``tied``) it is the mean
    of that and of the opposite answer's. With a width > 0 it is log((1 - EQUAL_LAPSES) lapse/2 + (1
    - lapse) sigma(eta - width)). For a tie it is log(1 - p - q), where p is the probability of this
    answer and q that of the opposite one.
    """
    if width > 0.0:
        eta, top = width - abs(eta) if tied else eta - width, 0.0
        if tied:
            top = math.log(
                -math.expm1(-2.0 * width) / (1.0 + small_exp(min(2.0 * width - eta, FARTHEST)))
            )
        less = small_exp(min(abs(eta), FARTHEST))
        if lapse == 0.0:
            return top + min(eta, 0.0) - math.log(1.0 + less)
        sure = (1.0 - lapse) * math.exp(top) * (1.0 if eta >= 0.0 else less)
        share = EQUAL_LAPSES if tied else 0.5 * (1.0 - EQUAL_LAPSES)
        return math.log(share * lapse + sure / (1.0 + less))
    less = small_exp(min(abs(eta), FARTHEST))
    if lapse == 0.0:
        return (-0.5 * abs(eta) if tied else min(eta, 0.0)) - math.log(1.0 + less)
    even, sure = 0.5 * lapse * (1.0 + less), 1.0 - lapse
    if tied:
        return 0.5 * math.log((even + sure) * (even + sure * less)) - math.log(1.0 + less)
    return math.log(even + sure * (1.0 if eta >= 0.0 else less)) - math.log(1.0 + less)


def exp_of_minus(u: Any) -> Any:
    """Return exp(-u) for u in 0..60.

    The relative error is a few parts in 10^14 if the result is above 1e-8, and in 10^11 below. The
    method is Taylor's series of exp(-u/256), squared eight times. It has no branches, so that the
    compiler can treat several u at once.
    """
    v = u * (-1.0 / 256.0)
    e = 1.0 / 40320.0 + v * (1.0 / 362880.0)
    e = 1.0 / 5040.0 + v * e
    e = 1.0 / 720.0 + v * e
    e = 1.0 / 120.0 + v * e
    e = 1.0 / 24.0 + v * e
    e = 1.0 / 6.0 + v * e
    e = 0.5 + v * e
    e = 1.0 + v * e
    e = 1.0 + v * e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


small_exp = compiled(exp_of_minus)
"""``exp_of_minus`` of one number."""


@compiled
def likelihoods(theta: Any, slip: Any, rows: Any, tied: Any, n: int, out: Any) -> None:
    """Write the log-likelihood (m,) of the last of n answers, for each particle, into ``out``.

    The particles are given by theta (p, m), and by ``slip`` (2, m), their lapses and widths of
    EQUAL.
    """
    p, m = theta.shape
    for i in range(m):
        out[i] = 0.0
    for j in range(p):
        each, by = theta[j], rows[j, n - 1]
        for i in range(m):
            out[i] += by * each[i]
    for i in range(m):
        out[i] = log_term(out[i], tied[n - 1], slip[0, i], slip[1, i])


@compiled
def powered(
    theta: Any,
    rows: Any,
    tied: Any,
    n: int,
    last: float,
    lapse: float,
    width: float,
    least: float,
    work: Any,
) -> float:
    """Return the log-likelihood of n answers, the last one's raised to the power ``last``.

    The other arguments are those of ``log_likelihood``.
    """
    if last == 1.0:
        return log_likelihood(theta, rows, tied, 0, n, lapse, width, least, work)
    found = last * log_likelihood(theta, rows, tied, n - 1, n, lapse, width, -math.inf, work)
    return found + log_likelihood(theta, rows, tied, 0, n - 1, lapse, width, least - found, work)
