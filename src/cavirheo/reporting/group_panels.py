"""The two panels of a group: the plane of G and mu with the 90 % region of each shot and that of the material; and all
curves, R/R_max over t*, with what their answers predict. Both have the same colours, darker for smaller R_max.

A bound is an arrow at its limit, never a point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.answer import CurveRecord, Unit, display_unit, parameters_of
from cavirheo.reporting.group import MATERIAL_CONSTANTS, GroupRecord
from cavirheo.reporting.panels import RMAX, Axis, Layer, Panel, predicted_radius, sizes_in_words, tones_of
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
_KEY = {"region": "shot, 90 %", "region-out": "does not count", "estimate": "shot"}  # name of the first of each look


class Ends(NamedTuple):
    """A value on a logarithmic axis: ends and middle, log10 of the unit of the axis. side: -1, it is below `high`; 1,
    it is above `low`; 0, it lies between them."""

    low: float
    middle: float
    high: float
    side: int = 0


class _Quantity(NamedTuple):
    """What an axis of the plane shows: a parameter or _SIZE, its factor from SI, and its label."""

    name: str
    factor: float
    label: str

    def of_shot(self, record: CurveRecord) -> Ends | None:
        """The value of a shot."""
        if self.name == _SIZE:
            return ends_of(Quantity(median=record.max_radius_m), self.factor)
        known = record.viscosity if self.name in ("viscosity", VISCOSITY_AT_RATE) else record.value(self.name)
        return ends_of(known, self.factor)

    def of_material(self, group: GroupRecord) -> Ends | None:
        """The value of the material of a group."""
        known = group.viscosity if self.name in ("viscosity", VISCOSITY_AT_RATE) else group.value(self.name)
        return ends_of(known, self.factor)

    def of_method(self, value: Spread) -> Ends | None:
        """Mean and standard deviation by another method."""
        if not value.mean or value.mean <= 0.0:
            return None
        std = value.std or 0.0
        low = max(value.mean - std, 0.1 * value.mean)
        return Ends(*np.log10(self.factor * np.array([low, value.mean, value.mean + std])).tolist())

    def axis(self, values: Sequence[Ends | None], regions: Sequence[Floats]) -> Axis:
        """A logarithmic axis around these values, and these places of the corners of regions."""
        ends = [end for value in values if value for end in (value.low, value.high)]
        ends += [end for places in regions for end in (places.min(), places.max())]
        finite = [end for end in ends if np.isfinite(end)] or [0.0]
        low, high = float(min(finite)), float(max(finite))
        missing = 0.5 * max(_LEAST_DECADES - (high - low), 0.0)
        margin = missing + (_MARGIN + _ARROW) * (high - low + 2.0 * missing)
        return Axis(self.label, low - margin, high + margin, log=True)


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, and all curves, of the answered shots of a group. indices: of the group's curves in the
    result. A law without a modulus has R_max in its place."""
    names = dict(zip(indices, digits.distinct_names([result.curves[i].name for i in indices]), strict=True))
    members = [i for i in indices if result.curves[i].has_answer]
    every = max(-(-len(members) // MAX_DRAWN), 1)
    members = members[::every]
    records = [result.curves[i] for i in members]
    sizes = np.array([record.max_radius_m or np.nan for record in records])
    end = 1.1 * max([record.window.t_star_end or 1.0 for record in records])
    x, y = axes = _axes(records, result.modulus_unit)
    places, regions, curves = [], [], list[Layer]()
    for i, record, tone in zip(members, records, tones_of(sizes), strict=True):
        curve, answer = pairs[i]  # draws of thousands need not be in memory
        places.append((x.of_shot(record), y.of_shot(record)))
        regions.append(_region(answer, axes))
        curves += _curve_layers(curve, answer.checks, end, tone[None], 0.5 / len(members))
    boxes = _boxes(group, x, y)
    of_x, of_y = zip(*places, *((box.x, box.y) for box in boxes), strict=True)
    corners = [region for region in regions if region is not None]
    across = x.axis(of_x, [region[:, 0] for region in corners])
    up = y.axis(of_y, [region[:, 1] for region in corners])
    layers, labels = list[Layer](), list[Layer]()
    for i, record, tone, (a, b), region in zip(members, records, tones_of(sizes), places, regions, strict=True):
        if a is not None and b is not None:
            layers += _shot_layers(a, b, across, up, region, tone[None], record.trusted)
            look = f"shot-name{'' if region is not None or a.side or b.side else ' beside'}"
            at = np.clip([a.middle], across.low, across.high), np.clip([b.middle], up.low, up.high)
            text = digits.elide(names[i], _NAME)
            labels.append(Layer("labels", f"{look}{'' if record.trusted else ' outside'}", *at, texts=(text,)))
    for box in boxes:
        layers += _box_layers(box, across, up)
    left = dict(_KEY)
    layers = [layer if layer.name else replace(layer, name=left.pop(layer.look, "")) for layer in layers]
    note = f", 1 of {every} shots is drawn" if every > 1 else ""
    return [Panel(across, up, (*layers, *labels)), _all_curves(curves, sizes, end, note)]


def _axes(records: Sequence[CurveRecord], unit: Unit) -> tuple[_Quantity, _Quantity]:
    of_laws = parameters_of(records)
    upper = next((name for name in MATERIAL_CONSTANTS if name in of_laws), of_laws[0])
    made = []
    for name in ("shear_modulus", upper):
        symbol, factor, written = display_unit(name, unit)
        made.append(_Quantity(name, factor, f"{symbol} ({written})" if written else symbol))
    size = _Quantity(_SIZE, 1e6, f"{RMAX} (µm)")
    return (made[0] if "shear_modulus" in of_laws and upper != "shear_modulus" else size), made[1]


def ends_of(value: Quantity, factor: float = 1.0) -> Ends | None:
    """The value on an axis; None where nothing is known. A modulus that is exactly 0 is below the low end."""
    if not value.known or value.bound == "undetermined":
        return None
    if value.bound in ("upper", "lower"):
        place = float(np.log10(factor * value.largest)) if value.largest else -np.inf
        return Ends(place, place, place, -1 if value.bound == "upper" else 1)
    known = [number for number in (value.q05, value.median, value.q95) if number]
    if not known or min(known) <= 0.0:
        return None
    low, high = (float(np.log10(factor * end)) for end in (min(known), max(known)))
    return Ends(low, 0.5 * (low + high) if value.median is None else float(np.log10(factor * value.median)), high)


def _region(answer: Posterior, axes: Sequence[_Quantity]) -> Floats | None:
    """(n, 2) corners of the hull of the densest 90 % of the draws; None of a point answer, or of a value that is not
    among the draws."""
    if len(answer.theta) < 2 or not {axis.name for axis in axes} <= set(answer.parameters):
        return None
    values = np.stack([answer.draws(axis.name) * axis.factor for axis in axes], axis=-1)
    positive = np.all(values > 0.0, axis=1)
    weight = answer.weights[positive]
    if np.count_nonzero(positive) < 10 or not weight.sum() > 0.0:
        return None
    cumulated = np.cumsum(weight) / weight.sum()
    levels = (np.arange(_REGION_DRAWS) + 0.5) / _REGION_DRAWS
    points = np.log10(values[positive])[np.minimum(np.searchsorted(cumulated, levels), len(weight) - 1)]
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


def _shot_layers(
    x: Ends, y: Ends, across: Axis, up: Axis, region: Floats | None, tone: Floats, trusted: bool
) -> list[Layer]:
    """The arrows of a shot, its region, or its intervals."""
    look = "region" if trusted else "region-out"
    if x.side or y.side:
        return _bound_layers(x, y, across, up, look, tone if trusted else None)
    if region is not None:
        return [Layer("region", look, region[:, 0], region[:, 1], tones=tone if trusted else None)]
    places = np.array([x[:3]]), np.array([y[:3]])
    middle = places[0][:, 1], places[1][:, 1]
    return [Layer("bars", "interval", *places, tones=tone), Layer("dots", "estimate", *middle, tones=tone)]


class _Box(NamedTuple):
    """The material, or the values of another method, in the plane; None for a value that is not known."""

    look: str
    name: str
    x: Ends | None
    y: Ends | None


def _boxes(group: GroupRecord, x: _Quantity, y: _Quantity) -> list[_Box]:
    """The material and the values of other methods, where one of two values is known."""
    boxes = list[_Box]()
    if group.material and not group.material.heaps:
        boxes.append(_Box("material", "material, 90 %", x.of_material(group), y.of_material(group)))
    for method, values in group.published.items():
        a, b = (axis.of_method(values.get(axis.name, Spread())) for axis in (x, y))
        boxes.append(_Box("published", digits.elide(method, _NAME), a, b))
    return [box for box in boxes if box.x or box.y]


def _bound_layers(x: Ends, y: Ends, across: Axis, up: Axis, look: str, tone: Floats | None) -> list[Layer]:
    """Arrows from the limits of a bound into what it allows, and the interval of the other value at the limit."""
    horizontal = np.clip(x[:3], across.low, across.high)
    vertical = np.clip(y[:3], up.low, up.high)
    arrows = [(x.side, 0), (0, y.side)]
    length = _ARROW * np.array([across.high - across.low, up.high - up.low])
    steps = np.array([arrow for arrow in arrows if any(arrow)]) * length
    begin = np.array([horizontal[1], vertical[1]]) + 0.0 * steps
    ends = np.stack([begin, begin + steps], axis=-1)
    return [
        Layer("arrows", f"arrow {look}", ends[:, 0], ends[:, 1], tones=tone),
        Layer("line", f"limit {look}", horizontal[[0, 2]], vertical[[0, 2]], tones=tone),
    ]


def _box_layers(box: _Box, across: Axis, up: Axis) -> list[Layer]:
    """The rectangle of two intervals, over a whole axis for a value that is not known; arrows where one is a bound."""
    x, y = (
        ends or Ends(axis.low, 0.5 * (axis.low + axis.high), axis.high) for ends, axis in ((box.x, across), (box.y, up))
    )
    if x.side or y.side:
        arrows, limit = _bound_layers(x, y, across, up, box.look, None)
        return [replace(limit, look=box.look, name=box.name), arrows]
    corners = np.array([[x.low, y.low], [x.high, y.low], [x.high, y.high], [x.low, y.high]])
    return [Layer("region", box.look, corners[:, 0], corners[:, 1], box.name)]


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


def _all_curves(layers: Sequence[Layer], sizes: Floats, end: float, note: str) -> Panel:
    ordered = sorted(layers, key=lambda layer: layer.shape == "dots")  # areas below
    top = 1.06 * max([1.0, *(float(np.nanmax(layer.y)) for layer in ordered)])
    axes = Axis(f"t* = t √(p/ρ) / {RMAX}", -0.1, end), Axis(f"R / {RMAX}", 0.0, top)
    return Panel(*axes, tuple(ordered), note=sizes_in_words(sizes) + note)
