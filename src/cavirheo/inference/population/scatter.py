"""The posterior of a material's centre and of its shot-to-shot spread, given the likelihoods of the shots.

Of shot i, with Gaussians of share w, mean m and covariance V for its likelihood,

    p(frames_i | c, S) = (1 - OUTLIERS) sum w N(m; c + b x_i, V + S) + OUTLIERS sum w N(m; c + b x_i, V + S + WIDE^2),

c the centre in log10, S the covariance of the spread, b the slope along a column x, if there is one. An outlier
has the second, broad density. Of a shot that only bounds a parameter N is a normal distribution function of
it (likelihood.py). Hierarchical inference from the draws of single events, as for gravitational
waves: Mandel, Farr and Gair 2019, doi:10.1093/mnras/stz896.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from cavirheo.arrays import Floats
from cavirheo.inference.population.likelihood import Likelihoods
from cavirheo.inference.verify.sampler import Mixture, Sample, importance_sample
from cavirheo.prior import Prior, log_normal

OUTLIERS = 0.05  # prior probability that a shot is one
WIDE = 0.7  # decades: how far these scatter
SPREAD = 0.2  # decades: the half of a normal distribution is the prior of each spread
SLOPE = 1.0  # decades per standard deviation of the column: standard deviation of the prior of each slope
_LARGEST = 2.0  # decades, of a spread
_CHUNK = 100_000  # densities at a time
_EACH, _ENOUGH, _ADAPTED = 1000, 2500.0, 2  # draws of a round, effective ones that are enough, rounds that adapt
_STEP = 0.002  # of differences, in the coordinates of the prior
_FAR = 30.0  # height below the best mode, from which another is not drawn from
_STARTS, _CLIMBED = 12, 3  # shots at most, about each of which a search may start; from how many places it does


class Scatter:
    """The log posterior over u, the normal coordinates of the prior (cavirheo.prior). With `spread=False` all shots
    have one material.

    low, high: (d,) range of the centre, log10. column: (n,) with mean 0 and standard deviation 1, or None.
    """

    def __init__(
        self, shots: Likelihoods, low: Floats, high: Floats, *, spread: bool = True, column: Floats | None = None
    ) -> None:
        self.shots, self.d, self.spread, self.column = shots, len(low), spread, column
        d = self.d
        pairs = d * (d - 1) // 2
        ranges = [(low[i], high[i], 0.0, np.inf) for i in range(d)]
        ranges += [(0.0, _LARGEST, 0.0, SPREAD)] * d * spread + [(-1.0, 1.0, 0.0, np.inf)] * pairs * spread
        ranges += [(-10.0 * SLOPE, 10.0 * SLOPE, 0.0, SLOPE)] * d * (column is not None)
        names = tuple(f"{i}" for i in range(len(ranges)))
        self.prior = Prior(names, *np.array(ranges, dtype=float).T)

    def parts(self, u: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Centre (k, d), spread (k, d), correlation (k, d, d) and slope (k, d) of u (k, .)."""
        d, x = self.d, self.prior.to_x(u)
        centre, left = x[:, :d], x[:, d:]
        spread, root = np.zeros_like(centre), np.broadcast_to(np.eye(d), (len(u), d, d)).copy()
        if self.spread:
            spread, left = left[:, :d], left[:, d:]
            for i in range(1, d):  # the root of a correlation matrix from partial correlations, row by row
                square = np.ones(len(u))
                for j in range(i):
                    partial, left = left[:, 0], left[:, 1:]
                    root[:, i, j] = partial * np.sqrt(square)
                    square = square * (1.0 - partial**2)
                root[:, i, i] = np.sqrt(square)
        slope = left if self.column is not None else np.zeros_like(centre)
        return centre, spread, root @ root.transpose(0, 2, 1), slope

    def densities(self, u: Floats) -> tuple[Floats, Floats]:
        """(k, n) log density of each shot if it is an inlier and if it is an outlier, shares included."""
        d, shots = self.d, self.shots
        centre, spread, correlation, slope = self.parts(u)
        scatter = spread[:, :, None] * correlation * spread[:, None, :]
        x = np.zeros(len(shots.shot)) if self.column is None else self.column[shots.shot]
        along = slope[:, None] * x[:, None]
        densities = []
        for share, wide in ((1.0 - OUTLIERS, 0.0), (OUTLIERS, WIDE**2)):
            log_p = shots.log_densities(centre, along, scatter + wide * np.eye(d)) + shots.log_share
            densities.append(np.log(share) + _log_sum(log_p, shots.first))
        return densities[0], densities[1]

    def __call__(self, u: Floats) -> Floats:
        """(k,)"""
        parts = [np.sum(np.logaddexp(*self.densities(part)), axis=1) for part in self._chunks(u)]
        return np.concatenate(parts) + log_normal(u)

    def _chunks(self, u: Floats) -> list[Floats]:
        rows = max(_CHUNK // len(self.shots.shot), 1)
        return [u[i : i + rows] for i in range(0, len(u), rows)]

    def sample(self, seed: int) -> Sample:
        """Weighted draws; the mean weight is the evidence, but for the sizes of the likelihoods."""
        mixture = self._start()

        def adapt(draws: Sample, _: np.random.Generator) -> Mixture:
            nonlocal mixture
            mixture = mixture.fitted(draws.u, draws.log_weight)
            return mixture.widened()

        rng = np.random.Generator(np.random.Philox(seed))
        return importance_sample(self, mixture.widened(), adapt, rng, enough=_ENOUGH, each=_EACH, fewest=_ADAPTED)

    def outliers(self, u: Floats) -> Floats:
        """(n,) probability that each shot is an outlier, over equally likely u (k, .)."""
        total = np.zeros(len(self.shots.first))
        for inside, outside in map(self.densities, self._chunks(u)):
            total += np.sum(1.0 / (1.0 + np.exp(np.clip(inside - outside, -700.0, 700.0))), axis=0)
        return np.asarray(total / len(u))

    def _start(self) -> Mixture:
        """About the modes, climbed to from the middle and, where there are few shots, from each of them."""
        means = self.shots.means
        middle = np.median(means, axis=0)
        spread = np.clip(np.std(means, axis=0), 0.01, 0.5)
        steady = np.clip(1.5 * np.median(np.abs(means - middle), axis=0), 0.01, 0.5)
        starts = [(middle, steady), (np.mean(means, axis=0), spread), (middle, 0.02 + 0.0 * spread)]
        starts += [(mean, 0.05 + 0.0 * spread) for mean in means] if len(means) <= _STARTS else []
        u = np.array([self._at(*start) for start in starts])
        modes: list[tuple[Floats, Floats, float]] = []  # place, covariance and log of the integral
        for start in u[np.argsort(-self(u), kind="stable")[:_CLIMBED]]:
            place, height = self._climbed(start)
            if not any(np.max(np.abs(place - mode[0])) < 0.05 for mode in modes):
                width = self._width(place)
                modes.append((place, width, height + 0.5 * np.linalg.slogdet(width)[1]))
        top = max(mode[2] for mode in modes)
        places, widths, integrals = zip(*(mode for mode in modes if mode[2] > top - _FAR), strict=True)
        return Mixture.of_modes(places, widths, integrals)

    def _at(self, centre: Floats, spread: Floats) -> Floats:
        """u (m,) of a centre and a spread (d,)."""
        x = np.where(np.isfinite(self.prior.std), self.prior.mean, 0.5 * (self.prior.low + self.prior.high))
        x[: self.d] = centre
        if self.spread:
            x[self.d : 2 * self.d] = spread
        return self.prior.to_u(x, inside=1e-6)

    def _climbed(self, u: Floats) -> tuple[Floats, float]:
        steps = 1e-4 * np.concatenate([np.eye(len(u)), -np.eye(len(u))])

        def falling(at: Floats) -> tuple[float, Floats]:
            value = self(np.concatenate([at[None], at + steps]))
            up, down = np.split(value[1:], 2)
            return -float(value[0]), -(up - down) / 2e-4

        mode = minimize(falling, u, jac=True, method="BFGS", options={"maxiter": 60, "gtol": 1e-2})
        return np.clip(mode.x, -7.0, 7.0), -float(mode.fun)

    def _width(self, u: Floats) -> Floats:
        """(m, m) covariance of the Gaussian about a mode."""
        m = len(u)
        steps = self._steps(u)
        i, j = np.tril_indices(m)
        ends = [a * np.eye(m)[i] * steps[i, None] + b * np.eye(m)[j] * steps[j, None] for a, b in _CORNERS]
        value = [self(u + end) for end in ends]
        curved = np.zeros((m, m))
        curved[i, j] = (value[0] - value[1] - value[2] + value[3]) / (4.0 * steps[i] * steps[j])
        curved = curved + np.tril(curved, -1).T
        values, vectors = np.linalg.eigh(-curved)
        return np.asarray((vectors / np.clip(values, 0.5, None)) @ vectors.T)  # no wider than the prior, nearly

    def _steps(self, u: Floats) -> Floats:
        """(m,) of second differences: each lowers the height by about a twentieth."""
        ends = _STEP * np.concatenate([np.eye(len(u)), -np.eye(len(u))])
        up, down = np.split(self(u + ends), 2)
        curvature = np.maximum(-(up + down - 2.0 * self(u[None])) / _STEP**2, 1.0)
        return np.asarray(np.sqrt(0.1 / curvature))


_CORNERS: Sequence[tuple[float, float]] = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))


def _log_sum(log_p: Floats, first: np.ndarray) -> Floats:
    """(k, n) log of the sums of exp over the Gaussians (k, m) of each shot."""
    if len(first) == log_p.shape[1]:
        return log_p
    top = np.maximum.reduceat(log_p, first, axis=1)
    counts = np.diff(np.append(first, log_p.shape[1]))
    return np.asarray(top + np.log(np.add.reduceat(np.exp(log_p - np.repeat(top, counts, axis=1)), first, axis=1)))
