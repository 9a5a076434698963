"""Experiment: one curve, and everything that is assumed of it. Fit, posterior and evidence speak to this object.

A measured frame at t_i shows the mean of R over its exposure; the clock is off by t_0, the radii by a scale, and R_max
of the motion is a factor off that read from the curve:

    y_i = <R(t_i - t_0)>/(scale R_max) + e_i,    R(0) = scale x factor x R_max,    R_max that of the curve.

The parameters x are the law's in log10, log10 of the stretch (if it is not given), and what is free of t_0, scale and
factor as fractions of their half-widths, from -1 to 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.law import Family
from cavirheo.inference.noise import Noise
from cavirheo.inference.reconstruct import MISFIT, Reconstruction, Window, check_stretch, reconstruct, window
from cavirheo.parameters import LOG10, PARAMETERS
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import ROUGH, simulate
from cavirheo.posterior import weighted_quantile
from cavirheo.prior import Prior

Accuracy = Mapping[str, Any]  # options of `simulate`

COARSE: Accuracy = {"cells": 32, "rtol": 1e-3}  # for the starts: 1.5 ms
QUICK: Accuracy = ROUGH  # for the search: forward differences of 1e-3 are right to 1 %
FINE: Accuracy = {}  # the solver's default: central differences of 3e-3 are right to 0.1 % (docs/method/fit.md)
FLOOR = 0.007  # of R_max: two independent circle fits of one video differ by 1.0 % rms, so each has 0.7 %
TIMING = 1.0 / np.sqrt(12.0)  # of a frame interval: standard deviation of an instant somewhere within the frame
SHARPEST = 1e-3  # of R_max: less noise than this is not believed, for the solver's own error is up to that
FREE = {"t0": "time_origin", "scale": "radius_scale", "rmax": "max_radius_factor"}  # option: name in the answer
SCALE_BOUND = 0.015  # radius calibration and R_max are known to 1-1.5 % (two circle fits of one video differ by 1 %)
SIGMAS = 3.0  # standard deviations of the radius scale and of R_max within their bounds
NARROWEST = 0.02  # t_c: half-width of a posterior's clock where half a frame is less; R_max is hardly seen sooner
AT_END = 0.25  # of an interval's width: an end nearer to that of the range is the range's, not the curve's
_LN10 = float(np.log(10.0))
_NODES, _SHARES = (part / 2.0 for part in np.polynomial.legendre.leggauss(9))  # of an exposure, over its length


@dataclass(frozen=True)
class Options:
    """What is chosen for an experiment; the arguments of `fit_many` (inference/fit).

    Raises:
        InputError: an option out of its domain.
    """

    window: int | str | None = None
    end: float | None = None
    stretch: float | str | None = None
    free: tuple[str, ...] = ()
    t0_bound: float | None = None
    scale_bound: float = SCALE_BOUND
    weights: str = "motion"
    windows: bool = True

    def __post_init__(self) -> None:
        window, stretch, clock = self.window, self.stretch, self.t0_bound
        wanted = {
            "window": (window in (None, "all") or (isinstance(window, int) and window >= 1),
                       "a number of collapses from 1 up, or 'all'"),
            "end": (self.end is None or 0 < self.end < np.inf, "a positive time in s"),
            "stretch": (not isinstance(stretch, str) or stretch == "plateau", "R_max/R_0, 'plateau' or left out"),
            "free": (set(self.free) <= set(FREE) and len(set(self.free)) == len(self.free),
                     f"some of {', '.join(FREE)}, each once"),
            "t0_bound": (clock is None or 0 < clock < np.inf, "a positive time in s"),
            "scale_bound": (0 < self.scale_bound < 0.2, "between 0 and 0.2"),
            "weights": (self.weights in ("motion", "equal"), "'motion' or 'equal'"),
        }  # fmt: skip
        for name, (fine, what) in wanted.items():
            if not fine:
                raise InputError(f"{name} must be {what}; got {getattr(self, name)!r}", f"option.{name}")
        if not isinstance(stretch, str):
            check_stretch(stretch)

    @property
    def given_stretch(self) -> float | None:
        """R_max/R_0 where it is known, None where it is free."""
        return None if self.stretch is None or isinstance(self.stretch, str) else float(self.stretch)


class Prediction(NamedTuple):
    """A simulation as the camera would have measured it; both (m,), over the measured R_max."""

    radius: Floats
    speed: Floats  # |dR/dt|, 1/s


class Experiment:
    """One curve cut to a window, a law, a medium, the camera, and the prior of the parameters x.

    A frame counts with sigma^2 = sigma_R^2 + (U dt/sqrt(12))^2: sigma_R is the radius noise (its own where the file
    states one, else that of the curve from frame to frame, at least 0.7 % of R_max), U the wall's speed and dt the
    frame interval, within which the instant of a frame is not known (clock, exposure, and the wall's motion during
    it). So a frame beside a collapse, where one frame interval moves the wall by half of R_max, decides little.
    Frames that stand out as spikes do not count.

    names: (d,) of x. bounds: (d, 2). since, measured, sigma: (m,) of the measured frames in the window: s after R_max,
    R/R_max, assumed deviation over R_max. counted: (m,) frames that are no spikes.

    Raises:
        InputError: the curve has no maximum, or not the window; an exposure longer than the frame interval.
    """

    def __init__(
        self, curve: RadiusCurve, family: Family, medium: Medium = WATER, options: Options = Options(), *,
        exposure: float = 0.0,
    ) -> None:  # fmt: skip
        self.curve, self.family, self.medium, self.options = curve, family, medium, options
        self.max_radius = curve.max_radius
        self.time_scale = medium.time_scale(self.max_radius)
        self.frame = float(np.median(np.diff(curve.time)))
        self.exposure = _checked(exposure, self.frame, curve.name)
        self.shown = len(curve.collapse_times())
        # (lambda, standard deviation) from the late plateau, or None
        self.stretch_prior = curve.stretch_from_tail() if options.stretch == "plateau" else None
        self.stretch = options.given_stretch
        clock = options.t0_bound or 0.5 * self.frame
        self.half_widths = tuple(clock if name == "t0" else options.scale_bound for name in options.free)
        self.own = (() if self.stretch else ("stretch",)) + tuple(FREE[name] for name in options.free)
        self.law = len(family.parameters)  # how many of x are the law's
        self.names = (*family.parameters, *self.own)
        stretch = [] if self.stretch else [PARAMETERS["stretch"].searched]
        bounds = np.array([*stretch, *[(-1.0, 1.0)] * len(options.free)], dtype=float).reshape(-1, 2)
        self.bounds = np.concatenate([family.bounds(), bounds])
        self.noise_factor = 1.0  # of sigma, found from the residuals in a joint fit
        wanted = options.window
        if wanted is None and options.end is None and self.shown:
            wanted = min(3, self.shown)
        self.cut = (None if wanted in (None, "all") else int(wanted), options.end)  # the window asked for
        self.set_window(*self.cut)

    # what was measured

    def set_window(self, collapses: int | None, end: float | None = None) -> None:
        """Cut to so many collapses (None: all) and at most `end` s, with weights from the measured motion."""
        self.view: Window = window(self.curve, collapses=collapses, end=end)
        self.since, self.measured = self.view.since_max, self.view.normalised
        cut = self.view.curve
        finite = np.isfinite(cut.radius)
        stated, noise = cut.radius_std[finite] / self.max_radius, self.curve.noise / self.max_radius
        known = np.isfinite(stated) & (stated > 0)
        self._radius_sigma = np.where(known, stated, max(noise, FLOOR))
        self._sharpest = np.maximum(np.where(known, stated, noise), SHARPEST)
        wrong = set(self.curve.time[self.curve.spikes()].tolist())
        self.counted = np.array([t not in wrong for t in cut.time[finite].tolist()], dtype=bool)
        self.weigh(np.abs(np.gradient(self.measured, self.since)) if len(self.since) > 2 else 0.0)

    def weigh(self, speed: Floats | float) -> None:
        """Set sigma of the frames from the wall's speed over R_max, 1/s."""
        motion = speed * self.frame * TIMING if self.options.weights == "motion" else 0.0
        self.sigma = np.where(self.counted, np.hypot(self._radius_sigma, motion), np.inf)

    def candidates(self, collapses: Iterable[int | None]) -> list[int | None]:
        """Of these windows those that the curve shows, and none twice."""
        return [n for n in dict.fromkeys(collapses) if n is None or n <= self.shown]

    # what is varied

    @property
    def plateau(self) -> tuple[float, float] | None:
        """(mean, standard deviation) of log10 stretch where the late plateau is to tell it."""
        if not self.stretch_prior:
            return None
        value, deviation = self.stretch_prior
        return float(np.log10(value)), deviation / (value * _LN10)

    def natural(self, x: Floats) -> dict[str, Any]:
        """stretch, time_origin (s), radius_scale and max_radius_factor from x (d,), or from (d, draws)."""
        values: dict[str, Any] = {"time_origin": 0.0, "radius_scale": 1.0, "max_radius_factor": 1.0}
        values["stretch"] = self.stretch if self.stretch else 10.0 ** x[self.law]
        free = self.options.free
        for name, width, value in zip(free, self.half_widths, x[len(x) - len(free) :], strict=True):
            values[FREE[name]] = value * width + (0.0 if name == "t0" else 1.0)
        return values

    def best(self, x: Floats) -> dict[str, float]:
        """Every parameter by its natural name in SI, what was held fixed included."""
        law = dict(zip(self.family.parameters, (10.0 ** x[: self.law]).tolist(), strict=True))
        return law | {name: float(value) for name, value in self.natural(x).items()}

    def answer(self, x: Floats) -> tuple[tuple[str, ...], Floats]:
        """Names and theta (draws, d) as in a Posterior from x (draws, d): log10 of the law's, the others natural."""
        own = self.natural(x.T)
        names = (*(LOG10 + name for name in self.family.parameters), *self.own)
        return names, np.column_stack([x[:, : self.law], *(own[name] for name in self.own)])

    @property
    def steps(self) -> Floats:
        """(d,) by which finite differences move x, in units of the general step: a clock by t_c, a scale by 1."""
        units = [self.time_scale if name == "t0" else 1.0 for name in self.options.free]
        own = [unit / width for unit, width in zip(units, self.half_widths, strict=True)]
        return np.array([1.0] * (self.law + (self.stretch is None)) + own)

    def prior(self, ranges: Mapping[str, Sequence[float]] | None = None) -> Prior:
        """The proper prior of x.

        log10 of the law's parameters and of the stretch: uniform in the ranges that a fit searches, or in `ranges`
        ({"shear_modulus": [low, high] in SI}); the stretch normal where the plateau gives it. Time origin: uniform
        within its bound. Radius scale and R_max: normal, with a third of their bound as standard deviation.

        Raises:
            InputError: a range for an unknown parameter, or one that is not positive and rising.
        """
        given, bounds = dict(ranges or {}), self.bounds.copy()
        mean, std = np.zeros(len(self.names)), np.full(len(self.names), np.inf)
        for i, name in enumerate(self.names):
            if name in given and name not in FREE.values():
                pair = given.pop(name)
                if len(pair) != 2 or not 0 < pair[0] < pair[1] < np.inf:
                    wanted = f"the prior range of {name} must be [low, high] with 0 < low < high"
                    raise InputError(f"{wanted}, got {list(pair)}", "prior.range")
                bounds[i] = np.log10(pair)
            if name == "stretch" and self.plateau:
                mean[i], std[i] = self.plateau
            if name in ("radius_scale", "max_radius_factor"):
                std[i] = 1.0 / SIGMAS
        if given:
            known = f"known: {', '.join(self.names)}"
            raise InputError(f"no prior range can be set for {', '.join(given)}; {known}", "prior.name")
        return Prior(self.names, bounds[:, 0], bounds[:, 1], mean, std)

    # what is expected

    def predict(self, x: Floats, accuracy: Accuracy = FINE, *, counted: bool = False) -> Prediction | None:
        """What the camera would have measured at x (d,), in the frames that count or in all; None if the simulation
        failed.

        The bubble starts from rest at R_max times radius scale and factor, at t_max + t_0; instants before that are
        mirrored (R is even in time to third order at its maximum).
        """
        natural = self.natural(x)
        nodes, shares = (_NODES, _SHARES) if self.exposure else (np.zeros(1), np.ones(1))
        since = self.since[self.counted] if counted else self.since
        instants = np.abs(since[:, None] - natural["time_origin"] + self.exposure * nodes).ravel()
        order = np.argsort(instants, kind="stable")
        scale = natural["radius_scale"]
        try:
            run = simulate(
                self.family.material(x[: self.law]),
                max_radius=self.max_radius * scale * natural["max_radius_factor"],
                stretch=natural["stretch"], time=instants[order], medium=self.medium, throw=False, **accuracy,
            )  # fmt: skip
        except InputError:  # parameters that exclude each other: as a failed simulation
            return None
        if not run.ok or not np.all(np.isfinite(run.radius)):
            return None
        radius, speed = np.empty_like(instants), np.empty_like(instants)
        radius[order] = run.radius / (scale * self.max_radius)
        speed[order] = np.abs(run.velocity) / (scale * self.max_radius)
        seen = (np.asarray(values.reshape(-1, len(nodes)) @ shares) for values in (radius, speed))
        return Prediction(*seen)

    def residual(self, prediction: Prediction | None) -> Floats:
        """(m,) (measured - simulated)/sigma; a failed simulation misses by R_max everywhere: large, but finite."""
        difference = self.measured - prediction.radius if prediction is not None else np.ones(len(self.measured))
        return np.asarray(difference / (self.sigma * self.noise_factor))

    def difference(self, x: Floats, accuracy: Accuracy = FINE) -> Floats:
        """(n,) measured minus simulated, over R_max, of the frames that count; NaN where the simulation failed."""
        seen = self.predict(x, accuracy, counted=True)
        measured = self.measured[self.counted]
        return np.full(len(measured), np.nan) if seen is None else measured - seen.radius

    def log_likelihood(self, x: Floats, accuracy: Accuracy = FINE, *, discrepancy: bool = True) -> float:
        """log p(frames | x), the size of the noise and the discrepancy integrated out; -inf for a failed simulation."""
        return float(self.noise(discrepancy).log_density(self.difference(x, accuracy)[None])[0])

    def noise(self, discrepancy: bool) -> Noise:
        """The distribution of the frames that count about the simulation (noise.py).

        With `discrepancy` the assumed deviations are the fit's (at least 0.7 % of R_max, more where the measured wall
        moves fast); without it they are those of the file or of the frame-to-frame noise. Raises InputError: fewer
        than three frames count.
        """
        if np.count_nonzero(self.counted) < 3:
            frames = f"{np.count_nonzero(self.counted)} frames are too few for a posterior"
            raise InputError(f"{self.curve.name}: {frames}", "experiment.too_few_frames")
        deviation = (self.sigma if discrepancy else self._sharpest)[self.counted]
        return Noise(deviation, self.since[self.counted], self.time_scale, discrepancy)

    def overlaid(self, x: Floats) -> Reconstruction:
        """`reconstruct` at x on the clock and scale of x; what is drawn is put back on those of the measurement."""
        natural = self.natural(x)
        scale, origin = natural["radius_scale"], natural["time_origin"]
        cut = self.view.curve
        start = self.max_radius * scale * natural["max_radius_factor"]
        maximum = (cut.time_of_max + origin, start)
        moved = replace(cut, radius=cut.radius * scale, radius_std=cut.radius_std * scale, maximum=maximum)
        view = Window(moved, self.view.end - origin, self.view.collapses)
        found = reconstruct(view, self.family.material(x[: self.law]), self.medium, natural["stretch"])
        return replace(found, drawn_radius=found.drawn_radius / scale)

    def open_ends(self, x: Floats, low: Floats, high: Floats, log_weight: Floats | None = None) -> dict[str, str]:
        """Parameters of the law and the stretch whose central 90 % of the draws x (draws, d) end at an end of the
        range low (d,) to high (d,): there the range decides, not the curve."""
        found: dict[str, str] = {}
        for name, values, a, b in zip(self.names, x.T, low, high, strict=True):
            if name in FREE.values() or len(x) < 2:
                continue
            bottom, top = weighted_quantile(values, np.array([0.05, 0.95]), log_weight)
            sides = (("below", bottom - a), ("above", b - top))
            if open_sides := [side for side, room in sides if room < AT_END * (top - bottom)]:
                found[name] = ", ".join(f"{name} from {side}" for side in open_sides)
        return found

    @property
    def spikes(self) -> int:
        """How many frames of the window do not count."""
        return int(np.count_nonzero(~self.counted))


def _checked(exposure: float, frame: float, name: str) -> float:
    if not 0.0 <= exposure < np.inf:
        raise InputError(f"{name}: exposure_s must be a time in s, got {exposure!r}", "experiment.exposure")
    if exposure > frame * (1.0 + 1e-6):
        raise InputError(
            f"{name}: an exposure of {exposure * 1e6:.4g} us is longer than the time between two frames "
            f"({frame * 1e6:.4g} us)", "experiment.exposure",
        )  # fmt: skip
    return exposure


def misfit_of(seen: Reconstruction) -> list[str]:
    """The message of a simulation that misses the measurement by more than the limit; else none."""
    if seen.rmse <= MISFIT:
        return []
    return [f"the simulation misses the measurement by {seen.rmse:.1%} of R_max RMS (limit {MISFIT:.0%})"]
