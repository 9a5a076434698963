"""The comparison of the simulation of an answer with the measured curve, in a window of it. Frames that stand out do
not count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import SolverError
from cavirheo.messages import Message
from cavirheo.physics.bubble import FIELD, Bubble
from cavirheo.physics.materials import Material
from cavirheo.physics.media import Medium
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Checks, Verdict

# errors with which the analysis of one curve may fail: numbers that are refused (InputError and LinAlgError are
# ValueErrors), simulations that fail, and a curve too large for the memory
ANALYSIS_ERRORS = ValueError, ArithmeticError, SolverError, MemoryError
MISFIT = 0.03  # RMSE/R_max above which the model does not fit (docs/method/verdicts.md)
_POINTS = 800  # points of a simulated curve, for drawing


@dataclass(frozen=True, eq=False)
class Window:
    """The part of a curve that is compared: from R_max to `end` s after it."""

    curve: RadiusCurve  # cut to the window, with R_max and time of R_max of the whole curve
    end: float  # s after R_max
    collapses: int

    @property
    def time_since_max(self) -> Floats:
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


def reconstruct(
    view: Window, material: Material, medium: Medium, stretch: float, bubble: Bubble = FIELD
) -> dict[str, Floats]:
    """The fields of `Checks` that the simulation of an answer gives. Frames before R_max (if a fit has moved the clock)
    are compared with the mirrored fall after it. Raises SolverError: the answer cannot be simulated."""
    curve, since = view.curve, np.abs(view.time_since_max)
    times = np.union1d(since, np.linspace(0.0, view.end, _POINTS))
    run = simulate(material, max_radius=curve.max_radius, stretch=stretch, time=times, medium=medium, bubble=bubble)
    return {
        "compared_time": view.time_since_max + curve.time_of_max,
        "residual_over_rmax": view.normalised - run.radius[np.searchsorted(times, since)] / curve.max_radius,
        "reconstruction_time": times + curve.time_of_max,
        "reconstruction_radius": run.radius,
    }


def check_simulation(
    view: Window,
    simulated: dict[str, Floats],
    time_scale: float,
    verdict: Verdict,
    messages: Sequence[Message],
    limit: float = MISFIT,
) -> Checks:
    """The checks of an answer with this reconstruction and this verdict, unless the simulation misses the measurement
    by more than the limit and the frame-to-frame noise together. time_scale is t_c in s."""
    residual = simulated["residual_over_rmax"]
    rmse, limit = float(np.sqrt(np.mean(residual**2))), float(np.hypot(limit, view.curve.noise / view.curve.max_radius))
    if rmse > limit:
        missed = Message("misfit.rms", {"rms": rmse, "limit": limit})
        verdict, messages = "does_not_fit", [missed, *messages]
    return Checks(
        verdict,
        tuple(messages),
        rmse_over_rmax=rmse,
        collapses=view.collapses,
        t_star_end=view.end / time_scale,
        time_scale=time_scale,
        **simulated,
    )
