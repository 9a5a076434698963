"""Viscous laws: each is one function of one number, the stress integral S_v(g) at the wall's hoop rate g = U/R.

The shear rate sqrt(2 D:D) is 2 sqrt3 |g| at the wall and falls as r^-3 (docs/method/physics.md, section 4), so

    S_v(g) = -4 int_0^g mu(2 sqrt3 |e|) de,   dS_v/dg = -4 mu(2 sqrt3 |g|):

a law is complete with `apparent`, its viscosity mu at a shear rate; the table for the solver follows by quadrature.
Every law is by itself the material of a fluid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.parameters import FINITE, NOT_NEGATIVE, POSITIVE
from cavirheo.physics.law import Viscous


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
    """From one plateau, mu_0 at rest, to another."""

    zero_rate: float = field(metadata=NOT_NEGATIVE)
    infinite_rate: float = field(metadata=NOT_NEGATIVE)
    time: float = field(metadata=NOT_NEGATIVE)

    def between(self, fall: Floats) -> Floats:
        """The viscosity where `fall` has come down from 1 at rest."""
        return self.infinite_rate + (self.zero_rate - self.infinite_rate) * fall


@dataclass(frozen=True)
class CarreauYasuda(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf) [1 + (tau s)^a]^((n-1)/a), viscosities in Pa s, tau in s; a = 2 is Carreau's law.
    Carreau 1972, doi:10.1122/1.549276; Yasuda, Armstrong and Cohen 1981, doi:10.1007/BF01513059."""

    exponent: float = field(metadata=FINITE)
    transition: float = field(default=2.0, metadata=POSITIVE)

    def apparent(self, shear_rate: Floats) -> Floats:
        x = 1 + (self.time * shear_rate) ** self.transition
        return self.between(x ** ((self.exponent - 1) / self.transition))


@dataclass(frozen=True)
class Cross(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf)/[1 + (tau s)^m], viscosities in Pa s, tau in s.
    Cross 1965, doi:10.1016/0095-8522(65)90022-X."""

    exponent: float = field(default=1.0, metadata=POSITIVE)

    def apparent(self, shear_rate: Floats) -> Floats:
        return self.between(1 / (1 + (self.time * shear_rate) ** self.exponent))


@dataclass(frozen=True)
class PowellEyring(_Thinning):
    """mu = mu_inf + (mu_0 - mu_inf) asinh(tau s)/(tau s), viscosities in Pa s, tau in s.
    Powell and Eyring 1944, doi:10.1038/154427a0."""

    def apparent(self, shear_rate: Floats) -> Floats:
        x = self.time * shear_rate
        small = x < 1e-8
        return self.between(np.where(small, 1.0, np.arcsinh(x) / np.where(small, 1.0, x)))


@dataclass(frozen=True)
class Viscosity(Viscous):
    """Any generalised Newtonian fluid: function(shear_rate) gives Pa s for an array of 1/s; a Python function."""

    function: Callable[[Any], Any]

    def __repr__(self) -> str:
        return f"Viscosity({getattr(self.function, '__name__', self.function)})"

    def apparent(self, shear_rate: Floats) -> Floats:
        return np.broadcast_to(np.asarray(self.function(shear_rate), float), np.shape(shear_rate))
