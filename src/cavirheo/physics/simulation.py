"""Simulation: what one forward problem gave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Contents:
    """Fields in the bubble, from its centre to its wall."""

    position: Floats  # (m,) r/R of the centroids of the shells and of the wall, ascending to 1
    temperature: Floats  # (n, m) K
    vapour: Floats  # (n, m) mass fraction of vapour


@dataclass(frozen=True, eq=False)
class Simulation:
    """One solved (or failed) forward problem. Where a solve failed the arrays hold NaN from there on."""

    time: Floats  # (n,) s after the start
    radius: Floats  # (n,) m
    velocity: Floats  # (n,) m/s, of the wall
    pressure: Floats  # (n,) Pa, in the bubble
    stress: Floats  # (n,) Pa, stress integral of the material: positive where it pushes the wall outwards
    equilibrium_radius: float  # R_0, m
    status: str  # "ok", or what went wrong and where
    stats: dict[str, float]  # steps, rejected, gas_drift (relative change of the gas in the bubble)
    contents: Contents | None = None  # if asked for

    @property
    def ok(self) -> bool:
        return self.status == "ok"

    @property
    def strain(self) -> Floats:
        """(n,) logarithmic hoop strain at the wall, ln(R/R_0); the radial strain is -2 times as large."""
        return np.log(self.radius / self.equilibrium_radius)

    @property
    def strain_rate(self) -> Floats:
        """(n,) its rate U/R, 1/s; the radial rate is -2 times as large, the shear rate 2 sqrt(3)."""
        return self.velocity / self.radius
