"""What simulations near a maximum of the posterior say about it everywhere: a Gaussian process for the bubble.

The shape of the bubble (camera.py) is in its few common directions a set of Gaussian processes with one kernel
(Rasmussen and Williams 2006, ch. 2 and 5.4.2, gaussianprocess.org/gpml) of coordinates in which it is nearly linear,
whitened by the posterior. (In u it is not: a stress is linear in a modulus, not in its logarithm.) A camera films it
then as it films a simulation: at an instant R has a kink where a collapse passes, a shape has none. Clock, scale and
factor are coordinates of the surrogate beside u. The kernel is the one that tells simulations best which are left out.

Its draws are the answer if default simulations of some agree; else they are simulated and weighed (proposals.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.inference.noise import MarginalNoise
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, trust_in
from cavirheo.inference.verify.sampler import tempered
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parallel import each
from cavirheo.physics.accuracy import BRISK, ROUGH, Accuracy
from cavirheo.prior import log_normal


class Kernel(NamedTuple):
    """Matern function of order 5/2 with this length times `matern`, and (1 + z z'/scale)^2; nugget: of a likely
    simulation. Lengths are in standard deviations of the (flattened) posterior."""

    matern: float
    length: float
    scale: float
    nugget: float

    def __call__(self, z: Floats, others: Floats) -> Floats:
        """(k, m) of z (k, d) and others (m, d)."""
        product = z @ others.T
        distance = -2.0 * product
        distance += np.sum(z**2, axis=1)[:, None]
        distance += np.sum(others**2, axis=1)
        np.sqrt(np.maximum(distance, 0.0, out=distance), out=distance)
        distance *= np.sqrt(5.0) / self.length
        matern = distance / 3.0  # in place, for the time goes into memory
        matern += 1.0
        matern *= distance
        matern += 1.0
        matern *= np.exp(np.negative(distance, out=distance), out=distance)
        matern *= self.matern
        product /= self.scale
        product += 1.0
        matern += np.square(product, out=product)
        return np.asarray(matern)


# a smooth posterior takes the last, one where the law changes what the bubble does the first
KERNELS = (Kernel(1.0, 4.0, 30.0, 1e-4), Kernel(1.0, 8.0, 30.0, 1e-4), Kernel(0.0, 8.0, 16.0, 1e-4))


class Surrogate:
    """log of the posterior of u and the camera's z, from simulations at u (k, d) with extended residuals (k, size) and
    log posterior value (k,), all finite and more than 2 (d + 1).

    scatter: of the log posterior of likely simulations, each with its most likely camera, about what the others tell of
    it.
    """

    def __init__(self, target: Target, u: Floats, residual: Floats, value: Floats) -> None:
        latest = np.arange(len(u)) >= len(u) - TUNING.surrogate_latest  # they tell where the last surrogate was wrong
        chosen = np.lexsort((-value, ~latest))[: TUNING.surrogate_latest + TUNING.surrogate_likely]
        chosen = chosen[np.argsort(-value[chosen], kind="stable")]
        u, residual, value = u[chosen], residual[chosen], value[chosen]
        below = value[0] - value
        high = below < TUNING.flat_height
        likely = np.flatnonzero(high)[: TUNING.left_out]
        self.target: Target = target
        self.noise: MarginalNoise = target.noise.only(residual[high], TUNING.grid_share)
        v, weight = target.linear(u), np.exp(tempered(-below / TUNING.flat_height, TUNING.whitened * u.shape[1]))
        self.centre: Floats = weight @ v / np.sum(weight)
        off = v - self.centre
        self.unit: Floats = np.sqrt(weight @ off**2 / np.sum(weight)) + 1e-12 * np.abs(self.centre)
        off /= self.unit
        self.root: Floats = np.linalg.cholesky((off.T * weight) @ off / np.sum(weight) + 1e-9 * np.eye(off.shape[1]))
        self.z: Floats = self._whitened(u)
        self.limit: float = TUNING.surrogate_reach**2 * float(np.max(np.sum(self.z**2, axis=1)))
        trust = trust_in(value)
        shapes = target.noise.shapes(residual)
        self.best: Floats = shapes[0]
        self.axes, along = _directions(shapes - self.best, self._metric(), trust / np.sum(trust))
        camera = target.camera.z(residual)[likely]
        exact = self._log_density(u[likely], camera, shapes[likely])
        grown = np.minimum((1.0 + below / TUNING.nugget_height) ** 3, TUNING.nugget_most)
        self.scatter = np.inf
        for kernel in KERNELS:
            matrix = kernel(self.z, self.z)
            matrix[np.diag_indices_from(matrix)] += kernel.nugget * grown
            inverse = np.linalg.inv(matrix)
            coefficients = inverse @ along
            missed = coefficients / np.diag(inverse)[:, None]  # of each, by the others
            predicted = self._log_density(u[likely], camera, self._shapes(along[likely] - missed[likely]))
            scatter = _scatter(predicted - exact, trust[likely])
            if scatter < self.scatter:
                self.scatter, self.kernel, self.coefficients = scatter, kernel, coefficients

    def __call__(self, w: Floats) -> Floats:
        """(k,) at w (k, d + m), u and z beside each other, in blocks that do not depend on the number of threads: last
        digits would."""
        blocks = np.array_split(w, max(len(w) // 500, 1))
        return np.concatenate(each(self._expected, blocks, self.target.workers))

    def _expected(self, w: Floats) -> Floats:
        u, camera = np.split(w, [len(self.centre)], axis=1)
        z, value = self._whitened(u), np.full(len(u), -np.inf)
        reached = np.sum(z**2, axis=1) <= self.limit
        if np.any(reached):
            value[reached] = self._log_density(u[reached], camera[reached], self._shapes(self._along(z[reached])))
        return value

    def _log_density(self, u: Floats, camera: Floats, shapes: Floats) -> Floats:
        """(k,) of u (k, d) and a camera z (k, m) for bubbles of these shapes (k, numbers)."""
        return self.noise.log_density(self.target.extended(shapes, camera)) + log_normal(u)

    def shapes(self, u: Floats) -> Floats:
        """(k, numbers) of the bubbles at u (k, d)."""
        return self._shapes(self._along(self._whitened(u)))

    def _along(self, z: Floats) -> Floats:
        """(k, directions) how far the bubbles at whitened places z (k, d) are from the best."""
        return np.asarray(self.kernel(z, self.z) @ self.coefficients)

    def _shapes(self, along: Floats) -> Floats:
        """(k, numbers) of bubbles that are `along` (k, directions) the directions from the best."""
        return self.best + along @ self.axes

    def _metric(self) -> Floats:
        """(numbers,) what each number of a shape counts, over the noise."""
        camera, deviation = self.target.camera, self.noise.frames.typical
        metric = np.full(len(self.best), np.sqrt(len(camera.time) / camera.numbers))
        radius = np.abs(np.diff(camera.radius_of(self.best)))
        metric[: camera.collapses] = np.sqrt(len(camera.time) * np.mean(radius**2)) * len(radius)
        return metric / deviation

    def _whitened(self, u: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.root, ((self.target.linear(u) - self.centre) / self.unit).T).T)


class Emulated(Target):
    """A target that a surrogate simulates."""

    def __init__(self, target: Target, surrogate: Surrogate) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise, self.surrogate = target.camera, target.noise, surrogate

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """(k, size) at u (k, d)."""
        shapes = self.surrogate.shapes(u)
        return np.hstack([self.camera.of_shapes(shapes, self.noise.frames), shapes])


def climb_emulated(
    target: Target, simulated: Simulated, start: Floats, maxima: Sequence[Mode] = ()
) -> tuple[Mode | None, Simulated]:
    """The maximum reached from u (d,) as by `climb`, and what was simulated for it.

    A surrogate of what is simulated shows the way; one simulation where it ends teaches the next one, until this finds
    what was expected. Finite differences, which cost one simulation a parameter, only go on from there.
    """
    known = len(simulated.u)
    enough = len(simulated.finite.u) > 2 * (len(start) + 1)
    height = np.max(simulated.value[np.all(simulated.u == start, axis=1)], initial=-np.inf)
    for _ in range(TUNING.climb_surrogates if enough else 0):
        mode = climb(Emulated(target, Surrogate(target, *simulated.finite)), start, ROUGH, maxima)
        if mode is None:
            return None, simulated.after(known)
        end = Simulated.at(target, mode.u[None])
        simulated = simulated.joined(end)
        if end.value[0] > height:  # not of all that is known: another mode may be higher
            start, height = mode.u, end.value[0]
        if not abs(end.value[0] - mode.log_posterior) > TUNING.climb_expected or not np.isfinite(end.value[0]):
            break
    mode = climb(target, start, ROUGH, maxima)
    if mode and np.any(mode.u != start):
        simulated = simulated.joined(Simulated(mode.u[None], mode.residual[None], np.array([mode.log_posterior])))
    return mode, simulated.after(known)


def _directions(off: Floats, metric: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Axes (c, numbers) and along (k, c): off (k, numbers) = along @ axes but for what is far below the noise; metric:
    (numbers,) what each counts in units of it."""
    off = off * metric
    values, vectors = np.linalg.eigh((off.T * weight) @ off)
    count = int(np.clip(np.count_nonzero(values > TUNING.direction_share**2), 1, 40))
    vectors = vectors[:, ::-1][:, :count]
    return vectors.T / metric, off @ vectors


def _scatter(off: Floats, weight: Floats) -> float:
    """Standard deviation of what is off, none of it counted for more than some of them."""
    middle = np.average(off, weights=weight)
    return float(np.sqrt(np.average(np.minimum((off - middle) ** 2, 9.0), weights=weight)))
