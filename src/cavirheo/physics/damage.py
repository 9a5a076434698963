"""Damage: what a violent collapse leaves of an elastic material, as tables for the solver."""

from __future__ import annotations

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.physics.bubble import Damage
from cavirheo.physics.table import hermite, read, scaled


def damaged(elastic: Floats, damage: Damage, stretch: float) -> tuple[Floats, Floats, Floats]:
    """From the table of a law (physics/table.py): that of the law at radii above the smallest so far, that below
    it, and (3,) both factors of a tenfold contraction and the smallest R/R(0) so far.

    At the first rebound: damaged and whole; the smallest radius counts as infinite until then. By strain: whole,
    to be scaled as the wall turns; and the law while the wall is at its smallest radius, x = L/stretch,

        S = x^a S_el(u),  u = L x^b,  a = -log10 modulus,  b = log10 radius.
    """
    if damage.by != "strain":
        return scaled(elastic, damage.radius, damage.modulus), elastic, np.array([1.0, 1.0, np.inf])
    a, b = -np.log10(damage.modulus), np.log10(damage.radius)
    u = elastic[:, 0]
    u = np.append(u[u < stretch], stretch)
    L = (u * stretch**b) ** (1 / (1 + b))
    S, S1, S2 = read(elastic, u)
    share, c = (L / stretch) ** a, (1 + b) * u
    first = a * S + c * S1  # over share, by ln L
    second = a * first + c * ((a + 1 + b) * S1 + c * S2)
    falling = hermite(L, share * S, share * first / L, share * (second - first) / L**2)
    return elastic, falling, np.array([damage.modulus, damage.radius, 1.0])
