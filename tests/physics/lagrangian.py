"""Independent reference: spherical bubble in a viscoelastic medium with memory, relaxed at the start.

The medium's stress is carried point by point and S(t) = 2 int_R^inf (tau_rr - tau_tt)/r dr is a quadrature;
no reduced ODE is used. Units: length = the starting radius, pressure = the far pressure, unit density.
"""

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator


def quadrature(n=40, delta=1e-4, far=100.0):
    """Nodes x in (0, inf) and weights: x = delta (e^q - 1) to `far`, then x = far/s."""
    g, w = leggauss(n)
    q1 = np.log1p(far / delta)
    q, wq = q1 * (g + 1) / 2, q1 * w / 2
    g, w = leggauss(n // 4)
    s = (g + 1) / 2
    return np.r_[delta * np.expm1(q), far / s], np.r_[wq * delta * np.exp(q), w / 2 * far / s**2]


class Convected:
    """Upper-convected Maxwell arm on particles x = r^3 - R^3, with L_rr = -2h, L_tt = h, h = R^2 U/r^3:
    d tau_rr/dt = -4h tau_rr - tau_rr/lam - 4 (mu/lam) h,   d tau_tt/dt = 2h tau_tt - tau_tt/lam + 2 (mu/lam) h
    carried as r^4 tau_rr and tau_tt/r^2."""

    def __init__(self, mu, lam):
        self.g, self.lam = mu / lam, lam
        self.x, self.w = quadrature()
        self.size = 2 * len(self.x)

    def rate(self, R, U, y):
        r3 = self.x + R**3
        h, (a, b), g = R * R * U / r3, y.reshape(2, -1), self.g
        return np.r_[-4 * g * h * r3 ** (4 / 3) - a / self.lam, 2 * g * h * r3 ** (-2 / 3) - b / self.lam]

    def S(self, R, U, y, dy):
        """S and its rate."""
        r3 = self.x + R**3
        h, (a, b), (da, db) = R * R * U / r3, y.reshape(2, -1), dy.reshape(2, -1)
        ca, cb = r3 ** (-4 / 3), r3 ** (2 / 3)
        difference, drr, dtt = a * ca - b * cb, ca * (da - 4 * h * a), cb * (db + 2 * h * b)
        return 2 / 3 * self.w @ (difference / r3), 2 / 3 * self.w @ ((drr - dtt - 3 * h * difference) / r3)


class Fixed:
    """Linear Maxwell arm, d tau/dt|_r = (2 mu D - tau)/lam at nodes v = 1/r^3 < 1/rmin^3, of which those inside the
    bubble carry the continuation; S = (2/3) int_0^{R^-3} (tau_rr - tau_tt)/v dv."""

    def __init__(self, mu, lam, n=12, rmin=0.02):
        self.mu, self.lam, self.size = mu, lam, 2 * n
        self.v = (1 + np.cos(np.pi * (np.arange(n) + 0.5) / n)) / 2 / rmin**3
        self.interp = BarycentricInterpolator(self.v)
        self.gl = leggauss(n)

    def rate(self, R, U, y):
        a, b = y.reshape(2, -1)
        d = R * R * U * self.v
        return np.r_[(-4 * self.mu * d - a) / self.lam, (2 * self.mu * d - b) / self.lam]

    def _integral(self, R, y):
        top = R**-3
        assert top <= self.v[0] * 1.01, "R below rmin"
        v = top * (self.gl[0] + 1) / 2
        a, b = y.reshape(2, -1)
        self.interp.set_yi(a - b)
        return 2 / 3 * (top / 2 * self.gl[1]) @ (self.interp(v) / v), self.interp(top)

    def S(self, R, U, y, dy):
        """S and its rate."""
        S, wall = self._integral(R, y)
        return S, self._integral(R, dy)[0] - 2 * U / R * wall


def neo_hookean(G, R0):
    """(R, U) -> S and its rate, of the elastic stress G b about the radius R0, by quadrature."""
    x, w = quadrature()

    def S(R, U):
        r3 = x + R**3
        l3 = r3 / (x + R0**3)  # (r/r0)^3
        brr, btt, h = l3 ** (-4 / 3), l3 ** (2 / 3), R * R * U / r3
        f = G * 2 / 3 * w / r3
        return f @ (brr - btt), f @ (-4 * h * brr - 2 * h * btt - 3 * h * (brr - btt))

    return S


def linear(G, R0):
    """The same of small strains, in closed form."""
    return lambda R, U: (-4 * G / 3 * (1 - (R0 / R) ** 3), -4 * G * (R0 / R) ** 3 * U / R)


def solve(t, arm, spring=lambda R, U: (0.0, 0.0), *, mu_s, stretch, We, pv, k, C, rtol):
    """R, U, S at the times t (t[0] = 0).

    mu_s: of a Newtonian solvent 2 mu_s D. C: sound speed (Keller-Miksis when finite).
    """
    pg = (1 + stretch / We - pv) / stretch**3

    def stress(R, U, y):
        """S without the part of its rate that is proportional to U'; that rate; and the memory's."""
        dy = arm.rate(R, U, y)
        parts = (-4 * mu_s * U / R, 4 * mu_s * U * U / R**2), spring(R, U), arm.S(R, U, y, dy)
        return *map(sum, zip(*parts, strict=True)), dy

    def rhs(t, y):
        R, U = y[:2]
        S, dS, dm = stress(R, U, y[2:])
        p = pv + pg * R ** (-3 * k)
        dp = -3 * k * pg * R ** (-3 * k) * U / R
        force = (1 + U / C) * (p - 1 / (We * R) + S - 1) + R / C * (dp + U / (We * R * R) + dS)
        force -= 1.5 * (1 - U / (3 * C)) * U * U
        return np.r_[U, force / ((1 - U / C) * R + 4 * mu_s / C), dm]

    start = np.r_[1.0, 0.0, np.zeros(arm.size)]
    R, U, *m = solve_ivp(rhs, (0, t[-1]), start, t_eval=t, method="DOP853", rtol=rtol, atol=1e-3 * rtol).y
    return R, U, np.array([stress(*now, then)[0] for *now, then in zip(R, U, np.transpose(m), strict=True)])
