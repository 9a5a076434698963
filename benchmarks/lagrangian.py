"""Independent reference: spherical bubble in an incompressible viscoelastic medium with memory.

The medium's stress is carried point by point and S(t) = 2 int_R^inf (tau_rr - tau_tt)/r dr is a quadrature;
no reduced ODE is used.  Units: length = the starting radius, pressure = the far pressure, unit density.

Upper-convected arm: particles, label x = r^3 - R^3 (constant: incompressible), L_rr = -2h, L_tt = h, h = R^2 U/r^3:
    d tau_rr/dt = -4h tau_rr - tau_rr/lam - 4 (mu/lam) h,   d tau_tt/dt = 2h tau_tt - tau_tt/lam + 2 (mu/lam) h
carried as r^4 tau_rr and tau_tt/r^2 (raw=True: as they stand).
Linear arm: nodes at fixed r, d tau/dt|_r = (2 mu D - tau)/lam; a node inside the bubble carries the continuation.
"""

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp
from scipy.interpolate import BarycentricInterpolator

# law: (spring, arm); a Newtonian solvent 2 mu_s D is added in every law
LAWS = {
    "newton": (None, None),
    "kv": ("nh", None),
    "kv_lin": ("lin", None),
    "ucm": (None, "ucm"),
    "oldroyd": (None, "ucm"),
    "linear": (None, "lin"),
    "zener": ("nh", "ucm"),
    "zener_lin": ("lin", "lin"),
}


def quadrature(n, delta=1e-4, far=100.0):
    """Nodes x in (0, inf) and weights: x = delta (e^q - 1) to `far`, then x = far/s."""
    g, w = leggauss(n)
    q1 = np.log1p(far / delta)
    q, wq = q1 * (g + 1) / 2, q1 * w / 2
    g, w = leggauss(max(8, n // 4))
    s = (g + 1) / 2
    return np.r_[delta * np.expm1(q), far / s], np.r_[wq * delta * np.exp(q), w / 2 * far / s**2]


class Convected:
    """Upper-convected Maxwell arm on Lagrangian particles."""

    def __init__(self, mu, lam, n, raw):
        self.g, self.lam, self.raw = mu / lam, lam, raw
        self.x, self.w = quadrature(n)
        self.size = 2 * len(self.x)

    def rate(self, R, U, y):
        r3 = self.x + R**3
        h, (a, b), g = R * R * U / r3, y.reshape(2, -1), self.g
        if self.raw:
            return np.r_[-4 * h * (a + g) - a / self.lam, 2 * h * (b + g) - b / self.lam]
        return np.r_[-4 * g * h * r3 ** (4 / 3) - a / self.lam, 2 * g * h * r3 ** (-2 / 3) - b / self.lam]

    def S(self, R, U, y, dy=None):
        """S, or with dy = rate(...) its rate too."""
        r3 = self.x + R**3
        h, (a, b) = R * R * U / r3, y.reshape(2, -1)
        ca, cb = (1, 1) if self.raw else (r3 ** (-4 / 3), r3 ** (2 / 3))
        S = 2 / 3 * self.w @ ((a * ca - b * cb) / r3)
        if dy is None:
            return S
        da, db = dy.reshape(2, -1)
        drr, dtt = (da, db) if self.raw else (ca * (da - 4 * h * a), cb * (db + 2 * h * b))
        return S, 2 / 3 * self.w @ ((drr - dtt - 3 * h * (a * ca - b * cb)) / r3)


class Fixed:
    """Linear Maxwell arm, nodes at fixed r, v = 1/r^3 < 1/rmin^3; S = (2/3) int_0^{R^-3} (tau_rr - tau_tt)/v dv."""

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

    def S(self, R, U, y, dy=None):
        S, wall = self._integral(R, y)
        return S if dy is None else (S, self._integral(R, dy)[0] - 2 * U / R * wall)


class Spring:
    """Elastic stress about the radius R0: neo-Hookean G b by quadrature, or the linear closed form."""

    def __init__(self, kind, G, R0, n):
        self.kind, self.G, self.R0 = kind, G, R0
        self.x, self.w = quadrature(n)

    def S(self, R, U):
        if self.kind == "lin":
            q3 = (self.R0 / R) ** 3
            return -4 * self.G / 3 * (1 - q3), -4 * self.G * q3 * U / R
        r3 = self.x + R**3
        l3 = r3 / (self.x + self.R0**3)  # (r/r0)^3
        brr, btt, h = l3 ** (-4 / 3), l3 ** (2 / 3), R * R * U / r3
        f = self.G * 2 / 3 * self.w / r3
        return f @ (brr - btt), f @ (-4 * h * brr - 2 * h * btt - 3 * h * (brr - btt))


def growth(s, T, R0):
    """Prescribed history: R and U at s in (0, T), from R0 to 1, at rest at both ends."""
    z = s / T
    return R0 + (1 - R0) * z**3 * (10 - 15 * z + 6 * z * z), (1 - R0) * 30 * (z * (1 - z)) ** 2 / T


def solve(
    law,
    t,
    *,
    G=0.0,
    mu=0.0,
    lam=1.0,
    mu_s=0.0,
    stretch=1.0,
    We=np.inf,
    pv=0.0,
    k=1.4,
    start="relaxed",
    n=80,
    rtol=1e-11,
    C=np.inf,
    U0=0.0,
    path=None,
    raw=False,
    method="DOP853",
):
    """R, U, S at the times t (t[0] = 0).

    start: "relaxed" (memory stress 0 at t = 0) or ("history", T_g) (relaxed at 1/stretch, then `growth` over T_g).
    C: sound speed (Keller-Miksis when finite).  path(t) -> R, U: prescribed motion instead of the momentum equation.
    """
    kind, arm_kind = LAWS[law]
    R0 = 1 / stretch
    spring = Spring(kind, G, R0, n) if kind else None
    arm = {"ucm": lambda: Convected(mu, lam, n, raw), "lin": lambda: Fixed(mu, lam), None: lambda: None}[arm_kind]()
    pg = (1 + stretch / We - pv) / stretch**3
    opts = dict(method=method, rtol=rtol, atol=1e-3 * rtol)

    def stress(R, U, y, rates=False):
        """S without the part of its rate that is proportional to U'; and that rate."""
        S, dS, dy = -4 * mu_s * U / R, 4 * mu_s * U * U / R**2, y[:0]
        if spring:
            s, ds = spring.S(R, U)
            S, dS = S + s, dS + ds
        if arm:
            dy = arm.rate(R, U, y)
            s, ds = arm.S(R, U, y, dy) if rates and np.isfinite(C) else (arm.S(R, U, y), 0.0)
            S, dS = S + s, dS + ds
        return S, dS, dy

    def rhs(t, y):
        R, U, m = y[0], y[1], y[2:]
        S, dS, dm = stress(R, U, m, True)
        p = pv + pg * R ** (-3 * k)
        dp = -3 * k * pg * R ** (-3 * k) * U / R
        force = (1 + U / C) * (p - 1 / (We * R) + S - 1) + R / C * (dp + U / (We * R * R) + dS)
        force -= 1.5 * (1 - U / (3 * C)) * U * U
        return np.r_[U, force / ((1 - U / C) * R + 4 * mu_s / C), dm]

    m = np.zeros(arm.size if arm else 0)
    if arm and start != "relaxed":
        T = start[1]
        m = solve_ivp(lambda s, y: arm.rate(*growth(s, T, R0), y), (0, T), m, **opts).y[:, -1]
    t = np.asarray(t, float)
    if path is None:
        out = solve_ivp(rhs, (0, t[-1]), np.r_[1.0, U0, m], t_eval=t, **opts).y
        R, U, m = out[0], out[1], out[2:]
    else:
        R, U = path(t)
        m = (
            solve_ivp(lambda s, y: arm.rate(*path(s), y), (0, t[-1]), m, t_eval=t, **opts).y
            if arm
            else np.zeros((0, len(t)))
        )
    return R, U, np.array([stress(R[i], U[i], m[:, i])[0] for i in range(len(t))])
