"""The plane of G and mu: the 90 % region of each shot, that of the material, and the values of other methods. Shots are
darker for smaller R_max, as in the picture of all curves. A bound is an arrow at its limit, never a point.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.parameters import VISCOSITY_AT_RATE
from cavirheo.posterior import Posterior, weighted_quantile
from cavirheo.reporting.documents import Pairs
from cavirheo.reporting.panels import MAX_DRAWN, Axis, Layer, Panel, all_curves_panel, tones_of
from cavirheo.reporting.record import GroupRecord, Result
from cavirheo.reporting.table import parameters_of
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

_REGION_SHARE = 0.9  # share of the draws in a region
_MIN_REGION_DRAWS = 10
_ARROW = 0.09  # length of an arrow, of that of its axis
_MARGIN = 0.07  # margin of an axis, of its length
_LEAST_DECADES = 0.4  # least length of an axis
_NAME = 14  # most letters of a name in a picture
_KEY = {"region": "shot", "region-out": "not counted", "estimate": "shot", "arrow": "bound"}  # name of the first one
_HEAD = np.array([[0.0, 0.0], [1.0, 0.0], [0.8, 0.12], [1.0, 0.0], [0.8, -0.12]])  # an arrow: along it, and across

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
        """(2, 2) ends of what is drawn on axes with these ends (2,): of a bound its limit; of an unknown value the
        whole axis."""
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
    """The plane of G and mu, unless the law has only one of them, and all curves, of the answered shots of a group.
    indices: of the group's curves in the result."""
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
    """(n, 2) corners of the ellipse that holds 90 % of the draws; None of a point answer, or of a value that is not
    among the draws."""
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
        beside = " beside" if place.corners is None else ""
        outside = "" if place.look == "region" else " outside"
        x, y = place.limits(low, high).mean(axis=1, keepdims=True)
        labels.append(Layer("label", f"shot-name{beside}{outside}", x, y, text=place.name))
    names = dict(_KEY)
    layers = [replace(layer, name=names.pop(layer.look.split()[0], "")) for layer in layers]
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
