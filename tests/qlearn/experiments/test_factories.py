"""Parts that a user brings, by a name and a factory: found, checked, and their faults named."""

import re
from pathlib import Path
from typing import Any

import pytest

from qlearn.experiments.ablation import ablate, plan_of
from qlearn.experiments.own_parts import Own, own_of
from qlearn.experiments.settings import AblationSettings
from tests.own_cases import exact, tiny
from tests.sweep_cases import TINY


def test_a_text_names_a_factory_and_perhaps_what_to_call_it() -> None:
    plain, named = own_of("tests.own_cases:exact"), own_of("mine=tests.own_cases:exact")
    assert (plain.name, plain.factory) == ("tests.own_cases:exact", exact)
    assert (named.name, named.factory) == ("mine", exact)
    assert own_of("tests.own_cases:Exact.update").factory is not None
    assert plain == own_of("tests.own_cases:exact") != named
    assert len({plain, own_of("tests.own_cases:exact")}) == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "nowhere:f",
            "'nowhere:f': there is no module 'nowhere' in the current directory or installed",
        ),
        ("tests.nowhere.at:f", "there is no module 'tests.nowhere'"),
        ("tests.own_cases:missing", "module tests.own_cases has no 'missing'"),
        ("tests.own_cases:exact.missing", "module tests.own_cases has no 'exact.missing'"),
        ("tests.own_cases:NUMBER", "'tests.own_cases:NUMBER' is no factory: 5 cannot be called"),
        ("needy:f", "importing needy needs 'not_there', which is not installed"),
        ("failing:f", "importing failing raised ZeroDivisionError: division by zero"),
        (":f", "':f' is not of the form package.module:factory"),
        ("a=b:", "'b:' is not of the form package.module:factory"),
    ],
)
def test_what_is_wrong_with_a_text_is_said(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "needy.py").write_text("import not_there")
    (tmp_path / "failing.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=re.escape(said)):
        own_of(text)
    with pytest.raises(ValueError, match=rf"^comparators: .*{re.escape(said)}"):
        AblationSettings(comparators=[text])


def test_a_mapping_names_ours_by_themselves_and_yours_by_their_factories() -> None:
    given = {"mine": exact, "polytope": "polytope", "always": ..., "other": "tests.own_cases:exact"}
    settings = AblationSettings(
        comparators=given, problems={"box": tiny, "icu-sepsis": "icu-sepsis"}
    )
    assert settings.names("comparators") == ("mine", "polytope", "always", "other")
    assert settings.own()["comparator"] == {
        "mine": Own("mine", exact),
        "other": Own("other", exact),
    }
    assert settings.names("problems") == ("box", "icu-sepsis")
    assert settings == AblationSettings(
        comparators=given, problems={"box": tiny, "icu-sepsis": ...}
    )
    assert settings != AblationSettings(
        comparators=given | {"mine": tiny}, problems={"box": tiny, "icu-sepsis": ...}
    )
    assert settings.of_a_run() == AblationSettings().of_a_run()


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (
            {"comparators": {"mine": "polytope"}},
            "comparators must each be one of always, .*, not 'mine': 'polytope'",
        ),
        ({"comparators": {"mine": 3}}, r"\(k, seed\) returns a Comparator, not 'mine': 3"),
        ({"comparators": [exact]}, r"or of a mapping \{name: factory\}.*, not <function exact"),
        ({"comparators": {1: exact}}, "not 1: <function exact"),
        ({"problems": {"": tiny}}, "not '': <function tiny"),
        (
            {"tutors": ["flip"]},
            'tutors must each be one of person, or "package.module:factory", or of a mapping .*, '
            "not 'flip'",
        ),
        (
            {"comparators": {"always": exact}},
            "comparators: 'always' already means something: name your own otherwise",
        ),
        (
            {"comparators": ["a=tests.own_cases:exact", "a=tests.own_cases:two"]},
            "'a' already means something",
        ),
        ({"noise": {"flip": exact}}, "noise must be one of flip, logistic"),
    ],
)
def test_what_cannot_be_a_part_is_refused_by_its_setting(
    settings: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        AblationSettings(**settings)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (
            {"comparators": {"mine": lambda k, seed: 3}},
            "'mine': .* k = 4, seed = 0, returned no comparator: .* not 3",
        ),
        (
            {"comparators": ["tests.own_cases:two"]},
            "'tests.own_cases:two': .* of k = 2: it must be made for 4",
        ),
        (
            {"comparators": ["tests.own_cases:broken"]},
            r"factory, called with \(4, 0\), raised TypeError: broken.. takes 1 positional",
        ),
        (
            {"problems": ["x=tests.own_cases:three"]},
            r"'x': .* seed = 0, must return \(mdp, values\), .* not 3",
        ),
        (
            {"problems": {"x": lambda seed: (tiny(0)[0], [1, 0, 2, 3])}},
            "'x': .* returned values that are no scale: ",
        ),
        (
            {"problems": {"x": lambda seed: (tiny(0)[0], [0, 1])}},
            "'x': .* 2 values for an MDP of 4 levels",
        ),
        (
            {"tutors": ["x=tests.own_cases:three"]},
            "'x': .* must return a tutor, which takes a query, not 3",
        ),
        ({"learners": ["x=tests.own_cases:three"]}, "'x': .* must return a qlearn.Learner, not 3"),
    ],
)
def test_what_a_factory_returns_is_held_to_what_it_should_before_the_first_run(
    settings: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        ablate(**TINY | settings, jobs=1, progress=lambda done, total: pytest.fail("a run began"))


def test_yours_come_after_ours_in_the_order_given_and_are_not_audited() -> None:
    settings = AblationSettings(
        comparators={"z": exact, "a": exact, "posterior-close": exact, "polytope": ...},
        tutors={"nurse": lambda values, seed: None},
        learners={"mine": lambda mdp, comparator, seed: None, "value-iteration": ...},
        problems={"box": tiny, "random": ...},
        error_rates=(0.15, 0.0),
        seeds=1,
    )
    plan = plan_of(settings)
    assert list(dict.fromkeys(cell["problem"] for cell in plan)) == ["random", "box"]
    assert list(dict.fromkeys(cell["learner"] for cell in plan)) == ["value-iteration", "mine"]
    assert list(dict.fromkeys(cell["comparator"] for cell in plan if cell["learner"] == "value-iteration")) == [  # noqa: E501
        "always", "polytope", "posterior-close", "z", "a"
    ]  # fmt: skip
    of_z = [
        cell["error_rate"]
        for cell in plan
        if cell["comparator"] == "z" and cell["learner"] == "value-iteration"
    ]
    assert of_z == [0.0, 0.15, "nurse"] * 2
    assert {(cell["comparator"], cell["learner"]) for cell in plan if cell["audit"]} == {
        ("polytope", "value-iteration")
    }
    assert "always" not in {
        cell["comparator"] for cell in plan if cell["learner"] == "mine"
    }  # it has no oracle
