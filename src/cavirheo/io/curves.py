"""Read tables of radius histories with a header, or in one of two recognisable layouts without a header; write them.

A header names the columns, as in `time_us,radius_um`, in lower or upper case and in several languages. The units (s,
ms, us, ns; m, mm, um, px) are part of the titles (`time_s`, `t [us]`, `R (microns)`) or stand in the row below. Frame
numbers with a frame rate may replace the times, and diameters the radii. A file of several curves has a column `curve`
or `shot`, or one column of radii per curve (`R1_um,R2_um`, `Shot 1 (um)`). Optional columns are `radius_std_um`, and
for each curve `rmax_um` (the true R_max) and `stretch` with `stretch_std` (R_max/R_0 and its standard deviation).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.files import guarded
from cavirheo.io.tables import LENGTH_UNITS, TIME_UNITS, Column, Name, Table, Term, Vocabulary, read_columns, unit_of
from cavirheo.messages import Message
from cavirheo.parameters import FRAME_RATE, RADIUS
from cavirheo.writing.document import write_rows

RADIUS_UNITS = {**LENGTH_UNITS, "px": 1e-6}  # px: a placeholder factor until R_max is given
_PLAUSIBLE = (5e-6, 5e-3)  # m; limits of the largest radius: a number is within them in only one of the units m, mm, um
_LARGEST_NUMBER = 1e9  # in any unit; larger numbers are damaged data and would overflow later
_TIME_TOLERANCE = 1e-15  # s; times closer than this are one time and differ only by rounding
_LEAST_RADIUS = 1e-9  # m; a smaller radius means an empty frame (one published file has denormal numbers there)
SCALE_TOLERANCE = 0.02  # relative; scale factors that differ by less count as one, since R_max is only estimated
_UNITS = {unit: np.nan for unit in (*TIME_UNITS, *RADIUS_UNITS)}  # recognises a unit of another quantity, to report it
_SHOT = r"(?:shot|bubble|curve|run|exp|experiment|schuss|blase|kurve|tir|bulle|courbe|essai|disparo|burbuja|curva)"
_NUMBER = re.compile(rf"(?:\b|_)?({_SHOT}?)[\s_#.\-]*(\d+)(?!.*\d)", re.I)  # the last number in a title
_SEPARATOR = -1000.0
_RATIOS = (0.55, 1.6)  # first collapse time over the Rayleigh time: the range that proves the units of time and radius
_ADVICE = "begin the file with a header line such as time_us,radius_um, or time_us,R1_um,R2_um for several shots"


def _shot_name(title: str) -> Name:
    """Return what a title with a shot number names (`R2_um`, `Radius shot 2 (um)`, `Shot 2 (um)`); `R0` has none."""
    match = _NUMBER.search(title[:200])
    if not match or not match[2].strip("0"):
        return Name()
    shot, number = match.groups()
    words = f"{title[: match.start()]} {title[match.end() :]}".strip()
    kind, unit, _ = CURVES.name_by_words(words)
    if kind in ("time", "radius", "diameter"):
        return Name(kind, unit, number)
    unit = unit_of(words.strip("_[]()/ "), RADIUS_UNITS)
    return Name("radius", unit, number) if shot and (unit or not words) else Name()


CURVES = Vocabulary(
    {
        "time": Term("t time elapsedtime zeit temps tiempo tempo 時間 时间", _UNITS),
        "frame": Term(
            "frame frames frameno framenumber framenr frameindex framenum image imageno imagenumber bild bildnr "
            "bildnummer fotograma cuadro numeroimage numerodimage フレーム フレーム番号 コマ 帧 帧号 帧数",
            _UNITS,
        ),
        "radius": Term(
            "r radius rt rnew bubbleradius radiusofbubble radiusofthebubble meanradius averageradius equivalentradius "
            "blasenradius rayon rayonbulle rayondebulle rayondelabulle radio radioburbuja radiodeburbuja "
            "radiodelaburbuja raggio raio 半径 半徑 気泡半径 气泡半径 氣泡半徑",
            _UNITS,
            duplicate_advice="the shots of a file are R1_um, R2_um, or have a column `shot`",
        ),
        "max_radius": Term("rmax truermax maxradius maximumradius", _UNITS),
        "stretch": Term("stretch lambdamax lambdamaxmean"),
        "stretch_std": Term("stretchstd lambdamaxstd"),
        "radius_std": Term("radiusstd rstd radiussd rsd", _UNITS),
        "diameter": Term(
            "diameter bubblediameter meandiameter equivalentdiameter durchmesser blasendurchmesser diametre "
            "diametrebulle diametredebulle diametredelabulle diametro 直径 直徑 気泡直径 气泡直径",
            _UNITS,
        ),
        "curve": Term("curve shot"),
    },
    _ADVICE,
    required=("time|frame", "radius|diameter"),
    codes=dict.fromkeys(("empty", "rows"), "table.empty") | {"columns": "table.columns", "twice": "table.twice"},
    fallback=_shot_name,
    allows_no_header=True,
)


_TRACE = Vocabulary(
    {
        "time": Term("t time zeit temps tiempo 時間 时间", TIME_UNITS),
        "pressure": Term("p pressure druck pression presion 圧力 压力 壓力", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}),
    },
    "expected a pressure trace with the columns time_us,pressure_kPa",
    ("time", "pressure"),
    dict.fromkeys(("columns", "empty", "no_unit", "unit"), "trace.header") | {"twice": "trace.twice"},
)


def read(path: Path, density: float, pressure: float, frame_rate: float | None = None) -> list[RadiusCurve]:
    """Read the curves of a table. Raises InputError: unknown layout, a missing column, or a cell that is no number."""
    (table,) = read_columns(path, CURVES)
    curves = _read_with_header(table, frame_rate) if table.titles else _read_without_header(table, density, pressure)
    return [curve.with_notes("read from the first sheet of the workbook") if table.sheet else curve for curve in curves]


def _read_with_header(table: Table, frame_rate: float | None) -> list[RadiusCurve]:
    shot, std, max_radius, *stretches = map(table.find, ("curve", "radius_std", "max_radius", "stretch", "stretch_std"))
    radii, (times, time_unit) = _radii(table), _times(table, frame_rate)
    if std and len(radii) > 1:
        table.notes.append(f"{std.title!r} is not used: there are {len(radii)} columns of radii")
        std = None
    for column in radii:
        check_units(f"the header {table.titles}", time_unit, column.unit, std.unit if std else None)
    deviation = std.numbers if std else np.full(len(times), np.nan)
    message = f"a column {shot.title!r} and {len(radii)} columns of radii; expected one or the other" if shot else ""
    require(not shot or len(radii) == 1, message, "table.twice")
    shots: dict[str, list[int]] = {}
    for k, label in enumerate(shot.text if shot else [""] * len(table.rows)):
        shots.setdefault(label, []).append(k)
    limits.check(len(shots) * len(radii), limits.CURVES, "curves")
    curves = []
    for column in radii:
        radius = column.numbers * (0.5 if column.name.kind == "diameter" else 1.0)
        for label, rows in shots.items():
            meta = _stretch_meta(stretches, rows, table.notes)
            if shot or len(radii) > 1:
                meta["label"] = label if shot else re.sub(r"\s*[\[(].*", "", column.title) or column.title
            curve = make_curve(times[rows], radius[rows], deviation[rows], time_unit, column.unit, meta)
            curves.append(_scaled_to_column(curve, max_radius, rows) if max_radius else curve)
    return curves


def _scaled_to_column(curve: RadiusCurve, column: Column, rows: list[int]) -> RadiusCurve:
    """Scale a curve to the R_max in these rows of a column, if any. Raises InputError: several, or implausible."""
    if column.unit not in RADIUS_UNITS or column.unit == "px":
        return curve.with_notes(f"the column {column.title!r} is not used: it names no unit of length, as rmax_um does")
    sizes = sorted({float(value) for value in column.numbers[rows] if np.isfinite(value)})
    message = f"{column.title!r} has {len(sizes)} values for one curve, {sizes[:2]}: expected its R_max in every row"
    require(len(sizes) < 2, message, "table.several_sizes")
    if not sizes:
        return curve
    RADIUS.check(column.title, size := sizes[0] * RADIUS_UNITS[str(column.unit)], "curve.max_radius")
    with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
        factor = size / curve.max_radius
        off = abs(factor - 1.0) >= SCALE_TOLERANCE
        scaled = f"radii of {curve.name} scaled by {factor:.3g}" if off else "radii scaled to it"
        hint = f"R_max of each shot as the column {column.title!r} has it: {scaled}"
        return curve.labelled(hints=(*curve.hints, hint)).with_max_radius(size)
    return curve


def _stretch_meta(columns: list[Column | None], rows: list[int], notes: list[str]) -> dict[str, Any]:
    """Return the `meta` of one curve: the stretch that the columns state for its rows, and the notes."""
    meta: dict[str, Any] = {"notes": [*notes]}
    for column in filter(None, columns):
        values = {float(value) for value in column.numbers[rows] if np.isfinite(value)}
        if len(values) == 1:
            meta[column.name.kind] = values.pop()
        elif values:  # it varies, so it is another quantity
            meta["notes"].append(f"the column {column.title!r} is not used: it changes from frame to frame")
    if "stretch" in meta:
        spread = meta.get("stretch_std", np.nan)
        meta["notes"].append(f"the file states the stretch {meta['stretch']:.4g} +- {spread:.2g}")
    return meta


def _radii(table: Table) -> list[Column]:
    """Return the columns of radii. Raises InputError: it is unclear which columns to use."""
    radii = table.all("radius") or table.all("diameter")
    table.notes.extend(["diameters halved"] * (radii[0].name.kind == "diameter"))
    if scaled := [column for column in radii if column.unit != "px"]:
        note = "the column in pixels is not used: there is one in a unit of length"
        table.notes.extend([note] * (len(scaled) < len(radii)))
        radii = scaled
    unnumbered = [column for column in radii if not column.name.number]
    if unnumbered and len(unnumbered) < len(radii):
        titles = " and ".join(repr(column.title) for column in radii[:2])
        message = f"{titles}: two readings of one bubble, or two shots? keep one column, or number all of them"
        raise InputError(message, "table.twice")
    table.at_most_one(unnumbered)
    message = f"two columns {radii[0].title!r}; number them"
    require(len({column.title for column in radii}) == len(radii), message, "table.twice")
    if len(radii) > 1:
        titles = ", ".join(column.title for column in radii[:6]) + (", ..." if len(radii) > 6 else "")
        table.notes.append(f"{len(radii)} columns of radii, a curve each: {titles}")
    return radii


def _times(table: Table, frame_rate: float | None) -> tuple[Floats, str | None]:
    """Return ((rows,) times, their unit), from the times in the file or from its frame numbers and the frame rate."""
    time, frame = table.find("time"), table.find("frame")
    if time:
        table.notes.extend(["the frame rate that is given is not used: the file has times"] if frame_rate else [])
        return time.numbers, time.unit
    assert frame is not None  # a header without times has frame numbers
    if frame_rate is None:
        message = f"{frame.title!r} has numbers of frames and no times: give the frame rate (--fps 1e6)"
        raise InputError(message, "table.frame_rate")
    FRAME_RATE.check("the frame rate", frame_rate, "table.frame_rate")
    table.notes.append(f"times of the numbers in {frame.title!r} at {frame_rate:.6g} frames per second, as given")
    return frame.numbers / frame_rate, "s"


def _read_without_header(table: Table, density: float, pressure: float) -> list[RadiusCurve]:
    """Read curves separated by rows of -1000, or a column of times and one of radii whose sizes prove their units."""
    width = max(len(row.texts) for row in table.rows)
    values = [Column(table, index, "", Name(), Term("")).numbers for index in range(width)]
    while len(values) > 2 and np.isnan(values[-1]).all():  # an empty column: each line ends with a separator
        values.pop()
    require(len(values) == 2, f"{len(values)} columns and no header; {_ADVICE}", "table.header")
    numbers = np.column_stack(values)
    separators = np.flatnonzero(np.all(numbers == _SEPARATOR, axis=1))
    if len(separators):
        limits.check(len(separators), limits.CURVES, "curves")
        blocks = [block[np.any(block != _SEPARATOR, axis=1)] for block in np.split(numbers, separators)]
        filled = [block for block in blocks if (block[:, 1] > 1e-9).any()]
        without = sum(len(block) > 0 for block in blocks) - len(filled)
        require(bool(filled), "no curve between the rows of -1000 holds a radius", "table.empty")
        note = "curves separated by rows of -1000, no header"
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        curves = (make_curve(block[:, 0], block[:, 1], meta={"notes": (note,)}) for block in filled)
        return [curve.with_notes(*table.notes) for curve in curves]
    meta = {"notes": ("no header: columns taken as time and radius",)}
    curve = make_curve(values[0], values[1], meta=meta).with_notes(*table.notes)
    ratio = curve.rayleigh_ratio(density, pressure)
    proven = ratio is not None and _RATIOS[0] <= ratio <= _RATIOS[1]
    require(proven, f"no header, and the numbers do not prove their units; {_ADVICE}", "table.header")
    return [curve]


def read_trace(path: Path) -> tuple[Floats, Floats, list[str]]:
    """Read (n,) times in s, (n,) pressures above the ambient pressure in Pa, and notes of what was recognised or left
    out, from the columns time_us and pressure_kPa (or in other units, which the titles must name).

    Raises InputError: the file cannot be read, lacks these columns, or has a cell that is no number.
    """
    with guarded(path):
        (table,) = read_columns(path, _TRACE)
        return table.column("time").si, table.column("pressure").si, table.notes


def write_csv(path: str | Path, curve: RadiusCurve, remark: str = "") -> None:
    """Write the columns `time_us,radius_um`, and if known `radius_std_um`, `stretch`, `stretch_std`: one row per frame;
    ten digits; nan for a missing radius. remark: text of a first line that begins with "# "."""
    columns = {"time_us": 1e6 * curve.time, "radius_um": 1e6 * curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = 1e6 * curve.radius_std
    stated = {"stretch": curve.stretch, "stretch_std": curve.stretch_std}
    columns |= {name: np.full(len(curve.time), value) for name, value in stated.items() if value is not None}
    rows = zip(*columns.values(), strict=True)
    texts = ({name: f"{value:.10g}" for name, value in zip(columns, row, strict=True)} for row in rows)
    write_rows(path, list(columns), texts, remark)


def check_units(where: str, time: str | None, radius: str | None, radius_std: str | None) -> None:
    """Check the units. Raises InputError: one is of another quantity, or radii and their deviations differ in unit."""
    fine = time in (None, *TIME_UNITS) and radius in (None, *RADIUS_UNITS)
    message = f"{where} gives time in {time} and radius in {radius}; expected units of time and of length"
    require(fine, message, "table.units")
    message = f"radius is in {radius} but radius_std in {radius_std}; give both in one unit"
    require(radius_std in (None, radius), message, "table.units")


def unusable_curve(reason: str, meta: Mapping[str, Any], **fields: Any) -> RadiusCurve:
    """Return a curve without samples, with the reason. fields: other fields of the curve."""
    return RadiusCurve(np.empty(0), np.empty(0), meta={**meta, "notes": (reason,)}, **fields, unusable=reason)


def make_curve(
    time: ArrayLike,
    radius: ArrayLike,
    radius_std: ArrayLike | None = None,
    time_unit: str | None = None,
    radius_unit: str | None = None,
    meta: Mapping[str, Any] | None = None,
    **fields: Any,
) -> RadiusCurve:
    """Clean one curve: (n,) times and radii (and their deviations) in their units; None: infer the unit from the size.

    Radii that are NaN, below 1 nm or absurdly large (1e9 or more) become NaN. Frames without a time are left out.
    Frames are sorted by time, and the radii of one time are averaged. The notes count each of these cases, after the
    notes in `meta`; times out of order are also among the curve's `warnings`. If the size contradicts the unit of the
    radius, the curve is unscaled. fields: other fields of the curve.

    Raises InputError: the unit of time is not given and cannot be inferred.
    """
    t, r = (np.asarray(a, dtype=np.float64).ravel() for a in (time, radius))
    std = np.full(r.shape, np.nan) if radius_std is None else np.asarray(radius_std, dtype=np.float64).ravel()
    meta = dict(meta or {})
    if len(t) != len(r) or len(std) != len(r):
        return unusable_curve(f"{len(t)} times but {len(r)} radii", meta, **fields)
    timed = np.abs(t) < _LARGEST_NUMBER
    t, r, std = t[timed], np.where(np.abs(r) < _LARGEST_NUMBER, r, np.nan)[timed], std[timed]
    n, missing = len(t), np.count_nonzero(np.isnan(r))
    per_time, time_hint = _time_scale(t, time_unit)
    per_radius, radius_hint, unscaled = _radius_scale(r, radius_unit)
    t, r, std = t * per_time, r * per_radius, std * per_radius
    empty = r < _LEAST_RADIUS
    r[empty], std[~(std > 0)] = np.nan, np.nan
    backwards = np.count_nonzero(np.diff(t) < 0)
    order = np.argsort(t, kind="stable")
    first = np.flatnonzero(np.diff(t[order], prepend=-np.inf) > _TIME_TOLERANCE)
    t, r, std = t[order][first], _averaged(r[order], first), _averaged(std[order], first)
    warnings = (Message("check_input.time_order", {"steps": int(backwards)}),) if backwards else ()
    remarks = {
        f"{len(timed) - n} of {len(timed)} frames without a time left out": n < len(timed),
        time_hint: time_hint,
        radius_hint: radius_hint,
        f"{missing} of {n} frames without a radius (NaN)": missing,
        f"{empty.sum()} frames with radius <= 0 marked as not measured": empty.any(),
        **{warning.text: True for warning in warnings},
        f"{n - len(t)} frames repeat a time: the radii of one time averaged": len(t) < n,
        unscaled: unscaled,
    }
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) > 1 else 0.0
    if step and np.mean(np.abs(steps - step) < 0.01 * step) > 0.5:
        meta.setdefault("frame_rate_hz", 1.0 / step)
    meta["notes"] = (*meta.get("notes", ()), *(remark for remark, applies in remarks.items() if applies))
    if hints := (*meta.pop("hints", ()), *filter(None, (time_hint, radius_hint))):
        meta["hints"] = hints
    try:
        return RadiusCurve(t, r, std, meta, **{"unscaled": unscaled, **fields}, warnings=warnings)
    except InputError as error:  # not a bubble; the other curves of the file remain usable
        return unusable_curve(str(error), meta, **fields)


def _averaged(values: Floats, first: NDArray[np.intp]) -> Floats:
    """Return the mean of the finite values in each run (NaN without any); the runs begin at the indices `first`."""
    finite = np.isfinite(values)
    count = np.add.reduceat(finite.astype(int), first)
    total = np.add.reduceat(np.where(finite, values, 0.0), first)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _radius_scale(r: Floats, unit: str | None) -> tuple[float, str, str]:
    """Return (factor to metres, a note, why there is no scale) from the largest radius and the given unit, if any."""
    finite = np.sort(r[np.isfinite(r) & (r > _LEAST_RADIUS)])  # the limit holds in any unit
    largest = float(finite[-3] if len(finite) >= 5 else finite.max(initial=0.0))  # the two largest may be wrong
    if unit == "px":
        return RADIUS_UNITS["px"], "", f"the radius is in pixels (largest {largest:.4g}) without um per pixel"
    fits = [u for u in ("m", "mm", "um") if _PLAUSIBLE[0] <= largest * RADIUS_UNITS[u] <= _PLAUSIBLE[1]]
    if largest <= 0.0 or unit in fits:
        return RADIUS_UNITS[unit or "um"], "", ""
    words = f"the radius is given in {unit}" if unit else "no unit is given for the radius"
    if 0.8 < largest < 1.25:  # rather R/R_max than a bubble of 1 mm
        return 1e-6, "", f"{words}, but its largest value {largest:.4g} looks like R/R_max"
    if unit or not fits:
        only = f"; it only makes sense in {fits[0]}" if fits else ""
        return 1e-4 / largest, "", f"{words}; its largest value {largest:.4g} is no bubble of 5 um to 5 mm{only}"
    return RADIUS_UNITS[fits[0]], f"{words}: taken as {fits[0]} from its size", ""


def _time_scale(t: Floats, unit: str | None) -> tuple[float, str]:
    """Return (factor to seconds, a note). Recordings of collapses last 1 us to 5 ms, so the span shows the unit."""
    if unit:
        return TIME_UNITS[unit], ""
    span = float(np.ptp(t)) if len(t) else 0.0
    unit = "s" if len(t) < 2 or 5e-7 <= span <= 5e-3 else "us"
    message = f"the unit of time cannot be told from its span ({span:.4g}); name it in the header, e.g. time_us"
    require(unit == "s" or 1.0 <= span <= 5e3, message, "table.time")
    return TIME_UNITS[unit], f"no unit given for time: taken as {unit} from its span"
