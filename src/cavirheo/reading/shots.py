"""Several files -> the shots of one run, with the groups that files and folders make of them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.reading import read_curves


def read_shots(
    files: Sequence[str | Path], *, density: float, pressure: float, max_radius: float | None = None
) -> tuple[list[RadiusCurve], list[str]]:
    """(all curves of all files in their order, the reason for each file that could not be read).

    `max_radius` (m) rescales every curve. Single-shot files of one folder are the shots of one material: one group.

    Raises:
        InputError: `max_radius` is no radius of a bubble.
    """
    if max_radius is not None:
        why = f"the true R_max must be a radius in micrometres, up to 1e5, got {1e6 * max_radius:.6g}"
        require(0 < max_radius < 0.1, why, "curve.max_radius")
    groups: list[list[RadiusCurve]] = []
    problems: list[str] = []
    for path in files:
        try:
            groups.append(read_curves(path, density=density, pressure=pressure))
        except InputError as error:
            problems.append(str(error))
    folders = [Path(curves[0].source).resolve().parent for curves in groups]
    shared = [folder for folder, curves in zip(folders, groups, strict=True) if len(curves) == 1]
    for folder, curves in zip(folders, groups, strict=True):
        if len(curves) == 1 and shared.count(folder) > 1:
            curves[0] = curves[0].with_group(folder.name, str(folder))
        if max_radius is not None:
            curves[:] = (_scaled(curve, max_radius) for curve in curves)
    return [curve for curves in groups for curve in curves], problems


def _scaled(curve: RadiusCurve, max_radius: float) -> RadiusCurve:
    with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
        return curve.with_max_radius(max_radius)
    return curve
