"""The catalogue of comparators, learners and problems, with names, factories and labels.

``ablate``, ``figures``, ``teach``, the pictures, ``warm_up`` and the documentation take names and
parts from here, in the order of the entries. Importing this module imports nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from elicit.catalogue import ALWAYS, COMPARATORS, ComparatorEntry
from qlearn.problems.families.catalogue import FAMILIES

if TYPE_CHECKING:
    from elicit.model.comparator import Comparator
    from elicit.model.scale import Floats
    from qlearn.experiments.settings import Settings
    from qlearn.learners.learner import Learner
    from qlearn.mdp.ordinal_mdp import OrdinalMDP

__all__ = [
    "ALWAYS",
    "COMPARATORS",
    "LEARNERS",
    "NAMES",
    "PROBLEMS",
    "TAUGHT_WITH",
    "ComparatorEntry",
    "LearnerEntry",
    "ProblemEntry",
    "Size",
]

Size: TypeAlias = tuple[int, int, int, float]
"""Size of a random MDP: states, actions, levels, discount."""


@dataclass(frozen=True, kw_only=True)
class LearnerEntry:
    """One learner of the catalogue.

    Attributes
    ----------
    name : str
        Its name on the command line, in rows of results and in journals.
    label : str
        Its name in tables and pictures.
    factory : function
        Makes the learner from mdp, comparator and keywords.
    keywords : function
        Takes the settings, and returns the keywords that this learner takes in addition to those of
        all learners.
    indifference : function, optional
        Takes the settings and the discount, and returns the indifference that follows from the
        learner's tolerance. None: the settings have the indifference, and the learner runs with
        comparators that are ``indifferent``.
    needs_proof : bool
        True if the learner ends by a bound on its policy's loss, which only comparators that
        ``prove`` can give. It has no oracle, because always asking proves nothing.
    compiles : str, optional
        The small run of ``compile_ahead`` that compiles the learner's functions. None: there is
        none, and the functions are compiled in the learner's first run.
    """

    name: str
    label: str
    factory: Callable[..., Learner]
    keywords: Callable[[Settings], dict[str, Any]]
    indifference: Callable[[Settings, float], float] | None = None
    needs_proof: bool = False
    compiles: str | None = None

    @property
    def has_tolerance(self) -> bool:
        """True if the learner stops at a tolerance of loss. Its indifference follows from that."""
        return self.indifference is not None

    def pairs_with(self, comparator: ComparatorEntry) -> bool:
        """Return whether the ablation runs this learner with that comparator."""
        if self.has_tolerance and comparator.indifferent:
            return False
        return comparator.proves or not self.needs_proof


@dataclass(frozen=True, kw_only=True)
class ProblemEntry:
    """One problem of the catalogue.

    Attributes
    ----------
    name : str
        Its name on the command line, in rows of results and in journals.
    label : str
        Its name in tables and pictures.
    factory : function, optional
        Makes the MDP, or raises ImportError without the problem's package. None for random MDPs,
        which depend on a seed and a size, and for families.
    family : function, optional
        Makes the MDP of a family from a seed.
    taught : bool
        True if ``qlearn teach`` offers it.
    """

    name: str
    label: str
    factory: Callable[[], OrdinalMDP] | None = None
    family: Callable[[int], OrdinalMDP] | None = None
    taught: bool = False

    def instance(self, seed: int, size: Size) -> tuple[OrdinalMDP, Floats]:
        """Return the MDP and its hidden values (k,).

        An MDP that does not depend on a seed is made only once in each process.
        """
        from qlearn.problems.random_mdp import draw_values, random_mdp

        if self.family is not None:
            mdp = self.family(seed)
        elif self.factory is not None:
            mdp = _made_once(self.factory)
        else:
            return random_mdp(*size, seed=seed)
        return mdp, draw_values(mdp.k, seed=seed)


@cache  # making one takes seconds
def _made_once(factory: Callable[[], OrdinalMDP]) -> OrdinalMDP:
    return factory()


def _q_learning(mdp: OrdinalMDP, comparator: Comparator, **keywords: Any) -> Learner:
    from qlearn.learners.q_learning import InteractiveQLearning

    return InteractiveQLearning(mdp, comparator, **keywords)


def _value_iteration(mdp: OrdinalMDP, comparator: Comparator, **keywords: Any) -> Learner:
    from qlearn.learners.value_iteration import InteractiveValueIteration

    return InteractiveValueIteration(mdp, comparator, **keywords)


def _policy_iteration(mdp: OrdinalMDP, comparator: Comparator, **keywords: Any) -> Learner:
    from qlearn.learners.policy_iteration import InteractivePolicyIteration

    return InteractivePolicyIteration(mdp, comparator, **keywords)


_LEARNERS = (
    LearnerEntry(
        name="q-learning",
        label="Q-learning",
        factory=_q_learning,
        keywords=lambda settings: {
            "steps": settings.steps,
            "epsilon": settings.exploration or settings.epsilon,
        },
        compiles="loops",
    ),
    LearnerEntry(
        name="value-iteration",
        label="value iteration",
        factory=_value_iteration,
        keywords=lambda settings: settings.named("tolerance", "max_sweeps"),
        indifference=lambda settings, discount: settings.tolerance * (1 - discount) / 2,
        compiles="sweeps",
    ),
    LearnerEntry(
        name="policy-iteration",
        label="policy iteration",
        factory=_policy_iteration,
        keywords=lambda settings: settings.named("tolerance"),
        indifference=lambda settings, discount: settings.tolerance * (1 - discount),
        needs_proof=True,
        compiles="certificates",
    ),
)
LEARNERS: Mapping[str, LearnerEntry] = {entry.name: entry for entry in _LEARNERS}
"""The learners by name."""


def _icu_sepsis() -> OrdinalMDP:
    from qlearn.problems.icu_sepsis import icu_sepsis

    return icu_sepsis()


def _frozen_lake() -> OrdinalMDP:
    from qlearn.problems.gymnasium import frozen_lake

    return frozen_lake()


def _deep_sea_treasure() -> OrdinalMDP:
    from qlearn.problems.gymnasium import deep_sea_treasure

    return deep_sea_treasure()


_PROBLEMS = (
    ProblemEntry(name="random", label="random MDP", taught=True),
    ProblemEntry(name="icu-sepsis", label="ICU-Sepsis", factory=_icu_sepsis, taught=True),
    ProblemEntry(name="frozen-lake", label="FrozenLake 8x8", factory=_frozen_lake),
    ProblemEntry(name="deep-sea-treasure", label="deep-sea-treasure", factory=_deep_sea_treasure),
    *(
        ProblemEntry(name=name, label=name.replace("-", " "), family=family, taught=True)
        for name, family in FAMILIES.items()
    ),
)
PROBLEMS: Mapping[str, ProblemEntry] = {entry.name: entry for entry in _PROBLEMS}
"""The problems by name."""
TAUGHT_WITH = ("polytope", "polytope-1-wrong", "posterior")
"""The comparators that ``qlearn teach`` offers, by name."""
NAMES: Mapping[str, str] = {
    name: entry.label
    for catalogue in (PROBLEMS, LEARNERS, COMPARATORS)
    for name, entry in catalogue.items()
}
"""The label of each problem, learner and comparator, by name."""
