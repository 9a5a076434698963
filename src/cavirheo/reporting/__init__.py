"""Posterior -> terminal table, result.json, report.html and pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.errors import require
from cavirheo.reporting.record import Answered, Pairs, Published, Result, read_json, result
from cavirheo.writing import digits, style
from cavirheo.writing.document import Outputs, short_name, write_json

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

MANY = (
    500  # curves: above, a Parquet table stands beside the documents, and the report draws a picture when it is asked
)
GROUPS = 100  # of that many curves, whose pictures are drawn
PICTURES = "the report draws a picture when it is asked for; for a file of one, give its recording alone"
DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(
    directory: str | Path, curves: Sequence[RadiusCurve], pictures: Sequence[str] = ("png",), *, paper: bool = False
) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    unknown = ", ".join(repr(kind) for kind in pictures if kind not in ("png", "svg"))
    require(not unknown, f"pictures can be png or svg, got {unknown}", "reporting.picture_kind")
    many = ["result.parquet"] if len(curves) > MANY else []
    kinds = pictures if not many else ()
    drawn = [f"{name}.{kind}" for name in file_names([curve.name for curve in curves]) for kind in kinds]
    if paper:
        from cavirheo.reporting.paper import names

        groups = dict.fromkeys((curve.group, curve.group_source) for curve in curves)
        stems = names([curve.name for curve in curves], [group for group, _ in groups])
        drawn += [f"{name}.{kind}" for name in stems for kind in style.PAPER]
    return Outputs(directory, *DOCUMENTS, *many, *drawn, inputs=[curve.source for curve in curves if curve.source])


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    pictures: Sequence[str] = ("png",),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    complete: bool = True,
    draw: bool = True,
    workers: int = 1,
    done: Callable[[], None] | None = None,
    published: Mapping[str, Published] | None = None,
    paper: bool = False,
) -> Result:
    """Write result.json, result.csv, report.html and a picture of each curve into `directory` (made if missing).

    Each file takes its name when it is complete. What an earlier call wrote there and this one does not is removed.

    Args:
        pairs: (curve, its answer), in the order of the rows. Answers of an `Answered` are read when they are needed.
        command: what was run, as it stands in the documents.
        pictures: kinds of picture files, of "png" and "svg"; () for none. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all was answered: no report, no pictures.
        draw: False: no pictures, not even in the report.
        workers: processes that may draw, and make the rows of thousands of curves; above 1, the main module of the
            program must be safe to import.
        done: called after each picture.
        published: values of other methods, by group ("": all that are not named), method and parameter, which stand
            beside the groups.
        paper: figures for a two-column paper, too (`paper.figures`), as PDF, SVG and PNG; they need matplotlib.

    Of more than MANY curves there is result.parquet, too (with pyarrow), and there are no picture files: the report has
    a script that sorts and filters its rows and draws the picture of a curve when it is asked for.

    Without matplotlib there are no pictures, and the report and the result's notes say so; so they do of a picture
    that cannot be drawn.

    Raises:
        InputError: an unknown kind of picture, a directory that cannot be written, or a file in it that is not ours.
    """
    from cavirheo.reporting import html, table

    pairs, many = Answered.of(pairs), len(pairs) > MANY
    pictures = pictures if draw and not many else ()
    folder = outputs(directory, pairs.curves, pictures, paper=paper)
    date = date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    drawing = draw and complete and style.available()
    said = [*notes, *([style.NO_PICTURES] if draw and complete and not drawing else [])]
    document = result(pairs, command, date=date, notes=said, published=published, workers=workers if complete else 1)
    if many and complete:
        said = [*said, *([PICTURES] if draw else []), *_table(folder, document)]
        document.notes = list(said)
    folder.write("result.json", write_json, document)
    folder.write("result.csv", table.write_csv, document)
    if complete:
        drawn: tuple[Iterable[str], ...] = ()
        if many and draw:
            traces = _traces(pairs, done)
            drawn = (traces, _of_groups(pairs, document)) if drawing else (traces,)
        elif drawing:
            drawn = _drawn(folder, pairs, document, pictures, workers, done), _of_groups(pairs, document)
        sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
        folder.write("report.html", html.write, document, *drawn, sheets=sheets, many=many)
        if paper:
            from cavirheo.reporting.paper import figures, write

            for name, figure in figures(pairs, document):
                write(folder, name, figure)
        if document.notes != said:  # of pictures
            folder.write("result.json", write_json, document)
    folder.finish()
    return document


def _table(folder: Outputs, document: Result) -> list[str]:
    """result.parquet written; what is to be said where it cannot be."""
    from cavirheo.reporting import table

    try:
        folder.write("result.parquet", table.write_parquet, document)
    except ModuleNotFoundError:
        return ["no result.parquet (result.csv has the same rows): pip install 'cavirheo[cluster]'"]
    return []


def _traces(pairs: Answered, done: Callable[[], None] | None) -> Iterator[str]:
    """What the script of the report draws a curve's picture of."""
    from cavirheo.reporting.trace import trace

    for curve, answer in pairs:
        try:
            made = trace(curve, answer.checks, digits.simulated(answer.method))
        except Exception as error:  # costs nothing but itself
            made = f"no picture ({type(error).__name__}: {error})"
        if done:
            done()
        yield made


def _drawn(
    folder: Outputs, pairs: Answered, document: Result, kinds: Sequence[str], workers: int,
    done: Callable[[], None] | None,
) -> Iterator[str]:  # fmt: skip
    """What the report shows of its curves, drawn when it is asked for; files are saved meanwhile."""
    from cavirheo.reporting.picture_files import Drawing, curve_pictures

    records, unit = document.curves, document.modulus_unit
    given = zip(pairs, records, strict=True)
    jobs = [Drawing(curve, answer.checks, record, unit, kinds) for (curve, answer), record in given]
    drawn = zip(file_names([record.name for record in records]), records, curve_pictures(jobs, workers), strict=True)
    for name, record, picture in drawn:
        for kind, content in picture.files.items():
            folder.write(f"{name}.{kind}", Path.write_bytes, content)
        if done:
            done()
        yield _noted(document, record.name, picture.shown)


def _of_groups(pairs: Answered, document: Result) -> Iterator[str]:
    """What the report shows of its groups; of very many curves only the first groups."""
    from cavirheo.reporting.picture_files import group_pictures

    members = document.members()[: GROUPS if len(pairs) > MANY else None]
    for name, shown in group_pictures(pairs, members, document.curves, document.modulus_unit):
        yield _noted(document, name, shown)


def _noted(document: Result, name: str, shown: str) -> str:
    document.notes += [] if shown.startswith("data:") else [f"{name}: {shown}"]
    return shown


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, short enough for an ending, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = short_name(re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100]) or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]
