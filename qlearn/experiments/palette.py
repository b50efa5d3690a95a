"""What tables and pictures call a problem, a learner and a comparator, and one colour and marker a comparator."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import cycle
from typing import Any

NAMES = {
    "random": "random MDP",
    "icu": "ICU-Sepsis",
    "frozen-lake": "FrozenLake 8x8",
    "deep-sea-treasure": "deep-sea-treasure",
    "q-learning": "Q-learning",
    "ivi": "value iteration",
    "always": "always ask",
    "polytope": "polytope",
    "relaxed": "relaxed polytope",
    "posterior": "posterior",
    "posterior-close": "posterior, indifferent",
    "ensemble": "Bradley-Terry ensemble",
    "box": "Bradley-Terry box",
    "box-rescaled": "Bradley-Terry box, rescaled",
}
# Okabe and Ito's colours; the markers and line styles tell the same in grey
STYLES: dict[str, dict[str, Any]] = {
    "always": {"color": "#000000", "marker": "D", "linestyle": (0, (1, 1.5))},
    "polytope": {"color": "#D55E00", "marker": "s", "linestyle": "-"},
    "relaxed": {"color": "#E69F00", "marker": "v", "linestyle": (0, (1, 1))},
    "posterior": {"color": "#CC79A7", "marker": "P", "linestyle": (0, (8, 2))},
    "posterior-close": {"color": "#7A5195", "marker": "X", "linestyle": (0, (2, 1))},
    "ensemble": {"color": "#0072B2", "marker": "o", "linestyle": (0, (5, 1.5))},
    "box": {"color": "#009E73", "marker": "^", "linestyle": (0, (4, 1.5, 1, 1.5))},
    "box-rescaled": {"color": "#56B4E9", "marker": "p", "linestyle": (0, (3, 1, 1, 1, 1, 1))},
}
_OWN: tuple[dict[str, Any], ...] = (  # of comparators of the user's, in their order
    {"color": "#8C564B", "marker": "*", "linestyle": (0, (6, 1, 1, 1, 1, 1))},
    {"color": "#332288", "marker": "<", "linestyle": (0, (3, 1.5))},
    {"color": "#999933", "marker": "h", "linestyle": (0, (7, 1, 1, 1))},
    {"color": "#882255", "marker": ">", "linestyle": (0, (2, 2, 6, 2))},
    {"color": "#44AA99", "marker": "d", "linestyle": (0, (1, 1, 4, 1))},
    {"color": "#666666", "marker": "8", "linestyle": (0, (9, 1.5))},
)


def styles(comparators: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The style of each comparator: ours as in ``STYLES``, others in their order, no two alike among the first six."""
    own = cycle(_OWN)
    return {name: STYLES[name] if name in STYLES else next(own) for name in dict.fromkeys(comparators)}
