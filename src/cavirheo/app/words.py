"""Tables and facts as HTML (words.html); numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from base64 import b64encode
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from cavirheo.app.session import YOURS, Answers, Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import AUTO, DEFAULT
from cavirheo.inference.model import card, shipped
from cavirheo.reporting import html
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.citing import TITLE, methods_if_any
from cavirheo.reporting.found import causes, cells, notes, pooled, warnings
from cavirheo.reporting.record import result_of
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
    places = {"cavirheo.reporting": "report.css", "cavirheo.app": "app.css"}
    report, page = ((files(room) / name).read_text(encoding="utf-8") for room, name in places.items())
    return f".report {{\n{report}}}\n{page}"


def script(name: str) -> str:
    return (files("cavirheo.app") / name).read_text(encoding="utf-8")


def welcome() -> str:
    """What to bring, whom to cite, and a picture of an answer."""
    image = (files("cavirheo.app") / "examples" / "answer.png").read_bytes()
    return part("welcome", f"data:image/png;base64,{b64encode(image).decode()}", f"{TITLE}, version {VERSION}")


def told(error: Exception | str) -> str:
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


def found(session: Session) -> str:
    """What was found in the files: a row per shot, the warnings in full, and the files that could not be read."""
    curves = session.curves
    rows = [(one, digits.elide(one.name, 36), session.named.get(one.name, one.group), cells(one)) for one in curves]
    pooled = sum(one.group == YOURS for one in curves)
    return part("found", session.problems, rows, warnings(curves), notes(curves), session.waiting, pooled)


def prepared(curve: RadiusCurve, error: InputError | None = None) -> str:
    """The warnings on a curve, or why it cannot be shown, and what was done to it."""
    return part("prepared", {told(error): [curve.name]} if error else warnings([curve]), notes([curve]))


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
    groups = html.groups_table(document.groups, factor, unit), [one.words for one in document.differences]
    shots = html.curves_table(document.curves, factor, unit, title="Shots", linked=False)
    said = causes(document.curves)
    about = found.density, html.reading(document.curves), *methods_if_any(document)
    done = (verified, len(soon)), len(document.curves), found.not_run, pooled(document)
    return part("answers", session.stale and not soon, *done, *groups, shots, said, *about)


def facts(session: Session, name: str) -> str:
    """The answer, and the conventional fit if there is one, as rows of one table; then all facts of the answer."""
    answers, curve, answer, record = session.find(name)
    factor, unit = answers.document.modulus_unit
    table, failed, frames = "", {}, list[int]()
    if posterior := answers.fits.get(name):
        rows = {"answer": record, "least squares": curve_record(curve, posterior)}
        records = [row.model_copy(update={"name": what}) for what, row in rows.items()]
        table = html.curves_table(records, factor, unit, title="Answer and conventional fit", linked=False)
        failed = once((row.name, row.message) for row in records[1:] if not row.answered)
        times = (one.checks.compared_time for one in (answer, posterior))
        frames = [len(time) for time in times if time is not None]
    return part("facts", table, frames, failed, html.article(0, record, factor, unit, ""))
