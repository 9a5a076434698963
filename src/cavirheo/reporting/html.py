"""report.html: one file that needs nothing else, for a colleague, a notebook or the printer.

No script and no request to anywhere: the style and the pictures (SVG) stand in the page. Its text is in report.html
and parts.html beside this module (jinja2), where every word from a file or a command line is escaped.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cavirheo.reporting import fitted
from cavirheo.reporting.record import CurveRecord, GroupRecord, Result
from cavirheo.writing import digits
from cavirheo.writing.document import Quantity

if TYPE_CHECKING:
    from jinja2 import Environment


def write(path: str | Path, result: Result, pictures: Iterable[str] = (), group_pictures: Iterable[str] = ()) -> None:
    """The page of a result, curve by curve: `pictures`, an <svg> element for each curve or "", may be drawn meanwhile.

    `group_pictures`: <svg> elements that stand before the curves.
    """
    factor, unit = result.modulus_unit
    drawn = iter(pictures)
    names = [group.name for group in result.groups]
    failed = sum(not record.answered for record in result.curves)
    n = f"{len(result.curves)} curve" + ("" if len(result.curves) == 1 else "s")
    about = [n + (f", {failed} not answered" if failed else ""), result.date, f"cavirheo {result.version}"]
    page = (
        _templates()
        .get_template("report.html")
        .stream(
            result=result,
            title=", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "") or "no curves",
            about=[fact for fact in about if fact],
            style=files("cavirheo.reporting").joinpath("report.css").read_text(encoding="utf-8"),
            factor=factor,
            unit=unit,
            group_pictures=group_pictures,
            articles=(
                _part("article")(*_article(number, record, factor, unit, next(drawn, "")))
                for number, record in enumerate(result.curves)
            ),
            intervals=any(record.viscosity_Pa_s.q05 is not None for record in result.curves),
        )
    )
    page.dump(str(path))


def groups_table(groups: Sequence[GroupRecord], factor: float, unit: str) -> str:
    """One row per group; factor and unit are those of G, as `Result.modulus_unit` gives them."""
    return str(_part("groups_table")(groups, factor, unit))


def curves_table(
    curves: Sequence[CurveRecord], factor: float, unit: str, *, title: str = "Curves", linked: bool = True
) -> str:
    """One row per curve, with a link to its article if there is one in the page."""
    return str(_part("curves_table")(curves, factor, unit, title, linked))


def article(number: int, record: CurveRecord, factor: float, unit: str, picture: str) -> str:
    """All that is known of one curve and its answer; `picture`: an <svg> element or nothing."""
    return str(_part("article")(*_article(number, record, factor, unit, picture)))


def _article(number: int, record: CurveRecord, factor: float, unit: str, picture: str) -> tuple[Any, ...]:
    origin = {"source": record.source, **record.provenance, "seconds": round(record.seconds, 3)}
    text = json.dumps(origin, indent=1, ensure_ascii=False)
    return number, record, factor, unit, picture, fitted.facts(record, factor, unit), text


@cache
def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("cavirheo.reporting", ""),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    made.globals.update(digits=digits, LOOKS=digits.LOOKS, Quantity=Quantity)
    return made


@cache
def _part(name: str) -> Any:
    """A macro of parts.html."""
    return getattr(_templates().get_template("parts.html").module, name)
