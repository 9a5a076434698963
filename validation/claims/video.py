"""How well radii are measured in recordings.

Rendered recordings (validation/rendering.py) of simulated bubbles, so that R(t) is known: 12 kinds of scene, of seeds
that the method was not tuned on (0 to 4 are those of the tuning). A seed chooses material, R_max, frame rate, phase of
the clock, light and noise. Errors are in pixels, of frames called ok with R above 3 px; the true radius is the mean
over the exposure.

Beside it the practice of the field: the first frame (without one that is free of the bubble: each pixel's median) is
subtracted, Otsu's threshold, the largest region, Taubin's circle through its boundary pixels.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion, binary_fill_holes, label

import cavirheo
from cavirheo.io.shots import examine
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from validation.numbers import Number, Run, statistic
from validation.rendering import Film, Scene, render

SEEDS = range(100, 105)
FRAMES = 80
SCENES = {  # what is shown: the scene, R_max in px, how it is saved
    "clean, 8 bits": (Scene(width=256, height=176), 65, ".tif"),
    "no frame without the bubble": (Scene(width=256, height=176, empty=0), 65, ".tif"),
    "512 x 128, taller than the frame, exposure 80 %, flash, dark frame": (
        Scene(width=512, height=128, exposure=0.8, flash=1, dark_frames=1, empty=1), 90, ".tif"),
    "400 x 250, 10 bits, 3 % noise and noise of rows": (
        Scene(width=400, height=250, bits=10, noise=0.0165, row_noise=0.008), 80, ".tif"),
    "R_max 12 px": (Scene(width=96, height=96), 12, ".tif"),
    "5 % ellipse, two more modes, drift": (
        Scene(width=256, height=176, modes=((2, 0.05, 0.3), (3, 0.01, 1.0), (5, 0.006, 0.2)), drift=(0.15, 0.05)), 62,
        ".tif"),
    "gradient, wall, dust, shock waves, satellites, flicker": (
        Scene(width=256, height=176, gradient=0.5, wall=160.0, dust=12, shock=True, satellites=3, flicker=0.05), 62,
        ".tif"),
    "bright bubble": (Scene(width=256, height=176, lit=0.12, dark=6.0), 65, ".tif"),
    "H.264, crf 23": (Scene(width=256, height=176), 65, ".mp4"),
    "16 bits, 20 % contrast": (Scene(width=256, height=176, bits=16, dark=0.8), 65, ".tif"),
    "bright centre, exposure 60 %": (Scene(width=256, height=176, bright_centre=0.6, exposure=0.6), 65, ".tif"),
    "12 bits, sharp, exposure 5 %": (Scene(width=256, height=176, bits=12, blur=0.45, exposure=0.05), 65, ".tif"),
}  # fmt: skip
FIRST = {kind: SEEDS[k % len(SEEDS)] for k, kind in enumerate(SCENES)}  # seeds of a quick run
FITTED = list(SCENES)[:10]  # kinds of scene of which the recording of this seed is fitted


class Shot:
    """A simulated bubble on the clock of a camera: time in frames, radius in px; growth is the collapse in reverse."""

    def __init__(self, seed: int, top: float) -> None:
        rng = np.random.default_rng(seed)
        self.G, self.mu = 10 ** rng.uniform(3.5, 4.4), 10 ** rng.uniform(-1.7, -0.9)
        self.R_max, self.stretch = rng.uniform(180e-6, 320e-6), rng.uniform(5.0, 7.5)
        self.rate = rng.uniform(14, 22) / (self.R_max / 10.07)
        fine = np.linspace(0, FRAMES / self.rate, 16_000)
        run = cavirheo.simulate(
            NeoHookeanKelvinVoigt(self.G, self.mu), max_radius=self.R_max, stretch=self.stretch, time=fine
        )
        growth = int(np.argmin(run.radius[: int(0.4 * len(fine))]))
        begin = int(0.03 * growth)
        time = np.concatenate([fine[:growth], fine[growth] + fine]) * self.rate
        radius = np.concatenate([run.radius[:growth][::-1], run.radius])
        self.top = top * rng.uniform(0.9, 1.05)
        self.um_per_px = self.R_max / self.top * 1e6
        self.time = time[begin:] - time[begin] - rng.uniform(0, 0.5)
        self.radius = radius[begin:] / self.R_max * self.top

    def film(self, scene: Scene, seed: int) -> Film:
        return render(self.time, self.radius, frames=FRAMES, scene=scene, seed=seed)


def practice(frames: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """(n,) px: what the field's scripts find; NaN where they find nothing."""
    found = np.full(len(frames), np.nan)
    for k, frame in enumerate(frames):
        off = np.abs(frame.astype(float) - reference)
        regions, count = label(binary_fill_holes(off > otsu(off)))
        if not count:
            continue
        largest = regions == np.argmax(np.bincount(regions.ravel())[1:]) + 1
        y, x = np.nonzero(largest & ~binary_erosion(largest))
        inner = (x > 0) & (y > 0) & (x < frame.shape[1] - 1) & (y < frame.shape[0] - 1)
        if inner.sum() > 5:
            found[k] = taubin(x[inner].astype(float), y[inner].astype(float))
    return found


def otsu(image: np.ndarray) -> float:
    """The threshold that divides best into two classes."""
    count, edges = np.histogram(image, 256)
    middle = (edges[1:] + edges[:-1]) / 2
    below, total = np.cumsum(count), np.cumsum(count * middle)
    with np.errstate(invalid="ignore", divide="ignore"):
        between = (total[-1] * below / below[-1] - total) ** 2 / (below * (below[-1] - below))
    return float(middle[np.argmax(np.where(np.isfinite(between), between, -1.0))])


def taubin(x: np.ndarray, y: np.ndarray) -> float:
    """Radius of Taubin's circle (1991), by the singular vectors of the centred points."""
    x, y = x - x.mean(), y - y.mean()
    square = x * x + y * y
    mean = square.mean()
    rows = np.stack([(square - mean) / (2 * np.sqrt(mean)), x, y], axis=1)
    a, b, c = np.linalg.svd(rows, full_matrices=False)[2][2]
    a = a / (2 * np.sqrt(mean))
    return float(np.sqrt(b * b + c * c - 4 * a * (-mean * a)) / abs(a) / 2)


def one(job: tuple[str, int]) -> dict:
    """Of one recording: errors of the frames, px, those of the field's practice, and those of G and mu by `fit`."""
    kind, seed = job
    scene, top, ending = SCENES[kind]
    shot = Shot(seed, top)
    film = shot.film(scene, seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"shot{ending}"
        film.save(path, crf=23)
        exposure = scene.exposure / shot.rate
        found, curve = examine(path, frame_rate=shot.rate, um_per_px=shot.um_per_px, exposure=exposure)
    frames = found.recording.frames
    reference = frames[0] if scene.empty else np.median(frames, axis=0)
    usual = practice(frames, reference.astype(float)) - film.radius
    ok = (found.track.flags == "ok") & (film.radius > 3.0)
    row = {"error": (found.track.radius - film.radius)[ok].tolist()}
    row["usual"] = usual[ok & np.isfinite(usual)].tolist()
    if kind in FITTED and seed == FIRST[kind]:
        answer = cavirheo.fit(curve, bubble="field")
        row["G"] = answer.median("shear_modulus") / shot.G - 1.0
        row["mu"] = answer.median("viscosity") / shot.mu - 1.0
    return row


def rms(values: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=axis))


def measure(run: Run) -> Iterator[Number]:
    """Bias and rms of each kind of scene: the largest of all kinds, and the middle."""
    jobs = [(kind, seed) for kind in SCENES for seed in (SEEDS if run.full else [FIRST[kind]])]
    rows = run.rows("video", one, jobs)
    kinds: dict[str, list[dict]] = {kind: [] for kind in SCENES}
    for (kind, _), row in zip(jobs, rows, strict=True):
        kinds[kind].append(row)
    for who in ("error", "usual"):
        errors = [np.concatenate([row[who] for row in of_kind]) for of_kind in kinds.values()]
        bias = [float(np.mean(one)) for one in errors]
        yield statistic(f"{who}.bias.largest", np.abs(bias), "px", np.max, SEEDS[0])
        yield statistic(f"{who}.bias.median", bias, "px", seed=SEEDS[0])
        yield statistic(f"{who}.rms.largest", [float(rms(one)) for one in errors], "px", np.max, SEEDS[0])
        yield statistic(f"{who}.rms.median", [float(rms(one)) for one in errors], "px", seed=SEEDS[0])
    for name in ("G", "mu"):
        yield statistic(f"fit.{name}", [abs(row[name]) for row in rows if name in row], "1", seed=SEEDS[0])
