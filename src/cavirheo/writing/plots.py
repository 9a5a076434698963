"""Figures by matplotlib, which is optional (`pip install "cavirheo[plot]"`) and imported when the first one is made."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.writing import digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, VERMILLION, INK = "#0072b2", "#d55e00", "#444444"  # of Okabe and Ito, distinct also for colour-blind readers


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


def corner_plot(draws: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the draws (k,) of each parameter, by natural name in SI, with median and central 90 %, and of each pair
    of parameters, where a larger point has more weight (k,). Raises InputError without matplotlib."""
    from cavirheo.writing.document import Quantity

    size = 2.1 * len(draws) + 0.8
    figure, grid = subplots(len(draws), len(draws), size, size, sharex="col")
    areas = 12.0 * min(1.0, 500.0 / len(weights)) * weights / np.mean(weights)
    scaled, labels = list[Floats](), list[str]()
    for row, (name, values) in enumerate(draws.items()):
        levels = [0.002, 0.05, 0.5, 0.95, 0.998]
        least, *ends, most = np.quantile(values, levels, weights=weights, method="inverted_cdf").tolist()
        symbol, unit = digits.symbol_and_unit(name)
        factor, unit = digits.unit_for(unit, ends[1])
        label = f"{symbol} ({unit})" if unit else symbol
        scaled.append(factor * values)
        labels.append(label)
        for column, others in enumerate(scaled[:-1]):
            grid[column, row].remove()
            grid[row, column].scatter(others, scaled[row], areas, color=BLUE, alpha=0.4, lw=0)
        axes = grid[row, row]
        axes.hist(scaled[row], bins=24, range=(factor * least, factor * most), weights=weights, color=BLUE, alpha=0.4)
        for end in ends:
            axes.axvline(factor * end, color=INK, lw=0.8, ls="--")
        words = digits.quantity(Quantity.from_interval(*ends), factor)
        axes.set_title(f"{symbol} {words}", fontsize=9)
        axes.set_yticks([])
        grid[row, 0].set_ylabel(label if row else "")
    for axes, label in zip(grid[-1], labels, strict=True):
        axes.set_xlabel(label)
        axes.locator_params(axis="x", nbins=3)
    return figure
