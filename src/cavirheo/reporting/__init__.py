"""The report of a run: its files, result.json, result.csv and report.html, and which pictures are in it.

The page loads no other file: style and pictures are part of it. The script (table.js) only sorts the table of shots;
without it all content is still there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from markupsafe import Markup

from cavirheo.posterior import Checks
from cavirheo.reporting import pictures
from cavirheo.reporting.documents import Pairs, result
from cavirheo.reporting.panels import curve_panels, group_panels
from cavirheo.reporting.record import GroupRecord, Result, csv_rows
from cavirheo.reporting.templates import template
from cavirheo.writing import digits
from cavirheo.writing.document import Claim, Outputs, locked_folder, try_to_draw, write_json, write_rows

__all__ = ["result", "write_report"]

MAX_PICTURES = 200  # most curves, and most groups, of a report with a picture; exceptions come first
DOCUMENTS = ("result.json", "result.csv", "report.html")


def write_report(
    directory: str | Path, pairs: Pairs, document: Result, *, draw: bool = True, replace: bool = False
) -> None:
    """Write result.json, result.csv and report.html with a picture of each curve into `directory` (made if missing).

    Each file gets its name only when it is complete. Files that an earlier call with the same command and curves wrote
    are replaced. If a picture cannot be drawn, all else is written; report and notes of the document say why.

    Args:
        pairs: (curve, answer), in the order of the rows.
        document: their `result`.
        draw: whether the report has pictures.
        replace: whether answers of another call or command line may be replaced.

    Raises:
        InputError: a directory that cannot be written, a file in it that cavirheo did not write, or answers of another
            call in it.
    """
    curves = [(curve.name, curve.source, curve.source_sha256) for curve, _ in pairs]
    claim = Claim(document.command, {"command": document.command, "curves": curves}, replace)
    sources = [curve.source for curve, _ in pairs if curve.source]
    with locked_folder(directory):
        write_documents(Outputs(claim, directory, *DOCUMENTS, inputs=sources), pairs, document, draw=draw)


def write_documents(
    folder: Outputs, pairs: Pairs, document: Result, *, complete: bool = True, draw: bool = True
) -> None:
    """As `write_report`, into the folder of a run. complete: False for one that was stopped early: no report."""
    of_curves = _curve_pictures(pairs, document, draw=draw) if complete else {}
    of_groups = group_pictures(pairs, document, document.notes) if complete and draw else {}
    folder.write("result.json", write_json, document)
    folder.write("result.csv", write_rows, *csv_rows(document))
    if complete:
        sheets = [str(curve.meta.get("contact_sheet", "")) for curve, _ in pairs] if draw else []
        folder.write("report.html", write_page, document, of_curves, of_groups, sheets)
    folder.finish()


def write_page(
    path: Path, result: Result, of_curves: Mapping[int, str], of_groups: Mapping[str, str], sheets: Sequence[str]
) -> None:
    """Write the page of a result. of_curves: SVG of curves by their numbers, or the reason why there is none; these
    curves have a section of their own. of_groups: of groups of several answered shots by name, beside their answers.
    sheets: of each curve, an image of all frames of its recording, or ""."""
    alone = {first: group for group, (first, *others) in result.indices_by_group() if not others}
    if len(result.curves) == 1:  # its picture stands beside its answer
        of_curves, of_groups, alone = {0: ""}, {result.groups[0].name: of_curves.get(0, "")}, {}
    names = digits.distinct_names([curve.name for curve in result.curves])
    content = {"result": result, "names": names, "of_curves": of_curves, "of_groups": of_groups, "alone": alone}
    page = template("report.html").render(**content, sheets=sheets or [""] * len(names))
    path.write_text(page, encoding="utf-8")


def _curve_pictures(pairs: Pairs, document: Result, *, draw: bool) -> dict[int, str]:
    """SVG of curves by their numbers, or the reason why there is none, "" if none is drawn. Of many curves, those with
    an exceptional verdict come first."""
    rows, notes = document.curves, document.notes
    size = pictures.SIZE if len(pairs) == 1 else pictures.SHOT_SIZE
    exceptions_first = sorted(range(len(rows)), key=lambda number: rows[number].trusted)
    if len(rows) > MAX_PICTURES:
        notes.append(f"report.html has the sections of {MAX_PICTURES} of {len(rows)} curves, exceptions first")

    def curve_picture(number: int) -> str:
        curve, answer = pairs[number]
        panels = curve_panels(curve, answer.checks if rows[number].has_answer else Checks("failed"), answer.method)
        return pictures.picture(panels, size, with_key=len(pairs) == 1)

    return {
        number: try_to_draw(f"picture of {rows[number].name}", notes, curve_picture, number) if draw else ""
        for number in sorted(exceptions_first[:MAX_PICTURES])
    }


def group_pictures(pairs: Pairs, document: Result, notes: list[str]) -> dict[str, str]:
    """SVG of each of the first MAX_PICTURES groups with several answered shots, by name; or the reason why there is
    none, which is also added to `notes`."""

    def group_picture(group: GroupRecord, indices: list[int]) -> str:
        panels = group_panels(pairs, document, group, indices)
        return Markup().join(pictures.picture([panel], pictures.GROUP_SIZE) for panel in panels)

    groups = [(group, indices) for group, indices in document.indices_by_group() if group.n > 1][:MAX_PICTURES]
    return {group.name: try_to_draw(f"picture of {group.name}", notes, group_picture, group, i) for group, i in groups}
