"""Drawing of panels as SVG text within a page, by one template (picture.svg) for all sizes. Coordinates are whole
numbers, PX to a pixel, and the colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from cavirheo.arrays import Floats
from cavirheo.reporting.panels import Layer, Panel

PX = 4  # SVG units per pixel
SIZE = (480.0, 300.0)  # px of a picture as the report shows it
SHOT_SIZE = (380.0, 218.0)  # px of the picture of a shot among others
GROUP_SIZE = (400.0, 340.0)  # px of each of the two pictures of a group
_MOST_DOTS = 320  # most dots of a layer
_CELL = 4 * PX  # of a line that is drawn by one point
_LEFT, _RIGHT, _BOTTOM = 44 * PX, 6 * PX, 36 * PX  # margins around the axes
_ROW = 17 * PX  # height of a line of text
_TONES = np.array([[0, 45, 110], [90, 100, 120], [215, 175, 40]])  # dark blue, grey, yellow: grey prints keep the order
_SYMBOLS = {"dots": "●", "line": "—", "area": "▬"}  # symbols in the key, by shape
_SYMBOLS |= {"region": "▰", "region-out": "▱", "material": "▣", "published": "▢", "arrow": "→"}  # by look
_LETTER, _LINE = 7 * PX, 14 * PX  # width of a letter and height of a line of the names of shots
_AROUND = ((0, 0), (1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (-1, -1), (1, 1), (-1, 1))  # places of a name at a point


@dataclass(frozen=True)
class Frame:
    """A panel in a box of an SVG picture."""

    panel: Panel
    left: int
    top: int
    width: int
    height: int

    def across(self, x: Any) -> Floats:
        """Places on the axis `x` in units of the picture."""
        axis = self.panel.x
        return self.left + self.width * (np.asarray(x, dtype=float) - axis.low) / (axis.high - axis.low)

    def down(self, y: Any) -> Floats:
        """Places on the axis `y` in units of the picture."""
        axis = self.panel.y
        return self.top + self.height * (axis.high - np.asarray(y, dtype=float)) / (axis.high - axis.low)

    @property
    def ticks(self) -> tuple[list[tuple[int, str]], list[tuple[int, str]]]:
        """(place, number) of each tick of `x` and of `y`."""
        columns = self.panel.x.ticks(max(self.width // (55 * PX), 2))
        rows = self.panel.y.ticks(max(self.height // (36 * PX), 4))
        across = [(round(float(self.across(place))), number) for place, number in columns]
        return across, [(round(float(self.down(place))), number) for place, number in rows]

    @property
    def paths(self) -> Iterator[tuple[str, str, str]]:
        """(look, path, colour) of each layer."""
        for layer in self.panel.drawn:
            if layer.shape != "label":
                yield layer.look, self._path(layer), "" if layer.tone is None else _colour_of(layer.tone)

    def _path(self, layer: Layer) -> str:
        """Path with a dot for each point, or for every k-th of many; or of a line, with its turns and a point for each
        _CELL that it crosses."""
        across, down = self.across(layer.x), self.down(layer.y)
        if layer.shape == "dots":
            every = max(-(-len(across) // _MOST_DOTS), 1)
            return f"M{'zm'.join(_steps(across[::every], down[::every]))}z"
        moves = np.diff(np.rint(np.stack([across, down]) / _CELL), prepend=np.nan)
        turns = np.pad(np.diff(np.sign(np.diff(down))) != 0.0, 1, constant_values=True)
        kept = np.any(moves != 0.0, axis=0) | turns
        first, *steps = _steps(across[kept], down[kept])
        return f"M{first}l{' '.join(steps)}{'z' if layer.shape == 'area' else ''}"

    @property
    def names(self) -> Iterator[tuple[str, int, int, str]]:
        """(look, x, y, text) of the names at points, each where it covers no other; one without such a place is left
        out."""
        middle, centre = self.left + self.width / 2, self.top + self.height / 2
        taken = list[tuple[float, float, float]]()  # middle and half a width of each name
        for layer in self.panel.layers:
            if layer.shape != "label":
                continue
            across, down = float(self.across(layer.x[0])), float(self.down(layer.y[0]))
            half = 0.5 * _LETTER * len(layer.text)
            for aside, below in _AROUND[1:] if "beside" in layer.look else _AROUND:
                x, y = across + aside * (half + 2 * PX), down + below * _LINE
                within = abs(x - middle) < self.width / 2 - half and abs(y - centre) < (self.height - _LINE) / 2
                if within and all(abs(x - a) >= half + wide or abs(y - b) >= _LINE for a, b, wide in taken):
                    taken.append((x, y, half))
                    yield f"{layer.look} middle", round(x), round(y + 4 * PX), layer.text
                    break


def picture(panels: Sequence[Panel], size: tuple[float, float] = SIZE, *, with_key: bool = True) -> Markup:
    """SVG of one panel, or of a panel with that of the residual below it. size: px; the size of the type does not
    change. with_key: whether the looks of the first panel are named above it."""
    from cavirheo.reporting.html import template

    width, height = (round(PX * side) for side in size)
    named = [layer for layer in panels[0].drawn if layer.name and with_key]
    if size[0] <= SIZE[0]:  # there is no room
        named = [layer for layer in named if layer.look != "outside"]
    top = (2 if named or panels[0].note else 1) * _ROW + 2 * PX
    across, inner = width - _LEFT - _RIGHT, height - _BOTTOM - top
    below = PX * round(0.26 * (inner - _ROW) / PX) if len(panels) > 1 else 0
    between = _ROW + 8 * PX if below else 0
    frames = [Frame(panels[0], _LEFT, top, across, inner - below - between)]
    frames += [Frame(panel, _LEFT, height - _BOTTOM - below, across, below) for panel in panels[1:]]
    key = [(layer.look, _SYMBOLS.get(layer.look.split()[0], _SYMBOLS[layer.shape]), layer.name) for layer in named]
    return Markup(template("picture.svg").render(frames=frames, key=key, width=width, height=height, px=PX))


def _colour_of(tone: float) -> str:
    """The colour of a tone from 0 (dark) to 1 (light)."""
    red, green, blue = (round(float(np.interp(tone, [0.0, 0.5, 1.0], stops))) for stops in _TONES.T)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _steps(across: Floats, down: Floats) -> list[str]:
    """Whole coordinates of the first point, then steps from point to point, in as few letters as SVG allows."""
    x, y = (np.diff(np.rint(places).astype(int), prepend=0).tolist() for places in (across, down))
    return [f"{a}{b}" if b < 0 else f"{a} {b}" for a, b in zip(x, y, strict=True)]
