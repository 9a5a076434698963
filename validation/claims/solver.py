"""Accuracy and time of the forward solver, beside the field's method in one run.

Cases: log10 G in [3, 6], log10 mu in [-3, 0], stretch in [3, 11], R_max in [60, 450] um, 100 us at 1 MHz. An error is
the largest difference of R/R_max to 1,024 shells and 1e-8 a step. Times are processor times, of the field's method over
ours: 500 uniform nodes, mass fractions, scipy's BDF with a sparse Jacobian at rtol 1e-6.

The part `collapse` measures the analytic collapse time: its error over the simulated time, for Sobol points over
log10 G 2.5 to 5.5, log10 mu -3 to 0, stretch 3 to 11, R_max 60 to 450 um. `largest` is that of Re > 10 and stretch > 5.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from scipy.stats import qmc

from cavirheo.physics.accuracy import DEFAULT, PRECISE, ROUGH, Accuracy
from cavirheo.physics.collapse import analytic_time, simulated_time
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import dimensionless, simulate
from validation import field_standard
from validation.numbers import Number, Run, statistic

CASES_SEED = 11
TIME = np.linspace(0, 100e-6, 101)
FINEST = Accuracy(1024, 1e-8)
PEERS = 4  # cases that the slow program solves
TURNS = 3  # the least time counts
PARTS = ("collapse",)
COLLAPSES = 1024, 4096  # bubbles in a quick and a full run
REYNOLDS = ((7.0, 10.0), (5.0, 7.0), (3.0, 5.0))  # where errors are larger


def draw(n: int) -> np.ndarray:
    """(n, 4) G Pa, mu Pa s, stretch, R_max m."""
    theta = np.random.default_rng(CASES_SEED).uniform([3, -3, 3, 60e-6], [6, 0, 11, 450e-6], (n, 4))
    theta[:, :2] = 10 ** theta[:, :2]
    return theta


def ours(row: np.ndarray, accuracy: Accuracy) -> np.ndarray:
    G, mu, stretch, R_max = row
    gel = NeoHookeanKelvinVoigt(G, mu)
    return simulate(gel, max_radius=R_max, stretch=stretch, time=TIME, accuracy=accuracy).radius / R_max


def standard(bubble: np.ndarray, medium: Medium, at: np.ndarray, nodes: np.ndarray, rtol: float) -> np.ndarray:
    """R/R_max at times (n,) s, by the field's method. bubble: G Pa, mu Pa s, stretch, R_max m."""
    G, mu, stretch, R_max = bubble
    numbers = dimensionless(NeoHookeanKelvinVoigt(G, mu), medium, R_max, stretch)
    t_c = medium.time_scale(R_max)
    material = field_standard.neo_hookean(G / medium.pressure), field_standard.newtonian(mu / (medium.pressure * t_c))
    return field_standard.solve(numbers, nodes, at / t_c, rtol, *material)


def timed(call: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """The value and the processor time it took, s: other work disturbs that less than wall time."""
    began = time.process_time()
    value = call()
    return value, time.process_time() - began


def errors(name: str, curves: list[np.ndarray], truth: list[np.ndarray]) -> Iterator[Number]:
    apart = [float(np.max(np.abs(curve - true))) for curve, true in zip(curves, truth, strict=True)]
    yield statistic(f"{name}.error", apart, "R_max", seed=CASES_SEED)
    yield statistic(f"{name}.error.largest", apart, "R_max", np.max, CASES_SEED)


def solved(call: Callable[[np.ndarray], np.ndarray], cases: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Curves, and least processor times in ms."""
    turns = [[timed(lambda row=row: call(row)) for row in cases] for _ in range(TURNS)]
    return [curve for curve, _ in turns[0]], 1e3 * np.min([[spent for _, spent in turn] for turn in turns], axis=0)


def collapse(run: Run) -> Iterator[Number]:
    u = qmc.Sobol(4, seed=1).random(run.count(*COLLAPSES))
    G, mu = 10 ** (2.5 + 3 * u[:, 0]), 10 ** (-3 + 3 * u[:, 1])
    stretch, radius = 3 + 8 * u[:, 2], 60e-6 * 7.5 ** u[:, 3]
    simulated = simulated_time(radius, stretch, G, mu)
    simulated[~np.isfinite(simulated)] = np.nan  # no collapse
    off = analytic_time(radius, stretch, G, mu) / simulated - 1.0
    Re = WATER.pressure * radius / (mu * WATER.velocity_scale)
    yield Number("collapse.bubbles", len(u), "1", len(u), 0.0)
    yield statistic("collapse.median", off[Re > 10], "1")
    yield statistic("collapse.largest", np.abs(off[(Re > 10) & (stretch > 5)]), "1", np.max)
    for low, high in REYNOLDS:
        yield statistic(f"collapse.re.{low:g}", off[(Re >= low) & (Re < high)], "1")


def measure(run: Run) -> Iterator[Number]:
    if run.part == "collapse" or run.full:
        yield from collapse(run)
    if run.part:
        return
    cases = draw(run.count(20, 60))
    truth = [ours(row, FINEST) for row in cases]
    for name, accuracy in {"default": DEFAULT, "rough": ROUGH, "precise": PRECISE}.items():
        curves, spent = solved(lambda row, accuracy=accuracy: ours(row, accuracy), cases)
        yield from errors(name, curves, truth)
        yield statistic(f"{name}.ms", spent, "ms", seed=CASES_SEED)
        if name == "default":
            curves, usual = curves[:PEERS], spent[:PEERS]
            yield from errors("peers.default", curves, truth[:PEERS])
    nodes = np.linspace(0, 1, 500)
    others = [timed(lambda row=row: standard(row, WATER, TIME, nodes, 1e-6)) for row in cases[:PEERS]]
    yield from errors("peers.field", [curve for curve, _ in others], truth[:PEERS])
    ratios = [1e3 * spent / mine for (_, spent), mine in zip(others, usual, strict=True)]
    yield statistic("peers.field.ratio", ratios, "1", seed=CASES_SEED)
