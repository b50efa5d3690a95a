"""States and actions of ICU-Sepsis in a clinician's words, as far as the benchmark's data allow.

The package ``icu-sepsis`` has more about each state than the MDP needs: the centre of its cluster
in 47 measurements, and the treatments that doctors gave there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from elicit.model.scale import Floats
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.icu_sepsis import assets

# The order of the measurements is that of the AI Clinician's code (Komorowski and others, 2018).
# The score at place 31 is the state's SOFA score in other units, as a test checks.
_VENTILATED = 1  # 1 with mechanical ventilation and 0 without, less a half

ICU_LEGEND = (
    "A state is a group of similar patients. It is described by its condition, its mean SOFA "
    "score, the share on mechanical ventilation, and the share who die in hospital if treated as "
    "recorded. Doses are for 4 hours: low, medium, high and very high are quarters of the doses "
    "given."
)
"""What the words of states and actions mean."""

_DAYS = 30  # that the questions are about
_STEPS_A_DAY = 6  # of 4 hours each
ICU_DURATION = (
    f"Each patient stays in the condition shown for {_DAYS} days. Compare only these {_DAYS} days, "
    "and not what comes after them."
)
"""How long the conditions in a question last."""


def icu_valuation(mdp: OrdinalMDP) -> str:
    """Return sentences on how a plan for ICU-Sepsis is valued.

    Examples
    --------
    >>> from qlearn.problems.icu_sepsis import icu_sepsis
    >>> print(icu_valuation(icu_sepsis()).split(". ")[1])
    The first 30 days count for 84%, and all later days for the rest
    """
    share = 1.0 - mdp.discount ** (_DAYS * _STEPS_A_DAY)
    return (
        "How a plan is valued: by the condition of each patient, every 4 hours. "
        f"The first {_DAYS} days count for {share:.0%}, and all later days for the rest. A patient "
        "who died counts as “died” from then on, and one who recovered as “recovered”. "
        "So a death counts about as in the questions, and the years lost do not count."
    )


def icu_states(mdp: OrdinalMDP) -> Callable[[str], str]:
    """Return a function that puts a state of ICU-Sepsis in words, from its name.

    Examples
    --------
    >>> from qlearn.problems.icu_sepsis import icu_sepsis
    >>> icu_states(icu_sepsis())("12 (mean SOFA 11.0)")
    'critical, mean SOFA score 11.0, 47% ventilated, 24% die (state 12)'
    """

    def in_words(name: str) -> str:
        number, _, score = name.removesuffix(")").partition(" (mean SOFA ")
        if not score:
            return name
        state, found = int(number), _recorded()
        return (
            f"{mdp.labels[int(mdp.levels[state, 0])]}, mean SOFA score {score}, "
            f"{found.ventilated[state]:.0%} ventilated, {found.die[state]:.0%} die (state {number})"
        )

    return in_words


class _Recorded(NamedTuple):
    """Shares in the tables of the benchmark, if patients are treated as the doctors did."""

    ventilated: Floats  # (713,) share of patients on mechanical ventilation
    die: Floats  # (713,) share who die
    from_the_start: float  # share of all patients who die
    at_random: float  # the same if each action is drawn at random


@cache
def _recorded() -> _Recorded:
    """Return what the tables say. Reading them takes half a second."""
    with np.load(assets() / "dynamics.npz", allow_pickle=False) as data:
        moves, treated, start = data["tx_mat"], data["expert_policy"], data["d_0"]
        centres = data["state_cluster_centers"]
    died = len(moves) - 3  # the last three states are death, recovery, and what follows them
    die = _deaths(np.matmul(treated[:died, None, :], moves[:died])[:, 0])
    random = _deaths(moves[:died].mean(axis=1))  # an action rarely taken is like the others' mean
    first = start[:died]
    ventilated = np.clip(centres[:died, _VENTILATED] + 0.5, 0.0, 1.0)
    return _Recorded(ventilated, die, float(first @ die), float(first @ random))


def _deaths(chain: Floats) -> Floats:
    """Return for each live state the share who die, from the chances of moves (713, 716)."""
    live = len(chain)
    return np.asarray(np.linalg.solve(np.eye(live) - chain[:, :live], chain[:, live]))


def icu_caveat() -> str:
    """Return sentences on what a plan for ICU-Sepsis must not be taken for.

    Examples
    --------
    >>> print(icu_caveat().split(": ")[-1])
    so fewer deaths in the model are no forecast for real patients.
    """
    found = _recorded()
    recorded, random = round(1000 * found.from_the_start), round(1000 * found.at_random)
    return (
        "Not advice for treatment: the plan comes from a statistical model of recorded treatments, "
        f"and in many states it is not what a doctor would do. In the same model {recorded} of "
        f"1,000 die if treated as recorded, and {random} with doses drawn at random: so fewer "
        "deaths in the model are no forecast for real patients."
    )


def icu_dose(action: int) -> str:
    """Return an action of ICU-Sepsis in words.

    Examples
    --------
    >>> icu_dose(20)
    'very high fluids, no vasopressor'
    """
    words = ("no", "low", "medium", "high", "very high")
    return f"{words[action // 5]} fluids, {words[action % 5]} vasopressor"
