"""Read the variables in a file of MATLAB of version 5 to 7, by scipy in a process of its own: scipy 1.17 ends it with a
segmentation fault for some damaged files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.io import apart, limits

AN_OBJECT = "an object: of a table or timetable T save table2struct(T, 'ToScalar', true)"
COMPLEX_NUMBERS = "an array of complex numbers: save real(...) of it"
_DEEPEST = 16  # most structs and cells within each other


def read_matlab(path: Path) -> dict[str, np.ndarray | str]:
    """Return the arrays of numbers by their paths (name, struct/field, structs(2)/field, cells{3}); of what is none, a
    text that says what it is. Raises InputError: as `apart.call`."""
    found = apart.call(_variables, str(path.absolute()), memory=limits.MEMORY, seconds=limits.SECONDS)
    assert isinstance(found, dict)
    return found


def _variables(path: str) -> dict[str, Any]:
    """In the child."""
    from scipy.io import loadmat

    variables = [(name, value) for name, value in loadmat(path).items() if not name.startswith("__")]
    return {part: inner for name, value in variables for part, inner in _parts(name, value, 0)}


def _parts(path: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield (path, array of numbers, or what it is) of a variable and of all that is in it."""
    from scipy.io import matlab
    from scipy.sparse import issparse

    if isinstance(value, matlab.MatlabOpaque | matlab.MatlabFunction):
        yield bytes(value["s0"].item()).decode("latin-1") if path == "None" else path, AN_OBJECT  # scipy loses its name
    elif issparse(value):
        yield path, "a sparse array: save full(...) of it"
    elif isinstance(value, str) or value.dtype.kind not in "fiubcOV":
        yield path, "a text"
    elif value.dtype.kind == "c":
        yield path, COMPLEX_NUMBERS
    elif value.dtype.kind in "fiub":
        too_many = f"an array of {value.size} numbers: more than {limits.SAMPLES} are not read"
        yield path, value if value.size <= limits.SAMPLES else too_many
    elif depth == _DEEPEST or (path.endswith("}") and not value.dtype.names):
        yield path, "cells within cells"
    elif value.size > limits.CURVES:
        yield path, f"a row of {value.size} cells or structs: more than {limits.CURVES} are not read"
    else:
        for k, element in enumerate(value.ravel(order="F"), 1):
            if not value.dtype.names:
                yield from _parts(f"{path}{{{k}}}", element, depth + 1)
            for field in value.dtype.names or ():
                inner = f"{path}({k})" if value.size > 1 else path
                yield from _parts(f"{inner}/{field}", element[field], depth + 1)
