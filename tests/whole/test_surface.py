"""The public surface: few parameters each, and names that mean one thing."""

import inspect
import pkgutil
from collections.abc import Iterator
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any

import pytest

import elicit
import qlearn

MOST = 9  # parameters of one function or class; a common set, such as **asking, counts as one


def public() -> Iterator[tuple[str, Any]]:
    """Every function and class of the two packages without an underscore, and their methods."""
    for package in (elicit, qlearn):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if found.name.endswith("__main__"):
                continue
            try:
                module = import_module(found.name)
            except ModuleNotFoundError:  # an extra that is not installed
                continue
            for name, thing in vars(module).items():
                own = getattr(thing, "__module__", None) == found.name
                if name.startswith("_") or not own or not callable(thing):
                    continue
                yield f"{found.name}.{name}", thing
                for part, method in vars(thing).items() if isinstance(thing, type) else ():
                    method = getattr(method, "__func__", method)
                    if not part.startswith("_") and callable(method):
                        yield f"{found.name}.{name}.{part}", method


def is_record(thing: Any) -> bool:
    """Whether a thing is a dataclass or a named tuple: its parameters are the data it holds."""
    return is_dataclass(thing) or hasattr(thing, "_fields")


def test_no_function_and_no_class_has_more_parameters_than_one_can_keep_in_mind():
    checked, too_many = 0, {}
    for name, thing in public():
        if is_record(thing):
            continue
        try:
            parameters = inspect.signature(thing).parameters
        except (TypeError, ValueError):  # of a base class written in C
            continue
        checked += 1
        count = len(parameters.keys() - {"self", "cls"})
        if count > MOST:
            too_many[name] = count
    assert checked > 500
    assert not too_many


def test_every_option_of_asking_is_a_keyword_of_every_learner():
    takers = [getattr(qlearn, name) for name in qlearn.__all__ if name.startswith("Interactive")]
    assert len(takers) == 4
    for taker in takers:
        last = list(inspect.signature(taker).parameters.values())[-1]
        assert last.kind is last.VAR_KEYWORD
        assert "AskingOptions" in str(last.annotation)


@pytest.mark.parametrize("name", ["max_querys", "tolerence"])
def test_a_learner_made_with_a_misspelt_keyword_says_which_was_meant(name):
    mdp, _ = qlearn.random_mdp(3, 2, 3, seed=0)
    meant = {"max_querys": "max_queries", "tolerence": "tolerance"}[name]
    with pytest.raises(TypeError, match=f"no keyword '{name}'. The nearest is '{meant}'"):
        qlearn.InteractivePolicyIteration(mdp, elicit.PolytopeComparator(3), **{name: 1})
