"""The expected posterior of a recording that a setup could make, before the shot is taken.

Materials are drawn from what is known. A recording of each is simulated as the setup would film it, and read like a
measured one. At the maximum of its posterior, which is searched from the truth, the Fisher information is F = J' W J,
with J = d(frames)/du and u the coordinates in which the prior is standard normal. Clock, radius scale, R_max and
stretch are free, so the information on the law's parameters l is what is left when all others n are integrated out
(Chaloner and Verdinelli 1995, doi:10.1214/ss/1177009939, on the Gaussian approximation),

    P = (F + 1)_ll - (F + 1)_ln (F + 1)_nn^-1 (F + 1)_nl - 1_ll.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from cavirheo.arrays import NORMAL_90, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError, expect_whole, require
from cavirheo.inference.answer import Target
from cavirheo.inference.assumptions import FREE, SCALE_BOUND, Family, Options, fixed_bubble
from cavirheo.inference.experiment import BOUND_SCALES, BOUND_SIGMAS, ZETA, Experiment
from cavirheo.inference.noise import GAMMA_A, Noise
from cavirheo.inference.sample import climb
from cavirheo.parallel import run_jobs
from cavirheo.parameters import INTERVAL, PARAMETERS, RADIUS
from cavirheo.physics.bubble import FREE as INFERRED
from cavirheo.physics.bubble import REAL, ZERO_BY_DEFAULT, Bubble
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import simulate
from cavirheo.prior import log_normal

ROUNDS = 4  # iterations of the weight of the frames and of the maximum
DENSITY_POINTS = 8001  # points of a marginal density
INSIDE = 1e-3  # of the probability, that the start of a climb keeps away from the bounds
LN10 = float(np.log(10.0))
RECORDED_GROWTH = 0.8  # t_c before R_max at which a recording begins
_NODES = np.linspace(-0.5, 0.5, 9)  # instants in an exposure, in its unit
_STARTED: Any = PARAMETERS["accommodation"].start_range


@dataclass(frozen=True)
class Setting:
    """The settings of a shot. max_radius: m, the intended R_max. frame_rate: 1/s. noise: m, of the radius of a frame;
    relative_noise: over R_max, added in quadrature. frames: their number. exposure: s. Raises InputError."""

    max_radius: float
    frame_rate: float
    noise: float = 0.0
    relative_noise: float = 0.01
    frames: int = 128
    exposure: float = 0.0

    def __post_init__(self) -> None:
        RADIUS.check("the R_max of a setting", self.max_radius, "design.max_radius")
        require(self.frame_rate > 0, f"a frame rate must be positive, got {self.frame_rate}", "design.frame_rate")
        INTERVAL.check("the time between two frames", 1.0 / self.frame_rate, "design.frame_rate")
        expect_whole(self.frames, "frames", 10, "design.frames")
        message = f"the noise must be positive, got {self.noise:g} m and {self.relative_noise:g} of R_max"
        fine = self.noise >= 0 and 0 <= self.relative_noise < 0.5 and self.sigma > 0
        require(fine, message, "design.noise")
        longest = f"an exposure of {self.exposure:g} s does not fit between frames of {1.0 / self.frame_rate:g} s"
        require(0 <= self.exposure <= 1.0 / self.frame_rate * (1 + 1e-6), longest, "design.exposure")

    @property
    def sigma(self) -> float:
        """Standard deviation of the radius of a frame, m."""
        return float(np.hypot(self.noise, self.relative_noise * self.max_radius))

    def film(
        self, family: Family, law: Floats, stretch: float, medium: Medium = WATER, seed: int = 0, bubble: Bubble = REAL
    ) -> tuple[RadiusCurve, dict[str, float]]:
        """A simulated recording of one bubble in the material of (parameters,) log10 `law`, and its true parameters by
        natural name. Clock and scale have errors as those of a camera; free parameters of the bubble are drawn. Raises
        InputError or SolverError."""
        rng = np.random.Generator(np.random.Philox(seed))
        late, off = rng.uniform(), rng.normal()
        frame = 1.0 / self.frame_rate
        time = frame * (late + np.arange(self.frames)) - RECORDED_GROWTH * medium.time_scale(self.max_radius)
        instants = np.abs(time[:, None] + self.exposure * (_NODES if self.exposure else np.zeros(1))).ravel()
        order = np.argsort(instants, kind="stable")
        values = fixed_bubble(bubble, self.max_radius)
        if bubble.contents == "kinetic" and bubble.accommodation == INFERRED:
            values["accommodation"] = float(10.0 ** rng.uniform(*_STARTED))
        if bubble.confinement_damping == INFERRED:
            values["confinement_damping"] = float(np.minimum(np.abs(ZETA * rng.normal()), BOUND_SCALES * ZETA))
        numbers: Any = {**dict.fromkeys(ZERO_BY_DEFAULT, 0.0), **values}
        shot: Any = {"max_radius": self.max_radius, "stretch": stretch, "medium": medium, "time": instants[order]}
        bubble = replace(bubble, damage="none", wall_distance=None, **numbers)
        simulated = np.empty(len(instants))
        simulated[order] = simulate(family.material(law), **shot, bubble=bubble).radius
        scale = 1.0 + off * SCALE_BOUND / BOUND_SIGMAS
        radius = simulated.reshape(self.frames, -1).mean(axis=1) / scale + self.sigma * rng.standard_normal(self.frames)
        meta = {"name": "designed", "frame_rate_hz": self.frame_rate, "exposure_s": self.exposure}
        curve = RadiusCurve(np.asarray(time, dtype=np.float64), np.maximum(radius, 1e-3 * self.max_radius), meta=meta)
        truth = dict(zip(family.parameters, (10.0**law).tolist(), strict=True)) | {"stretch": stretch} | values
        truth |= {"time_origin": -curve.time_of_max, "radius_scale": scale}
        return curve, truth | {"max_radius_factor": self.max_radius / (scale * curve.max_radius)}


@dataclass(frozen=True, eq=False)
class Expectation:
    """The expected information of one shot, for one draw of what is known. information: (l, l) of the likelihood on
    log10 of the law's parameters, at the truth. half_width: (l,) decades, half of the 90 % interval that the shot alone
    gives."""

    information: Floats
    half_width: Floats


def compute_expectation(
    curve: RadiusCurve, truth: dict[str, float], family: Family, medium: Medium = WATER, bubble: Bubble = REAL
) -> Expectation:
    """`Expectation` of a recording with this truth. Raises InputError: it cannot be read, or SolverError."""
    options = Options(free=tuple(FREE), bubble=bubble)
    shot = Experiment(curve, family, medium, options)
    target, noise = Target(shot), shot.noise(discrepancy=True)
    x = shot.from_best(truth)
    state = target.state(x)
    prior = state.prior
    found = climb(lambda u: target.quick(state.to_x(u)), noise, state.to_u(x[None], INSIDE))
    if not np.isfinite(found.value[0]):
        raise SolverError(f"{curve.name}: there is no such bubble")
    mode = found.u[0]
    residual, jacobian = target.quick(state.to_x(found.u))[0], target.jacobian(state, mode)
    size, (u, covariance) = shot.law_size, linearised(noise, mode, residual, jacobian)
    covariance, slope, middle = covariance[:size, :size], prior.slope(u)[:size], prior.to_x(u)[:size]
    information = (np.linalg.inv(covariance) - np.eye(size)) / np.outer(slope, slope)
    moved = np.diag(10.0 ** (np.log10([truth[name] for name in family.parameters]) - middle))
    values, vectors = np.linalg.eigh(moved @ information @ moved)  # frames are linear in G and mu, not in their logs
    deviation = slope / np.sqrt(np.maximum(1.0 / np.diag(covariance) - 1.0, 1e-12))
    ends = list(map(interval, middle, deviation, prior.low[:size], prior.high[:size]))
    half_width = 0.5 * np.ptp(np.array(ends), axis=1)
    return Expectation(vectors @ np.diag(np.maximum(values, 0.0)) @ vectors.T, half_width)


def interval(middle: float, deviation: float, low: float, high: float) -> tuple[float, float]:
    """Ends of the 90 % interval of log10 of a parameter whose likelihood is a Gaussian of the parameter itself, with
    this middle and this deviation in decades. If the frames hardly determine a modulus, the interval reaches down to
    the low end of its uniform prior."""
    x = np.linspace(low, high, DENSITY_POINTS)
    density = np.exp(-0.5 * (np.expm1(LN10 * (x - middle)) / (LN10 * deviation)) ** 2)
    below = np.cumsum(density) / np.sum(density)
    first, last = np.interp([0.05, 0.95], below, x)
    return float(first), float(last)


def linearised(noise: Noise, u: Floats, residual: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
    """Mean (d,) and covariance (d, d) of the posterior in u, if the frames are linear in u: residual (n,) and jacobian
    (n, d) at u (d,). Each size of the discrepancy (noise.py) has one Gaussian, about its own maximum and weighted by
    its evidence: if the frames do not show how large the discrepancy is, wide Gaussians count, too."""
    size, both = len(u), np.column_stack([jacobian, residual])
    middles, spreads, heights = [], [], []
    for product, constant in zip(noise.products(both), noise.constants, strict=True):
        curved, slope, square = product[:size, :size], product[:size, -1], float(product[-1, -1])
        for _ in range(ROUNDS):  # the size of the residual decides the weight of the frames (Student's t)
            weight = noise.power / (GAMMA_A + 0.5 * square)
            covariance = np.linalg.inv(weight * curved + np.eye(size))
            step = covariance @ (weight * slope - u)
            square = float(product[-1, -1] - 2.0 * step @ slope + step @ curved @ step)
        middles.append(u + step)
        spreads.append(covariance)
        height = constant - noise.power * np.log1p(square / (2.0 * GAMMA_A)) + 0.5 * np.linalg.slogdet(covariance)[1]
        heights.append(height + log_normal(middles[-1]))
    share = np.exp(np.array(heights) - logsumexp(heights))
    mean = share @ np.array(middles)
    off = np.array(middles) - mean
    return mean, np.einsum("g,gij->ij", share, np.array(spreads)) + np.einsum("g,gi,gj->ij", share, off, off)


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of the material of a shot: law (draws, l) log10 of the parameters of `family`, stretch (draws,), medium and
    bubble. The noise of a draw depends on the seed and is the same at all settings."""

    family: Family
    law: Floats
    stretch: Floats
    medium: Medium = WATER
    bubble: Bubble = REAL
    seed: int = 0

    def shot(self, setting: Setting, k: int) -> tuple[RadiusCurve, Expectation] | None:
        """The recording of draw k and its `Expectation`; None if it cannot be read: it ends before the collapse,
        say."""
        family, medium, bubble = self.family, self.medium, self.bubble
        with suppress(InputError, SolverError, np.linalg.LinAlgError):
            curve, truth = setting.film(family, self.law[k], float(self.stretch[k]), medium, self.seed + k, bubble)
            return curve, compute_expectation(curve, truth, family, medium, bubble)
        return None

    def compute_expectations(
        self, settings: Sequence[Setting], workers: int | None = None, done: Callable[[], None] | None = None
    ) -> list[list[Expectation | None]]:
        """The `Expectation` of each draw at each setting; None for a recording that cannot be read."""
        count = len(self.law)
        jobs = [(setting, k) for setting in settings for k in range(count)]
        shots = run_jobs(lambda job: self.shot(*job), jobs, workers, (lambda *_: done()) if done else None)
        expectations = [shot[1] if shot else None for shot in shots]
        return [expectations[i : i + count] for i in range(0, len(jobs), count)]

    def check_widths(self, setting: Setting, workers: int | None = None) -> tuple[Floats, Floats]:
        """Expected half-widths (answers, l) of simulated recordings in decades, and those of the intervals that `infer`
        gives for them; only for recordings that have both."""
        from cavirheo.inference import infer_many

        shots = [shot for shot in run_jobs(lambda k: self.shot(setting, k), range(len(self.law)), workers) if shot]
        options: Any = {"material": self.family.name, "medium": self.medium, "bubble": self.bubble, "workers": workers}
        answers = infer_many([curve for curve, _ in shots], **options)
        pairs = []
        for answer, (_, expectation) in zip(answers, shots, strict=True):
            counts = answer.theta.size and answer.checks.verdict != "check_input"  # else the width is the prior's
            ends = [answer.interval(name) if counts else None for name in self.family.parameters]
            if all(ends):
                pairs.append((expectation.half_width, [0.5 * np.log10(high / low) for low, high in filter(None, ends)]))
        widths = np.reshape(pairs, (len(pairs), 2, len(self.family.parameters)))
        return widths[:, 0], widths[:, 1]


def variance(ends: Floats) -> Floats:
    """Variances (l,) in decades squared from 90 % intervals: (l, 3) log10 of low, median and high."""
    return np.asarray(((ends[:, 2] - ends[:, 0]) / (2.0 * NORMAL_90)) ** 2)


def gain(information: Floats, covariance: Floats) -> float:
    """Information gain of a shot on a material in nats: half log det(1 + covariance information), both (l, l)."""
    return 0.5 * float(np.linalg.slogdet(np.eye(len(covariance)) + covariance @ information)[1])


def material_information(information: Floats, scatter: Floats) -> Floats:
    """Information (l, l) of one shot on the material; scatter: (l, l) covariance of shots about it, decades squared."""
    return np.asarray(np.linalg.solve(np.eye(len(information)) + information @ scatter, information))


def shots_wanted(information: Floats, covariance: Floats, half_width: float, max_count: int = 10_000) -> int | None:
    """Number of shots that bring each parameter's 90 % interval to `half_width` decades about the median; None if it is
    more than `max_count`. information: (l, l) of one shot on the material. covariance: (l, l) of what is known."""
    before = np.linalg.inv(covariance)

    def enough(count: int) -> bool:
        left = np.linalg.inv(before + count * information)
        return bool(np.max(NORMAL_90 * np.sqrt(np.diag(left))) <= half_width)

    count = bisect_left(range(max_count + 1), True, key=enough)
    return count if count <= max_count else None
