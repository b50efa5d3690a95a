"""Draws from a posterior over scales, by random walks that rivals of ours may share.

Both walks take their random numbers as arrays, so that a seed gives the same draws compiled or not.
"""

from __future__ import annotations

import numpy as np

from benchmarks.contest.harness import Told
from elicit._support.jit import compiled
from elicit.model.scale import Floats

STEEP = 1000.0
"""Logits per unit of value that stand for a tutor who never errs."""


@compiled
def _log_chance(logit: float, lapse: float) -> float:
    """Return the logarithm of the chance of an answer that has this logit."""
    if lapse == 0.0:
        if logit > 0.0:
            return -np.log1p(np.exp(-logit))
        return logit - np.log1p(np.exp(logit))
    if logit < -50.0:
        return np.log(0.5 * lapse)
    return np.log(0.5 * lapse + (1.0 - lapse) / (1.0 + np.exp(-logit)))


@compiled
def _walk(
    rows: Floats,
    precision: float,
    lapse: float,
    g: Floats,
    directions: Floats,
    uniforms: Floats,
    thin: int,
    out: Floats,
) -> None:
    """Write draws of gaps (m, p) to ``out``: a random walk on the simplex from g (p,).

    Each of ``rows`` (n, p) is a difference, in tail sums, that was answered "better".
    """
    n, p = rows.shape
    dots = np.empty(n)
    other = np.empty(n)
    log_now = 0.0
    for i in range(n):
        dots[i] = 0.0
        for j in range(p):
            dots[i] += rows[i, j] * g[j]
        log_now += _log_chance(precision * dots[i], lapse)
    for step in range(len(directions)):
        inside = True
        for j in range(p):
            if g[j] + directions[step, j] < 0.0:
                inside = False
        if inside:
            log_next = 0.0
            for i in range(n):
                other[i] = dots[i]
                for j in range(p):
                    other[i] += rows[i, j] * directions[step, j]
                log_next += _log_chance(precision * other[i], lapse)
            if uniforms[step] < log_next - log_now:
                log_now = log_next
                for j in range(p):
                    g[j] += directions[step, j]
                for i in range(n):
                    dots[i] = other[i]
        if (step + 1) % thin == 0:
            for j in range(p):
                out[(step + 1) // thin - 1, j] = g[j]


class Posterior:
    """Draws of gaps (m, p), given all answers, from a uniform prior over ordered scales.

    The likelihood is that of ``Told``. The walk goes on from where it was; its steps have sizes
    from a ten-thousandth of the range to a third, so that it needs no tuning.
    """

    def __init__(self, k: int, told: Told, rng: np.random.Generator, draws: int = 200) -> None:
        self._rng, self._told, self._count = rng, told, draws
        self._p = k - 1
        self._rows: list[Floats] = []
        self.gaps: Floats = rng.dirichlet(np.ones(k - 1), size=draws)

    @property
    def mean(self) -> Floats:
        """(p,) the mean gaps."""
        return self.gaps.mean(axis=0)

    def tell(self, tails: Floats, verdict: int) -> None:
        """Take an answer to a difference with these tail sums (p,); 0 counts for nothing."""
        if verdict == 0:
            return
        self._rows.append(verdict * tails)
        thin, rest = 20, 600
        steps = rest + thin * self._count
        sizes = np.exp(self._rng.uniform(np.log(1e-4), np.log(0.3), size=(steps, 1)))
        directions = self._rng.standard_normal((steps, self._p))
        directions -= directions.mean(axis=1, keepdims=True)
        directions *= sizes
        uniforms = np.log(self._rng.random(steps))
        out = np.empty((steps // thin, self._p))
        rows = np.array(self._rows)
        start = self._likeliest(rows)
        precision = min(self._told.precision, STEEP)
        _walk(rows, precision, self._told.lapse, start, directions, uniforms, thin, out)
        self.gaps = out[rest // thin :]

    def _likeliest(self, rows: Floats) -> Floats:
        """Return one of the draws so far that fits the answers best."""
        logits = min(self._told.precision, STEEP) * (self.gaps @ rows.T)
        chance = 0.5 * self._told.lapse + (1 - self._told.lapse) / (
            1 + np.exp(-np.clip(logits, -700, 700))
        )
        fit = np.log(np.maximum(chance, 1e-300)).sum(axis=1)
        return self.gaps[int(np.argmax(np.round(fit, 9)))].copy()


@compiled
def _metropolis(
    rows: Floats, beta: float, w: Floats, steps: Floats, uniforms: Floats, out: Floats, logs: Floats
) -> None:
    """Write a Metropolis-Hastings walk over unit weights (n, p), as APReL has it.

    Each proposal is a normal step, scaled back to length one. Negative weights have no chance.
    """
    n, p = rows.shape
    proposal = np.empty(p)
    log_now = 0.0
    for i in range(n):
        dot = 0.0
        for j in range(p):
            dot += rows[i, j] * w[j]
        log_now += _log_chance(beta * dot, 0.0)
    for step in range(len(out)):
        out[step] = w
        logs[step] = log_now
        if step == len(out) - 1:
            break
        length = 0.0
        inside = True
        for j in range(p):
            proposal[j] = w[j] + steps[step, j]
            length += proposal[j] * proposal[j]
            if proposal[j] < 0.0:
                inside = False
        if not inside:
            continue
        log_next = 0.0
        for i in range(n):
            dot = 0.0
            for j in range(p):
                dot += rows[i, j] * proposal[j]
            log_next += _log_chance(beta * dot / np.sqrt(length), 0.0)
        if uniforms[step] < log_next - log_now:
            log_now = log_next
            for j in range(p):
                w[j] = proposal[j] / np.sqrt(length)


class UnitWeights:
    """APReL's belief: samples of weights of length one, by Metropolis-Hastings (Biyik et al. 2022).

    Its defaults: 100 samples, the first 200 steps left out, every 20th kept, normal steps of .05,
    and the chain starts at the last mean. The order of levels is the prior: no weight is negative.
    """

    SAMPLES, BURN_IN, THIN, STEP = 100, 200, 20, 0.05

    def __init__(self, p: int, beta: float, rng: np.random.Generator) -> None:
        self._rng, self._beta, self._p = rng, beta, p
        self._rows: list[Floats] = []
        first = np.abs(rng.standard_normal(p))
        self._sample(first / np.linalg.norm(first))

    @property
    def mean(self) -> Floats:
        """(p,) the mean weights, of length one."""
        mean = self.weights.mean(axis=0)
        return mean / np.linalg.norm(mean)

    def tell(self, tails: Floats, verdict: int) -> None:
        """Take an answer to a difference with these tail sums (p,).

        APReL's user always chooses: one who calls two sides equal tosses a coin.
        """
        side = verdict or (1 if self._rng.random() < 0.5 else -1)
        self._rows.append(side * tails)
        self._sample(self.mean)

    def _sample(self, start: Floats) -> None:
        count = self.BURN_IN + self.THIN * self.SAMPLES
        steps = self.STEP * self._rng.standard_normal((count, self._p))
        uniforms = np.log(self._rng.random(count))
        out, logs = np.empty((count, self._p)), np.empty(count)
        rows = np.array(self._rows).reshape(-1, self._p)
        _metropolis(rows, self._beta, start, steps, uniforms, out, logs)
        self.weights: Floats = out[self.BURN_IN :: self.THIN]
        self.logs: Floats = logs[self.BURN_IN :: self.THIN]
