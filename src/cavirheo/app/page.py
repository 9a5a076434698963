"""The page: what stands where in the five steps, and which handler answers what.

Only `infer` (endpoint.py) is public to programs; the handlers of the page are not.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import gradio as gr

from cavirheo.app import export, film, plots, steps, words
from cavirheo.app.endpoint import public, told, uploaded
from cavirheo.app.session import Camera, PageSettings, Session, Visitors
from cavirheo.errors import InputError, number_of
from cavirheo.inference import DEFAULT
from cavirheo.physics.media import MEDIA

_LEVELS = {"weighed by simulations": "auto", "not verified (fastest)": "none", "Gaussian": "map", "full (slow)": "full"}
_WINDOWS = {"the usual one": 0, "1 collapse": 1, "2 collapses": 2, "3 collapses": 3}
_NUMBERS = {  # settings that need not be given: label, what an empty field means
    "density": ("Density (kg/m³)", "as the medium"),
    "rmax_um": ("True R_max (µm)", "as measured"),
    "stretch": ("λ = R_max/R_0", "fitted"),
    "sound_speed": ("Sound speed (m/s)", "as the medium"),
    "surface_tension": ("Surface tension (N/m)", "as the medium"),
    "pressure": ("Pressure (Pa)", "as the medium"),
    "temperature": ("Temperature (K)", "as the medium"),
}
_CAMERA = {"Frames per second": "as the camera was set", "µm per pixel": "4.0", "Exposure of a frame (µs)": "if known"}
_REDRAW = Path(__file__).with_name("redraw.js").read_text(encoding="utf-8")
_AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
_LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
_line = partial(gr.Textbox, max_lines=1)
_button = partial(gr.Button, variant="primary")
_small = partial(gr.Button, size="sm", min_width=120)
_stop = partial(gr.Button, "Stop", variant="stop", visible=False)
_plot = partial(gr.Plot, show_label=False, container=False, min_width=320)
_html = partial(gr.HTML, apply_default_css=False)


class Page:
    """The five steps in `blocks`, with their handlers, not yet served; a component has its attribute's name as id."""

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors
        self.fields: dict[str, Any] = {}  # of PageSettings
        tabs = {"Data": self._data, "Prepare": self._prepare, "Infer": self._infer}
        tabs |= {"Check": self._check, "Export": self._export}
        self.blocks = gr.Blocks(title="cavirheo", analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
        with self.blocks:
            self.top = _html(words.part("top"))
            with gr.Tabs(selected=1) as self.steps:
                for number, (name, part) in enumerate(tabs.items(), 1):
                    with gr.Tab(f"{number} {name}", id=number):
                        part()
            self._wire([self.fields[field.name] for field in fields(PageSettings)])
            gr.api(public(visitors), api_name="infer")
        for name, part in (vars(self) | self.fields).items():
            if isinstance(part, gr.blocks.Block):
                part.elem_id = name.replace("_", "-")

    # what stands where

    def _data(self) -> None:
        kinds = ".mat, .csv, .txt, .h5, .xlsx; or recordings: .mp4, .avi, .mkv, .tif, .cine, .mraw with .cihx"
        label = f"Measured R(t): {kinds}; to {self.visitors.limits.file_mb:g} MB"
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(label=label, file_count="multiple", height=160)
            with gr.Column(scale=2, min_width=260):
                _html(words.part("quiet", "or look at a shipped example first:"))
                with gr.Row():
                    self.examples = {name: _small(name) for name in steps.examples()}
                with gr.Row():
                    self.clear, self.to_prepare = _small("Start over"), _small("Prepare first")
                self.infer_now = _button("Infer all shots", interactive=False)
        self._film()
        with gr.Row(visible=False) as self.loaded:
            self.overview, self.overview_normalised = _plot(), _plot()
        self.found = _html(words.found([], []))

    def _film(self) -> None:
        with gr.Column(visible=False) as self.film_step:
            self.film = gr.Dropdown(label="Recording")
            with gr.Row():
                boxes = [_line(label=label, placeholder=hint, min_width=160) for label, hint in _CAMERA.items()]
                self.film_rate, self.film_scale, self.film_exposure = self.film_typed = boxes
                self.measure = _button("Measure the bubble", min_width=160)
            self.film_told = _html(min_height=60)
            with gr.Column(visible=False) as self.film_seen:
                with gr.Row():
                    with gr.Column(min_width=300):
                        self.film_frame = _html()
                    self.film_plot = _plot(min_width=300)
                wide: dict[str, Any] = {"scale": 3, "min_width": 220}
                with gr.Row():
                    self.film_number = gr.Slider(label="Frame shown", step=1, buttons=[], **wide)
                    self.film_toggle = gr.Button("Exclude this frame", scale=1, min_width=140)
                with gr.Row():
                    self.film_excluded = _line(label="Frames to exclude", placeholder="12, 40-45", **wide)
                    self.confirm = _button("Confirm this curve", scale=1, min_width=140)

    def _prepare(self) -> None:
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                self.chosen = gr.CheckboxGroup(label="Shots to infer", show_select_all=True)
                windows = list(_WINDOWS.items())
                self.fields["window"] = gr.Dropdown(windows, value=0, label="Window that is compared")
                with gr.Row():
                    self.fields["medium"] = gr.Dropdown(list(MEDIA), value="water", label="Medium", min_width=120)
                    self._numbers("density")
                with gr.Row():
                    self._numbers("rmax_um", "stretch")
                with gr.Accordion("More about the liquid", open=False):
                    with gr.Row():
                        self._numbers("sound_speed", "surface_tension")
                    with gr.Row():
                        self._numbers("pressure", "temperature")
            with gr.Column(scale=3, min_width=300):
                self.shown = gr.Dropdown(label="Shot shown")
                self.prepared, self.dropped = _plot(), _html()
        self.to_infer = _button("Go on")

    def _numbers(self, *names: str) -> None:  # in fields for text: an empty gr.Number stalls the page
        for name in names:
            label, empty = _NUMBERS[name]
            self.fields[name] = _line(label=label, placeholder=empty, min_width=120)

    def _infer(self) -> None:
        self.fields["material"] = gr.Radio(words.materials(), value="nhkv", label="Material")
        with gr.Accordion("More about the method", open=False):
            self.fields["model"] = gr.Radio(words.models(), value=DEFAULT, label="Model")
            self.fields["verify"] = gr.Radio(list(_LEVELS.items()), value="auto", label="Uncertainty")
        with gr.Row():
            self.infer, self.stop = _button("Infer all chosen shots"), _stop()
        self.answers = _html(words.answers(None), min_height=120)
        self.to_check = gr.Button("Check against the simulation", interactive=False)

    def _check(self) -> None:
        with gr.Row(equal_height=True):
            self.checked = gr.Dropdown(label="Shot", scale=3, min_width=200)
            self.fit = gr.Button("Fit conventionally (seconds)", scale=1, min_width=180)
            self.stop_fit = _stop(scale=1, min_width=100)
        self.check_plot = _plot()
        with gr.Row():
            sliders = steps.SLIDERS.items()
            self.sliders = [gr.Slider(label=word, elem_id=f"slider-{key}", min_width=200) for key, (word, _) in sliders]
        self.trial = _html({"words": ""}, html_template="${value.words}", js_on_load=_REDRAW)
        self.facts = _html()
        self.to_export = gr.Button("Export")

    def _export(self) -> None:
        _html(words.part("export"))
        self.make = _button("Download cavirheo-result.zip")
        self.download = gr.DownloadButton()  # never seen: pressed when the zip is made

    # which handler answers what

    def _wire(self, settings: list[Any]) -> None:
        shown = [
            self.found, self.overview, self.overview_normalised, self.chosen, self.shown, self.upload, self.infer_now,
            self.answers, self.to_check, self.loaded, *self._wire_film(),
        ]  # fmt: skip
        checked = {"validator": self._checked(film.unready), "show_progress_on": [self.film_told]}
        self._on(self.confirm.click, self._confirm, [*self.film_typed, self.film_excluded], shown, **checked)
        check = [self.check_plot, self.facts, self.trial, *self.sliders]
        self._on(self.upload.upload, self._load, [self.upload, *settings], shown, show_progress_on=[self.found])
        for name, button in self.examples.items():
            self._on(button.click, partial(self._example, name), settings, shown)
        self._on(self.clear.click, self._clear, [], shown)
        changed = partial(gr.on, [one.change for one in (self.shown, *settings[:-1])])
        self._on(changed, self._view, [self.shown, *settings], [self.prepared, self.dropped], **_LATEST)
        for button, step in ((self.to_prepare, 2), (self.to_infer, 3), (self.to_check, 4), (self.to_export, 5)):
            button.click(partial(gr.Tabs, selected=step), outputs=self.steps, queue=False, api_visibility="private")
        given, answered = [self.chosen, *settings], [self.answers, self.checked, self.to_check]
        for button in (self.infer_now, self.infer):
            run = self._run(button, 3, self.stop, self._answer, given, answered, show_progress_on=[self.answers])
            self._on(run.success, self._show, [self.checked], check, show_progress="hidden")
        self._on(self.checked.select, self._show, [self.checked], check, show_progress="hidden")
        given, fitted = [self.checked, self.trial], [self.check_plot, self.facts]
        self._run(self.fit, 4, self.stop_fit, self._fit, given, fitted, show_progress_on=[self.check_plot])
        for button in (self.stop, self.stop_fit):
            self._on(button.click, lambda session: session.stopped.set(), queue=False)
        moved = partial(gr.on, [slider.input for slider in self.sliders])
        self._on(moved, self._try, [self.checked, *self.sliders], [self.trial], queue=False, **_LATEST)
        made = self._on(self.make.click, self._zip, [], [self.download], show_progress_on=[self.make])
        made.success(None, js="() => document.querySelector('#download').click()", api_visibility="private")
        self.blocks.unload(self._leave)

    def _wire_film(self) -> list[Any]:
        """What shows the film that is looked at."""
        look = [self.film_told, self.film_frame, self.film_plot, self.film_toggle]
        measured = [self.film_seen, self.film_number, self.film_excluded]
        parts = [self.film_step, self.film, *self.film_typed, *measured, *look]
        self._on(self.film.input, self._pick, [self.film], parts)
        measure = partial(gr.on, [self.measure.click, *(one.submit for one in self.film_typed)])
        wrong = self._checked(lambda one, *texts: film.typed(one, texts)[1])
        checked = {"validator": wrong, "show_progress_on": [self.film_told], "api_visibility": "private"}
        measure(self._working(self._measure), self.film_typed, parts, concurrency_limit=1, **checked)
        self._on(self.film_number.input, self._turn, [self.film_number], look[1:], queue=False, **_LATEST)
        self._on(self.film_toggle.click, self._toggle, [], [self.film_excluded, *look], **_AT_ONCE)
        checked = {"validator": self._checked(film.unlisted), **_LATEST}
        self._on(self.film_excluded.change, self._look, [self.film_excluded], look, **checked)
        return parts

    def _on(self, event: Callable[..., Any], handler: Callable[..., Any], *given: Any, **options: Any) -> Any:
        """The event calls the handler with the session of who asks, which is locked, and the values of components."""

        @told
        def one(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.of(request.session_hash or "")
            with session.lock:
                return handler(session, *values)

        return event(one, *given, api_visibility="private", **options)

    def _run(self, button: Any, step: int, stop: Any, handler: Callable[..., Any], *given: Any, **options: Any) -> Any:
        """The button starts the handler, which works on shots with a bar, and shows the button that stops it."""

        def begin(session: Session) -> list[Any]:
            if not session.busy.locked():
                session.stopped.clear()
            return [gr.Tabs(selected=step), gr.Button(visible=True)]

        begun = self._on(button.click, begin, [], [self.steps, stop], **_AT_ONCE)
        run = begun.then(self._working(handler), *given, concurrency_limit=2, api_visibility="private", **options)
        for ended in (run.success, run.failure):  # `then` does not follow a failure
            self._on(ended, lambda session: gr.Button(visible=session.busy.locked()), [], [stop], **_AT_ONCE)
        return run

    def _working(self, handler: Callable[..., Any]) -> Callable[..., Any]:
        """The handler as an event calls it that shows a bar; the session is not locked meanwhile."""

        @told
        def work(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            return handler(self.visitors.of(request.session_hash or ""), *values, progress=progress)

        return work

    def _checked(self, wrong: Callable[..., list[str]]) -> Callable[..., Any]:
        """Shows at each field what is `wrong` with its value for the film, and stops the event then."""

        def one(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.of(request.session_hash or "")
            with session.lock:
                told = [gr.validate(not why, why) for why in wrong(session.current, *values)]
            return told if len(told) > 1 else told[0]  # as gradio takes the answer of several fields, and of one

        return one

    # the handlers

    def _leave(self, request: gr.Request) -> None:
        self.visitors.leave(request.session_hash or "")

    def _load(self, session: Session, files: list[str] | None, *settings: Any) -> list[Any]:
        with uploaded(files or []) as paths:
            session.add(paths, _settings(settings))
        return self._loaded(session)

    def _example(self, name: str, session: Session, *settings: Any) -> list[Any]:
        session.add([steps.examples()[name]], _settings(settings), copy=True)
        if name in session.films:
            session.film, session.films[name].camera = name, Camera(500_000.0, 4.0, 0.4)
        return self._loaded(session)

    def _clear(self, session: Session) -> list[Any]:
        session.clear()
        return self._loaded(session)

    def _loaded(self, session: Session) -> list[Any]:
        names = [curve.name for curve in session.curves]
        figures = plots.overview(session.curves, session.settings.liquid) if names else (None, None)
        return [
            words.found(session.curves, session.problems, session.waiting), *figures,
            gr.CheckboxGroup(choices=names, value=names), gr.Dropdown(choices=names, value=next(iter(names), None)),
            None, gr.Button(interactive=bool(names)), words.answers(session.answers), gr.Button(interactive=False),
            gr.Row(visible=bool(names)),
            *self._filmed(session),
        ]  # fmt: skip

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
        return [words.film(one, error), words.frame(one), plots.filmed(one.found, out, one.shown), label]

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

    def _confirm(self, session: Session, *_: str) -> list[Any]:
        film.confirm(session)
        session.film = next(iter(session.waiting), session.film)
        return self._loaded(session)

    def _view(self, session: Session, name: str | None, *settings: Any) -> list[Any]:
        session.prepare(_settings(settings))
        for curve in (one for one in session.curves if one.name == name):
            try:
                return [plots.prepared(curve, steps.seen(curve, session.settings)), words.prepared(curve)]
            except InputError as error:
                return [None, words.prepared(curve, error)]
        return [None, ""]

    def _answer(self, session: Session, chosen: list[str], *settings: Any, progress: gr.Progress) -> list[Any]:
        with session.lock:
            session.prepare(_settings(settings))
        answers = steps.infer(session, chosen, progress)
        names = [curve.name for curve, _ in answers.pairs]
        return [words.answers(answers), gr.Dropdown(choices=names, value=names[0]), gr.Button(interactive=True)]

    def _show(self, session: Session, name: str) -> list[Any]:
        ranges = steps.sliders(session, name).values()
        moved = [gr.Slider(visible=found is not None, **(found or {})) for found in ranges]  # type: ignore[arg-type]
        return [*self._answered(session, name), {"words": ""}, *moved]

    def _fit(self, session: Session, name: str, trial: dict[str, Any], *, progress: gr.Progress) -> list[Any]:
        steps.fit(session, name, progress)
        with session.lock:
            return self._answered(session, name, json.loads(trial.get("lines", "null")))

    def _answered(self, session: Session, name: str, trial: dict[str, Any] | None = None) -> list[Any]:
        answers, curve, posterior, _ = session.find(name)
        fit = answers.fits.get(name)
        figure = plots.checked(curve, posterior.checks, fit.checks if fit else None, trial)
        return [figure, words.facts(session, name)]

    def _try(self, session: Session, name: str, *values: float | None) -> dict[str, Any]:
        found, lines = steps.trial(session, name, values)
        return {"words": words.part("trial", found), "lines": json.dumps({**lines, "traces": plots.TRIAL})}

    def _zip(self, session: Session) -> Any:
        return gr.DownloadButton(value=str(export.write_zip(session)))


def _settings(values: Sequence[Any]) -> PageSettings:
    """From the components, in the order of the fields of PageSettings. Raises InputError: no number."""
    given = dict(zip((field.name for field in fields(PageSettings)), values, strict=True))
    for name in _NUMBERS:
        given[name] = number_of(given[name], name.replace("_", " "))
    return PageSettings(**given | {"window": given["window"] or None})
