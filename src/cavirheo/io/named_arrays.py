"""Recognise radius histories among named arrays: the variables of a .mat file, the datasets of an HDF5 file, or the
fields of an array of numpy.

Names and layouts: docs/how-to/your-shots.md. Besides, BDT's cells (R_nondim_All, t_nondim_All, RmaxList m) hold R/R_max
and t/(R_max sqrt(rho/p)); shift_normRnew, Rmax (um) and t (s) R/R_max over common frame times, one shot per row.

A folder may be a shot: a group, a struct, the arrays of one number (R2, t2) or of one cell (R{2}, t{2}). What is stated
outside the shots counts for each. What is not used is named in a note.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import prod
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed
from cavirheo.io.curves import FORMS, Camera, Form, read_table, unusable_curve
from cavirheo.io.names import CURVES, OF_CAMERA, RANGES, STATED
from cavirheo.io.tables import Name, Table
from cavirheo.messages import Message
from cavirheo.physics.media import CONSTANTS
from cavirheo.units import unit_of

_BDT = ("R_nondim_All", "t_nondim_All", "RmaxList")
_ROWS = ("shift_normRnew", "Rmax", "t")
_ESSENTIAL = {kind for form in FORMS for kind in form.kinds} | {"time"}  # kinds of arrays that a shot must have
_PER_RADIUS = ("curve", "radius_std", "max_radius", "stretch", "stretch_std")  # used if they have a number per radius
_LISTED = 12  # most names in a note
_UNIT = 1e-4  # m, an R_max in place of one that is not known
_EXPERIMENT = re.compile(r"[_ ]?(exp|expt|experiment|experimental|data|meas|measured)(?=(_[a-z]+)?$)", re.I)
_NUMBERED = "\0"  # in the folder of arrays of one number
_CELL = re.compile(r"\{\d+\}$")  # at the end of a path
_AT_REST = re.compile(r"(?<![a-z])r(\d+)(?=_?eq)", re.I)  # R1_eq: a radius at rest of the arrays of a number


@dataclass(frozen=True, eq=False)
class Numbers:
    """An array of real numbers that is not read yet. unit: its attribute, or ""."""

    shape: tuple[int, ...]
    read: Callable[[], Floats]
    unit: str = ""

    @property
    def size(self) -> int:
        return prod(self.shape)


class NoNumbers(NamedTuple):
    """What holds no real numbers. code: of the error where it should be times or radii."""

    what: str
    code: str = "matlab.variables"
    size: int = 0


Leaf = Numbers | NoNumbers
Arrays = Mapping[str, Leaf]  # by their paths: radius, group/radius, structs(2)/R, cells{3}, group@attribute


class _Series(NamedTuple):
    """An array of times or radii. folder: of its shot. number: 2 of R2, else 0. rank: IMR's Rnew is 0, an experiment's
    R_exp 1, any other 2."""

    path: str
    folder: str
    number: int
    kind: str
    unit: str | None
    rank: int
    leaf: Leaf


class _Stated(NamedTuple):
    """A number and the array that states it; in SI, but a radius at rest without a unit is as the radii are."""

    path: str
    value: float
    unit: str = ""


def curves(arrays: Arrays, camera: Camera, density: float, pressure: float) -> list[RadiusCurve]:
    """Build the curves. density and pressure make seconds of BDT's times. Raises InputError: no radius history, or none
    that can be used."""
    names = {path.partition("{")[0] for path in arrays}
    if names.issuperset(_BDT[:2]):
        return _bdt(arrays, camera, density, pressure)
    if names.issuperset(_ROWS):
        note = "R/R_max times Rmax of the shot; the frame times t are used, not the normalised shift_normTnew"
        return _shots(_with_radii_of_rows(arrays), camera, [note], _ROWS)
    return _shots(arrays, camera)


def _shots(arrays: Arrays, camera: Camera, notes: Sequence[str] = (), only: Container[str] = ()) -> list[RadiusCurve]:
    """Return the curves of all folders that are shots. only: names of the times and radii, if not of any names."""
    folders: dict[str, list[_Series]] = {}
    for series in sorted(filter(None, map(_series, arrays, arrays.values())), key=lambda series: series.number):
        if not only or _CELL.sub("", series.path) in only:
            folders.setdefault(series.folder, []).append(series)
    with_radii = {folder for folder, members in folders.items() if _form(members)}
    with_radii -= {
        folder for folder in with_radii if _NUMBERED in folder and _around(folder) in with_radii
    }  # R, not R2
    candidates = [folder for folder in folders if folder in with_radii]
    shots = [folder for folder in candidates if _add_times(folders, folder, with_radii) or folder.endswith("}")]
    shots = shots or candidates
    if not shots:
        raise _no_history(arrays)
    inside: dict[str, list[str]] = {folder: [] for folder in ["", *shots]}  # "": outside all others
    folder_of = {series.path: series.folder for members in folders.values() for series in members}
    for path in arrays:
        folder = folder_of.get(path, _folder(path))
        if at_rest := _AT_REST.search(path):
            folder = f"{folder}/{_NUMBERED}{at_rest[1]}".strip("/")
        while folder not in inside:
            folder = _around(folder)
        inside[folder].append(path)
    outside = [path for path in inside[""] if "" not in shots or path not in folder_of]
    read: list[RadiusCurve] = []
    problems: list[InputError] = []
    for folder in shots:
        paths = [*inside[folder], *outside] if folder else inside[""]
        label = _label(folder, folders[folder])
        try:
            read += _shot(arrays, paths, folders[folder], camera, label, notes)
        except InputError as error:
            if error.code.startswith("limits."):
                raise
            problems.append(error)
            read.append(unusable_curve(error.message, {"label": label}))
    if len(problems) == len(read):  # no shot can be used
        raise problems[0]
    return read


def _folder(path: str) -> str:
    """Return the folder of an array or an attribute, or of the cells with its index; "" is the outermost one."""
    folder = path[: max(path.rfind("/"), path.rfind("@"), 0)]
    cell = _CELL.search(path)
    return f"{folder}/{cell[0]}".strip("/") if cell else folder


def _around(folder: str) -> str:
    return folder.rpartition("/")[0]


def _add_times(folders: dict[str, list[_Series]], folder: str, with_radii: Container[str]) -> bool:
    """Add to a shot without times those of the nearest folder around it that has no radii of its own; whether it has
    any then."""
    outer = folder
    while outer and not any(series.kind == "time" for series in folders[folder]):
        outer = _around(outer)
        if outer not in with_radii:
            folders[folder] += [series for series in folders.get(outer, []) if series.kind == "time"]
    return any(series.kind == "time" for series in folders[folder])


def _label(folder: str, members: Sequence[_Series]) -> str:
    """Return the name of a shot in its file: of its folder, cell (gel[2]), or radius with a number (R2)."""
    label = folder
    if _NUMBERED in folder:
        label = next(series.path for series in members if series.kind != "time")
    label = re.sub(r"/?\{(\d+)\}", r"[\1]", label)
    return label[1:-1] if re.fullmatch(r"\[\d+\]", label) else label


def _series(path: str, leaf: Leaf) -> _Series | None:
    """Return an array that may be a column of a table: several numbers, a cell, times or radii that cannot be read."""
    name = _CELL.sub("", re.split("[/@]", path)[-1])
    word = _EXPERIMENT.sub("", name)
    kind, unit, number = CURVES.name(word)
    if word.lower() == "curve" or "@" in path or not kind:  # a curve is rather a fitted one than labels of shots
        return None
    if isinstance(leaf, NoNumbers) and kind not in _ESSENTIAL:
        return None
    folder = _folder(path)
    if isinstance(leaf, Numbers):
        if leaf.size <= 2 and not folder.endswith("}"):
            return None
        unit = unit or unit_of(leaf.unit, CURVES.terms["time"].units) or leaf.unit or None
    if number:
        outer, _, cell = folder.rpartition("/") if folder.endswith("}") else (folder, "", "")
        folder = f"{outer}/{_NUMBERED}{number}/{cell}".strip("/")
    return _Series(path, folder, int(number or 0), kind, unit, 0 if name == "Rnew" else 1 if word != name else 2, leaf)


def _form(members: Iterable[_Series]) -> Form | None:
    kinds = {series.kind for series in members}
    return next((form for form in FORMS if kinds >= {*form.kinds}), None)


def _no_history(arrays: Arrays) -> InputError:
    if "pIMR_array" in arrays:
        message = "a table of collapse times (pIMR_array: R_max, stretch, t_1), not radius histories R(t)"
        return InputError(f"{message}: use cavirheo collapse-time", "matlab.collapse_times")
    kinds = {path: f" ({leaf.what})" if isinstance(leaf, NoNumbers) else "" for path, leaf in arrays.items()}
    words = [_CELL.sub("", path) + kind for path, kind in kinds.items()]
    expected = "R and t (m, s), or radius_um and time_us, alone or in a group per shot; MATLAB: save('a.mat', 'R', 't')"
    found = listed(words, _LISTED)
    return InputError(f"no radius history; found: {found}; expected {expected}", "matlab.variables")


def _pick(members: Iterable[_Series], kind: str) -> _Series | None:
    """Return the array of a kind with the lowest rank. Raises InputError: there are two, or it has no real numbers."""
    candidates = sorted((series for series in members if series.kind == kind), key=lambda series: series.rank)
    if not candidates:
        return None
    best = candidates[0]
    paths = [series.path for series in candidates if series.rank == best.rank]
    if len(paths) > 1:
        raise InputError(f"two arrays for {kind}: {' and '.join(paths)}; keep the one that counts", "hdf5.twice")
    if isinstance(best.leaf, NoNumbers):
        raise InputError(f"{best.path} is {best.leaf.what}", best.leaf.code)
    if not best.leaf.size:
        raise InputError(f"{best.path} is empty", "matlab.cells")
    return best


def _read_stated(arrays: Arrays, paths: Iterable[str]) -> dict[str, _Stated]:
    """Return what single numbers state, by quantity; the first of each that is possible."""
    stated: dict[str, _Stated] = {}
    for path in paths:
        name = _AT_REST.sub("R", re.split("[/@]", path)[-1])
        leaf, (kind, unit, _) = arrays[path], STATED.name(name)
        if not kind or kind in stated or not isinstance(leaf, Numbers) or leaf.size != 1:
            continue
        units = STATED.terms[kind].units or {"": 1.0}
        unit = unit or unit_of(leaf.unit, units) or leaf.unit
        value = float(leaf.read().ravel()[0]) * (units.get(unit, np.nan) if unit else 1.0)
        low, high = RANGES.get(kind, (0.0, np.inf))
        if 0.0 < value < np.inf and low <= value <= high:
            stated[kind] = _Stated(path, value, unit)
    return stated


def _shot(
    arrays: Arrays,
    paths: Sequence[str],
    members: Sequence[_Series],
    camera: Camera,
    label: str,
    notes: Sequence[str],
) -> list[RadiusCurve]:
    """Return the curves of the times and radii among `members`. paths: of all that is in the shot or around it."""
    form = _form(members)
    assert form is not None  # it makes the folder a shot
    picked = [series for kind in (*form.kinds, "time") if (series := _pick(members, kind))]
    first = picked[0]
    same = [series for series in members if series.leaf.size == first.leaf.size]
    kinds = _PER_RADIUS if picked[-1].kind == "time" else ("frame", *_PER_RADIUS)
    picked += [series for kind in kinds if (series := _pick(same, kind))]
    stated = _read_stated(arrays, paths)
    camera, meta, used = _facts(stated, camera)
    meta["notes"] = [*notes, *meta["notes"]]
    used |= {series.path for series in picked}
    not_used = [path for path in paths if path not in used]
    names = [Name(series.kind, series.unit) for series in picked]
    titles = [series.path for series in picked]
    shots: list[RadiusCurve] = []
    rows = _rows(picked)
    for k, row in enumerate(rows, 1):
        name = label
        if len(rows) > 1:
            name = f"{label}[{k}]" if label else str(k)
        table = Table(CURVES, [], [*meta["notes"]], titles=titles, names=names, arrays=row)
        try:
            of_row = read_table(table, camera)
        except InputError as error:
            raise InputError("; ".join([str(error), *_note_on(not_used)]), error.code) from None
        for curve in of_row:
            entries = {**meta, "notes": curve.notes}
            if labels := [text for text in (name, curve.meta.get("label")) if text]:
                entries["label"] = ", ".join(labels)
            curve, at_rest = _with_stretch(curve.labelled(**entries), stated.get("radius at rest"), first, row[0])
            shots.append(curve.with_notes(*_note_on([path for path in not_used if path not in at_rest])))
    return shots


def _with_stretch(
    curve: RadiusCurve, at_rest: _Stated | None, first: _Series, numbers: Floats
) -> tuple[RadiusCurve, set[str]]:
    """Return the curve with the stretch that follows from a radius at rest, and the path of that if it is used."""
    if at_rest is None or curve.stretch or not (at_rest.unit or first.kind in ("radius", "diameter")):
        return curve, set()
    per_number = float(np.nanmax(curve.radius, initial=0.0)) / max(float(np.nanmax(numbers, initial=0.0)), 1e-300)
    with suppress(InputError):  # no scale, or no maximum
        stretch = curve.max_radius / (at_rest.value * (1.0 if at_rest.unit else per_number))
        if 1.0 < stretch < 100.0:
            note = f"the file states the stretch {stretch:.4g}: R_max over {at_rest.path}"
            return curve.labelled(stretch=stretch).with_notes(note), {at_rest.path}
    return curve, set()


def _facts(stated: Mapping[str, _Stated], camera: Camera) -> tuple[Camera, dict[str, Any], set[str]]:
    """Return the camera as the user gives it, else as the file states it; the `meta` of a curve with what is stated of
    medium and stretch, and notes on it; and the paths of all that is taken from the file."""
    meta: dict[str, Any] = {"notes": []}
    used: set[str] = set()
    for kind, number in stated.items():
        field, unit, of_camera = OF_CAMERA.get(kind, ("", "", float))
        if kind in CONSTANTS:
            meta.setdefault("medium", {})[kind] = number.value
            unit = CONSTANTS[kind].unit
        elif kind in ("stretch", "stretch_std"):
            meta[kind] = number.value
        elif field and getattr(camera, field) is None:
            camera = camera._replace(**{field: of_camera(number.value)})
        else:
            continue
        what = f"the file states the {kind.replace('_', ' ')}: {number.path} = {number.value:.6g} {unit}"
        meta["notes"].append(what.rstrip())
        used.add(number.path)
    return camera, meta, used


def _note_on(not_used: Sequence[str]) -> list[str]:
    """Return a note, in a list, on arrays that are not used, if there are any."""
    names = [_CELL.sub("", path) for path in not_used]
    return [f"not used: {listed(names, _LISTED)}"] if names else []


def _rows(picked: Sequence[_Series]) -> list[list[Floats]]:
    """Return the (n,) numbers of each array for each shot: the rows (columns) of a matrix of radii, as long as the
    times, or vectors. Raises InputError: it is not clear which, or not as many times as radii."""
    values = [series.leaf.read() for series in picked if isinstance(series.leaf, Numbers)]
    radius = values[0]
    if radius.ndim != 2 or min(radius.shape) <= 1:
        if len({numbers.size for numbers in values}) > 1:
            sizes = " and ".join(f"{series.leaf.size} of {series.path}" for series in picked)
            raise InputError(f"arrays of different lengths: {sizes}", "matlab.cells")
        return [[numbers.ravel(order="F") for numbers in values]]
    values = [numbers.T if numbers.shape != radius.shape == numbers.shape[::-1] else numbers for numbers in values]
    time = next((numbers for series, numbers in zip(picked, values, strict=True) if series.kind == "time"), None)
    if time is not None and time.shape == radius.shape:
        rising = [float(np.mean(np.diff(time, axis=axis) > 0)) for axis in (0, 1)]  # padding does not rise
        in_rows = (rising[1], radius.shape[1]) > (rising[0], radius.shape[0])
    else:
        length = max(radius.shape) if time is None else time.size
        shapes = f"{picked[0].path} has the shape {radius.shape}" + ("" if time is None else f", and {length} times")
        if length not in radius.shape:
            raise InputError(f"{shapes}: expected as many times as rows or columns", "matlab.cells")
        if radius.shape[0] == radius.shape[1]:
            advice = "give times of the same shape, as repmat(t(:), 1, n) makes them"
            raise InputError(f"{shapes}: are the shots in rows or in columns? {advice}", "matlab.cells")
        in_rows = radius.shape[1] == length
    matrices = [numbers if in_rows else numbers.T for numbers in values]
    shots = range(len(matrices[0]))
    return [[matrix[k] if matrix.size == radius.size else matrix.ravel() for matrix in matrices] for k in shots]


def _bdt(arrays: Arrays, camera: Camera, density: float, pressure: float) -> list[RadiusCurve]:
    """Read BDT's cells of R/R_max and t* = t/(R_max sqrt(rho/p)), with R_max of each in RmaxList."""
    stated = _read_stated(arrays, arrays)
    density = stated["density"].value if "density" in stated else density
    pressure = stated["pressure"].value if "pressure" in stated else pressure
    factors = {_BDT[0]: ("m", 1.0), _BDT[1]: ("s", float(np.sqrt(density / pressure)))}  # of one metre of R_max
    stated_maxima = arrays.get(_BDT[2])
    maxima = stated_maxima.read().ravel() if isinstance(stated_maxima, Numbers) else np.empty(0)
    note = f"seconds from t* with R_max of RmaxList, density {density:.6g} kg/m3, {pressure:.6g} Pa"
    unscaled = ""
    if not len(maxima):
        note = unscaled = "the file has no RmaxList, so radii and times are only known in units of R_max"
    in_units: dict[str, Leaf] = {}
    for path, leaf in arrays.items():
        name, _, cell = path.partition("{")
        if name in factors:
            if not (number := cell.rstrip("}")).isdigit():
                raise InputError(f"{_BDT[0]} and {_BDT[1]} are no cells of arrays", "matlab.cells")
            at = int(number) - 1
            largest = _UNIT if unscaled else maxima[at] if at < len(maxima) else np.nan
            if isinstance(leaf, Numbers) and leaf.size and not largest > 0:
                leaf = NoNumbers("without a scale: RmaxList has no R_max")
            elif isinstance(leaf, Numbers):
                unit, factor = factors[name]
                leaf = Numbers(leaf.shape, _product(leaf, factor * largest), unit)
        if path != _BDT[2]:
            in_units[path] = leaf
    curves = []
    for curve in _shots(in_units, camera, [note], _BDT):
        if unscaled and not curve.unusable:  # the user's R_max will scale both time and radius
            time, radius = curve.time / _UNIT, curve.radius / _UNIT
            curve = replace(curve, time=time, radius=radius, unscaled=unscaled, time_unscaled=True)
        warnings = (*curve.warnings, *_density_warning(curve, density))
        curves.append(replace(curve, stated_time_of_max=0.0, warnings=warnings))
    return curves


def _product(leaf: Numbers, factor: float | Floats) -> Callable[[], Floats]:
    return lambda: leaf.read() * factor


def _density_warning(curve: RadiusCurve, density: float) -> list[Message]:
    """Return a warning if the density seems wrong: the rate is slightly off a round one, at which cameras run."""
    rate = curve.frame_rate
    if rate is None or curve.time_unscaled:
        return []
    rounds = np.array([1.0, 2.0, 5.0])[:, None] * 10.0 ** np.arange(4, 8)
    nearest = float(rounds.flat[np.argmin(np.abs(np.log(rounds / rate)))])
    if not 5e-3 < abs(rate / nearest - 1.0) < 0.035:
        return []
    meant = density * (rate / nearest) ** 2
    return [Message("check_input.density", {"density": density, "rate": rate, "usual": nearest, "meant": meant})]


def _with_radii_of_rows(arrays: Arrays) -> Arrays:
    """Return the arrays with rows of R/R_max times the Rmax of each; shift_normTnew = t/(R_max sqrt(rho/p)) with
    rho = 1060 is not used."""
    normal, largest = arrays[_ROWS[0]], arrays[_ROWS[1]]
    if isinstance(normal, NoNumbers) or isinstance(largest, NoNumbers):
        raise InputError(f"{', '.join(_ROWS)} are no arrays of numbers", "matlab.variables")
    if len(normal.shape) != 2 or normal.shape[0] != largest.size:
        raise InputError(f"Rmax has {largest.size} values but shift_normRnew the shape {normal.shape}")
    radii = Numbers(normal.shape, _product(normal, largest.read().reshape(-1, 1)))
    return {_ROWS[0]: radii} | {path: leaf for path, leaf in arrays.items() if path not in _ROWS[:2]}
