"""What the program wrote, frozen, so that a change is seen: the cases, how each is made anew, and how two compare.

A case is a function that gets an empty folder (the current one) and gives what is compared: dicts, lists, texts and
numbers. It uses the command line and the public Python names alone.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import hashlib
import html
import importlib
import inspect
import io
import json
import math
import os
import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType
from typing import Any
from unittest import mock

import h5py
import numpy as np
from conftest import BDT
from files import save_v73
from scipy.io import savemat

import cavirheo
from cavirheo.inference.budget import Budget

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "examples"
GOLDEN = Path(__file__).resolve().parent / "golden"
INPUTS = GOLDEN / "inputs"
CORES = 2  # as the program sees them: the last digits of weighted draws depend on their number
ENVIRONMENT = {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb", "LANG": "C.UTF-8"}

# Where the names that cavirheo itself does not offer live; the first module that has one is taken.
HOMES = {
    "main": ("cavirheo.cli", "cavirheo.verbs", "cavirheo.__main__"),
    "verify_many": ("cavirheo.inference.verify", "cavirheo.verify", "cavirheo.inference"),
}


def at_home(name: str) -> Any:
    """One of the names of HOMES."""
    for module in HOMES[name]:
        with contextlib.suppress(ModuleNotFoundError, AttributeError):
            return getattr(importlib.import_module(module), name)
    raise ImportError(f"{name} is in none of {', '.join(HOMES[name])}: add its new home to HOMES")


@dataclass(frozen=True)
class Case:
    """rtol: of numbers. share: of an interval's width, by which its median and ends may move. Both count only where
    another processor may have rounded otherwise, not in the exact mode. slow: many seconds. shift: absolute change of
    what is a logarithm or a share (log evidence, probability, p value)."""

    name: str
    make: Callable[[], Any]
    rtol: float
    share: float
    shift: float
    slow: bool


CASES: dict[str, Case] = {}


def case(rtol: float = 1e-4, share: float = 0.01, shift: float = 0.0, slow: bool = False) -> Callable[..., Any]:
    """Registers a function under its name."""

    def register(make: Callable[[], Any]) -> Callable[[], Any]:
        name = make.__name__
        CASES[name] = Case(name, make, rtol, share, shift, slow)
        return make

    return register


def made(name: str) -> Any:
    """The case made anew in an empty folder, as JSON would give it back."""
    before = {key: os.environ.get(key) for key in ENVIRONMENT}
    folder = Path.cwd()
    with tempfile.TemporaryDirectory() as empty:
        Path(empty, "here").mkdir()  # for the folder's name is that of a group
        os.chdir(Path(empty, "here"))
        os.environ.update(ENVIRONMENT)
        try:
            with mock.patch("os.cpu_count", return_value=CORES):
                found = CASES[name].make()
        finally:
            os.chdir(folder)
            for key, value in before.items():
                if value is None:
                    os.environ.pop(key, None)
                else:
                    os.environ[key] = value
        return json.loads(json.dumps(clean(found, empty), ensure_ascii=False))


# ---------------------------------------------------------------------------------------------- running and reading


def run(*words: object) -> dict[str, Any]:
    """Exit status, stdout and stderr of a command in this process."""
    out, err, status, before = io.StringIO(), io.StringIO(), 0, sys.argv
    sys.argv = ["cavirheo", *map(str, words)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            at_home("main")()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    finally:
        sys.argv = before
    told = [line for line in err.getvalue().splitlines() if line.strip() and not line.startswith("compiling the")]
    return {"status": status, "stdout": out.getvalue().splitlines(), "stderr": told}


def read(path: str) -> Any:
    """A JSON file."""
    return json.loads(Path(path).read_text(encoding="utf-8"))


def lines(path: str) -> list[str]:
    return Path(path).read_text(encoding="utf-8").splitlines()


def files(folder: str) -> list[str]:
    """Names of all files in it that are to be seen."""
    found = [path for path in Path(folder).rglob("*") if path.is_file() and path.name[0] != "."]
    return sorted(path.relative_to(folder).as_posix() for path in found)


def page(path: str) -> list[str]:
    """The visible text of a page, one line per block."""
    text = Path(path).read_text(encoding="utf-8")
    for tag in ("svg", "style", "script"):
        text = re.sub(rf"<{tag}\b.*?</{tag}>", " ", text, flags=re.S)
    text = re.sub(r"</?(p|h\d|tr|li|dt|dd|pre|header|title|footer|code|table)\b[^>]*>", "\n", text)
    text = html.unescape(re.sub(r"<[^>]*>", " ", text))
    return [line for line in (" ".join(part.split()) for part in text.splitlines()) if line]


def answered(*words: object, text: bool = False) -> dict[str, Any]:
    """What `infer` or `fit` says and writes; `text`: the page and the CSV, too."""
    shutil.rmtree("out", ignore_errors=True)  # that of other words
    told = run(*words, "-o", "out")
    found: dict[str, Any] = {"told": told}
    if Path("out").exists():
        found["files"] = files("out")
        found["result"] = read("out/result.json")
        if text:
            found["csv"], found["report"] = lines("out/result.csv"), page("out/report.html")
    return found


def bring(*names: str) -> None:
    """Examples and stored inputs into the current folder, so that the documents name no other."""
    for name in names:
        source = EXAMPLES / name if (EXAMPLES / name).exists() else INPUTS / name
        Path(name).write_bytes(source.read_bytes())


def shots(source: str, *numbers: int, folder: str = ".", stem: str = "shot") -> list[str]:
    """Single shots of a CSV file of several, each as a file of its own."""
    head, *rows = (EXAMPLES / source).read_text(encoding="utf-8").splitlines()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for number in numbers:
        mine = [row.split(",", 1)[1] for row in rows if row.startswith(f"{number},")]
        Path(folder, f"{stem}{number}.csv").write_text("\n".join([head.split(",", 1)[1], *mine]) + "\n")
    return [(Path(folder) / f"{stem}{number}.csv").as_posix() for number in numbers]


def sha(data: Any) -> str:
    """SHA-256 of bytes or of an array's."""
    data = data if isinstance(data, bytes) else np.ascontiguousarray(data).tobytes()
    return hashlib.sha256(data).hexdigest()


def array(values: Any) -> Any:
    """Shape, type, a few values and the hash of an array."""
    if values is None:
        return None
    values = np.asarray(values)
    flat = values.ravel()
    some = flat[np.unique(np.linspace(0, flat.size - 1, min(flat.size, 7)).astype(int))] if flat.size else flat
    return {
        "shape": list(values.shape), "dtype": str(values.dtype), "some": some.tolist(), "bytes_sha256": sha(values),
    }  # fmt: skip


# ---------------------------------------------------------------------------------------- normalising and comparing

MASKED = {"date", "version", "seconds", "cavirheo", "made_by"}  # keys whose values tell when and with what
MADE = "made here"  # in place of the hash of an input whose bytes hold the date of their making
_WORDS = [
    (re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d( [A-Z]+\b)?"), "(date)"),
    (re.compile(r"\bin [\d.]+ s\b"), "in (n) s"),
    (re.compile(r"\bpython -m [\w.]*\.?cavirheo\b"), "cavirheo"),
    (re.compile(r"\(\d+ per s\)"), "((n) per s)"),
    (re.compile(r"(\d+/\d+) \d+:\d\d:\d\d"), r"\1"),
    (re.compile(r"\bcavirheo \d+(\.\d+)+\w*"), "cavirheo (version)"),
    (re.compile(r'"(cavirheo|version|seconds)": ("[^"]*"|[\d.e-]+)'), r'"\1": *'),
]


def clean(value: Any, folder: str) -> Any:
    """Without what differs from run to run (times, dates) or from place to place (absolute paths, version)."""
    if isinstance(value, dict):
        return {str(k): "*" if k in MASKED and v is not None else clean(v, folder) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [clean(item, folder) for item in value]
    if isinstance(value, np.generic):
        return clean(value.item(), folder)
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    if isinstance(value, Path):
        value = str(value)
    if isinstance(value, str):
        for place in {folder, str(Path(folder).resolve()), str(Path(cavirheo.__file__).parent), str(ROOT)}:
            value = re.sub(re.escape(place) + r"/([^\s\"',]*/)?", "", value)
        for pattern, instead in _WORDS:
            value = pattern.sub(instead, value)
    return value


_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# Counts and verdicts on convergence that another rounding may change
_COUNTS = {"simulations", "failed_simulations", "draws", "modes", "runs", "starts", "effective_sample_size", "ess"}
_LOGS = {"log_evidence", "log_evidence_laplace", "log_evidence_error", "standard_error", "probability", "p_value"}
_LOGS |= {"level", "correlation", "run", "tail_index", "discrepancy_probability", "discrepancy_over_rmax"}
_LOGS |= {"systematic_misfit_over_rmax"}
_EXACT_ONLY = {"bytes_sha256", "draws_exactly"}
# As many points as the simulated recording takes to its end, which another rounding moves by one
_EXACT_ONLY |= {"reconstruction_time", "reconstruction_radius"}
_STEEP = {"max_difference_over_rmax"}  # at one frame beside a collapse, where radii move most


def differences(old: Any, new: Any, about: Case, exact: bool = False) -> list[str]:
    """Every place where two do not agree, by its path."""
    found: list[str] = []
    _compare(old, new, "", about, exact, found, None)
    return found


def _compare(old: Any, new: Any, path: str, about: Case, exact: bool, found: list[str], room: float | None) -> None:
    """room: absolute tolerance that the place gives (an interval's width, the size of the other values of a list)."""
    key = re.split(r"[.\[]", path)[-1]
    if not exact and (key in _EXACT_ONLY or path.endswith("data.sha256")):
        return
    if isinstance(old, dict) and isinstance(new, dict):
        if list(old) != list(new):
            gone, more = [k for k in old if k not in new], [k for k in new if k not in old]
            found.append(f"{path or 'case'}: keys: gone {gone}, new {more}" + ("" if gone or more else ", other order"))
        inner = room
        if not exact and all(isinstance(old.get(k), float) for k in ("median", "q05", "q95")):
            inner = about.share * (old["q95"] - old["q05"])
        for name in old:
            if name in new:
                _compare(old[name], new[name], f"{path}.{name}" if path else name, about, exact, found, inner)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            found.append(f"{path}: {len(old)} items -> {len(new)} items")
        sizes = [abs(v) for v in old if isinstance(v, int | float) and not isinstance(v, bool)]
        inner = about.rtol * max(sizes) if sizes and len(sizes) == len(old) else room
        for i, (one, other) in enumerate(zip(old, new, strict=False)):
            _compare(one, other, f"{path}[{i}]", about, exact, found, inner)
    elif not _same(old, new, key, about, exact, room or 0.0):
        found.append(f"{path}: {old!r} -> {new!r}")


def _same(old: Any, new: Any, key: str, about: Case, exact: bool, room: float) -> bool:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (old, new))
    if exact or not numbers:
        if type(old) is not type(new) and not (numbers and not exact):
            return False
        return old == new or (not exact and isinstance(old, str) and _alike(old, new, about))
    if key in _COUNTS:
        return True
    if isinstance(old, int) and isinstance(new, int):
        return old == new
    shift = about.shift if key in _LOGS else 0.0
    rtol = 10.0 * about.rtol if key in _STEEP else about.rtol
    return abs(old - new) <= max(rtol * max(abs(old), abs(new)), room, shift)


def _alike(old: str, new: str, about: Case) -> bool:
    """Texts of the same words whose numbers agree within the tolerance and the digits that are shown."""
    if _NUMBER.sub("#", "".join(old.split())) != _NUMBER.sub("#", "".join(new.split())):
        return False
    for one, other in zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=False):
        digit = 10.0 ** -min(len(one.partition(".")[2]), len(other.partition(".")[2])) if "e" not in one + other else 0
        digit = digit if "." in one + other else 0.0
        if abs(float(one) - float(other)) > max(2.0 * digit, about.rtol * float(one), 1e-12):
            return False
    return True


# ------------------------------------------------------------------------------------------------- answers of curves


@case(rtol=1e-2)
def infer_all() -> Any:
    """Two files of several curves: the documents, the table and the page."""
    bring("soft_gel.csv", "stiff_gel.mat")
    return answered("infer", *BDT, "soft_gel.csv", "stiff_gel.mat", text=True)


@case(rtol=1e-2)
def infer_options() -> Any:
    """One option at a time, and all at once."""
    (name,) = shots("soft_gel.csv", 3)
    return [
        answered("infer", *BDT, name, *more)
        for more in (
            ("--stretch", 7), ("--window", 2), ("--rmax-um", 250), ("--density", 1060), ("--medium", "bu2026"),
            ("--stretch", 6.8, "--window", 1, "--rmax-um", 280, "--sound-speed", 1500, "--pressure", 99000,
             "--temperature", 300, "--surface-tension", 0.056),
        )
    ]  # fmt: skip


@case(rtol=1e-2)
def infer_liquid() -> Any:
    bring("liquid.csv")
    return answered("infer", "liquid.csv", "--model", "bdt-viscous")


@case(rtol=1e-2)
def infer_refused() -> Any:
    """Curves that cannot be answered beside one that can, and one of another law."""
    bring("liquid.csv", "plateau.csv")
    Path("three.csv").write_text("time_us,radius_um\n0,100\n1,90\n2,80\n")
    head, *rows = lines("plateau.csv")
    Path("short.csv").write_text("\n".join([head, *rows[:30]]) + "\n")
    return answered("infer", *BDT, "three.csv", "short.csv", "liquid.csv", "plateau.csv", "missing.csv")


@case(rtol=1e-2, share=0.05, shift=0.3)
def infer_verify_map() -> Any:
    (name,) = shots("soft_gel.csv", 3)
    return answered("infer", *BDT, name, "--verify", "map", "--exposure-us", 0.3)


@case(rtol=1e-2, share=0.05, slow=True)
def fit_default() -> Any:
    """Two curves: the documents, the table and the page."""
    return answered("fit", *shots("soft_gel.csv", 3), *stiff(), text=True)


def stiff() -> list[str]:
    """The first shot of the stiff gel, as a file."""
    curve = cavirheo.read_curves(EXAMPLES / "stiff_gel.mat")[0]
    table("stiff.csv", "time_us,radius_um", curve.time * 1e6, curve.radius * 1e6)
    return ["stiff.csv"]


@case(rtol=1e-2, share=0.05, slow=True)
def fit_free() -> Any:
    (name,) = shots("soft_gel.csv", 3)
    return answered("fit", name, "--free", "t0,scale,rmax", "--window", 3)


@case(rtol=1e-2, share=0.05, slow=True)
def fit_newtonian() -> Any:
    bring("liquid.csv")
    return answered("fit", "liquid.csv", "--material", "newtonian", "--window-us", 60)


@case(rtol=1e-2, share=0.05, slow=True)
def fit_equal_plateau() -> Any:
    bring("plateau.csv")
    return answered("fit", "plateau.csv", "--weights", "equal", "--stretch", "plateau")


@case(rtol=5e-2, share=0.1, slow=True)
def fit_memory() -> Any:
    """A law with memory."""
    (name,) = shots("soft_gel.csv", 3)
    return answered("fit", name, "--material", "zener", "--window", 2)


@case(rtol=0.15, share=0.3, shift=0.7, slow=True)
def which_law() -> Any:
    (name,) = shots("soft_gel.csv", 3)
    told = run("which-law", name, "--laws", "nhkv,newtonian", "--window", 2, "-o", "out")
    return {"told": told, "files": files("out"), "laws": read("out/laws.json")}


# ------------------------------------------------------------------------------------------------- answers in Python


def about(answer: Any) -> dict[str, Any]:
    """A Posterior: draws, medians, intervals, checks."""
    names = [name.removeprefix("log10_") for name in answer.names]
    checks = {field.name: getattr(answer.checks, field.name) for field in dataclasses.fields(answer.checks)}
    checks["messages"] = [{"code": one.code, "text": one.text} for one in answer.checks.messages]
    quantities = {}
    for name in names:
        low, high = answer.interval(name) or (None, None)
        quantities[name] = {"median": answer.median(name), "q05": low, "q95": high}
    return {
        "names": list(answer.names), "units": list(answer.units), "material": answer.material, "method": answer.method,
        "shape": list(answer.theta.shape), "quantities": quantities,
        "draws_exactly": {
            "first": answer.theta[:5].tolist(), "theta": array(answer.theta),
            "log_q": array(answer.log_q), "log_weight": array(answer.log_weight),
        },
        "checks": {key: array(v) if isinstance(v, np.ndarray) else v for key, v in checks.items()},
        "provenance": answer.provenance,
    }  # fmt: skip


@case(rtol=1e-2, share=0.05, slow=True)
def python_answers() -> Any:
    """infer and fit from Python, with a seed and settings of their own."""
    curve, other = cavirheo.read_curves(EXAMPLES / "soft_gel.csv")[1:3]
    medium = dataclasses.replace(cavirheo.Medium(), density=1010.0)
    fitted = cavirheo.fit_many([curve, other], seed=5, window=2, free=("t0",), medium=medium)
    return {
        "infer": about(cavirheo.infer(curve, model="bdt-viscoelastic")),
        "infer_many": [
            about(answer)
            for answer in cavirheo.infer_many([curve, other], model="bdt-viscoelastic", window=1, stretch=7.0)
        ],
        "fit": about(cavirheo.fit(other, "qkv", seed=3, window=2)),
        "fit_many": [about(answer) for answer in fitted],
    }


@case(rtol=0.15, share=0.3, shift=0.7)
def python_verified() -> Any:
    """Draws that the physics has weighted."""
    (curve,) = cavirheo.read_curves(EXAMPLES / "soft_gel.csv")[2:3]
    answer = cavirheo.infer(curve, window=1, model="bdt-viscoelastic")
    (found,) = at_home("verify_many")([curve], [answer], level="full", seed=2, budget=Budget(draws=600), free=("t0",))
    return about(found)


# ------------------------------------------------------------------------------------------------------- other verbs


@case(rtol=1e-2)
def compare() -> Any:
    shots("soft_gel.csv", 3, 5, folder="data/gel_a")
    Path("data/gel_a/three.csv").write_text("time_us,radius_um\n0,100\n1,90\n2,80\n")
    Path("data/gel_a/torn.mat").write_bytes(b"")
    Path("data/gel_a/protocol.docx").write_bytes(b"PK")
    bring("liquid.csv")
    Path("liquid.csv").rename("data/liquid.csv")
    Path("data/published.csv").write_text(
        "# by hand\nset,files,density,model,method,quantity,mean,std\n"
        "gel a,gel_a,1003,,IMR,G_kPa,8,1.5\ngel a,,,,IMR,mu_Pa_s,0.020,0.009\ngel a,,,,BDT,G_kPa,6,\n"
        "gel a,,,,rheometer,G_Pa,2000,\ngone,nowhere/*.mat,,,IMR,G_kPa,5,1\n"
        "PEG,liquid.csv,,bdt-viscous,IMR,mu_mPa_s,55,5\n"
    )
    Path("data/fitted.csv").write_text("set,window,method,quantity,mean,std\ngel_a/shot3.csv,1,BDT,G_kPa,6,1\n")
    found = {}
    for name, *more in (
        ("published", "--reference-method", "rheometer", "--reference-method", "IMR"),
        ("fitted", "--fit", "nhkv"),
    ):
        told = run("compare", "data", "--references", f"data/{name}.csv", *more, "-o", name)
        found[name] = {
            "told": told, "files": files(name), "groups": read(f"{name}/result.json")["groups"],
            "md": lines(f"{name}/comparison.md"), "csv": lines(f"{name}/comparison.csv"),
        }  # fmt: skip
    return found


@case(rtol=1e-3)
def rheometer() -> Any:
    """The examples beside bubbles, and an export with another layout."""
    bring("soft_gel_strain_sweep.csv", "soft_gel_frequency_sweep.csv")
    run("infer", *BDT, *shots("soft_gel.csv", 3, 5), "-o", "bubbles")
    omega = np.logspace(-1, 2, 16)
    rows = [f"{w:.6g};{5000 + w:.6g};{0.3 * w + 20:.6g}".replace(".", ",") for w in omega]
    Path("german.csv").write_text("\n".join(["Kreisfrequenz [rad/s];Speichermodul [Pa];Verlustmodul [Pa]", *rows]))
    sweeps = ("soft_gel_strain_sweep.csv", "soft_gel_frequency_sweep.csv")
    found = []
    for words in (
        (*sweeps, "--beside", "bubbles/result.json"), (*sweeps, "--at", 5, "--tolerance", 10, "--name", "gel"),
        ("german.csv", "missing.csv"), ("german.csv", "--at", 1000),
    ):  # fmt: skip
        out = f"out{len(found)}"
        told = run("rheometer", *words, "-o", out)
        tables = {name: lines(f"{out}/{name}") for name in files(out) if name.endswith(".csv")}
        found.append({"told": told, "files": files(out), "json": read(f"{out}/rheometer.json"), "csv": tables})
    return found


@case(rtol=1e-3)
def collapse_time() -> Any:
    bring("times.csv", "plateau.csv")
    Path("few.csv").write_text("\n".join(lines("times.csv")[:6]) + "\n")
    Path("odd.csv").write_text("shot,rmax_um,stretch,t1_us\nA,200,7,18\nB,nan,7,18\nC,200,7,18000\n")
    found = []
    for words in (
        ("times.csv",), ("few.csv", "--exact", "--medium", "zhu2025", "--density", 1000), ("odd.csv",),
        ("times.csv", "few.csv", "--viscosity", 0.1), ("few.csv", "--material", "newtonian"), ("plateau.csv",),
        ("plateau.csv", "--stretch", 7, "--material", "nh"),
    ):  # fmt: skip
        out = f"out{len(found)}"
        told = run("collapse-time", *words, "-o", out)
        document = read(f"{out}/collapse-time.json")
        found.append({"told": told, "files": files(out), "json": document, "csv": lines(f"{out}/shots.csv")[:4]})
    return found


SIMULATED = {
    "nhkv": ("--stretch", 7, "--shear-modulus", 6000, "--viscosity", 0.05),
    "newtonian": ("--stretch", 5, "--material", "newtonian", "--viscosity", 0.02, "--medium", "estrada2018"),
    "qkv": ("--stretch", 6, "--material", "qkv", "--shear-modulus", 3000, "--viscosity", 0.1, "--stiffening", 0.2),
    "memory": ("--stretch", 6, "--material", "neo-hookean(2e3) + newtonian(0.02) + maxwell(5e3, 1e-5)", "--relaxed"),
    "carreau": ("--stretch", 7, "--material", "yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)", "--motion", "gilmore"),
    "pulse": ("--stretch", 1, "--pulse", -800, 1, 5, "--shear-modulus", 1000, "--viscosity", 0.01),
    "trace": ("--stretch", 1, "--driving", "pressure.csv", "--shear-modulus", 1000, "--viscosity", 0.01),
    "polytropic": ("--stretch", 7, "--shear-modulus", 6000, "--viscosity", 0.05, "--polytropic", 1.4,
                   "--motion", "rayleigh-plesset", "--precise"),
}  # fmt: skip


@case(rtol=1e-3)
def simulate() -> Any:
    """Every tenth row of the CSV, for laws, motions, gas and driving."""
    Path("pressure.csv").write_text("time_us,pressure_kPa\n0,0\n5,-500\n10,300\n15,0\n")
    found = {}
    for name, words in SIMULATED.items():
        radius = 5 if name in ("pulse", "trace") else 250
        more = ("--fields",) if name == "nhkv" else ()
        told = run("simulate", "--rmax-um", radius, "--duration-us", 80, *words, *more, "-o", name)
        table = Path(name, "simulation.csv")
        rows = list(csv.reader(lines(table))) if table.exists() else [[]]
        numbers = [[float(cell) if cell else None for cell in row] for row in rows[1::10]]
        found[name] = {
            "told": told, "head": rows[0], "rows": len(rows) - 1,
            "columns": [list(column) for column in zip(*numbers, strict=True)],
            "bytes_sha256": sha(table.read_bytes()) if len(rows) > 1 else None,
        }  # fmt: skip
    with h5py.File("nhkv/fields.h5") as file:
        found["fields"] = {name: array(file[name][()]) for name in sorted(file)}
        found["attributes"] = {key: str(value) for key, value in sorted(file.attrs.items())}
    return found


@case()
def simulate_python() -> Any:
    """`simulate` and `simulate_many` from Python: every field of what comes back."""
    time = np.arange(0.0, 60e-6, 1e-6)
    one = cavirheo.simulate(cavirheo.NeoHookeanKelvinVoigt(8e3, 0.05), max_radius=2e-4, stretch=6.5, time=time)
    return {
        field.name: array(value) if isinstance(value := getattr(one, field.name), np.ndarray) else str(value)
        for field in dataclasses.fields(one)
    }


@case(rtol=3e-2)
def generate() -> Any:
    """A small training set, its files, and a model judged on another; workers and shards change nothing."""
    words = ("generate", ROOT / "recipes" / "laptop.toml", "-n", 12)
    told = [run(*words, "-o", "set"), run(*words, "-o", "set"), run(*words, "-o", "same", "--workers", 1)]
    told.append(run("generate", ROOT / "recipes" / "laptop.toml", "-n", 30, "--seed", 9, "-o", "other"))
    found: dict[str, Any] = {"told": told, "files": files("set"), "alike": files("set") == files("same")}
    for name in files("set"):
        content = Path("set", name).read_bytes()
        with h5py.File(Path("set", name)) as file:
            arrays = {key: file[key][()] for key in file}
            found[name] = {
                "attributes": {key: str(value) for key, value in file.attrs.items() if key != "made_by"},
                "dtypes": {key: [str(value.dtype), list(value.shape)] for key, value in arrays.items()},
                "theta": arrays["theta"].tolist(),
                "radius": [[round(float(v), 6) for v in row[::10]] for row in arrays["radius"]],
                "status": [str(v, "utf-8") for v in arrays["status"]],
                "bytes_sha256": sha(content),
            }
        found["alike"] &= content == Path("same", name).read_bytes()
    found["evaluate"] = run("evaluate", "bdt-viscoelastic", "other", "-o", "judged")
    found["judged"] = [files("judged"), read("judged/metrics.json")] if Path("judged").exists() else None
    return found


# --------------------------------------------------------------------------------------------------- words and names

VERBS = ("infer", "watch", "design", "compare", "simulate", "laws", "generate", "train", "evaluate", "models", "fit",
         "which-law", "rheometer", "collapse-time", "cluster", "app")  # fmt: skip


@case()
def help_texts() -> Any:
    return {"cavirheo": run("--help"), "nothing": run()} | {verb: run(verb, "--help") for verb in VERBS}


@case()
def laws_and_models() -> Any:
    return {"version": run("--version"), "laws": run("laws"), "models": run("models")}


@case()
def refusals() -> Any:
    """What is said of wrong usage."""
    (name,) = shots("soft_gel.csv", 3)
    wrong: list[tuple[object, ...]] = [
        ("infer", "missing.csv"), ("infer", name, "--model", "nobody"), ("infer", name, "--verify", "some"),
        ("infer", name, "--stretch", 0.5), ("infer", name, "--medium", "honey"),
        ("infer", name, "--exposure-us", 1, "--verify", "none"),
        ("infer", name, "--temperature", 400), ("infer", name, "--rmax-um", -1), ("infer", name, "-o", name),
        ("infer",), ("infer", name, "--nothing"), ("nothing",), ("fit", name, "--material", "honey"),
        ("fit", name, "--window", "x"), ("fit", name, "--free", "x"), ("fit", name, "--weights", "x"),
        ("fit", name, "--window", 9), ("fit", name, "--stretch", "x"),
        ("which-law", name, "--laws", "nhkv"),
        ("compare", "nowhere", "--references", name), ("compare", ".", "--references", name),
        ("simulate", "--rmax-um", 100, "--stretch", 0.5, "-o", "x"), ("laws", "x"),
        ("simulate", "--rmax-um", 100, "--stretch", 5, "--material", "honey(1)", "-o", "x"),
        ("simulate", "--rmax-um", 100, "--stretch", 5, "--shear-modulus", 100, "-o", "x"),
        ("simulate", "--rmax-um", 100, "--stretch", 5, "--shear-modulus", 100, "--viscosity", 1,
         "--duration-us", 0, "-o", "x"),
        ("generate", "missing.toml", "-o", "x"), ("evaluate", "bdt-viscoelastic", "."),
        ("train", "missing.toml", ".", "-o", "x"),
        ("rheometer", name), ("rheometer", name, "--at", -1), ("collapse-time", name, "--material", "gent"),
        ("collapse-time", name, "--stretch", 0.5), ("rheometer", name, "--beside", name),
    ]  # fmt: skip
    return {" ".join(map(str, words)): run(*words) for words in wrong}


@case()
def names() -> Any:
    """The public names of cavirheo: signatures, fields and methods."""
    found: dict[str, Any] = {"all": list(cavirheo.__all__)}
    kinds = (FunctionType, classmethod, staticmethod)
    for name in cavirheo.__all__:
        thing = getattr(cavirheo, name)
        entry: dict[str, Any] = {"kind": type(thing).__name__}
        with contextlib.suppress(ValueError, TypeError):
            entry["signature"] = signature(thing)
        if inspect.isclass(thing):
            entry["bases"] = [base.__name__ for base in thing.__mro__[1:-1]]
            entry["members"] = {
                key: signature(getattr(thing, key)) if isinstance(value, kinds) else type(value).__name__
                for key, value in sorted(vars(thing).items())
                if key[0] != "_"
            }
            if dataclasses.is_dataclass(thing):
                entry["fields"] = [[f.name, str(f.type)] for f in dataclasses.fields(thing)]
        found[name] = entry
    found["media"] = {field.name: field.default for field in dataclasses.fields(cavirheo.Medium)}
    return found


def signature(thing: Any) -> str:
    """As text, without what tells where an object lies in memory."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(inspect.signature(thing)))


@case()
def shipped() -> Any:
    """The models in the package: their hashes and the shape of their cards."""

    def keys(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: keys(item) for key, item in value.items()}
        return [keys(item) for item in value] if isinstance(value, list) else type(value).__name__

    found: dict[str, Any] = {}
    for path in sorted(Path(cavirheo.__file__).parent.rglob("*.onnx")):
        card = json.loads(path.with_suffix(".json").read_text())
        hashes = {"sha256": sha(path.read_bytes()), "card_sha256": sha(path.with_suffix(".json").read_bytes())}
        found[path.name] = {**hashes, "card": keys(card)}
    return found


# ----------------------------------------------------------------------------------------------------------- reading


def table(path: str, header: str, *columns: Any, separator: str = ",", comma: bool = False) -> None:
    """A text file of numbers; not a number is an empty cell."""
    rows = [separator.join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    text = "\n".join([*([header] if header else []), *rows]) + "\n"
    Path(path).write_text(text.replace(".", ",") if comma else text, encoding="utf-8")


def bubble() -> tuple[Any, Any]:
    """t*, R*: growth, a collapse at 0.93 and four smaller ones."""
    t = np.linspace(-0.6, 4.0, 180)
    beat = np.sqrt(np.clip(1.0 - (((t + 0.93) % 1.86 - 0.93) / 0.93) ** 2, 0.0, 1.0)) ** 0.9
    return t, 0.12 + 0.88 * beat * np.exp(-0.8 * np.maximum(t - 0.93, 0.0))


def cells(*arrays: Any) -> Any:
    """A MATLAB cell array."""
    row = np.empty((1, len(arrays)), dtype=object)
    for k, one in enumerate(arrays):
        row[0, k] = np.asarray(one, dtype=float).reshape(-1, 1)
    return row


def excel(path: str, t: Any, r: Any) -> None:
    """A workbook with times in column A and radii in column C."""
    pairs = enumerate(zip(t, r, strict=True), 2)
    rows = "".join(f'<row><c r="A{k}"><v>{a:.9g}</v></c><c r="C{k}"><v>{b:.9g}</v></c></row>' for k, (a, b) in pairs)
    head = '<row><c r="A1" t="s"><v>0</v></c><c r="C1" t="inlineStr"><is><t>radius_um</t></is></c></row>'
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    office = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    parts = {
        "_rels/.rels": ("xl/workbook.xml", "officeDocument"),
        "xl/_rels/workbook.xml.rels": ("worksheets/sheet1.xml", "worksheet"),
    }
    with zipfile.ZipFile(path, "w") as archive:
        for part, (target, kind) in parts.items():
            one = f'<Relationship Id="rId1" Type="{office}/{kind}" Target="{target}"/>'
            if part.startswith("xl"):
                one += f'<Relationship Id="rId2" Type="{office}/sharedStrings" Target="sharedStrings.xml"/>'
            archive.writestr(part, f"<Relationships>{one}</Relationships>")
        archive.writestr(
            "xl/workbook.xml",
            f'<workbook {space} xmlns:r="{office}"><sheets>'
            '<sheet name="a" sheetId="1" r:id="rId1"/></sheets></workbook>',
        )
        archive.writestr("xl/sharedStrings.xml", f"<sst {space}><si><t>time_us</t></si></sst>")
        archive.writestr(
            "xl/worksheets/sheet1.xml", f"<worksheet {space}><sheetData>{head}{rows}</sheetData></worksheet>"
        )


def readable() -> Iterator[tuple[str, dict[str, Any]]]:
    """Names of files of all kinds, made here one after the other, with the options to read them."""
    bring("soft_gel.csv", "stiff_gel.mat", "truth.csv", "soft_gel_strain_sweep.csv", "liquid.csv", "plateau.csv")
    for name in ("soft_gel.csv", "stiff_gel.mat", "truth.csv", "soft_gel_strain_sweep.csv", "liquid.csv"):
        yield name, {}
    yield "plateau.csv", {}
    t, r = bubble()
    top = 200e-6
    scale = top * math.sqrt(998.0 / 101325.0)
    time, radius = t * scale, r * top
    usual = {
        "R_nondim_All": cells(r, r, r), "t_nondim_All": cells(t, t, t), "RmaxList": np.array([[1e-4, 2e-4, 3e-4]]),
        "lambda_max_mean": 6.5, "lambda_max_std": 0.4,
    }  # fmt: skip
    spoilt = usual | {
        "R_nondim_All": cells([], r[:3], np.full(180, np.nan), r, r), "t_nondim_All": cells([], t[:3], t, t, t),
        "RmaxList": np.array([[0.0, 1e-4, 1e-4, 0.0, 2e-4]]),
    }  # fmt: skip
    for kind, save in (("v5", savemat), ("v73", save_v73)):
        save(Path(f"usual_{kind}.mat"), usual)
        yield f"usual_{kind}.mat", {"density": 1025.0}
        save(Path(f"spoilt_{kind}.mat"), spoilt)
        yield f"spoilt_{kind}.mat", {}
    savemat("no_maxima.mat", {key: value for key, value in usual.items() if key != "RmaxList"})
    yield "no_maxima.mat", {}
    savemat("pressure.mat", {**usual, "P_inf": 9e4})
    yield "pressure.mat", {}
    frames = np.arange(-10, 80) * 1e-6 / (top * math.sqrt(1025.0 / 101325.0))
    rate = {"R_nondim_All": cells(np.interp(frames, t, r)), "t_nondim_All": cells(frames), "RmaxList": [[top]]}
    savemat("round_rate.mat", usual | rate)
    yield "round_rate.mat", {"density": 998.0}
    for name, variables in {
        "metres": {"Rnew": radius, "t": time}, "micrometres": {"Rnew": radius * 1e6, "t": time},
        "pixels": {"Rnew": radius / 2.76e-6, "deltax": 2.76e-6, "deltat": time[1] - time[0]},
        "plain": {"R": radius * 1e6, "t": time},
        "rows": {"shift_normRnew": np.stack([r, r]), "Rmax": [[150.0], [300.0]], "t": time - time[0]},
        "other": {"G": 1.0, "speed": np.arange(3.0)}, "times": {"pIMR_array": np.ones((4, 3))},
        "half": {"R_nondim_All": cells(r)},
    }.items():  # fmt: skip
        savemat(f"{name}.mat", variables)
        yield f"{name}.mat", {}
    for k, (header, a, b, separator) in enumerate((
        ("time_s,radius_m", 1.0, 1.0, ","), ("t [us];R [um]", 1e6, 1e6, ";"),
        ("Time (ms)\tRadius (mm)", 1e3, 1e3, "\t"),
        (" TIME_US , Radius_µm ", 1e6, 1e6, ","), ("# t_us R_um", 1e6, 1e6, " "), ("t,R", 1.0, 1e6, ","),
        ("", 1e6, 1e6, ","), ("time_us,radius_um", 1e6, 1.0, ","), ("time_us,radius_um", 1e6, 1e3, ","),
        ("time_us,radius_m", 1e6, 1e6, ","), ("time_us,radius_um", 1e6, 1 / top, ","),
        ("time_us,radius_um", 1e6, 1e9, ","),
        ("time_us,radius_px", 1e6, 1 / 2.76e-6, ","), ("time_us,radius_um", 1e6, 0.36e6, ","),
        ("time_us,radius_um", 1e6, 2.1e6, ","), ("", 1e6, 0.36e6, ","),
    )):  # fmt: skip
        table(f"head{k}.csv", header, time * a, radius * b, separator=separator)
        yield f"head{k}.csv", {}
    table("commas.csv", "t_us;r_um", time * 1e6, radius * 1e6, separator=";", comma=True)
    yield "commas.csv", {}
    twice, both = np.tile(time * 1e6, 2), np.tile(radius * 1e6, 2)
    shot = np.repeat([7, 9], len(time))
    table("shots.csv", "shot,time_us,radius_um,radius_std_um", shot, twice, both, np.full(len(both), 0.5))
    yield "shots.csv", {}
    table("three.txt", "", time, radius * 1.01e6, radius * 0.99e6)
    yield "three.txt", {}
    gap = [-1000.0]
    table(
        "blocks.csv", "", np.concatenate([[0.0], gap, time * 1e6, gap, time * 1e6]),
        np.concatenate([[7e-310], gap, radius * 1e6, gap, radius * 2e6]),
    )  # fmt: skip
    yield "blocks.csv", {}
    dirty = radius * 1e6
    dirty[:2], dirty[50], dirty[100] = [-3.0, 0.0], np.nan, 4e5
    untidy = np.concatenate([time * 1e6, time[60:63] * 1e6, [np.nan]])
    table("dirty.csv", "time_us,radius_um", untidy, np.concatenate([dirty, dirty[60:63] + 2.0, [100.0]]))
    yield "dirty.csv", {}
    with h5py.File("two.h5", "w") as file:
        file["first/time"], file["first/radius"] = time, radius
        file["series/second/time_us"], file["series/second/radius_um"] = time * 1e6, radius * 1e6
        file["first"].attrs["stretch"] = 7.0
        file["unrelated"] = np.zeros(3)
    yield "two.h5", {}
    excel("book.xlsx", time * 1e6, radius * 1e6)
    yield "book.xlsx", {}
    for name, text in {
        "empty.mat": "", "prose.txt": "Dear reader,\nthis is a letter.\n", "prose.mat": "Dear reader,\n",
        "blank.csv": "\n\n# nothing\n", "header.csv": "time_us,radius_um\n", "swapped.csv": "time_um,radius_us\n1,2\n",
        "words.csv": "time_us,radius_um\n1,2\n2,three\n", "odd.csv": "time_us,radius_um\n1,5,200,3\n",
        "twice.csv": "time_us,radius_um,radius_um\n1,2,3\n", "numbers.csv": "1,2\n2,3\n", "clip.mp4": "\0" * 64,
    }.items():  # fmt: skip
        Path(name).write_text(text)
        yield name, {}
    yield "missing.mat", {}
    yield ".", {}


def told_by(curve: Any, name: str) -> Any:
    """A property or method of a curve, or why there is none."""
    try:
        value = getattr(curve, name)
        value = value() if callable(value) else value
    except cavirheo.InputError as error:
        return f"InputError: {error}"
    return value.tolist() if isinstance(value, np.ndarray) else value


@case(rtol=1e-6)
def reading() -> Any:
    """Every kind of file: the curves, what is said of them, or why there are none."""
    found: dict[str, Any] = {}
    for name, options in readable():
        try:
            curves = cavirheo.read_curves(name, **options)
        except cavirheo.InputError as error:
            found[name] = f"InputError: {error}"
            continue
        made_here = not (EXAMPLES / name).exists() and not (INPUTS / name).exists()
        found[name] = []
        for curve in curves:
            meta = {key: value for key, value in curve.meta.items() if key not in ("name", "notes")}
            for field in ("unusable", "unscaled", "time_unscaled", "stated_time_of_max"):
                value = getattr(curve, field)
                if value is not None and value is not False and value != "":
                    meta[field] = value
            if made_here and "source_sha256" in meta:
                meta["source_sha256"] = MADE
            found[name].append({
                "name": curve.name, "notes": list(curve.notes), "frames": len(curve.time),
                "measured": int(np.isfinite(curve.radius).sum()), "meta": meta,
                "bytes_sha256": sha(np.stack([curve.time, curve.radius, curve.radius_std])),
                **{
                    name: told_by(curve, name) for name in (
                        "max_radius", "time_of_max", "collapse_times", "noise", "spikes", "strain_rate",
                        "stretch_from_tail", "rayleigh_ratio",
                    )
                },
            })  # fmt: skip
    return found


@case(rtol=1e-6)
def curve_methods() -> Any:
    """Windows, resampling, another scale: what comes back."""
    curve = cavirheo.read_curves(EXAMPLES / "soft_gel.csv")[2]
    medium = cavirheo.Medium()
    return {
        "window": [array(curve.window(2).radius), array(curve.window(end=40e-6).time)],
        "resampled": [array(curve.resampled(1e-6, 80)), array(curve.resampled(1e-6, 300, allow_short=True))],
        "normalised": [array(part) for part in curve.normalised(medium)],
        "scaled": [array(curve.with_max_radius(2e-4).radius), list(curve.with_max_radius(2e-4).notes)],
        "noted": [list(curve.with_notes("a", "b").notes), dict(curve.with_group("g", "s").meta)["group"]],
        "scale": medium.time_scale(2e-4),
    }
