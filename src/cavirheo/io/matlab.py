"""MATLAB files: BDT cells, IMR single shots, and the other layouts of the field, told apart by their variables.

| variables | what |
|---|---|
| R_nondim_All, t_nondim_All, RmaxList m, lambda_max_mean | BDT: cells of R/R_max and t/(R_max sqrt(rho/p)) |
| Rnew, t | IMR: m and s; with deltax (m) and deltat (s): a circle fit in pixels, one row per frame |
| R, t | one shot, units told from the size (um and s in the published file) |
| Rmax um, shift_normRnew, t s | one shot per row of R/R_max over common frame times |
| pIMR_array | collapse times: no radius histories, refused by name |
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.matfile import read_matfile
from cavirheo.io.samples import make_curve, unusable
from cavirheo.messages import Message

_CELL_ARRAYS = ("R_nondim_All", "t_nondim_All")
_ONE_EACH = "RmaxList lambda_max_mean lambda_max_std P_inf rho Rnew t deltax deltat R Rmax shift_normRnew"
VARIABLES = (*_CELL_ARRAYS, *_ONE_EACH.split())

HDF5 = b"\x89HDF\r\n\x1a\n"
_LARGEST = 0.01  # m, of a bubble
_REAL = "fiub"  # kinds of numpy's types
Variables = dict[str, Any]  # name -> (…,) float array, or a list of them for a cell array


def read_variables(path: Path, names: tuple[str, ...]) -> tuple[Variables, list[str]] | None:
    """(the wanted variables, names of all) of a .mat of any version; None where the file is none. Raises InputError."""
    with path.open("rb") as file:
        head = file.read(128)
    if head.startswith(b"MATLAB 7.3") or (path.suffix.lower() == ".mat" and head.startswith(HDF5)):
        return read_hdf5(path, names)
    five = head.startswith(b"MATLAB 5.0") or head[124:128] in (b"\x00\x01IM", b"\x01\x00MI")
    return read_matfile(path, names) if five else None


def read_hdf5(path: Path, names: Iterable[str]) -> tuple[Variables, list[str]]:
    """As `read_matfile`, of version 7.3: arrays are stored transposed, cells as references to them."""
    import h5py

    variables: Variables = {}
    with h5py.File(path, "r") as file:
        all_names = [limits.as_text(name) for name in file if name not in ("#refs#", "#subsystem#")]
        for name in names:
            item = limits.local_item(file, name)
            if not isinstance(item, h5py.Dataset):
                continue
            limits.arrays([item])
            if name in _CELL_ARRAYS and h5py.check_ref_dtype(item.dtype) is not None:
                limits.few(item.size, limits.CURVES, "curves")
                items = [file[reference] if reference else None for reference in np.ravel(item[()])]
                arrays = all(isinstance(cell, h5py.Dataset) for cell in items)
                require(arrays, f"a cell of {name} refers to no array", "matlab.cells")
                limits.arrays(items)
                variables[name] = [_plain(cell).ravel(order="F") for cell in items]
            elif item.dtype.kind in _REAL:
                variables[name] = _plain(item)
    return variables, all_names


def _plain(item: Any) -> Floats:
    """The numbers of a dataset; none where MATLAB wrote an empty array, or anything but real numbers."""
    empty = np.asarray(item.attrs.get("MATLAB_empty", 0))
    no_numbers = item.dtype.kind not in _REAL or (empty.dtype.kind in _REAL and empty.any())
    return np.empty(0) if no_numbers else np.asarray(item[()], dtype=np.float64).T


def curves(variables: Variables, names: list[str], density: float, pressure: float) -> list[RadiusCurve]:
    """The curves that the variables make; `names` of all that are in the file. Raises InputError: they make none."""
    cell_arrays = [name for name, value in variables.items() if isinstance(value, list) and name not in _CELL_ARRAYS]
    message = f"{', '.join(cell_arrays)}: a cell array; expected an array of numbers, as cell2mat makes it"
    require(not cell_arrays, message, "matlab.cells")
    if variables.keys() >= {*_CELL_ARRAYS}:
        return _bdt(variables, density, pressure)
    if variables.keys() >= {"shift_normRnew", "Rmax", "t"}:
        return _shifted(variables)
    if "Rnew" in variables and variables.keys() & {"t", "deltat"}:
        return _imr(variables)
    if variables.keys() >= {"R", "t"}:
        return _rows(variables["t"], variables["R"])
    if "pIMR_array" in names:
        message = "a table of collapse times (pIMR_array: R_max, stretch, t_1), not radius histories R(t): there is no "
        message += "curve in it to infer from; use cavirheo collapse-time"
        raise InputError(message, "matlab.collapse_times")
    expected = "expected R_nondim_All, t_nondim_All and RmaxList (BDT), or Rnew and t (IMR)"
    message = f"no radius history; variables found: {', '.join(names) or 'none'}; {expected}"
    raise InputError(message, "matlab.variables")


def _scalar(variables: Variables, name: str) -> float | None:
    value = variables.get(name)
    return float(value.ravel()[0]) if value is not None and value.size == 1 and np.isfinite(value).all() else None


def _bdt(variables: Variables, density: float, pressure: float) -> list[RadiusCurve]:
    radii, times = ([v] if isinstance(v, np.ndarray) else v for v in (variables[name] for name in _CELL_ARRAYS))
    count = len(radii)
    require(count == len(times), f"R_nondim_All has {count} cells but t_nondim_All {len(times)}")
    require(count > 0, "R_nondim_All has no cells: no curve", "matlab.cells")
    notes, hints, constants = list[str](), list[str](), {"pressure": pressure, "density": density}
    for word, name, unit in (("pressure", "P_inf", "Pa"), ("density", "rho", "kg/m3")):
        value, of_medium = _scalar(variables, name), constants[word]
        if value is not None and value > 0:
            notes.append(f"{name} = {value:.6g} {unit} taken from the file")
            constants[word] = value
            hint = f"the file states a {word} of {value:.6g} {unit}, with which its times are made seconds, and "
            hint += f"the medium has {of_medium:.6g}: --{word} {value:.6g} simulates with it, too"
            hints += [hint] if abs(value / of_medium - 1.0) > 1e-3 else []
    pressure, density = constants.values()
    notes += hints
    meta: dict[str, Any] = {"hints": tuple(hints)} if hints else {}
    stretch, spread = (_scalar(variables, name) for name in ("lambda_max_mean", "lambda_max_std"))
    if stretch is not None:
        meta |= {"stretch": stretch, "stretch_std": spread}
        notes.append(f"the file states one stretch for all shots: {stretch:.4g} +- {spread or float('nan'):.2g}")
    max_radii = variables.get("RmaxList", np.empty(0)).ravel()
    per_radius = float(np.sqrt(density / pressure))  # s per m of R_max and unit of t*

    def curve(k: int, radius: Floats, time: Floats) -> RadiusCurve:
        cell, max_radius = f"cell {k + 1} of {count}", float(max_radii[k]) if k < len(max_radii) else np.nan
        if radius.size == 0 or time.size == 0:
            return unusable(f"{cell} is empty", meta, stated_time_of_max=0.0)
        if not len(max_radii):  # time and radius both wait for the user's R_max
            reason = "the file has no RmaxList, so radii and times are only known in units of R_max"
            fields: dict[str, Any] = {"stated_time_of_max": 0.0, "time_unscaled": True, "unscaled": reason}
            unscaled = make_curve(time * per_radius, radius, time_unit="s", radius_unit="m", meta=meta, **fields)
            return unscaled.labelled(notes=(*notes, reason))
        if not max_radius > 0:
            reason = f"{cell} has samples but RmaxList gives R_max = {max_radius:.4g} m"
            return unusable(reason, meta, stated_time_of_max=0.0)
        scale = f"R_max = {max_radius * 1e6:.4g} um, density {density:.6g} kg/m3, {pressure:.6g} Pa"
        with_notes = {**meta, "notes": (f"seconds from t* with {scale}", *notes)}
        seconds, metres = time * (max_radius * per_radius), radius * max_radius
        scaled = make_curve(seconds, metres, time_unit="s", radius_unit="m", meta=with_notes, stated_time_of_max=0.0)
        return scaled.labelled(warnings=(*scaled.warnings, *_density_warning(scaled.frame_rate, density)))

    return [curve(k, *arrays) for k, arrays in enumerate(zip(radii, times, strict=True))]


def _density_warning(rate: float | None, density: float) -> list[Message]:
    """Cameras run at round rates: a rate just off one tells the density with which the file was made dimensionless."""
    if rate is None:
        return []
    rounds = np.array([1.0, 2.0, 5.0])[:, None] * 10.0 ** np.arange(4, 8)
    nearest = float(rounds.flat[np.argmin(np.abs(np.log(rounds / rate)))])
    if not 5e-3 < abs(rate / nearest - 1.0) < 0.035:
        return []
    meant = density * (rate / nearest) ** 2
    return [Message("check_input.density", {"density": density, "rate": rate, "usual": nearest, "meant": meant})]


def _imr(variables: Variables) -> list[RadiusCurve]:
    radius, time, hints, notes = variables["Rnew"], variables.get("t"), list[str](), list[str]()
    pixel, frame = _scalar(variables, "deltax"), _scalar(variables, "deltat")
    if pixel is not None and np.nanmax(radius, initial=0.0) > 1.0:
        hints.append(f"circle fit in pixels: scaled by deltax = {pixel * 1e6:.5g} um")
        radius = radius * pixel
    if time is None:
        if frame is None:
            raise InputError("Rnew without t or a usable deltat")
        notes.append(f"frame times from deltat = {frame * 1e6:.6g} us")
        time = frame * np.arange(radius.size)
    unit = "m" if np.nanmax(radius, initial=0.0) < _LARGEST else None  # some files have um
    return _rows(time, radius, time_unit="s", radius_unit=unit, meta={"notes": hints + notes, "hints": hints})


def _shifted(variables: Variables) -> list[RadiusCurve]:
    """Rows of R/R_max over the frame times t; shift_normTnew is t over R_max sqrt(rho/p) with rho = 1060: not used."""
    normal, largest = variables["shift_normRnew"], variables["Rmax"].ravel()
    fits = normal.ndim == 2 and len(normal) == len(largest)
    require(fits, f"Rmax has {len(largest)} values but shift_normRnew the shape {normal.shape}")
    note = "R/R_max times Rmax of the shot; the frame times t are used, not the normalised shift_normTnew"
    return _rows(variables["t"], normal * largest[:, None], time_unit="s", meta={"notes": (note,)})


def _rows(time: Floats, radius: Floats, **options: Any) -> list[RadiusCurve]:
    """One curve, or one per row (column) of a matrix whose rows (columns) are as long as the time; `options` of
    `make_curve`."""
    if radius.ndim != 2 or min(radius.shape) <= 1:
        radius = radius.reshape(1, -1)
    elif radius.shape[1] != time.size:
        radius = radius.T
    return [make_curve(time, shot, **options) for shot in radius]
