"""elicit: learn the values of an ordinal scale by asking which of two bags of outcomes is better."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from elicit.model.comparator import AlwaysAsk, Comparator, Dominance, Tier, decide, simultaneous_bounds
from elicit.model.query import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict

if TYPE_CHECKING:
    from elicit.asking.bags import Bags
    from elicit.asking.choose import choose
    from elicit.comparators.bradley_terry.bootstrap_comparator import BradleyTerryComparator
    from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
    from elicit.comparators.polytope.comparator import PolytopeComparator
    from elicit.comparators.polytope.relaxed_comparator import RelaxedPolytopeComparator
    from elicit.diagnostics.held_out import compare_held_out, held_out
    from elicit.diagnostics.tutor_report import tutor_report
    from elicit.lp.inequalities import Inequality, inequalities, inequality
    from elicit.tutors.answer_log import AnswerLog
    from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, ReplayTutor, TruthfulTutor, Tutor

_LATER = {  # imported when first used, so that `import elicit` stays light
    "AnswerLog": "elicit.tutors.answer_log",
    "Bags": "elicit.asking.bags",
    "BradleyTerryComparator": "elicit.comparators.bradley_terry.bootstrap_comparator",
    "BradleyTerryTutor": "elicit.tutors.simulated",
    "FlippingTutor": "elicit.tutors.simulated",
    "Inequality": "elicit.lp.inequalities",
    "PolytopeComparator": "elicit.comparators.polytope.comparator",
    "PosteriorComparator": "elicit.comparators.bradley_terry.particle_comparator",
    "RelaxedPolytopeComparator": "elicit.comparators.polytope.relaxed_comparator",
    "ReplayTutor": "elicit.tutors.simulated",
    "TruthfulTutor": "elicit.tutors.simulated",
    "Tutor": "elicit.tutors.simulated",
    "choose": "elicit.asking.choose",
    "compare_held_out": "elicit.diagnostics.held_out",
    "held_out": "elicit.diagnostics.held_out",
    "inequalities": "elicit.lp.inequalities",
    "inequality": "elicit.lp.inequalities",
    "tutor_report": "elicit.diagnostics.tutor_report",
}
_MODULES = {"graph": "elicit.diagnostics.preference_graph"}  # to be written as elicit.graph.circles, say

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
