"""Files of arrays (MATLAB, HDF5, .npy and .npz of numpy) become named arrays, and these become tables: one for each
group or struct that is a shot.

Names and layouts: docs/how-to/your-shots.md. A number in a name (R2, t2), a cell (R{2}) and a row or column of a matrix
are columns with a number. Two published layouts are known besides: BDT's cells hold R/R_max and t/(R_max sqrt(rho/p)),
and shift_normRnew holds R/R_max in rows over common times, with R_max of each row in Rmax (um).

MATLAB's version 7.3 is HDF5, with arrays transposed, cells as references, a struct as a group, and an array of structs
as a group of references.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from math import prod
from typing import Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, listed
from cavirheo.io import apart
from cavirheo.io.curves import FORMS, Camera, read_each, read_table, stated
from cavirheo.io.files import LARGEST_TEXT, MOST_CURVES, MOST_NUMBERS, Source, check_limit
from cavirheo.io.names import CURVES, PER_SHOT, STATED
from cavirheo.io.tables import Name, Table, unit_beside
from cavirheo.messages import Message

Arrays = dict[str, np.ndarray | str]  # by their paths: radius, group/radius, structs(2)/R, cells{3}; or what they are
_BDT = ("R_nondim_All", "t_nondim_All", "RmaxList")
_ROWS = ("shift_normRnew", "Rmax", "t")
_ESSENTIAL = {kind for form in FORMS for kind in form.kinds} | {"time"}  # kinds of arrays that a shot must have
_OF_FRAMES = _ESSENTIAL | {"frame", "curve", "radius_std", *PER_SHOT}
_LISTED = 12  # most names in a message
_EXPERIMENT = re.compile(r"[_ ]?(exp|expt|experiment|experimental|data|meas|measured)(?=(_[a-z]+)?$)", re.I)
_CELL = re.compile(r"\{(\d+)\}$")  # at the end of a path
_SIMULATED = re.compile(r"(^|[/_])(sim|simulated|simulations?|fit|fitted)\d*(\(\d+\))?(/|$)", re.I)  # groups of no shot
_AT_REST = re.compile(r"(?<![a-z])r(\d+)(?=_?eq)", re.I)  # R1_eq: a radius at rest of the arrays of a number
_DEEPEST = 16  # most references, structs or cells within each other
_REAL = "fiub"  # numpy's dtype kinds of real numbers
_HELD = ("#refs#", "#subsystem#")  # groups in which MATLAB holds what its variables refer to
_AN_OBJECT = "an object: of a table or timetable T save table2struct(T, 'ToScalar', true)"
_COMPLEX_NUMBERS = "an array of complex numbers: save real(...) of it"
_NO_NUMBERS = "no array of numbers: save it as one"
_ATTRIBUTE = "@"  # before the name of an attribute of HDF5 in a path; attributes are named, and not read
_OF_LIBRARIES = re.compile(r"MATLAB|_|[A-Z_0-9]+$")  # attributes that MATLAB, netCDF and PyTables write


def read_arrays(source: Source, density: float, pressure: float, camera: Camera) -> list[RadiusCurve]:
    """Read the curves of a file of arrays. density and pressure make seconds of BDT's times. Raises InputError: no
    radius history, or none that can be used; the file violates its format, or exceeds a limit."""
    if source.kind in ("matlab73", "hdf5"):
        arrays = _hdf5_variables(source)
    elif source.kind == "numpy":
        arrays = _numpy_variables(source)
    else:  # in a process of its own: scipy 1.17 ends it with a segmentation fault for some damaged files
        arrays = apart.call(_matlab_variables, str(source.path.absolute()))
    names = {path.partition("{")[0] for path in arrays}
    if names.issuperset(_BDT[:2]):
        return _bdt(arrays, density, pressure, camera)
    if names.issuperset(_ROWS):
        arrays = _with_radii_of_rows(arrays)
    arrays, taken = _with_pairs_apart(arrays)
    shots, of_frames = _shots(arrays)

    def read(group: str) -> list[RadiusCurve]:
        return read_table(camera, _table(group, shots[group], of_frames, arrays))

    curves = read_each([(group if len(shots) > 1 else "", group) for group in shots], read)
    note = f"an array of numpy: {', '.join(arrays)}"
    return [curve.with_notes(*taken, *([note] if source.kind == "numpy" else [])) for curve in curves]


def _matlab_variables(path: str) -> dict[str, Any]:
    """In the child."""
    from scipy.io import loadmat

    variables = [(name, value) for name, value in loadmat(path).items() if not name.startswith("__")]
    return {part: inner for name, value in variables for part, inner in _matlab_parts(name, value, 0)}


def _matlab_parts(path: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield (path, array of numbers, or what it is) of a variable and of all that is in it."""
    from scipy.io import matlab
    from scipy.sparse import issparse

    if isinstance(value, matlab.MatlabOpaque | matlab.MatlabFunction):
        name = bytes(value["s0"].item()).decode("latin-1") if path == "None" else path  # scipy loses its name
        yield name, _AN_OBJECT
    elif issparse(value):
        yield path, "a sparse array: save full(...) of it"
    elif isinstance(value, str) or value.dtype.kind not in "fiubcOV":
        yield path, "a text"
    elif value.dtype.kind == "c":
        yield path, _COMPLEX_NUMBERS
    elif value.dtype.kind in _REAL:
        too_many = f"an array of {value.size} numbers: more than {MOST_NUMBERS} are not read"
        yield path, value if value.size <= MOST_NUMBERS else too_many
    elif depth == _DEEPEST or (path.endswith("}") and not value.dtype.names):
        yield path, "cells within cells"
    elif value.size > MOST_CURVES:
        yield path, f"a row of {value.size} cells or structs: more than {MOST_CURVES} are not read"
    else:
        for k, element in enumerate(value.ravel(order="F"), 1):
            if not value.dtype.names:
                yield from _matlab_parts(f"{path}{{{k}}}", element, depth + 1)
            struct = f"{path}({k})" if value.size > 1 else path
            for field in value.dtype.names or ():
                yield from _matlab_parts(f"{struct}/{field}", element[field], depth + 1)


def _numpy_variables(source: Source) -> Arrays:
    """Return the arrays of an .npz file, or the columns of the array in an .npy file: times and radii (n, 2), radii
    alone, or named fields. Raises InputError: no array of numbers, or no such shape."""
    check_limit(source.size, LARGEST_TEXT, "bytes of arrays")
    source.file.seek(0)
    try:
        loaded: Any = np.load(source.file, allow_pickle=False)
    except ValueError as error:
        message = f"the array cannot be read ({error}): save numbers alone, numpy.save(file, numpy.stack([t, R]))"
        raise InputError(message, "tabular.array") from None
    if isinstance(loaded, np.ndarray):
        columns = _columns(loaded)
    else:
        check_limit(sum(part.file_size for part in loaded.zip.infolist()), LARGEST_TEXT, "bytes of arrays")
        columns = dict.fromkeys(loaded.files, np.empty(0, object))
        for name in loaded.files:
            with suppress(ValueError):  # only pickle could read it
                columns[name] = np.asarray(loaded[name])  # of a file that is no array, its bytes
    return {name: column if column.dtype.kind in _REAL else _NO_NUMBERS for name, column in columns.items()}


def _columns(array: np.ndarray) -> dict[str, np.ndarray]:
    if array.dtype.names:
        return {name: array[name] for name in array.dtype.names}
    rows = np.atleast_2d(array.T if array.ndim == 2 and array.shape[1] in (1, 2) else array)
    if rows.ndim != 2 or len(rows) not in (1, 2) or array.dtype.kind not in _REAL:
        found = f"an array {array.shape} of {array.dtype}"
        raise InputError(f"{found}: expected numbers of the shape (n, 2), times and radii", "tabular.array")
    counts = array.dtype.kind in "iu" and bool(np.all(np.diff(rows[0]) == 1))
    return dict(zip(["frame" if counts else "time", "radius"][-len(rows) :], rows, strict=True))


def _hdf5_variables(source: Source) -> Arrays:
    """Return the datasets, what they refer to, and the names of attributes. What a link leads to is not read: a file
    cannot show what lies elsewhere."""
    import h5py  # takes a quarter of a second

    found: Arrays = {}
    count = 0  # of the numbers in all of them
    with h5py.File(source.path, "r") as file:
        if {"problem", "seed", "made_by"} <= file.attrs.keys():
            message = "a part of a training set, which `cavirheo generate` simulated for `train`: no measurement"
            raise InputError(message, "reading.training_set")
        for path, item in local_items(file).items():
            unit, read = _unit(path, item)
            for part, value in _parts(file, path, item, 0) if not path.startswith(_HELD) else ():
                numbers = value if isinstance(value, str) else refusal(value, count) or _numbers(value)
                count += np.size(numbers)
                found[f"{part}{unit}"] = numbers
            found |= _attributes(f"{path}/", item, read)
        found |= _attributes("", file)
    return found


def _unit(path: str, item: Any) -> tuple[str, str]:
    """Return ("_mm", "units") where an attribute names the unit of an array whose name has none, ("", "units") where
    both name one, else ("", ""). Raises InputError: its name has another one."""
    word = path.rpartition("/")[2]
    vocabulary = CURVES if getattr(item, "size", 0) != 1 else STATED
    for name in ("units", "unit"):
        text = _attribute(item, name)
        if isinstance(text, str) and (unit := unit_beside(vocabulary, word, text, "as its attribute")):
            return f"_{unit}" if vocabulary.name(word).unit is None else "", name
    return "", ""


def _attributes(place: str, item: Any, read: str = "") -> Arrays:
    names = [name for name in item.attrs if name != read and not _OF_LIBRARIES.match(name)]
    advice = "an attribute of HDF5 that is no number: save it as a dataset"
    values = {name: _attribute(item, name) for name in names}
    return {
        f"{place}{_ATTRIBUTE}{name}": np.asarray(value) if isinstance(value, int | float) else advice
        for name, value in values.items()
    }


def _attribute(item: Any, name: str) -> Any:
    """Return the only value of an attribute, decoded; None if there is none, or many."""
    if name not in item.attrs or prod(item.attrs.get_id(name).shape or (1,)) != 1:
        return None
    value = np.asarray(item.attrs[name]).item()
    return value.decode("latin-1") if isinstance(value, bytes) else value


def _parts(file: Any, path: str, item: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield (path, dataset of numbers, or what it is) of a dataset, or of what its references name: cells, or fields of
    an array of structs."""
    import h5py

    if not isinstance(item, h5py.Dataset):
        return
    if h5py.check_ref_dtype(item.dtype) is None:
        yield path, _meaning(item) or item
    elif item.shape is None or item.size > MOST_CURVES or depth > _DEEPEST:
        yield path, f"too many references: {item.shape}"
    elif path.endswith("}"):
        yield path, "cells within cells"
    else:
        group, _, name = path.rpartition("/")
        of_structs = "MATLAB_class" not in item.attrs and item.parent.attrs.get("MATLAB_class") == b"struct"
        for k, reference in enumerate(np.ravel(item[()]), 1):
            inner = f"{group}({k})/{name}" if of_structs else f"{path}{{{k}}}"
            referred = file[reference] if reference else None
            if isinstance(referred, h5py.Dataset):
                yield from _parts(file, inner, referred, depth + 1)
            elif referred is not None and referred.attrs.get("MATLAB_class") == b"struct":
                for field, part in local_items(referred).items():
                    yield from _parts(file, f"{inner}/{field}", part, depth + 1)
            else:
                yield inner, "a reference to no array"


def _meaning(item: Any) -> str:
    """Return what a dataset is that holds no real numbers, else ""."""
    if "MATLAB_object_decode" in item.attrs:
        return _AN_OBJECT
    if item.dtype.kind == "c" or (item.dtype.names == ("real", "imag")):
        return _COMPLEX_NUMBERS
    return "" if item.dtype.kind in _REAL and item.attrs.get("MATLAB_class") != b"char" else _NO_NUMBERS


def _numbers(item: Any) -> np.ndarray | str:
    if np.any(item.attrs.get("MATLAB_empty", 0)):
        return np.empty(0)
    try:
        return np.transpose(item[()])
    except OSError as error:  # damaged, or packed by a library that is not installed
        return f"an array that cannot be unpacked ({error})"


def local_items(group: Any) -> dict[str, Any]:
    """Return the groups and datasets in an HDF5 group by their paths, but none to which only a link leads. Raises
    InputError: too many."""
    items: dict[str, Any] = {}

    def add(name: str | bytes, item: Any) -> None:
        # a name that is not UTF-8, which h5py gives as bytes, is Latin-1
        items[name.decode("latin-1") if isinstance(name, bytes) else name] = item
        check_limit(len(items), MOST_NUMBERS // 100, "groups and datasets")

    group.visititems(add)
    return items


def refusal(item: Any, others: int = 0) -> str:
    """Return why a dataset is not read, "" if it may be: it declares more numbers, with `others` or in a chunk, than
    the limit allows; or it has no shape, or takes its numbers from another file."""
    if item.shape is None:
        return "without a shape: it holds nothing"
    if item.external or item.is_virtual:
        return "an array of numbers in another file: copy them into this one"
    size = max(others + prod(item.shape), prod(item.chunks or (0,)))
    if size > MOST_NUMBERS:
        return f"an array of the shape {item.shape}: more than {MOST_NUMBERS} numbers of a file are not read"
    return ""


def _shots(arrays: Arrays) -> tuple[dict[str, dict[str, Name]], Container[str]]:
    """Return (by the group of each shot the names of its arrays, which are in it or outside all shots; the paths of
    arrays with a number for each frame)."""
    names = {path: _name(path, array) for path, array in arrays.items()}
    of_frames = {  # a dict keeps their order
        path: None for path, name in names.items() if name.kind in _OF_FRAMES and _has_frames(path, arrays[path])
    }
    kinds: dict[str, set[str]] = {}  # of each group
    for path in of_frames:
        kinds.setdefault(_group(path), set()).add(names[path].kind)
    with_radii = [group for group, found in kinds.items() if any(found.issuperset(form.kinds) for form in FORMS)]
    if measured := [group for group in with_radii if not _SIMULATED.search(group)]:
        with_radii = measured
        names = {path: Name() if _SIMULATED.search(_group(path)) else name for path, name in names.items()}
    groups = [group for group in with_radii if _group_with_times(group, kinds, with_radii) is not None] or with_radii
    if not groups:
        raise _no_history(arrays)
    inside: dict[str, list[str]] = {group: [] for group in ["", *groups]}  # paths; "": outside all others
    for path in names:
        inside[next(each for each in _with_outer(_group(path)) if each in inside)].append(path)
    outside = [path for path in inside[""] if "" not in groups or path not in of_frames]
    shots: dict[str, dict[str, Name]] = {}
    for group in groups:
        group_of_times = _group_with_times(group, kinds, with_radii)
        here = {path: names[path] for path in [*inside[group], *(outside if group else ())]}
        for path in here.keys() & of_frames.keys():
            if _group(path) != (group_of_times if names[path].kind == "time" else group):
                here[path] = Name()
        shots[group] = here
    return shots, of_frames


def _with_pairs_apart(arrays: Arrays) -> tuple[Arrays, list[str]]:
    """Return the arrays with times and radii for each matrix [t R], if there are no other times, and notes. Raises
    InputError: another matrix of radii has a column that always rises, as only times do."""
    names = {path: _name(path, array) for path, array in arrays.items()}
    if any(name.kind in ("time", "frame") for name in names.values()):
        return arrays, []
    parts: Arrays = {}
    notes = []
    for path, array in arrays.items():
        rows = np.empty((0, 0)) if isinstance(array, str) or np.ndim(array) != 2 else array
        rows = rows.T if rows.shape[0] > rows.shape[1] else rows
        rising = [k for k, row in enumerate(rows) if np.all(np.diff(row) > 0.0)]
        if names[path].kind != "radius" or min(rows.shape) < 2 or not rising:
            parts[path] = array
        elif len(rows) == 2 and len(rising) == 1 and names[path].unit is None:
            place = path.rpartition("/")[0] + "/" if "/" in path else ""
            parts |= {f"{place}time": rows[rising[0]], f"{place}radius": rows[1 - rising[0]]}
            notes.append(f"{path} is taken as times and radii: one of its columns always rises")
        else:
            found = f"{path} has the shape {np.shape(array)}, and a column that always rises, as times do"
            raise InputError(f"{found}: save times and radii as arrays of their own, t and R", "matlab.cells")
    return parts, notes


def _group(path: str) -> str:
    """Return the group of an array; "" is the outermost one."""
    return path.rpartition("/")[0]


def _with_outer(group: str) -> Iterator[str]:
    """Yield the group, then those around it, to the outermost one."""
    yield group
    while group:
        group = _group(group)
        yield group


def _group_with_times(group: str, kinds: Mapping[str, set[str]], with_radii: Iterable[str]) -> str | None:
    """Return the group with the times of a shot: itself, else the nearest one around it without radii; or None."""
    timed = (each for each in _with_outer(group) if "time" in kinds.get(each, ()))
    return next((each for each in timed if each == group or each not in with_radii), None)


def _size(array: np.ndarray | str) -> int:
    """Return how many numbers it holds."""
    return 0 if isinstance(array, str) else array.size


def _has_frames(path: str, array: np.ndarray | str) -> bool:
    """Whether an array may hold a number for each frame; a single number states something, except in a cell."""
    return _size(array) != 1 or _CELL.search(path) is not None


def _name(path: str, array: np.ndarray | str) -> Name:
    """Return what an array is: a single number states something of its group, several are of frames."""
    cell = _CELL.search(path)
    word = _CELL.sub("", path.rpartition("/")[2])
    if word.startswith(_ATTRIBUTE) and isinstance(array, str):
        return Name()
    if not _has_frames(path, array):
        number = _AT_REST.search(word)
        kind, unit, _ = STATED.name(_AT_REST.sub("R", word.removeprefix(_ATTRIBUTE)))
        return Name(kind, unit, number[1] if number else "")
    kind, unit, shot = CURVES.name(_EXPERIMENT.sub("", word))
    if isinstance(array, str):
        unusable = kind not in _ESSENTIAL
    else:
        unusable = array.size <= 2 and not cell and kind not in PER_SHOT
    if unusable or word.lower() == "curve":  # rather a fitted one than labels of shots
        return Name()
    return Name(kind, unit, f"{shot}[{cell[1]}]" if shot and cell else cell[1] if cell else shot)


def _table(group: str, names: dict[str, Name], of_frames: Container[str], arrays: Arrays) -> Table:
    """Return the table of a shot, with a column for each row or column of a matrix."""
    essential = {path: name.kind for path, name in names.items() if name.kind in _ESSENTIAL}
    best: dict[str, int] = {}  # rank of each kind
    for path, kind in essential.items():
        best[kind] = min(_rank(path), best.get(kind, 2))
    names |= {path: Name() for path, kind in essential.items() if _rank(path) > best[kind]}
    form = next(form for form in FORMS if {name.kind for name in names.values()}.issuperset(form.kinds))
    radii = {path: arrays[path] for path, name in names.items() if name.kind in form.kinds}
    sizes = set(map(_size, radii.values()))
    shapes = {path: np.shape(array) for path, array in radii.items()}
    path_of_matrix = next((path for path, shape in shapes.items() if len(shape) == 2 and min(shape) > 1), "")
    matrix = shapes.get(path_of_matrix)
    times = next((arrays[path] for path, name in names.items() if name.kind == "time"), None)
    in_rows = matrix is not None and _in_rows(path_of_matrix, matrix, times)
    shots = len(radii) if matrix is None else matrix[0] if in_rows else matrix[1]
    columns: dict[str, tuple[Name, np.ndarray | str]] = {}  # by title
    for path, name in names.items():
        array = arrays[path]
        if path in of_frames and name.kind not in (*_ESSENTIAL, *PER_SHOT) and _size(array) not in sizes:
            name = Name()
        shape = np.shape(array)
        if name.kind in PER_SHOT and not isinstance(array, str) and 1 < shots == array.size:
            for k, number in enumerate(np.ravel(array), 1):
                columns[f"{path}{{{k}}}"] = name._replace(number=str(k)), number
            continue
        if isinstance(array, str) or matrix is None or path not in of_frames or sorted(shape) != sorted(matrix):
            columns[path] = name, array
            continue
        by_row = in_rows == (shape == matrix)
        for k, row in enumerate(array if by_row else array.T, 1):
            columns[f"{path}{{{k}}}"] = name._replace(number=str(k)), row
    return Table(CURVES, [], [], group, [*columns], arrays=[*columns.values()])


def _rank(path: str) -> int:
    """Return 0 for IMR's Rnew, 1 for an array of an experiment, such as R_exp, 2 for any other."""
    word = _CELL.sub("", path.rpartition("/")[2])
    return 0 if word == "Rnew" else 1 if _EXPERIMENT.search(word) else 2


def _in_rows(path: str, shape: tuple[int, ...], time: np.ndarray | str | None) -> bool:
    """Whether the shots are the rows of a matrix of radii. Raises InputError: it is not clear."""
    rows, columns = shape
    if isinstance(time, np.ndarray) and sorted(time.shape) == sorted(shape):
        numbers = time if time.shape == shape else time.T
        rising = [float(np.mean(np.diff(numbers, axis=axis) > 0)) for axis in (0, 1)]  # padding does not rise
        return (rising[1], columns) > (rising[0], rows)
    length = max(rows, columns) if time is None else _size(time)
    shapes = f"{path} has the shape {shape}" + ("" if time is None else f", and {length} times")
    if length not in shape:
        raise InputError(f"{shapes}: expected as many times as rows or columns", "matlab.cells")
    if rows == columns:
        advice = "give times of the same shape, as repmat(t(:), 1, n) makes them"
        raise InputError(f"{shapes}: are the shots in rows or in columns? {advice}", "matlab.cells")
    return columns == length


def _no_history(arrays: Arrays) -> InputError:
    words = [_CELL.sub("", path) + (f" ({array})" if isinstance(array, str) else "") for path, array in arrays.items()]
    expected = "R and t (m, s), or radius_um and time_us, alone or in a group per shot; MATLAB: save('a.mat', 'R', 't')"
    found = listed(words, _LISTED)
    return InputError(f"no radius history; found: {found}; expected {expected}", "matlab.variables")


def _bdt(arrays: Arrays, density: float, pressure: float, camera: Camera) -> list[RadiusCurve]:
    """Read BDT's cells of R/R_max and t* = t/(R_max sqrt(rho/p)), with R_max of each in RmaxList."""
    others = {path: array for path, array in arrays.items() if _CELL.sub("", path) not in _BDT}
    about = [(Name() if _has_frames(path, array) else _name(path, array), array) for path, array in others.items()]
    facts = stated(Table(CURVES, [], [], titles=[*others], arrays=about))
    density = facts["density"][1] if "density" in facts else density
    pressure = facts["pressure"][1] if "pressure" in facts else pressure
    if not _size(arrays.get(_BDT[2], "")):
        message = "no RmaxList, so radii and times are only known in units of R_max: add R_max of each cell, m"
        raise InputError(message, "matlab.variables")
    maxima = np.ravel(arrays[_BDT[2]], order="F")
    note = f"seconds from t* with R_max of RmaxList, density {density:.6g} kg/m3, {pressure:.6g} Pa"
    count = sum(path.startswith(_BDT[0]) for path in arrays)
    if _BDT[0] in arrays or count != sum(path.startswith(_BDT[1]) for path in arrays):
        raise InputError(f"{_BDT[0]} and {_BDT[1]} are no cells of arrays, as many of both", "matlab.cells")

    def read(k: int) -> list[RadiusCurve]:
        largest = maxima[k] if k < len(maxima) else np.nan
        radius, time = (f"{name}{{{k + 1}}}" for name in _BDT[:2])
        shot = [
            (Name("radius", "m"), _scaled(arrays.get(radius, "missing"), largest)),
            (Name("time", "s"), _scaled(arrays.get(time, "missing"), largest * np.sqrt(density / pressure))),
        ]
        table = Table(CURVES, [], [note], titles=[radius, time, *others], arrays=[*shot, *about])
        curves = [replace(curve, stated_time_of_max=0.0) for curve in read_table(camera, table)]
        return [curve.labelled(warnings=(*curve.warnings, *_density_warning(curve, density))) for curve in curves]

    return read_each([(str(k + 1) if count > 1 else "", k) for k in range(count)], read)


def _scaled(array: np.ndarray | str, factor: float) -> np.ndarray | str:
    """Return an array of numbers times a factor, or why there are none."""
    if isinstance(array, str) or not array.size:
        return array
    return array * factor if factor > 0 else "without a scale: RmaxList has no R_max"


def _density_warning(curve: RadiusCurve, density: float) -> list[Message]:
    """Return a warning if the density seems wrong: the rate is slightly off a round one, at which cameras run."""
    rate = curve.frame_rate
    if rate is None:
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
    if np.ndim(normal) != 2 or np.shape(normal)[0] != _size(largest):
        shapes = f"{np.shape(normal)} and Rmax {np.shape(largest)}"
        raise InputError(f"{_ROWS[0]} has the shape {shapes}: expected an Rmax of each row", "matlab.variables")
    others = {path: array for path, array in arrays.items() if path not in _ROWS[:2]}
    return {_ROWS[0]: np.asarray(normal, float) * np.reshape(largest, (-1, 1)), **others}
