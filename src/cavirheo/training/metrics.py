"""How far predictions are from the truth: in numbers, and where in the prior the error sits."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import require
from cavirheo.parameters import LOG10, natural
from cavirheo.prior import Prior

BINS = 4  # of a parameter whose prior is not logarithmic; the others are cut by decades, or by halves of them in pairs


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.

    Raises:
        InputError: fewer than 2 curves, or shapes that do not fit.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    fine = truth.shape == predicted.shape == (max(len(truth), 2), len(names))
    shapes = f"got shapes {truth.shape} and {predicted.shape}"
    require(fine, f"need truth and prediction of 2 curves or more for {', '.join(names)}, {shapes}", "metrics.shape")
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        t_natural, p_natural = natural(name, t), natural(name, p)
        values = {
            "r2": _r2(t, p),
            "r2_natural": _r2(t_natural, p_natural),
            "median_absolute_error": np.median(np.abs(p - t)),
            "p90_absolute_error": np.quantile(np.abs(p - t), 0.9),
            "rmse": np.sqrt(np.mean((p - t) ** 2)),
            "bias": np.mean(p - t),
            "median_relative_error": np.median(np.abs(p_natural / t_natural - 1.0)),
        }
        result[name] = {key: float(value) for key, value in values.items()}
    return result


def breakdown(outputs: Sequence[str], prior: Prior, theta: Floats, error: Floats) -> dict[str, Any]:
    """The errors (curves, outputs) of predictions over the true theta (curves, parameters), in the prior's scale.

    Returns:
        For each output {"by_parameter": {parameter: rows}, "by_pair": maps}. A row is a bin of the truth: {"low",
        "high", "curves", "bias", "rmse", "share"}, the last being its part of all squared error of the output. A map
        is a pair of parameters: {"x", "y", "x_edges", "y_edges", "curves", "rmse"}, tables [x][y]. Numbers of an empty
        bin are None.
    """
    coarse, fine = (_bins(prior, theta, width) for width in (1.0, 0.5))
    result = {}
    for output, e in zip(outputs, error.T, strict=True):
        total = max(np.sum(e**2), np.finfo(float).tiny)
        rows = {
            name: [_row(e[inside], *ends, total) for ends, inside in zip(pairwise(edges), masks, strict=True)]
            for name, (edges, masks) in coarse.items()
        }
        maps = []
        for (x, (x_edges, x_masks)), (y, (y_edges, y_masks)) in combinations(fine.items(), 2):
            errors = [[e[i & j] for j in y_masks] for i in x_masks]
            pair: dict[str, Any] = {"x": x, "y": y, "x_edges": x_edges, "y_edges": y_edges}
            pair["curves"] = [[len(part) for part in row] for row in errors]
            maps.append(pair | {"rmse": [[_rms(part) for part in row] for row in errors]})
        result[output] = {"by_parameter": rows, "by_pair": maps}
    return result


def _bins(prior: Prior, theta: Floats, width: float) -> dict[str, tuple[list[float], list[Bools]]]:
    """Of each parameter the edges of its bins, and which curves lie in each; the outermost include their ends."""
    bins = {}
    for name, low, high, values in zip(prior.names, prior.low, prior.high, theta.T, strict=True):
        count = max(1, round((high - low) / width)) if name.startswith(LOG10) else BINS
        edges = np.linspace(low, high, count + 1)
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
        bins[name] = edges.tolist(), [place == k for k in range(count)]
    return bins


def _row(error: Floats, low: float, high: float, total: float) -> dict[str, Any]:
    bias = float(error.mean()) if len(error) else None
    row: dict[str, Any] = {"low": low, "high": high, "curves": len(error), "bias": bias, "rmse": _rms(error)}
    return row | {"share": float(np.sum(error**2) / total)}


def _rms(error: Floats) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def _r2(truth: Floats, predicted: Floats) -> float:
    """Coefficient of determination: 1 - sum of squared errors over that of the mean as predictor."""
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))
