"""Simulation: what one forward problem gave."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cavirheo.errors import InputError

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


def write_csv(run: Simulation, path: Path) -> None:
    """One row a frame. Raises InputError if the file cannot be written."""
    columns = {
        "time_us": run.time * 1e6,
        "radius_um": run.radius * 1e6,
        "velocity_m_per_s": run.velocity,
        "pressure_Pa": run.pressure,
        "stress_Pa": run.stress,
        "strain": run.strain,
        "strain_rate_per_s": run.strain_rate,
    }
    table = np.column_stack(list(columns.values()))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}") from error


def write_fields(run: Simulation, path: Path) -> None:
    """The contents as HDF5: time_s (n,), radius_m (n,), position (m,), temperature_K and vapour_mass_fraction (n, m).

    Raises:
        InputError: the simulation kept no contents, or the file cannot be written.
    """
    import h5py  # a quarter of a second that other uses need not wait for

    if run.contents is None:
        raise InputError("the simulation kept no fields: simulate with fields=True")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(path, "w") as file:
            file["time_s"], file["radius_m"] = run.time, run.radius
            file["position"] = run.contents.position
            file["temperature_K"], file["vapour_mass_fraction"] = run.contents.temperature, run.contents.vapour
    except OSError as error:
        raise InputError(f"cannot write {path}: {error}") from error
