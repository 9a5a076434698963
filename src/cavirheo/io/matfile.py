"""The numbers in a MATLAB file of version 5 to 7: numeric arrays and cells of them, checked at every step.

Not scipy.io: its compiled reader (scipy 1.17) ends the whole process with a segmentation fault on some damaged files,
which no message can mend. Format: MathWorks, "MAT-File Format", level 5: a header of 128 bytes, then elements (type,
length, data) on 8-byte borders; type 15 is a deflated element, type 14 an array made of elements for its flags,
dimensions, name and numbers.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Container, Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.errors import require
from cavirheo.io import limits

_HEAD = 1024  # bytes that hold the header of an array, its name at the end
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _DEFLATED = 14, 15
_CELL, _NUMERIC = 1, range(6, 16)  # array classes
_COMPLEX = 0x800  # a flag
_NOTHING = (0, b"")  # no element
_DAMAGED, _CUT = "matfile.damaged", "matfile.cut"


def read_matfile(path: Path, names_wanted: Container[str]) -> tuple[dict[str, Any], list[str]]:
    """(numeric variables of the wanted names, names of all): an array as (…,) float64, a cell array as a list of its
    numeric cells in MATLAB's order, each flat; other cells are empty arrays.

    Raises InputError: the file breaks its own format, or holds more than is read.
    """
    limits.few(path.stat().st_size, limits.INFLATED, "bytes")
    content = path.read_bytes()
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128], "")
    require(order != "", "not a MATLAB file of version 5 to 7: its header of 128 bytes is damaged", _DAMAGED)
    left = limits.INFLATED
    variables: dict[str, Any] = {}
    names: list[str] = []
    for kind, data in _elements(content[128:], order):
        if kind not in (_MATRIX, _DEFLATED) or not data:
            continue
        inflate = zlib.decompressobj()
        head = inflate.decompress(data, _HEAD) if kind == _DEFLATED else data
        name = _header(head[8:] if kind == _DEFLATED else head, order)[2]
        names += [name] if name else []
        if name not in names_wanted:
            continue
        if kind == _DEFLATED:
            data = head + inflate.decompress(inflate.unconsumed_tail, max(left, 1))  # 0 would be no limit
            left -= len(data)
            most = f"{name} unpacks to more than {limits.INFLATED} bytes in all"
            require(left >= 0 and not inflate.unconsumed_tail, most, "limits.unpacked")
            require(inflate.eof, f"{name} is cut off", _CUT)
            kind, data = next(_elements(data, order), _NOTHING)
        if kind == _MATRIX and (value := _value(data, order, name)) is not None:
            variables[name] = value
    return variables, names


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """(type, data) of the elements one after the other."""
    at = 0
    while at + 8 <= len(data):
        kind, length = struct.unpack_from(order + "II", data, at)
        if kind >> 16:  # small element: both numbers share the first four bytes, the data fills the other four
            kind, length, start, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            require(length <= 4, f"damaged at byte {at}: a small element of {length} bytes", _DAMAGED)
        else:
            start = at + 8
            after = start + length + (0 if kind == _DEFLATED else -length % 8)
        left = len(data) - start
        require(length <= left, f"cut off: an element of {length} bytes begins where {left} are left", _CUT)
        yield kind, data[start : start + length]
        at = after


def _header(data: bytes, order: str) -> tuple[int, tuple[int, ...], str, Iterator[tuple[int, bytes]]]:
    """(class, shape, name, the elements that follow) of one array."""
    parts = _elements(data, order)
    flags, shape, name = (next(parts, _NOTHING)[1] for _ in range(3))
    require(len(flags) >= 4 and len(shape) % 4 == 0, "an array without flags or dimensions", _DAMAGED)
    bits = struct.unpack_from(order + "I", flags)[0]
    array_class = 0 if bits & _COMPLEX else bits & 0xFF
    return array_class, struct.unpack(f"{order}{len(shape) // 4}i", shape), name.decode("latin-1"), parts


def _value(data: bytes, order: str, name: str = "") -> Any:
    """The numbers of an array, or a list of those of the cells of a cell array; None where it is neither. A cell has no
    name, and cells in it hold nothing that is read."""
    if not data:
        return np.empty(0)  # how an empty cell is written
    array_class, shape, _, parts = _header(data, order)
    if array_class == _CELL and name:
        arrays: list[Any] = []
        for kind, part in parts:
            if kind == _MATRIX:
                value = _value(part, order)
                arrays.append(np.empty(0) if value is None else value.ravel(order="F"))
                limits.few(len(arrays), limits.CURVES, f"cells of {name}")
        return arrays
    if array_class not in _NUMERIC:
        return None
    kind, numbers = next(parts, (9, b""))
    label = name or "a cell"
    require(kind in _NUMBERS, f"{label}: numbers of the unknown type {kind}", _DAMAGED)
    item = np.dtype(order + _NUMBERS[kind])
    count = len(numbers) // item.itemsize
    limits.few(count, limits.SAMPLES, f"numbers in {label}")
    fits = min(shape, default=0) >= 0 and prod(shape) == count
    require(fits, f"{label}: {count} numbers for an array of the shape {shape}", _DAMAGED)
    return np.frombuffer(numbers, item, count).astype(np.float64).reshape(shape, order="F")
