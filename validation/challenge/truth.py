"""What is simulated: materials and bubbles drawn from the ranges that gels and liquids have, and their R(t).

The ranges are those of published values, not the prior of a program; no number here is read from cavirheo.
The bubble is solved by validation/field_standard.py, the field's method with scipy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from validation import field_standard

HALVES = ("field", "real")  # bubble with equilibrium contents in open liquid; with both resistances
LAWS = ("nhkv", "nhkv", "newtonian", "power-law", "fung + newtonian")  # two of five are neo-Hookean Kelvin-Voigt
PRESSURE, TEMPERATURE = 101325.0, 298.15  # Pa, K, far from the bubble
SOUND_SPEED, SURFACE_TENSION = 1484.0, 0.072  # m/s, N/m
KAPPA, R_VAPOUR, R_GAS, DIFFUSIVITY = 1.4, 462.0, 287.0, 24.2e-6  # 1, J/(kg K), J/(kg K), m2/s
CONDUCTIVITY = (5.3e-5, 1.17e-2)  # slope W/(m K2), intercept W/(m K)
VAPOUR = (1.17e11, 5200.0)  # p_v = Pa exp(-K/T)
RATE = 1e5  # 1/s, at which the viscosity of a power law is stated
PLATEAU = 1e3  # 1/s, below which a power law has a constant viscosity
NODES, STEEPNESS, TOLERANCE = 100, 4.0, 1e-5  # of the solver
STEP = 0.0025  # t_c between samples of the solution


@dataclass(frozen=True)
class Truth:
    """SI. G is 0 in liquids; mu of a power law is that at RATE."""

    half: str
    law: str
    G: float
    mu: float
    stretch: float
    R_max: float
    density: float
    exponent: float = 1.0  # of a power law
    stiffening: float = 0.0  # of Fung's law
    accommodation: float = np.inf
    damping: float = 0.0

    @property
    def t_c(self) -> float:
        """R_max sqrt(rho/p), s."""
        return self.R_max * float(np.sqrt(self.density / PRESSURE))


def _log_normal(rng: np.random.Generator, median: float, decades: float, low: float, high: float) -> float:
    while True:
        value = median * 10 ** (decades * rng.standard_normal())
        if low <= value <= high:
            return float(value)


def draw(rng: np.random.Generator, half: str, law: str) -> Truth:
    """Stiffer gels are grown to smaller stretches, as in experiments."""
    liquid = law in ("newtonian", "power-law")
    G = 0.0 if liquid else _log_normal(rng, 8e3, 0.45, 500.0, 1e5)
    mu = _log_normal(rng, 0.05, 0.4, 0.005, 0.5)
    middle = 7.5 if liquid else 9.5 - 2.5 * np.log10(G / 1e3)
    stretch = float(np.clip(middle + rng.standard_normal(), 2.5, 11.0))
    R_max = _log_normal(rng, 220e-6, 0.18, 60e-6, 500e-6)
    density = float(rng.uniform(998.0, 1060.0))
    more = {}
    if law == "power-law":
        more["exponent"] = float(np.clip(0.6 + 0.15 * rng.standard_normal(), 0.35, 0.95))
    if law == "fung + newtonian":  # so many times as steep at R_max as a neo-Hookean gel
        more["stiffening"] = float(np.log(rng.uniform(1.3, 6.0)) / (2 * stretch**2 + stretch**-4 - 3))
    if half == "real":
        more["accommodation"] = _log_normal(rng, 0.05, 0.35, 0.01, 1.0)
        more["damping"] = float(rng.uniform(0.0, 0.4))
    return Truth(half, law, G, mu, stretch, R_max, density, **more)


def numbers(truth: Truth) -> tuple[float, ...]:
    """C*, We, stretch, Fo, chi, A, B, p_v, kappa: the dimensionless numbers of docs/method/physics.md, section 1."""
    speed = float(np.sqrt(PRESSURE / truth.density))
    conductivity = CONDUCTIVITY[0] * TEMPERATURE + CONDUCTIVITY[1]
    A = CONDUCTIVITY[0] * TEMPERATURE / conductivity
    return (
        SOUND_SPEED / speed,
        PRESSURE * truth.R_max / (2 * SURFACE_TENSION),
        truth.stretch,
        DIFFUSIVITY / (speed * truth.R_max),
        TEMPERATURE * conductivity / (PRESSURE * truth.R_max * speed),
        A,
        1 - A,
        VAPOUR[0] * float(np.exp(-VAPOUR[1] / TEMPERATURE)) / PRESSURE,
        KAPPA,
    )


def parts(truth: Truth) -> tuple[field_standard.Part, field_standard.Part]:
    """The elastic and the viscous part of the material."""
    G, mu = truth.G / PRESSURE, truth.mu / (PRESSURE * truth.t_c)
    elastic = field_standard.neo_hookean(G) if G else field_standard.no_stress
    if truth.stiffening:
        elastic = field_standard.fung(G, truth.stiffening)
    viscous = field_standard.newtonian(mu)
    if truth.law == "power-law":
        viscous = field_standard.power_law(mu, truth.exponent, RATE * truth.t_c, PLATEAU * truth.t_c)
    return elastic, viscous


def solve(truth: Truth, end: float) -> PchipInterpolator:
    """R/R_max over t/t_c from 0 (R_max) to `end`.

    Raises RuntimeError where the solution fails.
    """
    y = np.tanh(STEEPNESS * np.linspace(0, 1, NODES)) / np.tanh(STEEPNESS)
    time: NDArray[np.float64] = np.linspace(0.0, end, int(end / STEP) + 2)
    rate = truth.accommodation * np.sqrt(R_VAPOUR * TEMPERATURE / (2 * np.pi)) / np.sqrt(PRESSURE / truth.density)
    radius = field_standard.solve(
        numbers(truth), y, time, TOLERANCE, *parts(truth), R_VAPOUR, R_GAS, rate=rate, damping=truth.damping
    )
    return PchipInterpolator(time, radius)
