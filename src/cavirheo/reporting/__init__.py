"""Posterior -> terminal table, result.json, report.html, and figures as files where they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.posterior import Posterior
from cavirheo.reporting import html, pictures, table
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import REFERENCES, GroupRecord, Published
from cavirheo.reporting.panels import answer_panels, group_panels
from cavirheo.reporting.pictures import file_names
from cavirheo.reporting.record import CurveAnswers, Pairs, Result, group_names, read_json, result
from cavirheo.writing.document import CLAIM, Claim, Outputs, try_to_draw, write_json, write_rows

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

GROUPS = 50  # of a run, whose pictures are in the report
PAGE_POINTS = 240_000  # that the pictures of all curves, and those of all groups, have together
DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(directory: str | Path, curves: Sequence[RadiusCurve], figures: Sequence[str] = ()) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    pictures.check_figures(figures)
    stems = pictures.stems_of([curve.name for curve in curves], group_names(curves))
    drawings = [f"{stem}.{kind}" for kind in figures for stem in stems]
    return Outputs(directory, *DOCUMENTS, *drawings, inputs=[curve.source for curve in curves if curve.source])


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
    replaced, or removed. A picture or figure that cannot be drawn costs nothing else: report and notes say why.

    Args:
        pairs: (curve, its answer), in the order of the rows. A `CurveAnswers` reads each answer when it is needed.
        command: what was run, as it stands in the documents.
        figures: files of each answered curve and group for a two-column paper, of "png", "svg" and "pdf"; they need
            matplotlib, without which the notes say so. The report holds its pictures in itself.
        date: as it stands in the documents; now if not given.
        notes: on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all was answered: no report, no figures.
        draw: False: no pictures in the report.
        advance: called after each figure.
        published: values of other methods, by group, method and parameter, which stand beside the groups.
        references: methods of these that errors are to.
        replace: whether answers of another call, or of another command line, may be replaced, too.

    Raises:
        InputError: an unknown kind of figure, a directory that cannot be written, a file in it that is not ours, or
            answers of another call in it.
    """
    pairs, date = CurveAnswers.of(pairs), date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    figures, draw = figures if complete else (), draw and complete
    sources = [(curve.name, curve.source, curve.source_sha256) for curve in pairs.curves]
    claim = Claim(command, {"command": command, "curves": sources}, replace)
    with nullcontext() if CLAIM.get() else claim.running():  # a command has its claim
        folder = outputs(directory, pairs.curves, figures)
        document = result(pairs, command, date=date, notes=notes)
        document.add_published(published or {}, references)
        of_curves = _curve_pictures(pairs, document) if draw else []
        of_groups = group_pictures(pairs, document, document.notes) if draw else []
        folder.write("result.json", write_json, document)
        folder.write("result.csv", write_rows, *table.rows_of(document))
        if figures and (failed := pictures.write_figures(folder, pairs, document, figures, advance)):
            document.notes += failed
            folder.write("result.json", write_json, document)
        if complete:
            sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
            folder.write("report.html", html.write, document, of_curves, of_groups, sheets)
        folder.finish()
    return document


def _curve_pictures(pairs: CurveAnswers, document: Result) -> list[str]:
    """SVG of each curve, or why there is none; of very many curves the radius alone, half as high."""
    count, height = (1, pictures.HEIGHT / 2) if len(pairs) > html.DETAILED else (2, pictures.HEIGHT)
    points, notes = min(pictures.POINTS, PAGE_POINTS // max(len(pairs), 1)), document.notes

    def draw(pair: tuple[RadiusCurve, Posterior], row: CurveRecord) -> str:
        panels = answer_panels(pair[0], pair[1].checks, row)
        return pictures.curve_svg(panels[:count], height=height, points=points)

    rows = zip(pairs, document.curves, strict=True)
    return [try_to_draw(f"picture of {row.name}", notes, draw, pair, row) or notes[-1] for pair, row in rows]


def group_pictures(pairs: Pairs, document: Result, notes: list[str]) -> list[str]:
    """SVG of each group of several answered shots, or why there is none, which becomes one of the notes; of the first
    groups where they are many."""
    members = [(group, indices) for group, indices in document.members() if group.n > 1][:GROUPS]
    points = min(pictures.GROUP_POINTS, PAGE_POINTS // (24 * max(len(members), 1)))

    def draw(group: GroupRecord, indices: list[int]) -> str:
        return pictures.group_svg(group_panels(pairs, document, group, indices), points)

    return [try_to_draw(f"picture of {of[0].name}", notes, draw, *of) or notes[-1] for of in members]
