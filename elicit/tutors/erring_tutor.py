"""The likelihood of an erring tutor's answers, used by all code that predicts answers.

It is the paper's eq. (6) with lapses. A tutor with precision c says that left is better with
probability lapse/2 + (1 - lapse) / (1 + exp(-c d.e)). The posterior has a compiled version,
``comparators.bradley_terry.density.log_term``, which gives logarithms and includes answers "equal".
"""

import numpy as np

from elicit.model.scale import Floats


def says_left(scores: Floats, precision: Floats, lapse: float) -> Floats:
    """Return the probability (n, m) that a tutor says "left is better".

    Parameters
    ----------
    scores : (n, m)
        d.e of n differences under m scales.
    precision : (m,)
        The tutor's precision under each scale. An infinite one never errs, but tosses a coin at
        d.e = 0.
    lapse : float
        Share of the answers that are given at random.

    Returns
    -------
    (n, m)
    """
    with np.errstate(over="ignore", invalid="ignore"):
        chance = np.asarray(-(precision * scores))
        if not np.isfinite(precision).all():
            chance = np.nan_to_num(chance, nan=0.0)
        np.exp(chance, out=chance)
        chance += 1.0
        np.divide(1.0 - lapse, chance, out=chance)
        chance += 0.5 * lapse
    return chance
