"""Materials that are sums of laws: an elastic part, a viscous part and arms with memory.

The solver sees tables and does not know which laws they hold (docs/method/physics.md, section 4). A Maxwell arm is a
spring and a dashpot in series, whose stress fades within the relaxation time. Its spring forgets what it was stretched
from, which one number a term tells (section 4.3 there):

    S = sum_k C_k m_k,   m_k' = -m_k/tau - n_k (1 + m_k) U/R,   m_k = 0 in the relaxed state:

1 + m_k is the fading mean of past R^n_k over the present one. One arm takes the elastic part of the material along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from cavirheo.errors import InputError, require
from cavirheo.parameters import NOT_NEGATIVE, POSITIVE
from cavirheo.physics.elastic import Linear, NeoHookean, Quadratic
from cavirheo.physics.law import Arm, Elastic, Material, Parts, Viscous
from cavirheo.physics.viscous import Newtonian


@dataclass(frozen=True)
class Maxwell(Arm):
    """Linear Maxwell fluid, tau_rr + tau d(tau_rr)/dt = 2 mu D_rr at a fixed place: its spring is linear.
    Not frame-indifferent: for small strains. Allen and Roy 2000, doi:10.1121/1.429344."""

    terms: ClassVar[tuple[tuple[float, float], ...]] = ((4 / 3, 3.0),)


@dataclass(frozen=True)
class UpperConvectedMaxwell(Arm):
    """Maxwell fluid with the upper-convected rate (UCM), right at any strain: its spring is neo-Hookean.
    Warnez and Johnsen 2015, doi:10.1063/1.4922598."""

    name: ClassVar[str] = "ucm"
    terms: ClassVar[tuple[tuple[float, float], ...]] = ((2.0, 1.0), (0.5, 4.0))


@dataclass(frozen=True)
class TotalRelaxation(Maxwell):
    """The stress of spring and dashpot together relaxes at a fixed place: tau dT/dt + T = T_el + 2 mu D, T = T_rr.

    T_el is the stress of the elastic part of the material that this arm stands in, which acts through it alone:

        m' = -(m - S_el/C)/tau - 3 (1 + m) U/R,   S = C m,   C = 4 mu/(3 tau),

    and S -> S_el - 4 mu U/R for tau -> 0. With Z = R^3 S it is the Zener model of IMRv2 and PyIMR; of a linear spring
    G it is that spring beside a Maxwell arm of viscosity mu - G tau. Hua and Johnsen 2013, doi:10.1063/1.4817673.

    grown: False: it starts without stress at R_max, as in these codes, and so without that of the elastic part.
    """

    viscosity: float = field(metadata=POSITIVE)
    grown: bool = True
    follows: ClassVar[bool] = True

    @property
    def starts_stressed(self) -> bool:
        return self.grown


@dataclass(frozen=True)
class Viscoelastic(Material):
    """Any elastic law beside any viscous law (Kelvin-Voigt) and any number of Maxwell arms; their stresses add.

    `Viscoelastic(Gent(2e3, 40.0), CarreauYasuda(0.5, 0.01, 1e-4, 0.4))`.

    Attributes:
        elastic: a law, None without this part.
        viscous: a law, None without this part.
        memory: the arms.
    """

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "memory", tuple(self.memory))
        for part, kind in ((self.elastic, Elastic), (self.viscous, Viscous), *((arm, Arm) for arm in self.memory)):
            if part is not None and not isinstance(part, kind):
                why = "a material takes an elastic law, a viscous law and a list of Maxwell arms, in this order"
                raise InputError(f"{why}; got {part!r} where {kind.__name__} stands", f"physics.not_{kind.__name__}")
        following = sum(arm.follows for arm in self.memory)
        why = f"the elastic part can act through one arm alone, got {following} that take it along"
        require(following < 2, why, "physics.followed_twice")
        some = bool(self.elastic or self.viscous or self.memory)
        require(some, "a material needs at least one law; an ideal fluid is Newtonian(0)", "physics.no_law")

    def parts(self) -> Parts:
        return Parts(self.elastic, self.viscous, self.memory)


@dataclass(frozen=True)
class NeoHookeanKelvinVoigt(Material):
    """NHKV: neo-Hookean spring (shear modulus, Pa) beside a dashpot (viscosity, Pa s).
    Estrada et al. 2018, doi:10.1016/j.jmps.2017.12.006."""

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "nhkv"

    def parts(self) -> Parts:
        return Parts(NeoHookean(self.shear_modulus), Newtonian(self.viscosity))


@dataclass(frozen=True)
class QuadraticKelvinVoigt(Material):
    """qKV: W = G/2 [(I1-3) + alpha/2 (I1-3)^2] beside a dashpot; stiffening alpha is dimensionless.
    Yang et al. 2020, doi:10.1016/j.eml.2020.100839."""

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=NOT_NEGATIVE)
    stiffening: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "qkv"

    def parts(self) -> Parts:
        return Parts(Quadratic(self.shear_modulus, self.stiffening), Newtonian(self.viscosity))


@dataclass(frozen=True)
class OldroydB(Material):
    """Dilute polymer solution: an upper-convected Maxwell arm in a Newtonian solvent.
    viscosity mu in Pa s is that of both at rest; relaxation time tau_1 and retardation time tau_2 <= tau_1 in s: the
    solvent has mu tau_2/tau_1. Oldroyd 1950, doi:10.1098/rspa.1950.0035."""

    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    retardation_time: float = field(metadata=NOT_NEGATIVE)

    def __post_init__(self) -> None:
        super().__post_init__()
        both = f"{self.retardation_time!r} and {self.relaxation_time!r} s"
        why = f"the retardation time must not exceed the relaxation time, got {both}"
        require(self.retardation_time <= self.relaxation_time, why, "physics.retardation_time")

    def parts(self) -> Parts:
        solvent = Newtonian(self.viscosity * self.retardation_time / self.relaxation_time)
        share = 1 - self.retardation_time / self.relaxation_time
        return Parts(None, solvent, (UpperConvectedMaxwell(self.viscosity * share, self.relaxation_time),))


@dataclass(frozen=True)
class Zener(Material):
    """Zener solid at finite strain: a neo-Hookean spring (shear modulus, Pa) beside an upper-convected Maxwell arm.

    viscosity in Pa s and relaxation time in s are the arm's: for tau -> 0 it is NHKV. The spring is that of Gaudron,
    Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7, the arm that of Warnez and Johnsen 2015, doi:10.1063/1.4922598.
    """

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)

    def parts(self) -> Parts:
        arm = UpperConvectedMaxwell(self.viscosity, self.relaxation_time)
        return Parts(NeoHookean(self.shear_modulus), None, (arm,))


@dataclass(frozen=True)
class StandardLinearSolid(Zener):
    """The Zener solid for small strains: a linear spring beside a linear Maxwell arm.
    Hua and Johnsen 2013, doi:10.1063/1.4817673."""

    name: ClassVar[str] = "sls"

    def parts(self) -> Parts:
        return Parts(Linear(self.shear_modulus), None, (Maxwell(self.viscosity, self.relaxation_time),))


@dataclass(frozen=True)
class QuadraticStandardLinearSolid(Material):
    """qSLS: the stress of a quadratic spring and a dashpot together relaxes at a fixed place, the field's Zener model.

    With stiffening 0 it is IMRv2's `stress = 3`, else its `stress = 4`, both without retardation; a dashpot beside it
    ("qsls + newtonian") is the retardation. As there the bubble starts without any stress, also that of the spring
    (`TotalRelaxation` leaves the choice). Hua and Johnsen 2013, doi:10.1063/1.4817673, with the
    spring of Yang et al. 2020, doi:10.1016/j.eml.2020.100839.
    """

    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    viscosity: float = field(metadata=POSITIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    stiffening: float = field(metadata=NOT_NEGATIVE)
    name: ClassVar[str] = "qsls"

    def parts(self) -> Parts:
        arm = TotalRelaxation(self.viscosity, self.relaxation_time, grown=False)
        return Parts(Quadratic(self.shear_modulus, self.stiffening), None, (arm,))


MATERIALS: dict[str, type] = {m.name: m for m in (Newtonian, NeoHookeanKelvinVoigt, QuadraticKelvinVoigt)}
