"""Several files -> the shots of one run: each counted once, named apart, in the groups that files and folders make."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.parameters import RADIUS
from cavirheo.reading import read_curves
from cavirheo.reading.curve_tables import ONE_SCALE

GROUPINGS = ("auto", "file", "folder", "name", "none")
# the number of a shot at the end of a name, with what stands before it; a decimal number is no shot's
_NUMBER = re.compile(r"(?:[^\w.,]|_)*(?<![.,])\d+(?: \(\d+\))?[)\]]?$")


class Recordings(NamedTuple):
    """The curves of all files in their order; why files could not be read; which recordings were given twice and how
    they were scaled; and what of scales and constants should be known, a line for all groups that it concerns."""

    curves: list[RadiusCurve]
    problems: list[str]
    remarks: list[str]
    hints: list[str]


def read_shots(
    files: Sequence[str | Path | RadiusCurve], *, max_radius: float | None = None, group: str = "auto", **reading: Any
) -> Recordings:
    """All curves of all files; `reading` are the options of `read_curves`. A curve stands for a file that was read.

    A recording that is given again (the same samples, in whichever file) is left out with a remark. Names that several
    curves share get their folders before them.

    Args:
        max_radius: m, the true R_max: rescales every curve, by one factor.
        group: whose shots are one material: "file" (of one file), "folder" (of all files of a folder), "name" (of
            the files of a folder whose names differ in the number at their end), "none" (each by itself), "auto" (of
            one file; single-shot files of one folder together).

    Raises:
        InputError: `max_radius` is no radius of a bubble, or would scale curves by different factors; or `group` is
            none of these.
    """
    require(group in GROUPINGS, f"group must be one of {', '.join(GROUPINGS)}, got {group!r}", "option.group")
    check_max_radius(max_radius)
    found: list[RadiusCurve] = []
    problems: list[str] = []
    for path in files:
        try:
            found += [path] if isinstance(path, RadiusCurve) else read_curves(path, **reading)
        except InputError as error:
            problems.append(str(error))
    curves, remarks = _once(found)
    curves = _grouped(_named_apart(curves), group)
    about: dict[str, dict[str, None]] = {}
    for curve in curves:
        for hint in curve.hints:
            about.setdefault(hint, {})[curve.group] = None
    hints = [f"{', '.join(groups)}: {hint}" for hint, groups in about.items()]
    if max_radius:
        curves, said = _scaled(curves, max_radius)
        remarks += said
    return Recordings(curves, problems, remarks, hints)


def samples_of(curve: RadiusCurve) -> bytes:
    """By which a recording is known again in whichever file; without samples, one is like no other."""
    known = curve.time.tobytes() + curve.radius.tobytes() or f"{curve.source}: {curve.name}: {curve.unusable}".encode()
    return hashlib.sha256(known).digest()


def _once(curves: list[RadiusCurve]) -> tuple[list[RadiusCurve], list[str]]:
    """The curves without those whose samples were there before, and a remark on each of these."""
    first: dict[bytes, RadiusCurve] = {}
    again: list[str] = []
    for curve in curves:
        if (other := first.setdefault(samples_of(curve), curve)) is not curve:
            here, there = (f"{one.name} ({one.source})" for one in (curve, other))
            again.append(f"{here} is the same recording as {there}: it is counted once")
    return list(first.values()), again


def _named_apart(curves: list[RadiusCurve]) -> list[RadiusCurve]:
    """The curves with unlike names: those that several files share get the file's ending, or folders, or a number."""
    sharing: dict[str, list[int]] = {}
    for k, curve in enumerate(curves):
        sharing.setdefault(curve.name, []).append(k)
    for name, places in sharing.items():
        if len(places) < 2:
            continue
        paths = [Path(curves[k].source).resolve() for k in places]
        tails = (["/".join((*path.parts[-depth:-1], name)) for path in paths] for depth in range(2, 9))
        endings = [name + path.suffix for path in paths]
        numbers = [f"{name} ({k})" for k in range(1, len(places) + 1)]
        apart = next((some for some in (*tails, endings) if len(set(some)) == len(places)), numbers)
        for k, new in zip(places, apart, strict=True):
            curves[k] = curves[k].labelled(name=new)
    return curves


def _grouped(curves: list[RadiusCurve], group: str) -> list[RadiusCurve]:
    sources = Counter(curve.source for curve in curves)
    alone = [sources[curve.source] == 1 for curve in curves]
    folders = [Path(curve.source).resolve().parent for curve in curves]
    singles = Counter(folder for folder, single in zip(folders, alone, strict=True) if single)
    made = []
    for curve, folder, single in zip(curves, folders, alone, strict=True):
        if group == "none":
            curve = curve.with_group(curve.name, curve.source)
        elif group == "name":
            stem = stem_of(curve.source)
            curve = curve.with_group(stem or folder.name, str(folder / stem))
        elif group == "folder" or (group == "auto" and single and singles[folder] > 1):
            curve = curve.with_group(folder.name, str(folder))
        made.append(curve)
    return made


def stem_of(file: str) -> str:
    """'soft' of soft_1.csv, soft 02.csv and soft_1 (2).csv; "" of 7.csv."""
    return _NUMBER.sub("", Path(file).stem)


def _scaled(curves: list[RadiusCurve], max_radius: float) -> tuple[list[RadiusCurve], list[str]]:
    """The curves with this R_max, and by which factor their radii are scaled. Raises InputError: there are several."""
    made, factors = list(curves), dict[str, float]()
    for k, curve in enumerate(curves):
        with suppress(InputError):  # without a maximum there is nothing to scale; the answer will say why
            made[k] = curve.with_max_radius(max_radius)
            factors[curve.name] = float(np.nanmax(made[k].radius) / np.nanmax(curve.radius))
    if not factors:
        return made, []
    low, high = min(factors, key=factors.__getitem__), max(factors, key=factors.__getitem__)
    given, ends = f"--rmax-um {1e6 * max_radius:g}", f"{factors[low]:.4g} ({low}) to {factors[high]:.4g} ({high})"
    message = (
        f"{given} would scale the shots by {ends}, but a wrong scale is one factor for all of them: give the R_max "
    )
    message += "of each shot in a column rmax_um of the file, or each shot in a run of its own"
    require(factors[high] <= (1.0 + ONE_SCALE) * factors[low], message, "option.several_scales")
    pixels = any(curve.unscaled for curve in curves)
    return made, [given + ("" if pixels else f": radii scaled by {factors[high]:.4g}")]


def check_max_radius(given: float | None) -> None:
    """Raise InputError unless it is None, or a radius (m) that a bubble has."""
    if given is not None:
        low, high = (1e6 * end for end in RADIUS[:2])
        why = f"the true R_max must be a radius in micrometres, {low:g} to {high:g}, got {1e6 * given:.6g}"
        require(RADIUS.low <= given <= RADIUS.high, why, "curve.max_radius")
