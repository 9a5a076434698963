"""Experiment: one curve and all assumptions about it. Fit, posterior and evidence use this object.

A frame at t_i shows the mean of R over its exposure; the clock is wrong by t_0, the radii by a scale, and R_max of the
motion by a factor (docs/method/posterior.md):

    y_i = <R(t_i - t_0)>/(scale R_max) + e_i,    R(0) = scale x factor x R_max,    R_max that of the curve.

The parameters x are log10 of the law's parameters, log10 of the shot's (such as the stretch, if it is not given), the
free ones of t_0, scale and factor as fractions of their half-widths about the middle, from -1 to 1, and roots of the
free ones of walls and vapour over their scale.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from cavirheo.arrays import LN10, Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.inference.assumptions import FREE, Family, Options, fixed_bubble
from cavirheo.inference.emulator import Bubbles, Camera, Emulator
from cavirheo.inference.frames import SOLVER_ERROR, compared_frames
from cavirheo.inference.noise import Noise
from cavirheo.messages import Message
from cavirheo.parameters import LOG10, PARAMETERS, STRETCH_RANGE, USUAL_STRETCH
from cavirheo.physics.accuracy import DEFAULT, Accuracy
from cavirheo.physics.bubble import ACCOMMODATION, FIELD, REAL, ZERO_BY_DEFAULT, Bubble, Damage
from cavirheo.physics.materials import Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Checks, Verdict
from cavirheo.prior import Prior

INSTANTS, QUICK_INSTANTS = 5, 2  # of an exposure, for the solver and for the emulator
MIN_CLOCK = 0.02  # t_c: smallest half-width of the prior of the clock
NOISE_FLOOR = 0.007  # of R_max: two circle fits of one video differ by 1.0 % rms, so each has 0.7 %
FIELD_PROBABILITY = 0.2  # prior probability that a bubble is the field's
INERTIA_SCALE, DAMPING_SCALE, VAPOUR_SCALE = 0.05, 0.15, 0.015
"""Scales of the priors of walls (inertia, damping) and of vapour (over p_inf): each is its scale times the square of a
normal number (chi squared), up to MOST_ROOT. Bubbles far from walls are likely then, and those near them not excluded.
"""
MOST_ROOT = 2.58
BOUND_SIGMAS = 3.0  # standard deviations from the middle to the bound of radius scale and R_max factor
CLEAN_DEVIATION = 1.5e-4  # deviation of the radius over R_max below which a curve is no measurement
MISFIT = 0.03  # RMSE/R_max above which the model does not fit (docs/method/verdicts.md)
DRAWN = 800  # points of a simulated curve
CLEAN_MISFIT = 1e-3  # RMSE/R_max above which the simulation of a curve that is no measurement does not fit
STATED_DEVIATION = 0.1  # least standard deviation of a stretch that the file states, over the stretch


def _known_stretch(curve: RadiusCurve, requested: float | str | None) -> tuple[float, float] | None:
    """(mean, standard deviation) of the stretch's prior, from the file or the late plateau; None if there is none. A
    value of the file is often the mean of many shots: its deviation is at least its distance to the plateau."""
    plateau = curve.stretch_from_tail() if requested in (None, "plateau") else None
    stated = curve.stretch if requested is None else None
    if not stated or not STRETCH_RANGE[0] < stated < STRETCH_RANGE[1]:
        return plateau if requested == "plateau" else None
    missed = abs(plateau[0] - stated) if plateau else 0.0
    return stated, max(curve.stretch_std or 0.0, STATED_DEVIATION * stated, missed)


class Experiment:
    """One curve cut to a window, a law, a medium, the camera, and the prior of the parameters x. It does not change.

    names: (d,) of x. bounds: (d, 2). time_since_max, measured: (m,) of the frames in the window that are compared,
    measured ones or means (frames.py): s after R_max, R/R_max. averaged: (m,) number of measured frames in each.
    counted: (m,) frames that neither stand out nor drift. window: the curve from R_max to the last measured frame,
    `end` s later, with so many `collapses`. usable: (n,) which of its measured frames count. Raises InputError: the
    curve has no maximum or not enough collapses for the window; an exposure longer than the frame interval; damage of a
    law without elasticity; a wall nearer than R_max."""

    def __init__(
        self, curve: RadiusCurve, family: Family, medium: Medium = WATER, options: Options | None = None
    ) -> None:
        options = options or Options()
        self.curve, self.family, self.medium, self.options = curve, family, medium, options
        self.max_radius: float = curve.max_radius
        self.time_scale: float = medium.time_scale(self.max_radius)
        self.frame_interval: float = float(np.median(np.diff(curve.time)))
        self.exposure = exposure = float(curve.exposure or 0.0)
        if exposure > self.frame_interval * (1.0 + 1e-6):
            longer = f"longer than the time between two frames ({self.frame_interval * 1e6:.4g} us)"
            raise InputError(f"an exposure of {exposure * 1e6:.4g} us is {longer}", "experiment.exposure", curve.name)
        stretch = None if isinstance(options.stretch, str) else options.stretch
        self.stretch: float | None = float(stretch) if stretch else None
        # (mean, standard deviation) of the stretch if the file or the late plateau gives it
        self.stretch_prior: tuple[float, float] | None = _known_stretch(curve, options.stretch)
        camera = self._camera()  # (middle, half-width)
        self.free: dict[str, tuple[float, float]] = {FREE[name]: camera[name] for name in options.free}
        bubble = options.bubble
        scales = {"confinement_inertia": INERTIA_SCALE, "confinement_damping": DAMPING_SCALE}
        scales["vapour_excess"] = VAPOUR_SCALE * medium.pressure
        self.walls: dict[str, float] = {name: scales[name] for name in scales if getattr(bubble, name) == "free"}
        self.bubble: dict[str, float] = fixed_bubble(bubble, self.max_radius)
        family.check_damage(bubble)
        free_logs = {
            "stretch": not self.stretch,
            "accommodation": bubble.contents == "kinetic" and bubble.accommodation == "free",
            "damage_modulus": bubble.damage != "none", "damage_radius": bubble.damage != "none",
        }  # fmt: skip
        self.log_names: tuple[str, ...] = tuple(name for name, free in free_logs.items() if free)  # of the shot; log10
        self.shot_names: tuple[str, ...] = (*self.log_names, *self.free, *self.walls)
        self.law_size: int = len(family.parameters)  # number of parameters of the law, the first in x
        self.names: tuple[str, ...] = (*family.parameters, *self.shot_names)
        ranges = [PARAMETERS[name].search_range for name in self.log_names]
        ranges += [(-1.0, 1.0)] * len(self.free) + [(0.0, MOST_ROOT)] * len(self.walls)
        self.bounds: Floats = np.concatenate([family.bounds(), np.array(ranges, dtype=float).reshape(-1, 2)])
        requested, recorded = options.window, len(curve.collapse_times())
        if requested is None and options.end is None and recorded:
            requested = min(3, recorded)
        collapses = None if requested in (None, "all") else int(requested)
        self.window: RadiusCurve = curve.window(collapses=collapses, end=options.end)
        cut = self.window
        time, wrong = cut.time[np.isfinite(cut.radius)], curve.time[curve.spikes()]
        self.end: float = float(time[-1] - curve.time_of_max)
        self.collapses: int = int(np.count_nonzero(curve.collapse_times() <= time[-1]))
        self.usable: Bools = ~np.isin(time, wrong) & ~self._drifting(time)
        frames = compared_frames(cut, self.usable)
        self.time_since_max: Floats = frames.time - curve.time_of_max
        self.measured: Floats = frames.radius / self.max_radius
        self.averaged: Floats = frames.averaged
        stated, noise = frames.radius_std / self.max_radius, curve.noise / self.max_radius
        valid = np.isfinite(stated) & (stated > 0)
        root = np.sqrt(self.averaged)
        self._radius_sigma = np.where(valid, stated, max(noise, NOISE_FLOOR) / root)
        self._measured_sigma = np.maximum(np.where(valid, stated, noise / root), SOLVER_ERROR / root)
        self.counted: Bools = frames.usable

    def _camera(self) -> dict[str, tuple[float, float]]:
        """Middle and half-width of the priors of the clock (s), the radius scale and the factor of R_max. The clock has
        all times of R_max that the frames near it allow. If no growth is recorded, R_max may be up to a frame before
        the first one, where the radius is smaller by about (frame/t_c)^2/2."""
        curve, bound, frame = self.curve, self.options.scale_bound, self.frame_interval / self.time_scale
        late, noise = float(curve.begins_late), curve.noise / self.max_radius
        factor = max(bound, min(2.25 * noise + late * (frame * frame), 0.2))
        usual = max(0.5 * (1.0 + late) * frame, MIN_CLOCK) * self.time_scale
        earliest, latest = (time - curve.time_of_max for time in curve.time_of_max_span)
        low, high = min(earliest, -usual), max(latest, usual)
        if self.options.clock_bound:
            low, high = -self.options.clock_bound, self.options.clock_bound
        return {"t0": (0.5 * (low + high), 0.5 * (high - low)), "scale": (1.0, bound), "rmax": (1.0, factor)}

    def natural(self, x: Floats) -> dict[str, Any]:
        """Natural values by name of the shot's parameters (stretch, time_origin in s, radius_scale, max_radius_factor,
        ...) from x (d,) or (d, draws)."""
        values: dict[str, Any] = {"time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}
        values |= self.bubble
        if self.stretch:
            values["stretch"] = self.stretch
        for name, value in zip(self.log_names, x[self.law_size :], strict=False):
            values[name] = 10.0**value
        camera, walls = np.split(x[self.law_size + len(self.log_names) :], [len(self.free)])
        for (name, (middle, width)), value in zip(self.free.items(), camera, strict=True):
            values[name] = value * width + middle
        bounded = np.isfinite(values.get("accommodation", 1.0))  # infinite: the field's bubble, without walls
        for (name, scale), root in zip(self.walls.items(), walls, strict=True):
            values[name] = scale * root**2 * bounded
        return values

    def bubble_with(self, natural: Mapping[str, Any]) -> Bubble:
        """The bubble with these natural values, as `simulate` takes it; with an infinite accommodation the field's."""
        if natural.get("accommodation") == np.inf:
            return FIELD
        values = {name: natural[name] for name in ("accommodation", *ZERO_BY_DEFAULT) if name in natural}
        if self.options.bubble.damage == "strain":
            values["damage"] = Damage(natural["damage_modulus"], natural["damage_radius"])
        return replace(self.options.bubble, wall_distance=None, **values)

    def from_best(self, best: Mapping[str, float]) -> Floats:
        """x (d,) from natural values by name, clipped to the ranges; parameters without a value have a default:
        0, where they may be 0."""
        x = np.zeros(len(self.names))
        for i, name in enumerate(self.names):
            low, high = self.bounds[i]
            if name in self.free:
                middle, width = self.free[name]
                x[i] = np.clip((best[name] - middle) / width if name in best else 0.0, low, high)
            elif name in self.walls:
                x[i] = np.clip(np.sqrt(best.get(name, 0.25 * self.walls[name]) / self.walls[name]), low, high)
            elif name in self.family.atoms and best.get(name, 0.0) == 0.0:
                x[i] = -np.inf
            else:
                usual = ACCOMMODATION if name == "accommodation" else 1.0
                x[i] = np.clip(np.log10(max(best.get(name, usual), 1e-300)), low, high)
        return x

    def all_values(self, x: Floats) -> dict[str, float]:
        """Every parameter by its natural name in SI, including those that were held fixed."""
        law = dict(zip(self.family.parameters, (10.0 ** x[: self.law_size]).tolist(), strict=True))
        return law | {name: float(value) for name, value in self.natural(x).items()}

    def to_theta(self, x: Floats) -> tuple[tuple[str, ...], Floats]:
        """Names and theta (draws, d) as in a Posterior from x (draws, d): log10 for the law, natural values for the
        rest. A field's bubble, as a limit of the real one, has the accommodation 1."""
        natural = self.natural(x.T)
        if "accommodation" in natural:
            natural["accommodation"] = np.where(np.isposinf(natural["accommodation"]), 1.0, natural["accommodation"])
        names = (*(LOG10 + name for name in self.family.parameters), *self.shot_names)
        return names, np.column_stack([x[:, : self.law_size], *(natural[name] for name in self.shot_names)])

    def prior(self) -> Prior:
        """The proper prior of x. log10 of the parameters of law and shot: uniform in the ranges of parameters.py, with
        the atoms of the family; the stretch is normal about USUAL_STRETCH, or
        about what the file or the plateau gives. A real bubble is the field's
        with FIELD_PROBABILITY: its accommodation is then infinite. Time origin: uniform within its bound. Radius scale
        and R_max factor: normal, with a third of their bound as standard deviation. Roots of walls and vapour above
        saturation: half-normal."""
        normal = dict.fromkeys(self.walls, (0.0, 1.0))
        normal |= dict.fromkeys(("radius_scale", "max_radius_factor"), (0.0, 1.0 / BOUND_SIGMAS))
        normal["stretch"] = (float(np.log10(USUAL_STRETCH[0])), float(np.log10(USUAL_STRETCH[1])))
        if self.stretch_prior:
            value, deviation = self.stretch_prior
            normal["stretch"] = float(np.log10(value)), deviation / (value * LN10)
        mean, std = np.transpose([normal.get(name, (0.0, np.inf)) for name in self.names])
        zero = np.array([self.family.atoms.get(name, 0.0) for name in self.names])
        real = self.options.bubble == REAL
        infinite = np.array([FIELD_PROBABILITY if real and name == "accommodation" else 0.0 for name in self.names])
        low, high = self.bounds.T
        return Prior(self.names, low, high, mean, std, zero, infinite)

    def predict(self, x: Floats, accuracy: Accuracy = DEFAULT, *, times: Floats | None = None) -> Floats | None:
        """(m,) the radius over the measured R_max that the camera would have measured at x (d,), at the times of the
        frames or at other times since R_max (m,), s; None if the simulation failed. Instants before R_max are mirrored
        (R is even to third order there)."""
        natural, (offsets, shares) = self.natural(x), exposure_nodes(self.exposure, INSTANTS)
        times = self.time_since_max if times is None else times
        instants = np.abs((times[:, None] - natural["time_origin"] + offsets).ravel())
        order = np.argsort(instants, kind="stable")
        scale = natural["radius_scale"]
        try:
            run = simulate(
                self.family.material(x[: self.law_size]),
                max_radius=self.max_radius * scale * natural["max_radius_factor"],
                stretch=natural["stretch"],
                time=instants[order],
                medium=self.medium,
                bubble=self.bubble_with(natural),
                accuracy=accuracy,
                throw=False,
            )
        except InputError:  # parameters that exclude each other count as a failed simulation
            return None
        if not (run.ok and np.all(np.isfinite(run.radius))):
            return None
        radius = np.empty(len(instants))
        radius[order] = run.radius / (scale * self.max_radius)
        return np.asarray(radius.reshape(-1, len(offsets)) @ shares)

    def bubbles(self, x: Floats) -> Bubbles:
        """The bubbles at x (k, d), as the emulator takes them."""
        natural = self.natural(x.T)

        def each(name: str, default: float = 0.0) -> Floats:
            return np.broadcast_to(natural.get(name, default), (len(x),))

        kinetic = self.options.bubble.contents == "kinetic"
        return Bubbles(
            material=self.family.material(x[:, : self.law_size]),
            medium=self.medium,
            max_radius=self.max_radius * (each("radius_scale") * each("max_radius_factor")),
            stretch=each("stretch"),
            accommodation=each("accommodation") if kinetic else np.full(len(x), np.inf),
            damping=each("confinement_damping"),
            inertia=each("confinement_inertia"),
            vapour_excess=each("vapour_excess"),
            damage_modulus=each("damage_modulus", 1.0),
            damage_radius=each("damage_radius", 1.0),
        )

    def emulated(self, x: Floats, emulator: Emulator, *, times: Floats | None = None) -> Floats:
        """(k, n) simulated R over the measured R_max, at x (k, d), by the emulator, of the frames that count or at
        other times since R_max (n,), s; NaN where `Emulator.radius` is."""
        natural = self.natural(x.T)
        origin, factor = (np.broadcast_to(natural[name], len(x)) for name in ("time_origin", "max_radius_factor"))
        nodes = exposure_nodes(self.exposure, QUICK_INSTANTS)
        times = self.time_since_max[self.counted] if times is None else times
        camera = Camera(times, *nodes, np.ascontiguousarray(origin))
        return factor[:, None] * emulator.radius(self.bubbles(x), camera)

    def difference(self, x: Floats, accuracy: Accuracy = DEFAULT) -> Floats:
        """(n,) measured minus simulated, over R_max, of the frames that count; NaN if the simulation failed."""
        radius = self.predict(x, accuracy, times=self.time_since_max[self.counted])
        measured = self.measured[self.counted]
        return np.full(len(measured), np.nan) if radius is None else measured - radius

    def misfit(self, difference: Floats) -> float:
        """RMS of the part of measured minus simulated (n,), over R_max, that exceeds the deviations of the frames:
        those that the file states, else the frame-to-frame noise."""
        excess = float(np.mean(difference**2 - self._measured_sigma[self.counted] ** 2))
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

    def checks(self, x: Floats, verdict: Verdict, messages: Sequence[Message]) -> Checks:
        """`checks_of` the simulation at x (d,)."""
        natural = self.natural(x)
        material, bubble = self.family.material(x[: self.law_size]), self.bubble_with(natural)
        return self.checks_of(material, bubble, natural, verdict, messages, CLEAN_MISFIT if self.clean else MISFIT)

    def checks_of(
        self, material: Material, bubble: Bubble, natural: Mapping[str, Any], verdict: Verdict,
        messages: Sequence[Message], limit: float = MISFIT,
    ) -> Checks:  # fmt: skip
        """The checks of an answer with this verdict, unless its simulation misses the frames that count by more than
        the limit and the frame-to-frame noise together. Frames before R_max (if a fit has moved the clock) are compared
        with the mirrored fall after it. What is drawn has the scale of the measurement. Raises SolverError."""
        cut, scale = self.window, natural["radius_scale"]
        maximum, top = cut.time_of_max + natural["time_origin"], self.max_radius * scale * natural["max_radius_factor"]
        measured = np.isfinite(cut.radius)
        since = cut.time[measured] - maximum
        times = np.union1d(np.abs(since), np.linspace(0.0, self.end - natural["time_origin"], DRAWN))
        run = simulate(
            material, max_radius=top, stretch=natural["stretch"], time=times, medium=self.medium, bubble=bubble
        )
        residual = cut.radius[measured] * scale / top - run.radius[np.searchsorted(times, np.abs(since))] / top
        residual = residual[self.usable]
        rmse = float(np.sqrt(np.mean(residual**2)))
        limit = float(np.hypot(limit, cut.noise / self.max_radius))
        if rmse > limit:
            missed = Message("misfit.rms", {"rms": rmse, "limit": limit})
            verdict, messages = "does_not_fit", [missed, *messages]
        return Checks(
            verdict,
            tuple(messages),
            rmse_over_rmax=rmse,
            collapses=self.collapses,
            t_star_end=self.end / self.time_scale,
            time_scale=self.time_scale,
            compared_time=(since + maximum)[self.usable],
            residual_over_rmax=residual,
            reconstruction_time=times + maximum,
            reconstruction_radius=run.radius / scale,
        )

    @property
    def clean(self) -> bool:
        """Whether the curve is no measurement: its stated deviation, else its noise, is smaller than a camera's."""
        stated = self.curve.radius_std[self.curve.radius_std > 0]
        deviation = float(np.median(stated)) if len(stated) else self.curve.noise
        return deviation < CLEAN_DEVIATION * self.max_radius

    @property
    def messages(self) -> list[Message]:
        """Messages on frames that do not count, and on a stretch that is given or that the recording gives."""
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


@lru_cache(maxsize=64)
def exposure_nodes(exposure: float, count: int) -> tuple[Floats, Floats]:
    """Offsets of `count` Gauss-Legendre instants in an exposure, in its unit, and their weights. An exposure of 0 has
    one instant."""
    nodes, shares = np.polynomial.legendre.leggauss(count if exposure else 1)
    return 0.5 * exposure * nodes, 0.5 * shares
