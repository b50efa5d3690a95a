"""The program that sets the posterior of now beside older code and beside people's repeats."""

import numpy as np
import pytest

import elicit
from benchmarks.history import in_older_code, people_before, repeated
from benchmarks.people import comparators
from benchmarks.people.choices import deal
from elicit.people import repeated_gambles
from tests.thoroughness import scaled


def told(n: int = 2, m: int = 12, k: int = 4) -> dict[str, np.ndarray]:
    """Return n simulated people's answers to m questions, as the program hands them over."""
    rng = np.random.default_rng(0)
    d = rng.dirichlet(np.ones(k), m) - rng.dirichlet(np.ones(k), m)
    said = (rng.random((n, m)) < 1 / (1 + np.exp(-8 * d @ np.linspace(0, 1, k)))).astype(float)
    said[0, 0] = np.nan
    fold = deal(n, m, in_older_code.FOLDS, 0)
    return {"d": d, "said": said, "fold": fold, "whole": np.array([1]), "first": np.array([0])}


def test_the_older_code_is_asked_as_the_code_of_now_is(tmp_path):
    given = told()
    np.savez(tmp_path / "in.npz", **given)
    in_older_code.main(str(tmp_path / "in.npz"), str(tmp_path / "out.npz"))
    found = np.load(tmp_path / "out.npz")
    assert np.isnan(found["chance"][0]).all()
    test = given["fold"][1] == 0
    known = elicit.PosteriorComparator(4).update(
        in_older_code.answers_of(given["d"], np.where(test, np.nan, given["said"][1]))
    )
    now = known.answer_probability(given["d"][test])
    # older code took the mean of the lapse for the lapse
    np.testing.assert_allclose(found["chance"][1, test], now, atol=0.03)
    assert found["verdict"][1, test].tolist() == known.compare(given["d"][test]).tolist()
    assert str(found["place"]) == elicit.__file__
    answers = in_older_code.answers_of(given["d"], given["said"][0])
    assert len(answers) == 11
    score = elicit.held_out(elicit.PosteriorComparator(4), answers, in_older_code.FOLDS)
    loglik, scored, decided, otherwise = found["scores"][0]
    assert (loglik, scored) == (score.log_likelihood.value, 11)
    assert decided == pytest.approx(11 * score.decided.value)
    assert 0 <= otherwise <= decided


def test_a_clone_without_the_history_is_told_what_to_do(monkeypatch):
    monkeypatch.setattr(people_before, "BEFORE", "0" * 40)
    nobody = np.zeros(0, dtype=np.intp)
    with pytest.raises(RuntimeError, match=r"no commit 00000000 in .*whole history"):
        people_before.by_older_code(None, nobody, nobody, nobody)


def test_pairs_are_judged_as_on_the_page_of_people(monkeypatch):
    monkeypatch.setattr(repeated, "FOLDS", folds := scaled(2, repeated.FOLDS))
    log = repeated_gambles()["5"]
    fresh = elicit.PosteriorComparator(log.k)
    verdict, chance, left, right, equal = repeated.judged(
        repeated.by_posterior(fresh), repeated.splits_of(log)
    ).T
    rows = comparators.on_repeats(lambda k: elicit.PosteriorComparator(k), log, folds, 0)
    assert (np.abs(verdict) == 1).tolist() == rows[:, 0].tolist()
    np.testing.assert_allclose(np.maximum(left, right) / 20, 1 - rows[:, 2])
    assert (left + right).tolist() == [20.0] * len(rows)
    assert not equal.any()
    logs = left * np.log(chance) + right * np.log(1 - chance)
    np.testing.assert_allclose(logs, rows[:, 4])


def test_a_strength_for_each_gamble_says_who_wins():
    queries = [
        elicit.Query(f"{a}{b}", np.eye(3)[a], np.eye(3)[b]) for a in range(3) for b in range(a)
    ]
    answers = [elicit.Answer(query, elicit.Verdict.BETTER) for query in queries[:2]]
    for features in repeated.FEATURES.values():
        verdict, chance = repeated.by_logistic_fit(features, 1.0)(answers, queries[2:])
        assert verdict.tolist() == [0.0 if abs(chance[0] - 0.5) < 1e-6 else 1.0]
        assert chance[0] >= 0.5 - 1e-6


def test_disagreement_is_counted_by_hand():
    rows = np.array([[[1.0, 0.9, 8.0, 2.0, 0.0], [2.0, 0.5, 5.0, 5.0, 0.0]]])
    decided, other, unusual, beyond, differ = repeated.disagreements(rows)
    assert decided.startswith("50.0%")
    assert other.startswith("20.0%")
    assert unusual.startswith("20.0%")
    assert beyond.startswith("0.0%")
    assert differ.startswith(f"{100 * (1 - (8 * 7 + 2) / 90):.1f}%")
    assert repeated.by_person(rows) == pytest.approx(
        (8 * np.log(0.9) + 2 * np.log(0.1) + 10 * np.log(0.5)) / 20
    )


def test_later_disagreement_is_a_mean_over_pairs_either_way_round():
    d = np.array([[1.0, -1, 0], [-1, 1, 0], [1, -1, 0], [0, 1, -1]])
    answers = elicit.Answers(d, np.array([1, -1, -1, 0]))
    assert repeated.later_disagreement(answers) == pytest.approx((1 / 3 + 0) / 2)
