"""A simulated tutor who errs as people do.

Its parameters differ from person to person. They are drawn from the distribution that was found in
public experiments in which people answered the same questions many times: see docs/people.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from elicit._support.hashing import Seed, fold, key_of, name_code, uniform
from elicit._support.seeds import seed_of
from elicit.comparators.bradley_terry.density import EQUAL_LAPSES
from elicit.model.difference import tail_sums
from elicit.model.difference_kernel import pair_code, way_round
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats, normalise

_PERSON = name_code("parameters of a person")
_ERRORS = name_code("errors of a person")
_LEAST_SPREAD = 1e-4  # of two bags that hold one level each: then the answer is clear


class Population(NamedTuple):
    """The distribution of people from which ``PersonTutor`` draws a person.

    The logarithm of the precision is normal, the lapse is Beta(a, b), and the side bias is normal.
    A share ``ties`` of the people sometimes answers EQUAL. The logarithm of their width of EQUAL is
    normal. Precision, bias and width are in logits.
    """

    log_precision: float
    log_precision_sd: float
    lapse_a: float
    lapse_b: float
    ties: float
    log_width: float
    log_width_sd: float
    side: float
    side_sd: float


DRAWN_FROM = Population(
    log_precision=3.15,
    log_precision_sd=1.74,
    lapse_a=0.27,
    lapse_b=2.95,
    ties=0.53,
    log_width=-3.05,
    log_width_sd=1.9,
    side=0.04,
    side_sd=0.04,
)
"""Parameters found on half of the people: see PersonTutor in benchmarks/RESULTS-people.md."""


class PersonTutor:
    """A simulated tutor who errs as people do in experiments. The seed determines the person.

    With probability 1 - ``lapse`` the person weighs the two bags. They say "left" with probability
    sigma(precision d.e / spread + side - width), "right" with sigma(-precision d.e / spread - side
    - width), and otherwise EQUAL. ``side`` is a bias to the left. The spread is the root of the
    mean variance of value within the bags: bags of mixed levels are harder to compare. With
    probability ``lapse`` they say "left" or "right", equally often. If the person ever says EQUAL
    of bags that differ, a share ``EQUAL_LAPSES`` of these lapses says EQUAL instead.

    Errors depend only on the seed, the pair, in either order, and how often it was asked before.

    Parameters
    ----------
    values : (k,)
        The hidden scale, increasing, in any unit.
    seed : int, SeedSequence, Generator or None
        Draws the person, and the errors.

    Attributes
    ----------
    precision, lapse, width, side : float
        The person's parameters. With a width of 0 they call only identical bags EQUAL.

    Raises
    ------
    ValueError
        If the values do not increase.
    """

    def __init__(self, values: ArrayLike, seed: Seed | None = 0) -> None:
        self._e = normalise(values)
        self.seed = seed_of(seed)
        key = key_of(self.seed)
        rng = np.random.Generator(np.random.PCG64(int(fold(key, _PERSON))))
        law = DRAWN_FROM
        self.precision = float(np.exp(rng.normal(law.log_precision, law.log_precision_sd)))
        self.lapse = float(rng.beta(law.lapse_a, law.lapse_b))
        self.side = float(rng.normal(law.side, law.side_sd))
        says_equal, width = rng.random() < law.ties, rng.normal(law.log_width, law.log_width_sd)
        self.width = float(np.exp(width)) if says_equal else 0.0
        self._key = np.uint64(fold(key, _ERRORS))
        self._times: dict[int, int] = {}
        self._given = self._wrong = 0

    def __repr__(self) -> str:
        return (
            f"PersonTutor(k={self.k}, precision={self.precision:.3g}, lapse={self.lapse:.3g}, "
            f"width={self.width:.3g}, side={self.side:.2g}, seed={self.seed})"
        )

    @property
    def k(self) -> int:
        """Number of levels."""
        return len(self._e)

    @property
    def values(self) -> Floats:
        """The person's hidden scale (k,), from 0 for the worst level to 1 for the best."""
        return self._e.copy()

    @property
    def realised_error_rate(self) -> float:
        """Share of the answers so far that said the opposite of the truth; nan before the first."""
        return self._wrong / self._given if self._given else float("nan")

    def probabilities(self, query: Query) -> tuple[float, float, float]:
        """Return the probabilities of the answers left, right and EQUAL to a query.

        Parameters
        ----------
        query : Query

        Returns
        -------
        left, right, equal : float
            They total 1.

        Raises
        ------
        ValueError
            If the query is not about k levels.
        """
        if len(query.left) != self.k:
            raise ValueError(
                f"the query is about {len(query.left)} levels, but the tutor was made for {self.k}"
            )
        if not tail_sums(query.d).any():
            return 0.0, 0.0, 1.0
        left, right = _bags(query)
        squares = float((left + right) @ self._e**2) / 2
        means = float((left @ self._e) ** 2 + (right @ self._e) ** 2) / 2
        spread = max(float(np.sqrt(max(0.0, squares - means))), _LEAST_SPREAD)
        logit = self.precision * float((left - right) @ self._e) / spread + self.side
        any_answer = 0.5 * self.lapse * (1.0 - EQUAL_LAPSES if self.width else 1.0)
        yes = any_answer + (1.0 - self.lapse) * float(expit(logit - self.width))
        no = any_answer + (1.0 - self.lapse) * float(expit(-logit - self.width))
        return yes, no, max(0.0, 1.0 - yes - no) if self.width else 0.0

    def __call__(self, query: Query) -> Answer:
        """Return the person's answer to a query.

        Parameters
        ----------
        query : Query

        Returns
        -------
        Answer
            Drawn from ``probabilities``. The person can always tell.

        Raises
        ------
        ValueError
            If the query is not about k levels.
        """
        left, right, equal = self.probabilities(query)
        self._given += 1
        if equal == 1.0:
            return Answer(query, Verdict.EQUAL)
        t = np.ascontiguousarray(tail_sums(query.d))
        way = int(way_round(t))
        with np.errstate(all="ignore"):  # the hash wraps around
            code = int(pair_code(self._key, t))
        times = self._times.get(code, 0)
        self._times[code] = times + 1
        u = float(uniform(fold(np.uint64(code), times)))
        first, last = (left, right) if way > 0 else (right, left)
        verdict = way if u < first else -way if u >= 1.0 - last else 0
        truth = float(query.d @ self._e)
        self._wrong += verdict * truth < 0
        return Answer(query, Verdict(verdict))


def _bags(query: Query) -> tuple[Floats, Floats]:
    """Return left and right (k,) as shares of total 1.

    A missing share is added at the worst level.
    """
    both = np.stack([query.left, query.right])
    both = both - np.minimum(both.min(axis=0), 0.0)
    totals = both.sum(axis=1)
    both[:, 0] += totals.max() - totals
    both /= totals.max()
    return both[0], both[1]
