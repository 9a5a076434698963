"""Figures of an evaluation: the paper's three, and where the error sits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import LOG10, about, natural, natural_name
from cavirheo.writing.style import BLUE, INK, VERMILLION, available

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.titlesize": 10,
    "axes.labelsize": 10,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}
_DOTS: Any = {"marker": ".", "ls": "", "ms": 3.5, "mew": 0, "color": BLUE}
_LARGE_BIN = 10  # curves below which a running median is not drawn


def draw(
    folder: Path, card: Mapping[str, Any], result: Mapping[str, Any], truth: Floats, predicted: Floats
) -> list[str]:
    """Draw an `evaluate` result into the folder; the names of the files drawn.

    loss.png (from the history on the model's card), predicted.png, error.png, error_map.png, error_share.png, and
    robustness.png where that was asked for. truth and predicted: (curves, outputs) in the prior's scale.

    Raises InputError if matplotlib is not installed.
    """
    if not available():
        raise InputError("the figures need matplotlib: pip install 'cavirheo[plot]'", "figures.matplotlib")
    from matplotlib import rc_context

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

    figure, ((axes,),) = _panels(6.0, 3.8)
    history, best = card["history"], card["training"]["best_epoch"]
    epochs, lowest = np.arange(1, len(history["train"]) + 1), history["validation"][best - 1]
    dropped = f"dropout to epoch {last}" if (last := card["training"].get("dropout_epochs")) else "with dropout"
    axes.semilogy(epochs, history["train"], color=BLUE, lw=1.6, label=f"training ({dropped})")
    axes.semilogy(epochs, history["validation"], color=VERMILLION, lw=1.2, label="validation")
    axes.plot(best, lowest, "o", ms=7, mfc="none", mec=INK, label=f"kept: epoch {best}, {lowest:.4f}")
    axes.set(xlabel="epoch", ylabel="mean squared error\n(of outputs over the prior's std. deviation)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both", lw=0.5)
    axes.legend()
    return figure


def _predicted(names: Sequence[str], truth: Floats, predicted: Floats, metrics: Mapping[str, Any]) -> Figure:
    figure, (row,) = _panels(4.3 * len(names), 4.4, columns=len(names))
    for axes, name, t, p in zip(row, names, truth.T, predicted.T, strict=True):
        t, p = natural(name, t), natural(name, p)
        ends = np.array([min(t.min(), p.min()), max(t.max(), p.max())])
        axes.plot(t, p, alpha=0.5, **_DOTS)
        axes.plot(ends, ends, color=INK, lw=1, label="predicted = true", zorder=1)
        _scale(axes, x=name, y=name)
        axes.set_xlim(axes.get_ylim())
        axes.set(xlabel=f"true {_label(name)}", ylabel=f"predicted {_label(name)}", box_aspect=1)
        axes.set_title(f"R² = {metrics[name]['r2']:.4f}" + (" of the logarithm" if name.startswith(LOG10) else ""))
        axes.legend(loc="upper left")
    return figure


def _error(names: Sequence[str], truth: Floats, predicted: Floats) -> Figure:
    figure, (row,) = _panels(4.8 * len(names), 4.0, columns=len(names))
    for axes, name, t, p in zip(row, names, truth.T, predicted.T, strict=True):
        error = 100 * (natural(name, p) / natural(name, t) - 1)
        axes.plot(natural(name, t), error, alpha=0.35, **_DOTS)
        axes.axhline(0, color=INK, lw=1)
        edges = np.linspace(t.min(), t.max(), 13)
        place = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(edges) - 2)
        kept = [k for k in range(len(edges) - 1) if np.count_nonzero(place == k) >= _LARGE_BIN]
        if kept:
            low, middle, high = np.transpose([np.percentile(error[place == k], (16, 50, 84)) for k in kept])
            centre = natural(name, ((edges[:-1] + edges[1:]) / 2)[kept])
            axes.fill_between(centre, low, high, color=VERMILLION, alpha=0.25, lw=0, label="middle 68 %")
            axes.plot(centre, middle, color=VERMILLION, lw=1.8, label="median")
            axes.legend(loc="upper right", ncols=2)
        _scale(axes, x=name)
        axes.set_yscale("symlog", linthresh=10)
        ticks = [s * v for s in (-1, 1) for v in (5, 10, 20, 50, 100, 200, 500, 1000) if v <= 1.3 * abs(error).max()]
        axes.set_yticks([0, *ticks], [f"{v:+g}" if v else "0" for v in (0, *ticks)], minor=False)
        axes.minorticks_off()
        axes.set_ylim(1.25 * min(error.min(), -10), 2.2 * max(error.max(), 10))
        axes.set(xlabel=f"true {_label(name)}", ylabel=f"relative error of {about(name).symbol} (%)")
    return figure


def _error_map(names: Sequence[str], breakdown: Mapping[str, Any]) -> Figure:
    """RMSE over each pair of parameters, one row an output, one colour scale a row."""
    pairs = len(breakdown[names[0]]["by_pair"])
    figure, panels = _panels(4.1 * pairs + 0.7, 3.7 * len(names), len(names), pairs)
    for row, name in zip(panels, names, strict=True):
        maps = [np.array(pair["rmse"], dtype=float) for pair in breakdown[name]["by_pair"]]
        top = max(np.nanmax(values) for values in maps)
        for axes, pair, values in zip(row, breakdown[name]["by_pair"], maps, strict=True):
            edges = [np.array(pair[f"{k}_edges"]) for k in "xy"]
            x, y = (natural(pair[k], ends) for k, ends in zip("xy", edges, strict=True))
            mesh = axes.pcolormesh(x, y, values.T, cmap="cividis", vmin=0, vmax=top, edgecolors="white", linewidth=0.4)
            x, y = (natural(pair[k], (e[1:] + e[:-1]) / 2) for k, e in zip("xy", edges, strict=True))
            for i, j in np.argwhere(np.isfinite(values)):
                how: Any = {"color": "white" if values[i, j] < 0.55 * top else "black", "fontsize": 7.5}
                axes.text(x[i], y[j], f"{values[i, j]:.2f}", ha="center", va="center", **how)
            _scale(axes, x=pair["x"], y=pair["y"])
            axes.set(xlabel=f"true {_label(pair['x'])}", ylabel=f"true {_label(pair['y'])}")
            axes.set_facecolor("#eeeeee")  # bins without a curve
        what = f"RMSE of {_error_of(name)}"
        figure.colorbar(mesh, ax=row[-1], label=what)
        row[0].set_title(what, loc="left", fontweight="bold")
    return figure


def _error_share(names: Sequence[str], breakdown: Mapping[str, Any]) -> Figure:
    """Part of the squared error in each bin of each parameter, beside the part of the curves."""
    parameters = list(breakdown[names[0]]["by_parameter"])
    figure, panels = _panels(3.4 * len(parameters), 3.0 * len(names), len(names), len(parameters), sharey="row")
    for row, name in zip(panels, names, strict=True):
        for axes, parameter in zip(row, parameters, strict=True):
            rows = breakdown[name]["by_parameter"][parameter]
            curves, x = np.array([r["curves"] for r in rows]), np.arange(len(rows))
            share, even = np.array([100 * r["share"] for r in rows]), 100 * curves / max(curves.sum(), 1)
            axes.bar(x, share, 0.75, color=BLUE, label="of the squared error")
            axes.hlines(even, x - 0.42, x + 0.42, color=VERMILLION, lw=2, label="of the curves")
            for at, value, above in zip(x, share, np.maximum(share, even), strict=True):
                axes.text(at, above + 2, f"{value:.0f}", ha="center", fontsize=9, color=BLUE)
            ends = "$10^{{{low:g}}}$–$10^{{{high:g}}}$" if parameter.startswith(LOG10) else "{low:g}–{high:g}"
            axes.set_xticks(x, [ends.format(**r) for r in rows])
            axes.set(xlabel=f"true {_label(parameter)}", ylim=(0, 108))
        row[0].set_ylabel("part (%)")
        row[0].set_title(f"error of {_error_of(name)}", loc="left")
        row[-1].legend(loc="upper right")
    return figure


def _robustness(names: Sequence[str], robust: Mapping[str, Any]) -> Figure:
    """Median absolute error for each way of filming."""
    figure, (panels,) = _panels(4.2 * len(names) + 1.6, 3.9, columns=len(names), sharey=True)
    rows = robust["rows"]
    y = np.arange(len(rows))[::-1]
    ways = {
        "network": (f"network alone ({robust['curves']} curves)", "o", BLUE),
        "answer": (f"cavirheo infer ({robust['answers']} curves)", "D", VERMILLION),
    }
    for axes, name in zip(panels, names, strict=True):
        for way, (text, marker, colour) in ways.items():
            values = [r[way]["metrics"][name]["median_absolute_error"] if r[way]["metrics"] else np.nan for r in rows]
            axes.plot(values, y, marker, color=colour, ms=7, label=text)
        axes.set_xscale("log")
        axes.set_yticks(y, [r["recording"]["name"] for r in rows])
        axes.set_xlabel(f"median error of {_error_of(name)}")
        axes.grid(alpha=0.3, lw=0.5)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def _panels(width: float, height: float, rows: int = 1, columns: int = 1, **how: Any) -> tuple[Figure, Any]:
    """A figure and its axes (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **how)


def _scale(axes: Axes, **names: str) -> None:
    """Logarithmic where the parameter on "x" or "y" is."""
    axes.set(**{f"{direction}scale": "log" for direction, name in names.items() if name.startswith(LOG10)})


def _error_of(name: str) -> str:
    return f"log₁₀ {about(name).symbol} (decades)" if name.startswith(LOG10) else about(name).symbol


def _label(name: str) -> str:
    """Words, symbol and unit of a parameter's natural value."""
    unit = "" if about(name).unit == "1" else f" ({about(name).unit})"
    return f"{natural_name(name).replace('_', ' ')} {about(name).symbol}{unit}"
