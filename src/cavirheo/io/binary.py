"""Files of arrays become named arrays that are not read yet: MATLAB's, HDF5, and the .npy of numpy.

MATLAB's versions 5 to 7 are read here and not by scipy.io, whose compiled reader (scipy 1.17) ends the whole process
with a segmentation fault on some damaged files. Format: MathWorks, "MAT-File Format", level 5: a header of 128 bytes,
then elements (type, length, data) on 8-byte boundaries. Type 15 is a compressed element (deflate), type 14 an array: of
elements for its flags, dimensions, name and content. Version 7.3 is HDF5, with arrays transposed, cells as references,
a struct as a group, and an array of structs as a group of references.
"""

from __future__ import annotations

import struct
import zlib
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

_HEAD_SIZE = 1024  # bytes that contain the header of an array, which ends with its name
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _DEFLATED = 14, 15
_CELL, _STRUCT, _NUMERIC, _OBJECT = 1, 2, range(6, 16), 17  # array classes
_AN_OBJECT = "an object: of a table or timetable T save table2struct(T, 'ToScalar', true)"
_COMPLEX_NUMBERS = "an array of complex numbers: save real(...) of it"
_WORDS = {0: _COMPLEX_NUMBERS, 4: "a text", 5: "a sparse array: save full(...) of it", _OBJECT: _AN_OBJECT}  # by class
_COMPLEX = 0x800  # flag of a complex array
_DEEPEST = 16  # most structs, cells and references within each other
_NO_ELEMENT = (0, b"")
_DAMAGED, _CUT_OFF = "matfile.damaged", "matfile.cut"
_REAL = "fiub"  # numpy's dtype kinds of real numbers
_INTERNAL = ("MATLAB_", "CLASS", "NAME", "VERSION", "TITLE", "DIMENSION_", "REFERENCE_", "_Netcdf", "H5PATH", "unit")
_HELD = ("#refs#", "#subsystem#")  # groups in which MATLAB holds what its variables refer to
_Elements = Iterator[tuple[int, bytes]]


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
        limits.check(source.size, limits.INFLATED, "bytes")
        yield _Version5(source.content).arrays()
    else:
        yield _numpy_arrays(source) if source.kind == "numpy" else {}


def _numpy_arrays(source: Source) -> Arrays:
    """Return the columns of the array in a file of numpy: times and radii (n, 2), radii alone, or named fields. Raises
    InputError: no array of numbers, or no such shape."""
    limits.check(source.size, limits.SHEET, "bytes of an array")
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
    return {
        name: Array(column.shape, partial(column.astype, np.float64))
        if column.ndim == 1 and column.dtype.kind in _REAL
        else no_numbers
        for name, column in columns.items()
    }


class _Version5:
    """A file of MATLAB of version 5 to 7; `left` bytes may still be unpacked."""

    def __init__(self, content: bytes) -> None:
        self.content = content
        self.left = limits.INFLATED
        self.order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")

    def arrays(self) -> Arrays:
        """Return all arrays; numbers are not unpacked before they are read."""
        require(self.order != "", "not a MATLAB file of version 5 to 7: its header of 128 bytes is damaged", _DAMAGED)
        arrays: Arrays = {}
        for kind, data in self._elements(self.content[128:]):
            if kind in (_MATRIX, _DEFLATED) and data:
                self._add(arrays, "", kind, data, 0)
        return arrays

    def _add(self, arrays: Arrays, path: str, kind: int, data: bytes, depth: int) -> None:
        """Add an array under its path, or its name; a struct, or cells, as arrays with longer paths."""
        if not data:  # an empty cell
            arrays[path] = Array((0,))
            return
        head = zlib.decompressobj().decompress(data, _HEAD_SIZE)[8:] if kind == _DEFLATED else data
        array_class, shape, name, _ = self._header(head)
        path = path or name
        if array_class in _NUMERIC:
            arrays[path] = Array(shape, partial(self._numbers, path, kind, data))
        elif array_class == _CELL and path.endswith("}"):
            arrays[path] = Array(problem="cells within cells")
        elif array_class not in (_CELL, _STRUCT) or depth >= _DEEPEST:
            arrays[path] = Array(problem=_WORDS.get(array_class, "an array within many others"))
        else:
            parts = self._header(self._unpacked(path, kind, data))[3]
            count = prod(shape) if array_class == _STRUCT else limits.CURVES + 1
            fields = _fields(parts, self.order) if array_class == _STRUCT else []
            elements = (f"{path}({k})" if count > 1 else path for k in range(1, count + 1))
            of_structs = (f"{element}/{field}" for element in elements for field in fields)
            of_cells = (f"{path}{{{k}}}" for k in range(1, count + 1))
            paths = of_structs if array_class == _STRUCT else of_cells
            for number, (inner, (_, part)) in enumerate(zip(paths, parts, strict=False)):
                limits.check(number // max(len(fields), 1) + 1, limits.CURVES, f"cells or structs of {path}")
                self._add(arrays, inner, _MATRIX, part, depth + 1)

    def _unpacked(self, path: str, kind: int, data: bytes) -> bytes:
        if kind == _MATRIX:
            return data
        inflate = zlib.decompressobj()
        data = inflate.decompress(data, max(self.left, 1))  # 0 would mean no limit
        self.left -= len(data)
        if self.left < 0 or inflate.unconsumed_tail:
            raise InputError(f"{path} unpacks to more than {limits.INFLATED} bytes in all", "limits.unpacked")
        require(inflate.eof, f"{path} is cut off", _CUT_OFF)
        return next(self._elements(data), _NO_ELEMENT)[1]

    def _numbers(self, path: str, kind: int, data: bytes) -> Floats:
        data = self._unpacked(path, kind, data)
        require(bool(data), f"{path} is cut off", _CUT_OFF)
        _, shape, _, parts = self._header(data)
        kind, numbers = next(parts, (9, b""))
        require(kind in _NUMBER_TYPES, f"{path}: numbers of the unknown type {kind}", _DAMAGED)
        item = np.dtype(self.order + _NUMBER_TYPES[kind])
        count = len(numbers) // item.itemsize
        limits.check(count, limits.SAMPLES, f"numbers in {path}")
        if min(shape, default=0) < 0 or prod(shape) != count:
            raise InputError(f"{path}: {count} numbers for an array of the shape {shape}", _DAMAGED)
        return np.frombuffer(numbers, item, count).astype(np.float64).reshape(shape, order="F")

    def _elements(self, data: bytes) -> _Elements:
        """Yield (type, data) of each element."""
        at = 0
        while at + 8 <= len(data):
            kind, length = struct.unpack_from(self.order + "II", data, at)
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

    def _header(self, data: bytes) -> tuple[int, tuple[int, ...], str, _Elements]:
        """Return (class, shape, name, the elements that follow) of an array; class 0 stands for complex numbers."""
        parts = self._elements(data)
        flags = next(parts, _NO_ELEMENT)[1]
        require(len(flags) >= 4, "an array without flags", _DAMAGED)
        bits = struct.unpack_from(self.order + "I", flags)[0]
        array_class = bits & 0xFF
        shape = b"" if array_class == _OBJECT else next(parts, _NO_ELEMENT)[1]  # an object has no dimensions
        require(len(shape) % 4 == 0, "an array without dimensions", _DAMAGED)
        name = next(parts, _NO_ELEMENT)[1].decode("latin-1")
        is_complex = array_class in _NUMERIC and bits & _COMPLEX
        return 0 if is_complex else array_class, struct.unpack(f"{self.order}{len(shape) // 4}i", shape), name, parts


def _fields(parts: _Elements, order: str) -> list[str]:
    """Return the names of the fields of a struct, the first two elements behind its header."""
    (_, length), (_, names) = next(parts, _NO_ELEMENT), next(parts, _NO_ELEMENT)
    size = max(struct.unpack(f"{order}i", length[:4].rjust(4, b"\0"))[0], 1)
    return [names[at : at + size].split(b"\0")[0].decode("latin-1") for at in range(0, len(names), size)]


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
            return Array(problem=_AN_OBJECT)
        if kind == "c":
            return Array(problem=_COMPLEX_NUMBERS)
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
