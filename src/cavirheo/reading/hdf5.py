"""HDF5: groups that hold a time and a radius.

A file has one curve per group (at any depth, the root included) that holds two one-dimensional datasets of equal
length named like CSV columns: `time_us` and `radius_um`, or `time` (s) and `radius` (m); optional `radius_std_um` or
`radius_std`. Optional attribute of a group: `stretch` (R_max/R_0).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading.clean import make_curve
from cavirheo.reading.table import column

_MOST_SAMPLES = 20_000_000  # of one array; a damaged file may declare any shape


def checked(name: str, shape: tuple[int, ...]) -> None:
    """Raises InputError where an array is declared larger than any recording: it is not read then."""
    size = 1
    for length in shape:
        size *= int(length)
    if size > _MOST_SAMPLES:
        raise InputError(f"{name} declares the shape {shape}: more than {_MOST_SAMPLES} samples are not read")


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    import h5py

    curves: list[RadiusCurve] = []
    found: list[str] = []
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            found.append(name)
            if isinstance(item, h5py.Group):
                curves.extend(_curve_of(item, h5py.Dataset))

        curves.extend(_curve_of(file, h5py.Dataset))
        file.visititems(visit)
    if not curves:
        raise InputError(
            f"no group holds a time and a radius dataset; found: {', '.join(found[:20]) or 'nothing'}; expected "
            "datasets time and radius (s, m), or time_us and radius_um, in the root or one group per curve"
        )
    return curves


def _curve_of(group: Any, dataset: Any) -> list[RadiusCurve]:
    arrays: dict[str, Any] = {}
    units: dict[str, str | None] = {}
    for name, item in group.items():
        kind, unit = column(name)
        if kind in ("time", "radius", "radius_std") and isinstance(item, dataset) and item.dtype.kind in "fiu":
            arrays[kind], units[kind] = item, unit
    if "time" not in arrays or "radius" not in arrays:
        return []
    for item in arrays.values():
        checked(item.name, item.shape)
    values = {kind: np.asarray(item[()]) for kind, item in arrays.items()}
    meta: dict[str, Any] = {"label": group.name.strip("/")} if group.name != "/" else {}
    if "stretch" in group.attrs:
        meta["stretch"] = float(group.attrs["stretch"])
    return [
        make_curve(
            values["time"],
            values["radius"],
            radius_std=values.get("radius_std"),
            time_unit=units["time"] or "s",
            radius_unit=units["radius"] or "m",
            **meta,
        )
    ]
