"""Measure a recording: radii in metres over times in seconds, and the origin of every number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, parse_number_list, require
from cavirheo.messages import Message
from cavirheo.parameters import FRAME_RATE
from cavirheo.video import formats
from cavirheo.video.formats import Footage
from cavirheo.video.stage import set_stage
from cavirheo.video.track import FLAGS, USED, Track, follow
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Record

_PIXEL = 1e-6  # m, placeholder for the size of a pixel until the scale is known
_TOLERANCE = 0.01  # relative; if the user's number differs by more from the file's, a warning says so
_TWIN_SHARE = 0.2  # share of the measured frames; a second bubble in so many gives a warning
_LEAST_ARC = 0.9  # share of the outline at R_max; if less is visible, a note says so
_SATURATED_SHARE = 0.3  # share of the background at the brightest value, above which a warning is given
_NO_RATE = "how fast it was recorded is not known, for a video file states how fast it is played"


class StatedNumber(Record):
    """A number that the frames do not show, and its origin.

    Attributes:
        value: the number, in SI, or in um for um_per_px; null where it is not known.
        origin: who states the number: "the user", "the camera's header", ..., or "not known".
    """

    value: Finite = None
    origin: str = "not known"


@dataclass(frozen=True, eq=False)
class Measurement:
    """A measured recording. `track` is in pixels of the chosen region; `corner` is the (x, y) of this region.

    time: (n,) s since the first frame of the recording. first: number of the first chosen frame, from 1.
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
    def last(self) -> int:
        """Number of the last chosen frame, from 1."""
        return self.first + len(self.time) - 1

    @property
    def counts(self) -> dict[str, int]:
        """Number of frames by flag, in the order of `FLAGS`."""
        counter = Counter(self.track.flags.tolist())
        return {flag: counter[flag] for flag in FLAGS if counter[flag]}

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes of the recording, and what is unusual besides the flags."""
        notes = [*self.recording.notes]
        if listed := self.options.get("exclude"):
            notes.append(f"excluded by hand: frames {listed}")
        share = self.track.arc[int(np.nanargmax(self.track.radius))]
        if share < _LEAST_ARC:
            notes.append(f"at R_max {100 * share:.0f} % of the outline is within the frame")
        if self.exposure.value is None:
            notes.append("exposure not known: taken as the time between frames")
        return tuple(notes)

    def curve(self, **meta: Any) -> RadiusCurve:
        """Return the radius history; unused frames are NaN, and `meta` has the (n,) `flags`. Raises InputError."""
        pixel = (self.um_per_px.value or 1.0) * _PIXEL
        used = f"{np.isin(self.track.flags, USED).sum()} of {len(self.track.flags)} frames measured"
        usual = ("ok", "before", "excluded")
        unusual = [f"{n} {flag} ({FLAGS[flag]})" for flag, n in self.counts.items() if flag not in usual]
        notes = (*self.notes, used, *unusual)
        labels = {"notes": notes, "flags": tuple(self.track.flags.tolist()), "video": True, **meta}
        numbers = {"frame_rate_hz": self.frame_rate.value, "exposure_s": self.exposure.value}
        labels |= {name: value for name, value in numbers.items() if value}
        radius, sigma = self.track.radius * pixel, self.track.sigma * pixel
        largest = f"the radius is in pixels (largest {np.nanmax(self.track.radius):.4g})"
        unscaled = "" if self.um_per_px.value else f"{largest} without um per pixel (--um-per-px)"
        return RadiusCurve(self.time, radius, sigma, labels, unscaled=unscaled, warnings=self.warnings)


class MeasureOptions(TypedDict, total=False):
    """Options of `measure`. progress: takes the number of frames, and gives a context of the function to call after
    each."""

    frame_rate: float | None
    um_per_px: float | None
    exposure: float | None
    polarity: str
    roi: tuple[int, int, int, int] | None
    span: tuple[int, int] | None
    exclude: str | Iterable[int] | None
    progress: Callable[[int], AbstractContextManager[Callable[[], None]]]


def measure(path: Path, **options: Unpack[MeasureOptions]) -> Measurement:
    """Measure a recording; options as of `cavirheo.measure`. Raises InputError, and any exception of the libraries for
    damaged files."""
    frame_rate = options.get("frame_rate")
    um_per_px = options.get("um_per_px")
    exposure = options.get("exposure")
    for name, value in (("frame_rate", frame_rate), ("um_per_px", um_per_px), ("exposure", exposure)):
        fine = value is None or (isinstance(value, int | float) and 0 < value < float("inf"))
        require(fine, f"{name} must be a positive number, got {value!r}", f"video.{name}")
    whole = formats.read(path)
    metadata = "the camera's header" if path.suffix.lower() in formats.CAMERA_ENDINGS else "the metadata of the file"
    camera_rate = whole.frame_rate, metadata
    if whole.time is not None:
        camera_rate = float(1.0 / np.median(np.diff(whole.time))), "the camera's time stamps"
    given = (
        ("frames per second", frame_rate, *camera_rate),
        ("seconds of exposure", exposure, whole.exposure, metadata),
        ("um per pixel", um_per_px, whole.um_per_px, metadata),
    )
    warnings = [*whole.warnings, *_contradictions(given)]
    rate, shutter, scale = (_stated(by_user, value, origin) for _, by_user, value, origin in given)
    if rate.value is None:
        raise InputError(f"{_NO_RATE}; give it (--fps; in Python frame_rate=)", "video.frame_rate")
    FRAME_RATE.check("the frame rate", rate.value, "video.frame_rate")
    count, height, width = whole.frames.shape
    time = np.arange(count) / rate.value if whole.time is None or frame_rate else whole.time
    first, last = options.get("span") or (1, count)
    region = options.get("roi") or (0, 0, width, height)
    footage = _cropped(whole, first, last, region)
    interval = float(np.median(np.diff(time)))
    exposed_share = shutter.value / interval if shutter.value else 1.0
    if shutter.value and shutter.value > 1.001 * interval:
        longer = f"{1e6 * shutter.value:.4g} us is longer than the {1e6 * interval:.4g} us between frames"
        raise InputError(f"an exposure of {longer}", "video.exposure")
    stage = set_stage(footage, options.get("polarity", "auto"))
    excluded = _excluded(options.get("exclude"), first, last)
    stage = replace(stage, kinds=np.where(np.isin(np.arange(first, last + 1), excluded), "excluded", stage.kinds))
    progress = options.get("progress", lambda _: nullcontext(lambda: None))
    with progress(len(footage.frames)) as advance:
        track = follow(stage, exposed_share, advance)
    settings = {
        "polarity": "dark" if stage.depth > 0 else "bright",
        "roi": options.get("roi"),
        "frames": f"{first}:{last}",
        "frames_without_bubble": stage.empty,
    }
    if excluded:
        settings["exclude"] = digits.number_ranges(excluded)
    measured = int(np.isfinite(track.radius).sum())
    if track.twins >= _TWIN_SHARE * measured:
        warnings.append(Message("check_input.two_bubbles", {"frames": track.twins, "measured": measured}))
    if stage.depth > 0 and np.mean(stage.reference >= 0.995 * stage.frames.max()) > _SATURATED_SHARE:
        warnings.append(Message("check_input.overexposed"))
    time, corner = time[first - 1 : last], region[:2]
    return Measurement(track, footage, time, rate, scale, shutter, settings, tuple(warnings), first, corner)


def _excluded(text: str | Iterable[int] | None, first: int, last: int) -> list[int]:
    """The frames from `first` to `last` that a list excludes. Raises InputError: no such list, or all of them."""
    listed = [] if text is None else list(parse_number_list(text, "frames to exclude", "video.exclude", first, last))
    require(len(listed) < last - first + 1, "all frames are excluded", "video.exclude")
    return listed


def _stated(by_user: float | None, value: float | None, origin: str) -> StatedNumber:
    """The number of the user, or that of the camera, which comes from `origin`."""
    if by_user is not None:
        return StatedNumber(value=by_user, origin="the user")
    return StatedNumber(value=value, origin=origin) if value else StatedNumber()


def _contradictions(given: Iterable[tuple[str, float | None, float | None, str]]) -> Iterator[Message]:
    """A warning for each (what, number of the user, number of the camera, its origin) whose numbers differ."""
    for what, by_user, value, origin in given:
        if by_user and value and abs(by_user / value - 1.0) > _TOLERANCE:
            differ = {"given": by_user, "what": what, "origin": origin, "value": value}
            yield Message("check_input.camera_differs", differ)


def _cropped(whole: Footage, first: int, last: int, roi: tuple[int, int, int, int]) -> Footage:
    """Return a region of the frames `first` to `last`, counted from 1."""
    (x, y, width, height), (count, high, wide) = roi, whole.frames.shape
    if not 1 <= first < last <= count:
        message = f"frames {first}:{last} were asked for; the recording has 1:{count}, and two are needed"
        raise InputError(message, "video.frames")
    if min(x, y) < 0 or min(width, height) < 16 or x + width > wide or y + height > high:
        message = f"region {x},{y},{width},{height} of frames of {wide} x {high} pixels"
        raise InputError(f"{message}; give x,y,width,height within them, at least 16 x 16", "video.roi")
    chosen = slice(first - 1, last)
    frames = whole.frames[chosen, y : y + height, x : x + width]
    return replace(whole, frames=frames, time=None, damaged=whole.damaged[chosen])
