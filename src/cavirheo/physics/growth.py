"""What a material remembers at R_max: the growth of the bubble from R_0, found by shooting."""

from __future__ import annotations

from math import prod

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import SolverError
from cavirheo.physics import solver
from cavirheo.physics.accuracy import NO_SHELLS
from cavirheo.physics.scales import ABSENT, Numbers
from cavirheo.physics.tableau import RODAS5P

_TIME = np.linspace(0.0, 4.0, 401)  # in t_c: an impulse turns within about one
_RTOL = (1e-7, 1e-5)
_NEAR = 0.03  # of R^3, from which memories follow from those of other impulses
_LARGEST = 1e9  # impulse over stretch^3


def remembered(numbers: Numbers, rtol: float) -> Floats:
    """Memories (k,) at R = 1 after growth from relaxed rest at R_0 = 1/stretch, a hundred times as exact as `rtol`
    says, within bounds.

    The growth is an impulse: at R_0 the wall gets the velocity that carries it to R = 1, in incompressible surroundings
    of the same law, with isothermal gas and saturated vapour (docs/method/physics.md, section 4.3).

    Raises:
        SolverError: no impulse carries the wall to R_max within the laws of the material.
    """
    nothing = np.zeros(len(numbers.memory))
    if numbers.stretch == 1:
        return nothing
    quiet = numbers._replace(C=np.inf, tait=0.0, polytropic=1.0, driving=ABSENT, vapour=numbers.pv)
    quiet = quiet._replace(damage=numbers.damage * [1, 1, 1 / numbers.stretch])  # growth from R_0 does none
    exact = min(max(rtol / 100, _RTOL[0]), _RTOL[1])
    # R^3 is nearly linear in the impulse v^2, the kinetic energy: (impulse, memories) by R^3 - 1 of what was tried
    turns: dict[float, tuple[float, Floats]] = {numbers.stretch**-3.0 - 1.0: (0.0, nothing)}
    low, high = 0.0, np.inf
    impulse = work = 2 / 3 * numbers.stretch**3  # all the work against the ambient pressure
    while high - low > exact * max(low, work):
        radius, memories = _turn(quiet, float(np.sqrt(impulse)), exact)
        missed = radius**3 - 1.0
        low, high = (impulse, high) if missed < 0 else (low, impulse)
        if radius < np.inf:
            turns[missed] = impulse, memories
            near = sorted(turns, key=abs)[:4]
            if abs(near[0]) < exact:
                return turns[near[0]][1]
            weights = np.array(_at_nothing(near))
            # the error of a cubic through four is about the product of what they missed by
            if abs(near[0]) < _NEAR and len(near) == 4 and prod(map(abs, near)) < exact:
                return np.asarray(weights @ np.array([turns[one][1] for one in near]))
            impulse = float(weights @ np.array([turns[one][0] for one in near]))
        if not low < impulse < high:
            impulse = 2.0 * low if high == np.inf else 0.5 * (low + high)
        if impulse > _LARGEST * numbers.stretch**3:
            break
    raise SolverError("no impulse at R_0 makes the bubble grow to R_max in this material; start it relaxed")


def _at_nothing(x: list[float]) -> list[float]:
    """Weights with which values at x give the value at 0 of the polynomial through them (Lagrange)."""
    return [prod(b / (b - a) for j, b in enumerate(x) if j != i) for i, a in enumerate(x)]


def _turn(numbers: Numbers, velocity: float, rtol: float) -> tuple[float, Floats]:
    """Radius and memories where a wall that leaves R_0 with this velocity comes to rest; infinite if none is found."""
    k = len(numbers.memory)
    out = np.full((_TIME.size, 4 + k), np.nan)
    small = 1 / numbers.stretch
    gas = (numbers.pressure - numbers.pv) * numbers.stretch**3
    start = np.concatenate([[small, velocity, numbers.pv + gas], np.zeros(k)])
    ways = (_TIME, rtol, 20_000, True)
    code = solver.integrate(numbers, NO_SHELLS, RODAS5P, start, *ways, out, np.zeros((0, 0)), np.zeros(5))
    falling = np.flatnonzero(out[:, 1] <= 0)
    reached = np.count_nonzero(np.isfinite(out[:, 1]))
    if falling.size:
        after = falling[0]
    elif code == solver.OK and reached < len(_TIME):  # the solver stops at the turn, here before the next instant
        after = reached - 1
    else:
        return np.inf, out[0, 4:]
    i, step = np.array([after - 1, after]), _TIME[after] - _TIME[after - 1]
    R, U, m = out[i, :1], out[i, 1:2], out[i, 4:]
    power, fading, follows = numbers.memory[:, 1:].T
    E = np.array([solver.spring(numbers, float(radius))[:1] for radius in R[:, 0]]) if numbers.delayed else 0.0
    rates = (follows * E - m) * fading - power * (1 + m) * U / R
    (y0, y1), (slope0, slope1) = np.hstack([R, m]), step * np.hstack([U, rates])
    x = U[0, 0] / (U[0, 0] - U[1, 0])  # on the cubic through values and slopes at both instants
    here = (1 - x) ** 2 * ((1 + 2 * x) * y0 + x * slope0) + x**2 * ((3 - 2 * x) * y1 - (1 - x) * slope1)
    return float(here[0]), here[1:]
