"""The problem that choix and evalica are made for: one strength for each item, from wins of items
over items.

Our tutors compare bags of levels. Where every bag holds a single level, eq. (6) is Bradley and
Terry's (1952) own model of k items, and all libraries solve the same: maximise eq. (7) for the
answers and for each resample, with no ridge, no order, and the first item's strength held at 0.
What a resample holds is then a table of wins (k, k), and each library gets it in the form in which
it is fastest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.fitting.tutor_data import SPREAD
from benchmarks.reporting import markdown
from elicit.comparators.bradley_terry.likelihood import bootstrap_weights, fit
from elicit.model.difference import tail_sums
from elicit.model.scale import Floats

LIBRARIES = ("choix", "evalica")
PER_ITEM = 10  # answers at least: with fewer, most resamples have no finite maximum to be fitted
OURS = "elicit.comparators.bradley_terry.likelihood.fit"


class Items(NamedTuple):
    """Wins (m + 1, k, k) of items (rows) over items (columns), of all answers and of each resample;
    ``spread``: from the least to the greatest true strength, in logits."""

    wins: Floats
    spread: float


class ItemLine(NamedTuple):
    """Milliseconds for all fits; the greatest error, as a share of the spread; fits that are
    missing where there is one, and those given where there is none."""

    name: str
    milliseconds: float
    error: float
    missing: int
    invented: int


Method = Callable[
    [Items], Floats
]  # to strengths (m + 1, k) up to a constant, nan where it gives none


def draw_items(k: int, n: int, m: int, seed: int) -> Items:
    """n answers about pairs of k items, uniform; strengths of uniform gaps, scaled to logits of
    ``SPREAD``.
    """
    rng = np.random.default_rng([seed, k, n])
    strengths = np.cumsum(np.concatenate([[0.0], rng.dirichlet(np.ones(k - 1))]))
    left = rng.integers(0, k, n)
    right = (left + rng.integers(1, k, n)) % k
    strengths *= SPREAD / np.std(strengths[left] - strengths[right])
    won = rng.random(n) < expit(strengths[left] - strengths[right])
    winner, loser = np.where(won, left, right), np.where(won, right, left)
    wins = np.zeros((m + 1, k, k))
    for table, counts in zip(wins, [np.ones(n), *bootstrap_weights(seed, m, n)], strict=True):
        np.add.at(table, (winner, loser), counts)
    return Items(wins, float(strengths[-1]))


def ours(items: Items) -> Floats:
    """All resamples at once: the ordered pairs of items are the rows, their wins the weights."""
    pairs, wins = _pairs(items)
    k = items.wins.shape[1]
    t = tail_sums(np.eye(k)[pairs[:, 0]] - np.eye(k)[pairs[:, 1]])
    settings: dict[str, Any] = {"precision": 1.0, "strength": 0.0, "monotone": False}
    found = fit(
        t,
        np.ones(len(t), dtype=np.int8),
        centre=np.zeros((len(wins), k - 1)),
        weights=wins,
        **settings,
    )
    strengths = np.concatenate([np.zeros((len(wins), 1)), np.cumsum(found.gamma, axis=1)], axis=1)
    strengths[~found.converged] = np.nan
    return strengths


def scipy_lbfgs(items: Items) -> Floats:
    """L-BFGS-B with the gradient, one resample at a time, from the fit to the answers."""
    (pairs, wins), k = _pairs(items), items.wins.shape[1]
    x = (np.eye(k)[pairs[:, 0]] - np.eye(k)[pairs[:, 1]])[:, 1:]
    found, start = np.zeros((len(wins), k)), np.zeros(k - 1)
    for i, c in enumerate(wins):

        def loss(free: Floats, c: Floats = c) -> tuple[float, Floats]:
            z = x @ free
            return float(c @ (np.log1p(np.exp(-np.abs(z))) - np.minimum(z, 0.0))), -(
                c * expit(-z)
            ) @ x

        options = {"ftol": 1e-13, "gtol": 1e-6, "maxiter": 10_000}
        done = minimize(loss, start, jac=True, method="L-BFGS-B", options=options)
        found[i, 1:] = done.x if done.success else np.nan
        start = found[0, 1:] if np.isfinite(found[0]).all() else start
    return found


def choix_ilsr(items: Items) -> Floats:
    """Maystre and Grossglauser's (2015) iterated spectral ranking on the table of wins, from the
    fit to the answers.
    """
    choix = import_module("choix")
    found = np.full(items.wins.shape[:2], np.nan)
    for i, wins in enumerate(items.wins):
        start = found[0] if i and np.isfinite(found[0]).all() else None
        with suppress(RuntimeError, ValueError, np.linalg.LinAlgError), np.errstate(all="ignore"):
            found[i] = choix.ilsr_pairwise_dense(wins, initial_params=start, tol=1e-8)
    return found


def evalica_public(items: Items) -> Floats:
    """Newman's (2023) iteration in Rust, as its manual has it: it returns a pandas Series."""
    evalica = import_module("evalica")
    index = import_module("pandas").Index(range(items.wins.shape[1]))
    (pairs, wins), found = _pairs(items), np.empty(items.wins.shape[:2])
    given = pairs[:, 0].tolist(), pairs[:, 1].tolist(), [evalica.Winner.X] * len(pairs)
    for i, weights in enumerate(wins):
        scores = evalica.bradley_terry(*given, index=index, weights=weights, **_LIMITS).scores
        found[i] = scores.reindex(index).to_numpy()
    return _logs(found)


def evalica_routine(items: Items) -> Floats:
    """The compiled routine behind it, called directly, which is no public name."""
    evalica = import_module("evalica")
    (pairs, wins), found = _pairs(items), np.empty(items.wins.shape[:2])
    xs, ys, winners = pairs[:, 0].tolist(), pairs[:, 1].tolist(), [evalica.Winner.X] * len(pairs)
    settings = {"total": items.wins.shape[1], "win_weight": 1.0, "tie_weight": 0.5} | _LIMITS
    for i, weights in enumerate(wins):
        found[i] = evalica._brzo.bradley_terry(
            xs=xs, ys=ys, winners=winners, weights=weights, **settings
        )[0]
    return _logs(found)


_LIMITS = {"tolerance": 1e-8, "limit": 10_000}
METHODS: dict[str, tuple[str, Method]] = {  # the library that it needs, and how it is run
    OURS: ("elicit", ours),
    "SciPy L-BFGS-B, gradient": ("scipy", scipy_lbfgs),
    "choix.ilsr_pairwise_dense": ("choix", choix_ilsr),
    "evalica.bradley_terry": ("evalica", evalica_public),
    "evalica, its compiled routine called directly": ("evalica", evalica_routine),
}


def _pairs(items: Items) -> tuple[Any, Floats]:
    """All ordered pairs of items (k (k - 1), 2), and how often the first beats the second in each
    resample.
    """
    k = items.wins.shape[1]
    pairs = np.argwhere(~np.eye(k, dtype=np.bool_))
    return pairs, np.ascontiguousarray(items.wins[:, pairs[:, 0], pairs[:, 1]])


def _logs(scores: Floats) -> Floats:
    """Strengths in logits of scores; nan for a resample with one that is 0 or overflows."""
    with np.errstate(all="ignore"):
        logs = np.log(scores)
    logs[~np.isfinite(logs).all(axis=1)] = np.nan
    return np.asarray(logs)


def missing() -> list[str]:
    """The libraries that are not installed."""
    return [name for name in LIBRARIES if find_spec(name) is None]


def item_lines(k: int, n: int, sets: int, m: int, seed: int) -> tuple[list[ItemLine], int]:
    """Each method on the same data sets, one after another, and how many of their fits have no
    finite maximum: where some items never lost to the others."""
    cell = [draw_items(k, n, m, seed + i) for i in range(sets)]
    ours(cell[0])  # loads what is to be loaded
    exact = [ours(items) for items in cell]
    lines = []
    for name, (needs, method) in METHODS.items():
        if needs not in missing():
            begin = process_time()
            found = [method(items) for items in cell]
            seconds = (process_time() - begin) / len(cell)
            lines.append(_line(name, seconds, found, exact, cell))
    return lines, sum(int(np.isnan(each[:, 0]).sum()) for each in exact)


def _line(
    name: str, seconds: float, found: list[Floats], exact: list[Floats], cell: list[Items]
) -> ItemLine:
    off, lost, invented = 0.0, 0, 0
    for one, reference, items in zip(found, exact, cell, strict=True):
        gives, has = np.isfinite(one).all(axis=1), np.isfinite(reference).all(axis=1)
        both = gives & has
        apart = (one - one[:, :1] - reference)[both]
        off = max(off, float(np.abs(apart).max(initial=0.0)) / items.spread)
        lost, invented = lost + int((has & ~gives).sum()), invented + int((gives & ~has).sum())
    return ItemLine(name, 1e3 * seconds, off, lost, invented)


def item_tables(
    cells: dict[tuple[int, int], tuple[list[ItemLine], int]], sets: int, m: int
) -> Iterator[list[str]]:
    """The section on items, as lines of Markdown."""
    left_out = [f"{name} is not installed, and its rows are left out." for name in missing()]
    known = ", ".join(f"{name} {version(name)}" for name in LIBRARIES if name not in missing())
    yield [
        "## Items: the problem of choix and evalica",
        "",
        "These libraries fit one strength for each of k items, not gaps of a scale to differences "
        "of bags. With one "
        "level in each bag both are the same problem; here it has no ridge and no order. All "
        f"{m + 1} fits, to the "
        f"answers and to {m} resamples, milliseconds of processor time, mean over {sets} data "
        "set(s); at least "
        f"{PER_ITEM} answers an item: with fewer most resamples have no finite maximum. {known}"
        + "."
        * bool(known),
        *left_out,
        "",
        "Error: the largest difference from our fit, as a share of the range of the true "
        "strengths. A fit without a "
        "finite maximum (some items never lost to the others) should be told, not given: *told* "
        "counts those that were "
        "not given, nor should have been. evalica stops after its limit of iterations and says so "
        "in a number that it "
        "returns; its scores are there all the same.",
    ]
    for (k, n), (lines, none) in cells.items():
        rows = [
            [line.name, f"{line.milliseconds:,.1f}", f"{line.error:.0e}", str(line.missing),
             f"{none - line.invented} of {none}" if none else ""]
            for line in lines
        ]  # fmt: skip
        head = ("method", "ms", "error", "missing", "told")
        yield [f"### {k} items, {n} answers", "", *markdown(head, rows, 1)]
