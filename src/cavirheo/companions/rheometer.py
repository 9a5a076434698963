"""Oscillatory rheometry: exports of rheometers -> sweeps in SI -> linear range, plateau modulus and viscosity.

A table is recognised by the header over it (what is read: docs/how-to/rheometer.md): one column for G', one for G'',
and the frequency or the strain. Units are read, never guessed. Without one, a modulus is in Pa and an angular frequency
in rad/s, and the sweep says so; a strain and a plain frequency are errors. Nothing is extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import median_filter

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, printable, require
from cavirheo.io.files import file_label, guarded, sha256
from cavirheo.io.tables import Table, Term, Vocabulary, read_columns
from cavirheo.writing.digits import counted
from cavirheo.writing.document import Finite, Record

_SHORTEST = 3.0  # largest over smallest strain of a linear range
_OUTLIERS = 0.2  # part of the points of a linear range that may lie outside it, each alone
_FLAT = 0.1  # |d ln G'/d ln omega| of a plateau
_DECADE = 0.99 * math.log(10.0)  # of a plateau; instruments set 0.1 and 1 rad/s to within a per cent
Measured = Annotated[Any, Field(exclude=True, repr=False)]  # (n,) floats, which are not written
_PASCAL = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "mPa": 1e-3, "pa": 1.0, "KPa": 1e3, "kpa": 1e3, "dyncm2": 0.1}
_PER_SECOND = dict.fromkeys(("rad/s", "rads", "radsec", "radpers", "rads-1", "rads1", "radsec-1"), 1.0)
_INVERSE = ("1s", "s-1", "pers", "1sec")  # Hz or rad/s: only the title can tell
_HERTZ = {"Hz": 2 * math.pi, "hz": 2 * math.pi, "HZ": 2 * math.pi, "kHz": 2e3 * math.pi, "mHz": 2e-3 * math.pi}
_STRAIN = dict.fromkeys(("%", "percent", "pct"), 0.01)
_STRAIN |= dict.fromkeys(("1", "-", "–", "—", "fraction", "dimensionless", "unitless"), 1.0)
_TWO_PI = "Hz and rad/s differ by a factor of 2 pi; write 'Frequency (Hz)' or 'Angular frequency (rad/s)'"
_CENT = "per cent and fraction differ by a factor of 100; write 'Strain (%)' or 'Strain [1]'"
_NO_SWEEP = "rheometer.no_sweep"  # the code of a table of moduli that is no sweep: one frequency, one strain


def _modulus(symbol: str, words: str, names: str) -> Term:
    """Titles by themselves, and those that may have the symbol beside them."""
    with_symbol = (f"{symbol}{word} {word}{symbol}" for word in names.split())
    return Term(" ".join([symbol, words, names, *with_symbol]), _PASCAL, unit="Pa", label=symbol.upper())


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
    sections=True,
)
_SWEPT = 2.0  # largest over smallest, from which a column counts as swept
_SAME = 0.02  # relative difference below which two settings of the instrument are one


class Sweep(Record):
    """Moduli over strain (a strain of 1 is 100 %) or over angular frequency in rad/s, sorted, SI.

    Attributes:
        kind: "strain" or "frequency", which is x.
        x: (n,) not written.
        storage: (n,) G', Pa; not written.
        loss: (n,) G'', Pa; not written.
        name: of the sweep.
        source: the file, as it was given.
        source_sha256: its SHA-256.
        points: how many.
        held: what x is not, in its median: the angular frequency in rad/s of a strain sweep, the strain of the other.
        x_from: smallest x.
        x_to: largest x.
        plateau_storage_Pa: G' of the plateau; in a strain sweep that of the linear range, Pa.
        plateau_loss_Pa: G'' of the linear range, Pa.
        plateau_from: its first x.
        plateau_to: its last x; in a strain sweep where G' leaves the band, or the largest one where it does not.
        departs: "softens" or "stiffens" beyond the linear range; null where G' stays in the band.
        crossover: x where G' = G''.
        crossover_modulus_Pa: G' there, Pa.
        at_rad_per_s: frequency of the following numbers, rad/s.
        viscosity_Pa_s: G''/omega there, Pa s.
        tan_delta: G''/G' there.
        complex_viscosity_Pa_s: |G*|/omega there, Pa s.
        notes: what was recognised, converted or left out.
        message: why a number is missing.
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
    crossover: Finite = None
    crossover_modulus_Pa: Finite = None
    at_rad_per_s: Finite = None
    viscosity_Pa_s: Finite = None
    tan_delta: Finite = None
    complex_viscosity_Pa_s: Finite = None
    notes: list[str] = []
    message: str = ""


def strain_sweep(sweep: Sweep, tolerance: float = 0.05) -> Sweep:
    """The same sweep with its linear range, plateau and crossover.

    The linear range is the longest one (at least a factor of 3 in strain) in which G' stays within `tolerance` of its
    median and has no trend: the median slope of all pairs of points, |d ln G'/d ln strain|, is at most `tolerance`.
    One outlier does not end it, two in succession to one side do. It may begin above the smallest strain, where
    the torque is low. It ends where G', interpolated between two points, leaves the band, if it does.
    """
    gamma, storage, first = sweep.x, sweep.storage, 0
    if linear := _linear_range(gamma, storage, tolerance):
        first, last, level = linear
        sweep.plateau_from, sweep.plateau_storage_Pa = gamma[first], level
        sweep.plateau_loss_Pa = float(np.median(sweep.loss[first : last + 1]))
        sweep.plateau_to, sweep.departs = _limit(gamma, storage, last, level, tolerance)
        points, low = f"{counted(first, 'point')} below the linear range", storage[:first]
        if first > 2 and np.all(low > level * (1 + tolerance)):
            sweep.notes.append(f"G' is higher in the {points}: the true one may lie there, or below the data")
        elif first:
            off = 100 * np.max(np.abs(low / level - 1))
            sweep.notes.append(f"{points} left out of it: up to {off:.2g} % off (low torque?)")
    else:
        band = f"within {100 * tolerance:g} % over a factor of {_SHORTEST:g} in strain"
        sweep.message = f"no linear range: nowhere does G' stay {band}"
    yields = [(x, modulus) for x, modulus, falls in _crossovers(sweep) if falls and x > gamma[first]]
    sweep.x_from, sweep.x_to = gamma[0], gamma[-1]
    if yields:
        sweep.crossover, sweep.crossover_modulus_Pa = yields[0]
    return sweep


def _linear_range(gamma: Floats, storage: Floats, tolerance: float) -> tuple[int, int, float] | None:
    """First and last point, and the level: the median of the points within the band."""
    x, y = np.log(gamma), np.log(storage)
    first, last = np.triu_indices(len(x), 2)
    order = np.lexsort((first, x[first] - x[last]))  # the longest, then the one at smaller strain
    for i, j in zip(first[order], last[order], strict=True):
        if x[j] - x[i] < math.log(_SHORTEST):
            break
        part = storage[i : j + 1]
        away = part / np.median(part) - 1
        outside = np.abs(away) > tolerance
        twice = outside[1:] & outside[:-1] & (away[1:] * away[:-1] > 0)
        if outside[0] or outside[-1] or twice.any() or outside.mean() > _OUTLIERS:
            continue
        a, b = np.triu_indices(len(part), 1)
        if abs(np.median((y[i + b] - y[i + a]) / (x[i + b] - x[i + a]))) <= tolerance:
            return int(i), int(j), float(np.median(part[~outside]))
    return None


def _limit(gamma: Floats, storage: Floats, last: int, level: float, tolerance: float) -> tuple[float, str | None]:
    """The strain at which G' leaves the band, and how; or the largest strain and None."""
    if last == len(gamma) - 1:
        return float(gamma[last]), None
    departs = "softens" if storage[last + 1] < level else "stiffens"
    inside, outside = np.log(storage[last : last + 2] / level) - np.log1p(
        -tolerance if departs == "softens" else tolerance
    )
    part = np.clip(inside / (inside - outside), 0.0, 1.0) if inside != outside else 1.0
    return float(gamma[last] * (gamma[last + 1] / gamma[last]) ** part), departs


def frequency_sweep(sweep: Sweep, at: float = 1.0) -> Sweep:
    """The same sweep with its plateau, its viscosity at the angular frequency `at` (rad/s) and its crossover.

    The plateau is the longest range of at least a decade in which |d ln G'/d ln omega|, fitted over half a decade round
    each point, is at most 0.1. The viscosity is G''/omega; G'' and G' are interpolated by monotone cubics (PCHIP)
    through their logarithms, never extrapolated.
    """
    omega = sweep.x
    sweep.x_from, sweep.x_to, sweep.at_rad_per_s = omega[0], omega[-1], at
    if flat := _plateau(omega, sweep.storage):
        first, last = flat
        sweep.plateau_from, sweep.plateau_to = omega[first], omega[last]
        sweep.plateau_storage_Pa = float(np.median(sweep.storage[first : last + 1]))
    else:
        sweep.notes.append(f"no plateau of G': nowhere is d ln G'/d ln ω within ±{_FLAT:g} over a decade")
    above = int(np.clip(np.searchsorted(omega, at), 1, len(omega) - 1))
    if not omega[0] * 0.999 <= at <= omega[-1] * 1.001:  # digits of the export, no more
        outside = f"{at:g} rad/s lies outside the data, {omega[0]:.3g} to {omega[-1]:.3g} rad/s"
        sweep.message = f"{outside}: µ is not extrapolated; ask for another frequency with --at"
    elif omega[above] > 10 * omega[above - 1]:
        gap = f"the data nearest to {at:g} rad/s are more than a decade apart"
        sweep.message = f"{gap}: µ is not interpolated over such a gap"
    else:
        moduli = PchipInterpolator(np.log(omega), np.log([sweep.storage, sweep.loss]), axis=1)
        storage, loss = np.exp(moduli(math.log(np.clip(at, omega[0], omega[-1])))).tolist()
        sweep.viscosity_Pa_s, sweep.tan_delta = loss / at, loss / storage
        sweep.complex_viscosity_Pa_s = math.hypot(storage, loss) / at
    if crossovers := _crossovers(sweep):
        sweep.crossover, sweep.crossover_modulus_Pa, _ = crossovers[0]
    if further := ", ".join(f"{x:.3g}" for x, _, _ in crossovers[1:]):
        sweep.notes.append(f"G' = G'' also at {further} rad/s")
    return sweep


def _plateau(omega: Floats, storage: Floats) -> tuple[int, int] | None:
    """First and last point of the longest flat range."""
    x, y = np.log(omega), np.log(storage)
    flat = np.zeros(len(x), dtype=bool)
    for k in range(len(x)):
        window = np.abs(x - x[k]) <= 0.25 * math.log(10.0) * 1.01
        window[max(k - 1, 0) : k + 2] = True
        flat[k] = abs(np.polyfit(x[window], y[window], 1)[0]) <= _FLAT
    edges = np.flatnonzero(np.diff(_steady(flat), prepend=False, append=False))
    first, last = max(
        zip(edges[::2], edges[1::2] - 1, strict=True), key=lambda run: x[run[1]] - x[run[0]], default=(0, 0)
    )
    return (int(first), int(last)) if x[last] - x[first] >= _DECADE else None


def _crossovers(sweep: Sweep) -> list[tuple[float, float, bool]]:
    """(x, G' = G'', whether G'' wins beyond) in the logarithms, without single outliers."""
    solid = sweep.storage > sweep.loss
    keep = solid == _steady(solid)
    x, storage, loss, solid = (values[keep] for values in (sweep.x, sweep.storage, sweep.loss, solid))
    crossovers = []
    for k in np.flatnonzero(solid[1:] != solid[:-1]):
        before, after = np.log(storage[k : k + 2] / loss[k : k + 2])
        part = before / (before - after)
        position, modulus = (values[k] * (values[k + 1] / values[k]) ** part for values in (x, storage))
        crossovers.append((float(position), float(modulus), bool(solid[k])))
    return crossovers


def _steady(flags: Bools) -> Bools:
    """As their neighbours where these agree."""
    return median_filter(flags.astype(np.int8), 3, mode="nearest").astype(bool)


def read_sweeps(path: str | Path) -> list[Sweep]:
    """Every strain and frequency sweep of a file; rows that cannot be used are counted in `notes`.

    A table with every setting equally often (a sweep run three times, or up and down) is that many sweeps.

    Raises:
        InputError: the file cannot be read, holds no table of G' and G'', or leaves a unit open.
    """
    path = Path(path)
    sweeps: list[Sweep] = []
    refusals: list[str] = []
    with guarded(path):
        parts = [part for table in read_columns(path, VOCABULARY, ("storage", "loss")) for part in _intervals(table)]
        for number, (label, table) in enumerate(parts, 1):
            try:
                sweeps += _sweeps(table, label or (str(number) if len(parts) > 1 else ""))
            except InputError as error:
                if error.code != _NO_SWEEP:
                    raise
                refusals.append(str(error))
        require(bool(sweeps), "; ".join(refusals), _NO_SWEEP)
        digest = sha256(path)
    for sweep in sweeps:
        stem = printable(path.stem)
        sweep.name = f"{stem}[{sweep.name}]" if len(sweeps) > 1 and sweep.name else stem
        sweep.source, sweep.source_sha256 = file_label(path), digest
        sweep.notes += [f"left out of the file: {'; '.join(dict.fromkeys(refusals))}"] if refusals else []
    return sweeps


def _intervals(table: Table) -> Iterator[tuple[str, Table]]:
    """(label, rows) of each interval that a column tells apart; ("", all rows) where none does."""
    column = next(iter(table.all("interval")), None)
    labels = column.text if column else [""] * len(table.rows)
    if len(set(labels)) == len(labels):  # a number for each row
        labels = [""] * len(labels)
    for label in dict.fromkeys(labels) or [""]:
        yield label, table.part([row for row, its_label in zip(table.rows, labels, strict=True) if its_label == label])


def _sweeps(table: Table, label: str) -> Iterator[Sweep]:
    """The sweep that a table holds, or each of its repetitions."""
    rows = [row for row in table.rows if not any("invalid" in cell.lower() for cell in row.texts)]
    invalid, table = len(table.rows) - len(rows), table.part(rows)
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
    notes += [note for column in columns for note in column.assumed]
    if columns[0].unit in _HERTZ:
        notes.append(f"{columns[0].title!r} is in {columns[0].unit}: converted to rad/s by 2 pi")
    data = np.stack([column.factor * column.numbers[usable] for column in columns])
    held = np.full(data.shape[1], np.nan)
    for column in first.values():
        values = column.numbers[usable]
        for omega in np.unique(data[0]) if kind == "frequency" else ():
            strains = values[np.abs(data[0] / omega - 1) < _SAME]
            trouble = (
                f"{len(strains)} rows at {omega:.4g} rad/s with strains that differ by more than a factor of {_SWEPT:g}"
            )
            remedy = "two sweeps in one table; give them as two files, or tell them apart by a column `interval`"
            require(len(strains) < 3 or _span(strains) <= _SWEPT, f"{trouble}: {remedy}", "rheometer.two_sweeps")
        try:
            held = values * column.factor
        except InputError:
            notes.append(f"{column.title!r} is not used: its unit is missing or not known")
    passes = _passes(data[0])
    for number in range(times := int(passes.max()) + 1):
        sweep_notes = notes + [f"each {kind} {times} times: read as {times} sweeps"] * (times > 1)
        name = label if times == 1 else f"{label}.{number + 1}".lstrip(".")
        yield _sweep(kind, data[:, passes == number], held[passes == number], name=name, notes=sweep_notes)


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
    counts: dict[float, int] = {}  # how often each setting came
    passes = np.zeros(len(x), dtype=int)
    for row, value in enumerate(x):
        setting = next((earlier for earlier in counts if abs(value / earlier - 1) < _SAME), value)
        passes[row] = counts.get(setting, 0)
        counts[setting] = counts.get(setting, 0) + 1
    return passes if len(set(counts.values())) == 1 else np.zeros_like(passes)
