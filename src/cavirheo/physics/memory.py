"""Laws with memory: Maxwell arms, a spring and a dashpot in series, whose stress fades within the relaxation time.

An arm's spring forgets what it was stretched from, which one number a term tells (docs/method/physics.md, section 4.3):

    S = sum_k C_k m_k,   m_k' = -m_k/tau - n_k (1 + m_k) U/R,   m_k = 0 in the relaxed state:

1 + m_k is the fading mean of past R^n_k over the present one. One arm takes the elastic part of the material along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.physics.law import NOT_NEGATIVE, POSITIVE, Material, Parts


@dataclass(frozen=True)
class Arm(Material):
    """Base of the arms: viscosity in Pa s and relaxation time tau in s; the spring's shear modulus is their ratio."""

    viscosity: float = field(metadata=NOT_NEGATIVE)
    relaxation_time: float = field(metadata=POSITIVE)
    terms: ClassVar[tuple[tuple[float, float], ...]] = ()  # C_k/modulus and n_k
    follows: ClassVar[bool] = False  # whether the elastic part of the material acts through this arm alone

    @property
    def starts_stressed(self) -> bool:
        """Whether the growth to R_max leaves stress in it, where the simulation does not start relaxed."""
        return True

    def parts(self) -> Parts:
        return Parts(memory=(self,))

    @property
    def modulus(self) -> float:
        """Shear modulus of the spring, Pa."""
        return self.viscosity / self.relaxation_time

    def table(self) -> Floats:
        """(k, 4) rows C_k in Pa, n_k, 1/tau in 1/s, and 1/C_k in 1/Pa of an arm that follows the elastic part or 0,
        for the solver."""
        stiff = [(self.modulus * c, n) for c, n in self.terms]
        return np.array([[C, n, 1 / self.relaxation_time, 1 / C if self.follows else 0.0] for C, n in stiff])


@dataclass(frozen=True)
class Maxwell(Arm):
    """Linear Maxwell fluid, tau_rr + tau d(tau_rr)/dt = 2 mu D_rr at a fixed place: its spring is linear.
    Not frame-indifferent: for small strains. Allen and Roy 2000, doi:10.1121/1.429344."""

    terms: ClassVar[tuple[tuple[float, float], ...]] = ((4 / 3, 3.0),)


@dataclass(frozen=True)
class UpperConvectedMaxwell(Arm):
    """Maxwell fluid with the upper-convected rate (UCM), right at any strain: its spring is neo-Hookean.
    Warnez and Johnsen 2015, doi:10.1063/1.4922598."""

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
