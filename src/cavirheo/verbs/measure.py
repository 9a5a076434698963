"""`cavirheo measure`: a recording in; its radii, a sheet of its frames and a document out."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.run import Run

if TYPE_CHECKING:
    from collections.abc import Callable

_Numbers = str | None


def measure(
    video: Annotated[
        Path, Argument(readable=False, help=".mp4, .avi, .mkv, .mov, .tif, .cine, .mraw (+ .cihx); a folder of images")
    ],
    fps: Annotated[float | None, Option(help="frames per second of recording  [default: the camera's stamps]")] = None,
    um_per_px: options.UmPerPx = None,
    exposure_us: Annotated[float | None, Option(help="of a frame, us  [default: the camera's header]")] = None,
    polarity: Annotated[str, Option(help="the bubble is dark, bright, or auto")] = "auto",
    roi: Annotated[_Numbers, Option(help="part of the picture to measure, px", metavar="X,Y,W,H")] = None,
    reference_frame: Annotated[int | None, Option(help="number of a frame without the bubble, from 1")] = None,
    frames: Annotated[_Numbers, Option(help="first and last frame to measure", metavar="A:B")] = None,
    exclude: options.Exclude = None,
    overlay: Annotated[bool, Option("--overlay", help="write overlay.mp4: recording and circles")] = False,
    out: options.Out = Path("cavirheo-measure"),
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Radii of a bubble, with standard deviations, from a high-speed recording."""
    from cavirheo.inference import input_checks
    from cavirheo.physics.media import WATER
    from cavirheo.reading.recordings import examine
    from cavirheo.video import document
    from cavirheo.video.frames import need
    from cavirheo.writing.document import Outputs, write_json

    need("PIL")  # the pictures' library, of the extra [video]
    from cavirheo.video import picture

    settings: dict[str, Any] = {"frame_rate": fps, "um_per_px": um_per_px, "polarity": polarity}
    settings |= {"exposure": None if exposure_us is None else exposure_us * 1e-6, "reference_frame": reference_frame}
    settings |= {"exclude": exclude, "roi": _numbers("--roi", roi, 4), "span": _numbers("--frames", frames, 2)}
    (path,) = (Path(video),) if video.is_dir() else run.files([video])
    names = ["measure.json", "measured.csv", "contact.png", *(["overlay.mp4"] if overlay else [])]
    outputs = Outputs(out, *names, inputs=[path])
    with ExitStack() as stack:

        def begin(count: int) -> Callable[[], None]:
            return stack.enter_context(run.bar("measuring", count, unit="frames"))

        found, curve = examine(path, begin=begin, **settings)
    odd = [warning.text for warning in input_checks.plain(curve, WATER)]
    made = document.describe(found, curve, odd, command=run.command, date=run.date, notes=list(found.notes))
    outputs.write("measured.csv", document.write_csv, found)
    made.notes += outputs.picture("contact.png", picture.save_sheet, picture.contact_sheet, found)
    if overlay:
        outputs.write("overlay.mp4", picture.write_overlay, found)
    outputs.write("measure.json", write_json, made)
    outputs.finish()
    run.show(made, document.print_table)
    run.end(f"written to {out} in {{seconds}}", bool(odd or made.unusable))


def _numbers(option: str, text: str | None, count: int) -> tuple[int, ...] | None:
    if text is None:
        return None
    fine = re.fullmatch(r"\d{1,9}([,:]\d{1,9})*", text) and len(re.split("[,:]", text)) == count
    expected = "x,y,width,height in px" if count == 4 else "first:last"
    require(bool(fine), f"{option} must be {expected}, got {text!r}", f"option.{option[2:]}")
    return tuple(map(int, re.split("[,:]", text)))
