"""The frame of pictures with two panels: the answer in words, the measurement, and below it what is left."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cavirheo.writing import digits
from cavirheo.writing.style import INK, new_axes, new_figure, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WHOLE, _UPPER, _LOWER = (0.1, 0.115, 0.875, 0.72), (0.1, 0.415, 0.875, 0.4), (0.1, 0.115, 0.875, 0.22)


def headed(name: str, right: str, answer: list[str]) -> Figure:
    """A figure with its title and the answer in a box. Raises InputError without matplotlib."""
    figure = new_figure(4.5)
    write(figure, 0.1, 0.955, digits.elide(name, 50), size=11, weight="bold")
    write(figure, 0.975, 0.955, right, size=10, weight="bold", ha="right", color=INK)
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#f4f1ea", "edgecolor": "none"}
    write(figure, 0.111, 0.895, "\u2003\u2002".join(filter(None, answer)), size=9.0, bbox=box)
    return figure


def one_panel(figure: Figure, x: str, y: str) -> Axes:
    return new_axes(figure, _WHOLE, x, y)


def two_panels(figure: Figure, upper_y: str, x: str, lower_y: str) -> tuple[Axes, Axes]:
    """Upper and lower axes; the lower one names x for both."""
    upper, lower = new_axes(figure, _UPPER, "", upper_y), new_axes(figure, _LOWER, x, lower_y)
    upper.tick_params(labelbottom=False)
    return upper, lower


def named_curves(axes: Axes, count: int, **how: Any) -> None:
    """The names of so many curves in one line at the upper right of a panel, above the curves."""
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.985), "ncols": count}
    axes.legend(**place, fontsize=8.5, frameon=False, handlelength=1.6, **how)


def plain_ticks(axis: Any, steps: tuple[int, ...], most: int | None = None) -> None:
    """0.01, 1, 100 instead of powers, and such multiples of these."""
    from matplotlib.ticker import LogLocator

    axis.set_major_locator(LogLocator(subs=steps, numticks=most))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")
