"""What simulations near a maximum of the posterior say about it everywhere: a Gaussian process for the frames.

The residuals of all frames, in their few common directions, are Gaussian processes with one kernel (Rasmussen and
Williams 2006, ch. 2 and 5.4.2, gaussianprocess.org/gpml): a Matern function and a linear trend, of coordinates in which
frames are nearly linear, whitened by the posterior. (In u they are not: a stress is linear in a modulus, not in its
logarithm.) The process' own variance is added to that of the noise: where little is known the surrogate neither claims
a likely place nor excludes one. It only shapes proposals (proposals.py): what counts is simulated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from cavirheo.arrays import Floats, log_sum
from cavirheo.inference.noise import MarginalNoise
from cavirheo.inference.verify.mode import Target
from cavirheo.inference.verify.sampler import tempered
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parallel import each
from cavirheo.prior import log_normal

Real = NDArray[np.floating]  # of either precision
_TOGETHER = 10  # factors in a product


class Surrogate:
    """log of the posterior to be expected at u (k, d), from simulations at u (m, d) with residuals (m, n) and log
    posterior value (m,), all finite and more than 2 (d + 1)."""

    def __init__(self, target: Target, u: Floats, residual: Floats, value: Floats) -> None:
        kept = np.argsort(-value, kind="stable")[: TUNING.surrogate_simulations]
        likely = kept[value[kept] > value[kept[0]] - TUNING.flat_height]
        self.target: Target = target
        self.noise: MarginalNoise = target.noise.only(residual[likely], TUNING.grid_share)
        v, residual, below = target.linear(u[kept]), residual[kept], value[kept[0]] - value[kept]
        weight = np.exp(tempered(-below / TUNING.flat_height, TUNING.whitened * u.shape[1]))
        self.centre: Floats = weight @ v / np.sum(weight)
        off = v - self.centre
        self.unit: Floats = np.sqrt(weight @ off**2 / np.sum(weight)) + 1e-12 * np.abs(self.centre)
        off /= self.unit
        self.root: Floats = np.linalg.cholesky((off.T * weight) @ off / np.sum(weight) + 1e-9 * np.eye(off.shape[1]))
        self.z: Floats = self._whitened(u[kept])
        self.limit: float = TUNING.surrogate_reach**2 * float(np.max(np.sum(self.z**2, axis=1)))
        trust = (1.0 + below / TUNING.nugget_height) ** -2.0
        columns, along = _directions(residual, self.noise.deviation, trust / np.sum(trust))
        kernel = self._kernel(self.z)
        grown = np.minimum((1.0 + below / TUNING.nugget_height) ** 3, TUNING.nugget_most)
        kernel[np.diag_indices_from(kernel)] += TUNING.nugget * grown
        # L^-1 for K = L L': a product with it lets other threads run, a triangular solve does not
        root_inverse = solve_triangular(np.linalg.cholesky(kernel), np.eye(len(kernel)), lower=True)
        inverse = root_inverse.T @ root_inverse
        left_out = (inverse @ along) ** 2 / np.diag(inverse)[:, None]  # (y - y left out)^2 over its variance
        # what each call needs, in single precision: twice as fast, and wrong by a thousandth of the noise
        self.single: tuple[Real, Real] = self.z.astype(np.float32), root_inverse.T.astype(np.float32)
        self.coefficients: Real = (root_inverse @ along).astype(np.float32)
        size = np.sqrt(trust @ left_out / np.sum(trust)) + 1e-9  # of each process, (directions,)
        # for each covariance C of the noise: e' C^-1 e as a quadratic form of the directions, and its axes in units of
        # the processes' sizes
        forms = self.noise.products(columns)
        best = np.append(along[0], 1.0)
        self.scale: float = self.noise.factor(forms @ best @ best)  # k^2, as at the best
        values, axes = np.linalg.eigh(size[:, None] * forms[:, :-1, :-1] * size)
        small = 1e-12 * np.trace(forms, axis1=1, axis2=2)[:, None, None] * np.eye(len(best))
        across = np.swapaxes(axes, 1, 2) @ (size[:, None] * forms[:, :-1])
        self.rest: float = float(target.noise.split(residual[0])[2])  # of the integral over the camera: hardly changes
        self.stiff: Floats = np.maximum(values, 0.0)  # (covariances, directions)
        # side by side, for one product with all of them
        self.roots: Floats = np.concatenate([*np.linalg.cholesky(forms + small)], axis=1)
        self.across: Floats = np.concatenate([*np.swapaxes(across, 1, 2)], axis=1)

    def __call__(self, u: Floats) -> Floats:
        """(k,) at u (k, d), in blocks that do not depend on the number of threads: last digits would."""
        blocks = np.array_split(u, max(len(u) // 250, 1))  # smaller ones cost more than threads give
        return np.concatenate(each(self._expected, blocks, self.target.workers))

    def _expected(self, u: Floats) -> Floats:
        z = self._whitened(u)
        value = np.full(len(u), -np.inf)
        near = np.sum(z**2, axis=1) <= self.limit
        if not np.any(near):
            return value
        z = z[near]
        others, root_inverse = self.single
        known = self._kernel(z.astype(np.float32), others) @ root_inverse
        variance = np.maximum(2.0 + np.sum(z**2, axis=1) / z.shape[1] - np.sum(known**2, axis=1), 0.0)
        variance *= TUNING.hope / self.scale
        mean = np.column_stack([known @ self.coefficients, np.ones(len(z))])
        apart, count = (len(z), *self.stiff.shape), self.stiff.shape[1]
        # (C + V S V')^-1 and its determinant by Woodbury, S the variance of the processes
        whole, soft = (mean @ self.roots).reshape(len(z), len(self.stiff), -1), (mean @ self.across).reshape(apart)
        grown = variance[:, None, None] * self.stiff + 1.0
        squares = np.einsum("kpc,kpc->pk", whole, whole)
        squares -= variance * np.einsum("kpc,kpc->pk", soft, soft / grown)
        # by some at a time, so that no product is too large
        log_det = sum(np.log(np.prod(grown[:, :, i : i + _TOGETHER], axis=2)) for i in range(0, count, _TOGETHER))
        half_log_det = 0.5 / TUNING.hope * np.transpose(log_det)
        joint = self.noise.joint(np.maximum(squares, 0.0)) - half_log_det
        value[near] = log_sum(joint, axis=0) + self.rest + log_normal(u[near])
        return value

    def _whitened(self, u: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.root, ((self.target.linear(u) - self.centre) / self.unit).T).T)

    def _kernel(self, z: Real, other: Real | None = None) -> Real:
        """(k, m) Matern function of order 5/2 and linear trend."""
        other = z if other is None else other
        product = z @ other.T
        distance = np.sum(z**2, axis=1)[:, None] + np.sum(other**2, axis=1) - 2.0 * product
        distance = np.sqrt(np.maximum(distance, 0.0)) * float(np.sqrt(5.0) / TUNING.kernel_length)
        matern = ((distance / 3.0 + 1.0) * distance + 1.0) * np.exp(-distance)
        return np.asarray(matern + (product / z.shape[1] + 1.0), z.dtype)


def _directions(residual: Floats, deviation: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Columns (n, c + 1) and along (m, c): residual = columns @ [along, 1] but for what is far below the noise."""
    off = (residual - residual[0]) / deviation
    values, vectors = np.linalg.eigh((off.T * weight) @ off)
    count = int(np.clip(np.count_nonzero(values > TUNING.direction_share**2), 1, 40))
    vectors = vectors[:, ::-1][:, :count]
    return np.column_stack([vectors * deviation[:, None], residual[0]]), off @ vectors
