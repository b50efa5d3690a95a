"""ICU-Sepsis: treating sepsis in intensive care, an MDP made of real patients' records."""

from __future__ import annotations

from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from elicit.model.scale import Floats
from qlearn.mdp.array_checks import Flags
from qlearn.mdp.ordinal_mdp import OrdinalMDP

_DIED, _RECOVERED, _ABSORBING, _ACTIONS = 713, 714, 715, 25
_DOSES = 5  # of fluids, and of vasopressors
_SHAPES = {"tx_mat": (716, 25, 716), "d_0": (716,), "sofa_scores": (716,)}


def icu_sepsis(
    bands: tuple[float, float, float] | None = None, discount: float = 0.99
) -> OrdinalMDP:
    """Return ICU-Sepsis: treating sepsis in intensive care, estimated from real patients' records.

    There are 715 states and 25 actions. States 0 to 712 are clusters of patients' conditions, 713
    is death and 714 recovery. An action is a dose of fluids and one of vasopressors within four
    hours. It has the number 5 times the first plus the second. Dose 0 is none, and doses 1 to 4 are
    the quarters of the doses given. Actions that doctors rarely took in a state are not offered
    there.

    The levels are died < critical < severe < moderate < mild < recovered. The level is that of the
    state, whatever the action. The middle four are ours and not the benchmark's: bands of the
    cluster's mean SOFA score, which rates organ failure and is higher if it is worse. They are no
    clinical categories.

    Parameters
    ----------
    bands : (float, float, float), optional
        The three scores that divide the middle levels, increasing. A score on a line counts as the
        milder level. Default: the quartiles over the 713 clusters, 4.69, 6.49 and 8.55.
    discount : float
        In [0, 1).

    Returns
    -------
    OrdinalMDP
        Its states and actions have names.

    Raises
    ------
    ImportError
        If the package ``icu-sepsis`` is missing.
    RuntimeError
        If the package's tables are not those known here.
    ValueError
        If ``bands`` or ``discount`` are out of range.

    Notes
    -----
    The benchmark scores survival only, without a discount. Here a policy is compared by the
    discounted share of time at each level, and death and recovery count for ever. How bad a day in
    a critical state is, next to death, is for the tutor to say. This is for research on algorithms;
    it is not medical advice.

    Transitions and the initial distribution are those of the package's tables, version 2. Two
    things differ. The tables' state 715, which follows death and recovery, is left out because it
    could have no level. In the package a rarely taken action has the mean effect of the others;
    leaving it out changes no optimal value.

    References
    ----------
    Choudhary, Gupta and Thomas, "ICU-Sepsis: A Benchmark MDP Built from Real Medical Data" (2024),
    arXiv 2406.05646. The tables are read from the package ``icu-sepsis`` (MIT licence), which is
    not imported.
    """
    transitions, start, sofa = _tables()
    _expect((transitions[_DIED:, :, _ABSORBING] == 1).all(), "death and survival lead to state 715")
    _expect(not transitions[:_DIED, :, _ABSORBING].any(), "no live state leads to state 715")
    _expect(not start[_DIED:].any(), "nobody starts dead, recovered or in state 715")
    lines = np.quantile(sofa[:_DIED], (0.25, 0.5, 0.75)) if bands is None else _bands(bands)
    level = np.empty(_ABSORBING, dtype=np.int32)
    level[:_DIED] = 4 - np.searchsorted(lines, sofa[:_DIED])
    level[_DIED], level[_RECOVERED] = 0, 5
    return OrdinalMDP.from_dense(
        transitions[:_ABSORBING, :, :_ABSORBING],
        np.repeat(level[:, None], _ACTIONS, axis=1),
        discount,
        ("died", "critical", "severe", "moderate", "mild", "recovered"),
        initial=start[:_ABSORBING],
        terminal=np.arange(_ABSORBING) >= _DIED,
        admissible=_admissible(),
        state_names=[
            *(f"{s} (mean SOFA {sofa[s]:.1f})" for s in range(_DIED)),
            "died",
            "recovered",
        ],
        action_names=[
            f"fluids {a // _DOSES} with vasopressors {a % _DOSES}" for a in range(_ACTIONS)
        ],
    )


def _expect(holds: object, claim: str) -> None:
    if not holds:
        raise RuntimeError(
            f"the tables of the installed icu-sepsis are not those of 2.0.1, where {claim}: "
            "pip install 'icu-sepsis==2.0.1'"
        )


def assets() -> Path:
    """Return the folder of the tables in the package ``icu-sepsis``.

    Raises ImportError if the package is missing.
    """
    # find_spec does not run the package, whose __init__ imports the abandoned gym
    spec = find_spec("icu_sepsis")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(
            "the ICU-Sepsis tables are not installed: pip install 'elicit-qlearn[icu]'"
        )
    return Path(spec.submodule_search_locations[0]) / "envs" / "assets"


def _tables() -> list[Floats]:
    """Return the tables listed in ``_SHAPES``."""
    path = assets() / "dynamics.npz"
    _expect(path.is_file(), f"{path} exists")
    tables: list[Floats] = []
    with np.load(path, allow_pickle=False) as data:
        for name, shape in _SHAPES.items():
            _expect(name in data.files, f"dynamics.npz holds {name}")
            tables.append(data[name])
            _expect(tables[-1].shape == shape, f"{name} has shape {shape}, not {tables[-1].shape}")
    return tables


def _admissible() -> Flags:
    """Return flags (715, 25) of the admissible actions of each state.

    The file's first line counts each state's actions. Then a line for each state names them.
    """
    path = assets() / "admissible_actions.txt"
    _expect(path.is_file(), f"{path} exists")
    counts, *rows = [
        [int(word) for word in line.split()] for line in path.read_text("ascii").splitlines()
    ]
    _expect(
        counts == [len(row) for row in rows] and len(rows) == 716,
        "admissible_actions.txt lists 716 states",
    )
    admissible = np.zeros((716, _ACTIONS), dtype=np.bool_)
    for s, row in enumerate(rows):
        admissible[s, row] = True
    return admissible[:_ABSORBING]


def _bands(bands: tuple[float, float, float]) -> Floats:
    lines: Floats = np.empty(0)
    with suppress(TypeError, ValueError):  # no numbers, or lists of unequal length: said below
        lines = np.asarray(bands, dtype=np.float64)
    if lines.shape != (3,) or not (np.diff(lines) > 0).all():
        raise ValueError(f"bands must be three increasing SOFA scores, not {bands!r}")
    return lines
