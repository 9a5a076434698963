"""What one shot says of the material: its likelihood, as a few Gaussians, from weighted draws of its posterior.

Draws of a posterior, each over the density of the prior that they were made with, are draws of the likelihood (Hogg,
Myers and Bovy 2010, doi:10.1088/0004-637X/725/2/2166). As a sum over single draws they fail where the material is
narrower than the gaps between draws: a few nearest draws then decide. A mixture of Gaussians, fitted to them by
expectation maximisation, keeps their mean and covariance, has no gaps, and its convolution with a Gaussian population
is closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from cavirheo.arrays import Floats

FEW = 30.0  # effective draws of a shot, below which its interval is rough
_MOST = 4  # Gaussians of a shot
_EACH = 20.0  # effective draws for each
_STEPS, _GAIN = 40, 5e-4  # of expectation maximisation: most steps, and gain of log likelihood per draw at its end
_THIN = 1e-4  # of the whole covariance, added to that of each Gaussian


class Likelihood(NamedTuple):
    """exp(log_size) times Gaussians with shares (k,) that sum to 1, means (k, d) and covariances (k, d, d); effective:
    what the draws are worth."""

    log_size: float
    share: Floats
    mean: Floats
    covariance: Floats
    effective: float


@dataclass(frozen=True, eq=False)
class Likelihoods:
    """Those of n shots, their m Gaussians one after the other: log_share (m,), mean (m, d), covariance (m, d, d), shot
    (m,) to which each belongs, first (n,) of each shot; log_size: sum of the shots'."""

    log_share: Floats
    mean: Floats
    covariance: Floats
    shot: np.ndarray
    first: np.ndarray
    log_size: float

    @classmethod
    def of(cls, shots: Sequence[Likelihood]) -> Likelihoods:
        counts = np.array([len(one.share) for one in shots])
        log_share, mean, covariance = (
            np.concatenate([getattr(one, name) for one in shots]) for name in ("share", "mean", "covariance")
        )
        first = np.cumsum(counts) - counts
        size = float(sum(one.log_size for one in shots))
        return cls(np.log(log_share), mean, covariance, np.repeat(np.arange(len(shots)), counts), first, size)

    @property
    def means(self) -> Floats:
        """(n, d) of the shots."""
        share = np.exp(self.log_share)[:, None]
        return np.asarray(np.add.reduceat(share * self.mean, self.first, axis=0))


def likelihood(theta: Floats, log_weight: Floats, log_prior: Floats) -> Likelihood | None:
    """Of draws theta (k, d) of a posterior with log weights and log density of their prior (k,); None where they are
    worth too little for a covariance."""
    log_weight = log_weight - logsumexp(log_weight) - log_prior
    size = float(logsumexp(log_weight))
    weight = np.exp(log_weight - size)
    effective, d = 1.0 / float(np.sum(weight**2)), theta.shape[1]
    if not effective > d + 3:
        return None
    mean = weight @ theta
    whole = (theta - mean).T * weight @ (theta - mean)
    if not np.all(np.diag(whole) > 0):
        return None
    if effective < FEW:  # the covariance is itself uncertain: that of Student's t, which predicts the next draw
        whole = whole * effective / (effective - 1.0) * (effective + 1.0) / (effective - d - 2.0)
        return Likelihood(size, np.ones(1), mean[None], whole[None], effective)
    best, height = (np.ones(1), mean[None], whole[None]), -np.inf
    for k in range(1, min(_MOST, int(effective / _EACH)) + 1):
        found, fitted = _mixture(theta, weight, whole, k)
        information = effective * fitted - 0.5 * np.log(effective) * (k * (d + 1) * (d + 2) / 2 - 1)
        if information <= height:
            break
        best, height = found, information
    return Likelihood(size, *best, effective)


def _mixture(theta: Floats, weight: Floats, whole: Floats, k: int) -> tuple[tuple[Floats, Floats, Floats], float]:
    """k Gaussians by expectation maximisation, begun with slices across the longest axis; mean log density."""
    d = theta.shape[1]
    along = theta @ np.linalg.eigh(whole)[1][:, -1]
    order = np.argsort(along, kind="stable")
    rank = np.empty(len(along))
    rank[order] = np.cumsum(weight[order]) - 0.5 * weight[order]
    resp = (np.minimum((rank * k).astype(int), k - 1) == np.arange(k)[:, None]).astype(float)
    before = -np.inf
    for _ in range(_STEPS if k > 1 else 1):
        mass = resp * weight
        share = np.maximum(np.sum(mass, axis=1), 1e-12)
        mean = mass @ theta / share[:, None]
        off = theta[None] - mean[:, None]
        covariance = np.einsum("kn,kni,knj->kij", mass, off, off) / share[:, None, None] + _THIN * whole
        share = share / np.sum(share)
        terms = [[covariance[:, i, j, None] for j in range(i + 1)] for i in range(d)]
        log_p = np.log(share)[:, None] + log_gaussian([off[:, :, i] for i in range(d)], terms)
        total = np.logaddexp.reduce(log_p, axis=0)
        resp = np.exp(log_p - total)
        fitted = float(weight @ total)
        if fitted - before < _GAIN:
            break
        before = fitted
    return (share, mean, covariance), fitted


def log_gaussian(off: Sequence[Floats], covariance: Sequence[Sequence[Floats]]) -> Floats:
    """Log density at d distances, each an array, with the lower triangle of the covariances: Cholesky, written out."""
    root: list[list[Floats]] = []
    whitened: list[Floats] = []
    log_p = np.full(off[0].shape, -0.5 * len(off) * np.log(2.0 * np.pi))
    for i, distance in enumerate(off):
        row: list[Floats] = []
        for j in range(i):
            row.append((covariance[i][j] - _dot(row, root[j][:j])) / root[j][j])
        row.append(np.sqrt(np.maximum(covariance[i][i] - _dot(row, row), 1e-300)))
        whitened.append((distance - _dot(row[:i], whitened)) / row[i])
        root.append(row)
        log_p = log_p - 0.5 * whitened[i] ** 2 - np.log(row[i])
    return log_p


def _dot(one: Sequence[Floats], other: Sequence[Floats]) -> Floats | float:
    return sum((a * b for a, b in zip(one, other, strict=True)), start=0.0)
