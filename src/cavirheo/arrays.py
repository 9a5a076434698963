"""Type names of arrays, functions of logarithms of weights, and evenly spread points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FEWEST = 10  # draws that tell a covariance
LN10 = float(np.log(10.0))
NORMAL_90 = 1.6448536  # standard deviations of a normal from its median to the ends of its 90 % interval
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def relative_weights(log_weight: Floats) -> Floats:
    """Weights exp(log_weight), scaled so that the largest is 1."""
    return np.asarray(np.exp(log_weight - np.max(log_weight)))


def at_levels(weight: Floats, levels: Floats) -> NDArray[np.int64]:
    """Indices of the draws at these levels, from 0 to 1, of the sum of their weights (draws,)."""
    ends = np.cumsum(weight)
    return np.minimum(np.searchsorted(ends / ends[-1], levels), len(weight) - 1)


def relative_scatter(decades: float) -> float:
    """Standard deviation over the mean of a lognormal distribution with this standard deviation of log10."""
    return float(np.sqrt(np.expm1((decades * LN10) ** 2)))


def log_sum(log_value: ArrayLike, axis: int | None = None) -> Floats:
    """log of the sum of exp(log_value), along an axis or over the whole array; -inf where every term is zero. scipy's
    logsumexp takes ten times as long for the small arrays of a posterior, which needs thousands of these sums."""
    log_value = np.asarray(log_value, float)
    top = np.max(log_value, axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.sum(np.exp(log_value - top), axis=axis)) + np.squeeze(top, axis))


def weighted_covariance(first: Floats, second: Floats, log_weight: Floats) -> Floats | None:
    """(2, 2) covariance of two columns of draws (k,), by those that are finite; None if they are fewer than FEWEST."""
    good = np.isfinite(first) & np.isfinite(second) & np.isfinite(log_weight)
    if np.count_nonzero(good) < FEWEST:
        return None
    return np.asarray(np.cov(first[good], second[good], aweights=relative_weights(log_weight[good])))
