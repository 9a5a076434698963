"""Tables and facts as HTML (words.html); numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from cavirheo.app.session import YOURS, Answers, PageSettings, Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import AUTO, DEFAULT
from cavirheo.inference.model import card, shipped
from cavirheo.inference.what_if import compared_window
from cavirheo.reporting import html
from cavirheo.reporting.answer import CurveRecord, Sentence, curve_record, parameter_key
from cavirheo.reporting.citation import TITLE, methods
from cavirheo.reporting.curve_panels import preview_panels
from cavirheo.reporting.input_remarks import causes, cells, notes, pooled, warnings
from cavirheo.reporting.record import result_of
from cavirheo.reporting.svg import curve_svg
from cavirheo.writing import digits
from cavirheo.writing.terminal import once

VERSION = version("cavirheo")
NONE = "No answers yet: press the button above."
_PARTS = html.template("words.html", "cavirheo.app").module


def part(name: str, *given: Any) -> str:
    """This part of words.html."""
    return str(getattr(_PARTS, name)(*given)).strip()


def style() -> str:
    """The style of the page: that of the report for all that stands in .report, and its own."""
    return f".report {{\n{html.style()}}}\n{script('app.css')}"


def script(name: str) -> str:
    return (files("cavirheo.app") / name).read_text(encoding="utf-8")


def welcome() -> str:
    """What to bring, whom to cite, and a picture of an answer."""
    return part("welcome", script("examples/answer.svg"), f"{TITLE}, version {VERSION}")


_HERE = {  # by what stands in messages: an option of the command line or of Python, and what the page has for it
    "Medium(..., unusual=True), --trust-input": "vouch for it in step 2",
    " (if it is meant: unusual=True)": "",
    "add --trust-input": "vouch for it in step 2",
    "(--rmax-um)": "(step 2)",
    "--rmax-um": "R_max in step 2",
    "(--fps)": "(in the file)",
    "--roi": "cavirheo measure --roi",
    "; give --um-per-px": ": type it",
}


def told(error: Exception | str) -> str:
    """The message, with the field of the page instead of the option of the command line."""
    said = str(error)
    for option, field in _HERE.items():
        said = said.replace(option, field)
    return said


def _told(records: Sequence[CurveRecord]) -> list[CurveRecord]:
    """The rows with messages as `told`."""
    return [
        row.model_copy(update={"messages": [Sentence(code=one.code, text=told(one.text)) for one in row.messages]})
        for row in records
    ]


def lost(session: Session) -> str:
    """What starting over deletes."""
    files = dict.fromkeys([*(path.name for path in session.files), *session.films])
    return part("lost", [*files], len(session.answers.pairs) if session.answers else 0)


def models() -> list[tuple[str, str]]:
    """(label, name) of every shipped model, the default first."""
    laws = ((name, card(path)["material"]) for name, path in shipped("point").items())
    return [("any recording, with interval", DEFAULT), *((f"the paper's: {law} · {name}", name) for name, law in laws)]


def materials() -> list[tuple[str, str]]:
    """(label, name) of the laws that the default answers."""
    words = {law: digits.MATERIALS.get(law, law).partition(" (")[0] for law in AUTO}
    return [(word, law) for law, word in words.items()] + [("whichever the evidence prefers (slower)", "auto")]


def table(session: Session) -> list[tuple[str, tuple[str, ...]]]:
    """Name and cells of each shot."""
    return [(one.name, cells(one)) for one in session.curves]


def found(session: Session) -> str:
    """What was found in the files: a row per shot."""
    curves, typed = session.curves, {shot: f"{density:.10g}" for shot, density in session.densities.items()}
    rows = [
        (one, digits.elide(one.name, 36), session.named.get(one.name, one.group), typed.get(one.name, ""), cells(one))
        for one in curves
    ]
    pooled = sum(one.group == YOURS for one in curves)
    density = f"{session.settings.liquid.density:g}"
    return part("found", rows, notes(curves), session.waiting, pooled, density)


def warned(session: Session) -> str:
    """The warnings on all shots, in full."""
    return part("warned", {told(text): names for text, names in warnings(session.curves).items()})


def prepared(curve: RadiusCurve, settings: PageSettings) -> str:
    """A curve with the frames that are compared, or why it cannot be shown; the warnings on it, and what was done to
    it."""
    picture, said = "", warnings([curve])
    try:
        picture = curve_svg(preview_panels(curve, compared_window(curve, settings.analysis).curve))
    except InputError as error:
        said = {str(error): [curve.name]}
    return part("prepared", picture, {told(text): names for text, names in said.items()}, notes([curve]))


def answers(session: Session) -> str:
    """The answers: materials, groups, shots, what is said of them, and whether settings were changed since; in a run
    those that are known so far."""
    found, soon = session.answers, list(session.soon.values())
    final = "" if session.settings.verify == "none" else "unverified"  # verdict of those that simulations verify
    verified = sum(row is not None and row.verdict != final for row in soon)
    if soon:
        found = Answers([], result_of([row for row in soon if row], ""), [], session.settings)
    if found is None:
        return part("quiet", NONE)
    document = found.document
    factor, unit = document.modulus_unit
    groups = html.part("groups_table", document.groups, factor, unit), [one.words for one in document.differences]
    rows, models = _told(document.curves), {row.in_words for row in document.curves if row.answered}
    title = f"Shots: {next(iter(models))}" if len(models) == 1 else "Shots"
    shots = html.part("curves_table", rows, factor, unit, title, False)
    said = causes(rows)
    about = html.part("reading", document.curves), *methods(document)
    done = (verified, len(soon)), len(document.curves), found.not_run, pooled(document)
    return part("answers", session.stale and not soon, *done, *groups, shots, said, *about)


def facts(session: Session, name: str) -> str:
    """The answer, and the conventional fit if there is one, as rows of one table; then all facts of the answer."""
    answers, curve, answer, record = session.find(name)
    (record,) = _told([record])
    factor, unit = answers.document.modulus_unit
    table, failed, frames = "", {}, list[int]()
    if posterior := answers.fits.get(name):
        rows = {"answer": record, "least squares": curve_record(curve, posterior)}
        records = [row.model_copy(update={"name": what}) for what, row in rows.items()]
        table = html.part("curves_table", records, factor, unit, "Answer and conventional fit", False)
        failed = once((row.name, row.message) for row in records[1:] if not row.answered)
        times = (one.checks.compared_time for one in (answer, posterior))
        frames = [len(time) for time in times if time is not None]
    key = parameter_key(record.other_parameters)
    return part("facts", table, frames, failed, html.article(record, factor, unit), key)
