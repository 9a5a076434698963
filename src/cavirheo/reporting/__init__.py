"""Posterior -> terminal table, result.json, report.html and pictures."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.curve import RadiusCurve
from cavirheo.errors import require
from cavirheo.reporting.record import Pairs, Result, read_json, result
from cavirheo.writing import style
from cavirheo.writing.document import Outputs, write_json

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(directory: str | Path, curves: Sequence[RadiusCurve], pictures: Sequence[str] = ("png",)) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    unknown = ", ".join(repr(kind) for kind in pictures if kind not in ("png", "svg"))
    require(not unknown, f"pictures can be png or svg, got {unknown}", "reporting.picture_kind")
    drawn = [f"{name}.{kind}" for name in file_names([curve.name for curve in curves]) for kind in pictures]
    return Outputs(directory, *DOCUMENTS, *drawn, inputs=[curve.source for curve in curves if curve.source])


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    pictures: Sequence[str] = ("png",),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    complete: bool = True,
) -> Result:
    """Write result.json, result.csv, report.html and a picture of each curve into `directory` (made if missing).

    Each file takes its name when it is complete. What an earlier call wrote there and this one does not is removed.

    Args:
        pairs: (curve, its answer), in the order of the rows.
        command: what was run, as it stands in the documents.
        pictures: kinds of picture files, of "png" and "svg"; () for none. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all was answered: no report, no pictures.

    Without matplotlib there are no pictures, and the report and the result's notes say so; so they do of a picture
    that cannot be drawn.

    Raises:
        InputError: an unknown kind of picture, a directory that cannot be written, or a file in it that is not ours.
    """
    from cavirheo.reporting import html, table

    folder = outputs(directory, [curve for curve, _ in pairs], pictures)
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    drawing = complete and style.available()
    said = [*notes, *([style.NO_PICTURES] if complete and not drawing else [])]
    document = result(pairs, command, date=date, notes=said)
    folder.write("result.json", write_json, document)
    folder.write("result.csv", table.write_csv, document)
    if complete:
        drawn = (_curves(folder, pairs, document, pictures), _groups(pairs, document)) if drawing else ()
        folder.write("report.html", html.write, document, *drawn)
        if document.notes != said:  # of pictures
            folder.write("result.json", write_json, document)
    folder.finish()
    return document


def _curves(folder: Outputs, pairs: Pairs, document: Result, kinds: Sequence[str]) -> Iterator[str]:
    """Draws and saves the picture of one curve after the other; yields what the report shows of it."""
    from cavirheo.reporting.picture import HEAD, CurvePicture

    picture, names = None, file_names([record.name for record in document.curves])
    for (curve, posterior), record, name in zip(pairs, document.curves, names, strict=True):
        try:
            picture = picture or CurvePicture()
            figure = picture.show(curve, posterior.checks, record, document.modulus_unit)
            image = style.compact(style.drawn(figure))
        except Exception as error:  # of this picture alone
            document.notes.append(f"{record.name} could not be drawn: {type(error).__name__}: {error}")
            picture = None
            yield ""
            continue
        if "svg" in kinds:
            folder.write(f"{name}.svg", style.save_svg, figure)
        if "png" in kinds:
            folder.write(f"{name}.png", _save, image)
        yield style.address(image.crop((0, int(HEAD * image.height), *image.size)))


def _save(path: Path, image: Image) -> None:
    image.save(path, dpi=(style.DPI, style.DPI), compress_level=3)


def _groups(pairs: Pairs, document: Result) -> Iterator[str]:
    from cavirheo.reporting.picture import group_picture

    for group, members in document.members():
        if group.n > 1:
            mine = [pairs[i] for i in members], [document.curves[i] for i in members]
            try:
                yield style.address(style.drawn(group_picture(*mine, group, document.modulus_unit)).quantize(64))
            except Exception as error:  # of this picture alone
                document.notes.append(f"{group.name} could not be drawn: {type(error).__name__}: {error}")


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100] or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]
