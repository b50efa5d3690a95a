"""Others' rules for the next question: each prefers what its source says, and the page says first
who asks fewer.
"""

import json

import numpy as np
import pytest

from benchmarks.asking import question_counts as questions
from benchmarks.asking import question_rules as bench
from benchmarks.asking import rival_rules as rules
from elicit.lp.hit_and_run import Draws
from qlearn.learners.query_strategies import Candidates

D = np.array(
    [[0.0, 1.0, -1.0], [1.0, -1.0, 0.0], [0.5, -1.0, 0.5]]
)  # tail sums (0, -1), (-1, 0), (-.5, .5)


class Drawn:
    """A comparator of three levels that is only its draws; their tutor never errs, or by a logistic
    law.
    """

    k = 3
    values = np.array([0.0, 0.5, 1.0])

    def __init__(self, first_gaps, weights, precision=np.inf):
        gaps = np.array([first_gaps, 1 - np.array(first_gaps)])
        self.draws = Draws(gaps, np.array(weights), np.full(len(weights), precision))


def candidates(first_gaps, weights, precision=np.inf, d=D):
    n = len(d)
    return Candidates(d, np.arange(n), np.zeros(n, int), 0.0, Drawn(first_gaps, weights, precision))


def test_volume_removal_takes_the_evenest_answer_also_of_a_tutor_who_errs():
    some = candidates([0.2, 0.3, 0.6, 0.9], [0.25] * 4)
    np.testing.assert_allclose(rules.volume_removal(some), [0, 0, 0.5])
    erring = candidates([0.2, 0.3, 0.6, 0.9], [0.25] * 4, precision=1.0)
    score = rules.volume_removal(erring)
    assert 0 < score[1] < score[2] < 0.5


def test_the_greatest_regret_needs_scales_that_disagree_and_leaves_out_those_without_weight():
    np.testing.assert_allclose(
        rules.greatest_regret(candidates([0.2, 0.9], [0.5, 0.5])), [0, 0, 0.3 + 0.4]
    )
    some = candidates([0.2, 0.4, 0.9], [0.5, 0.499, 0.001])
    np.testing.assert_allclose(rules.greatest_regret(some), [0, 0, 0])


def test_the_polyhedral_question_cuts_the_longest_axis_through_its_middle():
    score = rules.polyhedral(candidates([0.3, 0.4, 0.6, 0.7], [0.25] * 4))
    assert np.argmax(score) == 2
    assert score[2] == pytest.approx(1.0)  # through the very middle, across the only axis
    off_centre = rules.polyhedral(candidates([0.6, 0.7, 0.9, 1.0], [0.25] * 4))
    assert off_centre[2] < 0  # both ends of the axis on one side


@pytest.mark.parametrize("method", list(bench.RULES.values()))
def test_every_rule_asks_until_the_certificate_stands(method, monkeypatch):
    monkeypatch.setattr(
        questions, "problem", lambda _, seed: questions.random_mdp(10, 3, 4, discount=0.8, rng=seed)
    )
    cell = {
        "environment": "",
        "method": method,
        "error": 0.0,
        "comparator": "polytope",
        "bounds": False,
        "seed": 1,
    }
    row = questions.run(cell)
    assert row["status"] in ("BOUNDED", "CONVERGED")
    assert row["end"] <= questions.TOLERANCE
    assert json.loads(json.dumps(row))["asked"] == row["asked"]


def test_the_page_says_who_asks_fewer_first():
    todo = bench.cells(["k = 5"], 3)
    assert len(todo) == len(bench.TUTORS) * len(bench.RULES) * 3
    n = len(questions.GRID)

    def row(cell, fewer):
        less = (
            5
            if fewer
            and cell["method"] == "policy iteration, polyhedral"
            and cell["comparator"] == "polytope"
            else 0
        )
        return {"asked": 20 - less + cell["seed"] + (cell["method"] == "policy iteration, mutual information"),  # noqa: E501
                "loss": [0.01] * n}  # fmt: skip

    def page(fewer):
        return "\n".join(
            line
            for part in bench.report([(cell, row(cell, fewer)) for cell in todo])
            for line in part
        )

    won = page(True)
    assert (
        "Fewer questions than our default, beyond the interval: polyhedral (Toubia 2004) at k = 5, "
        "truthful, " in won
    )
    assert won.index("polyhedral (Toubia 2004) at") < won.index("## k = 5")
    assert "| 1 / 2 / 0 |" in won
    assert "| +1.0 ± 0.0 | 0 / 0 / 3 |" in won  # mutual information
    assert "In no table another rule asks fewer questions" in page(False)
