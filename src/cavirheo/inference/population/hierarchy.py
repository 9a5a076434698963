"""The posterior of a material's centre and of the scatter of its shots about it, from the draws of each shot.

    p(frames_i | c, S) = (1 - P_OUTLIER) L_i(c, S) + P_OUTLIER L_i(c, S + OUTLIER_STD^2),

L_i(c, S) the integral of the likelihood of shot i over a normal population with centre c in log10 and variances S. An
outlier has the second, wide density (Mandel, Farr and Gair 2019, doi:10.1093/mnras/stz896).

The draws of a shot, weighted by the inverse density of the prior that they were made with, are draws of its likelihood
(Hogg, Myers and Bovy 2010, doi:10.1088/0004-637X/725/2/2166). POINTS of them, each widened to a normal distribution and
mirrored at an end of the prior, give a smooth one, whose integral over a normal population has a closed form, even if
the population is narrower than the gaps between draws (docs/method/population.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cavirheo.arrays import Floats, at_levels, log_sum
from cavirheo.inference.sample import EMULATED, Draws, Mixture, first_round, sample
from cavirheo.prior import INSIDE, Prior, log_normal

POINTS = 100  # of a shot
ROUNDING = 1e-9  # share of variances that is added, so that covariances are positive
MIRRORED = 0.25  # part of a prior's range from an end in which points are mirrored at it
P_OUTLIER = 0.05  # prior probability that a shot is an outlier
OUTLIER_STD = 0.7  # decades: additional standard deviation of outliers
SPREAD_SCALE = 0.2  # decades: scale of the half-normal prior of each spread
CUT = 10.0  # standard deviations at which this prior ends
ENOUGH = 2500.0  # effective draws after which no round follows


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


class MaterialPosterior:
    """The log posterior over u, the normal coordinates of the prior (cavirheo.prior). shots: n likelihoods. low,
    high: (d,) range of the centre, log10."""

    def __init__(self, shots: Sequence[Likelihood]) -> None:
        self.low = np.min([shot.low for shot in shots], axis=0)
        self.high = np.max([shot.high for shot in shots], axis=0)
        self.shots, self.d = shots, len(self.low)
        low, high = np.append(self.low, np.zeros(self.d)), np.append(self.high, np.full(self.d, CUT * SPREAD_SCALE))
        std = np.repeat([np.inf, SPREAD_SCALE], self.d)
        self.prior = Prior(tuple(map(str, range(2 * self.d))), low, high, std=std)

    def parts(self, u: Floats) -> tuple[Floats, Floats]:
        """Centre and spread (k, d) of u (k, 2 d)."""
        x = self.prior.to_x(u)
        return x[:, : self.d], x[:, self.d :]

    def densities(self, u: Floats) -> tuple[Floats, Floats]:
        """Log density (n, k) of each shot as an inlier and as an outlier, with the prior probabilities of these."""
        centre, spread = self.parts(u)
        inside = np.array([shot.log_integral(centre, spread**2) for shot in self.shots])
        wide = spread**2 + OUTLIER_STD**2
        outside = np.array([shot.log_integral_of_outliers(centre, wide) for shot in self.shots])
        return np.log(1.0 - P_OUTLIER) + inside, np.log(P_OUTLIER) + outside

    def sample(self, seed: int) -> Draws:
        """Weighted draws."""
        rng = np.random.Generator(np.random.Philox(seed))

        def log_posterior(u: Floats) -> Floats:
            return np.asarray(np.sum(np.logaddexp(*self.densities(u)), axis=0) + log_normal(u))[:, None]

        rounds = first_round(self._start(), EMULATED.rounds[0], log_posterior, rng)
        return sample(log_posterior, lambda _, value: value[:, 0], rounds, EMULATED.rounds, rng, ENOUGH)[0]

    def outliers(self, u: Floats) -> Floats:
        """Probability (n,) that each shot is an outlier, averaged over equally likely u (k, 2 d)."""
        inside, outside = self.densities(u)
        return np.asarray(np.mean(np.exp(outside - np.logaddexp(inside, outside)), axis=1))

    def _start(self) -> Mixture:
        """First proposal: normal shots about their median."""
        means = np.array([shot.mean for shot in self.shots])
        centre = np.median(means, axis=0)
        scatter = 1.5 * np.median(np.abs(means - centre), axis=0)  # the standard deviation of normal numbers
        own = np.sqrt(np.median([np.diag(shot.covariance) for shot in self.shots], axis=0))
        error = np.hypot(scatter, own) / np.sqrt(len(means))
        spread = np.maximum(scatter, own)
        low, middle, high = (
            self.prior.to_u(np.concatenate([at, spread]), INSIDE) for at in (centre - error, centre, centre + error)
        )
        width = np.ones(len(middle))
        width[: self.d] = 0.5 * (high - low)[: self.d]
        return Mixture.of_modes([middle], [np.diag(width**2)], [0.0])
