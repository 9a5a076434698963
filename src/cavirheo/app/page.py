"""The page: the layout of the five steps, the event handlers (all private), and the public endpoint `/infer`
(docs/how-to/app.md)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
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

_CLICK = "() => document.querySelector('#{}').click()"
_FOCUS = "() => setTimeout(() => document.querySelector('#{}')?.focus(), 100)"
_ADDRESS = "link => history.replaceState(null, '', link || location.pathname)"
_RUNS: dict[str, Any] = {"concurrency_id": "runs", "concurrency_limit": 2}  # limit over all visitors
_UNQUEUED: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
_LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
_CAMERA = {"Frames per second": "as the camera was set", "µm per pixel": "4.0", "Exposure of a frame (µs)": "if known"}
_text_box = partial(gr.Textbox, max_lines=1)
_button = partial(gr.Button, variant="primary")
_html = partial(gr.HTML, apply_default_css=False)
_small_button = partial(gr.Button, size="sm", min_width=120)
_stop_button = partial(gr.Button, "Stop", variant="stop")  # visible only during a run or a fit: app.css
_Updates = dict[Any, Any]  # new content by component; a component that is not a key keeps its content
_Handler = Callable[..., Any]


class _Blocks(gr.Blocks):
    """Blocks whose endpoint accepts calls without the last arguments, if these have defaults."""

    def validate_inputs(self, block_fn: Any, inputs: list[Any]) -> None:
        inputs += [block.value for block in block_fn.inputs[len(inputs) :] if isinstance(block, Api)]
        super().validate_inputs(block_fn, inputs)


class Page:
    """The five steps with their handlers, in `blocks`, not yet served.

    The HTML id of a component is its attribute's name, with hyphens. `error_box` is the component for error messages.
    """

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors  # by itself, gradio keeps figures and tables of closed pages
        visitors.on_forget = lambda name: self.blocks.state_holder.session_data.pop(name, None)
        self.fields: dict[str, Any] = {}  # component of each field of PageSettings
        self.tabs: list[Any] = []
        tabs = {"Data": self._data, "Prepare": self._prepare, "Infer": self._infer}
        tabs |= {"Check": self._check, "Export": self._export}
        self.blocks = _Blocks(title="cavirheo", analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
        with self.blocks:
            self.banner = _html(words.render("banner", words.VERSION))
            self.error_box, self.link = _html(), gr.Textbox(visible="hidden", label="Address")
            with gr.Tabs(selected=1) as self.steps:
                for number, (name, part) in enumerate(tabs.items(), 1):
                    with gr.Tab(f"{number} {name}", id=number, interactive=number == 1) as tab:
                        part()
                    self.tabs.append(tab)
            self._wire([self.fields[field.name] for field in fields(PageSettings)])
            gr.api(_infer_endpoint(visitors), api_name="infer", concurrency_limit=4)
        for name, part in (vars(self) | self.fields).items():
            if isinstance(part, gr.blocks.Block):
                part.elem_id = name.replace("_", "-")

    # layout

    def _data(self) -> None:
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(label="Measured R(t), or recordings", file_count="multiple", height=160)
                _html(words.render("file_kinds", self.visitors.limits.file_mb))
                self._numbers("fps", "um_per_px")
            with gr.Column(scale=2, min_width=260):
                _html(words.render("hint", "or look at a shipped example first:"))
                with gr.Row():
                    self.examples = {name: _small_button(name) for name in steps.examples()}
                with gr.Row():
                    self.clear = _small_button("Start over")
                    self.to_prepare = _small_button("Prepare first", interactive=False)
                self.infer_now = _button("Infer all shots", interactive=False)
        with gr.Column(visible=False) as self.clear_dialog:
            self.clear_warning = _html()
            with gr.Row():
                self.keep_files, self.delete_files = gr.Button("Keep them"), gr.Button("Delete them", variant="stop")
        self.file_errors = _html()
        self.welcome = _html(words.welcome())
        self._film()
        self.overview = _html(visible=False)
        self.input_warnings, self.shots_table = _html(), _html(js_on_load=words.read_file("materials.js"))

    def _film(self) -> None:
        with gr.Column(visible=False) as self.film_step:
            self.film = gr.Dropdown(label="Recording")
            with gr.Row():
                boxes = [_text_box(label=label, placeholder=hint, min_width=160) for label, hint in _CAMERA.items()]
                self.film_rate, self.film_scale, self.film_exposure = self.camera_boxes = boxes
                self.measure = _button("Measure the bubble", min_width=160)
            self.film_summary = _html(min_height=60)
            with gr.Column(visible=False) as self.film_view:
                with gr.Row():
                    with gr.Column(min_width=300):
                        self.film_frame = _html()
                    self.film_plot = _html(min_width=300)
                wide: dict[str, Any] = {"scale": 3, "min_width": 220}
                with gr.Row():
                    self.film_number = gr.Slider(label="Frame shown", step=1, buttons=[], **wide)
                    self.film_toggle = gr.Button("Exclude this frame", scale=1, min_width=140)
                with gr.Row():
                    self.film_excluded = _text_box(label="Frames to exclude", placeholder="12, 40-45", **wide)
                    self.confirm = _button("Confirm this curve", scale=1, min_width=140)

    def _prepare(self) -> None:
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                self.chosen_shots = gr.CheckboxGroup(label="Shots to infer", show_select_all=True)
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
                self.shown_shot = gr.Dropdown(label="Shot shown")
                self.prepared_curve = _html()
        self.to_infer = _button("Go on")

    def _numbers(self, *names: str) -> None:  # text boxes, because an empty gr.Number stalls the page
        with gr.Row():
            for name in names:
                label, empty = words.NUMBER_FIELDS[name]
                self.fields[name] = _text_box(label=label, placeholder=empty, min_width=120)

    def _infer(self) -> None:
        self.fields["material"] = gr.Radio(words.material_choices(), value="auto", label="Law of the material")
        with gr.Accordion("More about the method", open=False):
            self.fields["model"] = gr.Radio(words.model_choices(), value=DEFAULT, label="Model")
            self.fields["bubble"] = gr.Radio(words.BUBBLES, value="real", label="Bubble")
        with gr.Row():
            self.infer, self.stop = _button("Infer all chosen shots"), _stop_button()
        self.auto_law = gr.Button(
            "Most shots ask for another law: try a liquid, or a gel that may stiffen", visible=False
        )
        self.answers = _html(
            words.render("hint", words.NO_ANSWERS), min_height=120, js_on_load=words.read_file("table.js")
        )
        self.groups, self.timer = _html(visible=False), gr.Timer(1.0, active=False)
        values = "Published values or a rheometer's sweeps beside them"
        self.published = gr.UploadButton(values, file_count="multiple", visible=False)
        self.to_check = gr.Button("Check against the simulation", interactive=False)

    def _check(self) -> None:
        with gr.Row(equal_height=True):
            self.checked_shot = gr.Dropdown(label="Shot", scale=3, min_width=200)
            self.fit = gr.Button("Fit conventionally (seconds)", scale=1, min_width=180)
            self.stop_fit = _stop_button(scale=1, min_width=100)
        self.check_plot = _html()
        with gr.Row():
            sliders = steps.SLIDERS.items()
            self.sliders = [gr.Slider(label=word, elem_id=f"slider-{key}", min_width=200) for key, (word, _) in sliders]
        self.trial = _html()
        self.facts = _html()
        self.to_export = gr.Button("Export")

    def _export(self) -> None:
        _html(words.render("export"))
        self.make_zip = _button("Download cavirheo-result.zip")
        self.result_files = gr.File(label="File by file", file_count="multiple", interactive=False, visible=False)
        self.download = gr.DownloadButton()  # hidden: a script clicks it when the zip is ready

    # event handlers

    def _bind(self, event: Any, handler: _Handler, inputs: Any, out: Any, *, slow: bool = False, **options: Any) -> Any:
        """Bind the handler to an event, or to a list of events. It gets the visitor's session, locked, and the values
        of `inputs`; with `slow` (a long task), it gets `progress`, and no lock is held. The page shows its errors."""

        def handle(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> _Updates:  # noqa: B008
            session = self.visitors.session_for(request.session_hash)
            lock: Any = nullcontext() if slow else session.lock
            bar = {"progress": progress} if slow else {}
            with lock:
                try:
                    session.error_message, result = "", handler(session, *values, **bar)
                except (InputError, SolverError) as error:
                    session.error_message = words.page_text(error)
                    raise gr.Error(session.error_message, visible=False, print_exception=False) from None
            return {**(result or {}), self.error_box: ""}

        def show_error(request: gr.Request) -> str:  # the message covers nothing, and the next success clears it
            return words.render("error_box", self.visitors.session_for(request.session_hash).error_message)

        listen = partial(gr.on, event) if isinstance(event, list) else event
        listener = listen(handle, inputs, [*out, self.error_box], api_visibility="private", **options)
        listener.failure(show_error, None, [self.error_box], api_visibility="private", **_UNQUEUED)
        return listener

    def _make_validator(self, find_errors: Callable[..., list[str]]) -> _Handler:
        """Return a validator that shows each message of `find_errors` at its field, and cancels the event if any."""

        def validate(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.session_for(request.session_hash)
            with session.lock:
                results = [gr.validate(not error, error) for error in find_errors(session, *values)]
            return results if len(results) > 1 else results[0]  # gradio expects no list for a single field

        return validate

    def _wire(self, settings: list[Any]) -> None:
        answer_outputs = [self.answers, self.to_check, self.auto_law, self.groups, self.published]
        self.state_outputs = [*self.tabs[1:], self.to_prepare, self.infer_now, *answer_outputs]
        data_outputs = [self.file_errors, self.clear_dialog, self.shots_table, self.welcome, self.overview]
        data_outputs += [self.chosen_shots, self.shown_shot, self.link]
        outputs = [*data_outputs, *self.state_outputs, *self._wire_film()]
        validator = self._make_validator(lambda session, *texts: session.current_clip.confirm_errors(*texts))
        checked: dict[str, Any] = {"validator": validator, "show_progress_on": [self.film_summary]}
        self._bind(self.confirm.click, self._confirm, [*self.camera_boxes, self.film_excluded], outputs, **checked)
        check = [self.check_plot, self.facts, self.trial, *self.sliders]
        bind_concurrent = partial(self._bind, trigger_mode="multiple")  # also while another upload is loading
        sent = bind_concurrent(self.upload.upload, self._enqueue, [self.upload], [self.upload], slow=True, **_UNQUEUED)
        bind_concurrent(sent.then, self._load, settings, outputs, show_progress_on=[self.shots_table])
        for name, example in self.examples.items():
            self._bind(example.click, partial(self._load_example, name), settings, outputs)
        question = self._bind(self.clear.click, self._ask_clear, [], [*outputs, self.clear_warning])
        question.success(None, js=_FOCUS.format("keep-files"), api_visibility="private")
        self._bind(
            self.keep_files.click, lambda _: {self.clear_dialog: gr.Column(visible=False)}, [], [self.clear_dialog]
        )
        self._bind(self.delete_files.click, self._clear, [], outputs)
        self._bind(
            self.shown_shot.change, self._show_prepared, [self.shown_shot], [self.prepared_curve], slow=True, **_LATEST
        )
        # a reload, which sets the values one by one, causes no `input` event; pasting text causes none either
        change_events = [setting.change if isinstance(setting, gr.Textbox) else setting.input for setting in settings]
        validator = self._make_validator(lambda _, name, *values: ["", *_field_errors(values)])
        prepared = [self.prepared_curve, self.shots_table, *self.state_outputs]
        self._bind(
            change_events, self._change_settings, [self.shown_shot, *settings], prepared, validator=validator, **_LATEST
        )
        for pressed, step in ((self.to_prepare, 2), (self.to_infer, 3), (self.to_check, 4), (self.to_export, 5)):
            pressed.click(partial(gr.Tabs, selected=step), outputs=self.steps, queue=False, api_visibility="private")
        self._wire_runs([self.chosen_shots, *settings], check)
        out, js = [self.steps, self.checked_shot, *check], "() => [document.body.dataset.picked]"
        self._bind(self.answers.click, self._open_check, [self.checked_shot], out, js=js, **_LATEST)
        # warnings load the solver: they are shown later, so that the table need not wait for it
        self._bind(self.shots_table.change, self._warn, [], [self.input_warnings], slow=True, **_LATEST)
        js = "(_, shown) => [document.body.dataset.materials, shown]"
        self._bind(
            self.shots_table.submit, self._name_materials, [self.link, self.shown_shot], prepared, js=js, **_LATEST
        )
        self._bind(
            self.published.upload, self._add_published, [self.published], self.state_outputs, show_progress="hidden"
        )
        fit_options: dict[str, Any] = {"slow": True, "show_progress_on": [self.check_plot], **_RUNS}
        self._bind(self.fit.click, self._fit, [self.checked_shot], [self.check_plot, self.facts], **fit_options)
        stops = [self.stop.click, self.stop_fit.click]
        self._bind(stops, lambda session: session.runs.stopped.set(), [], [], queue=False)
        slider_events = [slider.input for slider in self.sliders]
        self._bind(
            slider_events,
            self._try_sliders,
            [self.checked_shot, *self.sliders],
            [self.check_plot, self.trial],
            queue=False,
            **_LATEST,
        )
        options: dict[str, Any] = {"concurrency_limit": 1, "show_progress_on": [self.make_zip]}
        zipped = self._bind(
            self.make_zip.click, self._zip, [], [self.result_files, self.download], slow=True, **options
        )
        zipped.success(None, js=_CLICK.format("download"), api_visibility="private")
        self.link.change(None, self.link, js=_ADDRESS, api_visibility="private")
        # choices before text boxes, whose `change` events read all settings
        self.fields = dict(sorted(self.fields.items(), key=lambda item: isinstance(item[1], gr.Textbox)))
        everything = [*outputs, *self.fields.values(), self.checked_shot, *check]
        self.blocks.load(self._restore, None, everything, api_visibility="private", show_progress="hidden")
        self.blocks.unload(self._leave)

    def _wire_film(self) -> list[Any]:
        """Bind the handlers of recordings; return the components that show the selected recording."""
        frame_parts = [self.film_summary, self.film_frame, self.film_plot, self.film_toggle]
        view_parts = [self.film_view, self.film_number, self.film_excluded]
        parts = [self.film_step, self.film, *self.camera_boxes, *view_parts, *frame_parts]
        self._bind(self.film.input, self._select_film, [self.film], parts)
        starts = [self.measure.click, *(box.submit for box in self.camera_boxes)]
        validator = self._make_validator(lambda session, *texts: session.current_clip.read_camera(texts)[1])
        checked: dict[str, Any] = {"validator": validator, "show_progress_on": [self.film_summary]}
        self._bind(starts, self._measure, self.camera_boxes, parts, slow=True, concurrency_limit=1, **checked)
        self._bind(self.film_number.input, self._show_frame, [self.film_number], frame_parts, queue=False, **_LATEST)
        self._bind(self.film_toggle.click, self._toggle_frame, [], [self.film_excluded, *frame_parts], **_UNQUEUED)
        listed = self._make_validator(lambda session, text: session.current_clip.set_excluded(text))
        self._bind(
            self.film_excluded.change, self._show_frame, [self.film_excluded], frame_parts, validator=listed, **_LATEST
        )
        return parts

    def _wire_runs(self, inputs: list[Any], check: list[Any]) -> None:
        """Bind the handlers of runs: each answer is shown once it is ready."""
        chosen, run_outputs = [self.chosen_shots], [self.checked_shot, *self.state_outputs]
        auto = self.auto_law.click(lambda: "auto", None, self.fields["material"], api_visibility="private", **_UNQUEUED)
        auto.then(None, js=_CLICK.format("infer"), api_visibility="private")
        starts, out = [self.infer_now.click, self.infer.click], [self.steps, self.timer, self.answers]
        begin = self._bind(starts, self._begin_run, inputs, out, **_UNQUEUED)
        run = self._bind(begin.success, self._answer, chosen, run_outputs, slow=True, show_progress="hidden", **_RUNS)
        self._bind(run.success, self._show_check, [self.checked_shot], check, show_progress="hidden")
        self._bind(self.timer.tick, self._refresh_answers, [], [self.timer, self.answers], **_UNQUEUED)
        self._bind(self.checked_shot.select, self._show_check, [self.checked_shot], check, show_progress="hidden")

    def _leave(self, request: gr.Request) -> None:
        self.visitors.leave(request.session_hash or "")

    def _restore(self, request: gr.Request) -> Any:
        """Restore the session on a page that is reloaded, or opened by the link of the session."""
        session = self.visitors.reopen(request.session_hash or "", request.query_params.get("session", ""))
        if session is None:
            return gr.skip()  # all components stay as they are
        with session.lock:
            names = [curve.name for curve, _ in session.answers.pairs] if session.answers else []
            values = {"window": 0, "material": "auto"}
            values |= {name: value for name, value in vars(session.settings).items() if value is not None}
            texts = {name: f"{value:.10g}" for name, value in values.items() if isinstance(value, float)}
            shown = self._show_data(session) | {self.fields[name]: value for name, value in (values | texts).items()}
            shown[self.checked_shot] = gr.Dropdown(choices=names, value=next(iter(names), None))
            return shown | self._show_check(session, names[0]) if names and not session.stale else shown

    def _enqueue(self, session: Session, files: list[str] | None, **_: Any) -> _Updates:
        session.pending_uploads.extend(files or [])
        return {self.upload: None}

    def _load(self, session: Session, *settings: Any) -> _Updates:
        files, session.pending_uploads = session.pending_uploads, []
        with uploaded_paths(files) as paths:
            if paths:  # none if an earlier event has loaded these files
                session.add(paths, _settings(settings))
        return self._show_data(session)

    def _load_example(self, name: str, session: Session, *settings: Any) -> _Updates:
        session.add([steps.examples()[name]], _settings(settings), copy=True)
        if name in session.films:
            session.film_name, session.films[name].camera = name, Camera(500_000.0, 4.0, 0.4)
        return self._show_data(session)

    def _ask_clear(self, session: Session) -> _Updates:
        """Ask whether to delete the files and answers; without any file, clear the session at once."""
        if not session.files and not session.films:
            return self._clear(session)
        return {self.clear_dialog: gr.Column(visible=True), self.clear_warning: words.clear_warning(session)}

    def _clear(self, session: Session) -> _Updates:
        session.clear()
        return self._show_data(session)

    def _show_data(self, session: Session) -> _Updates:
        names = [curve.name for curve in session.curves]
        anything = bool(names or session.films)
        shown = {
            self.file_errors: words.render("file_errors", session.problems),
            self.clear_dialog: gr.Column(visible=False),
            self.shots_table: words.shots_table(session),
            self.welcome: gr.HTML(visible=not anything),
            self.overview: gr.HTML(words.overview(session), visible=bool(names)),
            self.chosen_shots: gr.CheckboxGroup(choices=names, value=names),
            self.shown_shot: gr.Dropdown(choices=names, value=next(iter(names), None)),
            self.link: f"?session={session.link}" if anything else "",
        }
        return shown | self._show_state(session, draw=True) | self._show_film(session)

    def _show_state(self, session: Session, *, draw: bool = False) -> _Updates:
        """Enable the steps that can be used; show the answers, marked if settings changed since. draw: groups, too."""
        loaded, current = bool(session.curves), session.answers is not None and not session.stale
        groups: dict[str, Any] = {"value": words.groups(session)} if draw else {}
        able = zip(self.tabs[1:], (loaded, loaded, current, current), strict=True)
        return {tab: gr.Tab(interactive=works) for tab, works in able} | {
            self.to_prepare: gr.Button(interactive=loaded),
            self.infer_now: gr.Button(interactive=loaded),
            self.answers: words.answers(session),
            self.to_check: gr.Button(interactive=current),
            self.auto_law: gr.Button(visible=steps.law_in_doubt(session)),
            self.groups: gr.HTML(visible=current, **groups),
            self.published: gr.UploadButton(visible=current),
        }

    def _show_film(self, session: Session) -> _Updates:
        clip = session.current_clip
        names = [(f"{name}: {'not ' * (name in session.unconfirmed)}confirmed", name) for name in session.film_names]
        camera = ["" if value is None else f"{value:.10g}" for value in clip.camera]
        first, last = (clip.measurement.first, clip.measurement.last) if clip.measurement else (1, 2)
        shown = {
            self.film_step: gr.Column(visible=bool(names)),
            self.film: gr.Dropdown(names, value=session.film_name or None, visible=len(names) > 1),
            self.film_view: gr.Column(visible=clip.measurement is not None),
            self.film_number: gr.Slider(first, last, clip.shown_frame),
            self.film_excluded: clip.excluded_text,
        }
        typed = dict(zip(self.camera_boxes, camera, strict=True)) if any(camera) else {}
        return shown | typed | self._show_frame(session)

    def _show_frame(self, session: Session, number: int | str = "") -> _Updates:
        clip = session.current_clip
        clip.shown_frame = number if isinstance(number, int) else clip.shown_frame
        shown: _Updates = {self.film_summary: words.film_summary(clip)}
        if clip.measurement:
            label = "Bring this frame back" if clip.excluded[clip.shown_index] else "Exclude this frame"
            shown |= {
                self.film_frame: words.film_frame(clip),
                self.film_plot: words.film_plot(clip),
                self.film_toggle: label,
            }
        return shown

    def _select_film(self, session: Session, name: str) -> _Updates:
        session.film_name = name
        return self._show_film(session)

    def _measure(self, session: Session, *texts: str, progress: gr.Progress) -> _Updates:
        steps.measure(session, session.current_clip.read_camera(texts)[0], progress)
        return self._show_film(session)

    def _toggle_frame(self, session: Session) -> _Updates:
        session.current_clip.toggle_excluded()
        return {self.film_excluded: session.current_clip.excluded_text, **self._show_frame(session)}

    def _confirm(self, session: Session, *_: str) -> _Updates:
        steps.confirm(session)
        session.film_name = next(iter(session.unconfirmed), session.film_name)
        return self._show_data(session)

    def _show_prepared(self, session: Session, name: str | None, **_: Any) -> _Updates:
        selected = (curve for curve in session.curves if curve.name == name)
        texts = (words.prepared_curve(curve, session.settings_of(curve.name)) for curve in selected)
        return {self.prepared_curve: next(texts, "")}

    def _warn(self, session: Session, **_: Any) -> _Updates:
        return {self.input_warnings: words.render("input_warnings", words.warnings(session.curves))}

    def _change_settings(self, session: Session, name: str | None, *settings: Any) -> _Updates:
        session.apply_settings(_settings(settings))
        return {
            **self._show_prepared(session, name),
            self.shots_table: words.shots_table(session),
            **self._show_state(session),
        }

    def _begin_run(self, session: Session, chosen: list[str], *settings: Any) -> _Updates:
        session.apply_settings(_settings(settings))
        if session.runs.ready():
            session.so_far = dict.fromkeys(chosen)
        return {self.steps: gr.Tabs(selected=3), **self._refresh_answers(session)}

    def _refresh_answers(self, session: Session) -> _Updates:
        return {self.timer: gr.Timer(active=bool(session.so_far)), self.answers: words.answers(session)}

    def _answer(self, session: Session, chosen: list[str], **_: Any) -> _Updates:
        names = [curve.name for curve, _ in steps.infer(session, chosen).pairs]
        with session.lock:
            return {
                self.checked_shot: gr.Dropdown(choices=names, value=names[0]),
                **self._show_state(session, draw=True),
            }

    def _name_materials(self, session: Session, materials: str, name: str | None) -> _Updates:
        earlier, edits = words.shot_cells(session), json.loads(materials)
        steps.name_materials(session, edits["names"], edits["densities"])
        same = words.shot_cells(session) == earlier  # the table is not drawn again: the focus stays
        table = {} if same else {self.shots_table: words.shots_table(session)}
        return self._show_prepared(session, name) | table | self._show_state(session, draw=True)

    def _add_published(self, session: Session, files: list[str]) -> _Updates:
        with uploaded_paths(files) as paths:
            session.add_published(paths)
        return self._show_state(session, draw=True)

    def _open_check(self, session: Session, name: str) -> _Updates:
        return {self.steps: gr.Tabs(selected=4), self.checked_shot: name, **self._show_check(session, name)}

    def _show_check(self, session: Session, name: str) -> _Updates:
        ranges = zip(self.sliders, steps.sliders(session, name).values(), strict=True)
        answers, *_, record = session.find_answer(name)
        answers.trials.pop(name, None)
        shown = self._draw_check(session, name) | {self.trial: words.render("slider_start", record.simulation_in_words)}
        return shown | {slider: gr.Slider(visible=bool(limits), **(limits or {})) for slider, limits in ranges}  # type: ignore[arg-type]

    def _fit(self, session: Session, name: str, **_: Any) -> _Updates:
        session.runs.ready()
        steps.fit(session, name)
        with session.lock:
            return self._draw_check(session, name)

    def _draw_check(self, session: Session, name: str) -> _Updates:
        return {self.check_plot: words.check_plot(session, name), self.facts: words.facts(session, name)}

    def _try_sliders(self, session: Session, name: str, *values: float | None) -> _Updates:
        checks = steps.what_if(session, name, values)
        return {self.check_plot: words.check_plot(session, name), self.trial: words.render("trial", checks)}

    def _zip(self, session: Session, *, progress: gr.Progress) -> _Updates:
        archive, files = steps.export(session, progress)
        shown = gr.File([str(path) for path in files], visible=True)
        return {self.result_files: shown, self.download: gr.DownloadButton(value=str(archive))}


def _settings(values: Sequence[Any]) -> PageSettings:
    """Return the settings with these values, in the order of the fields of PageSettings. Raises InputError."""
    settings, errors = PageSettings.from_page(values)
    require(not errors, "; ".join(errors.values()), "app.settings")
    return settings


def _field_errors(values: Sequence[Any]) -> list[str]:
    """Return the error message of each field of PageSettings, "" where the value is valid."""
    errors = PageSettings.from_page(values)[1]
    return [words.page_text(errors.get(field.name, "")) for field in fields(PageSettings)]


@contextmanager
def uploaded_paths(files: Sequence[str]) -> Iterator[list[Path]]:
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


def _infer_endpoint(visitors: Visitors) -> Callable[..., Any]:
    """Return the function of the endpoint `/infer`, for programs; nothing is kept after a call."""

    def infer(
        files: list[gr.FileData],
        model: str = DEFAULT,
        medium: str = "water",
        density: float | None = None,
        rmax_um: float | None = None,
        stretch: float | str | None = None,
        window: int | None = None,
        material: str | None = None,
        bubble: str = "real",
        trust_input: bool = False,
        fps: float | None = None,
        um_per_px: float | None = None,
    ) -> dict[str, Any]:
        """Measured radius histories in, the content of result.json out; options as those of `cavirheo infer`."""
        values: dict[str, Any] = {**locals()}
        options = {name: value for name, value in values.items() if hasattr(PageSettings, name) and value is not None}
        session = Session(visitors.limits, visitors.reader, store=visitors.store)
        try:
            with uploaded_paths([str(dict(file)["path"]) for file in files or []]) as paths:
                session.add(paths, PageSettings(**options))
                require(
                    not session.unconfirmed,
                    f"{session.unconfirmed}: send measured.csv of `cavirheo measure`",
                    "app.film",
                )
                problem = "; ".join(session.problems) or "no curve could be read"
                require(bool(session.curves), problem, "app.no_curve")
                document = steps.infer(session, [curve.name for curve in session.curves]).document
                document.notes.extend(session.problems)
                return document.model_dump(by_alias=True, mode="json")
        except (InputError, SolverError) as error:
            raise gr.Error(words.page_text(error), title="Not done", print_exception=False) from None
        finally:
            visitors.end_session(session)

    return infer
