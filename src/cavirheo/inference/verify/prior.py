"""Proper priors of all that a shot depends on, and the coordinates u in which each of them is the standard normal.

u = Phi^-1(F(x)), F the cumulative distribution of a parameter's prior and x as in a fit (fit/parameters.py). In u there
are no bounds, the prior density is prod phi(u_i), and what a curve does not determine looks like its prior: the
coordinates in which the posterior is sampled. A density over x is one over u times p(x)/phi(u).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cavirheo.errors import InputError
from cavirheo.inference.fit.parameters import Family
from cavirheo.inference.fit.shots import Shot

Floats = NDArray[np.float64]

_LN10 = float(np.log(10.0))
_LOG_2PI = float(np.log(2.0 * np.pi))
_INSIDE = 1e-12  # of the probability, that u keeps away from the bounds
_START = 1e-3  # the same for a start, which must have somewhere to go
SIGMAS = 3.0  # standard deviations of the radius scale and of R_max within their bounds


class Prior:
    """Independent and normalised: uniform between the bounds, or normal and cut there.

    names: (d,) as in an answer. bounds: (d, 2). mean, std: (d,) of the normal ones; std is infinite where uniform.
    """

    def __init__(self, names: Sequence[str], bounds: Floats, mean: Floats, std: Floats) -> None:
        self.names = tuple(names)
        self.low, self.high = np.asarray(bounds, dtype=float).T
        self.mean, self.std = np.asarray(mean, dtype=float), np.asarray(std, dtype=float)
        self._uniform = ~np.isfinite(self.std)
        unit = np.where(self._uniform, 1.0, self.std)
        self._unit, self._centre = unit, np.where(self._uniform, 0.0, self.mean)
        self._below = ndtr((self.low - self._centre) / unit)
        self._inside = ndtr((self.high - self._centre) / unit) - self._below

    def cdf(self, x: Floats) -> Floats:
        """(..., d) from x (..., d)."""
        uniform = (x - self.low) / (self.high - self.low)
        normal = (ndtr((x - self._centre) / self._unit) - self._below) / self._inside
        return np.asarray(np.clip(np.where(self._uniform, uniform, normal), 0.0, 1.0))

    def to_x(self, u: Floats) -> Floats:
        """(..., d) from u (..., d)."""
        p = np.clip(ndtr(u), _INSIDE, 1.0 - _INSIDE)
        normal = self._centre + self._unit * ndtri(np.clip(self._below + p * self._inside, _INSIDE, 1.0 - _INSIDE))
        x = np.where(self._uniform, self.low + p * (self.high - self.low), normal)
        return np.asarray(np.clip(x, self.low, self.high))

    def to_u(self, x: Floats) -> Floats:
        """(..., d) from x (..., d); infinite at and beyond a bound."""
        return np.asarray(ndtri(self.cdf(x)))

    def start(self, x: Floats) -> Floats:
        """`to_u` with what lies at or beyond a bound brought a little inside."""
        return np.asarray(ndtri(np.clip(self.cdf(x), _START, 1.0 - _START)))

    def log_density(self, x: Floats) -> Floats:
        """(...,) log p(x) of x (..., d), inside the bounds."""
        z = (x - self._centre) / self._unit
        normal = -0.5 * (z**2 + _LOG_2PI) - np.log(self._unit * self._inside)
        return np.asarray(np.sum(np.where(self._uniform, -np.log(self.high - self.low), normal), axis=-1))

    def slope(self, u: Floats) -> Floats:
        """(d,) dx/du = phi(u)/p(x)."""
        z = (self.to_x(u) - self._centre) / self._unit
        normal = -0.5 * z**2 - np.log(self._unit * self._inside)
        log_p = np.where(self._uniform, 0.5 * _LOG_2PI - np.log(self.high - self.low), normal)
        return np.asarray(np.exp(-0.5 * u**2 - log_p))

    def to_dict(self) -> dict[str, list[float]]:
        """{name: [low, high]} or [low, high, mean, standard deviation], in x."""
        rows = np.column_stack([self.low, self.high, self.mean, self.std]).tolist()
        return {n: row[:2] if np.isinf(row[3]) else row for n, row in zip(self.names, rows, strict=True)}


def log_normal(u: Floats) -> Floats:
    """(...,) sum of log phi over the last axis."""
    return np.asarray(-0.5 * np.sum(u**2 + _LOG_2PI, axis=-1))


def prior_of(shot: Shot, family: Family, ranges: Mapping[str, Sequence[float]] | None = None) -> Prior:
    """The prior of a shot's parameters, in the order of a fit: the law's, then the shot's own.

    log10 of the law's parameters and of the stretch: uniform in the ranges that a fit searches, or in `ranges`
    ({"shear_modulus": [low, high] in SI}); the stretch normal where the plateau gives it. Time origin: uniform within
    its bound. Radius scale and R_max: normal, with a third of their bound as standard deviation.

    Raises:
        InputError: a range for an unknown parameter, or one that is not positive and rising.
    """
    given = dict(ranges or {})
    own = shot.own
    bounds = np.concatenate([family.bounds(), own.bounds])
    names = [*family.parameters, *own.names]
    mean, std = np.zeros(len(names)), np.full(len(names), np.inf)
    for i, name in enumerate(names):
        if name in given and name in (*family.parameters, "stretch"):
            pair = given.pop(name)
            if len(pair) != 2 or not 0 < pair[0] < pair[1] < np.inf:
                raise InputError(f"the prior range of {name} must be [low, high] with 0 < low < high, got {list(pair)}")
            bounds[i] = np.log10(pair)
        if name == "stretch" and shot.stretch_prior:
            value, deviation = shot.stretch_prior
            mean[i], std[i] = np.log10(value), deviation / (value * _LN10)
        if name in ("radius_scale", "max_radius_factor"):
            std[i] = 1.0 / SIGMAS
    if given:
        raise InputError(f"no prior range can be set for {', '.join(given)}; known: {', '.join(names)}")
    return Prior(names, bounds, mean, std)
