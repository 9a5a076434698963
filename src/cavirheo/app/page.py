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

_FORMATS = ".mat, .csv, .txt, .h5, .xlsx"
_LEVELS = [
    ("none (fastest)", "none"), ("quick (Gaussian)", "map"),
    ("full (weighted draws, several seconds a shot)", "full"),
]  # fmt: skip
_WINDOWS = [("all that the model reads", 0), ("1 collapse", 1), ("2 collapses", 2), ("3 collapses", 3)]
_NUMBERS = {  # settings that need not be given: label, what an empty field means
    "density": ("Density (kg/m³)", "as the medium"),
    "rmax_um": ("True R_max (µm)", "as measured"),
    "stretch": ("λ = R_max/R_0", "fitted"),
    "sound_speed": ("Sound speed (m/s)", "as the medium"),
    "surface_tension": ("Surface tension (N/m)", "as the medium"),
    "pressure": ("Pressure (Pa)", "as the medium"),
    "temperature": ("Temperature (K)", "as the medium"),
}
_STEPS = ("Data", "Prepare", "Infer", "Check", "Export")
_SLIDERS = ("Try G (kPa)", "Try µ (Pa s)", "Try λ (R_max/R_0)")
_REDRAW = Path(__file__).with_name("redraw.js").read_text(encoding="utf-8")
_AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}


class Page:
    """The five steps in `blocks`, with their handlers, not yet served."""

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors
        parts = (self._data, self._prepare, self._infer, self._check, self._export)
        self.blocks = gr.Blocks(title="cavirheo", analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
        with self.blocks:
            _html("top", words.part("top"))
            with gr.Tabs(selected=1, elem_id="steps") as self.tabs:
                for number, (name, part) in enumerate(zip(_STEPS, parts, strict=True), 1):
                    with gr.Tab(f"{number} {name}", id=number):
                        part()
            self.settings = [getattr(self, field.name) for field in fields(PageSettings)]
            self._wire()
            self.blocks.unload(self._leave)
            gr.api(public(visitors), api_name="infer")

    # what stands where; what is set is named as the fields of PageSettings

    def _data(self) -> None:
        label = f"Measured R(t): {_FORMATS}; to {self.visitors.limits.file_mb:g} MB"
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(label=label, file_count="multiple", height=160, elem_id="upload")
            with gr.Column(scale=2, min_width=260):
                _html(None, words.part("quiet", "or look at a shipped example first:"))
                small: dict[str, Any] = {"size": "sm", "min_width": 120}
                with gr.Row():
                    self.examples = {name: gr.Button(name, **small) for name in steps.examples()}
                with gr.Row():
                    self.clear = gr.Button("Start over", elem_id="clear", **small)
                    self.to_prepare = gr.Button("Prepare first", elem_id="to-prepare", **small)
                self.infer_now = gr.Button("Infer all shots", variant="primary", interactive=False, elem_id="infer-now")
        with gr.Row(visible=False) as self.overview:
            self.plain, self.scaled = _plot("overview"), _plot("overview-normalised")
        self.found = _html("found", words.found([], []))

    def _prepare(self) -> None:
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                self.chosen = gr.CheckboxGroup(label="Shots to infer", show_select_all=True, elem_id="chosen")
                self.window = gr.Dropdown(_WINDOWS, value=0, label="Window that is compared", elem_id="window")
                with gr.Row():
                    self.medium = gr.Dropdown(list(MEDIA), value="water", label="Medium", min_width=120)
                    self.density = _number("density")
                with gr.Row():
                    self.rmax_um, self.stretch = _number("rmax_um"), _number("stretch")
                with gr.Accordion("More about the liquid", open=False):
                    with gr.Row():
                        self.sound_speed, self.surface_tension = _number("sound_speed"), _number("surface_tension")
                    with gr.Row():
                        self.pressure, self.temperature = _number("pressure"), _number("temperature")
            with gr.Column(scale=3, min_width=300):
                self.shown = gr.Dropdown(label="Shot shown", elem_id="shown")
                self.prepared, self.dropped = _plot("prepared"), _html("dropped")
        self.to_infer = gr.Button("Go on", variant="primary", elem_id="to-infer")

    def _infer(self) -> None:
        self.model = gr.Radio(words.models(), value=DEFAULT, label="Material and model", elem_id="model")
        self.verify = gr.Radio(_LEVELS, value="none", label="Uncertainty", elem_id="verify")
        with gr.Row():
            self.infer = gr.Button("Infer all chosen shots", variant="primary", elem_id="infer")
            self.stop = gr.Button("Stop", variant="stop", visible=False, elem_id="stop")
        self.answers = _html("answers", words.answers(None), min_height=120)
        self.to_check = gr.Button("Check against the simulation", interactive=False, elem_id="to-check")

    def _check(self) -> None:
        with gr.Row(equal_height=True):
            self.checked = gr.Dropdown(label="Shot", scale=3, min_width=200, elem_id="checked")
            self.fit = gr.Button("Fit conventionally (seconds)", scale=1, min_width=180, elem_id="fit")
            self.stop_fit = gr.Button("Stop", variant="stop", visible=False, scale=1, min_width=100, elem_id="stop-fit")
        self.plot = _plot("check-plot")
        with gr.Row():
            labels = zip(steps.SLIDERS, _SLIDERS, strict=True)
            self.sliders = [gr.Slider(label=label, elem_id=f"slider-{key}", min_width=200) for key, label in labels]
        self.trial = _html("trial", {"words": ""}, html_template="${value.words}", js_on_load=_REDRAW)
        self.facts = _html("facts")
        self.to_export = gr.Button("Export", elem_id="to-export")

    def _export(self) -> None:
        _html(None, words.part("export"))
        self.make = gr.Button("Download cavirheo-result.zip", variant="primary", elem_id="make")
        self.download = gr.DownloadButton(elem_id="download")  # never seen: pressed when the zip is made

    # which handler answers what

    def _wire(self) -> None:
        shown = [
            self.found, self.plain, self.scaled, self.chosen, self.shown, self.upload, self.infer_now, self.answers,
            self.to_check, self.overview,
        ]  # fmt: skip
        load = [self.upload, *self.settings]
        self._on(self.upload.upload, self._load, load, shown, show_progress_on=[self.found])
        for name, button in self.examples.items():
            self._on(button.click, partial(self._example, name), self.settings, shown)
        self._on(self.clear.click, self._clear, [], shown)
        view = partial(gr.on, [one.change for one in (self.shown, *self.settings[:-1])])
        self._on(
            view, self._view, [self.shown, *self.settings], [self.prepared, self.dropped],
            trigger_mode="always_last", show_progress="hidden",
        )  # fmt: skip
        for button, step in ((self.to_prepare, 2), (self.to_infer, 3), (self.to_check, 4), (self.to_export, 5)):
            button.click(partial(gr.Tabs, selected=step), outputs=self.tabs, queue=False, api_visibility="private")
        given, answered = [self.chosen, *self.settings], [self.answers, self.checked, self.to_check]
        check = [self.plot, self.facts, self.trial, *self.sliders]
        for button in (self.infer_now, self.infer):
            run = self._run(button, 3, self.stop, self._answer, given, answered, show_progress_on=[self.answers])
            self._on(run.success, self._show, [self.checked], check, show_progress="hidden")
        self._on(self.checked.select, self._show, [self.checked], check, show_progress="hidden")
        given, fitted = [self.checked, self.trial], [self.plot, self.facts]
        self._run(self.fit, 4, self.stop_fit, self._fit, given, fitted, show_progress_on=[self.plot])
        for button in (self.stop, self.stop_fit):
            self._on(button.click, lambda session: session.stopped.set(), queue=False)
        move = partial(gr.on, [slider.input for slider in self.sliders])
        self._on(move, self._try, [self.checked, *self.sliders], [self.trial], trigger_mode="always_last", **_AT_ONCE)
        made = self._on(self.make.click, self._zip, [], [self.download], show_progress_on=[self.make])
        made.success(None, js="() => document.querySelector('#download').click()", api_visibility="private")

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

        def end(session: Session) -> Any:
            return gr.Button(visible=session.busy.locked())

        @told
        def work(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            return handler(self.visitors.of(request.session_hash or ""), *values, progress=progress)

        begun = self._on(button.click, begin, [], [self.tabs, stop], **_AT_ONCE)
        run = begun.then(work, *given, concurrency_limit=2, api_visibility="private", **options)
        self._on(run.then, end, [], [stop], **_AT_ONCE)
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
            view, step, grid = steps.seen(curve, session.settings)
            figure = plots.prepared(curve, view.curve, step, grid)
        except InputError as error:
            return [None, words.prepared(curve, error)]
        return [figure, words.prepared(curve)]

    def _answer(self, session: Session, chosen: list[str], *settings: Any, progress: gr.Progress) -> list[Any]:
        with session.lock:
            session.prepare(_settings(settings))
        answers = steps.infer(session, chosen, progress)
        names = [curve.name for curve, _ in answers.pairs]
        first = gr.Dropdown(choices=names, value=names[0])
        return [words.answers(answers), first, gr.Button(interactive=True)]

    def _show(self, session: Session, name: str) -> list[Any]:
        ranges = steps.sliders(session, name).values()
        moved = [gr.Slider(visible=found is not None, **(found or {})) for found in ranges]  # type: ignore[arg-type]
        return [self._figure(session, name), words.facts(session, name), {"words": ""}, *moved]

    def _fit(self, session: Session, name: str, trial: dict[str, Any], *, progress: gr.Progress) -> list[Any]:
        steps.fit(session, name, progress)
        drawn = json.loads(trial["lines"]) if "lines" in trial else None
        with session.lock:
            return [self._figure(session, name, drawn), words.facts(session, name)]

    def _figure(self, session: Session, name: str, trial: dict[str, Any] | None = None) -> Any:
        answers, curve, posterior, _ = session.find(name)
        fit = answers.fits.get(name)
        return plots.checked(curve, posterior.checks, fit.checks if fit else None, trial)

    def _try(self, session: Session, name: str, *values: float | None) -> dict[str, Any]:
        found, lines = steps.trial(session, name, values)
        return {"words": words.part("trial", found), "lines": json.dumps({**lines, "traces": plots.TRIAL})}

    def _zip(self, session: Session) -> Any:
        return gr.DownloadButton(value=str(export.write_zip(session)))


def _html(name: str | None, value: Any = "", **options: Any) -> gr.HTML:
    return gr.HTML(value, apply_default_css=False, elem_id=name, **options)


def _plot(name: str) -> gr.Plot:
    return gr.Plot(show_label=False, container=False, min_width=320, elem_id=name)


def _number(name: str) -> gr.Textbox:
    """A field for a number that need not be given."""
    label, empty = _NUMBERS[name]
    return gr.Textbox(label=label, placeholder=empty, max_lines=1, min_width=120, elem_id=name)


def _settings(values: Sequence[Any]) -> PageSettings:
    """From the components, in the order of the fields of PageSettings. Raises InputError: no number."""
    given = {field.name: value for field, value in zip(fields(PageSettings), values, strict=True)}
    given["window"] = given["window"] or None
    for name in _NUMBERS:
        text = str(given[name] or "").strip().replace(",", ".")
        try:
            given[name] = float(text) if text else None
        except ValueError:
            label = name.replace("_", " ")
            raise InputError(f"{label} must be a number, got {given[name]!r}", "app.not_a_number") from None
    return PageSettings(**given)
