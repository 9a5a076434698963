"""report.html: one file that needs nothing else, for a colleague, a notebook or the printer; and live.html, the page
for the wall at the bench.

No request to anywhere: the style and the pictures (SVG) stand in the page. Its text is in report.html and parts.html
beside this module (jinja2), where every word from a file or a command line is escaped. The script (report.js) of a page
of several curves only sorts and filters them; all is there without it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting.answer import CurveRecord, in_unit, meaning_of, parameter_key
from cavirheo.reporting.panels import answer_panels
from cavirheo.reporting.pictures import curve_svg
from cavirheo.reporting.record import Result
from cavirheo.reporting.table import FITS, model_rows, windows
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

FOLDED = 6  # curves: of more each is folded to a line, which its link in the table opens
DETAILED = 500  # curves: of more each has its row, message and picture
LIVE = "live.html"
HALF_WIDTH = 0.1  # of the 90 % interval of the material, over its value
_LIVE_SIZE = (335.0, 178.0)  # px of the picture, whose type is to be large

if TYPE_CHECKING:
    from jinja2 import Template


def write(
    path: str | Path,
    result: Result,
    pictures: Sequence[str] = (),
    group_pictures: Sequence[str] = (),
    sheets: Sequence[str] = (),
) -> None:
    """The page of a result: before the curves `group_pictures`, of each curve its picture (SVG, or in plain words why
    there is none) and its sheet (all frames of its recording, or ""). What is the same for all curves is said once; of
    more than DETAILED curves each has its row, message and picture."""
    curves = result.curves
    answers = [curve for curve in curves if curve.has_answer]
    common = _common([facts(curve) for curve in answers]) if len(answers) > 1 else {}
    shared = {name: text for name, text in common.items() if text}
    content = {"result": result, "unit": result.modulus_unit, "shared": shared, "brief": len(curves) > DETAILED}
    content |= {"pictures": pictures, "group_pictures": group_pictures, "sheets": sheets}
    content["origin"] = _text(_common([curve.provenance for curve in (answers if shared else curves)]))
    Path(path).write_text(template("report.html").render(**content), encoding="utf-8")


def facts(record: CurveRecord) -> dict[str, str]:
    """What is said of a curve, or once of all where it is the same."""
    material = digits.MATERIALS.get(record.material, record.material)
    method = digits.METHODS.get(record.method, record.method)
    words = {"material": material, "bubble": record.bubble.sentence, "method": method}
    return words | {"stretch": record.diagnostics.stretch_source, "file": record.source}


def _common(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The entries that all of these have alike."""
    first, *later = parts or [{}]
    return {key: value for key, value in first.items() if all((key, value) in part.items() for part in later)}


def _text(origin: Mapping[str, Any]) -> Markup:
    """As JSON."""
    return Markup(escape(json.dumps(origin, indent=1, ensure_ascii=False), quote=False))  # quotes need six letters each


def article(record: CurveRecord, factor: float, unit: str) -> str:
    """What is known of one curve and its answer, without a picture. unit and factor: of moduli."""
    return part("article", record, factor, unit, origin=_text({"source": record.source, **record.provenance}))


@cache
def template(name: str, package: str = "cavirheo.reporting") -> Template:
    """One of the templates in the folder of a package."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, "")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True, finalize=_printable
    )
    functions = (facts, in_unit, meaning_of, parameter_key, model_rows, windows)
    environment.globals.update({function.__name__: function for function in functions})
    environment.globals.update(digits=digits, LOOKS=digits.LOOKS, FITS=FITS, Quantity=Quantity, FOLDED=FOLDED)
    return environment.get_template(name)


def part(name: str, *values: Any, **more: Any) -> str:
    """A macro of parts.html, filled; a template takes it as it stands."""
    return getattr(template("parts.html").module, name)(*values, **more)


def live_page(
    result: Result | None = None,
    latest: int = -1,
    curve: RadiusCurve | None = None,
    answer: Posterior | None = None,
    half_width: float = HALF_WIDTH,
) -> str:
    """The page for the wall at the bench: the latest shot (its index, curve and answer), the material so far, and how
    many shots are still needed until the 90 % interval is +- `half_width` of the value. It loads itself anew every two
    seconds, without a script; without a result it waits for the first."""
    result = result or Result(command="", curves=[], groups=[])
    group, members = next((row for row in result.members() if latest in row[1]), (None, []))
    record, picture = result.curves[latest] if group else None, ""
    if curve and answer and record:
        with suppress(InputError):
            picture = curve_svg(answer_panels(curve, answer.checks, record), *_LIVE_SIZE)
    material = group.material if group else None
    needed = material.still_needed([result.curves[i] for i in members], half_width) if material else None
    content = {"record": record, "group": group, "material": material, "more": needed, "percent": 100.0 * half_width}
    return template(LIVE).render(**content, result=result, picture=picture)


def _printable(value: Any) -> Any:
    """Without control characters, and as safe as it was."""
    return type(value)(digits.printable(value)) if isinstance(value, str) else value
