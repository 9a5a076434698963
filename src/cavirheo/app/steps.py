"""What the buttons do: the functions of the command line, called for one visitor."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from cavirheo.app.session import Answers, PageSettings, Session
from cavirheo.companions.published_values import add_to_groups
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, parse_number, require
from cavirheo.inference.what_if import checks_with, compared_window, slider
from cavirheo.io import write_csv
from cavirheo.io.subprocess_reader import Report
from cavirheo.io.videos import Camera
from cavirheo.parallel import cores, run_on_any_core
from cavirheo.posterior import Checks, Posterior
from cavirheo.reporting import file_names, result, write_report
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.record import Pairs
from cavirheo.reporting.table import count_unsuited
from cavirheo.workflow.store import with_source_of
from cavirheo.writing import digits
from cavirheo.writing.document import LIST_FILE
from cavirheo.writing.packing import content_hash

SLIDERS = {  # label, factor from SI
    "shear_modulus": ("Try G (kPa)", 1e-3),
    "viscosity": ("Try µ (Pa s)", 1.0),
    "stretch": ("Try λ (R_max/R_0)", 1.0),
}
_CHANGED_MESSAGE = "files or settings were changed while it ran: its answers are dropped; run it again"


def examples() -> dict[str, Path]:
    """The shipped measurements by their names."""
    folder = Path(__file__).parent / "examples"
    return {path.name: path for kind in ("*gel.*", "*.mp4") for path in sorted(folder.glob(kind))}


def measure(session: Session, camera: Camera, say: Report) -> None:
    """Measure the shown recording in a child process; excluded frames stay excluded. Raises InputError."""
    film, (rate, scale, us) = session.current_clip, camera
    images, most = session.folder / f"{token_hex(8)}.npy", session.limits.film_mb * 1e6
    numbers = {"frame_rate": rate, "um_per_px": scale, "exposure": us and us * 1e-6}
    try:
        measurement = session.measurer.measure(film.path, images, most, say, **numbers)
    finally:
        with suppress(OSError):  # some systems cannot remove a file that is memory-mapped
            images.unlink(missing_ok=True)
    with session.lock:
        require(film in session.films.values(), "the recording was removed while it was measured", "app.changed")
        listed = film.excluded_text
        for clip in session.films.values():
            clip.measurement = clip.selection = None  # frames are kept of one recording only
        film.camera, film.measurement, film.selection = camera, measurement, measurement
        film.shown_frame = measurement.first + int(np.nanargmax(measurement.track.radius))
        film.set_excluded(listed)


def confirm(session: Session) -> None:
    """Hand the curve of the shown recording to the next steps, in place of its earlier curve. Raises InputError."""
    film = session.current_clip
    session.films[session.film_name] = replace(film, curve=film.history(sheet=True), confirmed_options=film.options)
    try:
        session.set_files([*session.files, *({film.path} - {*session.files})], session.settings)
    except InputError:
        session.films[session.film_name] = film
        raise


def _answer(session: Session, names: Sequence[str]) -> list[tuple[RadiusCurve, Posterior | None]]:
    """Return (curve, answer) of each chosen shot; None if a stop came before its answer. Each answer goes into
    `session.so_far` at once. Raises InputError."""
    with session.lock:
        chosen = [curve for curve in session.curves if curve.name in names]
        analyses = {curve.name: session.settings_of(curve.name).analysis for curve in chosen}
    require(bool(chosen), "no shots: load a file in step 1, and choose shots in step 2", "app.no_shots")
    so_far, workers = session.so_far, max(cores() // len(chosen), 1)

    def answer_one(curve: RadiusCurve) -> Posterior:
        analysis = analyses[curve.name]
        job = partial(analysis.answer, curve, workers=workers)
        answer = session.compute_once(session.store, analysis.key(curve), partial(run_on_any_core, job))
        answer = with_source_of(answer, curve)
        so_far[curve.name] = curve_record(*session.regroup([(curve, answer)])[0])
        return answer

    return list(zip(chosen, session.runs.run_jobs(answer_one, chosen), strict=True))


def infer(session: Session, names: Sequence[str]) -> Answers:
    """Return the answers of the chosen shots, and keep them in the session; a stop leaves out unfinished shots. Raises
    InputError: no or too many shots, stopped before the first answer, or files or settings changed during the run."""
    with session.lock:
        request, curves = session.request, session.curves
    try:
        answers = _answer(session, names)
        pairs = [(curve, answer) for curve, answer in answers if answer]
        pooled = _pool_answers(session, pairs, [curve.name for curve, answer in answers if not answer], request)
    finally:
        if not session.runs.busy.locked():  # an earlier run, which continues, uses them
            session.so_far = {}
    with session.lock:
        require(session.curves is curves and session.request == request, _CHANGED_MESSAGE, "app.changed")
        session.answers = pooled
        return session.answers


def _pool_answers(
    session: Session, pairs: Pairs, not_run: list[str], request: tuple[PageSettings, Mapping[str, float]]
) -> Answers:
    """Return the answers with their document: groups, published values, command and notes."""
    (settings, densities), pairs = request, session.regroup(pairs)
    command = session.command(settings)
    if len(pairs) < len(session.curves):
        command += f" ({len(pairs)} of {len(session.curves)} shots)"
    by_group = dict.fromkeys((curve.group, densities[curve.name]) for curve, _ in pairs if curve.name in densities)
    command += "".join(f" ({shlex.quote(group)}: --density {density:g})" for group, density in by_group)
    materials = ", ".join(f"{shot} = {material}" for shot, material in session.materials.items())
    document = result(pairs, command, notes=[f"materials that were typed: {materials}"] if materials else [])
    for values in session.published:
        with suppress(InputError):  # other groups than when they were given
            add_to_groups(document.groups, values)
    return Answers(pairs, document, not_run, request)


def name_materials(session: Session, names: Sequence[str], densities: Sequence[str] = ()) -> None:
    """Set the material of each loaded shot, "" for the group of its file, and pool the answers again. densities: kg/m3
    of each shot, "" for that of the settings; the files are read again if these change. Raises InputError."""
    fine = len(names) == len(session.curves) and len(densities) in (0, len(names))
    require(fine, "the files were changed: reload the page", "app.changed")
    shots = [curve.name for curve in session.curves]
    if densities:
        numbers = {shot: parse_number(text, "density") for shot, text in zip(shots, densities, strict=True)}
        by_shot = {shot: density for shot, density in numbers.items() if density is not None}
        session.apply_settings(session.settings, by_shot)
    groups = zip(session.curves, map(str.strip, names), strict=True)
    session.materials = {curve.name: name[:60] for curve, name in groups if name not in ("", curve.group)}
    if old := session.answers:
        pooled = _pool_answers(session, old.pairs, old.not_run, old.request)
        session.answers = replace(pooled, fits=old.fits)


def fit(session: Session, name: str | None) -> None:
    """Fit an answered curve conventionally: same law, bubble, medium, window and stretch. Raises InputError."""
    with session.lock:
        (answers, curve, posterior, _), settings = session.find_answer(name), session.settings_of(name or "")
    analysis, end = settings.analysis, None
    if analysis.method == "bdt":  # a network with a fixed window: the fit takes the same window
        end = compared_window(curve, analysis).end * (1.0 + 1e-9)
    model: dict[str, Any] = {"material": posterior.material, "bubble": posterior.bubble}
    analysis = replace(analysis, method="fit", free=None, end=end, **model)
    (answer,) = session.runs.run_jobs(partial(run_on_any_core, analysis.answer), [curve])
    with session.lock:
        if answer is None or session.answers is not answers:
            raise InputError(_CHANGED_MESSAGE, "app.changed")
        answers.fits[curve.name] = answer


def sliders(session: Session, name: str) -> dict[str, dict[str, float] | None]:
    """Return the limits, step and start of each slider, in kPa, Pa s and 1; None for a parameter that the law lacks."""
    posterior = session.find_answer(name)[2]
    return {key: slider(posterior, key, factor) for key, (_, factor) in SLIDERS.items()}


def what_if(session: Session, name: str, values: Sequence[float | None]) -> Checks:
    """Simulate with the sliders' values over the window of the answer; return the Checks, and keep them in the answers.
    The Checks of a failed simulation hold the reason."""
    answers, curve, posterior, _ = session.find_answer(name)
    changed = {key: v / SLIDERS[key][1] for key, v in zip(SLIDERS, values, strict=True) if v is not None}
    answers.trials[name] = checks_with(curve, posterior, changed, session.settings_of(name).analysis)
    return answers.trials[name]


def law_in_doubt(session: Session) -> bool:
    """Whether most answers suggest another law, and the settings of these answers name a single law."""
    records = session.answers.document.curves if session.answers else []
    open_law = session.settings.material is None or session.stale
    return not open_law and count_unsuited(records) > len(records) / 2


def export(session: Session, progress: Report) -> tuple[Path, list[Path]]:
    """Return (the path of the zip, paths of its files outside subfolders). Raises InputError: no current answers."""
    if (answers := session.answers) is None or session.stale:
        raise InputError("nothing to export: infer first (step 3)", "app.no_answer")
    fits = [(curve, answers.fits[curve.name]) for curve, _ in answers.pairs if curve.name in answers.fits]
    folder = session.folder / "export"
    progress(0.0, "pictures are drawn")
    archive, document = session.folder / "cavirheo-result.zip", answers.document
    published = {group.name: group.published for group in document.groups}

    def build() -> bytes:
        with TemporaryDirectory() as base:
            result_folder = Path(base, "cavirheo-result")
            for kind in ("processed", "simulated"):
                (result_folder / kind).mkdir(parents=True)
            options: dict[str, Any] = {"notes": document.notes, "published": published}
            write_report(result_folder, answers.pairs, document.command, **options)
            if fits:
                write_report(result_folder / "least-squares", fits, f"{document.command}; then fit", **options)
            for listing in result_folder.rglob(LIST_FILE):  # the list of files by run, which one run does not need
                listing.unlink()
            _write_curves(result_folder, answers)
            return Path(shutil.make_archive(f"{base}/made", "zip", base, result_folder.name)).read_bytes()

    key = content_hash([answers.pairs, document.command, fits, document.notes, published])
    archive.write_bytes(session.compute_once(session.zips, key, build))  # visitors with the same answers share one zip
    shutil.rmtree(folder, ignore_errors=True)
    shutil.unpack_archive(archive, folder)
    return archive, sorted(path for path in (folder / "cavirheo-result").iterdir() if path.is_file())


def _write_curves(folder: Path, answers: Answers) -> None:
    """Write the processed and the simulated curves as CSV."""
    names = file_names([record.name for record in answers.document.curves])
    for stem, (curve, posterior), record in zip(names, answers.pairs, answers.document.curves, strict=True):
        write_csv(folder / "processed" / f"{stem}.csv", curve)
        time, radius = posterior.checks.reconstruction_time, posterior.checks.reconstruction_radius
        if time is not None and radius is not None:
            # leave out points so close to a frame that their times are equal in the digits of the CSV
            distinct = np.diff(time, prepend=-np.inf) > 1e-15
            place = folder / "simulated" / f"{stem}-{digits.simulation_name(posterior.method).replace(' ', '-')}.csv"
            remark = f"simulation of {record.name}, {record.simulation_in_words}"
            write_csv(place, RadiusCurve(time[distinct], radius[distinct]), remark)
