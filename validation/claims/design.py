"""Intervals that `design` predicts over those that `infer` then reaches, geometric means of recordings.

Materials: nhkv, G 3 to 12 kPa, mu 0.03 to 0.1 Pa s, stretch 5 to 8; 128 frames, noise of 1 % of R_max. What is expected
of some recordings is compared with the answers to as many others of the same materials. `within`: 20 %.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from cavirheo import infer_many
from cavirheo.inference.assumptions import Family
from cavirheo.inference.design import Draws, Setting
from cavirheo.prior import Prior
from validation.numbers import Number, Run, share, statistic

KNOWN = {"log10_shear_modulus": np.log10([3e3, 1.2e4]), "log10_viscosity": np.log10([0.03, 0.1]), "stretch": [5.0, 8.0]}
RADII, RATES, NOISE = (100e-6, 150e-6, 250e-6, 400e-6), (250e3, 500e3, 1e6), 0.01
QUICK = ((400e-6, 500e3), (250e-6, 1e6), (250e-6, 500e3), (150e-6, 1e6))  # settings of a quick run
WITHIN = 1.2


def reached(draws: Draws, setting: Setting) -> list[np.ndarray]:
    """Half-widths (2,) of G and mu in decades of the answers of `infer` that count."""
    curves = [film.curve for film in draws.films(setting) if film]
    answers = infer_many(curves, material=draws.family.name)
    counted = [one for one in answers if one.theta.size and one.checks.verdict != "check_input"]
    ends = [[one.interval(name) for name in draws.family.parameters] for one in counted]
    return [0.5 * np.log10([high / low for low, high in pair]) for pair in ends if all(pair)]


def one(job: tuple[float, float, int]) -> dict:
    """Nothing where too few recordings can be read."""
    radius, rate, count = job
    setting = Setting(radius, rate, NOISE * radius)
    x = Prior.uniform(KNOWN).sample(count, 1)
    first, others = (Draws(Family("nhkv"), x[:, :2], x[:, 2], seed=seed) for seed in (0, 1000))
    (told,) = first.expectations([setting])
    expected = [each.half_width for each in told if each]
    answered = reached(others, setting)
    if min(len(expected), len(answered)) < 0.8 * count:
        return {}
    ratio = np.exp(np.mean(np.log(expected), axis=0) - np.mean(np.log(answered), axis=0))
    return {"ratio": ratio.tolist()}


def measure(run: Run) -> Iterator[Number]:
    settings = [*product(RADII, RATES)] if run.full else QUICK
    rows = [row for row in run.rows("design", one, [(*setting, run.count(8, 24)) for setting in settings]) if row]
    for i, name in enumerate(("G", "mu")):
        yield statistic(f"ratio.{name}", [row["ratio"][i] for row in rows], "1")
        yield share(f"within.{name}", [abs(np.log(row["ratio"][i])) < np.log(WITHIN) for row in rows])
