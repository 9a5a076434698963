"""Read the named arrays of HDF5 files, MATLAB 7.3 included; declared sizes are checked before data are read.

MATLAB 7.3 stores arrays transposed, cells as references, a struct as a group, and an array of structs as a group of
references.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from math import prod
from typing import Any

import h5py
import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.named_arrays import Leaf, NoNumbers, Numbers

_REAL = "fiub"  # numpy's dtype kinds of real numbers
_INTERNAL = ("MATLAB_", "CLASS", "NAME", "VERSION", "TITLE", "DIMENSION_", "REFERENCE_", "_Netcdf", "H5PATH", "unit")
_HELD = ("#refs#", "#subsystem#")  # groups in which MATLAB holds what its variables refer to
_ELSEWHERE = NoNumbers("in another file: copy it into this one", "limits.elsewhere")


class Walk:
    """One walk through an open file; `arrays`: its datasets and attributes by their paths. Links to other files and to
    groups are not followed. Raises InputError: there are too many, or, where one is read, it exceeds a limit."""

    def __init__(self, file: Any) -> None:
        self.file = file
        self.arrays: dict[str, Leaf] = {}
        self.numbers_read = 0
        visited = set[int]()
        waiting = [("", file)]
        while waiting:
            path, group = waiting.pop(0)
            if (place := h5py.h5o.get_info(group.id).addr) in visited:
                continue
            visited.add(place)
            self._attributes(path, group)
            for name in group:
                inner = f"{path}/{as_text(name)}".lstrip("/")
                try:
                    item = local_item(group, name)
                except InputError:
                    self.arrays[inner] = _ELSEWHERE
                    continue
                if isinstance(item, h5py.Group) and inner not in _HELD:
                    waiting.append((inner, item))
                elif isinstance(item, h5py.Dataset):
                    self._dataset(inner, item, is_element=group.attrs.get("MATLAB_class") == b"struct")
                elif item is None:
                    self.arrays[inner] = NoNumbers("a link to nothing")
                limits.check(len(self.arrays) + len(waiting), limits.SAMPLES // 100, "groups and datasets")

    def _attributes(self, path: str, item: Any) -> None:
        """Add the attributes of a group or a dataset, but those that libraries and MATLAB write for themselves."""
        for name in item.attrs:
            text = as_text(name)
            if not text.startswith(_INTERNAL):
                stored = item.attrs.get_id(name)
                leaf: Leaf = NoNumbers("no number")
                if stored.dtype.kind in _REAL and prod(stored.shape or ()) == 1:
                    value = np.asarray(item.attrs[name], dtype=np.float64).reshape(1)
                    leaf = Numbers((1,), partial(np.array, value))
                self.arrays[f"{path}@{text}"] = leaf

    def _dataset(self, path: str, item: Any, *, is_element: bool = False, depth: int = 0) -> None:
        """Add a dataset, the columns of one, its cells, or with `is_element` the same field of each of many structs."""
        self._attributes(path, item)
        if h5py.check_ref_dtype(item.dtype) is None:
            for name in [""] if depth else item.dtype.names or [""]:
                self.arrays[f"{path}/{name}" if name else path] = self._leaf(item, name)
        elif item.shape is None or item.size > limits.CURVES or depth > 3:
            self.arrays[path] = NoNumbers(f"too many references: {item.shape}", "limits.curves")
        elif path.endswith("}"):
            self.arrays[path] = NoNumbers("cells within cells")
        else:
            of_structs = is_element and "MATLAB_class" not in item.attrs
            folder, _, name = path.rpartition("/")
            for k, reference in enumerate(np.ravel(item[()]), 1):
                self._referred(f"{folder}({k})/{name}" if of_structs else f"{path}{{{k}}}", reference, depth)

    def _referred(self, path: str, reference: Any, depth: int) -> None:
        """Add what a reference of MATLAB names: an array, or a struct."""
        item = self.file[reference] if reference else None
        if isinstance(item, h5py.Dataset):
            self._dataset(path, item, depth=depth + 1)
        elif isinstance(item, h5py.Group) and item.attrs.get("MATLAB_class") == b"struct":
            for name in item:
                if isinstance(field := local_item(item, name), h5py.Dataset):
                    self._dataset(f"{path}/{as_text(name)}", field, depth=depth + 1)
        else:
            self.arrays[path] = NoNumbers("a reference to no array", "matlab.cells")

    def _leaf(self, item: Any, column: str) -> Leaf:
        """Return the array of a dataset, or of its column, which is not read yet."""
        kind = (item.dtype[column] if column else item.dtype).kind
        attributes = item.attrs
        if item.shape is None:
            return NoNumbers("without a shape: it holds nothing", "limits.no_shape")
        empty = np.asarray(attributes.get("MATLAB_empty", 0))
        if empty.dtype.kind in _REAL and empty.any():
            return Numbers((0,), lambda: np.empty(0))
        if "MATLAB_object_decode" in attributes:
            return NoNumbers("an object: of a table or timetable T save table2struct(T, 'ToScalar', true)")
        if kind == "c":
            return NoNumbers("complex numbers: save real(...) of it")
        if kind not in _REAL or attributes.get("MATLAB_class") == b"char":
            return NoNumbers("no array of numbers: save it as one")
        unit = np.asarray(attributes.get("units", attributes.get("unit", "")))
        text = unit.item() if unit.size == 1 else ""
        unit_text = as_text(text) if isinstance(text, str | bytes) else ""
        return Numbers(item.shape[::-1], partial(self._read, item, column), unit_text)

    def _read(self, item: Any, column: str) -> Floats:
        check_sizes([item], self.numbers_read)
        self.numbers_read += item.size
        return np.asarray(item[column] if column else item[()], dtype=np.float64).T


def check_sizes(items: Iterable[Any], total: int = 0) -> None:
    """Check datasets before they are read. Raises InputError: they declare more samples, with `total` others or in a
    chunk, than the limit allows; or they have no shape, or take their numbers from other files."""
    for item in items:
        name = as_text(item.name or "a dataset")
        require(item.shape is not None, f"{name} has no shape: it holds nothing", "limits.no_shape")
        elsewhere = f"{name} takes its numbers from another file; copy them into this one"
        require(not (item.external or item.is_virtual), elsewhere, "limits.elsewhere")
        total += prod(item.shape)
        for attribute, size in (("chunks", prod(item.chunks or (0,))), ("shape", total)):
            message = f"{name} declares the {attribute} {getattr(item, attribute)}: more than {limits.SAMPLES} samples"
            require(size <= limits.SAMPLES, message, f"limits.{attribute}")


def as_text(name: str | bytes) -> str:
    """Return a group's or dataset's name as text; names that are not UTF-8, which h5py gives as bytes, are Latin-1."""
    return name.decode("latin-1") if isinstance(name, bytes) else name


def local_item(group: Any, name: str | bytes) -> Any:
    """Return group[name], or None if it does not exist. Raises InputError: it is in another file, whatever links lead
    there."""
    links, key = group.id.links, name if isinstance(name, bytes) else name.encode()  # get(getlink=True) needs UTF-8
    link = links.exists(key) and links.get_info(key).type == h5py.h5l.TYPE_EXTERNAL
    item = None if link else group.get(name)
    elsewhere = link or (item is not None and h5py.h5o.get_info(item.id).fileno != h5py.h5o.get_info(group.id).fileno)
    require(not elsewhere, f"{as_text(name)} is in another file; copy it into this one", "limits.elsewhere")
    return item
