"""Exports of rheometers -> sweeps in SI.

A table is recognised by the header over it: one column for G', one for G'', and the frequency or the strain. Lines of
metadata above it, a row of units below it (TRIOS, RheoCompass), several tables one after the other, several sheets of
a workbook, and a column that tells intervals apart (rSpace) are all read; decimal commas too, where commas do not
separate the columns.
Titles and units: `titles`.
"""

from __future__ import annotations

import csv
import hashlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from zipfile import BadZipFile

import numpy as np

from cavirheo.beside.rheometer.titles import NAMES, Column, read_title
from cavirheo.errors import InputError
from cavirheo.reading.spreadsheet import sheets
from cavirheo.reading.table import Rows, decimal_point, is_number, text_of

Floats = np.ndarray
Kind = Literal["strain", "frequency"]

_EXPECTED = "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)"
_SWEPT = 2.0  # largest over smallest, from which a column counts as swept
_SAME = 0.02  # relative difference below which two settings of the instrument are one


@dataclass(frozen=True)
class Sweep:
    """Moduli over strain or angular frequency, in SI, sorted; `held`: the other of the two, where it is known."""

    name: str
    source: str
    kind: Kind
    x: Floats  # strain as a fraction, or angular frequency in rad/s
    storage: Floats  # G', Pa
    loss: Floats  # G'', Pa
    held: float | None = None
    notes: tuple[str, ...] = ()
    sha256: str = ""


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Every strain and frequency sweep of a file, in its order. Rows that cannot be used are counted in `notes`.

    A table that gives every strain or frequency equally often (a sweep run three times, or up and down) is that many
    sweeps.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path} is a directory; give the files in it" if path.is_dir() else f"{path} does not exist")
    try:
        content = path.read_bytes()
        tables = [table for rows in _layouts(path, content) for table in _tables(rows)]
        if not tables:
            raise InputError(_nothing_found(next(_layouts(path, content))))
        found, others = [], []
        for number, (label, table) in enumerate(tables, 1):
            try:
                found += _sweeps(label or (str(number) if len(tables) > 1 else ""), table)
            except _NoSweepError as reason:
                others.append(str(reason))
        if not found:
            raise InputError("; ".join(others))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (OSError, BadZipFile, KeyError, ValueError, SyntaxError) as error:  # SyntaxError: of XML
        raise InputError(f"{path} cannot be read, it may be damaged ({type(error).__name__}: {error})") from error
    digest = hashlib.sha256(content).hexdigest()
    notes = (f"left out of the file: {'; '.join(dict.fromkeys(others))}",) if others else ()
    return [
        replace(
            sweep,
            name=f"{path.stem}[{sweep.name}]" if len(found) > 1 and sweep.name else path.stem,
            source=str(path),
            notes=sweep.notes + notes,
            sha256=digest,
        )
        for sweep in found
    ]


def _layouts(path: Path, content: bytes) -> Iterator[Rows]:
    """The file as rows of cells: each sheet of a workbook; for text, the first separator that shows a table."""
    if content.startswith(b"PK\x03\x04"):
        yield from sheets(path)
        return
    if content.startswith(b"\xd0\xcf\x11\xe0"):
        raise InputError("an old Excel file (.xls); save it as .xlsx or CSV")
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = content.decode("utf-16")
    elif b"\x00" in content[:1000]:  # RheoCompass, with its byte order mark lost on the way
        text = content.decode("utf-16-le" if content[1:2] == b"\x00" else "utf-16-be")
    else:
        text = text_of(content)
    lines = [line.removeprefix("#") for line in text.splitlines()]
    if not any(line.strip() for line in lines):
        raise InputError(f"the file is empty; {_EXPECTED}")
    layouts = [(separator, _split(lines, separator)) for separator in ("\t", ";", ",", None)]
    shown = (layout for layout in layouts if any(map(_header, layout[1])))
    best = max(layouts, key=lambda layout: max(map(_recognised, layout[1][:200])))  # for the message that there is none
    separator, rows = next(shown, best)
    yield rows if separator == "," else [_with_points(row) for row in rows]


def _split(lines: list[str], separator: str | None) -> Rows:
    rows = [next(csv.reader([line], delimiter=separator), []) if separator else line.split() for line in lines]
    return [[cell.strip() for cell in row] for row in rows]


def _recognised(row: list[str]) -> int:
    return sum(bool(read_title(cell)[0]) for cell in row)


def _with_points(row: list[str]) -> list[str]:
    """Decimal commas become points; a row that has both does not say which of them separates thousands."""
    changed = [decimal_point(cell) for cell in row]
    commas = [old for old, new in zip(row, changed, strict=True) if old != new]
    points = [cell for cell in row if "." in cell and is_number(cell)]
    if commas and points:
        raise InputError(f"{commas[0]!r} and {points[0]!r} in one row: is the comma decimal? export with points only")
    return changed


@dataclass
class _Table:
    columns: dict[str, Column]
    header: list[str]
    rows: list[tuple[int, list[str]]]  # with their numbers in the file, from 1


def _tables(rows: Rows) -> Iterator[tuple[str, _Table]]:
    """Each table with its label: what tells its rows from those of the others, where a column does."""
    table: _Table | None = None
    whole: list[_Table] = []
    for number, row in enumerate(rows, 1):
        filled = [cell for cell in row if cell]
        if columns := _header(row):
            table = _Table(columns, row, [])
            whole.append(table)
        elif not filled or table is None:
            continue
        elif not table.rows and _are_units(table, row):
            for kind, c in table.columns.items():  # the units, below their titles
                if c.unit is None and c.at < len(row) and row[c.at]:
                    table.columns[kind] = c._replace(unit=row[c.at])
        elif filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled)):
            table = None  # "[step]", "Result:", "Frequency sweep - 2": another table begins, or none
        else:
            table.rows.append((number, row))
    for table in whole:
        at = table.columns.pop("interval", None)
        labels = [row[at.at] if at and at.at < len(row) else "" for _, row in table.rows]
        if len(set(labels)) == len(labels):  # a number for each row
            labels = [""] * len(labels)
        for label in dict.fromkeys(labels) or [""]:
            mine = [row for row, other in zip(table.rows, labels, strict=True) if other == label]
            yield label, _Table(table.columns, table.header, mine)


def _are_units(table: _Table, row: list[str]) -> bool:
    """Whether a row just below the titles has words, not numbers, in the columns that matter."""
    mine = [row[c.at] for kind, c in table.columns.items() if c.at < len(row) and row[c.at] and kind != "interval"]
    return not any(is_number(cell) and re.search(r"\d", cell) for cell in mine or row)


def _header(row: list[str]) -> dict[str, Column]:
    """The columns that a row names, if it is the header of a table of moduli; else none."""
    columns: dict[str, Column] = {}
    for at, title in enumerate(row):
        kind, unit, preference = ("", None, 0) if title[:1] in "0123456789+-." else read_title(title)
        if not kind or (kind == "interval" and kind in columns):
            continue
        if kind not in columns or preference < columns[kind].preference:
            columns[kind] = Column(at, title, unit, preference)
        elif preference == columns[kind].preference and {"storage", "loss"} <= columns.keys():
            raise InputError(f"two columns for {NAMES[kind]}: {columns[kind].title!r} and {title!r}; one sweep a table")
    return columns if {"storage", "loss"} <= columns.keys() else {}


def _nothing_found(rows: Rows) -> str:
    titles = max(rows, key=lambda row: (_recognised(row), sum(not is_number(cell) for cell in row)), default=[])
    found = {kind for kind, _, _ in map(read_title, titles)} & {"storage", "loss"}
    missing = " and ".join(NAMES[kind] for kind in ("storage", "loss") if kind not in found)
    shown = ", ".join(repr(title[:30]) for title in titles[:8] if title)
    return f"no column for {missing} among {shown}; {_EXPECTED}"


class _NoSweepError(Exception):
    """A table of moduli that is no sweep: one frequency, one strain."""


def _sweeps(label: str, table: _Table) -> list[Sweep]:
    """The sweep that a table holds, or each of its repetitions."""
    columns = table.columns
    settings = [kind for kind in ("omega", "strain") if kind in columns]
    if not settings:
        raise _NoSweepError(
            f"no column for frequency or strain among {', '.join(map(repr, table.header[:8]))}; {_EXPECTED}"
        )
    numbers, invalid = _numbers(table)
    swept = {kind: _span(numbers[kind][numbers["storage"] > 0]) >= _SWEPT for kind in settings}
    if not any(swept.values()):
        rows = np.count_nonzero(numbers["storage"] > 0)
        what = " and ".join(NAMES[kind] for kind in settings)
        raise _NoSweepError(f"no sweep of {what} in the {rows} rows with moduli{f' of {label!r}' if label else ''}")
    x_kind = "omega" if swept.get("omega") else "strain"  # at a given stress the strain varies with the frequency
    needed = np.stack([numbers[kind] for kind in (x_kind, "storage", "loss")])
    known = np.isfinite(needed).all(axis=0)
    usable = known & (needed > 0).all(axis=0)
    dropped = {
        "marked invalid": invalid,
        "without a number": int(np.count_nonzero(~known)),
        "with a modulus or setting that is not positive": int(np.count_nonzero(known & ~usable)),
    }
    notes = [f"{count} row{'s' * (count > 1)} {why} left out" for why, count in dropped.items() if count]
    if np.count_nonzero(usable) < 3:
        raise _NoSweepError(
            f"{np.count_nonzero(usable)} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}"
        )
    notes += [note for kind in (x_kind, "storage", "loss") if (note := columns[kind].note(kind))]
    x, storage, loss = (columns[kind].factor(kind) * numbers[kind][usable] for kind in (x_kind, "storage", "loss"))
    other = {"omega": "strain", "strain": "omega"}[x_kind]
    held = np.full(len(x), np.nan)
    if other in columns:
        if x_kind == "omega":
            _refuse_two_sweeps(x, numbers[other][usable])
        try:
            held = columns[other].factor(other) * numbers[other][usable]
        except InputError:
            notes.append(f"{columns[other].title!r} is not used: its unit is missing or not known")

    passes = _passes(x)
    times = int(passes.max()) + 1
    if times > 1:
        notes.append(f"each {NAMES[x_kind]} {times} times: read as {times} sweeps")
    found = []
    for k in range(times):
        mine = np.flatnonzero(passes == k)
        mine = mine[np.argsort(x[mine], kind="stable")]
        columns_of_sweep, twice = _merged(x[mine], storage[mine], loss[mine])
        more = [f"{twice} row{'s' * (twice > 1)} at the {NAMES[x_kind]} of another averaged with it"] if twice else []
        name = label if times == 1 else f"{label}.{k + 1}".lstrip(".")
        kind: Kind = "frequency" if x_kind == "omega" else "strain"
        setting = held[mine][np.isfinite(held[mine])]
        median = float(np.median(setting)) if setting.size else None
        found.append(Sweep(name, "", kind, *columns_of_sweep, held=median, notes=(*notes, *more)))
    return found


def _numbers(table: _Table) -> tuple[dict[str, Floats], int]:
    """The columns as numbers in the units of the file, NaN where there is none; and the rows marked invalid."""
    values: dict[str, list[float]] = {kind: [] for kind in table.columns}
    invalid = 0
    for number, row in table.rows:
        if any(row[len(table.header) :]):
            raise InputError(f"row {number} has {len(row)} cells, the header {len(table.header)} (a decimal comma?)")
        if any("invalid" in cell.lower() for cell in row):
            invalid += 1
            continue
        for kind, place in table.columns.items():
            cell = row[place.at] if place.at < len(row) else ""
            if not is_number(cell) and not re.fullmatch(r"\W*", cell):
                raise InputError(f"row {number}: {cell[:30]!r} is not a number")
            values[kind].append(float(cell) if re.search(r"\d", cell) else math.nan)
    return {kind: np.array(numbers) for kind, numbers in values.items()}, invalid


def _span(values: Floats) -> float:
    """Largest over smallest of the positive ones."""
    positive = values[np.isfinite(values) & (values > 0)]
    return float(np.max(positive) / np.min(positive)) if positive.size else 1.0


def _refuse_two_sweeps(omega: Floats, strain: Floats) -> None:
    for one in np.unique(omega):
        here = strain[np.abs(omega / one - 1) < _SAME]
        if len(here) > 2 and _span(here) > _SWEPT:
            raise InputError(
                f"{len(here)} rows at {one:.4g} rad/s with strains that differ by more than a factor of {_SWEPT:g}: "
                "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
            )


def _passes(x: Floats) -> np.ndarray:
    """(n,) the number of the repetition that a row belongs to, where all settings come equally often; else 0."""
    settings: list[float] = []
    count: list[int] = []
    passes = np.zeros(len(x), dtype=int)
    for row, value in enumerate(x):
        which = next((k for k, other in enumerate(settings) if abs(value / other - 1) < _SAME), None)
        if which is None:
            settings.append(value)
            count.append(1)
        else:
            passes[row] = count[which]
            count[which] += 1
    return passes if len(set(count)) == 1 else np.zeros_like(passes)


def _merged(x: Floats, storage: Floats, loss: Floats) -> tuple[tuple[Floats, Floats, Floats], int]:
    """Sorted columns with rows of one setting averaged, and how many rows that took away."""
    group = np.concatenate([[0], np.cumsum(np.diff(x) > _SAME * x[:-1])])
    count = np.bincount(group)
    mean = tuple(np.bincount(group, values) / count for values in (x, storage, loss))
    return (mean[0], mean[1], mean[2]), len(x) - len(count)
