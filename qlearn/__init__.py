"""qlearn: interactive reinforcement learning with ordinal rewards and a tutor who may err."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elicit.asking.elicitation import Audit
    from qlearn.learners.learner import Learner, Result, Status, drive
    from qlearn.learners.loss_bound import Guarantee, loss_bound
    from qlearn.learners.policy_iteration import InteractivePolicyIteration
    from qlearn.learners.q_learning import InteractiveQLearning
    from qlearn.learners.q_learning_asking_late import LateQLearning
    from qlearn.learners.value_iteration import InteractiveValueIteration, LateValueIteration
    from qlearn.mdp.ordinal_mdp import OrdinalMDP
    from qlearn.mdp.planning import evaluate_policy, policy_loss, value_iteration
    from qlearn.problems.icu_sepsis import icu_sepsis
    from qlearn.problems.random_mdp import draw_values, random_mdp

_LATER = {  # imported when first used, so that the command line starts fast
    "Audit": "elicit.asking.elicitation",
    "Guarantee": "qlearn.learners.loss_bound",
    "InteractivePolicyIteration": "qlearn.learners.policy_iteration",
    "InteractiveQLearning": "qlearn.learners.q_learning",
    "InteractiveValueIteration": "qlearn.learners.value_iteration",
    "LateQLearning": "qlearn.learners.q_learning_asking_late",
    "LateValueIteration": "qlearn.learners.value_iteration",
    "Learner": "qlearn.learners.learner",
    "OrdinalMDP": "qlearn.mdp.ordinal_mdp",
    "Result": "qlearn.learners.learner",
    "Status": "qlearn.learners.learner",
    "draw_values": "qlearn.problems.random_mdp",
    "drive": "qlearn.learners.learner",
    "evaluate_policy": "qlearn.mdp.planning",
    "icu_sepsis": "qlearn.problems.icu_sepsis",
    "loss_bound": "qlearn.learners.loss_bound",
    "policy_loss": "qlearn.mdp.planning",
    "random_mdp": "qlearn.problems.random_mdp",
    "value_iteration": "qlearn.mdp.planning",
}
_MODULES = {  # to be written as qlearn.strategies.max_regret, say
    "ablation": "qlearn.experiments.ablation",
    "exploration": "qlearn.learners.exploration",
    "gym_environments": "qlearn.problems.gymnasium",
    "strategies": "qlearn.learners.query_strategies",
}

__all__ = [
    "Audit",
    "Guarantee",
    "InteractivePolicyIteration",
    "InteractiveQLearning",
    "InteractiveValueIteration",
    "LateQLearning",
    "LateValueIteration",
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
        return import_module(_MODULES[name])
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'qlearn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
