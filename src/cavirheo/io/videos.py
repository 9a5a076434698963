"""Measure recordings as RadiusCurves, guarded like other files; and parse what a user types about the camera."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import Unpack

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, as_path, parse_number, require, sha256
from cavirheo.io.curves import Camera
from cavirheo.io.files import file_label, guarded
from cavirheo.video.frames import CAMERA_ENDINGS, STACK_ENDINGS
from cavirheo.video.measurement import Measurement, MeasureOptions
from cavirheo.video.measurement import measure as measure_frames


def measure(path: str | Path, **options: Unpack[MeasureOptions]) -> RadiusCurve:
    """Measure R(t) in a recording: .mp4, .avi, .mkv, .mov, .tif, .cine, .mraw + .cihx or .cih, or a folder of images.

    Args:
        path: the recording.
        options: `frame_rate` (1/s; needed unless the camera's file states it), `um_per_px` (without it, unless the file
            states it, the curve has no scale), `exposure` (s), `polarity` ("auto", "dark", "bright"), `roi` (x, y,
            width, height in px), `reference_frame`, `span` (first, last frame), `exclude` (frames to leave out,
            "12,40-45" or a list); frames are counted from 1.

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
    path, known = as_path(path), MeasureOptions.__annotations__
    unknown, names = ", ".join(sorted(options.keys() - known.keys())), ", ".join(known)
    require(not unknown, f"measure has no option {unknown}; it has {names}", "video.option")
    with guarded(path, "expected a recording of a bubble", folder=True):
        measurement = measure_frames(path, **options)
        return measurement, history(measurement, path, sheet=sheet)


def history(measurement: Measurement, path: Path, *, sheet: bool = False) -> RadiusCurve:
    """Return the curve of a measurement, with its name and the file it comes from. Raises InputError."""
    digest = None if path.is_dir() else sha256(path)
    origin = {"name": path.stem, "group": path.stem, "source": file_label(path), "source_sha256": digest}
    if sheet:
        from cavirheo.video.picture import contact_sheet, data_url

        origin["contact_sheet"] = data_url(contact_sheet(measurement))
    return measurement.curve(**origin)


_THOUSANDS = {"frame_rate": ".,"}  # marks that may separate thousands, by field


def parse_camera(texts: Sequence[str], ending: str, *, unscaled: bool = False) -> tuple[Camera, list[str]]:
    """Return (the camera in these texts; for each field, why a recording with this ending cannot be measured with it,
    or ""). unscaled: the file is known to state no scale."""
    rate = "missing: type the rate of the camera; the file states only how fast it is played"
    scale = "missing: type how many micrometres a pixel shows"
    errors = [
        "" if ending in (*CAMERA_ENDINGS, *STACK_ENDINGS) else rate,
        scale if unscaled or ending not in STACK_ENDINGS else "",
        "",
    ]
    values: list[float | None] = [None, None, None]
    for k, (text, field) in enumerate(zip(texts, Camera._fields, strict=True)):
        try:
            if (value := parse_number(text, field.replace("_", " "), _THOUSANDS.get(field, ","))) is not None:
                values[k], errors[k] = value, "" if 0 < value < inf else "must be a positive number"
        except InputError as error:
            errors[k] = str(error)
    return Camera(*values), errors
