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
from dataclasses import dataclass
from typing import NamedTuple

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
_Gaussians = tuple[Floats, Floats, Floats]  # shares (k,), means (k, d) and covariances (k, d, d)


class Likelihood(NamedTuple):
    """exp(log_size) times the sum of share (k,) times Gaussians of means (k, d) and covariances (k, d, d), each
    integrated as `says` (k, d); effective: what the draws are worth."""

    log_size: float
    share: Floats
    mean: Floats
    covariance: Floats
    says: np.ndarray
    effective: float


@dataclass(frozen=True, eq=False)
class Likelihoods:
    """Those of n shots, their m Gaussians one after the other: log_share (m,), mean (m, d), covariance (m, d, d), says
    (m, d), shot (m,) to which each belongs, first (n,) of each shot; log_size: sum of the shots'."""

    log_share: Floats
    mean: Floats
    covariance: Floats
    says: np.ndarray
    shot: np.ndarray
    first: np.ndarray
    log_size: float

    @classmethod
    def of(cls, shots: Sequence[Likelihood]) -> Likelihoods:
        counts = np.array([len(shot.share) for shot in shots])
        share, mean, covariance, says = (
            np.concatenate([getattr(shot, name) for shot in shots]) for name in ("share", "mean", "covariance", "says")
        )
        first = np.cumsum(counts) - counts
        size = float(sum(shot.log_size for shot in shots))
        return cls(np.log(share), mean, covariance, says, np.repeat(np.arange(len(shots)), counts), first, size)

    @property
    def means(self) -> Floats:
        """(n, d) of the shots."""
        share = np.exp(self.log_share)[:, None]
        total = np.add.reduceat(share, self.first, axis=0)
        return np.asarray(np.add.reduceat(share * self.mean, self.first, axis=0) / total)

    def log_density(self, centre: Floats, slope_at: Floats, scatter: Floats) -> Floats:
        """(k, m) log of each Gaussian about centres (k, d) plus slopes (k, m, d), widened by a scatter (k, d, d)."""
        log_p = np.empty((len(centre), len(self.says)))
        for pattern in np.unique(self.says, axis=0):
            some = np.flatnonzero(np.all(self.says == pattern, axis=1))
            mean, base = self.mean[some], self.covariance[some]
            order = _order(pattern)
            off = [mean[:, i] - centre[:, i, None] - slope_at[:, some, i] for i in order]
            covariance = [[base[:, i, j] + scatter[:, i, j, None] for j in order[: a + 1]] for a, i in enumerate(order)]
            shape = (len(centre), len(some))
            log_p[:, some] = np.broadcast_to(log_gaussian(off, covariance, pattern[order]), shape)
        return log_p + self.log_share


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
    mean = weight @ theta
    whole = (theta - mean).T * weight @ (theta - mean)
    if not np.all(np.diag(whole) > 0):
        return None
    says = np.array([_SAYS[bound] for bound in bounds] or [VALUE] * d)
    fits = [_Fit(theta, weight, whole, says, ends)]
    single = (np.ones(1), mean[None], whole[None])
    if effective < FEW:  # the covariance is itself uncertain: that of Student's t, which predicts the next draw
        wider = effective / (effective - 1.0) * (effective + 1.0) / (effective - d - 2.0)
        share, mean, covariance = fits[0].mixture(1)[0] if np.any(says) else single
        return fits[0].likelihood(size, (share, mean, covariance * wider), effective)
    best, chosen, height = single, fits[0], -np.inf
    reaching = _reaching(theta, effective * weight, says, ends)
    if np.any(reaching != says):
        fits.append(_Fit(theta, weight, whole, reaching, ends))
    for fit in fits:
        before = -np.inf
        for k in range(1, min(_MOST, int(effective / _EACH)) + 1):
            gaussians, fitted = fit.mixture(k)
            information = effective * fitted - 0.5 * np.log(effective) * (k * (d + 1) * (d + 2) / 2 - 1)
            if information <= before:
                break
            before = information
            if information > height:
                best, chosen, height = gaussians, fit, information
    return chosen.likelihood(size, best if len(best[0]) > 1 or np.any(chosen.says) else single, effective)


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
    """Gaussians of draws theta (n, d) with weights that sum to 1 and their covariance (d, d); the first is as `says`
    (d,), the others are of values; ends: (2, d) of the prior."""

    def __init__(self, theta: Floats, weight: Floats, whole: Floats, says: np.ndarray, ends: Floats | None) -> None:
        self.theta, self.weight, self.whole, self.says = theta, weight, whole, says
        self.ends = np.array([np.min(theta, axis=0), np.max(theta, axis=0)]) if ends is None else ends
        self.bounded = [int(i) for i in np.flatnonzero(np.abs(says) == UPPER)]

    def likelihood(self, size: float, gaussians: _Gaussians, effective: float) -> Likelihood:
        share, mean, covariance = gaussians
        share = share.copy()
        share[0] /= self._volume(mean[0], covariance[0])
        says = np.zeros(mean.shape, dtype=int)
        says[0] = self.says
        return Likelihood(size, share, mean, covariance, says, effective)

    def mixture(self, k: int) -> tuple[_Gaussians, float]:
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
        mean, covariance = np.empty((k, d)), np.empty((k, d, d))
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
            share = share / np.sum(share)
            log_p = np.log(share)[:, None] + self._log_density(mean, covariance)
            total = np.logaddexp.reduce(log_p, axis=0)
            resp = np.exp(log_p - total)
            fitted = float(weight @ total)
            if fitted - before < (_BOUND_GAIN if self.bounded else _GAIN):
                break
            before = fitted
            self._fill(mean[0], covariance[0], filled[0], spare[0])
        return (share, mean, covariance), fitted

    def _log_density(self, mean: Floats, covariance: Floats) -> Floats:
        """(k, n), each with an integral of 1 over the prior's range."""
        off, d = mean[:, None] - self.theta[None], self.theta.shape[1]
        log_p = np.empty(off.shape[:2])
        for some, says in ((slice(0, 1), self.says), (slice(1, None), np.zeros(d, dtype=int))):
            order = _order(says)
            terms = [[covariance[some, i, j, None] for j in order[: a + 1]] for a, i in enumerate(order)]
            log_p[some] = log_gaussian([off[some, :, i] for i in order], terms, says[order])
        log_p[0] -= np.log(self._volume(mean[0], covariance[0]))
        return log_p

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


def _order(says: np.ndarray) -> np.ndarray:
    """Indices of the parameters that are said anything of: values first, then bounds, which may depend on them."""
    return np.concatenate([np.flatnonzero(says == VALUE), np.flatnonzero(np.abs(says) == UPPER)])


def log_gaussian(
    off: Sequence[Floats], covariance: Sequence[Sequence[Floats]], says: Sequence[int] | np.ndarray = ()
) -> Floats:
    """Log density at d distances mean - x, each an array, with the lower triangle of the covariances: Cholesky, written
    out. Those of bounds, which come last, are integrated from x on."""
    root: list[list[Floats]] = []
    whitened: list[Floats] = []
    log_p: Floats = np.zeros(off[0].shape if off else ())
    for i, distance in enumerate(off):
        row: list[Floats] = []
        for j in range(len(root)):
            row.append((covariance[i][j] - _dot(row, root[j][:j])) / root[j][j])
        row.append(np.sqrt(np.maximum(covariance[i][i] - _dot(row, row), 1e-300)))
        z = (distance - _dot(row[:-1], whitened)) / row[-1]
        if len(says) and says[i] != VALUE:
            log_p = log_p + log_ndtr(says[i] * z)
            continue
        whitened.append(z)
        root.append(row)
        log_p = log_p - 0.5 * z**2 - np.log(row[-1]) - 0.5 * np.log(2.0 * np.pi)
    return log_p


def _dot(first: Sequence[Floats], second: Sequence[Floats]) -> Floats | float:
    return sum((a * b for a, b in zip(first, second, strict=True)), start=0.0)
