"""BoTorch's qEUBO values pairs as query iteration does. Needs botorch, else nothing is tested."""

import numpy as np
import pytest

from benchmarks.contest import problems
from benchmarks.contest.harness import as_seed, play
from benchmarks.contest.methods.botorch_eubo import BestOption
from benchmarks.contest.methods.expected_utility import ExpectedUtility
from benchmarks.contest.small_mdp import tails_of

torch = pytest.importorskip("torch")
pytest.importorskip("botorch")


@pytest.fixture(scope="module")
def asked():
    """Expected utility's posterior after five answers, and all pairs of a few policies."""
    mdp, values = problems.problem("reservoir", 1), problems.scale(5, 1)
    method, told = ExpectedUtility(), problems.TUTORS["eq. (6)"]
    tutor = problems.tutor("eq. (6)", values, 1)
    play(method, mdp, values, tutor, told, 5, as_seed({"seed": 1}))
    gaps = method._posterior.gaps
    return gaps, tails_of(method._shares(gaps[:12]))


def test_qeubo_of_the_same_draws_is_the_same_number(asked):
    from botorch.acquisition.preference import qExpectedUtilityOfBestOption
    from botorch.models.ensemble import EnsembleModel
    from botorch.sampling.base import MCSampler

    gaps, tails = asked

    class Linear(EnsembleModel):
        num_outputs = 1

        def forward(self, X):
            return torch.einsum("...nd,md->...mn", X, torch.tensor(gaps))[..., None]

    class All(MCSampler):
        """Every draw once: the samplers of BoTorch draw with replacement."""

        def forward(self, posterior):
            return posterior.values.movedim(-3, 0)

    acquisition = qExpectedUtilityOfBestOption(Linear(), sampler=All(torch.Size([len(gaps)])))
    pairs = np.array([(i, j) for i in range(12) for j in range(i)])
    theirs = acquisition(torch.tensor(tails.copy())[torch.tensor(pairs)]).numpy()
    worth = tails @ gaps.T
    ours = np.maximum(worth[pairs[:, 0]], worth[pairs[:, 1]]).mean(axis=1)
    assert theirs == pytest.approx(ours, abs=1e-12)


@pytest.mark.slow
def test_the_analytic_form_is_what_draws_of_the_same_gaussian_give():
    from botorch.acquisition.preference import AnalyticExpectedUtilityOfBestOption

    mdp = problems.problem("career", 1)
    values, told = problems.scale(mdp.k, 1), problems.TUTORS["truthful"]
    method = BestOption(linear=True)
    play(method, mdp, values, problems.tutor("truthful", values, 1), told, 3, 1)
    pair = method._outcomes[:2]
    with torch.no_grad():
        posterior = method._model.posterior(pair)
        theirs = float(AnalyticExpectedUtilityOfBestOption(method._model)(pair[None]))
        gaussian = posterior.mean.squeeze(-1).numpy(), posterior.covariance_matrix.numpy()
    drawn = np.random.default_rng(0).multivariate_normal(*gaussian, size=200_000)
    spread = drawn.max(axis=1).std() / np.sqrt(len(drawn))
    assert drawn.max(axis=1).mean() == pytest.approx(theirs, abs=4 * spread)


@pytest.mark.slow
@pytest.mark.parametrize("linear", [False, True])
def test_a_run_can_be_repeated_and_learns(linear):
    mdp = problems.problem("career", 1)
    values, told = problems.scale(mdp.k, 1), problems.TUTORS["truthful"]
    tutor = problems.tutor("truthful", values, 1)
    rows = [play(BestOption(linear), mdp, values, tutor, told, 4, 1) for _ in range(2)]
    assert rows[0]["initial"] == rows[1]["initial"]
    assert rows[0]["initial"][-1] <= 0.01 < rows[0]["initial"][0]
