"""Measure recordings as RadiusCurves, guarded like other files. The formats of cameras are in video/formats.py."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Unpack

from cavirheo.curve import RadiusCurve
from cavirheo.errors import as_path, printable, require
from cavirheo.io.files import guarded
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
    path = as_path(path)
    names = MeasureOptions.__annotations__.keys()
    unknown = ", ".join(sorted(options.keys() - names))
    require(not unknown, f"measure has no option {unknown}; it has {', '.join(names)}", "video.option")
    with guarded(path, "expected a recording of a bubble", folder=True) as source:
        measurement = measure_frames(path, **options)
        origin: dict[str, Any] = {"name": path.stem, "group": path.stem, "source": printable(str(path))}
        origin["source_sha256"] = None if path.is_dir() else source.sha256
        if sheet:
            from cavirheo.video.picture import contact_sheet, data_url

            origin["contact_sheet"] = data_url(contact_sheet(measurement))
        return measurement, measurement.curve(**origin)
