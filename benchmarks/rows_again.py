"""Some rows of each page of results, made again: ``python -m benchmarks.evidence --repeat``.

A page of older code whose rows come out with the same digits still says what the code does. Rows
are the cheapest of their page; what is seconds in them is not compared.
"""

from __future__ import annotations

import csv
import io
import math
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias
from unittest.mock import patch

import numpy as np
import pandas as pd

from benchmarks import shown_ranges
from benchmarks.asking import (
    about_equal,
    certificates,
    certify_at_scale,
    cuts_and_pairs,
    headroom,
    loss_by_questions,
    person_sessions,
    question_counts,
    question_rules,
    wrong_answers,
)
from benchmarks.comparing import comparison_cost, families_and_rules
from benchmarks.contest import redraw
from benchmarks.evidence import PAGES, ROOT, Page
from benchmarks.fitting import calibration, calibration_questions, fit_cost
from benchmarks.fitting.calibration_tables import shown, summary
from benchmarks.history import repeated
from benchmarks.learning import growth_by_size, learning_cost, value_iteration_cost
from benchmarks.learning.learning_runs import Setting
from benchmarks.learning.learning_tables import Kind, described
from benchmarks.paper import ablation_table, assumptions, exploration, literal
from benchmarks.paper.paired_runs import Choice, measure_all
from benchmarks.people import answers_of_people, gains, kinds_of_question, panel, promise, raters
from benchmarks.people.repeats import of_logs
from benchmarks.posteriors import preference_posteriors
from benchmarks.quotes import table_rows
from benchmarks.reporting import with_interval
from benchmarks.rivals import printed_figures
from benchmarks.training import dqn_on_terrain, training_questions
from elicit.model.scale import Floats
from elicit.people import repeated_gambles
from qlearn.paper.claims import claims_page
from qlearn.paper.figure_runs import figures

Cells: TypeAlias = list[str | None]  # of a row of a page, None for seconds and the like
Again: TypeAlias = Callable[
    [str], Iterator[str | Cells]
]  # from a page's text to its rows, or sentences, made again


class Sample(NamedTuple):
    """Rows of a page: its name, the function that repeats them, and whether it takes seconds."""

    page: str
    again: Again
    quick: bool = False


def differing(page: Page, again: Again) -> list[str | Cells]:
    """Return the repeated rows that are not on the page digit for digit."""
    text = (ROOT / page.path).read_text(encoding="utf-8")
    rows = list(csv.reader(io.StringIO(text))) if page.path.endswith(".csv") else table_rows(text)
    made = list(again(text))
    assert made, f"nothing of {page.path} was made again"
    return [
        found
        for found in made
        if not (found in text if isinstance(found, str) else any_like(found, rows))
    ]


def any_like(found: Cells, rows: list[list[str]]) -> bool:
    """Return whether a row is there, apart from cells that are not compared."""
    return any(len(row) == len(found) and all(map(alike, found, row)) for row in rows)


def alike(made: str | None, there: str) -> bool:
    """Return whether a cell is the same; long floats of tables may differ in their last digits."""
    if made is None or made == there:
        return True
    try:
        return len(made) > 12 and math.isclose(
            float(made), float(there), rel_tol=1e-9, abs_tol=1e-12
        )
    except ValueError:
        return False


def cells(line: str, *timed: int) -> Cells:
    """Return the cells of a line of Markdown, except those in the places ``timed``."""
    (row,) = table_rows(line)
    return without(row, *timed)


def without(row: list[str], *places: int) -> Cells:
    """Return the cells of a row, with None in some places, counted from either end."""
    return [None if i - len(row) in places or i in places else cell for i, cell in enumerate(row)]


def under(text: str, heading: str) -> str:
    """The part of a page below a heading."""
    return re.split(r"^## ", text.split(f"## {heading}\n")[1], flags=re.MULTILINE)[0]


def number(text: str, *start: str, place: int) -> int:
    """Return the number in a place of the row that begins with ``start``."""
    return next(int(row[place]) for row in table_rows(text) if row[: len(start)] == [*start])


def certified(name: str, who: str, errs: str) -> Again:
    def again(text: str) -> Iterator[str | Cells]:
        runs = [
            certificates.plan(name, who, errs, seed)
            for seed in range(number(text, name, who, errs, place=4))
        ]
        row: list[str | None] = [
            *certificates.line(runs[0], [certificates.certify(cell) for cell in runs])
        ]
        yield [*row[:-1], None]

    return again


def questions(method: str, comparator: str, error: float) -> Again:
    def again(text: str) -> Iterator[str | Cells]:
        count = int(re.search(r"mean over (\d+) problems", text)[1])
        todo = question_counts.cells(["k = 5"], count, [method])
        todo = [cell for cell in todo if (cell["comparator"], cell["error"]) == (comparator, error)]
        yield question_counts.line(method, comparator, [question_counts.run(cell) for cell in todo])

    return again


def equal(text: str) -> Iterator[str | Cells]:
    start = ("polytope", "policy iteration", "0.02")
    count = number(text, *start, place=3) // len(about_equal.LEVELS)
    yield [*about_equal.row(*start[:2], float(start[2]), count)]


def unasked(text: str) -> Iterator[str | Cells]:
    count = int(re.search(r"of (\d+) draws", text)[1])
    for name in ("career", "plant"):
        yield [*headroom.described(name, headroom.losses(name, range(count), ["even"])["even"])]


def asked_together(text: str) -> Iterator[str | Cells]:
    count = int(re.search(r"Seeds 0 to (\d+)", text)[1]) + 1
    key = panel.SMALL, "independent", "never"
    found = panel.runs(*key, range(count))
    yield [*panel.described(*key, found)]


def promised(text: str) -> Iterator[str | Cells]:
    key = promise.STATES[0], "PersonTutor", promise.LEVELS[0]
    runs = number(text, *map(str, key), place=3)
    of_row = [
        cell for cell in promise.cells(runs) if (cell["states"], cell["tutor"], cell["k"]) == key
    ]
    yield [*promise.line(*key, [promise.promised(cell) for cell in of_row])]


def by_every_rule(text: str) -> Iterator[str | Cells]:
    count = int(re.search(r"over (\d+) problems", text)[1])
    runs = [
        families_and_rules.run({"problem": "career", "kind": kind, "seed": seed})
        for seed in range(families_and_rules.FIRST, families_and_rules.FIRST + count)
        for kind in families_and_rules.KINDS
    ]
    yield [*families_and_rules.row("career", runs)]


def asked_so_far(text: str) -> Iterator[str | Cells]:
    count = int(re.search(r"mean over (\d+) hidden scales", text)[1])
    frame = pd.DataFrame(loss_by_questions.curves("career", range(count), 30))
    part = frame[frame["method"] == "policy-iteration"]
    shown = loss_by_questions.SHOWN
    yield ["policy iteration", *(loss_by_questions._cell(part, n, "loss") for n in shown)]


def contested(text: str) -> Iterator[str | Cells]:
    """From the committed rows; tests/benchmarks/contest/test_rows.py runs some of them again."""
    for line in redraw.claim_table(redraw.load())[2:]:
        yield cells(line)


def cut(text: str) -> Iterator[str | Cells]:
    count, first = int(re.search(r"over (\d+) problems", text)[1]), cuts_and_pairs.FIRST
    cell = {"problem": "plant", "tolerance": 0.01}
    runs = [
        cuts_and_pairs.run(cell | {"kind": kind, "seed": seed})
        for kind in cuts_and_pairs.KINDS
        for seed in range(first, first + count)
    ]
    yield [*cuts_and_pairs.row("plant", 0.01, runs)]


def wrong(text: str) -> Iterator[str | Cells]:
    setting = (5, "one lie", 1)
    count = number(text, "5", "one lie", "1", place=3)
    cell = dict(zip(("k", "tutor", "allowed"), setting, strict=True))
    runs = [wrong_answers.Run(**wrong_answers.run(cell | {"seed": seed})) for seed in range(count)]
    row: Cells = [*wrong_answers.row(*setting, runs)]
    yield [*row[:5], None, *row[6:]]


def sessions(text: str) -> Iterator[str | Cells]:
    setting = person_sessions.SETTINGS[0]
    count = number(text, setting.comparator, f"{setting.tolerance:g}", place=4)
    yield person_sessions.row_of(
        setting, [person_sessions.session(setting, i) for i in range(count)]
    )


def ranges(text: str) -> Iterator[str | Cells]:
    problem, setting = "list of 6, 4 levels", shown_ranges.Setting("few large steps", "few")
    settled = next(row[3] for row in table_rows(text) if row[:3] == [problem, *setting])
    asked = int(settled.split(" of ")[1])
    with tempfile.TemporaryDirectory() as name:
        shown_ranges.write_lists(folder := Path(name))
        runs = [shown_ranges.interview(problem, setting, i, folder) for i in range(asked)]
    found = [run for run in runs if run is not None]
    yield shown_ranges.row_of((problem, *setting), asked, found)


def scale(text: str) -> Iterator[str | Cells]:
    row = certify_at_scale.row("random", 1000, 0.95, number(text, "1,000", "0.95", place=2), 600.0)
    timed = ("seconds", "values known", "ratio", "peak memory")  # columns may be added to the page
    yield without(row, *(i for i, at in enumerate(certify_at_scale.HEAD) if at.startswith(timed)))


def grown(text: str) -> Iterator[str | Cells]:
    """Questions of the smallest problems, and what few answers leave open."""
    with patch.object(growth_by_size, "ENOUGH", math.inf):
        learned = growth_by_size.learned("Q-learning, polytope", 100, growth_by_size.LEVELS)
        informed = growth_by_size.informed("polytope", 10)
    row = growth_by_size.row("states", "Q-learning, polytope", 100, learned)
    yield without(row, 3, 5)
    row = growth_by_size.row("answers", "polytope", 10, informed)
    yield without(row, 3, 4, 6)


def calibrated(setting: int, rule: str) -> Again:
    """The rows of fresh pairs with k = 5."""

    def again(text: str) -> Iterator[str | Cells]:
        chosen, size = calibration.SETTINGS[setting], calibration.FULL
        part = under(text, f"Fresh pairs: {chosen.name}")
        place = table_rows(part)[0].index(rule)
        rows = []
        for i in range(chosen.times * size.sets):
            rows += calibration.on_fresh_pairs(chosen, 5, i, 0, size, [rule])
        for cell in summary(rows):
            row: Cells = [None] * len(table_rows(part)[0])
            row[0], row[1], row[place] = "5", str(cell.answers), shown(cell)
            yield row

    return again


def lapse(text: str) -> Iterator[str | Cells]:
    *_, table = calibration_questions.report(calibration_questions.FULL, [10], [0.0], 2)
    yield cells(table[-1])


def fits(text: str) -> Iterator[str | Cells]:
    sets = int(re.search(r"mean over (\d+) data set", text)[1])
    cell = [fit_cost.draw(5, 30, 200, seed) for seed in range(sets)]
    wrong, how_near = fit_cost.about(cell, [fit_cost.references(data) for data in cell]).split(
        " The references"
    )
    assert how_near  # which is rounding
    yield wrong


def learned(text: str) -> Iterator[str | Cells]:
    for part in learning_cost.beside_knowing(replace(Setting(), k=5, repeats=1)):
        if isinstance(part, Kind):
            yield [None if i == 1 else cell for i, cell in enumerate(described(part))]


def swept(text: str) -> Iterator[str | Cells]:
    method = "interactive value iteration"
    found = value_iteration_cost.run(method, 10_000, 1, 1, True)
    counts = [f"{found['sweeps']}", f"{found['asked']}", f"{found['loss']:.1e}"]
    yield [method, *[None] * 4, *counts, None]
    yield f"Decided by: {found['decided']}."


def streams(text: str) -> Iterator[str | Cells]:
    yield comparison_cost.about(
        comparison_cost.record("IVI", 5, 0, steps=100_000, tolerance=0.0005)
    )[-1]


def trained(kind: str) -> Again:
    def again(text: str) -> Iterator[str | Cells]:
        count = number(text, kind, place=1)
        yield training_questions.line(kind, training_questions.kinds(count)[kind]())

    return again


def explored(text: str) -> Iterator[str | Cells]:
    (title, problem, asks), choice = exploration.FULL[1], "uniform"
    with patch.object(exploration, "CHOICES", {choice: exploration.CHOICES[choice]}):
        yield exploration.section(title, problem, 100_000, 20, asks)[-2]


def paired(choice: Choice, size: tuple[int, int, int], seeds: int) -> dict[str, Floats]:
    """Return every measure of a choice over its seeds (n,)."""
    return measure_all([choice], [range(seeds)], size, None, 1)[0]


def assumed(text: str) -> Iterator[str | Cells]:
    steps = int(re.search(r"([\d,]+) steps", text)[1].replace(",", ""))
    name, choices = "tutor never errs", assumptions.choices()  # needs the fewest runs
    seeds, size = number(text, name, place=1), (100, 10, steps)
    found = {each: paired(choices[each], size, seeds) for each in ("default", name)}
    yield cells(assumptions.table(found)[-1])


def read_literally(text: str) -> Iterator[str | Cells]:
    seeds, steps = (int(re.search(rf"--{name} (\d+)", text)[1]) for name in ("seeds", "steps"))
    size = (50, 5, steps)
    found = {name: paired(choice, size, seeds) for name, choice in list(literal.arms().items())[:2]}
    for line in literal.table(found, size, "each answer")[2:]:
        yield cells(line, -1)


def ruled(text: str) -> Iterator[str | Cells]:
    asked = int(re.search(r"--seeds (\d+)", text)[1])
    method = question_rules.RULES[question_rules.OURS]
    todo = [
        cell for cell in question_rules.cells(["k = 5"], asked) if cell["comparator"] == "polytope"
    ]
    todo = [cell for cell in todo if cell["method"] == method]
    counts = [question_counts.run(cell)["asked"] for cell in todo]
    yield [question_rules.OURS, with_interval(counts, 1), *[None] * 7]


def believed(text: str) -> Iterator[str | Cells]:
    seeds = int(re.search(r"--seeds (\d+)", text)[1])
    name = "PosteriorComparator"
    with patch.object(
        preference_posteriors, "methods", lambda: {name: preference_posteriors.particles}
    ):
        rows = [
            preference_posteriors.run({"tutor": "logistic", "k": 5, "n": 20, "seed": n})
            for n in range(seeds)
        ]
    yield [*preference_posteriors._line(name, rows)[:-2], None, None]


def answered_again(text: str) -> Iterator[str | Cells]:
    """Rows of the people whose answers are shipped; the table of subsets is not."""
    logs = repeated_gambles()
    shipped = of_logs(logs)[1]
    with patch.object(
        answers_of_people.repeats, "of_subsets", lambda _: (shipped, np.ones((18, 2)))
    ):
        made = list(answers_of_people.again({"20 times": logs}, ROOT))
    yield from (cells(line) for line in made if line.startswith("| 20 times"))


def liked(text: str) -> Iterator[str | Cells]:
    """Rows of the people whose answers are shipped."""
    yield from gains.gamble_rows("20 times", lambda number: repeated_gambles(sets=[number]), (1,))


def judged_beside_repeats(text: str) -> Iterator[str | Cells]:
    """Rows of the people whose answers are shipped."""
    found = repeated.scores(repeated_gambles())
    for label in ("without", "with"):
        rows = found[label]
        yield ["20 times", label, f"{len(rows)}", *repeated.disagreements(rows)]


def asked_of_each_kind(text: str) -> Iterator[str | Cells]:
    """Plain questions about one family."""
    count = int(re.search(r"over (\d+) problems", text)[1])
    cell = {"problem": "career", "question": kinds_of_question.PLAIN}
    runs = [
        kinds_of_question.run(cell | {"scale": scale, "seed": seed})
        for scale in ("even", "skewed")
        for seed in range(kinds_of_question.FIRST, kinds_of_question.FIRST + count)
    ]
    yield [*kinds_of_question.row("career", kinds_of_question.PLAIN, runs, runs)]


def taken_for_one(text: str) -> Iterator[str | Cells]:
    """The fewest answers, without raters."""
    count = int(re.search(r"over (\d+) draws", text)[1])
    changes = raters.changes(count, raters.EACH[0], raters=False)
    yield [str(raters.EACH[0]), with_interval(changes, 1), None, None]


def as_many_questions(text: str) -> Iterator[str | Cells]:
    """Policy comparisons with three objectives."""
    count = int(re.search(r"(\d+) seeds from", text)[1])
    seeds = range(printed_figures.FIRST, printed_figures.FIRST + count)
    asked, losses = np.transpose([printed_figures.compared(3, 0.01, seed) for seed in seeds])
    ratio = asked.mean() / (3 * np.log(3 / 0.01))
    losses = with_interval(100 * losses, 4)
    yield ["3", "0.01", with_interval(asked, 1), f"{ratio:.2f}", losses]


def claimed(text: str) -> Iterator[str | Cells]:
    yield claims_page(pd.read_csv(ROOT / "notebooks" / "data" / "figures.csv"))


def rows_of(frame: pd.DataFrame, text: str) -> Iterator[Cells]:
    """Rows of a table in CSV with the columns of the page."""
    head = text.splitlines()[0].split(",")
    for row in csv.DictReader(io.StringIO(frame.to_csv(index=False))):
        yield [None if name == "seconds" else row.get(name) for name in head]


def drawn(comparator: str) -> Again:
    """Repeat runs of the figures, on the smallest problem."""

    def again(text: str) -> Iterator[str | Cells]:
        size = {
            "levels": (5,),
            "at_levels": 5,
            "states": (100,),
            "at_states": 100,
            "seeds": 1,
            "jobs": 1,
        }
        yield from rows_of(figures(comparators=(comparator,), **size), text)

    return again


def ablated(comparator: str) -> Again:
    def again(text: str) -> Iterator[str | Cells]:
        few = {
            "comparators": ("always", comparator),
            "error_rates": (0.0,),
            "max_queries": 2000,
            "seeds": 1,
        }
        yield from rows_of(ablation_table.table(levels=(5,), tasks=(), jobs=1, **few), text)

    return again


def walked(text: str) -> Iterator[str | Cells]:
    yield from rows_of(dqn_on_terrain.table(20_000, [0]), text)


SAMPLES = (
    Sample("figures", drawn("polytope"), quick=True),
    Sample("figures", drawn("posterior")),
    Sample("claims", claimed, quick=True),
    Sample("assumptions", assumed),
    Sample("literal", read_literally),
    Sample("exploration", explored),
    Sample("ablation", ablated("polytope"), quick=True),
    Sample("ablation", ablated("posterior")),
    Sample("RESULTS-certified", certified("k = 5", "value iteration", certificates.NEVER)),
    Sample("RESULTS-certified", certified("k = 5", "policy iteration", certificates.NEVER)),
    Sample("RESULTS-certified", certified("ICU-Sepsis", "policy iteration", certificates.NEVER)),
    Sample("RESULTS-certified", certified("k = 5", "policy iteration", certificates.FLIPS)),
    Sample("RESULTS-certified", certified("k = 5", "policy iteration", "eq. (6), c = 1")),
    Sample("RESULTS-questions", questions("policy iteration, telling violation", "polytope", 0.0)),
    Sample("RESULTS-questions", questions("policy iteration, simple bags", "posterior", 0.1)),
    Sample("RESULTS-question-rules", ruled),
    Sample("about-equal", equal),
    Sample("RESULTS-headroom", unasked),
    Sample("RESULTS-loss", asked_so_far),
    Sample("RESULTS-contest", contested, quick=True),
    Sample("RESULTS-printed-figures", as_many_questions, quick=True),
    Sample("RESULTS-cuts", cut),
    Sample("RESULTS-wrong", wrong),
    Sample("RESULTS-sessions", sessions),
    Sample("RESULTS-ranges", ranges),
    Sample("RESULTS-scale", scale),
    Sample("RESULTS-growth", grown),
    Sample("RESULTS-calibration", calibrated(6, "posterior")),
    Sample("RESULTS-lapse", lapse),
    Sample("RESULTS-bradley-terry", fits, quick=True),
    Sample("RESULTS-posteriors", believed),
    Sample("RESULTS-people", answered_again, quick=True),
    Sample("RESULTS-people-gains", liked),
    Sample("RESULTS-people-before", judged_beside_repeats),
    Sample("RESULTS-promise", promised),
    Sample("RESULTS-panel", asked_together),
    Sample("RESULTS-raters", taken_for_one),
    Sample("RESULTS-families", by_every_rule),
    Sample("RESULTS-kinds", asked_of_each_kind),
    Sample("RESULTS", learned),
    Sample("RESULTS-ivi", swept),
    Sample("RESULTS-lp", streams),
    Sample("RESULTS-training", trained("random MDP, k = 5, truthful")),
    Sample("RESULTS-training", trained("deep-sea-treasure, hidden weights")),
    Sample("dqn_terrain", walked),
)
NOT_AGAIN = {  # pages without such rows, and why
    "RESULTS-ivi-huge": "its least row of ours takes a minute and a half, and 2 GiB",
    "RESULTS-cold": "it has nothing but seconds",
    "RESULTS-single-precision": "it has nothing but seconds",
    "crowd": "it needs answers of people that are not shipped",
    "RESULTS-equal": "it needs answers of people that are not shipped",
    **{page.name: "it is run whole" for page in PAGES if page.path.endswith(".ipynb")},
}
