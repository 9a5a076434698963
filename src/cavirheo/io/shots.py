"""Read the curves of a file; and the shots of one run: each recording once, with a unique name, in its group.

The way of a file: its path is checked and opened once (`files.Source`). The first bytes choose the reader: a text or a
workbook (`tables`), or a file of arrays (`arrays`), becomes tables with named columns, whose titles `names`
understands; `curves` makes RadiusCurves of them.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, Unpack

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, as_path, parse_number_list, printable, require
from cavirheo.io.arrays import read_arrays
from cavirheo.io.curves import SCALE_TOLERANCE, Camera, read_text
from cavirheo.io.files import Source, guarded
from cavirheo.parameters import FRAME_RATE, RADIUS
from cavirheo.physics.media import Medium
from cavirheo.video.formats import is_video

if TYPE_CHECKING:
    from cavirheo.video.measurement import Measurement, MeasureOptions

Chosen = str | Iterable[int] | None  # which shots of a file: "1,4-7", numbered from 1 in the order of the file
Item = TypeVar("Item")
GROUPINGS = ("auto", "file", "folder", "name", "none")
# the shot number at the end of a name, with the separator before it; a decimal number is no shot number
_NUMBER = re.compile(r"(?:[^\w.,]|_)*(?<![.,])\d+(?: \(\d+\))?[)\]]?$")
ROUNDED, ROUNDED_TIME = 3e-4, 0.02  # of R_max, and of a frame interval: most that rounding changes
_EXPECTED = (
    "expected .mat (R_nondim_All + t_nondim_All + RmaxList, or Rnew + t), .csv or .txt (columns time_us,radius_um), "
    ".h5 (groups with time and radius), .xlsx, .xls or .ods"
)
_NO_GROWTH = (
    "no growth recorded: R_max is taken to be where the file says or at the first frame; "
    "if the recording began later, R_max is larger and G smaller than found"
)


def read_curves(
    path: str | Path,
    *,
    density: float = 998.0,
    pressure: float = 101325.0,
    frame_rate_hz: float | None = None,
    shots: Chosen = None,
    um_per_px: float | None = None,
    exposure: float | None = None,
    exclude: str | Iterable[int] | None = None,
    unusual: bool = False,
    beside_recordings: bool = False,
) -> list[RadiusCurve]:
    """Read every radius history of a file.

    Args:
        path: a table, a .mat or HDF5 file, or a recording (docs/how-to/your-shots.md).
        density: kg/m3. It and `pressure` turn dimensionless times into seconds, t = t* R_max sqrt(rho/p), and check
            the units of a table without a header. They do not change times in seconds.
        pressure: Pa.
        frame_rate_hz: 1/s, of a recording, and of a table without times, or with times of too few digits.
        shots: the curves to return, "1,4-7" or [1, 4, 5, 6, 7], from 1 in the order of the file; None: all.
        um_per_px: micrometres per pixel, of a recording (measured as by `cavirheo.measure`) or of a table in pixels.
        exposure: s, of a frame.
        exclude: frames of a recording to leave out, "12,40-45" or a list, from 1.
        unusual: accept a density and a pressure outside the ranges of liquids and gels, as in `Medium`.
        beside_recordings: whether frame rate and scale are of recordings that are read beside this table: then it is no
            doubt if they do not fit it.

    Returns:
        The curves in the order of the file, with (n,) times in s and radii in m. A curve that cannot be used (empty
        cell, three samples, all NaN) is returned too; its `max_radius` raises InputError with the reason. The `notes`
        of a curve say what was recognised, converted or left out; its `warnings` are the input warnings.

    Raises:
        InputError: the file cannot be found or read, has no radius history, or fewer than `shots` asks for; the message
            says what was found. Or a density or pressure that no liquid or gel has.
    """
    Medium(density, pressure=pressure, vapour_reference_pressure=0.0, unusual=unusual)  # checks both; nothing boils
    path = as_path(path)
    if is_video(path):
        camera: dict[str, Any] = {"frame_rate": frame_rate_hz, "um_per_px": um_per_px, "exposure": exposure}
        _, curve = examine(path, sheet=True, exclude=exclude, **camera)
        return selected([_with_maximum_notes(curve)], shots)
    if exclude is not None:
        message = f"{printable(str(path))}: frames are excluded of recordings; of a table empty their radius"
        raise InputError(message, "reading.exclude")
    check_camera(frame_rate_hz, um_per_px)
    with guarded(path, _EXPECTED) as source:
        doubt = not beside_recordings
        curves = _read(source, density, pressure, Camera(frame_rate_hz, um_per_px, doubt, doubt))
        origin: dict[str, Any] = {"group": path.stem, "source": printable(str(path)), "source_sha256": source.sha256}
        origin |= {"exposure_s": exposure} if exposure else {}
        labels = [f"{path.stem}[{curve.meta.get('label', k)}]" for k, curve in enumerate(curves, 1)]
        labels = labels if len(curves) > 1 else [path.stem]
        chosen = selected(list(zip(curves, labels, strict=True)), shots)
        return [_with_maximum_notes(curve.labelled(name=label, **origin)) for curve, label in chosen]


def _read(source: Source, density: float, pressure: float, camera: Camera) -> list[RadiusCurve]:
    if source.kind == "empty":
        raise InputError(f"the file is empty; {_EXPECTED}", "reading.empty")
    if source.kind == "binary":
        advice = "unpack what is packed, and save arrays of old MATLAB with '-v7'"
        raise InputError(f"binary data of no known format: {advice}; {_EXPECTED}", "reading.binary")
    if source.kind in ("text", "workbook"):
        return read_text(source, density, pressure, camera)
    return read_arrays(source, density, pressure, camera)


def measure(path: str | Path, **options: Unpack[MeasureOptions]) -> RadiusCurve:
    """Measure R(t) in a recording: .mp4, .avi, .mkv, .mov, .tif, .cine, .mraw + .cihx or .cih, or a folder of images.

    Args:
        path: the recording.
        options: `frame_rate` (1/s; needed unless the camera's file states it), `um_per_px` (without it, unless the file
            states it, the curve has no scale), `exposure` (s), `polarity` ("auto", "dark", "bright"), `roi` (x, y,
            width, height in px), `span` (first, last frame), `exclude` (frames to leave out, "12,40-45" or a list);
            frames are counted from 1.

    Returns:
        A curve: (n,) times in s, radii and their standard deviations in m. Frames that cannot be measured are NaN;
        `curve.meta["flags"]` has the reason for each frame.

    Raises:
        InputError: the recording cannot be read, its frame rate is not known, or no bubble is found.

    Source: docs/method/video.md.
    """
    return examine(path, **options)[1]


def examine(
    path: str | Path, *, sheet: bool = False, **options: Unpack[MeasureOptions]
) -> tuple[Measurement, RadiusCurve]:
    """Return (the measurement, its curve), as `measure`; with `sheet` the curve's `meta` has the contact sheet."""
    from cavirheo.video import measurement as video

    path = as_path(path)
    names = video.MeasureOptions.__annotations__.keys()
    unknown = ", ".join(sorted(options.keys() - names))
    require(not unknown, f"measure has no option {unknown}; it has {', '.join(names)}", "video.option")
    with guarded(path, "expected a recording of a bubble", folder=True) as source:
        measurement = video.measure(path, **options)
        origin: dict[str, Any] = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
        origin["source_sha256"] = None if path.is_dir() else source.sha256
        if sheet:
            origin["contact_sheet"] = video.data_url(video.contact_sheet(measurement))
        return measurement, measurement.curve(**origin)


def _with_maximum_notes(curve: RadiusCurve) -> RadiusCurve:
    """Return the curve with notes on its growth and on outlying frames, unless it has no maximum."""
    try:
        start, spikes = curve.time_of_max, curve.spikes()
    except InputError:
        return curve
    growth = int(((curve.time < start) & (curve.radius > 0)).sum())
    notes = [f"{growth} measured frames before R_max (growth)" if growth else _NO_GROWTH]
    if spikes:
        notes.append(f"{len(spikes)} single frames stand out by more than 20 % of R_max; kept, but probably wrong")
    return curve.with_notes(*notes)


def shot_numbers(shots: Chosen) -> list[int] | None:
    """Return the numbers, sorted and each once; None for all. Raises InputError: no valid list, or a number below 1."""
    return None if shots is None else parse_number_list(shots, "shots", "option.shots")


def selected(items: Sequence[Item], shots: Chosen) -> list[Item]:
    """Return the items with these numbers, ascending. Raises InputError: as `shot_numbers`, or too large a number."""
    if (numbers := shot_numbers(shots)) is None:
        return list(items)
    if missing := ", ".join(str(number) for number in numbers if number > len(items)):
        advice = f"give numbers from 1 to {len(items)}, or this file in a command of its own"
        message = f"shot {missing} is asked for, and the file has {len(items)}: {advice}"
        raise InputError(message, "reading.shots")
    return [items[number - 1] for number in numbers]


class CurveSet(NamedTuple):
    """The curves of all files, in order. problems: why files could not be read. remarks: which recordings were given
    twice, which units were told by sizes, and how radii were scaled."""

    curves: list[RadiusCurve]
    problems: list[str]
    remarks: list[str]


def read_shots(
    files: Sequence[str | Path | RadiusCurve], *, max_radius: float | None = None, group: str = "auto", **options: Any
) -> CurveSet:
    """Read all curves of all files; `options` are those of `read_curves`. A RadiusCurve among the files is used as is.

    A recording that is given twice (the same samples, perhaps rounded, in any file) is used once, with a remark. If
    several curves have the same name, their folders are put before it.

    Args:
        max_radius: m, the true R_max, to which all curves are scaled by the same factor.
        group: which shots are one material: "file" (those of a file), "folder" (of all files of a folder), "name" (of
            the files of a folder whose names differ only in the number at their end), "none" (each shot alone),
            "auto" (those of a file, but the single-shot files of a folder together).

    Raises:
        InputError: `max_radius` is no plausible radius, or would scale the curves by different factors; or `group` is
            unknown.
    """
    if group not in GROUPINGS:
        raise InputError(f"group must be one of {', '.join(GROUPINGS)}, got {group!r}", "option.group")
    if max_radius is not None:
        RADIUS.check("the true R_max", max_radius, "curve.max_radius")
    options["beside_recordings"] = any(is_video(Path(path)) for path in files if isinstance(path, str | Path))
    curves: list[RadiusCurve] = []
    problems: list[str] = []
    for path in files:
        try:
            curves += [path] if isinstance(path, RadiusCurve) else read_curves(path, **options)
        except InputError as error:
            problems.append(str(error))
    curves, remarks = _unique_recordings(curves)
    curves = _grouped(_with_unique_names(curves), group)
    remarks += dict.fromkeys(hint for curve in curves for hint in curve.hints)
    if max_radius:
        curves, scale_remarks = _scaled(curves, max_radius)
        remarks += scale_remarks
    return CurveSet(curves, problems, remarks)


def _unique_recordings(curves: list[RadiusCurve]) -> tuple[list[RadiusCurve], list[str]]:
    """Return (the curves without repeated recordings, a remark on each repetition)."""
    kept: dict[int, list[tuple[float, RadiusCurve]]] = {}  # by number of samples; with the largest radius
    unique: list[RadiusCurve] = []
    remarks: list[str] = []
    for curve in curves:
        alike, largest = kept.setdefault(len(curve.time), []), float(np.nanmax(curve.radius, initial=0.0))
        near = (one for size, one in alike if abs(size - largest) <= ROUNDED * size)
        if earlier := next((one for one in near if _same_recording(one, curve)), None):
            copy, original = (f"{each.name} ({each.source})" for each in (curve, earlier))
            counted = f"{copy} is the same recording as {original}: it is counted once"
            used, lost = map(_stated, (earlier, curve))
            differ = f", with what the latter states ({used}), not the former ({lost})" if used != lost else ""
            remarks.append(counted + differ)
        else:
            alike.append((largest, curve))
            unique.append(curve)
    return unique, remarks


def _stated(curve: RadiusCurve) -> str:
    """Return what its file states of medium and stretch."""
    constants = {**curve.medium} | ({"stretch": curve.stretch} if curve.stretch else {})
    return ", ".join(f"{name} {value:.6g}" for name, value in sorted(constants.items())) or "nothing"


def _same_recording(first: RadiusCurve, second: RadiusCurve) -> bool:
    """Whether two curves with as many samples are of one recording, perhaps rounded; without samples, whether they are
    the same part of a file."""
    if not len(first.time):
        return (first.source, first.name, first.unusable) == (second.source, second.name, second.unusable)
    both = np.stack([first.radius, second.radius])
    interval = (first.time[-1] - first.time[0]) / len(first.time)
    apart = np.abs(np.diff(both, axis=0)) > ROUNDED * np.nanmax(both, initial=0.0)
    late = np.abs(first.time - second.time) > ROUNDED_TIME * interval
    return np.array_equal(*np.isnan(both)) and not np.any(apart) and not np.any(late)


def _with_unique_names(curves: list[RadiusCurve]) -> list[RadiusCurve]:
    """Return the curves with unique names: a shared name gets its folder before it, or a number behind it."""
    sharing: dict[str, list[int]] = {}
    for k, curve in enumerate(curves):
        sharing.setdefault(curve.name, []).append(k)
    for name, places in sharing.items():
        if len(places) == 1:
            continue
        with_folders = [f"{Path(curves[k].source).resolve().parent.name}/{name}" for k in places]
        numbered = [f"{name} ({k})" for k in range(1, len(places) + 1)]
        names = with_folders if len({*with_folders}) == len(places) else numbered
        for k, new in zip(places, names, strict=True):
            curves[k] = curves[k].labelled(name=new)
    return curves


def _grouped(curves: list[RadiusCurve], group: str) -> list[RadiusCurve]:
    per_file = Counter(curve.source for curve in curves)
    folders = [Path(curve.source).resolve().parent for curve in curves]
    singles = Counter(folder for curve, folder in zip(curves, folders, strict=True) if per_file[curve.source] == 1)
    grouped = []
    for curve, folder in zip(curves, folders, strict=True):
        stem = _NUMBER.sub("", Path(curve.source).stem)  # "soft" of soft_1.csv and soft_1 (2).csv, "" of 7.csv
        with_others = per_file[curve.source] == 1 and singles[folder] > 1
        groups = {
            "none": (curve.name, curve.source),
            "name": (stem or folder.name, str(folder / stem)),
            "folder": (folder.name, str(folder)),
        }
        by = "folder" if group == "auto" and with_others else group
        grouped.append(curve.with_group(*groups[by]) if by in groups else curve)
    return grouped


def _scaled(curves: list[RadiusCurve], max_radius: float) -> tuple[list[RadiusCurve], list[str]]:
    """Return (the curves scaled to this R_max, a remark on the factor). Raises InputError: the factors differ."""
    scaled, factors = list(curves), dict[str, float]()
    for k, curve in enumerate(curves):
        with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
            scaled[k] = curve.with_max_radius(max_radius)
            factors[curve.name] = float(np.nanmax(scaled[k].radius) / np.nanmax(curve.radius))
    if not factors:
        return scaled, []
    low, high = min(factors, key=factors.__getitem__), max(factors, key=factors.__getitem__)
    option = f"--rmax-um {1e6 * max_radius:g}"
    if factors[high] > (1.0 + SCALE_TOLERANCE) * factors[low]:
        ends = f"{factors[low]:.4g} ({low}) to {factors[high]:.4g} ({high})"
        message = f"{option} would scale the shots by {ends}, but a wrong scale is one factor for all of them"
        mending = "give the R_max of each shot in a column rmax_um of the file, or each shot in a run of its own"
        raise InputError(f"{message}: {mending}", "option.several_scales")
    pixels = any(curve.unscaled for curve in curves)
    return scaled, [option + ("" if pixels else f": radii scaled by {factors[high]:.4g}")]


def check_camera(frame_rate: float | None, um_per_px: float | None) -> None:
    """Raise InputError unless the frame rate (1/s) and the scale are None or possible."""
    if frame_rate is not None:
        FRAME_RATE.check("the frame rate", frame_rate, "table.frame_rate")
    if um_per_px is not None and not (isinstance(um_per_px, Real) and 0 < um_per_px < np.inf):
        raise InputError(f"the scale must be a number of um per pixel above 0, got {um_per_px!r}", "table.scale")
