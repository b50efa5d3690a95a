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
    """ICU-Sepsis: treating sepsis in intensive care, an MDP estimated from real patients' records.

    715 states and 25 actions: 5 times the dose of fluids plus that of vasopressors within 4 hours,
    each 0 (none) or the quarter, 1 to 4, of the doses above none to which it belongs. States 0..712
    are clusters of patients' conditions; 713 (died) and 714 (recovered) are terminal; the tables'
    state 715, which absorbs after both and could bear no level, is left out. Transitions and the
    initial distribution are those of the tables (version 2). Actions that doctors rarely took in a
    state are inadmissible there; the package lets them act as the mean of the admissible ones, here
    they are not offered, which changes no optimal value.

    Levels: died < critical < severe < moderate < mild < recovered. The middle four are ours, not
    the benchmark's: bands of the cluster's mean SOFA score (organ failure; higher is worse).
    ``bands`` are the three scores that divide them, increasing, a score on the line counting as the
    milder; the default is the quartiles over the 713 clusters (4.69, 6.49, 8.55), so a band holds
    a quarter of the clusters, and is no clinical category. The level is that of the state, whatever
    the action.

    The benchmark itself scores survival only, undiscounted. Here a policy is judged by the
    discounted share of time at each level, died and recovered counting for ever: how bad a day in a
    critical state is, next to death, is for the tutor to say. For research on algorithms; not
    medical advice.

    Source: Choudhary, Gupta and Thomas, "ICU-Sepsis: A Benchmark MDP Built from Real Medical Data"
    (2024), arXiv 2406.05646; tables from the package ``icu-sepsis`` (MIT), which is read, not
    imported.

    Raises ImportError if that package is missing, RuntimeError if its tables are not those known
    here, ValueError for bad ``bands`` or ``discount``.
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


def _assets() -> Path:
    # find_spec does not run the package, whose __init__ imports the abandoned gym
    spec = find_spec("icu_sepsis")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError(
            "the ICU-Sepsis tables are not installed: pip install 'elicit-qlearn[icu]'"
        )
    return Path(spec.submodule_search_locations[0]) / "envs" / "assets"


def _tables() -> list[Floats]:
    """Those of ``_SHAPES``."""
    path = _assets() / "dynamics.npz"
    _expect(path.is_file(), f"{path} exists")
    tables: list[Floats] = []
    with np.load(path, allow_pickle=False) as data:
        for name, shape in _SHAPES.items():
            _expect(name in data.files, f"dynamics.npz holds {name}")
            tables.append(data[name])
            _expect(tables[-1].shape == shape, f"{name} has shape {shape}, not {tables[-1].shape}")
    return tables


def _admissible() -> Flags:
    """(715, 25). The file's first line counts each state's actions; then a line a state names
    them.
    """
    path = _assets() / "admissible_actions.txt"
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
