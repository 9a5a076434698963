"""The page: the layout of the five steps, the event handlers (all private), and the public endpoint `/infer`
(docs/how-to/app.md)."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, get_type_hints

import gradio as gr

from cavirheo.app import words
from cavirheo.app.session import (
    EXAMPLE_CAMERA,
    EXAMPLES,
    PAGE_FIELDS,
    SLIDERS,
    STARTS,
    PageSettings,
    Session,
    Visitors,
)
from cavirheo.errors import InputError, SolverError
from cavirheo.inference import DEFAULT
from cavirheo.physics.media import MEDIA
from cavirheo.video.formats import is_video

_DOWNLOAD = "() => document.querySelector('#error-box .failed-message') || document.querySelector('#download').click()"
_ADDRESS = "link => history.replaceState(null, '', link || location.pathname)"
_SURE = "yes"
_QUESTION = "Delete all files and answers of this page? The zip of step 5 keeps the answers."
_ASK = f"() => [!location.search || confirm('{_QUESTION}') ? '{_SURE}' : '']"
_RUNS: dict[str, Any] = {"concurrency_id": "runs", "concurrency_limit": 2}  # limit over all visitors
_LATEST: dict[str, Any] = {"trigger_mode": "always_last"}
_button = partial(gr.Button, variant="primary")
_html = partial(gr.HTML, apply_default_css=False)
_small_button = partial(gr.Button, size="sm", min_width=120)
_Updates = dict[Any, Any]  # new content by component; a component that is not a key keeps its content
_Handler = Callable[..., Any]


class _Blocks(gr.Blocks):
    """Blocks whose endpoint accepts calls without the last arguments, which then have their defaults."""

    def validate_inputs(self, block_fn: Any, inputs: list[Any], *more: Any) -> None:
        inputs += [getattr(block, "value", None) for block in block_fn.inputs[len(inputs) :]]
        super().validate_inputs(block_fn, inputs, *more)


class Page:
    """The five steps with their handlers, in `blocks`, not yet served.

    The HTML id of a component is its attribute's name, with hyphens. `error_box` is the component for error messages.
    """

    def __init__(self, visitors: Visitors) -> None:
        self.visitors = visitors
        visitors.on_forget = self._forget
        self.fields: dict[str, Any] = {}  # component of each field of PageSettings
        self.tabs: list[Any] = []
        tabs = {"Data": self._data, "Prepare": self._prepare, "Infer": self._infer}
        tabs |= {"Check": self._check, "Export": self._export}
        self.blocks = _Blocks(title="cavirheo", analytics_enabled=False, delete_cache=(300, 900), fill_width=True)
        with self.blocks:
            self.banner = _html(words.render("banner", words.VERSION))
            self.error_box = _html()
            self.link = gr.Textbox(visible="hidden", label="Address")
            with gr.Tabs(selected=1) as self.steps:
                for number, (name, part) in enumerate(tabs.items(), 1):
                    with gr.Tab(f"{number} {name}", id=number, interactive=number == 1) as tab:
                        part()
                    self.tabs.append(tab)
            components = {
                name: part for name, part in (vars(self) | self.fields).items() if isinstance(part, gr.blocks.Block)
            }
            del components["blocks"]
            for name, component in components.items():
                component.elem_id = name.replace("_", "-")
            self.outputs = [*components.values(), *self.tabs, *self.sliders]  # what a handler may change
            self._wire([self.fields[name] for name in PAGE_FIELDS])
            gr.api(_infer_endpoint(visitors), api_name="infer", concurrency_limit=4)

    # layout

    def _data(self) -> None:
        with gr.Row():
            with gr.Column(scale=3, min_width=300):
                self.upload = gr.File(label="Measured R(t), or recordings", file_count="multiple", height=160)
                _html(words.render("file_kinds", self.visitors.limits.file_mb))
                self._text_boxes("fps", "um_per_px")
                self._text_boxes("exposure_us", "exclude")
            with gr.Column(scale=2, min_width=260):
                _html(words.render("hint", "or look at a shipped example first:"))
                with gr.Row():
                    self.examples = {name: _small_button(name) for name in EXAMPLES}
                self.clear = _small_button("Start over")
                self.infer_now = _button("Infer all shots", interactive=False)
        self.file_errors = _html()
        self.welcome = _html(words.render("welcome", words.read_file("examples/answer.svg"), words.CITED))
        self.overview = _html(visible=False)
        self.input_warnings = _html()
        self.shots_table = _html()

    def _prepare(self) -> None:
        with gr.Row():
            with gr.Column(scale=2, min_width=300):
                self.chosen_shots = gr.CheckboxGroup(label="Shots to infer", show_select_all=True)
                self.fields["window"] = gr.Dropdown(words.WINDOWS, value="", label="Window that is compared")
                self.fields["group"] = gr.Dropdown(words.GROUPS, value="auto", label="Shots that are one material")
                with gr.Row():
                    self.fields["medium"] = gr.Dropdown(list(MEDIA), value="water", label="Medium", min_width=120)
                    self._text_boxes("density")
                self._text_boxes("rmax_um", "stretch")
                self.fields["trust_input"] = gr.Checkbox(label=words.with_option(words.VOUCH, "trust_input"))
                with gr.Accordion("More about the liquid", open=False):
                    self._text_boxes("sound_speed", "surface_tension")
                    self._text_boxes("pressure", "temperature")
            with gr.Column(scale=3, min_width=300):
                self.shown_shot = gr.Dropdown(label="Shot shown")
                self.prepared_curve = _html()

    def _text_boxes(self, *names: str) -> None:  # also of numbers, because an empty gr.Number stalls the page
        with gr.Row():
            for name in names:
                label, empty = words.TEXT_FIELDS[name]
                label = words.with_option(label, name)
                self.fields[name] = gr.Textbox(label=label, placeholder=empty, max_lines=1, min_width=120)

    def _infer(self) -> None:
        self.fields["material"] = gr.Radio(words.material_choices(), value="auto", label="Law of the material")
        with gr.Accordion("More about the method", open=False):
            self.fields["model"] = gr.Radio(words.model_choices(), value=DEFAULT, label="Model")
            self.fields["bubble"] = gr.Radio(words.BUBBLES, value="real", label="Bubble")
        with gr.Row():
            self.infer = _button("Infer all chosen shots")
            self.stop = gr.Button("Stop", variant="stop")  # visible only during a run: app.css
        none = words.render("hint", words.NO_ANSWERS)
        self.answers = _html(none, min_height=120, js_on_load=words.read_file("table.js"))
        self.timer = gr.Timer(1.0, active=False)

    def _check(self) -> None:
        self.checked_shot = gr.Dropdown(label="Shot")
        self.check_plot = _html()
        with gr.Row():
            sliders = SLIDERS.items()
            self.sliders = [gr.Slider(label=word, elem_id=f"slider-{key}", min_width=200) for key, (word, _) in sliders]
        self.trial = _html()
        self.facts = _html()

    def _export(self) -> None:
        _html(words.render("export"))
        self.make_zip = _button("Download cavirheo-result.zip")
        self.download = gr.DownloadButton()  # hidden: a script clicks it when the zip is ready

    # events

    def _bind(
        self,
        event: Any,
        handler: _Handler,
        inputs: Sequence[Any] = (),
        *,
        slow: bool = False,
        spinner: Any = None,
        outputs: Sequence[Any] | None = None,
        **options: Any,
    ) -> Any:
        """Bind the handler to an event, or to a list of events. It gets the visitor's session, locked unless the task
        is slow, and the values of `inputs`; it returns new content of components. Its error is shown by the page, and
        the next success clears it."""

        def handle(request: gr.Request, *values: Any) -> Any:
            session = self.visitors.session_for(request.session_hash)
            with nullcontext() if slow else session.lock:
                try:
                    updates = handler(session, *values)
                except (InputError, SolverError) as error:
                    return {self.error_box: words.render("error_box", str(error))}
            return {**updates, self.error_box: ""} if updates else gr.skip()

        listen = partial(gr.on, event) if isinstance(event, list) else event
        progress: dict[str, Any] = {"show_progress_on": [spinner]} if spinner else {"show_progress": "hidden"}
        to = self.outputs if outputs is None else [*outputs, self.error_box]
        return listen(handle, [*inputs], to, api_visibility="private", **progress, **options)

    def _wire(self, settings: list[Any]) -> None:
        bind = self._bind
        shot = [self.checked_shot]
        private: dict[str, Any] = {"api_visibility": "private"}
        loading: dict[str, Any] = {"spinner": self.shots_table}
        bind(self.upload.upload, self._load, [self.upload, *settings], trigger_mode="multiple", **loading)
        for name, example in self.examples.items():
            bind(example.click, partial(self._load_example, name), settings, **loading)
        bind(self.clear.click, self._clear, [self.link], js=_ASK)
        texts = [box for box in settings if isinstance(box, gr.Textbox)]
        changes = [event for box in texts for event in (box.blur, box.submit)]  # not while somebody types
        changes += [box.input for box in settings if box not in texts]
        bind(changes, self._change_settings, [self.shown_shot, *settings], **_LATEST)
        bind(self.shown_shot.change, self._show_prepared, [self.shown_shot], slow=True, **_LATEST)
        # warnings load the solver: they are shown later, so that the table need not wait for it
        bind(self.shots_table.change, self._warn, slow=True, **_LATEST)
        starts = [self.infer_now.click, self.infer.click]
        begin = bind(starts, self._begin_run, [self.chosen_shots, *settings], queue=False)
        bind(begin.success, self._answer, [self.chosen_shots], slow=True, **_RUNS)
        bind(self.timer.tick, self._refresh_answers, outputs=[self.timer, self.answers], queue=False)
        bind(self.stop.click, self._stop, queue=False)
        js = "() => [document.body.dataset.picked]"
        bind(self.answers.click, self._open_check, shot, js=js, **_LATEST)
        bind(self.checked_shot.select, self._show_check, shot)
        moves = [slider.input for slider in self.sliders]
        pictures = [self.check_plot, self.trial]
        bind(moves, self._try_sliders, [*shot, *self.sliders], outputs=pictures, queue=False, **_LATEST)
        zipped = bind(self.make_zip.click, self._zip, slow=True, spinner=self.make_zip, concurrency_limit=1)
        zipped.success(None, js=_DOWNLOAD, **private)
        self.link.change(None, self.link, js=_ADDRESS, **private)
        self.blocks.load(self._restore, None, self.outputs, show_progress="hidden", **private)
        self.blocks.unload(self._leave)

    def _leave(self, request: gr.Request) -> None:
        self.visitors.leave(request.session_hash or "")

    def _forget(self, name: str) -> None:
        """Drop what gradio itself keeps of a page that was closed, if it does: figures and tables."""
        data = getattr(getattr(self.blocks, "state_holder", None), "session_data", {})
        data.pop(name, None)

    def _restore(self, request: gr.Request) -> Any:
        """Restore the session on a page that is reloaded, or opened by the link of the session."""
        session = self.visitors.reopen(request.session_hash or "", request.query_params.get("session", ""))
        if session is None:
            return gr.skip()  # all components stay as they are
        with session.lock:
            names = [curve.name for curve, _ in session.answers.pairs] if session.answers else []
            updates = self._show_data(session) | self._show_settings(session)
            updates[self.checked_shot] = gr.Dropdown(choices=names, value=next(iter(names), None))
            return updates | self._show_check(session, names[0]) if names else updates

    def _load(self, session: Session, files: list[str] | None, *settings: Any) -> _Updates:
        with uploaded_paths(files or []) as paths:
            if paths:  # none if an earlier event has loaded these files
                session.add(paths, _settings(settings))
        return self._show_data(session) | {self.upload: None}

    def _load_example(self, name: str, session: Session, *settings: Any) -> _Updates:
        path = EXAMPLES[name]
        camera: dict[str, Any] = EXAMPLE_CAMERA if is_video(path) else {}
        session.add([path], replace(_settings(settings), **camera), copy=True)
        return self._show_data(session) | self._show_settings(session)

    def _clear(self, session: Session, sure: str) -> _Updates:
        if sure != _SURE:
            return {}
        session.clear()
        return self._show_data(session)

    def _show_settings(self, session: Session) -> _Updates:
        values = {"window": ""} | STARTS
        values |= {name: value for name in PAGE_FIELDS if (value := getattr(session.settings, name)) is not None}
        texts = {name: f"{value:.10g}" for name, value in values.items() if isinstance(value, float)}
        return {self.fields[name]: value for name, value in (values | texts).items()}

    def _show_data(self, session: Session) -> _Updates:
        names = session.names
        loaded = {
            self.welcome: gr.HTML(visible=not session.files),
            self.chosen_shots: gr.CheckboxGroup(choices=names, value=names),
            self.shown_shot: gr.Dropdown(choices=names, value=next(iter(names), None)),
            self.link: f"?session={session.link}" if session.files else "",
        }
        return loaded | self._show_tables(session) | self._show_state(session)

    def _show_tables(self, session: Session) -> _Updates:
        return {
            self.file_errors: words.render("file_errors", session.problems),
            self.overview: gr.HTML(words.overview(session), visible=bool(session.curves)),
            self.shots_table: words.shots_table(session),
        }

    def _show_state(self, session: Session) -> _Updates:
        """Enable the steps that can be used; show the answers, marked if settings changed since."""
        loaded = bool(session.curves)
        current = session.answers is not None
        able = zip(self.tabs[1:], (loaded, loaded, current, current), strict=True)
        return {tab: gr.Tab(interactive=works) for tab, works in able} | {
            self.infer_now: gr.Button(interactive=loaded),
            self.answers: words.answers(session),
        }

    def _show_prepared(self, session: Session, name: str | None) -> _Updates:
        curve = next((curve for curve in session.curves if curve.name == name), None)
        return {self.prepared_curve: words.prepared_curve(curve, session.settings) if curve else ""}

    def _warn(self, session: Session) -> _Updates:
        return {self.input_warnings: words.render("input_warnings", words.curve_warnings(session.curves))}

    def _change_settings(self, session: Session, name: str | None, *settings: Any) -> _Updates:
        before = session.settings
        curves = session.curves
        names = session.names
        session.apply_settings(_settings(settings))
        if session.settings == before:
            return {self.error_box: ""}
        if session.names != names:  # a recording was measured
            return self._show_data(session)
        tables = {} if session.curves is curves else self._show_tables(session)
        return self._show_prepared(session, name) | tables | self._show_state(session)

    def _begin_run(self, session: Session, chosen: list[str], *settings: Any) -> _Updates:
        session.apply_settings(_settings(settings))
        session.announce(chosen)
        return {self.steps: gr.Tabs(selected=3), **self._refresh_answers(session)}

    def _stop(self, session: Session) -> None:
        if session.run:
            session.run.stopped.set()

    def _refresh_answers(self, session: Session) -> _Updates:
        return {self.timer: gr.Timer(active=session.run is not None), self.answers: words.answers(session)}

    def _answer(self, session: Session, chosen: list[str]) -> _Updates:
        if session.run is None or session.run.working:  # the beginning failed
            return {}
        names = [curve.name for curve, _ in session.infer(chosen).pairs]
        with session.lock:
            updates = {self.checked_shot: gr.Dropdown(choices=names, value=names[0])}
            return updates | self._show_state(session) | self._show_check(session, names[0])

    def _open_check(self, session: Session, name: str) -> _Updates:
        return {self.steps: gr.Tabs(selected=4), self.checked_shot: name, **self._show_check(session, name)}

    def _show_check(self, session: Session, name: str) -> _Updates:
        answers, *_, record = session.find_answer(name)
        answers.trials.pop(name, None)
        updates: _Updates = {self.check_plot: words.check_plot(session, name), self.facts: words.facts(session, name)}
        updates[self.trial] = words.render("slider_start", bool(record.best))
        for slider, limits in zip(self.sliders, session.sliders(name).values(), strict=True):
            updates[slider] = gr.Slider(visible=bool(limits), **(limits or {}))  # type: ignore[arg-type]
        return updates

    def _try_sliders(self, session: Session, name: str, *values: float | None) -> _Updates:
        checks = session.what_if(name, values)
        return {self.check_plot: words.check_plot(session, name), self.trial: words.render("trial", checks)}

    def _zip(self, session: Session) -> _Updates:
        return {self.download: gr.DownloadButton(value=str(session.export()))}


def _settings(values: Sequence[Any]) -> PageSettings:
    """The settings with these values of PAGE_FIELDS, in their order."""
    return PageSettings(**dict(zip(PAGE_FIELDS, values, strict=True)))


@contextmanager
def uploaded_paths(files: Sequence[str]) -> Iterator[list[Path]]:
    """Yield the paths of uploaded files that exist, and delete them at the end. Raises InputError: another file."""
    folder = Path(os.environ["GRADIO_TEMP_DIR"]).resolve()
    paths = [Path(file).resolve() for file in files]
    if not all(path.is_relative_to(folder) for path in paths):
        raise InputError("only uploaded files are read", "app.not_uploaded")
    try:
        yield [path for path in paths if path.is_file()]
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


def _infer_endpoint(visitors: Visitors) -> Callable[..., Any]:
    """The function of the endpoint `/infer`: files, then the values of PAGE_FIELDS. Nothing is kept after a call."""

    def infer(files: list[gr.FileData], *options: Any) -> dict[str, Any]:
        """Measured radius histories in, the content of result.json out; options as those of `cavirheo infer`."""
        session = Session(visitors)
        try:
            with uploaded_paths([str(dict(file)["path"]) for file in files or []]) as paths:
                session.add(paths, _settings(options))
                if not session.curves:
                    raise InputError("; ".join(session.problems) or "no curve could be read", "app.no_curve")
                document = session.infer(session.names).document
                document.notes.extend(session.problems)
                return document.model_dump(by_alias=True, mode="json")
        except (InputError, SolverError) as error:
            raise gr.Error(str(error), title="Not done", print_exception=False) from None
        finally:
            session.close()

    plain = signature(infer)
    kind = Parameter.POSITIONAL_OR_KEYWORD
    options = [Parameter(name, kind, default=getattr(PageSettings, name)) for name in PAGE_FIELDS]
    infer.__signature__ = plain.replace(parameters=[plain.parameters["files"], *options])  # type: ignore[attr-defined]
    hints = get_type_hints(PageSettings)
    infer.__annotations__ |= {name: hints[name] for name in PAGE_FIELDS}
    return infer
