"""How the measured frames scatter about the simulation: noise of unknown size, and a discrepancy.

The residuals e of an experiment (experiment.py) are e ~ N(0, k^2 C) with C = D + r^2 K.

D = diag(d_i^2) the frames' assumed variances, k^2 an unknown factor on all of them (inverse gamma, shape A, scale A:
between 0.4 and 5.6 in 90 %), and K_ij = d^2 exp(-|t_i - t_j|/tau), an Ornstein-Uhlenbeck process: the discrepancy
between any simulation and a real bubble, alike in neighbouring frames. k^2 is integrated out exactly,

    p(e | r, tau) = Gamma(A + n/2)/Gamma(A) (2 pi A)^(-n/2) |C|^(-1/2) (1 + e' C^-1 e/(2 A))^-(A + n/2),

Student's t, and (r, tau) are summed over a grid: neither costs a simulation. K has a tridiagonal inverse T, so that
e' C^-1 e = e' D^-1 e - e' D^-1 (D^-1 + T/r^2)^-1 D^-1 e takes O(n) (Woodbury). Kennedy and O'Hagan 2001,
doi:10.1111/1467-9868.00294, on the discrepancy.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.special import gammaln, logsumexp

from cavirheo.arrays import Floats

SHAPE = 2.0  # A: the frame-to-frame noise is a good guess of the noise, but no more
RATIOS = (1.0, 2.0, 4.0, 8.0, 16.0)  # r: discrepancy over noise
TIMES = (0.03, 0.12, 0.5)  # tau/t_c: a collapse, a quarter of the first fall, half of it
ABSENT = 1.0 / (1 + len(RATIOS))  # prior probability that there is no discrepancy


class _Covariance:
    """C = D + r^2 K for one grid point; r = 0 is white noise."""

    def __init__(self, deviation: Floats, time: Floats, ratio: float, tau: float) -> None:
        self.weight = 1.0 / deviation**2
        self.log_det = 2.0 * float(np.sum(np.log(deviation)))
        self.factor: Floats | None = None
        if ratio > 0.0:
            rho = np.exp(-np.diff(time) / tau)
            gain = -np.expm1(-2.0 * np.diff(time) / tau)  # 1 - rho^2
            variance = (ratio * float(np.median(deviation))) ** 2
            band = np.zeros((2, len(time)))
            band[1] = 1.0
            band[1, 1:] += rho**2 / gain
            band[1, :-1] += rho**2 / gain
            band[0, 1:] = -rho / gain
            band /= variance
            band[1] += self.weight
            self.factor = cholesky_banded(band)
            self.log_det += len(time) * np.log(variance) + float(np.sum(np.log(gain)))
            self.log_det += 2.0 * float(np.sum(np.log(self.factor[1])))

    def solve(self, columns: Floats) -> Floats:
        """C^-1 columns, (n, k)."""
        weighted = columns * self.weight[:, None]
        if self.factor is None:
            return weighted
        return np.asarray(weighted - self.weight[:, None] * cho_solve_banded((self.factor, False), weighted))


class Noise:
    """The distribution of (n,) residuals at (n,) times, s, with assumed deviations (n,); tau in units of `scale`, s."""

    def __init__(self, deviation: Floats, time: Floats, scale: float, discrepancy: bool) -> None:
        self.deviation, self.size = deviation, len(deviation)
        grid = [(r, tau * scale) for r in RATIOS for tau in TIMES] if discrepancy else []
        self.grid = [(0.0, 1.0), *grid]
        self.parts = [_Covariance(deviation, time, *point) for point in self.grid]
        share = [ABSENT] + [(1.0 - ABSENT) / len(grid)] * len(grid) if grid else [1.0]
        self.log_prior = np.log(share)
        self.power = SHAPE + 0.5 * self.size
        constant = gammaln(self.power) - gammaln(SHAPE) - 0.5 * self.size * np.log(2.0 * np.pi * SHAPE)
        self.constants = constant - 0.5 * np.array([part.log_det for part in self.parts]) + self.log_prior

    def solved(self, columns: Floats) -> list[Floats]:
        """C^-1 columns, (n, k), for each grid point."""
        return [part.solve(columns) for part in self.parts]

    def joint(self, squares: Floats) -> Floats:
        """(grid, k) log joint density of grid point and residual, from e' C^-1 e (grid, k)."""
        return np.asarray(self.constants[:, None] - self.power * np.log1p(squares / (2.0 * SHAPE)))

    def _weighed(self, residuals: Floats) -> tuple[Floats, Floats, Floats]:
        """log density (k,) of residuals (n, k), the share of each grid point in it and e' C^-1 e, both (grid, k)."""
        squares = np.array([np.sum(residuals * part.solve(residuals), axis=0) for part in self.parts])
        terms = self.joint(squares)
        total = logsumexp(terms, axis=0)
        return total, np.exp(terms - total), squares

    def factor(self, squares: Floats) -> float:
        """k^2 on average over the grid, for one residual with e' C^-1 e (grid,)."""
        terms = self.joint(squares[:, None])[:, 0]
        return float(np.exp(terms - logsumexp(terms)) @ (SHAPE + 0.5 * squares) / self.power)

    def log_density(self, residuals: Floats) -> Floats:
        """(k,) of residuals (k, n); -inf where one is not finite."""
        found = np.full(len(residuals), -np.inf)
        good = np.all(np.isfinite(residuals), axis=1)
        if np.any(good):
            found[good] = self._weighed(residuals[good].T)[0]
        return found

    def newton(self, residual: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """Gradient (d,) and Gauss-Newton curvature (d, d) of -log density of measured minus simulated, (n,), with the
        simulated's `jacobian` (n, d)."""
        _, share, squares = self._weighed(residual[:, None])
        weight = (share * self.power / (SHAPE + 0.5 * squares))[:, 0]
        both = np.column_stack([jacobian, residual])
        solved = sum(w * part.solve(both) for w, part in zip(weight, self.parts, strict=True))
        product = jacobian.T @ solved
        return -product[:, -1], product[:, :-1]

    def describe(self, residual: Floats) -> dict[str, float]:
        """The noise over that assumed, the probability of a discrepancy, and its standard deviation, of a (n,)."""
        _, share, squares = self._weighed(residual[:, None])
        variance = (SHAPE + 0.5 * squares) / (self.power - 1.0)
        ratio = np.array([r for r, _ in self.grid])[:, None]
        sigma = float(np.median(self.deviation))
        return {
            "noise_over_assumed": float(np.sqrt(np.sum(share * variance))),
            "discrepancy_probability": float(1.0 - np.sum(share[0])),
            "discrepancy_over_rmax": sigma * float(np.sqrt(np.sum(share * variance * ratio**2))),
        }


def correlation_time(residual: Floats) -> float:
    """Frames per independent residual: 1 + 2 sum rho_k up to the first lag k whose autocorrelation is not positive.

    The integrated autocorrelation time; the sum is cut where noise begins, as by Geyer 1992, doi:10.1214/ss/1177011137.
    """
    r = residual - np.mean(residual)
    variance = float(r @ r)
    if variance == 0.0 or len(r) < 4:
        return 1.0
    tau = 1.0
    for lag in range(1, len(r) // 2):
        rho = float(r[:-lag] @ r[lag:]) / variance
        if rho <= 0:
            break
        tau += 2.0 * rho
    return min(tau, len(r) / 2.0)
