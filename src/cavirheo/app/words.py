"""Tables and facts as HTML (words.html); numbers and verdicts are written by `reporting`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from importlib.resources import files
from typing import Any

import numpy as np

from cavirheo.app.session import UPLOAD_FOLDER, Answers, Clip, PageSettings, Session
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference import DEFAULT
from cavirheo.inference.cards import card, shipped
from cavirheo.inference.what_if import compared_window
from cavirheo.reporting import group_pictures, html
from cavirheo.reporting.answer import CurveRecord, Sentence, curve_record, parameter_key
from cavirheo.reporting.citation import TITLE, methods_paragraph
from cavirheo.reporting.panels import Axis, Layer, Panel, curve_panels, overview_panels, preview_panels
from cavirheo.reporting.pictures import curve_svg, overlay_svg
from cavirheo.reporting.record import result_of
from cavirheo.reporting.table import (
    curve_warnings,
    curves_by_note,
    curves_by_remark,
    groups_with_mixed_files,
    summary_cells,
)
from cavirheo.video.picture import COLOURS, GREY, frame_url
from cavirheo.video.track import FLAGS
from cavirheo.writing import digits
from cavirheo.writing.terminal import names_by_message

VERSION = version("cavirheo")
BUBBLES = [  # label and value of each choice of the page
    ("real: vapour condenses at a finite rate, damped by its surroundings", "real"),
    ("the field's: equilibrium contents, unbounded liquid", "field"),
]
WINDOWS = [("the usual one", 0), ("1 collapse", 1), ("2 collapses", 2), ("3 collapses", 3)]
GROUPS = [
    ("those of one file; files of a single shot together", "auto"),
    ("those of one file", "file"),
    ("each by itself", "none"),
    ("those whose files have one name: soft_1, soft_2 | stiff_1", "name"),
]
NUMBER_FIELDS = {  # label, and what an empty field means, of settings that need not be given
    "density": ("Density (kg/m³)", "as the medium"),
    "fps": ("Frames per second", "of tables that number their frames"),
    "um_per_px": ("µm per pixel", "of tables in pixels"),
    "rmax_um": ("True R_max (µm)", "as measured"),
    "stretch": ("λ = R_max/R_0", "fitted; free: without the file's prior"),
    "sound_speed": ("Sound speed (m/s)", "as the medium"),
    "surface_tension": ("Surface tension (N/m)", "as the medium"),
    "pressure": ("Pressure (Pa)", "as the medium"),
    "temperature": ("Temperature (K)", "as the medium"),
}
NO_ANSWERS = "No answers yet: press the button above."
_MACROS = html.template("words.html", "cavirheo.app").module


def render(name: str, *content: Any) -> str:
    """Render the macro of this name in words.html."""
    return str(getattr(_MACROS, name)(*content)).strip()


def page_css() -> str:
    """Return the CSS of the page: the report's CSS inside .report, app.css, and the colours of the flags."""
    dots = "".join(f".picture path.flag-{flag} {{ stroke: {colour}; }}\n" for flag, colour in COLOURS.items())
    words = "".join(f".picture tspan.flag-{flag} {{ fill: {colour}; }}\n" for flag, colour in COLOURS.items())
    return f".report {{\n{html.template('report.css').render()}}}\n{read_file('app.css')}{dots}{words}"


def read_file(name: str) -> str:
    return (files("cavirheo.app") / name).read_text(encoding="utf-8")


def welcome() -> str:
    """The first view: which data are needed, how to cite, and a picture of an answer."""
    return render("welcome", read_file("examples/answer.svg"), f"{TITLE}, version {VERSION}")


_PAGE_WORDS = {  # text in messages (options of the command line or of Python): text on the page
    "Medium(..., unusual=True), --trust-input": "vouch for it in step 2",
    " (if it is meant: unusual=True)": "",
    "add --trust-input": "vouch for it in step 2",
    "(--rmax-um)": "(step 2)",
    "--rmax-um": "R_max in step 2",
    "(--fps)": "(step 1)",
    "(--fps 1e6)": "(step 1)",
    "(--fps; in Python frame_rate=)": "(step 1)",
    "(--um-per-px)": "(step 1)",
    "(--um-per-px 3.2)": "(step 1)",
    "--roi": "cavirheo measure --roi",
    "; give --um-per-px": ": type it",
}


def page_text(error: Exception | str) -> str:
    """Return the message with fields of the page in place of options of the command line."""
    message = str(error)
    for option, field in _PAGE_WORDS.items():
        message = message.replace(option, field)
    return message


def _page_rows(records: Sequence[CurveRecord]) -> list[CurveRecord]:
    """Return the rows, with their messages through `page_text`."""

    def messages(row: CurveRecord) -> list[Sentence]:
        return [Sentence(code=message.code, text=page_text(message.text)) for message in row.messages]

    return [row.model_copy(update={"messages": messages(row)}) for row in records]


def clear_warning(session: Session) -> str:
    """The warning that lists what starting over deletes."""
    files = dict.fromkeys([*(path.name for path in session.files), *session.films])
    return render("clear_warning", [*files], len(session.answers.pairs) if session.answers else 0)


def model_choices() -> list[tuple[str, str]]:
    """(label, name) of every shipped model, the default first."""
    laws = ((name, card(path)["material"]) for name, path in shipped("point").items())
    return [("any recording, with interval", DEFAULT), *((f"the paper's: {law} · {name}", name) for name, law in laws)]


def material_choices() -> list[tuple[str, str]]:
    """(label, name) of laws; the first is the default family."""
    words = {law: digits.MATERIAL_TITLES[law].partition(" (")[0] for law in ("nhkv", "newtonian", "qkv")}
    return [("a liquid, or a gel that may stiffen", "auto"), *((word, law) for law, word in words.items())]


def shot_cells(session: Session) -> list[tuple[str, tuple[str, ...]]]:
    """(name, cells of the table) of each shot."""
    return [(curve.name, summary_cells(curve)) for curve in session.curves]


def shots_table(session: Session) -> str:
    """The table of the loaded shots, a row per shot."""
    curves = session.curves
    rows = []
    for curve in curves:
        material, density = session.materials.get(curve.name, curve.group), session.densities.get(curve.name)
        density_text = "" if density is None else f"{density:.10g}"
        rows.append((curve, digits.elide(curve.name, 36), material, density_text, summary_cells(curve)))
    pooled = sum(curve.group == UPLOAD_FOLDER for curve in curves)
    return render(
        "shots_table", rows, curves_by_note(curves), session.unconfirmed, pooled, f"{session.settings.liquid.density:g}"
    )


def film_summary(clip: Clip) -> str:
    """A recording before measurement: what to do; afterwards: its warnings, R_max and remarks."""
    if clip.measurement is None:
        return render("film_summary", (), {}, {}, "")
    curve = clip.history()
    cut = f"{clip.measurement.cut_note}: the radius rests on that part alone" * bool(clip.measurement.cut_note)
    by_text = names_by_message(
        (clip.path.name, page_text(text)) for text in (cut, *(text for _, text in curve_warnings([curve])))
    )
    state = "" if clip.curve is None else "confirmed" if clip.confirmed_options == clip.options else "changed"
    return render("film_summary", summary_cells(curve), by_text, curves_by_note([curve]), state)


def film_plot(clip: Clip) -> str:
    """The picture of R(t), coloured by flag, with missing radii drawn at zero; a line marks the shown frame."""
    measurement = clip.measured
    unit, scale = ("µm", measurement.um_per_px.value) if measurement.um_per_px.value else ("px", 1.0)
    flags = np.where(clip.excluded, "excluded", measurement.track.flags)
    time, radius = 1e6 * measurement.time, np.nan_to_num(scale * measurement.track.radius)
    top, layers = 1.05 * float(radius.max()) or 1.0, list[Layer]()
    for flag in dict.fromkeys(flags.tolist()):
        layers.append(Layer("dots", f"flag-{flag}", time[flags == flag], radius[flags == flag], flag))
    layers.append(Layer("line", "frame", np.full(2, time[clip.shown_index]), np.array([0.0, top])))
    x = Axis("time (µs)", float(time[0]), float(time[-1]))
    return render("pictures", [curve_svg([Panel(x, Axis(f"R ({unit})", 0.0, top), tuple(layers))])])


def film_frame(clip: Clip) -> str:
    """The shown frame of a recording with its circle, number, time, radius and flag."""
    measurement, i = clip.measured, clip.shown_index
    track, scale = measurement.track, measurement.um_per_px.value
    radius, sigma = (f"{float(x[i]) * (scale or 1.0):.{n}g}" for x, n in ((track.radius, 4), (track.sigma, 1)))
    size = f"R = {radius} ± {sigma} {'µm' if scale else 'px'}" if np.isfinite(track.radius[i]) else ""
    where = f"Frame {clip.shown_frame} of {measurement.last}, {1e6 * measurement.time[i]:.4g} µs"
    flag = str(track.flags[i])
    look = flag, COLOURS.get(flag, GREY), FLAGS[flag], bool(clip.excluded[i])
    return render("film_frame", frame_url(measurement, i, 560), where, size, *look)


def overview(session: Session) -> str:
    """The pictures of all curves over each other."""
    media = [session.settings_of(curve.name).analysis.medium_for(curve) for curve in session.curves]
    return render("pictures", [overlay_svg(panel) for panel in overview_panels(session.curves, media)])


def groups(session: Session) -> str:
    """The report's pictures of all groups of several shots."""
    answers = session.answers
    return render("pictures", group_pictures(answers.pairs, answers.document, []) if answers else [])


def check_plot(session: Session, name: str) -> str:
    """Picture of the answer over the measurement, with its band, conventional fit and sliders' simulation."""
    answers, curve, posterior, _ = session.find_answer(name)
    fit, simulated = answers.fits.get(name), f"simulation: {digits.simulation_name(posterior.method)}"
    simulations: Any = {"fit": fit and fit.checks, "what_if": answers.trials.get(name)}
    return render("pictures", [curve_svg(curve_panels(curve, posterior.checks, simulated, **simulations), 840, 460)])


def warnings(curves: Sequence[RadiusCurve]) -> dict[str, list[str]]:
    """The warnings on these shots: names of the shots by warning."""
    return names_by_message((name, page_text(text)) for name, text in curve_warnings(curves))


def prepared_curve(curve: RadiusCurve, settings: PageSettings) -> str:
    """The picture of a curve with its compared frames, or the error; its warnings, and remarks on how it was read."""
    picture, remarks = "", warnings([curve])
    try:
        picture = curve_svg(preview_panels(curve, compared_window(curve, settings.analysis).curve))
    except InputError as error:
        remarks = {page_text(error): [curve.name]}
    return render("prepared_curve", picture, remarks, curves_by_note([curve]))


def answers(session: Session) -> str:
    """The answers: groups, shots, their messages, and whether settings changed since; during a run, the answers so
    far."""
    current, chosen = session.answers, list(session.so_far.values())
    ready = [row for row in chosen if row]
    if chosen:
        current = Answers([], result_of(ready, ""), [], session.request)
    if current is None:
        return render("hint", NO_ANSWERS)
    document = current.document
    factor, unit = document.modulus_unit
    differences = [difference.words for difference in document.differences]
    said = [html.render_macro("group_answer", *answer) for answer in html.group_answers(document)]
    said.append(html.render_macro("comparisons", document.groups, factor, unit))
    groups = "\n".join(said), differences
    rows, models = _page_rows(document.curves), {row.model_title for row in document.curves if row.has_answer}
    title = f"Shots: {next(iter(models))}" if len(models) == 1 else "Shots"
    shots = html.render_macro("curves_table", rows, factor, unit, title, False)
    explanation = html.render_macro("reading"), *methods_paragraph(document)
    progress = (len(ready), len(chosen)), len(document.curves), current.not_run, groups_with_mixed_files(document)
    return render(
        "answers", session.stale and not chosen, *progress, *groups, shots, curves_by_remark(rows), *explanation
    )


def facts(session: Session, name: str) -> str:
    """The answer and its conventional fit, if there is one, as rows of a table; then all facts of the answer."""
    answers, curve, answer, record = session.find_answer(name)
    (record,) = _page_rows([record])
    factor, unit = answers.document.modulus_unit
    table, failed, frames = "", {}, list[int]()
    if posterior := answers.fits.get(name):
        rows = {"answer": record, "least squares": curve_record(curve, posterior)}
        records = [row.model_copy(update={"name": what}) for what, row in rows.items()]
        table = html.render_macro("curves_table", records, factor, unit, "Answer and conventional fit", False)
        failed = names_by_message((row.name, row.message) for row in records[1:] if not row.has_answer)
        times = (posterior.checks.compared_time for posterior in (answer, posterior))
        frames = [len(time) for time in times if time is not None]
    key = parameter_key(record.other_parameters)
    return render("facts", table, frames, failed, record, html.about(record, factor, unit), key)
