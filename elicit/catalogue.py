"""The catalogue of comparators: name, factory, label and look of each.

The catalogue's order is that of tables and legends. Tables, pictures and commands take a
comparator's name and its look from here. ``LOOKS`` has the looks of everything else that pictures
compare, such as learners.

Importing this module imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import cycle
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elicit._support.hashing import Seed
    from elicit.model.comparator import Comparator


def _always_ask(k: int, seed: Seed, **settings: Any) -> Comparator:
    from elicit.comparators.baselines import AlwaysAsk

    return AlwaysAsk(k, **settings)


def _polytope(k: int, seed: Seed, **settings: Any) -> Comparator:
    from elicit.comparators.polytope.comparator import PolytopeComparator

    return PolytopeComparator(k, **settings)


def _posterior(k: int, seed: Seed, **settings: Any) -> Comparator:
    from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator

    return PosteriorComparator(k, seed=seed, **settings)


def _bradley_terry(k: int, seed: Seed, **settings: Any) -> Comparator:
    from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator

    return BradleyTerryComparator(k, seed=seed, **settings)


@dataclass(frozen=True, kw_only=True)
class ComparatorEntry:
    """One comparator of the catalogue.

    name         its name on the command line, in rows of results and in journals
    label        its name in pictures; the table of ``qlearn ablate`` has ``name``
    kind         the name of its class
    factory      a function that makes it, from k, a seed for its draws, and keywords
    color, marker, linestyle    its look, as matplotlib's keywords
    fixed        keywords that tell it apart from others of its class
    options      settings of the ablation that the factory takes, by name; () if it takes none
    learns       whether answers change what it knows
    proves       whether its bounds on the loss of a policy are tight enough for policy iteration to
                 end
    trusts       whether it takes each answer as a fact, so that a later answer can contradict it
    indifferent  whether the learner treats close pairs as equal; apart from that, the comparator is
                 the one of the same class that is not ``indifferent``
    cost         rough CPU time of a run, as a multiple of the cheapest; it orders the runs of a
                 sweep
    compiles     the small run of ``qlearn.experiments.compile_ahead`` that compiles the code it
                 needs
    quick        whether ``qlearn ablate --quick`` runs it
    """

    name: str
    label: str
    kind: str
    factory: Callable[..., Comparator]
    color: str
    marker: str
    linestyle: Any
    fixed: Mapping[str, Any] = field(default_factory=dict)
    options: tuple[str, ...] = ("tie",)
    learns: bool = True
    proves: bool = True
    trusts: bool = False
    indifferent: bool = False
    cost: float = 1.0
    compiles: str | None = None
    quick: bool = False

    @property
    def look(self) -> dict[str, Any]:
        """Colour, marker and line, as matplotlib's keywords."""
        return {"color": self.color, "marker": self.marker, "linestyle": self.linestyle}

    def make(self, k: int, seed: Seed, settings: Mapping[str, Any] | None = None) -> Comparator:
        """Return the comparator for k levels.

        Those of ``settings`` that are among the entry's ``options`` are passed on, and the others
        ignored.
        """
        given = {name: value for name, value in (settings or {}).items() if name in self.options}
        return self.factory(k, seed, **self.fixed, **given)

    def is_kind_of(self, comparator: Comparator) -> bool:
        """Return whether the comparator is of this entry's class and has its fixed keywords."""
        if type(comparator).__name__ != self.kind:
            return False
        return all(getattr(comparator, name) == value for name, value in self.fixed.items())


_POSTERIOR: Mapping[str, Any] = {
    "kind": "PosteriorComparator",
    "factory": _posterior,
    "options": ("lapse", "level", "particles", "tie"),
    "cost": 3.0,
    "compiles": "moves",
}
_BRADLEY_TERRY: Mapping[str, Any] = {
    "kind": "BradleyTerryComparator",
    "factory": _bradley_terry,
    "options": ("precision", "n_boot", "level", "refit_growth", "tie"),
}
_ENTRIES = (  # Okabe and Ito's colours; the markers and line styles tell the same in grey
    ComparatorEntry(
        name="always",
        label="always ask",
        kind="AlwaysAsk",
        factory=_always_ask,
        color="#000000",
        marker="D",
        linestyle=(0, (1, 1.5)),
        learns=False,
        proves=False,
        quick=True,
    ),
    ComparatorEntry(
        name="polytope",
        label="polytope",
        kind="PolytopeComparator",
        factory=_polytope,
        color="#D55E00",
        marker="s",
        linestyle="-",
        fixed={"wrong": 0},
        trusts=True,
        compiles="proofs",
        quick=True,
    ),
    ComparatorEntry(
        name="polytope-1-wrong",
        label="polytope, one wrong",
        kind="PolytopeComparator",
        factory=_polytope,
        color="#7F3B08",
        marker="H",
        linestyle=(0, (6, 1, 1, 1)),
        fixed={"wrong": 1},
        cost=10.0,
        compiles="proofs",
    ),
    ComparatorEntry(
        name="posterior",
        label="posterior",
        color="#CC79A7",
        marker="P",
        linestyle=(0, (8, 2)),
        quick=True,
        **_POSTERIOR,
    ),
    ComparatorEntry(
        name="posterior-close",
        label="posterior, indifferent",
        color="#7A5195",
        marker="X",
        linestyle=(0, (2, 1)),
        indifferent=True,
        **_POSTERIOR,
    ),
    ComparatorEntry(
        name="ensemble",
        label="Bradley-Terry ensemble",
        color="#0072B2",
        marker="o",
        linestyle=(0, (5, 1.5)),
        fixed={"region": "ensemble"},
        cost=4.0,
        quick=True,
        **_BRADLEY_TERRY,
    ),
    ComparatorEntry(
        name="box-rescaled",
        label="Bradley-Terry box, rescaled",
        color="#56B4E9",
        marker="p",
        linestyle=(0, (3, 1, 1, 1, 1, 1)),
        fixed={"region": "box", "rescale": True},
        cost=4.0,
        proves=False,
        **_BRADLEY_TERRY,
    ),
    ComparatorEntry(
        name="box",
        label="Bradley-Terry box",
        color="#009E73",
        marker="^",
        linestyle=(0, (4, 1.5, 1, 1.5)),
        fixed={"region": "box"},
        cost=8.0,
        proves=False,
        **_BRADLEY_TERRY,
    ),
)
COMPARATORS: Mapping[str, ComparatorEntry] = {entry.name: entry for entry in _ENTRIES}
"""The comparators by name."""
OWN = "own comparator"
"""The name of the look of a comparator that the catalogue does not have."""
_THREE_POINTS, _FOUR_POINTS = (3, 1, 180), (4, 1, 0)  # matplotlib's stars of so many points
_HOURGLASS = ((-0.8, -1), (0.8, -1), (-0.8, 1), (0.8, 1), (-0.8, -1))  # vertices of the marker
_BOW_TIE = ((-1, -0.8), (-1, 0.8), (1, -0.8), (1, 0.8), (-1, -0.8))
LOOKS: Mapping[str, Mapping[str, Any]] = {
    "polytope, audited": {"color": "#8B0000", "marker": "d", "linestyle": (0, (3, 1, 1, 1))},
    "audited, repaired": {"color": "#332288", "marker": _FOUR_POINTS, "linestyle": (0, (3, 1.5))},
    "asked 3 times": {"color": "#999933", "marker": "h", "linestyle": (0, (7, 1, 1, 1))},
    "policy iteration": {"color": "#117733", "marker": ">", "linestyle": "-"},
    "value iteration": {"color": "#882255", "marker": "<", "linestyle": (0, (5, 1.5))},
    "value iteration, late": {"color": "#B8860B", "marker": "v", "linestyle": (0, (2, 1))},
    "Q-learning": {"color": "#44AA99", "marker": "8", "linestyle": (0, (1, 1))},
    "random questions": {"color": "#666666", "marker": "x", "linestyle": (0, (3, 1, 1, 1))},
    "bare bootstrap": {"color": "#00385C", "marker": _HOURGLASS, "linestyle": (0, (1, 1.5))},
    "posterior, lapse 20%": {"color": "#7B2D5E", "marker": _THREE_POINTS, "linestyle": (0, (1, 2))},
    OWN: {"color": "#8C564B", "marker": _BOW_TIE, "linestyle": (0, (6, 1, 1, 1, 1, 1))},
}
"""The look of ways of asking, of learners and of other comparators in pictures, by their label."""
ALWAYS = "always"
"""The name of the comparator that learns nothing. With a truthful tutor it is the oracle."""

STYLES: dict[str, dict[str, Any]] = {name: entry.look for name, entry in COMPARATORS.items()}
"""The colour, marker and line of each comparator, by the name that ``qlearn ablate`` gives it."""
OTHER_LOOKS: tuple[dict[str, Any], ...] = (
    {**LOOKS[OWN]},
    {"color": "#4477AA", "marker": "<", "linestyle": (0, (3, 1.5))},
    {"color": "#AAAA00", "marker": "h", "linestyle": (0, (7, 1, 1, 1))},
    {"color": "#AA3377", "marker": ">", "linestyle": (0, (2, 2, 6, 2))},
    {"color": "#225555", "marker": "d", "linestyle": (0, (1, 1, 4, 1))},
    {"color": "#777777", "marker": "8", "linestyle": (0, (9, 1.5))},
)
"""The looks of names that the catalogue does not have, in this order: the first is ``OWN``'s."""
PEOPLE: tuple[dict[str, Any], ...] = (
    {"color": "#000060", "marker": "o"},
    {"color": "#E3B505", "marker": "s"},
    {"color": "#A50F4C", "marker": "^"},
    {"color": "#6C6CFC", "marker": "D"},
    {"color": "#F2A48C", "marker": "v"},
    {"color": "#6C2424", "marker": "p"},
)
"""The looks of people beside each other. No comparator has one of these colours."""


def styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the colour, marker and line of each name, as matplotlib's keywords.

    A comparator's look is the one in ``STYLES``. Learners ("policy iteration") and ways of asking
    ("polytope, audited") have fixed looks too. The first other name gets the look of "own
    comparator", and each further one the next free look. The first six of these are all different.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    dict of str to dict
    """
    given = list(dict.fromkeys(names))
    others = cycle(OTHER_LOOKS[1:] if OWN in given else OTHER_LOOKS)
    fixed = STYLES | {name: {**look} for name, look in LOOKS.items()}
    return {name: fixed[name] if name in fixed else next(others) for name in given}


def kind_of(comparator: Comparator) -> str:
    """Return a comparator's name in ``STYLES``, or the name of its class if it has none there.

    Parameters
    ----------
    comparator : Comparator
        Any comparator.

    Returns
    -------
    str
        The name, such as "polytope".
    """
    kinds = (name for name, entry in COMPARATORS.items() if entry.is_kind_of(comparator))
    return next(kinds, type(comparator).__name__)
