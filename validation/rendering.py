"""Rendered recordings with a known radius history, for claims, tests and examples."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import require
from cavirheo.video.formats import Pixels

_SUBPIXELS = 3  # subpixels along a pixel's side
_MOMENTS = 65  # times within an exposure at which the bubble is drawn
_LEAST_REVERSAL = 0.25  # px, motion within the exposure that a reversal must exceed
_SHOCK_SPEED = 120.0  # px per frame, speed of a shock wave


@dataclass(frozen=True)
class Scene:
    """What the camera records. Lengths are in pixels, brightness in parts of the full scale, times in frames.

    centre: (x, y), by default near the middle. exposure: of a frame. blur: sigma of the optics. lit: brightness of the
    background. dark: light that passes the bubble, over that beside it; above 1 the bubble is bright. noise: deviation
    at the background. modes: (n, amplitude over R, phase). wall: y of a dark wall's edge. empty, flash, dark_frames:
    numbers of frames before the bubble: normal, overexposed, then dark ones.
    """

    width: int = 256
    height: int = 160
    centre: tuple[float, float] | None = None
    bits: int = 8
    exposure: float = 0.3
    blur: float = 0.9
    lit: float = 0.55
    dark: float = 0.08
    noise: float = 0.008
    row_noise: float = 0.0
    gradient: float = 0.0
    flicker: float = 0.0
    bright_centre: float = 0.0
    modes: tuple[tuple[int, float, float], ...] = ()
    drift: tuple[float, float] = (0.0, 0.0)
    wall: float | None = None
    dust: int = 0
    shock: bool = False
    satellites: int = 0
    empty: int = 4
    flash: int = 0
    dark_frames: int = 0


@dataclass(frozen=True, eq=False)
class Film:
    """A rendered recording, with its true values.

    Attributes:
        frames: (n, height, width) of 8 or 16 bits.
        radius: (n,) px, mean over the exposure, NaN without a bubble and in spoilt frames.
        reversal: (n,) whether the wall turns outwards in the exposure, and moves by more than a quarter of a pixel.
        centre: (n, 2) px.
    """

    frames: Pixels
    radius: Floats
    reversal: Bools
    centre: Floats

    def save(self, path: str | Path, crf: int = 18) -> None:
        """Save the film as .mp4 (H.264 of quality `crf`, 8 bits), .mkv (FFV1, lossless) or .tif."""
        path = Path(path)
        if path.suffix == ".tif":
            from tifffile import imwrite

            imwrite(path, self.frames, photometric="minisblack")
        else:
            _write_movie(path, self.frames, crf if path.suffix == ".mp4" else None)


def render(time: ArrayLike, radius: ArrayLike, *, frames: int, scene: Scene | None = None, seed: int = 0) -> Film:
    """Render a recording of a bubble.

    Args:
        time: (m,) in frames, increasing, 0 at the bubble's beginning; with steps finer than the exposure.
        radius: (m,) px. Before the first and after the last time there is no bubble.
        frames: their number; the bubble begins after `scene.empty`, `scene.flash` and `scene.dark_frames` frames.

    Raises InputError.
    """
    scene = scene or Scene()
    time, radius = np.asarray(time, float), np.asarray(radius, float)
    fine = time.ndim == 1 and time.shape == radius.shape and len(time) > 1 and bool(np.all(np.diff(time) > 0))
    require(fine, "time and radius must be (m,) arrays, time increasing", "render.time")
    require(scene.bits in range(8, 17), f"8 to 16 bits, got {scene.bits}", "render.bits")
    camera = _Camera(time, radius, scene, np.random.default_rng(seed))
    first = scene.empty + scene.flash + scene.dark_frames
    require(frames > first, f"{frames} frames, and {first} before the bubble", "render.frames")
    shots = [camera.expose(k, k - first + 0.5) for k in range(frames)]
    images, true, turned, centres = zip(*shots, strict=True)
    return Film(np.stack(images), np.array(true), np.array(turned), np.array(centres))


class _Camera:
    def __init__(self, time: Floats, radius: Floats, scene: Scene, rng: np.random.Generator) -> None:
        self.time, self.radius, self.scene, self.rng = time, radius, scene, rng
        height, width = scene.height, scene.width
        self.centre = np.array(scene.centre or ((width - 1) / 2 + 0.3, (height - 1) / 2 - 0.2))
        y, x = np.mgrid[:height, :width]
        slope = rng.normal(size=2)
        slope *= scene.gradient / np.hypot(*slope)
        vignette = ((x / width - 0.5) ** 2 + (y / height - 0.5) ** 2) * scene.gradient
        self.light = 1.0 + slope[0] * (x / width - 0.5) + slope[1] * (y / height - 0.5) - vignette
        for _ in range(scene.dust):
            at, size = rng.uniform((0, 0), (width, height)), rng.uniform(0.8, 2.5)
            self.light *= 1.0 - rng.uniform(0.2, 0.8) * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * size**2))
        if scene.wall is not None:
            self.light *= 1.0 - 0.85 / (1.0 + np.exp(-(y - scene.wall) / 0.8))
        self.x, self.y = x, y
        final_radius = float(np.median(radius[-len(radius) // 5 :]))
        angles, away = rng.uniform(0, 2 * np.pi, scene.satellites), rng.uniform(1.6, 2.6, scene.satellites)
        x, y = final_radius * away * np.array([np.cos(angles), np.sin(angles)])
        self.satellites = list(zip(x, y, rng.uniform(1.2, 3.0, scene.satellites), strict=True))
        minima = np.flatnonzero((radius[1:-1] < radius[:-2]) & (radius[1:-1] <= radius[2:])) + 1
        self.collapses = time[minima]

    def expose(self, number: int, middle: float) -> tuple[Pixels, float, bool, Floats]:
        """Return (image, true radius, whether the wall turns, centre) of a frame; `middle`: time of mid-exposure."""
        scene, rng = self.scene, self.rng
        moments = middle + scene.exposure * np.linspace(-0.5, 0.5, _MOMENTS)
        radii = np.interp(moments, self.time, self.radius, left=0.0, right=0.0)
        true, centre = float(radii.mean()), self.centre + np.array(scene.drift) * max(middle, 0.0)
        image = self.light * (1.0 + scene.flicker * rng.normal())
        if radii.max() > 0:
            image = image * self._transmission(radii, centre, middle)
        if scene.shock:
            for begin in (0.0, *self.collapses[:2]):
                if 0.0 < middle - begin < 3.0:
                    away = np.hypot(self.x - centre[0], self.y - centre[1]) - _SHOCK_SPEED * (middle - begin)
                    bright, dark = (np.exp(-((away / 1.5 - behind) ** 2)) for behind in (0, 2))
                    image = image * (1.0 + 0.35 * bright - 0.35 * dark)
        image = scene.lit * image
        after = number - scene.empty
        if 0 <= after < scene.flash + scene.dark_frames:
            image = image * (8.0 if after < scene.flash else 0.05)
            true = np.nan
        image = image + scene.noise * np.sqrt(np.clip(image, 0.02, 1.0) / scene.lit) * rng.normal(size=image.shape)
        image = image + scene.row_noise * rng.normal(size=(len(image), 1))
        full = 2**scene.bits - 1
        pixels = np.rint(np.clip(image, 0.0, 1.0) * full).astype(np.uint8 if scene.bits == 8 else np.uint16)
        turned = bool(min(radii[0], radii[-1]) > radii.min() > 0 and np.ptp(radii) > _LEAST_REVERSAL)
        return pixels, (true if true > 0 else np.nan), turned, centre

    def _transmission(self, radii: Floats, centre: Floats, middle: float) -> Floats:
        """Return (height, width) the light that passes the bubble and its satellites, blurred."""
        scene = self.scene
        satellites = self.satellites if len(self.collapses) and middle > self.collapses[0] else []
        extent = 1.3 * radii.max() + 6.0 * scene.blur + 4.0
        extent = max([extent, *(np.hypot(x, y) + size + 8.0 for x, y, size in satellites)])
        (left, top), (right, bottom) = (np.floor(centre - extent).astype(int), np.ceil(centre + extent).astype(int) + 1)
        left, top, right, bottom = max(left, 0), max(top, 0), min(right, scene.width), min(bottom, scene.height)
        cut = np.zeros((scene.height, scene.width))
        if left >= right or top >= bottom:
            return 1.0 - cut
        edge = int(np.ceil(4 * scene.blur)) + 1  # margin beyond the region, for the blur
        steps = (np.arange(-edge * _SUBPIXELS, (n + edge) * _SUBPIXELS) + 0.5 for n in (right - left, bottom - top))
        x, y = (step / _SUBPIXELS - 0.5 + start for step, start in zip(steps, (left, top), strict=True))
        covered = self._bubble(x[None, :] - centre[0], y[:, None] - centre[1], radii)
        for dx, dy, size in satellites:
            away = np.hypot(x[None, :] - centre[0] - dx, y[:, None] - centre[1] - dy)
            covered = np.maximum(covered, (1.0 - scene.dark) * np.clip((size - away) * _SUBPIXELS + 0.5, 0.0, 1.0))
        smooth = gaussian_filter(covered, scene.blur * _SUBPIXELS)
        inner = smooth[edge * _SUBPIXELS : -edge * _SUBPIXELS, edge * _SUBPIXELS : -edge * _SUBPIXELS]
        cut[top:bottom, left:right] = inner.reshape(bottom - top, _SUBPIXELS, right - left, _SUBPIXELS).mean((1, 3))
        return 1.0 - cut

    def _bubble(self, x: Floats, y: Floats, radii: Floats) -> Floats:
        """Return the share of light that the bubble blocks, at points relative to its centre."""
        scene, away = self.scene, np.hypot(x, y)
        table = np.arange(0.0, radii.max() + 2.0, 0.04)
        share = np.clip((radii[:, None] - table) * _SUBPIXELS + 0.5, 0.0, 1.0).mean(axis=0)
        if scene.modes:
            angle = np.arctan2(y, x)
            away = away / (1.0 + sum(size * np.cos(n * angle + phase) for n, size, phase in scene.modes))
        inside = 1.0 - scene.dark
        if scene.bright_centre:
            inside = inside - scene.bright_centre * np.exp(-((away / (0.3 * radii[_MOMENTS // 2] + 0.1)) ** 4))
        return np.asarray(inside * np.interp(away, table, share, right=0.0))


def _write_movie(path: Path, frames: Iterable[Pixels], crf: int | None) -> None:
    """Encode frames, (height, width) or (height, width, 3), in H.264 of the quality `crf`, or if it is None in lossless
    FFV1. They are cut to an even height and width, and played at 10 per second."""
    import av

    codec, options = ("ffv1", {}) if crf is None else ("libx264", {"crf": str(crf)})
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=10, options=options)
        for k, frame in enumerate(frames):
            pixels = "rgb24" if frame.ndim == 3 else "gray16le" if frame.dtype == np.uint16 else "gray"
            height, width = (size // 2 * 2 for size in frame.shape[:2])
            if k == 0:
                stream.height, stream.width, stream.pix_fmt = height, width, pixels if crf is None else "yuv420p"
            even = np.ascontiguousarray(frame[:height, :width])
            container.mux(stream.encode(av.VideoFrame.from_ndarray(even, format=pixels)))
        container.mux(stream.encode())
