"""Constitutive laws of the material around the bubble: an elastic part, a viscous part and arms that remember.

The parts combine freely, `Viscoelastic(Gent(2e3, 40.0), CarreauYasuda(0.5, 0.01, 1e-4, 0.4))`, and each is a material
by itself. The solver sees tables and does not know which laws they hold (docs/physics.md, section 4).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, Protocol, runtime_checkable

from cavirheo.errors import InputError
from cavirheo.physics.checks import not_negative
from cavirheo.physics.elastic import Elastic, Linear, NeoHookean, Quadratic
from cavirheo.physics.law import Law
from cavirheo.physics.memory import Arm, Maxwell, UpperConvectedMaxwell
from cavirheo.physics.viscous import Newtonian, Viscous


@runtime_checkable
class Material(Protocol):
    """What the solver needs: the parts of the stress, None for one that is absent."""

    @property
    def name(self) -> str: ...

    @property
    def elastic(self) -> Elastic | None: ...

    @property
    def viscous(self) -> Viscous | None: ...

    @property
    def memory(self) -> tuple[Arm, ...]: ...


@dataclass(frozen=True)
class Viscoelastic:
    """Any elastic law beside any viscous law (Kelvin-Voigt) and any number of Maxwell arms; their stresses add.

    A part that the material does not have is None, or is left out.
    """

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()
    name: ClassVar[str] = "viscoelastic"

    def __post_init__(self) -> None:
        object.__setattr__(self, "memory", tuple(self.memory))
        for part, kind, what in ((self.elastic, Elastic, "an elastic law"), (self.viscous, Viscous, "a viscous law")):
            if part is not None and not isinstance(part, kind):
                raise InputError(f"expected {what} (elastic before viscous, arms as a list after them), got {part!r}")
        if wrong := [arm for arm in self.memory if not isinstance(arm, Arm)]:
            raise InputError(f"memory takes Maxwell arms, got {wrong[0]!r}")
        if self.elastic is None and self.viscous is None and not self.memory:
            raise InputError("a material needs at least one law; an ideal fluid is Newtonian(0)")


@dataclass(frozen=True)
class NeoHookeanKelvinVoigt(Law):
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
class QuadraticKelvinVoigt(Law):
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


@dataclass(frozen=True)
class OldroydB(Law):
    """Dilute polymer solution: an upper-convected Maxwell arm in a Newtonian solvent.

    viscosity mu in Pa s is that of both at rest; relaxation time tau_1 and retardation time tau_2 <= tau_1 in s: the
    solvent has mu tau_2/tau_1. Oldroyd 1950, doi:10.1098/rspa.1950.0035.
    """

    viscosity: float
    relaxation_time: float
    retardation_time: float
    name: ClassVar[str] = "oldroyd-b"

    def __post_init__(self) -> None:
        not_negative(retardation_time=self.retardation_time)
        if not self.retardation_time <= self.relaxation_time:
            raise InputError(
                "the retardation time must not exceed the relaxation time, "
                f"got {self.retardation_time!r} and {self.relaxation_time!r} s"
            )
        _ = self.viscous, self.memory

    @property
    def viscous(self) -> Viscous:
        return Newtonian(self.viscosity * self.retardation_time / self.relaxation_time)

    @property
    def memory(self) -> tuple[Arm, ...]:
        share = 1 - self.retardation_time / self.relaxation_time
        return (UpperConvectedMaxwell(self.viscosity * share, self.relaxation_time),)


@dataclass(frozen=True)
class Zener(Law):
    """Zener solid at finite strain: a neo-Hookean spring (shear modulus, Pa) beside an upper-convected Maxwell arm.

    viscosity in Pa s and relaxation time in s are the arm's: for tau -> 0 it is NHKV.
    """

    shear_modulus: float
    viscosity: float
    relaxation_time: float
    name: ClassVar[str] = "zener"

    def __post_init__(self) -> None:
        _ = self.elastic, self.memory

    @property
    def elastic(self) -> Elastic:
        return NeoHookean(self.shear_modulus)

    @property
    def memory(self) -> tuple[Arm, ...]:
        return (UpperConvectedMaxwell(self.viscosity, self.relaxation_time),)


@dataclass(frozen=True)
class StandardLinearSolid(Zener):
    """The Zener solid for small strains: a linear spring beside a linear Maxwell arm.

    Hua and Johnsen 2013, doi:10.1063/1.4817673.
    """

    name: ClassVar[str] = "sls"

    @property
    def elastic(self) -> Elastic:
        return Linear(self.shear_modulus)

    @property
    def memory(self) -> tuple[Arm, ...]:
        return (Maxwell(self.viscosity, self.relaxation_time),)


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
