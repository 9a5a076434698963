"""Files of arrays become named arrays: MATLAB's, HDF5, and the .npy and .npz of numpy.

MATLAB's version 7.3 is HDF5, with arrays transposed, cells as references, a struct as a group, and an array of structs
as a group of references.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.errors import InputError
from cavirheo.io import apart, limits
from cavirheo.io.files import Source

Arrays = dict[str, np.ndarray | str]  # by their paths: radius, group/radius, structs(2)/R, cells{3}; or what they are
_DEEPEST = 16  # most references, structs or cells within each other
_REAL = "fiub"  # numpy's dtype kinds of real numbers
_HELD = ("#refs#", "#subsystem#")  # groups in which MATLAB holds what its variables refer to
_AN_OBJECT = "an object: of a table or timetable T save table2struct(T, 'ToScalar', true)"
_COMPLEX_NUMBERS = "an array of complex numbers: save real(...) of it"
_NO_NUMBERS = "no array of numbers: save it as one"
ATTRIBUTE = "@"  # before the name of an attribute of HDF5 in a path; attributes are named, and not read
_OF_LIBRARIES = re.compile(r"MATLAB|_|[A-Z_0-9]+$")  # attributes that MATLAB, netCDF and PyTables write


def read_variables(source: Source) -> Arrays:
    """Return the arrays of numbers of a file by their paths (name, struct/field, group/dataset), and for any other
    variable a text that says what it is.

    Raises InputError: the file violates its format, or exceeds a limit.
    """
    if source.kind in ("matlab73", "hdf5"):
        return _hdf5_variables(source)
    if source.kind == "matlab":
        return _read_matlab(source.path)
    return _numpy_variables(source)


def _read_matlab(path: Path) -> Arrays:
    """Read a file of MATLAB of version 5 to 7, by scipy in a process of its own: scipy 1.17 ends it with a segmentation
    fault for some damaged files. Raises InputError: as `apart.call`."""
    found = apart.call(_matlab_variables, str(path.absolute()), memory=limits.MEMORY, seconds=limits.SECONDS)
    assert isinstance(found, dict)
    return found


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
        too_many = f"an array of {value.size} numbers: more than {limits.SAMPLES} are not read"
        yield path, value if value.size <= limits.SAMPLES else too_many
    elif depth == _DEEPEST or (path.endswith("}") and not value.dtype.names):
        yield path, "cells within cells"
    elif value.size > limits.CURVES:
        yield path, f"a row of {value.size} cells or structs: more than {limits.CURVES} are not read"
    else:
        for k, element in enumerate(value.ravel(order="F"), 1):
            if not value.dtype.names:
                yield from _matlab_parts(f"{path}{{{k}}}", element, depth + 1)
            for field in value.dtype.names or ():
                inner = f"{path}({k})" if value.size > 1 else path
                yield from _matlab_parts(f"{inner}/{field}", element[field], depth + 1)


def _numpy_variables(source: Source) -> Arrays:
    """Return the arrays of an .npz file, or the columns of the array in an .npy file: times and radii (n, 2), radii
    alone, or named fields. Raises InputError: no array of numbers, or no such shape."""
    limits.check(source.size, limits.TEXT, "bytes of arrays")
    source.file.seek(0)
    try:
        loaded: Any = np.load(source.file, allow_pickle=False)
    except ValueError as error:
        message = f"the array cannot be read ({error}): save numbers alone, numpy.save(file, numpy.stack([t, R]))"
        raise InputError(message, "tabular.array") from None
    if isinstance(loaded, np.ndarray):
        columns = _columns(loaded)
    else:
        limits.check(sum(part.file_size for part in loaded.zip.infolist()), limits.TEXT, "bytes of arrays")
        columns = {name: _without_objects(loaded, name) for name in loaded.files}
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


def _without_objects(archive: Mapping[str, np.ndarray], name: str) -> np.ndarray:
    """Return an array; an empty one of objects for one that only pickle could read."""
    try:
        return np.asarray(archive[name])  # of a file that is no array, its bytes
    except ValueError:
        return np.empty(0, object)


def _hdf5_variables(source: Source) -> Arrays:
    """Return the datasets, what they refer to, and the names of attributes. What a link leads to is not read: a file
    cannot show what lies elsewhere."""
    import h5py  # takes a quarter of a second

    found: Arrays = {}
    count = 0  # of the numbers in all of them
    with h5py.File(source.path, "r") as file:
        for path, item in local_items(file).items():
            for part, value in _parts(file, path, item, 0) if not path.startswith(_HELD) else ():
                found[part] = value if isinstance(value, str) else refusal(value, count) or _numbers(value)
                count += np.size(found[part])
            found |= _attributes(f"{path}/", item)
        found |= _attributes("", file)
    return found


def _attributes(place: str, item: Any) -> Arrays:
    names = [name for name in item.attrs if not _OF_LIBRARIES.match(name)]
    return {f"{place}{ATTRIBUTE}{name}": "an attribute of HDF5: save it as a dataset" for name in names}


def _parts(file: Any, path: str, item: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield (path, dataset of numbers, or what it is) of a dataset, or of what its references name: cells, or fields of
    an array of structs."""
    import h5py

    if not isinstance(item, h5py.Dataset):
        return
    if h5py.check_ref_dtype(item.dtype) is None:
        yield path, _meaning(item) or item
    elif item.shape is None or item.size > limits.CURVES or depth > _DEEPEST:
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
        items[_as_text(name)] = item
        limits.check(len(items), limits.SAMPLES // 100, "groups and datasets")

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
    if size > limits.SAMPLES:
        return f"an array of the shape {item.shape}: more than {limits.SAMPLES} numbers of a file are not read"
    return ""


def _as_text(name: str | bytes) -> str:
    """Return a group's or dataset's name as text; names that are not UTF-8, which h5py gives as bytes, are Latin-1."""
    return name.decode("latin-1") if isinstance(name, bytes) else name
