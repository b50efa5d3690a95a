"""A simulated person answers by the law that is stated, and one seed is one person."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import elicit
from elicit import PersonTutor, Query, Verdict
from elicit.testing import check_tutor
from elicit.tutors.person import DRAWN_FROM
from tests.thoroughness import quick_first

VALUES = [0, 1, 3, 10]
SHARES = st.lists(st.integers(0, 9), min_size=4, max_size=4).filter(any)


def bag(weights):
    return np.array(weights) / sum(weights)


def by_outcomes(tutor, query):
    """The stated probabilities, from the value of each outcome of both bags by itself."""
    e = tutor.values
    means = [sum(p * x for p, x in zip(side, e, strict=True)) for side in (query.left, query.right)]
    variances = [
        sum(p * (x - mean) ** 2 for p, x in zip(side, e, strict=True))
        for side, mean in zip((query.left, query.right), means, strict=True)
    ]
    spread = max(math.sqrt(sum(variances) / 2), 1e-4)
    logit = tutor.precision * (means[0] - means[1]) / spread
    lapse = tutor.lapse * (0.99 if tutor.width else 1.0) / 2

    def chance(x):
        weighed = 0.0 if x < -700 else 1 / (1 + math.exp(-x))
        return lapse + (1 - tutor.lapse) * weighed

    return chance(logit + tutor.side - tutor.width), chance(-logit - tutor.side - tutor.width)


@given(SHARES, SHARES, st.integers(0, 50))
def test_probabilities_are_those_of_the_law(left, right, seed):
    tutor, query = PersonTutor(VALUES, seed), Query("q", bag(left), bag(right))
    found = tutor.probabilities(query)
    assert sum(found) == pytest.approx(1)
    if np.array_equal(query.left, query.right):
        assert found == (0, 0, 1)
    elif np.abs(query.d).max() > 1e-12:
        assert found[:2] == pytest.approx(by_outcomes(tutor, query), abs=1e-6)
        assert tutor.width or found[2] == 0


@given(SHARES, SHARES, st.integers(0, 50))
def test_the_same_pair_in_other_units_is_answered_alike(left, right, seed):
    """Bags that are ten times as large are the same bags; so are those without the worst level."""
    query = Query("q", bag(left), bag(right))
    tutor = PersonTutor(VALUES, seed)
    tenfold = Query("q", 10 * query.left, 10 * query.right)
    assert tutor.probabilities(tenfold) == pytest.approx(tutor.probabilities(query), abs=1e-6)
    bare = Query("q", query.left * [0, 1, 1, 1], query.right * [0, 1, 1, 1])
    left_out = min(query.left[0], query.right[0])
    if left_out == 0 and np.abs(bare.d).max() > 1e-9:  # then the larger total is still 1
        assert tutor.probabilities(bare) == pytest.approx(tutor.probabilities(query), abs=1e-6)


@pytest.mark.parametrize("seed", quick_first([1, 4, 9], 1))
def test_answers_come_as_often_as_their_probabilities_say(seed):
    tutor = PersonTutor(VALUES, seed)
    query = Query("q", [0, 1, 0, 0], [0.92, 0, 0, 0.08])
    wanted = tutor.probabilities(query)
    said = [int(tutor(query).verdict) for _ in range(4000)]
    found = [said.count(code) / len(said) for code in (1, -1, 0)]
    assert found == pytest.approx(wanted, abs=4 * 0.5 / math.sqrt(len(said)))
    flipped = Query("q", query.right, query.left)
    again = PersonTutor(VALUES, seed)
    mirrored = [-int(again(flipped).verdict) for _ in range(4000)]
    differ = np.mean(np.array(said) != np.array(mirrored))
    assert differ == pytest.approx(abs(2 * sided(tutor, query, flipped)), abs=0.03)


def sided(tutor, query, flipped):
    """Return how far the side bias moves the probability of the answer for the first bag."""
    return (tutor.probabilities(query)[0] - tutor.probabilities(flipped)[1]) / 2


def test_one_seed_is_one_person_and_other_questions_do_not_matter():
    queries = [Query("q", [1 - p, 0, 0, p], [0, 1, 0, 0]) for p in np.linspace(0.02, 0.3, 30)]
    one, same, other = PersonTutor(VALUES, 3), PersonTutor(VALUES, 3), PersonTutor(VALUES, 4)
    assert repr(one) == repr(same) != repr(other)
    first = [one(query).verdict for query in queries]
    assert [same(query).verdict for query in reversed(queries)][::-1] == first
    drawn = PersonTutor(VALUES, None)
    assert repr(PersonTutor(VALUES, drawn.seed)) == repr(drawn)


def test_persons_are_drawn_from_the_population():
    people = [PersonTutor(VALUES, seed) for seed in range(3000)]
    logs = np.log([tutor.precision for tutor in people])
    assert logs.mean() == pytest.approx(DRAWN_FROM.log_precision, abs=0.1)
    assert logs.std() == pytest.approx(DRAWN_FROM.log_precision_sd, abs=0.1)
    a, b = DRAWN_FROM.lapse_a, DRAWN_FROM.lapse_b
    assert np.mean([tutor.lapse for tutor in people]) == pytest.approx(a / (a + b), abs=0.01)
    assert np.mean([tutor.width > 0 for tutor in people]) == pytest.approx(
        DRAWN_FROM.ties, abs=0.03
    )
    assert np.mean([tutor.side for tutor in people]) == pytest.approx(DRAWN_FROM.side, abs=0.01)


def test_it_is_a_tutor():
    for seed in range(5):
        check_tutor(PersonTutor(VALUES, seed), 4)
    tutor = PersonTutor(VALUES, 2)
    assert isinstance(tutor, elicit.Tutor)
    assert tutor.k == 4
    assert tutor.values.tolist() == [0, 0.1, 0.3, 1]
    assert math.isnan(tutor.realised_error_rate)
    assert tutor(Query("q", [0, 1, 0, 0], [0, 1, 0, 0])).verdict is Verdict.EQUAL
    assert tutor.realised_error_rate == 0
    with pytest.raises(ValueError, match="about 3 levels, but the tutor was made for 4"):
        tutor(Query("q", [0, 1, 0], [1, 0, 0]))
    with pytest.raises(ValueError, match="must increase"):
        PersonTutor([0, 0, 1])


def test_errors_are_counted():
    query = Query("q", [0, 1, 0, 0], [0.9, 0, 0, 0.1])  # an exact tie
    clear = Query("q", [0, 1, 0, 0], [0.8, 0, 0, 0.2])
    tutor = PersonTutor(VALUES, 1)
    wrong = sum(tutor(clear).verdict is Verdict.BETTER for _ in range(200))
    assert tutor.realised_error_rate == wrong / 200
    assert 0 < wrong < 200 or tutor.precision > 100
    assert tutor(query).verdict in tuple(Verdict)
