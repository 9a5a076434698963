"""Pictures as SVG text, which a page holds in itself: one template (picture.svg) at every size, and no library.

Coordinates are whole numbers, UNITS to a pixel. Colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.reporting.curve_panels import Axis, Layer, Panel
from cavirheo.writing import digits
from cavirheo.writing.style import shades

if TYPE_CHECKING:
    from markupsafe import Markup

UNITS = 4  # to a pixel
WIDTH, HEIGHT = 480, 300  # px of a picture as the report shows it
POINTS = 800  # of a picture
GROUP_POINTS = 8 * POINTS  # of the shots of a group
Box = tuple[float, float, float, float]  # left, top, width and height, px
_LEFT, _RIGHT, _BELOW = 44, 6, 36  # px around the axes
_ROW = 17  # px: a line of words
_TICK = 4  # px
_FEWEST = 40  # points of a line that is drawn
_TONES = 12  # of the shots of a group
_SYMBOLS = {
    "dots": "●",
    "line": "—",
    "bars": "+",
    "area": "▬",
    "ticks": "|",
    "ring": "○",
    "outlier": "○",
    "contour": "- -",
}


class Picture:
    """One picture in the making: axes, then layers over them, then words."""

    def __init__(self, width: float, height: float, label: str) -> None:
        self.width, self.height, self.label = width, height, label
        self.axes: list[str] = []
        self.ticks: list[tuple[str, float, float, str]] = []
        self.layers: list[tuple[str, str, str]] = []
        self.words: list[tuple[str, int, int, list[tuple[str, str]]]] = []

    def frame(self, box: Box, panel: Panel, points: int, *, along: bool = True) -> None:
        """Axes in a box, with ticks, names and layers. points: of the picture. along: with those of `x`."""
        frame, (left, top, width, height) = Frame(box, panel.x, panel.y), box
        bottom, right = top + height, left + width
        rows, columns = panel.y.ticks(max(int(height / 36), 4)), panel.x.ticks(max(int(width / 55), 2))
        for value in rows:
            down = int(frame.place(panel.x.low, value)[1])
            self.ticks.append(("end", _units(left - 5), down + _units(4), f"{value:g}"))
            self.axes.append(f"M{_units(left)} {down}h{_units(width)}")
        self.write("name", 2, top - 6, panel.y.label)
        self.axes.append(f"M{_units(left)} {_units(top)}v{_units(height)}h{_units(width)}")
        for value in columns if along else ():
            across = int(frame.place(value, panel.y.low)[0])
            self.ticks.append(("middle", across, _units(bottom + 15), f"{value:g}"))
            self.axes.append(f"M{across} {_units(bottom)}v{_units(_TICK)}")
        if along:
            self.write("name end", right, bottom + 31, panel.x.title)
        for layer in panel.layers:
            self.layers += frame.paths(layer, points)
        if panel.top:
            self._along_top(panel.top, box)

    def _along_top(self, axis: Axis, box: Box) -> None:
        """The ticks of a second axis along the top."""
        left, top, width, _ = box
        for tick in axis.ticks(max(int(width / 45), 2)):
            place = left + width * (tick - axis.low) / (axis.high - axis.low)
            self.axes.append(f"M{_units(place)} {_units(top)}v{_units(-_TICK)}")
            if left + 30 < place < left + width - 25:  # the ends are those of the axes' names
                self.ticks.append(("middle", _units(place), _units(top - 6), f"{tick:g}"))
        self.write("name end", left + width, top - 6, axis.label)

    def write(self, look: str, x: float, y: float, text: str) -> None:
        """Words, if there are any, whose baseline is y; look: class of the style."""
        if text:
            self.words.append((look, _units(x), _units(y), [("", digits.printable(text))]))

    def key(self, panel: Panel, note: str = "", *, without: str = "") -> None:
        """What the layers are, in their colours, in the row at the top; then a note in that of a failure. without: a
        look that is left out."""
        parts = [
            (layer.look, f"{_SYMBOLS.get(layer.look, _SYMBOLS.get(layer.shape, ''))} {layer.name}")
            for layer in panel.layers
            if layer.name and layer.look != without
        ]
        parts += [("failed", note)] if note else []
        words = [(look, digits.printable(f"{text}\u2003")) for look, text in parts]
        self.words.append(("name", _units(_LEFT), _units(_ROW - 5), words))

    @property
    def svg(self) -> Markup:
        """The picture as SVG; all words are escaped."""
        from markupsafe import Markup

        from cavirheo.reporting.html import template

        view = _units(self.width), _units(self.height)
        parts = {"axes": "".join(self.axes), "ticks": self.ticks, "layers": self.layers, "words": self.words}
        return Markup(template("picture.svg").render(view=view, label=digits.printable(self.label), **parts))


@dataclass(frozen=True)
class Frame:
    """Axes in a box of a picture: where points lie, and the paths of layers."""

    box: Box
    x: Axis
    y: Axis

    def place(self, x: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        """In whole units of the picture."""
        left, top, width, height = self.box
        across = left + width * (np.asarray(x, dtype=float) - self.x.low) / (self.x.high - self.x.low)
        down = top + height * (self.y.high - np.asarray(y, dtype=float)) / (self.y.high - self.y.low)
        return np.rint(UNITS * across).astype(int), np.rint(UNITS * down).astype(int)

    def paths(self, layer: Layer, points: int) -> list[tuple[str, str, str]]:
        """(look, path, colour) of a layer. points: of the picture, of which it has its share. Those of one tone are one
        path."""
        most = len(layer.x) if layer.share is None else max(int(points * layer.share), 1)
        path: Any = getattr(self, f"_{layer.shape}")
        colours = np.array([""] if layer.tones is None else _colours(layer.tones))
        paths = []
        for colour in dict.fromkeys(colours.tolist()):
            some = colours == colour if len(colours) == len(layer.x) else slice(None)
            if data := path(layer.x[some], layer.y[some], most):
                paths.append((layer.look, data, colour))
        return paths

    def _dots(self, x: Floats, y: Floats, most: int) -> str:
        """A dot for each point, or for every k-th of more than `most`."""
        every = max(-(-len(x) // max(most, 1)), 1)
        across, down = self.place(x[::every], y[::every])
        return "".join(f"m{step}z" for step in _steps(across, down)).replace("m", "M", 1)

    def _line(self, x: Floats, y: Floats, most: int) -> str:
        """A line through the points, with no more than about `most` of them; it breaks where a number is NaN."""
        finite, path = np.flatnonzero(np.isfinite(y)), ""
        for part in np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1) if len(finite) else ():
            across, down = x[part] / (self.x.high - self.x.low), y[part] / (self.y.high - self.y.low)
            some = part[thinned(across, down, max(most * len(part) // len(finite), 2))]
            first, *steps = _steps(*self.place(x[some], y[some]))
            path += f"M{first}l{' '.join(steps)}" if steps else f"M{first}z"
        return path

    def _band(self, x: Floats, y: Floats, _: int) -> str:
        (left, right), (bottom, top) = self.place(x, y)
        return f"M{left} {top}h{right - left}V{bottom}H{left}z"

    def _area(self, x: Floats, y: Floats, most: int) -> str:
        """Between two lines, with no more than about `most` points of each."""
        some = thinned(x / (self.x.high - self.x.low), y[:, 1] / (self.y.high - self.y.low), most)
        ends = np.concatenate([y[some, 0], y[some[::-1], 1]])
        first, *steps = _steps(*self.place(x[np.concatenate([some, some[::-1]])], ends))
        return f"M{first}l{' '.join(steps)}z"

    def _bars(self, x: Floats, y: Floats, _: int) -> str:
        across, down = self.place(x, y)
        return "".join(
            (f"M{a} {m}H{b}" if a < b else "") + (f"M{k} {c}V{d}" if d < c else "")
            for (a, k, b), (c, m, d) in zip(across.tolist(), down.tolist(), strict=True)
        )

    def _ticks(self, x: Floats, y: Floats, _: int) -> str:
        across, down = self.place(x, y)
        return "".join(f"M{a} {b}v{_units(-7)}" for a, b in zip(across, down, strict=True))


def curve_svg(panels: Sequence[Panel], width: float = WIDTH, height: float = HEIGHT, *, points: int = POINTS) -> Markup:
    """The picture of a curve: measured points, the simulation over them, and below what is left between, with a band of
    ± RMSE. Without an answer it says so.

    width and height: px; type keeps its size. points: about so many are drawn.
    """
    radius, *residual = panels
    simulated = f", {radius.layer('simulated').name} and residual" if residual else ""
    picture = _picture(panels, f"measured radius over time{simulated}", points, width, height)
    picture.key(radius, radius.note, without="outside" if width < WIDTH else "")  # there is no room
    return picture.svg


def _picture(panels: Sequence[Panel], label: str, points: int, width: float = WIDTH, height: float = HEIGHT) -> Picture:
    """A panel, and below it at most one of what is left between."""
    (upper, *lower), picture, top = panels, Picture(width, height, label), 2 * _ROW + 2
    across, inner = width - _LEFT - _RIGHT, height - _BELOW - top
    below = round(0.26 * (inner - _ROW)) if lower else 0
    picture.frame((_LEFT, top, across, inner - below - (_ROW + 4) * len(lower)), upper, points, along=not lower)
    for panel in lower:
        picture.frame((_LEFT, height - _BELOW - below, across, below), panel, points)
        picture.write("residual end", width - _RIGHT, height - _BELOW - below - 6, panel.note)
    return picture


def group_svg(panels: Sequence[Panel], points: int = GROUP_POINTS) -> Markup:
    """The pictures of a group beside each other: its shots (`overlay_svg`), then their answers."""
    from markupsafe import Markup

    shots, *answers = panels
    pictures = [overlay_svg(shots, points)]
    for panel in answers:
        picture = _picture([panel], f"{panel.y.label} of each shot over {panel.x.label}", points)
        picture.key(panel)
        pictures.append(picture.svg)
    return Markup("").join(pictures)


def overlay_svg(panel: Panel, points: int = GROUP_POINTS) -> Markup:
    """The picture of shots over each other. points: of all lines; of too many shots for these every k-th is drawn."""
    count = len(panel.layers)
    every = max(-(-count * _FEWEST // points), 1)
    drawn = panel.layers[::every]
    layers = tuple(replace(layer, share=max(points // len(drawn), _FEWEST) / points) for layer in drawn)
    label = f"{panel.y.label} over {panel.x.label} of {digits.counted(count, 'shot')}"
    picture = _picture([replace(panel, layers=layers)], label, points)
    picture.write("name", _LEFT, _ROW - 5, panel.note + (f", 1 of {every} is drawn" if every > 1 else ""))
    return picture.svg


def thinned(x: Floats, y: Floats, most: int) -> np.ndarray:
    """Indices of at most about so many points, equally far from each other along a line, and of its turning points, so
    that a collapse stays sharp. x and y: in units of the picture."""
    if len(x) <= most:
        return np.arange(len(x))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even = np.searchsorted(along, np.linspace(0.0, along[-1], most))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
    return np.union1d(np.minimum(even, len(x) - 1), turns[: max(most, 0)])


def _colours(tones: Floats) -> list[str]:
    """Of few tones, so that the shots of one are one path."""
    rgb = shades(np.rint(_TONES * tones) / _TONES)
    return ["#" + "".join(f"{round(255 * part):02x}" for part in tone) for tone in rgb]


def _steps(across: np.ndarray, down: np.ndarray) -> list[str]:
    """The first place, then from each to the next, in as few letters as SVG allows."""
    x, y = np.diff(across, prepend=0).tolist(), np.diff(down, prepend=0).tolist()
    return [f"{a}{b}" if b < 0 else f"{a} {b}" for a, b in zip(x, y, strict=True)]


def _units(pixels: float) -> int:
    return round(UNITS * pixels)
