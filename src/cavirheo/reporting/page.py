"""report.html, by templates of jinja2 that escape all text from files and command lines.

The page loads no other file: style and pictures are part of it. The script (table.js) only sorts the table of shots;
without it all content is still there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from cavirheo.reporting import advice
from cavirheo.reporting.record import Result
from cavirheo.writing import digits

if TYPE_CHECKING:
    from jinja2 import Template


def write_page(
    path: Path, result: Result, pictures: Mapping[int, str], group_pictures: Mapping[str, str], sheets: Sequence[str]
) -> None:
    """Write the page of a result. pictures: SVG of curves by their numbers, or the reason why there is none; these
    curves have a section of their own. group_pictures: of groups of several answered shots by name, beside their
    answers. sheets: of each curve, an image of all frames of its recording, or ""."""
    if len(result.curves) == 1:  # its picture stands beside its answer
        group_pictures, pictures = {group.name: pictures.get(0, "") for group in result.groups}, {0: ""}
    names = digits.distinct_names([curve.name for curve in result.curves])
    several = result.indices_by_group() if len(names) > 1 else []
    page = template("report.html").render(
        result=result,
        names=names,
        pictures=pictures,
        group_pictures=group_pictures,
        sheets=sheets or [""] * len(names),
        alone={first: group for group, (first, *others) in several if not others},
    )
    path.write_text(page, encoding="utf-8")


@cache
def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """The template of this file name in the folder of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, ""),
        autoescape=not name.endswith(".txt"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        finalize=digits.printable,
    )
    environment.globals.update(advice=advice, digits=digits)
    return environment.get_template(name)
