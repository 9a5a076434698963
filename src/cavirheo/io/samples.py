"""Samples as a file gives them -> one RadiusCurve; everything that is done to them is counted in its notes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io.formats import LENGTH_UNITS, TIME_UNITS
from cavirheo.messages import Message

RADIUS_UNITS = {**LENGTH_UNITS, "px": 1e-6}  # px: a stand-in until R_max is given
_PLAUSIBLE = (5e-6, 5e-3)  # m; the largest radius read as m, mm and um falls in here for one of them at most
_ABSURD = 1e9  # in any unit; larger numbers are damage and would overflow later
_SAME_TIME = 1e-15  # s; closer frames are one, told apart by rounding only
_NO_BUBBLE = 1e-9  # m; smaller numbers are what an empty frame leaves behind (denormals in one published file)


def check_units(where: str, time: str | None, radius: str | None, radius_std: str | None) -> None:
    """Raises InputError: a unit is that of another quantity, or radii and their deviations are in two units."""
    fine = time in (None, *TIME_UNITS) and radius in (None, *RADIUS_UNITS)
    message = f"{where} gives time in {time} and radius in {radius}; expected units of time and of length"
    require(fine, message, "table.units")
    message = f"radius is in {radius} but radius_std in {radius_std}; give both in one unit"
    require(radius_std in (None, radius), message, "table.units")


def unusable(reason: str, meta: Mapping[str, Any], **fields: Any) -> RadiusCurve:
    """A curve without samples that says why. fields: its other fields."""
    return RadiusCurve(np.empty(0), np.empty(0), meta={**meta, "notes": (reason,)}, **fields, unusable=reason)


def make_curve(
    time: ArrayLike,
    radius: ArrayLike,
    radius_std: ArrayLike | None = None,
    time_unit: str | None = None,
    radius_unit: str | None = None,
    meta: Mapping[str, Any] | None = None,
    **fields: Any,
) -> RadiusCurve:
    """Clean one curve: (n,) times and radii (and their deviations) in the given units; None = tell from the size.

    Frames with NaN or absurd (1e9) radius are NaN; radii <= 0 become NaN; frames without a time are left out; frames
    are sorted by time; frames of one time are averaged. Each is counted in the notes, after those in `meta`; times out
    of order are among the curve's `warnings` too. A unit that the size contradicts is no scale. fields: other fields of
    the curve.

    Raises InputError: no unit of time is given and it cannot be told.
    """
    t, r = (np.asarray(a, dtype=np.float64).ravel() for a in (time, radius))
    std = np.full(r.shape, np.nan) if radius_std is None else np.asarray(radius_std, dtype=np.float64).ravel()
    meta = dict(meta or {})
    if len(t) != len(r) or len(std) != len(r):
        return unusable(f"{len(t)} times but {len(r)} radii", meta, **fields)
    timed = np.abs(t) < _ABSURD
    t, r, std = t[timed], np.where(np.abs(r) < _ABSURD, r, np.nan)[timed], std[timed]
    n, missing = len(t), np.count_nonzero(np.isnan(r))
    per_time, time_hint = _time_scale(t, time_unit)
    per_radius, radius_hint, unscaled = _radius_scale(_largest(r), radius_unit)
    t, r, std = t * per_time, r * per_radius, std * per_radius
    empty = r < _NO_BUBBLE
    r[empty], std[~(std > 0)] = np.nan, np.nan
    backwards = np.count_nonzero(np.diff(t) < 0)
    order = np.argsort(t, kind="stable")
    first = np.flatnonzero(np.diff(t[order], prepend=-np.inf) > _SAME_TIME)
    t, r, std = t[order][first], _averaged(r[order], first), _averaged(std[order], first)
    warnings = (Message("check_input.time_order", {"steps": int(backwards)}),) if backwards else ()
    remarks = {
        f"{len(timed) - n} of {len(timed)} frames without a time left out": n < len(timed),
        time_hint: time_hint,
        radius_hint: radius_hint,
        f"{missing} of {n} frames without a radius (NaN)": missing,
        f"{empty.sum()} frames with radius <= 0 marked as not measured": empty.any(),
        **{warning.text: True for warning in warnings},
        f"{n - len(t)} frames repeat a time: the radii of one time averaged": len(t) < n,
        unscaled: unscaled,
    }
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) > 1 else 0.0
    if step and np.mean(np.abs(steps - step) < 0.01 * step) > 0.5:
        meta.setdefault("frame_rate_hz", 1.0 / step)
    meta["notes"] = (*meta.get("notes", ()), *(remark for remark, applies in remarks.items() if applies))
    if hints := (*meta.pop("hints", ()), *filter(None, (time_hint, radius_hint))):
        meta["hints"] = hints
    try:
        return RadiusCurve(t, r, std, meta, **{"unscaled": unscaled, **fields}, warnings=warnings)
    except InputError as error:  # of no bubble: the others of its file are answered
        return unusable(str(error), meta, **fields)


def _averaged(values: Floats, first: NDArray[np.intp]) -> Floats:
    """The mean of what is known of each run of values that begins at one of the indices `first`."""
    finite = np.isfinite(values)
    count = np.add.reduceat(finite.astype(int), first)
    total = np.add.reduceat(np.where(finite, values, 0.0), first)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _largest(r: Floats) -> float:
    """The largest radius but for two frames, which may be wrong ones."""
    finite = np.sort(r[np.isfinite(r)])
    return float(finite[-3] if len(finite) >= 5 else finite.max(initial=0.0))


def _radius_scale(largest: float, unit: str | None) -> tuple[float, str, str]:
    """(metres per number, a note, why there is no scale) from the largest radius and the unit given, if any."""
    if unit == "px":
        return RADIUS_UNITS["px"], "", f"the radius is in pixels (largest {largest:.4g}) without um per pixel"
    fits = [u for u in ("m", "mm", "um") if _PLAUSIBLE[0] <= largest * RADIUS_UNITS[u] <= _PLAUSIBLE[1]]
    if largest <= 0.0 or unit in fits:
        return RADIUS_UNITS[unit or "um"], "", ""
    words = f"the radius is given in {unit}" if unit else "no unit is given for the radius"
    if 0.8 < largest < 1.25:  # rather R/R_max than a bubble of 1 mm
        return 1e-6, "", f"{words}, but its largest value {largest:.4g} looks like R/R_max"
    if unit or not fits:
        only = f"; it only makes sense in {fits[0]}" if fits else ""
        return 1e-4 / largest, "", f"{words}; its largest value {largest:.4g} is no bubble of 5 um to 5 mm{only}"
    return RADIUS_UNITS[fits[0]], f"{words}: taken as {fits[0]} from its size", ""


def _time_scale(t: Floats, unit: str | None) -> tuple[float, str]:
    """(seconds per number, a note). Recordings of collapsing bubbles last 1 us to 5 ms: such spans are s or us."""
    if unit:
        return TIME_UNITS[unit], ""
    span = float(np.ptp(t)) if len(t) else 0.0
    if len(t) < 2 or 5e-7 <= span <= 5e-3:
        unit = "s"
    elif 1.0 <= span <= 5e3:
        unit = "us"
    else:
        message = f"the unit of time cannot be told from its span ({span:.4g})"
        raise InputError(f"{message}; name it in the header, e.g. time_us", "table.time")
    return TIME_UNITS[unit], f"no unit given for time: taken as {unit} from its span"
