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

from cavirheo.app import export, plots, steps, words
from cavirheo.app.endpoint import public, told, uploaded
from cavirheo.app.session import PageSettings, Session, Visitors
from cavirheo.errors import InputError
from cavirheo.inference.model import DEFAULT
from cavirheo.physics.media import MEDIA

_LEVELS = {"none (fastest)": "none", "quick (Gaussian)": "map", "full (weighted draws, several seconds a shot)": "full"}
_WINDOWS = {"all that the model reads": 0, "1 collapse": 1, "2 collapses": 2, "3 collapses": 3}
_NUMBERS = {  # settings that need not be given: label, what an empty field means
    "density": ("Density (kg/m³)", "as the medium"),
    "rmax_um": ("True R_max (µm)", "as measured"),
    "stretch": ("λ = R_max/R_0", "fitted"),
    "sound_speed": ("Sound speed (m/s)", "as the medium"),
    "surface_tension": ("Surface tension (N/m)", "as the medium"),
    "pressure": ("Pressure (Pa)", "as the medium"),
    "temperature": ("Temperature (K)", "as the medium"),
}
_REDRAW = Path(__file__).with_name("redraw.js").read_text(encoding="utf-8")
_AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
_LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
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
        label = f"Measured R(t): .mat, .csv, .txt, .h5, .xlsx; to {self.visitors.limits.file_mb:g} MB"
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
        with gr.Row(visible=False) as self.loaded:
            self.overview, self.overview_normalised = _plot(), _plot()
        self.found = _html(words.found([], []))

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
            self.fields[name] = gr.Textbox(label=label, placeholder=empty, max_lines=1, min_width=120)

    def _infer(self) -> None:
        self.fields["model"] = gr.Radio(words.models(), value=DEFAULT, label="Material and model")
        self.fields["verify"] = gr.Radio(list(_LEVELS.items()), value="none", label="Uncertainty")
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
            self.answers, self.to_check, self.loaded,
        ]  # fmt: skip
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

    def _on(self, event: Callable[..., Any], handler: Callable[..., Any], *given: Any, **options: Any) -> Any:
        """The event calls the handler with the session of who asks, which is locked, and the values of components."""

        @told
        def one(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.of(request.session_hash or "")
            with session.lock:
                return handler(session, *values)

        return event(one, *given, api_visibility="private", **options)

    def _run(
        self, button: gr.Button, step: int, stop: gr.Button, handler: Callable[..., Any], *given: Any, **options: Any
    ) -> Any:
        """The button starts the handler, which works on shots with a bar, and shows the button that stops it."""

        def begin(session: Session) -> list[Any]:
            if not session.busy.locked():
                session.stopped.clear()
            return [gr.Tabs(selected=step), gr.Button(visible=True)]

        @told
        def work(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            return handler(self.visitors.of(request.session_hash or ""), *values, progress=progress)

        begun = self._on(button.click, begin, [], [self.steps, stop], **_AT_ONCE)
        run = begun.then(work, *given, concurrency_limit=2, api_visibility="private", **options)
        self._on(run.then, lambda session: gr.Button(visible=session.busy.locked()), [], [stop], **_AT_ONCE)
        return run

    # the handlers

    def _leave(self, request: gr.Request) -> None:
        self.visitors.leave(request.session_hash or "")

    def _load(self, session: Session, files: list[str] | None, *settings: Any) -> list[Any]:
        with uploaded(files or []) as paths:
            session.add(paths, _settings(settings))
        return self._loaded(session)

    def _example(self, name: str, session: Session, *settings: Any) -> list[Any]:
        session.add([steps.examples()[name]], _settings(settings), copy=True)
        return self._loaded(session)

    def _clear(self, session: Session) -> list[Any]:
        session.clear()
        return self._loaded(session)

    def _loaded(self, session: Session) -> list[Any]:
        names = [curve.name for curve in session.curves]
        figures = plots.overview(session.curves, session.settings.liquid) if names else (None, None)
        return [
            words.found(session.curves, session.problems), *figures, gr.CheckboxGroup(choices=names, value=names),
            gr.Dropdown(choices=names, value=next(iter(names), None)), None, gr.Button(interactive=bool(names)),
            words.answers(session.answers), gr.Button(interactive=False), gr.Row(visible=bool(names)),
        ]  # fmt: skip

    def _view(self, session: Session, name: str | None, *settings: Any) -> list[Any]:
        session.prepare(_settings(settings))
        curve = next((curve for curve in session.curves if curve.name == name), None)
        if curve is None:
            return [None, ""]
        try:
            figure = plots.prepared(curve, *steps.seen(curve, session.settings))
        except InputError as error:
            return [None, words.prepared(curve, error)]
        return [figure, words.prepared(curve)]

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
        text = str(given[name] or "").strip().replace(",", ".")
        try:
            given[name] = float(text) if text else None
        except ValueError:
            label = name.replace("_", " ")
            raise InputError(f"{label} must be a number, got {given[name]!r}", "app.not_a_number") from None
    return PageSettings(**given | {"window": given["window"] or None})
