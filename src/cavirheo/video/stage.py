"""Find in a recording the unusable frames, the background, and how dark the bubble is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes, binary_opening

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, require
from cavirheo.video.formats import Footage, Pixels

POLARITIES = ("auto", "dark", "bright")
_PIXELS_SAMPLED = 4000  # pixels of a frame that are used to classify it
_MOST_SAMPLED = 20_000_000  # most such pixels in all frames
_FLASH = 1.25  # of the usual brightness; in a flash the darkest quarter of the frame is above it
_SATURATED = 0.3  # share of saturated pixels, above which a frame is a flash
_DARK = 0.5  # of the usual brightness at the border; a dark frame is below it
_OPAQUE = 0.3  # of the usual brightness; pixels of the background below it are not used (a wall, dust)
_DISTURBANCE = 5.0  # noise deviations from the first background, beyond which a pixel is disturbed
_LEAST_CONTRAST = 4.0  # noise deviations by which a bubble must differ from the background
_BACKGROUND_FRAMES = 32  # most frames used for the first background

Image = NDArray[np.float32]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Stage:
    """frames: (n, height, width). kinds: (n,) "", or why a frame is not used: "flash", "dark", "lost" or "excluded".
    reference: (height, width), the background in a frame of usual brightness. blind: (height, width), whether a pixel
    of it cannot be used.

    depth: share of the light that a dark bubble blocks; for a bright bubble the light that it adds, as a negative
    number. noise: standard deviation of `covered`. empty: number of leading frames without a bubble. gains: (n,)
    brightness of the frames over that of the background.
    """

    frames: Pixels
    kinds: NDArray[np.str_]
    reference: Image
    depth: float
    blind: Bools
    noise: float
    empty: int
    gains: Floats

    def covered(self, i: int, part: tuple[slice, slice] = np.s_[:, :]) -> Image:
        """Return which share of each pixel in a part of frame i the bubble covers; NaN if blind."""
        behind = self.reference[part] * np.float32(self.gains[i])
        share = behind - self.frames[i][part].astype(np.float32)
        share /= np.float32(self.depth) * behind if self.depth > 0 else np.float32(self.depth)
        share[self.blind[part]] = np.nan
        return np.asarray(share)


def set_stage(recording: Footage, polarity: str = "auto") -> Stage:
    """Classify the frames, and find a first background.

    Raises InputError: nothing moves in the recording, or an option is wrong.
    """
    if polarity not in POLARITIES:
        raise InputError(f"polarity must be one of {', '.join(POLARITIES)}, got {polarity!r}", "video.polarity")
    frames = recording.frames
    step = max(int(np.sqrt(frames[0].size / _PIXELS_SAMPLED)), int(np.sqrt(frames.size / _MOST_SAMPLED)), 1)
    small = frames[:, ::step, ::step].astype(np.float32)
    kinds, level = _kinds(small, recording)
    normal = np.flatnonzero(kinds == "")
    require(len(normal) > 1, "every frame is dark, overexposed or damaged", "video.no_frames")
    usual = float(np.median(level[normal]))
    small = small[normal] * (usual / np.maximum(level[normal], 1e-3))[:, None, None].astype(np.float32)
    low, high, middle = small.min(0), small.max(0), np.median(small, 0)
    noise = 1.4826 / np.sqrt(2) * float(np.median(np.abs(np.diff(small, axis=0)))) + 0.3
    moving = binary_opening(high - low > 0.5 * np.percentile(high - low, 99.5))
    moving = moving if moving.any() else high - low >= np.max(high - low)
    down, up = float(np.median((usual - low)[moving])), float(np.median((high - usual)[moving]))
    dark = polarity == "dark" or (polarity == "auto" and down >= up)
    swing = down if dark else -up  # by how much the bubble darkens a pixel
    if not abs(swing) > max(_LEAST_CONTRAST * noise, 0.03 * usual):
        still = "nothing moves in the recording: no bubble that is darker or brighter than the background"
        raise InputError(still, "video.no_bubble")
    # If the bubble never disappears, the middle of the moving region is always covered.
    within = binary_fill_holes(moving)
    background = np.where(within & ((usual - middle) / swing > 0.3), usual, middle)
    with_bubble = np.flatnonzero((((background - small) / swing > 0.5) & within).any((1, 2)))
    empty = normal[: int(with_bubble[0])] if len(with_bubble) else normal[:0]
    empty = empty[:-1] if len(empty) > 2 else empty  # the last one may show a bubble that is too small to be found
    reference = _first_background(frames, normal, level / usual, empty, swing, usual)
    blind = reference < (_OPAQUE * usual if dark else -1.0)
    reference = np.maximum(reference, np.float32(1e-3 * usual))
    gains = np.ones(len(frames))
    for i in normal:
        gains[i] = _gain(frames[i], reference, ~blind, swing / usual)
    return Stage(
        frames=frames,
        kinds=kinds,
        reference=reference,
        depth=swing / usual if dark else swing,
        blind=blind,
        noise=noise / abs(swing),
        empty=int(empty[-1]) + 1 if len(empty) else 0,
        gains=gains,
    )


def _gain(frame: Pixels, reference: Image, pixels: Bools, depth: float | None = None) -> float:
    """Return a frame's brightness over the background's: the median of pixels, with `depth` of uncovered ones only."""
    chosen = pixels[::3, ::3]
    ratio = frame[::3, ::3][chosen] / reference[::3, ::3][chosen]
    if depth is not None and ratio.size:
        bulk = np.percentile(ratio, 90 if depth > 0 else 10)
        ratio = ratio[np.sign(depth) * (ratio / bulk - 1.0) > -abs(depth) / 2]
    return float(np.median(ratio)) if ratio.size else 1.0


def _kinds(small: Image, recording: Footage) -> tuple[NDArray[np.str_], Floats]:
    """Return ((n,) kind of each frame, (n,) its brightness at the border)."""
    border = np.concatenate([small[:, 0], small[:, -1], small[:, :, 0], small[:, :, -1]], axis=1)
    level = np.percentile(border, 60, axis=1)
    quarter, most = (np.percentile(small, q, axis=(1, 2)) for q in (25, 95))
    usual, top = float(np.median(most)), float(small.max())
    burnt = (np.mean(small >= 0.98 * top, axis=(1, 2)) > _SATURATED) & (top > _FLASH * usual)
    kinds = np.full(len(small), "", dtype="U12")
    kinds[level < _DARK * np.median(level)] = "dark"
    kinds[(quarter > _FLASH * usual) | burnt] = "flash"
    kinds[recording.damaged] = "lost"
    return kinds, level


def _first_background(
    frames: Pixels, normal: Indices, gain: Floats, empty: Indices, swing: float, usual: float
) -> Image:
    """Return the mean of frames without a bubble, or else a percentile of each pixel, filled where always covered."""

    def light(chosen: Indices) -> Image:
        return np.stack([frames[i] / np.float32(gain[i]) for i in chosen])

    if len(empty) > 2:
        return np.asarray(light(empty[:_BACKGROUND_FRAMES]).mean(axis=0), np.float32)
    stack = light(normal[np.unique(np.linspace(0, len(normal) - 1, _BACKGROUND_FRAMES).astype(int))])
    background = np.asarray(np.percentile(stack, 80 if swing > 0 else 20, axis=0), np.float32)
    moving = np.ptp(stack, axis=0) > 0.5 * abs(swing)
    hole = binary_fill_holes(binary_opening(moving, iterations=2)) & ((usual - background) / swing > 0.3)
    if len(empty):
        background[hole] = light(empty).mean(axis=0)[hole]
    elif hole.any():
        background[hole] = smooth_surface(background, ~hole)[hole]
    return background


def smooth_surface(image: Image, measured: Bools) -> Image:
    """Fit a (height, width) quadratic surface to the measured pixels, robustly against dust."""
    y, x = np.mgrid[: image.shape[0], : image.shape[1]] / max(image.shape)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    rows, values = terms[measured][::7], image[measured][::7].astype(np.float64)
    weight = np.ones(len(values))
    for _ in range(6):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(rows * root[:, None], values * root, rcond=None)[0]
        residual = values - rows @ solution
        weight = 1.0 / (1.0 + (residual / max(1.4826 * float(np.median(np.abs(residual))), 1e-6)) ** 2) ** 2
    return np.asarray(terms @ solution, np.float32)


def with_refined_background(stage: Stage, circles: dict[int, tuple[float, float, float]]) -> Stage:
    """Return the stage with a new background: each pixel's mean over all frames where it is well outside the bubble.

    circles: by frame, (x, y, R) in px.
    """
    total, count = np.zeros((2, *stage.reference.shape)), np.zeros((2, *stage.reference.shape))  # all; undisturbed
    usual = float(np.median(stage.reference))
    tolerance = max(_DISTURBANCE * stage.noise, 0.02) * abs(stage.depth) * (usual if stage.depth > 0 else 1.0)
    y, x = (np.arange(size, dtype=np.float32) for size in stage.reference.shape)
    gains = stage.gains.copy()
    for i in [*range(stage.empty), *circles] if stage.empty else circles:
        if stage.kinds[i]:
            continue
        outside = np.ones(stage.reference.shape, bool)
        if i in circles:
            centre_x, centre_y, _ = circles[i]
            radius = max(circles[k][2] for k in (i - 1, i, i + 1) if k in circles)  # the wall may move fast
            outside = ((x - centre_x) ** 2)[None, :] + ((y - centre_y) ** 2)[:, None] > (1.25 * radius + 5.0) ** 2
        gains[i] = _gain(stage.frames[i], stage.reference, outside & ~stage.blind)
        light = stage.frames[i] / np.float32(gains[i])
        for k, part in enumerate((outside, outside & (np.abs(light - stage.reference) < tolerance))):
            np.add(total[k], light, out=total[k], where=part)
            count[k] += part
    passed = count[1] > 0.5 * count[0]  # a shock wave passes these pixels, in a few frames
    total, count = np.where(passed, total[1], total[0]), np.where(passed, count[1], count[0])
    measured = count > 0
    if measured.mean() < 0.05:
        return stage
    reference = stage.reference.copy()
    reference[measured] = (total[measured] / count[measured]).astype(np.float32)
    if not stage.empty and not measured.all():
        reference[~measured] = smooth_surface(reference, measured)[~measured]
    blind = reference < _OPAQUE * float(np.median(reference)) if stage.depth > 0 else stage.blind
    return replace(stage, reference=np.maximum(reference, np.float32(1e-3 * usual)), blind=blind, gains=gains)
