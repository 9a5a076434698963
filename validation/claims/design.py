"""Intervals that `design` predicts over those that `infer` then reaches, geometric means of simulated recordings.

Materials: nhkv, G 3 to 12 kPa, mu 0.03 to 0.1 Pa s, stretch 5 to 8; 128 frames. `unchecked`: as expected; `ratio` and
`within` 20 %: scaled by checked recordings, as `design` does. What answers of some recordings say is compared with the
answers to twice as many others, of other materials from the same ranges.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from cavirheo.inference.assumptions import Family
from cavirheo.inference.design import Draws, Setting
from cavirheo.prior import Prior
from validation.numbers import Number, Run, share, statistic

KNOWN = {"log10_shear_modulus": np.log10([3e3, 1.2e4]), "log10_viscosity": np.log10([0.03, 0.1]), "stretch": [5.0, 8.0]}
RADII, RATES, FRAMES = (100e-6, 150e-6, 250e-6, 400e-6), (250e3, 500e3, 1e6), 128
QUICK = ((400e-6, 500e3), (250e-6, 1e6), (250e-6, 500e3), (150e-6, 1e6))  # settings of a quick run
WITHIN = 1.2


def middle(widths: np.ndarray) -> np.ndarray:
    """(2,) geometric mean of half-widths of G and mu."""
    return np.exp(np.mean(np.log(widths), axis=0)) if len(widths) else np.full(2, np.nan)


def one(job: tuple[float, float, int]) -> dict:
    """Nothing where too few recordings can be read."""
    radius, rate, count = job
    setting = Setting(radius, rate, frames=FRAMES)
    x = Prior.uniform(KNOWN).sample(3 * count, 1)
    both = []
    for k, part in enumerate((slice(count), slice(count, None))):
        draws = Draws(Family("nhkv"), x[part, :2], x[part, 2], seed=10_000 + 1000 * k)
        expected, answered = draws.check_widths(setting)
        both.append((middle(expected), middle(answered), len(answered)))
    (told, checked, n), (expects, reached, others) = both
    if n < 0.8 * count or others < 1.6 * count:
        return {}
    return {"unchecked": list(expects / reached), "ratio": list(expects * checked / told / reached)}


def measure(run: Run) -> Iterator[Number]:
    settings = [*product(RADII, RATES)] if run.full else QUICK
    rows = [row for row in run.rows("design", one, [(*setting, run.count(4, 24)) for setting in settings]) if row]
    for i, name in enumerate(("G", "mu")):
        for key in ("ratio", "unchecked"):
            yield statistic(f"{key}.{name}", [row[key][i] for row in rows], "1")
        yield share(f"within.{name}", [abs(np.log(row["ratio"][i])) < np.log(WITHIN) for row in rows])
