"""Tables and facts as HTML (words.html); numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib.resources import files
from typing import Any

import numpy as np

from cavirheo.app import film as film_step
from cavirheo.app.session import Answers, Clip, Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import AUTO, DEFAULT
from cavirheo.inference.model import card, shipped
from cavirheo.reporting import html
from cavirheo.reporting.answer import curve_record
from cavirheo.video.picture import COLOURS, GREY, frame_address
from cavirheo.video.track import FLAGS
from cavirheo.writing import digits
from cavirheo.writing.terminal import once

_PARTS = html.template("words.html", "cavirheo.app").module


def part(name: str, *given: Any) -> str:
    """This part of words.html."""
    return str(getattr(_PARTS, name)(*given)).strip()


def style() -> str:
    """The style of the page: that of the report for all that stands in .report, and its own."""
    places = {"cavirheo.reporting": "report.css", "cavirheo.app": "app.css"}
    report, page = ((files(room) / name).read_text(encoding="utf-8") for room, name in places.items())
    return f".report {{\n{report}}}\n{page}"


def told(error: Exception) -> str:
    """The message, with the field of the page instead of the option of the command line."""
    said = str(error).replace("--rmax-um", "R_max in step 2").replace("--roi", "cavirheo measure --roi")
    return said.replace("; give --um-per-px", ": type it")


def models() -> list[tuple[str, str]]:
    """(label, name) of every shipped model, the default first."""
    laws = ((name, card(path)["material"]) for name, path in shipped("point").items())
    return [("any recording, with interval", DEFAULT), *((f"the paper's: {law} · {name}", name) for name, law in laws)]


def materials() -> list[tuple[str, str]]:
    """(label, name) of the laws that the default answers."""
    words = {law: digits.MATERIALS.get(law, law).partition(" (")[0] for law in AUTO}
    return [(word, law) for law, word in words.items()] + [("whichever the evidence prefers (slower)", "auto")]


def found(curves: Sequence[RadiusCurve], problems: Sequence[str], waiting: Sequence[str] = ()) -> str:
    """What was found in the files: a row per shot, the warnings in full, and the files that could not be read."""
    rows = [(curve.name, digits.elide(curve.name, 36), _cells(curve)) for curve in curves]
    return part("found", problems, rows, _warnings(curves), _notes(curves), waiting)


def film(one: Clip, error: InputError | None = None) -> str:
    """What to do with a recording, or why it cannot be measured; what is doubtful and what was found."""
    if error or one.found is None:
        return part("film", told(error) if error else "", (), {}, {}, "")
    curve = film_step.curve(one)
    doubts = once((one.path.name, told(InputError(doubt))) for doubt in curve.doubts)
    state = "" if one.curve is None else "confirmed" if one.command == film_step.options(one) else "changed"
    return part("film", "", _cells(curve), _warnings([curve]) | doubts, _notes([curve]), state)


def frame(one: Clip) -> str:
    """The shown frame of a recording with its circle, what it is, and how many there are of each kind."""
    found, out = film_step.measured(one), film_step.left_out(one)
    track, i, scale = found.track, one.shown - found.first, found.um_per_px.value
    size = [f"{float(x[i]) * (scale or 1.0):.{n}g}" for x, n in ((track.radius, 4), (track.sigma, 1))]
    seen = f"R = {size[0]} ± {size[1]} {'µm' if scale else 'px'}" if np.isfinite(track.radius[i]) else ""
    where = f"Frame {one.shown} of {found.first + len(out) - 1}, {1e6 * found.time[i]:.4g} µs"
    flag = str(track.flags[i])
    look = flag, COLOURS.get(flag, GREY), FLAGS[flag], bool(out[i])
    return part("frame", frame_address(found, i, 560), where, seen, *look)


def _cells(curve: RadiusCurve) -> tuple[str, ...]:
    """R_max, frame rate, frames with a radius, time that was recorded, collapses."""
    rate, top, collapses = curve.frame_rate, digits.MISSING, digits.MISSING
    with suppress(InputError):
        top, collapses = digits.micrometres(curve.max_radius), str(len(curve.collapse_times()))
    seen = f"{np.isfinite(curve.radius).sum()} of {len(curve.time)}"
    recorded = f"{1e6 * np.ptp(curve.time):.4g}" if len(curve.time) else digits.MISSING
    return top, digits.significant(rate / 1000) if rate else digits.MISSING, seen, recorded, collapses


def prepared(curve: RadiusCurve, error: InputError | None = None) -> str:
    """The warnings on a curve, or why it cannot be shown, and what was done to it."""
    return part("prepared", {told(error): [curve.name]} if error else _warnings([curve]), _notes([curve]))


def _warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What must not be overlooked: curves without R_max, and scales that make no sense."""
    said = []
    for curve in curves:
        try:
            _ = curve.max_radius
            said.append((curve.name, curve.scale_warning() or ""))
        except InputError as error:
            said.append((curve.name, told(error).removeprefix(f"{curve.name}: ")))
    return once(said)


def _notes(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """What was recognised, converted or left out, each once with the shots that it concerns."""
    return once((curve.name, note) for curve in curves for note in curve.notes)


def answers(found: Answers | None) -> str:
    """The table of the answers: groups, curves, and what is said of them."""
    if found is None:
        return part("quiet", "No answers yet: press the button above.")
    document = found.document
    factor, unit = document.modulus_unit
    tables = html.groups_table(document.groups, factor, unit)
    tables += html.curves_table(document.curves, factor, unit, title="Shots", linked=False)
    said = once((record.name, record.message) for record in document.curves)
    return part("answers", len(document.curves), found.not_run, tables, said)


def facts(session: Session, name: str) -> str:
    """The answer, and the conventional fit if there is one, as rows of one table; then all facts of the answer."""
    answers, curve, _, record = session.find(name)
    factor, unit = answers.document.modulus_unit
    table, failed = "", {}
    if posterior := answers.fits.get(name):
        rows = {"answer": record, "least squares": curve_record(curve, posterior)}
        records = [row.model_copy(update={"name": what}) for what, row in rows.items()]
        table = html.curves_table(records, factor, unit, title="Answer and conventional fit", linked=False)
        failed = once((row.name, row.message) for row in records[1:] if not row.answered)
    return part("facts", table, failed, html.article(0, record, factor, unit, ""))
