"""Measure a recording: radii in metres over times in seconds, and the origin of every number; and draw its frames with
their circles."""

from __future__ import annotations

import io
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from math import floor
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, parse_number_list, require
from cavirheo.landmarks import median_where_large
from cavirheo.messages import Message, aspherical_warnings, camera_warnings
from cavirheo.parameters import FRAME_RATE
from cavirheo.video import formats
from cavirheo.video.formats import Footage
from cavirheo.video.stage import set_stage
from cavirheo.video.track import FLAGS, USED, Track, follow
from cavirheo.writing import digits
from cavirheo.writing.document import Finite, Record

if TYPE_CHECKING:
    from PIL import Image

COLOURS = {  # of flags in pictures, from the palette of Okabe and Ito; all others are grey
    "ok": "#56b4e9",
    "small": "#009e73",
    "arc": "#f0e442",
    "reversal": "#d55e00",
    "spike": "#cc79a7",
    **dict.fromkeys(("poor", "faint", "elsewhere", "lost"), "#e69f00"),
}
GREY = "#999999"
_SHEET_WIDTH, _LABEL_HEIGHT, _GAP = 1600, 13, 4  # px, of the contact sheet
_FRAME_SIZE = (190, 150)  # px, largest width and height of a frame in the sheet
_MOST_FRAMES = 400  # most frames in the sheet
_PIXEL = 1e-6  # m, placeholder for the size of a pixel until the scale is known
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
    for name in ("frame_rate", "um_per_px", "exposure"):
        value = options.get(name)
        fine = value is None or (isinstance(value, int | float) and 0 < value < float("inf"))
        require(fine, f"{name} must be a positive number, got {value!r}", f"video.{name}")
    for name, count in {"roi": 4, "span": 2}.items():
        fine = options.get(name) is None or np.shape(options[name]) == (count,)  # type: ignore[literal-required]
        require(fine, f"{name} must be {count} numbers, got {options.get(name)!r}", f"video.{name}")
    whole = formats.read(path)
    metadata = "the camera's header" if path.suffix.lower() in formats.CAMERA_ENDINGS else "the metadata of the file"
    camera_rate = whole.frame_rate, metadata
    if whole.time is not None:
        camera_rate = float(1.0 / np.median(np.diff(whole.time))), "the camera's time stamps"
    rate, of_rate = _stated(options.get("frame_rate"), "frames per second", *camera_rate)
    shutter, of_shutter = _stated(options.get("exposure"), "seconds of exposure", whole.exposure, metadata)
    scale, of_scale = _stated(options.get("um_per_px"), "um per pixel", whole.um_per_px, metadata)
    warnings = [*whole.warnings, *of_rate, *of_shutter, *of_scale]
    count, height, width = whole.frames.shape
    per_second = _checked_rate(rate)
    time = np.arange(count) / per_second if whole.time is None or options.get("frame_rate") else whole.time
    first, last = options.get("span") or (1, count)
    region = options.get("roi") or (0, 0, width, height)
    footage = _cropped(whole, first, last, region)
    exposed_share = _exposed_share(shutter, rate, float(np.median(np.diff(time))))
    stage = set_stage(footage, options.get("polarity", "auto"))
    listed = options.get("exclude")
    excluded = [] if listed is None else parse_number_list(listed, "frames to exclude", "video.exclude", first, last)
    require(len(excluded) < last - first + 1, "all frames are excluded", "video.exclude")
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
    shape = np.nan_to_num(track.asphericity)  # 0 where too little of the outline is seen
    warnings += aspherical_warnings(median_where_large(track.radius, 2.0 * shape / (1.0 + shape)))
    if stage.depth > 0 and np.mean(stage.reference >= 0.995 * stage.frames.max()) > _SATURATED_SHARE:
        warnings.append(Message("check_input.overexposed"))
    time, corner = time[first - 1 : last], region[:2]
    return Measurement(track, footage, time, rate, scale, shutter, settings, tuple(warnings), first, corner)


def _stated(
    by_user: float | None, what: str, value: float | None, origin: str
) -> tuple[StatedNumber, tuple[Message, ...]]:
    """The number of the user, else that of the camera, which comes from `origin`; and a warning if they differ."""
    if by_user is None:
        return StatedNumber(value=value, origin=origin) if value else StatedNumber(), ()
    warnings = camera_warnings(by_user, value, what, origin) if value else ()
    return StatedNumber(value=by_user, origin="the user"), warnings


def _checked_rate(rate: StatedNumber) -> float:
    """The frame rate. Raises InputError: it is not known, or that of no bubble."""
    if rate.value is None:
        raise InputError(f"{_NO_RATE}; give it (--fps; in Python frame_rate=)", "video.frame_rate")
    if rate.origin != "the user" and rate.value < FRAME_RATE.low:
        message = f"{rate.value:g} frames per second by {rate.origin}: expected {FRAME_RATE.low:g} or more of a bubble"
        advice = "if the file is wrong, give the rate (--fps; in Python frame_rate=)"
        raise InputError(f"{message}; {advice}", "video.frame_rate")
    FRAME_RATE.check("the frame rate", rate.value, "video.frame_rate")
    return rate.value


def _exposed_share(shutter: StatedNumber, rate: StatedNumber, interval: float) -> float:
    """The exposure over the time between frames, s; 1 if it is not known. Raises InputError: it is longer."""
    if not shutter.value:
        return 1.0
    if shutter.value > 1.001 * interval:
        longer = f"{1e6 * shutter.value:.4g} us by {shutter.origin}"
        longer += f" is longer than the {1e6 * interval:.4g} us between frames by {rate.origin}"
        advice = "give the right ones (--fps, --exposure-us; in Python frame_rate=, exposure=)"
        raise InputError(f"an exposure of {longer}: {advice}", "video.exposure")
    return shutter.value / interval


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


def contact_sheet(measurement: Measurement) -> Image.Image:
    """Draw all frames in one picture, or evenly spaced ones if there are very many, each below its number, flag and
    radius in px."""
    from PIL import Image, ImageDraw

    images, track = measurement.recording.frames, measurement.track
    count, height, width = images.shape
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_FRAMES)).astype(int))
    scale = min(_FRAME_SIZE[0] / width, _FRAME_SIZE[1] / height)
    cell = int(width * scale), int(height * scale) + _LABEL_HEIGHT
    columns = _SHEET_WIDTH // _FRAME_SIZE[0]
    rows = -(-len(chosen) // columns)
    sheet = Image.new("RGB", (columns * (cell[0] + _GAP) + _GAP, rows * (cell[1] + _GAP) + _GAP), "white")
    usual = np.flatnonzero(np.isin(track.flags, ("flash", "dark"), invert=True))
    some = images[usual[:: max(count // 40, 1)], ::3, ::3] if len(usual) else images
    black, white = map(float, np.percentile(some, (0.5, 99.5)))
    for k, i in enumerate(chosen):
        colour = COLOURS.get(str(track.flags[i]), GREY)
        words = f"{measurement.first + i} {track.flags[i]}"
        words += f" {track.radius[i]:.1f}" if np.isfinite(track.radius[i]) else ""
        grey = (images[i].astype(np.float32) - black) * (235.0 / (max(white, black + 1.0) - black))
        labelled = Image.new("RGB", cell, "#222222")
        labelled.paste(
            _with_circle(np.clip(grey, 0, 255).astype(np.uint8), track, i, scale, colour), (0, _LABEL_HEIGHT)
        )
        ImageDraw.Draw(labelled).text((2, 0), words, fill=colour)
        sheet.paste(labelled, (_GAP + k % columns * (cell[0] + _GAP), _GAP + k // columns * (cell[1] + _GAP)))
    return sheet


def _with_circle(grey: np.ndarray, track: Track, i: int, scale: float, colour: str) -> Image.Image:
    """Draw frame i, given in grey, at this scale with its circle, or with a border if there is no radius."""
    from PIL import Image, ImageDraw

    size = int(grey.shape[1] * scale), int(grey.shape[0] * scale)
    picture = Image.fromarray(grey).resize(size, Image.Resampling.BILINEAR).convert("RGB")
    draw = ImageDraw.Draw(picture)
    x, y, r = scale * float(track.x[i] + 0.5), scale * float(track.y[i] + 0.5), scale * float(track.radius[i])
    if np.isfinite(r):
        box = [floor(end) for end in (x - r, y - r, x + r, y + r)]
        draw.ellipse(box, outline=colour, width=max(round(scale), 1))
    else:
        draw.rectangle((0, 0, size[0] - 1, size[1] - 1), outline=colour)
    return picture


def data_url(picture: Image.Image) -> str:
    """Return a picture as a data URL (JPEG) that a web page can show."""
    file = io.BytesIO()
    picture.save(file, "jpeg", quality=60)
    return f"data:image/jpeg;base64,{b64encode(file.getvalue()).decode()}"
