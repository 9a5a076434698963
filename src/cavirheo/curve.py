"""RadiusCurve: one measured bubble radius history R(t), and the quantities that need no material model."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from math import inf, isfinite, log, sqrt
from numbers import Real
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from cavirheo import landmarks
from cavirheo.arrays import Floats
from cavirheo.errors import InputError, brief, expect, expect_whole, listed, printable
from cavirheo.landmarks import AT_MAXIMUM, RAYLEIGH, collapse_time, fit_maximum, spikes, turning_points
from cavirheo.messages import CAMERA_TOLERANCE, Message
from cavirheo.parameters import (
    DEVIATION,
    DURATION,
    INTERVAL,
    NOT_NEGATIVE,
    RADIUS,
    check,
    check_domain,
    domain,
    optional,
)
from cavirheo.physics.media import CONSTANTS, Medium
from cavirheo.physics.media import medium as medium_of

T = TypeVar("T")
_FEWEST_FRAMES = 5  # with fewer measured frames no maximum is fitted
_LEAST_DRIFT = 0.05  # of R_max: a larger late rise of the radius is a drift
_LEAST_SPIKE = 0.2  # of R_max: a frame so far above both neighbours is wrong (below them, it may be a collapse)


def _all(values: Any, kind: type) -> bool:
    return isinstance(values, Collection) and not isinstance(values, str) and all(isinstance(x, kind) for x in values)


_TEXT = domain("a text", lambda x: isinstance(x, str))
_TEXTS = optional("a list of texts", lambda x: _all(x, str))
_SIZE = optional(*NOT_NEGATIVE["domain"])
_MAXIMUM = optional(
    "(time in s, R_max in m), R_max above 0",
    lambda x: _all(x, Real) and len(x) == 2 and isfinite(x[0]) and 0 < x[1] < inf,
)
_STRETCH = optional("R_max/R_0, from 1 to 100", lambda x: 1 <= x <= 100)
_MEDIUM = optional(
    f"numbers by name: {listed(CONSTANTS)}", lambda x: isinstance(x, Mapping) and x.keys() <= CONSTANTS.keys()
)
_CONSTANTS = {constant.name: constant.metadata for constant in fields(Medium) if constant.metadata}


class _MetaEntry(Generic[T]):
    """Descriptor: an entry of `meta` as an attribute of the curve. allowed: its domain; None: any value."""

    def __init__(self, key: str, default: T, allowed: Mapping[str, Any] | None = None) -> None:
        self.key, self.default, self.allowed = key, default, allowed

    def __get__(self, curve: RadiusCurve | None, _: type[RadiusCurve]) -> T:
        value = None if curve is None else curve.meta.get(self.key)
        return self.default if value is None else value


def as_numbers(name: str, values: Any) -> Floats:
    """The values as an array, NaN where one is masked. Raises InputError: not real numbers."""
    try:
        if np.iscomplexobj(values):
            raise TypeError
        return np.ma.filled(np.ma.array(values, dtype=np.float64, copy=True), np.nan)
    except (TypeError, ValueError):
        message = f"{name} must be a list or an array of real numbers, got {type(values).__name__} {brief(values)}"
        raise InputError(message, f"curve.{name}") from None


def _plain(value: Any) -> Any:
    """An array as a tuple, and NaN, which stands for a missing value in tables, as None."""
    if isinstance(value, np.ndarray):
        return tuple(value.tolist())
    return None if isinstance(value, float) and np.isnan(value) else value


def _labels(meta: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `meta` with all texts made printable, and always with a name, notes and hints. Raises InputError:
    an entry outside its domain."""
    labels = {"name": "curve", "notes": (), **meta}
    entries = {name: entry for name, entry in vars(RadiusCurve).items() if isinstance(entry, _MetaEntry)}
    for name, entry in entries.items():
        if name != entry.key and name in labels:
            raise InputError(f"the key of {name} in meta is {entry.key!r}, got {name!r}", f"curve.{name}")
        if entry.allowed and entry.key in labels:
            labels[entry.key] = _plain(labels[entry.key])
            check_domain(entry.allowed, entry.key, labels[entry.key], "curve")
    for name in labels.keys() & {"density", "pressure"}:
        raise InputError(f'{name} belongs into meta={{"medium": {{"{name}": {labels[name]!r}}}}}', "curve.medium")
    for name, value in (labels.get("medium") or {}).items():
        check_domain(_CONSTANTS[name], name, value, "curve")
    labels = {key: printable(value) if isinstance(value, str) else value for key, value in labels.items()}
    texts = {key: tuple(map(printable, labels.get(key) or ())) for key in ("notes", "hints")}
    return labels | {"name": str(labels["name"])} | texts


def as_curves(curves: Iterable[RadiusCurve]) -> list[RadiusCurve]:
    """The curves as a list. Raises InputError: not a list of RadiusCurves (the message says how to get one)."""
    advice = "read_curves(path) reads the curves of a file; infer and fit take one, infer_many and fit_many a list"
    expect(curves, Iterable, f"a list of RadiusCurves ({advice})")
    found = [curves] if isinstance(curves, str) else list(curves)
    for curve in found:
        expect(curve, RadiusCurve, f"a RadiusCurve ({advice})")
    return found


def rate_warnings(curve: RadiusCurve, given: float | None) -> tuple[Message, ...]:
    """A warning if the times contradict this frame rate, 1/s: both their median and their mean interval."""
    steps = np.diff(curve.time)
    if not given or not steps.size:
        return ()
    middle = float(np.median(steps))
    rate = float(np.sum(np.round(steps / middle)) / np.sum(steps))  # gaps and rounded times count whole
    differs = min(abs(given / rate - 1.0), abs(given * middle - 1.0)) > CAMERA_TOLERANCE
    return (Message("check_input.rate_unused", {"given": given, "rate": rate}),) if differs else ()


@dataclass(frozen=True, eq=False, repr=False)
class RadiusCurve:
    """A measured radius history.

    Attributes:
        time: (n,) s, strictly increasing, any spacing and any origin.
        radius: (n,) m, positive; NaN is a frame without a measurement.
        radius_std: (n,) m, standard deviation of the radius; NaN where unknown.
        meta: facts about the recording. Every key is optional, and these are attributes of the curve too: name, group
            and group_source; source (the file as given) and source_sha256; notes (what was recognised, converted or
            left out); hints (remarks on scale and constants); stretch (R_max/R_0 as stated) and stretch_std; medium
            (constants of the medium as stated, SI, by field of `Medium`); frame_rate, 1/s (key frame_rate_hz);
            exposure, s (key exposure_s).
        maximum: (time in s, R_max in m); if None, it is fitted to the samples (landmarks.py).
        stated_time_of_max: time of R_max that the file states, s; used where the recording does not show the growth.
        unscaled: reason why the radii have no scale; `max_radius` raises it until `with_max_radius` sets the scale.
        late: whether R_max may be before the first frame; if None, the frames decide (`begins_late`).
        warnings: input warnings, such as frames out of order. With a warning no answer is `ok`, unless the user
            confirms that the input is right.
        unusable: reason why the curve cannot be analysed (three samples, all NaN, an empty cell); `max_radius` raises
            it. Such a curve exists so that the other curves of its file can be answered.

    Raises:
        InputError: arrays of different lengths, a time that is not finite or does not increase, a radius or a deviation
            that is infinite or <= 0, radii or frame intervals that no bubble has in m and s, or another attribute or
            entry of `meta` that is not as above.
    """

    time: Floats
    radius: Floats
    radius_std: Floats = field(default_factory=lambda: np.empty(0))
    meta: Mapping[str, Any] = field(default_factory=dict)
    _: KW_ONLY
    maximum: tuple[float, float] | None = field(default=None, metadata=_MAXIMUM)
    stated_time_of_max: float | None = field(default=None, metadata=optional("finite", isfinite))
    unscaled: str = field(default="", metadata=_TEXT)
    late: bool | None = None
    warnings: tuple[Message, ...] = field(default=(), metadata=domain("Messages", lambda x: _all(x, Message)))
    unusable: str = field(default="", metadata=_TEXT)

    name: ClassVar[_MetaEntry[str]] = _MetaEntry("name", "curve")
    notes: ClassVar[_MetaEntry[tuple[str, ...]]] = _MetaEntry("notes", (), _TEXTS)
    hints: ClassVar[_MetaEntry[tuple[str, ...]]] = _MetaEntry("hints", (), _TEXTS)
    source: ClassVar[_MetaEntry[str]] = _MetaEntry("source", "")
    source_sha256: ClassVar[_MetaEntry[str | None]] = _MetaEntry("source_sha256", None)
    stretch: ClassVar[_MetaEntry[float | None]] = _MetaEntry("stretch", None, _STRETCH)
    stretch_std: ClassVar[_MetaEntry[float | None]] = _MetaEntry("stretch_std", None, _SIZE)
    medium: ClassVar[_MetaEntry[Mapping[str, float]]] = _MetaEntry("medium", {}, _MEDIUM)
    frame_rate: ClassVar[_MetaEntry[float | None]] = _MetaEntry("frame_rate_hz", None, _SIZE)
    exposure: ClassVar[_MetaEntry[float]] = _MetaEntry("exposure_s", 0.0, _SIZE)  # centred on the time of the frame

    def __post_init__(self) -> None:
        expect(self.meta, Mapping, 'a mapping as meta, {"name": "shot 1"}')
        expect(self.late, bool | np.bool_ | None, "True or False as late, or none")
        object.__setattr__(self, "maximum", _plain(self.maximum))
        check(self, "curve")
        if self.maximum and not self.unscaled:
            RADIUS.check("R_max of maximum", self.maximum[1], "curve.max_radius")
        time, radius, std = (as_numbers(name, getattr(self, name)) for name in ("time", "radius", "radius_std"))
        std = std if std.size else np.full(radius.shape, np.nan)
        if time.ndim != 1 or not time.shape == radius.shape == std.shape:
            message = "time, radius and radius_std must be one-dimensional and of one length, got shapes "
            raise InputError(f"{message}{time.shape}, {radius.shape}, {std.shape}", "curve.shape")
        for at in np.flatnonzero(~np.isfinite(time)):
            raise InputError(f"time must be finite; sample {at} is not", "curve.time")
        for at in np.flatnonzero(np.diff(time) <= 0) + 1:
            raise InputError(f"time must increase; sample {at} ({time[at]:.6g} s) does not", "curve.time")
        for name, values, plausible in (("radius", radius, RADIUS), ("radius_std", std, DEVIATION)):
            if np.any((values <= 0) | np.isinf(values)):
                raise InputError(f"{name} must be positive and finite, or NaN where a frame has none", f"curve.{name}")
            if np.isfinite(values).any() and not self.unscaled:
                plausible.check(name, float(np.nanmedian(values)), f"curve.{name}_unit")
        if len(time) > 1:
            INTERVAL.check("the time between frames", float(np.median(np.diff(time))), "curve.time_unit")
        self.__setstate__({"time": time, "radius": radius, "radius_std": std, "meta": _labels(self.meta)})

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state)
        for array in (self.time, self.radius, self.radius_std):
            array.setflags(write=False)

    def __repr__(self) -> str:
        rate, top = f" at {self.frame_rate:.4g}/s" if self.frame_rate else "", "no R_max"
        with suppress(InputError):
            top = f"R_max {self.max_radius * 1e6:.4g} um"
        span = 1e6 * float(np.ptp(self.time)) if len(self.time) else 0.0
        return f"RadiusCurve({self.name!r}: {len(self.time)} frames{rate}, {top}, {span:.4g} us)"

    @property
    def group(self) -> str:
        """Name of the group, the shots of one material; by default the name of the curve."""
        return str(self.meta.get("group", self.name))

    @property
    def group_source(self) -> str:
        """The file or folder that defines the group; by default `source`."""
        return str(self.meta.get("group_source", self.source))

    @property
    def max_radius(self) -> float:
        """R_max in m: `maximum`, else by the local fit (landmarks.py). Raises InputError: the curve is `unusable` or
        `unscaled`, has fewer than 5 measured frames, no fall after the maximum, or too much scatter near it."""
        if self.unscaled:
            raise self._error(f"{self.unscaled}; give the true R_max (--rmax-um)", "unscaled")
        return self._maximum[1]

    @property
    def time_of_max(self) -> float:
        """Time of R_max on the clock of `time`, s. Raises InputError: as `max_radius`, except for `unscaled` curves."""
        return self._maximum[0]

    @cached_property
    def _maximum(self) -> tuple[float, float]:
        if self.maximum is not None:
            return self.maximum
        if self.unusable:
            raise self._error(self.unusable, "unusable")
        time, radius = self._measured
        if len(time) < _FEWEST_FRAMES:
            few = f"{len(time)} of {len(self.time)} frames have a radius"
            raise self._error(f"{few}; at least {_FEWEST_FRAMES} are needed", "few_frames")
        try:
            return fit_maximum(time, radius, self.stated_time_of_max)
        except InputError as error:
            raise error.within(self.name) from None

    @cached_property
    def _measured(self) -> tuple[Floats, Floats]:
        measured = np.isfinite(self.radius)
        return self.time[measured], self.radius[measured]

    @cached_property
    def _after_max(self) -> tuple[Floats, Floats]:
        """(time, radius) of the measured samples after the maximum, with the maximum itself as the first sample."""
        time, radius = self._measured
        start, top = self._maximum
        later = time > start
        return np.append(start, time[later]), np.append(top, radius[later])

    @cached_property
    def _turning_points(self) -> tuple[list[int], list[int]]:
        """Indices into `_after_max` of the collapses and of the rebound maxima between them."""
        radius = self._after_max[1].copy()
        for i in spikes(radius, _LEAST_SPIKE * radius[0]):
            radius[i] = max(radius[i - 1], radius[i + 1])
        return turning_points(radius, landmarks.least_rebound(float(radius[0]), self.noise))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the radius noise from frame to frame after R_max, m: `landmarks.noise_std` (0 for
        fewer than 8 frames), but at least the standard deviation of the rounding of the radii."""
        return max(landmarks.noise_std(self._after_max[1][1:]), landmarks.rounding_step(self._measured[1]) / sqrt(12.0))

    def _error(self, message: str, code: str) -> InputError:
        return InputError(message, f"curve.{code}", self.name)

    def labelled(self, *, warnings: tuple[Message, ...] | None = None, **meta: Any) -> RadiusCurve:
        """A copy of the curve with these entries of `meta` or these warnings; computed properties are kept."""
        curve = copy(self)
        warnings = self.warnings if warnings is None else warnings
        vars(curve).update(meta=_labels({**self.meta, **meta}), warnings=warnings)
        return curve

    def with_notes(self, *notes: str) -> RadiusCurve:
        """A copy of the curve with more notes."""
        return self.labelled(notes=self.notes + notes)

    def with_group(self, name: str, source: str) -> RadiusCurve:
        """A copy of the curve in another group; `source` is the file or folder that defines the group."""
        return self.labelled(group=name, group_source=source)

    def with_max_radius(self, max_radius: float) -> RadiusCurve:
        """The curve scaled so that its maximum is `max_radius` (m): for radii in pixels, or if R_max is known better.
        Times do not change."""
        RADIUS.check("the maximum radius", max_radius, "curve.max_radius")
        start, top = self._maximum
        scale = max_radius / top
        note = f"R_max set to {max_radius * 1e6:.4g} um" + ("" if self.unscaled else f": radii scaled by {scale:.4g}")
        parts: Any = {"radius": self.radius * scale, "radius_std": self.radius_std * scale, "late": self.begins_late}
        parts |= {"maximum": (start, float(max_radius)), "stated_time_of_max": None}
        return replace(self.with_notes(note), **parts, unscaled="")

    def normalised(self, medium: Medium | str) -> tuple[Floats, Floats]:
        """(m,) t* = (t - t_max)/t_c and (m,) R* = R/R_max of the measured frames, growth (t* < 0) included."""
        medium = medium_of(medium)
        time, radius = self._measured
        return (time - self.time_of_max) / medium.time_scale(self.max_radius), radius / self.max_radius

    def resampled(self, step: float, count: int = 100) -> Floats:
        """(count,) m: the radius at time_of_max + step*arange(count), `step` in s; the first is max_radius.

        Shape-preserving piecewise cubic Hermite (PCHIP) through the fitted maximum and the measured samples after it;
        the values beyond the last measured sample are NaN. Raises InputError: there is no maximum, or no such step.
        """
        from scipy.interpolate import PchipInterpolator

        INTERVAL.check("step", step, "curve.step")
        expect_whole(count, "count", 1, "curve.count")
        top = self.max_radius
        time, radius = self._after_max
        times = step * np.arange(count)
        missing = times > (time[-1] - time[0]) * (1.0 + 1e-9)
        result = np.asarray(PchipInterpolator(time, radius)(np.minimum(time[0] + times, time[-1])))
        result[missing] = np.nan
        result[0] = top
        return result

    def spikes(self) -> list[int]:
        """Frames (indices into `time`) whose radius exceeds that of both measured neighbours by 20 % of R_max: wrong
        measurements. They stay in the curve; only the search for collapses ignores them."""
        measured = np.flatnonzero(np.isfinite(self.radius))
        return [int(measured[i]) for i in spikes(self.radius[measured], _LEAST_SPIKE * self.max_radius)]

    def collapse_times(self) -> Floats:
        """(k,) s: ascending times of the collapses on the clock of `time`; empty if there is none."""
        time, radius = self._after_max
        return np.array([collapse_time(time, radius, i) for i in self._turning_points[0]])

    def window(self, collapses: int | None = None, end: float | None = None) -> RadiusCurve:
        """The part from R_max on: up to the middle of the rebound after the given number of collapses, or up to `end` s
        after R_max, whichever is earlier. R_max and its time stay those of the whole curve.

        The middle is halfway between two collapses. If the second one is not recorded, its time is estimated from the
        heights of the rebounds. The largest frame of the rebound would be a biased end: its noise is positive.
        Raises InputError: the curve shows fewer collapses, or fewer than two frames are left.
        """
        start, top = self.time_of_max, self.max_radius
        time, radius = self._after_max
        stop = time[-1]
        if end is not None:
            DURATION.check("end", end, "curve.window")
            stop = start + end
        if collapses is not None:
            expect_whole(collapses, "collapses", 1, "curve.collapses")
            minima, maxima = self._turning_points
            if collapses > len(minima):
                message = f"a window of {collapses} collapses was asked; the curve shows {len(minima)}"
                raise self._error(message, "collapses")
            times, tops = self.collapse_times(), [top, *radius[maxima]]
            last = times[collapses - 1]
            period = last - (times[collapses - 2] if collapses > 1 else 2.0 * start - last)
            if collapses < len(tops):
                period *= min(tops[collapses] / tops[collapses - 1], 1.0)
            following = times[collapses] if collapses < len(times) else last + period
            stop = min(stop, 0.5 * (last + following))
        inside = (self.time >= start) & (self.time <= stop)
        if np.count_nonzero(inside & np.isfinite(self.radius)) < 2:
            few = f"fewer than two measured frames between R_max and {1e6 * (stop - start):.4g} us after it"
            raise self._error(few, "window")
        parts = {name: getattr(self, name)[inside] for name in ("time", "radius", "radius_std")}
        return replace(self, **parts, maximum=(start, top))

    @cached_property
    def drifts_from(self) -> float | None:
        """Time, s, from which the radius drifts upwards as no single bubble does (landmarks.py); None: no drift."""
        time, radius = self._after_max
        rise = max(_LEAST_DRIFT * radius[0], 6.0 * self.noise)
        return landmarks.drift_start(time, radius, *self._turning_points, rise)

    def strain_rate(self) -> float:
        """Mean strain rate at the bubble wall between R_max and the first collapse, 1/s.

        For an incompressible medium the wall's radial logarithmic strain rate is -2 R'/R, whose mean is
        2 ln(R_max/R_1)/(t_1 - t_max), R_1 being the smallest *measured* radius of the first collapse; the hoop rate is
        half of it. Collapses are under-sampled: a true minimum half as large adds 2 ln 2/(t_1 - t_max). Raises
        InputError: the curve shows no collapse.
        """
        time, radius = self._after_max
        minima = self._turning_points[0]
        if not minima:
            raise self._error("the curve shows no collapse, so there is no strain rate up to it", "collapses")
        return 2.0 * log(self.max_radius / radius[minima[0]]) / (float(self.collapse_times()[0]) - time[0])

    def stretch_from_tail(self) -> tuple[float, float] | None:
        """(lambda, its standard deviation): R_max over the mean radius of the last third of the time.

        None where the last third is no plateau: it has fewer than 8 frames, begins before twice the time from R_max to
        the first collapse, scatters by more than 5 % (residual oscillation included), or drifts by more than 5 %, in
        itself or relative to the sixth of the time before it. The standard deviation combines scatter and drift.
        """
        return self._plateau_stretch

    @cached_property
    def _plateau_stretch(self) -> tuple[float, float] | None:
        time, radius = self._after_max
        duration = time[-1] - time[0]
        late = time > time[-1] - duration / 3.0
        before = (time > time[-1] - duration / 2.0) & ~late
        early = any(2.0 * (collapse - time[0]) > duration * 2.0 / 3.0 for collapse in self.collapse_times()[:1])
        if early or np.count_nonzero(late) < 8 or np.count_nonzero(before) < 3:
            return None
        level = float(np.mean(radius[late]))
        slope = float(np.polyfit(time[late] - time[-1], radius[late], 1)[0])
        drifts = max(abs(slope) * duration / 3.0, abs(level - float(np.median(radius[before])))) / level
        scatter = float(np.std(radius[late], ddof=1)) / level
        if scatter > 0.05 or drifts > 0.05:
            return None
        stretch = float(radius[0]) / level
        return stretch, stretch * float(np.hypot(scatter, drifts / 2.0))

    @property
    def begins_late(self) -> bool:
        """Whether R_max may be before the first frame: `late`; if None, no growth is recorded and no R_max is given."""
        if self.late is not None or self.maximum or self.stated_time_of_max is not None:
            return bool(self.late)
        return not self._shows_growth()

    def _shows_growth(self) -> bool:
        (time, radius), (start, top) = self._measured, self._maximum
        return bool(radius[time < start].min(initial=np.inf) <= AT_MAXIMUM * top)

    @cached_property
    def time_of_max_span(self) -> tuple[float, float]:
        """(earliest, latest) time of R_max, s, that the frames near it allow (landmarks.py). Unless `late` is given,
        both are equal if `maximum` is given, or if `stated_time_of_max` is given and no growth is recorded. Raises
        InputError: the curve has no R_max."""
        start, top = self._maximum
        if self.late is None and (self.maximum or (self.stated_time_of_max is not None and not self._shows_growth())):
            return start, start
        return landmarks.maximum_span(*self._measured, (start, top), self.noise)

    @cached_property
    def frames_missed(self) -> float:
        """Number of frames from R_max to the first frame, if the first radii show clearly that it is more than the one
        frame that the fit of the clock allows; else 0. Raises InputError: the curve has no R_max."""
        is_late = self.begins_late and not self.maximum
        return landmarks.frames_missed(*self._measured, self.noise) if is_late else 0.0

    def rayleigh_ratio(self, density: float = 998.0, pressure: float = 101325.0) -> float | None:
        """Time from R_max to the first collapse over the Rayleigh time t_RC = 0.9147 R_max sqrt(rho/p).

        Elasticity shortens the collapse to about t_RC (1 + 2.5 G/p)^(-1/2), viscosity lengthens it (Zhu et al. 2025,
        doi:10.1039/D5SM00397K): liquids and gels below 50 kPa show 0.7 to 1.4. None: the curve shows no collapse, or
        has no R_max. density in kg/m3, pressure in Pa.
        """
        with suppress(InputError, IndexError):
            measured = float(self.collapse_times()[0] - self.time_of_max)
            return measured / (RAYLEIGH * self.max_radius * float(np.sqrt(density / pressure)))
        return None
