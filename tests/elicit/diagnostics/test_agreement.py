"""Disagreement of people whose scales are known: scales, dividing questions, and groups."""

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot as plt

from elicit import (
    Answer,
    AnswerLog,
    Answers,
    FlippingTutor,
    Panel,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    agreement,
    plot,
)
from tests.own_cases import Exact
from tests.thoroughness import scaled

matplotlib.use("Agg")
K = 4
LABELS = ("died", "severe", "mild", "well")
ONE_SCHOOL = {"ann": [0, 1, 2, 10], "ben": [0, 1.1, 2.2, 10]}
OTHER = {"chen": [0, 7, 9, 10], "dora": [0, 7.5, 9, 10]}


def exact(scales):
    return Panel({name: Exact(values) for name, values in scales.items()})


def answers_of(scales, n=60, errors=0.05):
    parts = []
    for i, (name, values) in enumerate(scales.items()):
        rng = np.random.default_rng(i)
        d = rng.dirichlet(np.ones(K), n) - rng.dirichlet(np.ones(K), n)
        y = FlippingTutor(values, errors, seed=i).signs(d)
        parts.append(Answers(d, y, [f"{name} {j}" for j in range(n)], [name] * n))
    return sum(parts[1:], parts[0])


def test_two_schools_are_found_and_the_questions_that_divide_them():
    found = agreement(exact({**ONE_SCHOOL, **OTHER}), LABELS)
    assert found.groups == (("ann", "ben"), ("chen", "dora"))
    np.testing.assert_allclose(found.values, found.low)
    np.testing.assert_allclose(found.values[2], [0, 0.7, 0.9, 1])
    first = found.questions[0]
    for name, values in {**ONE_SCHOOL, **OTHER}.items():
        better = (first.left - first.right) @ np.array(values) > 0
        assert first.prefers_left[name] == better
    assert first.disagreement == pytest.approx(2 * 2 * 2 / 12)  # ordered pairs that differ
    asked = [
        sum(((q.left - q.right) @ np.array(v)) > 0 for v in ({**ONE_SCHOOL, **OTHER}).values())
        for q in found.questions
    ]
    assert asked == [2, 2]
    text = str(found)
    assert "2 groups: ann, ben; chen, dora" in text
    assert "for sure, or" in text
    assert all(name in text for name in (*LABELS, "ann", "dora"))


def test_people_who_think_alike_are_one_group_and_say_so():
    found = agreement(exact(ONE_SCHOOL), LABELS)
    assert found.groups == (("ann", "ben"),)
    assert "no groups of people who think differently" in str(found)


def test_without_answers_nothing_is_known_to_differ():
    panel = Panel({name: PosteriorComparator(K, seed=i) for i, name in enumerate("abcde")})
    found = agreement(panel)
    assert found.groups == (tuple("abcde"),)
    assert (found.known_to_differ == 0).all()
    assert found.labels[0] == "level 1"


def test_answers_and_logs_come_to_the_same_as_a_panel(tmp_path):
    answers = answers_of({**ONE_SCHOOL, **OTHER}, scaled(30, 60))
    found = agreement(answers, LABELS)
    assert found.groups == (("ann", "ben"), ("chen", "dora"))
    panel = Panel({name: PosteriorComparator(K, seed=0) for name in found.people})
    same = agreement(panel.update(answers), LABELS)
    assert (same.values == found.values).all()
    logs = []
    for name in found.people:
        logs.append(AnswerLog(tmp_path / name, who=name))
        for d, y, id in answers.of_person(name):
            logs[-1].append(Answer(Query(id, np.maximum(d, 0), np.maximum(-d, 0)), y))
    again = agreement(logs, LABELS)
    np.testing.assert_allclose(again.values, found.values, atol=0.02)
    assert again.groups == found.groups
    by_name = agreement(dict(zip("wxyz", logs, strict=True)), LABELS, make=another_seed)
    assert by_name.people == tuple("wxyz")
    with pytest.raises(ValueError, match="two logs are of 'ann'"):
        agreement([logs[0], logs[0]])
    for log in logs:
        log.close()


def another_seed(k):
    return PosteriorComparator(k, seed=1)


def test_the_intervals_are_those_of_the_members():
    panel = Panel({"ann": PolytopeComparator(K), "ben": PolytopeComparator(K)})
    panel = panel.update(Answers([[-0.5, 1, 0, -0.5]], [1], who=["ann"]))
    found = agreement(panel)
    np.testing.assert_allclose(found.low[0, 1], 0.5, atol=1e-9)  # level 2 is worth half or more
    np.testing.assert_allclose(found.low[1, 1], 0, atol=1e-5)


def test_one_person_agrees_with_themselves():
    found = agreement(exact({"ann": [0, 1, 2, 10]}))
    assert (found.groups, found.questions) == ((("ann",),), ())
    assert "too few" in str(found)


@pytest.mark.parametrize(
    ("people", "kind", "says"),
    [
        (Answers([[0, 1, -1.0]], [1]), ValueError, "say who gave them"),
        (Answers.none(3), ValueError, "say who gave them"),
        ([AnswerLog(k=3)], ValueError, "does not say whose its answers are"),
        ([], ValueError, "at least one person"),
        (3, TypeError, "takes an elicit.Panel"),
    ],
)
def test_what_names_nobody_is_refused(people, kind, says):
    with pytest.raises(kind, match=says):
        agreement(people)


def test_the_picture_has_an_interval_of_each_level_for_each_person():
    found = agreement(exact({**ONE_SCHOOL, **OTHER}), LABELS)
    ax = plot.agreement(found)
    assert [label.get_text() for label in ax.get_yticklabels()] == list(LABELS)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == ["ann (group 1)", "ben (group 1)", "chen (group 2)", "dora (group 2)"]
    drawn = [line.get_xdata() for line in ax.get_lines() if len(line.get_xdata()) == K]
    for name, shown in zip(found.people, drawn, strict=True):
        assert (shown == found.values[found.people.index(name)]).all()
    handles = ax.get_legend().legend_handles
    assert len({(line.get_color(), line.get_marker()) for line in handles}) == len(names)
    lines = [line.get_linestyle() for line in handles]
    assert lines[0] == lines[1] != lines[2] == lines[3]
    plt.close("all")


def test_a_merged_log_is_not_one_person():
    merged = answers_of({**ONE_SCHOOL}, n=3)
    log = AnswerLog(k=K)
    for i, who in enumerate(["ann", "ben"]):
        log.append(Answer(Query(f"{i}", [0, 1, 0, 0], [0.5, 0, 0, 0.5]), 1, who=who))
    for people in ({"all": merged}, {"all": log}):
        with pytest.raises(ValueError, match="'all' are of several people, 'ann', 'ben'"):
            agreement(people)
    with pytest.raises(TypeError, match="takes an AnswerLog or Answers of 'ann', not 3"):
        agreement({"ann": 3})
    own = {name: merged.of_person(name) for name in ONE_SCHOOL}
    np.testing.assert_allclose(agreement(own).values, agreement(merged).values)
