"""Figures of an evaluation: the losses of the training, and predicted over true values, as the paper has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.parameters import LOG10, natural, natural_name, parameter_of
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
NAMES = ("loss.png", "predicted.png")


def draw(
    folder: Outputs, card: Mapping[str, Any], result: Mapping[str, Any], truth: Floats, predicted: Floats
) -> list[str]:
    """Draw an `evaluate` result into the folder; the names of the files drawn.

    loss.png (from the history on the model's card, if it has one) and predicted.png. truth and predicted:
    (curves, outputs) in the prior's scale.

    Raises InputError if matplotlib is not installed.
    """
    require(available(), "the figures need matplotlib: pip install 'cavirheo[plot]'", "figures.matplotlib")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    scores = result["metrics"]
    names = NAMES if card.get("history") else NAMES[1:]
    with rc_context(_STYLE):
        for name in names:
            columns = 1 if name == "loss.png" else len(scores)
            figure = Figure(figsize=(6.0, 3.8) if name == "loss.png" else (4.3 * columns, 4.4), layout="constrained")
            axes = figure.subplots(1, columns, squeeze=False)[0]
            if name == "loss.png":
                _loss(axes[0], card["history"], card["training"])
            else:
                for panel, output, t, p in zip(axes, scores, truth.T, predicted.T, strict=True):
                    _predicted(panel, output, t, p, scores[output]["r2"])
            folder.write(name, lambda path, drawing: drawing.savefig(path, dpi=160), figure)
    return list(names)


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
    axes.plot(t, p, marker=".", ls="", ms=3.5, mew=0, color=BLUE, alpha=0.5)
    axes.plot(ends, ends, color=INK, lw=1, label="predicted = true", zorder=1)
    scale = "log" if name.startswith(LOG10) else "linear"
    axes.set(xlabel=f"true {_label(name)}", ylabel=f"predicted {_label(name)}", xscale=scale, yscale=scale)
    axes.set(xlim=axes.get_ylim(), box_aspect=1)
    axes.set_title(f"R² = {r2:.4f}" + (" of the logarithm" if name.startswith(LOG10) else ""))
    axes.legend(loc="upper left")


def _label(name: str) -> str:
    """Words, symbol and unit of a parameter's natural value."""
    unit = "" if parameter_of(name).unit == "1" else f" ({parameter_of(name).unit})"
    return f"{natural_name(name).replace('_', ' ')} {parameter_of(name).symbol}{unit}"
