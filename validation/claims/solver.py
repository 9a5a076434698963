"""Accuracy and time of the forward solver, beside the field's method and PyIMR (where it is installed) in one run.

Cases and ways are those of benchmarks/solver.py. An error is the largest difference of R/R_max to 1,024 shells and 1e-8
a step. Times are processor times; those of other programs are ratios to ours of the same cases.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks import solver
from cavirheo.physics.accuracy import DEFAULT, PRECISE, ROUGH
from cavirheo.physics.media import WATER
from validation.numbers import Number, Run, statistic

CASES_SEED = 11
PEERS = 4  # cases that the slow programs solve
TURNS = 3  # the least time counts


def errors(name: str, curves: list[np.ndarray], truth: list[np.ndarray]) -> Iterator[Number]:
    apart = [float(np.max(np.abs(curve - true))) for curve, true in zip(curves, truth, strict=True)]
    yield statistic(f"{name}.error", apart, "R_max", seed=CASES_SEED)
    yield statistic(f"{name}.error.largest", apart, "R_max", np.max, CASES_SEED)


def solved(call: Callable[[np.ndarray], np.ndarray], cases: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Curves, and least processor times in ms."""
    turns = [[solver.timed(lambda row=row: call(row)) for row in cases] for _ in range(TURNS)]
    return [curve for curve, _ in turns[0]], 1e3 * np.min([[spent for _, spent in turn] for turn in turns], axis=0)


def measure(run: Run) -> Iterator[Number]:
    cases = solver.draw(run.count(20, 60), CASES_SEED)
    truth = [solver.ours(row, solver.FINEST) for row in cases]
    for name, accuracy in {"default": DEFAULT, "rough": ROUGH, "precise": PRECISE}.items():
        curves, spent = solved(lambda row, accuracy=accuracy: solver.ours(row, accuracy), cases)
        yield from errors(name, curves, truth)
        yield statistic(f"{name}.ms", spent, "ms", seed=CASES_SEED)
        if name == "default":
            curves, ours = curves[:PEERS], spent[:PEERS]
            yield from errors("peers.default", curves, truth[:PEERS])
    others = [solver.timed(lambda row=row: solver.standard(row)) for row in cases[:PEERS]]
    yield from errors("peers.field", [curve for curve, _ in others], truth[:PEERS])
    ratios = [1e3 * spent / mine for (_, spent), mine in zip(others, ours, strict=True)]
    yield statistic("peers.field.ratio", ratios, "1", seed=CASES_SEED)
    if importlib.util.find_spec("pyimr") is not None:
        from benchmarks import pyimr_peer

        for nodes in (25, 50):
            runs = [pyimr_peer.solve(row, WATER, solver.TIME, nodes, 1e-6) for row in cases[:PEERS]]
            good = [k for k, one in enumerate(runs) if one.ratio is not None]
            yield from errors(f"peers.pyimr{nodes}", [runs[k].ratio for k in good], [truth[k] for k in good])
            ratios = [1e3 * runs[k].seconds / ours[k] for k in good]
            yield statistic(f"peers.pyimr{nodes}.ratio", ratios, "1", seed=CASES_SEED)
