"""live.html: the page for the wall at the bench. It shows the latest shot, the material so far and how many shots are
still wanted, and loads itself anew every two seconds. No script, no request to anywhere."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting import html
from cavirheo.reporting.curve_panels import answer_panels
from cavirheo.reporting.record import Result
from cavirheo.reporting.svg import curve_svg, style

PAGE = "live.html"
WIDE, HIGH = 335.0, 178.0  # px of the picture, whose type is to be large
WANTED = 0.1  # half of the 90 % interval of the material, over its value


def page(
    result: Result | None = None,
    latest: int = -1,
    curve: RadiusCurve | None = None,
    answer: Posterior | None = None,
    wanted: float = WANTED,
) -> str:
    """Of a result; without one it waits for the first. latest: index of the shot that is shown large, with its curve
    and answer. wanted: half of the 90 % interval over the value, by which shots that are still wanted are counted."""
    result = result or Result(command="", curves=[], groups=[])
    group, members = next((one for one in result.members() if latest in one[1]), (None, []))
    record = result.curves[latest] if group else None
    picture = ""
    if curve and answer and record:
        with suppress(InputError):
            picture = curve_svg(answer_panels(curve, answer.checks, record), WIDE, HIGH)
    counts = {"shots": len(result.curves), "trusted": sum(one.trusted for one in result.curves)}
    counts["failed"] = sum(not one.answered for one in result.curves)
    material = group.population if group and group.population and group.population.found else None
    more = material.still_wanted([result.curves[i] for i in members], wanted) if material else None
    return html.template(PAGE).render(
        result=result, record=record, group=group, material=material, more=more, percent=100.0 * wanted,
        unit=result.modulus_unit, picture=picture, style=style(), **counts,
    )  # fmt: skip


def write(path: str | Path, *shown: Any, **how: Any) -> None:
    """What `page` makes of these."""
    Path(path).write_text(page(*shown, **how), encoding="utf-8")


def read(folder: Path) -> str:
    """The page that is in a folder, or one that waits for it."""
    with suppress(OSError):
        return (folder / PAGE).read_text(encoding="utf-8")
    return page()
