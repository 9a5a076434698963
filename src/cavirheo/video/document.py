"""What `measure` writes: measured.csv, a row per frame; measure.json, where every number came from."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.video.measurement import Measurement, Stated
from cavirheo.video.track import FLAGS
from cavirheo.writing import document, terminal
from cavirheo.writing.document import Document, Finite, Record

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


class StatedNumber(Record):
    """A number that somebody must say.

    Attributes:
        value: in SI, but for um per pixel; null where nobody says it.
        origin: who says so.
    """

    value: Finite
    origin: str


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
        doubts: about the recording and its settings.
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
    max_radius_m: Finite
    time_of_max_s: Finite
    collapse_times_s: list[float]
    unusable: str
    doubts: list[str]
    columns: dict[str, str] = COLUMNS


def describe(found: Measurement, curve: RadiusCurve, doubts: list[str], **head: Any) -> Measured:
    """The document of a measurement; `doubts`: those of the curve in its medium."""
    top: tuple[float | None, float | None] = None, None
    collapses, unusable = [], ""
    try:
        top, collapses = (curve.max_radius, curve.time_of_max), curve.collapse_times().tolist()
    except InputError as error:
        unusable = str(error)
    shape = found.recording.frames.shape
    return Measured(
        **head, name=curve.name, source=curve.source, source_sha256=curve.source_sha256,
        width=shape[2], height=shape[1], bits=8 * found.recording.frames.dtype.itemsize,
        frame_rate_hz=_stated(found.frame_rate), um_per_px=_stated(found.um_per_px), exposure_s=_stated(found.exposure),
        measured_with=found.options, optics_sigma_px=found.track.optics, flags=found.counts,
        max_radius_px=float(np.nanmax(found.track.radius)), max_radius_m=top[0], time_of_max_s=top[1],
        collapse_times_s=collapses, unusable=unusable, doubts=doubts,
    )  # fmt: skip


def _stated(number: Stated) -> StatedNumber:
    return StatedNumber(value=number.value, origin=number.origin)


def write_csv(path: Path, found: Measurement) -> None:
    """A row per frame; radii in pixels (radius_px, ...) where there is no scale."""
    track, scale = found.track, found.um_per_px.value
    unit = "um" if scale else "px"
    lengths = {"radius": track.radius, "radius_std": track.sigma, "systematic": track.systematic}
    columns = {f"{name}_{unit}": values * (scale or 1.0) for name, values in lengths.items()}
    columns = {
        "time_us": found.time * 1e6,
        **columns,
        "x_px": track.x + found.corner[0],
        "y_px": track.y + found.corner[1],
    }
    columns |= {"asphericity": track.asphericity, "edge_width_px": track.width, "arc": track.arc}
    rows = (
        {name: f"{values[i]:.6g}" if np.isfinite(values[i]) else "" for name, values in columns.items()}
        | {"time_us": f"{found.time[i] * 1e6:.10g}", "flag": track.flags[i], "frame": found.first + i}
        for i in range(len(found.time))
    )
    document.write_rows(path, [*columns, "flag", "frame"], rows)


def print_table(made: Measured) -> None:
    """Frames by flag, the maximum, where rate and scale are from, and what is doubtful."""
    console = terminal.console()
    frames = sum(made.flags.values())
    console.print(f"{made.name}: {frames} frames of {made.width} x {made.height} pixels, {made.bits} bits")
    table = terminal.table("flag", ["frames"], left=["meaning"])
    for flag, count in made.flags.items():
        table.add_row(flag, str(count), FLAGS[flag])
    console.print(table)
    top = f"R_max {made.max_radius_px:.2f} px" if made.max_radius_px else "no R_max"
    if made.max_radius_m:
        top += f", {1e6 * made.max_radius_m:.2f} um; {len(made.collapse_times_s)} collapses"
    console.print(top)
    for what, number in (("frames per second", made.frame_rate_hz), ("um per pixel", made.um_per_px)):
        console.print(f"{what}: {'–' if number.value is None else f'{number.value:.6g}'} ({number.origin})")
    terminal.print_warnings(console, ((made.name, doubt) for doubt in made.doubts))
    terminal.print_remarks(console, terminal.once((made.name, note) for note in (made.unusable, *made.notes) if note))
