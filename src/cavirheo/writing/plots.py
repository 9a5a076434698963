"""Figures by matplotlib, which is optional (`pip install "cavirheo[plot]"`) and imported when the first one is made."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.writing import digits
from cavirheo.writing.export import import_optional

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, VERMILLION = "#0072b2", "#d55e00"  # of Okabe and Ito, distinct also for colour-blind readers


def subplots(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """(a new figure of this size in inches, its axes (rows, columns)). Raises InputError without matplotlib."""
    import_optional("matplotlib", "cavirheo[plot]")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in grid.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
    return figure, grid


def corner_plot(draws: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the weighted draws (k,) of each parameter, by natural name in SI, with median and central 90 %, and of
    each pair of parameters, by `corner` (Foreman-Mackey 2016, doi:10.21105/joss.00024). Raises InputError without
    corner."""
    corner = import_optional("corner")
    from matplotlib.figure import Figure

    columns, labels = list[Floats](), list[str]()
    for name, values in draws.items():
        shown = digits.shown(name, float(np.median(values)))
        columns.append(shown.factor * values)
        labels.append(f"{shown.symbol} ({shown.unit})" if shown.unit else shown.symbol)
    size = 2.2 * len(draws) + 0.8
    figure = Figure(figsize=(size, size))
    ends = (0.05, 0.5, 0.95)
    options = {"quantiles": ends, "title_quantiles": ends, "show_titles": True, "title_fmt": ".3g", "color": BLUE}
    corner.corner(np.column_stack(columns), weights=weights, labels=labels, fig=figure, **options)
    return figure
