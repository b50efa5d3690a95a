"""A tiny ablation from end to end."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from elicit import Comparator, FlippingTutor, PolytopeComparator, Tier, TruthfulTutor
from elicit.catalogue import LOOKS, OWN, PEOPLE
from elicit.plot import STYLES, kind_of, styles
from qlearn import (
    InteractivePolicyIteration,
    InteractiveQLearning,
    drive,
    equal_gaps_policy,
    policy_loss,
    random_mdp,
)
from qlearn.cli.ablate import QUICK
from qlearn.experiments import ablation as runs
from qlearn.experiments import code_identity, compile_ahead
from qlearn.experiments.ablation import KEYS, Run, ablate, run, summarise
from qlearn.experiments.ablation_plot import LEGEND, NAMES, table
from qlearn.experiments.catalogue import TAUGHT_WITH, LearnerEntry
from qlearn.experiments.metrics import MEASURES
from qlearn.experiments.settings import ORDER, TUTORS, AblationSettings, Settings
from qlearn.learners.exploration import EXPLORATIONS
from qlearn.problems import FAMILIES
from tests.sweep_cases import TINY
from tests.thoroughness import quick_first, thorough


def text_of(frame: pd.DataFrame) -> str:
    return str(frame.drop(columns="seconds").to_csv(index=False))


@pytest.fixture(scope="module")
def frame() -> pd.DataFrame:
    return ablate(**TINY, jobs=1)


def test_rows_are_the_same_on_one_process_and_on_two_computed_or_read_back(
    frame: pd.DataFrame, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    seen: list[tuple[int, int]] = []
    settings = TINY
    if not thorough():
        few = {"comparators": ["always", "polytope"], "error_rates": (0.15,)}
        settings = TINY | few | {"learners": ["q-learning", "value-iteration"]}
        frame = ablate(**settings, jobs=1)
    part = settings | {
        "comparators": ["polytope"],
        "error_rates": [0.15],
        "learners": ["value-iteration"],
    }
    first = ablate(**part, jobs=1, journal=journal)  # three runs of the whole
    assert first.comparator.tolist() == ["always", "polytope", "polytope"]  # the oracle always runs
    whole = ablate(**settings, jobs=2, journal=journal, progress=lambda *now: seen.append(now))
    assert seen[0] == (3, len(frame))
    assert text_of(whole) == text_of(frame)

    kept = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(kept[4:]) + kept[0][:-30])
    seen.clear()
    # an oracle is among the missing; and a default is the same setting, named or not
    resumed = ablate(
        **settings, particles=1000, jobs=1, journal=journal, progress=lambda *now: seen.append(now)
    )
    assert seen == [(done, len(frame)) for done in range(len(frame) - 4, len(frame) + 1)]
    assert text_of(resumed) == text_of(frame)


def test_one_row_a_cell_in_order(frame: pd.DataFrame) -> None:
    # 2 error rates each: plain runs of all, and an audited one of the polytope; the posterior with
    # an indifference for Q-learning only; policy iteration where a loss bound can be proven
    assert len(frame) == 2 * (6 + 1) + 2 * (5 + 1) + 2 * 3
    assert not frame.duplicated(list(KEYS)).any()
    assert frame.learner.unique().tolist() == ["q-learning", "value-iteration", "policy-iteration"]
    assert frame.comparator.unique().tolist() == [
        "always", "polytope", "posterior", "posterior-close", "ensemble", "box"
    ]  # fmt: skip
    tiers = [tier.name.lower() for tier in Tier]
    assert (frame[tiers].sum(axis=1) == frame.compared).all()
    assert (frame.tutor == frame.asked).all()
    assert (frame.audited[frame.audit == 0] == 0).all()
    assert (frame.realised_error_rate[frame.error_rate == 0] == 0).all()
    assert frame.asked[frame.comparator != "always"].max() <= 40


def test_polytope_with_a_truthful_tutor_is_the_oracle_with_fewer_questions(
    frame: pd.DataFrame,
) -> None:
    plain = frame[(frame.learner == "q-learning") & (frame.error_rate == 0) & (frame.audit == 0)]
    learned = plain.set_index("comparator")
    polytope = learned.loc[["polytope"]]
    paired = ["excess_loss", "excess_loss_initial", "paper_loss_percent"]
    assert (learned.loc[["always", "polytope"], paired] == 0).all(axis=None)
    assert (polytope.wrong_before + polytope.wrong_after == 0).all()
    assert (polytope.judged_before > 0).all()
    assert (polytope.asked < learned.asked["always"]).all()


def test_audited_runs_are_shorter_and_not_paired(frame: pd.DataFrame) -> None:
    audited = frame[frame.audit > 0]
    assert (audited[audited.learner == "q-learning"].rounds == 20).all()
    assert (audited[audited.learner == "value-iteration"].rounds <= 8).all()
    assert audited.audited.sum() > 0
    paired = ["excess_loss", "excess_loss_initial", "paper_loss_percent"]
    assert audited[paired].isna().all(axis=None)
    with_oracle = frame[(frame.audit == 0) & (frame.learner != "policy-iteration")]
    assert with_oracle[paired].notna().all(axis=None)


def test_policy_iteration_runs_where_a_bound_can_be_proven_and_its_losses_are_those_of_all(
    frame: pd.DataFrame,
) -> None:
    mine = frame[frame.learner == "policy-iteration"]
    assert mine.comparator.unique().tolist() == ["polytope", "posterior", "ensemble"]
    assert (mine.audit == 0).all()
    assert (
        mine.excess_loss.tolist() == mine.loss.tolist()
    )  # without an oracle: beyond the best policy
    assert mine.paper_loss_percent.isna().all()
    assert (
        mine.loss[(mine.comparator == "polytope") & (mine.error_rate == 0)] <= TINY["tolerance"]
    ).all()
    (row,) = mine[(mine.comparator == "polytope") & (mine.error_rate == 0.15)].itertuples()
    mdp, values = random_mdp(8, 3, 4, seed=0)
    learner = InteractivePolicyIteration(
        mdp, PolytopeComparator(4, tie=0.0), tolerance=0.05, max_queries=40, seed=0
    )
    result = drive(learner, FlippingTutor(values, 0.15, seed=0))
    loss = policy_loss(mdp, result.policy, values)
    assert (row.asked, row.status, row.loss) == (
        result.asked,
        result.status.name.lower(),
        loss.mean(),
    )


def test_a_learner_that_no_comparator_goes_with_is_refused() -> None:
    none = TINY | {"comparators": ["always", "box"], "learners": ["policy-iteration"]}
    with pytest.raises(
        ValueError, match=r"policy-iteration .* needs a comparator that can prove a loss bound"
    ):
        ablate(**none, jobs=1)


def test_a_run_can_be_rebuilt_by_hand(frame: pd.DataFrame) -> None:
    mdp, values = random_mdp(8, 3, 4, rng=0)
    learner = InteractiveQLearning(
        mdp, PolytopeComparator(4), steps=200, epsilon=1.0, rng=0, max_queries=40
    )
    tutor = FlippingTutor(values, 0.15, seed=0)
    result = drive(learner, tutor)
    loss = policy_loss(mdp, result.policy, values)
    where = (
        "learner == 'q-learning' and comparator == 'polytope' and error_rate == .15 and audit == 0"
    )
    (row,) = frame.query(where).itertuples()
    found = (row.asked, row.compared, row.realised_error_rate, row.loss, row.loss_initial)
    assert found == (
        result.asked,
        result.compared,
        tutor.realised_error_rate,
        loss.mean(),
        mdp.initial @ loss,
    )


def test_runs_of_other_sources_are_not_taken_from_the_journal(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    one = TINY | {"comparators": ["always"], "error_rates": [0.0], "learners": ["value-iteration"]}
    ablate(**one, jobs=1, journal=tmp_path / "journal")
    ablate(**one, jobs=1, journal=tmp_path / "journal")
    older, now = ["older"], runs.sources  # the sweep asks first, then the worker
    monkeypatch.setattr(runs, "sources", lambda: older.pop() if older else now())
    # neither from the journal, nor by a worker that has sources of its own
    with pytest.raises(
        RuntimeError, match="other sources or libraries than the process that started the sweep"
    ):
        ablate(**one, jobs=1, journal=tmp_path / "journal")


def one_run(comparator: str = "always", **changes: Any) -> Run:
    """A short run of Q-learning with a tutor who flips."""
    mdp, values = random_mdp(8, 3, 4, rng=0)
    cell = dict(zip(KEYS, ("random", "q-learning", comparator, 0.15, 0.0, 0), strict=True))
    return run(cell, mdp, values, Settings(steps=300, **changes))


def test_logistic_noise_errs_at_near_ties() -> None:
    flip, logistic = (one_run(noise=noise).row for noise in ("flip", "logistic"))
    assert 0 < logistic["realised_error_rate"] != flip["realised_error_rate"] > 0


def test_a_named_exploration_takes_the_place_of_epsilon() -> None:
    named, constant, other = (
        one_run(**changes).v.tolist()
        for changes in (
            {"exploration": "constant", "epsilon": 0.3},
            {"epsilon": 0.1},
            {"exploration": "decaying"},
        )
    )
    assert named == constant != other


def test_posterior_close_is_the_posterior_with_an_indifference() -> None:
    plain, close, by_hand = (
        one_run(name, particles=50, **changes).v.tolist()
        for name, changes in (
            ("posterior", {}), ("posterior-close", {"close": 0.1}),
            ("posterior", {"indifference": 0.1})
        )
    )  # fmt: skip
    assert close == by_hand != plain


def test_a_run_has_linear_algebra_on_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def tutor(*_: Any) -> TruthfulTutor:
        seen.extend(pool["num_threads"] for pool in threadpool_info())
        return TruthfulTutor([0, 1, 2, 3])

    monkeypatch.setattr(runs, "TUTORS", {"flip": tutor})
    with threadpool_limits(2):
        one_run()
    assert {*seen} == {1}


def test_families_are_problems_of_the_ablation_drawn_by_its_seeds() -> None:
    cells = {
        "learners": ["policy-iteration"],
        "comparators": ["polytope"],
        "error_rates": [0.0],
        "audit": 0.0,
    }
    rows = ablate(problems=["career", "plant"], seeds=2, jobs=1, **cells)
    assert rows.problem.tolist() == ["career"] * 2 + ["plant"] * 2
    assert (rows.loss <= AblationSettings().tolerance).all()
    assert rows.asked.min() > 0
    assert {name for name, entry in runs.PROBLEMS.items() if entry.family is not None} == {
        *FAMILIES
    }
    mdps = [runs.instance("career", seed, (1, 1, 2, 0.5)) for seed in (3, 3, 4)]
    assert [mdp.fingerprint for mdp, _ in mdps] == [
        FAMILIES["career"](seed).fingerprint for seed in (3, 3, 4)
    ]
    assert all(len(values) == mdp.k for mdp, values in mdps)


def test_every_name_has_something_that_it_stands_for() -> None:
    made = {
        "problem": {*runs.PROBLEMS},
        "learner": {*runs.LEARNERS},
        "comparator": {*runs.COMPARATORS},
    }
    assert {name: {*ORDER[name]} for name in ORDER} == made | {
        "errs": {*TUTORS},
        "error_rate": {"person"},
    }
    assert {*NAMES} == set().union(*made.values())
    catalogues: list[Mapping[str, Any]] = [runs.PROBLEMS, runs.LEARNERS, runs.COMPARATORS]
    assert all(entry.name == name for one in catalogues for name, entry in one.items())
    assert len({*NAMES.values()}) == len(NAMES)
    assert {*TAUGHT_WITH} <= {*runs.COMPARATORS}
    small_runs = {part.__name__ for part in compile_ahead.ALL}
    assert {entry.compiles for one in catalogues[1:] for entry in one.values()} == small_runs | {
        None
    }
    for name, entry in runs.COMPARATORS.items():
        if not entry.indifferent:
            assert kind_of(entry.make(4, 0)) == name
    assert all(isinstance(entry.make(3, 0), Comparator) for entry in runs.COMPARATORS.values())
    for name, kind in (
        ("q-learning", InteractiveQLearning),
        ("policy-iteration", InteractivePolicyIteration),
    ):
        mdp, _ = random_mdp(4, 2, 3, seed=0)
        assert type(runs.LEARNERS[name].factory(mdp, PolytopeComparator(3))) is kind
    looks = [(style["color"], style["marker"]) for style in STYLES.values()]
    assert {*STYLES} == {*ORDER["comparator"]}
    assert all(
        len(set(look)) == len(STYLES) for look in zip(*looks, strict=True)
    )  # no two have one in common
    more = styles(
        [*(f"mine {i}" for i in range(6)), *STYLES]
    )  # nor one of the first six of the user's
    assert {name: more[name] for name in STYLES} == STYLES
    looks = [(style["color"], style["marker"], str(style["linestyle"])) for style in more.values()]
    assert all(len(set(look)) == len(STYLES) + 6 for look in zip(*looks, strict=True))
    every = styles([*(f"mine {i}" for i in range(5)), *STYLES, *LOOKS])
    assert len({style["color"] for style in every.values()}) == len(STYLES) + len(LOOKS) + 5
    named = styles([*STYLES, *LOOKS])
    assert len({style["marker"] for style in named.values()}) == len(named)
    assert "*" not in {style["marker"] for style in every.values()}  # it is the tutor's scale
    assert styles(["mine"])["mine"] == named[OWN] != styles([OWN, "mine"])["mine"]
    assert not {look["color"] for look in PEOPLE} & {style["color"] for style in every.values()}
    assert len({look["color"] for look in PEOPLE} | {look["marker"] for look in PEOPLE}) == 2 * len(
        PEOPLE
    )
    assert {entry.label for entry in runs.LEARNERS.values()} <= {*LOOKS}
    assert [*styles(f"mine {i}" for i in range(30))] == [f"mine {i}" for i in range(30)]
    choices = {one.name: one.metadata["check"] for one in fields(Settings)}
    assert {*choices["exploration"].names} == {*EXPLORATIONS}
    assert {*choices["noise"].names} == {*runs.TUTORS}


def test_the_page_of_commands_lists_the_names_of_the_catalogue() -> None:
    page = (Path(runs.__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
    told = page.split("<!-- begin command-ablate -->")[1].split("<!-- end command-ablate -->")[0]
    settings = {one.name: one.metadata["check"] for one in fields(AblationSettings)}
    for name in ("learners", "problems", "comparators"):
        row = next(row for row in told.splitlines() if row.startswith(f"| `--{name}` |"))
        assert f"One of {', '.join(f'`{each}`' for each in settings[name].names)}, " in row


def test_what_runs_do_not_depend_on_is_there() -> None:
    here = Path(runs.__file__).parents[1]
    assert all((here / name).exists() for name in code_identity._NO_RUNS)


def test_the_summary_has_means_and_t_intervals_and_its_table_says_all_cells_in_120_columns(
    frame: pd.DataFrame,
) -> None:
    rows = ablate(
        **TINY | {"seeds": 3, "steps": 60, "learners": ["q-learning"], "comparators": ["ensemble"]},
        jobs=1,
    )
    summary = summarise(rows)
    assert (summary.runs == 3).all()
    where = "comparator == 'ensemble' and error_rate == .15 and audit == 0"
    cell, line = rows.query(where), summary.query(where).iloc[0]
    assert line.asked == pytest.approx(cell.asked.mean())
    assert line.asked_half == pytest.approx(
        4.302652729911275 * cell.asked.std() / np.sqrt(3)
    )  # 2 degrees of freedom
    assert line.budget_spent == (cell.guess > 0).sum()
    assert {*MEASURES} <= {*summary.columns}
    one = summarise(frame)  # of a single seed
    assert one.asked.tolist() == frame.asked.tolist()
    assert one.asked_half.isna().all()
    text = table(one, {"random": "a tiny MDP"})
    assert max(map(len, [*text.splitlines(), *LEGEND.splitlines()])) <= 120
    assert "a tiny MDP, Q-learning" in text
    assert sum(line.startswith(ORDER["comparator"]) for line in text.splitlines()) == len(frame)
    assert "nan" not in text
    nobody = [line.split() for line in text.splitlines() if line.startswith("none ")]
    assert len(nobody) == frame.learner.nunique()  # one line a table, above the comparators
    assert {tuple(line[:3]) for line in nobody} == {("none", "1", "0")}


def test_a_row_says_what_asking_nothing_loses(frame: pd.DataFrame) -> None:
    for row in frame.itertuples():
        mdp, values = runs.instance(
            row.problem,
            row.seed,
            (TINY["states"], TINY["actions"], TINY["levels"], AblationSettings().discount),
        )
        loss = policy_loss(mdp, equal_gaps_policy(mdp), values)
        assert row.loss_unasked == pytest.approx(loss.mean(), abs=1e-12)
    old = frame.drop(columns="loss_unasked")  # a file written before there was the column
    assert "loss_unasked" not in summarise(old)
    assert "\nnone " not in table(summarise(old))


@pytest.mark.parametrize("problem", quick_first(["frozen-lake", "deep-sea-treasure"], 1))
def test_known_tasks_are_problems_too(problem: str) -> None:
    pytest.importorskip("mo_gymnasium")
    settings = TINY | {
        "problems": [problem],
        "comparators": ["polytope"],
        "error_rates": [0.0],
        "audit": 0.0,
    }
    rows = ablate(**settings, jobs=1)
    assert len(rows) == 5  # the oracles, and the polytope with each learner
    assert (rows.problem == problem).all()
    polytope = rows[(rows.comparator == "polytope") & (rows.learner == "q-learning")]
    assert (polytope.excess_loss == 0).all()
    assert "FrozenLake 8x8, Q-learning" in table(summarise(rows)) or problem != "frozen-lake"


def test_the_quick_ablation_takes_its_comparators_from_the_catalogue() -> None:
    quick = [name for name, entry in runs.COMPARATORS.items() if entry.quick]
    assert quick == QUICK["comparators"] == ["always", "polytope", "posterior", "ensemble"]


def test_a_learner_of_the_catalogue_need_not_say_what_compiles_it() -> None:
    entry = LearnerEntry(
        name="mine", label="mine", factory=InteractiveQLearning, keywords=lambda settings: {}
    )
    assert entry.compiles is None
    cells = [{"comparator": "polytope", "learner": "mine"}]
    assert [part.__name__ for part in compile_ahead.parts(cells)] == ["proofs"]


def test_a_name_with_a_control_character_is_refused() -> None:
    with pytest.raises(ValueError, match=r"names of your own .* control character"):
        ablate(comparators={"mine\n": lambda k, seed: PolytopeComparator(k)})
