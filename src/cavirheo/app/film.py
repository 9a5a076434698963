"""The step of a recording: measured, looked at frame by frame, frames left out, and confirmed as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from secrets import token_hex

import numpy as np
from plotly.graph_objects import Figure

from cavirheo.app.session import Clip, Session
from cavirheo.arrays import Bools
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.reading import camera, noted
from cavirheo.reading.apart import Report
from cavirheo.reading.camera import Camera
from cavirheo.reading.recordings import history
from cavirheo.reporting.interactive import filmed
from cavirheo.video.measurement import Measurement
from cavirheo.video.picture import COLOURS
from cavirheo.writing import digits


def typed(film: Clip, texts: Sequence[str]) -> tuple[Camera, list[str]]:
    """Frame rate, scale and exposure; why the film cannot be measured so, field by field, empty where it can."""
    unscaled = film.found is not None and film.found.um_per_px.value is None
    return camera.typed(texts, film.path.suffix.lower(), unscaled=unscaled)


def unready(film: Clip, *texts: str) -> list[str]:
    """Why its curve cannot be confirmed so, field by field: numbers as `typed`, then the list of frames."""
    new, wrong = typed(film, texts[:3])
    changed = ["changed since: measure again" * (now != old) for now, old in zip(new, film.camera, strict=True)]
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


def measure(session: Session, given: Camera, say: Report) -> None:
    """Measure the film in the process for it; excluded frames stay excluded. Raises InputError."""
    film = session.current
    images, most, (rate, scale, us) = session.folder / f"{token_hex(8)}.npy", session.limits.film_mb * 1e6, given
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
        film.camera, film.found, film.kept = given, found, found
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
    return film.camera.options + f" --exclude {film.exclude.replace(' ', '')}" * bool(film.exclude)


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
