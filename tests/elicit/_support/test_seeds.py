"""One word for randomness, everywhere, and None for a new seed that can be named afterwards."""

import inspect

import numpy as np
import pytest

from elicit import (
    AnswerLog,
    BradleyTerryComparator,
    BradleyTerryTutor,
    Dominance,
    FlippingTutor,
    PosteriorComparator,
    Query,
    Session,
    TruthfulTutor,
    choose,
    compare_held_out,
    held_out,
    tutor_report,
)
from elicit._support.hashing import key_of
from elicit._support.seeds import seed_of, takes_rng
from elicit.testing import check_comparator, check_tutor, sample_differences


def test_a_seed_is_kept_and_none_is_a_new_one_that_has_a_key():
    generator = np.random.default_rng(1)
    assert seed_of(generator) is generator
    assert [seed_of(0), seed_of(7)] == [0, 7]
    fresh = {seed_of(None) for _ in range(20)}
    assert len(fresh) == 20
    assert all(type(seed) is int and key_of(seed) >= 0 for seed in fresh)


def test_rng_is_another_word_for_seed():
    @takes_rng
    def drawn(k: int, seed: int | None) -> tuple[int, int | None]:
        return k, seed

    assert drawn(2, 3) == drawn(2, seed=3) == drawn(2, rng=3) == (2, 3)
    assert drawn(2, rng=None) == (2, None)
    assert list(inspect.signature(drawn).parameters) == ["k", "seed"]
    with pytest.raises(TypeError, match=r"seed= and rng= are two words for the same"):
        drawn(2, seed=3, rng=3)
    with pytest.raises(TypeError, match="multiple values"):
        drawn(2, 3, rng=3)


@pytest.mark.parametrize(
    "make",
    [
        lambda seed: FlippingTutor([0, 1, 2, 4], 0.4, seed),
        lambda seed: FlippingTutor.from_error_rate(
            [0, 1, 2, 4], 0.4, sample_differences(4), seed=seed
        ),
        lambda seed: BradleyTerryTutor([0, 1, 2, 4], 1.0, seed),
    ],
)
def test_a_tutor_without_a_seed_can_be_had_again(make):
    d = sample_differences(4)
    first, second = make(None), make(None)
    said = first.signs(d)
    assert (make(first.seed).signs(d) == said).all()
    assert (second.signs(d) != said).any()
    assert f"seed={first.seed}" in repr(first)


@pytest.mark.parametrize(
    "make",
    [
        lambda seed: PosteriorComparator(4, particles=50, seed=seed),
        lambda seed: BradleyTerryComparator(4, n_boot=20, min_answers=1, seed=seed),
    ],
)
def test_a_comparator_without_a_seed_can_be_had_again(make):
    first, second = (make(None) for _ in range(2))
    again = make(first.seed)
    assert first.seed == again.seed != second.seed
    d = sample_differences(4)
    assert np.array_equal(first.bounds(d), again.bounds(d))


def test_a_session_without_a_seed_can_be_had_again():
    def make(known):
        return choose(
            [[3, 0, 7], [2, 2, 6], [0, 5, 5], [1, 4, 5], [2, 3, 5]],
            Dominance(3),
            order=True,
            known=known,
        )

    def asked(seed):
        session = Session(make, AnswerLog(), audit=0.5, seed=seed)
        found = []
        while query := session.question():
            found.append(query.about)
            session.answer(query.id, 1)
        return session.seed, found

    seed, found = asked(None)
    assert asked(seed) == (seed, found)
    assert len({asked(None)[0] for _ in range(5)}) == 5


def test_checks_take_any_seed():
    assert len(sample_differences(4, None)) == len(sample_differences(4, np.random.default_rng(2)))
    check_tutor(TruthfulTutor([0, 1, 2]), 3, truthful=True, seed=None)
    check_comparator(Dominance(3), seed=None)


def test_reports_take_none_too():
    tutor = FlippingTutor([0, 1, 4], 0.1, seed=None)
    pairs = [([0.5, 0.0, 0.5], [x, 1 - 2 * x, x]) for x in (0.1, 0.2, 0.3)]
    answers = [tutor(Query.make("p", i, left, right)) for i, (left, right) in enumerate(pairs)]
    tutor_report(answers, particles=20, seed=None)
    comparator = PosteriorComparator(3, particles=20)
    held_out(comparator, answers, 2, seed=None)
    compare_held_out({"a": comparator}, answers, 2, seed=None)
