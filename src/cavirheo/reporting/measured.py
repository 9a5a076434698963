"""Measured curves in words; and the document, the table and the files of a measured recording, measure.json and
measured.csv."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.physics.media import WATER
from cavirheo.video.measurement import Measurement, StatedNumber
from cavirheo.video.track import FLAGS, USED
from cavirheo.writing import digits, terminal
from cavirheo.writing.document import Document, Finite, write_rows


class Measured(Document):
    """The results of measuring a recording, with the origin of each stated number."""

    kind: Literal["measure"] = "measure"
    name: str
    """Name of the recording."""
    source: str
    """File of the recording, as it was given."""
    source_sha256: str | None
    """SHA-256 of the file; null for a folder of images."""
    width: int
    """Width of the measured region, pixels."""
    height: int
    """Height of the measured region, pixels."""
    bits: int
    """Number of bits in which the brightness of a pixel is stored."""
    frame_rate_hz: StatedNumber
    """Frame rate, 1/s."""
    um_per_px: StatedNumber
    """Length of a pixel, um."""
    exposure_s: StatedNumber
    """Exposure time of a frame, s."""
    measured_with: dict[str, Any]
    """Settings of the measurement."""
    optics_sigma_px: Finite
    """Standard deviation of the blur of a bubble at rest, pixels."""
    flags: dict[str, int]
    """Number of frames with each flag."""
    max_radius_px: Finite
    """Largest radius of a frame, pixels."""
    max_radius_m: Finite = None
    """R_max, m; null if there is no scale, or no maximum."""
    time_of_max_s: Finite = None
    """Time of R_max after the first frame of the recording, s; null if max_radius_m is."""
    collapse_times_s: list[float] = []
    """Times of the collapses after the first frame of the recording, s."""
    unusable: str = ""
    """Reason why there is no R_max; else empty."""
    warnings: list[str]
    """Input warnings on the recording and its settings."""


def describe(measurement: Measurement, curve: RadiusCurve, **head: Any) -> Measured:
    """The document of a measurement. head: command, date, notes."""
    from cavirheo.inference import input_warnings  # imports the solver

    try:
        head |= {"max_radius_m": curve.max_radius, "time_of_max_s": curve.time_of_max}
        head["collapse_times_s"] = curve.collapse_times().tolist()
    except InputError as error:
        head["unusable"] = error.message
    head |= {name: getattr(curve, name) for name in ("name", "source", "source_sha256")}
    images, track = measurement.recording.frames, measurement.track
    head |= {"width": images.shape[2], "height": images.shape[1], "bits": 8 * images.dtype.itemsize}
    head |= {"frame_rate_hz": measurement.frame_rate, "um_per_px": measurement.um_per_px}
    head |= {"exposure_s": measurement.exposure, "measured_with": measurement.options, "flags": measurement.counts}
    head |= {"optics_sigma_px": track.optics, "max_radius_px": float(np.nanmax(track.radius))}
    return Measured(**head, warnings=[warning.text for warning in input_warnings.curve_warnings(curve, WATER)])


def write_csv(path: Path, measurement: Measurement) -> None:
    """Write one row per frame (docs/how-to/measure.md); lengths are in pixels (radius_px, ...) if there is no scale."""
    track, (left, top), scale = measurement.track, measurement.corner, measurement.um_per_px.value
    unit, factor = ("um", scale) if scale else ("px", 1.0)
    numbers = {
        f"radius_{unit}": factor * track.radius,
        f"radius_std_{unit}": factor * track.sigma,
        f"systematic_{unit}": factor * track.systematic,
        "x_px": track.x + left,
        "y_px": track.y + top,
        "asphericity": track.asphericity,
        "edge_width_px": track.width,
        "arc": track.arc,
    }
    first = measurement.first
    columns: dict[str, Sequence[Any]] = {"time_us": [f"{time:.10g}" for time in 1e6 * measurement.time]}
    for name, values in numbers.items():
        columns[name] = [f"{value:.6g}" if np.isfinite(value) else "" for value in values]
    columns |= {"flag": track.flags.tolist(), "frame": range(first, first + len(measurement.time))}
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    write_rows(path, [*columns], rows)


def print_table(record: Measured) -> None:
    """Print the frames by flag, the maximum, the origin of rate and scale, the input warnings and the notes."""
    used = sum(record.flags.get(flag, 0) for flag in USED)
    frames = f"{used} of {sum(record.flags.values())} frames measured"
    terminal.print_text(f"{record.name}: {frames}, {record.width} x {record.height} pixels, {record.bits} bits")
    rows = [[flag, str(count), FLAGS[flag]] for flag, count in record.flags.items()]
    terminal.print_table(["flag", "frames", "meaning"], rows, left=["meaning"])
    top = f"R_max {record.max_radius_px:.2f} px" if record.max_radius_px else "no R_max"
    if record.max_radius_m:
        top += f", {1e6 * record.max_radius_m:.2f} µm; {digits.counted(len(record.collapse_times_s), 'collapse')}"
    terminal.print_text(top)
    for quantity, number in (("frames per second", record.frame_rate_hz), ("µm per pixel", record.um_per_px)):
        terminal.print_text(f"{quantity}: {'–' if number.value is None else f'{number.value:.6g}'} ({number.origin})")
    terminal.print_remarks({warning: [record.name] for warning in record.warnings}, mark="check input:")
    notes = [note for note in (record.unusable, *record.notes) if note]
    terminal.print_remarks({note: [record.name] for note in notes})


def summary_cells(curve: RadiusCurve) -> tuple[str, ...]:
    """Cells of a curve: R_max (µm), frame rate (kHz), frames with a radius, recorded time (µs), number of collapses."""
    top, collapses = digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    frames = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.number(curve.frame_rate, 1e-3), frames, recorded, collapses


def curve_warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """The warnings on scales and settings, and why a curve has no R_max, each with the names of its curves."""
    from cavirheo.inference import input_warnings  # imports the solver

    warnings = []
    for curve in curves:
        warnings += [(curve.name, warning.text) for warning in input_warnings.curve_warnings(curve, WATER)]
        try:
            _ = curve.max_radius
        except InputError as error:
            warnings.append((curve.name, error.message))
    return terminal.names_by_text(warnings)


def curves_by_note(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """Notes on what was recognised, converted or left out in the files, each once, with the names of its curves."""
    return terminal.names_by_text((curve.name, note) for curve in curves for note in curve.notes)
