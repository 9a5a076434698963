"""Measured and model t_1/t_RC over R_max, and what is left between them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cavirheo.beside.collapse_times.document import CollapseGroup, CollapseTimes, interval
from cavirheo.beside.panels import headed, one_panel, two_panels
from cavirheo.inference.collapse_time import CollapseEstimate
from cavirheo.physics.collapse import analytic_time, rayleigh_time
from cavirheo.physics.media import Medium
from cavirheo.reporting import file_names
from cavirheo.reporting.picture import save_png
from cavirheo.writing import digits
from cavirheo.writing.style import BLUE, INK, VERMILLION, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_pictures(folder: Path, document: CollapseTimes) -> None:
    """One PNG per group that has an answer."""
    names = file_names([group.name for group in document.groups])
    medium = Medium(**document.medium)
    for group, name in zip(document.groups, names, strict=True):
        if group.best is not None:
            save_png(folder / f"{name}.png", figure(group, group.best, medium, document.modulus_unit))


def figure(group: CollapseGroup, best: CollapseEstimate, medium: Medium, unit: tuple[float, str]) -> Figure:
    """Where G and mu were found: above, t_1/t_RC of the shots and of the model, with the model's curve at the median
    lambda; below, residuals. The model is the simulation where `exact` was asked for, else the analytic one; the curve
    is always analytic. Where they were not found: the equally good pairs.
    """
    factor, name = unit
    count = f"{len(group.usable)} collapse time" + "s" * (len(group.usable) != 1)
    if best.shear_modulus_Pa.value is None:
        drawing = headed(group.name, count, ["G and µ: one relation, not both"])
        pairs = np.array(best.pairs).reshape(-1, 2) * [factor, 1.0]
        axes = one_panel(drawing, "µ (Pa s)", f"G ({name})")
        axes.plot(pairs[:, 1], pairs[:, 0], "o-", ms=4, lw=1, color=VERMILLION)
        said = "every pair on this line has the measured collapse times" if len(pairs) else "no pair gives such times"
        write(axes, 0.02, 0.93, said, size=9, color=INK)
        return drawing
    G, mu = interval(best.shear_modulus_Pa, factor), interval(best.viscosity_Pa_s)
    model_name = "exact" if group.exact else "analytic"
    drawing = headed(group.name, count, [f"G = {G} {name}", f"µ = {mu} Pa s", model_name])
    labels = (r"$t_1/t_\mathrm{RC}$", r"$R_\mathrm{max}$ (µm)", r"$t_1$ from model (%)")
    upper, lower = two_panels(drawing, *labels)
    radius, stretches = (np.array([getattr(s, k) for s in group.usable]) for k in ("max_radius_m", "stretch"))
    radius = 1e6 * radius
    measured, model = np.array(best.measured, dtype=float), np.array(best.model, dtype=float)
    upper.plot(radius, measured, "o", ms=4.5, mew=0, color=BLUE, label="measured", zorder=3)
    if np.isfinite(model).any():
        upper.plot(radius, model, "s", ms=4.2, mew=1.0, mfc="none", mec=VERMILLION, label="model", zorder=4)
        heavy = np.array(best.weight) >= 0.5
        away = 100 * (measured / model - 1)
        lower.plot(radius[heavy], away[heavy], "o", ms=4, mew=0, color=BLUE)
        lower.plot(radius[~heavy], away[~heavy], "x", ms=5, mew=1.4, color=INK)
        if not heavy.all():
            write(lower, 1.0, 1.05, "× weighted down", size=8, color=INK, ha="right")
        most = 1.15 * float(np.nanmax(np.abs(away))) or 1.0
        lower.set_ylim(-most, most)
        if best.viscosity_Pa_s.value is not None and radius.size > 1:
            across = np.geomspace(radius.min() * 0.97, radius.max() * 1.03, 200) * 1e-6
            stretch = float(np.median(stretches))
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
