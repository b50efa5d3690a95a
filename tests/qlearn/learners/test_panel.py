"""Learners with a panel: whom they ask, what they prove, and that a panel of one is its member."""

from functools import partial
from itertools import product

import numpy as np
import pytest

import qlearn
from elicit import (
    Answer,
    AnswerLog,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    Panel,
    PanelTutor,
    PolytopeComparator,
    PosteriorComparator,
    ReplayTutor,
    Session,
    TruthfulTutor,
    choose,
)
from qlearn import drive
from tests.thoroughness import on_any_processor, scaled

K = 4
MDP, _ = qlearn.random_mdp(12, 3, K, discount=0.9, seed=3)
VALUES = {"ann": [0, 1, 4, 10], "ben": [0, 6, 9, 10], "cher": [0, 3, 4, 10]}
TUTORS = {name: TruthfulTutor(values) for name, values in VALUES.items()}
MEAN = np.mean(list(VALUES.values()), axis=0)
LEARNERS = {
    "policy": partial(qlearn.InteractivePolicyIteration, tolerance=0.01),
    "value": partial(qlearn.InteractiveValueIteration, tolerance=0.01),
    "late value": partial(qlearn.LateValueIteration, tolerance=0.01),
    "q": partial(qlearn.InteractiveQLearning, steps=scaled(60, 1500), indifference=0.002),
}

SLOW = pytest.mark.slow


def panel(make=PolytopeComparator, people=VALUES):
    return Panel({name: make(K) for name in people})


def posterior(k):
    return PosteriorComparator(k, seed=2)


@pytest.mark.parametrize("learner", [*LEARNERS])
def test_every_learner_asks_each_by_name_and_proves_the_mean(learner):
    seen = []

    def said(name, query):
        assert query.who == name
        seen.append((name, query))
        return TUTORS[name](query)

    run = LEARNERS[learner](MDP, panel())
    result = drive(run, {name: partial(said, name) for name in VALUES})
    assert {name for name, _ in seen} == VALUES.keys()
    assert result.answers.who == tuple(name for name, _ in seen)
    assert result.comparator.answers.who == result.answers.who
    assert result.confidence == 1
    loss = qlearn.policy_loss(MDP, result.policy, MEAN).max()
    assert loss <= result.loss_bound + 1e-9
    if learner != "q":
        assert result.status is qlearn.Status.CONVERGED
        assert loss <= 0.01
    for name, bound in result.member_loss_bounds.items():
        assert qlearn.policy_loss(MDP, result.policy, VALUES[name]).max() <= bound + 1e-9
    for name in VALUES:  # nobody is asked the same twice
        own = [query.id for who, query in seen if who == name]
        assert len({*own}) == len(own)


@pytest.mark.parametrize(
    ("learner", "make"),
    [
        pytest.param(*each, marks=[] if "policy" in each or each[1] is PolytopeComparator else SLOW)
        for each in product(LEARNERS, [PolytopeComparator, posterior])
    ],
)
def test_a_panel_of_one_asks_what_its_member_asks(learner, make):
    asked = []
    for comparator in (make(K), Panel({"ann": make(K)})):
        log = AnswerLog(k=K)
        tutor = FlippingTutor(VALUES["ann"], 0.1, seed=1) if make is posterior else TUTORS["ann"]
        result = drive(LEARNERS[learner](MDP, comparator), tutor, log)
        asked.append(
            (
                [(e.answer.query.id, e.answer.query.left.tobytes(), e.answer.verdict) for e in log],
                result.policy.tolist(),
                dict(result.decided),
                (result.loss_bound, result.confidence, result.status),
            )
        )
    assert asked[0] == asked[1]
    (own,) = result.member_loss_bounds.values()  # in full, where a learner stops at what is enough
    assert 0 <= own <= result.loss_bound + 1e-9


@on_any_processor
def test_a_result_says_what_the_policy_may_lose_each():
    result = qlearn.solve(MDP, TUTORS, panel(), seed=0)
    assert "By their own scale it loses each at most" in str(result)
    assert all(name in str(result) for name in VALUES)
    alone = qlearn.solve(MDP, TUTORS["ann"], "polytope", seed=0)
    assert alone.member_loss_bounds == {}
    assert "each" not in str(alone)


def test_members_who_err_are_bounded_at_the_level():
    tutors = {name: FlippingTutor(VALUES[name], 0.1, seed=i) for i, name in enumerate(VALUES)}
    result = qlearn.solve(MDP, tutors, panel(posterior), tolerance=0.02, seed=0)
    assert result.confidence == 0.95
    assert result.loss_bound <= 0.02
    assert qlearn.policy_loss(MDP, result.policy, MEAN).max() <= result.loss_bound


@pytest.mark.parametrize("learner", [*LEARNERS])
def test_a_log_tells_again_what_was_asked_and_is_known_to_the_next(learner):
    log = AnswerLog(k=K)
    first = drive(LEARNERS[learner](MDP, panel()), TUTORS, log)
    again = drive(LEARNERS[learner](MDP, panel()), ReplayTutor(log))
    assert again.answers.ids == first.answers.ids
    assert again.answers.who == first.answers.who
    assert (again.policy == first.policy).all()
    known = drive(LEARNERS[learner](MDP, panel(), known=log), TUTORS)
    assert known.answers.who[: len(log)] == first.answers.who
    if learner == "policy":
        assert known.asked == 0


def test_one_who_cannot_tell_is_not_asked_the_same_and_the_others_are():
    asked = []

    def silent(query):
        asked.append(query.left.tobytes())
        return Answer(query, None)

    run = qlearn.InteractiveValueIteration(MDP, panel(), tolerance=0.05, indifference=0.02)
    result = drive(run, {**TUTORS, "ann": silent})
    assert asked
    assert len({*asked}) == len(asked)
    assert {"ben", "cher"} <= {*result.answers.who}
    assert "ann" not in result.answers.who
    nobody = drive(
        qlearn.InteractiveValueIteration(MDP, panel(), tolerance=0.05, indifference=0.02),
        dict.fromkeys(VALUES, lambda query: Answer(query, None)),
    )
    assert nobody.cannot_tell == nobody.asked > 0


class Contrary(Dominance):
    """A comparator of somebody whose every answer contradicts what they said before."""

    def update(self, answers):
        if len(answers):
            raise InconsistentAnswers("they said the opposite")
        return self


def test_an_answer_that_contradicts_their_own_is_dropped_and_they_are_not_asked_again():
    several = Panel({"ann": PolytopeComparator(K), "ben": Contrary(K)})
    run = qlearn.InteractiveValueIteration(MDP, several, tolerance=0.1)
    asked, log = [], AnswerLog(k=K)

    def said(query):
        asked.append((query.left.tobytes(), query.right.tobytes()))
        return TUTORS["ben"](query)

    drive(run, {**TUTORS, "ben": said}, log, on_conflict="drop")
    assert {entry.answer.who for entry in log if not entry.used} == {"ben"}
    assert {entry.answer.who for entry in log if entry.used} == {"ann"}
    assert len({*asked}) == len(asked) > 0


def test_several_people_are_not_audited():
    with pytest.raises(ValueError, match="an audit asks one person"):
        LEARNERS["policy"](MDP, panel(), audit=0.5)


def test_a_tutor_of_several_says_whose_query_it_has_no_answer_to():
    with pytest.raises(ValueError, match=r"the tutors are of .ben., but the questions go to .ann"):
        drive(LEARNERS["policy"](MDP, panel()), {"ben": TUTORS["ben"]})
    with pytest.raises(ValueError, match="one tutor alone"):
        qlearn.solve(MDP, TUTORS, "polytope", seed=0)
    with pytest.raises(ValueError, match="at least one tutor"):
        PanelTutor({})
    with pytest.raises(TypeError, match="cannot be called"):
        PanelTutor({"ann": 3})
    words = PanelTutor({"ann": lambda query: 1})
    query = LEARNERS["policy"](MDP, Panel({"ann": PolytopeComparator(K)})).ask()[0]
    assert words(query) == Answer(query, 1, who="ann")


def make(known):
    return choose(
        np.random.default_rng(2).dirichlet(np.ones(K), 5), panel(), known=known, order=True
    )


def test_a_session_of_several_goes_on_from_its_log_and_takes_answers_back(tmp_path):
    path = tmp_path / "log"
    with Session(make, path) as session:
        for _ in range(4):
            query = session.question()
            session.shown(query.id)
            session.answer(query.id, TUTORS[query.who](query).verdict)
        assert [one.metadata["who"] for one in session.log.asked] == [
            entry.answer.who for entry in session.log
        ]
        said = [(e.answer.who, e.answer.query.id) for e in session.log]
        waits = session.question()
    assert len({who for who, _ in said}) > 1
    with Session(make, path) as session:
        assert session.question().id == waits.id
        assert session.question().who == waits.who
        assert [(e.answer.who, e.answer.query.id) for e in session.log] == said
        assert session.undo().query.id == said[-1][1]
        back = session.question()
        assert (back.who, back.id) == said[-1]
        session.withdraw(said[0][1])
        known = session.current_asker().comparator.answers
        assert known.who == tuple(who for who, _ in said[1:-1])
        while query := session.question():
            session.answer(query.id, TUTORS[query.who](query).verdict)
        order = session.result().order
    vectors = np.random.default_rng(2).dirichlet(np.ones(K), 5)
    assert (np.diff(vectors[list(order)] @ MEAN) <= 1e-9).all()


def test_a_missing_tutor_is_found_before_anybody_is_asked():
    def never(query):
        raise AssertionError(query)

    mdp = qlearn.random_mdp(5, 2, 3, seed=0)[0]
    panel = Panel({"a": PolytopeComparator(3), "b": PolytopeComparator(3)})
    with pytest.raises(ValueError, match="give the tutor of each member"):
        qlearn.solve(mdp, {"a": never, "B": never}, panel)
    with pytest.raises(ValueError, match="one tutor alone"):
        qlearn.solve(mdp, {"a": never, "b": never}, PolytopeComparator(3))
