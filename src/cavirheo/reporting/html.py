"""report.html: one file that needs nothing else, for a colleague, a notebook or the printer.

No request to anywhere: the style and the pictures (SVG) stand in the page. Its text is in report.html and parts.html
beside this module (jinja2), where every word from a file or a command line is escaped. The script (report.js) of a page
of several curves only sorts and filters them; all is there without it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.reporting import svg
from cavirheo.reporting.answer import CurveRecord, described, meaning_of, parameter_key
from cavirheo.reporting.group import GroupRecord
from cavirheo.reporting.material import GroupDifference
from cavirheo.reporting.record import Result
from cavirheo.reporting.table import FITS, model_rows, window_cells, window_title
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

FOLDED = 6  # curves: of more each is folded to a line, which its link in the table opens
DETAILED = 500  # curves: of more each has its row, message and picture

if TYPE_CHECKING:
    from jinja2 import Environment, Template
    from markupsafe import Markup


def write(
    path: str | Path,
    result: Result,
    pictures: Sequence[str] = (),
    group_pictures: Sequence[str] = (),
    sheets: Sequence[str] = (),
) -> None:
    """The page of a result, curve by curve; `pictures`: SVG of each curve, or in plain words why there is none.

    `group_pictures`: those that stand before the curves. `sheets`: of each curve all frames of its recording, or "".
    What is the same for all curves is said once; of more than DETAILED curves each has its row, message and picture.
    """
    curves, unit = result.curves, result.modulus_unit
    shared, brief = _shared(curves), len(curves) > DETAILED
    articles = []
    for k, record in enumerate(curves):
        picture, sheet = pictures[k] if pictures else "", sheets[k] if sheets else ""
        told: Any = {"shared": frozenset(shared), "brief": brief, "number": k}
        articles.append(article(record, *unit, picture, **told) + _part("frames", sheet))
    page = template("report.html").render(
        result=result,
        style=style(),
        unit=unit,
        group_pictures=group_pictures,
        script=_beside("report.js") if len(curves) > FOLDED else "",
        articles=articles,
        pictured=bool(pictures),
        shared=shared,
        origin=_text(_common([one.provenance for one in curves if one.answered or not shared])),
        brief=brief,
    )
    Path(path).write_text(page, encoding="utf-8")


def _shared(curves: Sequence[CurveRecord]) -> dict[str, str]:
    """What is the same for all of several curves that are answered, by its name."""
    told = [
        {
            "material": digits.MATERIALS.get(one.material, one.material),
            "bubble": one.bubble.sentence,
            "method": digits.METHODS.get(one.method, one.method),
            "stretch": one.diagnostics.stretch_source,
            "file": one.source,
        }
        for one in curves
        if one.answered
    ]
    return {name: text for name, text in _common(told).items() if text} if len(told) > 1 else {}


def _common(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The entries that all of these have alike."""
    first, *others = parts or [{}]
    return {key: value for key, value in first.items() if all(key in one and one[key] == value for one in others)}


def _text(origin: Mapping[str, Any]) -> Markup:
    """As JSON."""
    from markupsafe import Markup

    return Markup(escape(json.dumps(origin, indent=1, ensure_ascii=False), quote=False))  # quotes need six letters each


def style() -> str:
    """How tables, articles, verdicts and pictures look."""
    badges = "".join(f".badge.{verdict} {{ background: {look.colour}; }}\n" for verdict, look in digits.LOOKS.items())
    return _beside("report.css") + badges + svg.style()


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


def article(
    record: CurveRecord,
    factor: float,
    unit: str,
    picture: str = "",
    *,
    shared: frozenset[str] = frozenset(),
    brief: bool = False,
    number: int | None = None,
) -> str:
    """What is known of one curve and its answer.

    picture: SVG, why there is none, or "". shared: names of facts that are said elsewhere. brief: its message and its
    picture alone. number: of the curve in the page, which has the provenance and the name itself; None elsewhere.
    """
    if brief:
        return _part("brief_article", number, record, picture)
    windows = window_title([record], (factor, unit)), window_cells(record, (factor, unit))
    origin = "" if number is not None else _text({"source": record.source, **record.provenance})
    return _part("article", number, record, factor, unit, picture, *windows, model_rows(record, factor), shared, origin)


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
    made.globals.update(digits=digits, LOOKS=digits.LOOKS, FITS=FITS, Quantity=Quantity, FOLDED=FOLDED)
    made.globals.update(named_parameter=_named, meaning_of=meaning_of, parameter_key=parameter_key)
    return made
