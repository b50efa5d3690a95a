"""Errors of people, the law of error that fits them, and predictions of answers by comparators.

Needs the folder with the tables that are not shipped; docs/people.md says what they hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.people import comparators, error_laws, repeats
from benchmarks.people.choices import (
    BINS,
    SPLIT_SEED,
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
from elicit.model.scale import Floats
from elicit.people.experiments import lottery_choices, repeated_gambles
from elicit.tutors.answer_log import AnswerLog
from elicit.tutors.person import DRAWN_FROM, PersonTutor

FOLDS = 5
LEVELS = (6, 8, 10)
DRAWS = 40_000
GROUPS = 5  # of the choosing half: a prior of people for one group is of the others
TRIED = ("logistic, lapse", "spread")  # laws at each number of levels
SEED = 0


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    main_of_people(
        "benchmarks.people.answers_of_people", report, f"{SEED}, halves by {SPLIT_SEED}", arguments
    )


def report(folder: Path, quick: bool = False) -> Iterator[list[str]]:
    """The page, part by part."""
    most, count = (8, 2000) if quick else (None, DRAWS)
    logs = {
        "20 times": _first(repeated_gambles(), most),
        "45 times": _first(repeated_gambles(folder / "gambles_45_times.csv"), most),
    }
    yield introduction()
    yield list(again(logs, folder))
    yield list(repeat_laws(logs, count))
    people = _first(lottery_choices(folder, LEVELS[0]), most)
    tried = {}
    for levels in LEVELS[:1] if quick else LEVELS:
        choices = choices_of(_first(lottery_choices(folder, levels), most))
        tried[levels] = choices, choose(choices, TRIED, count)
    levels = max(tried, key=lambda k: tried[k][1]["logistic, lapse"][0])
    choices = tried[levels][0]
    chosen = choose(choices, tuple(error_laws.LAWS), count)
    yield list(choosing_page(tried, levels, chosen, len(people)))
    yield list(lottery_laws(choices, count))
    yield list(lottery_comparators(choices, levels))
    yield list(repeat_comparators(logs))
    yield list(person_tutors(logs, folder))
    yield ["## Machine", "", machine("one thread")]


def _first(logs: dict[str, AnswerLog], most: int | None) -> dict[str, AnswerLog]:
    return dict(list(logs.items())[:most])


def introduction() -> list[str]:
    return [
        "# Answers of real people",
        "",
        "Every other page of results asks simulated tutors. This one replays people who chose "
        "between lotteries over money in public experiments. [People](../docs/people.md) says what "
        "it means.",
        "",
        "- *20 times*: 18 people, two sets of five gambles, each of the 20 pairs put 20 times "
        "(Regenwetter, Dana and Davis-Stober 2011).",
        '- *45 times*: 30 people, the same gambles, 45 times, with the answer "indifferent" '
        "(Regenwetter and Davis-Stober 2012).",
        "- *subsets*: 141 people, the ten pairs of five gambles, each put 6 times, sides on record "
        "(McCausland and others 2020). Its amounts are not at hand.",
        "- *lotteries*: 139 people, 70 pairs of lotteries, each put once, sides on record "
        "(Baillon, Bleichrodt and Spinu 2020). Amounts are split between neighbouring levels.",
        "",
        f"The people of each experiment are split into halves (seed {SPLIT_SEED}). Whatever is "
        "chosen is chosen on the one half; tables are of the other, unless they say so. Intervals "
        "are of 95%, by a bootstrap over people.",
        "",
        "*Log-likelihood* is the mean per answer, in nats; a coin has -0.693. *Calibration error* "
        f'is the expected one in {BINS} equal bins of the probability of "left" (left is lottery '
        "a of the tables, which 62% of the answers prefer). *Answered otherwise* is the share of "
        "answers that say the opposite of a verdict that was given without them.",
    ]


def again(logs: dict[str, dict[str, AnswerLog]], folder: Path) -> Iterator[str]:
    """Write the section on people who answer the same question again."""
    head = ("experiment", "people", "answers that disagree", "pairs without disagreement",
            "quartiles of a pair's disagreement", "people's, from least to most",
            "said indifferent")  # fmt: skip
    rows = []
    subsets, sides = repeats.of_subsets(folder / "gambles_every_subset.csv")
    tables = {
        f"{name}, set {number}": each
        for name, by_set in logs.items()
        for number, each in repeats.of_logs(by_set).items()
    }
    for name, each in sorted((tables | {"subsets": subsets}).items()):
        counts = each.counts[~repeats.halves(each)]
        share = repeats.minority_shares(counts)
        own = share.mean(axis=1)
        never = (share == 0).mean(axis=1)
        equal = counts[..., 2].sum(axis=1) / counts.sum(axis=(1, 2))
        quartiles = ", ".join(f"{100 * q:.0f}%" for q in np.quantile(share, [0.25, 0.5, 0.75]))
        rows.append([
            name, str(len(counts)), _mean(own), _mean(never), quartiles,
            f"{100 * own.min():.0f}% to {100 * own.max():.0f}%", _mean(equal),
        ])  # fmt: skip
    yield "## The same question again"
    yield ""
    yield (
        "An answer disagrees if it is not the person's most frequent one to that pair. With few "
        "repeats a pair shows no disagreement by luck, so *subsets* looks steadier than it is."
    )
    yield ""
    yield from markdown(head, rows, 1)
    yield ""
    half = repeats.halves(subsets)
    left, total = sides[~half].T
    yield (
        "**Sides.** Of the pairs of *subsets*, people took the side shown left in "
        f"{_mean(left / total)} of the cases. Beyond chance, people differ by "
        f"{_extra(left, total)} (standard deviation). Lotteries follow below."
    )


def _mean(x: Floats) -> str:
    return shown(over_people(lambda i: float(x[i].mean()), len(x)), 1, percent=True)


def _extra(left: Floats, total: Floats) -> str:
    found = over_people(lambda i: repeats.extra_spread(left[i], total[i]), len(left))
    return shown(found, 1, percent=True)


def repeat_laws(logs: dict[str, dict[str, AnswerLog]], count: int) -> Iterator[str]:
    """Yield the lines of the report's section that compares laws of error on repeated gambles."""
    drawn = repeats.draws(count, SEED)
    tables = [each for by_set in logs.values() for each in repeats.of_logs(by_set).items()]
    rows = []
    for law, label in repeats.LAWS.items():
        parts = list[str]()
        for reported in (False, True):
            scores = []
            for number, each in tables:
                half = repeats.halves(each)
                found, _ = repeats.held_out_pairs(law, each, number, drawn)
                scores.append(found[~half if reported else half])
            score = np.concatenate(scores)
            parts.append(shown(over_people(lambda i, s=score: float(s[i].mean()), len(score))))
        rows.append([label, *parts])
    yield "## Laws of error on repeated gambles"
    yield ""
    yield (
        "Log-likelihood of all answers to a pair, by the person's answers to the other pairs of "
        "the set. A prize is worth a power of it; power, precision and lapse are averaged over "
        "their posterior. *Spread* is the root of the two bags' mean variance of value. A unit of "
        "the bootstrap is a person and a set."
    )
    yield ""
    yield from markdown(("law", "choosing half", "reporting half"), rows, 1)


def choose(
    choices: Choices, names: Sequence[str], count: int
) -> dict[str, tuple[float, float, float, float]]:
    """Return log-likelihoods and calibration errors of laws on the choosing half: by the prior of
    the product, then by a prior of other people of this half."""
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    drawn = error_laws.draws(choices.left.shape[1], count, SEED)
    groups = np.random.default_rng(SEED).integers(0, GROUPS, n)
    found = {}
    for name in names:
        by_side = error_laws.chances(error_laws.LAWS[name], drawn, choices)
        full = error_laws.log_weights(by_side, choices, np.ones((n, m), dtype=np.bool_))
        own, _ = error_laws.predicted(by_side, choices, fold_of, half)
        shared = np.full((n, m), np.nan)
        for group in range(GROUPS):
            here = half & (groups == group)
            if here.any():
                prior = error_laws.prior_of_people(full, half & ~here)
                shared[here] = error_laws.predicted(by_side, choices, fold_of, here, prior)[0][here]
        found[name] = (
            log_likelihood(own[half], choices.said[half]),
            calibration_error(own[half], choices.said[half]),
            log_likelihood(shared[half], choices.said[half]),
            calibration_error(shared[half], choices.said[half]),
        )
    return found


def choosing_page(
    tried: dict[int, tuple[Choices, dict[str, tuple[float, float, float, float]]]],
    levels: int,
    chosen: dict[str, tuple[float, float, float, float]],
    people: int,
) -> Iterator[str]:
    """Write the page on levels and laws, as the choosing half of the people shows them."""
    head = ("levels", "law", "log-likelihood", "calibration error", "with a prior of people: "
            "log-likelihood", "calibration error")  # fmt: skip
    yield "## Lotteries: the choosing half"
    yield ""
    yield (
        f"{int(choosing_half(people).sum())} people; each fifth of a person's answers is predicted "
        "by the rest. A *prior of people* is learned from the other people of this half. The "
        f"number of levels is that of the best log-likelihood of the product's law: {levels}."
    )
    yield ""
    rows = [
        [str(k), error_laws.LAWS[name].label, *_four(scores)]
        for k, (_, found) in tried.items()
        if k != levels
        for name, scores in found.items()
    ]
    rows += [
        [str(levels), error_laws.LAWS[name].label, *_four(each)] for name, each in chosen.items()
    ]
    yield from markdown(head, rows, 2)
    best, best_shared = (max(chosen, key=lambda law: chosen[law][i]) for i in (0, 2))
    yield ""
    yield (
        f"Best: {error_laws.LAWS[best].label}; with a prior of people, "
        f"{error_laws.LAWS[best_shared].label}."
    )


def _four(scores: tuple[float, float, float, float]) -> list[str]:
    return [f"{x:.3f}" for x in scores]


def _scores(chance: Floats, choices: Choices, who: Bools) -> list[str]:
    """Return log-likelihood, calibration error and agreement, with intervals over people."""
    p, said = chance[who], choices.said[who]
    if np.isnan(p).all():
        return ["", ""]
    return [
        shown(over_people(lambda i, of=score: of(p[i], said[i]), len(p)))
        for score in (log_likelihood, calibration_error)
    ]


def lottery_laws(choices: Choices, count: int) -> Iterator[str]:
    """Laws of error on the reporting half."""
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    drawn = error_laws.draws(choices.left.shape[1], count, SEED)
    rows = []
    for law in error_laws.LAWS.values():
        by_side = error_laws.chances(law, drawn, choices)
        full = error_laws.log_weights(by_side, choices, np.ones((n, m), dtype=np.bool_))
        for people in (False, True):
            prior = error_laws.prior_of_people(full, half) if people else None
            chance, sizes = error_laws.predicted(by_side, choices, fold_of, ~half, prior)
            hits = chance[~half], choices.said[~half]
            right = over_people(lambda i, h=hits: agreement(h[0][i], h[1][i]), len(hits[0]))
            rows.append([
                law.label, "people" if people else "product",
                *_scores(chance, choices, ~half), shown(right, 1, percent=True),
                f"{np.median(sizes):.0f} ({100 * (sizes < 20).mean():.0f}%)",
            ])  # fmt: skip
    yield "## Laws of error on lotteries"
    yield ""
    yield (
        f"The reporting half, {int((~half).sum())} people. Means over the posterior by "
        f"{count:,} draws from the prior; the last column has the median of the draws that a "
        "prediction is worth, and how many predictions are worth fewer than 20."
    )
    yield ""
    head = ("law", "prior", "log-likelihood", "calibration error", "on the likelier side",
            "draws")  # fmt: skip
    yield from markdown(head, rows, 2)
    left = (choices.said == (choices.side == 1)).astype(float)[~half]
    answered = choices.answered[~half]
    yield ""
    yield (
        "**Sides.** Lotteries shown first were taken in "
        f"{_mean((left * answered).sum(axis=1) / answered.sum(axis=1))} of the cases; beyond "
        f"chance, people differ by {_extra((left * answered).sum(axis=1), answered.sum(axis=1))}."
    )


def lottery_comparators(choices: Choices, levels: int) -> Iterator[str]:
    """Comparators and rivals on the reporting half."""
    n, m = choices.said.shape
    half, fold_of = choosing_half(n), deal(n, m, FOLDS, SEED)
    found = {
        name: comparators.on_questions(make, choices, fold_of, ~half)
        for name, make in comparators.MAKES.items()
    }
    for name, seen in comparators.features(choices).items():
        strength = max(
            comparators.STRENGTHS,
            key=lambda s, seen=seen: log_likelihood(
                comparators.by_logistic_fit(seen, choices, fold_of, half, s).chance, choices.said
            ),
        )
        rival = comparators.by_logistic_fit(seen, choices, fold_of, ~half, strength)
        found[f"{name} (inverse ridge {strength:g})"] = rival
    found["majority of the others"] = comparators.by_others(choices, ~half)
    posterior = found["PosteriorComparator"]
    if posterior.better is not None:
        taken = posterior._replace(chance=posterior.better)
        found["PosteriorComparator, `probability` taken for it"] = taken
    rows = []
    for name, (verdict, chance, _) in found.items():
        clear = choices.answered[~half] & ~np.isnan(verdict[~half])
        v, y = verdict[~half], np.where(choices.said[~half] == 1, 1, -1)
        decided = clear & (np.abs(v) == 1)
        wrong = decided & (v == -y)
        share = over_people(lambda i, d=decided, c=clear: d[i].sum() / c[i].sum(), len(v))
        other = over_people(lambda i, d=decided, w=wrong: w[i].sum() / max(1, d[i].sum()), len(v))
        rows.append([
            name, shown(share, 1, percent=True), shown(other, 1, percent=True),
            *_scores(chance, choices, ~half),
        ])  # fmt: skip
    yield "## Comparators and rivals on lotteries"
    yield ""
    yield (
        f"The reporting half, {levels} levels; each fifth of a person's answers is predicted by "
        "the rest. The probability is `answer_probability` of the posterior and the point of "
        "`probability` of Bradley-Terry. The majority of the others is of the same half, and knows "
        "what no comparator is told."
    )
    yield ""
    head = ("", "decided", "answered otherwise", "log-likelihood", "calibration error")
    yield from markdown(head, rows, 1)


def repeat_comparators(logs: dict[str, dict[str, AnswerLog]]) -> Iterator[str]:
    """Comparators on pairs of repeated gambles that they were not told of."""
    rows = []
    for name, make in comparators.MAKES.items():
        for experiment, people in logs.items():
            half = choosing_half(len(people))
            names = sorted(people)
            scores = np.array([
                comparators.on_repeats(make, people[who], FOLDS, SEED)
                for who, chosen in zip(names, half, strict=True) if not chosen
            ])  # fmt: skip
            decided, other, own, total, logs_ = np.moveaxis(scores, -1, 0)
            sure = decided == 1

            def of_decided(x: Floats, i: Floats, sure: Bools = sure) -> float:
                taken = x[i][sure[i]]
                return float(taken.mean()) if len(taken) else float("nan")

            n = len(scores)
            rows.append([
                name, experiment,
                _mean(decided.mean(axis=1)),
                shown(over_people(lambda i, o=other: of_decided(o, i), n), 1, percent=True),
                shown(over_people(lambda i, o=own: of_decided(o, i), n), 1, percent=True),
                "" if np.isnan(logs_).any()
                else shown(over_people(lambda i, a=logs_, t=total: a[i].sum() / t[i].sum(), n)),
            ])  # fmt: skip
    yield "## Comparators on repeated gambles"
    yield ""
    yield (
        f"Each fifth of a person's 20 pairs is judged after {comparators.TIMES} answers to each of "
        "the other pairs. *Own disagreement* is the share of the person's answers to the decided "
        "pairs that are not the most frequent one; EQUAL is among them, but is no answer "
        "otherwise."
    )
    yield ""
    head = ("", "experiment", "decided", "answered otherwise", "own disagreement",
            "log-likelihood")  # fmt: skip
    yield from markdown(head, rows, 2)


def person_tutors(logs: dict[str, dict[str, AnswerLog]], folder: Path) -> Iterator[str]:
    """Parameters of ``elicit.PersonTutor``, and its answers beside people's."""
    subsets, sides = repeats.of_subsets(folder / "gambles_every_subset.csv")
    found = parameters(logs) | side_bias(*sides[repeats.halves(subsets)].T)
    yield "## PersonTutor"
    yield ""
    yield (
        "Means and standard deviations over people of the choosing half (repeated gambles, law: "
        f"{repeats.LAWS['spread, lapse']}; the side bias is of *subsets*), "
        "and what `elicit.PersonTutor` draws from:"
    )
    yield ""
    given = DRAWN_FROM._asdict()
    rows = [[name, f"{value:.2f}", f"{given[name]:.2f}"] for name, value in found.items()]
    yield from markdown(("parameter", "found", "in PersonTutor"), rows, 1)
    yield ""
    yield (
        "Repeats of simulated persons, one for each person of the reporting half, with that "
        "person's posterior mean scale, beside the repeats of these people:"
    )
    yield ""
    rows = []
    for experiment, people in logs.items():
        counts, twins = twin_counts(people)
        for who, each in (("people", counts), ("PersonTutor", twins)):
            share = repeats.minority_shares(each)
            quartiles = ", ".join(f"{100 * q:.0f}%" for q in np.quantile(share, [0.25, 0.5, 0.75]))
            rows.append([
                experiment, who, _mean(share.mean(axis=1)), _mean((share == 0).mean(axis=1)),
                quartiles, _mean(each[..., 2].sum(axis=1) / each.sum(axis=(1, 2))),
            ])  # fmt: skip
    head = ("experiment", "", "answers that disagree", "pairs without disagreement",
            "quartiles of a pair's disagreement", "indifferent")  # fmt: skip
    yield from markdown(head, rows, 2)


def parameters(logs: dict[str, dict[str, AnswerLog]]) -> dict[str, float]:
    """Return what ``PersonTutor`` draws from, found on the choosing half."""
    drawn = repeats.draws(DRAWS, SEED)
    pools, tied, untied = [], [], 0
    for experiment, people in logs.items():
        for number, each in repeats.of_logs(people).items():
            half = repeats.halves(each)
            _, full = repeats.held_out_pairs("spread, lapse", each, number, drawn)
            weights = error_laws.normalised(full)
            pools.append(weights[:, half])
            if experiment == "45 times":
                says = each.counts[..., 2].sum(axis=1) > 0
                tied.append(weights[:, half & says])
                untied += int((half & ~says).sum())
    pool = np.concatenate(pools, axis=1).mean(axis=1)
    some = np.concatenate(tied, axis=1)

    def moments(x: Floats, w: Floats) -> tuple[float, float]:
        mean = float(w @ x)
        return mean, float(np.sqrt(w @ (x - mean) ** 2))

    precision, lapse = moments(drawn.precision, pool), moments(drawn.lapse, pool)
    width = moments(drawn.width, some.mean(axis=1))
    total = lapse[0] * (1 - lapse[0]) / lapse[1] ** 2 - 1
    return {
        "log_precision": precision[0],
        "log_precision_sd": precision[1],
        "lapse_a": lapse[0] * total,
        "lapse_b": (1 - lapse[0]) * total,
        "ties": some.shape[1] / (some.shape[1] + untied),
        "log_width": width[0],
        "log_width_sd": width[1],
    }


def side_bias(left: Floats, total: Floats) -> dict[str, float]:
    """Return mean and standard deviation over people of the side bias, in logits."""
    share = float((left / total).mean())
    slope = share * (1 - share)
    return {
        "side": float(np.log(share / (1 - share))),
        "side_sd": repeats.extra_spread(left, total) / slope,
    }


def twin_counts(people: dict[str, AnswerLog]) -> tuple[Floats, Floats]:
    """Return counts (people, pairs, 3) of the reporting half, and of simulated persons."""
    from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator

    names, half = sorted(people), choosing_half(len(people))
    real, twins = [], []
    for seed, name in enumerate(np.array(names)[~half].tolist()):
        log = people[name]
        queries = {entry.answer.query.id.rsplit(":", 1)[0]: entry.answer.query for entry in log}
        said = {pair: [0, 0, 0] for pair in queries}
        for entry in log:
            pair = entry.answer.query.id.rsplit(":", 1)[0]
            said[pair][{1: 0, -1: 1, 0: 2}[int(entry.answer.verdict or 0)]] += 1
        values = PosteriorComparator(log.k or 0).update(log.answers()[:120]).values
        tutor = PersonTutor(values, seed=seed)
        echo = []
        for query in queries.values():
            answers = [int(tutor(query).verdict or 0) for _ in range(len(log) // len(queries))]
            echo.append([answers.count(1), answers.count(-1), answers.count(0)])
        real.append(list(said.values()))
        twins.append(echo)
    return np.array(real, dtype=float), np.array(twins, dtype=float)


if __name__ == "__main__":
    main()
