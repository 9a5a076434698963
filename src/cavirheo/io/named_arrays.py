"""Recognise radius histories among named arrays: the variables of a .mat file, the datasets of an HDF5 file, or the
fields of an array of numpy.

| names | content |
|---|---|
| R_nondim_All, t_nondim_All, RmaxList m, lambda_max_mean | BDT: cells of R/R_max and t/(R_max sqrt(rho/p)) |
| shift_normRnew, Rmax um, t s | R/R_max over common frame times, one shot per row |
| times and radii, named like columns of tables (`Rnew`, `t_us`, `R_exp`) | a shot, or one per row, cell or number |
| deltat s, deltax m; fps, um_per_px | replace times; scale radii in pixels |
| rho, Pinf, c, gamma, T; R_eq, lambda_max | constants of the medium, SI; radius at rest, stretch |
| pIMR_array | collapse times, no radius histories: refused with advice |

A folder (a group, a struct) may be a shot; what is stated outside the shots counts for each. What is not used is named
in a note.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from math import prod
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed, require
from cavirheo.io.curves import CURVES, FORMS, RADIUS_UNITS, Camera, Form, read_table, unusable_curve
from cavirheo.io.tables import Name, Table, Term, Vocabulary
from cavirheo.messages import Message
from cavirheo.physics.media import CONSTANTS
from cavirheo.units import TIME_UNITS, unit_of

_CELL_ARRAYS = ("R_nondim_All", "t_nondim_All")
_ROWS = ("shift_normRnew", "Rmax", "t")
_ESSENTIAL = {kind for form in FORMS for kind in form.kinds} | {"time"}  # kinds of arrays that a shot must have
_BESIDE = ("curve", "radius_std", "max_radius", "stretch", "stretch_std")  # used if they have a number per radius
_WITHOUT_UNITS = ("area", "frame", "curve", "stretch", "stretch_std")  # kinds without a usual unit
_LARGEST_RADIUS = 0.01  # m, largest radius of a bubble
_LONGEST_TIME = 0.1  # s, of a recording
_LISTED = 12  # most names in a note
_UNIT = 1e-4  # m, an R_max in place of one that is not known
_EXPERIMENT = re.compile(r"[_ ]?(exp|expt|experiment|experimental|data|meas|measured)(?=(_[a-z]+)?$)", re.I)
_STATED = Vocabulary(
    {
        "density": Term("rho density rho0 rhoinf rhol", {"kgm3": 1.0, "kgm-3": 1.0, "gcm3": 1e3}),
        "pressure": Term("pinf pressure pambient patm", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5}),
        "sound_speed": Term("c cinf soundspeed speedofsound clong", {"ms": 1.0, "ms-1": 1.0}),
        "surface_tension": Term("gamma sigma surfacetension", {"Nm": 1.0, "Nm-1": 1.0, "mNm": 1e-3}),
        "temperature": Term("t tinf temperature tambient", {"K": 1.0}),
        "radius at rest": Term("req rinf requilibrium equilibriumradius restradius", RADIUS_UNITS),
        "stretch": Term("stretch lambda lambdamax lambdamaxmean"),
        "stretch_std": Term("stretchstd lambdastd lambdamaxstd"),
        "frame rate": Term("fps framerate framespersecond", {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6}),
        "frame interval": Term("deltat dt frameinterval", TIME_UNITS),
        "size of a pixel": Term("deltax", RADIUS_UNITS),
        "um per pixel": Term("umperpx umperpixel micronsperpixel micronperpixel"),
    },
    "",
    (),
)
_ANY = (0.0, np.inf)
_RANGES: dict[str, tuple[float, float]] = {name: one[:2] for name, one in CONSTANTS.items()}
_RANGES |= {"density": _ANY, "pressure": _ANY, "surface_tension": (1e-3, 1.0), "stretch": (1.0, 100.0)}
_OF_CAMERA: dict[str, tuple[str, str, Callable[[float], float]]] = {  # field of Camera; unit in the file; its value
    "frame interval": ("frame_rate", "s", lambda interval: 1.0 / interval),
    "frame rate": ("frame_rate", "per second", lambda rate: rate),
    "size of a pixel": ("um_per_px", "m", lambda size: 1e6 * size),
    "um per pixel": ("um_per_px", "", lambda scale: scale),
}


@dataclass(frozen=True, eq=False)
class Numbers:
    """An array of real numbers that is not read yet. unit: its attribute, or ""."""

    shape: tuple[int, ...]
    read: Callable[[], Floats]
    unit: str = ""

    @property
    def size(self) -> int:
        return prod(self.shape)


class Other(NamedTuple):
    """What holds no real numbers. code: of the error where it should be times or radii."""

    what: str
    code: str = "matlab.variables"


Leaf = Any  # Numbers, Other, or a list of them, the cells of an array
Arrays = Mapping[str, Leaf]  # by their paths: radius, group/radius, structs(2)/R, group@attribute


class _Series(NamedTuple):
    """An array of times or radii. rank: IMR's Rnew is 0, an experiment's R_exp 1, any other 2."""

    path: str
    kind: str
    number: str
    unit: str | None
    rank: int
    leaf: Leaf


class _Stated(NamedTuple):
    """A number and the array that states it; in SI, but a radius at rest without a unit is as the radii are."""

    path: str
    value: float
    unit: str = ""


def curves(arrays: Arrays, camera: Camera, density: float, pressure: float, *, si: bool = False) -> list[RadiusCurve]:
    """Build the curves. si: times and radii without a unit are in s and m; else their sizes tell. density and pressure
    make seconds of BDT's times. Raises InputError: no radius history, or none that can be used."""
    if arrays.keys() >= {*_CELL_ARRAYS}:
        return _bdt(arrays, camera, density, pressure)
    if arrays.keys() >= {*_ROWS}:
        return _shifted(arrays, camera)
    folders: dict[str, list[_Series]] = {}
    for one in filter(None, map(_series, arrays, arrays.values())):
        folders.setdefault(folder_of(one.path), []).append(one)
    with_radii = [folder for folder, members in folders.items() if _form(members)]
    for folder in with_radii:  # the times of the nearest folder around it that has no radii of its own
        outer = folder
        while outer and not any(one.kind == "time" for one in folders[folder]):
            outer = folder_of(outer)
            if outer not in with_radii:
                folders[folder] += [one for one in folders.get(outer, []) if one.kind == "time"]
    shots = [folder for folder in with_radii if any(one.kind == "time" for one in folders[folder])] or with_radii
    if not shots:
        raise _no_history(arrays)
    inside: dict[str, list[str]] = {folder: [] for folder in ["", *shots]}  # "": outside all others
    for path in arrays:
        folder = folder_of(path)
        while folder not in inside:
            folder = folder_of(folder)
        inside[folder].append(path)
    outside = {one.path for one in folders.get("", [])} if "" in shots else set()
    found, problems = list[RadiusCurve](), list[InputError]()
    for folder in shots:
        around = [path for path in inside[""] if path not in outside] if folder else []
        paths, members = inside[folder] + around, folders[folder]
        form = _form(members)
        numbered = {one.number: one.path for one in members if form and one.kind in form.kinds}
        for number in [""] if "" in numbered else sorted(numbered, key=int):
            others = {one.path for one in members if number and one.number not in ("", number)}
            mine = [one for one in members if one.path not in others]
            label = numbered[number] if number else folder
            own = [path for path in paths if path not in others]
            try:
                found += _shot(arrays, own, mine, camera, label=label, si=si)
            except InputError as error:
                if error.code.startswith("limits."):
                    raise
                problems.append(error)
                found.append(unusable_curve(error.message, {"label": label}))
    if len(problems) == len(found):  # no shot can be used
        raise problems[0]
    return found


def cells_of(path: str, leaves: Arrays) -> dict[str, Leaf]:
    """Return the cells of an array, `leaves` by their paths, as one leaf; but the fields of structs as they are."""
    if any("}/" in one for one in leaves):
        return dict(leaves)
    return {path: [Other("cells within cells") if isinstance(leaf, list) else leaf for leaf in leaves.values()]}


def folder_of(path: str) -> str:
    """Return the folder of an array, an attribute or a folder; "" is the outermost one."""
    return path[: max(path.rfind("/"), path.rfind("@"), 0)]


def _series(path: str, leaf: Leaf) -> _Series | None:
    """Return what an array is, if it may be a column of a table: several numbers, cells of them, or times or radii that
    cannot be read."""
    plain = re.split("[/@]", path)[-1]
    word = _EXPERIMENT.sub("", plain)
    kind, unit, number = CURVES.name("radius" if word.lower() == "roft" else word)
    several = any(map(_several, leaf)) if isinstance(leaf, list) else _several(leaf)
    if word.lower() == "curve":  # rather a fitted one than labels of shots
        return None
    if "@" in path or not kind or not several or (isinstance(leaf, Other) and kind not in _ESSENTIAL):
        return None
    attribute = leaf.unit if isinstance(leaf, Numbers) else ""
    unit = unit or unit_of(attribute, CURVES.terms["time"].units) or attribute or None
    return _Series(path, kind, number, unit, 0 if plain == "Rnew" else 1 if word != plain else 2, leaf)


def _form(members: Iterable[_Series]) -> Form | None:
    """Return how these arrays give radii, if they do."""
    kinds = {one.kind for one in members}
    return next((form for form in FORMS if kinds >= {*form.kinds}), None)


def _several(leaf: Leaf) -> bool:
    return isinstance(leaf, Other) or leaf.size > 2


def _no_history(arrays: Arrays) -> InputError:
    if "pIMR_array" in arrays:
        message = "a table of collapse times (pIMR_array: R_max, stretch, t_1), not radius histories R(t): there is no "
        message += "curve in it to infer from; use cavirheo collapse-time"
        return InputError(message, "matlab.collapse_times")
    names = [f"{path} ({leaf.what})" if isinstance(leaf, Other) else path for path, leaf in arrays.items()]
    expected = "expected R and t (m, s), or radius_um and time_us, alone or in a group per shot; in MATLAB: "
    expected += "save('shot.mat', 'R', 't')"
    return InputError(f"no radius history; found: {listed(names, _LISTED)}; {expected}", "matlab.variables")


def _pick(members: Iterable[_Series], kind: str) -> _Series | None:
    """Return the array of a kind with a number before one without, then with the lowest rank. Raises InputError: there
    are two, or it has no real numbers."""
    found = sorted((one for one in members if one.kind == kind), key=lambda one: (not one.number, one.rank))
    if not found:
        return None
    best, *others = found
    equal = [one.path for one in others if (not one.number, one.rank) == (not best.number, best.rank)]
    twice = f"two arrays for {kind}: {best.path} and {', '.join(equal)}; keep the one that counts"
    require(not equal, twice, "hdf5.twice")
    if isinstance(best.leaf, Other):
        raise InputError(f"{best.path} is {best.leaf.what}", best.leaf.code)
    return best


def _read_stated(arrays: Arrays, paths: Iterable[str]) -> dict[str, _Stated]:
    """Return what single numbers state, by quantity; the first of each that is possible."""
    found: dict[str, _Stated] = {}
    for path in paths:
        leaf, (kind, unit, _) = arrays[path], _STATED.name(re.split("[/@]", path)[-1])
        if not kind or kind in found or not isinstance(leaf, Numbers) or leaf.size != 1:
            continue
        units = _STATED.terms[kind].units or {"": 1.0}
        unit = unit or unit_of(leaf.unit, units) or leaf.unit
        value = float(leaf.read().ravel()[0]) * (units.get(unit, np.nan) if unit else 1.0)
        low, high = _RANGES.get(kind, (0.0, np.inf))
        if 0.0 < value < np.inf and low <= value <= high:
            found[kind] = _Stated(path, value, unit)
    return found


def _shot(
    arrays: Arrays,
    paths: Sequence[str],
    members: Sequence[_Series],
    camera: Camera,
    *,
    label: str = "",
    si: bool = True,
    notes: Sequence[str] = (),
) -> list[RadiusCurve]:
    """Return the curves of the times and radii among `members`. paths: of all that is in the shot or around it."""
    form = _form(members)
    assert form is not None  # it makes the folder a shot
    picked = [one for kind in (*form.kinds, "time") if (one := _pick(members, kind))]
    first = picked[0]
    same = [one for one in members if _shape(one.leaf) == _shape(first.leaf)]
    kinds = _BESIDE if picked[-1].kind == "time" else ("frame", *_BESIDE)
    picked += [one for kind in kinds if (one := _pick(same, kind))]
    stated = _read_stated(arrays, paths)
    camera, meta, used = _facts(stated, camera)
    meta["notes"] = [*notes, *meta["notes"]]
    used |= {one.path for one in picked}
    left = [path for path in paths if path not in used]
    shots = _histories(picked)
    plain = si or first.rank == 0  # in s and m if the numbers allow it
    read = [shot for shot in shots if not isinstance(shot, str)]
    names = [_named(one, [shot[k] for shot in read], plain) for k, one in enumerate(picked)]
    titles = [one.path for one in picked]
    made = []
    for k, shot in enumerate(shots, 1):
        name = (f"{label}[{k}]" if label else str(k)) if len(shots) > 1 else label
        if isinstance(shot, str):
            made.append(unusable_curve(shot, {**meta, "label": name}))
            continue
        table = Table(CURVES, [], [*meta["notes"]], titles=titles, arrays=list(zip(names, shot, strict=True)))
        try:
            found = read_table(table, camera)
        except InputError as error:
            raise InputError("; ".join([str(error), *_left_out(left)]), error.code) from None
        for curve in found:
            labels = [text for text in (name, curve.meta.get("label", "")) if text]
            about = {**meta, "notes": curve.notes} | ({"label": ", ".join(labels)} if labels else {})
            curve, at_rest = _with_rest(curve.labelled(**about), stated.get("radius at rest"), first, shot[0])
            made.append(curve.with_notes(*_left_out([path for path in left if path not in at_rest])))
    return made


def _named(one: _Series, shots: Sequence[Floats], plain: bool) -> Name:
    """Return what a column of an array is. plain: without a unit it is in s or m, unless it is too large for that."""
    values = np.concatenate(shots)
    finite = values[np.isfinite(values)]
    largest = float(np.ptp(finite) if one.kind == "time" else finite.max()) if finite.size else 0.0
    usual, limit = ("s", _LONGEST_TIME) if one.kind == "time" else ("m", _LARGEST_RADIUS)
    assumed = plain and largest < limit and one.kind not in _WITHOUT_UNITS
    return Name(one.kind, one.unit or (usual if assumed else None))


def _with_rest(
    curve: RadiusCurve, rest: _Stated | None, first: _Series, numbers: Floats
) -> tuple[RadiusCurve, set[str]]:
    """Return the curve with the stretch that follows from a radius at rest, and the path of that if it is used."""
    if rest is None or curve.stretch or not (rest.unit or first.kind in ("radius", "diameter")):
        return curve, set()
    per_number = float(np.nanmax(curve.radius, initial=0.0)) / max(float(np.nanmax(numbers, initial=0.0)), 1e-300)
    with suppress(InputError):  # no scale, or no maximum
        stretch = curve.max_radius / (rest.value * (1.0 if rest.unit else per_number))
        if 1.0 < stretch < 100.0:
            note = f"the file states the stretch {stretch:.4g}: R_max over {rest.path}"
            return curve.labelled(stretch=stretch).with_notes(note), {rest.path}
    return curve, set()


def _facts(stated: Mapping[str, _Stated], camera: Camera) -> tuple[Camera, dict[str, Any], set[str]]:
    """Return the camera as the user gives it, else as the file states it; the `meta` of a curve with what is stated of
    medium and stretch, and notes on it; and the paths of all that is taken from the file."""
    meta: dict[str, Any] = {"notes": []}
    used: set[str] = set()
    for kind, one in stated.items():
        field, unit, of_camera = _OF_CAMERA.get(kind, ("", "", float))
        if kind in CONSTANTS:
            meta.setdefault("medium", {})[kind] = one.value
            unit = CONSTANTS[kind].unit
        elif kind in ("stretch", "stretch_std"):
            meta[kind] = one.value
        elif field and getattr(camera, field) is None:
            camera = camera._replace(**{field: of_camera(one.value)})
        else:
            continue
        what = f"the file states the {kind.replace('_', ' ')}: {one.path} = {one.value:.6g} {unit}"
        meta["notes"].append(what.rstrip())
        used.add(one.path)
    return camera, meta, used


def _left_out(paths: Sequence[str]) -> list[str]:
    """Return a note, in a list, on arrays that are not used, if there are any."""
    return [f"not used: {listed(paths, _LISTED)}"] if paths else []


def _shape(leaf: Leaf) -> Any:
    """Return the number of numbers of an array, or that of each of its cells."""
    return list(map(_shape, leaf)) if isinstance(leaf, list) else leaf.size if isinstance(leaf, Numbers) else 0


def _histories(picked: Sequence[_Series]) -> list[list[Floats] | str]:
    """Return, for each shot, (n,) numbers of each array, the first of which has radii, or why it has none. A shot is a
    cell, or a row (column) of a matrix; a vector beside them is the same in each. Raises InputError: no shot has such
    numbers."""
    cells = [one.leaf if isinstance(one.leaf, list) else [one.leaf] for one in picked]
    if not any(isinstance(one.leaf, list) for one in picked):
        cells = _rows_of_matrices(picked)
    count = max(map(len, cells))
    cells = [leaves * count if len(leaves) == 1 else leaves for leaves in cells]
    paths = " and ".join(one.path for one in picked)
    message = f"{paths} have {' and '.join(str(len(leaves)) for leaves in cells)} cells: expected as many of each"
    require(count > 0 and len({*map(len, cells)}) == 1, message, "matlab.cells")
    shots: list[list[Floats] | str] = []
    for k, leaves in enumerate(zip(*cells, strict=True), 1):
        sizes = [0 if isinstance(leaf, Other) else leaf.size for leaf in leaves]
        lacks = [leaf.what for leaf in leaves if isinstance(leaf, Other)] + ["empty"] * (0 in sizes)
        if lacks or len({*sizes}) > 1:
            of_each = " and ".join(f"{size} of {one.path}" for size, one in zip(sizes, picked, strict=True))
            shots.append(f"cell {k} of {count} is {lacks[0]}" if lacks else f"arrays of different lengths: {of_each}")
        else:
            shots.append([(leaf.read() if isinstance(leaf, Numbers) else leaf).ravel(order="F") for leaf in leaves])
    reasons = [shot for shot in shots if isinstance(shot, str)]
    if len(reasons) == count:
        raise InputError(f"{paths}: {reasons[0]}; expected numbers, as many times as radii", "matlab.cells")
    return shots


def _rows_of_matrices(picked: Sequence[_Series]) -> list[list[Floats]]:
    """Return the shots of each array: the rows (columns) of a matrix as long as the times, or a vector. Raises
    InputError: it is not clear which."""
    values = [one.leaf.read() for one in picked]
    radius = values[0]
    if radius.ndim != 2 or min(radius.shape) <= 1:
        return [[numbers] for numbers in values]
    values = [numbers.T if numbers.shape != radius.shape == numbers.shape[::-1] else numbers for numbers in values]
    time = next((numbers for one, numbers in zip(picked, values, strict=True) if one.kind == "time"), None)
    if time is not None and time.shape == radius.shape:
        rising = [float(np.mean(np.diff(time, axis=axis) > 0)) for axis in (0, 1)]  # padding does not rise
        in_rows = (rising[1], radius.shape[1]) > (rising[0], radius.shape[0])
    else:
        length = max(radius.shape) if time is None else time.size
        shapes = f"{picked[0].path} has the shape {radius.shape}" + ("" if time is None else f", and {length} times")
        require(length in radius.shape, f"{shapes}: expected as many times as rows or columns", "matlab.cells")
        advice = "are the shots in rows or in columns? give times of the same shape, as repmat(t(:), 1, n) makes them"
        require(radius.shape[0] != radius.shape[1], f"{shapes}: {advice}", "matlab.cells")
        in_rows = radius.shape[1] == length
    matrices = [numbers if in_rows else numbers.T for numbers in values]
    return [list(matrix) if matrix.size == radius.size else [matrix] for matrix in matrices]


def _bdt(arrays: Arrays, camera: Camera, density: float, pressure: float) -> list[RadiusCurve]:
    """Read BDT's cells of R/R_max and t* = t/(R_max sqrt(rho/p)), with R_max of each in RmaxList."""
    stated = _read_stated(arrays, arrays)
    density = stated["density"].value if "density" in stated else density
    pressure = stated["pressure"].value if "pressure" in stated else pressure
    per_radius = float(np.sqrt(density / pressure))  # s/m: seconds per metre of R_max and unit of t*
    maxima = arrays["RmaxList"].read().ravel() if isinstance(arrays.get("RmaxList"), Numbers) else np.empty(0)
    radii, times = (arrays[path] for path in _CELL_ARRAYS)
    cells = isinstance(radii, list) and isinstance(times, list)
    require(cells, "R_nondim_All and t_nondim_All are no cells of arrays", "matlab.cells")
    notes = [f"seconds from t* with R_max of RmaxList, density {density:.6g} kg/m3, {pressure:.6g} Pa"]
    unscaled = ""
    if not len(maxima):
        unscaled = "the file has no RmaxList, so radii and times are only known in units of R_max"
        notes, maxima = [unscaled], np.full(max(len(radii), len(times)), _UNIT)
    without = "no scale: RmaxList has no R_max"
    members = [
        _Series(_CELL_ARRAYS[0], "radius", "", "m", 0, _times_each(radii, maxima, without)),
        _Series(_CELL_ARRAYS[1], "time", "", "s", 0, _times_each(times, per_radius * maxima, without)),
    ]
    curves = []
    for curve in _shot(arrays, [path for path in arrays if path != "RmaxList"], members, camera, notes=notes):
        if unscaled:  # the user's R_max will scale both time and radius
            time, radius = curve.time / _UNIT, curve.radius / _UNIT
            curve = replace(curve, time=time, radius=radius, unscaled=unscaled, time_unscaled=True)
        warnings = (*curve.warnings, *_density_warning(curve, density))
        curves.append(replace(curve, stated_time_of_max=0.0, warnings=warnings))
    return curves


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


def _shifted(arrays: Arrays, camera: Camera) -> list[RadiusCurve]:
    """Read rows of R/R_max over the frame times t; shift_normTnew = t/(R_max sqrt(rho/p)), rho = 1060, is not used."""
    fine = all(isinstance(arrays[name], Numbers) for name in _ROWS)
    require(fine, f"{', '.join(_ROWS)} are no arrays of numbers", "matlab.variables")
    normal, largest, time = (arrays[name] for name in _ROWS)
    fits = len(normal.shape) == 2 and normal.shape[0] == largest.size
    require(fits, f"Rmax has {largest.size} values but shift_normRnew the shape {normal.shape}")
    rows = [Numbers((normal.shape[1],), partial(np.array, row)) for row in normal.read()]
    note = "R/R_max times Rmax of the shot; the frame times t are used, not the normalised shift_normTnew"
    radius = _Series(_ROWS[0], "radius", "", None, 2, _times_each(rows, largest.read().ravel(), "without Rmax"))
    members = [radius, _Series("t", "time", "", "s", 2, time)]
    return _shot(arrays, [path for path in arrays if path != "Rmax"], members, camera, si=False, notes=[note])


def _times_each(leaves: Sequence[Leaf], factors: Floats, without: str) -> list[Leaf]:
    """Return the cells times a number each; a cell with numbers that has no positive one is `without` it."""
    made: list[Leaf] = []
    for leaf, factor in zip_longest(leaves, factors[: len(leaves)], fillvalue=np.nan):
        if isinstance(leaf, Numbers) and leaf.size:
            leaf = Numbers(leaf.shape, partial(np.multiply, leaf.read(), factor)) if factor > 0 else Other(without)
        made.append(leaf)
    return made
