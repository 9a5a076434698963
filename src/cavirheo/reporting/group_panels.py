"""What the picture of a group shows: its shots over each other, their answers, and what these say of the material."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.parameters import AT_RATE
from cavirheo.physics.media import Medium
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit, parameters_of
from cavirheo.reporting.curve_panels import RMAX, Axis, Layer, Panel
from cavirheo.reporting.group import CONSTANTS, GroupRecord
from cavirheo.reporting.record import Pairs
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread

FAR = 3.0  # largest over smallest, above which axes begin at zero
_SIZE = "R_max"  # in place of a parameter's name
Shot = tuple[RadiusCurve, Checks, CurveRecord]
Mark = tuple[str, str, Floats | None, Floats]  # look, name, and (3,) lower end, value and upper end along both axes


def shots_of(pairs: Pairs, rows: Sequence[CurveRecord], indices: Sequence[int]) -> list[Shot]:
    """Those of these curves that were answered."""
    return [(pairs[i][0], pairs[i][1].checks, rows[i]) for i in indices if rows[i].has_answer]


def group_panels(shots: Sequence[Shot], group: GroupRecord, unit: Unit) -> list[Panel]:
    """The shots of a group that were answered, R/R_max over t*, darker where R_max is smaller; then one or two panels
    of a parameter over another, or over R_max. unit: that of moduli."""
    records = [record for *_, record in shots]
    names = parameters_of(records)
    upper = next((name for name in CONSTANTS if name in names), names[0])
    lower = ["shear_modulus"] if "shear_modulus" in names and upper != "shear_modulus" else []
    all_elastic = lower and all(record.shear_modulus_Pa.median is not None for record in records)
    lower += [] if all_elastic and upper not in group.slopes else [_SIZE]
    curves, t_c = [curve for curve, *_ in shots], [checks.time_scale or np.nan for _, checks, _ in shots]
    tones = _tones(np.array([curve.max_radius for curve in curves]))
    end = max((record.window.t_star_end or 0.0 for record in records), default=0.0) or 1.0
    answers = [_answers(records, group, unit, upper, across, tones) for across in lower]
    return [_overlay(curves, t_c, 1.1 * end, scaled=True), *answers]


def overview_panels(curves: Sequence[RadiusCurve], media: Sequence[Medium]) -> list[Panel]:
    """All curves in µs and µm, and as R/R_max over t* in the medium of each; unusable ones are left out."""
    usable = []
    for curve, medium in zip(curves, media, strict=True):
        with suppress(InputError):
            usable.append((curve, medium.time_scale(curve.max_radius)))
    if not usable:
        return []
    shots, units = zip(*usable, strict=True)
    return [_overlay(shots, [1e-6] * len(shots), scaled=False), _overlay(shots, units, scaled=True)]


def _overlay(curves: Sequence[RadiusCurve], units: Sequence[float], end: float = np.inf, *, scaled: bool) -> Panel:
    """The curves over each other, darker where R_max is smaller. units: of the time of each curve, s. scaled: radii
    over R_max (else µm), and times (t*) from shortly before R_max to `end`."""
    sizes = np.array([curve.max_radius for curve in curves])
    layers = []
    for curve, unit, size, tone in zip(curves, units, sizes, _tones(sizes), strict=True):
        time = (curve.time - curve.time_of_max) / unit
        some = (time >= -1.1) & (time <= end) if scaled else np.isfinite(time)
        radius = curve.radius[some] / (size if scaled else 1e-6)
        layers.append(Layer("line", "shot", time[some], radius, tones=tone[None]))
    times = np.concatenate([layer.x for layer in layers])
    radii = np.concatenate([layer.y for layer in layers])
    low, high = (-1.1 if scaled else times.min(), end if np.isfinite(end) else times.max(initial=1.0))
    smallest, largest = 1e6 * sizes.min(), 1e6 * sizes.max()
    key = f"{RMAX} {smallest:.0f} µm" + f" (dark) to {largest:.0f} µm (light)" * bool(np.ptp(sizes))
    labels = (f"t* = t √(p/ρ) / {RMAX}", f"R / {RMAX}") if scaled else (f"time after {RMAX} (µs)", "R (µm)")
    top = 1.06 * float(np.nanmax(radii, initial=0.0)) or 1.06
    return Panel(Axis(labels[0], float(low), float(high)), Axis(labels[1], 0.0, top), tuple(layers), note=key)


def _tones(sizes: Floats) -> Floats:
    return (sizes - sizes.min()) / (np.ptp(sizes) or 1.0)


def _answers(
    records: Sequence[CurveRecord], group: GroupRecord, unit: Unit, upper: str, across: str, tones: Floats
) -> Panel:
    """Rings are answers that do not count."""
    x, mean_x, x_label = _along(across, records, group, unit)
    y, mean_y, y_label = _along(upper, records, group, unit)
    trusted = np.array([record.trusted for record in records])
    finite = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    over_size, material = across == _SIZE, group.material
    layers = [
        Layer("bars", "interval", x[finite], y[finite], tones=tones[finite]),
        Layer("dots", "estimate", x[finite, 1], y[finite, 1], tones=tones[finite]),
        Layer("dots", "ring", x[finite & ~trusted, 1], y[finite & ~trusted, 1], "does not count"),
    ]
    marks: list[Mark] = []
    if over_size and (slope := group.slopes.get(upper)):
        power, some = slope.median or 0.0, (y[:, 1] > 0) & (trusted | (slope.n_trusted < slope.n))
        level = np.median(np.log(y[some, 1]) - power * np.log(x[some, 1]))
        line = np.linspace(x[:, 1].min(), x[:, 1].max(), 60)
        layers.append(Layer("line", "centre", line, np.exp(level) * line**power, f"{RMAX}^{slope.words}"))
    elif (across, upper) == ("shear_modulus", "viscosity") and material and (contour := material.contour()) is not None:
        of_modulus = in_unit("shear_modulus", unit)[1]
        layers.append(Layer("line", "contour", of_modulus * contour[:, 1], contour[:, 0], "90 % of shots"))
        centre = _ends([material.value(across)], of_modulus)[0], _ends([material.value(upper)])[0]
        marks.append(("centre", "material", *centre))
    elif mean_y is not None and group.value(upper).std is not None and (over_size or mean_x is not None):
        marks.append(("centre", "mean ± std", None if over_size else mean_x, mean_y))
    if not (over_size and group.shear_modulus_Pa.mean is not None):  # once
        for method, values in group.published.items():
            of_x, of_y = (_mean(values.get(name, Spread()), in_unit(name, unit)[1]) for name in (across, upper))
            if of_y is not None and (over_size or of_x is not None):
                marks.append(("published", digits.elide(method, 14), of_x, of_y))
    layers += [Layer("bars", look, x[None], y[None], name) for look, name, x, y in marks if x is not None]
    ends = ([x, *(layer.x for layer in layers)], [y, *(layer.y for layer in layers), *(y for *_, y in marks)])
    axes = Axis(x_label, *_around(ends[0], close=over_size)), Axis(y_label, *_around(ends[1]))
    width = np.array([axes[0].low, axes[0].high])
    for look, name, place, (low, middle, high) in marks:
        if place is None:
            layers.append(Layer("line", look, width, np.full(2, middle), name))
            layers.append(Layer("band", f"{look}-range", width, np.array([low, high])))
    return Panel(*axes, tuple(layer for layer in layers if len(layer.x)))


def _along(
    name: str, records: Sequence[CurveRecord], group: GroupRecord, unit: Unit
) -> tuple[Floats, Floats | None, str]:
    """(n, 3) of a parameter or of R_max, (3,) of the group's mean, and the axis's label."""
    if name == _SIZE:
        radii = [1e6 * (record.max_radius_m or np.nan) for record in records]
        return np.column_stack([radii] * 3), None, f"{RMAX} (µm)"
    symbol, factor, written = in_unit(name, unit)
    viscous = name in ("viscosity", AT_RATE)
    values = _ends([record.viscosity if viscous else record.value(name) for record in records], factor)
    return values, _mean(group.value(name), factor), f"{symbol} ({written})" if written else symbol


def _mean(value: Spread, factor: float) -> Floats | None:
    if value.mean is None:
        return None
    return factor * (value.mean + (value.std or 0.0) * np.array([-1.0, 0.0, 1.0]))


def _ends(values: Sequence[Quantity], factor: float = 1.0) -> Floats:
    """(n, 3) lower end, median and upper end; the median thrice where there is no interval."""
    ends = factor * np.array([(value.q05, value.median, value.q95) for value in values], dtype=float).reshape(-1, 3)
    return np.where(np.isnan(ends), ends[:, 1:2], ends)


def _around(parts: Sequence[Floats], *, close: bool = False) -> tuple[float, float]:
    """Limits about all of these positive numbers: from zero where the smallest is far below the largest, else close, so
    that what differs by little lies apart. close: in any case."""
    numbers = np.concatenate([np.ravel(part) for part in parts])
    numbers = numbers[np.isfinite(numbers)]
    if not len(numbers) or numbers.max() <= 0.0:
        return 0.0, 1.0
    low, high = float(numbers.min()), float(numbers.max())
    begin = 0.0 if low < high / FAR and not close else low
    margin = 0.1 * (high - begin) or 0.1 * high
    return max(begin - margin, 0.0), high + margin
