"""Laws of materials: elastic and viscous laws, and the base classes of these and of arms with memory. Their names, laws
with memory and sums are in materials.py; the ranges of their parameters in cavirheo/parameters.py.

An elastic law is the stress integral S_el(L) at L = R/R_0, a viscous law S_v(g) at the wall's hoop rate g = U/R. With
stretches (b^-2, b, b) around the bubble, What(b) = W(b^-2, b, b) and q = 1/L (docs/method/physics.md, section 4),

    dS_el/dL = -What'(L)/(L^3 - 1),  for W(I_1):  -4 W_1 (q^2 + q^5),  S_el(1) = 0;   dS_v/dg = -4 mu(2 sqrt3 |g|).

So an elastic law only needs `slope`, dS_el/dL, or `first`, W_1 = dW/dI_1, and a viscous law `apparent`, its viscosity
mu at a shear rate. Every law is also a material: a purely elastic solid, or a fluid.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import lru_cache
from inspect import cleandoc, get_annotations
from math import inf, sqrt
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import FINITE, NOT_NEGATIVE, PARAMETERS, POSITIVE, POSITIVE_OR_INFINITE, check, check_domain
from cavirheo.physics.table import extend_table, look_up, scale_table, tabulate

_RAISES = "Raises:\n    InputError: a parameter that is no number or out of its domain."
RATIO_MAX = 1e3  # R/R_0, and its inverse: wider than the range of any collapse or stretch
_HALF = np.geomspace(1, RATIO_MAX, 71)  # nodes, which are divided further where a law needs it
_NODES = np.concatenate([1 / _HALF[:0:-1], _HALF])
SHEAR_RATIO = 2 * sqrt(3)  # shear rate at the wall over |U/R|
RATE_MIN, RATE_MAX = 1e-3, 1e12  # U/R in 1/s: below the first and above the second the viscosity counts as constant


class Parts(NamedTuple):
    """The parts of a material; their stresses add."""

    elastic: Elastic | None = None
    viscous: Viscous | None = None
    memory: tuple[Arm, ...] = ()


def of_one(excluded: ArrayLike) -> bool:
    """Whether parameters exclude each other in a single material. Of many at once, such ones have no frames instead."""
    return np.ndim(excluded) == 0 and bool(excluded)


class Material:
    """Base of laws and of sums of laws: frozen dataclasses with SI parameters, which define `parts`."""

    proportional_to: ClassVar[str] = ""  # the parameter to which the whole stress is proportional, if any
    name: ClassVar[str]  # name in texts; by default from the class, "power-law" for PowerLaw

    def __init_subclass__(cls, **options: Any) -> None:
        """Set the name of a law, and append its parameters from parameters.py to its docstring, for help()."""
        super().__init_subclass__(**options)
        if "name" not in cls.__dict__:
            cls.name = re.sub(r"(?<=[a-z])(?=[A-Z])", "-", cls.__name__).lower()
        names = [name for base in reversed(cls.__mro__) for name in get_annotations(base) if name in PARAMETERS]
        described = [f"{name} ({PARAMETERS[name].symbol}, {PARAMETERS[name].unit})" for name in dict.fromkeys(names)]
        if described:
            docstring = cleandoc(cls.__dict__.get("__doc__") or "")
            cls.__doc__ = f"{docstring}\n\nParameters: {', '.join(described)}.\n\n{_RAISES}"

    def __post_init__(self) -> None:
        check(self)

    def parts(self) -> Parts:
        """The elastic part, the viscous part and the arms with memory; the material is their sum."""
        return Parts()


class Elastic(Material):
    """Base of the elastic laws: a subclass defines `slope`, or `first` if its energy depends on I_1 only."""

    def parts(self) -> Parts:
        return Parts(elastic=self)

    def first(self, I1: Floats) -> Floats:
        """W_1 = dW/dI_1 in Pa at the first invariant I1 (any shape)."""
        raise NotImplementedError

    def slope(self, ratio: Floats) -> Floats:
        """dS_el/dL in Pa at L = ratio = R/R_0 (any shape); not finite where the law does not hold."""
        q2 = 1 / (ratio * ratio)
        return -4 * self.first(q2 * q2 + 2 * ratio * ratio) * (q2 + q2 * q2 / ratio)

    def table(self) -> Floats:
        """(n, 7) S_el over L in Pa for the solver (physics/table.py); it ends where the law ends."""
        table = tabulate(self.slope, _NODES, origin=1.0)
        if not table[0, 0] < 1 < table[-1, 0]:
            why = f"the stress of {self} must be finite and smooth around R = R_0, which it is not"
            raise InputError(why, "physics.no_stress_at_rest")
        return table

    def stress(self, ratio: ArrayLike) -> Floats:
        """S_el in Pa at R/R_0 (any shape); NaN where the law does not hold."""
        return look_up(table_of(self), ratio)[0]


class Viscous(Material):
    """Base of the viscous laws: a subclass defines `apparent`."""

    def parts(self) -> Parts:
        return Parts(viscous=self)

    def apparent(self, shear_rate: Floats) -> Floats:
        """Viscosity in Pa s at a shear rate in 1/s (any shape, not negative)."""
        raise NotImplementedError

    def stress(self, rate: ArrayLike) -> Floats:
        """S_v in Pa at U/R in 1/s (any shape)."""
        rate = np.asarray(rate, float)
        return np.sign(rate) * look_up(table_of(self), np.abs(rate))[0]

    def table(self) -> Floats:
        """(n, 7) S_v over g >= 0 in Pa for the solver (physics/table.py)."""
        nodes = np.geomspace(RATE_MIN, RATE_MAX, 200)
        table = tabulate(lambda g: -4 * self.apparent(SHEAR_RATIO * g), nodes, origin=RATE_MIN)
        if (table[0, 0], table[-1, 0]) != (RATE_MIN, RATE_MAX) or np.any(table[:, 2] > 0):
            why = f"the viscosity of {self} must be finite and not negative at all shear rates"
            raise InputError(why, "physics.negative_viscosity")
        slope, (value, last_slope, _) = table[0, 2], look_up(table, RATE_MAX)
        table[:, 1] += RATE_MIN * slope
        return extend_table(table, (0.0, 0.0, slope), (RATE_MAX, float(value) + RATE_MIN * slope, float(last_slope)))


@dataclass(frozen=True)
class Arm(Material):
    """Base of the arms: viscosity in Pa s and relaxation time tau in s; the spring's shear modulus is their ratio."""

    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    terms: ClassVar[tuple[tuple[float, float], ...]] = ()  # C_k/modulus and n_k
    relaxes_elastic_part: ClassVar[bool] = False  # whether the elastic part of the material acts through this arm alone
    stressed_by_growth = True  # whether growth to R_max leaves stress in the arm, unless the simulation starts relaxed

    def parts(self) -> Parts:
        return Parts(memory=(self,))

    @property
    def modulus(self) -> float:
        """Shear modulus of the spring, Pa."""
        return self.viscosity / self.relaxation_time

    def table(self) -> Floats:
        """(k, 4) rows for the solver: C_k in Pa, n_k, 1/tau in 1/s, and 1/C_k in 1/Pa if the arm relaxes the elastic
        part, else 0."""
        stiff = [(self.modulus * c, n) for c, n in self.terms]
        return np.array(
            [[C, n, 1 / self.relaxation_time, 1 / C if self.relaxes_elastic_part else 0.0] for C, n in stiff]
        )


def table_of(law: Elastic | Viscous) -> Floats:
    """`law.table()`, cached; for a law that is proportional to a modulus, the table for 1 Pa is cached."""
    if not law.proportional_to:
        return _table_of(law)
    unit: Any = {law.proportional_to: 1.0}
    return scale_table(_table_of(replace(cast("Any", law), **unit)), 1.0, getattr(law, law.proportional_to))


@lru_cache(maxsize=128)
def _table_of(law: Elastic | Viscous) -> Floats:
    return law.table()


@dataclass(frozen=True)
class Linear(Elastic):
    """Linear elasticity, shear modulus G in Pa: S_el = -(4/3) G (1 - q^3).
    Yang and Church 2005, doi:10.1121/1.2118307."""

    proportional_to = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)

    def slope(self, ratio: Floats) -> Floats:
        q2 = 1 / (ratio * ratio)
        return -4 * self.shear_modulus * q2 * q2


@dataclass(frozen=True)
class Quadratic(Elastic):
    """W = G/2 [(I_1-3) + alpha/2 (I_1-3)^2], G in Pa; stiffening alpha = 0 is neo-Hookean.
    Yang et al. 2020, doi:10.1016/j.eml.2020.100839."""

    proportional_to = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    stiffening: float = field(default=0.0, metadata=NOT_NEGATIVE)

    def first(self, I1: Floats) -> Floats:
        return self.shear_modulus / 2 * (1 + self.stiffening * (I1 - 3))

    def stress(self, ratio: ArrayLike) -> Floats:
        L, a = np.asarray(ratio, float), self.stiffening
        q = 1 / L
        q2 = q * q
        q4 = q2 * q2
        stiff = 27 / 40 + q4 * q4 / 8 + q4 * q / 5 + q2 - 2 * L
        return self.shear_modulus * ((3 * a - 1) * (5 - 4 * q - q4) / 2 + 2 * a * stiff)


@dataclass(frozen=True)
class NeoHookean(Quadratic):
    """W = G/2 (I_1-3), shear modulus G in Pa.
    Gaudron, Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7."""

    stiffening: float = field(default=0.0, init=False, repr=False)


@dataclass(frozen=True)
class MooneyRivlin(Elastic):
    """W = C_1 (I_1-3) + C_2 (I_2-3), Pa; shear modulus 2 (C_1 + C_2).
    Mooney 1940, doi:10.1063/1.1712836; Rivlin 1948, doi:10.1098/rsta.1948.0024."""

    C1: float = field(metadata=FINITE)
    C2: float = field(metadata=FINITE)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_domain(NOT_NEGATIVE, "C1 + C2", self.C1 + self.C2)

    def slope(self, ratio: Floats) -> Floats:
        q2 = 1 / (ratio * ratio)
        q3 = q2 / ratio
        return -4 * self.C1 * (q2 + q2 * q3) - 4 * self.C2 * (1 + q3)


@dataclass(frozen=True)
class Yeoh(Elastic):
    """W = C_1 (I_1-3) + C_2 (I_1-3)^2 + C_3 (I_1-3)^3, Pa; shear modulus 2 C_1.
    Yeoh 1993, doi:10.5254/1.3538343."""

    C1: float = field(metadata=NOT_NEGATIVE)
    C2: float = field(default=0.0, metadata=FINITE)
    C3: float = field(default=0.0, metadata=FINITE)

    def first(self, I1: Floats) -> Floats:
        J = I1 - 3
        return self.C1 + J * (2 * self.C2 + 3 * self.C3 * J)


@dataclass(frozen=True)
class Fung(Elastic):
    """W = G/(2a) [exp(a (I_1-3)) - 1], shear modulus G in Pa; stiffening a = 0 is neo-Hookean.
    Fung 1967, doi:10.1152/ajplegacy.1967.213.6.1532, in its isotropic form."""

    proportional_to = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    stiffening: float = field(metadata=NOT_NEGATIVE)

    def first(self, I1: Floats) -> Floats:
        return self.shear_modulus / 2 * np.exp(self.stiffening * (I1 - 3))


@dataclass(frozen=True)
class Gent(Elastic):
    """W = -(G J_m/2) ln(1 - (I_1-3)/J_m), shear modulus G in Pa: the chains are taut (lock-up) at I_1 - 3 = J_m.
    Gent 1996, doi:10.5254/1.3538357."""

    proportional_to = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    limit: float = field(metadata=POSITIVE)  # J_m

    def first(self, I1: Floats) -> Floats:
        J = (I1 - 3) / self.limit
        return self.shear_modulus / 2 / np.where(J < 1, 1 - J, np.nan)


@dataclass(frozen=True)
class ArrudaBoyce(Elastic):
    """Eight-chain network of chains with N segments, the energy's series to fifth order; modulus G in Pa.
    W = G sum_i c_i (I_1^i - 3^i)/N^(i-1). N -> infinity is neo-Hookean; at finite N the small-strain modulus is
    somewhat above G. Arruda and Boyce 1993, doi:10.1016/0022-5096(93)90013-6."""

    proportional_to = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    segments: float = field(metadata=POSITIVE_OR_INFINITE)  # N

    def first(self, I1: Floats) -> Floats:
        x = I1 / self.segments
        return self.shear_modulus * (1 / 2 + x * (1 / 10 + x * (33 / 1050 + x * (76 / 7000 + x * 2595 / 673750))))


@dataclass(frozen=True)
class Newtonian(Viscous):
    """A fluid of constant viscosity in Pa s; S_v = -4 mu g, exactly."""

    viscosity: float = field(metadata=NOT_NEGATIVE)

    def apparent(self, shear_rate: Floats) -> Floats:
        return np.full_like(shear_rate, self.viscosity)

    def table(self) -> Floats:
        return np.array([[0, 0, -4 * self.viscosity, 0, 0, 0, 0], [inf, 0, 0, 0, 0, 0, 0]])


@dataclass(frozen=True)
class PowerLaw(Viscous):
    """mu = K s^(n-1), consistency K in Pa s^n, exponent n; a viscosity that is finite at rest.
    With n < 1 the law itself diverges at rest: s stands for sqrt(shear_rate^2 + rest_rate^2). Collapses have rates of
    1e4 to 1e7 1/s. Ostwald 1925, doi:10.1007/BF01431449."""

    consistency: float = field(metadata=NOT_NEGATIVE)
    exponent: float = field(metadata=POSITIVE)
    rest_rate: float = field(default=1.0, metadata=POSITIVE)  # 1/s

    def apparent(self, shear_rate: Floats) -> Floats:
        return self.consistency * np.hypot(shear_rate, self.rest_rate) ** (self.exponent - 1)


@dataclass(frozen=True)
class HerschelBulkley(Viscous):
    """mu = tau_y/s + K s^(n-1), yield stress tau_y in Pa, consistency K in Pa s^n, exponent n.
    Regularised: s stands for sqrt(shear_rate^2 + rest_rate^2), so that below the yield stress the material creeps with
    the viscosity tau_y/rest_rate instead of being rigid. Herschel and Bulkley 1926, doi:10.1007/BF01432034; the
    regularisation is that of Bercovier and Engelman 1980, doi:10.1016/0021-9991(80)90163-1."""

    yield_stress: float = field(metadata=NOT_NEGATIVE)
    consistency: float = field(metadata=NOT_NEGATIVE)
    exponent: float = field(metadata=POSITIVE)
    rest_rate: float = field(default=1.0, metadata=POSITIVE)  # 1/s

    def apparent(self, shear_rate: Floats) -> Floats:
        s = np.hypot(shear_rate, self.rest_rate)
        return self.yield_stress / s + self.consistency * s ** (self.exponent - 1)


@dataclass(frozen=True)
class _Thinning(Viscous):
    """Base of the laws that go from a plateau mu_0 at rest to a plateau mu_inf at high rates."""

    zero_rate: float = field(metadata=NOT_NEGATIVE)
    infinite_rate: float = field(metadata=NOT_NEGATIVE)
    time: float = field(metadata=NOT_NEGATIVE)

    def plateau_mixture(self, fall: Floats) -> Floats:
        """The viscosity for `fall`, which is 1 at rest and 0 at infinite rate."""
        return self.infinite_rate + (self.zero_rate - self.infinite_rate) * fall


@dataclass(frozen=True)
class CarreauYasuda(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf) [1 + (tau s)^a]^((n-1)/a), viscosities in Pa s, tau in s; a = 2 is Carreau's law.
    Carreau 1972, doi:10.1122/1.549276; Yasuda, Armstrong and Cohen 1981, doi:10.1007/BF01513059."""

    exponent: float = field(metadata=FINITE)
    transition: float = field(default=2.0, metadata=POSITIVE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if of_one(np.greater(self.exponent, 1) & np.less(self.zero_rate, self.infinite_rate)):
            rates = f"with an exponent above 1, got {self.exponent!r}, zero_rate must not be below infinite_rate, got "
            why = f"{rates}{self.zero_rate!r} and {self.infinite_rate!r} Pa s: the viscosity would become negative"
            raise InputError(why, "physics.negative_viscosity")

    def apparent(self, shear_rate: Floats) -> Floats:
        x = 1 + (self.time * shear_rate) ** self.transition
        return self.plateau_mixture(x ** ((self.exponent - 1) / self.transition))


@dataclass(frozen=True)
class Cross(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf)/[1 + (tau s)^m], viscosities in Pa s, tau in s.
    Cross 1965, doi:10.1016/0095-8522(65)90022-X."""

    exponent: float = field(default=1.0, metadata=POSITIVE)

    def apparent(self, shear_rate: Floats) -> Floats:
        return self.plateau_mixture(1 / (1 + (self.time * shear_rate) ** self.exponent))


@dataclass(frozen=True)
class PowellEyring(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf) asinh(tau s)/(tau s), viscosities in Pa s, tau in s.
    Powell and Eyring 1944, doi:10.1038/154427a0."""

    def apparent(self, shear_rate: Floats) -> Floats:
        x = self.time * shear_rate
        small = x < 1e-8
        return self.plateau_mixture(np.where(small, 1.0, np.arcsinh(x) / np.where(small, 1.0, x)))
