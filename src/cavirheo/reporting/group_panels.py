"""The two panels of a group: the plane of G and mu with the 90 % region of each shot and that of the material; and all
curves, R/R_max over t*, with what their answers predict. Both have the same colours, darker for smaller R_max.

A bound is an arrow at its limit, never a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.answer import CurveRecord, Unit, display_unit, parameters_of
from cavirheo.reporting.group import MATERIAL_CONSTANTS, GroupRecord
from cavirheo.reporting.panels import RMAX, Axis, Layer, Panel, predicted_radius, tones_of
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread

MAX_DRAWN = 60  # most shots in a picture of a group; of more every k-th is drawn
_SIZE = "R_max"  # used instead of the name of a parameter
_REGION_DRAWS = 300  # draws from which the region of a shot is found
_REGION_SHARE = 0.9  # share of the draws in a region
_ARROW = 0.09  # length of an arrow, of that of its axis
_MARGIN = 0.07  # margin of an axis, of its length
_LEAST_DECADES = 0.4  # least length of an axis
_NAME = 14  # most letters of a name in a picture


@dataclass(frozen=True)
class Ends:
    """A value on a logarithmic axis: ends and middle, log10 of the unit of the axis. side: -1, it is below `high`; 1,
    it is above `low`; 0, it lies between them."""

    low: float
    middle: float
    high: float
    side: int = 0


@dataclass
class _Drawn:
    """What is collected of the shots for the plane."""

    layers: list[Layer] = field(default_factory=list)
    bounds: list[tuple[Ends, Ends, str, Floats | None]] = field(default_factory=list)  # x, y, look, tone
    x: list[float] = field(default_factory=list)
    y: list[float] = field(default_factory=list)
    names: list[tuple[float, float, str, str]] = field(default_factory=list)  # x, y, text, look


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, and all curves, of the answered shots of a group. indices: of the group's curves in the
    result. A law without a modulus has R_max in its place."""
    members = [i for i in indices if result.curves[i].has_answer]
    every = max(-(-len(members) // MAX_DRAWN), 1)
    members = members[::every]
    records = [result.curves[i] for i in members]
    names = dict(zip(indices, digits.distinct_names([result.curves[i].name for i in indices]), strict=True))
    of_laws = parameters_of(records)
    upper = next((name for name in MATERIAL_CONSTANTS if name in of_laws), of_laws[0])
    across = "shear_modulus" if "shear_modulus" in of_laws and upper != "shear_modulus" else _SIZE
    tones = tones_of(np.array([record.max_radius_m or np.nan for record in records]))
    end = 1.1 * (max((record.window.t_star_end or 0.0 for record in records), default=0.0) or 1.0)
    drawn = _Drawn()
    curves = list[Layer]()
    for i, record, tone in zip(members, records, tones, strict=True):  # draws of thousands need not be in memory
        curve, answer = pairs[i]
        _add_shot(drawn, answer, record, (across, upper), result.modulus_unit, tone[None], names[i])
        curves += _curve_layers(curve, answer.checks, end, tone[None], 0.5 / len(members))
    note = f", 1 of {every} shots is drawn" if every > 1 else ""
    plane = _plane(drawn, group, (across, upper), result.modulus_unit)
    return [plane, _all_curves(curves, records, end, note)]


def ends_of(value: Quantity, factor: float = 1.0) -> Ends | None:
    """The value on an axis; None where nothing is known. A modulus that is exactly 0 is below the low end."""
    if not value.known or value.bound == "undetermined":
        return None
    if value.bound in ("upper", "lower"):
        limit = value.q95 if value.bound == "upper" else value.q05
        place = float(np.log10(factor * limit)) if limit else -np.inf
        return Ends(place, place, place, -1 if value.bound == "upper" else 1)
    numbers = [value.q05, value.median, value.q95]
    known = [number for number in numbers if number]
    if not known or min(known) <= 0.0:
        return None
    low, high = (np.log10(factor * end) for end in (min(known), max(known)))
    middle = 0.5 * (low + high) if value.median is None else np.log10(factor * value.median)
    return Ends(float(low), float(middle), float(high))


def _add_shot(
    drawn: _Drawn, answer: Posterior, record: CurveRecord, axes: tuple[str, str], unit: Unit, tone: Floats, name: str
) -> None:
    """Add the region of a shot, or its arrows."""
    x, y = (_of_shot(record, axis, unit) for axis in axes)
    if x is None or y is None:
        return
    look = "region" if record.trusted else "region-out"
    colour = tone if record.trusted else None
    points = np.array([[x.low, y.low], [x.high, y.high]])
    region = None if x.side or y.side else _region(answer, axes, unit)
    beside = "beside" if region is None else ""
    if x.side or y.side:
        drawn.bounds.append((x, y, look, colour))
    elif region is not None:
        points = region
        drawn.layers.append(Layer("region", look, region[:, 0], region[:, 1], tones=colour))
    else:
        across, up = (np.array([[ends.low, ends.middle, ends.high]]) for ends in (x, y))
        drawn.layers.append(Layer("bars", "interval", across, up, tones=tone))
        drawn.layers.append(Layer("dots", "estimate", across[:, 1], up[:, 1], tones=tone))
    drawn.x += points[:, 0].tolist()
    drawn.y += points[:, 1].tolist()
    kind = " ".join(filter(None, ["shot-name", beside, "" if record.trusted else "outside"]))
    drawn.names.append((x.middle, y.middle, digits.elide(name, _NAME), kind))


def _of_shot(record: CurveRecord, name: str, unit: Unit) -> Ends | None:
    if name == _SIZE:
        return ends_of(Quantity(median=record.max_radius_m), 1e6)
    if name in ("viscosity", VISCOSITY_AT_RATE):
        return ends_of(record.viscosity)
    return ends_of(record.value(name), display_unit(name, unit)[1])


def _region(answer: Posterior, axes: tuple[str, str], unit: Unit) -> Floats | None:
    """(n, 2) corners of the hull of the densest 90 % of the draws; None of a point answer, or of a value that is not
    among the draws."""
    if len(answer.theta) < 2 or not set(axes) <= set(answer.parameters):
        return None
    values = np.stack([answer.draws(name) * display_unit(name, unit)[1] for name in axes], axis=-1)
    positive = np.all(values > 0.0, axis=1)
    weight = answer.weights[positive]
    if np.count_nonzero(positive) < 10 or not weight.sum() > 0.0:
        return None
    cumulated = np.cumsum(weight) / weight.sum()
    places = (np.arange(_REGION_DRAWS) + 0.5) / _REGION_DRAWS
    points = np.log10(values[positive])[np.minimum(np.searchsorted(cumulated, places), len(weight) - 1)]
    covariance = np.cov(points.T) + 1e-12 * np.eye(2)
    white = np.linalg.solve(np.linalg.cholesky(covariance), points.T) * _REGION_DRAWS ** (1 / 6)  # Scott's width is 1
    square = np.sum(white**2, axis=0)
    distances = square[:, None] + square - 2.0 * white.T @ white
    density = np.exp(-0.5 * np.maximum(distances, 0.0)).sum(axis=1)
    return _hull(points[np.argsort(-density)[: round(_REGION_SHARE * len(points))]])


def _hull(points: Floats) -> Floats:
    """(n, 2) corners of the convex hull of points, in order (Andrew's monotone chain)."""
    ordered = sorted(map(tuple, points.tolist()))
    corners = list[tuple[float, ...]]()
    for some in (ordered, ordered[::-1]):
        side = list[tuple[float, ...]]()
        for x, y in some:
            while len(side) > 1 and _turn(side[-2], side[-1], (x, y)) <= 0.0:
                side.pop()
            side.append((x, y))
        corners += side[:-1]
    return np.array(corners or ordered[:1])


def _turn(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _plane(drawn: _Drawn, group: GroupRecord, axes: tuple[str, str], unit: Unit) -> Panel:
    """The panel of the plane, with the material and the values of other methods."""
    of_group = _of_group(group, axes, unit)
    boxes = [box for box in of_group if any(box[2:])]
    for *_, x, y in boxes:
        drawn.x += [end for end in (x.low, x.high) if np.isfinite(end)] if x else []
        drawn.y += [end for end in (y.low, y.high) if np.isfinite(end)] if y else []
    across, up = (_axis(name, ends, unit) for name, ends in zip(axes, (drawn.x, drawn.y), strict=True))
    layers = [*drawn.layers]
    for x, y, look, tone in drawn.bounds:
        layers += _bound_layers(x, y, (across, up), look, tone)
    for look, name, x, y in boxes:
        open_x, open_y = (Ends(axis.low, 0.5 * (axis.low + axis.high), axis.high) for axis in (across, up))
        layers += _box(x or open_x, y or open_y, (across, up), look, name)
    for x_name, y_name, text, look in drawn.names:
        at = np.clip([[x_name, y_name]], [across.low, up.low], [across.high, up.high])
        layers.append(Layer("labels", look, at[:, 0], at[:, 1], texts=(text,)))
    return Panel(across, up, _named([layer for layer in layers if len(layer.x)]))


def _named(layers: Sequence[Layer]) -> tuple[Layer, ...]:
    """The layers, the first of each look with its name in the key."""
    names = {"region": "shot, 90 %", "region-out": "does not count", "estimate": "shot"}
    named = list[Layer]()
    for layer in layers:
        name = layer.name or names.pop(layer.look, "")
        named.append(Layer(layer.shape, layer.look, layer.x, layer.y, name, layer.tones, layer.share, layer.texts))
    return tuple(named)


def _of_group(group: GroupRecord, axes: tuple[str, str], unit: Unit) -> list[tuple[str, str, Ends | None, Ends | None]]:
    """(look, name, x, y) of the material and of the values of other methods."""
    boxes = list[tuple[str, str, Ends | None, Ends | None]]()
    of_axes = [(name, 1.0 if name == _SIZE else display_unit(name, unit)[1]) for name in axes]
    if group.material and not group.material.heaps:
        x, y = (
            None
            if name == _SIZE
            else ends_of(group.viscosity if name in ("viscosity", VISCOSITY_AT_RATE) else group.value(name), factor)
            for name, factor in of_axes
        )
        boxes.append(("material", "material, 90 %", x, y))
    for method, values in group.published.items():
        x, y = (_of_spread(values.get(name, Spread()), factor) for name, factor in of_axes)
        boxes.append(("published", digits.elide(method, _NAME), x, y))
    return boxes


def _of_spread(value: Spread, factor: float) -> Ends | None:
    """Mean and standard deviation on an axis."""
    if not value.mean or value.mean <= 0.0:
        return None
    std = value.std or 0.0
    low = max(value.mean - std, 0.1 * value.mean)
    first, middle, last = (float(np.log10(factor * number)) for number in (low, value.mean, value.mean + std))
    return Ends(first, middle, last)


def _axis(name: str, ends: Sequence[float], unit: Unit) -> Axis:
    """A logarithmic axis around these ends."""
    finite = [end for end in ends if np.isfinite(end)] or [0.0]
    low, high = min(finite), max(finite)
    missing = 0.5 * max(_LEAST_DECADES - (high - low), 0.0)
    margin = missing + (_MARGIN + _ARROW) * (high - low + 2.0 * missing)
    if name == _SIZE:
        return Axis(f"{RMAX} (µm)", low - margin, high + margin, log=True)
    symbol, _, written = display_unit(name, unit)
    return Axis(f"{symbol} ({written})" if written else symbol, low - margin, high + margin, log=True)


def _bound_layers(x: Ends, y: Ends, axes: tuple[Axis, Axis], look: str, tone: Floats | None) -> list[Layer]:
    """Arrows from the limits of a bound into what it allows, and the interval of the other value at the limit."""
    (left, middle, right), (bottom, centre, top) = (
        np.clip([ends.low, ends.middle, ends.high], axis.low, axis.high)
        for ends, axis in zip((x, y), axes, strict=True)
    )
    layers = []
    along, up = (_ARROW * (axis.high - axis.low) for axis in axes)
    starts = [(middle, centre, x.side * along, 0.0)] if x.side else []
    starts += [(middle, centre, 0.0, y.side * up)] if y.side else []
    begin = np.array(starts)
    across, down = begin[:, [0]] + begin[:, 2:3] * [0.0, 1.0], begin[:, [1]] + begin[:, 3:4] * [0.0, 1.0]
    layers.append(Layer("arrows", f"arrow {look}", across, down, tones=tone))
    layers.append(Layer("line", f"limit {look}", np.array([left, right]), np.array([bottom, top]), tones=tone))
    return layers


def _box(x: Ends, y: Ends, axes: tuple[Axis, Axis], look: str, name: str) -> list[Layer]:
    """The rectangle of two intervals; arrows where one of them is a bound."""
    if x.side or y.side:
        layers = _bound_layers(x, y, axes, look, None)
        return [Layer("line", look, layers[1].x, layers[1].y, name), layers[0]]
    corners = np.array([[x.low, y.low], [x.high, y.low], [x.high, y.high], [x.low, y.high]])
    return [Layer("region", look, corners[:, 0], corners[:, 1], name)]


def _curve_layers(curve: RadiusCurve, checks: Checks, end: float, tone: Floats, share: float) -> list[Layer]:
    """Points of a curve and the area that its answer predicts, R/R_max over t*."""
    unit, size = checks.time_scale or np.nan, curve.max_radius
    layers = []
    if (predicted := predicted_radius(checks, curve)) is not None:
        time, radius = predicted
        layers.append(Layer("area", "draws-shot", (time - curve.time_of_max) / unit, radius / size, "", tone, share))
    elif (line := checks.reconstruction_radius) is not None and (times := checks.reconstruction_time) is not None:
        if len(line) != len(times):
            return []
        time = (times - curve.time_of_max) / unit
        layers.append(Layer("line", "shot", time, line / size, "", tone, share))
    time = (curve.time - curve.time_of_max) / unit
    some = (time >= -0.1) & (time <= end) & np.isfinite(curve.radius)
    layers.append(Layer("dots", "measured-shot", time[some], curve.radius[some] / size, "", tone, share))
    return [layer for layer in layers if len(layer.x)]


def _all_curves(layers: Sequence[Layer], records: Sequence[CurveRecord], end: float, note: str) -> Panel:
    sizes = np.array([1e6 * (record.max_radius_m or np.nan) for record in records])
    key = f"{RMAX} {np.nanmin(sizes):.0f} µm"
    if np.ptp(sizes):
        key += f" (dark) to {np.nanmax(sizes):.0f} µm (light)"
    ordered = sorted(layers, key=lambda layer: layer.shape == "dots")  # areas below
    top = 1.06 * max([1.0, *(float(np.nanmax(layer.y)) for layer in ordered)])
    axes = Axis(f"t* = t √(p/ρ) / {RMAX}", -0.1, end), Axis(f"R / {RMAX}", 0.0, top)
    return Panel(*axes, tuple(ordered), note=key + note)
