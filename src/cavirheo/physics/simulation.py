"""Simulation: what one forward problem gave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.landmarks import turning_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Contents:
    """Fields in the bubble, from its centre to its wall.

    Attributes:
        position: (m,) r/R of the centroids of the shells and of the wall, ascending to 1.
        temperature: (n, m) K.
        vapour: (n, m) mass fraction of vapour.
    """

    position: Floats
    temperature: Floats
    vapour: Floats

    def __repr__(self) -> str:
        frames, places = self.temperature.shape
        return f"Contents({frames} frames, {places} places, at most {np.nanmax(self.temperature):.4g} K)"


@dataclass(frozen=True, eq=False)
class Simulation:
    """One solved (or failed) forward problem. Where a solve failed the arrays hold NaN from there on.

    Attributes:
        time: (n,) s after the start.
        radius: (n,) m.
        velocity: (n,) m/s, of the wall.
        pressure: (n,) Pa, in the bubble.
        stress: (n,) Pa, stress integral of the material: positive where it pushes the wall outwards.
        equilibrium_radius: R_0, m.
        status: "ok", or what went wrong and where.
        stats: steps, rejected, gas_drift (relative change of the gas in the bubble).
        contents: fields in the bubble, if they were asked for.
    """

    time: Floats
    radius: Floats
    velocity: Floats
    pressure: Floats
    stress: Floats
    equilibrium_radius: float
    status: str
    stats: dict[str, float]
    contents: Contents | None = None

    def __repr__(self) -> str:
        solved = np.isfinite(self.radius)
        frames = f"{len(self.time)} frames" if solved.all() else f"{solved.sum()} of {len(self.time)} frames"
        words = [self.status if self.ok else f"failed: {self.status}", frames]
        if solved.any():
            words += [
                f"{1e6 * self.time[0]:.4g} to {1e6 * self.time[solved][-1]:.4g} us",
                f"R {1e6 * np.nanmin(self.radius):.4g} to {1e6 * np.nanmax(self.radius):.4g} um",
                f"R_0 {1e6 * self.equilibrium_radius:.4g} um",
                f"collapses: {self.collapses}",
            ]
        return f"Simulation({', '.join(words)})"

    @property
    def ok(self) -> bool:
        """Whether it reached the last time."""
        return self.status == "ok"

    @property
    def strain(self) -> Floats:
        """(n,) logarithmic hoop strain at the wall, ln(R/R_0); the radial strain is -2 times as large."""
        return np.log(self.radius / self.equilibrium_radius)

    @property
    def strain_rate(self) -> Floats:
        """(n,) its rate U/R, 1/s; the radial rate is -2 times as large, the shear rate 2 sqrt(3)."""
        return self.velocity / self.radius

    @property
    def collapses(self) -> int:
        """Minima of R after which it rises again by more than 3 % of the largest R, as those of a measured curve."""
        radius = self.radius[np.isfinite(self.radius)]
        return len(turning_points(radius, 0.03 * radius.max(initial=0.0))[0])

    @property
    def columns(self) -> dict[str, Floats]:
        """(n,) each, named as in the CSV of `cavirheo simulate`: "time_us", "radius_um", "velocity_m_per_s", ..."""
        wall = {"time_us": self.time * 1e6, "radius_um": self.radius * 1e6, "velocity_m_per_s": self.velocity}
        forces = {"pressure_Pa": self.pressure, "stress_Pa": self.stress}
        return wall | forces | {"strain": self.strain, "strain_rate_per_s": self.strain_rate}

    def to_dataframe(self) -> Any:
        """`columns` as a pandas.DataFrame. Raises InputError without pandas."""
        from cavirheo.writing.export import dataframe

        return dataframe(self.columns, {"status": self.status, "equilibrium_radius_m": self.equilibrium_radius})

    def plot(self, axes: Axes | None = None) -> Axes:
        """R(t), um over us, on these axes or on those of a new figure. Raises InputError without matplotlib."""
        from cavirheo.writing.style import BLUE, new_axes, new_figure

        if axes is None:
            axes = new_axes(new_figure(3.5), (0.085, 0.14, 0.89, 0.8), "time after the start (µs)", "radius (µm)")
        axes.plot(1e6 * self.time, 1e6 * self.radius, color=BLUE, lw=1.5)
        return axes
