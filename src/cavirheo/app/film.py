"""The part of the page where a recording is measured, looked at frame by frame, and confirmed as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from secrets import token_hex
from typing import Any

import gradio as gr
import numpy as np

from cavirheo.app import words
from cavirheo.app.events import AT_ONCE, LATEST, Events, button, html, line
from cavirheo.app.session import Clip, Session
from cavirheo.arrays import Bools
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError, require
from cavirheo.io.shots import with_maximum_notes
from cavirheo.io.subprocess_reader import Report
from cavirheo.io.videos import Camera, history, parse_camera
from cavirheo.reporting.panels import Axis, Layer, Panel
from cavirheo.reporting.pictures import curve_svg
from cavirheo.reporting.table import curve_warnings, notes, summary_cells
from cavirheo.video.measurement import Measurement
from cavirheo.video.picture import COLOURS, GREY, frame_address
from cavirheo.video.track import FLAGS
from cavirheo.writing import digits
from cavirheo.writing.terminal import by_message

_CAMERA = {"Frames per second": "as the camera was set", "µm per pixel": "4.0", "Exposure of a frame (µs)": "if known"}


def camera_of(film: Clip, texts: Sequence[str]) -> tuple[Camera, list[str]]:
    """Frame rate, scale and exposure; why the film cannot be measured so, field by field, empty where it can."""
    unscaled = film.measurement is not None and film.measurement.um_per_px.value is None
    return parse_camera(texts, film.path.suffix.lower(), unscaled=unscaled)


def unready(film: Clip, *texts: str) -> list[str]:
    """Why its curve cannot be confirmed so, field by field: numbers as `typed`, then the list of frames."""
    new, wrong = camera_of(film, texts[:3])
    changed = ["changed since: measure again" * (now != old) for now, old in zip(new, film.camera, strict=True)]
    return [mistake or change for mistake, change in zip(wrong, changed, strict=True)] + unlisted(film, texts[3])


def unlisted(film: Clip, listed: str) -> list[str]:
    """Leave out these frames, "12, 40-45", and no others; or say why not. A list half typed counts so far."""
    listed = listed.strip(" ,-–")
    try:
        film.used = film.measurement and film.measurement.without(listed) if listed else film.measurement
    except InputError as error:
        return [str(error)]
    return [""]


def measured(film: Clip) -> Measurement:
    """Its measurement, with all frames. Raises InputError: there is none."""
    if film.measurement is None:
        raise InputError("measure the recording first (step 1)", "app.not_measured")
    return film.measurement


def measure(session: Session, camera: Camera, say: Report) -> None:
    """Measure the film in the process for it; excluded frames stay excluded. Raises InputError."""
    film = session.current
    images, most, (rate, scale, us) = session.folder / f"{token_hex(8)}.npy", session.limits.film_mb * 1e6, camera
    numbers = {"frame_rate": rate, "um_per_px": scale, "exposure": us and us * 1e-6}
    try:
        measurement = session.measurer.measure(film.path, images, most, say, **numbers)
    finally:
        with suppress(OSError):  # on a system that keeps a file that is mapped
            images.unlink(missing_ok=True)
    with session.lock:
        require(film in session.films.values(), "the recording was removed while it was measured", "app.changed")
        listed = film.exclude
        for clip in session.films.values():
            clip.measurement = clip.used = None  # frames are kept of one film
        film.camera, film.measurement, film.used = camera, measurement, measurement
        film.frame = measurement.first + int(np.nanargmax(measurement.track.radius))
        unlisted(film, listed)


def excluded(film: Clip) -> Bools:
    """(n,) frames that are excluded."""
    return np.asarray((film.used or measured(film)).track.flags == "excluded")


def toggle(film: Clip) -> None:
    """Leave the shown frame out, or bring it back. Raises InputError: no frame would be left."""
    excluded_frames, first = excluded(film), measured(film).first
    excluded_frames[film.frame - first] ^= True
    (wrong,) = unlisted(film, digits.ranges((np.flatnonzero(excluded_frames) + first).tolist()))
    require(not wrong, wrong, "video.exclude")


def curve(film: Clip, *, sheet: bool = False) -> RadiusCurve:
    """As `read_curves` gives it. Raises InputError: not measured."""
    return with_maximum_notes(history(film.used or measured(film), film.path, sheet=sheet))


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


def radii_picture(film: Clip) -> str:
    """Radii by the flags of their frames, those without one at zero; a line marks the shown frame."""
    measurement = measured(film)
    unit, scale = ("µm", measurement.um_per_px.value) if measurement.um_per_px.value else ("px", 1.0)
    flags = np.where(excluded(film), "excluded", measurement.track.flags)
    time, radius = 1e6 * measurement.time, np.nan_to_num(scale * measurement.track.radius)
    top, instant = 1.05 * float(radius.max()) or 1.0, float(time[film.frame - measurement.first])
    layers = [
        Layer("dots", f"flag-{flag}", time[flags == flag], radius[flags == flag], flag)
        for flag in dict.fromkeys(flags.tolist())
    ]
    layers.append(Layer("line", "frame", np.full(2, instant), np.array([0.0, top])))
    x = Axis("time (µs)", float(time[0]), float(time[-1]))
    return words.pictures([curve_svg([Panel(x, Axis(f"R ({unit})", 0.0, top), tuple(layers))])])


def summary(film: Clip) -> str:
    """What to do with a recording; its warnings and what was found."""
    if film.measurement is None:
        return words.part("film", (), {}, {}, "")
    radii = curve(film)
    cut = f"{film.measurement.cut}: the radius rests on that part alone" * bool(film.measurement.cut)
    texts = [cut, *(text for _, text in curve_warnings([radii]))]
    by_text = by_message((film.path.name, words.for_page(text)) for text in texts)
    state = "" if film.curve is None else "confirmed" if film.command == options(film) else "changed"
    return words.part("film", summary_cells(radii), by_text, notes([radii]), state)


def frame_view(film: Clip) -> str:
    """The shown frame of a recording with its circle, what it is, and how many there are of each kind."""
    measurement, excluded_frames = measured(film), excluded(film)
    track, i, scale = measurement.track, film.frame - measurement.first, measurement.um_per_px.value
    size = [f"{float(x[i]) * (scale or 1.0):.{n}g}" for x, n in ((track.radius, 4), (track.sigma, 1))]
    size_text = f"R = {size[0]} ± {size[1]} {'µm' if scale else 'px'}" if np.isfinite(track.radius[i]) else ""
    where = f"Frame {film.frame} of {measurement.first + len(excluded_frames) - 1}, {1e6 * measurement.time[i]:.4g} µs"
    flag = str(track.flags[i])
    look = flag, COLOURS.get(flag, GREY), FLAGS[flag], bool(excluded_frames[i])
    return words.part("frame", frame_address(measurement, i, 560), where, size_text, *look)


class FilmPart(Events):
    """A component has its attribute's name as id."""

    def _film(self) -> None:
        with gr.Column(visible=False) as self.film_step:
            self.film = gr.Dropdown(label="Recording")
            with gr.Row():
                boxes = [line(label=label, placeholder=hint, min_width=160) for label, hint in _CAMERA.items()]
                self.film_rate, self.film_scale, self.film_exposure = self.film_typed = boxes
                self.measure = button("Measure the bubble", min_width=160)
            self.film_told = html(min_height=60)
            with gr.Column(visible=False) as self.film_seen:
                with gr.Row():
                    with gr.Column(min_width=300):
                        self.film_frame = html()
                    self.film_plot = html(min_width=300)
                wide: dict[str, Any] = {"scale": 3, "min_width": 220}
                with gr.Row():
                    self.film_number = gr.Slider(label="Frame shown", step=1, buttons=[], **wide)
                    self.film_toggle = gr.Button("Exclude this frame", scale=1, min_width=140)
                with gr.Row():
                    self.film_excluded = line(label="Frames to exclude", placeholder="12, 40-45", **wide)
                    self.confirm = button("Confirm this curve", scale=1, min_width=140)

    def _wire_film(self) -> list[Any]:
        """What shows the film that is looked at."""
        look = [self.film_told, self.film_frame, self.film_plot, self.film_toggle]
        view = [self.film_seen, self.film_number, self.film_excluded]
        parts = [self.film_step, self.film, *self.film_typed, *view, *look]
        self.on(self.film.input, self._pick, [self.film], parts)
        starts = [self.measure.click, *(box.submit for box in self.film_typed)]
        wrong = self.validated(lambda session, *texts: camera_of(session.current, texts)[1])
        checked = {"validator": wrong, "show_progress_on": [self.film_told], "concurrency_limit": 1}
        self.on(starts, self._measure, self.film_typed, parts, works=True, **checked)
        self.on(self.film_number.input, self._look, [self.film_number], look, queue=False, **LATEST)
        self.on(self.film_toggle.click, self._toggle, [], [self.film_excluded, *look], **AT_ONCE)
        listed = self.validated(lambda session, text: unlisted(session.current, text))
        self.on(self.film_excluded.change, self._look, [self.film_excluded], look, validator=listed, **LATEST)
        return parts

    def _filmed(self, session: Session) -> list[Any]:
        clip = session.current
        names = [(f"{name}: {'not ' * (name in session.waiting)}confirmed", name) for name in session.recordings]
        camera = ["" if value is None else f"{value:.10g}" for value in clip.camera]
        measurement = clip.measurement
        first, last = (measurement.first, measurement.first + len(measurement.time) - 1) if measurement else (1, 2)
        return [
            gr.Column(visible=bool(names)),
            gr.Dropdown(names, value=session.film or None, visible=len(names) > 1),
            *(camera if any(camera) else [gr.skip()] * 3),
            gr.Column(visible=clip.measurement is not None),
            gr.Slider(first, last, clip.frame),
            clip.exclude,
            *self._look(session),
        ]

    def _look(self, session: Session, number: int | str = "") -> list[Any]:
        clip = session.current
        clip.frame = number if isinstance(number, int) else clip.frame
        if clip.measurement is None:
            return [summary(clip), gr.skip(), gr.skip(), gr.skip()]
        excluded_frames = excluded(clip)
        out = excluded_frames[clip.frame - clip.measurement.first]
        label = "Bring this frame back" if out else "Exclude this frame"
        return [summary(clip), frame_view(clip), radii_picture(clip), label]

    def _pick(self, session: Session, name: str) -> list[Any]:
        session.film = name
        return self._filmed(session)

    def _measure(self, session: Session, *texts: str, progress: gr.Progress) -> list[Any]:
        measure(session, camera_of(session.current, texts)[0], progress)
        return self._filmed(session)

    def _toggle(self, session: Session) -> list[Any]:
        toggle(session.current)
        return [session.current.exclude, *self._look(session)]
