"""The table and the picture of a design."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.companions.design import Design, width
from cavirheo.reporting.answer import described
from cavirheo.writing import digits, terminal
from cavirheo.writing.style import INK, new_axes, new_figure, shades, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN = 100.0  # of the smallest: what is above is of no use


def print_table(document: Design) -> None:
    """A line per setting, then the next one and the number of shots."""
    from rich.text import Text

    console = terminal.console()
    names = list(document.settings[0].half_width_percent)
    heads = ["frames/s", *(f"{described(name)[0]}\n± %" for name in names), "readable\n%", "shots", "gain\nnats"]
    title = f"{document.material}: expected 90 % interval of one shot, and shots for ± {document.wanted_percent:g} %"
    table = terminal.table("R_max\nµm", heads, title=title)
    for k, one in enumerate(document.settings):
        widths = [width(one.half_width_percent[name]) for name in names]
        shots = digits.MISSING if one.shots is None else str(one.shots)
        cells = [f"{one.frame_rate_hz:,.0f}", *widths, f"{100 * one.readable:.0f}", shots, f"{one.gain_nats:.2f}"]
        style = "bold" if k in (document.best, document.fewest) else ""
        table.add_row(digits.micrometres(one.max_radius_m), *cells, style=style)
    console.print(table)
    for line in document.said:
        console.print(Text(line, "bold"))


def picture(document: Design) -> Figure:
    """The shots that are wanted, and the half-width of each parameter, over R_max and frame rate; the next
    setting is ringed. Bars: the error of so few draws."""
    from matplotlib.ticker import LogLocator, NullLocator

    names = list(document.settings[0].half_width_percent)
    rates = sorted({one.frame_rate_hz for one in document.settings})
    panels: list[tuple[str, list[Any], str, str]] = [  # the word in a panel without a point, and whose ends are shown
        (
            f"{described(name)[0]}: ± % of one shot",
            [one.half_width_percent[name] for one in document.settings],
            "none",
            name,
        )
        for name in names
    ]
    shots = [one.shots for one in document.settings]
    word = "already reached" if 0 in shots else "reached by no setting"
    panels.append((f"shots for ± {document.wanted_percent:g} %", shots, word, ""))
    figure = new_figure(3.0)
    write(figure, 0.07, 0.93, f"{document.material}: which shot next", size=11, weight="bold")
    write(figure, 0.07, 0.865, digits.elide(document.said[0], 110), size=8.5, color=INK)
    tones = shades(np.linspace(0.0, 1.0, len(rates)))
    wide = 0.86 / len(panels)
    for k, (title, values, empty, name) in enumerate(panels):
        axes = new_axes(figure, (0.07 + k * wide, 0.16, wide - 0.06, 0.58), "R_max (µm)", "")
        axes.set_title(title, fontsize=9, color=INK, loc="left")
        seen = [value for value in values if value]
        for rate, tone in zip(rates, tones, strict=True):
            at = [i for i, one in enumerate(document.settings) if one.frame_rate_hz == rate and values[i]]
            x, y = [1e6 * document.settings[i].max_radius_m for i in at], [values[i] for i in at]
            axes.plot(x, y, "o-", color=tone, ms=4, lw=1.3, label=f"{1e-3 * rate:g} kfps")
            ends = [document.settings[i].half_width_ends_percent.get(name) for i in at]
            if x and all(one and None not in one for one in ends):
                low, high = np.array(ends, dtype=float).T
                axes.vlines(x, low, high, color=tone, lw=0.9)
            if document.next in at:
                place = at.index(document.next)
                axes.plot(x[place], y[place], "o", ms=10, mfc="none", mec="black")
        if not seen:
            axes.set(xticks=[], yticks=[], xlabel="")
            write(axes, 0.5, 0.5, empty, size=9, color=INK, ha="center", va="center")
            continue
        axes.set(xscale="log", yscale="log")
        axes.margins(x=0.08)  # of a ring
        axes.set_ylim(0.7 * min(seen), min(1.4 * max(seen), SHOWN * min(seen)))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_locator(NullLocator())
    axes.legend(frameon=False, fontsize=7.5, loc="upper left", bbox_to_anchor=(1.0, 1.0), handlelength=1.2)
    return figure
