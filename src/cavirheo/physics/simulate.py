"""Parameters -> Simulation: the forward problem, and the dimensionless numbers that it is solved in
(docs/method/physics.md, section 1).

Scales: R_c = R_max, U_c = sqrt(p_inf/rho), t_c = R_c/U_c, p_inf for pressures, T_inf for temperature.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import inf, pi, prod, sqrt
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from cavirheo import parallel
from cavirheo.arrays import Floats
from cavirheo.errors import InputError, SolverError, brief, expect
from cavirheo.landmarks import turning_points
from cavirheo.parameters import DURATION, POSITIVE, RADIUS, check_domain, domain
from cavirheo.physics import cache, solver
from cavirheo.physics.accuracy import DEFAULT, NO_SHELLS, RODAS5P, Accuracy, Grid, wall_clustered
from cavirheo.physics.bubble import FIELD, Bubble, Damage
from cavirheo.physics.laws import Material, Newtonian, table_of
from cavirheo.physics.media import WATER, Driving, Medium
from cavirheo.physics.media import medium as medium_of
from cavirheo.physics.table import hermite, look_up, scale_table

TAIT_EXPONENT = 7.15  # exponent of water in Tait's equation of state: Gilmore 1952
STRETCH_DOMAIN = domain("at least 1 (the bubble starts at its largest radius)", lambda x: 1 <= x < inf)
ZERO_TABLE = np.zeros((2, 7))  # table that is 0 everywhere: no stress, or no driving
ZERO_TABLE[1, 0] = np.inf
POLYTROPIC = 1e-7  # largest relative error of a step with polytropic contents, which is cheap
KINETIC = 0.1  # factor of the relative error: kinetic contents are less stiff; steps would be too long
MAX_STEPS = 100_000
GROWTH_TIME = np.linspace(0.0, 4.0, 401)  # in t_c; the wall turns after about one
GROWTH_ERROR = (1e-7, 1e-5)
GROWTH_MISS = 0.03  # of R^3: if the miss is smaller, memories are interpolated between impulses
LARGEST_IMPULSE = 1e9  # largest impulse that is tried, over stretch^3
_IF_MEANT = " (if it is meant: unusual=True)"
_EXAMPLE = "NeoHookeanKelvinVoigt(shear_modulus=8e3, viscosity=0.05)"


class Numbers(NamedTuple):
    """Input of the compiled solver; every field is dimensionless."""

    C: float  # c/U_c
    We: float  # p_inf R_max/(2 gamma); infinite without surface tension
    stretch: float  # lambda = R_max/R_0
    Fo: float  # D/(U_c R_max), mass Fourier number
    chi: float  # T_inf K_inf/(p_inf R_max U_c)
    A: float  # A T_inf/K_inf
    B: float  # B/K_inf = 1 - A
    pv: float  # vapour pressure/p_inf
    kappa: float
    elastic: Floats  # (n, 7) table of S_el/p_inf over R/R_0 (physics/table.py)
    elastic_falling: Floats  # (n, 7) the same for R/R_max below damage[2] (`falling_table`); (0, 7) without damage
    damage: Floats  # (3,) both factors of a tenfold contraction, and the smallest R/R_max so far; 0 without damage
    viscous: Floats  # (m, 7) table of S_v/p_inf over t_c U/R, for U >= 0
    memory: Floats  # (k, 4) C_k/p_inf, power n_k, t_c/tau, p_inf/C_k or 0, of each relaxing term (physics/laws.py)
    elastic_relaxes: bool  # whether the elastic part acts through a relaxing term alone
    driving: Floats  # (n, 7) table of the far-field pressure above ambient, over p_inf, over t/t_c
    polytropic: float  # exponent of the gas where the contents are polytropic
    tait: float  # exponent of the liquid in Gilmore's equation; 0: Keller-Miksis
    vapour: float  # pressure of the vapour at the start/p_inf
    condensation_rate: float  # a of docs (3.11): accommodation sqrt(R_v T_inf/2 pi)/U_c; infinite: equilibrium
    variable_D: bool  # whether D = Fo T^1.75/p instead of Fo
    inertia: float  # beta of the walls, at R_max
    radiation: float  # zeta of the tube, at R_max
    base: float  # p_b, subtracted from the pressure in the state of the solver (docs/method/physics.md, section 3.2)

    @property
    def pressure(self) -> float:
        """Pressure at the start (3.9): vapour, and the gas of the equilibrium at R_0 after isothermal expansion."""
        return self.vapour + (1 + self.stretch / self.We - self.pv) / self.stretch**3


@dataclass(frozen=True, eq=False)
class Contents:
    """Temperature and vapour in the bubble, from its centre to its wall.

    Attributes:
        position: (m,) r/R of the centroids of the shells and of the wall, ascending to 1.
        temperature: (n, m) K.
        vapour: (n, m) mass fraction of vapour.
    """

    position: Floats
    temperature: Floats
    vapour: Floats

    def __repr__(self) -> str:
        frames, places = self.temperature.shape
        return f"Contents({frames} frames, {places} places, at most {np.nanmax(self.temperature):.4g} K)"


@dataclass(frozen=True, eq=False)
class Simulation:
    """One solved (or failed) forward problem. If the solve failed, the arrays are NaN from the failure on.

    Attributes:
        time: (n,) s after the start.
        radius: (n,) m.
        velocity: (n,) m/s, of the wall.
        pressure: (n,) Pa, in the bubble.
        stress: (n,) Pa, stress integral of the material: positive where it pushes the wall outwards.
        equilibrium_radius: R_0, m.
        status: "ok", or what went wrong and where.
        stats: steps, rejected, gas_drift (relative change of the gas in the bubble).
        contents: temperature and vapour in the bubble, if `fields` was set.
    """

    time: Floats
    radius: Floats
    velocity: Floats
    pressure: Floats
    stress: Floats
    equilibrium_radius: float
    status: str
    stats: dict[str, float]
    contents: Contents | None = None

    def __repr__(self) -> str:
        solved = np.isfinite(self.radius)
        frames = f"{len(self.time)} frames" if solved.all() else f"{solved.sum()} of {len(self.time)} frames"
        words = [self.status if self.ok else f"failed: {self.status}", frames]
        if solved.any():
            words += [
                f"{1e6 * self.time[0]:.4g} to {1e6 * self.time[solved][-1]:.4g} us",
                f"R {1e6 * np.nanmin(self.radius):.4g} to {1e6 * np.nanmax(self.radius):.4g} um",
                f"R_0 {1e6 * self.equilibrium_radius:.4g} um",
                f"collapses: {self.collapses}",
            ]
        return f"Simulation({', '.join(words)})"

    @property
    def ok(self) -> bool:
        """Whether the solve reached the last time."""
        return self.status == "ok"

    @property
    def strain(self) -> Floats:
        """(n,) logarithmic hoop strain at the wall, ln(R/R_0); the radial strain is -2 times as large."""
        return np.log(self.radius / self.equilibrium_radius)

    @property
    def strain_rate(self) -> Floats:
        """(n,) hoop strain rate at the wall, 1/s; the radial rate is -2 times, the shear rate 2 sqrt(3) times it."""
        return self.velocity / self.radius

    @property
    def collapses(self) -> int:
        """Number of minima of R after which R rises by more than 3 % of the largest R, as for a noise-free curve."""
        radius = self.radius[np.isfinite(self.radius)]
        return len(turning_points(radius, 0.03 * radius.max(initial=0.0))[0])

    @property
    def columns(self) -> dict[str, Floats]:
        """(n,) each, named as in the CSV of `cavirheo simulate`: "time_us", "radius_um", "velocity_m_per_s", ..."""
        wall = {"time_us": self.time * 1e6, "radius_um": self.radius * 1e6, "velocity_m_per_s": self.velocity}
        forces = {"pressure_Pa": self.pressure, "stress_Pa": self.stress}
        return wall | forces | {"strain": self.strain, "strain_rate_per_s": self.strain_rate}


def simulate(
    material: Material,
    *,
    max_radius: float,
    stretch: float,
    time: ArrayLike,
    medium: Medium | str = WATER,
    bubble: Bubble = FIELD,
    driving: Driving | None = None,
    relaxed: bool = False,
    fields: bool = False,
    accuracy: Accuracy = DEFAULT,
    throw: bool = True,
    unusual: bool = False,
) -> Simulation:
    """Simulate a bubble from rest at R_max (laser cavitation), or driven by ultrasound from equilibrium (stretch 1).

    Args:
        material: constitutive law of the surroundings, SI.
        max_radius: R_max, m: the radius at the start.
        stretch: lambda = R_max/R_0, R_0 the stress-free equilibrium radius.
        time: (n,) s after the start, ascending, from zero or later.
        medium: liquid and gas constants, or the name of a set of them.
        bubble: equation of the wall, contents, confinement and damage; no value may be "free".
        driving: pressure far from the bubble above the ambient one (`Pulse`, `Trace`).
        relaxed: start laws with memory without stress; otherwise, but for `qsls`, with that of `memories_after_growth`.
        fields: keep temperature and vapour in the bubble, `Simulation.contents`.
        accuracy: in space and time; PRECISE of physics/accuracy.py is six times as accurate as the default.
        throw: raise on a failed solve; otherwise return it with its status.
        unusual: accept bubbles smaller than 10 nm or larger than 5 cm, and times of more than a second.

    Returns: radius, velocity, pressure and stress at each of these times, (n,), SI.

    Raises:
        InputError: a parameter is out of its domain, a value of the bubble is free, or time is not as above.
        SolverError: the solve failed and throw is set.

    Source: docs/method/physics.md sections 1-4; Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006."""
    times = _checked_times(time)
    medium = medium_of(medium)
    _check_types(material, bubble, accuracy, driving, relaxed=relaxed, fields=fields, throw=throw, unusual=unusual)
    _check_size(material, max_radius, stretch, times, unusual=unusual)
    numbers = dimensionless(material, medium, max_radius, stretch, bubble=bubble, driving=driving)
    out = np.full((times.size, 4 + len(numbers.memory)), np.nan)
    shells = np.full((times.size, 2 * accuracy.shells), np.nan) if fields else np.zeros((0, 0))
    stats = np.zeros(5)
    failure = _solve(numbers, material, times, medium.time_scale(max_radius), accuracy, relaxed, out, shells, stats)
    if failure and throw:
        raise SolverError(failure)
    return Simulation(
        time=times,
        radius=out[:, 0] * max_radius,
        velocity=out[:, 1] * medium.velocity_scale,
        pressure=out[:, 2] * medium.pressure,
        stress=out[:, 3] * medium.pressure,
        equilibrium_radius=max_radius / stretch,
        status=failure or "ok",
        stats={"steps": int(stats[0]), "rejected": int(stats[1]), "gas_drift": float(stats[2])},
        contents=_contents(out, shells, medium, numbers, wall_clustered(accuracy.shells)) if fields else None,
    )


def _check_types(
    material: Material, bubble: Bubble, accuracy: Accuracy, driving: Driving | None, **switches: bool
) -> None:
    """Raises InputError for arguments of `simulate` of a wrong type, or that exclude each other."""
    expect(material, Material, f"a material such as {_EXAMPLE}")
    expect(bubble, Bubble, "a Bubble such as Bubble(contents='kinetic', accommodation=0.07)")
    expect(accuracy, Accuracy, "an Accuracy such as Accuracy(shells=128, relative_error=2e-4)")
    for name, value in switches.items():
        expect(value, bool | np.bool_, f"True or False as {name}")
    if driving is not None and not hasattr(driving, "table"):
        raise InputError(f"driving must be a Pulse or a Trace, got {brief(driving)}", "physics.driving")
    if switches["fields"] and bubble.exponent is not None:
        message = "a gas with an exponent has no fields: leave out fields, or the exponent of the bubble"
        raise InputError(message, "physics.no_fields")


def _check_size(material: Material, max_radius: float, stretch: float, times: Floats, *, unusual: bool) -> None:
    """Raises InputError for arrays, or a radius, m, or a last time, s, that cannot be, or hardly can unless
    `unusual`."""
    parts, numbers = material.parts(), [("max_radius", max_radius), ("stretch", stretch)]
    for law in (parts.elastic, parts.viscous, *parts.memory):
        numbers += vars(law).items() if law else []
    for name, value in numbers:
        if np.ndim(value):
            message = f"{name} must be one number, got an array of shape {np.shape(value)}: simulate_many takes many"
            raise InputError(message, f"physics.{name}")
    check_domain(POSITIVE, "max_radius", max_radius)
    if not unusual:
        RADIUS.check("max_radius", max_radius, "physics.max_radius", _IF_MEANT)
        DURATION.check("the last time", float(times[-1]), "physics.times_unit", _IF_MEANT)


def _solve(
    numbers: Numbers,
    material: Material,
    times: Floats,
    t_c: float,
    accuracy: Accuracy,
    relaxed: bool,
    out: Floats,
    shells: Floats,
    stats: Floats,
) -> str:
    """Solve for times (n,), s, with t_c, s, as their scale; returns what failed and where, or "".

    Fills, in dimensionless numbers, until a failure: `out` (n, 4 + k) with radius, velocity, pressure, stress and k
    memories; `shells` (n, 2 shells), unless it is empty, with moles of gas and vapour and moles of gas in each shell;
    `stats` (5,) with steps, rejected steps, drift of the gas, and the time and the radius that were reached.
    """
    grid, relative_error = wall_clustered(accuracy.shells), accuracy.relative_error
    if numbers.polytropic:
        grid, relative_error = NO_SHELLS, min(relative_error, POLYTROPIC)
    most = MAX_STEPS + len(numbers.driving) - 2  # no step passes over more than one sample of a trace
    memory = np.zeros(len(numbers.memory))
    stressed = np.array([arm.stressed_by_growth for arm in material.parts().memory for _ in arm.terms], dtype=bool)
    if stressed.any() and not relaxed:
        try:
            memory = np.where(stressed, memories_after_growth(numbers, relative_error), 0.0)
        except SolverError as error:
            return f"{error}; with {material} and stretch {numbers.stretch:.4g}"
    start = np.concatenate([[1.0, 0.0, numbers.pressure], memory])
    args = (times / t_c, float(relative_error) * (KINETIC if numbers.condensation_rate < np.inf else 1.0), most, False)
    code = solver.integrate(numbers, grid, RODAS5P, start, *args, out, shells, stats)
    lost = np.flatnonzero(out[:, 0] <= 0.0)  # the polynomial of a step at rest that is many t_c long
    if len(lost):
        out[lost[0] :] = np.nan
        at = times[lost[0]]
        return f"no radius above 0 at t = {at * 1e6:.4g} us, {at / t_c:.2g} times t_c: simulate a shorter time"
    if code == solver.OK:
        return ""
    low, high = numbers.elastic[[0, -1], 0]
    why = {
        solver.TOO_MANY_STEPS: f"more than {most} steps",
        solver.STEP_TOO_SMALL: "the step size went to zero",
        solver.OUTSIDE_LAW: f"R/R_0 left the range {low:.4g} to {high:.4g} of {material.parts().elastic}",
    }[code]
    where = f"t = {stats[3] * t_c * 1e6:.4g} us, R/R_max = {stats[4]:.3g}"
    return f"{why} at {where}, with {material} and stretch {numbers.stretch:.4g}"


def _contents(out: Floats, shells: Floats, medium: Medium, numbers: Numbers, grid: Grid) -> Contents:
    """Temperature and mass fraction of vapour from moles per shell volume (docs/method/physics.md, section 3.2)."""
    moles, gas = np.split(shells, 2, axis=1)
    R, p = out[:, :1], out[:, 2:3]
    temperature = np.hstack([p * R**3 / moles, np.ones_like(p)]) * medium.temperature
    wall = medium.vapour_pressure / (p * medium.pressure)
    if numbers.condensation_rate < np.inf:
        outer = (gas / moles)[:, [-1, -2]] @ grid.wall[1:]
        states = zip(R[:, 0], (p - numbers.base)[:, 0] * R[:, 0] ** 3, outer, strict=True)
        wall = np.array([[1 - solver.gas_at_wall(numbers, a, b, grid.wall[0], c)[0]] for a, b, c in states])
    x = np.hstack([1 - gas / moles, wall])
    vapour = x * medium.gas_constant / (x * medium.gas_constant + (1 - x) * medium.vapour_constant)
    return Contents(np.append(grid.centre, 1.0), temperature, vapour)


class SimulationOptions(TypedDict, total=False):
    """Options of `simulate` that all bubbles of `simulate_many` share."""

    medium: Medium | str
    bubble: Bubble
    driving: Driving | None
    relaxed: bool
    fields: bool
    accuracy: Accuracy
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

    def simulate_one(i: int) -> Simulation:
        shot: dict[str, Any] = dict(max_radius=float(radii[i]), stretch=float(stretches[i]), time=times[i])
        return simulate(materials[i], **shot, throw=False, **options)

    first = [simulate_one(0)] if m else []  # before threads start, because it may compile
    return first + parallel.run_jobs(simulate_one, range(1, m), workers)


def load_solver() -> None:
    """Load the compiled solver; Ctrl-C ends it. If it must be compiled first, the user is told."""
    cache.NOTICES["solver.integrate"] = "compiling the bubble solver for this machine, once (10 to 30 s) ..."
    run = partial(simulate, max_radius=1e-4, stretch=2.0, time=[0.0, 1e-7])
    parallel.run_jobs(run, [Newtonian(0.1)], 1)  # in a thread: this one only waits


def _checked_times(time: ArrayLike) -> Floats:
    try:
        times = np.array(time, dtype=float, ndmin=1)
    except (TypeError, ValueError):
        raise InputError(f"time must be a list of numbers in s, got {brief(time)}", "physics.times") from None
    if times.ndim != 1 or times.size == 0 or not np.all(np.isfinite(times)):
        why = f"time must be a non-empty list of finite seconds, got an array of shape {times.shape}"
        raise InputError(why, "physics.times")
    smallest = np.min(np.diff(times), initial=np.inf)
    if times[0] < 0 or smallest < 0:
        got = f"got {times[0]:.4g} s first and a smallest increment of {min(smallest, 0):.4g} s"
        raise InputError(f"time must ascend from zero or later (seconds after R_max); {got}", "physics.times_descend")
    return times


def dimensionless(
    material: Material,
    medium: Medium,
    max_radius: float,
    stretch: float,
    *,
    bubble: Bubble = FIELD,
    driving: Driving | None = None,
) -> Numbers:
    """Numbers of a bubble of `max_radius` (m) and `stretch` (1) in a material (SI) and a medium. Raises InputError:
    the stretch is below 1, the bubble has free values, it follows Gilmore's equation in an incompressible medium, a
    wall is nearer than R_max, or there is damage without an elastic part."""
    bubble.check_known()
    if bubble.motion == "gilmore" and medium.sound_speed == inf:
        why = "Gilmore's equation needs a finite speed of sound: use motion='rayleigh-plesset'"
        raise InputError(why, "physics.sound_speed")
    check_domain(STRETCH_DOMAIN, "stretch = R_max/R_0", stretch)
    kinetic, parts = bubble.contents == "kinetic", material.parts()
    U_c, p, pv = medium.velocity_scale, medium.pressure, medium.vapour_pressure / medium.pressure
    K_inf = medium.conductivity_slope * medium.temperature + medium.conductivity_intercept
    A = medium.conductivity_slope * medium.temperature / K_inf
    mean_speed = sqrt(medium.vapour_constant * medium.temperature / (2 * pi))  # of the vapour towards the wall
    fields: dict[str, Any] = dict(
        C=inf if bubble.motion == "rayleigh-plesset" else medium.sound_speed / U_c,
        We=p * max_radius / (2 * medium.surface_tension) if medium.surface_tension else inf,
        stretch=stretch,
        Fo=medium.diffusivity / (U_c * max_radius),
        chi=medium.temperature * K_inf / (p * max_radius * U_c),
        A=A,
        B=1 - A,
        pv=pv,
        kappa=medium.adiabatic_index,
        polytropic=bubble.exponent or 0.0,
        tait=TAIT_EXPONENT if bubble.motion == "gilmore" else 0.0,
        vapour=pv + float(bubble.vapour_excess) / p,
        condensation_rate=float(bubble.accommodation) * mean_speed / U_c if kinetic else inf,
        inertia=bubble.inertia(max_radius),
        radiation=bubble.confinement_damping,
        base=pv if (driving or stretch > 20) and not kinetic else 0.0,  # kinetic: p may fall below p_v
    )
    elastic, viscous = (table_of(part) if part else ZERO_TABLE for part in parts[:2])
    falling, damage = _damage_tables(bubble, material, elastic, stretch)
    arms = [arm.table() * [1 / p, 1.0, max_radius / U_c, p] for arm in parts.memory]
    return Numbers(
        **{name: float(value) for name, value in fields.items()},  # with ints the solver would be compiled again
        variable_D=kinetic,
        elastic=scale_table(elastic, 1.0, 1 / p),
        elastic_falling=scale_table(falling, 1.0, 1 / p),
        damage=damage,
        viscous=scale_table(viscous, max_radius / U_c, 1 / p),
        memory=np.concatenate([np.zeros((0, 4)), *arms]),
        elastic_relaxes=any(arm.relaxes_elastic_part for arm in parts.memory),
        driving=scale_table(driving.table() if driving else ZERO_TABLE, U_c / max_radius, 1 / p),
    )


def _damage_tables(bubble: Bubble, material: Material, elastic: Floats, stretch: float) -> tuple[Floats, Floats]:
    """`elastic_falling`, in Pa, and `damage` of Numbers."""
    if not isinstance(bubble.damage, Damage):
        return np.zeros((0, 7)), np.zeros(3)
    if material.parts().elastic is None:
        why = f"damage needs a material with an elastic part, {material} has none: leave out damage or add a spring"
        raise InputError(why, "physics.damage_without_elasticity")
    factors = np.array([bubble.damage.modulus, bubble.damage.radius, 1.0])
    return falling_table(elastic, bubble.damage, stretch), factors


def falling_table(elastic: Floats, damage: Damage, stretch: float) -> Floats:
    """(n, 7) table of the stress while the wall is at its smallest radius so far, x = R/R(0) = L/stretch, from the
    table (m, 7) of the undamaged law (physics/table.py):

    S = x^a S_el(u),  u = L x^b,  a = -log10 modulus,  b = log10 radius.
    """
    a, b = -np.log10(damage.modulus), np.log10(damage.radius)
    u = elastic[:, 0]
    u = np.append(u[u < stretch], stretch)
    L = (u * stretch**b) ** (1 / (1 + b))
    S, S1, S2 = look_up(elastic, u)
    share, c = (L / stretch) ** a, (1 + b) * u
    first = a * S + c * S1  # first derivative by ln L, over share
    second = a * first + c * ((a + 1 + b) * S1 + c * S2)
    return hermite(L, share * S, share * first / L, share * (second - first) / L**2)


def memories_after_growth(numbers: Numbers, rtol: float) -> Floats:
    """Memories (k,) at R = 1 after growth from relaxed rest at R_0 = 1/stretch, to a relative error of rtol/100 within
    GROWTH_ERROR.

    The growth is modelled as an impulse: at R_0 the wall gets the velocity that carries it to R = 1, in incompressible
    surroundings of the same law, with isothermal gas and saturated vapour (docs/method/physics.md, section 4.3).
    Raises SolverError: no impulse carries the wall to R_max within the laws of the material.
    """
    nothing = np.zeros(len(numbers.memory))
    if numbers.stretch == 1:
        return nothing
    growth = numbers._replace(C=np.inf, tait=0.0, polytropic=1.0, driving=ZERO_TABLE, vapour=numbers.pv)
    growth = growth._replace(damage=numbers.damage * [1, 1, 1 / numbers.stretch])  # growth from R_0 causes no damage
    tolerance = min(max(rtol / 100, GROWTH_ERROR[0]), GROWTH_ERROR[1])
    # trials, (impulse, memories) by R^3 - 1; R^3 is nearly linear in the impulse v^2, the kinetic energy
    trials: dict[float, tuple[float, Floats]] = {numbers.stretch**-3.0 - 1.0: (0.0, nothing)}
    low, high = 0.0, np.inf
    impulse = total_work = 2 / 3 * numbers.stretch**3  # the whole work against the ambient pressure
    while high - low > tolerance * max(low, total_work):
        radius, memories = _turning_point(growth, float(np.sqrt(impulse)), tolerance)
        miss = radius**3 - 1.0
        low, high = (impulse, high) if miss < 0 else (low, impulse)
        if radius < np.inf:
            trials[miss] = impulse, memories
            nearest = sorted(trials, key=abs)[:4]
            if abs(nearest[0]) < tolerance:
                return trials[nearest[0]][1]
            # Lagrange weights: from values at these points to the value of their polynomial at 0
            weights = np.array([prod(b / (b - a) for b in nearest if b != a) for a in nearest])
            # the error of a cubic through four points is about the product of their misses
            if abs(nearest[0]) < GROWTH_MISS and len(nearest) == 4 and prod(map(abs, nearest)) < tolerance:
                return np.asarray(weights @ np.array([trials[miss][1] for miss in nearest]))
            impulse = float(weights @ np.array([trials[miss][0] for miss in nearest]))
        if not low < impulse < high:
            impulse = 2.0 * low if high == np.inf else 0.5 * (low + high)
        if impulse > LARGEST_IMPULSE * numbers.stretch**3:
            break
    raise SolverError("no impulse at R_0 makes the bubble grow to R_max in this material; start it relaxed")


def _turning_point(numbers: Numbers, velocity: float, rtol: float) -> tuple[float, Floats]:
    """(radius, memories) where a wall that leaves R_0 with this velocity turns; radius inf if no turn is found."""
    k = len(numbers.memory)
    out = np.full((GROWTH_TIME.size, 4 + k), np.nan)
    small = 1 / numbers.stretch
    gas = (numbers.pressure - numbers.pv) * numbers.stretch**3
    start = np.concatenate([[small, velocity, numbers.pv + gas], np.zeros(k)])
    args = (GROWTH_TIME, rtol, 20_000, True)
    code = solver.integrate(numbers, NO_SHELLS, RODAS5P, start, *args, out, np.zeros((0, 0)), np.zeros(5))
    falling = np.flatnonzero(out[:, 1] <= 0)
    reached = np.count_nonzero(np.isfinite(out[:, 1]))
    if falling.size:
        after = falling[0]
    elif code == solver.OK and reached < len(GROWTH_TIME):  # the solver stops at the turn, here before the next time
        after = reached - 1
    else:
        return np.inf, out[0, 4:]
    i, step = np.array([after - 1, after]), GROWTH_TIME[after] - GROWTH_TIME[after - 1]
    R, U, m = out[i, :1], out[i, 1:2], out[i, 4:]
    power, relaxation_rate, compliance = numbers.memory[:, 1:].T
    E = np.array([solver.spring(numbers, float(radius))[:1] for radius in R[:, 0]]) if numbers.elastic_relaxes else 0.0
    rates = (compliance * E - m) * relaxation_rate - power * (1 + m) * U / R
    (y0, y1), (slope0, slope1) = np.hstack([R, m]), step * np.hstack([U, rates])
    x = U[0, 0] / (U[0, 0] - U[1, 0])  # on the cubic through values and slopes at both times
    turn = (1 - x) ** 2 * ((1 + 2 * x) * y0 + x * slope0) + x**2 * ((3 - 2 * x) * y1 - (1 - x) * slope1)
    return float(turn[0]), turn[1:]
