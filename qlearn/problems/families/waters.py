"""Stocks that are used or saved: a fishery, and a reservoir."""

from __future__ import annotations

from collections.abc import Iterator

from elicit._support.hashing import Seed
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.table import RandomNumbers, Table, checked_size


def fishery(seed: Seed | None = None, size: int = 40) -> OrdinalMDP:
    """Return a fishery whose stock recovers slowly, and below a threshold not at all.

    Every year a share of the stock is caught. The rest grows, fastest at middling stocks, and
    shrinks by itself below a threshold: too few fish find each other. Good and bad years cannot be
    foreseen. A rich catch today may mean no catch for decades. Whether a small catch for ever is
    worth more than a rich one for some years depends on what the levels are worth. A wrong scale
    ruins a stock that was worth keeping, or closes a fishery that was lost anyway.

    Parameters
    ----------
    seed : int or None
        The seed of growth, threshold and luck; None draws others each time.
    size : int
        Steps of the stock, at least 10, and the number of states.

    Returns
    -------
    OrdinalMDP
        Levels: collapsed < no catch < small catch < fair catch < rich catch. 4 actions, discount
        .96. It starts at any stock above the threshold, and never ends.

    Notes
    -----
    Logistic growth with a threshold (the Allee effect), as in Clark, "Mathematical Bioeconomics"
    (2nd edition 1990). The numbers are made up here.
    """
    n = checked_size(size, 10, "steps of the stock")
    draws = RandomNumbers("fishery", seed)
    growth = draws.between(0.6, 1.4)
    threshold = draws.between(0.15, 0.3)
    luck = draws.between(0.05, 0.15)
    table = Table(
        [f"stock {s} of {n - 1}" for s in range(n)],
        ("no fishing", "small quota", "fair quota", "rich quota"),
        ("collapsed", "no catch", "small catch", "fair catch", "rich catch"),
    )
    collapsed = (n - 1) // 10
    for s in range(n):
        stock = s / (n - 1)
        for a, quota in enumerate((0.0, 0.1, 0.2, 0.3)):
            # from few fish the same effort catches less
            level = 0 if s <= collapsed else max(1, a + 1 - (stock < 0.4 and a > 0))
            grown = stock + growth * stock * (1.0 - stock) * (stock - threshold)
            left = max(grown - quota * stock, 0.0)
            moves = [
                move
                for chance, year in _YEARS
                for move in _between(left * (1.0 + year * luck), n, chance)
            ]
            table.write(s, a, level, *moves)
    return table.mdp(0.96, [s for s in range(n) if s / (n - 1) > threshold])


_YEARS = ((0.1, -2.0), (0.2, -1.0), (0.4, 0.0), (0.2, 1.0), (0.1, 2.0))
"""The kinds of years, from very bad to very good: probability, and distance from a usual year."""


def reservoir(seed: Seed | None = None, size: int = 20) -> OrdinalMDP:
    """Return a reservoir that supplies a town and protects it from floods.

    Every season some water is let out to the town. Inflow changes with the season and from year to
    year. A full reservoir cannot hold back a flood, whose damage takes two years to repair. An
    empty one leaves taps dry. Water in store guards against dry seasons, and invites floods. So it
    matters how much worse than dry taps a flood is, and how much better plenty is than rations. A
    wrong scale empties the reservoir for fear of floods, or fills it for fear of thirst.

    Parameters
    ----------
    seed : int or None
        The seed of the inflows; None draws others each time.
    size : int
        Steps of the water in store, at least 8. There are 4 * size + 8 states.

    Returns
    -------
    OrdinalMDP
        Levels: flooded < dry taps < rationed < enough < plenty. 4 actions, discount .97. It starts
        half full in any season, and never ends.

    Notes
    -----
    A reservoir under uncertain inflow is one of the first uses of dynamic programming: Little, "The
    use of storage water in a hydroelectric system" (Operations Research 3, 1955). The numbers are
    made up here.
    """
    n = checked_size(size, 8, "steps of the water in store")
    draws = RandomNumbers("reservoir", seed)
    inflows = [draws.between(0.03, 0.25) for _ in range(4)]
    spread = draws.between(0.3, 0.6)
    seasons, repair = ("spring", "summer", "autumn", "winter"), 8
    table = Table(
        [
            *(f"{season}, {v} of {n - 1} full" for season in seasons for v in range(n)),
            *(f"season {q + 1} of the repair" for q in range(repair)),
        ],
        ("keep", "ration", "supply", "let out"),
        ("flooded", "dry taps", "rationed", "enough", "plenty"),
    )
    flood = 4 * n
    for season, inflow in enumerate(inflows):
        for v in range(n):
            stored = v / (n - 1)
            for a, wanted in enumerate((0.0, 0.1, 0.2, 0.3)):
                short = wanted > stored
                level = 1 if short or a == 0 else a + 1
                left = max(stored - wanted, 0.0)
                moves: list[tuple[int, float]] = []
                for chance, year in _YEARS:
                    full = left + inflow * (1.0 + year * spread)
                    if full > 1.0:
                        moves.append((flood, chance))
                        continue
                    first = (season + 1) % 4 * n
                    moves += [(first + to, p) for to, p in _between(max(full, 0.0), n, chance)]
                table.write(season * n + v, a, level, *moves)
    for q in range(repair - 1):
        table.write_all(flood + q, 0, (flood + q + 1, 1.0))
    table.write_all(flood + repair - 1, 0, *((season * n + n // 2, 0.25) for season in range(4)))
    return table.mdp(0.97, [season * n + n // 2 for season in range(4)])


def _between(amount: float, n: int, chance: float) -> Iterator[tuple[int, float]]:
    """Yield the two of n steps that an amount in 0..1 lies between, with parts of a probability."""
    place = min(amount, 1.0) * (n - 1)
    below = min(int(place), n - 2)
    yield below, chance * (1.0 - (place - below))
    yield below + 1, chance * (place - below)
