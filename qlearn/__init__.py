"""qlearn: interactive reinforcement learning with ordinal rewards and a tutor who may err."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elicit.asking.question import Audit
    from elicit.model.outcomes import Status
    from qlearn.certificates.loss_bound import Guarantee, loss_bound
    from qlearn.environments.level_rewards import LevelVector, OrdinalReward
    from qlearn.environments.rollout_shares import RolloutShares
    from qlearn.environments.rollouts import rollout_shares
    from qlearn.experiments.loss_history import LossHistory
    from qlearn.learners.driving import drive
    from qlearn.learners.expected_bounds import ExpectedBounds, expected_bounds
    from qlearn.learners.learner import Learner, Result
    from qlearn.learners.policy_iteration import InteractivePolicyIteration
    from qlearn.learners.q_learning import InteractiveQLearning
    from qlearn.learners.q_learning_asking_late import LateQLearning
    from qlearn.learners.value_iteration import InteractiveValueIteration, LateValueIteration
    from qlearn.mdp.equal_gaps import UnaskedLoss, equal_gaps_policy, unasked_loss
    from qlearn.mdp.ordinal_mdp import OrdinalMDP
    from qlearn.mdp.planning import evaluate_policy, policy_loss, value_iteration
    from qlearn.panel.asking_for_the_worst_off import WorstOffIteration, WorstOffResult
    from qlearn.panel.following import Following, cost_of_following, cost_of_following_a_choice
    from qlearn.panel.worst_off import WorstOffPolicy, policy_for_the_worst_off
    from qlearn.problems.hidden_scales import hidden_scales
    from qlearn.problems.icu_sepsis import icu_sepsis
    from qlearn.problems.random_mdp import draw_values, random_mdp
    from qlearn.solving import solve
    from qlearn.training.interactive_training import InteractiveTraining
    from qlearn.training.training_result import TrainedPolicy, TrainingResult

_NAMES = {  # imported when first used, so that the command line starts fast
    "elicit.asking.question": ("Audit",),
    "elicit.model.outcomes": ("Status",),
    "qlearn.learners.expected_bounds": ("ExpectedBounds", "expected_bounds"),
    "qlearn.environments.level_rewards": ("LevelVector", "OrdinalReward"),
    "qlearn.environments.rollout_shares": ("RolloutShares",),
    "qlearn.environments.rollouts": ("rollout_shares",),
    "qlearn.learners.driving": ("drive",),
    "qlearn.learners.learner": ("Learner", "Result"),
    "qlearn.certificates.loss_bound": ("Guarantee", "loss_bound"),
    "qlearn.learners.policy_iteration": ("InteractivePolicyIteration",),
    "qlearn.learners.q_learning": ("InteractiveQLearning",),
    "qlearn.learners.q_learning_asking_late": ("LateQLearning",),
    "qlearn.learners.value_iteration": ("InteractiveValueIteration", "LateValueIteration"),
    "qlearn.panel.asking_for_the_worst_off": ("WorstOffIteration", "WorstOffResult"),
    "qlearn.experiments.loss_history": ("LossHistory",),
    "qlearn.mdp.equal_gaps": ("UnaskedLoss", "equal_gaps_policy", "unasked_loss"),
    "qlearn.mdp.ordinal_mdp": ("OrdinalMDP",),
    "qlearn.mdp.planning": ("evaluate_policy", "policy_loss", "value_iteration"),
    "qlearn.panel.following": ("Following", "cost_of_following", "cost_of_following_a_choice"),
    "qlearn.panel.worst_off": ("WorstOffPolicy", "policy_for_the_worst_off"),
    "qlearn.problems.hidden_scales": ("hidden_scales",),
    "qlearn.problems.icu_sepsis": ("icu_sepsis",),
    "qlearn.problems.random_mdp": ("draw_values", "random_mdp"),
    "qlearn.solving": ("solve",),
    "qlearn.training.interactive_training": ("InteractiveTraining",),
    "qlearn.training.training_result": ("TrainedPolicy", "TrainingResult"),
}
_LATER = {name: module for module, names in _NAMES.items() for name in names}
_MODULES = {  # to be written as qlearn.strategies.max_regret, say
    "ablation": "qlearn.experiments.ablation",
    "ablation_plot": "qlearn.experiments.ablation_plot",
    "claims": "qlearn.paper.claims",
    "exploration": "qlearn.learners.exploration",
    "figure_runs": "qlearn.paper.figure_runs",
    "gym_environments": "qlearn.problems.gymnasium",
    "paper_figures": "qlearn.paper.figures",
    "problems": "qlearn.problems",
    "strategies": "qlearn.learners.query_strategies",
}

__all__ = [
    "Audit",
    "ExpectedBounds",
    "Following",
    "Guarantee",
    "InteractivePolicyIteration",
    "InteractiveQLearning",
    "InteractiveTraining",
    "InteractiveValueIteration",
    "LateQLearning",
    "LateValueIteration",
    "Learner",
    "LevelVector",
    "LossHistory",
    "OrdinalMDP",
    "OrdinalReward",
    "Result",
    "RolloutShares",
    "Status",
    "TrainedPolicy",
    "TrainingResult",
    "UnaskedLoss",
    "WorstOffIteration",
    "WorstOffPolicy",
    "WorstOffResult",
    "cost_of_following",
    "cost_of_following_a_choice",
    "draw_values",
    "drive",
    "equal_gaps_policy",
    "evaluate_policy",
    "expected_bounds",
    "hidden_scales",
    "icu_sepsis",
    "loss_bound",
    "policy_for_the_worst_off",
    "policy_loss",
    "random_mdp",
    "rollout_shares",
    "solve",
    "unasked_loss",
    "value_iteration",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from elicit._support.distribution import version

        return version()
    if name in _MODULES or name in _LATER:
        try:
            module = import_module(_MODULES.get(name) or _LATER[name])
        except ModuleNotFoundError as error:
            from elicit._support.distribution import with_advice

            raise with_advice(error) from None
        if name in _MODULES:
            return module
        value = getattr(module, name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'qlearn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *_MODULES, "__version__"])
