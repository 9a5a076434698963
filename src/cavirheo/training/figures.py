"""Figures of an evaluation: the paper's three, and where the error sits. Colour-blind readers tell the colours apart.

matplotlib is optional (`pip install "cavirheo[plot]"`) and used by its object interface alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import InputError
from cavirheo.parameters import LOG10, about, natural_name
from cavirheo.training.metrics import natural

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
SYMBOLS = {"shear_modulus": "G", "viscosity": "µ", "stretch": "λ = Rₘₐₓ/R₀", "stiffening": "α"}
_BLUE, _ORANGE, _GREY, _INK = "#0072b2", "#d55e00", "#9a9a9a", "#333333"  # the first two of Okabe and Ito
_MAP = "cividis"
_STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": _INK,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}
_LARGE_BIN = 10  # curves below which a running median is not drawn


def draw(
    folder: Path, card: Mapping[str, Any], result: Mapping[str, Any], truth: Floats, predicted: Floats
) -> list[str]:
    """Draw an `evaluate` result into the folder; the names of the files drawn.

    loss.png (from the history on the model's card), predicted.png, error.png, error_map.png, error_share.png, and
    robustness.png where that was asked for. truth and predicted: (curves, outputs) in the prior's scale.

    Raises InputError if matplotlib is not installed.
    """
    try:
        from matplotlib import rc_context
    except ImportError as error:
        raise InputError("the figures need matplotlib: pip install 'cavirheo[plot]'") from error
    names = result["outputs"]
    with rc_context(_STYLE):
        figures = {
            "loss.png": _loss(card) if card.get("history") else None,
            "predicted.png": _predicted(names, truth, predicted, result["metrics"]),
            "error.png": _error(names, truth, predicted),
            "error_map.png": _error_map(names, result["breakdown"]),
            "error_share.png": _error_share(names, result["breakdown"]),
            "robustness.png": _robustness(names, result["robustness"]) if result["robustness"] else None,
        }
        drawn = {name: figure for name, figure in figures.items() if figure is not None}
        for name, figure in drawn.items():
            figure.savefig(folder / name, dpi=160)
    return list(drawn)


def _loss(card: Mapping[str, Any]) -> Figure:
    from matplotlib.ticker import LogLocator, NullFormatter

    figure = _figure(6.0, 3.8)
    axes = figure.subplots()
    history, best = card["history"], card["training"]["best_epoch"]
    epochs = np.arange(1, len(history["train"]) + 1)
    dropped = f"dropout to epoch {last}" if (last := card["training"].get("dropout_epochs")) else "with dropout"
    axes.semilogy(epochs, history["train"], color=_BLUE, lw=1.6, label=f"training ({dropped})")
    axes.semilogy(epochs, history["validation"], color=_ORANGE, lw=1.2, label="validation")
    lowest = history["validation"][best - 1]
    axes.plot(best, lowest, "o", ms=7, mfc="none", mec=_INK, label=f"kept: epoch {best}, {lowest:.4f}")
    axes.set(xlabel="epoch", ylabel="mean squared error\n(of outputs over the prior's std. deviation)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both", lw=0.5)
    axes.legend()
    return figure


def _predicted(names: Sequence[str], truth: Floats, predicted: Floats, metrics: Mapping[str, Any]) -> Figure:
    figure = _figure(4.3 * len(names), 4.4)
    for axes, name, t, p in zip(_row(figure, len(names)), names, truth.T, predicted.T, strict=True):
        t, p = natural(name, t), natural(name, p)
        ends = np.array([min(t.min(), p.min()), max(t.max(), p.max())])
        axes.plot(t, p, ".", ms=3.5, alpha=0.5, mew=0, color=_BLUE)
        axes.plot(ends, ends, color=_INK, lw=1, label="predicted = true", zorder=1)
        _scale(axes, name, "x")
        _scale(axes, name, "y")
        axes.set_xlim(axes.get_ylim())
        axes.set(xlabel=f"true {_label(name)}", ylabel=f"predicted {_label(name)}", box_aspect=1)
        axes.set_title(f"R² = {metrics[name]['r2']:.4f}" + (" of the logarithm" if name.startswith(LOG10) else ""))
        axes.legend(loc="upper left")
    return figure


def _error(names: Sequence[str], truth: Floats, predicted: Floats) -> Figure:
    figure = _figure(4.8 * len(names), 4.0)
    for axes, name, t, p in zip(_row(figure, len(names)), names, truth.T, predicted.T, strict=True):
        error = 100 * (natural(name, p) / natural(name, t) - 1)
        axes.plot(natural(name, t), error, ".", ms=3.5, alpha=0.35, mew=0, color=_BLUE)
        axes.axhline(0, color=_INK, lw=1)
        edges = np.linspace(t.min(), t.max(), 13)
        place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
        kept = [k for k in range(len(edges) - 1) if np.count_nonzero(place == k) >= _LARGE_BIN]
        if kept:
            low, middle, high = np.transpose([np.percentile(error[place == k], (16, 50, 84)) for k in kept])
            centre = natural(name, ((edges[:-1] + edges[1:]) / 2)[kept])
            axes.fill_between(centre, low, high, color=_ORANGE, alpha=0.25, lw=0, label="middle 68 %")
            axes.plot(centre, middle, color=_ORANGE, lw=1.8, label="median")
            axes.legend(loc="upper right", ncols=2)
        _scale(axes, name, "x")
        axes.set_yscale("symlog", linthresh=10)
        ticks = [s * v for s in (-1, 1) for v in (5, 10, 20, 50, 100, 200, 500, 1000) if v <= 1.3 * abs(error).max()]
        axes.set_yticks([0, *ticks], [f"{v:+g}" if v else "0" for v in (0, *ticks)], minor=False)
        axes.minorticks_off()
        axes.set_ylim(1.25 * min(error.min(), -10), 2.2 * max(error.max(), 10))
        axes.set(xlabel=f"true {_label(name)}", ylabel=f"relative error of {_symbol(name)} (%)")
    return figure


def _error_map(names: Sequence[str], breakdown: Mapping[str, Any]) -> Figure:
    """RMSE over each pair of parameters, one row an output, one colour scale a row."""
    pairs = len(breakdown[names[0]]["by_pair"])
    figure = _figure(4.1 * pairs + 0.7, 3.7 * len(names))
    for row, name in zip(figure.subplots(len(names), pairs, squeeze=False), names, strict=True):
        maps = [np.array(m["rmse"], dtype=float) for m in breakdown[name]["by_pair"]]
        top = max(np.nanmax(values) for values in maps)
        for axes, pair, values in zip(row, breakdown[name]["by_pair"], maps, strict=True):
            x, y = (natural(pair[k], np.array(pair[f"{k}_edges"])) for k in "xy")
            mesh = axes.pcolormesh(x, y, values.T, cmap=_MAP, vmin=0, vmax=top, edgecolors="white", linewidth=0.4)
            _write_cells(axes, pair, values, top)
            _scale(axes, pair["x"], "x")
            _scale(axes, pair["y"], "y")
            axes.set(xlabel=f"true {_label(pair['x'])}", ylabel=f"true {_label(pair['y'])}")
            axes.set_facecolor("#eeeeee")  # bins without a curve
        what = f"RMSE of {'log₁₀ ' if name.startswith(LOG10) else ''}{_symbol(name)}"
        figure.colorbar(mesh, ax=row[-1], label=what + (" (decades)" if name.startswith(LOG10) else ""))
        row[0].set_title(what, loc="left", fontweight="bold")
    return figure


def _write_cells(axes: Axes, pair: Mapping[str, Any], values: Floats, top: float) -> None:
    x, y = ((np.array(pair[f"{k}_edges"])[1:] + np.array(pair[f"{k}_edges"])[:-1]) / 2 for k in "xy")
    for i, j in np.argwhere(np.isfinite(values)):
        at = float(natural(pair["x"], x[i])), float(natural(pair["y"], y[j]))
        colour = "white" if values[i, j] < 0.55 * top else "black"
        axes.text(*at, f"{values[i, j]:.2f}", ha="center", va="center", fontsize=7.5, color=colour)


def _error_share(names: Sequence[str], breakdown: Mapping[str, Any]) -> Figure:
    """Part of the squared error in each bin of each parameter, beside the part of the curves."""
    parameters = list(breakdown[names[0]]["by_parameter"])
    figure = _figure(3.4 * len(parameters), 3.0 * len(names))
    for row, name in zip(figure.subplots(len(names), len(parameters), squeeze=False, sharey="row"), names, strict=True):
        for axes, parameter in zip(row, parameters, strict=True):
            rows = breakdown[name]["by_parameter"][parameter]
            curves = np.array([r["curves"] for r in rows])
            x = np.arange(len(rows))
            share, even = np.array([100 * r["share"] for r in rows]), 100 * curves / max(curves.sum(), 1)
            axes.bar(x, share, 0.75, color=_BLUE, label="of the squared error")
            axes.hlines(even, x - 0.42, x + 0.42, color=_ORANGE, lw=2, label="of the curves")
            for at, value, above in zip(x, share, np.maximum(share, even), strict=True):
                axes.text(at, above + 2, f"{value:.0f}", ha="center", fontsize=9, color=_BLUE)
            axes.set_xticks(x, [_range(parameter, r["low"], r["high"]) for r in rows])
            axes.set(xlabel=f"true {_label(parameter)}", ylim=(0, 108))
        row[0].set_ylabel("part (%)")
        row[0].set_title(f"error of {'log₁₀ ' if name.startswith(LOG10) else ''}{_symbol(name)}", loc="left")
        row[-1].legend(loc="upper right")
    return figure


def _robustness(names: Sequence[str], robust: Mapping[str, Any]) -> Figure:
    """Median absolute error for each way of filming."""
    figure = _figure(4.2 * len(names) + 1.6, 3.9)
    rows = robust["rows"]
    y = np.arange(len(rows))[::-1]
    ways = {
        "network": (f"network alone ({robust['curves']} curves)", "o", _BLUE),
        "answer": (f"cavirheo infer ({robust['answers']} curves)", "D", _ORANGE),
    }
    panels = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for axes, name in zip(panels, names, strict=True):
        for way, (text, marker, colour) in ways.items():
            values = [r[way]["metrics"][name]["median_absolute_error"] if r[way]["metrics"] else np.nan for r in rows]
            axes.plot(values, y, marker, color=colour, ms=7, label=text)
        decades = name.startswith(LOG10)
        axes.set_xscale("log")
        axes.set_yticks(y, [r["recording"]["name"] for r in rows])
        axes.set_xlabel(
            f"median error of {'log₁₀ ' if decades else ''}{_symbol(name)}{' (decades)' if decades else ''}"
        )
        axes.grid(alpha=0.3, lw=0.5)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _row(figure: Figure, count: int) -> list[Axes]:
    return list(figure.subplots(1, count, squeeze=False)[0])


def _scale(axes: Axes, name: str, direction: str) -> None:
    if name.startswith(LOG10):
        axes.set(**{f"{direction}scale": "log"})


def _symbol(name: str) -> str:
    return SYMBOLS.get(natural_name(name), natural_name(name)).split(" = ")[0]


def _label(name: str) -> str:
    """Words, symbol and unit of a parameter's natural value."""
    words = natural_name(name).replace("_", " ")
    dimension = "" if about(name).unit == "1" else f" ({about(name).unit})"
    return f"{words} {SYMBOLS.get(natural_name(name), '')}{dimension}"


def _range(name: str, low: float, high: float) -> str:
    if name.startswith(LOG10):
        return f"$10^{{{low:g}}}$–$10^{{{high:g}}}$"
    return f"{low:g}–{high:g}"
