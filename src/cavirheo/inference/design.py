"""The expected posterior of a recording that a rig could make, before the shot is taken.

Materials are drawn from what is known. The emulator films a bubble in each of them as the rig would; the recording is
read and answered as `infer` does, but with the emulator in place of the solver. Frames are linear in G and mu, not in
their logarithms, so the information of a shot is the inverse of the covariance of the values themselves, under a prior
that is even in them: it adds up over shots, also where a single one only bounds G.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from cavirheo.arrays import NORMAL_90, Floats, relative_weights
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, expect_whole, require
from cavirheo.inference.answer import Target
from cavirheo.inference.assumptions import FREE, SCALE_BOUND, Family, Options, fixed_bubble
from cavirheo.inference.emulator import Bubbles, Camera, emulator, outside
from cavirheo.inference.experiment import (
    BOUND_SCALES,
    BOUND_SIGMAS,
    QUICK_INSTANTS,
    ZETA,
    Experiment,
    exposure_nodes,
)
from cavirheo.inference.sample import Budget, Frames, alone, finding_maxima, first_round, ridges, sample
from cavirheo.inference.weigh import LOOKED_AT, REACH, Model
from cavirheo.parallel import run_jobs
from cavirheo.parameters import INTERVAL, PARAMETERS, RADIUS
from cavirheo.physics.bubble import FREE as INFERRED
from cavirheo.physics.bubble import REAL, Bubble
from cavirheo.physics.media import WATER, Medium
from cavirheo.posterior import weighted_quantile

BUDGET = Budget(sampled=500.0)
RECORDED_GROWTH = 0.8  # t_c before R_max at which a recording begins
MOST_SHOTS = 10_000
LN10 = float(np.log(10.0))


@dataclass(frozen=True)
class Setting:
    """The settings of a shot. max_radius: m, the intended R_max. frame_rate: 1/s. noise: m, standard deviation of the
    radius of a frame. frames: their number. exposure: s. Raises InputError."""

    max_radius: float
    frame_rate: float
    noise: float
    frames: int = 128
    exposure: float = 0.0

    def __post_init__(self) -> None:
        RADIUS.check("the R_max of a setting", self.max_radius, "design.max_radius")
        require(self.frame_rate > 0, f"a frame rate must be positive, got {self.frame_rate}", "design.frame_rate")
        INTERVAL.check("the time between two frames", 1.0 / self.frame_rate, "design.frame_rate")
        expect_whole(self.frames, "frames", 10, "design.frames")
        message = f"the noise must be positive and below half of R_max, got {self.noise:g} m"
        require(0 < self.noise < 0.5 * self.max_radius, message, "design.noise")
        longest = f"an exposure of {self.exposure:g} s does not fit between frames of {1.0 / self.frame_rate:g} s"
        require(0 <= self.exposure <= 1.0 / self.frame_rate * (1 + 1e-6), longest, "design.exposure")


@dataclass(frozen=True, eq=False)
class Expectation:
    """What one shot would tell, for one draw of what is known. information: (l, l) of the likelihood on log10 of the
    law's parameters, at the truth. half_width: (l,) decades, half of the 90 % interval that the shot alone gives."""

    information: Floats
    half_width: Floats


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of the material of a shot: law (draws, l) log10 of the parameters of `family`, stretch (draws,), medium and
    bubble. The errors of the camera depend on the seed and are the same at all settings."""

    family: Family
    law: Floats
    stretch: Floats
    medium: Medium = WATER
    bubble: Bubble = REAL
    seed: int = 0

    def films(self, setting: Setting) -> list[RadiusCurve | None]:
        """The recording of each draw, with errors of clock and scale as those of a camera; free parameters of the
        bubble are drawn. None for a bubble that cannot be. Raises InputError: the emulator does not know them."""
        usual = self.family.material(np.mean(self.law, axis=0))
        unknown = outside(usual, self.bubble, self.medium, setting.max_radius)
        require(not unknown, f"design needs bubbles that the emulator knows: {unknown}", "design.unknown")
        k, rng, frame = len(self.law), np.random.default_rng(self.seed), 1.0 / setting.frame_rate
        low, high = PARAMETERS["accommodation"].start_range or (0.0, 0.0)
        late, scale = rng.uniform(size=k), 1.0 + rng.normal(size=k) * SCALE_BOUND / BOUND_SIGMAS
        accommodation, damping = 10.0 ** rng.uniform(low, high, k), np.abs(ZETA * rng.normal(size=k))
        errors = setting.noise * rng.standard_normal((k, setting.frames))
        given = fixed_bubble(self.bubble, setting.max_radius)
        if self.bubble.contents != "kinetic":
            accommodation[:] = np.inf
        elif self.bubble.accommodation != INFERRED:
            accommodation[:] = given["accommodation"]
        if self.bubble.confinement_damping != INFERRED:
            damping[:] = given.get("confinement_damping", 0.0)
        damping = np.minimum(damping, BOUND_SCALES * ZETA)
        size, whole = np.full(k, setting.max_radius), np.ones(k)
        law = self.family.material(self.law)
        bubbles = Bubbles(law, self.medium, size, self.stretch, accommodation, damping, whole, whole)
        begin = RECORDED_GROWTH * self.medium.time_scale(setting.max_radius)
        time = frame * np.arange(setting.frames, dtype=np.float64) - begin
        camera = Camera(time, *exposure_nodes(setting.exposure, QUICK_INSTANTS), -frame * late)
        radius = setting.max_radius * emulator().radius(bubbles, camera) / scale[:, None] + errors
        meta = {"name": "designed", "frame_rate_hz": setting.frame_rate, "exposure_s": setting.exposure}
        return [
            RadiusCurve(time, np.maximum(row, 1e-3 * setting.max_radius), meta=meta) if np.isfinite(row).all() else None
            for row in radius
        ]

    def expectation(self, k: int, curve: RadiusCurve | None) -> Expectation | None:
        """`Expectation` of the recording of draw k; None if it cannot be read: it ends before the collapse, say."""
        if curve is None:
            return None
        options = Options(free=tuple(FREE), bubble=self.bubble)
        with suppress(InputError, SolverError, np.linalg.LinAlgError):
            shot = Experiment(curve, self.family, self.medium, options)
            x, log_weight = _draws(shot, np.random.default_rng(self.seed + k))
            logs = x[:, : shot.law_size]
            low, high = weighted_quantile(logs, [0.05, 0.95], log_weight)
            relative = 10.0 ** (logs - self.law[k])
            weight = relative_weights(log_weight) * np.prod(relative, axis=1)
            covariance = np.atleast_2d(np.cov(relative.T / LN10, aweights=weight))
            return Expectation(np.linalg.inv(covariance), 0.5 * (high - low))
        return None

    def expectations(
        self, settings: Sequence[Setting], done: Callable[[], None] | None = None
    ) -> list[list[Expectation | None]]:
        """The `Expectation` of each draw at each setting. done: called after each of them."""
        jobs = [(k, curve) for setting in settings for k, curve in enumerate(self.films(setting))]
        found = run_jobs(lambda job: self.expectation(*job), jobs, None, (lambda *_: done()) if done else None)
        count = len(self.law)
        return [found[i : i + count] for i in range(0, len(jobs), count)]


def _draws(shot: Experiment, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draws x (k, d) of the posterior by the emulator, over all states of the switches, and their log weights (k,).
    Raises SolverError: there is no such bubble.

    The emulator also answers where the measured R_max is somewhat smaller than those that it knows, for which `infer`
    takes simulations."""
    target = Target(shot)
    found = [
        _sampled(model, lambda x: target.measured - shot.emulated(x, emulator()), rng)
        for model in target.models(shot.noise(discrepancy=True))
    ]
    if not any(len(x) for x, _ in found):
        raise SolverError(f"{shot.curve.name}: there is no such bubble")
    x, log_weight = (np.concatenate(part) for part in zip(*found, strict=True))
    return x, log_weight


def _sampled(model: Model, quick: Frames, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draws x (k, d) of one model and their log weights (k,), of which the exponentials sum to its evidence; none where
    there is no such bubble. quick: residuals (k, n) at x."""

    def residuals(u: Floats) -> Floats:
        return quick(model.to_x(u))

    maxima = alone(finding_maxima(model.noise, model.dimension, BUDGET, rng), residuals)
    if not np.any(np.isfinite(maxima.value)):
        return model.to_x(np.zeros((0, model.dimension))), np.zeros(0)
    mixture = ridges(residuals, model.noise, maxima, BUDGET, rng, LOOKED_AT, REACH)
    rounds = first_round(mixture, BUDGET.rounds[0], residuals, rng)
    draws, _ = sample(residuals, model.log_posterior, rounds, BUDGET.rounds, rng, BUDGET.sampled, BUDGET.walkers)
    return model.to_x(draws.u), draws.log_weight + draws.log_evidence


def variance(ends: Floats) -> Floats:
    """Variances (l,) in decades squared from 90 % intervals: (l, 3) log10 of low, median and high."""
    return np.asarray(((ends[:, 2] - ends[:, 0]) / (2.0 * NORMAL_90)) ** 2)


def gain(information: Floats, covariance: Floats) -> float:
    """Information gain of a shot on a material in nats: half log det(1 + covariance information), both (l, l)."""
    return 0.5 * float(np.linalg.slogdet(np.eye(len(covariance)) + covariance @ information)[1])


def material_information(information: Floats, scatter: Floats) -> Floats:
    """Information (l, l) of one shot on the material; scatter: (l, l) covariance of shots about it, decades squared."""
    return np.asarray(np.linalg.solve(np.eye(len(information)) + information @ scatter, information))


def shots_wanted(information: Floats, covariance: Floats, half_width: float) -> int | None:
    """Number of shots that bring each parameter's 90 % interval to `half_width` decades about the median; None if it is
    more than MOST_SHOTS. information: (l, l) of one shot on the material. covariance: (l, l) of what is known."""
    before = np.linalg.inv(covariance)

    def enough(count: int) -> bool:
        left = np.linalg.inv(before + count * information)
        return bool(np.max(NORMAL_90 * np.sqrt(np.diag(left))) <= half_width)

    count = bisect_left(range(MOST_SHOTS + 1), True, key=enough)
    return count if count <= MOST_SHOTS else None
