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
from cavirheo.reading import limits
from cavirheo.reading.clean import make_curve
from cavirheo.reading.table import column


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    import h5py

    shots: list[tuple[Any, dict[str, Any], dict[str, str | None]]] = []
    found: list[str] = []
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            found.append(name)
            limits.few(len(found), limits.SAMPLES // 100, "groups and datasets")
            if isinstance(item, h5py.Group):
                shots.extend(_shot_of(item, h5py.Dataset))

        shots.extend(_shot_of(file, h5py.Dataset))
        file.visititems(visit)
        limits.few(len(shots), limits.CURVES, "curves")
        limits.arrays(array for _, arrays, _ in shots for array in arrays.values())
        curves = [_curve(*shot) for shot in shots]
    if not curves:
        raise InputError(
            f"no group holds a time and a radius dataset; found: {', '.join(found[:20]) or 'nothing'}; expected "
            "datasets time and radius (s, m), or time_us and radius_um, in the root or one group per curve"
        )
    return curves


def _shot_of(group: Any, dataset: Any) -> list[tuple[Any, dict[str, Any], dict[str, str | None]]]:
    """[(group, its arrays, their units)], not yet read; [] if it holds no time or no radius."""
    arrays: dict[str, Any] = {}
    units: dict[str, str | None] = {}
    for name in group:
        kind, unit = column(name)
        if kind not in ("time", "radius", "radius_std"):
            continue
        item = limits.own(group, name)
        if isinstance(item, dataset) and item.dtype.kind in "fiu":
            arrays[kind], units[kind] = item, unit
    return [(group, arrays, units)] if "time" in arrays and "radius" in arrays else []


def _curve(group: Any, arrays: dict[str, Any], units: dict[str, str | None]) -> RadiusCurve:
    values = {kind: np.asarray(item[()]) for kind, item in arrays.items()}
    meta: dict[str, Any] = {"label": group.name.strip("/")} if group.name != "/" else {}
    if "stretch" in group.attrs:
        meta["stretch"] = float(group.attrs["stretch"])
    return make_curve(
        values["time"],
        values["radius"],
        radius_std=values.get("radius_std"),
        time_unit=units["time"] or "s",
        radius_unit=units["radius"] or "m",
        **meta,
    )
