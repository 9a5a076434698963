"""Posterior -> terminal table, result.json, report.html, and figures as files where they are asked for."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.reporting.group import REFERENCES, Published
from cavirheo.reporting.record import Answered, Pairs, Result, read_json, result
from cavirheo.writing import claim, style
from cavirheo.writing.document import Outputs, drawing, short_name, write_json

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

MANY = 500  # curves: above, a Parquet table stands beside the documents
GROUPS = 50  # of a run, whose pictures are in the report
PAGE_POINTS = 240_000  # that the pictures of all curves, and those of all groups, have together
DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(directory: str | Path, curves: Sequence[RadiusCurve], figures: Sequence[str] = ()) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    many = ["result.parquet"] if len(curves) > MANY else []
    drawn: list[str] = []
    if figures:
        from cavirheo.reporting.figures import check_figures, files

        check_figures(figures)
        groups = dict.fromkeys((curve.group, curve.group_source) for curve in curves)
        drawn = files(figures, [curve.name for curve in curves], [group for group, _ in groups])
    return Outputs(directory, *DOCUMENTS, *many, *drawn, inputs=[curve.source for curve in curves if curve.source])


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    figures: Sequence[str] = (),
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    complete: bool = True,
    draw: bool = True,
    workers: int = 1,
    done: Callable[[], None] | None = None,
    published: Mapping[str, Published] | None = None,
    references: Sequence[str] = REFERENCES,
    replace: bool = False,
) -> Result:
    """Write result.json, result.csv and report.html with a picture of each curve into `directory` (made if missing).

    Each file takes its name when it is complete. What an earlier call with this command and these curves wrote there is
    replaced, or removed.

    Args:
        pairs: (curve, its answer), in the order of the rows. Answers of an `Answered` are read when they are needed.
        command: what was run, as it stands in the documents.
        figures: files of each curve and group, of "png", "svg", "pdf" and "paper" (PDF, SVG and PNG for a two-column
            paper); they need matplotlib, without which the notes say so. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all was answered: no report, no figures.
        draw: False: no pictures in the report.
        workers: processes that may make the rows of thousands of curves; above 1, the main module of the program must
            be safe to import.
        done: called after each figure.
        published: values of other methods, by group, method and parameter, which stand beside the groups.
        references: methods of these that errors are to.
        replace: whether answers of another call, or of another command line, may be replaced, too.

    Of more than MANY curves there is result.parquet, too (with pyarrow). A picture or figure that cannot be drawn costs
    nothing else: the report and the result's notes say why.

    Raises:
        InputError: an unknown kind of figure, a directory that cannot be written, a file in it that is not ours, or
            answers of another call in it.
    """
    from cavirheo.reporting import html, table

    pairs, date = Answered.of(pairs), date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    figures = figures if complete else ()
    known = [(curve.name, curve.source, curve.source_sha256) for curve in pairs.curves]
    with claim.held(claim.Claim(command, {"command": command, "curves": known}, replace)):
        folder = outputs(directory, pairs.curves, figures)
        workers = workers if complete else 1
        document = result(pairs, command, date=date, notes=notes, workers=workers)
        document.put_beside(published or {}, references)
        pictures = _pictures(pairs, document) if draw and complete else Pictures()
        document.notes += pictures.failed
        if complete and len(pairs) > MANY:
            document.notes += _parquet(folder, document)
        folder.write("result.json", write_json, document)
        folder.write("result.csv", table.write_csv, document)
        if figures and (failed := _figures(folder, pairs, document, figures, done)):
            document.notes += failed
            folder.write("result.json", write_json, document)
        if complete:
            sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
            folder.write("report.html", html.write, document, pictures.curves, pictures.groups, sheets)
        folder.finish()
    return document


def _figures(
    folder: Outputs, pairs: Answered, document: Result, figures: Sequence[str], done: Callable[[], None] | None
) -> list[str]:
    """The files of figures written; what is to be said of those that could not be drawn."""
    if not style.available():
        return [style.NO_PICTURES]
    from cavirheo.reporting.figures import write

    return write(folder, pairs, document, figures, done)


class Pictures:
    """The pictures of a report: SVG of each curve and of each group, or why there is none; and what failed."""

    def __init__(self) -> None:
        self.curves: list[str] = []
        self.groups: list[str] = []
        self.failed: list[str] = []

    def draw(self, name: str, lines: Callable[[], Any], svg: Callable[..., str], **how: Any) -> str:
        """A picture, or why there is none."""
        with drawing(f"picture of {name}", self.failed):
            return svg(lines(), **how)
        return self.failed[-1]


def _pictures(pairs: Answered, document: Result) -> Pictures:
    """Of very many curves the lines are simpler, and only the first groups have a picture."""
    from cavirheo.reporting import html, svg
    from cavirheo.reporting.curve_panels import answer_panels
    from cavirheo.reporting.group_panels import group_panels

    made, records, unit = Pictures(), document.curves, document.modulus_unit
    most = min(svg.POINTS, PAGE_POINTS // max(len(pairs), 1))
    how: dict[str, Any] = {"points": most, "brief": len(pairs) > html.DETAILED}
    for (curve, answer), record in zip(pairs, records, strict=True):
        lines = partial(answer_panels, curve, answer.checks, record)
        made.curves.append(made.draw(record.name, lines, svg.curve_svg, **how))
    members = [(group, indices) for group, indices in document.members() if group.n > 1][:GROUPS]
    most = min(svg.GROUP_POINTS, PAGE_POINTS // (24 * max(len(members), 1)))
    for group, indices in members:
        shots = [(pairs[i][0], pairs[i][1].checks, records[i]) for i in indices if records[i].answered]
        made.groups.append(made.draw(group.name, partial(group_panels, shots, group, unit), svg.group_svg, points=most))
    return made


def _parquet(folder: Outputs, document: Result) -> list[str]:
    """result.parquet written; what is to be said where it cannot be."""
    from cavirheo.reporting import table

    try:
        folder.write("result.parquet", table.write_parquet, document)
    except ModuleNotFoundError:
        return ["no result.parquet (result.csv has the same rows): pip install 'cavirheo[cluster]'"]
    return []


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, short enough for an ending, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = short_name(re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100]) or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]
