"""Figures of an evaluation: the paper's three, and where the error sits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.parameters import LOG10, about, natural, natural_name
from cavirheo.writing.document import Outputs
from cavirheo.writing.style import BLUE, INK, VERMILLION, available

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE: Any = {
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.titlesize": 10,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
}
_DOTS: Any = {"marker": ".", "ls": "", "ms": 3.5, "mew": 0, "color": BLUE}
NAMES = ("loss.png", "predicted.png", "error.png", "error_map.png", "error_share.png", "robustness.png")
_LARGE_BIN = 10  # curves below which a running median is not drawn


def draw(
    folder: Outputs, card: Mapping[str, Any], result: Mapping[str, Any], truth: Floats, predicted: Floats
) -> list[str]:
    """Draw an `evaluate` result into the folder; the names of the files drawn.

    loss.png (from the history on the model's card), predicted.png, error.png, error_map.png, error_share.png, and
    robustness.png where that was asked for. truth and predicted: (curves, outputs) in the prior's scale.

    Raises InputError if matplotlib is not installed.
    """
    require(available(), "the figures need matplotlib: pip install 'cavirheo[plot]'", "figures.matplotlib")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    where, robust = result["breakdown"], result["robustness"]
    outputs = list(zip(where, truth.T, predicted.T, strict=True))
    scores, loss = result["metrics"], [(card["history"], card["training"])] if card.get("history") else []
    # who draws a panel, its size in inches, and what is drawn in the panels of each row
    pages: dict[str, tuple[Any, float, float, list[list[Any]]]] = {
        "loss.png": (_loss, 6.0, 3.8, [loss]),
        "predicted.png": (_predicted, 4.3, 4.4, [[(*panel, scores[panel[0]]["r2"]) for panel in outputs]]),
        "error.png": (_error, 4.8, 4.0, [outputs]),
        "error_map.png": (_error_map, 4.3, 3.7, [_row(name, where[name]["by_pair"]) for name in where]),
        "error_share.png": (_error_share, 3.4, 3.0, [_row(name, where[name]["by_parameter"]) for name in where]),
        "robustness.png": (_robustness, 5.0, 3.9, [_row(robust, where) if robust else []]),
    }
    pages_drawn = {file: page for file, page in pages.items() if any(page[-1])}
    with rc_context(_STYLE):
        for file, (paint, width, height, panels) in pages_drawn.items():
            rows, columns = len(panels), len(panels[0])
            figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
            axes = figure.subplots(rows, columns, squeeze=False)
            for panel, arguments in zip(axes.flat, chain(*panels), strict=True):
                paint(panel, *arguments)
            folder.write(file, lambda path, drawing: drawing.savefig(path, dpi=160), figure)
    return list(pages_drawn)


def _row(what: Any, items: Any) -> list[Any]:
    return [(what, items, k) for k in range(len(items))]


def _loss(axes: Axes, history: Mapping[str, Sequence[float]], training: Mapping[str, Any]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    best, epochs = training["best_epoch"], np.arange(1, len(history["train"]) + 1)
    lowest = history["validation"][best - 1]
    dropped = f"dropout to epoch {last}" if (last := training.get("dropout_epochs")) else "with dropout"
    axes.semilogy(epochs, history["train"], color=BLUE, lw=1.6, label=f"training ({dropped})")
    axes.semilogy(epochs, history["validation"], color=VERMILLION, lw=1.2, label="validation")
    axes.plot(best, lowest, "o", ms=7, mfc="none", mec=INK, label=f"kept: epoch {best}, {lowest:.4f}")
    axes.set(xlabel="epoch", ylabel="mean squared error\n(of outputs over the prior's std. deviation)")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=0.25, which="both", lw=0.5)
    axes.legend()


def _predicted(axes: Axes, name: str, truth: Floats, predicted: Floats, r2: float) -> None:
    t, p = natural(name, truth), natural(name, predicted)
    ends = [min(t.min(), p.min()), max(t.max(), p.max())]
    axes.plot(t, p, alpha=0.5, **_DOTS)
    axes.plot(ends, ends, color=INK, lw=1, label="predicted = true", zorder=1)
    _over(axes, x=name, y=name)
    axes.set(xlim=axes.get_ylim(), ylabel=f"predicted {_label(name)}", box_aspect=1)
    axes.set_title(f"R² = {r2:.4f}" + (" of the logarithm" if name.startswith(LOG10) else ""))
    axes.legend(loc="upper left")


def _error(axes: Axes, name: str, truth: Floats, predicted: Floats) -> None:
    t, error = natural(name, truth), 100 * (natural(name, predicted) / natural(name, truth) - 1)
    axes.plot(t, error, alpha=0.35, **_DOTS)
    axes.axhline(0, color=INK, lw=1)
    edges = np.linspace(truth.min(), truth.max(), 13)
    place = np.clip(np.searchsorted(edges, truth, side="right") - 1, 0, len(edges) - 2)
    filled = [k for k in range(len(edges) - 1) if np.count_nonzero(place == k) >= _LARGE_BIN]
    if filled:
        low, middle, high = np.transpose([np.percentile(error[place == k], (16, 50, 84)) for k in filled])
        centre = natural(name, _middles(edges)[filled])
        axes.fill_between(centre, low, high, color=VERMILLION, alpha=0.25, lw=0, label="middle 68 %")
        axes.plot(centre, middle, color=VERMILLION, lw=1.8, label="median")
        axes.legend(loc="upper right", ncols=2)
    _over(axes, x=name)
    axes.set_yscale("symlog", linthresh=10)
    ticks = [s * v for s in (-1, 1) for v in (5, 10, 20, 50, 100, 200, 500, 1000) if v <= 1.3 * abs(error).max()]
    axes.set_yticks([0, *ticks], [f"{v:+g}" if v else "0" for v in (0, *ticks)])
    axes.minorticks_off()
    axes.set(ylim=(1.25 * min(error.min(), -10), 2.2 * max(error.max(), 10)))
    axes.set_ylabel(f"relative error of {about(name).symbol} (%)")


def _error_map(axes: Axes, name: str, pairs: Sequence[Mapping[str, Any]], k: int) -> None:
    """RMSE over pair k of the parameters; one colour scale for all pairs."""
    top = max(np.nanmax(np.array(pair["rmse"], dtype=float)) for pair in pairs)
    pair, label = pairs[k], f"RMSE of {_error_of(name)}"
    values, edges = np.array(pair["rmse"], dtype=float), {axis: np.array(pair[f"{axis}_edges"]) for axis in "xy"}
    x, y = (natural(pair[axis], ends) for axis, ends in edges.items())
    mesh = axes.pcolormesh(x, y, values.T, cmap="cividis", vmin=0, vmax=top, edgecolors="white", linewidth=0.4)
    x, y = (natural(pair[axis], _middles(ends)) for axis, ends in edges.items())
    for i, j in zip(*np.nonzero(np.isfinite(values)), strict=True):
        how: Any = {"color": "white" if values[i, j] < 0.55 * top else "black", "fontsize": 7.5}
        axes.text(float(x[i]), float(y[j]), f"{values[i, j]:.2f}", ha="center", va="center", **how)
    _over(axes, x=pair["x"], y=pair["y"])
    axes.set_facecolor("#eeeeee")  # bins without a curve
    if k == 0:
        axes.set_title(label, loc="left", fontweight="bold")
    if k == len(pairs) - 1:
        axes.figure.colorbar(mesh, ax=axes, label=label)


def _error_share(axes: Axes, name: str, parameters: Mapping[str, list[dict[str, Any]]], k: int) -> None:
    """Part of the squared error in each bin of parameter k, beside the part of the curves."""
    parameter, rows = list(parameters.items())[k]
    curves, x = np.array([row["curves"] for row in rows]), np.arange(float(len(rows)))
    share, even = np.array([100 * row["share"] for row in rows]), 100 * curves / max(curves.sum(), 1)
    axes.bar(x, share, 0.75, color=BLUE, label="of the squared error")
    axes.hlines(even, x - 0.42, x + 0.42, color=VERMILLION, lw=2, label="of the curves")
    for at, value, above in zip(x, share, np.maximum(share, even), strict=True):
        axes.text(at, above + 2, f"{value:.0f}", ha="center", fontsize=9, color=BLUE)
    ends = "$10^{{{low:g}}}$–$10^{{{high:g}}}$" if parameter.startswith(LOG10) else "{low:g}–{high:g}"
    axes.set_xticks(x, [ends.format(**row) for row in rows])
    axes.set(xlabel=f"true {_label(parameter)}", ylim=(0, 108))
    if k == 0:
        axes.set_ylabel("part (%)")
        axes.set_title(f"error of {_error_of(name)}", loc="left")
    if k == len(parameters) - 1:
        axes.legend(loc="upper right")


def _robustness(axes: Axes, robust: Mapping[str, Any], names: Mapping[str, Any], k: int) -> None:
    """Median absolute error of output k for each way of filming."""
    name, rows, y = list(names)[k], robust["rows"], np.arange(len(robust["rows"]))[::-1]
    for way, marker, colour, words in (
        ("network", "o", BLUE, f"network alone ({robust['curves']} curves)"),
        ("answer", "D", VERMILLION, f"cavirheo infer ({robust['answers']} curves)"),
    ):
        scores = [(row[way]["metrics"] or {}).get(name, {}) for row in rows]
        values = [numbers.get("median_absolute_error", np.nan) for numbers in scores]
        axes.plot(values, y, marker, color=colour, ms=7, label=words)
    axes.set(xscale="log", xlabel=f"median error of {_error_of(name)}", ylim=(-0.5, len(rows) - 0.5))
    axes.set_yticks(y, [row["recording"]["name"] if k == 0 else "" for row in rows])
    axes.grid(alpha=0.3, lw=0.5)
    if k == 0:
        axes.figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=2)


def _over(axes: Axes, **names: str) -> None:
    """The true values of a parameter on "x" or "y": label, and logarithmic where it is."""
    for axis, name in names.items():
        scale = "log" if name.startswith(LOG10) else "linear"
        axes.set(**{f"{axis}label": f"true {_label(name)}", f"{axis}scale": scale})


def _middles(edges: Floats) -> Floats:
    return (edges[1:] + edges[:-1]) / 2


def _error_of(name: str) -> str:
    return f"log₁₀ {about(name).symbol} (decades)" if name.startswith(LOG10) else about(name).symbol


def _label(name: str) -> str:
    """Words, symbol and unit of a parameter's natural value."""
    unit = "" if about(name).unit == "1" else f" ({about(name).unit})"
    return f"{natural_name(name).replace('_', ' ')} {about(name).symbol}{unit}"
