"""The plane of G and mu: the 90 % region of each shot, that of the material, and the values of other methods. Shots are
darker for smaller R_max, as in the picture of all curves. A bound is an arrow at its limit, never a point.
"""

from __future__ import annotations

from collections.abc import Sequence
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
_NOWHERE = np.array([[-np.inf, np.inf], [-np.inf, np.inf]])


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


class _Quantity(NamedTuple):
    """What an axis of the plane shows: a parameter or _SIZE, its factor from SI, and its label."""

    name: str
    factor: float
    label: str

    def ends(self, record: CurveRecord | GroupRecord) -> tuple[float, float]:
        """(low, high) of a shot, or of the material of a group."""
        if self.name == _SIZE:
            return _log_ends(Quantity(median=getattr(record, "max_radius_m", None)), self.factor)
        return _log_ends(record.value(self.name), self.factor)

    def ends_of_method(self, value: Spread) -> tuple[float, float]:
        """Mean ± standard deviation by another method."""
        mean, std = value.mean or 0.0, value.std or 0.0
        return _log_ends(Quantity(median=value.mean, q05=max(mean - std, 0.1 * mean), q95=mean + std), self.factor)


def _log_ends(value: Quantity, factor: float) -> tuple[float, float]:
    """log10 of the ends of a value; infinite where there is no limit."""
    ends = [value.median if end is None else end for end in (value.q05, value.q95)]
    if value.bound in ("upper", "undetermined"):
        ends[0] = None
    if value.bound in ("lower", "undetermined"):
        ends[1] = None
    low, high = ends
    if value.is_zero:
        return -np.inf, -np.inf
    return (np.log10(factor * low) if low else -np.inf), (np.log10(factor * high) if high else np.inf)


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, and all curves, of the answered shots of a group. indices: of the group's curves in the
    result. A law without a modulus has R_max in its place."""
    names = dict(zip(indices, digits.distinct_names([result.curves[i].name for i in indices]), strict=True))
    members = [i for i in indices if result.curves[i].has_answer]
    chosen = members[:: max(-(-len(members) // MAX_DRAWN), 1)]
    records = [result.curves[i] for i in chosen]
    axes = _axes(records, result.modulus_unit)
    tones = tones_of(np.array([record.max_radius_m or np.nan for record in records]))
    shots = []
    for i, record, tone in zip(chosen, records, tones.tolist(), strict=True):
        look, ends = "region" if record.trusted else "region-out", np.array([axis.ends(record) for axis in axes])
        corners = _region(pairs[i][1], axes) if np.all(np.isfinite(ends)) else None
        shots.append(_Place(look, digits.elide(names[i], _NAME), ends, corners, tone))
    end = 1.1 * max([record.window.t_star_end or 1.0 for record in records])
    curves = all_curves_panel([(pairs[i][0], pairs[i][1].checks) for i in members], end)
    return [_plane(shots, _references(group, axes), axes), curves]


def _axes(records: Sequence[CurveRecord], unit: Unit) -> tuple[_Quantity, _Quantity]:
    of_laws = parameters_of(records)
    upper = next((name for name in MATERIAL_CONSTANTS if name in of_laws), of_laws[0])
    axes = []
    for name in ("shear_modulus", upper):
        symbol, factor, written = display_unit(name, unit)
        axes.append(_Quantity(name, factor, f"{symbol} ({written})" if written else symbol))
    if "shear_modulus" not in of_laws or upper == "shear_modulus":
        axes[0] = _Quantity(_SIZE, 1e6, f"{RMAX} (µm)")
    return axes[0], axes[1]


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


def _references(group: GroupRecord, axes: tuple[_Quantity, _Quantity]) -> list[_Place]:
    """The material and the values of other methods, where one of two values is known."""
    places = list[_Place]()
    if group.material and not group.material.heaps:
        places.append(_Place("material", "material", np.array([axis.ends(group) for axis in axes])))
    for method, values in group.published.items():
        ends = np.array([axis.ends_of_method(values.get(axis.name, Spread())) for axis in axes])
        places.append(_Place("published", digits.elide(method, _NAME), ends))
    return [place for place in places if np.any(place.ends != _NOWHERE)]


def _plane(shots: Sequence[_Place], references: Sequence[_Place], axes: Sequence[_Quantity]) -> Panel:
    shots = [place for place in shots if np.all(np.any(place.ends != _NOWHERE, axis=1))]  # both are known
    across, up = (_axis(axis.label, k, [*shots, *references]) for k, axis in enumerate(axes))
    layers, labels, key = list[Layer](), list[Layer](), dict(_KEY)
    for place in shots:
        layers += [replace(layer, name=key.pop(layer.look, "")) for layer in _layers(place, across, up, is_shot=True)]
        at = [np.array([middle]) for middle in _limits(place, across, up).mean(axis=1)]
        beside = " beside" if place.corners is None else ""
        look = f"shot-name{beside}{'' if place.look == 'region' else ' outside'}"
        labels.append(Layer("labels", look, at[0], at[1], texts=(place.name,)))
    for place in references:
        layers += _layers(place, across, up)
    return Panel(across, up, (*layers, *labels))


def _axis(label: str, k: int, places: Sequence[_Place]) -> Axis:
    """A logarithmic axis around these places: the first or the second one of the plane."""
    ends = [place.ends[k] for place in places]
    ends += [place.corners[:, k] for place in places if place.corners is not None]
    limits = np.concatenate([*ends, [np.inf]])
    limits = limits[np.isfinite(limits)]
    low, high = (float(limits.min()), float(limits.max())) if len(limits) else (0.0, 0.0)
    missing = 0.5 * max(_LEAST_DECADES - (high - low), 0.0)
    margin = missing + (_MARGIN + _ARROW) * (high - low + 2.0 * missing)
    return Axis(label, low - margin, high + margin, log=True)


def _sides(place: _Place) -> list[int]:
    """Of each value: -1 of an upper bound, 1 of a lower one, else 0."""
    return [int(np.isposinf(high)) - int(np.isneginf(low)) for low, high in place.ends]


def _limits(place: _Place, across: Axis, up: Axis) -> Floats:
    """(2, 2) ends of what is drawn of a place: of a bound its limit, of an unknown value the whole axis."""
    limits = np.clip(place.ends, [[across.low], [up.low]], [[across.high], [up.high]])
    for k, side in enumerate(_sides(place)):
        if side:
            limits[k] = limits[k, 1 if side < 0 else 0]
    return np.asarray(limits)


def _layers(place: _Place, across: Axis, up: Axis, *, is_shot: bool = False) -> list[Layer]:
    """The region of a place; a point of one without intervals; of a bound an arrow from its limit into what it allows,
    and the interval of the other value at the limit."""
    tone, name = None if place.look == "region-out" else place.tone, "" if is_shot else place.name
    limits = _limits(place, across, up)
    (left, right), (low, high) = limits
    sides = _sides(place)
    if any(sides):
        begin = limits.mean(axis=1)
        lengths = _ARROW * np.array([across.high - across.low, up.high - up.low])
        steps = np.diag(sides * lengths)[np.flatnonzero(sides)]  # an arrow for each bound
        arrows_x, arrows_y = (np.column_stack([begin[k] + 0.0 * steps[:, k], begin[k] + steps[:, k]]) for k in (0, 1))
        return [
            Layer("line", f"limit {place.look}" if is_shot else place.look, limits[0], limits[1], name, tone),
            Layer("arrows", f"arrow {place.look}", arrows_x, arrows_y, "", tone),
        ]
    if place.corners is None and is_shot and left == right and low == high:
        return [Layer("dots", "estimate", np.array([left]), np.array([low]), tone=place.tone)]
    rectangle = np.array([[left, low], [right, low], [right, high], [left, high]])
    corners = rectangle if place.corners is None else place.corners
    return [Layer("region", place.look, corners[:, 0], corners[:, 1], name, tone)]
