"""Type names of arrays, functions of logarithms of weights, and evenly spread points."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def relative_weights(log_weight: Floats) -> Floats:
    """Weights exp(log_weight), scaled so that the largest is 1."""
    return np.asarray(np.exp(log_weight - np.max(log_weight)))


def log_sum(log_value: ArrayLike, axis: int | None = None) -> Floats:
    """log of the sum of exp(log_value), along an axis or over the whole array; -inf where every term is zero. scipy's
    logsumexp takes ten times as long for the small arrays of a posterior, which needs thousands of these sums."""
    log_value = np.asarray(log_value, float)
    top = np.max(log_value, axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.sum(np.exp(log_value - top), axis=axis)) + np.squeeze(top, axis))


@cache
def even_points(count: int, d: int) -> Floats:
    """(count, d) points that fill the unit cube evenly: the additive recurrence of the generalised golden ratio
    (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences")."""
    ratio = 2.0
    for _ in range(50):
        ratio = (1.0 + ratio) ** (1.0 / (d + 1.0))
    return np.asarray((0.5 + np.outer(np.arange(1, count + 1), ratio ** -np.arange(1.0, d + 1.0))) % 1.0)
