"""cavirheo's answers to the recordings of the challenge, by its command line and result.json alone.

    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- infer --material auto
    python -m validation.challenge.run_cavirheo RECORDINGS ANSWERS.csv -- fit --bubble field

Seconds are those of the whole command, start included. `verdict` says whether cavirheo itself trusts the answer.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from validation.challenge.answers import Answer, Recording, run

QUANTITIES = {"G": "shear_modulus_Pa", "mu": "viscosity_Pa_s"}
AT_RATE = "viscosity_at_1e5_per_s"  # among the other parameters of a law without one viscosity


def answer(recording: Recording, options: list[str]) -> Answer:
    verb, *more = options or ["infer"]
    with TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-m", "cavirheo", verb, str(recording.path), *more, "--quiet", "--no-pictures"]
        command += ["--density", f"{recording.density:.6g}", "--exposure-us", f"{1e6 * recording.exposure:.6g}"]
        done = subprocess.run([*command, "-o", str(out)], check=False, capture_output=True, text=True)
        if not (out / "result.json").exists():
            return {"verdict": f"failed: {done.stderr.strip().splitlines()[-1:]}"}
        curve = json.loads((out / "result.json").read_text("utf-8"))["curves"][0]
    if AT_RATE in curve["other_parameters"]:
        curve[QUANTITIES["mu"]] = curve["other_parameters"][AT_RATE]
    row: Answer = {}
    for name, field in QUANTITIES.items():
        value = curve.get(field) or {}
        row |= {name: value.get("median"), f"{name}_low": value.get("q05"), f"{name}_high": value.get("q95")}
    return {key: "" if value is None else value for key, value in row.items()} | {"verdict": curve["verdict"]}


if __name__ == "__main__":
    run(__doc__, answer)
