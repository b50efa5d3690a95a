"""Results of learners and comparators, as hashes to the last bit.

Their sizes are such that BLAS would share the work out."""

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

import elicit
import qlearn
from elicit import simultaneous_bounds
from tests.compile_cases import LEARNERS


def comparators(k: int) -> dict[str, Any]:
    return {
        "polytope": elicit.PolytopeComparator(k),
        "posterior": elicit.PosteriorComparator(k, seed=1),
        "ensemble": elicit.BradleyTerryComparator(k, seed=1, region="ensemble"),
    }


def digest(*parts: Any) -> str:
    return hashlib.blake2b(
        b"".join(np.asarray(part).tobytes() for part in parts), digest_size=8
    ).hexdigest()


def learned(learners: Sequence[str]) -> Iterator[str]:
    """One line for each of these learners and each comparator: questions asked, and a hash of what
    came out.
    """
    large = mdp, values = qlearn.random_mdp(100, 5, 10, rng=3)
    small = qlearn.random_mdp(20, 3, 10, rng=3)  # value iteration compares thousands of pairs
    for name in learners:
        learner, settings = LEARNERS[name]
        for of, comparator in comparators(10).items():
            problem, hidden = small if "value iteration" in name else large
            tutor = (
                elicit.TruthfulTutor(hidden)
                if of == "polytope"
                else elicit.FlippingTutor(hidden, 0.1, 1)
            )
            result = qlearn.drive(learner(problem, comparator, max_queries=12, **settings), tutor)
            known = result.answers
            found = digest(
                known.d,
                known.y,
                result.policy,
                result.q,
                result.loss_bound,
                result.comparator.values,
            )
            yield f"{name}, {of}: {result.asked} {found}"
    policy = qlearn.value_iteration(mdp, values)[1]
    yield (
        "planning "
        f"{digest(qlearn.evaluate_policy(mdp, policy), qlearn.policy_loss(mdp, 0 * policy, values))}"  # noqa: E501
    )


def compared() -> Iterator[str]:
    """One line a comparator and what it says after sixty answers, some of them wrong."""
    rng, k = np.random.default_rng(0), 12
    d = np.subtract(*rng.dirichlet(np.ones(k), size=(2, 60)))
    truth = elicit.TruthfulTutor(np.arange(k)).signs(d)
    y = elicit.FlippingTutor(np.arange(k), 0.1, 1).signs(d)
    asked = np.subtract(*rng.dirichlet(np.ones(k), size=(2, 400)))
    for name, comparator in comparators(k).items():
        knows = comparator.update(elicit.Answers(d, truth if name == "polytope" else y))
        says = {
            "values": digest(knows.values),
            "verdicts": digest(knows.compare(asked)),
            "bounds": digest(*knows.bounds(asked[:20]), simultaneous_bounds(knows, asked)[0]),
            "draws": digest(*knows.draws),
        }
        yield f"{name} {says}"


def report(learners: Sequence[str]) -> list[str]:
    return [*learned(learners), *compared()]
