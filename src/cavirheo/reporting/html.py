"""report.html, a single file with everything in it, to send, store or print.

The page loads no other file: style and pictures (SVG) are part of it. The text of the report is in the templates
report.html and parts.html beside this module (jinja2), which escape all text from files and command lines. The script
(report.js) of a page of many curves only sorts and filters them; without it all content is still there.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from cavirheo.reporting.answer import CurveRecord, display_unit, meaning_of, parameter_key
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.record import Result
from cavirheo.reporting.screen import answer_lines, group_facts, shot_cells, value_parts
from cavirheo.reporting.table import model_rows
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

MIN_SORTED = 7  # curves, from which on the table can be sorted and filtered
MANY = 60  # curves; if there are more, those out of sight are not laid out
MAX_ANSWERS = 200  # most groups whose answer has a section of its own; the table has all shots
MAX_DETAILED_CURVES = 500  # curves; if there are more, each has only its row, message and picture

if TYPE_CHECKING:
    from jinja2 import Template


def write(
    path: str | Path,
    result: Result,
    pictures: Sequence[str] = (),
    group_pictures: Sequence[str] = (),
    sheets: Sequence[str] = (),
) -> None:
    """Write the page of a result. group_pictures: of each group of several answered shots, beside its answer. pictures:
    of each curve, SVG or the reason why there is none. sheets: of each curve, an image of all frames of its recording,
    or "". Facts that all curves share are shown once; of more than MAX_DETAILED_CURVES curves each has only its row,
    message and picture."""
    curves = result.curves
    answered = [curve for curve in curves if curve.has_answer]
    common = _common([facts(curve) for curve in answered]) if len(answered) > 1 else {}
    shared = {name: text for name, text in common.items() if text}
    groups = [group.name for group in result.groups]
    title = ", ".join(groups[:3]) + (f" and {len(groups) - 3} more" if len(groups) > 3 else "")
    content = {"result": result, "unit": result.modulus_unit, "shared": shared, "pictures": pictures}
    content["drawn"] = bool(pictures)
    content |= {"sheets": sheets, "brief": len(curves) > MAX_DETAILED_CURVES, "title": title or "no curves"}
    if len(curves) == 1:  # its picture stands beside its answer
        group_pictures, content["pictures"] = pictures, []
    content["answers"] = group_answers(result, group_pictures)
    content["names"] = digits.distinct_names([curve.name for curve in curves])
    content["origin"] = _json_markup(_common([curve.provenance for curve in (answered if shared else curves)]))
    Path(path).write_text(template("report.html").render(**content), encoding="utf-8")


def group_answers(result: Result, pictures: Sequence[str] = ()) -> list[tuple[GroupRecord, str, list[str], Any, str]]:
    """(group, heading, facts, lines, picture) of each group with an answer of its own: of those of several shots, and
    of a shot that is alone in its run. pictures: of the groups of several answered shots, or of that shot."""
    left = iter(pictures)
    alone = len(result.curves) == 1
    answers = []
    for group, shots in result.rows_by_group():
        if len(shots) > 1 or (shots and alone):
            heading = group.name if len(result.groups) > 1 else "Answer"
            lines = answer_lines(result, group, shots)
            picture = next(left, "") if group.n > 1 or alone else ""
            answers.append((group, heading, group_facts(group, shots), lines, picture))
    return answers[:MAX_ANSWERS]


def facts(record: CurveRecord) -> dict[str, str]:
    """Facts on a curve by name; the page shows those that all curves share once."""
    material = digits.MATERIAL_TITLES.get(record.material, record.material)
    method = digits.METHOD_TITLES.get(record.method, record.method)
    words = {"material": material, "bubble": record.bubble.sentence, "method": method}
    return words | {"stretch": record.diagnostics.stretch_source, "file": record.source}


def _common(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The entries that are equal in all these mappings."""
    first, *later = parts or [{}]
    return {key: value for key, value in first.items() if all((key, value) in part.items() for part in later)}


def _json_markup(origin: Mapping[str, Any]) -> Markup:
    """The mapping as JSON text, escaped for HTML."""
    return Markup(escape(json.dumps(origin, indent=1, ensure_ascii=False), quote=False))  # &quot; is longer


def about(record: CurveRecord, factor: float, unit: str) -> str:
    """HTML of all that is known of an answer, without a picture. factor, unit: unit of moduli, and its factor from
    Pa."""
    origin = _json_markup({"source": record.source, **record.provenance})
    return render_macro("about", record, factor, unit, origin=origin)


@cache
def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """The template of this file name in the folder of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, "")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True, finalize=_printable
    )
    functions = (facts, display_unit, meaning_of, parameter_key, model_rows, shot_cells, value_parts)
    environment.globals.update({function.__name__: function for function in functions})
    environment.globals.update(MIN_SORTED=MIN_SORTED, MANY=MANY)
    environment.globals.update(digits=digits, VERDICT_STYLES=digits.VERDICT_STYLES, Quantity=Quantity)
    return environment.get_template(name)


def render_macro(name: str, *values: Any, **more: Any) -> str:
    """HTML of a macro of parts.html with these arguments, marked as safe for templates."""
    return getattr(template("parts.html").module, name)(*values, **more)


def _printable(value: Any) -> Any:
    """The value; in a text control characters are escaped, and its type (str or Markup) is kept."""
    return type(value)(digits.printable(value)) if isinstance(value, str) else value
