"""The page: what stands where in the five steps, and which handler answers what.

Only `infer` (endpoint.py) is public to programs; the handlers of the page are not.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from functools import partial, wraps
from pathlib import Path
from typing import Any

import gradio as gr
from gradio.utils import get_upload_folder

from cavirheo.app import endpoint, export, plots, steps, words
from cavirheo.app.session import Session, Settings, Visitors
from cavirheo.errors import InputError, SolverError
from cavirheo.inference.model import DEFAULT
from cavirheo.physics.media import MEDIA

TITLE = "cavirheo"
_FORMATS = ".mat, .csv, .txt, .h5, .xlsx"
_LEVELS = [
    ("none (fastest)", "none"), ("quick (Gaussian)", "map"),
    ("full (weighted draws, several seconds a shot)", "full"),
]  # fmt: skip
_WINDOWS = [("all that the model reads", 0), ("1 collapse", 1), ("2 collapses", 2), ("3 collapses", 3)]
_REDRAW = Path(__file__).with_name("redraw.js").read_text(encoding="utf-8")


def told(handler: Callable[..., Any]) -> Callable[..., Any]:
    """The handler, whose errors of the user become a message that stays until it is closed."""

    @wraps(handler)
    def one(*given: Any) -> Any:
        try:
            return handler(*given)
        except (InputError, SolverError) as error:
            text = str(error).replace("--rmax-um", "R_max in step 2")
            raise gr.Error(text, duration=None, title="Not done", print_exception=False) from None

    return one


def build(visitors: Visitors) -> gr.Blocks:
    """The page with its handlers, not yet served."""
    page = gr.Blocks(title=TITLE, analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
    with page:
        Page(visitors)

        def leave(request: gr.Request) -> None:
            visitors.leave(request.session_hash or "")

        page.unload(leave)
    return page


class Page:
    """The components of the five steps."""

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors
        gr.HTML(
            "<header><h1>cavirheo</h1><p>Shear modulus and viscosity from bubble radius histories</p></header>",
            elem_id="top", apply_default_css=False,
        )  # fmt: skip
        with gr.Tabs(selected=1, elem_id="steps") as self.tabs:
            with gr.Tab("1 Data", id=1):
                self._data()
            with gr.Tab("2 Prepare", id=2):
                self._prepare()
            with gr.Tab("3 Infer", id=3):
                self._infer()
            with gr.Tab("4 Check", id=4):
                self._check()
            with gr.Tab("5 Export", id=5):
                self._export()
        self.settings: list[Any] = [
            self.medium, self.density, self.sound_speed, self.surface_tension, self.pressure, self.temperature,
            self.rmax, self.stretch, self.window, self.model, self.verify,
        ]  # fmt: skip
        self._wire()
        gr.api(self._api(), api_name="infer")

    # what stands where

    def _data(self) -> None:
        limits = self.visitors.limits
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(
                    label=f"Measured R(t): {_FORMATS}; to {limits.file_mb:g} MB",
                    file_count="multiple", height=160, elem_id="upload",
                )  # fmt: skip
            with gr.Column(scale=2, min_width=260):
                gr.HTML(words.NOTHING.format("or look at a shipped example first:"), apply_default_css=False)
                with gr.Row():
                    self.examples = {
                        name: gr.Button(name, size="sm", min_width=120, elem_classes="example")
                        for name in steps.examples()
                    }
                with gr.Row():
                    self.clear = gr.Button("Start over", size="sm", elem_id="clear")
                    self.to_prepare = gr.Button("Prepare first", size="sm", elem_id="to-prepare")
                self.infer_now = gr.Button("Infer all shots", variant="primary", interactive=False, elem_id="infer-now")
        with gr.Row(visible=False) as self.overview:
            self.plain = gr.Plot(show_label=False, container=False, min_width=320, elem_id="overview")
            self.scaled = gr.Plot(show_label=False, container=False, min_width=320, elem_id="overview-normalised")
        self.found = gr.HTML(words.found([], []), apply_default_css=False, elem_id="found")

    def _prepare(self) -> None:
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                self.chosen = gr.CheckboxGroup(label="Shots to infer", show_select_all=True, elem_id="chosen")
                self.window = gr.Dropdown(_WINDOWS, value=0, label="Window that is compared", elem_id="window")
                with gr.Row():
                    self.medium = gr.Dropdown(list(MEDIA), value="water", label="Medium", min_width=120)
                    self.density = _number("density", "Density (kg/m³)", "as the medium")
                with gr.Row():
                    self.rmax = _number("rmax", "True R_max (µm)", "as measured")
                    self.stretch = _number("stretch", "λ = R_max/R_0", "fitted")
                with gr.Accordion("More about the liquid", open=False):
                    with gr.Row():
                        self.sound_speed = _number("sound_speed", "Sound speed (m/s)", "as the medium")
                        self.surface_tension = _number("surface_tension", "Surface tension (N/m)", "as the medium")
                    with gr.Row():
                        self.pressure = _number("pressure", "Pressure (Pa)", "as the medium")
                        self.temperature = _number("temperature", "Temperature (K)", "as the medium")
            with gr.Column(scale=3, min_width=300):
                self.shown = gr.Dropdown(label="Shot shown", elem_id="shown")
                self.prepared = gr.Plot(show_label=False, container=False, elem_id="prepared")
                self.dropped = gr.HTML(apply_default_css=False, elem_id="dropped")
        self.to_infer = gr.Button("Go on", variant="primary", elem_id="to-infer")

    def _infer(self) -> None:
        models = words.models()
        self.model = gr.Radio(models, value=DEFAULT, label="Material and model", elem_id="model")
        self.verify = gr.Radio(_LEVELS, value="none", label="Uncertainty", elem_id="verify")
        with gr.Row():
            self.infer = gr.Button("Infer all chosen shots", variant="primary", elem_id="infer")
            self.stop = gr.Button("Stop", variant="stop", visible=False, elem_id="stop")
        self.answers = gr.HTML(
            words.NOTHING.format("No answers yet: press the button above."), apply_default_css=False,
            elem_id="answers", min_height=120,
        )  # fmt: skip
        self.to_check = gr.Button("Check against the simulation", interactive=False, elem_id="to-check")

    def _check(self) -> None:
        with gr.Row(equal_height=True):
            self.checked = gr.Dropdown(label="Shot", scale=3, min_width=200, elem_id="checked")
            self.fit = gr.Button("Fit conventionally (seconds)", scale=1, min_width=180, elem_id="fit")
            self.stop_fit = gr.Button("Stop", variant="stop", visible=False, scale=1, min_width=100, elem_id="stop-fit")
        self.plot = gr.Plot(show_label=False, container=False, elem_id="check-plot")
        with gr.Row():
            self.sliders = [
                gr.Slider(label=label, elem_id=f"slider-{key}", min_width=200)
                for key, label in zip(steps.SLIDERS, ("Try G (kPa)", "Try µ (Pa s)", "Try λ (R_max/R_0)"), strict=True)
            ]
        self.trial = gr.HTML(
            {"words": ""}, html_template="${value.words}", js_on_load=_REDRAW, apply_default_css=False, elem_id="trial"
        )
        self.facts = gr.HTML(apply_default_css=False, elem_id="facts")
        self.to_export = gr.Button("Export", elem_id="to-export")

    def _export(self) -> None:
        gr.HTML(
            words.report(
                '<p class="card">One zip with <b>result.json</b>, the table <b>result.csv</b>, <b>report.html</b>, a '
                "figure of every shot (<b>PNG</b>, <b>SVG</b>), the processed and the simulated curves (<b>CSV</b>), "
                "and the conventional fits that you made.</p>"
            ),
            apply_default_css=False,
        )
        self.make = gr.Button("Download cavirheo-result.zip", variant="primary", elem_id="make")
        self.download = gr.DownloadButton(elem_id="download")  # never seen: pressed when the zip is made

    # which handler answers what

    def _wire(self) -> None:
        private: dict[str, Any] = {"api_visibility": "private"}
        shown = [
            self.found, self.plain, self.scaled, self.chosen, self.shown, self.upload, self.infer_now, self.answers,
            self.to_check, self.overview,
        ]  # fmt: skip
        self.upload.upload(
            self._of(self._load), [self.upload, *self.settings], shown, show_progress_on=[self.found], **private
        )
        for name, button in self.examples.items():
            button.click(self._of(partial(self._example, name)), self.settings, shown, **private)
        self.clear.click(self._of(self._clear), self.settings, shown, **private)
        view = [self.prepared, self.dropped]
        gr.on(
            [one.change for one in (self.shown, *self.settings[:-1])],
            self._of(self._view), [self.shown, *self.settings], view,
            trigger_mode="always_last", show_progress="hidden", **private,
        )  # fmt: skip
        for button, step in ((self.to_prepare, 2), (self.to_infer, 3), (self.to_check, 4), (self.to_export, 5)):
            button.click(_go(step), outputs=self.tabs, queue=False, **private)
        answered = [self.answers, self.checked, self.to_check]
        check = [self.plot, self.facts, self.trial, *self.sliders]
        for button in (self.infer_now, self.infer):
            run = self._run(
                button, 3, self.stop, self._answer, [self.chosen, *self.settings], answered,
                show_progress_on=[self.answers],
            )  # fmt: skip
            run.success(self._of(self._show), [self.checked, *self.settings], check, show_progress="hidden", **private)
        self.checked.select(
            self._of(self._show), [self.checked, *self.settings], check, show_progress="hidden", **private
        )
        self._run(
            self.fit, 4, self.stop_fit, self._fit, [self.checked, self.trial], [self.plot, self.facts],
            show_progress_on=[self.plot],
        )  # fmt: skip
        for button in (self.stop, self.stop_fit):
            button.click(self._of(lambda session: session.stopped.set()), queue=False, **private)
        gr.on(
            [slider.input for slider in self.sliders], self._of(self._try), [self.checked, *self.sliders], [self.trial],
            queue=False, show_progress="hidden", trigger_mode="always_last", **private,
        )  # fmt: skip
        self.make.click(self._of(self._zip), outputs=[self.download], show_progress_on=[self.make], **private).success(
            None, js="() => document.querySelector('#download').click()", **private
        )

    def _run(
        self, button: gr.Button, step: int, stop: gr.Button, handler: Callable[..., Any], *given: Any, **options: Any
    ) -> Any:
        """The button starts the handler, which works on shots, and shows the button that stops it."""

        def begin(session: Session) -> list[Any]:
            if not session.busy.locked():
                session.stopped.clear()
            return [gr.Tabs(selected=step), gr.Button(visible=True)]

        def end(session: Session) -> Any:
            return gr.Button(visible=session.busy.locked())

        at_once: dict[str, Any] = {"queue": False, "show_progress": "hidden", "api_visibility": "private"}
        run = button.click(self._of(begin), outputs=[self.tabs, stop], **at_once).then(
            self._of(handler, long=True), *given, concurrency_limit=2, api_visibility="private", **options
        )
        run.then(self._of(end), outputs=[stop], **at_once)
        return run

    def _of(self, handler: Callable[..., Any], *, long: bool = False) -> Callable[..., Any]:
        """The handler, called with the session of who asks: locked, or with the bar for what takes long."""

        @told
        def one(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            session = self.visitors.of(request.session_hash or "")
            if long:
                return handler(session, *values, progress=progress)
            with session.lock:
                return handler(session, *values)

        return one

    # the handlers

    def _load(self, session: Session, files: list[str] | None, *settings: Any) -> list[Any]:
        with _uploaded(files or []) as paths:
            session.add(paths, _settings(settings))
        return self._loaded(session)

    def _example(self, name: str, session: Session, *settings: Any) -> list[Any]:
        session.add([steps.examples()[name]], _settings(settings), copy=True)
        return self._loaded(session)

    def _clear(self, session: Session, *settings: Any) -> list[Any]:
        session.clear()
        return self._loaded(session)

    def _loaded(self, session: Session) -> list[Any]:
        names = [curve.name for curve in session.curves]
        figures = plots.overview(session.curves, session.settings.liquid) if names else (None, None)
        return [
            words.found(session.curves, session.problems), *figures, gr.CheckboxGroup(choices=names, value=names),
            gr.Dropdown(choices=names, value=names[0] if names else None), None, gr.Button(interactive=bool(names)),
            steps.answers(session), gr.Button(interactive=False), gr.Row(visible=bool(names)),
        ]  # fmt: skip

    def _view(self, session: Session, name: str | None, *settings: Any) -> list[Any]:
        session.prepare(_settings(settings))
        curve = next((curve for curve in session.curves if curve.name == name), None)
        if curve is None:
            return [None, ""]
        try:
            view = steps.compared(curve, session.settings)
            figure = plots.prepared(curve, view.curve, *steps.network_grid(curve, session.settings))
        except InputError as error:
            return [None, words.report(words.messages({str(error): [name or ""]}), words.notes([curve], shown=True))]
        return [figure, words.report(words.warnings([curve]), f"<section>{words.notes([curve], shown=True)}</section>")]

    def _answer(self, session: Session, chosen: list[str], *settings: Any, progress: gr.Progress) -> list[Any]:
        with session.lock:
            session.prepare(_settings(settings))
        steps.infer(session, chosen, progress)
        with session.lock:
            names = [curve.name for curve, _ in session.pairs]
            first = gr.Dropdown(choices=names, value=next(iter(names), None))
            return [steps.answers(session), first, gr.Button(interactive=True)]

    def _show(self, session: Session, name: str, *_: Any) -> list[Any]:
        ranges = steps.sliders(session, name)
        moved = [
            gr.Slider(visible=False) if (found := ranges[key]) is None else gr.Slider(visible=True, **found)  # type: ignore[arg-type]
            for key in steps.SLIDERS
        ]
        return [self._figure(session, name), steps.beside(session, name), {"words": ""}, *moved]

    def _fit(self, session: Session, name: str, trial: dict[str, Any], *, progress: gr.Progress) -> list[Any]:
        steps.fit(session, name, progress)
        drawn = json.loads(trial["lines"]) if "lines" in trial else None
        with session.lock:
            return [self._figure(session, name, drawn), steps.beside(session, name)]

    def _figure(self, session: Session, name: str, trial: dict[str, Any] | None = None) -> Any:
        curve, posterior = steps.pair(session, name)
        found = [plots.of(posterior, "simulation of the answer", plots.VERMILLION)]
        if name in session.fits:
            found.append(plots.of(session.fits[name], "least squares", plots.BLUE, "dash"))
        return plots.checked(curve, found, trial)

    def _try(self, session: Session, name: str, *values: float | None) -> dict[str, Any]:
        said, lines = steps.trial(session, name, values)
        return {"words": said, "lines": json.dumps({**lines, "traces": plots.TRIAL})}

    def _zip(self, session: Session) -> Any:
        return gr.DownloadButton(value=str(export.write_zip(session)))

    def _api(self) -> Callable[..., Any]:
        visitors = self.visitors

        @told
        def infer(
            files: list[gr.FileData],
            model: str = DEFAULT,
            medium: str = "water",
            density: float | None = None,
            rmax_um: float | None = None,
            stretch: float | None = None,
            window: int | None = None,
            verify: str = "none",
        ) -> dict:
            """Measured radius histories in, the content of result.json out; options as those of `cavirheo infer`."""
            with _uploaded([str(dict(file)["path"]) for file in files]) as paths:
                options: dict[str, Any] = {"rmax_um": rmax_um, "stretch": stretch, "window": window, "verify": verify}
                return endpoint.infer(visitors, paths, Settings(medium, density, model=model, **options))

        return infer


def _go(step: int) -> Callable[[], Any]:
    return lambda: gr.Tabs(selected=step)


@contextmanager
def _uploaded(files: Sequence[str]) -> Iterator[list[Path]]:
    """What the browser sent, and no other file of this machine: what is not taken over is removed."""
    folder = Path(get_upload_folder()).resolve()
    paths = [Path(file).resolve() for file in files]
    if not all(path.is_relative_to(folder) and path.is_file() for path in paths):
        raise InputError("only uploaded files are read")
    try:
        yield paths
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


def _number(name: str, label: str, empty: str) -> gr.Textbox:
    """A field for a number that need not be given."""
    return gr.Textbox(label=label, placeholder=empty, max_lines=1, min_width=120, elem_id=name)


def _settings(values: tuple[Any, ...]) -> Settings:
    """From the components, in the order of the fields of Settings. Raises InputError: no number."""
    given: dict[str, Any] = {field.name: value for field, value in zip(fields(Settings), values, strict=True)}
    for name, value in given.items():
        if name == "window":
            given[name] = value or None
        elif name not in ("medium", "model", "verify"):
            text = str(value or "").strip().replace(",", ".")
            try:
                given[name] = float(text) if text else None
            except ValueError:
                raise InputError(f"{name.replace('_', ' ')} must be a number, got {value!r}") from None
    return Settings(**given)
