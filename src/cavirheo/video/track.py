"""Follow one bubble through all frames: its radius history, each radius with its deviation and a flag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.landmarks import collapse_time, spikes
from cavirheo.video import outline
from cavirheo.video.outline import QUARTILE_WIDTH, WHOLE_ARC, Outline, Patch
from cavirheo.video.stage import Stage, with_refined_background

FLAGS = {  # flag of a frame: its meaning
    "ok": "measured",
    "small": "measured by the light that is missing: too small for an outline",
    "arc": "measured on a short arc, with the centre of other frames",
    "reversal": "the wall turns within the exposure: an uncertain mean of what it blurs",
    "faint": "less contrast than in other frames",
    "poor": "the outline is no circle, or too little of it fits",
    "elsewhere": "something dark, but not where the bubble was",
    "lost": "no bubble is found, or the frame is damaged",
    "spike": "far larger than before and after",
    "flash": "overexposed",
    "dark": "hardly any light",
    "before": "before the bubble",
    "excluded": "left out by hand",
}
USED = ("ok", "small", "arc", "reversal")  # flags of frames whose radius is used


class Rules:
    """The thresholds and factors of this module. Lengths are in px if not stated otherwise; deviations are of radii."""

    small_radius: float = 4.0  # radius below which the missing light is measured, not the outline
    calibration_radii: tuple[float, float] = (5.0, 15.0)  # radii between which both are measured, for calibration
    short_arc: float = 0.25  # share of the circle, below which an arc is short
    faint_contrast: float = 0.5  # of the usual contrast, below which a frame is faint
    least_inlier_share: float = 0.5  # share of the points that must be near the circle
    centre_motion: float = 12.0  # largest motion of the centre, in addition to half the radius
    neighbour_count: int = 15  # number of fully visible outlines that give a partly visible one its centre
    largest_gap: int = 1  # frames without a bubble that may be crossed on the way back to its beginning
    spike_share: float = 0.1  # of the largest radius, by which a spike exceeds both neighbours
    reversal_swing: float = 0.2  # change of the radius within half an exposure that a reversal must exceed
    reversal_time_error: float = 0.25  # uncertainty of the time of a reversal, in frames
    interpolation_variance: float = 0.065  # px^2, part of the edge's variance by interpolation, which moves no level
    scatter_factor: float = 1.6  # factor on the deviation of the fit, as neighbouring rays share their noise
    per_width: float = 0.0005  # deviation over the edge's width
    per_lag: float = 0.1  # deviation over the correction for the motion within the exposure
    blur_range: tuple[float, float] = (1.1, 1.4)  # width over that at rest, where the correction begins and is full
    per_curvature: float = 1.5  # deviation over the next order of the correction for a curved edge
    per_reversal: float = 0.15  # deviation in a reversal over the edge's width
    least_twin: float = 0.1  # largest area of a second bubble over that of the bubble; a smaller one is a mark or dust
    floor: float = 0.002  # smallest deviation
    small_share: float = 0.02  # deviation of a small bubble's radius over the radius
    systematic_width: float = 0.02  # systematic deviation over the edge's width


@dataclass(frozen=True, eq=False)
class Track:
    """The history of one bubble. Arrays (n,), lengths in px, NaN if not measured: radius, its deviation `sigma`, the
    deviation `systematic` common to all frames, centre x and y, asphericity (second mode over the radius), width of the
    edge, visible share `arc` of the circle. flags: keys of `FLAGS`.

    optics: sigma of the blur at rest, px. twins: number of used frames with a second bubble of more than half the area.
    """

    radius: Floats
    sigma: Floats
    systematic: Floats
    x: Floats
    y: Floats
    asphericity: Floats
    width: Floats
    arc: Floats
    flags: NDArray[np.str_]
    optics: float
    twins: int = 0


def follow(stage: Stage, exposure: float = 1.0, advance: Callable[[], None] = lambda: None) -> Track:
    """Follow the bubble through all frames. exposure: in frames. advance: called after each frame.

    Raises InputError: no bubble.
    """
    n = len(stage.frames)
    patches_of = {i: outline.patches(stage, i) for i in map(int, np.flatnonzero(stage.kinds == ""))}
    chosen, _ = _one_bubble(patches_of, n)
    levels = [patch.inside for patch in chosen.values() if patch.radius > 10 and np.isfinite(patch.inside)]
    stage = with_refined_background(stage, {i: (patch.x, patch.y, patch.radius) for i, patch in chosen.items()})
    if levels:
        stage = replace(stage, depth=stage.depth * float(np.median(levels)))
    patches_of = {i: patches or outline.patches(stage, i) for i, patches in patches_of.items()}
    chosen, elsewhere = _one_bubble(patches_of, n)
    others = {i: [patch.area for patch in patches_of[i] if patch is not bubble] for i, bubble in chosen.items()}
    areas = {i: max(each, default=0.0) for i, each in others.items()}
    twins = [i for i, area in areas.items() if area > 0.5 * chosen[i].area > 25.0]
    full_size = max(bubble.area for bubble in chosen.values())
    if max((areas[i] for i in twins), default=0.0) < Rules.least_twin * full_size:
        twins = []
    outlines: dict[int, Outline] = {}
    for i, patch in chosen.items():
        if measured := outline.measure(stage, i, patch):
            outlines[i] = measured
        advance()
    require(bool(outlines), _NO_BUBBLE, "video.no_bubble")
    return _corrected_and_flagged(stage, _centred(outlines), elsewhere, exposure, twins)


_NO_BUBBLE = "no bubble is found in any frame; name its place with --roi x,y,w,h, or --polarity dark or bright"


def _one_bubble(patches_of: dict[int, list[Patch]], n: int) -> tuple[dict[int, Patch], set[int]]:
    """Return (the bubble's patch by frame, frames with patches elsewhere), from the largest patch on both ways."""
    largest = max(patches_of, key=lambda i: max((patch.area for patch in patches_of[i]), default=0.0))
    require(bool(patches_of[largest]), _NO_BUBBLE, "video.no_bubble")
    peak, chosen, elsewhere = patches_of[largest][0], {}, set()
    for frames in (range(largest, n), range(largest - 1, -1, -1)):
        last, missed = peak, 0
        for i in frames:
            distances = [(patch, hypot(patch.x - last.x, patch.y - last.y)) for patch in patches_of.get(i, ())]
            candidates = [(p, d) for p, d in distances if d < Rules.centre_motion + 0.5 * max(p.radius, last.radius)]
            if candidates:
                (last, _), missed = max(candidates, key=lambda pair: pair[0].area / (1.0 + (pair[1] / 10.0) ** 2)), 0
                chosen[i] = last
            elif i in patches_of:
                missed += 1
                if patches_of[i]:
                    elsewhere.add(i)
                if frames.step < 0 and missed > Rules.largest_gap:
                    break
    return dict(sorted(chosen.items())), elsewhere


def _centred(outlines: dict[int, Outline]) -> dict[int, Outline]:
    """Fit partly visible outlines again, with the centre of fully visible outlines in near frames."""
    whole = [i for i, fit in outlines.items() if fit.edge.arc > WHOLE_ARC]
    whole = whole or sorted(outlines, key=lambda i: -outlines[i].edge.arc)[:5]

    def centred(i: int, fit: Outline) -> Outline:
        if fit.edge.arc > WHOLE_ARC:
            return fit
        neighbours = [outlines[k] for k in sorted(whole, key=lambda k: abs(k - i))[: Rules.neighbour_count]]
        weight = np.array([1.0 / max(each.sigma, 0.02) for each in neighbours])
        centres = np.array([(each.x, each.y) for each in neighbours])
        x, y = map(float, np.quantile(centres, 0.5, axis=0, method="inverted_cdf", weights=weight))
        spread = 1.4826 * float(np.median([hypot(*away) for away in centres - (x, y)])) + 0.3
        return outline.fit_circle(fit.points, (x, y), fit.edge, spread) or fit

    return {i: centred(i, fit) for i, fit in outlines.items()}


def _corrected_and_flagged(
    stage: Stage, outlines: dict[int, Outline], elsewhere: set[int], exposure: float, twins: list[int]
) -> Track:
    """Return the radii of the outlines, corrected for blur, with deviations and flags. twins: frames of two bubbles."""
    n, index = len(stage.frames), list(outlines)
    values = np.full((11, n), np.nan)
    for i, fit in outlines.items():
        values[:, i] = fit.radius, fit.sigma, fit.x, fit.y, fit.mode, fit.inlier_share, *astuple(fit.edge)
    radius, sigma, x, y, mode, inlier_share, width, lag, light, contrast, arc = values
    sharp = (arc > 0.5) & (radius > 8.0) & (width > 0.0)
    optics = float(np.percentile(width[sharp], 20)) / QUARTILE_WIDTH if sharp.any() else 1.0
    blurred = np.interp(width / (QUARTILE_WIDTH * optics), Rules.blur_range, (0.0, 1.0))
    still = lag[blurred == 0.0]
    motion = np.nan_to_num((lag - (np.median(still) if len(still) > 2 else 0.0)) * blurred)
    # A disc of radius R with blur sigma has its half level at that r for which Rice(r, sigma) has the median R.
    curvature = np.minimum(optics**2 - Rules.interpolation_variance, 0.1 * radius**2)
    radius = np.sqrt(radius**2 + curvature) + motion
    both = (radius > Rules.calibration_radii[0]) & (radius < Rules.calibration_radii[1]) & (light > 0.0)
    light_factor = float(np.median(radius[both] / light[both])) if both.sum() > 4 else 1.0
    small = (radius < Rules.small_radius) & (light > 0.0)
    radius = np.where(small, light_factor * light, radius)
    radius[~(radius > 0.0)] = np.nan
    parts = (
        Rules.scatter_factor * sigma,
        Rules.per_width * width,
        Rules.per_lag * motion,
        Rules.small_share * radius * small,
        Rules.per_curvature * optics**4 / np.maximum(radius, optics) ** 3 * ~small,
    )
    sigma = np.sqrt(Rules.floor**2 + sum(part**2 for part in parts))
    flags = stage.kinds.astype("U12")
    flags[flags == ""] = "lost"
    flags[[i for i in elsewhere if i not in outlines]] = "elsewhere"
    flags[index] = "ok"
    flags[small] = "small"
    flags[arc < Rules.short_arc] = "arc"
    flags[(inlier_share < Rules.least_inlier_share) | (sigma > np.maximum(0.05 * radius, 0.3))] = "poor"
    flags[contrast < Rules.faint_contrast * float(np.nanmedian(contrast))] = "faint"
    measured = np.flatnonzero(np.isfinite(radius) & np.isin(flags, USED))
    high = spikes(radius[measured], Rules.spike_share * float(np.max(radius[measured], initial=0.0)))
    flags[measured[high]] = "spike"
    turned = _reversals(np.where(np.isin(flags, USED), radius, np.nan), exposure)
    flags[turned] = "reversal"
    sigma[turned] = np.hypot(sigma[turned], Rules.per_reversal * width[turned])
    require(bool(np.any(flags == "ok")), _NO_BUBBLE, "video.no_bubble")
    early = np.arange(n) < int(np.argmax(flags == "ok"))
    flags[early & ~np.isin(flags, ("flash", "dark", "excluded"))] = "before"
    used = np.isin(flags, USED)
    systematic = np.hypot(Rules.systematic_width * width, np.nan_to_num(mode) / 6.0)
    columns = np.where(used, (radius, sigma, systematic, x, y, mode / radius, width, arc), np.nan)
    return Track(*columns, flags, optics, int(used[twins].sum()))  # type: ignore[call-arg]


def _reversals(radius: Floats, exposure: float) -> list[int]:
    """Return the frames in whose exposure the wall turns fast enough to matter."""
    turned = []
    measured = [int(i) for i in np.flatnonzero(np.isfinite(radius))]
    for k in range(1, len(measured) - 1):
        before, i, after = measured[k - 1], measured[k], measured[k + 1]
        if radius[i] > min(radius[before], radius[after]) or after - before > 4:
            continue
        speed = max((radius[before] - radius[i]) / (i - before), (radius[after] - radius[i]) / (after - i))
        turn = _reversal_time(radius, measured, k)
        near_turn = [abs(j - turn) < exposure / 2 + Rules.reversal_time_error for j in (before, i, after)]
        if speed * exposure / 2 > Rules.reversal_swing:
            turned += [j for j, within in zip((before, i, after), near_turn, strict=True) if within]
    return turned


def _reversal_time(radius: Floats, measured: list[int], k: int) -> float:
    """Return when (in frames) the wall turns near frame measured[k], the smallest: midway between the minimum of the
    parabola through three frames (a gentle turn) and the point where the branches of R^(5/2), straight in a collapse,
    meet; with too few frames, that minimum."""
    before, i, after = measured[k - 1 : k + 2]
    falls, rises = (radius[before] - radius[i]) / (i - before), (radius[after] - radius[i]) / (after - i)
    lowest = i + 0.5 * (falls - rises) / max(falls + rises, 1e-9)
    five = measured[k - 2 : k + 3]
    if k < 2 or len(five) < 5:
        return lowest
    return (lowest + collapse_time(np.array(five, float), radius[five], 2)) / 2
