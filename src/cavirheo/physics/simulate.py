"""Parameters -> Simulation: the forward problem."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cavirheo import parallel
from cavirheo.arrays import Floats
from cavirheo.bubble import CONTENTS
from cavirheo.errors import InputError, SolverError, brief, expect, expect_whole, require
from cavirheo.parameters import DURATION, RADIUS
from cavirheo.physics import cache, solver
from cavirheo.physics.damage import Damage
from cavirheo.physics.domain import POSITIVE, domain, within
from cavirheo.physics.driving import Driving
from cavirheo.physics.grid import NO_SHELLS, Grid, wall_clustered
from cavirheo.physics.law import Material
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.media import medium as named
from cavirheo.physics.scales import ACCOMMODATION, MOTIONS, Numbers, dimensionless, inertia_of
from cavirheo.physics.simulation import INSIST, Contents, Simulation
from cavirheo.physics.tableau import RODAS5P
from cavirheo.physics.viscous import Newtonian

DEFAULT = (152, 1e-4)  # shells across the bubble, relative error per step: what they are worth, benchmarks/solver.md
PRECISE = (384, 1e-5)
ROUGH: dict[str, Any] = {"cells": 64, "rtol": 3e-4}  # inside a search: 2 ms, good to 1 % of R_max, most to 0.04 %
POLYTROPIC = (0, 1e-7)  # without fields a step costs next to nothing
KINETIC = 0.1  # of rtol: kinetic contents are less stiff, and the longer steps would be less accurate
WALL_CELL = 1e-4  # thickness of the shell at the wall
MAX_STEPS = 100_000
_EXAMPLE = "NeoHookeanKelvinVoigt(shear_modulus=8e3, viscosity=0.05)"
_RTOL = domain("between 1e-12 and 0.1", lambda x: 1e-12 < x < 0.1)
_EXPONENT = domain("between 0 and 10 (1 is isothermal)", lambda x: 0 < x < 10)


def simulate(
    material: Material,
    *,
    max_radius: float,
    stretch: float,
    time: ArrayLike,
    medium: Medium | str = WATER,
    driving: Driving | None = None,
    motion: str = MOTIONS[0],
    polytropic: float | None = None,
    contents: str = CONTENTS[0],
    accommodation: float = ACCOMMODATION,
    confinement_inertia: float = 0.0,
    wall_distance: float | None = None,
    confinement_damping: float = 0.0,
    vapour_excess: float = 0.0,
    damage: Damage | None = None,
    relaxed: bool = False,
    fields: bool = False,
    precise: bool = False,
    rtol: float | None = None,
    cells: int | None = None,
    throw: bool = True,
    unusual: bool = False,
) -> Simulation:
    """One bubble from rest at R_max (laser-induced cavitation), or from equilibrium, driven by ultrasound (stretch 1).

    Args:
        material: constitutive law of the surroundings, SI.
        max_radius: R_max, m: the radius at the start.
        stretch: lambda = R_max/R_0, R_0 the stress-free equilibrium radius.
        time: (n,) s after the start, ascending, from zero or later.
        medium: liquid and gas constants, or the name of a set of them.
        driving: pressure far from the bubble above the ambient one (physics/driving.py).
        motion: "keller-miksis", "rayleigh-plesset" (incompressible) or "gilmore" (Tait's liquid).
        polytropic: exponent of the gas (1 isothermal, 1.4 adiabatic air) beside saturated vapour, instead of heat and
            vapour transport. The gas of R_0 is expanded to the start isothermally: with another exponent than 1 the
            bubble rests above R_0.
        contents: "equilibrium" (vapour at the wall is saturated, the field's model) or "kinetic" (it condenses at a
            finite rate, and its diffusivity depends on temperature and pressure).
        accommodation: of kinetic contents, above 0 and at most 10: share of the vapour's molecules that stay where
            they hit the wall, or what stands for any resistance there.
        confinement_inertia: beta = R_max sum(s_i/d_i) over the images of the bubble behind walls, d_i their distances,
            s_i = 1 for a rigid wall and -1 for a free surface.
        wall_distance: m, from the bubble's centre to one rigid wall, instead of confinement_inertia (R_max over twice
            the distance).
        confinement_damping: zeta = 2 pi (R_max^2/A) c/U_c of a tube of cross-section A around the bubble, along which
            its sound leaves as plane waves: it resists V' of the bubble's volume, as rho c V'/(2 A).
        vapour_excess: Pa of vapour above saturation at the start.
        damage: of the elastic part, at the first rebound or by strain (physics/damage.py).
        relaxed: laws with memory start unstressed; otherwise with what the growth from R_0 to R_max leaves
            (physics/growth.py), but for those that always start so (`qsls`).
        fields: keep temperature and vapour in the bubble, `Simulation.contents`.
        precise: ten times as accurate and five times as long as the default, whose error is 1e-4 of R_max in
            the median and up to 2e-3 in the most violent collapses (benchmarks/solver.md).
        rtol: relative error per step instead of the default's; of kinetic contents a tenth of it.
        cells: shells across the bubble instead of the default's.
        throw: raise on a failed solve; otherwise return it with its status.
        unusual: accept bubbles smaller than 10 nm or larger than 5 cm, and more than a second.

    Returns:
        Radius, velocity, pressure and stress at each of these times, (n,), SI.

    Raises:
        InputError: a parameter is out of its domain, or time is not as above.
        SolverError: the solve failed and throw is set.

    Source: docs/method/physics.md sections 1-4; Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006.
    """
    expect(material, Material, f"a material such as {_EXAMPLE}")
    times, medium = _checked(time), named(medium)
    within(POSITIVE, "max_radius", max_radius)
    if not unusual:
        RADIUS.check("max_radius", max_radius, "physics.max_radius", INSIST)
        DURATION.check("the last time", float(times[-1]), "physics.times_unit", INSIST)
    usual = POLYTROPIC if polytropic is not None else PRECISE if precise else DEFAULT
    cells, rtol = usual[0] if cells is None else cells, usual[1] if rtol is None else rtol
    within(_RTOL, "rtol", rtol)
    drives = driving is None or hasattr(driving, "table")
    require(drives, f"driving must be a Pulse or a Trace, got {brief(driving)}", "physics.driving")
    if polytropic is not None:
        within(_EXPONENT, "polytropic", polytropic)
        require(not fields, "polytropic contents have no fields: leave out fields or polytropic", "physics.no_fields")
    else:
        expect_whole(cells, "cells", 8, "physics.cells")
    if wall_distance is not None:
        require(
            not confinement_inertia, "give either confinement_inertia or wall_distance, not both", "physics.two_walls"
        )
        confinement_inertia = inertia_of(wall_distance, max_radius)
    way: dict[str, Any] = {"driving": driving, "motion": motion, "polytropic": polytropic or 0.0}
    way |= {"contents": contents, "accommodation": accommodation, "damage": damage}
    way |= {
        "confinement_inertia": confinement_inertia,
        "confinement_damping": confinement_damping,
        "vapour_excess": vapour_excess,
    }
    numbers = dimensionless(material, medium, max_radius, stretch, **way)
    grid = wall_clustered(cells, min(WALL_CELL, 0.5 / cells)) if polytropic is None else NO_SHELLS
    most = MAX_STEPS + len(numbers.driving) - 2  # no step passes over more than one sample of a trace
    t_c, terms = medium.time_scale(max_radius), len(numbers.memory)
    out = np.full((times.size, 4 + terms), np.nan)
    shells = np.full((times.size, 2 * cells), np.nan) if fields else np.zeros((0, 0))
    stats = np.zeros(5)
    why = where = ""
    try:
        memory = np.zeros(terms)
        stressed = np.array([arm.starts_stressed for arm in material.memory for _ in arm.terms], dtype=bool)
        if stressed.any() and not relaxed:
            from cavirheo.physics.growth import remembered  # its scipy takes a third of a second to import

            memory = np.where(stressed, remembered(numbers, rtol), 0.0)
        start = np.concatenate([[1.0, 0.0, numbers.pressure], memory])
        ways = (times / t_c, float(rtol) * (KINETIC if numbers.rate < np.inf else 1.0), most, False)
        code = solver.integrate(numbers, grid, RODAS5P, start, *ways, out, shells, stats)
        if code != solver.OK:
            low, high = numbers.elastic[[0, -1], 0]
            why = {
                solver.TOO_MANY_STEPS: f"more than {most} steps",
                solver.STEP_TOO_SMALL: "the step size went to zero",
                solver.OUTSIDE_LAW: f"R/R_0 left the range {low:.4g} to {high:.4g} of {material.elastic}",
            }[code]
            where = f" at t = {stats[3] * t_c * 1e6:.4g} us, R/R_max = {stats[4]:.3g}, with"
    except SolverError as error:
        why, where = str(error), "; with"
    status = f"{why}{where} {material} and stretch {stretch:.4g}" if why else "ok"
    if throw and why:
        raise SolverError(status)
    return Simulation(
        time=times,
        radius=out[:, 0] * max_radius,
        velocity=out[:, 1] * medium.velocity_scale,
        pressure=out[:, 2] * medium.pressure,
        stress=out[:, 3] * medium.pressure,
        equilibrium_radius=max_radius / stretch,
        status=status,
        stats={"steps": int(stats[0]), "rejected": int(stats[1]), "gas_drift": float(stats[2])},
        contents=_contents(shells, out, grid, medium, numbers) if fields else None,
        unusual=True,  # looked at before
    )


def _contents(shells: Floats, out: Floats, grid: Grid, medium: Medium, numbers: Numbers) -> Contents:
    """Temperature and mass fraction of vapour from moles per shell volume (docs/method/physics.md, section 3.2)."""
    moles, gas = np.split(shells, 2, axis=1)
    R, p = out[:, :1], out[:, 2:3]
    temperature = np.hstack([p * R**3 / moles, np.ones_like(p)]) * medium.temperature
    wall = medium.vapour_pressure / (p * medium.pressure)
    if numbers.rate < np.inf:
        outer = (gas / moles)[:, [-1, -2]] @ grid.wall[1:]
        states = zip(R[:, 0], (p - numbers.base)[:, 0] * R[:, 0] ** 3, outer, strict=True)
        wall = np.array([[1 - solver.gas_at_wall(numbers, a, b, grid.wall[0], c)[0]] for a, b, c in states])
    x = np.hstack([1 - gas / moles, wall])
    vapour = x * medium.gas_constant / (x * medium.gas_constant + (1 - x) * medium.vapour_constant)
    return Contents(np.append(grid.centre, 1.0), temperature, vapour)


class SimulationOptions(TypedDict, total=False):
    """Options of `simulate` that many bubbles share."""

    medium: Medium | str
    driving: Driving | None
    motion: str
    polytropic: float | None
    contents: str
    accommodation: float
    confinement_inertia: float
    wall_distance: float | None
    confinement_damping: float
    vapour_excess: float
    damage: Damage | None
    relaxed: bool
    fields: bool
    precise: bool
    rtol: float | None
    cells: int | None
    unusual: bool


def simulate_many(
    materials: Sequence[Material],
    *,
    max_radius: ArrayLike,
    stretch: ArrayLike,
    time: ArrayLike,
    workers: int | None = None,
    **options: Unpack[SimulationOptions],
) -> list[Simulation]:
    """`simulate` for m materials on all cores; the result does not depend on the number of workers.

    Args:
        materials: m constitutive laws, SI.
        max_radius: (m,) m, or one for all.
        stretch: (m,), or one for all.
        time: (n,) s for all, or (m, n).
        workers: threads; default: all cores.
        options: those of `simulate`.

    Returns:
        A simulation for each material. A failed solve does not raise: its status says what happened.

    Raises:
        InputError: shapes that do not belong together, or as `simulate`.

    Source: docs/method/physics.md sections 1-4.
    """
    expect(materials, Sequence, f"a list of materials such as [{_EXAMPLE}]")
    m = len(materials)
    try:
        radii, stretches = (np.broadcast_to(np.asarray(a, float), (m,)) for a in (max_radius, stretch))
        times = np.broadcast_to(np.asarray(time, float), (m, np.shape(time)[-1] if np.ndim(time) else 1))
    except (TypeError, ValueError) as error:
        shapes = f"{np.shape(max_radius)}, {np.shape(stretch)}, {np.shape(time)}"
        expected = f"numbers: max_radius and stretch as scalars or ({m},), time as (n,) or ({m}, n)"
        raise InputError(f"{m} materials need {expected}; got {shapes}", "physics.shapes") from error

    def one(i: int) -> Simulation:
        bubble: dict[str, Any] = dict(max_radius=float(radii[i]), stretch=float(stretches[i]), time=times[i])
        return simulate(materials[i], **bubble, throw=False, **options)

    first = [one(0)] if m else []  # it may compile: before threads
    return first + parallel.each(one, range(1, m), workers)


_SLOW = 2.0  # s


def load_solver() -> None:
    """Load the compiled solver; tell the user if that takes long because it is compiled for the first time."""
    loaded = threading.Event()

    def tell() -> None:
        while not loaded.wait(_SLOW):
            if cache.MISSED.is_set():  # else the machine is slow
                print("compiling the bubble solver for this machine, once (10 to 30 s) ...", file=sys.stderr)
                return

    threading.Thread(target=tell, daemon=True).start()
    try:
        simulate(Newtonian(0.1), max_radius=1e-4, stretch=2.0, time=[0.0, 1e-7])
    finally:
        loaded.set()


def _checked(time: ArrayLike) -> Floats:
    try:
        times = np.array(time, dtype=float, ndmin=1)
    except (TypeError, ValueError):
        raise InputError(f"time must be a list of numbers in s, got {brief(time)}", "physics.times") from None
    fine = times.ndim == 1 and times.size > 0 and bool(np.all(np.isfinite(times)))
    why = f"time must be a non-empty list of finite seconds, got an array of shape {times.shape}"
    require(fine, why, "physics.times")
    smallest = np.min(np.diff(times), initial=np.inf)
    got = f"got {times[0]:.4g} s first and a smallest increment of {min(smallest, 0):.4g} s"
    why = f"time must ascend from zero or later (seconds after R_max); {got}"
    require(times[0] >= 0 and smallest >= 0, why, "physics.times_descend")
    return times
