"""The comparison as a picture: G and µ of every set by every method, on logarithmic axes side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cavirheo.reporting.comparison import ALL, MU, TRUSTED, ComparedParameter, Comparison, G
from cavirheo.reporting.group import OURS
from cavirheo.reporting.record import Result
from cavirheo.writing import digits
from cavirheo.writing.document import Spread
from cavirheo.writing.style import BLUE, INK, VERMILLION, plain_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = (  # Okabe and Ito's colours, and a shape each for those who do not see them
    (BLUE, "s"),
    ("#009e73", "D"),
    ("#7f7f7f", "^"),
    ("#cc79a7", "v"),
    ("#e69f00", "P"),
    ("#56b4e9", "X"),
)
_ROOM = 0.78  # of the height of a set, for its methods


def figure(result: Result) -> Figure:
    """Mean ± standard deviation; ours is over the trusted shots, hollow where there are none.

    Our shots are dots, hollow where they are not trusted. Needs matplotlib.
    """
    from matplotlib.figure import Figure

    comparison = Comparison(result)
    names, methods = [group.name for group in result.groups], [*comparison.methods, OURS]
    shown = [name for name in (G, MU) if any(row.name == name for row in comparison.rows)] or [MU]
    height = 1.3 + len(names) * max(0.16 * len(methods), 0.35)
    drawing = Figure(figsize=(1.2 + 4.2 * len(shown), height), facecolor="white", layout="constrained")
    panels = drawing.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, shown, strict=True):
        factor, label = comparison.unit(name)
        rows = {row.group.name: row for row in comparison.rows if row.name == name}
        _panel(axes, [rows.get(group) for group in names], factor, methods, comparison.answers[0])
        axes.set_xlabel(label, fontsize=10, color=INK)
    panels[0].set_yticks(range(len(names)), [digits.elide(name, 28) for name in names], parse_math=False)
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    handles = {text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    order = sorted(handles, key=[*methods, TRUSTED, ALL, *handles].index)
    look: Any = {"loc": "outside upper center", "ncols": min(len(order), 4), "frameon": False, "fontsize": 9}
    if comparison.bubbles:
        drawing.supxlabel(f"{OURS}: {comparison.bubbles}", fontsize=8, color=INK)
    for text in drawing.legend([handles[text] for text in order], order, **look).get_texts():
        text.set_parse_math(False)
    return drawing


def _panel(axes: Axes, rows: Sequence[ComparedParameter | None], factor: float, methods: list[str], ours: str) -> None:
    axes.set_xscale("log")
    step = _ROOM / len(methods)
    for place, row in enumerate(rows):
        heights = {method: place + (k - (len(methods) - 1) / 2) * step for k, method in enumerate(methods)}
        if place % 2:
            axes.axhspan(place - 0.5, place + 0.5, color="#f5f3ee", lw=0, zorder=0)
        if row is None:
            look: Any = {"fontsize": 8, "color": "#999999", "va": "center"}
            axes.text(0.02, place, "not determined", transform=axes.get_yaxis_transform(), **look)
            continue
        for method in methods[:-1]:
            style = _STYLES[methods.index(method) % len(_STYLES)]
            _draw_mean(axes, method, row.value(method), factor, heights[method], style)
        _draw_shots(axes, row, factor, heights[OURS] + 0.5 * step)
        name = next((name for name in row.answers if row.value(name).mean is not None), OURS)
        _draw_mean(axes, name if name == ALL else ours, row.value(name), factor, heights[OURS], (VERMILLION, "o"))
    low, high = axes.get_xlim()
    plain_ticks(axes.xaxis, (1, 2, 5) if high < 40.0 * low else (1, 3) if high < 1e3 * low else (1,))
    axes.tick_params(labelsize=9, labelcolor=INK, color="#888888")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#dddddd", lw=0.6, zorder=0)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)


def _draw_shots(axes: Axes, row: ComparedParameter, factor: float, height: float) -> None:
    for face, label in ((VERMILLION, f"{OURS}: shot, trusted"), ("none", f"{OURS}: shot, not trusted")):
        shots = [shot.determined(row.name) for shot in row.shots if shot.answered and shot.trusted == (face != "none")]
        values = [value * factor for value in shots if value is not None]
        if values:
            look: Any = {"ms": 3, "mec": VERMILLION, "mew": 0.7, "alpha": 0.7, "mfc": face, "zorder": 2}
            axes.plot(values, [height] * len(values), "o", label=label, **look)


def _draw_mean(axes: Axes, name: str, value: Spread, factor: float, height: float, style: tuple[str, str]) -> None:
    if value.mean is None:
        return
    mean, std = value.mean * factor, (value.std or 0.0) * factor
    colour, marker = style
    hollow = name == ALL
    look: Any = {"color": colour, "ms": 5.5, "mfc": "white" if hollow else colour, "mec": colour if hollow else "white"}
    look |= {"mew": 1.2 if hollow else 0.6, "elinewidth": 1.4, "capsize": 2.5, "zorder": 3}
    below = std >= mean  # to where a logarithmic axis does not reach
    ends = [[0.0 if below else std], [std]] if std else None
    axes.errorbar(mean, height, xerr=ends, fmt=marker, label=name, **look)
    if below:
        axes.plot([0.2 * mean, mean], [height] * 2, color=colour, lw=1.4, zorder=2)
        axes.plot(0.2 * mean, height, "<", color=colour, ms=4, label="std reaches below 0", ls="none", zorder=2)
