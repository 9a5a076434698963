"""Tables of text: CSV with a header, and the two header-less layouts that can be told apart.

A header names its columns `time_us,radius_um`; s, ms, us, ns and m, mm, um, px are known, written `time_s`, `t [us]`,
`R (mm)`, in any case. Optional: `radius_std_um`; a column `curve` or `shot` whose values tell several curves apart.
Comma, semicolon (then with decimal commas too), tab or spaces separate; lines that begin with # or % are comments.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.curve import Floats, RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading import limits
from cavirheo.reading.clean import make_curve

_UNITS = {
    **{u: u for u in ("s", "ms", "us", "ns", "m", "mm", "um", "px")},
    **{"sec": "s", "second": "s", "seconds": "s", "microseconds": "us", "pixel": "px", "pixels": "px"},
}
_KINDS = {
    **dict.fromkeys(("t", "time"), "time"),
    **dict.fromkeys(("r", "radius", "rnew"), "radius"),
    **dict.fromkeys(("radius_std", "r_std", "radius_sd", "r_sd"), "radius_std"),
    **dict.fromkeys(("curve", "shot"), "curve"),
}
_NOT_A_NUMBER = {"", "nan", "na", "n/a", "null", "none", "-", "#n/a"}
_SEPARATOR = -1000.0
_HEADER_ADVICE = "begin the file with a header line such as time_us,radius_um"

Rows = list[list[str]]


def column(title: str) -> tuple[str, str | None]:
    """("time" | "radius" | "radius_std" | "curve" | "", unit or None) of a column title such as `R [um]`."""
    words = [w for w in re.split(r"[\s_\[\]()/,.\-]+", title.strip().lower().replace("µ", "u").replace("μ", "u")) if w]
    unit = _UNITS.get(words[-1]) if len(words) > 1 else None
    name = "_".join(words[:-1] if unit else words)
    return _KINDS.get(name, ""), unit


def read(path: Path, density: float, pressure: float) -> list[RadiusCurve]:
    return curves_of_rows(_split(text_of(limits.text(path))), density, pressure)


def text_of(content: bytes) -> str:
    """UTF-8 or Latin-1."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def curves_of_rows(rows: Rows, density: float, pressure: float) -> list[RadiusCurve]:
    """The curves of a table of text cells, its header first if it has one.

    Raises:
        InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    if not rows:
        raise InputError(f"no rows of data; {_HEADER_ADVICE}")
    limits.few(max(map(len, rows)), limits.COLUMNS, "columns")
    if any(not is_number(cell) for cell in rows[0]):
        return _with_header(rows[0], rows[1:])
    table = np.column_stack([_numbers(rows, k, 1) for k in range(max(map(len, rows)))])
    return _without_header(table, density, pressure)


def _with_header(header: list[str], rows: Rows) -> list[RadiusCurve]:
    columns: dict[str, int] = {}
    units: dict[str, str | None] = {}
    for k, title in enumerate(header):
        kind, unit = column(title)
        if kind in columns:
            raise InputError(f"two columns for {kind} in the header {header}; several curves need a column `shot`")
        if kind:
            columns[kind], units[kind] = k, unit
    if "time" not in columns or "radius" not in columns:
        shown = ", ".join(repr(title[:30]) for title in header[:8])
        raise InputError(f"no columns for time and radius among {shown}; {_HEADER_ADVICE}")
    if units["time"] not in (None, "s", "ms", "us", "ns") or units["radius"] in ("s", "ms", "us", "ns"):
        raise InputError(f"the header {header} gives time in {units['time']} and radius in {units['radius']}")
    if not rows:
        raise InputError("a header but no rows of data")
    for k, row in enumerate(rows, 2):
        if any(cell.strip() for cell in row[len(header) :]):
            raise InputError(f"row {k} has {len(row)} cells, the header {len(header)} (a decimal comma?)")
    time, radius = _numbers(rows, columns["time"], 2), _numbers(rows, columns["radius"], 2)
    std = _numbers(rows, columns["radius_std"], 2) if "radius_std" in columns else np.full(len(rows), np.nan)
    unit = units["radius"]
    if "radius_std" in columns and units["radius_std"] != unit:
        raise InputError(f"radius is in {unit} but radius_std in {units['radius_std']}; give both in one unit")
    at = columns.get("curve")
    labels = [row[at].strip() if at is not None and at < len(row) else "" for row in rows]
    shots: dict[str, list[int]] = {}
    for row_number, label in enumerate(labels):
        shots.setdefault(label, []).append(row_number)
    limits.few(len(shots), limits.CURVES, "curves")
    curves = []
    for label, mine in shots.items():
        meta: dict[str, Any] = {} if at is None else {"label": label}
        curves.append(
            make_curve(
                time[mine],
                radius[mine],
                radius_std=std[mine],
                time_unit=units["time"],
                radius_unit=unit,
                **meta,
            )
        )
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
        return [make_curve(b[:, 0], b[:, 1], time_unit=None, radius_unit=None, notes=(note,)) for b in filled]
    if table.shape[1] not in (2, 3):
        raise InputError(f"{table.shape[1]} columns and no header; {_HEADER_ADVICE}")
    time, radius, notes = table[:, 0], table[:, 1], ["no header: columns taken as time and radius"]
    if table.shape[1] == 3:
        radius = table[:, 1:].mean(axis=1)
        apart = np.abs(table[:, 2] - table[:, 1]) / radius
        if not np.nanmedian(apart) < 0.1:
            raise InputError(f"three columns, no header, and the last two are not two radii; {_HEADER_ADVICE}")
        notes = [
            "no header: columns taken as time and two radii of one bubble (semi-axes), which differ by "
            f"{100 * np.nanmedian(apart):.2g} % (median) and {100 * np.nanmax(apart):.2g} % (most): their mean is used"
        ]
    curve = make_curve(time, radius, time_unit=None, radius_unit=None, notes=tuple(notes))
    try:
        proven = len(curve.collapse_times()) > 0 and curve.scale_warning(density, pressure) is None
    except InputError:
        proven = False
    if not proven:
        raise InputError(f"no header, and the numbers do not prove their units; {_HEADER_ADVICE}")
    return [curve]


def _split(text: str) -> Rows:
    """Rows of cells. A comment just above the numbers counts as the header if it names the columns (numpy.savetxt)."""
    lines = [line.strip() for line in text.splitlines()]
    limits.rows(lines)
    data = [line for line in lines if line and line[0] not in "#%"]
    if not data:
        return []
    sample = data[:20]
    delimiter = next((d for d in "\t;," if all(d in line for line in sample)), None)
    rows = [[cell.strip().strip('"') for cell in line.split(delimiter)] for line in data]
    if delimiter == ";" or delimiter == "\t":
        rows = [[decimal_point(cell) for cell in row] for row in rows]
    above = lines[: lines.index(data[0])]
    if all(map(is_number, rows[0])) and above and above[-1].startswith(("#", "%")):
        titles = [title.strip() for title in above[-1].lstrip("#% ").split(delimiter)]
        if {"time", "radius"} <= {column(title)[0] for title in titles}:
            rows.insert(0, titles)
    return rows


def decimal_point(cell: str) -> str:
    """'0,5' -> '0.5', where commas do not separate the columns."""
    return re.sub(r"^([+-]?\d+),(\d+(e[+-]?\d+)?)$", r"\1.\2", cell, flags=re.I)


def is_number(cell: str) -> bool:
    """A number, or one of the words that stand for a missing one."""
    try:
        float(cell)
    except ValueError:
        return cell.strip().lower() in _NOT_A_NUMBER
    return True


def _numbers(rows: Rows, k: int, first_row: int) -> Floats:
    """(rows,) column k; empty and missing cells are NaN."""
    values = np.full(len(rows), np.nan)
    for i, row in enumerate(rows):
        if k < len(row) and row[k].strip().lower() not in _NOT_A_NUMBER:
            try:
                values[i] = float(row[k])
            except ValueError:
                raise InputError(f"row {i + first_row}: {row[k][:30]!r} is not a number") from None
    return values


def write_csv(path: str | Path, curve: RadiusCurve) -> None:
    """Write `time_us,radius_um` (and `radius_std_um` where known), one row per frame, ten digits, nan for no radius."""
    columns = {"time_us": curve.time, "radius_um": curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = curve.radius_std
    rows = zip(*(values * 1e6 for values in columns.values()), strict=True)
    text = "".join(",".join(f"{value:.10g}" for value in row) + "\n" for row in rows)
    Path(path).write_text(",".join(columns) + "\n" + text, encoding="utf-8")
