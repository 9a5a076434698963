"""Tables become RadiusCurves: which columns are the times and radii of which shot, and in which unit. Write CSV.

Layouts and titles: docs/how-to/your-shots.md. The notes name the columns that are not used.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve, rate_warnings
from cavirheo.errors import InputError, listed
from cavirheo.io.files import MOST_CURVES, Source, check_limit
from cavirheo.io.names import AREA_UNITS, CURVES, OF_CAMERA, OF_MEDIUM, RADIUS_UNITS, STATED, WITHOUT_TIMES
from cavirheo.io.tables import Column, Name, Table, read_columns
from cavirheo.landmarks import median_where_large
from cavirheo.messages import Message, aspherical_warnings, camera_warnings
from cavirheo.parameters import LENGTH_UNITS, RADIUS, TIME_UNITS
from cavirheo.physics.media import CONSTANTS
from cavirheo.writing.digits import counted
from cavirheo.writing.document import write_rows

Part = TypeVar("Part")
Indices = NDArray[np.intp]
_PLAUSIBLE = (5e-6, 5e-3)  # m; limits of the largest radius: a number is within them in only one of the units m, mm, um
_LARGEST_NUMBER = 1e9  # in any unit; larger numbers are damaged data and would overflow later
_TIME_TOLERANCE = 1e-15  # s; times closer than this are one time and differ only by rounding
_LEAST_RADIUS = 1e-9  # m; a smaller radius means an empty frame (one published file has denormal numbers there)
_SHARED_TIMES = 0.05  # largest part of the frames that may have the time of another one
_ROUNDED_SHARE, _COARSE = 0.2, 0.1  # least part of the shorter or longer intervals, and of an interval, for a rounding
_SEVERAL_ROWS = 1.5  # rows of a frame by its times and the frame rate: more are rows of several shots
_FEWEST_FRAMES = 5  # of a shot below another one: fewer frames with earlier times are out of order
_LATEST_START = 0.25  # of the duration of the first shot: where shots below it begin; later ones are out of order
_LONG_GAP = 20.0  # median intervals; a longer one that is longer than all before it may part two shots
SCALE_TOLERANCE = 0.02  # relative; scale factors that differ by less count as one, since R_max is only estimated
_DIAMETER_TOLERANCE = 0.1  # relative; diameters that differ by more from two radii are none of them
_STRETCH_TOLERANCE = 0.05  # relative; a larger difference of two stretches of a file is a doubt
_FORMULAS = "; formulas that were never calculated have no values before a spreadsheet saves them"
_REMARK = re.compile(r"\W*([A-Za-z_][\w ]*?)(?:\s*[:=]\s*|\s+)(\d+\.?\d*(?:[eE][+-]?\d+)?)\s*[\[(]?(.*?)[\])]?\s*$")
_RATIOS = (0.55, 1.6)  # first collapse time over the Rayleigh time: the range that proves the units of time and radius
_MOST_REMARKS = 1000  # that are looked through


class Camera(NamedTuple):
    """What is known of the camera: frames per s, micrometres per pixel; None: not known. doubt_rate: whether it is a
    doubt if the times contradict the rate. doubt_scale: whether it is one if the scale is not used."""

    frame_rate: float | None = None
    um_per_px: float | None = None
    doubt_rate: bool = True
    doubt_scale: bool = True


class Form(NamedTuple):
    """How columns of these kinds give the radius: a note, and R of their numbers. deviation: that of R over that of the
    column; 0 if a column of deviations is of something else."""

    kinds: tuple[str, ...]
    note: str
    radius: Callable[..., Floats]
    deviation: float = 0.0


FORMS = (  # the first ones that a table has are used
    Form(("radius",), "", lambda radius: radius, 1.0),
    Form(("diameter",), "diameters halved", lambda diameter: 0.5 * diameter, 0.5),
    Form(("half_a", "half_b"), "R = (a^2 b)^(1/3) of the half-axes", lambda a, b: np.cbrt(a * a * b)),
    Form(("major", "minor"), "R = (a^2 b)^(1/3) of half the axes", lambda a, b: 0.5 * np.cbrt(a * a * b)),
    Form(("area",), "R = sqrt(A/pi) of the areas A", lambda area: np.sqrt(np.where(area < 0.0, np.nan, area) / np.pi)),
)


class _Series(NamedTuple):
    """One radius of a table, as one column or two, and the columns that belong to it."""

    form: Form
    radius: tuple[Column, ...]
    clock: Column | None
    deviation: Column | None
    at_rest: Column | None
    max_radius: Column | None
    shot: Column | None
    stated: list[Column]

    @property
    def used(self) -> list[Column]:
        others = (self.clock, self.deviation, self.at_rest, self.shot, self.max_radius)
        return [*self.radius, *self.stated, *(column for column in others if column)]


def read_text(source: Source, density: float, pressure: float, camera: Camera) -> list[RadiusCurve]:
    """Read the curves of a text or a workbook. Raises InputError: as `read_table`, or there is no table."""
    try:
        tables = read_columns(source, CURVES)
    except InputError as error:
        if camera.frame_rate is None or error.code != "table.columns":
            raise
        try:
            tables = read_columns(source, WITHOUT_TIMES)
        except InputError:
            raise error from None
    if tables[0].titles:
        names = [table.name for table in tables] if len(tables) > 1 else [""]
        return read_each([*zip(names, tables, strict=True)], partial(read_table, camera))
    return [curve for table in tables for curve in _read_without_header(table, density, pressure, camera)]


def read_each(parts: Collection[tuple[str, Part]], read: Callable[[Part], list[RadiusCurve]]) -> list[RadiusCurve]:
    """Read the curves of all parts. The label of a part, unless it is "", becomes that of its curve, or stands before
    the labels of its curves; a part that cannot be read is an unusable curve.

    Raises InputError: no part can be read, or a limit is exceeded.
    """
    check_limit(len(parts), MOST_CURVES, "curves")
    curves: list[RadiusCurve] = []
    problems: list[InputError] = []
    for label, part in parts:
        try:
            found = read(part)
        except InputError as error:
            if error.code.startswith("limits."):
                raise
            problems.append(error)
            found = [unusable_curve(error.message, {})]
        if label:
            labels = [f"{label}, {curve.meta['label']}" for curve in found] if len(found) > 1 else [label]
            found = [curve.labelled(label=each) for curve, each in zip(found, labels, strict=True)]
        curves += found
        check_limit(len(curves), MOST_CURVES, "curves")
    if problems and len(problems) == len(curves):
        raise problems[0]
    return curves


def read_table(camera: Camera, table: Table) -> list[RadiusCurve]:
    """Read the curves of a table. Raises InputError: an unknown layout, a missing column, a cell that is no number, or
    a frame rate or scale that is needed and not given."""
    series = _series(table)
    camera, meta, used, warnings = _facts(table, camera)
    used += [column for one in series for column in one.used]
    notes = [*meta["notes"], series[0].form.note]
    titles = [one.radius[0].title.removeprefix(f"{table.name}/") for one in series]
    names = [""]
    if len(series) > 1:
        notes.append(f"{len(series)} columns of radii, a curve each: {listed(titles)}")
        names = [re.sub(r"\s*[\[(].*", "", re.sub(r".*\{(\d+)\}$", r"\1", title)) or title for title in titles]
    if len({*names}) < len(names):
        names = [str(k) for k in range(1, len(names) + 1)]
    notes.append(_unused(table, {column.index for column in used}))
    meta["notes"] = list(filter(None, notes))
    several_clocks = len({one.clock.index for one in series if one.clock}) > 1
    curves = read_each([*zip(names, series, strict=True)], partial(_read_series, camera, meta, several_clocks))
    return [curve.labelled(warnings=(*curve.warnings, *warnings)) for curve in curves]


def _series(table: Table) -> list[_Series]:
    """Return each radius with its columns. Raises InputError: two columns may be two shots, or readings of one."""
    form = next((form for form in FORMS if all(map(table.all, form.kinds))), None)
    if form is None:
        raise InputError(f"one of two axes among {table.titles}: expected both, as in a_um and b_um", "table.columns")
    _check_diameters(table.all("radius"), table.all("diameter"))
    shot = table.find("curve")
    shots = len({*shot.text}) if shot else 1
    radii = list(zip(*map(table.all, form.kinds), strict=False))
    without_number = ((column, column.title.replace(column.name.number, "", 1)) for column, *_ in radii)
    rests = [column for column, title in without_number if STATED.name(title).kind == "radius at rest"]
    rests = [column for column in rests if len(radii) > 1 and len(_distinct(column.numbers)) <= shots]
    radii = [columns for columns in radii if columns[0] not in rests]
    radii = [columns for columns in radii if columns[0].unit not in ("px", "px2")] or radii
    clocks = table.all("time") or [column for column in table.all("frame") if len({*column.text}) > 1]
    firsts = [columns[0] for columns in radii]
    if shot and len(radii) > 1:
        both = f"a column {shot.title!r} and {len(radii)} columns of radii"
        raise InputError(f"{both}; expected one or the other", "table.twice")
    letters = [title for title in table.titles if re.fullmatch(r"(.*/)?[A-D]( \(.*\))?", title)]
    units = {column.unit for column in (*firsts, *table.all("half_a"))}  # "D (um)" may have that of the row below
    unclear = form.kinds[0] == "diameter" and len(letters) == 4 and len(units) == 1
    if form.kinds[0] == "half_a" and re.search(r"(^|/)A(?![A-Za-z])", firsts[0].title):
        unclear, letters = True, [column.title for column in radii[0]]
    if unclear:
        message = f"{', '.join(map(repr, letters))}: shots, or the half-axes of one bubble? no name says which is the "
        raise InputError(f"{message}radius: name them R1_um and R2_um, or a_um and b_um", "table.twice")
    numbers = {column.name.number for column in firsts}
    if len(clocks) < 2 and len(firsts) > 1 and ("" in numbers or len(numbers) < len(firsts)):
        titles = " and ".join(repr(column.title) for column in firsts[:2])
        message = f"{titles}: two readings of one bubble, or two shots? keep one column, or number all: R1_um, R2_um"
        raise InputError(message, "table.twice")
    clock_of = _of_each(firsts, clocks) or [table.at_most_one(clocks)] * len(firsts)
    deviations = [column for column in table.all("radius_std") if column.unit in (None, *RADIUS_UNITS)]
    deviation_of = _of_each(firsts, deviations if form.deviation else []) or [None] * len(firsts)
    at_rest = [*rests, *table.all("radius at rest")]
    at_rest_of = _of_each(firsts, at_rest) or [next(iter(at_rest), None)] * len(firsts)
    maxima = table.all("max_radius")
    max_radius_of = _of_each(firsts, maxima) or [table.at_most_one(maxima)] * len(firsts)
    stated_of = list[Sequence[Column | None]]()
    for columns in filter(None, map(table.all, ("stretch", "stretch_std", *OF_MEDIUM))):
        numbered = [column for column in columns if column.name.number]
        stated_of.append(_of_each(firsts, numbered) or [columns[0]] * len(firsts))
    of_each = zip(radii, clock_of, deviation_of, at_rest_of, max_radius_of, strict=True)
    return [
        _Series(form, *columns, shot, list(filter(None, (each[k] for each in stated_of))))
        for k, columns in enumerate(of_each)
    ]


def _check_diameters(radii: Sequence[Column], diameters: Sequence[Column]) -> None:
    """Raise InputError if the only diameters are not about twice the only radii."""
    if not len(radii) == len(diameters) == 1 or len(radii[0].numbers) != len(diameters[0].numbers):
        return
    (radius,), (diameter,) = radii, diameters
    if radius.unit != diameter.unit and not {radius.unit, diameter.unit} <= LENGTH_UNITS.keys():
        return
    factor = LENGTH_UNITS.get(diameter.unit or "", 1.0) / LENGTH_UNITS.get(radius.unit or "", 1.0)
    ratio = factor * float(np.nanmedian(diameter.numbers / radius.numbers))
    if abs(0.5 * ratio - 1.0) > _DIAMETER_TOLERANCE:
        both = f"{diameter.title!r} is {ratio:.3g} times {radius.title!r}, and a diameter is twice a radius"
        raise InputError(f"{both}: remove the column that is wrong", "table.twice")


def _of_each(radii: Sequence[Column], columns: Sequence[Column]) -> Sequence[Column | None]:
    """Return the column that belongs to each radius, by number, else by order; none if their counts differ."""
    if len(radii) != len(columns):
        return []
    numbers = {column.name.number: column for column in columns}
    if len(numbers) < len(columns):
        return columns
    return [numbers.get(radius.name.number, columns[k]) for k, radius in enumerate(radii)]


def _of_all(table: Table) -> Iterator[Column]:
    """Yield the columns of all shots: no array has a number for one alone; and what remarks such as "density 1060
    kg/m3" state, as columns of one number."""
    yield from (column for column in table.columns if not column.name.number)
    for match in filter(None, (_REMARK.match(remark[:200]) for remark in table.remarks[:_MOST_REMARKS])):
        word, number, unit = match.groups()
        name = CURVES.name(f"{word} [{unit}]" if unit else word)
        yield Column(table, -1, word, name, np.array([float(number)]))


def stated(table: Table) -> dict[str, tuple[Column, float]]:
    """Return what single numbers, and columns of one number, state of medium and camera, by quantity, in SI: the first
    of each that is possible; NaN for remarks that state two."""
    facts: dict[str, tuple[Column, float]] = {}
    for column in _of_all(table):
        kind, unit, _ = column.name
        if kind not in (*OF_MEDIUM, *OF_CAMERA) or len(values := _distinct(column.numbers)) != 1:
            continue
        value = values[0] * (STATED.terms[kind].units.get(unit, np.nan) if unit else 1.0)
        if 0.0 < value < np.inf:
            first, known = facts.setdefault(kind, (column, value))
            if first.index < 0 and not np.isclose(value, known, rtol=1e-9):
                facts[kind] = first, np.nan
    return facts


def _facts(table: Table, camera: Camera) -> tuple[Camera, dict[str, Any], list[Column], list[Message]]:
    """Return the camera as the user gives it, else as the file states it; the `meta` of a curve with what is stated of
    the medium, and notes; the columns of all that is taken from the file; and a warning where both differ."""
    meta: dict[str, Any] = {"notes": [*table.notes], "hints": table.hints}
    used, warnings = [], list[Message]()
    meta["ignored"] = {*OF_MEDIUM} & {column.name.kind for column in (*table.columns, *_of_all(table))}
    for kind, (column, value) in stated(table).items():
        if np.isnan(value):
            meta["notes"].append(f"not used: two values of the {kind} in comments")
            continue
        if kind in OF_MEDIUM:
            meta.setdefault("medium", {})[kind] = value
            unit = CONSTANTS[kind].unit
        else:
            field, unit, of_camera = OF_CAMERA[kind]
            known, found = getattr(camera, field), of_camera(value)
            if field == "um_per_px":
                camera = camera._replace(doubt_scale=False)
            elif known is None:
                camera = camera._replace(doubt_rate=True)
            if known is not None:
                what = "um per pixel" if field == "um_per_px" else "frames per second"
                warnings += camera_warnings(known, found, what, column.title)
                continue
            changes: Any = {field: found}
            camera = camera._replace(**changes)
        used.append(column)
        what = f"the file states the {kind.replace('_', ' ')}: {column.title} = {value:.6g} {unit}"
        meta["notes"].append(what.rstrip())
    return camera, meta, used, warnings


def _unused(table: Table, used: set[int]) -> str:
    """Return a note that names the columns that are not used, "" if there are none."""
    filled = {k for row in table.rows for k, cell in enumerate(row.texts) if cell} or {*range(len(table.arrays))}
    titles = [title or f"column {k}, without a title" for k, title in enumerate(table.titles, 1)]
    left = [re.sub(r"\{\d+\}$", "", titles[k]) for k in sorted(filled - used)]
    return f"not used: {listed(left, 12)}" if left else ""


def _read_series(camera: Camera, meta: Mapping[str, Any], several_clocks: bool, series: _Series) -> list[RadiusCurve]:
    """Read the curves of one radius: one, or shots below each other. Raises InputError: no unit, or no times; arrays of
    different lengths."""
    notes = [*meta["notes"]]
    clock = series.clock
    of_frames = [column for column in (*series.radius, clock, series.deviation, series.shot) if column]
    if len({len(column.text if column is series.shot else column.numbers) for column in of_frames}) > 1:
        sizes = " and ".join(f"{len(column.text)} of {column.title}" for column in of_frames)
        raise InputError(f"arrays of different lengths: {sizes}", "matlab.cells")
    radius = series.form.radius(*(column.numbers for column in series.radius))
    unit = _unit_of_radius(series, notes)
    too_large = bool(np.nanmax(radius, initial=0.0) > 1e3 * _PLAUSIBLE[1])  # for m or mm
    in_pixels = unit == "px" or (unit is None and too_large)
    if clock is None or _counts_frames(clock):
        _ask_for(camera, series, unit, in_pixels=in_pixels, notes=notes)
    formulas = _FORMULAS if series.radius[0].array is None and series.radius[0].table.name else ""  # of a sheet
    time = clock.numbers if clock else np.arange(float(len(radius)))
    if clock and not several_clocks and time.size and not (np.abs(time) < _LARGEST_NUMBER).any():
        message = f"{clock.title!r} holds no number below {_LARGEST_NUMBER:g}"
        raise InputError(f"{message}: of times since 1970 subtract the first one{formulas}", "table.empty")
    for column in series.radius:
        if formulas and not any(column.text):
            raise InputError(f"{column.title!r} is empty{formulas}", "table.empty")
    std = _deviations(series, radius, notes)
    scale = 1.0
    if camera.um_per_px is not None and in_pixels:
        scale, unit = camera.um_per_px, "um"
        notes.append(f"radii in pixels of {scale:g} um")
    scale_doubts = [] if in_pixels else _unused_scale(camera, unit, notes)
    rows_of: dict[str, list[int]] = {}
    for row, label in enumerate(_labels(series.shot, notes) if series.shot else ()):
        rows_of.setdefault(label, []).append(row)
    rows_of = rows_of or {"": [*range(len(time))]}

    def read(numbers: list[int]) -> list[RadiusCurve]:
        rows = np.array(numbers, dtype=np.intp)
        if several_clocks:  # rows below a shot that is shorter than another one
            rows = rows[np.isfinite(time[rows]) | np.isfinite(radius[rows])]
        parts, lost = _parts(time[rows], radius[rows])
        check_limit(len(parts), MOST_CURVES, "curves")
        curves = []
        for number, part in enumerate(parts, 1):
            chosen = rows[part]
            about = {**meta, "notes": [*notes, *lost]}
            if len(parts) > 1:
                about["label"] = str(number)
                about["notes"].append(f"the times begin again: shot {number} of {len(parts)} below each other")
            seconds, unit_of_time = _times(time[chosen], clock, camera, about["notes"])
            values = seconds, scale * radius[chosen], scale * std[chosen], (unit_of_time, unit)
            curve = _curve(*values, about, camera.frame_rate)
            doubts = [*_aspherical(series.radius, radius, chosen)]
            doubts += rate_warnings(curve, camera.frame_rate) if camera.doubt_rate else ()
            curve = curve.labelled(warnings=(*curve.warnings, *doubts, *scale_doubts))
            curves.append(_with_stated(curve, series, chosen, float(np.nanmax(radius[chosen], initial=0.0))))
        return curves

    return read_each(rows_of.items(), read)


def _unused_scale(camera: Camera, unit: str | None, notes: list[str]) -> list[Message]:
    """Note that a known scale is not used for radii that are no pixels; and return the doubt that this is."""
    if camera.um_per_px is None:
        return []
    why = "the radii have a unit of length" if unit else "the radii are too small for pixels"
    notes.append(f"the scale is not used: {why}")
    return [Message("check_input.scale_unused", {"given": camera.um_per_px})] if camera.doubt_scale else []


def _unit_of_radius(series: _Series, notes: list[str]) -> str | None:
    """Return the unit of length that the columns name. Raises InputError: they name another one, or two."""
    title, unit = series.radius[0].title, series.radius[0].unit
    clock = series.clock
    if any(column.unit != unit for column in series.radius):
        both = " and ".join(column.title for column in series.radius)
        raise InputError(f"{both}: give both in one unit", "table.units")
    if series.form.kinds == ("area",):
        if unit is not None and unit not in AREA_UNITS:
            raise InputError(f"{title!r} is in {unit}: expected a unit of area, as in Area [um^2]", "table.units")
        if unit is None:
            notes.append(f"{title!r} has no unit: taken to be in px^2")
        unit = AREA_UNITS.get(unit or "px")
    if (clock and clock.unit not in (None, "frame", *TIME_UNITS)) or unit not in (None, *RADIUS_UNITS):
        units = f"time in {clock.unit if clock else None} and radius in {unit}"
        titles = [column.title for column in (clock, *series.radius) if column]
        raise InputError(f"{titles} give {units}; expected units of time and of length", "table.units")
    return unit


def _deviations(series: _Series, radius: Floats, notes: list[str]) -> Floats:
    """Return the (n,) standard deviations in the unit of the radius. Raises InputError: their units do not agree."""
    deviation, unit = series.deviation, series.radius[0].unit
    if deviation is None:
        return np.full(len(radius), np.nan)
    if not np.any(deviation.numbers > 0.0):
        notes.append(f"{deviation.title!r} is not used: a standard deviation is above 0, and none of its numbers is")
        return np.full(len(radius), np.nan)
    notes.append(f"{deviation.title!r} is taken as the standard deviation of the radius in each frame")
    unit = unit or next(iter(_units_by_size(_largest(radius))), None)
    factor = series.form.deviation
    if deviation.unit not in (None, unit):
        if deviation.unit not in LENGTH_UNITS or unit not in LENGTH_UNITS:
            message = f"{deviation.title!r} is in {deviation.unit} and the radius in {unit}: give both in one unit"
            raise InputError(message, "table.units")
        factor *= LENGTH_UNITS[deviation.unit] / LENGTH_UNITS[unit]
    return factor * deviation.numbers


def _ask_for(camera: Camera, series: _Series, unit: str | None, *, in_pixels: bool, notes: list[str]) -> None:
    """Raise InputError if there is no frame rate for frames without times, or no unit of the radius and no scale."""
    title, clock = series.radius[0].title, series.clock
    scaled = series.max_radius is not None and series.max_radius.unit in LENGTH_UNITS
    missing = ["the frame rate (--fps 1e6)"] if camera.frame_rate is None else []
    if camera.um_per_px is None and not scaled and in_pixels and (missing or unit is None):
        missing.append(f"the scale (--um-per-px 3.2) of {title!r}, in pixels unless its title says more")
    what = f"{clock.title!r} has numbers of frames and no times" if clock else f"{title!r} has no times"
    if camera.frame_rate is not None:
        what = f"{title!r} has no unit"
    if missing:
        unused = [f"; {note}" for note in notes if note.startswith("not used")]
        raise InputError(f"{what}: give {' and '.join(missing)}{''.join(unused)}", "table.frame_rate")


def _counts_frames(clock: Column) -> bool:
    return clock.name.kind == "frame" or clock.unit == "frame"


def _aspherical(columns: Sequence[Column], radius: Floats, rows: Indices) -> tuple[Message, ...]:
    """Return a warning if two axes differ where the bubble is large in these rows."""
    if len(columns) == 1:
        return ()
    a, b = (column.numbers[rows] for column in columns)
    return aspherical_warnings(median_where_large(radius[rows], np.abs(a - b) / np.maximum(a, b)))


def _labels(shot: Column, notes: list[str]) -> list[str]:
    """Return the (n,) labels of shots: 1.0 is 1, and a blank cell has the label above it, which a note says; those
    above all labels are "unlabelled"."""
    labels = [re.sub(r"^(\d+)\.0*$", r"\1", label) for label in shot.text]
    blank = [k for k, label in enumerate(labels) if not label] if any(labels) else []
    for k in blank:
        labels[k] = labels[k - 1] if k else "unlabelled"
    if blank:
        notes.append(f"{len(blank)} blank cells of {shot.title!r} filled with the label above them")
    return labels


def _parts(time: Floats, radius: Floats) -> tuple[list[Indices], list[str]]:
    """Return the indices of the frames of each shot in (n,) times, which begin again with each, and notes on the rows
    that are no frames: those without a time, and after the start those with time 0 and no radius."""
    timed = np.abs(time) < _LARGEST_NUMBER
    latest = np.maximum.accumulate(np.r_[-np.inf, np.where(timed, time, -np.inf)])[:-1]  # before each row
    padding = (time == 0.0) & ~(radius > 0.0) & (latest >= 0.0)
    lost = []
    if not timed.all():
        lost.append(f"{len(time) - timed.sum()} of {len(time)} frames without a time left out")
    if padding.any():
        lost.append(f"{padding.sum()} rows with time 0 and no radius left out: lost frames or padding")
    frames = np.flatnonzero(timed & ~padding)
    parts = np.split(frames, np.flatnonzero(np.diff(time[frames]) < 0) + 1)
    whole = time[parts[0]]
    start = whole[0] + _LATEST_START * np.ptp(whole) if len(whole) else np.nan
    begins_again = all(len(part) >= _FEWEST_FRAMES and time[part[0]] <= start for part in parts)
    return parts if begins_again else [frames], lost


def _times(time: Floats, clock: Column | None, camera: Camera, notes: list[str]) -> tuple[Floats, str | None]:
    """Return ((n,) times, their unit) of the frames of one shot; by the frame rate if they are numbered, as by times
    without a unit that count by one, or if their times have too few digits."""
    rate = camera.frame_rate
    steps = np.diff(time)
    counts = clock is not None and clock.unit is None and len(steps) > 0 and bool(np.all(steps == 1.0))
    if rate is not None and (clock is None or _counts_frames(clock) or counts):
        what = f"of the numbers in {clock.title!r}" if clock else "of the rows"
        notes.append(f"times {what} at {rate:.6g} frames per second")
        return time / rate, "s"
    assert clock is not None  # a frame rate was asked for
    shared = np.count_nonzero(steps == 0.0) > _SHARED_TIMES * len(time)
    several = rate is not None and _rows_per_frame(time, clock, rate) > _SEVERAL_ROWS
    if rate is not None and not several and (shared or _rounding(time[np.isfinite(time)])):
        notes.append(f"times in {clock.title!r} have too few digits: {rate:.6g} frames per second are used instead")
        return np.arange(len(time)) / rate, "s"
    if rate is not None:
        notes.append("the frame rate is not used: the file has times")
        return time, clock.unit
    counts_mostly = len(steps) >= _FEWEST_FRAMES and np.mean(steps == 1.0) > 0.5 and not np.any(steps % 1.0)
    if clock.unit is None and counts_mostly:
        message = f"{clock.title!r} counts by one and has no unit: are these numbers of frames, or times? "
        message += "give the frame rate (--fps 1e6), or write a unit into the title, as in time_us"
        raise InputError(message, "table.frame_rate")
    return time, clock.unit


def _rows_per_frame(time: Floats, clock: Column, rate: float) -> float:
    """Return how many of the (n,) times, which may be rounded, are of one frame; 0 if it is not known."""
    with suppress(InputError):  # no unit
        rounding = float(np.min(np.diff(time), initial=np.inf, where=np.diff(time) > 0.0))
        return (len(time) - 1) / ((np.ptp(time) + rounding) * _time_scale(time, clock.unit)[0] * rate)
    return 0.0


def _single(column: Column, rows: Indices) -> list[float]:
    """Return the distinct numbers of a column in some rows, or the one that is stated for all."""
    return _distinct(column.numbers[rows] if len(column.numbers) > np.max(rows, initial=1) else column.numbers)


def _distinct(numbers: Floats) -> list[float]:
    return np.unique(numbers[np.isfinite(numbers)]).tolist()


def _with_stated(curve: RadiusCurve, series: _Series, rows: Indices, largest: float) -> RadiusCurve:
    """Return the curve with the R_max and the stretch that the file states for these rows. largest: the number of its
    largest radius. Raises InputError: several R_max, or an implausible one."""
    if column := series.max_radius:
        curve = _scaled_to_column(curve, column, rows)
    meta: dict[str, Any] = {}
    medium = {**curve.medium}
    notes = list[str]()
    doubts = list[Message]()
    for column in series.stated:
        kind, unit, _ = column.name
        values = _single(column, rows)
        if kind in OF_MEDIUM:
            factor = column.term.units.get(unit, np.nan) if unit else 1.0
            if len(values) == 1 and 0.0 < (value := factor * values[0]) < np.inf:
                if medium.get(kind) != value:
                    notes.append(f"the file states the {kind}: {column.title} = {value:.6g} {CONSTANTS[kind].unit}")
                medium[kind] = value
            elif kind not in medium:
                notes.append(f"{column.title!r} is not used: it is not one number above 0 in a known unit")
        elif len(values) == 1 and (0.0 if kind == "stretch_std" else 1.0) <= values[0] <= 100.0:
            meta[kind] = values[0]
        elif values:
            notes.append(f"{column.title!r} is not used: it changes from frame to frame, or is no stretch")
    if "stretch" in meta:
        deviation = f" +- {meta['stretch_std']:.2g}" if "stretch_std" in meta else ""
        notes.append(f"the file states the stretch {meta['stretch']:.4g}{deviation}")
    if column := series.at_rest:
        stretch = _stretch_at_rest(curve, column, rows, largest)
        if "stretch" in meta:
            notes.append(f"{column.title!r} is not used: the file states the stretch, too")
            if abs(stretch / meta["stretch"] - 1.0) > _STRETCH_TOLERANCE:
                doubts.append(Message("check_input.stretches", {"stated": meta["stretch"], "at_rest": stretch}))
        elif 1.0 < stretch < 100.0:
            meta["stretch"] = stretch
            notes.append(f"the file states the stretch {stretch:.4g}: R_max over {column.title}")
        else:
            notes.append(f"{column.title!r} is not used: it gives no stretch")
            if not np.isnan(stretch):
                doubts.append(Message("check_input.at_rest", {"ratio": stretch, "title": column.title}))
    ignored = sorted({*curve.meta.get("ignored", ())} - medium.keys())
    curve = curve.labelled(**meta, medium=medium, ignored=ignored, warnings=(*curve.warnings, *doubts))
    return curve.with_notes(*notes)


def _stretch_at_rest(curve: RadiusCurve, column: Column, rows: Indices, largest: float) -> float:
    """Return R_max over the radius at rest in these rows; NaN if one of them is not known. largest: as in
    `_with_stated`."""
    per_number = float(np.nanmax(curve.radius, initial=0.0)) / largest if largest > 0.0 else np.nan
    values = _single(column, rows)
    at_rest = (values[0] if len(values) == 1 else np.nan) * LENGTH_UNITS.get(column.unit or "", per_number)  # m
    with suppress(InputError):  # no scale, or no maximum
        return curve.max_radius / at_rest if at_rest > 0.0 else np.nan
    return np.nan


def _scaled_to_column(curve: RadiusCurve, column: Column, rows: Indices) -> RadiusCurve:
    """Scale a curve to the R_max in these rows of a column, if any. Raises InputError: several, or implausible."""
    if column.unit not in LENGTH_UNITS:
        return curve.with_notes(f"{column.title!r} is not used: it names no unit of length, as rmax_um does")
    sizes = _single(column, rows)
    if len(sizes) > 1:
        values = f"{len(sizes)} values for one curve, {sizes[:2]}"
        raise InputError(f"{column.title!r} has {values}: expected its R_max in every row", "table.several_sizes")
    if not sizes:
        return curve
    size = sizes[0] * LENGTH_UNITS[column.unit]
    RADIUS.check(column.title, size, "curve.max_radius")
    hint = f"R_max of each shot as the column {column.title!r} has it"
    with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
        if not curve.unscaled and abs(size / curve.max_radius - 1.0) >= SCALE_TOLERANCE:
            hint += f": radii scaled by {size / curve.max_radius:.3g}"
        return curve.labelled(hints=(*curve.hints, hint)).with_max_radius(size)
    return curve


def _read_without_header(table: Table, density: float, pressure: float, camera: Camera) -> list[RadiusCurve]:
    """Read a column of times and one of radii, or radii of a known frame rate, whose sizes prove their units."""
    width = max(len(row.texts) for row in table.rows)
    values = [Column(table, index, "", Name()).numbers for index in range(width)]
    while len(values) > 2 and np.isnan(values[-1]).all():  # an empty column: each line ends with a separator
        values.pop()
    alone = len(values) == 1
    if len(values) > 2 or (alone and camera.frame_rate is None):
        raise InputError(f"{counted(len(values), 'column')} and no header; {CURVES.expected}", "table.header")
    titles = ["radius"] if alone else ["time", "radius"]
    unit = next(iter(_units_by_size(_largest(values[0]))), None) if alone and camera.um_per_px is None else None
    empty = (values[-1] < _LEAST_RADIUS) & (not alone)  # lost frames, or rows of -1000 between shots
    arrays = [(Name(title, unit), column[~empty]) for title, column in zip(titles, values, strict=True)]
    notes = [f"no header: columns taken as {' and '.join(titles)}{f' in {unit}' if unit else ''}", *table.notes]
    if empty.any():
        notes.append(f"{np.count_nonzero(empty)} rows with radius <= 0 left out")
    curves = read_table(camera, Table(CURVES, [], notes, titles=titles, arrays=arrays))
    ratios = [ratio for curve in curves if (ratio := curve.rayleigh_ratio(density, pressure))]
    if not ratios or not all(_RATIOS[0] <= ratio <= _RATIOS[1] for ratio in ratios):
        title = "radius_um" if camera.um_per_px is None else "radius_px"
        advice = f"check the frame rate, or begin the file with the line {title}" if alone else CURVES.expected
        raise InputError(f"no header, and the numbers do not prove their units; {advice}", "table.header")
    return curves


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


def unusable_curve(reason: str, meta: Mapping[str, Any]) -> RadiusCurve:
    """Return a curve without samples, with the reason."""
    return RadiusCurve(np.empty(0), np.empty(0), meta=dict(meta), unusable=reason)


def _curve(
    t: Floats, r: Floats, std: Floats, units: tuple[str | None, str | None], meta: Mapping[str, Any], rate: float | None
) -> RadiusCurve:
    """Clean one curve: (n,) finite times and radii (and their deviations) in their units; None: infer the unit from the
    size. If the size contradicts the unit of the radius, the curve is unscaled; if many frames share times, unusable.
    The notes count what is left out. Raises InputError: the unit of time is not given and cannot be inferred."""
    meta = dict(meta)
    r = np.where(np.abs(r) < _LARGEST_NUMBER, r, np.nan)
    n, missing, backwards = len(t), np.count_nonzero(np.isnan(r)), np.count_nonzero(np.diff(t) < 0)
    if 0 < backwards < n - 1 and np.all(np.diff(r) > 0):
        reason = f"the times go back in {backwards} of {n - 1} steps, and the radius always grows"
        return unusable_curve(f"{reason}: are the columns exchanged?", meta)
    per_time, time_note = _time_scale(t, units[0])
    per_radius, radius_note, unscaled = _radius_scale(r, units[1])
    t, r, std = t * per_time, r * per_radius, std * per_radius
    empty = r < _LEAST_RADIUS
    r[empty], std[~((std > 0) & (std < np.inf))] = np.nan, np.nan
    order = np.lexsort((np.isnan(r), t))  # of frames of one time, one with a radius comes first
    if reason := _shared_times(t[order], r[order], rate):
        return unusable_curve(reason, meta)
    first = order[np.diff(t[order], prepend=-np.inf) > _TIME_TOLERANCE]
    t, r, std = t[first], r[first], std[first]
    warnings: tuple[Message, ...] = ()
    if backwards:
        warnings += (Message("check_input.time_order", {"steps": int(backwards)}),)
    if step := _rounding(t):
        values = {"step": 1e6 * step, "interval": 1e6 * float(np.mean(np.diff(t)))}
        warnings += (Message("check_input.time_digits", values),)
    if gap := _gap(t):
        warnings += (Message("check_input.time_gap", {"gap": 1e6 * gap}),)
    remarks = {
        time_note: time_note,
        radius_note: radius_note,
        f"{missing} of {n} frames without a radius (NaN)": missing,
        f"frames with radius <= 0 marked as not measured: {empty.sum()}": empty.any(),
        f"{n - len(t)} frames repeat the time of another one, which is kept": len(t) < n,
    }
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) > 1 else 0.0
    if step and np.mean(np.abs(steps - step) < 0.01 * step) > 0.5:
        meta.setdefault("frame_rate_hz", 1.0 / step)
    meta["notes"] = (*meta.get("notes", ()), *(remark for remark, applies in remarks.items() if applies))
    by_size = ((time_note, per_time), (radius_note, per_radius))
    if hints := [note for note, factor in by_size if note and factor != 1.0]:  # SI units surprise nobody
        meta["hints"] = (*meta.get("hints", ()), *hints)
    try:
        return RadiusCurve(t, r, std, meta, unscaled=unscaled, warnings=warnings)
    except InputError as error:  # not a bubble; the other curves of the file remain usable
        return unusable_curve(str(error), meta)


def _gap(t: Floats) -> float:
    """Return the longest interval of ascending times (n,), s, if it seems to part two shots: it is longer than all that
    is before it, and many frames long; else 0."""
    steps = np.diff(t)
    k = int(np.argmax(steps)) if len(t) >= 2 * _FEWEST_FRAMES else 0
    parts = _FEWEST_FRAMES <= k + 1 <= len(t) - _FEWEST_FRAMES
    return float(steps[k]) if parts and steps[k] > max(t[k] - t[0], _LONG_GAP * float(np.median(steps))) else 0.0


def _shared_times(t: Floats, r: Floats, rate: float | None) -> str:
    """Return why the ascending times (n,) of these radii cannot be right, "" if they can: too many frames share them
    with frames of other radii."""
    shared = np.count_nonzero((np.diff(t) <= _TIME_TOLERANCE) & (np.abs(np.diff(r)) > 0.0))
    if shared <= _SHARED_TIMES * len(t):
        return ""
    advice = "or too few digits? write more, or give the frame rate (--fps) of a table"
    if rate is not None:
        advice = f"these times contradict the frame rate of {rate:.6g} per second"
    question = f"{shared} of {len(t)} frames have the time of another one: several shots?"
    return f'{question} give each a file, or name the column of their labels "shot"; {advice}'


def _rounding(t: Floats) -> float:
    """Return the decimal step of ascending times (n,) if it moves the frames: intervals are m or m + 1 steps, and not
    many steps; else 0."""
    interval = float(np.mean(np.diff(t))) if len(t) > 2 else 0.0
    decades = [10.0**-k for k in range(13) if 10.0**-k < 2.0 * interval]
    step = next((step for step in decades if np.all(np.abs(t / step - np.round(t / step)) < 1e-3)), 0.0)
    counts = np.round(np.diff(t) / step) if step else np.empty(0)
    shares = [np.mean(counts == counts.min() + more) for more in (0, 1)] if len(counts) else [0.0, 0.0]
    moves = min(shares) > _ROUNDED_SHARE and sum(shares) > 0.95 and step > _COARSE * interval
    return step if moves else 0.0


def _radius_scale(r: Floats, unit: str | None) -> tuple[float, str, str]:
    """Return (factor to metres, a note, why there is no scale) from the largest radius and the given unit, if any."""
    largest = _largest(r)
    if unit == "px":
        in_pixels = f"the radius is in pixels (largest {largest:.4g}) without um per pixel (--um-per-px)"
        return RADIUS_UNITS["px"], "", in_pixels
    fits = _units_by_size(largest, unit)
    if largest <= 0.0 or unit in fits:
        return RADIUS_UNITS[unit or "um"], "", ""
    words = f"the radius is given in {unit}" if unit else "no unit is given for the radius"
    if 0.8 < largest < 1.25:  # rather R/R_max than a bubble of 1 mm
        return 1e-6, "", f"{words}, but its largest value {largest:.4g} looks like R/R_max"
    if unit or not fits:
        only = f"; in {fits[0]} it would be one: write {fits[0]} into the name of the column" if fits else ""
        return 1e-4 / largest, "", f"{words}; its largest value {largest:.4g} is no bubble of 5 um to 5 mm{only}"
    return RADIUS_UNITS[fits[0]], f"{words}: taken as {fits[0]} from its size", ""


def _largest(radius: Floats) -> float:
    """Return the third largest of the radii, since the two largest may be wrong; of fewer than five the largest."""
    finite = np.sort(radius[np.isfinite(radius) & (radius > _LEAST_RADIUS)])  # the limit holds in any unit
    return float(finite[-3] if len(finite) >= 5 else finite.max(initial=0.0))


def _units_by_size(largest: float, unit: str | None = None) -> list[str]:
    """Return in which of the units m, mm, um, and a given one this is the largest radius of a bubble."""
    units = dict.fromkeys(filter(None, ("m", "mm", "um", unit)))
    return [each for each in units if _PLAUSIBLE[0] <= largest * RADIUS_UNITS[each] <= _PLAUSIBLE[1]]


def _time_scale(t: Floats, unit: str | None) -> tuple[float, str]:
    """Return (factor to seconds, a note). Recordings of collapses last 1 us to 5 ms, so the span shows the unit."""
    if unit:
        return TIME_UNITS[unit], ""
    span = float(np.ptp(t)) if len(t) else 0.0
    unit = "s" if len(t) < 2 or 5e-7 <= span <= 5e-3 else "us"
    if unit == "us" and not 1.0 <= span <= 5e3:
        message = f"the unit of time cannot be told from its span ({span:.4g}): name it, as in time_us"
        raise InputError(message, "table.time")
    return TIME_UNITS[unit], f"no unit given for time: taken as {unit} from its span"
