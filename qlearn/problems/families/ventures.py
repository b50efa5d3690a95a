"""Safe and risky work: a career, and a power plant in bad weather."""

from __future__ import annotations

from elicit._support.hashing import Seed
from qlearn.mdp.ordinal_mdp import OrdinalMDP
from qlearn.problems.families.table import RandomNumbers, Table, checked_size


def career(seed: Seed | None = None, size: int = 40) -> OrdinalMDP:
    """Return a career: a steady post for life, or a venture that ends in fame or ruin.

    Every year there is one venture on offer, whose chance of success is known. A steady post ends
    the search at once. A venture ends in fame or ruin, after two years on average. Training waits
    for the next offer, and in 15 of 100 years the money runs out first. A post, ruin and fame last
    for ever. So everything depends on one number: where the steady post lies between ruin and fame.
    It is the standard gamble by which utilities are elicited, and a guess of it can cost a whole
    life.

    Parameters
    ----------
    seed : int or None
        The seed of the offers; None draws others each time.
    size : int
        Years in which ventures are on offer, at least 4. There are size + 3 states.

    Returns
    -------
    OrdinalMDP
        Levels: ruined < in training < in a steady post < famous. 3 actions, discount .95. Careers
        begin in one of the first half of the years.

    Notes
    -----
    The gamble is that of von Neumann and Morgenstern, "Theory of Games and Economic Behavior"
    (1944); waiting for a better one is that of job search (McCall, Quarterly Journal of Economics
    84, 1970). Chances are made up here.
    """
    n = checked_size(size, 4, "years with an offer")
    draws = RandomNumbers("career", seed)
    ruined, steady, famous = n, n + 1, n + 2
    chances = [draws.between(0.2, 0.8) for _ in range(n)]
    table = Table(
        [
            *(f"year {year + 1}, venture of {chances[year]:.0%}" for year in range(n)),
            "ruined",
            "steady post",
            "famous",
        ],
        ("take the post", "join the venture", "train"),
        ("ruined", "in training", "in a steady post", "famous"),
    )
    for year, chance in enumerate(chances):
        following = min(year + 1, n - 1)
        table.write(year, 0, 2, (steady, 1.0))
        table.write(
            year, 1, 1, (famous, 0.5 * chance), (ruined, 0.5 * (1.0 - chance)), (following, 0.5)
        )
        table.write(year, 2, 1, (following, 0.85), (ruined, 0.15))
    table.end(ruined, 0)
    table.end(steady, 2)
    table.end(famous, 3)
    return table.mdp(0.95, range(n // 2))


def plant(seed: Seed | None = None, size: int = 12) -> OrdinalMDP:
    """Return a power plant in changing weather, where load can end in a long outage.

    Each day the plant runs at full load, at half load, or is off. Bad weather makes an outage
    likely, half load three times less so, and a plant that is off is safe. Repairs take a month.
    Off, half and full load differ by a day's output, an outage by a month: how far the lower levels
    are apart decides how much weather is too much. A wrong scale shuts the plant down in fair
    weather, or runs it into one outage after the other.

    Parameters
    ----------
    seed : int or None
        The seed of the weather and its dangers; None draws others each time.
    size : int
        Kinds of weather, at least 3. There are size + 30 states.

    Returns
    -------
    OrdinalMDP
        Levels: outage < off < half load < full load. 3 actions, discount .98. It starts in any
        weather, and never ends.

    Notes
    -----
    Made up here, after shutdowns of power lines in fire weather and of plants in storms.
    """
    n = checked_size(size, 3, "kinds of weather")
    draws = RandomNumbers("plant", seed)
    repair = 30
    marks = sorted(draws.between(0.0, 1.0) for _ in range(n))
    risks = [0.002 + 0.3 * mark * mark * mark for mark in marks]
    shares = [1 + draws.whole(8) for _ in range(n)]
    changes = [share / sum(shares) for share in shares]
    table = Table(
        [
            *(f"weather {w + 1} of {n}, {risks[w]:.1%} risk at full load" for w in range(n)),
            *(f"day {day + 1} of the repair" for day in range(repair)),
        ],
        ("full load", "half load", "off"),
        ("outage", "off", "half load", "full load"),
    )
    for w, risk in enumerate(risks):
        for a, exposed in enumerate((1.0, 1 / 3, 0.0)):
            running = 1.0 - exposed * risk
            moves = [(other, running * 0.1 * changes[other]) for other in range(n)]
            table.write(w, a, 3 - a, (w, running * 0.9), (n, exposed * risk), *moves)
    for day in range(repair - 1):
        table.write_all(n + day, 0, (n + day + 1, 1.0))
    table.write_all(n + repair - 1, 0, *enumerate(changes))
    return table.mdp(0.98, range(n))
