"""BoTorch's ``PairwiseGP`` (Chu and Ghahramani 2005; Laplace's approximation) as a model of the
tutor's utility.

It learns a function of the share vectors themselves, which need not be linear and knows no order of
the levels. torch and botorch are no dependency: ``pip install torch==2.13.0 botorch`` beside the
project.
"""

from __future__ import annotations

import copy
import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, ndtr

from elicit.model.scale import Floats

KERNELS = {
    "PairwiseGP, as it comes: RBF, probit": ("rbf", "probit"),
    "PairwiseGP, RBF, logistic": ("rbf", "logistic"),
    "PairwiseGP, linear kernel, logistic": ("linear", "logistic"),
}


def available() -> bool:
    """Return whether botorch can be imported."""
    return find_spec("botorch") is not None


def utility_draws(
    name: str, left: Floats, right: Floats, y: NDArray[np.int8], at: Floats, draws: int, seed: int
) -> Floats:
    """Draws (draws, q) of the utility at vectors ``at`` (q, k), given that of left (n, k) and right
    (n, k) the tutor preferred the one that y (n,) in {-1, 1} says; hyperparameters by the greatest
    marginal likelihood, or as it has them at first where its search for that fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what torch deprecates of itself
        import torch
        from botorch.exceptions.errors import ModelFittingError
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import PairwiseGP
        from botorch.models.likelihoods.pairwise import (
            PairwiseLogitLikelihood,
            PairwiseProbitLikelihood,
        )
        from botorch.models.pairwise_gp import PairwiseLaplaceMarginalLogLikelihood
        from botorch.models.transforms.input import Normalize
        from gpytorch.constraints import Interval
        from gpytorch.kernels import LinearKernel, ScaleKernel

    torch.set_num_threads(1)
    kernel, link = KERNELS[name]
    n, k = left.shape
    points = torch.as_tensor(np.concatenate([left, right]))
    first, second = np.arange(n), n + np.arange(n)
    better = np.where(y > 0, first, second), np.where(y > 0, second, first)
    settings: dict[str, Any] = {
        "likelihood": PairwiseLogitLikelihood()
        if link == "logistic"
        else PairwiseProbitLikelihood(),
        "consolidate_atol": 0.0,  # no two vectors are the same here, however near
    }
    if kernel == "rbf":
        settings["input_transform"] = Normalize(d=k)
    else:
        linear = LinearKernel()
        linear.variance = 1.0
        linear.raw_variance.requires_grad = False  # the outer scale is enough
        limits = Interval(1e-2, 1e5, initial_value=100.0)
        settings["covar_module"] = ScaleKernel(linear, outputscale_constraint=limits)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # its doubts about single fits; what they come to shows in the scores
        model = PairwiseGP(points, torch.as_tensor(np.stack(better, axis=1)), **settings)
        begun = copy.deepcopy(model)
        try:
            fit_gpytorch_mll(PairwiseLaplaceMarginalLogLikelihood(model.likelihood, model))
        except ModelFittingError:
            model = begun.eval()
        with torch.no_grad():
            found = model.posterior(torch.as_tensor(at))
            mean, covariance = (
                found.mean[:, 0].numpy(),
                found.distribution.covariance_matrix.numpy(),
            )
    values, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    normals = np.random.default_rng(seed).standard_normal((draws, len(mean)))
    return np.asarray(mean + (normals * np.sqrt(np.maximum(values, 0.0))) @ axes.T)


def chance(name: str, difference: Floats) -> Floats:
    """The chance that left is said to be better, for differences of the utility, by the link of the
    model.
    """
    if KERNELS[name][1] == "logistic":
        return np.asarray(expit(difference))
    return np.asarray(ndtr(difference / np.sqrt(2.0)))
