"""The medium, and the pressure that drives the bubble in it.

Media are named sets of constants for the liquid and the bubble contents; their docstrings name the codes that use them.
The gas and the vapour are those of Estrada et al. 2018 (doi:10.1016/j.jmps.2017.12.006), unless a set states otherwise.
The solver gets a driving as a table (physics/table.py) of pressure over time.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, InitVar, dataclass, field, fields, replace
from math import exp, inf, pi, sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, expect
from cavirheo.parameters import FINITE, NOT_NEGATIVE, POSITIVE, POSITIVE_OR_INFINITE, PlausibleRange, check, domain
from cavirheo.physics.table import extend_table, hermite

_IF_MEANT = " (if it is meant: unusual=True, --trust-input)"


def _constant(
    allowed: dict[str, Any],
    usual: float,
    low: float,
    high: float,
    unit: str,
    *,
    zero: float = 0.0,
    **mistaken_units: float,
) -> Any:
    """A field with its domain, default, plausible range and unit; `mistaken_units`: units that are given by mistake,
    with their size in this unit; `zero`: their zero in this unit."""
    mistaken = {name: (size, zero) for name, size in mistaken_units.items()}
    return field(default=usual, metadata=allowed | {"plausible": PlausibleRange(low, high, usual, unit, mistaken)})


@dataclass(frozen=True)
class Medium:
    """Constants of the surroundings and of the contents of the bubble, SI.

    Attributes:
        density: of the liquid or gel, kg/m3.
        sound_speed: of the liquid or gel, m/s; may be infinite.
        surface_tension: at the wall of the bubble, N/m.
        pressure: far from the bubble, Pa.
        temperature: far from the bubble and at its wall, K.
        adiabatic_index: kappa of gas and vapour.
        gas_constant: of the gas that does not condense (air), J/(kg K).
        vapour_constant: of the vapour, J/(kg K).
        diffusivity: of the vapour in the gas, m2/s.
        conductivity_slope: of the conductivity of gas and vapour, K = slope T + intercept, W/(m K2).
        conductivity_intercept: of this conductivity, W/(m K).
        vapour_reference_pressure: p_ref of p_v = p_ref exp(-T_ref/T), Pa; 0 without vapour.
        vapour_reference_temperature: T_ref, K.
        name: of the set, for documents.
        unusual: accept constants outside the ranges of liquids and gels; it is not stored.

    Raises:
        InputError: an impossible constant (a density of 0), a boiling liquid, or, unless `unusual`, an implausible
            constant (1.05 kg/m3).
    """

    density: float = _constant(POSITIVE, 998.0, 500, 3000, "kg/m3", **{"g/cm3": 1e3})
    sound_speed: float = _constant(POSITIVE_OR_INFINITE, 1484.0, 300, 6000, "m/s", **{"km/s": 1e3})
    surface_tension: float = _constant(NOT_NEGATIVE, 0.072, 0, 1, "N/m", **{"mN/m": 1e-3})
    pressure: float = _constant(POSITIVE, 101325.0, 1e4, 1e8, "Pa", bar=1e5, kPa=1e3, mbar=100.0, MPa=1e6)
    temperature: float = _constant(POSITIVE, 298.15, 240, 450, "K", zero=273.15, **{"degrees C": 1.0})
    adiabatic_index: float = _constant(POSITIVE, 1.4, 1, 1.7, "(no unit)")
    gas_constant: float = _constant(POSITIVE, 287.0, 20, 5000, "J/(kg K)", **{"J/(g K)": 1e3})
    vapour_constant: float = _constant(POSITIVE, 462.0, 20, 5000, "J/(kg K)", **{"J/(g K)": 1e3})
    diffusivity: float = _constant(POSITIVE, 24.2e-6, 1e-7, 1e-3, "m2/s", **{"cm2/s": 1e-4, "mm2/s": 1e-6})
    conductivity_slope: float = _constant(NOT_NEGATIVE, 5.3e-5, 0, 1e-3, "W/(m K2)", **{"mW/(m K2)": 1e-3})
    conductivity_intercept: float = _constant(FINITE, 1.17e-2, -0.1, 1, "W/(m K)", **{"mW/(m K)": 1e-3})
    vapour_reference_pressure: float = _constant(NOT_NEGATIVE, 1.17e11, 0, 1e15, "Pa")
    vapour_reference_temperature: float = _constant(POSITIVE, 5200.0, 1000, 20000, "K")
    name: str = "water"
    _: KW_ONLY
    unusual: InitVar[bool] = False

    def __post_init__(self, unusual: bool) -> None:
        check(self)
        expect(unusual, bool | np.bool_, "True or False as unusual")
        for name, plausible in {} if unusual else CONSTANTS.items():
            if (value := getattr(self, name)) != inf:  # an incompressible liquid
                plausible.check(name, value, f"physics.unusual_{name}", _IF_MEANT)
        if self.vapour_pressure >= self.pressure:
            boils = f"the vapour pressure ({self.vapour_pressure:.4g} Pa at {self.temperature} K) must be below the "
            boils += f"ambient pressure ({self.pressure:.4g} Pa): the liquid would boil"
            raise InputError(boils, "physics.boiling")

    @property
    def vapour_pressure(self) -> float:
        """Saturation pressure of the vapour at the far-field temperature, Pa."""
        return self.vapour_reference_pressure * exp(-self.vapour_reference_temperature / self.temperature)

    @property
    def velocity_scale(self) -> float:
        """U_c = sqrt(p_inf/rho), m/s."""
        return sqrt(self.pressure / self.density)

    def time_scale(self, max_radius: float) -> float:
        """t_c = R_max/U_c, s, for R_max in m."""
        return max_radius / self.velocity_scale


CONSTANTS: dict[str, PlausibleRange] = {one.name: one.metadata["plausible"] for one in fields(Medium) if one.metadata}
"""The plausible range and the unit of each constant of a medium."""

WATER = Medium()
"""A water-like gel at 25 C."""
BU2026 = Medium(1000.0, 1700.0, 0.0725, name="bu2026")
"""The app released with the BDT paper."""
ESTRADA2018 = Medium(1060.0, 1430.0, 0.056, name="estrada2018")
"""IMR v1, doi:10.1016/j.jmps.2017.12.006."""
ZHU2025 = Medium(998.2, 1484.0, 0.07, name="zhu2025")
"""pIMR, runIMR."""
YANG2020 = Medium(1064.0, 1484.0, 0.07, adiabatic_index=1.47, name="yang2020")
"""IMRv2, doi:10.1016/j.eml.2020.100839."""

MEDIA: dict[str, Medium] = {m.name: m for m in (WATER, BU2026, ESTRADA2018, ZHU2025, YANG2020)}
"""The media by name."""


def medium(name: str | Medium, *, unusual: bool = False, **constants: float | None) -> Medium:
    """The medium of this name, or this Medium, with the constants that are not None in place of its own.

    constants: fields of Medium. unusual: as in Medium.

    Raises InputError: unknown name (with the known ones), or a constant out of its domain.
    """
    if not isinstance(name, Medium):
        expect(name, str, f"a Medium or the name of one ({', '.join(MEDIA)})")
        if name not in MEDIA:
            raise InputError(f"unknown medium {name!r}; known: {', '.join(MEDIA)}", "physics.unknown_medium")
        name = MEDIA[name]
    changes: Any = {key: value for key, value in constants.items() if value is not None}
    return replace(name, **changes, name=f"{name.name}, changed", unusual=unusual) if changes else name


class Driving(Protocol):
    """Far-field pressure above the ambient one, Pa, as a function of time, s."""

    def table(self) -> Floats: ...


@dataclass(frozen=True)
class Pulse:
    """One cycle of focused ultrasound, p_A {[1 + cos(2 pi f (t - centre))]/2}^n within half a period of its centre.
    Gaudron, Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7.

    Attributes:
        amplitude: p_A, Pa; negative for tension.
        frequency: f, Hz.
        centre: s after the start.
        exponent: n.
    """

    amplitude: float = field(metadata=FINITE)
    frequency: float = field(metadata=POSITIVE)
    centre: float = field(metadata=FINITE)
    exponent: float = field(default=3.7, metadata=domain("at least 1", lambda x: 1 <= x < inf))

    def __post_init__(self) -> None:
        check(self)

    def pressure(self, time: ArrayLike) -> Floats:
        """Pa above ambient at `time` in s (any shape)."""
        phase = 2 * pi * self.frequency * (np.asarray(time, float) - self.centre)
        return np.where(np.abs(phase) < pi, self.amplitude * ((1 + np.cos(phase)) / 2) ** self.exponent, 0.0)

    def table(self) -> Floats:
        n, omega = self.exponent, 2 * pi * self.frequency
        x = np.linspace(-pi, pi, 129)
        base, sine = (1 + np.cos(x)) / 2, np.sin(x)
        base[[0, -1]] = sine[[0, -1]] = 0.0
        value, below = base**n, base ** (n - 1)
        slope = -n / 2 * sine * below
        curvature = (n * (n - 1) * (1 - base) - n / 2 * np.cos(x)) * below
        rows = self.amplitude * np.stack([value, slope * omega, curvature * omega**2])
        return _held_at_ends(hermite(self.centre + x / omega, *rows))


@dataclass(frozen=True, eq=False)
class Trace:
    """A measured or computed pressure above ambient: monotone cubics (PCHIP) between its samples, held at both ends.

    Attributes:
        time: (n,) s after the start, ascending.
        pressure: (n,) Pa.

    Raises:
        InputError: fewer than two samples, not finite, not ascending, or not as many times as pressures.
    """

    time: Floats
    pressure: Floats

    def __post_init__(self) -> None:
        for name in ("time", "pressure"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        if self.time.ndim != 1 or self.time.size < 2 or self.time.shape != self.pressure.shape:
            shapes = f"got shapes {self.time.shape} and {self.pressure.shape}"
            why = f"a pressure trace needs as many times as pressures, at least two, {shapes}"
            raise InputError(why, "physics.trace_shape")
        if not (np.isfinite([self.time, self.pressure]).all() and np.all(np.diff(self.time) > 0)):
            why = "the times of a pressure trace must be finite and ascend, and its pressures be finite"
            raise InputError(why, "physics.trace_values")

    def table(self) -> Floats:
        from scipy.interpolate import PchipInterpolator  # the import takes a third of a second

        rows = np.zeros((self.time.size, 7))
        rows[:, 0], rows[:, 1] = self.time, self.pressure
        rows[:-1, 1:5] = PchipInterpolator(self.time, self.pressure).c[::-1].T
        return _held_at_ends(rows)


def _held_at_ends(rows: Floats) -> Floats:
    """The table from rows (n, 7) at ascending times, continued at both ends by the first and the last value."""
    before, after = (min(0.0, rows[0, 0]) - 1.0, rows[0, 1], 0.0), (rows[-1, 0], rows[-1, 1], 0.0)
    return extend_table(rows, before, after)
