"""Videos -> RadiusCurves, guarded as other files are; and what a person types of their camera."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import NamedTuple, Unpack

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, as_path, number_of, sha256
from cavirheo.io.files import file_label, guarded
from cavirheo.video.frames import CAMERAS, STACKS
from cavirheo.video.measurement import Measurement, MeasureOptions
from cavirheo.video.measurement import measure as measure_frames


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
    origin = {"name": path.stem, "group": path.stem, "source": file_label(path), "source_sha256": digest}
    if sheet:
        from cavirheo.video.picture import address, contact_sheet

        origin["contact_sheet"] = address(contact_sheet(measurement))
    return measurement.curve(**origin)


class Camera(NamedTuple):
    """Frames per s, um per pixel, exposure in us; None: not given."""

    frame_rate: float | None = None
    um_per_px: float | None = None
    exposure_us: float | None = None

    @property
    def options(self) -> str:
        """Of `cavirheo infer`, that mean the same."""
        values = zip(("fps", "um-per-px", "exposure-us"), self, strict=True)
        return "".join(f" --{name} {value:.10g}" for name, value in values if value is not None)


def parse_camera(texts: Sequence[str], ending: str, *, unscaled: bool = False) -> tuple[Camera, list[str]]:
    """The camera that these texts say; why a recording with this ending cannot be measured so, field by field, empty
    where it can. unscaled: its file is known to state no scale."""
    played = "missing: type the rate of the camera; the file states only how fast it is played"
    scale = "missing: type how many micrometres a pixel shows"
    wrong = ["" if ending in CAMERAS else played, scale if unscaled or ending not in STACKS else "", ""]
    values: list[float | None] = [None, None, None]
    for k, (text, field) in enumerate(zip(texts, Camera._fields, strict=True)):
        try:
            if (value := number_of(text, field.replace("_", " "))) is not None:
                values[k], wrong[k] = value, "" if 0 < value < inf else "must be a positive number"
        except InputError as error:
            wrong[k] = str(error)
    return Camera(*values), wrong
