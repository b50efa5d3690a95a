"""elicit: learn the values of an ordinal scale by asking which of two bags of outcomes is better."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from elicit.model.comparator import Comparator, Tier, simultaneous_bounds
from elicit.model.query import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict
from elicit.model.tutor import Tutor

if TYPE_CHECKING:
    from elicit.asking.bags import Bags
    from elicit.asking.choose_from_list import choose
    from elicit.comparators.baselines import AlwaysAsk, Dominance
    from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
    from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
    from elicit.comparators.polytope.comparator import PolytopeComparator
    from elicit.comparators.polytope.relaxed_comparator import RelaxedPolytopeComparator
    from elicit.decision.verdicts import decide
    from elicit.diagnostics.held_out import compare_held_out, held_out
    from elicit.diagnostics.tutor_report import tutor_report
    from elicit.lp.prior_inequalities import Inequality, inequalities, inequality
    from elicit.model.scale_variable import scale_variable
    from elicit.tutors.answer_log import AnswerLog
    from elicit.tutors.replay import ReplayTutor
    from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor

_LATER = {  # imported when first used, so that `import elicit` stays light
    "AlwaysAsk": "elicit.comparators.baselines",
    "Dominance": "elicit.comparators.baselines",
    "decide": "elicit.decision.verdicts",
    "choose": "elicit.asking.choose_from_list",
    "AnswerLog": "elicit.tutors.answer_log",
    "Bags": "elicit.asking.bags",
    "BradleyTerryComparator": "elicit.comparators.bradley_terry.bootstrap_comparator",
    "BradleyTerryTutor": "elicit.tutors.simulated",
    "FlippingTutor": "elicit.tutors.simulated",
    "Inequality": "elicit.lp.prior_inequalities",
    "PolytopeComparator": "elicit.comparators.polytope.comparator",
    "PosteriorComparator": "elicit.comparators.bradley_terry.particle_comparator",
    "RelaxedPolytopeComparator": "elicit.comparators.polytope.relaxed_comparator",
    "ReplayTutor": "elicit.tutors.replay",
    "TruthfulTutor": "elicit.tutors.simulated",
    "compare_held_out": "elicit.diagnostics.held_out",
    "held_out": "elicit.diagnostics.held_out",
    "inequalities": "elicit.lp.prior_inequalities",
    "inequality": "elicit.lp.prior_inequalities",
    "scale_variable": "elicit.model.scale_variable",
    "tutor_report": "elicit.diagnostics.tutor_report",
}
_MODULES = {"graph": "elicit.diagnostics.preference_graph"}  # to be written as elicit.graph.cycles, say

__all__ = [
    "AlwaysAsk",
    "Answer",
    "AnswerLog",
    "Answers",
    "Bags",
    "BradleyTerryComparator",
    "BradleyTerryTutor",
    "Comparator",
    "Dominance",
    "FlippingTutor",
    "InconsistentAnswers",
    "Inequality",
    "PolytopeComparator",
    "PosteriorComparator",
    "Query",
    "RelaxedPolytopeComparator",
    "ReplayTutor",
    "StaleAnswer",
    "Tier",
    "TruthfulTutor",
    "Tutor",
    "Verdict",
    "choose",
    "compare_held_out",
    "decide",
    "held_out",
    "inequalities",
    "inequality",
    "scale_variable",
    "simultaneous_bounds",
    "tutor_report",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'elicit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
