"""report.html, a single file with everything in it, to send, store or print.

The page loads no other file: style and pictures (SVG) are part of it. The text of the report is in the templates
report.html and parts.html beside this module (jinja2), which escape all text from files and command lines. The script
(table.js) only sorts the table of shots; without it all content is still there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.reporting.answer import CurveRecord, display_unit, meaning_of, parameter_key
from cavirheo.reporting.comparison import comparison_key, comparison_table
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.laws import LAW_HEADS, LAWS_TITLE
from cavirheo.reporting.record import Result
from cavirheo.reporting.screen import answer_lines, group_facts
from cavirheo.reporting.table import shots_table
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

MAX_ANSWERS = 200  # most groups whose answer has a section of its own; the table has all shots

if TYPE_CHECKING:
    from jinja2 import Template


def write(
    path: str | Path,
    result: Result,
    pictures: Mapping[int, str] = {},
    group_pictures: Mapping[str, str] = {},
    sheets: Sequence[str] = (),
) -> None:
    """Write the page of a result. pictures: SVG of curves by their numbers, or the reason why there is none; these
    curves have a section of their own. group_pictures: of groups of several answered shots by name, beside their
    answers. sheets: of each curve, an image of all frames of its recording, or ""."""
    groups = [group.name for group in result.groups]
    title = ", ".join(groups[:3]) + (f" and {len(groups) - 3} more" if len(groups) > 3 else "")
    if len(result.curves) == 1:  # its picture stands beside its answer
        group_pictures, pictures = dict.fromkeys(groups, pictures.get(0, "")), {0: ""}
    content: dict[str, Any] = {"result": result, "pictures": pictures, "title": title or "no curves"}
    content |= {"answers": group_answers(result, group_pictures), "sheets": sheets or [""] * len(result.curves)}
    content["names"] = digits.distinct_names([curve.name for curve in result.curves])
    Path(path).write_text(template("report.html").render(**content), encoding="utf-8")


def group_answers(
    result: Result, pictures: Mapping[str, str] = {}
) -> list[tuple[GroupRecord, str, list[str], list[tuple[str, list[str]]], str]]:
    """(group, heading, facts, lines, picture) of each group with an answer of its own: of those of several shots, and
    of a shot that is alone in its run. pictures: by the names of groups."""
    answers = []
    for group, shots in result.rows_by_group():
        if len(shots) > 1 or (shots and len(result.curves) == 1):
            heading = group.name if len(result.groups) > 1 else "Answer"
            lines = answer_lines(result, group, shots)
            answers.append((group, heading, group_facts(group, shots), lines, pictures.get(group.name, "")))
    return answers[:MAX_ANSWERS]


def facts(record: CurveRecord) -> dict[str, str]:
    """Facts on a curve by name."""
    material = digits.MATERIAL_TITLES.get(record.material, record.material)
    method, _ = digits.METHODS.get(record.method, (record.method, ""))
    words = {"name": record.name, "file": record.source, "material": material, "bubble": record.bubble.sentence}
    if record.has_answer:
        words |= {"window": record.window.words, "drawn": record.simulation_in_words, "method": method}
        words["stretch"] = record.diagnostics.stretch_source
    if record.strain_rate_per_s is not None:
        rate = digits.significant(record.strain_rate_per_s, 2)
        words["strain rate"] = f"{rate} 1/s, mean from R_max to the first collapse"
    return {name: text for name, text in words.items() if text}


@cache
def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """The template of this file name in the folder of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, "")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True, finalize=_printable
    )
    functions = (facts, display_unit, meaning_of, parameter_key)
    tables = (shots_table, comparison_table, comparison_key)
    environment.globals.update({function.__name__: function for function in (*functions, *tables)})
    environment.globals.update(digits=digits, VERDICT_STYLES=digits.VERDICT_STYLES, Quantity=Quantity)
    environment.globals.update(LAW_HEADS=LAW_HEADS, LAWS_TITLE=LAWS_TITLE)
    return environment.get_template(name)


def render_macro(name: str, *values: Any, **more: Any) -> str:
    """HTML of a macro of parts.html with these arguments, marked as safe for templates."""
    return getattr(template("parts.html").module, name)(*values, **more)


def _printable(value: Any) -> Any:
    """The value; in a text control characters are escaped, and its type (str or Markup) is kept."""
    return type(value)(digits.printable(value)) if isinstance(value, str) else value
