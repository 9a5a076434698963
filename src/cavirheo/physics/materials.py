"""Constitutive laws of the material around the bubble.

Every instantaneous elastic law enters the bubble equation as one function of one number, S_el(L) with L = R/R_0
(docs/physics.md, section 4); here the closed forms. A law is a frozen dataclass whose fields are its parameters in SI.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol, runtime_checkable

from cavirheo.errors import InputError


@runtime_checkable
class Material(Protocol):
    """What the solver needs of a law: a quadratic Kelvin-Voigt triple (G Pa, mu Pa s, alpha)."""

    name: ClassVar[str]

    @property
    def coefficients(self) -> tuple[float, float, float]: ...


def _not_negative(**values: float) -> None:
    for name, value in values.items():
        if not (value >= 0 and value < float("inf")):
            raise InputError(f"{name} must be finite and not negative, got {value!r}")


@dataclass(frozen=True)
class Newtonian:
    """A viscous fluid; viscosity in Pa s."""

    viscosity: float
    name: ClassVar[str] = "newtonian"

    def __post_init__(self) -> None:
        _not_negative(viscosity=self.viscosity)

    @property
    def coefficients(self) -> tuple[float, float, float]:
        return 0.0, self.viscosity, 0.0


@dataclass(frozen=True)
class NeoHookeanKelvinVoigt:
    """NHKV: neo-Hookean spring (shear modulus, Pa) beside a dashpot (viscosity, Pa s).

    Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006.
    """

    shear_modulus: float
    viscosity: float
    name: ClassVar[str] = "nhkv"

    def __post_init__(self) -> None:
        _not_negative(shear_modulus=self.shear_modulus, viscosity=self.viscosity)

    @property
    def coefficients(self) -> tuple[float, float, float]:
        return self.shear_modulus, self.viscosity, 0.0


@dataclass(frozen=True)
class QuadraticKelvinVoigt:
    """qKV: W = G/2 [(I1-3) + alpha/2 (I1-3)^2] beside a dashpot; stiffening alpha is dimensionless.

    Yang et al. 2020, doi:10.1039/D0SM01246A.
    """

    shear_modulus: float
    viscosity: float
    stiffening: float
    name: ClassVar[str] = "qkv"

    def __post_init__(self) -> None:
        _not_negative(shear_modulus=self.shear_modulus, viscosity=self.viscosity, stiffening=self.stiffening)

    @property
    def coefficients(self) -> tuple[float, float, float]:
        return self.shear_modulus, self.viscosity, self.stiffening


MATERIALS: dict[str, type] = {m.name: m for m in (Newtonian, NeoHookeanKelvinVoigt, QuadraticKelvinVoigt)}


def make(name: str, **parameters: float | None) -> Material:
    """The law of this name; parameters that it does not have must be None.

    Raises:
        InputError: unknown law, a parameter missing, or one too many.
    """
    if name not in MATERIALS:
        raise InputError(f"unknown material {name!r}; known: {', '.join(MATERIALS)}")
    law = MATERIALS[name]
    given = {key: value for key, value in parameters.items() if value is not None}
    needed = [field.name for field in fields(law)]
    if sorted(given) != sorted(needed):
        raise InputError(f"material {name!r} takes {', '.join(needed)}; got {', '.join(given) or 'nothing'}")
    material: Material = law(**given)
    return material
