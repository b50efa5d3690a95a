"""Pictures of comparators: plausible scales, intervals of levels, and graphs of answers.

Each comparator has one colour and marker, in these and all other pictures. All functions take
``ax`` (None makes a figure of its own), return it, show nothing and change no settings. matplotlib
is imported when one is called. Without it they raise ImportError.
"""

from elicit.catalogue import STYLES, kind_of, styles
from elicit.plot.answer_graph import preference_graph
from elicit.plot.plausible_sets import corners, plausible, polytope
from elicit.plot.value_intervals import agreement, scale_intervals

__all__ = [
    "STYLES",
    "agreement",
    "corners",
    "kind_of",
    "plausible",
    "polytope",
    "preference_graph",
    "scale_intervals",
    "styles",
]
