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
from cavirheo.reporting.record import CurveAnswers, Pairs, Result, read_json, result
from cavirheo.writing import claim
from cavirheo.writing.document import Outputs, drawing, short_name, write_json

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

MANY = 500  # curves: above, a Parquet table stands beside the documents
GROUPS = 50  # of a run, whose pictures are in the report
PAGE_POINTS = 240_000  # that the pictures of all curves, and those of all groups, have together
DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(directory: str | Path, curves: Sequence[RadiusCurve], figures: Sequence[str] = ()) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    many = ["result.parquet"] if len(curves) > MANY else []
    drawings: list[str] = []
    if figures:
        from cavirheo.reporting.figures import check_figures, files

        check_figures(figures)
        groups = dict.fromkeys((curve.group, curve.group_source) for curve in curves)
        drawings = files(figures, [curve.name for curve in curves], [group for group, _ in groups])
    return Outputs(directory, *DOCUMENTS, *many, *drawings, inputs=[curve.source for curve in curves if curve.source])


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
    advance: Callable[[], None] | None = None,
    published: Mapping[str, Published] | None = None,
    references: Sequence[str] = REFERENCES,
    replace: bool = False,
) -> Result:
    """Write result.json, result.csv and report.html with a picture of each curve into `directory` (made if missing).

    Each file takes its name when it is complete. What an earlier call with this command and these curves wrote there is
    replaced, or removed.

    Args:
        pairs: (curve, its answer), in the order of the rows. A `CurveAnswers` reads each answer when it is needed.
        command: what was run, as it stands in the documents.
        figures: files of each curve and group, of "png", "svg", "pdf" and "paper" (PDF, SVG and PNG for a two-column
            paper); they need matplotlib, without which the notes say so. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all was answered: no report, no figures.
        draw: False: no pictures in the report.
        advance: called after each figure.
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

    pairs, date = CurveAnswers.of(pairs), date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    figures = figures if complete else ()
    sources = [(curve.name, curve.source, curve.source_sha256) for curve in pairs.curves]
    with claim.held(claim.Claim(command, {"command": command, "curves": sources}, replace)):
        folder = outputs(directory, pairs.curves, figures)
        document = result(pairs, command, date=date, notes=notes)
        document.add_published(published or {}, references)
        pictures = _pictures(pairs, document) if draw and complete else ([], [])
        if complete and len(pairs) > MANY:
            try:
                folder.write("result.parquet", table.write_parquet, document)
            except ModuleNotFoundError:
                document.notes.append(
                    "no result.parquet (result.csv has the same rows): pip install 'cavirheo[cluster]'"
                )
        folder.write("result.json", write_json, document)
        folder.write("result.csv", table.write_csv, document)
        if figures:
            from cavirheo.reporting.figures import write

            if failed := write(folder, pairs, document, figures, advance):
                document.notes += failed
                folder.write("result.json", write_json, document)
        if complete:
            sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
            folder.write("report.html", html.write, document, *pictures, sheets)
        folder.finish()
    return document


def _pictures(pairs: CurveAnswers, document: Result) -> tuple[list[str], list[str]]:
    """SVG of each curve and of each group, or why there is none, which becomes a note of the document. Of very many
    curves the pictures are simpler, and only the first groups have one."""
    from cavirheo.reporting import html, svg
    from cavirheo.reporting.curve_panels import answer_panels
    from cavirheo.reporting.group_panels import group_panels, shots_of

    def draw(name: str, panels: Callable[[], Any], svg: Callable[..., str], **how: Any) -> str:
        with drawing(f"picture of {name}", document.notes):
            return svg(panels(), **how)
        return document.notes[-1]

    rows, unit = document.curves, document.modulus_unit
    how: dict[str, Any] = {"points": min(svg.POINTS, PAGE_POINTS // max(len(pairs), 1))}
    how["brief"] = len(pairs) > html.DETAILED
    curves = [
        draw(row.name, partial(answer_panels, curve, answer.checks, row), svg.curve_svg, **how)
        for (curve, answer), row in zip(pairs, rows, strict=True)
    ]
    members = [(group, indices) for group, indices in document.members() if group.n > 1][:GROUPS]
    points = min(svg.GROUP_POINTS, PAGE_POINTS // (24 * max(len(members), 1)))
    groups = []
    for group, indices in members:
        shots = shots_of(pairs, rows, indices)
        groups.append(draw(group.name, partial(group_panels, shots, group, unit), svg.group_svg, points=points))
    return curves, groups


def file_names(names: Sequence[str]) -> list[str]:
    """A safe file name for each, short enough for an ending, different also where letter case does not count."""
    taken = dict.fromkeys(("result", "report"), "")
    for name in names:
        stem = short_name(re.sub(r"[^\w.+-]+", "_", name).strip("._")[:100]) or "curve"
        unique = next(n for n in chain([stem], (f"{stem}-{k}" for k in count(2))) if n.lower() not in taken)
        taken[unique.lower()] = unique
    return list(taken.values())[2:]
