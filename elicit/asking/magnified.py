"""Questions about a multiple of a difference: easier to tell, and saying the same.

Two actions at one state often lead to nearly the same. A tutor who errs where little is at stake
then answers nearly by chance. Whole policies or gambles differ by more, which is why published
methods ask about those. But the sign of d.e is that of any positive multiple of d: so the common
part of the two sides can be shrunk, and what differs enlarged.
"""

import math
from typing import Final, Literal

import numpy as np

from elicit.asking.elicitation import Pair

MAGNIFIED: Final[Literal["magnified"]] = "magnified"
"""The name of this among ways to ask."""


def magnified(pair: Pair) -> Pair:
    """Return a pair whose difference is larger by the greatest power of two that there is room for.

    The total of the larger side stays as it is, and so do the proportions of what both sides have
    in common. A pair is known by its value up to powers of two, so it is not asked about twice.
    """
    common = np.minimum(pair.left, pair.right)
    total = float(max(pair.left.sum(), pair.right.sum()))
    apart = total - float(common.sum())
    if not 0.0 < apart < total:
        return pair
    times = 2.0 ** math.floor(math.log2(total / apart))
    if times <= 1.0:
        return pair
    shrunk = common * ((total - times * apart) / float(common.sum()))
    left, right = (times * (side - common) + shrunk for side in (pair.left, pair.right))
    about = f"{pair.about} (the difference {times:g} times as large)"
    return pair._replace(left=left, right=right, about=about)
