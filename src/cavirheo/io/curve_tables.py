"""Tables of radius histories: with a header, or one of two layouts without one that can be told apart.

A header names its columns `time_us,radius_um`, in any case and in several languages, with s, ms, us, ns and m, mm, um,
px written `time_s`, `t [us]`, `R (microns)`, or in the row below. Numbers of frames with a frame rate may stand for
the times, diameters for the radii. Several curves: a column `curve` or `shot`, or one column of radii for each
(`R1_um,R2_um`, `Shot 1 (um)`). Optional: `radius_std_um`; and of each curve `rmax_um`, the true R_max, and `stretch`
with `stretch_std`, what is known of R_max/R_0.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io import limits
from cavirheo.io.formats import unit_of
from cavirheo.io.samples import RADIUS_UNITS, TIME_UNITS, make_curve
from cavirheo.io.tables import Column, Name, Table, Term, Vocabulary, read_columns, single
from cavirheo.parameters import FRAME_RATE, RADIUS
from cavirheo.writing.document import write_rows

ONE_SCALE = 0.02  # by which factors of one scale may differ: R_max is read off the frames
_EITHER = {unit: np.nan for unit in (*TIME_UNITS, *RADIUS_UNITS)}  # the unit of another quantity is seen as a mistake
_SHOT = r"(?:shot|bubble|curve|run|exp|experiment|schuss|blase|kurve|tir|bulle|courbe|essai|disparo|burbuja|curva)"
_NUMBER = re.compile(rf"(?:\b|_)?({_SHOT}?)[\s_#.\-]*(\d+)(?!.*\d)", re.I)  # the last one in a title
_SEPARATOR = -1000.0
_PROVEN = (0.55, 1.6)  # Rayleigh times of a first collapse that prove the units of time and radius
_ADVICE = "begin the file with a header line such as time_us,radius_um, or time_us,R1_um,R2_um for several shots"


def _of_one_shot(title: str) -> Name:
    """What titles of one curve among several name: `R2_um`, `Radius shot 2 (um)`, `Shot 2 (um)`; R0 is no shot's."""
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
        "time": Term("t time elapsedtime zeit temps tiempo tempo 時間 时间", _EITHER),
        "frame": Term(
            "frame frames frameno framenumber framenr frameindex framenum image imageno imagenumber bild bildnr "
            "bildnummer fotograma cuadro numeroimage numerodimage フレーム フレーム番号 コマ 帧 帧号 帧数",
            _EITHER,
        ),
        "radius": Term(
            "r radius rt rnew bubbleradius radiusofbubble radiusofthebubble meanradius averageradius equivalentradius "
            "blasenradius rayon rayonbulle rayondebulle rayondelabulle radio radioburbuja radiodeburbuja "
            "radiodelaburbuja raggio raio 半径 半徑 気泡半径 气泡半径 氣泡半徑",
            _EITHER,
            twice="the shots of a file are R1_um, R2_um, or have a column `shot`",
        ),
        "max_radius": Term("rmax truermax maxradius maximumradius", _EITHER),
        "stretch": Term("stretch lambdamax lambdamaxmean"),
        "stretch_std": Term("stretchstd lambdamaxstd"),
        "radius_std": Term("radiusstd rstd radiussd rsd", _EITHER),
        "diameter": Term(
            "diameter bubblediameter meandiameter equivalentdiameter durchmesser blasendurchmesser diametre "
            "diametrebulle diametredebulle diametredelabulle diametro 直径 直徑 気泡直径 气泡直径",
            _EITHER,
        ),
        "curve": Term("curve shot"),
    },
    _ADVICE,
    need=("time|frame", "radius|diameter"),
    codes=dict.fromkeys(("empty", "rows"), "table.empty") | {"columns": "table.columns", "twice": "table.twice"},
    fallback=_of_one_shot,
    bare=True,
)


def read(path: Path, density: float, pressure: float, frame_rate: float | None = None) -> list[RadiusCurve]:
    """The curves of a text table, or of the first sheet of a workbook; the options are those of `read_curves`.

    Raises:
        InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    (table,) = read_columns(path, CURVES)
    curves = _with_header(table, frame_rate) if table.titles else _without_header(table, density, pressure)
    notes = ["read from the first sheet of the workbook"] if table.sheet else []
    return [curve.with_notes(*notes) for curve in curves] if notes else curves


def _with_header(table: Table, frame_rate: float | None) -> list[RadiusCurve]:
    shot, std, max_radius, *stretches = map(table.only, ("curve", "radius_std", "max_radius", "stretch", "stretch_std"))
    radii, radius_notes = _radii(table)
    clock, time_unit, clock_notes = _clock(table, frame_rate)
    units = [column.unit for column in radii]
    fine = time_unit in (None, *TIME_UNITS) and {*units} <= {None, *RADIUS_UNITS}
    message = f"the header {table.titles} gives time in {time_unit} and radius in {' and '.join(map(str, units[:2]))}"
    require(fine, message, "table.units")
    notes = [*table.notes, *radius_notes, *clock_notes]
    deviation = np.full(len(clock), np.nan)
    if std and len(radii) > 1:
        notes.append(f"{std.title!r} is not used: there are {len(radii)} columns of radii")
    elif std:
        message = f"radius is in {units[0]} but radius_std in {std.unit}; give both in one unit"
        require(std.unit in (None, units[0]), message, "table.units")
        deviation = std.numbers
    message = f"a column {shot.title!r} and {len(radii)} columns of radii; expected one or the other" if shot else ""
    require(not shot or len(radii) == 1, message, "table.twice")
    shots: dict[str, list[int]] = {}
    for k, label in enumerate(shot.text if shot else [""] * len(table.rows)):
        shots.setdefault(label, []).append(k)
    limits.few(len(shots) * len(radii), limits.CURVES, "curves")
    curves = []
    for column in radii:
        radius = column.numbers * (0.5 if column.name.kind == "diameter" else 1.0)
        for label, rows in shots.items():
            meta, stretch_notes = _stated_stretch(stretches, rows)
            if shot or len(radii) > 1:
                meta["label"] = label if shot else re.sub(r"\s*[\[(].*", "", column.title) or column.title
            curve = make_curve(
                clock[rows],
                radius[rows],
                deviation[rows],
                time_unit=time_unit,
                radius_unit=column.unit,
                notes=(*notes, *stretch_notes),
                **meta,
            )
            curves.append(_with_size(curve, max_radius, rows) if max_radius else curve)
    return curves


def _with_size(curve: RadiusCurve, column: Column, rows: list[int]) -> RadiusCurve:
    """Scaled to the R_max in these rows of a column, if there is one. Raises InputError: two, or that of no bubble."""
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
        scaled = "radii scaled to it"
        if abs(factor - 1.0) >= ONE_SCALE:
            scaled = f"radii of {curve.name} scaled by {factor:.3g}"
        hint = f"R_max of each shot as the column {column.title!r} has it: {scaled}"
        return curve.labelled(hints=(*curve.hints, hint)).with_max_radius(size)
    return curve


def _stated_stretch(columns: list[Column | None], rows: list[int]) -> tuple[dict[str, Any], list[str]]:
    """What columns state of the stretch of one curve, and notes; one that changes from frame to frame is another."""
    meta, notes = dict[str, Any](), list[str]()
    for column in filter(None, columns):
        values = {float(value) for value in column.numbers[rows] if np.isfinite(value)}
        if len(values) == 1:
            meta[column.name.kind] = values.pop()
        elif values:
            notes.append(f"the column {column.title!r} is not used: it changes from frame to frame")
    if "stretch" in meta:
        notes.append(f"the file states the stretch {meta['stretch']:.4g} +- {meta.get('stretch_std', np.nan):.2g}")
    return meta, notes


def _radii(table: Table) -> tuple[list[Column], list[str]]:
    """(the columns of radii, one curve each; notes). Raises InputError: it is not clear which they are."""
    kind = next(kind for kind in ("radius", "diameter") if table.all(kind))
    radii, notes = table.all(kind), ["diameters halved"] if kind == "diameter" else []
    if scaled := [column for column in radii if column.unit != "px"]:
        notes += ["the column in pixels is not used: there is one in a unit of length"] * (len(scaled) < len(radii))
        radii = scaled
    unnumbered = [column for column in radii if not column.name.number]
    if unnumbered and len(unnumbered) < len(radii):
        titles = " and ".join(repr(column.title) for column in radii[:2])
        message = f"{titles}: two readings of one bubble, or two shots? keep one column, or number all of them"
        raise InputError(message, "table.twice")
    single(unnumbered)
    message = f"two columns {radii[0].title!r}; number them"
    require(len({column.title for column in radii}) == len(radii), message, "table.twice")
    if len(radii) > 1:
        titles = ", ".join(column.title for column in radii[:6]) + (", ..." if len(radii) > 6 else "")
        notes.append(f"{len(radii)} columns of radii, a curve each: {titles}")
    return radii, notes


def _clock(table: Table, frame_rate: float | None) -> tuple[Floats, str | None, list[str]]:
    """((rows,) times, their unit, notes), of the times in the file, or its frame numbers and the frame rate.

    Raises:
        InputError: two columns of times, or no frame rate.
    """
    time, frame = table.only("time"), table.only("frame")
    if time:
        idle = ["the frame rate that is given is not used: the file has times"] if frame_rate else []
        return time.numbers, time.unit, idle
    assert frame is not None  # a header without times has frames
    if frame_rate is None:
        message = f"{frame.title!r} has numbers of frames and no times: give the frame rate (--fps 1e6)"
        raise InputError(message, "table.frame_rate")
    FRAME_RATE.check("the frame rate", frame_rate, "table.frame_rate")
    note = f"times of the numbers in {frame.title!r} at {frame_rate:.6g} frames per second, as given"
    return frame.numbers / frame_rate, "s", [note]


def _without_header(table: Table, density: float, pressure: float) -> list[RadiusCurve]:
    """Curves separated by rows of -1000; else a column of times and one of radii whose units prove themselves."""
    width = max(len(row.texts) for row in table.rows)
    values = [Column(table, at, "", Name()).numbers for at in range(width)]
    while len(values) > 2 and np.isnan(values[-1]).all():  # each line ends with a separator
        values.pop()
    columns, numbers = len(values), np.column_stack(values)
    separators = np.flatnonzero(np.all(numbers == _SEPARATOR, axis=1))
    if len(separators) and columns == 2:
        limits.few(len(separators), limits.CURVES, "curves")
        blocks = [b[np.any(b != _SEPARATOR, axis=1)] for b in np.split(numbers, separators)]
        filled = [b for b in blocks if np.count_nonzero(b[:, 1] > 1e-9) > 0]
        without = sum(len(b) > 0 for b in blocks) - len(filled)
        require(len(filled) > 0, "no curve between the rows of -1000 holds a radius", "table.empty")
        note = "curves separated by rows of -1000, no header"
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        return [make_curve(b[:, 0], b[:, 1], notes=(note,)).with_notes(*table.notes) for b in filled]
    require(columns == 2, f"{columns} columns and no header; {_ADVICE}", "table.header")
    note = "no header: columns taken as time and radius"
    curve = make_curve(values[0], values[1], notes=(note,)).with_notes(*table.notes)
    ratio = curve.rayleigh_ratio(density, pressure)
    proven = ratio is not None and _PROVEN[0] <= ratio <= _PROVEN[1]
    require(proven, f"no header, and the numbers do not prove their units; {_ADVICE}", "table.header")
    return [curve]


def write_csv(path: str | Path, curve: RadiusCurve, remark: str = "") -> None:
    """Write `time_us,radius_um` (and `radius_std_um`, and what the file stated of the stretch, where known), one row
    per frame, ten digits, nan for no radius. remark: a line above them, after "# "."""
    columns = {"time_us": 1e6 * curve.time, "radius_um": 1e6 * curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = 1e6 * curve.radius_std
    stated = {"stretch": curve.stretch, "stretch_std": curve.stretch_std}
    columns |= {name: np.full(len(curve.time), value) for name, value in stated.items() if value is not None}
    rows = zip(*columns.values(), strict=True)
    texts = ({name: f"{value:.10g}" for name, value in zip(columns, row, strict=True)} for row in rows)
    write_rows(path, list(columns), texts, remark)
