"""The pressure far from the bubble over time, as a table: what `cavirheo simulate --driving` is given."""

from __future__ import annotations

from pathlib import Path

from cavirheo.arrays import Floats
from cavirheo.io.files import guarded
from cavirheo.io.tables import Term, Vocabulary, read_columns
from cavirheo.io.units import TIME_UNITS

_TRACE = Vocabulary(
    {
        "time": Term("t time zeit temps tiempo 時間 时间", TIME_UNITS),
        "pressure": Term("p pressure druck pression presion 圧力 压力 壓力", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}),
    },
    "expected a pressure trace with the columns time_us,pressure_kPa",
    dict.fromkeys(("columns", "empty", "no_unit", "unit"), "trace.header") | {"twice": "trace.twice"},
)


def read_trace(path: Path) -> tuple[Floats, Floats, list[str]]:
    """(n,) times in s, (n,) pressures above the ambient one in Pa, and notes of what was recognised or left out, from
    the columns time_us and pressure_kPa (or in other units, which must be named).

    Raises:
        InputError: the file cannot be read, has no such columns, or a cell that is no number.
    """
    with guarded(path):
        (table,) = read_columns(path, _TRACE, ("time", "pressure"))
        return table.column("time").si, table.column("pressure").si, table.notes
