"""Independent reference: the stress of a linear Maxwell medium around a bubble, relaxed at the start.

It is carried at fixed places, and S(t) = 2 int_R^inf (tau_rr - tau_tt)/r dr is a quadrature; no reduced ODE is used.
Units: length = the starting radius, pressure = the far pressure, unit density. `spring`: R -> S of what stands beside.
Arms that move with the material are checked against IMRv2 (test_imrv2.py).
"""

import numpy as np


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


def linear(G, R0):
    """R -> S of an elastic stress of small strains about the radius R0, in closed form."""
    return lambda R: -4 * G / 3 * (1 - (R0 / R) ** 3)
