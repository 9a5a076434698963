"""Interactive figures of curves, of what a network reads, and of answers over measurements; colours as everywhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cavirheo.curve import Floats, RadiusCurve
from cavirheo.errors import InputError
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks, Posterior
from cavirheo.writing.style import BLUE, INK, VERMILLION, shades

GREEN, MEASURED, PALE = "#00875f", "#222222", "#b4b4b4"
TRIAL = [0, 1]  # places of the trial's line and of its residual among the traces: `steps.trial` redraws these alone
_RMAX = "R<sub>max</sub>"
_NOT_OFFERED = ["select2d", "lasso2d", "autoScale2d", "toImage", "zoomIn2d", "zoomOut2d"]
_MOST_POINTS = 2000  # of a drawn curve

Answer = tuple[str, str, str, Checks]  # name, colour, dash, what was found


def overview(curves: Sequence[RadiusCurve], medium: Medium) -> tuple[go.Figure, go.Figure]:
    """All curves in µs and µm, and as R/R_max over t*, darker where R_max is smaller; unusable ones are left out."""
    usable = [(curve, top) for curve in curves if (top := _max_radius(curve)) is not None]
    radii = np.array([top for _, top in usable])
    tones = shades((radii - radii.min()) / (np.ptp(radii) or 1.0)) if usable else radii
    plain = _figure(f"time after {_RMAX} (µs)", "R (µm)")
    scaled = _figure(f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}")
    for (curve, top), colour in zip(usable, tones, strict=True):
        line: Any = {"color": "rgb({},{},{})".format(*(255 * colour).astype(int)), "width": 1.2}
        measured = np.isfinite(curve.radius)
        time, radius = _thin(curve.time[measured] - curve.time_of_max, curve.radius[measured])
        for figure, x, y in (
            (plain, 1e6 * time, 1e6 * radius),
            (scaled, time / medium.time_scale(top), radius / top),
        ):
            figure.add_scatter(x=x, y=y, mode="lines+markers", line=line, marker={"size": 3}, name=curve.name)
    for figure in (plain, scaled):
        figure.update_layout(showlegend=False, hovermode="closest")
    return plain, scaled


def prepared(curve: RadiusCurve, view: RadiusCurve, step: float, grid: Floats) -> go.Figure:
    """The frames of a curve, those that are compared (`view`), and the grid that the network reads, every `step` s."""
    figure = _figure(f"time after {_RMAX} (µs)", "R (µm)")
    start = curve.time_of_max
    inside = (curve.time >= view.time[0]) & (curve.time <= view.time[-1])
    spikes = np.zeros(len(curve.time), dtype=bool)
    spikes[curve.spikes()] = True
    missing = np.isnan(curve.radius)
    for name, which, marker in (
        ("measured, not compared", ~inside, {"color": PALE, "size": 5}),
        ("measured", inside, {"color": MEASURED, "size": 5}),
        ("stands out, kept", spikes, {"color": VERMILLION, "size": 11, "symbol": "circle-open", "line": {"width": 2}}),
    ):
        if np.any(which & ~missing):
            time, radius = _thin(curve.time[which] - start, curve.radius[which])
            figure.add_scatter(x=1e6 * time, y=1e6 * radius, mode="markers", marker=marker, name=name)
    if missing.any():
        time, _ = _thin(curve.time[missing] - start, curve.radius[missing])
        marker = {"color": VERMILLION, "size": 8, "symbol": "line-ns-open"}
        figure.add_scatter(x=1e6 * time, y=np.zeros(len(time)), mode="markers", marker=marker, name="no radius")
    read = np.isfinite(grid)
    line: Any = {"color": BLUE, "width": 1.6}
    figure.add_scatter(
        x=1e6 * step * np.flatnonzero(read), y=1e6 * grid[read], mode="lines+markers", line=line,
        marker={"size": 3}, name="read by the network",
    )  # fmt: skip
    end = 1e6 * max(step * len(grid), view.time[-1] - start)
    figure.update_xaxes(range=[max(1e6 * (curve.time[0] - start), -0.5 * end), 1.25 * end])
    return figure


def checked(curve: RadiusCurve, answers: Sequence[Answer], trial: dict[str, Any] | None = None) -> go.Figure:
    """A measured curve, the simulations of its answers over it, what is left between, and the trial (`steps.trial`)."""
    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=[0.68, 0.32], vertical_spacing=0.06)
    _dress(figure)
    start = curve.time_of_max
    x, y = (trial[axis] if trial else ([], []) for axis in ("x", "y"))
    for row in (1, 2):  # TRIAL
        _line(figure, row, x[row - 1], y[row - 1], GREEN, "solid", "sliders")
    compared = answers[0][3].compared_time if answers else None
    inside = np.zeros(len(curve.time), dtype=bool)
    if compared is not None and len(compared):
        slack = 1e-9 * max(curve.time[-1] - curve.time[0], 1e-12)
        inside = (curve.time >= compared[0] - slack) & (curve.time <= compared[-1] + slack)
        reach = compared[-1] - start
        figure.update_xaxes(range=[-0.05e6 * reach, 1.15e6 * reach])
    for name, which, colour in (("measured, not compared", ~inside, PALE), ("measured", inside, MEASURED)):
        if np.any(which & np.isfinite(curve.radius)):
            time, radius = _thin(curve.time[which] - start, curve.radius[which])
            marker = {"color": colour, "size": 5}
            figure.add_scatter(x=1e6 * time, y=1e6 * radius, mode="markers", marker=marker, name=name, row=1, col=1)
    for name, colour, dash, checks in answers:
        if checks.reconstruction_time is None or checks.reconstruction_radius is None:
            continue
        drawn = 1e6 * (checks.reconstruction_time - start), 1e6 * checks.reconstruction_radius
        _line(figure, 1, *drawn, colour, dash, name)
        if checks.compared_time is not None and checks.residual_over_rmax is not None:
            _line(figure, 2, 1e6 * (checks.compared_time - start), 100 * checks.residual_over_rmax, colour, dash, name)
    figure.update_yaxes(title_text="R (µm)", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title_text=f"residual (% {_RMAX})", row=2, col=1, zerolinecolor=INK, zeroline=True)
    figure.update_xaxes(title_text=f"time after {_RMAX} (µs)", row=2, col=1)
    figure.update_layout(height=520)
    return figure


def of(posterior: Posterior, name: str, colour: str, dash: str = "solid") -> Answer:
    return name, colour, dash, posterior.checks


def _line(figure: go.Figure, row: int, x: Any, y: Any, colour: str, dash: str, name: str) -> None:
    shape: Any = {"color": colour, "dash": dash, "width": 2 if row == 1 else 1.3}
    figure.add_scatter(
        x=x, y=y, mode="lines" if row == 1 else "lines+markers", line=shape, marker={"size": 3}, name=name,
        legendgroup=name, showlegend=row == 1, row=row, col=1,
    )  # fmt: skip


def _figure(x: str, y: str) -> go.Figure:
    figure = go.Figure()
    _dress(figure)
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(title_text=y, rangemode="tozero")
    figure.update_layout(height=340)
    return figure


def _dress(figure: go.Figure) -> None:
    figure.update_layout(
        template="none",
        font={"family": "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif", "size": 12, "color": INK},
        margin={"l": 56, "r": 12, "t": 34, "b": 46},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0, "font": {"size": 11}},
        hovermode="x unified",
        hoverlabel={"namelength": 28},
        modebar={"orientation": "v", "remove": _NOT_OFFERED},
        uirevision="keep",
    )
    axis: Any = {
        "showline": True, "linecolor": "#888888", "gridcolor": "#eceef1", "zeroline": False, "ticks": "outside",
        "tickcolor": "#888888", "ticklen": 4, "hoverformat": ".4g",
    }  # fmt: skip
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis, title_standoff=6)


def _thin(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Every k-th point, where there are more than can be told apart."""
    every = -(-len(x) // _MOST_POINTS) or 1
    return x[::every], y[::every]


def _max_radius(curve: RadiusCurve) -> float | None:
    try:
        return curve.max_radius
    except InputError:
        return None
