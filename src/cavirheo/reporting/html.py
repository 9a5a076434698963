"""report.html: one file that needs nothing else, for a colleague, a notebook or the printer.

No request to anywhere: the style and the pictures stand in the page. Its text is in report.html and parts.html beside
this module (jinja2), where every word from a file or a command line is escaped. Only the page of very many curves has a
script (report.js), which sorts and filters the rows and draws the picture that is asked for.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.reporting.answer import CurveRecord, described, meaning_of, parameter_key
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.material import GroupDifference
from cavirheo.reporting.record import Result
from cavirheo.reporting.table import FITS, model_rows, window_cells, window_title
from cavirheo.reporting.trace import MARK
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

FOLDED = 6  # curves: of more each is folded to a line, which its link in the table opens

if TYPE_CHECKING:
    from jinja2 import Environment, Template


def write(
    path: str | Path,
    result: Result,
    pictures: Iterable[str] = (),
    group_pictures: Iterable[str] = (),
    sheets: Sequence[str] = (),
    many: bool = False,
) -> None:
    """The page of a result, curve by curve; `pictures`, an image's address for each or none, may be drawn meanwhile.

    `group_pictures`: those that stand before the curves. `sheets`: of each curve all frames of its recording, or "".
    `many`: with the script that sorts, filters and draws.
    """
    unit, drawn = result.modulus_unit, iter(pictures)
    page = template("report.html")
    page.stream(
        result=result,
        style=_beside("report.css"),
        unit=unit,
        group_pictures=group_pictures,
        script=_beside("report.js") if many else "",
        articles=(
            article(k, record, *unit, next(drawn, "")) + _part("frames", sheets[k] if sheets else "")
            for k, record in enumerate(result.curves)
        ),
    ).dump(str(path))


def _beside(name: str) -> str:
    return files("cavirheo.reporting").joinpath(name).read_text(encoding="utf-8")


def groups_table(groups: Sequence[GroupRecord], factor: float, unit: str, apart: Sequence[GroupDifference] = ()) -> str:
    """One row per group, below the materials and what tells them apart; factor and unit are those of G, as
    `Result.modulus_unit` gives them."""
    return _part("groups_table", groups, factor, unit, apart)


def curves_table(
    curves: Sequence[CurveRecord], factor: float, unit: str, *, title: str = "Curves", linked: bool = True
) -> str:
    """One row per curve, with a link to its article if there is one in the page."""
    return _part("curves_table", curves, factor, unit, title, linked)


def reading(curves: Sequence[CurveRecord]) -> str:
    """What verdicts, brackets and means say."""
    return _part("reading", curves)


def article(number: int, record: CurveRecord, factor: float, unit: str, picture: str) -> str:
    """All that is known of one curve and its answer; `picture`: the address of an image, a `trace`, why there is none,
    or ""."""
    from markupsafe import Markup

    origin = {"source": record.source, **record.provenance, "seconds": round(record.seconds, 3)}
    text = escape(json.dumps(origin, indent=1, ensure_ascii=False), quote=False)  # quotes need six letters each
    windows = window_title([record], (factor, unit)), window_cells(record, (factor, unit))
    more = *windows, model_rows(record, factor), Markup(text)
    return _part("article", number, record, factor, unit, picture, *more)


def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """One of the templates in the folder of a package."""
    return _templates(package).get_template(name)


def _part(name: str, *given: Any) -> str:
    """A macro of parts.html, filled; a template takes it as it stands."""
    return getattr(template("parts.html").module, name)(*given)


def _named(name: str) -> tuple[str, float, str]:
    """A parameter's name in words, and factor and name of its unit."""
    _, unit = described(name)
    return name.replace("_", " "), *((1e6, "µs") if unit == "s" else (1.0, unit))


def _printable(value: Any) -> Any:
    """Without control characters, and as safe as it was."""
    return type(value)(digits.printable(value)) if isinstance(value, str) else value


@cache
def _templates(package: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader(package, ""), autoescape=True, undefined=StrictUndefined,
        keep_trailing_newline=True, finalize=_printable,
    )  # fmt: skip
    made.globals.update(digits=digits, LOOKS=digits.LOOKS, FITS=FITS, MARK=MARK, Quantity=Quantity, FOLDED=FOLDED)
    made.globals.update(named_parameter=_named, meaning_of=meaning_of, parameter_key=parameter_key)
    return made
