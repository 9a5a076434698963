"""A recording measured: the bubble's history in seconds and metres, and where every number came from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import starmap
from math import isfinite
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, numbered, require
from cavirheo.messages import Message
from cavirheo.parameters import FRAME_RATE
from cavirheo.video import frames
from cavirheo.video.frames import Footage
from cavirheo.video.stage import set_stage
from cavirheo.video.track import FLAGS, USED, Track, follow
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Record

_PIXEL = 1e-6  # m, that stands in for a pixel until there is a scale
_DIFFERS = 0.01  # of the rate or the exposure: the camera and the user mean different ones
_TWINS = 0.2  # of the measured frames
_CUT = 0.9  # of the outline at R_max: seen less far, it is said
_BURNT = 0.3  # of the background, at the brightest value
_HOW = "give it (--fps; in Python frame_rate=)"
_NO_RATE = f"how fast it was recorded is not known, for a video file states how fast it is played; {_HOW}"


class StatedNumber(Record):
    """A number that somebody must say.

    Attributes:
        value: in SI, but for um per pixel; null where nobody says it.
        origin: who says so.
    """

    value: Finite = None
    origin: str = "not known"


@dataclass(frozen=True, eq=False)
class Measurement:
    """One recording. `track` is in pixels of the region that was looked at; `corner` is its (x, y) in the recording.

    time: (n,) s from the recording's first frame on. first: number of the first frame here, from 1.
    """

    track: Track
    recording: Footage
    time: Floats
    frame_rate: StatedNumber
    um_per_px: StatedNumber
    exposure: StatedNumber
    options: dict[str, Any]
    warnings: tuple[Message, ...]
    first: int = 1
    corner: tuple[int, int] = (0, 0)

    @property
    def counts(self) -> dict[str, int]:
        """Frames by flag, in the order of `FLAGS`."""
        counter = Counter(self.track.flags.tolist())
        return {flag: counter[flag] for flag in FLAGS if counter[flag]}

    @property
    def notes(self) -> tuple[str, ...]:
        """What the recording tells, and what became of its frames."""
        used = sum(self.counts.get(flag, 0) for flag in USED)
        notes = [*self.recording.notes, f"{used} of {len(self.track.flags)} frames measured"]
        usual = ("ok", "before", "excluded")
        notes += [f"{n} {flag} ({FLAGS[flag]})" for flag, n in self.counts.items() if flag not in usual]
        if listed := self.options.get("exclude"):
            notes.append(f"excluded by hand: frames {listed}")
        notes += [self.cut] if self.cut else []
        hint = self.track.exposure_hint
        if self.exposure.value is None and hint and isfinite(hint):
            share = f"{min(hint, 1.0):.2g} of the time between frames"
            notes.append(f"exposure not known; the blur of fast frames suggests {share}")
        return tuple(notes)

    @property
    def cut(self) -> str:
        """How little of the largest outline is within the frame, where it is little."""
        share = self.track.arc[int(np.nanargmax(self.track.radius))]
        return f"at R_max {100 * share:.0f} % of the outline is within the frame" if share < _CUT else ""

    def without(self, frames: str | Iterable[int]) -> Measurement:
        """The same with these frames left out: "12,40-45" or numbers, from 1 in the recording. The others stay as they
        are. Raises InputError: there are no such frames, or no measured one is left."""
        last = self.first + len(self.time) - 1
        listed = numbered(frames, "frames to exclude", "video.exclude", self.first, last)
        left = np.isin(np.arange(self.first, last + 1), listed)
        arrays = {name: array for name, array in vars(self.track).items() if isinstance(array, np.ndarray)}
        out = {name: np.where(left, "excluded" if name == "flags" else np.nan, each) for name, each in arrays.items()}
        track: Track = replace(self.track, **out)  # type: ignore[arg-type]
        require(bool(np.isfinite(track.radius).any()), "all measured frames are excluded", "video.exclude")
        listed = (np.flatnonzero(track.flags == "excluded") + self.first).tolist()
        return replace(self, track=track, options={**self.options, "exclude": digits.ranges(listed)})

    def curve(self, **meta: Any) -> RadiusCurve:
        """The history; frames that are not used are NaN. Its meta has `flags` (n,). Raises InputError."""
        pixel = (self.um_per_px.value or 1.0) * _PIXEL
        labels = {"notes": self.notes, "flags": tuple(self.track.flags.tolist()), "video": True, **meta}
        numbers = {"frame_rate_hz": self.frame_rate.value, "exposure_s": self.exposure.value}
        labels |= {name: value for name, value in numbers.items() if value}
        radius, sigma = self.track.radius * pixel, self.track.sigma * pixel
        largest = f"the radius is in pixels (largest {np.nanmax(self.track.radius):.4g})"
        unscaled = "" if self.um_per_px.value else f"{largest} without um per pixel; give --um-per-px"
        return RadiusCurve(self.time, radius, sigma, labels, unscaled=unscaled, warnings=self.warnings)


class MeasureOptions(TypedDict, total=False):
    """Options of `measure`."""

    frame_rate: float | None
    um_per_px: float | None
    exposure: float | None
    polarity: str
    roi: tuple[int, int, int, int] | None
    reference_frame: int | None
    span: tuple[int, int] | None
    exclude: str | Iterable[int] | None
    begin: Callable[[int], Callable[[], None]]


def measure(
    path: Path,
    *,
    frame_rate: float | None = None,
    um_per_px: float | None = None,
    exposure: float | None = None,
    polarity: str = "auto",
    roi: tuple[int, int, int, int] | None = None,
    reference_frame: int | None = None,
    span: tuple[int, int] | None = None,
    exclude: str | Iterable[int] | None = None,
    begin: Callable[[int], Callable[[], None]] = lambda count: lambda: None,
) -> Measurement:
    """Measure a recording; options as of `cavirheo.measure`. begin: told the number of frames, it gives what is called
    after each. Raises InputError, and what libraries raise of damaged files."""
    for name, value in (("frame_rate", frame_rate), ("um_per_px", um_per_px), ("exposure", exposure)):
        fine = value is None or (isinstance(value, int | float) and 0 < value < float("inf"))
        require(fine, f"{name} must be a positive number, got {value!r}", f"video.{name}")
    whole = frames.read(path)
    counted = whole.frame_rate, "the camera's header"
    if whole.time is not None:
        counted = float(1.0 / np.median(np.diff(whole.time))), "the camera's time stamps"
    by_camera = {
        "frames per second": (frame_rate, *counted),
        "seconds of exposure": (exposure, whole.exposure, "the camera's header"),
        "um per pixel": (um_per_px, whole.um_per_px, "the resolution stored by ImageJ"),
    }
    rate, shutter, scale = starmap(_stated, by_camera.values())
    differ = [
        Message("check_input.camera_differs", {"given": stated, "what": what, "origin": origin, "value": value})
        for what, (stated, value, origin) in by_camera.items()
        if stated and value and abs(stated / value - 1.0) > _DIFFERS
    ]
    if rate.value is None:
        raise InputError(_NO_RATE, "video.frame_rate")
    FRAME_RATE.check("the frame rate", rate.value, "video.frame_rate")
    count, height, width = whole.frames.shape
    time = np.arange(count) / rate.value if whole.time is None or frame_rate else whole.time
    first, last = span or (1, count)
    footage, region = whole.part(first, last), roi or (0, 0, width, height)
    footage = replace(footage, frames=_region(footage.frames, region))
    fine = reference_frame is None or first <= reference_frame <= last
    require(fine, f"reference frame {reference_frame} is not within {first}:{last}", "video.reference_frame")
    between = float(np.median(np.diff(time)))
    exposed = shutter.value / between if shutter.value else None
    longer = f"{1e6 * (shutter.value or 0):.4g} us is longer than the {1e6 * between:.4g} us between frames"
    require(not exposed or exposed <= 1.001, f"an exposure of {longer}", "video.exposure")
    stage = set_stage(footage, polarity, reference_frame and reference_frame - first + 1)
    track = follow(stage, exposed, begin(len(footage.frames)))
    options = {
        "polarity": "dark" if stage.depth > 0 else "bright",
        "roi": roi,
        "frames": f"{first}:{last}",
        "reference_frame": reference_frame,
        "frames_without_bubble": stage.empty,
    }
    warnings = [*whole.warnings, *differ]
    measured = int(np.isfinite(track.radius).sum())
    if track.twins >= _TWINS * measured:
        warnings.append(Message("check_input.two_bubbles", {"frames": track.twins, "measured": measured}))
    if stage.depth > 0 and np.mean(stage.reference >= 0.995 * stage.frames.max()) > _BURNT:
        warnings.append(Message("check_input.overexposed"))
    numbers = time[first - 1 : last], rate, scale, shutter
    measurement = Measurement(track, footage, *numbers, options, tuple(warnings), first, region[:2])
    return measurement if exclude is None else measurement.without(exclude)


def _stated(stated: float | None, value: float | None, origin: str) -> StatedNumber:
    """The number that counts, the user's before the camera's."""
    if stated is not None:
        return StatedNumber(value=stated, origin="the user")
    return StatedNumber(value=value, origin=origin) if value else StatedNumber()


def _region(images: frames.Pixels, roi: tuple[int, int, int, int]) -> frames.Pixels:
    (x, y, width, height), (high, wide) = roi, images.shape[1:]
    inside = min(x, y) >= 0 and min(width, height) >= 16 and x + width <= wide and y + height <= high
    message = f"region {x},{y},{width},{height} of frames of {wide} x {high} pixels"
    require(inside, f"{message}; give x,y,width,height within them, at least 16 x 16", "video.roi")
    return images[:, y : y + height, x : x + width]
