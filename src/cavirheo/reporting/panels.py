"""The content of pictures in the units of their axes, the same for the report, the app and `Posterior.plot`: a curve
with its residual; all curves of a group; and the plane of G and mu, with the 90 % region of each shot, that of the
material, and the values of other methods. Shots of a group are darker for smaller R_max. A bound is an arrow at its
limit, never a point."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Checks, Posterior, weighted_quantile
from cavirheo.reporting.documents import Pairs
from cavirheo.reporting.record import GroupRecord, Result, parameters_of
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

RMAX = "Rₘₐₓ"
MAX_DRAWN = 60  # most shots in one picture; of more every k-th is drawn
_LOG_DIGITS = ((1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0), (1.0, 2.0, 3.0, 5.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))
_REGION_SHARE = 0.9  # share of the draws in a region
_MIN_REGION_DRAWS = 10
_ARROW = 0.09  # length of an arrow, of that of its axis
_MARGIN = 0.07  # margin of an axis, of its length
_LEAST_DECADES = 0.4  # least length of an axis
_NAME = 14  # most letters of a name in a picture
_KEY = {"region": "shot", "region-out": "not counted", "estimate": "shot", "arrow": "bound"}  # name of the first one
_HEAD = np.array([[0.0, 0.0], [1.0, 0.0], [0.8, 0.12], [1.0, 0.0], [0.8, -0.12]])  # an arrow: along it, and across
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
        for step in (ten, 2.0 * ten, 5.0 * ten, 10.0 * ten):
            numbers = np.arange(np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9) + 1.0)
            if len(numbers) <= most + 1:
                break
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
    time, origin = "time of the recording (µs)", 0.0
    with suppress(InputError):  # no maximum
        time, origin = f"time after {RMAX} (µs)", curve.time_of_max
    radius, per_metre = "R (µm)", 1e6
    if curve.unscaled:
        radius, per_metre = "R / largest R", 1.0 / float(np.nanmax(curve.radius, initial=1e-300))
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
    layers, residuals = list[Layer](), [residual]
    if (predicted := predicted_radius(checks, curve)) is not None:
        layers.append(_band("draws", *points(*predicted), "90 % of predictions"))
    for look, name, some in (("measured", "measured", compared), ("outside", "not compared", ~compared)):
        layers.append(Layer("dots", look, time[measured & some], radius[measured & some], name))
    layers.append(line)
    if what_if:
        other, left = _simulation(points, what_if, "what-if", "sliders")
        layers.append(other)
        residuals.append(replace(left, shape="line", look="what-if"))
    note = "" if has_answer else "no answer: no line is drawn"
    note = note if measured.any() else "no measured radius"
    remark = f"recorded until {time[-1]:.0f}" if len(time) and time[-1] > high else ""
    x = Axis(time_label, low, high, remark)
    y = Axis(radius_label, 0.0, 1.05 * _largest(layers, 0.0) or 1.05)
    title = f"measured radius over time, {simulation}" if len(line.x) else "measured radius over time"
    panel = Panel(x, y, tuple(layers), title, note)
    return [panel, _residual_panel(x, residuals, checks)] if len(residual.y) else [panel]


def _residual_panel(x: Axis, residuals: Sequence[Layer], checks: Checks) -> Panel:
    """The panel of the residuals, with the area that holds 90 % of the predictions."""
    note = f"RMSE {digits.percent(checks.rmse_over_rmax)} %" if checks.rmse_over_rmax else ""
    predicted = checks.predicted_over_rmax
    band = [] if predicted is None else [_band("draws", residuals[0].x, 100.0 * predicted)]
    largest = 1.15 * _largest([*residuals, *band], 0.1)
    zero = Layer("line", "zero", np.array([x.low, x.high]), np.zeros(2))
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
    """(times (n,), s, ends (n, 2), m, between which 90 % of an answer's predictions lie); None without draws."""
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


Axes = dict[str, digits.Shown]  # of G and mu, by name


class _Place(NamedTuple):
    """A shot, the material or the value of another method in the plane.

    ends: (2, 2) low and high of G and of mu, log10 of the units of the axes; infinite where there is no limit. corners:
    (n, 2) of the region of a shot; of anything else its rectangle is drawn.
    """

    look: str
    name: str
    ends: Floats
    corners: Floats | None = None
    tone: float | None = None

    @property
    def known(self) -> bool:
        """Whether anything is known of both G and mu."""
        return bool(np.all(np.isfinite(self.ends).any(axis=1) | (self.ends[:, 0] == self.ends[:, 1])))

    @property
    def sides(self) -> np.ndarray:
        """(2,) -1 of an upper bound, 1 of a lower one, else 0."""
        return np.isposinf(self.ends[:, 1]).astype(int) - np.isneginf(self.ends[:, 0])

    def limits(self, low: Floats, high: Floats) -> Floats:
        """(2, 2) ends of what is drawn on axes with these ends (2,): of a bound its limit, else the interval."""
        lower, upper = np.clip(self.ends, low[:, None], high[:, None]).T
        ends = [np.where(self.sides < 0, upper, lower), np.where(self.sides > 0, lower, upper)]
        return np.column_stack(ends)

    def layers(self, low: Floats, high: Floats) -> list[Layer]:
        """The region; a point if there are no intervals; of a bound an arrow from its limit into what it allows, and
        the interval of the other value at the limit."""
        x, y = self.limits(low, high)
        tone = None if self.look == "region-out" else self.tone
        if self.sides.any():
            layers = [Layer("line", f"limit {self.look}", x, y, tone=tone)]
            for k in np.flatnonzero(self.sides):
                along, up = (self.sides[k] * _ARROW * np.roll(_HEAD, k, axis=1) * (high - low)).T
                layers.append(Layer("line", f"arrow {self.look}", x.mean() + along, y.mean() + up, tone=tone))
            return layers
        if self.corners is None and np.all(self.ends[:, 0] == self.ends[:, 1]):
            return [Layer("dots", "estimate", x[:1], y[:1], tone=self.tone)]
        corners = np.array([x[[0, 1, 1, 0]], y[[0, 0, 1, 1]]]).T if self.corners is None else self.corners
        return [Layer("area", self.look, corners[:, 0], corners[:, 1], tone=tone)]


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, unless the law lacks one, and all curves, of the answered shots with these indices."""
    names = dict(zip(indices, digits.short_names([result.curves[i].name for i in indices], _NAME), strict=True))
    members = [i for i in indices if result.curves[i].has_answer]
    chosen = members[:: max(-(-len(members) // MAX_DRAWN), 1)]
    rows = [result.curves[i] for i in chosen]
    end = 1.1 * max([row.window.t_star_end or 1.0 for row in rows])
    curves = all_curves_panel([(pairs[i][0], pairs[i][1].checks) for i in members], end)
    known = parameters_of(rows)
    names_of_axes = [name for name in ("shear_modulus", "viscosity", VISCOSITY_AT_RATE) if name in known][:2]
    axes = {name: result.shown(name) for name in names_of_axes}
    if len(axes) < 2 or "shear_modulus" not in axes:
        return [curves]
    tones = tones_of(np.array([row.max_radius_m or np.nan for row in rows]))
    shots = []
    for i, row, tone in zip(chosen, rows, tones, strict=True):
        ends = _ends([row.value(name) for name in axes], axes)
        corners = _region(pairs[i][1], axes) if np.all(np.isfinite(ends)) else None
        shots.append(_Place("region" if row.trusted else "region-out", names[i], ends, corners, float(tone)))
    places = []
    if group.population.has_material and not group.population.heaps:
        places.append(_Place("material", "material", _ends([group.value(name) for name in axes], axes)))
    for method, of in group.published.items():
        values = [of[name].within_deviation if name in of else Quantity() for name in axes]
        places.append(_Place("published", digits.elide(method.partition(",")[0], _NAME), _ends(values, axes)))
    references = [place for place in places if np.isfinite(place.ends).any()]
    return [_plane([shot for shot in shots if shot.known], references, axes), curves]


def _ends(values: Iterable[Quantity], axes: Axes) -> Floats:
    """(2, 2) log10 of the ends of G and mu in the units of the axes; infinite where there is no limit."""
    factors = np.array([[shown.factor] for shown in axes.values()])
    with np.errstate(divide="ignore"):
        return np.asarray(np.log10(factors * np.array([value.limits for value in values])))


def _region(answer: Posterior, axes: Axes) -> Floats | None:
    """(n, 2) corners of the ellipse that holds 90 % of the draws; None without draws of both values."""
    if not axes.keys() <= answer.parameters.keys():
        return None
    values = np.stack([answer.draws(name) * shown.factor for name, shown in axes.items()], axis=-1)
    positive = np.all(values > 0.0, axis=1)
    weights = answer.weights[positive]
    if len(weights) < _MIN_REGION_DRAWS or not weights.sum() > 0.0:
        return None
    points = np.log10(values[positive])
    middle = np.average(points, axis=0, weights=weights)
    root = np.linalg.cholesky(np.cov(points.T, aweights=weights) + 1e-12 * np.eye(2))
    distances = np.linalg.norm(np.linalg.solve(root, (points - middle).T), axis=0)
    radius = weighted_quantile(distances, _REGION_SHARE, np.log(np.maximum(weights, 1e-300)))
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    return np.asarray(middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1) @ root.T)


def _plane(shots: Sequence[_Place], references: Sequence[_Place], axes: Axes) -> Panel:
    across, up = (_axis(shown, k, [*shots, *references]) for k, shown in enumerate(axes.values()))
    low, high = np.array([[across.low, up.low], [across.high, up.high]])
    layers, labels = list[Layer](), list[Layer]()
    for place in shots:
        layers += place.layers(low, high)
        outside = "" if place.look == "region" else " outside"
        x, y = place.limits(low, high).mean(axis=1, keepdims=True)
        labels.append(Layer("label", f"shot-name{outside}", x, y, text=place.name))
    names = dict(_KEY)
    looks = ["region-out" if layer.look.endswith("region-out") else layer.look.split()[0] for layer in layers]
    layers = [replace(layer, name=names.pop(look, "")) for layer, look in zip(layers, looks, strict=True)]
    for place in references:
        first, *arrows = place.layers(low, high)
        layers += [replace(first, name=place.name), *arrows]
    title = f"{up.label} over {across.label}: the 90 % region of each shot, and that of the material"
    return Panel(across, up, (*layers, *labels), title)


def _axis(shown: digits.Shown, k: int, places: Sequence[_Place]) -> Axis:
    """A logarithmic axis around these places: the first or the second one of the plane."""
    ends = [place.ends[k] for place in places]
    ends += [place.corners[:, k] for place in places if place.corners is not None]
    limits = np.concatenate([*ends, [np.inf]])
    limits = limits[np.isfinite(limits)]
    low, high = (float(limits.min()), float(limits.max())) if len(limits) else (0.0, 0.0)
    missing = 0.5 * max(_LEAST_DECADES - (high - low), 0.0)
    margin = missing + (_MARGIN + _ARROW) * (high - low + 2.0 * missing)
    return Axis(f"{shown.symbol} ({shown.unit})", low - margin, high + margin, log=True)
