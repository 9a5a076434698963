"""The posterior of one shot as a function of u, its modes, and the Gaussian about each (Laplace)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.inference.camera import NAMES, CameraNuisances, rescaled
from cavirheo.inference.experiment import DIFFERENCE_STEP, Experiment
from cavirheo.inference.noise import MarginalNoise, Noise
from cavirheo.inference.verify.sampler import Coordinates, integral_about
from cavirheo.inference.verify.tuning import TUNING
from cavirheo.parallel import run_jobs
from cavirheo.physics.accuracy import DEFAULT, ROUGH, Accuracy
from cavirheo.physics.laws import fung_stress
from cavirheo.posterior import Evidence, OtherAnswer, intervals
from cavirheo.prior import Prior, log_normal

INSIDE = 1e-3  # of the probability, that a start keeps away from the bounds: it must have somewhere to go
_RESISTING = 0.3  # accommodation below which condensation resists more than what else does
_STIFF, _STIFFENED = 0.03, 0.3  # pressures of the medium: modulus and stress at R_max that count as large


class Target(Coordinates):
    """log p(frames | x(u)) + log p(u) of one experiment, integrated over clock, scale and R_max factor (camera.py). It
    is -inf where the simulation failed.

    whole: prior of all parameters of the experiment. prior: prior of the parameters that are sampled. columns: indices
    of these among the parameters of the experiment.
    """

    def __init__(self, experiment: Experiment, whole: Prior, noise: Noise, workers: int = 1) -> None:
        self.experiment, self.whole, self.workers = experiment, whole, workers
        self.camera: CameraNuisances = replace(experiment.camera, simulates_size=experiment.camera.resolves_size(noise))
        self.prior = whole.marginal([name for name in whole.names if name not in NAMES])
        self.columns = [whole.names.index(name) for name in self.prior.names]
        self.noise = MarginalNoise(noise, len(self.camera.free), self.camera.size)
        self._resistance = [i for i, name in enumerate(self.prior.names) if name == "accommodation"]

    def adapt_shapes(self, u: Floats, residual: Floats) -> bool:
        """Give shapes the collapses of the bubble at u (d,) with an extended residual (size,). Its effect of size is
        used for all bubbles if simulations do not each find theirs. Whether shapes changed."""
        frames, before = self.noise.frames, self.camera
        curve = self.experiment.solve_on_grid(self.with_camera(u[None])[0], replace(before, simulates_size=True))
        if curve is None or not self.noise.pulls:
            return False
        camera = before.with_collapses(curve, before.z(residual), frames)
        if not camera.simulates_size:
            shape = replace(camera, simulates_size=True).extended(curve, frames)[0]
            camera = replace(camera, by_size=shape[-camera.numbers :])
        self.camera, self.noise = camera, MarginalNoise(frames, len(camera.free), camera.size)
        return camera.collapses != before.collapses

    def holds(self, u: Floats) -> Bools:
        """Which u (k, d) have a material, as simulations have: the prior is 0 where the law's parameters exclude each
        other."""
        return self.experiment.family.holds(self.prior.to_x(u)[:, : self.experiment.law_size])

    def start(self, x: Floats) -> Floats:
        """u (..., d) of x (..., all), inside the ranges, so that a climb can begin there."""
        return self.prior.to_u(x[..., self.columns], INSIDE)

    def residuals(self, u: Floats, accuracy: Accuracy) -> Floats:
        """Extended residuals (k, size) at u (k, d); NaN where the simulation failed."""
        shot, camera, frames = self.experiment, self.camera, self.noise.frames
        places = self.with_camera(u)
        rows = run_jobs(lambda x: shot.extended(x, camera, frames, accuracy)[0], places, self.workers)
        return np.array(rows).reshape(len(u), camera.size)

    def with_camera(self, u: Floats, z: Floats | None = None) -> Floats:
        """x (k, all) of u (k, d) and of clock, scale and factor z (k, m) in units of their prior, or at their middle.
        Parameters of the law that depend on the bubble's size are those of its true size."""
        x = np.zeros((len(u), len(self.whole.names)))
        x[:, self.columns] = self.prior.to_x(u)
        if z is not None and len(self.camera.free):
            values, law = self.camera.natural(z), self.experiment.law_size
            for name, (middle, width, _) in self.experiment.free.items():
                if name in NAMES:
                    x[:, self.whole.names.index(name)] = (values[name] - middle) / width
            size = values["radius_scale"] * values["max_radius_factor"]
            x[:, :law] = rescaled(self.experiment.family.parameters, x[:, :law], size)
        return x

    def add_camera(self, u: Floats, z: Floats) -> tuple[Floats, Floats]:
        """x (k, all) of draws u (k, d) with a camera z (k, m), and the change (k,) of the log density from z to x."""
        free, shot = self.camera.free, self.experiment
        widths = np.array([shot.free[NAMES[i]][1] for i in free]) / self.camera.widths[free]
        return self.with_camera(u, np.nan_to_num(z)), np.full(len(u), float(np.sum(np.log(widths))))

    def draw_camera(self, u: Floats, z: Floats, at: Floats, seed: int) -> tuple[Floats, Floats]:
        """x (k, all) of u (k, d) with a camera drawn from the Gaussian about the most likely one z (k, m), whose
        spread is that at u `at` (d,); and the log density (k,) of these draws over x."""
        middle, shot = np.nan_to_num(z), self.experiment
        curvature = shot.extended(self.with_camera(at[None])[0], self.camera, self.noise.frames)[1]
        if not len(self.camera.free) or not np.all(np.isfinite(curvature)):
            return self.with_camera(u, middle), np.zeros(len(u))
        z, log_density = self.camera.draw(middle, curvature, np.random.Generator(np.random.Philox(seed).jumped(2)))
        x, log_width = self.add_camera(u, z)
        return x, log_density + log_width

    def log_posterior(self, u: Floats, residual: Floats) -> Floats:
        """Log posterior (k,) of u (k, d) with extended residuals (k, size); -inf where one is not finite."""
        return self.noise.log_density(residual) + log_normal(u)

    def extended(self, shapes: Floats, z: Floats) -> Floats:
        """Extended residuals (k, size) of bubbles of these shapes (k, numbers) and of a camera z (k, m), which is not
        integrated: its part of the log density is that of its prior."""
        rest = np.full((len(z), 1), -0.5 * z.shape[1] * np.log(2.0 * np.pi))
        return np.hstack([self.camera.difference_of_shapes(shapes, z), z, rest, shapes])

    def checks(
        self, u: Floats, z: Floats, accuracy: Accuracy = DEFAULT, correction: Floats | float = 0.0
    ) -> tuple[Simulated, Floats]:
        """Simulations at u (k, d), and their log posterior (k,) with a given camera z (k, m). correction: (size,) is
        added to the extended residuals of this accuracy."""
        shot, frames, camera = self.experiment, self.noise.frames, self.camera

        def simulate(pair: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
            curve = shot.solve_on_grid(pair[0], camera, accuracy)
            if curve is None:
                return np.full(camera.size, np.nan), np.full(frames.size, np.nan)
            return camera.extended(curve, frames)[0] + correction, camera.shape_error(curve, pair[1])

        rows = run_jobs(simulate, list(zip(self.with_camera(u), z, strict=True)), self.workers)
        residual, missed = (np.array(part) for part in zip(*rows, strict=True))
        extended = self.extended(self.noise.shapes(residual), z)
        extended[:, : frames.size] += missed
        return Simulated(u, residual, self.log_posterior(u, residual)), self.log_posterior(u, extended)

    def integrated(self, simulated: Simulated) -> Simulated:
        """The simulations, with the camera of the likely ones integrated by importance sampling: Laplace's integral is
        wrong by 1, and by up to 6, in log posterior where a collapse is beside a frame."""
        selected = simulated.value > simulated.height - TUNING.camera_depth
        if not np.any(selected) or not self.noise.pulls:
            return simulated
        residual, density_column = simulated.residual.copy(), self.noise.frames.size + self.noise.pulls
        noise = self.noise.select_points(residual[selected], TUNING.noise_point_least)

        def integral(residual: Floats) -> float:
            z, shape = self.camera.z(residual), self.noise.shapes(residual)

            def log_density(z: Floats) -> Floats:
                return noise.log_density(self.extended(np.tile(shape, (len(z), 1)), z))

            return integral_about(log_density, z, TUNING.camera_scale, TUNING.camera_points)

        gain = np.array(list(map(integral, residual[selected]))) - noise.log_density(residual[selected])
        residual[selected, density_column] += gain
        return Simulated(simulated.u, residual, self.log_posterior(simulated.u, residual))

    def linear(self, u: Floats) -> Floats:
        """Coordinates (k, d) of u (k, d) in which frames are nearly linear: parameters, not their logarithms. The
        accommodation counts by its inverse, a resistance, and by its logarithm where this resistance is large. A law
        that stiffens counts by the stress at R_max; this and the modulus count by their logarithm where they are
        large."""
        x = self.prior.to_x(u)
        v = self._values(x)
        if "fung" in self.experiment.family.name:
            modulus, stiffening = (self.prior.names.index(name) for name in ("shear_modulus", "stiffening"))
            natural, pressure = self.experiment.natural(self.with_camera(u).T), self.experiment.medium.pressure
            stretch = np.full(len(x), natural["stretch"])
            stress = fung_stress(v[:, modulus], v[:, stiffening], stretch)
            v[:, stiffening] = np.log1p(stress / (_STIFFENED * pressure))
            v[:, modulus] = np.log1p(v[:, modulus] / (_STIFF * pressure))
        return v

    def _values(self, x: Floats) -> Floats:
        """Functions (k, d) of single parameters x (k, d) in which frames are nearly linear."""
        law = self.experiment.law_size
        v = np.concatenate([10.0 ** x[:, :law], x[:, law:]], axis=1)
        v[:, self._resistance] = np.log1p(_RESISTING * 10.0 ** -x[:, self._resistance])
        return v

    def to_straight(self, w: Floats) -> tuple[Floats, Floats]:
        """v (k, d + m) of u and camera w (k, d + m), in which ridges of the posterior are nearly straight, and
        log |dv/dw| (k,). v is that of `linear`, without the stress of a law that stiffens."""
        d, law, columns = len(self.prior.names), self.experiment.law_size, self._resistance
        x = self.prior.to_x(w[:, :d])
        v = self._values(x)
        by_x = np.log(10.0) * np.hstack([v[:, :law], -np.expm1(-v[:, columns])])
        log_slope = log_normal(w[:, :d]) - self.prior.log_density(x) + np.sum(np.log(by_x), axis=1)
        return np.hstack([v, w[:, d:]]), log_slope

    def from_straight(self, v: Floats) -> Floats:
        """w (k, d + m) of v (k, d + m); NaN outside the ranges."""
        d, law, columns = len(self.prior.names), self.experiment.law_size, self._resistance
        x = v[:, :d].copy()
        with np.errstate(invalid="ignore", divide="ignore"):
            x[:, :law] = np.log10(v[:, :law])
            x[:, columns] = -np.log10(np.expm1(v[:, columns]) / _RESISTING)
        inside = np.all((x > self.prior.low) & (x < self.prior.high), axis=1)
        w = np.full(v.shape, np.nan)
        w[inside] = np.hstack([self.prior.to_u(x[inside]), v[inside, d:]])
        return w

    def jacobian(self, u: Floats, residual: Floats, accuracy: Accuracy) -> Floats:
        """Derivatives (size, d) of the simulated frames by u, with the camera refitted: differences towards u = 0, with
        the steps of a fit."""
        steps = self.experiment.steps[self.columns]
        moves = np.minimum(DIFFERENCE_STEP * steps / self.prior.slope(u), 0.3) * np.where(u > 0, -1.0, 1.0)
        moved = self.residuals(u + np.diag(moves), accuracy)
        return np.nan_to_num((residual - moved) / moves[:, None]).T


@dataclass(frozen=True, eq=False)
class Mode:
    """A maximum of the posterior in u, with the Gaussian about it."""

    u: Floats  # (d,)
    log_posterior: float
    covariance: Floats  # (d, d), of u
    residual: Floats  # (n,)
    jacobian: Floats  # (n, d)

    @property
    def log_evidence(self) -> float:
        """Log of Laplace's integral of likelihood times prior."""
        return self.log_posterior + 0.5 * float(np.linalg.slogdet(2.0 * np.pi * self.covariance)[1])

    def squares(self, u: Floats) -> Floats:
        """Squared Mahalanobis distances (k,) of u (k, d)."""
        off = u - self.u
        return np.asarray(np.einsum("ki,ij,kj->k", off, np.linalg.inv(self.covariance), off))

    def draws(self, count: int, seed: int) -> Floats:
        """Draws (count, d) of the Gaussian, in pairs on opposite sides of the maximum."""
        rng = np.random.Generator(np.random.Philox(seed))
        half = rng.standard_normal((count // 2, len(self.u))) @ np.linalg.cholesky(self.covariance).T
        return np.asarray(self.u + np.concatenate([half, -half]))


def with_noise(mode: Mode, noise: MarginalNoise) -> Mode:
    """The mode under another noise, by one Newton step without a simulation."""
    gradient, curvature = noise.newton(mode.residual, mode.jacobian)
    gradient, covariance = gradient + mode.u, np.asarray(np.linalg.inv(curvature + np.eye(len(mode.u))), dtype=float)
    step = -covariance @ gradient
    height = noise.log_density(mode.residual[None]) + log_normal(mode.u[None])
    top = float(height[0] - 0.5 * gradient @ step)
    return replace(mode, u=mode.u + step, log_posterior=top, covariance=covariance)


def answer_at(target: Target, mode: Mode) -> OtherAnswer:
    """The answer of the Gaussian about a mode, to stand beside the answer of another one."""
    shot, z = target.experiment, target.camera.z(mode.residual)
    draws = mode.draws(TUNING.draws, 0)
    quantiles = intervals(*shot.to_theta(target.with_camera(draws, np.tile(z, (len(draws), 1)))))
    best, frames = shot.all_values(target.with_camera(mode.u[None], z[None])[0]), target.noise.split(mode.residual)[0]
    rmse = float(np.sqrt(np.mean(frames**2)))
    return OtherAnswer(shot.family.name, shot.options.bubble, best, quantiles, Evidence(mode.log_evidence), rmse)


def climb(
    target: Target, start: Floats, accuracy: Accuracy, maxima: Sequence[Mode] = (), least: float = TUNING.climb_gain
) -> Mode | None:
    """The maximum that damped Gauss-Newton steps reach from u (d,), until a step gains less than `least`. None if the
    start cannot be simulated, or if the climb comes to one of the `maxima` or will end far below the best of them."""
    u, noise = start, target.noise
    _, (residual,), (value,) = Simulated.at(target, u[None], accuracy)
    if not np.isfinite(value):
        return None
    damping = 1e-3
    lowest = max((mode.log_posterior for mode in maxima), default=-np.inf)
    lowest -= TUNING.climb_depth
    gain = np.inf
    for turn in range(TUNING.climb_steps + 1):
        if any(mode.squares(u[None])[0] < TUNING.mode_distance**2 for mode in maxima):
            return None
        jacobian = target.jacobian(u, residual, accuracy)
        gradient, curvature = noise.newton(residual, jacobian)
        gradient, curvature = gradient + u, curvature + np.eye(len(u))
        predicted_gain = 0.5 * float(gradient @ np.linalg.solve(curvature, gradient))
        if turn > 2 and value + predicted_gain < lowest:
            return None
        if turn == TUNING.climb_steps or min(predicted_gain, gain) < least:
            break
        for _ in range(5):
            step = -np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
            next_u = np.clip(u + step, -5.0, 5.0)
            _, (next_residual,), (next_value,) = Simulated.at(target, next_u[None], accuracy)
            if next_value > value:
                break
            damping *= 8.0
        else:
            break
        gain, u, residual, value = next_value - value, next_u, next_residual, next_value
        damping = max(damping / 8.0, 1e-6)
    return Mode(u, float(value), np.asarray(np.linalg.inv(curvature), dtype=float), residual, jacobian)


class Simulated(NamedTuple):
    """Simulations: u (k, d), extended residuals (k, n), log posterior (k,)."""

    u: Floats
    residual: Floats
    value: Floats

    @classmethod
    def at(cls, target: Target, u: Floats, accuracy: Accuracy = DEFAULT) -> Simulated:
        """Simulate at u (k, d)."""
        residual = target.residuals(u, accuracy)
        return cls(u, residual, target.log_posterior(u, residual))

    def joined(self, others: Simulated) -> Simulated:
        """These simulations and others."""
        return Simulated(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))

    def after(self, count: int) -> Simulated:
        """All but the first `count`."""
        return Simulated(self.u[count:], self.residual[count:], self.value[count:])

    @property
    def height(self) -> float:
        """The largest log posterior; -inf without any."""
        return float(np.max(self.value, initial=-np.inf))

    @property
    def highest(self) -> Floats:
        """u (d,) of the largest log posterior."""
        return np.asarray(self.u[np.argmax(self.value)])

    @property
    def finite(self) -> Simulated:
        """The simulations that did not fail."""
        good = np.isfinite(self.value)
        return Simulated(self.u[good], self.residual[good], self.value[good])


def trust_in(value: Floats) -> Floats:
    """Weights (k,) of simulations with this log posterior (k,) in a description of the likely ones."""
    return np.asarray((1.0 + (np.max(value) - value) / TUNING.nugget_depth) ** -2.0)


def same(first: Mode, second: Mode) -> bool:
    """Whether two modes are nearer to each other than their Gaussians are wide."""
    off = first.u - second.u
    return bool(off @ np.linalg.solve(second.covariance + first.covariance, off) < TUNING.mode_distance**2)


def modes(
    target: Target, starts: Sequence[Floats], further: Sequence[Floats] = (), maxima: Sequence[Mode] = ()
) -> list[Mode]:
    """Distinct maxima that are reached from the starts and `further` ones, u (d,), and the given `maxima`; the best
    first, without those far below it."""
    distinct = list(maxima)
    for start in (*starts, *further):
        mode = climb(target, start, ROUGH, maxima=distinct)
        if mode is None:
            continue
        twin = next((i for i, maximum in enumerate(distinct) if same(mode, maximum)), None)
        if twin is None:
            distinct.append(mode)
        elif mode.log_posterior > distinct[twin].log_posterior:
            distinct[twin] = mode
    distinct.sort(key=lambda mode: -mode.log_posterior)
    return [mode for mode in distinct if mode.log_posterior > distinct[0].log_posterior - TUNING.mode_depth]
