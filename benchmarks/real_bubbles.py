"""Real recordings, answered with the field's bubble and with the real one: the fits behind docs/real-bubbles.md.

    python benchmarks/real_bubbles.py FOLDER --keep results.json [--only fits,ahead] [--sets PEG,PA] [--shots 5]

FOLDER holds a folder for each set of SETS. No shot is left out, and nothing is set for a set but its law. Every answer
is kept in the file of --keep as it is found, and none is computed twice; benchmarks/real_bubbles_report.py makes tables
and pictures of that file.

Fits are those of `cavirheo fit` with its defaults, over three collapses or as many as were recorded. The evidence says
whether a bubble with further parameters is worth them; predictions (`run_ahead`) have no parameter to spare.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, SolverError
from cavirheo.inference import fit_many
from cavirheo.inference.assumptions import Family, Options
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.what_if import predict_radius
from cavirheo.io import read_curves
from cavirheo.physics.bubble import FIELD, FREE, REAL, Bubble
from cavirheo.physics.laws import Newtonian
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.posterior import Posterior

USUAL: dict[str, Any] = {"trust_input": True, "workers": 1}
BUBBLES = {
    "field": FIELD,
    "kinetic": Bubble("kinetic"),
    "damping": Bubble(confinement_damping=FREE),
    "real": REAL,
}
FREED = ("accommodation", "confinement_damping")  # what the real bubble has beyond the field's
RHEOMETER = {"PEG 10 w/v %": 0.0064, "PEG 40 w/v %": 0.130, "water": 0.001}  # Pa s
PUBLISHED = {"PEG 10 w/v %": (0.047, 0.016), "PEG 40 w/v %": (0.111, 0.023)}  # Pa s, mean and standard deviation (IMR)
LATE = (3.0, 8.0, 0.25)  # a shot rises late if the median of R/R_max between the first two t* exceeds the third
SPEED = WATER.sound_speed / WATER.velocity_scale


class Set(NamedTuple):
    """A set of recordings: its files and its law, the simplest that there is."""

    files: str
    material: str


SETS = {
    "PEG 40 w/v %": Set("peg8000_40wv/*.mat", "newtonian"),
    "PEG 10 w/v %": Set("peg8000_10wv/*.mat", "newtonian"),
    "stiff PA": Set("pa_stiff/*[!E].mat", "nhkv"),  # not the file in a wrong scale
    "alginate": Set("paam_alginate_0p3/*.mat", "nhkv"),
    "agarose 0.5 %": Set("agarose_0p5/2E*.mat", "nhkv"),
    "agarose 2.5 %": Set("agarose_2p5/2E*.mat", "nhkv"),
    "PEGDA 0.05": Set("pegda_S3/*.mat", "nhkv"),
    "PEGDA 0.10": Set("pegda_S4/*.mat", "nhkv"),
}
PURE_WATER = Set("water_laser/*.csv", "newtonian")
WATER_MODELS = {
    "clock, R_max": FIELD,
    "walls": Bubble(confinement_inertia=FREE),
    "damping": BUBBLES["damping"],
    "walls, damping": Bubble(confinement_damping=FREE, confinement_inertia=FREE),
    "kinetic, walls, damping": replace(REAL, confinement_inertia=FREE),
}


def read_set(folder: Path, about: Set) -> list[RadiusCurve]:
    return [curve for file in sorted(folder.glob(about.files)) for curve in read_curves(file)]


def rises_late(curve: RadiusCurve) -> bool:
    """Seen before any fit; a curve that ends before that time does not."""
    t = (curve.time - curve.time_of_max) / WATER.time_scale(curve.max_radius)
    late = (t > LATE[0]) & (t < LATE[1]) & np.isfinite(curve.radius)
    return bool(late.any() and np.median(curve.radius[late]) > LATE[2] * curve.max_radius)


# --- growth against collapse, without a fit

_LEVELS = np.arange(0.5, 0.96, 0.05)  # of R_max, at which growth and collapse are compared


def growth(curve: RadiusCurve) -> tuple[float, float]:
    """Even and odd part: half the time between equal radii over that of water's first collapse; and gamma, with which
    the middle of that time moves, gamma t^2/6 (docs/method/physics.md, section 2). NaN where no growth is recorded."""
    seen, t_c = np.isfinite(curve.radius), WATER.time_scale(curve.max_radius)
    t, r = (curve.time[seen] - curve.time_of_max) / t_c, curve.radius[seen] / curve.max_radius
    up, down = np.full((2, len(_LEVELS)), np.nan)
    for k, level in enumerate(_LEVELS):
        for i in np.flatnonzero((r[:-1] - level) * (r[1:] - level) <= 0):
            at = t[i] + (level - r[i]) / (r[i + 1] - r[i]) * (t[i + 1] - t[i])
            if at < 0:
                up[k] = -at  # the last one
            elif np.isnan(down[k]):
                down[k] = at
    known = np.isfinite(up + down)
    if np.count_nonzero(known) < 6:
        return np.nan, np.nan
    even, odd = (up + down)[known] / 2, (down - up)[known] / 2
    instants = np.linspace(0, 0.9, 400)
    water = simulate(Newtonian(1e-3), max_radius=3e-4, stretch=8.0, time=instants * WATER.time_scale(3e-4))
    ideal = np.interp(-_LEVELS[known], -water.radius / 3e-4, instants)
    shift = np.linalg.lstsq(np.column_stack([np.ones(len(even)), even**2]), odd, rcond=None)[0][1]
    return float(even @ ideal / (ideal @ ideal)), float(6 * shift)


def resistance(radius: float, gamma: float, viscosity: float) -> float:
    """zeta of growth and collapse: gamma less that of the viscosity, 4/Re."""
    return gamma - 4 * viscosity * WATER.velocity_scale / (WATER.pressure * radius)


def cross_section(found: list[list[float]], viscosity: float) -> float:
    """A in m2, of the median of zeta/R_max^2 over the shots (R_max in um, even, gamma)."""
    ratios = [resistance(1e-6 * R, gamma, viscosity) / (1e-6 * R) ** 2 for R, _, gamma in found]
    return float(2 * np.pi * SPEED / np.nanmedian(ratios))


# --- one fit


def fitted(curve: RadiusCurve, law: str, **model: Any) -> Posterior:
    return fit_many([curve], law, **{**USUAL, **model})[0]


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def record(curve: RadiusCurve, answer: Posterior) -> dict[str, Any]:
    """One answer for JSON. cycles: RMS residual from collapse to collapse, % of R_max."""
    checks: Any = answer.checks
    if not answer.best:
        return {"verdict": "failed", "message": checks.message}
    part = np.searchsorted(curve.collapse_times(), checks.compared_time)
    names = [name for name in ("shear_modulus", "viscosity") if name in answer.parameters]
    return {
        "rmax_um": 1e6 * curve.max_radius, "rmse": 100 * checks.rmse_over_rmax, "verdict": checks.verdict,
        "best": {name: float(value) for name, value in answer.best.items()},
        "intervals": {name: answer.interval(name) for name in names},
        "evidence": answer.evidence.log if answer.evidence else None,
        "cycles": [100 * rms(checks.residual_over_rmax[part == k]) for k in range(part.max() + 1)],
    }  # fmt: skip


# --- what is computed


class Kept:
    """Records by name, written after each; what is there is not computed again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.found: dict[str, Any] = json.loads(path.read_text("utf-8")) if path.exists() else {}

    def __call__(self, name: str, make: Callable[..., Any], *given: Any, **more: Any) -> Any:
        if name not in self.found:
            began = time.process_time()
            self.found[name] = made = make(*given, **more)
            self.path.write_text(json.dumps(self.found), encoding="utf-8")
            short = {k: made[k] for k in ("rmse", "ahead", "evidence") if k in made} if isinstance(made, dict) else ""
            print(f"{name} {short} {time.process_time() - began:.1f} s", flush=True)
        return self.found[name]


Sets = dict[str, list[RadiusCurve]]


def run_growth(kept: Kept, sets: Sets) -> None:
    for name, curves in sets.items():
        kept(f"growth/{name}", lambda shots: [(1e6 * c.max_radius, *growth(c)) for c in shots], curves)


def one(curve: RadiusCurve, material: str, bubble: Bubble) -> dict[str, Any]:
    return record(curve, fitted(curve, material, bubble=bubble))


def run_fits(kept: Kept, sets: Sets) -> None:
    """Every bubble in every shot."""
    for name in (name for name in SETS if name in sets):
        for i, curve in enumerate(sets[name]):
            kept(f"late/{name}/{i}", rises_late, curve)
            for word, bubble in BUBBLES.items():
                kept(f"fit/{name}/{word}/{i}", one, curve, SETS[name].material, bubble)


def ahead(curve: RadiusCurve, material: str, bubble: Bubble) -> dict[str, Any]:
    """RMS of the frames after the first rebound's maximum, % of R_max, predicted from a fit to those before, by the
    mean over its draws."""
    answer = fitted(curve, material, window=1, bubble=bubble)
    if not answer.best:
        return {"verdict": "failed", "message": answer.checks.message}
    shot = Experiment(curve, Family(answer.material), options=Options(bubble=answer.bubble))
    later = shot.counted & (shot.time_since_max > shot.cut_to(1).time_since_max[-1])
    mean = np.nan
    with suppress(InputError, SolverError):  # a point, or what cannot be simulated so far
        predicted = predict_radius(curve, answer, shot.time_since_max[later] + curve.time_of_max).mean
        mean = rms(shot.measured[later] - predicted / curve.max_radius)
    return {
        "frames": int(np.sum(later)),
        "ahead": 100 * mean,
        "best": {name: float(value) for name, value in answer.best.items()},
    }


def run_ahead(kept: Kept, sets: Sets) -> None:
    """The field's bubble against the real one, in every shot that shows a second collapse; and against one that has
    the median accommodation and damping of the other shots of the set, so with no more parameters than the field's."""
    for name in (name for name in SETS if name in sets):
        real = {i: kept.found.get(f"fit/{name}/real/{i}", {}).get("best") for i in range(len(sets[name]))}
        for i, curve in enumerate(sets[name]):
            others = [best for j, best in real.items() if best and j != i]
            given = {x: float(np.median([best[x] for best in others])) for x in FREED} if others else {}
            bubbles = {"field": FIELD, "real": REAL, "others": replace(REAL, **given)}
            for word, bubble in bubbles.items() if len(curve.collapse_times()) > 1 else ():
                kept(f"ahead/{name}/{word}/{i}", ahead, curve, SETS[name].material, bubble)


def verified(curve: RadiusCurve, bubble: Bubble) -> dict[str, Any]:
    return record(curve, fitted(curve, "newtonian", stretch="free", bubble=bubble))


def run_water(kept: Kept, sets: Sets) -> None:
    """First collapses in water by the posterior: does the interval of mu hold 0.001 Pa s?"""
    for word, bubble in WATER_MODELS.items():
        for i, curve in enumerate(sets.get("water", [])):
            kept(f"water/{word}/{i}", verified, curve, bubble)


RUNS = {"growth": run_growth, "fits": run_fits, "ahead": run_ahead, "water": run_water}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--keep", type=Path, required=True)
    parser.add_argument("--only", default=",".join(RUNS), help=f"of {', '.join(RUNS)}, in this order")
    parser.add_argument("--sets", default="", help="words of the sets' names, with commas")
    parser.add_argument("--shots", type=int, help="at most so many of a set")
    given = parser.parse_args()
    words = given.sets.split(",")
    chosen = {name: about for name, about in {**SETS, "water": PURE_WATER}.items() if any(w in name for w in words)}
    sets = {name: read_set(given.folder, about)[: given.shots] for name, about in chosen.items()}
    for name in given.only.split(","):
        RUNS[name](Kept(given.keep), sets)


if __name__ == "__main__":
    main()
