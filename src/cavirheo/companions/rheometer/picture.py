"""Picture of the sweeps of one kind, laid over each other: the measured moduli, and in them what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cavirheo.companions.panels import headed, named_curves, plain_ticks, two_panels
from cavirheo.companions.rheometer.document import Rheometry, shown
from cavirheo.writing import digits
from cavirheo.writing.document import spread_of
from cavirheo.writing.style import BLUE, INK, VERMILLION, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NARROWEST = 5.0  # highest over lowest viscosity of an axis
_MARK: Any = {"ls": "none", "ms": 8, "mew": 1.4, "mec": INK, "mfc": "none", "zorder": 4, "clip_on": False}


def figure(document: Rheometry, kind: str) -> Figure:
    """Moduli with the range of the plateau that all have; below, how far G' is from its plateau, or G''/omega with the
    viscosity marked. What was not found is not drawn."""
    sweeps, strain, band = document.of(kind), kind == "strain", 100 * document.tolerance
    (factor, unit), scale = document.unit, 100.0 if strain else 1.0

    def found(name: str) -> np.ndarray:
        return np.array([getattr(sweep, name) for sweep in sweeps], dtype=float)

    said = [one for one in shown(document, kind) if one.words]
    means = [(one, spread_of([getattr(sweep, one.field) for sweep in sweeps])) for one in said]
    answer = [one.words.format(digits.spread(mean, one.factor)) for one, mean in means if mean.mean is not None]
    what = f"{kind} sweep" if len(sweeps) == 1 else f"{len(sweeps)} {kind} sweeps: mean ± std"
    drawing = headed(document.material, what, answer)
    labels = ("strain (%)", "G′ from plateau (%)") if strain else ("angular frequency ω (rad/s)", "G″/ω (Pa s)")
    upper, lower = two_panels(drawing, f"G′, G″ ({unit})", *labels)
    line: Any = {"ms": 4.0 if len(sweeps) == 1 else 3.0, "lw": 0.7}
    for k, (sweep, level) in enumerate(zip(sweeps, found("plateau_storage_Pa"), strict=True)):
        x, names = scale * sweep.x, [None, None] if k else ["G′", "G″"]
        upper.plot(x, factor * sweep.storage, "o-", color=BLUE, label=names[0], **line)
        upper.plot(x, factor * sweep.loss, "o-", color=VERMILLION, mfc="white", mew=0.9, label=names[1], **line)
        y, colour = (100 * (sweep.storage / level - 1), BLUE) if strain else (sweep.loss / sweep.x, VERMILLION)
        lower.plot(x, y, "o-", color=colour, **line | {"ms": 3.2})
    upper.plot(scale * found("crossover"), factor * found("crossover_modulus_Pa"), "D", **_MARK)
    named_curves(upper, 2, columnspacing=1.2, borderaxespad=0.1)
    first, last = scale * np.fmax.reduce(found("plateau_from")), scale * np.fmin.reduce(found("plateau_to"))
    if first < last:
        for axes in (upper, lower):
            axes.axvspan(first, last, color="#00694d", alpha=0.09, lw=0, zorder=0)
        words = ("linear range" if strain else "plateau") + " of all" * (len(sweeps) > 1)
        place: Any = {"transform": upper.get_xaxis_transform(), "ha": "center", "va": "bottom", "fontsize": 8}
        upper.text(np.sqrt(first * last), 1.02, words, color="#00694d", **place)
    upper.loglog()
    lower.semilogx()
    lower.set_xlim(upper.get_xlim())
    if strain:
        lower.axhspan(-band, band, color=BLUE, alpha=0.13, lw=0)
        lower.axhline(0.0, color=INK, lw=0.8)
        lower.set_ylim(-5 * band, 5 * band)
        write(lower, 1.0, 1.06, f"band: ± {band:g} %", size=8, color=INK, ha="right")
    else:
        lower.plot(found("at_rad_per_s"), found("viscosity_Pa_s"), "o", **_MARK)
        lower.set_yscale("log")
        low, high = lower.get_ylim()
        widen = max(np.sqrt(_NARROWEST * low / high), 1.0)  # or noise would fill the panel
        lower.set_ylim(low / widen, high * widen)
    for axis in (upper.xaxis, upper.yaxis, lower.xaxis, *([] if strain else [lower.yaxis])):
        low, high = axis.get_view_interval()
        plain_ticks(axis, (1, 2, 5) if 0 < high < 100 * low else (1,), 9)
    for axes in (upper, lower):
        axes.tick_params(which="minor", color="#bbbbbb", length=2)
    return drawing
