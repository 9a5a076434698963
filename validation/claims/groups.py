"""Does the line of a group hold the truth? Simulated groups with errors that all shots share, and spoiled ones.

Clean: 5 to 12 shots of one neo-Hookean gel (500 Pa to 50 kPa, 5 mPa s to 0.5 Pa s) with the bubbles and cameras of
calibration.py; the scale and the density of a group are wrong by 1 % and its frame rate by 0.1 %, standard deviations.
Thinning: the same of a liquid with this viscosity at 1e5 1/s and an exponent of 0.4 to 0.9. Spoiled: five such shots of
a gel of 2 to 20 kPa and 0.02 to 0.2 Pa s, each of KINDS. `wrong`: lines without a doubt whose G or mu misses the truth
by more than a factor 1.3 beyond the interval.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from cavirheo import NeoHookeanKelvinVoigt, RadiusCurve, infer_many
from cavirheo.errors import SolverError
from cavirheo.physics.materials import Material
from cavirheo.reporting import result
from validation.claims import calibration
from validation.numbers import SEED, Number, Run, coverage, share, statistic

LEVEL, FACTOR = 0.9, 1.3
SHARED = {"scale": 0.01, "rate": 0.001, "density": 0.01}
ASKED = ("shear_modulus", "viscosity")
WITHOUT_DOUBT = ("ok", "bound")


def shots(law: Material, count: int, rng: np.random.Generator) -> list[RadiusCurve]:
    """Recordings of one material by a camera of 1 % noise."""
    made = list[RadiusCurve]()
    while len(made) < count:
        bubble = calibration.real_bubble(rng)
        stretch, top = float(rng.uniform(4.0, 11.0)), float(rng.uniform(100e-6, 400e-6))
        name = f"shot {len(made) + 1}"
        try:
            made.append(
                calibration.film(law, top, stretch, calibration.NOISE, rng, name, as_read=True, bubble=bubble)[1]
            )
        except SolverError:  # a gel so stiff cannot be so large
            continue
    return made


def scaled(curve: RadiusCurve, radius: float = 1.0, time: float = 1.0) -> RadiusCurve:
    return replace(curve, radius=curve.radius * radius, time=curve.time * time)


def seen_as_one(curve: RadiusCurve, rng: np.random.Generator) -> RadiusCurve:
    """Two bubbles, of which the second is smaller and slower."""
    other = np.interp(curve.time, curve.time * rng.uniform(1.1, 1.4), curve.radius)
    return replace(curve, radius=np.maximum(curve.radius, rng.uniform(0.7, 0.9) * other))


def out_of_round(curve: RadiusCurve, rng: np.random.Generator) -> RadiusCurve:
    """A shape that changes with the radius by 6 %."""
    phase, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(6.0, 12.0)
    return replace(curve, radius=curve.radius * (1.0 + 0.06 * np.sin(phase + speed * curve.time / curve.time[-1])))


def late(curve: RadiusCurve, rng: np.random.Generator) -> RadiusCurve:
    first = int(rng.integers(4, 9))
    return replace(curve, time=curve.time[first:], radius=curve.radius[first:], radius_std=curve.radius_std[first:])


KINDS: dict[str, Callable[[RadiusCurve, np.random.Generator], RadiusCurve]] = {
    "scale too large": lambda curve, rng: scaled(curve, radius=1.1),
    "scale too small": lambda curve, rng: scaled(curve, radius=0.9),
    "rate too high": lambda curve, rng: scaled(curve, time=0.9),
    "rate too low": lambda curve, rng: scaled(curve, time=1.1),
    "density": lambda curve, rng: scaled(curve, time=np.sqrt(1060.0 / 998.0)),
    "two materials": lambda curve, rng: curve,
    "two bubbles": seen_as_one,
    "smoothed": lambda curve, rng: replace(curve, radius=savgol_filter(curve.radius, 7, 3)),
    "late": late,
    "out of round": out_of_round,
}


def answered(curves: list[RadiusCurve], seed: int) -> tuple[str, dict[str, tuple[float, float]]]:
    """The verdict of the group, and the ends of its 90 % intervals, 0 and infinity where it is only bounded."""
    answers = infer_many(curves, seed=seed, workers=1)
    (group,) = result(list(zip(curves, answers, strict=True)), "").groups
    ends = dict[str, tuple[float, float]]()
    for name in (*ASKED, "exponent"):
        value = group.value(name)
        if value and value.q05 is not None and value.q95 is not None:
            low = 0.0 if value.bound in ("upper", "undetermined") else value.q05
            high = np.inf if value.bound in ("lower", "undetermined") else value.q95
            ends[name] = low, high
    return group.verdict, ends


def one(job: tuple[str, int]) -> dict[str, Any]:
    kind, number = job
    rng, exponent = np.random.default_rng([SEED, 6, number, *kind.encode()]), 1.0
    if kind in ("clean", "thinning"):
        modulus, viscosity = (float(10 ** rng.uniform(*np.log10(calibration.RANGES[name]))) for name in ASKED)
        law: Material = NeoHookeanKelvinVoigt(modulus, viscosity)
        if kind == "thinning":
            modulus, exponent = 0.0, float(rng.uniform(*calibration.EXPONENTS))
            law = calibration.thinning(viscosity, exponent)
        wrong = {name: 1.0 + deviation * rng.standard_normal() for name, deviation in SHARED.items()}
        time = wrong["rate"] * np.sqrt(wrong["density"])
        curves = [scaled(curve, wrong["scale"], time) for curve in shots(law, rng.integers(5, 13), rng)]
    else:
        modulus, viscosity = float(10 ** rng.uniform(3.3, 4.3)), float(10 ** rng.uniform(-1.7, -0.7))
        curves = shots(NeoHookeanKelvinVoigt(modulus, viscosity), 5, rng)
        if kind == "two materials":
            curves = curves[:3] + shots(NeoHookeanKelvinVoigt(6.0 * modulus, viscosity), 3, rng)
        curves = [KINDS[kind](curve, rng) for curve in curves]
    curves = [
        replace(curve, meta={**curve.meta, "name": f"shot {i + 1}", "group": kind}) for i, curve in enumerate(curves)
    ]
    verdict, ends = answered(curves, number)
    truth = {"shear_modulus": modulus, "viscosity": viscosity, "exponent": exponent}
    return {"verdict": verdict, "truth": truth, "ends": ends}


def ends_of(row: dict[str, Any], name: str) -> tuple[float, float]:
    """The ends of the interval of a group's line; a line without G says that the material is a liquid."""
    low, high = row["ends"].get(name, (0.0, 0.0))
    return low, high


def misses(row: dict[str, Any]) -> bool:
    ends = [(*ends_of(row, name), row["truth"][name]) for name in ASKED]
    return any(not low / FACTOR <= truth <= high * FACTOR for low, high, truth in ends)


def measure(run: Run) -> Iterator[Number]:
    clean = run.rows("groups", one, [("clean", number) for number in range(run.count(10, 60))])
    for name in ASKED:
        known = [(*ends_of(row, name), row["truth"][name]) for row in clean if row["verdict"] in WITHOUT_DOUBT]
        yield coverage(f"clean.{name}", [low <= truth <= high for low, high, truth in known], LEVEL)
        widths = [np.log10(high / low) for low, high, _ in known if low > 0.0 and np.isfinite(high)]
        yield statistic(f"clean.{name}.width", widths, "decades")
    yield share("clean.doubted", [row["verdict"] not in WITHOUT_DOUBT for row in clean])
    thinning = run.rows("groups", one, [("thinning", number) for number in range(run.count(3, 30))])
    for name in ("viscosity", "exponent"):
        told = [row for row in thinning if row["verdict"] in WITHOUT_DOUBT and name in row["ends"]]
        known = [(*ends_of(row, name), row["truth"][name]) for row in told]
        yield coverage(f"thinning.{name}", [low <= truth <= high for low, high, truth in known], LEVEL)
    yield share("thinning.doubted", [row["verdict"] not in WITHOUT_DOUBT for row in thinning])
    spoiled = {kind: run.rows("groups", one, [(kind, number) for number in range(run.count(1, 3))]) for kind in KINDS}
    for kind, rows in spoiled.items():
        yield share(f"spoiled.{kind}.doubted", [row["verdict"] not in WITHOUT_DOUBT for row in rows])
    every = [row for rows in spoiled.values() for row in rows]
    yield share("spoiled.wrong", [row["verdict"] in WITHOUT_DOUBT and misses(row) for row in every])
