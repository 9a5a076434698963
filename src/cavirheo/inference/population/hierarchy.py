"""The posterior of a material's centre and of its shot-to-shot spread, given the likelihoods of the shots.

Draws of a posterior, weighted by the inverse density of the prior that they were made with, are draws of the likelihood
(Hogg, Myers and Bovy 2010, doi:10.1088/0004-637X/725/2/2166). A mixture of Gaussians is fitted to them by expectation
maximisation. It is smooth even if the material is narrower than the gaps between draws, and its convolution with a
Gaussian population has a closed form: of shot i, with shares w, means m and covariances V,

    p(frames_i | c, S) = (1 - P_OUTLIER) sum w N(m; c + b x_i, V + S)
        + P_OUTLIER sum w N(m; c + b x_i, V + S + OUTLIER_STD^2),

c the centre in log10, S the covariance of the spread, b the slope along a column x, if there is one. An outlier has the
second, broad density (Mandel, Farr and Gair 2019, doi:10.1093/mnras/stz896).

A shot that only bounds a parameter has draws up to the end of its prior, and would have draws beyond it if the prior
were wider. Its first Gaussian is that of the bound y, not of the value m: the likelihood of m is the integral of N(y)
over all y beyond m, a normal distribution function of m (given the parameters with values, on which the bound may
depend). Correlations between several bounds of one shot, given its values, are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp

from cavirheo.arrays import Floats
from cavirheo.inference.sample import Draws, Mixture, first_round, sample
from cavirheo.parameters import Bound
from cavirheo.posterior import Evidence
from cavirheo.prior import Prior, log_normal

FEW = 30.0  # effective draws of a shot, below which its interval is rough
_MAX_GAUSSIANS = 4  # most Gaussians of a shot
_DRAWS_PER_GAUSSIAN = 20.0  # effective draws for each Gaussian
_STEPS, _GAIN = 40, 5e-4  # of expectation maximisation: most steps, and gain of log likelihood per draw at its end
_BOUND_STEPS, _BOUND_GAIN = 100, 3e-5  # the same where a bound is fitted, which few draws determine
_END, _END_DRAWS = 0.1, 2.0  # share of a prior's range near its end; effective draws there above which a bound is tried
_ADDED = 1e-4  # share of the covariance of all draws that is added to that of each Gaussian
VALUE, UPPER, LOWER, UNDETERMINED = 0, 1, -1, 2  # what a Gaussian describes of a parameter
_KINDS: dict[Bound | None, int] = {
    None: VALUE,
    "wide": VALUE,
    "upper": UPPER,
    "lower": LOWER,
    "undetermined": UNDETERMINED,
}
P_OUTLIER = 0.05  # prior probability that a shot is an outlier
OUTLIER_STD = 0.7  # decades: additional standard deviation of outliers
SPREAD_SCALE = 0.2  # decades: scale of the half-normal prior of each spread
SLOPE_STD = 1.0  # decades per standard deviation of the column: standard deviation of the prior of each slope
_MAX_SPREAD = 2.0  # decades: largest spread
_CHUNK = 100_000  # densities that are computed at a time
_ROUNDS = (2000, 2500, 3000, 3500, 4000, 4500)  # draws of each round at most
_ENOUGH = 5000.0  # effective draws after which no round follows; half of it finds the evidence of slopes 0.1 too low
_STEP = 1e-4  # step of differences, in the coordinates of the prior
_SHOT_STARTS, _CLIMBED = 12, 3  # most shots at each of which a search starts; starts that are used, the likeliest


@dataclass(frozen=True, eq=False)
class Gaussians:
    """m Gaussians: share (m,), mean (m, d), covariance (m, d, d). kinds: (m, d) VALUE, UPPER, LOWER or UNDETERMINED of
    each parameter, which decides how it is integrated."""

    share: Floats
    mean: Floats
    covariance: Floats
    kinds: np.ndarray

    def log_densities(self, x: Floats, along: Floats, scatter: Floats) -> Floats:
        """Log density (k, m) of each Gaussian at x (k, d) plus `along` (k, m, d), widened by a scatter (k, d, d)."""
        log_p = np.empty((len(x), len(self.kinds)))
        for pattern in np.unique(self.kinds, axis=0):
            some = np.flatnonzero(np.all(self.kinds == pattern, axis=1))
            mean, base = self.mean[some], self.covariance[some]
            order = np.concatenate([np.flatnonzero(pattern == VALUE), np.flatnonzero(np.abs(pattern) == UPPER)])
            off = [mean[:, i] - x[:, i, None] - along[:, some, i] for i in order]
            covariance = [[base[:, i, j] + scatter[:, i, j, None] for j in order[: a + 1]] for a, i in enumerate(order)]
            log_p[:, some] = np.broadcast_to(_log_gaussian(off, covariance, pattern[order]), (len(x), len(some)))
        return log_p


@dataclass(frozen=True, eq=False)
class Likelihood(Gaussians):
    """The likelihood of a shot: exp(log_size) times the sum of its Gaussians. effective: number of effective draws."""

    log_size: float
    effective: float


def likelihood(
    theta: Floats, log_weight: Floats, log_prior: Floats, bounds: Sequence[Bound | None], ends: Floats
) -> Likelihood | None:
    """The likelihood from draws theta (k, d) of a posterior with log weights and log density of their prior (k,); None
    if there are too few effective draws for a covariance. bounds: of each parameter in the range `ends` (2, d) of its
    prior. If the tail of a parameter without a bound reaches an end, a fit with a bound is tried, too."""
    log_weight = log_weight - logsumexp(log_weight) - log_prior
    size = float(logsumexp(log_weight))
    weight = np.exp(log_weight - size)
    effective, d = 1.0 / float(np.sum(weight**2)), theta.shape[1]
    if not effective > d + 3:
        return None
    kinds = np.array([_KINDS[bound] for bound in bounds])
    fits = [_Fit(theta, weight, kinds, ends)]
    if not np.all(np.diag(fits[0].total) > 0):
        return None
    worth, width = effective * weight, _END * (ends[1] - ends[0])
    mass = np.array([worth @ (theta < ends[0] + width), worth @ (theta > ends[1] - width)])
    tail = np.where(mass[0] >= mass[1], UPPER, LOWER)
    reaching = np.where((kinds == VALUE) & (np.max(mass, axis=0) >= _END_DRAWS), tail, kinds)
    if effective >= FEW and np.any(reaching != kinds):
        fits.append(_Fit(theta, weight, reaching, ends))
    candidates: list[tuple[float, _Fit, Gaussians]] = []
    for fit in fits:
        for k in range(1, max(min(_MAX_GAUSSIANS, int(effective / _DRAWS_PER_GAUSSIAN)), 1) + 1):
            gaussians, fitted = fit.mixture(k)
            information = effective * fitted - 0.5 * np.log(effective) * (k * (d + 1) * (d + 2) / 2 - 1)
            if k > 1 and information <= candidates[-1][0]:
                break
            candidates.append((information, fit, gaussians))
    _, fit, gaussians = max(candidates, key=lambda candidate: candidate[0])
    share, covariance = gaussians.share.copy(), gaussians.covariance
    if effective < FEW:  # it is uncertain itself: that of Student's t, which predicts the next draw
        covariance = covariance * (effective / (effective - 1.0) * (effective + 1.0) / (effective - d - 2.0))
    share[0] /= fit.volume(gaussians.mean[0], covariance[0])
    return Likelihood(share, gaussians.mean, covariance, gaussians.kinds, size, effective)


class _Fit:
    """Fits of Gaussians to draws theta (n, d) with weights that sum to 1. kinds: (d,) of the first Gaussian; the others
    are of values. ends: (2, d) of the prior. total: (d, d) covariance of the draws."""

    def __init__(self, theta: Floats, weight: Floats, kinds: np.ndarray, ends: Floats) -> None:
        self.theta, self.weight, self.kinds, self.ends, self.mean = theta, weight, kinds, ends, weight @ theta
        self.total: Floats = (theta - self.mean).T * weight @ (theta - self.mean)
        self.bounded: list[int] = np.flatnonzero(np.abs(kinds) == UPPER).tolist()

    def mixture(self, k: int) -> tuple[Gaussians, float]:
        """k Gaussians by expectation maximisation from slices across the longest axis, and the mean log density."""
        theta, weight, d = self.theta, self.weight, self.theta.shape[1]
        along = theta @ np.linalg.eigh(self.total)[1][:, -1]
        order = np.argsort(along, kind="stable")
        rank = np.empty(len(along))
        rank[order] = np.cumsum(weight[order]) - 0.5 * weight[order]
        slices = k - 1 if np.any(self.kinds) and k > 1 else k
        resp = (np.minimum((rank * slices).astype(int), slices - 1) == np.arange(slices)[:, None]).astype(float)
        if slices < k:  # the bound's Gaussian has all draws
            resp = 0.5 * np.concatenate([np.ones((1, len(theta))), resp])
        filled, spare = np.repeat(theta[None], k, axis=0), np.zeros((k, len(theta), d))
        mean, covariance, kinds = np.empty((k, d)), np.empty((k, d, d)), np.zeros((k, d), dtype=int)
        kinds[0] = self.kinds
        for i in self.bounded:  # an upper bound starts at the 90 % quantile of the draws, a lower one at 10 %
            edge = 0.9 if self.kinds[i] == UPPER else 0.1
            filled[0, :, i] = np.quantile(theta[:, i], edge, weights=weight, method="inverted_cdf")
            spare[0, :, i] = 0.01 * self.total[i, i]
        before, steps = -np.inf, _BOUND_STEPS if self.bounded else _STEPS if k > 1 else 1
        for step in range(steps):
            mass = resp * weight
            share = np.maximum(np.sum(mass, axis=1), 1e-12)
            mean = np.einsum("kn,kni->ki", mass, filled) / share[:, None]
            mean[0] -= self._pull(mean[0], covariance[0]) if step else 0.0
            off = filled - mean[:, None]
            covariance = np.einsum("kn,kni,knj->kij", mass, off, off) / share[:, None, None] + _ADDED * self.total
            covariance += np.eye(d) * np.einsum("kn,kni->ki", mass, spare)[:, None] / share[:, None, None]
            gaussians = Gaussians(share / np.sum(share), mean, covariance, kinds)
            densities = gaussians.log_densities(theta, np.zeros((1, k, d)), np.zeros((1, d, d)))
            log_p = np.ascontiguousarray(densities.T)
            inside = max(self.volume(mean[0], covariance[0]), 1e-12)
            log_p[0] -= np.log(inside)  # it then has the integral 1 over the prior's range
            log_p += np.log(gaussians.share)[:, None]
            total = np.logaddexp.reduce(log_p, axis=0)
            resp = np.exp(log_p - total)
            fitted = float(weight @ total)
            if fitted - before < (_BOUND_GAIN if self.bounded else _GAIN):
                break
            before = fitted
            self._fill(mean[0], covariance[0], filled[0], spare[0])
        if k == 1 and not np.any(self.kinds):
            gaussians = Gaussians(np.ones(1), self.mean[None], self.total[None], kinds)
        return gaussians, fitted

    def volume(self, mean: Floats, covariance: Floats) -> float:
        """The integral over the prior's range of the first Gaussian, with bounds as distribution functions."""
        flat = np.flatnonzero(self.kinds == UNDETERMINED)
        volume = float(np.prod(self.ends[1, flat] - self.ends[0, flat]))
        for i in self.bounded:
            room, deviation = self._room(mean, i), np.sqrt(covariance[i, i])
            density = np.exp(-0.5 * (room / deviation) ** 2) / np.sqrt(2.0 * np.pi)
            volume *= room * np.exp(log_ndtr(room / deviation)) + deviation * density
        return volume

    def _room(self, mean: Floats, i: int) -> float:
        """Distance from the end of the prior to a bound."""
        return float(mean[i] - self.ends[0, i] if self.kinds[i] == UPPER else self.ends[1, i] - mean[i])

    def _pull(self, mean: Floats, covariance: Floats) -> Floats:
        """Shift (d,) of the mean of the bounds from that of the draws to the end: farther bounds have more draws."""
        pull = np.zeros(len(mean))
        for i in self.bounded:
            room, deviation = max(self._room(mean, i), 1e-3), np.sqrt(covariance[i, i])
            pull += self.kinds[i] * covariance[:, i] / max(room, deviation)
        return pull

    def _fill(self, mean: Floats, covariance: Floats, filled: Floats, spare: Floats) -> None:
        """Write the expected bound beyond each draw (n, d), given its values, and the variance of this bound."""
        valued = np.flatnonzero(self.kinds == VALUE)
        off = self.theta[:, valued] - mean[valued]
        for i in self.bounded:
            along = np.linalg.solve(covariance[np.ix_(valued, valued)], covariance[valued, i])
            deviation = np.sqrt(max(covariance[i, i] - along @ covariance[valued, i], 1e-12))
            middle, sign = mean[i] + off @ along, float(self.kinds[i])
            least = sign * (self.theta[:, i] - middle) / deviation
            hazard = np.exp(-0.5 * least**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(-least))
            filled[:, i] = middle + sign * deviation * hazard
            spare[:, i] = deviation**2 * np.maximum(1.0 + least * hazard - hazard**2, 0.0)


def _log_gaussian(off: Sequence[Floats], covariance: Sequence[Sequence[Floats]], kinds: np.ndarray) -> Floats:
    """Log density at d distances mean - x with the lower triangle of the covariances, by Cholesky's factor. Bounds come
    last, because they may depend on the values, and are integrated from x on."""
    root: list[list[Floats]] = []
    whitened: list[Floats] = []
    log_p: Floats = np.zeros(off[0].shape if off else ())
    for i, distance in enumerate(off):
        row: list[Floats] = []
        for j in range(len(root)):
            row.append((covariance[i][j] - _dot(row, root[j][:j])) / root[j][j])
        row.append(np.sqrt(np.maximum(covariance[i][i] - _dot(row, row), 1e-300)))
        z = (distance - _dot(row[:-1], whitened)) / row[-1]
        if kinds[i] != VALUE:
            log_p = log_p + log_ndtr(kinds[i] * z)
            continue
        whitened.append(z)
        root.append(row)
        log_p = log_p - 0.5 * z**2 - np.log(row[-1]) - 0.5 * np.log(2.0 * np.pi)
    return log_p


def _dot(first: Sequence[Floats], second: Sequence[Floats]) -> Floats | float:
    return sum((a * b for a, b in zip(first, second, strict=True)), start=0.0)


class MaterialPosterior:
    """The log posterior over u, the normal coordinates of the prior (cavirheo.prior). shots: likelihoods of n shots,
    whose Gaussians are joined in this order. low, high: (d,) range of the centre, log10. column: (n,) with mean 0 and
    deviation 1, or None."""

    def __init__(self, shots: Sequence[Likelihood], low: Floats, high: Floats, column: Floats | None) -> None:
        names = [field.name for field in fields(Gaussians)]
        self.gaussians = Gaussians(*(np.concatenate([getattr(shot, name) for shot in shots]) for name in names))
        counts = [len(shot.share) for shot in shots]
        self.shot = np.repeat(np.arange(len(shots)), counts)  # (m,) shot of each Gaussian
        self.first: np.ndarray = np.cumsum(counts) - counts  # (n,) first Gaussian of each shot
        self.log_size = float(sum(shot.log_size for shot in shots))
        self.d, self.column = len(low), column
        d, pairs = self.d, self.d * (self.d - 1) // 2
        ranges = [(low[i], high[i], 0.0, np.inf) for i in range(d)]
        ranges += [(0.0, _MAX_SPREAD, 0.0, SPREAD_SCALE)] * d + [(-1.0, 1.0, 0.0, np.inf)] * pairs
        ranges += [(-10.0 * SLOPE_STD, 10.0 * SLOPE_STD, 0.0, SLOPE_STD)] * d * (column is not None)
        self.prior = Prior(tuple(map(str, range(len(ranges)))), *np.array(ranges, dtype=float).T)

    def parts(self, u: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Centre (k, d), spread (k, d), correlation (k, d, d) and slope (k, d) of u (k, .)."""
        d, x = self.d, self.prior.to_x(u)
        centre, spread, left = x[:, :d], x[:, d : 2 * d], x[:, 2 * d :]
        root = np.broadcast_to(np.eye(d), (len(u), d, d)).copy()
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
        """Log density (k, n) of each shot as an inlier and as an outlier, with the prior probabilities of these."""
        d, gaussians = self.d, self.gaussians
        centre, spread, correlation, slope = self.parts(u)
        scatter = spread[:, :, None] * correlation * spread[:, None, :]
        x = np.zeros(len(self.shot)) if self.column is None else self.column[self.shot]
        along = slope[:, None] * x[:, None]
        densities = []
        for share, wide in ((1.0 - P_OUTLIER, 0.0), (P_OUTLIER, OUTLIER_STD**2)):
            log_p = gaussians.log_densities(centre, along, scatter + wide * np.eye(d)) + np.log(gaussians.share)
            densities.append(np.log(share) + _log_sum(log_p, self.first))
        return densities[0], densities[1]

    def __call__(self, u: Floats) -> Floats:
        """Log posterior (k,) at u (k, .)."""
        parts = [np.sum(np.logaddexp(*self.densities(part)), axis=1) for part in self._chunks(u)]
        return np.concatenate(parts) + log_normal(u)

    def _chunks(self, u: Floats) -> list[Floats]:
        rows = max(_CHUNK // len(self.shot), 1)
        return [u[i : i + rows] for i in range(0, len(u), rows)]

    def sample(self, seed: int) -> Draws:
        """Weighted draws."""
        rng = np.random.Generator(np.random.Philox(seed))

        def values(u: Floats) -> Floats:
            return self(u)[:, None]

        rounds = first_round(self._start(), _ROUNDS[0], values, rng)
        return sample(values, lambda u, value: value[:, 0], rounds, _ROUNDS, rng, _ENOUGH)[0]

    def evidence(self, draws: Draws) -> Evidence:
        """Log evidence: that of the draws times the sizes of the likelihoods."""
        return Evidence(draws.log_evidence + self.log_size, draws.error)

    def outliers(self, u: Floats) -> Floats:
        """Probability (n,) that each shot is an outlier, averaged over equally likely u (k, .)."""
        total = np.zeros(len(self.first))
        for inside, outside in map(self.densities, self._chunks(u)):
            total += np.sum(1.0 / (1.0 + np.exp(np.clip(inside - outside, -700.0, 700.0))), axis=0)
        return np.asarray(total / len(u))

    def _start(self) -> Mixture:
        """First proposal about the modes, which are reached from the middle and, if shots are few, from each shot."""
        share = self.gaussians.share[:, None]
        total = np.add.reduceat(share, self.first, axis=0)
        means = np.add.reduceat(share * self.gaussians.mean, self.first, axis=0) / total
        middle = np.median(means, axis=0)
        spread = np.clip(np.std(means, axis=0), 0.01, 0.5)
        steady = np.clip(1.5 * np.median(np.abs(means - middle), axis=0), 0.01, 0.5)
        starts = [(middle, steady), (np.mean(means, axis=0), spread), (middle, 0.02 + 0.0 * spread)]
        starts += [(mean, 0.05 + 0.0 * spread) for mean in means] if len(means) <= _SHOT_STARTS else []
        u = np.array([self._to_u(*start) for start in starts])
        modes = [self._climb(start) for start in u[np.argsort(-self(u), kind="stable")[:_CLIMBED]]]
        places, widths, integrals = zip(*modes, strict=True)
        return Mixture.of_modes(places, widths, integrals)

    def _to_u(self, centre: Floats, spread: Floats) -> Floats:
        """u (m,) of a centre and a spread (d,)."""
        x = np.where(np.isfinite(self.prior.std), self.prior.mean, 0.5 * (self.prior.low + self.prior.high))
        x[: self.d], x[self.d : 2 * self.d] = centre, spread
        return self.prior.to_u(x, inside=1e-6)

    def _climb(self, u: Floats) -> tuple[Floats, Floats, float]:
        """A mode (m,) near u (m,), a covariance (m, m) about it, and the log of its integral."""
        steps = _STEP * np.eye(len(u))

        def falling(at: Floats) -> tuple[float, Floats]:
            value = self(np.concatenate([at[None], at + steps, at - steps]))
            up, down = np.split(value[1:], 2)
            return -float(value[0]), -(up - down) / (2.0 * _STEP)

        mode = minimize(falling, u, jac=True, method="BFGS", options={"maxiter": 60, "gtol": 1e-2})
        values, vectors = np.linalg.eigh(mode.hess_inv)
        values = np.clip(values, 1e-6, 2.0)  # hardly wider than the prior
        height = -float(mode.fun) + 0.5 * float(np.sum(np.log(values)))
        return np.clip(mode.x, -7.0, 7.0), (vectors * values) @ vectors.T, height


def _log_sum(log_p: Floats, first: np.ndarray) -> Floats:
    """(k, n) log of the sums of exp over the Gaussians (k, m) of each shot."""
    if len(first) == log_p.shape[1]:
        return log_p
    top = np.maximum.reduceat(log_p, first, axis=1)
    counts = np.diff(np.append(first, log_p.shape[1]))
    return np.asarray(top + np.log(np.add.reduceat(np.exp(log_p - np.repeat(top, counts, axis=1)), first, axis=1)))
