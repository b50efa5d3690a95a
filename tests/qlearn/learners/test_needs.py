"""Learners and strategies take of a comparator what they declare, and no more."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import qlearn
from elicit import Bags, Needs, PolytopeComparator, PosteriorComparator, TruthfulTutor
from elicit.model.comparator_parts import OPTIONAL_PARTS
from elicit.model.needs import needs_of
from qlearn.learners.query_strategies import STRATEGIES, Candidates
from tests.own_cases import Exact
from tests.thoroughness import on_any_processor

K = 4
MDP, VALUES = qlearn.random_mdp(8, 3, K, discount=0.8, seed=3)
# a comparator that leaves the order open is refused, so no consumer takes the part
PARTS = {part.member for part in OPTIONAL_PARTS} - {"unordered"}
DOCS = Path(__file__).parents[3] / "docs"


class Spy:
    """A comparator that hands on every part of another, and notes which were asked for."""

    def __init__(self, inner: Any, seen: set[str]) -> None:
        self._inner, self._seen = inner, seen
        self.k = inner.k

    @property
    def values(self) -> Any:
        return self._inner.values

    def bounds(self, d: Any) -> Any:
        return self._inner.bounds(d)

    def compare(self, d: Any) -> Any:
        return self._inner.compare(d)

    def update(self, answers: Any) -> Spy:
        return Spy(self._inner.update(answers), self._seen)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in PARTS:
            self._seen.add(name)
        return getattr(self._inner, name)


LEARNERS: dict[str, Any] = {
    "InteractivePolicyIteration": qlearn.InteractivePolicyIteration,
    "with bags": partial(qlearn.InteractivePolicyIteration, bags=Bags(days=4)),
    "InteractiveValueIteration": partial(qlearn.InteractiveValueIteration, tolerance=0.05),
    "LateValueIteration": partial(qlearn.LateValueIteration, tolerance=0.05),
    "InteractiveQLearning": partial(qlearn.InteractiveQLearning, steps=200),
    "LateQLearning": partial(qlearn.LateQLearning, steps=200),
}


@on_any_processor
@pytest.mark.parametrize("inner", [PolytopeComparator(K), PosteriorComparator(K, seed=0)])
@pytest.mark.parametrize("name", LEARNERS)
def test_a_learner_takes_no_part_that_it_does_not_declare(name: str, inner: Any) -> None:
    seen: set[str] = set()
    learner = LEARNERS[name](MDP, Spy(inner, seen), max_queries=6)
    result = qlearn.drive(learner, TruthfulTutor(VALUES))
    assert result.loss_bound >= 0
    declared = needs_of(type(learner)) | needs_of(getattr(learner, "_strategy", None))
    assert seen
    assert seen <= {*declared.required, *declared.used}


@pytest.mark.parametrize("name", STRATEGIES)
def test_a_strategy_takes_what_it_declares(name: str) -> None:
    seen: set[str] = set()
    d = np.random.default_rng(0).dirichlet(np.ones(K), (2, 6))
    comparator = Spy(PosteriorComparator(K, seed=0), seen)
    zeros = np.zeros(6, np.int64)
    STRATEGIES[name](Candidates(d[0] - d[1], zeros, zeros, 0.01, comparator))  # type: ignore[arg-type]
    assert seen == set(needs_of(STRATEGIES[name]).used)


def test_a_strategy_of_ones_own_that_requires_a_part_is_refused_when_the_learner_is_made() -> None:
    def mine(candidates: Candidates) -> Any:
        return candidates.comparator.lapse  # type: ignore[attr-defined]

    mine.needs = Needs(required=("lapse",))  # type: ignore[attr-defined]
    for learner in (
        qlearn.InteractivePolicyIteration,
        qlearn.LateValueIteration,
        qlearn.LateQLearning,
    ):
        with pytest.raises(TypeError, match=r"Exact has no lapse, which mine needs .*Posterior"):
            learner(MDP, Exact(VALUES), strategy=mine)
    with pytest.raises(TypeError, match="PolytopeComparator has no lapse, which mine needs"):
        qlearn.InteractiveTraining(PolytopeComparator(K), discount=0.5, strategy=mine)


def named(members: Any) -> str:
    return ", ".join(f"`{member}`" for member in members)


@pytest.mark.parametrize(
    "name", [*(name for name in LEARNERS if " " not in name), "InteractiveTraining"]
)
def test_the_docs_have_the_table_of_what_learners_take(name: str) -> None:
    needs = needs_of(getattr(qlearn, name))
    row = f"| `{name}` | {named(needs.required) or '-'} | {named(needs.used)} |"
    assert row in (DOCS / "your-own-comparator.md").read_text(encoding="utf-8")


def test_the_docs_list_the_strategies_by_what_they_use() -> None:
    text = (DOCS / "reference" / "qlearn.md").read_text(encoding="utf-8")
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, strategy in STRATEGIES.items():
        groups.setdefault(needs_of(strategy).used, []).append(name)
    for used, names in groups.items():
        assert f"| {named(used) or 'nothing'} | {named(names)} |" in text
