"""Reports of posteriors: a terminal table, result.json, result.csv and report.html."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.curve import RadiusCurve
from cavirheo.posterior import Posterior
from cavirheo.reporting import html, pictures, table
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.group import GroupRecord, Published
from cavirheo.reporting.group_panels import group_panels
from cavirheo.reporting.panels import answer_panels
from cavirheo.reporting.pictures import file_names
from cavirheo.reporting.record import CurveAnswers, Pairs, Result, read_json, result
from cavirheo.writing.document import CLAIM, Claim, Outputs, try_to_draw, write_json, write_rows

if TYPE_CHECKING:
    from cavirheo.inference.population import CommonErrors

__all__ = ["file_names", "read_json", "result", "write_report"]

MAX_GROUP_PICTURES = 50  # most groups of a run that have a picture in the report
MAX_PAGE_POINTS = 240_000  # most points in the pictures of all curves of a report; those of all groups have 1/24 of it
DOCUMENTS = ("result.json", "result.csv", "report.html")


def write_report(
    directory: str | Path,
    pairs: Pairs,
    command: str,
    *,
    date: str | None = None,
    notes: Sequence[str] = (),
    complete: bool = True,
    draw: bool = True,
    published: Mapping[str, Published] | None = None,
    errors: CommonErrors | None = None,
    replace: bool = False,
) -> Result:
    """Write result.json, result.csv and report.html with a picture of each curve into `directory` (made if missing).

    Each file gets its name only when it is complete. Files that an earlier call with the same command and curves wrote
    are replaced. If a picture cannot be drawn, all else is written; report and notes say why.

    Args:
        pairs: (curve, answer), in the order of the rows. A `CurveAnswers` can read each answer when it is needed.
        command: the command that was run, as text for the documents.
        date: date in the documents; default: the present time.
        notes: notes on the run as a whole (files that could not be read, ...).
        complete: False for a run that was stopped before all curves were answered: no report.
        draw: whether the report has pictures.
        published: values of other methods by group, method and parameter, shown beside the groups.
        errors: relative standard deviations of the errors that all shots of a group share; default: those of
            `population`.
        replace: whether answers of another call or command line may be replaced.

    Raises:
        InputError: a directory that cannot be written, a file in it that cavirheo did not write, or answers of another
            call in it.
    """
    pairs, date = CurveAnswers.from_pairs(pairs), date or datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    draw = draw and complete
    sources = [(curve.name, curve.source, curve.source_sha256) for curve in pairs.curves]
    claim = Claim(command, {"command": command, "curves": sources}, replace)
    with nullcontext() if CLAIM.get() else claim.running():  # a verb of the command line has set its claim already
        folder = Outputs(directory, *DOCUMENTS, inputs=[curve.source for curve in pairs.curves if curve.source])
        document = result(pairs, command, date=date, notes=notes, errors=errors)
        document.add_published(published or {})
        of_curves = _curve_pictures(pairs, document) if draw else []
        of_groups = group_pictures(pairs, document, document.notes) if draw else []
        folder.write("result.json", write_json, document)
        folder.write("result.csv", write_rows, *table.csv_rows(document))
        if complete:
            sheets = [str(curve.meta.get("contact_sheet", "")) for curve in pairs.curves] if draw else []
            folder.write("report.html", html.write, document, of_curves, of_groups, sheets)
        folder.finish()
    return document


def _curve_pictures(pairs: CurveAnswers, document: Result) -> list[str]:
    """SVG of each curve, or the reason why there is none: large if alone; half as high, R(t) only, of too many."""
    single, brief = len(pairs) == 1, len(pairs) > html.MAX_DETAILED_CURVES
    count = 1 if brief else 2
    width, height = (pictures.WIDTH, pictures.HEIGHT) if single else pictures.SHOT_SIZE
    height = height / 2 if brief else height
    points, notes = min(pictures.POINTS, MAX_PAGE_POINTS // max(len(pairs), 1)), document.notes

    def draw(pair: tuple[RadiusCurve, Posterior], row: CurveRecord) -> str:
        panels = answer_panels(pair[0], pair[1].checks, row)
        return pictures.curve_svg(panels[:count], width, height, points=points, with_key=single)

    rows = zip(pairs, document.curves, strict=True)
    return [try_to_draw(f"picture of {row.name}", notes, draw, pair, row) or notes[-1] for pair, row in rows]


def group_pictures(pairs: Pairs, document: Result, notes: list[str]) -> list[str]:
    """SVG of each of the first MAX_GROUP_PICTURES groups with several answered shots, or the reason why there is none,
    which is also added to `notes`."""
    members = [(group, indices) for group, indices in document.indices_by_group() if group.n > 1][:MAX_GROUP_PICTURES]
    points = min(pictures.GROUP_POINTS, MAX_PAGE_POINTS // (24 * max(len(members), 1)))

    def draw(group: GroupRecord, indices: list[int]) -> str:
        return pictures.group_svg(group_panels(pairs, document, group, indices), points)

    return [try_to_draw(f"picture of {of[0].name}", notes, draw, *of) or notes[-1] for of in members]
