"""Pictures of the sweeps: the measured moduli, and in them what was found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.companions.panels import headed, named_curves, plain_ticks, two_panels
from cavirheo.companions.rheometer.document import Rheometry
from cavirheo.writing import digits
from cavirheo.writing.document import Outputs, spread_of
from cavirheo.writing.style import BLUE, INK, VERMILLION, save_png, write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GREEN = "#00694d"
_NARROWEST = 5.0  # highest over lowest viscosity of an axis
_PLATEAU = ("plateau G′ = {}", "plateau_storage_Pa", "Pa", "")
_LINE: Any = {"marker": "o", "ms": 3.2, "mew": 0, "lw": 0.7}
_MARK: Any = {"ls": "none", "ms": 8, "mew": 1.4, "mec": INK, "mfc": "none", "zorder": 4, "clip_on": False}


def write_pictures(outputs: Outputs, document: Rheometry) -> list[str]:
    """strain-sweep.png and frequency-sweep.png: the sweeps of each kind laid over each other; what is to be said of one
    that cannot be drawn."""
    said = outputs.picture("strain-sweep.png", save_png, _strain, document) if document.strain_sweeps else []
    frequency = "frequency-sweep.png", save_png, _frequency, document
    return said + (outputs.picture(*frequency) if document.frequency_sweeps else [])


def _strain(document: Rheometry) -> Figure:
    """Moduli over strain with the linear range shaded; below, how far G' is from its plateau."""
    sweeps, band = document.strain_sweeps, 100 * document.tolerance
    figure, upper, lower, factor = _frame(
        document.material, sweeps, "strain sweep", "strain (%)", "G′ from plateau (%)", 100.0,
        ("linear to {}", "linear_to", "%", ""), _PLATEAU, ("G′ = G″ at {}", "crossover_strain", "%", ""),
    )  # fmt: skip
    lower.axhspan(-band, band, color=BLUE, alpha=0.13, lw=0)
    lower.axhline(0.0, color=INK, lw=0.8)
    for sweep, level in zip(sweeps, _column(sweeps, "plateau_storage_Pa"), strict=True):
        lower.plot(100 * sweep.x, 100 * (sweep.storage / level - 1), color=BLUE, **_LINE)
    _mark(upper, sweeps, "D", ("crossover_strain", 100.0), ("crossover_modulus_Pa", factor))
    starts, ends = (_column(sweeps, name, 100.0) for name in ("linear_from", "linear_to"))
    if (first := np.fmax.reduce(starts)) < (last := np.fmin.reduce(ends)):
        for axes in (upper, lower):
            axes.axvspan(first, last, color=_GREEN, alpha=0.09, lw=0, zorder=0)
        several = np.count_nonzero(np.isfinite(ends)) > 1
        _along(upper, np.sqrt(first * last), "linear range of all" if several else "linear range", _GREEN)
    lower.set_ylim(-5 * band, 5 * band)
    write(lower, 1.0, 1.06, f"band: ± {band:g} %", size=8, color=INK, ha="right")
    return figure


def _frequency(document: Rheometry) -> Figure:
    """Moduli over angular frequency with the plateau of G'; below, G''/omega with the viscosity marked."""
    sweeps, at = document.frequency_sweeps, f"{document.at_rad_per_s:g} rad/s"
    figure, upper, lower, factor = _frame(
        document.material, sweeps, "frequency sweep", "angular frequency ω (rad/s)", "G″/ω (Pa s)", 1.0,
        (*_PLATEAU[:3], "no plateau of G′"), ("µ = {}", "viscosity_Pa_s", f"Pa s at {at}", f"no µ at {at}"),
        ("tan δ = {}", "tan_delta", "", ""), ("G′ = G″ at {}", "crossover_rad_per_s", "rad/s", ""),
    )  # fmt: skip
    for sweep in sweeps:
        lower.plot(sweep.x, sweep.loss / sweep.x, color=VERMILLION, **_LINE)
    plateaus = [_column(sweeps, f"plateau_{name}") for name in ("from_rad_per_s", "to_rad_per_s", "storage_Pa")]
    for start, end, level in zip(*plateaus, strict=True):
        upper.plot([start, end], [factor * level] * 2, color=BLUE, lw=6, alpha=0.2, solid_capstyle="butt", zorder=1)
    _mark(upper, sweeps, "o", ("at_rad_per_s", 1.0), ("loss_at_Pa", factor))
    _mark(lower, sweeps, "o", ("at_rad_per_s", 1.0), ("viscosity_Pa_s", 1.0))
    _mark(upper, sweeps, "D", ("crossover_rad_per_s", 1.0), ("crossover_modulus_Pa", factor))
    if np.isfinite(_column(sweeps, "viscosity_Pa_s")).any():
        for axes in (upper, lower):
            axes.axvline(document.at_rad_per_s, color=INK, lw=0.8, ls=(0, (2, 3)), zorder=0)
        _along(upper, document.at_rad_per_s, at, INK)
    lower.set_yscale("log")
    low, high = lower.get_ylim()
    widen = max(np.sqrt(_NARROWEST * low / high), 1.0)  # or noise would fill the panel
    lower.set_ylim(low / widen, high * widen)
    _ticks(lower.yaxis)
    return figure


def _frame(
    material: str, sweeps: Sequence[Any], kind: str, x: str, below: str, x_factor: float, *said: tuple[str, ...]
) -> tuple[Figure, Axes, Axes, float]:
    """(the picture with the moduli in its upper panel, its panels, the factor of moduli).

    `said` are (words, field, unit, words without a value) of the answer.
    """
    factor, unit = digits.modulus_unit([sweep.plateau_storage_Pa for sweep in sweeps])
    units, answer = {"%": (100.0, "%"), "Pa": (factor, unit)}, []
    for words, name, its, otherwise in said:
        spread, (of, named) = spread_of([getattr(sweep, name) for sweep in sweeps]), units.get(its, (1.0, its))
        shown = f"{words.format(digits.spread(spread, of))} {named}".rstrip()
        answer.append(otherwise if spread.mean is None else shown)
    figure = headed(material, kind if len(sweeps) == 1 else f"{len(sweeps)} {kind}s: mean ± std", answer)
    upper, lower = two_panels(figure, f"G′, G″ ({unit})", x, below)
    for name, colour, face, modulus in (("G′", BLUE, BLUE, "storage"), ("G″", VERMILLION, "white", "loss")):
        look: Any = {"ms": 4.0 if len(sweeps) == 1 else 3.0, "mew": 0.9, "mfc": face, "color": colour, "lw": 0.7}
        for k, sweep in enumerate(sweeps):
            y = factor * getattr(sweep, modulus)
            upper.plot(x_factor * sweep.x, y, "o-", label=None if k else name, zorder=2, **look)
    named_curves(upper, 2, columnspacing=1.2, borderaxespad=0.1)
    upper.loglog()
    lower.semilogx()
    lower.set_xlim(upper.get_xlim())
    for axis in (upper.xaxis, upper.yaxis, lower.xaxis):
        _ticks(axis)
    for axes in (upper, lower):
        axes.tick_params(which="minor", color="#bbbbbb", length=2)
    return figure, upper, lower, factor


def _column(sweeps: Sequence[Any], name: str, factor: float = 1.0) -> Floats:
    """(n,) of the sweeps, NaN where it was not found: that is not drawn."""
    return factor * np.array([getattr(sweep, name) for sweep in sweeps], dtype=float)


def _mark(axes: Axes, sweeps: Sequence[Any], marker: str, *places: tuple[str, float]) -> None:
    """A mark of each sweep at (field, factor) of x and of y."""
    axes.plot(*(_column(sweeps, name, factor) for name, factor in places), marker=marker, **_MARK)


def _along(axes: Axes, x: float, text: str, colour: str) -> None:
    """A word over the axes at x."""
    axes.text(x, 1.02, text, transform=axes.get_xaxis_transform(), fontsize=8, color=colour, ha="center", va="bottom")


def _ticks(axis: Any) -> None:
    """Powers of ten; 2 and 5 between where the axis spans less than two decades."""
    low, high = axis.get_view_interval()
    plain_ticks(axis, (1, 2, 5) if 0 < high < 100 * low else (1,), 9)
