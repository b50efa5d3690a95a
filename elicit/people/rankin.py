"""The modified Rankin scale: published weights of its seven levels, and outcomes of trials.

The scale says how disabled somebody is after a stroke, from 0 (no symptoms) to 6 (dead). Its levels
are ordered, and studies disagree on what each is worth. Here levels run from the worst to the best,
as everywhere in this package, so the last is Rankin 0.

Trials report shares of patients at each level. Some reports pool several levels. Then the pooled
patients are counted at one of these, as ``Trial.pooled`` says.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.validation import is_list, is_number, require
from elicit.model.difference import as_vectors
from elicit.model.query import Answer, Query, Verdict
from elicit.model.scale import Floats

LEVELS = (
    "dead",
    "bedridden, in constant care",
    "cannot walk without help",
    "walks, but needs some help",
    "slight disability",
    "symptoms, but no disability",
    "no symptoms",
)
"""The levels, worst first: Rankin 6, 5, 4, 3, 2, 1 and 0."""
_EXACT = 1e-9  # differences in worth below this are rounding: published weights have two digits


class Weights(NamedTuple):
    """Published values of the levels, (7,) worst first, and the study that they are from.

    Attributes
    ----------
    values : (7,)
        The value of each level.
    source : str
        The study.
    """

    values: tuple[float, ...]
    source: str


class Trial(NamedTuple):
    """Shares of patients at each level, (7,) worst first, with and without a treatment.

    Attributes
    ----------
    treated, control : (7,)
        Shares of the patients in each arm, of total 1.
    about : str
        The treatment, the patients and the time of the outcome, in words.
    pooled : str
        The levels of the Rankin scale that the report pools, or "none".
    source : str
        The report.
    """

    treated: tuple[float, ...]
    control: tuple[float, ...]
    about: str
    pooled: str
    source: str


def _worst_first(*rankin_0_to_6: float) -> tuple[float, ...]:
    return rankin_0_to_6[::-1]


WEIGHTS: Mapping[str, Weights] = {
    "utility weights": Weights(
        _worst_first(1.0, 0.91, 0.76, 0.65, 0.33, 0.0, 0.0), "PubMed 26138130"
    ),
    "disability weights": Weights(
        tuple(round(1 - x, 3) for x in _worst_first(0, 0.046, 0.212, 0.331, 0.652, 0.944, 1)),
        "Hong and Saver 2009, PubMed 19797698 (1 less the disability)",
    ),
    "22,946 patients": Weights(
        _worst_first(0.96, 0.83, 0.72, 0.54, 0.22, -0.18, 0.0), "PubMed 32640944"
    ),
}
"""Three published sets of weights. In the last, constant care in bed is worse than death."""


def trials(better: bool = False) -> dict[str, Trial]:
    """Return outcomes of trials, by the name of the treatment.

    Parameters
    ----------
    better : bool
        If a report pools levels, count its patients at the best of these. By default they are
        counted at the worst.

    Returns
    -------
    dict of str to Trial
        Shares of each arm total 1. Reports round to whole percents or tenths, so shares are divided
        by their total.

    Examples
    --------
    >>> old = trials()["decompression over 60"]
    >>> [round(share, 2) for share in old.treated]
    [0.33, 0.28, 0.32, 0.07, 0.0, 0.0, 0.0]
    """

    def shares(*parts: tuple[float, int, int]) -> tuple[float, ...]:
        """Return shares (7,) from percents at Rankin ``best`` to ``worst``.

        A pooled percentage is counted at one end of its pool.
        """
        row = np.zeros(len(LEVELS))
        for percent, best, worst in parts:
            row[len(LEVELS) - 1 - (best if better else worst)] += percent
        return tuple((row / row.sum()).tolist())

    def single(*percents: float) -> tuple[float, ...]:
        return shares(*((percent, i, i) for i, percent in enumerate(percents)))

    def up_to_3(good: float, *rest: float) -> tuple[float, ...]:
        return shares((good, 0, 3), *((percent, i, i) for i, percent in enumerate(rest, start=4)))

    return {
        "thrombectomy": Trial(
            single(10.0, 16.9, 19.1, 16.9, 15.6, 6.2, 15.3),
            single(5.0, 7.9, 13.6, 16.4, 24.7, 13.5, 18.9),
            "removal of the clot after a large stroke, five trials, at 90 days",
            "none",
            "Goyal et al. 2016, doi 10.1016/S0140-6736(16)00163-X",
        ),
        "decompression up to 60": Trial(
            up_to_3(43, 32, 3, 22),
            up_to_3(21, 3, 5, 71),
            "opening the skull after a malignant stroke, three trials, at 12 months",
            "0 to 3",
            "Vahedi et al. 2007, doi 10.1016/S1474-4422(07)70036-4",
        ),
        "decompression over 60": Trial(
            single(0, 0, 0, 7, 32, 28, 33),
            single(0, 0, 0, 3, 15, 13, 70),
            "the same operation from 61 years on, DESTINY II",
            "none",
            "Juettler et al. 2014, doi 10.1056/NEJMoa1311367",
        ),
        "clot lysis in the ventricles": Trial(
            up_to_3(48, 17, 17, 18),
            up_to_3(45, 17, 9, 29),
            "alteplase through a drain after a haemorrhage, CLEAR III, at 180 days",
            "0 to 3",
            "Hanley et al. 2017, doi 10.1016/S0140-6736(16)32410-2",
        ),
        "lower blood pressure": Trial(
            single(8.1, 21.2, 18.7, 15.9, 18.1, 6.0, 12.0),
            single(7.6, 18.0, 18.8, 16.6, 19.0, 8.0, 12.0),
            "intensive lowering after a haemorrhage, INTERACT2, at 90 days",
            "none",
            "Anderson et al. 2013, doi 10.1056/NEJMoa1214609",
        ),
        "thrombolysis": Trial(
            shares((39, 0, 1), (21, 2, 3), (23, 4, 5), (17, 6, 6)),
            shares((26, 0, 1), (25, 2, 3), (27, 4, 5), (21, 6, 6)),
            "t-PA within three hours, NINDS part 2, at 3 months",
            "0 and 1, 2 and 3, 4 and 5",
            "NINDS rt-PA study group 1995, doi 10.1056/NEJM199512143332401",
        ),
    }


def programmes(better: bool = False) -> tuple[tuple[str, ...], Floats]:
    """Return the outcomes of all patients if a hospital can afford only one of the treatments.

    The hospital sees equally many patients of each trial. In each programme the patients of one
    trial are treated, and all others have the outcomes of their control arms.

    Parameters
    ----------
    better : bool
        As in ``trials``.

    Returns
    -------
    names : tuple of str
        The n treatments.
    shares : (n, 7)
        Outcomes of all patients together, worst level first, for ``elicit.choose``.
    """
    found = trials(better)
    control = np.array([trial.control for trial in found.values()])
    treated = np.array([trial.treated for trial in found.values()])
    return tuple(found), (control.sum(axis=0) + treated - control) / len(found)


def worth(shares: ArrayLike, weights: Weights) -> Floats:
    """Return the mean value (n,) of shares (n, 7), from 0 for the worst level to 1 for the best.

    Parameters
    ----------
    shares : (n, 7)
        Shares of the levels, worst first.
    weights : Weights
        One of ``WEIGHTS``, or your own.

    Returns
    -------
    (n,)
        The mean values. The level of the least weight counts 0, and that of the greatest 1.

    Raises
    ------
    TypeError
        If ``weights`` is no Weights, such as only a name.
    ValueError
        If there are not seven weights, or they are all the same, or shares are not of seven levels.
    """
    values = _values_of(weights)
    low, high = values.min(), values.max()
    require(high > low, "weights", "numbers of which some differ", weights.values)
    rows = as_vectors(shares, len(LEVELS), "shares")
    return np.asarray(rows @ ((values - low) / (high - low)))


def tutor_of(weights: Weights) -> Callable[[Query], Answer]:
    """Return a tutor who always answers by published weights.

    Unlike ``elicit.TruthfulTutor`` it takes weights that do not rise from level to level.

    Parameters
    ----------
    weights : Weights
        One of ``WEIGHTS``, or your own.

    Returns
    -------
    function
        The tutor: it takes a Query and returns an Answer. Differences in worth that rounding alone
        could make are answered EQUAL.

    Raises
    ------
    TypeError
        If ``weights`` is no Weights, such as only a name.
    ValueError
        If there are not seven weights. The tutor raises it for a query about other levels.

    Examples
    --------
    >>> tutor = tutor_of(WEIGHTS["22,946 patients"])
    >>> bedridden, dead = [0, 1, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0, 0]
    >>> tutor(elicit.Query.make("example", 0, bedridden, dead)).verdict
    <Verdict.WORSE: -1>
    """
    values = _values_of(weights)

    def answer(query: Query) -> Answer:
        if len(query.d) != len(LEVELS):
            raise ValueError(
                f"query {query.id} is about {len(query.d)} levels, but these weights are of "
                f"{len(LEVELS)}"
            )
        apart = float(np.dot(query.d, values))
        sign = 0 if abs(apart) <= _EXACT else 1 if apart > 0 else -1
        return Answer(query, Verdict(sign))

    return answer


def _values_of(weights: Weights) -> Floats:
    """Return the worth (7,) of each level. Raises TypeError and ValueError."""
    if not isinstance(weights, Weights):
        raise TypeError(
            f"weights must be rankin.Weights, such as WEIGHTS[{next(iter(WEIGHTS))!r}], not "
            f"{weights!r}"
        )
    known = is_list(weights.values, len(LEVELS)) and all(map(is_number, weights.values))
    require(known, "weights", f"{len(LEVELS)} finite numbers", weights.values)
    return np.array(weights.values, dtype=float)
