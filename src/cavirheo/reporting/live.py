"""live.html: the page for the wall at the bench. It shows the latest shot and the material so far, and loads itself
anew every two seconds. No script, no request to anywhere."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from cavirheo.arrays import Floats
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.posterior import Posterior
from cavirheo.reporting import html
from cavirheo.reporting.record import Result

PAGE = "live.html"
WIDE, HIGH = 900.0, 420.0  # of the drawing, in its own units
BEYOND = 0.5  # of the window that was compared, that is shown after it


def write(
    path: str | Path,
    result: Result,
    latest: int = -1,
    curve: RadiusCurve | None = None,
    answer: Posterior | None = None,
) -> None:
    """The page of a result; `latest`: the index of the shot that is shown large, with its curve and its answer."""
    group = next((group for group, members in result.members() if latest in members), None)
    record = result.curves[latest] if group else None
    drawn = drawing(curve, answer) if curve and answer else {}
    counts = {"shots": len(result.curves), "trusted": sum(one.trusted for one in result.curves)}
    counts["failed"] = sum(not one.answered for one in result.curves)
    page = html.template(PAGE)
    page.stream(result=result, record=record, group=group, unit=result.modulus_unit, drawn=drawn, **counts).dump(
        str(path)
    )


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
