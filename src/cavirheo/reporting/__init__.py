"""Posterior -> terminal table, result.json, report.html and pictures.

| module | does |
|---|---|
| document | what all documents have in common |
| record | result.json: what other programs read |
| digits | digits, units and words for people, the same everywhere |
| table | the terminal, and CSV |
| style | how all pictures look |
| picture | measured points, simulation of the answer, residual (needs the [plot] extra) |
| html | the report, one file |
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from cavirheo.errors import InputError
from cavirheo.reporting.record import Pairs, Result, read_json, result
from cavirheo.writing.document import into, write_json

__all__ = ["file_names", "read_json", "result", "write_json", "write_report"]

_KINDS = ("png", "svg")


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    pictures: Sequence[str] = ("png",),
    *,
    date: str | None = None,
) -> Result:
    """Write result.json, result.csv, report.html and a picture of each curve into `directory` (made if missing).

    Args:
        pairs: (curve, its answer), in the order of the rows.
        command: what was run, as it stands in the documents.
        pictures: kinds of picture files, of "png" and "svg"; () for none. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.

    Without matplotlib there are no pictures, and the report and the result's notes say so.

    Raises:
        InputError: an unknown kind of picture, or a directory that cannot be written.
    """
    from cavirheo.reporting import html, picture, table
    from cavirheo.writing import style

    if unknown := [kind for kind in pictures if kind not in _KINDS]:
        raise InputError(f"pictures can be {' or '.join(_KINDS)}, got {', '.join(map(repr, unknown))}")
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    drawing = style.available()
    document = result(pairs, command, date=date, notes=() if drawing else (style.NO_PICTURES,))
    unit = document.modulus_unit
    with into(directory) as folder:
        drawn: dict[int, str] = {}
        overviews: dict[int, str] = {}
        if drawing:
            names = file_names([record.name for record in document.curves])
            for number, (pair, name) in enumerate(zip(pairs, names, strict=True)):
                figure = picture.curve_figure(*pair, unit)
                drawn[number] = picture.svg(figure, f"curve-{number}", header=False)
                if "svg" in pictures:
                    (folder / f"{name}.svg").write_text(picture.svg(figure, name), encoding="utf-8")
                if "png" in pictures:
                    picture.save_png(folder / f"{name}.png", figure)
            for number, (group, members) in enumerate(document.members()):
                if group.n > 1:
                    figure = picture.group_figure([pairs[i] for i in members], group, unit)
                    overviews[number] = picture.svg(figure, f"group-{number}")
        write_json(folder / "result.json", document)
        table.write_csv(folder / "result.csv", document)
        (folder / "report.html").write_text(html.render(document, drawn, overviews), encoding="utf-8")
    return document


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, different also where letter case does not count."""
    taken: set[str] = {"result", "report"}
    found = []
    for name in names:
        stem = re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100] or "curve"
        unique, count = stem, 1
        while unique.lower() in taken:
            count += 1
            unique = f"{stem}-{count}"
        taken.add(unique.lower())
        found.append(unique)
    return found
