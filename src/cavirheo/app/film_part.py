"""The part of the page where a recording is measured, looked at and confirmed."""

from __future__ import annotations

from functools import partial
from typing import Any

import gradio as gr

from cavirheo.app import film, words
from cavirheo.app.events import AT_ONCE, LATEST, Events, button, html, line, plot
from cavirheo.app.session import Session
from cavirheo.errors import InputError

_CAMERA = {"Frames per second": "as the camera was set", "µm per pixel": "4.0", "Exposure of a frame (µs)": "if known"}


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
                    self.film_plot = plot(min_width=300)
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
        measured = [self.film_seen, self.film_number, self.film_excluded]
        parts = [self.film_step, self.film, *self.film_typed, *measured, *look]
        self.on(self.film.input, self._pick, [self.film], parts)
        measure = partial(gr.on, [self.measure.click, *(one.submit for one in self.film_typed)])
        wrong = self.validated(lambda session, *texts: film.typed(session.current, texts)[1])
        checked = {"validator": wrong, "show_progress_on": [self.film_told], "concurrency_limit": 1}
        self.on(measure, self._measure, self.film_typed, parts, works=True, **checked)
        self.on(self.film_number.input, self._turn, [self.film_number], look[1:], queue=False, **LATEST)
        self.on(self.film_toggle.click, self._toggle, [], [self.film_excluded, *look], **AT_ONCE)
        listed = self.validated(lambda session, text: film.unlisted(session.current, text))
        self.on(self.film_excluded.change, self._look, [self.film_excluded], look, validator=listed, **LATEST)
        return parts

    def _filmed(self, session: Session, error: InputError | None = None) -> list[Any]:
        one = session.current
        names = [(f"{name}: {'not ' * (name in session.waiting)}confirmed", name) for name in session.recordings]
        camera = ["" if value is None else f"{value:.10g}" for value in one.camera]
        first, last = (one.found.first, one.found.first + len(one.found.time) - 1) if one.found else (1, 2)
        return [
            gr.Column(visible=bool(names)), gr.Dropdown(names, value=session.film or None, visible=len(names) > 1),
            *(camera if any(camera) else [gr.skip()] * 3), gr.Column(visible=one.found is not None),
            gr.Slider(first, last, one.shown), one.exclude, *self._look(session, "", error),
        ]  # fmt: skip

    def _look(self, session: Session, _: str = "", error: InputError | None = None) -> list[Any]:
        one = session.current
        if one.found is None:
            return [words.film(one, error), gr.skip(), gr.skip(), gr.skip()]
        out = film.left_out(one)
        label = "Bring this frame back" if out[one.shown - one.found.first] else "Exclude this frame"
        return [words.film(one, error), words.frame(one), film.drawn(one), label]

    def _pick(self, session: Session, name: str) -> list[Any]:
        session.film = name
        return self._filmed(session)

    def _measure(self, session: Session, *texts: str, progress: gr.Progress) -> list[Any]:
        try:
            film.measure(session, film.typed(session.current, texts)[0], progress)
        except InputError as error:
            return self._filmed(session, error)
        return self._filmed(session)

    def _turn(self, session: Session, number: int) -> list[Any]:
        session.current.shown = number
        return self._look(session)[1:]

    def _toggle(self, session: Session) -> list[Any]:
        film.toggle(session.current)
        return [session.current.exclude, *self._look(session)]
