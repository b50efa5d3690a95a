"""Learn the values of an ordinal scale by asking which of two bags of outcomes is better."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elicit.asking.bags import Bags
    from elicit.asking.choose_from_list import choose
    from elicit.asking.options import AskingOptions
    from elicit.comparators.baselines import AlwaysAsk, Dominance
    from elicit.comparators.bradley_terry.bootstrap_comparator import (
        BradleyTerryComparator,
        NotConverged,
    )
    from elicit.comparators.bradley_terry.open_order_posterior import OpenOrderPosterior
    from elicit.comparators.bradley_terry.particle_comparator import PosteriorComparator
    from elicit.comparators.panel import Panel
    from elicit.comparators.polytope.comparator import PolytopeComparator
    from elicit.comparators.polytope.open_order import OpenOrderComparator
    from elicit.decision.verdicts import decide
    from elicit.diagnostics.agreement import Agreement, agreement
    from elicit.diagnostics.held_out import compare_held_out, held_out
    from elicit.diagnostics.tutor_report import tutor_report
    from elicit.lp.prior_inequalities import Inequality, inequalities, inequality
    from elicit.model.comparator import Comparator, Decisions, Tier, value_bounds
    from elicit.model.comparator_parts import simultaneous_bounds
    from elicit.model.difference import as_differences
    from elicit.model.needs import Needs
    from elicit.model.outcomes import Status
    from elicit.model.query import Answer, Answers, InconsistentAnswers, Query, StaleAnswer, Verdict
    from elicit.model.scale_variable import scale_variable
    from elicit.model.tutor import Tutor
    from elicit.person.hosts.widget import InterviewWidget as InterviewWidget
    from elicit.person.interview import Interview, Subject
    from elicit.person.session import Session
    from elicit.person.showing import Words
    from elicit.tutors.answer_log import AnswerLog
    from elicit.tutors.log_file import BadLog
    from elicit.tutors.merge_logs import merge_logs
    from elicit.tutors.panel import PanelTutor
    from elicit.tutors.person import PersonTutor
    from elicit.tutors.replay import NotInLog, ReplayTutor
    from elicit.tutors.simulated import BradleyTerryTutor, FlippingTutor, TruthfulTutor

_PLACES = {  # imported when first used, so that `import elicit` stays light
    "elicit.asking.bags": ["Bags"],
    "elicit.asking.choose_from_list": ["choose"],
    "elicit.asking.options": ["AskingOptions"],
    "elicit.comparators.baselines": ["AlwaysAsk", "Dominance"],
    "elicit.comparators.bradley_terry.bootstrap_comparator": [
        "BradleyTerryComparator",
        "NotConverged",
    ],
    "elicit.comparators.bradley_terry.open_order_posterior": ["OpenOrderPosterior"],
    "elicit.comparators.bradley_terry.particle_comparator": ["PosteriorComparator"],
    "elicit.comparators.panel": ["Panel"],
    "elicit.comparators.polytope.comparator": ["PolytopeComparator"],
    "elicit.comparators.polytope.open_order": ["OpenOrderComparator"],
    "elicit.decision.verdicts": ["decide"],
    "elicit.diagnostics.agreement": ["Agreement", "agreement"],
    "elicit.diagnostics.held_out": ["compare_held_out", "held_out"],
    "elicit.diagnostics.tutor_report": ["tutor_report"],
    "elicit.lp.prior_inequalities": ["Inequality", "inequalities", "inequality"],
    "elicit.person.interview": ["Interview", "Subject"],
    "elicit.person.session": ["Session"],
    "elicit.person.showing": ["Words"],
    "elicit.tutors.answer_log": ["AnswerLog"],
    "elicit.model.comparator": ["Comparator", "Decisions", "Tier", "value_bounds"],
    "elicit.model.comparator_parts": ["simultaneous_bounds"],
    "elicit.model.needs": ["Needs"],
    "elicit.model.outcomes": ["Status"],
    "elicit.model.query": [
        "Answer",
        "Answers",
        "InconsistentAnswers",
        "Query",
        "StaleAnswer",
        "Verdict",
    ],
    "elicit.model.difference": ["as_differences"],
    "elicit.model.scale_variable": ["scale_variable"],
    "elicit.model.tutor": ["Tutor"],
    "elicit.tutors.log_file": ["BadLog"],
    "elicit.tutors.merge_logs": ["merge_logs"],
    "elicit.tutors.panel": ["PanelTutor"],
    "elicit.tutors.person": ["PersonTutor"],
    "elicit.tutors.replay": ["NotInLog", "ReplayTutor"],
    "elicit.tutors.simulated": ["BradleyTerryTutor", "FlippingTutor", "TruthfulTutor"],
}
_LATER = {name: place for place, names in _PLACES.items() for name in names}
_LATER["InterviewWidget"] = (
    "elicit.person.hosts.widget"  # needs an extra, so `from elicit import *` leaves it out
)
_MODULES = {  # to be written as elicit.graph.cycles, say, after import elicit alone
    "conclusion": "elicit.person.course.conclusion",
    "graph": "elicit.diagnostics.preference_graph",
    "objectives": "elicit.objectives",
    "parts": "elicit.model.comparator_parts",
    "people": "elicit.people",
    "plot": "elicit.plot",
    "showing": "elicit.person.showing",
    "testing": "elicit.testing",
}

__all__ = [
    "Agreement",
    "AlwaysAsk",
    "Answer",
    "AnswerLog",
    "Answers",
    "AskingOptions",
    "BadLog",
    "Bags",
    "BradleyTerryComparator",
    "BradleyTerryTutor",
    "Comparator",
    "Decisions",
    "Dominance",
    "FlippingTutor",
    "InconsistentAnswers",
    "Inequality",
    "Interview",
    "Needs",
    "NotConverged",
    "NotInLog",
    "OpenOrderComparator",
    "OpenOrderPosterior",
    "Panel",
    "PanelTutor",
    "PersonTutor",
    "PolytopeComparator",
    "PosteriorComparator",
    "Query",
    "ReplayTutor",
    "Session",
    "StaleAnswer",
    "Status",
    "Subject",
    "Tier",
    "TruthfulTutor",
    "Tutor",
    "Verdict",
    "Words",
    "agreement",
    "as_differences",
    "choose",
    "compare_held_out",
    "decide",
    "held_out",
    "inequalities",
    "inequality",
    "merge_logs",
    "scale_variable",
    "simultaneous_bounds",
    "tutor_report",
    "value_bounds",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from elicit._support.distribution import version

        return version()
    place = _MODULES.get(name) or _LATER.get(name)
    if place is None:
        raise AttributeError(f"module 'elicit' has no attribute {name!r}")
    try:
        module = import_module(place)
    except ModuleNotFoundError as error:
        from elicit._support.distribution import with_advice

        raise with_advice(error) from None
    if name in _MODULES:
        return module
    globals()[name] = value = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_LATER, *_MODULES, "__version__"})
