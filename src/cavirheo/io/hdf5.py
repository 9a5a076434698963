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
from cavirheo.errors import require
from cavirheo.io import limits
from cavirheo.io.curve_tables import CURVES
from cavirheo.io.samples import check_units, make_curve

_EXPECTED = "datasets time and radius (s, m), or time_us and radius_um, in the root or one group per curve"


def read(path: Path) -> list[RadiusCurve]:
    import h5py

    with h5py.File(path, "r") as file:
        groups, names_found = [file], []

        def visit(name: str | bytes, item: Any) -> None:
            names_found.append(limits.as_text(name))
            limits.few(len(names_found), limits.SAMPLES // 100, "groups and datasets")
            if isinstance(item, h5py.Group):
                groups.append(item)

        file.visititems(visit)
        shots = [(group, arrays) for group in groups if {"time", "radius"} <= (arrays := _arrays(group)).keys()]
        limits.few(len(shots), limits.CURVES, "curves")
        limits.arrays(item for _, arrays in shots for item, _ in arrays.values())
        names = ", ".join(names_found[:20]) or "nothing"
        none = f"no group holds a time and a radius dataset; found: {names}; expected {_EXPECTED}"
        require(len(shots) > 0, none, "hdf5.datasets")
        return [_curve(*shot) for shot in shots]


def _arrays(group: Any) -> dict[str, tuple[Any, str | None]]:
    """By kind of column: the dataset named so, not yet read, and its unit."""
    import h5py

    arrays = {}
    for name in group:
        kind, unit, _ = CURVES.name_by_words(limits.as_text(name))
        if kind in ("time", "radius", "radius_std"):
            item = limits.local_item(group, name)
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
                both = f"{limits.as_text(group.name)} has two datasets for {kind}"
                twice = f"{both}: {limits.as_text(name)} is one; keep the one that counts"
                require(kind not in arrays, twice, "hdf5.twice")
                arrays[kind] = item, unit
    return arrays


def _curve(group: Any, arrays: dict[str, tuple[Any, str | None]]) -> RadiusCurve:
    path = limits.as_text(group.name)
    meta: dict[str, Any] = {"label": path.strip("/")} if path != "/" else {}
    if "stretch" in group.attrs:
        stretch = np.asarray(group.attrs["stretch"])
        number = stretch.size == 1 and stretch.dtype.kind in "fiu"
        require(number, f"the attribute stretch of {path} is no number: {stretch}"[:200], "hdf5.stretch")
        meta["stretch"] = float(stretch.item())
    samples: dict[str, Any] = {kind: np.asarray(item[()]) for kind, (item, _) in arrays.items()}
    units = {"time": "s", "radius": "m"} | {kind: unit for kind, (_, unit) in arrays.items() if unit}
    check_units(f"the group {path}", units["time"], units["radius"], units.get("radius_std"))
    return make_curve(**samples, time_unit=units["time"], radius_unit=units["radius"], meta=meta)
