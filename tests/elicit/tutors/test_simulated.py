"""Simulated tutors are exact, reproducible and as wrong as asked."""

import copy
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit

from elicit import Answer, BradleyTerryTutor, FlippingTutor, Query, TruthfulTutor, Tutor, Verdict
from elicit.model.difference_kernel import LEFT_OPEN
from elicit.model.scale import exact_dot
from elicit.testing import check_tutor
from elicit.tutors.simulated_kernel import NOBODY, respond
from tests.noisy_cases import differences
from tests.scale_arithmetic import gaps, tail_sums
from tests.thoroughness import examples

HIDDEN = np.array([3, 10, 11, 40, 99])


def query(d, name="q"):
    d = np.asarray(d, dtype=float)
    return Query(name, np.clip(d, 0, None), np.clip(-d, 0, None))


def by_fractions(d, values):
    parts = zip(tail_sums(np.asarray(d, dtype=float)), gaps(values), strict=True)
    total = sum(Fraction(float(a)) * Fraction(float(b)) for a, b in parts)
    return (total > 0) - (total < 0)


NOISY = [
    lambda seed: FlippingTutor(HIDDEN, 0.3, seed),
    lambda seed: BradleyTerryTutor(HIDDEN, 4.0, seed),
]


@pytest.mark.parametrize("k", [3, 5, 10, 25])
def test_the_truthful_tutor_is_exact_next_to_a_tie(k):
    """Differences orthogonal to the scale, up to a few units in the last place of one entry."""
    rng = np.random.default_rng(k)
    values = np.sort(rng.random(k))
    g = gaps(values)
    d = differences(rng, k, 60)
    d[:, 1] -= (tail_sums(d) @ g) / g[0]
    rows = np.repeat(d, 5, axis=0)
    rows[:, 1] += np.tile(range(-2, 3), 60) * np.spacing(rows[:, 1])
    wanted = [by_fractions(row, values) for row in rows]
    assert len(set(wanted)) > 1
    assert (np.sign(tail_sums(rows) @ g) != wanted).any(), (
        "these cases do not need exact arithmetic"
    )
    assert TruthfulTutor(values).signs(rows).tolist() == wanted


@given(st.lists(st.floats(-1e300, 1e300, allow_subnormal=True), min_size=2, max_size=6), st.data())
@examples(150)
def test_any_finite_difference_gets_its_exact_sign(d, data):
    steps = data.draw(st.lists(st.floats(1e-3, 1e3), min_size=len(d) - 1, max_size=len(d) - 1))
    values = np.concatenate([[0.0], np.cumsum(steps)])
    tutor = TruthfulTutor(values)
    wanted = by_fractions(d, values)
    assert tutor.signs([d]).tolist() == [wanted]
    assert [tutor(query(row)).verdict for row in (d, [-x for x in d])] == [wanted, -wanted]
    assert tutor.realised_error_rate == 0


@pytest.mark.parametrize("tiny", [5e-324, 1e-310, 1e-300])
def test_differences_that_underflow(tiny):
    rows = [[-tiny, tiny, 0], [0, 2 * tiny, -tiny]]
    assert TruthfulTutor([0, 1, 10]).signs(rows).tolist() == [1, by_fractions(rows[1], [0, 1, 10])]


def test_values_are_normalised_and_their_unit_does_not_matter():
    tutor = TruthfulTutor(HIDDEN)
    assert tutor.k == 5
    tutor.values[0] = 5.0  # of a copy
    assert tutor.values == pytest.approx((HIDDEN - 3) / 96)
    d = differences(np.random.default_rng(0), 5, 50)
    assert (TruthfulTutor(HIDDEN * 7.0 - 5).signs(d) == tutor.signs(d)).all()


MAKERS = [
    TruthfulTutor,
    lambda values: FlippingTutor(values, 0.1),
    lambda values: BradleyTerryTutor(values, 1.0),
]


@pytest.mark.parametrize("values", [[0, 0, 1], [1, 0], [0], [0, np.nan], [[0, 1]]])
@pytest.mark.parametrize("make", MAKERS)
def test_bad_values(make, values):
    with pytest.raises(ValueError, match="values"):
        make(values)


@pytest.mark.parametrize("tutor", [TruthfulTutor(HIDDEN), *(make(1) for make in NOISY)])
def test_a_query_about_other_levels(tutor):
    with pytest.raises(ValueError, match="5"):
        tutor(query([1, -1]))
    with pytest.raises(ValueError, match="finite"):
        tutor.signs([[0, 0, 0, 0, np.nan]])
    assert math.isnan(tutor.realised_error_rate)


@pytest.mark.parametrize("make", [lambda s: TruthfulTutor(HIDDEN), *NOISY])
def test_many_at_once_is_one_by_one(make):
    rng = np.random.default_rng(0)
    d = differences(rng, 5, 60)
    d = np.concatenate([d, -d[:20], d[:20], np.zeros((2, 5)), [[0, 0, 7, -8, 1]]])
    together, apart = make(3), make(3)
    signs = together.signs(d)
    assert signs.dtype == np.int8
    assert signs.tolist() == [apart(query(row)).verdict for row in d]
    in_two = make(3)
    assert signs.tolist() == [*in_two.signs(d[:50]), *in_two.signs(d[50:])]
    assert together.realised_error_rate == apart.realised_error_rate == in_two.realised_error_rate
    assert make(3).signs(np.empty((0, 5))).shape == (0,)


@pytest.mark.parametrize("make", NOISY)
def test_errors_do_not_depend_on_the_order_of_asking(make):
    d = differences(np.random.default_rng(1), 5, 100)
    shuffled = np.random.default_rng(2).permutation(100)
    assert (make(5).signs(d)[shuffled] == make(5).signs(d[shuffled])).all()
    late = make(5)
    asked = [
        late.signs(d),
        late.signs(differences(np.random.default_rng(3), 5, 1500)),
        late.signs(d),
    ]
    together = make(5).signs(np.concatenate([d, d])).tolist()
    assert [*asked[0], *asked[2]] == together, "however many others are in between"


@pytest.mark.parametrize("make", NOISY)
def test_the_mirrored_pair_gets_the_mirrored_answer(make):
    d = differences(np.random.default_rng(1), 5, 200)
    straight, turned = make(5), make(5)
    assert (straight.signs(-d) == -turned.signs(d)).all()
    # also as the second asking, whichever way round the first was
    assert (straight.signs(d) == turned.signs(d)).all()


@pytest.mark.parametrize("make", NOISY)
def test_seeds(make):
    d = differences(np.random.default_rng(1), 5, 200)
    assert (make(5).signs(d) == make(5).signs(d)).all()
    assert (make(5).signs(d) != make(6).signs(d)).any()
    assert (
        make(np.random.default_rng(4)).signs(d) == make(np.random.default_rng(4)).signs(d)
    ).all()
    with pytest.raises(TypeError, match="seed"):
        make(-5)


@pytest.mark.parametrize("make", NOISY)
def test_asking_again_draws_again_and_signed_zeros_are_one_pair(make):
    d = np.array([[0.25, 0.0, -0.5, 0.0, 0.25]] * 100)
    answers = make(5).signs(d)
    assert set(answers.tolist()) == {-1, 1}
    assert (make(5).signs(np.where(d == 0, -0.0, d)) == answers).all()


def test_errors_grow_with_the_error_rate():
    """A pair answered wrongly by a careful tutor is answered wrongly by a careless one of the same
    seed.
    """
    d = differences(np.random.default_rng(1), 5, 2000)
    truth = TruthfulTutor(HIDDEN).signs(d)
    for make, careless in ((FlippingTutor, (0.05, 0.1, 0.3)), (BradleyTerryTutor, (30, 10, 2))):
        wrong = [make(HIDDEN, setting, 1).signs(d) != truth for setting in careless]
        assert ((wrong[0] <= wrong[1]) & (wrong[1] <= wrong[2])).all()
        assert wrong[0].sum() < wrong[1].sum() < wrong[2].sum()


def test_a_precise_tutor_is_truthful():
    d = differences(np.random.default_rng(1), 5, 4000)
    assert (BradleyTerryTutor(HIDDEN, 1e9, 1).signs(d) == TruthfulTutor(HIDDEN).signs(d)).all()


@pytest.mark.parametrize("precision", [0.0, 6.0])
def test_bradley_terry_is_equation_6(precision):
    """1 / (1 + exp(-c d.e)), at one difference asked often; with precision 0 a coin."""
    d = np.array([-0.3, 0.1, 0.2, 0.15, -0.15])
    tutor, n = BradleyTerryTutor(HIDDEN, precision, 11), 20_000
    share = np.mean(tutor.signs(np.repeat(d[None], n, axis=0)) == 1)
    p = expit(precision * d @ tutor.values)
    assert abs(share - p) < 4 * math.sqrt(p * (1 - p) / n)


def test_exact_ties():
    values, ties = [0, 1, 2, 4], np.array([[1, -2, 1, 0]] * 4000)
    assert TruthfulTutor(values)(query(ties[0])).verdict is Verdict.EQUAL
    assert not FlippingTutor(values, 1.0, 0).signs(ties).any()
    coin = BradleyTerryTutor(values, 5.0, 0)
    tossed = coin.signs(ties)
    assert abs(tossed.sum()) < 260
    assert (tossed != 0).all()
    assert coin.realised_error_rate == 0
    assert (BradleyTerryTutor(values, 5.0, 0).signs(-ties) == -tossed).all()
    for tutor in (coin, FlippingTutor(values, 1.0, 0), TruthfulTutor(values)):
        assert tutor.signs([[0, 0, 0, 0]]).tolist() == [0]


def test_a_tie_in_floats_that_is_none_can_be_answered_wrongly():
    """If float sums are 0 and the exact product is not, an answer can be wrong, and is counted."""
    values = [0.0, 0.1, 0.3, 0.6, 1.0]
    g = gaps(values)
    d = differences(np.random.default_rng(0), 5, 4000)
    d[:, 1] -= (tail_sums(d) @ g) / g[0]
    t = tail_sums(d)
    hard = d[[(row * g).sum() == 0 and exact_dot(row, g) != 0 for row in t]]
    assert len(hard)
    tutor = FlippingTutor(values, 1.0, 0)
    assert (tutor.signs(hard) == -TruthfulTutor(values).signs(hard)).all()
    assert tutor.realised_error_rate == 1.0


def test_realised_error_rate_counts_every_answer():
    tutor = FlippingTutor(HIDDEN, 0.25, 2)
    assert math.isnan(tutor.realised_error_rate)
    d = differences(np.random.default_rng(1), 5, 400)
    truth = TruthfulTutor(HIDDEN).signs(d)
    wrong = sum(tutor(query(row)).verdict != y for row, y in zip(d[:100], truth[:100], strict=True))
    assert tutor.realised_error_rate == wrong / 100
    wrong += int((tutor.signs(d[100:]) != truth[100:]).sum())
    assert tutor.realised_error_rate == wrong / 400
    assert abs(wrong / 400 - 0.25) < 0.09


@pytest.mark.parametrize("make", [lambda s: TruthfulTutor(HIDDEN), *NOISY])
def test_a_respondent_says_what_its_tutor_says(make):
    d = differences(np.random.default_rng(3), 5, 1500)
    tie = [[0.0, 5.0, -5.0 - 1 / 29, 1 / 29, 0.0]]
    d = np.concatenate([d, d[:50], -d[:50], d[:20], tie])  # asked again, and the other way round
    asked, told, said, left = make(5), make(5), [], 0
    for row, t in zip(d, tail_sums(d), strict=True):
        with np.errstate(over="ignore"):
            found = respond(t, told.respondent)
        left += found == LEFT_OPEN
        said.append(int(told.signs(row)[0]) if found == LEFT_OPEN else found)
    assert said == asked.signs(d).tolist()
    assert told.realised_error_rate == asked.realised_error_rate
    assert left < 10


def test_a_class_with_signs_of_its_own_is_no_respondent():
    class Moody(TruthfulTutor):
        def signs(self, d):
            return -super().signs(d)

    class Late(TruthfulTutor):
        def __call__(self, query):
            return super().__call__(query)

    assert Late(HIDDEN).respondent.kind == NOBODY
    moody = Moody(HIDDEN)
    assert moody.respondent.kind == NOBODY
    assert moody(query([1, -1, 0, 0, 0])).verdict is Verdict.BETTER


@pytest.mark.parametrize("rate", [0.001, 0.05, 0.15, 0.3, 0.499])
@pytest.mark.parametrize("k", [2, 5, 20])
def test_the_expected_error_rate_is_the_one_asked_for(k, rate):
    rng = np.random.default_rng(k)
    values = np.sort(rng.choice(100, k, replace=False))
    reference = differences(rng, k, 500)
    tutor = BradleyTerryTutor.from_error_rate(values, rate, reference)
    de = tail_sums(reference) @ gaps(values)
    assert expit(-tutor.precision * np.abs(de)).mean() == pytest.approx(rate, rel=1e-6)
    assert tutor.expected_error_rate(reference) == pytest.approx(rate, rel=1e-6)
    flipping = FlippingTutor.from_error_rate(values, rate, reference, seed=4)
    assert flipping.error_rate == rate
    for one in (tutor, flipping):
        one.signs(np.tile(reference, (10, 1)))
        assert abs(one.realised_error_rate - rate) < 4 * math.sqrt(rate * (1 - rate) / 5000)


@pytest.mark.parametrize("scale", [1e-200, 1e-6, 1e6])
def test_the_length_of_the_reference_sets_the_precision(scale):
    reference = differences(np.random.default_rng(8), 5, 300)
    plain = BradleyTerryTutor.from_error_rate(HIDDEN, 0.1, reference).precision
    assert BradleyTerryTutor.from_error_rate(
        HIDDEN, 0.1, reference * scale
    ).precision * scale == pytest.approx(plain)


def test_ties_in_the_reference_are_no_errors():
    values = [0, 1, 2, 4]
    reference = np.array([[1, -2, 1, 0], [0, 0, 0, 0], [-1, 1, 0, 0], [0, 0, -1, 1]], dtype=float)
    for make in (FlippingTutor, BradleyTerryTutor):
        tutor = make.from_error_rate(values, 0.2, reference)
        tutor.signs(np.tile(reference, (4000, 1)))
        assert abs(tutor.realised_error_rate - 0.2) < 0.02
        with pytest.raises(ValueError, match=r"0\.25"):
            make.from_error_rate(values, 0.25, reference)
        with pytest.raises(ValueError, match="0 reference"):
            make.from_error_rate(values, 0.2, reference[:0])
    tiny = [[-5e-324, 5e-324, 0, 0]]  # no tie, though its value is too small for a float
    assert FlippingTutor.from_error_rate(values, 0.2, tiny).error_rate == 0.2


@pytest.mark.parametrize("rate", [0, 0.5, -0.1, 1, np.nan, "a", None])
@pytest.mark.parametrize("make", [FlippingTutor, BradleyTerryTutor])
def test_bad_error_rates(make, rate):
    with pytest.raises(ValueError, match="error rate"):
        make.from_error_rate(HIDDEN, rate, differences(np.random.default_rng(8), 5, 30))
    with pytest.raises(ValueError, match="reference"):
        make.from_error_rate(HIDDEN, 0.1, [[1, -1]])


@pytest.mark.parametrize("value", [-1, np.nan, np.inf, "a", None])
def test_bad_settings(value):
    with pytest.raises(ValueError, match=f"error_rate must be .* not {value!r}"):
        FlippingTutor(HIDDEN, value)
    with pytest.raises(ValueError, match=f"precision must be .* not {value!r}"):
        BradleyTerryTutor(HIDDEN, value)


@pytest.mark.parametrize("k", [2, 5])
def test_all_tutors_conform(k):
    values = np.arange(k) ** 2
    check_tutor(TruthfulTutor(values), k, truthful=True)
    for make in MAKERS:
        check_tutor(make(values), k)
    assert isinstance(TruthfulTutor(values), Tutor)
    with pytest.raises(AssertionError, match=r"truthful|every scale"):
        check_tutor(FlippingTutor(values, 0.5, 0), k, truthful=True)


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        (lambda q: q.left, "must return an elicit.Answer"),
        (lambda q: Answer(query([1, -1, 0], "else"), Verdict.BETTER), "names another one"),
        (lambda q: Answer(q, Verdict.BETTER), "identical vectors"),
    ],
)
def test_bad_tutors_are_found_out(answer, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_tutor(answer, 3)


def test_a_tutor_can_be_copied():
    tutor = FlippingTutor(HIDDEN, 0.4, 0)
    d = differences(np.random.default_rng(0), 5, 50)
    tutor.signs(d)
    twin = copy.deepcopy(tutor)
    assert (tutor.signs(d) == twin.signs(d)).all()
