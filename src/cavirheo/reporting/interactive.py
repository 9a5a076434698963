"""Interactive figures of curves, of what is compared, and of answers, for pages in a browser; colours as everywhere.

Needs plotly, which comes with the extra [app].
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.reconstruct import Window
from cavirheo.inference.trial import Band
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Spread
from cavirheo.writing.style import BLUE, INK, VERMILLION, shades

GREEN, MEASURED, PALE = "#00875f", "#222222", "#b4b4b4"
TRIAL = [0, 1]  # places of the trial's line and of its residual among the traces: `steps.trial` redraws these alone
_RMAX = "R<sub>max</sub>"
_TIME = f"time after {_RMAX} (µs)"
_STYLE = json.loads(Path(__file__).with_name("figure.json").read_text(encoding="utf-8"))
_GROUPS = (BLUE, VERMILLION, GREEN, "#7b4fa3", "#8a6d00", MEASURED)
_MARKS = ("square", "diamond", "triangle-up", "cross")  # of published values
_MOST_POINTS = 2000  # of a drawn curve


def overview(curves: Sequence[RadiusCurve], medium: Medium) -> tuple[go.Figure, go.Figure]:
    """All curves in µs and µm, and as R/R_max over t*, darker where R_max is smaller; unusable ones are left out."""
    usable = []
    for curve in curves:
        with suppress(InputError):
            usable.append((curve, curve.max_radius))
    radii = np.array([top for _, top in usable])
    tones = shades((radii - radii.min()) / (np.ptp(radii) or 1.0)) if usable else radii
    look = {"showlegend": False, "hovermode": "closest"}
    plain, scaled = figure_of(_TIME, "R (µm)", **look), figure_of(f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}", **look)
    for (curve, top), colour in zip(usable, tones, strict=True):
        line: Any = {"color": "rgb({},{},{})".format(*(255 * colour).astype(int)), "width": 1.2}
        time, radius = _thin(*curve.normalised(medium))
        t_c = medium.time_scale(top)
        for figure, x, y in ((plain, 1e6 * t_c * time, 1e6 * top * radius), (scaled, time, radius)):
            figure.add_scatter(x=x, y=y, mode="lines+markers", line=line, marker={"size": 3}, name=curve.name)
    return plain, scaled


def filmed(
    time: Floats, radius: Floats, unit: str, flags: NDArray[np.str_], colours: Mapping[str, str], first: int, shown: int
) -> go.Figure:
    """Radii of a recording over s by the flags of its frames, those excluded as crosses; `first`: number of the first
    frame; that which is shown is marked."""
    number, figure = first + np.arange(len(time)), figure_of("time (µs)", f"R ({unit})")
    cross = {"size": 8, "symbol": "x-thin-open", "line": {"width": 2}}
    for flag in dict.fromkeys(flags.tolist()):
        some = flags == flag
        marker = {"color": colours.get(flag, PALE), **(cross if flag == "excluded" else {"size": 5})}
        figure.add_scatter(
            x=1e6 * time[some], y=np.nan_to_num(radius)[some], customdata=number[some], mode="markers", marker=marker,
            name=flag, hovertemplate="frame %{customdata}: %{y:.4g} " + unit,
        )  # fmt: skip
    figure.add_vline(x=1e6 * time[shown - first], line={"color": MEASURED, "width": 1.5})
    return figure


def prepared(curve: RadiusCurve, seen: Window) -> go.Figure:
    """The frames of a curve, and those that are compared (`seen`)."""
    figure = figure_of(_TIME, "R (µm)")
    view = seen.curve
    _measured(figure, curve, (curve.time >= view.time[0]) & (curve.time <= view.time[-1]))
    spikes = np.isin(np.arange(len(curve.time)), curve.spikes())
    _dots(figure, curve, spikes, "stands out, kept", VERMILLION, 11, symbol="circle-open", line={"width": 2})
    _dots(figure, curve, np.isnan(curve.radius), "no radius", VERMILLION, 8, symbol="line-ns-open")
    begin, end = 1e6 * (curve.time[0] - curve.time_of_max), 1e6 * (view.time[-1] - curve.time_of_max)
    figure.update_xaxes(range=[max(begin, -0.5 * end), 1.25 * end])
    return figure


def checked(
    curve: RadiusCurve, answer: Checks, simulated_as: str, fit: Checks | None = None,
    trial: dict[str, Any] | None = None, band: Band | None = None,
) -> go.Figure:  # fmt: skip
    """A measured curve, the simulation of its answer over it under this name, that of a conventional fit, what is left
    between, a trial's `lines`, and the band in which the draws' simulations run."""
    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=[0.68, 0.32], vertical_spacing=0.06)
    figure.layout.template, figure.layout.height = _STYLE, 520
    _lines(figure, trial or lines(Checks("failed")), GREEN, "solid", "sliders")  # TRIAL
    inside = np.zeros(len(curve.time), dtype=bool)
    if answer.compared_time is not None and len(answer.compared_time):
        slack = 1e-9 * max(curve.time[-1] - curve.time[0], 1e-12)
        first, last = answer.compared_time[[0, -1]]
        inside = (curve.time >= first - slack) & (curve.time <= last + slack)
        reach = 1e6 * (last - curve.time_of_max)
        figure.update_xaxes(range=[-0.05 * reach, 1.15 * reach])
    if band:
        x, low, high = _short(band[0], 1e6, curve.time_of_max), _short(band[1], 1e6), _short(band[2], 1e6)
        shape: Any = {"fill": "toself", "fillcolor": "rgba(213, 94, 0, .25)", "line": {"width": 0}, "mode": "lines"}
        x, y = [*x, *x[::-1]], [*high, *low[::-1]]
        figure.add_scatter(x=x, y=y, name="90 % of the draws", hoverinfo="skip", row=1, col=1, **shape)
    _measured(figure, curve, inside)
    drawn = (simulated_as, VERMILLION, "solid", answer), ("least squares", BLUE, "dash", fit)
    for name, colour, dash, checks in drawn:
        if checks and checks.reconstruction_time is not None:
            _lines(figure, lines(checks, curve.time_of_max), colour, dash, name)
    figure.update_yaxes(title_text="R (µm)", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title_text=f"residual (% {_RMAX})", row=2, col=1, zerolinecolor=INK, zeroline=True)
    figure.update_xaxes(title_text=_TIME, row=2, col=1)
    return figure


def cloud(pairs: Pairs, document: Result) -> go.Figure:
    """G over mu: draws and medians of all shots, coloured by group, those that are not trusted hollow; of each group
    the contour that holds 90 % of its shots, and published values. Answers without G or mu are left out."""
    factor, unit = document.modulus_unit
    figure = figure_of("µ (Pa s)", f"G ({unit})", hovermode="closest", height=420)
    for axis in (figure.update_xaxes, figure.update_yaxes):
        axis(type="log", rangemode="normal", tickformat="~g", nticks=8)
    for (group, members), colour in zip(document.members(), cycle(_GROUPS), strict=False):
        shots = [i for i in members if {"log10_shear_modulus", "log10_viscosity"} <= {*pairs[i][1].names}]
        look: dict[str, Any] = {"legendgroup": group.name, "name": digits.elide(group.name, 40)}
        contour = group.population.contour() if group.population else None
        if contour is not None:
            line = {"color": colour, "width": 2}
            x, y = contour.T
            words = look | {"name": f"90 % of shots, {look['name']}"}
            figure.add_scatter(x=x, y=factor * y, mode="lines", line=line, hoverinfo="skip", **words)
        drawn = [pairs[i][1] for i in shots]
        several = [one for one in drawn if len(one.theta) > 1]
        if several:
            rows = [np.random.default_rng(0).choice(len(one.theta), 80, p=one.weights) for one in several]
            x, y = (
                np.concatenate([one.draws(name)[some] for one, some in zip(several, rows, strict=True)])
                for name in ("viscosity", "shear_modulus")
            )
            marker: Any = {"color": colour, "size": 3, "opacity": 0.25}
            figure.add_scatter(
                x=x, y=factor * y, mode="markers", marker=marker, hoverinfo="skip", showlegend=False, **look
            )  # fmt: skip
        if drawn:
            symbols = ["circle" if document.curves[i].trusted else "circle-open" for i in shots]
            x, y = ([one.median(name) for one in drawn] for name in ("viscosity", "shear_modulus"))
            names = [document.curves[i].name for i in shots]
            figure.add_scatter(
                x=x, y=[factor * (one or np.nan) for one in y], mode="markers", text=names,
                marker={"color": colour, "size": 9, "symbol": symbols, "line": {"color": INK, "width": 1}}, **look,
                hovertemplate="%{text}: G %{y:.3g} " + unit + ", µ %{x:.3g} Pa s<extra></extra>",
            )  # fmt: skip
            for mark, (method, values) in zip(cycle(_MARKS), group.published.items(), strict=False):
                _published(figure, f"{look['name']}, {method}", values, factor, x, {"color": colour, "symbol": mark})
    return figure


def _published(
    figure: go.Figure, name: str, values: Mapping[str, Spread], factor: float, across: Sequence[float | None],
    look: dict[str, Any],
) -> None:  # fmt: skip
    """G over mu of another method; of one that has no mu a line `across` the shots."""
    modulus, viscosity = values.get("shear_modulus", Spread()), values.get("viscosity", Spread())
    if modulus.mean is None:
        return
    y, up = factor * modulus.mean, factor * (modulus.std or 0.0)
    if viscosity.mean is None:
        ends = [one for one in across if one]
        line = {"color": look["color"], "dash": "dot"}
        figure.add_scatter(x=[0.8 * min(ends), 1.25 * max(ends)], y=[y, y], mode="lines", line=line, name=name)
        return
    bars: dict[str, Any] = {"error_x": {"array": [viscosity.std or 0.0]}, "error_y": {"array": [up]}}
    marker = {"size": 13, "line": {"color": INK, "width": 1.5}, **look}
    figure.add_scatter(x=[viscosity.mean], y=[y], mode="markers", marker=marker, name=name, **bars)


def lines(found: Checks, start: float = 0.0) -> dict[str, Any]:
    """{x, y} of a simulation and of its residual: µm and % of R_max over µs after `start` (s); empty if it failed."""
    x = [_short(found.reconstruction_time, 1e6, start), _short(found.compared_time, 1e6, start)]
    y = [_short(found.reconstruction_radius, 1e6), _short(found.residual_over_rmax, 100.0)]
    return {"x": x, "y": y}


def _measured(figure: go.Figure, curve: RadiusCurve, inside: Bools) -> None:
    """The frames of a curve that have a radius, those `inside` what is compared darker."""
    measured = np.isfinite(curve.radius)
    _dots(figure, curve, measured & ~inside, "measured, not compared", PALE)
    _dots(figure, curve, measured & inside, "measured", MEASURED)


def _dots(
    figure: go.Figure, curve: RadiusCurve, which: Bools, name: str, colour: str, size: int = 5, **look: Any
) -> None:
    """Frames of a curve, those without a radius at zero."""
    if which.any():
        start = curve.time[0]
        with suppress(InputError):  # a curve without R_max is drawn from its beginning
            start = curve.time_of_max
        time, radius = _thin(curve.time[which] - start, np.nan_to_num(curve.radius[which]))
        marker = {"color": colour, "size": size, **look}
        figure.add_scatter(x=1e6 * time, y=1e6 * radius, mode="markers", marker=marker, name=name)


def _lines(figure: go.Figure, drawn: dict[str, Any], colour: str, dash: str, name: str) -> None:
    for row, (x, y) in enumerate(zip(drawn["x"], drawn["y"], strict=True), 1):
        shape: Any = {"color": colour, "dash": dash, "width": 2 if row == 1 else 1.3}
        figure.add_scatter(
            x=x, y=y, mode="lines" if row == 1 else "lines+markers", line=shape, marker={"size": 3}, name=name,
            legendgroup=name, showlegend=row == 1, row=row, col=1,
        )  # fmt: skip


def figure_of(x: str, y: str, **look: Any) -> go.Figure:
    """Empty, with these titles of its axes."""
    figure = go.Figure(layout={"template": _STYLE, "height": 340, **look})
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(title_text=y, rangemode="tozero")
    return figure


def _short(values: Floats | None, scale: float, start: float = 0.0) -> list[float]:
    """Five digits: finer than any screen."""
    return [] if values is None else [float(f"{value:.5g}") for value in scale * (values - start)]


def _thin(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Every k-th point, where there are more than can be told apart."""
    every = -(-len(x) // _MOST_POINTS) or 1
    return x[::every], y[::every]
