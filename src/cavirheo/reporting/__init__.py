"""Posterior -> terminal table, result.json, report.html, and figures as files where they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.posterior import Posterior
from cavirheo.reporting import svg
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.figures import check_figures, file_names, stems_of
from cavirheo.reporting.figures import write as write_figures
from cavirheo.reporting.group import REFERENCES, GroupRecord, Published
from cavirheo.reporting.panels import answer_panels, group_panels, shots_of
from cavirheo.reporting.record import CurveAnswers, Pairs, Result, read_json, result
from cavirheo.writing import claim
from cavirheo.writing.document import Outputs, try_to_draw, write_json

__all__ = ["file_names", "outputs", "read_json", "result", "write_report"]

GROUPS = 50  # of a run, whose pictures are in the report
PAGE_POINTS = 240_000  # that the pictures of all curves, and those of all groups, have together
DOCUMENTS = ("result.json", "result.csv", "report.html")


def outputs(directory: str | Path, curves: Sequence[RadiusCurve], figures: Sequence[str] = ()) -> Outputs:
    """Where `write_report` writes, tried. Raises InputError: it cannot, or it would replace a file of the user's."""
    check_figures(figures)
    names = [curve.name for curve in curves]
    groups = [group for group, _ in dict.fromkeys((curve.group, curve.group_source) for curve in curves)]
    drawings = [f"{stem}.{kind}" for kind in figures for stem in stems_of(names, groups)]
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
    replaced, or removed.

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

    A picture or figure that cannot be drawn costs nothing else: the report and the result's notes say why.

    Raises:
        InputError: an unknown kind of figure, a directory that cannot be written, a file in it that is not ours, or
            answers of another call in it.
    """
    from cavirheo.reporting import html, table

    pairs, date = CurveAnswers.of(pairs), date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    figures = figures if complete else ()
    sources = [(curve.name, curve.source, curve.source_sha256) for curve in pairs.curves]
    new_claim = claim.Claim(command, {"command": command, "curves": sources}, replace)
    with nullcontext() if claim.current() else claim.claimed(new_claim):  # a command has its claim
        folder = outputs(directory, pairs.curves, figures)
        document = result(pairs, command, date=date, notes=notes)
        document.add_published(published or {}, references)
        pictures = []
        if draw and complete:
            pictures = [_curve_pictures(pairs, document), group_pictures(pairs, document, document.notes)]
        folder.write("result.json", write_json, document)
        folder.write("result.csv", table.write_csv, document)
        if figures and (failed := write_figures(folder, pairs, document, figures, advance)):
            document.notes += failed
            folder.write("result.json", write_json, document)
        if complete:
            sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
            folder.write("report.html", html.write, document, *pictures, sheets=sheets)
        folder.finish()
    return document


def _curve_pictures(pairs: CurveAnswers, document: Result) -> list[str]:
    """SVG of each curve, or why there is none; of very many curves the radius alone, half as high."""
    from cavirheo.reporting.html import DETAILED

    count, height = (1, svg.HEIGHT / 2) if len(pairs) > DETAILED else (2, svg.HEIGHT)
    points = min(svg.POINTS, PAGE_POINTS // max(len(pairs), 1))

    def draw(pair: tuple[RadiusCurve, Posterior], row: CurveRecord) -> str:
        panels = answer_panels(pair[0], pair[1].checks, row)
        return svg.curve_svg(panels[:count], height=height, points=points)

    notes, rows = document.notes, zip(pairs, document.curves, strict=True)
    return [try_to_draw(f"picture of {row.name}", notes, draw, pair, row) or notes[-1] for pair, row in rows]


def group_pictures(pairs: Pairs, document: Result, notes: list[str]) -> list[str]:
    """SVG of each group of several answered shots, or why there is none, which becomes one of the notes; of the first
    groups where they are many."""
    members = [(group, indices) for group, indices in document.members() if group.n > 1][:GROUPS]
    points = min(svg.GROUP_POINTS, PAGE_POINTS // (24 * max(len(members), 1)))

    def draw(group: GroupRecord, indices: list[int]) -> str:
        shots = shots_of(pairs, document.curves, indices)
        return svg.group_svg(group_panels(shots, group, document.modulus_unit), points)

    return [try_to_draw(f"picture of {of[0].name}", notes, draw, *of) or notes[-1] for of in members]
