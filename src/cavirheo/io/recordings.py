"""Recordings -> RadiusCurves, guarded as other files are."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from cavirheo.curve import RadiusCurve
from cavirheo.errors import as_path
from cavirheo.io.files import guarded, sha256, shown
from cavirheo.video.frames import is_recording
from cavirheo.video.measurement import Measurement, MeasureOptions
from cavirheo.video.measurement import measure as measure_frames

__all__ = ["examine", "history", "is_recording", "measure"]


def measure(path: str | Path, **options: Unpack[MeasureOptions]) -> RadiusCurve:
    """R(t) of the bubble in a recording: .mp4, .avi, .mkv, .mov, .tif, .cine, .mraw + .cihx, or a folder of images.

    Args:
        path: the recording.
        options: `frame_rate` (1/s; needed where no camera says it), `um_per_px` (without it the curve has no scale),
            `exposure` (s), `polarity` ("auto", "dark", "bright"), `roi` (x, y, width, height in px),
            `reference_frame`, `span` (first, last frame), `exclude` (frames to leave out, "12,40-45" or a list);
            frames are counted from 1.

    Returns:
        (n,) times in s, radii and their standard deviations in m. Frames that cannot be measured are NaN;
        `curve.meta["flags"]` says of each frame why.

    Raises:
        InputError: not readable, no frame rate, no bubble.

    Source: docs/method/video.md.
    """
    return examine(path, **options)[1]


def examine(
    path: str | Path, *, sheet: bool = False, **options: Unpack[MeasureOptions]
) -> tuple[Measurement, RadiusCurve]:
    """The measurement and its curve, as `measure`; with `sheet` the curve carries the contact sheet for a report."""
    path = as_path(path)
    with guarded(path, "expected a recording of a bubble", folder=True):
        measurement = measure_frames(path, **options)
        return measurement, history(measurement, path, sheet=sheet)


def history(measurement: Measurement, path: Path, *, sheet: bool = False) -> RadiusCurve:
    """The curve of a measurement, with what the file says of it. Raises InputError."""
    digest = None if path.is_dir() else sha256(path)
    origin = {"name": path.stem, "group": path.stem, "source": shown(path), "source_sha256": digest}
    if sheet:
        from cavirheo.video.picture import sheet_address

        origin["contact_sheet"] = sheet_address(measurement)
    return measurement.curve(**origin)
