"""What the picture of one curve shows, in the units of its axes: the same panels for the report, the page for the wall,
the app and the files that are asked for."""

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
from cavirheo.reporting.answer import CurveRecord
from cavirheo.writing import digits

RMAX = "Rₘₐₓ"
_STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Axis:
    """Name and ends of an axis, and a remark on it, for which a paper has no room."""

    label: str
    low: float
    high: float
    remark: str = ""

    @property
    def title(self) -> str:
        """The name with the remark."""
        return ", ".join(filter(None, (self.label, self.remark)))

    def ticks(self, most: int) -> list[float]:
        """At most so many round numbers within the ends, evenly spaced; the ends where no round number is known."""
        rough = (self.high - self.low) / max(most, 1)
        if not np.isfinite(rough) or rough <= 0.0:
            return []
        ten = 10.0 ** np.floor(np.log10(rough))
        step = next(factor * ten for factor in _STEPS if factor * ten >= rough * (1.0 - 1e-9))
        first, last = np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9)
        return [float(f"{number * step:.10g}") + 0.0 for number in np.arange(first, last + 1.0)]


@dataclass(frozen=True, eq=False)
class Layer:
    """Points of a panel that look alike.

    Attributes:
        shape: "dots", "line", "bars" (values with their intervals), "band" (between two values of `y`), "area" (between
            two lines) or "ticks" (on the lower end of `y`).
        look: by which every way of drawing has colours and sizes: "measured", "simulated", ...
        x: (n,); of bars (n, 3) lower ends, middles and upper ends; of a band (2,) the ends of the axis.
        y: likewise; of an area (n, 2); of ticks zeros.
        name: in the key of the picture; "" is left out.
        tones: (n,) of points in colours of their own, or (1,) of a line, from 0, dark, to 1, light; None: that of the
            look.
        share: part of the points of a picture that it may have; None: it is drawn as it is.
    """

    shape: Literal["dots", "line", "bars", "band", "area", "ticks"]
    look: str
    x: Floats
    y: Floats
    name: str = ""
    tones: Floats | None = None
    share: float | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with layers over each other.

    Attributes:
        top: a second axis along the top; None where there is none.
        note: words beside the key.
    """

    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    top: Axis | None = None
    note: str = ""

    def layer(self, look: str) -> Layer:
        """The first of this look, or one without points."""
        nothing = Layer("dots", look, np.empty(0), np.empty(0))
        return next((layer for layer in self.layers if layer.look == look), nothing)


def curve_panels(
    curve: RadiusCurve,
    checks: Checks,
    simulated_as: str = "simulation",
    *,
    fit: Checks | None = None,
    what_if: Checks | None = None,
    draws: tuple[Floats, Floats, Floats] | None = None,
) -> list[Panel]:
    """The radius, measured and simulated, then what is left between, if anything was compared.

    checks: what was found when its answer was simulated; a failed one leaves the measured points alone. simulated_as:
    the name of the line. fit and what_if: the simulations of a conventional fit and of other values. draws: the band in
    which those of the draws run: times (s), lower and upper radius (m). Raises ValueError: times and values of a line
    are not as many.
    """
    if checks.verdict == "failed":
        checks = Checks("failed")
    units = _Units.of(curve)
    time, radius = units.points(curve.time, curve.radius)
    line, difference = _simulation(units, checks, "simulated", simulated_as)
    has_answer, rmse = checks.verdict != "failed", 100.0 * (checks.rmse_over_rmax or 0.0)
    compared = np.full(len(time), not has_answer)
    if len(difference.x):
        slack = 1e-6 * (time[-1] - time[0])
        compared = (time >= difference.x[0] - slack) & (time <= difference.x[-1] + slack)
    low, high = _view(time, difference.x)
    measured = np.isfinite(radius) & (time >= low) & (time <= high)
    share = 0.4 / max(int(np.count_nonzero(measured)), 1)  # as much as the simulation has
    layers = [
        Layer("dots", look, time[some], radius[some], name, share=share * np.count_nonzero(some))
        for look, name, some in (
            ("measured", "measured", measured & compared),
            ("outside", "not compared", measured & ~compared),
        )
    ] + [line]
    if draws:
        area = units.points(draws[0], np.column_stack(draws[1:]))
        layers.insert(0, Layer("area", "draws", *area, "90 % of the draws", share=0.2))
    differences = [difference]
    for look, name, simulation in (("fit", "least squares", fit), ("what-if", "sliders", what_if)):
        if simulation and simulation.reconstruction_time is not None:
            line, left = _simulation(units, simulation, look, name)
            layers.append(line)
            differences.append(replace(left, shape="line", look=look))
    remark = f"recorded until {time[-1]:.0f}" if len(time) and time[-1] > high else ""
    x, top = Axis(units.time, low, high, remark), 1.05 * _largest(layers, 0.0) or 1.05
    note = "" if has_answer else "no answer: no line is drawn"
    t_c = (checks.time_scale or 0.0) * units.per_second
    panels = [
        Panel(
            x,
            Axis(units.radius, 0.0, top),
            tuple(layer for layer in layers if len(layer.y)),
            Axis("t*", low / t_c, high / t_c) if t_c else None,
            note if measured.any() else "no measured radius",
        )
    ]
    if len(difference.y):
        largest = 1.15 * max(_largest(differences, 0.1), rmse)
        ends = np.array([low, high])
        band = [Layer("band", "band", ends, np.array([-rmse, rmse]))] if rmse else []
        zero = Layer("line", "zero", ends, np.zeros(2))
        note = f"band: ± RMSE = {digits.significant(rmse, 2)} %" if rmse else ""
        panels.append(Panel(x, Axis(f"residual (% {RMAX})", -largest, largest), (*band, zero, *differences), note=note))
    return panels


def _largest(layers: Sequence[Layer], least: float) -> float:
    """The largest of all numbers along `y`, whatever their sign; `least` at least."""
    return float(np.nanmax(np.concatenate([np.abs(layer.y).ravel() for layer in layers]), initial=least))


def _simulation(units: _Units, checks: Checks, look: str, name: str) -> tuple[Layer, Layer]:
    """The line of a simulation, and what is left between; without values where there are none. Raises ValueError."""
    names = ("reconstruction_time", "reconstruction_radius", "compared_time", "residual_over_rmax")
    arrays = [getattr(checks, name) for name in names]
    time, radius, compared_time, residual = (np.empty(0) if values is None else values for values in arrays)
    for values, times in ((radius, time), (residual, compared_time)):
        if values.size and values.shape != times.shape:
            raise ValueError(f"{len(values)} values at {len(times)} times")
    compared_time, _ = units.points(compared_time, compared_time)
    return (
        Layer("line", look, *units.points(time, radius), name, share=0.4),
        Layer("dots", "residual", compared_time, 100.0 * residual, share=0.2),
    )


def answer_panels(curve: RadiusCurve, checks: Checks, record: CurveRecord) -> list[Panel]:
    """The panels of a curve as its row says: a row without an answer has none of the simulation."""
    name = f"simulation: {digits.simulated(record.method)}"
    return curve_panels(curve, checks if record.has_answer else Checks("failed"), name)


def preview_panels(curve: RadiusCurve, window: RadiusCurve) -> list[Panel]:
    """The panel of a curve before it is answered: which frames are compared (those of `window`), which stand out, and
    which have no radius. Raises InputError: the curve has no R_max."""
    (panel,) = curve_panels(curve, Checks("unverified", compared_time=window.time))
    time, radius = _Units.of(curve).points(curve.time, curve.radius)
    within = (time >= panel.x.low) & (time <= panel.x.high)
    outliers = np.isin(np.arange(len(time)), curve.spikes()) & within
    missing = np.isnan(radius) & within
    layers = (
        Layer("dots", "outlier", time[outliers], radius[outliers], "stands out, kept"),
        Layer("ticks", "missing", time[missing], np.zeros(np.count_nonzero(missing)), "no radius"),
    )
    return [replace(panel, layers=(*panel.layers, *(layer for layer in layers if len(layer.x))))]


class _Units(NamedTuple):
    """How the axes of a curve count: names of both, origin (s), units per second and per metre."""

    time: str
    radius: str
    origin: float
    per_second: float
    per_metre: float

    @classmethod
    def of(cls, curve: RadiusCurve) -> _Units:
        """µs after R_max and µm, as far as the scales of the curve are known."""
        radius, per_metre = "R (µm)", 1e6
        if curve.unscaled:
            radius, per_metre = "R / largest R", 1.0 / float(np.nanmax(curve.radius, initial=1e-300))
        if curve.time_unscaled:
            return cls("time (no scale)", radius, 0.0, 1.0, per_metre)
        with suppress(InputError):  # no maximum
            return cls(f"time after {RMAX} (µs)", radius, curve.time_of_max, 1e6, per_metre)
        return cls("time of the recording (µs)", radius, 0.0, 1e6, per_metre)

    def points(self, time: Floats, radius: Floats) -> tuple[Floats, Floats]:
        """Along both axes, of seconds and metres."""
        return (time - self.origin) * self.per_second, radius * self.per_metre


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
