"""Oscillatory rheometry: exports of rheometers -> sweeps in SI -> linear range, plateau modulus and viscosity, in
rheometer.json (`Rheometry`) and beside the values of bubbles. What is read: docs/how-to/rheometer.md.

Numbers are SI (a strain of 1 is 100 %) and finite, or null if not found; `message` of a sweep then gives the reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, printable
from cavirheo.io.files import guarded
from cavirheo.io.tables import Column, Row, Table, Term, Vocabulary, read_columns
from cavirheo.reporting.group import PublishedValue
from cavirheo.writing import digits, terminal
from cavirheo.writing.digits import counted
from cavirheo.writing.document import Document, Finite, Record, Spread, spread_of

_LINEAR = 0.05  # largest relative deviation of G' from its plateau in a strain sweep
_FLAT = 0.12  # the same in a frequency sweep: a power of 0.1 over a decade
_LEAST_STRAINS, _LEAST_FREQUENCIES = 4.0, 9.9  # smallest ratio of the ends of a plateau; instruments are off by 1 %
_OUTLIER_SHARE = 0.2  # largest share of outliers among the points of a plateau
_WIDEST_GAP = 10.0  # ratio of two frequencies between which nothing is interpolated
_SWEPT_RATIO = 2.0  # largest over smallest value from which a column counts as swept
_RESOLUTION = 0.02  # relative difference below which two settings of the instrument count as one
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
_INTERVAL = "actionname interval intervalno step stepname segment sweep sample run repeat replicate test"


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
        "interval": Term(_INTERVAL),
    },
    "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)",
    ("storage", "loss"),
    {"columns": "rheometer.no_moduli", "empty": "rheometer.empty", "rows": _NO_SWEEP, "twice": "rheometer.two_columns"}
    | {"no_unit": "rheometer.no_unit", "unit": "rheometer.unknown_unit"},
    sections=True,
)
Measured = Annotated[Any, Field(exclude=True, repr=False)]  # array (n,), which is not written into documents


class Sweep(Record):
    """Moduli G' and G'' over x: strain (1 is 100 %) in a strain sweep, angular frequency in rad/s in a frequency sweep.

    Attributes:
        kind: kind of the sweep, and of its x: "strain" or "frequency".
        x: (n,) strain, or angular frequency, rad/s; ascending; not written.
        storage: (n,) G', Pa; not written.
        loss: (n,) G'', Pa; not written.
        name: name of the sweep.
        source: file of the sweep, as it was given.
        source_sha256: SHA-256 of the file.
        held: median of the quantity that is held: the angular frequency of a strain sweep, rad/s, or the strain of a
            frequency sweep; null where it is not known.
        x_from: smallest x.
        x_to: largest x.
        plateau_from: first x of the plateau, which is the linear range in a strain sweep; null without one.
        plateau_to: last x of the plateau; in a strain sweep the x at which G' leaves its band, if it does.
        plateau_storage_Pa: G' of the plateau, Pa; null without one, and in a strain sweep in which it is below G''.
        viscosity_Pa_s: G''/omega at the angular frequency of the document, Pa s; null in a strain sweep.
        notes: what was recognised, converted or left out.
        message: reason why a value is missing; else empty.
    """

    kind: Literal["strain", "frequency"]
    x: Measured = ()
    storage: Measured = ()
    loss: Measured = ()
    name: str = ""
    source: str = ""
    source_sha256: str = ""
    held: Finite = None
    x_from: Finite = None
    x_to: Finite = None
    plateau_from: Finite = None
    plateau_to: Finite = None
    plateau_storage_Pa: Finite = None
    viscosity_Pa_s: Finite = None
    notes: list[str] = []
    message: str = ""

    def model_post_init(self, _: Any) -> None:
        if len(self.x):  # empty in a document that is read from a file
            self.x_from, self.x_to = self.x[0], self.x[-1]

    @property
    def ends_flat(self) -> bool:
        """Whether the sweep ends before its plateau does."""
        return self.plateau_to == self.x_to


def strain_sweep(sweep: Sweep) -> Sweep:
    """The same sweep with its linear range: the longest range (at least a factor of 4 in strain) in which G' stays
    within 5 % of its median. It may begin above the smallest strain, where the torque is low, and ends where G',
    interpolated between two points, leaves the band, if it does."""
    gamma, storage = sweep.x, sweep.storage
    flat = _plateau(gamma, storage, _LINEAR, _LEAST_STRAINS)
    if flat is None:
        band = f"within {100 * _LINEAR:g} % over a factor of {_LEAST_STRAINS:g} in strain"
        sweep.message = f"no linear range: nowhere does G' stay {band}"
        return sweep
    first, last, level = flat
    sweep.plateau_from, sweep.plateau_to = gamma[first], gamma[last]
    if last + 1 < len(gamma):
        softens = storage[last + 1] < level
        edge = level * (1 - _LINEAR if softens else 1 + _LINEAR)
        ends = [last + 1, last] if softens else [last, last + 1]
        sweep.plateau_to = math.exp(np.interp(math.log(edge), np.log(storage[ends]), np.log(gamma[ends])))
    loss = float(np.median(sweep.loss[first : last + 1]))
    if loss < level:
        sweep.plateau_storage_Pa = level
    else:
        sweep.notes.append(f"no modulus: G'' ({loss:.3g} Pa) is above G' ({level:.3g} Pa), as in a liquid")
    if first:
        sweep.notes.append(f"{counted(first, 'point')} below the linear range left out of it")
    return sweep


def frequency_sweep(sweep: Sweep, at: float = 1.0) -> Sweep:
    """The same sweep with its plateau, the longest range of at least a decade in which G' stays within 12 % of its
    median, and its viscosity G''/omega at the angular frequency `at` (rad/s), between two points interpolated linearly
    in their logarithms."""
    omega = sweep.x
    flat = _plateau(omega, sweep.storage, _FLAT, _LEAST_FREQUENCIES)
    if flat:
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
        sweep.viscosity_Pa_s = math.exp(np.interp(math.log(at), np.log(omega), np.log(sweep.loss))) / at
    return sweep


def _plateau(x: Floats, storage: Floats, tolerance: float, least: float) -> tuple[int, int, float] | None:
    """First and last point of the longest range, by at least the factor `least` in x, in which G' stays within
    `tolerance` of its median, and the median of the points that do. One outlier does not end it, two in succession do.
    None: there is none."""
    first, last = np.triu_indices(len(x), 2)
    for k in np.lexsort((first, x[first] / x[last])):  # the longest, then the one at smaller x
        i, j = int(first[k]), int(last[k])
        if x[j] < least * x[i]:
            break
        part = storage[i : j + 1]
        outside = np.abs(part / np.median(part) - 1) > tolerance
        ends = outside[0] or outside[-1]
        if not (ends or np.any(outside[1:] & outside[:-1]) or outside.mean() > _OUTLIER_SHARE):
            return i, j, float(np.median(part[~outside]))
    return None


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Read every strain and frequency sweep of a file. Unusable rows are counted in `notes`; rows of one setting are
    averaged.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    sweeps: list[Sweep] = []
    refusals: dict[str, None] = {}
    with guarded(path) as source:
        parts = [part for table in read_columns(source, VOCABULARY) for part in _intervals(table)]
        for number, (label, table) in enumerate(parts, 1):
            try:
                sweeps.append(_sweep(table, label or (str(number) if len(parts) > 1 else "")))
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                refusals[str(error)] = None
        if not sweeps:
            raise InputError("; ".join(refusals), _NO_SWEEP)
        stem, origin = printable(path.stem), printable(str(path))
        for sweep in sweeps:
            sweep.name = f"{stem}[{sweep.name}]" if len(sweeps) > 1 and sweep.name else stem
            sweep.source, sweep.source_sha256 = origin, source.sha256
            sweep.notes += [f"left out of the file: {'; '.join(refusals)}"] if refusals else []
    return sweeps


def _intervals(table: Table) -> list[tuple[str, Table]]:
    """(label, rows) of each interval, if a column distinguishes intervals; else ("", all rows)."""
    rows: dict[str, list[Row]] = {}
    for column in table.all("interval")[:1]:
        for label, row in zip(column.text, table.rows, strict=True):
            rows.setdefault(label, []).append(row)
    if len(rows) in (0, len(table.rows)):  # no such column, or another label on each row
        return [("", table)]
    return [(label, replace(table, rows=interval_rows)) for label, interval_rows in rows.items()]


def _sweep(table: Table, label: str) -> Sweep:
    """The sweep that a table holds. Raises InputError: it holds none, or two."""
    valid = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.texts)]
    count, table = len(table.rows), replace(table, rows=valid)
    kind, swept, second = _settings(table, label)
    columns = [swept, table.column("storage"), table.column("loss")]
    numbers = np.stack([column.numbers for column in columns])  # in units of the file
    usable = np.all(np.isfinite(numbers) & (numbers > 0), axis=0)
    left, notes = count - int(np.sum(usable)), [*table.notes]
    if left:
        notes.append(f"{counted(left, 'row')} left out: marked invalid, or without three positive numbers")
    if count - left < 3:
        few = f"{count - left} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}"
        raise InputError(few, _NO_SWEEP)
    assumed = [column for column in columns if column.name.unit is None and column.term.unit]
    notes += [f"{column.title!r} has no unit: taken to be in {column.term.unit}" for column in assumed]
    if swept.unit in _HERTZ:
        notes.append(f"{swept.title!r} is in {swept.unit}: converted to rad/s by 2 pi")
    order = np.argsort(swept.numbers[usable], kind="stable")
    data = np.stack([column.si[usable][order] for column in columns])
    setting = np.cumsum(np.diff(data[0], prepend=data[0, 0]) > _RESOLUTION * np.roll(data[0], 1))  # number of each row
    rows = np.bincount(setting)
    held = None
    if second:
        values = second.numbers[usable][order]
        for k in np.flatnonzero(rows > 2) if kind == "frequency" else ():
            if _ratio(values[setting == k]) > _SWEPT_RATIO:
                strains = f"{rows[k]} rows of one frequency with strains that differ by more than a factor of"
                remedy = "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
                raise InputError(f"{strains} {_SWEPT_RATIO:g}: {remedy}", "rheometer.two_sweeps")
        try:
            held = float(np.nanmedian(values) * second.factor) if np.isfinite(values).any() else None
        except InputError:
            notes.append(f"{second.title!r} is not used: its unit is missing or not known")
    x, storage, loss = (np.bincount(setting, row) / rows for row in data)
    if len(rows) < len(setting):
        notes.append(f"{counted(len(setting) - len(rows), 'row')} at the {kind} of another averaged with it")
    return Sweep(kind=kind, x=x, storage=storage, loss=loss, name=label, held=held, notes=notes)


def _settings(table: Table, label: str) -> tuple[Any, Column, Column | None]:
    """(kind of the sweep, column of what is swept, column of what is held). Raises InputError: nothing is swept."""
    settings = {  # frequency before strain, which varies with it at a constant stress
        kind: columns[0]
        for kind, terms in (("frequency", ("omega", "frequency")), ("strain", ("strain", "shear strain")))
        if (columns := [column for term in terms for column in table.all(term)])
    }
    if not settings:
        titles = ", ".join(map(repr, table.titles[:8]))
        raise InputError(f"no column for frequency or strain among {titles}; {VOCABULARY.expected}", _NO_SWEEP)
    positive = table.column("storage").numbers > 0
    swept = [kind for kind, column in settings.items() if _ratio(column.numbers[positive]) >= _SWEPT_RATIO]
    if not swept:
        where = f"{np.sum(positive)} rows with moduli" + (f" of {label!r}" if label else "")
        raise InputError(f"no sweep of {' and '.join(settings)} in the {where}", _NO_SWEEP)
    return swept[0], settings.pop(swept[0]), next(iter(settings.values()), None)


def _ratio(values: Floats) -> float:
    """Largest over smallest positive value; 1 if there is none."""
    positive = values[np.isfinite(values) & (values > 0)]
    return float(np.max(positive) / np.min(positive)) if positive.size else 1.0


class Rheometry(Document):
    """All sweeps of one material, and their results.

    Attributes:
        material: name of the material.
        at_rad_per_s: angular frequency at which mu is taken, rad/s.
        shear_modulus_Pa: G, Pa, over the plateaus of the frequency sweeps; without one, over those of the strain
            sweeps.
        shear_modulus_from: origin of G, or "no plateau".
        viscosity_Pa_s: G''/omega at this frequency, Pa s, over the frequency sweeps.
        sweeps: the strain sweeps, then the frequency sweeps.
    """

    kind: Literal["rheometer"] = "rheometer"
    material: str
    at_rad_per_s: float
    shear_modulus_Pa: Spread
    shear_modulus_from: str
    viscosity_Pa_s: Spread
    sweeps: list[Sweep]

    @property
    def published(self) -> dict[str, dict[str, PublishedValue]]:
        """Values of a method whose name states the regime; this viscosity is not compared with that of a bubble."""
        strain, frequency = ([s for s in self.sweeps if s.kind == kind] for kind in ("strain", "frequency"))
        omegas = [end for s in frequency for end in (s.x_from, s.x_to)] or [s.held for s in strain]
        strains = _present(s.held for s in frequency) or _present(s.plateau_to for s in strain)
        deformation = f"strain ≤ {digits.percent(max(strains))} %" if strains else "small strain"
        viscosity = f"viscosity_at_{self.at_rad_per_s:g}_rad_per_s"
        values = {"shear_modulus": self.shear_modulus_Pa, viscosity: self.viscosity_Pa_s}
        published = {name: PublishedValue(**dict(value)) for name, value in values.items() if value.mean is not None}
        return {f"rheometer, {digits.ends(omegas, count=2)} rad/s, {deformation}": published}


def rheometry(sweeps: Sequence[Sweep], material: str, at: float = 1.0, **head: Any) -> Rheometry:
    """The document of sweeps from `read_sweeps`, which are analysed here. head: command, date, notes."""
    strain = [strain_sweep(sweep) for sweep in sweeps if sweep.kind == "strain"]
    frequency = [frequency_sweep(sweep, at) for sweep in sweeps if sweep.kind == "frequency"]
    modulus, origin = spread_of([s.plateau_storage_Pa for s in frequency]), "plateau of the frequency sweep"
    if modulus.mean is None:
        modulus = spread_of([s.plateau_storage_Pa for s in strain])
        held = _present(s.held for s in strain if s.plateau_storage_Pa)
        origin = "plateau of the strain sweep" + (f" at {digits.significant(held[0])} rad/s" if held else "")
    document = Rheometry(
        material=material,
        at_rad_per_s=at,
        shear_modulus_Pa=modulus,
        shear_modulus_from="no plateau" if modulus.mean is None else origin,
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        sweeps=[*strain, *frequency],
        **head,
    )
    limit = min(_present(sweep.plateau_to for sweep in strain if not sweep.ends_flat), default=math.inf)
    document.notes += [
        f"{sweep.name} was run at a strain of {digits.percent(sweep.held)} %, beyond the linear range "
        f"(to {digits.percent(limit)} %): its moduli are not those of the linear range"
        for sweep in frequency
        if (sweep.held or 0.0) > limit
    ]
    return document


def _present(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def shared_name(files: Sequence[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def print_rheometry(document: Rheometry) -> None:
    """Print the sweeps, the values of the material, and the remarks."""
    console = terminal.console()
    factor, unit = digits.modulus_unit(sweep.plateau_storage_Pa for sweep in document.sweeps)
    heads = ["sweep", f"plateau G'\n{unit}", "over", "µ = G''/ω\nPa s"]
    rows = []
    for sweep in document.sweeps:
        modulus, viscosity = digits.number(sweep.plateau_storage_Pa, factor), digits.number(sweep.viscosity_Pa_s)
        rows.append([sweep.name, modulus, _range(sweep), viscosity])
    terminal.print_table(console, heads, rows, title=f"linear range: G' within {100 * _LINEAR:g} %")
    modulus = digits.spread(document.shear_modulus_Pa, factor)
    answer = f": G = {modulus} {unit} ({document.shear_modulus_from})"
    if any(sweep.kind == "frequency" for sweep in document.sweeps):
        answer += f", µ = {digits.spread(document.viscosity_Pa_s)} Pa s at {document.at_rad_per_s:g} rad/s"
    terminal.print_text(console, answer, first=digits.printable(document.material), look="bold")
    remarks = [(sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes)]
    terminal.print_remarks(console, terminal.names_by_text(remarks), document.notes)


def _range(sweep: Sweep) -> str:
    """'0.10 to 7.9 %' of strain, where the sweep ends before G' changes '≥ 7.9 %'; '0.10 to 100 rad/s'."""
    if sweep.plateau_to is None:
        return digits.MISSING
    if sweep.kind == "frequency":
        return f"{digits.ends([sweep.plateau_from, sweep.plateau_to])} rad/s"
    to = "to ≥" if sweep.ends_flat else "to"
    return f"{digits.percent(sweep.plateau_from)} {to} {digits.percent(sweep.plateau_to)} %"
