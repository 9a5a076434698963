"""The posterior network alone: how often its intervals hold the truth over its whole prior, without a simulation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks import method_figures, posterior_network
from cavirheo.inference.posterior_network import z_index
from cavirheo.writing import style
from validation.claims.calibration import LEVELS, SHOWN
from validation.numbers import Number, Run, coverage


def measure(run: Run) -> Iterator[Number]:
    found = posterior_network.distances(run.count(300, 1000))
    for symbol, name in SHOWN.items():
        mine = np.array([one.distance for one in found if one.coordinate == z_index(name)])
        for level in LEVELS:
            yield coverage(f"{symbol}.{100 * level:.0f}", mine < level, level, seed=posterior_network.SEED)
    if run.pictures:
        style.save(run.picture("docs/method/draws.png"), method_figures.draws(), dpi=method_figures.DPI)
