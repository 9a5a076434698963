"""Accuracy and speed of the forward solver, beside the field's standard way, in one run on one core.

    python benchmarks/solver.py [--cases 12] [--standard 4] [--reference ../shared/reference/reference_curves.npz]

Cases are drawn from log10 G in [3, 6], log10 mu in [-3, 0], lambda in [3, 11], R_max in [60, 450] um, 100 us, 1 MHz.
Errors are the largest difference of R/R_max to the package's own solver at 1024 shells and rtol 1e-8 (and, if the file
is there, to reference curves made with other code). The standard way is 500 uniform nodes, mass fractions, scipy's BDF
with a sparse Jacobian at rtol 1e-6 (benchmarks/field_standard.py); it takes seconds per curve, hence `--standard` cases
of it only.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import field_standard
import numpy as np

from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.scales import dimensionless
from cavirheo.physics.simulate import simulate

TIME = np.linspace(0, 100e-6, 101)


def draw(n: int, seed: int) -> np.ndarray:
    """(n, 4) G Pa, mu Pa s, lambda, R_max m."""
    theta = np.random.default_rng(seed).uniform([3, -3, 3, 60e-6], [6, 0, 11, 450e-6], (n, 4))
    theta[:, :2] = 10 ** theta[:, :2]
    return theta


def ours(row: np.ndarray, medium: Medium = WATER, time_points: np.ndarray = TIME, **settings: float) -> np.ndarray:
    G, mu, stretch, R_max = row
    run = simulate(
        NeoHookeanKelvinVoigt(G, mu), max_radius=R_max, stretch=stretch, time=time_points, medium=medium, **settings
    )
    return run.radius / R_max


def timed(call) -> tuple[np.ndarray, float]:
    began = time.perf_counter()
    value = call()
    return value, 1e3 * (time.perf_counter() - began)


def show(name: str, errors: list[float], milliseconds: list[float]) -> None:
    e, t = np.array(errors), np.array(milliseconds)
    print(
        f"| {name} | {np.median(e):.1e} | {e.max():.1e} | {np.median(t):.3g} | {np.percentile(t, 95):.3g} | {len(e)} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--standard", type=int, default=4)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--reference", type=Path, default=Path("../shared/reference/reference_curves.npz"))
    options = parser.parse_args()
    cases = draw(options.cases, options.seed)
    ours(cases[0])  # compile or load
    truth = [ours(row, cells=1024, rtol=1e-8) for row in cases]
    print("| way | error median | largest | ms median | ms 95 % | curves |\n|---|---|---|---|---|---|")
    for name, settings in {
        "cavirheo, default (128 shells, rtol 3e-5)": {},
        "cavirheo, 64 shells, rtol 3e-4": {"cells": 64, "rtol": 3e-4},
        "cavirheo, 256 shells, rtol 1e-6": {"cells": 256, "rtol": 1e-6},
    }.items():
        runs = [timed(lambda row=row, settings=settings: ours(row, **settings)) for row in cases]
        show(name, [np.abs(run - t).max() for (run, _), t in zip(runs, truth, strict=True)], [ms for _, ms in runs])
    errors, times = [], []
    for row, t in list(zip(cases, truth, strict=True))[: options.standard]:
        G, mu, stretch, R_max = row
        numbers = dimensionless(NeoHookeanKelvinVoigt(G, mu), WATER, R_max, stretch)
        t_c = WATER.time_scale(R_max)
        run, ms = timed(
            lambda numbers=numbers, t_c=t_c, G=G, mu=mu: field_standard.solve(
                numbers, np.linspace(0, 1, 500), TIME / t_c, 1e-6, G / WATER.pressure, mu / (WATER.pressure * t_c)
            )
        )
        errors.append(np.abs(run - t).max())
        times.append(ms)
    if times:
        show("field's standard: 500 uniform nodes, BDF", errors, times)
    if options.reference.is_file():
        data = np.load(options.reference)
        c = json.loads(str(data["conditions"]))
        medium = Medium(c["rho"], c["c"], c["gamma"])
        print("\nReference curves of other code (the reference is itself good to about `ref`):\n")
        print("| G Pa | mu Pa s | lambda | R_max um | error | ref | ms |\n|---|---|---|---|---|---|---|")
        errors = []
        for row, R, err in zip(data["params"], data["R"], data["err"], strict=True):
            run, ms = timed(lambda row=row: ours(row, medium, data["t"]))
            errors.append(np.abs(run - R / row[3]).max())
            case = f"{row[0]:.3g} | {row[1]:.3g} | {row[2]:.2f} | {row[3] * 1e6:.0f}"
            print(f"| {case} | {errors[-1]:.1e} | {err:.1e} | {ms:.1f} |")
        print(f"\nlargest {max(errors):.1e}, median {np.median(errors):.1e}")


if __name__ == "__main__":
    main()
