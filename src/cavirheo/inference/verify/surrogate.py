"""A Gaussian process that predicts the bubble, and so the posterior, from the simulations so far.

The shape of the bubble (camera.py) changes in a few common directions. Each of these is a Gaussian process, all with
one kernel (Rasmussen and Williams 2006, ch. 2 and 5.4.2, gaussianprocess.org/gpml), of coordinates in which the shape
is nearly linear (a stress is linear in a modulus, not in its logarithm) and which are whitened by the posterior. The
camera then films the predicted shape as it films a simulation: R at an instant has a kink where a collapse passes, a
shape has none. Clock, scale and factor are coordinates of the surrogate beside u. The kernel is the one that predicts
simulations best when they are left out.

Draws of the surrogate are the answer if default simulations of some agree; otherwise they are simulated and weighted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats, relative_weights
from cavirheo.inference.noise import MarginalNoise
from cavirheo.inference.verify.mode import Mode, Simulated, Target, climb, same, trust_in
from cavirheo.inference.verify.sampler import Density, Mixture, Sample, effective_size, markov_sample, tempered
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.physics.accuracy import BRISK, ROUGH, Accuracy
from cavirheo.posterior import weighted_quantile
from cavirheo.prior import log_normal


class Kernel(NamedTuple):
    """`matern` times the Matern function of order 5/2 of this length, plus (1 + z z'/scale)^2. nugget: that of a likely
    simulation. Lengths are in standard deviations of the flattened posterior."""

    matern: float
    length: float
    scale: float
    nugget: float

    def __call__(self, z: Floats, others: Floats) -> Floats:
        """Covariances (k, m) of z (k, d) and others (m, d)."""
        product = z @ others.T
        distance = -2.0 * product
        distance += np.sum(z**2, axis=1)[:, None]
        distance += np.sum(others**2, axis=1)
        np.sqrt(np.maximum(distance, 0.0, out=distance), out=distance)
        distance *= np.sqrt(5.0) / self.length
        matern = distance / 3.0  # in place: memory takes most of the time
        matern += 1.0
        matern *= distance
        matern += 1.0
        matern *= np.exp(np.negative(distance, out=distance), out=distance)
        matern *= self.matern
        product /= self.scale
        product += 1.0
        matern += np.square(product, out=product)
        return np.asarray(matern)


# a smooth posterior takes the last; one in which the law changes the motion of the bubble takes the first
KERNELS = (Kernel(1.0, 4.0, 30.0, 1e-4), Kernel(1.0, 8.0, 30.0, 1e-4), Kernel(0.0, 8.0, 16.0, 1e-4))


class Surrogate:
    """Log posterior of u and the camera's z, predicted from more than 2 (d + 1) simulations at u (k, d) with extended
    residuals (k, size) and log posterior values (k,), all finite.

    scatter: standard deviation of the log posterior of likely simulations, each with its most likely camera, about the
    prediction from the others.
    """

    def __init__(self, target: Target, u: Floats, residual: Floats, value: Floats) -> None:
        latest = np.arange(len(u)) >= len(u) - TUNING.surrogate_latest  # they correct the last surrogate
        chosen = np.lexsort((-value, ~latest))[: TUNING.surrogate_latest + TUNING.surrogate_likely]
        chosen = chosen[np.argsort(-value[chosen], kind="stable")]
        u, residual, value = u[chosen], residual[chosen], value[chosen]
        below = value[0] - value
        high = below < TUNING.flattened_depth
        likely = np.flatnonzero(high)[: TUNING.likely_left_out]
        self.target: Target = target
        self.noise: MarginalNoise = target.noise.select_points(residual[high], TUNING.noise_point_least)
        v, effective = target.linear(u), TUNING.whitened_effective * u.shape[1]
        weight = np.exp(tempered(-below / TUNING.flattened_depth, effective))
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
        grown = np.minimum((1.0 + below / TUNING.nugget_depth) ** 3, TUNING.nugget_most)
        self.scatter = np.inf
        for kernel in KERNELS:
            matrix = kernel(self.z, self.z)
            matrix[np.diag_indices_from(matrix)] += kernel.nugget * grown
            inverse = np.linalg.inv(matrix)
            coefficients = inverse @ along
            missed = coefficients / np.diag(inverse)[:, None]  # by the prediction of each from the others
            predicted = self._log_density(u[likely], camera, self.best + (along[likely] - missed[likely]) @ self.axes)
            scatter = _scatter(predicted - exact, trust[likely])
            if scatter < self.scatter:
                self.scatter, self.kernel, self.coefficients = scatter, kernel, coefficients

    def __call__(self, w: Floats) -> Floats:
        """Log posterior (k,) at w (k, d + m), which is u beside z."""
        u, camera = np.split(w, [len(self.centre)], axis=1)
        z, value = self._whitened(u), np.full(len(u), -np.inf)
        reached = np.sum(z**2, axis=1) <= self.limit
        if np.any(reached):
            value[reached] = self._log_density(u[reached], camera[reached], self._shapes(z[reached]))
        return value

    def _log_density(self, u: Floats, camera: Floats, shapes: Floats) -> Floats:
        """Log posterior (k,) of u (k, d) and a camera z (k, m) for bubbles of these shapes (k, numbers)."""
        return self.noise.log_density(self.target.extended(shapes, camera)) + log_normal(u)

    def shapes(self, u: Floats) -> Floats:
        """Shapes (k, numbers) of the bubbles at u (k, d)."""
        return self._shapes(self._whitened(u))

    def _shapes(self, z: Floats) -> Floats:
        """Shapes (k, numbers) of the bubbles at whitened places z (k, d)."""
        return self.best + (self.kernel(z, self.z) @ self.coefficients) @ self.axes

    def _metric(self) -> Floats:
        """Weight (numbers,) of each number of a shape, in units of the noise."""
        camera, deviation = self.target.camera, self.noise.frames.typical
        metric = np.full(len(self.best), np.sqrt(len(camera.time) / camera.numbers))
        radius = np.abs(np.diff(camera.radius_of(self.best)))
        metric[: camera.collapses] = np.sqrt(len(camera.time) * np.mean(radius**2)) * len(radius)
        return metric / deviation

    def _whitened(self, u: Floats) -> Floats:
        return np.asarray(np.linalg.solve(self.root, ((self.target.linear(u) - self.centre) / self.unit).T).T)


class SurrogateTarget(Target):
    """A target whose simulations are predictions of a surrogate."""

    def __init__(self, target: Target, surrogate: Surrogate) -> None:
        super().__init__(target.experiment, target.whole, target.noise.frames, target.workers)
        self.camera, self.noise, self.surrogate = target.camera, target.noise, surrogate

    def residuals(self, u: Floats, accuracy: Accuracy = BRISK) -> Floats:
        """Extended residuals (k, size) at u (k, d)."""
        shapes = self.surrogate.shapes(u)
        return np.hstack([self.camera.residuals_of_shapes(shapes, self.noise.frames), shapes])


def climb_by_surrogates(
    target: Target, simulated: Simulated, start: Floats, maxima: Sequence[Mode] = ()
) -> tuple[Mode | None, Simulated]:
    """The maximum that is reached from u (d,) as by `climb`, and the simulations that it took.

    A surrogate of the simulations so far leads to a maximum. One simulation there teaches the next surrogate, until a
    simulation is as high as predicted and no higher than the one before. Finite differences, which cost one simulation
    for each parameter, give the curvature there, and further steps are taken only if they promise more.
    """
    known = len(simulated.u)
    enough = len(simulated.finite.u) > 2 * (len(start) + 1)
    height = np.max(simulated.value[np.all(simulated.u == start, axis=1)], initial=-np.inf)
    for _ in range(TUNING.climb_surrogates if enough else 0):
        mode = climb(SurrogateTarget(target, Surrogate(target, *simulated.finite)), start, ROUGH, maxima)
        if mode is None:
            return None, simulated.after(known)
        end = Simulated.at(target, mode.u[None])
        simulated, (value,) = simulated.joined(end), end.value
        off = max(abs(value - mode.log_posterior), value - height)
        if value > height:  # of this climb: another mode may be higher
            start, height = mode.u, value
        if not off > TUNING.climb_tolerance or not np.isfinite(value):
            break
    mode = climb(target, start, ROUGH, maxima, TUNING.climb_tolerance)
    if mode and np.any(mode.u != start):
        simulated = simulated.joined(Simulated(mode.u[None], mode.residual[None], np.array([mode.log_posterior])))
    return mode, simulated.after(known)


def _directions(off: Floats, metric: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Axes (c, numbers) and coordinates along them (k, c), so that off (k, numbers) = along @ axes but for differences
    far below the noise. metric: weight (numbers,) of each number in units of the noise."""
    off = off * metric
    values, vectors = np.linalg.eigh((off.T * weight) @ off)
    count = int(np.clip(np.count_nonzero(values > TUNING.direction_least**2), 1, 40))
    vectors = vectors[:, ::-1][:, :count]
    return vectors.T / metric, off @ vectors


def _scatter(off: Floats, weight: Floats) -> float:
    """Weighted standard deviation of `off`; a deviation from the mean counts as 3 at most."""
    middle = np.average(off, weights=weight)
    return float(np.sqrt(np.average(np.minimum((off - middle) ** 2, 9.0), weights=weight)))


def flat_tails(target: Target, w: Floats, size: int) -> Mixture | None:
    """Components where frames bound a coordinate from one side only, for draws w (k, d) that begin with u (k, size).

    Towards an end of its range a coordinate may change the frames less and less (`Target.linear`). Its posterior is as
    wide as its prior there, and the other coordinates follow their regression on the linear coordinate. There is a
    component for each end that the draws do not exclude; None if they exclude all.
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
        for end in (-TUNING.flat_tail_end, TUNING.flat_tail_end):
            place = mean[None, :size].copy()
            place[0, j] = end
            away = target.linear(place)[0, j] - np.mean(linear[:, j])
            if away**2 < TUNING.flat_tail_reach**2 * variance[j]:
                means.append(np.where(np.arange(d) == j, 0.0, mean + slope * away))
                covariances.append(covariance)
    return Mixture(np.full(len(means), 1.0 / len(means)), np.array(means), np.array(covariances)) if means else None


class AdaptiveProposal:
    """Draws of the posterior of a shot by surrogates that learn from every simulation. It begins with modes. simulated:
    the simulations so far. About a mode with few of them, one standard deviation on either side is simulated, too."""

    def __init__(self, target: Target, modes: Sequence[Mode], simulated: Simulated | None = None) -> None:
        self.target = target
        nothing = np.empty((0, len(target.prior.names))), np.empty((0, target.noise.size)), np.empty(0)
        self.simulated = Simulated(*nothing)
        self.modes, self.climbed = list[Mode](), 0
        self.surrounded_modes = 0  # modes about which there are enough simulations
        self.latest: tuple[Surrogate, int] | None = None  # the latest surrogate, of the first so many simulations
        self.drawn: Sample | None = None  # the last draws of a surrogate
        self.walkers = np.empty((0, 0))  # (k, d + m) u and camera, where the last draws of a surrogate ended
        if simulated:
            self.learn(simulated)
        self._append_new(modes)
        self.mixture = self.start

    def add_modes(self, modes: Sequence[Mode]) -> None:
        """Add modes; if one is new, the next draws begin about all of them."""
        if self._append_new(modes):
            self.mixture = self._wide()

    def _append_new(self, modes: Sequence[Mode]) -> bool:
        """Append the modes that differ from those so far. Whether there are any."""
        before = len(self.modes)
        for mode in modes:
            if not any(same(mode, earlier) for earlier in self.modes):
                self.modes.append(mode)
        return len(self.modes) > before

    def _surround(self) -> None:
        """Simulate about the modes that have few simulations near them."""
        for mode in self.modes[self.surrounded_modes :]:
            d = len(mode.u)
            if np.count_nonzero(mode.squares(self.simulated.u) < TUNING.mode_reach**2 * d) <= 2 * d:
                axes = np.linalg.cholesky(mode.covariance).T
                self(mode.u + np.concatenate([axes, -axes]))
        self.surrounded_modes = len(self.modes)

    @property
    def start(self) -> Mixture:
        """The mixture of the Gaussians about the modes."""
        heights = np.array([mode.log_evidence for mode in self.modes])
        means, covariances = [mode.u for mode in self.modes], [mode.covariance for mode in self.modes]
        return Mixture.of_modes(means, covariances, heights - np.max(heights))

    def __call__(self, u: Floats) -> None:
        """Simulate at u (k, d) for the next surrogate."""
        self.learn(Simulated.at(self.target, u))

    def learn(self, simulated: Simulated) -> None:
        """Add simulations for the next surrogate."""
        self.simulated = self.simulated.joined(simulated.finite)

    @property
    def height(self) -> float:
        """The largest log posterior of all modes and simulations."""
        return max(*(mode.log_posterior for mode in self.modes), self.simulated.height)

    @property
    def highest(self) -> Floats:
        """u (d,) of the largest log posterior of all modes and simulations."""
        mode = max(self.modes, key=lambda mode: mode.log_posterior)
        return self.simulated.highest if self.simulated.height > mode.log_posterior else mode.u

    def climb_higher(self) -> None:
        """Climb from the highest simulation if it lies above all modes: it then belongs to another mode."""
        highest = max(mode.log_posterior for mode in self.modes)
        if self.climbed < TUNING.other_modes and self.simulated.height >= highest + TUNING.other_mode_height:
            self.climbed += 1
            self.climb_from(self.simulated.highest)

    def climb_from(self, start: Floats) -> None:
        """Climb from a simulated u (d,), and add the mode that is reached."""
        mode, simulated_on_way = climb_by_surrogates(self.target, self.simulated, start, self.modes)
        self.learn(simulated_on_way)
        self.add_modes([mode] if mode else [])

    def surrogate_draws(
        self, rng: np.random.Generator, enough: float = TUNING.teaching_effective, settling: int = TUNING.fits_most
    ) -> tuple[Surrogate, Sample] | None:
        """A surrogate of all simulations so far, and draws of it that are worth `enough` independent ones. Rough
        simulations about the modes are added if there are too few. None if there are still too few, or if no draw is
        likely. settling: as of `markov_sample`."""
        self._surround()
        d = len(self.target.prior.names)
        if len(self.simulated.u) <= 2 * (d + 1):
            self(self._wide().draw(TUNING.network_draws, rng))
        count = len(self.simulated.u)
        if count <= 2 * (d + 1):
            return None
        if self.latest is None or self.latest[1] != count:
            self.latest = Surrogate(self.target, *self.simulated), count
        surrogate, _ = self.latest
        draws = int(TUNING.draws_per_effective * enough)
        walkers = self._starts_of_walkers(surrogate, int(np.clip(draws / 6, *TUNING.walkers)), rng)
        if walkers is None:
            return None
        tail_raise = self._tail_raise()

        def raised(w: Floats) -> Floats:
            return surrogate(w) + tail_raise(w)

        sample, self.walkers = markov_sample(
            raised, walkers, lambda w: flat_tails(self.target, w, d), rng, draws, self.target, settling
        )
        u, camera = np.split(sample.u, [d], axis=1)
        sample = replace(sample, u=u, camera=camera, log_target=sample.log_target - tail_raise(sample.u))
        self.drawn = sample
        self.mixture = self._through(sample, rng).widened(TUNING.start_wide_share, TUNING.start_wide_factor)
        return surrogate, sample

    def _tail_raise(self) -> Density:
        """Amount (k,) by which the log density of draws w (k, d + m) is raised at large values of the law's parameters.
        If the recording only bounds a parameter from above, its bound lies where the posterior has few draws. A
        parameter that the recording determines is hardly changed."""
        if self.drawn is None:
            return lambda w: np.zeros(len(w))
        law = self.target.experiment.law_size
        prior = self.target.prior.marginal(self.target.prior.names[:law])
        x, quantile = prior.to_x(self.drawn.u[:, :law]), np.array([TUNING.raised_above])
        usual = weighted_quantile(x, quantile, self.drawn.log_weight)
        return lambda w: np.sum(np.log1p(10.0 ** (prior.to_x(w[:, :law]) - usual)), axis=1)

    def _starts_of_walkers(self, surrogate: Surrogate, count: int, rng: np.random.Generator) -> Floats | None:
        """Places (count, d + m) where walkers begin: the ends of the last walkers, and likely places about the modes;
        None if no place is likely."""
        mixture = self._wide()
        u = mixture.draw(TUNING.starts_per_walker * count, rng)
        middle, spread = self._expected_camera(u)
        off = rng.standard_normal(middle.shape)
        w = np.hstack([u, middle + spread * off])
        log_q = mixture.log_density(u) + log_normal(off) - float(np.sum(np.log(spread)))
        log_weight = tempered(surrogate(w) - log_q, count / 4)
        if not np.any(np.isfinite(log_weight)):
            return None
        new = count - min(int(TUNING.continued_share * count), len(self.walkers))
        chosen = rng.choice(len(w), new, p=relative_weights(log_weight) / np.sum(relative_weights(log_weight)))
        return np.concatenate([w[chosen], rng.permutation(self.walkers)[: count - new].reshape(-1, w.shape[1])])

    def _expected_camera(self, u: Floats) -> tuple[Floats, Floats]:
        """Camera z (k, m) of bubbles at u (k, d) by linear regression on the likely simulations, and standard
        deviations (m,) for draws about it."""
        z = self.target.camera.z(self.simulated.residual)
        trust = trust_in(self.simulated.value)
        middle = trust @ self.simulated.u / np.sum(trust)
        root, off = np.sqrt(trust)[:, None], self.simulated.u - middle
        line = root * np.column_stack([np.ones(len(z)), off])
        firm = np.diag(np.append(0.0, np.full(u.shape[1], 0.1 * np.sum(trust))))
        slopes = np.linalg.solve(line.T @ line + firm, line.T @ (root * z))
        missed = z - slopes[0] - off @ slopes[1:]
        spread = np.sqrt(trust @ missed**2 / np.sum(trust)) + TUNING.start_camera_spread
        return slopes[0] + (u - middle) @ slopes[1:], spread

    def _through(self, draws: Sample, rng: np.random.Generator) -> Mixture:
        """A mixture fitted to weighted draws, with more components for more effective draws, and the modes."""
        d = draws.u.shape[1]
        log_weight = tempered(draws.log_weight, min(TUNING.mixture_effective * d, 0.25 * len(draws.u)))
        fitting = effective_size(log_weight) / (TUNING.component_effective * d)
        count = int(np.clip(fitting, 1, TUNING.mixture_components))
        mixture = Mixture.through(draws.u, log_weight, count, rng)
        return mixture.mixed_with(self.start, TUNING.mixture_modes).widened()

    def _wide(self) -> Mixture:
        """The mixture with a part for the modes, widened."""
        return self.mixture.mixed_with(self.start, TUNING.start_modes).widened()
