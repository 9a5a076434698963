"""One shot in a fit: its frames, their weights, and the simulation at exactly these frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.fit.parameters import Family, Own, Settings
from cavirheo.inference.reconstruct import Window, window
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import ROUGH, simulate

COARSE: dict[str, Any] = {"cells": 32, "rtol": 1e-3}  # for the starts: 1.5 ms
QUICK = ROUGH  # for the search: forward differences of 1e-3 are right to 1 %
FINE: dict[str, Any] = {}  # the solver's default: central differences of 3e-3 are right to 0.1 % (docs/fit.md)
FLOOR = 0.007  # of R_max: two independent circle fits of one video differ by 1.0 % rms, so each has 0.7 %
TIMING = 1.0 / np.sqrt(12.0)  # of a frame interval: standard deviation of an instant somewhere within the frame

Floats = NDArray[np.float64]


class Prediction(NamedTuple):
    """A simulation as the camera would have measured it; both (m,), over the measured R_max."""

    radius: Floats
    speed: Floats  # |dR/dt|, 1/s


class Shot:
    """One curve, cut to a window, and the parameters of its own.

    A frame counts with sigma^2 = sigma_R^2 + (U dt/sqrt(12))^2: sigma_R is the radius noise (its own where the file
    states one, else that of the curve from frame to frame, at least 0.7 % of R_max), U the wall's speed and dt the
    frame interval, within which the instant of a frame is not known (clock, exposure, and the wall's motion during
    it). So a frame beside a collapse, where one frame interval moves the wall by half of R_max, decides little.

    Raises:
        InputError: the curve has no maximum, or not the window.
    """

    def __init__(self, curve: RadiusCurve, family: Family, medium: Medium, settings: Settings) -> None:
        self.curve, self.family, self.medium, self.settings = curve, family, medium, settings
        self.max_radius = curve.max_radius
        self.time_scale = medium.time_scale(self.max_radius)
        self.frame = float(np.median(np.diff(curve.time)))
        self.shown = len(curve.collapse_times())
        prior = curve.stretch_from_tail() if settings.stretch == "plateau" else None
        self.stretch_prior = prior  # (lambda, standard deviation) or None
        t0 = settings.t0_bound or 0.5 * self.frame
        widths = tuple(t0 if name == "t0" else settings.scale_bound for name in settings.free)
        given = None if settings.stretch_free else float(settings.stretch)  # type: ignore[arg-type]
        self.own = Own(settings.free, widths, given)
        self.noise_factor = 1.0  # of sigma, found from the residuals in a joint fit
        wanted = settings.window
        if wanted is None and settings.end is None and self.shown:
            wanted = min(3, self.shown)
        self.cut = (None if wanted in (None, "all") else int(wanted), settings.end)  # the window asked for
        self.set_window(*self.cut)

    def set_window(self, collapses: int | None, end: float | None = None) -> None:
        """Cut to so many collapses (None: all) and at most `end` s, with weights from the measured motion."""
        self.view: Window = window(self.curve, collapses=collapses, end=end)
        self.since, self.measured = self.view.since_max, self.view.normalised
        cut = self.view.curve
        finite = np.isfinite(cut.radius)
        stated = cut.radius_std[finite] / self.max_radius
        self.radius_sigma = np.where(
            np.isfinite(stated) & (stated > 0), stated, max(self.curve.noise / self.max_radius, FLOOR)
        )
        wrong = set(self.curve.time[self.curve.spikes()].tolist())
        self.spikes = np.array([t in wrong for t in cut.time[finite].tolist()], dtype=bool)
        self.weigh(np.abs(np.gradient(self.measured, self.since)) if len(self.since) > 2 else 0.0)

    def weigh(self, speed: Floats | float) -> None:
        """Set sigma (m,) of the frames, over R_max, from the wall's speed over R_max, 1/s; spikes do not count."""
        motion = speed * self.frame * TIMING if self.settings.weights == "motion" else 0.0
        self.sigma = np.where(self.spikes, np.inf, np.hypot(self.radius_sigma, motion))

    def candidates(self, collapses: Iterable[int | None]) -> list[int | None]:
        """Of these windows those that the curve shows, and none twice."""
        return [n for n in dict.fromkeys(collapses) if n is None or n <= self.shown]

    def predict(self, x: Floats, accuracy: dict[str, Any]) -> Prediction | None:
        """The frames for (parameters,) of the law and the shot's own; None if the simulation failed.

        The bubble starts from rest at R_max times radius scale and factor, at t_max + t_0; frames before that are
        mirrored (R is even in time to third order at its maximum).
        """
        law = len(self.family.parameters)
        natural = self.own.natural(x[law:])
        times = np.abs(self.since - natural["time_origin"])
        order = np.argsort(times, kind="stable")
        scale = natural["radius_scale"]
        start = self.max_radius * scale * natural["max_radius_factor"]
        try:
            run = simulate(
                self.family.material(x[:law]), max_radius=start, stretch=natural["stretch"], time=times[order],
                medium=self.medium, throw=False, **accuracy,
            )  # fmt: skip
        except InputError:  # parameters that exclude each other: as a failed simulation
            return None
        if not run.ok or not np.all(np.isfinite(run.radius)):
            return None
        radius, speed = np.empty_like(times), np.empty_like(times)
        radius[order] = run.radius / (scale * self.max_radius)
        speed[order] = np.abs(run.velocity) / (scale * self.max_radius)
        return Prediction(radius, speed)

    def residual(self, prediction: Prediction | None) -> Floats:
        """(m,) (measured - simulated)/sigma; a failed simulation misses by R_max everywhere: large, but finite."""
        difference = self.measured - prediction.radius if prediction is not None else np.ones(len(self.measured))
        return np.asarray(difference / (self.sigma * self.noise_factor))


Run = Callable[[list[tuple[Shot, Floats]]], list[Prediction | None]]
