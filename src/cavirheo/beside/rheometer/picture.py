"""Pictures of the sweeps: the measured moduli, and in them what was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.beside.rheometer.read import Floats, Sweep
from cavirheo.beside.rheometer.record import Rheometry
from cavirheo.reporting.picture import save_png
from cavirheo.writing import digits
from cavirheo.writing.style import BLUE, INK, VERMILLION, new_axes, new_figure, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UPPER, _LOWER = (0.1, 0.42, 0.875, 0.4), (0.1, 0.115, 0.875, 0.22)
_GREEN = "#00694d"
_NARROWEST = 5.0  # highest over lowest viscosity of an axis


def write_pictures(folder: Path, document: Rheometry, sweeps: Sequence[Sweep]) -> None:
    """strain-sweep.png and frequency-sweep.png: the sweeps of each kind laid over each other."""
    strain = [sweep for sweep in sweeps if sweep.kind == "strain"]
    frequency = [sweep for sweep in sweeps if sweep.kind == "frequency"]
    if strain:
        save_png(folder / "strain-sweep.png", strain_figure(strain, document))
    if frequency:
        save_png(folder / "frequency-sweep.png", frequency_figure(frequency, document))


def strain_figure(sweeps: Sequence[Sweep], document: Rheometry) -> Figure:
    """Moduli over strain with the linear range shaded; below, how far G' is from its plateau."""
    found = document.strain_sweeps
    figure = new_figure(4.5)
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in found])
    answer = [
        _said("linear to {} %", [s.linear_to for s in found], 100.0),
        _said(f"plateau G′ = {{}} {unit}", [s.plateau_storage_Pa for s in found], factor),
        _said("G′ = G″ at {} %", [s.crossover_strain for s in found], 100.0),
    ]
    _head(figure, document, "strain sweep", len(sweeps), answer)
    upper = new_axes(figure, _UPPER, "", f"G′, G″ ({unit})")
    lower = new_axes(figure, _LOWER, "strain (%)", "G′ from plateau (%)")
    _moduli(upper, sweeps, 100.0, factor)
    band = 100 * document.tolerance
    lower.axhspan(-band, band, color=BLUE, alpha=0.13, lw=0)
    lower.axhline(0.0, color=INK, lw=0.8)
    for sweep, one in zip(sweeps, found, strict=True):
        if one.plateau_storage_Pa is not None:
            away = 100 * (sweep.storage / one.plateau_storage_Pa - 1)
            lower.plot(100 * sweep.x, away, "o-", ms=3.2, mew=0, lw=0.7, color=BLUE)
        if one.crossover_strain is not None and one.crossover_modulus_Pa is not None:
            _mark(upper, 100 * one.crossover_strain, factor * one.crossover_modulus_Pa, INK, "D")
    ranges = [(s.linear_from, s.linear_to) for s in found if s.linear_from is not None and s.linear_to is not None]
    first, last = 100 * max((r[0] for r in ranges), default=1), 100 * min((r[1] for r in ranges), default=0)
    if first < last:
        for axes in (upper, lower):
            axes.axvspan(first, last, color=_GREEN, alpha=0.09, lw=0, zorder=0)
        _along(upper, np.sqrt(first * last), "linear range" + (" of all" if len(ranges) > 1 else ""), _GREEN)
    _logarithmic(lower, upper)
    lower.set_ylim(-5 * band, 5 * band)
    write(lower, 1.0, 1.06, f"band: ± {band:g} %", size=8, color=INK, ha="right")
    return figure


def frequency_figure(sweeps: Sequence[Sweep], document: Rheometry) -> Figure:
    """Moduli over angular frequency with the plateau of G'; below, G''/omega with the viscosity marked."""
    found = document.frequency_sweeps
    figure = new_figure(4.5)
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in found])
    at = f"{document.at_rad_per_s:g} rad/s"
    answer = [
        _said(f"plateau G′ = {{}} {unit}", [s.plateau_storage_Pa for s in found], factor) or "no plateau of G′",
        _said(f"µ = {{}} Pa s at {at}", [s.viscosity_Pa_s for s in found]) or f"no µ at {at}",
        _said("tan δ = {}", [s.tan_delta for s in found]),
        _said("G′ = G″ at {} rad/s", [s.crossover_rad_per_s for s in found]),
    ]
    _head(figure, document, "frequency sweep", len(sweeps), answer)
    upper = new_axes(figure, _UPPER, "", f"G′, G″ ({unit})")
    lower = new_axes(figure, _LOWER, "angular frequency ω (rad/s)", "G″/ω (Pa s)")
    _moduli(upper, sweeps, 1.0, factor)
    for sweep, one in zip(sweeps, found, strict=True):
        lower.plot(sweep.x, sweep.loss / sweep.x, "o-", ms=3.2, mew=0, lw=0.7, color=VERMILLION)
        start, end, level = one.plateau_from_rad_per_s, one.plateau_to_rad_per_s, one.plateau_storage_Pa
        if start is not None and end is not None and level is not None:
            upper.plot([start, end], [factor * level] * 2, color=BLUE, lw=6, alpha=0.2, solid_capstyle="butt", zorder=1)
        if one.viscosity_Pa_s is not None and one.loss_at_Pa is not None:
            _mark(upper, one.at_rad_per_s, factor * one.loss_at_Pa, INK, "o")
            _mark(lower, one.at_rad_per_s, one.viscosity_Pa_s, INK, "o")
        if one.crossover_rad_per_s is not None and one.crossover_modulus_Pa is not None:
            _mark(upper, one.crossover_rad_per_s, factor * one.crossover_modulus_Pa, INK, "D")
    if any(one.viscosity_Pa_s is not None for one in found):
        for axes in (upper, lower):
            axes.axvline(document.at_rad_per_s, color=INK, lw=0.8, ls=(0, (2, 3)), zorder=0)
        _along(upper, document.at_rad_per_s, at, INK)
    _logarithmic(lower, upper)
    lower.set_yscale("log")
    low, high = lower.get_ylim()
    widen = max(np.sqrt(_NARROWEST * low / high), 1.0)  # or noise would fill the panel
    lower.set_ylim(low / widen, high * widen)
    _plain_ticks(lower.yaxis)
    return figure


def _head(figure: Figure, document: Rheometry, kind: str, n: int, answer: Sequence[str]) -> None:
    write(figure, 0.1, 0.955, digits.elide(document.material, 50), size=11, weight="bold")
    title = kind if n == 1 else f"{n} {kind}s: mean ± std"
    write(figure, 0.975, 0.955, title, size=10, weight="bold", ha="right", color=INK)
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#f4f1ea", "edgecolor": "none"}
    write(figure, 0.111, 0.898, "\u2003\u2002".join(filter(None, answer)), size=9.0, bbox=box)


def _said(text: str, values: Sequence[float | None], factor: float = 1.0) -> str:
    """The mean ± std in words; empty where there is no value."""
    from cavirheo.writing.document import spread_of

    spread = spread_of(list(values))
    return "" if spread.mean is None else text.format(digits.spread(spread, factor))


def _moduli(axes: Axes, sweeps: Sequence[Sweep], x_factor: float, factor: float) -> None:
    modulus: Callable[[Sweep], Floats]
    size = 4.0 if len(sweeps) == 1 else 3.0
    for name, colour, face, modulus in (
        ("G′", BLUE, BLUE, lambda sweep: sweep.storage),
        ("G″", VERMILLION, "white", lambda sweep: sweep.loss),
    ):
        look: Any = {"ms": size, "mew": 0.9, "mec": colour, "mfc": face, "color": colour, "lw": 0.7, "zorder": 2}
        for k, sweep in enumerate(sweeps):
            axes.plot(x_factor * sweep.x, factor * modulus(sweep), "o-", label=None if k else name, **look)
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.985), "ncols": 2, "columnspacing": 1.2}
    axes.legend(fontsize=8.5, frameon=False, handlelength=1.6, borderaxespad=0.1, **place)


def _mark(axes: Axes, x: float, y: float, colour: str, symbol: str) -> None:
    axes.plot(x, y, symbol, ms=8, mew=1.4, mec=colour, mfc="none", zorder=4, clip_on=False)


def _along(axes: Axes, x: float, text: str, colour: str) -> None:
    """A word over the axes at x."""
    axes.text(x, 1.02, text, transform=axes.get_xaxis_transform(), fontsize=8, color=colour, ha="center", va="bottom")


def _logarithmic(lower: Axes, upper: Axes) -> None:
    upper.set_yscale("log")
    _plain_ticks(upper.yaxis)
    for axes in (upper, lower):
        axes.set_xscale("log")
        _plain_ticks(axes.xaxis)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)
    for axes in (upper, lower):
        axes.tick_params(which="minor", color="#bbbbbb", length=2)


def _plain_ticks(axis) -> None:  # type: ignore[no-untyped-def]  # matplotlib is imported late
    """0.01, 1, 100 instead of powers; 2 and 5 between where the axis spans less than two decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = low > 0 and high < 100 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
