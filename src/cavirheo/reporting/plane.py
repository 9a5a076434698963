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
from cavirheo.reporting.documents import MATERIAL_CONSTANTS, Pairs
from cavirheo.reporting.panels import MAX_DRAWN, Axis, Layer, Panel, all_curves_panel, tones_of
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.reporting.table import parameters_of
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread

_REGION_SHARE = 0.9  # share of the draws in a region
_MIN_REGION_DRAWS = 10
_ARROW = 0.09  # length of an arrow, of that of its axis
_MARGIN = 0.07  # margin of an axis, of its length
_LEAST_DECADES = 0.4  # least length of an axis
_NAME = 14  # most letters of a name in a picture
_KEY = {"region": "shot", "region-out": "not counted", "estimate": "shot", "arrow": "bound"}  # name of the first one
_HEAD = np.array([[0.0, 0.0], [1.0, 0.0], [0.8, 0.12], [1.0, 0.0], [0.8, -0.12]])  # an arrow: along it, and across


class _Parameter(NamedTuple):
    """What an axis of the plane shows: a parameter, its factor from SI, and its label."""

    name: str
    factor: float
    label: str

    def ends(self, value: Quantity) -> tuple[float, float]:
        """log10 of the ends of a value; infinite where there is no limit."""
        if value.is_zero:
            return -np.inf, -np.inf
        low = None if value.bound in ("upper", "undetermined") else value.q05 or value.median
        high = None if value.bound in ("lower", "undetermined") else value.q95 or value.median
        return (np.log10(self.factor * low) if low else -np.inf), (np.log10(self.factor * high) if high else np.inf)


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
    def known(self) -> np.ndarray:
        """(2,) whether anything is known of G and of mu."""
        return np.isfinite(self.ends).any(axis=1) | (self.ends[:, 0] == self.ends[:, 1])

    @property
    def sides(self) -> np.ndarray:
        """(2,) -1 of an upper bound, 1 of a lower one, else 0."""
        return np.isposinf(self.ends[:, 1]).astype(int) - np.isneginf(self.ends[:, 0])


def group_panels(pairs: Pairs, result: Result, group: GroupRecord, indices: Sequence[int]) -> list[Panel]:
    """The plane of G and mu, unless the law has only one of them, and all curves, of the answered shots of a group.
    indices: of the group's curves in the result."""
    names = dict(zip(indices, digits.short_names([result.curves[i].name for i in indices], _NAME), strict=True))
    members = [i for i in indices if result.curves[i].has_answer]
    chosen = members[:: max(-(-len(members) // MAX_DRAWN), 1)]
    rows = [result.curves[i] for i in chosen]
    end = 1.1 * max([row.window.t_star_end or 1.0 for row in rows])
    curves = all_curves_panel([(pairs[i][0], pairs[i][1].checks) for i in members], end)
    axes = _axes(rows, result.modulus_unit)
    if len(axes) < 2:
        return [curves]
    tones = tones_of(np.array([row.max_radius_m or np.nan for row in rows])).tolist()
    shots = []
    for i, row, tone in zip(chosen, rows, tones, strict=True):
        ends = np.array([axis.ends(row.value(axis.name)) for axis in axes])
        corners = _region(pairs[i][1], axes) if np.all(np.isfinite(ends)) else None
        look = "region" if row.trusted else "region-out"
        shots.append(_Place(look, names[i], ends, corners, tone))
    return [_plane([shot for shot in shots if shot.known.all()], _references(group, axes), axes), curves]


def _axes(rows: Sequence[CurveRecord], unit: tuple[float, str]) -> list[_Parameter]:
    known = parameters_of(rows)
    upper = next((name for name in MATERIAL_CONSTANTS[:2] if name in known), "")
    axes = []
    for name in ("shear_modulus", upper):
        if name in known:
            symbol, factor, written = digits.display_unit(name, unit)
            axes.append(_Parameter(name, factor, f"{symbol} ({written})"))
    return axes


def _region(answer: Posterior, axes: Sequence[_Parameter]) -> Floats | None:
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


def _references(group: GroupRecord, axes: Sequence[_Parameter]) -> list[_Place]:
    """The material and the values of other methods, where one of two values is known."""
    places = list[_Place]()
    if group.population.has_material and not group.population.heaps:
        ends = np.array([axis.ends(group.value(axis.name)) for axis in axes])
        places.append(_Place("material", "material", ends))
    for method, values in group.published.items():
        ends = np.array([axis.ends(_within_deviation(values.get(axis.name, Spread()))) for axis in axes])
        places.append(_Place("published", digits.elide(method.partition(",")[0], _NAME), ends))
    return [place for place in places if place.known.any()]


def _within_deviation(value: Spread) -> Quantity:
    """Mean ± standard deviation."""
    if value.mean is None:
        return Quantity()
    std = value.std or 0.0
    return Quantity(median=value.mean, q05=max(value.mean - std, 0.1 * value.mean), q95=value.mean + std)


def _plane(shots: Sequence[_Place], references: Sequence[_Place], axes: Sequence[_Parameter]) -> Panel:
    across, up = (_axis(axis.label, k, [*shots, *references]) for k, axis in enumerate(axes))
    low, high = np.array([[across.low, up.low], [across.high, up.high]])
    layers, labels = list[Layer](), list[Layer]()
    for place in shots:
        layers += _layers(place, low, high)
        beside = " beside" if place.corners is None else ""
        outside = "" if place.look == "region" else " outside"
        x, y = _limits(place, low, high).mean(axis=1, keepdims=True)
        labels.append(Layer("labels", f"shot-name{beside}{outside}", x, y, texts=(place.name,)))
    names = dict(_KEY)
    layers = [replace(layer, name=names.pop(layer.look.split()[0], "")) for layer in layers]
    for place in references:
        first, *arrows = _layers(place, low, high)
        layers += [replace(first, name=place.name), *arrows]
    title = f"{up.label} over {across.label}: the 90 % region of each shot, and that of the material"
    return Panel(across, up, (*layers, *labels), title)


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


def _limits(place: _Place, low: Floats, high: Floats) -> Floats:
    """(2, 2) ends of what is drawn of a place on axes with these ends (2,): of a bound its limit; of an unknown value
    the whole axis."""
    lower, upper = np.clip(place.ends, low[:, None], high[:, None]).T
    return np.column_stack([np.where(place.sides < 0, upper, lower), np.where(place.sides > 0, lower, upper)])


def _layers(place: _Place, low: Floats, high: Floats) -> list[Layer]:
    """The region of a place; a point of one without intervals; of a bound an arrow from its limit into what it allows,
    and the interval of the other value at the limit."""
    tone = None if place.look == "region-out" else place.tone
    x, y = _limits(place, low, high)
    if place.sides.any():
        layers = [Layer("line", f"limit {place.look}", x, y, tone=tone)]
        for k in np.flatnonzero(place.sides):
            along, up = (place.sides[k] * _ARROW * np.roll(_HEAD, k, axis=1) * (high - low)).T
            layers.append(Layer("line", f"arrow {place.look}", x.mean() + along, y.mean() + up, tone=tone))
        return layers
    if place.corners is not None:
        return [Layer("area", place.look, place.corners[:, 0], place.corners[:, 1], tone=tone)]
    if x[0] == x[1] and y[0] == y[1]:
        return [Layer("dots", "estimate", x[:1], y[:1], tone=place.tone)]
    return [Layer("area", place.look, x[[0, 1, 1, 0]], y[[0, 0, 1, 1]], tone=tone)]
