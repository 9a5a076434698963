"""Draw the frames with their circles, coloured by flag: a contact sheet of all frames."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Iterator
from math import floor

import numpy as np
from PIL import Image, ImageDraw

from cavirheo.video.measurement import Measurement

COLOURS = {  # palette of Okabe and Ito; all other flags are grey
    "ok": "#56b4e9",
    "small": "#009e73",
    "arc": "#f0e442",
    "reversal": "#d55e00",
    "spike": "#cc79a7",
    **dict.fromkeys(("poor", "faint", "elsewhere", "lost"), "#e69f00"),
}
GREY = "#999999"
_SHEET_WIDTH = 1600  # px, width of the contact sheet
_CELL_SIZE = (190, 150)  # px, largest width and height of a frame in the sheet
_MOST_FRAMES = 400  # most frames in the sheet


def contact_sheet(measurement: Measurement) -> Image.Image:
    """Draw all frames in one picture, or evenly spaced ones if there are very many."""
    n = len(measurement.time)
    chosen = np.unique(np.linspace(0, n - 1, min(n, _MOST_FRAMES)).astype(int))
    height, width = measurement.recording.frames.shape[1:]
    scale = min(_CELL_SIZE[0] / width, _CELL_SIZE[1] / height)
    columns, cell = _SHEET_WIDTH // _CELL_SIZE[0], (int(width * scale), int(height * scale) + 13)
    rows = -(-len(chosen) // columns)
    sheet = Image.new("RGB", (columns * (cell[0] + 4) + 4, rows * (cell[1] + 4) + 4), "white")
    for k, picture in enumerate(_pictures(measurement, scale, chosen)):
        sheet.paste(picture, (4 + k % columns * (cell[0] + 4), 4 + k // columns * (cell[1] + 4)))
    return sheet


def data_url(picture: Image.Image) -> str:
    """Return a picture as a data URL (JPEG) that a web page can show."""
    file = io.BytesIO()
    picture.save(file, "jpeg", quality=60)
    return f"data:image/jpeg;base64,{b64encode(file.getvalue()).decode()}"


def _pictures(measurement: Measurement, scale: float, chosen: np.ndarray) -> Iterator[Image.Image]:
    levels = _levels(measurement)
    for i in chosen:
        picture = _frame(measurement, int(i), scale, levels)
        flag, radius = str(measurement.track.flags[i]), measurement.track.radius[i]
        words = f"{measurement.first + i} {flag}" + (f" {radius:.1f}" if np.isfinite(radius) else "")
        labelled = Image.new("RGB", (picture.width, picture.height + 13), "#222222")
        labelled.paste(picture, (0, 13))
        ImageDraw.Draw(labelled).text((2, 0), words, fill=COLOURS.get(flag, GREY))
        yield labelled


def _levels(measurement: Measurement) -> tuple[float, float]:
    """Return the pixel values that are shown as black and nearly white."""
    images = measurement.recording.frames
    usual = np.flatnonzero(np.isin(measurement.track.flags, ("flash", "dark"), invert=True))
    some = images[usual[:: max(len(images) // 40, 1)], ::3, ::3] if len(usual) else images
    low, high = np.percentile(some, (0.5, 99.5))
    return float(low), max(float(high), float(low) + 1.0)


def _frame(measurement: Measurement, i: int, scale: float, levels: tuple[float, float]) -> Image.Image:
    """Draw frame i with its circle, or with a border if there is no radius, in the colour of its flag."""
    image, (low, high) = measurement.recording.frames[i].astype(np.float32), levels
    grey = Image.fromarray(np.clip((image - low) * (235.0 / (high - low)), 0, 255).astype(np.uint8))
    size = int(grey.width * scale), int(grey.height * scale)
    picture, track = grey.resize(size, Image.Resampling.BILINEAR).convert("RGB"), measurement.track
    draw, colour = ImageDraw.Draw(picture), COLOURS.get(str(track.flags[i]), GREY)
    x, y, r = scale * float(track.x[i] + 0.5), scale * float(track.y[i] + 0.5), scale * float(track.radius[i])
    if np.isfinite(r):
        box = [floor(end) for end in (x - r, y - r, x + r, y + r)]
        draw.ellipse(box, outline=colour, width=max(round(scale), 1))
    else:
        draw.rectangle((0, 0, size[0] - 1, size[1] - 1), outline=colour)
    return picture
