"""Oscillatory rheometry: exports of rheometers -> sweeps in SI -> linear range, plateau modulus and viscosity, in
rheometer.json (`Rheometry`) and beside the values of bubbles. What is read: docs/how-to/rheometer.md.

Numbers are SI (a strain of 1 is 100 %) and finite, or null if not found; `message` of a sweep then gives the reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, printable
from cavirheo.io.files import guarded
from cavirheo.io.tables import Column, Table, Term, Vocabulary, read_columns
from cavirheo.reporting.record import PublishedValue
from cavirheo.writing import digits, terminal
from cavirheo.writing.digits import counted
from cavirheo.writing.document import Document, Finite, Record, Spread, spread_of

Indices = NDArray[np.int64]
_LINEAR = 0.05  # largest relative deviation of G' from its plateau in a strain sweep
_FLAT = 0.12  # the same in a frequency sweep: a power of 0.1 over a decade
_LEAST_STRAINS, _LEAST_FREQUENCIES = 4.0, 9.9  # smallest ratio of the ends of a plateau; instruments are off by 1 %
_WIDEST_GAP = 10.0  # ratio of two frequencies between which nothing is interpolated
_SWEPT_RATIO = 2.0  # largest over smallest value from which a column counts as swept
_STEADY = 0.005  # largest change of the frequency's logarithm from row to row in a strain sweep: that of rounding
_FEWEST = 3  # rows of a sweep
_FREQUENCIES, _STRAINS = ("omega", "frequency"), ("strain", "shear strain")  # kinds of columns, the surer one first
_NO_SWEEP = "rheometer.no_sweep"  # error code of a table of moduli that is no sweep: one frequency, one strain
_PASCAL = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "pa": 1.0, "KPa": 1e3, "kpa": 1e3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rad/s", "rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE = ("1s", "s-1", "pers", "1sec")  # Hz or rad/s: only the title can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_STRAIN = dict.fromkeys(("%", "percent", "pct"), 0.01)
_STRAIN |= dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_HZ_HINT = "Hz and rad/s differ by a factor of 2 pi; write 'Frequency (Hz)' or 'Angular frequency (rad/s)'"
_STRAIN_HINT = "per cent and fraction differ by a factor of 100; write 'Strain (%)' or 'Strain [1]'"
# titles in exports of rheometers, in English, German and French; those of moduli may have the symbol beside them
_STORAGE = """storagemodulus shearstoragemodulus elasticmodulus shearmoduluselasticcomponent speichermodul
modulestockage moduledestockage moduleconservation moduledeconservation moduleelastique"""
_LOSS = """lossmodulus shearlossmodulus viscousmodulus shearmodulusviscouscomponent verlustmodul moduleperte
moduledeperte modulevisqueux"""
_OMEGA = "angularfrequency angfrequency angularfreq angfreq omega ω w kreisfrequenz frequenceangulaire pulsation"
_OSCILLATION = "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude oscillationstrainamplitude"
_SHEAR = "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement"


def _modulus(symbol: str, words: str, names: str) -> Term:
    """The column of a modulus. words: its titles; names: titles that may have the symbol beside them."""
    with_symbol = (f"{symbol}{word} {word}{symbol}" for word in names.split())
    return Term(" ".join([symbol, words, names, *with_symbol]), _PASCAL, unit="Pa", label=symbol.upper())


VOCABULARY = Vocabulary(
    {
        "storage": _modulus("g'", "gp gprime gstorage", _STORAGE),
        "loss": _modulus("g''", "gpp gdp gdoubleprime gloss", _LOSS),
        "omega": Term(_OMEGA, _PER_SECOND | _HERTZ | dict.fromkeys(_INVERSE, 1.0), unit="rad/s"),
        "frequency": Term(
            "frequency freq frequenz frequence", _HERTZ | _PER_SECOND | dict.fromkeys(_INVERSE, math.nan), hint=_HZ_HINT
        ),
        "strain": Term(_OSCILLATION, _STRAIN, hint=_STRAIN_HINT),
        "shear strain": Term(_SHEAR, _STRAIN, hint=_STRAIN_HINT),  # used if no other title is more specific
    },
    "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)",
    ("storage", "loss"),
    {"columns": "rheometer.no_moduli", "empty": "rheometer.empty", "rows": _NO_SWEEP, "twice": "rheometer.two_columns"}
    | {"no_unit": "rheometer.no_unit", "unit": "rheometer.unknown_unit"},
    sections=True,
)


class Sweep(Record):
    """What moduli over x tell: over the strain (1 is 100 %) in a strain sweep, or the angular frequency in rad/s."""

    kind: Literal["strain", "frequency"]
    """Kind of the sweep, and of its x: "strain" or "frequency"."""
    name: str = ""
    """Name of the sweep."""
    source: str = ""
    """File of the sweep, as it was given."""
    source_sha256: str = ""
    """SHA-256 of the file."""
    plateau_from: Finite = None
    """First x of the plateau, which is the linear range in a strain sweep; null without one."""
    plateau_to: Finite = None
    """Last x of the plateau."""
    plateau_storage_Pa: Finite = None
    """G' of the plateau, Pa; null without one, and in a strain sweep in which it is below G''."""
    viscosity_Pa_s: Finite = None
    """G''/omega at the angular frequency of the document, Pa s; null in a strain sweep."""
    notes: list[str] = []
    """What was recognised, converted or left out."""
    message: str = ""
    """Reason why a value is missing; else empty."""


def strain_sweep(strain: Floats, storage: Floats, loss: Floats) -> Sweep:
    """The linear range of G' and G'' (n,), Pa, over ascending strains (n,): the longest range (at least a factor of 4
    in strain) in which G' stays within 5 % of its median. It may begin above the smallest strain, where the torque is
    low."""
    flat = _plateau(strain, storage, _LINEAR, _LEAST_STRAINS)
    if flat is None:
        band = f"within {100 * _LINEAR:g} % over a factor of {_LEAST_STRAINS:g} in strain"
        return Sweep(kind="strain", message=f"no linear range: nowhere does G' stay {band}")
    first, last, level = flat
    notes = list[str]()
    viscous = float(np.median(loss[first : last + 1]))
    if viscous >= level:
        notes.append(f"no modulus: G'' ({viscous:.3g} Pa) is above G' ({level:.3g} Pa), as in a liquid")
    if first:
        notes.append(f"{counted(first, 'point')} below the linear range left out of it")
    modulus = level if viscous < level else None
    linear: Any = {"plateau_from": strain[first], "plateau_to": strain[last], "plateau_storage_Pa": modulus}
    return Sweep(kind="strain", **linear, notes=notes)


def frequency_sweep(omega: Floats, storage: Floats, loss: Floats, at: float = 1.0) -> Sweep:
    """The plateau of G' (n,), Pa, over ascending angular frequencies (n,), rad/s: the longest range of at least a
    decade in which it stays within 12 % of its median; and the viscosity G''/omega at the angular frequency `at`,
    between two points interpolated linearly in their logarithms."""
    sweep = Sweep(kind="frequency")
    if flat := _plateau(omega, storage, _FLAT, _LEAST_FREQUENCIES):
        first, last, sweep.plateau_storage_Pa = flat
        sweep.plateau_from, sweep.plateau_to = omega[first], omega[last]
    else:
        sweep.notes.append(f"no plateau: nowhere does G' stay within {100 * _FLAT:g} % over a decade")
    above = int(np.clip(np.searchsorted(omega, at), 1, len(omega) - 1))
    if not omega[0] * 0.999 <= at <= omega[-1] * 1.001:  # tolerance for the rounding of exports
        outside = f"{at:g} rad/s lies outside the data, {omega[0]:.3g} to {omega[-1]:.3g} rad/s"
        sweep.message = f"{outside}: µ is not extrapolated; ask for another frequency with --at"
    elif omega[above] > _WIDEST_GAP * omega[above - 1]:
        gap = f"the data nearest to {at:g} rad/s are more than a decade apart"
        sweep.message = f"{gap}: µ is not interpolated over such a gap"
    else:
        sweep.viscosity_Pa_s = math.exp(np.interp(math.log(at), np.log(omega), np.log(loss))) / at
    return sweep


def _plateau(x: Floats, storage: Floats, tolerance: float, least: float) -> tuple[int, int, float] | None:
    """First and last point of the longest range, by at least the factor `least` in x, in which G' stays within
    `tolerance` of its median, and this median. None: there is none."""
    first, last = np.triu_indices(len(x), 2)
    for k in np.lexsort((first, x[first] / x[last])):  # the longest, then the one at smaller x
        i, j = int(first[k]), int(last[k])
        if x[j] < least * x[i]:
            break
        part = storage[i : j + 1]
        level = float(np.median(part))
        if np.all(np.abs(part / level - 1) <= tolerance):
            return i, j, level
    return None


def read_sweeps(path: str | Path, at: float = 1.0) -> list[Sweep]:
    """Read the strain and frequency sweeps of a file; a table may hold several, tables without any are left out.
    Unusable rows are counted in `notes`. at: as of `frequency_sweep`.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', leaves a unit open, or mixes sweeps.
    """
    path = Path(path)
    sweeps, refused = list[Sweep](), list[InputError]()
    with guarded(path) as source:
        for table in read_columns(source, VOCABULARY):
            try:
                sweeps += _sweeps(table, at)
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                refused.append(error)
        if not sweeps:
            raise refused[0]
        for number, sweep in enumerate(sweeps, 1):
            sweep.name = printable(path.stem) + (f"[{number}]" if len(sweeps) > 1 else "")
            sweep.source, sweep.source_sha256 = printable(str(path)), source.sha256
    return sweeps


def _varies(values: Floats) -> bool:
    """Whether a column counts as swept over these rows; values that are not positive do not count."""
    values = values[values > 0]
    return len(values) >= _FEWEST and bool(values.max() >= _SWEPT_RATIO * values.min())


def _parts(table: Table) -> list[tuple[Column, Indices]]:
    """What is swept, and in which rows. If both are, the frequency stays in each strain sweep, and the other rows are
    of a frequency sweep; where the frequency only rises or only falls, the strain varies with it, at constant stress.

    Raises InputError: nothing is swept, or strain and frequency change together and the frequency comes again."""
    kinds = (table.all(sure) + table.all(other) for sure, other in (_FREQUENCIES, _STRAINS))
    settings = [columns[0] for columns in kinds if columns]
    if not settings:
        titles = ", ".join(map(repr, table.titles[:8]))
        raise InputError(f"no column for frequency or strain among {titles}; {VOCABULARY.expected}", _NO_SWEEP)
    both = " and ".join(repr(column.title) for column in settings)
    measured = np.flatnonzero(table.column("storage").numbers > 0)
    swept = list[Column]()
    for column in settings:
        try:
            if _varies(column.numbers[measured]):
                swept.append(column)
        except InputError:
            if not swept:  # otherwise the frequency is swept, and the strain need not be readable
                raise
    if not swept:
        least = f"it takes {_FEWEST} rows, and ends that differ by a factor of {_SWEPT_RATIO:g}"
        raise InputError(f"no sweep of {both} in the {len(measured)} rows with moduli: {least}", _NO_SWEEP)
    every = np.arange(len(table.rows))
    if len(swept) == 1:
        return [(swept[0], every)]
    frequency, strain = (column.numbers for column in swept)
    rows = measured[(frequency[measured] > 0) & (strain[measured] > 0)]
    steps = np.diff(np.log(frequency[rows]))
    moves = np.abs(steps) > _STEADY
    runs = [run for run in np.split(rows, np.flatnonzero(moves) + 1) if _varies(strain[run])]  # at one frequency
    if not runs and len({*np.sign(steps[moves]).tolist()}) < 2:
        return [(swept[0], every)]
    if not runs:
        message = f"several sweeps in which {both} change together: write each below a header of its own"
        raise InputError(message, "rheometer.mixed")
    rest = np.setdiff1d(every, np.concatenate(runs))
    return [*((swept[1], run) for run in runs), *([(swept[0], rest)] if _varies(frequency[rest]) else [])]


def _sweeps(table: Table, at: float) -> Iterator[Sweep]:
    """The sweeps that a table holds. Raises InputError: it holds none."""
    rows = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.texts)]
    total, table = len(table.rows), replace(table, rows=rows)
    for swept, part in _parts(table):
        columns = [swept, table.column("storage"), table.column("loss")]
        numbers = np.stack([column.numbers for column in columns])  # in units of the file
        usable = part[np.all(np.isfinite(numbers) & (numbers > 0), axis=0)[part]]
        notes, size = [*table.notes], total
        if len(part) < len(rows):
            size = len(part)
            notes.append(f"{size} of the {total} rows of the table are of this sweep")
        if len(usable) < size:
            left = counted(size - len(usable), "row")
            notes.append(f"{left} left out: marked invalid, or without three positive numbers")
        if len(usable) < _FEWEST:
            few = f"{len(usable)} usable rows in a sweep, at least {_FEWEST} are needed; {'; '.join(notes)}"
            raise InputError(few, _NO_SWEEP)
        assumed = [column for column in columns if column.name.unit is None and column.term.unit]
        notes += [f"{column.title!r} has no unit: taken to be in {column.term.unit}" for column in assumed]
        if swept.unit in _HERTZ:
            notes.append(f"{swept.title!r} is in {swept.unit}: converted to rad/s by 2 pi")
        order = usable[np.argsort(numbers[0, usable], kind="stable")]
        x, storage, loss = (column.si[order] for column in columns)
        of_frequency = swept.name.kind in _FREQUENCIES
        sweep = frequency_sweep(x, storage, loss, at) if of_frequency else strain_sweep(x, storage, loss)
        sweep.notes = notes + sweep.notes
        yield sweep


class Rheometry(Document):
    """All sweeps of one material, and their results."""

    kind: Literal["rheometer"] = "rheometer"
    material: str
    """Name of the material."""
    at_rad_per_s: float
    """Angular frequency at which mu is taken, rad/s."""
    shear_modulus_Pa: Spread
    """G, Pa, over the plateaus of the frequency sweeps; without one, over those of the strain sweeps."""
    shear_modulus_from: str
    """Origin of G, or "no plateau"."""
    viscosity_Pa_s: Spread
    """G''/omega at this frequency, Pa s, over the frequency sweeps."""
    sweeps: list[Sweep]
    """The strain sweeps, then the frequency sweeps."""

    @property
    def published(self) -> dict[str, dict[str, PublishedValue]]:
        """Values of a method whose name states the regime of G. This viscosity is not compared with a bubble's."""
        frequency = [end for s in self.sweeps if s.kind == "frequency" for end in (s.plateau_from, s.plateau_to)]
        if regime := digits.ends(frequency, count=2):
            regime += " rad/s"
        elif strains := [s.plateau_to for s in self.sweeps if s.kind == "strain" and s.plateau_to]:
            regime = f"strain ≤ {digits.percent(max(strains))} %"
        values = {"shear_modulus": self.shear_modulus_Pa}
        values[f"viscosity_at_{self.at_rad_per_s:g}_rad_per_s"] = self.viscosity_Pa_s
        published = {name: PublishedValue(**dict(value)) for name, value in values.items() if value.mean is not None}
        return {f"rheometer, {regime}" if regime else "rheometer": published}


def rheometry(sweeps: Sequence[Sweep], material: str, at: float = 1.0, **head: Any) -> Rheometry:
    """The document of sweeps from `read_sweeps`. head: command, date, notes."""
    strain, frequency = ([sweep for sweep in sweeps if sweep.kind == kind] for kind in ("strain", "frequency"))
    modulus, origin = spread_of([s.plateau_storage_Pa for s in frequency]), "plateau of the frequency sweep"
    if modulus.mean is None:
        modulus, origin = spread_of([s.plateau_storage_Pa for s in strain]), "plateau of the strain sweep"
    return Rheometry(
        material=material,
        at_rad_per_s=at,
        shear_modulus_Pa=modulus,
        shear_modulus_from="no plateau" if modulus.mean is None else origin,
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        sweeps=[*strain, *frequency],
        **head,
    )


def shared_name(files: Sequence[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def print_rheometry(document: Rheometry) -> None:
    """Print the sweeps, the values of the material, and the remarks."""
    _, factor, unit, _ = digits.shown("shear_modulus", *(sweep.plateau_storage_Pa for sweep in document.sweeps))
    heads = ["sweep", f"plateau G'\n{unit}", "over", "µ = G''/ω\nPa s"]
    limits = {"strain": _LINEAR, "frequency": _FLAT}
    bands = dict.fromkeys(f"{100 * limits[one.kind]:g} % in a {one.kind} sweep" for one in document.sweeps)
    rows = []
    for sweep in document.sweeps:
        modulus, viscosity = digits.number(sweep.plateau_storage_Pa, factor), digits.number(sweep.viscosity_Pa_s)
        ends, unit_of_x = [sweep.plateau_from, sweep.plateau_to], "rad/s" if sweep.kind == "frequency" else "%"
        over = digits.ends(ends, 1.0 if sweep.kind == "frequency" else 100.0, 2)
        rows.append([sweep.name, modulus, f"{over} {unit_of_x}" if over else digits.MISSING, viscosity])
    terminal.print_table(heads, rows, title=f"plateau: G' within {', '.join(bands)}")
    answer = f": {document.shear_modulus_from}"
    if document.shear_modulus_Pa.mean is not None:
        answer = f": G = {digits.spread(document.shear_modulus_Pa, factor)} {unit} ({document.shear_modulus_from})"
    if document.viscosity_Pa_s.mean is not None:
        answer += f", µ = {digits.spread(document.viscosity_Pa_s)} Pa s at {document.at_rad_per_s:g} rad/s"
    terminal.print_text(answer, first=digits.printable(document.material), look="bold")
    remarks = [(sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes)]
    terminal.print_remarks(terminal.names_by_text(remarks), document.notes)
