"""Posterior -> terminal table, result.json, report.html and pictures."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from cavirheo.errors import require
from cavirheo.reporting.record import Pairs, Result, read_json, result
from cavirheo.writing import style
from cavirheo.writing.document import into, write_json

__all__ = ["file_names", "read_json", "result", "write_report"]


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    pictures: Sequence[str] = ("png",),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
) -> Result:
    """Write result.json, result.csv, report.html and a picture of each curve into `directory` (made if missing).

    Args:
        pairs: (curve, its answer), in the order of the rows.
        command: what was run, as it stands in the documents.
        pictures: kinds of picture files, of "png" and "svg"; () for none. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).

    Without matplotlib there are no pictures, and the report and the result's notes say so.

    Raises:
        InputError: an unknown kind of picture, or a directory that cannot be written.
    """
    from cavirheo.reporting import html, table

    unknown = ", ".join(repr(kind) for kind in pictures if kind not in ("png", "svg"))
    require(not unknown, f"pictures can be png or svg, got {unknown}", "reporting.picture_kind")
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    drawing = style.available()
    document = result(pairs, command, date=date, notes=(*notes, *(() if drawing else (style.NO_PICTURES,))))
    with into(directory) as folder:
        write_json(folder / "result.json", document)
        table.write_csv(folder / "result.csv", document)
        drawn = (_curves(folder, pairs, document, pictures), _groups(pairs, document)) if drawing else ()
        html.write(folder / "report.html", document, *drawn)
    return document


def _curves(folder: Path, pairs: Pairs, document: Result, kinds: Sequence[str]) -> Iterator[str]:
    """Draws and saves the picture of one curve after the other; yields what the report shows of it."""
    from cavirheo.reporting.picture import HEAD, CurvePicture

    picture, names = CurvePicture(), file_names([record.name for record in document.curves])
    for (curve, posterior), record, name in zip(pairs, document.curves, names, strict=True):
        figure = picture.show(curve, posterior.checks, record, document.modulus_unit)
        if "svg" in kinds:
            style.save_svg(folder / f"{name}.svg", figure)
        image = style.compact(style.drawn(figure))
        if "png" in kinds:
            image.save(folder / f"{name}.png", dpi=(style.DPI, style.DPI), compress_level=3)
        yield style.address(image.crop((0, int(HEAD * image.height), *image.size)))


def _groups(pairs: Pairs, document: Result) -> Iterator[str]:
    from cavirheo.reporting.picture import group_picture

    for group, members in document.members():
        if group.n > 1:
            mine = [pairs[i] for i in members], [document.curves[i] for i in members]
            yield style.address(style.drawn(group_picture(*mine, group, document.modulus_unit)).quantize(64))


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100] or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]
