"""Gains in predicting people's answers: by another law of error, or by a prior of earlier people.

Needs the folder with the tables that are not shipped; docs/people.md says what they hold.

    python -m benchmarks.people.gains FOLDER --out benchmarks/RESULTS-people-gains.md
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.people import comparators, error_laws
from benchmarks.people.choices import (
    LEAST,
    Bools,
    Choices,
    agreement,
    calibration_error,
    choices_of,
    choosing_half,
    deal,
    log_likelihood,
    over_people,
    shown,
)
from benchmarks.reporting import machine, main_of_people, markdown
from elicit.asking.choose_from_list import choose
from elicit.comparators.bradley_terry.earlier_people import EarlierPeople
from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
from elicit.model.query import Answers, Query
from elicit.model.scale import Floats
from elicit.people.experiments import lottery_choices, repeated_gambles
from elicit.people.repeated_answers import NoRepeatLeft, RepeatedAnswersTutor
from elicit.tutors.answer_log import AnswerLog

FOLDS, LEVELS, DRAWS, SEED = 5, 8, 40_000, 0
FEWER = (4, 12, 35)  # of the choosing half's people
COUNTS = (0, 5, 10, 20, 40, 56)  # answers of a person
LAWS = ("spread", "own spread", "range", "mass", "logistic, lapse, side", "spread, side")
PLAIN = "logistic, lapse"
ANSWERS_BEFORE = 60  # of each earlier person of the repeated gambles


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    main_of_people("benchmarks.people.gains", report, f"{SEED}", arguments)


def report(folder: Path, quick: bool = False) -> Iterator[list[str]]:
    """The page, part by part."""
    most = 8 if quick else None
    logs = dict(list(lottery_choices(folder, LEVELS).items())[:most])
    choices = choices_of(logs)
    yield [
        "# What would predict people better",
        "",
        "Of [the same people](RESULTS-people.md), and split in the same way: whatever is learned "
        "or chosen is so on one half of the people, and the tables are of the other half, unless "
        f"they say so. Lotteries have {LEVELS} levels; each fifth of a person's answers is "
        "predicted by the rest. A gain is in nats an answer, person by person on the same answers. "
        "Intervals are of 95%, by a bootstrap over people.",
    ]
    yield list(laws(choices, order_of(choices, logs), 2000 if quick else DRAWS))
    yield list(earlier_people(choices, FEWER[:1] if quick else FEWER))
    yield list(questions(folder, 6 if quick else None))
    yield ["## Machine", "", machine("one thread")]


def by_person(chance: Floats, said: Floats) -> Floats:
    """Return the mean log-probability (n,) of each person's answers."""
    given = np.where(said == 1, chance, 1.0 - chance)
    given[np.isnan(said)] = np.nan
    return np.asarray(np.nanmean(np.log(np.maximum(given, LEAST)), axis=1))


def gain(chance: Floats, before: Floats, said: Floats) -> str:
    """Return by how much one prediction is better than another, with its interval."""
    apart = by_person(chance, said) - by_person(before, said)
    return shown(over_people(lambda i: float(apart[i].mean()), len(apart)), 4)


def order_of(choices: Choices, logs: Mapping[str, AnswerLog]) -> Floats:
    """Return when each question was answered (n, m), from 0 (first) to 1 (last)."""
    place = {name: i for i, name in enumerate(_questions_of(logs))}
    when = np.full(choices.said.shape, np.nan)
    for row, name in enumerate(choices.names):
        for i, entry in enumerate(logs[name]):
            when[row, place[entry.answer.query.id]] = i / max(1, len(logs[name]) - 1)
    return when


def _questions_of(logs: Mapping[str, AnswerLog]) -> list[str]:
    """Return the questions in the order of ``choices_of``."""
    found: dict[str, int] = {}
    for name in sorted(logs):
        for entry in logs[name]:
            found.setdefault(entry.answer.query.id, len(found))
    return list(found)


def drift(chance: Floats, said: Floats, when: Floats) -> str:
    """Return by how much the second half of a session is predicted better than the first."""
    first, last = (
        by_person(chance, np.where(half, said, np.nan)) for half in (when < 0.5, when >= 0.5)
    )
    apart = last - first
    return shown(over_people(lambda i: float(apart[i].mean()), len(apart)), 4)


def laws(choices: Choices, when: Floats, count: int) -> Iterator[str]:
    """Laws of error beside the product's, by the same draws."""
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    drawn = error_laws.draws(LEVELS, count, SEED)
    found = {}
    for name in (PLAIN, *LAWS):
        by_side = error_laws.chances(error_laws.LAWS[name], drawn, choices)
        full = error_laws.log_weights(by_side, choices, np.ones((n, m), dtype=np.bool_))
        own, _ = error_laws.predicted(by_side, choices, fold_of, np.ones(n, dtype=np.bool_))
        prior = error_laws.prior_of_people(full, half)
        shared, _ = error_laws.predicted(by_side, choices, fold_of, ~half, prior)
        found[name] = own, shared
    yield "## Another law of error"
    yield ""
    yield (
        "Gain over the product's law, logistic in d.e with a lapse. The last column has a prior of "
        "the choosing half's people for both laws. A law that divides by the spread of a pair "
        "needs both bags. `answer_probability(d)` knows only their difference: such a law must do "
        "with the spread of what differs."
    )
    yield ""
    rows = []
    for name in LAWS:
        own, shared = found[name]
        plain, plain_shared = found[PLAIN]
        rows.append([
            error_laws.LAWS[name].label,
            gain(own[half], plain[half], choices.said[half]),
            gain(own[~half], plain[~half], choices.said[~half]),
            gain(shared[~half], plain_shared[~half], choices.said[~half]),
        ])  # fmt: skip
    head = ("law", "choosing half", "reporting half", "reporting half, with a prior of people")
    yield from markdown(head, rows, 1)
    apart = drift(found[PLAIN][0][~half], choices.said[~half], when[~half])
    yield ""
    yield (
        "**Drift.** By the product's law the second half of the reporting half's sessions is "
        f"predicted better than the first by {apart} nats an answer."
    )


def answers_of(choices: Choices, person: int) -> Answers:
    """Return all answers of a person."""
    there = choices.answered[person]
    return Answers(choices.d[there], np.where(choices.said[person, there] == 1, 1, -1))


def earlier_people(choices: Choices, fewer: Sequence[int]) -> Iterator[str]:
    """``like=`` on the reporting half, beside rivals that know as much."""
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    before = np.random.default_rng(SEED).permutation(np.flatnonzero(half))
    found: dict[str, comparators.Predictions] = {}
    learned: EarlierPeople | None = None
    for count in (0, *fewer, len(before)):
        like = [answers_of(choices, i) for i in before[:count]]
        learned = PosteriorComparator(LEVELS, like=like).like
        name = f"PosteriorComparator, like {count} people" if count else "PosteriorComparator"
        found[name] = comparators.on_questions(
            lambda k, learned=learned: PosteriorComparator(k, like=learned),
            choices,
            fold_of,
            ~half,
        )
    seen = comparators.features(choices)["logistic fit on shares"]
    strength = max(
        comparators.STRENGTHS,
        key=lambda s: log_likelihood(
            comparators.by_logistic_fit(seen, choices, fold_of, half, s).chance, choices.said
        ),
    )
    alone = comparators.by_logistic_fit(seen, choices, fold_of, ~half, strength)
    found[f"logistic fit on shares (inverse ridge {strength:g})"] = alone
    majority = by_the_half(choices, half)
    found["majority of the choosing half"] = comparators.Predictions(
        np.sign(majority - 0.5), majority
    )
    own = np.column_stack([seen, np.log(majority[0] / (1.0 - majority[0]))])
    pooled = comparators.by_logistic_fit(own, choices, fold_of, ~half, strength)
    found["logistic fit on shares and that majority"] = pooled
    said = choices.said[~half]
    plain = found["PosteriorComparator"].chance[~half]
    rows = []
    for name, (verdict, chance, _) in found.items():
        v, p = verdict[~half], chance[~half]
        clear = choices.answered[~half]
        decided = clear & (np.abs(v) == 1)
        wrong = decided & (v == np.where(said == 1, -1, 1))
        share = over_people(lambda i, d=decided, c=clear: d[i].sum() / c[i].sum(), len(v))
        other = over_people(lambda i, d=decided, w=wrong: w[i].sum() / max(1, d[i].sum()), len(v))
        right = over_people(lambda i, p=p: agreement(p[i], said[i]), len(v))
        ours = name.startswith("Posterior")
        rows.append([
            name,
            shown(over_people(lambda i, p=p: log_likelihood(p[i], said[i]), len(v))),
            "" if name == "PosteriorComparator" else gain(p, plain, said),
            shown(over_people(lambda i, p=p: calibration_error(p[i], said[i]), len(v))),
            shown(right, 1, percent=True),
            shown(share, 1, percent=True) if ours else "",
            shown(other, 1, percent=True) if ours else "",
        ])  # fmt: skip
    yield "## A prior of earlier people"
    yield ""
    yield (
        f"The reporting half, {int((~half).sum())} people. The earlier people are of the choosing "
        "half, all their answers. The majority of the choosing half is told what the others "
        "answered to *this* question, which no comparator is."
    )
    yield ""
    head = ("", "log-likelihood", "gain", "calibration error", "on the likelier side", "decided",
            "answered otherwise")  # fmt: skip
    yield from markdown(head, rows, 1)
    yield ""
    yield 'The probability of the answer "left" beside the share of answers that are:'
    yield ""
    last = f"PosteriorComparator, like {len(before)} people"
    yield from markdown(
        ("probability", "answers", "without, mean", "said left", "answers", "with, mean",
         "said left"),
        [
            [name, *one, *other]
            for name, one, other in zip(
                [f"{i / 10:.1f} to {(i + 1) / 10:.1f}" for i in range(10)],
                curve(plain, said),
                curve(found[last].chance[~half], said),
                strict=True,
            )
        ],
        1,
    )  # fmt: skip
    yield from after_few(choices, learned, COUNTS[:2] if len(fewer) == 1 else COUNTS)


def after_few(
    choices: Choices, learned: EarlierPeople | None, counts: Sequence[int]
) -> Iterator[str]:
    """Measure how soon a person is known, with and without earlier people."""
    n, m = choices.said.shape
    who = np.flatnonzero(~choosing_half(n))
    fold_of = deal(n, m, FOLDS, SEED)
    chance = {count: np.full((2, len(who), m), np.nan) for count in counts}
    decided = {count: np.zeros((2, len(who))) for count in counts}
    for row, person in enumerate(who):
        test = (fold_of[person] == 0) & choices.answered[person]
        others = np.flatnonzero((fold_of[person] != 0) & choices.answered[person])
        order = np.random.default_rng([SEED, person]).permutation(others)
        y = np.where(choices.said[person] == 1, 1, -1)
        for i, prior in enumerate((None, learned)):
            known, told = PosteriorComparator(LEVELS, like=prior), 0
            for count in counts:
                new = order[told:count]
                known, told = known.update(Answers(choices.d[new], y[new])), count
                chance[count][i, row, test] = known.answer_probability(choices.d[test])
                decided[count][i, row] = (known.compare(choices.d[test]) != 2).mean()
    yield ""
    yield (
        "How soon a person is known: log-likelihood of the answers of one fifth, and the share of "
        "it that is decided, after the first answers of the rest, in an order drawn by chance."
    )
    yield ""
    rows = []
    for count in counts:
        cells = []
        for i in (0, 1):
            scores = by_person(chance[count][i], choices.said[who])
            cells += [
                shown(over_people(lambda j, s=scores: float(s[j].mean()), len(who))),
                f"{100 * decided[count][i].mean():.1f}%",
            ]
        rows.append([f"{count}", *cells])
    head = ("answers", "without", "decided", "with", "decided")
    yield from markdown(head, rows, 1)


def by_the_half(choices: Choices, who: Bools) -> Floats:
    """Return for each person (n, m) the share of ``who`` who said left, with one answer each way
    added."""
    said = choices.said[who]
    share = (np.nansum(said, axis=0) + 1) / ((~np.isnan(said)).sum(axis=0) + 2)
    return np.where(choices.answered, share, np.nan)


def curve(chance: Floats, said: Floats) -> list[list[str]]:
    """Return the number of answers, the mean probability and the share of "left", by tenths."""
    clear = ~np.isnan(said) & ~np.isnan(chance)
    p, y = chance[clear], said[clear]
    tenth = np.minimum((p * 10).astype(int), 9)
    rows = []
    for i in range(10):
        here = tenth == i
        some = [f"{p[here].mean():.2f}", f"{y[here].mean():.2f}"] if here.any() else ["", ""]
        rows.append([f"{int(here.sum())}", *some])
    return rows


def questions(folder: Path, most: int | None) -> Iterator[str]:
    """Questions until the best of five gambles is found, with a person's own repeats as answers."""
    tables = {
        "20 times": lambda number: repeated_gambles(sets=[number]),
        "45 times": lambda number: repeated_gambles(folder / "gambles_45_times.csv", sets=[number]),
    }
    rows = [
        row
        for experiment, load in tables.items()
        for row in gamble_rows(experiment, load, (1, 2), most)
    ]
    yield "## Questions until the best of five gambles is found"
    yield ""
    yield (
        "`elicit.choose` asks the reporting half, and each answer is one of the person's own. "
        f"*With*: the first {ANSWERS_BEFORE} answers of each person of the choosing half are "
        "known. *Ended*: a best gamble was found before the person's repeats ran out. *Preferred*: "
        "the share of the person's unused answers that prefer the gamble found to another."
    )
    yield ""
    head = ("experiment", "earlier people", "people", "questions", "ended", "preferred")
    yield from markdown(head, rows, 2)


def gamble_rows(
    experiment: str,
    load: Callable[[int], dict[str, AnswerLog]],
    sets: Sequence[int],
    most: int | None = None,
) -> Iterator[list[str]]:
    """Rows of questions without earlier people and with them, for sets of gambles."""
    for number in sets:
        logs = dict(list(load(number).items())[:most])
        names = np.array(sorted(logs))
        half = choosing_half(len(names))
        k = logs[names[0]].k or 0
        like = PosteriorComparator(
            k, like=[logs[name].answers()[:ANSWERS_BEFORE] for name in names[half]]
        ).like
        for label, prior in (("without", None), ("with", like)):
            runs = np.array([best_of(logs[name], k, prior) for name in names[~half]])
            yield [
                f"{experiment}, set {number}",
                label,
                f"{len(runs)}",
                _mean(runs[:, 0], 1, False),
                _mean(runs[:, 1], 0, True),
                _mean(runs[:, 2], 1, True),
            ]


def _mean(x: Floats, digits: int, percent: bool) -> str:
    known = x[~np.isnan(x)]
    if not len(known):
        return ""
    return shown(over_people(lambda i: float(known[i].mean()), len(known)), digits, percent)


def best_of(log: AnswerLog, k: int, like: object) -> tuple[float, float, float]:
    """Return the number of questions, whether a best gamble was found, and how often the person's
    other answers prefer it."""
    vectors = bags_of(log)
    asker = choose(vectors, PosteriorComparator(k, like=like))  # type: ignore[arg-type]
    tutor = RepeatedAnswersTutor(log, SEED)
    asked, ended = 0, True
    try:
        while pending := asker.ask():
            asker.tell([tutor(query) for query in pending])
            asked += len(pending)
    except NoRepeatLeft:
        ended = False
    best = asker.result().best
    scores = []
    for other in range(len(vectors)):
        if other != best:
            query = Query("left over", vectors[best], vectors[other])
            said = [int(tutor(query).verdict or 0) for _ in range(tutor.left_over(query))]
            if said:
                scores.append(float(np.mean([(1 + verdict) / 2 for verdict in said])))
    return float(asked), float(ended), float(np.mean(scores)) if scores else float("nan")


def bags_of(log: AnswerLog) -> Floats:
    """Return the different bags (5, k) of the questions of a log."""
    found: NDArray[np.float64] = np.unique(
        np.array([entry.answer.query.left for entry in log]
                 + [entry.answer.query.right for entry in log]), axis=0
    )  # fmt: skip
    return found


if __name__ == "__main__":
    main()
