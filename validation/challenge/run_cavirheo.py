"""cavirheo's answers to the recordings of the challenge, by its command line and result.json alone.

    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- infer --material auto
    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- fit --bubble field

Seconds are those of the whole command, start included. `verdict` says whether cavirheo itself trusts the answer.
"""

from __future__ import annotations

import json
import subprocess
import sys
from functools import partial
from inspect import signature
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cavirheo import Bubble, Medium, simulate
from cavirheo.physics.materials import LAWS, parse, with_consistency
from validation.challenge.answers import Answer, Recording, run

QUANTITIES = {"G": "shear_modulus_Pa", "mu": "viscosity_Pa_s"}
AT_RATE = "viscosity_at_1e5_per_s"  # among the other parameters of a law without one viscosity


def answer(recording: Recording, options: list[str]) -> Answer:
    verb, *more = options or ["infer"]
    with TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-m", "cavirheo", verb, str(recording.path), *more, "--quiet", "--no-pictures"]
        command += ["--density", f"{recording.density:.6g}"]
        command += ["--exposure-us", f"{1e6 * recording.exposure:.6g}"] * (recording.exposure > 0)
        done = subprocess.run([*command, "-o", str(out)], check=False, capture_output=True, text=True)
        if not (out / "result.json").exists():
            return {"verdict": f"failed: {done.stderr.strip().splitlines()[-1:]}"}
        curve = json.loads((out / "result.json").read_text("utf-8"))["curves"][0]
    if AT_RATE in curve["other_parameters"]:
        curve[QUANTITIES["mu"]] = curve["other_parameters"][AT_RATE]
    row: Answer = {}
    for name, field in QUANTITIES.items():
        value = curve.get(field) or {}
        row |= stated(name, value.get("median"), value.get("q05"), value.get("q95"), value.get("bound"))
    row = {key: "" if value is None else value for key, value in row.items()} | {"verdict": curve["verdict"]}
    return row | ({"predict": partial(predicted, curve, recording.density)} if curve["best"] else {})


def stated(name: str, median: float | None, low: float | None, high: float | None, bound: str | None) -> Answer:
    """A quantity as result.json states it: a value with its interval, or a bound on one side, or nothing."""
    if bound == "undetermined":
        return {}
    return {
        name: median if bound is None else None,
        f"{name}_low": None if bound == "upper" else low,
        f"{name}_high": None if bound == "lower" else high,
    }


def predicted(curve: dict[str, Any], density: float, at: np.ndarray) -> np.ndarray:
    """Radii as measured, by the best values of an answer, at times of the recording."""
    best = curve["best"]
    terms = [family.strip() for family in curve["material"].split("+")]
    values = with_consistency(best)
    words = [
        f"{law}({', '.join(f'{n}={values[n]!r}' for n in signature(LAWS[law]).parameters if n in values)})"
        for law in terms
    ]
    known = {name: best.get(name, 0.0) for name in ("confinement_damping",)}
    bubble = Bubble("kinetic", best["accommodation"], **known) if "accommodation" in best else Bubble(**known)
    scale, late = best.get("radius_scale", 1.0), best.get("time_origin", 0.0)
    R_max = curve["max_radius_m"] * scale * best.get("max_radius_factor", 1.0)
    run = simulate(
        parse(" + ".join(words)),
        max_radius=R_max,
        stretch=best["stretch"],
        time=at - curve["time_of_max_s"] - late,
        medium=Medium(density=density),
        bubble=bubble,
    )
    return run.radius / scale


if __name__ == "__main__":
    run(__doc__, answer)
