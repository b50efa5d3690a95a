"""A policy's loss and its bound against the number of questions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from elicit.catalogue import styles
from elicit.model.scale import Floats
from elicit.plot.axes import axes_of, legend_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class HasLosses(Protocol):
    """A policy's losses after each answer, from question zero, such as ``qlearn.LossHistory``."""

    @property
    def asked(self) -> Any:
        """Numbers (n,) of questions asked, 0 first."""

    @property
    def loss(self) -> Floats:
        """True losses (n,), as shares of the value range; nan where they are not known."""

    @property
    def loss_bound(self) -> Floats:
        """Upper bounds (n,) on the losses; nan where there are none."""


def loss_history(histories: HasLosses | Mapping[str, HasLosses], ax: Axes | None = None) -> Axes:
    """Draw a policy's loss and the bound on it after each answer, from question zero.

    The loss is a full line, in percent of the value range, and the bound a dotted one. The axis is
    linear up to 0.1% and logarithmic beyond.

    Parameters
    ----------
    histories : LossHistory, or mapping of str to LossHistory
        A run's losses, or those of several runs by name. A run has the colour that
        ``elicit.plot.styles`` gives its name, if it is that of a comparator or learner.
    ax : matplotlib Axes, optional

    Returns
    -------
    Axes

    Raises
    ------
    TypeError
        If the histories are not losses.
    """
    several = histories if isinstance(histories, Mapping) else {"": histories}
    for one in several.values():
        if not all(hasattr(one, name) for name in ("asked", "loss", "loss_bound")):
            raise TypeError(
                f"loss_history draws a qlearn.LossHistory, not {one!r}: give one to qlearn.solve "
                "as progress=, then draw it"
            )
    ax = axes_of(ax, (6.4, 4.0))
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    handles = []
    for name, look in styles(several).items():
        one, color = several[name], look["color"]
        for y, line in ((one.loss, "-"), (one.loss_bound, ":")):
            ax.step(one.asked, 100 * np.asarray(y), line, color=color, where="post")
        handles.append(Line2D([], [], color=color, label=name))
    handles = handles if isinstance(histories, Mapping) else []
    handles += [Line2D([], [], color="0.3", linestyle=line, label=label) for line, label in _LINES]
    ax.set_yscale("symlog", linthresh=0.1)
    ax.set(xlabel="questions asked", ylabel="loss, % of the value range", ylim=(0, None))
    ax.set_xlim(left=0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.spines[["top", "right"]].set_visible(False)
    legend_above(ax, handles)
    return ax


_LINES: tuple[tuple[Any, str], ...] = (("-", "loss under the true values"), (":", "bound"))
