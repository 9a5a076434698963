"""The page: the layout of the five steps, the event handlers (all private), and the public endpoint `/infer`
(docs/how-to/app.md)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import gradio as gr
from gradio.components.api_component import Api
from gradio.utils import get_upload_folder

from cavirheo.app import steps, words
from cavirheo.app.session import PageSettings, Session, Visitors
from cavirheo.errors import InputError, SolverError, require
from cavirheo.inference import DEFAULT
from cavirheo.io.videos import Camera
from cavirheo.physics.media import MEDIA

_PRESS = "() => document.querySelector('#{}').click()"
_FOCUS = "() => setTimeout(() => document.querySelector('#{}')?.focus(), 100)"
_ADDRESS = "link => history.replaceState(null, '', link || location.pathname)"
_PREVIEWS: dict[str, Any] = {"concurrency_id": "previews", "concurrency_limit": 2, "show_progress": "hidden"}
_RUNS: dict[str, Any] = {"concurrency_id": "runs", "concurrency_limit": 2}  # limit over all visitors
_AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
_LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
_CAMERA = {"Frames per second": "as the camera was set", "µm per pixel": "4.0", "Exposure of a frame (µs)": "if known"}
_line = partial(gr.Textbox, max_lines=1)
_button = partial(gr.Button, variant="primary")
_html = partial(gr.HTML, apply_default_css=False)
_small = partial(gr.Button, size="sm", min_width=120)
_stop = partial(gr.Button, "Stop", variant="stop")  # visible only during a run or a fit: app.css
_Shown = dict[Any, Any]  # new content by component; a component that is not a key keeps its content
_Handler = Callable[..., Any]


class _Served(gr.Blocks):
    """Blocks whose endpoint accepts calls without the last arguments, if these have defaults."""

    def validate_inputs(self, block_fn: Any, inputs: list[Any]) -> None:
        inputs += [block.value for block in block_fn.inputs[len(inputs) :] if isinstance(block, Api)]
        super().validate_inputs(block_fn, inputs)


class Page:
    """The five steps with their handlers, in `blocks`, not yet served.

    The HTML id of a component is its attribute's name, with hyphens. `wrong` is the component for error messages.
    """

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors  # by itself, gradio keeps figures and tables of closed pages
        visitors.forgotten = lambda name: self.blocks.state_holder.session_data.pop(name, None)
        self.fields: dict[str, Any] = {}  # component of each field of PageSettings
        self.tabs: list[Any] = []
        tabs = {"Data": self._data, "Prepare": self._prepare, "Infer": self._infer}
        tabs |= {"Check": self._check, "Export": self._export}
        self.blocks = _Served(title="cavirheo", analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
        with self.blocks:
            self.top = _html(words.part("top", words.VERSION))
            self.wrong, self.link = _html(), gr.Textbox(visible="hidden", label="Address")
            with gr.Tabs(selected=1) as self.steps:
                for number, (name, part) in enumerate(tabs.items(), 1):
                    with gr.Tab(f"{number} {name}", id=number, interactive=number == 1) as tab:
                        part()
                    self.tabs.append(tab)
            self._wire([self.fields[field.name] for field in fields(PageSettings)])
            gr.api(_public(visitors), api_name="infer", concurrency_limit=4)
        for name, part in (vars(self) | self.fields).items():
            if isinstance(part, gr.blocks.Block):
                part.elem_id = name.replace("_", "-")

    # layout

    def _data(self) -> None:
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(label="Measured R(t), or recordings", file_count="multiple", height=160)
                _html(words.part("kinds", self.visitors.limits.file_mb))
            with gr.Column(scale=2, min_width=260):
                _html(words.part("quiet", "or look at a shipped example first:"))
                with gr.Row():
                    self.examples = {name: _small(name) for name in steps.examples()}
                with gr.Row():
                    self.clear, self.to_prepare = _small("Start over"), _small("Prepare first", interactive=False)
                self.infer_now = _button("Infer all shots", interactive=False)
        with gr.Column(visible=False) as self.sure:
            self.lost = _html()
            with gr.Row():
                self.keep, self.delete = gr.Button("Keep them"), gr.Button("Delete them", variant="stop")
        self.refused = _html()
        self.welcome = _html(words.welcome())
        self._film()
        self.overview = _html(visible=False)
        self.warned, self.found = _html(), _html(js_on_load=words.script("materials.js"))

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
                    self.film_plot = _html(min_width=300)
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
                self.fields["window"] = gr.Dropdown(words.WINDOWS, value=0, label="Window that is compared")
                self.fields["group"] = gr.Dropdown(words.GROUPS, value="auto", label="Shots that are one material")
                with gr.Row():
                    self.fields["medium"] = gr.Dropdown(list(MEDIA), value="water", label="Medium", min_width=120)
                    self._numbers("density")
                self._numbers("rmax_um", "stretch")
                vouch = "I vouch for scale, frame rate and medium, however odd they look"
                self.fields["trust_input"] = gr.Checkbox(label=vouch)
                with gr.Accordion("More about the liquid", open=False):
                    self._numbers("sound_speed", "surface_tension")
                    self._numbers("pressure", "temperature")
            with gr.Column(scale=3, min_width=300):
                self.shown = gr.Dropdown(label="Shot shown")
                self.prepared = _html()
        self.to_infer = _button("Go on")

    def _numbers(self, *names: str) -> None:  # text boxes, because an empty gr.Number stalls the page
        with gr.Row():
            for name in names:
                label, empty = words.NUMBERS[name]
                self.fields[name] = _line(label=label, placeholder=empty, min_width=120)

    def _infer(self) -> None:
        self.fields["material"] = gr.Radio(words.materials(), value="auto", label="Law of the material")
        with gr.Accordion("More about the method", open=False):
            self.fields["model"] = gr.Radio(words.models(), value=DEFAULT, label="Model")
            self.fields["bubble"] = gr.Radio(words.BUBBLES, value="real", label="Bubble")
            self.fields["verify"] = gr.Radio(words.LEVELS, value="auto", label="Uncertainty")
        with gr.Row():
            self.infer, self.stop = _button("Infer all chosen shots"), _stop()
        self.which = gr.Button("Most shots ask for another law: let the evidence choose it", visible=False)
        self.answers = _html(words.part("quiet", words.NONE), min_height=120, js_on_load=words.script("table.js"))
        self.groups, self.timer = _html(visible=False), gr.Timer(1.0, active=False)
        values = "Published values or a rheometer's sweeps beside them"
        self.published = gr.UploadButton(values, file_count="multiple", visible=False)
        self.to_check = gr.Button("Check against the simulation", interactive=False)

    def _check(self) -> None:
        with gr.Row(equal_height=True):
            self.checked = gr.Dropdown(label="Shot", scale=3, min_width=200)
            self.fit = gr.Button("Fit conventionally (seconds)", scale=1, min_width=180)
            self.stop_fit = _stop(scale=1, min_width=100)
        self.check_plot = _html()
        with gr.Row():
            sliders = steps.SLIDERS.items()
            self.sliders = [gr.Slider(label=word, elem_id=f"slider-{key}", min_width=200) for key, (word, _) in sliders]
        self.trial = _html()
        self.facts = _html()
        self.to_export = gr.Button("Export")

    def _export(self) -> None:
        _html(words.part("export"))
        self.make = _button("Download cavirheo-result.zip")
        self.files = gr.File(label="File by file", file_count="multiple", interactive=False, visible=False)
        self.download = gr.DownloadButton()  # hidden: a script clicks it when the zip is ready

    # event handlers

    def _on(self, event: Any, handler: _Handler, sources: Any, out: Any, *, works: bool = False, **options: Any) -> Any:
        """Bind the handler to an event, or to a list of events. It gets the visitor's session, locked, and the values
        of `sources`; with `works` (a long task), it gets `progress`, and no lock is held. The page shows its errors."""

        def handle(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> _Shown:  # noqa: B008
            session = self.visitors.of(request.session_hash)
            lock: Any = nullcontext() if works else session.lock
            bar = {"progress": progress} if works else {}
            with lock:
                try:
                    session.refusal, result = "", handler(session, *values, **bar)
                except (InputError, SolverError) as error:
                    session.refusal = words.for_page(error)
                    raise gr.Error(session.refusal, visible=False, print_exception=False) from None
            return {**(result or {}), self.wrong: ""}

        def why(request: gr.Request) -> str:  # the message covers nothing, and the next success clears it
            return words.part("wrong", self.visitors.of(request.session_hash).refusal)

        begins = partial(gr.on, event) if isinstance(event, list) else event
        handled = begins(handle, sources, [*out, self.wrong], api_visibility="private", **options)
        handled.failure(why, None, [self.wrong], api_visibility="private", **_AT_ONCE)
        return handled

    def _validated(self, wrong: Callable[..., list[str]]) -> _Handler:
        """Return a validator that shows each message of `wrong` at its field, and cancels the event if there is any."""

        def validate(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.of(request.session_hash)
            with session.lock:
                results = [gr.validate(not why, why) for why in wrong(session, *values)]
            return results if len(results) > 1 else results[0]  # gradio expects no list for a single field

        return validate

    def _wire(self, settings: list[Any]) -> None:
        of_answers = [self.answers, self.to_check, self.which, self.groups, self.published]
        self.state = [*self.tabs[1:], self.to_prepare, self.infer_now, *of_answers]
        loaded = [self.refused, self.sure, self.found, self.welcome, self.overview, self.chosen, self.shown, self.link]
        outputs = [*loaded, *self.state, *self._wire_film()]
        wrong = self._validated(lambda session, *texts: session.current.unready(*texts))
        checked: dict[str, Any] = {"validator": wrong, "show_progress_on": [self.film_told]}
        self._on(self.confirm.click, self._confirm, [*self.film_typed, self.film_excluded], outputs, **checked)
        check = [self.check_plot, self.facts, self.trial, *self.sliders]
        many = partial(self._on, trigger_mode="multiple")  # also while another upload is loading
        sent = many(self.upload.upload, self._sent, [self.upload], [self.upload], works=True, **_AT_ONCE)
        many(sent.then, self._load, settings, outputs, show_progress_on=[self.found])
        for name, example in self.examples.items():
            self._on(example.click, partial(self._example, name), settings, outputs)
        question = self._on(self.clear.click, self._ask, [], [*outputs, self.lost])
        question.success(None, js=_FOCUS.format("keep"), api_visibility="private")
        self._on(self.keep.click, lambda _: {self.sure: gr.Column(visible=False)}, [], [self.sure])
        self._on(self.delete.click, self._clear, [], outputs)
        self._on(self.shown.change, self._view, [self.shown], [self.prepared], works=True, **_LATEST)
        # a reload, which sets the values one by one, causes no `input` event; pasting text causes none either
        kinds = [setting.change if isinstance(setting, gr.Textbox) else setting.input for setting in settings]
        wrong = self._validated(lambda _, name, *values: ["", *_wrong(values)])
        prepared = [self.prepared, self.found, *self.state]
        self._on(kinds, self._changed, [self.shown, *settings], prepared, validator=wrong, **_LATEST)
        for pressed, step in ((self.to_prepare, 2), (self.to_infer, 3), (self.to_check, 4), (self.to_export, 5)):
            pressed.click(partial(gr.Tabs, selected=step), outputs=self.steps, queue=False, api_visibility="private")
        self._wire_runs([self.chosen, *settings], check)
        out, js = [self.steps, self.checked, *check], "() => [document.body.dataset.picked]"
        self._on(self.answers.click, self._picked, [self.checked], out, js=js, **_LATEST)
        # warnings load the solver: they are shown later, so that the table need not wait for it
        self._on(self.found.change, self._warn, [], [self.warned], works=True, **_LATEST)
        js = "(_, shown) => [document.body.dataset.materials, shown]"
        self._on(self.found.submit, self._name, [self.link, self.shown], prepared, js=js, **_LATEST)
        self._on(self.published.upload, self._publish, [self.published], self.state, show_progress="hidden")
        fitted: dict[str, Any] = {"works": True, "show_progress_on": [self.check_plot], **_RUNS}
        self._on(self.fit.click, self._fit, [self.checked], [self.check_plot, self.facts], **fitted)
        stops = [self.stop.click, self.stop_fit.click]
        self._on(stops, lambda session: session.runs.stopped.set(), [], [], queue=False)
        moved = [slider.input for slider in self.sliders]
        self._on(moved, self._try, [self.checked, *self.sliders], [self.check_plot, self.trial], queue=False, **_LATEST)
        single: dict[str, Any] = {"concurrency_limit": 1, "show_progress_on": [self.make]}
        zipped = self._on(self.make.click, self._zip, [], [self.files, self.download], works=True, **single)
        zipped.success(None, js=_PRESS.format("download"), api_visibility="private")
        self.link.change(None, self.link, js=_ADDRESS, api_visibility="private")
        # choices before text boxes, whose `change` events read all settings
        self.fields = dict(sorted(self.fields.items(), key=lambda item: isinstance(item[1], gr.Textbox)))
        everything = [*outputs, *self.fields.values(), self.checked, *check]
        self.blocks.load(self._back, None, everything, api_visibility="private", show_progress="hidden")
        self.blocks.unload(self._leave)

    def _wire_film(self) -> list[Any]:
        """Bind the handlers of recordings; return the components that show the selected recording."""
        look = [self.film_told, self.film_frame, self.film_plot, self.film_toggle]
        view = [self.film_seen, self.film_number, self.film_excluded]
        parts = [self.film_step, self.film, *self.film_typed, *view, *look]
        self._on(self.film.input, self._pick, [self.film], parts)
        starts = [self.measure.click, *(box.submit for box in self.film_typed)]
        wrong = self._validated(lambda session, *texts: session.current.camera_of(texts)[1])
        checked: dict[str, Any] = {"validator": wrong, "show_progress_on": [self.film_told]}
        self._on(starts, self._measure, self.film_typed, parts, works=True, concurrency_limit=1, **checked)
        self._on(self.film_number.input, self._look, [self.film_number], look, queue=False, **_LATEST)
        self._on(self.film_toggle.click, self._toggle, [], [self.film_excluded, *look], **_AT_ONCE)
        listed = self._validated(lambda session, text: session.current.leave_out(text))
        self._on(self.film_excluded.change, self._look, [self.film_excluded], look, validator=listed, **_LATEST)
        return parts

    def _wire_runs(self, inputs: list[Any], check: list[Any]) -> None:
        """Bind the handlers of runs: previews of the chosen shots come first, then each answer once it is ready."""
        chosen, run_outputs = [self.chosen], [self.checked, *self.state]
        which = self.which.click(lambda: "auto", None, self.fields["material"], api_visibility="private", **_AT_ONCE)
        which.then(None, js=_PRESS.format("infer"), api_visibility="private")
        starts, out = [self.infer_now.click, self.infer.click], [self.steps, self.timer, self.answers]
        begin = self._on(starts, self._begin, inputs, out, **_AT_ONCE)
        begin = self._on(begin.success, self._preview, chosen, [self.answers], works=True, **_PREVIEWS)
        run = self._on(begin.then, self._answer, chosen, run_outputs, works=True, show_progress="hidden", **_RUNS)
        self._on(run.success, self._show, [self.checked], check, show_progress="hidden")
        self._on(self.timer.tick, self._tick, [], [self.timer, self.answers], **_AT_ONCE)
        self._on(self.checked.select, self._show, [self.checked], check, show_progress="hidden")

    def _leave(self, request: gr.Request) -> None:
        self.visitors.leave(request.session_hash or "")

    def _back(self, request: gr.Request) -> Any:
        """Restore the session on a page that is reloaded, or opened by the link of the session."""
        session = self.visitors.back(request.session_hash or "", request.query_params.get("session", ""))
        if session is None:
            return gr.skip()  # all components stay as they are
        with session.lock:
            names = [curve.name for curve, _ in session.answers.pairs] if session.answers else []
            values = {"window": 0, "material": "auto"}
            values |= {name: value for name, value in vars(session.settings).items() if value is not None}
            texts = {name: f"{value:.10g}" for name, value in values.items() if isinstance(value, float)}
            shown = self._loaded(session) | {self.fields[name]: value for name, value in (values | texts).items()}
            shown[self.checked] = gr.Dropdown(choices=names, value=next(iter(names), None))
            return shown | self._show(session, names[0]) if names and not session.stale else shown

    def _sent(self, session: Session, files: list[str] | None, **_: Any) -> _Shown:
        session.sent.extend(files or [])
        return {self.upload: None}

    def _load(self, session: Session, *settings: Any) -> _Shown:
        files, session.sent = session.sent, []
        with uploaded(files) as paths:
            if paths:  # none if an earlier event has loaded these files
                session.add(paths, _settings(settings))
        return self._loaded(session)

    def _example(self, name: str, session: Session, *settings: Any) -> _Shown:
        session.add([steps.examples()[name]], _settings(settings), copy=True)
        if name in session.films:
            session.film, session.films[name].camera = name, Camera(500_000.0, 4.0, 0.4)
        return self._loaded(session)

    def _ask(self, session: Session) -> _Shown:
        """Ask whether to delete the files and answers; without any file, clear the session at once."""
        if not session.files and not session.films:
            return self._clear(session)
        return {self.sure: gr.Column(visible=True), self.lost: words.lost(session)}

    def _clear(self, session: Session) -> _Shown:
        session.clear()
        return self._loaded(session)

    def _loaded(self, session: Session) -> _Shown:
        names = [curve.name for curve in session.curves]
        anything = bool(names or session.films)
        shown = {
            self.refused: words.part("refused", session.problems),
            self.sure: gr.Column(visible=False),
            self.found: words.files_table(session),
            self.welcome: gr.HTML(visible=not anything),
            self.overview: gr.HTML(words.overview(session), visible=bool(names)),
            self.chosen: gr.CheckboxGroup(choices=names, value=names),
            self.shown: gr.Dropdown(choices=names, value=next(iter(names), None)),
            self.link: f"?session={session.link}" if anything else "",
        }
        return shown | self._state(session, draw=True) | self._filmed(session)

    def _state(self, session: Session, *, draw: bool = False) -> _Shown:
        """Enable the steps that can be used; show the answers, marked if settings changed since. draw: groups, too."""
        loaded, current = bool(session.curves), session.answers is not None and not session.stale
        groups: dict[str, Any] = {"value": words.groups(session)} if draw else {}
        able = zip(self.tabs[1:], (loaded, loaded, current, current), strict=True)
        return {tab: gr.Tab(interactive=works) for tab, works in able} | {
            self.to_prepare: gr.Button(interactive=loaded),
            self.infer_now: gr.Button(interactive=loaded),
            self.answers: words.answers(session),
            self.to_check: gr.Button(interactive=current),
            self.which: gr.Button(visible=steps.law_in_doubt(session)),
            self.groups: gr.HTML(visible=current, **groups),
            self.published: gr.UploadButton(visible=current),
        }

    def _filmed(self, session: Session) -> _Shown:
        clip = session.current
        names = [(f"{name}: {'not ' * (name in session.waiting)}confirmed", name) for name in session.recordings]
        camera = ["" if value is None else f"{value:.10g}" for value in clip.camera]
        first, last = (clip.measurement.first, clip.measurement.last) if clip.measurement else (1, 2)
        shown = {
            self.film_step: gr.Column(visible=bool(names)),
            self.film: gr.Dropdown(names, value=session.film or None, visible=len(names) > 1),
            self.film_seen: gr.Column(visible=clip.measurement is not None),
            self.film_number: gr.Slider(first, last, clip.frame),
            self.film_excluded: clip.exclude,
        }
        typed = dict(zip(self.film_typed, camera, strict=True)) if any(camera) else {}
        return shown | typed | self._look(session)

    def _look(self, session: Session, number: int | str = "") -> _Shown:
        clip = session.current
        clip.frame = number if isinstance(number, int) else clip.frame
        shown: _Shown = {self.film_told: words.film(clip)}
        if clip.measurement:
            label = "Bring this frame back" if clip.excluded[clip.index] else "Exclude this frame"
            shown |= {self.film_frame: words.frame(clip), self.film_plot: words.radii(clip), self.film_toggle: label}
        return shown

    def _pick(self, session: Session, name: str) -> _Shown:
        session.film = name
        return self._filmed(session)

    def _measure(self, session: Session, *texts: str, progress: gr.Progress) -> _Shown:
        steps.measure(session, session.current.camera_of(texts)[0], progress)
        return self._filmed(session)

    def _toggle(self, session: Session) -> _Shown:
        session.current.toggle()
        return {self.film_excluded: session.current.exclude, **self._look(session)}

    def _confirm(self, session: Session, *_: str) -> _Shown:
        steps.confirm(session)
        session.film = next(iter(session.waiting), session.film)
        return self._loaded(session)

    def _view(self, session: Session, name: str | None, **_: Any) -> _Shown:
        selected = (curve for curve in session.curves if curve.name == name)
        texts = (words.prepared(curve, session.settings_of(curve.name)) for curve in selected)
        return {self.prepared: next(texts, "")}

    def _warn(self, session: Session, **_: Any) -> _Shown:
        return {self.warned: words.part("warned", words.warnings(session.curves))}

    def _changed(self, session: Session, name: str | None, *settings: Any) -> _Shown:
        session.prepare(_settings(settings))
        return {**self._view(session, name), self.found: words.files_table(session), **self._state(session)}

    def _begin(self, session: Session, chosen: list[str], *settings: Any) -> _Shown:
        session.prepare(_settings(settings))
        if session.runs.ready():
            session.previews = dict.fromkeys(chosen)
        return {self.steps: gr.Tabs(selected=3), **self._tick(session)}

    def _tick(self, session: Session) -> _Shown:
        return {self.timer: gr.Timer(active=bool(session.previews)), self.answers: words.answers(session)}

    def _preview(self, session: Session, chosen: list[str], **_: Any) -> _Shown:
        with suppress(InputError):  # the run shows the same error
            steps.preview(session, chosen)
        return {self.answers: words.answers(session)}

    def _answer(self, session: Session, chosen: list[str], **_: Any) -> _Shown:
        names = [curve.name for curve, _ in steps.infer(session, chosen).pairs]
        with session.lock:
            return {self.checked: gr.Dropdown(choices=names, value=names[0]), **self._state(session, draw=True)}

    def _name(self, session: Session, materials: str, name: str | None) -> _Shown:
        earlier, edits = words.table(session), json.loads(materials)
        steps.name_materials(session, edits["names"], edits["densities"])
        same = words.table(session) == earlier  # the table is not drawn again: the focus stays
        table = {} if same else {self.found: words.files_table(session)}
        return self._view(session, name) | table | self._state(session, draw=True)

    def _publish(self, session: Session, files: list[str]) -> _Shown:
        with uploaded(files) as paths:
            session.publish(paths)
        return self._state(session, draw=True)

    def _picked(self, session: Session, name: str) -> _Shown:
        return {self.steps: gr.Tabs(selected=4), self.checked: name, **self._show(session, name)}

    def _show(self, session: Session, name: str) -> _Shown:
        ranges = zip(self.sliders, steps.sliders(session, name).values(), strict=True)
        answers, *_, record = session.find(name)
        answers.trials.pop(name, None)
        shown = self._checked(session, name) | {self.trial: words.part("start", record.simulated)}
        return shown | {slider: gr.Slider(visible=bool(limits), **(limits or {})) for slider, limits in ranges}  # type: ignore[arg-type]

    def _fit(self, session: Session, name: str, **_: Any) -> _Shown:
        session.runs.ready()
        steps.fit(session, name)
        with session.lock:
            return self._checked(session, name)

    def _checked(self, session: Session, name: str) -> _Shown:
        return {self.check_plot: words.checked(session, name), self.facts: words.facts(session, name)}

    def _try(self, session: Session, name: str, *values: float | None) -> _Shown:
        checks = steps.what_if(session, name, values)
        return {self.check_plot: words.checked(session, name), self.trial: words.part("trial", checks)}

    def _zip(self, session: Session, *, progress: gr.Progress) -> _Shown:
        archive, files = steps.export(session, progress)
        shown = gr.File([str(path) for path in files], visible=True)
        return {self.files: shown, self.download: gr.DownloadButton(value=str(archive))}


def _settings(values: Sequence[Any]) -> PageSettings:
    """Return the settings with these values, in the order of the fields of PageSettings. Raises InputError."""
    settings, wrong = PageSettings.of(values)
    require(not wrong, "; ".join(wrong.values()), "app.settings")
    return settings


def _wrong(values: Sequence[Any]) -> list[str]:
    """Return the error message of each field of PageSettings, "" where the value is valid."""
    wrong = PageSettings.of(values)[1]
    return [words.for_page(wrong.get(field.name, "")) for field in fields(PageSettings)]


@contextmanager
def uploaded(files: Sequence[str]) -> Iterator[list[Path]]:
    """Yield the paths of uploaded files; at the end, delete the ones that are still there. Raises InputError: another
    file of this machine."""
    folder = Path(get_upload_folder()).resolve()
    paths = [Path(file).resolve() for file in files]
    if not all(path.is_relative_to(folder) and path.is_file() for path in paths):
        raise InputError("only uploaded files are read", "app.not_uploaded")
    try:
        yield paths
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


def _public(visitors: Visitors) -> Callable[..., Any]:
    """Return the function of the endpoint `/infer`, for programs; nothing is kept after a call."""

    def infer(
        files: list[gr.FileData],
        model: str = DEFAULT,
        medium: str = "water",
        density: float | None = None,
        rmax_um: float | None = None,
        stretch: float | str | None = None,
        window: int | None = None,
        verify: str = "auto",
        material: str | None = None,
        bubble: str = "real",
        trust_input: bool = False,
    ) -> dict[str, Any]:
        """Measured radius histories in, the content of result.json out; options as those of `cavirheo infer`."""
        values: dict[str, Any] = {**locals()}
        options = {name: value for name, value in values.items() if hasattr(PageSettings, name) and value is not None}
        session = Session(visitors.limits, visitors.reader, store=visitors.store)
        try:
            with uploaded([str(dict(file)["path"]) for file in files or []]) as paths:
                session.add(paths, PageSettings(**options))
                require(not session.waiting, f"{session.waiting}: send measured.csv of `cavirheo measure`", "app.film")
                problem = "; ".join(session.problems) or "no curve could be read"
                require(bool(session.curves), problem, "app.no_curve")
                document = steps.infer(session, [curve.name for curve in session.curves]).document
                document.notes.extend(session.problems)
                return document.model_dump(by_alias=True, mode="json")
        except (InputError, SolverError) as error:
            raise gr.Error(words.for_page(error), title="Not done", print_exception=False) from None
        finally:
            visitors.end(session)

    return infer
