"""The benchmark of people: scores, laws of error and their sampler against plain computations."""

import math
from collections import Counter

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.special import expit
from scipy.stats import beta, norm

from benchmarks.people import (
    answers_of_people,
    choices,
    comparators,
    equal_laws,
    error_laws,
    repeats,
)
from elicit import Answer, AnswerLog, PosteriorComparator, Query
from elicit.people import GAMBLES, repeated_gambles
from tests.report_cases import quick_report
from tests.thoroughness import scaled

BAGS = [([0.5, 0, 0.5], [0, 1, 0]), ([0.2, 0.8, 0], [0.6, 0, 0.4]), ([0.9, 0, 0.1], [0.4, 0.6, 0])]


@pytest.fixture
def few() -> choices.Choices:
    """Three people's answers to three questions; one is missing."""
    logs = {}
    for who, said in {"x": [1, -1, 1], "y": [-1, -1, None], "z": [1, 1, 1]}.items():
        logs[who] = AnswerLog(k=3, header={"amounts": [0, 4, 9]})
        for i, verdict in enumerate(said):
            if verdict is not None:
                query = Query(f"question {i}", *BAGS[i])
                logs[who].append(Answer(query, verdict, swapped=i == 1))
    return choices.choices_of(logs)


def test_choices_are_the_answers(few):
    assert few.names == ["x", "y", "z"]
    assert few.said[0].tolist() == [1, 0, 1]
    assert np.isnan(few.said[1, 2])
    assert few.side.tolist() == [[1, -1, 1]] * 3
    assert few.amounts.tolist() == [0, 4, 9]
    assert few.d.tolist() == [[0.5, -1, 0.5], *(np.subtract(*bags).tolist() for bags in BAGS[1:])]


def test_scores_are_those_of_their_definitions():
    chance, said = np.array([0.95, 0.95, 0.15, 0.45, np.nan]), np.array([1, 0, 0, 1, 1.0])
    logs = [math.log(0.95), math.log(0.05), math.log(0.85), math.log(0.45)]
    assert choices.log_likelihood(chance, said) == pytest.approx(np.mean(logs))
    # bins of one, two and one answers: |.95 + .95 - 1|, |.15|, |.45 - 1|, over four
    assert choices.calibration_error(chance, said) == pytest.approx((0.9 + 0.15 + 0.55) / 4)
    assert choices.agreement(chance, said) == 0.5
    assert choices.calibration_error(np.full(1000, 0.3), np.arange(1000) < 300) < 1e-12


def test_halves_are_fixed_and_every_fold_is_of_the_same_size():
    half = choices.choosing_half(139)
    assert half.sum() == 70
    assert (half == choices.choosing_half(139)).all()
    folds = choices.deal(4, 70, 5, 0)
    assert {tuple(np.bincount(row)) for row in folds} == {(14,) * 5}


def test_an_interval_over_people_holds_the_mean_of_normal_numbers():
    rng, held = np.random.default_rng(5), 0
    seeds = scaled(30, 60)
    for seed in range(seeds):
        x = rng.normal(size=40)
        value, low, high = choices.over_people(lambda i, x=x: float(x[i].mean()), 40, seed)
        assert value == x.mean()
        held += low <= 0 <= high
    assert held >= seeds * 5 / 6


def test_the_spread_is_the_root_of_the_mean_variance():
    values = np.array([[0, 0.3, 1.0]])
    for left, right in BAGS:
        variances = [
            sum(p * (x - np.dot(bag, values[0])) ** 2 for p, x in zip(bag, values[0], strict=True))
            for bag in (left, right)
        ]
        found = error_laws.spread_of(values, np.array([left]), np.array([right]))
        assert found == pytest.approx(max(math.sqrt(np.mean(variances)), 1e-4))


@pytest.mark.parametrize("name", error_laws.LAWS)
def test_a_law_gives_probabilities_that_mirror(few, name):
    law, drawn = error_laws.LAWS[name], error_laws.draws(3, 200, 0)
    by_side = error_laws.chances(law, drawn, few)
    mirrored = few._replace(left=few.right, right=few.left)
    other = error_laws.chances(law, drawn, mirrored)
    for side in (1, -1):
        assert ((by_side[side] >= 0) & (by_side[side] <= 1)).all()
        assert by_side[side] == pytest.approx(1 - other[-side], abs=1e-5)
    assert law.bias or (by_side[1] == by_side[-1]).all()


def test_the_product_law_is_that_of_the_product(few):
    """Predictions by draws are those of PosteriorComparator."""
    by_side = error_laws.chances(
        error_laws.LAWS["logistic, lapse"], error_laws.draws(3, 200_000, 1), few
    )
    fold_of = np.array([[0, 1, 2]] * 3)
    everybody = np.ones(3, dtype=np.bool_)
    found, sizes = error_laws.predicted(by_side, few, fold_of, everybody)
    assert sizes.min() > 1000
    ours = comparators.on_questions(
        lambda k: PosteriorComparator(k, particles=4000), few, fold_of, everybody
    )
    assert np.abs(found - ours.chance).max() < 0.02


def test_a_prior_of_people_is_likelier_for_such_people(few):
    by_side = error_laws.chances(
        error_laws.LAWS["logistic, lapse"], error_laws.draws(3, 5000, 2), few
    )
    taken = np.ones((3, 3), dtype=np.bool_)
    full = error_laws.log_weights(by_side, few, taken)
    for i, j in np.argwhere(few.answered):
        chance = by_side[int(few.side[i, j])][:, j].astype(float)
        one = np.zeros((3, 3), dtype=np.bool_)
        one[i, j] = True
        said = np.where(few.said[i, j] == 1, chance, 1 - chance)
        logs = error_laws.log_weights(by_side, few, one)[:, i]
        assert logs == pytest.approx(np.log(np.maximum(said, 1e-9)), abs=1e-3)
    prior = error_laws.prior_of_people(full, np.array([True, False, True]))
    weights = error_laws.normalised(prior[:, None])[:, 0]
    before, after = np.exp(full[:, 0]).mean(), weights @ np.exp(full[:, 0])
    assert after > before


def test_counts_of_repeats_are_those_of_the_logs():
    logs = dict(list(repeated_gambles(sets=[2]).items())[:2])
    (table,) = repeats.of_logs(logs).values()
    assert len(table.pairs) == 10
    assert table.counts.sum(axis=2).tolist() == [[20] * 10] * 2
    said = Counter(
        int(entry.answer.verdict) for entry in logs["1"] if entry.answer.query.id[2:4] == "bd"
    )
    row = table.counts[table.names.index("1"), table.pairs.index(("b", "d"))]
    assert row.tolist() == [said[1], said[-1], said[0]]
    assert repeats.minority_shares(row) == min(said[1], said[-1]) / 20


def test_a_table_of_subsets_gives_pairs_and_sides(tmp_path):
    path = tmp_path / "subsets.csv"
    path.write_text(
        "subject,trial,set,shown,choice\n1,1,ab,ba,b\n1,2,ab,ab,b\n1,3,abc,abc,a\n2,1,ab,ab,a\n"
    )
    table, sides = repeats.of_subsets(path)
    assert (table.names, table.pairs) == (["1", "2"], [("a", "b")])
    assert table.counts.tolist() == [[[0, 2, 0]], [[1, 0, 0]]]
    assert sides.tolist() == [[1, 2], [1, 1]]


def test_the_extra_spread_finds_that_of_simulated_people():
    rng, total = np.random.default_rng(2), np.full(4000, 30.0)
    same = rng.binomial(30, 0.5, 4000).astype(float)
    differ = rng.binomial(30, np.clip(rng.normal(0.5, 0.1, 4000), 0, 1)).astype(float)
    assert repeats.extra_spread(same, total) < 0.03
    assert repeats.extra_spread(differ, total) == pytest.approx(0.1, abs=0.01)


def test_the_held_out_likelihood_is_that_of_an_integral():
    """For the law of flips and one power that decides all pairs alike, two integrals are left."""
    table = repeats.of_logs({"1": repeated_gambles(sets=[2])["1"]})[2]
    pairs = table._replace(pairs=table.pairs[:2], counts=table.counts[:, :2])
    drawn = repeats.draws(n := scaled(30_000, 100_000), 3)
    found, full = repeats.held_out_pairs("flips", pairs, 2, drawn)
    assert full.shape == (n, 1)

    def likes_safe(power: float) -> list[bool]:
        worth = {
            name: chance * (prize / 31.43) ** math.exp(min(power, 5.0))
            for name, (chance, prize) in GAMBLES[2].items()
        }
        return [worth[right] > worth[left] for left, right in pairs.pairs]

    def likelihood(power: float, lapse: float, pair: int) -> float:
        left, right, _ = pairs.counts[0, pair]
        yes = lapse / 2 if likes_safe(power)[pair] else 1 - lapse / 2
        return float(yes**left * (1 - yes) ** right)

    def integral(of: list[int]) -> float:
        def inside(lapse: float, z: float) -> float:
            power = repeats.POWER[0] + repeats.POWER[1] * z
            product = math.prod(likelihood(power, lapse, pair) for pair in of)
            return product * norm.pdf(z) * beta.pdf(lapse, *repeats.LAPSE)

        # the gambles have equal expected values, so the preference turns at a power near 1
        turn = -repeats.POWER[0] / repeats.POWER[1]
        parts = [(-7.0, turn - 0.005), (turn - 0.005, turn + 0.005), (turn + 0.005, 7.0)]
        error = {"epsabs": scaled(1e-5, 1e-6), "epsrel": scaled(1e-3, 1e-4)}
        return sum(dblquad(inside, a, b, 1e-9, 1, **error)[0] for a, b in parts)

    both, per_pair = full[:, 0], [integral([0]), integral([1])]
    assert np.exp(both).mean() == pytest.approx(integral([0, 1]), rel=0.1)
    assert -3 < found[0] < 0
    assert all(x > 0 for x in per_pair)


def test_a_repeated_person_is_scored_by_answers_that_were_not_told():
    log = repeated_gambles()["5"]
    rows = comparators.on_repeats(comparators.MAKES["BradleyTerryComparator"], log, scaled(2, 5), 0)
    assert rows.shape == (20, 5)
    assert rows[:, 3].tolist() == [20.0] * 20  # of pairs that were not told of
    assert ((rows[:, 1] >= 0) | np.isnan(rows[:, 1])).all()
    assert (rows[:, 4] / rows[:, 3] < 0).all()


@pytest.mark.slow
def test_the_report_is_written_from_tables_of_the_stated_form(tmp_path):
    """A made-up folder, whose people answer at random."""
    rng = np.random.default_rng(0)
    head = "participant,set,left,right,left_better,right_better,indifferent\n"
    pairs = [(a, b) for a in "abcde" for b in "abcde" if a < b]
    rows = [
        f"{who},{number},{a},{b},{n},{4 - n},1"
        for who in range(4)
        for number in (1, 2)
        for a, b in pairs
        for n in [rng.integers(0, 5)]
    ]
    (tmp_path / "gambles_45_times.csv").write_text(head + "\n".join(rows) + "\n")
    rows = [
        f"{who},{i},{a}{b},{a}{b},{rng.choice([a, b])}"
        for who in range(6)
        for i, (a, b) in enumerate(pairs)
    ]
    text = "subject,trial,set,shown,choice\n" + "\n".join(rows) + "\n"
    (tmp_path / "gambles_every_subset.csv").write_text(text)
    columns = [f"{what}{i}{side}" for side in "ab" for what in "xp" for i in range(1, 5)]
    rows = [f"{i},{10 + i},{200 - i},,,0.5,0.5,,,{90 + i},,,,1,,," for i in range(1, 11)]
    text = ",".join(["Choice", *columns]) + "\n" + "\n".join(rows) + "\n"
    (tmp_path / "lotteries_questions.csv").write_text(text)
    rows = [
        f"{who},{i},{i},{rng.integers(0, 2)},{rng.choice(['a', 'b'])}"
        for who in range(6)
        for i in range(1, 11)
    ]
    text = "subject,question,rank,a_on_top,preferred\n" + "\n".join(rows) + "\n"
    (tmp_path / "lotteries_answers.csv").write_text(text)
    page = quick_report("benchmarks.people.answers_of_people", tmp_path, str(tmp_path))
    for heading in ("The same question again", "Laws of error on lotteries", "PersonTutor"):
        assert f"## {heading}" in page
    assert "PosteriorComparator" in page


def test_the_page_names_what_person_tutor_draws_from():
    assert answers_of_people.DRAWN_FROM._fields[-2:] == tuple(
        answers_of_people.side_bias(np.array([3.0, 5.0]), np.array([10.0, 10.0]))
    )


def test_laws_of_equal_predict_as_a_plain_sum_over_the_draws_does():
    query = Query("gamble", *BAGS[0])
    other = Query("gamble turned", *BAGS[0][::-1])
    said = [Answer(query, 0), Answer(other, 1), Answer(query, -1), Answer(query, 1)]
    log = AnswerLog(k=3)
    for answer in said:
        log.append(answer)
    t, (places,) = equal_laws.by_pair([log.answers()])
    assert len(t) == 1
    assert places.tolist() == [2, 1, 1, 0]  # an answer to the turned pair is turned
    one = equal_laws.Dealt("1", np.array([0.0, 1, 1]), np.array([1.0, 0, 1]))
    drawn = equal_laws.draws(2, 50)
    for law in (equal_laws.OLDER, equal_laws.NOW):
        (found,), (worth,) = equal_laws.predicted(drawn, t, law, [one])
        width = equal_laws.widths(equal_laws.WIDTHS[law[1]], drawn.chance)
        assert (width <= (0.02 if law == equal_laws.OLDER else 1.0)).all()
        share, total, after = equal_laws.SHARES[law[0]], 0.0, np.zeros(2)
        for g, c, p, w in zip(drawn.gaps, drawn.precision, drawn.lapse, width, strict=True):
            left, right = (expit(c * (way * g @ t[0] - w)) for way in (1, -1))
            equal = p * share + (1 - p) * (1 - left - right)
            left, right = (p * (1 - share) / 2 + (1 - p) * each for each in (left, right))
            total += right * equal
            after += right * equal * np.array([left, equal])
        assert found == pytest.approx(np.log(after / total).mean())
        assert 1 <= worth <= 50
