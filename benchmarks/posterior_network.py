"""The posterior network alone, without simulations: R2 of its medians on curves drawn as the paper's, seen by worse and
worse cameras (with the field's bubble, as theirs is); and coverage of its intervals over its whole prior, of both
bubbles, by noise and noise model. No curve of the training.

python benchmarks/posterior_network.py [-n 150] [--recordings 1000] [-o build/posterior-network.md]
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo import RadiusCurve, infer
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.posterior_network import COORDINATES, coordinate_indices, network_of, z_index
from cavirheo.physics.bubble import FIELD
from cavirheo.physics.materials import MATERIALS
from cavirheo.physics.simulate import simulate_many
from cavirheo.prior import uniforms
from cavirheo.training.recipe import read_recipe
from cavirheo.training.recordings import COLUMNS, film, simulated_curve

SHOWN = ("viscosity", "shear_modulus", "stretch", "accommodation", "confinement_damping")  # of the coverage
SEED = 4242  # of curves; the training has others
RADIUS, FRAME, FRAMES = 245e-6, 1e-6, 100
VIEWS = {  # noise over R_max, clock in frames, every n-th frame, share that is missing, only up to the first rebound
    "clean": (0.0, 0.0, 1, 0.0, False),
    "clock off by up to half a frame": (0.0, 0.5, 1, 0.0, False),
    "1 % noise": (0.01, 0.5, 1, 0.0, False),
    "2 % noise": (0.02, 0.5, 1, 0.0, False),
    "half the rate": (0.0, 0.5, 2, 0.0, False),
    "10 % missing": (0.0, 0.5, 1, 0.1, False),
    "first collapse only": (0.0, 0.5, 1, 0.0, True),
}


def seen(number: int, radius: np.ndarray, view: tuple, fine: int) -> RadiusCurve:
    """A curve of radii at steps of FRAME/fine as a camera shows it."""
    noise, clock, every, missing, early = view
    rng = np.random.default_rng([SEED, number])
    late = round(fine * clock * (2.0 * rng.uniform() - 1.0))
    at = np.abs(np.arange(0, FRAMES, every) * fine + late)
    y = radius[at] + noise * RADIUS * rng.standard_normal(len(at))
    y[(rng.uniform(size=len(at)) < missing) & (np.arange(len(at)) > 0)] = np.nan
    y[y < 0.01 * RADIUS] = np.nan
    time = np.arange(0, FRAMES, every) * FRAME
    curve = RadiusCurve(time, y, meta={"name": f"{number}"})
    if early and len(curve.collapse_times()):
        end = 1.35 * float(curve.collapse_times()[0] - curve.time_of_max)
        keep = time <= max(end, 14 * FRAME)
        curve = RadiusCurve(time[keep], y[keep], meta={"name": f"{number}"})
    return curve


def r2_table(n: int, weighed: bool = False) -> list[str]:
    draws = np.array([uniforms(SEED, i, 3, 5) for i in range(n)])
    logs = np.column_stack([3 + 3 * draws[:, 0], -3 + 3 * draws[:, 1]])
    stretch = 3 + 8 * draws[:, 2]
    fine = 40
    materials = [MATERIALS["nhkv"](shear_modulus=10**g, viscosity=10**m) for g, m in logs]
    times = np.arange(FRAMES * fine) * (FRAME / fine)
    runs = simulate_many(materials, max_radius=RADIUS, stretch=stretch, time=times)
    exact: Any = {"discrepancy": False, "trust_input": True, "bubble": FIELD}
    alone = Analysis(material="nhkv", window="all", **exact)
    rows = [f"| {n} curves drawn as the paper's | answered | R2 of log G | R2 of log mu |", "|---|---|---|---|"]
    for name, view in VIEWS.items():
        truth, found = [], []
        for i, run in enumerate(runs):
            if not run.ok:
                continue
            try:
                curve = seen(i, run.radius, view, fine)
                answer = infer(curve, **exact) if weighed else alone.starts(curve)[0]
            except Exception:
                continue
            if answer.checks.verdict != "failed" and answer.log_q is not None:
                truth.append(logs[i])
                found.append(np.log10([answer.median("shear_modulus"), answer.median("viscosity")]))
        left = np.sum((np.array(found) - truth) ** 2, axis=0)
        whole = np.sum((np.array(truth) - np.mean(truth, axis=0)) ** 2, axis=0)
        g, m = 1.0 - left / whole
        rows.append(f"| {name} | {len(found)} | {g:.3f} | {m:.3f} |")
        print(rows[-1], flush=True)
    return rows


class Distance(NamedTuple):
    """Of the truth from the middle of the draws: below 0.9 if a 90 % interval holds it."""

    coordinate: int
    noise: float
    slow: bool
    distance: float


def distances(recordings: int) -> list[Distance]:
    """Of each parameter of curves drawn from the whole prior, with either bubble."""
    recipe = read_recipe(Path(__file__).parent.parent / "recipes" / "posterior.toml")
    table = recipe.problem.model_copy(update={"max_radius_um": (30.0, 600.0)})
    kinds, model = table.kinds, network_of()
    made: list = []
    index = 0
    while len(made) < 2 * recordings:
        one = simulated_curve(table, SEED, index)
        index += 1
        made += [one] if one is not None else []
    columns = zip(COLUMNS.items(), zip(*made, strict=True), strict=True)
    store = {name: np.array(column, kind) for (name, (kind, _)), column in columns}
    shown = film(store, np.arange(len(made)), SEED)
    rng = np.random.default_rng(SEED)
    found = []
    for i in range(min(recordings, len(shown.z))):
        z = model.sample(shown.inputs[i : i + 1], int(shown.kind[i]), 400, rng, {})
        below = np.mean(z < shown.z[i], axis=0)
        about = float(shown.noise[i]), bool(shown.discrepancy[i])
        found += [Distance(k, *about, abs(2 * below[k] - 1)) for k in coordinate_indices(*kinds[shown.kind[i]][:2])]
    return found


def coverage(recordings: int) -> list[str]:
    off = distances(recordings)
    ends = np.quantile([one.noise for one in off], [0, 1 / 3, 2 / 3, 1])
    rows = ["| slot | noise | noise model | 50 % | 90 % |", "|---|---|---|---|---|"]
    for k in map(z_index, SHOWN):
        for a, b in pairwise(ends):
            for slow in (False, True):
                mine = [one for one in off if one.coordinate == k and a <= one.noise <= b and one.slow == slow]
                some = np.array([one.distance for one in mine])
                words = "white and slow" if slow else "white"
                shares = f"{np.mean(some < 0.5):.0%} | {np.mean(some < 0.9):.0%}"
                rows.append(f"| {COORDINATES[k]} | {a:.2%} to {b:.2%} | {words} | {shares} |")
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=150)
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--default", action="store_true", help="R2 of the answer of infer, weighed by simulations")
    parser.add_argument("-o", type=Path, default=Path("build/posterior-network.md"))
    given = parser.parse_args()
    tables = r2_table(given.n, True) if given.default else [*r2_table(given.n), "", *coverage(given.recordings)]
    text = "\n".join(tables) + "\n"
    given.o.parent.mkdir(parents=True, exist_ok=True)
    given.o.write_text(text)
    print(text)
