"""The options of asking are one set, for everything that asks a tutor."""

import inspect
from typing import Any

import pytest

import qlearn
from elicit import AskingOptions, PolytopeComparator
from elicit.asking.elicitation import Elicitation
from elicit.asking.options import filled

K = 4
OPTIONS: AskingOptions = {
    "max_queries": 7,
    "indifference": 0.01,
    "audit": 0.5,
    "max_audits": 3,
    "batch": 2,
    "known": (),
    "seed": 5,
    "labels": ["bad", "poor", "fair", "good"],
}
MDP = qlearn.random_mdp(6, 2, K, seed=0)[0]
ASKERS: dict[str, Any] = {
    "Elicitation": lambda **options: Elicitation(PolytopeComparator(K), "a run", **options),
    "InteractivePolicyIteration": lambda **options: qlearn.InteractivePolicyIteration(
        MDP, PolytopeComparator(K), **options
    ),
    "InteractiveValueIteration": lambda **options: qlearn.InteractiveValueIteration(
        MDP, PolytopeComparator(K), **options
    ),
    "LateValueIteration": lambda **options: qlearn.LateValueIteration(
        MDP, PolytopeComparator(K), **options
    ),
    "InteractiveQLearning": lambda **options: qlearn.InteractiveQLearning(
        MDP, PolytopeComparator(K), steps=20, **options
    ),
    "LateQLearning": lambda **options: qlearn.LateQLearning(
        MDP, PolytopeComparator(K), steps=20, **options
    ),
    "InteractiveTraining": lambda **options: qlearn.InteractiveTraining(
        PolytopeComparator(K), discount=0.5, **options
    ),
}
each = pytest.mark.parametrize("name", ASKERS)


def test_the_options_given_here_are_all_that_there_are() -> None:
    assert OPTIONS.keys() == AskingOptions.__annotations__.keys()


@each
def test_every_asker_takes_every_option_and_hands_it_on(name: str) -> None:
    asker = ASKERS[name](**OPTIONS)
    asks = asker if name == "Elicitation" else asker._elicitation
    assert asks.batch == 2
    assert asks.indifference == 0.01
    assert asks.audits_left == 3
    assert asks.asking_state().audit == 0.5
    queries = asker.ask()
    assert all(query.labels == ("bad", "poor", "fair", "good") for query in queries)
    assert name == "Elicitation" or asker.seed == 5


@each
def test_a_misspelt_option_is_refused_with_the_nearest_name(name: str) -> None:
    message = f"{name} has no keyword 'max_query'. The nearest is 'max_queries'"
    with pytest.raises(TypeError, match=message):
        ASKERS[name](max_query=3)


@each
@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("audit", None, "audit, the share of decided pairs to ask about, must be in 0..1"),
        ("batch", 0, "batch must be a whole number of at least 1, not 0"),
        ("max_queries", -1, "max_queries must be None or a whole number from 0 on, not -1"),
        ("indifference", "x", "indifference must be a number of at least 0, not 'x'"),
        ("labels", ["one"], "labels must be .*4 names, one a level"),
    ],
)
def test_a_senseless_option_is_refused(name: str, option: str, value: Any, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ASKERS[name](**{option: value})


def test_defaults_stand_in_for_what_is_left_out_or_none() -> None:
    defaults: AskingOptions = {"indifference": 0.5, "batch": 9}
    assert filled({"batch": 2, "indifference": None}, defaults) == {"batch": 2, "indifference": 0.5}
    assert filled({"audit": 0.1}, defaults) == {"audit": 0.1, **defaults}


@pytest.mark.parametrize("name", [name for name in ASKERS if name != "Elicitation"])
def test_an_option_is_documented_once(name: str) -> None:
    """It is documented in the common set, and not as a parameter of anything that takes the set."""
    sections = inspect.getdoc(getattr(qlearn, name)) or ""
    for option in AskingOptions.__annotations__:
        assert f"\n{option} :" not in sections
        assert f"{option} : " in (AskingOptions.__doc__ or "")
