"""The comparison as a picture: G and µ of every set by every method, on logarithmic axes side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cavirheo.beside.published.comparison import ALL, TRUSTED, ComparedSet, Comparison, units
from cavirheo.beside.published.references import MU, OURS, G, MethodValue
from cavirheo.writing import digits
from cavirheo.writing.style import BLUE, INK, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = (  # Okabe and Ito's colours, and a shape each for those who do not see them
    (BLUE, "s"), ("#009e73", "D"), ("#7f7f7f", "^"), ("#cc79a7", "v"), ("#e69f00", "P"), ("#56b4e9", "X"),
)  # fmt: skip
_ROOM = 0.78  # of the height of a set, for its methods


def figure(comparison: Comparison) -> Figure:
    """Mean ± standard deviation; ours is over the trusted shots, hollow where there are none.

    Our shots are dots, hollow where the verdict is not ok. Needs matplotlib.
    """
    from matplotlib.figure import Figure

    in_units, methods = units(comparison), [*comparison.methods, OURS]
    shown = [q for q in (G, MU) if any(row and row.quantity == q for _, row in comparison.rows())] or [MU]
    height = 1.3 + len(comparison.sets) * max(0.16 * len(methods), 0.35)
    drawing = Figure(figsize=(1.2 + 4.2 * len(shown), height), facecolor="white", layout="constrained")
    panels = drawing.subplots(1, len(shown), sharey=True, squeeze=False)[0]
    for axes, quantity in zip(panels, shown, strict=True):
        factor, symbol, unit = in_units[quantity]
        _panel(axes, comparison, quantity, factor, methods)
        axes.set_xlabel(f"{symbol} ({unit})", fontsize=10, color=INK)
    panels[0].set_yticks(
        range(len(comparison.sets)), [digits.elide(about.name, 28) for about in comparison.sets], parse_math=False
    )
    panels[0].set_ylim(len(comparison.sets) - 0.5, -0.5)
    handles = {text: handle for axes in panels for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    order = [text for text in (*methods, TRUSTED, ALL) if text in handles]
    order += [text for text in handles if text not in order]
    look: Any = {"loc": "outside upper center", "ncols": min(len(order), 4), "frameon": False, "fontsize": 9}
    for text in drawing.legend([handles[text] for text in order], order, **look).get_texts():
        text.set_parse_math(False)
    return drawing


def _panel(axes: Axes, comparison: Comparison, quantity: str, factor: float, methods: list[str]) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axes.set_xscale("log")
    step = _ROOM / max(len(methods), 1)
    for place, about in enumerate(comparison.sets):
        if place % 2:
            axes.axhspan(place - 0.5, place + 0.5, color="#f5f3ee", lw=0, zorder=0)
        rows = [row for row in about.quantities if row.quantity == quantity]
        for row in rows:
            heights = {method: place + (k - (len(methods) - 1) / 2) * step for k, method in enumerate(methods)}
            for method, value in row.published.items():
                style = _STYLES[methods.index(method) % len(_STYLES)]
                _draw_mean(axes, method, value, factor, heights[method], style)
            _draw_shots(axes, about, quantity, factor, heights[OURS] + 0.5 * step)
            name, ours = next(((n, v) for n, v in row.answers() if v.mean is not None), (OURS, row.ours))
            name = TRUSTED if comparison.doubtful and name == OURS else name
            _draw_mean(axes, name, ours, factor, heights[OURS], (VERMILLION, "o"))
        if not rows:
            axes.text(
                0.02, place, "not determined", transform=axes.get_yaxis_transform(), fontsize=8, color="#999999",
                va="center",
            )  # fmt: skip
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(labelsize=9, labelcolor=INK, color="#888888")
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", color="#dddddd", lw=0.6, zorder=0)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)


def _draw_shots(axes: Axes, about: ComparedSet, quantity: str, factor: float, height: float) -> None:
    for fine, label in ((True, f"{OURS}: shot, ok"), (False, f"{OURS}: shot, not ok")):
        values = [
            value * factor
            for shot in about.shots
            if (value := getattr(shot, quantity)) is not None and (shot.verdict == "ok") == fine
        ]
        if values:
            axes.plot(
                values, [height] * len(values), "o", ms=3, mec=VERMILLION, mew=0.7, alpha=0.7,
                mfc=VERMILLION if fine else "none", label=label, zorder=2,
            )  # fmt: skip


def _draw_mean(axes: Axes, name: str, value: MethodValue, factor: float, height: float, style: tuple[str, str]) -> None:
    if value.mean is None:
        return
    mean, std = value.mean * factor, (value.std or 0.0) * factor
    colour, marker = style
    face, edge = ("white", colour) if name == ALL else (colour, "white")
    below = std >= mean  # to where a logarithmic axis does not reach
    axes.errorbar(
        mean, height, xerr=[[0.0 if below else std], [std]] if std else None, fmt=marker, color=colour, ms=5.5,
        mfc=face, mec=edge, mew=1.2 if name == ALL else 0.6, elinewidth=1.4, capsize=2.5, label=name, zorder=3,
    )  # fmt: skip
    if below:
        axes.plot([0.2 * mean, mean], [height] * 2, color=colour, lw=1.4, zorder=2)
        axes.plot(0.2 * mean, height, "<", color=colour, ms=4, label="std reaches below 0", ls="none", zorder=2)
