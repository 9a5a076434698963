"""Tables of radius histories: with a header, or one of the two layouts without one that can be told apart.

A header names its columns `time_us,radius_um`, in any case and in several languages, with s, ms, us, ns and m, mm, um,
px written `time_s`, `t [us]`, `R (microns)`, or in the row below. Numbers of frames with a frame rate may stand for
the times, diameters for the radii. Several curves: a column `curve` or `shot`, or one column of radii for each
(`R1_um,R2_um`, `Shot 1 (um)`). Optional: `radius_std_um`; and of each curve `rmax_um`, the true R_max, and `stretch`
with `stretch_std`, what is known of R_max/R_0.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, printable, require
from cavirheo.parameters import RADIUS
from cavirheo.reading import limits
from cavirheo.reading.header import column_of, plain_title, plain_unit
from cavirheo.reading.number_format import Cells, is_number
from cavirheo.reading.samples import RADIUS_UNITS, TIME_UNITS, UNIT_WORDS, make_curve, swapped
from cavirheo.reading.sheet import Table, find_table, numbers
from cavirheo.reading.tabular import Row, read_sheets

ONE_SCALE = 0.02  # by which factors of one scale may differ: R_max is read off the frames
_KINDS = {
    plain_title(word): kind
    for kind, words in {
        "time": "t time elapsedtime zeit temps tiempo tempo 時間 时间",
        "frame": "frame frames frameno framenumber framenr frameindex framenum image imageno imagenumber bild bildnr "
        "bildnummer fotograma cuadro numeroimage numerodimage フレーム フレーム番号 コマ 帧 帧号 帧数",
        "radius": "r radius rt rnew bubbleradius radiusofbubble radiusofthebubble meanradius averageradius "
        "equivalentradius blasenradius rayon rayonbulle rayondebulle rayondelabulle radio radioburbuja "
        "radiodeburbuja radiodelaburbuja raggio raio 半径 半徑 気泡半径 气泡半径 氣泡半徑",
        "max_radius": "rmax truermax maxradius maximumradius",
        "stretch": "stretch lambdamax lambdamaxmean",
        "stretch_std": "stretchstd lambdamaxstd",
        "radius_std": "radiusstd rstd radiussd rsd",
        "diameter": "d diameter bubblediameter meandiameter equivalentdiameter durchmesser blasendurchmesser "
        "diametre diametrebulle diametredebulle diametredelabulle diametro 直径 直徑 気泡直径 气泡直径",
        "area": "a area bubblearea flache blasenflache aire surface superficie 面積 面积",
        "curve": "curve shot",
    }.items()
    for word in words.split()
}
_UNITS = dict.fromkeys(_KINDS.values(), UNIT_WORDS) | {"area": dict.fromkeys(f"{u}2" for u in RADIUS_UNITS)}
_SHOT = r"(?:shot|bubble|curve|run|exp|experiment|schuss|blase|kurve|tir|bulle|courbe|essai|disparo|burbuja|curva)"
_NUMBER = re.compile(rf"(?:\b|_)?({_SHOT}?)[\s_#.\-]*(\d+)(?!.*\d)", re.I)  # the last one in a title
_UNIT = re.compile(r"[\s_\[(/,]([^\W_]+)[\])]?$")
_NO_RADIUS = re.compile(r"(x|y|z|pos|cent|dist|depth|height|width|length|wave|gap|lambda|std|sd|err)", re.I)
_COUNT = r"(\d[\d.,' ]*(?:e\+?\d+)?)"
_RATE = re.compile(
    r"(?:frame.?rate|fps|frames.per.s|bildrate|bildfrequenz|aufnahmerate|cadence|フレームレート|帧率)\D{0,20}?"
    rf"{_COUNT}|{_COUNT}\s*[kM]?(?:fps|frames)",
    re.I,
)
_CAMERA = (1e3, 1e10)  # frames per second that may show the collapse of a bubble
_DIGIT = re.compile(r"\d").search
_SEPARATOR = -1000.0
_PROVEN = (0.55, 1.6)  # Rayleigh times of a first collapse that prove the units of time and radius
_ADVICE = "begin the file with a header line such as time_us,radius_um"


class CurveColumn(NamedTuple):
    """What a title says. kind "": not known; "shot": a length under the name of a shot. number: `2` of R2, else ""."""

    title: str
    kind: str
    unit: str | None
    number: str = ""
    at: int = -1


def column(title: str) -> tuple[str, str | None]:
    """(kind of `_KINDS` or "", unit or None) of a column title such as `R [um]`."""
    kind, unit = column_of(title, _KINDS, _UNITS)
    if unit is None and plain_title(title) in ("d", "a"):
        return "", None
    return kind or "", None if unit is None else UNIT_WORDS.get(unit, unit)


@lru_cache(4096)
def _read_title(title: str) -> CurveColumn:
    """As `column`, and titles of one curve among several: `R2_um`, `Radius shot 2 (um)`, `Shot 2`, `gel_02 [um]`."""
    kind, unit = column(title)
    found = _NUMBER.search(title[:200])
    if kind or not found:
        return CurveColumn(title, kind, unit)
    shot, number = found.groups()
    rest = (title[: found.start()] + " " + title[found.end() :]).strip()
    kind, unit = column(rest)
    if kind in ("time", "radius", "diameter"):
        return CurveColumn(title, kind, unit, number)
    written = _UNIT.search(title)
    unit = UNIT_WORDS.get(plain_unit(written[1])) if written else None
    bare = not rest or bool(written and rest.strip("_[]()/ ") == written[1])
    named = unit in RADIUS_UNITS and not _NO_RADIUS.match(title)
    return CurveColumn(title, "shot" if (shot and bare) or named else "", unit, number)


def _column(title: str) -> tuple[str, str | None]:
    return _read_title(title)[1:3]


def _is_header(cells: Cells) -> bool:
    kinds = {_read_title(title).kind for title in cells}
    return bool(kinds & {"time", "frame"} and kinds & {"radius", "diameter", "area", "shot"})


def read(path: Path, density: float, pressure: float, frame_rate: float | None = None) -> list[RadiusCurve]:
    """The curves of a text table, or of the first sheet of a workbook; the options are those of `read_curves`.

    Raises:
        InputError: no header and no layout that can be told, a column missing, or a cell that is no number.
    """
    sheet = read_sheets(path, _is_header, most=1)[0]
    require(len(sheet.rows) > 0, f"no rows of data; {_ADVICE}", "table.empty")
    table = find_table(sheet, _is_header, _column)
    if table is not None:
        curves = _with_header(table, frame_rate)
    elif all(map(is_number, sheet.rows[0].cells)):
        width = max(len(row.cells) for row in sheet.rows)
        columns = [numbers(sheet.rows, k) for k in range(width)]
        while len(columns) > 2 and np.isnan(columns[-1]).all():  # each line ends with a separator
            columns.pop()
        found = _without_header(np.column_stack(columns), density, pressure)
        curves = [curve.with_notes(*sheet.notes) for curve in found]
    else:
        data = (k for k, row in enumerate(sheet.rows) if all(map(is_number, row.cells)) and any(map(_DIGIT, row.cells)))
        first = next(data, 1)
        shown = ", ".join(repr(title[:30]) for title in sheet.rows[first - 1].cells[:8])
        timed = any(column(title)[0] in ("time", "frame") for title in sheet.rows[first - 1].cells)
        advice = "name the column radius_um, or those of several shots R1_um,R2_um" if timed else _ADVICE
        raise InputError(f"no columns for time and radius among {shown}; {advice}", "table.columns")
    return [curve.with_notes("read from the first sheet of the workbook") for curve in curves] if sheet.name else curves


def _with_header(table: Table, frame_rate: float | None) -> list[RadiusCurve]:
    columns = [_read_title(title)._replace(at=k) for k, title in enumerate(table.titles)]
    rows, notes = table.rows, list(table.notes)
    require(len(rows) > 0, "a header but no rows of data", "table.empty")
    shot, std, top = (_only(columns, kind) for kind in ("curve", "radius_std", "max_radius"))
    stretched = [one for kind in ("stretch", "stretch_std") if (one := _only(columns, kind))]
    radii, said = _radii(columns)
    clock, time_unit, how, doubts = _clock(columns, rows, table.above, frame_rate)
    units = {column.unit for column in radii}
    known = time_unit in (None, *TIME_UNITS) and units <= {None, *RADIUS_UNITS}
    given = " and ".join(str(column.unit) for column in radii[:2])
    require(known, f"the header {table.titles} gives time in {time_unit} and radius in {given}", "table.units")
    notes += said + how
    deviation = None
    if std and len(radii) > 1:
        notes.append(f"{std.title!r} is not used: there are {len(radii)} columns of radii")
    elif std:
        other = std.unit or radii[0].unit
        why = f"radius is in {radii[0].unit} but radius_std in {other}; give both in one unit"
        require(other == radii[0].unit, why, "table.units")
        deviation = numbers(rows, std.at)
    both = f"a column {shot.title!r} and {len(radii)} columns of radii; expected one or the other" if shot else ""
    require(not shot or len(radii) == 1, both, "table.twice")
    shots: dict[str, list[int]] = {}
    for k, (_, cells) in enumerate(rows):
        shots.setdefault(cells[shot.at] if shot and shot.at < len(cells) else "", []).append(k)
    limits.few(len(shots) * len(radii), limits.CURVES, "curves")
    made = []
    for column in radii:
        radius = numbers(rows, column.at) * (0.5 if column.kind == "diameter" else 1.0)
        for label, mine in shots.items():
            name = label if shot else re.sub(r"\s*[\[(].*", "", column.title) or column.title
            about: dict[str, Any] = {"label": name} if shot or len(radii) > 1 else {}
            about |= {} if deviation is None else {"radius_std": deviation[mine]}
            about |= {"time_unit": time_unit, "radius_unit": column.unit}
            lasting, more = _stated_stretch(stretched, [rows[k] for k in mine])
            curve = make_curve(clock[mine], radius[mine], notes=(*notes, *more), **about, **lasting)
            curve = replace(curve, doubts=(*doubts, *curve.doubts)) if doubts else curve
            made.append(_with_size(curve, top, [rows[k] for k in mine]) if top else curve)
    return made


def _with_size(curve: RadiusCurve, column: CurveColumn, rows: list[Row]) -> RadiusCurve:
    """Scaled to the R_max of a column, if its cells hold one. Raises InputError: two, or no radius of a bubble."""
    if column.unit not in RADIUS_UNITS or column.unit == "px":
        return curve.with_notes(f"the column {column.title!r} is not used: it names no unit of length, as rmax_um does")
    values = numbers(rows, column.at)
    known = sorted({float(value) for value in values if np.isfinite(value)})
    told = f"{column.title!r} has {len(known)} values for one curve, {known[:2]}: expected its R_max in every row"
    require(len(known) < 2, told, "table.several_sizes")
    if not known:
        return curve
    RADIUS.check(column.title, size := known[0] * RADIUS_UNITS[str(column.unit)], "curve.max_radius")
    with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
        factor = size / curve.max_radius
        scaled = (
            "radii scaled to it" if abs(factor - 1.0) < ONE_SCALE else f"radii of {curve.name} scaled by {factor:.3g}"
        )
        hint = f"R_max of each shot as the column {column.title!r} has it: {scaled}"
        curve = replace(curve, meta={**curve.meta, "hints": (*curve.hints, hint)})
        return curve.with_max_radius(size)
    return curve


def _stated_stretch(columns: list[CurveColumn], rows: list[Row]) -> tuple[dict[str, Any], list[str]]:
    """What columns state of the stretch of one curve, and notes; one that changes from frame to frame is another."""
    found, said = dict[str, Any](), list[str]()
    for column in columns:
        values = {float(value) for value in numbers(rows, column.at) if np.isfinite(value)}
        if len(values) == 1:
            found[column.kind] = values.pop()
        elif values:
            said.append(f"the column {column.title!r} is not used: it changes from frame to frame")
    if "stretch" in found:
        said.append(f"the file states the stretch {found['stretch']:.4g} +- {found.get('stretch_std', np.nan):.2g}")
    return found, said


def _only(columns: list[CurveColumn], kind: str) -> CurveColumn | None:
    """The one column of a kind, if there is one. Raises InputError ("table.twice"): there are two."""
    mine = [column for column in columns if column.kind == kind]
    two = " and ".join(repr(column.title) for column in mine[:2])
    mends = {
        "time": "keep the one that counts",
        "radius": "the shots of a file are R1_um, R2_um, or have a column `shot`",
    }
    require(len(mine) < 2, f"two columns for {kind}: {two}; {mends.get(kind, 'expected one')}", "table.twice")
    return mine[0] if mine else None


def _radii(columns: list[CurveColumn]) -> tuple[list[CurveColumn], list[str]]:
    """(the columns of radii, one curve each; notes).

    Raises:
        InputError: there is none, or it is not clear which they are.
    """
    kinds = {kind: [c for c in columns if c.kind == kind] for kind in ("radius", "diameter", "area", "shot")}
    area = kinds["area"][0].title if kinds["area"] else ""
    kind = next(kind for kind, found in kinds.items() if found)
    mend = f"{area!r} is an area: expected a radius; give a column of sqrt(area/pi), if the bubble is round"
    require(kind != "area", mend, "table.area")
    mine, notes = kinds[kind], []
    if len({column.unit for column in mine} - {"px"}) == 1 and any(column.unit == "px" for column in mine):
        notes.append("the column in pixels is not used: there is one in a unit of length")
        mine = [column for column in mine if column.unit != "px"]
    plain, counted = ([c for c in mine if bool(c.number) == has] for has in (False, True))
    if plain and counted:
        shown = " and ".join(repr(column.title) for column in (plain[0], counted[0]))
        unclear = f"{shown}: two readings of one bubble, or two shots? keep one column, or number all of them"
        require({c.number.lstrip("0") for c in counted} == {""}, unclear, "table.twice")  # R0 is another radius
        counted = []
    if not counted:
        _only(plain, kind)
    mine = counted or plain
    require(len({c.title for c in mine}) == len(mine), f"two columns {mine[0].title!r}; number them", "table.twice")
    if len(mine) > 1:
        shown = ", ".join(column.title for column in mine[:6]) + (", ..." if len(mine) > 6 else "")
        notes.append(f"{len(mine)} columns of {'diameters' if kind == 'diameter' else 'radii'}, a curve each: {shown}")
    elif kind == "shot":
        notes.append(f"the column {mine[0].title!r} taken as the radius")
    return mine, notes + (["diameters halved"] if kind == "diameter" else [])


def _clock(
    columns: list[CurveColumn], rows: list[Any], above: list[str], frame_rate: float | None
) -> tuple[Floats, str | None, list[str], list[str]]:
    """((rows,) times, their unit, notes, doubts), of the times in the file, or its frame numbers and the frame rate.

    Raises:
        InputError: two columns of times, or no frame rate, or two.
    """
    time, frame = _only(columns, "time"), _only(columns, "frame")
    if time:
        idle = ["the frame rate that is given is not used: the file has times"] if frame_rate else []
        return numbers(rows, time.at), time.unit, idle, []
    assert frame is not None  # a header without times has frames
    stated = _stated_rates(above)
    rate = frame_rate or (stated[0] if len(stated) == 1 else None)
    found = f"; the file states {' and '.join(f'{one:g}/s' for one in stated)}" if stated else ""
    how = f"{frame.title!r} has numbers of frames and no times{found}: give the frame rate (--frame-rate-hz 1e6)"
    require(rate is not None, how, "table.frame_rate")
    assert rate is not None
    why = f"the frame rate must be positive, frames per second, got {rate!r}"
    require(0 < rate < np.inf, why, "table.frame_rate")
    said = f"times of the numbers in {frame.title!r} at {rate:.6g} frames per second, as "
    other = [one for one in stated if abs(one / rate - 1) > 0.01]
    doubts = [f"the frame rate is given as {rate:.6g}/s, but the file states {other[0]:.6g}/s"] if other else []
    return numbers(rows, frame.at) / rate, "s", [said + ("given" if frame_rate else "the file states"), *doubts], doubts


def _stated_rates(lines: Iterable[str]) -> list[float]:
    """The frame rates, 1/s, that stand above a table (`frame rate: 1,000,000 fps`, `270 kfps`)."""
    found: dict[float, None] = {}
    for line in lines:
        for match in _RATE.finditer(line[:300]):
            unit = 1e3 if re.search(r"\bk(fps|hz)|\dk(fps|hz)", line, re.I) else 1.0
            unit = 1e6 if re.search(r"\bM(fps|hz)|\dM(fps|hz)", line, re.I) else unit
            text = re.sub("[' ]", "", match[1] or match[2]).strip(".,")
            readings = {text.replace(",", ""), text.replace(".", "").replace(",", ".")}
            rates = {float(one) * unit for one in readings if is_number(one) and one.count(".") < 2}
            possible = [rate for rate in rates if _CAMERA[0] <= rate <= _CAMERA[1]]
            if len(possible) == 1:
                found[possible[0]] = None
    return list(found)


def _without_header(table: Floats, density: float, pressure: float) -> list[RadiusCurve]:
    """Curves separated by rows of -1000; else two columns (or one time and two radii) whose units prove themselves."""
    columns = table.shape[1]
    separators = np.flatnonzero(np.all(table == _SEPARATOR, axis=1))
    if len(separators) and columns == 2:
        limits.few(len(separators), limits.CURVES, "curves")
        blocks = [b[np.any(b != _SEPARATOR, axis=1)] for b in np.split(table, separators)]
        filled = [b for b in blocks if np.count_nonzero(b[:, 1] > 1e-9) > 0]
        without = sum(len(b) > 0 for b in blocks) - len(filled)
        require(len(filled) > 0, "no curve between the rows of -1000 holds a radius", "table.empty")
        note = "curves separated by rows of -1000, no header"
        note += f"; {without} blocks of the file hold no radius and were left out" if without else ""
        return [make_curve(b[:, 0], b[:, 1], notes=(note,)) for b in filled]
    require(columns in (2, 3), f"{columns} columns and no header; {_ADVICE}", "table.header")
    time, radius, note = table[:, 0], table[:, 1], "no header: columns taken as time and radius"
    if columns == 3:
        radius = table[:, 1:].mean(axis=1)
        apart = 100 * np.abs(table[:, 2] - table[:, 1]) / radius
        known = apart[np.isfinite(apart)]
        middle, most = (np.median(known), np.max(known)) if known.size else (np.inf, np.inf)
        require(middle < 10, f"three columns, no header, and the last two are not two radii; {_ADVICE}", "table.header")
        note = "no header: columns taken as time and two radii of one bubble (semi-axes), which differ by "
        note += f"{middle:.2g} % (median) and {most:.2g} % (most): their mean is used"
    elif swapped(time, radius):
        time, radius = radius, time
        note = "no header: columns taken as radius and time, as only the second rises in even steps"
    curve = make_curve(time, radius, notes=(note,))
    ratio = curve.rayleigh_ratio(density, pressure)
    proven = ratio is not None and _PROVEN[0] <= ratio <= _PROVEN[1]
    require(proven, f"no header, and the numbers do not prove their units; {_ADVICE}", "table.header")
    return [curve]


def write_csv(path: str | Path, curve: RadiusCurve, remark: str = "") -> None:
    """Write `time_us,radius_um` (and `radius_std_um`, and what the file stated of the stretch, where known), one row
    per frame, ten digits, nan for no radius. remark: a line above them, after "# "."""
    columns = {"time_us": curve.time, "radius_um": curve.radius}
    if np.isfinite(curve.radius_std).any():
        columns["radius_std_um"] = curve.radius_std
    columns = {name: 1e6 * values for name, values in columns.items()}
    for name, value in (("stretch", curve.stretch), ("stretch_std", curve.stretch_std)):
        columns |= {} if value is None else {name: np.full(len(curve.time), value)}
    rows = np.column_stack(list(columns.values()))
    with Path(path).open("wb") as file:
        file.write(f"# {printable(remark)}\n".encode() if remark else b"")
        np.savetxt(file, rows, fmt="%.10g", delimiter=",", header=",".join(columns), comments="")
