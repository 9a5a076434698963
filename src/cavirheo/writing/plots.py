"""Figures by matplotlib, which is optional (`pip install "cavirheo[plot]"`) and imported when the first one is made."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from cavirheo.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, VERMILLION = "#0072b2", "#d55e00"  # of Okabe and Ito, distinct also for colour-blind readers


def subplots(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """(a new figure of this size in inches, its axes (rows, columns)). Raises InputError without matplotlib."""
    if find_spec("matplotlib") is None:
        raise InputError('pictures need matplotlib: pip install "cavirheo[plot]"', "style.no_matplotlib")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in grid.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    return figure, grid


def new_axes(height: float, x_label: str, y_label: str) -> Any:
    """The axes of a new figure of this height in inches. Raises InputError without matplotlib."""
    axes = subplots(1, 1, 7.2, height)[1][0, 0]
    axes.set(xlabel=x_label, ylabel=y_label)
    return axes
