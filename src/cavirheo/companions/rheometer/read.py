"""Exports of rheometers -> sweeps in SI (what is read: docs/how-to/rheometer.md).

A table is recognised by the header over it: one column for G', one for G'', and the frequency or the strain. Units are
read, never guessed: from the title (`G' (Pa)`, `Shear Strain [%]`, `omega_rad_per_s`) or from the row below. Without
one, a modulus is in Pa and an angular frequency in rad/s, and the sweep says so; a strain and a plain frequency are
errors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.companions.rheometer.sweeps import FrequencySweep, StrainSweep
from cavirheo.errors import InputError, printable, require
from cavirheo.reading.files import guarded, sha256, shown
from cavirheo.reading.header import column_of, plain_unit
from cavirheo.reading.number_format import is_number
from cavirheo.reading.sheet import numbers, refuse_wider, without_summary
from cavirheo.reading.tabular import Row, Sheet, read_sheets

# Titles as exported, without accents, spaces and capitals; in English, German and French, as the programs speak.
_VOCABULARY = (  # column; 0, or 1 where another title of the column is more exact; a symbol that may be part of it
    ("storage", 0, "", "g' gp gprime gstorage"),
    ("storage", 0, "g'", "storagemodulus shearstoragemodulus elasticmodulus shearmoduluselasticcomponent"),
    ("storage", 0, "g'", "speichermodul modulestockage moduledestockage moduleconservation moduledeconservation"),
    ("storage", 0, "g'", "moduleelastique"),
    ("loss", 0, "", "g'' gpp gdp gdoubleprime gloss"),
    ("loss", 0, "g''", "lossmodulus shearlossmodulus viscousmodulus shearmodulusviscouscomponent"),
    ("loss", 0, "g''", "verlustmodul moduleperte moduledeperte modulevisqueux"),
    ("omega", 0, "", "angularfrequency angfrequency angularfreq angfreq omega ω w kreisfrequenz"),
    ("omega", 0, "", "frequenceangulaire pulsation"),
    ("omega", 1, "", "frequency freq frequenz frequence"),
    ("strain", 0, "", "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude"),
    ("strain", 0, "", "oscillationstrainamplitude"),
    ("strain", 1, "", "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement"),
    ("interval", 0, "", "actionname interval intervalno step stepname segment sweep sample run repeat replicate test"),
)
_TITLES = {
    title: (kind, preference)
    for kind, preference, symbol, words in _VOCABULARY
    for word in words.split()
    for title in (word, symbol + word, word + symbol)
}
_PASCAL = {"Pa": 1.0, "pa": 1.0, "kPa": 1e3, "KPa": 1e3, "kpa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE_SECOND = dict.fromkeys(("1s", "s-1", "pers", "1sec"), 1.0)  # Hz or rad/s: only the name can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_PER_CENT = dict.fromkeys(("%", "percent", "pct"), 0.01)
_FRACTION = dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_UNITS: dict[str, dict[str, float]] = {
    "storage": _PASCAL,
    "loss": _PASCAL,
    "omega": _PER_SECOND | _INVERSE_SECOND | _HERTZ,
    "strain": _PER_CENT | _FRACTION,
    "interval": {},
}
_UNITS_OF_TITLES: dict[Any, dict[str, float]] = {kind: _UNITS[kind[0]] for kind in _TITLES.values()}
_KNOWN = {"strain": "%, 1", "omega": "rad/s, Hz", "storage": "Pa, kPa, MPa", "loss": "Pa, kPa, MPa"}
_NAMES = {"storage": "G'", "loss": "G''", "omega": "frequency", "strain": "strain"}
_AMBIGUOUS = {
    "strain": "per cent and fraction differ by a factor of 100; write it into the header: 'Strain (%)' or 'Strain [1]'",
    "omega": "Hz and rad/s differ by a factor of 2 pi; write it into the header: "
    "'Frequency (Hz)' or 'Angular frequency (rad/s)'",
}
_EXPECTED = "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)"
_NO_SWEEP = "rheometer.no_sweep"  # the code of a table of moduli that is no sweep: one frequency, one strain
_SWEPT = 2.0  # largest over smallest, from which a column counts as swept
_SAME = 0.02  # relative difference below which two settings of the instrument are one


def read_sweeps(path: str | Path) -> list[StrainSweep | FrequencySweep]:
    """Every strain and frequency sweep of a file; rows that cannot be used are counted in `notes`.

    A table with every setting equally often (a sweep run three times, or up and down) is that many sweeps.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    found: list[StrainSweep | FrequencySweep] = []
    others: list[str] = []
    with guarded(path):
        sheets = read_sheets(path, _is_header, marks="#")
        tables = [table for sheet in sheets for table in _tables(sheet)]
        if not tables:
            raise _nothing_found([row.cells for sheet in sheets for row in sheet.rows])
        for number, table in enumerate(tables, 1):
            try:
                found += _sweeps(table, table.label or (str(number) if len(tables) > 1 else ""))
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                others.append(str(error))
        require(bool(found), "; ".join(others), _NO_SWEEP)
        digest = sha256(path)
    for sweep in found:
        stem = printable(path.stem)
        sweep.name = f"{stem}[{sweep.name}]" if len(found) > 1 and sweep.name else stem
        sweep.source, sweep.source_sha256 = shown(path), digest
        sweep.notes += [f"left out of the file: {'; '.join(dict.fromkeys(others))}"] if others else []
    return found


class SweepColumn(NamedTuple):
    """One column of a table of moduli; `preference`: 0 where another title of its kind is less exact."""

    at: int
    title: str
    kind: str
    preference: int
    unit: str | None

    def factor(self) -> float:
        """From the column's unit to SI. Raises InputError for a unit that is missing or unknown."""
        plain = self.kind == "omega" and self.preference == 1
        unit, title = plain_unit(self.unit or ""), self.title
        if (plain and unit in _INVERSE_SECOND) or (self.unit is None and (plain or self.kind == "strain")):
            title = title if (self.unit or "") in title else f"{title} {self.unit}"
            raise InputError(f"{title!r} has no unit, and {_AMBIGUOUS[self.kind]}", "rheometer.no_unit")
        if self.unit is None:
            return 1.0
        known = f"the unit {self.unit!r} of {title!r} is not known; known: {_KNOWN[self.kind]}"
        require(unit in _UNITS[self.kind], known, "rheometer.unknown_unit")
        return _UNITS[self.kind][unit]

    def notes(self) -> list[str]:
        """What was done to the unit, if anything."""
        if self.unit is None:
            return [f"{self.title!r} has no unit: taken to be in {'rad/s' if self.kind == 'omega' else 'Pa'}"]
        if self.kind == "omega" and plain_unit(self.unit) in _HERTZ:
            return [f"{self.title!r} is in {self.unit}: converted to rad/s by 2 pi"]
        return []


@cache
def read_title(title: str) -> tuple[str, int, str | None]:
    """(column or "", preference, unit or None) of a title; the columns are those of the vocabulary."""
    if title[:1] in "0123456789+-.":
        return "", 0, None
    kind, unit = column_of(title, _TITLES, _UNITS_OF_TITLES)
    return (*(kind or ("", 0)), unit)


@dataclass
class _ModuliTable:
    """`label`: what tells its rows from those of the others, where a column does. `notes`: what was recognised."""

    columns: dict[str, SweepColumn]
    header: list[str]
    rows: list[Row]
    notes: list[str]
    label: str = ""


def _tables(sheet: Sheet) -> Iterator[_ModuliTable]:
    """Each table of moduli; one with a column of intervals is as many tables."""
    table: _ModuliTable | None = None
    whole: list[_ModuliTable] = []
    for row in sheet.rows:
        filled = [cell for cell in row.cells if cell]
        if _is_header(row.cells):
            table = _ModuliTable(_columns(row.cells), row.cells, [], list(sheet.notes))
            whole.append(table)
        elif table is None:
            continue
        elif not table.rows and _are_units(table, row.cells):
            for kind, c in table.columns.items():  # the units, below their titles
                if c.unit is None and _cell(row, c):
                    table.columns[kind] = c._replace(unit=_cell(row, c))
        elif filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled)):
            table = None  # "[step]", "Result:", "Frequency sweep - 2": another table begins, or none
        else:
            table.rows.append(row)
    for table in whole:
        table.rows, said = without_summary(table.rows)
        table.notes += said
        interval = table.columns.pop("interval", None)
        labels = [_cell(row, interval) for row in table.rows]
        if len(set(labels)) == len(labels):  # a number for each row
            labels = [""] * len(labels)
        for label in dict.fromkeys(labels) or [""]:
            mine = [row for row, other in zip(table.rows, labels, strict=True) if other == label]
            yield replace(table, rows=mine, label=label)


def _cell(row: Row, column: SweepColumn | None) -> str:
    return row.cells[column.at] if column and column.at < len(row.cells) else ""


def _are_units(table: _ModuliTable, cells: list[str]) -> bool:
    """Whether a row just below the titles has words, not numbers, in the columns that matter."""
    places = [c.at for kind, c in table.columns.items() if kind != "interval"]
    mine = [cells[at] for at in places if at < len(cells) and cells[at]]
    return not any(is_number(cell) and re.search(r"\d", cell) for cell in mine or cells)


def _is_header(cells: list[str]) -> bool:
    return {"storage", "loss"} <= {read_title(cell)[0] for cell in cells}


def _columns(header: list[str]) -> dict[str, SweepColumn]:
    """The columns that the header of a table of moduli names, by kind."""
    columns: dict[str, SweepColumn] = {}
    for at, title in enumerate(header):
        column = SweepColumn(at, title, *read_title(title))
        first = columns.get(column.kind)
        if column.kind and (first is None or column.preference < first.preference):
            columns[column.kind] = column
        elif first and first.preference == column.preference and column.kind != "interval":
            twice = f"two columns for {_NAMES[column.kind]}: {first.title!r} and {title!r}; one sweep a table"
            require(not {"storage", "loss"} <= columns.keys(), twice, "rheometer.two_columns")
    return columns


def _nothing_found(rows: list[list[str]]) -> InputError:
    if not rows:
        return InputError(f"the file is empty; {_EXPECTED}", "rheometer.empty")
    titles = max(rows, key=lambda row: (sum(bool(read_title(c)[0]) for c in row), sum(not is_number(c) for c in row)))
    found = {read_title(title)[0] for title in titles}
    missing = " and ".join(_NAMES[kind] for kind in ("storage", "loss") if kind not in found)
    shown = ", ".join(repr(title[:30]) for title in titles[:8] if title)
    return InputError(f"no column for {missing} among {shown}; {_EXPECTED}", "rheometer.no_moduli")


def _sweeps(table: _ModuliTable, label: str) -> Iterator[StrainSweep | FrequencySweep]:
    """The sweep that a table holds, or each of its repetitions."""
    columns = table.columns
    settings = [kind for kind in ("omega", "strain") if kind in columns]
    titles = ", ".join(map(repr, table.header[:8]))
    require(bool(settings), f"no column for frequency or strain among {titles}; {_EXPECTED}", _NO_SWEEP)
    refuse_wider(table.rows, table.header)
    rows = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.cells)]
    values = {kind: numbers(rows, column.at) for kind, column in columns.items()}  # in the units of the file
    positive = values["storage"] > 0
    swept = [kind for kind in settings if _span(values[kind][positive]) >= _SWEPT]
    kinds = " and ".join(_NAMES[kind] for kind in settings)
    where = f"{np.sum(positive)} rows with moduli" + (f" of {label!r}" if label else "")
    require(bool(swept), f"no sweep of {kinds} in the {where}", _NO_SWEEP)
    setting = swept[0]  # at a given stress the strain varies with the frequency
    wanted = [columns[kind] for kind in (setting, "storage", "loss")]
    needed = np.stack([values[column.kind] for column in wanted])
    known = np.isfinite(needed).all(axis=0)
    usable = known & (needed > 0).all(axis=0)
    dropped = {
        "marked invalid": len(table.rows) - len(rows),
        "without a number": int(np.sum(~known)),
        "with a modulus or setting that is not positive": int(np.sum(known & ~usable)),
    }
    notes = table.notes + [f"{_rows(count)} {why} left out" for why, count in dropped.items() if count]
    few = f"{np.sum(usable)} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}"
    require(bool(np.sum(usable) >= 3), few, _NO_SWEEP)
    notes += [note for column in wanted for note in column.notes()]
    data = [column.factor() * values[column.kind][usable] for column in wanted]
    held = np.full(len(data[0]), np.nan)
    if other := columns.get("strain" if setting == "omega" else "omega"):
        if setting == "omega":
            _refuse_two_sweeps(data[0], values["strain"][usable])
        try:
            held = other.factor() * values[other.kind][usable]
        except InputError:
            notes.append(f"{other.title!r} is not used: its unit is missing or not known")
    passes = _passes(data[0])
    times = int(passes.max()) + 1
    if times > 1:
        notes.append(f"each {_NAMES[setting]} {times} times: read as {times} sweeps")
    for k in range(times):
        part = np.stack([*data, held])[:, passes == k]
        part = part[:, np.argsort(part[0], kind="stable")]
        group = np.cumsum(np.diff(part[0], prepend=part[0, 0]) > _SAME * np.roll(part[0], 1))  # rows of one setting
        count = np.bincount(group)
        x, storage, loss = (np.bincount(group, row) / count for row in part[:3])
        twice = part.shape[1] - len(count)
        averaged = [f"{_rows(twice)} at the {_NAMES[setting]} of another averaged with it"] if twice else []
        steady = part[3][np.isfinite(part[3])]
        median = float(np.median(steady)) if steady.size else None
        told: dict[str, Any] = {"x": x, "storage": storage, "loss": loss, "points": len(x)}
        told["name"] = label if times == 1 else f"{label}.{k + 1}".lstrip(".")
        told["notes"] = notes + averaged
        if setting == "omega":
            yield FrequencySweep(strain=median, **told)
        else:
            yield StrainSweep(frequency_rad_per_s=median, **told)


def _rows(count: int) -> str:
    return f"{count} row" + "s" * (count > 1)


def _span(values: Floats) -> float:
    """Largest over smallest of the positive ones."""
    positive = values[np.isfinite(values) & (values > 0)]
    return float(np.max(positive) / np.min(positive)) if positive.size else 1.0


def _refuse_two_sweeps(omega: Floats, strain: Floats) -> None:
    for one in np.unique(omega):
        here = strain[np.abs(omega / one - 1) < _SAME]
        trouble = f"{len(here)} rows at {one:.4g} rad/s with strains that differ by more than a factor of {_SWEPT:g}"
        mend = "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
        require(len(here) < 3 or _span(here) <= _SWEPT, f"{trouble}: {mend}", "rheometer.two_sweeps")


def _passes(x: Floats) -> np.ndarray:
    """(n,) the repetition that a row belongs to, where all settings come equally often; else 0."""
    seen: dict[float, int] = {}  # how often each setting came
    passes = np.zeros(len(x), dtype=int)
    for row, value in enumerate(x):
        setting = next((other for other in seen if abs(value / other - 1) < _SAME), value)
        passes[row] = seen.get(setting, 0)
        seen[setting] = seen.get(setting, 0) + 1
    return passes if len(set(seen.values())) == 1 else np.zeros_like(passes)
