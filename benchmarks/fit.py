"""Least-squares fit: time per curve, recovery on simulated shots of known truth, error over the Cramer-Rao bound.

    python benchmarks/fit.py [-n 30] [--noise 0.01] [--seed 1] [--real DIR]

Truths are drawn from G 1 to 50 kPa, mu 0.01 to 0.3 Pa s, stretch 4 to 10, R_max 100 to 400 um, simulated with
PRECISE (the fit uses the default accuracy), 100 frames over 4.07 t_c, and fitted with the field's bubble, as they are.
The bound is that of unweighted frames with independent noise, clock and R_max free: cov = sigma^2 (J^T J)^-1 over the
window, J by differences of 1e-3.
Noise-free shots count as identifiable where the bound of 0.1 % noise is below 1 % in G and 3 % in mu. --real: time per
curve, as `cavirheo fit` fits them by default, of all curves that are found below a folder.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cavirheo.inference.search import LeastSquares

from cavirheo import NeoHookeanKelvinVoigt, Posterior, RadiusCurve, simulate
from cavirheo.arrays import even_points
from cavirheo.inference import fit
from cavirheo.inference.assumptions import Family, Options
from cavirheo.inference.experiment import Experiment
from cavirheo.io.shots import read_shots
from cavirheo.physics.accuracy import PRECISE
from cavirheo.physics.media import WATER

LN10 = np.log(10.0)
BOX = np.array([[3.0, np.log10(5e4)], [-2.0, np.log10(0.3)], [np.log10(4), 1.0], [-4.0, np.log10(4e-4)]])


@dataclass
class Case:
    truth: np.ndarray  # log10 of G, mu, stretch, R_max
    clean: RadiusCurve

    def noisy(self, noise: float, seed: int) -> RadiusCurve:
        """The frames with normal noise, as a fraction of R_max. R_max and its time are those of the truth."""
        draw = np.random.default_rng(seed).standard_normal(len(self.clean.time))
        top = 10 ** self.truth[3]
        radius = np.maximum(self.clean.radius + noise * top * draw, 1e-7)
        return RadiusCurve(self.clean.time, radius, meta={"name": "shot"}, maximum=(0.0, top))


def cases(count: int, seed: int) -> list[Case]:
    return [made(BOX[:, 0] + point * np.ptp(BOX, axis=1)) for point in even_points(count + seed, len(BOX))[seed:]]


def made(truth: np.ndarray) -> Case:
    G, mu, stretch, R_max = 10**truth
    times = np.linspace(0.0, 4.07 * WATER.time_scale(R_max), 100)
    run = simulate(NeoHookeanKelvinVoigt(G, mu), max_radius=R_max, stretch=stretch, time=times, accuracy=PRECISE)
    return Case(truth, RadiusCurve(times, run.radius, meta={"name": "shot"}, maximum=(0.0, R_max)))


def bound(case: Case, window: int | str | None, noise: float) -> np.ndarray:
    """(3,) Cramer-Rao bound of log10 G, mu, stretch at this noise, fraction of R_max, clock and R_max free, too."""
    shot = Experiment(case.clean, Family("nhkv"), options=Options(window=window, weights="equal"))
    shot.sigma = np.ones(len(shot.measured))
    x = np.concatenate([case.truth[:3], np.zeros(len(shot.names) - 3)])  # clock and R_max are right
    J = LeastSquares(shot).jacobian(x, PRECISE, shot.predict(x, PRECISE))
    return noise * np.sqrt(np.diag(np.linalg.pinv(J.T @ J, rcond=1e-14)))[:3]


def error(answer: Posterior, case: Case) -> np.ndarray:
    """(3,) log10 of answer over truth."""
    best = [answer.best[name] for name in ("shear_modulus", "viscosity", "stretch")]
    return np.log10(best) - case.truth[:3]


def timed(curves: list[RadiusCurve]) -> tuple[np.ndarray, np.ndarray, int]:
    """(CPU seconds, simulations) of each curve that was answered, by one thread; how many were not."""
    seconds, runs = [], []
    for curve in curves:
        began = time.process_time()
        answer = fit(curve, workers=1)
        if answer.checks.verdict != "failed":
            seconds.append(time.process_time() - began)
            runs.append(answer.diagnostics.simulations)
    return np.array(seconds), np.array(runs), len(curves) - len(runs)


def sets_below(folder: Path) -> Iterator[tuple[str, list[RadiusCurve], list[str]]]:
    """Of the folder and every subfolder: name, curves, problems in reading."""
    for place in sorted(path for path in [folder, *folder.iterdir()] if path.is_dir()):
        files = sorted(path for path in place.iterdir() if path.suffix in (".mat", ".csv", ".txt"))
        if files:
            yield place.name, *read_shots(files, density=WATER.density, pressure=WATER.pressure)[:2]


def real(folder: Path) -> None:
    """Prints the time per curve of every subfolder, and of all curves."""
    everything = []
    for name, curves, problems in sets_below(folder):
        seconds, runs, failed = timed(curves)
        if len(seconds):
            everything.append(seconds)
            print(f"{name}: {len(seconds)} curves, median {np.median(seconds):.2f} s CPU, {np.median(runs):.0f} "
                  f"simulations; not answered {failed}, files not read {len(problems)}")  # fmt: skip
    if everything:
        all_of_them = np.concatenate(everything)
        print(f"all {len(all_of_them)} real curves: median {np.median(all_of_them):.2f} s CPU, nine of ten below "
              f"{np.quantile(all_of_them, 0.9):.2f} s, largest {all_of_them.max():.2f} s")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=30)
    parser.add_argument("--noise", type=float, default=0.01)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--window", default=None)
    parser.add_argument("--real", type=Path, default=None)
    given = parser.parse_args()
    window = int(given.window) if given.window and given.window.isdigit() else given.window
    shots = cases(given.n, given.seed)
    fit(shots[0].clean, bubble="field")  # compiles
    if given.real:
        real(given.real)

    wall, cpu, runs, failed = [], [], [], 0
    clean, sharp = [], []
    for case in shots:
        began, spent = time.perf_counter(), time.process_time()
        answer = fit(case.clean, bubble="field", window=window, workers=1)
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - spent)
        runs.append(answer.diagnostics.simulations or 0)
        failed += answer.checks.verdict == "failed"
        clean.append(np.expm1(LN10 * error(answer, case)) if answer.checks.verdict != "failed" else np.full(3, np.nan))
        sharp.append(bound(case, window, 1e-3) * LN10)
    clean, sharp = np.abs(clean), np.array(sharp)
    identifiable = (sharp[:, 0] < 0.01) & (sharp[:, 1] < 0.03)
    good = (clean[:, 0] < 0.01) & (clean[:, 1] < 0.03)
    print(f"{given.n} shots, NHKV, stretch free, all windows fitted, one thread; failed {failed}")
    print(f"seconds per curve: median {np.median(wall):.2f} wall, {np.median(cpu):.2f} CPU, largest {max(wall):.2f}")
    print(f"simulations per curve: median {np.median(runs):.0f}")
    print(f"noise-free: within 1 % of G and 3 % of mu: {np.sum(good & identifiable)} of {np.sum(identifiable)}")
    print(f"  (all: {np.sum(good)} of {given.n}); median errors of G, mu, stretch: {np.nanmedian(clean, axis=0)}")
    for i in np.flatnonzero(identifiable & ~good):
        print(f"  missed: truth {10 ** shots[i].truth}, errors {clean[i]}, bound at 0.1 % noise {sharp[i]}")
    for weights in ("learnt", "equal"):
        ratios, inside = [], []
        for number, case in enumerate(shots):
            how = {"window": window, "weights": weights, "bubble": "field", "workers": 1}
            answer = fit(case.noisy(given.noise, number), **how)
            if answer.checks.verdict == "failed":
                continue
            limit = bound(case, window, given.noise)
            ratios.append(error(answer, case) / limit)
            for name, value in zip(("shear_modulus", "viscosity"), 10 ** case.truth[:2], strict=True):
                low, high = answer.interval(name) or (np.nan, np.nan)
                inside.append(low <= value <= high)
        far = int(np.sum(np.max(np.abs(ratios), axis=1) > 5))
        rms = np.sqrt(np.median(np.array(ratios) ** 2, axis=0)) / 0.6745  # robust: of a normal distribution 1
        print(
            f"{given.noise:.1%} noise, weights {weights}: error over the Cramer-Rao bound (robust rms) of G, mu, "
            f"stretch {rms}, {far} shots beyond 5 bounds; "
            f"truth within the 90 % interval: {np.mean(inside):.0%} of {len(inside)}"
        )


if __name__ == "__main__":
    main()
