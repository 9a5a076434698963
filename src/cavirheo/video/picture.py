"""Every frame with its circle, coloured by its flag: a sheet of all frames, and a film."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from cavirheo.video.film import write_movie
from cavirheo.video.measurement import Measurement
from cavirheo.video.track import USED

COLOURS = {  # Okabe and Ito's; what is not named is grey
    "ok": "#56b4e9", "small": "#009e73", "arc": "#f0e442", "reversal": "#d55e00", "spike": "#cc79a7",
    "poor": "#e69f00", "faint": "#e69f00", "elsewhere": "#e69f00", "lost": "#e69f00",
}  # fmt: skip
_GREY = "#999999"
_SHEET = 1600  # px across
_CELL = (190, 150)  # px of a frame in it, at most
_MOST = 400  # frames in it
_FILM = 640  # px across, at least


def contact_sheet(found: Measurement) -> Image.Image:
    """All frames, or evenly chosen ones of very many."""
    n = len(found.time)
    chosen = np.unique(np.linspace(0, n - 1, min(n, _MOST)).astype(int))
    height, width = found.recording.frames.shape[1:]
    scale = min(_CELL[0] / width, _CELL[1] / height)
    across, cell = _SHEET // _CELL[0], (int(width * scale), int(height * scale) + 13)
    rows = -(-len(chosen) // across)
    sheet = Image.new("RGB", (across * (cell[0] + 4) + 4, rows * (cell[1] + 4) + 4), "white")
    for k, picture in enumerate(_pictures(found, scale, chosen)):
        sheet.paste(picture, (4 + k % across * (cell[0] + 4), 4 + k // across * (cell[1] + 4)))
    return sheet


def save_sheet(path: Path, sheet: Image.Image) -> None:
    """In greys and the colours of the flags alone."""
    flags = [int(colour[k : k + 2], 16) for colour in {*COLOURS.values(), _GREY} for k in (1, 3, 5)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([level for grey in range(0, 256, 2) for level in (grey, grey, grey)] + flags)
    sheet.quantize(palette=palette, dither=Image.Dither.NONE).save(path, "png", optimize=True)


def sheet_address(found: Measurement) -> str:
    """The sheet itself, as an address that a page can show."""
    file = io.BytesIO()
    contact_sheet(found).save(file, "jpeg", quality=60)
    return f"data:image/jpeg;base64,{b64encode(file.getvalue()).decode()}"


def write_overlay(path: Path, found: Measurement) -> None:
    """The recording as a film (H.264), every frame with its circle."""
    scale = max(1.0, _FILM / found.recording.frames.shape[2])
    film = (np.asarray(picture) for picture in _pictures(found, scale, np.arange(len(found.time))))
    write_movie(path, film, "rgb24", "libx264", "yuv420p", {"crf": "20"})


def _pictures(found: Measurement, scale: float, chosen: np.ndarray) -> Iterator[Image.Image]:
    track, images = found.track, found.recording.frames
    normal = images[np.isin(track.flags, ("flash", "dark"), invert=True)][:: max(len(images) // 40, 1), ::3, ::3]
    low, high = np.percentile(normal if normal.size else images, (0.5, 99.5))
    for i in chosen:
        grey = np.clip((images[i].astype(np.float32) - low) * (235.0 / max(high - low, 1.0)), 0, 255).astype(np.uint8)
        size = int(grey.shape[1] * scale), int(grey.shape[0] * scale)
        frame = Image.new("RGB", (size[0], size[1] + 13), "#222222")
        frame.paste(Image.fromarray(grey).resize(size, Image.Resampling.BILINEAR), (0, 13))
        flag, colour = str(track.flags[i]), COLOURS.get(str(track.flags[i]), _GREY)
        draw = ImageDraw.Draw(frame)
        radius = track.radius[i] if flag in USED else np.nan
        words = f"{found.first + i} {flag}" + (f" {radius:.1f}" if np.isfinite(radius) else "")
        draw.text((2, 0), words, fill=colour)
        if np.isfinite(radius):
            x, y = scale * (track.x[i] + 0.5), 13 + scale * (track.y[i] + 0.5)
            r = scale * radius
            draw.ellipse((x - r, y - r, x + r, y + r), outline=colour, width=max(round(scale), 1))
            draw.rectangle((0, 0, size[0], 12), fill="#222222")
            draw.text((2, 0), words, fill=colour)
        elif flag not in USED:
            draw.rectangle((0, 13, size[0] - 1, size[1] + 12), outline=colour)
        yield frame
