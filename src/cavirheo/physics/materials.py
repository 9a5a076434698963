"""Constitutive laws of the material around the bubble: an elastic part beside a viscous part.

The parts combine freely, `Viscoelastic(Gent(2e3, 40.0), CarreauYasuda(0.5, 0.01, 1e-4, 0.4))`, and each is a material
by itself. The solver sees two tables and does not know which laws they hold (docs/physics.md, section 4).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol, runtime_checkable

from cavirheo.errors import InputError
from cavirheo.physics.elastic import Elastic, NeoHookean, Quadratic
from cavirheo.physics.viscous import Newtonian, Viscous


@runtime_checkable
class Material(Protocol):
    """What the solver needs: the two parts of the stress, None for one that is absent."""

    @property
    def name(self) -> str: ...

    @property
    def elastic(self) -> Elastic | None: ...

    @property
    def viscous(self) -> Viscous | None: ...


@dataclass(frozen=True)
class Viscoelastic:
    """Kelvin-Voigt solid of any elastic and any viscous law; their stresses add."""

    elastic: Elastic
    viscous: Viscous
    name: ClassVar[str] = "viscoelastic"

    def __post_init__(self) -> None:
        if not isinstance(self.elastic, Elastic) or not isinstance(self.viscous, Viscous):
            raise InputError(f"an elastic and a viscous law, in this order; got {self.elastic!r} and {self.viscous!r}")


@dataclass(frozen=True)
class NeoHookeanKelvinVoigt:
    """NHKV: neo-Hookean spring (shear modulus, Pa) beside a dashpot (viscosity, Pa s).

    Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006.
    """

    shear_modulus: float
    viscosity: float
    name: ClassVar[str] = "nhkv"

    def __post_init__(self) -> None:
        _ = self.elastic, self.viscous  # which check their parameters

    @property
    def elastic(self) -> Elastic:
        return NeoHookean(self.shear_modulus)

    @property
    def viscous(self) -> Viscous:
        return Newtonian(self.viscosity)


@dataclass(frozen=True)
class QuadraticKelvinVoigt:
    """qKV: W = G/2 [(I1-3) + alpha/2 (I1-3)^2] beside a dashpot; stiffening alpha is dimensionless.

    Yang et al. 2020, doi:10.1016/j.eml.2020.100839.
    """

    shear_modulus: float
    viscosity: float
    stiffening: float
    name: ClassVar[str] = "qkv"

    def __post_init__(self) -> None:
        _ = self.elastic, self.viscous  # which check their parameters

    @property
    def elastic(self) -> Elastic:
        return Quadratic(self.shear_modulus, self.stiffening)

    @property
    def viscous(self) -> Viscous:
        return Newtonian(self.viscosity)


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
