"""Dimensionless numbers of one simulation (docs/method/physics.md, section 1).

Scales: R_c = R_max, U_c = sqrt(p_inf/rho), t_c = R_c/U_c, p_inf for pressures, T_inf for temperature.
"""

from __future__ import annotations

from math import inf, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.parameters import POSITIVE, check_domain, domain
from cavirheo.physics.bubble import FIELD, Bubble, Damage
from cavirheo.physics.laws import Material, table_of
from cavirheo.physics.media import Driving, Medium
from cavirheo.physics.table import hermite, look_up, scale_table


class Numbers(NamedTuple):
    """Input of the compiled solver; every field is dimensionless."""

    C: float  # c/U_c
    We: float  # p_inf R_max/(2 gamma); infinite without surface tension
    stretch: float  # lambda = R_max/R_0
    Fo: float  # D/(U_c R_max), mass Fourier number
    chi: float  # T_inf K_inf/(p_inf R_max U_c)
    A: float  # A T_inf/K_inf
    B: float  # B/K_inf = 1 - A
    pv: float  # vapour pressure/p_inf
    kappa: float
    elastic: Floats  # (n, 7) table of S_el/p_inf over R/R_0 (physics/table.py)
    elastic_falling: Floats  # (n, 7) the same for R/R_max below damage[2] (`falling_table`); (0, 7) without damage
    damage: Floats  # (3,) both factors of a tenfold contraction, and the smallest R/R_max so far; 0 without damage
    viscous: Floats  # (m, 7) table of S_v/p_inf over t_c U/R, for U >= 0
    memory: Floats  # (k, 4) C_k/p_inf, power n_k, t_c/tau, p_inf/C_k or 0, of each relaxing term (physics/laws.py)
    elastic_relaxes: bool  # whether the elastic part acts through a relaxing term alone
    driving: Floats  # (n, 7) table of the far-field pressure above ambient, over p_inf, over t/t_c
    polytropic: float  # exponent of the gas where the contents are polytropic
    tait: float  # exponent of the liquid in Gilmore's equation; 0: Keller-Miksis
    vapour: float  # pressure of the vapour at the start/p_inf
    condensation_rate: float  # a of docs (3.11): accommodation sqrt(R_v T_inf/2 pi)/U_c; infinite: equilibrium
    variable_D: bool  # whether D = Fo T^1.75/p instead of Fo
    inertia: float  # beta of the walls, at R_max
    radiation: float  # zeta of the tube, at R_max
    base: float  # p_b, subtracted from the pressure in the state of the solver (docs/method/physics.md, section 3.2)

    @property
    def pressure(self) -> float:
        """Pressure at the start (3.9): vapour, and the gas of the equilibrium at R_0 after isothermal expansion."""
        return self.vapour + (1 + self.stretch / self.We - self.pv) / self.stretch**3


TAIT_EXPONENT = 7.15  # exponent of water in Tait's equation of state: Gilmore 1952
STRETCH_DOMAIN = domain("at least 1 (the bubble starts at its largest radius)", lambda x: 1 <= x < inf)
ZERO_TABLE = np.zeros((2, 7))  # table that is 0 everywhere: no stress, or no driving
ZERO_TABLE[1, 0] = np.inf


def dimensionless(
    material: Material,
    medium: Medium,
    max_radius: float,
    stretch: float,
    *,
    bubble: Bubble = FIELD,
    driving: Driving | None = None,
) -> Numbers:
    """Numbers of a bubble of `max_radius` (m) and `stretch` (1) in a material (SI) and a medium.

    Raises:
        InputError: the radius is not positive, the stretch is below 1, the bubble has free values, it follows
            Gilmore's equation in an incompressible medium, a wall is nearer than R_max, or there is damage without an
            elastic part.
    """
    bubble.check_known()
    if bubble.motion == "gilmore" and medium.sound_speed == inf:
        why = "Gilmore's equation needs a finite speed of sound: use motion='rayleigh-plesset'"
        raise InputError(why, "physics.sound_speed")
    check_domain(POSITIVE, "max_radius", max_radius)
    check_domain(STRETCH_DOMAIN, "stretch = R_max/R_0", stretch)
    kinetic, parts = bubble.contents == "kinetic", material.parts()
    U_c, p, pv = medium.velocity_scale, medium.pressure, medium.vapour_pressure / medium.pressure
    K_inf = medium.conductivity_slope * medium.temperature + medium.conductivity_intercept
    A = medium.conductivity_slope * medium.temperature / K_inf
    mean_speed = sqrt(medium.vapour_constant * medium.temperature / (2 * pi))  # of the vapour towards the wall
    fields: dict[str, Any] = dict(
        C=inf if bubble.motion == "rayleigh-plesset" else medium.sound_speed / U_c,
        We=p * max_radius / (2 * medium.surface_tension) if medium.surface_tension else inf,
        stretch=stretch,
        Fo=medium.diffusivity / (U_c * max_radius),
        chi=medium.temperature * K_inf / (p * max_radius * U_c),
        A=A,
        B=1 - A,
        pv=pv,
        kappa=medium.adiabatic_index,
        polytropic=bubble.exponent or 0.0,
        tait=TAIT_EXPONENT if bubble.motion == "gilmore" else 0.0,
        vapour=pv + float(bubble.vapour_excess) / p,
        condensation_rate=float(bubble.accommodation) * mean_speed / U_c if kinetic else inf,
        inertia=bubble.inertia(max_radius),
        radiation=bubble.confinement_damping,
        base=pv if (driving or stretch > 20) and not kinetic else 0.0,  # kinetic: p may fall below p_v
    )
    elastic, viscous = (table_of(part) if part else ZERO_TABLE for part in parts[:2])
    falling, damage = _damage_tables(bubble, material, elastic, stretch)
    arms = [arm.table() * [1 / p, 1.0, max_radius / U_c, p] for arm in parts.memory]
    return Numbers(
        **{name: float(value) for name, value in fields.items()},  # with ints the solver would be compiled again
        variable_D=kinetic,
        elastic=scale_table(elastic, 1.0, 1 / p),
        elastic_falling=scale_table(falling, 1.0, 1 / p),
        damage=damage,
        viscous=scale_table(viscous, max_radius / U_c, 1 / p),
        memory=np.concatenate([np.zeros((0, 4)), *arms]),
        elastic_relaxes=any(arm.relaxes_elastic_part for arm in parts.memory),
        driving=scale_table(driving.table() if driving else ZERO_TABLE, U_c / max_radius, 1 / p),
    )


def _damage_tables(bubble: Bubble, material: Material, elastic: Floats, stretch: float) -> tuple[Floats, Floats]:
    """`elastic_falling`, in Pa, and `damage` of Numbers."""
    if not isinstance(bubble.damage, Damage):
        return np.zeros((0, 7)), np.zeros(3)
    if material.parts().elastic is None:
        why = f"damage needs a material with an elastic part, {material} has none: leave out damage or add a spring"
        raise InputError(why, "physics.damage_without_elasticity")
    factors = np.array([bubble.damage.modulus, bubble.damage.radius, 1.0])
    return falling_table(elastic, bubble.damage, stretch), factors


def falling_table(elastic: Floats, damage: Damage, stretch: float) -> Floats:
    """(n, 7) table of the stress while the wall is at its smallest radius so far, x = R/R(0) = L/stretch, from the
    table (m, 7) of the undamaged law (physics/table.py):

    S = x^a S_el(u),  u = L x^b,  a = -log10 modulus,  b = log10 radius.
    """
    a, b = -np.log10(damage.modulus), np.log10(damage.radius)
    u = elastic[:, 0]
    u = np.append(u[u < stretch], stretch)
    L = (u * stretch**b) ** (1 / (1 + b))
    S, S1, S2 = look_up(elastic, u)
    share, c = (L / stretch) ** a, (1 + b) * u
    first = a * S + c * S1  # first derivative by ln L, over share
    second = a * first + c * ((a + 1 + b) * S1 + c * S2)
    return hermite(L, share * S, share * first / L, share * (second - first) / L**2)
