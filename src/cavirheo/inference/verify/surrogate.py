"""What simulations near a maximum of the posterior say about it everywhere: a Gaussian process for the bubble.

The shape of the bubble (camera.py) is in its few common directions a set of Gaussian processes with one kernel
(Rasmussen and Williams 2006, ch. 2 and 5.4.2, gaussianprocess.org/gpml) of coordinates in which it is nearly linear,
whitened by the posterior. (In u it is not: a stress is linear in a modulus, not in its logarithm.) A camera films it
then as it films a simulation: at an instant R has a kink where a collapse passes, a shape has none. Clock, scale and
factor are coordinates of the surrogate beside u. The kernel is the one that tells simulations best which are left out.

Its draws are the answer if default simulations of some agree; else they are simulated and weighed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats, unscaled
from cavirheo.inference.noise import MarginalNoise
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, same, trust_in
from cavirheo.inference.verify.sampler import Density, Mixture, Sample, effective_size, markov_sample, tempered
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import BRISK, ROUGH, Accuracy
from cavirheo.posterior import weighted_quantile
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
            predicted = self._log_density(u[likely], camera, self.best + (along[likely] - missed[likely]) @ self.axes)
            scatter = _scatter(predicted - exact, trust[likely])
            if scatter < self.scatter:
                self.scatter, self.kernel, self.coefficients = scatter, kernel, coefficients

    def __call__(self, w: Floats) -> Floats:
        """(k,) at w (k, d + m), u and z beside each other."""
        u, camera = np.split(w, [len(self.centre)], axis=1)
        z, value = self._whitened(u), np.full(len(u), -np.inf)
        reached = np.sum(z**2, axis=1) <= self.limit
        if np.any(reached):
            value[reached] = self._log_density(u[reached], camera[reached], self._shapes(z[reached]))
        return value

    def _log_density(self, u: Floats, camera: Floats, shapes: Floats) -> Floats:
        """(k,) of u (k, d) and a camera z (k, m) for bubbles of these shapes (k, numbers)."""
        return self.noise.log_density(self.target.extended(shapes, camera)) + log_normal(u)

    def shapes(self, u: Floats) -> Floats:
        """(k, numbers) of the bubbles at u (k, d)."""
        return self._shapes(self._whitened(u))

    def _shapes(self, z: Floats) -> Floats:
        """(k, numbers) of the bubbles at whitened places z (k, d)."""
        return self.best + (self.kernel(z, self.z) @ self.coefficients) @ self.axes

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
    what was expected and leads no higher. Finite differences, which cost one simulation a parameter, tell the curvature
    there, and only go on where they promise more.
    """
    known = len(simulated.u)
    enough = len(simulated.finite.u) > 2 * (len(start) + 1)
    height = np.max(simulated.value[np.all(simulated.u == start, axis=1)], initial=-np.inf)
    for _ in range(TUNING.climb_surrogates if enough else 0):
        mode = climb(Emulated(target, Surrogate(target, *simulated.finite)), start, ROUGH, maxima)
        if mode is None:
            return None, simulated.after(known)
        end = Simulated.at(target, mode.u[None])
        simulated, (value,) = simulated.joined(end), end.value
        off = max(abs(value - mode.log_posterior), value - height)
        if value > height:  # not over all that is known: another mode may be higher
            start, height = mode.u, value
        if not off > TUNING.climb_expected or not np.isfinite(value):
            break
    mode = climb(target, start, ROUGH, maxima, TUNING.climb_expected)
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


def shelves(target: Target, w: Floats, size: int) -> Mixture | None:
    """Of draws w (k, d) whose first `size` coordinates are u: where frames bound one of these from one side only.

    Towards an end of its range a coordinate changes the frames less and less (Target.linear): its posterior is as wide
    as its prior there. The others are where their regression on what the frames see of it tells. A component for each
    end that this regression does not exclude; None without one.
    """
    count, d = w.shape
    linear, mean = target.linear(w[:, :size]), np.mean(w, axis=0)
    off, off_seen = w - mean, linear - np.mean(linear, axis=0)
    variance = np.mean(off_seen**2, axis=0) + 1e-30
    means, covariances = [], []
    for j in range(size):
        slope = off_seen[:, j] @ off / (count * variance[j])
        left = off - np.outer(off_seen[:, j], slope)
        covariance = left.T @ left / count
        covariance[j], covariance[:, j] = 0.0, 0.0
        covariance += np.diag(np.where(np.arange(d) == j, 1.0, 1e-9))
        for end in (-TUNING.shelf_end, TUNING.shelf_end):
            place = mean[None, :size].copy()
            place[0, j] = end
            away = target.linear(place)[0, j] - np.mean(linear[:, j])
            if away**2 < TUNING.shelf_reach**2 * variance[j]:
                means.append(np.where(np.arange(d) == j, 0.0, mean + slope * away))
                covariances.append(covariance)
    return Mixture(np.full(len(means), 1.0 / len(means)), np.array(means), np.array(covariances)) if means else None


class AdaptiveProposal:
    """Draws of the posterior of a shot that learn from every simulation, from its modes on. simulated: all it knows;
    about a mode near which little is, a standard deviation on either side is simulated."""

    def __init__(self, target: Target, modes: Sequence[Mode], simulated: Simulated | None = None) -> None:
        self.target = target
        nothing = np.empty((0, len(target.prior.names))), np.empty((0, target.noise.size)), np.empty(0)
        self.simulated = Simulated(*nothing)
        self.modes, self.climbed = list[Mode](), 0
        self.surrounded = 0  # modes about which enough is known
        self.taught: tuple[Surrogate, int] | None = None  # by the first so many simulations
        self.drawn: Sample | None = None  # the last draws of a surrogate
        self.walkers = np.empty((0, 0))  # (k, d + m) u and camera, where the last draws of a surrogate ended
        if simulated:
            self.learn(simulated)
        self._know(modes)
        self.mixture = self.start

    def also(self, modes: Sequence[Mode]) -> None:
        """Take up further modes that are not known yet; the next draws begin about all of them."""
        if self._know(modes):
            self.mixture = self._wide()

    def _know(self, modes: Sequence[Mode]) -> bool:
        """Take up modes. Whether one of them is new."""
        before = len(self.modes)
        for mode in modes:
            if not any(same(mode, earlier) for earlier in self.modes):
                self.modes.append(mode)
        return len(self.modes) > before

    def _surround(self) -> None:
        """Simulate about the modes where little is known."""
        for mode in self.modes[self.surrounded :]:
            d = len(mode.u)
            if np.count_nonzero(mode.squares(self.simulated.u) < TUNING.near_mode**2 * d) <= 2 * d:
                axes = np.linalg.cholesky(mode.covariance).T
                self(mode.u + np.concatenate([axes, -axes]))
        self.surrounded = len(self.modes)

    @property
    def start(self) -> Mixture:
        """About the modes."""
        heights = np.array([mode.log_evidence for mode in self.modes])
        means, covariances = [mode.u for mode in self.modes], [mode.covariance for mode in self.modes]
        return Mixture.of_modes(means, covariances, heights - np.max(heights))

    def __call__(self, u: Floats) -> None:
        """Simulate u (k, d), which the next surrogate knows."""
        self.learn(Simulated.at(self.target, u))

    def learn(self, simulated: Simulated) -> None:
        """Know further simulations."""
        self.simulated = self.simulated.joined(simulated.finite)

    @property
    def height(self) -> float:
        """The largest log posterior that was met."""
        return max(*(mode.log_posterior for mode in self.modes), self.simulated.height)

    @property
    def highest(self) -> Floats:
        """(d,) u of the largest log posterior that was met, at a mode or a simulation."""
        mode = max(self.modes, key=lambda mode: mode.log_posterior)
        return self.simulated.highest if self.simulated.height > mode.log_posterior else mode.u

    def climb_higher(self) -> None:
        """Climb from the best simulation if it lies above all modes, which must then be beside the highest."""
        highest = max(mode.log_posterior for mode in self.modes)
        if self.climbed < TUNING.modes_climbed and self.simulated.height >= highest + TUNING.other_mode:
            self.climbed += 1
            self.climb_from(self.simulated.highest)

    def climb_from(self, start: Floats) -> None:
        """Climb from a simulated u (d,) and take up the mode that it leads to, if this is a new one."""
        mode, on_the_way = climb_emulated(self.target, self.simulated, start, self.modes)
        self.learn(on_the_way)
        self.also([mode] if mode else [])

    def emulated(
        self, rng: np.random.Generator, enough: float = TUNING.pool, settling: int = TUNING.settling_most
    ) -> tuple[Surrogate, Sample] | None:
        """Draws, worth `enough` independent ones, of a surrogate of all simulations so far, and of rough ones about the
        modes where these are too few; None where they still are, or nothing that is drawn is likely. settling: as of
        `markov_sample`."""
        self._surround()
        d = len(self.target.prior.names)
        if len(self.simulated.u) <= 2 * (d + 1):
            self(self._wide().draw(TUNING.own_draws, rng))
        count = len(self.simulated.u)
        if count <= 2 * (d + 1):
            return None
        if self.taught is None or self.taught[1] != count:
            self.taught = Surrogate(self.target, *self.simulated), count
        surrogate, _ = self.taught
        draws = int(TUNING.emulated_draws * enough)
        walkers = self._begun(surrogate, int(np.clip(draws / 6, *TUNING.walkers)), rng)
        if walkers is None:
            return None
        lift = self._lift()

        def lifted(w: Floats) -> Floats:
            return surrogate(w) + lift(w)

        sample, self.walkers = markov_sample(
            lifted, walkers, lambda w: shelves(self.target, w, d), rng, draws, self.target, settling
        )
        u, camera = np.split(sample.u, [d], axis=1)
        sample = replace(sample, u=u, camera=camera, log_target=sample.log_target - lift(sample.u))
        self.drawn = sample
        self.mixture = self._through(sample, rng).widened(TUNING.flat_share, TUNING.flat_factor)
        return surrogate, sample

    def _lift(self) -> Density:
        """By how much the log density of draws is raised at larger values of the law's parameters, of u and camera (k,
        d + m): where the recording bounds one alone, its bound lies where a prior that is uniform in the logarithm has
        few draws. One whose value is known is hardly moved."""
        if self.drawn is None:
            return lambda w: np.zeros(len(w))
        law = self.target.experiment.law
        prior = self.target.prior.of(self.target.prior.names[:law])
        usual = weighted_quantile(prior.to_x(self.drawn.u[:, :law]), np.array([TUNING.lifted]), self.drawn.log_weight)
        return lambda w: np.sum(np.log1p(10.0 ** (prior.to_x(w[:, :law]) - usual)), axis=1)

    def _begun(self, surrogate: Surrogate, count: int, rng: np.random.Generator) -> Floats | None:
        """(count, d + m) where walkers begin: where the last ones ended, and likely places about the modes; None
        without such places."""
        mixture = self._wide()
        u = mixture.draw(TUNING.begun * count, rng)
        middle, spread = self._expected_camera(u)
        off = rng.standard_normal(middle.shape)
        w = np.hstack([u, middle + spread * off])
        log_q = mixture.log_density(u) + log_normal(off) - float(np.sum(np.log(spread)))
        log_weight = tempered(surrogate(w) - log_q, count / 4)
        if not np.any(np.isfinite(log_weight)):
            return None
        new = count - min(int(TUNING.walked_on * count), len(self.walkers))
        chosen = rng.choice(len(w), new, p=unscaled(log_weight) / np.sum(unscaled(log_weight)))
        return np.concatenate([w[chosen], rng.permutation(self.walkers)[: count - new].reshape(-1, w.shape[1])])

    def _expected_camera(self, u: Floats) -> tuple[Floats, Floats]:
        """(k, m) camera z of bubbles at u (k, d) by a line through those of the likely simulations, and the standard
        deviations (m,) of draws about it."""
        z = self.target.camera.z(self.simulated.residual)
        trust = trust_in(self.simulated.value)
        middle = trust @ self.simulated.u / np.sum(trust)
        root, off = np.sqrt(trust)[:, None], self.simulated.u - middle
        line = root * np.column_stack([np.ones(len(z)), off])
        firm = np.diag(np.append(0.0, np.full(u.shape[1], 0.1 * np.sum(trust))))
        slopes = np.linalg.solve(line.T @ line + firm, line.T @ (root * z))
        missed = z - slopes[0] - off @ slopes[1:]
        spread = np.sqrt(trust @ missed**2 / np.sum(trust)) + TUNING.begun_camera
        return slopes[0] + (u - middle) @ slopes[1:], spread

    def _through(self, draws: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture that follows weighted draws, with as many components as they are worth, and the modes."""
        d = draws.u.shape[1]
        log_weight = tempered(draws.log_weight, min(TUNING.adapted * d, 0.25 * len(draws.u)))
        count = int(np.clip(effective_size(log_weight) / (TUNING.adapted_each * d), 1, TUNING.adapted_components))
        mixture = Mixture.through(draws.u, log_weight, count, rng)
        return mixture.mixed_with(self.start, TUNING.adapted_modes).widened()

    def _wide(self) -> Mixture:
        """The mixture with the modes beside it, widened."""
        return self.mixture.mixed_with(self.start, TUNING.modes_share).widened()
