"""The pressure far from the bubble over time, as a table: what `cavirheo simulate --driving` is given."""

from __future__ import annotations

from pathlib import Path

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.reading.files import guarded
from cavirheo.reading.header import column_of, plain_title
from cavirheo.reading.number_format import Cells
from cavirheo.reading.samples import TIME_UNITS, UNIT_WORDS
from cavirheo.reading.sheet import find_table, numbers
from cavirheo.reading.tabular import read_sheets

_KINDS = {
    plain_title(word): kind
    for kind, words in {
        "time": "t time zeit temps tiempo 時間 时间",
        "pressure": "p pressure druck pression presion 圧力 压力 壓力",
    }.items()
    for word in words.split()
}
_PASCALS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
_UNITS = {
    "time": {word: TIME_UNITS[unit] for word, unit in UNIT_WORDS.items() if unit in TIME_UNITS},
    "pressure": _PASCALS,
}


def read_trace(path: Path) -> tuple[Floats, Floats, list[str]]:
    """(n,) times in s, (n,) pressures above the ambient one in Pa, and notes of what was recognised or left out, from
    the columns time_us and pressure_kPa (or in other units, which must be named).

    Raises:
        InputError: the file cannot be read, has no such columns, or a cell that is no number.
    """
    with guarded(path):
        sheet = read_sheets(path, _is_header, most=1)[0]
        table = find_table(sheet, _is_header, _column)
        first = ",".join(sheet.rows[0].cells)[:80] if sheet.rows else ""
        expected = f"no pressure trace: its columns must be named time_us,pressure_kPa, got {first!r}"
        require(table is not None, expected, "trace.header")
        assert table is not None
        columns = []
        for kind in ("time", "pressure"):
            (at, unit), *others = [
                (k, _column(title)[1]) for k, title in enumerate(table.titles) if _column(title)[0] == kind
            ]
            require(not others, f"two columns for {kind} in {','.join(table.titles)!r}", "trace.twice")
            require(unit in _UNITS[kind], f"{kind} in {unit}: {expected}", "trace.header")
            columns.append(numbers(table.rows, at) * _UNITS[kind][unit or ""])
        return columns[0], columns[1], table.notes


def _column(title: str) -> tuple[str | None, str | None]:
    return column_of(title, _KINDS, _UNITS)


def _is_header(cells: Cells) -> bool:
    return {"time", "pressure"} <= {_column(title)[0] for title in cells}
