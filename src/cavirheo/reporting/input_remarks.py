"""What is said of measurements before they are answered, and of materials that may be several."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import input_checks
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.population.material import relative_scatter
from cavirheo.io.shots import stem_of
from cavirheo.messages import title
from cavirheo.parameters import CAMERA
from cavirheo.physics.media import WATER
from cavirheo.reporting.answer import CurveRecord
from cavirheo.reporting.record import Result
from cavirheo.writing import digits
from cavirheo.writing.terminal import once

_NO_STIFFNESS = ("upper", "undetermined")  # bounds of G
_LONGEST = 300  # letters of a command that is worth to be written again
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
            said += [(curve.name, warning.text) for warning in input_checks.of_scale(curve, WATER)]
        except InputError as error:
            said.append((curve.name, error.message))
    return once(said)


def notes(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What was recognised, converted or left out, each once with the shots that it concerns."""
    return once((curve.name, note) for curve in curves for note in curve.notes)


def causes(records: Sequence[CurveRecord]) -> dict[str, list[str]]:
    """What the messages of answers say, the most frequent first, with the names that each concerns: the sentence of
    one curve as it is, of several what all with its code have in common."""
    found: dict[str, list[tuple[str, str]]] = {}
    for one in records:
        for message in one.remarks:
            found.setdefault(message.code, []).append((one.name, message.text))
    said: dict[str, list[str]] = {}
    for code, mine in sorted(found.items(), key=lambda one: len(one[1]), reverse=True):
        common = title(code) if len({text for _, text in mine}) > 1 else ""
        said |= once((name, common or text) for name, text in mine)
    return said


def unexplained(records: Sequence[CurveRecord]) -> int:
    """How many answers ask for another law: their simulation does not follow, or no stiffness is seen."""
    soft = [one for one in records if one.verdict == "undetermined" and one.shear_modulus_Pa.bound in _NO_STIFFNESS]
    return len(soft) + sum(one.verdict == "model_does_not_fit" for one in records)


def at_fault(record: CurveRecord) -> bool:
    """Whether the recording itself may be why no simulation follows: frames that do not count, or its clock, scale or
    R_max at the end of what is expected."""
    how = record.diagnostics
    return bool(how.frames_left_out) or any(name in CAMERA for name in how.at_bound)


def next_step(document: Result, asked: Analysis, out: Path) -> str:
    """The command that helps where most answers ask for another law or bubble, or the recording to look at before;
    "" where none does."""
    if asked.method == "bdt" or asked.verify == "none":
        return ""
    unlike = [one for one in document.curves if one.verdict == "model_does_not_fit"]
    if len(unlike) > len(document.curves) / 2 and all(map(at_fault, unlike)):
        names = ", ".join(one.name for one in unlike[:3]) + f" and {len(unlike) - 3} more" * (len(unlike) > 3)
        look = "µm per pixel, frame rate, the frames at R_max and those that stand out"
        return f"next: look at the recording ({look}) before another model is tried: {names}"
    records, options = document.curves, []
    other, rejected = unexplained(records), sum(one.preferred is not None for one in records)
    if other > len(records) / 2 and asked.material != "auto":
        options += ["--material auto"]
    if rejected > len(records) / 2 and len(asked.bubbles) == 1:
        options += ["--bubble auto"]
    if not options:
        return ""
    new = f"{' '.join(options)} -o {shlex.quote(f'{out}-auto')}"
    whole = _without(document.command, "-o", "--out", *(one.partition(" ")[0] for one in options))
    many = digits.counted(len(records), "shot")
    why = f"another model may follow {other + rejected} of {many} better, and the evidence can choose it"
    return f"next: {why}: {whole if len(whole) < _LONGEST else 'the same command with'} {new}"


def _without(command: str, *options: str) -> str:
    """A command line without these options and their values."""
    words, kept = iter(shlex.split(command)), list[str]()
    for word in words:
        name, equals, _ = word.partition("=")
        if name not in options:
            kept.append(word)
        elif not equals:
            next(words, None)
    return shlex.join(kept)


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
