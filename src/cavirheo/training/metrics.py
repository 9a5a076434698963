"""How far predictions are from the truth, output by output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.errors import InputError
from cavirheo.parameters import LOG10


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
            f"got shapes {truth.shape} and {predicted.shape}"
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


def natural(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Natural values of a parameter from those in the prior's scale."""
    values = np.asarray(values, dtype=float)
    return np.asarray(10.0**values if name.startswith(LOG10) else values)
