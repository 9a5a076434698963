"""Is a default answer that of a longer run? And does another seed answer the same?

Shots: of each kind of calibration.py, and the first shots of the open sets (with --data). A reference has a budget with
more climbs, four times the draws and seven times the simulations, and another seed. Compared are the log evidence
and the ends of the 90 % intervals of G, mu and stretch in widths of the reference's interval; bounds by their
logarithm are left out. "seeds": two default answers of a shot, in the same way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo import RadiusCurve, infer, read_curves
from cavirheo.inference import answer
from cavirheo.inference.sample import EMULATED
from validation.claims import calibration
from validation.numbers import Number, Run, statistic

LONG = replace(
    EMULATED,
    scanned=6000,
    climbed=60,
    kept=20,
    ridge=150,
    rounds=(4000,) * 9,
    sampled=8000.0,
    effective=700.0,
    most=7000,
)
PARTS = ("seeds",)
SHOTS = 2, 8  # of each kind, in a quick and a full run
SETS = (
    "paam_alginate_0p3", "peg8000_40wv", "peg8000_10wv", "agarose_2p5", "agarose_0p5", "pa_stiff", "pa_soft",
    "pegda_S3", "pegda_S4", "water_laser", "water_libdar",
)  # fmt: skip
SHOWN = ("shear_modulus", "viscosity", "stretch")


def curve_of(name: str, place: int | str) -> RadiusCurve:
    if name in calibration.KINDS:
        return calibration.shot(int(place), kind=name)[1]
    return read_curves(place)[0]


def one(job: tuple[str, int | str, int, bool]) -> dict[str, Any]:
    """Evidence and intervals of one answer."""
    name, place, seed, long = job
    usual = answer.EMULATED
    answer.EMULATED = LONG if long else usual
    try:
        found = infer(curve_of(name, place), seed=seed, trust_input=True)
    finally:
        answer.EMULATED = usual
    told = found.log_weight is not None
    return {
        "evidence": found.evidence.log if found.evidence else None,
        "intervals": {n: found.interval(n) for n in SHOWN if told and n in found.parameters and not found.bound(n)},
    }


def compared(pairs: list[tuple[dict[str, Any], dict[str, Any]]], name: str) -> Iterator[Number]:
    both = [(this, other) for this, other in pairs if None not in (this["evidence"], other["evidence"])]
    gains = np.array([this["evidence"] - other["evidence"] for this, other in both])
    yield statistic(f"{name}.evidence", np.abs(gains), "1")
    apart = []
    for this, other in both:
        ends = [
            (np.array(this["intervals"][n]) - other["intervals"][n]) / np.ptp(other["intervals"][n])
            for n in this["intervals"] if n in other["intervals"]
        ]  # fmt: skip
        apart += list(np.ravel(ends))
    yield statistic(f"{name}.ends", np.abs(apart), "widths")
    yield Number(f"{name}.ends.rms", float(np.sqrt(np.mean(np.square(apart)))), "widths", len(apart), 0.0)


def measure(run: Run) -> Iterator[Number]:
    places: list[tuple[str, int | str]] = [
        (kind, seed) for kind in calibration.KINDS for seed in range(1000, 1000 + run.count(*SHOTS))
    ]
    for name in SETS if run.data else ():
        files = sorted(path for path in Path(run.data, name).iterdir() if path.suffix in (".mat", ".csv"))
        places += [(name, str(path)) for path in files[: run.count(1, 3)]]
    rows = run.rows("references", one, [(*place, seed, False) for place in places for seed in (0, 1)])
    yield from compared(list(zip(rows[::2], rows[1::2], strict=True)), "seeds")
    if run.part != "seeds":
        long = run.rows("references", one, [(*place, 2, True) for place in places])
        yield from compared(list(zip(rows[::2], long, strict=True)), "long")
