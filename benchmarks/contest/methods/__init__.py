"""The methods of the contest, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import find_spec
from typing import NamedTuple

from benchmarks.contest.harness import Method
from benchmarks.contest.methods.aprel import RULES, APReL
from benchmarks.contest.methods.botorch_eubo import BestOption
from benchmarks.contest.methods.expected_utility import ExpectedUtility
from benchmarks.contest.methods.gaussian_process import OrderedElicitation
from benchmarks.contest.methods.information_directed import InformationDirected
from benchmarks.contest.methods.minimax_regret import MinimaxRegret
from benchmarks.contest.methods.ours import PolicyIteration
from benchmarks.contest.methods.policy_comparisons import PolicyComparisons
from benchmarks.contest.methods.polyhedral import Polyhedral
from benchmarks.contest.methods.simple import Bisection, RandomPairs
from elicit.asking.magnified import AS_THEY_ARE

WORST, START = "at the worst state", "from the start"


class Entry(NamedTuple):
    """A method: how to make one, and what it claims when it is done.

    ``claims`` names the loss that it says is at most 1%, or is empty. ``promises`` is the chance
    with which it says so of a tutor who errs, which takes many runs to judge; 0 for no promise.
    ``only`` is the one tutor that it takes part with, if it is made for no other. ``runs`` is how
    many runs of each problem and tutor a slow method plays, one in every four; 0 for all of them.
    ``needs`` is a package that it imports, and that this project does not require.
    """

    make: Callable[[], Method]
    claims: str = ""
    promises: float = 0.0
    only: str = ""
    runs: int = 0
    needs: str = ""

    @property
    def playable(self) -> bool:
        """Return whether the package that it needs is installed."""
        return not self.needs or find_spec(self.needs) is not None


METHODS: Mapping[str, Entry] = {
    "ours: polytope": Entry(partial(PolicyIteration, "polytope"), WORST, only="truthful"),
    "ours: posterior": Entry(partial(PolicyIteration, "posterior"), WORST, 0.95),
    "ours: posterior, as they are": Entry(
        partial(PolicyIteration, "posterior", AS_THEY_ARE), WORST, 0.95
    ),
    "minimax regret: current solution": Entry(partial(MinimaxRegret, "current solution"), START),
    "minimax regret: largest gap": Entry(partial(MinimaxRegret, "largest gap"), START),
    "expected utility (EVOI, EUBO)": Entry(ExpectedUtility, START),
    "qEUBO (BoTorch)": Entry(BestOption, runs=1, needs="botorch"),
    "qEUBO (BoTorch), linear kernel": Entry(partial(BestOption, True), runs=1, needs="botorch"),
    "IDRL": Entry(InformationDirected),
    **{f"APReL: {rule}": Entry(partial(APReL, rule)) for rule in RULES},
    "Gaussian process (Zintgraf)": Entry(OrderedElicitation),
    "policy comparisons (Shao)": Entry(PolicyComparisons, START),
    "polyhedral (Toubia)": Entry(Polyhedral),
    "bisection of each level": Entry(Bisection, WORST),
    "random pairs": Entry(RandomPairs),
}
