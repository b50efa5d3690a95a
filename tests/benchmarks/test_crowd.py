"""People as a panel: schools, what one policy loses each, and the row of each person."""

import numpy as np
import pytest

from benchmarks.people import crowd
from elicit import AnswerLog, Answers, FlippingTutor, Panel, PolytopeComparator, Query

OPPOSITE = np.array([[0.0, 0.1, 1.0], [0.0, 0.9, 1.0]])
SURE = np.array([[-0.5, 1.0, -0.5]])  # the middle for sure, or half the best and half the worst


def logs_of(n: int, questions: int) -> dict[str, AnswerLog]:
    """Return logs of n people of two schools, who were put the same questions in other orders."""
    rng, logs = np.random.default_rng(3), {}
    bags = rng.dirichlet([0.5, 0.5, 0.5], (questions, 2))
    for i in range(n):
        tutor = FlippingTutor(OPPOSITE[i % 2], 0.05, seed=i)
        log = AnswerLog(k=3, header={"labels": ("0", "10", "90")})
        for j in rng.permutation(questions):
            log.append(tutor(Query(f"question {j}", *bags[j])))
        logs[str(i)] = log
    return logs


def test_a_policy_loses_what_it_leaves():
    more = np.array([[0.4, -0.1], [-0.2, 0.3]])  # two pairs by two scales
    np.testing.assert_allclose(crowd.losses(np.array([1.0, 1.0]), more), [0.1, 0.05])
    np.testing.assert_allclose(crowd.losses(np.array([1.0, 0.0]), more), [0.0, 0.2])
    np.testing.assert_allclose(crowd.losses(np.array([0.5, 0.5]), more), [0.15, 0.1])
    for scale in OPPOSITE:
        best = crowd.takes_left(SURE, scale)
        assert crowd.losses(best, crowd.worth(SURE, np.diff(scale)[:, None])) == 0


def test_the_worst_off_of_two_who_want_opposite_things_lose_the_same():
    policy = crowd.for_the_worst_off(SURE, OPPOSITE)
    np.testing.assert_allclose(policy, [0.5])
    rng = np.random.default_rng(0)
    d = rng.dirichlet(np.ones(4), 4) - rng.dirichlet(np.ones(4), 4)
    scales = np.sort(np.c_[np.zeros(3), rng.random((3, 2)), np.ones(3)], axis=1)
    more = crowd.worth(d, np.diff(scales, axis=1).T)
    least = crowd.losses(crowd.for_the_worst_off(d, scales), more).max()
    for choice in np.ndindex(3, 3, 3, 3):  # left, right, or one of them at random
        assert crowd.losses(np.array(choice) / 2, more).max() >= least - 1e-9


def test_halves_are_parts_of_the_whole():
    answers = logs_of(1, 9)["0"].answers()
    one, two = crowd.halved(answers, 1)
    assert (len(one), len(two)) == (4, 5)
    assert sorted(one.ids + two.ids) == sorted(answers.ids)


def test_schools_are_those_at_the_widest_distance():
    members = {}
    for i in range(4):
        tutor = FlippingTutor(OPPOSITE[i % 2], 0.0, seed=0)
        asked = [
            tutor(Query(f"{share}", np.array([0.0, 1.0, 0.0]), np.array([1 - share, 0.0, share])))
            for share in (0.25, 0.5, 0.75)
        ]
        members[f"p{i}"] = PolytopeComparator(3).update(Answers.of(asked, 3))
    found = crowd.schools_in(Panel(members))
    assert found.groups == (("p0", "p2"), ("p1", "p3"))
    assert found.apart == 0.1
    assert [found.of(name) for name in members] == [0, 1, 0, 1]
    alone = crowd.schools_in(Panel({"a": members["p0"], "b": members["p2"]}))
    assert alone.groups == (("a", "b"),)


def test_each_person_has_a_row(tmp_path, monkeypatch, capsys):
    found = crowd.table(logs_of(4, 24))
    assert list(found.person) == [1, 2, 3, 4]
    assert list(found.school) == [1, 2, 1, 2]
    assert (found["value of 10"][found.school == 1] < 0.5).all()
    assert (found["value of 10"][found.school == 2] > 0.5).all()
    for whose in ("the mean", "school 1", "school 2", "the worst off"):
        assert (found[f"loss by {whose}"] <= found[f"at most by {whose}"] + 1e-9).all()
    for school in (1, 2):
        own = found[found.school == school]
        assert own[f"loss by school {school}"].max() < own[f"loss by school {3 - school}"].min()
    assert found.filter(like="alike by").min().min() >= 0
    assert found.filter(like="alike by").max().max() <= 1
    monkeypatch.setattr(crowd, "lottery_choices", lambda folder, levels: logs_of(3, 12))
    out = tmp_path / "crowd.csv"
    crowd.main([str(tmp_path), "--people", "2", "--out", str(out)])
    assert len(out.read_text(encoding="utf-8").splitlines()) == 3
    assert "loss by the mean" in capsys.readouterr().out


def test_without_the_tables_it_says_where_they_are(tmp_path):
    with pytest.raises(FileNotFoundError, match="vspinu/reference-point"):
        crowd.main([str(tmp_path)])
