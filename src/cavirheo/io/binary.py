"""Files of arrays become named arrays that are not read yet: MATLAB's, HDF5, and the .npy of numpy.

MATLAB's version 7.3 is HDF5, with arrays transposed, cells as references, a struct as a group, and an array of structs
as a group of references; versions 5 to 7 are read by scipy (matlab.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from math import prod
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.files import Source
from cavirheo.io.matlab import AN_OBJECT, COMPLEX_NUMBERS, read_matlab

_DEEPEST = 16  # most references within each other
_REAL = "fiub"  # numpy's dtype kinds of real numbers
_INTERNAL = ("MATLAB_", "CLASS", "NAME", "VERSION", "TITLE", "DIMENSION_", "REFERENCE_", "_Netcdf", "H5PATH", "unit")
_HELD = ("#refs#", "#subsystem#")  # groups in which MATLAB holds what its variables refer to


@dataclass(frozen=True, eq=False)
class Array:
    """An array that is not read yet. unit: its attribute, or "". problem: why it holds no real numbers, and the code of
    the error where it should be times or radii."""

    shape: tuple[int, ...] = ()
    read: Callable[[], Floats] = lambda: np.empty(0)
    unit: str = ""
    problem: str = ""
    code: str = "matlab.variables"

    @property
    def size(self) -> int:
        return 0 if self.problem else prod(self.shape)

    @cached_property
    def values(self) -> Floats:
        """The numbers, read once. Raises InputError: it holds none, or more than are read."""
        require(not self.problem, f"an array is {self.problem}", self.code)
        return self.read()


Arrays = dict[str, Array]  # by their paths: radius, group/radius, structs(2)/R, cells{3}, group@attribute


@contextmanager
def opened(source: Source) -> Iterator[Arrays]:
    """Give the arrays of a file by their paths (name, struct/field, group/dataset); none of a file of another kind.

    Raises InputError: the file violates its format, or exceeds a limit.
    """
    if source.kind in ("matlab73", "hdf5"):
        import h5py  # takes a quarter of a second

        with h5py.File(source.path, "r") as file:
            yield _Hdf5(file).arrays()
    elif source.kind == "matlab":
        found = read_matlab(source.path).items()
        yield {path: Array(problem=it) if isinstance(it, str) else _array(it) for path, it in found}
    else:
        yield _numpy_arrays(source) if source.kind == "numpy" else {}


def _array(numbers: Any) -> Array:
    return Array(numbers.shape, partial(numbers.astype, np.float64))


def _numpy_arrays(source: Source) -> Arrays:
    """Return the columns of the array in a file of numpy: times and radii (n, 2), radii alone, or named fields. Raises
    InputError: no array of numbers, or no such shape."""
    limits.check(source.size, limits.TEXT, "bytes of an array")
    source.file.seek(0)
    try:
        array = np.load(source.file, allow_pickle=False)
    except ValueError as error:
        message = f"the array cannot be read ({error}): save numbers alone, numpy.save(file, numpy.stack([t, R]))"
        raise InputError(message, "tabular.array") from None
    limits.check(array.size, limits.ROWS, "numbers of an array")
    if array.dtype.names:
        columns = {name: array[name] for name in array.dtype.names}
    else:
        rows = np.atleast_2d(array.T if array.ndim == 2 and array.shape[1] in (1, 2) else array)
        if rows.ndim != 2 or len(rows) not in (1, 2) or array.dtype.kind not in _REAL:
            found = f"an array {array.shape} of {array.dtype}"
            raise InputError(f"{found}: expected numbers of the shape (n, 2), times and radii", "tabular.array")
        counts = array.dtype.kind in "iu" and bool(np.all(np.diff(rows[0]) == 1))
        columns = dict(zip(["frame" if counts else "time", "radius"][-len(rows) :], rows, strict=True))
    no_numbers = Array(problem="no field of single numbers: save each quantity as one", code="tabular.array")
    usable = {name: column.ndim == 1 and column.dtype.kind in _REAL for name, column in columns.items()}
    return {name: _array(column) if usable[name] else no_numbers for name, column in columns.items()}


class _Hdf5:
    """An open HDF5 file. What a link leads to is not read: a file cannot show what lies elsewhere."""

    def __init__(self, file: Any) -> None:
        self.file = file
        self.numbers_read = 0

    def arrays(self) -> Arrays:
        """Return its datasets, their columns, what they refer to, and attributes."""
        arrays: Arrays = {}
        self._add_attributes(arrays, "", self.file)
        for path, item in local_items(self.file).items():
            if not path.startswith(_HELD):
                self._add(arrays, path, item, 0)
        return arrays

    def _add_attributes(self, arrays: Arrays, path: str, item: Any) -> None:
        """Add the attributes of a group or a dataset, but those that libraries and MATLAB write for themselves."""
        for name in item.attrs:
            text = as_text(name)
            if text.startswith(_INTERNAL):
                continue
            stored = item.attrs.get_id(name)
            arrays[f"{path}@{text}"] = Array(problem="no number")
            if stored.dtype.kind in _REAL and prod(stored.shape or ()) == 1:
                value = np.asarray(item.attrs[name], dtype=np.float64).reshape(1)
                arrays[f"{path}@{text}"] = Array((1,), partial(np.array, value))

    def _add(self, arrays: Arrays, path: str, item: Any, depth: int) -> None:
        """Add a dataset, or its columns, or what its references name: cells, or fields of an array of structs."""
        import h5py

        self._add_attributes(arrays, path, item)
        if not isinstance(item, h5py.Dataset):
            return
        if h5py.check_ref_dtype(item.dtype) is None:
            for name in (item.dtype.names if depth == 0 else None) or [""]:
                arrays[f"{path}/{name}" if name else path] = self._array(item, name)
            return
        if item.shape is None or item.size > limits.CURVES or depth > _DEEPEST:
            arrays[path] = Array(problem=f"too many references: {item.shape}", code="limits.curves")
            return
        if path.endswith("}"):
            arrays[path] = Array(problem="cells within cells")
            return
        group, _, name = path.rpartition("/")
        of_structs = "MATLAB_class" not in item.attrs and item.parent.attrs.get("MATLAB_class") == b"struct"
        for k, reference in enumerate(np.ravel(item[()]), 1):
            inner = f"{group}({k})/{name}" if of_structs else f"{path}{{{k}}}"
            referred = self.file[reference] if reference else None
            if isinstance(referred, h5py.Dataset):
                self._add(arrays, inner, referred, depth + 1)
            elif referred is not None and referred.attrs.get("MATLAB_class") == b"struct":
                for field, part in local_items(referred).items():
                    self._add(arrays, f"{inner}/{field}", part, depth + 1)
            else:
                arrays[inner] = Array(problem="a reference to no array", code="matlab.cells")

    def _array(self, item: Any, column: str) -> Array:
        """Return the array of a dataset, or of its column, which is not read yet."""
        kind = (item.dtype[column] if column else item.dtype).kind
        attributes = item.attrs
        if item.shape is None:
            return Array(problem="without a shape: it holds nothing", code="limits.no_shape")
        empty = np.asarray(attributes.get("MATLAB_empty", 0))
        if empty.dtype.kind in _REAL and empty.any():
            return Array((0,))
        if "MATLAB_object_decode" in attributes:
            return Array(problem=AN_OBJECT)
        if kind == "c":
            return Array(problem=COMPLEX_NUMBERS)
        if kind not in _REAL or attributes.get("MATLAB_class") == b"char":
            return Array(problem="no array of numbers: save it as one")
        unit = np.asarray(attributes.get("units", attributes.get("unit", "")))
        text = unit.item() if unit.size == 1 else ""
        unit_text = as_text(text) if isinstance(text, str | bytes) else ""
        return Array(item.shape[::-1], partial(self._numbers, item, column), unit_text)

    def _numbers(self, item: Any, column: str) -> Floats:
        check_sizes([item], self.numbers_read)
        self.numbers_read += item.size
        return np.asarray(item[column] if column else item[()], dtype=np.float64).T


def local_items(group: Any) -> dict[str, Any]:
    """Return the groups and datasets in an HDF5 group by their paths, but none to which only a link leads. Raises
    InputError: too many."""
    items: dict[str, Any] = {}

    def add(name: str | bytes, item: Any) -> None:
        items[as_text(name)] = item
        limits.check(len(items), limits.SAMPLES // 100, "groups and datasets")

    group.visititems(add)
    return items


def check_sizes(items: Iterable[Any], total: int = 0) -> None:
    """Check datasets before they are read. Raises InputError: they declare more samples, with `total` others or in a
    chunk, than the limit allows; or they have no shape, or take their numbers from other files."""
    for item in items:
        name = as_text(item.name or "a dataset")
        require(item.shape is not None, f"{name} has no shape: it holds nothing", "limits.no_shape")
        if item.external or item.is_virtual:
            raise InputError(f"{name} takes its numbers from another file; copy them into this one", "limits.elsewhere")
        total += prod(item.shape)
        for attribute, size in (("chunks", prod(item.chunks or (0,))), ("shape", total)):
            if size > limits.SAMPLES:
                declared = f"{name} declares the {attribute} {getattr(item, attribute)}"
                raise InputError(f"{declared}: more than {limits.SAMPLES} samples", f"limits.{attribute}")


def as_text(name: str | bytes) -> str:
    """Return a group's or dataset's name as text; names that are not UTF-8, which h5py gives as bytes, are Latin-1."""
    return name.decode("latin-1") if isinstance(name, bytes) else name
