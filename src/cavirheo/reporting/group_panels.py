"""The two panels of a group: the plane of G and mu with the 90 % region of each shot and that of the material; and all
curves, R/R_max over t*, with what their answers predict. Both have the same colours, darker for smaller R_max.

A bound is an arrow at its limit, never a point.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.posterior import Posterior, weighted_quantile
from cavirheo.reporting.answer import CurveRecord, Unit, display_unit, parameters_of
from cavirheo.reporting.group import MATERIAL_CONSTANTS, GroupRecord
from cavirheo.reporting.panels import MAX_DRAWN, RMAX, Axis, Layer, Panel, all_curves_panel, tones_of
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread

_SIZE = "R_max"  # used instead of the name of a parameter
_REGION_SHARE = 0.9  # share of the draws in a region
_MIN_REGION_DRAWS = 10
_ARROW = 0.09  # length of an arrow, of that of its axis
_MARGIN = 0.07  # margin of an axis, of its length
_LEAST_DECADES = 0.4  # least length of an axis
_NAME = 14  # most letters of a name in a picture
_KEY = {"region": "shot", "region-out": "not counted", "estimate": "shot"}  # name of the first of each look


class Ends(NamedTuple):
    """A value on a logarithmic axis: ends and middle, log10 of the unit of the axis. side: -1, it is below `high`; 1,
    it is above `low`; 0, it lies between them."""

    low: float
    middle: float
    high: float
    side: int = 0


class _Place(NamedTuple):
    """A shot, the material or the value of another method in the plane; None for a value that is not known.

    region: (n, 2) corners; None: the rectangle of the two intervals."""

    look: str
    name: str
    x: Ends | None
    y: Ends | None
    region: Floats | None = None
    tone: float | None = None


class _Quantity(NamedTuple):
    """What an axis of the plane shows: a parameter or _SIZE, its factor from SI, and its label."""

    name: str
    factor: float
    label: str

    def ends(self, record: CurveRecord | GroupRecord) -> Ends | None:
        """The value of a shot, or of the material of a group, on this axis."""
        if self.name == _SIZE:
            return ends_of(Quantity(median=getattr(record, "max_radius_m", None)), self.factor)
        return ends_of(record.value(self.name), self.factor)

    def ends_of_method(self, value: Spread) -> Ends | None:
        """Mean and standard deviation by another method."""
        mean, std = value.mean or 0.0, value.std or 0.0
        return ends_of(Quantity.from_interval(max(mean - std, 0.1 * mean), mean, mean + std), self.factor)

    def axis(self, ends: Iterable[Ends | None], regions: Iterable[Floats]) -> Axis:
        """A logarithmic axis around these values, and these places of the corners of regions."""
        limits = [end for value in ends if value for end in (value.low, value.high)]
        limits += [end for places in regions for end in (places.min(), places.max())]
        finite = [end for end in limits if np.isfinite(end)] or [0.0]
        low, high = float(min(finite)), float(max(finite))
        missing = 0.5 * max(_LEAST_DECADES - (high - low), 0.0)
        margin = missing + (_MARGIN + _ARROW) * (high - low + 2.0 * missing)
        return Axis(self.label, low - margin, high + margin, log=True)


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, and all curves, of the answered shots of a group. indices: of the group's curves in the
    result. A law without a modulus has R_max in its place."""
    names = dict(zip(indices, digits.distinct_names([result.curves[i].name for i in indices]), strict=True))
    members = [i for i in indices if result.curves[i].has_answer]
    drawn = members[:: max(-(-len(members) // MAX_DRAWN), 1)]
    records = [result.curves[i] for i in drawn]
    x, y = axes = _axes(records, result.modulus_unit)
    tones = tones_of(np.array([record.max_radius_m or np.nan for record in records]))
    places = []
    for i, record, tone in zip(drawn, records, tones.tolist(), strict=True):
        look = "region" if record.trusted else "region-out"
        ends = x.ends(record), y.ends(record)
        bounded = any(end is not None and end.side for end in ends)
        region = None if bounded else _region(pairs[i][1], axes)
        places.append(_Place(look, "", *ends, region, tone))
    end = 1.1 * max([record.window.t_star_end or 1.0 for record in records])
    curves = all_curves_panel([(pairs[i][0], pairs[i][1].checks) for i in members], end)
    return [_plane(places, _others(group, axes), axes, [names[i] for i in drawn]), curves]


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
    """(n, 2) corners of the ellipse that holds 90 % of the draws; None of a point answer, or of a value that is not
    among the draws."""
    if not {axis.name for axis in axes} <= set(answer.parameters):
        return None
    values = np.stack([answer.draws(axis.name) * axis.factor for axis in axes], axis=-1)
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


def _others(group: GroupRecord, axes: tuple[_Quantity, _Quantity]) -> list[_Place]:
    """The material and the values of other methods, where one of two values is known."""
    x, y = axes
    places = list[_Place]()
    if group.material and not group.material.heaps:
        places.append(_Place("material", "material", x.ends(group), y.ends(group)))
    for method, values in group.published.items():
        a, b = (axis.ends_of_method(values.get(axis.name, Spread())) for axis in axes)
        places.append(_Place("published", digits.elide(method, _NAME), a, b))
    return [place for place in places if place.x or place.y]


def _plane(
    shots: Sequence[_Place], others: Sequence[_Place], axes: tuple[_Quantity, _Quantity], names: Sequence[str]
) -> Panel:
    regions = [place.region for place in shots if place.region is not None]
    across = axes[0].axis((place.x for place in (*shots, *others)), (region[:, 0] for region in regions))
    up = axes[1].axis((place.y for place in (*shots, *others)), (region[:, 1] for region in regions))
    layers, labels, key = list[Layer](), list[Layer](), dict(_KEY)
    for place, name in zip(shots, names, strict=True):
        if place.x and place.y:
            layers += _layers(place, across, up)
            at = np.clip([place.x.middle], across.low, across.high), np.clip([place.y.middle], up.low, up.high)
            beside = " beside" if place.region is None else ""
            look = f"shot-name{beside}{'' if place.look == 'region' else ' outside'}"
            labels.append(Layer("labels", look, *at, texts=(digits.elide(name, _NAME),)))
    layers = [replace(layer, name=key.pop(layer.look, "")) for layer in layers]
    for place in others:
        layers += _layers(place, across, up)
    return Panel(across, up, (*layers, *labels))


def _layers(place: _Place, across: Axis, up: Axis) -> list[Layer]:
    """The region of a place, over a whole axis for a value that is not known; a point of one without intervals; of a
    bound an arrow from its limit into what it allows, and the interval of the other value at the limit."""
    tone = None if place.look == "region-out" else place.tone
    x = place.x or Ends(across.low, 0.5 * (across.low + across.high), across.high)
    y = place.y or Ends(up.low, 0.5 * (up.low + up.high), up.high)
    if x.side or y.side:
        horizontal, vertical = np.clip(x[:3], across.low, across.high), np.clip(y[:3], up.low, up.high)
        sides = np.array([side for side in ((x.side, 0), (0, y.side)) if any(side)], dtype=float)
        steps = _ARROW * sides * [across.high - across.low, up.high - up.low]
        from_x, from_y = horizontal[1] + 0.0 * sides[:, 0], vertical[1] + 0.0 * sides[:, 0]
        arrows_x = np.column_stack([from_x, from_x + steps[:, 0]])
        arrows_y = np.column_stack([from_y, from_y + steps[:, 1]])
        look = place.look if place.name else f"limit {place.look}"
        return [
            Layer("line", look, horizontal[[0, 2]], vertical[[0, 2]], place.name, tone),
            Layer("arrows", f"arrow {place.look}", arrows_x, arrows_y, "", tone),
        ]
    if place.region is not None:
        corners = place.region
    elif not place.name and x.low == x.high and y.low == y.high:
        return [Layer("dots", "estimate", np.array([x.middle]), np.array([y.middle]), tone=place.tone)]
    else:
        corners = np.array([[x.low, y.low], [x.high, y.low], [x.high, y.high], [x.low, y.high]])
    return [Layer("region", place.look, corners[:, 0], corners[:, 1], place.name, tone)]
