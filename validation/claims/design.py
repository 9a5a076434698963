"""Intervals that `design` predicts over those that `infer` then reaches, geometric means of simulated recordings.

Settings and materials are those of benchmarks/design.py. `unchecked`: as expected; `ratio` and `within` 20 %: scaled by
checked recordings, as `design` does.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from benchmarks import design
from cavirheo.inference.design import Setting
from validation.numbers import Number, Run, share, statistic

WITHIN = 1.2


def one(job: tuple[float, float, int]) -> dict:
    radius, rate, checked = job
    found = design.halves(Setting(radius, rate, frames=design.FRAMES), checked)
    if found is None:
        return {}
    return {"unchecked": list(found.expected / found.answered), "ratio": list(found.scaled / found.answered)}


def measure(run: Run) -> Iterator[Number]:
    settings = [*product(design.RADII, design.RATES)] if run.full else design.AGAIN
    rows = [row for row in run.rows("design", one, [(*setting, run.count(4, 24)) for setting in settings]) if row]
    for i, name in enumerate(("G", "mu")):
        for key in ("ratio", "unchecked"):
            yield statistic(f"{key}.{name}", [row[key][i] for row in rows], "1")
        yield share(f"within.{name}", [abs(np.log(row["ratio"][i])) < np.log(WITHIN) for row in rows])
