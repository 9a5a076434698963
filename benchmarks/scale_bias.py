"""Does the answer depend on the true R_max? Simulated shots with R_max independent of everything else.

    python benchmarks/scale_bias.py [--shots 300] [--noise 0.0] [--model NAME]

Draws G, mu and lambda from the training prior and R_max uniformly from 60-450 um, films each shot at 1 Mfps from the
maximum on, and reports the bias of log10 mu and log10 G in three terciles of R_max: for the network's answer
scaled at equal Cauchy and Reynolds numbers, and for the answer corrected at the true scale (the default). First it
shows what is at stake without any network: curves of one R_max fitted (least squares in G, mu, lambda at equal Ca and
Re) as if they were of 245 um.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.optimize import least_squares

from cavirheo.curve import RadiusCurve
from cavirheo.inference.amortised import Amortised
from cavirheo.inference.model import DEFAULT, load
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate


def shots(n: int, noise: float, seed: int) -> tuple[np.ndarray, list[RadiusCurve]]:
    """(n, 4) log10 G, log10 mu, lambda, R_max, and the curves."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform([3, -3, 3, 60e-6], [6, 0, 11, 450e-6], (n, 4))
    curves = []
    for k, (G, mu, stretch, R_max) in enumerate(truth):
        end = 4.3 * WATER.time_scale(R_max)
        time = 1e-6 * (np.arange(int(end / 1e-6) + 1) + rng.uniform())
        run = simulate(NeoHookeanKelvinVoigt(10**G, 10**mu), max_radius=R_max, stretch=stretch, time=time)
        radius = run.radius + noise * R_max * rng.standard_normal(len(time))
        radius[radius <= 0] = np.nan
        meta = {"name": f"shot {k}", "maximum": (0.0, R_max)}  # R_max known: its own error is not what is asked here
        curves.append(RadiusCurve(time, radius, meta=meta))
    return truth, curves


def misread(R_max: float, n: int, seed: int) -> np.ndarray:
    """(n, 3) errors of log10 G, log10 mu, lambda when curves of R_max (m) are fitted as if of 245 um."""
    rng = np.random.default_rng(seed)
    t_star = np.linspace(0.0, 4.07, 100)

    def curve(theta: np.ndarray, R: float) -> np.ndarray:
        material = NeoHookeanKelvinVoigt(10 ** theta[0], 10 ** theta[1] * R / 245e-6)  # theta at 245 um
        time = t_star * WATER.time_scale(R)
        run = simulate(material, max_radius=R, stretch=theta[2], time=time, cells=64, rtol=3e-4, throw=False)
        return np.nan_to_num(run.radius / R, nan=1.0)

    errors = []
    for theta in rng.uniform([3, -3, 3], [6, 0, 11], (n, 3)):
        target = curve(theta, R_max)
        bounds = ([1, -4.5, 1.5], [7, 2, 16])
        found = least_squares(
            lambda x, target=target: curve(x, 245e-6) - target, theta, bounds=bounds, diff_step=1e-3, max_nfev=15
        )
        errors.append(found.x - theta)
    return np.array(errors)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--shots", type=int, default=300)
    parser.add_argument("--noise", type=float, default=0.0)
    parser.add_argument("--model", default=DEFAULT)
    parser.add_argument("--fits", type=int, default=40)
    parser.add_argument("--seed", type=int, default=20)
    options = parser.parse_args()
    print("Curves of R_max fitted as if of 245 um, median error\n")
    print("| R_max um | log10 G | log10 mu | lambda |\n|---|---|---|---|")
    for micrometres in (60, 100, 150, 350, 450):
        error = np.median(misread(micrometres * 1e-6, options.fits, options.seed), axis=0)
        print(f"| {micrometres} | " + " | ".join(f"{value:+.3f}" for value in error) + " |")
    print()
    truth, curves = shots(options.shots, options.noise, options.seed)
    order = np.argsort(truth[:, 3])
    print(f"{options.shots} shots, noise {options.noise:g} R_max, model {options.model}")
    for correct in (False, True):
        estimator = Amortised(load(options.model), correct=correct)
        with ThreadPoolExecutor() as pool:
            answers = list(pool.map(estimator.infer, curves))
        failed = [a for a in answers if a.checks.verdict == "failed"]
        found = np.array([a.theta[0] if len(a.theta) else (np.nan, np.nan) for a in answers])
        error = found - truth[:, :2]
        way = "corrected at the true scale (default)" if correct else "network alone, equal Ca and Re"
        print(f"\n{way}, {len(failed)} failed\n")
        print("| R_max um | bias log10 mu | bias log10 G | abs. error log10 mu | abs. error log10 G |")
        print("|---|---|---|---|---|")
        for part in np.array_split(order, 3):
            bias, spread = np.nanmedian(error[part], axis=0), np.nanmedian(np.abs(error[part]), axis=0)
            low, high = truth[part, 3].min() * 1e6, truth[part, 3].max() * 1e6
            numbers = " | ".join(f"{value:+.3f}" for value in (bias[1], bias[0], spread[1], spread[0]))
            print(f"| {low:.0f}-{high:.0f} | {numbers} |")
        for reason in sorted({a.checks.message for a in failed}):
            print("  failed:", reason)


if __name__ == "__main__":
    main()
