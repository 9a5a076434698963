"""Measure the bubble's outline in one frame: find a covered patch, then measure it on rays to about 0.01 pixel.

On each ray the wall is where the coverage falls below one half. At constant wall speed this is the radius in the middle
of the exposure, whatever its length (Sieber et al. 2023, doi:10.1007/s00348-023-03732-6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, map_coordinates, uniform_filter

from cavirheo.arrays import Bools, Floats
from cavirheo.video.stage import Image, Stage

_RAY_COUNTS = (48, 300)  # fewest, most
_STEP = 0.5  # px along a ray
_TUKEY = 4.0  # scaled residual beyond which a point has no weight
_LEAST_AREA = 4  # pixels of a region that may be the bubble
WHOLE_ARC = 0.9  # share of the circle; an outline that shows more determines its own centre and shape
QUARTILE_WIDTH = 1.349  # distance between 25 % and 75 % of a Gaussian edge, over its sigma


@dataclass(frozen=True, eq=False)
class Patch:
    """A region that may be the bubble: area in pixels, circle (x, y, R) in px, median coverage near the edge."""

    area: float
    x: float
    y: float
    radius: float
    inside: float


@dataclass(frozen=True)
class Edge:
    """Properties of the profile across the wall, lengths in px. width: distance from 75 % to 25 %. lag: by how much the
    wall's mean over the exposure is outside the half level. light: radius of a disc that blocks as much light, NaN for
    large bubbles. contrast: coverage inside minus outside. arc: visible share of the circle.
    """

    width: float
    lag: float
    light: float
    contrast: float
    arc: float


_UNKNOWN = Edge(np.nan, np.nan, np.nan, np.nan, arc=0.0)


@dataclass(frozen=True, eq=False)
class Outline:
    """points: (k, 2) on the wall. radius, x, y: px. sigma: deviation of the radius by the fit alone, px. mode:
    amplitude of the second mode, px, NaN if too little of the circle is visible. inlier_share: of points that fit."""

    points: Floats
    radius: float
    x: float
    y: float
    sigma: float
    mode: float
    inlier_share: float
    edge: Edge


def patches(stage: Stage, i: int) -> list[Patch]:
    """Return the regions in frame i that may be the bubble, the largest first, at most four."""
    covered = np.nan_to_num(stage.covered(i))
    marks, _ = label((covered if stage.noise < 0.05 else uniform_filter(covered, 3)) > 0.5)
    areas = np.bincount(marks.ravel())[1:]
    order = np.argsort(areas)[::-1][:4]
    order = order[areas[order] >= _LEAST_AREA]
    if not len(order):
        return []
    spans = [marks == k + 1 for k in order]
    through = [bool(span[0].any() and span[-1].any()) or bool(span[:, 0].any() and span[:, -1].any()) for span in spans]
    if through[0] and any(through[1:]):  # of a bubble larger than the frame only the sides are visible
        sides = np.any([span for span, whole in zip(spans, through, strict=True) if whole], axis=0)
        spans = [sides, *(span for span, whole in zip(spans, through, strict=True) if not whole)]
    return [_patch(span, covered) for span in spans]


def _patch(mask: Bools, covered: Image) -> Patch:
    """Fit a circle through the first and last pixel of each row and column, so that a bright centre does not matter."""
    height, width = mask.shape
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    left, right = mask[rows].argmax(1), width - 1 - mask[rows, ::-1].argmax(1)
    top, bottom = mask[:, columns].argmax(0), height - 1 - mask[::-1, columns].argmax(0)
    x = np.concatenate([left - 0.5, right + 0.5, columns, columns])
    y = np.concatenate([rows, rows, top - 0.5, bottom + 0.5])
    inner = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1)
    area = float(mask.sum())
    x0, y0, radius = float(columns.mean()), float(rows.mean()), float(np.sqrt(area / np.pi))
    points = np.stack([x, y], axis=1)[inner]
    rough = fit_circle(points, (x0, y0), _UNKNOWN) if area > 30 and len(points) > 8 else None
    if rough:
        x0, y0, radius = rough.x, rough.y, rough.radius
    v, u = np.nonzero(mask)
    away = np.hypot(u - x0, v - y0)
    ring = (away > 0.55 * radius) & (away < 0.85 * radius)
    inside = float(np.median(covered[v[ring], u[ring]])) if ring.sum() > 20 else np.nan
    return Patch(area, x0, y0, radius, inside)


def measure(stage: Stage, i: int, rough: Patch) -> Outline | None:
    """Measure the outline near a rough circle in frame i; None if no wall is found."""
    x0, y0, radius, width = rough.x, rough.y, rough.radius, 2.0
    for _ in range(3):  # repeat if the edge is wider than assumed, or elsewhere
        span = float(np.clip(0.25 * radius + 2.0 * width, 6.0, 60.0))
        result = _trace_rays(stage, i, x0, y0, radius, span, width)
        if result is None:
            return None
        moved = np.hypot(result.x - x0, result.y - y0) + abs(result.radius - radius)
        settled = moved < 0.25 * span and result.edge.width < 0.4 * span
        x0, y0, radius, width = result.x, result.y, max(result.radius, 1.0), max(0.5, result.edge.width)
        if settled:
            break
    return result


def _trace_rays(stage: Stage, i: int, x0: float, y0: float, radius: float, span: float, width: float) -> Outline | None:
    count = int(np.clip(2 * np.pi * radius / 1.5, *_RAY_COUNTS))
    angles = np.arange(count) * (2 * np.pi / count)
    away = np.arange(max(radius - span, 0.25), radius + span, _STEP)
    size = radius + span + 2
    top, left = max(int(y0 - size), 0), max(int(x0 - size), 0)
    part = (slice(top, max(int(y0 + size) + 2, 0)), slice(left, max(int(x0 + size) + 2, 0)))
    if 0 in stage.reference[part].shape:
        return None
    covered = stage.covered(i, part)
    x = x0 - left + np.cos(angles)[:, None] * away
    y = y0 - top + np.sin(angles)[:, None] * away
    profiles = map_coordinates(covered, [y, x], order=1, mode="constant", cval=np.nan)
    inside_frame = np.isfinite(profiles)
    if inside_frame.mean() < 0.02:
        return None
    outer, inner = away > radius + 1.5 * width + 1.5, (away < radius - 1.5 * width - 1.0) & (away > 0.55 * radius)
    outside_level = _level(profiles[:, outer], 0.0)
    inside_level = _level(profiles[:, inner], 1.0) if radius > 8 and inner.sum() > 2 else 1.0
    contrast = inside_level - outside_level
    if contrast < 0.15:
        return None
    smooth = profiles if radius < 12 else (profiles + np.roll(profiles, 1, 0) + np.roll(profiles, -1, 0)) / 3
    wall, outside, within = (_crossings(smooth, away, outside_level + part * contrast) for part in (0.5, 0.25, 0.75))
    visible = np.isfinite(wall)
    if visible.sum() < 8:
        return None
    from_centre = wall[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = from_centre[visible] + [x0, y0]
    width = _median(outside - within, np.nan)
    lag = _lag(smooth, away, wall, outside_level, contrast, 1.2 * _median(outside - within, 2.0) + 1.5)[visible]
    light = np.nan
    if radius < 20 and inside_frame.mean() > 0.99:
        light = _light(covered, x0 - left, y0 - top, radius + 3 * width + 2.0, outside_level)
    edge = Edge(width, _median(lag, 0.0), light, contrast, float(visible.mean()))
    return fit_circle(points, (x0, y0), edge)


def _median(values: NDArray[np.floating], otherwise: float) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else otherwise


def _level(values: NDArray[np.floating], otherwise: float) -> float:
    """Return the mean of the values without outliers; the median alone would be a whole grey value."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return otherwise
    middle = np.median(finite)
    deviation = np.abs(finite - middle)
    return float(np.mean(finite[deviation <= 4.0 * np.median(deviation) + 0.02]))


def _crossings(profiles: NDArray[np.floating], distance: Floats, level: float) -> Floats:
    """Return (rays,) the largest distance at which a ray falls below the level; NaN if it does not."""
    above = profiles >= level
    falls = above[:, :-1] & (profiles[:, 1:] < level)
    last = falls.shape[1] - 1 - falls[:, ::-1].argmax(1)
    ray = np.arange(len(profiles))
    before, after = profiles[ray, last], profiles[ray, last + 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = distance[last] + (distance[1] - distance[0]) * (before - level) / (before - after)
    return np.where(falls.any(1), crossing, np.nan)


def _lag(
    profiles: NDArray[np.floating], distance: Floats, wall: Floats, outside_level: float, contrast: float, span: float
) -> Floats:
    """Return (rays,) by how much the wall's mean over the exposure is outside the half level, by the profile's area."""
    within = np.abs(distance - wall[:, None]) <= span
    begin = distance[within.argmax(1)] - _STEP / 2
    covered = np.where(within, (profiles - outside_level) / contrast, 0.0).sum(1) * _STEP
    return np.asarray(begin + covered - wall)


def _light(covered: Image, x: float, y: float, distance: float, outside_level: float) -> float:
    """Return the radius of the disc that blocks as much light."""
    v, u = np.ogrid[: covered.shape[0], : covered.shape[1]]
    within = (u - x) ** 2 + (v - y) ** 2 < distance**2
    missing = float(np.nansum(covered[within] - outside_level))
    return float(np.sqrt(max(missing, 0.0) / np.pi))


def fit_circle(points: Floats, centre: tuple[float, float], edge: Edge, sigma: float | None = None) -> Outline | None:
    """Fit a circle to points by distance, with the modes of its shape if nearly all of it is visible; None if it fails.
    sigma: deviation of `centre`, px, if that is known from other frames; None: `centre` is a first guess."""
    x, y = centre
    whole = edge.arc > WHOLE_ARC
    weight = np.ones(len(points))
    for turn in range(8):
        away = np.hypot(points[:, 0] - x, points[:, 1] - y)
        angle = np.arctan2(points[:, 1] - y, points[:, 0] - x)
        all_modes = turn > 1 and whole
        highest = (8 if np.median(away) >= 15 else 4 if np.median(away) >= 6 else 2) if all_modes else 1
        orders = np.arange(1, highest + 1)
        rows = np.hstack([np.ones((len(away), 1)), np.cos(angle[:, None] * orders), np.sin(angle[:, None] * orders)])
        root = np.sqrt(weight)
        scaled, targets = rows * root[:, None], away * root
        if sigma is not None:
            spread = max(1.4826 * float(np.median(np.abs(away - np.median(away)))), 0.1) / sigma
            pull = np.zeros((2, rows.shape[1]))
            pull[0, 1] = pull[1, 1 + highest] = spread
            offset = np.array([centre[0] - x, centre[1] - y])
            scaled, targets = np.vstack([scaled, pull]), np.append(targets, spread * offset)
        solution = np.linalg.lstsq(scaled, targets, rcond=None)[0]
        residual = away - rows @ solution
        scale = max(1.4826 * float(np.median(np.abs(residual))), 0.02)
        weight = np.clip(1.0 - (residual / (_TUKEY * scale)) ** 2, 0.0, None) ** 2
        if weight.sum() < 6:
            return None
        step = solution[1], solution[1 + highest]
        x, y = x + float(step[0]), y + float(step[1])
        if turn > 3 and np.hypot(*step) < 1e-3:
            break
    inliers = residual[weight > 0]
    rho = 0.0
    if len(inliers) > 4 and np.ptp(inliers):
        rho = float(np.clip(np.corrcoef(inliers[:-1], inliers[1:])[0, 1], 0.0, 0.95))
    effective = max(len(inliers) * (1 - rho) / (1 + rho) - rows.shape[1], 2.0)
    radius = float(solution[0])
    if not 0.3 < radius < 1e4:
        return None
    mode = float(np.hypot(solution[2], solution[2 + highest])) if highest > 1 else np.nan
    scatter = float(np.sqrt(np.mean(inliers**2) / effective))
    return Outline(points, radius, x, y, scatter, mode, float(len(inliers) / len(residual)), edge)
