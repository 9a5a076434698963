"""Files -> groups of (R_max, lambda, t_1): tables of collapse times, and radius histories whose t_1 is read off.

A text table or the first sheet of an .xlsx has a header `rmax_um,stretch,t1_us` (m, mm, um, nm; s, ms, us, ns; also
`R_max [m]`, `lambda`, `t_1 (s)`, `collapse time (us)`; a column `shot` names the rows). A .mat table is the variable
`pIMR_array` (n, 3) in m, 1, s. Anything else is read as curves. Units are read, never guessed.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.beside.collapse_times.document import CollapseGroup, CollapseShot
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.collapse_time import shot, unusable
from cavirheo.physics.media import Medium
from cavirheo.reading import limits
from cavirheo.reading.matfile import read_matfile
from cavirheo.reading.shots import read_shots
from cavirheo.reading.spreadsheet import sheets
from cavirheo.reading.table import Rows, decimal_point, is_number, text_of

VARIABLE = "pIMR_array"
_TITLES = {
    **dict.fromkeys(("rmax", "maxradius", "maximumradius", "largestradius"), "max_radius"),
    **dict.fromkeys(("stretch", "lambda", "λ", "lmax", "lambdamax", "λmax", "rmaxr0", "rmaxreq"), "stretch"),
    **dict.fromkeys(("t1", "collapsetime", "tcollapse", "firstcollapse"), "time"),
    **dict.fromkeys(("shot", "curve", "name"), "name"),
}  # fmt: skip
_UNITS: dict[str, dict[str, float]] = {
    "max_radius": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
_SHOWN = {"max_radius": "R_max", "time": "t_1", "stretch": "lambda"}
_EXPECTED = "expected a header such as rmax_um,stretch,t1_us"


def read_groups(
    files: Sequence[str | Path], medium: Medium, stretch: float | None = None
) -> tuple[list[CollapseGroup], list[str]]:
    """(the groups of all files in their order, the reason for each file that could not be read).

    `stretch` is for curves, and for tables without a column of it. Every row and curve of a file is in its group,
    those that cannot be used with the reason.
    """
    groups: list[CollapseGroup] = []
    problems: list[str] = []
    curves: list[str | Path] = []
    for path in map(Path, files):
        try:
            table = read_table(path, stretch)
        except InputError as error:
            problems.append(f"{path}: {error}")
            continue
        if table is None:
            curves.append(path)
        else:
            groups.append(table)
    found, unread = read_shots(curves, density=medium.density, pressure=medium.pressure) if curves else ([], [])
    members: dict[tuple[str, str], list[RadiusCurve]] = {}
    for curve in found:
        source = str(curve.meta.get("group_source", curve.meta["source"]))
        members.setdefault((str(curve.meta["group"]), source), []).append(curve)
    for (name, source), shots in members.items():
        sha256 = str(shots[0].meta["source_sha256"]) if "group_source" not in shots[0].meta else ""
        notes = [f"{curve.name}: {note}" for curve in shots for note in curve.notes if "CHECK" in note]
        groups.append(_group(name, source, sha256, [_read_off(curve, stretch) for curve in shots], notes))
    return groups, problems + unread


def _group(name: str, source: str, sha256: str, shots: list[CollapseShot], notes: list[str]) -> CollapseGroup:
    unusable = sum(bool(shot.message) for shot in shots)
    return CollapseGroup(
        name=name, source=source, source_sha256=sha256, n=len(shots), unusable=unusable, notes=notes, shots=shots
    )


def _read_off(curve: RadiusCurve, stretch: float | None) -> CollapseShot:
    try:
        found, origin = shot(curve, stretch)
    except InputError as error:
        return CollapseShot(name=curve.name, message=str(error).removeprefix(f"{curve.name}: "))
    radius, ratio, time = found.max_radius[0], found.stretch[0], found.time[0]
    return CollapseShot(name=curve.name, max_radius_m=radius, stretch=ratio, collapse_time_s=time, stretch_from=origin)


def read_table(path: Path, stretch: float | None = None) -> CollapseGroup | None:
    """The table of collapse times in a file, or None where the file holds none and may hold curves.

    Raises:
        InputError: a table without a unit, with a cell that is no number, or a damaged file.
    """
    if not path.is_file():
        return None  # the reader of curves says what is wrong
    content = path.read_bytes()
    notes: list[str] = []
    if (array := _variable(path, content)) is not None:
        if array.ndim != 2 or 3 not in array.shape or not array.size:
            raise InputError(f"{VARIABLE} must be (n, 3): R_max in m, lambda, t_1 in s; got the shape {array.shape}")
        values = array if array.shape[1] == 3 else array.T
        cells: dict[str, Any] = {"max_radius": values[:, 0], "stretch": values[:, 1], "time": values[:, 2]}
        notes.append(f"variable {VARIABLE}: R_max in m, lambda, t_1 in s")
    elif (rows := _rows(path, content)) and (parsed := _columns(rows, stretch is not None)) is not None:
        cells = parsed
    else:
        return None
    origin = "table"
    if "stretch" not in cells:
        cells["stretch"], origin = np.full(len(cells["time"]), stretch), "given"
    elif stretch is not None:
        notes.append("lambda of the table used, not the one given")
    names = cells.get("name") or [str(k) for k in range(1, len(cells["time"]) + 1)]
    shots = []
    for k, name in enumerate(names):
        radius, ratio, time = (float(cells[key][k]) for key in ("max_radius", "stretch", "time"))
        message = unusable(radius, ratio, time)
        shots.append(
            CollapseShot(
                name=name,
                max_radius_m=radius,
                stretch=ratio,
                collapse_time_s=time,
                stretch_from=origin,
                message=message,
            )
        )
    return _group(path.stem, str(path), hashlib.sha256(content).hexdigest(), shots, notes)


def _variable(path: Path, content: bytes) -> np.ndarray | None:
    """The array of a .mat of any version; None where there is none."""
    if content.startswith(b"MATLAB 7.3"):
        import h5py

        try:
            with h5py.File(path, "r") as file:
                item = limits.own(file, VARIABLE)
                if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
                    limits.arrays([item])
                    return np.asarray(item[()], dtype=float).T
        except OSError:
            pass
        return None
    if content[124:128] not in (b"\x00\x01IM", b"\x01\x00MI"):
        return None
    try:
        value = read_matfile(path, (VARIABLE,))[0].get(VARIABLE)
    except Exception:  # damaged: the reader of curves says how
        return None
    return value if isinstance(value, np.ndarray) else None


def _rows(path: Path, content: bytes) -> Rows:
    """Rows of cells of the first sheet, or of text by the first separator that gives its header several cells."""
    if content.startswith(b"PK\x03\x04"):
        try:
            return sheets(path, 1)[0]
        except Exception:  # of a damaged workbook: the reader of curves reports it
            return []
    if b"\x00" in content[:1024]:
        return []
    lines = [line for line in text_of(content).splitlines() if line.strip() and not line.lstrip().startswith("%")]
    while len(lines) > 1 and lines[0].startswith("#") and lines[1].startswith("#"):
        lines = lines[1:]
    lines = [line.removeprefix("#").strip() if k == 0 else line for k, line in enumerate(lines)]
    lines = [line for line in lines if not line.startswith("#")]
    if not lines:
        return []
    delimiter = next((d for d in "\t;," if d in lines[0]), None)
    if delimiter is None:
        return [line.split() for line in lines]
    rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=delimiter)]
    return [[decimal_point(cell) for cell in row] for row in rows] if delimiter != "," else rows


def title(text: str) -> tuple[str, str]:
    """("max_radius" | "stretch" | "time" | "name" | "", unit or "") of a column such as `R_max [um]` or `t1_us`."""
    words = [w for w in re.split(r"[\W_]+", text.strip().lower().replace("µ", "u").replace("μ", "u")) if w]
    if len(words) > 1 and (kind := _TITLES.get("".join(words[:-1]), "")) in _UNITS and words[-1] in _UNITS[kind]:
        return kind, words[-1]
    return _TITLES.get("".join(words), ""), ""


def _columns(rows: Rows, known_stretch: bool) -> dict[str, Any] | None:
    """Columns in SI by name; None where the header is not that of collapse times."""
    at: dict[str, tuple[int, str]] = {}
    for k, text in enumerate(rows[0]):
        kind, unit = title(text)
        if kind in at:
            raise InputError(f"two columns for {_SHOWN.get(kind, kind)} in the header {rows[0]}")
        if kind:
            at[kind] = (k, unit)
    if not {"max_radius", "time"} <= at.keys():
        return None
    for kind in ("max_radius", "time"):
        if not at[kind][1]:
            known = ", ".join(_UNITS[kind])
            raise InputError(f"{rows[0][at[kind][0]]!r} has no unit ({known}); {_EXPECTED}")
    if "stretch" not in at and not known_stretch:
        raise InputError(f"no column for lambda = R_max/R_0; {_EXPECTED}, or give --stretch")
    if len(rows) < 2:
        raise InputError("a header but no rows of data")
    columns: dict[str, Any] = {}
    for kind, (k, unit) in at.items():
        cells = [row[k].strip() if k < len(row) else "" for row in rows[1:]]
        if kind == "name":
            columns[kind] = cells
            continue
        values = np.full(len(cells), np.nan)
        for i, cell in enumerate(cells):
            if not is_number(cell):
                raise InputError(f"row {i + 2}: {cell[:30]!r} is not a number")
            try:
                values[i] = float(cell)
            except ValueError:  # a word for a missing number
                continue
        columns[kind] = values * _UNITS.get(kind, {}).get(unit, 1.0)
    return columns
