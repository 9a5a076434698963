"""cavirheo's answers to the recordings of the challenge, by command line and result.json; predictions by Python.

    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- infer --material auto
    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- fit --bubble field

Seconds are those of the whole command, start included. `verdict` says whether cavirheo itself trusts the answer.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cavirheo import Medium, RadiusCurve, fit, infer, infer_many, predict_radius, read_curves
from validation.challenge.answers import Answer, Recording, read, run

QUANTITIES = {"G": "shear_modulus_Pa", "mu": "viscosity_Pa_s"}


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
    row: Answer = {}
    for name, field in QUANTITIES.items():
        value = curve.get(field) or {}
        row |= stated(name, value.get("median"), value.get("q05"), value.get("q95"), value.get("bound"))
    row = {key: "" if value is None else value for key, value in row.items()} | {"verdict": curve["verdict"]}
    return row | ({"predict": partial(predicted, recording, options)} if curve["best"] else {})


def seconds_together(folder: Path) -> float:
    """Seconds in which all recordings of a folder are answered in one call."""
    curves = list[RadiusCurve]()
    for one in read(folder):
        known = {"exposure_s": one.exposure, "medium": {"density": one.density}}
        curves.append(read_curves(one.path)[0].labelled(**known))
    infer_many(curves[:1])  # loads compiled code; the processes start anew, and count
    began = time.perf_counter()
    infer_many(curves)
    return time.perf_counter() - began


def stated(name: str, median: float | None, low: float | None, high: float | None, bound: str | None) -> Answer:
    """A quantity as result.json states it: a value with its interval, or a bound on one side, or nothing."""
    if bound == "undetermined":
        return {}
    return {
        name: median if bound is None else None,
        f"{name}_low": None if bound == "upper" else low,
        f"{name}_high": None if bound == "lower" else high,
    }


def predicted(recording: Recording, options: list[str], at: np.ndarray) -> np.ndarray:
    """(3, n) radii at times (n,) of the recording, by the draws of the same answer made in Python: their mean, and the
    ends of 90 % of them."""
    verb, *more = options or ["infer"]
    how = {name.strip("-"): value for name, value in zip(more[::2], more[1::2], strict=True)}
    curve, medium = read_curves(recording.path)[0], Medium(density=recording.density)
    curve = curve.labelled(exposure_s=recording.exposure)
    answer = {"infer": infer, "fit": fit}[verb](curve, medium=medium, trust_input=True, **how)
    return np.array(predict_radius(answer, at))


if __name__ == "__main__":
    run(__doc__, answer)
