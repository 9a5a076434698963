"""The pressure far from the bubble over time, as a table: what `cavirheo simulate --driving` is given."""

from __future__ import annotations

from pathlib import Path

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, require
from cavirheo.reading.clean import TIME_UNITS
from cavirheo.reading.tabular import Cells, column_of, numbers, read_sheets, refuse_wider

_KINDS = {"time": "time", "t": "time", "pressure": "pressure", "p": "pressure"}
_UNITS = {"time": TIME_UNITS, "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}}


def read_trace(path: Path) -> tuple[Floats, Floats]:
    """(n,) times in s and (n,) pressures above the ambient one in Pa, from the columns time_us and pressure_kPa (or in
    other units, which must be named).

    Raises:
        InputError: the file cannot be read, has no such columns, or a cell that is no number.
    """
    try:
        rows = read_sheets(path, lambda cells: len(_columns(cells)) == 2, most=1)[0].rows
        header, below = rows[0].cells if rows else [], rows[1:]
        found, first = _columns(header), ",".join(header)
        require(len(found) == 2, f"its first line must read time_us,pressure_kPa, got {first!r}", "trace.header")
        refuse_wider(below, header)
        (t, seconds), (p, pascals) = found["time"], found["pressure"]
        return numbers(below, t) * seconds, numbers(below, p) * pascals
    except OSError as error:
        raise InputError(f"cannot read a pressure trace from {path}: {error}", "trace.missing") from error
    except InputError as error:
        raise error.within(f"cannot read a pressure trace from {path}") from None


def _columns(header: Cells) -> dict[str, tuple[int, float]]:
    """By kind: where the column is, and its unit in SI."""
    named = [column_of(title, _KINDS, _UNITS) for title in header]
    return {kind: (k, _UNITS[kind][unit]) for k, (kind, unit) in enumerate(named) if kind and unit in _UNITS[kind]}
