"""Read the array in a file of numpy (.npy): times and radii (n, 2), radii alone, or records of named fields."""

from __future__ import annotations

from functools import partial

import numpy as np

from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.files import Source
from cavirheo.io.named_arrays import Leaf, NoNumbers, Numbers


def arrays(source: Source) -> dict[str, Leaf]:
    """Return the columns by their names. Raises InputError: no array of numbers, or no such shape."""
    limits.check(source.size, limits.SHEET, "bytes of an array")
    source.file.seek(0)
    try:
        array = np.load(source.file, allow_pickle=False)
    except ValueError as error:
        message = f"the array cannot be read ({error}): save numbers alone, numpy.save(file, numpy.stack([t, R]))"
        raise InputError(message, "tabular.array") from None
    limits.check(array.size, limits.ROWS, "numbers of an array")
    if array.dtype.names:
        return {name: _leaf(array[name]) for name in array.dtype.names}
    columns = np.atleast_2d(array.T if array.ndim == 2 and array.shape[1] in (1, 2) else array)
    message = f"an array {array.shape} of {array.dtype}: expected numbers of the shape (n, 2), times and radii"
    require(columns.ndim == 2 and len(columns) in (1, 2) and array.dtype.kind in "fiu", message, "tabular.array")
    names = ["time", "radius"][-len(columns) :]
    if names[0] == "time" and array.dtype.kind in "iu" and np.all(np.diff(columns[0]) == 1):
        names[0] = "frame"  # whole numbers that count
    return {name: _leaf(column) for name, column in zip(names, columns, strict=True)}


def _leaf(column: np.ndarray) -> Leaf:
    if column.ndim != 1 or column.dtype.kind not in "fiu":
        return NoNumbers("no field of single numbers: save each quantity as one", "tabular.array")
    return Numbers(column.shape, partial(column.astype, np.float64))
