"""Prior knowledge of the scale: named linear inequalities on e, with e_1 = 0 and e_k = 1.

    inequality("well >= 2*stable", labels=["critical", "stable", "well"])
    inequality("e4 - e3 >= e3 - e2", k=5, name="the last steps grow")

A text is read as a linear expression and never run. It may hold names of levels, numbers, + - * /
and brackets.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from unicodedata import normalize

import numpy as np
from numpy.typing import ArrayLike

from elicit._support.validation import is_list, require
from elicit.model.comparator import check_levels
from elicit.model.difference import as_vectors
from elicit.model.scale import Floats
from elicit.model.scale_variable import is_constraint, linear_rows

if TYPE_CHECKING:
    import cvxpy

_LONGEST = 1000  # characters; a text beyond the parser's own limit would crash it
_FORM = (
    'such as "e4 >= 2*e2 + 0.1": names of levels, numbers, + - * / and brackets on both sides of '
    "one >= or <="
)
_NO_WORD = re.compile(r"\W+")  # characters that a name in a text cannot hold, such as a space
_LIKE_A_NUMBER = re.compile(r"(?<![\w.])((?:\d+\.?\d*|\.\d+)[eE](\d+))(?![\w.])")


@dataclass(frozen=True, eq=False)
class Inequality:
    """The inequality ``coefficients`` . e >= ``bound``, with the name that people know it by.

    Parameters
    ----------
    coefficients : (k,)
    bound : float
    name : str

    Raises
    ------
    ValueError
        Unless all numbers are finite and there is one for each of k >= 2 levels.
    """

    coefficients: Floats
    bound: float
    name: str = ""

    def __post_init__(self) -> None:
        if np.ndim(self.coefficients) != 1:
            raise ValueError(
                f"an inequality has coefficients of shape (k,), not {np.shape(self.coefficients)}"
            )
        row = as_vectors(self.coefficients, name="an inequality's coefficients")[0].copy()
        row.flags.writeable = False
        object.__setattr__(self, "coefficients", row)
        object.__setattr__(self, "bound", float(_bounds(self.bound, 1)[0]))
        object.__setattr__(self, "name", str(self.name) or readable(row, self.bound))


class Prior(NamedTuple):
    """Several inequalities a e >= b, as a (p, k) and b (p,), and their p names."""

    a: Floats
    b: Floats
    names: tuple[str, ...]


Statement: TypeAlias = "Inequality | str | cvxpy.Constraint"
PriorLike: TypeAlias = (
    "Prior | tuple[ArrayLike, ArrayLike] | Statement | Sequence[Statement] | None"
)


def inequality(
    text: str, k: int | None = None, labels: Sequence[str] | None = None, name: str | None = None
) -> Inequality:
    """Return one inequality from text such as "e4 >= 2*e2".

    Parameters
    ----------
    text : str
        Levels are e1 (worst, always 0) to ek (best, always 1), or go by their labels ("very_ill"
        for "very ill").
    k : int, optional
        Number of levels. It may be left out if ``labels`` is given.
    labels : (k,) str, optional
        Names of the levels, worst first.
    name : str, optional
        Default: the text.

    Returns
    -------
    Inequality

    Raises
    ------
    ValueError
        For anything but one linear >= or <=.
    """
    found = inequalities(text, k, labels, name)
    if len(found) > 1:
        raise ValueError(
            f'"{text}" holds {len(found)} inequalities: write each by itself, or use inequalities()'
        )
    return found[0]


def inequalities(
    text: str | Sequence[str],
    k: int | None = None,
    labels: Sequence[str] | None = None,
    name: str | None = None,
) -> tuple[Inequality, ...]:
    """Read one text or several, each an inequality or a chain of them.

        labels = ["critical", "stable", "well"]
        PolytopeComparator(3, prior=inequalities(["stable >= 0.4", "0.9*well >= stable"],
        labels=labels))

    Parameters
    ----------
    text : str or sequence of str
        An inequality such as "e4 >= 2*e2", a chain such as "0.2 <= e2 <= 0.5", or a list of these.
    k : int, optional
        The number of levels. It may be left out if ``labels`` is given.
    labels : (k,) str, optional
        The levels' names, worst first. The text may use them, as well as e1 to ek. Write "very_ill"
        for "very ill".
    name : str, optional
        A name for people. Default: the text. Several inequalities add their text to the name.

    Returns
    -------
    tuple of Inequality
        One for each inequality, in order.

    Raises
    ------
    ValueError
        If a text is anything but linear inequalities with >= or <=, or if it names an unknown
        level.
    """
    if not isinstance(text, str):
        for one in text:
            require(isinstance(one, str), "each inequality", "a text such as 'e2 >= 0.4'", one)
        each = [
            (one, name if name is None or len(text) == 1 else f"{name}: {one.strip()}")
            for one in text
        ]
        return tuple(
            found for one, called in each for found in inequalities(one, k, labels, called)
        )
    if k is None and labels is None:
        raise ValueError(f'how many levels is "{text}" about? Give k or labels')
    levels = _levels(check_levels(len(labels or ()) if k is None else k), labels)
    tree = _parsed(text, max(levels.values()) + 1)
    if not isinstance(tree, ast.Compare):
        raise ValueError(f'"{text}" states no inequality: write one {_FORM}')
    signs = [_direction(op, text) for op in tree.ops]
    parts = (tree.left, *tree.comparators)
    try:
        sides = [_linear(part, levels, text) for part in parts]
    except RecursionError:
        raise ValueError(f'"{text}" is nested too deeply to be read') from None
    out: list[Inequality] = []
    for i, sign in enumerate(signs):
        row = sign * (sides[i] - sides[i + 1])
        if not np.isfinite(row).all():
            raise ValueError(f'"{text}" holds numbers too large to compute with')
        if not row[1:].any():
            raise ValueError(
                f'"{text}" compares nothing: no level is left in it once both sides are subtracted'
            )
        shown = name or text.strip()
        if len(signs) > 1:
            link = (
                f"{ast.unparse(parts[i])} {'>=' if sign > 0 else '<='} {ast.unparse(parts[i + 1])}"
            )
            shown = f"{name}: {link}" if name else link
        out.append(Inequality(row[1:], float(0.0 - row[0]), shown))
    return tuple(out)


def as_prior(prior: PriorLike, k: int) -> Prior | None:
    """Return prior knowledge about k levels, in any of its forms, as a ``Prior``.

    Parameters
    ----------
    prior : optional
        None, (A (p, k), b (p,)) meaning A e >= b, an Inequality or its text, a linear cvxpy
        constraint over ``elicit.scale_variable(k)``, a sequence of these, or a Prior. A constraint
        is called by its label, or else by the text that cvxpy prints.
    k : int
        Number of levels.

    Returns
    -------
    Prior or None
        None if there is no prior.

    Raises
    ------
    ValueError
        For other shapes, another number of levels, numbers that are not finite, and constraints
        that are not linear.
    """
    if prior is None:
        return None
    if isinstance(prior, Prior):
        a, b, names = prior
        return _prior(a, b, tuple(str(name) for name in names), k)
    given: Any = [prior] if _is_statement(prior) else prior
    if not isinstance(given, (list, tuple)):
        raise ValueError(
            f"a prior is (A, b) with A e >= b, or a list of inequalities, not {prior!r}"
        )
    if all(_is_statement(one) for one in given):
        listed = [x for one in given for x in _stated(one, k)]
        for one in listed:
            if len(one.coefficients) != k:
                raise ValueError(
                    f'the prior\'s "{one.name}" is about {len(one.coefficients)} levels, not k = '
                    f"{k}"
                )
        rows = np.array([one.coefficients for one in listed])
        return (
            _prior(rows, [one.bound for one in listed], tuple(one.name for one in listed), k)
            if listed
            else None
        )
    if len(given) != 2 or any(_is_statement(one) for one in given):
        raise ValueError(
            f"a prior is (A, b) with A e >= b, or a list of inequalities, not {prior!r}"
        )
    return _prior(given[0], given[1], None, k)


def readable(coefficients: Floats, bound: float) -> str:
    """Return the inequality coefficients . e >= bound as text, such as "2*e3 - e2 >= 0.1".

    The best level comes first.
    """
    terms = [(float(c), f"e{i + 1}") for i, c in enumerate(coefficients) if c != 0][::-1]
    sign = -1.0 if terms and terms[0][0] < 0 else 1.0
    text = ""
    for c, level in terms:
        size = "" if abs(c) == 1 else f"{abs(c):.6g}*"
        text += (" + " if sign * c > 0 else " - ") * bool(text) + size + level
    return f"{text or '0'} {'>=' if sign > 0 else '<='} {sign * bound + 0.0:.6g}"


def _is_statement(one: object) -> bool:
    return isinstance(one, (Inequality, str)) or is_constraint(one)


def _stated(one: Statement, k: int) -> Sequence[Inequality]:
    """Return the inequalities that a statement about k levels makes.

    If a cvxpy constraint has several rows, they get numbered names.
    """
    if isinstance(one, Inequality):
        return [one]
    if isinstance(one, str):
        return inequalities(one, k)
    a, b, name = linear_rows(one, k)
    numbers = [readable(row, float(limit)) for row, limit in zip(a, b, strict=True)]
    names = (
        [name] * len(a)
        if one.size == 1
        else [f"{name}: {shown}" if name else shown for shown in numbers]
    )
    return [
        Inequality(row, float(limit), shown) for row, limit, shown in zip(a, b, names, strict=True)
    ]


def _prior(a: ArrayLike, b: ArrayLike, names: tuple[str, ...] | None, k: int) -> Prior:
    rows = as_vectors(a, k, name="the prior's A").copy()
    limits = _bounds(b, len(rows), "the prior's b")
    if names is None:
        names = tuple(readable(row, float(limit)) for row, limit in zip(rows, limits, strict=True))
    if len(names) != len(rows):
        raise ValueError(
            f"a prior needs one name an inequality: {len(rows)} inequalities, {len(names)} names"
        )
    rows.flags.writeable = limits.flags.writeable = False
    return Prior(rows, limits, names)


def _bounds(b: ArrayLike, count: int, name: str = "an inequality's bound") -> Floats:
    want = "one finite number" if count == 1 else f"{count} finite numbers, one a row of A"
    try:
        limits = np.array(b, dtype=np.float64, ndmin=1)
    except (TypeError, ValueError):
        limits = np.full(count, np.nan)
    if limits.shape != (count,) or not np.isfinite(limits).all():
        raise ValueError(f"{name} must be {want}, not {b!r}")
    return limits


def _levels(k: int, labels: Sequence[str] | None) -> dict[str, int]:
    """Return the number of each level, from 0, by every name that an expression may use."""
    levels = {f"e{i + 1}": i for i in range(k)}
    require(labels is None or is_list(labels, k), "labels", f"{k} names, one a level", labels)
    for i, label in enumerate(labels or ()):
        word = normalize("NFKC", str(label))  # as the parser does with every name it reads
        if word.isidentifier() and levels.setdefault(word, i) != i:
            raise ValueError(
                f'the label "{label}" of level {i + 1} is also a name of level {levels[word] + 1}'
            )
    words = [_NO_WORD.sub("_", normalize("NFKC", str(label))) for label in labels or ()]
    for i, word in enumerate(words):
        if (
            word.isidentifier() and words.count(word) == 1
        ):  # otherwise it is ambiguous which level is meant
            levels.setdefault(word, i)
    return levels


def _parsed(text: str, k: int) -> ast.expr:
    if len(text) > _LONGEST:
        raise ValueError(
            f"an inequality of {len(text)} characters is too long to read: {_LONGEST} are the most"
        )
    for number, level in _LIKE_A_NUMBER.findall(text):
        if 1 <= int(level) <= k:
            factor = re.split("[eE]", number)[0]
            raise ValueError(
                f'"{text}": {number} would be read as the number {float(number):g}. Write '
                f"{factor}*e{level} for the "
                f"level, {float(number):g} for the number"
            )
    try:
        return ast.parse(text.strip().replace("≥", ">=").replace("≤", "<="), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f'"{text}" cannot be read: write an inequality {_FORM}') from None


def _direction(op: ast.cmpop, text: str) -> int:
    """Return 1 for >= and -1 for <=; raise ValueError for any other comparison."""
    if isinstance(op, (ast.Gt, ast.Lt)):
        sign = ">" if isinstance(op, ast.Gt) else "<"
        raise ValueError(
            f'"{text}": write {sign}= for {sign}; the border always belongs to the scales that fit'
        )
    if isinstance(op, ast.Eq):
        raise ValueError(
            f'"{text}": write an equality as two inequalities, one with >= and one with <='
        )
    if not isinstance(op, (ast.GtE, ast.LtE)):
        raise ValueError(f'"{text}" states no inequality: write one {_FORM}')
    return 1 if isinstance(op, ast.GtE) else -1


def _linear(node: ast.expr, levels: dict[str, int], text: str) -> Floats:
    """Return an expression as numbers (1 + k,): its constant, and a coefficient for each level."""
    out: Floats = np.zeros(1 + max(levels.values()) + 1)
    if (
        isinstance(node, ast.Constant)
        and isinstance(node.value, (int, float))
        and not isinstance(node.value, bool)
    ):
        try:
            out[0] = float(node.value)
        except OverflowError:
            out[0] = np.inf
        return out
    if isinstance(node, ast.Name):
        if node.id not in levels:
            raise ValueError(
                f'"{text}": no level is called "{node.id}"; there are {", ".join(levels)}. To use '
                "other names, give "
                f'them: elicit.inequalities("{text}", labels=[...]), with one name a level, worst '
                "first"
            )
        out[1 + levels[node.id]] = 1.0
        return out
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        side = _linear(node.operand, levels, text)
        return side if isinstance(node.op, ast.UAdd) else 0.0 - side
    if isinstance(node, ast.BinOp) and isinstance(node.op, (ast.Add, ast.Sub, ast.Mult, ast.Div)):
        left, right = _linear(node.left, levels, text), _linear(node.right, levels, text)
        with np.errstate(all="ignore"):  # the caller checks for overflow
            if isinstance(node.op, ast.Add):
                return left + right
            if isinstance(node.op, ast.Sub):
                return left - right
            if isinstance(node.op, ast.Mult) and not left[1:].any():
                return np.asarray(left[0] * right)
            if not right[1:].any():
                if isinstance(node.op, ast.Div) and right[0] == 0:
                    raise ValueError(f'"{text}" divides by zero')
                scaled: Floats = (
                    left / right[0] if isinstance(node.op, ast.Div) else left * right[0]
                )
                return scaled
    raise ValueError(
        f'"{text}": "{ast.unparse(node)}" is not linear in the levels; write an inequality {_FORM}'
    )
