"""Weighted draws of several parameters: their marginals on the diagonal, their pairs below it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.writing.style import BLUE, INK, VERMILLION, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BINS = 40


def corner(draws: Mapping[str, Any], weights: Floats) -> Figure:
    """`draws`: (n,) values by label. Lines mark the median and the central 90 %. Raises InputError: no matplotlib."""
    count = len(draws)
    figure = new_figure(7.2)
    figure.set_size_inches(max(2.1 * count, 4.2), max(2.1 * count, 4.2))
    grid: Any = figure.subplots(count, count, squeeze=False, gridspec_kw={"wspace": 0.08, "hspace": 0.08})
    labels, values = list(draws), list(draws.values())
    edges = [_edges(value, weights) for value in values]
    for i, j in np.ndindex(count, count):
        axes = grid[i, j]
        if j > i:
            axes.set_visible(False)
            continue
        if i == j:
            axes.hist(values[i], edges[i], weights=weights, color=BLUE, alpha=0.35)
            low, middle, high = _quantiles(values[i], weights)
            axes.axvline(middle, color=VERMILLION, lw=1.2)
            axes.axvspan(low, high, color=INK, alpha=0.1, lw=0)
        else:
            density, _, _ = np.histogram2d(values[j], values[i], [edges[j], edges[i]], weights=weights)
            axes.pcolormesh(edges[j], edges[i], density.T, cmap="Blues", rasterized=True)
            axes.set_ylim(edges[i][0], edges[i][-1])
        axes.set_xlim(edges[j][0], edges[j][-1])
        axes.locator_params(nbins=4, steps=[1, 2, 5, 10])
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:.3g}")
        axes.tick_params(labelsize=8, labelcolor=INK, color="#888888", length=3)
        axes.tick_params(axis="x", labelbottom=i == count - 1, labelrotation=30)
        axes.tick_params(axis="y", left=j < i, labelleft=j == 0 < i)
        if i == count - 1:
            axes.set_xlabel(labels[j], fontsize=9, color=INK)
        if j == 0 < i:
            axes.set_ylabel(labels[i], fontsize=9, color=INK)
    figure.align_labels()
    return figure


def _edges(values: Floats, weights: Floats) -> Floats:
    """Bins that hold all but one draw in a thousand on each side."""
    low, _, high = _quantiles(values, weights, (0.001, 0.5, 0.999))
    margin = 0.02 * (high - low) or 1e-3 * abs(high) or 1.0
    return np.linspace(low - margin, high + margin, _BINS + 1)


def _quantiles(values: Floats, weights: Floats, levels: tuple[float, ...] = (0.05, 0.5, 0.95)) -> Floats:
    return np.asarray(np.quantile(values, levels, weights=weights, method="inverted_cdf"))
