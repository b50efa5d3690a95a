"""The best of a list, or its order: right, with few questions, and unharmed by bad answers."""

import re
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elicit import (
    AlwaysAsk,
    Answer,
    Answers,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    StaleAnswer,
    Status,
    Tier,
    TruthfulTutor,
    Verdict,
    choose,
)
from tests.scale_arithmetic import dot, gaps, tail_sums
from tests.thoroughness import covering, examples, on_any_processor, scaled

K = 5
HIDDEN = np.array([0, 8, 20, 25, 80])


def shares(seed, n, k=K):
    return np.random.default_rng(seed).dirichlet(np.ones(k), n)


def run(choice, tutor):
    asked = []
    while queries := choice.ask():
        asked += queries
        choice.tell([tutor(query) for query in queries])
    return asked


def true_order(vectors, values=HIDDEN):
    return np.argsort(-dot(tail_sums(vectors), gaps(values)), kind="stable").tolist()


COMPARATORS = [AlwaysAsk(K), Dominance(K), PolytopeComparator(K)]


@pytest.mark.parametrize(
    ("comparator", "order", "n"), covering(COMPARATORS, [False, True], [17, 1, 2, 3])
)
def test_a_truthful_tutor_leads_to_the_truth(comparator, order, n):
    for seed in range(scaled(3, 6)):
        vectors = shares(seed, n)
        choice = choose(vectors, comparator, order)

        def tutor(query, choice=choice):
            assert choice.result().comparator.compare(query.d)[0] == Verdict.UNKNOWN, (
                "else it need not be asked"
            )
            return TruthfulTutor(HIDDEN)(query)

        asked = run(choice, tutor)
        result = choice.result()
        assert result.best == true_order(vectors)[0]
        assert result.order == (tuple(true_order(vectors)) if order else None)
        assert result.asked == len(asked) == len(result.answers)
        if isinstance(comparator, PolytopeComparator):
            assert result.comparator.answers.ids == result.answers.ids
            assert len(comparator.answers) == 0
        assert result.decided.get("tutor", 0) == len(asked)
        assert result.status is Status.DONE
        assert choice.ask() == ()


@given(
    st.lists(st.tuples(*[st.integers(0, 4)] * 3), min_size=1, max_size=9),
    st.booleans(),
    st.booleans(),
)
@examples(150)
def test_ties_keep_the_order_of_the_list(counts, order, guessed):
    """Small integer vectors on a scale whose gaps are exact: ties and copies everywhere."""
    vectors = np.array(counts, dtype=float)
    values = [0, 1, 2] if guessed else [0, 1, 4]
    for comparator in (AlwaysAsk(3), Dominance(3)):
        choice = choose(vectors, comparator, order, check_totals=False)
        run(choice, TruthfulTutor(values))
        wanted = np.argsort(-(vectors @ values), kind="stable").tolist()
        result = choice.result()
        assert result.best == wanted[0]
        if order:
            assert list(result.order) == wanted


@pytest.mark.parametrize(
    ("vectors", "comparator", "order", "decided"),
    [
        ([[0.5, 0.5, 0]], AlwaysAsk(3), (0,), set()),
        (np.tile(shares(0, 1, 3), (6, 1)), AlwaysAsk(3), (0, 1, 2, 3, 4, 5), {"equal"}),
        (
            [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0]],
            Dominance(3),
            (2, 1, 3, 0),
            {"dominance"},
        ),
    ],
    ids=["one", "identical", "dominated"],
)
def test_what_every_scale_orders_needs_no_question(vectors, comparator, order, decided):
    choice = choose(vectors, comparator, order=True)
    assert choice.ask() == ()
    result = choice.result()
    assert (result.best, result.order, result.asked) == (order[0], order, 0)
    assert set(result.decided) == decided
    assert choose(vectors, comparator).ask() == ()


@on_any_processor
def test_the_number_of_questions():
    for seed in range(scaled(1, 5)):
        n = scaled(20, 30)
        vectors = shares(seed, n)
        tutor = TruthfulTutor(HIDDEN)
        always = run(choose(vectors, AlwaysAsk(K)), tutor)
        by_order = run(choose(vectors, Dominance(K)), tutor)
        learning = run(choose(vectors, PolytopeComparator(K)), tutor)
        assert len(always) == n - 1
        assert len(learning) <= len(by_order) < 20
        assert len(learning) <= 8
        ordering = run(choose(vectors, PolytopeComparator(K), order=True), tutor)
        assert (
            len(ordering)
            < len(run(choose(vectors, Dominance(K), order=True), tutor))
            <= n * np.log2(n)
        )


def pair_of(query):
    d = query.d + 0.0
    return min(d.tobytes(), (0.0 - d).tobytes())


@pytest.mark.parametrize("comparator", COMPARATORS, ids=lambda c: type(c).__name__)
@pytest.mark.parametrize("order", [False, True])
def test_no_pair_is_asked_twice(comparator, order):
    steps = np.arange(12)[:, None] * np.array([[0.25, -0.5, 0, 0.25, 0]]) / 32 + np.array(
        [[0.2, 0.4, 0.1, 0.2, 0.1]]
    )
    grid = np.round(steps * 1024) / 1024  # equal steps, so differences repeat to the last bit
    for vectors in (grid, shares(2, 12)):
        for tutor in (
            TruthfulTutor(HIDDEN),
            lambda q: Answer(q, None),
            lambda q: Answer(q, Verdict.EQUAL),
        ):
            asked = run(choose(vectors, comparator, order), tutor)
            assert max(Counter(map(pair_of, asked)).values(), default=0) <= 1


def test_a_known_pair_is_counted_as_known():
    base, step = np.array([0.25, 0.5, 0.25]), np.array([0.125, -0.25, 0.125])
    for values, order, asked in (([0, 3, 4], (2, 0, 1), 2), ([0, 1, 2], (0, 1, 2), 1)):
        choice = choose([base, base + step, base - step], AlwaysAsk(3), order=True)
        assert len(run(choice, TruthfulTutor(values))) == asked
        assert choice.result().order == order
        assert choice.result().decided == {"tutor": asked, "known": 1}

    learned = choose([base, base + step], PolytopeComparator(3), order=True)
    run(learned, TruthfulTutor([0, 1, 10]))
    assert learned.result().decided == {"tutor": 1}, "though the comparator can tell by now"


def test_equal_is_equal_from_then_on():
    """Whatever the comparator makes of it later, and for another pair with the same difference
    too.
    """

    class Waking(Dominance):
        def update(self, answers):
            return PolytopeComparator(3).update(
                Answers([[-0.2, 1.0, -0.8]], [1])
            )  # the middle is worth .8

    base, step = np.array([0.25, 0.5, 0.25]), np.array([0.125, -0.25, 0.125])
    choice = choose([base, base + step, base - step], Waking(3), order=True)
    (query,) = choice.ask()
    assert abs(query.d[0]) == 0.125
    choice.tell([Answer(query, Verdict.EQUAL)])
    assert choice.ask() == ()
    assert choice.result().order == (0, 2, 1), "the comparator would say 2, 0, 1"
    assert choice.result().decided["known"] == 1


@on_any_processor
def test_a_wrong_guess_costs_little():
    """The best guess has the whole order upside down: still far from the 496 pairs, or 190."""
    n, most = scaled((20, 85), (32, 160))
    lengths = np.cumsum(np.random.default_rng(0).random(n) / n)[:, None] + 0.1
    vectors = np.array([[0.2, 0.6, 0.2]]) + lengths * np.array([[0.1, -0.21, 0.11]])
    hidden = [0, 90, 100]
    assert true_order(vectors, hidden) == true_order(vectors, AlwaysAsk(3).values)[::-1]
    choice = choose(vectors, AlwaysAsk(3), order=True)
    asked = run(choice, TruthfulTutor(hidden))
    assert list(choice.result().order) == true_order(vectors, hidden)
    assert len(asked) < most


def test_the_same_problem_asks_the_same_queries():
    ids = [
        [q.id for q in run(choose(shares(0, 10), Dominance(K)), TruthfulTutor(HIDDEN))]
        for _ in range(2)
    ]
    assert ids[0] == ids[1]
    assert len(set(ids[0])) == len(ids[0])
    assert set(ids[0]).isdisjoint(
        q.id for q in run(choose(shares(1, 10), Dominance(K)), TruthfulTutor(HIDDEN))
    )


def test_a_question_stays_until_it_is_answered_and_no_other_answer_counts():
    choice = choose(shares(0, 30), Dominance(K))
    (query,) = choice.ask()
    choice.tell([])
    tutor = TruthfulTutor(HIDDEN)
    stranger = Query("stranger", query.left, query.right)
    for answers in (
        [tutor(stranger)],
        [tutor(query), tutor(stranger)],
        [tutor(query), tutor(query)],
    ):
        with pytest.raises(StaleAnswer, match="pending"):
            choice.tell(answers)
        assert choice.ask() == (query,)
        assert choice.result().asked == 0
    choice.tell([tutor(query)])
    assert choice.ask()[0].id != query.id
    with pytest.raises(StaleAnswer, match=query.id):
        choice.tell([tutor(query)])
    assert choice.result().asked == 1


class Refusing(Dominance):
    """Finds a contradiction in every second answer."""

    count = 0

    def update(self, answers):
        Refusing.count += 1
        if Refusing.count % 2:
            raise InconsistentAnswers("no", [(0, answers.ids[0])], False)
        return self


@pytest.mark.parametrize("order", [False, True])
def test_a_contradiction_changes_nothing(order):
    vectors, tutor = shares(0, 12), TruthfulTutor(HIDDEN)
    choice, plain = choose(vectors, Refusing(K), order), choose(vectors, Dominance(K), order)
    while queries := choice.ask():
        before = choice.result()
        with pytest.raises(InconsistentAnswers):
            choice.tell([tutor(q) for q in queries])
        after = choice.result()
        assert choice.ask() == queries
        assert replace(after, guarantee=before.guarantee).__dict__ == vars(before)
        assert after.loss_bound == before.loss_bound
        assert [q.id for q in plain.ask()] == [q.id for q in queries]
        choice.tell([tutor(q) for q in queries])
        plain.tell([tutor(q) for q in queries])
    assert choice.result().order == plain.result().order


def test_an_error_after_the_update_changes_nothing_either():
    class Breaking(Dominance):
        broken = False

        def compare(self, d):
            if Breaking.broken:
                raise RuntimeError("broken")
            return super().compare(d)

        def update(self, answers):
            return Breaking(self.k)

    choice = choose(shares(0, 30), Breaking(K))
    (query,) = choice.ask()
    Breaking.broken = True
    with pytest.raises(RuntimeError):
        choice.tell([Answer(query, Verdict.EQUAL)])
    Breaking.broken = False
    assert choice.ask() == (query,)
    assert choice.result().asked == 0
    run(choice, TruthfulTutor(HIDDEN))
    assert choice.result().best == true_order(shares(0, 30))[0]


@pytest.mark.parametrize("order", [False, True])
@pytest.mark.parametrize("comparator", COMPARATORS, ids=lambda c: type(c).__name__)
def test_cannot_tell_leaves_the_best_guess(comparator, order):
    vectors = shares(4, 15)
    choice = choose(vectors, comparator, order)
    asked = run(choice, lambda q: Answer(q, None))
    result = choice.result()
    assert result.status is Status.UNSURE
    assert result.asked == result.cannot_tell == len(asked) > 0
    assert len(result.answers) == 0
    assert "tutor" not in result.decided
    guess = true_order(vectors, comparator.values)
    assert result.best == guess[0]
    if order:
        assert list(result.order) == guess


@on_any_processor
@pytest.mark.parametrize("order", [False, True])
def test_the_budget(order):
    vectors, tutor = shares(5, scaled(12, 20)), TruthfulTutor(HIDDEN)
    full = len(run(choose(vectors, Dominance(K), order), tutor))
    for budget in (0, 1, full // 2, full - 1, full, full + 5):
        choice = choose(vectors, Dominance(K), order, max_queries=budget)
        asked = run(choice, tutor)
        result = choice.result()
        assert len(asked) == result.asked == min(budget, full)
        if budget < full:
            assert result.status is Status.GUESSED
            assert result.decided["guess"] > 0
        else:
            assert result.status is Status.DONE
            assert "guess" not in result.decided
            assert result.best == true_order(vectors)[0]
        if budget == 0:
            guess = true_order(vectors, Dominance(K).values)
            assert result.best == guess[0]
            assert result.order == (tuple(guess) if order else None)


@on_any_processor
def test_a_result_at_any_time():
    vectors = shares(6, scaled(8, 20))
    for order in (False, True):
        choice = choose(vectors, PolytopeComparator(K), order)
        while queries := choice.ask():
            result = choice.result()
            assert result.status is Status.WAITING
            budgeted = choose(vectors, PolytopeComparator(K), order, max_queries=result.asked)
            run(budgeted, TruthfulTutor(HIDDEN))
            assert (budgeted.result().best, budgeted.result().order) == (result.best, result.order)
            choice.tell([TruthfulTutor(HIDDEN)(q) for q in queries])


@on_any_processor
@pytest.mark.parametrize("order", [False, True])
@pytest.mark.parametrize("rate", [0.05, 0.15, 0.5])
def test_an_erring_tutor_ends_it_all_the_same(order, rate):
    """Answers may run in circles; the questions end, and the result is an order of all vectors."""
    for seed in range(scaled(2, 5)):
        vectors = shares(seed, 15)
        choice = choose(vectors, Dominance(K), order)
        asked = run(choice, FlippingTutor(HIDDEN, rate, seed))
        assert len(asked) <= 15 * 14 / 2
        result = choice.result()
        assert result.status is Status.DONE
        if order:
            assert sorted(result.order) == list(range(15))
            assert result.order[0] == result.best


def test_questions_and_the_result_name_alternatives_and_levels():
    names, labels = [f"ward {i}" for i in range(20)], ["died", "severe", "moderate", "mild", "well"]
    choice = choose(shares(7, 20), Dominance(K), names=names, labels=labels)
    asked = run(choice, TruthfulTutor(HIDDEN))
    assert asked
    assert all(query.about.count("ward") == 2 and query.labels == tuple(labels) for query in asked)
    assert re.search(r"left:  .*% (died|severe|moderate|mild|well)", str(asked[0]))
    result = choice.result()
    assert result.name == names[result.best]
    plain = run(choose(shares(7, 20), Dominance(K)), TruthfulTutor(HIDDEN))
    assert [query.id for query in plain] == [query.id for query in asked]
    assert plain[0].labels is None
    assert set(result.decided) <= {tier.name.lower() for tier in Tier}
    assert {type(count) for count in result.decided.values()} == {int}


@pytest.mark.parametrize(
    ("vectors", "more", "complaint"),
    [
        (np.ones((2, 4)) / 4, {}, r"\(n, 5\)"),
        (np.empty((0, 5)), {}, "nothing to choose"),
        ([[0, 0, 0, 0, np.inf]], {}, "finite"),
        (
            np.ones((2, 5)),
            {"names": ["a"]},
            "names must be None or 2 names, one for each of the vectors",
        ),
        (np.ones((2, 5)), {"names": "ab"}, "names must be None or 2 names, .* not 'ab'"),
        (
            np.ones((2, 5)),
            {"labels": ["a", "b"]},
            "labels must be 5 names, one a level, .* there are 2, .* pass the names of "
            "alternatives as names=",
        ),
        (
            np.ones((2, 5)),
            {"labels": ["a", "b", "c"]},
            "labels must be None or 5 names, one a level, worst first, not",
        ),
        (np.ones((2, 5)), {"labels": "abcde"}, "labels must be None or 5 names, .* not 'abcde'"),
        (np.ones((2, 5)), {"max_queries": -1}, "max_queries"),
        (np.ones((2, 5)), {"max_queries": "a"}, "max_queries .* not 'a'"),
        ([[1, 0, 0, 0, 0], [0, 0, 0, 0, 0]], {}, "equal totals"),
        ([[1, 0, 0, 0, 0], [0, 0, 0, 0, 1 + 1e-8]], {}, "check_totals"),
    ],
)
def test_bad_arguments(vectors, more, complaint):
    with pytest.raises(ValueError, match=complaint):
        choose(vectors, Dominance(K), **more)


def test_totals():
    uneven = [[1, 0, 0, 0, 0], [0, 0, 0, 0, 2]]
    assert choose(uneven, Dominance(K), check_totals=False).result().best == 1
    assert choose([[1, 0, 0, 0, 0], [0, 0, 0, 0, 1 + 1e-12]], Dominance(K)).result().best == 1
    assert choose(np.array(uneven) * [[2], [1]] * 1e6, Dominance(K)).result().best == 1


def test_the_callers_array_is_not_kept():
    vectors = shares(0, 5)
    choice = choose(vectors, Dominance(K))
    vectors[:] = 0
    run(choice, TruthfulTutor(HIDDEN))
    assert choice.result().best == true_order(shares(0, 5))[0]


def test_a_choice_is_short_to_read():
    choice = choose(np.eye(3), Dominance(3), names=["a", "b", "c"]).result()
    assert repr(choice) == "Choice(best=2, name='c', status=DONE, asked=0)"
    choice = choose(np.eye(3), Dominance(3), order=True).result()
    assert repr(choice) == "Choice(best=2, order=(2, 1, 0), name='2', status=DONE, asked=0)"


def test_the_pair_of_which_either_is_as_likely_better_is_asked_about_first() -> None:
    """The bounds on d.e are -0.5 and 0.5 for it, -0.2 and 0.5, and -0.3 and 0.7 for the others."""
    vectors = np.array([[0, 0.7, 0, 0.3], [0, 0, 1, 0], [0.5, 0, 0, 0.5]])
    (query,) = choose(vectors, PolytopeComparator(4)).ask()
    assert np.abs(query.d).tolist() == np.abs(vectors[1] - vectors[2]).tolist()


class Fickle:
    """One who takes level 2 to be worth 0.6 to 0.9, and after any answer 0.1 to 0.2."""

    k = 3

    def __init__(self, low: float = 0.6, high: float = 0.9) -> None:
        self._ends = np.array([[low, high], [1 - low, 1 - high]])
        self.values = np.array([0.0, (low + high) / 2, 1.0])

    def bounds(self, d: Any) -> Any:
        at = tail_sums(np.atleast_2d(d)) @ self._ends
        return at.min(axis=1), at.max(axis=1)

    def compare(self, d: Any) -> Any:
        low, high = self.bounds(d)
        verdicts = np.where(low > 0, 1, np.where(high < 0, -1, Verdict.UNKNOWN))
        return np.where((low == 0) & (high == 0), 0, verdicts).astype(np.int8)

    def update(self, _: Answers) -> "Fickle":
        return Fickle(0.1, 0.2)


def test_what_the_comparator_has_decided_stands_whatever_it_says_later() -> None:
    """The comparator decides one pair once, and the tutor the other one; both verdicts stand."""
    choosing = choose([[0, 1, 0], [0.5, 0, 0.5], [0.2, 0, 0.8]], Fickle(), order=True)
    (query,) = choosing.ask()
    choosing.tell([Answer(query, -1 if query.left[1] == 1 else 1)])
    assert choosing.ask() == ()
    assert choosing.result().order == (2, 0, 1)
