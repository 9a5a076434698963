"""Laws with memory: Maxwell arms, a spring and a dashpot in series, whose stress fades within the relaxation time.

An arm's spring forgets what it was stretched from, which one number a term tells (docs/method/physics.md, section 4.3):

    S = sum_k C_k m_k,   m_k' = -m_k/tau - n_k (1 + m_k) U/R,   m_k = 0 in the relaxed state:

1 + m_k is the fading mean of past R^n_k over the present one. One arm takes the elastic part of the material along.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from cavirheo.physics.domain import POSITIVE
from cavirheo.physics.law import Arm


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
