"""Parameters -> Simulation: the forward problem."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.errors import InputError, SolverError
from cavirheo.physics import solver, tableau
from cavirheo.physics.grid import wall_clustered
from cavirheo.physics.materials import Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.scales import dimensionless

CELLS = 128  # shells across the bubble, and
WALL_CELL = 1e-4  # the thickness of the one at the wall: both set the error of space (benchmarks/solver.md)
RTOL = 3e-5
MAX_STEPS = 100_000


@dataclass(frozen=True, eq=False)
class Simulation:
    """One solved (or failed) forward problem. Where a solve failed the arrays hold NaN from there on."""

    time: NDArray[np.float64]  # (n,) s after R_max
    radius: NDArray[np.float64]  # (n,) m
    velocity: NDArray[np.float64]  # (n,) m/s, of the wall
    pressure: NDArray[np.float64]  # (n,) Pa, in the bubble
    status: str  # "ok", or what went wrong and where
    stats: dict[str, float]  # steps, rejected, gas_drift (relative change of the gas in the bubble)

    @property
    def ok(self) -> bool:
        return self.status == "ok"


def simulate(
    material: Material,
    *,
    max_radius: float,
    stretch: float,
    time: ArrayLike,
    medium: Medium = WATER,
    rtol: float = RTOL,
    cells: int = CELLS,
    throw: bool = True,
) -> Simulation:
    """Keller-Miksis with heat and vapour transport from rest at R_max (laser-induced cavitation).

    Args:
        material: constitutive law of the surroundings, SI.
        max_radius: R_max, m.
        stretch: lambda = R_max/R_0, R_0 the stress-free equilibrium radius.
        time: (n,) s after R_max, ascending, from zero or later.
        medium: liquid and gas constants.
        rtol: relative error per step; cells: shells across the bubble. The defaults are good to about 1e-3 of R_max
            in the most violent collapses and 1e-4 in most (benchmarks/solver.md).
        throw: raise on a failed solve; otherwise return it with its status.

    Raises:
        InputError: a parameter is out of its domain, or time is not as above.
        SolverError: the solve failed and throw is set.

    Source: docs/physics.md sections 1-4; Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006.
    """
    times = _checked(time)
    if not 1e-12 < rtol < 0.1:
        raise InputError(f"rtol must lie between 1e-12 and 0.1, got {rtol!r}")
    numbers = dimensionless(material, medium, max_radius, stretch)
    t_c = medium.time_scale(max_radius)
    radius, velocity, pressure = (np.full(times.shape, np.nan) for _ in range(3))
    stats = np.zeros(5)
    code = solver.integrate(
        numbers, wall_clustered(cells, min(WALL_CELL, 0.5 / cells)), tableau.A, tableau.C, tableau.GAMMA,
        tableau.ORDER, times / t_c, rtol, MAX_STEPS, radius, velocity, pressure, stats,
    )  # fmt: skip
    status = "ok"
    if code != solver.OK:
        low, high = numbers.elastic[[0, -1], 0]
        why = {
            solver.TOO_MANY_STEPS: f"more than {MAX_STEPS} steps",
            solver.STEP_TOO_SMALL: "the step size went to zero",
            solver.OUTSIDE_LAW: f"R/R_0 left the range {low:.4g} to {high:.4g} of {material.elastic}",
        }[code]
        where = f"t = {stats[3] * t_c * 1e6:.4g} us, R/R_max = {stats[4]:.3g}"
        status = f"{why} at {where}, with {material} and stretch {stretch:.4g}"
        if throw:
            raise SolverError(status)
    return Simulation(
        time=times,
        radius=radius * max_radius,
        velocity=velocity * medium.velocity_scale,
        pressure=pressure * medium.pressure,
        status=status,
        stats={"steps": int(stats[0]), "rejected": int(stats[1]), "gas_drift": float(stats[2])},
    )


def simulate_many(
    materials: Sequence[Material],
    *,
    max_radius: ArrayLike,
    stretch: ArrayLike,
    time: ArrayLike,
    medium: Medium = WATER,
    rtol: float = RTOL,
    cells: int = CELLS,
    workers: int | None = None,
) -> list[Simulation]:
    """`simulate` for m materials on all cores; the result does not depend on the number of workers.

    max_radius and stretch are (m,) or scalars, time (n,) for all or (m, n). A failed solve does not raise: its
    status says what happened.
    """
    m = len(materials)
    try:
        radii, stretches = (np.broadcast_to(np.asarray(a, float), (m,)) for a in (max_radius, stretch))
        times = np.broadcast_to(np.asarray(time, float), (m, np.shape(time)[-1] if np.ndim(time) else 1))
    except ValueError as error:
        raise InputError(
            f"{m} materials need max_radius and stretch as scalars or ({m},), time as (n,) or ({m}, n); "
            f"got {np.shape(max_radius)}, {np.shape(stretch)}, {np.shape(time)}"
        ) from error

    def one(i: int) -> Simulation:
        return simulate(
            materials[i], max_radius=float(radii[i]), stretch=float(stretches[i]), time=times[i],
            medium=medium, rtol=rtol, cells=cells, throw=False,
        )  # fmt: skip

    done = [one(i) for i in range(m if workers == 1 else min(m, 1))]  # the first may compile: before threads
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        return done + list(pool.map(one, range(len(done), m)))


def _checked(time: ArrayLike) -> NDArray[np.float64]:
    times = np.array(time, dtype=float, ndmin=1)
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)):
        raise InputError(f"time must be a non-empty list of finite seconds, got an array of shape {times.shape}")
    if times[0] < 0 or np.any(np.diff(times) < 0):
        raise InputError(
            "time must ascend from zero or later (seconds after R_max); "
            f"got {times[0]:.4g} s first and a smallest increment of {np.min(np.diff(times), initial=0):.4g} s"
        )
    return times
