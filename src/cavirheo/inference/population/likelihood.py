"""What one shot says of the material: its likelihood, as a few Gaussians, from weighted draws of its posterior.

Draws of a posterior, each over the density of the prior that they were made with, are draws of the likelihood (Hogg,
Myers and Bovy 2010, doi:10.1088/0004-637X/725/2/2166). As a sum over single draws they fail where the material is
narrower than the gaps between draws: a few nearest draws then decide. A mixture of Gaussians, fitted to them by
expectation maximisation, keeps their mean and covariance, has no gaps, and its convolution with a Gaussian population
is closed.

A shot that only bounds a parameter has draws up to the end of its prior, and would have them beyond it, too: there its
likelihood is constant. Its first Gaussian is then that of the bound y, not of the value m: the likelihood of m is the
integral of N(y) over all y beyond m, which is a normal distribution function of m (given the parameters with values,
on which the bound may depend). Its convolution with a Gaussian population is closed as well. What several bounds of
one shot have in common, given its values, is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import log_ndtr, logsumexp

from cavirheo.arrays import Floats
from cavirheo.parameters import Bound

FEW = 30.0  # effective draws of a shot, below which its interval is rough
_MOST = 4  # Gaussians of a shot
_EACH = 20.0  # effective draws for each
_STEPS, _GAIN = 40, 5e-4  # of expectation maximisation: most steps, and gain of log likelihood per draw at its end
_BOUND_STEPS, _BOUND_GAIN = 100, 3e-5  # the same where a bound is fitted, of which few draws say much
_END, _END_DRAWS = 0.1, 2.0  # of the range of a prior: near its end; effective draws there, from which it may be open
_THIN = 1e-4  # of the whole covariance, added to that of each Gaussian
VALUE, UPPER, LOWER, NOTHING = 0, 1, -1, 2  # what a Gaussian says of a parameter
_SAYS: dict[Bound | None, int] = {None: VALUE, "upper": UPPER, "lower": LOWER, "undetermined": NOTHING}


@dataclass(frozen=True, eq=False)
class Gaussians:
    """m Gaussians: share (m,), mean (m, d), covariance (m, d, d), each integrated as `says` (m, d)."""

    share: Floats
    mean: Floats
    covariance: Floats
    says: np.ndarray

    def log_densities(self, x: Floats, along: Floats, scatter: Floats) -> Floats:
        """(k, m) log of each Gaussian at x (k, d) plus (k, m, d) along a column, widened by a scatter (k, d, d)."""
        log_p = np.empty((len(x), len(self.says)))
        for pattern in np.unique(self.says, axis=0):
            some = np.flatnonzero(np.all(self.says == pattern, axis=1))
            mean, base = self.mean[some], self.covariance[some]
            order = np.concatenate([np.flatnonzero(pattern == VALUE), np.flatnonzero(np.abs(pattern) == UPPER)])
            off = [mean[:, i] - x[:, i, None] - along[:, some, i] for i in order]
            covariance = [[base[:, i, j] + scatter[:, i, j, None] for j in order[: a + 1]] for a, i in enumerate(order)]
            log_p[:, some] = np.broadcast_to(_log_gaussian(off, covariance, pattern[order]), (len(x), len(some)))
        return log_p


@dataclass(frozen=True, eq=False)
class Likelihood(Gaussians):
    """Of a shot: exp(log_size) times the sum of its Gaussians; effective: what the draws are worth."""

    log_size: float
    effective: float


@dataclass(frozen=True, eq=False)
class Likelihoods(Gaussians):
    """Those of n shots one after the other: shot (m,) to which each belongs, first (n,) of each shot; log_size: sum of
    the shots'."""

    shot: np.ndarray
    first: np.ndarray
    log_size: float

    @classmethod
    def of(cls, shots: Sequence[Likelihood]) -> Likelihoods:
        counts = np.array([len(shot.share) for shot in shots])
        names = [field.name for field in fields(Gaussians)]
        parts: Any = {name: np.concatenate([getattr(shot, name) for shot in shots]) for name in names}
        of, first = np.repeat(np.arange(len(shots)), counts), np.cumsum(counts) - counts
        return cls(**parts, shot=of, first=first, log_size=float(sum(shot.log_size for shot in shots)))

    @cached_property
    def log_share(self) -> Floats:
        """(m,)"""
        return np.log(self.share)

    @property
    def means(self) -> Floats:
        """(n, d) of the shots."""
        share = np.exp(self.log_share)[:, None]
        total = np.add.reduceat(share, self.first, axis=0)
        return np.asarray(np.add.reduceat(share * self.mean, self.first, axis=0) / total)


def likelihood(
    theta: Floats,
    log_weight: Floats,
    log_prior: Floats,
    bounds: Sequence[Bound | None] = (),
    ends: Floats | None = None,
) -> Likelihood | None:
    """Of draws theta (k, d) of a posterior with log weights and log density of their prior (k,); None where they are
    worth too little for a covariance. bounds: what is known of each parameter that has no value, in the range `ends`
    (2, d) of its prior."""
    log_weight = log_weight - logsumexp(log_weight) - log_prior
    size = float(logsumexp(log_weight))
    weight = np.exp(log_weight - size)
    effective, d = 1.0 / float(np.sum(weight**2)), theta.shape[1]
    if not effective > d + 3:
        return None
    says = np.array([_SAYS[bound] for bound in bounds] or [VALUE] * d)
    fits = [_Fit(theta, weight, says, ends)]
    if not np.all(np.diag(fits[0].whole) > 0):
        return None
    if effective < FEW:  # the covariance is itself uncertain: that of Student's t, which predicts the next draw
        wider = effective / (effective - 1.0) * (effective + 1.0) / (effective - d - 2.0)
        few, _ = fits[0].mixture(1)
        return fits[0].likelihood(size, replace(few, covariance=few.covariance * wider), effective)
    reaching = _reaching(theta, effective * weight, says, ends)
    if np.any(reaching != says):
        fits.append(_Fit(theta, weight, reaching, ends))
    candidates: list[tuple[float, _Fit, Gaussians]] = []
    for fit in fits:
        for k in range(1, min(_MOST, int(effective / _EACH)) + 1):
            gaussians, fitted = fit.mixture(k)
            information = effective * fitted - 0.5 * np.log(effective) * (k * (d + 1) * (d + 2) / 2 - 1)
            if k > 1 and information <= candidates[-1][0]:
                break
            candidates.append((information, fit, gaussians))
    _, fit, gaussians = max(candidates, key=lambda candidate: candidate[0])
    return fit.likelihood(size, gaussians, effective)


def _reaching(theta: Floats, effective: Floats, says: np.ndarray, ends: Floats | None) -> np.ndarray:
    """`says` (d,), with a bound for each value whose tail of draws theta (k, d), worth `effective` (k,), reaches an end
    of the prior: most draws tell a value, and some that it may as well be anything beyond."""
    if ends is None:
        return says
    width = _END * (ends[1] - ends[0])
    mass = np.array([effective @ (theta < ends[0] + width), effective @ (theta > ends[1] - width)])
    tail = np.where(mass[0] >= mass[1], UPPER, LOWER)
    return np.where((says == VALUE) & (np.max(mass, axis=0) >= _END_DRAWS), tail, says)


class _Fit:
    """Gaussians of draws theta (n, d) with weights that sum to 1; the first is as `says` (d,), the others are of
    values; ends: (2, d) of the prior. whole: (d, d) covariance of the draws."""

    def __init__(self, theta: Floats, weight: Floats, says: np.ndarray, ends: Floats | None) -> None:
        self.theta, self.weight, self.says, self.mean = theta, weight, says, weight @ theta
        self.whole: Floats = (theta - self.mean).T * weight @ (theta - self.mean)
        self.ends = np.array([np.min(theta, axis=0), np.max(theta, axis=0)]) if ends is None else ends
        self.bounded = [int(i) for i in np.flatnonzero(np.abs(says) == UPPER)]

    def likelihood(self, size: float, gaussians: Gaussians, effective: float) -> Likelihood:
        share = gaussians.share.copy()
        share[0] /= self._volume(gaussians.mean[0], gaussians.covariance[0])
        return Likelihood(share, gaussians.mean, gaussians.covariance, gaussians.says, size, effective)

    def mixture(self, k: int) -> tuple[Gaussians, float]:
        """k Gaussians by expectation maximisation, begun with slices across the longest axis; mean log density."""
        theta, weight, d = self.theta, self.weight, self.theta.shape[1]
        along = theta @ np.linalg.eigh(self.whole)[1][:, -1]
        order = np.argsort(along, kind="stable")
        rank = np.empty(len(along))
        rank[order] = np.cumsum(weight[order]) - 0.5 * weight[order]
        slices = k - 1 if np.any(self.says) and k > 1 else k
        resp = (np.minimum((rank * slices).astype(int), slices - 1) == np.arange(slices)[:, None]).astype(float)
        if slices < k:  # the bound is of all draws
            resp = 0.5 * np.concatenate([np.ones((1, len(theta))), resp])
        filled, spare = np.repeat(theta[None], k, axis=0), np.zeros((k, len(theta), d))
        mean, covariance, says = np.empty((k, d)), np.empty((k, d, d)), np.zeros((k, d), dtype=int)
        says[0] = self.says
        for i in self.bounded:  # begun where an edge as sharp as a tenth of the draws has half of its height
            edge = 0.9 if self.says[i] == UPPER else 0.1
            filled[0, :, i] = np.quantile(theta[:, i], edge, weights=weight, method="inverted_cdf")
            spare[0, :, i] = 0.01 * self.whole[i, i]
        before, steps = -np.inf, _BOUND_STEPS if self.bounded else _STEPS if k > 1 else 1
        for step in range(steps):
            mass = resp * weight
            share = np.maximum(np.sum(mass, axis=1), 1e-12)
            mean = np.einsum("kn,kni->ki", mass, filled) / share[:, None]
            mean[0] -= self._pull(mean[0], covariance[0]) if step else 0.0
            off = filled - mean[:, None]
            covariance = np.einsum("kn,kni,knj->kij", mass, off, off) / share[:, None, None] + _THIN * self.whole
            covariance += np.eye(d) * np.einsum("kn,kni->ki", mass, spare)[:, None] / share[:, None, None]
            gaussians = Gaussians(share / np.sum(share), mean, covariance, says)
            densities = gaussians.log_densities(theta, np.zeros((1, k, d)), np.zeros((1, d, d)))
            log_p = np.ascontiguousarray(densities.T)
            log_p[0] -= np.log(self._volume(mean[0], covariance[0]))  # an integral of 1 over the prior's range
            log_p += np.log(gaussians.share)[:, None]
            total = np.logaddexp.reduce(log_p, axis=0)
            resp = np.exp(log_p - total)
            fitted = float(weight @ total)
            if fitted - before < (_BOUND_GAIN if self.bounded else _GAIN):
                break
            before = fitted
            self._fill(mean[0], covariance[0], filled[0], spare[0])
        if k == 1 and not np.any(self.says):
            gaussians = Gaussians(np.ones(1), self.mean[None], self.whole[None], says)
        return gaussians, fitted

    def _volume(self, mean: Floats, covariance: Floats) -> float:
        """The integral of the first Gaussian, as it is integrated, over the prior's range."""
        flat = np.flatnonzero(self.says == NOTHING)
        volume = float(np.prod(self.ends[1, flat] - self.ends[0, flat]))
        for i in self.bounded:
            room, deviation = self._room(mean, i), np.sqrt(covariance[i, i])
            density = np.exp(-0.5 * (room / deviation) ** 2) / np.sqrt(2.0 * np.pi)
            volume *= room * np.exp(log_ndtr(room / deviation)) + deviation * density
        return volume

    def _room(self, mean: Floats, i: int) -> float:
        """From the end of the prior to a bound."""
        return float(mean[i] - self.ends[0, i] if self.says[i] == UPPER else self.ends[1, i] - mean[i])

    def _pull(self, mean: Floats, covariance: Floats) -> Floats:
        """(d,) by which the mean of the bounds lies nearer to the end than that of the draws': a far bound has more."""
        pull = np.zeros(len(mean))
        for i in self.bounded:
            room, deviation = max(self._room(mean, i), 1e-3), np.sqrt(covariance[i, i])
            pull += self.says[i] * covariance[:, i] / max(room, deviation)
        return pull

    def _fill(self, mean: Floats, covariance: Floats, filled: Floats, spare: Floats) -> None:
        """For the draws (n, d), given their values: the expected bound beyond each, and its variance."""
        valued = np.flatnonzero(self.says == VALUE)
        off = self.theta[:, valued] - mean[valued]
        for i in self.bounded:
            along = np.linalg.solve(covariance[np.ix_(valued, valued)], covariance[valued, i])
            deviation = np.sqrt(max(covariance[i, i] - along @ covariance[valued, i], 1e-12))
            middle, sign = mean[i] + off @ along, float(self.says[i])
            least = sign * (self.theta[:, i] - middle) / deviation
            hazard = np.exp(-0.5 * least**2 - 0.5 * np.log(2.0 * np.pi) - log_ndtr(-least))
            filled[:, i] = middle + sign * deviation * hazard
            spare[:, i] = deviation**2 * np.maximum(1.0 + least * hazard - hazard**2, 0.0)


def _log_gaussian(off: Sequence[Floats], covariance: Sequence[Sequence[Floats]], says: np.ndarray) -> Floats:
    """Log density at d distances mean - x, each an array, with the lower triangle of the covariances: Cholesky, written
    out. Those of bounds, which come last, as they may depend on the values, are integrated from x on."""
    root: list[list[Floats]] = []
    whitened: list[Floats] = []
    log_p: Floats = np.zeros(off[0].shape if off else ())
    for i, distance in enumerate(off):
        row: list[Floats] = []
        for j in range(len(root)):
            row.append((covariance[i][j] - _dot(row, root[j][:j])) / root[j][j])
        row.append(np.sqrt(np.maximum(covariance[i][i] - _dot(row, row), 1e-300)))
        z = (distance - _dot(row[:-1], whitened)) / row[-1]
        if says[i] != VALUE:
            log_p = log_p + log_ndtr(says[i] * z)
            continue
        whitened.append(z)
        root.append(row)
        log_p = log_p - 0.5 * z**2 - np.log(row[-1]) - 0.5 * np.log(2.0 * np.pi)
    return log_p


def _dot(first: Sequence[Floats], second: Sequence[Floats]) -> Floats | float:
    return sum((a * b for a, b in zip(first, second, strict=True)), start=0.0)
