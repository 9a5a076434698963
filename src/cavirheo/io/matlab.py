"""Read MATLAB files: BDT cells, IMR single shots, and other layouts of the field, recognised by their variables.

| variables | content |
|---|---|
| R_nondim_All, t_nondim_All, RmaxList m, lambda_max_mean | BDT: cells of R/R_max and t/(R_max sqrt(rho/p)) |
| Rnew, t | IMR: m and s; with deltax (m) and deltat (s): a circle fit in pixels, one row per frame |
| R, t | one shot, units inferred from the size (um and s in the published file) |
| Rmax um, shift_normRnew, t s | one shot per row of R/R_max over common frame times |
| pIMR_array | collapse times, no radius histories: refused with advice |

Versions 5 to 7 are read here and not by scipy.io, whose compiled reader (scipy 1.17) ends the whole process with a
segmentation fault on some damaged files. Format: MathWorks, "MAT-File Format", level 5: a header of 128 bytes, then
elements (type, length, data) on 8-byte boundaries. Type 15 is a compressed element (deflate). Type 14 is an array; it
consists of elements for its flags, dimensions, name and numbers.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Container, Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.curves import make_curve, unusable_curve
from cavirheo.io.files import Source
from cavirheo.messages import Message

_CELL_ARRAYS = ("R_nondim_All", "t_nondim_All")
_SINGLE_ARRAYS = "RmaxList lambda_max_mean lambda_max_std P_inf rho Rnew t deltax deltat R Rmax shift_normRnew"
VARIABLES = (*_CELL_ARRAYS, *_SINGLE_ARRAYS.split())
_LARGEST_RADIUS = 0.01  # m, largest radius of a bubble
_HEAD_SIZE = 1024  # bytes that contain the header of an array, which ends with its name
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _DEFLATED = 14, 15
_CELL, _NUMERIC = 1, range(6, 16)  # array classes
_COMPLEX = 0x800  # flag of a complex array
_NO_ELEMENT = (0, b"")  # no element
_DAMAGED, _CUT_OFF = "matfile.damaged", "matfile.cut"
Variables = dict[str, Any]  # name -> (…,) float64, or a list of a cell array's flattened cells (not numeric: empty)


def read_variables(source: Source, names: tuple[str, ...]) -> tuple[Variables, list[str]] | None:
    """Return (the wanted variables, the names of all) of a .mat file of version 5 to 7.3; None for any other file.

    Raises InputError: the file violates its format, or exceeds a limit.
    """
    if source.kind == "matlab73":
        from cavirheo.io import hdf5  # imports h5py, which takes a quarter of a second

        return hdf5.read_variables(source.path, names)
    return _read_version5(source.path, names) if source.kind == "matlab" else None


def curves(variables: Variables, names: list[str], density: float, pressure: float) -> list[RadiusCurve]:
    """Build the curves from the variables; `names`: of all variables in the file. Raises InputError: unknown layout."""
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
    per_radius = float(np.sqrt(density / pressure))  # s/m: seconds per metre of R_max and unit of t*

    def curve(k: int, radius: Floats, time: Floats) -> RadiusCurve:
        cell, max_radius = f"cell {k + 1} of {count}", float(max_radii[k]) if k < len(max_radii) else np.nan
        fields: dict[str, Any] = {"stated_time_of_max": 0.0}
        if radius.size == 0 or time.size == 0:
            return unusable_curve(f"{cell} is empty", meta, **fields)
        si: dict[str, Any] = {"time_unit": "s", "radius_unit": "m"} | fields
        if not len(max_radii):  # the user's R_max will scale both time and radius
            reason = "the file has no RmaxList, so radii and times are only known in units of R_max"
            unscaled = make_curve(time * per_radius, radius, meta=meta, time_unscaled=True, unscaled=reason, **si)
            return unscaled.labelled(notes=(*notes, reason))
        if not max_radius > 0:
            return unusable_curve(f"{cell} has samples but RmaxList gives R_max = {max_radius:.4g} m", meta, **fields)
        scale = f"R_max = {max_radius * 1e6:.4g} um, density {density:.6g} kg/m3, {pressure:.6g} Pa"
        with_notes = {**meta, "notes": (f"seconds from t* with {scale}", *notes)}
        scaled = make_curve(time * (max_radius * per_radius), radius * max_radius, meta=with_notes, **si)
        return scaled.labelled(warnings=(*scaled.warnings, *_density_warning(scaled.frame_rate, density)))

    return [curve(k, *arrays) for k, arrays in enumerate(zip(radii, times, strict=True))]


def _density_warning(rate: float | None, density: float) -> list[Message]:
    """Return a warning if the density seems wrong: the rate is slightly off a round one, at which cameras run."""
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
    unit = "m" if np.nanmax(radius, initial=0.0) < _LARGEST_RADIUS else None  # some files have um
    return _rows(time, radius, time_unit="s", radius_unit=unit, meta={"notes": hints + notes, "hints": hints})


def _shifted(variables: Variables) -> list[RadiusCurve]:
    """Read rows of R/R_max over the frame times t; shift_normTnew = t/(R_max sqrt(rho/p)), rho = 1060, is not used."""
    normal, largest = variables["shift_normRnew"], variables["Rmax"].ravel()
    fits = normal.ndim == 2 and len(normal) == len(largest)
    require(fits, f"Rmax has {len(largest)} values but shift_normRnew the shape {normal.shape}")
    note = "R/R_max times Rmax of the shot; the frame times t are used, not the normalised shift_normTnew"
    return _rows(variables["t"], normal * largest[:, None], time_unit="s", meta={"notes": (note,)})


def _rows(time: Floats, radius: Floats, **options: Any) -> list[RadiusCurve]:
    """Return one curve, or one per row (column) of a matrix whose rows (columns) are as long as the time."""
    if radius.ndim != 2 or min(radius.shape) <= 1:
        radius = radius.reshape(1, -1)
    elif radius.shape[1] != time.size:
        radius = radius.T
    return [make_curve(time, shot, **options) for shot in radius]


def _read_version5(path: Path, names_wanted: Container[str]) -> tuple[Variables, list[str]]:
    """Do what `read_variables` does, for versions 5 to 7."""
    limits.check(path.stat().st_size, limits.INFLATED, "bytes")
    content = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")
    require(order != "", "not a MATLAB file of version 5 to 7: its header of 128 bytes is damaged", _DAMAGED)
    left = limits.INFLATED
    variables: Variables = {}
    names: list[str] = []
    for kind, data in _elements(content[128:], order):
        if kind not in (_MATRIX, _DEFLATED) or not data:
            continue
        inflate = zlib.decompressobj()
        head = inflate.decompress(data, _HEAD_SIZE) if kind == _DEFLATED else data
        name = _header(head[8:] if kind == _DEFLATED else head, order)[2]
        names += [name] if name else []
        if name not in names_wanted:
            continue
        if kind == _DEFLATED:
            data = head + inflate.decompress(inflate.unconsumed_tail, max(left, 1))  # 0 would mean no limit
            left -= len(data)
            most = f"{name} unpacks to more than {limits.INFLATED} bytes in all"
            require(left >= 0 and not inflate.unconsumed_tail, most, "limits.unpacked")
            require(inflate.eof, f"{name} is cut off", _CUT_OFF)
            kind, data = next(_elements(data, order), _NO_ELEMENT)
        if kind == _MATRIX and (value := _value(data, order, name)) is not None:
            variables[name] = value
    return variables, names


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield (type, data) of each element."""
    at = 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # small element: type and length share the first four bytes, the data fill the other four
            kind, length, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            require(length <= 4, f"damaged at byte {at}: a small element of {length} bytes", _DAMAGED)
        else:
            start = at + 8
            after = start + length + (0 if kind == _DEFLATED else -length % 8)
        left = len(data) - start
        require(length <= left, f"cut off: an element of {length} bytes begins where {left} are left", _CUT_OFF)
        yield kind, data[start : start + length]
        at = after


def _header(data: bytes, order: str) -> tuple[int, tuple[int, ...], str, Iterator[tuple[int, bytes]]]:
    """Return (class, shape, name, the elements that follow) of an array; class 0 stands for complex numbers."""
    parts = _elements(data, order)
    flags, shape, name = (next(parts, _NO_ELEMENT)[1] for _ in range(3))
    require(len(flags) >= 4 and len(shape) % 4 == 0, "an array without flags or dimensions", _DAMAGED)
    bits = struct.unpack_from(order + "I", flags)[0]
    array_class = 0 if bits & _COMPLEX else bits & 0xFF
    return array_class, struct.unpack(f"{order}{len(shape) // 4}i", shape), name.decode("latin-1"), parts


def _value(data: bytes, order: str, name: str = "") -> Any:
    """Return the numbers of an array, or for a named cell array a list of those of its cells; None for other arrays."""
    if not data:
        return np.empty(0)  # an empty cell has no data
    array_class, shape, _, parts = _header(data, order)
    if array_class == _CELL and name:
        arrays: list[Any] = []
        for kind, part in parts:
            if kind == _MATRIX:
                value = _value(part, order)
                arrays.append(np.empty(0) if value is None else value.ravel(order="F"))
                limits.check(len(arrays), limits.CURVES, f"cells of {name}")
        return arrays
    if array_class not in _NUMERIC:
        return None
    kind, numbers = next(parts, (9, b""))
    label = name or "a cell"
    require(kind in _NUMBER_TYPES, f"{label}: numbers of the unknown type {kind}", _DAMAGED)
    item = np.dtype(order + _NUMBER_TYPES[kind])
    count = len(numbers) // item.itemsize
    limits.check(count, limits.SAMPLES, f"numbers in {label}")
    fits = min(shape, default=0) >= 0 and prod(shape) == count
    require(fits, f"{label}: {count} numbers for an array of the shape {shape}", _DAMAGED)
    return np.frombuffer(numbers, item, count).astype(np.float64).reshape(shape, order="F")
