"""The types of every public name are complete, as pyright sees them in a program that uses the package."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

import cavirheo
from cavirheo.loading import KINDS

pytestmark = pytest.mark.slow
SOURCE = Path(cavirheo.__file__).parents[1]


def pyright(*words: str, cwd: Path | None = None) -> dict[str, Any]:
    """What it reports, in a program that uses the package."""
    if find_spec("pyright") is None:
        pytest.skip("pyright is not installed")
    surroundings = os.environ | {"PYTHONPATH": str(SOURCE)}
    command = [sys.executable, "-m", "pyright", *words, "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, env=surroundings, cwd=cwd, capture_output=True, text=True, timeout=900)
    if not done.stdout.startswith("{"):
        pytest.skip(f"pyright does not run here: {done.stderr.strip()[-200:]}")  # it fetches its program when first run
    return json.loads(done.stdout)


def test_all_public_types_are_known():
    symbols = pyright("--verifytypes", "cavirheo", "--ignoreexternal")["typeCompleteness"]["symbols"]
    documents = [getattr(importlib.import_module(f"cavirheo.{one.module}"), one.name) for one in KINDS.values()]
    objects = [*(getattr(cavirheo, name) for name in cavirheo.__all__), *documents]
    names = {f"cavirheo.{name}" for name in cavirheo.__all__}
    names |= {f"{one.__module__}.{one.__qualname__}" for one in objects}
    ours = [one for one in symbols if any(f"{one['name']}.".startswith(f"{name}.") for name in names)]
    assert [one["name"] for one in ours if not one["isTypeKnown"] or one["isTypeAmbiguous"]] == []
    assert len(ours) > 400


USE = """# pyright: strict
import cavirheo
from cavirheo.companions.design import Design
from cavirheo.reporting.laws import Laws

curves = cavirheo.read_curves("gel.mat", shots="1,4-7")
answers = [cavirheo.infer(curve, material="nhkv", verify="none") for curve in curves]
low, high = answers[0].interval("shear_modulus") or (0.0, 0.0)
fitted = cavirheo.fit(curve=curves[0], material="zener", window=3, free=("t0",), medium="water")
print(low, high, fitted.best["viscosity"], fitted.checks.verdict, fitted.median("viscosity"))
material = cavirheo.population(answers, along=[1.0, 2.0])
gel = cavirheo.NeoHookeanKelvinVoigt(shear_modulus=8e3, viscosity=0.05)
run = cavirheo.simulate(gel, max_radius=2e-4, stretch=6.0, time=curves[0].time)
runs = cavirheo.simulate_many([gel, gel], max_radius=2e-4, stretch=[5.0, 6.0], time=run.time, relaxed=True)
filmed = cavirheo.measure("bubble.mp4", frame_rate=5e5, um_per_px=4.0, exclude="12,40-45")
for one in (filmed, *curves, run, *runs, material, *answers):
    one.to_dataframe()
    print(one.plot())
result = cavirheo.load("result.json")
for row in result.curves:
    print(row.name, row.shear_modulus_Pa.median, row.verdict)
print(result.to_dataframe())
print(cavirheo.load("laws", Laws).curves[0].chosen, cavirheo.load("design", Design).wanted_percent)
"""
MISTAKES = """# pyright: strict
import cavirheo
from cavirheo.reporting.laws import Laws

curve = cavirheo.read_curves("gel.csv")[0]
cavirheo.fit(curve, windou=3)  # wrong
cavirheo.fit(curve, window=3.5)  # wrong
cavirheo.infer(curve, materail="nhkv")  # wrong
cavirheo.measure("bubble.mp4", framerate=5e5)  # wrong
gel = cavirheo.Newtonian(0.05)
cavirheo.simulate_many([gel], max_radius=2e-4, stretch=6.0, time=[0.0], nonsense=1)  # wrong
print(curve.radii)  # wrong
print(cavirheo.load("result.json").shots)  # wrong
print(cavirheo.load("laws.json", Laws).parameters)  # wrong
"""


@pytest.mark.parametrize("program", [USE, MISTAKES], ids=["use", "mistakes"])
def test_a_strict_program_is_told_of_its_mistakes_and_of_nothing_else(program, tmp_path):
    (tmp_path / "program.py").write_text(program, encoding="utf-8")
    errors = pyright("program.py", cwd=tmp_path)["generalDiagnostics"]
    wrong = {number for number, line in enumerate(program.split("\n")) if line.endswith("# wrong")}
    assert {one["range"]["start"]["line"] for one in errors} == wrong, [one["message"] for one in errors]
