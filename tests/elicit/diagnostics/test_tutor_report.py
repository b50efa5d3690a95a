"""Diagnostics recover what simulated tutors are, and hold a comparator only to answers that it has
not seen.
"""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.special import betaincinv, expit, gammaln
from scipy.stats import binomtest

from elicit import (
    AlwaysAsk,
    Answer,
    AnswerLog,
    Answers,
    BradleyTerryComparator,
    BradleyTerryTutor,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    OpenOrderPosterior,
    PolytopeComparator,
    PosteriorComparator,
    Query,
    TruthfulTutor,
    Verdict,
    compare_held_out,
    held_out,
    tutor_report,
)
from elicit.comparators.bradley_terry.first_particles import CONCENTRATION
from elicit.diagnostics.held_out import wilson
from elicit.diagnostics.tutor_report import exact_share
from tests.noisy_cases import log_terms
from tests.scale_arithmetic import dominance, tail_sums
from tests.thoroughness import quick_first, scaled

FAST = 300  # particles enough for a rough check


def scale(k, rng):
    return np.concatenate([[0.0], np.cumsum(rng.dirichlet(np.ones(k - 1)))])


def differences(k, n, rng, repeated=0):
    """n differences of share vectors; the last ``repeated`` of them are the first ones the other
    way round.
    """
    d = rng.dirichlet(np.ones(k), n - repeated) - rng.dirichlet(np.ones(k), n - repeated)
    return np.concatenate([d, -d[:repeated]])


def a_log(k=4, n=60, seed=0, rate=0.1):
    rng = np.random.default_rng(seed)
    d = differences(k, n, rng, n // 4)
    return Answers(d, FlippingTutor(scale(k, rng), rate, seed).signs(d))


TUTORS = {
    "truthful": (lambda values, seed: TruthfulTutor(values), 0.0, math.inf),
    "flips 10%": (lambda values, seed: FlippingTutor(values, 0.1, seed), 0.2, math.inf),
    "flips 20%": (lambda values, seed: FlippingTutor(values, 0.2, seed), 0.4, math.inf),
    "precision 25": (lambda values, seed: BradleyTerryTutor(values, 25.0, seed), 0.0, 25.0),
}


@pytest.mark.parametrize(
    "name", quick_first(["flips 10%", "truthful", "precision 25", "flips 20%"], 1)
)
def test_intervals_cover_what_simulated_tutors_are(name):
    make, lapse, precision = TUTORS[name]
    (logs, most), covered, estimates = scaled((12, 2), (30, 4)), np.zeros(4), []
    for seed in range(logs):
        rng = np.random.default_rng([seed, 7])
        tutor, d = make(scale(5, rng), seed), differences(5, 80, rng, 20)
        report = tutor_report(Answers(d, tutor.signs(d)), particles=FAST, seed=seed)
        true = tutor.realised_error_rate
        found = np.array(
            [report.error_rate, report.error_rate_repeated, report.lapse, report.precision]
        )
        assert ((found[:, 1] <= found[:, 0]) & (found[:, 0] <= found[:, 2])).all()
        wanted = np.array([true, true, lapse, precision])
        covered += (found[:, 1] - 1e-12 <= wanted) & (wanted <= found[:, 2] + 1e-12)
        estimates.append(
            (report.error_rate.value - true, report.error_rate.high - report.error_rate.low)
        )
    # of 30 intervals that hold with probability .95, fewer than 26 do once in 60 times
    assert (covered[:2] >= logs - most).all()
    # the prior takes a lapse of 40% for unlikely: of 120 intervals 98 held it, the others were low
    assert covered[2] >= logs - (3 if lapse == 0.4 else 1) * most
    assert covered[3] == 0 if precision == math.inf else covered[3] >= logs - 1.5 * most
    error, width = np.array(estimates).T
    assert abs(error.mean()) < 0.03
    assert np.sqrt((error**2).mean()) < 0.035
    assert width.mean() < 0.12, "an interval that holds everything covers the truth too"


def by_quadrature(answers):
    """The posterior for k = 3 in its three numbers (gap, precision, lapse), on a grid: lapse
    (mean), precision (quantiles), share of wrong answers (mean), probability that each answer is
    wrong."""
    u = np.unique(
        np.concatenate([np.linspace(-100, 100, 101), np.linspace(-4, 4, 301)])
    )  # logit of the first gap
    first, second, log_c = expit(u), expit(-u), np.log(30.0) + np.linspace(-10, 10, 61)
    lapses = (np.arange(30) + 0.5) / 30
    nodes, mass = np.polynomial.legendre.leggauss(24)
    low, high = CONCENTRATION
    shapes = low * (high / low) ** ((nodes + 1) / 2) / 2
    prior = sum(
        m * np.exp(gammaln(2 * a) - 2 * gammaln(a) + a * np.log(first) + a * np.log(second))
        for m, a in zip(mass, shapes, strict=True)
    ) * np.gradient(u)
    t = tail_sums(answers.d) * np.where(answers.y == 0, 1, answers.y)[:, None]
    tied = answers.y == 0
    gaps, density = np.stack([first, second], axis=1), np.empty((len(u), len(log_c), len(lapses)))
    for j, i in np.ndindex(density.shape[1:]):
        density[:, j, i] = log_terms(np.exp(log_c[j]) * gaps, t, tied, lapses[i]).sum(axis=1)
    density = np.exp(density - density.max()) * prior[:, None, None]
    density *= (1 - lapses) ** 3 * np.exp(-(((log_c - np.log(30.0)) / 2.5) ** 2) / 2)[:, None]
    density /= density.sum()
    of_u, of_c = density.sum(axis=(1, 2)), density.sum(axis=(0, 2))
    quantiles = np.exp(np.interp([0.5, 0.025, 0.975], np.cumsum(of_c) - of_c / 2, log_c))
    wrong = (t @ gaps.T < 0) @ of_u
    return density.sum(axis=(0, 1)) @ lapses, quantiles, wrong[~tied].mean(), wrong


@pytest.mark.parametrize(
    "make",
    quick_first([lambda e: FlippingTutor(e, 0.2, 1), lambda e: BradleyTerryTutor(e, 12, 1)], 1),
)
def test_the_model_agrees_with_a_sum_over_all_scales(make):
    rng = np.random.default_rng(2)
    d = differences(3, 30, rng)
    y = make([0.0, 0.3, 1.0]).signs(d)
    y[:3] = 0
    answers = Answers(d, y)
    lapse, precision, error_rate, wrong = by_quadrature(answers)
    report = tutor_report(answers, particles=1000)
    assert report.lapse.value == pytest.approx(lapse, abs=0.02)
    assert report.precision[:2] == pytest.approx(precision[:2], rel=0.35)
    assert report.precision.high == pytest.approx(
        precision[2], rel=1.0
    )  # far out in the prior's tail
    assert report.error_rate.value == pytest.approx(error_rate, abs=0.01)
    found = dict(report.doubtful)
    assert {str(row) for row in range(3, 30) if wrong[row] > 0.56} <= found.keys()
    assert [found[name] for name in found] == pytest.approx(
        [wrong[int(name)] for name in found], abs=0.06
    )
    assert list(found.values()) == sorted(found.values(), reverse=True)


def test_shares_have_the_intervals_of_the_textbook():
    for count, n in [(0, 7), (7, 7), (3, 10), (41, 80)]:
        for level in (0.9, 0.95):
            reference = binomtest(count, n).proportion_ci(level, "wilson")
            assert wilson(count, n, level) == pytest.approx(
                (count / n, reference.low, reference.high), abs=1e-12
            )
            share, low, high = exact_share(count, n, level)
            assert share == count / n
            assert count == 0 or betaincinv(count, n - count + 1, (1 - level) / 2) == pytest.approx(
                low
            )
            assert count == n or betaincinv(count + 1, n - count, (1 + level) / 2) == pytest.approx(
                high
            )
    assert math.isnan(exact_share(0, 0).value)
    assert math.isnan(wilson(0, 0).low)


def queries(d):
    return [
        Query(f"q{i}", np.clip(row, 0, None), np.clip(-row, 0, None)) for i, row in enumerate(d)
    ]


def test_repeated_questions_count_in_independent_couples_either_way_round():
    a, b, c = [1.0, -2.0, 1.0], [0.5, -1.5, 1.0], [1.0, -1.5, 0.5]
    d = np.array([a, a, b, a, b, b, a, [0.0, 0.0, 0.0], c, [0.0, 0.0, 0.0], c])
    d[[1, 4]] *= -1
    y = [1, -1, 1, 1, 1, 0, -1, 1, 0, -1, 0]
    report = tutor_report(Answers(d, y), particles=FAST)
    # a: (+, +), (+, -); b: (+, -), and a tie left over; c: (0, 0); nothing against nothing is no
    # question
    assert (report.repeated, report.couples) == (3, 4)
    assert report.consistency == exact_share(2, 4)
    value, low, high = report.error_rate_repeated
    assert value == high == 0.5, "they differ more often than coins would"
    assert 2 * low * (1 - low) == pytest.approx(exact_share(2, 3).low)
    assert (report.answers, report.ties) == (11, 3)

    nothing = tutor_report(Answers([a, b], [1, 1]), particles=FAST)
    assert (nothing.repeated, nothing.couples) == (0, 0)
    assert np.isnan([nothing.consistency, nothing.error_rate_repeated]).all()
    assert "no question was asked twice" in str(nothing)


def test_answers_against_the_order_of_the_levels_are_counted():
    d = [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, -2.0, 1.0]]
    report = tutor_report(Answers(d, [1, 1, -1, 0, 1]), particles=FAST)
    assert (report.by_order, report.against_order) == (3, 2)
    assert "2 of 3 answers that the order of the levels decides defy it" in str(report)
    assert dict(report.doubtful) == pytest.approx({"1": 1.0, "2": 1.0}), (
        "no scale agrees with these"
    )
    assert report.error_rate.low >= 0.5


def sided_log(bias, n=150, exchange=0.5, seed=3):
    """Return answers of a tutor who names the left side blindly in a share ``bias`` of cases."""
    rng = np.random.default_rng(seed)
    tutor = TruthfulTutor(scale(4, rng))
    told = []
    for query in queries(differences(4, n, rng)):
        swapped = bool(rng.random() < exchange)
        shown_left = Verdict.WORSE if swapped else Verdict.BETTER
        told.append(
            Answer(query, shown_left if rng.random() < bias else tutor(query).verdict, swapped)
        )
    return told


def test_a_bias_to_the_side_shown_left():
    for bias in (0.0, 0.3):
        told = sided_log(bias)
        report = tutor_report(told, particles=FAST)
        left = sum((answer.verdict == 1) != answer.swapped for answer in told)
        assert (report.sided, report.exchanged) == (
            len(told),
            sum(answer.swapped for answer in told),
        )
        assert report.left_share == exact_share(left, len(told))
        assert report.left_p == pytest.approx(binomtest(left, len(told)).pvalue)
        assert (report.left_p < 0.05) == (bias > 0)
        assert (": a bias" if bias else ": no sign of a bias") in str(report)
        assert report.left_share.low <= 0.5 + bias / 2 <= report.left_share.high
    left_first = tutor_report(sided_log(0.0, n=20, exchange=0.0), particles=FAST)
    assert (left_first.sided, math.isnan(left_first.left_p)) == (20, True)
    assert "never exchanged" in str(left_first)
    bare = tutor_report(Answers.of(told, 4), particles=FAST)
    assert (bare.sided, bare.exchanged) == (0, 0)
    assert np.isnan([bare.left_share.value, bare.left_p]).all()
    assert "give the log" in str(bare)
    assert bare.error_rate == report.error_rate, "the model needs no sides"


def test_all_that_a_log_holds_is_counted():
    rng = np.random.default_rng(4)
    asked = queries(differences(3, 8, rng))
    log = AnswerLog(k=3)
    for i, (query, verdict) in enumerate(zip(asked, [1, None, 0, 1, 1, 1, 1, 1], strict=True)):
        log.append(Answer(query, verdict), used=i not in (4, 5))
    log.retract("q3")
    log.retract("q5")
    log.append(Answer(asked[3], Verdict.WORSE))
    report = tutor_report(log, particles=FAST)
    assert (report.answers, report.ties, report.cannot_tell) == (6, 1, 1)
    assert (report.retracted, report.unused, report.couples) == (2, 1, 0)
    assert repr(tutor_report(list(log), particles=FAST)) == repr(report), (
        "entries are as good as their log"
    )
    assert repr(tutor_report(iter(log), 3, particles=FAST)) == repr(report)
    told = [entry.answer for entry in log if not entry.retracted]
    assert tutor_report(told, particles=FAST).error_rate == report.error_rate
    text = str(report)
    assert (
        "6 over 3 levels, 1 of them ties, 1 not learned from; 1 more could not be told, 2 were "
        "retracted" in text
    )
    assert report.error_rate.percent in text


def test_reports_on_next_to_nothing():
    for empty in (
        tutor_report([], k=3),
        tutor_report(AnswerLog(k=3)),
        tutor_report(Answers.none(3)),
    ):
        assert (empty.k, empty.answers, math.isnan(empty.error_rate.value)) == (3, 0, True)
        assert "no answer prefers a side" in str(empty)
        assert "nan" not in str(empty)
    tie = tutor_report(Answers([[1.0, -2.0, 1.0]], [0]))
    assert math.isnan(tie.precision.value)
    one = tutor_report(Answers([[1.0, -2.0, 1.0]], [1]), level=0.9, particles=FAST)
    assert one.lapse == pytest.approx((0.2, 0.0, 1 - 0.1**0.25), abs=0.03), (
        "one answer leaves the prior"
    )
    assert (one.error_rate.low, one.error_rate.high) == (0.0, 1.0)
    assert "90% intervals" in str(one)
    assert "the upper end being the prior's" in str(one)


def test_a_report_is_a_function_of_its_arguments():
    answers = a_log(n=16)
    first = tutor_report(answers, particles=FAST, seed=1)
    assert repr(tutor_report(answers, particles=FAST, seed=1)) == repr(first)
    assert tutor_report(answers, particles=FAST, seed=2).lapse != first.lapse
    narrow = tutor_report(answers, particles=FAST, seed=1, level=0.5)
    for name in ("lapse", "precision", "consistency"):
        inner, outer = getattr(narrow, name), getattr(first, name)
        assert outer.low <= inner.low <= inner.high <= outer.high
        assert inner[1:] != outer[1:]
    sure = tutor_report(Answers([[1.0, -3.0, 2.0]], [1]), particles=FAST, prior=["e3 >= 4*e2"])
    assert sure.error_rate.value == 0.0, "the prior forces it"


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda: tutor_report([]), "the log is empty.*give k"),
        (lambda: tutor_report([], k=0), "must be a whole number of at least 2, not 0"),
        (
            lambda: tutor_report(Answers.none(3), k="a"),
            "must be a whole number of at least 2, not 'a'",
        ),
        (lambda: tutor_report([], k=3, level="a"), "level must be .* not 'a'"),
        (lambda: tutor_report(a_log(), k=5), "4 levels, not k = 5"),
        (lambda: tutor_report(a_log(), level=1.0), "level.*1.0"),
        (lambda: tutor_report(sided_log(0.0, n=2), k=3), "4 levels, but the answers are about 3"),
        (lambda: held_out(Dominance(4), a_log(), folds=1), "not 1"),
        (lambda: held_out(Dominance(4), a_log(), folds="each"), "not 'each'"),
        (lambda: held_out(Dominance(4), a_log(n=8), folds=7), "different pairs, 6, not 7"),
        (lambda: held_out(Dominance(4), Answers.none(4)), "different pairs, 0, not 10"),
        (lambda: held_out(Dominance(4), a_log(), level=0.0), "level"),
        (lambda: compare_held_out({"a": Dominance(4), "b": Dominance(5)}, a_log(n=12), 3), "5"),
        (lambda: held_out(Dominance(3), a_log()), "4 levels, not k = 3"),
    ],
)
def test_what_cannot_be_reported_is_said(call, complaint):
    with pytest.raises(ValueError, match=complaint):
        call()
    with pytest.raises(TypeError, match=r"AnswerLog\.read"):
        tutor_report("answers.jsonl")


@dataclass(frozen=True)
class Recorder:
    """Knows nothing but what it was told, and writes down what it is asked, with what it knew
    then.
    """

    k: int
    asked: list = field(default_factory=list)
    known: tuple = ()

    values = np.array([0.0, 0.25, 0.5, 1.0])

    def bounds(self, d):
        raise NotImplementedError

    def compare(self, d):
        self.asked.extend((tuple(row), self.known) for row in d.tolist())
        return np.full(len(d), Verdict.UNKNOWN, dtype=np.int8)

    def update(self, answers):
        rows = zip(map(tuple, answers.d.tolist()), answers.y.tolist(), answers.ids, strict=True)
        return type(self)(self.k, self.asked, (*self.known, *rows))


def test_folds_never_show_a_pair_that_is_asked():
    answers, recorder = a_log(n=40), Recorder(4)
    score = held_out(recorder, answers, folds=7)
    assert sorted(d for d, _ in recorder.asked) == sorted(map(tuple, answers.d.tolist())), (
        "each once"
    )
    trainings = {known for _, known in recorder.asked}
    assert len(trainings) == 7
    for d, known in recorder.asked:
        seen = {row for row, _, _ in known}
        assert d not in seen
        assert tuple(-x for x in d) not in seen
        assert [row[2] for row in known] == sorted((row[2] for row in known), key=int), (
            "in told order"
        )
        assert 40 - 2 * math.ceil(30 / 7) <= len(known) < 40
    assert (score.scored, score.ties, score.decided.value) == (40, 0, 0.0)
    assert np.isnan([score.accuracy.value, score.log_likelihood.value]).all()
    other = Recorder(4)
    held_out(other, answers, folds=7, seed=1)
    assert {known for _, known in other.asked} != trainings


def test_answer_by_answer_each_is_foretold_from_those_before():
    answers, recorder = a_log(n=12), Recorder(4)
    held_out(recorder, answers, "sequential")
    assert [d for d, _ in recorder.asked] == list(map(tuple, answers.d.tolist()))
    assert [[row[2] for row in known] for _, known in recorder.asked] == [
        list(answers.ids[:i]) for i in range(12)
    ]
    assert held_out(recorder, Answers.none(4), "sequential").scored == 0


@pytest.mark.parametrize("folds", [5, "sequential"])
def test_scores_of_a_comparator_that_learns_nothing_are_plain_counts(folds):
    answers = a_log(n=60)
    y = answers.y.copy()
    y[::9] = 0
    tied = Answers(answers.d, y)
    score = held_out(Dominance(4), tied, folds)
    codes, clear = dominance(tail_sums(tied.d)), y != 0
    decided = clear & (codes != 2)
    assert (score.scored, score.ties, score.folds) == (int(clear.sum()), int((~clear).sum()), folds)
    assert score.decided == wilson(int(decided.sum()), int(clear.sum()))
    assert score.accuracy == wilson(int((codes == y)[decided].sum()), int(decided.sum()))
    assert score.wrong.value == pytest.approx(1 - score.accuracy.value)
    signs = np.sign(tied.d @ np.linspace(0, 1, 4))
    assert score.by_values.value == pytest.approx(np.mean(signs[clear] == y[clear]))
    assert (score.contradicted, score.dropped) == (0, 0)
    at_random = held_out(
        AlwaysAsk(4), Answers([[-0.5, 1.0, 0.0, -0.5], [0.0] * 4], [1, 1]), "sequential"
    )
    assert at_random.by_values.value == pytest.approx(0.25), "-1/6 is wrong, and 0 half right"
    # AlwaysAsk calls two identical vectors equal, which neither agrees with the answer nor says the
    # opposite
    assert (at_random.decided.value, at_random.accuracy.value, at_random.wrong.value) == (
        0.5,
        0.0,
        0.0,
    )


def test_log_likelihoods_are_those_of_the_model():
    d = [[-0.1, 0.1], [0.2, -0.2], [-0.3, 0.3], [0.05, -0.05]]
    answers = Answers(d, [1, 1, -1, -1])
    chance = 0.1 + 0.8 * expit(
        7.0 * np.array([0.1, -0.2, -0.3, 0.05])
    )  # of what was said; two levels have one scale
    score = held_out(PosteriorComparator(2, precision=7.0, lapse=0.2), answers, "sequential")
    assert score.log_likelihood.value == pytest.approx(np.log(chance).mean(), rel=1e-12)
    assert score.log_likelihood.low < score.log_likelihood.value < score.log_likelihood.high < 0
    mute = held_out(PosteriorComparator(2, precision=0.0, lapse=0.2), answers, 2)
    assert mute.log_likelihood == pytest.approx([-math.log(2)] * 3)

    answers = a_log(n=40)
    model = BradleyTerryComparator(4, n_boot=20)
    score = held_out(model, answers, "sequential")
    point = [model.update(answers[:i]).probability(answers.d[i : i + 1])[2][0] for i in range(40)]
    said = np.where(answers.y > 0, point, 1 - np.array(point))
    assert score.log_likelihood.value == pytest.approx(np.log(said).mean())


def test_an_open_order_is_scored_by_its_probability_of_an_answer():
    answers = a_log(n=6)
    model = OpenOrderPosterior(4, seed=0)
    score = held_out(model, answers, "sequential")
    said = [
        model.update(answers[:i]).answer_probability(answers.d[i : i + 1] * answers.y[i])[0]
        for i in range(6)
    ]
    assert score.log_likelihood.value == pytest.approx(np.log(said).mean())


class Sure(Recorder):
    def probability(self, d):
        return np.ones(len(d))


def test_a_probability_of_zero_is_not_smoothed_over():
    score = held_out(
        Sure(4), Answers([[0, 1, 0, -1], [1, 0, 0, -1], [0, 1, -1, 0]], [1, 1, -1]), "sequential"
    )
    assert score.log_likelihood[:2] == (-math.inf, -math.inf)
    assert "-inf" in str(score)


def test_contradictions_are_dropped_one_by_one_and_counted():
    answers = a_log(k=4, n=60, rate=0.2, seed=2)
    score = held_out(PolytopeComparator(4), answers, "sequential")
    comparator, lost, right, decided = PolytopeComparator(4), 0, 0, 0
    for i in range(len(answers)):
        verdict = comparator.compare(answers.d[i])[0]
        decided += verdict != Verdict.UNKNOWN
        right += verdict == answers.y[i]
        try:
            comparator = comparator.update(answers[i : i + 1])
        except InconsistentAnswers:
            lost += 1
    assert lost > 0
    assert (score.dropped, score.contradicted) == (lost, 1)
    assert score.accuracy == wilson(right, decided)
    assert score.decided == wilson(decided, 60)
    folded = held_out(PolytopeComparator(4), answers, 6)
    assert folded.contradicted == 6
    assert folded.dropped > 3 * lost
    assert f"contradictory answers in 6, {folded.dropped} dropped" in str(folded)
    truthful = held_out(PolytopeComparator(4), a_log(rate=0.0), 6)
    assert (truthful.dropped, truthful.contradicted, truthful.wrong.value) == (0, 0, 0.0)
    assert "dropped" not in str(truthful)


def test_comparators_side_by_side():
    answers = a_log(k=4, n=80, rate=0.2, seed=1)
    models = {
        "posterior": PosteriorComparator(4, lapse=0.2),
        "polytope": PolytopeComparator(4),
        "order": Dominance(4),
    }
    table = compare_held_out(models, answers, 4, seed=3)
    assert list(table) == list(models)
    for name, model in models.items():
        assert repr(table[name]) == repr(held_out(model, answers, 4, seed=3))
    assert table["posterior"].accuracy.value > table["polytope"].accuracy.value + 0.03, (
        "the reliable tutor errs"
    )
    assert table["posterior"].decided.value > table["order"].decided.value
    lines = str(table).splitlines()
    assert len(lines) == 1 + 2 * len(models)
    starts = [
        lines[0].index(head) for head in ("decided", "right of", "wrong of", "right by", "log-")
    ]
    for line in lines[1:4]:
        assert all(line[i - 1] == " " and line[i] not in " " for i in starts)
    assert lines[2].split("  ")[-1].strip() == "-", "a polytope has no probabilities"
    assert lines[4] == "posterior: 80 answers held out in 4 folds, 0 ties not scored"
    assert len(compare_held_out({}, answers)) == 0
