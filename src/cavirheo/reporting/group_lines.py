"""What the picture of a group shows: its shots over each other, their answers, and what these say of the material."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cavirheo.arrays import Bools, Floats
from cavirheo.curve import RadiusCurve
from cavirheo.parameters import AT_RATE
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord, Unit, in_unit, parameters_of
from cavirheo.reporting.curve_lines import RMAX, Axis
from cavirheo.reporting.group import CONSTANTS, GroupRecord
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity, Spread

FAR = 3.0  # largest over smallest, above which axes begin at zero
_SIZE = "R_max"  # in place of a parameter's name
Shot = tuple[RadiusCurve, Checks, CurveRecord]


@dataclass(frozen=True, eq=False)
class ShotLine:
    """One shot.

    Attributes:
        name: of the curve.
        size: 0 of the smallest R_max of the group to 1 of the largest.
        t_star: (n,) its time after R_max over t_c.
        radius: (n,) R/R_max.
    """

    name: str
    size: float
    t_star: Floats
    radius: Floats


@dataclass(frozen=True, eq=False)
class Mark:
    """A value with its interval, or one number alone.

    Attributes:
        name: what it is the value of: "material", "mean ± std", a method's name.
        x: (3,) lower end, value and upper end; None where it has no value along `x`.
        y: (3,).
        published: whether another method says so.
    """

    name: str
    x: Floats | None
    y: Floats
    published: bool = False


@dataclass(frozen=True, eq=False)
class AnswerPoints:
    """The answers of the shots: one parameter over another, or over R_max.

    Attributes:
        x: the lower axis.
        y: the upper one.
        across: (n, 3) lower end, median and upper end of each shot along `x`.
        up: (n, 3) along `y`.
        contour: (k, 2) that holds 90 % of the shots of the material; empty where it is not known.
        marks: the material or the mean, then published values.
        slope: (k, 2) the power law of R_max; empty where there is none.
        slope_words: "Rₘₐₓ^0.4 [0.1, 0.7]".
    """

    x: Axis
    y: Axis
    across: Floats
    up: Floats
    contour: Floats
    marks: tuple[Mark, ...]
    slope: Floats
    slope_words: str


@dataclass(frozen=True, eq=False)
class GroupLines:
    """The lines and points of one group.

    Attributes:
        title: "soft: 5 shots, 1 failed".
        said: which models the answers are of, and how many shots count.
        shots: those that were answered.
        trusted: (n,) which of them count.
        smallest: R_max of the smallest, µm.
        largest: R_max of the largest, µm.
        x: t*.
        y: R/R_max.
        answers: one or two panels.
    """

    title: str
    said: str
    shots: tuple[ShotLine, ...]
    trusted: Bools
    smallest: float
    largest: float
    x: Axis
    y: Axis
    answers: tuple[AnswerPoints, ...]


def group_lines(shots: Sequence[Shot], group: GroupRecord, unit: Unit) -> GroupLines:
    """The lines of a group; `shots` are those that were answered. unit: that of moduli."""
    records = [record for *_, record in shots]
    names = parameters_of(records)
    upper = next((name for name in CONSTANTS if name in names), names[0])
    beside = ["shear_modulus"] if "shear_modulus" in names and upper != "shear_modulus" else []
    all_elastic = beside and all(record.shear_modulus_Pa.median is not None for record in records)
    beside += [] if all_elastic and upper not in group.slopes else [_SIZE]
    radii = 1e6 * np.array([curve.max_radius for curve, *_ in shots])
    sizes = (radii - radii.min()) / (np.ptp(radii) or 1.0)
    end = max((record.window.t_star_end or 0.0 for record in records), default=0.0) or 1.0
    x = Axis(f"t* = t √(p/ρ) / {RMAX}", -1.1, 1.1 * end)
    lines = []
    for (curve, checks, record), size in zip(shots, sizes, strict=True):
        t_star = (curve.time - curve.time_of_max) / (checks.time_scale or np.nan)
        seen = (t_star >= x.low) & (t_star <= x.high)
        lines.append(ShotLine(record.name, float(size), t_star[seen], curve.radius[seen] / curve.max_radius))
    models = dict.fromkeys(record.itself.in_words for record in records)
    return GroupLines(
        title=f"{digits.elide(group.name, 32)}: {group.shots}",
        said=digits.elide("; ".join(filter(None, [*models, group.basis])), 90),
        shots=tuple(lines),
        trusted=np.array([record.trusted for record in records]),
        smallest=float(radii.min()),
        largest=float(radii.max()),
        x=x,
        y=Axis(f"R / {RMAX}", 0.0, 1.06),
        answers=tuple(_answers(records, group, unit, upper, across) for across in beside),
    )


def _answers(records: Sequence[CurveRecord], group: GroupRecord, unit: Unit, upper: str, across: str) -> AnswerPoints:
    x, mean_x, x_label = _along(across, records, group, unit)
    y, mean_y, y_label = _along(upper, records, group, unit)
    over_size, contour, slope, words = across == _SIZE, np.empty((0, 2)), np.empty((0, 2)), ""
    marks = []
    if over_size and (found := group.slopes.get(upper)):
        known = (y[:, 1] > 0) & [record.trusted or found.n_trusted < found.n for record in records]
        level = np.median(np.log(y[known, 1]) - (found.median or 0.0) * np.log(x[known, 1]))
        line = np.linspace(x[:, 1].min(), x[:, 1].max(), 60)
        slope = np.column_stack([line, np.exp(level) * line ** (found.median or 0.0)])
        words = f"{RMAX}^{found.words}"
    elif material := _material(group, unit, across, upper):
        contour, mark = material
        marks.append(mark)
    elif mean_y is not None and group.spread(upper).std is not None and (over_size or mean_x is not None):
        marks.append(Mark("mean ± std", None if over_size else mean_x, mean_y))
    if not (over_size and group.shear_modulus_Pa.mean is not None):  # once
        marks += _published(group, unit, across, upper)
    ends_x = [x, contour[:, 0], *(mark.x for mark in marks if mark.x is not None)]
    ends_y = [y, contour[:, 1], slope[:, 1], *(mark.y for mark in marks)]
    axes = Axis(x_label, *_around(ends_x, close=over_size)), Axis(y_label, *_around(ends_y))
    return AnswerPoints(*axes, x, y, contour, tuple(marks), slope, words)


def _material(group: GroupRecord, unit: Unit, across: str, upper: str) -> tuple[Floats, Mark] | None:
    """The contour of the shots, and the centre with its interval."""
    contour = group.population.contour() if group.population else None
    if group.population is None or contour is None or (across, upper) != ("shear_modulus", "viscosity"):
        return None
    factor = in_unit(across, unit)[1]
    x, y = (_ends([group.population.centre(name)], by)[0] for name, by in ((across, factor), (upper, 1.0)))
    return np.column_stack([factor * contour[:, 1], contour[:, 0]]), Mark("material", x, y)


def _published(group: GroupRecord, unit: Unit, across: str, upper: str) -> list[Mark]:
    """Mean ± std of each method that has what the axes show."""
    marks = []
    for method, values in group.published.items():
        ends = [_mean(values.get(name, Spread()), in_unit(name, unit)[1]) for name in (across, upper) if name != _SIZE]
        if all(one is not None for one in ends):
            x = ends[0] if len(ends) == 2 else None
            marks.append(Mark(digits.elide(method, 14), x, ends[-1], published=True))  # type: ignore[arg-type]
    return marks


def _along(
    name: str, records: Sequence[CurveRecord], group: GroupRecord, unit: Unit
) -> tuple[Floats, Floats | None, str]:
    """(n, 3) of a parameter or of R_max, (3,) of the group's mean, and the axis's label."""
    if name == _SIZE:
        radii = [1e6 * (record.max_radius_m or np.nan) for record in records]
        return np.column_stack([radii] * 3), None, f"{RMAX} (µm)"
    symbol, factor, written = in_unit(name, unit)
    viscous = name in ("viscosity", AT_RATE)
    values = _ends([one.viscosity if viscous else one.itself.quantity(name) for one in records], factor)
    return values, _mean(group.spread(name), factor), f"{symbol} ({written})" if written else symbol


def _mean(value: Spread, factor: float) -> Floats | None:
    if value.mean is None:
        return None
    return factor * (value.mean + (value.std or 0.0) * np.array([-1.0, 0.0, 1.0]))


def _ends(values: Sequence[Quantity], factor: float = 1.0) -> Floats:
    """(n, 3) lower end, median and upper end; the median thrice where there is no interval."""
    known = factor * np.array([(one.q05, one.median, one.q95) for one in values], dtype=float).reshape(-1, 3)
    return np.where(np.isnan(known), known[:, 1:2], known)


def _around(parts: Sequence[Floats], *, close: bool = False) -> tuple[float, float]:
    """Limits about all of these positive numbers: from zero where the smallest is far below the largest, else close, so
    that what differs by little lies apart. close: in any case."""
    known = np.concatenate([np.ravel(part) for part in parts])
    known = known[np.isfinite(known)]
    if not len(known) or known.max() <= 0.0:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    begin = 0.0 if low < high / FAR and not close else low
    margin = 0.1 * (high - begin) or 0.1 * high
    return max(begin - margin, 0.0), high + margin
