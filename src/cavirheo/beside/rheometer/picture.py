"""Pictures of the sweeps: the measured moduli, and in them what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.beside.panels import headed, two_panels
from cavirheo.beside.rheometer.document import Rheometry
from cavirheo.beside.rheometer.sweeps import FrequencySweep, StrainSweep
from cavirheo.reporting.picture import save_png
from cavirheo.writing import digits
from cavirheo.writing.document import spread_of
from cavirheo.writing.style import BLUE, INK, VERMILLION, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREEN = "#00694d"
_NARROWEST = 5.0  # highest over lowest viscosity of an axis
_LINE: Any = {"marker": "o", "ms": 3.2, "mew": 0, "lw": 0.7}
_MARK: Any = {"ls": "none", "ms": 8, "mew": 1.4, "mec": INK, "mfc": "none", "zorder": 4, "clip_on": False}


def write_pictures(folder: Path, document: Rheometry) -> None:
    """strain-sweep.png and frequency-sweep.png: the sweeps of each kind laid over each other."""
    if document.strain_sweeps:
        save_png(folder / "strain-sweep.png", strain_figure(document))
    if document.frequency_sweeps:
        save_png(folder / "frequency-sweep.png", frequency_figure(document))


def strain_figure(document: Rheometry) -> Figure:
    """Moduli over strain with the linear range shaded; below, how far G' is from its plateau."""
    sweeps = document.strain_sweeps
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in sweeps])
    answer = [
        _said(sweeps, "linear to {} %", "linear_to", 100.0),
        _said(sweeps, f"plateau G′ = {{}} {unit}", "plateau_storage_Pa", factor),
        _said(sweeps, "G′ = G″ at {} %", "crossover_strain", 100.0),
    ]
    figure = headed(document.material, _title("strain sweep", len(sweeps)), answer)
    upper, lower = two_panels(figure, f"G′, G″ ({unit})", "strain (%)", "G′ from plateau (%)")
    _moduli(upper, sweeps, 100.0, factor)
    band = 100 * document.tolerance
    lower.axhspan(-band, band, color=BLUE, alpha=0.13, lw=0)
    lower.axhline(0.0, color=INK, lw=0.8)
    for sweep, level in zip(sweeps, _column(sweeps, "plateau_storage_Pa"), strict=True):
        lower.plot(100 * sweep.data.x, 100 * (sweep.data.storage / level - 1), color=BLUE, **_LINE)
    crossover = (100 * _column(sweeps, "crossover_strain"), factor * _column(sweeps, "crossover_modulus_Pa"))
    upper.plot(*crossover, marker="D", **_MARK)
    starts, ends = (100 * _column(sweeps, name) for name in ("linear_from", "linear_to"))
    if (first := np.fmax.reduce(starts)) < (last := np.fmin.reduce(ends)):
        for axes in (upper, lower):
            axes.axvspan(first, last, color=_GREEN, alpha=0.09, lw=0, zorder=0)
        words = "linear range of all" if np.count_nonzero(np.isfinite(ends)) > 1 else "linear range"
        _along(upper, np.sqrt(first * last), words, _GREEN)
    _logarithmic(lower, upper)
    lower.set_ylim(-5 * band, 5 * band)
    write(lower, 1.0, 1.06, f"band: ± {band:g} %", size=8, color=INK, ha="right")
    return figure


def frequency_figure(document: Rheometry) -> Figure:
    """Moduli over angular frequency with the plateau of G'; below, G''/omega with the viscosity marked."""
    sweeps = document.frequency_sweeps
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in sweeps])
    at = f"{document.at_rad_per_s:g} rad/s"
    answer = [
        _said(sweeps, f"plateau G′ = {{}} {unit}", "plateau_storage_Pa", factor) or "no plateau of G′",
        _said(sweeps, f"µ = {{}} Pa s at {at}", "viscosity_Pa_s") or f"no µ at {at}",
        _said(sweeps, "tan δ = {}", "tan_delta"),
        _said(sweeps, "G′ = G″ at {} rad/s", "crossover_rad_per_s"),
    ]
    figure = headed(document.material, _title("frequency sweep", len(sweeps)), answer)
    upper, lower = two_panels(figure, f"G′, G″ ({unit})", "angular frequency ω (rad/s)", "G″/ω (Pa s)")
    _moduli(upper, sweeps, 1.0, factor)
    for sweep in sweeps:
        lower.plot(sweep.data.x, sweep.data.loss / sweep.data.x, color=VERMILLION, **_LINE)
    plateaus = [_column(sweeps, f"plateau_{name}") for name in ("from_rad_per_s", "to_rad_per_s", "storage_Pa")]
    for start, end, level in zip(*plateaus, strict=True):
        upper.plot([start, end], [factor * level] * 2, color=BLUE, lw=6, alpha=0.2, solid_capstyle="butt", zorder=1)
    there, viscosities = _column(sweeps, "at_rad_per_s"), _column(sweeps, "viscosity_Pa_s")
    upper.plot(there, factor * _column(sweeps, "loss_at_Pa"), marker="o", **_MARK)
    lower.plot(there, viscosities, marker="o", **_MARK)
    crossover = (_column(sweeps, "crossover_rad_per_s"), factor * _column(sweeps, "crossover_modulus_Pa"))
    upper.plot(*crossover, marker="D", **_MARK)
    if np.isfinite(viscosities).any():
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


_Sweeps = Sequence[StrainSweep] | Sequence[FrequencySweep]


def _title(kind: str, n: int) -> str:
    return kind if n == 1 else f"{n} {kind}s: mean ± std"


def _column(sweeps: _Sweeps, name: str) -> np.ndarray:
    """(n,) of the sweeps, NaN where it was not found: that is not drawn."""
    return np.array([getattr(sweep, name) for sweep in sweeps], dtype=float)


def _said(sweeps: _Sweeps, text: str, name: str, factor: float = 1.0) -> str:
    """The mean ± std in words; empty where there is no value."""
    spread = spread_of([getattr(sweep, name) for sweep in sweeps])
    return "" if spread.mean is None else text.format(digits.spread(spread, factor))


def _moduli(axes: Axes, sweeps: _Sweeps, x_factor: float, factor: float) -> None:
    for name, colour, face, modulus in (("G′", BLUE, BLUE, "storage"), ("G″", VERMILLION, "white", "loss")):
        look: Any = {"ms": 4.0 if len(sweeps) == 1 else 3.0, "mew": 0.9, "mfc": face, "color": colour, "lw": 0.7}
        for k, sweep in enumerate(sweeps):
            y = factor * getattr(sweep.data, modulus)
            axes.plot(x_factor * sweep.data.x, y, "o-", label=None if k else name, zorder=2, **look)
    place: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.985), "ncols": 2, "columnspacing": 1.2}
    axes.legend(fontsize=8.5, frameon=False, handlelength=1.6, borderaxespad=0.1, **place)


def _along(axes: Axes, x: float, text: str, colour: str) -> None:
    """A word over the axes at x."""
    axes.text(x, 1.02, text, transform=axes.get_xaxis_transform(), fontsize=8, color=colour, ha="center", va="bottom")


def _logarithmic(lower: Axes, upper: Axes) -> None:
    upper.set_yscale("log")
    _plain_ticks(upper.yaxis)
    for axes in (upper, lower):
        axes.set_xscale("log")
        _plain_ticks(axes.xaxis)
        axes.tick_params(which="minor", color="#bbbbbb", length=2)
    lower.set_xlim(upper.get_xlim())
    upper.tick_params(labelbottom=False)


def _plain_ticks(axis: Any) -> None:
    """0.01, 1, 100 instead of powers; 2 and 5 between where the axis spans less than two decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    few = low > 0 and high < 100 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=9))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
