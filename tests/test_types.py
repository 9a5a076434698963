"""The types of every public name are complete, as pyright sees them in a program that uses the package."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from test_python import public_dataclasses

import cavirheo
from cavirheo.loading import _KINDS

pytestmark = pytest.mark.slow
SOURCE = Path(cavirheo.__file__).parents[1]
ENGINES = {"cavirheo.inference.verify.Verification"}  # its field `network` holds an engine, made by `infer` alone


def public() -> set[str]:
    """Where each public name, each dataclass that these hold, and each document that `load` gives is defined."""
    documents = [getattr(importlib.import_module(f"cavirheo.{room}"), kind) for room, kind in _KINDS.values()]
    objects = [*(getattr(cavirheo, name) for name in cavirheo.__all__), *public_dataclasses(), *documents]
    return {f"{one.__module__}.{one.__qualname__}" for one in objects} - ENGINES


def test_all_public_types_are_known():
    if find_spec("pyright") is None:
        pytest.skip("pyright is not installed")
    words = ["--verifytypes", "cavirheo", "--ignoreexternal", "--outputjson"]
    surroundings = os.environ | {"PYTHONPATH": str(SOURCE)}
    command = [sys.executable, "-m", "pyright", *words, "--pythonpath", sys.executable]
    done = subprocess.run(command, env=surroundings, capture_output=True, text=True, timeout=900)
    if not done.stdout.startswith("{"):
        pytest.skip(f"pyright does not run here: {done.stderr.strip()[-200:]}")  # it fetches its program when first run
    symbols = json.loads(done.stdout)["typeCompleteness"]["symbols"]
    names = public() | {f"cavirheo.{name}" for name in cavirheo.__all__}
    ours = [one for one in symbols if any(f"{one['name']}.".startswith(f"{name}.") for name in names)]
    wrong = {one["name"]: [said["message"] for said in one["diagnostics"]] for one in ours
             if not one["isTypeKnown"] or one["isTypeAmbiguous"]}  # fmt: skip
    assert wrong == {}
    assert {one["name"] for one in ours} >= {"cavirheo.infer", "cavirheo.curve.RadiusCurve.max_radius"}
    assert len(ours) > 500
