"""A tutor is any function from queries to answers, made for as many levels as are asked about."""

import numpy as np
import pytest

import qlearn
from elicit import Answer, FlippingTutor, PolytopeComparator, TruthfulTutor, Tutor
from elicit.model.tutor import check_tutor_made
from elicit.testing import check_tutor

MDP, VALUES = qlearn.random_mdp(8, 3, 4, discount=0.9, seed=0)


class Silent:
    k = 4

    def __call__(self, question):
        return Answer(question, None)


def test_functions_and_instances_are():
    for tutor in (lambda q: Answer(q, None), Silent(), TruthfulTutor(VALUES)):
        assert isinstance(tutor, Tutor)
        check_tutor_made(tutor, 4)
    check_tutor_made(lambda q: Answer(q, None), 7)


@pytest.mark.parametrize(
    ("tutor", "kind", "complaint"),
    [
        (
            TruthfulTutor,
            TypeError,
            r"not the class TruthfulTutor: make one, such as TruthfulTutor\(values=",
        ),
        (Silent, TypeError, "not the class Silent"),
        (
            TruthfulTutor([0, 1, 2]),
            ValueError,
            r"about 4 levels, but the tutor was made for 3: TruthfulTutor\(k=3\)",
        ),
        (FlippingTutor(range(9), 0.1), ValueError, "made for 9: FlippingTutor"),
        ("ask", TypeError, "'ask' cannot be called"),
    ],
)
def test_what_is_no_tutor_for_these_questions_is_refused_before_the_first(tutor, kind, complaint):
    learner = qlearn.InteractivePolicyIteration(MDP, PolytopeComparator(4))
    with pytest.raises(kind, match=complaint):
        qlearn.drive(learner, tutor)
    with pytest.raises(AssertionError, match=complaint):
        check_tutor(tutor, 4)


@pytest.mark.parametrize(
    ("reply", "complaint"),
    [
        (lambda q: int(np.sign((q.right - q.left) @ [0, 1, 2, 3])), "in 5 of 5 questions: are"),
        (lambda q: 0, "prefers neither in all 5 questions"),
        (lambda q: Answer(q, None), "prefers neither in all 5 questions"),
        (lambda q: None, r"where it cannot tell, elicit.Answer\(query, None\)"),
    ],
)
def test_a_tutor_who_exchanges_the_sides_or_prefers_nothing_is_noticed(reply, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_tutor(reply, 4)


def test_an_error_of_a_tutor_for_other_levels_says_how_many_were_asked_about():
    with pytest.raises(ValueError, match="matmul") as failed:
        check_tutor(lambda q: int((q.left - q.right) @ [0, 1, 2, 3, 4] > 0), 4)
    assert failed.value.__notes__ == [
        "check_tutor asked about k = 4 levels: has your tutor as many?"
    ]


def test_sides_exchanged_are_noticed_of_a_tutor_who_errs_and_who_errs_is_not_blamed():
    values = [0, 1, 2, 3]
    for seed in range(40):
        errs = FlippingTutor(values, error_rate=0.1, seed=seed)
        with pytest.raises(AssertionError, match=r"of (5|15) questions: are left and right"):
            check_tutor(lambda q, errs=errs: -errs(q).verdict, 4)
        check_tutor(FlippingTutor(values, error_rate=0.2, seed=seed), 4)
