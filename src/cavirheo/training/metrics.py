"""How far predictions are from the truth: in numbers, and where in the prior the error sits."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError
from cavirheo.parameters import LOG10, natural
from cavirheo.prior import Prior

BINS = 4  # of a parameter whose prior is not logarithmic; the others are cut by decades, or by halves of them in pairs


def r2(truth: ArrayLike, predicted: ArrayLike) -> float:
    """Coefficient of determination, 1 - sum of squared errors over that of the mean as predictor."""
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.

    Raises:
        InputError: fewer than 2 curves, or shapes that do not fit.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    if truth.shape != predicted.shape or truth.ndim != 2 or truth.shape[1] != len(names) or len(truth) < 2:
        raise InputError(
            f"need truth and prediction of at least 2 curves for {', '.join(names)}, "
            f"got shapes {truth.shape} and {predicted.shape}",
            "metrics.shape",
        )
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        t_natural, p_natural = natural(name, t), natural(name, p)
        result[name] = {
            "r2": r2(t, p),
            "r2_natural": r2(t_natural, p_natural),
            "median_absolute_error": float(np.median(np.abs(p - t))),
            "p90_absolute_error": float(np.quantile(np.abs(p - t), 0.9)),
            "rmse": float(np.sqrt(np.mean((p - t) ** 2))),
            "bias": float(np.mean(p - t)),
            "median_relative_error": float(np.median(np.abs(p_natural / t_natural - 1.0))),
        }
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
        by_parameter = {
            name: [
                {
                    "low": float(low),
                    "high": float(high),
                    "curves": int(inside.sum()),
                    "bias": float(e[inside].mean()) if inside.any() else None,
                    "rmse": _rms(e[inside]),
                    "share": float(np.sum(e[inside] ** 2) / total),
                }
                for (low, high), inside in zip(pairwise(edges), masks, strict=True)
            ]
            for name, (edges, masks) in zip(prior.names, coarse, strict=True)
        }
        by_pair = []
        for i, j in combinations(range(len(prior.names)), 2):
            (x_edges, x_masks), (y_edges, y_masks) = fine[i], fine[j]
            cells = [[e[x & y] for y in y_masks] for x in x_masks]
            by_pair.append(
                {
                    "x": prior.names[i],
                    "y": prior.names[j],
                    "x_edges": x_edges.tolist(),
                    "y_edges": y_edges.tolist(),
                    "curves": [[len(cell) for cell in row] for row in cells],
                    "rmse": [[_rms(cell) for cell in row] for row in cells],
                }
            )
        result[output] = {"by_parameter": by_parameter, "by_pair": by_pair}
    return result


def _bins(prior: Prior, theta: Floats, width: float) -> list[tuple[Floats, list[Bools]]]:
    """For each parameter the edges of its bins, and which curves lie in each; the ends of the prior belong to the
    outermost."""
    found = []
    for name, low, high, values in zip(prior.names, prior.low, prior.high, theta.T, strict=True):
        count = max(1, round((high - low) / width)) if name.startswith(LOG10) else BINS
        edges = np.linspace(low, high, count + 1)
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
        found.append((edges, [place == k for k in range(count)]))
    return found


def _rms(error: Floats) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None
