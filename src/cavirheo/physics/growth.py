"""What a material remembers at R_max: the growth of the bubble from R_0, found by shooting."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.physics import solver
from cavirheo.physics.grid import NO_SHELLS
from cavirheo.physics.scales import ABSENT, Numbers
from cavirheo.physics.tableau import RODAS5P

_TIME = np.linspace(0.0, 4.0, 8001)  # in t_c: an impulse turns within about one
_RTOL = 1e-8


def remembered(numbers: Numbers) -> Floats:
    """Memories (k,) at R = 1 after growth from relaxed rest at R_0 = 1/stretch.

    The growth is an impulse: at R_0 the wall gets the velocity that carries it to R = 1, in incompressible surroundings
    of the same law, with isothermal gas and saturated vapour (docs/method/physics.md, section 4.3).

    Raises:
        SolverError: no impulse carries the wall to R_max within the laws of the material.
    """
    if numbers.stretch == 1:
        return np.zeros(len(numbers.memory))
    quiet = numbers._replace(C=np.inf, tait=0.0, polytropic=1.0, driving=ABSENT, vapour=numbers.pv)
    quiet = quiet._replace(damage=numbers.damage * [1, 1, 1 / numbers.stretch])  # growth from R_0 does none
    state = np.zeros(len(numbers.memory))

    def overshoot(velocity: float) -> float:
        radius, state[:] = _turn(quiet, velocity)
        return radius - 1

    high = np.sqrt(2 / 3 * numbers.stretch**3)  # all the work against the ambient pressure, from kinetic energy
    for _ in range(40):
        if overshoot(high) > 0:
            break
        high *= 1.5
    if abs(overshoot(brentq(overshoot, 0.0, high, xtol=1e-10, rtol=1e-10))) > 1e-6:
        raise SolverError("no impulse at R_0 makes the bubble grow to R_max in this material; start it relaxed")
    return state


def _turn(numbers: Numbers, velocity: float) -> tuple[float, Floats]:
    """Radius and memories where a wall that leaves R_0 with this velocity comes to rest; 2 where none is found."""
    k = len(numbers.memory)
    out = np.full((_TIME.size, 4 + k), np.nan)
    small = 1 / numbers.stretch
    gas = (numbers.pressure - numbers.pv) * numbers.stretch**3
    start = np.concatenate([[small, velocity, numbers.pv + gas], np.zeros(k)])
    solver.integrate(numbers, NO_SHELLS, RODAS5P, start, _TIME, _RTOL, 20_000, True, out, np.zeros((0, 0)), np.zeros(5))
    falling = np.flatnonzero(out[:, 1] <= 0)
    if velocity == 0:
        return small, out[0, 4:]
    if falling.size == 0:
        return 2.0, out[0, 4:]
    i = np.array([falling[0] - 1, falling[0]])
    R, U, m = out[i, 0], out[i, 1], out[i, 4:]
    x = U[0] / (U[0] - U[1])
    when = _TIME[i[0]] + x * (_TIME[i[1]] - _TIME[i[0]])
    return float(CubicHermiteSpline(_TIME[i], R, U)(when)), m[0] + x * (m[1] - m[0])
