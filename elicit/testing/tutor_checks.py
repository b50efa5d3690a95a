"""Checks that a tutor answers as the contract says."""

import numpy as np

from elicit._support.hashing import Seed
from elicit.model.difference import dominance, tail_sums
from elicit.model.query import Answer, Query, Verdict
from elicit.model.tutor import CountsErrors, Tutor, TutorOfMany, answer_of, check_tutor_made
from elicit.testing.demands import demand, demand_same, wanted
from elicit.testing.differences import sample_differences

_ENDS = 5, 15  # questions about the best and the worst level: at first, and if answers differ


def check_tutor(tutor: Tutor, k: int, truthful: bool = False, seed: Seed | None = 0) -> None:
    """Check that a tutor answers queries about k levels as the contract says.

    A ReplayTutor cannot be checked: it knows only the queries of its log.

    Parameters
    ----------
    tutor : Tutor
    k : int
    truthful : bool
        If True, also demand what holds for a tutor without errors: the same answer to the same
        pair, the flipped answer to the flipped pair, and no answer against dominance.
    seed : int, SeedSequence, Generator or None

    Raises
    ------
    AssertionError
        If the tutor breaks the contract, or prefers the worst level to the best in at least two of
        three questions.
    """
    wanted(lambda: check_tutor_made(tutor, k))
    d = sample_differences(k, seed)
    pairs = [(np.clip(row, 0.0, None), np.clip(-row, 0.0, None)) for row in d]
    queries = [Query.make("check_tutor", i, left, right) for i, (left, right) in enumerate(pairs)]
    codes = [_ask(tutor, query) for query in queries]
    same = Query.make("check_tutor", -1, pairs[-1][0], pairs[-1][0])
    verdict = _ask(tutor, same)
    demand(
        verdict in (None, Verdict.EQUAL),
        f"two identical vectors are EQUAL, but it says {verdict!r}",
    )
    worst, best = np.eye(k)[[0, -1]]
    gap = best - worst
    ends: list[Verdict | None] = []
    for most in _ENDS:
        if len(set(ends)) != 1:  # a tutor who errs is asked more
            ends += [
                _ask(tutor, Query.make("check_tutor", -2 - i, best, worst + i / 60 * gap))
                for i in range(len(ends), most)
            ]
    wrong = ends.count(Verdict.WORSE)
    demand(
        3 * wrong < 2 * len(ends),
        f"of the best level (left) and nearly the worst (right), it prefers the right in {wrong} "
        f"of {len(ends)} questions: are left and right exchanged? 1 means that left is better",
    )
    demand(
        any(code in (Verdict.BETTER, Verdict.WORSE) for code in ends),
        "of the best level (left) and nearly the worst (right), it prefers neither in all "
        f"{len(ends)} questions: such a tutor teaches nothing",
    )
    if truthful:
        plain = dominance(tail_sums(d))
        for i, (query, code) in enumerate(zip(queries, codes, strict=True)):
            again = _ask(tutor, query)
            demand(
                again == code,
                f"a truthful tutor repeats itself, but on {query.d} it says {code!r}, then "
                f"{again!r}",
            )
            mirrored = _ask(tutor, Query.make("mirrored", i, query.right, query.left))
            want = None if code is None else code.flipped
            what = f"left and right exchanged, {code!r} on {query.d} must become {want!r}"
            demand(mirrored == want, f"{what}: {mirrored!r}")
            right = code is None or plain[i] not in (-1, 1) or code == plain[i]
            demand(
                right, f"every scale ranks {query.d} as {Verdict(plain[i])!r}, but it says {code!r}"
            )
    if isinstance(tutor, TutorOfMany):
        many = tutor.signs(d)
        right = many.shape == (len(d),) and many.dtype == np.int8
        demand(right, f"signs must be (n,) int8, not {many.shape} {many.dtype}")
        demand(np.isin(many, (-1, 0, 1)).all(), f"signs must be -1, 0 or 1, not {many}")
        if truthful:
            demand_same(
                "signs(d)",
                many,
                "asking one by one",
                np.array([0 if c is None else c for c in codes]),
                d,
            )
    rate = tutor.realised_error_rate if isinstance(tutor, CountsErrors) else 0.0
    demand(
        0 <= rate <= 1,
        f"after some answers realised_error_rate must lie between 0 and 1, not {rate}",
    )


def _ask(tutor: Tutor, query: Query) -> Verdict | None:
    before = query.left.copy(), query.right.copy()
    try:
        reply = tutor(query)
    except Exception as error:
        error.add_note(
            f"check_tutor asked about k = {len(query.left)} levels: has your tutor as many?"
        )
        raise
    answer = answer_of(reply, query)
    demand(
        isinstance(answer, Answer),
        "a tutor must return an elicit.Answer, or 1 (left is better), -1 (right is) or 0 (equal), "
        f"not {reply!r}; where it cannot tell, elicit.Answer(query, None)",
    )
    demand(
        answer.query.id == query.id,
        f"the answer to query {query.id} names another one: {answer.query.id}",
    )
    kept = (query.left == before[0]).all() and (query.right == before[1]).all()
    demand(kept, f"a tutor must not change the query's vectors, but it did in {query.id}")
    return answer.verdict
