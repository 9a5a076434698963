"""The pictures of a report: each curve's is drawn once, for its file and for the page; many by several processes."""

from __future__ import annotations

import io
import multiprocessing
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from typing import NamedTuple

from cavirheo.curve import RadiusCurve
from cavirheo.parallel import processes
from cavirheo.posterior import Checks
from cavirheo.reporting.answer import CurveRecord, Unit
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.picture import DPI, HEAD, OUTSIDE, CurvePicture, group_picture
from cavirheo.reporting.record import Pairs
from cavirheo.writing import style
from cavirheo.writing.digits import LOOKS

_MANY = 80  # curves; fewer are drawn before other processes have loaded what they need
_MOST = 4  # processes, of 120 MB each
_PATIENCE = 60.0  # s for one picture, before this process draws the rest
_TONES = (style.BLUE, style.VERMILLION, style.BLACK)
_FILE = ("white", style.BOX), (*_TONES, *(look.colour for look in LOOKS.values())), (0.13, 0.4, 0.7, 1.0)  # colours
_PAGE = ("white", OUTSIDE), _TONES, (0.13, 0.5, 1.0)  # fewer: 400 pictures are to be a page of 5 MB


class Drawing(NamedTuple):
    """What the picture of one curve needs; `kinds` of files, of "png" and "svg"."""

    curve: RadiusCurve
    checks: Checks
    record: CurveRecord
    unit: Unit
    kinds: Sequence[str]


class Drawn(NamedTuple):
    """What the page shows, an image's address or why there is none; and the content of each file by its kind."""

    shown: str
    files: dict[str, bytes]


class _Artist:
    """Draws one picture after the other into one figure."""

    def __init__(self) -> None:
        self.picture: CurvePicture | None = None

    def draw(self, one: Drawing) -> Drawn:
        """Whatever goes wrong, it is the reason why there is no picture."""
        try:
            self.picture = self.picture or CurvePicture()
            figure = self.picture.show(one.curve, one.checks, one.record, one.unit)
            image = style.drawn(figure, DPI)
            page = image.crop((0, int(HEAD * image.height), *image.size))
            files = {kind: io.BytesIO() for kind in one.kinds}
            if "svg" in files:
                style.save_svg(files["svg"], figure)
            if "png" in files:
                style.compact(image, *_FILE).save(files["png"], "png", dpi=(DPI, DPI), compress_level=3)
            shown = style.address(style.compact(page, *_PAGE))
            return Drawn(shown, {kind: file.getvalue() for kind, file in files.items()})
        except Exception as error:
            self.picture = None  # it may be left half changed
            return Drawn(f"no picture ({type(error).__name__}: {error})", {})


def prepare() -> None:
    """Load what pictures need, half a second, in a thread beside other work."""

    def load() -> None:
        with suppress(Exception):  # what fails here is said where a picture is wanted
            style.drawn(CurvePicture().figure, DPI)

    threading.Thread(target=load).start()  # waited for at the end: matplotlib aborts a process that ends below it


_artist = cache(_Artist)  # of a process that only draws


def _draw(one: Drawing) -> Drawn:
    return _artist().draw(one)


def curve_pictures(jobs: Sequence[Drawing], workers: int = 1) -> Iterator[Drawn]:
    """The picture of each, in their order, drawn by so many processes where that is faster."""
    done = 0
    if workers > 1 and len(jobs) > _MANY:
        with suppress(OSError, multiprocessing.TimeoutError), processes(min(workers, _MOST)) as pool:
            found = pool.imap(_draw, jobs)
            for _ in jobs:
                yield found.next(_PATIENCE)
                done += 1
    yield from map(_Artist().draw, jobs[done:])


def group_pictures(
    pairs: Pairs, members: Sequence[tuple[GroupRecord, list[int]]], records: Sequence[CurveRecord], unit: Unit
) -> Iterator[tuple[str, str]]:
    """(name, an image's address or why there is none) of each group of several shots."""
    for group, indices in members:
        if group.n > 1:
            try:
                mine = [pairs[i] for i in indices], [records[i] for i in indices]
                yield group.name, style.address(style.drawn(group_picture(*mine, group, unit)).quantize(64))
            except Exception as error:
                yield group.name, f"no picture ({type(error).__name__}: {error})"
