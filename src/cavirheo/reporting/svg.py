"""Pictures as SVG text, which a page holds in itself: one template (picture.svg) at every size, and no library.

Coordinates are whole numbers, PX to a pixel. Colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from cavirheo.arrays import Floats
from cavirheo.reporting.panels import Axis, Layer, Panel
from cavirheo.writing import digits
from cavirheo.writing.style import shades

PX = 4  # units of a picture to a pixel
WIDTH, HEIGHT = 480, 300  # px of a picture as the report shows it
POINTS = 800  # of a picture
GROUP_POINTS = 8 * POINTS  # of the shots of a group
Word = tuple[str, int, int, str]  # look, place of its baseline, text
Key = list[tuple[str, str]]  # look, text
_LEFT, _RIGHT, _BELOW = 44 * PX, 6 * PX, 36 * PX  # around the axes
_ROW = 17 * PX  # a line of words
_TICK = 4 * PX
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


@dataclass(frozen=True)
class Frame:
    """Axes in a box of a picture: where points lie, and the paths of layers. box: left, top, width and height."""

    box: tuple[int, int, int, int]
    x: Axis
    y: Axis

    def place(self, x: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        """In whole units of the picture."""
        left, top, width, height = self.box
        across = left + width * (np.asarray(x, dtype=float) - self.x.low) / (self.x.high - self.x.low)
        down = top + height * (self.y.high - np.asarray(y, dtype=float)) / (self.y.high - self.y.low)
        return np.rint(across).astype(int), np.rint(down).astype(int)

    def axes(self, second: Axis | None, *, along: bool) -> tuple[str, list[Word], list[Word]]:
        """The path of the axes, their ticks and names; second: an axis along the top. along: with ticks of `x`."""
        left, top, width, height = self.box
        right, bottom = left + width, top + height
        rows, columns = self.y.ticks(max(height // (36 * PX), 4)), self.x.ticks(max(width // (55 * PX), 2))
        places = self.place(self.x.low, rows)[1]
        path = "".join(f"M{left} {down}h{width}" for down in places) + f"M{left} {top}v{height}h{width}"
        ticks = [("end", left - 5 * PX, down + 4 * PX, f"{n:g}") for down, n in zip(places, rows, strict=True)]
        names = [("name", 2 * PX, top - 6 * PX, self.y.label)]
        if along:
            places = self.place(columns, self.y.low)[0]
            path += "".join(f"M{across} {bottom}v{_TICK}" for across in places)
            ticks += [("middle", x, bottom + 15 * PX, f"{n:g}") for x, n in zip(places, columns, strict=True)]
            names.append(("name end", right, bottom + 31 * PX, self.x.title))
        if second:
            columns = second.ticks(max(width // (45 * PX), 2))
            for across, n in zip(replace(self, x=second).place(columns, self.y.low)[0], columns, strict=True):
                path += f"M{across} {top}v{-_TICK}"
                if left + 30 * PX < across < right - 25 * PX:  # the ends are those of the axes' names
                    ticks.append(("middle", across, top - 6 * PX, f"{n:g}"))
            names.append(("name end", right, top - 6 * PX, second.label))
        return path, ticks, names

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
            some = part[self._thinned(x[part], y[part], max(most * len(part) // len(finite), 2))]
            first, *steps = _steps(*self.place(x[some], y[some]))
            path += f"M{first}l{' '.join(steps)}" if steps else f"M{first}z"
        return path

    def _band(self, x: Floats, y: Floats, _: int) -> str:
        (left, right), (bottom, top) = self.place(x, y)
        return f"M{left} {top}h{right - left}V{bottom}H{left}z"

    def _area(self, x: Floats, y: Floats, most: int) -> str:
        """Between two lines, with no more than about `most` points of each."""
        some = self._thinned(x, y[:, 1], most)
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
        return "".join(f"M{across} {down}v{-7 * PX}" for across, down in zip(*self.place(x, y), strict=True))

    def _thinned(self, x: Floats, y: Floats, most: int) -> np.ndarray:
        """Indices of at most about so many points, equally far from each other along a line, and of its turning points,
        so that a collapse stays sharp."""
        if len(x) <= most:
            return np.arange(len(x))
        steps = np.hypot(np.diff(x / (self.x.high - self.x.low)), np.diff(y / (self.y.high - self.y.low)))
        along = np.concatenate([[0.0], np.cumsum(steps)])
        even = np.searchsorted(along, np.linspace(0.0, along[-1], most))
        turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
        return np.union1d(np.minimum(even, len(x) - 1), turns[: max(most, 0)])


def curve_svg(panels: Sequence[Panel], width: float = WIDTH, height: float = HEIGHT, *, points: int = POINTS) -> Markup:
    """The picture of a curve: measured points, the simulation over them, and below what is left between, with a band of
    ± RMSE. Without an answer it says so.

    width and height: px; type keeps its size. points: about so many are drawn.
    """
    radius, *residual = panels
    simulated = f", {radius.layer('simulated').name} and residual" if residual else ""
    key = _key(radius, without="outside" if width < WIDTH else "")  # there is no room
    key += [("failed", f"{radius.note}\u2003")] if radius.note else []
    return _picture(panels, f"measured radius over time{simulated}", key, points, (width, height))


def group_svg(panels: Sequence[Panel], points: int = GROUP_POINTS) -> Markup:
    """The pictures of a group beside each other: its shots (`overlay_svg`), then their answers."""
    shots, *answers = panels
    labels = [f"{panel.y.label} of each shot over {panel.x.label}" for panel in answers]
    pictures = [_picture([panel], label, _key(panel), points) for panel, label in zip(answers, labels, strict=True)]
    return Markup("").join([overlay_svg(shots, points), *pictures])


def overlay_svg(panel: Panel, points: int = GROUP_POINTS) -> Markup:
    """The picture of shots over each other. points: of all lines; of too many shots for these every k-th is drawn."""
    count = len(panel.layers)
    every = max(-(-count * _FEWEST // points), 1)
    drawn = panel.layers[::every]
    layers = tuple(replace(layer, share=max(points // len(drawn), _FEWEST) / points) for layer in drawn)
    label = f"{panel.y.label} over {panel.x.label} of {digits.counted(count, 'shot')}"
    note = panel.note + (f", 1 of {every} is drawn" if every > 1 else "")
    return _picture([replace(panel, layers=layers)], label, [("", note)], points)


def _picture(
    panels: Sequence[Panel], label: str, key: Key, points: int, size: tuple[float, float] = (WIDTH, HEIGHT)
) -> Markup:
    """A panel, and below it at most one of what is left between. key: the words in the row at the top."""
    from cavirheo.reporting.html import template

    view, top = [round(PX * side) for side in size], 2 * _ROW + 2 * PX
    across, inner = view[0] - _LEFT - _RIGHT, view[1] - _BELOW - top
    below = PX * round(0.26 * (inner - _ROW) / PX) if len(panels) > 1 else 0
    begin = view[1] - _BELOW - below
    between = _ROW + 4 * PX if below else 0
    axes, ticks, words, layers = list[str](), list[Word](), list[Word](), list[tuple[str, str, str]]()
    boxes = (_LEFT, top, across, inner - below - between), (_LEFT, begin, across, below)
    for panel, box in zip(panels, boxes, strict=False):  # there may be no second one
        frame = Frame(box, panel.x, panel.y)
        path, more, names = frame.axes(panel.top, along=panel is panels[-1])
        axes.append(path)
        ticks += more
        words += names
        layers += [path for layer in panel.layers for path in frame.paths(layer, points)]
    for panel in panels[1:]:
        words.append(("residual end", view[0] - _RIGHT, begin - 6 * PX, panel.note))
    content = {"axes": axes, "ticks": ticks, "layers": layers, "words": words, "key": key}
    return Markup(template("picture.svg").render(view=view, label=label, left=_LEFT, row=_ROW - 5 * PX, **content))


def _key(panel: Panel, *, without: str = "") -> Key:
    """What the layers are, in their colours. without: a look that is left out."""
    return [
        (layer.look, f"{_SYMBOLS.get(layer.look, _SYMBOLS.get(layer.shape, ''))} {layer.name}\u2003")
        for layer in panel.layers
        if layer.name and layer.look != without
    ]


def _colours(tones: Floats) -> list[str]:
    """Of few tones, so that the shots of one are one path."""
    rgb = shades(np.rint(_TONES * tones) / _TONES)
    return ["#" + "".join(f"{round(255 * part):02x}" for part in tone) for tone in rgb]


def _steps(across: np.ndarray, down: np.ndarray) -> list[str]:
    """The first place, then from each to the next, in as few letters as SVG allows."""
    x, y = np.diff(across, prepend=0).tolist(), np.diff(down, prepend=0).tolist()
    return [f"{a}{b}" if b < 0 else f"{a} {b}" for a, b in zip(x, y, strict=True)]
