"""Oscillatory rheometry: exports of rheometers -> sweeps in SI -> linear range, plateau modulus and viscosity, in
rheometer.json (`Rheometry`) and beside the values of bubbles.

A table is recognised by the header over it (what is read: docs/how-to/rheometer.md): one column for G', one for G'',
and the frequency or the strain. Units are read, never guessed. Without a unit, a modulus is in Pa and an angular
frequency in rad/s, with a note in the sweep; a strain or plain frequency is an error. Nothing is extrapolated.

Numbers are SI (a strain of 1 is 100 %) and finite, or null if not found; `message` of a sweep then gives the reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import PchipInterpolator

from cavirheo.arrays import Floats
from cavirheo.errors import InputError, printable, require
from cavirheo.io.files import file_label, guarded
from cavirheo.io.tables import Column, Row, Table, Term, Vocabulary, read_columns
from cavirheo.reporting.group import Published, PublishedValue
from cavirheo.writing import digits, terminal
from cavirheo.writing.digits import counted
from cavirheo.writing.document import Document, Finite, Record, Spread, spread_of, write_rows

_LEAST_RANGE = 3.0  # smallest ratio of the ends of a linear range
_OUTLIER_SHARE = 0.2  # largest share of outliers among the points of a linear range
_PLATEAU_SLOPE = 0.1  # largest |d ln G'/d ln omega| of a plateau
_DECADE = 0.99 * math.log(10.0)  # smallest range of ln(omega) of a plateau; frequencies of instruments are off by 1 %
Measured = Annotated[Any, Field(exclude=True, repr=False)]  # array (n,), which is not written into documents
_PASCAL = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "pa": 1.0, "KPa": 1e3, "kpa": 1e3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rad/s", "rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE = ("1s", "s-1", "pers", "1sec")  # Hz or rad/s: only the title can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_STRAIN = dict.fromkeys(("%", "percent", "pct"), 0.01)
_STRAIN |= dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_HZ_HINT = "Hz and rad/s differ by a factor of 2 pi; write 'Frequency (Hz)' or 'Angular frequency (rad/s)'"
_STRAIN_HINT = "per cent and fraction differ by a factor of 100; write 'Strain (%)' or 'Strain [1]'"
_strain = partial(Term, units=_STRAIN, hint=_STRAIN_HINT)
_NO_SWEEP = "rheometer.no_sweep"  # error code of a table of moduli that is no sweep: one frequency, one strain


def _modulus(symbol: str, words: str, names: str) -> Term:
    """The column of a modulus. words: its titles; names: titles that may have the symbol beside them."""
    with_symbol = (f"{symbol}{word} {word}{symbol}" for word in names.split())
    return Term(" ".join([symbol, words, names, *with_symbol]), _PASCAL, unit="Pa", label=symbol.upper())


VOCABULARY = Vocabulary(  # titles in exports of rheometers, in English, German and French
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
            "frequency freq frequenz frequence", _HERTZ | _PER_SECOND | dict.fromkeys(_INVERSE, math.nan), hint=_HZ_HINT
        ),
        "strain": _strain(
            "oscillationstrain complexshearstrain strainamplitude shearstrainamplitude oscillationstrainamplitude"
        ),
        "shear strain": _strain(  # used if no other title is more specific
            "shearstrain strain gamma γ γ0 gamma0 scherdeformation deformation deformationdecisaillement"
        ),
        "interval": Term("actionname interval intervalno step stepname segment sweep sample run repeat replicate test"),
    },
    "expected a header such as omega (rad/s), G' (Pa), G'' (Pa) or strain (%), G' (Pa), G'' (Pa)",
    ("storage", "loss"),
    {"columns": "rheometer.no_moduli", "empty": "rheometer.empty", "rows": _NO_SWEEP, "twice": "rheometer.two_columns"}
    | {"no_unit": "rheometer.no_unit", "unit": "rheometer.unknown_unit"},
    sections=True,
)
_SWEPT_RATIO = 2.0  # largest over smallest value from which a column counts as swept
_RESOLUTION = 0.02  # relative difference below which two settings of the instrument count as one


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
        points: number of points.
        held: median of the quantity that is held: the angular frequency of a strain sweep, rad/s, or the strain of a
            frequency sweep; null where it is not known.
        x_from: smallest x.
        x_to: largest x.
        plateau_storage_Pa: G' of the plateau, Pa, which is the linear range in a strain sweep; null without a plateau.
        plateau_loss_Pa: G'' of the linear range of a strain sweep, Pa; null in a frequency sweep.
        plateau_from: first x of the plateau.
        plateau_to: last x of the plateau; in a strain sweep the x at which G' leaves its band, if it does.
        departs: "softens" or "stiffens": change of G' beyond the linear range; null where G' stays in the band.
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
    points: int = 0
    held: Finite = None
    x_from: Finite = None
    x_to: Finite = None
    plateau_storage_Pa: Finite = None
    plateau_loss_Pa: Finite = None
    plateau_from: Finite = None
    plateau_to: Finite = None
    departs: str | None = None
    viscosity_Pa_s: Finite = None
    notes: list[str] = []
    message: str = ""

    def model_post_init(self, _: Any) -> None:
        if len(self.x):  # empty in a document that is read from a file
            self.points, self.x_from, self.x_to = len(self.x), self.x[0], self.x[-1]


def strain_sweep(sweep: Sweep, tolerance: float = 0.05) -> Sweep:
    """The same sweep with its linear range and plateau.

    The linear range is the longest one (at least a factor of 3 in strain) in which G' stays within `tolerance` of its
    median and has no trend: the median slope of all pairs of points, |d ln G'/d ln strain|, is at most `tolerance`.
    One outlier does not end it, two neighbours on the same side do. It may begin above the smallest strain, where
    the torque is low. It ends where G', interpolated between two points, leaves the band, if it does.
    """
    gamma, storage = sweep.x, sweep.storage
    if linear := _linear_range(gamma, storage, tolerance):
        first, last, level = linear
        sweep.plateau_from, sweep.plateau_storage_Pa = gamma[first], level
        sweep.plateau_loss_Pa = float(np.median(sweep.loss[first : last + 1]))
        end = gamma[last]
        if last + 1 < len(gamma):
            sweep.departs, edge = ("softens", -1) if storage[last + 1] < level else ("stiffens", 1)
            inside, outside = np.log(storage[last : last + 2] / (level * (1 + edge * tolerance)))
            part = np.clip(inside / (inside - outside), 0.0, 1.0) if inside != outside else 1.0
            end *= (gamma[last + 1] / gamma[last]) ** part
        sweep.plateau_to = end
        if first:
            off = 100 * np.max(np.abs(storage[:first] / level - 1))
            points = f"{counted(first, 'point')} below the linear range left out of it"
            sweep.notes.append(f"{points}: up to {off:.2g} % off (low torque, or a plateau below the data)")
    else:
        band = f"within {100 * tolerance:g} % over a factor of {_LEAST_RANGE:g} in strain"
        sweep.message = f"no linear range: nowhere does G' stay {band}"
    return sweep


def _linear_range(gamma: Floats, storage: Floats, tolerance: float) -> tuple[int, int, float] | None:
    """First and last point, and the level: the median of the points within the band. None: there is none."""
    x, y = np.log(gamma), np.log(storage)
    first, last = np.triu_indices(len(x), 2)
    order = np.lexsort((first, x[first] - x[last]))  # the longest, then the one at smaller strain
    for i, j in zip(first[order], last[order], strict=True):
        if x[j] - x[i] < math.log(_LEAST_RANGE):
            break
        part = storage[i : j + 1]
        deviation = part / np.median(part) - 1
        outside = np.abs(deviation) > tolerance
        two_neighbours = outside[1:] & outside[:-1] & (deviation[1:] * deviation[:-1] > 0)
        if outside[0] or outside[-1] or two_neighbours.any() or outside.mean() > _OUTLIER_SHARE:
            continue
        a, b = np.triu_indices(len(part), 1)
        if abs(np.median((y[i + b] - y[i + a]) / (x[i + b] - x[i + a]))) <= tolerance:
            return int(i), int(j), float(np.median(part[~outside]))
    return None


def frequency_sweep(sweep: Sweep, at: float = 1.0) -> Sweep:
    """The same sweep with its plateau, and its viscosity at the angular frequency `at` (rad/s).

    The plateau is the longest range of at least a decade in which |d ln G'/d ln omega|, fitted over half a decade round
    each point, is at most 0.1. The viscosity is G''/omega; G'' is interpolated by monotone cubics (PCHIP) through its
    logarithms, never extrapolated.
    """
    omega = sweep.x
    if flat := _plateau(omega, sweep.storage):
        first, last = flat
        sweep.plateau_from, sweep.plateau_to = omega[first], omega[last]
        sweep.plateau_storage_Pa = float(np.median(sweep.storage[first : last + 1]))
    else:
        sweep.notes.append(f"no plateau of G': nowhere is d ln G'/d ln ω within ±{_PLATEAU_SLOPE:g} over a decade")
    above = int(np.clip(np.searchsorted(omega, at), 1, len(omega) - 1))
    if not omega[0] * 0.999 <= at <= omega[-1] * 1.001:  # tolerance for the rounding of exports
        outside = f"{at:g} rad/s lies outside the data, {omega[0]:.3g} to {omega[-1]:.3g} rad/s"
        sweep.message = f"{outside}: µ is not extrapolated; ask for another frequency with --at"
    elif omega[above] > 10 * omega[above - 1]:
        gap = f"the data nearest to {at:g} rad/s are more than a decade apart"
        sweep.message = f"{gap}: µ is not interpolated over such a gap"
    else:
        loss = PchipInterpolator(np.log(omega), np.log(sweep.loss))
        sweep.viscosity_Pa_s = math.exp(loss(math.log(np.clip(at, omega[0], omega[-1])))) / at
    return sweep


def _plateau(omega: Floats, storage: Floats) -> tuple[int, int] | None:
    """First and last point of the longest flat range."""
    x, y = np.log(omega), np.log(storage)
    flat = np.zeros(len(x), dtype=bool)
    for k in range(len(x)):
        window = np.abs(x - x[k]) <= 0.25 * math.log(10.0) * 1.01
        window[max(k - 1, 0) : k + 2] = True
        flat[k] = abs(np.polyfit(x[window], y[window], 1)[0]) <= _PLATEAU_SLOPE
    edges = np.flatnonzero(np.diff(flat, prepend=False, append=False))
    runs = zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True)
    first, last = max(runs, key=lambda run: x[run[1]] - x[run[0]], default=(0, 0))
    return (first, last) if x[last] - x[first] >= _DECADE else None


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Read every strain and frequency sweep of a file. Unusable rows are counted in `notes`; rows of one setting are
    averaged.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path, sweeps, refusals = Path(path), list[Sweep](), list[str]()
    with guarded(path) as source:
        parts = [part for table in read_columns(source, VOCABULARY) for part in _intervals(table)]
        for number, (label, table) in enumerate(parts, 1):
            try:
                sweeps.append(_sweep(table, label or (str(number) if len(parts) > 1 else "")))
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                refusals.append(str(error))
        require(bool(sweeps), "; ".join(refusals), _NO_SWEEP)
        digest = source.sha256
    for sweep in sweeps:
        stem = printable(path.stem)
        sweep.name = f"{stem}[{sweep.name}]" if len(sweeps) > 1 and sweep.name else stem
        sweep.source, sweep.source_sha256 = file_label(path), digest
        sweep.notes += [f"left out of the file: {'; '.join(dict.fromkeys(refusals))}"] if refusals else []
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
    rows = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.texts)]
    invalid, table = len(table.rows) - len(rows), replace(table, rows=rows)
    kind, swept, second = _settings(table, label)
    columns = [swept, table.column("storage"), table.column("loss")]
    numbers = np.stack([column.numbers for column in columns])  # in units of the file
    finite = np.isfinite(numbers).all(axis=0)
    usable = np.asarray(finite & (numbers > 0).all(axis=0))
    dropped = {
        "marked invalid": invalid,
        "without a number": int(np.sum(~finite)),
        "with a modulus or setting that is not positive": int(np.sum(finite & ~usable)),
    }
    notes = table.notes + [f"{counted(count, 'row')} {why} left out" for why, count in dropped.items() if count]
    few = f"{np.sum(usable)} usable rows in a sweep, at least 3 are needed; {'; '.join(notes)}"
    require(bool(np.sum(usable) >= 3), few, _NO_SWEEP)
    assumed = [column for column in columns if column.name.unit is None and column.term.unit]
    notes += [f"{column.title!r} has no unit: taken to be in {column.term.unit}" for column in assumed]
    if swept.unit in _HERTZ:
        notes.append(f"{swept.title!r} is in {swept.unit}: converted to rad/s by 2 pi")
    data = np.stack([column.factor * column.numbers[usable] for column in columns])
    held = None
    if second:
        values = second.numbers[usable]
        if kind == "frequency":
            _check_one_sweep(data[0], values)
        try:
            held = float(np.nanmedian(values) * second.factor) if np.isfinite(values).any() else None
        except InputError:
            notes.append(f"{second.title!r} is not used: its unit is missing or not known")
    data = data[:, np.argsort(data[0], kind="stable")]
    group = np.cumsum(np.diff(data[0], prepend=data[0, 0]) > _RESOLUTION * np.roll(data[0], 1))  # setting of each row
    count = np.bincount(group)
    x, storage, loss = (np.bincount(group, row) / count for row in data)
    if repeated := data.shape[1] - len(count):
        notes.append(f"{counted(repeated, 'row')} at the {kind} of another averaged with it")
    return Sweep(kind=kind, x=x, storage=storage, loss=loss, name=label, held=held, notes=notes)


def _settings(table: Table, label: str) -> tuple[Any, Column, Column | None]:
    """(kind of the sweep, column of what is swept, column of what is held). Raises InputError: nothing is swept."""
    terms = {"frequency": ("omega", "frequency"), "strain": ("strain", "shear strain")}
    columns = {kind: [*table.all(first), *table.all(second)] for kind, (first, second) in terms.items()}
    settings = {kind: candidates[0] for kind, candidates in columns.items() if candidates}
    titles = ", ".join(map(repr, table.titles[:8]))
    message = f"no column for frequency or strain among {titles}; {VOCABULARY.expected}"
    require(bool(settings), message, _NO_SWEEP)
    positive = table.column("storage").numbers > 0
    swept = [kind for kind, column in settings.items() if _ratio(column.numbers[positive]) >= _SWEPT_RATIO]
    where = f"{np.sum(positive)} rows with moduli" + (f" of {label!r}" if label else "")
    require(bool(swept), f"no sweep of {' and '.join(settings)} in the {where}", _NO_SWEEP)
    kind = swept[0]  # frequency before strain, which varies with it at a constant stress
    return kind, settings.pop(kind), next(iter(settings.values()), None)


def _check_one_sweep(omega: Floats, strain: Floats) -> None:
    """Raises InputError: the rows of one frequency are a sweep of the strain."""
    for each in np.unique(omega):
        strains = strain[np.abs(omega / each - 1) < _RESOLUTION]
        trouble = f"{len(strains)} rows at {each:.4g} rad/s with strains that differ by more than a factor of"
        remedy = "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
        fine = len(strains) < 3 or _ratio(strains) <= _SWEPT_RATIO
        require(fine, f"{trouble} {_SWEPT_RATIO:g}: {remedy}", "rheometer.two_sweeps")


def _ratio(values: Floats) -> float:
    """Largest over smallest positive value; 1 if there is none."""
    positive = values[np.isfinite(values) & (values > 0)]
    return float(np.max(positive) / np.min(positive)) if positive.size else 1.0


class Rheometry(Document):
    """All sweeps of one material, and their results.

    Attributes:
        material: name of the material.
        tolerance: largest relative deviation of G' from its plateau in the linear range of a strain sweep.
        at_rad_per_s: angular frequency at which mu is taken, rad/s.
        shear_modulus_Pa: G, Pa, over the plateaus of the frequency sweeps; without one, over those of the strain sweeps
            in which G' > G''.
        shear_modulus_from: origin of G, or "no plateau".
        viscosity_Pa_s: G''/omega at this frequency, Pa s, over the frequency sweeps.
        sweeps: the strain sweeps, then the frequency sweeps.
    """

    kind: Literal["rheometer"] = "rheometer"
    material: str
    tolerance: float
    at_rad_per_s: float
    shear_modulus_Pa: Spread
    shear_modulus_from: str
    viscosity_Pa_s: Spread
    sweeps: list[Sweep]

    def sweeps_over(self, kind: str) -> list[Sweep]:
        return [sweep for sweep in self.sweeps if sweep.kind == kind]

    @property
    def unit(self) -> tuple[float, str]:
        """(factor from Pa, name of the unit) of moduli in all tables and pictures of this document."""
        return digits.modulus_unit([sweep.plateau_storage_Pa for sweep in self.sweeps])

    @property
    def published(self) -> Published:
        """Values of a method whose name states the regime; this viscosity is not compared with that of a bubble."""
        strain, frequency = self.sweeps_over("strain"), self.sweeps_over("frequency")
        omegas = [end for s in frequency for end in (s.x_from, s.x_to)] or [s.held for s in strain]
        strains = _present(s.held for s in frequency) or _present(s.plateau_to for s in strain)
        deformation = f"strain ≤ {digits.percent(max(strains))} %" if strains else "small strain"
        viscosity = f"viscosity_at_{self.at_rad_per_s:g}_rad_per_s"
        values = {"shear_modulus": self.shear_modulus_Pa, viscosity: self.viscosity_Pa_s}
        published = {name: PublishedValue(**dict(value)) for name, value in values.items() if value.mean is not None}
        return {f"rheometer, {_span(omegas, 2)} rad/s, {deformation}": published}


def rheometry(
    sweeps: Sequence[Sweep], material: str, tolerance: float = 0.05, at: float = 1.0, **head: Any
) -> Rheometry:
    """The document of sweeps from `read_sweeps`, which are analysed here. head: command, date, notes."""
    strain = [strain_sweep(sweep, tolerance) for sweep in sweeps if sweep.kind == "strain"]
    frequency = [frequency_sweep(sweep, at) for sweep in sweeps if sweep.kind == "frequency"]
    modulus, origin = spread_of([s.plateau_storage_Pa for s in frequency]), "plateau of the frequency sweep"
    if modulus.mean is None:
        solid = [s for s in strain if (s.plateau_storage_Pa or 0.0) > (s.plateau_loss_Pa or 0.0)]
        held = _present(s.held for s in solid)
        modulus = spread_of([s.plateau_storage_Pa for s in solid])
        origin = "plateau of the strain sweep" + (f" at {digits.significant(held[0])} rad/s" if held else "")
    document = Rheometry(
        material=material,
        tolerance=tolerance,
        at_rad_per_s=at,
        shear_modulus_Pa=modulus,
        shear_modulus_from="no plateau" if modulus.mean is None else origin,
        viscosity_Pa_s=spread_of([sweep.viscosity_Pa_s for sweep in frequency]),
        sweeps=[*strain, *frequency],
        **head,
    )
    limit = min(_present(sweep.plateau_to for sweep in strain if sweep.departs), default=math.inf)
    document.notes += [
        f"{sweep.name} was run at a strain of {digits.percent(sweep.held)} %, beyond the linear range "
        f"(to {digits.percent(limit)} %): its moduli are not those of the linear range"
        for sweep in frequency
        if (sweep.held or 0.0) > limit
    ]
    return document


def write_csv(path: Path, document: Rheometry) -> None:
    """Write one line per sweep."""
    head = [name for name in Sweep.model_fields if name not in ("x", "storage", "loss", "notes")]
    write_rows(path, head, (sweep.model_dump() for sweep in document.sweeps))


def shared_name(files: Sequence[Path]) -> str:
    """'gel' of gel_strain.csv and gel_frequency.csv: the words with which all names begin, or the first name."""
    words = [re.split(r"[\W_]+", path.stem) for path in files]
    shared = takewhile(lambda column: len(set(column)) == 1, zip(*words, strict=False))
    return ("_".join(column[0] for column in shared) if len(files) > 1 else "") or files[0].stem


def print_rheometry(document: Rheometry) -> None:
    """Print the sweeps, the values of the material, and the remarks."""
    from rich.text import Text

    console, (factor, unit) = terminal.console(), document.unit
    plateau = {f"plateau G'\n{unit}": ("plateau_storage_Pa", factor)}
    linear = {f"linear, ±{100 * document.tolerance:g} %\n%": ("plateau_to", 100.0)}
    frequency = plateau | {"over\nrad/s": ("plateau_to", 1.0), "µ = G''/ω\nPa s": ("viscosity_Pa_s", 1.0)}
    for kind, columns in (("strain", linear | plateau), ("frequency", frequency)):  # field and factor from SI by title
        if not (sweeps := document.sweeps_over(kind)):
            continue
        table = terminal.table(f"{kind} sweep", list(columns))
        for sweep in sweeps:
            table.add_row(sweep.name, *(_cell(sweep, *column) for column in columns.values()))
        table.add_section()
        if len(sweeps) > 1:
            means = (digits.spread(spread_of([getattr(s, name) for s in sweeps]), x) for name, x in columns.values())
            table.add_row("mean ± std", *means, style="bold")
        console.print(table)
    answer = f": G = {_with_unit(document.shear_modulus_Pa, *document.unit)} ({document.shear_modulus_from})"
    if document.sweeps_over("frequency"):
        answer += f", µ = {_with_unit(document.viscosity_Pa_s, 1.0, 'Pa s')} at {document.at_rad_per_s:g} rad/s"
    console.print(Text.assemble((digits.printable(document.material), "bold"), answer))
    remarks = [(sweep.name, note) for sweep in document.sweeps for note in (sweep.message, *sweep.notes)]
    terminal.print_remarks(console, terminal.names_by_message(remarks), document.notes)


def _cell(sweep: Sweep, field: str, factor: float) -> str:
    """Text of a number, or of the ends of the plateau."""
    if field != "plateau_to":
        return digits.number(getattr(sweep, field), factor)
    ends = [factor * end for end in _present([sweep.plateau_from, sweep.plateau_to])]
    return _span(ends, to=" to " if sweep.departs or sweep.kind == "frequency" else " to ≥ ")


def _present(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _span(values: Iterable[float | None], count: int = 3, to: str = " to ") -> str:
    """'0.10 to 100', '1.5e5 to 2.5e5', or one number where both ends read the same."""
    finite = _present(values)
    ends = [
        digits.significant(end, count) if end < 1e4 else f"{end:.{count - 1}e}".replace("e+0", "e")
        for end in ([min(finite), max(finite)] if finite else [])
    ]
    return to.join(dict.fromkeys(ends)) or digits.MISSING


def _with_unit(value: Spread, factor: float, unit: str) -> str:
    return digits.spread(value, factor) + ("" if value.mean is None else f" {unit}")
