"""What comes from outside: events of the page, uploaded files, and the endpoint `/infer` (docs/how-to/app.md)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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

AT_ONCE: dict[str, Any] = {"queue": False, "show_progress": "hidden"}
LATEST: dict[str, Any] = {"trigger_mode": "always_last", "show_progress": "hidden"}
line = partial(gr.Textbox, max_lines=1)
button = partial(gr.Button, variant="primary")
html = partial(gr.HTML, apply_default_css=False)
Handler = Callable[..., Any]


class Events:
    """Of a page whose visitors these are; `wrong`: the component that says what was not done, and why."""

    visitors: Visitors
    wrong: Any

    def session(self, request: gr.Request) -> Session:
        return self.visitors.of(request.session_hash or "")

    def on(self, event: Any, handler: Handler, sources: Any, out: Any, *, works: bool = False, **options: Any) -> Any:
        """The event, or each of a list, calls the handler with the session of who asks and the values of components.
        The session is locked; not for a handler that `works` for a while, which gets `progress` to show a bar. What it
        fails of is said on the page."""

        def handle(request: gr.Request, progress: gr.Progress = gr.Progress(), *values: Any) -> Any:  # noqa: B008
            session = self.session(request)
            if works:
                return self._run_handler(partial(handler, progress=progress), session, *values)
            with session.lock:
                return self._run_handler(handler, session, *values)

        def why(request: gr.Request) -> str:  # on the page, where it covers nothing and goes with the next success
            return words.part("wrong", self.session(request).refusal)

        begins = partial(gr.on, event) if isinstance(event, list) else event
        handled = begins(handle, sources, [*out, self.wrong], api_visibility="private", **options)
        handled.failure(why, None, [self.wrong], api_visibility="private", **AT_ONCE)
        return handled

    def validated(self, wrong: Callable[..., list[str]]) -> Handler:
        """Shows at each field what is `wrong` with its value, and stops the event then."""

        def validate(request: gr.Request, *values: Any) -> Any:
            session = self.session(request)
            with session.lock:
                results = [gr.validate(not why, why) for why in wrong(session, *values)]
            return results if len(results) > 1 else results[0]  # as gradio takes those of several fields, and of one

        return validate

    def _run_handler(self, handler: Handler, session: Session, *values: Any) -> list[Any]:
        """What the handler returns, and that nothing is wrong; what is, is kept for the event after a failure."""
        try:
            session.refusal, result = "", handler(session, *values)
        except (InputError, SolverError) as error:
            session.refusal = words.for_page(error)
            raise gr.Error(session.refusal, visible=False, print_exception=False) from None
        return [*(result if isinstance(result, list) else [] if result is None else [result]), ""]


@contextmanager
def uploaded(files: Sequence[str]) -> Iterator[list[Path]]:
    """What the browser sent, and no other file of this machine: what is not taken over is removed."""
    folder = Path(get_upload_folder()).resolve()
    paths = [Path(file).resolve() for file in files]
    if not all(path.is_relative_to(folder) and path.is_file() for path in paths):
        raise InputError("only uploaded files are read", "app.not_uploaded")
    try:
        yield paths
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


class Served(gr.Blocks):
    """A page whose programs need not give what has a default."""

    def validate_inputs(self, block_fn: Any, inputs: list[Any]) -> None:
        inputs += [block.value for block in block_fn.inputs[len(inputs) :] if isinstance(block, Api)]
        super().validate_inputs(block_fn, inputs)


def public(visitors: Visitors) -> Callable[..., Any]:
    """The function that programs may call; nothing of a call is kept."""

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
        arguments: dict[str, Any] = {**locals()}
        names = [field.name for field in fields(PageSettings)]
        options = {name: arguments[name] for name in names if arguments.get(name) is not None}
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
