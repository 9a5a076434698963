"""How well radii are measured in recordings: five minutes of one core.

Rendered recordings (cavirheo.video.render) of simulated bubbles, so that R(t) is known: 12 kinds of scene, 5 seeds
each. A seed chooses material, R_max, frame rate, phase of the clock, light and noise. `--tuning` runs the seeds that
the method was tuned on.

Beside it the practice of the field: the first frame (without one that is free of the bubble: each pixel's median) is
subtracted, Otsu's threshold, the largest region, Taubin's circle through its boundary pixels.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.ndimage import binary_erosion, binary_fill_holes, label

import cavirheo
from cavirheo.errors import InputError
from cavirheo.io.recordings import examine
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.video import Film, Scene, render
from cavirheo.video.track import USED

SEEDS = {"tuning": range(5), "reporting": range(100, 105)}
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
FITTED = list(SCENES)[:10]  # kinds of scene of which one recording each is inferred


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


def measured(kind: str, seed: int, folder: Path) -> tuple[dict[str, np.ndarray], cavirheo.RadiusCurve, Shot]:
    """Of one recording: arrays over its frames."""
    scene, top, ending = SCENES[kind]
    shot = Shot(seed, top)
    film = shot.film(scene, seed)
    path = folder / f"shot{ending}"
    film.save(path, crf=23)
    began = time.process_time()
    found, curve = examine(path, frame_rate=shot.rate, um_per_px=shot.um_per_px, exposure=scene.exposure / shot.rate)
    spent = 1e3 * (time.process_time() - began) / FRAMES
    track, frames = found.track, found.recording.frames
    reference = frames[0] if scene.empty else np.median(frames, axis=0)
    usual = practice(frames, reference.astype(float))
    used = np.isin(track.flags, USED)
    print(f"{kind} {seed}: {spent:.1f} ms a frame", flush=True)
    return {
        "true": film.radius, "error": track.radius - film.radius, "sigma": track.sigma, "ok": track.flags == "ok",
        "used": used, "reversal": film.reversal, "usual": usual - film.radius, "ms": np.array([spent]),
    }, curve, shot  # fmt: skip


def row(kind: str, all_of: dict[str, np.ndarray]) -> str:
    ok = all_of["ok"] & (all_of["true"] > 3.0)
    error, sigma, usual = all_of["error"][ok], all_of["sigma"][ok], all_of["usual"][ok]
    usual = usual[np.isfinite(usual)]
    within = [np.mean(np.abs(error) < k * sigma) for k in (1, 2)]
    turned, other = all_of["reversal"], all_of["used"] & ~all_of["ok"] & np.isfinite(all_of["error"])
    invented = int((all_of["used"] & np.isnan(all_of["true"])).sum())
    least = f"{np.sqrt(np.mean(all_of['error'][other] ** 2)):.3f} ({other.sum()})" if other.any() else "–"
    return (
        f"| {kind} | {ok.sum()} | {error.mean():+.3f} | {np.sqrt(np.mean(error**2)):.3f} | {np.abs(error).max():.2f} | "
        f"{within[0]:.2f}, {within[1]:.2f} | {int((turned & ~all_of['ok']).sum())} of {turned.sum()} | {invented} | "
        f"{least} | {all_of['ms'].mean():.1f} | {usual.mean():+.2f}, {np.sqrt(np.mean(usual**2)):.2f} |"
    )


def inferred(kind: str, curve: cavirheo.RadiusCurve, shot: Shot) -> tuple[str, np.ndarray]:
    """A row, and (fit: G, mu, lambda relative errors; whether the 90 % intervals of `infer` hold G and mu)."""
    answer = cavirheo.fit(curve, bubble="field")
    truth = {"shear_modulus": shot.G, "viscosity": shot.mu, "stretch": shot.stretch}
    errors = [answer.median(name) / true - 1.0 for name, true in truth.items()]
    checked = cavirheo.infer(curve, bubble="field")
    held = []
    for name in ("shear_modulus", "viscosity"):
        low, high = checked.interval(name) or (np.nan, np.nan)
        held.append(bool(low <= truth[name] <= high))
    cells = " | ".join(f"{100 * error:+.1f}" for error in errors)
    told = " | ".join("yes" if one else "no" for one in held)
    verdict = answer.checks.verdict
    return f"| {kind} | {shot.G / 1e3:.1f} | {shot.mu:.3f} | {cells} | {verdict} | {told} |", np.array([*errors, *held])


def real(folder: Path) -> list[str]:
    path = folder / "video" / "PAstiff_xy002.mp4"
    if not path.is_file():
        return []
    began = time.process_time()
    found, _ = examine(path, frame_rate=270e3, um_per_px=2.76)
    spent = 1e3 * (time.process_time() - began) / len(found.time)
    published = loadmat(str(path.with_name("PAstiff_xy002_RofT.mat")))["Rnew"].ravel()
    top, radius = published.max(), found.track.radius
    off = 100 * (radius - published) / top
    off[~np.isfinite(off) | (published <= 0)] = np.nan
    ok = found.track.flags == "ok"
    first = ", ".join(found.track.flags[:3])
    return [
        "", "## A real recording",
        "A published recording (101 frames of 512 x 128, taller bubble than frame) beside the published circle fit.",
        f"RMS difference {np.sqrt(np.nanmean(off[ok] ** 2)):.2f} % of R_max over the {ok.sum()} frames called ok "
        f"(mean {np.nanmean(off[ok]):+.2f} %),",
        f"{np.sqrt(np.nanmean(off**2)):.2f} % with the {np.isfinite(off[~ok]).sum()} in which the wall turns;",
        f"R_max {np.nanmax(radius):.2f} px against {top:.2f} px ({100 * (np.nanmax(radius) / top - 1):+.2f} %).",
        f"Frames 1 to 3: {first}.", f"{spent:.1f} ms of processor time a frame, decoding included.",
    ]  # fmt: skip


HEAD = """# Radii from recordings
Written by `python benchmarks/video.py`.
Rendered recordings with known R(t): {n} kinds of scene, {seeds} seeds each, {frames} frames.
The seeds are not those of the tuning.
Errors are in pixels, of frames called ok with R above 3 px; the true radius is the mean over the exposure.

- *reversal*: frames in whose exposure the wall turns outwards (and moves by more than 0.25 px) that were flagged.
- *invented*: frames without a bubble that got a radius.
- *other*: rms error of the frames flagged small, arc or reversal, and how many.
- *ms*: processor time a frame, reading included.
- *practice of the field*: bias and rms of reference subtraction, Otsu's threshold and Taubin's circle on the same
  frames.

| scene | frames | bias | rms | largest | within 1, 2 sigma | reversal | invented | other | ms | practice of the field |
|---|---|---|---|---|---|---|---|---|---|---|"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tuning", action="store_true", help="the seeds of the tuning; nothing is written")
    parser.add_argument("--scenes", type=int, default=len(SCENES), help="of so many kinds of scene")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--no-fits", action="store_true")
    given = parser.parse_args()
    seeds = list(SEEDS["tuning" if given.tuning else "reporting"])[: given.seeds]
    lines = [HEAD.format(n=given.scenes, seeds=len(seeds), frames=FRAMES)]
    fits, answers = [], []
    with tempfile.TemporaryDirectory() as folder:
        for kind in list(SCENES)[: given.scenes]:
            of_seeds = [measured(kind, seed, Path(folder)) for seed in seeds]
            arrays = [one for one, _, _ in of_seeds]
            lines.append(row(kind, {name: np.concatenate([one[name] for one in arrays]) for name in arrays[0]}))
            print(lines[-1], flush=True)
            if kind in FITTED and not given.no_fits:
                try:
                    line, found = inferred(kind, *of_seeds[FITTED.index(kind) % len(seeds)][1:])
                    answers.append(found)
                except InputError as error:
                    line = f"| {kind} | failed: {error} | | | | | | | |"
                fits.append(line)
                print(line, flush=True)
    if fits:
        held = np.array(answers)
        lines += [
            "", "## From the recording to G and µ",
            "One recording of each kind, measured and fitted (`fit` with its defaults), and `infer` with its defaults:",
            "whether the 90 % interval holds the truth.", "",
            "| scene | G, kPa | µ, Pa s | error of G, % | of µ, % | of λ, % | verdict of fit | G held | µ held |",
            "|---|---|---|---|---|---|---|---|---|", *fits, "",
            f"Median of the absolute errors: G {100 * np.median(np.abs(held[:, 0])):.1f} %, "
            f"µ {100 * np.median(np.abs(held[:, 1])):.1f} %, λ {100 * np.median(np.abs(held[:, 2])):.1f} %; "
            f"intervals hold G in {int(held[:, 3].sum())} and µ in {int(held[:, 4].sum())} of {len(held)}.",
        ]  # fmt: skip
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    lines += real(Path(os.environ.get("CAVIRHEO_REAL_DATA", default)))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
