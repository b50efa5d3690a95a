"""First steps of users, each small: README's example, an ICU-Sepsis session, every learner.

Each learner runs with every comparator."""

import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import event

import elicit
import qlearn
from elicit._support import jit

LEARNERS: dict[str, tuple[Any, dict[str, Any]]] = {
    "policy iteration": (qlearn.InteractivePolicyIteration, {}),
    "policy iteration, bags": (qlearn.InteractivePolicyIteration, {"bags": elicit.Bags(days=10)}),
    "value iteration": (qlearn.InteractiveValueIteration, {"tolerance": 0.1}),
    "late value iteration": (qlearn.LateValueIteration, {"tolerance": 0.1}),
    "Q-learning": (qlearn.InteractiveQLearning, {"steps": 1000}),
    "late Q-learning": (qlearn.LateQLearning, {"steps": 1000}),
}


class Compiled(event.Listener):  # type: ignore[misc, unused-ignore]  # numba is untyped in some versions
    """The names of our functions that were compiled in this process, not read from the disk."""

    def __init__(self) -> None:
        self.names: list[str] = []
        event.register("numba:compile", self)

    def on_start(self, event: Any) -> None:
        function = event.data["dispatcher"].py_func
        if function in jit._OURS:
            self.names.append(f"{function.__module__}.{function.__name__}")

    def on_end(self, event: Any) -> None:
        pass


def comparators(k: int) -> dict[str, Any]:
    return {
        "polytope": elicit.PolytopeComparator(k),
        "polytope with a prior": elicit.PolytopeComparator(k, prior=["e3 >= 1.5*e2"]),
        "posterior": elicit.PosteriorComparator(k, particles=50, seed=0),
        "ensemble": elicit.BradleyTerryComparator(k, n_boot=20, region="ensemble"),
        "box": elicit.BradleyTerryComparator(k, n_boot=20, region="box"),
        "dominance": elicit.Dominance(k),
        "always": elicit.AlwaysAsk(k),
    }


def readme() -> None:
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec("".join(blocks), {})


def icu() -> None:
    if find_spec("icu_sepsis") is not None:
        mdp = qlearn.icu_sepsis()
        values = qlearn.draw_values(mdp.k, rng=0)
        for comparator in (
            elicit.PolytopeComparator(mdp.k),
            elicit.PosteriorComparator(mdp.k, seed=0),
        ):
            learner = qlearn.InteractivePolicyIteration(
                mdp, comparator, tolerance=0.05, max_queries=5
            )
            assert qlearn.drive(learner, elicit.TruthfulTutor(values)).loss_bound <= 1
        sweeps = qlearn.InteractiveValueIteration(
            mdp, elicit.PolytopeComparator(mdp.k), max_sweeps=2, max_queries=5
        )
        assert qlearn.drive(sweeps, elicit.TruthfulTutor(values)).compared


def choices() -> None:
    rows = np.random.default_rng(0).dirichlet(np.ones(5), size=20)
    for tutor in (elicit.TruthfulTutor(range(5)), elicit.BradleyTerryTutor(range(5), 5.0, 0)):
        for name, comparator in comparators(5).items():
            knows, choice = comparator, elicit.choose(rows, comparator, max_queries=10)
            while queries := choice.ask():
                choice.tell([tutor(query) for query in queries])
            knows = choice.result().comparator
            assert (
                knows.compare(rows[:5] - rows[5:10]).shape
                == knows.bounds(rows[:5] - rows[5:10])[0].shape
            )
            if "polytope" in name:
                assert str(knows.explain(rows[0] - rows[1]))


def sessions() -> None:
    mdp, values = qlearn.random_mdp(8, 3, 5, rng=0)
    for learner, settings in LEARNERS.values():
        for name, comparator in comparators(5).items():
            exact = "polytope" in name or name in ("dominance", "always")
            tutor = elicit.TruthfulTutor(values) if exact else elicit.FlippingTutor(values, 0.1, 0)
            for more in ({}, {"audit": 0.5, "batch": 3}):
                made = learner(mdp, comparator, max_queries=20, **settings, **more)
                result = qlearn.drive(made, tutor, on_conflict="drop")
                assert result.q.shape == (8, 3, 5)
                assert result.loss_bound >= 0
    assert (qlearn.policy_loss(mdp, result.policy, values) >= 0).all()
    log = elicit.AnswerLog(k=5)
    qlearn.drive(
        qlearn.InteractivePolicyIteration(mdp, elicit.PolytopeComparator(5)), tutor, log=log
    )
    again = qlearn.InteractivePolicyIteration(
        mdp, elicit.PosteriorComparator(5), known=log, max_queries=1
    )
    assert qlearn.drive(again, tutor).asked <= 1


def report() -> Iterator[str]:
    """Yield the name of each case, and the functions that it had compiled, all in this process."""
    compiled = Compiled()
    for part in (readme, icu, choices, sessions):
        part()
        yield f"after {part.__name__}: {sorted(set(compiled.names))}"
