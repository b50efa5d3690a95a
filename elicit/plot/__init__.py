"""Pictures of comparators: plausible scales, intervals of levels, graphs of answers, and losses.

Each comparator has the same colour and marker in all pictures. All functions take ``ax`` (None
makes a new figure) and return it. They show nothing and change no settings. They import matplotlib
when they are called, and raise ImportError without it.

Pictures of levels take two more keywords:

labels : sequence of k str, optional
    Names of the levels, worst first. None: e_1 to e_k.
values : (k,), optional
    The true scale, a number for each level, in any unit. It is drawn beside what the comparator
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
