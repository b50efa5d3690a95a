"""Ask and tell, the loop that drives them, and the books that a learner keeps: the same for every
learner.
"""

from __future__ import annotations

import copy
import pickle
import re
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elicit import (
    AlwaysAsk,
    Answer,
    AnswerLog,
    Answers,
    Bags,
    BradleyTerryComparator,
    Comparator,
    Dominance,
    FlippingTutor,
    InconsistentAnswers,
    PolytopeComparator,
    Query,
    ReplayTutor,
    StaleAnswer,
    TruthfulTutor,
    Tutor,
    Verdict,
)
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    InteractiveValueIteration,
    LateQLearning,
    LateValueIteration,
    Learner,
    Result,
    Status,
    drive,
    policy_loss,
    random_mdp,
)
from tests.noisy_cases import COMPARATORS
from tests.scale_arithmetic import Floats, tail_sums
from tests.thoroughness import covering, on_any_processor, scaled

K = 5
MDP, VALUES = random_mdp(8, 3, K, discount=0.9, rng=0)
Make = Callable[..., Any]


def q_learning(comparator: Comparator, **settings: Any) -> InteractiveQLearning:
    return InteractiveQLearning(
        MDP, comparator, **{"steps": 400, "epsilon": 0.3, "rng": 1, **settings}
    )


def value_iteration(comparator: Comparator, **settings: Any) -> InteractiveValueIteration:
    return InteractiveValueIteration(
        MDP, comparator, **{"tolerance": 0.01, "max_sweeps": 60, "rng": 1, **settings}
    )


@pytest.fixture(params=[q_learning, value_iteration])
def make(request: pytest.FixtureRequest) -> Make:
    chosen: Make = request.param
    return chosen


def truth(query: Query) -> Answer:
    return TruthfulTutor(VALUES)(query)


def names(queries: Iterable[Query]) -> list[bytes]:
    """Each query's unordered pair."""
    tails = [tail_sums(query.d) for query in queries]
    return [min((t + 0.0).tobytes(), (0.0 - t).tobytes()) for t in tails]


def recorded(
    learner: Learner, tutor: Callable[[Query], Answer], on_conflict: Any = "raise"
) -> list[Answer]:
    """All answers of a run driven by hand."""
    told = []
    while queries := learner.ask():
        answers = [tutor(query) for query in queries]
        learner.tell(answers, on_conflict)
        told += answers
    return told


def snapshot(result: Result) -> tuple[Any, ...]:
    """Everything a Result says, but for the comparator's caches."""
    return (
        result.policy.tolist(), result.q.tobytes(), result.status, result.asked, result.audited,
        result.cannot_tell,
        dict(result.decided), result.rounds, result.answers.d.tobytes(), result.answers.y.tolist(),
        result.answers.ids,
        result.comparator.values.tobytes(),
        [(a.query.id, a.expected, a.answer) for a in result.audits],
    )  # fmt: skip


def test_ask_is_idempotent(make: Make) -> None:
    learner = make(PolytopeComparator(K))
    while queries := learner.ask():
        before = snapshot(learner.result())
        assert learner.ask() == queries
        assert learner.ask()[0] is queries[0]
        assert learner.tell([]) == ()
        assert learner.ask() == queries
        assert snapshot(learner.result()) == before
        learner.tell([truth(query) for query in queries])
    assert learner.ask() == learner.ask() == ()


def test_what_is_refused_changes_nothing(make: Make) -> None:
    learner = make(PolytopeComparator(K), batch=4)
    told = [truth(query) for query in learner.ask()]
    learner.tell(told)
    queries, before = learner.ask(), snapshot(learner.result())
    answers = [truth(query) for query in queries]
    with pytest.raises(StaleAnswer):
        learner.tell(answers + told[:1])
    with pytest.raises(ValueError, match="'Drop'"):
        learner.tell(answers, "Drop")
    with pytest.raises(ValueError, match="'Drop'"):
        drive(learner, TruthfulTutor(VALUES), on_conflict="Drop")  # type: ignore[arg-type]
    assert learner.ask() == queries
    assert snapshot(learner.result()) == before


def test_a_tutor_who_fails_leaves_the_question_open(make: Make) -> None:
    learner = make(PolytopeComparator(K))

    def tired(query: Query) -> Answer:
        raise TimeoutError("gone for lunch")

    with pytest.raises(TimeoutError):
        drive(learner, tired)
    assert learner.result().status is Status.WAITING
    assert snapshot(drive(learner, TruthfulTutor(VALUES))) == snapshot(
        drive(make(PolytopeComparator(K)), TruthfulTutor(VALUES))
    )


def test_a_result_can_be_had_at_any_time(make: Make) -> None:
    learner = make(PolytopeComparator(K))
    results = [learner.result()]
    while queries := learner.ask():
        results.append(learner.result())
        learner.tell([truth(query) for query in queries])
        results.append(learner.result())
    assert {result.status for result in results} == {Status.WAITING}
    assert all(
        status.value.startswith(("finished", "not finished", "stopped")) for status in Status
    )
    for before, after in pairwise(results):
        assert before.asked <= after.asked
        assert before.compared <= after.compared
        assert before.rounds <= after.rounds
    for result in results:
        assert MDP.admissible[np.arange(MDP.n_states), result.policy].all()
        assert result.asked == result.decided["tutor"] == len(result.answers)
    assert learner.result().status in (Status.DONE, Status.CONVERGED)


@on_any_processor
def test_a_result_does_not_change_later(make: Make) -> None:
    settings = {"tolerance": 0.1} if make is value_iteration else {}
    learner, results, said = make(PolytopeComparator(K), **settings), [], []
    while queries := learner.ask():
        said.append(snapshot(learner.result()))
        results.append(learner.result())  # whose q is not read before the end
        learner.tell([truth(query) for query in queries])
    assert [snapshot(pickle.loads(pickle.dumps(result))) for result in results] == said
    assert said[0] != said[-1]
    assert said[0][2] is Status.WAITING
    spoiled = learner.result()
    spoiled.policy[:], spoiled.q[:] = 0, 0.0  # nor does the learner, whatever is done to its result
    again = drive(make(PolytopeComparator(K), **settings), truth)
    assert snapshot(learner.result()) == snapshot(again)


@pytest.mark.parametrize(
    "comparator",
    [Dominance(K), PolytopeComparator(K), BradleyTerryComparator(K, n_boot=20), AlwaysAsk(K)],
    ids=["dominance", "polytope", "ensemble", "always ask"],
)
def test_no_pair_is_asked_twice(make: Make, comparator: Comparator) -> None:
    settings = (
        {"learning_rate": 1.0, "steps": 200} if make is q_learning else {"max_sweeps": 15}
    )  # rate 1: vectors come back
    learner = make(comparator, **settings)
    tutor = FlippingTutor(VALUES, 0.1, seed=0)
    answers = recorded(learner, lambda query: tutor(query))
    asked = names(answer.query for answer in answers)
    assert len(set(asked)) == len(asked) > 0
    if isinstance(comparator, Dominance) and make is q_learning:
        assert learner.result().decided["known"] > 0


@pytest.mark.parametrize(
    "comparator", [Dominance(K), PolytopeComparator(K), BradleyTerryComparator(K, n_boot=20)]
)
def test_who_cannot_tell_keeps_the_incumbent(make: Make, comparator: Comparator) -> None:
    log = AnswerLog()
    result = drive(make(comparator), lambda query: Answer(query, None), log=log)
    assert result.cannot_tell == result.asked == len(log) > 0
    assert all(entry.used and entry.answer.verdict is None for entry in log)
    assert len(result.answers) == 0
    asked = names(entry.answer.query for entry in log)
    assert len(set(asked)) == len(asked)
    # then only dominance speaks, as if every open pair were a tie
    indifferent = make(Dominance(K), indifference=1.0)
    assert indifferent.ask() == ()
    assert result.q.tobytes() == indifferent.result().q.tobytes()
    assert result.policy.tolist() == indifferent.result().policy.tolist()


@on_any_processor
@pytest.mark.parametrize("budget", [0, 1, 3])
@pytest.mark.parametrize("batch", [1, 5])
def test_beyond_the_budget_the_best_guess_decides(make: Make, budget: int, batch: int) -> None:
    log = AnswerLog()
    result = drive(
        make(PolytopeComparator(K), max_queries=budget, batch=batch), TruthfulTutor(VALUES), log=log
    )
    assert result.asked == budget == len(log) == len(result.answers)
    assert result.status is Status.GUESSED
    assert result.decided["guess"] > 0
    assert "max_queries" in result.status.value


def test_a_budget_that_suffices_changes_nothing(make: Make) -> None:
    free = drive(make(PolytopeComparator(K)), TruthfulTutor(VALUES))
    exact = drive(make(PolytopeComparator(K), max_queries=free.asked), TruthfulTutor(VALUES))
    assert snapshot(exact) == snapshot(free)


def test_audits_are_counted_apart_and_change_nothing_if_true(make: Make) -> None:
    plain = drive(make(PolytopeComparator(K)), TruthfulTutor(VALUES))
    for share in (0.2, 1.0):
        log = AnswerLog()
        audited = drive(make(PolytopeComparator(K), audit=share), TruthfulTutor(VALUES), log=log)
        assert audited.asked == plain.asked == audited.decided["tutor"]
        assert audited.policy.tolist() == plain.policy.tolist()
        assert audited.q.tobytes() == plain.q.tobytes()
        assert audited.audited > 0
        assert audited.compared == plain.compared
        assert len(log) == len(audited.answers) == audited.asked + audited.audited
        assert not any(audit.contradicts for audit in audited.audits)
        assert all(audit.expected in (Verdict.BETTER, Verdict.WORSE) for audit in audited.audits)
        pairs = names(entry.answer.query for entry in log)
        assert len(set(pairs)) == len(pairs)


@pytest.mark.parametrize("contrary", [Verdict.EQUAL, None, "opposite"])
def test_dropped_answers_settle_their_own_pair_and_are_marked(make: Make, contrary: Any) -> None:
    # truthful when asked, contrary when audited
    open_pairs = set(names(answer.query for answer in recorded(make(PolytopeComparator(K)), truth)))

    def tutor(query: Query) -> Answer:
        answer = truth(query)
        if names([query])[0] in open_pairs or np.abs(query.d).sum() < 0.02:
            return answer
        return Answer(
            query, answer.verdict.flipped if contrary == "opposite" and answer.verdict else contrary
        )

    learner = make(PolytopeComparator(K), audit=0.3, max_queries=300)
    log = AnswerLog()
    result = drive(learner, tutor, log=log, on_conflict="drop")
    assert result.status is not Status.WAITING
    unused = [entry.answer for entry in log if not entry.used]
    if contrary is None:
        assert not unused
        return
    assert unused
    assert len(log) == result.asked + result.audited
    assert log.answers().d.tobytes() == result.answers.d.tobytes()
    assert log.answers().y.tolist() == result.answers.y.tolist()
    assert result.decided["known"] >= len(unused)


LEARNING = ("polytope", "dominance", "ensemble")


@pytest.mark.parametrize(
    ("comparator", "settings"),
    covering(LEARNING, [{"audit": 0.1}, {"batch": 3}, {}, {"max_queries": 5}], together=1),
)
def test_a_run_can_be_replayed_from_its_log(
    make: Make, comparator: str, settings: dict[str, Any], tmp_path: Path
) -> None:
    def run(tutor: Tutor, log: AnswerLog | None = None) -> Result:
        learner = make(
            COMPARATORS[comparator](K),
            **{"max_sweeps": 12} if make is value_iteration else {"steps": 200},
            **settings,
        )
        return drive(learner, tutor, log=log, on_conflict="drop")

    log = AnswerLog(tmp_path / "answers.jsonl")
    first = run(FlippingTutor(VALUES, 0.1, seed=3), log)
    assert len(log) == first.asked + first.audited > 0
    for source in (log, AnswerLog.read(tmp_path / "answers.jsonl")):
        assert snapshot(run(ReplayTutor(source))) == snapshot(first)


@pytest.mark.parametrize("comparator", LEARNING)
def test_a_run_may_be_cut_anywhere_and_resumed(make: Make, comparator: str) -> None:
    """Rebuilt from the log before every answer, the learner ends where an undisturbed one does."""
    settings: dict[str, Any] = (
        {"steps": scaled(100, 150)} if make is q_learning else {"max_sweeps": scaled(2, 4)}
    )
    settings["audit"] = 0.1

    def fresh() -> Any:
        return make(COMPARATORS[comparator](K), **settings)

    undisturbed = fresh()
    tutor = FlippingTutor(VALUES, 0.1, seed=3)
    answers = recorded(undisturbed, lambda query: tutor(query), on_conflict="drop")
    assert len(answers) > 3
    tutor = FlippingTutor(VALUES, 0.1, seed=3)
    log = AnswerLog()
    while True:
        learner = fresh()
        replay = ReplayTutor(log)
        for _ in range(len(log)):
            learner.tell([replay(query) for query in learner.ask()], "drop")
        queries = learner.ask()
        if not queries:
            break
        for query in queries:
            log.append(tutor(query))
    assert snapshot(learner.result()) == snapshot(undisturbed.result())


def test_a_learner_can_be_copied_before_every_answer(make: Make) -> None:
    settings = {"steps": 150} if make is q_learning else {"max_sweeps": 6}
    learner: Any = make(COMPARATORS["ensemble"](K), **settings)
    undisturbed = make(COMPARATORS["ensemble"](K), **settings)
    recorded(undisturbed, truth)
    while queries := learner.ask():
        twin = copy.deepcopy(learner)
        twin.tell([truth(query) for query in queries])
        learner.tell([Answer(query, None) for query in queries])  # must not reach the copy
        learner = twin
    assert snapshot(learner.result()) == snapshot(undisturbed.result())


def test_driving_is_the_loop(make: Make) -> None:
    comparator = PolytopeComparator(K)
    by_hand = make(comparator)
    told = recorded(by_hand, truth)
    assert len(comparator.answers) == 0
    assert by_hand.comparator.answers.ids == by_hand.result().answers.ids
    log = AnswerLog()
    driven = drive(make(PolytopeComparator(K)), TruthfulTutor(VALUES), log=log)
    assert snapshot(by_hand.result()) == snapshot(driven)
    assert (
        [entry.answer.query.id for entry in log]
        == [answer.query.id for answer in told]
        == list(driven.answers.ids)
    )
    assert len(set(driven.answers.ids)) == len(told)
    assert all(entry.used for entry in log)
    for answers in (log.answers(), Answers.of(told, K)):
        assert answers.d.tobytes() == driven.answers.d.tobytes()
        assert answers.y.tolist() == driven.answers.y.tolist()


def test_progress_is_reported_after_every_round() -> None:
    for batch in (1, 3):
        results: list[Result] = []
        final = drive(
            value_iteration(PolytopeComparator(K), batch=batch), truth, progress=results.append
        )
        asked = [result.asked for result in results]
        assert asked == sorted(set(asked))
        assert asked[-1] == final.asked
        assert all(after - before <= batch for before, after in pairwise(asked))


def test_a_contradiction_is_logged_unused_and_raised(make: Make) -> None:
    log = AnswerLog()
    learner = make(PolytopeComparator(K), audit=1.0)
    with pytest.raises(InconsistentAnswers):
        drive(learner, lambda query: Answer(query, Verdict.BETTER), log=log)
    *before, last = log
    assert not last.used
    assert all(entry.used for entry in before)
    assert [query.id for query in learner.ask()] == [last.answer.query.id]
    assert log.answers().y.tolist() == learner.result().answers.y.tolist()


class Contrary(TruthfulTutor):
    """A simulated tutor with its own way to answer a single question."""

    def __call__(self, query: Query) -> Answer:
        answer = super().__call__(query)
        return Answer(query, answer.verdict and answer.verdict.flipped)


class Wrapping:
    """Hands on all but questions."""

    def __init__(self) -> None:
        self.inner, self.asked = TruthfulTutor(VALUES), 0

    def __call__(self, query: Query) -> Answer:
        self.asked += 1
        return self.inner(query)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@on_any_processor
def test_a_tutor_with_its_own_way_to_answer_is_called_by_those_who_always_ask(make: Make) -> None:
    settings = exact(make) or {"steps": 100}
    contrary = drive(make(AlwaysAsk(K), **settings), Contrary(VALUES))
    by_hand = drive(make(AlwaysAsk(K), **settings), lambda query: Contrary(VALUES)(query))
    assert contrary.q.tobytes() == by_hand.q.tobytes()
    wrapping = Wrapping()
    result = drive(make(AlwaysAsk(K), **settings), wrapping)
    assert wrapping.asked == result.asked > 0


def test_an_answer_is_in_the_log_before_the_learner_is_told() -> None:
    """An answer is not lost if telling fails, and nothing is told if it cannot be logged."""

    class Failing:
        def __init__(self, learner: Any) -> None:
            self.ask, self.implied, self.comparator = (
                learner.ask,
                learner.implied,
                learner.comparator,
            )

        def tell(self, answers: Any, on_conflict: str) -> Any:
            raise FloatingPointError("while telling")

    log = AnswerLog()
    learner: Any = Failing(value_iteration(PolytopeComparator(K)))
    with pytest.raises(FloatingPointError):
        drive(learner, truth, log=log)
    assert [(entry.answer.query.id, entry.used) for entry in log] == [(learner.ask()[0].id, True)]
    other: Any = value_iteration(PolytopeComparator(K))
    with pytest.raises(ValueError, match="3 levels"):
        drive(other, truth, log=AnswerLog(k=3))
    assert len(other.result().answers) == 0


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_what_was_answered_before_a_tutor_raises_is_logged_and_told(
    error: type[BaseException],
) -> None:
    """This holds for several questions at once, too."""
    plain = drive(value_iteration(PolytopeComparator(K), batch=3), truth)

    class Failing:
        """Raises at its second question, and never again."""

        asked = 0

        def __call__(self, query: Query) -> Answer:
            self.asked += 1
            if self.asked == 2:
                raise error("while answering")
            return truth(query)

    log, learner, tutor = AnswerLog(), value_iteration(PolytopeComparator(K), batch=3), Failing()
    first, second, *_ = learner.ask()
    with pytest.raises(error, match="while answering"):
        drive(learner, tutor, log=log)
    assert (
        [entry.answer.query.id for entry in log] == [first.id] == list(learner.result().answers.ids)
    )
    assert learner.ask()[0].id == second.id
    result = drive(learner, tutor, log=log)
    assert [entry.answer.query.id for entry in log] == list(result.answers.ids)
    assert snapshot(result)[:1] == snapshot(plain)[:1]
    assert len({entry.answer.query.id for entry in log}) == len(log) == result.asked


def test_a_contradiction_before_a_tutor_raises_is_logged_unused() -> None:
    class Failing(Exception):
        pass

    class Ring:
        """Asks three questions at once that no scale answers with "better"."""

        comparator = PolytopeComparator(4)
        implied: dict[str, Verdict] = {}  # noqa: RUF012

        def ask(self) -> tuple[Query, ...]:
            a, b, c = np.array([[0.5, 0, 0, 0.5], [0.2, 0.3, 0.4, 0.1], [0, 0.9, 0.1, 0]])
            ring = ((a, b), (b, c), (c, a), (a, c))
            return tuple(Query(f"q{i}", left, right) for i, (left, right) in enumerate(ring))

        def tell(self, answers: Any, on_conflict: str) -> Any:
            self.comparator.update(Answers.of(answers, 4))

    def fails_late(query: Query) -> Answer:
        if query.id == "q3":
            raise Failing
        asked = next(each for each in ring.ask() if each.id == query.id)
        same_side = (query.left == asked.left).all()
        return Answer(query, Verdict.BETTER if same_side else Verdict.WORSE)

    ring: Any = Ring()
    log = AnswerLog()
    with pytest.raises(Failing) as caught:
        drive(ring, fails_late, log=log)
    assert [entry.used for entry in log] == [False] * 3
    assert "logged, but not learned" in caught.value.__notes__[0]


def test_an_answer_to_what_was_not_asked_before_a_tutor_raises_is_not_logged() -> None:
    def strange(query: Query) -> Answer:
        if query.id != first.id:
            raise RuntimeError("while answering")
        return Answer(Query("other", query.left, query.right), Verdict.BETTER)

    log, learner = AnswerLog(), value_iteration(PolytopeComparator(K), batch=3)
    first = learner.ask()[0]
    with pytest.raises(StaleAnswer):
        drive(learner, strange, log=log)
    assert len(log) == 0


def test_an_answer_to_what_was_not_asked_is_not_logged() -> None:
    log = AnswerLog()
    with pytest.raises(StaleAnswer):
        drive(
            value_iteration(PolytopeComparator(K)),
            lambda query: Answer(Query("other", query.left, query.right), Verdict.BETTER),
            log=log,
        )
    assert len(log) == 0


@on_any_processor
def test_the_oracle_is_only_counted(make: Make) -> None:
    log = AnswerLog()
    learner = make(AlwaysAsk(K), max_queries=3)  # no budget either
    given: list[int] = []

    class Counting(TruthfulTutor):
        def signs(self, d: Any) -> Any:
            given.append(len(np.atleast_2d(d)))
            return super().signs(d)

    tutor = Counting(VALUES)
    result = drive(learner, tutor, log=log)
    assert len(log) == len(result.answers) == 0
    assert result.asked == sum(given) == result.decided["tutor"] > 3
    assert result.status in (Status.DONE, Status.CONVERGED)
    assert tutor.realised_error_rate == 0


class Five:
    """A comparator with the five members of the protocol, and no more: it knows the scale from the
    start.
    """

    k = K
    values = MDP.normalise(VALUES)

    def compare(self, d: Any) -> Any:
        return TruthfulTutor(VALUES).signs(d)

    def bounds(self, d: Any) -> tuple[Floats, Floats]:
        x = np.atleast_2d(d) @ self.values
        return x, x

    def update(self, answers: Answers) -> Five:
        return self


def test_any_function_is_a_tutor_and_any_comparator_will_do(make: Make) -> None:
    def nobody(query: Query) -> Answer:
        raise AssertionError("there is nothing to ask")

    result = drive(make(Five()), nobody)
    assert result.asked == 0
    assert result.decided["model"] > 0
    assert (
        result.policy.tolist()
        == drive(make(AlwaysAsk(K), **exact(make)), TruthfulTutor(VALUES)).policy.tolist()
    )


@pytest.mark.parametrize(
    ("learner", "settings"),
    [
        (InteractivePolicyIteration, {}),
        (InteractivePolicyIteration, {"bags": Bags(days=4), "max_queries": 5}),
        (LateQLearning, {"steps": 400, "max_loss": 0.5}),
        (LateValueIteration, {"tolerance": 0.01}),
    ],
)
def test_five_members_are_enough_for_every_learner(learner: Any, settings: dict[str, Any]) -> None:
    result = drive(learner(MDP, Five(), **settings), truth)
    assert result.status is not Status.WAITING
    assert 0 <= result.loss_bound <= 1, "by its own bounds"
    assert np.isnan(result.confidence), "for it does not say that they hold for all pairs at once"
    if learner is InteractivePolicyIteration:
        assert (result.asked, result.status) == (0, Status.BOUNDED)
        assert policy_loss(MDP, result.policy, VALUES).max() <= result.loss_bound <= 1e-3


def test_what_a_comparator_lacks_is_named() -> None:
    class Four:
        k, values = K, Five.values
        bounds, update = Five.bounds, Five.update

    for wrong, complaint in (
        (Four(), "which has no compare$"),
        (Five, "not <class"),
        (None, "not None"),
    ):
        with pytest.raises(TypeError, match=f"a comparator is wanted.*{complaint}"):
            q_learning(wrong)  # type: ignore[arg-type]


def exact(make: Make) -> dict[str, Any]:
    return {} if make is q_learning else {"indifference": 0.0}


@pytest.mark.parametrize("make", [InteractiveQLearning, InteractiveValueIteration])
def test_where_the_tutor_cannot_tell_he_is_asked_once_however_the_estimates_move(
    make: Callable[..., Any],
) -> None:
    mdp, values = random_mdp(20, 3, K, rng=5)
    truthful = TruthfulTutor(values)
    unclear: list[str] = []

    def tutor(query: Query) -> Answer:
        if "action 0 " in query.about:
            unclear.append(query.about)
            return Answer(query, None)
        return truthful(query)

    result = drive(
        make(
            mdp, PolytopeComparator(K), **({"steps": 3000} if make is InteractiveQLearning else {})
        ),
        tutor,
    )
    numbers = [re.findall(r"\d+", about) for about in unclear]
    places = [(state, *sorted(actions)) for state, *actions in numbers]
    assert len(places) == len(set(places)) == result.cannot_tell > 0
