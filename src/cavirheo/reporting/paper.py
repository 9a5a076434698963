"""Figures for a two-column paper (`--figures paper`): 84 or 174 mm wide, type of 7 and 8 pt, told apart in grey."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit, parameters_of
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.laws import WeighedLaws
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits, style
from cavirheo.writing.document import Outputs, Quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ONE, TWO = 84.0, 174.0  # mm: the widths of one column and of two
_SMALL, _LARGE = 7.0, 8.0  # pt: numbers and keys, names of axes
_RMAX = r"$R_\mathrm{max}$"
_UNCOMPARED = "#a0a0a0"


def names(curves: Sequence[str], groups: Sequence[str] = (), of: str = "") -> list[str]:
    """File names without their ending, of the figures of curves and of groups; of: "laws-" for those of evidence."""
    from cavirheo.reporting import file_names

    return file_names([f"paper-{of}{name}" for name in curves] + [f"paper-{of}group-{name}" for name in groups])


def write(folder: Outputs, name: str, figure: Figure) -> None:
    """As PDF, SVG and PNG."""
    for kind in style.PAPER:
        folder.write(f"{name}.{kind}", style.save_paper, figure, kind)


def figures(pairs: Pairs, document: Result) -> Iterator[tuple[str, Figure]]:
    """(file name, figure) of every curve that has an answer, and of every group of several."""
    records, unit = document.curves, document.modulus_unit
    stems = iter(names([record.name for record in records], [group.name for group in document.groups]))
    for (curve, answer), record in zip(pairs, records, strict=True):
        stem = next(stems)
        if record.answered:
            yield stem, curve_figure(curve, answer.checks, digits.simulated(answer.method))
    for group, indices in document.members():
        stem, shown = next(stems), [i for i in indices if records[i].answered]
        if len(shown) > 1:
            shots = [(*pairs[i], records[i]) for i in shown]
            yield stem, group_figure([(c, a.checks, r) for c, a, r in shots], group, unit)


def curve_figure(curve: RadiusCurve, checks: Checks, simulated_as: str) -> Figure:
    """One column: the measured radii, the simulation of this name, and what is left between."""
    figure = _figure(ONE, 68.0)
    upper = _axes(figure, (18.0, 25.0, 64.0, 41.0), "", "$R$ (µm)")
    lower = _axes(figure, (18.0, 10.0, 64.0, 12.0), f"time after {_RMAX} (µs)", f"residual\n(% {_RMAX})")
    time, compared = 1e6 * (curve.time - curve.time_of_max), 1e6 * (_of(checks.compared_time) - curve.time_of_max)
    simulated = 1e6 * (_of(checks.reconstruction_time) - curve.time_of_max)
    radius, inside = 1e6 * curve.radius, (time >= compared[0] - 1e-3) & (time <= compared[-1] + 1e-3)
    dots: Any = {"ls": "", "ms": 2.4, "mew": 0.5, "mfc": "none"}
    upper.plot(time[~inside], radius[~inside], "o", mec=_UNCOMPARED, **dots)
    upper.plot(time[inside], radius[inside], "o", mec="black", label="measured", **dots)
    upper.plot(simulated, 1e6 * _of(checks.reconstruction_radius), color=style.VERMILLION, lw=1.0, label=simulated_as)
    upper.legend(frameon=False, fontsize=_SMALL, handlelength=1.2, borderpad=0.0, loc="upper right")
    lower.axhline(0.0, color="black", lw=0.5)
    lower.plot(compared, 100.0 * _of(checks.residual_over_rmax), "o", mec="black", **dots)
    span = compared[-1] - compared[0]
    view = max(time[0], compared[0] - span) - 0.02 * span, min(time[-1], compared[-1] + 0.5 * span) + 0.02 * span
    upper.set(xlim=view, ylim=(0.0, 1.06 * float(np.nanmax(radius))), xticklabels=[])
    lower.set_xlim(view)
    for axes in (upper, lower):  # both names left of the widest numbers, within the page
        axes.yaxis.set_label_coords(-9.5 / 64.0, 0.5)
    return figure


def group_figure(shots: Sequence[tuple[RadiusCurve, Checks, CurveRecord]], group: GroupRecord, unit: Unit) -> Figure:
    """Two columns: all shots over each other, and their answers with the material; open marks are not trusted."""
    figure = _figure(TWO, 62.0)
    left = _axes(figure, (13.0, 11.0, 74.0, 45.0), "$t^* = t\\sqrt{p/\\rho}/R_\\mathrm{max}$", f"$R$ / {_RMAX}")
    tones = style.shades(np.linspace(0.0, 0.85, len(shots))[np.argsort(np.argsort([c.max_radius for c, *_ in shots]))])
    for (curve, checks, _), tone in zip(shots, tones, strict=True):
        if checks.time_scale:
            t_star = (curve.time - curve.time_of_max) / checks.time_scale
            left.plot(t_star, curve.radius / curve.max_radius, color=tone, lw=0.8)
    _size_key(
        figure, sorted((1e6 * curve.max_radius, tuple(tone)) for (curve, *_), tone in zip(shots, tones, strict=True))
    )
    end = max((record.window.t_star_end or 0.0 for *_, record in shots), default=0.0) or 1.0
    left.set(xlim=(-1.1, 1.1 * end), ylim=(0.0, 1.06))

    records = [record for *_, record in shots]
    known = [
        name for name in parameters_of(records) if name in ("shear_modulus", "viscosity", "viscosity_at_1e5_per_s")
    ]
    known = known or parameters_of(records)[:1]
    x_name, y_name = (known[0], known[1]) if len(known) > 1 else ("", known[0])
    (x, x_label), (y, y_label) = (_values(records, name, unit) for name in (x_name, y_name))
    right = _axes(figure, (116.0, 11.0, 56.0, 45.0), x_label, y_label)
    filled = [tone if record.trusted else "white" for tone, record in zip(tones, records, strict=True)]
    for (x0, x1, x2), (y0, y1, y2), tone, inside in zip(x, y, tones, filled, strict=True):
        bars = [[x1 - x0], [x2 - x1]], [[y1 - y0], [y2 - y1]]
        right.errorbar(x1, y1, bars[1], bars[0], "o", color=tone, mfc=inside, ms=3.5, mew=0.8, lw=0.8)
    _material(right, group, (x_name, y_name), unit)
    style.around(right, x=bool(x_name))
    for axes, letter in ((left, "a"), (right, "b")):
        axes.set_title(letter, loc="left", fontsize=_LARGE, fontweight="bold")
    return figure


def _size_key(figure: Figure, sizes: Sequence[tuple[float, Any]]) -> None:
    """Which tone is which R_max: a cell for each shot, the smallest at the bottom."""
    bar = _axes(figure, (89.0, 11.0, 2.0, 38.0), "", "")
    bar.imshow([[tone] for _, tone in sizes], aspect="auto", origin="lower")
    shown = sorted({0, len(sizes) // 2, len(sizes) - 1})
    bar.set_xticks([])
    bar.set_yticks(shown, [f"{sizes[i][0]:.0f}" for i in shown])
    bar.yaxis.tick_right()
    bar.tick_params(length=0.0)
    bar.spines[:].set_visible(False)
    bar.set_title(f"{_RMAX}\n(µm)", fontsize=_SMALL, loc="left")


def laws_figure(weighed: WeighedLaws) -> Figure:
    """One column: the log evidence of each law below that of the best, with its standard error; filled: the chosen."""
    found = {name: law for name, law in weighed.laws.items() if law.log_evidence is not None}
    ordered = sorted(found, key=lambda name: found[name].log_evidence or 0.0)
    best = max((found[name].log_evidence or 0.0 for name in ordered), default=0.0)
    shown, height = [digits.elide(name, 24) for name in ordered], 6.0 * max(len(ordered), 2)
    left = 4.0 + 1.5 * max(map(len, shown), default=8)
    figure = _figure(ONE, 14.0 + height)
    axes = _axes(figure, (left, 10.0, ONE - left - 2.0, height), "log evidence, best = 0", "")
    for row, name in enumerate(ordered):
        law, chosen = found[name], name == weighed.chosen
        error = law.standard_error or 0.0
        look: Any = {"color": "black", "mfc": "black" if chosen else "white", "ms": 4.0, "mew": 0.8, "lw": 0.8}
        axes.errorbar((law.log_evidence or 0.0) - best, row, xerr=error, fmt="o", **look)
    axes.axvline(0.0, color=_UNCOMPARED, lw=0.5, zorder=0)
    lowest = min((found[name].log_evidence or 0.0 for name in ordered), default=best) - best
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(1.8 * min(lowest, -2.0), 3.0)
    axes.set_yticks(range(len(ordered)), shown)
    axes.set_ylim(-0.6, max(len(ordered), 2) - 0.4)
    return figure


def _figure(width: float, height: float) -> Figure:
    """mm."""
    figure = style.new_figure(1.0)
    figure.set_size_inches(width / 25.4, height / 25.4)
    return figure


def _axes(figure: Figure, box: tuple[float, float, float, float], x_label: str, y_label: str) -> Axes:
    """left, bottom, width and height in mm."""
    from matplotlib.ticker import MaxNLocator

    width, height = (25.4 * side for side in figure.get_size_inches())
    axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_linewidth(0.6)
    axes.tick_params(labelsize=_SMALL, width=0.6, length=2.0, pad=2.0)
    axes.set_xlabel(x_label, fontsize=_LARGE, labelpad=2.0)
    axes.set_ylabel(y_label, fontsize=_LARGE, labelpad=3.0)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5 if box[3] > 20 else 3, steps=[1, 2, 5, 10]))
    return axes


def _values(records: Sequence[CurveRecord], name: str, unit: Unit) -> tuple[np.ndarray, str]:
    """(n, 3) lower end, median and upper end of a parameter (of R_max where there is no name), and the axis's name."""
    if not name:
        return np.repeat([[1e6 * (record.max_radius_m or np.nan)] for record in records], 3, axis=1), f"{_RMAX} (µm)"
    symbol, factor, written = in_unit(name, unit)
    found = [_ends(record.itself.quantity(name), factor) for record in records]
    return np.array(found), f"{symbol} ({written})" if written else symbol


def _ends(value: Quantity, factor: float) -> tuple[float, float, float]:
    """The median thrice where there is no interval."""
    if value.median is None:
        return np.nan, np.nan, np.nan
    low, high = (value.median if end is None else end for end in (value.q05, value.q95))
    return factor * low, factor * value.median, factor * high


def _material(axes: Axes, group: GroupRecord, along: tuple[str, str], unit: Unit) -> None:
    """The centre of the shots with its interval, and the contour of 90 % of them; else mean ± standard deviation."""
    look: Any = {"color": "black", "ms": 4.0, "lw": 1.0, "capsize": 2.0, "zorder": 3}
    factors = [in_unit(name, unit)[1] if name else 1.0 for name in along]
    centre = [group.population.centre(name) if group.population and name else Quantity() for name in along]
    if group.population and all(one.median is not None for one in centre):
        x, y = (_ends(one, factor) for one, factor in zip(centre, factors, strict=True))
        contour = group.population.contour()
        if contour is not None and along == ("shear_modulus", "viscosity"):
            axes.plot(factors[0] * contour[:, 1], contour[:, 0], "k--", lw=0.7, zorder=3, label="90 % of shots")
        bars = [[x[1] - x[0]], [x[2] - x[1]]], [[y[1] - y[0]], [y[2] - y[1]]]
        axes.errorbar(x[1], y[1], bars[1], bars[0], "D", label="material", **look)
    else:
        spreads = [group.spread(name) for name in along if name]
        if any(one.mean is None for one in spreads):
            return
        means = [
            (factor * (one.mean or 0.0), factor * (one.std or 0.0))
            for factor, one in zip(factors[-len(spreads) :], spreads, strict=True)
        ]
        if len(means) == 2:
            axes.errorbar(means[0][0], means[1][0], means[1][1], means[0][1], "D", label="mean ± std", **look)
        else:
            axes.axhline(means[0][0], color="black", lw=0.8, label="mean ± std")
            axes.axhspan(means[0][0] - means[0][1], means[0][0] + means[0][1], color="black", alpha=0.1, lw=0)
    key: Any = {"frameon": False, "fontsize": _SMALL, "ncols": 2, "borderpad": 0.0, "handlelength": 1.4}
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.01), **key)


def _of(values: Any) -> np.ndarray:
    return np.empty(0) if values is None else np.asarray(values)
