"""The pressure far from the bubble over time, as a table: what `cavirheo simulate --driving` is given."""

from __future__ import annotations

from pathlib import Path

from cavirheo.curve import Floats
from cavirheo.errors import InputError
from cavirheo.reading.clean import TIME_UNITS
from cavirheo.reading.tabular import Cells, Row, column_of, numbers, read_sheets, refuse_wider

_KINDS = {"time": "time", "t": "time", "pressure": "pressure", "p": "pressure"}
_UNITS = {"time": TIME_UNITS, "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}}


def read_trace(path: Path) -> tuple[Floats, Floats]:
    """(n,) times in s and (n,) pressures above the ambient one in Pa, from the columns time_us and pressure_kPa (or in
    other units, which must be named).

    Raises:
        InputError: the file cannot be read, has no such columns, or a cell that is no number.
    """
    try:
        rows = read_sheets(path, _is_header, most=1)[0].rows
        header, *below = rows if rows else [Row(1, [])]
        if not _is_header(header.cells):
            first = ",".join(header.cells)
            raise InputError(f"its first line must read time_us,pressure_kPa, got {first!r}", "trace.header")
        refuse_wider(below, header.cells)
        found = {}
        for at, title in enumerate(header.cells):
            kind, unit = column_of(title, _KINDS, _UNITS)
            if kind and unit:
                found[kind] = numbers(below, at) * _UNITS[kind][unit]
    except OSError as error:
        raise InputError(f"cannot read a pressure trace from {path}: {error}", "trace.missing") from error
    except InputError as error:
        raise error.within(f"cannot read a pressure trace from {path}") from None
    return found["time"], found["pressure"]


def _is_header(cells: Cells) -> bool:
    named = dict(column_of(title, _KINDS, _UNITS) for title in cells)
    return all(named.get(kind) in _UNITS[kind] for kind in _UNITS)
