"""Where in the prior the error of a model sits: root mean square and share of the squared error by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cavirheo.parameters import LOG10
from cavirheo.prior import Prior

Floats = NDArray[np.float64]
BINS = 4  # of a parameter whose prior is not logarithmic; the others are cut by decades, or by halves of them in pairs


def breakdown(outputs: Sequence[str], prior: Prior, theta: Floats, error: Floats) -> dict[str, Any]:
    """The errors (curves, outputs) of predictions over the true theta (curves, parameters), in the prior's scale.

    Returns:
        For each output {"by_parameter": {parameter: rows}, "by_pair": maps}. A row is a bin of the truth: {"low",
        "high", "curves", "bias", "rmse", "share"}, the last being its part of all squared error of the output. A map
        is a pair of parameters: {"x", "y", "x_edges", "y_edges", "curves", "rmse"}, tables [x][y]. Numbers of an empty
        bin are None.
    """
    coarse = [_edges(*ends, width=1.0) for ends in zip(prior.names, prior.low, prior.high, strict=True)]
    fine = [_edges(*ends, width=0.5) for ends in zip(prior.names, prior.low, prior.high, strict=True)]
    result = {}
    for output, e in zip(outputs, error.T, strict=True):
        by_parameter = {
            name: [
                {
                    "low": float(low),
                    "high": float(high),
                    "curves": int(inside.sum()),
                    "bias": float(e[inside].mean()) if inside.any() else None,
                    "rmse": _rms(e[inside]),
                    "share": float(np.sum(e[inside] ** 2) / max(np.sum(e**2), np.finfo(float).tiny)),
                }
                for low, high, inside in _bins(edges, values)
            ]
            for name, edges, values in zip(prior.names, coarse, theta.T, strict=True)
        }
        maps = []
        for i, j in combinations(range(len(prior.names)), 2):
            cells = [[e[x & y] for _, _, y in _bins(fine[j], theta[:, j])] for _, _, x in _bins(fine[i], theta[:, i])]
            maps.append(
                {
                    "x": prior.names[i],
                    "y": prior.names[j],
                    "x_edges": fine[i].tolist(),
                    "y_edges": fine[j].tolist(),
                    "curves": [[len(cell) for cell in row] for row in cells],
                    "rmse": [[_rms(cell) for cell in row] for row in cells],
                }
            )
        result[output] = {"by_parameter": by_parameter, "by_pair": maps}
    return result


def _edges(name: str, low: float, high: float, width: float) -> Floats:
    count = max(1, round((high - low) / width)) if name.startswith(LOG10) else BINS
    return np.linspace(low, high, count + 1)


def _bins(edges: Floats, values: Floats) -> list[tuple[float, float, NDArray[np.bool_]]]:
    """Bins with the values inside, (curves,); the ends of the prior belong to the outermost."""
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return [(low, high, place == k) for k, (low, high) in enumerate(pairwise(edges))]


def _rms(error: Floats) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None
