"""Files -> groups of (R_max, lambda, t_1): tables of collapse times, and radius histories whose t_1 is read off.

A text table or the first sheet of a workbook has a header `rmax_um,stretch,t1_us` (m, mm, um, nm; s, ms, us, ns; also
`R_max [m]`, `lambda`, `t_1 (s)`, `collapse time (us)`; a column `shot` names the rows). A .mat table is the variable
`pIMR_array` (n, 3) in m, 1, s. Anything else is read as curves. Units are read, never guessed.
"""

from __future__ import annotations

import hashlib
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
from cavirheo.reading.tabular import Row, column_of, numbers, read_sheets, refuse_wider

VARIABLE = "pIMR_array"
_TITLES = {
    **dict.fromkeys(("rmax", "maxradius", "maximumradius", "largestradius"), "max_radius"),
    **dict.fromkeys(("stretch", "lambda", "λ", "lmax", "lambdamax", "λmax", "rmaxr0", "rmaxreq"), "stretch"),
    **dict.fromkeys(("t1", "collapsetime", "tcollapse", "firstcollapse"), "time"),
    **dict.fromkeys(("shot", "curve", "name"), "name"),
}
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
            if (table := read_table(path, stretch)) is None:
                curves.append(path)
            else:
                groups.append(table)
        except InputError as error:
            problems.append(str(error.within(str(path))))
    found, unread = read_shots(curves, density=medium.density, pressure=medium.pressure) if curves else ([], [])
    members: dict[tuple[str, str], list[RadiusCurve]] = {}
    for curve in found:
        members.setdefault((curve.group, curve.group_source), []).append(curve)
    for (name, source), shots in members.items():
        sha256 = shots[0].source_sha256 if source == shots[0].source else ""
        notes = [f"{curve.name}: {note}" for curve in shots for note in curve.notes if "CHECK" in note]
        groups.append(_group(name, source, sha256 or "", [_read_off(curve, stretch) for curve in shots], notes))
    return groups, problems + unread


def _group(name: str, source: str, sha256: str, shots: list[CollapseShot], notes: list[str]) -> CollapseGroup:
    bad = sum(bool(shot.message) for shot in shots)
    return CollapseGroup(
        name=name, source=source, source_sha256=sha256, n=len(shots), unusable=bad, notes=notes, shots=shots
    )


def _shot(name: str, of: Sequence[float], origin: str, message: str = "") -> CollapseShot:
    radius, stretch, time = of
    return CollapseShot(
        name=name, max_radius_m=radius, stretch=stretch, collapse_time_s=time, stretch_from=origin, message=message
    )


def _read_off(curve: RadiusCurve, stretch: float | None) -> CollapseShot:
    try:
        found, origin = shot(curve, stretch)
    except InputError as error:
        return CollapseShot(name=curve.name, message=str(error).removeprefix(f"{curve.name}: "))
    return _shot(curve.name, (found.max_radius[0], found.stretch[0], found.time[0]), origin)


def read_table(path: Path, stretch: float | None = None) -> CollapseGroup | None:
    """The table of collapse times in a file, or None where the file holds none and may hold curves.

    Raises:
        InputError: a table without a unit, with a cell that is no number, or a damaged file.
    """
    if not path.is_file():
        return None  # the reader of curves says what is wrong
    notes: list[str] = []
    if (array := _variable(path)) is not None:
        if array.ndim != 2 or 3 not in array.shape or not array.size:
            raise InputError(
                f"{VARIABLE} must be (n, 3): R_max in m, lambda, t_1 in s; got the shape {array.shape}",
                "collapse_time.variable",
            )
        values = array if array.shape[1] == 3 else array.T
        cells: dict[str, Any] = {"max_radius": values[:, 0], "stretch": values[:, 1], "time": values[:, 2]}
        notes.append(f"variable {VARIABLE}: R_max in m, lambda, t_1 in s")
    else:
        try:
            sheets = read_sheets(path, _is_header, most=1)
        except InputError:
            return None
        if not sheets or not sheets[0].rows or not _is_header(sheets[0].rows[0].cells):
            return None
        cells = _columns(sheets[0].rows, stretch is not None)
    origin = "table"
    if "stretch" not in cells:
        cells["stretch"], origin = np.full(len(cells["time"]), stretch), "given"
    elif stretch is not None:
        notes.append("lambda of the table used, not the one given")
    rows = np.stack([cells[kind] for kind in ("max_radius", "stretch", "time")], axis=1).astype(float).tolist()
    names = cells.get("name") or [str(k) for k in range(1, len(rows) + 1)]
    shots = [_shot(name, row, origin, unusable(*row)) for name, row in zip(names, rows, strict=True)]
    return _group(path.stem, str(path), hashlib.sha256(path.read_bytes()).hexdigest(), shots, notes)


def _variable(path: Path) -> np.ndarray | None:
    """The array of a .mat of any version; None where there is none."""
    with path.open("rb") as file:
        head = file.read(128)
    try:
        if head.startswith(b"MATLAB 7.3"):
            import h5py

            with h5py.File(path, "r") as file:
                item = limits.own(file, VARIABLE)
                if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "fiu":
                    return None
                limits.arrays([item])
                return np.asarray(item[()], dtype=float).T
        if head[124:128] in (b"\x00\x01IM", b"\x01\x00MI"):
            value = read_matfile(path, (VARIABLE,))[0].get(VARIABLE)
            return value if isinstance(value, np.ndarray) else None
    except InputError:
        if head.startswith(b"MATLAB 7.3"):
            raise
    except Exception:  # damaged: the reader of curves says how
        pass
    return None


def column(title: str) -> tuple[str | None, str | None]:
    """("max_radius" | "stretch" | "time" | "name" | None, unit or None) of a column such as `R_max [um]` or `t1_us`."""
    return column_of(title, _TITLES, _UNITS)


def _is_header(cells: list[str]) -> bool:
    return {"max_radius", "time"} <= {column(title)[0] for title in cells}


def _columns(table: list[Row], known_stretch: bool) -> dict[str, Any]:
    """Columns in SI by name."""
    (_, header), *rows = table
    columns: dict[str, Any] = {}
    for at, title in enumerate(header):
        kind, unit = column(title)
        if kind is None:
            continue
        if kind in columns:
            raise InputError(f"two columns for {_SHOWN.get(kind, kind)} in the header {header}", "collapse_time.twice")
        if kind in _UNITS and unit not in _UNITS[kind]:
            trouble = "has no unit" if unit is None else f"has the unknown unit {unit!r}"
            raise InputError(f"{title!r} {trouble} ({', '.join(_UNITS[kind])}); {_EXPECTED}", "collapse_time.unit")
        if kind == "name":
            columns[kind] = [cells[at] if at < len(cells) else "" for _, cells in rows]
        else:
            columns[kind] = numbers(rows, at) * _UNITS.get(kind, {}).get(unit or "", 1.0)
    if "stretch" not in columns and not known_stretch:
        missing = f"no column for lambda = R_max/R_0; {_EXPECTED}, or give --stretch"
        raise InputError(missing, "collapse_time.no_stretch")
    if not rows:
        raise InputError("a header but no rows of data", "collapse_time.no_rows")
    refuse_wider(rows, header)
    return columns
