"""Panels as pictures (SVG) of pages, and as figures by matplotlib, all readable in grey.

Coordinates of SVG are whole numbers, PX to a pixel; its colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from cavirheo.arrays import Floats
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting.panels import Layer, Panel, curve_panels
from cavirheo.reporting.templates import template
from cavirheo.writing import digits
from cavirheo.writing.export import import_optional

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
_COLUMN = 84 / 25.4, 68 / 25.4  # inches: a figure as wide as a column of a paper
_BLUE, _VERMILLION = "#0072b2", "#d55e00"  # of Okabe and Ito, distinct also for colour-blind readers
_DOT = {"marker": "o", "ls": "", "ms": 2.4, "mew": 0.5, "mfc": "none"}
_STYLES: dict[str, dict[str, Any]] = {  # of matplotlib, by look
    "measured": _DOT | {"mec": "black"},
    "outside": _DOT | {"mec": "#a0a0a0"},
    "residual": _DOT | {"mec": "black"},
    "simulated": {"color": _VERMILLION, "lw": 1.0},
    "zero": {"color": "black", "lw": 0.5},
    "draws": {"color": _VERMILLION, "alpha": 0.25, "lw": 0},
}


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
        """(look, x, y, text) of the names at points that have a place where they cover no line, dot or other name."""
        first, last = (self.left, self.top), (self.left + self.width, self.top + self.height)
        marks = [layer for layer in self.panel.drawn if layer.shape in ("line", "dots")]
        places = [np.array([self.across(mark.x), self.down(mark.y)]) for mark in marks]
        taken = [(place.min(axis=1), place.max(axis=1)) for place in places]
        for label in (layer for layer in self.panel.drawn if layer.shape == "label"):
            x, y = float(self.across(label.x[0])), float(self.down(label.y[0]))
            half = 0.5 * np.array([_LETTER * len(label.text), _LINE])
            for aside, below in _AROUND:
                middle = np.array([x + aside * (half[0] + 2 * PX), y + below * _LINE])
                low, high = middle - half, middle + half
                free = all(np.any(low >= end) or np.any(high <= start) for start, end in taken)
                if free and np.all(low > first) and np.all(high < last):
                    taken.append((low, high))
                    yield f"{label.look} middle", round(middle[0]), round(middle[1] + 4 * PX), label.text
                    break


def picture(panels: Sequence[Panel], size: tuple[float, float] = SIZE, *, with_key: bool = True) -> Markup:
    """SVG of one panel, or of a panel with that of the residual below it. size: px; the size of the type does not
    change. with_key: whether the looks of the first panel are named above it."""
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


def answer_figure(answer: Posterior) -> Figure:
    """Figure of an answer and its curve: measured points with the simulation over them, and below the residual. Raises
    InputError: it has no curve, or matplotlib is missing."""
    curve = answer.curve
    if curve is None:
        message = "the answer has no curve to draw: set one, dataclasses.replace(answer, curve=curve)"
        raise InputError(message, "posterior.no_curve")
    import_optional("matplotlib", "cavirheo[plot]")
    from matplotlib.figure import Figure

    panels = curve_panels(curve, answer.checks, answer.method)
    figure = Figure(figsize=_COLUMN, dpi=200, layout="constrained")
    how: Any = {"squeeze": False, "sharex": True, "height_ratios": [2, 1][: len(panels)]}
    rows: Any = figure.subplots(len(panels), 1, **how)[:, 0]
    for axes, panel in zip(rows, panels, strict=True):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.set(xlim=(panel.x.low, panel.x.high), ylim=(panel.y.low, panel.y.high))
        axes.set_ylabel(panel.y.label, fontsize=7)
        for layer in panel.drawn:
            draw = axes.fill if layer.shape == "area" else axes.plot
            draw(layer.x, layer.y, label=layer.name or "_", **_STYLES[layer.look])
    rows[-1].set_xlabel(panels[0].x.label, fontsize=7)
    legend = rows[0].legend(loc="upper right", frameon=False, fontsize=7, title=digits.elide(answer.name, 30))
    legend.get_title().set(fontsize=7, fontweight="bold", parse_math=False)
    return figure


def corner_figure(draws: Mapping[str, Floats], weights: Floats) -> Figure:
    """Figure of the weighted draws (k,) of each parameter, by natural name in SI, with median and central 90 %, and of
    each pair of parameters, by `corner` (Foreman-Mackey 2016, doi:10.21105/joss.00024). Raises InputError without
    corner."""
    corner = import_optional("corner", "cavirheo[plot]")
    from matplotlib.figure import Figure

    columns = [(digits.shown(name, float(np.median(values))), values) for name, values in draws.items()]
    labels = [f"{shown.symbol} ({shown.unit})" if shown.unit else shown.symbol for shown, _ in columns]
    size = 2.2 * len(draws) + 0.8
    figure = Figure(figsize=(size, size))
    ends = (0.05, 0.5, 0.95)
    options = {"quantiles": ends, "title_quantiles": ends, "show_titles": True, "title_fmt": ".3g", "color": _BLUE}
    values = np.column_stack([shown.factor * values for shown, values in columns])
    corner.corner(values, weights=weights, labels=labels, fig=figure, **options)
    return figure
