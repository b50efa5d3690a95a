"""Pictures of comparators: plausible scales, intervals of levels, graphs of answers, and losses.

Each comparator has one colour and marker, in these and all other pictures. All functions take
``ax`` (None makes a figure of its own), return it, show nothing and change no settings. matplotlib
is imported when one is called. Without it they raise ImportError.

Pictures of levels take two more keywords:

labels : sequence of k str, optional
    Names of the levels, worst first. None: e_1 to e_k.
values : (k,), optional
    The true scale, one number for each level, in any unit. It is drawn beside what the comparator
    says. Only a simulation knows it.
"""

from elicit.catalogue import STYLES, kind_of, styles
from elicit.plot.answer_graph import preference_graph
from elicit.plot.loss_curves import loss_history
from elicit.plot.plausible_sets import corners, plausible, polytope
from elicit.plot.value_intervals import agreement, scale_intervals

__all__ = [
    "STYLES",
    "agreement",
    "corners",
    "kind_of",
    "loss_history",
    "plausible",
    "polytope",
    "preference_graph",
    "scale_intervals",
    "styles",
]
