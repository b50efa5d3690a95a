"""Questions of simple bags: what there are, how easy they are said to be, and what their answers
tell.
"""

import numpy as np
import pytest

from elicit import Bags, PolytopeComparator
from elicit.asking.bags import ease, entropy, information
from elicit.tutors.erring_tutor import says_left
from tests.scale_arithmetic import tail_sums

ABOUT = np.array([[0.5, -1.0, 0.5]])


def test_there_is_one_for_every_triple_of_levels_and_every_number_of_days():
    asked = Bags(days=10).questions(5)
    assert len(asked.ease) == 10 * 9
    for left, right in zip(asked.left, asked.right, strict=True):
        assert left.sum() == right.sum() == 10
        (sure,), others = np.flatnonzero(left), np.flatnonzero(right)
        assert others.min() < sure < others.max()
    assert (np.diff(asked.ease) <= 0).all()
    assert Bags(days=4).questions(2).ease.size == 0  # two levels leave nothing to weigh


def test_halves_are_easier_than_tenths_and_the_ends_than_the_middle():
    assert ease(10, 5, True) == 1.0
    assert ease(10, 5, True) > ease(10, 4, True) > ease(10, 3, True)
    assert ease(10, 5, True) > ease(10, 5, False)
    asked = Bags(days=2).questions(4)
    ends = asked.right[:, [0, -1]].all(axis=1)  # both the worst level and the best
    assert (asked.ease == np.where(ends, 1.0, 0.7)).all()
    assert ends.sum() == 2


def test_information_is_that_of_the_joint_table():
    rng = np.random.default_rng(0)
    chance, events, weights = (
        rng.random((4, 30)),
        rng.random((3, 30)) > 0.5,
        rng.dirichlet(np.ones(30)),
    )
    expected = np.zeros(4)
    for n in range(4):
        for event in events:
            table = np.array(
                [
                    [(weights * p * b).sum() for b in (event, ~event)]
                    for p in (chance[n], 1 - chance[n])
                ]
            )
            outer = table.sum(axis=1, keepdims=True) * table.sum(axis=0)
            expected[n] += (table * np.log2(table / outer)).sum() / 3
    np.testing.assert_allclose(information(chance, events, weights), expected, atol=1e-10)
    assert information(chance, np.ones((2, 30), bool), weights).tolist() == [0.0] * 4
    np.testing.assert_allclose(entropy(np.array([0.0, 0.5, 1.0])), [0.0, 1.0, 0.0], atol=1e-12)


def test_a_tutor_says_left_by_the_model():
    chance = says_left(np.array([[0.1, -0.1, 0.0, 0.2]]), np.array([10.0, 10.0, 10.0, np.inf]), 0.2)
    np.testing.assert_allclose(
        chance, [[0.1 + 0.8 / (1 + np.exp(-1)), 0.1 + 0.8 / (1 + np.exp(1)), 0.5, 0.9]]
    )
    assert says_left(np.zeros((1, 1)), np.array([np.inf]), 0.0)[0, 0] == 0.5


def test_simplicity_trades_information_for_ease():
    comparator = PolytopeComparator(5)
    about = np.array([[0.1, -0.35, 0.2, 0.0, 0.05], [0.0, 0.4, -0.7, 0.0, 0.3]])
    eases, bits = [], []
    for simplicity in (0.0, 0.3, 0.6, 1.0):
        bags = Bags(simplicity=simplicity)
        row, told = bags.best(comparator.draws, about)
        assert told[row] >= (1 - simplicity) * told.max() - 1e-12
        easy = bags.questions(5).ease
        assert easy[row] == easy[told >= max((1 - simplicity) * told.max(), 1e-3)].max(), (
            "the easiest of these"
        )
        eases.append(easy[row])
        bits.append(told[row])
    assert eases == sorted(eases)
    assert bits == sorted(bits, reverse=True)
    assert bits[0] == told.max()
    row, _ = Bags(simplicity=0.0).best(comparator.draws, about)
    assert Bags(simplicity=0.0).best(comparator.draws, about, skip=[row])[0] != row


def test_where_all_is_known_there_is_no_question():
    comparator = PolytopeComparator(4)
    dominated = np.array([[-0.5, 0.2, 0.2, 0.1]])
    row, told = Bags().best(comparator.draws, dominated)
    assert (row, told.max()) == (-1, 0.0)
    assert Bags().best(PolytopeComparator(2).draws, np.array([[1.0, -1.0]]))[0] == -1


def test_a_sentence_that_a_person_can_read():
    asked = Bags().questions(3)
    labels = ("critical", "stable", "well")
    assert Bags().sentence(asked.left[0], asked.right[0], labels) == (
        "of 10 days: 10 stable (left), or 5 critical and 5 well (right)?"
    )
    # and its answer is a cut of the scale: 10 e_2 against 5 e_1 + 5 e_3
    d = (asked.left[0] - asked.right[0]) / 10
    np.testing.assert_allclose(tail_sums(d), [0.5, -0.5])


@pytest.mark.parametrize(
    "bad", [{"days": 1}, {"days": 2.5}, {"simplicity": -0.1}, {"simplicity": 1.1}]
)
@pytest.mark.parametrize("worse", [None, "ten", float("nan"), float("inf")])
def test_settings_that_make_no_sense_are_refused(bad, worse):
    (name,) = bad
    for value in (bad[name], worse):
        with pytest.raises(ValueError, match=f"{name}.* must .*, not {value!r}"):
            Bags(**{name: value})


@pytest.mark.parametrize(
    ("about", "lapse", "skip", "complaint"),
    [
        *(
            (ABOUT, 0.0, [row], r"rows of questions\(3\), .* below 9")
            for row in (999, -1, "a", 0.5, None)
        ),
        (ABOUT, "a", [], r"lapse must be a number in 0\.\.1, not 'a'"),
        *((about, 0.0, [], "d must") for about in (np.zeros((2, 5)), [[np.nan, 0.0, 0.0]], "all")),
    ],
)
def test_what_nothing_can_be_asked_of_is_refused(about, lapse, skip, complaint):
    draws = PolytopeComparator(3).draws
    with pytest.raises(ValueError, match=complaint):
        Bags().best(draws, about, lapse, skip)
    assert Bags().best(draws, ABOUT, skip=np.arange(8))[0] == 8, "all rows but one can be skipped"


def test_more_questions_than_can_be_looked_through_are_refused():
    with pytest.raises(
        ValueError, match=r"1000 days over k = 20 levels make 1,138,860 .* days to 176 or fewer"
    ):
        Bags(days=1000).questions(20)
    with pytest.raises(ValueError, match=r"177 days over k = 20"):
        Bags(days=177).questions(20)
    with pytest.raises(ValueError, match=r"k = 200 levels .* take fewer levels"):
        Bags(days=2).questions(200)
    assert len(Bags(days=1000).questions(5).ease) == 9990  # fewer levels leave room for more days
