"""Experiment: one curve and all assumptions about it. Fit, posterior and evidence use this object.

A frame at t_i shows the mean of R over its exposure; the clock is wrong by t_0, the radii by a scale, and R_max of the
motion by a factor (docs/method/posterior.md):

    y_i = <R(t_i - t_0)>/(scale R_max) + e_i,    R(0) = scale x factor x R_max,    R_max that of the curve.

The parameters x are log10 of the law's parameters, log10 of the shot's (such as the stretch, if it is not given), and
the free ones of t_0, scale, factor, walls and vapour as fractions of their half-widths about the middle, from -1 to 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.assumptions import FREE, Family, Options, fixed_bubble
from cavirheo.inference.camera import (
    GRID_STEP,
    INSTANTS,
    MAX_GRID_STEPS,
    NAMES,
    SIZE_STEP,
    STEPS_PER_FRAME,
    CameraNuisances,
    SimulatedCurve,
    exposure_nodes,
    rescaled,
)
from cavirheo.inference.checks import MISFIT, Window, check_simulation, reconstruct, window
from cavirheo.inference.emulator import Bubbles, Emulator
from cavirheo.inference.frames import compared_frames
from cavirheo.inference.noise import Noise, correlation_time
from cavirheo.messages import Message, message_of_bound
from cavirheo.parameters import LOG10, PARAMETERS, STRETCH_RANGE, bound_of
from cavirheo.physics.accuracy import DEFAULT, Accuracy
from cavirheo.physics.bubble import ACCOMMODATION, FIELD, REAL, ZERO_BY_DEFAULT, Bubble, Damage
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import Simulation, simulate
from cavirheo.posterior import Checks, Verdict, intervals, weighted_quantile
from cavirheo.prior import Prior

MIN_CLOCK, MIN_FACTOR = 0.02, 0.015  # smallest half-widths of the priors of the clock (t_c) and of the R_max factor
DIFFERENCE_STEP = 1e-3  # step of forward differences of x, times `Experiment.steps`
NOISE_FLOOR = 0.007  # of R_max: two circle fits of one video differ by 1.0 % rms, so each has 0.7 %
INSTANT_DEVIATION = 1.0 / np.sqrt(12.0)  # standard deviation of an instant within a frame, frames
FIELD_PROBABILITY = 0.2  # prior probability that a bubble is the field's
SOLVER_ERROR = 1e-3  # smallest noise over R_max that is used: the error of the solver
# scales of the half-normal priors of walls (inertia, damping) and of vapour (over p_inf), which are cut at BOUND_SCALES
BETA, ZETA, EXCESS = 0.3, 0.3, 0.03
BOUND_SCALES = 10.0 / 3.0  # in these scales
BOUND_SIGMAS = 3.0  # standard deviations from the middle to the bound of radius scale and R_max factor
CLEAN_DEVIATION = 1.5e-4  # deviation of the radius over R_max below which a curve is no measurement
CLEAN_MISFIT = 1e-3  # largest RMS misfit over R_max of a simulation of such a curve
STATED_DEVIATION = 0.1  # least standard deviation of a stretch that the file states, over the stretch
TIMING_FACTORS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0)  # values of j that are tried (`Experiment`)
_LN10 = float(np.log(10.0))
_EMULATED = {
    "stretch": 7.0,
    "accommodation": 1.0,
    "confinement_damping": 0.0,
    "damage_modulus": 1.0,
    "damage_radius": 1.0,
}


def half_widths(frame: Floats, noise: Floats, late: Floats) -> tuple[Floats, Floats]:
    """Half-widths of the priors of the clock (in t_c) and of the factor of R_max, from the frame interval in t_c and
    the noise over R_max. late: 1 if no growth is recorded. R_max may then be up to a frame from the first one, where
    the radius is smaller by about (frame/t_c)^2/2."""
    read = np.minimum(2.25 * noise + late * frame**2, 0.2)
    return np.maximum(0.5 * (1.0 + late) * frame, MIN_CLOCK), np.maximum(MIN_FACTOR, read)


def _known_stretch(curve: RadiusCurve, requested: float | str | None) -> tuple[float, float] | None:
    """(mean, standard deviation) of the stretch's prior, from the file or the late plateau; None if there is none. A
    value of the file is often the mean of many shots: its deviation is at least its distance to the plateau."""
    plateau = curve.stretch_from_tail() if requested in (None, "plateau") else None
    stated = curve.stretch if requested is None else None
    if not stated or not STRETCH_RANGE[0] < stated < STRETCH_RANGE[1]:
        return plateau if requested == "plateau" else None
    missed = abs(plateau[0] - stated) if plateau else 0.0
    return stated, max(curve.stretch_std or 0.0, STATED_DEVIATION * stated, missed)


class Prediction(NamedTuple):
    """A simulation as the camera would have measured it; all arrays are (m,), over the measured R_max."""

    radius: Floats
    speed: Floats  # |dR/dt|, 1/s
    velocity: Floats  # dR/dt, 1/s; before R_max the bubble is mirrored


@dataclass
class Simulations:
    """Number of simulations and of failed ones. Several threads may count at the same time."""

    runs: int = 0
    failures: int = 0
    _lock: Lock = field(default_factory=Lock, repr=False)

    def count(self, good: bool) -> None:
        """Count one simulation."""
        with self._lock:
            self.runs += 1
            self.failures += not good


class Experiment:
    """One curve cut to a window, a law, a medium, the camera, and the prior of the parameters x. It is immutable:
    another window or other weights are a new experiment (`cut_to`, `reweighted`), with the same counter of simulations.

    A frame has the variance sigma^2 = sigma_R^2 + (j U dt/sqrt(12))^2: sigma_R is the radius noise (that of the frame
    if the file states it, else the frame-to-frame noise of the curve, at least 0.7 % of R_max), U the wall's speed, and
    dt the frame interval, within which the instant of the frame may be unknown. j is 0 except in the result of
    `reweighted`.

    names: (d,) of x. bounds: (d, 2). time_since_max, measured, sigma: (m,) of the frames in the window that are
    compared, measured ones or means (frames.py): s after R_max, R/R_max, assumed deviation over R_max. averaged: (m,)
    number of measured frames in each. counted: (m,) frames that neither stand out nor drift. view: the window with all
    its frames. usable: (n,) which of these count. Raises InputError: the curve has no maximum or not enough collapses
    for the window; an exposure longer than the frame interval; damage of a law without elasticity; a wall nearer than
    R_max."""

    def __init__(
        self, curve: RadiusCurve, family: Family, medium: Medium = WATER, options: Options | None = None, *,
        simulations: Simulations | None = None,
    ) -> None:  # fmt: skip
        options = options or Options()
        self.curve, self.family, self.medium, self.options = curve, family, medium, options
        self.max_radius: float = curve.max_radius
        self.time_scale: float = medium.time_scale(self.max_radius)
        self.frame_interval: float = float(np.median(np.diff(curve.time)))
        self.exposure = exposure = float(curve.exposure or 0.0)
        message = f"an exposure of {exposure * 1e6:.4g} us is "
        require(0.0 <= exposure < np.inf, message + "no time", "experiment.exposure", curve.name)
        longest = f"longer than the time between two frames ({self.frame_interval * 1e6:.4g} us)"
        require(exposure <= self.frame_interval * (1.0 + 1e-6), message + longest, "experiment.exposure", curve.name)
        self.simulations: Simulations = simulations or Simulations()
        stretch = None if isinstance(options.stretch, str) else options.stretch
        self.stretch: float | None = float(stretch) if stretch else None
        # (mean, standard deviation) of the stretch if the file or the late plateau gives it
        self.stretch_prior: tuple[float, float] | None = _known_stretch(curve, options.stretch)
        read = max(options.scale_bound, self.usual_half_widths[1])
        # (middle, half-width, unit of the steps of finite differences) of clock and scales, and which are free
        widths = {
            "t0": (*self._clock, self.time_scale),
            "scale": (1.0, options.scale_bound, 1.0),
            "rmax": (1.0, read, 1.0),
        }
        self.free: dict[str, tuple[float, float, float]] = {FREE[name]: widths[name] for name in options.free}
        bubble, p = options.bubble, medium.pressure
        for name, width, unit in zip(ZERO_BY_DEFAULT, (BETA, ZETA, EXCESS * p), (1.0, 1.0, p), strict=True):
            if getattr(bubble, name) == "free":
                self.free[name] = (0.5 * BOUND_SCALES * width, 0.5 * BOUND_SCALES * width, unit)
        self.bubble: dict[str, float] = fixed_bubble(bubble, self.max_radius)
        message = f"damage needs a law with an elastic part, {family.name} has none: leave out damage"
        require(bubble.damage == "none" or family.elastic, message, "physics.damage_without_elasticity")
        free_logs = {
            "stretch": not self.stretch,
            "accommodation": bubble.contents == "kinetic" and bubble.accommodation == "free",
            "damage_modulus": bubble.damage != "none", "damage_radius": bubble.damage != "none",
        }  # fmt: skip
        self.log_names: tuple[str, ...] = tuple(name for name, free in free_logs.items() if free)  # of the shot; log10
        self.shot_names: tuple[str, ...] = (*self.log_names, *self.free)
        self.law_size: int = len(family.parameters)  # number of parameters of the law, the first in x
        self.names: tuple[str, ...] = (*family.parameters, *self.shot_names)
        units = [unit / width for _, width, unit in self.free.values()]
        self.steps: Floats = np.array([1.0] * (len(self.names) - len(units)) + units)  # steps of x over DIFFERENCE_STEP
        ranges = [PARAMETERS[name].search_range if name in self.log_names else (-1.0, 1.0) for name in self.shot_names]
        self.bounds: Floats = np.concatenate([family.bounds(), np.array(ranges, dtype=float).reshape(-1, 2)])
        requested, recorded = options.window, len(curve.collapse_times())
        if requested is None and options.end is None and recorded:
            requested = min(3, recorded)
        collapses = None if requested in (None, "all") else int(requested)
        self.extent: tuple[int | None, float | None] = (collapses, options.end)  # the window
        self._frames_end = -np.inf  # of the window of which `_frames` are the compared frames, s after R_max
        self._cut(*self.extent)

    def cut_to(self, collapses: int | None, end: float | None = None) -> Experiment:
        """The experiment cut to this number of collapses (None: all) and at most `end` s, with equal weights. In a
        shorter window, the compared frames are the first ones of this experiment."""
        experiment = copy(self)
        experiment._cut(collapses, end)
        return experiment

    def _cut(self, collapses: int | None, end: float | None) -> None:
        self.view: Window = window(self.curve, collapses=collapses, end=end)
        cut, last = self.view.curve, self.view.end * (1.0 + 1e-9)
        time, wrong = cut.time[np.isfinite(cut.radius)], self.curve.time[self.curve.spikes()]
        self.usable: Bools = ~np.isin(time, wrong) & ~self._drifting(time)
        if last > self._frames_end:
            self._frames, self._frames_end = compared_frames(cut, self.usable), last
        since = self._frames.time - self.curve.time_of_max
        some = since <= last
        frames = self._frames
        self.time_since_max: Floats = since[some]
        self.measured: Floats = frames.radius[some] / self.max_radius
        self.averaged: Floats = frames.averaged[some]
        stated, noise = frames.radius_std[some] / self.max_radius, self.curve.noise / self.max_radius
        valid = np.isfinite(stated) & (stated > 0)
        root = np.sqrt(self.averaged)
        self._radius_sigma = np.where(valid, stated, max(noise, NOISE_FLOOR) / root)
        self._measured_sigma = np.maximum(np.where(valid, stated, noise / root), SOLVER_ERROR / root)
        self.counted: Bools = frames.usable[some]
        self.noise_factor: float = 1.0
        self.sigma: Floats = np.where(self.counted, self._radius_sigma, np.inf)

    def reweighted(self, prediction: Prediction) -> Experiment:
        """The experiment with the sigma of the frames, and the share j of the wall's motion in it, for which the
        residuals of a simulation are most likely. Neighbours with similar residuals count as one (noise_factor)."""
        noise, root = self._radius_sigma, np.sqrt(self.averaged)
        motion = prediction.speed * self.frame_interval * INSTANT_DEVIATION / root
        missed = self.measured - prediction.radius
        shares = np.array(TIMING_FACTORS if self.options.weights == "learnt" else (0.0,))
        squares = noise**2 + (shares[:, None] * motion) ** 2
        sizes = np.mean((missed**2 / squares)[:, self.counted], axis=1)
        lost = np.log(np.maximum(sizes, 1e-12)) + np.mean(np.log(squares[:, self.counted]), axis=1)
        best = int(np.argmin(lost))
        noise, motion = np.sqrt(sizes[best]) * noise, np.sqrt(sizes[best]) * shares[best] * motion
        experiment = copy(self)
        experiment.noise_factor = float(np.sqrt(correlation_time(missed[self.counted])))
        experiment.sigma = np.where(self.counted, np.hypot(np.maximum(noise, SOLVER_ERROR / root), motion), np.inf)
        return experiment

    def stretch_source(self) -> str:
        """Where the stretch comes from, in words."""
        if self.stretch:
            return "given"
        if self.stretch_prior is None:
            return "inferred with the other parameters"
        value, deviation = self.stretch_prior
        source = "late plateau" if self.options.stretch else "stretch that the file states"
        return f"fitted, with the {source} ({value:.3g}, taken as ± {deviation:.2g}) as prior"

    @property
    def usual_half_widths(self) -> tuple[float, float]:
        """Half-widths of the priors of the clock, in t_c, and of the factor of R_max, where none are given."""
        curve, frame = self.curve, self.frame_interval / self.time_scale
        clock, read = half_widths(*map(np.array, (frame, curve.noise / self.max_radius, float(curve.begins_late))))
        return float(clock), float(read)

    @property
    def _clock(self) -> tuple[float, float]:
        """Middle and half-width, s, of the prior of the clock; with all times of R_max that the frames near it allow,
        unless a bound is given."""
        if self.options.t0_bound:
            return 0.0, self.options.t0_bound
        usual = self.usual_half_widths[0] * self.time_scale
        earliest, latest = (time - self.curve.time_of_max for time in self.curve.time_of_max_span)
        low, high = min(earliest, -usual), max(latest, usual)
        return 0.5 * (low + high), 0.5 * (high - low)

    def natural(self, x: Floats) -> dict[str, Any]:
        """Natural values by name of the shot's parameters (stretch, time_origin in s, radius_scale, max_radius_factor,
        ...) from x (d,) or (d, draws)."""
        values: dict[str, Any] = {"time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}
        values |= self.bubble
        if self.stretch:
            values["stretch"] = self.stretch
        for name, value in zip(self.log_names, x[self.law_size :], strict=False):
            values[name] = 10.0**value
        for (name, (middle, width, _)), value in zip(self.free.items(), x[len(x) - len(self.free) :], strict=True):
            values[name] = value * width + middle
        return values

    def bubble_with(self, natural: Mapping[str, Any]) -> Bubble:
        """The bubble with these natural values, as `simulate` takes it; with an infinite accommodation the field's."""
        if natural.get("accommodation") == np.inf:
            return FIELD
        values = {name: natural[name] for name in ("accommodation", *ZERO_BY_DEFAULT) if name in natural}
        damage = self.options.bubble.damage
        if isinstance(damage, str) and damage != "none":
            values["damage"] = Damage(natural["damage_modulus"], natural["damage_radius"], damage)
        return replace(self.options.bubble, wall_distance=None, **values)

    def starts(self, x: Floats) -> Floats:
        """x (..., d) with clock, scales, walls and vapour, if free, where a search starts: at hardly any effect."""
        x = np.array(x)
        for i, name in enumerate(self.names):
            if name in self.free:
                x[..., i] = -0.8 if name in ZERO_BY_DEFAULT else 0.0
        return x

    def from_best(self, best: Mapping[str, float]) -> Floats:
        """x (d,) from natural values by name, clipped to the ranges; parameters without a value have a default."""
        x = self.starts(np.zeros(len(self.names)))
        for i, name in enumerate(self.names):
            if name in self.free and name in best:
                middle, width, _ = self.free[name]
                x[i] = (best[name] - middle) / width
            elif name not in self.free:
                x[i] = np.log10(best.get(name, ACCOMMODATION if name == "accommodation" else 1.0))
        return np.clip(x, *self.bounds.T)

    def as_limit(self, x: Floats, names: Sequence[str]) -> Floats:
        """x (draws, all) of draws x (draws, names) of the field's bubble with the same curve, law and camera, which is
        the limit of the real one: the accommodation at the upper end of its range, and no damping."""
        at_limit = np.tile(self.bounds[:, 0], (len(x), 1))
        for i, name in enumerate(self.names):
            if name in names:
                at_limit[:, i] = x[:, names.index(name)]
            elif name == "accommodation":
                at_limit[:, i] = self.bounds[i, 1]
        return at_limit

    def all_values(self, x: Floats) -> dict[str, float]:
        """Every parameter by its natural name in SI, including those that were held fixed."""
        law = dict(zip(self.family.parameters, (10.0 ** x[: self.law_size]).tolist(), strict=True))
        return law | {name: float(value) for name, value in self.natural(x).items()}

    def to_theta(self, x: Floats) -> tuple[tuple[str, ...], Floats]:
        """Names and theta (draws, d) as in a Posterior from x (draws, d): log10 for the law, natural values for the
        rest."""
        natural = self.natural(x.T)
        names = (*(LOG10 + name for name in self.family.parameters), *self.shot_names)
        return names, np.column_stack([x[:, : self.law_size], *(natural[name] for name in self.shot_names)])

    def log_jacobian(self, theta: Floats) -> Floats:
        """log |dtheta/dx| (draws,) at theta (draws, d) of `to_theta`; it is added to log densities over theta, for
        x."""
        logs = theta[:, self.law_size : self.law_size + len(self.log_names)]  # values, not logarithms as in x
        widths = np.sum(np.log([width for _, width, _ in self.free.values()]))
        return np.asarray(widths + np.sum(np.log(logs * _LN10), axis=1))

    def prior(self, ranges: Mapping[str, Sequence[float]] | None = None) -> Prior:
        """The proper prior of x. log10 of the parameters of law and shot: uniform in the ranges that a fit searches, or
        in `ranges` ({"shear_modulus": [low, high] in SI}); the stretch is normal if the file or the plateau gives it.
        Time origin: uniform within its bound. Radius scale and R_max factor: normal, with a third of their bound as
        standard deviation. Walls and vapour above saturation: half-normal. Raises InputError: a range of an unknown
        parameter, or one that is not positive and rising."""
        bounds, unused = self.bounds.copy(), dict(ranges or {})
        zero = np.array([self.family.atoms.get(name, 0.0) for name in self.names])
        infinite = np.zeros(len(self.names))
        if self.options.bubble == REAL:
            infinite[self.names.index("accommodation")] = FIELD_PROBABILITY
        mean, std = np.zeros(len(self.names)), np.full(len(self.names), np.inf)
        for i, name in enumerate(self.names):
            if name in unused and name not in self.free:
                pair = unused.pop(name)
                message = f"the prior range of {name} must be [low, high] with 0 < low < high, got {list(pair)}"
                require(len(pair) == 2 and 0 < pair[0] < pair[1] < np.inf, message, "prior.range")
                bounds[i] = np.log10(pair)
            if name == "stretch" and self.stretch_prior:
                value, deviation = self.stretch_prior
                mean[i], std[i] = float(np.log10(value)), deviation / (value * _LN10)
            if name in ("radius_scale", "max_radius_factor"):
                std[i] = 1.0 / BOUND_SIGMAS
            if name in ZERO_BY_DEFAULT:
                mean[i], std[i] = -1.0, 2.0 / BOUND_SCALES
        message = f"no prior range can be set for {', '.join(unused)}; known: {', '.join(self.names)}"
        require(not unused, message, "prior.name")
        return Prior(self.names, bounds[:, 0], bounds[:, 1], mean, std, zero, infinite)

    def law_prior(self, prior: Prior) -> dict[str, tuple[float, ...]]:
        """The prior of the law's parameters, by their names in theta, as a Posterior stores it."""
        rows = prior.to_dict()
        return {LOG10 + name: tuple(rows[name]) for name in self.family.parameters}

    def predict(self, x: Floats, accuracy: Accuracy = DEFAULT, *, times: Floats | None = None) -> Prediction | None:
        """The frames that the camera would have measured at x (d,), at their times or at other times since R_max (m,),
        s; None if the simulation failed. Instants before R_max are mirrored (R is even to third order there)."""
        natural, (offsets, shares) = self.natural(x), exposure_nodes(self.exposure, INSTANTS)
        times = self.time_since_max if times is None else times
        instants = (times[:, None] - natural["time_origin"] + offsets).ravel()
        side, instants = np.sign(instants), np.abs(instants)
        order = np.argsort(instants, kind="stable")
        scale = natural["radius_scale"]
        run = self._run(x, natural, self.max_radius * scale * natural["max_radius_factor"], instants[order], accuracy)
        if run is None:
            return None
        at_instants = np.empty((3, len(instants)))
        at_instants[:, order] = np.array([run.radius, np.abs(run.velocity), run.velocity]) / (scale * self.max_radius)
        at_instants[2] *= side
        return Prediction(*(np.asarray(values.reshape(-1, len(offsets)) @ shares) for values in at_instants))

    def emulated(self, x: Floats, emulator: Emulator, scale: float = 1.0) -> Floats:
        """(k, n) simulated R over the measured R_max of the frames that count, at x (k, d), by the emulator; NaN where
        the law does not hold. scale: factor of the times of the frames."""
        natural, k = self.natural(x.T), len(x)
        size = {
            name: np.broadcast_to(natural[name], (k,)) for name in ("time_origin", "radius_scale", "max_radius_factor")
        }
        factor = size["max_radius_factor"]
        radius = self.max_radius * size["radius_scale"] * factor
        values = {name: np.broadcast_to(natural.get(name, default), (k,)) for name, default in _EMULATED.items()}
        accommodation = np.full(k, np.inf)
        if self.options.bubble.contents == "kinetic":
            accommodation = values["accommodation"]
        real = np.isfinite(accommodation) | (self.options.bubble.contents != "kinetic")
        bubbles = Bubbles(
            self.family.material(x[:, : self.law_size]), self.medium, radius, values["stretch"], accommodation,
            np.where(real, values["confinement_damping"], 0.0), values["damage_modulus"], values["damage_radius"],
        )  # fmt: skip
        offsets, shares = exposure_nodes(self.exposure, INSTANTS)
        since = scale * self.time_since_max[self.counted]
        instants = np.abs((since[:, None] + offsets).ravel() - size["time_origin"][:, None])
        at_instants = emulator.radius(bubbles, instants).reshape(k, len(since), len(offsets))
        return np.asarray(factor[:, None] * (at_instants @ shares))

    def _run(
        self, x: Floats, natural: Mapping[str, Any], max_radius: float, time: Floats, accuracy: Accuracy
    ) -> Simulation | None:  # fmt: skip
        """The simulation of x (d,) with its natural values at these times, s; None if it failed. Both are counted."""
        try:
            run = simulate(
                self.family.material(x[: self.law_size]), max_radius=max_radius, stretch=natural["stretch"], time=time,
                medium=self.medium, bubble=self.bubble_with(natural), accuracy=accuracy, throw=False,
            )  # fmt: skip
            good = run.ok and bool(np.all(np.isfinite(run.radius)))
        except InputError:  # parameters that exclude each other count as a failed simulation
            good = False
        self.simulations.count(good)
        return run if good else None

    @property
    def camera(self) -> CameraNuisances:
        """The unknown clock, radius scale and R_max factor of the frames that count."""
        units = (1.0 / np.sqrt(3.0), 1.0 / BOUND_SIGMAS, 1.0 / BOUND_SIGMAS)  # deviations over half-widths
        widths = [
            self.free[name][1] * unit if name in self.free else 0.0 for name, unit in zip(NAMES, units, strict=True)
        ]
        time, measured = self.time_since_max[self.counted], self.measured[self.counted]
        step = min(self.frame_interval / STEPS_PER_FRAME, GRID_STEP * self.time_scale)
        step = max(step, float(np.max(time, initial=0.0)) / MAX_GRID_STEPS)
        clock = self.free[NAMES[0]][0] if NAMES[0] in self.free else 0.0
        return CameraNuisances(time, measured, np.array(widths), self.exposure, step, self.view.collapses, clock=clock)

    def extended(
        self, x: Floats, camera: CameraNuisances, noise: Noise, accuracy: Accuracy = DEFAULT
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Extended residual (size,) (camera.py) of x (d,), without the camera's part of x, and the curvature (m, m)
        about the most likely camera; NaN if the simulation failed."""
        curve, m = self.solve_on_grid(x, camera, accuracy), len(camera.free)
        if curve is None:
            return np.full(camera.size, np.nan), np.full((m, m), np.nan)
        return camera.extended(curve, noise)

    def solve_on_grid(self, x: Floats, camera: CameraNuisances, accuracy: Accuracy = DEFAULT) -> SimulatedCurve | None:
        """The simulation of x (d,) on the camera's grid, for `extended`; None if it failed."""
        natural, by_size, speed_by_size = self.natural(x), *np.zeros((2, len(camera.grid)))
        run = self._run(x, natural, self.max_radius, camera.grid, accuracy)
        if run is None:
            return None
        if camera.simulates_size:
            size = 1.0 + SIZE_STEP
            law = rescaled(self.family.parameters, x[None, : self.law_size], np.array([size]))[0]
            x = np.concatenate([law, x[self.law_size :]])
            larger = self._run(x, natural, size * self.max_radius, size * camera.grid, accuracy)
            if larger is None:
                return None
            by_size = (larger.radius / size - run.radius) / (self.max_radius * SIZE_STEP)
            speed_by_size = (larger.velocity - run.velocity) / (self.max_radius * SIZE_STEP)
        return SimulatedCurve(run.radius / self.max_radius, run.velocity / self.max_radius, by_size, speed_by_size)

    def residual(self, prediction: Prediction | None) -> Floats:
        """(m,) (measured - simulated)/sigma; a failed simulation differs by R_max everywhere: large, but finite."""
        difference = self.measured - prediction.radius if prediction is not None else np.ones(len(self.measured))
        return np.asarray(difference / (self.sigma * self.noise_factor))

    def camera_slopes(self, x: Floats, prediction: Prediction, by_law: Floats) -> Floats:
        """Derivatives (m, camera) of the residual by the free ones of clock, scale and factor, without a simulation:
        bubbles of all sizes are alike (camera.py). prediction: at x. by_law: (m, law) derivatives by the law's."""
        natural, weight = self.natural(x), 1.0 / (self.sigma * self.noise_factor)
        power = rescaled(self.family.parameters, x[None, : self.law_size], np.array([10.0]))[0] - x[: self.law_size]
        later = prediction.velocity * (self.time_since_max - natural["time_origin"])
        same = by_law @ power / _LN10  # a larger bubble is like an equal one in a thinner law
        slopes = {
            "time_origin": prediction.velocity * weight,
            "radius_scale": (later * weight - same) / natural["radius_scale"],
            "max_radius_factor": ((later - prediction.radius) * weight - same) / natural["max_radius_factor"],
        }
        columns = [slopes[name] * self.free[name][1] for name in self.names if name in slopes]
        return np.array(columns).reshape(len(columns), len(self.time_since_max)).T

    def difference(self, x: Floats, accuracy: Accuracy = DEFAULT) -> Floats:
        """(n,) measured minus simulated, over R_max, of the frames that count; NaN if the simulation failed."""
        prediction = self.predict(x, accuracy, times=self.time_since_max[self.counted])
        measured = self.measured[self.counted]
        return np.full(len(measured), np.nan) if prediction is None else measured - prediction.radius

    @property
    def noise_over_rmax(self) -> float:
        """RMS frame-to-frame noise, over R_max, of the frames that count; that of a mean is smaller."""
        share = float(np.mean(1.0 / self.averaged[self.counted]))
        return self.curve.noise / self.max_radius * float(np.sqrt(share))

    def misfit(self, difference: Floats) -> float:
        """RMS of the part of measured minus simulated (n,), over R_max, that exceeds the frame-to-frame noise."""
        excess = float(np.mean(difference**2)) - self.noise_over_rmax**2
        return float(np.sqrt(max(excess, 0.0)))

    def noise(self, discrepancy: bool) -> Noise:
        """The distribution of the frames that count about the simulation (noise.py). The assumed deviations are those
        of the file, else the frame-to-frame noise. With `discrepancy` the latter is at least 0.7 % of R_max, and
        deviations are larger where the wall turns, by its curvature over half a frame. Raises InputError: fewer than
        three frames count."""
        count = int(np.sum(self.counted))
        message = f"{count} frames are too few for a posterior"
        require(count >= 3, message, "experiment.too_few_frames", self.curve.name)
        time, measured, turn = self.time_since_max, self.measured, np.zeros(len(self.measured))
        velocity, twice = np.gradient(measured, time), time[2:] - time[:-2]
        frame = 0.5 * twice / self.averaged[1:-1]
        turn[1:-1] = np.diff(np.diff(measured) / np.diff(time)) / twice * frame**2 / 4.0
        deviation = np.hypot(self._radius_sigma, turn) if discrepancy else self._measured_sigma
        typical = float(np.median((deviation * np.sqrt(self.averaged))[self.counted]))  # of one frame
        deviation, since, velocity = (values[self.counted] for values in (deviation, time, velocity))
        return Noise(deviation, since, self.time_scale, discrepancy, velocity, typical)

    def white_noise(self) -> Noise:
        """Independent noise with the weights of a fit (`reweighted`) in the frames that count."""
        deviation = (self.sigma * self.noise_factor)[self.counted]
        return Noise(deviation, self.time_since_max[self.counted], self.time_scale, discrepancy=False)

    def checks(self, x: Floats, verdict: Verdict, messages: Sequence[Message]) -> Checks:
        """The checks of the simulation at x. What is drawn has clock and scale of the measurement, not those of x."""
        natural, cut = self.natural(x), self.view.curve
        scale, origin = natural["radius_scale"], natural["time_origin"]
        maximum = (cut.time_of_max + origin, self.max_radius * scale * natural["max_radius_factor"])
        moved = replace(cut, radius=cut.radius * scale, radius_std=cut.radius_std * scale, maximum=maximum)
        view = Window(moved, self.view.end - origin, self.view.collapses)
        material, bubble = self.family.material(x[: self.law_size]), self.bubble_with(natural)
        simulated = reconstruct(view, material, self.medium, natural["stretch"], bubble)
        simulated["reconstruction_radius"] = simulated["reconstruction_radius"] / scale
        for name in ("compared_time", "residual_over_rmax"):
            simulated[name] = simulated[name][self.usable]
        limit = CLEAN_MISFIT if self.clean else MISFIT
        return check_simulation(self.view, simulated, self.time_scale, verdict, messages, limit)

    @property
    def clean(self) -> bool:
        """Whether the curve is no measurement: its stated deviation, else its noise, is smaller than a camera's."""
        stated = self.curve.radius_std[self.curve.radius_std > 0]
        deviation = float(np.median(stated)) if len(stated) else self.curve.noise
        return deviation < CLEAN_DEVIATION * self.max_radius

    def bound_messages(self, x: Floats, low: Floats, high: Floats, log_weight: Floats | None = None) -> list[Message]:
        """A message for each parameter of the law, and for the stretch, of which the central 90 % of x (draws, d) reach
        an end of the range from low to high (d,)."""
        messages = list[Message]()
        for name, values, a, b in zip(self.names, x.T, low, high, strict=True):
            if name not in (*self.family.parameters, "stretch") or len(x) < 2:
                continue
            low_end, high_end = weighted_quantile(values, np.array([0.05, 0.95]), log_weight)
            if bound := bound_of(low_end, high_end, (a, b)):
                messages.append(
                    message_of_bound(name, bound, intervals([LOG10 + name], values[:, None], log_weight)[name])
                )
        return messages

    @property
    def messages(self) -> list[Message]:
        """Messages on frames that do not count, and on the use of a stretch that the recording gives."""
        spikes = int(np.count_nonzero(~self.counted & ~self._drifting(self.time_since_max + self.curve.time_of_max)))
        messages, stated, (low, high) = list[Message](), self.curve.stretch, STRETCH_RANGE
        if self.stretch_prior:
            value, deviation = self.stretch_prior
            source = "late_plateau" if self.options.stretch else "file"
            messages.append(Message(f"stretch_prior.{source}", {"value": value, "deviation": deviation}))
        elif stated is not None and self.options.stretch is None and not low < stated < high:
            messages.append(Message("stretch.left_out", {"stretch": stated, "low": low, "high": high}))
        if len(self.measured) < len(self.usable):
            counts = {"frames": len(self.usable), "means": len(self.measured)}
            messages.append(Message("frames.averaged", counts))
        if spikes:
            messages.append(Message("frames.spikes", {"frames": spikes}))
        drifting = self.curve.time[self._drifting(self.curve.time)]
        if len(drifting):
            since = float(drifting[0] - self.curve.time_of_max)
            messages.append(Message("frames.other_bubble", {"frames": len(drifting), "since": since}))
        return messages

    def _drifting(self, time: Floats) -> Bools:
        """Which frames at these times (m,), s, do not count because the radius drifts upwards (`drifts_from`)."""
        first = self.curve.drifts_from
        return time >= (np.inf if first is None else first)
