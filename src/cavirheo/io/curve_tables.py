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
from cavirheo.io.samples import RADIUS_UNITS, TIME_UNITS, check_units, make_curve
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

    Raises InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    (table,) = read_columns(path, CURVES)
    curves = _with_header(table, frame_rate) if table.titles else _without_header(table, density, pressure)
    return [curve.with_notes("read from the first sheet of the workbook") if table.sheet else curve for curve in curves]


def _with_header(table: Table, frame_rate: float | None) -> list[RadiusCurve]:
    shot, std, max_radius, *stretches = map(table.only, ("curve", "radius_std", "max_radius", "stretch", "stretch_std"))
    radii, (clock, time_unit) = _radii(table), _clock(table, frame_rate)
    if std and len(radii) > 1:
        table.notes.append(f"{std.title!r} is not used: there are {len(radii)} columns of radii")
        std = None
    for column in radii:
        check_units(f"the header {table.titles}", time_unit, column.unit, std.unit if std else None)
    deviation = std.numbers if std else np.full(len(clock), np.nan)
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
            meta = _stated_stretch(stretches, rows, table.notes)
            if shot or len(radii) > 1:
                meta["label"] = label if shot else re.sub(r"\s*[\[(].*", "", column.title) or column.title
            curve = make_curve(clock[rows], radius[rows], deviation[rows], time_unit, column.unit, meta)
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
        off = abs(factor - 1.0) >= ONE_SCALE
        scaled = f"radii of {curve.name} scaled by {factor:.3g}" if off else "radii scaled to it"
        hint = f"R_max of each shot as the column {column.title!r} has it: {scaled}"
        return curve.labelled(hints=(*curve.hints, hint)).with_max_radius(size)
    return curve


def _stated_stretch(columns: list[Column | None], rows: list[int], notes: list[str]) -> dict[str, Any]:
    """What columns state of the stretch of one curve, after these notes; one that changes from frame to frame is
    another quantity."""
    meta: dict[str, Any] = {"notes": [*notes]}
    for column in filter(None, columns):
        values = {float(value) for value in column.numbers[rows] if np.isfinite(value)}
        if len(values) == 1:
            meta[column.name.kind] = values.pop()
        elif values:
            meta["notes"].append(f"the column {column.title!r} is not used: it changes from frame to frame")
    if "stretch" in meta:
        spread = meta.get("stretch_std", np.nan)
        meta["notes"].append(f"the file states the stretch {meta['stretch']:.4g} +- {spread:.2g}")
    return meta


def _radii(table: Table) -> list[Column]:
    """The columns of radii, one curve each. Raises InputError: it is not clear which they are."""
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
    single(unnumbered)
    message = f"two columns {radii[0].title!r}; number them"
    require(len({column.title for column in radii}) == len(radii), message, "table.twice")
    if len(radii) > 1:
        titles = ", ".join(column.title for column in radii[:6]) + (", ..." if len(radii) > 6 else "")
        table.notes.append(f"{len(radii)} columns of radii, a curve each: {titles}")
    return radii


def _clock(table: Table, frame_rate: float | None) -> tuple[Floats, str | None]:
    """((rows,) times, their unit), of the times in the file, or its frame numbers and the frame rate.

    Raises InputError: two columns of times, or no frame rate.
    """
    time, frame = table.only("time"), table.only("frame")
    if time:
        table.notes.extend(["the frame rate that is given is not used: the file has times"] if frame_rate else [])
        return time.numbers, time.unit
    assert frame is not None  # a header without times has frames
    if frame_rate is None:
        message = f"{frame.title!r} has numbers of frames and no times: give the frame rate (--fps 1e6)"
        raise InputError(message, "table.frame_rate")
    FRAME_RATE.check("the frame rate", frame_rate, "table.frame_rate")
    table.notes.append(f"times of the numbers in {frame.title!r} at {frame_rate:.6g} frames per second, as given")
    return frame.numbers / frame_rate, "s"


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
        blocks = [block[np.any(block != _SEPARATOR, axis=1)] for block in np.split(numbers, separators)]
        filled = [block for block in blocks if (block[:, 1] > 1e-9).any()]
        without = sum(len(block) > 0 for block in blocks) - len(filled)
        require(bool(filled), "no curve between the rows of -1000 holds a radius", "table.empty")
        note = "curves separated by rows of -1000, no header"
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        curves = (make_curve(block[:, 0], block[:, 1], meta={"notes": (note,)}) for block in filled)
        return [curve.with_notes(*table.notes) for curve in curves]
    require(columns == 2, f"{columns} columns and no header; {_ADVICE}", "table.header")
    meta = {"notes": ("no header: columns taken as time and radius",)}
    curve = make_curve(values[0], values[1], meta=meta).with_notes(*table.notes)
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
