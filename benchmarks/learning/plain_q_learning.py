"""Interactive Q-learning as one would first write it, with the usual solvers: what the compiled
learner stands beside.

Algorithm 1 is a Python loop over NumPy arrays; of Algorithm 2 it knows dominance (eq. 4), a judge
for what dominance leaves open, and the tutor for what the judge leaves open. Three judges: cvxpy
programs stated anew for each comparison (``Rebuilt``), one hot solver (``lp_methods.Careful``), and
scikit-learn fits to bootstrap resamples (``Bootstrap``). The random numbers are those of the
learners, drawn beforehand, so that a run can be compared with theirs question for question and
costs no more than with any other generator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.comparing import lp_methods as methods
from benchmarks.comparing.recorded_streams import unit
from elicit import Answers, Verdict
from elicit._support.hashing import fold, uniform
from elicit.model.difference import dominance, tail_sums
from elicit.model.scale import Floats
from qlearn import OrdinalMDP
from qlearn.learners.loops.q_learning_kernel import ACTION, EXPLORE, FIRST_BEST, RESTART, TRANSITION
from qlearn.learners.q_learning import rescaled_linear_rate

RESAMPLES, LEVEL, RIDGE = 100, 0.95, 0.1
# answers up to which everything open is asked: the resamples of one answer all agree, and would ask
# no more
FEW = 10
MARGIN = 1e-6
OPEN = int(Verdict.UNKNOWN)
BETTER = int(Verdict.BETTER)


class Judge(Protocol):
    """Learns answers, and settles what dominance leaves open."""

    def learn(self, answers: Answers) -> None:
        """Take in further answers."""

    def settle(self, t: Floats) -> int:
        """Return the verdict on tail sums t (p,), the largest of size 1; UNKNOWN: ask the tutor."""


class Tutor(Protocol):
    """A simulated tutor, such as elicit's."""

    def signs(self, d: Floats) -> NDArray[np.int8]:
        """Answers (n,) to differences d (n, k)."""


@dataclass
class Run:
    """The state of a run.

    Attributes
    ----------
    judging : float
        CPU seconds spent on comparisons that dominance left open, answers included.
    seconds : float
        CPU seconds in all.
    opened : int
        Number of comparisons that dominance left open.
    asked : list of (k,)
        Differences that were put to the tutor.
    """

    best: NDArray[np.int64]
    q: Floats
    steps: int = 0
    compared: int = 0
    opened: int = 0
    asked: list[Floats] = field(default_factory=list)
    said: list[int] = field(default_factory=list)
    judging: float = 0.0
    seconds: float = 0.0

    def whole(self, steps: int, opened: int) -> float:
        """Seconds of a run of so many steps with so many open comparisons, each as dear as here on
        average.
        """
        return (self.seconds - self.judging) * steps / self.steps + self.judging * opened / max(
            1, self.opened
        )


class World:
    """The simulator: exploration by step, transitions by (state, action, visit). All actions
    admissible, no ends.
    """

    def __init__(self, mdp: OrdinalMDP, key: int, steps: int, epsilon: float) -> None:
        if mdp.terminal.any() or not mdp.admissible.all():
            raise ValueError(
                "the plain loop knows no terminal states and no inadmissible actions: use "
                "random_mdp"
            )
        self.n_states, self.n_actions, self._mdp, self._key = mdp.n_states, mdp.n_actions, mdp, key
        step = np.arange(steps)
        self.explores = (uniform(fold(key, EXPLORE, step)) < epsilon).tolist()
        self.drawn = (uniform(fold(key, ACTION, step)) * mdp.n_actions).astype(int).tolist()
        self.first_best = (
            uniform(fold(key, FIRST_BEST, np.arange(mdp.n_states))) * mdp.n_actions
        ).astype(np.int64)
        u = float(uniform(fold(key, RESTART, 0)))
        self.start = int(np.searchsorted(np.cumsum(mdp.initial), u, side="right"))
        self._cumulative = np.cumsum(mdp.probabilities, axis=2)
        self._next = {
            (s, a): self._draw(s, a, 0, 64)
            for s in range(mdp.n_states)
            for a in range(mdp.n_actions)
        }

    def successor(self, s: int, a: int, visit: int) -> int:
        """Return the state that action a leads to from s, at the given visit of the two."""
        ahead = self._next[s, a]
        while visit >= len(ahead):
            ahead += self._draw(s, a, len(ahead), len(ahead))
        return ahead[visit]

    def _draw(self, s: int, a: int, first: int, n: int) -> list[int]:
        u = uniform(fold(self._key, TRANSITION, s, a, np.arange(first, first + n)))
        last = self._cumulative.shape[2] - 1
        i = np.minimum(np.searchsorted(self._cumulative[s, a], u, side="right"), last)
        found: list[int] = self._mdp.successors[s, a, i].tolist()
        return found


def q_learning(
    mdp: OrdinalMDP,
    judge: Judge,
    tutor: Tutor,
    *,
    steps: int,
    epsilon: float,
    key: int,
    enough: Callable[[Run], bool] = lambda run: False,
) -> Run:
    """Run Algorithm 1 until ``enough`` returns True after a step.

    All mass is on the worst level at first. The time to build the simulator is not counted.
    """
    world = World(mdp, key, steps, epsilon)
    gamma, rates, levels = (
        mdp.discount,
        rescaled_linear_rate(mdp.discount)(np.arange(steps)).tolist(),
        mdp.levels,
    )
    run = Run(world.first_best.copy(), np.zeros((mdp.n_states, mdp.n_actions, mdp.k)))
    run.q[:, :, 0] = 1.0
    q, best, every = run.q, run.best, list(range(world.n_actions))
    visits = [[0] * world.n_actions for _ in range(world.n_states)]
    s, begin = world.start, process_time()
    while run.steps < steps and not enough(run):
        a = world.drawn[run.steps] if world.explores[run.steps] else int(best[s])
        visit = visits[s][a]
        visits[s][a] += 1
        following = world.successor(s, a, visit)
        delta = gamma * q[following, best[following]] - q[s, a]
        delta[levels[s, a]] += 1.0 - gamma
        q[s, a] += rates[visit] * delta
        best[s] = tournament(q[s], int(best[s]), every if a == best[s] else [a], judge, tutor, run)
        s = following
        run.steps += 1
        run.seconds = process_time() - begin
    return run


def tournament(
    q: Floats, best: int, challengers: list[int], judge: Judge, tutor: Tutor, run: Run
) -> int:
    """The best action of a state with vectors q (A, k): each challenger meets the best so far
    (Algorithm 2).
    """
    d, t, verdicts = screened(q, best, challengers)
    for i, challenger in enumerate(challengers):
        if challenger == best:
            continue
        run.compared += 1
        verdict = verdicts[i]
        if verdict == OPEN:
            verdict = settled(d[i], t[i], judge, tutor, run)
        if verdict == BETTER:
            best = challenger
            d, t, verdicts = screened(q, best, challengers)
    return best


def screened(q: Floats, best: int, challengers: list[int]) -> tuple[Floats, Floats, list[int]]:
    """All challengers against the best so far at once: differences, tail sums, and verdicts by
    dominance.
    """
    d = q[challengers] - q[best]
    t = tail_sums(d)
    return d, t, dominance(t).tolist()


def settled(d: Floats, t: Floats, judge: Judge, tutor: Tutor, run: Run) -> int:
    """The judge's verdict, or else the tutor's, which the judge then learns."""
    start = process_time()
    run.opened += 1
    verdict = judge.settle(unit(t))
    if verdict not in (-1, 0, 1):  # UNKNOWN, or no optimum
        verdict = int(tutor.signs(d[None])[0])
        run.asked.append(d.copy())
        run.said.append(verdict)
        judge.learn(Answers(d[None], [verdict]))
    run.judging += process_time() - start
    return verdict


class Rebuilt(methods.CvxpyRebuilt):
    """The paper's two programs over K_t, stated anew in cvxpy for each comparison."""

    def __init__(self, k: int) -> None:
        super().__init__(k, MARGIN)

    def settle(self, t: Floats) -> int:
        return methods.verdict(self.sign(t), -self.sign(-t))


class Careful(methods.Careful):
    """One hot HiGHS model, and as a rule one program for each comparison."""

    def __init__(self, k: int) -> None:
        super().__init__(k, MARGIN)


class Bootstrap:
    """Section 3.2: a logistic regression (eq. 7, with a ridge) to each of m resamples of the
    answers, all anew after every answer. "box": the extremes of d.theta over a percentile interval
    for each theta_i, as in the paper; "ensemble": the percentiles of d.theta. Up to ``FEW`` answers
    they decide nothing."""

    def __init__(self, k: int, region: Literal["box", "ensemble"], seed: int = 0) -> None:
        from sklearn.linear_model import LogisticRegression  # type: ignore[import-untyped, unused-ignore]

        self.region, self.rng = region, np.random.default_rng(seed)
        self.t, self.y = np.empty((0, k - 1)), np.empty(0, dtype=np.int8)
        self.gamma = np.empty(
            (0, k - 1)
        )  # what each fit says each step of the scale is worth, in logits
        self.model = LogisticRegression(C=1.0 / RIDGE, fit_intercept=False)

    def learn(self, answers: Answers) -> None:
        self.add(answers)
        self.refit()

    def add(self, answers: Answers) -> None:
        """Keep answers; a tie says nothing."""
        told = answers.y != 0
        self.t = np.concatenate([self.t, tail_sums(answers.d)[told]])
        self.y = np.concatenate([self.y, answers.y[told]])

    def refit(self) -> None:
        n = len(self.y)
        drawn = [self.rng.integers(n, size=n) for _ in range(RESAMPLES if n else 0)]
        self.gamma = np.array([self.fit(self.t[rows], self.y[rows]) for rows in drawn]).reshape(
            -1, self.t.shape[1]
        )

    def fit(self, t: Floats, y: NDArray[np.int8]) -> Floats:
        """Each answer both ways round, at half the weight: scikit-learn wants answers of both
        kinds.
        """
        rows, kinds = np.concatenate([t, -t]), np.concatenate([y, -y])
        return np.array(self.model.fit(rows, kinds, sample_weight=np.full(len(rows), 0.5)).coef_[0])

    def settle(self, t: Floats) -> int:
        if len(self.y) <= FEW:
            return OPEN
        ends = (1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0
        if self.region == "ensemble":
            low, high = np.quantile(self.gamma @ t, ends)
        else:
            theta = np.quantile(np.cumsum(self.gamma, axis=1), ends, axis=0)  # theta_1 = 0
            d = methods.shares(t)[1:]
            low, high = (
                np.minimum(d * theta[0], d * theta[1]).sum(),
                np.maximum(d * theta[0], d * theta[1]).sum(),
            )
        return int(low > 0) - int(high < 0) if low > 0 or high < 0 else OPEN
