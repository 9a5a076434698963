"""What is said of measurements before they are answered, and of materials that may be several."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import doubts
from cavirheo.inference.population.material import relative_scatter
from cavirheo.physics.media import WATER
from cavirheo.reading.shots import stem_of
from cavirheo.reporting.record import Result
from cavirheo.writing import digits
from cavirheo.writing.terminal import once

WIDE = 0.4  # scatter of G from shot to shot, of its mean: a gel made once has less


def cells(curve: RadiusCurve) -> tuple[str, ...]:
    """R_max, frame rate, frames with a radius, time that was recorded, collapses."""
    rate, top, collapses = curve.frame_rate, digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    seen = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.significant(rate / 1000) if rate else digits.MISSING, seen, recorded, collapses


def warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What must not be overlooked: curves without R_max, and scales that make no sense."""
    said = []
    for curve in curves:
        try:
            _ = curve.max_radius
            said.append((curve.name, "; ".join(doubts.of_scale(curve, WATER))))
        except InputError as error:
            said.append((curve.name, str(error).removeprefix(f"{curve.name}: ")))
    return once(said)


def notes(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What was recognised, converted or left out, each once with the shots that it concerns."""
    return once((curve.name, note) for curve in curves for note in curve.notes)


def pooled(document: Result) -> list[tuple[str, str, list[str]]]:
    """(group, scatter of G in %, stems of the files' names) of groups that scatter more than WIDE, and whose files
    have several names, of which some differ in a number alone: several materials?"""
    said = []
    for group, members in document.members():
        known = group.population.spreads_decades if group.population else {}
        scatter = relative_scatter(known["shear_modulus"].median or 0.0) if "shear_modulus" in known else 0.0
        files = {document.curves[i].source for i in members}
        stems = sorted({stem_of(file) for file in files})
        if scatter > WIDE and 1 < len(stems) < len(files):
            said.append((group.name, digits.significant(100 * scatter, 2), stems))
    return said
