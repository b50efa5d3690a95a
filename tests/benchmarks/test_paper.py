"""The benchmarks of exploration, of what the paper leaves open, and of the paper read literally
run, and their tables say what was measured."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from benchmarks import quotes
from benchmarks.paper import assumptions, exploration, literal, paired_runs
from benchmarks.paper.ablation_table import table
from benchmarks.paper.paired_runs import Choice
from benchmarks.quotes import table_rows
from elicit import AlwaysAsk, TruthfulTutor
from elicit._support.hashing import key_of
from qlearn import InteractiveQLearning, drive, random_mdp
from qlearn.learners.exploration import EXPLORATIONS, Exploration
from qlearn.learners.q_learning import rescaled_linear_rate
from tests.scalar_q_learning import scalar_q_learning
from tests.thoroughness import scaled


def test_exploration_measures_every_choice(capsys, tmp_path):
    out = tmp_path / "new" / "exploration.md"
    exploration.main(["--quick", "--out", str(out)])
    text = out.read_text()
    assert capsys.readouterr().out.rstrip() == text.rstrip()
    head, *table = table_rows(text)
    assert head == ["exploration", "loss", "at the start", "questions"]
    assert sorted(row[0] for row in table) == sorted(exploration.CHOICES)
    losses = [float(row[1].split()[0]) for row in table]
    assert losses == sorted(losses)


def test_a_loss_is_that_of_the_run():
    def problem(seed):
        return random_mdp(6, 2, 3, rng=seed)

    loss, start, asked = exploration.measure(problem, Exploration(0.0), 0, 3, True)
    assert (asked, loss) == (0, pytest.approx(start))  # the initial distribution is uniform
    better, _, asked = exploration.measure(problem, EXPLORATIONS["uniform"], 3000, 3, True)
    assert better < loss
    assert asked > 0
    assert np.isnan(exploration.measure(problem, EXPLORATIONS["uniform"], 10, 3, False)[2])


FEW = ("default", "m = 20", "tutor never errs", "start at zero (line 4)", "level .8")


@pytest.mark.slow
@pytest.mark.parametrize("chosen", [FEW, ()], ids=["few", "all"])
def test_assumptions_changes_one_choice_a_line(chosen, capsys, tmp_path, monkeypatch):
    every, etas = assumptions.choices(), assumptions.etas()
    if chosen:
        monkeypatch.setattr(assumptions, "choices", lambda: {name: every[name] for name in chosen})
        monkeypatch.setattr(assumptions, "etas", lambda: dict(list(etas.items())[:2]))
    out = tmp_path / "assumptions.md"
    assumptions.main(["--quick", "--out", str(out)])
    text = out.read_text()
    assert capsys.readouterr().out.rstrip() == text.rstrip()
    (head, *table), (_, *polytope) = quotes.tables(text)
    assert [row[0] for row in table] == list(assumptions.choices())
    assert [row[0] for row in polytope] == list(assumptions.etas())
    assert all(cell[:1] in "+-" for row in table[1:] for cell in [row[2], *row[4:]])
    # what only the comparator is told does not touch the oracle
    untouched = {row[0]: row[head.index("oracle's loss")] for row in table}
    assert untouched["m = 20"] == untouched["tutor never errs"] == "+0.00 ± 0.00"
    # what these seeds do not tell was given all
    told = {row[0]: (row[1], row[3]) for row in table[1:]}
    assert {seeds for seeds, asks in told.values() if asks == "inconclusive"} == {"3"}
    assert ("2", "as much") in told.values()


def cell(choice, seed=1, states=8, levels=3):
    return {"choice": asdict(choice), "states": states, "levels": levels, "seed": seed}


def test_always_deciding_by_the_truth_loses_nothing_by_figure_4():
    found = paired_runs.measure(cell(Choice("polytope", error_rate=0.0)), steps=200)
    assert 0 < found.asked_of_all <= found.asked_of_open <= 100
    assert (found.formula, found.excess_loss, found.errors_realised) == (0, 0, 0)
    assert found.oracle_loss >= 0


def test_errors_realised_are_the_wrong_answers_among_those_given():
    few, many = (
        paired_runs.measure(cell(Choice(error_rate=rate), states=20), steps=2000).errors_realised
        for rate in (0.02, 0.3)
    )
    assert 0 < few < 30 < many < 50


@pytest.mark.parametrize("seed", range(3))
def test_one_level_more_is_the_start_at_zero_with_the_values_as_they_are(seed):
    mdp, values = random_mdp(6, 3, 4, rng=seed)
    longer, worth = paired_runs.with_nothing(mdp, values)
    settings = {"steps": 400, "rng": seed}
    always = InteractiveQLearning(
        longer, AlwaysAsk(5), epsilon=Exploration(0.3, "worst"), **settings
    )
    found = drive(always, TruthfulTutor(worth))
    # Q-learning on the values themselves, from zeros
    rates = rescaled_linear_rate(mdp.discount)(np.arange(400))
    plain = scalar_q_learning(longer, worth, steps=400, epsilon=0.3, rates=rates, key=key_of(seed))
    assert found.policy.tolist() == plain.best
    assert found.q @ ((worth - worth[0]) / (worth[-1] - worth[0])) == pytest.approx(plain.q)
    # the other levels are line 4's zeros, updated; their totals differ
    first = InteractiveQLearning(
        longer, AlwaysAsk(5), epsilon=Exploration(0.3, "worst"), steps=0, rng=seed
    )
    assert not first.result().q[:, :, 1:].any()
    assert np.ptp(found.q[:, :, 1:].sum(axis=2)) > 0.01


def test_where_the_lowest_value_is_zero_nothing_is_worth_less():
    mdp, _ = random_mdp(6, 3, 4, rng=0)
    _, worth = paired_runs.with_nothing(mdp, np.array([0.0, 3, 50, 99]))
    assert worth[0] < 0
    assert TruthfulTutor(worth).signs([[0.5, -0.5, 0, 0, 0]]).tolist() == [-1]


def test_an_answer_is_what_the_interval_tells():
    assert paired_runs.answer(np.array([1.0, 1.2, 0.8]), 5.0) == "more"
    assert paired_runs.answer(np.array([-1.0, -1.2, -0.8]), 5.0) == "less"
    assert paired_runs.answer(np.array([0.1, -0.1, 0.0]), 1.0) == "as much"
    assert paired_runs.answer(np.array([0.1, -0.1, 0.0]), 0.1) == "inconclusive"
    assert paired_runs.answer(np.array([1.0]), 5.0) == "inconclusive"


@pytest.mark.slow
def test_the_literal_reading_is_held_to_the_default_and_the_others_to_it(capsys, tmp_path):
    out, journal = tmp_path / "literal.md", tmp_path / "runs.jsonl"
    literal.main(["--quick", "--out", str(out), "--journal", str(journal)])
    text = out.read_text()
    assert capsys.readouterr().out.rstrip() == text.rstrip()
    runs = len(journal.read_text().splitlines())
    short, longer = quotes.tables(text)
    assert [row[3] for row in short[1:]] == list(literal.arms())
    assert set(literal.arms()) - {row[3] for row in longer} == {"fits at 20% more answers"}
    assert runs == 2 * (len(short) + len(longer) - 2)
    default, strict, *_ = (float(row[5].split()[0]) for row in short[1:])
    assert 0 < default < default + strict <= 100  # it asks more
    literal.main(["--quick", "--out", str(out), "--journal", str(journal)])
    assert out.read_text() == text  # from the journal, CPU seconds included


def test_the_literal_reading_has_nothing_that_the_text_has_not():
    base = literal.LITERAL.settings
    assert (base["dominance"], base["monotone"], base["prior_strength"]) == (False, False, 0)
    assert (base["refit_growth"], base["min_answers"], literal.LITERAL.first_level) == (
        0,
        1,
        "free",
    )
    changed = [choice for choice in literal.put_back().values() if choice != literal.LITERAL]
    assert len(changed) == len(literal.put_back())


def test_with_a_tutor_who_never_errs_the_literal_reading_decides_nothing():
    truthful = replace(literal.LITERAL, error_rate=0.0)
    silent = replace(truthful, settings={**truthful.settings, "min_answers": 10**6})
    found, silence = (paired_runs.measure(cell(choice), steps=60) for choice in (truthful, silent))
    assert found.asked_of_all == silence.asked_of_all > 50


def test_the_rows_behind_the_ablation_notebook_are_paired():
    tiny = {
        "seeds": 1,
        "steps": 60,
        "max_sweeps": 8,
        "states": 8,
        "actions": 2,
        "max_queries": 20,
        "n_boot": 5,
    }
    levels = scaled((3,), (3, 4))
    rows = table(
        levels=levels,
        tasks=(),
        particles=50,
        tolerance=0.05,
        error_rates=(0.0, 0.3),
        jobs=1,
        **tiny,
    )
    assert sorted(rows.k.unique()) == [*levels]
    audited = rows[rows.name == "polytope, audited"]
    assert (audited.audit > 0).all()
    assert (audited.rounds[audited.learner == "q-learning"] == 60).all()  # as long as the others
    assert (rows.questions == rows.asked + rows.audited).all()
    oracle = rows[(rows.comparator == "always") & (rows.error_rate == 0)]
    assert (oracle.excess == 0).all()
    for row in rows.itertuples():
        of = oracle[
            (oracle.k == row.k) & (oracle.learner == row.learner) & (oracle.seed == row.seed)
        ]
        beside = of.loss.iloc[0] if row.learner != "policy-iteration" else 0.0  # it has no oracle
        assert row.excess == pytest.approx(100 * (row.loss - beside))
