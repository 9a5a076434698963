"""`infer` without an option on the open sets, where a folder of them is given (docs/validation.md names them).

The first shots of each set that have a rebound. A viscosity of a power law is that at 1e5 1/s. `rheometer`: shots of a
liquid whose viscosity is within 20 % of that of a rheometer; `held`: 90 % intervals with two ends that hold it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np

from cavirheo import infer_many, read_curves
from validation.challenge.open_sets import SETS
from validation.numbers import Number, Run, share, statistic

FILES = {name: files for name, (files, _) in SETS.items()}
FILES |= {"PEGDA S3": "pegda_S3/*.mat", "PEGDA S4": "pegda_S4/*.mat"}
LIQUID, RHEOMETER, WITHIN = "PEG 40 %", {"PEG 40 %": 0.130, "PEG 10 %": 0.0064}, 0.2  # Pa s
GOOD = ("ok", "bound")


def key_of(name: str) -> str:
    """Of a set, in names of numbers."""
    return name.removesuffix(" %").replace(" ", "_").replace(".", "_")


@cache
def usable(folder: Path, name: str) -> list:
    files = sorted(folder.glob(FILES[name]))
    curves = [curve for file in files for curve in read_curves(file) if not curve.unusable]
    return [curve for curve in curves if len(curve.collapse_times())]


def one(job: tuple[str, int], folder: Path) -> dict:
    name, number = job
    began = time.perf_counter()
    (answer,) = infer_many([usable(folder, name)[number]], workers=1)
    drawn = answer.parameters if len(answer.theta) > 1 else []
    return {
        "seconds": time.perf_counter() - began,
        "verdict": answer.checks.verdict,
        "rmse": answer.checks.rmse_over_rmax,
        "intervals": {one: answer.interval(one) for one in drawn},
        "bounds": {one: answer.bound(one) for one in drawn},
        "medians": {one: answer.quantity(one).median for one in answer.parameters},
    }


def value(row: dict, name: str) -> float:
    """The median of a parameter of the answer; NaN where it is only bounded, or none."""
    median = row["medians"].get(name)
    return np.nan if median is None else median


def holds(rows: list[dict], viscosity: float) -> list[bool]:
    """Whether each interval of the viscosity with two ends holds this."""
    ends = [row["intervals"]["viscosity"] for row in rows if np.isfinite(value(row, "viscosity"))]
    return [low <= viscosity <= high for low, *_, high in ends]


def measure(run: Run) -> Iterator[Number]:
    if run.data is None:
        return
    jobs = []
    for name in FILES:
        most = run.count(6 if name == LIQUID else 2, 100)
        jobs += [(name, number) for number in range(min(len(usable(run.data, name)), most))]
    rows = run.rows("open_sets", partial(one, folder=run.data), jobs)
    yield share("trusted", [row["verdict"] in GOOD for row in rows])
    yield share("ok", [row["verdict"] == "ok" for row in rows])
    for name in FILES:
        mine = [row for job, row in zip(jobs, rows, strict=True) if job[0] == name]
        key = key_of(name)
        yield statistic(f"rmse.{key}", [row["rmse"] or np.nan for row in mine], "R_max")
        yield statistic(f"G.{key}", 1e-3 * np.array([value(row, "shear_modulus") for row in mine]), "kPa")
        viscosity = np.array([value(row, "viscosity") for row in mine])
        yield statistic(f"mu.{key}", viscosity, "Pa s")
        if name in RHEOMETER:
            yield share(f"rheometer.held.{key}", holds(mine, RHEOMETER[name]))
        if name == LIQUID:
            yield share("rheometer.within", np.abs(viscosity / RHEOMETER[name] - 1.0) < WITHIN)
            yield statistic("rheometer.ratio", viscosity / RHEOMETER[name], "1")
    yield statistic("seconds", [row["seconds"] for row in rows], "s")
