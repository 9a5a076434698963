"""Answer -> simulated curve over the measured one: the comparison that an answer passes or fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import SolverError, require
from cavirheo.messages import Message
from cavirheo.parameters import STRETCH_RANGE
from cavirheo.physics.accuracy import Accuracy
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.materials import Material
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import simulate, simulate_many
from cavirheo.posterior import Checks, Verdict

MISFIT = 0.03  # RMSE/R_max above which the model is said not to fit (docs/method/verdicts.md)
_COMPARED = Accuracy(48, 1e-3)  # of simulations that are only compared with each other
_POINTS = 800  # points of the drawn reconstruction


@dataclass(frozen=True, eq=False)
class Window:
    """The part of a curve that is compared: from R_max to `end` s after it, and what it holds."""

    curve: RadiusCurve  # cut to the window; its R_max and time of R_max are those of the whole
    end: float  # s after R_max
    collapses: int

    @property
    def since_max(self) -> Floats:
        """(m,) s after R_max of the measured frames."""
        measured = np.isfinite(self.curve.radius)
        return self.curve.time[measured] - self.curve.time_of_max

    @property
    def normalised(self) -> Floats:
        """(m,) R/R_max of the measured frames."""
        return self.curve.radius[np.isfinite(self.curve.radius)] / self.curve.max_radius


def window(curve: RadiusCurve, *, collapses: int | None = None, end: float | None = None) -> Window:
    """The window of `collapses` collapses and at most `end` s, cut at the last measured frame. Raises InputError."""
    cut = curve.window(collapses=collapses, end=end)
    last = cut.time[np.isfinite(cut.radius)][-1]
    return Window(cut, float(last - curve.time_of_max), int(np.count_nonzero(curve.collapse_times() <= last)))


def fit_stretch(view: Window, material: Material, medium: Medium) -> float:
    """The stretch R_max/R_0 with the smallest RMSE, the material being given. Raises SolverError: none succeeded.

    The error has several minima (a rebound may slip by a period), so the whole range is looked over first.
    """
    top, measured = view.curve.max_radius, view.normalised
    shot: Any = {"max_radius": top, "time": view.since_max, "medium": medium}

    def misfit(stretches: Floats) -> Floats:
        """(k,) RMSE/R_max of quick simulations, only compared with each other; infinite where a solve failed."""
        runs = simulate_many([material] * len(stretches), **shot, stretch=stretches, workers=1, accuracy=_COMPARED)
        return np.array([np.sqrt(np.mean((run.radius / top - measured) ** 2)) if run.ok else np.inf for run in runs])

    grid = np.geomspace(*STRETCH_RANGE, 18)
    errors = misfit(grid)
    best = int(np.argmin(errors))
    if not np.isfinite(errors[best]):
        raise SolverError(f"no simulation with {material} succeeded at any stretch in {STRETCH_RANGE}")
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    from scipy.optimize import minimize_scalar  # a tenth of a second to import

    def cost(stretch: float) -> float:
        return float(misfit(np.array([stretch]))[0])

    return float(minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 0.01}).x)


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A measurement and the simulation of its answer."""

    residual: Floats  # (m,) measured minus simulated, over R_max
    time: Floats  # (m,) s, clock of the measurement
    drawn_time: Floats  # (k,) s, clock of the measurement
    drawn_radius: Floats  # (k,) m

    @property
    def rmse(self) -> float:
        return float(np.sqrt(np.mean(self.residual**2)))

    def of(self, counted: Bools) -> Reconstruction:
        """The same, compared in some of the frames (m,) only."""
        return replace(self, residual=self.residual[counted], time=self.time[counted])

    def checks(
        self, view: Window, time_scale: float, verdict: Verdict, messages: Sequence[Message], limit: float = MISFIT
    ) -> Checks:
        """The Checks of an answer: this verdict, unless the simulation misses the measurement by more than the limit
        and the noise from frame to frame. time_scale is t_c in s."""
        limit = float(np.hypot(limit, view.curve.noise / view.curve.max_radius))
        if self.rmse > limit:
            missed = Message("misfit.rms", {"rms": self.rmse, "limit": limit})
            verdict, messages = "model_does_not_fit", [missed, *messages]
        return Checks(
            verdict,
            tuple(messages),
            rmse_over_rmax=self.rmse,
            mae_over_rmax=float(np.mean(np.abs(self.residual))),
            max_difference_over_rmax=float(np.max(np.abs(self.residual))),
            collapses=view.collapses,
            t_star_end=view.end / time_scale,
            compared_time=self.time,
            residual_over_rmax=self.residual,
            reconstruction_time=self.drawn_time,
            reconstruction_radius=self.drawn_radius,
            time_scale=time_scale,
        )


def reconstruct(
    view: Window, material: Material, medium: Medium, stretch: float, bubble: Bubble = FIELD
) -> Reconstruction:
    """Simulate the answer and lay it over the window. Raises SolverError if it cannot be simulated.

    Frames before R_max (where a fit has moved the clock) are compared with the mirrored fall after it.
    """
    curve, since = view.curve, np.abs(view.since_max)
    times = np.union1d(since, np.linspace(0.0, view.end, _POINTS))
    run = simulate(material, max_radius=curve.max_radius, stretch=stretch, time=times, medium=medium, bubble=bubble)
    residual = view.normalised - run.radius[np.searchsorted(times, since)] / curve.max_radius
    return Reconstruction(residual, view.since_max + curve.time_of_max, times + curve.time_of_max, run.radius)


def check_stretch(stretch: float | str | None) -> None:
    """Raises InputError for a stretch that no bubble at its largest radius has."""
    message = f"stretch = R_max/R_0 must lie between 1 and 100, got {stretch!r}"
    fine = stretch is None or (isinstance(stretch, Real) and 1 < stretch < 100)
    require(fine, message, "option.stretch")
