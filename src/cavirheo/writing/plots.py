"""Figures by matplotlib, which is optional (`pip install "cavirheo[plot]"`) and imported when the first one is made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.writing import digits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cavirheo.writing.document import Quantity

BLUE, VERMILLION, INK = "#0072b2", "#d55e00", "#444444"  # of Okabe and Ito, distinct also for colour-blind readers
_MARKERS = {None: "o", "upper": "<", "lower": ">"}  # of a value, and of the limit of a bound


def subplots(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """(a new figure of this size in inches, its axes (rows, columns)). Raises InputError without matplotlib."""
    message = 'pictures need matplotlib: pip install "cavirheo[plot]"'
    require(find_spec("matplotlib") is not None, message, "style.no_matplotlib")
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
        factor, label = _axis(name, ends[1])
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
        axes.set_title(f"{label.split()[0]} {words}", fontsize=9)
        axes.set_yticks([])
        grid[row, 0].set_ylabel(label if row else "")
    for axes, label in zip(grid[-1], labels, strict=True):
        axes.set_xlabel(label)
        axes.locator_params(axis="x", nbins=3)
    return figure


def interval_plot(
    shots: Sequence[str], values: Mapping[str, Sequence[Quantity]], material: Mapping[str, Quantity]
) -> Figure:
    """Figure of the 90 % interval of each shot, over that of the material, a panel for each parameter, by natural name
    in SI; of a bound the limit, as an arrow. Raises InputError without matplotlib."""
    figure, grid = subplots(1, len(values), 1.5 + 2.6 * len(values), 0.22 * len(shots) + 0.9, sharey=True)
    for axes, (name, shot_values) in zip(grid[0], values.items(), strict=True):
        whole = material[name]
        factor, label = _axis(name, whole.largest)
        ends = [factor * end for end in whole.limits if 0.0 < end < np.inf]
        if len(ends) == 2:
            axes.axvspan(*ends, color=BLUE, alpha=0.2, lw=0)
        for end in ends:
            axes.axvline(end, color=BLUE, lw=0.8, ls="--")
        if whole.median is not None:
            axes.axvline(factor * whole.median, color=BLUE, lw=0.8)
        for row, value in enumerate(shot_values):
            ends = [factor * end for end in value.limits if 0.0 < end < np.inf]
            axes.plot(ends, [row] * len(ends), color=INK, lw=1.2)
            if value.bound in _MARKERS and value.largest is not None:
                axes.plot(factor * value.largest, row, _MARKERS[value.bound], color=INK, ms=4)
        axes.set_xlabel(label)
        axes.locator_params(axis="x", nbins=4)
    grid[0, 0].set_yticks(range(len(shots)), [digits.elide(name, 24) for name in shots], parse_math=False)
    grid[0, 0].set_ylim(len(shots) - 0.5, -0.5)
    return figure


def _axis(name: str, value: float | None) -> tuple[float, str]:
    """(factor from SI to the unit of an axis, its label 'G (kPa)') for values of a parameter of this size, SI."""
    symbol, unit = digits.symbol_and_unit(name)
    factor, unit = digits.unit_for(unit or "1", value)
    return factor, f"{symbol} ({unit})" if unit else symbol
