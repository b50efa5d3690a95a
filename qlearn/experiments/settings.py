"""The settings of the ablation and of the paper's figures.

Each setting has its default, its range, and its meaning. The command line, its help and all checks
are made from the fields of these classes. Importing this module imports nothing heavy.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar

from elicit._support.validation import check_printable
from qlearn.experiments.catalogue import ALWAYS, COMPARATORS, LEARNERS, PROBLEMS
from qlearn.experiments.own_parts import Own, own_of

_LIKE: Mapping[type, Any] = {int: numbers.Integral, float: numbers.Real}  # NumPy's numbers too


@dataclass(frozen=True)
class Number:
    """A kind of setting: numbers that are finite and satisfy the condition ``holds``.

    ``wanted`` is the condition in words, for messages.
    """

    kind: type[int] | type[float]
    holds: Callable[[Any], bool]
    wanted: str

    def value_of(self, given: Any) -> int | float | None:
        """Return a number as this type, or None if it is not allowed."""
        if isinstance(given, bool) or not isinstance(given, _LIKE[self.kind]):
            return None
        try:
            value: int | float = self.kind(given)
            return value if math.isfinite(value) and self.holds(value) else None
        except (OverflowError, ValueError):  # no float can hold some ints, and no int can hold nan
            return None


@dataclass(frozen=True)
class OneOf:
    """A kind of setting: one of some names, or True or False."""

    names: tuple[Any, ...]

    @property
    def wanted(self) -> str:
        """The allowed values, in words."""
        return f"one of {', '.join(map(str, self.names))}"

    def value_of(self, given: Any) -> Any:
        """Return the given name, or None if it is not allowed."""
        return given if isinstance(given, type(self.names[0])) and given in self.names else None


@dataclass(frozen=True)
class NameOrOwn(OneOf):
    """A kind of setting: one of some names, or a user's own part (an ``Own`` or its text).

    ``call`` says in words what a factory takes and returns.
    """

    call: str

    @property
    def wanted(self) -> str:
        """The allowed values, in words."""
        ours = f"one of {', '.join(self.names)}, or " if self.names else ""
        return (
            f'{ours}"package.module:factory", or of a mapping {{name: factory}}, where '
            f"factory{self.call}"
        )

    def value_of(self, given: Any) -> Any:
        """Return the given name, or the Own; None if it is neither.

        Raise ValueError for the text of a factory that does not exist.
        """
        if isinstance(given, Own) or (isinstance(given, str) and given in self.names):
            return given
        return own_of(given) if isinstance(given, str) and ":" in given else None

    def named(self, name: Any, given: Any) -> Any:
        """Return the value of an item (name, part) of a user's mapping, or None if not allowed.

        For one of our names the value is the name. The part is then the same name, or ``...``. For
        other items the value is the user's own part.
        """
        if not isinstance(name, str) or not name:
            return None
        check_printable("names of your own", [name])
        if name in self.names and given in (name, ...):
            return name
        if isinstance(given, str) and ":" in given:
            given = own_of(given).factory
        return Own(name, given) if callable(given) else None


COUNT = Number(int, lambda n: n >= 1, "a whole number of at least 1")
FROM_0 = Number(int, lambda n: n >= 0, "a whole number of at least 0")
LEVELS = Number(int, lambda n: 2 <= n <= 100, "a whole number from 2 to 100")
PARTICLES = Number(int, lambda n: n >= 20, "a whole number of at least 20")
SHARE = Number(float, lambda x: 0 <= x <= 1, "a number from 0 to 1")
INNER = Number(float, lambda x: 0 < x < 1, "a number strictly between 0 and 1")
BELOW_1 = Number(float, lambda x: 0 <= x < 1, "a number of at least 0 and below 1")
ERROR_RATE = Number(float, lambda x: 0 <= x < 0.5, "a number of at least 0 and below 0.5")
SCALE = Number(float, lambda x: x >= 0, "a number of at least 0")

TRUTHFUL = "truthful"
TUTORS = (TRUTHFUL, "c=1", "2%", "5%", "10%", "20%", "30%")  # of the paper's figures
NAMED_TUTORS = ("person",)
"""Tutors of the ablation that have a name and no error rate."""
ORDER: Mapping[str, tuple[str, ...]] = {
    "problem": tuple(PROBLEMS),
    "learner": tuple(LEARNERS),
    "comparator": tuple(COMPARATORS),
    "errs": TUTORS,
    "error_rate": NAMED_TUTORS,
}
"""The order in which tables and pictures name things. The user's own parts come after them, as they
were given."""
OWN = {
    "problem": "problems",
    "learner": "learners",
    "comparator": "comparators",
    "error_rate": "tutors",
}
"""The columns of a table that may hold a user's own name, each with the setting that gives it."""


def setting(default: Any, check: Number | OneOf, text: str, may_be_empty: bool = False) -> Any:
    """Return a field for a class of settings.

    A tuple stands for one or more values, each of which is checked. On the command line there may
    be none if ``may_be_empty``. None is allowed if the field's type says so.
    """
    return field(
        default=default, metadata={"check": check, "help": text, "may_be_empty": may_be_empty}
    )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The settings of one run. Invalid values raise ValueError, which names the setting."""

    GROUPS: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """The settings that the command has as options, by the title under which its help lists
    them.
    """

    noise: str = setting(
        "flip",
        OneOf(("flip", "logistic")),
        "errors however clear the case (flip), or near ties mostly, set to the same mean rate "
        "(logistic)",
    )
    max_queries: int | None = setting(
        2000, FROM_0, "question budget; beyond it the best guess decides"
    )
    audit_steps: int = setting(2000, COUNT, "steps of an audited run, if steps are not fewer")
    audit_sweeps: int = setting(
        20, COUNT, "sweeps of an audited run at most, if max-sweeps are not fewer"
    )
    steps: int = setting(100_000, COUNT, "number of steps of Q-learning")
    epsilon: float = setting(
        1.0, SHARE, "chance of a random action; at 1 all comparators see the same transitions"
    )
    exploration: str | None = setting(
        None,
        OneOf(("constant", "decaying", "restarts", "optimistic", "uniform")),
        "a named way of exploring, in place of epsilon",
    )
    indifference: float = setting(
        0.0, SHARE, "undecided pairs this close count as equal (share of range)"
    )
    close: float = setting(0.005, SHARE, "the indifference of posterior-close")
    tolerance: float = setting(0.005, INNER, "policy loss aimed at (share of range)")
    max_sweeps: int = setting(
        200, COUNT, "value iteration stops there; a tutor who errs anew each time keeps it going"
    )
    precision: float = setting(300.0, SCALE, "of the Bradley-Terry prior, logits per unit of d.e")
    n_boot: int = setting(50, COUNT, "number of resamples of a Bradley-Terry fit")
    level: float = setting(0.95, INNER, "confidence level, also the posterior's")
    refit_growth: float = setting(
        0.05, SCALE, "growth of the answers between two Bradley-Terry fits; 0: fit at each (hours)"
    )
    lapse: float | None = setting(
        None,
        BELOW_1,
        "share of answers that the posterior takes to be given at random (default: it is learned)",
    )
    particles: int = setting(1000, PARTICLES, "the posterior's number of particles")
    tie: float | None = setting(
        None,
        BELOW_1,
        "how far apart a tutor may call equal; 0 with ours, who are exact, .01 with yours (share "
        "of range)",
    )

    def __post_init__(self) -> None:
        for one in fields(self):
            given = getattr(self, one.name)
            if not (given is None and "None" in str(one.type)):
                object.__setattr__(self, one.name, _checked(one, given))

    def own(self) -> dict[str, dict[str, Own]]:
        """The user's own parts, by the column of the table and by name."""
        return {}

    def named(self, *names: str) -> dict[str, Any]:
        """Return the settings with these names, as keywords."""
        return {name: getattr(self, name) for name in names}

    def of_a_run(self) -> Settings:
        """Return the settings that matter to a single run, without the plan of many runs."""
        return Settings(**self.named(*(one.name for one in fields(Settings))))


_FOR_THE_ABLATION = tuple(name for name in COMPARATORS if name != "box-rescaled")
_IN_THE_ABLATION = tuple(name for name in _FOR_THE_ABLATION if name != "polytope-1-wrong")
_IN_THE_PAPER = ("polytope", "posterior", "box-rescaled", "box")


@dataclass(frozen=True, kw_only=True)
class AblationSettings(Settings):
    """The settings of the ablation.

    Attributes
    ----------
    problems : tuple of str
        Problems by name. Default: "random" and "icu-sepsis". Of this setting, ``learners``,
        ``comparators`` and ``tutors``, a mapping from names to factories gives your own
        (``ablate``).
    learners : tuple of str
        Learners by name. Default: all.
    comparators : tuple of str
        Comparators by name. Default: all but the polytope that allows for a wrong answer.
    tutors : tuple of str
        Tutors beside those of the error rates: "person", who errs as people were seen to, or your
        own. Default: none.
    error_rates : tuple of float
        The tutors' chances of a wrong answer, each at least 0 and below 0.5. 0 is truthful.
        Default: 0, 0.05 and 0.15.
    noise : {"flip", "logistic"}
        "flip": a tutor errs however clear the case is. "logistic": mostly at near ties, at the same
        mean rate. Default: "flip".
    tie : float, optional
        How far apart a tutor may call equal, a share of the value range. None: 0 with our tutors,
        who are exact, and 0.01 with yours.
    audit : float
        Share of decided pairs put to the tutor in the audited runs. 0: no such runs. Default: 0.05.
    audit_steps : int
        Steps of an audited run, if ``steps`` are not fewer. Default: 2000.
    audit_sweeps : int
        Largest number of sweeps of an audited run, if ``max_sweeps`` are not fewer. Default: 20.
    seeds : int
        Number of seeds. Default: 4.
    seed : int
        The first seed. Default: 0.
    max_queries : int, optional
        Question budget. Beyond it the best guess decides. None: no limit. Default: 2000.
    states, actions : int
        Number of states and actions of random MDPs. Default: 100 and 5.
    levels : int
        Number of levels of random MDPs, from 2 to 100. Default: 10.
    discount : float
        Discount of random MDPs, at least 0 and below 1. Other problems have their own. Default:
        0.95.
    steps : int
        Number of steps of Q-learning. Default: 100,000.
    epsilon : float
        Q-learning's probability of a random action. At 1 all comparators see the same transitions.
        Default: 1.
    exploration : str, optional
        A named way of exploring, in place of ``epsilon``: "constant", "decaying", "restarts",
        "optimistic" or "uniform". None: ``epsilon``.
    indifference : float
        Undecided pairs this close count as equal, a share of the value range. Default: 0.
    close : float
        The indifference of "posterior-close". Default: 0.005.
    tolerance : float
        The policy loss that value iteration and policy iteration aim at, a share of the value
        range. Default: 0.005.
    max_sweeps : int
        Value iteration stops after this many sweeps. Default: 200.
    precision : float
        Precision of the Bradley-Terry prior, in logits per unit of d.e. Default: 300.
    n_boot : int
        Number of resamples of a Bradley-Terry fit. Default: 50.
    level : float
        Confidence level of Bradley-Terry and of the posterior, strictly between 0 and 1. Default:
        0.95.
    refit_growth : float
        Growth of the answers between two Bradley-Terry fits, a share. 0: fit at each answer, which
        takes hours. Default: 0.05.
    lapse : float, optional
        Share of answers that the posterior takes to be given at random. None: it is learned.
    particles : int
        The posterior's number of particles, at least 20. Default: 1000.

    Raises
    ------
    ValueError
        If a setting is out of range. The message names the setting.
    """

    GROUPS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "the sweep": (
            "problems", "learners", "comparators", "error_rates", "noise", "tutors", "tie", "audit",
            "audit_steps",
            "audit_sweeps", "seeds", "seed", "max_queries",
        ),
        "the random MDP": ("states", "actions", "levels", "discount"),
        "Q-learning": ("steps", "epsilon", "exploration", "indifference", "close"),
        "value iteration and policy iteration": ("tolerance", "max_sweeps"),
        "Bradley-Terry": ("precision", "n_boot", "level", "refit_growth"),
        "posterior": ("lapse", "particles"),
    }  # fmt: skip

    problems: tuple[str | Own, ...] = setting(
        ("random", "icu-sepsis"),
        NameOrOwn(tuple(PROBLEMS), "(seed) returns (mdp, values)"),
        "random MDPs; real and known tasks; families in which asking matters; your own",
    )
    learners: tuple[str | Own, ...] = setting(
        tuple(LEARNERS),
        NameOrOwn(tuple(LEARNERS), "(mdp, comparator, seed) returns a Learner"),
        "Q-learning; interactive value iteration and policy iteration; your own. Policy iteration "
        "runs only with "
        "comparators that can prove a loss bound: not with always, not with box",
    )
    comparators: tuple[str | Own, ...] = setting(
        _IN_THE_ABLATION,
        NameOrOwn(_FOR_THE_ABLATION, "(k, seed) returns a Comparator"),
        "always ask; polytope, plain and (if named) with one wrong answer; posterior, plain and "
        "with an indifference; Bradley-Terry; your own",
    )
    tutors: tuple[str | Own, ...] = setting(
        (),
        NameOrOwn(NAMED_TUTORS, "(values, seed), or (values, seed, reference), returns a Tutor"),
        "beside those of the error rates: person, who errs as people were seen to (another one for "
        "each seed), or your own",
    )
    error_rates: tuple[float, ...] = setting(
        (0.0, 0.05, 0.15), ERROR_RATE, "the tutor's chance of a wrong answer; 0 is truthful"
    )
    audit: float = setting(
        0.05, SHARE, "share of decided pairs put to the tutor in the audited runs; 0: none"
    )
    seeds: int = setting(4, COUNT, "number of seeds")
    seed: int = setting(0, FROM_0, "the first seed")
    states: int = setting(100, COUNT, "number of states")
    actions: int = setting(5, COUNT, "number of actions")
    levels: int = setting(10, LEVELS, "number of levels")
    discount: float = setting(
        0.95, BELOW_1, "discount factor of random MDPs; other problems have their own"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in OWN.values():
            names = [one.name for one in getattr(self, name) if isinstance(one, Own)]
            clash = {
                n for n in names if names.count(n) > 1 or n in getattr(self, name) or n == ALWAYS
            }
            if clash:
                raise ValueError(
                    f"{name}: {min(clash)!r} already means something: name your own otherwise"
                )

    def names(self, setting: str) -> tuple[str, ...]:
        """Return the names in a setting that lists parts, such as comparators.

        Parameters
        ----------
        setting : str
            The name of the setting.

        Returns
        -------
        tuple of str
        """
        return tuple(one.name if isinstance(one, Own) else one for one in getattr(self, setting))

    def own(self) -> dict[str, dict[str, Own]]:
        """Return the user's own parts, by the column of the table and by name.

        Returns
        -------
        dict of str to dict of str to Own
        """
        given = {column: getattr(self, name) for column, name in OWN.items()}
        return {
            column: {one.name: one for one in ones if isinstance(one, Own)}
            for column, ones in given.items()
        }


@dataclass(frozen=True, kw_only=True)
class FiguresSettings(Settings):
    """The settings of the paper's figures.

    Runs differ from those of the ablation in three ways. The tutor answers as in the paper's eq.
    (6). There is no budget, because figures 2 and 3 show the number of questions. Fits are made
    only when the number of answers has grown by a fifth.
    """

    GROUPS: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "the two series": (
            "levels", "at_states", "states", "at_levels", "actions", "discount", "seeds", "seed",
            "steps", "epsilon",
        ),
        "comparators and tutors": (
            "comparators", "tutors", "thinned", "precision", "n_boot", "level", "refit_growth",
            "lapse",
            "particles",
        ),
    }  # fmt: skip

    noise: str = setting("logistic", OneOf(("flip", "logistic")), "as in the ablation")
    max_queries: int | None = setting(None, FROM_0, "as in the ablation")
    refit_growth: float = setting(
        0.2, SCALE, "growth of the box's answers between two fits; 0: fit at each (hours)"
    )
    levels: tuple[int, ...] = setting(
        (5, 10, 15, 20, 25), LEVELS, "numbers of levels of the first series"
    )
    at_states: int = setting(100, COUNT, "its number of states")
    states: tuple[int, ...] = setting(
        (100, 200, 300, 400, 500), COUNT, "numbers of states of the second series"
    )
    at_levels: int = setting(20, LEVELS, "its number of levels")
    actions: int = setting(5, COUNT, "number of actions")
    discount: float = setting(0.95, BELOW_1, "discount factor")
    seeds: int = setting(20, COUNT, "number of runs of each point")
    seed: int = setting(0, FROM_0, "the first seed")
    comparators: tuple[str, ...] = setting(
        _IN_THE_PAPER,
        OneOf(_IN_THE_PAPER),
        "the polytope (its tutor never errs), the posterior, the paper's Bradley-Terry box with "
        "footnote 3 and without",
    )
    tutors: tuple[str, ...] = setting(
        TUTORS[:5],
        OneOf(TUTORS),
        "who answers all but the polytope, whose tutor never errs: as in eq. (6) with this c, on "
        "counts times values "
        "of 0..99, or with the precision that errs in this share of the comparisons of an optimal "
        "policy",
    )
    thinned: tuple[str, ...] = setting(
        ("posterior",),
        OneOf(_IN_THE_PAPER),
        "comparators (or none) that run only at every other size and with every other tutor; all "
        "others run at every "
        "size with the first and the last tutor, and at every other one with those between",
        may_be_empty=True,
    )


def _checked(one: Field[Any], given: Any) -> Any:
    """Return the value of a field, converted by its kind. Raise ValueError if it is not allowed."""
    check = one.metadata["check"]
    many = isinstance(one.default, tuple)
    if many and (isinstance(given, str) or not hasattr(given, "__iter__")):
        raise ValueError(f"{one.name} must be several values, not {given!r}")
    try:
        if isinstance(given, Mapping) and isinstance(check, NameOrOwn):
            found = [
                (f"{name!r}: {value!r}", check.named(name, value)) for name, value in given.items()
            ]
        else:
            found = [
                (repr(value), check.value_of(value)) for value in (given if many else (given,))
            ]
    except ValueError as error:
        raise ValueError(f"{one.name}: {error}") from error
    for shown, value in found:
        if value is None:
            raise ValueError(
                f"{one.name} must {'each ' if many else ''}be {check.wanted}, not {shown}"
            )
    return tuple(value for _, value in found) if many else found[0][1]
