"""The history of a run: its losses are those of the policies at that time, from question zero."""

import numpy as np
import pytest

import elicit
import qlearn


def history_of(bound: bool = True, **options):
    mdp = qlearn.problems.FAMILIES["career"](seed=3)
    values = qlearn.hidden_scales("even", mdp.k, 3)
    history = qlearn.LossHistory(mdp, values, bound=bound)
    seen = []

    def progress(result):
        seen.append(result)
        history(result)

    result = qlearn.solve(
        mdp, elicit.TruthfulTutor(values), "polytope", 1e-3, 0, progress=progress, **options
    )
    return mdp, values, history, seen, result


def test_it_begins_with_question_zero_and_has_a_row_for_each_answer():
    mdp, values, history, seen, result = history_of()
    assert history.asked.tolist() == list(range(result.asked + 1))
    unasked = qlearn.unasked_loss(mdp, values)
    assert history.loss[0] == pytest.approx(unasked.worst)
    assert history.initial_loss[0] == pytest.approx(unasked.initial)
    for row, then in enumerate(seen, start=1):
        loss = qlearn.policy_loss(mdp, then.policy, values)
        assert history.loss[row] == loss.max()
        assert history.initial_loss[row] == pytest.approx(mdp.initial @ loss)
        assert history.loss_bound[row] == then.loss_bound
    assert (history.loss <= history.loss_bound + 1e-12).all()
    assert history.loss[-1] < 1e-3 < history.loss[0]


def test_a_curve_goes_on_after_the_end():
    *_, history, _, result = history_of(bound=False)
    rows = history.after(np.arange(result.asked + 3))
    assert rows.tolist() == [*range(result.asked + 1), result.asked, result.asked]
    assert np.isnan(history.loss_bound).all()


def test_without_values_there_is_no_loss_but_a_bound():
    mdp, values = qlearn.random_mdp(12, 3, 4, seed=2)
    history = qlearn.LossHistory(mdp)
    qlearn.solve(mdp, elicit.TruthfulTutor(values), "polytope", seed=0, progress=history)
    frame = history.frame()
    assert list(frame) == ["asked", "loss", "initial_loss", "loss_bound"]
    assert frame["loss"].isna().all()
    assert frame["loss_bound"].between(0, 1).all()
    assert frame["loss_bound"].iloc[-1] <= 0.01 < frame["loss_bound"].iloc[0]


def test_bad_values_are_refused_at_once():
    mdp, _ = qlearn.random_mdp(12, 3, 4, seed=2)
    with pytest.raises(ValueError, match="values"):
        qlearn.LossHistory(mdp, [0, 1, 2])
    with pytest.raises(ValueError, match=r"bound must be True or False, not 1\b"):
        qlearn.LossHistory(mdp, bound=1)
