"""Drawing of panels as SVG text within a page, by one template (picture.svg) for all sizes. Coordinates are whole
numbers, PX to a pixel, and the colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from markupsafe import Markup

from cavirheo.arrays import Floats
from cavirheo.reporting.panels import Layer, Panel

PX = 4  # SVG units per pixel
SIZE = (480.0, 300.0)  # px of a picture as the report shows it
SHOT_SIZE = (380.0, 218.0)  # px of the picture of a shot among others
GROUP_SIZE = (400.0, 340.0)  # px of each of the two pictures of a group
Word = tuple[str, int, int, str]  # look, x and y of the baseline, text
Key = list[tuple[str, str]]  # look, text
_LEFT, _RIGHT, _BOTTOM = 44 * PX, 6 * PX, 36 * PX  # margins around the axes
_ROW = 17 * PX  # height of a line of text
_TONES = np.array([[0, 45, 110], [90, 100, 120], [215, 175, 40]])  # dark blue, grey, yellow: grey prints keep the order
_SYMBOLS = {"dots": "●", "line": "—", "area": "▬", "ticks": "|"}  # symbols in the key, by shape
_SYMBOLS |= {"outlier": "○", "region": "▰", "region-out": "▱", "material": "▣", "published": "▢"}  # or by look
_LETTER, _LINE = 7 * PX, 14 * PX  # width of a letter and height of a line of the names of shots
_AROUND = ((0, 0), (1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (-1, -1), (1, 1), (-1, 1))  # places of a name at a point


def colour_of(tone: float) -> str:
    """The colour of a tone from 0 (dark) to 1 (light)."""
    red, green, blue = (round(float(np.interp(tone, [0.0, 0.5, 1.0], stops))) for stops in _TONES.T)
    return f"#{red:02x}{green:02x}{blue:02x}"


@dataclass(frozen=True)
class Frame:
    """A panel in a box of an SVG picture. box: left, top, width and height."""

    panel: Panel
    box: tuple[int, int, int, int]

    def place(self, x: Any, y: Any) -> tuple[np.ndarray, np.ndarray]:
        """Points in whole units of the picture."""
        (left, top, width, height), along, up = self.box, self.panel.x, self.panel.y
        across = left + width * (np.asarray(x, dtype=float) - along.low) / (along.high - along.low)
        down = top + height * (up.high - np.asarray(y, dtype=float)) / (up.high - up.low)
        return np.rint(across).astype(int), np.rint(down).astype(int)

    def axes(self, *, along: bool) -> tuple[str, list[Word], list[Word]]:
        """(path of the axes, numbers at their ticks, their names). along: with ticks and name of `x`."""
        (left, top, width, height), panel = self.box, self.panel
        right, bottom = left + width, top + height
        path, ticks = f"M{left} {top}v{height}h{width}", list[Word]()
        names = [("name", 2 * PX, top - 8 * PX, panel.y.label)]
        for place, number in panel.y.ticks(max(height // (36 * PX), 4)):
            down = int(self.place(panel.x.low, place)[1])
            path += f"M{left} {down}h{width}"
            ticks.append(("end", left - 5 * PX, down + 4 * PX, number))
        for place, number in panel.x.ticks(max(width // (55 * PX), 2)) if along else ():
            across = int(self.place(place, panel.y.low)[0])
            path += f"M{across} {bottom}v{4 * PX}"
            ticks.append(("middle", across, bottom + 15 * PX, number))
        if along:
            title = ", ".join(filter(None, (panel.x.label, panel.x.remark)))
            names.append(("name end", right, bottom + 31 * PX, title))
        return path, ticks, names

    def paths(self) -> Iterator[tuple[str, str, str]]:
        """Yield (look, path, colour) of each layer."""
        for layer in self.panel.layers:
            if layer.shape != "labels" and (path := getattr(self, f"_{layer.shape}")(layer)):
                yield layer.look, path, "" if layer.tone is None else colour_of(layer.tone)

    def _dots(self, layer: Layer) -> str:
        """Path with a dot for each point, or for every k-th if there are too many."""
        every = max(-(-len(layer.x) // layer.most), 1)
        across, down = self.place(layer.x[::every], layer.y[::every])
        return "M" + "m".join(f"{step}z" for step in _steps(across, down)) if len(across) else ""

    def _line(self, layer: Layer) -> str:
        """Path of a line; NaN makes a gap."""
        finite = np.flatnonzero(np.isfinite(layer.y))
        parts = np.split(finite, np.flatnonzero(np.diff(finite) > 1) + 1)
        thinned = (part[self._thin(layer.x[part], layer.y[part], layer.most)] for part in parts if len(part))
        return "".join(_path(*self.place(layer.x[some], layer.y[some])) for some in thinned)

    def _area(self, layer: Layer) -> str:
        """Path of the area between two lines."""
        some = self._thin(layer.x, layer.y[:, 1], layer.most // 2)
        ends = np.concatenate([layer.y[some, 0], layer.y[some[::-1], 1]])
        return _path(*self.place(layer.x[np.concatenate([some, some[::-1]])], ends)) + "z"

    def _region(self, layer: Layer) -> str:
        return _path(*self.place(layer.x, layer.y)) + "z"

    def _ticks(self, layer: Layer) -> str:
        places = zip(*self.place(layer.x, layer.y), strict=True)
        return "".join(f"M{across} {down}v{-7 * PX}" for across, down in places)

    def _arrows(self, layer: Layer) -> str:
        """Path of arrows, of which each has two strokes as a head."""
        path = ""
        for (a, b), (c, d) in zip(*(values.tolist() for values in self.place(layer.x, layer.y)), strict=True):
            length = max(np.hypot(b - a, d - c), 1.0)
            along, down = (round(6 * PX * (begin - end) / length) for begin, end in ((a, b), (c, d)))
            aside, below = along // 2, down // 2
            path += f"M{a} {c}L{b} {d}M{b + along - below} {d + down + aside}"
            path += f"L{b} {d}L{b + along + below} {d + down - aside}"
        return path

    def names(self) -> list[Word]:
        """The names at points, each where it covers no other; one without such a place is left out."""
        words, taken = list[Word](), list[tuple[float, float, float, float]]()
        left, top, width, height = self.box
        for layer in (layer for layer in self.panel.layers if layer.shape == "labels"):
            for across, down, text in zip(*self.place(layer.x, layer.y), layer.texts, strict=True):
                half = 0.5 * _LETTER * len(text)
                for aside, below in _AROUND[1:] if "beside" in layer.look else _AROUND:
                    x, y = across + aside * (half + 2 * PX), down + below * _LINE
                    box = (x - half, y - _LINE / 2, x + half, y + _LINE / 2)
                    within = left < box[0] and box[2] < left + width and top < box[1] and box[3] < top + height
                    free = all(box[2] <= a or c <= box[0] or box[3] <= b or d <= box[1] for a, b, c, d in taken)
                    if within and free:
                        taken.append(box)
                        words.append((f"{layer.look} middle", round(x), round(y + 4 * PX), text))
                        break
        return words

    def _thin(self, x: Floats, y: Floats, most: int) -> np.ndarray:
        """Indices of `most` points evenly along a line, and of as many of its turns, so that a collapse stays sharp."""
        if len(x) <= most:
            return np.arange(len(x))
        width, height = (axis.high - axis.low for axis in (self.panel.x, self.panel.y))
        steps = np.hypot(np.diff(x / width), np.diff(y / height))
        along = np.concatenate([[0.0], np.cumsum(steps)])
        even = np.searchsorted(along, np.linspace(0.0, along[-1], most))
        turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
        return np.union1d(np.minimum(even, len(x) - 1), turns[:most])


def curve_svg(panels: Sequence[Panel], size: tuple[float, float] = SIZE, *, with_key: bool = True) -> Markup:
    """The picture of a curve: measured points with the simulation over them, and below the residual. size: px; the size
    of the type does not change. with_key: whether the looks are named."""
    radius, *residual = panels
    simulated = f", {radius.layer('simulated').name} and residual" if residual else ""
    key = _key(radius, omitted_look="outside" if size[0] <= SIZE[0] else "") if with_key else []  # if there is no room
    key += [("failed", f"{radius.note}\u2003")] if radius.note else []
    return _picture(panels, f"measured radius over time{simulated}", key, size)


def group_svg(panels: Sequence[Panel]) -> Markup:
    """The pictures of a group beside each other: the plane of G and mu, if there is one, and all curves."""
    *planes, curves = panels
    if not planes:
        return all_curves_svg(curves)
    plane = planes[0]
    label = f"{plane.y.label} over {plane.x.label}: the 90 % region of each shot, and that of the material"
    key = _key(plane)
    if any(layer.shape == "arrows" for layer in plane.layers):
        key.append(("", "→ bound"))
    return _picture([plane], label, key, GROUP_SIZE) + all_curves_svg(curves)


def all_curves_svg(panel: Panel) -> Markup:
    """The picture of the curves of all shots."""
    label = f"{panel.y.label} over {panel.x.label} of all shots: measured points, and the predictions of their answers"
    return _picture([panel], label, [("", panel.note)], GROUP_SIZE)


def _picture(panels: Sequence[Panel], label: str, key: Key, size: tuple[float, float]) -> Markup:
    """SVG of one panel, or of a panel with that of the residual below it. key: the text in the row at the top."""
    from cavirheo.reporting.html import template

    view = [round(PX * side) for side in size]
    top = (2 if key else 1) * _ROW + 2 * PX
    across, inner = view[0] - _LEFT - _RIGHT, view[1] - _BOTTOM - top
    below = PX * round(0.26 * (inner - _ROW) / PX) if len(panels) > 1 else 0
    between = _ROW + 8 * PX if below else 0
    begin = view[1] - _BOTTOM - below
    boxes = (_LEFT, top, across, inner - below - between), (_LEFT, begin, across, below)
    frames = [Frame(panel, box) for panel, box in zip(panels, boxes, strict=False)]  # one, or both
    axes, ticks, names = zip(*(frame.axes(along=frame is frames[-1]) for frame in frames), strict=True)
    notes = [("residual end", view[0] - _RIGHT, begin - 6 * PX, panel.note) for panel in panels[1:]]
    content: dict[str, Any] = {"axes": axes, "ticks": [*chain(*ticks)], "key": key}
    content["words"] = [*chain(*names), *notes, *chain(*(frame.names() for frame in frames))]
    content["layers"] = [*chain(*(frame.paths() for frame in frames))]
    return Markup(template("picture.svg").render(view=view, label=label, left=_LEFT, row=_ROW - 5 * PX, **content))


def _key(panel: Panel, *, omitted_look: str = "") -> Key:
    """The key: (look, symbol and name) of each layer with a name. omitted_look: a look that is left out."""
    return [
        (layer.look, f"{_SYMBOLS.get(layer.look, _SYMBOLS.get(layer.shape, ''))} {layer.name}\u2003")
        for layer in panel.layers
        if layer.name and layer.look != omitted_look
    ]


def _path(across: np.ndarray, down: np.ndarray) -> str:
    """Path of lines from point to point."""
    first, *steps = _steps(across, down)
    return f"M{first}l{' '.join(steps)}"


def _steps(across: np.ndarray, down: np.ndarray) -> list[str]:
    """Coordinates of the first point, then of the steps from point to point, in as few letters as SVG allows."""
    x, y = np.diff(across, prepend=0).tolist(), np.diff(down, prepend=0).tolist()
    return [f"{a}{b}" if b < 0 else f"{a} {b}" for a, b in zip(x, y, strict=True)]
