"""elicit: learn the values of an ordinal scale by asking which of two bags of outcomes is better."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from elicit.choose import choose
from elicit.comparator import AlwaysAsk, Comparator, Dominance, Tier, decide, simultaneous_bounds
from elicit.query import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict

if TYPE_CHECKING:
    from elicit.bags import Bags
    from elicit.bradley_terry import BradleyTerryComparator
    from elicit.diagnostics import tutor_report
    from elicit.foretell import compare_held_out, held_out
    from elicit.log import AnswerLog
    from elicit.polytope import PolytopeComparator
    from elicit.posterior import PosteriorComparator
    from elicit.prior import Inequality, inequalities, inequality
    from elicit.relaxed import RelaxedPolytopeComparator
    from elicit.tutor import BradleyTerryTutor, FlippingTutor, ReplayTutor, TruthfulTutor, Tutor

_LATER = {  # imported when first used, so that `import elicit` stays light
    "AnswerLog": "elicit.log",
    "Bags": "elicit.bags",
    "BradleyTerryComparator": "elicit.bradley_terry",
    "BradleyTerryTutor": "elicit.tutor",
    "FlippingTutor": "elicit.tutor",
    "Inequality": "elicit.prior",
    "PolytopeComparator": "elicit.polytope",
    "PosteriorComparator": "elicit.posterior",
    "RelaxedPolytopeComparator": "elicit.relaxed",
    "ReplayTutor": "elicit.tutor",
    "TruthfulTutor": "elicit.tutor",
    "Tutor": "elicit.tutor",
    "compare_held_out": "elicit.foretell",
    "held_out": "elicit.foretell",
    "inequalities": "elicit.prior",
    "inequality": "elicit.prior",
    "tutor_report": "elicit.diagnostics",
}

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
    if name in _LATER:
        value = getattr(import_module(_LATER[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'elicit' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
