"""The harness counts, judges and stops as it says; rows can be repeated; anybody can join."""

import numpy as np
import pytest

import qlearn
from benchmarks.contest import problems
from benchmarks.contest import run as contest
from benchmarks.contest.harness import as_seed, play
from benchmarks.contest.methods import METHODS
from benchmarks.contest.small_mdp import SmallMDP
from tests.rival_cases import TRIED

ONE, TWO = {"promising": 1, "others": 1}, {"promising": 2, "others": 2}
CELL = {"problem": "career", "tutor": "flips", "seed": 5, "questions": 6}


class Stubborn:
    """A method that asks one thing twice, never learns, and then says that it is done."""

    def start(self, mdp, told, seed):
        self._policy = SmallMDP(mdp).best(np.ones(mdp.k - 1))[0]
        self._asked, self.heard = 0, []
        self._pair = np.eye(mdp.k)[1], np.eye(mdp.k)[0]

    def question(self):
        self._asked += 1
        return self._pair if self._asked < 3 else None

    def tell(self, verdict):
        self.heard.append(verdict)

    def policy(self):
        return self._policy


def test_a_method_of_ones_own_takes_four_functions():
    mdp = problems.problem("rover", 1)
    values, method = problems.scale(mdp.k, 1), Stubborn()
    tutor = problems.tutor("truthful", values, 1)
    row = play(method, mdp, values, tutor, problems.TUTORS["truthful"], 5, 0)
    assert (row["asked"], row["done"], row["wrong"]) == (2, 2, 0)
    assert method.heard == [1, 1]
    lost = qlearn.policy_loss(mdp, qlearn.equal_gaps_policy(mdp), values)
    assert row["worst"] == pytest.approx([lost.max()] * 6, abs=1e-7)
    assert row["initial"] == pytest.approx([mdp.initial @ lost] * 6, abs=1e-7)


def test_wrong_answers_are_counted():
    mdp = problems.problem("rover", 1)
    values, wrong = problems.scale(mdp.k, 1), 0
    for seed in range(20):
        tutor = problems.tutor("flips", values, seed)
        row = play(Stubborn(), mdp, values, tutor, problems.TUTORS["flips"], 5, 0)
        wrong += row["wrong"]
    assert 0 < wrong < 15


@pytest.mark.parametrize("name", TRIED)
def test_a_run_can_be_repeated(name):
    tutor = METHODS[name].only or "flips"
    cell = CELL | {"method": name, "tutor": tutor}
    first, second = contest.flat(cell, contest.run(cell)), contest.flat(cell, contest.run(cell))
    first.pop("seconds")
    second.pop("seconds")
    assert first == second


def test_all_methods_meet_the_same_problems_scales_and_tutors():
    cells = list(contest.cells(["rover"], {"truthful": TWO, "flips": ONE}, 7, 5))
    assert {cell["seed"] for cell in cells if cell["tutor"] == "truthful"} == {7, 8}
    for method, entry in METHODS.items():
        mine = [cell for cell in cells if cell["method"] == method]
        assert len(mine) == (2 if entry.only else 3) or entry.runs


def test_the_seed_of_a_method_is_not_that_of_its_problem():
    assert as_seed({"seed": 1}) not in (1, as_seed({"seed": 2}))


@pytest.mark.parametrize("part", ["held_out", "confirmation"])
def test_held_out_seeds_are_not_those_of_development(part):
    plan = problems.plan()
    assert set(plan[part]["problems"]) == set(problems.PROBLEMS)
    assert plan[part]["first_seed"] > plan["development"]["first_seed"] + 1000
    assert set(plan[part]["runs"]) == set(problems.TUTORS)
    for counts in plan[part]["runs"].values():
        assert counts["promising"] >= counts["others"] >= 4  # every kind of scale


def test_the_seeds_of_the_confirmation_are_not_those_of_the_main_runs():
    plan = problems.plan()
    most = max(max(counts.values()) for counts in plan["held_out"]["runs"].values())
    assert plan["held_out"]["first_seed"] + most <= plan["confirmation"]["first_seed"]


def test_a_slow_method_plays_fewer_runs_with_every_kind_of_scale():
    plan = problems.plan()["confirmation"]
    for method, entry in METHODS.items():
        mine = [cell for cell in contest.planned("confirmation") if cell["method"] == method]
        if entry.runs:
            assert len(mine) == entry.runs * len(plan["slow_problems"]) * len(problems.TUTORS)
            assert {cell["seed"] % 4 for cell in mine} == {0, 1, 2, 3}


def test_a_method_that_promises_nothing_may_have_fewer_runs():
    runs = {"flips": {"promising": 3, "others": 1}}
    cells = list(contest.cells(["rover"], runs, 7, 5))
    counts = {name: sum(cell["method"] == name for cell in cells) for name in METHODS}
    assert counts["ours: posterior"] == 3
    assert counts["random pairs"] == 1
