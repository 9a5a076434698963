"""`cavirheo measure`: a recording in; its radii, a sheet of its frames and a document out."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.options import argument, number, option
from cavirheo.verbs.run import Run

_VIDEO = ".mp4, .avi, .mkv, .mov, .tif, .cine, .mraw (+ .cihx); a folder of images"


@dataclass(kw_only=True)
class Measure(options.Printing):
    """Radii of a bubble, with standard deviations, from a high-speed recording."""

    video: Annotated[Path, argument("VIDEO", _VIDEO, readable=False)]
    fps: Annotated[Any, number("frames per second of recording  [default: the camera's stamps]")] = None
    um_per_px: options.UmPerPx = None
    exposure_us: Annotated[Any, number("exposure time of a frame, us  [default: the camera's header]")] = None
    polarity: Annotated[Literal["auto", "dark", "bright"], option("the bubble's look before its background")] = "auto"
    roi: Annotated[str | None, option("part of the picture to measure, px", metavar="X,Y,W,H")] = None
    reference_frame: Annotated[int | None, option("number of a frame without the bubble, from 1")] = None
    frames: Annotated[str | None, option("first and last frame to measure", metavar="A:B")] = None
    exclude: options.Exclude = None
    overlay: Annotated[bool, option("write overlay.mp4: recording and circles", None, "--overlay")] = False
    out: options.Out = Path("cavirheo-measure")

    def __call__(self, run: Run) -> None:
        from cavirheo.inference import input_checks
        from cavirheo.io.videos import examine
        from cavirheo.physics.media import WATER
        from cavirheo.video import document
        from cavirheo.video.frames import need
        from cavirheo.writing.document import Outputs

        need("PIL")  # the pictures' library, of the extra [video]
        from cavirheo.video import picture

        names = ("um_per_px", "polarity", "exclude", "reference_frame")
        settings: dict[str, Any] = {name: getattr(self, name) for name in names} | {"frame_rate": self.fps}
        settings["exposure"] = self.exposure_us and self.exposure_us * 1e-6
        settings |= {"roi": _numbers("--roi", self.roi, 4), "span": _numbers("--frames", self.frames, 2)}
        (path,) = (self.video,) if self.video.is_dir() else run.files([self.video])
        overlay = ["overlay.mp4"] if self.overlay else []
        outputs = Outputs(self.out, "measure.json", "measured.csv", "contact.png", *overlay, inputs=[path])
        with ExitStack() as stack:

            def begin(count: int) -> Callable[[], None]:
                return stack.enter_context(run.bar("measuring", count, unit="frames"))

            measurement, curve = examine(path, begin=begin, **settings)
        warnings = [warning.text for warning in input_checks.plain(curve, WATER)]
        record = document.describe(
            measurement, curve, warnings, command=run.command, date=run.date, notes=list(measurement.notes)
        )
        outputs.write("measured.csv", document.write_csv, measurement)
        record.notes += outputs.picture("contact.png", picture.save_sheet, picture.contact_sheet, measurement)
        if self.overlay:
            outputs.write("overlay.mp4", picture.write_overlay, measurement)
        run.deliver(outputs, record)
        run.end(f"written to {self.out} in {{seconds}}", bool(warnings or record.unusable))


def _numbers(option: str, text: str | None, count: int) -> tuple[int, ...] | None:
    if text is None:
        return None
    parts = re.split("[,:]", text)
    expected = "x,y,width,height in px" if count == 4 else "first:last"
    fine = len(parts) == count and all(re.fullmatch(r"\d{1,9}", part) for part in parts)
    require(fine, f"{option} must be {expected}, got {text!r}", f"option.{option[2:]}")
    return tuple(map(int, parts))
