"""Figures as files, for those that are asked for: `curve_panels` and `group_panels` drawn by matplotlib.

The size and type of a figure are a `FigureStyle`: SCREEN, with name, verdict and answer above the axes, or PAPER, for a
two-column paper: 84 or 174 mm wide, type of 7 and 8 pt, told apart in grey.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.errors import require
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit, parameters_of
from cavirheo.reporting.curve_panels import RMAX, Axis, Layer, Panel, answer_panels
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.group_panels import GroupPanels, group_panels, shots_of
from cavirheo.reporting.laws import Laws, WeighedLaws
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits, style
from cavirheo.writing.document import Outputs, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KINDS = ("png", "svg", "pdf")  # of files
FIGURES = (*KINDS, "paper")  # that can be asked for
_MM = 25.4  # to an inch
_GREY = "#a0a0a0"
_LIGHTEST = 0.85  # tone of a shot, of 1
_RATHER = 104  # letters in a line of a heading


@dataclass(frozen=True)
class FigureStyle:
    """How large a figure is and how it looks.

    Attributes:
        curve_size: width and height of the figure of a curve's, mm.
        group_size: of a group's, mm.
        small: size of numbers and keys, pt.
        large: size of the names of axes, pt.
        dot: diameter of a measured point, pt.
        line: width of a line, pt.
        hollow: whether measured points are black circles, which print tells apart from the line.
        heading: whether name, verdict and answer stand above the axes.
        dpi: dots per inch of a PNG.
    """

    curve_size: tuple[float, float]
    group_size: tuple[float, float]
    small: float
    large: float
    dot: float
    line: float
    hollow: bool
    heading: bool
    dpi: int

    @property
    def em(self) -> float:
        """mm of the larger type."""
        return self.large * _MM / 72.0

    @property
    def looks(self) -> dict[str, dict[str, Any]]:
        """Of the layers of a panel; of one that is left out there is none."""
        dot = {"marker": "o", "ls": "", "ms": self.dot, "mew": 0.5 if self.hollow else 0.0}
        mark = {"ms": 4.0, "lw": 1.0, "capsize": 2.0, "zorder": 3}
        red, blue, black = style.VERMILLION, style.BLUE, {"mec": "black", "mfc": "none"}
        looks: dict[str, dict[str, Any]] = {
            "measured": dot | (black if self.hollow else {"color": style.BLACK}),
            "outside": dot | ({"mec": _GREY, "mfc": "none"} if self.hollow else {"color": "#b4b4b4"}),
            "simulated": {"color": red, "lw": self.line},
            "residual": dot | (black if self.hollow else {"color": blue}),
            "zero": {"color": "black", "lw": 0.5},
            "band": {"color": blue, "alpha": 0.13, "lw": 0},
            "shot": {"lw": 0.8 * self.line},
            "interval": {"lw": 0.8},
            "estimate": {"s": 14.0},
            "ring": {"marker": "o", "ls": "", "ms": 3.2, "mew": 0.8, "mec": style.INK, "mfc": "white"},
            "contour": {"color": "black", "ls": "--", "lw": 0.7 * self.line, "zorder": 3},
            "centre": {"color": "black", "marker": "D", **mark},
            "published": {"color": red, "marker": "s", **mark},
            "centre-range": {"color": "black", "alpha": 0.1, "lw": 0},
            "published-range": {"color": red, "alpha": 0.1, "lw": 0},
        }
        if self.hollow:
            del looks["band"]
        return looks


SCREEN = FigureStyle((183.0, 115.0), (183.0, 80.0), 8.5, 9.5, 3.2, 1.4, hollow=False, heading=True, dpi=150)
PAPER = FigureStyle((84.0, 68.0), (174.0, 62.0), 7.0, 8.0, 2.4, 1.0, hollow=True, heading=False, dpi=300)


def check_figures(figures: Sequence[str]) -> None:
    """Raises InputError: a kind of figure that is unknown."""
    unknown = ", ".join(repr(kind) for kind in figures if kind not in FIGURES)
    require(not unknown, f"figures can be {', '.join(FIGURES)}, got {unknown}", "reporting.figures")


def names(curves: Sequence[str], groups: Sequence[str] = (), before: str = "") -> list[str]:
    """File names without their ending of the figures of curves and groups, `before` in front of each."""
    from cavirheo.reporting import file_names

    return file_names([f"{before}{name}" for name in curves] + [f"{before}group-{name}" for name in groups])


def _sets(figures: Sequence[str]) -> list[tuple[str, FigureStyle, tuple[str, ...]]]:
    """What names begin with, the style, and the kinds of files."""
    kinds = tuple(kind for kind in KINDS if kind in figures)
    return [("", SCREEN, kinds)] * bool(kinds) + [("paper-", PAPER, KINDS)] * ("paper" in figures)


def files(figures: Sequence[str], curves: Sequence[str], groups: Sequence[str]) -> list[str]:
    """The names of all files of these kinds of figures."""
    sets = ((names(curves, groups, before), kinds) for before, _, kinds in _sets(figures))
    return [f"{stem}.{kind}" for stems, kinds in sets for stem in stems for kind in kinds]


def write(
    folder: Outputs, pairs: Pairs, document: Result, figures: Sequence[str], advance: Callable[[], None] | None = None
) -> list[str]:
    """Write the figures of all curves and groups; return the reasons of those that failed. advance: called after each.

    There is no figure of a group of a single answer, and none for a paper of a curve without an answer.
    """
    if not style.available():
        return [style.NO_PICTURES]
    rows, unit, failed = document.curves, document.modulus_unit, list[str]()

    def of_curve(index: int, look: FigureStyle) -> Figure | None:
        if not (rows[index].has_answer or look.heading):
            return None
        curve, answer = pairs[index]
        panels = answer_panels(curve, answer.checks, rows[index])
        return curve_figure(panels, look, heading(rows[index], unit))

    def of_group(group: GroupRecord, indices: list[int], look: FigureStyle) -> Figure | None:
        shots = shots_of(pairs, rows, indices)
        return group_figure(group_panels(shots, group, unit), look) if len(shots) > 1 else None

    drawings = [(row.name, partial(of_curve, index)) for index, row in enumerate(rows)]
    drawings += [(group.name, partial(of_group, group, indices)) for group, indices in document.members()]
    for before, look, kinds in _sets(figures):
        stems = names([row.name for row in rows], [group.name for group in document.groups], before)
        for stem, (name, draw) in zip(stems, drawings, strict=True):
            with drawing(f"figure of {name}", failed):
                if (figure := draw(look)) is not None:
                    _save(folder, stem, figure, kinds, look.dpi)
            if advance:
                advance()
    return failed


def write_laws(folder: Outputs, document: Laws) -> list[str]:
    """Write the figures for a paper of the evidence of laws, of all curves and groups; return the reasons of those that
    failed."""
    failed: list[str] = []
    stems = names(
        [record.name for record in document.curves], [record.name for record in document.groups], "paper-laws-"
    )
    for stem, record in zip(stems, [*document.curves, *document.groups], strict=True):
        with drawing(stem, failed):
            _save(folder, stem, laws_figure(record), KINDS, PAPER.dpi)
    return failed


def _save(folder: Outputs, stem: str, figure: Figure, kinds: Sequence[str], dpi: int) -> None:
    """As a file of each kind."""
    for kind in kinds:
        folder.write(f"{stem}.{kind}", style.save, figure, kind, dpi)


def heading(record: CurveRecord, unit: Unit) -> tuple[str, str, list[str]]:
    """Name, verdict and lines that stand above the axes: the answer and its model, or why there is none."""
    name = digits.printable(digits.elide(record.name, 60))
    verdict = digits.LOOKS[record.verdict].words
    if not record.has_answer:
        message = digits.printable(record.message)
        return name, verdict, textwrap.wrap(message, _RATHER, max_lines=3, placeholder=" …")
    values = []
    for parameter in (*parameters_of([record]), "stretch"):
        symbol, factor, written = in_unit(parameter, unit)
        value = record.quantity(parameter)
        values += [] if value.median is None else [f"{symbol} = {digits.quantity(value, factor, unit=written)}"]
    values.append(f"{RMAX} = {digits.micrometres(record.max_radius_m)} µm")
    unbroken = "   ".join(part.replace(" ", "\u00a0") for part in values)
    return name, verdict, [*textwrap.wrap(unbroken, _RATHER), f"model: {digits.elide(record.in_words, 80)}"]


def curve_figure(panels: Sequence[Panel], look: FigureStyle, head: tuple[str, str, Sequence[str]]) -> Figure:
    """The measured points, the simulation over them, and below what is left between; a curve without an answer has its
    points alone, and the heading says why."""
    figure, em = _figure(look.curve_size), look.em
    width, height = look.curve_size
    left, bottom, across = 6.4 * em, 3.6 * em, width - 7.1 * em
    top = _head(figure, look, head) - 2.0 * em if look.heading else height - 0.7 * em
    radius, *residual = panels
    lower = 0.18 * height * len(residual)
    begin = bottom + lower + (1.7 if look.heading else 1.1) * em * len(residual)
    upper = _panel(figure, (left, begin, across, top - begin), radius, look, along=not residual)
    if radius.layers:
        _legend(upper, look, loc="upper right")
    else:
        style.write(upper, 0.5, 0.5, radius.note, size=look.large, ha="center")
    for panel in residual:
        below = _panel(figure, (left, bottom, across, lower), panel, look)
        if "band" in look.looks:
            style.write(below, 1.0, 1.05, panel.note, size=look.small, color=style.BLUE, ha="right")
    return figure


def group_figure(group: GroupPanels, look: FigureStyle) -> Figure:
    """All shots over each other, and their answers with the material; rings do not count."""
    figure, em = _figure(look.group_size), look.em
    width, height = look.group_size
    bottom, tall = 3.9 * em, height - 7.4 * em  # two lines of the key above
    if look.heading:
        tall = _head(figure, look, (group.title, "", [group.subtitle])) - 1.4 * em - bottom
    half = (width - 15.5 * em) / 2.0
    tones = np.sort(np.concatenate([layer.tones for layer in group.shots.layers if layer.tones is not None]))
    left = _panel(figure, (4.6 * em, bottom, half, tall), group.shots, look, tones)
    _size_key(figure, group.sizes, (5.3 * em + half, bottom, 0.7 * em, 0.84 * tall), look)
    right = _panel(figure, (width - 0.7 * em - half, bottom, half, tall), group.answers[0], look, tones)
    if right.get_legend_handles_labels()[0]:
        _legend(right, look, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.01))
    for axes, letter in ((left, "a"), (right, "b")):
        if not look.heading:
            axes.set_title(letter, loc="left", fontsize=look.large, fontweight="bold")
    return figure


def laws_figure(ranking: WeighedLaws) -> Figure:
    """One column: the log evidence of each law below that of the best, with its standard error; filled: the chosen."""
    laws = {name: law for name, law in ranking.laws.items() if law.log_evidence is not None}
    ordered = sorted(laws, key=lambda name: laws[name].log_evidence or 0.0)
    best = max((laws[name].log_evidence or 0.0 for name in ordered), default=0.0)
    labels, height = [digits.elide(name, 24) for name in ordered], 6.0 * max(len(ordered), 2)
    left, width = 4.0 + 1.5 * max(map(len, labels), default=8), PAPER.curve_size[0]
    lowest = min((laws[name].log_evidence or 0.0 for name in ordered), default=best) - best
    figure = _figure((width, 14.0 + height))
    ends = Axis("log evidence, best = 0", 1.8 * min(lowest, -2.0), 3.0), Axis("", -0.6, max(len(ordered), 2) - 0.4)
    axes = _axes(figure, (left, 10.0, width - left - 2.0, height), *ends, PAPER)
    for row, name in enumerate(ordered):
        law = laws[name]
        look: Any = {"color": "black", "mfc": "black" if name == ranking.chosen else "white", "ms": 4.0, "mew": 0.8}
        axes.errorbar((law.log_evidence or 0.0) - best, row, xerr=law.standard_error or 0.0, fmt="o", lw=0.8, **look)
    axes.axvline(0.0, color=_GREY, lw=0.5, zorder=0)
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(ends[0].low, ends[0].high)
    axes.set_yticks(range(len(ordered)), labels)
    return figure


def _figure(size: tuple[float, float]) -> Figure:
    """Width and height in mm."""
    figure = style.new_figure(1.0)
    figure.set_size_inches(size[0] / _MM, size[1] / _MM)
    return figure


def _head(figure: Figure, look: FigureStyle, head: tuple[str, str, Sequence[str]]) -> float:
    """Name, verdict and lines at the top; the height at which they end, mm."""
    width, height = (_MM * side for side in figure.get_size_inches())
    name, verdict, lines = head
    y = height - 1.7 * look.em
    size, right = look.large + 1.5, 1.0 - 0.7 * look.em / width
    style.write(figure, 0.7 * look.em / width, y / height, name, size=size, weight="bold")
    style.write(figure, right, y / height, verdict, size=size, weight="bold", ha="right")
    for line in lines:
        y -= 1.6 * look.em
        style.write(figure, 0.7 * look.em / width, y / height, line, size=look.large, color=style.INK)
    return y


def _panel(
    figure: Figure,
    box: tuple[float, float, float, float],
    panel: Panel,
    look: FigureStyle,
    tones: Floats | None = None,
    *,
    along: bool = True,
) -> Axes:
    """Axes with their layers. tones: of all shots in order, whose colours are evenly apart."""
    x = Axis(panel.x.title if look.heading else panel.x.label, panel.x.low, panel.x.high)
    axes = _axes(figure, box, x, panel.y, look, along=along)
    for layer in panel.layers:
        if layer.look in look.looks:
            colours = None
            if layer.tones is not None and tones is not None:
                places = np.searchsorted(tones, layer.tones) / max(len(tones) - 1, 1)
                colours = style.shades(_LIGHTEST * places)
            _layer(axes, layer, look.looks[layer.look], colours)
    if panel.top and look.heading:
        _along_top(axes, panel.top, look)
    return axes


def _layer(axes: Axes, layer: Layer, how: dict[str, Any], colours: np.ndarray | None) -> None:
    """colours: (n, 3) of the points, (1, 3) of a line; None: that of the look."""
    x, y, label = layer.x, layer.y, layer.name or "_"
    if layer.shape == "band":
        axes.axhspan(*y, **how)
    elif layer.shape == "bars":
        xerr, yerr = (np.abs(values[:, [0, 2]] - values[:, [1]]).T for values in (x, y))
        points: dict[str, Any] = {"ls": ""} if "marker" in how else {"fmt": "none", "ecolor": colours}
        axes.errorbar(x[:, 1], y[:, 1], yerr, xerr, label=label, **how | points)
    elif layer.shape == "dots" and colours is not None:
        axes.scatter(x, y, c=colours, zorder=2, **how)
    else:
        colour = {} if colours is None else {"color": colours[0]}
        flat = {"marker": ""} if layer.shape == "line" else {}
        axes.plot(x, y, label=label, **how | colour | flat)


def _axes(
    figure: Figure, box: tuple[float, float, float, float], x: Axis, y: Axis, look: FigureStyle, *, along: bool = True
) -> Axes:
    """left, bottom, width and height in mm; along: with numbers and name along the bottom."""
    width, height = (_MM * side for side in figure.get_size_inches())
    axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_linewidth(0.6)
    axes.tick_params(labelsize=look.small, width=0.6, length=2.0, pad=2.0, labelbottom=along)
    axes.set_xlabel(x.label if along else "", fontsize=look.large, labelpad=2.0)
    axes.set_ylabel(y.label.replace(" (%", "\n(%"), fontsize=look.large)
    axes.yaxis.set_label_coords(-3.3 * look.em / box[2], 0.5)  # left of the widest numbers
    axes.set(xlim=(x.low, x.high), ylim=(y.low, y.high), xticks=x.ticks(7), yticks=y.ticks(6 if box[3] > 20 else 3))
    return axes


def _along_top(axes: Axes, axis: Axis, look: FigureStyle) -> None:
    """t* along the top."""
    top: Any = axes.twiny()
    top.spines[:].set_visible(False)
    top.set(xlim=(axis.low, axis.high), xticks=axis.ticks(8))
    top.tick_params(labelsize=look.small, labelcolor="#808080", color="#aaaaaa", length=3, pad=1)
    style.write(top, 1.0, 1.06, axis.label, size=look.small, color="#808080", ha="right")


def _legend(axes: Axes, look: FigureStyle, **place: Any) -> None:
    key: Any = {"frameon": False, "fontsize": look.small, "handlelength": 1.4, "borderpad": 0.0}
    axes.legend(**key, **place)


def _size_key(figure: Figure, sizes: Floats, box: tuple[float, float, float, float], look: FigureStyle) -> None:
    """Which tone is which R_max, µm: a cell for each shot, the smallest at the bottom."""
    count, ordered = len(sizes), np.sort(sizes)
    bar = _axes(figure, box, Axis("", -0.5, 0.5), Axis("", -0.5, count - 0.5), look)
    tones = style.shades(np.linspace(0.0, _LIGHTEST, count))
    bar.imshow(tones[:, None], aspect="auto", origin="lower", extent=(-0.5, 0.5, -0.5, count - 0.5))
    labelled = sorted({0, count // 2, count - 1})
    bar.set_xticks([])
    bar.set_yticks(labelled, [f"{ordered[i]:.0f}" for i in labelled])
    bar.yaxis.tick_right()
    bar.tick_params(length=0.0)
    bar.spines[:].set_visible(False)
    bar.set_title(f"{RMAX}\n(µm)", fontsize=look.small, loc="left")
