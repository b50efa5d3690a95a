"""A panel is a comparator over the mean of its members' scales."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

import elicit
from elicit import (
    AlwaysAsk,
    Answers,
    Dominance,
    InconsistentAnswers,
    OpenOrderComparator,
    Panel,
    PolytopeComparator,
    PosteriorComparator,
    TruthfulTutor,
    decide,
)
from elicit.comparators.panel import _FORMS
from elicit.model.comparator_parts import OPTIONAL_PARTS
from elicit.model.pairs import same_pairs
from elicit.testing import check_comparator, sample_differences
from tests.own_cases import Exact
from tests.scale_arithmetic import tail_sums
from tests.thoroughness import examples

K = 4
VALUES = {"ann": np.array([0, 0.1, 0.4, 1.0]), "ben": np.array([0, 0.5, 0.9, 1.0])}


def told(panel, n=6, seed=0):
    """The panel after n answers of each member, who are truthful."""
    rng = np.random.default_rng(seed)
    for name in panel.people:
        d = rng.dirichlet(np.ones(panel.k), n) - rng.dirichlet(np.ones(panel.k), n)
        y = TruthfulTutor(VALUES.get(name, VALUES["ann"])).signs(d)
        panel = panel.update(Answers(d, y, [f"{name} {i}" for i in range(n)], [name] * n))
    return panel


def two(make=PolytopeComparator, weights=None):
    return Panel({name: make(K) for name in VALUES}, weights)


MEMBERS = {
    "polytope": PolytopeComparator,
    "posterior": lambda k: PosteriorComparator(k, seed=1),
    "dominance": Dominance,
    "exact": lambda k: Exact(VALUES["ann"]),
}


class ToldInTheName(Panel):
    """A panel whose answers, where they do not say who gave them, are the first member's."""

    def update(self, answers):
        who = [name or self.people[0] for name in answers.who]
        new = super().update(Answers(answers.d, answers.y, answers.ids, who))
        new.__class__ = ToldInTheName
        return new


@pytest.mark.parametrize("name", [*MEMBERS])
def test_it_conforms(name):
    check_comparator(ToldInTheName({"ann": MEMBERS[name](K), "ben": MEMBERS[name](K)}))
    check_comparator(Panel({"ann": MEMBERS[name](K)}))


def test_members_of_different_kinds_conform():
    members = {"ann": PolytopeComparator(K), "ben": PosteriorComparator(K, seed=0)}
    panel = ToldInTheName({**members, "cher": Dominance(K)}, [3, 1, 1])
    check_comparator(panel)
    assert not elicit.parts.offers(panel, "level"), "not all bounds depend on draws"
    _, confidence = panel.simultaneous_bounds(np.eye(K))
    assert confidence == pytest.approx(0.95)


def test_bounds_are_the_weighted_sums_and_a_verdict_is_the_sign_that_they_prove():
    panel = told(two(weights={"ben": 1, "ann": 3}))
    d = sample_differences(K)
    each = {name: member.bounds(d) for name, member in panel.members.items()}
    low, high = (0.75 * each["ann"][i] + 0.25 * each["ben"][i] for i in (0, 1))
    np.testing.assert_allclose(panel.bounds(d), (low, high), atol=1e-15)
    verdicts = panel.compare(d)
    assert (verdicts[low > 1e-8] == 1).all()
    assert (verdicts[high < -1e-8] == -1).all()
    assert (verdicts[(low < -1e-8) & (high > 1e-8)] == 2).all()
    sums, confidence = panel.simultaneous_bounds(d)
    own = [member.simultaneous_bounds(d)[0] for member in panel.members.values()]
    np.testing.assert_allclose(sums, 0.75 * own[0] + 0.25 * own[1], atol=1e-15)
    assert confidence == 1
    mean = 0.75 * VALUES["ann"] + 0.25 * VALUES["ben"]
    assert (d @ mean <= sums + 1e-9).all()
    np.testing.assert_allclose(
        panel.values,
        0.75 * panel.members["ann"].values + 0.25 * panel.members["ben"].values,
    )


@examples(5)
@given(st.integers(0, 10_000))
def test_the_bounds_are_those_of_one_program_over_all_scales_together(seed):
    panel = told(two(), 4, seed)
    (d,) = np.random.default_rng(seed).normal(size=(1, K))
    rows, limits, equal = [], [], []
    for i, name in enumerate(panel.people):
        zero = np.zeros((K - 1) * i), np.zeros((K - 1) * (1 - i))
        own = panel.answers.of_person(name)
        for t, y in zip(tail_sums(own.d), own.y, strict=True):
            rows.append(np.concatenate([zero[0], -y * t, zero[1]]))
            limits.append(0.0)
        equal.append(np.concatenate([zero[0], np.ones(K - 1), zero[1]]))
    cost = 0.5 * np.tile(tail_sums(d), 2)
    found = [
        sign * linprog(sign * cost, rows, limits, equal, [1, 1], bounds=(1e-6, None)).fun
        for sign in (1, -1)
    ]
    np.testing.assert_allclose(np.ravel(panel.bounds(d[None])), found, atol=1e-8)


def test_the_confidence_of_sums_of_bounds_is_a_union_bound():
    panel = Panel({f"{i}": PosteriorComparator(K, seed=i) for i in range(5)})
    assert panel.simultaneous_bounds(np.eye(K))[1] == pytest.approx(0.75)
    crowd = Panel({f"{i}": PosteriorComparator(K, seed=i) for i in range(21)})
    assert crowd.simultaneous_bounds(np.eye(K))[1] == 0
    mixed = Panel({"ann": PosteriorComparator(K, seed=0), "ben": Exact(VALUES["ann"])})
    assert not elicit.parts.offers(mixed, "simultaneous_bounds")


def test_draws_of_the_mean_combine_the_members_as_independent():
    panel = told(two(lambda k: PosteriorComparator(k, seed=3, particles=4000)), 15)
    gaps, weights, _ = panel.draws
    each = [member.draws for member in panel.members.values()]
    means = [draws.gaps @ draws.weights for draws in each]
    np.testing.assert_allclose(gaps @ weights, (means[0] + means[1]) / 2, atol=0.01)
    spread = [
        (draws.weights * (draws.gaps - mean[:, None]) ** 2).sum(axis=1)
        for draws, mean in zip(each, means, strict=True)
    ]
    np.testing.assert_allclose(gaps.var(axis=1), (spread[0] + spread[1]) / 4, rtol=0.15)
    assert panel.level == 0.95
    assert (panel.draws[0] == pickle.loads(pickle.dumps(panel)).draws[0]).all()


@pytest.mark.parametrize("name", [*MEMBERS])
def test_a_panel_of_one_is_its_member(name):
    member, d = MEMBERS[name](K), sample_differences(K)
    panel = Panel({"ann": member})
    for _ in range(2):
        for part in OPTIONAL_PARTS:
            if part.member not in ("people", "whom", "rule", "decide_rest", "answers"):
                assert elicit.parts.offers(panel, part.member) == elicit.parts.offers(
                    member, part.member
                )
        for mine, theirs in zip(decide(panel, d), decide(member, d), strict=True):
            assert (mine == theirs).all()
        assert (np.array(panel.bounds(d)) == np.array(member.bounds(d))).all()
        assert (panel.values == member.values).all()
        answers = Answers(d[:3], TruthfulTutor(VALUES["ann"]).signs(d[:3]))
        panel, member = panel.update(answers), member.update(answers)
    assert panel.people == ("ann",)


def test_what_members_know_already_the_panel_knows():
    d = np.array([[0.5, -1, 0, 0.5]])
    ann = PolytopeComparator(K).update(Answers(d, [1], ["first"]))
    panel = Panel({"ann": ann, "ben": PolytopeComparator(K)})
    assert (panel.answers.ids, panel.answers.who) == (("first",), ("ann",))
    more = panel.update(Answers(-d, [1], ["second"], ["ben"]))
    assert more.answers.who == ("ann", "ben")
    assert panel.answers.who == ("ann",)
    assert more.members["ann"] is ann
    assert copy.deepcopy(more).answers.ids == ("first", "second")


def test_an_answer_must_be_of_a_member():
    answers = Answers([[0.5, -1, 0, 0.5]], [1], ["q7"])
    with pytest.raises(ValueError, match=r"row 0, 'q7', does not say who gave it.* 'ann' or 'ben'"):
        two().update(answers)
    named = Answers(answers.d, answers.y, answers.ids, ["cher"])
    with pytest.raises(ValueError, match="'q7', is one of 'cher'"):
        two().update(named)
    assert len(Panel({"ann": PolytopeComparator(K)}).update(answers).answers) == 1


def test_people_may_disagree_and_one_may_not_contradict_themselves():
    d = np.array([[0.5, -1, 0, 0.5]])
    panel = two().update(Answers(np.concatenate([d, d]), [1, -1], ["a", "b"], ["ann", "ben"]))
    with pytest.raises(InconsistentAnswers, match="of the answers of 'ben'") as caught:
        panel.update(Answers(np.concatenate([d, d]), [1, 1], ["c", "d"], ["ann", "ben"]))
    assert caught.value.answers == ((1, "b"), (3, "d"))


@pytest.mark.parametrize(
    ("members", "weights", "kind", "says"),
    [
        ({}, None, ValueError, "at least one"),
        ([PolytopeComparator(K)], None, ValueError, "by name"),
        ({None: PolytopeComparator(K)}, None, TypeError, "needs a name"),
        ({"": PolytopeComparator(K)}, None, ValueError, "must not be empty"),
        ({"ann": 3}, None, TypeError, "a comparator is wanted"),
        ({"ann": AlwaysAsk(3), "ben": AlwaysAsk(4)}, None, ValueError, "the same levels"),
        ({"ann": AlwaysAsk(3)}, [0], ValueError, "a number above 0"),
        ({"ann": AlwaysAsk(3)}, {"ben": 1}, ValueError, "each of 'ann'"),
        ({"ann": AlwaysAsk(3), "ben": AlwaysAsk(3)}, [1], ValueError, "a number above 0"),
    ],
)
def test_what_makes_no_panel_is_refused(members, weights, kind, says):
    with pytest.raises(kind, match=says):
        Panel(members, weights)


def test_it_asks_the_member_of_the_widest_interval_and_nobody_the_same_twice():
    d = np.array([0.2, -0.6, 0.1, 0.3])
    panel = two()
    first = panel.whom(d)
    assert (first.who, (first.d == d).all()) == ("ann", True)
    assert panel.whom(d, ["ann"]).who == "ben"
    assert panel.whom(d, ["ann", "ben"]) is None
    assert panel.whom(np.zeros(K)) is None
    assert two(weights=[1, 2]).whom(d).who == "ben"
    asked, widths = [], []
    for i in range(60):
        found = panel.whom(d)
        if found is None:
            break
        own = panel.answers.of_person(found.who)
        assert not same_pairs(tail_sums(found.d), tail_sums(own.d)).any()
        y = TruthfulTutor(VALUES[found.who]).signs(found.d[None])
        panel = panel.update(Answers(found.d[None], y, [f"{i}"], [found.who]))
        asked.append(found.who)
        low, high = panel.bounds(d)
        widths.append(high[0] - low[0])
        at = d @ (VALUES["ann"] + VALUES["ben"]) / 2
        assert low[0] - 1e-9 <= at <= high[0] + 1e-9
    assert panel.whom(d) is None
    assert {*asked} == {"ann", "ben"}
    assert widths[-1] < 1e-6
    assert (np.diff(widths) <= 1e-9).all()


def test_a_member_whose_answers_may_be_wrong_is_asked_so_often_about_a_pair_at_most():
    d = np.array([0.2, -0.6, 0.1, 0.3])
    panel = two(lambda k: PosteriorComparator(k, seed=5))
    while (found := panel.whom(d)) is not None:
        panel = panel.update(Answers(found.d[None], [1], who=[found.who]))
        assert len(panel.answers) <= 2 * _FORMS
    assert {*panel.answers.who} == {"ann", "ben"}
    assert panel.whom(np.array([0.2, -0.1, -0.6, 0.5])) is not None


def test_a_member_whose_order_is_open_and_a_panel_are_refused():
    with pytest.raises(ValueError, match="member 'a' has OpenOrderComparator"):
        Panel({"a": OpenOrderComparator(3), "b": PolytopeComparator(3)})
    with pytest.raises(ValueError, match="member 'b' has Panel"):
        Panel({"b": Panel({"c": PolytopeComparator(3)})})


@pytest.mark.parametrize("weights", [5, [1, None], [1e308, 1e308], [1], {"a": 1, "c": 1}, [1, 0]])
def test_weights_that_are_no_shares_are_refused(weights):
    with pytest.raises(ValueError, match="weights must give each of 'a', 'b' a number above 0"):
        Panel({"a": PolytopeComparator(3), "b": PolytopeComparator(3)}, weights)


def test_one_name_is_no_list_of_letters():
    panel = Panel({"a": PolytopeComparator(K), "n": PolytopeComparator(K)})
    with pytest.raises(TypeError, match=r"put the one into a list, \['ann'\]"):
        panel.whom([-0.5, 0.5, 0.5, -0.5], "ann")
    assert panel.whom([-0.5, 0.5, 0.5, -0.5], ["ann"]) is not None


def test_a_panel_trusts_as_its_least_certain_member_and_ties_as_its_most_tolerant():
    sure, less = (PosteriorComparator(K, level=level, particles=50) for level in (0.99, 0.9))
    for members in ((sure, less), (less, sure)):
        panel = Panel(dict(zip(VALUES, members, strict=True)))
        assert (panel.level, panel.confidence) == (0.9, 0.9)
    ties = {"ann": PolytopeComparator(K, tie=0.01), "ben": PolytopeComparator(K, tie=0.05)}
    assert Panel(ties).tie == 0.05
