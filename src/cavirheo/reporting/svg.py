"""Pictures as SVG text, which a page holds in itself: one template (picture.svg) at every size, and no library.

Coordinates are whole numbers, UNITS to a pixel. Colours are those of picture.css, which each page has once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.reporting.curve_lines import RMAX, Axis, CurveLines, thinned
from cavirheo.reporting.group_lines import AnswerPoints, GroupLines
from cavirheo.writing import digits
from cavirheo.writing.style import shades

if TYPE_CHECKING:
    from jinja2 import Template
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
_ONE = (_LEFT, 2 * _ROW + 2, WIDTH - _LEFT - _RIGHT, HEIGHT - _BELOW - 2 * _ROW - 2)  # px: one panel


class Picture:
    """One picture in the making: axes, then layers over them, then words."""

    def __init__(self, width: float, height: float, label: str) -> None:
        self.width, self.height, self.label = width, height, label
        self.axes: list[str] = []
        self.ticks: list[tuple[str, float, float, str]] = []
        self.layers: list[tuple[str, str, str]] = []
        self.words: list[tuple[str, int, int, list[tuple[str, str]]]] = []

    def panel(self, box: Box, x: Axis, y: Axis, *, along: bool = True, few: bool = False) -> Panel:
        """Axes in a box, with ticks and names. along: those of `x`, too. few: few ticks, the last with the name, which
        is a unit."""
        panel = Panel(self, box, x, y)
        panel.ticks_of_y(few)
        self.axes.append(f"M{_units(box[0])} {_units(box[1])}v{_units(box[3])}h{_units(box[2])}")
        if along:
            panel.ticks_of_x(few)
        return panel

    def write(self, kind: str, x: float, y: float, text: str) -> None:
        """Words whose baseline is y; kind: class of their look."""
        self.key(kind, x, y, [("", text)])

    def key(self, kind: str, x: float, y: float, parts: Sequence[tuple[str, str]]) -> None:
        """Several words in a row, each with the class of its look."""
        self.words.append((kind, _units(x), _units(y), [(look, digits.printable(text)) for look, text in parts]))

    @property
    def svg(self) -> Markup:
        """The picture as SVG; all words are escaped."""
        from markupsafe import Markup

        view = _units(self.width), _units(self.height)
        made = {"axes": "".join(self.axes), "ticks": self.ticks, "layers": self.layers, "words": self.words}
        return Markup(_template().render(view=view, label=digits.printable(self.label), **made))


class Panel:
    """Axes of a picture, that place what is drawn into them."""

    def __init__(self, picture: Picture, box: Box, x: Axis, y: Axis) -> None:
        self.picture, self.box, self.x, self.y = picture, box, x, y

    def ticks_of_y(self, few: bool) -> None:
        """Numbers left of the axes, and lines along them unless they are few."""
        left, top, width, height = self.box
        rows = self.y.ticks(2 if few else max(int(height / 36), 4))
        _, places = self.place(np.full(len(rows), self.x.low), np.array(rows))
        self._number("end", np.full(len(rows), _units(left - 5)), places + _units(4), rows, self.y.label * few)
        if not few:
            self.picture.axes += [f"M{_units(left)} {place}h{_units(width)}" for place in places]
            self.picture.write("name", 2, top - 6, self.y.label)

    def ticks_of_x(self, few: bool) -> None:
        """Numbers below the axes."""
        left, top, width, height = self.box
        bottom, columns = top + height, self.x.ticks(3 if few else max(int(width / 55), 2))
        places, _ = self.place(np.array(columns), np.full(len(columns), self.y.low))
        self._number("middle", places, np.full(len(places), _units(bottom + 15)), columns, self.x.label * few)
        self.picture.axes += [f"M{place} {_units(bottom)}v{_units(_TICK)}" for place in places]
        if not few:
            self.picture.write("name end", left + width, bottom + 31, self.x.label)

    def _number(self, anchor: str, x: np.ndarray, y: np.ndarray, values: Sequence[float], unit: str) -> None:
        words = [f"{value:g}" for value in values]
        if words and unit:
            words[-1] += f" {unit}"
        self.picture.ticks += [(anchor, *place) for place in zip(x.tolist(), y.tolist(), words, strict=True)]

    def place(self, x: Floats, y: Floats) -> tuple[np.ndarray, np.ndarray]:
        """In whole units of the picture."""
        left, top, width, height = self.box
        across = left + width * (np.asarray(x, dtype=float) - self.x.low) / (self.x.high - self.x.low)
        down = top + height * (self.y.high - np.asarray(y, dtype=float)) / (self.y.high - self.y.low)
        return np.rint(UNITS * across).astype(int), np.rint(UNITS * down).astype(int)

    def dots(self, kind: str, x: Floats, y: Floats, most: int = POINTS, colour: str = "") -> None:
        """A dot for each point, or for every k-th of more than `most`."""
        every = max(-(-len(x) // max(most, 1)), 1)
        across, down = self.place(x[::every], y[::every])
        self._layer(kind, "".join(f"m{step}z" for step in _steps(across, down)).replace("m", "M", 1), colour)

    def line(self, kind: str, x: Floats, y: Floats, most: int = POINTS, colour: str = "") -> None:
        """A line through the points, with no more than about `most` of them; it breaks where a number is NaN."""
        known, path = np.flatnonzero(np.isfinite(y)), ""
        for part in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(known) else ():
            across, down = x[part] / (self.x.high - self.x.low), y[part] / (self.y.high - self.y.low)
            kept = part[thinned(across, down, max(most * len(part) // len(known), 2))]
            first, *steps = _steps(*self.place(x[kept], y[kept]))
            path += f"M{first}l{' '.join(steps)}" if steps else f"M{first}z"
        self._layer(kind, path, colour)

    def band(self, kind: str, low: float, high: float) -> None:
        """Between two values of `y`, along all of `x`."""
        (left, right), (top, bottom) = self.place([self.x.low, self.x.high], [high, low])  # type: ignore[arg-type]
        self._layer(kind, f"M{left} {top}h{right - left}V{bottom}H{left}z")

    def bars(self, kind: str, x: Floats, y: Floats, colour: str = "") -> None:
        """(n, 3) lower ends, middles and upper ends along both axes."""
        across, down = self.place(x, y)
        parts = [
            (f"M{a} {m}H{b}" if a < b else "") + (f"M{k} {c}V{d}" if d < c else "")
            for (a, k, b), (c, m, d) in zip(across.tolist(), down.tolist(), strict=True)
        ]
        self._layer(kind, "".join(parts), colour)

    def marks(self, kind: str, x: Floats) -> None:
        """Short lines that stand on the lower end of `y`."""
        across, down = self.place(x, np.full(len(x), self.y.low))
        self._layer(kind, "".join(f"M{a} {b}v{_units(-7)}" for a, b in zip(across, down, strict=True)))

    def along_top(self, axis: Axis) -> None:
        """The ticks of a second axis along the top."""
        left, top, width, _ = self.box
        for tick in axis.ticks(max(int(width / 45), 2)):
            place = left + width * (tick - axis.low) / (axis.high - axis.low)
            self.picture.axes.append(f"M{_units(place)} {_units(top)}v{_units(-_TICK)}")
            if left + 30 < place < left + width - 25:  # the ends are those of the axes' names
                self.picture.ticks.append(("middle", _units(place), _units(top - 6), f"{tick:g}"))
        self.picture.write("name end", left + width, top - 6, axis.label)

    def _layer(self, kind: str, path: str, colour: str = "") -> None:
        if path:
            self.picture.layers.append((kind, path, colour))


def curve_svg(
    lines: CurveLines, width: float = WIDTH, height: float = HEIGHT, *, points: int = POINTS, brief: bool = False
) -> Markup:
    """The picture of a curve: measured points, the simulation over them, and below what is left between, with a band of
    ± RMSE. Without an answer it says so.

    width and height: px; type keeps its size. points: about so many are drawn. brief: of fewer bytes, without residual,
    key and t*, and half as high.
    """
    if brief:
        return _brief(lines, width, height / 2, points)
    compared = len(lines.residual) > 0
    label = f"measured radius over time{f', {lines.simulated_as} and residual' if compared else ''}"
    picture, top = Picture(width, height, label), 2 * _ROW + 2
    across, inner = width - _LEFT - _RIGHT, height - _BELOW - top
    lower = round(0.26 * (inner - _ROW)) if compared else 0
    upper = inner - lower - (_ROW + 4) * compared
    panel = picture.panel((_LEFT, top, across, upper), lines.time_axis, lines.y, along=not compared)
    _radii(panel, lines, points)
    if compared:
        box = _LEFT, height - _BELOW - lower, across, lower
        _residuals(picture.panel(box, lines.time_axis, lines.difference), lines, points // 5)
        if lines.band:
            picture.write("residual end", width - _RIGHT, box[1] - 6, lines.band)
    if axis := lines.t_star_axis:
        panel.along_top(axis)
    _key(picture, lines)
    if not len(lines.time):
        picture.write("name middle", _LEFT + across / 2, top + upper / 2, "no measured radius")
    return picture.svg


def _brief(lines: CurveLines, width: float, height: float, points: int) -> Markup:
    """Units stand at the last numbers, not at the axes."""
    picture = Picture(width, height, "R(t)")
    box = _LEFT, 6, width - _LEFT - _RIGHT, height - 6 - 20
    units = [axis.label.partition("(")[2].rstrip(")") for axis in (lines.x, lines.y)]
    panel = picture.panel(box, replace(lines.x, label=units[0]), replace(lines.y, label=units[1]), few=True)
    _radii(panel, lines, points)
    if not lines.answered or not len(lines.time):
        picture.write("failed end", width - _RIGHT, 22, "no answer" if len(lines.time) else "no measured radius")
    return picture.svg


def _radii(panel: Panel, lines: CurveLines, points: int) -> None:
    """Two fifths of the points are measured ones, two fifths are those of the simulation."""
    for kind, some in (("outside", ~lines.compared), ("measured", lines.compared)):
        share = 2 * points * int(np.count_nonzero(some)) // (5 * max(len(some), 1))
        panel.dots(kind, lines.time[some], lines.radius[some], max(share, 1))
    panel.line("simulated", lines.simulated_time, lines.simulated_radius, 2 * points // 5)
    panel.dots("outlier", *lines.outliers.T)
    panel.marks("missing", lines.missing)


def _residuals(panel: Panel, lines: CurveLines, most: int) -> None:
    if lines.rmse:
        panel.band("band", -lines.rmse, lines.rmse)
    panel.line("zero", np.array([lines.x.low, lines.x.high]), np.zeros(2))
    panel.dots("residual", lines.residual_time, lines.residual, most)


def _key(picture: Picture, lines: CurveLines) -> None:
    """What dots and lines are, in their colours, in the row at the top."""
    parts = [("measured", "● measured")] if lines.compared.any() else []
    grey = lines.answered and not lines.compared.all() and picture.width >= WIDTH  # else there is no room
    parts += [("outside", "● not compared")] if grey else []
    parts += [("outlier", "○ stands out, kept")] if len(lines.outliers) else []
    parts += [("missing", "| no radius")] if len(lines.missing) else []
    parts += [("simulated", f"— {lines.simulated_as}")] if len(lines.simulated_time) else []
    parts += [] if lines.answered else [("failed", "no answer: no line is drawn")]
    picture.key("name", _LEFT, _ROW - 5, [(kind, f"{text}\u2003") for kind, text in parts])


def group_svg(lines: GroupLines, points: int = GROUP_POINTS) -> Markup:
    """The pictures of a group beside each other: its shots, then their answers. points: of the lines of the shots."""
    from markupsafe import Markup

    pictures = [_shots(lines, points), *(_answers(lines, answers) for answers in lines.answers)]
    return Markup("").join(picture.svg for picture in pictures)


def _shots(lines: GroupLines, points: int) -> Picture:
    """Where there are too many shots for these points, every k-th is drawn."""
    picture = Picture(WIDTH, HEIGHT, f"radius over time of {digits.counted(len(lines.shots), 'shot')}")
    panel = picture.panel(_ONE, lines.x, lines.y)
    every = max(-(-len(lines.shots) * _FEWEST // points), 1)
    drawn = lines.shots[::every]
    for shot in drawn:
        tone = _tones(np.array([shot.size]))[0]
        panel.line("shot", shot.t_star, shot.radius, max(points // len(drawn), _FEWEST), tone)
    some = f", 1 of {every} is drawn" if every > 1 else ""
    sizes = f"{RMAX} {lines.smallest:.0f} µm (dark) to {lines.largest:.0f} µm (light){some}"
    picture.write("name", _LEFT, _ROW - 5, sizes if lines.largest > lines.smallest else lines.title)
    return picture


def _answers(lines: GroupLines, answers: AnswerPoints) -> Picture:
    """Rings are answers that do not count."""
    picture = Picture(WIDTH, HEIGHT, f"{answers.y.label} of each shot over {answers.x.label}")
    panel = picture.panel(_ONE, answers.x, answers.y)
    tones = np.array(_tones(np.array([shot.size for shot in lines.shots])))
    known = np.isfinite(answers.across).all(axis=1) & np.isfinite(answers.up).all(axis=1)
    for tone in dict.fromkeys(tones.tolist()):
        panel.bars("interval", answers.across[known & (tones == tone)], answers.up[known & (tones == tone)], tone)
    for tone in dict.fromkeys(tones.tolist()):
        some = known & (tones == tone)
        panel.dots("estimate", answers.across[some, 1], answers.up[some, 1], len(some), tone)
    some = known & ~lines.trusted
    panel.dots("ring", answers.across[some, 1], answers.up[some, 1], len(some))
    panel.line("contour", *answers.contour.T)
    panel.line("centre", *answers.slope.T)
    parts = [("centre", f"— {answers.slope_words}")] if len(answers.slope) else []
    parts += [("centre", "- - 90 % of shots")] if len(answers.contour) else []
    for mark in answers.marks:
        kind = "simulated" if mark.published else "centre"
        parts.append((kind, f"+ {mark.name}"))
        if mark.x is not None:
            panel.bars(kind, mark.x[None], mark.y[None])
        else:
            low, middle, high = mark.y
            panel.line(kind, np.array([answers.x.low, answers.x.high]), np.full(2, middle))
            panel.band("band", low, high)
    parts += [("outside", "○ does not count")] if not lines.trusted.all() else []
    picture.key("name", _LEFT, _ROW - 5, [(kind, f"{text}\u2003") for kind, text in parts])
    return picture


def _tones(sizes: Floats) -> list[str]:
    """Of few tones, so that the shots of one are one path."""
    tones = shades(np.rint(_TONES * sizes) / _TONES)
    return ["#" + "".join(f"{round(255 * part):02x}" for part in tone) for tone in tones]


def _steps(across: np.ndarray, down: np.ndarray) -> list[str]:
    """The first place, then from each to the next, in as few letters as SVG allows."""
    x, y = np.diff(across, prepend=0).tolist(), np.diff(down, prepend=0).tolist()
    return [f"{a}{b}" if b < 0 else f"{a} {b}" for a, b in zip(x, y, strict=True)]


def _units(pixels: float) -> int:
    return round(UNITS * pixels)


@cache
def style() -> str:
    """The colours and type of all pictures, for the style of a page."""
    return files("cavirheo.reporting").joinpath("picture.css").read_text(encoding="utf-8")


@cache
def _template() -> Template:
    from cavirheo.reporting.html import template

    return template("picture.svg")
