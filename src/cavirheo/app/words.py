"""Tables and facts as HTML (words.html); numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from contextlib import suppress
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from cavirheo.app.session import UPLOAD_FOLDER, Answers, PageSettings, Session, option_of
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import DEFAULT
from cavirheo.inference.network_files import card, shipped
from cavirheo.posterior import Checks
from cavirheo.reporting.advice import curves_by_message
from cavirheo.reporting.citation import TITLE, methods_paragraph
from cavirheo.reporting.documents import result_of
from cavirheo.reporting.measured import curve_warnings, curves_by_note, summary_cells
from cavirheo.reporting.panels import all_curves_panel, curve_panels
from cavirheo.reporting.pictures import GROUP_SIZE, picture
from cavirheo.reporting.templates import template
from cavirheo.writing import digits

VERSION = version("cavirheo")
CITED = f"{TITLE}, version {VERSION}"
BUBBLES = [  # label and value of each choice of the page
    ("real: vapour condenses at a finite rate, damping and inertia of walls", "real"),
    ("the field's: equilibrium contents, unbounded liquid", "field"),
]
WINDOWS: list[Any] = [("the usual one", ""), ("1 collapse", 1), ("2 collapses", 2), ("3 collapses", 3)]
GROUPS = [
    ("those of one file; files of a single shot together", "auto"),
    ("those of one file", "file"),
    ("each by itself", "none"),
    ("those whose files have one name: soft_1, soft_2 | stiff_1", "name"),
]
TEXT_FIELDS = {  # label, and what an empty field means
    "fps": ("Frames per second", "as the camera was set"),
    "um_per_px": ("µm per pixel", "of recordings, or tables in pixels"),
    "exposure_us": ("Exposure, µs", "if known"),
    "exclude": ("Frames to leave out", "none; 12,40-45"),
    "density": ("Density, kg/m³", "as the medium"),
    "rmax_um": ("True R_max, µm", "as measured"),
    "stretch": ("λ = R_max/R_0", "fitted; free: without the file's prior"),
    "sound_speed": ("Sound speed, m/s", "as the medium"),
    "surface_tension": ("Surface tension, N/m", "as the medium"),
    "pressure": ("Pressure, Pa", "as the medium"),
    "temperature": ("Temperature, K", "as the medium"),
}
VOUCH = "I vouch for scale, frame rate and medium, however odd they look"
HYPHEN = "\u2011"  # at which no line is broken
NO_ANSWERS = "No answers with these settings yet: press the button above."
_MACROS = template("words.html", "cavirheo.app").module
_PARTS: Any = template("parts.html").module  # of the report


def render(name: str, *content: Any) -> str:
    """Render the macro of this name in words.html."""
    return str(getattr(_MACROS, name)(*content)).strip()


def with_option(label: str, name: str) -> str:
    """The label of a field with the option of the command line, which messages name; its hyphens do not break."""
    return f"{label} ({option_of(name).replace('-', HYPHEN)})"


def page_head() -> str:
    """Return CSS and script of the page: the report's CSS inside .report, app.css, and the report's table.js."""
    css = f".report {{\n{template('report.css').render()}}}\n{read_file('app.css')}"
    return f"<style>{css}</style><script>{template('table.js').render()}</script>"


def read_file(name: str) -> str:
    return (files("cavirheo.app") / name).read_text(encoding="utf-8")


def model_choices() -> list[tuple[str, str]]:
    """(label, name) of every shipped model, the default first."""
    laws = ((name, card(path)["material"]) for name, path in shipped("point").items())
    return [("any recording, with interval", DEFAULT), *((f"the paper's: {law} · {name}", name) for name, law in laws)]


def material_choices() -> list[tuple[str, str]]:
    """(label, name) of laws; the first is the default family."""
    words = {law: digits.MATERIAL_TITLES[law].partition(" (")[0] for law in ("nhkv", "newtonian", "qkv")}
    usual = "a liquid that may thin, or a gel that may stiffen"
    return [(usual, "auto"), *((word, law) for law, word in words.items())]


def shots_table(session: Session) -> str:
    """The table of the loaded shots, a row per shot."""
    curves = session.curves
    rows = [(curve, digits.elide(curve.name, 36), summary_cells(curve)) for curve in curves]
    pooled = sum(curve.group == UPLOAD_FOLDER for curve in curves)
    return render("shots_table", rows, curves_by_note(curves), pooled)


def overview(session: Session) -> str:
    """The picture of all curves over each other, R/R_max over t*; those without R_max are left out."""
    usable = []
    for curve in session.curves:
        with suppress(InputError):
            medium = session.settings.analysis.medium_for(curve)
            usable.append((curve, Checks("ok", time_scale=medium.time_scale(curve.max_radius))))
    return render("pictures", [picture([all_curves_panel(usable)], GROUP_SIZE)] if usable else [])


def check_plot(session: Session, name: str) -> str:
    """Picture of the answer over the measurement, with its band and the sliders' simulation."""
    answers, curve, posterior, _ = session.find_answer(name)
    panels = curve_panels(curve, posterior.checks, posterior.method, answers.trials.get(name))
    return render("pictures", [picture(panels, (840, 460))])


def prepared_curve(curve: RadiusCurve, settings: PageSettings) -> str:
    """The picture of a curve with its compared frames, or the error; its warnings, and remarks on how it was read."""
    drawn = ""
    remarks = curve_warnings([curve])
    try:
        window = settings.analysis.experiment(curve).window
        drawn = picture(curve_panels(curve, Checks("ok", compared_time=window.time)))
    except InputError as error:
        remarks = {str(error): [curve.name]}
    sheet = curve.meta.get("contact_sheet", "")
    return render("prepared_curve", drawn, remarks, curves_by_note([curve]), sheet)


def answers(session: Session) -> str:
    """The answers: groups with their pictures, shots, messages, citations; during a run those so far, not drawn."""
    current = session.answers
    run = session.run
    if run:
        current = Answers([], result_of(run.ready, command=""), [], {})
    if current is None:
        return render("hint", NO_ANSWERS)
    document = current.document
    groups = _PARTS.group_answers(document, current.pictures)
    groups += _PARTS.comparisons(document)
    rows = document.rows
    names = [row.name for row in rows]
    shots = _PARTS.curves_table(document, rows, names)
    explanation = _PARTS.reading(), *methods_paragraph(document)
    done = len(document.curves), current.not_run
    return render("answers", run, *done, groups, shots, curves_by_message(rows, names), *explanation)


def facts(session: Session, name: str) -> str:
    """All facts of the answer."""
    answers, *_, record = session.find_answer(name)
    about = _PARTS.about(record, answers.document)
    return render("facts", record, about)
