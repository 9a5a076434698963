"""Tables of radius histories: with a header, or one of the two layouts without one that can be told apart.

A header names its columns `time_us,radius_um`; s, ms, us, ns and m, mm, um, px are known, written `time_s`, `t [us]`,
`R (mm)`, in any case. Optional: `radius_std_um`; a column `curve` or `shot` whose values tell several curves apart.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.reading import limits
from cavirheo.reading.clean import RADIUS_UNITS, TIME_UNITS, make_curve
from cavirheo.reading.tabular import Cells, Row, column_of, is_number, numbers, read_sheets, refuse_wider

_UNITS = {unit: unit for unit in (*TIME_UNITS, *RADIUS_UNITS)} | {
    "sec": "s", "second": "s", "seconds": "s", "microseconds": "us", "pixel": "px", "pixels": "px",
}  # fmt: skip
_KINDS = {
    "t": "time", "time": "time", "r": "radius", "radius": "radius", "rnew": "radius", "curve": "curve", "shot": "curve",
    "radiusstd": "radius_std", "rstd": "radius_std", "radiussd": "radius_std", "rsd": "radius_std",
}  # fmt: skip
_SEPARATOR = -1000.0
_ADVICE = "begin the file with a header line such as time_us,radius_um"


def column(title: str) -> tuple[str, str | None]:
    """("time" | "radius" | "radius_std" | "curve" | "", unit or None) of a column title such as `R [um]`."""
    kind, unit = column_of(title, _KINDS, dict.fromkeys(_KINDS.values(), _UNITS))
    return kind or "", None if unit is None else _UNITS.get(unit, unit)


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    """The curves of a text table, or of the first sheet of a workbook; density and pressure as `read_curves`.

    Raises:
        InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    sheet = read_sheets(path, lambda cells: {"time", "radius"} <= {column(title)[0] for title in cells}, most=1)[0]
    require(len(sheet.rows) > 0, f"no rows of data; {_ADVICE}", "table.empty")
    if all(map(is_number, sheet.rows[0].cells)):
        width = max(len(row.cells) for row in sheet.rows)
        table = np.column_stack([numbers(sheet.rows, k) for k in range(width)])
        curves = _without_header(table, density, pressure)
    else:
        curves = _with_header(sheet.rows[0].cells, sheet.rows[1:])
    return [curve.with_notes("read from the first sheet of the workbook") for curve in curves] if sheet.name else curves


def _with_header(header: Cells, rows: list[Row]) -> list[RadiusCurve]:
    places: dict[str, int] = {}
    units: dict[str, str | None] = {}
    for k, title in enumerate(header):
        kind, unit = column(title)
        twice = f"two columns for {kind} in the header {header}; several curves need a column `shot`"
        require(kind not in places, twice, "table.twice")
        if kind:
            places[kind], units[kind] = k, unit
    shown = ", ".join(repr(title[:30]) for title in header[:8])
    known = {"time", "radius"} <= places.keys()
    require(known, f"no columns for time and radius among {shown}; {_ADVICE}", "table.columns")
    seconds, metres = units["time"], units["radius"]
    known = seconds in (None, *TIME_UNITS) and metres in (None, *RADIUS_UNITS)
    require(known, f"the header {header} gives time in {seconds} and radius in {metres}", "table.units")
    other = units.get("radius_std", metres)
    why = f"radius is in {metres} but radius_std in {other}; give both in one unit"
    require(other == metres, why, "table.units")
    require(len(rows) > 0, "a header but no rows of data", "table.empty")
    refuse_wider(rows, header)
    at = places.pop("curve", None)
    values = {kind: numbers(rows, place) for kind, place in places.items()}
    shots: dict[str, list[int]] = {}
    for k, (_, cells) in enumerate(rows):
        shots.setdefault("" if at is None or at >= len(cells) else cells[at], []).append(k)
    limits.few(len(shots), limits.CURVES, "curves")
    curves = []
    for label, mine in shots.items():
        samples: dict[str, Any] = {kind: array[mine] for kind, array in values.items()}
        meta: dict[str, Any] = {} if at is None else {"label": label}
        curves.append(make_curve(**samples, time_unit=seconds, radius_unit=metres, **meta))
    return curves


def _without_header(table: Floats, density: float, pressure: float) -> list[RadiusCurve]:
    """Curves separated by rows of -1000; else two columns (or one time and two radii) whose units prove themselves."""
    columns = table.shape[1]
    separators = np.flatnonzero(np.all(table == _SEPARATOR, axis=1))
    if len(separators) and columns == 2:
        limits.few(len(separators), limits.CURVES, "curves")
        blocks = [b[np.any(b != _SEPARATOR, axis=1)] for b in np.split(table, separators)]
        filled = [b for b in blocks if np.count_nonzero(b[:, 1] > 1e-9) > 0]
        without = sum(len(b) > 0 for b in blocks) - len(filled)
        require(len(filled) > 0, "no curve between the rows of -1000 holds a radius", "table.empty")
        note = "curves separated by rows of -1000, no header"
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        return [make_curve(b[:, 0], b[:, 1], notes=(note,)) for b in filled]
    require(columns in (2, 3), f"{columns} columns and no header; {_ADVICE}", "table.header")
    time, radius, note = table[:, 0], table[:, 1], "no header: columns taken as time and radius"
    if columns == 3:
        radius = table[:, 1:].mean(axis=1)
        apart = 100 * np.abs(table[:, 2] - table[:, 1]) / radius
        middle, most = np.nanmedian(apart), np.nanmax(apart)
        require(middle < 10, f"three columns, no header, and the last two are not two radii; {_ADVICE}", "table.header")
        note = "no header: columns taken as time and two radii of one bubble (semi-axes), which differ by "
        note += f"{middle:.2g} % (median) and {most:.2g} % (most): their mean is used"
    curve = make_curve(time, radius, notes=(note,))
    try:
        proven = len(curve.collapse_times()) > 0 and curve.scale_warning(density, pressure) is None
    except InputError:
        proven = False
    require(proven, f"no header, and the numbers do not prove their units; {_ADVICE}", "table.header")
    return [curve]


def write_csv(path: str | Path, curve: RadiusCurve) -> None:
    """Write `time_us,radius_um` (and `radius_std_um` where known), one row per frame, ten digits, nan for no radius."""
    columns = {"time_us": curve.time, "radius_um": curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = curve.radius_std
    rows = np.column_stack(list(columns.values())) * 1e6
    with Path(path).open("wb") as file:
        np.savetxt(file, rows, fmt="%.10g", delimiter=",", header=",".join(columns), comments="")
