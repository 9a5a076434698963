"""Make the synthetic shots of this folder: simulated bubbles, filmed by an imperfect camera; two rheometer sweeps; and
a recording of one more bubble.

    python -m examples.make_examples

Nothing here was measured. Each shot is a Keller-Miksis simulation (water-like medium, neo-Hookean Kelvin-Voigt
material) filmed at 1 Mfps. It has what real recordings have: growth before R_max (here the collapse in reverse, because
the model has no laser), a clock that starts before nucleation, frames without a bubble, a blur by the exposure that
fills the sharp minima, radius noise, and frames that the edge detection lost, most of them around a collapse. The true
parameters are written to truth.csv, which only the tests read.

The sweeps are of a gel that is the soft one at a bubble's rates, 6 kPa and 0.03 Pa s, and a softer one at a
rheometer's: a spring of 1.5 kPa, beside it a Maxwell arm of 4.5 kPa that relaxes in 3 ms, and a dashpot of 0.03 Pa s.
Its G' falls by half at a strain of 50 %; torque noise makes the smallest strains scatter.

The recording, bubble.mp4, was made at 500,000 frames per second and 4 um per pixel; a frame is exposed for 0.4 us.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from scipy.io import savemat

from cavirheo import NeoHookeanKelvinVoigt, simulate
from cavirheo.physics.media import WATER
from validation.rendering import Scene, render

HERE = Path(__file__).parent
FRAME, EXPOSURE, FRAMES = 1e-6, 0.3e-6, 160  # s, s
NOISE, LOST = 0.006, 0.05  # of R_max, of the frames
SETS = {"soft_gel": (6.0e3, 0.03, 5), "stiff_gel": (3.0e4, 0.08, 5)}  # G Pa, mu Pa s, shots

SPRING, ARM, RELAXATION, DASHPOT, HALF_STRAIN = 1500.0, 4500.0, 3e-3, 0.03, 0.5  # Pa, Pa, s, Pa s, 1


def moduli(omega: np.ndarray | float, strain: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """G', G'' (Pa) of the gel at an angular frequency (rad/s) and a strain."""
    wt, softening = omega * RELAXATION, (strain / HALF_STRAIN) ** 2
    storage = SPRING + ARM * wt**2 / (1 + wt**2)
    loss = DASHPOT * omega + ARM * wt / (1 + wt**2)
    return np.asarray(storage / (1 + softening)), np.asarray(loss * (1 + 4 * softening) / (1 + softening))


def write_sweeps(folder: Path) -> None:
    """A strain sweep at 1 Hz and a frequency sweep at 1 %: 0.5 % noise, and a torque floor at the smallest strains."""
    rng = np.random.default_rng(11)
    strain, frequency = np.logspace(-4, 0.5, 28), np.logspace(-2, 1.2, 17)
    for name, omega, gamma in (("strain", 2 * np.pi, strain), ("frequency", 2 * np.pi * frequency, 0.01)):
        noise = 0.005 + 1e-5 / gamma
        measured = [modulus * (1 + noise * rng.standard_normal(modulus.shape)) for modulus in moduli(omega, gamma)]
        columns = np.broadcast_arrays(100 * gamma, omega / (2 * np.pi), *measured)
        header = ("Oscillation strain (%)", "Frequency (Hz)", "Storage modulus (Pa)", "Loss modulus (Pa)")
        rows = [tuple(f"{value:.5g}" for value in row) for row in zip(*columns, strict=True)]
        _write(folder / f"soft_gel_{name}_sweep.csv", header, rows)


def film(rng: np.random.Generator, G: float, mu: float) -> tuple[np.ndarray, np.ndarray, float, float]:
    """time (n,) s, radius (n,) m with NaN for lost frames, and the true R_max (m) and stretch of one shot."""
    R_max, stretch = rng.uniform(180e-6, 320e-6), rng.uniform(6.0, 9.0) if G < 1e4 else rng.uniform(4.5, 6.5)
    fine = np.arange(0, FRAMES * FRAME + 2e-6, 0.02e-6)
    run = simulate(NeoHookeanKelvinVoigt(G, mu), max_radius=R_max, stretch=stretch, time=fine)
    growth = fine[: int(np.argmin(run.radius))]
    nucleation = 0.98 * growth[-1]  # before R_max
    time = FRAME * np.arange(FRAMES)
    shutter = rng.uniform(0, FRAME) + 3 * FRAME + nucleation  # R_max on the camera's clock, three dark frames first
    opened = time[:, None] - shutter + np.linspace(-EXPOSURE / 2, EXPOSURE / 2, 16)
    radius = np.interp(np.abs(opened), fine, run.radius).mean(axis=1)
    radius += NOISE * R_max * rng.standard_normal(FRAMES)
    lost = rng.random(FRAMES) < LOST * np.where(radius < 0.25 * R_max, 4.0, 1.0)
    radius[lost | (time < shutter - nucleation) | (radius <= 0.02 * R_max)] = np.nan
    return time, radius, R_max, stretch


FILMED = ("bubble", 1, 1.0e4, 0.06, 250e-6, 6.5)  # set, shot, G Pa, mu Pa s, R_max m, lambda
RATE, SCALE, SHUTTER = 5e5, 4.0, 0.2  # 1/s, um/px, frames


def write_video(path: Path) -> None:
    """What a camera sees of a bubble that grows as it collapses, taller than the frame, with dust and a shock wave."""
    *_, G, mu, R_max, stretch = FILMED
    fine = np.linspace(0, 160e-6, 16_000)
    radius = simulate(NeoHookeanKelvinVoigt(G, mu), max_radius=R_max, stretch=stretch, time=fine).radius
    growth = int(np.argmin(radius[:4000]))
    time = np.concatenate([fine[:growth], fine[growth] + fine])[200:]
    radius = np.concatenate([radius[:growth][::-1], radius])[200:]
    scene = Scene(
        width=256, height=112, exposure=SHUTTER, dust=6, gradient=0.2, shock=True, satellites=2, bright_centre=0.4,
        empty=3, flash=1,
    )  # fmt: skip
    render((time - time[0]) * RATE, radius / SCALE * 1e6, frames=80, scene=scene, seed=3).save(path, crf=20)


def main() -> None:
    rng = np.random.default_rng(7)
    truth = []
    for name, (G, mu, shots) in SETS.items():
        filmed = [film(rng, G, mu) for _ in range(shots)]
        truth += [(name, k, G, mu, *(round(v, 9) for v in shot[2:])) for k, shot in enumerate(filmed, 1)]
        if name == "soft_gel":
            rows = [
                (k, f"{t * 1e6:.1f}", "" if np.isnan(R) else f"{R * 1e6:.2f}")
                for k, (time, radius, _, _) in enumerate(filmed, 1)
                for t, R in zip(time, radius, strict=True)
            ]
            _write(HERE / f"{name}.csv", ("shot", "time_us", "radius_um"), rows)
        else:
            radii, times = np.empty((1, shots), object), np.empty((1, shots), object)
            peaks = [float(np.nanmax(radius)) for _, radius, _, _ in filmed]
            for k, ((time, radius, _, _), peak) in enumerate(zip(filmed, peaks, strict=True)):
                origin = time[np.nanargmax(radius)]
                radii[0, k] = (radius / peak)[None, :]
                times[0, k] = ((time - origin) / WATER.time_scale(peak))[None, :]
            stretches = [shot[3] for shot in filmed]
            content = {
                "R_nondim_All": radii, "t_nondim_All": times, "RmaxList": np.array([peaks]),
                "lambda_max_mean": float(np.mean(stretches)), "lambda_max_std": float(np.std(stretches, ddof=1)),
            }  # fmt: skip
            savemat(HERE / f"{name}.mat", content, do_compression=True)
    truth.append(FILMED)
    write_video(HERE / "bubble.mp4")
    _write(
        HERE / "truth.csv",
        ("set", "shot", "shear_modulus_Pa", "viscosity_Pa_s", "max_radius_m", "stretch"),
        truth,
    )
    write_sweeps(HERE)


def _write(path: Path, header: tuple[str, ...], rows: list[tuple[object, ...]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


if __name__ == "__main__":
    main()
