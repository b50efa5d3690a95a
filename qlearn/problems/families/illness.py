"""Decisions for a patient: whether to operate, and how hard to treat."""

from __future__ import annotations

from elicit._support.hashing import Seed
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.table import RandomNumbers, Table, checked_size

_STAGES = "stages of the illness"


def surgery(seed: Seed | None = None, size: int = 30) -> OrdinalMDP:
    """Return the choice between living with an illness and an operation that cures or kills.

    An illness gets slowly worse, from mild to severe. Drugs slow it down, with side effects that
    make every month one level worse. An operation costs a severe month and ends the illness: the
    patient is cured, or dead.
    Its risk differs between four groups of patients, and grows with the stage. How bad a severe
    month is, next to death and to a cure, decides when to operate, if at all. A wrong scale
    operates on patients who would rather live with the illness, or lets patients wait who would
    rather take the risk.

    Parameters
    ----------
    seed : int or None
        The seed of the risks; None draws others each time.
    size : int
        Stages of the illness, at least 6. There are 4 * size + 2 states.

    Returns
    -------
    OrdinalMDP
        Levels: dead < severe < moderate < mild < cured. 3 actions, discount .98. Patients come in a
        mild or moderate stage, from all risk groups alike.

    Notes
    -----
    The timing of one treatment that cannot be undone is that of Alagoz, Maillart, Schaefer and
    Roberts, "The optimal timing of living-donor liver transplantation" (Management Science 50,
    2004). All numbers are made up here: nothing of it is medical advice.
    """
    n = checked_size(size, 6, _STAGES)
    draws = RandomNumbers("surgery", seed)
    risks = sorted(draws.between(0.05, 0.8) for _ in range(4))
    worse = draws.between(3.0, 9.0) / n
    dead, cured = 4 * n, 4 * n + 1
    groups = ("lowest", "low", "high", "highest")
    table = Table(
        [
            *(f"stage {stage + 1} of {n}, {group} risk" for group in groups for stage in range(n)),
            "dead",
            "cured",
        ],
        ("wait", "take drugs", "operate"),
        ("dead", "severe", "moderate", "mild", "cured"),
    )
    for group, risk in enumerate(risks):
        for stage in range(n):
            state = group * n + stage
            following = group * n + min(stage + 1, n - 1)
            level = 3 - 3 * stage // n
            for a, (advance, death) in enumerate(
                [(min(worse, 0.9), 0.002), (min(worse, 0.9) / 3, 0.001)]
            ):
                alive = 1.0 - death
                moves = (
                    (following, alive * advance),
                    (state, alive * (1.0 - advance)),
                    (dead, death),
                )
                table.write(state, a, max(level - a, 1), *moves)
            fatal = min(risk + 0.2 * stage / n, 0.95)
            table.write(state, 2, 1, (dead, fatal), (cured, 1.0 - fatal))
    table.end(dead, 0)
    table.end(cured, 4)
    return table.mdp(0.98, [group * n + stage for group in range(4) for stage in range(2 * n // 3)])


def care(seed: Seed | None = None, size: int = 30) -> OrdinalMDP:
    """Return the choice between comfort, standard and aggressive treatment of an illness.

    Comfort gives the best months that a stage allows, and the illness takes its course. Standard
    treatment slows it down. Aggressive treatment costs months in hospital, and some patients their
    lives, above all the frail. It alone has a fair chance of a cure, while the illness is young. On
    a wrong scale patients spend their last year in hospital in vain, or give up a cure.

    Parameters
    ----------
    seed : int or None
        The seed of the illness; None draws another one each time.
    size : int
        Stages of the illness, at least 6. There are 3 * size + 2 states.

    Returns
    -------
    OrdinalMDP
        Levels: dead < in hospital < ill < well < cured. 3 actions, discount .98. Patients come in
        one of the first two thirds of the stages.

    Notes
    -----
    Made up here, after the choices that palliative care is about; nothing of it is medical advice.
    """
    n = checked_size(size, 6, _STAGES)
    draws = RandomNumbers("care", seed)
    toxic = draws.between(0.01, 0.06)
    hardest = draws.between(0.05, 0.2)
    cure = draws.between(0.02, 0.15)
    died, cured = 3 * n, 3 * n + 1
    frailty = {"robust": 0.4, "average": 1.0, "frail": 2.5}
    table = Table(
        [
            *(f"stage {stage + 1} of {n}, {who}" for who in frailty for stage in range(n)),
            "died",
            "cured",
        ],
        ("comfort", "standard treatment", "aggressive treatment"),
        ("dead", "in hospital", "ill", "well", "cured"),
    )
    for state in range(3 * n):
        patient, stage = divmod(state, n)
        first = patient * n
        harm = list(frailty.values())[patient] * toxic
        lethal = 0.005 + hardest * (stage / n) * (stage / n)
        best = 3 if stage < n // 2 else 2
        young = 1.0 - stage / n
        ways = (
            # level, better, worse, risk of death, chance of a cure
            (best, 0.0, 0.5, lethal, 0.0),
            (2, 0.25, 0.35, 0.6 * lethal, 0.1 * cure * young),
            (1, 0.5, 0.2, 0.25 * lethal + harm, cure * young),
        )
        for a, (level, better, worse, death, healed) in enumerate(ways):
            rest = 1.0 - death - healed
            table.write(
                state,
                a,
                level,
                (died, death),
                (cured, healed),
                (first + max(stage - 1, 0), rest * better),
                (first + min(stage + 1, n - 1), rest * worse),
                (state, rest * (1.0 - better - worse)),
            )
    table.end(died, 0)
    table.end(cured, 4)
    return table.mdp(
        0.98, [first + stage for first in (0, n, 2 * n) for stage in range(2 * n // 3)]
    )
