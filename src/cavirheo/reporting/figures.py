"""Figures as files, for those that are asked for: `curve_panels` and `group_panels` drawn by matplotlib.

For a two-column paper: 84 or 174 mm wide, type of 7 and 8 pt, told apart in grey; name, verdict and answer stand in its
caption.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import chain, count
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.errors import require
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.panels import Layer, Panel, answer_panels, group_panels, shots_of
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import style
from cavirheo.writing.document import Outputs, short_name, try_to_draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KINDS = ("png", "svg", "pdf")  # of files
_MM = 25.4  # to an inch
_WIDTH, _PAGE = 84.0, 174.0  # mm: a column, and a page
_SMALL, _LARGE = 7.0, 8.0  # pt: numbers and keys, and the names of axes
_EM = _LARGE * _MM / 72.0  # mm
_LINE = 1.0  # pt
_DPI = 300  # of a PNG
_GREY = "#a0a0a0"
_LIGHTEST = 0.85  # tone of a shot, of 1
_KEY: dict[str, Any] = {"frameon": False, "fontsize": _SMALL, "handlelength": 1.4, "borderpad": 0.0}
_DOT = {"marker": "o", "ls": "", "ms": 2.4, "mew": 0.5, "mfc": "none"}
_MARK = {"ms": 4.0, "lw": 1.0, "capsize": 2.0, "zorder": 3}
_LOOKS: dict[str, dict[str, Any]] = {  # of the layers of a panel; one without is left out
    "measured": _DOT | {"mec": "black"},
    "outside": _DOT | {"mec": _GREY},
    "simulated": {"color": style.VERMILLION, "lw": _LINE},
    "residual": _DOT | {"mec": "black"},
    "zero": {"color": "black", "lw": 0.5},
    "shot": {"lw": 0.8 * _LINE},
    "interval": {"lw": 0.8},
    "estimate": {"s": 14.0},
    "ring": {"marker": "o", "ls": "", "ms": 3.2, "mew": 0.8, "mec": style.INK, "mfc": "white"},
    "contour": {"color": "black", "ls": "--", "lw": 0.7 * _LINE, "zorder": 3},
    "centre": {"color": "black", "marker": "D", **_MARK},
    "published": {"color": style.VERMILLION, "marker": "s", **_MARK},
    "centre-range": {"color": "black", "alpha": 0.1, "lw": 0},
    "published-range": {"color": style.VERMILLION, "alpha": 0.1, "lw": 0},
}


def check_figures(figures: Sequence[str]) -> None:
    """Raises InputError: a kind of figure that is unknown."""
    unknown = ", ".join(repr(kind) for kind in figures if kind not in KINDS)
    require(not unknown, f"figures can be {', '.join(KINDS)}, got {unknown}", "reporting.figures")


def stems_of(curves: Iterable[str], groups: Iterable[str]) -> list[str]:
    """File names without their ending of the figures of curves and groups."""
    return file_names([*curves, *(f"group-{name}" for name in groups)])


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, short enough for an ending, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = short_name(re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100]) or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]


def write(
    folder: Outputs, pairs: Pairs, document: Result, figures: Sequence[str], advance: Callable[[], None] | None = None
) -> list[str]:
    """Write the figures of all curves and groups; return the reasons of those that failed. advance: called after each.

    There is no figure of a curve without an answer, and none of a group of a single answer.
    """
    if not style.available():
        return [style.NO_PICTURES]
    rows, failed = document.curves, list[str]()

    def save(stem: str, group: GroupRecord | None, indices: Sequence[int]) -> None:
        shots, figure = shots_of(pairs, rows, indices), None
        if group and len(shots) > 1:
            figure = group_figure(group_panels(shots, group, document.modulus_unit))
        elif shots and not group:
            figure = curve_figure(answer_panels(*shots[0]))
        for kind in figures if figure else ():
            folder.write(f"{stem}.{kind}", style.save, figure, kind, _DPI)

    pictures: list[tuple[str, GroupRecord | None, list[int]]]
    pictures = [(row.name, None, [index]) for index, row in enumerate(rows)]
    pictures += [(group.name, group, indices) for group, indices in document.members()]
    stems = stems_of((row.name for row in rows), (group.name for group in document.groups))
    for stem, (name, *content) in zip(stems, pictures, strict=True):
        try_to_draw(f"figure of {name}", failed, save, stem, *content)
        if advance:
            advance()
    return failed


def curve_figure(panels: Sequence[Panel]) -> Figure:
    """A column: the measured points, the simulation over them, and below what is left between."""
    height = 68.0
    figure = style.new_figure(height / _MM, _WIDTH / _MM)
    left, bottom, across = 6.4 * _EM, 3.6 * _EM, _WIDTH - 7.1 * _EM
    radius, *residual = panels
    lower = 0.18 * height * len(residual)
    begin = bottom + lower + 1.1 * _EM * len(residual)
    upper = _panel(figure, (left, begin, across, height - 0.7 * _EM - begin), radius, along=not residual)
    upper.legend(**_KEY, loc="upper right")
    for panel in residual:
        _panel(figure, (left, bottom, across, lower), panel)
    return figure


def group_figure(panels: Sequence[Panel]) -> Figure:
    """A page: all shots over each other, and their answers with the material; rings do not count."""
    height = 62.0
    figure = style.new_figure(height / _MM, _PAGE / _MM)
    bottom, tall = 3.9 * _EM, height - 7.4 * _EM  # two lines of the key above
    half = (_PAGE - 12.0 * _EM) / 2.0
    shots, answers, *_ = panels
    left = _panel(figure, (4.6 * _EM, bottom, half, tall), shots)
    style.write(left, 1.0, 1.03, shots.note, size=_SMALL, ha="right")
    right = _panel(figure, (_PAGE - 0.7 * _EM - half, bottom, half, tall), answers)
    if right.get_legend_handles_labels()[0]:
        right.legend(**_KEY, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.01))
    for axes, letter in ((left, "a"), (right, "b")):
        axes.set_title(letter, loc="left", fontsize=_LARGE, fontweight="bold")
    return figure


def _panel(figure: Figure, box: tuple[float, float, float, float], panel: Panel, *, along: bool = True) -> Axes:
    """Axes with their layers. box: left, bottom, width and height, mm; along: with numbers and name at the bottom."""
    (width, height), x, y = (_MM * figure.get_size_inches()), panel.x, panel.y
    axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_linewidth(0.6)
    axes.tick_params(labelsize=_SMALL, width=0.6, length=2.0, pad=2.0, labelbottom=along)
    axes.set_xlabel(x.label if along else "", fontsize=_LARGE, labelpad=2.0)
    axes.set_ylabel(y.label.replace(" (%", "\n(%"), fontsize=_LARGE)
    axes.yaxis.set_label_coords(-3.3 * _EM / box[2], 0.5)  # left of the widest numbers
    axes.set(xlim=(x.low, x.high), ylim=(y.low, y.high), xticks=x.ticks(7), yticks=y.ticks(6 if box[3] > 20 else 3))
    for layer in panel.layers:
        if layer.look in _LOOKS:
            _draw(axes, layer, _LOOKS[layer.look])
    return axes


def _draw(axes: Axes, layer: Layer, how: dict[str, Any]) -> None:
    x, y, label = layer.x, layer.y, layer.name or "_"
    colours = None if layer.tones is None else style.shades(_LIGHTEST * layer.tones)
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
