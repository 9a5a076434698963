"""Exports of rheometers -> sweeps in SI.

A table is recognised by the header over it: one column for G', one for G'', and the frequency or the strain. Lines of
metadata above it, a row of units below it (TRIOS, RheoCompass), several tables one after the other, several sheets of
a workbook, and a column that tells intervals apart (rSpace) are all read; decimal commas too, where commas do not
separate the columns.

Units are read, never guessed: from the title (`G' (Pa)`, `Shear Strain [%]`, `omega_rad_per_s`) or from the row below.
Without a unit, a modulus is in Pa and an angular frequency in rad/s (there is one usual unit, and the sweep says so);
a strain (per cent or fraction?) and a plain frequency (Hz or rad/s?) without a unit are errors.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.reading.tabular import Row, column_of, is_number, numbers, plain_unit, read_sheets, refuse_wider

SweepKind = Literal["strain", "frequency"]

# Titles as exported, without accents, spaces and capitals; in English, German and French, as the programs speak.
_STORAGE = "storagemodulus shearstoragemodulus elasticmodulus shearmoduluselasticcomponent speichermodul"
_STORAGE += " modulestockage moduleconservation moduledestockage moduledeconservation moduleelastique"
_LOSS = "lossmodulus shearlossmodulus viscousmodulus shearmodulusviscouscomponent verlustmodul"
_LOSS += " moduleperte moduledeperte modulevisqueux"
_OMEGA = "angularfrequency angfrequency angularfreq angfreq omega ω w kreisfrequenz frequenceangulaire pulsation"
_AMPLITUDE = "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude oscillationstrainamplitude"
_STRAIN = "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement"
_INTERVAL = "actionname interval intervalno step stepname segment sweep sample run repeat replicate test"
_COLUMNS = (  # column, which to prefer where two titles name one, titles
    ("storage", 0, [f"{a}{t}{b}" for t in _STORAGE.split() for a, b in (("", ""), ("g'", ""), ("", "g'"))]),
    ("storage", 0, ["g'", "gp", "gprime", "gstorage"]),
    ("loss", 0, [f"{a}{t}{b}" for t in _LOSS.split() for a, b in (("", ""), ("g''", ""), ("", "g''"))]),
    ("loss", 0, ["g''", "gpp", "gdp", "gdoubleprime", "gloss"]),
    ("omega", 0, _OMEGA.split()),
    ("omega", 1, ["frequency", "freq", "frequenz", "frequence"]),
    ("strain", 0, _AMPLITUDE.split()),
    ("strain", 1, _STRAIN.split()),
    ("interval", 0, _INTERVAL.split()),
)
_TITLES = {title: (kind, preference) for kind, preference, titles in _COLUMNS for title in titles}
_PASCAL = {"Pa": 1.0, "pa": 1.0, "kPa": 1e3, "KPa": 1e3, "kpa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE_SECOND = dict.fromkeys(("1s", "s-1", "pers", "1sec"), 1.0)  # Hz or rad/s: only the name can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_FRACTION = dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_UNITS = {
    "storage": _PASCAL,
    "loss": _PASCAL,
    "omega": _PER_SECOND | _INVERSE_SECOND | _HERTZ,
    "strain": dict.fromkeys(("%", "percent", "pct"), 0.01) | _FRACTION,
    "interval": {},
}
_UNITS_BY_KIND: dict[Any, dict[str, float]] = {kind: _UNITS[kind[0]] for kind in set(_TITLES.values())}
_NAMES = {"storage": "G'", "loss": "G''", "omega": "frequency", "strain": "strain"}
_UNDECLARED = {
    "strain": "{title!r} has no unit, and per cent and fraction differ by a factor of 100; write it into the header: "
    "'Strain (%)' or 'Strain [1]'",
    "omega": "{title!r} has no unit, and Hz and rad/s differ by a factor of 2 pi; write it into the header: "
    "'Frequency (Hz)' or 'Angular frequency (rad/s)'",
}
_EXPECTED = "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)"
_SWEPT = 2.0  # largest over smallest, from which a column counts as swept
_SAME = 0.02  # relative difference below which two settings of the instrument are one


@dataclass(frozen=True)
class Sweep:
    """Moduli over strain or angular frequency, in SI, sorted; `held`: the other of the two, where it is known."""

    name: str
    source: str
    kind: SweepKind
    x: Floats  # strain as a fraction, or angular frequency in rad/s
    storage: Floats  # G', Pa
    loss: Floats  # G'', Pa
    held: float | None = None
    notes: Sequence[str] = ()
    source_sha256: str = ""


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Every strain and frequency sweep of a file, in its order. Rows that cannot be used are counted in `notes`.

    A table that gives every strain or frequency equally often (a sweep run three times, or up and down) is that many
    sweeps.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    if not path.is_file():
        trouble = "is a directory; give the files in it" if path.is_dir() else "does not exist"
        raise InputError(f"{path} {trouble}", "rheometer.no_file")
    found: list[Sweep] = []
    others: list[str] = []
    try:
        sheets = read_sheets(path, _is_header, marks="#")
        tables = [table for sheet in sheets for table in _tables(sheet.rows)]
        if not tables:
            raise _nothing_found([row.cells for sheet in sheets for row in sheet.rows])
        for number, table in enumerate(tables, 1):
            try:
                found += _sweeps(table, table.label or (str(number) if len(tables) > 1 else ""))
            except _NoSweepError as reason:
                others.append(str(reason))
        if not found:
            raise InputError("; ".join(others), "rheometer.no_sweep")
    except InputError as error:
        raise error.within(str(path)) from None
    notes = [f"left out of the file: {'; '.join(dict.fromkeys(others))}"] if others else []
    file: dict[str, Any] = {"source": str(path), "source_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
    names = [f"{path.stem}[{sweep.name}]" if len(found) > 1 and sweep.name else path.stem for sweep in found]
    return [
        replace(sweep, name=name, notes=[*sweep.notes, *notes], **file)
        for name, sweep in zip(names, found, strict=True)
    ]


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
        if self.unit is None and (self.kind == "strain" or plain):
            raise InputError(_UNDECLARED[self.kind].format(title=self.title), "rheometer.no_unit")
        if self.unit is None:
            return 1.0
        unit, units = plain_unit(self.unit), _UNITS[self.kind]
        if plain and unit in _INVERSE_SECOND:
            title = self.title if self.unit in self.title else f"{self.title} {self.unit}"
            raise InputError(_UNDECLARED[self.kind].format(title=title), "rheometer.no_unit")
        if unit not in units:
            known = {"strain": "%, 1", "omega": "rad/s, Hz"}.get(self.kind, "Pa, kPa, MPa")
            raise InputError(
                f"the unit {self.unit!r} of {self.title!r} is not known; known: {known}", "rheometer.unknown_unit"
            )
        return units[unit]

    def note(self) -> str:
        """What was done to the unit; nothing where there was nothing to do."""
        if self.unit is None:
            return f"{self.title!r} has no unit: taken to be in {'rad/s' if self.kind == 'omega' else 'Pa'}"
        if self.kind == "omega" and plain_unit(self.unit) in _HERTZ:
            return f"{self.title!r} is in {self.unit}: converted to rad/s by 2 pi"
        return ""


@cache
def read_title(title: str) -> tuple[str, int, str | None]:
    """("storage" | "loss" | "omega" | "strain" | "interval" | "", preference, unit or None) of a column's title."""
    if title[:1] in "0123456789+-.":
        return "", 0, None
    kind, unit = column_of(title, _TITLES, _UNITS_BY_KIND)
    return (*(kind or ("", 0)), unit)


@dataclass
class _ModuliTable:
    """`label`: what tells its rows from those of the others, where a column does."""

    columns: dict[str, SweepColumn]
    header: list[str]
    rows: list[Row]
    label: str = ""


def _tables(rows: list[Row]) -> Iterator[_ModuliTable]:
    """Each table of moduli; one with a column of intervals is as many tables."""
    table: _ModuliTable | None = None
    whole: list[_ModuliTable] = []
    for row in rows:
        filled = [cell for cell in row.cells if cell]
        if _is_header(row.cells):
            table = _ModuliTable(_columns(row.cells), row.cells, [])
            whole.append(table)
        elif table is None:
            continue
        elif not table.rows and _are_units(table, row.cells):
            for kind, c in table.columns.items():  # the units, below their titles
                if c.unit is None and c.at < len(row.cells) and row.cells[c.at]:
                    table.columns[kind] = c._replace(unit=row.cells[c.at])
        elif filled[0].startswith("[") or filled[0].endswith(":") or not any(map(is_number, filled)):
            table = None  # "[step]", "Result:", "Frequency sweep - 2": another table begins, or none
        else:
            table.rows.append(row)
    for table in whole:
        at = table.columns.pop("interval", None)
        labels = [row.cells[at.at] if at and at.at < len(row.cells) else "" for row in table.rows]
        if len(set(labels)) == len(labels):  # a number for each row
            labels = [""] * len(labels)
        for label in dict.fromkeys(labels) or [""]:
            mine = [row for row, other in zip(table.rows, labels, strict=True) if other == label]
            yield replace(table, rows=mine, label=label)


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
        elif (
            first
            and first.preference == column.preference
            and column.kind != "interval"
            and {"storage", "loss"} <= columns.keys()
        ):
            raise InputError(
                f"two columns for {_NAMES[column.kind]}: {first.title!r} and {title!r}; one sweep a table",
                "rheometer.two_columns",
            )
    return columns


def _nothing_found(rows: list[list[str]]) -> InputError:
    if not rows:
        return InputError(f"the file is empty; {_EXPECTED}", "rheometer.empty")
    titles = max(rows, key=lambda row: (sum(bool(read_title(c)[0]) for c in row), sum(not is_number(c) for c in row)))
    found = {read_title(title)[0] for title in titles}
    missing = " and ".join(_NAMES[kind] for kind in ("storage", "loss") if kind not in found)
    shown = ", ".join(repr(title[:30]) for title in titles[:8] if title)
    return InputError(f"no column for {missing} among {shown}; {_EXPECTED}", "rheometer.no_moduli")


class _NoSweepError(Exception):
    """A table of moduli that is no sweep: one frequency, one strain."""


def _sweeps(table: _ModuliTable, label: str) -> list[Sweep]:
    """The sweep that a table holds, or each of its repetitions."""
    columns = table.columns
    settings = [kind for kind in ("omega", "strain") if kind in columns]
    if not settings:
        titles = ", ".join(map(repr, table.header[:8]))
        raise _NoSweepError(f"no column for frequency or strain among {titles}; {_EXPECTED}")
    refuse_wider(table.rows, table.header)
    rows = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.cells)]
    values = {kind: numbers(rows, column.at) for kind, column in columns.items()}  # in the units of the file
    swept = {kind: _span(values[kind][values["storage"] > 0]) >= _SWEPT for kind in settings}
    if not any(swept.values()):
        count = np.count_nonzero(values["storage"] > 0)
        what = " and ".join(_NAMES[kind] for kind in settings)
        raise _NoSweepError(f"no sweep of {what} in the {count} rows with moduli{f' of {label!r}' if label else ''}")
    x_kind = "omega" if swept.get("omega") else "strain"  # at a given stress the strain varies with the frequency
    kinds = (x_kind, "storage", "loss")
    needed = np.stack([values[kind] for kind in kinds])
    known = np.isfinite(needed).all(axis=0)
    usable = known & (needed > 0).all(axis=0)
    dropped = {
        "marked invalid": len(table.rows) - len(rows),
        "without a number": int(np.count_nonzero(~known)),
        "with a modulus or setting that is not positive": int(np.count_nonzero(known & ~usable)),
    }
    notes = [f"{count} row{'s' * (count > 1)} {why} left out" for why, count in dropped.items() if count]
    if (count := np.count_nonzero(usable)) < 3:
        raise _NoSweepError(f"{count} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}")
    notes += filter(None, (columns[kind].note() for kind in kinds))
    x, storage, loss = (columns[kind].factor() * values[kind][usable] for kind in kinds)
    held = np.full(len(x), np.nan)
    if (other := "strain" if x_kind == "omega" else "omega") in columns:
        if x_kind == "omega":
            _refuse_two_sweeps(x, values[other][usable])
        try:
            held = columns[other].factor() * values[other][usable]
        except InputError:
            notes.append(f"{columns[other].title!r} is not used: its unit is missing or not known")
    passes = _passes(x)
    times = int(passes.max()) + 1
    if times > 1:
        notes.append(f"each {_NAMES[x_kind]} {times} times: read as {times} sweeps")
    found = []
    for k in range(times):
        mine = np.flatnonzero(passes == k)
        mine = mine[np.argsort(x[mine], kind="stable")]
        merged, twice = _merged(x[mine], storage[mine], loss[mine])
        more = [f"{twice} row{'s' * (twice > 1)} at the {_NAMES[x_kind]} of another averaged with it"] if twice else []
        name = label if times == 1 else f"{label}.{k + 1}".lstrip(".")
        setting = held[mine][np.isfinite(held[mine])]
        median = float(np.median(setting)) if setting.size else None
        kind: SweepKind = "frequency" if x_kind == "omega" else "strain"
        found.append(Sweep(name, "", kind, *merged, held=median, notes=[*notes, *more]))
    return found


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
                "two sweeps in one table; give them as two files, or tell them apart by a column `interval`",
                "rheometer.two_sweeps",
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
