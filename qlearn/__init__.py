"""qlearn: interactive reinforcement learning with ordinal rewards and a tutor who may err."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from qlearn.environments import draw_values, icu_sepsis, random_mdp
    from qlearn.guarantee import Guarantee, loss_bound
    from qlearn.ivi import InteractiveValueIteration
    from qlearn.learner import Audit, Learner, Result, Status, drive
    from qlearn.mdp import OrdinalMDP
    from qlearn.planning import evaluate_policy, policy_loss, value_iteration
    from qlearn.policy_iteration import InteractivePolicyIteration
    from qlearn.q_learning import InteractiveQLearning

_LATER = {  # imported when first used, so that the command line starts fast
    "Audit": "qlearn.learner",
    "Guarantee": "qlearn.guarantee",
    "InteractivePolicyIteration": "qlearn.policy_iteration",
    "InteractiveQLearning": "qlearn.q_learning",
    "InteractiveValueIteration": "qlearn.ivi",
    "Learner": "qlearn.learner",
    "OrdinalMDP": "qlearn.mdp",
    "Result": "qlearn.learner",
    "Status": "qlearn.learner",
    "draw_values": "qlearn.environments",
    "drive": "qlearn.learner",
    "evaluate_policy": "qlearn.planning",
    "icu_sepsis": "qlearn.environments",
    "loss_bound": "qlearn.guarantee",
    "policy_loss": "qlearn.planning",
    "random_mdp": "qlearn.environments",
    "value_iteration": "qlearn.planning",
}
_MODULES = ("exploration", "gym_environments", "strategies")  # to be written as qlearn.strategies.max_regret, say

__all__ = [
    "Audit",
    "Guarantee",
    "InteractivePolicyIteration",
    "InteractiveQLearning",
    "InteractiveValueIteration",
    "Learner",
    "OrdinalMDP",
    "Result",
    "Status",
    "draw_values",
    "drive",
    "evaluate_policy",
    "icu_sepsis",
    "loss_bound",
    "policy_loss",
    "random_mdp",
    "value_iteration",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"qlearn.{name}")
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'qlearn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
