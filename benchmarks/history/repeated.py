"""The posterior on repeated gambles, beside rivals and beside the person's own repeats."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.people.choices import LEAST, choosing_half, over_people, shown
from benchmarks.people.comparators import STRENGTHS, TIMES
from benchmarks.people.gains import ANSWERS_BEFORE, SEED
from benchmarks.reporting import markdown
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.difference import tail_sums
from elicit.model.pairs import pair_numbers
from elicit.model.query import Answer, Answers, Query
from elicit.model.scale import Floats
from elicit.people.repeated_answers import RepeatedAnswersTutor
from elicit.tutors.answer_log import AnswerLog

FOLDS = 5
LEARNED = 120  # answers of a person from which the lapse is learned
THIRDS = ("least", "middle", "greatest")  # of people, by the learned lapse

Logs = Mapping[str, AnswerLog]
Told = Sequence[Answer]
Asked = Sequence[Query]
Predict = Callable[[Told, Asked], tuple[Floats, Floats]]
"""Returns the verdicts (n,) on n queries, and the probabilities of "left" among the answers that
prefer a side, after some answers."""


def sections(gambles: Mapping[str, Logs]) -> Iterator[list[str]]:
    """Yield the sections of the page, of the people of each experiment."""
    found = {name: scores(logs) for name, logs in gambles.items()}
    yield list(own_repeats(found))
    yield list(rivals(found))
    yield list(learned_lapses(gambles))


class Split(NamedTuple):
    """Some answers of a person, and all later ones to the pairs of a fold that they leave out.

    ``here`` (n,) numbers these pairs, and ``counts`` (n, 3) has the numbers of answers left, right
    and EQUAL to each.
    """

    told: list[Answer]
    asked: list[Query]
    here: NDArray[np.intp]
    counts: Floats


def scores(logs: Logs) -> dict[str, Floats]:
    """Return ``judged`` (people, pairs, 5) of the reporting half, by what predicts."""
    names, half = sorted(logs), choosing_half(len(logs))
    k = logs[names[0]].k or 0
    chosen, reported = (
        [name for name, is_half in zip(names, half, strict=True) if is_half == side]
        for side in (True, False)
    )
    like = PosteriorComparator(k, like=[logs[who].answers()[:ANSWERS_BEFORE] for who in chosen])
    splits = {who: splits_of(logs[who]) for who in names}

    def of(predict: Predict, people: Sequence[str]) -> Floats:
        return np.array([judged(predict, splits[who]) for who in people])

    found = {
        "without": of(by_posterior(PosteriorComparator(k)), reported),
        "with": of(by_posterior(like), reported),
    }
    for label, features in FEATURES.items():
        strength = max(
            STRENGTHS,
            key=lambda s, f=features: by_person(of(by_logistic_fit(f, s), chosen)).mean(),
        )
        name = f"{label} (inverse ridge {strength:g})"
        found[name] = of(by_logistic_fit(features, strength), reported)
    return found


def splits_of(log: AnswerLog) -> list[Split]:
    """Return a split for each fold of a person's pairs, with ``TIMES`` answers to each pair of the
    other folds."""
    entries = list(log)
    numbers = pair_numbers(np.array([entry.answer.query.d for entry in entries]))
    first = [int(np.flatnonzero(numbers == i)[0]) for i in range(numbers.max() + 1)]
    queries = [entries[i].answer.query for i in first]
    fold_of = np.random.default_rng(SEED).permutation(len(first)) % FOLDS
    found = []
    for fold in range(FOLDS):
        tutor = RepeatedAnswersTutor(log, SEED)
        told = [tutor(queries[i]) for i in np.flatnonzero(fold_of != fold) for _ in range(TIMES)]
        here = np.flatnonzero(fold_of == fold)
        asked = [queries[i] for i in here]
        said = [
            [int(tutor(query).verdict or 0) for _ in range(tutor.left_over(query))]
            for query in asked
        ]
        counts = np.array([[x.count(y) for y in (1, -1, 0)] for x in said], dtype=np.float64)
        found.append(Split(told, asked, here, counts))
    return found


def judged(predict: Predict, splits: Sequence[Split]) -> Floats:
    """Return what is predicted of each pair, and the person's answers to it (pairs, 5).

    The columns are the verdict, the probability of "left" among the answers that prefer a side, and
    the numbers of answers left, right and EQUAL.
    """
    rows = np.full((sum(len(split.here) for split in splits), 5), np.nan)
    for told, asked, here, counts in splits:
        rows[here, :2] = np.transpose(predict(told, asked))
        rows[here, 2:] = counts
    return rows


def by_posterior(fresh: PosteriorComparator) -> Predict:
    """Return predictions of a posterior."""

    def predict(told: Told, asked: Asked) -> tuple[Floats, Floats]:
        known = fresh.update(Answers.of(told, fresh.k))
        d = np.array([query.d for query in asked])
        left, right = known.answer_probability(d), known.answer_probability(-d)
        return known.compare(d).astype(np.float64), left / (left + right)

    return predict


def by_logistic_fit(features: Callable[[Told, Asked], Floats], strength: float) -> Predict:
    """Return predictions of a ridge logistic regression; EQUAL is half an answer each way."""

    def predict(told: Told, asked: Asked) -> tuple[Floats, Floats]:
        from sklearn.linear_model import LogisticRegression

        x = features(told, asked)
        seen, new = x[: len(told)], x[len(told) :]
        y = np.array([int(answer.verdict or 0) for answer in told])
        weights = np.concatenate([(1 + y) / 2, (1 - y) / 2]) / 2
        # each answer also the other way round: no constant is fitted, so that changes no fit, and
        # there are two classes even if all answers were "left"
        fit = LogisticRegression(C=strength, fit_intercept=False).fit(
            np.concatenate([seen, seen, -seen, -seen]),
            np.repeat([1, 0, 0, 1], len(y)),
            sample_weight=np.concatenate([weights, weights]),
        )
        chance = fit.predict_proba(new)[:, 1]
        return np.sign(chance - 0.5), chance

    return predict


def strengths(told: Told, asked: Asked) -> Floats:
    """Return features (n, gambles): 1 for the left gamble and -1 for the right one."""
    queries = [answer.query for answer in told] + list(asked)
    bags = np.array([side for query in queries for side in (query.left, query.right)])
    _, number = np.unique(bags, axis=0, return_inverse=True)
    one = np.eye(int(number.max()) + 1)[number.reshape(-1, 2)]
    return np.asarray(one[:, 0] - one[:, 1])


def shares(told: Told, asked: Asked) -> Floats:
    """Return features (n, k - 1): tail sums of the difference of two share vectors."""
    return tail_sums(np.array([answer.query.d for answer in told] + [query.d for query in asked]))


FEATURES = {
    "a strength for each gamble": strengths,
    "logistic fit on shares": shares,
}


def by_person(rows: Floats) -> Floats:
    """Return the mean log-probability (people,) of the answers that prefer a side."""
    _, chance, left, right, _ = np.moveaxis(rows, -1, 0)
    p = np.clip(chance, LEAST, 1.0 - LEAST)
    total = left * np.log(p) + right * np.log(1.0 - p)
    return np.asarray(total.sum(axis=1) / (left + right).sum(axis=1))


def both(found: Mapping[str, Mapping[str, Floats]]) -> dict[str, Mapping[str, Floats]]:
    """Return the scores of each experiment, and those of the people of all of them."""
    kinds = dict.fromkeys(label.split(" (")[0] for each in found.values() for label in each)
    together = {
        kind: np.concatenate([
            rows for each in found.values() for label, rows in each.items()
            if label.split(" (")[0] == kind
        ])
        for kind in kinds
    }  # fmt: skip
    return {**found, "both": together}


def own_repeats(found: Mapping[str, Mapping[str, Floats]]) -> Iterator[str]:
    """Yield the lines on the posterior's verdicts beside the person's own answers."""
    rows = [
        [experiment, label, f"{len(each[label])}", *disagreements(each[label])]
        for experiment, each in both(found).items()
        for label in ("without", "with")
    ]
    yield "## Verdicts beside the person's own repeats"
    yield ""
    yield (
        "The reporting half. Each fifth of the pairs of repeated gambles is judged by the "
        f"posterior of today, after {TIMES} answers to each of the other pairs. The columns after "
        "*decided* are of the pairs that it decides. *Answered otherwise* is the share of the "
        "person's answers that say the opposite of the verdict. *Not the usual answer* is the "
        'share that is not the person\'s most frequent one to the pair, "indifferent" included. '
        "Which one that is, only these answers tell: a verdict without them can hardly do better. "
        "*Beyond* is the first less the second. *Two differ* is the probability that two of the "
        "person's answers to the pair differ: so often is one answer of the person contradicted by "
        f"another. *With*: the first {ANSWERS_BEFORE} answers of each person of the choosing half "
        "are known."
    )
    yield ""
    head = ("experiment", "earlier people", "people", "decided", "answered otherwise",
            "not the usual answer", "beyond", "two differ")  # fmt: skip
    yield from markdown(head, rows, 2)


def disagreements(rows: Floats) -> list[str]:
    """Return the shares of ``own_repeats`` of ``judged`` (people, pairs, 5) as text."""
    verdict, counts = rows[..., 0], rows[..., 2:]
    sure, total = np.abs(verdict) == 1, counts.sum(axis=-1)
    other = np.where(verdict == 1, counts[..., 1], counts[..., 0]) / total
    unusual = 1.0 - counts.max(axis=-1) / total
    beyond = np.round(other - unusual, 12)  # without the last bits of a difference of 0
    differ = 1.0 - (counts * (counts - 1.0)).sum(axis=-1) / (total * (total - 1.0))

    def of_decided(x: Floats) -> str:
        def mean(i: NDArray[np.intp]) -> float:
            taken = x[i][sure[i]]
            return float(taken.mean()) if len(taken) else float("nan")

        return shown(over_people(mean, len(x)), 1, percent=True)

    decided = over_people(lambda i: float(sure[i].mean()), len(rows))
    return [
        shown(decided, 1, percent=True),
        *(of_decided(x) for x in (other, unusual, beyond, differ)),
    ]


def rivals(found: Mapping[str, Mapping[str, Floats]]) -> Iterator[str]:
    """Yield the lines on rivals' predictions of the same answers."""
    rows = []
    for experiment, each in both(found).items():
        plain = by_person(each["without"])
        for label, scored in each.items():
            score = by_person(scored)
            ours = {
                "without": "PosteriorComparator",
                "with": "PosteriorComparator, like earlier people",
            }
            rows.append([
                experiment, ours.get(label, label), f"{len(score)}", _mean(score, 3),
                "" if label == "without" else _mean(score - plain, 4),
            ])  # fmt: skip
    yield "## Rivals on repeated gambles"
    yield ""
    yield (
        "The same people, pairs and answers. The log-likelihood is that of the answers that prefer "
        "a side, given that they do. *A strength for each gamble* is the problem that choix solves "
        "(`opt_pairwise`): it learns from the other pairs of a gamble, and nothing of prizes and "
        "chances. The ridge of each fit is the best on the choosing half. To the fits, an answer "
        '"indifferent" is half an answer each way.'
    )
    yield ""
    head = ("experiment", "", "people", "log-likelihood", "gain")
    yield from markdown(head, rows, 2)


def _mean(x: Floats, digits: int) -> str:
    return shown(over_people(lambda i: float(x[i].mean()), len(x)), digits)


def _percent(x: Floats) -> str:
    return shown(over_people(lambda i: float(x[i].mean()), len(x)), 1, percent=True)


def learned_lapses(gambles: Mapping[str, Logs]) -> Iterator[str]:
    """Yield the lines on lapses that were learned, beside disagreement among later answers."""
    lapses, precisions, shares_ = [], [], []
    for logs in gambles.values():
        names, half = np.array(sorted(logs)), choosing_half(len(logs))
        for name in names[~half]:
            answers = logs[name].answers()
            known = PosteriorComparator(logs[name].k or 0).update(answers[:LEARNED])
            lapses.append(known.lapse)
            precisions.append(known.precision)
            shares_.append(later_disagreement(answers[LEARNED:]))
    lapse, precision, share = map(np.array, (lapses, precisions, shares_))
    thirds = np.array_split(np.argsort(lapse, kind="stable"), len(THIRDS))
    rows = [
        [
            name, f"{len(third)}", _percent(lapse[third] / 2),
            f"{np.exp(np.log(precision[third]).mean()):.0f}", _percent(share[third]),
        ]
        for name, third in zip(THIRDS, thirds, strict=True)
    ]  # fmt: skip

    def together(i: NDArray[np.intp]) -> float:
        if len(set(lapse[i])) < 2 or len(set(share[i])) < 2:
            return float("nan")
        return float(stats.spearmanr(lapse[i], share[i]).statistic)

    yield "## The learned lapse beside disagreement"
    yield ""
    yield (
        f"The posterior learns {LEARNED} answers of each person of the reporting half, in the "
        "drawn order. *Wrong by lapses* is half the learned lapse, since half of the random "
        "answers are right. *Disagree* is the share of the person's later answers to a pair that "
        "are not the most frequent one among these, a mean over pairs. The people are in thirds by "
        "the learned lapse. Spearman's correlation of lapse and disagreement is "
        f"{shown(over_people(together, len(lapse)), 2)}."
    )
    yield ""
    head = ("lapse", "people", "wrong by lapses", "precision, geometric mean", "disagree")
    yield from markdown(head, rows, 1)


def later_disagreement(answers: Answers) -> float:
    """Return the mean over pairs of the share of answers that are not the most frequent one."""
    numbers = pair_numbers(answers.d)
    first = {int(i): answers.d[np.flatnonzero(numbers == i)[0]] for i in set(numbers.tolist())}
    found = []
    for i, d in first.items():
        here = numbers == i
        same = np.where(np.isclose(answers.d[here], d).all(axis=1), 1, -1)
        said = (answers.y[here] * same).tolist()
        found.append(1.0 - max(map(said.count, set(said))) / len(said))
    return float(np.mean(found))
