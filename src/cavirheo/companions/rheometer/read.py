"""Exports of rheometers -> sweeps in SI (what is read: docs/how-to/rheometer.md).

A table is recognised by the header over it: one column for G', one for G'', and the frequency or the strain. Units are
read, never guessed. Without one, a modulus is in Pa and an angular frequency in rad/s, and the sweep says so; a strain
and a plain frequency are errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.companions.rheometer.sweeps import Sweep
from cavirheo.errors import InputError, printable, require
from cavirheo.io.files import file_label, guarded, sha256
from cavirheo.io.tables import Table, Term, Vocabulary, read_columns
from cavirheo.writing.digits import counted

_PASCAL = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "pa": 1.0, "KPa": 1e3, "kpa": 1e3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rad/s", "rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE = ("1s", "s-1", "pers", "1sec")  # Hz or rad/s: only the title can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_STRAIN = dict.fromkeys(("%", "percent", "pct"), 0.01)
_STRAIN |= dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_TWO_PI = "Hz and rad/s differ by a factor of 2 pi; write 'Frequency (Hz)' or 'Angular frequency (rad/s)'"
_CENT = "per cent and fraction differ by a factor of 100; write 'Strain (%)' or 'Strain [1]'"
_NO_SWEEP = "rheometer.no_sweep"  # the code of a table of moduli that is no sweep: one frequency, one strain


def _modulus(symbol: str, words: str, named: str) -> Term:
    """Titles by themselves, and those that may have the symbol beside them."""
    beside = (f"{symbol}{word} {word}{symbol}" for word in named.split())
    return Term(" ".join([symbol, words, named, *beside]), _PASCAL, unit="Pa", label=symbol.upper())


VOCABULARY = Vocabulary(  # as exported, in English, German and French, as the programs speak
    {
        "storage": _modulus(
            "g'",
            "gp gprime gstorage",
            "storagemodulus shearstoragemodulus elasticmodulus shearmoduluselasticcomponent speichermodul "
            "modulestockage moduledestockage moduleconservation moduledeconservation moduleelastique",
        ),
        "loss": _modulus(
            "g''",
            "gpp gdp gdoubleprime gloss",
            "lossmodulus shearlossmodulus viscousmodulus shearmodulusviscouscomponent verlustmodul moduleperte "
            "moduledeperte modulevisqueux",
        ),
        "omega": Term(
            "angularfrequency angfrequency angularfreq angfreq omega ω w kreisfrequenz frequenceangulaire pulsation",
            _PER_SECOND | _HERTZ | dict.fromkeys(_INVERSE, 1.0),
            unit="rad/s",
        ),
        "frequency": Term(
            "frequency freq frequenz frequence", _HERTZ | _PER_SECOND | dict.fromkeys(_INVERSE, math.nan), hint=_TWO_PI
        ),
        "strain": Term(
            "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude oscillationstrainamplitude",
            _STRAIN,
            hint=_CENT,
        ),
        "shear strain": Term(  # where no title is more exact
            "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement",
            _STRAIN,
            hint=_CENT,
        ),
        "interval": Term("actionname interval intervalno step stepname segment sweep sample run repeat replicate test"),
    },
    "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)",
    {"columns": "rheometer.no_moduli", "empty": "rheometer.empty", "rows": _NO_SWEEP, "twice": "rheometer.two_columns"}
    | {"no_unit": "rheometer.no_unit", "unit": "rheometer.unknown_unit"},
    marks="#",
    sections=True,
)
_SWEPT = 2.0  # largest over smallest, from which a column counts as swept
_SAME = 0.02  # relative difference below which two settings of the instrument are one


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Every strain and frequency sweep of a file; rows that cannot be used are counted in `notes`.

    A table with every setting equally often (a sweep run three times, or up and down) is that many sweeps.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    found: list[Sweep] = []
    others: list[str] = []
    with guarded(path):
        parts = [part for table in read_columns(path, VOCABULARY, ("storage", "loss")) for part in _intervals(table)]
        for number, (label, table) in enumerate(parts, 1):
            try:
                found += _sweeps(table, label or (str(number) if len(parts) > 1 else ""))
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                others.append(str(error))
        require(bool(found), "; ".join(others), _NO_SWEEP)
        digest = sha256(path)
    for sweep in found:
        stem = printable(path.stem)
        sweep.name = f"{stem}[{sweep.name}]" if len(found) > 1 and sweep.name else stem
        sweep.source, sweep.source_sha256 = file_label(path), digest
        sweep.notes += [f"left out of the file: {'; '.join(dict.fromkeys(others))}"] if others else []
    return found


def _intervals(table: Table) -> Iterator[tuple[str, Table]]:
    """(label, rows) of each interval that a column tells apart; ("", all rows) where none does."""
    column = next(iter(table.all("interval")), None)
    labels = column.text if column else [""] * len(table.rows)
    if len(set(labels)) == len(labels):  # a number for each row
        labels = [""] * len(labels)
    for label in dict.fromkeys(labels) or [""]:
        yield label, table.part([row for row, other in zip(table.rows, labels, strict=True) if other == label])


def _sweeps(table: Table, label: str) -> Iterator[Sweep]:
    """The sweep that a table holds, or each of its repetitions."""
    kept = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.cells)]
    invalid, table = len(table.rows) - len(kept), table.part(kept)
    moduli = [table.column("storage"), table.column("loss")]
    settings = {"frequency": table.all("omega") + table.all("frequency")}
    settings["strain"] = table.all("strain") + table.all("shear strain")
    first = {name: columns[0] for name, columns in settings.items() if columns}
    titles = ", ".join(map(repr, table.titles[:8]))
    none = f"no column for frequency or strain among {titles}; {VOCABULARY.expected}"
    require(bool(first), none, _NO_SWEEP)
    positive = moduli[0].numbers > 0
    swept = [name for name, column in first.items() if _span(column.numbers[positive]) >= _SWEPT]
    where = f"{np.sum(positive)} rows with moduli" + (f" of {label!r}" if label else "")
    require(bool(swept), f"no sweep of {' and '.join(first)} in the {where}", _NO_SWEEP)
    kind = swept[0]  # at a given stress the strain varies with the frequency
    columns = [first.pop(kind), *moduli]
    numbers = np.stack([column.numbers for column in columns])  # in the units of the file
    known = np.isfinite(numbers).all(axis=0)
    usable = np.asarray(known & (numbers > 0).all(axis=0))
    dropped = {
        "marked invalid": invalid,
        "without a number": int(np.sum(~known)),
        "with a modulus or setting that is not positive": int(np.sum(known & ~usable)),
    }
    notes = table.notes + [f"{counted(count, 'row')} {why} left out" for why, count in dropped.items() if count]
    few = f"{np.sum(usable)} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}"
    require(bool(np.sum(usable) >= 3), few, _NO_SWEEP)
    notes += [note for column in columns for note in column.assumed]
    if columns[0].unit in _HERTZ:
        notes.append(f"{columns[0].title!r} is in {columns[0].unit}: converted to rad/s by 2 pi")
    data = np.stack([column.factor * column.numbers[usable] for column in columns])
    held = np.full(data.shape[1], np.nan)
    for column in first.values():
        values = column.numbers[usable]
        for omega in np.unique(data[0]) if kind == "frequency" else ():
            here = values[np.abs(data[0] / omega - 1) < _SAME]
            trouble = (
                f"{len(here)} rows at {omega:.4g} rad/s with strains that differ by more than a factor of {_SWEPT:g}"
            )
            mend = "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
            require(len(here) < 3 or _span(here) <= _SWEPT, f"{trouble}: {mend}", "rheometer.two_sweeps")
        try:
            held = values * column.factor
        except InputError:
            notes.append(f"{column.title!r} is not used: its unit is missing or not known")
    passes = _passes(data[0])
    for number in range(times := int(passes.max()) + 1):
        notes_of = notes + [f"each {kind} {times} times: read as {times} sweeps"] * (times > 1)
        name = label if times == 1 else f"{label}.{number + 1}".lstrip(".")
        yield _sweep(kind, data[:, passes == number], held[passes == number], name=name, notes=notes_of)


def _sweep(kind: Any, data: Floats, held: Floats, *, name: str, notes: list[str]) -> Sweep:
    """Of data (3, n): setting, G' and G''; rows of one setting are averaged. held: (n,) the other setting."""
    data = data[:, np.argsort(data[0], kind="stable")]
    group = np.cumsum(np.diff(data[0], prepend=data[0, 0]) > _SAME * np.roll(data[0], 1))  # rows of one setting
    count = np.bincount(group)
    x, storage, loss = (np.bincount(group, row) / count for row in data)
    twice = data.shape[1] - len(count)
    notes = notes + [f"{counted(twice, 'row')} at the {kind} of another averaged with it"] * (twice > 0)
    steady = float(np.median(held[np.isfinite(held)])) if np.isfinite(held).any() else None
    return Sweep(kind=kind, x=x, storage=storage, loss=loss, name=name, points=len(x), held=steady, notes=notes)


def _span(values: Floats) -> float:
    """Largest over smallest of the positive ones."""
    positive = values[np.isfinite(values) & (values > 0)]
    return float(np.max(positive) / np.min(positive)) if positive.size else 1.0


def _passes(x: Floats) -> np.ndarray:
    """(n,) the repetition that a row belongs to, where all settings come equally often; else 0."""
    seen: dict[float, int] = {}  # how often each setting came
    passes = np.zeros(len(x), dtype=int)
    for row, value in enumerate(x):
        setting = next((other for other in seen if abs(value / other - 1) < _SAME), value)
        passes[row] = seen.get(setting, 0)
        seen[setting] = seen.get(setting, 0) + 1
    return passes if len(set(seen.values())) == 1 else np.zeros_like(passes)
