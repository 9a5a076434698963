"""How the measured frames scatter about the simulation: noise of unknown size, and a discrepancy.

The residuals e of an experiment (experiment.py) are e ~ N(0, k^2 C) with C = D + L K L + M K M.

D = diag(d_i^2) has the assumed variances of the frames, and k^2 is an unknown factor on C (inverse gamma, shape A,
scale A: between 0.4 and 5.6 in 90 %). K_ij = exp(-|t_i - t_j|/tau) is the covariance of an Ornstein-Uhlenbeck process.
Two such processes are the discrepancy between any simulation and a real bubble, which is alike in neighbouring frames:
the radius is wrong by r d, L = r d, and the simulated bubble is early or late by s d t_c/R_max, which moves a frame by
the wall's velocity, M = s d t_c U_i; d is the median of d_i. k^2 is integrated out exactly,

    p(e | r, s, tau) = Gamma(A + n/2)/Gamma(A) (2 pi A)^(-n/2) |C|^(-1/2) (1 + e' C^-1 e/(2 A))^-(A + n/2),

Student's t, and (r, s, tau) are summed over a grid. Neither needs a simulation. K has a tridiagonal inverse, so that e'
C^-1 e = e' D^-1 e - e' D^-1 H (P + H' D^-1 H)^-1 H' D^-1 e takes O(n) (Woodbury), with H = [L M] and P the inverses of
K for both, ordered by frame. On the discrepancy: Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.special import gammaln

from cavirheo.arrays import Bools, Floats, log_sum
from cavirheo.physics.cache import compiled

GAMMA_A = 2.0  # A: shape and scale of the prior of k^2; the assumed noise may be wrong by a factor of 2
RATIOS = (1.0, 3.0, 10.0)  # r: discrepancy of the radius over noise
CLOCK_RATIOS = (0.0, 1.0, 4.0)  # s/r
TIMES = (0.1, 0.5, 2.0)  # tau/t_c: a collapse, half of the first fall, the whole window
SEEN_SHARE = 1e-5  # a grid point with a smaller share of the density has no part in its slope
ABSENCE_PROBABILITY = 1.0 / 6.0  # prior probability that there is no discrepancy


class Noise:
    """The distribution of (n,) residuals at (n,) times, s, with assumed deviations (n,) and, for a discrepancy, the
    wall's velocities (n,), 1/s. scale: unit of tau and of the clock, s. typical: deviation of one frame, in units of
    which the discrepancy counts; by default the median deviation. constants: (grid,) the part of a log density that
    does not depend on e' C^-1 e."""

    def __init__(
        self, deviation: Floats, time: Floats, scale: float, discrepancy: bool, velocity: Floats | float = 0.0,
        typical: float | None = None,
    ) -> None:  # fmt: skip
        self.deviation, self.time, self.size, self.scale = deviation, time, len(deviation), scale
        some = [(r, r * s, tau * scale) for r in RATIOS for s in CLOCK_RATIOS for tau in TIMES] if discrepancy else []
        self.grid: list[tuple[float, float, float]] = [(0.0, 0.0, 1.0), *some]
        self.typical: float = float(np.median(deviation)) if typical is None else typical
        shapes = self.typical * np.stack([np.ones(self.size), np.broadcast_to(velocity * scale, self.size)], axis=1)
        self.covariances, log_det = Covariances.of(deviation, time, [(shapes * (r, s), tau) for r, s, tau in self.grid])
        share = [ABSENCE_PROBABILITY] + [(1.0 - ABSENCE_PROBABILITY) / len(some)] * len(some) if some else [1.0]
        self.log_prior: Floats = np.log(share)
        self.power: float = GAMMA_A + 0.5 * self.size
        constant = gammaln(self.power) - gammaln(GAMMA_A) - 0.5 * self.size * np.log(2.0 * np.pi * GAMMA_A)
        self.constants: Floats = constant - 0.5 * log_det + self.log_prior

    def without_discrepancy(self) -> Noise:
        """White noise with the same deviations."""
        return Noise(self.deviation, self.time, 1.0, False)

    def _shares(self, residuals: Floats) -> tuple[Floats, Floats, Floats]:
        """Log density (k,) of residuals (k, n), the share of each grid point in it and e' C^-1 e, both (grid, k)."""
        squares = np.asarray(squared(np.ascontiguousarray(residuals), *self.covariances))
        terms = self.constants[:, None] - self.power * np.log1p(squares / (2.0 * GAMMA_A))
        total = log_sum(terms, axis=0)
        return total, np.exp(terms - total), squares

    def log_density(self, residuals: Floats) -> Floats:
        """Log density (k,) of residuals (k, n); -inf where one is not finite."""
        log_density = np.full(len(residuals), -np.inf)
        good = np.all(np.isfinite(residuals), axis=1)
        if np.any(good):
            log_density[good] = self._shares(residuals[good])[0]
        return log_density

    def newton(self, residuals: Floats, jacobians: Floats) -> tuple[Floats, Floats]:
        """Gradients (m, d) and Gauss-Newton curvatures (m, d, d) of -log density of residuals (m, n), measured minus
        simulated; jacobians: (m, n, d) of the simulated frames. Where a residual is not finite there is no slope."""
        m, _, d = jacobians.shape
        gradients, curvatures = np.zeros((m, d)), np.zeros((m, d, d))
        shares = self._shares(residuals)[1]
        for i in np.flatnonzero(np.all(np.isfinite(residuals), axis=1)):
            used = np.flatnonzero(shares[:, i] > SEEN_SHARE)
            product = products(np.column_stack([jacobians[i], residuals[i]]), used, *self.covariances)
            trust = shares[used, i] * self.power / (GAMMA_A + 0.5 * product[:, d, d])
            gradients[i] = -trust @ product[:, :d, d]
            curvatures[i] = np.tensordot(trust, product[:, :d, :d], 1)
        return gradients, curvatures

    def _factors(self, residual: Floats) -> Floats:
        """(grid,) expected k^2 of each grid point by a residual (n,), times the share of the point."""
        _, share, squares = self._shares(residual[None])
        return np.asarray(share[:, 0] * (GAMMA_A + 0.5 * squares[:, 0]) / (self.power - 1.0))

    def deviations(self, residual: Floats, averaged: Floats) -> Floats:
        """(n,) standard deviations of one frame, noise and discrepancy, by a residual (n,) of means of so many frames
        (n,)."""
        factors = self._factors(residual)
        variances = self.deviation**2 * averaged + np.sum(self.covariances.shifts**2, axis=2)
        return np.asarray(np.sqrt(factors @ variances))

    def predicted_deviations(
        self, residual: Floats, velocity: Floats, compared: Bools, rng: np.random.Generator
    ) -> Floats:
        """(m,) standard deviations of one frame, noise and discrepancy, at other instants where the wall has these
        velocities (m,), 1/s, by a residual (n,). compared: (m,) whether these instants are among those of the compared
        frames. At others no frame tells the discrepancy: its size is drawn from its prior."""
        factors = self._factors(residual)
        ratio, clock_ratio, _ = np.array(self.grid).T[:, :, None]
        discrepancies = ratio**2 + (clock_ratio * self.scale * velocity) ** 2
        one = rng.choice(len(self.grid), p=np.exp(self.log_prior))
        unseen = discrepancies[one] * GAMMA_A / rng.gamma(GAMMA_A)
        variances = np.sum(factors) + np.where(compared, factors @ discrepancies, unseen)
        return np.asarray(self.typical * np.sqrt(variances))


class Covariances(NamedTuple):
    """C = D + sum of (h K h') over the columns h of `shifts`, for each grid point; white noise if these are 0. weight:
    (n,) diagonal of D^-1. shifts: (grid, n, 2). rank: (grid,) number of its columns that are not 0. factor: (grid, 3, 2
    n) the upper Cholesky factor of P + H' D^-1 H, diagonal by diagonal, with the main one last and inverted."""

    weight: Floats
    shifts: Floats
    rank: NDArray[np.int64]
    factor: Floats

    @classmethod
    def of(cls, deviation: Floats, time: Floats, grid: Sequence[tuple[Floats, float]]) -> tuple[Covariances, Floats]:
        """Covariances and log |C| (grid,) of deviations (n,) at times (n,) and (shifts (n, 2), tau) by grid point."""
        n, weight = len(time), 1.0 / deviation**2
        rank = np.array([np.count_nonzero(np.any(shifts != 0.0, axis=0)) for shifts, _ in grid])
        factor, log_det = np.zeros((len(grid), 3, 2 * n)), np.full(len(grid), 2.0 * float(np.sum(np.log(deviation))))
        for k, (shifts, tau) in enumerate(grid):
            columns = int(rank[k])
            if not columns:
                continue
            rho = np.exp(-np.diff(time) / tau)
            gain = -np.expm1(-2.0 * np.diff(time) / tau)  # 1 - rho^2
            band, inverse = np.zeros((columns + 1, columns * n)), np.ones(n)
            inverse[1:] += rho**2 / gain
            inverse[:-1] += rho**2 / gain
            for i in range(columns):
                band[-1, i::columns] = inverse + weight * shifts[:, i] ** 2
                band[0, columns + i :: columns] = -rho / gain
            if columns == 2:
                band[1, 1::2] = weight * shifts[:, 0] * shifts[:, 1]
            root = cholesky_banded(band)
            log_det[k] += columns * float(np.sum(np.log(gain))) + 2.0 * float(np.sum(np.log(root[-1])))
            root[-1] = 1.0 / root[-1]
            factor[k, 2 - columns :, : columns * n] = root
        return cls(weight, np.array([shifts for shifts, _ in grid]), rank, factor), log_det


@compiled
def products(
    columns: Floats, used: NDArray[np.int64], weight: Floats, shifts: Floats, rank: NDArray[np.int64], factor: Floats
) -> Floats:
    """columns' C^-1 columns (used, k, k) of columns (n, k) at these grid points, by Woodbury; the rest are fields of
    `Covariances`."""
    n, k = columns.shape
    white = np.zeros((k, k))
    for i in range(n):
        for a in range(k):
            for b in range(a + 1):
                white[a, b] += columns[i, a] * weight[i] * columns[i, b]
    product = np.empty((len(used), k, k))
    row, one_before, two_before = np.empty(k), np.empty(k), np.empty(k)
    for q in range(len(used)):
        p = used[q]
        m = rank[p]
        for a in range(k):  # numba compiles `product[q] = white` for seconds
            for b in range(a + 1):
                product[q, a, b] = white[a, b]
        one_before[:] = 0.0
        two_before[:] = 0.0
        for j in range(m * n):  # forward substitution, row by row
            i = j // m
            h = shifts[p, i, j - m * i] * weight[i]
            first_off, second_off = factor[p, 1, j], factor[p, 0, j]
            for a in range(k):
                row[a] = (h * columns[i, a] - first_off * one_before[a] - second_off * two_before[a]) * factor[p, 2, j]
            for a in range(k):
                for b in range(a + 1):
                    product[q, a, b] -= row[a] * row[b]
            for a in range(k):
                two_before[a] = one_before[a]
                one_before[a] = row[a]
        for a in range(k):
            for b in range(a):
                product[q, b, a] = product[q, a, b]
    return product


@compiled
def squared(residuals: Floats, weight: Floats, shifts: Floats, rank: NDArray[np.int64], factor: Floats) -> Floats:
    """(grid, k) e' C^-1 e of residuals (k, n): as `products`, each step for all residuals at once."""
    count, n = residuals.shape
    columns, white, squares = residuals.T.copy(), np.zeros(count), np.empty((len(rank), count))
    for i in range(n):
        for k in range(count):
            white[k] += weight[i] * columns[i, k] ** 2
    one_before, two_before = np.empty(count), np.empty(count)
    for p in range(len(rank)):
        m, total = rank[p], squares[p]
        one_before[:], two_before[:] = 0.0, 0.0
        for k in range(count):  # numba compiles `total[:] = white` for seconds
            total[k] = white[k]
        for j in range(m * n):
            i = j // m
            column, h = columns[i], shifts[p, i, j - m * i] * weight[i]
            first_off, second_off, inverse = factor[p, 1, j], factor[p, 0, j], factor[p, 2, j]
            for k in range(count):
                value = (h * column[k] - first_off * one_before[k] - second_off * two_before[k]) * inverse
                total[k] -= value * value
                two_before[k] = one_before[k]
                one_before[k] = value
    return squares
