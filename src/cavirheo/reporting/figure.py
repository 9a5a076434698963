"""Figures of an answer by matplotlib, readable in grey: its curve, as wide as a column of a paper, and its draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting.panels import curve_panels
from cavirheo.writing import digits
from cavirheo.writing.export import import_optional

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = 84 / 25.4, 68 / 25.4  # inches
_BLUE, _VERMILLION = "#0072b2", "#d55e00"  # of Okabe and Ito, distinct also for colour-blind readers
_DOT = {"marker": "o", "ls": "", "ms": 2.4, "mew": 0.5, "mfc": "none"}
_STYLES: dict[str, dict[str, Any]] = {  # by look
    "measured": _DOT | {"mec": "black"},
    "outside": _DOT | {"mec": "#a0a0a0"},
    "residual": _DOT | {"mec": "black"},
    "simulated": {"color": _VERMILLION, "lw": 1.0},
    "zero": {"color": "black", "lw": 0.5},
    "draws": {"color": _VERMILLION, "alpha": 0.25, "lw": 0},
}


def answer_figure(answer: Posterior) -> Figure:
    """Figure of an answer and its curve: measured points with the simulation over them, and below the residual. Raises
    InputError: it has no curve, or matplotlib is missing."""
    curve = answer.curve
    if curve is None:
        message = "the answer has no curve to draw: set one, dataclasses.replace(answer, curve=curve)"
        raise InputError(message, "posterior.no_curve")
    panels = curve_panels(curve, answer.checks, answer.method)
    heights = [2, 1][: len(panels)]
    import_optional("matplotlib", "cavirheo[plot]")
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE, dpi=200, layout="constrained")
    rows: Any = figure.subplots(len(panels), 1, squeeze=False, sharex=True, height_ratios=heights)
    for axes, panel in zip(rows[:, 0], panels, strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.set(xlim=(panel.x.low, panel.x.high), ylim=(panel.y.low, panel.y.high))
        axes.set_ylabel(panel.y.label, fontsize=7)
        for layer in panel.drawn:
            style = {"label": layer.name or "_", **_STYLES[layer.look]}
            if layer.shape == "area":
                axes.fill(layer.x, layer.y, **style)
            else:
                axes.plot(layer.x, layer.y, **style)
    rows[-1, 0].set_xlabel(panels[0].x.label, fontsize=7)
    legend = rows[0, 0].legend(loc="upper right", frameon=False, fontsize=7, title=digits.elide(answer.name, 30))
    legend.get_title().set(fontsize=7, fontweight="bold", parse_math=False)
    return figure


def corner_figure(draws: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the weighted draws (k,) of each parameter, by natural name in SI, with median and central 90 %, and of
    each pair of parameters, by `corner` (Foreman-Mackey 2016, doi:10.21105/joss.00024). Raises InputError without
    corner."""
    corner = import_optional("corner", "cavirheo[plot]")
    from matplotlib.figure import Figure

    columns = [(digits.shown(name, float(np.median(values))), values) for name, values in draws.items()]
    labels = [f"{shown.symbol} ({shown.unit})" if shown.unit else shown.symbol for shown, _ in columns]
    size = 2.2 * len(draws) + 0.8
    figure = Figure(figsize=(size, size))
    ends = (0.05, 0.5, 0.95)
    options = {"quantiles": ends, "title_quantiles": ends, "show_titles": True, "title_fmt": ".3g", "color": _BLUE}
    values = np.column_stack([shown.factor * values for shown, values in columns])
    corner.corner(values, weights=weights, labels=labels, fig=figure, **options)
    return figure
