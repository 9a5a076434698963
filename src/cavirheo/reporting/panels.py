"""The content of pictures in the units of their axes: the same panels for the report, the app and `Posterior.plot`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Checks
from cavirheo.writing import digits

RMAX = "Rₘₐₓ"
MAX_DRAWN = 60  # most shots in one picture; of more every k-th is drawn
_LOG_DIGITS = ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 3.0, 5.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))
_NONE: Floats = np.empty(0)


@dataclass(frozen=True)
class Axis:
    """Name and ends of an axis, and a remark beside the name. log: places on it are log10 of the values."""

    label: str
    low: float
    high: float
    remark: str = ""
    log: bool = False

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """(place, number) of evenly spaced round numbers within the ends, about `most`; on a logarithmic axis, of a few
        digits in each decade."""
        if self.log:
            decades = 10.0 ** np.arange(np.floor(self.low), np.ceil(self.high) + 1.0)
            choices = (np.log10(np.outer(decades, numbers)).ravel() for numbers in _LOG_DIGITS)
            within = [places[(places >= self.low) & (places <= self.high)] for places in choices]
            places = next((few for few in within if len(few) <= most + 1), within[-1])
            every = -(-len(places) // (most + 1)) or 1
            return [(place, f"{10.0**place:.6g}") for place in places.tolist()[::every]]
        rough = (self.high - self.low) / most
        if not np.isfinite(rough) or rough <= 0.0:
            return []
        ten = 10.0 ** np.floor(np.log10(rough))
        step = next(factor * ten for factor in (1.0, 2.0, 5.0, 10.0) if factor * ten >= rough * (1.0 - 1e-9))
        numbers = np.arange(np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9) + 1.0)
        return [(place, f"{place:g}") for place in (step * numbers + 0.0).tolist()]


@dataclass(frozen=True, eq=False)
class Layer:
    """Points of a panel that are drawn in one style.

    Attributes:
        shape: "dots", "line", "area" (within corners) or "label" (`text` at a point).
        look: name of the style, for which SVG and matplotlib have colours and sizes: "measured", "simulated", ...
        x: (n,) places.
        y: (n,) places.
        name: text in the key of the picture; "": none.
        tone: of the colour, from 0 (dark) to 1 (light); None: the colour of the look.
        text: of a label.
    """

    shape: Literal["dots", "line", "area", "label"]
    look: str
    x: Floats
    y: Floats
    name: str = ""
    tone: float | None = None
    text: str = ""


def _band(look: str, x: Floats, ends: Floats, name: str = "", tone: float | None = None) -> Layer:
    """The area between two lines `ends` (n, 2)."""
    return Layer("area", look, np.append(x, x[::-1]), np.append(ends[:, 0], ends[::-1, 1]), name, tone)


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with layers, drawn in this order. title: what is drawn, for those who do not see it; note: text above."""

    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    title: str = ""
    note: str = ""

    @property
    def drawn(self) -> list[Layer]:
        """The layers that have points."""
        return [layer for layer in self.layers if len(layer.x)]


Points = Callable[[Floats, Floats], tuple[Floats, Floats]]


def _units_of(curve: RadiusCurve) -> tuple[str, str, Points]:
    """(names of both axes; a function of times (s) and radii (m) that gives them in the units of the axes): µs after
    R_max and µm, as far as the scales of the curve are known."""
    origin = 0.0
    time = "time of the recording (µs)"
    with suppress(InputError):  # no maximum
        origin = curve.time_of_max
        time = f"time after {RMAX} (µs)"
    per_metre = 1e6
    radius = "R (µm)"
    if curve.unscaled:
        per_metre = 1.0 / float(np.nanmax(curve.radius, initial=1e-300))
        radius = "R / largest R"
    return time, radius, lambda times, radii: ((times - origin) * 1e6, radii * per_metre)


def curve_panels(curve: RadiusCurve, checks: Checks, method: str = "", what_if: Checks | None = None) -> list[Panel]:
    """The panel of the measured and simulated radius, then that of the residual, if frames were compared.

    checks: of the answer; if it failed, only measured points are drawn. method: of the answer. what_if: a simulation of
    other values."""
    has_answer = checks.verdict != "failed"
    time_label, radius_label, points = _units_of(curve)
    time, radius = points(curve.time, curve.radius)
    simulation = f"simulation: {digits.simulation_name(method)}"
    line, residual = _simulation(points, checks, "simulated", simulation)
    low, high = _time_ends(time, residual.x)
    compared = np.full(len(time), not has_answer)
    if len(residual.x):
        slack = 1e-6 * (time[-1] - time[0])
        compared = (time >= residual.x[0] - slack) & (time <= residual.x[-1] + slack)
    measured = np.isfinite(radius) & (time >= low) & (time <= high)
    layers = list[Layer]()
    residuals = [residual]
    if (predicted := predicted_radius(checks, curve)) is not None:
        layers.append(_band("draws", *points(*predicted), "90 % of predictions"))
    for look, name, some in (("measured", "measured", compared), ("outside", "not compared", ~compared)):
        layers.append(Layer("dots", look, time[measured & some], radius[measured & some], name))
    layers.append(line)
    if what_if and what_if.reconstruction_time is not None:
        other, left = _simulation(points, what_if, "what-if", "sliders")
        layers.append(other)
        residuals.append(replace(left, shape="line", look="what-if"))
    note = "" if has_answer else "no answer: no line is drawn"
    if not measured.any():
        note = "no measured radius"
    remark = f"recorded until {time[-1]:.0f}" if len(time) and time[-1] > high else ""
    x = Axis(time_label, low, high, remark)
    y = Axis(radius_label, 0.0, 1.05 * _largest(layers, 0.0) or 1.05)
    title = f"measured radius over time, {simulation}" if len(line.x) else "measured radius over time"
    panel = Panel(x, y, tuple(layers), title, note)
    return [panel, _residual_panel(x, residuals, checks)] if len(residual.y) else [panel]


def _residual_panel(x: Axis, residuals: Sequence[Layer], checks: Checks) -> Panel:
    """The panel of the residuals, with the area that holds 90 % of the predictions."""
    rmse, ends = 100.0 * (checks.rmse_over_rmax or 0.0), np.array([x.low, x.high])
    note = f"RMSE {digits.significant(rmse, 2)} %" if rmse else ""
    band = list[Layer]()
    if checks.predicted_over_rmax is not None:
        band = [_band("draws", residuals[0].x, 100.0 * checks.predicted_over_rmax)]
    largest = 1.15 * _largest([*residuals, *band], 0.1)
    zero = Layer("line", "zero", ends, np.zeros(2))
    return Panel(x, Axis(f"residual (% {RMAX})", -largest, largest), (*band, zero, *residuals), "residual", note)


def _largest(layers: Sequence[Layer], least: float) -> float:
    """The largest absolute value along `y` in these layers, or `least` if that is larger."""
    return max([least, *(float(np.nanmax(np.abs(layer.y), initial=0.0)) for layer in layers)])


def _simulation(points: Points, checks: Checks, look: str, name: str) -> tuple[Layer, Layer]:
    """(line of a simulation, points of its residual); layers without points where `checks` has no values."""
    names = ("reconstruction_time", "reconstruction_radius", "compared_time", "residual_over_rmax")
    arrays = (getattr(checks, name) for name in names)
    time, radius, compared_time, residual = (_NONE if values is None else values for values in arrays)
    line = Layer("line", look, *points(time, radius), name)
    return line, Layer("dots", "residual", points(compared_time, _NONE)[0], 100.0 * residual)


def predicted_radius(checks: Checks, curve: RadiusCurve) -> tuple[Floats, Floats] | None:
    """(times (n,), s, and the ends (n, 2), m, between which lie 90 % of the predictions of an answer); None of one
    without draws."""
    compared, ends = checks.compared_time, checks.predicted_over_rmax
    time, radius = checks.reconstruction_time, checks.reconstruction_radius
    if compared is None or ends is None or time is None or radius is None:
        return None
    within = (time >= compared[0]) & (time <= compared[-1])
    time, radius = time[within], radius[within]
    shift = np.column_stack([np.interp(time, compared, end) for end in ends.T])
    return time, np.maximum(radius[:, None] + curve.max_radius * shift, 0.0)


def _time_ends(time: Floats, window: Floats) -> tuple[float, float]:
    """Ends of the time axis: at most one window length before the window and half of one after it, so that a long
    recording does not make the window small; all frames if there is no window."""
    if not len(time):
        return 0.0, 1.0
    first, last = float(time[0]), float(time[-1])
    if len(window):
        last = min(last, float(window[-1] + 0.5 * (window[-1] - window[0])))
        first = max(first, float(window[0] - (window[-1] - window[0])))
    margin = 0.015 * (last - first) or 1.0
    return first - margin, last + margin


def all_curves_panel(curves: Sequence[tuple[RadiusCurve, Checks]], end: float | None = None) -> Panel:
    """Measured points of all curves, R/R_max over t*, with what their answers predict, up to `end` or all of them;
    darker for smaller R_max. Only the time scale of the checks is needed. Raises InputError: a curve has no R_max."""
    every = max(-(-len(curves) // MAX_DRAWN), 1)
    curves = curves[::every]
    sizes = np.array([curve.max_radius for curve, _ in curves])
    caption = f"{RMAX} {1e6 * np.nanmin(sizes):.0f} µm"
    caption += f" (dark) to {1e6 * np.nanmax(sizes):.0f} µm (light)" if np.ptp(sizes) else ""
    caption += f", 1 of {every} shots is drawn" if every > 1 else ""
    lines, dots = list[Layer](), list[Layer]()
    for (curve, checks), tone in zip(curves, tones_of(sizes).tolist(), strict=True):
        start, unit = curve.time_of_max, checks.time_scale or np.nan
        time, radius = checks.reconstruction_time, checks.reconstruction_radius
        if (predicted := predicted_radius(checks, curve)) is not None:
            time, ends = predicted
            lines.append(_band("draws-shot", (time - start) / unit, ends / curve.max_radius, "", tone))
        elif time is not None and radius is not None:
            lines.append(Layer("line", "shot", (time - start) / unit, radius / curve.max_radius, "", tone))
        time = (curve.time - start) / unit
        some = (time >= -0.1) & (time <= (end or np.inf)) & np.isfinite(curve.radius)
        points = time[some], curve.radius[some] / curve.max_radius
        dots.append(Layer("dots", "measured-shot", *points, "" if dots else caption, tone))
    layers = (*lines, *dots)
    last = end or max([1.0, *(float(layer.x.max(initial=0.0)) for layer in layers)])
    x, y = Axis(f"t* = t √(p/ρ) / {RMAX}", -0.1, last), Axis(f"R / {RMAX}", 0.0, 1.06 * _largest(layers, 1.0))
    title = f"{y.label} over {x.label} of all shots: measured points, and the predictions of their answers"
    return Panel(x, y, layers, title)


def tones_of(sizes: Floats) -> Floats:
    """Tones from 0 (the smallest, dark) to 1 (the largest)."""
    return (sizes - sizes.min()) / (np.ptp(sizes) or 1.0)
