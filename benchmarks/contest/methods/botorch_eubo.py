"""The published qEUBO: BoTorch's own model and acquisition function (Astudillo et al. 2023).

Nothing of the method is written anew. ``PairwiseGP`` takes in each answer. Its hyperparameters are
fitted with BoTorch's defaults after each of the first answers and then after every fifth, from
where the last fit ended. The next question is the pair with the greatest
``AnalyticExpectedUtilityOfBestOption``, which for pairs is qEUBO without its sampling error. As in
Lin et al. (2022), the utility is a function of outcomes. An outcome is the tail sums of a policy
from the start, and the designs are the policies of a coverage set. The estimate is the design with
the greatest posterior mean. The method has no rule to stop.

The order of the levels is given as one virtual comparison of each level with the next one. With
``linear``, the kernel is that of linear utilities, and the estimate is the best policy for the
posterior mean of the weights.

BoTorch is imported when a run starts. It is no extra of this project: ``pip install
torch==2.14.1 botorch==0.18.1``.
"""

from __future__ import annotations

import warnings
from contextlib import suppress
from itertools import combinations
from typing import Any

import numpy as np

from benchmarks.contest.harness import Question, Told
from benchmarks.contest.small_mdp import Policy, SmallMDP, coverage_set, tails_of
from qlearn.mdp.ordinal_mdp import OrdinalMDP

ALWAYS, SELDOM = 5, 5
"""Hyperparameters are fitted after each of so many answers, and then after every so many."""
LEAST_GAP = 1e-9
"""A weight below this counts as this, so that the order of the levels holds in the estimate."""


class BestOption:
    """Pairs of policies with the greatest expected utility of the better one."""

    def __init__(self, linear: bool = False) -> None:
        self._linear = linear

    def start(self, mdp: OrdinalMDP, told: Told, seed: int) -> None:
        import torch

        torch.manual_seed(seed)
        torch.set_num_threads(1)
        self._small = SmallMDP(mdp)
        self._policies, self._shares = coverage_set(self._small, np.random.default_rng(seed))
        levels = np.eye(mdp.k)
        outcomes = tails_of(np.concatenate([self._shares, levels])).copy()
        self._outcomes = torch.tensor(outcomes, dtype=torch.double)
        n = len(self._shares)
        self._levels = [n + j for j in range(mdp.k)]
        self._pairs = np.array(list(combinations(range(n), 2))).reshape(-1, 2)
        self._wins = [(n + j + 1, n + j) for j in range(mdp.k - 1)]
        self._fitted: dict[str, Any] = {}
        self._fit()

    def question(self) -> Question | None:
        import torch
        from botorch.acquisition.preference import AnalyticExpectedUtilityOfBestOption

        if not len(self._pairs):
            return None
        acquisition = AnalyticExpectedUtilityOfBestOption(pref_model=self._model)
        with torch.no_grad():
            worth = acquisition(self._outcomes[torch.as_tensor(self._pairs)]).numpy()
        self._asked = self._pairs[int(np.argmax(np.round(worth, 9)))]
        left, right = self._asked
        return self._shares[left], self._shares[right]

    def tell(self, verdict: int) -> None:
        left, right = (int(i) for i in self._asked)
        if verdict:
            self._wins.append((left, right) if verdict > 0 else (right, left))
            self._fit()

    def policy(self) -> Policy:
        if self._linear:
            values = self._mean[self._levels]
            gaps = np.maximum(np.diff(values), LEAST_GAP)
            return self._small.best(gaps / gaps.sum())[0]
        return self._policies[int(np.argmax(np.round(self._mean[: len(self._shares)], 9)))]

    def _fit(self) -> None:
        import torch
        from botorch import fit_gpytorch_mll
        from botorch.exceptions.errors import ModelFittingError
        from botorch.models.pairwise_gp import PairwiseGP, PairwiseLaplaceMarginalLogLikelihood

        seen, places = np.unique(np.array(self._wins), return_inverse=True)
        data = self._outcomes[torch.as_tensor(seen)], torch.as_tensor(places.reshape(-1, 2))
        self._model = PairwiseGP(*data, covar_module=self._kernel())
        if self._fitted:
            self._model.covar_module.load_state_dict(self._fitted)  # where the last fit ended
        answers = len(self._wins) - len(self._levels) + 1
        if answers <= ALWAYS or answers % SELDOM == 0:
            likelihood = PairwiseLaplaceMarginalLogLikelihood(self._model.likelihood, self._model)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of restarts of the fit
                with suppress(ModelFittingError):  # then the last hyperparameters stay
                    fit_gpytorch_mll(likelihood)
            self._fitted = self._model.covar_module.state_dict()
        else:
            self._model.set_train_data(*data)
        with torch.no_grad():
            self._mean = self._model.posterior(self._outcomes).mean.squeeze(-1).numpy()

    def _kernel(self) -> Any:
        """Return the kernel of linear utilities, or None for BoTorch's default."""
        if not self._linear:
            return None
        from gpytorch.constraints import Interval
        from gpytorch.kernels import LinearKernel, ScaleKernel
        from gpytorch.priors import SmoothedBoxPrior

        linear = LinearKernel()
        linear.variance = 1.0
        linear.raw_variance.requires_grad_(False)
        # the outputscale as in BoTorch's default, but for room for a tutor who never errs
        return ScaleKernel(
            linear,
            outputscale_prior=SmoothedBoxPrior(a=1e-2, b=1e4),
            outputscale_constraint=Interval(5e-3, 2e4, initial_value=100.0),
        )
