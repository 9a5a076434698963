"""Pictures of shots: shapes and words on a page, written as SVG, and as PNG by matplotlib's rasteriser.

A report holds a picture of every shot. matplotlib's axes take a tenth of a second each, this a hundredth, and the SVG
needs no library. Pictures that are made once per run are matplotlib's (`style`).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.writing.style import INK, need_matplotlib

Pair = tuple[float, float]
Anchor = Literal["start", "middle", "end"]
_AXIS, _TICK = "#888888", 3.0
_RING = 1.2  # points
_MANY = 1500  # dots above which those that fall together are drawn once
_NARROW, _WIDE = " .,:;'|!()[]-–fijlrtIJ", "mwMW@%=±µ…+−"


@dataclass
class Shape:
    """Polylines through `points` (n, 2), NaN interrupts; a filled polygon where the width is 0."""

    points: Floats
    colour: str
    width: float
    opacity: float

    def svg(self) -> str:
        d = "".join(f"M{'L'.join(f'{x:.2f} {y:.2f}' for x, y in run.tolist())}" for run in _runs(self.points))
        look = f'fill="{self.colour}"'
        if self.width:
            look = f'fill="none" stroke="{self.colour}" stroke-width="{self.width:g}"'
        faint = "" if self.opacity == 1.0 else f' opacity="{self.opacity:g}"'
        return f'<path d="{d}" {look}{faint}/>'

    def paint(self, page: _Page) -> None:
        page.path(self.points, None, self.colour, self.width, self.opacity)


@dataclass
class Dots:
    """Discs, or rings, of `size` points across at `points` (n, 2)."""

    points: Floats
    colour: str
    size: float
    ring: bool

    def svg(self) -> str:
        if self.ring:
            discs = (f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{self.size / 2:g}"/>' for x, y in self.points.tolist())
            return f'<g fill="#ffffff" stroke="{self.colour}" stroke-width="{_RING}">{"".join(discs)}</g>'
        where = self.points.round(1)
        if len(where) > _MANY:
            where = np.unique((self.points * 2).round() / 2, axis=0)
        d = "".join(f"M{x:g} {y:g}h0" for x, y in where.tolist())
        return f'<path d="{d}" stroke="{self.colour}" stroke-width="{self.size:g}" stroke-linecap="round"/>'

    def paint(self, page: _Page) -> None:
        page.discs(self.points, self.size, self.colour, self.ring)


@dataclass
class Words:
    """A line of text on its baseline; `turned`: upwards."""

    points: Floats  # (1, 2) where it begins, is centred or ends
    text: str
    size: float
    colour: str
    anchor: Anchor
    bold: bool
    turned: bool

    def svg(self) -> str:
        x, y = self.points[0].tolist()
        look = f'font-size="{self.size:g}" fill="{self.colour}"'
        look += "" if self.anchor == "start" else f' text-anchor="{self.anchor}"'
        look += ' font-weight="bold"' if self.bold else ""
        look += f' transform="rotate(-90 {x:.1f} {y:.1f})"' if self.turned else ""
        return f'<text x="{x:.1f}" y="{y:.1f}" {look}>{escape(self.text)}</text>'

    def paint(self, page: _Page) -> None:
        outline, codes, width = _outline(self.text, self.bold)
        shift = {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor] * width
        letters = (outline - [shift, 0.0]) * [self.size, -self.size]
        letters = letters[:, ::-1] * [1.0, -1.0] if self.turned else letters
        page.path(self.points + letters, codes, self.colour)


class Drawing:
    """A page of `width` x `height` points, y downwards; what is added later lies above.

    `panels` are the axes that were put on it, for whoever wants to know what they show.
    """

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.marks: list[Shape | Dots | Words] = []
        self.panels: list[Panel] = []

    @property
    def text(self) -> list[str]:
        """Everything that is written on it."""
        return [mark.text for mark in self.marks if isinstance(mark, Words)]

    def line(self, points: Any, colour: str, width: float = 1.0, opacity: float = 1.0) -> None:
        self.marks.append(Shape(np.asarray(points, dtype=float), colour, width, opacity))

    def dots(self, points: Any, colour: str, size: float, *, ring: bool = False) -> None:
        points = np.asarray(points, dtype=float)
        self.marks.append(Dots(points[np.isfinite(points).all(axis=1)], colour, size, ring))

    def box(self, x: float, y: float, width: float, height: float, colour: str, opacity: float = 1.0) -> None:
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
        self.marks.append(Shape(np.array(corners), colour, 0.0, opacity))

    def write(
        self, x: float, y: float, text: str, size: float = 8.5, colour: str = INK,
        anchor: Anchor = "start", *, bold: bool = False, turned: bool = False,
    ) -> None:  # fmt: skip
        self.marks.append(Words(np.array([[x, y]]), text, size, colour, anchor, bold, turned))

    def svg(self, top: float = 0.0) -> str:
        """An <svg> element without ids; the page begins at `top`, and what lies above it is left out."""
        shown = [mark for mark in self.marks if np.nanmax(mark.points[:, 1], initial=-np.inf) >= top]
        box = f'viewBox="0 {top:g} {self.width:g} {self.height - top:g}"'
        look = 'font-family="system-ui, \'DejaVu Sans\', sans-serif" stroke-linejoin="round"'
        lines = "\n".join(mark.svg() for mark in shown)
        return f'<svg xmlns="http://www.w3.org/2000/svg" {box} {look} role="img">\n{lines}\n</svg>\n'

    def save_svg(self, path: str | Path) -> None:
        Path(path).write_text(self.svg(), encoding="utf-8")

    def save_png(self, path: str | Path, dpi: int = 150) -> None:
        """Raises InputError without matplotlib."""
        need_matplotlib()
        page = _Page(self.width, self.height, dpi)
        for mark in self.marks:
            mark.paint(page)
        page.save(path)

    def _repr_svg_(self) -> str:
        """What a notebook shows."""
        return self.svg()


class Panel:
    """Axes on a drawing, at `place` (left, top, width, height), over the ranges x and y; drawn by `frame`."""

    def __init__(self, on: Drawing, place: tuple[float, float, float, float], x: Pair, y: Pair) -> None:
        self.on, self.place, self.x, self.y = on, place, x, y
        self.data: dict[str, Floats] = {}  # what was drawn, by label, (n, 2)
        on.panels.append(self)

    def at(self, x: Any, y: Any) -> Floats:
        """(n, 2) places on the page; NaN outside of the range of x."""
        left, top, width, height = self.place
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        down = (self.y[1] - y) / (self.y[1] - self.y[0])
        inside = (across >= -1e-9) & (across <= 1 + 1e-9)
        return np.column_stack([left + np.where(inside, across, np.nan) * width, top + down * height])

    def line(self, x: Any, y: Any, colour: str, width: float = 1.0, opacity: float = 1.0, label: str = "") -> None:
        self._keep(label, x, y)
        self.on.line(self.at(x, y), colour, width, opacity)

    def dots(self, x: Any, y: Any, colour: str, size: float, *, ring: bool = False, label: str = "") -> None:
        self._keep(label, x, y)
        self.on.dots(self.at(x, y), colour, size, ring=ring)

    def band(self, low: float, high: float, colour: str, opacity: float) -> None:
        """From side to side."""
        (_, top), (_, bottom) = self.at(self.x[:1] * 2, [min(high, self.y[1]), max(low, self.y[0])])
        self.on.box(self.place[0], top, self.place[2], bottom - top, colour, opacity)

    def frame(self, x_label: str, y_label: str, *, numbers: bool = True) -> None:
        """The two axes with ticks and labels; without `numbers` the lower one has its ticks alone."""
        left, top, width, height = self.place
        right, bottom = left + width, top + height
        self.on.line([(left, top), (left, bottom), (right, bottom)], _AXIS, 0.8)
        marks, texts = ticks(*self.x, 8 if width > 250 else 5)
        along = [(x, bottom) for x, _ in self.at(marks, self.y[0])]
        for (x, y), text in zip(along, texts, strict=True):
            self.on.line([(x, y), (x, y + _TICK)], _AXIS, 0.8)
            if numbers:
                self.on.write(x, y + 13, text, anchor="middle")
        marks, texts = ticks(*self.y, 6 if height > 100 else 4)
        for (_, y), text in zip(self.at(np.full(len(marks), self.x[0]), marks), texts, strict=True):
            self.on.line([(left - _TICK, y), (left, y)], _AXIS, 0.8)
            self.on.write(left - 6, y + 3, text, anchor="end")
        if x_label:
            self.on.write(left + width / 2, bottom + 26, x_label, 9, anchor="middle")
        longest = max(map(len, texts), default=0)
        self.on.write(left - 12 - 5.4 * longest, top + height / 2, y_label, 9, anchor="middle", turned=True)

    def _keep(self, label: str, x: Any, y: Any) -> None:
        if label:
            self.data[label] = np.column_stack(np.broadcast_arrays(x, y)).astype(float)


def ticks(low: float, high: float, most: int) -> tuple[Floats, list[str]]:
    """Round numbers from low to high with steps of 1, 2 or 5, at most so many steps, and as they are written."""
    power = np.floor(np.log10((high - low) / most))
    step = next(s * 10.0**power for s in (1, 2, 5, 10, 20) if (high - low) / (s * 10.0**power) <= most)
    marks = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    places = max(-int(np.floor(np.log10(step) + 1e-9)), 0)
    return marks, [f"{mark + 0.0:.{places}f}".replace("-", "−") for mark in marks]


def room_for(text: str, size: float) -> float:
    """Points that a line of text takes at most, in a wide typeface."""
    return size * sum(0.42 if c in _NARROW else 1.0 if c in _WIDE else 0.8 if c.isupper() else 0.64 for c in text)


def _runs(points: Floats) -> list[Floats]:
    """The parts without NaN."""
    known = np.isfinite(points).all(axis=1)
    cuts = np.flatnonzero(np.diff(known.astype(int))) + 1
    return [part for part in np.split(points, cuts) if len(part) > 1 and np.isfinite(part[0]).all()]


@lru_cache(maxsize=2048)
def _outline(text: str, bold: bool) -> tuple[Floats, Any, float]:
    """Outlines of the letters at size 1: points (n, 2), matplotlib's codes, width; never read as mathematics."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(weight="bold" if bold else "normal", size=text_to_path.FONT_SCALE)
    points, codes = text_to_path.get_text_path(font, text, ismath=False)
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    scale = text_to_path.FONT_SCALE
    return np.asarray(points, dtype=float).reshape(-1, 2) / scale, codes, width / scale


class _Page:
    """matplotlib's rasteriser, in points with y downwards, on white."""

    def __init__(self, width: float, height: float, dpi: int) -> None:
        from matplotlib.backends.backend_agg import RendererAgg
        from matplotlib.transforms import Affine2D

        scale = dpi / 72.0
        self.size = round(width * scale), round(height * scale)
        self.renderer: Any = RendererAgg(*self.size, dpi)
        self.to_pixels: Any = Affine2D().scale(scale, -scale).translate(0.0, height * scale)
        self.path(np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)]), None, "#ffffff")

    def path(self, points: Floats, codes: Any, colour: str, width: float = 0.0, opacity: float = 1.0) -> None:
        """A line of this width, or filled where it is 0."""
        from matplotlib.colors import to_rgba
        from matplotlib.path import Path as Outline

        inside = None if width else to_rgba(colour, opacity)
        self.renderer.draw_path(self._pen(colour, width, opacity), Outline(points, codes), self.to_pixels, inside)

    def discs(self, points: Floats, size: float, colour: str, ring: bool) -> None:
        from matplotlib.colors import to_rgba
        from matplotlib.path import Path as Outline
        from matplotlib.transforms import Affine2D

        pen, radius = self._pen(colour, _RING if ring else 0.0, 1.0), size / 2 * self.renderer.dpi / 72.0
        circle: Any = Affine2D().scale(radius)
        inside = to_rgba("#ffffff" if ring else colour)
        self.renderer.draw_markers(pen, Outline.unit_circle(), circle, Outline(points), self.to_pixels, inside)

    def _pen(self, colour: str, width: float, opacity: float) -> Any:
        pen = self.renderer.new_gc()
        pen.set_foreground(colour)
        pen.set_alpha(opacity)
        pen.set_linewidth(width)
        pen.set_joinstyle("round")
        return pen

    def save(self, path: str | Path) -> None:
        """As PNG without filters: a third of the time that imaging libraries take, and smaller for flat colours."""
        pixels = np.asarray(self.renderer.buffer_rgba())[:, :, :3]
        rows = np.zeros((len(pixels), 1 + 3 * pixels.shape[1]), dtype=np.uint8)
        rows[:, 1:] = pixels.reshape(len(pixels), -1)
        per_metre = round(self.renderer.dpi / 0.0254)
        parts = {
            b"IHDR": struct.pack(">IIBBBBB", *self.size, 8, 2, 0, 0, 0),
            b"pHYs": struct.pack(">IIB", per_metre, per_metre, 1),
            b"IDAT": zlib.compress(rows.tobytes(), 3),
            b"IEND": b"",
        }
        chunks = (struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts.items())
        Path(path).write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
