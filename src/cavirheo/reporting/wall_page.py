"""live.html: the page for the wall at the bench. It shows the latest shot, the material so far and how many shots are
still wanted, and loads itself anew every two seconds. No script, no request to anywhere."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting import html
from cavirheo.reporting.record import Result

PAGE = "live.html"
WIDE, HIGH = 900.0, 420.0  # of the drawing, in its own units
WANTED = 0.1  # half of the 90 % interval of the material, over its value
BEYOND = 0.5  # of the window that was compared, that is shown after it


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
    drawn = drawing(curve, answer) if curve and answer else {}
    counts = {"shots": len(result.curves), "trusted": sum(one.trusted for one in result.curves)}
    counts["failed"] = sum(not one.answered for one in result.curves)
    material = group.population if group and group.population and group.population.found else None
    more = material.still_wanted([result.curves[i] for i in members], wanted) if material else None
    return html.template(PAGE).render(
        result=result, record=record, group=group, material=material, more=more, percent=100.0 * wanted,
        unit=result.modulus_unit, drawn=drawn, **counts,
    )  # fmt: skip


def write(path: str | Path, *shown: Any, **how: Any) -> None:
    """What `page` makes of these."""
    Path(path).write_text(page(*shown, **how), encoding="utf-8")


def read(folder: Path) -> str:
    """The page that is in a folder, or one that waits for it."""
    with suppress(OSError):
        return (folder / PAGE).read_text(encoding="utf-8")
    return page()


def drawing(curve: RadiusCurve, answer: Posterior) -> dict[str, object]:
    """Measured points and simulated line in units of the drawing, with what its axes say; nothing of a curve without
    R_max."""
    with suppress(InputError):
        begin, top, checks = curve.time_of_max, curve.max_radius, answer.checks
        compared = checks.compared_time
        last = float(curve.time[-1])
        if compared is not None and len(compared):
            last = min(last, float(compared[-1] + BEYOND * (compared[-1] - begin)))
        first = max(float(curve.time[0]), begin - 0.4 * (last - begin))

        def placed(time: Floats | None, radius: Floats | None) -> list[tuple[float, float]]:
            if time is None or radius is None:
                return []
            seen = np.isfinite(radius) & (time >= first) & (time <= last)
            x, y = WIDE * (time[seen] - first) / (last - first), HIGH * (1.0 - radius[seen] / (1.08 * top))
            return list(zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True))

        line = placed(checks.reconstruction_time, checks.reconstruction_radius)
        return {
            "points": placed(curve.time, curve.radius), "line": " ".join(f"{x},{y}" for x, y in line),
            "wide": WIDE, "high": HIGH, "top": HIGH * (1.0 - 1.0 / 1.08), "span": 1e6 * (last - first),
            "radius": 1e6 * top,
        }  # fmt: skip
    return {}
