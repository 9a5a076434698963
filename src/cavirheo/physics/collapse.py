"""Time of the first collapse, by the analytic model of pIMR and by simulation.

t_1 is the time from R_max to the first minimum of R(t), t_RC = 0.9147 R_max sqrt(rho/p) that of an empty bubble.
The analytic model (Zhu et al. 2025, doi:10.1039/D5SM00397K) takes a microsecond and is 0.3 % too long in the median
where Re > 10; docs/how-to/collapse-time.md describes its range and the sources of its errors.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.landmarks import RAYLEIGH
from cavirheo.physics.materials import NeoHookeanKelvinVoigt
from cavirheo.physics.media import WATER, Medium
from cavirheo.physics.simulate import simulate_many

_A = 1 / RAYLEIGH  # A_RC of the paper
_SURFACE = pi * _A / sqrt(6)  # mean of (3/2) (1 - r^2)/(1 - r^3) over Rayleigh's collapse
_GAS = 1.4942  # the paper's C_kappa: mean of 3 (r^(3-3k) - 1)/((3k-3)(1 - r^3)) over Rayleigh's collapse, k = 1.4
_VISCOUS = (0.4637, 0.56598, 5.7331)  # the paper's series in 1/Re
_SAMPLES = 4096  # number of samples of a simulated collapse; each costs 50 ns
_LATEST = 4.0  # in t_RC: latest time at which a simulated bubble may collapse


def rayleigh_time(max_radius: ArrayLike, medium: Medium = WATER) -> Floats:
    """t_RC in s of bubbles of R_max (n,) in m."""
    return RAYLEIGH * np.asarray(max_radius, dtype=float) / medium.velocity_scale


def elastic_number(stretch: ArrayLike) -> Floats:
    """Be: a neo-Hookean gel of modulus G collapses sqrt(1 + Be G/p) times earlier than a liquid (Zhu et al. 2025,
    doi:10.1039/D5SM00397K)."""
    return np.asarray(2.5 - 2 * _SURFACE / np.asarray(stretch, dtype=float))


def inverse_square(
    max_radius: ArrayLike, stretch: ArrayLike, shear_modulus: ArrayLike, viscosity: ArrayLike, medium: Medium = WATER
) -> Floats:
    """(t_RC/t_1)^2 of the analytic model = f_model - f_We - f_Ma - f_gas; zero or less if there is no collapse.

    Neo-Hookean Kelvin-Voigt (Zhu et al. 2025, doi:10.1039/D5SM00397K); G = 0 is a Newtonian fluid, mu = 0 a neo-Hookean
    solid. The arguments broadcast; the result falls with mu and rises with G.

    f_We = -pi A_RC/(sqrt(6) We), f_Ma = 2/(1 + sqrt(1 + 4 (C/A_RC)^2)), f_gas = 1.4942 (lambda^-3 + p_v),
    f_model = (Z + sqrt(Z^2 + beta))^-2, Z = 2 beta A_RC (0.4637/Re + 0.56598/Re^2 + 5.7331/Re^3),
    beta = 1/(1 + Be/Ca), Be = 5/2 - sqrt(2/3) pi A_RC/lambda; symbols as in docs/method/physics.md, section 1.
    """
    R, stretch, mu = (np.asarray(a, dtype=float) for a in (max_radius, stretch, viscosity))
    U_c, p = medium.velocity_scale, medium.pressure
    f_We = -_SURFACE * 2 * medium.surface_tension / (p * R)
    f_Ma = 2 / (1 + sqrt(1 + 4 * (medium.sound_speed / (U_c * _A)) ** 2))
    f_gas = _GAS * (stretch**-3 + medium.vapour_pressure / p)
    inverse_Re = mu * U_c / (p * R)
    a, b, c = _VISCOUS
    beta = 1 / (1 + elastic_number(stretch) * np.asarray(shear_modulus, dtype=float) / p)
    Z = beta * (2 * _A * inverse_Re * (a + inverse_Re * (b + inverse_Re * c)))
    return np.asarray((Z + np.sqrt(Z * Z + beta)) ** -2 - (f_We + f_Ma + f_gas))


def analytic_time(
    max_radius: ArrayLike, stretch: ArrayLike, shear_modulus: ArrayLike, viscosity: ArrayLike, medium: Medium = WATER
) -> Floats:
    """t_1 in s of the analytic model; infinite if there is no collapse. Arguments as for `inverse_square`."""
    f = inverse_square(max_radius, stretch, shear_modulus, viscosity, medium)
    with np.errstate(divide="ignore"):
        return np.asarray(rayleigh_time(max_radius, medium) / np.sqrt(np.maximum(f, 0.0)))


def simulated_time(
    max_radius: ArrayLike,
    stretch: ArrayLike,
    shear_modulus: ArrayLike,
    viscosity: ArrayLike,
    medium: Medium = WATER,
    **options: Any,
) -> Floats:
    """(n,) s: t_1 of simulated neo-Hookean Kelvin-Voigt bubbles; infinite without a collapse within 4 t_RC.

    The first four arguments broadcast to (n,); `options` are those of `simulate_many`. About 5 ms per bubble and core.

    Raises:
        InputError: a parameter out of its domain.
        SolverError: a simulation failed (where, and how).
    """
    four = (np.atleast_1d(np.asarray(a, dtype=float)) for a in (max_radius, stretch, shear_modulus, viscosity))
    R, stretches, G, mu = np.broadcast_arrays(*four)
    late = _LATEST * rayleigh_time(R, medium)
    # the analytic time gives the end of the first simulation
    guess = np.minimum(1.3 * analytic_time(R, stretches, G, mu, medium), late)
    times = np.full(R.shape, np.inf)
    for end in (guess, late):
        missing = np.flatnonzero(np.isinf(times))
        materials = [NeoHookeanKelvinVoigt(float(G[i]), float(mu[i])) for i in missing]
        time = np.linspace(0.0, end[missing], _SAMPLES, axis=1)
        shots: Any = {"max_radius": R[missing], "stretch": stretches[missing], "time": time, "medium": medium}
        for i, run in zip(missing, simulate_many(materials, **shots, **options), strict=True):
            times[i] = _first_minimum(run.time, run.radius, run.velocity)
            if not np.isfinite(times[i]) and not run.ok:
                raise SolverError(f"no collapse time: {run.status}")
    return times


def _first_minimum(time: Floats, radius: Floats, velocity: Floats) -> float:
    """Time at which the wall first turns outwards, by a cubic through radius and velocity; infinite if it does not."""
    turns = np.flatnonzero((velocity[1:] > 0) & (velocity[:-1] <= 0) & (time[1:] > 0))
    turns = turns[radius[turns] < radius[0]]
    if turns.size == 0:
        return np.inf
    k = int(turns[0])
    h = time[k + 1] - time[k]
    a, b, rise = h * velocity[k], h * velocity[k + 1], radius[k + 1] - radius[k]
    # d/dx of the Hermite cubic: a + 2 (3 rise - 2a - b) x + 3 (a + b - 2 rise) x^2; the root where it turns positive
    square, half = 3 * (a + b - 2 * rise), 3 * rise - 2 * a - b
    root = sqrt(max(half * half - square * a, 0.0))
    x = -a / (half + root) if half + root > 0 else 0.5
    return float(time[k] + h * min(max(x, 0.0), 1.0))
