"""Answer -> simulated curve over the measured one: the check that signs or refuses an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.physics.materials import Material
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import simulate, simulate_many
from cavirheo.posterior import Checks, Verdict

STRETCH_RANGE = (1.2, 16.0)  # in which R_max/R_0 is looked for
MISFIT = 0.06  # RMSE/R_max above which the model is said not to fit (docs/method/verdicts.md)
_DRAWN = 800  # points of the drawn reconstruction

Floats = NDArray[np.float64]


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
    seen = curve.collapse_times()
    return Window(cut, float(last - curve.time_of_max), int(np.count_nonzero(seen <= last)))


def misfit(view: Window, material: Material, medium: Medium, stretches: Floats) -> Floats:
    """(k,) RMSE/R_max of quick simulations at each stretch; infinite where a solve failed."""
    runs = simulate_many(
        [material] * len(stretches), max_radius=view.curve.max_radius, stretch=stretches,
        time=view.since_max, medium=medium, workers=1, cells=48, rtol=1e-3,  # only compared with each other
    )  # fmt: skip
    measured = view.normalised
    errors = [np.sqrt(np.mean((r.radius / view.curve.max_radius - measured) ** 2)) if r.ok else np.inf for r in runs]
    return np.array(errors)


def fit_stretch(view: Window, material: Material, medium: Medium) -> float:
    """The stretch R_max/R_0 with the smallest RMSE, the material being given.

    The error has several minima (a rebound may slip by a period), so the whole range is looked over first.

    Raises:
        SolverError: no simulation succeeded at any stretch.
    """
    grid = np.geomspace(*STRETCH_RANGE, 18)
    errors = misfit(view, material, medium, grid)
    best = int(np.argmin(errors))
    if not np.isfinite(errors[best]):
        raise SolverError(f"no simulation with {material} succeeded at any stretch in {STRETCH_RANGE}")
    found = minimize_scalar(
        lambda s: float(misfit(view, material, medium, np.array([s]))[0]),
        bounds=(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]), method="bounded", options={"xatol": 0.01},
    )  # fmt: skip
    return float(found.x)


def refine_stretch(view: Window, material: Material, medium: Medium, start: float) -> float:
    """One parabola step in log stretch from a stretch that is nearly right; for use inside an iteration."""
    step = 0.03
    logs = np.log(np.clip(start, STRETCH_RANGE[0] * 1.04, STRETCH_RANGE[1] / 1.04)) + np.array([-step, 0.0, step])
    low, middle, high = misfit(view, material, medium, np.exp(logs)) ** 2
    curvature = low - 2 * middle + high
    if not np.isfinite(curvature):
        return start
    if curvature <= 0:
        move = -2 * step * np.sign(high - low)
    else:
        move = np.clip(step * (low - high) / (2 * curvature), -2 * step, 2 * step)
    return float(np.clip(np.exp(logs[1] + move), *STRETCH_RANGE))


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A measurement and the simulation of its answer. Differences are measured minus simulated, over R_max."""

    rmse: float
    mae: float
    largest: float
    time: Floats  # (m,) s, clock of the measurement
    residual: Floats  # (m,)
    drawn_time: Floats  # (k,) s, clock of the measurement
    drawn_radius: Floats  # (k,) m

    def checks(self, view: Window, time_scale: float, verdict: Verdict, messages: Sequence[str]) -> Checks:
        """The Checks of an answer with this verdict, compared over this window; time_scale is t_c in s."""
        return Checks(
            verdict=verdict,
            message="; ".join(messages),
            rmse_over_rmax=self.rmse,
            mae_over_rmax=self.mae,
            max_difference_over_rmax=self.largest,
            collapses=view.collapses,
            t_star_end=view.end / time_scale,
            compared_time=self.time,
            residual_over_rmax=self.residual,
            reconstruction_time=self.drawn_time,
            reconstruction_radius=self.drawn_radius,
        )


def reconstruct(view: Window, material: Material, medium: Medium, stretch: float) -> Reconstruction:
    """Simulate the answer and lay it over the window. Raises SolverError if it cannot be simulated.

    Frames before R_max (where a fit has moved the clock) are compared with the mirrored fall after it.
    """
    curve, since = view.curve, np.abs(view.since_max)
    times = np.union1d(since, np.linspace(0.0, view.end, _DRAWN))
    run = simulate(material, max_radius=curve.max_radius, stretch=stretch, time=times, medium=medium)
    at_frames = run.radius[np.searchsorted(times, since)]
    residual = view.normalised - at_frames / curve.max_radius
    return Reconstruction(
        rmse=float(np.sqrt(np.mean(residual**2))),
        mae=float(np.mean(np.abs(residual))),
        largest=float(np.max(np.abs(residual))),
        time=view.since_max + curve.time_of_max,
        residual=residual,
        drawn_time=times + curve.time_of_max,
        drawn_radius=run.radius,
    )


def check_stretch(stretch: float | None) -> None:
    """Raises InputError for a stretch that no bubble at its largest radius has."""
    if stretch is not None and not 1 < stretch < 100:
        raise InputError(f"stretch = R_max/R_0 must lie between 1 and 100, got {stretch!r}", "option.stretch")
