"""What `measure` writes: measured.csv, a row per frame; measure.json, where every number came from."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.video.measurement import Measurement, StatedNumber
from cavirheo.video.track import FLAGS
from cavirheo.writing import document, terminal
from cavirheo.writing.document import Document, Finite

COLUMNS = {
    "time_us": "from the first frame of the recording on",
    "radius_um": "mean over the exposure; empty where the frame is not used",
    "radius_std_um": "standard deviation of the radius, from frame to frame",
    "systematic_um": "what may move the radii of all frames alike",
    "x_px": "centre, from the middle of the leftmost pixel",
    "y_px": "centre, from the middle of the topmost pixel",
    "asphericity": "amplitude of the outline's second mode over the radius",
    "edge_width_px": "from a quarter to three quarters of the edge",
    "arc": "part of the outline that is seen",
    "flag": "; ".join(f"{flag}: {meaning}" for flag, meaning in FLAGS.items()),
    "frame": "number of the frame, from 1",
}


class Measured(Document):
    """What was found in a recording, and where every number came from.

    Attributes:
        name: of the recording.
        source: the file, as it was given.
        source_sha256: its SHA-256.
        width: of a frame, pixels.
        height: of a frame, pixels.
        bits: of a pixel.
        frame_rate_hz: frames per second.
        um_per_px: micrometres per pixel.
        exposure_s: of a frame, s.
        measured_with: the settings.
        optics_sigma_px: standard deviation of the blur at rest, pixels.
        flags: frames with each flag.
        max_radius_px: largest radius of a frame, pixels.
        max_radius_m: R_max, m; null where there is no scale, or no maximum.
        time_of_max_s: time of R_max, s from the first frame; null as `max_radius_m`.
        collapse_times_s: times of the collapses, s from the first frame.
        unusable: why there is no R_max; else empty.
        warnings: about the recording and its settings.
        columns: of measured.csv, with what each holds.
    """

    kind: Literal["measure"] = "measure"
    name: str
    source: str
    source_sha256: str | None
    width: int
    height: int
    bits: int
    frame_rate_hz: StatedNumber
    um_per_px: StatedNumber
    exposure_s: StatedNumber
    measured_with: dict[str, Any]
    optics_sigma_px: Finite
    flags: dict[str, int]
    max_radius_px: Finite
    max_radius_m: Finite = None
    time_of_max_s: Finite = None
    collapse_times_s: list[float] = []
    unusable: str = ""
    warnings: list[str]
    columns: dict[str, str] = COLUMNS


def describe(measurement: Measurement, curve: RadiusCurve, warnings: list[str], **head: Any) -> Measured:
    """The document of a measurement; `warnings`: of the curve in its medium."""
    try:
        head |= {"max_radius_m": curve.max_radius, "time_of_max_s": curve.time_of_max}
        head["collapse_times_s"] = curve.collapse_times().tolist()
    except InputError as error:
        head["unusable"] = str(error)
    footage, track = measurement.recording, measurement.track
    return Measured(
        **head,
        name=curve.name,
        source=curve.source,
        source_sha256=curve.source_sha256,
        width=footage.frames.shape[2],
        height=footage.frames.shape[1],
        bits=8 * footage.frames.dtype.itemsize,
        frame_rate_hz=measurement.frame_rate,
        um_per_px=measurement.um_per_px,
        exposure_s=measurement.exposure,
        measured_with=measurement.options,
        optics_sigma_px=track.optics,
        flags=measurement.counts,
        max_radius_px=float(np.nanmax(track.radius)),
        warnings=warnings,
    )


def write_csv(path: Path, measurement: Measurement) -> None:
    """A row per frame; radii in pixels (radius_px, ...) where there is no scale."""
    track, scale, (left, top) = measurement.track, measurement.um_per_px.value, measurement.corner
    names = list(COLUMNS) if scale else [name.replace("_um", "_px") for name in COLUMNS]
    lengths = [(scale or 1.0) * values for values in (track.radius, track.sigma, track.systematic)]
    columns = (*lengths, track.x + left, track.y + top, track.asphericity, track.width, track.arc)
    numbers = ([f"{value:.6g}" if np.isfinite(value) else "" for value in values] for values in columns)
    times = [f"{time:.10g}" for time in 1e6 * measurement.time]
    rows = zip(times, *numbers, track.flags, range(measurement.first, measurement.first + len(times)), strict=True)
    document.write_rows(path, names, (dict(zip(names, row, strict=True)) for row in rows))


def print_table(record: Measured) -> None:
    """Frames by flag, the maximum, where rate and scale are from, and the input warnings."""
    console = terminal.console()
    frames = sum(record.flags.values())
    size = f"{record.width} x {record.height} pixels, {record.bits} bits"
    console.print(f"{record.name}: {frames} frames of {size}")
    table = terminal.table("flag", ["frames"], left=["meaning"])
    for flag, count in record.flags.items():
        table.add_row(flag, str(count), FLAGS[flag])
    console.print(table)
    top = f"R_max {record.max_radius_px:.2f} px" if record.max_radius_px else "no R_max"
    if record.max_radius_m:
        top += f", {1e6 * record.max_radius_m:.2f} um; {len(record.collapse_times_s)} collapses"
    console.print(top)
    for what, number in (("frames per second", record.frame_rate_hz), ("um per pixel", record.um_per_px)):
        console.print(f"{what}: {'–' if number.value is None else f'{number.value:.6g}'} ({number.origin})")
    terminal.print_warnings(console, ((record.name, warning) for warning in record.warnings))
    notes = [note for note in (record.unusable, *record.notes) if note]
    terminal.print_remarks(console, terminal.by_message((record.name, note) for note in notes))
