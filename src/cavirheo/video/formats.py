"""Read the frames of recordings into memory, with the time and scale that the file itself states.

The frame rate of a video container is for playback and is never taken as the camera's. Pixels have 8 or 16 bits.
"""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from itertools import islice, pairwise
from os.path import isdir  # also works for names that no file can have
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from cavirheo.arrays import Bools, Floats
from cavirheo.errors import InputError, listed, read_bytes, require
from cavirheo.messages import Message
from cavirheo.parameters import FRAME_RATE, LENGTH_UNITS, TIME_UNITS, unit_of
from cavirheo.writing.export import import_optional

Pixels = NDArray[Any]  # unsigned integers of 8 or 16 bits

EXTRA = "cavirheo[video]"  # the libraries that recordings need
MOVIE_ENDINGS = (".mp4", ".avi", ".mkv", ".mov", ".gif", ".webm")
STACK_ENDINGS = (".tif", ".tiff")
IMAGE_ENDINGS = (".png", ".bmp", ".jpg", ".jpeg", ".pgm")  # a folder of them is a recording
PIXELS_ENDING, HEADER_ENDINGS = ".mraw", (".cihx", ".cih")  # the two files of one film, in one folder
CAMERA_ENDINGS = (".cine", PIXELS_ENDING, *HEADER_ENDINGS)
ENDINGS = frozenset((*MOVIE_ENDINGS, *STACK_ENDINGS, *CAMERA_ENDINGS))
LARGEST_SIZE = 2_500_000_000  # bytes of all frames in memory
_LARGEST_HEADER = 50_000_000  # most bytes of a camera's header
_LONGEST_STEP = 100.0  # median steps; a longer one is a wrong time stamp
_STAMP_TOLERANCE = 0.1  # of a frame interval; time stamps this close to even spacing are made evenly spaced
_GREY_TOLERANCE = 12  # of 255 levels; after compression the channels of a grey picture differ by up to this
_COLOUR_NOTE = "a colour recording: its brightness is measured"
_FFMPEG = {  # without playlists, which would open other files
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,gif,cine",
    "protocol_whitelist": "file",
}
_MINUS = r"(?<![^\W_])-"  # in the name of an image, after no letter or digit
_STAMPS, _EXPOSURES = 1002, 1003  # blocks of a .cine file: time and exposure of every frame


@dataclass(frozen=True, eq=False)
class Footage:
    """The frames of a recording, and what its file states; all but `frames` may be missing.

    frames: (n, height, width). time: (n,) s since the first frame, by the camera's stamps. frame_rate (1/s) and
    exposure (s): of the camera's header. damaged: (n,) whether a frame is incomplete. notes: what was found. warnings:
    what is wrong with the file.
    """

    frames: Pixels
    time: Floats | None = None
    frame_rate: float | None = None
    exposure: float | None = None
    um_per_px: float | None = None
    damaged: Bools = field(default_factory=lambda: np.empty(0, bool))
    notes: tuple[str, ...] = ()
    warnings: tuple[Message, ...] = ()


def is_video(path: Path) -> bool:
    """Whether a path is a recording: a folder of images, or a file with the ending of a video."""
    return bool(_images(path)) if isdir(path) else path.suffix.lower() in ENDINGS


def read(path: Path) -> Footage:
    """Read the frames of a file or a folder of images.

    Raises InputError, or any exception of the libraries for a damaged file.
    """
    footage = _reader(path)(path)
    shape = footage.frames.shape
    require(len(shape) == 3 and shape[0] > 0, f"no frame in it (shape {shape})", "video.no_frames")
    if min(shape[1:]) < 16:
        raise InputError(f"frames of {shape[2]} x {shape[1]} pixels; at least 16 x 16 are needed", "video.small")
    require(shape[0] > 1, "one frame is no recording: a bubble must be seen to grow and collapse", "video.one_frame")
    return footage if len(footage.damaged) else replace(footage, damaged=np.zeros(shape[0], bool))


def _reader(path: Path) -> Callable[[Path], Footage]:
    if path.is_dir():
        return _read_folder
    if (ending := path.suffix.lower()) in (PIXELS_ENDING, *HEADER_ENDINGS):
        return _read_mraw
    with path.open("rb") as file:
        head = file.read(4)
    if ending == ".cine" and head[:2] == b"CI":
        return _read_cine
    return _read_stack if head in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+") else _read_movie


def _read_movie(path: Path) -> Footage:
    av = import_optional("av", EXTRA)
    av.logging.set_level(av.logging.PANIC)
    notes, warnings, damaged, stamps, stated = list[str](), list[Message](), list[bool](), list[int](), 0.0

    def decoded() -> Iterator[Pixels]:
        nonlocal stated
        try:
            with av.open(str(path), options=_FFMPEG) as container:
                require(bool(container.streams.video), "no video in it", "video.no_frames")
                stream = container.streams.video[0]
                deep = max((part.bits for part in stream.format.components), default=8) > 8 if stream.format else False
                lasts = (container.duration or 0) / av.time_base * float(stream.average_rate or 0)
                stated = stream.frames or 0.98 * lasts - 1.0
                for frame in container.decode(stream):
                    if not damaged:
                        ranges = np.ptp(frame.to_ndarray(format="rgb24")[::2, ::2].astype(np.int16), axis=2)
                        if np.percentile(ranges, 90) > _GREY_TOLERANCE:
                            notes.append(_COLOUR_NOTE)
                    image = frame.to_ndarray(format="gray16le" if deep else "gray")
                    damaged.append(bool(frame.is_corrupt))
                    stamps.append(frame.pts or 0)
                    yield image
        except av.error.FFmpegError as error:
            require(bool(damaged), f"no frame of a video can be decoded ({error.strerror})", "video.undecodable")
            warnings.append(Message("check_input.file_damaged", {"frames": len(damaged), "cause": error.strerror}))

    frames = _join_frames(decoded())
    if not warnings and len(damaged) < stated:
        warnings.append(_cut_short_warning(len(damaged), stated, "about "))
    steps = np.diff(stamps)
    if len(steps) and np.max(steps) > 1.9 * np.median(steps) + 1.0:
        warnings.append(Message("check_input.frames_uneven", {"steps": int(np.sum(steps > 1.9 * np.median(steps)))}))
    bad = np.array(damaged, bool)
    notes += [f"{bad.sum()} damaged frames are left out"] if bad.any() else []
    return Footage(frames, damaged=bad, notes=tuple(notes), warnings=tuple(warnings))


def _join_frames(frames: Iterable[Pixels]) -> Pixels:
    """Join frames to (n, height, width), without a second copy in memory. Raises InputError: too large, or mixed."""
    content, first = bytearray(), np.empty((0, 0))
    for frame in frames:
        first = first if content else frame
        if frame.shape != first.shape or frame.dtype != first.dtype:
            sizes = f"{frame.shape[::-1]} after {first.shape[::-1]}"
            raise InputError(f"the frames are of several sizes or kinds: {sizes}", "video.sizes")
        _check_size(len(content) + frame.nbytes)
        content += frame.tobytes()
    return np.frombuffer(content, first.dtype).reshape(-1, *first.shape)


def _check_size(size: float) -> None:
    if size > LARGEST_SIZE:
        why = f"its frames are more than {LARGEST_SIZE / 1e9:g} GB; cut the recording to the bubble and save that"
        raise InputError(why, "video.too_large")


def _grey(image: Pixels) -> Pixels:
    """Return the (height, width) brightness, with as many bits; an alpha channel is left out."""
    if image.ndim == 2:
        return image
    if image.shape[0] in (3, 4) and image.shape[-1] > 4:  # one plane per colour
        image = np.moveaxis(image, 0, -1)
    colours = image[..., :3] if image.shape[-1] >= 3 else image[..., :1]
    weights = np.array([0.299, 0.587, 0.114]) if colours.shape[-1] == 3 else np.ones(1)
    return np.rint(colours @ weights).astype(image.dtype)


def _read_stack(path: Path) -> Footage:
    tifffile = import_optional("tifffile", EXTRA)
    logging.getLogger("tifffile").addHandler(logging.NullHandler())  # what is wrong is said once, by the error
    with tifffile.TiffFile(path) as file:
        first, count = file.pages[0], len(file.pages)
        scale, rate = _stated_by_stack(file)
        several = list[str]()
        with suppress(Exception):  # tifffile raises nearly anything for a damaged description
            series = file.series[0]
            count = max(count, (file.imagej_metadata or {}).get("images", 1), series.size // first.size)
            several = [axis for axis, n in zip(series.axes, series.shape, strict=True) if axis not in "YXS" and n > 1]
        _check_size(count * float(first.nbytes))
        if len(several) > 1:
            kinds = f"a stack along {' and '.join(several)} (T: times, C: channels, Z: depths)"
            raise InputError(f"{kinds}: save one channel and one depth alone", "video.stack")
        notes = [_COLOUR_NOTE] if getattr(first, "samplesperpixel", 1) > 2 else []
        notes += [f"the file states {scale:.4g} um per pixel"] if scale else []
        try:
            images, warnings = _stack_frames(file, count)
        except (ValueError, ImportError):  # a compression that needs another library
            images, warnings = _until_damage(_pillow_images(path))
    images = images.reshape(-1, *images.shape[-2:])
    return Footage(_unsigned(images), frame_rate=rate, um_per_px=scale, notes=tuple(notes), warnings=tuple(warnings))


def _stack_frames(file: Any, stated: int) -> tuple[Pixels, list[Message]]:
    """Return the brightness of the frames of a TIFF, as far as they are there, and a warning of what is missing."""
    first = file.pages[0]
    source = file.filehandle
    source.seek(file.pages.next_page_offset)
    cause = "the next one is missing" if any(source.read(file.tiff.offsetsize)) else ""
    if len(file.pages) == 1 < stated + bool(cause) and first.is_contiguous:  # one block, as of large stacks of ImageJ
        there = (source.size - first.dataoffsets[0]) // first.nbytes
        there = min(there, stated) if stated > 1 else there
        block = source.read_array(first.dtype.newbyteorder(file.byteorder), there * first.size, first.dataoffsets[0])
        frames = _join_frames(map(_grey, block.astype(first.dtype).reshape(there, *first.shape)))
        warnings = _damage_warnings(len(frames), cause)
    else:
        frames, warnings = _until_damage((_grey(page.asarray()) for page in file.pages), cause)
    if not len(frames) < stated > len(file.pages):
        return frames, warnings
    files = {*re.findall(r"""<(?:\w+:)?UUID FileName=["'](.*?)["']""", file.ome_metadata or "")}
    if len(files) < 2:
        return frames, [_cut_short_warning(len(frames), stated)]
    return frames, [Message("check_input.file_of_set", {"stated": stated, "files": len(files)}), *warnings]


def _until_damage(frames: Iterator[Pixels], cause: str = "") -> tuple[Pixels, list[Message]]:
    """Join frames as far as they can be read, with a warning if that, or a known cause, ends them early. Raises any
    error of the first one."""

    def readable() -> Iterator[Pixels]:
        nonlocal cause
        first = True
        try:
            for frame in frames:
                yield frame
                first = False
        except Exception as error:
            if first:
                raise
            cause = str(error)

    joined = _join_frames(readable())
    return joined, _damage_warnings(len(joined), cause)


def _damage_warnings(frames: int, cause: str) -> list[Message]:
    return [Message("check_input.file_damaged", {"frames": frames, "cause": cause})] if cause else []


def _stated_by_stack(file: Any) -> tuple[float | None, float | None]:
    """Return (um per pixel, frames per second) as the description of OME or ImageJ states them, but no rate at which a
    stack is played."""
    if file.ome_metadata:
        pixels = ElementTree.fromstring(file.ome_metadata).find(".//{*}Pixels")
        stated: Any = {} if pixels is None else pixels.attrib
        size, unit = stated.get("PhysicalSizeX"), stated.get("PhysicalSizeXUnit", "um")
        interval = _in_si(stated.get("TimeIncrement"), stated.get("TimeIncrementUnit", "s"), TIME_UNITS)
    else:
        stated, tag = file.imagej_metadata or {}, file.pages[0].tags.get("XResolution")
        size, unit = (tag.value[1] / tag.value[0] if tag and tag.value[0] else None), str(stated.get("unit", "pixel"))
        interval = _in_si(stated.get("finterval"), str(stated.get("tunit", "s")), TIME_UNITS)
    recorded = 0.0 < interval < 1.0 / FRAME_RATE.low
    return 1e6 * _in_si(size, unit, LENGTH_UNITS) or None, 1.0 / interval if recorded else None


def _in_si(number: Any, unit: str, units: Mapping[str, float]) -> float:
    """Return a positive number with a unit, however it is spelled, in SI; 0 for anything else."""
    name = unit_of(unit.lower().replace(r"\u00b5", "u"), units)
    with suppress(TypeError, ValueError):
        return max(float(number), 0.0) * units[name] if name else 0.0
    return 0.0


def _pillow_images(path: Path, count: int | None = None) -> Iterator[Pixels]:
    """Yield the brightness of the first `count` images in a file (None: all)."""
    import_optional("PIL", EXTRA)
    from PIL import Image, ImageSequence

    with Image.open(path) as image:
        for page in islice(ImageSequence.Iterator(image), count):
            yield _grey(np.asarray(page.convert("RGB") if page.mode in ("P", "CMYK", "YCbCr") else page))


def _unsigned(images: Pixels) -> Pixels:
    """Return integers of 8 or 16 bits. Raises InputError: other numbers, which software computed."""
    if images.dtype in (np.uint8, np.uint16):
        return images
    if images.dtype.kind not in "biu" or images.min() < 0 or images.max() >= 2**16:
        message = f"pixels of {images.dtype}: expected the grey levels of a camera, 8 or 16 bits without a sign"
        raise InputError(f"{message}; save the recording as one of these", "video.pixels")
    return images.astype(np.uint16)


def _read_folder(path: Path) -> Footage:
    images = _images(path)
    if not images:
        expected = f"expected at least 3 images of one kind ({', '.join(IMAGE_ENDINGS + STACK_ENDINGS)})"
        raise InputError(f"no recording in this folder; {expected}", "video.no_images")
    names = _split_at_numbers(images)
    _check_names(names.values())
    frames = _join_frames(frame for image in names for frame in _pillow_images(image, 1))
    first, *_, last = names
    note = f"{len(names)} images of a folder in natural order, {first.name} to {last.name}"
    gaps = _gaps_in_numbers(names.values())
    warnings = (Message("check_input.images_missing", {"gaps": gaps}),) if gaps else ()
    return Footage(_unsigned(frames), notes=(note,), warnings=warnings)


def _check_names(names: Iterable[list[str]]) -> None:
    """Raise InputError if images have several names, apart from their numbers, and count over each other's last ones:
    these are several recordings. The names are split at their numbers."""
    last_numbers = defaultdict[str, list[int]](list)  # by name
    for *before, end in names:
        if before[-2:-1] == ["."]:  # a decimal number
            del before[-2:]
        if before:
            last_numbers["#".join(before[::2]) + end].append(int(before[-1]))
    several = {name: numbers for name, numbers in last_numbers.items() if len(numbers) > 2}  # as many as a recording
    ranges = sorted((min(numbers), max(numbers)) for numbers in several.values())
    if any(start <= end for (_, end), (start, _) in pairwise(ranges)):
        named = f"the images have {len(several)} names, {listed(name or 'numbers alone' for name in several)}"
        raise InputError(f"{named}: give each recording a folder", "video.names")


def _split_at_numbers(images: Sequence[Path]) -> dict[Path, list[str]]:
    """Return the name of each image as [text, number, ..., text], in natural order (frame 2 before frame 10). A minus
    is a sign if the same name has a number without it too, as frame_-1 where frame_0 is; else it is a dash."""
    forms = {re.sub(r"\d+", "0", image.stem) for image in images}
    names = []
    for image in images:
        sign = _MINUS if re.sub(rf"({_MINUS})?\d+", "0", image.stem) in forms else ""
        parts = re.split(rf"((?:{sign})?\d+)", image.stem)
        natural = [int(part) if k % 2 else part.casefold() for k, part in enumerate(parts)]
        names.append((natural, image, parts))
    return {image: parts for _, image, parts in sorted(names)}


def _gaps_in_numbers(names: Iterable[list[str]]) -> int:
    """Return how often names that end in numbers, most of them evenly spaced, leave numbers out."""
    numbers = [int(parts[-2][-18:]) for parts in names if len(parts) > 1]
    steps = np.diff(numbers)
    if len(steps) == 0 or np.any(steps <= 0):
        return 0
    usual = np.median(steps)
    return int(np.sum(steps > usual)) if np.mean(steps == usual) > 0.5 else 0


def _images(folder: Path) -> list[Path]:
    """Return the images with the commonest ending; none if they are fewer than three, or stacks of frames."""
    try:
        paths = [p for p in folder.iterdir() if p.name[0] != "." and p.suffix.lower() in IMAGE_ENDINGS + STACK_ENDINGS]
    except OSError:
        return []
    most = Counter(path.suffix.lower() for path in paths).most_common(1)
    chosen = [path for path in paths if path.suffix.lower() in dict(most) and path.is_file()]
    return chosen if len(chosen) > 2 and not _is_stack(min(chosen)) else []


def _is_stack(image: Path) -> bool:
    """Whether an image is a stack of frames, or a damaged TIFF."""
    if image.suffix.lower() not in STACK_ENDINGS or not find_spec("tifffile"):
        return False
    from tifffile import TiffFile

    try:
        with TiffFile(image) as file:
            return len(file.pages) != 1
    except Exception:  # tifffile raises nearly anything for a damaged file; the reader will report the error
        return True


def _read_cine(path: Path) -> Footage:
    """Read a Phantom film: FFmpeg decodes the pixels. The header (Vision Research, Cine File Format, 2011) has the
    frame rate that was set, and the actual exposure and time stamp of every frame."""
    movie = _read_movie(path)
    n = len(movie.frames)
    count, rate, blocks = _cine_header(path)
    notes, warnings = [*movie.notes], [*movie.warnings]
    if n < count:
        warnings.append(_cut_short_warning(n, count))
    time = exposure = None
    if len(blocks.get(_STAMPS, b"")) >= 8 * n and n > 1:
        parts, seconds = np.frombuffer(blocks[_STAMPS], "<u4")[: 2 * n].reshape(-1, 2).astype(np.float64).T
        time = (seconds - seconds[0]) + (parts - parts[0]) / 2**32
        steps = np.diff(time)
        right = (steps > 0) & (steps < _LONGEST_STEP * np.median(steps))
        usable = float(np.mean(right)) > 0.5
        stamped = 1.0 / float(np.mean(steps[right])) if usable else rate
        if not right.all():
            wrong = {"steps": int(np.sum(~right)), "frames": n, "rate": stamped}
            warnings.append(Message("check_input.time_stamps", wrong))
        if not usable:
            time = None
        else:
            if not right.all() or np.all(np.abs(time * stamped - np.arange(n)) < _STAMP_TOLERANCE):
                time = np.arange(n) / stamped  # stamps are rounded, often to 1 us
            notes.append(f"{stamped:.6g} frames per second by the time stamps of the .cine file")
            if rate and abs(stamped / rate - 1.0) > 0.01:
                warnings.append(Message("check_input.camera_clock", {"header": rate, "stamps": stamped}))
    if len(blocks.get(_EXPOSURES, b"")) >= 4 * n:
        exposure = float(np.median(np.frombuffer(blocks[_EXPOSURES], "<u4")[:n])) / 2**32 or None
    footage = replace(movie, time=time, frame_rate=rate or None, exposure=exposure)
    return replace(footage, notes=tuple(notes), warnings=tuple(warnings))


def _cine_header(path: Path) -> tuple[int, float, dict[int, bytes]]:
    """Return (number of frames, frame rate that was set, the blocks of numbers by their kind)."""
    with path.open("rb") as file:
        head = file.read(44)
        count, _, setup, images = struct.unpack_from("<4I", head, 20)
        require(44 <= setup < images <= _LARGEST_HEADER, "the header of the .cine file is damaged", "video.cine")
        head += file.read(images - 44)
    at = setup + struct.unpack_from("<H", head, setup + 142)[0]
    blocks = {}
    while at + 8 <= images:
        size, kind = struct.unpack_from("<IH", head, at)
        if size < 8:
            break
        blocks[kind] = head[at + 8 : at + size]
        at += size
    return count, float(struct.unpack_from("<I", head, setup + 768)[0]), blocks


def _cut_short_warning(frames: int, stated: float, precision: str = "") -> Message:
    return Message("check_input.file_cut_short", {"frames": frames, "stated": stated, "about": precision})


def pixels_of(path: Path) -> Path | None:
    """Return the path of the pixels that belong to a header, existing or not; None for any other file."""
    return path.with_suffix(PIXELS_ENDING) if path.suffix.lower() in HEADER_ENDINGS else None


def header_of(path: Path) -> Path | None:
    """Return the path of the header that belongs to pixels, existing or not; None for any other file."""
    headers = [path.with_suffix(ending) for ending in HEADER_ENDINGS]
    return next(filter(Path.exists, headers), headers[0]) if path.suffix.lower() == PIXELS_ENDING else None


def _read_mraw(path: Path) -> Footage:
    """Read a Photron film: raw pixels, described by a file of the same name, .cihx (XML) or .cih (lines)."""
    header = header_of(path) or path
    raw = pixels_of(path) or path
    for each in (header, raw):
        require(each.is_file(), f"{each.name} is missing beside it: pixels and header are two files", "video.mraw_pair")
    values = _photron_values(header)

    def number(place: str) -> int:
        text = values.get(place, "")
        require(text.isdecimal(), f"{header.name} lacks {place}", "video.cihx")
        return int(text)

    width, height, bits, stated = map(number, ("Image Width", "Image Height", "Color Bit", "Total Frame"))
    kind = values.get("Color Type", "")
    fine = bits in (8, 12, 16) and kind in ("Mono", "Raw", "")
    require(fine, f"{bits} bits of kind {kind!r}; expected grey pixels of 8, 12 or 16 bits", "video.mraw_bits")
    size = width * height
    _check_size(float(stated) * size * (2 if bits > 8 else 1))
    require(size > 0 and size * bits % 8 == 0, f"frames of {width} x {height} pixels", "video.mraw_bits")
    content = np.fromfile(raw, np.uint8, count=stated * size * bits // 8)
    n = len(content) * 8 // (size * bits)
    content = content[: n * size * bits // 8]
    if bits == 12:  # three bytes hold two pixels
        a, b, c = content.reshape(-1, 3).astype(np.uint16).T
        content = np.stack([a << 4 | b >> 4, (b & 15) << 8 | c], axis=1)
    frames = (content.view("<u2") if bits == 16 else content).reshape(-1, height, width)
    short = (_cut_short_warning(n, stated),) if n < stated else ()
    rate, shutter = number("Record Rate(fps)"), number("Shutter Type2(nsec)")
    step = max(int(values.get("Save Step", "").strip() or 1), 1)
    notes = [f"{rate} frames per second and an exposure of {shutter / 1e3:g} us by the camera's header"]
    notes += [f"every {step}th frame was saved: {rate / step:.6g} per second"] if step > 1 else []
    time = step * np.arange(n) / rate if step > 1 and rate else None
    return Footage(frames, time, float(rate) or None, shutter * 1e-9 or None, notes=tuple(notes), warnings=short)


_PHOTRON = {  # places in a .cihx file, by the keys of a .cih file
    "Image Width": "imageDataInfo/resolution/width",
    "Image Height": "imageDataInfo/resolution/height",
    "Color Bit": "imageDataInfo/colorInfo/bit",
    "Color Type": "imageDataInfo/colorInfo/type",
    "Total Frame": "frameInfo/totalFrame",
    "Save Step": "frameInfo/skipFrame",
    "Record Rate(fps)": "recordInfo/recordRate",
    "Shutter Type2(nsec)": "recordInfo/shutterSpeedNsec",
}


def _photron_values(header: Path) -> dict[str, str]:
    """Return the values of a Photron header by the keys of a .cih file. Raises InputError: it is none."""
    content = read_bytes(header, _LARGEST_HEADER)
    if content.startswith(b"#Camera Information Header"):
        pairs = (line.partition(" : ") for line in content.decode("latin-1").partition("\n\n")[0].splitlines())
        return {key.strip(): value.strip() for key, _, value in pairs}
    require(b"<cih>" in content, f"{header.name} is no Photron header", "video.cihx")
    tree = ElementTree.fromstring(content[content.index(b"<cih>") : content.rindex(b"</cih>") + 6])
    return {key: (tree.findtext(place) or "").strip() for key, place in _PHOTRON.items()}
