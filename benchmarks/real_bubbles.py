"""Real recordings and what the field's model of the bubble lacks: the fits behind docs/real-bubbles.md.

    python benchmarks/real_bubbles.py FOLDER --keep results.json [--only fits,ahead] [--sets PEG,PA] [--shots 5]

FOLDER holds a folder for each set of SETS, which says the files, the models that are fitted, and whether shots are left
out by a rule that sees the recording only. Every answer is kept in the file of --keep as it is found, and none is
computed twice; benchmarks/real_bubbles_report.py makes tables and pictures of that file.

Fits are those of `cavirheo fit` over three collapses, lambda free of what a file states. chi2 is the mean square of
(measured - simulated)/sigma with the weights "motion", the same for all models. A model with further parameters must
fit better; whether by enough tells the evidence, and predictions (`run_ahead`) have no parameter to spare.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.inference import infer_many
from cavirheo.inference.experiment import Experiment
from cavirheo.inference.fit import fit_many
from cavirheo.inference.law import Family
from cavirheo.inference.noise import Noise
from cavirheo.inference.options import Options
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER
from cavirheo.physics.simulate import simulate
from cavirheo.physics.viscous import Newtonian
from cavirheo.posterior import Posterior
from cavirheo.reading import read_curves

Model = dict[str, Any]
USUAL: Model = {"stretch": "free", "windows": False, "others": False, "trust_input": True, "workers": 1}
KINETIC: Model = {"contents": "kinetic"}
WALLS: Model = {"confinement_inertia": "free"}
SOUND: Model = {"sound": True}  # confinement_damping of the cross-section that growth and collapse in PEG 10 show
THIN: Model = {"material": "power-law"}
RHEOMETER = {"PEG 10 w/v %": 0.0064, "PEG 40 w/v %": 0.130, "water": 0.001}  # Pa s
LATE = (3.0, 8.0, 0.25)  # a shot rises late if the median of R/R_max between the first two t* exceeds the third
RATE = 1e5  # 1/s, at which the viscosity of a shear-thinning law is stated
SPEED = WATER.sound_speed / WATER.velocity_scale


class Set(NamedTuple):
    """A set of recordings: files, law, what is fitted; are late risers left out, is the clock free by a frame."""

    files: str
    material: str
    models: dict[str, Model]
    late: bool = False
    clock: bool = False


GEL: dict[str, Model] = {"equilibrium": {}, "kinetic": KINETIC}
MOTION: Model = {"weights": "motion"}  # those that chi2 is stated with, instead of the learnt ones
WEIGHED: dict[str, Model] = {**GEL, "equilibrium, motion": MOTION, "kinetic, motion": {**KINETIC, **MOTION}}
HURT: Model = {**KINETIC, "damage": "strain"}
FUNG: Model = {"material": "fung + newtonian"}
DAMAGE: dict[str, Model] = {"first-rebound": {"damage": "first-rebound"}, "strain": {"damage": "strain"}}
LIQUID: dict[str, Model] = {
    **GEL, "kinetic, walls": {**KINETIC, **WALLS}, "sound": SOUND, "kinetic, sound": {**KINETIC, **SOUND},
    "kinetic, walls, sound": {**KINETIC, **WALLS, **SOUND}, "power-law": THIN, "power-law, sound": {**THIN, **SOUND},
    "power-law, free sound": {**THIN, "confinement_damping": "free"},
}  # fmt: skip
SETS = {
    "stiff PA": Set("pa_stiff/*[!E].mat", "nhkv", WEIGHED, clock=True),  # not the file in a wrong scale
    "alginate": Set("paam_alginate_0p3/*.mat", "nhkv", WEIGHED, clock=True),
    "agarose 0.5 %": Set("agarose_0p5/2E*.mat", "nhkv", {**GEL, **DAMAGE, "kinetic, strain": HURT}),
    "agarose 2.5 %": Set("agarose_2p5/2E*.mat", "nhkv", {"equilibrium": {}, "fung": FUNG, **DAMAGE}),
    "PEG 40 w/v %": Set("peg8000_40wv/*.mat", "newtonian", LIQUID),
    "PEG 10 w/v %": Set("peg8000_10wv/*.mat", "newtonian", LIQUID, late=True),
}  # fmt: skip
PURE_WATER = Set("water_laser/*.csv", "newtonian", {})
WATER_MODELS: dict[str, Model] = {
    "clock, R_max": {}, "walls": WALLS, "sound": {"confinement_damping": "free"},
    "walls, sound": {**WALLS, "confinement_damping": "free"},
    "kinetic, walls, sound": {**KINETIC, **WALLS, "confinement_damping": "free"},
}  # fmt: skip


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


def fitted(curve: RadiusCurve, law: str, area: float = np.inf, **model: Any) -> Posterior:
    if model.pop("sound", False):
        model["confinement_damping"] = 2 * np.pi * curve.max_radius**2 / area * SPEED
    return fit_many([curve], **{**USUAL, "material": law, **model})[0]


def laid(curve: RadiusCurve, answer: Posterior, **window: Any) -> tuple[Experiment, Floats]:
    """The experiment with the weights "motion" of the simulated motion, and measured minus simulated over R_max."""
    wide = 2 * float(np.median(np.diff(curve.time)))  # so that no clock is clipped
    options = Options(stretch="free", weights="motion", t0_bound=wide, scale_bound=0.19, bubble=answer.bubble, **window)
    shot = Experiment(curve, Family(answer.material), options=options)
    seen = shot.predict(shot.from_best(answer.best))
    if seen is None:
        return shot, np.full(len(shot.measured), np.nan)
    shot.weigh(seen.speed)
    return shot, shot.measured - seen.radius


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def record(curve: RadiusCurve, answer: Posterior) -> dict[str, Any]:
    """One answer for JSON. cycles: RMS residual from collapse to collapse; density: log, residuals correlated."""
    if not answer.best:
        return {"verdict": "failed", "message": answer.checks.message}
    shot, missed = laid(curve, answer)
    kept, best = shot.counted, {name: float(value) for name, value in answer.best.items()}
    if "viscosity" not in best:  # of a power law
        best["viscosity"] = best["consistency"] * RATE ** (best["exponent"] - 1)
    part = np.searchsorted(curve.collapse_times() - curve.time_of_max, shot.since)
    noise = Noise(shot.sigma[kept], shot.since[kept], shot.time_scale, True)
    return {
        "rmax_um": 1e6 * curve.max_radius,
        "rmse": 100 * rms(missed[kept]),
        "chi2": rms((missed / shot.sigma)[kept]) ** 2,
        "density": float(noise.log_density(missed[None, kept])[0]), "verdict": answer.checks.verdict, "best": best,
        "interval": answer.interval("viscosity") if "viscosity" in answer.parameters else None,
        "evidence": answer.evidence.log if answer.evidence else None,
        "cycles": [100 * rms(missed[kept & (part == k)]) for k in range(part[kept].max() + 1)],
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
            short = {k: made[k] for k in ("rmse", "chi2", "interval") if k in made} if isinstance(made, dict) else ""
            print(f"{name} {short} {time.process_time() - began:.1f} s", flush=True)
        return self.found[name]


Sets = dict[str, list[RadiusCurve]]


def run_growth(kept: Kept, sets: Sets) -> None:
    for name, curves in sets.items():
        kept(f"growth/{name}", lambda shots: [(1e6 * c.max_radius, *growth(c)) for c in shots], curves)


def one(curve: RadiusCurve, material: str, area: float, model: Model) -> dict[str, Any]:
    return record(curve, fitted(curve, material, area, **model))


def freed(curve: RadiusCurve, model: Model) -> Model:
    """The model with the clock free by a frame."""
    return {**model, "t0_bound": float(np.median(np.diff(curve.time)))}


def run_fits(kept: Kept, sets: Sets) -> None:
    """Every model of a set in every shot that does not rise late; after `run_growth`, of PEG 10 at least."""
    name = "PEG 10 w/v %"
    area = cross_section(kept.found[f"growth/{name}"], RHEOMETER[name])
    for name, about in SETS.items():
        for i, curve in enumerate(sets.get(name, [])):
            if not kept(f"late/{name}/{i}", lambda c, rule: rule and rises_late(c), curve, about.late):
                for model, options in about.models.items():
                    way = freed(curve, options) if about.clock else options
                    kept(f"fit/{name}/{model}/{i}", one, curve, about.material, area, way)


def verified(curve: RadiusCurve, model: Model) -> dict[str, Any]:
    return record(curve, fitted(curve, "newtonian", verify="full", **model))


def run_water(kept: Kept, sets: Sets) -> None:
    """First collapses in water by the posterior of `--verify full`: does the interval of mu hold 0.001 Pa s?"""
    for model, options in WATER_MODELS.items():
        for i, curve in enumerate(sets.get("water", [])):
            kept(f"water/{model}/{i}", verified, curve, options)


def ahead(curve: RadiusCurve, accommodation: float) -> dict[str, Any]:
    """Both models of the contents with equally many parameters: of three collapses; and RMS of the frames after the
    first rebound's maximum predicted from those before."""
    found: dict[str, Any] = {}
    for name, model in (("equilibrium", MOTION), ("kinetic", {**KINETIC, **MOTION, "accommodation": accommodation})):
        found[name] = record(curve, fitted(curve, "nhkv", **freed(curve, model)))
        early = fitted(curve, "nhkv", window=1, **freed(curve, model))
        shot, missed = laid(curve, early)
        later = shot.counted & (shot.since > laid(curve, early, window=1)[0].view.end)
        found[name]["ahead"] = 100 * rms(missed[later])
    return found


def run_ahead(kept: Kept, sets: Sets) -> None:
    """Leave one out: the accommodation is the median of that of the other shots of the set."""
    for name in ("stiff PA", "alginate"):
        kinetic = {i: kept.found.get(f"fit/{name}/kinetic, motion/{i}") for i in range(len(sets.get(name, [])))}
        for i, mine in kinetic.items():
            if mine and "best" in mine:
                others = [f["best"]["accommodation"] for j, f in kinetic.items() if j != i and f and "best" in f]
                kept(f"ahead/{name}/{i}", ahead, sets[name][i], float(np.median(others)))


def inferred(curve: RadiusCurve, contents: str) -> dict[str, Any]:
    return record(curve, infer_many([curve], contents=contents, trust_input=True, workers=1)[0])


def run_controls(kept: Kept, _: Sets) -> None:
    """Simulated gels of either contents, answered with both by fit and infer: ten of each, 0.7 % noise, 1 MHz."""
    rng, frames = np.random.default_rng(1), np.arange(100) * 1e-6
    for truth, contents, viscosity in (("kinetic", KINETIC, 0.003), ("equilibrium", {}, 0.03)):
        for i in range(10):
            gel = NeoHookeanKelvinVoigt(float(np.exp(rng.uniform(np.log(3e3), np.log(1e4)))), viscosity)
            top = float(rng.uniform(2e-4, 4e-4))
            run = simulate(gel, max_radius=top, stretch=8.0, time=frames, **contents)
            radius = np.maximum(run.radius + 0.007 * top * rng.normal(size=len(frames)), 0.01 * top)
            curve = replace(RadiusCurve(time=frames, radius=radius), maximum=(0.0, top))
            kept(f"control/{truth}/{i}", asdict, gel)
            for model, options in GEL.items():
                kept(f"control/{truth}/{i}/{model}", one, curve, "nhkv", np.inf, options)
                kept(f"control/{truth}/{i}/infer {model}", inferred, curve, model)


RUNS = {"growth": run_growth, "fits": run_fits, "ahead": run_ahead, "controls": run_controls, "water": run_water}


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
