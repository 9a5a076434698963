"""The content of pictures in the units of their axes: the same panels for the report, the app and `Posterior.plot`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Checks
from cavirheo.writing import digits

RMAX = "Rₘₐₓ"
MAX_DRAWN = 60  # most shots in one picture; of more every k-th is drawn
_POINTS = 320  # most points of a line, and of the dots of a picture
_GROUP_POINTS = 1600  # most dots of all shots in one picture; their lines have as many
_LOG_DIGITS = ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 3.0, 5.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))


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
            return self._log_ticks(most)
        rough = (self.high - self.low) / most
        if not np.isfinite(rough) or rough <= 0.0:
            return []
        ten = 10.0 ** np.floor(np.log10(rough))
        step = next(factor * ten for factor in (1.0, 2.0, 5.0, 10.0) if factor * ten >= rough * (1.0 - 1e-9))
        first, last = np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9)
        places = [float(f"{number * step:.10g}") + 0.0 for number in np.arange(first, last + 1.0)]
        return [(place, f"{place:g}") for place in places]

    def _log_ticks(self, most: int) -> list[tuple[float, str]]:
        decades = 10.0 ** np.arange(np.floor(self.low), np.ceil(self.high) + 1.0)
        for numbers in _LOG_DIGITS:
            values = [float(decade * number) for decade in decades for number in numbers]
            ticks = [(float(np.log10(value)), f"{value:.6g}") for value in values]
            ticks = [tick for tick in ticks if self.low <= tick[0] <= self.high]
            if len(ticks) <= most + 1:
                break
        return ticks[:: -(-len(ticks) // (most + 1)) or 1]


@dataclass(frozen=True, eq=False)
class Layer:
    """Points of a panel that are drawn in one style.

    Attributes:
        shape: "dots", "line", "area" (between two lines), "ticks" (on the lower end of `y`), "region" (within corners),
            "arrows" (from the first to the second place) or "labels" (`texts` at points).
        look: name of the style, for which SVG and matplotlib have colours and sizes: "measured", "simulated", ...
        x: (n,); of arrows (n, 2).
        y: as `x`; of an area (n, 2); of ticks zeros.
        name: text in the key of the picture; "": none.
        tone: of the colour, from 0 (dark) to 1 (light); None: the colour of the look.
        most: most points that are drawn.
        texts: of labels.
    """

    shape: Literal["dots", "line", "area", "ticks", "region", "arrows", "labels"]
    look: str
    x: Floats
    y: Floats
    name: str = ""
    tone: float | None = None
    most: int = _POINTS
    texts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with layers, drawn in this order. note: text beside the key."""

    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    note: str = ""

    def layer(self, look: str) -> Layer:
        """The first layer of this look, or an empty one."""
        nothing = Layer("dots", look, np.empty(0), np.empty(0))
        return next((layer for layer in self.layers if layer.look == look), nothing)


class _Units(NamedTuple):
    """Units of the axes of a curve: names of both axes, time origin (s), units per second and per metre."""

    time: str
    radius: str
    origin: float
    per_second: float
    per_metre: float

    def points(self, time: Floats, radius: Floats) -> tuple[Floats, Floats]:
        """Times (s) and radii (m) in the units of the axes."""
        return (time - self.origin) * self.per_second, radius * self.per_metre


def _units_of(curve: RadiusCurve) -> _Units:
    """µs after R_max and µm, as far as the scales of the curve are known."""
    radius, per_metre = "R (µm)", 1e6
    if curve.unscaled:
        radius, per_metre = "R / largest R", 1.0 / float(np.nanmax(curve.radius, initial=1e-300))
    if curve.time_unscaled:
        return _Units("time (no scale)", radius, 0.0, 1.0, per_metre)
    with suppress(InputError):  # no maximum
        return _Units(f"time after {RMAX} (µs)", radius, curve.time_of_max, 1e6, per_metre)
    return _Units("time of the recording (µs)", radius, 0.0, 1e6, per_metre)


def curve_panels(curve: RadiusCurve, checks: Checks, method: str = "", what_if: Checks | None = None) -> list[Panel]:
    """The panel of the measured and simulated radius, then that of the residual, if frames were compared.

    checks: of the answer; if it failed, only measured points are drawn. method: of the answer. what_if: a simulation of
    other values. Raises ValueError: a line has not as many times as values."""
    has_answer = checks.verdict != "failed"
    checks = checks if has_answer else Checks("failed")
    units = _units_of(curve)
    time, radius = units.points(curve.time, curve.radius)
    line, residual = _simulation(units, checks, "simulated", f"simulation: {digits.simulation_name(method)}")
    low, high = _time_ends(time, residual.x)
    compared = np.full(len(time), not has_answer)
    if len(residual.x):
        slack = 1e-6 * (time[-1] - time[0])
        compared = (time >= residual.x[0] - slack) & (time <= residual.x[-1] + slack)
    measured = np.isfinite(radius) & (time >= low) & (time <= high)
    layers, residuals = list[Layer](), [residual]
    if (predicted := predicted_radius(checks, curve)) is not None:
        layers.append(Layer("area", "draws", *units.points(*predicted), "90 % of predictions"))
    for look, name, some in (("measured", "measured", compared), ("outside", "not compared", ~compared)):
        layers.append(Layer("dots", look, time[measured & some], radius[measured & some], name))
    layers.append(line)
    if what_if and what_if.reconstruction_time is not None:
        other, left = _simulation(units, what_if, "what-if", "sliders")
        layers.append(other)
        residuals.append(replace(left, shape="line", look="what-if"))
    layers = [layer for layer in layers if len(layer.y)]
    note = "" if has_answer else "no answer: no line is drawn"
    if not measured.any():
        note = "no measured radius"
    remark = f"recorded until {time[-1]:.0f}" if len(time) and time[-1] > high else ""
    x, y = Axis(units.time, low, high, remark), Axis(units.radius, 0.0, 1.05 * _largest(layers, 0.0) or 1.05)
    panels = [Panel(x, y, tuple(layers), note)]
    if len(residual.y):
        panels.append(_residual_panel(x, residuals, checks))
    return panels


def _residual_panel(x: Axis, residuals: Sequence[Layer], checks: Checks) -> Panel:
    """The panel of the residuals, with the area that holds 90 % of the predictions, or else ± RMSE."""
    rmse, ends = 100.0 * (checks.rmse_over_rmax or 0.0), np.array([x.low, x.high])
    note = f"RMSE {digits.significant(rmse, 2)} %" if rmse else ""
    band = list[Layer]()
    if checks.predicted_over_rmax is not None:
        band = [Layer("area", "draws", residuals[0].x, 100.0 * checks.predicted_over_rmax)]
    elif rmse:
        band = [Layer("area", "band", ends, np.array([[-rmse, rmse], [-rmse, rmse]]))]
        note = f"band: ± {note}"
    largest = 1.15 * _largest([*residuals, *band], 0.1)
    zero = Layer("line", "zero", ends, np.zeros(2))
    return Panel(x, Axis(f"residual (% {RMAX})", -largest, largest), (*band, zero, *residuals), note)


def _largest(layers: Sequence[Layer], least: float) -> float:
    """The largest absolute value along `y` in these layers, or `least` if that is larger."""
    return max([least, *(float(np.nanmax(np.abs(layer.y), initial=0.0)) for layer in layers)])


def preview_panels(curve: RadiusCurve, window: RadiusCurve) -> list[Panel]:
    """The panel of a curve without an answer: which frames are to be compared (those of `window`), which are outliers,
    and which have no radius. Raises InputError: the curve has no R_max."""
    (panel,) = curve_panels(curve, Checks("ok", compared_time=window.time))
    time, radius = _units_of(curve).points(curve.time, curve.radius)
    within = (time >= panel.x.low) & (time <= panel.x.high)
    outliers = np.isin(np.arange(len(time)), curve.spikes()) & within
    missing = time[np.isnan(radius) & within]
    layers = [Layer("dots", "outlier", time[outliers], radius[outliers], "stands out, kept")]
    layers.append(Layer("ticks", "missing", missing, np.zeros(len(missing)), "no radius"))
    return [replace(panel, layers=(*panel.layers, *(layer for layer in layers if len(layer.x))))]


def _simulation(units: _Units, checks: Checks, look: str, name: str) -> tuple[Layer, Layer]:
    """(line of a simulation, points of its residual); layers without points where `checks` has no values."""
    names = ("reconstruction_time", "reconstruction_radius", "compared_time", "residual_over_rmax")
    arrays = (getattr(checks, name) for name in names)
    time, radius, compared_time, residual = (np.empty(0) if values is None else values for values in arrays)
    for values, times in ((radius, time), (residual, compared_time)):
        if values.size and values.shape != times.shape:
            raise ValueError(f"{len(values)} values at {len(times)} times")
    compared_time, _ = units.points(compared_time, compared_time)
    line = Layer("line", look, *units.points(time, radius), name)
    return line, Layer("dots", "residual", compared_time, 100.0 * residual)


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
    most = _GROUP_POINTS // max(len(curves), 1)
    sizes = np.array([curve.max_radius for curve, _ in curves])
    areas, dots = list[Layer](), list[Layer]()
    for (curve, checks), tone in zip(curves, tones_of(sizes).tolist(), strict=True):
        start, unit = curve.time_of_max, checks.time_scale or np.nan
        line, radius = checks.reconstruction_time, checks.reconstruction_radius
        if (predicted := predicted_radius(checks, curve)) is not None:
            area = (predicted[0] - start) / unit, predicted[1] / curve.max_radius
            areas.append(Layer("area", "draws-shot", *area, "", tone, most))
        elif line is not None and radius is not None:
            areas.append(Layer("line", "shot", (line - start) / unit, radius / curve.max_radius, "", tone, most))
        time = (curve.time - start) / unit
        some = (time >= -0.1) & (time <= (end or np.inf)) & np.isfinite(curve.radius)
        dots.append(Layer("dots", "measured-shot", time[some], curve.radius[some] / curve.max_radius, "", tone, most))
    layers = tuple(layer for layer in (*areas, *dots) if len(layer.x))
    last = end or max([1.0, *(float(layer.x.max()) for layer in layers)])
    note = f"{RMAX} {1e6 * np.nanmin(sizes):.0f} µm"
    note += f" (dark) to {1e6 * np.nanmax(sizes):.0f} µm (light)" if np.ptp(sizes) else ""
    note += f", 1 of {every} shots is drawn" if every > 1 else ""
    x = Axis(f"t* = t √(p/ρ) / {RMAX}", -0.1, last)
    return Panel(x, Axis(f"R / {RMAX}", 0.0, 1.06 * _largest(layers, 1.0)), layers, note)


def tones_of(sizes: Floats) -> Floats:
    """Tones from 0 (the smallest, dark) to 1 (the largest)."""
    return (sizes - sizes.min()) / (np.ptp(sizes) or 1.0)
