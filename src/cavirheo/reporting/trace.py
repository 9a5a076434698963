"""The numbers of a curve's picture, small enough for thousands in one page, whose script draws the one that is asked
for (report.js). No library is needed."""

from __future__ import annotations

import base64
import json

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.posterior import Checks
from cavirheo.reporting.picture import lines_of

MARK = "trace:"  # before them where a picture's address would stand
_POINTS = 240  # of the simulation, besides its turning points
_MOST = 2000  # frames that are shown
_WHOLE = 65535


def trace(curve: RadiusCurve, checks: Checks, simulated_as: str) -> str:
    """MARK and a JSON object; "" of a curve without a measured radius.

    x, y: ends of the axes; labels; line: what it is (`simulated_as`); measured, outside (not compared), simulated,
    residual: points (x, y) as 16-bit numbers between the ends of their axes, base64; reach of the residuals and rmse,
    in % of R_max.
    """
    if not np.isfinite(curve.radius).any():
        return ""
    lines = lines_of(curve, checks)
    left, right = lines.view
    time, radius, inside = lines.time, lines.radius, lines.inside

    def points(x: Floats, y: Floats, low: float, high: float) -> str:
        seen = np.isfinite(y) & (x >= left) & (x <= right)
        every = max(-(-int(seen.sum()) // _MOST), 1)
        ends = np.array([[left], [low]]), np.array([[right - left], [high - low]])
        scaled = (np.array([x[seen][::every], y[seen][::every]]) - ends[0]) / ends[1]
        whole = np.round(_WHOLE * np.clip(scaled, 0.0, 1.0)).astype("<u2")
        return base64.b64encode(whole.tobytes()).decode()

    thin = _thinned(lines.simulated / (right - left), lines.drawn / lines.top)
    made = {
        "x": [float(f"{end:.6g}") for end in lines.view], "y": float(f"{lines.top:.6g}"), "labels": lines.labels,
        "line": simulated_as,
        "measured": points(time[inside], radius[inside], 0.0, lines.top),
        "outside": points(time[~inside], radius[~inside], 0.0, lines.top),
        "simulated": points(lines.simulated[thin], lines.drawn[thin], 0.0, lines.top),
        "residual": points(lines.compared, lines.residual, -lines.reach, lines.reach),
        "reach": float(f"{lines.reach:.4g}"), "rmse": float(f"{lines.rmse:.4g}"),
    }  # fmt: skip
    return MARK + json.dumps(made, separators=(",", ":"))


def _thinned(x: Floats, y: Floats) -> np.ndarray:
    """Indices of points about equally far from each other along a line, and of its turns: a collapse stays sharp."""
    if len(x) <= _POINTS:
        return np.arange(len(x))
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    even = np.searchsorted(along, np.linspace(0.0, along[-1], _POINTS))
    turns = np.flatnonzero(np.diff(np.sign(np.diff(y))) != 0) + 1
    return np.union1d(np.minimum(even, len(x) - 1), turns)
