"""Read HDF5: curves in groups, and the variables of MATLAB 7.3; declared sizes are checked before data are read.

A group (at any depth, the root included) is one curve if it holds a dataset of times and one of radii, both with one
dimension and of equal length. They are named like CSV columns: `time_us` and `radius_um`, or `time` (s) and `radius`
(m). Optional are a dataset `radius_std_um` or `radius_std`, and the attribute `stretch` (R_max/R_0) of the group.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import require
from cavirheo.io import limits
from cavirheo.io.curves import CURVES, check_units, make_curve

_REAL = "fiub"  # numpy's dtype kinds of real numbers
_EXPECTED = "datasets time and radius (s, m), or time_us and radius_um, in the root or one group per curve"


def read(path: Path) -> list[RadiusCurve]:
    """Read the curves of a file. Raises InputError: the file has no curve, or exceeds a limit."""
    with h5py.File(path, "r") as file:
        groups, names_found = [file], []

        def visit(name: str | bytes, item: Any) -> None:
            names_found.append(as_text(name))
            limits.check(len(names_found), limits.SAMPLES // 100, "groups and datasets")
            if isinstance(item, h5py.Group):
                groups.append(item)

        file.visititems(visit)
        shots = [(group, arrays) for group in groups if {"time", "radius"} <= (arrays := _arrays(group)).keys()]
        limits.check(len(shots), limits.CURVES, "curves")
        check_sizes(item for _, arrays in shots for item, _ in arrays.values())
        names = ", ".join(names_found[:20]) or "nothing"
        none = f"no group holds a time and a radius dataset; found: {names}; expected {_EXPECTED}"
        require(len(shots) > 0, none, "hdf5.datasets")
        return [_curve(*shot) for shot in shots]


def _arrays(group: Any) -> dict[str, tuple[Any, str | None]]:
    """Return for each kind of column its dataset, not read yet, and its unit. Raises InputError: two of one kind."""
    arrays = {}
    for name in group:
        kind, unit, _ = CURVES.name_by_words(as_text(name))
        if kind in ("time", "radius", "radius_std"):
            item = local_item(group, name)
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
                both = f"{as_text(group.name)} has two datasets for {kind}"
                twice = f"{both}: {as_text(name)} is one; keep the one that counts"
                require(kind not in arrays, twice, "hdf5.twice")
                arrays[kind] = item, unit or {"time": "s", "radius": "m"}.get(kind)
    return arrays


def _curve(group: Any, arrays: dict[str, tuple[Any, str | None]]) -> RadiusCurve:
    path = as_text(group.name)
    meta: dict[str, Any] = {"label": path.strip("/")} if path != "/" else {}
    if "stretch" in group.attrs:
        stretch = np.asarray(group.attrs["stretch"])
        number = stretch.size == 1 and stretch.dtype.kind in "fiu"
        require(number, f"the attribute stretch of {path} is no number: {stretch}"[:200], "hdf5.stretch")
        meta["stretch"] = float(stretch.item())
    samples: dict[str, Any] = {kind: np.asarray(item[()]) for kind, (item, _) in arrays.items()}
    time_unit, radius_unit, std_unit = (arrays.get(kind, (None, None))[1] for kind in ("time", "radius", "radius_std"))
    check_units(f"the group {path}", time_unit, radius_unit, std_unit)
    return make_curve(**samples, time_unit=time_unit, radius_unit=radius_unit, meta=meta)


def read_variables(path: Path, names: Iterable[str]) -> tuple[dict[str, Any], list[str]]:
    """Do what `matlab.read_variables` does, for version 7.3, which stores arrays transposed and cells as references."""
    variables: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        all_names = [as_text(name) for name in file if name not in ("#refs#", "#subsystem#")]
        for name in names:
            item = local_item(file, name)
            if not isinstance(item, h5py.Dataset):
                continue
            check_sizes([item])
            if h5py.check_ref_dtype(item.dtype) is not None:
                limits.check(item.size, limits.CURVES, "curves")
                items = [file[reference] if reference else None for reference in np.ravel(item[()])]
                arrays = all(isinstance(cell, h5py.Dataset) for cell in items)
                require(arrays, f"a cell of {name} refers to no array", "matlab.cells")
                check_sizes(items)
                variables[name] = [_real_numbers(cell).ravel(order="F") for cell in items]
            elif item.dtype.kind in _REAL:
                variables[name] = _real_numbers(item)
    return variables, all_names


def _real_numbers(item: Any) -> Floats:
    """Return the numbers of a dataset; none if it is an empty array of MATLAB, or holds anything but real numbers."""
    empty = np.asarray(item.attrs.get("MATLAB_empty", 0))
    no_numbers = item.dtype.kind not in _REAL or (empty.dtype.kind in _REAL and empty.any())
    return np.empty(0) if no_numbers else np.asarray(item[()], dtype=np.float64).T


def check_sizes(items: Iterable[Any]) -> None:
    """Check datasets before they are read. Raises InputError: they declare more samples in all, or in a chunk, than the
    limit allows; or they have no shape, or take their numbers from other files."""
    total = 0
    for item in items:
        name = as_text(item.name)
        require(item.shape is not None, f"{name} has no shape: it holds nothing", "limits.no_shape")
        elsewhere = f"{name} takes its numbers from another file; copy them into this one"
        require(not (item.external or item.is_virtual), elsewhere, "limits.elsewhere")
        total += prod(item.shape)
        for attribute, size in (("chunks", prod(item.chunks or (0,))), ("shape", total)):
            declared = f"{name} declares the {attribute} {getattr(item, attribute)}"
            many = f"{declared}: more than {limits.SAMPLES} samples are not read"
            require(size <= limits.SAMPLES, many, f"limits.{attribute}")


def as_text(name: str | bytes) -> str:
    """Return a group's or dataset's name as text; names that are not UTF-8, which h5py gives as bytes, are Latin-1."""
    return name.decode("latin-1") if isinstance(name, bytes) else name


def local_item(group: Any, name: str | bytes) -> Any:
    """Return group[name], or None if it does not exist. Raises InputError: it is a link to another file."""
    links, key = group.id.links, name if isinstance(name, bytes) else name.encode()  # get(getlink=True) needs UTF-8
    link = links.exists(key) and links.get_info(key).type == h5py.h5l.TYPE_EXTERNAL
    require(not link, f"{as_text(name)} is a link to another file; copy them into this one", "limits.elsewhere")
    return group.get(name)
