"""A tutor is any function from queries to answers, made for as many levels as are asked about."""

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
