"""Named sets of constants for the liquid and the bubble contents; each says which code of the field it is from.

The gas and the vapour are those of Estrada et al. 2018 (doi:10.1016/j.jmps.2017.12.006) throughout, unless a set says
otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import exp, sqrt
from typing import Any

from cavirheo.errors import require
from cavirheo.physics.law import NOT_NEGATIVE, POSITIVE, POSITIVE_OR_INFINITE, check


@dataclass(frozen=True)
class Medium:
    """The surroundings of the bubble and what is in it. All SI.

    Raises:
        InputError: a constant that must be positive is not.
    """

    density: float = field(default=998.0, metadata=POSITIVE)  # kg/m3, of the liquid or gel
    sound_speed: float = field(default=1484.0, metadata=POSITIVE_OR_INFINITE)  # m/s
    surface_tension: float = field(default=0.072, metadata=NOT_NEGATIVE)  # N/m
    pressure: float = field(default=101325.0, metadata=POSITIVE)  # Pa, far from the bubble
    temperature: float = field(default=298.15, metadata=POSITIVE)  # K, far from the bubble and at the bubble wall
    adiabatic_index: float = field(default=1.4, metadata=POSITIVE)  # kappa, gas and vapour alike
    gas_constant: float = 287.0  # J/(kg K), non-condensable gas (air)
    vapour_constant: float = 462.0  # J/(kg K), vapour (water)
    diffusivity: float = field(default=24.2e-6, metadata=POSITIVE)  # m2/s, vapour in gas
    conductivity_slope: float = 5.3e-5  # W/(m K2): K = slope T + intercept
    conductivity_intercept: float = 1.17e-2  # W/(m K)
    vapour_reference_pressure: float = 1.17e11  # Pa: p_v = p_ref exp(-T_ref/T)
    vapour_reference_temperature: float = 5200.0  # K
    name: str = "water"

    def __post_init__(self) -> None:
        check(self)
        boils = f"the vapour pressure ({self.vapour_pressure:.4g} Pa at {self.temperature} K) must be below the "
        boils += f"ambient pressure ({self.pressure:.4g} Pa): the liquid would boil"
        require(self.vapour_pressure < self.pressure, boils, "physics.boiling")

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


WATER = Medium()  # water-like gel at 25 C
BU2026 = Medium(1000.0, 1700.0, 0.0725, name="bu2026")  # the app released with the BDT paper
ESTRADA2018 = Medium(1060.0, 1430.0, 0.056, name="estrada2018")  # IMR v1, doi:10.1016/j.jmps.2017.12.006
ZHU2025 = Medium(998.2, 1484.0, 0.07, name="zhu2025")  # pIMR, runIMR
YANG2020 = Medium(1064.0, 1484.0, 0.07, adiabatic_index=1.47, name="yang2020")  # IMRv2, doi:10.1016/j.eml.2020.100839

MEDIA: dict[str, Medium] = {m.name: m for m in (WATER, BU2026, ESTRADA2018, ZHU2025, YANG2020)}


def medium(name: str, **constants: float | None) -> Medium:
    """The named set, with the constants (fields of Medium) that are not None instead of its own.

    Raises InputError: unknown name (with the known ones), or a constant out of its domain.
    """
    require(name in MEDIA, f"unknown medium {name!r}; known: {', '.join(MEDIA)}", "physics.unknown_medium")
    base = MEDIA[name]
    changes: Any = {key: value for key, value in constants.items() if value is not None}
    return replace(base, **changes, name=f"{base.name}, changed") if changes else base
