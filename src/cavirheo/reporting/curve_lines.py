"""What the picture of one curve shows, in the units of its axes: the same lines for the report, the page for the wall,
the app and the files that are asked for."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord
from cavirheo.writing import digits

RMAX = "Rₘₐₓ"
_NONE = np.empty(0)
_STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """Name and ends of an axis."""

    label: str
    low: float
    high: float

    def ticks(self, most: int) -> list[float]:
        """At most so many round numbers within the ends, evenly spaced; the ends where no round number is known."""
        rough = (self.high - self.low) / max(most, 1)
        if not np.isfinite(rough) or rough <= 0.0:
            return []
        ten = 10.0 ** np.floor(np.log10(rough))
        step = next(one * ten for one in _STEPS if one * ten >= rough * (1.0 - 1e-9))
        first, last = np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9)
        return [float(f"{number * step:.10g}") + 0.0 for number in np.arange(first, last + 1.0)]


@dataclass(frozen=True, eq=False)
class CurveLines:
    """The points and lines of one curve, in the units of their axes.

    Attributes:
        time: (n,) of the frames that have a radius and lie within the axes.
        radius: (n,) measured.
        compared: (n,) whether a frame was compared with the simulation; all where there is no answer.
        simulated_time: (k,) of the simulation; empty where there is none.
        simulated_radius: (k,).
        residual_time: (m,) of the frames that were compared.
        residual: (m,) measured minus simulated radius, % of R_max.
        rmse: root mean square of the residual, % of R_max; 0 where there is none.
        x: time.
        y: radius.
        difference: the residual.
        recorded_until: last time of a recording that goes on beyond the axes; None where it does not.
        t_star: one unit of t*, in the unit of `x`; None without an answer.
        answered: whether there is an answer; without one the picture says so.
        simulated_as: what the line is: "simulation: best draw".
        outliers: (o, 2) time and radius of frames that stand out and are kept.
        missing: (q,) times of frames without a radius.
    """

    time: Floats
    radius: Floats
    compared: Bools
    simulated_time: Floats
    simulated_radius: Floats
    residual_time: Floats
    residual: Floats
    rmse: float
    x: Axis
    y: Axis
    difference: Axis
    recorded_until: float | None
    t_star: float | None
    answered: bool
    simulated_as: str
    outliers: Floats
    missing: Floats

    @property
    def time_axis(self) -> Axis:
        """`x`, whose name says how far the recording goes on."""
        beyond = "" if self.recorded_until is None else f", recorded until {self.recorded_until:.0f}"
        return replace(self.x, label=self.x.label + beyond)

    @property
    def band(self) -> str:
        """What the band about the residual is; nothing where there is none."""
        return f"band: ± RMSE = {digits.significant(self.rmse, 2)} %" if self.rmse else ""

    @property
    def t_star_axis(self) -> Axis | None:
        """The axis of time as t*; None without an answer."""
        return Axis("t*", self.x.low / self.t_star, self.x.high / self.t_star) if self.t_star else None


def curve_lines(curve: RadiusCurve, checks: Checks, simulated_as: str = "simulation") -> CurveLines:
    """The lines of a curve and of what was found when its answer was simulated; a failed one has its points alone.

    simulated_as: what the line is called.
    """
    answered = checks.verdict != "failed"
    origin, per_second, x_label = _clock(curve)
    per_metre, y_label = _scale(curve)
    time, radius = (curve.time - origin) * per_second, curve.radius * per_metre
    lines: dict[str, Floats] = dict.fromkeys(("simulated_time", "simulated_radius", "residual_time", "residual"), _NONE)
    if answered and checks.reconstruction_time is not None and checks.reconstruction_radius is not None:
        lines["simulated_time"] = (checks.reconstruction_time - origin) * per_second
        lines["simulated_radius"] = checks.reconstruction_radius * per_metre
    if answered and checks.compared_time is not None:
        lines["residual_time"] = (checks.compared_time - origin) * per_second
    if answered and checks.residual_over_rmax is not None:
        lines["residual"] = 100.0 * checks.residual_over_rmax
    for first, second in (("simulated_time", "simulated_radius"), ("residual_time", "residual")):
        if lines[second].size and lines[first].shape != lines[second].shape:
            raise ValueError(f"{len(lines[second])} values at {len(lines[first])} times")
    window, rmse = lines["residual_time"], 100.0 * (checks.rmse_over_rmax or 0.0) if answered else 0.0
    compared = np.full(len(time), not answered)
    if len(window):
        slack = 1e-6 * (time[-1] - time[0])
        compared = (time >= window[0] - slack) & (time <= window[-1] + slack)
    low, high = _view(time, window)
    seen = np.isfinite(radius) & (time >= low) & (time <= high)
    top = 1.05 * float(np.max([*radius[seen], *lines["simulated_radius"]], initial=0.0)) or 1.05
    reach = 1.15 * max(float(np.max(np.abs(lines["residual"]), initial=0.1)), rmse)
    return CurveLines(
        time=time[seen],
        radius=radius[seen],
        compared=compared[seen],
        rmse=rmse,
        x=Axis(x_label, low, high),
        y=Axis(y_label, 0.0, top),
        difference=Axis(f"residual (% {RMAX})", -reach, reach),
        recorded_until=float(time[-1]) if len(time) and time[-1] > high else None,
        t_star=checks.time_scale * per_second if answered and checks.time_scale else None,
        answered=answered,
        simulated_as=simulated_as,
        outliers=np.empty((0, 2)),
        missing=_NONE,
        **lines,
    )


def answer_lines(curve: RadiusCurve, checks: Checks, record: CurveRecord) -> CurveLines:
    """The lines of a curve as its row says: a row without an answer has none of the simulation."""
    named = f"simulation: {digits.simulated(record.method)}"
    return curve_lines(curve, checks if record.answered else Checks("failed"), named)


def preview_lines(curve: RadiusCurve, window: RadiusCurve) -> CurveLines:
    """The lines of a curve before it is answered: which frames are compared (those of `window`), which stand out, and
    which have no radius. Raises InputError: the curve has no R_max."""
    lines = curve_lines(curve, Checks("unverified", compared_time=window.time))
    origin, per_second, _ = _clock(curve)
    per_metre, _ = _scale(curve)
    time = (curve.time - origin) * per_second
    spikes = curve.spikes()
    outliers = np.column_stack([time[spikes], curve.radius[spikes] * per_metre])
    within = (time >= lines.x.low) & (time <= lines.x.high)
    return replace(
        lines, residual_time=_NONE, outliers=outliers[within[spikes]], missing=time[np.isnan(curve.radius) & within]
    )


def thinned(x: Floats, y: Floats, most: int) -> np.ndarray:
    """Indices of at most about so many points, equally far from each other along a line, and of its turning points, so
    that a collapse stays sharp. x and y: in units of the picture."""
    if len(x) <= most:
        return np.arange(len(x))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even = np.searchsorted(along, np.linspace(0.0, along[-1], most))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
    return np.union1d(np.minimum(even, len(x) - 1), turns[: max(most, 0)])


def _clock(curve: RadiusCurve) -> tuple[float, float, str]:
    """Origin (s), units per second, and name of the axis of time."""
    if curve.time_unscaled:
        return 0.0, 1.0, "time (no scale)"
    with suppress(InputError):  # no maximum
        return curve.time_of_max, 1e6, f"time after {RMAX} (µs)"
    return 0.0, 1e6, "time of the recording (µs)"


def _scale(curve: RadiusCurve) -> tuple[float, str]:
    """Units per metre, and name of the axis of radius."""
    if curve.unscaled:
        return 1.0 / float(np.nanmax(curve.radius, initial=1e-300)), "R / largest R"
    return 1e6, "R (µm)"


def _view(time: Floats, window: Floats) -> tuple[float, float]:
    """From the first frame to half a window beyond the window: a long quiet tail would squeeze what was compared."""
    if not len(time):
        return 0.0, 1.0
    first, last = float(time[0]), float(time[-1])
    if len(window):
        last = min(last, float(window[-1] + 0.5 * (window[-1] - window[0])))
        first = max(first, float(window[0] - (window[-1] - window[0])))
    margin = 0.015 * (last - first) or 1.0
    return first - margin, last + margin
