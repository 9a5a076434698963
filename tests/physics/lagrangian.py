"""Independent reference: the stress of a viscoelastic medium with memory around a bubble, relaxed at the start.

It is carried point by point and S(t) = 2 int_R^inf (tau_rr - tau_tt)/r dr is a quadrature; no reduced ODE is used.
Units: length = the starting radius, pressure = the far pressure, unit density. `spring`: R -> S of what stands beside.
"""

import numpy as np
from numpy.polynomial.legendre import leggauss


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

    def __init__(self, mu, lam, spring=lambda R: 0.0):
        self.g, self.lam, self.spring = mu / lam, lam, spring
        self.x, self.w = quadrature()
        self.size = 2 * len(self.x)

    def rate(self, R, U, y):
        r3 = self.x + R**3
        h, (a, b), g = R * R * U / r3, y.reshape(2, -1), self.g
        return np.r_[-4 * g * h * r3 ** (4 / 3) - a / self.lam, 2 * g * h * r3 ** (-2 / 3) - b / self.lam]

    def S(self, R, y):
        r3, (a, b) = self.x + R**3, y.reshape(2, -1)
        return 2 / 3 * self.w @ ((a * r3 ** (-4 / 3) - b * r3 ** (2 / 3)) / r3) + self.spring(R)


class Fixed:
    """Linear Maxwell arm, d tau/dt|_r = (2 mu D - tau)/lam at nodes v = 1/r^3 < 1/rmin^3, of which those inside the
    bubble carry the continuation; S = (2/3) int_0^{R^-3} (tau_rr - tau_tt)/v dv of a polynomial through them and 0."""

    def __init__(self, mu, lam, spring=lambda R: 0.0, n=4, rmin=0.02):
        self.mu, self.lam, self.spring, self.rmin, self.size = mu, lam, spring, rmin, 2 * n
        self.k, x = np.arange(1, n + 1), np.arange(1, n + 1) / n  # x = v rmin^3
        self.v, self.to_powers = x / rmin**3, np.linalg.inv(x[:, None] ** self.k)

    def rate(self, R, U, y):
        a, b = y.reshape(2, -1)
        d = R * R * U * self.v
        return np.r_[(-4 * self.mu * d - a) / self.lam, (2 * self.mu * d - b) / self.lam]

    def S(self, R, y):
        a, b = y.reshape(2, -1)
        return 2 / 3 * self.to_powers @ (a - b) @ ((self.rmin / R) ** (3 * self.k) / self.k) + self.spring(R)


def neo_hookean(G, R0):
    """R -> S of the elastic stress G b about the radius R0, by quadrature."""
    x, w = quadrature()

    def S(R):
        r3 = x + R**3
        l3 = r3 / (x + R0**3)  # (r/r0)^3
        return 2 / 3 * G * w @ ((l3 ** (-4 / 3) - l3 ** (2 / 3)) / r3)

    return S


def linear(G, R0):
    """The same of small strains, in closed form."""
    return lambda R: -4 * G / 3 * (1 - (R0 / R) ** 3)
