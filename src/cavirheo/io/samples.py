"""Samples as a file gives them -> one RadiusCurve; everything that is done to them is counted in its notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.io.formats import LENGTH_UNITS, TIME_UNITS
from cavirheo.messages import Message

RADIUS_UNITS = {**LENGTH_UNITS, "px": 1e-6}  # px: a stand-in until R_max is given
_PLAUSIBLE = (5e-6, 5e-3)  # m; the largest radius read as m, mm and um falls in here for one of them at most
_ABSURD = 1e9  # in any unit; larger numbers are damage and would overflow later
_SAME_TIME = 1e-15  # s; closer frames are one, told apart by rounding only
_NO_BUBBLE = 1e-9  # m; smaller numbers are what an empty frame leaves behind (denormals in one published file)


@dataclass
class _Remarks:
    """What was done to samples: notes; hints, those of scale and constants; warnings, what makes them doubtful."""

    notes: list[str]
    hints: list[str]
    warnings: list[Message] = field(default_factory=list)

    def hint(self, text: str) -> None:
        self.hints.append(text)
        self.notes.append(text)

    def warn(self, message: Message) -> None:
        self.warnings.append(message)
        self.notes.append(message.text)


def unusable(reason: str, fields: Mapping[str, Any] | None = None, **meta: Any) -> RadiusCurve:
    """A curve without samples that says why. fields: its other fields."""
    meta["notes"] = (reason,)
    return RadiusCurve(np.empty(0), np.empty(0), meta=meta, **{**(fields or {}), "unusable": reason})


def make_curve(
    time: ArrayLike,
    radius: ArrayLike,
    radius_std: ArrayLike | None = None,
    *,
    time_unit: str | None = None,
    radius_unit: str | None = None,
    notes: Sequence[str] = (),
    fields: Mapping[str, Any] | None = None,
    **meta: Any,
) -> RadiusCurve:
    """Clean one curve: (n,) times and radii (and their deviations) in the given units; None = tell from the size.

    Frames with NaN or absurd (1e9) radius are NaN; radii <= 0 become NaN; frames without a time are left out; frames
    are sorted by time; frames of one time are averaged. Each is counted in the notes; times out of order are among the
    curve's `warnings` too. A unit that the size contradicts is no scale. fields: other fields of the curve.

    Raises:
        InputError: no unit of time is given and it cannot be told.
    """
    t, r = (np.asarray(a, dtype=np.float64).ravel() for a in (time, radius))
    std = np.full(r.shape, np.nan) if radius_std is None else np.asarray(radius_std, dtype=np.float64).ravel()
    remarks, fields = _Remarks(list(notes), list(meta.pop("hints", ()))), dict(fields or {})
    if len(t) != len(r) or len(std) != len(r):
        return unusable(f"{len(t)} times but {len(r)} radii", fields, **meta)
    t, r, std = _in_seconds(t, r, std, time_unit, remarks)
    r, std, unscaled = _in_metres(r, std, radius_unit, remarks)
    t, r, std = _in_order(t, r, std, remarks)
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) > 1 else 0.0
    if step and np.mean(np.abs(steps - step) < 0.01 * step) > 0.5:
        meta.setdefault("frame_rate_hz", 1.0 / step)
    meta["notes"] = (*remarks.notes, unscaled) if unscaled else tuple(remarks.notes)
    meta |= {"hints": tuple(remarks.hints)} if remarks.hints else {}
    try:
        fields = {"unscaled": unscaled, **fields}
        return RadiusCurve(t, r, std, meta, **fields, warnings=tuple(remarks.warnings))
    except InputError as error:  # of no bubble: the others of its file are answered
        return unusable(str(error), fields, **meta)


def _in_seconds(
    t: Floats, r: Floats, std: Floats, unit: str | None, remarks: _Remarks
) -> tuple[Floats, Floats, Floats]:
    """The frames that have a time, in s."""
    timed = np.abs(t) < _ABSURD
    if missing := np.count_nonzero(~timed):
        remarks.notes.append(f"{missing} of {len(t)} frames without a time left out")
    t, r, std = t[timed], r[timed], std[timed]
    if unit is None:
        unit = _guess_time_unit(t)
        remarks.hint(f"no unit given for time: taken as {unit} from its span")
    return t * TIME_UNITS[unit], r, std


def _in_metres(r: Floats, std: Floats, unit: str | None, remarks: _Remarks) -> tuple[Floats, Floats, str]:
    """(radii in m, NaN where there is none; their deviations; why there is no scale)."""
    r = np.where(np.abs(r) < _ABSURD, r, np.nan)
    missing = np.count_nonzero(np.isnan(r))
    scale, hint, unscaled = _radius_scale(_largest(r), unit)
    r, std = r * scale, std * scale
    std[~(std > 0)] = np.nan
    empty = r < _NO_BUBBLE
    r[empty] = np.nan
    if hint:
        remarks.hint(hint)
    remarks.notes += [f"{missing} of {len(r)} frames without a radius (NaN)"] if missing else []
    remarks.notes += [f"{empty.sum()} frames with radius <= 0 marked as not measured"] if empty.any() else []
    return r, std, unscaled


def _in_order(t: Floats, r: Floats, std: Floats, remarks: _Remarks) -> tuple[Floats, Floats, Floats]:
    """Sorted by time, those of one time averaged."""
    if backwards := np.count_nonzero(np.diff(t) < 0):
        remarks.warn(Message("check_input.time_order", {"steps": int(backwards)}))
        order = np.argsort(t, kind="stable")
        t, r, std = t[order], r[order], std[order]
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > _SAME_TIME)
    if len(first) < len(t):
        remarks.notes.append(f"{len(t) - len(first)} frames repeat a time: the radii of one time averaged")
        t, r, std = t[first], _averaged(r, first), _averaged(std, first)
    return t, r, std


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


def _guess_time_unit(t: Floats) -> str:
    """Recordings of collapsing bubbles last between 1 us and 5 ms: numbers of that span are s or us."""
    span = float(np.ptp(t)) if len(t) else 0.0
    if len(t) < 2 or 5e-7 <= span <= 5e-3:
        return "s"
    if 1.0 <= span <= 5e3:
        return "us"
    message = f"the unit of time cannot be told from its span ({span:.4g})"
    raise InputError(f"{message}; name it in the header, e.g. time_us", "table.time")
