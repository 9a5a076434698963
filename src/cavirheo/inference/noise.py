"""How the measured frames scatter about the simulation: noise of unknown size, and a discrepancy.

The residuals e of an experiment (experiment.py) are e ~ N(0, k^2 C) with C = D + L K L + M K M.

D = diag(d_i^2) the frames' assumed variances, k^2 an unknown factor on all of them (inverse gamma, shape A, scale A:
between 0.4 and 5.6 in 90 %). K_ij = exp(-|t_i - t_j|/tau) is an Ornstein-Uhlenbeck process, and two of them are the
discrepancy between any simulation and a real bubble, alike in neighbouring frames: the radius is off by r d, L = r d,
and the simulated bubble is early or late by s d t_c/R_max, which moves a frame by the wall's velocity, M = s d t_c U_i;
d is the median of d_i. k^2 is integrated out exactly,

    p(e | r, s, tau) = Gamma(A + n/2)/Gamma(A) (2 pi A)^(-n/2) |C|^(-1/2) (1 + e' C^-1 e/(2 A))^-(A + n/2),

Student's t, and (r, s, tau) are summed over a grid: neither costs a simulation. K has a tridiagonal inverse, so that
e' C^-1 e = e' D^-1 e - e' D^-1 H (P + H' D^-1 H)^-1 H' D^-1 e takes O(n) (Woodbury), H = [L M] and P the inverse of K
for each of them, frame by frame. Kennedy and O'Hagan 2001, doi:10.1111/1467-9868.00294, on the discrepancy.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dpbtrs
from scipy.special import gammaln

from cavirheo.arrays import Floats, log_sum

SHAPE = 2.0  # A: the frame-to-frame noise is a good guess of the noise, but no more
RATIOS = (1.0, 3.0, 10.0)  # r: discrepancy of the radius over noise
CLOCKS = (0.0, 1.0, 4.0)  # s/r
TIMES = (0.1, 0.5, 2.0)  # tau/t_c: a collapse, half of the first fall, the whole window
UNSEEN = 1e6  # deviation of the number of an extended residual that has no distribution
DENSE = 450  # frames, up to which an inverse is kept
ABSENT = 1.0 / 6.0  # prior probability that there is no discrepancy


class _Covariance:
    """C = D + sum of (h K h') over the columns h of `moved` (n, m) for one grid point; without columns, white noise."""

    def __init__(self, deviation: Floats, time: Floats, tau: float, moved: Floats) -> None:
        self.weight, self.moved = 1.0 / deviation**2, moved
        self.log_det = 2.0 * float(np.sum(np.log(deviation)))
        self.factor: Floats | None = None
        if count := moved.shape[1]:
            rho = np.exp(-np.diff(time) / tau)
            gain = -np.expm1(-2.0 * np.diff(time) / tau)  # 1 - rho^2
            band = np.zeros((count + 1, moved.size))
            inverse = np.ones(len(time))
            inverse[1:] += rho**2 / gain
            inverse[:-1] += rho**2 / gain
            for i in range(count):
                band[-1, i::count] = inverse + self.weight * moved[:, i] ** 2
                band[0, count + i :: count] = -rho / gain
            if count == 2:
                band[1, 1::2] = self.weight * moved[:, 0] * moved[:, 1]
            self.factor = cholesky_banded(band)
            self.log_det += count * float(np.sum(np.log(gain))) + 2.0 * float(np.sum(np.log(self.factor[-1])))

    def solve(self, columns: Floats) -> Floats:
        """C^-1 columns, (n, k)."""
        weighted = columns * self.weight[:, None]
        if self.factor is None:
            return weighted
        along = (self.moved[:, :, None] * weighted[:, None]).reshape(self.moved.size, -1)
        off = dpbtrs(self.factor, along)[0].reshape(*self.moved.shape, -1)  # cho_solve_banded without its checks
        return np.asarray(weighted - self.weight[:, None] * np.sum(self.moved[:, :, None] * off, axis=1))


class Noise:
    """The distribution of (n,) residuals at (n,) times, s, with assumed deviations (n,) and, with a discrepancy, the
    wall's velocities (n,), 1/s; tau and the clock in units of `scale`, s."""

    def __init__(
        self, deviation: Floats, time: Floats, scale: float, discrepancy: bool, velocity: Floats | float = 0.0
    ) -> None:
        self.deviation: Floats = deviation
        self.size: int = len(deviation)
        some = [(r, r * s, tau * scale) for r in RATIOS for s in CLOCKS for tau in TIMES] if discrepancy else []
        self.grid: list[tuple[float, float, float]] = [(0.0, 0.0, 1.0), *some]
        sigma = float(np.median(deviation))
        shapes = sigma * np.stack([np.ones(self.size), np.broadcast_to(velocity * scale, self.size)], axis=1)
        moved = [(tau, self._moved(shapes, r, s)) for r, s, tau in self.grid]
        self.parts: list[_Covariance] = [_Covariance(deviation, time, *one) for one in moved]
        share = [ABSENT] + [(1.0 - ABSENT) / len(some)] * len(some) if some else [1.0]
        self.log_prior: Floats = np.log(share)
        self.power: float = SHAPE + 0.5 * self.size
        constant = gammaln(self.power) - gammaln(SHAPE) - 0.5 * self.size * np.log(2.0 * np.pi * SHAPE)
        self.constants: Floats = constant - 0.5 * np.array([part.log_det for part in self.parts]) + self.log_prior

    @cached_property
    def inverses(self) -> Floats | None:
        """(parts, n, n) C^-1 of each: one product with all of them takes a tenth of as many banded solves. None for
        more frames than that holds for."""
        return np.array([part.solve(np.eye(self.size)) for part in self.parts]) if self.size <= DENSE else None

    def solved_together(self, columns: Floats) -> Floats:
        """(parts, n, k) C^-1 columns, (n, k)."""
        return np.array(self.solved(columns)) if self.inverses is None else np.asarray(self.inverses @ columns)

    @staticmethod
    def _moved(shapes: Floats, *sizes: float) -> Floats:
        return (shapes * sizes)[:, np.array(sizes) > 0]

    def only(self, residuals: Floats, least: float) -> Noise:
        """With the grid points alone that have a share of `least` in the density of any of residuals (k, n)."""
        share = np.max(self._weighed(residuals.T)[1], axis=1)
        found = copy(self)
        found.parts = [part for part, most in zip(self.parts, share, strict=True) if most > least]
        found.constants = self.constants[share > least]
        if self.inverses is not None:
            found.__dict__["inverses"] = self.inverses[share > least]
        return found

    def solved(self, columns: Floats) -> list[Floats]:
        """C^-1 columns, (n, k), for each grid point."""
        return [part.solve(columns) for part in self.parts]

    def joint(self, squares: Floats) -> Floats:
        """(grid, k) log joint density of grid point and residual, from e' C^-1 e (grid, k)."""
        return np.asarray(self.constants[:, None] - self.power * np.log1p(squares / (2.0 * SHAPE)))

    def _weighed(self, residuals: Floats) -> tuple[Floats, Floats, Floats]:
        """log density (k,) of residuals (n, k), the share of each grid point in it and e' C^-1 e, both (grid, k)."""
        squares = np.sum(residuals * self.solved_together(residuals), axis=1)
        terms = self.joint(squares)
        total = log_sum(terms, axis=0)
        return total, np.exp(terms - total), squares

    def factor(self, squares: Floats) -> float:
        """k^2 on average over the grid, for one residual with e' C^-1 e (grid,)."""
        terms = self.joint(squares[:, None])[:, 0]
        return float(np.exp(terms - log_sum(terms)) @ (SHAPE + 0.5 * squares) / self.power)

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
        return self.expanded(residual, jacobian)[1:]

    def expanded(self, residual: Floats, jacobian: Floats) -> tuple[float, Floats, Floats]:
        """Log density of a residual (n,), and what `newton` gives."""
        both = np.column_stack([jacobian, residual])
        products = both.T @ self.solved_together(both)
        squares = products[:, -1, -1]
        terms = self.joint(squares[:, None])[:, 0]
        total = float(log_sum(terms))
        weight = np.exp(terms - total) * self.power / (SHAPE + 0.5 * squares)
        product = np.tensordot(weight, products, 1)
        return total, -product[:-1, -1], product[:-1, :-1]

    def describe(self, residual: Floats) -> dict[str, float]:
        """The noise over that assumed, the probability of a discrepancy, and its standard deviation, of a (n,)."""
        _, share, squares = self._weighed(residual[:, None])
        variance = (SHAPE + 0.5 * squares) / (self.power - 1.0)
        moved = np.array([np.sum(part.moved**2) for part in self.parts])[:, None] / self.size
        return {
            "noise_over_assumed": float(np.sqrt(np.sum(share * variance))),
            "discrepancy_probability": float(1.0 - np.sum(share[0])),
            "discrepancy_over_rmax": float(np.sqrt(np.sum(share * variance * moved))),
        }


class MarginalNoise:
    """The distribution of extended residuals (k, n + m + 1), which hold m pulls and the logarithm of the rest of an
    integral over the camera (camera.py) beside the n frames that `frames` is about.

    parts, power, constants, joint: of `frames`. pull: k^2 of the frames, by which the pulls' squares are multiplied
    where the frames' are to be divided by it.
    """

    def __init__(self, frames: Noise, pulls: int) -> None:
        self.frames, self.pulls, self.pull = frames, pulls, 1.0
        self.deviation: Floats = np.concatenate([frames.deviation, np.ones(pulls), [UNSEEN]])
        self.size: int = len(self.deviation)

    @property
    def parts(self) -> list[_Covariance]:
        return self.frames.parts

    @property
    def power(self) -> float:
        return self.frames.power

    @property
    def constants(self) -> Floats:
        return self.frames.constants

    def joint(self, squares: Floats) -> Floats:
        """As that of `frames`."""
        return self.frames.joint(squares)

    def factor(self, squares: Floats) -> float:
        """As that of `frames`."""
        return self.frames.factor(squares)

    def split(self, residuals: Floats) -> tuple[Floats, Floats, Floats]:
        """Frames (..., n), pulls (..., m) and the logarithm of the rest (...,)."""
        n = self.frames.size
        return residuals[..., :n], residuals[..., n : n + self.pulls], residuals[..., n + self.pulls]

    def log_density(self, residuals: Floats) -> Floats:
        """(k,) of extended residuals (k, size); -inf where one is not finite."""
        frames, pulls, rest = self.split(residuals)
        found = self.frames.log_density(frames) - 0.5 * np.sum(pulls**2, axis=1) + rest
        return np.where(np.isfinite(found), found, -np.inf)

    def newton(self, residual: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
        """As that of `frames`, of an extended residual (size,) with the derivatives (size, d)."""
        frames, pulls, _ = self.split(residual)
        by_frames, by_pulls, by_rest = (part.T for part in self.split(jacobian.T))
        gradient, curvature = self.frames.newton(frames, by_frames)
        return gradient - by_pulls.T @ pulls + by_rest, curvature + by_pulls.T @ by_pulls

    def only(self, residuals: Floats, least: float) -> MarginalNoise:
        """As that of `frames`; its `pull` is that of the first of the residuals."""
        frames = self.split(residuals)[0]
        found = copy(self)
        found.frames = self.frames.only(frames, least)
        squares = np.array([frames[0] @ part.solve(frames[:1].T)[:, 0] for part in found.frames.parts])
        found.pull = found.frames.factor(squares)
        return found

    def solved(self, columns: Floats) -> list[Floats]:
        """C^-1 columns, (size, k), for each grid point; that of the pulls is `pull`, that of the rest is nothing."""
        frames, pulls, _ = (part.T for part in self.split(columns.T))
        nothing = np.zeros((1, columns.shape[1]))
        return [np.concatenate([part, self.pull * pulls, nothing]) for part in self.frames.solved(frames)]

    def describe(self, residual: Floats) -> dict[str, float]:
        """As that of `frames`."""
        return self.frames.describe(self.split(residual)[0])


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
