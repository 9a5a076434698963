"""What a minimum is worth: covariance with correlated residuals, correlations, draws."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.experiment import FINE
from cavirheo.inference.fit.least_squares import LeastSquares
from cavirheo.inference.noise import correlation_time


class Laplace(NamedTuple):
    """The Gaussian about a minimum, in the units of the fit (log10 for parameters of the law and the stretch)."""

    covariance: Floats  # (parameters, parameters)
    variance: list[float]  # per shot: residual variance over the one that its weights assume
    correlation: list[float]  # per shot: frames per independent residual
    freedom: float  # degrees of freedom from which the variances are known


def laplace(fit: LeastSquares, x: Floats) -> Laplace:
    """Gauss-Newton: cov^-1 = sum over shots J^T J/(s^2 tau) + priors + ranges.

    s^2 is chi^2 over the degrees of freedom of a shot, tau the correlation time: m frames are worth m/tau independent
    ones. A range of width w counts as a Gaussian of variance w^2/12, that of a uniform prior.
    """
    seen = fit.at(x, FINE)
    residual, J = fit.weighted(x, seen), fit.jacobian(x, FINE, central=True, at=seen)
    precision: Any = np.diag(12.0 / (fit.bounds[:, 1] - fit.bounds[:, 0]) ** 2)
    variances, taus, independent = [], [], 0.0
    share = fit.common / len(fit.shots)  # of the common parameters, that each shot pays with degrees of freedom
    for shot, rows in zip(fit.shots, fit.rows, strict=True):
        r, Jk = residual[rows][shot.counted], J[rows][shot.counted]
        freedom = max(len(r) - share - len(shot.own), 1.0)
        variances.append(max(float(r @ r) / freedom, 1e-12))
        taus.append(correlation_time(r))
        precision += Jk.T @ Jk / (variances[-1] * taus[-1])
        independent += len(r) / taus[-1]
    plateaus = J[fit.rows[-1].stop :]
    precision += plateaus.T @ plateaus
    return Laplace(np.linalg.inv(precision), variances, taus, max(independent - len(x), 1.0))


def draws(mean: Floats, covariance: Floats, bounds: Floats, count: int, seed: int, freedom: float) -> Floats:
    """(count, parameters) of Student's t, for the variance is itself estimated, clipped to the bounds.

    In pairs opposite to each other (the median is the mean); the same for the same seed and count.
    """
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((count // 2, len(mean)))
    half *= np.sqrt(freedom / rng.chisquare(freedom, (len(half), 1)))
    values, vectors = np.linalg.eigh(covariance)
    spread = half @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    return np.clip(mean + np.concatenate([spread, -spread]), bounds[:, 0], bounds[:, 1])
