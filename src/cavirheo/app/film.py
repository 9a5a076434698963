"""The step of a recording: measured, looked at frame by frame, frames left out, and confirmed as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf
from secrets import token_hex

import numpy as np
from plotly.graph_objects import Figure

from cavirheo.app.session import Camera, Clip, Session
from cavirheo.arrays import Bools
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, number_of, require
from cavirheo.reading import noted
from cavirheo.reading.apart import Report
from cavirheo.reading.recordings import history
from cavirheo.reporting.interactive import filmed
from cavirheo.video.frames import CAMERAS, STACKS
from cavirheo.video.measurement import Measurement
from cavirheo.video.picture import COLOURS
from cavirheo.writing import digits


def typed(film: Clip, texts: Sequence[str]) -> tuple[Camera, list[str]]:
    """Frame rate, scale and exposure; why the film cannot be measured so, field by field, empty where it can."""
    values: list[float | None] = []
    wrong = []
    for text, field in zip(texts, Camera._fields, strict=True):
        value, why = None, ""
        try:
            value = number_of(text, field.replace("_", " "))
        except InputError as error:
            why = str(error)
        values.append(value)
        wrong.append(why if value is None or 0 < value < inf else "must be a positive number")
    ending, unscaled = film.path.suffix.lower(), film.found is not None and film.found.um_per_px.value is None
    if values[0] is None and ending not in CAMERAS:
        wrong[0] = wrong[0] or "missing: type the rate of the camera; the file states only how fast it is played"
    if values[1] is None and (ending not in STACKS or unscaled):
        wrong[1] = wrong[1] or "missing: type how many micrometres a pixel shows"
    return Camera(*values), wrong


def unready(film: Clip, *texts: str) -> list[str]:
    """Why its curve cannot be confirmed so, field by field: numbers as `typed`, then the list of frames."""
    camera, wrong = typed(film, texts[:3])
    changed = ["changed since: measure again" * (new != old) for new, old in zip(camera, film.camera, strict=True)]
    return [why or other for why, other in zip(wrong, changed, strict=True)] + unlisted(film, texts[3])


def unlisted(film: Clip, listed: str) -> list[str]:
    """Leave out these frames, "12, 40-45", and no others; or say why not. A list half typed counts so far."""
    listed = listed.strip(" ,-–")
    try:
        film.kept = film.found and film.found.without(listed) if listed else film.found
    except InputError as error:
        return [str(error)]
    return [""]


def measured(film: Clip) -> Measurement:
    """Its measurement, with all frames. Raises InputError: there is none."""
    if film.found is None:
        raise InputError("measure the recording first (step 1)", "app.not_measured")
    return film.found


def measure(session: Session, camera: Camera, say: Report) -> None:
    """Measure the film in the process for it; excluded frames stay excluded. Raises InputError."""
    film = session.current
    images, most, (rate, scale, us) = session.folder / f"{token_hex(8)}.npy", session.limits.film_mb * 1e6, camera
    numbers = {"frame_rate": rate, "um_per_px": scale, "exposure": us and us * 1e-6}
    try:
        found = session.measurer.measure(film.path, images, most, say, **numbers)
    finally:
        with suppress(OSError):  # on a system that keeps a file that is mapped
            images.unlink(missing_ok=True)
    with session.lock:
        require(film in session.films.values(), "the recording was removed while it was measured", "app.changed")
        listed = film.exclude
        for other in session.films.values():
            other.found = other.kept = None  # frames are kept of one film
        film.camera, film.found, film.kept = camera, found, found
        film.shown = found.first + int(np.nanargmax(found.track.radius))
        unlisted(film, listed)


def left_out(film: Clip) -> Bools:
    """(n,) frames that are excluded."""
    return np.asarray((film.kept or measured(film)).track.flags == "excluded")


def toggle(film: Clip) -> None:
    """Leave the shown frame out, or bring it back. Raises InputError: no frame would be left."""
    out, first = left_out(film), measured(film).first
    out[film.shown - first] ^= True
    (wrong,) = unlisted(film, digits.ranges((np.flatnonzero(out) + first).tolist()))
    require(not wrong, wrong, "video.exclude")


def curve(film: Clip, *, sheet: bool = False) -> RadiusCurve:
    """As `read_curves` gives it. Raises InputError: not measured."""
    return noted(history(film.kept or measured(film), film.path, sheet=sheet))


def options(film: Clip) -> str:
    """Of `cavirheo infer`, that mean the same."""
    values = zip(("frame-rate-hz", "um-per-px", "exposure-us"), film.camera, strict=True)
    said = [f" --{name} {value:.10g}" for name, value in values if value is not None]
    return "".join(said) + f" --exclude {film.exclude.replace(' ', '')}" * bool(film.exclude)


def confirm(session: Session) -> None:
    """Its curve becomes one of the next steps, instead of what it was there before. Raises InputError: too much."""
    film = session.current
    session.films[session.film] = replace(film, curve=curve(film, sheet=True), command=options(film))
    try:
        session.take([*session.files, *({film.path} - {*session.files})], session.settings)
    except InputError:
        session.films[session.film] = film
        raise


def drawn(film: Clip) -> Figure:
    """Radii by the flags of their frames, those left out as crosses; the shown frame marked."""
    found = measured(film)
    unit, scale = ("µm", found.um_per_px.value) if found.um_per_px.value else ("px", 1.0)
    flags = np.where(left_out(film), "excluded", found.track.flags)
    return filmed(found.time, scale * found.track.radius, unit, flags, COLOURS, found.first, film.shown)
