"""Pictures of the answers: the measured points, the simulation of the answer over them, and what is left between."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting.record import CurveRecord, GroupRecord
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread
from cavirheo.writing.drawing import Drawing, Panel, room_for
from cavirheo.writing.style import BLUE, INK, VERMILLION, save_png, shades

__all__ = ["HEADER", "curve_picture", "group_picture", "save_png"]

KILOPASCAL = (1e-3, "kPa")
HEADER = 50.0  # points of a curve's picture: name, verdict and answer stand above
_WIDTH, _HEIGHT = 518.4, 324.0  # points
_LEFT, _WIDE = 44.0, 461.0  # of the axes
_MEASURED, _SIMULATED, _RESIDUAL, _PALE, _GREY = "#222222", VERMILLION, BLUE, "#b4b4b4", "#808080"
_RMAX = "Rₘₐₓ"


def curve_picture(
    curve: RadiusCurve, checks: Checks, record: CurveRecord, unit: tuple[float, str] = KILOPASCAL
) -> Drawing:
    """One curve and its answer; a failed one shows its measured points and the reason, and no line.

    `record` is the row of the curve, `unit` that of G: (factor from Pa, name).
    """
    page = Drawing(_WIDTH, _HEIGHT)
    look = digits.LOOKS[record.verdict]
    page.write(_LEFT, 14.5, digits.elide(record.name, 60), 11, "#111111", bold=True)
    page.write(_LEFT + _WIDE, 14.5, look.words, 10, look.colour, "end", bold=True)
    if record.answered:
        _write_answer(page, record, unit)
        _draw_answer(page, curve, checks)
    else:
        reason = textwrap.wrap(record.message, 100, max_lines=3, placeholder=" …")
        for number, line in enumerate(reason):
            page.write(_LEFT, 28.0 + 10.5 * number, line, 8.5, look.colour)
        _draw_unanswered(page, curve)
    return page


def _write_answer(page: Drawing, record: CurveRecord, unit: tuple[float, str]) -> None:
    answer = [] if record.shear_modulus_Pa.median is None else [f"G = {_with(record.shear_modulus_Pa, *unit)}"]
    answer.append(f"µ = {_with(record.viscosity_Pa_s, 1.0, 'Pa s')}")
    answer += [] if record.stretch.median is None else [f"λ = {digits.quantity(record.stretch)}"]
    answer.append(f"{_RMAX} = {digits.micrometres(record.max_radius_m)} µm")
    gap, size = 14.0, 9.5
    taken = sum(room_for(part, size) for part in answer) + gap * len(answer)
    size *= min(1.0, _WIDE / taken)  # within the axes
    page.box(_LEFT, 21.5, _WIDE, 17.5, "#f4f1ea")
    x = _LEFT + gap / 2
    for part in answer:
        page.write(x, 33.5, part, size, "#111111")
        x += room_for(part, size) + gap


def _draw_unanswered(page: Drawing, curve: RadiusCurve) -> None:
    place = (_LEFT, 62.0, _WIDE, 226.0)
    known = np.isfinite(curve.radius)
    if not known.any():
        page.write(_LEFT + _WIDE / 2, 175.0, "no measured radius", 10, anchor="middle")
        return
    x, y = _time_scale(curve), _radius_scale(curve)
    time, radius = x(curve.time), y(curve.radius)
    panel = Panel(page, place, _wider(time.min(), time.max()), (0.0, 1.05 * float(radius[known].max())))
    _points(panel, time, radius, _MEASURED, "measured")
    panel.frame(x.label, y.label)


def _draw_answer(page: Drawing, curve: RadiusCurve, checks: Checks) -> None:
    x, y = _time_scale(curve), _radius_scale(curve)
    time, radius = x(curve.time), y(curve.radius)
    compared = np.empty(0) if checks.compared_time is None else x(checks.compared_time)
    drawn = np.empty(0) if checks.reconstruction_radius is None else y(checks.reconstruction_radius)
    view = _view(time, compared)
    top = 1.05 * max(float(np.nanmax(radius)), float(np.max(drawn, initial=0.0)))
    upper = Panel(page, (_LEFT, 64.8, _WIDE, 144.2), view, (0.0, top))
    inside = np.zeros(len(time), dtype=bool)
    if len(compared):
        slack = 1e-6 * (time[-1] - time[0])
        inside = (time >= compared[0] - slack) & (time <= compared[-1] + slack)
    upper.frame("", y.label, numbers=False)
    key: list[tuple[str, str]] = []
    for which, colour, label in ((inside, _MEASURED, "measured"), (~inside, _PALE, "measured, not compared")):
        if _points(upper, time[which], radius[which], colour, label):
            key.append((colour, label))
    if checks.reconstruction_time is not None and len(drawn):
        upper.line(x(checks.reconstruction_time), drawn, _SIMULATED, 1.5, label="simulation of the answer")
        key.append((_SIMULATED, "simulation of the answer"))
    _write_key(page, key)
    if checks.time_scale is not None:
        _t_star_axis(upper, x.factor * checks.time_scale)

    rmse = None if checks.rmse_over_rmax is None else 100.0 * checks.rmse_over_rmax
    residual = np.empty(0) if checks.residual_over_rmax is None else 100.0 * checks.residual_over_rmax
    reach = 1.15 * max(float(np.max(np.abs(residual), initial=0.1)), rmse or 0.0)
    lower = Panel(page, (_LEFT, 223.6, _WIDE, 64.8), view, (-reach, reach))
    if rmse is not None:
        lower.band(-rmse, rmse, _RESIDUAL, 0.13)
        band = f"band: ± RMSE = {digits.significant(rmse, 2)} %"
        page.write(_LEFT + _WIDE, 220.0, band, 8, anchor="end")
    lower.line(np.array(view), 0.0, INK, 0.8)
    if len(residual) and len(compared):
        _points(lower, compared, residual, _RESIDUAL, "residual")
    lower.frame(x.label, f"residual (% {_RMAX})")
    if time[-1] > view[1]:
        page.write(_LEFT + _WIDE, 316.0, f"recorded until {time[-1]:.0f} µs →", 8, _GREY, "end")


def _write_key(page: Drawing, key: Sequence[tuple[str, str]]) -> None:
    """What the points and the line are, at the upper right."""
    left = _LEFT + _WIDE - 118.0
    for number, (colour, label) in enumerate(key):
        y = 72.0 + 12.0 * number
        if colour == _SIMULATED:
            page.line([(left - 6.0, y), (left + 6.0, y)], colour, 1.5)
        else:
            page.dots([(left, y)], colour, 3.6)
        page.write(left + 12.0, y + 2.8, label, 8, "#111111")


def _t_star_axis(panel: Panel, t_c: float) -> None:
    """t* in whole numbers along the top."""
    left, top, *_ = panel.place
    step = next(s for s in (1, 2, 5, 10, 20, 50, 100, 10**9) if (panel.x[1] - panel.x[0]) / t_c / s < 9)
    marks = np.arange(np.ceil(panel.x[0] / t_c / step), np.floor(panel.x[1] / t_c / step) + 1) * step
    for mark, (x, _) in zip(marks, panel.at(marks * t_c, 0.0), strict=True):
        panel.on.line([(x, top - 2.5), (x, top + 2.5)], "#aaaaaa", 1.0)
        panel.on.write(x, top - 5.0, f"{mark + 0.0:.0f}", 7.5, _GREY, "middle")
    panel.on.write(left - 4.0, top - 5.0, "t*", 7.5, _GREY, "end")


def group_picture(
    pairs: Sequence[tuple[RadiusCurve, Posterior]],
    records: Sequence[CurveRecord],
    group: GroupRecord,
    unit: tuple[float, str] = KILOPASCAL,
) -> Drawing:
    """The shots of a group laid over each other, R/R_max over t*, beside their answers and the mean ± std of these.

    `pairs` and `records` are the group's; failed ones are counted in the title, those not trusted drawn as rings.
    """
    page = Drawing(_WIDTH, 252.0)
    page.write(_LEFT, 14.0, f"{digits.elide(group.name, 56)}: {group.shots}", 11, "#111111", bold=True)
    page.write(_LEFT, 26.0, group.basis, 8.5)
    shots = [(c, p.checks, r) for (c, p), r in zip(pairs, records, strict=True) if r.answered]
    radii = np.array([1e6 * curve.max_radius for curve, _, _ in shots])
    colours = ["#{:02x}{:02x}{:02x}".format(*tone) for tone in (255 * shades(_fractions(radii))).astype(int)]
    _overlay(page, shots, colours)
    _scatter(page, [record for *_, record in shots], radii, colours, group, unit)
    if len(radii) and np.ptp(radii) > 0:
        _radius_bar(page, float(radii.min()), float(radii.max()))
    return page


def _overlay(page: Drawing, shots: Sequence[tuple[RadiusCurve, Checks, CurveRecord]], colours: Sequence[str]) -> None:
    end = max((record.window.t_star_end or 0.0 for *_, record in shots), default=0.0) or 1.0
    panel = Panel(page, (_LEFT, 36.0, 238.0, 181.0), (-1.1, 1.1 * end), (0.0, 1.06))
    for (curve, checks, record), colour in zip(shots, colours, strict=True):
        if checks.time_scale:
            t_star = (curve.time - curve.time_of_max) / checks.time_scale
            panel.line(t_star, curve.radius / curve.max_radius, colour, 1.0, 0.85, record.name)
    panel.frame(f"t* = t √(p/ρ) / {_RMAX}", f"R / {_RMAX}")


def _scatter(
    page: Drawing, records: Sequence[CurveRecord], radii: Floats, colours: Sequence[str], group: GroupRecord,
    unit: tuple[float, str],
) -> None:  # fmt: skip
    """µ over G, or over R_max where there is no G, each with its interval."""
    elastic = any(record.shear_modulus_Pa.median is not None for record in records)
    across = [_ends(record.shear_modulus_Pa, unit[0]) for record in records] if elastic else [(r, r, r) for r in radii]
    up = [_ends(record.viscosity_Pa_s, 1.0) for record in records]
    G, mu = group.shear_modulus_Pa, group.viscosity_Pa_s
    mean_x, mean_y = _ends(_mean(G), unit[0]), _ends(_mean(mu), 1.0)
    x = _around([*across, mean_x] if elastic else across, from_zero=elastic)
    panel = Panel(page, (340.0, 36.0, 127.0, 181.0), x, _around([*up, mean_y], from_zero=True))
    if not elastic and mu.std is not None:
        panel.band(mean_y[1], mean_y[2], INK, 0.12)
        panel.line(np.array(x), mean_y[0], "#000000")
    for (gx, x_low, x_high), (my, y_low, y_high), colour, record in zip(across, up, colours, records, strict=True):
        panel.line([x_low, x_high], [my, my], colour)
        panel.line([gx, gx], [y_low, y_high], colour)
        panel.dots([gx], [my], colour, 5.0, ring=not record.trusted, label=record.name)
    if mu.std is not None:
        if elastic:
            panel.line([mean_x[1], mean_x[2]], [mean_y[0]] * 2, "#000000", 1.2)
            panel.line([mean_x[0]] * 2, [mean_y[1], mean_y[2]], "#000000", 1.2)
            panel.dots([mean_x[0]], [mean_y[0]], "#000000", 4.5, label="mean ± std")
        page.line([(336.0, 28.0), (350.0, 28.0)], "#000000", 1.2)
        page.dots([(343.0, 28.0)], "#000000", 4.5)
        page.write(355.0, 31.0, "mean ± std", 8, "#111111")
    if not all(record.trusted for record in records):
        page.dots([(413.0, 28.0)], INK, 5.0, ring=True)
        page.write(420.0, 31.0, "not trusted", 8, "#111111")
    panel.frame(f"G ({unit[1]})" if elastic else f"{_RMAX} (µm)", "µ (Pa s)")


def _radius_bar(page: Drawing, low: float, high: float) -> None:
    """The key to the colours: R_max in um."""
    tones = (255 * shades(np.linspace(1.0, 0.0, 32))).astype(int)
    step = 181.0 / len(tones)
    for number, tone in enumerate(tones):
        page.box(479.5, 36.0 + step * number, 8.0, step + 0.3, "#{:02x}{:02x}{:02x}".format(*tone))
    page.write(490.0, 39.0, f"{high:.0f}", 8)
    page.write(490.0, 217.0, f"{low:.0f}", 8)
    page.write(483.5, 21.0, _RMAX, 8, anchor="middle")
    page.write(483.5, 31.0, "(µm)", 8, anchor="middle")


class _Scale(NamedTuple):
    """SI numbers -> what stands on an axis."""

    origin: float
    factor: float
    label: str

    def __call__(self, values: Floats) -> Floats:
        return (values - self.origin) * self.factor


def _time_scale(curve: RadiusCurve) -> _Scale:
    if curve.time_unscaled:
        return _Scale(0.0, 1.0, "time (no scale)")
    try:
        return _Scale(curve.time_of_max, 1e6, f"time after {_RMAX} (µs)")
    except InputError:
        return _Scale(0.0, 1e6, "time of the recording (µs)")


def _radius_scale(curve: RadiusCurve) -> _Scale:
    if curve.unscaled:
        return _Scale(0.0, 1.0 / float(np.nanmax(curve.radius, initial=1e-300)), "R / largest R")
    return _Scale(0.0, 1e6, "R (µm)")


def _view(times: Floats, compared: Floats) -> tuple[float, float]:
    """From the first frame to half a window beyond the window: a long quiet tail would squeeze what was compared."""
    first, last = float(times[0]), float(times[-1])
    if len(compared):
        last = min(last, float(compared[-1] + 0.5 * (compared[-1] - compared[0])))
        first = max(first, float(compared[0] - (compared[-1] - compared[0])))
    return _wider(first, last)


def _wider(first: float, last: float) -> tuple[float, float]:
    margin = 0.015 * (last - first) or 1.0
    return first - margin, last + margin


def _points(panel: Panel, x: Floats, y: Floats, colour: str, label: str) -> bool:
    """Whether there are any."""
    count = np.count_nonzero(np.isfinite(y))
    if count:
        panel.dots(x, y, colour, float(np.interp(count, [50, 400], [3.6, 2.0])), label=label)
    return bool(count)


def _fractions(values: Floats) -> Floats:
    return (values - values.min()) / (np.ptp(values) or 1.0) if len(values) else values


def _around(ends: Sequence[tuple[float, float, float]], *, from_zero: bool) -> tuple[float, float]:
    """A range that holds all."""
    known = np.array(ends, dtype=float).ravel()
    low, high = float(np.nanmin(known, initial=np.inf)), float(np.nanmax(known, initial=-np.inf))
    if not np.isfinite(high):
        return 0.0, 1.0
    low = 0.0 if from_zero else low
    margin = 0.1 * (high - low) or 0.1 * abs(high) or 1.0
    return (low if from_zero else low - margin), high + margin


def _with(value: Quantity, factor: float, unit: str) -> str:
    """'6.1 kPa [5.4, 6.9]'."""
    number, *interval = digits.quantity(value, factor).split(" ", 1)
    return " ".join([number, unit, *interval])


def _ends(value: Quantity, factor: float) -> tuple[float, float, float]:
    """Median and interval; the median thrice where there is none."""
    middle = np.nan if value.median is None else value.median
    low, high = (middle if end is None else end for end in (value.q05, value.q95))
    return middle * factor, low * factor, high * factor


def _mean(value: Spread) -> Quantity:
    """Mean ± std as median and interval."""
    if value.mean is None:
        return Quantity()
    std = value.std or 0.0
    return Quantity(median=value.mean, q05=value.mean - std, q95=value.mean + std)
