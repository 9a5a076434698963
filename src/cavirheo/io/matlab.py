"""Read the named arrays of MATLAB files, those in structs and cells included.

Versions 5 to 7 are read here and not by scipy.io, whose compiled reader (scipy 1.17) ends the whole process with a
segmentation fault on some damaged files. Format: MathWorks, "MAT-File Format", level 5: a header of 128 bytes, then
elements (type, length, data) on 8-byte boundaries. Type 15 is a compressed element (deflate). Type 14 is an array; it
consists of elements for its flags, dimensions, name and content; an object (class 17) has no dimensions.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from math import prod

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.files import Source
from cavirheo.io.named_arrays import Leaf, NoNumbers, Numbers

_HEAD_SIZE = 1024  # bytes that contain the header of an array, which ends with its name
_NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _DEFLATED = 14, 15
_CELL, _STRUCT, _NUMERIC, _OBJECT = 1, 2, range(6, 16), 17  # array classes
_WORDS = {  # by class
    0: "an array of complex numbers: save real(...) of it",
    4: "a text",
    5: "a sparse array: save full(...) of it",
    17: "an object: of a table or timetable T save table2struct(T, 'ToScalar', true)",
}
_COMPLEX = 0x800  # flag of a complex array
_DEEPEST = 16  # most structs and cells within each other
_NO_ELEMENT = (0, b"")  # no element
_DAMAGED, _CUT_OFF = "matfile.damaged", "matfile.cut"
_Elements = Iterator[tuple[int, bytes]]


@contextmanager
def opened(source: Source) -> Iterator[dict[str, Leaf]]:
    """Give the arrays of a MATLAB or HDF5 file by their paths (name, struct/field, group/dataset); none of others.

    Raises InputError: the file violates its format, or exceeds a limit.
    """
    if source.kind in ("matlab73", "hdf5"):
        import h5py  # takes a quarter of a second

        from cavirheo.io.hdf5 import Walk

        with h5py.File(source.path, "r") as file:
            yield Walk(file).arrays
    else:
        yield _Version5(source).arrays() if source.kind == "matlab" else {}


class _Version5:
    """A file of version 5 to 7; `left` bytes may still be unpacked."""

    def __init__(self, source: Source) -> None:
        limits.check(source.size, limits.INFLATED, "bytes")
        self.content = source.content
        self.left = limits.INFLATED
        self.order = {b"IM": "<", b"MI": ">"}.get(self.content[126:128], "")
        require(self.order != "", "not a MATLAB file of version 5 to 7: its header of 128 bytes is damaged", _DAMAGED)

    def arrays(self) -> dict[str, Leaf]:
        """Return all arrays; numbers are not unpacked before they are read."""
        arrays: dict[str, Leaf] = {}
        for kind, data in _elements(self.content[128:], self.order):
            if kind not in (_MATRIX, _DEFLATED) or not data:
                continue
            head = zlib.decompressobj().decompress(data, _HEAD_SIZE)[8:] if kind == _DEFLATED else data
            array_class, shape, name, _ = _header(head, self.order)
            if name and array_class in _NUMERIC:
                arrays[name] = Numbers(shape, partial(self._numbers, name, kind, data))
            elif name:
                self._add(arrays, name, self._unpacked(name, kind, data), 0)
        return arrays

    def _unpacked(self, name: str, kind: int, data: bytes) -> bytes:
        if kind == _MATRIX:
            return data
        inflate = zlib.decompressobj()
        data = inflate.decompress(data, max(self.left, 1))  # 0 would mean no limit
        self.left -= len(data)
        if self.left < 0 or inflate.unconsumed_tail:
            raise InputError(f"{name} unpacks to more than {limits.INFLATED} bytes in all", "limits.unpacked")
        require(inflate.eof, f"{name} is cut off", _CUT_OFF)
        return next(_elements(data, self.order), _NO_ELEMENT)[1]

    def _add(self, arrays: dict[str, Leaf], name: str, data: bytes, depth: int) -> None:
        """Add an array under its name; a struct, or cells with structs, as arrays with longer names."""
        if not data:  # an empty cell
            arrays[name] = Numbers((0,), lambda: np.empty(0))
            return
        array_class, shape, _, parts = _header(data, self.order)
        if array_class in _NUMERIC:
            arrays[name] = Numbers(shape, partial(self._numbers, name, _MATRIX, data))
        elif array_class == _STRUCT and depth < _DEEPEST:
            (_, length), (_, names) = next(parts, _NO_ELEMENT), next(parts, _NO_ELEMENT)
            size = max(struct.unpack(f"{self.order}i", length[:4].rjust(4, b"\0"))[0], 1)
            fields = [names[at : at + size].split(b"\0")[0].decode("latin-1") for at in range(0, len(names), size)]
            elements = [f"{name}({k + 1})" if prod(shape) > 1 else name for k in range(min(prod(shape), limits.CURVES))]
            paths = (f"{element}/{field}" for element in elements for field in fields)
            for path, (_, part) in zip(paths, parts, strict=False):
                self._add(arrays, path, part, depth + 1)
            limits.check(prod(shape), limits.CURVES, f"elements of {name}")
        elif array_class == _CELL and name.endswith("}"):
            arrays[name] = NoNumbers("cells within cells")
        elif array_class == _CELL and depth < _DEEPEST:
            for k, (_, part) in enumerate(parts, 1):
                limits.check(k, limits.CURVES, f"cells of {name}")
                self._add(arrays, f"{name}{{{k}}}", part, depth + 1)
        else:
            arrays[name] = NoNumbers(_WORDS.get(array_class, "an array within many others"))

    def _numbers(self, name: str, kind: int, data: bytes) -> Floats:
        data = self._unpacked(name, kind, data)
        require(bool(data), f"{name} is cut off", _CUT_OFF)
        _, shape, _, parts = _header(data, self.order)
        kind, numbers = next(parts, (9, b""))
        require(kind in _NUMBER_TYPES, f"{name}: numbers of the unknown type {kind}", _DAMAGED)
        item = np.dtype(self.order + _NUMBER_TYPES[kind])
        count = len(numbers) // item.itemsize
        limits.check(count, limits.SAMPLES, f"numbers in {name}")
        if min(shape, default=0) < 0 or prod(shape) != count:
            raise InputError(f"{name}: {count} numbers for an array of the shape {shape}", _DAMAGED)
        return np.frombuffer(numbers, item, count).astype(np.float64).reshape(shape, order="F")


def _elements(data: bytes, order: str) -> _Elements:
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


def _header(data: bytes, order: str) -> tuple[int, tuple[int, ...], str, _Elements]:
    """Return (class, shape, name, the elements that follow) of an array; class 0 stands for complex numbers."""
    parts = _elements(data, order)
    flags = next(parts, _NO_ELEMENT)[1]
    require(len(flags) >= 4, "an array without flags", _DAMAGED)
    bits = struct.unpack_from(order + "I", flags)[0]
    array_class = bits & 0xFF
    shape = b"" if array_class == _OBJECT else next(parts, _NO_ELEMENT)[1]
    require(len(shape) % 4 == 0, "an array without dimensions", _DAMAGED)
    name = next(parts, _NO_ELEMENT)[1].decode("latin-1")
    plain = array_class not in _NUMERIC or not bits & _COMPLEX
    return array_class if plain else 0, struct.unpack(f"{order}{len(shape) // 4}i", shape), name, parts
