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

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.what_if import Band
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.record import Pairs, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread
from cavirheo.writing.style import BLUE, INK, VERMILLION, shades

GREEN, MEASURED, PALE = "#00875f", "#222222", "#b4b4b4"
WHAT_IF_TRACES = [0, 1]  # radius and residual of a what-if simulation: the page redraws these traces alone
_RMAX = "R<sub>max</sub>"
_TIME = f"time after {_RMAX} (µs)"
_STYLE = json.loads(Path(__file__).with_name("figure.json").read_text(encoding="utf-8"))
_GROUPS = (BLUE, VERMILLION, GREEN, "#7b4fa3", "#8a6d00", MEASURED)
_MARKS = ("square", "diamond", "triangle-up", "cross")  # of published values
_SIDES = {"upper": "triangle-left", "lower": "triangle-right"}  # of a bound of G
_UPS = {"upper": "triangle-down", "lower": "triangle-up"}  # of µ
_MOST_POINTS = 2000  # of a drawn curve


def overview(curves: Sequence[RadiusCurve], media: Sequence[Medium]) -> tuple[go.Figure, go.Figure]:
    """All curves in µs and µm, and as R/R_max over t* in the medium of each, darker where R_max is smaller; unusable
    ones are left out."""
    usable = []
    for curve, medium in zip(curves, media, strict=True):
        with suppress(InputError):
            usable.append((curve, medium, curve.max_radius))
    radii = np.array([top for *_, top in usable])
    tones = shades((radii - radii.min()) / (np.ptp(radii) or 1.0)) if usable else radii
    look = {"showlegend": False, "hovermode": "closest"}
    plain, scaled = figure_of(_TIME, "R (µm)", **look), figure_of(f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}", **look)
    for (curve, medium, top), colour in zip(usable, tones, strict=True):
        line: Any = {"color": "rgb({},{},{})".format(*(255 * colour).astype(int)), "width": 1.2}
        time, radius = _thin(*curve.normalised(medium))
        t_c = medium.time_scale(top)
        for figure, x, y in ((plain, 1e6 * t_c * time, 1e6 * top * radius), (scaled, time, radius)):
            figure.add_scatter(x=x, y=y, mode="lines+markers", line=line, marker={"size": 3}, name=curve.name)
    return plain, scaled


def filmed(
    time: Floats, radius: Floats, unit: str, flags: NDArray[np.str_], colours: Mapping[str, str], first: int, frame: int
) -> go.Figure:
    """Radii of a recording over s by the flags of its frames, those excluded as crosses; `first`: number of the first
    frame. A line marks `frame`, the number of the frame that the page shows."""
    number, figure = first + np.arange(len(time)), figure_of("time (µs)", f"R ({unit})")
    cross = {"size": 8, "symbol": "x-thin-open", "line": {"width": 2}}
    for flag in dict.fromkeys(flags.tolist()):
        some = flags == flag
        marker = {"color": colours.get(flag, PALE), **(cross if flag == "excluded" else {"size": 5})}
        figure.add_scatter(
            x=1e6 * time[some],
            y=np.nan_to_num(radius)[some],
            customdata=number[some],
            mode="markers",
            marker=marker,
            name=flag,
            hovertemplate="frame %{customdata}: %{y:.4g} " + unit,
        )
    figure.add_vline(x=1e6 * time[frame - first], line={"color": MEASURED, "width": 1.5})
    return figure


def checked(
    curve: RadiusCurve,
    answer: Checks,
    simulated_as: str,
    fit: Checks | None = None,
    what_if: dict[str, Any] | None = None,
    band: Band | None = None,
) -> go.Figure:
    """A measured curve, the simulation of its answer over it under this name, that of a conventional fit, what is left
    between, the `lines` of a what-if simulation, and the band in which the draws' simulations run."""
    figure = make_subplots(rows=2, shared_xaxes=True, row_heights=[0.68, 0.32], vertical_spacing=0.06)
    figure.layout.template, figure.layout.height = _STYLE, 520
    _lines(figure, what_if or lines(Checks("failed")), GREEN, "solid", "sliders")  # WHAT_IF_TRACES
    start = curve.time[0]
    with suppress(InputError):  # a curve without R_max is drawn from its beginning
        start = curve.time_of_max
    time, compared = curve.time - start, np.zeros(len(curve.time), dtype=bool)
    if answer.compared_time is not None and len(answer.compared_time):
        slack = 1e-9 * max(curve.time[-1] - curve.time[0], 1e-12)
        first, last = answer.compared_time[[0, -1]] - start
        compared = (time >= first - slack) & (time <= last + slack)
        figure.update_xaxes(range=[-0.05e6 * last, 1.15e6 * last])
    if band:
        x, low, high = _short(band[0], 1e6, start), _short(band[1], 1e6), _short(band[2], 1e6)
        shape: Any = {"fill": "toself", "fillcolor": "rgba(213, 94, 0, .25)", "line": {"width": 0}, "mode": "lines"}
        around: Any = {"x": [*x, *x[::-1]], "y": [*high, *low[::-1]]}
        figure.add_scatter(**around, name="90 % of the draws", hoverinfo="skip", row=1, col=1, **shape)
    measured = np.isfinite(curve.radius)
    for name, colour, some in (("measured, not compared", PALE, ~compared), ("measured", MEASURED, compared)):
        if (some := measured & some).any():
            when, radius = _thin(time[some], curve.radius[some])
            marker = {"color": colour, "size": 5}
            figure.add_scatter(x=1e6 * when, y=1e6 * radius, mode="markers", marker=marker, name=name)
    simulations = (simulated_as, VERMILLION, "solid", answer), ("least squares", BLUE, "dash", fit)
    for name, colour, dash, checks in simulations:
        if checks and checks.reconstruction_time is not None:
            _lines(figure, lines(checks, start), colour, dash, name)
    figure.update_yaxes(title_text="R (µm)", rangemode="tozero", row=1, col=1)
    figure.update_yaxes(title_text=f"residual (% {_RMAX})", row=2, col=1, zerolinecolor=INK, zeroline=True)
    figure.update_xaxes(title_text=_TIME, row=2, col=1)
    return figure


def cloud(pairs: Pairs, document: Result) -> go.Figure:
    """µ over G, as the report has it: draws and medians of all shots, coloured by group, those that are not trusted
    hollow, bounds as triangles; of each group the contour that holds 90 % of its shots, and published values. µ over
    R_max with its intervals where the law of any shot has no G. Shots without a µ are left out."""
    factor, unit = document.modulus_unit
    rows = document.curves
    viscous = [row.viscosity.median is not None for row in rows]
    elastic = all(row.shear_modulus_Pa.median is not None for row, any_ in zip(rows, viscous, strict=True) if any_)
    rated = any(row.viscosity_Pa_s.median is None for row, any_ in zip(rows, viscous, strict=True) if any_)
    along = f"G ({unit})" if elastic else f"{_RMAX} (µm)"
    up = f"µ{' at 10<sup>5</sup> 1/s' * rated} (Pa s)"
    figure = figure_of(along, up, hovermode="closest", height=420)
    for axis in (figure.update_xaxes, figure.update_yaxes):
        axis(type="log", rangemode="normal", tickformat="~g", nticks=8, automargin=True, title_standoff=12)
    for (group, members), colour in zip(document.members(), cycle(_GROUPS), strict=False):
        shots = [i for i in members if viscous[i]]
        look: dict[str, Any] = {"legendgroup": group.name, "name": digits.elide(group.name, 40)}
        contour = group.population.contour() if elastic and group.population else None
        if contour is not None:
            line = {"color": colour, "width": 2}
            y, x = contour.T
            words = look | {"name": f"90 % of shots, {look['name']}"}
            figure.add_scatter(x=factor * x, y=y, mode="lines", line=line, hoverinfo="skip", **words)
        posteriors = [pairs[i][1] for i in shots]
        both = {"log10_viscosity", "log10_shear_modulus"}
        several = [each for each in posteriors if elastic and len(each.theta) > 1 and both <= {*each.names}]
        if several:
            some = [np.random.default_rng(0).choice(len(each.theta), 80, p=each.weights) for each in several]
            x, y = (
                np.concatenate([each.draws(name)[which] for each, which in zip(several, some, strict=True)])
                for name in ("shear_modulus", "viscosity")
            )
            marker: Any = {"color": colour, "size": 3, "opacity": 0.25}
            figure.add_scatter(
                x=factor * x, y=y, mode="markers", marker=marker, hoverinfo="skip", showlegend=False, **look
            )
        if shots:
            _medians(figure, [rows[i] for i in shots], factor if elastic else None, f"{along}, {up}", colour, look)
            places = [row.viscosity.median if elastic else row.max_radius_m for row in (rows[i] for i in shots)]
            across = [(1.0 if elastic else 1e6) * (each or np.nan) for each in places]
            for mark, (method, values) in zip(cycle(_MARKS), group.published.items(), strict=False):
                marked = {"color": colour, "symbol": mark}
                _published(figure, f"{look['name']}, {method}", values, factor if elastic else None, across, marked)
    return figure


def _medians(
    figure: go.Figure, rows: Sequence[CurveRecord], factor: float | None, axes: str, colour: str, look: dict[str, Any]
) -> None:
    """A mark for each shot, over R_max with its interval where there is no factor of G; of a bound its end."""
    along = [row.shear_modulus_Pa if factor else Quantity(median=row.max_radius_m) for row in rows]
    up = [row.viscosity for row in rows]
    x, y = [(factor or 1e6) * _end(value) for value in along], [_end(value) for value in up]
    symbols = [
        (_SIDES.get(G.bound or "") or _UPS.get(mu.bound or "") or "circle") + "-open" * (not row.trusted)
        for row, G, mu in zip(rows, along, up, strict=True)
    ]
    bars: dict[str, Any] = {}
    if not factor:
        above = [(value.q95 or end) - end for value, end in zip(up, y, strict=True)]
        below = [end - (value.q05 or end) for value, end in zip(up, y, strict=True)]
        bars = {"error_y": {"array": above, "arrayminus": below, "thickness": 1, "width": 0}}
    marker = {"color": colour, "size": 9, "symbol": symbols, "line": {"color": INK, "width": 1}}
    figure.add_scatter(
        x=x,
        y=y,
        mode="markers",
        text=[row.name for row in rows],
        marker=marker,
        **look,
        **bars,
        hovertemplate="%{text}: %{x:.3g}, %{y:.3g} (" + axes + ")<extra></extra>",
    )


def _end(value: Quantity) -> float:
    """The median, or the end that is left of a bound."""
    end = {"upper": value.q95, "lower": value.q05}.get(value.bound or "", value.median)
    return np.nan if end is None or value.bound == "undetermined" else end


def _published(
    figure: go.Figure,
    name: str,
    values: Mapping[str, Spread],
    factor: float | None,
    across: Sequence[float],
    look: dict[str, Any],
) -> None:
    """µ of another method over its G; of one that has but one of them, or where there is no factor of G, a line
    `across` the shots."""
    modulus, viscosity = values.get("shear_modulus", Spread()), values.get("viscosity", Spread())
    x = None if modulus.mean is None or factor is None else factor * modulus.mean
    y, ends = viscosity.mean, [place for place in across if np.isfinite(place)]
    line = {"color": look["color"], "dash": "dot"}
    if x is not None and y is not None:
        wide = (factor or 1.0) * (modulus.std or 0.0)
        bars: dict[str, Any] = {"error_x": {"array": [wide]}, "error_y": {"array": [viscosity.std or 0.0]}}
        marker = {"size": 13, "line": {"color": INK, "width": 1.5}, **look}
        figure.add_scatter(x=[x], y=[y], mode="markers", marker=marker, name=name, **bars)
    elif ends and x is not None:
        figure.add_scatter(x=[x, x], y=[0.8 * min(ends), 1.25 * max(ends)], mode="lines", line=line, name=name)
    elif ends and y is not None and factor is None:
        figure.add_scatter(x=[0.8 * min(ends), 1.25 * max(ends)], y=[y, y], mode="lines", line=line, name=name)


def lines(checks: Checks, start: float = 0.0) -> dict[str, Any]:
    """{x, y} of a simulation and of its residual: µm and % of R_max over µs after `start` (s); empty if it failed."""
    x = [_short(checks.reconstruction_time, 1e6, start), _short(checks.compared_time, 1e6, start)]
    y = [_short(checks.reconstruction_radius, 1e6), _short(checks.residual_over_rmax, 100.0)]
    return {"x": x, "y": y}


def _lines(figure: go.Figure, simulation: dict[str, Any], colour: str, dash: str, name: str) -> None:
    for row, (x, y) in enumerate(zip(simulation["x"], simulation["y"], strict=True), 1):
        shape: Any = {"color": colour, "dash": dash, "width": 2 if row == 1 else 1.3}
        figure.add_scatter(
            x=x,
            y=y,
            mode="lines" if row == 1 else "lines+markers",
            line=shape,
            marker={"size": 3},
            name=name,
            legendgroup=name,
            showlegend=row == 1,
            row=row,
            col=1,
        )


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
