"""What is said of measurements before they are answered, and of materials that may be several."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import checks
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.population import relative_scatter
from cavirheo.io.shots import stem_of
from cavirheo.messages import title
from cavirheo.parameters import CAMERA
from cavirheo.physics.media import WATER
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits
from cavirheo.writing.terminal import by_message

_NO_STIFFNESS = ("upper", "undetermined")  # bounds of G
WIDE = 0.4  # scatter of G from shot to shot, of its mean: a gel made once has less


def summary_cells(curve: RadiusCurve) -> tuple[str, ...]:
    """R_max, frame rate, frames with a radius, time that was recorded, collapses."""
    top, collapses = digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    frames = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.number(curve.frame_rate, 1e-3), frames, recorded, collapses


def warnings(curves: Iterable[RadiusCurve]) -> Iterator[tuple[str, str]]:
    """(name, sentence) of what must not be overlooked: curves without R_max, and scales that make no sense."""
    for curve in curves:
        yield from ((curve.name, warning.text) for warning in checks.curve_warnings(curve, WATER))
        try:
            _ = curve.max_radius
        except InputError as error:
            yield curve.name, error.message


def notes(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What was recognised, converted or left out, each once with the shots that it concerns."""
    return by_message((curve.name, note) for curve in curves for note in curve.notes)


def causes(records: Sequence[CurveRecord]) -> dict[str, list[str]]:
    """What the messages of answers say, the most frequent first, with the names that each concerns: the sentence of
    one curve as it is, of several what all with its code have in common."""
    by_code: dict[str, list[tuple[str, str]]] = {}
    for record in records:
        for message in record.remarks:
            by_code.setdefault(message.code, []).append((record.name, message.text))
    sentences: dict[str, list[str]] = {}
    for code, mine in sorted(by_code.items(), key=lambda item: len(item[1]), reverse=True):
        common = title(code) if len({text for _, text in mine}) > 1 else ""
        sentences |= by_message((name, common or text) for name, text in mine)
    return sentences


def unexplained(records: Sequence[CurveRecord]) -> int:
    """How many answers ask for another law: their simulation does not follow, or no stiffness is seen."""
    unlike = sum(record.verdict == "model_does_not_fit" for record in records)
    undetermined = [record.shear_modulus_Pa.bound for record in records if record.verdict == "undetermined"]
    return unlike + sum(bound in _NO_STIFFNESS for bound in undetermined)


def next_step(document: Result, analysis: Analysis, out: Path) -> str:
    """The command that helps where most answers ask for another law or bubble, or the recording to look at before;
    "" where none does."""
    if analysis.method == "bdt" or analysis.verify == "none":
        return ""
    unlike = [record for record in document.curves if record.verdict == "model_does_not_fit"]
    causes = [record.diagnostics for record in unlike]
    at_fault = [how for how in causes if how.frames_left_out or {*CAMERA} & {*how.at_bound}]
    if len(at_fault) == len(unlike) > len(document.curves) / 2:
        names = ", ".join(record.name for record in unlike[:3]) + f" and {len(unlike) - 3} more" * (len(unlike) > 3)
        look = "µm per pixel, frame rate, the frames at R_max and those that stand out"
        return f"next: look at the recording ({look}) before another model is tried: {names}"
    records, options = document.curves, []
    unsuited, rejected = unexplained(records), sum(record.preferred is not None for record in records)
    if unsuited > len(records) / 2 and analysis.material != "auto":
        options += ["--material auto"]
    if rejected > len(records) / 2 and len(analysis.bubbles) == 1:
        options += ["--bubble auto"]
    if not options:
        return ""
    many = digits.counted(len(records), "shot")
    why = f"another model may follow {unsuited + rejected} of {many} better, and the evidence can choose it"
    return f"next: {why}: the same command with {' '.join(options)} -o {shlex.quote(f'{out}-auto')}"


def pooled(document: Result) -> list[tuple[str, str, list[str]]]:
    """(group, scatter of G in %, stems of the files' names) of groups that scatter more than WIDE, and whose files
    have several names, of which some differ in a number alone: several materials?"""
    groups = []
    for group, shots in document.shots():
        spreads = group.population.spreads_decades if group.population else {}
        scatter = relative_scatter(spreads["shear_modulus"].median or 0.0) if "shear_modulus" in spreads else 0.0
        files = {shot.source for shot in shots}
        stems = sorted({stem_of(file) for file in files})
        if scatter > WIDE and 1 < len(stems) < len(files):
            groups.append((group.name, digits.significant(100 * scatter, 2), stems))
    return groups
