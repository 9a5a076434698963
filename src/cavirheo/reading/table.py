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
from cavirheo.errors import InputError
from cavirheo.reading import limits
from cavirheo.reading.clean import RADIUS_UNITS, TIME_UNITS, make_curve
from cavirheo.reading.tabular import Cells, Row, column_of, is_number, numbers, read_sheets, refuse_wider

_UNITS = {
    **{unit: unit for unit in (*TIME_UNITS, *RADIUS_UNITS)},
    **{"sec": "s", "second": "s", "seconds": "s", "microseconds": "us", "pixel": "px", "pixels": "px"},
}
_KINDS = {
    **dict.fromkeys(("t", "time"), "time"),
    **dict.fromkeys(("r", "radius", "rnew"), "radius"),
    **dict.fromkeys(("radiusstd", "rstd", "radiussd", "rsd"), "radius_std"),
    **dict.fromkeys(("curve", "shot"), "curve"),
}
_SEPARATOR = -1000.0
_HEADER_ADVICE = "begin the file with a header line such as time_us,radius_um"


def column(title: str) -> tuple[str, str | None]:
    """("time" | "radius" | "radius_std" | "curve" | "", unit or None) of a column title such as `R [um]`."""
    kind, unit = column_of(title, _KINDS, dict.fromkeys(_KINDS.values(), _UNITS))
    return kind or "", None if unit is None else _UNITS.get(unit, unit)


def _is_header(cells: Cells) -> bool:
    return {"time", "radius"} <= {column(title)[0] for title in cells}


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    """The curves of a text table, or of the first sheet of a workbook."""
    sheet = read_sheets(path, _is_header, most=1)[0]
    notes = ["read from the first sheet of the workbook"] if sheet.name else []
    return [curve.with_notes(*notes) for curve in curves_of_rows(sheet.rows, density, pressure)]


def curves_of_rows(rows: list[Row], density: float, pressure: float) -> list[RadiusCurve]:
    """The curves of a table of text cells, its header first if it has one.

    Raises:
        InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    if not rows:
        raise InputError(f"no rows of data; {_HEADER_ADVICE}", "table.empty")
    if not all(map(is_number, rows[0].cells)):
        return _with_header(rows[0].cells, rows[1:])
    width = max(len(row.cells) for row in rows)
    return _without_header(np.column_stack([numbers(rows, k) for k in range(width)]), density, pressure)


def _with_header(header: Cells, rows: list[Row]) -> list[RadiusCurve]:
    columns: dict[str, int] = {}
    units: dict[str, str | None] = {}
    for k, title in enumerate(header):
        kind, unit = column(title)
        if kind in columns:
            raise InputError(
                f"two columns for {kind} in the header {header}; several curves need a column `shot`", "table.twice"
            )
        if kind:
            columns[kind], units[kind] = k, unit
    if "time" not in columns or "radius" not in columns:
        shown = ", ".join(repr(title[:30]) for title in header[:8])
        raise InputError(f"no columns for time and radius among {shown}; {_HEADER_ADVICE}", "table.columns")
    if units["time"] not in (None, *TIME_UNITS) or units["radius"] not in (None, *RADIUS_UNITS):
        raise InputError(
            f"the header {header} gives time in {units['time']} and radius in {units['radius']}", "table.units"
        )
    if "radius_std" in columns and units["radius_std"] != units["radius"]:
        raise InputError(
            f"radius is in {units['radius']} but radius_std in {units['radius_std']}; give both in one unit",
            "table.units",
        )
    if not rows:
        raise InputError("a header but no rows of data", "table.empty")
    refuse_wider(rows, header)
    values = {kind: numbers(rows, at) for kind, at in columns.items() if kind != "curve"}
    at = columns.get("curve", len(header))
    shots: dict[str, list[int]] = {}
    for k, row in enumerate(rows):
        shots.setdefault(row.cells[at] if at < len(row.cells) else "", []).append(k)
    limits.few(len(shots), limits.CURVES, "curves")
    curves = []
    for label, mine in shots.items():
        meta: dict[str, Any] = {"label": label} if "curve" in columns else {}
        samples: dict[str, Any] = {kind: array[mine] for kind, array in values.items()}
        curves.append(make_curve(**samples, time_unit=units["time"], radius_unit=units["radius"], **meta))
    return curves


def _without_header(table: Floats, density: float, pressure: float) -> list[RadiusCurve]:
    """Curves separated by rows of -1000; else two columns (or one time and two radii) whose units prove themselves."""
    separators = np.flatnonzero(np.all(table == _SEPARATOR, axis=1))
    if len(separators) and table.shape[1] == 2:
        limits.few(len(separators), limits.CURVES, "curves")
        blocks = [b[np.any(b != _SEPARATOR, axis=1)] for b in np.split(table, separators)]
        filled = [b for b in blocks if np.count_nonzero(b[:, 1] > 1e-9) > 0]
        note = "curves separated by rows of -1000, no header"
        without = sum(len(b) > 0 for b in blocks) - len(filled)
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        return [make_curve(b[:, 0], b[:, 1], notes=(note,)) for b in filled]
    if table.shape[1] not in (2, 3):
        raise InputError(f"{table.shape[1]} columns and no header; {_HEADER_ADVICE}", "table.header")
    time, radius, note = table[:, 0], table[:, 1], "no header: columns taken as time and radius"
    if table.shape[1] == 3:
        radius = table[:, 1:].mean(axis=1)
        apart = np.abs(table[:, 2] - table[:, 1]) / radius
        if not np.nanmedian(apart) < 0.1:
            raise InputError(
                f"three columns, no header, and the last two are not two radii; {_HEADER_ADVICE}", "table.header"
            )
        note = (
            "no header: columns taken as time and two radii of one bubble (semi-axes), which differ by "
            f"{100 * np.nanmedian(apart):.2g} % (median) and {100 * np.nanmax(apart):.2g} % (most): their mean is used"
        )
    curve = make_curve(time, radius, notes=(note,))
    try:
        proven = len(curve.collapse_times()) > 0 and curve.scale_warning(density, pressure) is None
    except InputError:
        proven = False
    if not proven:
        raise InputError(f"no header, and the numbers do not prove their units; {_HEADER_ADVICE}", "table.header")
    return [curve]


def write_csv(path: str | Path, curve: RadiusCurve) -> None:
    """Write `time_us,radius_um` (and `radius_std_um` where known), one row per frame, ten digits, nan for no radius."""
    columns = {"time_us": curve.time, "radius_um": curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = curve.radius_std
    rows = zip(*(values * 1e6 for values in columns.values()), strict=True)
    text = "".join(",".join(f"{value:.10g}" for value in row) + "\n" for row in rows)
    Path(path).write_text(",".join(columns) + "\n" + text, encoding="utf-8")
