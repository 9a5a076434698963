"""The picture of an answer as a figure of matplotlib, as wide as a column of a paper; readable in grey."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.panels import Layer, answer_panels
from cavirheo.writing import digits, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT = 84 / 25.4, 68 / 25.4  # inches
_SCREEN_DPI = 200  # of a figure in a notebook
_DOT = {"marker": "o", "ls": "", "ms": 2.4, "mew": 0.5, "mfc": "none"}
_STYLES: dict[str, dict[str, Any]] = {  # by look
    "measured": _DOT | {"mec": "black"},
    "outside": _DOT | {"mec": "#a0a0a0"},
    "residual": _DOT | {"mec": "black"},
    "simulated": {"color": style.VERMILLION, "lw": 1.0},
    "zero": {"color": "black", "lw": 0.5},
    "draws": {"color": style.VERMILLION, "alpha": 0.25, "lw": 0},
    "band": {"color": style.BLUE, "alpha": 0.14, "lw": 0},
}


def answer_figure(answer: Posterior) -> Figure:
    """Figure of an answer and its curve: measured points with the simulation over them, and below the residual. Raises
    InputError: it has no curve, or matplotlib is missing."""
    curve = answer.curve
    if curve is None:
        message = "the answer has no curve to draw: set one, dataclasses.replace(answer, curve=curve)"
        raise InputError(message, "posterior.no_curve")
    panels = answer_panels(curve, answer.checks, curve_record(curve, answer))
    figure = style.new_figure(_HEIGHT, _WIDTH)
    figure.set_layout_engine("constrained", h_pad=0.02, w_pad=0.02)
    figure.set_dpi(_SCREEN_DPI)
    rows: Any = figure.subplots(len(panels), squeeze=False, sharex=True, height_ratios=[2, 1][: len(panels)])
    for axes, panel in zip(rows[:, 0], panels, strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=7)
        axes.set(xlim=(panel.x.low, panel.x.high), ylim=(panel.y.low, panel.y.high))
        axes.set_ylabel(panel.y.label, fontsize=7)
        for layer in panel.layers:
            _draw(axes, layer)
    rows[-1, 0].set_xlabel(panels[0].x.label, fontsize=7)
    legend = rows[0, 0].legend(loc="upper right", frameon=False, fontsize=7, title=digits.elide(answer.name, 30))
    legend.get_title().set(fontsize=7, fontweight="bold", parse_math=False)
    return figure


def _draw(axes: Axes, layer: Layer) -> None:
    look = _STYLES[layer.look]
    if layer.shape == "area":
        axes.fill_between(layer.x, layer.y[:, 0], layer.y[:, 1], label=layer.name or "_", **look)
    elif layer.shape == "band":
        axes.axhspan(*layer.y, **look)
    else:
        axes.plot(layer.x, layer.y, label=layer.name or "_", **look)
