"""The likelihood of a shot from the draws of its posterior.

Draws, weighted by the inverse density of the prior that they were made with, are draws of the likelihood (Hogg, Myers
and Bovy 2010, doi:10.1088/0004-637X/725/2/2166). POINTS of them, equally likely and each widened to a normal
distribution, give a smooth likelihood whose integral over a normal population has a closed form, even if the population
is narrower than the gaps between draws. Points and widths together have the mean and the covariance of the draws.

A shot that only bounds a parameter has draws up to the end of its prior, and would have draws beyond it if the prior
were wider: points near an end are mirrored at it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cavirheo.arrays import Floats, at_levels, log_sum
from cavirheo.prior import Prior

POINTS = 100  # of a shot
ROUNDING = 1e-9  # share of variances that is added, so that covariances are positive
MIRRORED = 0.25  # part of a prior's range from an end in which points are mirrored at it


@dataclass(frozen=True, eq=False)
class Likelihood:
    """The likelihood of a shot: exp(log_size) times the sum of normal distributions about points, over POINTS.

    Attributes:
        points: (m, d) POINTS and their mirror images.
        kernel: (d, d) covariance of the normal distribution about each of them.
        mean, covariance: (d,) and (d, d) of the draws.
        low, high: (d,) ends of the prior.
        log_size: log of the likelihood's integral over this range.
        effective: number of effective draws.
    """

    points: Floats
    kernel: Floats
    mean: Floats
    covariance: Floats
    low: Floats
    high: Floats
    log_size: float
    effective: float

    def log_integral(self, centre: Floats, variance: Floats) -> Floats:
        """Log (k,) of the likelihood's integral over normal populations with centre and variances (k, d), but for
        `log_size`."""
        points, centre = self.points - self.mean, centre - self.mean
        precision = _inverse(self.kernel, variance)
        # (point - centre) precision (point - centre), multiplied out: two matrix products for all points
        first, second = np.triu_indices(len(self.mean))
        twice = np.where(first == second, 1.0, 2.0)
        squares = precision[:, first, second] @ (twice * points[:, first] * points[:, second]).T
        along = np.einsum("kij,kj->ki", precision, centre)
        log_p = log_sum(along @ points.T - 0.5 * squares, axis=1) - 0.5 * np.sum(along * centre, axis=1)
        return np.asarray(log_p + _log_height(precision) - np.log(POINTS))

    def log_integral_of_outliers(self, centre: Floats, variance: Floats) -> Floats:
        """The same over wide populations, for which the likelihood is a single normal distribution."""
        precision, off = _inverse(self.covariance, variance), centre - self.mean
        return np.asarray(_log_height(precision) - 0.5 * np.einsum("ki,kij,kj->k", off, precision, off))


def _inverse(covariance: Floats, variance: Floats) -> Floats:
    """(k, d, d) inverse of a covariance (d, d) to whose diagonal variances (k, d) are added."""
    return np.asarray(np.linalg.inv(covariance + variance[:, :, None] * np.eye(len(covariance))))


def _log_height(precision: Floats) -> Floats:
    """Log (k,) of the density of normal distributions with inverse covariances (k, d, d) at their centres."""
    return np.asarray(0.5 * (np.linalg.slogdet(precision)[1] - precision.shape[1] * np.log(2.0 * np.pi)))


def likelihood(theta: Floats, log_weight: Floats | None, prior: Prior) -> Likelihood | None:
    """The likelihood from draws theta (k, d) of a posterior with log weights (k,), made with this prior; None if too
    few draws are effective."""
    if log_weight is None:
        log_weight = np.zeros(len(theta))
    over_prior = log_weight - log_sum(log_weight) - prior.log_density(theta)
    log_size = float(log_sum(over_prior))
    weight = np.exp(over_prior - log_size)
    effective, d = 1.0 / float(np.sum(weight**2)), theta.shape[1]
    mean = weight @ theta
    covariance = (theta - mean).T * weight @ (theta - mean)
    covariance += ROUNDING * np.diag(np.diag(covariance))
    if effective <= d + 3 or np.any(np.diag(covariance) <= 0.0):
        return None
    # few draws do not tell it for certain: that of Student's t, which predicts the next draw
    covariance *= effective / (effective - 1.0) * (effective + 1.0) / (effective - d - 2.0)
    bandwidth = (4.0 / ((d + 2.0) * effective)) ** (1.0 / (d + 4.0))  # Silverman's rule
    kernel = bandwidth**2 * covariance
    points = _with_moments(_equally_likely(theta, weight, covariance), mean, covariance - kernel)
    for i in range(d):
        points = _mirrored(points, i, prior.low[i], prior.high[i])
    return Likelihood(points, kernel, mean, covariance, prior.low, prior.high, log_size, effective)


def _equally_likely(theta: Floats, weight: Floats, covariance: Floats) -> Floats:
    """(POINTS, d) of the weighted draws, evenly along their longest axis."""
    longest = np.linalg.eigh(covariance)[1][:, -1]
    order = np.argsort(theta @ longest, kind="stable")
    return np.asarray(theta[order[at_levels(weight[order], (np.arange(POINTS) + 0.5) / POINTS)]])


def _with_moments(points: Floats, mean: Floats, covariance: Floats) -> Floats:
    """The points, shifted and stretched to this mean and covariance."""
    off = points - np.mean(points, axis=0)
    root = np.linalg.cholesky(off.T @ off / len(off) + ROUNDING * np.diag(np.diag(covariance)))
    return np.asarray(mean + np.linalg.solve(root, off.T).T @ np.linalg.cholesky(covariance).T)


def _mirrored(points: Floats, i: int, low: float, high: float) -> Floats:
    """The points, and the mirror images of those that are near an end of parameter i."""
    images = []
    for end in (low, high):
        image = points[np.abs(points[:, i] - end) < MIRRORED * (high - low)]
        image[:, i] = 2.0 * end - image[:, i]
        images.append(image)
    return np.concatenate([points, *images])
