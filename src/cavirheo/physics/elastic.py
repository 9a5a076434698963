"""Elastic laws: each is one function of one number, the stress integral S_el(L) at L = R/R_0.

With stretches (b^-2, b, b) around the bubble, What(b) = W(b^-2, b, b), W_1 = dW/dI_1 and q = 1/L
(docs/method/physics.md, section 4),

    dS_el/dL = -What'(L)/(L^3 - 1),  for W(I_1):  dS_el/dL = -4 W_1 (q^2 + q^5),  S_el(1) = 0.

So a law is complete with `slope`, dS_el/dL; the table for the solver follows by quadrature. The laws with a short
closed form are tabulated from that. Every law is by itself the material of a purely elastic solid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.parameters import FINITE, NOT_NEGATIVE, POSITIVE, POSITIVE_OR_INFINITE, within
from cavirheo.physics.law import Elastic, nodes
from cavirheo.physics.table import hermite

_FINE = nodes(0.02)  # for closed forms: an error of 2e-9 for their steepest term, q^8


class _Closed(Elastic):
    """A law with S_el(L) and two derivatives in closed form."""

    def closed(self, ratio: Floats) -> tuple[Floats, Floats, Floats]:
        """S_el, dS_el/dL, d2S_el/dL2 in Pa."""
        raise NotImplementedError

    def slope(self, ratio: Floats) -> Floats:
        return self.closed(ratio)[1]

    def stress(self, ratio: ArrayLike) -> Floats:
        return self.closed(np.asarray(ratio, float))[0]

    def table(self) -> Floats:
        return hermite(_FINE, *self.closed(_FINE))


@dataclass(frozen=True)
class Linear(_Closed):
    """Linear elasticity, shear modulus G in Pa: S_el = -(4/3) G (1 - q^3).
    Yang and Church 2005, doi:10.1121/1.2118307."""

    proportional = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)

    def closed(self, ratio: Floats) -> tuple[Floats, Floats, Floats]:
        G, q = self.shear_modulus, 1 / ratio
        q3 = q * q * q
        return -4 / 3 * G * (1 - q3), -4 * G * q3 * q, 16 * G * q3 * q * q


@dataclass(frozen=True)
class Quadratic(_Closed):
    """W = G/2 [(I_1-3) + alpha/2 (I_1-3)^2], G in Pa; stiffening alpha = 0 is neo-Hookean.
    Yang et al. 2020, doi:10.1016/j.eml.2020.100839."""

    proportional = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    stiffening: float = field(default=0.0, metadata=NOT_NEGATIVE)

    def closed(self, ratio: Floats) -> tuple[Floats, Floats, Floats]:
        G, a, q = self.shear_modulus, self.stiffening, 1 / ratio
        b = 3 * a - 1
        q2 = q * q
        q3, q4 = q2 * q, q2 * q2
        q5, q8 = q4 * q, q4 * q4
        return (
            G * (b * (5 - 4 * q - q4) / 2 + 2 * a * (27 / 40 + q8 / 8 + q5 / 5 + q2 - 2 * ratio)),
            G * (2 * b * (q2 + q5) - 2 * a * (q8 * q + q5 * q + 2 * q3 + 2)),
            G * (-2 * b * (2 * q3 + 5 * q5 * q) + 2 * a * (9 * q8 * q2 + 6 * q5 * q2 + 6 * q4)),
        )


@dataclass(frozen=True)
class NeoHookean(Quadratic):
    """W = G/2 (I_1-3), shear modulus G in Pa.
    Gaudron, Warnez and Johnsen 2015, doi:10.1017/jfm.2015.7."""

    stiffening: float = field(default=0.0, init=False, repr=False)


@dataclass(frozen=True)
class MooneyRivlin(_Closed):
    """W = C_1 (I_1-3) + C_2 (I_2-3), Pa; shear modulus 2 (C_1 + C_2).
    Mooney 1940, doi:10.1063/1.1712836; Rivlin 1948, doi:10.1098/rsta.1948.0024."""

    C1: float = field(metadata=FINITE)
    C2: float = field(metadata=FINITE)

    def __post_init__(self) -> None:
        super().__post_init__()
        within(NOT_NEGATIVE, "C1 + C2", self.C1 + self.C2)

    def closed(self, ratio: Floats) -> tuple[Floats, Floats, Floats]:
        q = 1 / ratio
        q2 = q * q
        q3, q5 = q2 * q, q2 * q2 * q
        return (
            -self.C1 * (5 - 4 * q - q2 * q2) - 2 * self.C2 * (2 * ratio - 1 - q2),
            -4 * self.C1 * (q2 + q5) - 4 * self.C2 * (1 + q3),
            4 * self.C1 * (2 * q3 + 5 * q5 * q) + 12 * self.C2 * q2 * q2,
        )


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

    proportional = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    stiffening: float = field(metadata=NOT_NEGATIVE)

    def first(self, I1: Floats) -> Floats:
        return self.shear_modulus / 2 * np.exp(self.stiffening * (I1 - 3))


def fung_stress(modulus: Floats, stiffening: Floats, ratio: Floats) -> Floats:
    """(k,) -S_el of Fung's law, Pa, at ratios L > 1, of its parameters (k,): in closed form by Dawson's integral, but
    that I_1 - 3 is taken as 2 L^2 - 3 and what goes with q^5 as neo-Hookean: within 10 % from L = 3 on."""
    from scipy.special import dawsn  # simulations need not wait for it

    root = np.sqrt(2.0 * stiffening)

    def part(ratio: Floats | float) -> Floats:
        energy = np.exp(np.minimum(stiffening * (2.0 * ratio**2 - 3.0), 50.0))
        return np.asarray(energy * (2.0 * root * dawsn(root * ratio) - 1.0 / ratio))

    return np.asarray(2.0 * modulus * (part(ratio) - part(1.0) + 0.25 * (1.0 - ratio**-4)))


@dataclass(frozen=True)
class Gent(Elastic):
    """W = -(G J_m/2) ln(1 - (I_1-3)/J_m), shear modulus G in Pa: the chains are taut (lock-up) at I_1 - 3 = J_m.
    Gent 1996, doi:10.5254/1.3538357."""

    proportional = "shear_modulus"
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

    proportional = "shear_modulus"
    shear_modulus: float = field(metadata=NOT_NEGATIVE)
    segments: float = field(metadata=POSITIVE_OR_INFINITE)  # N

    def first(self, I1: Floats) -> Floats:
        x = I1 / self.segments
        return self.shear_modulus * (1 / 2 + x * (1 / 10 + x * (33 / 1050 + x * (76 / 7000 + x * 2595 / 673750))))


@dataclass(frozen=True)
class Ogden(Elastic):
    """W = sum_i mu_i/alpha_i (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), mu_i in Pa; shear modulus sum mu_i alpha_i/2.
    Each mu_i alpha_i must not be negative (stability). Ogden 1972, doi:10.1098/rspa.1972.0026."""

    moduli: tuple[float, ...]
    exponents: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("moduli", "exponents"):  # lists are welcome, but could not be the key of a kept table
            object.__setattr__(self, name, tuple(getattr(self, name)))
        several = f"as many moduli as exponents, at least one, got {self.moduli} and {self.exponents}"
        require(len(self.moduli) == len(self.exponents) > 0, several, "physics.terms")
        for modulus, exponent in zip(self.moduli, self.exponents, strict=True):
            within(FINITE, "modulus", modulus)
            within(FINITE, "exponent", exponent)
            sign = f"modulus and exponent must have the same sign, the exponent not be 0; got {modulus} and {exponent}"
            require(exponent != 0 and modulus * exponent >= 0, sign, "physics.unstable")

    def slope(self, ratio: Floats) -> Floats:
        log = np.log(ratio)
        volume = np.expm1(3 * log)  # L^3 - 1
        safe = np.where(volume == 0, 1.0, volume)
        total = np.zeros_like(log)
        for mu, alpha in zip(self.moduli, self.exponents, strict=True):
            quotient = np.where(volume == 0, alpha, np.expm1(3 * alpha * log) / safe)
            total -= 2 * mu * ratio ** (-2 * alpha - 1) * quotient
        return total


@dataclass(frozen=True)
class StrainEnergy(Elastic):
    """Any isotropic incompressible solid: energy(l1, l2, l3) in Pa of the principal stretches, a Python function.

    The function gets complex arrays, because its derivative is taken by a complex step (exact to round-off): write it
    with arithmetic and numpy functions, without abs, max, or conditions.

    Raises:
        InputError: at its first use, if the function cannot be differentiated so.
    """

    energy: Callable[[Any, Any, Any], Any]

    def __repr__(self) -> str:
        return f"StrainEnergy({getattr(self.energy, '__name__', self.energy)})"

    def _derivative(self, b: Floats) -> Floats:
        """dWhat/db."""
        c = b + 1e-30j
        try:
            return np.broadcast_to(np.imag(self.energy(c**-2, c, c)) / 1e-30, b.shape)
        except TypeError as error:
            why = f"a strain energy must accept complex arrays (use numpy functions); got: {error}"
            raise InputError(why, "physics.not_analytic") from None

    def slope(self, ratio: Floats) -> Floats:
        close = np.abs(ratio - 1) < 2e-3  # 0/0 at 1: there a polynomial through six points beside it
        away = np.where(close, 2.0, ratio)
        x = np.array([-3, -2, -1, 1, 2, 3])
        b = 1 + 2e-3 * x
        through = np.polynomial.Polynomial.fit(x, -self._derivative(b) / (b**3 - 1), 5)
        slope = np.where(close, through((ratio - 1) / 2e-3), -self._derivative(away) / (away**3 - 1))
        return np.asarray(slope, float)

    def table(self) -> Floats:
        b, h = np.array([0.6, 0.9, 1.2, 1.7]), 1e-5
        by_step = self._derivative(b)
        above, below = (np.array([self.energy(c**-2, c, c) for c in ends]) for ends in (b + h, b - h))
        alike = np.allclose(by_step, (above - below) / (2 * h), rtol=1e-4, atol=1e-4 * np.abs(by_step).max())
        why = "the strain energy is not analytic in the stretches: use no abs, max, real or conditions"
        require(alike, why, "physics.not_analytic")
        return super().table()
