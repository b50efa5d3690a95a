"""Explanations, as data and as sentences, of verdicts that follow from earlier answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from elicit.lp.dual_simplex import Numbers
from elicit.model.difference import dominance, tail_sums
from elicit.model.query import Verdict
from elicit.model.scale import Floats

_MOST_STEPS = (
    4  # largest number of steps of the order to name; beyond, they are "the order of the levels"
)


class UsedAnswer(NamedTuple):
    """An answer that a proof uses: its row (from 0), its id, its sign and its multiplier.

    With the sign s the answer says s d_row . e >= 0. If it was "equal", the proof uses s d_row . e
    >= -tie.
    """

    row: int
    id: str
    sign: int
    multiplier: Fraction
    equal: bool


class UsedStep(NamedTuple):
    """A step of the order of levels that a proof uses, and its multiplier.

    The step is e[gap + 1] - e[gap] >= margin, with levels counted from 0.
    """

    gap: int
    multiplier: Fraction


class UsedPrior(NamedTuple):
    """A prior inequality that a proof uses: its row in (A, b) (from 0), name and multiplier."""

    row: int
    name: str
    multiplier: Fraction


@dataclass(frozen=True)
class Proof:
    """A proof that ``sign`` d.e >= ``bound`` >= 0 on all of K_t.

    It is the identity of ``minimal_proof`` for the difference sign * d. All numbers are exact.

    Attributes
    ----------
    remainder : Fraction
        Multiplier of the whole range e_k - e_1. It may be negative if the margin or a prior's bound
        makes up for it.
    bound_without_margin : Fraction
        The part of the bound that remains if neighbouring levels may be arbitrarily near.
    """

    sign: int
    answers: tuple[UsedAnswer, ...]
    order: tuple[UsedStep, ...]
    prior: tuple[UsedPrior, ...]
    remainder: Fraction
    bound: Fraction
    bound_without_margin: Fraction

    @property
    def needs_margin(self) -> bool:
        """True if the proof depends on the margin: neighbouring levels at least that far apart."""
        return self.bound_without_margin < 0

    def __str__(self) -> str:
        terms = [
            f"{_short(y)}*({'-' * (s < 0)}d of answer {row + 1}).e"
            for row, _, s, y, _ in self.answers
        ]
        terms += [f"{_short(z)}*(e{j + 2} - e{j + 1})" for j, z in self.order]
        terms += [f'{_short(w)}*(A of "{name}").e' for _, name, w in self.prior]
        rest = (
            _short(self.remainder)
            if not terms
            else f" {'-' if self.remainder < 0 else '+'} {_short(abs(self.remainder))}"
        )
        return (
            f"{'-' * (self.sign < 0)}d.e = {' + '.join(terms)}{rest * bool(self.remainder)} >= "
            f"{_short(self.bound)}"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Explanation:
    """The reason why a difference d (k,) has its verdict.

    ``str()`` gives a sentence that counts answers from 1.

    Attributes
    ----------
    proofs : tuple of Proof
        A proof about d for BETTER, about -d for WORSE, and both for EQUAL. There are none if left
        and right are the same, or if the verdict is UNKNOWN.
    scales : tuple of (k,)
        Exact scales of K_t. For UNKNOWN there are two, one under which left is better, and one
        under which right is. For BETTER and WORSE there is one if the proof's bound is 0: under it
        left and right are not equal. Otherwise none.
    tie : float
        Largest |d.e| that an answer "equal" allows.
    told_equal : int or None
        Row of an answer "equal" to this very pair. Learners do not ask such a pair again, though
        its sign is open.
    """

    d: Floats
    verdict: Verdict
    labels: tuple[str, ...]
    margin: float
    tie: float
    proofs: tuple[Proof, ...] = ()
    scales: tuple[Numbers, ...] = ()
    told_equal: int | None = None

    @property
    def answers(self) -> tuple[UsedAnswer, ...]:
        """The answers that force the verdict. None of them can be left out.

        For EQUAL the answers of the first proof come first.
        """
        return tuple(used for proof in self.proofs for used in proof.answers)

    @property
    def order(self) -> tuple[UsedStep, ...]:
        """The steps of the order of levels that the proofs use."""
        return tuple(used for proof in self.proofs for used in proof.order)

    @property
    def prior(self) -> tuple[UsedPrior, ...]:
        """The prior inequalities that force the verdict. None of them can be left out.

        For EQUAL the inequalities of the first proof come first.
        """
        return tuple(used for proof in self.proofs for used in proof.prior)

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows (from 0) of the answers that force the verdict, each once."""
        return tuple(sorted({used.row for used in self.answers}))

    def __repr__(self) -> str:
        return f"<Explanation: {self}>"

    def __str__(self) -> str:
        if self.verdict is Verdict.UNKNOWN:
            return self._open()
        if not self.proofs:
            return "not asked: left and right are the same at every level"
        who = {Verdict.BETTER: "left is better", Verdict.WORSE: "right is better"}.get(self.verdict)
        if who and dominance(tail_sums(self.d)) == self.verdict:
            return (
                f"not asked: {who} whatever the values, since it has at least as much time at or "
                "above every level"
            )
        return (
            f"not asked: {who or 'left and right are equally good'}, because it follows from "
            f"{self._reasons()}"
        )

    def _reasons(self) -> str:
        rows = [str(row + 1) for row in self.rows]
        reasons = [f"your answer{'s' * (len(rows) > 1)} {_listed(rows)}"] if rows else []
        names = list(dict.fromkeys(f'"{used.name}"' for used in self.prior))
        reasons += (
            [f'"equal" meaning within {self.tie:g}']
            if self.tie and any(a.equal for a in self.answers)
            else []
        )
        reasons += [_listed(names)] if names else []
        reasons += self._steps()
        if any(proof.needs_margin for proof in self.proofs):
            reasons.append(f"the margin of {self.margin:g} between neighbouring levels")
        return " and from ".join(
            [", from ".join(reasons[:-1]), reasons[-1]] if len(reasons) > 1 else reasons
        )

    def _steps(self) -> list[str]:
        """Return texts of the steps of the order that the proof uses, such as "well > stable".

        If there are many steps, the text is "the order of the levels".
        """
        gaps = sorted({used.gap for used in self.order})
        whole = any(proof.remainder > 0 and proof.bound_without_margin > 0 for proof in self.proofs)
        if len(gaps) > _MOST_STEPS or (gaps and whole):
            return ["the order of the levels"]
        if whole:
            return [f"{self.labels[-1]} > {self.labels[0]}"]
        chains: list[list[int]] = []
        for j in gaps:
            if chains and chains[-1][-1] == j:
                chains[-1].append(j + 1)
            else:
                chains.append([j, j + 1])
        named = [[self.labels[i] for i in chain] for chain in chains]
        return [
            " < ".join(chain) if len(chain) > 2 else f"{chain[1]} > {chain[0]}" for chain in named
        ]

    def _open(self) -> str:
        if self.told_equal is not None:
            within = f", which it is to within {self.tie:g} of the value range" if self.tie else ""
            return (
                f"not asked again: your answer {self.told_equal + 1} called this very pair "
                f"equal{within}"
            )
        left, right = (e.astype(np.float64) for e in self.scales)
        apart = np.abs((self.scales[0] - self.scales[1]).astype(np.float64))
        most = np.argsort(-apart, kind="stable")
        shown = sorted(int(i) for i in most[:3] if apart[i] > 0.01 * apart[most[0]])
        digits = next(
            (n for n in range(2, 17) if f"{left[most[0]]:.{n}g}" != f"{right[most[0]]:.{n}g}"), 17
        )
        a, b = (
            _listed([f"{self.labels[i]} = {e[i]:.{digits}g}" for i in shown]) for e in (left, right)
        )
        ends = f"{self.labels[0]} = 0 and {self.labels[-1]} = 1"
        return (
            f"ask: what is known leaves it open; left is better if, say, {a}, right if {b} (where "
            f"{ends})"
        )


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _short(number: Fraction) -> str:
    """Return a number as text with four digits. It may be beyond the range of floats."""
    if not number or 2**-1000 < abs(number) < 2**1000:
        return f"{float(number):.4g}"
    return f"{Decimal(number.numerator) / Decimal(number.denominator):.3e}"
