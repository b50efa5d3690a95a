"""Settings: what cannot be is said with the setting's name, from Python as on the command line."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from qlearn.experiments.ablation import ablate
from qlearn.experiments.settings import AblationSettings, FiguresSettings, Settings
from qlearn.paper.figure_runs import figures


@pytest.mark.parametrize(
    ("settings", "value", "wanted"),
    [
        ("seeds", 0, "seeds must be a whole number of at least 1, not 0"),
        ("seeds", True, "seeds must be .* not True"),
        ("steps", 2.5, "steps must be a whole number of at least 1, not 2.5"),
        ("steps", None, "steps must be a whole number of at least 1, not None"),
        ("max_queries", -1, "max_queries must be a whole number of at least 0, not -1"),
        ("levels", 101, "levels must be a whole number from 2 to 100, not 101"),
        ("particles", 19, "particles must be a whole number of at least 20, not 19"),
        (
            "error_rates",
            (0.0, 0.5),
            "error_rates must each be a number of at least 0 and below 0.5, not 0.5",
        ),
        ("error_rates", 0.1, "error_rates must be several values, not 0.1"),
        ("tolerance", 0, "tolerance must be a number strictly between 0 and 1, not 0"),
        ("tolerance", 5, "tolerance must be a number strictly between 0 and 1, not 5"),
        ("tolerance", math.nan, "tolerance must be a number strictly between 0 and 1, not nan"),
        ("tolerance", math.inf, "tolerance must be a number strictly between 0 and 1, not inf"),
        ("precision", 10**400, "precision must be a number of at least 0, not 1000"),
        ("refit_growth", "0", "refit_growth must be a number of at least 0, not '0'"),
        ("discount", 1.0, "discount must be a number of at least 0 and below 1, not 1.0"),
        ("level", 0.0, "level must be a number strictly between 0 and 1, not 0.0"),
        ("audit", 1.1, "audit must be a number from 0 to 1, not 1.1"),
        ("noise", "loud", "noise must be one of flip, logistic, not 'loud'"),
        ("comparators", ["box", "sphere"], "comparators must each be one of always, polytope, "),
        ("comparators", "box", "comparators must be several values, not 'box'"),
        (
            "problems",
            [["icu"]],
            r"problems must each be one of random, icu-sepsis, frozen-lake, .*, not \['icu'\]",
        ),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(settings: str, value: Any, wanted: str) -> None:
    with pytest.raises(ValueError, match=wanted):
        AblationSettings(**{settings: value})


@pytest.mark.parametrize(
    ("setting", "value", "wanted"),
    [
        (
            "comparators",
            ["always"],
            "comparators must each be one of polytope, posterior, box-rescaled, box, not 'alw",
        ),
        ("levels", 10, "levels must be several values, not 10"),
        (
            "tutors",
            ["3%"],
            "tutors must each be one of truthful, c=1, 2%, 5%, 10%, 20%, 30%, not '3%'",
        ),
        (
            "thinned",
            ["ensemble"],
            "thinned must each be one of polytope, posterior, box-rescaled, box, not 'ensemble'",
        ),
    ],
)
def test_the_figures_have_checks_and_defaults_of_their_own(
    setting: str, value: Any, wanted: str
) -> None:
    with pytest.raises(ValueError, match=wanted):
        FiguresSettings(**{setting: value})
    usual = FiguresSettings()
    assert (usual.noise, usual.max_queries, usual.refit_growth) == ("logistic", None, 0.2)


@pytest.mark.parametrize("command", [ablate, figures])
def test_settings_by_keyword_are_checked_before_the_runs(command: Callable[..., Any]) -> None:
    with pytest.raises(TypeError, match=r"has no keyword 'stepz'. The nearest is 'steps'"):
        command(stepz=3)
    with pytest.raises(ValueError, match="seeds must be a whole number of at least 1, not 0"):
        command(seeds=0)


def test_the_ends_of_what_may_be_are_taken() -> None:
    AblationSettings(
        seeds=1,
        max_queries=None,
        levels=2,
        particles=20,
        error_rates=(),
        discount=0.0,
        audit=1,
        lapse=0,
    )
    AblationSettings(
        max_queries=0, levels=100, exploration=None, precision=0, audit=0, error_rates=[0, 0.499]
    )


def test_equal_values_are_equal_settings_whatever_their_kind() -> None:
    given = {
        "steps": np.int64(100_000),
        "epsilon": 1,
        "error_rates": np.array([0.0, 0.05, 0.15]),
        "seeds": 4,
    }
    settings = AblationSettings(**given)
    assert settings == AblationSettings()
    assert [type(x) for x in (settings.steps, settings.epsilon, settings.error_rates)] == [
        int,
        float,
        tuple,
    ]
    assert AblationSettings(seeds=9, states=7).of_a_run() == Settings()
