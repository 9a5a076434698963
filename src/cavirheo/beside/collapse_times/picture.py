"""Measured and model t_1/t_RC over R_max, and what is left between them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cavirheo.beside.collapse_times.record import CollapseTimes, Fit, GroupRecord
from cavirheo.beside.collapse_times.table import interval
from cavirheo.inference.collapse_time import Estimate
from cavirheo.physics.collapse import analytic_time, rayleigh_time
from cavirheo.physics.media import Medium
from cavirheo.reporting import file_names
from cavirheo.reporting.picture import save_png
from cavirheo.writing import digits
from cavirheo.writing.style import BLUE, INK, VERMILLION, new_axes, new_figure, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WHOLE = (0.1, 0.115, 0.875, 0.72)
_UPPER, _LOWER = (0.1, 0.41, 0.875, 0.41), (0.1, 0.115, 0.875, 0.22)


def write_pictures(folder: Path, document: CollapseTimes, estimates: list[Estimate | None], medium: Medium) -> None:
    """One PNG per group that has an answer; `estimates` are the analytic ones."""
    names = file_names([group.name for group in document.groups])
    unit = document.modulus_unit
    for group, estimate, name in zip(document.groups, estimates, names, strict=True):
        if estimate is not None:
            save_png(folder / f"{name}.png", figure(group, estimate, medium, unit))


def figure(group: GroupRecord, estimate: Estimate, medium: Medium, unit: tuple[float, str]) -> Figure:
    """Where G and mu were found: above, t_1/t_RC of the shots and of the model, with the model's curve at the median
    lambda; below, residuals. The model is the simulation where `exact` was asked for, else the analytic one; the curve
    is always analytic. Where they were not found: the equally good pairs.
    """
    drawing = new_figure(4.5)
    best = group.exact or group.analytic
    assert best is not None
    write(drawing, 0.1, 0.955, digits.elide(group.name, 50), size=11, weight="bold")
    write(drawing, 0.975, 0.955, _count(len(estimate.shots)), size=10, weight="bold", ha="right", color=INK)
    box = {"boxstyle": "round,pad=0.45", "facecolor": "#f4f1ea", "edgecolor": "none"}
    write(drawing, 0.111, 0.892, _said(best, unit, "exact" if group.exact else "analytic"), size=9.0, bbox=box)
    if best.shear_modulus_Pa.value is None:
        pairs = np.array(best.pairs).reshape(-1, 2) * [unit[0], 1.0]
        axes = new_axes(drawing, _WHOLE, "µ (Pa s)", f"G ({unit[1]})")
        axes.plot(pairs[:, 1], pairs[:, 0], "o-", ms=4, lw=1, color=VERMILLION)
        said = "every pair on this line has the measured collapse times" if len(pairs) else "no pair gives such times"
        write(axes, 0.02, 0.93, said, size=9, color=INK)
        return drawing
    upper = new_axes(drawing, _UPPER, "", r"$t_1/t_\mathrm{RC}$")
    lower = new_axes(drawing, _LOWER, r"$R_\mathrm{max}$ (µm)", r"$t_1$ from model (%)")
    radius = 1e6 * estimate.shots.max_radius
    shots = [shot for shot in group.shots if not shot.message]
    model = np.array([np.nan if x is None else x for x in (s.exact if group.exact else s.analytic for s in shots)])
    upper.plot(radius, estimate.measured, "o", ms=4.5, mew=0, color=BLUE, label="measured", zorder=3)
    if np.isfinite(model).any():
        upper.plot(radius, model, "s", ms=4.2, mew=1.0, mfc="none", mec=VERMILLION, label="model", zorder=4)
        heavy = estimate.weight >= 0.5
        away = 100 * (estimate.measured / model - 1)
        lower.plot(radius[heavy], away[heavy], "o", ms=4, mew=0, color=BLUE)
        lower.plot(radius[~heavy], away[~heavy], "x", ms=5, mew=1.4, color=INK)
        if not heavy.all():
            write(lower, 1.0, 1.05, "× weighted down", size=8, color=INK, ha="right")
        most = 1.15 * float(np.nanmax(np.abs(away))) or 1.0
        lower.set_ylim(-most, most)
        if best.viscosity_Pa_s.value is not None and radius.size > 1:
            across = np.geomspace(radius.min() * 0.97, radius.max() * 1.03, 200) * 1e-6
            stretch = float(np.median(estimate.shots.stretch))
            times = analytic_time(across, stretch, best.shear_modulus_Pa.value, best.viscosity_Pa_s.value, medium)
            times = times / rayleigh_time(across, medium)
            label = f"analytic, λ = {digits.significant(stretch, 2)}"
            upper.plot(1e6 * across, np.where(np.isfinite(times), times, np.nan), lw=1, color=VERMILLION, label=label)
    lower.axhline(0.0, color=INK, lw=0.8)
    upper.axhline(1.0, color=INK, lw=0.8, ls=(0, (2, 3)), zorder=0)
    margin = 0.02 * max(float(np.ptp(radius)), 10.0)
    for axes in (upper, lower):
        axes.set_xlim(radius.min() - 2 * margin, radius.max() + 2 * margin)
    upper.tick_params(labelbottom=False)
    upper.legend(loc="lower right", bbox_to_anchor=(1.0, 0.985), ncols=3, fontsize=8.5, frameon=False, handlelength=1.6)
    return drawing


def _count(n: int) -> str:
    return f"{n} collapse time" + ("" if n == 1 else "s")


def _said(fit: Fit, unit: tuple[float, str], model: str) -> str:
    factor, name = unit
    if fit.shear_modulus_Pa.value is None:
        return "G and µ: one relation, not both"
    words = [f"G = {interval(fit.shear_modulus_Pa, factor)} {name}", f"µ = {interval(fit.viscosity_Pa_s)} Pa s", model]
    return "\u2003\u2002".join(words)
