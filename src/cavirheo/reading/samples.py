"""Samples as a file gives them -> one RadiusCurve; everything that is done to them is counted in its notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.messages import UNIT, Message
from cavirheo.reading.vocabulary import LENGTH_UNITS, TIME_UNITS

RADIUS_UNITS = {**LENGTH_UNITS, "px": 1e-6}  # px: a stand-in until R_max is given
_PLAUSIBLE = (5e-6, 5e-3)  # m; the largest radius read as m, mm and um falls in here for one of them at most
_FEWEST_STEPS = 5  # that tell even ones from chance
_ABSURD = 1e9  # in any unit; larger numbers are damage and would overflow later
_SAME_TIME = 1e-15  # s; closer frames are one, told apart by rounding only
_NO_BUBBLE = 1e-9  # m; smaller numbers are what an empty frame leaves behind (denormals in one published file)


def unusable(reason: str, about: Mapping[str, Any] | None = None, **meta: Any) -> RadiusCurve:
    """A curve without samples that says why. about: its other fields."""
    fields: dict[str, Any] = {**(about or {}), "unusable": reason}
    return RadiusCurve(np.empty(0), np.empty(0), meta={**meta, "notes": (reason,)}, **fields)


def make_curve(
    time: ArrayLike,
    radius: ArrayLike,
    radius_std: ArrayLike | None = None,
    *,
    time_unit: str | None = None,
    radius_unit: str | None = None,
    notes: Sequence[str] = (),
    warnings: Sequence[Message] = (),
    about: Mapping[str, Any] | None = None,
    **meta: Any,
) -> RadiusCurve:
    """Clean one curve: (n,) times and radii (and their deviations) in the given units; None = tell from the size.

    Frames with NaN or absurd (1e9) radius are NaN; radii <= 0 become NaN; frames without a time are left out; frames
    are sorted by time; frames of one time are averaged. Each is counted in the notes; a unit that the size contradicts,
    and times out of order, are among the curve's `warnings` too. The curve is `unusable` where time and radius are
    swapped. about: other fields of the curve.

    Raises:
        InputError: no unit of time is given and it cannot be told.
    """
    t, r = (np.asarray(a, dtype=np.float64).ravel() for a in (time, radius))
    std = np.full(r.shape, np.nan) if radius_std is None else np.asarray(radius_std, dtype=np.float64).ravel()
    fields = {**(about or {}), "warnings": tuple(warnings)}
    if len(t) != len(r) or len(std) != len(r):
        return unusable(f"{len(t)} times but {len(r)} radii", fields, **meta)
    if swapped(t, r):
        back = f"the times go back in {np.count_nonzero(np.diff(t) < 0)} of {len(t) - 1} steps"
        mend = "the radii rise in even steps, as times do: exchange the two columns, or their titles"
        return unusable(f"time and radius seem to be swapped: {back}, and {mend}", fields, **meta)
    said, hints = list(notes), list(meta.pop("hints", ()))

    said += _absurd("times", t)
    timed, known = np.abs(t) < _ABSURD, ~np.isnan(t)
    if not known.all():
        said.append(f"{np.count_nonzero(~known)} of {len(t)} frames without a time left out")
    t, r, std = t[timed], r[timed], std[timed]
    if time_unit is None:
        time_unit = _guess_time_unit(t)
        hints.append(f"no unit given for time: taken as {time_unit} from its span")
        said.append(hints[-1])
    t = t * TIME_UNITS[time_unit]

    missing = np.count_nonzero(np.isnan(r))
    said += _absurd("radii", r)
    r = np.where(np.abs(r) < _ABSURD, r, np.nan)
    scale, found, unscaled = _radius_scale(_largest(r), radius_unit)
    r, std = r * scale, std * scale
    std[~(std > 0)] = np.nan
    empty = r < _NO_BUBBLE
    r[empty] = np.nan
    doubtful = list(warnings)
    if isinstance(found, Message):
        doubtful.append(found)
        said.append(found.text)
    elif found:
        hints.append(found)
        said.append(found)
    said += [f"{missing} of {len(r)} frames without a radius (NaN)"] if missing else []
    said += [f"{empty.sum()} frames with radius <= 0 marked as not measured"] if empty.any() else []

    if backwards := np.count_nonzero(np.diff(t) < 0):
        doubtful.append(Message("check_input.time_order", {"steps": int(backwards)}))
        said.append(doubtful[-1].text)
        order = np.argsort(t, kind="stable")
        t, r, std = t[order], r[order], std[order]
    first = np.flatnonzero(np.diff(t, prepend=-np.inf) > _SAME_TIME)
    if len(first) < len(t):
        said.append(f"{len(t) - len(first)} frames repeat a time: the radii of one time averaged")
        t, r, std = t[first], _averaged(r, first), _averaged(std, first)
    steps = np.diff(t)
    step = float(np.median(steps)) if len(steps) > 1 else 0.0
    if step and _even(steps):
        meta.setdefault("frame_rate_hz", 1.0 / step)
    said += [unscaled] if unscaled else []
    meta |= {"hints": tuple(hints)} if hints else {}
    try:
        return RadiusCurve(
            t, r, std, {**meta, "notes": tuple(said)}, **{"unscaled": unscaled, **fields, "warnings": tuple(doubtful)}
        )
    except InputError as error:  # of no bubble: the others of its file are answered
        return unusable(str(error), fields, **meta)


def swapped(time: Floats, radius: Floats) -> bool:
    """Whether times (n,) go back while radii rise in even steps from the first to the last, as times do."""
    steps = np.diff(radius[np.isfinite(radius)])
    if len(steps) < _FEWEST_STEPS or not np.all(steps > 0) or not np.any(np.diff(time) < 0):
        return False
    return _even(steps)


def _even(steps: Floats) -> bool:
    """Whether most steps are as long as the median one."""
    step = float(np.median(steps))
    return bool(np.mean(np.abs(steps - step) < 0.01 * step) > 0.5)


def _absurd(what: str, values: Floats) -> list[str]:
    """A note where numbers are too large for any time or radius."""
    wrong = values[np.abs(values) >= _ABSURD]
    message = f"{len(wrong)} of {len(values)} {what} are numbers that no recording has (the first: {{:.4g}})"
    return [message.format(wrong[0]) + ": taken as not measured"] if len(wrong) else []


def _averaged(values: Floats, first: NDArray[np.intp]) -> Floats:
    """The mean of what is known of each run of values that begins at one of the indices `first`."""
    means = values[first]
    for k in np.flatnonzero(np.diff(first, append=len(values)) > 1):
        run = values[first[k] : first[k + 1] if k + 1 < len(first) else None]
        known = run[np.isfinite(run)]
        means[k] = known.mean() if known.size else np.nan
    return means


def _largest(r: Floats) -> float:
    """The largest radius but for two frames, which may be wrong ones."""
    known = np.sort(r[np.isfinite(r)])
    return float(known[-3] if len(known) >= 5 else known.max(initial=0.0))


def _radius_scale(largest: float, unit: str | None) -> tuple[float, Message | str, str]:
    """(metres per number, a warning or a note, why there is no scale) from the largest radius and the unit given, if
    any."""
    if unit == "px":
        return RADIUS_UNITS["px"], "", f"the radius is in pixels (largest {largest:.4g}) without um per pixel"
    fits = [u for u in ("m", "mm", "um") if _PLAUSIBLE[0] <= largest * RADIUS_UNITS[u] <= _PLAUSIBLE[1]]
    if largest <= 0.0 or unit in fits:
        return RADIUS_UNITS[unit or "um"], "", ""
    given = f"the radius is given in {unit}" if unit else "no unit is given for the radius"
    if 0.8 < largest < 1.25:  # rather R/R_max than a bubble of 1 mm
        return 1e-6, "", f"{given}, but its largest value {largest:.4g} looks like R/R_max"
    if len(fits) != 1:
        return 1e-6, "", f"{given}; its largest value {largest:.4g} is no bubble of 5 um to 5 mm in m, mm or um"
    warning = Message(UNIT, {"given": unit, "largest": largest, "taken": fits[0]})
    return RADIUS_UNITS[fits[0]], warning if unit else f"{given}: taken as {fits[0]} from its size", ""


def _guess_time_unit(t: Floats) -> str:
    """Recordings of collapsing bubbles last between 1 us and 5 ms: numbers of that span are s or us."""
    span = float(np.ptp(t)) if len(t) else 0.0
    if len(t) < 2 or 5e-7 <= span <= 5e-3:
        return "s"
    if 1.0 <= span <= 5e3:
        return "us"
    why = f"the unit of time cannot be told from its span ({span:.4g})"
    raise InputError(f"{why}; name it in the header, e.g. time_us", "table.time")
