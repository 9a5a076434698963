"""The field's usual way to solve the same physics, as an independent check: method of lines on mass fraction and
Kirchhoff temperature (the equations of Estrada et al. 2018 as printed, docs/method/physics.md section 3.1), finite
differences, scipy's BDF. Shares no line with the package's solver, and imports nothing of it.

With a finite rate of condensation (`rate`, docs section 3.5) the mass fraction at the wall is the root of the balance
of fluxes, and the diffusivity is T^1.75/p times Fo. `inertia` is that of walls, `damping` that of confinement.
A material is two functions: `elastic(L)` of L = R/R_0 gives S_el and L dS_el/dL, `viscous(g)` of g = U/R gives S_v and
-dS_v/dg (docs section 4), stresses in units of the far pressure and times in t_c.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.sparse import csc_matrix, lil_matrix

Floats = NDArray[np.float64]
Part = Callable[[float], tuple[float, float]]


def neo_hookean(modulus: float) -> Part:
    """Elastic part with the closed form, G over the far pressure."""

    def part(L: float) -> tuple[float, float]:
        q = 1.0 / L
        return -modulus * (5 - 4 * q - q**4) / 2, -2 * modulus * (q + q**4)

    return part


def fung(modulus: float, stiffening: float) -> Part:
    """W1 = (G/2) exp(a (I1 - 3)): the integral over the stretch, tabulated."""
    grid = np.linspace(-2.0, 3.0, 40_001)  # ln L
    b, one = np.exp(grid), 16_000
    slope = -2 * modulus * np.exp(np.minimum(stiffening * (b**-4 + 2 * b**2 - 3), 60.0)) * (b**-4 + 1 / b)
    below = cumulative_trapezoid(slope[one::-1], grid[one::-1], initial=0.0)[:0:-1]  # both from L = 1 outwards
    above = cumulative_trapezoid(slope[one:], grid[one:], initial=0.0)
    table = CubicSpline(grid, np.column_stack([np.append(below, above), slope]))
    return lambda L: tuple(table(np.log(L)))


def no_stress(_: float) -> tuple[float, float]:
    return 0.0, 0.0


def newtonian(viscosity: float) -> Part:
    """Viscous part of constant viscosity over p_inf t_c."""
    return lambda g: (-4 * viscosity * g, 4 * viscosity)


def power_law(viscosity: float, exponent: float, rate: float, rest: float) -> Part:
    """Viscosity over p_inf t_c at the shear rate `rate`, a power of the rate above `rest`; rates in 1/t_c."""
    place = np.linspace(0.0, 25.0, 20_001)  # g = rest sinh(place)
    g = rest * np.sinh(place)
    slope = 4 * viscosity * (np.hypot(2 * np.sqrt(3) * g, rest) / rate) ** (exponent - 1)
    table = CubicSpline(place, np.column_stack([cumulative_trapezoid(slope, g, initial=0.0), slope]))

    def part(g: float) -> tuple[float, float]:
        stress, slope = table(np.arcsinh(abs(g) / rest))
        return -np.sign(g) * stress, slope

    return part


def solve(
    numbers,
    y: Floats,
    t_star: Floats,
    rtol: float,
    elastic: Part,
    viscous: Part,
    R_v: float = 462.0,
    R_g: float = 287.0,
    rate: float = np.inf,
    inertia: float = 0.0,
    damping: float = 0.0,
    method: str = "BDF",
) -> Floats:
    """R/R_max at t_star on the nodes y (centre 0 ... wall 1).

    numbers: C*, We, stretch, Fo, chi, A, B, p_v and kappa (docs section 1). rate: sqrt(R_v T_inf/2 pi)/U_c times the
    accommodation coefficient.

    Raises RuntimeError where the integration fails.
    """
    n = len(y)
    Cs, We, lam, Fo, chi, A, B, pv, kappa = numbers[:9]

    left, right = np.diff(y)[:-1], np.diff(y)[1:]
    h1, h2 = y[-1] - y[-2], y[-1] - y[-3]

    def first(f):
        out = np.zeros(n)
        out[1:-1] = (f[2:] * left / right - f[:-2] * right / left + f[1:-1] * (right / left - left / right)) / (
            left + right
        )
        out[-1] = (f[-1] * (h2**2 - h1**2) - f[-2] * h2**2 + f[-3] * h1**2) / (h1 * h2 * (h2 - h1))
        return out

    def laplacian(f, df):
        out = np.zeros(n)
        second = 2 * (f[2:] * left + f[:-2] * right - f[1:-1] * (left + right)) / (left * right * (left + right))
        out[1:-1] = second + 2 * df[1:-1] / y[1:-1]
        out[0] = 6 * (f[1] - f[0]) / y[1] ** 2
        return out

    def wall_fraction(p, R=1.0, inner=None):
        if rate == np.inf or inner is None:
            return 1 / (1 + R_v / R_g * (p / pv - 1))

        # moles of vapour that condense are those that reach the wall, D = Fo/p there: (1 - k) times this is quadratic
        # in k, below 0 at k = 0 and above at k = 1, and the root between is the wanted one
        m, steep = Fo * R_v / R, (h2**2 - h1**2) / (h1 * h2 * (h2 - h1))
        inward = (inner[-1] * h2**2 - inner[-2] * h1**2) / (h1 * h2 * (h2 - h1))
        more = rate * (p * R_v - pv * (R_v - R_g))
        constant, linear = -rate * pv * R_g - m * inward, more + rate * pv * R_g + m * steep
        return -2 * constant / (linear + np.sqrt(linear**2 + 4 * more * constant))

    def rhs(_, s):
        R, U, p = s[:3]
        theta = np.append(s[3 : 3 + n - 1], 0.0)
        k = np.append(s[3 + n - 1 :], wall_fraction(p, R, s[3 + n - 1 :]))
        root = np.sqrt(1 + 2 * A * theta)
        T = (A - 1 + root) / A
        K = A * T + B
        Rm = k * R_v + (1 - k) * R_g
        dth, dk = first(theta), first(k)
        dth[0] = dk[0] = 0.0
        D = Fo if rate == np.inf else Fo * T**1.75 / p
        D_y = 0.0 if rate == np.inf else 1.75 * D * dth / (T * root)
        p_dot = (
            3
            / R
            * (
                -kappa * p * U
                + (kappa - 1) * chi * dth[-1] / R
                + kappa * p * (D * np.ones(n))[-1] * R_v * dk[-1] / (R * Rm[-1] * (1 - k[-1]))
            )
        )
        u_m = ((kappa - 1) * chi * dth / R - R * y * p_dot / 3) / (kappa * p) + D / R * (R_v - R_g) * dk / Rm
        th_dot = (
            (p_dot + chi * laplacian(theta, dth) / R**2) * K * T * (kappa - 1) / (kappa * p)
            - dth * (u_m - y * U) / R
            + D / R**2 * (R_v - R_g) * dk * dth / Rm
        )
        k_dot = D / R**2 * (laplacian(k, dk) - dk * ((R_v - R_g) * dk / Rm + dth / (T * root)))
        k_dot += D_y * dk / R**2 - (u_m - y * U) * dk / R
        (S_el, rise), (S_v, J) = elastic(R * lam), viscous(U / R)
        S, S_dot = S_el + S_v - damping * R**2 * U, rise * U / R + J * (U / R) ** 2 - 2 * damping * R * U**2
        top = (
            (1 + U / Cs) * (p - 1 / (We * R) + S - 1)
            + R / Cs * (p_dot + U / (We * R**2) + S_dot)
            - 1.5 * (1 - U / (3 * Cs)) * U**2
            - 2 * inertia * R * U**2
        )
        acceleration = top / ((1 - U / Cs + inertia * R) * R + (J + damping * R**3) / Cs)
        return np.concatenate([[U, acceleration, p_dot], th_dot[:-1], k_dot[:-1]])

    p0 = pv + (1 + lam / We - pv) / lam**3
    start = np.concatenate([[1.0, 0.0, p0], np.zeros(n - 1), np.full(n - 1, wall_fraction(p0))])
    solution = solve_ivp(
        rhs,
        (0, t_star[-1]),
        start,
        method=method,
        t_eval=t_star,
        rtol=rtol,
        atol=rtol * 1e-2,
        jac_sparsity=_pattern(n),
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    return solution.y[0]


def _pattern(n: int) -> csc_matrix:
    """Which of R, U, p, theta and k the derivatives of each depend on."""
    pattern = lil_matrix((2 * n + 1, 2 * n + 1))
    pattern[:, :3] = 1
    for block in (3, 2 + n):
        for i in range(n - 1):
            for other in (3, 2 + n):
                pattern[block + i, other + max(0, i - 1) : other + min(n - 1, i + 2)] = 1
                pattern[block + i, other + n - 3 : other + n - 1] = 1  # p_dot enters every node
    for j in (n, n + 1, 2 * n - 1, 2 * n):
        pattern[:3, j] = 1
    return pattern.tocsc()
