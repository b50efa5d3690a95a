"""Methods of the contest that a quick run tries."""

from benchmarks.contest.methods import METHODS
from tests.thoroughness import quick_first

_QUICK = ("ours: posterior", "minimax regret: current solution", "random pairs")
TRIED = quick_first(
    [*_QUICK, *(name for name in METHODS if name not in _QUICK and METHODS[name].playable)],
    len(_QUICK),
)
