"""Viscous laws: each is one function of one number, the stress integral S_v(g) at the wall's hoop rate g = U/R.

The shear rate sqrt(2 D:D) is 2 sqrt3 |g| at the wall and falls as r^-3 (docs/physics.md, section 4), so

    S_v(g) = -4 int_0^g mu(2 sqrt3 |e|) de,   dS_v/dg = -4 mu(2 sqrt3 |g|):

a law is complete with `apparent`, its viscosity mu at a shear rate; the table for the solver follows by quadrature.
Every law is a frozen dataclass with SI parameters, and is by itself the material of a fluid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from math import inf, sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.errors import InputError
from cavirheo.physics.checks import finite, not_negative, positive
from cavirheo.physics.law import Law
from cavirheo.physics.table import Floats, read, tabulate

SHEAR = 2 * sqrt(3)  # shear rate at the wall over |U/R|
SLOWEST, FASTEST = 1e-3, 1e12  # U/R in 1/s: below the first and above the second the viscosity counts as constant


class Viscous(Law):
    """Base of the viscous laws: a new one defines `apparent`."""

    @property
    def viscous(self) -> Viscous:
        return self

    def apparent(self, shear_rate: Floats) -> Floats:
        """Viscosity in Pa s at a shear rate in 1/s (any shape, not negative)."""
        raise NotImplementedError(f"{type(self).__name__} must define `apparent`")

    def table(self) -> Floats:
        """S_v over g >= 0 in Pa for the solver (physics/table.py). Kept once computed."""
        return _tabulated(self)

    def stress(self, rate: ArrayLike) -> Floats:
        """S_v in Pa at U/R in 1/s (any shape)."""
        rate = np.asarray(rate, float)
        return np.sign(rate) * read(self.table(), np.abs(rate))[0]


@lru_cache(maxsize=64)
def _tabulated(law: Viscous) -> Floats:
    nodes = np.geomspace(SLOWEST, FASTEST, 200)
    table = tabulate(lambda g: -4 * law.apparent(SHEAR * g), nodes, origin=SLOWEST)
    if (table[0, 0], table[-1, 0]) != (SLOWEST, FASTEST) or not np.all(table[:, 2] <= 0):
        raise InputError(f"the viscosity of {law} must be finite and not negative at all shear rates")
    low, high = table[0], [value[()] for value in read(table, FASTEST)]
    table[:, 1] += SLOWEST * low[2]
    slow, fast, end = np.zeros((3, 7))
    slow[2] = low[2]
    fast[:3] = FASTEST, high[0] + SLOWEST * low[2], high[1]
    end[0] = inf
    return np.vstack([slow, table[:-1], fast, end])


def _constant(viscosity: float) -> Floats:
    table = np.zeros((2, 7))
    table[0, 2], table[1, 0] = -4 * viscosity, inf
    return table


@dataclass(frozen=True)
class Newtonian(Viscous):
    """A fluid of constant viscosity in Pa s; S_v = -4 mu g, exactly."""

    viscosity: float
    name: ClassVar[str] = "newtonian"

    def __post_init__(self) -> None:
        not_negative(viscosity=self.viscosity)

    def apparent(self, shear_rate: Floats) -> Floats:
        return np.full_like(shear_rate, self.viscosity)

    def table(self) -> Floats:
        return _constant(self.viscosity)


@dataclass(frozen=True)
class PowerLaw(Viscous):
    """mu = K s^(n-1), consistency K in Pa s^n, exponent n; a viscosity that is finite at rest.

    With n < 1 the law itself diverges at rest: s stands for sqrt(shear_rate^2 + rest_rate^2). Collapses have rates of
    1e4 to 1e7 1/s. Ostwald 1925, doi:10.1007/BF01431449.
    """

    consistency: float
    exponent: float
    rest_rate: float = 1.0  # 1/s

    def __post_init__(self) -> None:
        not_negative(consistency=self.consistency)
        positive(exponent=self.exponent, rest_rate=self.rest_rate)

    def apparent(self, shear_rate: Floats) -> Floats:
        return self.consistency * np.hypot(shear_rate, self.rest_rate) ** (self.exponent - 1)


@dataclass(frozen=True)
class HerschelBulkley(Viscous):
    """mu = tau_y/s + K s^(n-1), yield stress tau_y in Pa, consistency K in Pa s^n, exponent n.

    Regularised: s stands for sqrt(shear_rate^2 + rest_rate^2), so that below the yield stress the material creeps with
    the viscosity tau_y/rest_rate instead of being rigid. Herschel and Bulkley 1926, doi:10.1007/BF01432034; the
    regularisation is that of Bercovier and Engelman 1980, doi:10.1016/0021-9991(80)90163-1.
    """

    yield_stress: float
    consistency: float
    exponent: float
    rest_rate: float = 1.0  # 1/s

    def __post_init__(self) -> None:
        not_negative(yield_stress=self.yield_stress, consistency=self.consistency)
        positive(exponent=self.exponent, rest_rate=self.rest_rate)

    def apparent(self, shear_rate: Floats) -> Floats:
        s = np.hypot(shear_rate, self.rest_rate)
        return self.yield_stress / s + self.consistency * s ** (self.exponent - 1)


@dataclass(frozen=True)
class CarreauYasuda(Viscous):
    """mu = mu_inf + (mu_0 - mu_inf) [1 + (tau s)^a]^((n-1)/a), viscosities in Pa s, tau in s; a = 2 is Carreau's law.

    Carreau 1972, doi:10.1122/1.549276; Yasuda, Armstrong and Cohen 1981, doi:10.1007/BF01513059.
    """

    zero_rate: float
    infinite_rate: float
    time: float
    exponent: float
    transition: float = 2.0

    def __post_init__(self) -> None:
        not_negative(zero_rate=self.zero_rate, infinite_rate=self.infinite_rate, time=self.time)
        finite(exponent=self.exponent)
        positive(transition=self.transition)

    def apparent(self, shear_rate: Floats) -> Floats:
        a = self.transition
        fall = (1 + (self.time * shear_rate) ** a) ** ((self.exponent - 1) / a)
        return self.infinite_rate + (self.zero_rate - self.infinite_rate) * fall


@dataclass(frozen=True)
class Cross(Viscous):
    """mu = mu_inf + (mu_0 - mu_inf)/[1 + (tau s)^m], viscosities in Pa s, tau in s.

    Cross 1965, doi:10.1016/0095-8522(65)90022-X.
    """

    zero_rate: float
    infinite_rate: float
    time: float
    exponent: float = 1.0

    def __post_init__(self) -> None:
        not_negative(zero_rate=self.zero_rate, infinite_rate=self.infinite_rate, time=self.time)
        positive(exponent=self.exponent)

    def apparent(self, shear_rate: Floats) -> Floats:
        fall = 1 / (1 + (self.time * shear_rate) ** self.exponent)
        return self.infinite_rate + (self.zero_rate - self.infinite_rate) * fall


@dataclass(frozen=True)
class PowellEyring(Viscous):
    """mu = mu_inf + (mu_0 - mu_inf) asinh(tau s)/(tau s), viscosities in Pa s, tau in s.

    Powell and Eyring 1944, doi:10.1038/154427a0.
    """

    zero_rate: float
    infinite_rate: float
    time: float

    def __post_init__(self) -> None:
        not_negative(zero_rate=self.zero_rate, infinite_rate=self.infinite_rate, time=self.time)

    def apparent(self, shear_rate: Floats) -> Floats:
        x = self.time * shear_rate
        small = x < 1e-8
        fall = np.where(small, 1.0, np.arcsinh(x) / np.where(small, 1.0, x))
        return self.infinite_rate + (self.zero_rate - self.infinite_rate) * fall


@dataclass(frozen=True)
class Viscosity(Viscous):
    """Any generalised Newtonian fluid: function(shear_rate) gives Pa s for an array of 1/s; a Python function."""

    function: Callable[[Any], Any]

    def apparent(self, shear_rate: Floats) -> Floats:
        return np.broadcast_to(np.asarray(self.function(shear_rate), float), np.shape(shear_rate))
