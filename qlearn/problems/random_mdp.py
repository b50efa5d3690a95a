"""Random MDPs as in section 5 of the paper, and a real clinical benchmark."""

from __future__ import annotations

from contextlib import suppress
from importlib.util import find_spec
from math import ceil, log
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from elicit._support.hashing import Seed, key_of
from elicit.model.scale import Floats
from qlearn.mdp.array_checks import BLOCK, Flags
from qlearn.mdp.ordinal_mdp import OrdinalMDP

_VALUES = 100  # hidden values are integers 0..99 (section 5)
_DIED, _RECOVERED, _ABSORBING, _ACTIONS = 713, 714, 715, 25
_SHAPES = {"tx_mat": (716, 25, 716), "d_0": (716,), "sofa_scores": (716,), "expert_policy": (716, 25)}


def draw_values(k: int, rng: Seed) -> Floats:
    """Hidden values (k,) of a scale: distinct integers drawn uniformly from 0..99, increasing.

    Section 5 draws integers from 0..99; drawn without replacement, the k levels are worth k
    different values, at least 1/99 of the range apart. Raises ValueError unless 2 <= k <= 100.
    """
    _check("the number of levels", k, 2, _VALUES)
    return _values(k, np.random.default_rng(key_of(rng)))


def random_mdp(
    n_states: int,
    n_actions: int,
    n_levels: int,
    discount: float = 0.95,
    *,
    rng: Seed,
    branching: Literal["log2", "log"] = "log2",
    weights: Literal["dirichlet", "gaussian"] = "dirichlet",
) -> tuple[OrdinalMDP, Floats]:
    """A random instance of section 5, and hidden values (k,) for its scale as of ``draw_values``.

    Each (s, a) has ceil(log2 |S|) distinct successors (at least 1), a uniform sample of the
    states. The paper leaves the rest open; here the probabilities are Dirichlet(1) and the level of
    each (s, a) is uniform over the scale. ``branching="log"`` (ceil(ln(1 + |S|)) successors) and
    ``weights="gaussian"`` (absolute values of standard normals, scaled to 1) give the law of later
    papers on interactive value iteration. Only the levels and values depend on ``n_levels``, so a series
    over it with one seed keeps its transitions. Raises ValueError.
    """
    _check("n_states", n_states, 1, 2**31 - 1)
    _check("n_actions", n_actions, 1, 2**31 - 1)
    _check("n_levels", n_levels, 2, _VALUES)
    if branching not in ("log2", "log"):
        raise ValueError(f'branching must be "log2" or "log", not {branching!r}')
    if weights not in ("dirichlet", "gaussian"):
        raise ValueError(f'weights must be "dirichlet" or "gaussian", not {weights!r}')
    generator = np.random.default_rng(key_of(rng))
    b = max(1, (n_states - 1).bit_length()) if branching == "log2" else ceil(log(1 + n_states))
    successors = _samples(n_states, b, (n_states, n_actions), generator)
    draw = generator.standard_exponential if weights == "dirichlet" else generator.standard_normal
    probabilities = draw(successors.shape)
    for part in np.array_split(probabilities, max(1, probabilities.size // BLOCK)):  # in place: it may be a gigabyte
        np.abs(part, out=part)
        part /= part.sum(axis=2, keepdims=True)
    levels = generator.integers(n_levels, size=(n_states, n_actions))
    successors.flags.writeable = probabilities.flags.writeable = False  # handed over, not copied
    labels = tuple(f"level {i + 1}" for i in range(n_levels))
    mdp = OrdinalMDP(successors, probabilities, levels, discount, labels)
    return mdp, _values(n_levels, generator)


def icu_sepsis(bands: tuple[float, float, float] | None = None, discount: float = 0.99) -> OrdinalMDP:
    """ICU-Sepsis: treating sepsis in intensive care, an MDP estimated from real patients' records.

    715 states and 25 actions (5 doses of fluids by 5 of vasopressors). States 0..712 are clusters of
    patients' conditions; 713 (died) and 714 (recovered) are terminal; the tables' state 715, which
    absorbs after both and could bear no level, is left out. Transitions and the initial
    distribution are those of the tables (version 2). Actions that doctors rarely took in a state
    are inadmissible there; the package lets them act as the mean of the admissible ones,
    here they are not offered, which changes no optimal value.

    Levels: died < critical < severe < moderate < mild < recovered. The middle four are ours, not the
    benchmark's: bands of the cluster's mean SOFA score (organ failure; higher is worse).
    ``bands`` are the three scores that divide them, increasing, a score on the line counting as the
    milder; the default is the quartiles over the 713 clusters (4.69, 6.49, 8.55), so a band holds
    a quarter of the clusters, and is no clinical category. The level is that of the state, whatever the action.

    The benchmark itself scores survival only, undiscounted. Here a policy is judged by the discounted
    share of time at each level, died and recovered counting for ever: how bad a day in a
    critical state is, next to death, is for the tutor to say. For research on algorithms; not
    medical advice.

    Source: Choudhary, Gupta and Thomas, "ICU-Sepsis: A Benchmark MDP Built from Real Medical Data"
    (2024), arXiv 2406.05646; tables from the package ``icu-sepsis`` (MIT), which is read, not imported.

    Raises ImportError if that package is missing, RuntimeError if its tables are not those known
    here, ValueError for bad ``bands`` or ``discount``.
    """
    tables = _icu_tables("tx_mat", "d_0", "sofa_scores")
    transitions, start, sofa = tables["tx_mat"], tables["d_0"], tables["sofa_scores"]
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
        admissible=_icu_admissible(),
    )


def icu_expert_policy() -> Floats:
    """The doctors' estimated policy for ``icu_sepsis()``: probabilities (715, 25).

    The published table also puts weight on inadmissible actions, which the benchmark answers
    with the mean of the admissible ones; so that weight is spread evenly over the state's
    admissible actions, which gives the same transitions. Terminal states: uniform.
    Raises as ``icu_sepsis`` does.
    """
    table, admissible = _icu_tables("expert_policy")["expert_policy"][:_ABSORBING], _icu_admissible()
    offered = np.where(admissible, table, 0.0)
    offered += admissible * ((1 - offered.sum(axis=1)) / admissible.sum(axis=1))[:, None]
    policy: Floats = offered / offered.sum(axis=1, keepdims=True)
    return policy


def _expect(holds: object, claim: str) -> None:
    if not holds:
        raise RuntimeError(
            f"the tables of the installed icu-sepsis are not those of 2.0.1, where {claim}: "
            "pip install 'icu-sepsis==2.0.1'"
        )


def _icu_assets() -> Path:
    # find_spec does not run the package, whose __init__ imports the abandoned gym
    spec = find_spec("icu_sepsis")
    if spec is None or not spec.submodule_search_locations:
        raise ImportError("the ICU-Sepsis tables are not installed: pip install 'elicit-qlearn[icu]'")
    return Path(spec.submodule_search_locations[0]) / "envs" / "assets"


def _icu_tables(*names: str) -> dict[str, Floats]:
    path = _icu_assets() / "dynamics.npz"
    _expect(path.is_file(), f"{path} exists")
    with np.load(path, allow_pickle=False) as data:
        for name in names:
            _expect(name in data.files, f"dynamics.npz holds {name}")
        tables: dict[str, Floats] = {name: data[name] for name in names}
    for name, table in tables.items():
        _expect(table.shape == _SHAPES[name], f"{name} has shape {_SHAPES[name]}, not {table.shape}")
    return tables


def _icu_admissible() -> Flags:
    """(715, 25). The file's first line counts each state's actions; then a line a state names them."""
    path = _icu_assets() / "admissible_actions.txt"
    _expect(path.is_file(), f"{path} exists")
    counts, *rows = [[int(word) for word in line.split()] for line in path.read_text("ascii").splitlines()]
    _expect(counts == [len(row) for row in rows] and len(rows) == 716, "admissible_actions.txt lists 716 states")
    admissible = np.zeros((716, _ACTIONS), dtype=np.bool_)
    for s, row in enumerate(rows):
        admissible[s, row] = True
    return admissible[:_ABSORBING]


def _check(name: str, value: int, least: int, most: int) -> None:
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or not least <= value <= most:
        raise ValueError(f"{name} must be a whole number from {least} to {most}, not {value!r}")


def _bands(bands: tuple[float, float, float]) -> Floats:
    lines: Floats = np.empty(0)
    with suppress(TypeError, ValueError):  # no numbers, or lists of unequal length: said below
        lines = np.asarray(bands, dtype=np.float64)
    if lines.shape != (3,) or not (np.diff(lines) > 0).all():
        raise ValueError(f"bands must be three increasing SOFA scores, not {bands!r}")
    return lines


def _values(k: int, generator: np.random.Generator) -> Floats:
    return np.sort(generator.choice(_VALUES, size=k, replace=False)).astype(np.float64)


def _samples(n: int, b: int, shape: tuple[int, ...], generator: np.random.Generator) -> NDArray[np.int32]:
    """(*shape, b): in each row b distinct states of n, every set equally likely, ascending.

    Floyd's algorithm (Bentley and Floyd, CACM 1987), for all rows at once.
    """
    samples = np.empty((*shape, b), dtype=np.int32)
    rows = samples.reshape(-1, b)
    for j in range(b):
        top = n - b + j
        pick = generator.integers(top + 1, size=len(rows), dtype=np.int32)
        taken = (rows[:, :j] == pick[:, None]).any(axis=1)
        rows[:, j] = np.where(taken, top, pick)
    rows.sort(axis=1)
    return samples
