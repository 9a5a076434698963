"""How good a trained network is. Torch is not needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import to_natural


def quantiles(errors: Mapping[str, float]) -> str:
    """Quantiles of the errors of an emulator as text."""
    words = {"median": "median", "p90": "90 % below", "p95": "95 % below", "p99": "99 % below"}
    return ", ".join(f"{words[name]} {value:.2%}" for name, value in errors.items())


def metrics(names: Sequence[str], truth: ArrayLike, predicted: ArrayLike) -> dict[str, dict[str, float]]:
    """Metrics of each output from truth and prediction (curves, outputs) in the prior's scale.

    Errors are in that scale (decades for log10 names); `r2_natural` and `median_relative_error` are of the
    natural values.

    Raises InputError: fewer than 2 curves, or shapes that do not fit.
    """
    truth, predicted = np.asarray(truth, dtype=float), np.asarray(predicted, dtype=float)
    if truth.shape != predicted.shape or truth.shape != (max(len(truth), 2), len(names)):
        message = f"need truth and prediction of 2 curves or more for {', '.join(names)}, got shapes {truth.shape} and "
        raise InputError(f"{message}{predicted.shape}", "metrics.shape")
    result = {}
    for name, t, p in zip(names, truth.T, predicted.T, strict=True):
        scales = {"prior": (t, p), "natural": (to_natural(name, t), to_natural(name, p))}
        result[name] = {key: float(formula(*scales[scale])) for key, (scale, formula) in METRICS.items()}
    return result


def _r2(truth: Floats, predicted: Floats) -> float:
    """Coefficient of determination: 1 - sum of squared errors / sum of squared deviations from the mean."""
    return float(1.0 - np.sum((predicted - truth) ** 2) / np.sum((truth - truth.mean()) ** 2))


# scale, and formula for truth t and prediction p
METRICS: dict[str, tuple[str, Callable[[Floats, Floats], Any]]] = {
    "r2": ("prior", _r2),
    "r2_natural": ("natural", _r2),
    "median_absolute_error": ("prior", lambda t, p: np.median(np.abs(p - t))),
    "median_relative_error": ("natural", lambda t, p: np.median(np.abs(p / t - 1.0))),
}
