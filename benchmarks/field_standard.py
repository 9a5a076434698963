"""The field's usual way to solve the same physics, as an independent check: method of lines on mass fraction and
Kirchhoff temperature (the equations of Estrada et al. 2018 as printed, docs/method/physics.md section 3.1), finite
differences, scipy's BDF. Shares no line with the package's solver.

With a finite rate of condensation (`rate`, docs section 3.5) the mass fraction at the wall is the root of the balance
of fluxes, found by bracketing, and the diffusivity is T^1.75/p times Fo. `inertia` is that of walls.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.sparse import lil_matrix


def solve(
    numbers,
    y: NDArray[np.float64],
    t_star: NDArray[np.float64],
    rtol: float,
    iCa: float,
    iRe: float,
    R_v: float = 462.0,
    R_g: float = 287.0,
    rate: float = np.inf,
    inertia: float = 0.0,
    method: str = "BDF",
) -> NDArray[np.float64]:
    """R/R_max at t_star for dimensionless `numbers` on the nodes y (centre 0 ... wall 1).

    The material is neo-Hookean with a dashpot: iCa = G/p_inf, iRe = mu/(p_inf t_c). rate: sqrt(R_v T_inf/2 pi)/U_c
    times the accommodation coefficient.
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

        def balance(k):  # moles of vapour that condense less those that reach the wall; D = Fo/p there
            Rm, dk = k * R_v + (1 - k) * R_g, (k * (h2**2 - h1**2) - inner[-1] * h2**2 + inner[-2] * h1**2)
            dk /= h1 * h2 * (h2 - h1)
            return rate * (p * k * R_v / Rm - pv) + Fo * R_v * dk / (R * Rm * (1 - k))

        return brentq(balance, -1.0, 1 - 1e-12, xtol=1e-15, rtol=1e-14)

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
        q = 1 / (R * lam)
        S = -iCa * (5 - 4 * q - q**4) / 2 - 4 * iRe * U / R
        S_dot = -2 * iCa * (q + q**4) * U / R + 4 * iRe * (U / R) ** 2
        top = (
            (1 + U / Cs) * (p - 1 / (We * R) + S - 1)
            + R / Cs * (p_dot + U / (We * R**2) + S_dot)
            - 1.5 * (1 - U / (3 * Cs)) * U**2
            - 2 * inertia * R * U**2
        )
        acceleration = top / ((1 - U / Cs + inertia * R) * R + 4 * iRe / Cs)
        return np.concatenate([[U, acceleration, p_dot], th_dot[:-1], k_dot[:-1]])

    p0 = pv + (1 + lam / We - pv) / lam**3
    start = np.concatenate([[1.0, 0.0, p0], np.zeros(n - 1), np.full(n - 1, wall_fraction(p0))])
    pattern = lil_matrix((len(start), len(start)))
    pattern[:3, :] = 0
    pattern[:, :3] = 1
    for block in (3, 2 + n):
        for i in range(n - 1):
            for other in (3, 2 + n):
                for j in range(max(0, i - 1), min(n - 1, i + 2)):
                    pattern[block + i, other + j] = 1
                for j in (n - 3, n - 2):  # p_dot enters every node
                    pattern[block + i, other + j] = 1
    for j in (3 + n - 3, 3 + n - 2, 2 + n + n - 3, 2 + n + n - 2):
        pattern[:3, j] = 1
    solution = solve_ivp(
        rhs,
        (0, t_star[-1]),
        start,
        method=method,
        t_eval=t_star,
        rtol=rtol,
        atol=rtol * 1e-2,
        jac_sparsity=pattern.tocsc(),
    )
    assert solution.success, solution.message
    return solution.y[0]
